"""Moments of the nodal forces on a rubber body about its deformed nodes.

A virtual rotation of the deformed body, omega x (X + u), is a trial function but no combination of
the piecewise-linear test functions w_i. The moments of the nodal forces f_i about deformed nodes
x_i therefore do not cancel. As unsupported nodes carry no force, any position may be assigned to
them in the sum of moments. In the plane T^-T x, with the force-transfer matrix T, is a suitable
position: for a mid-side node it is 4/3 of its position less 1/6 of the position of each vertex. On
a straight triangle the sums of x_i N_i, with the shape functions N_i, and of (T^-T x)_i w_i have
gradients with the same averages against every linear stress. The first gradient is the deformation
gradient F, and P F^T, with the first Piola-Kirchhoff stress P, is symmetric. A triangle therefore
contributes only the skew part of

    integral of (P - P_1) (grad sum (T^-T x)_i w_i - F)^T,

where P_1 is the best linear approximation of P. This vanishes if P is linear in F; otherwise it is
of order h^3 times the area where the deformation is smooth, and of order h where stresses grow as 1
/ h at a point.

In three dimensions T has no such identity, but the argument with test functions still holds: for
any w in the span of the test functions,

    integral of (P_h - P) : grad (omega x x - w)

is the moment if the moment of the loads is integrated from their density at deformed points (nodal
loads at deformed nodes give only second order). It is at least of third order.
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
from study.model.discretisation import make_element_spaces
from study.model.units import assign_unit_one_to_scalars
from study.run.store import Result

Array = npt.NDArray[np.float64]
StressLaw: TypeAlias = Callable[[ufl.core.expr.Expr], ufl.core.expr.Expr]
"""First Piola-Kirchhoff stress as a function of the deformation gradient."""

LAME_OVER_SHEAR = 1.5
SUB_CELL_QUADRATURE_DEGREES = {2: 6, 3: 4}
"""Degree of quadrature on sub-cells in the problem `smooth`, by dimension."""
LOAD_MOMENT_QUADRATURE_DEGREE = 10
"""Degree of quadrature of the moment of the load density."""


def neo_hookean_piola_kirchhoff_stress(F: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
    """Return the neo-Hookean first Piola-Kirchhoff stress over the shear modulus.

    Args:
        F: Deformation gradient.
    """
    inverse = ufl.inv(F).T
    return F - inverse + LAME_OVER_SHEAR * ufl.ln(ufl.det(F)) * inverse


def plane_stress_linear_in_deformation_gradient(F: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
    """Return the first Piola-Kirchhoff stress F - cof F of the energy density |F|^2 / 2 - det F.

    In the plane this stress is linear in F and objective.

    Args:
        F: Deformation gradient.
    """
    return F - ufl.cofac(F)


def internal_virtual_work_form(
    u: fem.Function,
    test_functions: ufl.Argument,
    quadrature_degree: int,
    stress: StressLaw = neo_hookean_piola_kirchhoff_stress,
) -> ufl.Form:
    """Return the internal virtual work of the first Piola-Kirchhoff stress as a linear form.

    Args:
        u: Displacements.
        test_functions: Test functions.
        quadrature_degree: Degree of quadrature on each cell or sub-cell.
        stress: Function that returns the stress of a deformation gradient.
    """
    stresses = stress(ufl.Identity(len(u)) + ufl.grad(u))
    dx = cell_measure(test_functions.ufl_function_space(), quadrature_degree)
    return ufl.inner(stresses, ufl.grad(test_functions)) * dx


def moments_about_origin(position: Array, force: Array) -> Array:
    """Return moments (n, 3) about the origin of forces (n, dim) at positions (n, dim)."""
    padding = (0, 0), (0, 3 - position.shape[1])
    return np.cross(np.pad(position, padding), np.pad(force, padding))


def moment_contributions_of_triangles(
    u: fem.Function, quadrature_degree: int, stress: StressLaw = neo_hookean_piola_kirchhoff_stress
) -> Array:
    """Return the contribution (cells,) of each triangle to the moment of the nodal forces.

    The forces of each triangle act at the positions T^-T x (see the head of the module). The sum of
    the contributions is the moment of all nodal forces about the deformed nodes.

    Args:
        u: Displacements of a triangular mesh.
        quadrature_degree: Degree of quadrature.
        stress: Function that returns the stress of a deformation gradient.
    """
    space = u.function_space
    element = basix.ufl.element("iso", "triangle", 1, shape=(2,), discontinuous=True)
    cell_weights = fem.functionspace(space.mesh, element)
    work = internal_virtual_work_form(u, ufl.TestFunction(cell_weights), quadrature_degree, stress)
    force = fem.assemble_vector(fem.form(work)).array.reshape(-1, 2)[cell_weights.dofmap.list]
    position = _weight_coefficients_of_deformed_position(u)[space.dofmap.list]
    nodal_moments = moments_about_origin(position.reshape(-1, 2), force.reshape(-1, 2))
    return nodal_moments[:, 2].reshape(len(position), -1).sum(axis=1)


def smooth(element: str, elements: int) -> Result:
    """Return resultant moments of reactions and loads on a body that is deformed smoothly.

    A body force deforms a unit square or cube with an unstructured mesh and a fixed boundary. The
    resultant moment, over the sum of the magnitudes of all nodal moments, is given in three ways:
    `moment_defect` integrates the load density, `moment_defect_at_nodes` applies nodal loads at the
    deformed nodes, and `moment_defect_at_coefficients` applies them at T^-T x.

    Args:
        element: Element name, "pw-T6" or "pw-T10".
        elements: Number of elements along a side.
    """
    mesh = (on_square if element.endswith("T6") else on_cube)(element, 1 / elements)
    dim, degree = mesh.geometry.dim, SUB_CELL_QUADRATURE_DEGREES[mesh.geometry.dim]
    pair = make_element_spaces(element, mesh)
    space, u, weights = pair.trial, fem.Function(pair.trial), ufl.TestFunction(pair.test)
    X, size = ufl.SpatialCoordinate(mesh), fem.Constant(mesh, 1.0)
    bubble = np.prod([ufl.sin(ufl.pi * X[axis]) for axis in range(dim)])
    exact = bubble * ufl.as_vector([0.13 + 0.13 * X[1], -0.1 - 0.05 * X[0], 0.08 * X[0]][:dim])
    load = -ufl.div(neo_hookean_piola_kirchhoff_stress(ufl.Identity(dim) + size * ufl.grad(exact)))
    external_work = ufl.inner(load, weights) * cell_measure(pair.test, degree)

    def is_on_boundary(x: Array) -> npt.NDArray[np.bool_]:
        return np.asarray((np.abs(x[:dim] - 0.5) > 0.5 - 1e-9).any(axis=0))

    supports = [prescribe(space, axis, is_on_boundary) for axis in range(dim)]
    problem = PetrovGalerkinProblem(
        internal_virtual_work_form(u, weights, degree) - external_work, u, supports
    )
    problem.solve(size, increments=4)

    x = space.tabulate_dof_coordinates()[:, :dim] + u.x.array.reshape(-1, dim)
    reaction_moments = moments_about_origin(x, problem.reactions().array_r.reshape(-1, dim))
    nodal_loads = assemble_vector(external_work).array_r.reshape(-1, dim)
    load_moments_at_nodes = moments_about_origin(x, nodal_loads)
    load_moments_at_coefficients = moments_about_origin(
        _weight_coefficients_of_deformed_position(u), nodal_loads
    )
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
    return Result(scalars, assign_unit_one_to_scalars(scalars), {}, dofs=x.size)


def _weight_coefficients_of_deformed_position(u: fem.Function) -> Array:
    """Return T^-T x (n, dim), the test-function coefficients of the deformed position x."""
    space = u.function_space
    dim = space.mesh.geometry.dim
    coefficients = Sibling.from_space(space).coefficients(u.x.petsc_vec).array_r.reshape(-1, dim)
    return np.asarray(space.tabulate_dof_coordinates()[:, :dim] + coefficients)
