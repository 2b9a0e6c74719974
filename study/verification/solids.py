"""Bodies in space on the elements of section V10, and contact pressures on their faces.

Two of these ways are what becomes of the standard element: its nodal forces times T, and its
symmetric sibling, whose stiffness is T K T^T. The sibling's unknowns are coefficients a of the
displacements u = T^T a, its forces belong to them, and contact is stated on their gaps T^-T g.
"""

from collections.abc import Callable
from dataclasses import dataclass

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.mesh import Mesh
from scipy.spatial import cKDTree

from pw_elements import (
    Body,
    Material,
    Reduction,
    StressState,
    assemble_matrix,
    assemble_vector,
    boundary_measure,
    reactions,
)
from pw_elements.contact import ContactState, Surface
from pw_elements.mechanics import Marker, Vector
from pw_elements.recovery import SurfaceNodes, by_position, force_transfer
from study.core.store import Result
from study.discretisation import spaces
from study.units import dimensionless

Array = npt.NDArray[np.float64]

# Radius within which pressures are compared, over the contact's
INNER = 0.8
# Of a mid-side node's coefficient, what its displacement keeps
_KEPT = 3 / 4


@dataclass(frozen=True)
class Solid:
    """An elastic body in space on one of the elements.

    Args:
        element: its name.
        body: spaces and material.
        galerkin: stiffness of the trial and test space, free.
        K: the stiffness that is solved with.
        T: the transfer of nodal forces, where the element has it.
    """

    element: str
    body: Body
    galerkin: PETSc.Mat
    K: PETSc.Mat
    T: PETSc.Mat | None

    @classmethod
    def of(cls, element: str, mesh: Mesh, material: Material) -> "Solid":
        """Assembles it."""
        body = Body(spaces(element, mesh), material, StressState.SOLID)
        stiffness = assemble_matrix(body.stiffness())
        if element not in ("transferred-T10", "sibling-T10"):
            return cls(element, body, stiffness, stiffness, None)
        T = force_transfer(body.spaces.trial)
        if element == "transferred-T10":
            return cls(element, body, stiffness, stiffness, T)
        return cls(element, body, stiffness, T.matMult(stiffness).matTransposeMult(T), T)

    @property
    def space(self) -> fem.FunctionSpace:
        """Trial space of the displacements."""
        return self.body.spaces.trial

    @property
    def dofs(self) -> int:
        """Number of unknowns, prescribed ones too."""
        return int(self.K.getSize()[0])

    @property
    def is_sibling(self) -> bool:
        """Whether the unknowns are coefficients."""
        return self.element.startswith("sibling")

    def surface_load(self, traction: Vector, where: Marker) -> PETSc.Vec:
        """Load vector of a traction on the part of the boundary that a marker holds on."""
        surface = boundary_measure(self.body.spaces.mesh, where)
        load = assemble_vector(self.body.surface_load(traction, surface))
        return self.T * load if self.T is not None and self.is_sibling else load

    def held(self, where: Marker, displacement: Callable[[Array], Array]) -> list[fem.DirichletBC]:
        """Prescribed displacements (n, 3) at points (n, 3) of whole faces of the boundary."""
        nodes = fem.locate_dofs_geometrical(self.space, where)
        field = fem.Function(self.space)
        x = self.space.tabulate_dof_coordinates()[nodes]
        field.x.array.reshape(-1, 3)[nodes] = displacement(x)
        field.x.array[:] = self._coefficients(field.x.petsc_vec).array_r
        return [fem.dirichletbc(field, nodes)]

    def held_by_load(self, where: Marker, displacement: Callable[[Array], Array]) -> PETSc.Vec:
        """Load that stands for displacements of faces, which the supports then hold."""
        moved = Reduction.dirichlet(self.space, self.held(where, displacement)).offset
        load = self.K * moved
        load.scale(-1.0)
        return load

    def facing(self, surface: Surface) -> Surface:
        """A surface as the unknowns of the nodes see it."""
        if not self.is_sibling:
            return surface
        x = self.space.tabulate_dof_coordinates()
        gap = np.zeros((len(x), 3))
        gap[:, 2] = np.nan_to_num(surface.gap(x), posinf=0.0)
        vector = self.K.createVecRight()
        vector.setArray(gap.ravel())
        change = (self._coefficients(vector).array_r.reshape(-1, 3) - gap)[:, 2]
        near = np.isclose(x[:, 2], 0.0)
        return _Corrected(surface, cKDTree(x[near, :2]), change[near])

    def nodal_forces(self, state: ContactState, load: PETSc.Vec, where: Marker) -> Array:
        """Contact forces (m, 3) of the last increment at the nodes that `SurfaceNodes` has."""
        if self.T is None or self.is_sibling:
            (pair,) = state.pairs
            return np.asarray(pair.force_normal[:, None] * pair.normal + pair.force_tangential)
        forces = self.T * reactions(self.galerkin, state.displacement, load)
        nodes = fem.locate_dofs_geometrical(self.space, where)
        order = by_position(self.space.tabulate_dof_coordinates()[nodes])
        return np.asarray(forces.array_r.reshape(-1, 3)[nodes[order]])

    def tractions(self, surface: SurfaceNodes, forces: Array) -> Array:
        """Forces (m, 3) over areas, by the nodes' weights; NaN where a node has none."""
        if self.T is None:
            return surface.pressure(forces)
        return surface.tributary_pressure(forces)

    def _coefficients(self, u: PETSc.Vec) -> PETSc.Vec:
        """T^-T u, by the mid-sides' share alone: vertices keep their values."""
        a = u.copy()
        if self.T is not None and self.is_sibling:
            image = u.duplicate()
            self.T.multTranspose(u, image)
            a.maxpy([1 / _KEPT, -1 / _KEPT], [u, image])
        return a


def face_result(
    states: list[ContactState],
    solid: Solid,
    surface: SurfaceNodes,
    forces: Array,
    exact: Array,
    scale: float,
    inner: float,
    **further: float,
) -> Result:
    """Errors of the pressure on a horizontal face, over nodes with weight; curves.

    Args:
        states: all increments.
        solid: the body.
        surface: nodes (m) of the face.
        forces: (m, 3), at them; the last component presses, the first shears.
        exact: (m,), pressure.
        scale: what errors and curves are over.
        inner: distance from the origin within which errors count.
        further: scalars to store besides.
    """
    x, tractions = surface.position, solid.tractions(surface, forces)
    pressure, tributary = tractions[:, 2], surface.tributary_pressure(forces[:, 2])
    r = np.linalg.norm(x[:, :2], axis=1)
    counts = r < inner
    error = np.abs(pressure - exact)[counts] / scale
    (pair,) = states[-1].pairs
    scalars = {
        "pressure_error_median": np.nanmedian(error),
        "pressure_error_max": np.nanmax(error),
        "weightless_nodes": np.isnan(pressure[counts]).sum(),
        "nodes": counts.sum(),
        "iterations": sum(state.iterations for state in states),
        "krylov_iterations": sum(state.report.krylov_iterations for state in states),
        "residual": max(state.residuals.largest() for state in states),
        **further,
    }
    curves = {
        "x": x,
        "pressure": pressure / scale,
        "pressure_tributary": tributary / scale,
        "exact_pressure": exact / scale,
        "shear": tractions[:, 0] / scale,
        "status": pair.status,
        "edges": surface.edges,
    }
    numbers = {name: float(value) for name, value in scalars.items()}
    return Result(numbers, dimensionless(numbers), curves, dofs=solid.dofs)


@dataclass(frozen=True)
class _Corrected:
    """A surface whose gap is changed at each node, told by its place across the axis z."""

    surface: Surface
    places: cKDTree
    change: Array

    def gap(self, x: Array) -> Array:
        """Gap (n,) of points (n, 3)."""
        return self.surface.gap(x) + self.change[self.places.query(x[:, :2])[1]]

    def normal(self, x: Array) -> Array:
        """The surface's own (n, 3)."""
        return self.surface.normal(x)
