"""CalculiX decks of the study's problems, on the study's meshes; needs no DOLFINx.

Keywords: G. Dhondt, "CalculiX CrunchiX User's Manual", version 2.20.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import product

# Faces of the two triangles of a square, by the side of the square that they lie on
BOTTOM, RIGHT, TOP, LEFT = 1, 2, 2, 3


@dataclass(frozen=True)
class TrianglePairs:
    """Rectangle of squares, each cut from lower left to upper right into two 6-node triangles.

    Nodes and elements count from 1 and along x first; a square's lower triangle comes first.
    """

    lower: tuple[float, float]
    upper: tuple[float, float]
    divisions: tuple[int, int]

    @cached_property
    def nodes(self) -> list[tuple[float, float]]:
        """Coordinates; node k is entry k - 1."""
        (x0, y0), (x1, y1), (nx, ny) = self.lower, self.upper, self.divisions
        return [
            (x0 + (x1 - x0) * i / (2 * nx), y0 + (y1 - y0) * j / (2 * ny))
            for j in range(2 * ny + 1)
            for i in range(2 * nx + 1)
        ]

    @cached_property
    def elements(self) -> list[list[int]]:
        """Corner nodes counterclockwise, then the middles of the sides that start at them."""
        nx, ny = self.divisions
        cells = []
        for j, i in product(range(0, 2 * ny, 2), range(0, 2 * nx, 2)):
            for b, c in (((2, 0), (2, 2)), ((2, 2), (0, 2))):
                corners = [(i, j), (i + b[0], j + b[1]), (i + c[0], j + c[1])]
                around = zip(corners, [*corners[1:], corners[0]], strict=True)
                middles = [((p[0] + q[0]) // 2, (p[1] + q[1]) // 2) for p, q in around]
                cells.append([self.node(*place) for place in corners + middles])
        return cells

    def node(self, i: int, j: int) -> int:
        """Number of the node in column i and row j, both from 0."""
        return j * (2 * self.divisions[0] + 1) + i + 1

    def row(self, j: int) -> list[int]:
        """Nodes of row j from left to right; 0 is the lower side."""
        return [self.node(i, j) for i in range(2 * self.divisions[0] + 1)]

    def column(self, i: int) -> list[int]:
        """Nodes of column i from bottom to top; 0 is the left side."""
        return [self.node(i, j) for j in range(2 * self.divisions[1] + 1)]

    def bottom(self) -> list[int]:
        """Elements along the lower side; their face is `BOTTOM`."""
        return [2 * i + 1 for i in range(self.divisions[0])]

    def top(self, start: float, end: float) -> list[int]:
        """Elements along the upper side whose squares lie in start <= x <= end; face `TOP`."""
        nx, ny = self.divisions
        side = (self.upper[0] - self.lower[0]) / nx
        first, last = (round((x - self.lower[0]) / side) for x in (start, end))
        return [2 * (nx * (ny - 1) + i) + 2 for i in range(first, last)]

    def right(self) -> list[int]:
        """Elements along the right side; their face is `RIGHT`."""
        nx, ny = self.divisions
        return [2 * (nx * j + nx - 1) + 1 for j in range(ny)]

    def left(self) -> list[int]:
        """Elements along the left side; their face is `LEFT`."""
        nx, ny = self.divisions
        return [2 * nx * j + 2 for j in range(ny)]

    def body(self, element: str, modulus: float, ratio: float, thickness: float) -> list[str]:
        """Lines of nodes, elements, material and section."""
        return [
            "*NODE",
            *(f"{k},{x!r},{y!r},0." for k, (x, y) in enumerate(self.nodes, start=1)),
            f"*ELEMENT,TYPE={element},ELSET=BODY",
            *(row([k, *cell]) for k, cell in enumerate(self.elements, start=1)),
            f"*MATERIAL,NAME=ELASTIC\n*ELASTIC\n{modulus!r},{ratio!r}",
            f"*SOLID SECTION,ELSET=BODY,MATERIAL=ELASTIC\n{thickness!r}",
        ]


@dataclass(frozen=True)
class TwoTriangles:
    """Section 7.1: unit square under unit pressure, reactions of its lower side."""

    mesh = TrianglePairs((0.0, 0.0), (1.0, 1.0), (1, 1))

    def deck(self) -> str:
        """The input file."""
        mesh = self.mesh
        lower = mesh.row(0)
        return text(
            [
                *mesh.body("CPS6", 1.0, 0.3, 1.0),
                f"*NSET,NSET=SUPPORT\n{row(lower)}",
                f"*BOUNDARY\nSUPPORT,2,2\n{lower[0]},1,1",
                "*STEP\n*STATIC",
                *distributed(mesh.top(0.0, 1.0), TOP, 1.0),
                "*NODE PRINT,NSET=SUPPORT\nRF\n*END STEP",
            ]
        )


@dataclass(frozen=True)
class Block:
    """Section 7.2: block on a rigid surface, pressed from above and pulled at its right side.

    Node-to-surface contact, with a fixed brick of its own below each node: what the brick
    carries is the node's contact force, and the penalty is the same for all nodes. CalculiX
    follows displacements; the loads are small, so that they do not count, and the forces are
    scaled back: without gaps they are proportional to the loads.

    Args:
        element: CPS6 is CalculiX's plane stress, whose thickness strain is a field of its own.
            CPE6 with the constants below is plane stress exactly.
        thickness: of the block.
        friction: Coulomb's mu, the same everywhere.
        pull: traction on the right side over the pressure.
        pressed: part of the upper side that the pressure acts on.
    """

    element: str = "CPE6"
    thickness: float = 1.0
    friction: float = 0.0
    pull: float = 0.0
    pressed: tuple[float, float] = (0.0, 4.0)

    mesh = TrianglePairs((0.0, 0.0), (4.0, 2.0), (20, 10))
    modulus, ratio, pressure = 1000.0, 0.3, 200.0
    increments = 10
    scale = 1e-3
    # Penalty and stick slope, per area of a brick's face; friction converges with no larger ones
    penalty, stick_slope = 5e7, 1e6
    # Tension of open nodes, per area, far below the contact pressure
    tension = 1e-9

    @property
    def contact_nodes(self) -> list[int]:
        """Nodes of the lower side from left to right."""
        return self.mesh.row(0)

    def bricks(self) -> list[list[int]]:
        """Nodes of the rigid brick below each contact node, its upper face last."""
        first = len(self.mesh.nodes) + 1
        return [list(range(first + 8 * k, first + 8 * k + 8)) for k in range(self._count)]

    @property
    def _count(self) -> int:
        return len(self.contact_nodes)

    def deck(self) -> str:
        """The input file."""
        mesh, middle = self.mesh, self.mesh.node(self.mesh.divisions[0], 0)
        held = [] if self.friction else [f"{middle},1,1"]
        return text(
            [
                *mesh.body(self.element, *self._constants(), self.thickness),
                *self._rigid(),
                *self._contact(),
                "*BOUNDARY\nRIGID,1,3",
                *held,
                *self._loads(),
                "*NODE PRINT,NSET=RIGID\nRF\n*END STEP",
            ]
        )

    def _constants(self) -> tuple[float, float]:
        """Modulus and ratio that make the element's state the plane stress of the example."""
        nu = self.ratio
        if self.element == "CPS6":
            return self.modulus, nu
        return self.modulus * (1 + 2 * nu) / (1 + nu) ** 2, nu / (1 + nu)

    def _rigid(self) -> list[str]:
        reach = 2 * self.mesh.nodes[1][0]
        places, elements = [], []
        for k, (node, brick) in enumerate(zip(self.contact_nodes, self.bricks(), strict=True)):
            x, y = self.mesh.nodes[node - 1]
            corners = product((y - 1.0, y), ((-1, -1), (-1, 1), (1, 1), (1, -1)))
            places += [
                f"{number},{x + reach * a!r},{height!r},{float(b)!r}"
                for number, (height, (a, b)) in zip(brick, corners, strict=True)
            ]
            elements.append(row([len(self.mesh.elements) + 1 + k, *brick]))
        section = "*SOLID SECTION,ELSET=BRICKS,MATERIAL=ELASTIC"
        bricks = ["*ELEMENT,TYPE=C3D8,ELSET=BRICKS", *elements, section]
        return ["*NODE,NSET=RIGID", *places, *bricks]

    def _contact(self) -> list[str]:
        lines = []
        for k, node in enumerate(self.contact_nodes):
            lines += [
                f"*SURFACE,NAME=NODE{k},TYPE=NODE\n{node}",
                f"*SURFACE,NAME=FACE{k}\n{len(self.mesh.elements) + 1 + k},S2",
                f"*CONTACT PAIR,INTERACTION=TOUCH,TYPE=NODE TO SURFACE\nNODE{k},FACE{k}",
            ]
        lines += self._law(self.penalty)
        if self.friction:
            lines.append(f"*FRICTION\n{self.friction!r},{self.stick_slope!r}")
        return lines

    def _law(self, penalty: float) -> list[str]:
        return [
            "*SURFACE INTERACTION,NAME=TOUCH\n*SURFACE BEHAVIOR,PRESSURE-OVERCLOSURE=LINEAR",
            f"{penalty!r},{self.tension!r}",
        ]

    def _loads(self) -> list[str]:
        """Pressure, then pull, in one step: a new step would relax the penetration of the last."""
        pressure = self.scale * self.pressure
        pressed = self.mesh.top(*self.pressed)
        if not self.pull:
            return ["*STEP\n*STATIC\n1.,1.", *distributed(pressed, TOP, pressure)]
        return [
            "*AMPLITUDE,NAME=PRESS\n0.,0.,1.,1.,2.,1.",
            "*AMPLITUDE,NAME=PULL\n0.,0.,1.,0.,2.,1.",
            f"*STEP\n*STATIC,DIRECT\n{1 / self.increments!r},2.",
            *distributed(pressed, TOP, pressure, ",AMPLITUDE=PRESS"),
            *distributed(self.mesh.right(), RIGHT, -self.pull * pressure, ",AMPLITUDE=PULL"),
        ]


@dataclass(frozen=True)
class NativePressure(Block):
    """The block under even pressure, with contact as users set it up: whole lower side on a face.

    What CalculiX calls the contact pressure of a node is its force over the area that the program
    gives to it.
    """

    penalty = 1e7

    def _rigid(self) -> list[str]:
        (x0, y), (x1, _) = (self.mesh.nodes[k - 1] for k in self.mesh.row(0)[:: self._count - 1])
        corners = product(
            (y - 1.0, y), ((x0 - 1, -1.0), (x0 - 1, 1.0), (x1 + 1, 1.0), (x1 + 1, -1.0))
        )
        brick = self.bricks()[0]
        return [
            "*NODE,NSET=RIGID",
            *(f"{k},{x!r},{y!r},{z!r}" for k, (y, (x, z)) in zip(brick, corners, strict=True)),
            f"*ELEMENT,TYPE=C3D8,ELSET=BRICKS\n{row([len(self.mesh.elements) + 1, *brick])}",
            "*SOLID SECTION,ELSET=BRICKS,MATERIAL=ELASTIC",
        ]

    def _contact(self) -> list[str]:
        return [
            "*SURFACE,NAME=LOWER",
            *(f"{element},S{BOTTOM}" for element in self.mesh.bottom()),
            f"*SURFACE,NAME=FACE\n{len(self.mesh.elements) + 1},S2",
            "*CONTACT PAIR,INTERACTION=TOUCH,TYPE=NODE TO SURFACE\nLOWER,FACE",
            *self._law(self.penalty),
        ]

    def deck(self) -> str:
        """The input file."""
        return super().deck().replace("*END STEP", "*CONTACT PRINT\nCSTR\n*END STEP")


@dataclass(frozen=True)
class HalfBeam:
    """Section 7.6: half beam under uniform load, v = 0 on the whole end face.

    Args:
        divisions: squares along and across.
        mode: 1 with the symmetric supports, 2 with the antisymmetric ones.
    """

    divisions: tuple[int, int]
    mode: int

    modulus, ratio, thickness = 2.07e11, 0.0, 0.1
    length, height = 8.0, 1.0
    # Nominal stress in Pa: the factors become 2.5 and 9, of which seven digits are printed
    stress = 1e9

    @property
    def mesh(self) -> TrianglePairs:
        """Half of the beam, its end face left."""
        y = self.height / 2
        return TrianglePairs((0.0, -y), (self.length / 2, y), self.divisions)

    def deck(self) -> str:
        """The input file."""
        mesh, (nx, ny) = self.mesh, self.divisions
        middle = mesh.column(2 * nx)
        supports = [(k, 2) for k in mesh.column(0)]
        loads = distributed(mesh.left(), LEFT, self.stress)
        if self.mode == 1:
            supports += [(k, 1) for k in middle]
        else:
            supports += [(middle[ny], 1), *((k, 2) for k in middle)]
            loads += distributed(mesh.right(), RIGHT, self.stress)
        return text(
            [
                *mesh.body("CPS6", self.modulus, self.ratio, self.thickness),
                "*BOUNDARY",
                *(f"{node},{axis},{axis}" for node, axis in supports),
                "*STEP\n*BUCKLE\n1,1e-8",
                *loads,
                "*NODE FILE\nU\n*END STEP",
            ]
        )


def distributed(elements: list[int], face: int, size: float, parameters: str = "") -> list[str]:
    """Lines of a pressure on one and the same face of some elements."""
    return [f"*DLOAD{parameters}", *(f"{element},P{face},{size!r}" for element in elements)]


def row(numbers: Iterable[float]) -> str:
    """One line of numbers."""
    return ",".join(map(str, numbers))


def text(lines: list[str]) -> str:
    """The lines as a file."""
    return "\n".join(lines) + "\n"
