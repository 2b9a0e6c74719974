"""Compare CalculiX's elements with the library's standard ones, for two quadrature rules."""

from collections.abc import Callable
from dataclasses import asdict

from mpi4py import MPI
from petsc4py import PETSc

import basix.ufl
import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.mesh import Mesh, create_mesh
from scipy.spatial import cKDTree

from pw_elements import (
    Body,
    Material,
    Reduction,
    Spaces,
    as_function,
    assemble_matrix,
    assemble_vector,
    boundary_measure,
    buckling,
    prescribe,
    solve,
    vibration_modes,
)
from pw_elements.contact import ContactPair, Plane, solve_contact
from pw_elements.elasticity import StressState
from pw_elements.meshes import curved_mesh
from pw_elements.spaces import Marker
from study.model.elements import serendipity_spaces
from study.model.units import assign_unit_one_to_scalars
from study.run.store import Result
from study.solutions.calculix.calculix import CalculixResult, load_recorded_result_if_unchanged
from study.solutions.calculix.grids import Grid, PointMarker
from study.solutions.calculix.standard_decks import (
    SPECIMENS,
    BlockOnRoughRigidPlane,
    BodyPressedOnRigidPlane,
    BucklingColumn,
    CompressedBody,
    Specimen,
    VibratingBody,
)

Array = npt.NDArray[np.float64]

_CELLS = {
    "T6": ("triangle", [0, 1, 2]),
    "Q8": ("quadrilateral", [0, 1, 3, 2]),
    "T10": ("tetrahedron", [0, 1, 2, 3]),
}
"""Shape of each cell, and the indices of its CalculiX corners in the order of Basix."""
_STATES = {
    "CPS": StressState.PLANE_STRESS,
    "CPE": StressState.PLANE_STRAIN,
    "CAX": StressState.AXISYMMETRIC,
    "C3D": StressState.SOLID,
}
REDUCED_DEGREES = {"T6": 2, "Q8": 4, "T10": 2}
"""Polynomial degrees up to which CalculiX's quadrature is exact, by cell.

CalculiX uses three points on a triangle, nine on a quadrilateral and four in a tetrahedron."""
STANDARD_ELEMENTS = {"T6": "galerkin-T6", "Q8": "galerkin-Q8", "T10": "galerkin-T10"}


class StandardElementModel:
    """Finite-element model of a CalculiX specimen with the library's standard elements.

    Args:
        specimen: Body with its mesh and material.
        degree: Quadrature degree of the stiffness; None for the library's default.
    """

    def __init__(self, specimen: Specimen, degree: int | None) -> None:
        self.grid = specimen.grid
        mesh = create_mesh_of_calculix_grid(specimen.grid)
        quadrilaterals = specimen.grid.cell == "Q8"
        spaces = serendipity_spaces(mesh) if quadrilaterals else Spaces.galerkin(mesh)
        material = Material(specimen.modulus, specimen.ratio, specimen.density)
        state = _STATES[specimen.element[:3]]
        self.body = Body(spaces, material, state, quadrature_degree=degree)
        self.space = spaces.trial
        self.K = assemble_matrix(self.body.stiffness())
        self._tree = cKDTree(np.array(specimen.grid.nodes))
        # Index in the grid of each node of the library
        self.grid_index = self.find_nodes(self.space.tabulate_dof_coordinates().T)

    def create_marker_on_bulged_mesh(self, is_marked_point: PointMarker) -> Marker:
        """Convert a marker of the grid without bulge to a marker of points of the bulged mesh."""
        is_marked = np.array([is_marked_point(point) for point in self.grid.nodes_without_bulge])
        return lambda x: is_marked[self.find_nodes(x)]

    def prescribe_components_at_marked_nodes(
        self, is_marked_point: PointMarker, axes: range, value: float = 0.0
    ) -> list[fem.DirichletBC]:
        """Prescribe a value of displacement components at marked nodes, one condition per axis."""
        marker = self.create_marker_on_bulged_mesh(is_marked_point)
        return [prescribe(self.space, axis, marker, value) for axis in axes]

    def reorder_to_grid_numbering(self, values: Array) -> Array:
        """Reorder nodal values (n, dim) from the library's numbering to that of the grid."""
        reordered = np.empty_like(values)
        reordered[self.grid_index] = values
        return reordered

    def assemble_traction_on_marked_facets(
        self, is_marked_point: PointMarker, traction: list[float]
    ) -> PETSc.Vec:
        """Assemble the load vector of a uniform traction on the marked part of the boundary."""
        surface = boundary_measure(
            self.body.spaces.mesh, self.create_marker_on_bulged_mesh(is_marked_point)
        )
        return assemble_vector(self.body.surface_load(traction, surface))

    def find_nodes(self, x: Array) -> npt.NDArray[np.intp]:
        """Return the indices (n,) of the grid nodes at points x (3, n)."""
        distance, node = self._tree.query(x[: len(self.grid.lower)].T)
        assert distance.max() < 1e-9
        return node


def create_mesh_of_calculix_grid(grid: Grid) -> Mesh:
    """Create the DOLFINx mesh of a CalculiX grid, with curved sides if the grid has a bulge."""
    name, order = _CELLS[grid.cell]
    dimension = len(grid.lower)
    corners = np.array(grid.elements)[:, order] - 1
    used, cells = np.unique(corners, return_inverse=True)
    mesh = create_mesh(
        MPI.COMM_SELF,
        cells=cells.reshape(corners.shape).astype(np.int64),
        x=np.array(grid.nodes_without_bulge)[used],
        e=basix.ufl.element("Lagrange", name, 1, shape=(dimension,)),
    )
    if not grid.bulge:
        return mesh
    return curved_mesh(
        mesh, lambda x: np.array([grid.move_point_by_bulge(point[:dimension]) for point in x])
    )


def _solve_compressed_body(
    problem: CompressedBody, model: StandardElementModel
) -> dict[str, Array]:
    all_axes = range(problem.dimension)
    supports = [
        *model.prescribe_components_at_marked_nodes(problem.marker_of_bottom, all_axes),
        *model.prescribe_components_at_marked_nodes(
            problem.marker_of_top, range(problem.vertical_axis)
        ),
        *model.prescribe_components_at_marked_nodes(
            problem.marker_of_top, range(problem.vertical_axis, problem.dimension), -problem.depth
        ),
    ]
    load = model.K.createVecLeft()
    load.set(0.0)
    a = solve(model.K, load, Reduction.dirichlet(model.space, supports))
    displacement, force = (
        model.reorder_to_grid_numbering(v.array_r.reshape(-1, problem.dimension))
        for v in (a, model.K * a)
    )
    bottom = np.array(problem.grid.find_nodes(problem.marker_of_bottom)) - 1
    reaction = force[bottom, 1:] if problem.is_axisymmetric else force[bottom]
    return {"displacement": displacement.ravel(), "reaction": reaction.ravel()}


def _solve_vibrating_body(problem: VibratingBody, model: StandardElementModel) -> dict[str, Array]:
    M = assemble_matrix(model.body.mass())
    supports = _make_clamped_bottom_reduction(problem, model)
    return {"eigenvalue": vibration_modes(model.K, M, supports, problem.count).eigenvalues}


def _solve_buckling_column(
    problem: BucklingColumn, model: StandardElementModel
) -> dict[str, Array]:
    supports = _make_clamped_bottom_reduction(problem, model)
    load = model.assemble_traction_on_marked_facets(problem.marker_of_top, [0.0, -1.0])
    prestress = as_function(model.space, solve(model.K, load, supports))
    K_sigma = assemble_matrix(model.body.geometric_stiffness(model.body.stress(prestress)))
    return {"critical_pressure": buckling(model.K, K_sigma, supports, problem.count).factors}


def _make_clamped_bottom_reduction(
    problem: VibratingBody | BucklingColumn, model: StandardElementModel
) -> Reduction:
    supports = model.prescribe_components_at_marked_nodes(
        problem.marker_of_bottom, range(problem.dimension)
    )
    return Reduction.dirichlet(model.space, supports)


def _solve_body_on_plane(
    problem: BodyPressedOnRigidPlane, model: StandardElementModel
) -> dict[str, Array]:
    supports = (
        model.prescribe_components_at_marked_nodes(
            problem.create_marker_of_plane(1, 0.0), range(1, 2)
        )
        if problem.dimension == 3
        else []
    )
    if not problem.friction:
        supports += model.prescribe_components_at_marked_nodes(
            problem.create_marker_of_plane(0, 0.0), range(1)
        )
    down, along = [0.0] * problem.dimension, [0.0] * problem.dimension
    down[problem.vertical_axis], along[0] = -problem.pressure, problem.pull * problem.pressure
    loads = [model.assemble_traction_on_marked_facets(problem.is_on_pressed_part_of_top, down)]
    if problem.pull:
        pull = model.assemble_traction_on_marked_facets(
            problem.create_marker_of_plane(0, problem.grid.upper[0]), along
        )
        steps = problem.increments
        loads += [loads[0] + pull * (k / steps) for k in range(1, steps + 1)]
    _, force = _solve_contact_with_rigid_plane(problem, model, loads, supports, problem.friction)
    contact_force = force[np.array(problem.contact_nodes) - 1]
    numbers = {"force_normal": contact_force[:, problem.vertical_axis]}
    if problem.friction:
        numbers["force_tangential"] = contact_force[:, : problem.vertical_axis].ravel()
    return numbers


def _solve_block_on_rough_plane(
    problem: BlockOnRoughRigidPlane, model: StandardElementModel
) -> dict[str, Array]:
    """Solve with contact at nodes, whereas CalculiX enforces contact at points within faces."""
    load = model.assemble_traction_on_marked_facets(
        problem.marker_of_top, [0.0, 0.0, -problem.pressure]
    )
    push = model.assemble_traction_on_marked_facets(
        problem.create_marker_of_plane(0, problem.grid.lower[0]), [*problem.push, 0.0]
    )
    displacement, force = _solve_contact_with_rigid_plane(
        problem, model, [load + push], [], problem.friction
    )
    return {"displacement": displacement.ravel(), "force": force.sum(axis=0)}


def _solve_contact_with_rigid_plane(
    problem: Specimen,
    model: StandardElementModel,
    loads: list[PETSc.Vec],
    supports: list[fem.DirichletBC],
    friction: float,
) -> tuple[Array, Array]:
    """Solve contact with a rigid plane below the body for a sequence of loads.

    Returns:
        Displacements and contact forces (n, dim) after the last load, in the order of the grid.
    """
    up = [0.0] * problem.dimension
    up[problem.vertical_axis] = 1.0
    foundation = ContactPair(
        model.create_marker_on_bulged_mesh(problem.marker_of_bottom),
        Plane(problem.grid.lower, tuple(up)),
        friction,
    )
    reduction = Reduction.dirichlet(model.space, supports)
    state = solve_contact(model.K, loads, reduction, [foundation], model.space)[-1]
    (pair,) = state.pairs
    force = np.zeros((len(problem.grid.nodes), problem.dimension))
    force[model.find_nodes(pair.position.T)] = pair.force_vector
    displacement = state.displacement.array_r.reshape(force.shape)
    return model.reorder_to_grid_numbering(displacement), force


_SOLVERS: dict[type, Callable[..., dict[str, Array]]] = {
    CompressedBody: _solve_compressed_body,
    VibratingBody: _solve_vibrating_body,
    BucklingColumn: _solve_buckling_column,
    BodyPressedOnRigidPlane: _solve_body_on_plane,
    BlockOnRoughRigidPlane: _solve_block_on_rough_plane,
}


def against_standard(case: str, tracked: str) -> Result:
    """Compare CalculiX with the library's standard element on one specimen.

    Scalars are the largest relative differences of each quantity, with the prefix `exact_` for the
    library's quadrature and `reduced_` for the quadrature of CalculiX. Differences of displacements
    and reactions are relative to the largest entry, those of eigenvalues and buckling pressures to
    each value, and those of contact forces to the mean normal force.

    Args:
        case: Name of the specimen in `SPECIMENS`.
        tracked: Digest of the recorded CalculiX result, which must not have changed.
    """
    problem, peer = SPECIMENS[case], load_recorded_result_if_unchanged(case, tracked)
    scalars: dict[str, float] = {}
    curves: dict[str, Array] = {}
    dofs = 0
    for rule, degree in (("exact", None), ("reduced", REDUCED_DEGREES[problem.grid.cell])):
        model = StandardElementModel(problem, degree)
        dofs = model.K.getSize()[0]
        for name, ours in _SOLVERS[type(problem)](problem, model).items():
            peers = peer.numbers[name]
            scalars[f"{rule}_{name}"] = float(
                (np.abs(peers - ours) / _scale_of_relative_difference(name, peer)).max()
            )
            curves |= {f"{rule}_{name}": ours, f"peer_{name}": peers}
    return Result(scalars, assign_unit_one_to_scalars(scalars), curves, dofs=dofs)


def _scale_of_relative_difference(quantity: str, peer: CalculixResult) -> Array:
    """Return the value or values by which differences of a quantity are divided.

    Args:
        quantity: Name of the quantity.
        peer: CalculiX' result.
    """
    values = peer.numbers[quantity]
    if quantity in ("eigenvalue", "critical_pressure"):
        return np.abs(values)
    if quantity.startswith("force_"):
        return np.array(peer.numbers["force_normal"].mean())
    return np.array(np.abs(values).max())


def parameters_implied_by_specimen(problem: Specimen) -> dict[str, object]:
    """Return the parameters of a specimen (element, mesh, constants) to store with the results."""
    fields = asdict(problem)
    grid = fields.pop("grid")
    return {
        "compared": [STANDARD_ELEMENTS[problem.grid.cell]],
        "peer_element": fields.pop("element"),
        **grid,
        **fields,
    }
