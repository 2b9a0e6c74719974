"""Pressures at all nodes of a plane surface, as linear functions of its nodal forces."""

import numpy as np
import numpy.typing as npt

from pw_elements import SurfaceNodes

Array = npt.NDArray[np.float64]


def reading(name: str, surface: SurfaceNodes) -> Array:
    """The matrix (m, m) that makes pressures of nodal forces (m,).

    Readings without a parameter: forces over "own" weights, or "tributary" areas, or "projected"
    to linear functions of the surface, which do the same work on all linear displacements. Where
    own weights vanish, at corners of the standard T10, two rules make up a pressure: none ("skip"),
    or the mean of the mid-side "neighbours".

    Raises:
        ValueError: for own weights that vanish.
    """
    if name == "projected":
        P = linear(surface)
        return np.asarray(P @ np.linalg.solve(_mass(surface), P.T))
    if name == "tributary":
        return np.diag(1 / surface.tributary_area)
    weightless = surface.weight_area < 1e-9 * surface.tributary_area
    weights = np.where(weightless, np.inf, surface.weight_area)
    own = np.diag(1 / weights)
    if name == "neighbours":
        beside = np.zeros_like(own)
        middle = surface.edges[:, :1].repeat(2, axis=1)
        beside[surface.edges[:, 1:], middle] = 1.0
        mean = beside / np.maximum(1.0, beside.sum(axis=1, keepdims=True))
        own[weightless] = (mean @ own)[weightless]
    elif name == "own" and weightless.any():
        raise ValueError("there are nodes whose own weight vanishes")
    return own


def linear(surface: SurfaceNodes) -> Array:
    """Values (m, c) at all nodes of functions that are one at one corner each, and linear."""
    corners, middle = _corners(surface), surface.edges[:, 0]
    P = np.eye(len(surface.position))
    P[middle] = (P[surface.edges[:, 1]] + P[surface.edges[:, 2]]) / 2
    return P[:, corners]


def _corners(surface: SurfaceNodes) -> npt.NDArray[np.int64]:
    found: npt.NDArray[np.int64] = np.unique(surface.edges[:, 1:])
    return found


def _mass(surface: SurfaceNodes) -> Array:
    """Integrals (c, c) of products of the linear functions, over intervals or triangles."""
    count = surface.position.shape[1]
    facets = np.searchsorted(_corners(surface), surface.facets[:, :count])
    x = surface.position[surface.facets[:, :count]]
    sides = x[:, 1:] - x[:, :1]
    sizes = np.sqrt(np.linalg.det(sides @ sides.transpose(0, 2, 1))) / (count - 1)
    shares = (np.ones((count, count)) + np.eye(count)) / (count * (count + 1))
    M = np.zeros((len(_corners(surface)),) * 2)
    np.add.at(M, (facets[:, :, None], facets[:, None, :]), sizes[:, None, None] * shares)
    return M
