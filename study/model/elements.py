"""Elements that the study compares with the library's own: what others use in their place."""

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

# Nodes 1..6 of the paper's triangle (vertices, then mid-sides 1-2, 2-3, 3-1) as Basix dofs
PAPER_NODES = [0, 1, 2, 5, 3, 4]


def composite(mesh: Mesh, components: int = 2) -> Spaces:
    """Composite triangles for both, with vectors or scalars (0 components): CPS6M, roughly."""
    trial = fem.functionspace(mesh, composite_element((components,) if components else ()))
    return Spaces(trial, trial)


def serendipity(mesh: Mesh, components: int = 2) -> Spaces:
    """Nodal 8-node quadrilaterals for both, with vectors or scalars (0 components): CPS8."""
    trial = fem.functionspace(mesh, serendipity_element((components,) if components else ()))
    return Spaces(trial, trial)


def one_cut(mesh: Mesh, shape: tuple[int, ...] = (3,)) -> Spaces:
    """The paper's element on tetrahedra cut along one diagonal: see `one_cut_element`."""
    trial = fem.functionspace(mesh, quadratic_element("tetrahedron", shape))
    return Spaces(trial, fem.functionspace(mesh, one_cut_element(shape)))


def taylor_hood(mesh: Mesh, parts: MeshTags | None = None) -> Spaces:
    """The standard hybrid element, quadratic displacements and linear pressure for both."""
    trial = Spaces.hybrid(mesh, parts).trial
    return Spaces(trial, trial, parts)


def one_cut_element(shape: tuple[int, ...] = ()) -> basix.ufl._ElementBase:
    """Piecewise-linear weights on tetrahedra cut into eight, P1-iso-P2.

    The order of a cell's vertices determines along which of three diagonals the octahedron inside
    is cut, and nodal forces change by some per cent with it. DOLFINx's own integrals of its slopes
    are wrong with degree 4, 5 and 7, whose points lie on sides of sub-cells.
    """
    return _blocked(
        basix.ufl._BasixElement(piecewise_linear_sub_cell_element("tetrahedron")._element),
        shape,
    )


def composite_element(shape: tuple[int, ...] = ()) -> basix.ufl._ElementBase:
    """Composite triangle: four linear triangles with one linear gradient over all of them.

    Values are those of `piecewise_linear_sub_cell_element("triangle")`. Wherever a form takes a
    gradient, it gets the L2 projection of the piecewise constant one onto linear functions of the
    macro
    triangle: with a constant D, the linear assumed strain of Y. Guo, M. Ortiz, T. Belytschko, E. A.
    Repetto, "Triangular composite finite elements", Int. J. Numer. Methods Eng. 47 (2000), for
    small strains. Projecting on the reference triangle is right for straight sides.
    """
    return _blocked(
        _AssumedGradientElement(piecewise_linear_sub_cell_element("triangle")._element),
        shape,
    )


def serendipity_element(shape: tuple[int, ...] = ()) -> basix.ufl._ElementBase:
    """Shape functions of the nodal 8-node quadrilateral (CPS8, CAX8): no centre node.

    Basix's own serendipity element has integral moments for degrees of freedom; nodal forces need
    point evaluations. The space is that of all quadratics, x²y and xy².
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
    return _blocked(element, shape)


class _AssumedGradientElement(basix.ufl._BasixElement):
    """Macro triangle that tabulates projected gradients; FFCx tabulates through it."""

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
        """Values and projected first derivatives at points (n, 2): (derivatives, n, nodes)."""
        if nderivs > 1:
            raise NotImplementedError("the composite triangle has first derivatives only")
        values = super().tabulate(0, points)
        if nderivs == 0:
            return values
        linear = tabulate_polynomial_set(
            CellType.triangle, PolysetType.standard, 1, 0, np.ascontiguousarray(points)
        )[0]
        return np.concatenate([values, np.einsum("dkn,kp->dpn", self._moments, linear)])


def _blocked(element: basix.ufl._ElementBase, shape: tuple[int, ...]) -> basix.ufl._ElementBase:
    return basix.ufl.blocked_element(element, shape=shape) if shape else element
