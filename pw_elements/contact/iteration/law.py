"""The law of one contact node: unilateral contact and Coulomb friction on nodal forces.

With r the force of the surface on the node, n the direction it pushes in, g the gap and v
the slip of the increment (relative tangential displacement), r_n = n·r, r_t = r - r_n n:

    r_n >= 0,  g >= 0,  r_n g = 0;      |r_t| <= l(r_n),  r_t |v| = -l(r_n) v,

l being the limit of friction, Coulomb's mu r_n say, is the same as the vanishing of the nodal
Alart-Curnier function

    F_n = r_n - max(0, p),                     p = r_n - c g,
    F_t = r_t - projection of s on the disc |.| <= l(max(0, p)),    s = r_t - c v,

for any c > 0; it is of the size of the node's stiffness diagonal, so that both terms are
forces. Newton's method on F is an active-set iteration: a node is

    open (p <= 0):        r = 0,
    stick (|s| < l(p)):   g = 0, v = 0,
    slip (else):          g = 0, (I - M) r_t - l'(p) r_n d + c M v = (l(p) - l'(p) p) d,
                          d = s/|s|, M = (l(p) / |s|) (I - d d^T).

M turns the direction of slip. In the plane there is one tangent, I - d d^T vanishes, the last line
is r_t = ± mu r_n by Coulomb's law, and the iteration runs through finitely many sets. A tangent of
length zero takes no part: that is how a prescribed tangential displacement is left alone.

A node whose slip would turn back sticks for one iteration first: otherwise long slips, which
c magnifies, let rows of nodes jump from one direction to the other and back.
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from pw_elements.contact.model import Cone, projected

Array = npt.NDArray[np.float64]

OPEN, STICK, SLIP = 0, 1, 2


@dataclass(frozen=True)
class ActiveSet:
    """What is assumed of every contact node (n of this process) in one linear solve.

    Args:
        status: (n,) OPEN, STICK or SLIP.
        direction: (n, dim - 1), unit tangential force of slipping nodes; zero for others and
            without friction.
        turning: (n,), l(p) / |s|; zero for nodes that do not slip.
        slope: (n,), l'(p), likewise.
        level: (n,), l(p) - l'(p) p, likewise; nothing by Coulomb's law.
    """

    status: npt.NDArray[np.int8]
    direction: Array
    turning: Array
    slope: Array
    level: Array

    @classmethod
    def of(
        cls,
        status: npt.NDArray[np.int8],
        direction: Array,
        turning: Array,
        cone: Cone,
        pressing: Array,
    ) -> "ActiveSet":
        """With the limits of friction linearised at p (n,)."""
        pressing = np.maximum(0.0, pressing)
        limit, slope = cone.limit(pressing)
        slips = np.any(direction != 0, axis=1)
        level = np.where(slips, limit - slope * pressing, 0.0)
        return cls(status, direction, turning, np.where(slips, slope, 0.0), level)


@dataclass(frozen=True)
class Contact:
    """Quantities of the contact nodes (n of this process) in their frames.

    Args:
        frame: (n, dim, dim), rows: normal, tangents (zero where the law is not stated).
        gap: (n,), infinite where nothing faces the node.
        slip: (n, dim - 1), of this increment.
        force: (n, dim), components of the nodal force along the frame.
        cone: of friction.
        scale: (n,), c.
    """

    frame: Array
    gap: Array
    slip: Array
    force: Array
    cone: Cone
    scale: Array

    @property
    def pressing(self) -> Array:
        """p, (n,); minus infinity for nodes which nothing faces."""
        return self.force[:, 0] - self.scale * self.gap

    @property
    def shearing(self) -> Array:
        """s, (n, dim - 1)."""
        return self.force[:, 1:] - self.scale[:, None] * self.slip

    @property
    def limit(self) -> Array:
        """Limits of friction l(max(0, p)), (n,)."""
        return self.cone.limit(np.maximum(0.0, self.pressing))[0]

    def active_set(self, before: ActiveSet | None = None) -> ActiveSet:
        """The linearisation of F here; with regard to the one before, if it is given."""
        p, s = self.pressing, self.shearing
        size, radius = np.linalg.norm(s, axis=1), self.limit
        slipping = (p > 0) & (size >= radius)
        if before is not None:
            slipping &= ~(np.sum(s * before.direction, axis=1) < 0)
        directed = slipping & self.cone.rough
        status = np.where(p > 0, STICK, OPEN)
        status[slipping] = SLIP
        direction = np.where(directed, 1 / np.where(directed, size, 1.0), 0.0)[:, None] * s
        turning = np.where(directed, radius / np.where(directed, size, 1.0), 0.0)
        return ActiveSet.of(status.astype(np.int8), direction, turning, self.cone, p)

    def violation(self) -> Array:
        """F, (n, dim), forces: zero at a solution."""
        p, s = self.pressing, self.shearing
        normal = self.force[:, :1] - np.maximum(0.0, p)[:, None]
        return np.hstack([normal, self.force[:, 1:] - projected(s, self.limit)])


def sticking(closed: npt.NDArray[np.bool_], cone: Cone, tangents: int) -> ActiveSet:
    """The set in which closed nodes (n,) stick, or slip where there is no friction."""
    n = len(closed)
    status = np.where(closed, np.where(cone.rough, STICK, SLIP), OPEN).astype(np.int8)
    return ActiveSet(status, np.zeros((n, tangents)), *np.zeros((3, n)))


def mixed(keep: npt.NDArray[np.bool_], old: ActiveSet, new: ActiveSet) -> ActiveSet:
    """The old set where `keep` holds, the new one elsewhere."""
    return ActiveSet(
        np.where(keep, old.status, new.status).astype(np.int8),
        np.where(keep[:, None], old.direction, new.direction),
        np.where(keep, old.turning, new.turning),
        np.where(keep, old.slope, new.slope),
        np.where(keep, old.level, new.level),
    )


def equations(active: ActiveSet, scale: Array) -> tuple[Array, Array, Array]:
    """Linear equations A force + B (gap; slip) = b of every node in its frame.

    Returns:
        A and B, both (n, dim, dim), and b, (n, dim).
    """
    n, tangents = active.direction.shape
    A, B = np.zeros((n, tangents + 1, tangents + 1)), np.zeros((n, tangents + 1, tangents + 1))
    one = np.eye(tangents + 1)
    A[active.status == OPEN] = one

    stick = active.status == STICK
    B[stick] = scale[stick, None, None] * one

    slip = active.status == SLIP
    d, c = active.direction[slip], scale[slip]
    across = one[1:, 1:] - d[:, :, None] * d[:, None, :]
    turn = active.turning[slip, None, None] * across
    B[slip, 0, 0] = c
    A[slip, 1:, 0] = -active.slope[slip, None] * d
    A[slip, 1:, 1:] = one[1:, 1:] - turn
    B[slip, 1:, 1:] = c[:, None, None] * turn
    return A, B, np.pad(active.level[:, None] * active.direction, ((0, 0), (1, 0)))


def frames(normal: Array, stated: npt.NDArray[np.bool_]) -> Array:
    """Normals and tangents of contact nodes, (n, dim, dim).

    Args:
        normal: (n, dim) unit vectors.
        stated: (n, dim), False for components of the displacement that are prescribed. They
            have to be tangential; the tangents are orthogonal to them.
    """
    free = np.eye(normal.shape[1]) * stated[:, None, :]
    projector = free - normal[:, :, None] * normal[:, None, :]
    values, vectors = np.linalg.eigh(projector)  # eigenvalues 0 and 1, ascending
    tangents = np.swapaxes(vectors * (values > 0.5)[:, None, :], 1, 2)
    return np.concatenate([normal[:, None, :], tangents[:, 1:]], axis=1)


def turned(active: ActiveSet, old: Array, new: Array) -> ActiveSet:
    """An active set that refers to frames (n, dim, dim), in new ones."""
    turn = np.einsum("nai,nbi->nab", new[:, 1:], old[:, 1:])
    direction = np.einsum("nab,nb->na", turn, active.direction)
    return replace(active, direction=direction)
