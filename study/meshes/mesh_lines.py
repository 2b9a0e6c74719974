"""Graded mesh lines, computed without DOLFINx."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

# Distance of the far sides, on which exact displacements are prescribed, and growth factor of the
# cells towards them; all lengths are relative to the contact radius
BODY_SIZE, GROWTH = 2.5, 1.6
CONTACT_ZONE_SIZE = 1.2  # distance within which nodes may touch a sphere
# Position of the contact's edge within an element, relative to the size of the element; arbitrary
CONTACT_EDGE_POSITION = 0.375


def growing_lines(min_size: float, length: float, growth: float) -> Array:
    """Return mesh lines from 0 to `length`; sizes grow geometrically from at most `min_size`."""
    count = int(np.ceil(np.log1p(length / min_size * (growth - 1)) / np.log(growth)))
    lines = np.concatenate([[0.0], np.cumsum(growth ** np.arange(count))])
    return length * lines / lines[-1]


@dataclass(frozen=True)
class BodyMeshLines:
    """Mesh lines of a body under a sphere.

    Args:
        horizontal: Positions of the lines from the axis outwards.
        vertical: Positions of the lines up to the surface z = 0.
        contact_zone_size: Distance from the axis within which nodes may touch the sphere.
    """

    horizontal: Array
    vertical: Array
    contact_zone_size: float


def graded_body_lines(elements_per_radius: float) -> BodyMeshLines:
    """Return the mesh lines for a number of elements along the contact radius."""
    size = 1 / (elements_per_radius + CONTACT_EDGE_POSITION)
    near = size * np.arange(np.ceil(CONTACT_ZONE_SIZE / size) + 1)
    far = near[-1] + growing_lines(size, BODY_SIZE - near[-1], GROWTH)[1:]
    return BodyMeshLines(np.concatenate([near, far]), depth_lines(size), float(near[-1]))


def depth_lines(surface_size: float) -> Array:
    """Return mesh lines up to the surface, where the element size is at most `surface_size`."""
    return -growing_lines(surface_size, BODY_SIZE, GROWTH)[::-1]
