"""Gap, slip and force of the contact points, linearised at a place of the surfaces."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pw_elements.contact.interface import Interface
from pw_elements.contact.iteration.law import frames

Array = npt.NDArray[np.float64]

# Step of differences along free translations, over the extent of the contact nodes
_STEP = 1e-4


@dataclass(frozen=True)
class Kinematics:
    """Gap, slip and force components as linear functions of a, U and r.

    a and r are displacements and forces of the contact nodes, U the translations of their
    surfaces. Where a curved surface is free to move, its normals turn with it. With values of
    the place of linearisation marked by 0 and sums over the free translations k,

        gap   = gap_0 + n_0·a - sum loss_k (U_k - U_0k),
        slip  = T_0 (a - U - what they were) + sum turned_slip_k (U_k - U_0k),
        force = [n_0; T_0] r + sum turned_force_k (U_k - U_0k).

    Args:
        interface: the contact points (m).
        translations: U_0, (pairs, dim).
        past: displacements less translations (n, dim) from which slip counts.
        frame: normals n_0 and tangents T_0, (n, dim, dim).
        gap: gap_0 of the undeformed body (n,), infinite where nothing faces a node.
        loss: (n, dim), of gap per translation; the normal, unless curved and free.
        turned_slip: (n, dim - 1, dim), by the turning of tangents per translation.
        turned_force: (n, dim, dim), by the turning of the frame per translation.
    """

    interface: Interface
    translations: Array
    past: Array
    frame: Array
    gap: Array
    loss: Array
    turned_slip: Array
    turned_force: Array

    @classmethod
    def at(
        cls,
        interface: Interface,
        past: Array,
        translations: Array,
        free: Array,
        displacement: Array,
        force: Array,
    ) -> "Kinematics":
        """Linearisation at translations, displacements (n, dim) and forces (n, dim).

        Args:
            interface: the contact points.
            past: displacements less translations (n, dim) from which slip counts.
            translations: (pairs, dim).
            free: (pairs, dim), tells which translations may change.
            displacement: of the nodes.
            force: on the nodes.
        """
        step = _STEP * (interface.extent or 1.0)
        frame = frames(interface.normals(translations), interface.equation >= 0)
        normal, tangents = frame[:, 0], frame[:, 1:]
        gap, loss = interface.gaps(translations), normal.copy()
        turn = np.zeros_like(frame)  # of the normal, (n, component, translation)
        for axis in np.flatnonzero(free.any(axis=0)):
            ahead, behind = translations.copy(), translations.copy()
            ahead[free[:, axis], axis] += step
            behind[free[:, axis], axis] -= step
            moved = free[interface.pair, axis]
            turned = (interface.normals(ahead) - interface.normals(behind)) / (2 * step)
            with np.errstate(invalid="ignore"):  # infinite gaps
                change = (interface.gaps(behind) - interface.gaps(ahead)) / (2 * step)
            smooth = moved & np.isfinite(change)
            turn[smooth, :, axis] = turned[smooth]
            loss[smooth, axis] = change[smooth] - np.sum(turned * displacement, axis=1)[smooth]
        # tangents turn so that they stay normal to it: dt = -(t·dn) n
        tilt = np.einsum("nta,nak->ntk", tangents, turn)
        relative = displacement - translations[interface.pair] - past
        turned_slip = -tilt * np.sum(normal * relative, axis=1)[:, None, None]
        turned_force = np.concatenate(
            [
                np.einsum("na,nak->nk", force, turn)[:, None],
                -tilt * np.sum(normal * force, axis=1)[:, None, None],
            ],
            axis=1,
        )
        return cls(interface, translations, past, frame, gap, loss, turned_slip, turned_force)

    def gaps(self, displacement: Array, translations: Array) -> Array:
        """Gaps (n,) at displacements (n, dim) and translations (pairs, dim)."""
        approach = np.sum(self.frame[:, 0] * displacement - self.loss * self._from(translations), 1)
        return self.gap + approach

    def slips(self, displacement: Array, translations: Array) -> Array:
        """Slip components (n, dim - 1) likewise."""
        relative = displacement - translations[self.interface.pair] - self.past
        slips = np.einsum("nab,nb->na", self.frame[:, 1:], relative)
        return slips + np.einsum("nak,nk->na", self.turned_slip, self._from(translations))

    def forces(self, force: Array, translations: Array) -> Array:
        """Force components (n, dim) along the frame of nodal forces (n, dim)."""
        turned = np.einsum("nak,nk->na", self.turned_force, self._from(translations))
        return np.einsum("nab,nb->na", self.frame, force) + turned

    def equations(self, A: Array, B: Array, b: Array) -> tuple[Array, Array, Array, Array]:
        """A force + B (gap; slip) = b in the nodes' coordinates.

        Args:
            A: (n, dim, dim), in the frames.
            B: (n, dim, dim).
            b: (n, dim).

        Returns:
            E, C, D and c of E r + C a - D U = c, (n, dim, dim) thrice and (n, dim).
        """
        slip = self.frame[:, 1:] - self.turned_slip
        follow = np.concatenate([self.loss[:, None], slip], axis=1)
        D = np.einsum("nab,nbk->nak", B, follow) - np.einsum("nab,nbk->nak", A, self.turned_force)
        level = np.einsum("nab,nb->na", self.frame, self.past)
        level[:, 0] = np.where(np.isfinite(self.gap), -self.gap, 0.0)
        here = self.translations[self.interface.pair]
        turned = D - np.einsum("nab,nbk->nak", B[:, :, 1:], self.frame[:, 1:])
        c = b + np.einsum("nab,nb->na", B, level) - np.einsum("nak,nk->na", turned, here)
        E, C = A @ self.frame, B @ self.frame
        to_nodes = np.swapaxes(self.frame, 1, 2)
        return to_nodes @ E, to_nodes @ C, to_nodes @ D, np.einsum("nab,nb->na", to_nodes, c)

    def _from(self, translations: Array) -> Array:
        """Translations (n, dim) of the nodes' surfaces from the place of linearisation."""
        return (translations - self.translations)[self.interface.pair]
