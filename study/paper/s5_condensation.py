"""Section 5: the 8-node quadrilateral, two triangles without their inner node (Fig. 3)."""

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
from study.judge.checks import check
from study.meshes.distortion import distort_unit_domain_smoothly
from study.meshes.inner_nodes import mid_diagonal_nodes
from study.model.discretisation import Discretisation, discretise
from study.model.matrices import relative_norm_of_difference, to_dense_array
from study.model.units import assign_unit_one_to_scalars
from study.run.cases import Case
from study.run.store import Result

SECTION = "5"
TITLE = "The 8-node quadrilateral"
FACTS = {
    "geometry": "a quadrilateral without symmetries and a unit square, each of two triangles; a "
    "distorted unit square",
    "mesh": "one element; 6 × 6 squares",
    "material": "linear elastic, plane stress; E = 1, ν = 0.3",
    "supports": "none for the element; one side of the square clamped",
    "load": "a body load, which acts on inner nodes, too",
    "reference": "the same problem with all nodes kept; rigid motions counted",
    "uncertainty": "none but round-off",
}

Array = npt.NDArray[np.float64]

# Problem

PROBLEM = r"""
{{ figure("fig03") }}
"""

MATERIAL = Material(1.0, 0.3)
CORNERS = np.array([[0.0, 0.0], [1.3, -0.1], [1.1, 0.9], [-0.1, 0.8]])
"""Corners of an element without symmetries, counter-clockwise."""
SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
DIVISIONS = (6, 6)
"""Numbers of squares along the sides of the distorted square."""

# Method

METHOD = r"""
With kept nodes e and inner nodes i, condensation {{ cite("guyan") }} is
$\boldsymbol{K}_\mathrm{r} = \boldsymbol{L}^\mathrm{T} \boldsymbol{K} \boldsymbol{R}$ with
$\boldsymbol{L}^\mathrm{T} = [\boldsymbol{I}, -\boldsymbol{K}_\mathrm{ei} \boldsymbol{K}_\mathrm{ii}^{-1}]$ and
$\boldsymbol{R} = [\boldsymbol{I}; -\boldsymbol{K}_\mathrm{ii}^{-1} \boldsymbol{K}_\mathrm{ie}]$; for an unsymmetric
$\boldsymbol{K}$ the two differ. Loads on inner nodes are carried over by $\boldsymbol{L}^\mathrm{T} \boldsymbol{f}$, and
inner displacements are recovered as
$\boldsymbol{K}_\mathrm{ii}^{-1} (\boldsymbol{f}_\mathrm{i} - \boldsymbol{K}_\mathrm{ie} \boldsymbol{a}_\mathrm{e})$. The
paper's element is compared with the extension that it only mentions: a native quadrilateral with biquadratic shape
functions and weights that are bilinear on four sub-quadrilaterals, its centre node condensed. Static results are compared
on a distorted, clamped square under a body load that also loads inner nodes, and reactions on the unit square of section
7.1.
"""


@dataclass(frozen=True)
class _CondensedQuadrilateral:
    """Quadrilateral whose inner node has been condensed.

    Args:
        nodes: Positions (9, 2), including the inner node.
        cells: Nodes (2, 6) of two triangles, or (1, 9) of one quadrilateral.
        inner: Number of the inner node.
        stiffness: Condensed stiffness (16, 16), nodes ordered by position.
    """

    nodes: Array
    cells: npt.NDArray[np.int32]
    inner: int
    stiffness: Array

    @classmethod
    def condense_on_corners(
        cls, element: str, corners: Array, pattern: DiagonalPattern = "right"
    ) -> "_CondensedQuadrilateral":
        """Build an element on corners (4, 2), counter-clockwise, and condense its inner node."""

        def map_bilinearly(x: Array) -> Array:
            s, t = x[:, :1], x[:, 1:2]
            shapes = ((1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t)
            image = sum(shape * corner for shape, corner in zip(shapes, corners, strict=True))
            return np.hstack([image, x[:, 2:]])

        def mesh_quadrilateral(cell: str) -> Mesh:
            return move_nodes(_mesh_square(cell, (1, 1), pattern), map_bilinearly)

        body = discretise(element, mesh_quadrilateral, MATERIAL, StressState.PLANE_STRESS)
        nodes = body.space.tabulate_dof_coordinates()[:, :2]
        (inner,) = body.inner_nodes()
        outer = np.delete(np.arange(len(nodes)), inner)
        order = np.lexsort(np.round(nodes[outer], 9).T)
        dofs = (2 * order[:, None] + np.arange(2)).ravel()
        stiffness = to_dense_array(body.supports([]).matrix(body.K))[np.ix_(dofs, dofs)]
        return cls(nodes, body.space.dofmap.list.copy(), inner, stiffness)


def element_matrix(element: str) -> Result:
    """Compute asymmetry and rank deficiency of a condensed stiffness, and the diagonal's effect.

    The curves of the result are `nodes` (9, 2), `cells` (2, 6) or (1, 9), and `inner`, the index of
    the inner node in `nodes`.
    """
    quadrilateral = _CondensedQuadrilateral.condense_on_corners(element, CORNERS)
    K = quadrilateral.stiffness
    scalars = {
        "unknowns": float(len(K)),
        "unsymmetry": relative_norm_of_difference(K, K.T),
        "rigid_motions": float(len(K) - np.linalg.matrix_rank(K, tol=1e-10)),
    }
    for name, corners in (("square", SQUARE), ("distorted", CORNERS)):
        right = _CondensedQuadrilateral.condense_on_corners(element, corners, "right")
        left = _CondensedQuadrilateral.condense_on_corners(element, corners, "left")
        scalars[f"diagonal_{name}"] = relative_norm_of_difference(right.stiffness, left.stiffness)
    curves: dict[str, np.ndarray] = {
        "nodes": quadrilateral.nodes,
        "cells": quadrilateral.cells,
        "inner": np.array(quadrilateral.inner),
    }
    return Result(scalars, assign_unit_one_to_scalars(scalars), curves, dofs=len(K))


def statics(element: str) -> Result:
    """Compare displacements and reactions of a clamped square with inner nodes condensed and kept.

    The body load acts on inner nodes, too.
    """
    body = _discretise_distorted_square(element)
    U, K = body.space, body.K
    f = assemble_vector(body.body.body_load((0.2, -0.7)))
    supports = [prescribe(U, 0, _on_left_side), prescribe(U, 1, _on_left_side, 0.01)]
    condensed, full = body.supports(supports), Reduction.dirichlet(U, supports)
    a_condensed, a_full = solve(K, f, condensed), solve(K, f, full)
    r_condensed, r_full = reactions(K, a_condensed, f), reactions(K, a_full, f)
    scalars = {
        "displacement_difference": (a_condensed - a_full).norm() / a_full.norm(),
        "reaction_difference": (r_condensed - r_full).norm() / r_full.norm(),
    }
    return Result(scalars, assign_unit_one_to_scalars(scalars), dofs=condensed.right.getSize()[1])


def identity() -> Result:
    """Compare condensed stiffness matrices: K of the new triangles, and T times K of standard ones.

    Further scalars are the asymmetry of both matrices, and of the condensed mass matrices.
    """
    condensed, scalars = [], {}
    for element in ("pw-T6", "galerkin-T6"):
        body = _discretise_distorted_square(element)
        inner = mid_diagonal_nodes(body.space)
        reduction = Reduction.condensation(body.K, body.space, inner)
        inner_dofs = 2 * inner[:, None] + [0, 1]
        outer_dofs = np.setdiff1d(np.arange(body.K.getSize()[0]), inner_dofs)
        condensed.append(to_dense_array(reduction.matrix(body.K)))
        mass = to_dense_array(reduction.matrix(assemble_matrix(body.body.mass())))
        weights = element.removesuffix("-T6")
        scalars[f"mass_unsymmetry_{weights}"] = relative_norm_of_difference(mass, mass.T)
    T = to_dense_array(force_transfer(body.space))[np.ix_(outer_dofs, outer_dofs)]
    K, K_galerkin = condensed
    scalars["difference"] = relative_norm_of_difference(K, T @ K_galerkin)
    scalars["difference_without_T"] = relative_norm_of_difference(K, K_galerkin)
    scalars["unsymmetry_pw"] = relative_norm_of_difference(K, K.T)
    scalars["unsymmetry_galerkin"] = relative_norm_of_difference(K_galerkin, K_galerkin.T)
    return Result(scalars, assign_unit_one_to_scalars(scalars), dofs=len(K))


def _discretise_distorted_square(element: str) -> Discretisation:
    def mesh_distorted_square(cell: str) -> Mesh:
        return move_nodes(_mesh_square(cell, DIVISIONS, "right"), distort_unit_domain_smoothly)

    return discretise(element, mesh_distorted_square, MATERIAL, StressState.PLANE_STRESS)


def _mesh_square(cell: str, divisions: tuple[int, int], pattern: DiagonalPattern) -> Mesh:
    if cell == "quadrilateral":
        return quadrilaterals(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), divisions)
    return triangles(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), divisions, pattern)


def _on_left_side(x: Array) -> npt.NDArray[np.bool_]:
    return np.isclose(x[0], 0.0)


# Cases

QUADRILATERALS = ("pw-Q8", "pw-Q9")
CASES = [
    Case("5", f"{name}-{element}", problem, {"element": element})
    for name, problem in (("element", element_matrix), ("statics", statics))
    for element in QUADRILATERALS
]
CASES += [
    Case("5", "identity", identity, implied_parameters={"compared": ["pw-T6", "galerkin-T6"]})
]

# Results

DETAILS = r"""
{% call table("5-the-condensed-quadrilaterals", "The condensed quadrilaterals.") %}
{% set elements = ("pw-Q8", "pw-Q9") %}
| Quantity | Two triangles condensed | Native quadrilateral condensed |
|---|---:|---:|
| unknowns of one element |{% for e in elements %} {{ fixed(s("5/element-" ~ e, "unknowns"), 0) }} |{% endfor %}

| rigid motions of $K$ |{% for e in elements %} {{ fixed(s("5/element-" ~ e, "rigid_motions"), 0) }} |{% endfor %}

| $\|K - K^\mathrm{T}\| / \|K\|$ |{% for e in elements %} {{ num(s("5/element-" ~ e, "unsymmetry"), 3) }} |{% endfor %}

| displacements with and without inner nodes, relative difference |{% for e in elements %} {{ num(s("5/statics-" ~ e, "displacement_difference"), 2) }} |{% endfor %}

| reactions with and without inner nodes, relative difference |{% for e in elements %} {{ num(s("5/statics-" ~ e, "reaction_difference"), 2) }} |{% endfor %}

| reactions of section 7.1: left, centre, right |{% for e in elements %} {% for i in range(3) %}{{ num(s("7.1/" ~ e, "reaction_" ~ i), 6) }}{{ ", " if i < 2 }}{% endfor %} |{% endfor %}

| corner over mid-side reaction, row of squares |{% for e in elements %} {{ num(measure("corner_over_midside", element=e), 6) }} |{% endfor %}

| $K$ with one diagonal against $K$ with the other, square element |{% for e in elements %} {{ num(s("5/element-" ~ e, "diagonal_square"), 3) }} |{% endfor %}

| the same, the element of Fig. 3 |{% for e in elements %} {{ num(s("5/element-" ~ e, "diagonal_distorted"), 3) }} |{% endfor %}

{% endcall %}
"""

# Findings

CHECKS = [
    check(
        "s5-identity",
        "The condensed stiffness is T times that of two standard triangles condensed in the "
        "same way.",
        lambda results: results.scalar("5/identity", "difference"),
        "=",
        0.0,
        tolerance=1e-13,
        tolerance_why="round-off of a small linear system",
        why="T multiplies the inner equation by 3/4 and passes parts of it on to the others, "
        "which elimination undoes.",
    ),
    check(
        "s5-diagonal",
        "Even on a square the condensed element depends on which diagonal cuts it.",
        lambda results: results.scalar("5/element-pw-Q8", "diagonal_square"),
        ">",
        0.001,
        tolerance_why="far above round-off, far below the measured value",
        why="Both cuts agree for stress fields that their triangles represent, and in no other "
        "deformation: the element has a preferred direction.",
    ),
]

FINDINGS = r"""
**Two triangles make a quadrilateral.** The paper's 8-node element is a pair of its triangles whose shared inner node is
eliminated by static condensation:
$\boldsymbol{K}_\mathrm{r} = \boldsymbol{L}^\mathrm{T} \boldsymbol{K} \boldsymbol{R}$, with $\boldsymbol{L}$ different
from $\boldsymbol{R}$ because $\boldsymbol{K}$ is unsymmetric. In statics the quadrilateral *is* its two triangles:
relative differences are {{ num(s("5/statics-pw-Q8", "displacement_difference"), 1) }} in displacements and
{{ num(s("5/statics-pw-Q8", "reaction_difference"), 1) }} in reactions. Two consequences are not mentioned in the paper. A
comparison with CPS8 also compares different shape functions; and the element depends on the diagonal that is cut (for a
square the two stiffness matrices differ by {{ num(s("5/element-pw-Q8", "diagonal_square"), 2) }} in relative norm). This
study therefore adds a native quadrilateral, “{{ names["pw-Q9"] }}”, with bilinear weights on four sub-quadrilaterals,
which the paper mentions but does not build.
"""

FURTHER_FINDINGS = r"""
1. What section T says about the triangle also holds for the quadrilateral: its stiffness is $\boldsymbol{T}$ times that of
   two standard triangles condensed in the same way (relative difference {{ num(s("5/identity", "difference"), 2) }};
   without $\boldsymbol{T}$ {{ num(s("5/identity", "difference_without_T"), 2) }}).
2. The stiffness matrices of the two cuts agree for the stress fields that the triangles represent exactly, so the
   difference concerns only the higher deformation modes of an element and vanishes with refinement. The native
   quadrilateral has no preferred direction.
"""

# Limits

LIMITS = r"""
Equality with the two triangles says nothing about their accuracy; see section T and section 7. In eigenvalue problems
Guyan's reduction is not an exact elimination; section V8 treats it.
"""
