"""Manufactured solutions on several bodies, and errors of elements relative to these solutions."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import default_scalar_type, fem
from dolfinx.mesh import Mesh
from ufl.core.expr import Expr

from pw_elements import (
    Body,
    Material,
    as_function,
    assemble_matrix,
    assemble_vector,
    boundary_measure,
    prescribe,
    solve,
)
from pw_elements.elasticity import StressState
from pw_elements.spaces import Marker, piecewise_linear_sub_cell_element
from study.meshes.mesh_families import (
    INNER_RADIUS,
    fit_convergence_order,
    mean_cell_size,
    on_cube,
    on_curved_ring,
    on_hollow_ball,
    on_pairs,
    on_ring,
    on_square,
)
from study.model.discretisation import Discretisation, make_element_spaces
from study.model.units import assign_unit_one_to_scalars
from study.run.store import Result
from study.solutions import manufactured
from study.solutions.manufactured import DisplacementField

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

DEGREE = 6
"""Quadrature degree of loads and errors, which are not polynomials; 8 changes errors by < 0.2 %."""


@dataclass(frozen=True)
class ManufacturedSolution:
    """Prescribed displacement field on a body, with the loads that make it the exact solution.

    Args:
        body: Body with its mesh, material and stress state.
        displacement_components: Function (m, x, compliance) that returns the components of the
            displacement.
    """

    body: Body
    displacement_components: DisplacementField

    @property
    def mesh(self) -> Mesh:
        """Mesh of the body."""
        return self.body.spaces.mesh

    @property
    def displacement(self) -> Expr:
        """Exact displacement as a UFL expression."""
        compliance = fem.Constant(self.mesh, default_scalar_type(self._inverse_lame_lambda()))
        return ufl.as_vector(
            self.displacement_components(ufl, ufl.SpatialCoordinate(self.mesh), compliance)
        )

    def evaluate_displacement_at_nodes(self, space: fem.FunctionSpace) -> Array:
        """Evaluate the exact displacement at the nodes of a space, (n_nodes, n_components)."""
        x = space.tabulate_dof_coordinates().T
        return np.column_stack(self.displacement_components(np, x, self._inverse_lame_lambda()))

    def assemble_body_force_and_traction(self, traction_boundary: Marker) -> PETSc.Vec:
        """Assemble the load vector of the exact body force and of exact boundary tractions."""
        body = self.body
        loaded_body = Body(body.spaces, body.material, body.state, quadrature_degree=DEGREE)
        body_force = assemble_vector(loaded_body.body_load(-self._divergence_of_stress()))
        return body_force + self.assemble_exact_traction(traction_boundary)

    def assemble_exact_traction(self, boundary: Marker) -> PETSc.Vec:
        """Assemble the load vector of the exact tractions on a part of the boundary."""
        axes = (
            [0, 1] if self.body.state is StressState.AXISYMMETRIC else range(len(self.displacement))
        )
        stress, normal = self.body.stress(self.displacement), ufl.FacetNormal(self.mesh)
        traction = ufl.as_vector([sum(stress[i, j] * normal[j] for j in axes) for i in axes])
        surface = boundary_measure(self.mesh, boundary, DEGREE)
        return assemble_vector(self.body.surface_load(traction, surface))

    def compute_relative_error_norms(
        self, u: fem.Function, function_for_gradient: fem.Function
    ) -> dict[str, float]:
        """Compute relative errors of displacement (H1 seminorm, L2 norm) and stress (L2 norm).

        Args:
            u: Computed displacement, from which the stress is also computed.
            function_for_gradient: Function whose gradient is compared with the exact gradient for
                the H1 seminorm; differs from `u` if the element assumes another gradient.

        Returns:
            Relative errors "H1", "L2" and "stress".
        """
        exact = self.displacement
        pairs = {
            "H1": (self._gradient(function_for_gradient), self._gradient(exact)),
            "L2": (u, exact),
            "stress": (self.body.stress(u), self.body.stress(exact)),
        }
        squares = []
        for computed_value, exact_value in pairs.values():
            difference = computed_value - exact_value
            squares += [ufl.inner(difference, difference), ufl.inner(exact_value, exact_value)]
        # one form on piecewise constants, instead of six forms
        constants = fem.functionspace(self.mesh, ("DG", 0, (len(squares),)))
        dx = ufl.dx(domain=self.mesh, metadata={"quadrature_degree": DEGREE})
        form = (
            ufl.inner(ufl.as_vector(squares), ufl.TestFunction(constants))
            * self._thickness_or_circumference()
            * dx
        )
        sums = assemble_vector(form).array.reshape(-1, len(squares)).sum(axis=0)
        relative_errors = np.sqrt(sums[::2] / sums[1::2])
        return dict(zip(pairs, relative_errors.tolist(), strict=True))

    def _inverse_lame_lambda(self) -> float:
        E, nu = self.body.material.youngs_modulus, self.body.material.poissons_ratio
        return float((1 + nu) * (1 - 2 * nu) / (E * nu))

    def _gradient(self, u: Expr) -> Expr:
        """Return the displacement gradient; in axisymmetry it is 3 x 3 and includes u_r / r."""
        grad = ufl.grad(u)
        if self.body.state is not StressState.AXISYMMETRIC:
            return grad
        hoop = u[0] / self._radius()
        return ufl.as_tensor(
            [[grad[0, 0], grad[0, 1], 0], [grad[1, 0], grad[1, 1], 0], [0, 0, hoop]]
        )

    def _divergence_of_stress(self) -> Expr:
        stress = self.body.stress(self.displacement)
        if self.body.state is not StressState.AXISYMMETRIC:
            return ufl.div(stress)
        r = self._radius()
        return ufl.as_vector(
            [
                stress[0, 0].dx(0) + stress[0, 1].dx(1) + (stress[0, 0] - stress[2, 2]) / r,
                stress[0, 1].dx(0) + stress[1, 1].dx(1) + stress[0, 1] / r,
            ]
        )

    def _thickness_or_circumference(self) -> Expr | float:
        """Return the factor of area integrals: 2 pi r in axisymmetry, otherwise the thickness 1."""
        return 2 * np.pi * self._radius() if self.body.state is StressState.AXISYMMETRIC else 1.0

    def _radius(self) -> Expr:
        return ufl.SpatialCoordinate(self.mesh)[0]


# Settings

YOUNGS_MODULUS = 1.0
ERROR_NORMS = ("H1", "L2", "stress", "force")
SURFACE_TOLERANCE = 1e-6
"""Distance up to which a node counts as on a surface; the bodies are 1 to 2 wide."""


def _is_anywhere(x: Array) -> Mask:
    return np.ones(x.shape[1], dtype=bool)


def _is_on_bottom(x: Array) -> Mask:
    return np.asarray(np.abs(x[1]) < SURFACE_TOLERANCE)


def _is_on_inner_arc(x: Array) -> Mask:
    return np.asarray(np.abs(np.hypot(x[0], x[1]) - INNER_RADIUS) < SURFACE_TOLERANCE)


def _is_on_inner_sphere(x: Array) -> Mask:
    return np.asarray(np.abs(np.linalg.norm(x, axis=0) - INNER_RADIUS) < SURFACE_TOLERANCE)


def _is_on_axis(x: Array) -> Mask:
    return np.asarray(np.abs(x[0]) < SURFACE_TOLERANCE)


def _is_on_right_bottom_or_top(x: Array) -> Mask:
    """Return a mask (n,) of points (3, n) on the right, lower or upper side of the square."""
    is_on_right = np.abs(x[0] - 1) < SURFACE_TOLERANCE
    is_on_bottom_or_top = np.abs(x[1] - 0.5) > 0.5 - SURFACE_TOLERANCE
    return np.asarray(is_on_right | is_on_bottom_or_top)


@dataclass(frozen=True)
class ManufacturedProblem:
    """Static problem with a manufactured solution, solved on a series of meshes.

    Args:
        state: Plane stress, plane strain, axisymmetric or solid.
        poissons_ratio: Poisson's ratio of the material.
        field: Function (m, x, compliance) that returns the exact displacement's components.
        mesh: Function of an element's name and a cell side length that returns a mesh.
        support: Marker of the side on which displacements are prescribed and nodal forces are
            compared.
        cell_sides: Side lengths of the cells, from coarse to fine.
        elements: Names of the elements that are compared.
    """

    state: StressState
    poissons_ratio: float = 0.3
    field: DisplacementField = manufactured.plane
    mesh: Callable[[str, float], Mesh] = on_square
    support: Marker = _is_on_bottom
    cell_sides: tuple[float, ...] = (1 / 4, 1 / 8, 1 / 16, 1 / 32)
    elements: tuple[str, ...] = ("galerkin-T6", "pw-T6", "composite-T6")


TRIANGULAR_ELEMENTS = ("galerkin-T6", "pw-T6")
QUADRILATERAL_ELEMENTS = ("galerkin-Q8", "pw-Q8", "pw-Q9")
TETRAHEDRAL_ELEMENTS = ("galerkin-T10", "pw-T10")
PLANE_ELEMENTS = (*ManufacturedProblem.elements, *QUADRILATERAL_ELEMENTS)
FINER_CELL_SIDES = (1 / 8, 1 / 16, 1 / 32, 1 / 64)

PLANE_STRESS_SETTING = ManufacturedProblem(StressState.PLANE_STRESS, elements=PLANE_ELEMENTS)
PLANE_STRAIN_SETTING = ManufacturedProblem(StressState.PLANE_STRAIN, elements=PLANE_ELEMENTS)
AXISYMMETRIC_SETTING = ManufacturedProblem(
    StressState.AXISYMMETRIC, field=manufactured.round_about, elements=PLANE_ELEMENTS
)
RING_SETTING = ManufacturedProblem(StressState.PLANE_STRESS, mesh=on_ring, support=_is_on_inner_arc)
CURVED_RING_SETTING = replace(
    RING_SETTING, mesh=on_curved_ring, elements=PLANE_ELEMENTS, cell_sides=FINER_CELL_SIDES
)
CUBE_SETTING = ManufacturedProblem(
    StressState.SOLID,
    field=manufactured.solid,
    mesh=on_cube,
    cell_sides=(1 / 2, 1 / 4, 1 / 8),
    elements=TETRAHEDRAL_ELEMENTS,
)
HOLLOW_BALL_SETTING = replace(
    CUBE_SETTING, mesh=on_hollow_ball, support=_is_on_inner_sphere, cell_sides=(0.5, 0.35, 0.2)
)
TRIANGLE_PAIRS_SETTING = replace(PLANE_STRESS_SETTING, mesh=on_pairs, elements=("galerkin-T6",))
PRESSURE_SETTING = replace(PLANE_STRAIN_SETTING, field=manufactured.plane_pressure)
PLANE_STRAIN_RING_SETTING = replace(
    RING_SETTING, state=StressState.PLANE_STRAIN, elements=TRIANGULAR_ELEMENTS
)
PLANE_STRAIN_CURVED_RING_SETTING = replace(
    PLANE_STRAIN_RING_SETTING, mesh=on_curved_ring, cell_sides=FINER_CELL_SIDES
)

SETTINGS = {
    "plane-stress": PLANE_STRESS_SETTING,
    "pairs": TRIANGLE_PAIRS_SETTING,
    "plane-strain": PLANE_STRAIN_SETTING,
    "axisymmetric": AXISYMMETRIC_SETTING,
    "ring": RING_SETTING,
    "curved-ring": CURVED_RING_SETTING,
    "solid": CUBE_SETTING,
    "ball": HOLLOW_BALL_SETTING,
}
NEARLY_INCOMPRESSIBLE_SETTINGS = {
    "incompressible": PLANE_STRAIN_SETTING,
    "incompressible-pressure": PRESSURE_SETTING,
    "incompressible-axisymmetric": replace(AXISYMMETRIC_SETTING, elements=TRIANGULAR_ELEMENTS),
    "incompressible-ring": PLANE_STRAIN_RING_SETTING,
    "incompressible-curved-ring": PLANE_STRAIN_CURVED_RING_SETTING,
    "incompressible-solid": replace(CUBE_SETTING, elements=(*TETRAHEDRAL_ELEMENTS, "onecut-T10")),
}
SETTINGS |= {
    name: replace(setting, poissons_ratio=0.4999)
    for name, setting in NEARLY_INCOMPRESSIBLE_SETTINGS.items()
}

SCANNED_POISSONS_RATIOS = (0.3, 0.4, 0.45, 0.49, 0.499, 0.4999)
SCANNED_SETTINGS = {
    "plane-strain": replace(PLANE_STRAIN_SETTING, elements=TRIANGULAR_ELEMENTS),
    "pressure": replace(PRESSURE_SETTING, elements=TRIANGULAR_ELEMENTS),
    "axisymmetric": replace(AXISYMMETRIC_SETTING, elements=TRIANGULAR_ELEMENTS),
    "ring": PLANE_STRAIN_RING_SETTING,
    "curved-ring": PLANE_STRAIN_CURVED_RING_SETTING,
    "solid": CUBE_SETTING,
}
"""Settings in which Poisson's ratio is varied on the second finest mesh."""


def statics(element: str, setting: str) -> Result:
    """Compute the errors of an element on all meshes of a setting, and their orders.

    Curves have one entry per mesh: the mean cell size `h` (mean volume to the power 1/dim), the
    number of unknowns `dofs`, and the relative errors `error_*` for each of `ERROR_NORMS`. Scalars
    are the observed orders of convergence `order_*` and the errors on the finest mesh.

    Args:
        element: Name of the element.
        setting: A key of `SETTINGS`.
    """
    problem = SETTINGS[setting]
    rows = [
        solve_and_compute_relative_errors(element, problem, side) for side in problem.cell_sides
    ]
    curves = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    scalars = {
        f"order_{norm}": fit_convergence_order(curves["h"], curves[f"error_{norm}"])
        for norm in ERROR_NORMS
    }
    scalars |= {f"error_{norm}": float(curves[f"error_{norm}"][-1]) for norm in ERROR_NORMS}
    return Result(
        scalars, assign_unit_one_to_scalars(scalars), curves, dofs=int(curves["dofs"][-1])
    )


def scan(element: str, setting: str) -> Result:
    """Compute the errors of an element for several Poisson's ratios on one mesh.

    Curves are Poisson's ratio `nu` and the relative errors `error_*`; scalars are the errors at the
    last Poisson's ratio.

    Args:
        element: Name of the element.
        setting: A key of `SCANNED_SETTINGS`.
    """
    problem = SCANNED_SETTINGS[setting]
    rows = [
        solve_and_compute_relative_errors(
            element, replace(problem, poissons_ratio=nu), problem.cell_sides[-2]
        )
        for nu in SCANNED_POISSONS_RATIOS
    ]
    curves = {
        f"error_{norm}": np.array([row[f"error_{norm}"] for row in rows]) for norm in ERROR_NORMS
    }
    curves["nu"] = np.array(SCANNED_POISSONS_RATIOS)
    scalars = {f"error_{norm}": float(curves[f"error_{norm}"][-1]) for norm in ERROR_NORMS}
    return Result(scalars, assign_unit_one_to_scalars(scalars), curves, dofs=int(rows[0]["dofs"]))


def solve_and_compute_relative_errors(
    element: str, setting: ManufacturedProblem, cell_side: float
) -> dict[str, float]:
    """Solve on one mesh; return errors `error_*`, cell size `h` and number of unknowns `dofs`."""
    mesh = setting.mesh(element, cell_side)
    material = Material(YOUNGS_MODULUS, setting.poissons_ratio)
    body = Body(make_element_spaces(element, mesh), material, setting.state)
    discretisation = Discretisation(element, body, assemble_matrix(body.stiffness()))
    solution = ManufacturedSolution(body, setting.field)
    K, U = discretisation.K, discretisation.space

    exact = fem.Function(U)
    exact.x.array[:] = solution.evaluate_displacement_at_nodes(U).ravel()
    support_nodes = fem.locate_dofs_geometrical(U, setting.support)
    conditions = [fem.dirichletbc(exact, support_nodes)]
    is_loaded = _is_anywhere
    if setting.state is StressState.AXISYMMETRIC:
        conditions.append(prescribe(U, 0, _is_on_axis))
        is_loaded = _is_on_right_bottom_or_top
    f = solution.assemble_body_force_and_traction(is_loaded)
    supports = discretisation.supports(conditions)
    a = solve(K, f, supports)

    u = as_function(U, a)
    piecewise_linear = u
    if element == "composite-T6":  # its own space defines an assumed gradient
        piecewise_linear = as_function(
            fem.functionspace(mesh, piecewise_linear_sub_cell_element("triangle", (2,))), a
        )
    errors = solution.compute_relative_error_norms(u, piecewise_linear)

    # f includes the traction on the support: reactions are compared with its integrals times test
    # functions
    dofs = (support_nodes[:, None] * len(exact) + np.arange(len(exact))).ravel()
    exact_forces = solution.assemble_exact_traction(setting.support).array[dofs]
    force_error = np.linalg.norm((K * a - f).array[dofs]) / np.linalg.norm(exact_forces)
    errors["force"] = float(force_error)
    return {f"error_{norm}": error for norm, error in errors.items()} | {
        "h": mean_cell_size(mesh),
        "dofs": float(supports.right.getSize()[1]),
    }
