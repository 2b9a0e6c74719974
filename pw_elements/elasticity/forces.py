"""Nodal forces and fluxes on the boundary, pressures, and the matrix T that makes forces even.

Three measures of contact pressure (and shear) must not be mixed:

1. the nodal force itself;
2. the nodal force divided by the surface integral of the node's test function;
3. the nodal force divided by the geometric tributary area of the node: each facet is divided at the
   midpoints of its edges, and the area of each sub-facet is distributed equally to its corners.

The guide's page on theory shows for which element each measure is even, and why reactions are
fluxes ("Reactions and fluxes").
"""

from dataclasses import dataclass
from typing import Literal, get_args

from petsc4py import PETSc

import basix
import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
import ufl
from dolfinx import fem, la
from dolfinx.mesh import Mesh, exterior_facet_indices
from scipy.spatial import cKDTree
from ufl.core.expr import Expr

from pw_elements.algebra import is_finite
from pw_elements.arrays import Array, Indices, LocalIndices, Mask
from pw_elements.checks import (
    JoinedSpace,
    arguments,
    check_same_arguments_on_all_processes,
    evaluate_at_owned_nodes,
    list_bodies,
    raise_errors_on_all_processes,
)
from pw_elements.elasticity.body import Body
from pw_elements.elasticity.boundary import boundary_measure
from pw_elements.elasticity.material import ScalarCoefficient
from pw_elements.spaces import (
    EntitySelection,
    Marker,
    Spaces,
    assemble_vector,
    gather_nodal_values,
    is_hybrid,
    locate_exterior_facets,
    piecewise_linear_sub_cell_element,
    quadratic_element,
    require_nodes,
    scalar_component_space,
)

# Fractions of a mid-side node's force (standard element): T leaves the first fraction at the node
# and moves the second one to each vertex
_MIDSIDE_FORCE_FRACTION_KEPT = 3 / 4
_MIDSIDE_FORCE_FRACTION_TO_VERTEX = 1 / 8
# The integral of a node's weight function is regarded as zero if it is smaller than this fraction
# of the node's tributary area
_WEIGHT_AREA_ROUND_OFF_OVER_TRIBUTARY_AREA = 1e-9

NodalAreaKind = Literal["geometric", "weight"]


@check_same_arguments_on_all_processes
def force_transfer(space: fem.FunctionSpace) -> PETSc.Mat:
    """Assemble the matrix T, (n, n), that makes nodal forces of the standard element even.

    Three quarters of a mid-side node's force stay at the node and an eighth goes to each vertex. On
    quadrilaterals and hexahedra T is the tensor product of this rule for intervals. Below, K_G and
    f_G are the stiffness and load of the standard (Galerkin) element; K_PW and f_PW are the
    stiffness and load with piecewise-linear weight functions. Under uniform tractions on straight
    sides, T f_G = f_PW for every type of cell.

    On straight-sided triangles with constant elasticity and thickness, in plane stress or strain,
    K_PW = T K_G holds as well; the guide's page on theory contains the proof. On other cells T K_G
    differs from K_PW, though both make forces even. Quadratic mortar methods construct dual
    multipliers by a transformation of this form, with 1/5 instead of 1/8 (A. Popp et al.,
    https://doi.org/10.1137/110848190).

        even = force_transfer(U) * reactions(K, a, f)  # reactions of the standard element

    Args:
        space: quadratic Lagrange trial space, on any type of cell.

    Raises:
        ValueError: for any other space. Quadratic Lagrange spaces have a node in the middle of each
            edge and, on quadrilaterals and hexahedra, of each face and cell.
    """
    return transposed_force_transfer(space).transpose()


def transposed_force_transfer(space: fem.FunctionSpace, inverse: bool = False) -> PETSc.Mat:
    """Assemble the transpose T^T, (n, n), of the matrix of `force_transfer`, or its inverse."""
    arguments.check_function_space(space)
    basix_element, element = space.element.basix_element, space.ufl_element()
    cell = space.mesh.topology.cell_name()
    if element != quadratic_element(cell, tuple(element.reference_value_shape)):
        raise ValueError("the force transfer T exists for quadratic Lagrange spaces only")
    # on an interval T = [1, b; 0, a] for vertex and middle, and T^-1 = [1, -b/a; 0, 1/a]
    a, b = _MIDSIDE_FORCE_FRACTION_KEPT, _MIDSIDE_FORCE_FRACTION_TO_VERTEX
    parts = (1 / a, -b / a) if inverse else (a, b)
    cell_T = sp.csr_matrix(_force_transfer_of_cell(basix_element, *parts)).tocoo()
    index_map, block = space.dofmap.index_map, space.dofmap.index_map_bs
    cells, owned = space.dofmap.list, index_map.size_local
    target, source = cells[:, cell_T.row].ravel(), cells[:, cell_T.col].ravel()
    is_owned = source < owned  # an owned source node and its targets share a local cell
    entries = np.stack([source[is_owned], target[is_owned]])
    entries, index = np.unique(entries, axis=1, return_index=True)
    value = np.tile(cell_T.data, len(cells))[is_owned][index]
    column = index_map.local_to_global(entries[1].astype(np.int32))
    shape = (owned, index_map.size_global)
    rows = sp.kron(sp.csr_matrix((value, (entries[0], column)), shape), np.eye(block), "csr")
    sizes = (owned * block, index_map.size_global * block)
    csr = (rows.indptr.astype(PETSc.IntType), rows.indices.astype(PETSc.IntType), rows.data)
    return PETSc.Mat().createAIJ((sizes, sizes), bsize=block, csr=csr, comm=space.mesh.comm)


def _force_transfer_of_cell(
    element: basix.finite_element.FiniteElement,
    midside_fraction_kept: float,
    midside_fraction_to_vertex: float,
) -> Array:
    """Return the force transfer matrix (nodes, nodes) of one cell.

    Column j contains the fractions of node j's force that go to each node.

    Args:
        element: quadratic Lagrange element.
        midside_fraction_kept: on an interval, fraction of the middle node's force that stays at
            this node.
        midside_fraction_to_vertex: on an interval, fraction of the middle node's force that goes to
            each vertex.
    """
    counts = [len(np.ravel(dofs)) for dofs in element.entity_dofs]
    dimension_of_node = np.repeat(np.arange(len(counts)), counts)  # of the entity of each node
    T = np.zeros((element.dim, element.dim))
    for dimension, entities in enumerate(element.entity_dofs):
        for entity, dofs in enumerate(entities):
            closure = element.entity_closure_dofs[dimension][entity]
            for dof in dofs:  # nodes in the middle of the entity in all its directions
                n_kept = dimension_of_node[closure]  # number of directions in which the force stays
                T[closure, dof] = midside_fraction_kept**n_kept * midside_fraction_to_vertex ** (
                    dimension - n_kept
                )
    return T


@dataclass(frozen=True)
class BoundaryForces:
    """Nodal forces along a boundary line, ordered by position.

    Args:
        position: coordinates (m, 3) of the nodes.
        force: forces (m, components) at the nodes.
    """

    position: Array
    force: Array


@check_same_arguments_on_all_processes
def forces_along(space: fem.FunctionSpace, forces: PETSc.Vec, where: Marker) -> BoundaryForces:
    """Gather nodal forces at the nodes that a marker selects, sorted by their coordinates.

        held = forces_along(U, reactions(K, a, f), lambda x: np.isclose(x[0], 0))
        axes.plot(held.position[:, 1], held.force)

    The result contains the nodes of all processes and is the same on all of them.

    Args:
        space: trial space.
        forces: vector (n,) of nodal forces.
        where: marker, a function of points (3, n) that returns a mask (n,).

    Raises:
        ValueError: if no node is selected, the marker raises an error or does not return truth
            values, or the vector is not finite or does not belong to the space.
    """
    arguments.check_function_space(space)
    with raise_errors_on_all_processes(space.mesh.comm):
        arguments.check_petsc_vector("the vector of forces", forces, "the space", space)
    if not is_finite(forces):
        raise ValueError("the vector of forces is not finite")
    nodes = require_nodes(space, "the line", where)
    values = forces.array_r.reshape(-1, space.dofmap.index_map_bs)
    return BoundaryForces(*_gather_nodes_sorted_by_position(space, nodes, values)[:2])


@dataclass(frozen=True)
class SurfaceNodes:
    """Nodes of a part of the boundary, sorted by position; the same on every process.

    In the plane, the area of a boundary line is its length times the thickness. In axisymmetry it
    is the area of the surface of revolution.

    Args:
        position: coordinates (m, dim) of the nodes.
        weight_area: surface integral (m,) of each node's test (weight) function.
        tributary_area: surface integral (m,) of each node's piecewise-linear function.
        edges: indices (e, 3) of the mid-side node and both corners of each edge of the surface.
        rim: mask (m,) of the nodes at the ends of a line or on the border of a surface.
        node: global numbers (m,) of the nodes in the space, which depend on the number of
            processes.
        facets: indices (f, k) of the nodes of each facet in Basix' order, corners first.
    """

    position: Array
    weight_area: Array
    tributary_area: Array
    edges: Indices
    rim: Mask
    node: Indices
    facets: Indices

    @classmethod
    @check_same_arguments_on_all_processes
    def from_body(
        cls, body: Body, where: EntitySelection, area_stretch: Expr | None = None
    ) -> "SurfaceNodes":
        """Collect the nodes of a part of a body's boundary.

        A `ContactPair` with the same marker has the same nodes if the marked part ends at vertices
        of the mesh (for a solid body, at whole edges).

        Args:
            body: body to which the boundary belongs.
            where: part of the boundary, given in one of three ways: a marker, a function of points
                (3, n) that returns a mask (n,) and has to hold at every vertex of a facet; local
                numbers of facets, as returned by `MeshTags.find`; or a mask of all local facets.
            area_stretch: ratio of deformed to undeformed area, from `SurfaceNodes.area_stretch`, to
                get the areas of the deformed boundary. If None, areas are undeformed.

        Raises:
            ValueError: if no facet is selected, the marker raises an error or does not return truth
                values, or a number does not belong to a facet.
        """
        arguments.check_type("body", body, Body, "Body(spaces, material, state) makes one")
        arguments.check_type(
            "area_stretch", area_stretch, Expr | None, "SurfaceNodes.area_stretch(u) makes it"
        )
        depth = (
            body._out_of_plane_depth()
            if area_stretch is None
            else body._out_of_plane_depth() * area_stretch
        )
        return cls.from_scalar_spaces(
            _scalar_component_spaces(body.spaces.displacements), where, depth
        )

    @classmethod
    @check_same_arguments_on_all_processes
    def from_scalar_spaces(
        cls, spaces: Spaces, where: EntitySelection, depth: ScalarCoefficient = 1.0
    ) -> "SurfaceNodes":
        """Collect the nodes of a part of the boundary of a scalar problem.

        Args:
            spaces: trial and test space of the scalar unknown.
            where: part of the boundary, as in `from_body`.
            depth: factor by which lengths or areas of the mesh are multiplied, such as a thickness
                or 2 pi r.

        Raises:
            ValueError: in the same cases as `from_body`, and if the spaces are not scalar.
        """
        arguments.check_type("spaces", spaces, Spaces, "Spaces.petrov_galerkin(mesh, 0) makes some")
        if spaces.trial.ufl_element().reference_value_shape != ():
            raise ValueError("the spaces have components: it takes those of a scalar")
        depth = arguments.check_positive_coefficient("depth", depth, spaces.mesh.comm)
        position, weight_area, node = _gather_nodes_and_weight_areas(spaces, where, depth)
        linear_position, linear_area = position, weight_area
        if spaces.test.ufl_element() != piecewise_linear_sub_cell_element(
            spaces.mesh.topology.cell_name()
        ):
            linear_position, linear_area, _ = _gather_nodes_and_weight_areas(
                Spaces.petrov_galerkin(spaces.mesh, 0), where, depth
            )
        if not linear_area.min(initial=np.inf) > 0:
            raise ValueError("the depth or thickness is not positive: a node there has no area")
        facets = _gather_facets_as_indices_into_nodes(spaces.trial, where, node)
        edges, rim_nodes = _find_edges_and_rim_nodes(facets, spaces.mesh)
        rim = np.isin(np.arange(len(position)), rim_nodes)
        tributary_area = linear_area[cKDTree(linear_position).query(position)[1]]
        return cls(position, weight_area, tributary_area, edges, rim, node, facets)

    @staticmethod
    def area_stretch(u: fem.Function) -> Expr:
        """Return the ratio of deformed to undeformed area of a surface (in the plane, of length).

        Nominal pressures are contact forces divided by undeformed areas, true pressures are contact
        forces divided by deformed areas:

            spaces = Spaces.petrov_galerkin(mesh, 0)
            nominal = SurfaceNodes.from_scalar_spaces(spaces, top).pressure(pair.force_normal)
            deformed = SurfaceNodes.from_scalar_spaces(spaces, top, SurfaceNodes.area_stretch(u))
            true = deformed.pressure(pair.force_normal)

        Args:
            u: displacements, or displacements and a pressure. The areas are computed with the
                values that `u` has when the `SurfaceNodes` are created.
        """
        arguments.check_type("u", u, fem.Function, "as_function(U, a) makes a function of a vector")
        space = u.function_space
        displacement = ufl.split(u)[0] if is_hybrid(space) else u
        shape = displacement.ufl_shape
        if shape != (space.mesh.geometry.dim,):
            raise ValueError(f"the displacement has the shape {shape}: give a vector")
        F = ufl.Identity(space.mesh.geometry.dim) + ufl.grad(displacement)
        area_vector = ufl.det(F) * ufl.inv(F).T * ufl.FacetNormal(space.mesh)
        return ufl.sqrt(ufl.inner(area_vector, area_vector))

    def pressure(self, force: Array) -> Array:
        """Divide nodal forces by the surface integrals of the nodes' test functions.

        Args:
            force: nodal forces (m,) or (m, components).

        Returns:
            Pressures of the same shape; NaN where the integral is zero.

        Raises:
            ValueError: if there is not one force for each node.
        """
        force = self._check_nodal_values(force)
        has_no_weight = (
            self.weight_area < _WEIGHT_AREA_ROUND_OFF_OVER_TRIBUTARY_AREA * self.tributary_area
        )
        area = np.where(has_no_weight, np.nan, self.weight_area)
        return (force.T / area).T

    def tributary_pressure(self, force: Array) -> Array:
        """Divide nodal forces by the tributary areas of the nodes.

        Args:
            force: nodal forces (m,) or (m, components).

        Returns:
            Pressures of the same shape.

        Raises:
            ValueError: if there is not one force for each node.
        """
        force = self._check_nodal_values(force)
        return (force.T / self.tributary_area).T

    def sawtooth(self, force: Array, closed: Mask | None = None) -> float:
        """Compute the median ratio of a mid-side node's force to the mean of both corners' forces.

        For uniform pressure in the plane, the ratio is 2 with the standard element. It is 1 for
        even forces, and NaN if no edge remains.

        Args:
            force: normal nodal forces (m,).
            closed: mask (m,) of the nodes in contact. Edges with a rim node or with a node that is
                not in contact are left out. If None, all nodes are taken to be in contact.

        Raises:
            ValueError: if there is not one value for each node.
        """
        middle, mean = self._midside_values_and_corner_means(force, closed)
        with np.errstate(divide="ignore"):  # forces at corners of 10-node tetrahedra may be zero
            return float(np.median(middle / mean)) if len(middle) else np.nan

    def unevenness(self, values: Array, closed: Mask | None = None) -> float:
        """Compute the median second difference along edges, divided by the median value.

        The second difference is the value at the mid-side node minus the mean of both corners'
        values. It is zero for forces or pressures that vary linearly. Medians are taken of absolute
        values. The result is NaN if no edge remains.

        Args:
            values: forces or pressures (m,) at the nodes.
            closed: mask (m,) of the nodes in contact. Edges with a rim node or with a node that is
                not in contact are left out. If None, all nodes are taken to be in contact.

        Raises:
            ValueError: if there is not one value for each node.
        """
        middle, mean = self._midside_values_and_corner_means(values, closed)
        if not len(middle):
            return np.nan
        return float(np.median(np.abs(middle - mean)) / np.median(np.abs(middle + mean) / 2))

    def _midside_values_and_corner_means(
        self, values: Array, closed: Mask | None
    ) -> tuple[Array, Array]:
        """Return the values at mid-side nodes, and the means of both corners' values, of edges.

        Edges with a rim node, or with a node that is not in contact, are left out.
        """
        values = self._check_nodal_values(values, only_scalars=True)
        counts = ~self.rim
        if closed is not None:
            closed = np.asarray(closed)
            if closed.shape != self.rim.shape or closed.dtype != bool:
                raise ValueError(f"closed: it has to be True or False for {len(self.rim)} nodes")
            counts = counts & closed
        edges = self.edges[counts[self.edges].all(axis=1)]
        return values[edges[:, 0]], values[edges[:, 1:]].mean(axis=1)

    def _check_nodal_values(self, values: Array, only_scalars: bool = False) -> Array:
        """Return values as an array; raise ValueError unless each node has one value or row."""
        count = len(self.position)
        try:
            array = np.asarray(values)
        except ValueError:  # rows of different lengths
            array = np.empty(0, dtype=object)
        if array.dtype.kind not in "iuf" or array.ndim not in ((1,) if only_scalars else (1, 2)):
            raise ValueError(
                f"values are {array.dtype} of the shape {array.shape}: they have to be numbers "
                f"({count},)" + ("" if only_scalars else f" or ({count}, components)")
            )
        if len(array) != count:
            raise ValueError(
                f"{len(array)} values for the {count} nodes of the surface: the "
                "marker of a contact pair has to end at vertices to have the surface's nodes"
            )
        return array


def order_by_position(position: Array, tie_break: Array | None = None) -> npt.NDArray[np.intp]:
    """Return indices (m,) that sort nodes by their first coordinate, then by the next ones.

    The order does not depend on the partition of the mesh. The round-off in positions of mid-side
    nodes depends on it, and coordinates are therefore rounded before they are compared.

    Args:
        position: coordinates (m, dim) of the nodes.
        tie_break: keys (m, k) by which nodes at equal positions are sorted.
    """
    extent = np.ptp(position, axis=0).max(initial=0.0) if len(position) else 0.0
    keys = position if tie_break is None else np.hstack([position, tie_break])
    return np.lexsort(np.round(keys / (extent or 1.0), 9).T[::-1])


def facet_nodes(space: fem.FunctionSpace, facets: LocalIndices) -> LocalIndices:
    """Return the local numbers (f, k) of the nodes of exterior facets (f,), in Basix' order."""
    cells, cell_dofs = locate_facet_nodes_in_cells(space, facets)
    return np.asarray(space.dofmap.list[cells[:, None], cell_dofs])


def mark_boundary_nodes(space: fem.FunctionSpace | JoinedSpace) -> Mask:
    """Return a mask (owned nodes,) of the nodes on exterior facets; collective."""
    if isinstance(space, JoinedSpace):
        return evaluate_at_owned_nodes(mark_boundary_nodes, space)
    topology, index_map = space.mesh.topology, space.dofmap.index_map
    topology.create_connectivity(topology.dim - 1, topology.dim)
    marks = la.vector(index_map, 1)
    marks.array[:] = 0.0
    marks.array[facet_nodes(space, exterior_facet_indices(topology))] = 1.0
    marks.scatter_reverse(la.InsertMode.add)
    return np.asarray(marks.array[: index_map.size_local] > 0)


def locate_facet_nodes_in_cells(
    space: fem.FunctionSpace, facets: LocalIndices
) -> tuple[LocalIndices, LocalIndices]:
    """Return the cell (f,) of each exterior facet, and local indices (f, k) of the facet's nodes.

    A local index is the position of the node in the list of the cell's nodes.
    """
    dim = space.mesh.topology.dim
    topology, layout = space.mesh.topology, space.dofmap.dof_layout
    topology.create_connectivity(dim - 1, dim)
    topology.create_connectivity(dim, dim - 1)
    cells_of_facet = topology.connectivity(dim - 1, dim)
    facets_of_cell = topology.connectivity(dim, dim - 1)
    n_facets = len(basix.topology(space.mesh.basix_cell())[dim - 1])
    cells = cells_of_facet.array[cells_of_facet.offsets[facets]]
    local_facet = (facets_of_cell.array.reshape(-1, n_facets)[cells] == facets[:, None]).argmax(
        axis=1
    )
    closure = np.array([layout.entity_closure_dofs(dim - 1, k) for k in range(n_facets)])
    return cells, closure[local_facet]


def exterior_facets_with_all_nodes(space: fem.FunctionSpace, global_nodes: Indices) -> LocalIndices:
    """Return the local numbers of the exterior facets all of whose nodes are in a given set.

    Args:
        space: space of the nodes.
        global_nodes: global numbers (m,) of the nodes.
    """
    (facets,) = exterior_facets_of_bodies_with_all_nodes(space, global_nodes)
    return facets


def exterior_facets_of_bodies_with_all_nodes(
    space: fem.FunctionSpace | JoinedSpace, global_nodes: Indices
) -> list[LocalIndices]:
    """Return, for each body of a space, its exterior facets with all nodes in a given set.

    Args:
        space: space of the nodes.
        global_nodes: global numbers (m,) of the nodes.
    """
    index_map = space.dofmap.index_map
    local = index_map.global_to_local(global_nodes)
    is_selected = np.zeros(index_map.size_local + index_map.num_ghosts, dtype=bool)
    is_selected[local[local >= 0]] = True
    facets_of_bodies = []
    for body in list_bodies(space):
        topology = body.space.mesh.topology
        topology.create_connectivity(topology.dim - 1, topology.dim)
        facets = exterior_facet_indices(topology)
        nodes = body.nodes[facet_nodes(body.space, facets)]
        facets_of_bodies.append(np.asarray(facets[is_selected[nodes].all(axis=1)]))
    return facets_of_bodies


def _gather_nodes_and_weight_areas(
    spaces: Spaces, where: EntitySelection, depth: ScalarCoefficient
) -> tuple[Array, Array, Indices]:
    """Gather the nodes of a surface from all processes.

    Returns:
        Positions (m, dim) of the nodes, integrals (m,) of their test functions, and their global
        numbers (m,).
    """
    space, mesh = spaces.trial, spaces.mesh
    form = depth * ufl.TestFunction(spaces.test) * boundary_measure(mesh, where)
    integrals = assemble_vector(form).array_r
    facets = locate_exterior_facets(mesh, where)
    nodes = fem.locate_dofs_topological(space, mesh.topology.dim - 1, facets)
    position, area, node = _gather_nodes_sorted_by_position(space, nodes, integrals)
    return position[:, : mesh.geometry.dim], area, node


def _gather_nodes_sorted_by_position(
    space: fem.FunctionSpace, nodes: LocalIndices, values: Array
) -> tuple[Array, Array, Indices]:
    """Gather nodes from all processes, sorted by position.

    Args:
        space: space of the nodes.
        nodes: local numbers of the nodes; ghosts are skipped.
        values: values (owned nodes, ...) at all nodes of this process.

    Returns:
        Positions (m, 3) of the nodes, values (m, ...), and global numbers (m,).
    """
    index_map, comm = space.dofmap.index_map, space.mesh.comm
    nodes = nodes[nodes < index_map.size_local]
    numbers = nodes + np.int64(index_map.local_range[0])
    local_parts = space.tabulate_dof_coordinates()[nodes], values[nodes], numbers
    position, values, numbers = (np.concatenate(comm.allgather(part)) for part in local_parts)
    order = order_by_position(position)
    return position[order], values[order], numbers[order]


def _gather_facets_as_indices_into_nodes(
    space: fem.FunctionSpace, where: EntitySelection, global_nodes: Indices
) -> Indices:
    """Gather the facets of a part of the boundary from all processes.

    Returns:
        Indices (f, k) of the facets' nodes in the array `global_nodes` (m,) of global numbers.
    """
    facets = facet_nodes(space, locate_exterior_facets(space.mesh, where))
    numbers = space.dofmap.index_map.local_to_global(facets.ravel()).reshape(facets.shape)
    order = np.argsort(global_nodes)
    all_facets = np.concatenate(space.mesh.comm.allgather(numbers))
    return np.unique(order[np.searchsorted(global_nodes, all_facets, sorter=order)], axis=0)


def _find_edges_and_rim_nodes(facets: Indices, mesh: Mesh) -> tuple[Indices, Indices]:
    """Return the edges (e, 3) of facets (mid-side node, then corners), and the nodes on the rim.

    The rim consists of the edges that belong to only one facet; in the plane, of such end nodes.
    """
    dim = mesh.topology.dim
    facet_type = basix.cell.subentity_types(mesh.basix_cell())[dim - 1][0]
    facet_topology = basix.topology(facet_type)
    corners = len(facet_topology[0])
    edges = np.concatenate(
        [facets[:, [corners + e, *ends]] for e, ends in enumerate(facet_topology[1])]
    )
    edges[:, 1:].sort(axis=1)
    ends = edges if dim == 3 else facets[:, :corners].reshape(-1, 1)
    rim, count = np.unique(ends, axis=0, return_counts=True)
    return np.unique(edges, axis=0), np.unique(rim[count == 1])


@dataclass(frozen=True)
class NodalFlux:
    """Fluxes at the nodes of a part of the boundary, the same on every process.

    Args:
        surface: positions, areas, edges and rim of the nodes.
        reaction: flow (m,) or (m, components) into the body at each node.
        flux: reaction divided by the node's area, (m,) or (m, components); NaN where the area is
            zero.
    """

    surface: SurfaceNodes
    reaction: Array
    flux: Array


@check_same_arguments_on_all_processes
def nodal_flux(
    spaces: Spaces,
    reactions: PETSc.Vec,
    where: EntitySelection,
    area: NodalAreaKind = "geometric",
    depth: ScalarCoefficient = 1.0,
) -> NodalFlux:
    """Compute the flux into a body at the nodes of a boundary on which the field is prescribed.

        K, f = assemble_matrix(k * inner(grad(u), grad(v)) * dx), assemble_vector(q * v * dx)
        a = solve(K, f, Reduction.dirichlet(spaces.trial, conditions))
        heat = nodal_flux(spaces, reactions(K, a, f), lambda x: np.isclose(x[0], 0.0))
        heat.surface.position, heat.flux

    With the standard quadratic element, reactions divided by geometric areas oscillate between
    vertices and mid-side nodes. To make them even, multiply the reactions by
    `force_transfer(space)`.

    If the part of the boundary is adjacent to another part with prescribed values, the reactions at
    the nodes between them belong to both parts. Leave these nodes out (`surface.rim`), or treat
    both parts as one.

    Args:
        spaces: trial and test space of the field, which is scalar or has components.
        reactions: vector (n,) of reactions, from the function `reactions` or the method
            `PetrovGalerkinProblem.reactions`.
        where: part of the boundary, as in `boundary_measure`.
        area: divisor of the reactions: "geometric" for the tributary area of the node, "weight" for
            the integral of its test function. Both are equal for piecewise-linear weight functions.
        depth: factor by which lengths or areas of the mesh are multiplied, such as a thickness or
            2 pi r.

    Raises:
        TypeError: for arguments of the wrong type.
        ValueError: if the vector is not finite or belongs to another space, the area is unknown,
            the depth is not positive, or no facet is selected.
    """
    arguments.check_type("spaces", spaces, Spaces, "Spaces.petrov_galerkin(mesh, 0) makes some")
    space = spaces.trial
    with raise_errors_on_all_processes(space.mesh.comm):
        arguments.check_petsc_vector("the vector of reactions", reactions, "the space", space)
    if not arguments.is_one_of(area, get_args(NodalAreaKind)):
        raise ValueError(f"area {area!r}: it is 'geometric' or 'weight'")
    if not is_finite(reactions):
        raise ValueError("the vector of reactions is not finite")
    surface = SurfaceNodes.from_scalar_spaces(_scalar_component_spaces(spaces), where, depth)
    values = reactions.array_r.reshape(-1, space.dofmap.index_map_bs)
    reaction = gather_nodal_values(space, surface.node, values)
    if not space.num_sub_spaces:
        reaction = reaction[:, 0]
    divide = surface.pressure if area == "weight" else surface.tributary_pressure
    return NodalFlux(surface, reaction, divide(reaction))


def _scalar_component_spaces(spaces: Spaces) -> Spaces:
    """Return the scalar spaces of one component; nodes are numbered as in `spaces`."""
    if not spaces.trial.num_sub_spaces:
        return spaces
    trial = scalar_component_space(spaces.trial)
    return Spaces(
        trial, trial if spaces.test is spaces.trial else scalar_component_space(spaces.test)
    )
