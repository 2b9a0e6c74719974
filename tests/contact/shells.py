"""Tubes and hollow spheres of two parts that meet in a curved face, under Lame's stresses."""

from mpi4py import MPI

import gmsh
import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import CellType, create_box, create_mesh, create_rectangle

from pw_elements import (
    Body,
    Material,
    Reduction,
    Spaces,
    assemble_matrix,
    assemble_vector,
    boundary_measure,
    prescribe,
)
from pw_elements._compat import cell_nodes
from pw_elements.contact import ContactPair, DeformableSurface
from pw_elements.meshes import curved
from pw_elements.spaces import exterior_facets
from study.verification.c_mesh_families import meshed
from tests.contact.cases import at
from tests.contact.two_bodies import joined

INNER, BETWEEN, OUTER, PRESSURE, NU = 1.0, 1.5, 2.2, 1e-3, 0.3


def _tube_2d(low, high, n, cell):
    size = (max(2, round(1.5 * n * (high - low))), 2 * n)
    flat = create_rectangle(MPI.COMM_SELF, [(low, 0.0), (high, 1.0)], size, CellType[cell])
    return curved(flat, _rolled)


def _tube_3d(low, high, n, cell):
    size = (max(2, round(1.5 * n * (high - low))), 2 * n, max(1, n // 2))
    flat = create_box(MPI.COMM_SELF, [(low, 0, 0), (high, 1.0, 0.5)], size, CellType[cell])
    return curved(flat, _rolled)


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
    "tube": (_tube_2d, 2, 2),
    "tube in space": (_tube_3d, 2, 2),
    "sphere": (_octant, 3, 3),
    "sphere of Gmsh": (_octant_of_gmsh, 3, 3),
    "revolved": (_tube_2d, 2, 3),
}


class Shells:
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
        dim = mesh.geometry.dim
        state = {"tube": "plane strain", "revolved": "axisymmetric"}.get(kind, "solid")
        self.body = Body(Spaces.petrov_galerkin(mesh), Material(1.0, NU), state)
        space = self.space = self.body.spaces.trial
        self.K = assemble_matrix(self.body.stiffness())
        self.x = space.tabulate_dof_coordinates()[:, :dim]

        def radius(x):
            return np.linalg.norm(x[:axes], axis=0)

        facets = exterior_facets(mesh, lambda x: np.isclose(radius(x), BETWEEN))
        behind = mesh.topology.connectivity(dim - 1, dim)
        middle = radius(self.x[space.dofmap.list].mean(axis=1).T)
        outer = np.array([middle[behind.links(f)[0]] > BETWEEN for f in facets])
        sides = {"inner": facets[~outer], "outer": facets[outer]}
        self.own = sides.pop(slave)
        (theirs,) = sides.values()
        nodes = fem.locate_dofs_topological(space, dim - 1, self.own)
        surface = DeformableSurface(theirs, coincident=coincident)
        self.pair = ContactPair(nodes, surface)
        bore = boundary_measure(mesh, lambda x: np.isclose(radius(x), INNER), 6)
        normal = ufl.FacetNormal(mesh)
        self.load = assemble_vector(self.body.surface_load(-PRESSURE * normal, bore))
        held = [prescribe(space, i, at(i, 0.0)) for i in range(dim)]
        if kind == "tube in space":
            held.append(prescribe(space, 2, at(2, 0.5)))
        self.supports = Reduction.dirichlet(space, held)

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
