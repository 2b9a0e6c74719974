"""Elasticity matrices and loads of one body, assembled element by element.

The degrees of freedom are dim * node + component. Trial functions and geometry are quadratic.
Weights are quadratic (Galerkin) or piecewise linear. All integrals are those of Hooke's law written
in components,

    sigma(u):eps(w) = lambda div u div w + mu (grad u : grad w + grad u : grad w^T),

with u the displacement, w the weight, and lambda and mu Lame's constants. In axisymmetry the hoop
strain u_r / r adds a term to div and to the strain products.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy import sparse

from tests.oracle.elements import REFERENCE_ELEMENTS, tabulate_at_gauss_points

NodeMarker = Callable[[np.ndarray], np.ndarray]


class GaussPointData(NamedTuple):
    """Functions and geometry at one Gauss point of each of c cells with n nodes in d dimensions."""

    shapes: np.ndarray  # (n,)
    gradients: np.ndarray  # (c, n, d)
    weights: np.ndarray  # (n,)
    weight_gradients: np.ndarray  # (c, n, d)
    radius: np.ndarray  # (c,), the first coordinate of the point
    volume: np.ndarray  # (c,), Gauss weight times Jacobian times depth in the third direction


@dataclass(frozen=True)
class LinearElasticBody:
    """An elastic body: mesh, element, weights, material, and plane or axisymmetric state."""

    nodes: np.ndarray
    cells: np.ndarray
    element: str
    linear_weights: bool
    state: str
    E: float
    nu: float
    rho: float = 1.0
    thickness: float = 1.0
    n_gauss: int = 3

    def stiffness(self) -> sparse.csc_matrix:
        lame_lambda, mu = self._lame_constants()
        n_nodes, dim = self.cells.shape[1], self.nodes.shape[1]
        cell_matrices = np.zeros((len(self.cells), n_nodes, dim, n_nodes, dim))
        for point in self._iterate_gauss_points():
            G, H = point.gradients, point.weight_gradients * point.volume[:, None, None]
            products = np.einsum("cik,cjl->cikjl", H, G)
            div_products, same_component = products, mu * H @ G.transpose(0, 2, 1)
            if self.state == "axisymmetric":
                div_u, div_w = G.copy(), H.copy()
                div_u[:, :, 0] += point.shapes / point.radius[:, None]
                div_w[:, :, 0] += point.weights * (point.volume / point.radius)[:, None]
                div_products = np.einsum("cik,cjl->cikjl", div_w, div_u)
                hoop = point.volume * point.radius**-2.0
                cell_matrices[:, :, 0, :, 0] += (
                    2 * mu * hoop[:, None, None] * np.outer(point.weights, point.shapes)
                )
            cell_matrices += lame_lambda * div_products
            cell_matrices += mu * products.swapaxes(2, 4)
            for component in range(dim):
                cell_matrices[:, :, component, :, component] += same_component
        return self._assemble_matrix(cell_matrices)

    def mass(self) -> sparse.csc_matrix:
        scalar_matrices = sum(
            np.outer(point.weights, point.shapes) * (self.rho * point.volume)[:, None, None]
            for point in self._iterate_gauss_points()
        )
        return self._assemble_for_each_component(scalar_matrices)

    def geometric_stiffness(self, displacement: np.ndarray) -> sparse.csc_matrix:
        """Assemble the geometric stiffness int grad w : grad u S (the form G of the theory page).

        S is the in-plane stress (2, 2) that belongs to the displacement.
        """
        u = displacement.reshape(self.nodes.shape)[self.cells]
        lame_lambda, mu = self._lame_constants()
        scalar_matrices = 0.0
        for point in self._iterate_gauss_points():
            displacement_gradient = np.einsum("cik,cid->ckd", u, point.gradients)
            S = mu * (displacement_gradient + displacement_gradient.transpose(0, 2, 1))
            S += (
                lame_lambda
                * np.trace(displacement_gradient, axis1=1, axis2=2)[:, None, None]
                * np.eye(2)
            )
            entry = np.einsum("cia,cab,cjb->cij", point.weight_gradients, S, point.gradients)
            scalar_matrices = scalar_matrices + entry * point.volume[:, None, None]
        return self._assemble_for_each_component(scalar_matrices)

    def body_load(self, force_per_volume: tuple[float, ...]) -> np.ndarray:
        """Assemble the load vector of a constant force per volume."""
        per_node = sum(
            np.outer(point.volume, point.weights) for point in self._iterate_gauss_points()
        )
        return self._assemble_vector(per_node, force_per_volume)

    def traction_load(self, where: NodeMarker, traction: tuple[float, ...]) -> np.ndarray:
        """Assemble the load vector of a traction on the facets whose nodes all satisfy `where`."""
        boundary = self._boundary_facets_as_body(where)
        per_node = sum(
            np.outer(point.volume, point.weights) for point in boundary._iterate_gauss_points()
        )
        return boundary._assemble_vector(per_node, traction)

    def component_mask(self, where: NodeMarker, components: tuple[int, ...]) -> np.ndarray:
        """Return a mask (n, dim) of the given components at the nodes that satisfy `where`."""
        mask = np.zeros(self.nodes.shape, dtype=bool)
        mask[:, components] = where(self.nodes)[:, None]
        return mask

    def _boundary_facets_as_body(self, where: NodeMarker) -> "LinearElasticBody":
        """Return a body whose cells are the facets whose nodes all satisfy `where`."""
        element = REFERENCE_ELEMENTS[self.element]
        facets = np.concatenate([self.cells[:, facet] for facet in element.facets])
        facets = facets[where(self.nodes)[facets].all(axis=1)]
        return replace(self, cells=facets, element=element.facet, n_gauss=4)

    def _lame_constants(self) -> tuple[float, float]:
        """Return Lame's constants lambda and mu; in plane stress lambda is E nu / (1 - nu^2)."""
        E, nu = self.E, self.nu
        if self.state == "plane stress":
            return E * nu / (1 - nu**2), E / (2 * (1 + nu))
        return E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))

    def _iterate_gauss_points(self) -> Iterator[GaussPointData]:
        """Yield the data of all cells for each Gauss point; for facets they have no gradients."""
        functions, x = (
            tabulate_at_gauss_points(self.element, self.linear_weights, self.n_gauss),
            self.nodes[self.cells],
        )
        for N, dN, W, dW, measure in zip(*functions, strict=True):
            J = np.einsum("cna,nb->cab", x, dN)
            on_surface = J.shape[1] > J.shape[2]
            jacobian_measure = np.sqrt(np.linalg.det(np.einsum("cab,cad->cbd", J, J)))
            G = H = np.empty(0)
            if not on_surface:
                inverse = np.linalg.inv(J)
                G, H = (np.einsum("nb,cba->cna", d, inverse) for d in (dN, dW))
            radius = np.einsum("cn,n->c", x[:, :, 0], N)
            depth_by_state = {"axisymmetric": 2 * np.pi * radius, "solid": 1.0}
            yield GaussPointData(
                N,
                G,
                W,
                H,
                radius,
                measure * jacobian_measure * depth_by_state.get(self.state, self.thickness),
            )

    def _assemble_for_each_component(self, scalar_cell_matrices: np.ndarray) -> sparse.csc_matrix:
        """Assemble a matrix from scalar cell matrices (c, n, n), repeated for each component."""
        return self._assemble_matrix(
            np.einsum("cij,kl->cikjl", scalar_cell_matrices, np.eye(self.nodes.shape[1]))
        )

    def _assemble_matrix(self, cell_matrices: np.ndarray) -> sparse.csc_matrix:
        """Assemble a matrix from cell matrices (c, n, dim, n, dim) of c cells with n nodes."""
        dim = self.nodes.shape[1]
        dofs = (self.cells[:, :, None] * dim + np.arange(dim)).reshape(len(self.cells), -1)
        rows, columns = np.broadcast_arrays(dofs[:, :, None], dofs[:, None, :])
        shape = (self.nodes.size, self.nodes.size)
        positions = (rows.ravel(), columns.ravel())
        return sparse.coo_matrix((cell_matrices.ravel(), positions), shape).tocsc()

    def _assemble_vector(
        self, scalar_cell_vectors: np.ndarray, constant_vector: tuple[float, ...]
    ) -> np.ndarray:
        """Assemble a global vector from cell vectors (c, n) times a constant vector (dim,)."""
        total = np.zeros(len(self.nodes))
        np.add.at(total, self.cells, scalar_cell_vectors)
        return np.outer(total, constant_vector).ravel()
