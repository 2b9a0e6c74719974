"""Two blocks on each other, parts of one mesh that need not match where they meet."""

from mpi4py import MPI

import numpy as np
from dolfinx import fem
from dolfinx.mesh import (
    CellType,
    compute_midpoints,
    create_box,
    create_mesh,
    create_rectangle,
    meshtags,
)

from pw_elements import Body, Material, Spaces, assemble_matrix, assemble_vector, boundary_measure
from pw_elements._compat import cell_nodes
from pw_elements.contact import ContactPair, DeformableSurface
from pw_elements.elasticity import facet_nodes
from pw_elements.spaces import SubSpace, exterior_facets


def joined(lower, upper, comm=MPI.COMM_SELF):
    """One mesh of two meshes, on any communicator."""
    a, b = lower.geometry.x, upper.geometry.x
    cells = np.concatenate([cell_nodes(lower), cell_nodes(upper) + len(a)]).astype(np.int64)
    x = np.ascontiguousarray(np.concatenate([a, b])[:, : lower.geometry.dim])
    if comm.rank:
        cells, x = cells[:0], x[:0]
    return create_mesh(comm, cells=cells, x=x, e=lower.ufl_domain().ufl_coordinate_element())


class Stack:
    """A block on another one; they meet near x_up = 1.

    Args:
        divisions: of the lower and the upper one.
        cell: of both.
        lower: first and last coordinate across, of the lower one.
        upper: of the upper one.
        element: method of `Spaces`.
        shape: of the upper block's nodes (n, 3) to new ones.
        nu: Poisson's ratio.
        ratio: of the upper modulus to the lower one, which is 1.
        state: of stress; plane strain unless given, or solid.
        comm: of the mesh.
    """

    def __init__(
        self,
        divisions,
        cell="triangle",
        lower=(0.0, 1.0),
        upper=(0.0, 1.0),
        element="petrov_galerkin",
        shape=None,
        nu=0.3,
        ratio=1.0,
        state=None,
        comm=MPI.COMM_SELF,
    ):
        self.dim = 3 if cell in ("tetrahedron", "hexahedron") else 2
        self.up = self.dim - 1

        def block(n, sides, bottom):
            low = [sides[0]] * self.up + [bottom]
            high = [sides[1]] * self.up + [bottom + 1.0]
            build = create_box if self.dim == 3 else create_rectangle
            return build(MPI.COMM_SELF, [low, high], [n, n + 1, n][: self.dim], CellType[cell])

        below, above = block(divisions[0], lower, 0.0), block(divisions[1], upper, 1.0)
        if shape is not None:
            above.geometry.x[:] = shape(above.geometry.x)
        mesh = joined(below, above, comm)
        state = state or ("solid" if self.dim == 3 else "plane strain")
        material = Material(1.0, nu)
        if ratio != 1:
            cells = np.arange(mesh.topology.index_map(self.dim).size_local, dtype=np.int32)
            above = compute_midpoints(mesh, self.dim, cells)[:, self.up] > 1
            tags = meshtags(mesh, self.dim, cells, above.astype(np.int32))
            material = Material.by_tag(mesh, tags, {0: material, 1: Material(ratio, nu)})
        self.body = Body(getattr(Spaces, element)(mesh), material, state)
        self.mesh, self.space = mesh, self.body.spaces.trial
        self.K = assemble_matrix(self.body.stiffness())
        self.displacements = SubSpace.displacements(self.space).space
        self.x = self.displacements.tabulate_dof_coordinates()[:, : self.dim]
        of_upper = self.x[self.displacements.dofmap.list].mean(axis=1)[:, self.up] > 1.0
        facets = exterior_facets(mesh, lambda x: np.abs(x[self.up] - 1.0) < 0.1)
        corners = self.x[facet_nodes(self.displacements, facets)]
        extent = np.ptp(corners, axis=1)
        facets = facets[extent[:, self.up] < extent[:, : self.up].max(axis=1)]  # but no side's
        cells = mesh.topology.connectivity(self.up, self.dim)
        above = np.array([of_upper[cells.links(f)[0]] for f in facets], dtype=bool)
        self.sides = {"upper": facets[above], "lower": facets[~above]}

    def nodes(self, side):
        """Mask of the nodes of one body's part."""
        mask = np.zeros(len(self.x), dtype=bool)
        facets = self.sides[side]
        mask[fem.locate_dofs_topological(self.displacements, self.up, facets)] = True
        return mask

    def load(self, traction):
        """Load vector of a traction on top."""
        top = boundary_measure(self.mesh, lambda x: np.isclose(x[self.up], 2.0))
        return assemble_vector(self.body.surface_load(np.asarray(traction), top))

    def pair(self, slave="upper", friction=0.0, motions=()):
        """A mortar pair."""
        master = "lower" if slave == "upper" else "upper"
        surface = DeformableSurface(self.sides[master])
        return ContactPair(self.nodes(slave), surface, friction, motions)
