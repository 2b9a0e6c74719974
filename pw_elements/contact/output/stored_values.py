"""Checks of the values in a state's file, which are treated like arguments of the user.

A digest shows whether a file has been damaged. However, someone who changes a file on purpose can
also write a new digest. Therefore the values themselves are checked: they must have the right type
and shape, be real, finite and in range, and not contradict each other. The module assumes that an
undeformed state of the problem is available for comparison.
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
    ResidualScale,
    SmallDisplacementMeasures,
)
from pw_elements.contact.nodes import HELD, OPEN, SLIP, STICK
from pw_elements.solvers import SolverReport

# Largest difference between two stored displacements of one node, relative to the largest
# displacement
_RELATIVE_DISPLACEMENT_MISMATCH_TOLERANCE = 1e-9
# Largest deviation of a unit vector's length from 1
_UNIT_VECTOR_LENGTH_TOLERANCE = 1e-6
_MAX_PLAUSIBLE_COUNT = 2**62


def check_stored_state_numbers(numbers: Any, dim: int) -> None:  # noqa: ANN401
    """Raise ValueError unless the numbers in a file can belong to a contact state.

    Args:
        numbers: numbers in the file, by the names of a state's attributes.
        dim: dimension of space.
    """
    for name in ("iterations", "increment", "pairs"):
        _check_nonnegative_integer(name, numbers[name])
    if not (numbers["unique"] is None or isinstance(numbers["unique"], bool)):
        raise ValueError(f"unique is {numbers['unique']!r}: it must be true, false or null")
    if not set(_check_list("determinant_signs", numbers["determinant_signs"])) <= {-1, 0, 1}:
        raise ValueError(
            f"determinant_signs {numbers['determinant_signs']}: they must be -1, 0 or 1"
        )
    free = [
        tuple(_check_list("a free component", component))
        for component in _check_list("free_motions", numbers["free_motions"])
    ]
    for component in free:
        is_valid = len(component) == 2 and all(isinstance(k, int) for k in component)
        if not is_valid or not (0 <= component[0] < numbers["pairs"] and 0 <= component[1] <= dim):
            raise ValueError(
                f"free_motions has {list(component)}, which is no motion of a pair's surface"
            )
    if len(set(free)) < len(free):
        raise ValueError("free_motions names a component twice")
    for name, kind in (
        ("residuals", Residuals),
        ("allowance", Residuals),
        ("scale", ResidualScale),
    ):
        _check_nonnegative_record(name, numbers[name], kind)
    if numbers["smallness"] is not None:
        _check_nonnegative_record("smallness", numbers["smallness"], SmallDisplacementMeasures)
    report = _check_field_names("report", numbers["report"], SolverReport)
    arguments.check_type("the method of the report", report["method"], str, "it must be a name")
    for name in ("factorisations", "krylov_iterations"):
        _check_nonnegative_integer(name, report[name])


def check_real_arrays(
    arrays: Mapping[str, npt.NDArray], names_of_text_arrays: Sequence[str]
) -> None:
    """Raise ValueError if an array does not consist of real numbers.

    Args:
        arrays: arrays by name.
        names_of_text_arrays: names of arrays that contain text and are not checked.
    """
    for name, values in arrays.items():
        if name not in names_of_text_arrays and values.dtype.kind not in "fiub":
            raise ValueError(f"{name} is of the type {values.dtype}: it must have real numbers")


def check_stored_pair_results(
    pairs: Sequence[Mapping[str, npt.NDArray]],
    undeformed_state: ContactState,
    contact_pairs: Sequence[ContactPair],
    numbers: Mapping[str, Any],
    displacement: npt.NDArray,
    max_scale: ResidualScale,
) -> None:
    """Raise ValueError unless the results of all pairs belong to the problem's contact nodes.

    Args:
        pairs: for each pair the values of the fields of `PairState`, with global node numbers of
            the present mesh.
        undeformed_state: undeformed state of the problem.
        contact_pairs: the problem's contact pairs.
        numbers: numbers in the file, checked by `check_stored_state_numbers`.
        displacement: displacements (nodes, dim) by global node numbers.
        max_scale: largest plausible force and length.
    """
    dim = displacement.shape[1]
    for pair, axis in numbers["free_motions"]:
        if axis == dim and contact_pairs[pair].pivot is None:
            raise ValueError(f"the surface of contact pair {pair} is free to turn, without a pivot")
    scale = ResidualScale(**numbers["scale"])
    check_plausible_size("the scale of forces", scale.force, max_scale.force)
    check_plausible_size("the scale of lengths", scale.length, max_scale.length)
    check_plausible_size("a displacement", np.abs(displacement).max(initial=0.0), max_scale.length)
    if not numbers["increment"] and np.any(displacement != 0):
        raise ValueError("an undeformed body has displacements")
    for k, (values, expected) in enumerate(zip(pairs, undeformed_state.pairs, strict=True)):
        try:
            _check_stored_pair(values, expected, displacement, max_scale)
        except ValueError as error:
            raise ValueError(f"contact pair {k}: {error}") from None


def _check_stored_pair(
    values: Mapping[str, npt.NDArray],
    undeformed: PairState,
    displacement: npt.NDArray,
    max_scale: ResidualScale,
) -> None:
    """Raise ValueError unless the results of one pair belong to its contact nodes.

    Args:
        values: values of the fields of `PairState`.
        undeformed: state of the pair on the undeformed body.
        displacement: displacements (nodes, dim) by global node numbers.
        max_scale: largest plausible force and length.
    """
    for name, expected in vars(undeformed).items():
        array = values[name]
        if array.shape != expected.shape or array.dtype != expected.dtype:
            raise ValueError(
                f"{name} has the shape {array.shape} and the type {array.dtype}, not "
                f"{expected.shape} and {expected.dtype}"
            )
        is_finite = ~np.isnan(array) if name == "gap" else np.isfinite(array)
        if not is_finite.all():
            raise ValueError(f"{name} has values that are not finite")
    for name in ("node", "faced_node", "opposite_node"):
        if not np.array_equal(np.sort(values[name]), np.sort(getattr(undeformed, name))):
            raise ValueError(f"{name} has numbers of other nodes than the pair's")
    if not np.isin(values["status"], (OPEN, STICK, SLIP, HELD)).all():
        raise ValueError(
            f"status has {np.unique(values['status']).tolist()}: it must be 0, 1, 2 or 3"
        )
    if (values["friction"] < 0).any():
        raise ValueError("friction is negative")
    if not (
        np.abs(np.linalg.norm(values["normal"], axis=1) - 1) < _UNIT_VECTOR_LENGTH_TOLERANCE
    ).all():
        raise ValueError("normal has vectors that are not of unit length")
    for name in ("force_normal", "force_tangential", "opposite_force"):
        check_plausible_size(name, np.abs(values[name]).max(initial=0.0), max_scale.force)
    for name in ("slip", "path_slip", "translation"):
        check_plausible_size(name, np.abs(values[name]).max(initial=0.0), max_scale.length)
    # nodes that face a deformable surface move relative to weighted means of many nodes
    faces_at_most_one_node = values["faced_node"] >= -1
    node, faced = (
        values["node"][faces_at_most_one_node],
        values["faced_node"][faces_at_most_one_node, None],
    )
    relative_displacement = displacement[node] - np.where(
        faced >= 0, displacement[faced[:, 0]], 0.0
    )
    max_displacement = np.abs(displacement).max(initial=0.0)
    difference = np.abs(values["displacement"][faces_at_most_one_node] - relative_displacement).max(
        initial=0.0
    )
    if difference > _RELATIVE_DISPLACEMENT_MISMATCH_TOLERANCE * max_displacement:
        raise ValueError("displacement differs from that of the body's nodes")


def check_plausible_size(name: str, size: float, max_size: float) -> None:
    """Raise ValueError if a size exceeds the largest plausible one."""
    if not size <= max_size:
        raise ValueError(f"{name} is {size:.3g}, more than {max_size:.3g}, which is not plausible")


def _check_nonnegative_integer(name: str, value: object) -> None:
    """Raise ValueError unless a value is a nonnegative integer of plausible size."""
    if (
        not isinstance(value, int)
        or isinstance(value, bool)
        or not 0 <= value < _MAX_PLAUSIBLE_COUNT
    ):
        raise ValueError(f"{name} is {value!r}: it must be a whole number >= 0")


def _check_list(name: str, value: object) -> list[Any]:
    """Return the value if it is a list; raise TypeError otherwise."""
    arguments.check_type(name, value, list, "it must be a list")
    assert isinstance(value, list)
    return value


def _check_field_names(name: str, value: object, record_type: type) -> dict[str, Any]:
    """Return the value if it is a dictionary whose keys are the fields of a dataclass.

    Otherwise ValueError is raised. The dataclass is `record_type`.
    """
    names = [field.name for field in fields(record_type)]
    if not isinstance(value, dict) or sorted(value) != sorted(names):
        raise ValueError(f"{name} does not have the fields {', '.join(names)}")
    return value


def _check_nonnegative_record(name: str, value: object, record_type: type) -> None:
    """Raise an error unless a value has nonnegative numbers for all fields of a dataclass."""
    for part, number in _check_field_names(name, value, record_type).items():
        if arguments.check_finite_number(f"{part} of {name}", number) < 0:
            raise ValueError(f"{part} of {name} is {number}: it must not be negative")
