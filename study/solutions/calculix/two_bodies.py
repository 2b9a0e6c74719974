"""CalculiX decks of two elastic bodies on the meshes of section V11.

This module does not need DOLFINx. Contact is either "SURFACE TO SURFACE", with a penalty at points
of the slave's faces, or "MORTAR", with dual multipliers. With the latter, slave nodes must not be
supported, because the matrix would be singular: no plane of symmetry may cut the contact surface.
Keywords: G. Dhondt, "CalculiX CrunchiX User's Manual", version 2.20.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from study.meshes.mesh_lines import BODY_SIZE, mesh_lines_of_body_under_sphere
from study.solutions.calculix.decks import join_lines_to_text, join_with_commas
from study.solutions.calculix.grids import Grid, Point
from study.solutions.calculix.output import Array, read_nodal_values_by_block
from study.solutions.half_space import ElasticHalfSpace, HertzSphere

SURFACE_TO_SURFACE, MORTAR = "SURFACE TO SURFACE", "MORTAR"
_Z = 2

Indices = npt.NDArray[np.int64]
Support = tuple[int, int, float]  # node, axis, displacement


@dataclass(frozen=True)
class TwoBodyContact(ABC):
    """Contact of two elastic bodies: a lower one, whose upper side is the slave, and an upper one.

    Args:
        contact_formulation: CalculiX' name of the contact formulation.
        penalty: Pressure over penetration.
    """

    contact_formulation: str
    penalty: float = 1e6

    output_suffix = ".frd"  # of the file from which numbers are read
    ratio = 0.3  # Poisson's ratio
    moduli = (1.0, 1.0)

    @property
    @abstractmethod
    def grids(self) -> tuple[Grid, Grid]:
        """Meshes of the lower and the upper body, whose nodes `place_nodes` maps to the bodies."""

    @abstractmethod
    def place_nodes(self, x: Array, upper: bool) -> Array:
        """Map nodes (n, 3) of a mesh in `grids` to their positions (n, 3) in the body.

        Args:
            x: Nodes of the mesh.
            upper: Whether the body is the upper one.
        """

    @abstractmethod
    def supports(self) -> Iterator[Support]:
        """Yield the node number, axis and value of each prescribed displacement."""

    def load_lines(self) -> list[str]:
        """Return the lines of the deck that apply the loads; the list is empty without loads."""
        return []

    @cached_property
    def nodes(self) -> Array:
        """Coordinates (n, 3) of all nodes; node k is row k - 1."""
        grids = zip(self.grids, (False, True), strict=True)
        return np.concatenate(
            [self.place_nodes(np.array(grid.nodes_without_bulge), upper) for grid, upper in grids]
        )

    @property
    def node_points(self) -> list[Point]:
        """Coordinates of all nodes as tuples of Python floats."""
        return [tuple(float(part) for part in x) for x in self.nodes]

    @cached_property
    def elements(self) -> Indices:
        """Node numbers (n_elements, 10) of all elements; element k is row k - 1."""
        lower, upper = (np.array(grid.elements) for grid in self.grids)
        return np.concatenate([lower, upper + len(self.grids[0].nodes_without_bulge)])

    @property
    def slave_and_master_faces(self) -> tuple[list[tuple[int, int]], list[tuple[int, int]]]:
        """Pairs (element, face number) of the slave's faces, and those of the master's faces."""
        lower, upper = self.grids
        top, bottom = lower.upper[_Z], upper.lower[_Z]
        master = upper.find_marked_faces(lambda x: abs(x[_Z] - bottom) < 1e-9)
        return (
            lower.find_marked_faces(lambda x: abs(x[_Z] - top) < 1e-9),
            [(k + len(lower.elements), face) for k, face in master],
        )

    @cached_property
    def slave_nodes(self) -> Indices:
        """Sorted node numbers of the slave's faces."""
        lower = self.grids[0]
        return np.unique(
            [
                node
                for k, face in self.slave_and_master_faces[0]
                for node in lower.nodes_of_face(k, face)
            ]
        )

    @cached_property
    def master_nodes(self) -> Indices:
        """Sorted node numbers of the master's faces."""
        lower, upper = self.grids
        first = len(lower.elements)
        faces = [upper.nodes_of_face(k - first, face) for k, face in self.slave_and_master_faces[1]]
        return np.unique(faces) + len(lower.nodes_without_bulge)

    @cached_property
    def nodes_of_elements_at_contact(self) -> Indices:
        """Node numbers of all elements that have a node on a contact surface.

        Displacements of these nodes determine the contact forces.
        """
        faces = np.concatenate([self.slave_nodes, self.master_nodes])
        return np.unique(self.elements[np.isin(self.elements, faces).any(axis=1)])

    def deck(self) -> str:
        """Return the text of CalculiX' input file."""
        lower = len(self.grids[0].elements)
        cells: list[list[int]] = [[int(node) for node in cell] for cell in self.elements]
        numbered = list(enumerate(cells, start=1))
        slave, master = self.slave_and_master_faces
        body: list[str] = []
        for name, elements, modulus in zip(
            ("LOWER", "UPPER"), (numbered[:lower], numbered[lower:]), self.moduli, strict=True
        ):
            body += [
                f"*ELEMENT,TYPE=C3D10,ELSET={name}",
                *(join_with_commas([k, *cell]) for k, cell in elements),
                f"*MATERIAL,NAME=OF_{name}\n*ELASTIC\n{modulus!r},{self.ratio!r}",
                f"*SOLID SECTION,ELSET={name},MATERIAL=OF_{name}",
            ]
        return join_lines_to_text(
            [
                "*NODE,NSET=ALL",
                *(
                    join_with_commas([k, *map(_round_to_9_significant_digits, x)])
                    for k, x in enumerate(self.node_points, start=1)
                ),
                *body,
                "*SURFACE,NAME=SLAVE",
                *(f"{k},S{face}" for k, face in slave),
                "*SURFACE,NAME=MASTER",
                *(f"{k},S{face}" for k, face in master),
                "*SURFACE INTERACTION,NAME=TOUCH",
                f"*SURFACE BEHAVIOR,PRESSURE-OVERCLOSURE=LINEAR\n{self.penalty!r},1e-12",
                f"*CONTACT PAIR,INTERACTION=TOUCH,TYPE={self.contact_formulation}\nSLAVE,MASTER",
                "*STEP\n*STATIC\n1.,1.\n*BOUNDARY",
                *(
                    join_with_commas([k, axis + 1, axis + 1, _round_to_9_significant_digits(u)])
                    for k, axis, u in self.supports()
                ),
                *self.load_lines(),
                "*NODE FILE\nU\n*CONTACT FILE\nCDIS,CSTR\n*END STEP",
            ]
        )

    def read_numbers(self, output: str) -> dict[str, Array]:
        """Read nodal displacements and contact pressures.

        The displacements (3 m,) are those of `nodes_of_elements_at_contact`, the pressures those of
        `slave_nodes`.
        """
        blocks = read_nodal_values_by_block(output)
        displacement, contact = blocks["DISP"], blocks["CONTACT"]
        return {
            "displacement": np.concatenate(
                [displacement[k][:3] for k in self.nodes_of_elements_at_contact]
            ),
            "pressure": np.array([contact[k][3] for k in self.slave_nodes]),
        }


@dataclass(frozen=True)
class StackedBlocksPatchTest(TwoBodyContact):
    """Contact patch test: a block on another one, pressed from above and held by contact alone.

    Lateral supports of the blocks are far from the contact surface; their reactions are zero.
    """

    pressure = 1e-6  # small, because CalculiX takes changes of geometry into account
    grids = (
        Grid("T10", (0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (3, 4, 3)),
        Grid("T10", (0.0, 0.0, 1.0), (1.0, 1.0, 2.0), (2, 3, 2)),
    )

    def place_nodes(self, x: Array, upper: bool) -> Array:  # noqa: ARG002
        """Return the positions unchanged."""
        return x

    def supports(self) -> Iterator[Support]:
        """Yield the supports of the base and, near base and top, of the planes of symmetry."""
        for k, x in enumerate(self.node_points, start=1):
            for axis in range(_Z):
                if x[axis] == 0 and abs(x[_Z] - 1) > 0.8:
                    yield k, axis, 0.0
            if x[_Z] == 0:
                yield k, _Z, 0.0

    def load_lines(self) -> list[str]:
        """Return the deck's lines of the pressure on top of the upper block."""
        lower, upper = self.grids
        top = upper.find_marked_faces(lambda x: abs(x[_Z] - upper.upper[_Z]) < 1e-9)
        n_lower, pressure = len(lower.elements), self.pressure
        return ["*DLOAD", *(f"{k + n_lower},P{face},{pressure!r}" for k, face in top)]


@dataclass(frozen=True)
class QuarterOfTouchingSpheres(TwoBodyContact):
    """Quarter of two spheres of unequal moduli in contact.

    Hertz' exact displacements are prescribed on the outer sides of both bodies.

    Args:
        edges: Number of the slave's element edges along the radius of the contact.
        size_ratio: Number of the master's edges along the radius, divided by the slave's number.
    """

    edges: int = 3
    size_ratio: float = 0.71

    moduli = (1.0, 3.0)
    radius = 1e3

    @property
    def grids(self) -> tuple[Grid, Grid]:
        """Meshes of both bodies in index coordinates, where the distance of mesh lines is 1."""
        divisions = [
            (len(x) - 1, len(x) - 1, len(z) - 1)
            for (x, z) in (self._mesh_line_positions(0), self._mesh_line_positions(1))
        ]
        lower, upper = (Grid("T10", (0.0,) * 3, tuple(map(float, n)), n) for n in divisions)
        return lower, upper

    @property
    def hertz_solutions_of_both_bodies(self) -> tuple[HertzSphere, HertzSphere]:
        """Hertz' solutions for the lower and the upper body, each against a rigid sphere."""
        bodies = [ElasticHalfSpace(E, self.ratio) for E in self.moduli]
        force = 4 / 3 / self.radius / sum(1 / b.plane_strain_modulus for b in bodies)
        first, second = (
            HertzSphere(b, 4 * b.plane_strain_modulus / (3 * force), force) for b in bodies
        )
        return first, second

    def place_nodes(self, x: Array, upper: bool) -> Array:
        """Map index coordinates to positions; make the upper body's lower side a paraboloid."""
        across, along = self._mesh_line_positions(upper)
        lines = (across, across, along)
        y = [np.interp(x[:, i], np.arange(len(line)), line) for i, line in enumerate(lines)]
        if upper:
            y[_Z] = y[_Z] + (y[0] ** 2 + y[1] ** 2) / (2 * self.radius)
        return np.column_stack(y)

    def supports(self) -> Iterator[Support]:
        """Yield Hertz' displacements of the outer sides, and the supports of planes of symmetry."""
        is_lower = np.arange(len(self.nodes)) < len(self.grids[0].nodes_without_bulge)
        approach = sum(exact.approach for exact in self.hertz_solutions_of_both_bodies)
        x = self.nodes
        is_outer = (np.abs(x[:, _Z]) > BODY_SIZE - 1e-9) | np.isclose(
            x[:, :_Z].max(axis=1), BODY_SIZE
        )
        for k in np.flatnonzero(is_outer):
            exact, sign = (
                (self.hertz_solutions_of_both_bodies[0], 1.0)
                if is_lower[k]
                else (self.hertz_solutions_of_both_bodies[1], -1.0)
            )
            r = float(np.hypot(*x[k, :_Z]))
            ((radial, up),) = exact.displacement(np.array([[r, sign * x[k, _Z]]]))
            for axis in range(_Z):
                yield k + 1, axis, radial * x[k, axis] / max(r, 1e-12)
            yield k + 1, _Z, sign * up - (0.0 if is_lower[k] else approach)
        for axis in range(_Z):
            for k in np.flatnonzero((np.abs(x[:, axis]) < 1e-12) & ~is_outer):
                yield k + 1, axis, 0.0

    def _mesh_line_positions(self, upper: bool | int) -> tuple[Array, Array]:
        """Return the coordinates of a body's mesh lines across the axis of contact and along it."""
        lines = mesh_lines_of_body_under_sphere(
            self.edges * self.size_ratio if upper else self.edges
        )
        return lines.horizontal, -lines.vertical[::-1] if upper else lines.vertical


def _round_to_9_significant_digits(value: float) -> float:
    """Round to nine significant digits, so that processor and NumPy version do not matter."""
    return float(f"{value:.9g}")


PAIRS: dict[str, StackedBlocksPatchTest | QuarterOfTouchingSpheres] = {
    "two-blocks-surface": StackedBlocksPatchTest(SURFACE_TO_SURFACE),
    "two-blocks-mortar": StackedBlocksPatchTest(MORTAR),
    "two-spheres-surface": QuarterOfTouchingSpheres(SURFACE_TO_SURFACE, 1e2),
    "two-spheres-surface-stiff": QuarterOfTouchingSpheres(SURFACE_TO_SURFACE, 1e3),
}
"""Problems by name.

A surface penalty acts at more points of quadratic faces than these have nodes; the larger the
penalty, the less accurate are the pressures between the spheres.
"""
