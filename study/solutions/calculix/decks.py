"""CalculiX decks of the problems of sections 7.1, 7.2 and 7.6, on the same meshes.

Needs no DOLFINx.

Keywords: G. Dhondt, "CalculiX CrunchiX User's Manual", version 2.20.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from study.solutions.calculix.output import Array, CalculixError, read_tables

BOTTOM_FACE, RIGHT_FACE, TOP_FACE, LEFT_FACE = 1, 2, 2, 3
"""Numbers of the faces of a square's two triangles that lie on the sides of the square."""


@dataclass(frozen=True)
class TrianglePairs:
    """Rectangle of squares, each cut from lower left to upper right into two 6-node triangles.

    Nodes and elements are numbered from 1, along x first; a square's lower triangle comes first.
    """

    lower: tuple[float, float]
    upper: tuple[float, float]
    divisions: tuple[int, int]

    @cached_property
    def nodes(self) -> list[tuple[float, float]]:
        """Coordinates of the nodes; node k is entry k - 1."""
        (x0, y0), (x1, y1), (nx, ny) = self.lower, self.upper, self.divisions
        return [
            (x0 + (x1 - x0) * i / (2 * nx), y0 + (y1 - y0) * j / (2 * ny))
            for j in range(2 * ny + 1)
            for i in range(2 * nx + 1)
        ]

    @cached_property
    def elements(self) -> list[list[int]]:
        """Nodes of the elements: corners counterclockwise, then mid-side nodes."""
        nx, ny = self.divisions
        cells = []
        for j, i in product(range(0, 2 * ny, 2), range(0, 2 * nx, 2)):
            for b, c in (((2, 0), (2, 2)), ((2, 2), (0, 2))):
                corners = [(i, j), (i + b[0], j + b[1]), (i + c[0], j + c[1])]
                around = zip(corners, [*corners[1:], corners[0]], strict=True)
                middles = [((p[0] + q[0]) // 2, (p[1] + q[1]) // 2) for p, q in around]
                cells.append([self.node_number(*index) for index in corners + middles])
        return cells

    def node_number(self, i: int, j: int) -> int:
        """Return the number of the node in column i and row j, both from 0."""
        return j * (2 * self.divisions[0] + 1) + i + 1

    def row_nodes(self, j: int) -> list[int]:
        """Return the nodes of row j from left to right; 0 is the lower side."""
        return [self.node_number(i, j) for i in range(2 * self.divisions[0] + 1)]

    def column_nodes(self, i: int) -> list[int]:
        """Return the nodes of column i from bottom to top; 0 is the left side."""
        return [self.node_number(i, j) for j in range(2 * self.divisions[1] + 1)]

    def bottom_elements(self) -> list[int]:
        """Return the elements along the lower side; their face there is `BOTTOM_FACE`."""
        return [2 * i + 1 for i in range(self.divisions[0])]

    def top_elements(self, start: float, end: float) -> list[int]:
        """Return the elements along the upper side in start <= x <= end; face `TOP_FACE`."""
        nx, ny = self.divisions
        square = (self.upper[0] - self.lower[0]) / nx
        first, last = (round((x - self.lower[0]) / square) for x in (start, end))
        return [2 * (nx * (ny - 1) + i) + 2 for i in range(first, last)]

    def right_elements(self) -> list[int]:
        """Return the elements along the right side; their face there is `RIGHT_FACE`."""
        nx, ny = self.divisions
        return [2 * (nx * j + nx - 1) + 1 for j in range(ny)]

    def left_elements(self) -> list[int]:
        """Return the elements along the left side; their face there is `LEFT_FACE`."""
        nx, ny = self.divisions
        return [2 * nx * j + 2 for j in range(ny)]

    def body_lines(self, element: str, modulus: float, ratio: float, thickness: float) -> list[str]:
        """Return the lines of nodes, elements, material and section."""
        return [
            "*NODE",
            *(f"{k},{x!r},{y!r},0." for k, (x, y) in enumerate(self.nodes, start=1)),
            f"*ELEMENT,TYPE={element},ELSET=BODY",
            *(join_numbers([k, *cell]) for k, cell in enumerate(self.elements, start=1)),
            f"*MATERIAL,NAME=ELASTIC\n*ELASTIC\n{modulus!r},{ratio!r}",
            f"*SOLID SECTION,ELSET=BODY,MATERIAL=ELASTIC\n{thickness!r}",
        ]


@dataclass(frozen=True)
class TwoTriangles:
    """Unit square under unit pressure (section 7.1), for the reactions of its lower side."""

    mesh = TrianglePairs((0.0, 0.0), (1.0, 1.0), (1, 1))

    def deck(self) -> str:
        """Return the input file."""
        mesh = self.mesh
        lower = mesh.row_nodes(0)
        return join_lines(
            [
                *mesh.body_lines("CPS6", 1.0, 0.3, 1.0),
                f"*NSET,NSET=SUPPORT\n{join_numbers(lower)}",
                f"*BOUNDARY\nSUPPORT,2,2\n{lower[0]},1,1",
                "*STEP\n*STATIC",
                *pressure_lines(mesh.top_elements(0.0, 1.0), TOP_FACE, 1.0),
                "*NODE PRINT,NSET=SUPPORT\nRF\n*END STEP",
            ]
        )

    def read_numbers(self, output: str) -> dict[str, Array]:
        """Return the reactions of the lower side, and their positions."""
        (forces,) = read_tables(output, "forces")
        x = [self.mesh.nodes[int(node) - 1][0] for node in forces[:, 0]]
        return {"x": np.array(x), "reaction": forces[:, 2]}


@dataclass(frozen=True)
class Block:
    """Block on a rigid surface, pressed from above and pulled at its right side (section 7.2).

    Contact is node-to-surface, with a separate fixed brick below each node: the force on the brick
    is the contact force of the node, and the penalty is the same for all nodes. CalculiX takes
    changes of geometry into account, so the loads are made small and the forces are scaled back;
    without initial gaps they are proportional to the loads.

    Args:
        element: "CPS6" is CalculiX's plane stress, with an independent field of thickness strains.
            "CPE6" with the constants of `_elastic_constants` is plane stress exactly.
        thickness: Thickness of the block.
        friction: Coulomb's coefficient, the same everywhere.
        pull: Traction on the right side, divided by the pressure.
        pressed: Ends of the part of the upper side on which the pressure acts.
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
    # Penalty and stick slope, times the area of a brick's face; with larger values friction does
    # not converge
    penalty, stick_slope = 5e7, 1e6
    # Tension at open nodes, far below the contact pressure
    tension = 1e-9

    @property
    def contact_nodes(self) -> list[int]:
        """Nodes of the lower side from left to right."""
        return self.mesh.row_nodes(0)

    def brick_nodes(self) -> list[list[int]]:
        """Return the nodes of the brick below each contact node, its upper face last."""
        first = len(self.mesh.nodes) + 1
        return [list(range(first + 8 * k, first + 8 * k + 8)) for k in range(self._n_contact_nodes)]

    @property
    def _n_contact_nodes(self) -> int:
        return len(self.contact_nodes)

    def deck(self) -> str:
        """Return the input file."""
        mesh, middle = self.mesh, self.mesh.node_number(self.mesh.divisions[0], 0)
        side_support = [] if self.friction else [f"{middle},1,1"]
        return join_lines(
            [
                *mesh.body_lines(self.element, *self._elastic_constants(), self.thickness),
                *self._brick_lines(),
                *self._contact_lines(),
                "*BOUNDARY\nRIGID,1,3",
                *side_support,
                *self._load_lines(),
                "*NODE PRINT,NSET=RIGID\nRF\n*END STEP",
            ]
        )

    def read_numbers(self, output: str) -> dict[str, Array]:
        """Return the contact forces of the last increment, and the positions of their nodes.

        The force of a node is the sum over the spatial nodes of its brick.
        """
        last_table = read_tables(output, "forces")[-1]
        force = {int(line[0]): line[1:] for line in last_table}
        sums = np.array([sum(force[node] for node in brick) for brick in self.brick_nodes()])
        scaled = sums / (self.scale * self.thickness)
        numbers = {"x": self._contact_positions(), "force_normal": scaled[:, 1]}
        return numbers | ({"force_tangential": scaled[:, 0]} if self.friction else {})

    def _contact_positions(self) -> Array:
        return np.array([self.mesh.nodes[node - 1][0] for node in self.contact_nodes])

    def _elastic_constants(self) -> tuple[float, float]:
        """Return the Young's modulus and Poisson's ratio that give the element plane stress."""
        nu = self.ratio
        if self.element == "CPS6":
            return self.modulus, nu
        return self.modulus * (1 + 2 * nu) / (1 + nu) ** 2, nu / (1 + nu)

    def _brick_lines(self) -> list[str]:
        half_width = 2 * self.mesh.nodes[1][0]
        nodes, elements = [], []
        for k, (node, brick) in enumerate(zip(self.contact_nodes, self.brick_nodes(), strict=True)):
            x, y = self.mesh.nodes[node - 1]
            corners = product((y - 1.0, y), ((-1, -1), (-1, 1), (1, 1), (1, -1)))
            nodes += [
                f"{number},{x + half_width * a!r},{height!r},{float(b)!r}"
                for number, (height, (a, b)) in zip(brick, corners, strict=True)
            ]
            elements.append(join_numbers([len(self.mesh.elements) + 1 + k, *brick]))
        section = "*SOLID SECTION,ELSET=BRICKS,MATERIAL=ELASTIC"
        bricks = ["*ELEMENT,TYPE=C3D8,ELSET=BRICKS", *elements, section]
        return ["*NODE,NSET=RIGID", *nodes, *bricks]

    def _contact_lines(self) -> list[str]:
        lines = []
        for k, node in enumerate(self.contact_nodes):
            lines += [
                f"*SURFACE,NAME=NODE{k},TYPE=NODE\n{node}",
                f"*SURFACE,NAME=FACE{k}\n{len(self.mesh.elements) + 1 + k},S2",
                f"*CONTACT PAIR,INTERACTION=TOUCH,TYPE=NODE TO SURFACE\nNODE{k},FACE{k}",
            ]
        lines += self._contact_law_lines(self.penalty)
        if self.friction:
            lines.append(f"*FRICTION\n{self.friction!r},{self.stick_slope!r}")
        return lines

    def _contact_law_lines(self, penalty: float) -> list[str]:
        return [
            "*SURFACE INTERACTION,NAME=TOUCH\n*SURFACE BEHAVIOR,PRESSURE-OVERCLOSURE=LINEAR",
            f"{penalty!r},{self.tension!r}",
        ]

    def _load_lines(self) -> list[str]:
        """Return the lines of pressure and pull, in one step, as a new one relaxes penetration."""
        pressure = self.scale * self.pressure
        pressed = self.mesh.top_elements(*self.pressed)
        if not self.pull:
            return ["*STEP\n*STATIC\n1.,1.", *pressure_lines(pressed, TOP_FACE, pressure)]
        return [
            "*AMPLITUDE,NAME=PRESS\n0.,0.,1.,1.,2.,1.",
            "*AMPLITUDE,NAME=PULL\n0.,0.,1.,0.,2.,1.",
            f"*STEP\n*STATIC,DIRECT\n{1 / self.increments!r},2.",
            *pressure_lines(pressed, TOP_FACE, pressure, ",AMPLITUDE=PRESS"),
            *pressure_lines(
                self.mesh.right_elements(), RIGHT_FACE, -self.pull * pressure, ",AMPLITUDE=PULL"
            ),
        ]


@dataclass(frozen=True)
class BlockWithPrintedContactPressure(Block):
    """Block under uniform pressure with contact as users set it up: its lower side on one face.

    The contact pressure that CalculiX prints is a nodal force divided by an area of its choice.
    """

    penalty = 1e7

    def _brick_lines(self) -> list[str]:
        (x0, y), (x1, _) = (
            self.mesh.nodes[k - 1] for k in self.mesh.row_nodes(0)[:: self._n_contact_nodes - 1]
        )
        corners = product(
            (y - 1.0, y), ((x0 - 1, -1.0), (x0 - 1, 1.0), (x1 + 1, 1.0), (x1 + 1, -1.0))
        )
        brick = self.brick_nodes()[0]
        return [
            "*NODE,NSET=RIGID",
            *(f"{k},{x!r},{y!r},{z!r}" for k, (y, (x, z)) in zip(brick, corners, strict=True)),
            "*ELEMENT,TYPE=C3D8,ELSET=BRICKS",
            join_numbers([len(self.mesh.elements) + 1, *brick]),
            "*SOLID SECTION,ELSET=BRICKS,MATERIAL=ELASTIC",
        ]

    def _contact_lines(self) -> list[str]:
        return [
            "*SURFACE,NAME=LOWER",
            *(f"{element},S{BOTTOM_FACE}" for element in self.mesh.bottom_elements()),
            f"*SURFACE,NAME=FACE\n{len(self.mesh.elements) + 1},S2",
            "*CONTACT PAIR,INTERACTION=TOUCH,TYPE=NODE TO SURFACE\nLOWER,FACE",
            *self._contact_law_lines(self.penalty),
        ]

    def deck(self) -> str:
        """Return the input file."""
        return super().deck().replace("*END STEP", "*CONTACT PRINT\nCSTR\n*END STEP")

    def read_numbers(self, output: str) -> dict[str, Array]:
        """Return contact pressures of plane nodes, each the mean over the node's spatial nodes.

        CalculiX reserves three numbers for the spatial nodes of each plane node, in the order of
        the plane nodes. A corner has all three spatial nodes, a mid-side node only the outer two.

        Raises:
            CalculixError: If the numbers of spatial nodes differ from these.
        """
        (spatial,) = read_tables(output, "contact stress")
        number = spatial[:, 0].astype(int)
        plane_node = (number - number.min()) // 3
        counts = np.bincount(plane_node)
        expected = np.where(np.arange(len(self.contact_nodes)) % 2 == 0, 3, 2)
        if not np.array_equal(counts, expected):
            raise CalculixError(
                f"contact nodes have {counts.tolist()} spatial nodes, expected 3, 2, 3, 2, ... 3"
            )
        pressure = np.bincount(plane_node, spatial[:, 1]) / counts / self.scale
        return {"x": self._contact_positions(), "pressure": pressure.astype(np.float64)}


@dataclass(frozen=True)
class HalfBeam:
    """Half beam under a uniform load, with v = 0 on the whole end face (section 7.6).

    Args:
        divisions: Numbers of squares along and across the beam.
        mode: 1 for symmetric supports, 2 for antisymmetric ones.
    """

    divisions: tuple[int, int]
    mode: int

    modulus, ratio, thickness = 2.07e11, 0.0, 0.1
    length, height = 8.0, 1.0
    # Nominal stress in Pa; with it the buckling factors are about 2.5 and 9, of which seven digits
    # are printed
    stress = 1e9

    @property
    def mesh(self) -> TrianglePairs:
        """Mesh of half of the beam, whose end face is on the left."""
        y = self.height / 2
        return TrianglePairs((0.0, -y), (self.length / 2, y), self.divisions)

    def deck(self) -> str:
        """Return the input file."""
        mesh, (nx, ny) = self.mesh, self.divisions
        middle = mesh.column_nodes(2 * nx)
        supports = [(k, 2) for k in mesh.column_nodes(0)]
        loads = pressure_lines(mesh.left_elements(), LEFT_FACE, self.stress)
        if self.mode == 1:
            supports += [(k, 1) for k in middle]
        else:
            supports += [(middle[ny], 1), *((k, 2) for k in middle)]
            loads += pressure_lines(mesh.right_elements(), RIGHT_FACE, self.stress)
        return join_lines(
            [
                *mesh.body_lines("CPS6", self.modulus, self.ratio, self.thickness),
                "*BOUNDARY",
                *(f"{node},{axis},{axis}" for node, axis in supports),
                "*STEP\n*BUCKLE\n1,1e-8",
                *loads,
                "*NODE FILE\nU\n*END STEP",
            ]
        )

    def read_numbers(self, output: str) -> dict[str, Array]:
        """Return the critical stress."""
        (factors,) = read_tables(output, "FACTOR")
        return {"critical_stress": self.stress * factors[:, 1]}


def pressure_lines(
    elements: list[int], face: int, pressure: float, parameters: str = ""
) -> list[str]:
    """Return the lines of a pressure on the same face of some elements."""
    return [f"*DLOAD{parameters}", *(f"{element},P{face},{pressure!r}" for element in elements)]


def join_numbers(numbers: Iterable[float]) -> str:
    """Return one line of numbers."""
    return ",".join(map(str, numbers))


def join_lines(lines: list[str]) -> str:
    """Return the lines as the text of a file."""
    return "\n".join(lines) + "\n"


def round_to_12_digits(number: float) -> float:
    """Return a number with 12 digits, which fits in the 20 characters that CalculiX reads."""
    return float(f"{number:.12g}")
