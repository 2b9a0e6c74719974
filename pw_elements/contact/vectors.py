"""Unit vectors of rigid surfaces."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from pw_elements.values import vector

Points = npt.NDArray[np.float64]


def unit(direction: Sequence[float]) -> npt.NDArray[np.float64]:
    """The unit vector (dim,) along a direction.

    Raises:
        ValueError: if it is no vector of a finite length.
    """
    along = vector("direction", direction)
    length = np.linalg.norm(along)
    if not (np.isfinite(length) and length > 0):
        raise ValueError(f"direction {list(direction)}: needs a finite length")
    return along / length


def normalised(vectors: Points) -> Points:
    """Unit vectors (n, dim) along vectors.

    Raises:
        ValueError: if one has no length.
    """
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    if not length.all():
        raise ValueError("the normal of a surface is not defined at a contact node")
    return vectors / length


def quarter_turned(vectors: Points) -> Points:
    """Unit vectors a quarter turn to the left, (n, 2)."""
    return normalised(np.column_stack((-vectors[:, 1], vectors[:, 0])))
