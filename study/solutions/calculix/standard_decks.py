"""Decks that set CalculiX's elements beside the standard ones: four kinds of problems.

They are linear (contact aside), so that units and sizes of loads do not count.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import product

import numpy as np

from study.solutions.calculix.decks import row, text
from study.solutions.calculix.grids import Grid, Where
from study.solutions.calculix.printed import Array, tables

# CalculiX computes a sector of two degrees of an axisymmetric body
SECTORS = 180


@dataclass(frozen=True)
class Specimen:
    """A body of one material.

    Args:
        element: CalculiX's name, like CAX6.
        grid: its mesh.
    """

    element: str
    grid: Grid

    modulus, ratio, density = 1000.0, 0.3, 1.0
    thickness = 1.0

    @property
    def dimension(self) -> int:
        """Of the mesh."""
        return len(self.grid.lower)

    @property
    def up(self) -> int:
        """Axis that points upwards: that of symmetry, or the last one."""
        return self.dimension - 1

    @property
    def is_axisymmetric(self) -> bool:
        """Whether the mesh is half of a section along the axis x = 0."""
        return self.element.startswith("CAX")

    def on(self, axis: int, value: float) -> Where:
        """Marker of a plane across an axis."""
        return lambda x: abs(x[axis] - value) < 1e-9

    @property
    def bottom(self) -> Where:
        """Marker of the lower side."""
        return self.on(self.up, self.grid.lower[self.up])

    @property
    def top(self) -> Where:
        """Marker of the upper side."""
        return self.on(self.up, self.grid.upper[self.up])

    def body(self) -> list[str]:
        """Lines of nodes, elements, material and section."""
        plane = (0.0,) * (3 - self.dimension)
        return [
            "*NODE,NSET=ALL",
            *(f"{k},{digits((*x, *plane))}" for k, x in enumerate(self.grid.nodes, start=1)),
            f"*ELEMENT,TYPE={self.element},ELSET=BODY",
            *(row([k, *cell]) for k, cell in enumerate(self.grid.elements, start=1)),
            f"*MATERIAL,NAME=ELASTIC\n*ELASTIC\n{self.modulus!r},{self.ratio!r}",
            f"*DENSITY\n{self.density!r}",
            "*SOLID SECTION,ELSET=BODY,MATERIAL=ELASTIC",
            *([repr(self.thickness)] if self.element.startswith("CP") else []),
        ]

    def held(self, where: Where, axes: range, value: float = 0.0) -> list[str]:
        """Lines of prescribed displacements."""
        nodes = self.grid.nodes_where(where)
        return [f"{node},{axis + 1},{axis + 1},{value!r}" for node in nodes for axis in axes]

    def pressed(self, where: Where, size: float, parameters: str = "") -> list[str]:
        """Lines of a pressure on the faces at all corners of which a marker holds."""
        faces = self.grid.faces_where(where)
        return [f"*DLOAD{parameters}", *(f"{k},P{face},{digits([size])}" for k, face in faces)]


@dataclass(frozen=True)
class Compressed(Specimen):
    """Held at the bottom, where reactions are read; the top is moved down and held sideways."""

    depth = 0.01

    def deck(self) -> str:
        """The input file."""
        every = range(self.dimension)
        return text(
            [
                *self.body(),
                f"*NSET,NSET=SUPPORT\n{lines(self.grid.nodes_where(self.bottom))}",
                "*BOUNDARY",
                *self.held(self.bottom, every),
                *self.held(self.top, range(self.up)),
                "*STEP\n*STATIC\n*BOUNDARY",
                *self.held(self.top, range(self.up, self.dimension), -self.depth),
                "*NODE PRINT,NSET=ALL\nU\n*NODE PRINT,NSET=SUPPORT\nRF\n*END STEP",
            ]
        )

    def numbers(self, printed: str) -> dict[str, Array]:
        """Displacements of all nodes, and reactions of the bottom."""
        (moved,), (force,) = tables(printed, "displacements"), tables(printed, "forces")
        last = self.dimension + 1
        displacement, reaction = moved[:, 1:last], force[:, 1:last]
        if self.is_axisymmetric:
            displacement[:, 0] /= self._printed_radially()
            reaction = SECTORS * reaction[:, 1:]  # radial ones hold the sides of the sector too
        return {"displacement": displacement.ravel(), "reaction": reaction.ravel()}

    def _printed_radially(self) -> Array:
        """Parts of radial displacements that CalculiX prints as those of plane nodes.

        They are means of the x components of the spatial nodes: of two, one degree beside the
        plane, at mid-side nodes (but for the curvature of the side's displacement); of these and
        of the one between, which counts four times, at corners.
        """
        beside = np.cos(np.pi / SECTORS)
        parts = np.full(len(self.grid.nodes), beside)
        parts[np.array(self.grid.corners) - 1] = (4 + 2 * beside) / 6
        return parts


@dataclass(frozen=True)
class Vibrating(Specimen):
    """Held at the bottom: lowest squares of angular frequencies."""

    count = 6

    def deck(self) -> str:
        """The input file."""
        return text(
            [
                *self.body(),
                "*BOUNDARY",
                *self.held(self.bottom, range(self.dimension)),
                f"*STEP\n*FREQUENCY\n{self.count}\n*NODE FILE\nU\n*END STEP",
            ]
        )

    def numbers(self, printed: str) -> dict[str, Array]:
        """The squares."""
        (rows,) = tables(printed, "(RAD/TIME)")
        return {"eigenvalue": rows[:, 1]}


@dataclass(frozen=True)
class Buckling(Specimen):
    """Plane column, held at the bottom and pressed on the top: buckling pressures.

    Args:
        thickness: of the column; the pressures do not depend on it.
    """

    thickness: float = 1.0

    count = 2

    def deck(self) -> str:
        """The input file."""
        return text(
            [
                *self.body(),
                "*BOUNDARY",
                *self.held(self.bottom, range(self.dimension)),
                f"*STEP\n*BUCKLE\n{self.count},1e-8",
                *self.pressed(self.top, 1.0),
                "*NODE FILE\nU\n*END STEP",
            ]
        )

    def numbers(self, printed: str) -> dict[str, Array]:
        """The pressures."""
        (factors,) = tables(printed, "FACTOR")
        return {"critical_pressure": factors[:, 1]}


@dataclass(frozen=True)
class Resting(Specimen):
    """On a rigid plane, pressed on a part of the top near x = 0; y = 0 is a plane of symmetry.

    Each contact node faces a fixed brick of its own, as in `Block`.

    Args:
        friction: Coulomb's mu; without it x = 0 is held, too.
        pull: traction on the side at the end of x over the pressure.
        penalty: pressure over penetration on a brick of area four.
        stick_slope: the same of friction over slip, as long as it sticks.
    """

    friction: float = 0.0
    pull: float = 0.0
    penalty: float = 5e9
    stick_slope: float = 1e7

    pressure, width, increments = 0.2, 1.0, 10

    def is_pressed(self, x: tuple[float, ...]) -> bool:
        """Marker of the pressed part of the top."""
        return self.top(x) and x[0] < self.width + 1e-9

    @property
    def contact_nodes(self) -> list[int]:
        """Nodes of the lower side."""
        return self.grid.nodes_where(self.bottom)

    def deck(self) -> str:
        """The input file."""
        symmetry = self.held(self.on(1, 0.0), range(1, 2)) if self.dimension == 3 else []
        side = self.held(self.on(0, 0.0), range(1)) if not self.friction else []
        return text(
            [
                *self.body(),
                *self._rigid(),
                *self._contact(),
                "*BOUNDARY\nRIGID,1,3",
                *symmetry,
                *side,
                *self._loads(),
                "*NODE PRINT,NSET=RIGID\nRF\n*END STEP",
            ]
        )

    def numbers(self, printed: str) -> dict[str, Array]:
        """What each brick carries, of the whole body, at the end of the last increment."""
        force = tables(printed, "forces")[-1][:, 1:]
        carried = force.reshape(-1, 8, 3).sum(axis=1) * (SECTORS if self.is_axisymmetric else 1)
        forces = {"force_normal": carried[:, self.up]}
        if self.friction:
            forces["force_tangential"] = carried[:, : self.up].ravel()
        return forces

    def _rigid(self) -> list[str]:
        return bricks(self, [self.grid.nodes[node - 1] for node in self.contact_nodes], 1.0)

    def _contact(self) -> list[str]:
        count, pairs = len(self.grid.elements), []
        for k, node in enumerate(self.contact_nodes):
            pairs += [
                f"*SURFACE,NAME=NODE{k},TYPE=NODE\n{node}",
                f"*SURFACE,NAME=FACE{k}\n{count + 1 + k},S2",
                f"*CONTACT PAIR,INTERACTION=TOUCH,TYPE=NODE TO SURFACE\nNODE{k},FACE{k}",
            ]
        return pairs + law(self.penalty, self.friction, self.stick_slope)

    def _loads(self) -> list[str]:
        """Pressure, then pull, in one step: a new step would relax the penetration of the last."""
        if not self.pull:
            return ["*STEP\n*STATIC\n1.,1.", *self.pressed(self.is_pressed, self.pressure)]
        end = self.on(0, self.grid.upper[0])
        return [
            "*AMPLITUDE,NAME=PRESS\n0.,0.,1.,1.,2.,1.",
            "*AMPLITUDE,NAME=PULL\n0.,0.,1.,0.,2.,1.",
            f"*STEP\n*STATIC\n{1 / self.increments!r},2.,1e-9,{1 / self.increments!r}",
            *self.pressed(self.is_pressed, self.pressure, ",AMPLITUDE=PRESS"),
            *self.pressed(end, -self.pull * self.pressure, ",AMPLITUDE=PULL"),
        ]


@dataclass(frozen=True)
class RoughBlock(Specimen):
    """Free block on one rigid face, by surface-to-surface contact: pressed and pushed at once.

    Args:
        friction: Coulomb's mu.
        penalty: pressure over penetration.
        stick_slope: friction over slip, as long as it sticks.
    """

    friction: float = 0.3
    penalty: float = 1e6
    stick_slope: float = 1e5

    # so small that changes of shape, which it follows, do not count
    pressure, push = 0.1, (0.02, 0.01)

    def deck(self) -> str:
        """The input file."""
        middle = tuple((a + b) / 2 for a, b in zip(self.grid.lower, self.grid.upper, strict=True))
        side = self.on(0, self.grid.lower[0])
        return text(
            [
                *self.body(),
                *bricks(self, [(*middle[:2], self.grid.lower[2])], 2 * max(self.grid.upper)),
                "*SURFACE,NAME=LOWER",
                *(f"{k},S{face}" for k, face in self.grid.faces_where(self.bottom)),
                f"*SURFACE,NAME=FACE\n{len(self.grid.elements) + 1},S2",
                "*CONTACT PAIR,INTERACTION=TOUCH,TYPE=SURFACE TO SURFACE\nLOWER,FACE",
                *law(self.penalty, self.friction, self.stick_slope),
                "*BOUNDARY\nRIGID,1,3\n*STEP\n*STATIC\n1.,1.",
                *self.pressed(self.top, self.pressure),
                *self.pushed(side, self.push),
                "*NODE PRINT,NSET=ALL\nU\n*NODE PRINT,NSET=RIGID\nRF\n*END STEP",
            ]
        )

    def numbers(self, printed: str) -> dict[str, Array]:
        """Displacements of all nodes, and the force on the rigid face."""
        moved = tables(printed, "displacements")[-1][:, 1:]
        force = tables(printed, "forces")[-1][:, 1:]
        return {"displacement": moved.ravel(), "force": force.sum(axis=0)}

    def pushed(self, where: Where, traction: tuple[float, float]) -> list[str]:
        """Lines of a traction along x and y, as forces on mid-side nodes: corners get none."""
        force: dict[int, float] = {}
        nodes = [np.array(place) for place in self.grid.nodes]
        for k, number in self.grid.faces_where(where):
            a, b, c = (nodes[node - 1] for node in self.grid.face(k, number)[:3])
            area = float(np.linalg.norm(np.cross(b - a, c - a))) / 2
            for node in self.grid.face(k, number)[3:]:
                force[node] = force.get(node, 0.0) + area / 3
        return [
            "*CLOAD",
            *(
                f"{node},{axis},{digits([size * part])}"
                for node, part in force.items()
                for axis, size in enumerate(traction, start=1)
            ),
        ]


def bricks(body: Specimen, places: list[tuple[float, ...]], reach: float) -> list[str]:
    """Lines of fixed bricks, numbered after the body, with a place in the middle of each's top."""
    first, count = len(body.grid.nodes) + 1, len(body.grid.elements)
    around = [(-reach, -reach), (reach, -reach), (reach, reach), (-reach, reach)]
    nodes: list[str] = []
    elements = []
    for k, place in enumerate(places):
        x, y, z = (*place, 0.0)[:3]
        for below, (a, b) in product((1.0, 0.0), around):
            corner = (x + a, y + b, z - below) if body.dimension == 3 else (x + a, y - below, z - b)
            nodes.append(f"{first + len(nodes)},{digits(corner)}")
        elements.append(row([count + 1 + k, *range(first + 8 * k, first + 8 * k + 8)]))
    section = "*SOLID SECTION,ELSET=BRICKS,MATERIAL=ELASTIC"
    return ["*NODE,NSET=RIGID", *nodes, "*ELEMENT,TYPE=C3D8,ELSET=BRICKS", *elements, section]


def law(penalty: float, friction: float, stick_slope: float) -> list[str]:
    """Lines of the contact law TOUCH; open nodes pull far less than closed ones press."""
    return [
        "*SURFACE INTERACTION,NAME=TOUCH\n*SURFACE BEHAVIOR,PRESSURE-OVERCLOSURE=LINEAR",
        f"{penalty!r},1e-9",
        *([f"*FRICTION\n{friction!r},{stick_slope!r}"] if friction else []),
    ]


def lines(nodes: list[int]) -> str:
    """Nodes in lines of sixteen, which is as many as CalculiX reads."""
    return "\n".join(row(nodes[k : k + 16]) for k in range(0, len(nodes), 16))


def digits(values: Iterable[float]) -> str:
    """Part of a line, with as many digits as always fit in the characters that CalculiX reads."""
    return ",".join(f"{value:.12g}" for value in values)


_RING = Grid("T6", (0.5, 0.0), (1.5, 2.0), (3, 6))
_CYLINDER = Grid("T6", (0.0, 0.0), (2.0, 1.0), (8, 4))
_COLUMN = Grid("T6", (-0.5, 0.0), (0.5, 4.0), (2, 8))
_BOX = Grid("T10", (0.0, 0.0, 0.0), (2.0, 1.0, 1.5), (4, 2, 3))
_BARREL = Grid("T10", (0.0, 0.0, 0.0), (2.0, 1.0, 1.5), (4, 2, 3), bulge=0.2)
_BLOCK = Grid("T10", (0.0, 0.0, 0.0), (2.0, 1.0, 1.0), (4, 2, 2))


def _squares(grid: Grid) -> Grid:
    """The same rectangle of 8-node quadrilaterals."""
    return Grid("Q8", grid.lower, grid.upper, grid.divisions)


AnySpecimen = Compressed | Vibrating | Buckling | Resting | RoughBlock

SPECIMENS: dict[str, AnySpecimen] = {
    "statics-CAX6": Compressed("CAX6", _RING),
    "statics-CAX8": Compressed("CAX8", _squares(_RING)),
    "statics-C3D10": Compressed("C3D10", _BOX),
    "statics-C3D10-curved": Compressed("C3D10", _BARREL),
    "frequencies-CAX6": Vibrating("CAX6", _RING),
    "frequencies-CAX8": Vibrating("CAX8", _squares(_RING)),
    "frequencies-C3D10": Vibrating("C3D10", _BOX),
    "frequencies-C3D10-curved": Vibrating("C3D10", _BARREL),
    "buckling-CPE6": Buckling("CPE6", _COLUMN),
    "buckling-CPE8": Buckling("CPE8", _squares(_COLUMN)),
    "buckling-CPS6": Buckling("CPS6", _COLUMN),
    "buckling-CPS6-thin": Buckling("CPS6", _COLUMN, thickness=0.01),
    "contact-CAX6": Resting("CAX6", _CYLINDER),
    "contact-CAX8": Resting("CAX8", _squares(_CYLINDER)),
    "contact-C3D10": Resting("C3D10", _BLOCK),
    "contact-C3D10-friction": Resting("C3D10", _BLOCK, 0.3, 0.1, penalty=5e8),
    "contact-C3D10-friction-soft": Resting("C3D10", _BLOCK, 0.3, 0.1, 5e8, stick_slope=1e6),
    "contact-C3D10-surface": RoughBlock("C3D10", _BLOCK),
    "contact-C3D10-surface-stiff": RoughBlock("C3D10", _BLOCK, penalty=1e7, stick_slope=1e6),
}
