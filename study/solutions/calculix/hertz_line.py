"""CalculiX' Hertz line contact with the edges of section Q: its own pressure; needs no DOLFINx.

The surface of the body is the parabola and the rigid one is flat: a brick's face, held. Contact is
of faces, by a penalty; the manual does not recommend its contact of nodes for quadratic elements.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from study.meshes.mesh_lines import growing
from study.solutions.calculix.decks import row, text
from study.solutions.calculix.grids import Grid
from study.solutions.calculix.printed import Array, fields
from study.solutions.half_space import Elastic, HertzLine

PENALTIES = 1, 10, 100  # times h/E
RADIUS, ZONE, OUTER, GROWTH = 1e5, 1.3, 5.0, 1.3


@dataclass(frozen=True)
class Line:
    """Half of the half plane, CPE6 elements.

    Args:
        edges: over the half width.
        offset: where in the next edge contact ends.
        penalty: pressure over penetration, times h/E.
    """

    edges: int
    offset: float
    penalty: float

    written = ".frd"

    @property
    def known(self) -> HertzLine:
        """Half width 1, E 1."""
        body = Elastic(1.0, 0.3)
        return HertzLine(body, RADIUS, np.pi * body.plane_modulus / (4 * RADIUS))

    @property
    def size(self) -> float:
        """Length of an edge."""
        return 1 / (self.edges + self.offset)

    @cached_property
    def lines(self) -> tuple[Array, Array]:
        """Mesh lines across and from below."""
        near = self.size * np.arange(np.ceil(ZONE / self.size) + 1)
        far = near[-1] + growing(self.size, OUTER - near[-1], GROWTH)[1:]
        return np.concatenate([near, far]), -growing(self.size, OUTER, GROWTH)[::-1]

    @cached_property
    def grid(self) -> Grid:
        """Its lattice."""
        x, y = (len(lines) - 1 for lines in self.lines)
        return Grid("T6", (0.0, 0.0), (float(x), float(y)), (x, y))

    @cached_property
    def nodes(self) -> Array:
        """Places (n, 2) before the surface is curved."""
        lattice = np.array(self.grid.places)
        columns = [
            np.interp(at, np.arange(len(lines)), lines)
            for at, lines in zip(lattice.T, self.lines, strict=True)
        ]
        return np.column_stack(columns)

    @property
    def slave(self) -> npt.NDArray[np.int64]:
        """Numbers of the nodes that may touch, from the middle outwards."""
        x, y = self.nodes.T
        found = np.flatnonzero(np.isclose(y, 0.0) & (x < self._zone + 1e-9))
        return found[np.argsort(x[found])] + 1

    @property
    def _zone(self) -> float:
        return float(self.size * np.ceil(ZONE / self.size))

    def deck(self) -> str:
        """The input file."""
        x, y = self.nodes.T
        placed = np.column_stack([x, y - np.isclose(y, 0.0) * x**2 / (2 * RADIUS)])
        top, columns = self.grid.upper[1], round(self._zone / self.size)
        sides = self.grid.faces_where(lambda p: p[1] == top and p[0] <= columns)
        first, element = len(x) + 1, len(self.grid.elements) + 1
        low, high = -1.0, self._zone + 1.0
        corners = [(low, -1), (low, 1), (high, 1), (high, -1)]
        brick = [(a, height, b) for height in (0.0, 1.0) for a, b in corners]
        return text(
            [
                "*NODE,NSET=ALL",
                *(row([k, *map(_short, (*p, 0.0))]) for k, p in enumerate(placed, start=1)),
                "*NODE,NSET=RIGID",
                *(row([first + k, *p]) for k, p in enumerate(brick)),
                "*ELEMENT,TYPE=CPE6,ELSET=BODY",
                *(row([k, *cell]) for k, cell in enumerate(self.grid.elements, start=1)),
                "*ELEMENT,TYPE=C3D8,ELSET=BRICK",
                row([element, *range(first, first + 8)]),
                "*MATERIAL,NAME=ELASTIC\n*ELASTIC\n1.,.3",
                "*SOLID SECTION,ELSET=BODY,MATERIAL=ELASTIC\n1.",
                "*SOLID SECTION,ELSET=BRICK,MATERIAL=ELASTIC",
                "*SURFACE,NAME=SLAVE",
                *(f"{k},S{face}" for k, face in sides),
                f"*SURFACE,NAME=MASTER\n{element},S1",
                "*SURFACE INTERACTION,NAME=TOUCH",
                "*SURFACE BEHAVIOR,PRESSURE-OVERCLOSURE=LINEAR",
                f"{_short(self.penalty / self.size)},1e-15",
                "*CONTACT PAIR,INTERACTION=TOUCH,TYPE=SURFACE TO SURFACE\nSLAVE,MASTER",
                "*STEP\n*STATIC\n1.,1.\n*BOUNDARY",
                "RIGID,1,1,0.\nRIGID,3,3,0.",
                f"RIGID,2,2,{_short(-self.known.approach)}",
                *self._held(),
                "*NODE FILE,OUTPUT=2D\nU\n*CONTACT FILE\nCDIS,CSTR\n*END STEP",
            ]
        )

    def _held(self) -> Iterator[str]:
        x, y = self.nodes.T
        far = np.isclose(x, OUTER) | np.isclose(y, -OUTER)
        field = self.known.displacement(self.nodes[far])
        field[x[far] == 0, 0] = 0.0
        for place, k in enumerate(np.flatnonzero(far)):
            for axis in (0, 1):
                moved = _short(float(field[place, axis]))
                yield row([int(k) + 1, axis + 1, axis + 1, moved])
        yield from (row([int(k), 1, 1, 0.0]) for k in np.flatnonzero(np.isclose(x, 0.0) & ~far) + 1)

    def numbers(self, printed: str) -> dict[str, Array]:
        """Places of the slave's nodes and CalculiX' pressures there, over Hertz' peak."""
        contact = fields(printed)["CONTACT"]
        pressure = np.array([contact[k][3] for k in self.slave]) / self.known.peak
        return {"x": self.nodes[self.slave - 1, 0], "pressure": pressure}


def _short(number: float) -> float:
    return float(f"{number:.12g}")


LINES = {
    f"hertz-line-{n}-{offset}-{penalty}": Line(n, offset, float(penalty))
    for n in (4, 8, 16)
    for offset in (0.375, 0.875)
    for penalty in PENALTIES
}
