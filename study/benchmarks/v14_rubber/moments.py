"""Moments of the nodal forces of a rubber body about its deformed nodes.

A virtual rotation of the deformed body, omega x (X + u), is a trial function but no sum of
piecewise-linear weights w_i, so the moments of nodal forces f_i about deformed nodes x_i do not
cancel. Free nodes carry no force and may be placed anywhere in that sum. In the plane T^-T x is
a suitable position: that of a mid-side node is 4/3 of its own less 1/6 of each vertex's position.
On a straight triangle the sums of x_i N_i and of (T^-T x)_i w_i have gradients with the same
averages against every linear stress. The first gradient is F, and P F^T is symmetric. A triangle
therefore contributes only the skew part of

    integral of (P - P_1) (grad sum (T^-T x)_i w_i - F)^T,

where P_1 is the best linear approximation of P. This vanishes if P is linear in F; otherwise it is
of order h^3 times the area where the deformation is smooth, and of order h where stresses grow as
1 / h at a point.

In space T has no such identity, but the argument with weights still holds: for any w in their span

    integral of (P_h - P) : grad (omega x x - w)

is the moment, if that of the loads is taken from their density at deformed points (nodal loads at
deformed nodes are only of second order). It is at least of third order.
"""

from collections.abc import Callable
from typing import TypeAlias

import basix.ufl
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem

from pw_elements import PetrovGalerkinProblem, Sibling, assemble_vector, cell_measure, prescribe
from study.meshes.mesh_families import on_cube, on_square
from study.model.discretisation import spaces
from study.model.units import dimensionless
from study.run.store import Result

Array = npt.NDArray[np.float64]
StressLaw: TypeAlias = Callable[[ufl.core.expr.Expr], ufl.core.expr.Expr]
"""First Piola-Kirchhoff stress as a function of the deformation gradient."""

LAME_OVER_SHEAR = 1.5
SUB_CELL_QUADRATURE_DEGREES = {2: 6, 3: 4}
"""Degree of quadrature on sub-cells in the smooth problem, by dimension."""
LOAD_MOMENT_QUADRATURE_DEGREE = 10
"""Degree of quadrature of the moment of the load density."""


def neo_hookean_stress(F: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
    """Return the neo-Hookean stress over the shear modulus."""
    inverse = ufl.inv(F).T
    return F - inverse + LAME_OVER_SHEAR * ufl.ln(ufl.det(F)) * inverse


def linear_stress(F: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
    """Return the stress of the energy |F|^2 / 2 - det F, in the plane linear in F and objective."""
    return F - ufl.cofac(F)


def internal_work_form(
    u: fem.Function, weights: ufl.Argument, degree: int, stress: StressLaw = neo_hookean_stress
) -> ufl.Form:
    """Return the form of the first Piola-Kirchhoff stress times the gradients of the weights."""
    stresses = stress(ufl.Identity(len(u)) + ufl.grad(u))
    dx = cell_measure(weights.ufl_function_space(), degree)
    return ufl.inner(stresses, ufl.grad(weights)) * dx


def moments_about_origin(position: Array, force: Array) -> Array:
    """Return moments (n, 3) about the origin of forces (n, dim) at positions (n, dim)."""
    padding = (0, 0), (0, 3 - position.shape[1])
    return np.cross(np.pad(position, padding), np.pad(force, padding))


def triangle_moment_contributions(
    u: fem.Function, degree: int, stress: StressLaw = neo_hookean_stress
) -> Array:
    """Return the moments (cells,) of the nodal forces of each triangle at T^-T x.

    Their sum is the moment of all nodal forces about the deformed nodes.
    """
    space = u.function_space
    element = basix.ufl.element("iso", "triangle", 1, shape=(2,), discontinuous=True)
    cell_weights = fem.functionspace(space.mesh, element)
    work = internal_work_form(u, ufl.TestFunction(cell_weights), degree, stress)
    force = fem.assemble_vector(fem.form(work)).array.reshape(-1, 2)[cell_weights.dofmap.list]
    position = _weight_coefficients(u)[space.dofmap.list]
    nodal_moments = moments_about_origin(position.reshape(-1, 2), force.reshape(-1, 2))
    return nodal_moments[:, 2].reshape(len(position), -1).sum(axis=1)


def smooth(element: str, elements: int) -> Result:
    """Deform a unit square or cube, fixed on its boundary, by the body force of a smooth field.

    Meshes are unstructured. The moment of reactions and loads, over the sum of all magnitudes, is
    given in three ways: with the moment of the load density, and with nodal loads at the deformed
    nodes or at T^-T x.
    """
    mesh = (on_square if element.endswith("T6") else on_cube)(element, 1 / elements)
    dim, degree = mesh.geometry.dim, SUB_CELL_QUADRATURE_DEGREES[mesh.geometry.dim]
    pair = spaces(element, mesh)
    space, u, weights = pair.trial, fem.Function(pair.trial), ufl.TestFunction(pair.test)
    X, size = ufl.SpatialCoordinate(mesh), fem.Constant(mesh, 1.0)
    bubble = np.prod([ufl.sin(ufl.pi * X[axis]) for axis in range(dim)])
    exact = bubble * ufl.as_vector([0.13 + 0.13 * X[1], -0.1 - 0.05 * X[0], 0.08 * X[0]][:dim])
    load = -ufl.div(neo_hookean_stress(ufl.Identity(dim) + size * ufl.grad(exact)))
    external_work = ufl.inner(load, weights) * cell_measure(pair.test, degree)

    def is_on_boundary(x: Array) -> npt.NDArray[np.bool_]:
        return np.asarray((np.abs(x[:dim] - 0.5) > 0.5 - 1e-9).any(axis=0))

    supports = [prescribe(space, axis, is_on_boundary) for axis in range(dim)]
    problem = PetrovGalerkinProblem(
        internal_work_form(u, weights, degree) - external_work, u, supports
    )
    problem.solve(size, increments=4)

    x = space.tabulate_dof_coordinates()[:, :dim] + u.x.array.reshape(-1, dim)
    reaction_moments = moments_about_origin(x, problem.reactions().array_r.reshape(-1, dim))
    nodal_loads = assemble_vector(external_work).array_r.reshape(-1, dim)
    load_moments_at_nodes = moments_about_origin(x, nodal_loads)
    load_moments_at_coefficients = moments_about_origin(_weight_coefficients(u), nodal_loads)
    moment_density = ufl.cross(*(ufl.as_vector([*v, *[0.0] * (3 - dim)]) for v in (X + u, load)))
    dx = ufl.dx(metadata={"quadrature_degree": LOAD_MOMENT_QUADRATURE_DEGREE})
    load_moment = np.array(
        [fem.assemble_scalar(fem.form(moment_density[axis] * dx)) for axis in range(3)]
    )
    magnitudes = np.linalg.norm(np.vstack([reaction_moments, load_moments_at_nodes]), axis=1).sum()
    scalars = {
        name: float(np.linalg.norm(reaction_moments.sum(axis=0) + total) / magnitudes)
        for name, total in (
            ("moment_defect", load_moment),
            ("moment_defect_at_nodes", load_moments_at_nodes.sum(axis=0)),
            ("moment_defect_at_coefficients", load_moments_at_coefficients.sum(axis=0)),
        )
    }
    return Result(scalars, dimensionless(scalars), {}, dofs=x.size)


def _weight_coefficients(u: fem.Function) -> Array:
    """Return T^-T x, (n, dim), the coefficients of the weights for the deformed position x."""
    space = u.function_space
    dim = space.mesh.geometry.dim
    coefficients = Sibling.from_space(space).coefficients(u.x.petsc_vec).array_r.reshape(-1, dim)
    return np.asarray(space.tabulate_dof_coordinates()[:, :dim] + coefficients)
