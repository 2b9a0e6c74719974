"""CalculiX's elements against the standard ones: exact quadrature, and CalculiX's own rule."""

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
from study.model.elements import serendipity
from study.model.units import dimensionless
from study.run.store import Result
from study.solutions.calculix.calculix import Peer, peer_of
from study.solutions.calculix.grids import Grid, Where
from study.solutions.calculix.standard_decks import (
    SPECIMENS,
    Buckling,
    Compressed,
    Resting,
    RoughBlock,
    Specimen,
    Vibrating,
)

Array = npt.NDArray[np.float64]

_CELLS = {
    "T6": ("triangle", [0, 1, 2]),
    "Q8": ("quadrilateral", [0, 1, 3, 2]),
    "T10": ("tetrahedron", [0, 1, 2, 3]),
}
"""Names of cells, and their corners in Basix's order."""
_STATES = {
    "CPS": StressState.PLANE_STRESS,
    "CPE": StressState.PLANE_STRAIN,
    "CAX": StressState.AXISYMMETRIC,
    "C3D": StressState.SOLID,
}
REDUCED_DEGREES = {"T6": 2, "Q8": 4, "T10": 2}
"""Degrees that CalculiX's points integrate exactly: three on a triangle, four on a tetrahedron,
nine on a quadrilateral."""
STANDARD_ELEMENTS = {"T6": "galerkin-T6", "Q8": "galerkin-Q8", "T10": "galerkin-T10"}


class Model:
    """A specimen of CalculiX's in the library's standard elements.

    Args:
        specimen: the body.
        degree: of quadrature; None for the library's own choice.
    """

    def __init__(self, specimen: Specimen, degree: int | None) -> None:
        self.grid = specimen.grid
        mesh = grid_mesh(specimen.grid)
        quadrilaterals = specimen.grid.cell == "Q8"
        spaces = serendipity(mesh) if quadrilaterals else Spaces.galerkin(mesh)
        material = Material(specimen.modulus, specimen.ratio, specimen.density)
        state = _STATES[specimen.element[:3]]
        self.body = Body(spaces, material, state, quadrature_degree=degree)
        self.space = spaces.trial
        self.K = assemble_matrix(self.body.stiffness())
        self._tree = cKDTree(np.array(specimen.grid.nodes))
        # numbers of the grid's nodes, less one, in the library's numbering
        self.order = self.find_nodes(self.space.tabulate_dof_coordinates().T)

    def marker(self, where: Where) -> Marker:
        """Return a marker of points, from one of points in the grid without bulge."""
        is_marked = np.array([where(point) for point in self.grid.places])
        return lambda x: is_marked[self.find_nodes(x)]

    def prescribe(self, where: Where, axes: range, value: float = 0.0) -> list[fem.DirichletBC]:
        """Prescribe displacement components."""
        marker = self.marker(where)
        return [prescribe(self.space, axis, marker, value) for axis in axes]

    def in_grid_order(self, values: Array) -> Array:
        """Return nodal values (n, dim) of the library's numbering in the grid's."""
        reordered = np.empty_like(values)
        reordered[self.order] = values
        return reordered

    def traction(self, where: Where, traction: list[float]) -> PETSc.Vec:
        """Return the load vector of a traction."""
        surface = boundary_measure(self.body.spaces.mesh, self.marker(where))
        return assemble_vector(self.body.surface_load(traction, surface))

    def find_nodes(self, x: Array) -> npt.NDArray[np.intp]:
        """Return the numbers, less one, of the grid's nodes at points, columns of x."""
        distance, node = self._tree.query(x[: len(self.grid.lower)].T)
        assert distance.max() < 1e-9
        return node


def grid_mesh(grid: Grid) -> Mesh:
    """Return the mesh of a grid, with straight sides, or curved ones where it bulges."""
    name, order = _CELLS[grid.cell]
    dimension = len(grid.lower)
    corners = np.array(grid.elements)[:, order] - 1
    used, cells = np.unique(corners, return_inverse=True)
    mesh = create_mesh(
        MPI.COMM_SELF,
        cells=cells.reshape(corners.shape).astype(np.int64),
        x=np.array(grid.places)[used],
        e=basix.ufl.element("Lagrange", name, 1, shape=(dimension,)),
    )
    if not grid.bulge:
        return mesh
    return curved_mesh(mesh, lambda x: np.array([grid.bulged(point[:dimension]) for point in x]))


def _compress(problem: Compressed, model: Model) -> dict[str, Array]:
    all_axes = range(problem.dimension)
    supports = [
        *model.prescribe(problem.bottom, all_axes),
        *model.prescribe(problem.top, range(problem.up)),
        *model.prescribe(problem.top, range(problem.up, problem.dimension), -problem.depth),
    ]
    load = model.K.createVecLeft()
    load.set(0.0)
    a = solve(model.K, load, Reduction.dirichlet(model.space, supports))
    displacement, force = (
        model.in_grid_order(v.array_r.reshape(-1, problem.dimension)) for v in (a, model.K * a)
    )
    bottom = np.array(problem.grid.nodes_where(problem.bottom)) - 1
    reaction = force[bottom, 1:] if problem.is_axisymmetric else force[bottom]
    return {"displacement": displacement.ravel(), "reaction": reaction.ravel()}


def _vibrate(problem: Vibrating, model: Model) -> dict[str, Array]:
    M = assemble_matrix(model.body.mass())
    supports = _clamp_bottom(problem, model)
    return {"eigenvalue": vibration_modes(model.K, M, supports, problem.count).eigenvalues}


def _buckle(problem: Buckling, model: Model) -> dict[str, Array]:
    supports = _clamp_bottom(problem, model)
    load = model.traction(problem.top, [0.0, -1.0])
    prestress = as_function(model.space, solve(model.K, load, supports))
    K_sigma = assemble_matrix(model.body.geometric_stiffness(model.body.stress(prestress)))
    return {"critical_pressure": buckling(model.K, K_sigma, supports, problem.count).factors}


def _clamp_bottom(problem: Vibrating | Buckling, model: Model) -> Reduction:
    supports = model.prescribe(problem.bottom, range(problem.dimension))
    return Reduction.dirichlet(model.space, supports)


def _rest_on_plane(problem: Resting, model: Model) -> dict[str, Array]:
    supports = model.prescribe(problem.on(1, 0.0), range(1, 2)) if problem.dimension == 3 else []
    if not problem.friction:
        supports += model.prescribe(problem.on(0, 0.0), range(1))
    down, along = [0.0] * problem.dimension, [0.0] * problem.dimension
    down[problem.up], along[0] = -problem.pressure, problem.pull * problem.pressure
    loads = [model.traction(problem.is_pressed, down)]
    if problem.pull:
        pull = model.traction(problem.on(0, problem.grid.upper[0]), along)
        steps = problem.increments
        loads += [loads[0] + pull * (k / steps) for k in range(1, steps + 1)]
    _, force = _solve_on_plane(problem, model, loads, supports, problem.friction)
    contact_force = force[np.array(problem.contact_nodes) - 1]
    numbers = {"force_normal": contact_force[:, problem.up]}
    if problem.friction:
        numbers["force_tangential"] = contact_force[:, : problem.up].ravel()
    return numbers


def _push_rough_block(problem: RoughBlock, model: Model) -> dict[str, Array]:
    """Solve by contact at nodes, where CalculiX has contact at integration points of faces."""
    load = model.traction(problem.top, [0.0, 0.0, -problem.pressure])
    push = model.traction(problem.on(0, problem.grid.lower[0]), [*problem.push, 0.0])
    displacement, force = _solve_on_plane(problem, model, [load + push], [], problem.friction)
    return {"displacement": displacement.ravel(), "force": force.sum(axis=0)}


def _solve_on_plane(
    problem: Specimen,
    model: Model,
    loads: list[PETSc.Vec],
    supports: list[fem.DirichletBC],
    friction: float,
) -> tuple[Array, Array]:
    """Return displacements and contact forces (n, dim) on a rigid plane, after all loads."""
    up = [0.0] * problem.dimension
    up[problem.up] = 1.0
    foundation = ContactPair(
        model.marker(problem.bottom), Plane(problem.grid.lower, tuple(up)), friction
    )
    reduction = Reduction.dirichlet(model.space, supports)
    state = solve_contact(model.K, loads, reduction, [foundation], model.space)[-1]
    (pair,) = state.pairs
    force = np.zeros((len(problem.grid.nodes), problem.dimension))
    force[model.find_nodes(pair.position.T)] = pair.force_vector
    displacement = state.displacement.array_r.reshape(force.shape)
    return model.in_grid_order(displacement), force


_SOLVERS: dict[type, Callable[..., dict[str, Array]]] = {
    Compressed: _compress,
    Vibrating: _vibrate,
    Buckling: _buckle,
    Resting: _rest_on_plane,
    RoughBlock: _push_rough_block,
}


def against_standard(case: str, tracked: str) -> Result:
    """Return the largest differences of CalculiX from the standard element, by kind of number.

    `exact` has the library's own quadrature, `reduced` CalculiX's. Displacements and reactions
    are over their largest entry, eigenvalues and buckling pressures each over itself, contact
    forces over the mean normal one.

    Args:
        case: name of a specimen.
        tracked: digest of the tracked answer.
    """
    problem, peer = SPECIMENS[case], peer_of(case, tracked)
    scalars: dict[str, float] = {}
    curves: dict[str, Array] = {}
    dofs = 0
    for rule, degree in (("exact", None), ("reduced", REDUCED_DEGREES[problem.grid.cell])):
        model = Model(problem, degree)
        dofs = model.K.getSize()[0]
        for name, ours in _SOLVERS[type(problem)](problem, model).items():
            peers = peer.numbers[name]
            scalars[f"{rule}_{name}"] = float((np.abs(peers - ours) / _scale(name, peer)).max())
            curves |= {f"{rule}_{name}": ours, f"peer_{name}": peers}
    return Result(scalars, dimensionless(scalars), curves, dofs=dofs)


def _scale(name: str, peer: Peer) -> Array:
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
