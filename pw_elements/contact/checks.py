"""Checks of mesh and solver before anything is solved."""

from collections.abc import Sequence

import basix
import numpy as np
import numpy.typing as npt
from dolfinx.mesh import Mesh

from pw_elements._compat import cell_nodes
from pw_elements.algebra import Reduction
from pw_elements.contact.errors import DegenerateMesh, listed
from pw_elements.contact.pairs import ContactPair, MatchingNodes
from pw_elements.iterative import Iterative, Solver, chosen
from pw_elements.linear_solver import LinearSolver

# Smallest Jacobian determinant over the product of a cell's edge lengths
_FLAT = 1e-10


def check_mesh(mesh: Mesh) -> None:
    """Looks for cells that have no volume, are inside out, or fold over a neighbour.

    Raises:
        DegenerateMesh: with the midpoints of such cells.
    """
    x, determinant = _determinants(mesh)
    dim = x.shape[2]
    size = np.ptp(x, axis=1).max(axis=1, initial=0.0) ** dim
    flat = np.abs(determinant).min(axis=1) <= _FLAT * size
    turned = ~flat & (determinant.min(axis=1) < 0) & (determinant.max(axis=1) > 0)
    _refuse(mesh, x, flat, "have no volume")
    _refuse(mesh, x, turned, "are turned inside out in a part of them")
    _refuse(mesh, x, _folded(mesh), "lie on the same side of a facet as their neighbour")


def solver_for(
    solver: Solver, reduction: Reduction, pairs: Sequence[ContactPair]
) -> tuple[LinearSolver, Reduction]:
    """The solver that is meant, and the reduction in the form in which it takes it.

    Raises:
        ValueError: if an iterative solver does not serve the reduction or the pairs.
    """
    matching = any(isinstance(pair.surface, MatchingNodes) for pair in pairs)
    why = "nodes of two bodies that face each other need factors" if matching else ""
    taken = chosen(solver, reduction.supports, why)
    if not isinstance(taken, Iterative):
        return taken, reduction
    if matching:
        raise ValueError(f"Iterative() knows rigid surfaces alone, {why}: take Direct()")
    return taken, reduction.masked()


def _determinants(mesh: Mesh) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Nodes (cells, nodes, dim) and Jacobian determinants (cells, points), ghosts included."""
    element = mesh.ufl_domain().ufl_coordinate_element().basix_element
    corners = basix.geometry(element.cell_type)
    points = np.vstack([corners, basix.make_quadrature(element.cell_type, 4)[0]])
    derivatives = element.tabulate(1, points)[1:, :, :, 0]
    dim = mesh.geometry.dim
    x = mesh.geometry.x[cell_nodes(mesh)][:, :, :dim]
    jacobian = np.einsum("jpn,cni->cpij", derivatives, x)
    if dim != jacobian.shape[-1]:
        raise DegenerateMesh("the mesh is a surface or line in space, not a body")
    return x, np.linalg.det(jacobian)


def _folded(mesh: Mesh) -> npt.NDArray[np.bool_]:
    """Cells (ghosts included) on the same side of a straight facet as the cell behind it."""
    topology, dim = mesh.topology, mesh.topology.dim
    for pair in ((dim - 1, dim), (dim, dim - 1), (dim - 1, 0), (dim, 0)):
        topology.create_connectivity(*pair)
    x = mesh.geometry.x[:, :dim]
    cells = cell_nodes(mesh)
    element = mesh.ufl_domain().ufl_coordinate_element().basix_element
    corner = [dofs[0] for dofs in element.entity_dofs[0]]
    middle = x[cells[:, corner]].mean(axis=1)
    facets = topology.connectivity(dim - 1, dim)
    offsets = facets.offsets
    inner = np.flatnonzero(np.diff(offsets) == 2)
    folded = np.zeros(len(cells), dtype=bool)
    if len(inner) == 0:
        return folded
    two = facets.array[offsets[inner][:, None] + np.arange(2)]
    of_cell = topology.connectivity(dim, dim - 1)
    on_facet = basix.topology(element.cell_type)[dim - 1]
    numbers = of_cell.array.reshape(-1, len(on_facet))  # also where a process has no cells
    local = np.argmax(numbers[two[:, 0]] == inner[:, None], axis=1)
    vertices = np.array([list(f)[:dim] for f in on_facet])[local]  # dim of them span it
    points = x[np.take_along_axis(cells[two[:, 0]][:, corner], vertices, axis=1)]
    span = points[:, 1:] - points[:, :1]
    sides = [
        np.linalg.det(np.concatenate([span, (middle[two[:, k]] - points[:, 0])[:, None]], axis=1))
        for k in range(2)
    ]
    wrong = sides[0] * sides[1] > 0
    folded[two[wrong].ravel()] = True
    return folded


def _refuse(
    mesh: Mesh, x: npt.NDArray[np.float64], wrong: npt.NDArray[np.bool_], what: str
) -> None:
    owned = mesh.topology.index_map(mesh.topology.dim).size_local
    middles = x[:owned][wrong[:owned]].mean(axis=1)
    places = np.concatenate(mesh.comm.allgather(middles))
    if len(places):
        raise DegenerateMesh(f"cells around {listed(places)} {what}")
