"""Bodies in space on the elements of section V10, and contact pressures on their faces.

Two of the elements are derived from the standard one: “transferred” multiplies its nodal forces by
T, and the symmetric sibling has the stiffness T K T^T. The sibling's unknowns are coefficients
rather than nodal displacements; nodal forces are work-conjugate to them, and contact conditions are
stated for the gaps that they define.
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
from study.model.discretisation import displacement_space, prescribe_nodes, spaces
from study.model.reading import error_norms_on_common_and_other_nodes, with_transferred_weights
from study.model.units import dimensionless
from study.run.store import Result

Array = npt.NDArray[np.float64]

# Radius within which pressures are compared, over the contact radius
INNER_PART = 0.8


@dataclass(frozen=True)
class Solid:
    """Elastic body in space on one of the elements.

    Args:
        element: Name of the element.
        body: Spaces and material.
        assembled_stiffness: Stiffness assembled from the spaces, without supports.
        K: Stiffness of the unknowns that are solved for, without supports.
        T: Transfer of nodal forces, for the element “transferred-T10” only.
        sibling: Sibling whose coefficients are the unknowns, for “sibling-T10” only.
    """

    element: str
    body: Body
    assembled_stiffness: PETSc.Mat
    K: PETSc.Mat
    T: PETSc.Mat | None = None
    sibling: Sibling | None = None

    @classmethod
    def from_mesh(cls, element: str, mesh: Mesh, material: Material) -> "Solid":
        """Assemble the stiffness of an element on a mesh."""
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
    def displacement_space(self) -> fem.FunctionSpace:
        """Space of the displacements alone."""
        return displacement_space(self.space)

    @property
    def dofs(self) -> int:
        """Number of unknowns, including prescribed ones."""
        return int(self.K.getSize()[0])

    def surface_load(self, traction: VectorCoefficient, where: Marker) -> PETSc.Vec:
        """Return the load vector of a traction on the marked part of the boundary."""
        surface = boundary_measure(self.body.spaces.mesh, where)
        load = assemble_vector(self.body.surface_load(traction, surface))
        return load if self.sibling is None else self.sibling.load(load)

    def supports(self, conditions: list[fem.DirichletBC]) -> Reduction:
        """Return the reduction by prescribed displacements."""
        if self.sibling is not None:
            return self.sibling.dirichlet(conditions)
        return Reduction.dirichlet(self.space, conditions)

    def prescribe_faces(
        self, where: Marker, displacement: Callable[[Array], Array]
    ) -> list[fem.DirichletBC]:
        """Prescribe displacements (n, 3), a function of points (n, 3), on marked faces."""
        x = self.displacement_space.tabulate_dof_coordinates()
        nodes = fem.locate_dofs_geometrical(self.displacement_space, where)
        return [prescribe_nodes(self.space, nodes, displacement(x[nodes]))]

    def load_of_prescribed_faces(
        self, where: Marker, displacement: Callable[[Array], Array]
    ) -> PETSc.Vec:
        """Return the load that replaces displacements of faces, which supports then fix at 0."""
        moved = self.supports(self.prescribe_faces(where, displacement)).offset
        load = self.K * moved
        load.scale(-1.0)
        return load

    def nodal_forces(self, state: ContactState, load: PETSc.Vec, where: Marker) -> Array:
        """Return the contact forces (m, 3) of a state, in the order of `SurfaceNodes`."""
        if self.T is None:
            (pair,) = state.pairs
            return np.asarray(pair.force_normal[:, None] * pair.normal + pair.force_tangential)
        forces = self.T * reactions(self.assembled_stiffness, state.displacement, load)
        nodes = fem.locate_dofs_geometrical(self.space, where)
        order = order_by_position(self.space.tabulate_dof_coordinates()[nodes])
        return np.asarray(forces.array_r.reshape(-1, 3)[nodes[order]])

    def own_and_standard_nodes(self, where: Marker) -> tuple[SurfaceNodes, SurfaceNodes]:
        """Return surface nodes with the element's weights, and with the standard element's ones."""
        own = SurfaceNodes.from_body(self.body, where)
        spaces, T = self.body.spaces, self.T
        if spaces.test is not spaces.trial:
            galerkin = replace(self.body, spaces=Spaces.galerkin(spaces.mesh))
            return own, SurfaceNodes.from_body(galerkin, where)
        if self.sibling is not None:
            T = force_transfer(self.space)
        return own if T is None else with_transferred_weights(own, T), own


def error_norms_beside_standard(
    name: str, error: Array, standard: SurfaceNodes
) -> dict[str, float]:
    """Return norms of errors (m,) at nodes with a standard pressure, and at the other nodes."""
    norms = error_norms_on_common_and_other_nodes(error, standard.pressure(np.zeros(len(error))))
    return {f"{name}_{suffix}": norm for suffix, norm in norms.items()}


def face_result(
    states: list[ContactState],
    solid: Solid,
    own_and_standard: tuple[SurfaceNodes, SurfaceNodes],
    forces: Array,
    exact: Array,
    scale: float,
    inner_radius: float,
    **extra_scalars: float,
) -> Result:
    """Return errors of the pressure on a horizontal face at nodes with a weight, and curves.

    Args:
        states: States at the ends of all increments.
        solid: Body.
        own_and_standard: `Solid.own_and_standard_nodes` of the face.
        forces: Forces (m, 3) at the face's nodes; the last component is normal, the first is shear.
        exact: Exact pressure (m,).
        scale: Pressure by which errors and curves are divided.
        inner_radius: Distance from the origin within which errors count.
        extra_scalars: Further scalars to store.
    """
    surface, standard = own_and_standard
    x, tractions = surface.position, surface.pressure(forces)
    pressure = tractions[:, 2]
    r = np.linalg.norm(x[:, :2], axis=1)
    is_inner = r < inner_radius
    error = np.where(is_inner, np.abs(pressure - exact), np.nan) / scale
    (pair,) = states[-1].pairs
    scalars = {
        "pressure_error_median": np.nanmedian(error),
        "pressure_error_max": np.nanmax(error),
        **error_norms_beside_standard("pressure_error", error, standard),
        "weightless_nodes": np.isnan(pressure[is_inner]).sum(),
        "nodes": is_inner.sum(),
        "iterations": sum(state.iterations for state in states),
        "krylov_iterations": sum(state.report.krylov_iterations for state in states),
        "residual": max(state.residuals.largest() for state in states),
        **extra_scalars,
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
