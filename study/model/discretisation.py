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
from study.model.elements import composite, one_cut, serendipity, taylor_hood

# CPS6, CPS8 (plane stress) of the paper's commercial code are the standard Galerkin elements
_SPACES: dict[str, Callable[[Mesh], Spaces]] = {
    "galerkin-T6": Spaces.galerkin,
    "pw-T6": Spaces.petrov_galerkin,
    "pwsym-T6": Spaces.petrov_galerkin,
    "sibling-T6": Spaces.galerkin,
    "galerkin-Q8": serendipity,
    "pw-Q8": Spaces.petrov_galerkin,
    "pwsym-Q8": Spaces.petrov_galerkin,
    "pw-Q9": Spaces.petrov_galerkin,
    "composite-T6": composite,
    # on tetrahedra and hexahedra; what becomes of the standard element's forces is the study's
    "galerkin-T10": Spaces.galerkin,
    "transferred-T10": Spaces.galerkin,
    "sibling-T10": Spaces.galerkin,
    "pw-T10": Spaces.petrov_galerkin,
    "onecut-T10": one_cut,
    # with a pressure beside displacements
    "galerkin-hybrid-T6": taylor_hood,
    "pw-hybrid-T6": Spaces.hybrid,
    "galerkin-hybrid-T10": taylor_hood,
    "pw-hybrid-T10": Spaces.hybrid,
    "galerkin-hybrid-Q9": taylor_hood,
    "pw-hybrid-Q9": Spaces.hybrid,
    "galerkin-hybrid-H27": taylor_hood,
    "pw-hybrid-H27": Spaces.hybrid,
    "galerkin-H27": Spaces.galerkin,
    "pw-H27": Spaces.petrov_galerkin,
}

# The quadrilaterals with piecewise-linear weights have an inner node more than the standard one:
# that of two triangles (the paper's section 5), or the centre of four sub-quadrilaterals
_INNER_NODES = {
    "pw-Q8": mid_diagonal_nodes,
    "pwsym-Q8": mid_diagonal_nodes,
    "pw-Q9": centre_nodes,
}


@dataclass(frozen=True)
class Discretisation:
    """An elastic body on one of the study's elements.

    Its stiffness and loads are those of all nodes, inner ones too: `supports` condenses them.

    Args:
        element: its name.
        body: displacement spaces, material, state.
        K: stiffness, free.
    """

    element: str
    body: Body
    K: PETSc.Mat

    @property
    def space(self) -> fem.FunctionSpace:
        """Trial space of the displacements."""
        return self.body.spaces.trial

    def surface_load(self, traction: VectorCoefficient, where: Marker) -> PETSc.Vec:
        """Load vector of a traction on the part of the boundary that a marker holds on."""
        surface = boundary_measure(self.body.spaces.mesh, where)
        return assemble_vector(self.body.surface_load(traction, surface))

    def supports(self, conditions: Sequence[fem.DirichletBC]) -> Reduction:
        """Dirichlet conditions, and what the element condenses."""
        if self.element not in _INNER_NODES:
            return Reduction.dirichlet(self.space, conditions)
        return Reduction.condensation(self.K, self.space, self.inner_nodes(), conditions)

    def inner_nodes(self) -> npt.NDArray[np.int32]:
        """Local numbers of the nodes that the element condenses."""
        if self.element not in _INNER_NODES:
            return np.empty(0, dtype=np.int32)
        return _INNER_NODES[self.element](self.space)


def discretise(
    element: str,
    build: Callable[[str], Mesh],
    material: Material,
    state: StressState,
) -> Discretisation:
    """A body on an element; `build` makes a mesh of "triangle" or "quadrilateral" cells."""
    mesh = build("quadrilateral" if is_quadrilateral(element) else "triangle")
    body = Body(spaces(element, mesh), material, state)
    return Discretisation(element, body, assemble_matrix(body.stiffness()))


def mesh_curves(space: fem.FunctionSpace) -> dict[str, npt.NDArray[Any]]:
    """Nodes (n, dim) and the nodes of each cell in Basix's order, to draw and to check with."""
    space = displacement_space(space)
    return {
        "nodes": space.tabulate_dof_coordinates()[:, : space.mesh.geometry.dim],
        "cells": space.dofmap.list.copy(),
    }


def spaces(element: str, mesh: Mesh) -> Spaces:
    """Displacement spaces of an element on a mesh of its cells."""
    return _SPACES[element](mesh)


def displacement_space(space: fem.FunctionSpace) -> fem.FunctionSpace:
    """That of the displacements alone, with nodes of its own where there is a pressure."""
    return SubSpace.displacements(space).space


def mass_left(condensed: Reduction, left: Literal["transposed", "same"]) -> Reduction:
    """A condensation for mass matrices, where two left matrices L are in use.

    "transposed" is its own L, from the transposed problem; "same" takes R for L, the recipe of
    symmetric codes. L^T K R is the same, since K R vanishes in the inner rows; L^T M R is not.
    """
    return condensed if left == "transposed" else replace(condensed, left=condensed.right)


def held_nodes(
    space: fem.FunctionSpace, nodes: npt.NDArray[np.int32], displacement: npt.NDArray[np.floating]
) -> fem.DirichletBC:
    """Prescribed displacements (m, dim) of nodes (m,) of the displacement space."""
    field, exact = SubSpace.displacements(space), fem.Function(space)
    exact.x.array[field.unknowns[nodes]] = displacement
    return fem.dirichletbc(exact, nodes if field.is_whole_space else field.unknowns[nodes].ravel())


def is_quadrilateral(element: str) -> bool:
    """Whether the element's mesh is one of quadrilaterals; pw-Q8 has pairs of triangles."""
    return element in ("galerkin-Q8", "pw-Q9") or element.endswith("hybrid-Q9")


def is_symmetrised(element: str) -> bool:
    """Whether matrices are replaced by their symmetric parts, as a symmetric solver does."""
    return element.startswith("pwsym")
