"""Tubes and hollow spheres of two parts that meet in a curved face, under Lame's stresses."""

from mpi4py import MPI

import gmsh
import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import CellType, create_box, create_mesh, create_rectangle

from pw_elements import assemble_vector, boundary_measure
from pw_elements._compat import cell_nodes
from pw_elements.contact import ContactPair, DeformableSurface
from pw_elements.meshes import curved
from study.verification.c_mesh_families import meshed
from tests.contact.cases import Elastic, at
from tests.contact.two_bodies import PLANE, joined, two_sides

INNER, BETWEEN, OUTER, PRESSURE, NU = 1.0, 1.5, 2.2, 1e-3, 0.3


def _tube(low, high, n, cell):
    size = (max(2, round(1.5 * n * (high - low))), 2 * n, max(1, n // 2))
    if cell in PLANE:
        ends = [(low, 0.0), (high, 1.0)]
        return curved(create_rectangle(MPI.COMM_SELF, ends, size[:2], CellType[cell]), _rolled)
    ends = [(low, 0, 0), (high, 1.0, 0.5)]
    return curved(create_box(MPI.COMM_SELF, ends, size, CellType[cell]), _rolled)


def _rolled(x):
    """A quarter of a circle about the last axis, of a strip."""
    angle = np.pi / 2 * x[:, 1]
    return np.column_stack([x[:, 0] * np.cos(angle), x[:, 0] * np.sin(angle), x[:, 2]])


def _octant(low, high, n, cell):
    """Of a hollow sphere, in three patches that meet along the planes x = y, y = z, z = x."""
    size = (max(2, round(1.5 * n * (high - low))), n, n)
    patch = create_box(MPI.COMM_SELF, [(low, 0, 0), (high, 1, 1)], size, CellType[cell])
    x = patch.geometry.x.copy()
    x[:, 1:] *= x[:, :1]
    cells, points = [], []
    for turn in range(3):
        cells.append(cell_nodes(patch) + turn * len(x))
        points.append(np.roll(x, turn, axis=1))
    points = np.concatenate(points)
    _, first, same = np.unique(points.round(9), axis=0, return_index=True, return_inverse=True)
    mesh = create_mesh(
        MPI.COMM_SELF,
        cells=same.ravel()[np.concatenate(cells)].astype(np.int64),
        x=np.ascontiguousarray(points[first]),
        e=patch.ufl_domain().ufl_coordinate_element(),
    )

    def blown(x):
        radius = np.abs(x).max(axis=1, keepdims=True)
        return x * radius / np.linalg.norm(x, axis=1, keepdims=True)

    return curved(mesh, blown)


def _octant_of_gmsh(low, high, n, cell):  # noqa: ARG001
    """Of a hollow sphere, in tetrahedra of any shape with nodes on both spheres."""

    def build():
        ball, core = (
            gmsh.model.occ.addSphere(0, 0, 0, r, -1, 0, np.pi / 2, np.pi / 2) for r in (high, low)
        )
        gmsh.model.occ.cut([(3, ball)], [(3, core)])

    return meshed(build, 3, 1 / n, 2)


# How each is built, the number of coordinates that make the radius, and the power in its stresses
_KINDS = {
    "tube": (_tube, 2, 2),
    "tube in space": (_tube, 2, 2),
    "sphere": (_octant, 3, 3),
    "sphere of Gmsh": (_octant_of_gmsh, 3, 3),
    "revolved": (_tube, 2, 3),
}


class Shells(Elastic):
    """One in the other, the outer one free outside; symmetry planes hold them.

    Args:
        kind: "tube", "tube in space", "sphere", or "revolved": a sphere in axisymmetry.
        cell: of both.
        divisions: of the inner and the outer one, some measure of them.
        slave: "inner" or "outer".
        coincident: as `DeformableSurface` has it.
    """

    def __init__(self, kind, cell, divisions, slave="inner", coincident=True):
        build, axes, self.power = _KINDS[kind]
        self.axes = axes
        mesh = joined(
            build(INNER, BETWEEN, divisions[0], cell), build(BETWEEN, OUTER, divisions[1], cell)
        )
        state = {"tube": "plane strain", "revolved": "axisymmetric"}.get(kind, "solid")
        super().__init__(mesh, state=state, E=1.0, nu=NU)

        def on(radius):
            return lambda x: np.isclose(np.linalg.norm(x[:axes], axis=0), radius)

        sides = two_sides(
            self, on(BETWEEN), lambda x: np.linalg.norm(x[:, :axes], axis=1) > BETWEEN
        )
        own, theirs = sides if slave == "inner" else sides[::-1]
        nodes = fem.locate_dofs_topological(self.space, self.dim - 1, own)
        surface = DeformableSurface(theirs, kind == "revolved", coincident)
        self.pair, self.between = ContactPair(nodes, surface), on(BETWEEN)
        self.inside = self.pushed(PRESSURE, on(INNER))
        ends = [(i, at(i, 0.0)) for i in range(self.dim)]
        self.supports = self.held(*ends, *[(2, at(2, 0.5))] * (kind == "tube in space"))

    def pushed(self, pressure, where):
        """Load vector of a pressure."""
        surface = boundary_measure(self.mesh, where, 6)
        return assemble_vector(
            self.body.surface_load(-pressure * ufl.FacetNormal(self.mesh), surface)
        )

    @property
    def pressure(self):
        """Between them, exact."""
        k = self.power
        return PRESSURE * ((OUTER / BETWEEN) ** k - 1) / ((OUTER / INNER) ** k - 1)

    def displacement(self):
        """Exact, (nodes, dim)."""
        k = self.power
        r = np.linalg.norm(self.x[:, : self.axes], axis=1)
        scale = PRESSURE * INNER**k / (OUTER**k - INNER**k)
        if k == 2:
            moved = scale * (1 + NU) * ((1 - 2 * NU) * r + OUTER**2 / r)
        else:
            moved = scale * ((1 - 2 * NU) * r + (1 + NU) / 2 * OUTER**3 / r**2)
        directed = np.zeros_like(self.x)
        directed[:, : self.axes] = (moved / r)[:, None] * self.x[:, : self.axes]
        return directed
