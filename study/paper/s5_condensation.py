"""5: the 8-node quadrilateral, two triangles without their inner node (Fig. 3)."""

from dataclasses import dataclass

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx.mesh import Mesh

from pw_elements import (
    Material,
    Reduction,
    assemble_matrix,
    assemble_vector,
    force_transfer,
    prescribe,
    reactions,
    solve,
)
from pw_elements.elasticity import StressState
from pw_elements.meshes import DiagonalPattern, move_nodes, quadrilaterals, triangles
from study.meshes.distortion import smooth_distortion
from study.meshes.inner_nodes import mid_diagonal_nodes
from study.model.discretisation import Discretisation, discretise
from study.model.matrices import dense, relative_difference
from study.model.units import dimensionless
from study.run.cases import Case
from study.run.store import Result

SECTION = "5"
TITLE = "The 8-node quadrilateral"

Array = npt.NDArray[np.float64]

MATERIAL = Material(1.0, 0.3)
# Corners of an element without symmetries, counter-clockwise
CORNERS = np.array([[0.0, 0.0], [1.3, -0.1], [1.1, 0.9], [-0.1, 0.8]])
SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
DIVISIONS = (6, 6)


def element_matrix(element: str) -> Result:
    """Stiffness of one quadrilateral without its inner node: symmetry, rank, its diagonal.

    Curves: `nodes` (9, 2), the inner one at `inner`, and the `cells` they belong to.
    """
    quadrilateral = _Quadrilateral.of(element, CORNERS)
    K = quadrilateral.stiffness
    scalars = {
        "unknowns": len(K),
        "unsymmetry": relative_difference(K, K.T),
        "rigid_motions": len(K) - np.linalg.matrix_rank(K, tol=1e-10),
    }
    for name, corners in (("square", SQUARE), ("distorted", CORNERS)):
        right = _Quadrilateral.of(element, corners, "right").stiffness
        scalars[f"diagonal_{name}"] = relative_difference(
            right, _Quadrilateral.of(element, corners, "left").stiffness
        )
    curves: dict[str, np.ndarray] = {
        "nodes": quadrilateral.nodes,
        "cells": quadrilateral.cells,
        "inner": np.array(quadrilateral.inner),
    }
    numbers = {name: float(value) for name, value in scalars.items()}
    return Result(numbers, dimensionless(numbers), curves, dofs=len(K))


def statics(element: str) -> Result:
    """A clamped body with and without inner nodes, which carry their share of a body load."""
    body = _distorted_body(element)
    U, K = body.space, body.K
    f = assemble_vector(body.body.body_load((0.2, -0.7)))
    held = [prescribe(U, 0, _left_side), prescribe(U, 1, _left_side, 0.01)]
    without = body.supports(held)
    a, a_all = solve(K, f, without), solve(K, f, Reduction.dirichlet(U, held))
    r, r_all = reactions(K, a, f), reactions(K, a_all, f)
    scalars = {
        "displacement_difference": (a - a_all).norm() / a_all.norm(),
        "reaction_difference": (r - r_all).norm() / r_all.norm(),
    }
    return Result(scalars, dimensionless(scalars), dofs=without.right.getSize()[1])


def identity() -> Result:
    """K of the condensed pairs against T times that of condensed pairs of standard triangles.

    And the unsymmetry of both, and of the mass matrices by Guyan's reduction.
    """
    condensed, scalars = [], {}
    for element in ("pw-T6", "galerkin-T6"):
        body = _distorted_body(element)
        inner = mid_diagonal_nodes(body.space)
        reduction = Reduction.condensation(body.K, body.space, inner)
        kept = np.setdiff1d(np.arange(body.K.getSize()[0]), 2 * inner[:, None] + [0, 1])
        condensed.append(dense(reduction.matrix(body.K)))
        mass = dense(reduction.matrix(assemble_matrix(body.body.mass())))
        scalars[f"mass_unsymmetry_{element[:-3]}"] = relative_difference(mass, mass.T)
    T = dense(force_transfer(body.space))[np.ix_(kept, kept)]
    K, K_galerkin = condensed
    scalars["difference"] = relative_difference(K, T @ K_galerkin)
    scalars["difference_without_T"] = relative_difference(K, K_galerkin)
    scalars["unsymmetry_pw"] = relative_difference(K, K.T)
    scalars["unsymmetry_galerkin"] = relative_difference(K_galerkin, K_galerkin.T)
    return Result(scalars, dimensionless(scalars), dofs=len(K))


@dataclass(frozen=True)
class _Quadrilateral:
    """One element.

    Args:
        nodes: (9, 2), inner one too.
        cells: (2, 6) of triangles, (1, 9) of a quadrilateral.
        inner: number of the inner node.
        stiffness: (16, 16), nodes in the order of their positions.
    """

    nodes: Array
    cells: npt.NDArray[np.int32]
    inner: int
    stiffness: Array

    @classmethod
    def of(
        cls, element: str, corners: Array, pattern: DiagonalPattern = "right"
    ) -> "_Quadrilateral":
        """The element on four corners (4, 2), counter-clockwise."""

        def bilinear(x: Array) -> Array:
            s, t = x[:, :1], x[:, 1:2]
            shapes = ((1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t)
            image = sum(shape * corner for shape, corner in zip(shapes, corners, strict=True))
            return np.hstack([image, x[:, 2:]])

        def build(cell: str) -> Mesh:
            return move_nodes(_square(cell, (1, 1), pattern), bilinear)

        body = discretise(element, build, MATERIAL, StressState.PLANE_STRESS)
        nodes = body.space.tabulate_dof_coordinates()[:, :2]
        (inner,) = body.inner_nodes()
        kept = np.delete(np.arange(len(nodes)), inner)
        order = np.lexsort(np.round(nodes[kept], 9).T)
        dofs = (2 * order[:, None] + np.arange(2)).ravel()
        K = dense(body.supports([]).matrix(body.K))[np.ix_(dofs, dofs)]
        return cls(nodes, body.space.dofmap.list.copy(), inner, K)


def _distorted_body(element: str) -> Discretisation:
    return discretise(
        element,
        lambda cell: move_nodes(_square(cell, DIVISIONS, "right"), smooth_distortion),
        MATERIAL,
        StressState.PLANE_STRESS,
    )


def _square(cell: str, divisions: tuple[int, int], pattern: DiagonalPattern) -> Mesh:
    if cell == "quadrilateral":
        return quadrilaterals(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), divisions)
    return triangles(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), divisions, pattern)


def _left_side(x: Array) -> npt.NDArray[np.bool_]:
    return np.isclose(x[0], 0.0)


QUADRILATERALS = ("pw-Q8", "pw-Q9")
CASES = [
    Case("5", f"{name}-{element}", run, {"element": element})
    for name, run in (("element", element_matrix), ("statics", statics))
    for element in QUADRILATERALS
]
CASES += [Case("5", "identity", identity, implied={"compared": ["pw-T6", "galerkin-T6"]})]
