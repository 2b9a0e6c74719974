"""Two stacked blocks that are parts of one mesh; nodes need not match at the interface."""

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
from pw_elements._compat import cell_geometry_nodes
from pw_elements.contact import ContactPair, DeformableSurface
from pw_elements.elasticity import facet_nodes
from pw_elements.spaces import locate_exterior_facets
from study.model.elements import composite_spaces, taylor_hood_spaces
from tests.contact.cases import ElasticBody, on_plane

TOP_PRESSURE_OVER_MODULUS = 1e-3  # divided by Young's modulus of the lower block
PLANE_CELLS = ("triangle", "quadrilateral")
COMPARISON_SPACE_MAKERS_BY_NAME = {"composite": composite_spaces, "taylor_hood": taylor_hood_spaces}


def join_meshes(lower, upper, comm=MPI.COMM_SELF):
    """Return one mesh with the cells of two serial meshes, distributed over a communicator."""
    a, b = lower.geometry.x, upper.geometry.x
    cells = np.concatenate(
        [cell_geometry_nodes(lower), cell_geometry_nodes(upper) + len(a)]
    ).astype(np.int64)
    x = np.ascontiguousarray(np.concatenate([a, b])[:, : lower.geometry.dim])
    if comm.rank:
        cells, x = cells[:0], x[:0]
    return create_mesh(comm, cells=cells, x=x, e=lower.ufl_domain().ufl_coordinate_element())


def split_facets_by_side(elastic_body, marker, is_cell_beyond):
    """Split the marked exterior facets into those before and those beyond an interface.

    The function `is_cell_beyond` gets the midpoints (n, dim) of cells, and decides on which side of
    the interface the cells and their facets lie.
    """
    facets = locate_exterior_facets(elastic_body.mesh, marker)
    is_beyond_cell = is_cell_beyond(
        elastic_body.x[elastic_body.displacement_space.dofmap.list].mean(axis=1)
    )
    cells = elastic_body.mesh.topology.connectivity(elastic_body.dim - 1, elastic_body.dim)
    is_beyond_facet = np.array([is_beyond_cell[cells.links(f)[0]] for f in facets], dtype=bool)
    return facets[~is_beyond_facet], facets[is_beyond_facet]


def refine_middle(x):
    """Return nodes (n, 3) that are moved horizontally towards the middle of the unit square.

    Of equal cells, those at the rim become 5.5 times as wide as those in the middle.
    """
    centred = 2 * x[:, :2] - 1
    return np.column_stack([0.5 + 0.5 * (0.4 * centred + 0.6 * centred**3), x[:, 2]])


def round_lower_side(x):
    """Return nodes (n, 3) of the upper block, raised at its lower side by a paraboloid."""
    height = 0.1 * np.sum((x[:, :2] - 0.5) ** 2, axis=1) * (2 - x[:, 2])
    return np.column_stack([x[:, :2], x[:, 2] + height])


class StackedBlocks(ElasticBody):
    """Two stacked blocks that meet near x_up = 1, where x_up is the last coordinate.

    `divisions` are the numbers of cells of the lower and the upper block along the first axis.
    `lower_range` and `upper_range` are the smallest and largest coordinates of the blocks along the
    horizontal axes. `element` is the name of a method of `Spaces` or of a comparison element.
    `map_all` maps the nodes (n, 3) of both blocks, and `map_upper` then those of the upper block.
    `modulus_ratio` is Young's modulus of the upper block
    divided by that of the lower block, which is 1.
    """

    def __init__(
        self,
        divisions,
        cell="triangle",
        lower_range=(0.0, 1.0),
        upper_range=(0.0, 1.0),
        element="petrov_galerkin",
        map_upper=None,
        nu=0.3,
        modulus_ratio=1.0,
        state=None,
        comm=MPI.COMM_SELF,
        map_all=None,
    ):
        dim = 2 if cell in PLANE_CELLS else 3
        self.up = dim - 1

        def make_block_mesh(n, side_range, bottom):
            low = [side_range[0]] * self.up + [bottom]
            high = [side_range[1]] * self.up + [bottom + 1.0]
            build = create_box if dim == 3 else create_rectangle
            return build(MPI.COMM_SELF, [low, high], [n, n + 1, n][:dim], CellType[cell])

        lower_mesh, upper_mesh = (
            make_block_mesh(divisions[0], lower_range, 0.0),
            make_block_mesh(divisions[1], upper_range, 1.0),
        )
        if map_all is not None:
            for block_mesh in (lower_mesh, upper_mesh):
                block_mesh.geometry.x[:] = map_all(block_mesh.geometry.x)
        if map_upper is not None:
            upper_mesh.geometry.x[:] = map_upper(upper_mesh.geometry.x)
        mesh, material = join_meshes(lower_mesh, upper_mesh, comm), Material(1.0, nu)
        if modulus_ratio != 1:
            cells = np.arange(mesh.topology.index_map(dim).size_local, dtype=np.int32)
            is_upper = compute_midpoints(mesh, dim, cells)[:, self.up] > 1
            tags = meshtags(mesh, dim, cells, is_upper.astype(np.int32))
            material = Material.by_tag(mesh, tags, {0: material, 1: Material(modulus_ratio, nu)})
        state = state or ("solid" if dim == 3 else "plane strain")
        spaces = COMPARISON_SPACE_MAKERS_BY_NAME.get(element) or getattr(Spaces, element)
        super().__init__(mesh, spaces, state, material=material)
        low, high = split_facets_by_side(
            self, lambda x: np.abs(x[self.up] - 1.0) < 0.1, lambda x: x[:, self.up] > 1.0
        )
        self.sides = {
            "upper": self._keep_facets_between_blocks(high),
            "lower": self._keep_facets_between_blocks(low),
        }

    def _keep_facets_between_blocks(self, facets):
        """Return the given facets without those that lie on the lateral sides of the blocks."""
        extent = np.ptp(self.x[facet_nodes(self.displacement_space, facets)], axis=1)
        return facets[extent[:, self.up] < extent[:, : self.up].max(axis=1)]

    def side_node_mask(self, side):
        """Return the mask (n,) of the nodes on the "upper" or "lower" side of the interface."""
        mask = np.zeros(len(self.x), dtype=bool)
        facets = self.sides[side]
        mask[fem.locate_dofs_topological(self.displacement_space, self.up, facets)] = True
        return mask

    def traction_load(self, traction, where=None):
        """Assemble the load vector of a traction, by default on the top."""
        return super().traction_load(traction, where or on_plane(self.up, 2.0))

    def make_pair(self, slave="upper", friction=0.0, motions=()):
        """Return the contact pair with the "upper" or "lower" side as the slave."""
        master = "lower" if slave == "upper" else "upper"
        surface = DeformableSurface(self.sides[master])
        return ContactPair(self.side_node_mask(slave), surface, friction, motions)

    def fixed_base_moved_top_supports(self, translation, side_conditions=()):
        """Return supports that fix the base and move the top by a translation."""
        top_conditions = [(i, on_plane(self.up, 2.0), translation[i]) for i in range(self.dim)]
        return self.make_supports(
            *((i, on_plane(self.up, 0.0)) for i in range(self.dim)),
            *top_conditions,
            *side_conditions,
        )

    def solve_shifted_top(self, slave="upper", friction=0.2, **options):
        """Return the state after the top is moved down and sideways; the contact is not uniform."""
        supports = self.fixed_base_moved_top_supports(
            [0.01, -0.02] if self.dim == 2 else [0.01, -0.02, -0.02]
        )
        return self.solve_contact(self.make_pair(slave, friction), supports, **options)[0]

    def solve_uniaxial_compression(self, slave="upper", friction=0.0, load=None):
        """Return the state of uniaxial stress, caused by a pressure on the top.

        Supports hold the sides in the coordinate planes, which are planes of symmetry. If `load` is
        given, it replaces the load vector of the pressure.
        """
        load = (
            self.traction_load(-TOP_PRESSURE_OVER_MODULUS * np.eye(self.dim)[self.up])
            if load is None
            else load
        )
        supports = self.make_supports(*((i, on_plane(i, 0.0)) for i in range(self.dim)))
        return self.solve_contact(self.make_pair(slave, friction), supports, load)[0]

    def uniaxial_displacement(self, nu=0.3):
        """Return the exact displacements (nodes, dim) under the pressure on the top."""
        modulus = 1.0
        if self.body.state.value == "plane strain":
            modulus, nu = 1 / (1 - nu**2), nu / (1 - nu)
        return TOP_PRESSURE_OVER_MODULUS / modulus * self.x * ([nu] * self.up + [-1.0])
