"""Elements of other codes and papers, with which the study compares those of the library."""

import basix
import basix.ufl
import numpy as np
import numpy.typing as npt
from basix import (
    CellType,
    ElementFamily,
    LagrangeVariant,
    MapType,
    PolysetType,
    SobolevSpace,
)
from basix.polynomials import tabulate_polynomial_set
from dolfinx import fem
from dolfinx.mesh import Mesh, MeshTags

from pw_elements import Spaces
from pw_elements.spaces import piecewise_linear_sub_cell_element, quadratic_element

# Basix dofs of the nodes 1 to 6 of the paper's triangle, which are the vertices, then the mid-side
# nodes of sides 1-2, 2-3 and 3-1
BASIX_DOF_OF_PAPER_NODE = [0, 1, 2, 5, 3, 4]


def composite_spaces(mesh: Mesh, n_components: int = 2) -> Spaces:
    """Return trial and test spaces of composite triangles, which are similar to CPS6M.

    Fields are vectors with `n_components`, or scalars if `n_components` is 0.
    """
    trial = fem.functionspace(mesh, composite_element((n_components,) if n_components else ()))
    return Spaces(trial, trial)


def serendipity_spaces(mesh: Mesh, n_components: int = 2) -> Spaces:
    """Return trial and test spaces of nodal 8-node quadrilaterals, like CPS8.

    Fields are vectors with `n_components`, or scalars if `n_components` is 0.
    """
    trial = fem.functionspace(mesh, serendipity_element((n_components,) if n_components else ()))
    return Spaces(trial, trial)


def p1_iso_p2_weight_spaces(mesh: Mesh, shape: tuple[int, ...] = (3,)) -> Spaces:
    """Return quadratic trial and P1-iso-P2 test spaces, i.e. the paper's element on tetrahedra.

    The sub-cells are described in `p1_iso_p2_tetrahedron`.
    """
    trial = fem.functionspace(mesh, quadratic_element("tetrahedron", shape))
    return Spaces(trial, fem.functionspace(mesh, p1_iso_p2_tetrahedron(shape)))


def taylor_hood_spaces(mesh: Mesh, cell_tags: MeshTags | None = None) -> Spaces:
    """Return spaces of the standard hybrid element (quadratic displacements, linear pressures)."""
    trial = Spaces.hybrid(mesh, cell_tags).trial
    return Spaces(trial, trial, cell_tags)


def p1_iso_p2_tetrahedron(shape: tuple[int, ...] = ()) -> basix.ufl._ElementBase:
    """Return the P1-iso-P2 element: piecewise-linear functions on eight parts of a tetrahedron.

    The order of a cell's vertices determines which of three diagonals divides the inner octahedron;
    this changes nodal forces by a few per cent. With quadrature degrees 4, 5 and 7, whose points
    lie on faces of sub-cells, DOLFINx does not integrate the gradients correctly.
    """
    return _blocked_element(
        basix.ufl._BasixElement(piecewise_linear_sub_cell_element("tetrahedron")._element),
        shape,
    )


def composite_element(shape: tuple[int, ...] = ()) -> basix.ufl._ElementBase:
    """Return the composite triangle: four linear triangles with a linear assumed gradient.

    Its values equal those of `piecewise_linear_sub_cell_element("triangle")`. Gradients in a form
    are L2 projections of the piecewise constant gradients onto linear functions on the macro
    triangle. If the elasticity matrix is constant, this is the linear assumed strain of Y. Guo,
    M. Ortiz, T. Belytschko, E. A. Repetto, "Triangular composite finite elements", Int. J. Numer.
    Methods Eng. 47 (2000), for small strains. The projection on the reference triangle is exact
    for straight sides.
    """
    return _blocked_element(
        _AssumedGradientElement(piecewise_linear_sub_cell_element("triangle")._element),
        shape,
    )


def serendipity_element(shape: tuple[int, ...] = ()) -> basix.ufl._ElementBase:
    """Return the nodal 8-node quadrilateral (CPS8, CAX8), without a centre node.

    Nodal forces require point evaluations as degrees of freedom, whereas those of Basix's
    serendipity element are integral moments. The space contains all quadratics, x²y and xy².
    """
    cell = CellType.quadrilateral
    points, weights = basix.make_quadrature(cell, 5)
    orthonormal = tabulate_polynomial_set(cell, PolysetType.standard, 2, 0, points)[0]
    px, py = points.T
    monomials = np.array([px**0, px, py, px**2, px * py, py**2, px**2 * py, px * py**2])
    coefficients = np.linalg.qr(((monomials * weights) @ orthonormal.T).T)[0].T
    space = np.ascontiguousarray(coefficients)
    lagrange = basix.create_element(ElementFamily.P, cell, 2, LagrangeVariant.gll_warped)
    x, M = lagrange.x, lagrange.M
    x[2], M[2] = [np.zeros((0, 2))], [np.zeros((0, 1, 0, 1))]
    identity, smooth = MapType.identity, SobolevSpace.H1
    element = basix.ufl.custom_element(cell, [], space, x, M, 0, identity, smooth, False, 2, 2)
    return _blocked_element(element, shape)


class _AssumedGradientElement(basix.ufl._BasixElement):
    """Macro triangle whose `tabulate`, which FFCx calls, returns projected gradients."""

    def __init__(self, element: basix.finite_element.FiniteElement) -> None:
        super().__init__(element)
        triangle, macro = CellType.triangle, PolysetType.macroedge
        # an orthonormal basis of linear functions makes the projection a sum of integrals
        points, weights = basix.make_quadrature(triangle, 2, polyset_type=macro)
        slopes = element.tabulate(1, points)[1:, :, :, 0]
        linear = tabulate_polynomial_set(triangle, PolysetType.standard, 1, 0, points)[0]
        self._moments = np.einsum("dpn,kp,p->dkn", slopes, linear, weights)

    def __repr__(self) -> str:
        return f"{super().__repr__()}, assumed gradient"

    def tabulate(self, nderivs: int, points: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return values and projected gradients (derivatives, n, nodes) at points (n, 2)."""
        if nderivs > 1:
            raise NotImplementedError("the composite triangle has first derivatives only")
        values = super().tabulate(0, points)
        if nderivs == 0:
            return values
        linear = tabulate_polynomial_set(
            CellType.triangle, PolysetType.standard, 1, 0, np.ascontiguousarray(points)
        )[0]
        return np.concatenate([values, np.einsum("dkn,kp->dpn", self._moments, linear)])


def _blocked_element(
    element: basix.ufl._ElementBase, shape: tuple[int, ...]
) -> basix.ufl._ElementBase:
    return basix.ufl.blocked_element(element, shape=shape) if shape else element
