"""CalculiX's elements and the standard ones: exact quadrature, and CalculiX's own rule."""

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
from study.run.cases import Case
from study.run.store import Result
from study.solutions.calculix.calculix import Peer, peer_of, tracked_digest
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

# Names of cells, and their corners in Basix's order
_CELLS = {
    "T6": ("triangle", [0, 1, 2]),
    "Q8": ("quadrilateral", [0, 1, 3, 2]),
    "T10": ("tetrahedron", [0, 1, 2, 3]),
}
_STATES = {
    "CPS": StressState.PLANE_STRESS,
    "CPE": StressState.PLANE_STRAIN,
    "CAX": StressState.AXISYMMETRIC,
    "C3D": StressState.SOLID,
}
# Degrees that CalculiX's points integrate exactly: three on a triangle, four on a tetrahedron,
# nine on a quadrilateral
REDUCED = {"T6": 2, "Q8": 4, "T10": 2}
STANDARD = {"T6": "galerkin-T6", "Q8": "galerkin-Q8", "T10": "galerkin-T10"}


class Model:
    """Our side of a specimen.

    Args:
        specimen: the body.
        degree: of quadrature, the library's own choice unless given.
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
        # numbers of the grid's nodes, less one, in our numbering
        self.order = self.nearest(self.space.tabulate_dof_coordinates().T)

    def marker(self, where: Where) -> Marker:
        """A marker of points, given one of places in the grid without bulge."""
        holds = np.array([where(place) for place in self.grid.places])
        return lambda x: holds[self.nearest(x)]

    def held(self, where: Where, axes: range, value: float = 0.0) -> list[fem.DirichletBC]:
        """Prescribed displacements."""
        marker = self.marker(where)
        return [prescribe(self.space, axis, marker, value) for axis in axes]

    def in_grid_order(self, values: Array) -> Array:
        """Nodal values (n, dim) of our numbering in the grid's."""
        sorted_ = np.empty_like(values)
        sorted_[self.order] = values
        return sorted_

    def traction(self, where: Where, traction: list[float]) -> PETSc.Vec:
        """Load vector of a traction."""
        surface = boundary_measure(self.body.spaces.mesh, self.marker(where))
        return assemble_vector(self.body.surface_load(traction, surface))

    def nearest(self, x: Array) -> npt.NDArray[np.intp]:
        """Numbers, less one, of the grid's nodes at points given as columns."""
        distance, node = self._tree.query(x[: len(self.grid.lower)].T)
        assert distance.max() < 1e-9
        return node


def grid_mesh(grid: Grid) -> Mesh:
    """The grid with straight sides, or curved ones where it bulges."""
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
    return curved_mesh(mesh, lambda x: np.array([grid.bulged(place[:dimension]) for place in x]))


def _compressed(problem: Compressed, model: Model) -> dict[str, Array]:
    every = range(problem.dimension)
    supports = [
        *model.held(problem.bottom, every),
        *model.held(problem.top, range(problem.up)),
        *model.held(problem.top, range(problem.up, problem.dimension), -problem.depth),
    ]
    load = model.K.createVecLeft()
    load.set(0.0)
    a = solve(model.K, load, Reduction.dirichlet(model.space, supports))
    rows = (-1, problem.dimension)
    moved, force = (model.in_grid_order(v.array_r.reshape(rows)) for v in (a, model.K * a))
    bottom = np.array(problem.grid.nodes_where(problem.bottom)) - 1
    reaction = force[bottom, 1:] if problem.is_axisymmetric else force[bottom]
    return {"displacement": moved.ravel(), "reaction": reaction.ravel()}


def _vibrating(problem: Vibrating, model: Model) -> dict[str, Array]:
    M = assemble_matrix(model.body.mass())
    held = Reduction.dirichlet(model.space, model.held(problem.bottom, range(problem.dimension)))
    return {"eigenvalue": vibration_modes(model.K, M, held, problem.count).eigenvalues}


def _buckling(problem: Buckling, model: Model) -> dict[str, Array]:
    held = Reduction.dirichlet(model.space, model.held(problem.bottom, range(problem.dimension)))
    load = model.traction(problem.top, [0.0, -1.0])
    prestress = as_function(model.space, solve(model.K, load, held))
    K_sigma = assemble_matrix(model.body.initial_stress(model.body.stress(prestress)))
    return {"critical_pressure": buckling(model.K, K_sigma, held, problem.count).factors}


def _resting(problem: Resting, model: Model) -> dict[str, Array]:
    supports = model.held(problem.on(1, 0.0), range(1, 2)) if problem.dimension == 3 else []
    if not problem.friction:
        supports += model.held(problem.on(0, 0.0), range(1))
    down, along = [0.0] * problem.dimension, [0.0] * problem.dimension
    down[problem.up], along[0] = -problem.pressure, problem.pull * problem.pressure
    loads = [model.traction(problem.is_pressed, down)]
    if problem.pull:
        pull = model.traction(problem.on(0, problem.grid.upper[0]), along)
        steps = problem.increments
        loads += [loads[0] + pull * (k / steps) for k in range(1, steps + 1)]
    _, force = _supported(problem, model, loads, supports, problem.friction)
    rest = force[np.array(problem.contact_nodes) - 1]
    numbers = {"force_normal": rest[:, problem.up]}
    if problem.friction:
        numbers["force_tangential"] = rest[:, : problem.up].ravel()
    return numbers


def _rough(problem: RoughBlock, model: Model) -> dict[str, Array]:
    """By nodal contact: another statement of the same problem."""
    load = model.traction(problem.top, [0.0, 0.0, -problem.pressure])
    push = model.traction(problem.on(0, problem.grid.lower[0]), [*problem.push, 0.0])
    displacement, force = _supported(problem, model, [load + push], [], problem.friction)
    return {"displacement": displacement.ravel(), "force": force.sum(axis=0)}


def _supported(
    problem: Specimen,
    model: Model,
    loads: list[PETSc.Vec],
    supports: list[fem.DirichletBC],
    friction: float,
) -> tuple[Array, Array]:
    """Last displacements and contact forces (n, dim) on a rigid plane under the bottom."""
    up = [0.0] * problem.dimension
    up[problem.up] = 1.0
    foundation = ContactPair(
        model.marker(problem.bottom), Plane(problem.grid.lower, tuple(up)), friction
    )
    held = Reduction.dirichlet(model.space, supports)
    state = solve_contact(model.K, loads, held, [foundation], model.space)[-1]
    (pair,) = state.pairs
    force = np.zeros((len(problem.grid.nodes), problem.dimension))
    force[model.nearest(pair.position.T)] = pair.force_vector
    moved = state.displacement.array_r.reshape(force.shape)
    return model.in_grid_order(moved), force


_SOLVED: dict[type, Callable[..., dict[str, Array]]] = {
    Compressed: _compressed,
    Vibrating: _vibrating,
    Buckling: _buckling,
    Resting: _resting,
    RoughBlock: _rough,
}


def against_standard(case: str, tracked: str) -> Result:
    """Largest differences of CalculiX from the standard element, by each kind of number.

    `exact` has the library's own quadrature, `reduced` CalculiX's. Displacements and reactions
    are over their largest entry, eigenvalues and buckling pressures each over itself, contact
    forces over the mean normal one.
    """
    problem, peer = SPECIMENS[case], peer_of(case, tracked)
    scalars: dict[str, float] = {}
    curves: dict[str, Array] = {}
    dofs = 0
    for rule, degree in (("exact", None), ("reduced", REDUCED[problem.grid.cell])):
        model = Model(problem, degree)
        dofs = model.K.getSize()[0]
        for name, ours in _SOLVED[type(problem)](problem, model).items():
            theirs = peer.numbers[name]
            scalars[f"{rule}_{name}"] = float((np.abs(theirs - ours) / _scale(name, peer)).max())
            curves |= {f"{rule}_{name}": ours, f"peer_{name}": theirs}
    return Result(scalars, dimensionless(scalars), curves, dofs=dofs)


def _scale(name: str, peer: Peer) -> Array:
    """What differences are divided by."""
    values = peer.numbers[name]
    if name in ("eigenvalue", "critical_pressure"):
        return np.abs(values)
    if name.startswith("force_"):
        return np.array(peer.numbers["force_normal"].mean())
    return np.array(np.abs(values).max())


def _stated(problem: Specimen) -> dict[str, object]:
    """What a problem's name implies."""
    fields = asdict(problem)
    grid = fields.pop("grid")
    return {
        "compared": [STANDARD[problem.grid.cell]],
        "peer_element": fields.pop("element"),
        **grid,
        **fields,
    }


CASES = [
    Case(
        "P",
        name,
        against_standard,
        {"case": name, "tracked": tracked_digest(name)},
        _stated(problem),
    )
    for name, problem in SPECIMENS.items()
]
