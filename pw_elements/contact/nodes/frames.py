"""Frames of contact nodes: a unit normal and unit tangents, as rows."""

import numpy as np

from pw_elements.arrays import Array, Mask

# Smallest length of a unit tangent's projection on the components held by supports at which the
# tangent counts as held
_MIN_SUPPORT_PROJECTION_OF_HELD_TANGENT = 0.5


def make_frames(normal: Array, law_applies: Mask) -> Array:
    """Return frames (m, dim, dim) whose rows are a unit normal and unit tangents.

    Tangents lie in the directions in which the contact law applies. Their other components are
    exactly zero, so that no round-off of a force acts along them. Rows for which there is no such
    tangent are zero.

    Args:
        normal: (m, dim), unit normals.
        law_applies: (m, dim), mask of the global components in which the law applies. All other
            components have to be perpendicular to the normal.
    """
    free = np.eye(normal.shape[1]) * law_applies[:, None, :]
    projector = free - normal[:, :, None] * normal[:, None, :]
    values, vectors = np.linalg.eigh(projector)  # eigenvalues 0 and 1, ascending
    tangents = np.swapaxes(vectors * (values > 0.5)[:, None, :], 1, 2) * law_applies[:, None, :]
    return np.concatenate([normal[:, None, :], tangents[:, 1:]], axis=1)


def add_tangents_along_supports(frame: Array, held_components: Mask) -> Array:
    """Return frames (m, dim, dim) with zero tangents replaced by unit tangents along supports.

    Tangents are replaced only at points where supports hold a component. `held_components` (m, dim)
    is a mask of the global components that supports hold.
    """
    if not held_components.any():
        return frame
    frame = frame.copy()
    for t in range(1, frame.shape[1]):
        empty = np.flatnonzero(held_components.any(axis=1) & ~frame[:, t].any(axis=1))
        rows = frame[empty]
        axes = np.eye(frame.shape[1]) - np.einsum("nka,nkb->nab", rows, rows)
        lengths = np.where(held_components[empty], np.linalg.norm(axes, axis=2), 0.0)
        chosen = axes[np.arange(len(empty)), lengths.argmax(axis=1)]
        frame[empty, t] = chosen / np.linalg.norm(chosen, axis=1, keepdims=True)
    return frame


def find_held_tangents(frame: Array, held_components: Mask) -> Mask:
    """Return a mask (m, dim - 1) of the tangents along which supports hold a point.

    `held_components` (m, dim) is a mask of the global components that supports hold.
    """
    held_part = np.where(held_components[:, None], frame[:, 1:], 0.0)
    return np.asarray(np.linalg.norm(held_part, axis=2) > _MIN_SUPPORT_PROJECTION_OF_HELD_TANGENT)
