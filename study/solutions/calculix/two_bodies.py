"""CalculiX decks of two elastic bodies on the meshes of section V11; needs no DOLFINx.

Its contact of faces: "SURFACE TO SURFACE", a penalty at points of the slave's faces, and "MORTAR",
with dual multipliers. Keywords: G. Dhondt, "CalculiX CrunchiX User's Manual", version 2.20. Its
mortar knows no supports of the slave's nodes, with which its matrix is singular, and so no planes
of symmetry that cut the faces.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from study.meshes.mesh_lines import OUTER, graded
from study.solutions.calculix.decks import row, text
from study.solutions.calculix.grids import Grid, Place
from study.solutions.calculix.printed import Array, fields
from study.solutions.half_space import Elastic, HertzSphere

SURFACE, MORTAR = "SURFACE TO SURFACE", "MORTAR"
_UP = 2  # the axis across the faces

Indices = npt.NDArray[np.int64]
Support = tuple[int, int, float]  # node, axis, displacement


@dataclass(frozen=True)
class TwoBodies(ABC):
    """The lower body, whose upper side is the slave, and the upper one.

    Args:
        contact: CalculiX's name of the formulation.
        penalty: pressure over penetration.
    """

    contact: str
    penalty: float = 1e6

    written = ".frd"  # the kind of file that numbers are read from
    ratio = 0.3  # Poisson's
    moduli = (1.0, 1.0)

    @property
    @abstractmethod
    def grids(self) -> tuple[Grid, Grid]:
        """Lattices of both."""

    @abstractmethod
    def placed(self, x: Array, upper: bool) -> Array:
        """Places (n, 3) of those of a lattice."""

    @abstractmethod
    def supports(self) -> Iterator[Support]:
        """Prescribed displacements."""

    def loads(self) -> list[str]:
        """Lines of loads."""
        return []

    @cached_property
    def nodes(self) -> Array:
        """Places (n, 3) of all nodes; node k is row k - 1."""
        both = zip(self.grids, (False, True), strict=True)
        return np.concatenate([self.placed(np.array(grid.places), upper) for grid, upper in both])

    @property
    def places(self) -> list[Place]:
        """The same as numbers."""
        return [tuple(float(part) for part in x) for x in self.nodes]

    @cached_property
    def elements(self) -> Indices:
        """Nodes (e, 10) of all elements; element k is row k - 1."""
        lower, upper = (np.array(grid.elements) for grid in self.grids)
        return np.concatenate([lower, upper + len(self.grids[0].places)])

    @property
    def sides(self) -> tuple[list[tuple[int, int]], list[tuple[int, int]]]:
        """Elements and their faces of the slave and of the master."""
        lower, upper = self.grids
        top, bottom = lower.upper[_UP], upper.lower[_UP]
        master = upper.faces_where(lambda x: abs(x[_UP] - bottom) < 1e-9)
        return (
            lower.faces_where(lambda x: abs(x[_UP] - top) < 1e-9),
            [(k + len(lower.elements), face) for k, face in master],
        )

    @cached_property
    def slave(self) -> Indices:
        """Nodes of the slave's face, in order."""
        lower = self.grids[0]
        return np.unique([node for k, face in self.sides[0] for node in lower.face(k, face)])

    @cached_property
    def master(self) -> Indices:
        """Nodes of the master's face, in order."""
        lower, upper = self.grids
        first = len(lower.elements)
        faces = [upper.face(k - first, face) for k, face in self.sides[1]]
        return np.unique(faces) + len(lower.places)

    @cached_property
    def around(self) -> Indices:
        """Nodes of all elements that have one on either face: what its forces come from."""
        faces = np.concatenate([self.slave, self.master])
        return np.unique(self.elements[np.isin(self.elements, faces).any(axis=1)])

    def deck(self) -> str:
        """The input file."""
        lower = len(self.grids[0].elements)
        cells: list[list[int]] = [[int(node) for node in cell] for cell in self.elements]
        numbered = list(enumerate(cells, start=1))
        slave, master = self.sides
        body: list[str] = []
        for name, of, modulus in zip(
            ("LOWER", "UPPER"), (numbered[:lower], numbered[lower:]), self.moduli, strict=True
        ):
            body += [
                f"*ELEMENT,TYPE=C3D10,ELSET={name}",
                *(row([k, *cell]) for k, cell in of),
                f"*MATERIAL,NAME=OF_{name}\n*ELASTIC\n{modulus!r},{self.ratio!r}",
                f"*SOLID SECTION,ELSET={name},MATERIAL=OF_{name}",
            ]
        return text(
            [
                "*NODE,NSET=ALL",
                *(row([k, *map(_rounded, x)]) for k, x in enumerate(self.places, start=1)),
                *body,
                "*SURFACE,NAME=SLAVE",
                *(f"{k},S{face}" for k, face in slave),
                "*SURFACE,NAME=MASTER",
                *(f"{k},S{face}" for k, face in master),
                "*SURFACE INTERACTION,NAME=TOUCH",
                f"*SURFACE BEHAVIOR,PRESSURE-OVERCLOSURE=LINEAR\n{self.penalty!r},1e-12",
                f"*CONTACT PAIR,INTERACTION=TOUCH,TYPE={self.contact}\nSLAVE,MASTER",
                "*STEP\n*STATIC\n1.,1.\n*BOUNDARY",
                *(row([k, axis + 1, axis + 1, _rounded(u)]) for k, axis, u in self.supports()),
                *self.loads(),
                "*NODE FILE\nU\n*CONTACT FILE\nCDIS,CSTR\n*END STEP",
            ]
        )

    def numbers(self, printed: str) -> dict[str, Array]:
        """Displacements of the nodes around the faces, and pressures of the slave's."""
        found = fields(printed)
        moved, contact = found["DISP"], found["CONTACT"]
        return {
            "displacement": np.concatenate([moved[k][:3] for k in self.around]),
            "pressure": np.array([contact[k][3] for k in self.slave]),
        }


@dataclass(frozen=True)
class Blocks(TwoBodies):
    """The patch test: a block on another, pressed from above, and held there by contact alone.

    Supports that hold them sideways are far from the faces, and hold nothing back.
    """

    pressure = 1e-6  # so small that changes of shape do not count
    grids = (
        Grid("T10", (0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (3, 4, 3)),
        Grid("T10", (0.0, 0.0, 1.0), (1.0, 1.0, 2.0), (2, 3, 2)),
    )

    def placed(self, x: Array, upper: bool) -> Array:  # noqa: ARG002
        """As in the lattice."""
        return x

    def supports(self) -> Iterator[Support]:
        """Of the base, and on the planes of symmetry near base and top."""
        for k, x in enumerate(self.places, start=1):
            for axis in range(_UP):
                if x[axis] == 0 and abs(x[_UP] - 1) > 0.8:
                    yield k, axis, 0.0
            if x[_UP] == 0:
                yield k, _UP, 0.0

    def loads(self) -> list[str]:
        """The pressure from above."""
        lower, upper = self.grids
        top = upper.faces_where(lambda x: abs(x[_UP] - upper.upper[_UP]) < 1e-9)
        size = self.pressure
        return ["*DLOAD", *(f"{k + len(lower.elements)},P{face},{size!r}" for k, face in top)]


@dataclass(frozen=True)
class Spheres(TwoBodies):
    """A quarter of two spheres of unequal moduli; outer sides have Hertz's displacements.

    Args:
        edges: of the slave, along the radius of the contact.
        other: edges of the master over the slave's.
    """

    edges: int = 3
    other: float = 0.71

    moduli = (1.0, 3.0)
    radius = 1e3

    @property
    def grids(self) -> tuple[Grid, Grid]:
        """A lattice of unit cubes for each."""
        divisions = [
            (len(x) - 1, len(x) - 1, len(z) - 1) for (x, z) in (self._lines(0), self._lines(1))
        ]
        lower, upper = (Grid("T10", (0.0,) * 3, tuple(map(float, n)), n) for n in divisions)
        return lower, upper

    @property
    def known(self) -> tuple[HertzSphere, HertzSphere]:
        """Of the lower and the upper body."""
        bodies = [Elastic(E, self.ratio) for E in self.moduli]
        force = 4 / 3 / self.radius / sum(1 / b.plane_modulus for b in bodies)
        first, second = (HertzSphere(b, 4 * b.plane_modulus / (3 * force), force) for b in bodies)
        return first, second

    def placed(self, x: Array, upper: bool) -> Array:
        """On the mesh lines, and the upper face on its sphere."""
        across, along = self._lines(upper)
        lines = (across, across, along)
        y = [np.interp(x[:, i], np.arange(len(of)), of) for i, of in enumerate(lines)]
        if upper:
            y[_UP] = y[_UP] + (y[0] ** 2 + y[1] ** 2) / (2 * self.radius)
        return np.column_stack(y)

    def supports(self) -> Iterator[Support]:
        """Planes of symmetry, and the outer sides."""
        of_lower = np.arange(len(self.nodes)) < len(self.grids[0].places)
        approach = sum(known.approach for known in self.known)
        x = self.nodes
        outer = (np.abs(x[:, _UP]) > OUTER - 1e-9) | np.isclose(x[:, :_UP].max(axis=1), OUTER)
        for k in np.flatnonzero(outer):
            known, turn = (self.known[0], 1.0) if of_lower[k] else (self.known[1], -1.0)
            r = float(np.hypot(*x[k, :_UP]))
            ((out, up),) = known.displacement(np.array([[r, turn * x[k, _UP]]]))
            for axis in range(_UP):
                yield k + 1, axis, out * x[k, axis] / max(r, 1e-12)
            yield k + 1, _UP, turn * up - (0.0 if of_lower[k] else approach)
        for axis in range(_UP):
            for k in np.flatnonzero((np.abs(x[:, axis]) < 1e-12) & ~outer):
                yield k + 1, axis, 0.0

    def _lines(self, upper: bool | int) -> tuple[Array, Array]:
        """Across the axis, and along it."""
        lines = graded(self.edges * self.other if upper else self.edges)
        return lines.beside, -lines.below[::-1] if upper else lines.below


def _rounded(value: float) -> float:
    """Without the digits that another processor or NumPy would round otherwise."""
    return float(f"{value:.9g}")


# A penalty on faces of quadratic elements holds more points than the faces have nodes: pressures
# between spheres are the worse the stiffer it is
PAIRS: dict[str, Blocks | Spheres] = {
    "two-blocks-surface": Blocks(SURFACE),
    "two-blocks-mortar": Blocks(MORTAR),
    "two-spheres-surface": Spheres(SURFACE, 1e2),
    "two-spheres-surface-stiff": Spheres(SURFACE, 1e3),
}
