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

from pw_elements import Material, Spaces
from pw_elements._compat import cell_nodes
from pw_elements.contact import ContactPair, DeformableSurface
from pw_elements.elasticity import facet_nodes
from pw_elements.spaces import locate_exterior_facets
from study.elements import composite, taylor_hood
from tests.contact.cases import Elastic, at

PRESSURE = 1e-3
PLANE = ("triangle", "quadrilateral")
RIVALS = {"composite": composite, "taylor_hood": taylor_hood}


def joined(lower, upper, comm=MPI.COMM_SELF):
    """One mesh of two meshes, on any communicator."""
    a, b = lower.geometry.x, upper.geometry.x
    cells = np.concatenate([cell_nodes(lower), cell_nodes(upper) + len(a)]).astype(np.int64)
    x = np.ascontiguousarray(np.concatenate([a, b])[:, : lower.geometry.dim])
    if comm.rank:
        cells, x = cells[:0], x[:0]
    return create_mesh(comm, cells=cells, x=x, e=lower.ufl_domain().ufl_coordinate_element())


def two_sides(elastic, marker, is_beyond):
    """Facets of a marker, of the cells whose middles (n, dim) are on this side, and beyond."""
    facets = locate_exterior_facets(elastic.mesh, marker)
    beyond = is_beyond(elastic.x[elastic.displacements.dofmap.list].mean(axis=1))
    cells = elastic.mesh.topology.connectivity(elastic.dim - 1, elastic.dim)
    behind = np.array([beyond[cells.links(f)[0]] for f in facets], dtype=bool)
    return facets[~behind], facets[behind]


class Stack(Elastic):
    """A block on another one; they meet near x_up = 1.

    `lower` and `upper` are their first and last coordinate across, `element` is a method of
    `Spaces` or a rival, `shape` maps the upper block's nodes (n, 3), and `ratio` is of the upper
    modulus to the lower one, which is 1.
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
        dim = 2 if cell in PLANE else 3
        self.up = dim - 1

        def block(n, sides, bottom):
            low = [sides[0]] * self.up + [bottom]
            high = [sides[1]] * self.up + [bottom + 1.0]
            build = create_box if dim == 3 else create_rectangle
            return build(MPI.COMM_SELF, [low, high], [n, n + 1, n][:dim], CellType[cell])

        below, above = block(divisions[0], lower, 0.0), block(divisions[1], upper, 1.0)
        if shape is not None:
            above.geometry.x[:] = shape(above.geometry.x)
        mesh, material = joined(below, above, comm), Material(1.0, nu)
        if ratio != 1:
            cells = np.arange(mesh.topology.index_map(dim).size_local, dtype=np.int32)
            above = compute_midpoints(mesh, dim, cells)[:, self.up] > 1
            tags = meshtags(mesh, dim, cells, above.astype(np.int32))
            material = Material.by_tag(mesh, tags, {0: material, 1: Material(ratio, nu)})
        state = state or ("solid" if dim == 3 else "plane strain")
        spaces = RIVALS.get(element) or getattr(Spaces, element)
        super().__init__(mesh, spaces, state, material=material)
        low, high = two_sides(
            self, lambda x: np.abs(x[self.up] - 1.0) < 0.1, lambda x: x[:, self.up] > 1.0
        )
        self.sides = {"upper": self._flat(high), "lower": self._flat(low)}

    def _flat(self, facets):
        """Facets that lie rather than stand, for the sides' may be among them."""
        extent = np.ptp(self.x[facet_nodes(self.displacements, facets)], axis=1)
        return facets[extent[:, self.up] < extent[:, : self.up].max(axis=1)]

    def nodes(self, side):
        mask = np.zeros(len(self.x), dtype=bool)
        facets = self.sides[side]
        mask[fem.locate_dofs_topological(self.displacements, self.up, facets)] = True
        return mask

    def load(self, traction, where=None):
        """Load vector of a traction, on top unless told otherwise."""
        return super().load(traction, where or at(self.up, 2.0))

    def pair(self, slave="upper", friction=0.0, motions=()):
        master = "lower" if slave == "upper" else "upper"
        surface = DeformableSurface(self.sides[master])
        return ContactPair(self.nodes(slave), surface, friction, motions)

    def moved_top(self, by, sides=()):
        """Supports: the base held, the top moved."""
        ends = [(i, at(self.up, 2.0), by[i]) for i in range(self.dim)]
        return self.held(*((i, at(self.up, 0.0)) for i in range(self.dim)), *ends, *sides)

    def askew(self, slave="upper", friction=0.2, **options):
        """The state of an uneven contact: pressed and pushed on by the top."""
        supports = self.moved_top([0.01, -0.02] if self.dim == 2 else [0.01, -0.02, -0.02])
        return self.contact(self.pair(slave, friction), supports, **options)[0]

    def pressed(self, slave="upper", friction=0.0, load=None):
        """The state of uniaxial stress: symmetry planes, a base that slides, pressure on top."""
        load = self.load(-PRESSURE * np.eye(self.dim)[self.up]) if load is None else load
        supports = self.held(*((i, at(i, 0.0)) for i in range(self.dim)))
        return self.contact(self.pair(slave, friction), supports, load)[0]

    def uniaxial(self, nu=0.3):
        """Its displacements (nodes, dim)."""
        modulus = 1.0
        if self.body.state.value == "plane strain":
            modulus, nu = 1 / (1 - nu**2), nu / (1 - nu)
        return PRESSURE / modulus * self.x * ([nu] * self.up + [-1.0])
