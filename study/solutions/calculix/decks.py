"""CalculiX decks of the problems of sections 7.1, 7.2 and 7.6, on the same meshes.

This module does not need DOLFINx.

Keywords: G. Dhondt, "CalculiX CrunchiX User's Manual", version 2.20.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from study.solutions.calculix.output import Array, CalculixError, read_tables_below_heading

BOTTOM_FACE, RIGHT_FACE, TOP_FACE, LEFT_FACE = 1, 2, 2, 3
"""CalculiX numbers of the triangle faces that lie on the sides of a square of two triangles."""


@dataclass(frozen=True)
class RectangleOfTrianglePairs:
    """Rectangular mesh of squares, each divided into two 6-node triangles.

    The common edge of the two triangles goes from lower left to upper right. Nodes and elements are
    numbered from 1, along x first; the lower triangle of a square precedes the upper one.

    Args:
        lower: Lower left corner.
        upper: Upper right corner.
        divisions: Numbers of squares along x and y.
    """

    lower: tuple[float, float]
    upper: tuple[float, float]
    divisions: tuple[int, int]

    @cached_property
    def nodes(self) -> list[tuple[float, float]]:
        """Coordinates (x, y) of the nodes; node k is entry k - 1."""
        (x0, y0), (x1, y1), (nx, ny) = self.lower, self.upper, self.divisions
        return [
            (x0 + (x1 - x0) * i / (2 * nx), y0 + (y1 - y0) * j / (2 * ny))
            for j in range(2 * ny + 1)
            for i in range(2 * nx + 1)
        ]

    @cached_property
    def elements(self) -> list[list[int]]:
        """Node numbers of the elements: corners counterclockwise, then mid-side nodes."""
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
        """Return the number of the node in column i and row j, which are counted from 0."""
        return j * (2 * self.divisions[0] + 1) + i + 1

    def nodes_in_row(self, j: int) -> list[int]:
        """Return the numbers of the nodes in row j from left to right; 0 is the lower side."""
        return [self.node_number(i, j) for i in range(2 * self.divisions[0] + 1)]

    def nodes_in_column(self, i: int) -> list[int]:
        """Return the numbers of the nodes in column i from bottom to top; 0 is the left side."""
        return [self.node_number(i, j) for j in range(2 * self.divisions[1] + 1)]

    def elements_along_lower_side(self) -> list[int]:
        """Return the elements whose face `BOTTOM_FACE` is on the lower side."""
        return [2 * i + 1 for i in range(self.divisions[0])]

    def elements_along_upper_side(self, start_x: float, end_x: float) -> list[int]:
        """Return the elements whose face `TOP_FACE` is on the upper side, for start <= x <= end."""
        nx, ny = self.divisions
        square = (self.upper[0] - self.lower[0]) / nx
        first, last = (round((x - self.lower[0]) / square) for x in (start_x, end_x))
        return [2 * (nx * (ny - 1) + i) + 2 for i in range(first, last)]

    def elements_along_right_side(self) -> list[int]:
        """Return the elements whose face `RIGHT_FACE` is on the right side."""
        nx, ny = self.divisions
        return [2 * (nx * j + nx - 1) + 1 for j in range(ny)]

    def elements_along_left_side(self) -> list[int]:
        """Return the elements whose face `LEFT_FACE` is on the left side."""
        nx, ny = self.divisions
        return [2 * nx * j + 2 for j in range(ny)]

    def body_lines(
        self, element: str, modulus: float, poissons_ratio: float, thickness: float
    ) -> list[str]:
        """Return the deck's lines that define nodes, elements, material and section.

        Args:
            element: CalculiX' name of the element.
            modulus: Young's modulus.
            poissons_ratio: Poisson's ratio.
            thickness: Thickness of the section.
        """
        return [
            "*NODE",
            *(f"{k},{x!r},{y!r},0." for k, (x, y) in enumerate(self.nodes, start=1)),
            f"*ELEMENT,TYPE={element},ELSET=BODY",
            *(join_with_commas([k, *cell]) for k, cell in enumerate(self.elements, start=1)),
            f"*MATERIAL,NAME=ELASTIC\n*ELASTIC\n{modulus!r},{poissons_ratio!r}",
            f"*SOLID SECTION,ELSET=BODY,MATERIAL=ELASTIC\n{thickness!r}",
        ]


@dataclass(frozen=True)
class PressedSquareOfTwoTriangles:
    """Unit square of two triangles under unit pressure, supported below (section 7.1)."""

    mesh = RectangleOfTrianglePairs((0.0, 0.0), (1.0, 1.0), (1, 1))

    def deck(self) -> str:
        """Return the text of CalculiX' input file."""
        mesh = self.mesh
        lower = mesh.nodes_in_row(0)
        return join_lines_to_text(
            [
                *mesh.body_lines("CPS6", 1.0, 0.3, 1.0),
                f"*NSET,NSET=SUPPORT\n{join_with_commas(lower)}",
                f"*BOUNDARY\nSUPPORT,2,2\n{lower[0]},1,1",
                "*STEP\n*STATIC",
                *pressure_deck_lines(mesh.elements_along_upper_side(0.0, 1.0), TOP_FACE, 1.0),
                "*NODE PRINT,NSET=SUPPORT\nRF\n*END STEP",
            ]
        )

    def read_numbers(self, output: str) -> dict[str, Array]:
        """Read positions "x" and vertical reactions "reaction" of the nodes on the lower side."""
        (forces,) = read_tables_below_heading(output, "forces")
        x = [self.mesh.nodes[int(node) - 1][0] for node in forces[:, 0]]
        return {"x": np.array(x), "reaction": forces[:, 2]}


@dataclass(frozen=True)
class PressedAndPulledBlock:
    """Block on a rigid surface, pressed from above and pulled at its right side (section 7.2).

    Contact is node-to-surface with a separate fixed brick element below each node, so that the
    force on the brick is the contact force of the node, and the penalty is the same for all nodes.
    CalculiX takes changes of geometry into account. Loads are therefore scaled down and the forces
    scaled up again; without initial gaps they are proportional to the loads.

    Args:
        element: "CPS6", CalculiX's plane-stress element with an independent thickness strain, or
            "CPE6", whose constants are those of `_constants_that_give_plane_stress`.
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

    mesh = RectangleOfTrianglePairs((0.0, 0.0), (4.0, 2.0), (20, 10))
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
        """Numbers of the nodes on the lower side from left to right."""
        return self.mesh.nodes_in_row(0)

    def nodes_of_rigid_bricks(self) -> list[list[int]]:
        """Return the eight nodes of the rigid brick below each contact node; upper face last."""
        first = len(self.mesh.nodes) + 1
        return [list(range(first + 8 * k, first + 8 * k + 8)) for k in range(self._n_contact_nodes)]

    @property
    def _n_contact_nodes(self) -> int:
        return len(self.contact_nodes)

    def deck(self) -> str:
        """Return the text of CalculiX' input file."""
        mesh, middle = self.mesh, self.mesh.node_number(self.mesh.divisions[0], 0)
        side_support = [] if self.friction else [f"{middle},1,1"]
        return join_lines_to_text(
            [
                *mesh.body_lines(
                    self.element, *self._constants_that_give_plane_stress(), self.thickness
                ),
                *self._brick_lines(),
                *self._contact_lines(),
                "*BOUNDARY\nRIGID,1,3",
                *side_support,
                *self._load_lines(),
                "*NODE PRINT,NSET=RIGID\nRF\n*END STEP",
            ]
        )

    def read_numbers(self, output: str) -> dict[str, Array]:
        """Read positions "x" and contact forces of the contact nodes in the last increment.

        The force on a contact node is the sum of the reactions of the nodes of its brick. The
        forces are "force_normal" and, with friction, "force_tangential".
        """
        last_table = read_tables_below_heading(output, "forces")[-1]
        force = {int(line[0]): line[1:] for line in last_table}
        sums = np.array(
            [sum(force[node] for node in brick) for brick in self.nodes_of_rigid_bricks()]
        )
        scaled = sums / (self.scale * self.thickness)
        numbers = {"x": self._x_of_contact_nodes(), "force_normal": scaled[:, 1]}
        return numbers | ({"force_tangential": scaled[:, 0]} if self.friction else {})

    def _x_of_contact_nodes(self) -> Array:
        return np.array([self.mesh.nodes[node - 1][0] for node in self.contact_nodes])

    def _constants_that_give_plane_stress(self) -> tuple[float, float]:
        """Return the E and nu with which the element is in plane stress of `modulus`, `ratio`."""
        nu = self.ratio
        if self.element == "CPS6":
            return self.modulus, nu
        return self.modulus * (1 + 2 * nu) / (1 + nu) ** 2, nu / (1 + nu)

    def _brick_lines(self) -> list[str]:
        half_width = 2 * self.mesh.nodes[1][0]
        nodes, elements = [], []
        for k, (node, brick) in enumerate(
            zip(self.contact_nodes, self.nodes_of_rigid_bricks(), strict=True)
        ):
            x, y = self.mesh.nodes[node - 1]
            corners = product((y - 1.0, y), ((-1, -1), (-1, 1), (1, 1), (1, -1)))
            nodes += [
                f"{number},{x + half_width * a!r},{height!r},{float(b)!r}"
                for number, (height, (a, b)) in zip(brick, corners, strict=True)
            ]
            elements.append(join_with_commas([len(self.mesh.elements) + 1 + k, *brick]))
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
        lines += self._contact_law_deck_lines(self.penalty)
        if self.friction:
            lines.append(f"*FRICTION\n{self.friction!r},{self.stick_slope!r}")
        return lines

    def _contact_law_deck_lines(self, penalty: float) -> list[str]:
        return [
            "*SURFACE INTERACTION,NAME=TOUCH\n*SURFACE BEHAVIOR,PRESSURE-OVERCLOSURE=LINEAR",
            f"{penalty!r},{self.tension!r}",
        ]

    def _load_lines(self) -> list[str]:
        """Return the deck's lines of pressure and pull.

        They are in a single step, because a new step would relax the penetration.
        """
        pressure = self.scale * self.pressure
        pressed = self.mesh.elements_along_upper_side(*self.pressed)
        if not self.pull:
            return ["*STEP\n*STATIC\n1.,1.", *pressure_deck_lines(pressed, TOP_FACE, pressure)]
        return [
            "*AMPLITUDE,NAME=PRESS\n0.,0.,1.,1.,2.,1.",
            "*AMPLITUDE,NAME=PULL\n0.,0.,1.,0.,2.,1.",
            f"*STEP\n*STATIC,DIRECT\n{1 / self.increments!r},2.",
            *pressure_deck_lines(pressed, TOP_FACE, pressure, ",AMPLITUDE=PRESS"),
            *pressure_deck_lines(
                self.mesh.elements_along_right_side(),
                RIGHT_FACE,
                -self.pull * pressure,
                ",AMPLITUDE=PULL",
            ),
        ]


@dataclass(frozen=True)
class BlockWithPrintedContactPressure(PressedAndPulledBlock):
    """Uniformly pressed block with one contact pair, for the contact pressure that CalculiX prints.

    As in usual models, the slave is the whole lower side and the master a single large face. The
    printed pressure of a node is its force divided by an area that CalculiX assigns to it.
    """

    penalty = 1e7

    def _brick_lines(self) -> list[str]:
        (x0, y), (x1, _) = (
            self.mesh.nodes[k - 1] for k in self.mesh.nodes_in_row(0)[:: self._n_contact_nodes - 1]
        )
        corners = product(
            (y - 1.0, y), ((x0 - 1, -1.0), (x0 - 1, 1.0), (x1 + 1, 1.0), (x1 + 1, -1.0))
        )
        brick = self.nodes_of_rigid_bricks()[0]
        return [
            "*NODE,NSET=RIGID",
            *(f"{k},{x!r},{y!r},{z!r}" for k, (y, (x, z)) in zip(brick, corners, strict=True)),
            "*ELEMENT,TYPE=C3D8,ELSET=BRICKS",
            join_with_commas([len(self.mesh.elements) + 1, *brick]),
            "*SOLID SECTION,ELSET=BRICKS,MATERIAL=ELASTIC",
        ]

    def _contact_lines(self) -> list[str]:
        return [
            "*SURFACE,NAME=LOWER",
            *(f"{element},S{BOTTOM_FACE}" for element in self.mesh.elements_along_lower_side()),
            f"*SURFACE,NAME=FACE\n{len(self.mesh.elements) + 1},S2",
            "*CONTACT PAIR,INTERACTION=TOUCH,TYPE=NODE TO SURFACE\nLOWER,FACE",
            *self._contact_law_deck_lines(self.penalty),
        ]

    def deck(self) -> str:
        """Return the text of CalculiX' input file."""
        return super().deck().replace("*END STEP", "*CONTACT PRINT\nCSTR\n*END STEP")

    def read_numbers(self, output: str) -> dict[str, Array]:
        """Read positions "x" and contact pressures "pressure" of the contact nodes.

        CalculiX expands each node of a plane mesh to three spatial nodes across the thickness
        (corner) or two (mid-side node), and numbers them with a stride of three in the order of the
        plane nodes. The pressure of a plane node is the mean over its spatial nodes.

        Raises:
            CalculixError: If a plane node has another number of spatial nodes.
        """
        (spatial,) = read_tables_below_heading(output, "contact stress")
        number = spatial[:, 0].astype(int)
        plane_node = (number - number.min()) // 3
        counts = np.bincount(plane_node)
        expected = np.where(np.arange(len(self.contact_nodes)) % 2 == 0, 3, 2)
        if not np.array_equal(counts, expected):
            raise CalculixError(
                f"contact nodes have {counts.tolist()} spatial nodes, expected 3, 2, 3, 2, ... 3"
            )
        pressure = np.bincount(plane_node, spatial[:, 1]) / counts / self.scale
        return {"x": self._x_of_contact_nodes(), "pressure": pressure.astype(np.float64)}


@dataclass(frozen=True)
class BucklingHalfBeam:
    """Buckling of half a beam under uniform axial load, with v = 0 on the end face (section 7.6).

    Args:
        divisions: Numbers of squares along and across the half beam.
        mode: 1 for symmetric supports in the middle of the beam, 2 for antisymmetric ones.
    """

    divisions: tuple[int, int]
    mode: int

    modulus, ratio, thickness = 2.07e11, 0.0, 0.1
    length, height = 8.0, 1.0
    # Nominal stress in Pa; with it the buckling factors are about 2.5 and 9, of which seven digits
    # are printed
    stress = 1e9

    @property
    def mesh(self) -> RectangleOfTrianglePairs:
        """Mesh of half the beam; the end face is on the left, the beam's middle on the right."""
        y = self.height / 2
        return RectangleOfTrianglePairs((0.0, -y), (self.length / 2, y), self.divisions)

    def deck(self) -> str:
        """Return the text of CalculiX' input file."""
        mesh, (nx, ny) = self.mesh, self.divisions
        middle = mesh.nodes_in_column(2 * nx)
        supports = [(k, 2) for k in mesh.nodes_in_column(0)]
        loads = pressure_deck_lines(mesh.elements_along_left_side(), LEFT_FACE, self.stress)
        if self.mode == 1:
            supports += [(k, 1) for k in middle]
        else:
            supports += [(middle[ny], 1), *((k, 2) for k in middle)]
            loads += pressure_deck_lines(mesh.elements_along_right_side(), RIGHT_FACE, self.stress)
        return join_lines_to_text(
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
        """Read the critical stress "critical_stress" (1,) in Pa."""
        (factors,) = read_tables_below_heading(output, "FACTOR")
        return {"critical_stress": self.stress * factors[:, 1]}


def pressure_deck_lines(
    elements: list[int], face: int, pressure: float, keyword_parameters: str = ""
) -> list[str]:
    """Return the deck's lines of a pressure on the face with the same number of several elements.

    Args:
        elements: Numbers of the elements.
        face: CalculiX' number of the face.
        pressure: Pressure, positive in compression.
        keyword_parameters: Further parameters of the keyword *DLOAD, with a leading comma.
    """
    return [
        f"*DLOAD{keyword_parameters}",
        *(f"{element},P{face},{pressure!r}" for element in elements),
    ]


def join_with_commas(numbers: Iterable[float]) -> str:
    """Join numbers to one line of a deck, separated by commas."""
    return ",".join(map(str, numbers))


def join_lines_to_text(lines: list[str]) -> str:
    """Join lines to the text of a file, with a newline at the end."""
    return "\n".join(lines) + "\n"


def list_block_and_round_tool_lines(
    block_nodes: Sequence[tuple[float, float]],
    block_cells: Sequence[Sequence[int]],
    angles: Array,
    inner_radius: float,
) -> list[str]:
    """Return the lines of a plane block and of a tool that is part of a ring of radius 1 above it.

    The block consists of CPE6 elements in the set BODY. The tool consists of bricks in the set
    BRICKS, whose first sides approximate a circle around (0, 1); its nodes are in the set TOOL.
    Nodes and elements of the tool are numbered after those of the block.

    Args:
        block_nodes: Coordinates of the block's nodes.
        block_cells: Node numbers of the block's elements, starting from 1.
        angles: Angles (n + 1,) of the ends of the n bricks, from the downward direction.
        inner_radius: Inner radius of the ring.
    """
    first_tool_node, first_brick = len(block_nodes) + 1, len(block_cells) + 1
    tool = [
        (r * np.sin(angle), 1 - r * np.cos(angle), z)
        for angle in angles
        for r, z in ((1.0, -1.0), (1.0, 1.0), (inner_radius, -1.0), (inner_radius, 1.0))
    ]
    brick = np.array([0, 1, 5, 4, 2, 3, 7, 6]) + first_tool_node
    return [
        "*NODE,NSET=ALL",
        *(
            join_with_commas([k, *map(round_to_12_significant_digits, (*p, 0.0))])
            for k, p in enumerate(block_nodes, start=1)
        ),
        "*NODE,NSET=TOOL",
        *(
            join_with_commas([k, *map(round_to_12_significant_digits, p)])
            for k, p in enumerate(tool, start=first_tool_node)
        ),
        "*ELEMENT,TYPE=CPE6,ELSET=BODY",
        *(join_with_commas([k, *cell]) for k, cell in enumerate(block_cells, start=1)),
        "*ELEMENT,TYPE=C3D8,ELSET=BRICKS",
        *(join_with_commas([first_brick + k, *(brick + 4 * k)]) for k in range(len(angles) - 1)),
    ]


def round_to_12_significant_digits(number: float) -> float:
    """Round to 12 significant digits, which fit into the 20 characters that CalculiX reads."""
    return float(f"{number:.12g}")
