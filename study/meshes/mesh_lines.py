"""Coordinates of graded mesh lines, computed without DOLFINx."""

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


def geometrically_growing_lines(min_size: float, length: float, growth: float) -> Array:
    """Return mesh lines from 0 to `length`, with element sizes in geometric progression.

    Args:
        min_size: Upper bound of the first element's size.
        length: Coordinate of the last line.
        growth: Ratio of the sizes of successive elements, greater than 1.
    """
    count = int(np.ceil(np.log1p(length / min_size * (growth - 1)) / np.log(growth)))
    lines = np.concatenate([[0.0], np.cumsum(growth ** np.arange(count))])
    return length * lines / lines[-1]


@dataclass(frozen=True)
class BodyMeshLines:
    """Mesh lines of an elastic body under a rigid sphere, in units of the contact radius.

    Args:
        horizontal: Positions of the lines from the axis outwards.
        vertical: Positions of the lines up to the surface z = 0.
        contact_zone_size: Distance from the axis within which nodes may touch the sphere.
    """

    horizontal: Array
    vertical: Array
    contact_zone_size: float


def mesh_lines_of_body_under_sphere(elements_per_radius: float) -> BodyMeshLines:
    """Return the mesh lines of a body for a number of elements along the contact radius.

    The contact's edge lies at the relative position `CONTACT_EDGE_POSITION` within an element.
    """
    size = 1 / (elements_per_radius + CONTACT_EDGE_POSITION)
    lines_in_contact_zone = size * np.arange(np.ceil(CONTACT_ZONE_SIZE / size) + 1)
    lines_outside_contact_zone = (
        lines_in_contact_zone[-1]
        + geometrically_growing_lines(size, BODY_SIZE - lines_in_contact_zone[-1], GROWTH)[1:]
    )
    return BodyMeshLines(
        np.concatenate([lines_in_contact_zone, lines_outside_contact_zone]),
        mesh_lines_over_depth(size),
        float(lines_in_contact_zone[-1]),
    )


def mesh_lines_over_depth(surface_size: float) -> Array:
    """Return mesh lines from the lower side up to the surface z = 0, refined towards the surface.

    `surface_size` is an upper bound of the size of the elements at the surface.
    """
    return -geometrically_growing_lines(surface_size, BODY_SIZE, GROWTH)[::-1]


def bend_end_of_block(x: Array, curvature: float) -> Array:
    """Map nodes (n, 3) of a block above or below z = 0 so that its side z = 0 is a paraboloid.

    Nodes move along z; the opposite side of the block remains flat.

    Args:
        x: Nodes of the block.
        curvature: Curvature of the side along both axes.
    """
    fraction = 1 - np.abs(x[:, 2]) / np.abs(x[:, 2]).max()
    height = curvature / 2 * (x[:, 0] ** 2 + x[:, 1] ** 2)
    return np.column_stack([x[:, :2], x[:, 2] + fraction * height])


def mesh_lines_of_block_under_ball(elements_per_radius: float) -> tuple[Array, Array, float]:
    """Return mesh lines of a whole body within `BODY_SIZE`, relative to the contact radius.

    Args:
        elements_per_radius: Number of elements along the contact radius.

    Returns:
        Lines across the body and into it, from 0, and the extent of the part that may touch.
    """
    size = 1 / (elements_per_radius + CONTACT_EDGE_POSITION)
    inner = size * np.arange(np.ceil(CONTACT_ZONE_SIZE / size) + 1)
    n_outer = int(np.ceil((BODY_SIZE - inner[-1]) / (2.5 * size)))
    outwards = np.concatenate([inner, np.linspace(inner[-1], BODY_SIZE, n_outer + 1)[1:]])
    horizontal = np.concatenate([-outwards[:0:-1], outwards])
    n_depth = int(np.ceil(np.log1p(BODY_SIZE / size) / np.log(2)))
    depth = BODY_SIZE * (2 ** np.arange(n_depth + 1) - 1) / (2**n_depth - 1)
    return horizontal, depth, float(inner[-1])
