"""Active set and displacements that an increment's iteration starts from."""

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from scipy.spatial import cKDTree

from pw_elements.contact.errors import FreeBody
from pw_elements.contact.globalisation import FreeMotions
from pw_elements.contact.interface import Interface
from pw_elements.contact.kinematics import Kinematics
from pw_elements.contact.law import SLIP, STICK, ActiveSet, sticking
from pw_elements.contact.state import ContactState
from pw_elements.hybrid import fields_of
from pw_elements.spaces import as_function

Array = npt.NDArray[np.float64]

# A gap of this part of the surface's extent counts as closed in a cold start
_TOUCHING = 1e-9
# Padding of cells among which that around a point of another mesh is looked for
_BESIDE = 1e-6
# Cells whose nodes are looked for at once, to save memory
_AT_ONCE = 20_000


def first_active_set(
    place: Kinematics,
    before: ContactState,
    guess: ContactState | None,
    free_motions: FreeMotions,
) -> ActiveSet:
    """A guess, else what the state before ended with, else the points that touch.

    If it would not hold the body, every point that faces something sticks.

    Raises:
        FreeBody: if not even that holds it.
    """
    if guess is not None:
        first = _transferred(guess, place)
    elif before.increment:
        first = _resumed(before, place)
    else:
        first = _touching(place)
    for candidate in (first, _closed(place, np.isfinite(place.gap))):
        motions = free_motions(candidate, place.frame)
        if not motions:
            return candidate
    raise FreeBody(
        f"{' and '.join(motions)}: held neither by supports nor by contact, even if every "
        "contact node touched and stuck; add a support, friction or contact nodes"
    )


def first_unknowns(
    before: ContactState, guess: ContactState | None, space: fem.FunctionSpace
) -> PETSc.Vec:
    """Unknowns (n,) for an iterative solver to begin at: a guess', as far as it tells them."""
    if guess is None or guess.unknowns.getAttr("space") is None:
        return before.unknowns
    start = before.unknowns.duplicate()
    known = guess.unknowns.getAttr("space")
    for there, here in zip(fields_of(known), fields_of(space), strict=False):
        values = _interpolated(as_function(there.space, there.part(guess.unknowns)), here.space)
        start.array[here.owned.ravel()] = values
    return start


def _interpolated(there: fem.Function, space: fem.FunctionSpace) -> Array:
    """Values (owned dofs,) of a function on another mesh."""
    known, here = there.function_space, fem.Function(space)
    cells, comm = _covering(space), space.mesh.comm
    for k in range(comm.allreduce(-(-len(cells) // _AT_ONCE), MPI.MAX)):
        some = cells[k * _AT_ONCE : (k + 1) * _AT_ONCE]
        data = fem.create_interpolation_data(space, known, some, padding=_BESIDE)
        here.interpolate_nonmatching(there, some, interpolation_data=data)
    here.x.scatter_forward()
    owned = space.dofmap.index_map.size_local * space.dofmap.index_map_bs
    return np.asarray(here.x.array[:owned])


def _covering(space: fem.FunctionSpace) -> npt.NDArray[np.int32]:
    """Cells of this process that have all its nodes between them: about half of all cells."""
    topology = space.mesh.topology
    nodes = space.dofmap.list[: topology.index_map(topology.dim).size_local]
    last = np.full(nodes.max(initial=-1) + 1, -1, dtype=np.int32)
    last[nodes] = np.arange(len(nodes), dtype=np.int32)[:, None]
    return np.unique(last[last >= 0])


def _closed(place: Kinematics, closed: npt.NDArray[np.bool_]) -> ActiveSet:
    return sticking(closed, place.interface.friction, place.frame.shape[1] - 1)


def _touching(place: Kinematics) -> ActiveSet:
    """Points that the moved surface reaches; the nearest of each pair in any case."""
    interface: Interface = place.interface
    gap, near = place.gap, _TOUCHING * interface.extent
    closed = gap <= near
    for k in range(interface.pairs):
        mine = interface.pair == k
        nearest = interface.comm.allreduce(gap[mine].min(initial=np.inf), MPI.MIN)
        closed |= mine & np.isfinite(gap) & (gap <= nearest + near)
    return _closed(place, closed)


def _resumed(before: ContactState, place: Kinematics) -> ActiveSet:
    """The active set of a state, in the frames of a place."""
    local, pairs = place.interface.local, before.pairs
    direction = local([pair.direction for pair in pairs])
    return ActiveSet(
        local([pair.status for pair in pairs]),
        np.einsum("nab,nb->na", place.frame[:, 1:], direction),
        local([pair.turning for pair in pairs]),
    )


def _transferred(guess: ContactState, place: Kinematics) -> ActiveSet:
    """Status and direction of the nearest node of another mesh's state."""
    interface = place.interface
    n, dim = interface.position.shape
    status, force = np.zeros(n, dtype=np.int8), np.zeros((n, dim))
    for k, pair in enumerate(guess.pairs):
        mine = interface.pair == k
        if mine.any():
            nearest = cKDTree(pair.position).query(interface.position[mine])[1]
            status[mine] = pair.status[nearest]
            force[mine] = pair.force_tangential[nearest]
    rough = interface.friction > 0
    status[(status == STICK) & ~rough] = SLIP
    tangential = np.einsum("nab,nb->na", place.frame[:, 1:], force)
    size = np.linalg.norm(tangential, axis=1)
    directed = (status == SLIP) & rough & (size > 0)
    status[(status == SLIP) & rough & ~directed] = STICK
    direction = np.where(directed, 1 / np.where(directed, size, 1.0), 0.0)[:, None]
    return ActiveSet(status, direction * tangential, directed.astype(float))
