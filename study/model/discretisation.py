"""The elements that the study compares, by the names of its result files."""

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

# CPS6, CPS8 (plane stress) of the paper's commercial code are the standard Galerkin elements
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
    # on tetrahedra and hexahedra; `study.solutions.solids` transfers the standard element's forces
    "galerkin-T10": Spaces.galerkin,
    "transferred-T10": Spaces.galerkin,
    "sibling-T10": Spaces.galerkin,
    "pw-T10": Spaces.petrov_galerkin,
    "onecut-T10": p1_iso_p2_weight_spaces,
    # with a pressure beside displacements
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

# Functions that find the inner node of quadrilaterals with piecewise-linear weights, which
# standard ones do not have: on the diagonal between two triangles (the paper's section 5), or at
# the centre of four sub-quadrilaterals
_FIND_INNER_NODES = {
    "pw-Q8": mid_diagonal_nodes,
    "pwsym-Q8": mid_diagonal_nodes,
    "pw-Q9": centre_nodes,
}


@dataclass(frozen=True)
class Discretisation:
    """Elastic body discretised with one of the study's elements.

    Stiffness and loads include inner nodes; `supports` condenses these.

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

    def surface_load(self, traction: VectorCoefficient, on_loaded_part: Marker) -> PETSc.Vec:
        """Return the load vector of a traction on the marked part of the boundary."""
        surface = boundary_measure(self.body.spaces.mesh, on_loaded_part)
        return assemble_vector(self.body.surface_load(traction, surface))

    def supports(self, conditions: Sequence[fem.DirichletBC]) -> Reduction:
        """Return the reduction by Dirichlet conditions and by condensation of inner nodes."""
        if self.element not in _FIND_INNER_NODES:
            return Reduction.dirichlet(self.space, conditions)
        return Reduction.condensation(self.K, self.space, self.inner_nodes(), conditions)

    def inner_nodes(self) -> npt.NDArray[np.int32]:
        """Return the local numbers of the nodes that the element condenses."""
        if self.element not in _FIND_INNER_NODES:
            return np.empty(0, dtype=np.int32)
        return _FIND_INNER_NODES[self.element](self.space)


def discretise(
    element: str,
    build_mesh: Callable[[str], Mesh],
    material: Material,
    state: StressState,
) -> Discretisation:
    """Discretise a body; `build_mesh` makes a mesh of "triangle" or "quadrilateral" cells."""
    mesh = build_mesh("quadrilateral" if has_quadrilateral_mesh(element) else "triangle")
    body = Body(spaces(element, mesh), material, state)
    return Discretisation(element, body, assemble_matrix(body.stiffness()))


def mesh_nodes_and_cells(space: fem.FunctionSpace) -> dict[str, npt.NDArray[Any]]:
    """Return the curves `nodes` (n, dim) and `cells`, the nodes of each cell in Basix's order."""
    space = displacement_space(space)
    return {
        "nodes": space.tabulate_dof_coordinates()[:, : space.mesh.geometry.dim],
        "cells": space.dofmap.list.copy(),
    }


def spaces(element: str, mesh: Mesh) -> Spaces:
    """Return the trial and test spaces of an element on a mesh of its cells."""
    return _MAKE_SPACES[element](mesh)


def displacement_space(space: fem.FunctionSpace) -> fem.FunctionSpace:
    """Return the space of displacements alone; of a mixed space, its collapsed part."""
    return SubSpace.displacements(space).space


def mass_condensation(
    condensation: Reduction, left_matrix: Literal["transposed", "same"]
) -> Reduction:
    """Return a condensation of mass matrices with one of two left matrices L.

    "transposed" keeps its L, from the transposed problem; "same" sets L = R, as symmetric codes
    do. L^T K R does not change, since K R vanishes in the inner rows; L^T M R does.
    """
    return (
        condensation
        if left_matrix == "transposed"
        else replace(condensation, left=condensation.right)
    )


def prescribe_nodes(
    space: fem.FunctionSpace, nodes: npt.NDArray[np.int32], displacement: npt.NDArray[np.floating]
) -> fem.DirichletBC:
    """Return the condition that nodes (m,) have prescribed displacements (m, dim).

    Nodes are those of the displacement space.
    """
    field, prescribed = SubSpace.displacements(space), fem.Function(space)
    prescribed.x.array[field.unknowns[nodes]] = displacement
    dofs = nodes if field.is_whole_space else field.unknowns[nodes].ravel()
    return fem.dirichletbc(prescribed, dofs)


def has_quadrilateral_mesh(element: str) -> bool:
    """Return whether the element is on quadrilateral cells; pw-Q8 is on pairs of triangles."""
    return element in ("galerkin-Q8", "pw-Q9") or element.endswith("hybrid-Q9")


def is_symmetrised(element: str) -> bool:
    """Return whether matrices are replaced by their symmetric parts, as symmetric solvers do."""
    return element.startswith("pwsym")
