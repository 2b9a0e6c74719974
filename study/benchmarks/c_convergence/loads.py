"""Loads that belong to a manufactured solution, and errors against it."""

from dataclasses import dataclass

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import default_scalar_type, fem
from dolfinx.mesh import Mesh
from ufl.core.expr import Expr

from pw_elements import Body, assemble_vector, boundary_measure
from pw_elements.elasticity import StressState
from pw_elements.spaces import Marker
from study.solutions.manufactured import Field

Array = npt.NDArray[np.float64]

DEGREE = 6
"""Of quadrature of loads and errors, which are no polynomials: 8 changes no error by 0.2 %."""


@dataclass(frozen=True)
class ManufacturedSolution:
    """An exact displacement field on a body.

    Args:
        body: its mesh, material and state.
        field: the field's components.
    """

    body: Body
    field: Field

    @property
    def mesh(self) -> Mesh:
        """The body's mesh."""
        return self.body.spaces.mesh

    @property
    def displacement(self) -> Expr:
        """The exact displacement as a UFL expression."""
        compliance = fem.Constant(self.mesh, default_scalar_type(self._compliance()))
        return ufl.as_vector(self.field(ufl, ufl.SpatialCoordinate(self.mesh), compliance))

    def at_nodes(self, space: fem.FunctionSpace) -> Array:
        """Return exact displacements (nodes, components) at the nodes of a space."""
        x = space.tabulate_dof_coordinates().T
        return np.column_stack(self.field(np, x, self._compliance()))

    def load(self, boundary: Marker) -> PETSc.Vec:
        """Return the load vector of the body force and of the tractions on a boundary."""
        body = self.body
        loaded_body = Body(body.spaces, body.material, body.state, quadrature_degree=DEGREE)
        body_force = assemble_vector(loaded_body.body_load(-self._divergence_of_stress()))
        return body_force + self.traction_load(boundary)

    def traction_load(self, boundary: Marker) -> PETSc.Vec:
        """Return integrals of the exact traction times the element's own test functions."""
        axes = (
            [0, 1] if self.body.state is StressState.AXISYMMETRIC else range(len(self.displacement))
        )
        stress, normal = self.body.stress(self.displacement), ufl.FacetNormal(self.mesh)
        traction = ufl.as_vector([sum(stress[i, j] * normal[j] for j in axes) for i in axes])
        surface = boundary_measure(self.mesh, boundary, DEGREE)
        return assemble_vector(self.body.surface_load(traction, surface))

    def errors(self, u: fem.Function, gradient_of: fem.Function) -> dict[str, float]:
        """Return relative errors in the H1 seminorm, in L2, and in L2 of the stress.

        Args:
            u: computed displacement, from which the stress is computed, too.
            gradient_of: function whose gradient the H1 seminorm compares.
        """
        exact = self.displacement
        pairs = {
            "H1": (self._gradient(gradient_of), self._gradient(exact)),
            "L2": (u, exact),
            "stress": (self.body.stress(u), self.body.stress(exact)),
        }
        squares = []
        for computed_value, exact_value in pairs.values():
            difference = computed_value - exact_value
            squares += [ufl.inner(difference, difference), ufl.inner(exact_value, exact_value)]
        # all of them cell by cell at once: one form instead of six
        constants = fem.functionspace(self.mesh, ("DG", 0, (len(squares),)))
        dx = ufl.dx(domain=self.mesh, metadata={"quadrature_degree": DEGREE})
        form = ufl.inner(ufl.as_vector(squares), ufl.TestFunction(constants)) * self._depth() * dx
        sums = assemble_vector(form).array.reshape(-1, len(squares)).sum(axis=0)
        relative = np.sqrt(sums[::2] / sums[1::2])
        return dict(zip(pairs, relative.tolist(), strict=True))

    def _compliance(self) -> float:
        E, nu = self.body.material.youngs_modulus, self.body.material.poissons_ratio
        return float((1 + nu) * (1 - 2 * nu) / (E * nu))

    def _gradient(self, u: Expr) -> Expr:
        """Return the gradient; in axisymmetry 3 x 3 with the hoop component u_r / r."""
        grad = ufl.grad(u)
        if self.body.state is not StressState.AXISYMMETRIC:
            return grad
        hoop = u[0] / self._radius()
        return ufl.as_tensor(
            [[grad[0, 0], grad[0, 1], 0], [grad[1, 0], grad[1, 1], 0], [0, 0, hoop]]
        )

    def _divergence_of_stress(self) -> Expr:
        stress = self.body.stress(self.displacement)
        if self.body.state is not StressState.AXISYMMETRIC:
            return ufl.div(stress)
        r = self._radius()
        return ufl.as_vector(
            [
                stress[0, 0].dx(0) + stress[0, 1].dx(1) + (stress[0, 0] - stress[2, 2]) / r,
                stress[0, 1].dx(0) + stress[1, 1].dx(1) + stress[0, 1] / r,
            ]
        )

    def _depth(self) -> Expr | float:
        return 2 * np.pi * self._radius() if self.body.state is StressState.AXISYMMETRIC else 1.0

    def _radius(self) -> Expr:
        return ufl.SpatialCoordinate(self.mesh)[0]
