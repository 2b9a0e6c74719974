"""Elasticity matrices and loads of one body, element by element; unknown = dim * node + component.

Trial functions and geometry are quadratic; weights are quadratic too (Galerkin), or piecewise
linear. All integrals follow from Hooke's law written in components,

    sigma(u):eps(w) = lambda div u div w + mu (grad u : grad w + grad u : grad w^T),

with the hoop strain u_r / r as a further term of div and of eps : eps in axisymmetry.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy import sparse

from tests.oracle.elements import ELEMENTS, tabulate_at_gauss_points

NodeMarker = Callable[[np.ndarray], np.ndarray]


class GaussPointData(NamedTuple):
    """What is known at one Gauss point of all c cells; the volume includes the third direction."""

    shapes: np.ndarray  # (n,)
    gradients: np.ndarray  # (c, n, d)
    weights: np.ndarray  # (n,)
    weight_gradients: np.ndarray  # (c, n, d)
    radius: np.ndarray  # (c,), the first coordinate
    volume: np.ndarray  # (c,)


@dataclass(frozen=True)
class Body:
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
        lame, mu = self._lame_constants()
        one = np.eye(self.nodes.shape[1])
        total = 0.0
        for at in self._gauss_points():
            G, H = at.gradients, at.weight_gradients
            div_u, div_w = G.copy(), H.copy()
            if self.state == "axisymmetric":
                div_u[:, :, 0] += at.shapes / at.radius[:, None]
                div_w[:, :, 0] += at.weights / at.radius[:, None]
            entry = lame * np.einsum("cik,cjl->cikjl", div_w, div_u)
            entry += mu * np.einsum("cia,cja,kl->cikjl", H, G, one)
            entry += mu * np.einsum("cil,cjk->cikjl", H, G)
            if self.state == "axisymmetric":
                hoop = np.einsum("i,j,c->cij", at.weights, at.shapes, at.radius**-2.0)
                entry[:, :, 0, :, 0] += 2 * mu * hoop
            total = total + entry * at.volume[:, None, None, None, None]
        return self._assemble_matrix(total)

    def mass(self) -> sparse.csc_matrix:
        scalar = sum(
            np.einsum("i,j,c->cij", at.weights, at.shapes, self.rho * at.volume)
            for at in self._gauss_points()
        )
        return self._assemble_for_each_component(scalar)

    def geometric_stiffness(self, displacement: np.ndarray) -> sparse.csc_matrix:
        """Form G, int grad w : grad u S, of a plane body with the stress S of a displacement."""
        u = displacement.reshape(self.nodes.shape)[self.cells]
        lame, mu = self._lame_constants()
        scalar = 0.0
        for at in self._gauss_points():
            slope = np.einsum("cik,cid->ckd", u, at.gradients)
            S = mu * (slope + slope.transpose(0, 2, 1))
            S += lame * np.trace(slope, axis1=1, axis2=2)[:, None, None] * np.eye(2)
            entry = np.einsum("cia,cab,cjb->cij", at.weight_gradients, S, at.gradients)
            scalar = scalar + entry * at.volume[:, None, None]
        return self._assemble_for_each_component(scalar)

    def body_load(self, force: tuple[float, ...]) -> np.ndarray:
        per_node = sum(np.outer(at.volume, at.weights) for at in self._gauss_points())
        return self._assemble_vector(per_node, force)

    def traction_load(self, where: NodeMarker, traction: tuple[float, ...]) -> np.ndarray:
        """Load vector of a traction on the facets all of whose nodes `where` (n, dim) holds on."""
        surface = self._boundary_body(where)
        per_node = sum(np.outer(at.volume, at.weights) for at in surface._gauss_points())
        return surface._assemble_vector(per_node, traction)

    def component_mask(self, where: NodeMarker, components: tuple[int, ...]) -> np.ndarray:
        """Mask (n, dim) of displacement components of the nodes that `where` holds on."""
        mask = np.zeros(self.nodes.shape, dtype=bool)
        mask[:, components] = where(self.nodes)[:, None]
        return mask

    def _boundary_body(self, where: NodeMarker) -> "Body":
        element = ELEMENTS[self.element]
        facets = np.concatenate([self.cells[:, facet] for facet in element.facets])
        facets = facets[where(self.nodes)[facets].all(axis=1)]
        return replace(self, cells=facets, element=element.facet, n_gauss=4)

    def _lame_constants(self) -> tuple[float, float]:
        """Lame's constants; in plane stress the first one that belongs to it."""
        E, nu = self.E, self.nu
        if self.state == "plane stress":
            return E * nu / (1 - nu**2), E / (2 * (1 + nu))
        return E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))

    def _gauss_points(self) -> Iterator[GaussPointData]:
        """Gauss points of the cells, one after the other; no gradients on surfaces."""
        functions, x = (
            tabulate_at_gauss_points(self.element, self.linear_weights, self.n_gauss),
            self.nodes[self.cells],
        )
        for N, dN, W, dW, measure in zip(*functions, strict=True):
            J = np.einsum("cna,nb->cab", x, dN)
            on_surface = J.shape[1] > J.shape[2]
            size = np.sqrt(np.linalg.det(np.einsum("cab,cad->cbd", J, J)))
            G = H = np.empty(0)
            if not on_surface:
                inverse = np.linalg.inv(J)
                G, H = (np.einsum("nb,cba->cna", d, inverse) for d in (dN, dW))
            radius = np.einsum("cn,n->c", x[:, :, 0], N)
            depth = {"axisymmetric": 2 * np.pi * radius, "solid": 1.0}
            yield GaussPointData(
                N, G, W, H, radius, measure * size * depth.get(self.state, self.thickness)
            )

    def _assemble_for_each_component(self, scalar: np.ndarray) -> sparse.csc_matrix:
        return self._assemble_matrix(
            np.einsum("cij,kl->cikjl", scalar, np.eye(self.nodes.shape[1]))
        )

    def _assemble_matrix(self, entries: np.ndarray) -> sparse.csc_matrix:
        """Sum of cell matrices (c, n, dim, n, dim)."""
        dim = self.nodes.shape[1]
        dofs = (self.cells[:, :, None] * dim + np.arange(dim)).reshape(len(self.cells), -1)
        rows, columns = np.broadcast_arrays(dofs[:, :, None], dofs[:, None, :])
        shape = (self.nodes.size, self.nodes.size)
        place = (rows.ravel(), columns.ravel())
        return sparse.coo_matrix((entries.ravel(), place), shape).tocsc()

    def _assemble_vector(self, per_node: np.ndarray, direction: tuple[float, ...]) -> np.ndarray:
        """Sum of cell vectors (c, n) times a constant vector."""
        total = np.zeros(len(self.nodes))
        np.add.at(total, self.cells, per_node)
        return np.outer(total, direction).ravel()
