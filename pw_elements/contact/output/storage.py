"""States in portable files: NumPy archives of plain numbers, independent of the partition."""

import io
import json
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from hashlib import blake2b
from itertools import product
from pathlib import Path
from typing import Any

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from scipy.spatial import cKDTree

from pw_elements.arrays import Array
from pw_elements.checks import arguments, collective_errors
from pw_elements.contact.interface import average_cell_midpoints, extents
from pw_elements.contact.model import (
    ContactPair,
    ContactState,
    PairState,
    Residuals,
    Scale,
    Smallness,
)
from pw_elements.contact.output.identity import Identity
from pw_elements.contact.output.stored_values import check_arrays, check_numbers, check_pairs
from pw_elements.files import ForeignEntry, replacing_file
from pw_elements.solvers import SolverReport
from pw_elements.spaces import list_fields

# Names of the arrays of places that belong to values
_FIELDS = {"displacement": "nodes", "pressure": "pressure_nodes"}
# What of a state is written as it is, and by its own numbers
_PLAIN = ("iterations", "unique", "increment", "free_motions")
_OF_NUMBERS = {
    "residuals": Residuals,
    "allowance": Residuals,
    "report": SolverReport,
    "scale": Scale,
    "smallness": Smallness,
}
_KIND = "pw_elements contact state"
_FORMAT = f"{_KIND} 8"
# First array of a file, by which it is known for a state, whole or not: the digest of the others
_MARK = f"{_KIND}, digest"
_HEAD = 200  # bytes of a file that have the name of its first array
# Before the names of what tells a problem from others
_PROBLEM = "problem "
# Largest displacement that is believed, over the body's diagonal
_LARGEST_MOTION = 1e6
# Largest distance of a node from its place in the file, over the body's extent
_NEAR = 1e-8


def write_state(
    path: str | Path,
    state: ContactState,
    space: fem.FunctionSpace,
    history: Sequence[fem.FunctionSpace],
    problem: Identity,
) -> None:
    """Writes a state whole or not at all, on one process, if it is a solution of a `problem`."""
    path, identity = checked_path(path), problem.numbers()
    if not state.converged:
        raise ValueError("the state is not a solution: no increment can continue from it")
    comm = space.mesh.comm
    arrays: dict[str, npt.NDArray] = {}
    known = [field.extract(state.unknowns).array_r for field in list_fields(space)]
    parts = zip(_parts(space, history), [*known, *state.history], strict=True)
    for (name, nodes, of), values in parts:
        places = _places(of)
        given = comm.gather((places, values.reshape(-1, of.dofmap.index_map_bs)[: len(places)]))
        if comm.rank == 0:
            each = zip(*given, strict=True)
            arrays |= dict(zip((nodes, name), map(np.concatenate, each), strict=True))
    if comm.rank == 0:
        for k, pair in enumerate(state.pairs):
            arrays |= {f"{name}_{k}": values for name, values in vars(pair).items()}
        numbers = {name: getattr(state, name) for name in _PLAIN}
        told = {name: getattr(state, name) for name in _OF_NUMBERS}
        numbers |= {name: None if part is None else vars(part) for name, part in told.items()}
        numbers |= {"orientations": sorted(state.orientations)}
        numbers |= {"format": _FORMAT, "pairs": len(state.pairs)}
        arrays |= {f"{_PROBLEM}{name}": values for name, values in identity.items()}
        arrays["state"] = np.array(json.dumps(numbers))
        arrays["digest"] = _digest(arrays)
    with collective_errors(comm):
        if arrays:
            try:
                _write(path, arrays)
            except ForeignEntry:
                raise
            except OSError as failed:
                raise type(failed)(f"the state cannot be written to {path}: {failed}") from failed


def read_state(
    path: str | Path,
    space: fem.FunctionSpace,
    history: Sequence[fem.FunctionSpace],
    problem: Identity,
    own: ContactState,
    stated: Sequence[ContactPair],
    stiffness: PETSc.Mat,
    changed: Collection[object] = (),
) -> ContactState:
    """Reads a state of a `problem`: one process does, and hands out values of their nodes.

    Args:
        path: of the file.
        space: of the unknowns.
        history: spaces of the functions that belong to a state.
        problem: whose state it has to be.
        own: the problem's undeformed state.
        stated: its pairs.
        stiffness: (n, n), by which forces are too large to be any.
        changed: what of the problem may be another one.
    """
    path, comm, parts = checked_path(path), space.mesh.comm, _parts(space, history)
    dim = space.mesh.geometry.dim
    arrays: dict[str, npt.NDArray] = {}
    numbers: dict[str, Any] = {}
    pairs: list[dict[str, Any]] = []
    with collective_errors(comm):
        if comm.rank == 0:
            arrays, numbers, pairs = _read(path, dim)
            if missing := [name for name, _, _ in parts if name not in arrays]:
                raise ValueError(
                    f"{path} has the state of a problem without {missing[0].partition('_')[0]}"
                )
            if f"history_{len(history)}" in arrays:
                raise ValueError(f"{path} has the state of a problem with more history")
    values, rows = {}, {}
    for name, nodes, of in parts:
        values[name], rows[name] = _handed_out(path, name, arrays.get(nodes), arrays.get(name), of)
    stored = {k.removeprefix(_PROBLEM): v for k, v in arrays.items() if k.startswith(_PROBLEM)}
    problem.refuse_another(path, comm.bcast(stored), changed)
    length = _LARGEST_MOTION * float(np.linalg.norm(extents(comm, space.mesh.geometry.x)))
    largest = Scale(length * stiffness.norm(PETSc.NormType.INFINITY), length)
    fields = list_fields(space)
    with collective_errors(comm):
        if comm.rank == 0:
            today = np.argsort(rows["displacement"])
            moved = arrays["displacement"][rows["displacement"]]
            try:
                _renumber(pairs, today)
                check_pairs(pairs, own, stated, numbers, moved, largest)
            except (ValueError, IndexError) as wrong:
                raise ValueError(f"{path} holds no contact state: {wrong}") from None
    numbers, pairs = comm.bcast((numbers, pairs))
    unknowns = PETSc.Vec().createMPI(fields[0].full_sizes, comm=comm)
    spread = [field.embed(values[name]) for name, field in zip(_FIELDS, fields, strict=False)]
    unknowns.setArray(np.sum(spread, axis=0))
    state: dict[str, Any] = {name: numbers[name] for name in _PLAIN}
    given = {name: numbers[name] for name in _OF_NUMBERS}
    state |= {k: None if v is None else _OF_NUMBERS[k](**v) for k, v in given.items()}
    state["free_motions"] = tuple((pair, axis) for pair, axis in numbers["free_motions"])
    state["orientations"] = frozenset(numbers["orientations"])
    state["pairs"] = tuple(PairState(**pair) for pair in pairs)
    functions = parts[len(fields) :]
    state["history"] = tuple(_with_ghosts(of, values[name]) for name, _, of in functions)
    return ContactState(fields[0].extract(unknowns), unknowns=unknowns, **state)


def _renumber(pairs: Sequence[dict[str, Any]], today: npt.NDArray[np.intp]) -> None:
    """Give the nodes of pairs, which are rows of the file, their global numbers of today."""
    for pair, name in product(pairs, ("node", "faced_node", "opposite_node")):
        rows = pair[name]
        if rows.dtype.kind not in "iu" or rows.max(initial=-1) >= len(today):
            raise ValueError(f"{name} has numbers of other nodes")
        pair[name] = np.where(rows < 0, rows, today[rows])


def _read(
    path: Path, dim: int
) -> tuple[dict[str, npt.NDArray], dict[str, Any], list[dict[str, Any]]]:
    """A file's arrays, the numbers of the state, and what makes its pairs."""
    try:
        _refuse_irregular(path, "it is not read")
        data = path.read_bytes()
    except OSError as failed:
        raise type(failed)(f"the state cannot be read from {path}: {failed}") from failed
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            arrays = dict(archive)
        digest = arrays.pop(_MARK, None)
        numbers = json.loads(str(arrays["state"]))
        if numbers["format"] != _FORMAT:
            raise ValueError(
                f"its format is {numbers['format']!r}, not {_FORMAT!r}: compute it once more"
            )
        if digest is None or digest.tobytes() != _digest(arrays).tobytes():
            raise ValueError("it has been changed since it was written")
        check_arrays(arrays, ("state", f"{_PROBLEM}version"))
        check_numbers(numbers, dim)
        pairs = [
            {name: arrays[f"{name}_{k}"] for name in PairState.__dataclass_fields__}
            for k in range(numbers["pairs"])
        ]
    except Exception as failed:  # of whatever kind: any bytes may be in a file
        said = str(failed) or type(failed).__name__
        raise ValueError(f"{path} holds no contact state: {said}") from None
    return arrays, numbers, pairs


def checked_path(path: str | Path) -> Path:
    arguments.check_type("the path", path, (str, Path), "give a file's name or pathlib.Path")
    if "\0" in str(path):
        raise ValueError(f"the path {str(path)!r} has a null character, which no file's name has")
    return Path(path)


def _parts(
    space: fem.FunctionSpace, history: Sequence[fem.FunctionSpace]
) -> list[tuple[str, str, fem.FunctionSpace]]:
    """Arrays of values and of their places, and the space, of all functions of a state."""
    fields = zip(_FIELDS.items(), list_fields(space), strict=False)
    functions = [(f"history_{k}", f"history_nodes_{k}", of) for k, of in enumerate(history)]
    return [(name, nodes, field.space) for (name, nodes), field in fields] + functions


def _with_ghosts(space: fem.FunctionSpace, own: Array) -> Array:
    found = fem.Function(space)
    found.x.array[: len(own)] = own
    found.x.scatter_forward()
    return found.x.array.copy()


def _handed_out(
    path: Path, name: str, stored: Array | None, values: Array | None, space: fem.FunctionSpace
) -> tuple[Array, npt.NDArray[np.intp]]:
    """Values at this process' owned nodes, from a file's places and values, which process 0 read.

    Process 0 also gets the row of each global node in the file, its number there; others none.
    """
    comm, nearest = space.mesh.comm, np.empty(0, dtype=np.intp)
    given, parts = comm.gather(_places(space)), None
    with collective_errors(comm):
        if stored is not None and values is not None:
            places = np.concatenate(given)
            wrong = stored.shape != places.shape
            if not wrong:
                distance, nearest = cKDTree(stored).query(places)
                extent = np.ptp(stored, axis=0).max()
                wrong = distance.max() > _NEAR * extent or len(np.unique(nearest)) < len(nearest)
            if wrong:
                raise ValueError(f"{path} has the state of another mesh")
            shape = len(stored), space.dofmap.index_map_bs
            try:
                arguments.check_real_array(name, values, shape)
            except ValueError as error:
                raise ValueError(f"{path} holds no contact state: {error}") from None
            rows = np.split(nearest, np.cumsum([len(each) for each in given])[:-1])
            parts = [values[each].ravel() for each in rows]
    return comm.scatter(parts), nearest


def _places(space: fem.FunctionSpace) -> Array:
    """Position and mean midpoint of the cells around of each owned node, (nodes, 2 dim).

    Both together tell nodes apart that coincide, such as those of two bodies that touch.
    """
    owned, dim = space.dofmap.index_map.size_local, space.mesh.geometry.dim
    x = space.tabulate_dof_coordinates()[:owned, :dim]
    return np.concatenate([x, average_cell_midpoints(space)[:owned]], axis=1)


def _refuse_irregular(path: Path, otherwise: str) -> None:
    if path.exists() and not path.is_file():
        raise FileExistsError(f"{path} is no regular file: {otherwise}")


def _digest(arrays: Mapping[str, npt.NDArray]) -> npt.NDArray[np.uint8]:
    digest = blake2b(digest_size=16)
    for name, values in sorted(arrays.items()):
        digest.update(f"{name} {values.dtype} {values.shape} ".encode())
        digest.update(np.ascontiguousarray(values).tobytes())
    return np.frombuffer(digest.digest(), dtype=np.uint8)


def _write(path: Path, arrays: dict[str, npt.NDArray]) -> None:
    marked = {_MARK: arrays.pop("digest"), **arrays}
    with replacing_file(path, _holds_state) as stream:
        np.savez_compressed(stream, allow_pickle=False, **marked)


def _holds_state(path: Path) -> bool:
    """Tell whether a file is a state, or was to be one: such files may be replaced."""
    with path.open("rb") as stream:
        head = stream.read(_HEAD)
    if not head or f"{_MARK}.npy".encode() in head:
        return True
    with suppress(Exception), np.load(path, allow_pickle=False) as archive:  # of earlier formats
        return str(json.loads(str(archive["state"]))["format"]).startswith(_KIND)
    return False
