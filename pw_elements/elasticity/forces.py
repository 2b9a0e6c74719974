"""Nodal forces: their redistribution matrix T, their reading at nodes, pressures, sawtooth.

Three measures of contact pressure (and shear) are in use, and they must never be mixed:

1. the nodal force itself;
2. the nodal force over the integral of the node's own test function over the surface;
3. the nodal force over the geometric tributary area of the node: facets are halved once, and the
   area of each sub-facet is shared equally by its corners.

Which of them is even with which element, and why reactions are fluxes, is in the guide's page on
theory ("Reactions and fluxes").
"""

from dataclasses import dataclass
from typing import Literal, get_args

from petsc4py import PETSc

import basix
import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
import ufl
from dolfinx import fem
from dolfinx.mesh import Mesh, exterior_facet_indices
from scipy.spatial import cKDTree
from ufl.core.expr import Expr

from pw_elements.algebra import is_finite
from pw_elements.arrays import Array, Indices, LocalIndices, Mask
from pw_elements.checks import arguments, check_same_arguments, collective_errors
from pw_elements.elasticity.body import Body, Scalar, boundary_measure
from pw_elements.spaces import (
    Marker,
    Part,
    Spaces,
    assemble_vector,
    gather_from_owners,
    is_hybrid,
    locate_any_nodes,
    locate_exterior_facets,
    macro_element,
    quadratic_element,
    scalar_space,
)

# Shares of a mid-side node's Galerkin force that stay with it and go to either vertex
_STAYS = 3 / 4
_GOES = 1 / 8

Area = Literal["geometric", "weight"]


@check_same_arguments
def force_transfer(space: fem.FunctionSpace) -> PETSc.Mat:
    """Matrix T, (n, n), that evens out the nodal forces of the standard quadratic element.

    Three quarters of a mid-side node's force stay with it and an eighth goes to either vertex; on
    quadrilaterals and hexahedra T is the tensor product of this rule for intervals. Under uniform
    tractions on straight sides the result is the nodal forces of the piecewise-linear weights: T
    f_G = f_PW on every cell.

    On straight-sided triangles with constant D and t, in plane stress or strain, K_PW = T K_G, too:
    the guide's page on theory has the proof. On other cells T K_G is another stiffness, though both
    even out forces. A transformation of this form, but with 1/5 in place of 1/8, gives quadratic
    mortar methods their dual multipliers (A. Popp et al., https://doi.org/10.1137/110848190).

        even = force_transfer(U) * reactions(K, a, f)  # of the standard element

    Args:
        space: quadratic Lagrange trial space, of any cell.

    Raises:
        ValueError: if the space is not quadratic, with a node in the middle of each edge (and of
            each face and cell of quadrilaterals and hexahedra).
    """
    return transposed_transfer(space).transpose()


def transposed_transfer(space: fem.FunctionSpace, inverse: bool = False) -> PETSc.Mat:
    """T^T, (n, n), or T^-T, which has the same pattern: see `force_transfer`."""
    arguments.check_space(space)
    element, whole = space.element.basix_element, space.ufl_element()
    cell = space.mesh.topology.cell_name()
    if whole != quadratic_element(cell, tuple(whole.reference_value_shape)):
        raise ValueError("the force transfer T exists for quadratic Lagrange spaces only")
    # what the middle of an interval keeps and gives: T = [1, b; 0, a], and so is its inverse
    keeps = (1 / _STAYS, -_GOES / _STAYS) if inverse else (_STAYS, _GOES)
    shares = sp.csr_matrix(_shares(element, *keeps)).tocoo()
    index_map, block = space.dofmap.index_map, space.dofmap.index_map_bs
    cells, owned = space.dofmap.list, index_map.size_local
    goes, comes = cells[:, shares.row].ravel(), cells[:, shares.col].ravel()
    own = comes < owned  # some cell here has each of them, and whatever they give to
    transposed, first = np.unique(np.stack([comes[own], goes[own]]), axis=1, return_index=True)
    value = np.tile(shares.data, len(cells))[own][first]
    column = index_map.local_to_global(transposed[1].astype(np.int32))
    shape = (owned, index_map.size_global)
    rows = sp.kron(sp.csr_matrix((value, (transposed[0], column)), shape), np.eye(block), "csr")
    local = (owned * block, index_map.size_global * block)
    csr = (rows.indptr.astype(PETSc.IntType), rows.indices.astype(PETSc.IntType), rows.data)
    return PETSc.Mat().createAIJ((local, local), bsize=block, csr=csr, comm=space.mesh.comm)


def _shares(element: basix.finite_element.FiniteElement, keeps: float, gives: float) -> Array:
    """T of one cell: of the node of each column, what goes to the node of each row."""
    each = [len(np.ravel(dofs)) for dofs in element.entity_dofs]
    inside = np.repeat(np.arange(len(each)), each)  # dimension of each node's entity
    T = np.zeros((element.dim, element.dim))
    for dimension, of_dimension in enumerate(element.entity_dofs):
        for entity, dofs in enumerate(of_dimension):
            closure = element.entity_closure_dofs[dimension][entity]
            for dof in dofs:  # in the middle of the entity, along each of its directions
                kept = inside[closure]
                T[closure, dof] = keeps**kept * gives ** (dimension - kept)
    return T


@dataclass(frozen=True)
class BoundaryForces:
    """Nodal forces along a boundary line, ordered by position.

    Args:
        position: (m, 3) node coordinates.
        force: (m, components).
    """

    position: Array
    force: Array


@check_same_arguments
def forces_along(space: fem.FunctionSpace, forces: PETSc.Vec, where: Marker) -> BoundaryForces:
    """Nodal forces at the nodes that a marker selects, sorted by their coordinates.

        held = forces_along(U, reactions(K, a, f), lambda x: np.isclose(x[0], 0))
        axes.plot(held.position[:, 1], held.force)

    Every process gets the whole line.

    Args:
        space: trial space.
        forces: vector (n,) of nodal forces.
        where: marker of the nodes' positions as columns (3, n).

    Raises:
        ValueError: if there is no such node, the marker fails or does not return truth values, or
            the vector is not finite or does not belong to the space.
    """
    arguments.check_space(space)
    with collective_errors(space.mesh.comm):
        arguments.check_petsc_vector("the vector of forces", forces, "the space", space)
    if not is_finite(forces):
        raise ValueError("the vector of forces is not finite")
    nodes = locate_any_nodes(space, "the line", where)
    values = forces.array_r.reshape(-1, space.dofmap.index_map_bs)
    return BoundaryForces(*_in_order(space, nodes, values)[:2])


@dataclass(frozen=True)
class SurfaceNodes:
    """Nodes of a part of the boundary, in the order of `order_by_position`, on every process.

    Areas are lengths times thickness in the plane, and of the whole circumference in
    axisymmetry.

    Args:
        position: (m, dim).
        own_area: (m,), integral of each node's test function.
        tributary_area: (m,), integral of the piecewise-linear function of each node.
        edges: (e, 3), mid-side node and both corners of each edge of the surface.
        rim: (m,), nodes at the ends of the line or on the edge of the face.
        node: (m,), global numbers in the space, valid for this number of processes.
        facets: (f, k), the nodes of each facet, in Basix' order (corners first).
    """

    position: Array
    weight_area: Array
    tributary_area: Array
    edges: Indices
    rim: Mask
    node: Indices
    facets: Indices

    @classmethod
    @check_same_arguments
    def from_body(cls, body: Body, where: Part, stretch: Expr | None = None) -> "SurfaceNodes":
        """Nodes of a part of the boundary.

        A `ContactPair` with the same marker has the same nodes if the marker ends at vertices.

        Args:
            body: whose boundary it is.
            where: marker of points as columns (3, n), which has to hold at every vertex of a facet;
                or local numbers of facets, as `MeshTags.find` gives them; or a mask of all.
            stretch: deformed over undeformed area, as `stretch` gives it, for areas of the deformed
                boundary; by default those of the undeformed one.

        Raises:
            ValueError: if there are none, the marker fails or does not return truth values, or a
                number is none of a facet.
        """
        arguments.check_type("body", body, Body, "Body(spaces, material, state) makes one")
        arguments.check_type("stretch", stretch, Expr | None, "SurfaceNodes.stretch(u) makes it")
        depth = body._depth() if stretch is None else body._depth() * stretch
        return cls.from_scalar_spaces(_scalar(body.spaces.displacements), where, depth)

    @classmethod
    @check_same_arguments
    def from_scalar_spaces(cls, spaces: Spaces, where: Part, depth: Scalar = 1.0) -> "SurfaceNodes":
        """Nodes of a part of the boundary of a scalar problem.

        Args:
            spaces: of the scalar.
            where: part of the boundary, as in `of`.
            depth: factor of the lengths or areas of the mesh, such as a thickness or 2 pi r.

        Raises:
            ValueError: as `of`, or if the spaces are not scalar.
        """
        arguments.check_type("spaces", spaces, Spaces, "Spaces.petrov_galerkin(mesh, 0) makes some")
        if spaces.trial.ufl_element().reference_value_shape != ():
            raise ValueError("the spaces have components: it takes those of a scalar")
        depth = arguments.check_positive_coefficient("depth", depth, spaces.mesh.comm)
        position, own, node = _areas(spaces, where, depth)
        other, tributary = position, own
        if spaces.test.ufl_element() != macro_element(spaces.mesh.topology.cell_name()):
            other, tributary, _ = _areas(Spaces.petrov_galerkin(spaces.mesh, 0), where, depth)
        if not tributary.min(initial=np.inf) > 0:
            raise ValueError("the depth or thickness is not positive: a node there has no area")
        facets = _facets(spaces.trial, where, node)
        edges, rim_nodes = _edges(facets, spaces.mesh)
        rim = np.isin(np.arange(len(position)), rim_nodes)
        shares = tributary[cKDTree(other).query(position)[1]]
        return cls(position, own, shares, edges, rim, node, facets)

    @staticmethod
    def stretch(u: fem.Function) -> Expr:
        """Deformed over undeformed area, or length in the plane, of a surface.

        Contact forces over weights on the undeformed and on the deformed surface are the nominal
        and the true pressure:

            spaces = Spaces.petrov_galerkin(mesh, 0)
            nominal = SurfaceNodes.from_scalar_spaces(spaces, top).pressure(pair.force_normal)
            deformed = SurfaceNodes.from_scalar_spaces(spaces, top, SurfaceNodes.stretch(u))
            true = deformed.pressure(pair.force_normal)

        Args:
            u: displacements, or these and a pressure, with the values of when areas are taken.
        """
        arguments.check_type("u", u, fem.Function, "as_function(U, a) makes a function of a vector")
        space = u.function_space
        moved = ufl.split(u)[0] if is_hybrid(space) else u
        if moved.ufl_shape != (space.mesh.geometry.dim,):
            raise ValueError(f"the displacement has the shape {moved.ufl_shape}: give a vector")
        F = ufl.Identity(space.mesh.geometry.dim) + ufl.grad(moved)
        area = ufl.det(F) * ufl.inv(F).T * ufl.FacetNormal(space.mesh)
        return ufl.sqrt(ufl.inner(area, area))

    def pressure(self, force: Array) -> Array:
        """Measure 2 of forces (m,) or (m, components); NaN where a node has no weight.

        Args:
            force: nodal forces (m,) or (m, components).

        Raises:
            ValueError: if they are not one for each node.
        """
        force = self._checked(force)
        weightless = self.weight_area < 1e-9 * self.tributary_area
        area = np.where(weightless, np.nan, self.weight_area)
        return (force.T / area).T

    def tributary_pressure(self, force: Array) -> Array:
        """Measure 3 of forces (m,) or (m, components).

        Args:
            force: nodal forces (m,) or (m, components).

        Raises:
            ValueError: if they are not one for each node.
        """
        force = self._checked(force)
        return (force.T / self.tributary_area).T

    def sawtooth(self, force: Array, closed: Mask | None = None) -> float:
        """Median ratio of mid-side nodes' forces to the mean of both corners'.

        2 in the plane for the standard element under uniform pressure, 1 for even forces; NaN
        without an edge to judge by.

        Args:
            force: (m,), raw normal nodal forces, measure 1.
            closed: (m,), nodes in contact; edges that have an open or a rim node do not count.

        Raises:
            ValueError: if they are not one for each node.
        """
        middle, mean = self._inner(force, closed)
        with np.errstate(divide="ignore"):  # corners of 10-node tetrahedra
            return float(np.median(middle / mean)) if len(middle) else np.nan

    def unevenness(self, values: Array, closed: Mask | None = None) -> float:
        """Median size of mid-side value less the mean of both corners', over the median value.

        A second difference: zero for values (m,) (forces or pressures) that vary linearly.

        Args:
            values: forces or pressures (m,).
            closed: (m,), nodes in contact; edges that have an open or a rim node do not count.

        Raises:
            ValueError: if they are not one for each node.
        """
        middle, mean = self._inner(values, closed)
        if not len(middle):
            return np.nan
        return float(np.median(np.abs(middle - mean)) / np.median(np.abs(middle + mean) / 2))

    def _inner(self, values: Array, closed: Mask | None) -> tuple[Array, Array]:
        """Mid-side values, and means of both corners', of edges that count."""
        values = self._checked(values, scalar=True)
        counts = ~self.rim
        if closed is not None:
            closed = np.asarray(closed)
            if closed.shape != self.rim.shape or closed.dtype != bool:
                raise ValueError(f"closed: it has to be True or False for {len(self.rim)} nodes")
            counts = counts & closed
        edges = self.edges[counts[self.edges].all(axis=1)]
        return values[edges[:, 0]], values[edges[:, 1:]].mean(axis=1)

    def _checked(self, values: Array, scalar: bool = False) -> Array:
        """Raises ValueError if there is not one value, or one vector, for each node."""
        try:
            given, count = np.asarray(values), len(self.position)
        except ValueError:  # rows of different lengths
            given, count = np.empty(0, dtype=object), len(self.position)
        if given.dtype.kind not in "iuf" or given.ndim not in ((1,) if scalar else (1, 2)):
            raise ValueError(
                f"values are {given.dtype} of the shape {given.shape}: they have to be numbers "
                f"({count},)" + ("" if scalar else f" or ({count}, components)")
            )
        if len(given) != count:
            raise ValueError(
                f"{len(given)} values for the {count} nodes of the surface: the "
                "marker of a contact pair has to end at vertices to have the surface's nodes"
            )
        return given


def order_by_position(position: Array, tie_break: Array | None = None) -> npt.NDArray[np.intp]:
    """Order of nodes (m, dim) by their first coordinate, then the next.

    Round-off of mid-side positions depends on the partition; the order does not. Nodes that
    coincide are in the order of a second position `beside`, if it is given.
    """
    size = np.ptp(position, axis=0).max(initial=0.0) if len(position) else 0.0
    keys = position if tie_break is None else np.hstack([position, tie_break])
    return np.lexsort(np.round(keys / (size or 1.0), 9).T[::-1])


def facet_nodes(space: fem.FunctionSpace, facets: LocalIndices) -> LocalIndices:
    """Local numbers (f, k) of the nodes of exterior facets, in the order of Basix' own facets."""
    cells, places = locate_facets_in_cells(space, facets)
    return np.asarray(space.dofmap.list[cells[:, None], places])


def locate_facets_in_cells(
    space: fem.FunctionSpace, facets: LocalIndices
) -> tuple[LocalIndices, LocalIndices]:
    """Cell (f,) of each exterior facet, and places (f, k) of its nodes there."""
    dim = space.mesh.topology.dim
    topology, layout = space.mesh.topology, space.dofmap.dof_layout
    topology.create_connectivity(dim - 1, dim)
    topology.create_connectivity(dim, dim - 1)
    of_facet = topology.connectivity(dim - 1, dim)
    of_cell = topology.connectivity(dim, dim - 1)
    count = len(basix.topology(space.mesh.basix_cell())[dim - 1])
    cells = of_facet.array[of_facet.offsets[facets]]
    local = (of_cell.array.reshape(-1, count)[cells] == facets[:, None]).argmax(axis=1)
    closure = np.array([layout.entity_closure_dofs(dim - 1, k) for k in range(count)])
    return cells, closure[local]


def facets_with_all_nodes(space: fem.FunctionSpace, nodes: Indices) -> LocalIndices:
    """Local numbers of exterior facets of owned cells with all nodes among global ones (m,)."""
    index_map, topology = space.dofmap.index_map, space.mesh.topology
    local = index_map.global_to_local(nodes)
    among = np.zeros(index_map.size_local + index_map.num_ghosts, dtype=bool)
    among[local[local >= 0]] = True
    topology.create_connectivity(topology.dim - 1, topology.dim)
    facets = exterior_facet_indices(topology)
    return np.asarray(facets[among[facet_nodes(space, facets)].all(axis=1)])


def _areas(spaces: Spaces, where: Part, depth: Scalar) -> tuple[Array, Array, Indices]:
    """Positions (m, dim), integrals (m,) of test functions, and numbers of a surface's nodes."""
    space, mesh = spaces.trial, spaces.mesh
    weights = depth * ufl.TestFunction(spaces.test) * boundary_measure(mesh, where)
    area = assemble_vector(weights).array_r
    facets = locate_exterior_facets(mesh, where)
    nodes = fem.locate_dofs_topological(space, mesh.topology.dim - 1, facets)
    position, areas, node = _in_order(space, nodes, area)
    return position[:, : mesh.geometry.dim], areas, node


def _in_order(
    space: fem.FunctionSpace, nodes: LocalIndices, values: Array
) -> tuple[Array, Array, Indices]:
    """Positions (m, 3) of all processes' nodes, owners' values there, and global numbers."""
    index_map = space.dofmap.index_map
    nodes = nodes[nodes < index_map.size_local]
    numbers = nodes + np.int64(index_map.local_range[0])
    own = space.tabulate_dof_coordinates()[nodes], values[nodes], numbers
    position, *rest = (np.concatenate(space.mesh.comm.allgather(part)) for part in own)
    order = order_by_position(position)
    return position[order], rest[0][order], rest[1][order]


def _facets(space: fem.FunctionSpace, where: Part, node: Indices) -> Indices:
    """Facets (f, k) of all processes as places of their nodes among `node` (m,)."""
    facets = facet_nodes(space, locate_exterior_facets(space.mesh, where))
    numbers = space.dofmap.index_map.local_to_global(facets.ravel()).reshape(facets.shape)
    order = np.argsort(node)
    every = np.concatenate(space.mesh.comm.allgather(numbers))
    return np.unique(order[np.searchsorted(node, every, sorter=order)], axis=0)


def _edges(facets: Indices, mesh: Mesh) -> tuple[Indices, Indices]:
    """Edges (e, 3), mid-side node first, and nodes of the rim: ends that no two facets share."""
    dim = mesh.topology.dim
    sub = basix.topology(basix.cell.subentity_types(mesh.basix_cell())[dim - 1][0])
    corners = len(sub[0])
    edges = np.concatenate([facets[:, [corners + e, *ends]] for e, ends in enumerate(sub[1])])
    edges[:, 1:].sort(axis=1)
    ends = edges if dim == 3 else facets[:, :corners].reshape(-1, 1)
    rim, count = np.unique(ends, axis=0, return_counts=True)
    return np.unique(edges, axis=0), np.unique(rim[count == 1])


@dataclass(frozen=True)
class NodalFlux:
    """Fluxes at the nodes of a part of the boundary, the same on every process.

    Args:
        surface: the nodes, their positions, areas, edges and rim.
        reaction: (m,) or (m, components), the flow into the body at each node.
        flux: (m,) or (m, components), the same per area; NaN where a node has no area.
    """

    surface: SurfaceNodes
    reaction: Array
    flux: Array


@check_same_arguments
def nodal_flux(
    spaces: Spaces, reactions: PETSc.Vec, where: Part, area: Area = "geometric", depth: Scalar = 1.0
) -> NodalFlux:
    """Flux into a body at the nodes of a boundary where its field is prescribed.

        K, f = assemble_matrix(k * inner(grad(u), grad(v)) * dx), assemble_vector(q * v * dx)
        a = solve(K, f, Reduction.dirichlet(spaces.trial, conditions))
        heat = nodal_flux(spaces, reactions(K, a, f), lambda x: np.isclose(x[0], 0.0))
        heat.surface.position, heat.flux

    Over geometric areas a standard quadratic element's reactions zigzag, unless they are evened out
    before: `force_transfer(space) * reactions`.

    Where the part ends at another one with prescribed values, the reactions at the nodes on its rim
    belong to both: leave them out (`surface.rim`), or treat both parts as one.

    Args:
        spaces: of the field, scalar or with components.
        reactions: vector (n,), of `reactions` or `PetrovGalerkinProblem.reactions`.
        where: part of the boundary, as in `boundary_measure`.
        area: by which reactions are divided: "geometric", the node's share of the surface, or
            "weight", the integral of its test function: the same for piecewise-linear weights.
        depth: factor of the lengths or areas of the mesh, such as a thickness or 2 pi r.

    Raises:
        TypeError: for arguments of the wrong type.
        ValueError: for a vector that is not finite or of another space, an unknown area, a depth
            that is not positive, or a part of the boundary without facets.
    """
    arguments.check_type("spaces", spaces, Spaces, "Spaces.petrov_galerkin(mesh, 0) makes some")
    space = spaces.trial
    with collective_errors(space.mesh.comm):
        arguments.check_petsc_vector("the vector of reactions", reactions, "the space", space)
    if not arguments.is_one_of(area, get_args(Area)):
        raise ValueError(f"area {area!r}: it is 'geometric' or 'weight'")
    if not is_finite(reactions):
        raise ValueError("the vector of reactions is not finite")
    surface = SurfaceNodes.from_scalar_spaces(_scalar(spaces), where, depth)
    values = reactions.array_r.reshape(-1, space.dofmap.index_map_bs)
    reaction = gather_from_owners(space, surface.node, values)
    if not space.num_sub_spaces:
        reaction = reaction[:, 0]
    read = surface.pressure if area == "weight" else surface.tributary_pressure
    return NodalFlux(surface, reaction, read(reaction))


def _scalar(spaces: Spaces) -> Spaces:
    """The spaces of a component; nodes are numbered alike."""
    if not spaces.trial.num_sub_spaces:
        return spaces
    trial = scalar_space(spaces.trial)
    return Spaces(trial, trial if spaces.test is spaces.trial else scalar_space(spaces.test))
