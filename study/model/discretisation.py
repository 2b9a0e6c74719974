"""Discretisation of bodies with the elements that the study compares, by name of element."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.mesh import Mesh

from pw_elements import (
    Body,
    Material,
    Reduction,
    Spaces,
    assemble_matrix,
    assemble_vector,
    boundary_measure,
)
from pw_elements.elasticity import StressState, VectorCoefficient
from pw_elements.spaces import (
    Marker,
    SubSpace,
)
from study.meshes.inner_nodes import centre_nodes, mid_diagonal_nodes
from study.model.elements import (
    composite_spaces,
    p1_iso_p2_weight_spaces,
    serendipity_spaces,
    taylor_hood_spaces,
)

# The elements CPS6 and CPS8 (plane stress) of the paper's commercial code are galerkin-T6 and -Q8
_MAKE_SPACES: dict[str, Callable[[Mesh], Spaces]] = {
    "galerkin-T6": Spaces.galerkin,
    "pw-T6": Spaces.petrov_galerkin,
    "pwsym-T6": Spaces.petrov_galerkin,
    "sibling-T6": Spaces.galerkin,
    "galerkin-Q8": serendipity_spaces,
    "pw-Q8": Spaces.petrov_galerkin,
    "pwsym-Q8": Spaces.petrov_galerkin,
    "pw-Q9": Spaces.petrov_galerkin,
    "composite-T6": composite_spaces,
    # elements on tetrahedra and hexahedra; `study.solutions.solids` applies T for transferred-T10
    "galerkin-T10": Spaces.galerkin,
    "transferred-T10": Spaces.galerkin,
    "sibling-T10": Spaces.galerkin,
    "pw-T10": Spaces.petrov_galerkin,
    "onecut-T10": p1_iso_p2_weight_spaces,
    # hybrid elements, with displacements and pressure
    "galerkin-hybrid-T6": taylor_hood_spaces,
    "pw-hybrid-T6": Spaces.hybrid,
    "galerkin-hybrid-T10": taylor_hood_spaces,
    "pw-hybrid-T10": Spaces.hybrid,
    "galerkin-hybrid-Q9": taylor_hood_spaces,
    "pw-hybrid-Q9": Spaces.hybrid,
    "galerkin-hybrid-H27": taylor_hood_spaces,
    "pw-hybrid-H27": Spaces.hybrid,
    "galerkin-H27": Spaces.galerkin,
    "pw-H27": Spaces.petrov_galerkin,
}

# Functions that find the inner nodes of quadrilaterals with piecewise-linear weight functions. An
# inner node is the middle of the diagonal between two triangles (section 5 of the paper) or the
# centre of four sub-quadrilaterals; standard quadrilaterals have none
_FIND_INNER_NODES = {
    "pw-Q8": mid_diagonal_nodes,
    "pwsym-Q8": mid_diagonal_nodes,
    "pw-Q9": centre_nodes,
}


@dataclass(frozen=True)
class Discretisation:
    """Elastic body discretised with one of the study's elements.

    Stiffness and loads include inner nodes, which `supports` eliminates by condensation.

    Args:
        element: Name of the element.
        body: Spaces, material and state of stress.
        K: Stiffness matrix without supports.
    """

    element: str
    body: Body
    K: PETSc.Mat

    @property
    def space(self) -> fem.FunctionSpace:
        """Trial space of the displacements."""
        return self.body.spaces.trial

    def surface_load(self, traction: VectorCoefficient, marker_of_loaded_part: Marker) -> PETSc.Vec:
        """Return the load vector of a traction on the marked part of the boundary."""
        surface = boundary_measure(self.body.spaces.mesh, marker_of_loaded_part)
        return assemble_vector(self.body.surface_load(traction, surface))

    def supports(self, conditions: Sequence[fem.DirichletBC]) -> Reduction:
        """Return the reduction by Dirichlet conditions and by condensation of inner nodes."""
        if self.element not in _FIND_INNER_NODES:
            return Reduction.dirichlet(self.space, conditions)
        return Reduction.condensation(self.K, self.space, self.inner_nodes(), conditions)

    def inner_nodes(self) -> npt.NDArray[np.int32]:
        """Return the local numbers of the inner nodes, which are eliminated by condensation."""
        if self.element not in _FIND_INNER_NODES:
            return np.empty(0, dtype=np.int32)
        return _FIND_INNER_NODES[self.element](self.space)


def discretise(
    element: str,
    build_mesh: Callable[[str], Mesh],
    material: Material,
    state: StressState,
) -> Discretisation:
    """Mesh a body, make the spaces of an element, and assemble the stiffness matrix.

    Args:
        element: Name of the element.
        build_mesh: Function that returns a mesh of cells "triangle" or "quadrilateral".
        material: Elastic material.
        state: State of stress.
    """
    mesh = build_mesh("quadrilateral" if requires_quadrilateral_cells(element) else "triangle")
    body = Body(make_element_spaces(element, mesh), material, state)
    return Discretisation(element, body, assemble_matrix(body.stiffness()))


def mesh_nodes_and_cells(space: fem.FunctionSpace) -> dict[str, npt.NDArray[Any]]:
    """Return the curves `nodes` (n, dim) and `cells` (cells, nodes per cell) for a result.

    The nodes of a cell are in Basix's order.
    """
    space = collapsed_displacement_space(space)
    return {
        "nodes": space.tabulate_dof_coordinates()[:, : space.mesh.geometry.dim],
        "cells": space.dofmap.list.copy(),
    }


def make_element_spaces(element: str, mesh: Mesh) -> Spaces:
    """Return the trial and test spaces of an element on a mesh of suitable cells."""
    return _MAKE_SPACES[element](mesh)


def collapsed_displacement_space(space: fem.FunctionSpace) -> fem.FunctionSpace:
    """Return the space of displacements; it is collapsed if the given space is mixed."""
    return SubSpace.displacements(space).space


def reduction_for_mass_condensation(
    condensation: Reduction, left_matrix: Literal["transposed", "same"]
) -> Reduction:
    """Return the reduction for the condensation of mass matrices.

    "transposed" keeps the left matrix L, which results from the transposed problem. "same" sets
    L = R, as in symmetric codes. The choice affects L^T M R, but not L^T K R, because the rows of
    K R at inner nodes are zero.
    """
    return (
        condensation
        if left_matrix == "transposed"
        else replace(condensation, left=condensation.right)
    )


def prescribe_node_displacements(
    space: fem.FunctionSpace, nodes: npt.NDArray[np.int32], displacement: npt.NDArray[np.floating]
) -> fem.DirichletBC:
    """Return the condition that prescribes displacements (m, dim) at nodes (m,).

    The numbers of the nodes refer to the displacement space.
    """
    field, prescribed = SubSpace.displacements(space), fem.Function(space)
    prescribed.x.array[field.unknowns[nodes]] = displacement
    dofs = nodes if field.is_whole_space else field.unknowns[nodes].ravel()
    return fem.dirichletbc(prescribed, dofs)


def requires_quadrilateral_cells(element: str) -> bool:
    """Return whether the element requires quadrilateral cells; pw-Q8 uses pairs of triangles."""
    return element in ("galerkin-Q8", "pw-Q9") or element.endswith("hybrid-Q9")


def is_symmetrised(element: str) -> bool:
    """Return whether the element's matrices are replaced by their symmetric parts.

    This models symmetric solvers, to which unsymmetric matrices are passed.
    """
    return element.startswith("pwsym")
