"""Elastic bodies in space with the elements of section V10, and contact pressures on their faces.

Two of the elements are derived from the standard one: “transferred” multiplies its nodal forces by
the force transfer matrix T, and the symmetric sibling has the stiffness T K T^T. The unknowns of
the sibling are coefficients rather than nodal displacements; its nodal forces are work-conjugate to
these coefficients, and contact conditions are formulated with the gaps that they define.
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
from study.model.discretisation import (
    collapsed_displacement_space,
    make_element_spaces,
    prescribe_node_displacements,
)
from study.model.reading import error_norms_on_common_and_other_nodes, multiply_nodal_weights_by_T
from study.model.units import assign_unit_one_to_scalars
from study.run.store import Result

Array = npt.NDArray[np.float64]

# Radius within which pressures are compared, over the contact radius
INNER_PART = 0.8


@dataclass(frozen=True)
class SolidBody:
    """Three-dimensional elastic body, discretised with one kind of element.

    Args:
        element: Name of the element.
        body: Element spaces and material.
        assembled_stiffness: Stiffness matrix assembled with the spaces, without supports.
        K: Stiffness matrix of the unknowns, without supports; differs for the sibling only.
        T: Force transfer matrix; for the element “transferred-T10” only, otherwise None.
        sibling: Symmetric sibling whose coefficients are the unknowns; for “sibling-T10” only.
    """

    element: str
    body: Body
    assembled_stiffness: PETSc.Mat
    K: PETSc.Mat
    T: PETSc.Mat | None = None
    sibling: Sibling | None = None

    @classmethod
    def from_mesh(cls, element: str, mesh: Mesh, material: Material) -> "SolidBody":
        """Create the body with the spaces and the assembled stiffness of an element on a mesh."""
        body = Body(make_element_spaces(element, mesh), material, StressState.SOLID)
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
        """Trial space of the unknowns: displacements and, in hybrid elements, pressures."""
        return self.body.spaces.trial

    @property
    def displacement_space(self) -> fem.FunctionSpace:
        """Trial space of the displacements without pressures."""
        return collapsed_displacement_space(self.space)

    @property
    def dofs(self) -> int:
        """Number of unknowns, including prescribed ones."""
        return int(self.K.getSize()[0])

    def surface_load(self, traction: VectorCoefficient, where: Marker) -> PETSc.Vec:
        """Assemble the load vector of a traction on the marked part of the boundary."""
        surface = boundary_measure(self.body.spaces.mesh, where)
        load = assemble_vector(self.body.surface_load(traction, surface))
        return load if self.sibling is None else self.sibling.load(load)

    def supports(self, conditions: list[fem.DirichletBC]) -> Reduction:
        """Return the reduction of the unknowns by prescribed displacements."""
        if self.sibling is not None:
            return self.sibling.dirichlet(conditions)
        return Reduction.dirichlet(self.space, conditions)

    def prescribe_displacements_on_faces(
        self, where: Marker, displacement: Callable[[Array], Array]
    ) -> list[fem.DirichletBC]:
        """Return the condition that prescribes displacements of the nodes on marked faces.

        Args:
            where: Marker of the faces.
            displacement: Function of points (n, 3) that returns displacements (n, 3).
        """
        x = self.displacement_space.tabulate_dof_coordinates()
        nodes = fem.locate_dofs_geometrical(self.displacement_space, where)
        return [prescribe_node_displacements(self.space, nodes, displacement(x[nodes]))]

    def load_equivalent_to_prescribed_faces(
        self, where: Marker, displacement: Callable[[Array], Array]
    ) -> PETSc.Vec:
        """Return the load -K u of prescribed displacements u of faces.

        Added to the other loads, it allows the supports to fix these faces at zero displacement.

        Args:
            where: Marker of the faces.
            displacement: Function of points (n, 3) that returns displacements (n, 3).
        """
        moved = self.supports(self.prescribe_displacements_on_faces(where, displacement)).offset
        load = self.K * moved
        load.scale(-1.0)
        return load

    def nodal_forces(self, state: ContactState, load: PETSc.Vec, where: Marker) -> Array:
        """Return the nodal contact forces (m, 3) of a state, in the order of `SurfaceNodes`.

        Args:
            state: Contact state.
            load: Load vector of the state, without contact forces.
            where: Marker of the contact surface.
        """
        if self.T is None:
            (pair,) = state.pairs
            return np.asarray(pair.force_normal[:, None] * pair.normal + pair.force_tangential)
        forces = self.T * reactions(self.assembled_stiffness, state.displacement, load)
        nodes = fem.locate_dofs_geometrical(self.space, where)
        order = order_by_position(self.space.tabulate_dof_coordinates()[nodes])
        return np.asarray(forces.array_r.reshape(-1, 3)[nodes[order]])

    def surface_nodes_with_own_and_standard_weights(
        self, where: Marker
    ) -> tuple[SurfaceNodes, SurfaceNodes]:
        """Return the surface nodes with the weights of the element and of the standard element.

        Weights are the integrals of the test functions over the surface.
        """
        own = SurfaceNodes.from_body(self.body, where)
        make_element_spaces, T = self.body.spaces, self.T
        if make_element_spaces.test is not make_element_spaces.trial:
            galerkin = replace(self.body, spaces=Spaces.galerkin(make_element_spaces.mesh))
            return own, SurfaceNodes.from_body(galerkin, where)
        if self.sibling is not None:
            T = force_transfer(self.space)
        return own if T is None else multiply_nodal_weights_by_T(own, T), own


def error_norms_at_standard_and_other_nodes(
    name: str, error: Array, standard_nodes: SurfaceNodes
) -> dict[str, float]:
    """Return norms of errors at nodes where the standard element has a pressure, and elsewhere.

    Args:
        name: Prefix of the names of the norms.
        error: Errors (m,), NaN where the element has no pressure.
        standard_nodes: The same nodes with the standard element's weights.
    """
    norms = error_norms_on_common_and_other_nodes(
        error, standard_nodes.pressure(np.zeros(len(error)))
    )
    return {f"{name}_{suffix}": norm for suffix, norm in norms.items()}


def evaluate_pressure_errors_on_face(
    states: list[ContactState],
    solid: SolidBody,
    own_and_standard_nodes: tuple[SurfaceNodes, SurfaceNodes],
    forces: Array,
    exact: Array,
    reference_pressure: float,
    inner_radius: float,
    **extra_scalars: float,
) -> Result:
    """Return the errors of the contact pressure at the nodes of a horizontal face, and its curves.

    Nodes whose test function has integral zero have no pressure and are omitted from the errors.

    Args:
        states: Contact states at the ends of all increments.
        solid: Body in contact.
        own_and_standard_nodes: Surface nodes of the face from
            `Solid.surface_nodes_with_own_and_standard_weights`.
        forces: Nodal contact forces (m, 3); the last component is normal to the face.
        exact: Exact pressure (m,) at the nodes.
        reference_pressure: Pressure by which errors and curves are divided.
        inner_radius: Distance from the origin within which errors are evaluated.
        extra_scalars: Further scalars to store with the result.
    """
    surface, standard = own_and_standard_nodes
    x, tractions = surface.position, surface.pressure(forces)
    pressure = tractions[:, 2]
    r = np.linalg.norm(x[:, :2], axis=1)
    is_inner = r < inner_radius
    error = np.where(is_inner, np.abs(pressure - exact), np.nan) / reference_pressure
    (pair,) = states[-1].pairs
    scalars = {
        "pressure_error_median": np.nanmedian(error),
        "pressure_error_max": np.nanmax(error),
        **error_norms_at_standard_and_other_nodes("pressure_error", error, standard),
        "weightless_nodes": np.isnan(pressure[is_inner]).sum(),
        "nodes": is_inner.sum(),
        "iterations": sum(state.iterations for state in states),
        "krylov_iterations": sum(state.report.krylov_iterations for state in states),
        "residual": max(state.residuals.largest() for state in states),
        **extra_scalars,
    }
    curves = {
        "x": x,
        "pressure": pressure / reference_pressure,
        "exact_pressure": exact / reference_pressure,
        "shear": tractions[:, 0] / reference_pressure,
        "status": pair.status,
        "edges": surface.edges,
    }
    numbers = {name: float(value) for name, value in scalars.items()}
    return Result(numbers, assign_unit_one_to_scalars(numbers), curves, dofs=solid.dofs)
