"""What moment the nodal forces of a rubber body have about its deformed nodes, and where from.

A virtual rotation of the deformed body, omega x (X + u), is a trial function but no sum of
piecewise-linear weights w_i, so the moments of nodal forces f_i about deformed nodes x_i add up to
something. Free nodes carry no force, and in that sum they may be placed anywhere. In the plane
T^-T x is a good place, where the force of a mid-side node is at 4/3 of its own position less 1/6 of
either vertex': on a straight triangle the sums of x_i N_i and of (T^-T x)_i w_i have gradients with
the same averages over every linear stress. The first gradient is F, and P F^T is symmetric. So all
that a triangle adds is the skew part of

    integral of (P - P_1) (grad sum (T^-T x)_i w_i - F)^T,

P_1 being the best linear approximation of P: nothing where P is linear in F, otherwise h^3 times
the area where all is smooth, h where stresses grow as 1 / h at a point.

In space T has no such identity. There is still the argument by weights: for any w of their span

    integral of (P_h - P) : grad (omega x x - w)

is the moment, if loads have their own (that of their density about deformed points, not that of
nodal loads about deformed nodes, which is of second order): third order at least.
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
Stress: TypeAlias = Callable[[ufl.core.expr.Expr], ufl.core.expr.Expr]
"""First Piola-Kirchhoff stress of a deformation gradient."""

LAME = 1.5  # over the shear modulus
# Degrees of quadrature of the smooth problem, by sub-cells, and of its load's own moment
_DEGREE, _OWN_DEGREE = {2: 6, 3: 4}, 10


def neo_hookean(F: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
    """Over the shear modulus."""
    inverse = ufl.inv(F).T
    return F - inverse + LAME * ufl.ln(ufl.det(F)) * inverse


def linear_stress(F: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
    """Of an energy |F|^2 / 2 - det F: in the plane linear in F, and yet objective."""
    return F - ufl.cofac(F)


def internal_work(
    u: fem.Function, weights: ufl.Argument, degree: int, stress: Stress = neo_hookean
) -> ufl.Form:
    """First Piola-Kirchhoff stress times the weights' gradients."""
    stresses = stress(ufl.Identity(len(u)) + ufl.grad(u))
    dx = cell_measure(weights.ufl_function_space(), degree)
    return ufl.inner(stresses, ufl.grad(weights)) * dx


def moments(place: Array, force: Array) -> Array:
    """About the origin, (n, 3), of forces at places (n, dim)."""
    room = (0, 0), (0, 3 - place.shape[1])
    return np.cross(np.pad(place, room), np.pad(force, room))


def moments_of_triangles(u: fem.Function, degree: int, stress: Stress = neo_hookean) -> Array:
    """What each triangle's own nodal forces have about T^-T x, (cells,); they add up to the sum."""
    space = u.function_space
    element = basix.ufl.element("iso", "triangle", 1, shape=(2,), discontinuous=True)
    own = fem.functionspace(space.mesh, element)
    work = internal_work(u, ufl.TestFunction(own), degree, stress)
    force = fem.assemble_vector(fem.form(work)).array.reshape(-1, 2)[own.dofmap.list]
    place = _coefficients(u)[space.dofmap.list]
    cells = moments(place.reshape(-1, 2), force.reshape(-1, 2))
    return cells[:, 2].reshape(len(place), -1).sum(axis=1)


def smooth(element: str, elements: int) -> Result:
    """A unit square or cube held all around, deformed inside by a force that is known.

    Meshes are Gmsh's. Over the sum of all magnitudes, reactions' moment with the load's is given in
    three ways: the load's own one, and those of nodal loads at the deformed nodes and at T^-T x.
    """
    mesh = (on_square if element.endswith("T6") else on_cube)(element, 1 / elements)
    dim, degree = mesh.geometry.dim, _DEGREE[mesh.geometry.dim]
    pair = spaces(element, mesh)
    space, u, weights = pair.trial, fem.Function(pair.trial), ufl.TestFunction(pair.test)
    X, size = ufl.SpatialCoordinate(mesh), fem.Constant(mesh, 1.0)
    bubble = np.prod([ufl.sin(ufl.pi * X[axis]) for axis in range(dim)])
    exact = bubble * ufl.as_vector([0.13 + 0.13 * X[1], -0.1 - 0.05 * X[0], 0.08 * X[0]][:dim])
    load = -ufl.div(neo_hookean(ufl.Identity(dim) + size * ufl.grad(exact)))
    loads = ufl.inner(load, weights) * cell_measure(pair.test, degree)

    def around(x: Array) -> npt.NDArray[np.bool_]:
        return np.asarray((np.abs(x[:dim] - 0.5) > 0.5 - 1e-9).any(axis=0))

    held = [prescribe(space, axis, around) for axis in range(dim)]
    problem = PetrovGalerkinProblem(internal_work(u, weights, degree) - loads, u, held)
    problem.solve(size, increments=4)

    X_nodes = space.tabulate_dof_coordinates()[:, :dim]
    x = X_nodes + u.x.array.reshape(-1, dim)
    supports = moments(x, problem.reactions().array_r.reshape(-1, dim))
    force = assemble_vector(loads).array_r.reshape(-1, dim)
    at_nodes, at_coefficients = (moments(place, force) for place in (x, _coefficients(u)))
    turning = ufl.cross(*(ufl.as_vector([*v, *[0.0] * (3 - dim)]) for v in (X + u, load)))
    dx = ufl.dx(metadata={"quadrature_degree": _OWN_DEGREE})
    of_load = np.array([fem.assemble_scalar(fem.form(turning[axis] * dx)) for axis in range(3)])
    magnitudes = np.linalg.norm(np.vstack([supports, at_nodes]), axis=1).sum()
    scalars = {
        name: float(np.linalg.norm(supports.sum(axis=0) + other) / magnitudes)
        for name, other in (
            ("moment_defect", of_load),
            ("moment_defect_at_nodes", at_nodes.sum(axis=0)),
            ("moment_defect_at_coefficients", at_coefficients.sum(axis=0)),
        )
    }
    return Result(scalars, dimensionless(scalars), {}, dofs=x.size)


def _coefficients(u: fem.Function) -> Array:
    """Places T^-T x, (n, dim), that give piecewise-linear weights the deformed body's averages."""
    space = u.function_space
    dim = space.mesh.geometry.dim
    coefficients = Sibling.from_space(space).coefficients(u.x.petsc_vec).array_r.reshape(-1, dim)
    return np.asarray(space.tabulate_dof_coordinates()[:, :dim] + coefficients)
