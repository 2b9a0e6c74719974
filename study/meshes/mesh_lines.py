"""Graded mesh lines; needs no DOLFINx."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

# Distance of the far sides, with exact displacements, and growth of cells towards them; lengths
# are over the contact's radius
BODY_SIZE, GROWTH = 2.5, 1.6
CONTACT_ZONE_SIZE = 1.2  # distance within which nodes may touch a sphere
# Position of the contact's edge within an element, over the element's size; arbitrary
CONTACT_EDGE_POSITION = 0.375


def growing_lines(min_size: float, length: float, growth: float) -> Array:
    """Return mesh lines from 0 to a length; sizes grow by a factor from at most `min_size`."""
    count = int(np.ceil(np.log1p(length / min_size * (growth - 1)) / np.log(growth)))
    lines = np.concatenate([[0.0], np.cumsum(growth ** np.arange(count))])
    return length * lines / lines[-1]


@dataclass(frozen=True)
class BodyMeshLines:
    """Mesh lines of a body under a sphere.

    Args:
        horizontal: Lines from the axis outwards.
        vertical: Lines up to the surface z = 0.
        contact_zone_size: Distance within which nodes may touch.
    """

    horizontal: Array
    vertical: Array
    contact_zone_size: float


def graded_body_lines(elements_per_radius: float) -> BodyMeshLines:
    """Return the mesh lines for a number of elements along the contact's radius."""
    size = 1 / (elements_per_radius + CONTACT_EDGE_POSITION)
    near = size * np.arange(np.ceil(CONTACT_ZONE_SIZE / size) + 1)
    far = near[-1] + growing_lines(size, BODY_SIZE - near[-1], GROWTH)[1:]
    return BodyMeshLines(np.concatenate([near, far]), depth_lines(size), float(near[-1]))


def depth_lines(surface_size: float) -> Array:
    """Return mesh lines up to the surface, where elements have at most `surface_size`."""
    return -growing_lines(surface_size, BODY_SIZE, GROWTH)[::-1]
