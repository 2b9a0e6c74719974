"""Combinations of a stiffness matrix and a lumped mass matrix for explicit dynamics."""

from collections.abc import Callable
from dataclasses import dataclass

from petsc4py import PETSc

import basix
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from dolfinx.mesh import Mesh

from pw_elements import (
    Body,
    Material,
    Reduction,
    Sibling,
    Spaces,
    assemble_matrix,
    lumped_mass,
    prescribe,
)
from pw_elements.elasticity import StressState

Array = npt.NDArray[np.float64]

POISSONS_RATIO = 0.3
YOUNGS_MODULUS = (1 + POISSONS_RATIO) * (1 - 2 * POISSONS_RATIO) / (1 - POISSONS_RATIO)
"""Young's modulus for which, at density one, the speed of sound in uniaxial strain is one."""
MATERIAL = Material(YOUNGS_MODULUS, POISSONS_RATIO)
STRESS_STATE_BY_DIMENSION = {2: StressState.PLANE_STRAIN, 3: StressState.SOLID}
"""Stress state by dimension of the mesh."""
ELEMENT_BY_SCHEME = {
    "hrz": "galerkin",
    "standard-pwmass": "galerkin",
    "sibling": "sibling",
    "sibling-pwmass": "sibling",
    "pw": "pw",
}
"""Element whose stiffness a scheme uses, by name of the scheme."""


@dataclass(frozen=True)
class StiffnessMassPair:
    """Stiffness matrix combined with a lumped mass matrix.

    Args:
        body: Finite-element model whose stiffness is used, with its spaces and material.
        K: Stiffness matrix without supports.
        M: Diagonal mass matrix.
        sibling: Transformation from displacements to the coefficients of the symmetric sibling, if
            these are the unknowns; otherwise None.
    """

    body: Body
    K: PETSc.Mat
    M: PETSc.Mat
    sibling: Sibling | None = None

    @classmethod
    def from_scheme_name(cls, scheme: str, mesh: Mesh) -> "StiffnessMassPair":
        """Assemble the stiffness and the lumped mass of a named scheme.

        Args:
            scheme: Name of the scheme, a key of `ELEMENT_BY_SCHEME`.
            mesh: Mesh of the body.
        """
        state = STRESS_STATE_BY_DIMENSION[mesh.topology.dim]
        standard = Body(Spaces.galerkin(mesh), MATERIAL, state)
        new = Body(Spaces.petrov_galerkin(mesh), MATERIAL, state)
        if scheme == "pw":
            return cls(new, assemble_matrix(new.stiffness()), _assemble_row_sum_lumped_mass(new))
        K, space = assemble_matrix(standard.stiffness()), standard.spaces.trial
        if scheme == "hrz":
            return cls(standard, K, _assemble_hinton_rock_zienkiewicz_mass(space))
        if scheme == "standard-pwmass":
            return cls(standard, K, _assemble_row_sum_lumped_mass(new))
        sibling = Sibling.from_space(space)
        if scheme == "sibling-pwmass":
            return cls(standard, sibling.matrix(K), _assemble_row_sum_lumped_mass(new), sibling)
        M = lumped_mass(sibling.matrix(assemble_matrix(standard.mass())), space)
        return cls(standard, sibling.matrix(K), M, sibling)

    @property
    def space(self) -> fem.FunctionSpace:
        """Finite-element space of the displacements."""
        return self.body.spaces.trial

    def make_smooth_wall_supports(self, distances_between_walls: list[float]) -> Reduction:
        """Return supports by two smooth rigid walls normal to each of the first axes.

        Args:
            distances_between_walls: Coordinate of the second wall on each axis; the first wall is
                at 0.
        """
        conditions = [
            prescribe(self.space, axis, make_plane_marker(axis, end))
            for axis, length in enumerate(distances_between_walls)
            for end in (0.0, length)
        ]
        if self.sibling is not None:
            return self.sibling.dirichlet(conditions)
        return Reduction.dirichlet(self.space, conditions)


def make_plane_marker(axis: int, value: float) -> Callable[[Array], npt.NDArray[np.bool_]]:
    """Return a function that marks the points (3, n) at which one coordinate has a given value."""
    return lambda x: np.isclose(x[axis], value)


def _assemble_row_sum_lumped_mass(body: Body) -> PETSc.Mat:
    return lumped_mass(assemble_matrix(body.mass()), body.spaces.trial)


def _assemble_hinton_rock_zienkiewicz_mass(space: fem.FunctionSpace) -> PETSc.Mat:
    """Return the Hinton-Rock-Zienkiewicz (HRZ) lumped mass of straight cells with density one.

    The diagonal of each cell's consistent mass matrix is scaled such that it sums up to the mass of
    the cell (DOI 10.1002/eqe.4290040305).
    """
    element = space.element.basix_element
    points, weights = basix.make_quadrature(element.cell_type, 4)
    diagonal = weights @ element.tabulate(0, points)[0, :, :, 0] ** 2
    cells = fem.functionspace(space.mesh, ("DG", 0))
    volume = fem.assemble_vector(fem.form(ufl.TestFunction(cells) * ufl.dx)).array
    node_masses = np.outer(volume, diagonal / diagonal.sum())
    mass = np.bincount(space.dofmap.list.ravel(), node_masses.ravel())
    M = PETSc.Mat().createAIJ([len(mass) * space.dofmap.index_map_bs] * 2, nnz=1)
    M.setDiagonal(PETSc.Vec().createWithArray(np.repeat(mass, space.dofmap.index_map_bs)))
    M.assemble()
    return M
