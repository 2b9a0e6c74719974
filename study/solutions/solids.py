"""Bodies in space on the elements of section V10, and contact pressures on their faces.

Two of these ways are what becomes of the standard element: its nodal forces times T, and its
symmetric sibling, whose stiffness is T K T^T. The sibling's unknowns are coefficients of the
displacements, its forces belong to them, and contact is stated on their gaps.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.mesh import Mesh

from pw_elements import (
    Body,
    Material,
    Reduction,
    Sibling,
    Spaces,
    SurfaceNodes,
    assemble_matrix,
    assemble_vector,
    boundary_measure,
    force_transfer,
    reactions,
)
from pw_elements.contact.model import ContactState
from pw_elements.elasticity import StressState, VectorCoefficient, order_by_position
from pw_elements.spaces import Marker
from study.model.discretisation import displacement_space, held_nodes, spaces
from study.model.reading import compared, transferred
from study.model.units import dimensionless
from study.run.store import Result

Array = npt.NDArray[np.float64]

# Radius within which pressures are compared, over the contact's
INNER = 0.8


@dataclass(frozen=True)
class Solid:
    """An elastic body in space on one of the elements.

    Args:
        element: its name.
        body: spaces and material.
        galerkin: stiffness of the trial and test space, free.
        K: the stiffness that is solved with.
        T: the transfer of nodal forces, where the standard element's get it.
        sibling: where the unknowns are its coefficients.
    """

    element: str
    body: Body
    galerkin: PETSc.Mat
    K: PETSc.Mat
    T: PETSc.Mat | None = None
    sibling: Sibling | None = None

    @classmethod
    def of(cls, element: str, mesh: Mesh, material: Material) -> "Solid":
        """Assembles it."""
        body = Body(spaces(element, mesh), material, StressState.SOLID)
        stiffness = assemble_matrix(body.stiffness(), blocked=True)
        if element == "transferred-T10":
            T = force_transfer(body.spaces.trial)
            return cls(element, body, stiffness, stiffness, T)
        if element == "sibling-T10":
            sibling = Sibling.from_space(body.spaces.trial)
            return cls(element, body, stiffness, sibling.matrix(stiffness), sibling=sibling)
        return cls(element, body, stiffness, stiffness)

    @property
    def space(self) -> fem.FunctionSpace:
        """Trial space of the displacements."""
        return self.body.spaces.trial

    @property
    def displacements(self) -> fem.FunctionSpace:
        """Space of the displacements alone."""
        return displacement_space(self.space)

    @property
    def dofs(self) -> int:
        """Number of unknowns, prescribed ones too."""
        return int(self.K.getSize()[0])

    def surface_load(self, traction: VectorCoefficient, where: Marker) -> PETSc.Vec:
        """Load vector of a traction on the part of the boundary that a marker holds on."""
        surface = boundary_measure(self.body.spaces.mesh, where)
        load = assemble_vector(self.body.surface_load(traction, surface))
        return load if self.sibling is None else self.sibling.load(load)

    def supports(self, conditions: list[fem.DirichletBC]) -> Reduction:
        """Supports that prescribe displacements."""
        if self.sibling is not None:
            return self.sibling.dirichlet(conditions)
        return Reduction.dirichlet(self.space, conditions)

    def held(self, where: Marker, displacement: Callable[[Array], Array]) -> list[fem.DirichletBC]:
        """Prescribed displacements (n, 3) at points (n, 3) of whole faces of the boundary."""
        x = self.displacements.tabulate_dof_coordinates()
        nodes = fem.locate_dofs_geometrical(self.displacements, where)
        return [held_nodes(self.space, nodes, displacement(x[nodes]))]

    def held_by_load(self, where: Marker, displacement: Callable[[Array], Array]) -> PETSc.Vec:
        """Load that stands for displacements of faces, which the supports then hold."""
        moved = self.supports(self.held(where, displacement)).offset
        load = self.K * moved
        load.scale(-1.0)
        return load

    def nodal_forces(self, state: ContactState, load: PETSc.Vec, where: Marker) -> Array:
        """Contact forces (m, 3) of the last increment at the nodes that `SurfaceNodes` has."""
        if self.T is None:
            (pair,) = state.pairs
            return np.asarray(pair.force_normal[:, None] * pair.normal + pair.force_tangential)
        forces = self.T * reactions(self.galerkin, state.displacement, load)
        nodes = fem.locate_dofs_geometrical(self.space, where)
        order = order_by_position(self.space.tabulate_dof_coordinates()[nodes])
        return np.asarray(forces.array_r.reshape(-1, 3)[nodes[order]])

    def faces(self, where: Marker) -> tuple[SurfaceNodes, SurfaceNodes]:
        """Nodes (m) of a part of the boundary, with own weights and with the standard element's."""
        own = SurfaceNodes.from_body(self.body, where)
        spaces, T = self.body.spaces, self.T
        if spaces.test is not spaces.trial:
            galerkin = replace(self.body, spaces=Spaces.galerkin(spaces.mesh))
            return own, SurfaceNodes.from_body(galerkin, where)
        if self.sibling is not None:
            T = force_transfer(self.space)
        return own if T is None else transferred(own, T), own


def errors_beside(name: str, error: Array, standard: SurfaceNodes) -> dict[str, float]:
    """Scalars of errors (m,) on the nodes that the standard element reads, and on others."""
    sizes = compared(error, standard.pressure(np.zeros(len(error))))
    return {f"{name}_{of}": size for of, size in sizes.items()}


def face_result(
    states: list[ContactState],
    solid: Solid,
    faces: tuple[SurfaceNodes, SurfaceNodes],
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
        faces: `Solid.faces` of the face.
        forces: (m, 3), at its nodes; the last component presses, the first shears.
        exact: (m,), pressure.
        scale: what errors and curves are over.
        inner: distance from the origin within which errors count.
        further: scalars to store besides.
    """
    surface, standard = faces
    x, tractions = surface.position, surface.pressure(forces)
    pressure = tractions[:, 2]
    r = np.linalg.norm(x[:, :2], axis=1)
    counts = r < inner
    off = np.where(counts, np.abs(pressure - exact), np.nan) / scale
    (pair,) = states[-1].pairs
    scalars = {
        "pressure_error_median": np.nanmedian(off),
        "pressure_error_max": np.nanmax(off),
        **errors_beside("pressure_error", off, standard),
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
        "exact_pressure": exact / scale,
        "shear": tractions[:, 0] / scale,
        "status": pair.status,
        "edges": surface.edges,
    }
    numbers = {name: float(value) for name, value in scalars.items()}
    return Result(numbers, dimensionless(numbers), curves, dofs=solid.dofs)
