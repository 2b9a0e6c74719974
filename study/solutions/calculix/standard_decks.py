"""CalculiX decks for the comparison of its elements with the standard ones.

The problems are linear apart from contact, so units and sizes of loads do not matter.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import product

import numpy as np

from study.solutions.calculix.decks import join_lines, join_numbers
from study.solutions.calculix.grids import Grid, PointMarker
from study.solutions.calculix.output import Array, read_tables

N_SECTORS = 180
"""Number of sectors of an axisymmetric body; CalculiX models one of them, of two degrees."""


@dataclass(frozen=True)
class Specimen:
    """Body of one material.

    Args:
        element: Name of the element in CalculiX, such as "CAX6".
        grid: The mesh.
    """

    element: str
    grid: Grid

    modulus, ratio, density = 1000.0, 0.3, 1.0
    thickness = 1.0

    @property
    def dimension(self) -> int:
        """Dimension of the mesh."""
        return len(self.grid.lower)

    @property
    def vertical_axis(self) -> int:
        """Axis that points upwards: the axis of symmetry, or the last one."""
        return self.dimension - 1

    @property
    def is_axisymmetric(self) -> bool:
        """Whether the mesh is half of a section along the axis x = 0."""
        return self.element.startswith("CAX")

    def is_on_plane(self, axis: int, value: float) -> PointMarker:
        """Return a marker of a plane across an axis."""
        return lambda x: abs(x[axis] - value) < 1e-9

    @property
    def is_at_bottom(self) -> PointMarker:
        """Marker of the lower side."""
        return self.is_on_plane(self.vertical_axis, self.grid.lower[self.vertical_axis])

    @property
    def is_at_top(self) -> PointMarker:
        """Marker of the upper side."""
        return self.is_on_plane(self.vertical_axis, self.grid.upper[self.vertical_axis])

    def body_lines(self) -> list[str]:
        """Return the lines of nodes, elements, material and section."""
        plane = (0.0,) * (3 - self.dimension)
        return [
            "*NODE,NSET=ALL",
            *(f"{k},{join_rounded((*x, *plane))}" for k, x in enumerate(self.grid.nodes, start=1)),
            f"*ELEMENT,TYPE={self.element},ELSET=BODY",
            *(join_numbers([k, *cell]) for k, cell in enumerate(self.grid.elements, start=1)),
            f"*MATERIAL,NAME=ELASTIC\n*ELASTIC\n{self.modulus!r},{self.ratio!r}",
            f"*DENSITY\n{self.density!r}",
            "*SOLID SECTION,ELSET=BODY,MATERIAL=ELASTIC",
            *([repr(self.thickness)] if self.element.startswith("CP") else []),
        ]

    def support_lines(self, is_marked: PointMarker, axes: range, value: float = 0.0) -> list[str]:
        """Return the lines of prescribed displacements."""
        nodes = self.grid.find_nodes(is_marked)
        return [f"{node},{axis + 1},{axis + 1},{value!r}" for node in nodes for axis in axes]

    def pressure_lines(
        self, is_marked: PointMarker, pressure: float, parameters: str = ""
    ) -> list[str]:
        """Return the lines of a pressure on the faces whose corners are all marked."""
        faces = self.grid.find_faces(is_marked)
        return [
            f"*DLOAD{parameters}",
            *(f"{k},P{face},{join_rounded([pressure])}" for k, face in faces),
        ]


@dataclass(frozen=True)
class CompressedBody(Specimen):
    """Body fixed at the bottom; the top is moved down and held sideways."""

    depth = 0.01

    def deck(self) -> str:
        """Return the input file."""
        all_axes = range(self.dimension)
        return join_lines(
            [
                *self.body_lines(),
                f"*NSET,NSET=SUPPORT\n{join_node_numbers(self.grid.find_nodes(self.is_at_bottom))}",
                "*BOUNDARY",
                *self.support_lines(self.is_at_bottom, all_axes),
                *self.support_lines(self.is_at_top, range(self.vertical_axis)),
                "*STEP\n*STATIC\n*BOUNDARY",
                *self.support_lines(
                    self.is_at_top, range(self.vertical_axis, self.dimension), -self.depth
                ),
                "*NODE PRINT,NSET=ALL\nU\n*NODE PRINT,NSET=SUPPORT\nRF\n*END STEP",
            ]
        )

    def read_numbers(self, output: str) -> dict[str, Array]:
        """Return displacements of all nodes, and reactions of the bottom."""
        (motions,), (forces,) = read_tables(output, "displacements"), read_tables(output, "forces")
        end = self.dimension + 1
        displacement, reaction = motions[:, 1:end], forces[:, 1:end]
        if self.is_axisymmetric:
            displacement[:, 0] /= self._radial_output_factors()
            reaction = N_SECTORS * reaction[:, 1:]  # radial ones support the sides, too
        return {"displacement": displacement.ravel(), "reaction": reaction.ravel()}

    def _radial_output_factors(self) -> Array:
        """Return the ratios (n,) of the radial displacements that CalculiX prints to the true ones.

        CalculiX expands a plane node to spatial nodes and prints a mean of their x components. For
        a mid-side node these are two nodes, one degree on either side of the plane (the curvature
        of the displacement along the side is neglected). For a corner they are two such nodes and
        the one between them, which has four times their weight.
        """
        cosine = np.cos(np.pi / N_SECTORS)
        factors = np.full(len(self.grid.nodes), cosine)
        factors[np.array(self.grid.corner_nodes) - 1] = (4 + 2 * cosine) / 6
        return factors


@dataclass(frozen=True)
class VibratingBody(Specimen):
    """Body fixed at the bottom, for the squares of the lowest angular frequencies."""

    count = 6

    def deck(self) -> str:
        """Return the input file."""
        return join_lines(
            [
                *self.body_lines(),
                "*BOUNDARY",
                *self.support_lines(self.is_at_bottom, range(self.dimension)),
                f"*STEP\n*FREQUENCY\n{self.count}\n*NODE FILE\nU\n*END STEP",
            ]
        )

    def read_numbers(self, output: str) -> dict[str, Array]:
        """Return the squares of the angular frequencies."""
        (rows,) = read_tables(output, "(RAD/TIME)")
        return {"eigenvalue": rows[:, 1]}


@dataclass(frozen=True)
class BucklingColumn(Specimen):
    """Plane column, fixed at the bottom and pressed on the top, for the buckling pressures.

    Args:
        thickness: Thickness of the column; the exact buckling pressures do not depend on it.
    """

    thickness: float = 1.0

    count = 2

    def deck(self) -> str:
        """Return the input file."""
        return join_lines(
            [
                *self.body_lines(),
                "*BOUNDARY",
                *self.support_lines(self.is_at_bottom, range(self.dimension)),
                f"*STEP\n*BUCKLE\n{self.count},1e-8",
                *self.pressure_lines(self.is_at_top, 1.0),
                "*NODE FILE\nU\n*END STEP",
            ]
        )

    def read_numbers(self, output: str) -> dict[str, Array]:
        """Return the buckling pressures."""
        (factors,) = read_tables(output, "FACTOR")
        return {"critical_pressure": factors[:, 1]}


@dataclass(frozen=True)
class BodyOnPlane(Specimen):
    """Body on a rigid plane, pressed on the part of its top near x = 0; symmetric about y = 0.

    Each contact node has its own fixed brick below it, as in `Block`.

    Args:
        friction: Coulomb's coefficient; without friction the side x = 0 is supported.
        pull: Traction on the side of largest x, divided by the pressure.
        penalty: Pressure over penetration, on a brick of area four.
        stick_slope: Friction traction over slip of a sticking node, on a brick of area four.
    """

    friction: float = 0.0
    pull: float = 0.0
    penalty: float = 5e9
    stick_slope: float = 1e7

    pressure, width, increments = 0.2, 1.0, 10

    def is_pressed(self, x: tuple[float, ...]) -> bool:
        """Return whether a point is on the pressed part of the top."""
        return self.is_at_top(x) and x[0] < self.width + 1e-9

    @property
    def contact_nodes(self) -> list[int]:
        """Nodes of the lower side."""
        return self.grid.find_nodes(self.is_at_bottom)

    def deck(self) -> str:
        """Return the input file."""
        symmetry = (
            self.support_lines(self.is_on_plane(1, 0.0), range(1, 2)) if self.dimension == 3 else []
        )
        side = self.support_lines(self.is_on_plane(0, 0.0), range(1)) if not self.friction else []
        return join_lines(
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
        """Return the forces of the whole body on the bricks after the last increment."""
        force = read_tables(output, "forces")[-1][:, 1:]
        brick_force = force.reshape(-1, 8, 3).sum(axis=1) * (
            N_SECTORS if self.is_axisymmetric else 1
        )
        forces = {"force_normal": brick_force[:, self.vertical_axis]}
        if self.friction:
            forces["force_tangential"] = brick_force[:, : self.vertical_axis].ravel()
        return forces

    def _brick_lines(self) -> list[str]:
        return rigid_brick_lines(
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
        return pairs + contact_law_lines(self.penalty, self.friction, self.stick_slope)

    def _load_lines(self) -> list[str]:
        """Return the lines of pressure and pull, in one step, as a new one relaxes penetration."""
        if not self.pull:
            return ["*STEP\n*STATIC\n1.,1.", *self.pressure_lines(self.is_pressed, self.pressure)]
        end = self.is_on_plane(0, self.grid.upper[0])
        return [
            "*AMPLITUDE,NAME=PRESS\n0.,0.,1.,1.,2.,1.",
            "*AMPLITUDE,NAME=PULL\n0.,0.,1.,0.,2.,1.",
            f"*STEP\n*STATIC\n{1 / self.increments!r},2.,1e-9,{1 / self.increments!r}",
            *self.pressure_lines(self.is_pressed, self.pressure, ",AMPLITUDE=PRESS"),
            *self.pressure_lines(end, -self.pull * self.pressure, ",AMPLITUDE=PULL"),
        ]


@dataclass(frozen=True)
class RoughBlock(Specimen):
    """Free block on one rigid face, pressed and pushed at once, with surface-to-surface contact.

    Args:
        friction: Coulomb's coefficient.
        penalty: Pressure over penetration.
        stick_slope: Friction over slip where the block sticks.
    """

    friction: float = 0.3
    penalty: float = 1e6
    stick_slope: float = 1e5

    # Small, because CalculiX takes changes of geometry into account
    pressure, push = 0.1, (0.02, 0.01)

    def deck(self) -> str:
        """Return the input file."""
        middle = tuple((a + b) / 2 for a, b in zip(self.grid.lower, self.grid.upper, strict=True))
        side = self.is_on_plane(0, self.grid.lower[0])
        return join_lines(
            [
                *self.body_lines(),
                *rigid_brick_lines(
                    self, [(*middle[:2], self.grid.lower[2])], 2 * max(self.grid.upper)
                ),
                "*SURFACE,NAME=LOWER",
                *(f"{k},S{face}" for k, face in self.grid.find_faces(self.is_at_bottom)),
                f"*SURFACE,NAME=FACE\n{len(self.grid.elements) + 1},S2",
                "*CONTACT PAIR,INTERACTION=TOUCH,TYPE=SURFACE TO SURFACE\nLOWER,FACE",
                *contact_law_lines(self.penalty, self.friction, self.stick_slope),
                "*BOUNDARY\nRIGID,1,3\n*STEP\n*STATIC\n1.,1.",
                *self.pressure_lines(self.is_at_top, self.pressure),
                *self.traction_lines(side, self.push),
                "*NODE PRINT,NSET=ALL\nU\n*NODE PRINT,NSET=RIGID\nRF\n*END STEP",
            ]
        )

    def read_numbers(self, output: str) -> dict[str, Array]:
        """Return displacements of all nodes, and the force on the rigid face."""
        displacement = read_tables(output, "displacements")[-1][:, 1:]
        force = read_tables(output, "forces")[-1][:, 1:]
        return {"displacement": displacement.ravel(), "force": force.sum(axis=0)}

    def traction_lines(self, is_marked: PointMarker, traction: tuple[float, float]) -> list[str]:
        """Return the lines of a traction along x and y, whose forces act on mid-side nodes only."""
        force: dict[int, float] = {}
        nodes = [np.array(point) for point in self.grid.nodes]
        for k, number in self.grid.find_faces(is_marked):
            a, b, c = (nodes[node - 1] for node in self.grid.face_nodes(k, number)[:3])
            area = float(np.linalg.norm(np.cross(b - a, c - a))) / 2
            for node in self.grid.face_nodes(k, number)[3:]:
                force[node] = force.get(node, 0.0) + area / 3
        return [
            "*CLOAD",
            *(
                f"{node},{axis},{join_rounded([component * size])}"
                for node, size in force.items()
                for axis, component in enumerate(traction, start=1)
            ),
        ]


def rigid_brick_lines(
    body: Specimen, points: list[tuple[float, ...]], half_width: float
) -> list[str]:
    """Return the lines of bricks of height one whose upper faces are centred at the given points.

    Nodes and elements are numbered after those of the body.
    """
    first, count = len(body.grid.nodes) + 1, len(body.grid.elements)
    w = half_width
    corners = [(-w, -w), (w, -w), (w, w), (-w, w)]
    nodes: list[str] = []
    elements = []
    for k, point in enumerate(points):
        x, y, z = (*point, 0.0)[:3]
        for below, (a, b) in product((1.0, 0.0), corners):
            corner = (x + a, y + b, z - below) if body.dimension == 3 else (x + a, y - below, z - b)
            nodes.append(f"{first + len(nodes)},{join_rounded(corner)}")
        elements.append(join_numbers([count + 1 + k, *range(first + 8 * k, first + 8 * k + 8)]))
    section = "*SOLID SECTION,ELSET=BRICKS,MATERIAL=ELASTIC"
    return ["*NODE,NSET=RIGID", *nodes, "*ELEMENT,TYPE=C3D8,ELSET=BRICKS", *elements, section]


def contact_law_lines(penalty: float, friction: float, stick_slope: float) -> list[str]:
    """Return the lines of the contact law TOUCH; the tension at open nodes is negligible."""
    return [
        "*SURFACE INTERACTION,NAME=TOUCH\n*SURFACE BEHAVIOR,PRESSURE-OVERCLOSURE=LINEAR",
        f"{penalty!r},1e-9",
        *([f"*FRICTION\n{friction!r},{stick_slope!r}"] if friction else []),
    ]


def join_node_numbers(nodes: list[int]) -> str:
    """Return node numbers in lines of sixteen, the largest number that CalculiX reads."""
    return "\n".join(join_numbers(nodes[k : k + 16]) for k in range(0, len(nodes), 16))


def join_rounded(values: Iterable[float]) -> str:
    """Return numbers as part of a line, with twelve digits, which CalculiX can read."""
    return ",".join(f"{value:.12g}" for value in values)


_RING = Grid("T6", (0.5, 0.0), (1.5, 2.0), (3, 6))
_CYLINDER = Grid("T6", (0.0, 0.0), (2.0, 1.0), (8, 4))
_COLUMN = Grid("T6", (-0.5, 0.0), (0.5, 4.0), (2, 8))
_BOX = Grid("T10", (0.0, 0.0, 0.0), (2.0, 1.0, 1.5), (4, 2, 3))
_BARREL = Grid("T10", (0.0, 0.0, 0.0), (2.0, 1.0, 1.5), (4, 2, 3), bulge=0.2)
_BLOCK = Grid("T10", (0.0, 0.0, 0.0), (2.0, 1.0, 1.0), (4, 2, 2))


def _with_quadrilaterals(grid: Grid) -> Grid:
    """Return the grid of the same rectangle with 8-node quadrilaterals."""
    return Grid("Q8", grid.lower, grid.upper, grid.divisions)


AnySpecimen = CompressedBody | VibratingBody | BucklingColumn | BodyOnPlane | RoughBlock

SPECIMENS: dict[str, AnySpecimen] = {
    "statics-CAX6": CompressedBody("CAX6", _RING),
    "statics-CAX8": CompressedBody("CAX8", _with_quadrilaterals(_RING)),
    "statics-C3D10": CompressedBody("C3D10", _BOX),
    "statics-C3D10-curved": CompressedBody("C3D10", _BARREL),
    "frequencies-CAX6": VibratingBody("CAX6", _RING),
    "frequencies-CAX8": VibratingBody("CAX8", _with_quadrilaterals(_RING)),
    "frequencies-C3D10": VibratingBody("C3D10", _BOX),
    "frequencies-C3D10-curved": VibratingBody("C3D10", _BARREL),
    "buckling-CPE6": BucklingColumn("CPE6", _COLUMN),
    "buckling-CPE8": BucklingColumn("CPE8", _with_quadrilaterals(_COLUMN)),
    "buckling-CPS6": BucklingColumn("CPS6", _COLUMN),
    "buckling-CPS6-thin": BucklingColumn("CPS6", _COLUMN, thickness=0.01),
    "contact-CAX6": BodyOnPlane("CAX6", _CYLINDER),
    "contact-CAX8": BodyOnPlane("CAX8", _with_quadrilaterals(_CYLINDER)),
    "contact-C3D10": BodyOnPlane("C3D10", _BLOCK),
    "contact-C3D10-friction": BodyOnPlane("C3D10", _BLOCK, 0.3, 0.1, penalty=5e8),
    "contact-C3D10-friction-soft": BodyOnPlane("C3D10", _BLOCK, 0.3, 0.1, 5e8, stick_slope=1e6),
    "contact-C3D10-surface": RoughBlock("C3D10", _BLOCK),
    "contact-C3D10-surface-stiff": RoughBlock("C3D10", _BLOCK, penalty=1e7, stick_slope=1e6),
}
