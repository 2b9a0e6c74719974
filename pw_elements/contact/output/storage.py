"""Files of contact states: NumPy archives of plain numbers, independent of the partition.

A file contains the nodal values of each function with the positions of the nodes, the results of
each contact pair, the fingerprint of the problem, and a digest of all these arrays. The module
guarantees that a file is either complete or not written at all. A state can be read on any number
of processes, but only for the problem that has the file's fingerprint. The module assumes that
nodes at the same position belong to cells with different midpoints.
"""

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
from pw_elements.checks import arguments, raise_errors_on_all_processes
from pw_elements.contact.interface import (
    average_midpoints_of_adjacent_cells,
    compute_bounding_box_extents,
)
from pw_elements.contact.model import (
    ContactPair,
    ContactState,
    PairState,
    Residuals,
    ResidualScale,
    SmallDisplacementMeasures,
)
from pw_elements.contact.output.identity import ProblemFingerprint
from pw_elements.contact.output.stored_values import (
    check_real_arrays,
    check_stored_pair_results,
    check_stored_state_numbers,
)
from pw_elements.files import ForeignFileOrFolder, open_replacement_file
from pw_elements.solvers import SolverReport
from pw_elements.spaces import list_fields

# Names of arrays with nodal values, and of the arrays with the positions of these nodes
_POSITION_ARRAY_OF_VALUE_ARRAY = {"displacement": "nodes", "pressure": "pressure_nodes"}
# Attributes of a state that are written unchanged, and attributes that are records of numbers, with
# the types of these records
_STATE_ATTRIBUTES_WRITTEN_UNCHANGED = ("iterations", "unique", "increment", "free_motions")
_RECORD_TYPE_OF_STATE_ATTRIBUTE = {
    "residuals": Residuals,
    "allowance": Residuals,
    "report": SolverReport,
    "scale": ResidualScale,
    "smallness": SmallDisplacementMeasures,
}
_FILE_FORMAT_NAME = "pw_elements contact state"
_FILE_FORMAT_AND_VERSION = f"{_FILE_FORMAT_NAME} 9"
# Name of a file's first array, the digest of all others. It shows that a file contains a state,
# even if the file is incomplete
_DIGEST_ARRAY_NAME = f"{_FILE_FORMAT_NAME}, digest"
# Number of bytes at the start of a file within which the name of its first array is found
_FILE_HEAD_SIZE_IN_BYTES = 200
# Prefix of the names of arrays that belong to the problem's fingerprint
_FINGERPRINT_ARRAY_PREFIX = "problem "
# Largest plausible displacement relative to the body's diagonal
_MAX_PLAUSIBLE_DISPLACEMENT_PER_DIAGONAL = 1e6
# Largest distance between a node and its position in the file, relative to the body's extent
_MAX_SAME_NODE_DISTANCE_PER_EXTENT = 1e-8


def write_state(
    path: str | Path,
    state: ContactState,
    space: fem.FunctionSpace,
    history_spaces: Sequence[fem.FunctionSpace],
    fingerprint: ProblemFingerprint,
) -> None:
    """Write a state to a file, completely or not at all.

    Process 0 collects all values and writes the file.

    Args:
        path: path of the file.
        state: solution of the problem.
        space: space of the unknowns.
        history_spaces: spaces of the functions whose values are stored with each state.
        fingerprint: fingerprint of the problem.

    Raises:
        ValueError: if the state is not a solution.
        OSError: if the file cannot be written.
    """
    path, fingerprint_values = check_and_convert_path(path), fingerprint.evaluate_all_values()
    if not state.converged:
        raise ValueError("the state is not a solution: no increment can continue from it")
    comm = space.mesh.comm
    arrays: dict[str, npt.NDArray] = {}
    field_values = [field.extract(state.unknowns).array_r for field in list_fields(space)]
    functions = zip(
        _list_array_names_and_spaces(space, history_spaces),
        [*field_values, *state.history],
        strict=True,
    )
    for (name, position_name, function_space), values in functions:
        positions = _node_positions_and_adjacent_midpoints(function_space)
        parts_of_ranks = comm.gather(
            (positions, values.reshape(-1, function_space.dofmap.index_map_bs)[: len(positions)])
        )
        if comm.rank == 0:
            arrays_of_function = zip(*parts_of_ranks, strict=True)
            arrays |= dict(
                zip((position_name, name), map(np.concatenate, arrays_of_function), strict=True)
            )
    if comm.rank == 0:
        for k, pair in enumerate(state.pairs):
            arrays |= {f"{name}_{k}": values for name, values in vars(pair).items()}
        header = {name: getattr(state, name) for name in _STATE_ATTRIBUTES_WRITTEN_UNCHANGED}
        records = {name: getattr(state, name) for name in _RECORD_TYPE_OF_STATE_ATTRIBUTE}
        header |= {
            name: None if record is None else vars(record) for name, record in records.items()
        }
        header |= {"determinant_signs": sorted(state.determinant_signs)}
        header |= {"format": _FILE_FORMAT_AND_VERSION, "pairs": len(state.pairs)}
        arrays |= {
            f"{_FINGERPRINT_ARRAY_PREFIX}{name}": values
            for name, values in fingerprint_values.items()
        }
        arrays["state"] = np.array(json.dumps(header))
        arrays["digest"] = _compute_digest(arrays)
    with raise_errors_on_all_processes(comm):
        if arrays:
            try:
                _write_state_file(path, arrays)
            except ForeignFileOrFolder:
                raise
            except OSError as error:
                raise type(error)(f"the state cannot be written to {path}: {error}") from error


def read_state(
    path: str | Path,
    space: fem.FunctionSpace,
    history_spaces: Sequence[fem.FunctionSpace],
    fingerprint: ProblemFingerprint,
    undeformed_state: ContactState,
    contact_pairs: Sequence[ContactPair],
    stiffness: PETSc.Mat,
    changed_parts: Collection[object] = (),
) -> ContactState:
    """Read a state of a problem from a file.

    Process 0 reads the file and distributes the values.

    Args:
        path: path of the file.
        space: space of the unknowns.
        history_spaces: spaces of the functions whose values are stored with each state.
        fingerprint: fingerprint of the problem.
        undeformed_state: the problem's undeformed state.
        contact_pairs: the problem's contact pairs.
        stiffness: stiffness (n, n), from which the largest plausible force is computed.
        changed_parts: parts of the problem that may differ: names from
            `PARTS_DECLARABLE_AS_CHANGED`, constants and functions.

    Raises:
        OSError: if the file cannot be read.
        ValueError: if the file contains no state, or the state of another problem.
    """
    path, comm, functions = (
        check_and_convert_path(path),
        space.mesh.comm,
        _list_array_names_and_spaces(space, history_spaces),
    )
    dim = space.mesh.geometry.dim
    arrays: dict[str, npt.NDArray] = {}
    header: dict[str, Any] = {}
    pairs: list[dict[str, Any]] = []
    with raise_errors_on_all_processes(comm):
        if comm.rank == 0:
            arrays, header, pairs = _read_and_check_state_file(path, dim)
            if missing := [name for name, _, _ in functions if name not in arrays]:
                raise ValueError(
                    f"{path} has the state of a problem without {missing[0].partition('_')[0]}"
                )
            if f"history_{len(history_spaces)}" in arrays:
                raise ValueError(f"{path} has the state of a problem with more history")
    values, rows = {}, {}
    for name, position_name, function_space in functions:
        values[name], rows[name] = _distribute_nodal_values(
            path, name, arrays.get(position_name), arrays.get(name), function_space
        )
    stored = {
        name.removeprefix(_FINGERPRINT_ARRAY_PREFIX): value
        for name, value in arrays.items()
        if name.startswith(_FINGERPRINT_ARRAY_PREFIX)
    }
    fingerprint.raise_if_file_of_other_problem(path, comm.bcast(stored), changed_parts)
    length = _MAX_PLAUSIBLE_DISPLACEMENT_PER_DIAGONAL * float(
        np.linalg.norm(compute_bounding_box_extents(comm, space.mesh.geometry.x))
    )
    max_scale = ResidualScale(length * stiffness.norm(PETSc.NormType.INFINITY), length)
    fields = list_fields(space)
    with raise_errors_on_all_processes(comm):
        if comm.rank == 0:
            global_nodes = np.argsort(rows["displacement"])
            displacement = arrays["displacement"][rows["displacement"]]
            try:
                _renumber_nodes_of_pairs(pairs, global_nodes)
                check_stored_pair_results(
                    pairs, undeformed_state, contact_pairs, header, displacement, max_scale
                )
            except (ValueError, IndexError) as error:
                raise ValueError(f"{path} holds no contact state: {error}") from None
    header, pairs = comm.bcast((header, pairs))
    unknowns = PETSc.Vec().createMPI(fields[0].full_sizes, comm=comm)
    field_vectors = [
        field.embed(values[name])
        for name, field in zip(_POSITION_ARRAY_OF_VALUE_ARRAY, fields, strict=False)
    ]
    unknowns.setArray(np.sum(field_vectors, axis=0))
    state: dict[str, Any] = {name: header[name] for name in _STATE_ATTRIBUTES_WRITTEN_UNCHANGED}
    records = {name: header[name] for name in _RECORD_TYPE_OF_STATE_ATTRIBUTE}
    state |= {
        name: None if value is None else _RECORD_TYPE_OF_STATE_ATTRIBUTE[name](**value)
        for name, value in records.items()
    }
    state["free_motions"] = tuple((pair, axis) for pair, axis in header["free_motions"])
    state["determinant_signs"] = frozenset(header["determinant_signs"])
    state["pairs"] = tuple(PairState(**pair) for pair in pairs)
    functions = functions[len(fields) :]
    state["history"] = tuple(
        _extend_by_ghost_values(function_space, values[name])
        for name, _, function_space in functions
    )
    return ContactState(fields[0].extract(unknowns), unknowns=unknowns, **state)


def _renumber_nodes_of_pairs(
    pair_fields: Sequence[dict[str, Any]], global_node_of_row: npt.NDArray[np.intp]
) -> None:
    """Replace node numbers of pairs in place: row numbers of the file become global numbers.

    Args:
        pair_fields: fields of the pairs' states.
        global_node_of_row: global number of each row of the file.
    """
    for pair, name in product(pair_fields, ("node", "faced_node", "opposite_node")):
        rows = pair[name]
        if rows.dtype.kind not in "iu" or rows.max(initial=-1) >= len(global_node_of_row):
            raise ValueError(f"{name} has numbers of other nodes than the file's")
        pair[name] = np.where(rows < 0, rows, global_node_of_row[rows])


def _read_and_check_state_file(
    path: Path, dim: int
) -> tuple[dict[str, npt.NDArray], dict[str, Any], list[dict[str, Any]]]:
    """Return a file's arrays, the numbers of the state, and the fields of the state's pairs.

    Args:
        path: path of the file.
        dim: dimension of space.

    Raises:
        OSError: if the file cannot be read.
        ValueError: if the file is damaged, or contains no state of a problem in this dimension.
    """
    try:
        _raise_if_irregular_file(path, "it is not read")
        data = path.read_bytes()
    except OSError as error:
        raise type(error)(f"the state cannot be read from {path}: {error}") from error
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            arrays = dict(archive)
        digest = arrays.pop(_DIGEST_ARRAY_NAME, None)
        header = json.loads(str(arrays["state"]))
        if header["format"] != _FILE_FORMAT_AND_VERSION:
            raise ValueError(
                f"its format is {header['format']!r}, not {_FILE_FORMAT_AND_VERSION!r}: compute "
                "the state again"
            )
        if digest is None or digest.tobytes() != _compute_digest(arrays).tobytes():
            raise ValueError("it has been changed since it was written")
        check_real_arrays(arrays, ("state", f"{_FINGERPRINT_ARRAY_PREFIX}version"))
        check_stored_state_numbers(header, dim)
        pairs = [
            {name: arrays[f"{name}_{k}"] for name in PairState.__dataclass_fields__}
            for k in range(header["pairs"])
        ]
    except Exception as error:  # of any type, since the file may contain any bytes
        reason = str(error) or type(error).__name__
        raise ValueError(f"{path} holds no contact state: {reason}") from None
    return arrays, header, pairs


def check_and_convert_path(path: str | Path) -> Path:
    """Return the argument as a `Path`; raise TypeError or ValueError if it is not a path."""
    arguments.check_type("the path", path, (str, Path), "give a file's name or pathlib.Path")
    if "\0" in str(path):
        raise ValueError(f"the path {str(path)!r} has a null character, which no file's name has")
    return Path(path)


def _list_array_names_and_spaces(
    space: fem.FunctionSpace, history_spaces: Sequence[fem.FunctionSpace]
) -> list[tuple[str, str, fem.FunctionSpace]]:
    """Return, for each function of a state, the names of its two arrays and its space.

    The first array contains the values, the second one the positions of the nodes. The functions of
    a state are its unknowns and its history.
    """
    fields = zip(_POSITION_ARRAY_OF_VALUE_ARRAY.items(), list_fields(space), strict=False)
    functions = [
        (f"history_{number}", f"history_nodes_{number}", function_space)
        for number, function_space in enumerate(history_spaces)
    ]
    return [
        (name, position_name, field.space) for (name, position_name), field in fields
    ] + functions


def _extend_by_ghost_values(space: fem.FunctionSpace, owned_values: Array) -> Array:
    """Return owned values of a function, followed by the values at ghost nodes; collective."""
    function = fem.Function(space)
    function.x.array[: len(owned_values)] = owned_values
    function.x.scatter_forward()
    return function.x.array.copy()


def _distribute_nodal_values(
    path: Path,
    name: str,
    stored_positions: Array | None,
    values: Array | None,
    space: fem.FunctionSpace,
) -> tuple[Array, npt.NDArray[np.intp]]:
    """Distribute nodal values of a file from process 0 to the owners of the nodes; collective.

    Args:
        path: path of the file.
        name: name of the values.
        stored_positions: on process 0, positions (nodes, 2 dim) in the file, as returned by
            `_node_positions_and_adjacent_midpoints`; None elsewhere.
        values: on process 0, values (nodes, block) in the file; None elsewhere.
        space: space of the function.

    Returns:
        The values at the nodes that this process owns; and, on process 0, the row of the file for
        each global node number.

    Raises:
        ValueError: if the nodes are not those of the space, or a value is not real and finite.
    """
    comm, nearest = space.mesh.comm, np.empty(0, dtype=np.intp)
    parts_of_ranks, values_of_ranks = (
        comm.gather(_node_positions_and_adjacent_midpoints(space)),
        None,
    )
    with raise_errors_on_all_processes(comm):
        if stored_positions is not None and values is not None:
            positions = np.concatenate(parts_of_ranks)
            is_other_mesh = stored_positions.shape != positions.shape
            if not is_other_mesh:
                distance, nearest = cKDTree(stored_positions).query(positions)
                extent = np.ptp(stored_positions, axis=0).max()
                is_other_mesh = distance.max() > _MAX_SAME_NODE_DISTANCE_PER_EXTENT * extent or len(
                    np.unique(nearest)
                ) < len(nearest)
            if is_other_mesh:
                raise ValueError(f"{path} has the state of another mesh")
            shape = len(stored_positions), space.dofmap.index_map_bs
            try:
                arguments.check_real_array(name, values, shape)
            except ValueError as error:
                raise ValueError(f"{path} holds no contact state: {error}") from None
            rows = np.split(nearest, np.cumsum([len(part) for part in parts_of_ranks])[:-1])
            values_of_ranks = [values[part].ravel() for part in rows]
    return comm.scatter(values_of_ranks), nearest


def _node_positions_and_adjacent_midpoints(space: fem.FunctionSpace) -> Array:
    """Return an array (nodes, 2 dim) that identifies the nodes that this process owns.

    A row has the position of the node and the mean midpoint of the adjacent cells. The midpoint
    distinguishes nodes that coincide, such as those of two bodies that touch.
    """
    owned, dim = space.dofmap.index_map.size_local, space.mesh.geometry.dim
    x = space.tabulate_dof_coordinates()[:owned, :dim]
    return np.concatenate([x, average_midpoints_of_adjacent_cells(space)[:owned]], axis=1)


def _raise_if_irregular_file(path: Path, consequence: str) -> None:
    """Raise FileExistsError if the path is a folder, a device or another irregular file.

    Args:
        path: path to check.
        consequence: end of the error message, which says that the file is not read, for example.
    """
    if path.exists() and not path.is_file():
        raise FileExistsError(f"{path} is no regular file: {consequence}")


def _compute_digest(arrays: Mapping[str, npt.NDArray]) -> npt.NDArray[np.uint8]:
    """Return a digest of arrays, including their names, types and shapes."""
    digest = blake2b(digest_size=16)
    for name, values in sorted(arrays.items()):
        digest.update(f"{name} {values.dtype} {values.shape} ".encode())
        digest.update(np.ascontiguousarray(values).tobytes())
    return np.frombuffer(digest.digest(), dtype=np.uint8)


def _write_state_file(path: Path, arrays: dict[str, npt.NDArray]) -> None:
    """Write arrays to a file, beginning with the digest.

    An existing file is replaced only if it contains a state.
    """
    digest_and_arrays = {_DIGEST_ARRAY_NAME: arrays.pop("digest"), **arrays}
    with open_replacement_file(path, _is_replaceable_state_file) as stream:
        np.savez_compressed(stream, allow_pickle=False, **digest_and_arrays)


def _is_replaceable_state_file(path: Path) -> bool:
    """Return whether a file contains a complete or incomplete state, or nothing at all."""
    with path.open("rb") as stream:
        head = stream.read(_FILE_HEAD_SIZE_IN_BYTES)
    if not head or f"{_DIGEST_ARRAY_NAME}.npy".encode() in head:
        return True
    with suppress(Exception), np.load(path, allow_pickle=False) as archive:  # earlier format
        return str(json.loads(str(archive["state"]))["format"]).startswith(_FILE_FORMAT_NAME)
    return False
