"""Checks of the values in a state's file, as of arguments.

A digest shows that a file has been damaged. Whoever changes a file on purpose can write another
digest, so that values are looked at, too: of the right type and shape, real, finite, in range, and
none that contradicts another.
"""

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np
import numpy.typing as npt

from pw_elements.checks import arguments
from pw_elements.contact.model import (
    ContactPair,
    ContactState,
    PairState,
    Residuals,
    Scale,
    Smallness,
)
from pw_elements.contact.nodes import HELD, OPEN, SLIP, STICK
from pw_elements.solvers import SolverReport

# Largest difference of displacements of one node, over the largest
_SAME_DISPLACEMENT = 1e-9
# Difference of the length of a unit vector from one
_UNIT = 1e-6
_LARGEST_COUNT = 2**62


def check_numbers(numbers: Any, dim: int) -> None:  # noqa: ANN401
    """Raise ValueError unless plain numbers are those of a state.

    Args:
        numbers: of the file: of `iterations`, `unique`, `increment`, `free_motions`, `residuals`
            and so on.
        dim: of space.
    """
    for name in ("iterations", "increment", "pairs"):
        _check_count(name, numbers[name])
    if not (numbers["unique"] is None or isinstance(numbers["unique"], bool)):
        raise ValueError(f"unique is {numbers['unique']!r}: it is true, false or unknown")
    if not set(_list("orientations", numbers["orientations"])) <= {-1, 0, 1}:
        raise ValueError(f"orientations {numbers['orientations']}: they are signs")
    free = [
        tuple(_list("a free component", one))
        for one in _list("free_motions", numbers["free_motions"])
    ]
    for one in free:
        whole = len(one) == 2 and all(isinstance(k, int) for k in one)
        if not whole or not (0 <= one[0] < numbers["pairs"] and 0 <= one[1] <= dim):
            raise ValueError(
                f"free_motions has {list(one)}, which is no component of a pair's surface"
            )
    if len(set(free)) < len(free):
        raise ValueError("free_motions names a component twice")
    for name, kind in (("residuals", Residuals), ("allowance", Residuals), ("scale", Scale)):
        _check_sizes(name, numbers[name], kind)
    if numbers["smallness"] is not None:
        _check_sizes("smallness", numbers["smallness"], Smallness)
    report = _mapping("report", numbers["report"], SolverReport)
    arguments.check_type("the method of the report", report["method"], str, "it is a name")
    for name in ("factorisations", "krylov_iterations"):
        _check_count(name, report[name])


def check_arrays(arrays: Mapping[str, npt.NDArray], plain: Sequence[str]) -> None:
    """Raise ValueError for arrays of anything but real numbers, but for `plain` ones, of text."""
    for name, values in arrays.items():
        if name not in plain and values.dtype.kind not in "fiub":
            raise ValueError(f"{name} is of the type {values.dtype}: its numbers are real")


def check_pairs(
    pairs: Sequence[Mapping[str, npt.NDArray]],
    own: ContactState,
    stated: Sequence[ContactPair],
    numbers: Mapping[str, Any],
    displacement: npt.NDArray,
    largest: Scale,
) -> None:
    """Raise ValueError unless the results of pairs are those of a problem's contact nodes.

    Args:
        pairs: values of the fields of `PairState`, with the global node numbers of today.
        own: undeformed state of the problem.
        stated: the problem's pairs.
        numbers: that `check_numbers` has let pass.
        displacement: (nodes, dim), by global numbers.
        largest: force and length beyond which nothing is believed.
    """
    dim = displacement.shape[1]
    for pair, axis in numbers["free_motions"]:
        if axis == dim and stated[pair].pivot is None:
            raise ValueError(f"the surface of contact pair {pair} is free to turn, without a pivot")
    scale = Scale(**numbers["scale"])
    check_size("the scale of forces", scale.force, largest.force)
    check_size("the scale of lengths", scale.length, largest.length)
    check_size("a displacement", np.abs(displacement).max(initial=0.0), largest.length)
    if not numbers["increment"] and np.any(displacement != 0):
        raise ValueError("an undeformed body has displacements")
    for k, (values, expected) in enumerate(zip(pairs, own.pairs, strict=True)):
        try:
            _check_pair(values, expected, displacement, largest)
        except ValueError as wrong:
            raise ValueError(f"contact pair {k}: {wrong}") from None


def _check_pair(
    values: Mapping[str, npt.NDArray], own: PairState, displacement: npt.NDArray, largest: Scale
) -> None:
    for name, expected in vars(own).items():
        array = values[name]
        if array.shape != expected.shape or array.dtype != expected.dtype:
            raise ValueError(
                f"{name} has the shape {array.shape} and the type {array.dtype}, not "
                f"{expected.shape} and {expected.dtype}"
            )
        finite = ~np.isnan(array) if name == "gap" else np.isfinite(array)
        if not finite.all():
            raise ValueError(f"{name} has values that are not finite")
    for name in ("node", "faced_node", "opposite_node"):
        if not np.array_equal(np.sort(values[name]), np.sort(getattr(own, name))):
            raise ValueError(f"{name} has numbers of other nodes")
    if not np.isin(values["status"], (OPEN, STICK, SLIP, HELD)).all():
        raise ValueError(f"status has {np.unique(values['status']).tolist()}: it is 0, 1, 2 or 3")
    if (values["friction"] < 0).any():
        raise ValueError("friction is negative")
    if not (np.abs(np.linalg.norm(values["normal"], axis=1) - 1) < _UNIT).all():
        raise ValueError("normal has vectors of other lengths than one")
    for name in ("force_normal", "force_tangential", "opposite_force"):
        check_size(name, np.abs(values[name]).max(initial=0.0), largest.force)
    for name in ("slip", "path_slip", "translation"):
        check_size(name, np.abs(values[name]).max(initial=0.0), largest.length)
    # a deformable surface moves by weighted means of many nodes
    alone = values["faced_node"] >= -1
    node, faced = values["node"][alone], values["faced_node"][alone, None]
    moved = displacement[node] - np.where(faced >= 0, displacement[faced[:, 0]], 0.0)
    size = np.abs(displacement).max(initial=0.0)
    apart = np.abs(values["displacement"][alone] - moved).max(initial=0.0)
    if apart > _SAME_DISPLACEMENT * size:
        raise ValueError("displacement is another one than that of the body's nodes")


def check_size(name: str, size: float, largest: float) -> None:
    """Raise ValueError for a size above the largest one that a problem can have."""
    if not size <= largest:
        raise ValueError(f"{name} is {size:.3g}, more than {largest:.3g}, which no state has")


def _check_count(name: str, value: object) -> None:
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < _LARGEST_COUNT:
        raise ValueError(f"{name} is {value!r}: it counts something")


def _list(name: str, value: object) -> list[Any]:
    arguments.check_type(name, value, list, "it is a list")
    assert isinstance(value, list)
    return value


def _mapping(name: str, value: object, kind: type) -> dict[str, Any]:
    names = [one.name for one in fields(kind)]
    if not isinstance(value, dict) or sorted(value) != sorted(names):
        raise ValueError(f"{name} has not the parts {', '.join(names)}")
    return value


def _check_sizes(name: str, value: object, kind: type) -> None:
    for part, number in _mapping(name, value, kind).items():
        if arguments.check_number(f"{part} of {name}", number) < 0:
            raise ValueError(f"{part} of {name} is {number}: it is not negative")
