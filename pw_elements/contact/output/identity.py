"""Fingerprint of a contact problem, which shows whether a file belongs to the problem.

A fingerprint consists of values of the problem's form, surfaces and laws at fixed probes. Two
fingerprints are compared with a tolerance. The partition of the mesh therefore does not matter, nor
does the signature of a form, which depends on the version of UFL. Loads, prescribed values and
motions are left out, since they change from step to step.

The probes of a form are smooth displacements and smooth weights. The form is evaluated at each of
these displacements, multiplied by each of these weights, and summed over all equations. Constants
and functions of the form are compared by their values, except for those that loads have changed.
When the form is compared with a file, it is evaluated with the constants and the mean values of
functions in the file.

The module guarantees that the problem is unchanged after an evaluation. It assumes that forms,
surfaces and laws are functions of their arguments alone.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from mpi4py import MPI
from petsc4py import PETSc

import dolfinx
import numpy as np
import numpy.typing as npt
from dolfinx import fem

from pw_elements.algebra import JoinedResidualSystem, PetrovGalerkinProblem, ResidualSystem
from pw_elements.arrays import Array, Indices
from pw_elements.checks import arguments, list_bodies, max_relative_difference
from pw_elements.contact.interface import (
    ContactInterface,
    sample_friction_coefficients,
    sample_interference,
    sample_surface_around_pair,
)
from pw_elements.contact.model import ContactPair, PairState
from pw_elements.spaces import SubSpace, gather_nodal_values, list_fields

# Largest difference between two fingerprints, relative to the values compared, that counts as
# round-off
_RELATIVE_FINGERPRINT_ROUND_OFF = 1e-8
# Smooth probes are cosines. For each probe, change of the phase along each axis from one end of the
# body to the other, and phase at the body's lower corner
_COSINE_PROBE_PHASE_CHANGES = (
    2 * np.pi * np.array([[0.31, 0.17, 0.23], [0.83, -0.57, 0.41], [-0.47, 1.13, 0.89]])
)
_COSINE_PROBE_START_PHASES = np.array([0.4, 1.1, 2.3])
# Size of probing displacements relative to the body's diagonal: strains are a few per cent
_PROBE_DISPLACEMENT_PER_DIAGONAL = 0.005
# Parts of a problem that a user may declare as changed
PARTS_DECLARABLE_AS_CHANGED = (
    *("constants", "friction", "interference", "pivot"),
    *("residual", "stiffness", "supports", "surface"),
)
_RESIDUAL_COEFFICIENT_SUFFIX = " of the residual"
# Smallest scale by which the difference of a row is divided, relative to the largest value of all
# rows; smaller values may be round-off of the sums
_MIN_ROW_SCALE_PER_LARGEST_VALUE = 1e-3

FingerprintValues = dict[str, npt.NDArray]


@dataclass
class ResidualCoefficients:
    """Constants and functions of a residual, except for its unknown.

    Args:
        constants: constants of the residual, in the order of their creation.
        functions: functions of the residual, in the order of their creation.
        history: functions whose values are stored with each state.

    Attributes:
        changed_constants: for each constant, whether a load has changed it since the problem was
            created. If the problem continues from a saved state, changes before that state count.
        changed_functions: for each function, whether a load has changed its values on this process.
    """

    constants: list[fem.Constant]
    functions: list[fem.Function]
    history: list[fem.Function]
    changed_constants: npt.NDArray[np.bool_] = field(init=False)
    changed_functions: npt.NDArray[np.bool_] = field(init=False)

    def __post_init__(self) -> None:
        self.changed_constants = np.zeros(len(self.constants), dtype=bool)
        self.changed_functions = np.zeros(len(self.functions), dtype=bool)

    @classmethod
    def from_problems(
        cls, problems: Sequence[PetrovGalerkinProblem], history: Sequence[fem.Function]
    ) -> "ResidualCoefficients":
        """Return the constants and functions of residuals, without their unknowns.

        Args:
            problems: residual and unknown function of each body.
            history: functions whose values are stored with each state.
        """
        functions = [
            f
            for problem in problems
            for f in problem.form.coefficients()
            if isinstance(f, fem.Function) and f is not problem.u
        ]
        history_functions = [f for f in functions if any(f is h for h in history)]
        return cls(
            [constant for problem in problems for constant in problem.form.constants()],
            [f for f in functions if f not in history_functions],
            history_functions,
        )

    @contextmanager
    def record_changes_by_load(self) -> Iterator[None]:
        """Record which constants and functions change within a `with` block that applies a load."""
        old_constants = [np.array(coefficient.value) for coefficient in self.constants]
        old_functions = [coefficient.x.array.copy() for coefficient in self.functions]
        yield
        for is_changed, old_values, new_values in (
            (
                self.changed_constants,
                old_constants,
                [coefficient.value for coefficient in self.constants],
            ),
            (
                self.changed_functions,
                old_functions,
                [coefficient.x.array for coefficient in self.functions],
            ),
        ):
            differs = [
                not np.array_equal(*values) for values in zip(old_values, new_values, strict=True)
            ]
            is_changed |= np.array(differs, dtype=bool)


@dataclass(frozen=True)
class ProblemFingerprint:
    """Fingerprint of a problem, with one entry for each named part of the problem.

    Args:
        parts: values that do not depend on the constants and functions of a residual, by the names
            of the parts.
        residual_fingerprint: fingerprint of the residual, its constants and its functions; None if
            the problem is defined by a stiffness matrix.
    """

    parts: FingerprintValues
    residual_fingerprint: "ResidualFingerprint | None" = None

    def evaluate_all_values(self) -> FingerprintValues:
        """Return all values that identify the problem in a file, by name; collective."""
        if self.residual_fingerprint is None:
            return self.parts
        values = self.residual_fingerprint.evaluate_coefficients()
        return self.parts | values | self.residual_fingerprint.evaluate_probed_residual(values)

    def raise_if_file_of_other_problem(
        self,
        path: Path,
        stored_values: Mapping[str, npt.NDArray],
        changed_parts: Collection[object],
    ) -> None:
        """Raise ValueError if a file contains the fingerprint of another problem; collective.

        Args:
            path: path of the file.
            stored_values: values that `evaluate_all_values` returned when the file was written. All
                processes have to pass the same values.
            changed_parts: parts that may differ. Each item is a name in
                `PARTS_DECLARABLE_AS_CHANGED`, or a constant or function object of the residual.
        """
        values, ignored = (
            dict(self.parts),
            {name for name in changed_parts if isinstance(name, str)},
        )
        if self.residual_fingerprint is not None:
            values |= self.residual_fingerprint.evaluate_coefficients()
            ignored |= self.residual_fingerprint.list_coefficients_that_may_differ(
                stored_values, changed_parts
            )
        stored_parts = {
            name: value for name, value in stored_values.items() if not name.startswith("residual")
        }
        for name in values | stored_parts:
            _raise_if_entry_differs(path, name, values.get(name), stored_values.get(name), ignored)
        if self.residual_fingerprint is None:
            return
        if "residual" not in ignored:
            for name, residual_values in self.residual_fingerprint.evaluate_probed_residual(
                stored_values
            ).items():
                note = _note_if_dolfinx_version_differs(stored_values)
                _raise_if_entry_differs(
                    path, name, residual_values, stored_values.get(name), ignored, note
                )
        self.residual_fingerprint.merge_changed_flags_from_file(stored_values)


def _raise_if_entry_differs(
    path: Path,
    name: str,
    values: npt.NDArray | None,
    stored_values: npt.NDArray | None,
    changed_names: Collection[str],
    note: str = "",
) -> None:
    """Raise ValueError if an entry of a fingerprint differs from that in the file and must not.

    Args:
        path: path of the file.
        name: name of the entry.
        values: values of this problem; None if the problem has no entry of this name.
        stored_values: values in the file; None if the file has no entry of this name.
        changed_names: names of parts, constants and functions that may differ.
        note: text at the end of the error message.
    """
    part = name.partition("#")[0]
    kind = part.partition(" of ")[0]
    if kind in ("changed", "version") or kind in changed_names:
        return
    refusal = f"{path} has the state of a problem with another {part}"
    refusal = refusal.replace("another supports", "other supports")
    if values is None or stored_values is None or values.shape != stored_values.shape:
        raise ValueError(refusal + note)
    is_coefficient = part.endswith(_RESIDUAL_COEFFICIENT_SUFFIX)
    if kind == "mean" or part in changed_names or (is_coefficient and "constants" in changed_names):
        return
    difference = _max_relative_row_difference(values, stored_values)
    if difference <= _RELATIVE_FINGERPRINT_ROUND_OFF:
        return
    amount = f"it differs by {difference:.2g} of its size"
    if values.size == 1:
        amount = f"it is {values.item():.10g} here, and {stored_values.item():.10g} in the file"
    if is_coefficient:
        note = (
            ". Set it to that value first; or, if it is a load and no property of the body, name "
            "it: load(path, changed=[...])"
        )
    elif kind in PARTS_DECLARABLE_AS_CHANGED:
        note += f". If the change is intended, name it: load(path, changed=[{kind!r}])"
    raise ValueError(f"{refusal}: {amount}{note}")


def check_parts_declared_as_changed(changed: object) -> None:
    """Raise TypeError or ValueError unless all items of `changed` are valid.

    Valid items are names in `PARTS_DECLARABLE_AS_CHANGED`, and objects of the types `fem.Constant`
    and `fem.Function`.
    """
    remedy = "give a list of names, constants and functions"
    arguments.check_type("changed", changed, (list, tuple, set, frozenset), remedy)
    assert isinstance(changed, Collection)
    for item in changed:
        kinds = (str, fem.Constant, fem.Function)
        arguments.check_type("an item of changed", item, kinds, remedy)
        if isinstance(item, str) and item not in PARTS_DECLARABLE_AS_CHANGED:
            raise ValueError(
                f"changed {item!r}: the names are {', '.join(PARTS_DECLARABLE_AS_CHANGED)}"
            )


def _max_relative_row_difference(values: npt.NDArray, stored: npt.NDArray) -> float:
    """Return the largest relative difference between corresponding rows of two arrays.

    The difference between two rows is divided by the size of the rows, but at least by 0.001 times
    the largest stored value.
    """
    rows, stored_rows = np.atleast_2d(values), np.atleast_2d(stored)
    min_scale = _MIN_ROW_SCALE_PER_LARGEST_VALUE * np.abs(
        stored_rows[np.isfinite(stored_rows)]
    ).max(initial=0.0)
    return max(
        max_relative_difference(*pair, min_scale) for pair in zip(rows, stored_rows, strict=True)
    )


def _note_if_dolfinx_version_differs(stored: Mapping[str, npt.NDArray]) -> str:
    """Return a note if the file was written with another version of DOLFINx, otherwise ""."""
    version = str(stored.get("version", ""))
    if version == dolfinx.__version__:
        return ""
    return (
        f". The file was written with DOLFINx {version}, this is {dolfinx.__version__}, which may "
        "estimate other quadrature degrees: state them in the measures"
    )


def fingerprint_mesh_supports_and_pairs(
    interface: ContactInterface,
    pairs: Sequence[ContactPair],
    states: Sequence[PairState],
    column_of_unknown: Indices,
    space: fem.FunctionSpace,
) -> FingerprintValues:
    """Return the fingerprint of mesh, spaces, supports and contact pairs; collective.

    Args:
        interface: the contact nodes of all pairs.
        pairs: contact pairs as given by the user.
        states: states of the pairs on the undeformed body.
        column_of_unknown: number (n,) of each unknown of this process among the free unknowns; -1
            for a prescribed unknown, and -2 for an unknown that is determined by other unknowns.
        space: space of the unknowns.
    """
    probes = _SmoothProbes(space)
    spaces = [body.space for field in probes.fields for body in list_bodies(field.space)]
    elements = [(V.element.basix_element, V.dofmap) for V in spaces]
    element_kinds = [(e.degree, int(e.family), dofmap.index_map_bs) for e, dofmap in elements]
    topologies = [body.space.mesh.topology for body in list_bodies(space)]
    n_cells = sum(topology.index_map(topology.dim).size_global for topology in topologies)
    supports = [
        probes.sum_products_with_probes((column_of_unknown == status).astype(float))
        for status in (-1, -2)
    ]
    numbers: FingerprintValues = {
        "mesh": np.array([n_cells, topologies[0].dim], dtype=float),
        "element": np.array(element_kinds, dtype=float),
        "supports": np.ravel(supports),
    }
    positions = probes.fields[0].space.tabulate_dof_coordinates()
    owned = positions[
        : probes.fields[0].space.dofmap.index_map.size_local, : space.mesh.geometry.dim
    ]
    size = max(np.abs(state.position).max() for state in states)
    for k, (pair, state) in enumerate(zip(pairs, states, strict=True)):
        facing = np.concatenate([state.opposite_node, state.faced_node[state.faced_node >= 0]])
        spin = np.concatenate(
            [part.ravel() for part in pair.pivot_and_spin_matrix(space.mesh.geometry.dim)]
        )
        pair_numbers = {
            "surface": np.concatenate([state.gap / size, state.normal.ravel()]),
            "surface#probes": sample_surface_around_pair(interface, k, interface.surfaces[k]),
            "friction": state.friction,
            "friction#probes": sample_friction_coefficients(interface, k, pair),
            "pivot": spin,
            "interference": sample_interference(interface, k, pair),
            "opposite side": gather_nodal_values(probes.fields[0].space, facing, owned).ravel(),
        }
        if interface.laws is not None:
            pair_numbers["interface law"] = interface.laws.sample_responses(k)
        for name, values in pair_numbers.items():
            status, separator, suffix = name.partition("#")
            numbers[f"{status} of contact pair {k}{separator}{suffix}"] = values
    return numbers


def fingerprint_stiffness(K: PETSc.Mat, space: fem.FunctionSpace) -> FingerprintValues:
    """Return sums of smooth weights times a stiffness (n, n) times smooth unknowns; collective.

    Displacements and pressures have separate sums, since their units differ.
    """
    probes, image = _SmoothProbes(space), K.createVecLeft()
    numbers = {}
    for column_field, vectors in enumerate(probes.vectors):
        forces = []
        for values in vectors:
            vector = K.createVecRight()
            vector.setArray(values)
            K.mult(vector, image)
            forces.append(probes.sum_products_with_probes(image.array_r))
        for row_field in range(len(probes.fields)):
            numbers[f"stiffness#{row_field}{column_field}"] = np.array(forces)[:, row_field]
    return numbers


class ResidualFingerprint:
    """Fingerprint of a residual: values of the residual at smooth unknowns, and its coefficients.

    Args:
        system: compiled residual, with its unknown function.
        coefficients: constants and functions of the residual.
    """

    def __init__(
        self, system: ResidualSystem | JoinedResidualSystem, coefficients: ResidualCoefficients
    ) -> None:
        self._system, self._coefficients = system, coefficients
        self._space: fem.FunctionSpace = system.u.function_space

    def evaluate_coefficients(self) -> FingerprintValues:
        """Return values of constants, and means and sums of functions, by name; collective.

        The entries "changed#constants" and "changed#functions" say which of them loads have
        changed.
        """
        coefficients, comm = self._coefficients, self._space.mesh.comm
        numbers: FingerprintValues = {"version": np.array(dolfinx.__version__)}
        for number, constant in enumerate(coefficients.constants):
            numbers[f"constant {number}{_RESIDUAL_COEFFICIENT_SUFFIX}"] = np.array(
                constant.value, dtype=float
            ).ravel()
        for number, function in enumerate(coefficients.functions):
            numbers[f"function {number}{_RESIDUAL_COEFFICIENT_SUFFIX}"] = (
                _sums_that_identify_function(function)
            )
        for number, function in enumerate([*coefficients.functions, *coefficients.history]):
            numbers[f"mean of function {number}"] = _mean_of_nodal_values(function)
        changed_functions = coefficients.changed_functions.copy()
        comm.Allreduce(MPI.IN_PLACE, changed_functions, MPI.LOR)
        numbers["changed#constants"] = coefficients.changed_constants.copy()
        numbers["changed#functions"] = changed_functions
        return numbers

    def evaluate_probed_residual(
        self, coefficient_values: Mapping[str, npt.NDArray]
    ) -> FingerprintValues:
        """Return sums of smooth weights times the residual at smooth unknowns; collective.

        Args:
            coefficient_values: result of `evaluate_coefficients` for this problem, or from a file.
                While the residual is evaluated, constants are set to these values and functions to
                these means.
        """
        coefficients, u, probes = self._coefficients, self._system.u, _SmoothProbes(self._space)
        constants = [
            (
                constant.value,
                coefficient_values[f"constant {number}{_RESIDUAL_COEFFICIENT_SUFFIX}"].reshape(
                    constant.value.shape
                ),
            )
            for number, constant in enumerate(coefficients.constants)
        ]
        functions = []
        for number, function in enumerate([*coefficients.functions, *coefficients.history]):
            mean = coefficient_values[f"mean of function {number}"]
            functions.append((function.x.array.reshape(-1, mean.size), mean))
        sums = []
        with _set_arrays_temporarily([*constants, *functions, (u.x.array, 0.0)]):
            vector = self._system.assemble_residual()
            sums.append(probes.sum_products_with_probes(vector.array_r))
            for unknowns in probes.make_small_smooth_unknowns():
                vector.setArray(unknowns)
                self._system.set_unknowns(vector)
                sums.append(
                    probes.sum_products_with_probes(self._system.assemble_residual().array_r)
                    - sums[0]
                )
        return {
            f"residual#{field}": np.array(sums)[:, field] for field in range(len(probes.fields))
        }

    def list_coefficients_that_may_differ(
        self, stored: Mapping[str, npt.NDArray], changed: Collection[object]
    ) -> set[str]:
        """Return the names of constants and functions that may differ from those of a file.

        These are the ones that loads have changed, here or in the file, and those in `changed`.

        Args:
            stored: fingerprint of the file.
            changed: constants and functions that the user has declared as changed.
        """
        coefficients, names = self._coefficients, set()
        for kind, items in (
            ("constant", coefficients.constants),
            ("function", coefficients.functions),
        ):
            is_changed = getattr(coefficients, f"changed_{kind}s") | _read_changed_flags(
                stored, f"{kind}s", len(items)
            )
            names |= {
                f"{kind} {number}{_RESIDUAL_COEFFICIENT_SUFFIX}"
                for number, item in enumerate(items)
                if is_changed[number] or any(item is declared for declared in changed)
            }
        return names

    def merge_changed_flags_from_file(self, stored: Mapping[str, npt.NDArray]) -> None:
        """Mark constants and functions as changed by loads if a file marks them as changed."""
        coefficients = self._coefficients
        coefficients.changed_constants |= _read_changed_flags(
            stored, "constants", len(coefficients.constants)
        )
        coefficients.changed_functions |= _read_changed_flags(
            stored, "functions", len(coefficients.functions)
        )


def _read_changed_flags(
    stored: Mapping[str, npt.NDArray], name: str, count: int
) -> npt.NDArray[np.bool_]:
    """Return the flags "changed#<name>" (count,) of a file; all False if the file has none."""
    flags = stored.get(f"changed#{name}", np.empty(0))
    return flags.astype(bool) if flags.shape == (count,) else np.zeros(count, dtype=bool)


class _SmoothProbes:
    """Vectors of all unknowns of a space that are smooth functions of position."""

    def __init__(self, space: fem.FunctionSpace) -> None:
        self.comm: MPI.Comm = space.mesh.comm
        self.fields: list[SubSpace] = list_fields(space)
        self.vectors = [
            [field.embed(v) for v in _evaluate_smooth_probes(field.space)] for field in self.fields
        ]

    def sum_products_with_probes(self, values: Array) -> Array:
        """Return sums (fields, probes) of values (n,) times each probe; collective."""
        sums = np.array([[np.dot(v, values) for v in vectors] for vectors in self.vectors])
        self.comm.Allreduce(MPI.IN_PLACE, sums, MPI.SUM)
        return sums

    def make_small_smooth_unknowns(self) -> list[Array]:
        """Return vectors (n,) of unknowns, each of which is nonzero in one field only.

        The displacements are so small that no cell is inverted.
        """
        _, diagonal = _bounding_box_corner_and_diagonal(self.fields[0].space)
        sizes = [_PROBE_DISPLACEMENT_PER_DIAGONAL * diagonal, 1.0]
        sizes_and_vectors = zip(sizes, self.vectors, strict=False)
        return [size * v for size, vectors in sizes_and_vectors for v in vectors[1:]]


def _bounding_box_corner_and_diagonal(space: fem.FunctionSpace) -> tuple[Array, float]:
    """Return the lower corner (3,) and the diagonal's length of the body's bounding box."""
    x, comm = space.mesh.geometry.x, space.mesh.comm
    ends = np.stack([x.min(axis=0, initial=np.inf), -x.max(axis=0, initial=-np.inf)])
    comm.Allreduce(MPI.IN_PLACE, ends, MPI.MIN)
    return ends[0], float(np.linalg.norm(ends.sum(axis=0)))


def _evaluate_smooth_probes(space: fem.FunctionSpace) -> list[Array]:
    """Return the values (owned unknowns,) of each smooth probe of a space.

    The components of a vector have different values in a probe.
    """
    lower, diagonal = _bounding_box_corner_and_diagonal(space)
    owned, block = space.dofmap.index_map.size_local, space.dofmap.index_map_bs
    x = (space.tabulate_dof_coordinates()[:owned] - lower) / diagonal
    component = np.arange(block)
    return [
        np.cos((x @ phase_change)[:, None] + first_phase + 0.7 * component).ravel()
        for phase_change, first_phase in zip(
            _COSINE_PROBE_PHASE_CHANGES, _COSINE_PROBE_START_PHASES, strict=True
        )
    ]


def _owned_nodal_values(function: fem.Function) -> Array:
    """Return the values (owned nodes, block) of a function at the nodes of this process."""
    dofmap = function.function_space.dofmap
    owned, block = dofmap.index_map.size_local, dofmap.index_map_bs
    return np.asarray(function.x.array[: owned * block].reshape(owned, block))


def _mean_of_nodal_values(function: fem.Function) -> Array:
    """Return the mean (block,) of a function's values on all processes; collective."""
    values, comm = _owned_nodal_values(function), function.function_space.mesh.comm
    total = np.append(values.sum(axis=0), float(len(values)))
    comm.Allreduce(MPI.IN_PLACE, total, MPI.SUM)
    return np.asarray(total[:-1] / max(total[-1], 1.0))


def _sums_that_identify_function(function: fem.Function) -> Array:
    """Return sums of a function's values, of their squares, and of values times smooth probes.

    The sums extend over all processes, so that the function is collective.
    """
    space, values = function.function_space, _owned_nodal_values(function).ravel()
    sums = [values.sum(), np.linalg.norm(values) ** 2]
    try:
        sums += [np.dot(values, probe) for probe in _evaluate_smooth_probes(space)]
    except RuntimeError:  # values that belong to no points, such as those of a mixed space
        sums += [0.0] * len(_COSINE_PROBE_PHASE_CHANGES)
    total = np.array(sums)
    space.mesh.comm.Allreduce(MPI.IN_PLACE, total, MPI.SUM)
    return total


@contextmanager
def _set_arrays_temporarily(
    arrays_and_values: Sequence[tuple[npt.NDArray, npt.NDArray | float]],
) -> Iterator[None]:
    """Set arrays to values within a `with` block, and restore them afterwards."""
    old_values = [array.copy() for array, _ in arrays_and_values]
    try:
        for array, values in arrays_and_values:
            array[...] = values
        yield
    finally:
        for (array, _), values in zip(arrays_and_values, old_values, strict=True):
            array[...] = values
