"""CalculiX decks for the comparison of CalculiX's elements with the library's standard ones.

The problems are linear apart from contact, so that units and load levels do not matter.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import product

import numpy as np

from study.solutions.calculix.decks import join_lines_to_text, join_with_commas
from study.solutions.calculix.grids import Grid, PointMarker
from study.solutions.calculix.output import Array, read_tables_below_heading

N_SECTORS = 180
"""Number of sectors of an axisymmetric body; CalculiX models one sector of two degrees."""


@dataclass(frozen=True)
class Specimen:
    """Homogeneous elastic body that is analysed with CalculiX and with the library.

    Args:
        element: Name of the element in CalculiX, such as "CAX6".
        grid: Mesh of the body.
    """

    element: str
    grid: Grid

    modulus, ratio, density = 1000.0, 0.3, 1.0
    thickness = 1.0

    @property
    def dimension(self) -> int:
        """Spatial dimension of the mesh, 2 or 3."""
        return len(self.grid.lower)

    @property
    def vertical_axis(self) -> int:
        """Index of the vertical axis, the last one; in axisymmetry it is the axis of symmetry."""
        return self.dimension - 1

    @property
    def is_axisymmetric(self) -> bool:
        """Whether the element is axisymmetric; the mesh is then the section x >= 0 (x = r)."""
        return self.element.startswith("CAX")

    def create_marker_of_plane(self, axis: int, position: float) -> PointMarker:
        """Return a marker of the points on the plane x[axis] = value."""
        return lambda x: abs(x[axis] - position) < 1e-9

    @property
    def marker_of_bottom(self) -> PointMarker:
        """Marker of the points on the lower side of the body."""
        return self.create_marker_of_plane(self.vertical_axis, self.grid.lower[self.vertical_axis])

    @property
    def marker_of_top(self) -> PointMarker:
        """Marker of the points on the upper side of the body."""
        return self.create_marker_of_plane(self.vertical_axis, self.grid.upper[self.vertical_axis])

    def body_lines(self) -> list[str]:
        """Return the deck's lines that define nodes, elements, material and section."""
        plane = (0.0,) * (3 - self.dimension)
        return [
            "*NODE,NSET=ALL",
            *(
                f"{k},{join_with_12_significant_digits((*x, *plane))}"
                for k, x in enumerate(self.grid.nodes, start=1)
            ),
            f"*ELEMENT,TYPE={self.element},ELSET=BODY",
            *(join_with_commas([k, *cell]) for k, cell in enumerate(self.grid.elements, start=1)),
            f"*MATERIAL,NAME=ELASTIC\n*ELASTIC\n{self.modulus!r},{self.ratio!r}",
            f"*DENSITY\n{self.density!r}",
            "*SOLID SECTION,ELSET=BODY,MATERIAL=ELASTIC",
            *([repr(self.thickness)] if self.element.startswith("CP") else []),
        ]

    def support_deck_lines(
        self, is_marked: PointMarker, axes: range, value: float = 0.0
    ) -> list[str]:
        """Return the deck's lines that prescribe a value of displacement components.

        Args:
            is_marked: Marker of the nodes.
            axes: Components, from 0.
            value: Displacement.
        """
        nodes = self.grid.find_nodes(is_marked)
        return [f"{node},{axis + 1},{axis + 1},{value!r}" for node in nodes for axis in axes]

    def pressure_deck_lines(
        self, is_marked: PointMarker, pressure: float, keyword_parameters: str = ""
    ) -> list[str]:
        """Return the deck's lines of a pressure on the faces whose corners are all marked.

        Args:
            is_marked: Marker of corners.
            pressure: Pressure, positive in compression.
            keyword_parameters: Further parameters of the keyword *DLOAD, with a leading comma.
        """
        faces = self.grid.find_marked_faces(is_marked)
        return [
            f"*DLOAD{keyword_parameters}",
            *(f"{k},P{face},{join_with_12_significant_digits([pressure])}" for k, face in faces),
        ]


@dataclass(frozen=True)
class CompressedBody(Specimen):
    """Body fixed at the bottom whose top is moved down without lateral displacement."""

    depth = 0.01

    def deck(self) -> str:
        """Return the text of CalculiX' input file."""
        all_axes = range(self.dimension)
        return join_lines_to_text(
            [
                *self.body_lines(),
                f"*NSET,NSET=SUPPORT\n{join_node_numbers_in_lines_of_16(self.grid.find_nodes(self.marker_of_bottom))}",
                "*BOUNDARY",
                *self.support_deck_lines(self.marker_of_bottom, all_axes),
                *self.support_deck_lines(self.marker_of_top, range(self.vertical_axis)),
                "*STEP\n*STATIC\n*BOUNDARY",
                *self.support_deck_lines(
                    self.marker_of_top, range(self.vertical_axis, self.dimension), -self.depth
                ),
                "*NODE PRINT,NSET=ALL\nU\n*NODE PRINT,NSET=SUPPORT\nRF\n*END STEP",
            ]
        )

    def read_numbers(self, output: str) -> dict[str, Array]:
        """Read the displacements of all nodes and the reactions at the bottom, both flattened."""
        (motions,), (forces,) = (
            read_tables_below_heading(output, "displacements"),
            read_tables_below_heading(output, "forces"),
        )
        end = self.dimension + 1
        displacement, reaction = motions[:, 1:end], forces[:, 1:end]
        if self.is_axisymmetric:
            displacement[:, 0] /= self._printed_over_true_radial_displacements()
            reaction = N_SECTORS * reaction[:, 1:]  # radial ones support the sides, too
        return {"displacement": displacement.ravel(), "reaction": reaction.ravel()}

    def _printed_over_true_radial_displacements(self) -> Array:
        """Return the ratios (n,) of the radial displacements that CalculiX prints to the true ones.

        CalculiX expands a node of the plane mesh to several spatial nodes and prints a mean of
        their x components. For a mid-side node these are two nodes, one degree on either side of
        the plane (the curvature of the displacement along the side is neglected). For a corner node
        they are two such nodes and one between them, which has four times their weight.
        """
        cosine = np.cos(np.pi / N_SECTORS)
        factors = np.full(len(self.grid.nodes), cosine)
        factors[np.array(self.grid.corner_nodes) - 1] = (4 + 2 * cosine) / 6
        return factors


@dataclass(frozen=True)
class VibratingBody(Specimen):
    """Body fixed at the bottom, whose lowest natural frequencies are computed."""

    count = 6

    def deck(self) -> str:
        """Return the text of CalculiX' input file."""
        return join_lines_to_text(
            [
                *self.body_lines(),
                "*BOUNDARY",
                *self.support_deck_lines(self.marker_of_bottom, range(self.dimension)),
                f"*STEP\n*FREQUENCY\n{self.count}\n*NODE FILE\nU\n*END STEP",
            ]
        )

    def read_numbers(self, output: str) -> dict[str, Array]:
        """Read the eigenvalues "eigenvalue", the squares of the angular frequencies."""
        (rows,) = read_tables_below_heading(output, "(RAD/TIME)")
        return {"eigenvalue": rows[:, 1]}


@dataclass(frozen=True)
class BucklingColumn(Specimen):
    """Plane column, fixed at the bottom and pressed on top, whose buckling pressures are computed.

    Args:
        thickness: Thickness of the column; the exact buckling pressures do not depend on it.
    """

    thickness: float = 1.0

    count = 2

    def deck(self) -> str:
        """Return the text of CalculiX' input file."""
        return join_lines_to_text(
            [
                *self.body_lines(),
                "*BOUNDARY",
                *self.support_deck_lines(self.marker_of_bottom, range(self.dimension)),
                f"*STEP\n*BUCKLE\n{self.count},1e-8",
                *self.pressure_deck_lines(self.marker_of_top, 1.0),
                "*NODE FILE\nU\n*END STEP",
            ]
        )

    def read_numbers(self, output: str) -> dict[str, Array]:
        """Read the buckling pressures "critical_pressure"."""
        (factors,) = read_tables_below_heading(output, "FACTOR")
        return {"critical_pressure": factors[:, 1]}


@dataclass(frozen=True)
class BodyPressedOnRigidPlane(Specimen):
    """Body on a rigid plane, pressed on top for x <= `width` and pulled at the side of largest x.

    In three dimensions the plane y = 0 is a plane of symmetry. Each contact node has its own fixed
    brick below it, as in `Block`.

    Args:
        friction: Coulomb's coefficient; if it is 0, the side x = 0 is supported.
        pull: Traction on the side of largest x, divided by the pressure.
        penalty: Pressure over penetration; it acts on a brick face of area four.
        stick_slope: Friction traction over slip of a sticking node, on a brick face of area four.
    """

    friction: float = 0.0
    pull: float = 0.0
    penalty: float = 5e9
    stick_slope: float = 1e7

    pressure, width, increments = 0.2, 1.0, 10

    def is_on_pressed_part_of_top(self, x: tuple[float, ...]) -> bool:
        """Return whether a point is on the pressed part of the upper side."""
        return self.marker_of_top(x) and x[0] < self.width + 1e-9

    @property
    def contact_nodes(self) -> list[int]:
        """Numbers of the nodes on the lower side."""
        return self.grid.find_nodes(self.marker_of_bottom)

    def deck(self) -> str:
        """Return the text of CalculiX' input file."""
        symmetry = (
            self.support_deck_lines(self.create_marker_of_plane(1, 0.0), range(1, 2))
            if self.dimension == 3
            else []
        )
        side = (
            self.support_deck_lines(self.create_marker_of_plane(0, 0.0), range(1))
            if not self.friction
            else []
        )
        return join_lines_to_text(
            [
                *self.body_lines(),
                *self._brick_lines(),
                *self._contact_lines(),
                "*BOUNDARY\nRIGID,1,3",
                *symmetry,
                *side,
                *self._load_lines(),
                "*NODE PRINT,NSET=RIGID\nRF\n*END STEP",
            ]
        )

    def read_numbers(self, output: str) -> dict[str, Array]:
        """Read the contact forces on the nodes after the last increment.

        They are "force_normal" and, with friction, "force_tangential". In axisymmetry forces are
        those of the whole body.
        """
        force = read_tables_below_heading(output, "forces")[-1][:, 1:]
        brick_force = force.reshape(-1, 8, 3).sum(axis=1) * (
            N_SECTORS if self.is_axisymmetric else 1
        )
        forces = {"force_normal": brick_force[:, self.vertical_axis]}
        if self.friction:
            forces["force_tangential"] = brick_force[:, : self.vertical_axis].ravel()
        return forces

    def _brick_lines(self) -> list[str]:
        return rigid_brick_deck_lines(
            self, [self.grid.nodes[node - 1] for node in self.contact_nodes], 1.0
        )

    def _contact_lines(self) -> list[str]:
        count, pairs = len(self.grid.elements), []
        for k, node in enumerate(self.contact_nodes):
            pairs += [
                f"*SURFACE,NAME=NODE{k},TYPE=NODE\n{node}",
                f"*SURFACE,NAME=FACE{k}\n{count + 1 + k},S2",
                f"*CONTACT PAIR,INTERACTION=TOUCH,TYPE=NODE TO SURFACE\nNODE{k},FACE{k}",
            ]
        return pairs + contact_law_deck_lines(self.penalty, self.friction, self.stick_slope)

    def _load_lines(self) -> list[str]:
        """Return the deck's lines of pressure and pull.

        They are in a single step, because a new step would relax the penetration.
        """
        if not self.pull:
            return [
                "*STEP\n*STATIC\n1.,1.",
                *self.pressure_deck_lines(self.is_on_pressed_part_of_top, self.pressure),
            ]
        end = self.create_marker_of_plane(0, self.grid.upper[0])
        return [
            "*AMPLITUDE,NAME=PRESS\n0.,0.,1.,1.,2.,1.",
            "*AMPLITUDE,NAME=PULL\n0.,0.,1.,0.,2.,1.",
            f"*STEP\n*STATIC\n{1 / self.increments!r},2.,1e-9,{1 / self.increments!r}",
            *self.pressure_deck_lines(
                self.is_on_pressed_part_of_top, self.pressure, ",AMPLITUDE=PRESS"
            ),
            *self.pressure_deck_lines(end, -self.pull * self.pressure, ",AMPLITUDE=PULL"),
        ]


@dataclass(frozen=True)
class BlockOnRoughRigidPlane(Specimen):
    """Block on a rough rigid plane, pressed on top and pushed at a side in one increment.

    Only contact with one rigid face, surface-to-surface contact by default, holds the block.

    Args:
        friction: Coulomb's coefficient.
        penalty: Pressure over penetration.
        stick_slope: Friction traction over slip where the block sticks.
    """

    friction: float = 0.3
    penalty: float = 1e6
    stick_slope: float = 1e5

    # Small, because CalculiX takes changes of geometry into account
    pressure, push = 0.1, (0.02, 0.01)
    contact_type = "SURFACE TO SURFACE"

    def deck(self) -> str:
        """Return the text of CalculiX' input file."""
        middle = tuple((a + b) / 2 for a, b in zip(self.grid.lower, self.grid.upper, strict=True))
        side = self.create_marker_of_plane(0, self.grid.lower[0])
        return join_lines_to_text(
            [
                *self.body_lines(),
                *rigid_brick_deck_lines(
                    self, [(*middle[:2], self.grid.lower[2])], 2 * max(self.grid.upper)
                ),
                "*SURFACE,NAME=LOWER",
                *(f"{k},S{face}" for k, face in self.grid.find_marked_faces(self.marker_of_bottom)),
                f"*SURFACE,NAME=FACE\n{len(self.grid.elements) + 1},S2",
                f"*CONTACT PAIR,INTERACTION=TOUCH,TYPE={self.contact_type}\nLOWER,FACE",
                *contact_law_deck_lines(self.penalty, self.friction, self.stick_slope),
                "*BOUNDARY\nRIGID,1,3\n*STEP\n*STATIC\n1.,1.",
                *self.pressure_deck_lines(self.marker_of_top, self.pressure),
                *self.traction_deck_lines(side, self.push),
                "*NODE PRINT,NSET=ALL\nU\n*NODE PRINT,NSET=RIGID\nRF\n*END STEP",
            ]
        )

    def read_numbers(self, output: str) -> dict[str, Array]:
        """Read displacements of all nodes (flattened) and the force (3,) on the rigid face."""
        displacement = read_tables_below_heading(output, "displacements")[-1][:, 1:]
        force = read_tables_below_heading(output, "forces")[-1][:, 1:]
        return {"displacement": displacement.ravel(), "force": force.sum(axis=0)}

    def traction_deck_lines(
        self, is_marked: PointMarker, traction: tuple[float, float]
    ) -> list[str]:
        """Return the deck's lines of the nodal forces of a uniform traction along x and y.

        On the faces of quadratic tetrahedra, these forces act on mid-side nodes only.
        """
        force: dict[int, float] = {}
        nodes = [np.array(point) for point in self.grid.nodes]
        for k, number in self.grid.find_marked_faces(is_marked):
            a, b, c = (nodes[node - 1] for node in self.grid.nodes_of_face(k, number)[:3])
            area = float(np.linalg.norm(np.cross(b - a, c - a))) / 2
            for node in self.grid.nodes_of_face(k, number)[3:]:
                force[node] = force.get(node, 0.0) + area / 3
        return [
            "*CLOAD",
            *(
                f"{node},{axis},{join_with_12_significant_digits([component * size])}"
                for node, size in force.items()
                for axis, component in enumerate(traction, start=1)
            ),
        ]


class BlockOnRoughRigidPlaneByNodes(BlockOnRoughRigidPlane):
    """The same block; its nodes, not points within faces, are in contact with the rigid face."""

    contact_type = "NODE TO SURFACE"


def rigid_brick_deck_lines(
    body: Specimen, centres_of_upper_faces: list[tuple[float, ...]], half_width: float
) -> list[str]:
    """Return the deck's lines of rigid bricks of height one.

    Nodes and elements of the bricks are numbered after those of the body.

    Args:
        body: Body above the bricks.
        centres_of_upper_faces: Centres of the upper faces of the bricks.
        half_width: Half of the side length of the square faces.
    """
    first, count = len(body.grid.nodes) + 1, len(body.grid.elements)
    w = half_width
    corners = [(-w, -w), (w, -w), (w, w), (-w, w)]
    nodes: list[str] = []
    elements = []
    for k, point in enumerate(centres_of_upper_faces):
        x, y, z = (*point, 0.0)[:3]
        for below, (a, b) in product((1.0, 0.0), corners):
            corner = (x + a, y + b, z - below) if body.dimension == 3 else (x + a, y - below, z - b)
            nodes.append(f"{first + len(nodes)},{join_with_12_significant_digits(corner)}")
        elements.append(join_with_commas([count + 1 + k, *range(first + 8 * k, first + 8 * k + 8)]))
    section = "*SOLID SECTION,ELSET=BRICKS,MATERIAL=ELASTIC"
    return ["*NODE,NSET=RIGID", *nodes, "*ELEMENT,TYPE=C3D8,ELSET=BRICKS", *elements, section]


def contact_law_deck_lines(penalty: float, friction: float, stick_slope: float) -> list[str]:
    """Return the lines of the deck that define a linear penalty contact law named TOUCH.

    Args:
        penalty: Pressure over penetration.
        friction: Coulomb's coefficient; 0 for frictionless contact.
        stick_slope: Friction traction over slip of sticking points.
    """
    return [
        "*SURFACE INTERACTION,NAME=TOUCH\n*SURFACE BEHAVIOR,PRESSURE-OVERCLOSURE=LINEAR",
        f"{penalty!r},1e-9",
        *([f"*FRICTION\n{friction!r},{stick_slope!r}"] if friction else []),
    ]


def join_node_numbers_in_lines_of_16(nodes: list[int]) -> str:
    """Join node numbers to lines of sixteen, the most that CalculiX reads per line."""
    return "\n".join(join_with_commas(nodes[k : k + 16]) for k in range(0, len(nodes), 16))


def join_with_12_significant_digits(values: Iterable[float]) -> str:
    """Join numbers with 12 significant digits, which CalculiX can read, separated by commas."""
    return ",".join(f"{value:.12g}" for value in values)


_RING = Grid("T6", (0.5, 0.0), (1.5, 2.0), (3, 6))
_CYLINDER = Grid("T6", (0.0, 0.0), (2.0, 1.0), (8, 4))
_COLUMN = Grid("T6", (-0.5, 0.0), (0.5, 4.0), (2, 8))
_BOX = Grid("T10", (0.0, 0.0, 0.0), (2.0, 1.0, 1.5), (4, 2, 3))
_BARREL = Grid("T10", (0.0, 0.0, 0.0), (2.0, 1.0, 1.5), (4, 2, 3), bulge=0.2)
_BLOCK = Grid("T10", (0.0, 0.0, 0.0), (2.0, 1.0, 1.0), (4, 2, 2))


def _replace_triangles_by_quadrilaterals(grid: Grid) -> Grid:
    """Return a grid of 8-node quadrilaterals with the same corners and divisions."""
    return Grid("Q8", grid.lower, grid.upper, grid.divisions)


AnySpecimen = (
    CompressedBody
    | VibratingBody
    | BucklingColumn
    | BodyPressedOnRigidPlane
    | BlockOnRoughRigidPlane
)

SPECIMENS: dict[str, AnySpecimen] = {
    "statics-CAX6": CompressedBody("CAX6", _RING),
    "statics-CAX8": CompressedBody("CAX8", _replace_triangles_by_quadrilaterals(_RING)),
    "statics-C3D10": CompressedBody("C3D10", _BOX),
    "statics-C3D10-curved": CompressedBody("C3D10", _BARREL),
    "frequencies-CAX6": VibratingBody("CAX6", _RING),
    "frequencies-CAX8": VibratingBody("CAX8", _replace_triangles_by_quadrilaterals(_RING)),
    "frequencies-C3D10": VibratingBody("C3D10", _BOX),
    "frequencies-C3D10-curved": VibratingBody("C3D10", _BARREL),
    "buckling-CPE6": BucklingColumn("CPE6", _COLUMN),
    "buckling-CPE8": BucklingColumn("CPE8", _replace_triangles_by_quadrilaterals(_COLUMN)),
    "buckling-CPS6": BucklingColumn("CPS6", _COLUMN),
    "buckling-CPS6-thin": BucklingColumn("CPS6", _COLUMN, thickness=0.01),
    "contact-CAX6": BodyPressedOnRigidPlane("CAX6", _CYLINDER),
    "contact-CAX8": BodyPressedOnRigidPlane(
        "CAX8", _replace_triangles_by_quadrilaterals(_CYLINDER)
    ),
    "contact-C3D10": BodyPressedOnRigidPlane("C3D10", _BLOCK),
    "contact-C3D10-friction": BodyPressedOnRigidPlane("C3D10", _BLOCK, 0.3, 0.1, penalty=5e8),
    "contact-C3D10-friction-soft": BodyPressedOnRigidPlane(
        "C3D10", _BLOCK, 0.3, 0.1, 5e8, stick_slope=1e6
    ),
    "contact-C3D10-surface": BlockOnRoughRigidPlane("C3D10", _BLOCK),
    "contact-C3D10-surface-stiff": BlockOnRoughRigidPlane(
        "C3D10", _BLOCK, penalty=1e7, stick_slope=1e6
    ),
}
