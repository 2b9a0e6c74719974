"""Numbers as users give them: real, finite and in range, of whatever type they are."""

from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def is_number(value: Any) -> bool:  # noqa: ANN401
    """Whether a value is one real number, a 0-d array being one, too: no truth value, no text."""
    if isinstance(value, bool):
        return False
    plain = isinstance(value, int | float | np.number | np.ndarray)
    return plain and np.ndim(value) == 0 and np.asarray(value).dtype.kind in "iuf"


def number(name: str, value: Any) -> float:  # noqa: ANN401
    """A number that is finite.

    Raises:
        ValueError: for anything else.
    """
    if not (is_number(value) and np.isfinite(value)):
        raise ValueError(f"{name} = {value!r}: has to be a finite number")
    return float(value)


def positive(name: str, value: Any) -> float:  # noqa: ANN401
    """A finite number above zero.

    Raises:
        ValueError: for anything else.
    """
    if not number(name, value) > 0:
        raise ValueError(f"{name} = {value!r}: has to be positive")
    return float(value)


def whole(name: str, value: Any, least: int) -> int:  # noqa: ANN401
    """A whole number of an integer type, `least` at least.

    Raises:
        ValueError: for anything else.
    """
    if not (is_number(value) and np.asarray(value).dtype.kind in "iu" and value >= least):
        raise ValueError(f"{name} = {value!r}: has to be a whole number, {least} at least")
    return int(value)


def vector(name: str, values: Any, length: int | None = None) -> Array:  # noqa: ANN401
    """Finite numbers (length,), or as many as there are.

    Raises:
        ValueError: for anything else.
    """
    try:
        each = list(values)
    except TypeError:
        each = []
    finite = all(is_number(one) and np.isfinite(one) for one in each)
    if not (each and finite and len(each) == (length or len(each))):
        count = f"{length} finite" if length else "finite"
        raise ValueError(f"{name} {values!r}: it needs {count} components")
    return np.array(each, dtype=float)


def field(whose: str, values: Any, shape: tuple[int, ...], layout: str) -> Array:  # noqa: ANN401
    """What a user's function gives at points, NaN and infinity included.

    Args:
        whose: the function, by name.
        values: what it gave.
        shape: what it has to have, the number of points first.
        layout: of its points and of what it gives, in words.

    Raises:
        ValueError: for another shape, or what are no real numbers.
    """
    given = np.asarray(values)
    if given.shape != shape or given.dtype.kind not in "iuf":
        raise ValueError(
            f"{whose} gave {given.dtype} of the shape {given.shape} for {shape[0]} points: {layout}"
        )
    return given.astype(float)
