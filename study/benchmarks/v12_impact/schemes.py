"""Pairs of a stiffness and a lumped mass for explicit dynamics."""

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
    """A stiffness with a lumped mass.

    Args:
        body: Spaces and material.
        K: Stiffness without supports.
        M: Diagonal mass.
        sibling: Transformation to the sibling's coefficients, if these are the unknowns.
    """

    body: Body
    K: PETSc.Mat
    M: PETSc.Mat
    sibling: Sibling | None = None

    @classmethod
    def from_name(cls, name: str, mesh: Mesh) -> "StiffnessMassPair":
        """Assemble a scheme of `ELEMENT_BY_SCHEME` on a mesh."""
        state = STRESS_STATE_BY_DIMENSION[mesh.topology.dim]
        standard = Body(Spaces.galerkin(mesh), MATERIAL, state)
        new = Body(Spaces.petrov_galerkin(mesh), MATERIAL, state)
        if name == "pw":
            return cls(new, assemble_matrix(new.stiffness()), _assemble_row_sum_mass(new))
        K, space = assemble_matrix(standard.stiffness()), standard.spaces.trial
        if name == "hrz":
            return cls(standard, K, _assemble_hrz_mass(space))
        if name == "standard-pwmass":
            return cls(standard, K, _assemble_row_sum_mass(new))
        sibling = Sibling.from_space(space)
        if name == "sibling-pwmass":
            return cls(standard, sibling.matrix(K), _assemble_row_sum_mass(new), sibling)
        M = lumped_mass(sibling.matrix(assemble_matrix(standard.mass())), space)
        return cls(standard, sibling.matrix(K), M, sibling)

    @property
    def space(self) -> fem.FunctionSpace:
        """Trial space."""
        return self.body.spaces.trial

    def make_wall_supports(self, lengths: list[float]) -> Reduction:
        """Return supports by smooth walls at coordinates 0 and `lengths` along the first axes."""
        conditions = [
            prescribe(self.space, axis, on_plane(axis, end))
            for axis, length in enumerate(lengths)
            for end in (0.0, length)
        ]
        if self.sibling is not None:
            return self.sibling.dirichlet(conditions)
        return Reduction.dirichlet(self.space, conditions)


def on_plane(axis: int, value: float) -> Callable[[Array], npt.NDArray[np.bool_]]:
    """Return a function that marks points (3, n) at which a coordinate has a given value."""
    return lambda x: np.isclose(x[axis], value)


def _assemble_row_sum_mass(body: Body) -> PETSc.Mat:
    return lumped_mass(assemble_matrix(body.mass()), body.spaces.trial)


def _assemble_hrz_mass(space: fem.FunctionSpace) -> PETSc.Mat:
    """Return the lumped mass of Hinton, Rock and Zienkiewicz for straight cells of density one.

    The diagonal of each cell's consistent mass is scaled to the mass of the cell.
    DOI 10.1002/eqe.4290040305.
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
