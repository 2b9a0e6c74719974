"""Compare CalculiX's elements with the standard ones, with exact quadrature and with CalculiX's."""

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
from study.model.units import dimensionless
from study.run.store import Result
from study.solutions.calculix.calculix import CalculixAnswer, load_unchanged_answer
from study.solutions.calculix.grids import Grid, PointMarker
from study.solutions.calculix.standard_decks import (
    SPECIMENS,
    BodyOnPlane,
    BucklingColumn,
    CompressedBody,
    RoughBlock,
    Specimen,
    VibratingBody,
)

Array = npt.NDArray[np.float64]

_CELLS = {
    "T6": ("triangle", [0, 1, 2]),
    "Q8": ("quadrilateral", [0, 1, 3, 2]),
    "T10": ("tetrahedron", [0, 1, 2, 3]),
}
"""Shape of each cell, and its corners in Basix's order."""
_STATES = {
    "CPS": StressState.PLANE_STRESS,
    "CPE": StressState.PLANE_STRAIN,
    "CAX": StressState.AXISYMMETRIC,
    "C3D": StressState.SOLID,
}
REDUCED_DEGREES = {"T6": 2, "Q8": 4, "T10": 2}
"""Degrees up to which CalculiX's quadrature is exact; it has three points on a triangle, nine on a
quadrilateral and four in a tetrahedron."""
STANDARD_ELEMENTS = {"T6": "galerkin-T6", "Q8": "galerkin-Q8", "T10": "galerkin-T10"}


class StandardModel:
    """Specimen of the CalculiX decks in the library's standard elements.

    Args:
        specimen: The body.
        degree: Degree of quadrature; None for the library's choice.
    """

    def __init__(self, specimen: Specimen, degree: int | None) -> None:
        self.grid = specimen.grid
        mesh = create_grid_mesh(specimen.grid)
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

    def create_marker(self, is_marked_point: PointMarker) -> Marker:
        """Return a marker of the model's points, given one for the grid without the bulge."""
        is_marked = np.array([is_marked_point(point) for point in self.grid.straight_nodes])
        return lambda x: is_marked[self.find_nodes(x)]

    def prescribe(
        self, is_marked_point: PointMarker, axes: range, value: float = 0.0
    ) -> list[fem.DirichletBC]:
        """Prescribe displacement components."""
        marker = self.create_marker(is_marked_point)
        return [prescribe(self.space, axis, marker, value) for axis in axes]

    def to_grid_order(self, values: Array) -> Array:
        """Reorder nodal values (n, dim) from the library's numbering to that of the grid."""
        reordered = np.empty_like(values)
        reordered[self.grid_index] = values
        return reordered

    def assemble_traction(self, is_marked_point: PointMarker, traction: list[float]) -> PETSc.Vec:
        """Return the load vector of a traction."""
        surface = boundary_measure(self.body.spaces.mesh, self.create_marker(is_marked_point))
        return assemble_vector(self.body.surface_load(traction, surface))

    def find_nodes(self, x: Array) -> npt.NDArray[np.intp]:
        """Return the indices of the grid's nodes at points, the columns of x."""
        distance, node = self._tree.query(x[: len(self.grid.lower)].T)
        assert distance.max() < 1e-9
        return node


def create_grid_mesh(grid: Grid) -> Mesh:
    """Return the mesh of a grid; its sides are curved if the grid bulges."""
    name, order = _CELLS[grid.cell]
    dimension = len(grid.lower)
    corners = np.array(grid.elements)[:, order] - 1
    used, cells = np.unique(corners, return_inverse=True)
    mesh = create_mesh(
        MPI.COMM_SELF,
        cells=cells.reshape(corners.shape).astype(np.int64),
        x=np.array(grid.straight_nodes)[used],
        e=basix.ufl.element("Lagrange", name, 1, shape=(dimension,)),
    )
    if not grid.bulge:
        return mesh
    return curved_mesh(
        mesh, lambda x: np.array([grid.bulged_point(point[:dimension]) for point in x])
    )


def _solve_compressed(problem: CompressedBody, model: StandardModel) -> dict[str, Array]:
    all_axes = range(problem.dimension)
    supports = [
        *model.prescribe(problem.is_at_bottom, all_axes),
        *model.prescribe(problem.is_at_top, range(problem.vertical_axis)),
        *model.prescribe(
            problem.is_at_top, range(problem.vertical_axis, problem.dimension), -problem.depth
        ),
    ]
    load = model.K.createVecLeft()
    load.set(0.0)
    a = solve(model.K, load, Reduction.dirichlet(model.space, supports))
    displacement, force = (
        model.to_grid_order(v.array_r.reshape(-1, problem.dimension)) for v in (a, model.K * a)
    )
    bottom = np.array(problem.grid.find_nodes(problem.is_at_bottom)) - 1
    reaction = force[bottom, 1:] if problem.is_axisymmetric else force[bottom]
    return {"displacement": displacement.ravel(), "reaction": reaction.ravel()}


def _solve_vibrating(problem: VibratingBody, model: StandardModel) -> dict[str, Array]:
    M = assemble_matrix(model.body.mass())
    supports = _clamp_bottom(problem, model)
    return {"eigenvalue": vibration_modes(model.K, M, supports, problem.count).eigenvalues}


def _solve_buckling(problem: BucklingColumn, model: StandardModel) -> dict[str, Array]:
    supports = _clamp_bottom(problem, model)
    load = model.assemble_traction(problem.is_at_top, [0.0, -1.0])
    prestress = as_function(model.space, solve(model.K, load, supports))
    K_sigma = assemble_matrix(model.body.geometric_stiffness(model.body.stress(prestress)))
    return {"critical_pressure": buckling(model.K, K_sigma, supports, problem.count).factors}


def _clamp_bottom(problem: VibratingBody | BucklingColumn, model: StandardModel) -> Reduction:
    supports = model.prescribe(problem.is_at_bottom, range(problem.dimension))
    return Reduction.dirichlet(model.space, supports)


def _solve_resting(problem: BodyOnPlane, model: StandardModel) -> dict[str, Array]:
    supports = (
        model.prescribe(problem.is_on_plane(1, 0.0), range(1, 2)) if problem.dimension == 3 else []
    )
    if not problem.friction:
        supports += model.prescribe(problem.is_on_plane(0, 0.0), range(1))
    down, along = [0.0] * problem.dimension, [0.0] * problem.dimension
    down[problem.vertical_axis], along[0] = -problem.pressure, problem.pull * problem.pressure
    loads = [model.assemble_traction(problem.is_pressed, down)]
    if problem.pull:
        pull = model.assemble_traction(problem.is_on_plane(0, problem.grid.upper[0]), along)
        steps = problem.increments
        loads += [loads[0] + pull * (k / steps) for k in range(1, steps + 1)]
    _, force = _solve_on_plane(problem, model, loads, supports, problem.friction)
    contact_force = force[np.array(problem.contact_nodes) - 1]
    numbers = {"force_normal": contact_force[:, problem.vertical_axis]}
    if problem.friction:
        numbers["force_tangential"] = contact_force[:, : problem.vertical_axis].ravel()
    return numbers


def _solve_rough_block(problem: RoughBlock, model: StandardModel) -> dict[str, Array]:
    """Solve with contact at nodes; CalculiX has contact at integration points of faces instead."""
    load = model.assemble_traction(problem.is_at_top, [0.0, 0.0, -problem.pressure])
    push = model.assemble_traction(
        problem.is_on_plane(0, problem.grid.lower[0]), [*problem.push, 0.0]
    )
    displacement, force = _solve_on_plane(problem, model, [load + push], [], problem.friction)
    return {"displacement": displacement.ravel(), "force": force.sum(axis=0)}


def _solve_on_plane(
    problem: Specimen,
    model: StandardModel,
    loads: list[PETSc.Vec],
    supports: list[fem.DirichletBC],
    friction: float,
) -> tuple[Array, Array]:
    """Return displacements and contact forces (n, dim) on a rigid plane, after all loads."""
    up = [0.0] * problem.dimension
    up[problem.vertical_axis] = 1.0
    foundation = ContactPair(
        model.create_marker(problem.is_at_bottom), Plane(problem.grid.lower, tuple(up)), friction
    )
    reduction = Reduction.dirichlet(model.space, supports)
    state = solve_contact(model.K, loads, reduction, [foundation], model.space)[-1]
    (pair,) = state.pairs
    force = np.zeros((len(problem.grid.nodes), problem.dimension))
    force[model.find_nodes(pair.position.T)] = pair.force_vector
    displacement = state.displacement.array_r.reshape(force.shape)
    return model.to_grid_order(displacement), force


_SOLVERS: dict[type, Callable[..., dict[str, Array]]] = {
    CompressedBody: _solve_compressed,
    VibratingBody: _solve_vibrating,
    BucklingColumn: _solve_buckling,
    BodyOnPlane: _solve_resting,
    RoughBlock: _solve_rough_block,
}


def against_standard(case: str, tracked: str) -> Result:
    """Compare CalculiX with the standard element: return the largest differences by quantity.

    `exact` uses the library's quadrature, `reduced` that of CalculiX. Displacements and reactions
    are relative to their largest entry, eigenvalues and buckling pressures to each value, contact
    forces to the mean normal force.

    Args:
        case: Name of a specimen.
        tracked: Digest of the recorded answer.
    """
    problem, peer = SPECIMENS[case], load_unchanged_answer(case, tracked)
    scalars: dict[str, float] = {}
    curves: dict[str, Array] = {}
    dofs = 0
    for rule, degree in (("exact", None), ("reduced", REDUCED_DEGREES[problem.grid.cell])):
        model = StandardModel(problem, degree)
        dofs = model.K.getSize()[0]
        for name, ours in _SOLVERS[type(problem)](problem, model).items():
            peers = peer.numbers[name]
            scalars[f"{rule}_{name}"] = float(
                (np.abs(peers - ours) / _difference_scale(name, peer)).max()
            )
            curves |= {f"{rule}_{name}": ours, f"peer_{name}": peers}
    return Result(scalars, dimensionless(scalars), curves, dofs=dofs)


def _difference_scale(name: str, peer: CalculixAnswer) -> Array:
    """Return the scale by which differences are divided."""
    values = peer.numbers[name]
    if name in ("eigenvalue", "critical_pressure"):
        return np.abs(values)
    if name.startswith("force_"):
        return np.array(peer.numbers["force_normal"].mean())
    return np.array(np.abs(values).max())


def implied_parameters(problem: Specimen) -> dict[str, object]:
    """Return the parameters that a specimen's name implies."""
    fields = asdict(problem)
    grid = fields.pop("grid")
    return {
        "compared": [STANDARD_ELEMENTS[problem.grid.cell]],
        "peer_element": fields.pop("element"),
        **grid,
        **fields,
    }
