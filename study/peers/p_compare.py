"""The same problems here and in CalculiX, node by node."""

from dataclasses import asdict, dataclass

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.mesh import Mesh

from pw_elements import Material, Spaces, force_transfer, forces_along, prescribe
from pw_elements.contact import ContactPair, Plane, solve_contact
from pw_elements.elasticity import StressState
from pw_elements.meshes import triangles
from study.model.discretisation import Discretisation, discretise
from study.model.units import dimensionless, units_of
from study.paper import s7_1_two_triangles, s7_6_buckling
from study.peers import p_standard
from study.run.cases import Case
from study.run.store import Result
from study.solutions.calculix.calculix import peer_of, tracked_digest
from study.solutions.calculix.decks import (
    Block,
    HalfBeam,
    NativePressure,
    TrianglePairs,
    TwoTriangles,
)
from study.solutions.calculix.problems import PROBLEMS

SECTION = "P"
TITLE = "An independent code: CalculiX"

Array = npt.NDArray[np.float64]

GALERKIN, PW = "galerkin-T6", "pw-T6"
# Nodes nearer than two elements to an end, or to a change of contact status, are at an edge
EDGE = 4


@dataclass(frozen=True)
class Line:
    """Forces along the lower side by one element.

    Args:
        x: (m,) positions.
        force: (m, 2), of the foundation on the body.
        transferred: (m, 2), T times them.
        status: (m,), of contact.
    """

    x: Array
    force: Array
    transferred: Array
    status: npt.NDArray[np.int8]


def reactions(case: str, tracked: str) -> Result:
    """Reactions of the two triangles, section 7.1."""
    problem, peer = PROBLEMS[case], peer_of(case, tracked)
    assert isinstance(problem, TwoTriangles)
    standard, new = (s7_1_two_triangles.structure(element).curves for element in (GALERKIN, PW))
    theirs = np.column_stack([np.zeros(3), peer.numbers["reaction"]])
    space = Spaces.galerkin(_triangles(problem.mesh)).trial
    transferred = _transferred(space, peer.numbers["x"], theirs)[:, 1]
    scalars = {
        "raw_normal": _largest(theirs[:, 1] - standard["reaction"]),
        "transferred_normal": _largest(transferred - new["reaction"]),
    }
    scalars = {name: value / float(new["reaction"].mean()) for name, value in scalars.items()}
    curves = {"x": peer.numbers["x"], "peer_normal": theirs[:, 1], "peer_T_normal": transferred}
    return Result(scalars, dimensionless(scalars), curves, dofs=new["nodes"].size)


def contact(case: str, tracked: str) -> Result:
    """Contact forces below the block, section 7.2, over the mean normal nodal force.

    `raw`: CalculiX against the standard element. `transferred`: T times CalculiX against the new
    element. `control`: T times our own standard element against the new one. `elsewhere`: the
    second, away from edges of contact zones. Curves are in units of the example.
    """
    problem = PROBLEMS[case]
    assert isinstance(problem, Block)
    peer = peer_of(case, tracked)
    bodies = [_block(problem, element) for element in (GALERKIN, PW)]
    standard, new = (_contact_line(problem, body) for body in bodies)
    zeros = np.zeros(len(standard.x))
    theirs = np.column_stack(
        [peer.numbers.get("force_tangential", zeros), peer.numbers["force_normal"]]
    )
    transferred = _transferred(bodies[0].space, standard.x, theirs)

    mean = float(standard.force[:, 1].mean())
    away = _away_from_edges(standard.status, new.status)
    scalars = {
        "mean_force": mean,
        "open_nodes": float(np.sum(theirs[:, 1] < 1e-6 * mean)),
        "nodes_elsewhere": float(away.sum()),
    }
    curves: dict[str, np.ndarray] = {"x": standard.x}
    curves |= {f"status_{GALERKIN}": standard.status, f"status_{PW}": new.status}
    for axis, name in _components(problem):
        raw = theirs[:, axis] - standard.force[:, axis]
        ours = transferred[:, axis] - new.force[:, axis]
        control = standard.transferred[:, axis] - new.force[:, axis]
        scalars |= {
            f"raw_{name}": _largest(raw) / mean,
            f"transferred_{name}": _largest(ours) / mean,
            f"elsewhere_{name}": _largest(ours[away]) / mean,
            f"control_{name}": _largest(control) / mean,
            f"beyond_control_{name}": _largest(ours - control) / mean,
        }
        curves |= {
            f"peer_{name}": theirs[:, axis],
            f"peer_T_{name}": transferred[:, axis],
            f"{GALERKIN}_{name}": standard.force[:, axis],
            f"{PW}_{name}": new.force[:, axis],
        }
    units = units_of(scalars, {"mean_force": "force", "*": "1"})
    return Result(scalars, units, curves, dofs=bodies[0].K.getSize()[0])


def native_pressure(case: str, tracked: str) -> Result:
    """What CalculiX calls contact pressure below an evenly pressed block, over the pressure."""
    problem, peer = PROBLEMS[case], peer_of(case, tracked)
    assert isinstance(problem, NativePressure)
    pressure = peer.numbers["pressure"] / problem.pressure
    corner, middle = np.median(pressure[2:-2:2]), np.median(pressure[1::2])
    scalars = {"corner": corner, "midside": middle, "ratio": middle / corner}
    curves = {"x": peer.numbers["x"], "pressure": pressure}
    numbers = {name: float(value) for name, value in scalars.items()}
    return Result(numbers, dimensionless(numbers), curves)


def critical_stress(case: str, tracked: str) -> Result:
    """Critical stress of the half beam under uniform load, section 7.6."""
    problem, peer = PROBLEMS[case], peer_of(case, tracked)
    assert isinstance(problem, HalfBeam)
    (theirs,) = peer.numbers["critical_stress"]
    scalars = {"peer": float(theirs)}
    dofs = 0
    for element in (GALERKIN, PW):
        ours = s7_6_buckling.beam(
            element, "G", "uniform", problem.divisions, "right", "face", "face"
        )
        stress = ours.scalars[f"sigma_cr_{problem.mode}"]
        scalars |= {element: stress, f"difference_{element}": abs(theirs / stress - 1)}
        dofs = ours.dofs
    return Result(scalars, units_of(scalars, {"difference_*": "1", "*": "Pa"}), dofs=dofs)


def _block(problem: Block, element: str) -> Discretisation:
    mesh = problem.mesh
    material = Material(problem.modulus, problem.ratio)
    return discretise(element, lambda _: _triangles(mesh), material, StressState.PLANE_STRESS)


def _contact_line(problem: Block, body: Discretisation) -> Line:
    """Our own forces after the pressure, and after the pull in equal steps."""
    (_, y0), (x1, y1) = problem.mesh.lower, problem.mesh.upper

    def lower(x: Array) -> npt.NDArray[np.bool_]:
        return np.isclose(x[1], y0)

    def pressed(x: Array) -> npt.NDArray[np.bool_]:
        start, end = problem.pressed
        inside = (x[0] > start - 1e-9) & (x[0] < end + 1e-9)
        return np.isclose(x[1], y1) & inside

    loads = [body.surface_load((0.0, -problem.pressure), pressed)]
    supports = []
    if problem.pull:
        traction = (problem.pull * problem.pressure, 0.0)
        pull = body.surface_load(traction, lambda x: np.isclose(x[0], x1))
        steps = problem.increments
        loads += [loads[0] + pull * (k / steps) for k in range(1, steps + 1)]
    if not problem.friction:
        middle = problem.mesh.nodes[problem.mesh.node(problem.mesh.divisions[0], 0) - 1][0]
        supports = [prescribe(body.space, 0, lambda x: lower(x) & np.isclose(x[0], middle))]
    foundation = ContactPair(lower, Plane((0.0, y0), (0.0, 1.0)), problem.friction)
    states = solve_contact(body.K, loads, body.supports(supports), [foundation], body.space)
    (pair,) = states[-1].pairs
    force = np.column_stack([pair.force_tangential[:, 0], pair.force_normal])
    x = pair.position[:, 0]
    return Line(x, force, _transferred(body.space, x, force), pair.status)


def _transferred(space: fem.FunctionSpace, x: Array, force: Array) -> Array:
    """T times forces (m, 2) on the lower side; all other nodes are in equilibrium."""
    position = space.tabulate_dof_coordinates()
    y = position[:, 1].min()
    T = force_transfer(space)
    full: PETSc.Vec = T.createVecRight()
    values = np.zeros((len(position), 2))
    for place, components in zip(x, force, strict=True):
        (node,) = np.flatnonzero(np.isclose(position[:, 0], place) & np.isclose(position[:, 1], y))
        values[node] = components
    full.setArray(values.ravel())
    return forces_along(space, T * full, lambda p: np.isclose(p[1], y)).force


def _away_from_edges(*status: npt.NDArray[np.int8]) -> npt.NDArray[np.bool_]:
    """Nodes (m,) that are two elements or more away from the ends and from changes of status."""
    place = np.arange(len(status[0]))
    changes = [np.flatnonzero(np.diff(s)) + 0.5 for s in status]
    edges = np.concatenate([[0.0, place[-1]], *changes])
    return np.abs(place[:, None] - edges).min(axis=1) >= EDGE


def _components(problem: Block) -> list[tuple[int, str]]:
    return [(1, "normal"), (0, "tangential")] if problem.friction else [(1, "normal")]


def _triangles(mesh: TrianglePairs) -> Mesh:
    return triangles(MPI.COMM_SELF, mesh.lower, mesh.upper, mesh.divisions)


def _largest(values: Array) -> float:
    return float(np.abs(values).max())


_RUNS = {
    TwoTriangles: reactions,
    Block: contact,
    NativePressure: native_pressure,
    HalfBeam: critical_stress,
}


def _stated(problem: TwoTriangles | Block | HalfBeam) -> dict[str, object]:
    """What a problem's name implies: our elements, of which CalculiX has the standard one."""
    fields = asdict(problem)
    return {
        "compared": [GALERKIN] if isinstance(problem, NativePressure) else [GALERKIN, PW],
        "peer_element": fields.pop("element", "CPS6"),
        "divisions": problem.mesh.divisions,
        **fields,
    }


# the digest makes a case out of date when its tracked file changes
CASES = [
    Case(
        "P",
        name,
        _RUNS[type(problem)],
        {"case": name, "tracked": tracked_digest(name)},
        _stated(problem),
    )
    for name, problem in PROBLEMS.items()
    if isinstance(problem, TwoTriangles | Block | HalfBeam)  # others: p_standard, V11, Q
] + p_standard.CASES
