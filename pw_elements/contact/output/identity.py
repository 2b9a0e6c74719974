"""What tells a problem from others: numbers that its form, surfaces and laws give at fixed places.

They are compared with a tolerance: neither the partition enters, nor the signatures of forms, which
differ between versions of UFL. Loads, prescribed values and motions are none of them, for they
change from step to step.

A form has fixed probes: sums, over all of its equations, of its values at smooth displacements
times smooth weights. Its constants and functions are compared by their values, but those which
loads have changed; the form itself then has the values of the file.
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
import ufl
from dolfinx import fem

from pw_elements.algebra import ResidualSystem
from pw_elements.arrays import Array, Indices
from pw_elements.checks import arguments, relative_difference
from pw_elements.contact.interface import (
    Interface,
    probe_friction,
    probe_interference,
    probe_surface,
)
from pw_elements.contact.model import ContactPair, PairState
from pw_elements.spaces import SubSpace, gather_from_owners, list_fields

# Difference of numbers, over the largest of their part, that may be round-off
_ROUND_OFF = 1e-8
# Probes: angles over the body along each axis, and of each one at the lower corner
_ANGLES = 2 * np.pi * np.array([[0.31, 0.17, 0.23], [0.83, -0.57, 0.41], [-0.47, 1.13, 0.89]])
_FIRST_ANGLES = np.array([0.4, 1.1, 2.3])
# Size of probing displacements over the body's diagonal: strains of some per cent
_PROBING_DISPLACEMENT = 0.005
# Parts of a problem that may be named as changed
CHANGEABLE = (
    *("constants", "friction", "interference", "pivot"),
    *("residual", "stiffness", "supports", "surface"),
)
_OF_RESIDUAL = " of the residual"
# Size of one row of numbers, over that of all, below which it is round-off of sums
_LEAST_ROW = 1e-3

Numbers = dict[str, npt.NDArray]


@dataclass
class Coefficients:
    """Constants and functions of a residual, but its unknown and its history.

    Args:
        constants: in the order in which they were made.
        functions: likewise.
        history: functions whose values belong to a state.
        changed_constants: whether a load, or what a state was loaded with, has changed each.
        changed_functions: likewise, by their values on this process.
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
    def from_form(
        cls, form: ufl.Form, u: fem.Function, history: Sequence[fem.Function]
    ) -> "Coefficients":
        others = [f for f in form.coefficients() if isinstance(f, fem.Function) and f is not u]
        kept = [f for f in others if any(f is one for one in history)]
        return cls(list(form.constants()), [f for f in others if f not in kept], kept)

    @contextmanager
    def note_changes(self) -> Iterator[None]:
        """Note which of them change in a block, which is a load's."""
        constants = [np.array(one.value) for one in self.constants]
        functions = [one.x.array.copy() for one in self.functions]
        yield
        for changed, before, arrays in (
            (self.changed_constants, constants, [one.value for one in self.constants]),
            (self.changed_functions, functions, [one.x.array for one in self.functions]),
        ):
            differ = [not np.array_equal(*both) for both in zip(before, arrays, strict=True)]
            changed |= np.array(differ, dtype=bool)


@dataclass(frozen=True)
class Identity:
    """The numbers of a problem, by the names of its parts.

    Args:
        parts: numbers that do not depend on constants and functions of a residual.
        residual: what does, None with a stiffness.
    """

    parts: Numbers
    residual: "ResidualProbe | None" = None

    def numbers(self) -> Numbers:
        """Return all that a file needs to tell the problem from others; collective."""
        if self.residual is None:
            return self.parts
        coefficients = self.residual.coefficients()
        return self.parts | coefficients | self.residual.evaluate(coefficients)

    def refuse_another(
        self, path: Path, stored: Mapping[str, npt.NDArray], changed: Collection[object]
    ) -> None:
        """Raise ValueError unless a file's numbers are this problem's; collective.

        Args:
            path: of the file.
            stored: what `numbers` gave when it was written, on all processes.
            changed: names of `CHANGEABLE` parts, constants and functions that may differ.
        """
        own, names = dict(self.parts), {one for one in changed if isinstance(one, str)}
        if self.residual is not None:
            own |= self.residual.coefficients()
            names |= self.residual.names_of_changed(stored, changed)
        others = {k: v for k, v in stored.items() if not k.startswith("residual")}
        for name in own | others:
            _compare(path, name, own.get(name), stored.get(name), names)
        if self.residual is None:
            return
        if "residual" not in names:
            for name, values in self.residual.evaluate(stored).items():
                _compare(path, name, values, stored.get(name), names, _said_of_versions(stored))
        self.residual.take_changed(stored)


def _compare(
    path: Path,
    name: str,
    values: npt.NDArray | None,
    stored: npt.NDArray | None,
    changed: Collection[str],
    more: str = "",
) -> None:
    """Raise ValueError, with `more` words, where numbers differ from a file's and must not."""
    words, kind = name.partition("#")[0], name.partition("#")[0].partition(" of ")[0]
    if kind in ("changed", "version") or kind in changed:
        return
    problem = f"{path} has the state of a problem with another {words}"
    problem = problem.replace("another supports", "other supports")
    if values is None or stored is None or values.shape != stored.shape:
        raise ValueError(problem + more)
    coefficient = words.endswith(_OF_RESIDUAL)
    if kind == "mean" or words in changed or (coefficient and "constants" in changed):
        return
    difference = _difference(values, stored)
    if difference <= _ROUND_OFF:
        return
    size = f"it differs by {difference:.2g} of its size"
    if values.size == 1:
        size = f"it is {values.item():.10g} here, and {stored.item():.10g} in the file"
    if coefficient:
        more = (
            ". Set it to that value first, or name it, load(path, changed=[...]), if it is no "
            "property of the body but a load"
        )
    elif kind in CHANGEABLE:
        more += f". If that is meant, name it: load(path, changed=[{kind!r}])"
    raise ValueError(f"{problem}: {size}{more}")


def check_changed(changed: object) -> None:
    """Raise TypeError or ValueError for anything but things that `refuse_another` takes."""
    remedy = "give a list of names, constants and functions"
    arguments.check_type("changed", changed, (list, tuple, set, frozenset), remedy)
    assert isinstance(changed, Collection)
    for one in changed:
        kinds = (str, fem.Constant, fem.Function)
        arguments.check_type("what has changed", one, kinds, remedy)
        if isinstance(one, str) and one not in CHANGEABLE:
            raise ValueError(f"changed {one!r}: the names are {', '.join(CHANGEABLE)}")


def _difference(values: npt.NDArray, stored: npt.NDArray) -> float:
    """Return the largest difference of any row over its size, or over a part of all rows'."""
    rows, others = np.atleast_2d(values), np.atleast_2d(stored)
    least = _LEAST_ROW * np.abs(others[np.isfinite(others)]).max(initial=0.0)
    return max(relative_difference(*both, least) for both in zip(rows, others, strict=True))


def _said_of_versions(stored: Mapping[str, npt.NDArray]) -> str:
    version = str(stored.get("version", ""))
    if version == dolfinx.__version__:
        return ""
    return (
        f". The file is one of DOLFINx {version}, and here is {dolfinx.__version__}, which may "
        "estimate other quadrature degrees: state them in the measures"
    )


def identify_problem(
    interface: Interface,
    pairs: Sequence[ContactPair],
    states: Sequence[PairState],
    column: Indices,
    space: fem.FunctionSpace,
) -> Numbers:
    """Return the numbers of mesh, spaces, supports and pairs; collective.

    Args:
        interface: of the pairs.
        pairs: as the user states them.
        states: of the undeformed body.
        column: (n,), of each unknown of this process: -1 where it is prescribed, -2 where others
            give it, else what it is among the free ones.
        space: of the unknowns.
    """
    probes, topology = _Probes(space), space.mesh.topology
    elements = [(one.space.element.basix_element, one.space.dofmap) for one in probes.fields]
    kinds = [(e.degree, int(e.family), dofmap.index_map_bs) for e, dofmap in elements]
    held = [probes.sums((column == kind).astype(float)) for kind in (-1, -2)]
    numbers: Numbers = {
        "mesh": np.array([topology.index_map(topology.dim).size_global, topology.dim], dtype=float),
        "element": np.array(kinds, dtype=float),
        "supports": np.ravel(held),
    }
    x = probes.fields[0].space.tabulate_dof_coordinates()
    owned = x[: probes.fields[0].space.dofmap.index_map.size_local, : space.mesh.geometry.dim]
    size = max(np.abs(state.position).max() for state in states)
    for k, (pair, state) in enumerate(zip(pairs, states, strict=True)):
        facing = np.concatenate([state.opposite_node, state.faced_node[state.faced_node >= 0]])
        spin = np.concatenate(
            [part.ravel() for part in pair.pivot_and_spin(space.mesh.geometry.dim)]
        )
        pair_numbers = {
            "surface": np.concatenate([state.gap / size, state.normal.ravel()]),
            "surface#probes": probe_surface(interface, k, interface.surfaces[k]),
            "friction": state.friction,
            "friction#probes": probe_friction(interface, k, pair),
            "pivot": spin,
            "interference": probe_interference(interface, k, pair),
            "opposite side": gather_from_owners(probes.fields[0].space, facing, owned).ravel(),
        }
        for name, values in pair_numbers.items():
            kind, mark, rest = name.partition("#")
            numbers[f"{kind} of contact pair {k}{mark}{rest}"] = values
    return numbers


def identify_stiffness(K: PETSc.Mat, space: fem.FunctionSpace) -> Numbers:
    """Return sums of smooth weights times a stiffness (n, n) times smooth unknowns; collective.

    Those of displacements and pressures are apart, since they have other units.
    """
    probes, image = _Probes(space), K.createVecLeft()
    numbers = {}
    for k, unknowns in enumerate(probes.vectors):
        forces = []
        for values in unknowns:
            moved = K.createVecRight()
            moved.setArray(values)
            K.mult(moved, image)
            forces.append(probes.sums(image.array_r))
        for row in range(len(probes.fields)):
            numbers[f"stiffness#{row}{k}"] = np.array(forces)[:, row]
    return numbers


class ResidualProbe:
    """A residual at probing unknowns, and the constants and functions that it has."""

    def __init__(self, system: ResidualSystem, coefficients: Coefficients) -> None:
        self._system, self._coefficients = system, coefficients
        self._space: fem.FunctionSpace = system.u.function_space

    def coefficients(self) -> Numbers:
        """Return the values of constants, means and sums of functions, by name; collective.

        Whether loads have changed each of them is told, too.
        """
        own, comm = self._coefficients, self._space.mesh.comm
        numbers: Numbers = {"version": np.array(dolfinx.__version__)}
        for k, constant in enumerate(own.constants):
            numbers[f"constant {k}{_OF_RESIDUAL}"] = np.array(constant.value, dtype=float).ravel()
        for k, function in enumerate(own.functions):
            numbers[f"function {k}{_OF_RESIDUAL}"] = _sums_of(function)
        for k, function in enumerate([*own.functions, *own.history]):
            numbers[f"mean of function {k}"] = _mean_of(function)
        changed_functions = own.changed_functions.copy()
        comm.Allreduce(MPI.IN_PLACE, changed_functions, MPI.LOR)
        numbers["changed#constants"] = own.changed_constants.copy()
        numbers["changed#functions"] = changed_functions
        return numbers

    def evaluate(self, values: Mapping[str, npt.NDArray]) -> Numbers:
        """Return sums of smooth weights times the residual at smooth unknowns; collective.

        Args:
            values: what `coefficients` gave, here or when a file was written: constants have their
                values from there meanwhile, functions their means.
        """
        own, u, probes = self._coefficients, self._system.u, _Probes(self._space)
        constants = [
            (constant.value, values[f"constant {k}{_OF_RESIDUAL}"].reshape(constant.value.shape))
            for k, constant in enumerate(own.constants)
        ]
        functions = []
        for k, function in enumerate([*own.functions, *own.history]):
            mean = values[f"mean of function {k}"]
            functions.append((function.x.array.reshape(-1, mean.size), mean))
        sums = []
        with _holding([*constants, *functions, (u.x.array, 0.0)]):
            vector = self._system.assemble_residual()
            sums.append(probes.sums(vector.array_r))
            for unknowns in probes.small_unknowns():
                vector.setArray(unknowns)
                self._system.set_unknowns(vector)
                sums.append(probes.sums(self._system.assemble_residual().array_r) - sums[0])
        return {f"residual#{row}": np.array(sums)[:, row] for row in range(len(probes.fields))}

    def names_of_changed(
        self, stored: Mapping[str, npt.NDArray], changed: Collection[object]
    ) -> set[str]:
        """Return the names of constants and functions that need not be what they were."""
        own, names = self._coefficients, set()
        for kind, things in (("constant", own.constants), ("function", own.functions)):
            flags = getattr(own, f"changed_{kind}s") | _flags(stored, f"{kind}s", len(things))
            names |= {
                f"{kind} {k}{_OF_RESIDUAL}"
                for k, thing in enumerate(things)
                if flags[k] or any(thing is one for one in changed)
            }
        return names

    def take_changed(self, stored: Mapping[str, npt.NDArray]) -> None:
        """Count as changed by loads what was so when a file was written."""
        own = self._coefficients
        own.changed_constants |= _flags(stored, "constants", len(own.constants))
        own.changed_functions |= _flags(stored, "functions", len(own.functions))


def _flags(stored: Mapping[str, npt.NDArray], name: str, count: int) -> npt.NDArray[np.bool_]:
    flags = stored.get(f"changed#{name}", np.empty(0))
    return flags.astype(bool) if flags.shape == (count,) else np.zeros(count, dtype=bool)


class _Probes:
    """Smooth functions of position, as vectors of all unknowns of a space."""

    def __init__(self, space: fem.FunctionSpace) -> None:
        self.comm: MPI.Comm = space.mesh.comm
        self.fields: list[SubSpace] = list_fields(space)
        self.vectors = [[one.embed(v) for v in _smooth(one.space)] for one in self.fields]

    def sums(self, values: Array) -> Array:
        """Return sums (fields, probes) of values (n,) times the probes, over all processes."""
        own = np.array([[np.dot(v, values) for v in vectors] for vectors in self.vectors])
        self.comm.Allreduce(MPI.IN_PLACE, own, MPI.SUM)
        return own

    def small_unknowns(self) -> list[Array]:
        """Return unknowns (n,) of one field each, displacements that turn no cell inside out."""
        _, diagonal = _box(self.fields[0].space)
        sizes = [_PROBING_DISPLACEMENT * diagonal, 1.0]
        each = zip(sizes, self.vectors, strict=False)
        return [size * v for size, vectors in each for v in vectors[1:]]


def _box(space: fem.FunctionSpace) -> tuple[Array, float]:
    """Return the lower corner (3,) of the body's box, and its diagonal."""
    x, comm = space.mesh.geometry.x, space.mesh.comm
    ends = np.stack([x.min(axis=0, initial=np.inf), -x.max(axis=0, initial=-np.inf)])
    comm.Allreduce(MPI.IN_PLACE, ends, MPI.MIN)
    return ends[0], float(np.linalg.norm(ends.sum(axis=0)))


def _smooth(space: fem.FunctionSpace) -> list[Array]:
    """Return values (owned unknowns,) of smooth functions, others for each component."""
    lower, diagonal = _box(space)
    owned, block = space.dofmap.index_map.size_local, space.dofmap.index_map_bs
    x = (space.tabulate_dof_coordinates()[:owned] - lower) / diagonal
    component = np.arange(block)
    return [
        np.cos((x @ angles)[:, None] + first + 0.7 * component).ravel()
        for angles, first in zip(_ANGLES, _FIRST_ANGLES, strict=True)
    ]


def _owned_values(function: fem.Function) -> Array:
    dofmap = function.function_space.dofmap
    owned, block = dofmap.index_map.size_local, dofmap.index_map_bs
    return np.asarray(function.x.array[: owned * block].reshape(owned, block))


def _mean_of(function: fem.Function) -> Array:
    """Return the mean (block,) of a function's values; collective."""
    values, comm = _owned_values(function), function.function_space.mesh.comm
    total = np.append(values.sum(axis=0), float(len(values)))
    comm.Allreduce(MPI.IN_PLACE, total, MPI.SUM)
    return np.asarray(total[:-1] / max(total[-1], 1.0))


def _sums_of(function: fem.Function) -> Array:
    """Return sums of a function's values, of their squares, and of values times probes."""
    space, values = function.function_space, _owned_values(function).ravel()
    sums = [values.sum(), np.linalg.norm(values) ** 2]
    try:
        sums += [np.dot(values, probe) for probe in _smooth(space)]
    except RuntimeError:  # of values that have no points, of a mixed space say
        sums += [0.0] * len(_ANGLES)
    own = np.array(sums)
    space.mesh.comm.Allreduce(MPI.IN_PLACE, own, MPI.SUM)
    return own


@contextmanager
def _holding(changes: Sequence[tuple[npt.NDArray, npt.NDArray | float]]) -> Iterator[None]:
    """Set arrays to values in a block, and back after it."""
    before = [array.copy() for array, _ in changes]
    try:
        for array, values in changes:
            array[...] = values
        yield
    finally:
        for (array, _), values in zip(changes, before, strict=True):
            array[...] = values
