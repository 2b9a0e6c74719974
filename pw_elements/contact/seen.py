"""Results at nodes of deformable surfaces, where no law is stated.

Forces are the nodes' own, pressures these over areas (see `sides`). Gap, slip and friction are
means of those of the pairs' nodes, weighted with integrals of the products of both weights, and the
status is that of which a node faces most.
"""

from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt

from pw_elements.contact.law import OPEN

Array = npt.NDArray[np.float64]

# Part of a node's area that has to face the other side for quotients by it. Where the pressure is
# linear, they are off by up to 0.3 % at a quarter, 1 % at a twentieth, and 10 % at a 200th
TRUSTED = 0.1
STATUSES = 3


@dataclass(frozen=True)
class Seen:
    """Results at nodes (n) of opposite sides, summed over the pairs that they face.

    Args:
        facing: (n,), integrals of the nodes' weights over what they face.
        gap: (n,), means times `facing`.
        slip: (n, dim), likewise, of the nodes on the pair's own side.
        friction: (n,), likewise.
        statuses: (n, 3), what of `facing` is open, sticks and slips.
        pressed: (n,), normal forces, compression positive.
        pulled: (n, dim), tangential ones, on the nodes.
        area: (n,), that make pressures of forces; zero without a body.
        tributary: (n,), the same from tributary areas.
        share: (n,), part of the nodes' areas that faces a pair.
    """

    facing: Array
    gap: Array
    slip: Array
    friction: Array
    statuses: Array
    pressed: Array
    pulled: Array
    area: Array
    tributary: Array
    share: Array

    def on(self, rows: npt.NDArray[np.int32], n: int) -> "Seen":
        """The same at rows of n nodes, or at none where they are negative; zero elsewhere."""
        values = []
        for part in fields(self):
            own = getattr(self, part.name)
            values.append(np.zeros((n, *own.shape[1:])))
            values[-1][rows[rows >= 0]] = own[rows >= 0]
        return Seen(*values)

    def __add__(self, other: "Seen") -> "Seen":
        return Seen(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))

    @property
    def faced(self) -> npt.NDArray[np.bool_]:
        """Which nodes face anything."""
        return self.facing > 0

    def mean(self, values: Array) -> Array:
        """`gap`, `slip` or `friction` over `facing`; zero where nothing is faced."""
        return (values.T / np.where(self.faced, self.facing, 1.0)).T

    @property
    def status(self) -> npt.NDArray[np.int8]:
        """Of most of what each node faces."""
        return self.statuses.argmax(axis=1).astype(np.int8)

    @property
    def pressure(self) -> Array:
        """By measure 2, (n,); NaN where too little of a node's area faces a pair that is closed."""
        return self._over(self.pressed, self.area)

    @property
    def tributary_pressure(self) -> Array:
        """By measure 3, (n,), likewise."""
        return self._over(self.pressed, self.tributary)

    @property
    def traction(self) -> Array:
        """Tangential, (n, dim), likewise."""
        return self._over(self.pulled, self.area)

    def _over(self, force: Array, area: Array) -> Array:
        closed = np.delete(self.statuses, OPEN, axis=1).any(axis=1)
        over = np.where(closed, np.where(self.share < TRUSTED, np.nan, area), np.inf)
        return np.asarray((force.T / over).T)
