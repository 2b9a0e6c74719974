"""Gap and slip of the contact nodes, linearised at a place of the surfaces."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pw_elements.contact.law import frames
from pw_elements.contact.pairs import ContactNodes

Array = npt.NDArray[np.float64]

# Step of differences along free translations, over the extent of the contact nodes
_STEP = 1e-6


@dataclass(frozen=True)
class Geometry:
    """Gap and slip as linear functions of displacement a and surface translation U.

    With U_0 the place of linearisation, g = gap(x - U_0) + n·a - loss·(U - U_0).

    Args:
        nodes: the contact nodes (n).
        translations: U_0, (pairs, dim).
        frame: normals and tangents (n, dim, dim) there.
        gap: of the undeformed body (n,), infinite where nothing faces a node.
        loss: (n, dim), of gap per translation; the normal, but for curved surfaces whose
            translation is free.
    """

    nodes: ContactNodes
    translations: Array
    frame: Array
    gap: Array
    loss: Array

    @classmethod
    def at(
        cls, nodes: ContactNodes, translations: Array, displacement: Array, free: Array
    ) -> "Geometry":
        """Geometry at a place; `free` (pairs, dim) tells which translations may change."""
        extent = np.ptp(nodes.gathered(nodes.position), axis=0).max()
        return cls(
            nodes,
            translations,
            frames(nodes.normals(translations), nodes.column >= 0),
            nodes.gaps(translations),
            nodes.approach(translations, displacement, free, _STEP * extent),
        )

    @property
    def follow(self) -> Array:
        """What translations act on, (n, dim, dim): gap and slip, as the frame for displacements."""
        return np.concatenate([self.loss[:, None], self.frame[:, 1:]], axis=1)

    def level(self, displacement: Array, translations: Array) -> Array:
        """Right sides (n, dim) of frame·a - follow·U = level: closed gap, and no slip from here.

        Args:
            displacement: (n, dim), from which slip counts.
            translations: (pairs, dim), likewise.
        """
        from_here = displacement - self.nodes.shifts(translations)
        level = np.einsum("nab,nb->na", self.frame, from_here)
        gap = np.where(np.isfinite(self.gap), self.gap, 0.0)
        level[:, 0] = -gap - np.sum(self.loss * self.nodes.shifts(self.translations), axis=1)
        return level

    def gaps(self, displacement: Array, translations: Array) -> Array:
        """Gaps (n,) at displacements (n, dim) and translations (pairs, dim)."""
        moved = self.nodes.shifts(translations - self.translations)
        approach = np.sum(self.frame[:, 0] * displacement - self.loss * moved, axis=1)
        return self.gap + approach

    def slips(self, displacement: Array, translations: Array) -> Array:
        """Tangential components (n, dim - 1) of displacements less translations."""
        relative = displacement - self.nodes.shifts(translations)
        return np.einsum("nab,nb->na", self.frame[:, 1:], relative)
