"""Graded mesh lines; needs no DOLFINx."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

# Sides of the bodies, which have the exact displacements, and growth of cells towards them;
# lengths over the contact's radius
OUTER, GROWTH = 2.5, 1.6
ZONE = 1.2  # nodes that may touch a sphere
# Where the contact's edge lies in an element, as a part of it: nowhere in particular
PLACE = 0.375


def growing(smallest: float, length: float, growth: float) -> Array:
    """Mesh lines from 0 to the length, elements growing from about the smallest by a factor."""
    count = int(np.ceil(np.log1p(length / smallest * (growth - 1)) / np.log(growth)))
    lines = np.concatenate([[0.0], np.cumsum(growth ** np.arange(count))])
    return length * lines / lines[-1]


@dataclass(frozen=True)
class Lines:
    """Mesh lines of a body under a sphere.

    Args:
        beside: from the axis outwards.
        below: up to the surface z = 0.
        zone: distance of the line up to which nodes may touch.
    """

    beside: Array
    below: Array
    zone: float


def graded(elements: float) -> Lines:
    """Lines with some `elements` along the contact's radius."""
    size = 1 / (elements + PLACE)
    near = size * np.arange(np.ceil(ZONE / size) + 1)
    far = near[-1] + growing(size, OUTER - near[-1], GROWTH)[1:]
    return Lines(np.concatenate([near, far]), depths(size), float(near[-1]))


def depths(size: float) -> Array:
    """Mesh lines up to the surface, the last element of a size."""
    return -growing(size, OUTER, GROWTH)[::-1]
