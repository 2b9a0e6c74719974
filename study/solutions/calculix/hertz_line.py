"""CalculiX deck of the Hertz line contact of section Q, for the pressure that CalculiX prints.

This module does not need DOLFINx. The body has a parabolic surface; the rigid surface is flat, the
face of a fixed brick. Contact is surface-to-surface with a penalty, because the manual does not
recommend node-to-surface contact for quadratic elements.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from study.meshes.mesh_lines import geometrically_growing_lines
from study.solutions.calculix.decks import (
    join_lines_to_text,
    join_with_commas,
    round_to_12_significant_digits,
)
from study.solutions.calculix.grids import Grid
from study.solutions.calculix.output import Array, read_nodal_values_by_block
from study.solutions.half_space import ElasticHalfSpace, HertzLine

PENALTIES = 1, 10, 100
"""Values of the penalty (pressure over penetration) times edge length h over Young's modulus E."""
RADIUS, MIN_FINE_WIDTH, BODY_SIZE, SIZE_RATIO = 1e5, 1.3, 5.0, 1.3


@dataclass(frozen=True)
class HertzLineContact:
    """Hertz line contact of a half plane; its half x >= 0 is modelled with CPE6 elements.

    Args:
        edges: Number of whole element edges within the half width of the contact.
        offset: Position of the end of the contact within the next edge, from 0 to 1.
        penalty: Pressure over penetration, times edge length h over Young's modulus E.
    """

    edges: int
    offset: float
    penalty: float

    output_suffix = ".frd"

    @property
    def exact_solution(self) -> HertzLine:
        """Hertz' solution for contact half width 1 and Young's modulus 1."""
        body = ElasticHalfSpace(1.0, 0.3)
        return HertzLine(body, RADIUS, np.pi * body.plane_strain_modulus / (4 * RADIUS))

    @property
    def edge_length_in_contact(self) -> float:
        """Length of an element edge in the contact zone."""
        return 1 / (self.edges + self.offset)

    @cached_property
    def mesh_line_positions(self) -> tuple[Array, Array]:
        """Coordinates of the mesh lines: x, and y from bottom to top."""
        near = self.edge_length_in_contact * np.arange(
            np.ceil(MIN_FINE_WIDTH / self.edge_length_in_contact) + 1
        )
        far = (
            near[-1]
            + geometrically_growing_lines(
                self.edge_length_in_contact, BODY_SIZE - near[-1], SIZE_RATIO
            )[1:]
        )
        return np.concatenate([near, far]), -geometrically_growing_lines(
            self.edge_length_in_contact, BODY_SIZE, SIZE_RATIO
        )[::-1]

    @cached_property
    def grid(self) -> Grid:
        """Mesh of the body in index coordinates, where the distance of mesh lines is 1."""
        x, y = (len(lines) - 1 for lines in self.mesh_line_positions)
        return Grid("T6", (0.0, 0.0), (float(x), float(y)), (x, y))

    @cached_property
    def nodes(self) -> Array:
        """Coordinates (n, 2) of the nodes before the surface is made parabolic."""
        indices = np.array(self.grid.nodes_without_bulge)
        columns = [
            np.interp(index, np.arange(len(lines)), lines)
            for index, lines in zip(indices.T, self.mesh_line_positions, strict=True)
        ]
        return np.column_stack(columns)

    @property
    def slave_nodes(self) -> npt.NDArray[np.int64]:
        """Numbers of the nodes that may come into contact, from the middle outwards."""
        x, y = self.nodes.T
        index = np.flatnonzero(np.isclose(y, 0.0) & (x < self._width_with_uniform_edges + 1e-9))
        return index[np.argsort(x[index])] + 1

    @property
    def _width_with_uniform_edges(self) -> float:
        """Width of the zone with edges of uniform length."""
        return float(
            self.edge_length_in_contact * np.ceil(MIN_FINE_WIDTH / self.edge_length_in_contact)
        )

    def deck(self) -> str:
        """Return the text of CalculiX' input file."""
        x, y = self.nodes.T
        curved = np.column_stack([x, y - np.isclose(y, 0.0) * x**2 / (2 * RADIUS)])
        top, columns = (
            self.grid.upper[1],
            round(self._width_with_uniform_edges / self.edge_length_in_contact),
        )
        sides = self.grid.find_marked_faces(lambda p: p[1] == top and p[0] <= columns)
        first, element = len(x) + 1, len(self.grid.elements) + 1
        low, high = -1.0, self._width_with_uniform_edges + 1.0
        corners = [(low, -1), (low, 1), (high, 1), (high, -1)]
        brick = [(a, height, b) for height in (0.0, 1.0) for a, b in corners]
        penalty_per_edge_length = round_to_12_significant_digits(
            self.penalty / self.edge_length_in_contact
        )
        return join_lines_to_text(
            [
                "*NODE,NSET=ALL",
                *(
                    join_with_commas([k, *map(round_to_12_significant_digits, (*p, 0.0))])
                    for k, p in enumerate(curved, start=1)
                ),
                "*NODE,NSET=RIGID",
                *(join_with_commas([first + k, *p]) for k, p in enumerate(brick)),
                "*ELEMENT,TYPE=CPE6,ELSET=BODY",
                *(
                    join_with_commas([k, *cell])
                    for k, cell in enumerate(self.grid.elements, start=1)
                ),
                "*ELEMENT,TYPE=C3D8,ELSET=BRICK",
                join_with_commas([element, *range(first, first + 8)]),
                "*MATERIAL,NAME=ELASTIC\n*ELASTIC\n1.,.3",
                "*SOLID SECTION,ELSET=BODY,MATERIAL=ELASTIC\n1.",
                "*SOLID SECTION,ELSET=BRICK,MATERIAL=ELASTIC",
                "*SURFACE,NAME=SLAVE",
                *(f"{k},S{face}" for k, face in sides),
                f"*SURFACE,NAME=MASTER\n{element},S1",
                "*SURFACE INTERACTION,NAME=TOUCH",
                "*SURFACE BEHAVIOR,PRESSURE-OVERCLOSURE=LINEAR",
                f"{penalty_per_edge_length},1e-15",
                "*CONTACT PAIR,INTERACTION=TOUCH,TYPE=SURFACE TO SURFACE\nSLAVE,MASTER",
                "*STEP\n*STATIC\n1.,1.\n*BOUNDARY",
                "RIGID,1,1,0.\nRIGID,3,3,0.",
                f"RIGID,2,2,{round_to_12_significant_digits(-self.exact_solution.approach)}",
                *self._support_deck_lines(),
                "*NODE FILE,OUTPUT=2D\nU\n*CONTACT FILE\nCDIS,CSTR\n*END STEP",
            ]
        )

    def _support_deck_lines(self) -> Iterator[str]:
        x, y = self.nodes.T
        far = np.isclose(x, BODY_SIZE) | np.isclose(y, -BODY_SIZE)
        displacement = self.exact_solution.displacement(self.nodes[far])
        displacement[x[far] == 0, 0] = 0.0
        for i, k in enumerate(np.flatnonzero(far)):
            for axis in (0, 1):
                component = round_to_12_significant_digits(float(displacement[i, axis]))
                yield join_with_commas([int(k) + 1, axis + 1, axis + 1, component])
        yield from (
            join_with_commas([int(k), 1, 1, 0.0])
            for k in np.flatnonzero(np.isclose(x, 0.0) & ~far) + 1
        )

    def read_numbers(self, output: str) -> dict[str, Array]:
        """Read positions "x" and pressures of the slave nodes, relative to Hertz' peak pressure."""
        contact = read_nodal_values_by_block(output)["CONTACT"]
        pressure = (
            np.array([contact[k][3] for k in self.slave_nodes]) / self.exact_solution.peak_pressure
        )
        return {"x": self.nodes[self.slave_nodes - 1, 0], "pressure": pressure}


HERTZ_LINES = {
    f"hertz-line-{n}-{offset}-{penalty}": HertzLineContact(n, offset, float(penalty))
    for n in (4, 8, 16)
    for offset in (0.375, 0.875)
    for penalty in PENALTIES
}
