"""Manufactured solutions: smooth displacement fields, and the loads that go with them by UFL."""

from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import Any, TypeAlias

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

Array = npt.NDArray[np.float64]
Terms: TypeAlias = Any  # of numpy or of UFL
# Components of a displacement at x, with the functions of numpy or UFL. The compliance is one
# over Lamé's first constant: what is multiplied by it leaves a bounded pressure as nu goes to 1/2.
Field = Callable[[ModuleType, Terms, Terms], tuple[Terms, ...]]

# Of loads and errors, which are no polynomials; two degrees more change no error by 0.2 %
DEGREE = 6


def plane(m: ModuleType, x: Terms, compliance: Terms) -> tuple[Terms, ...]:
    """A plane field without dilatation, and `plane_pressure`."""
    p = plane_pressure(m, x, compliance)
    return (
        1.5 * m.sin(2 * x[0]) * m.cos(1.5 * x[1]) + p[0],
        -2 * m.cos(2 * x[0]) * m.sin(1.5 * x[1]) + p[1],
    )


def plane_pressure(m: ModuleType, x: Terms, compliance: Terms) -> tuple[Terms, ...]:
    """A field whose stress is a pressure alone as nu goes to 1/2: the body force balances it."""
    return compliance * m.sin(x[0] + x[1]), compliance * m.cos(x[0] - 2 * x[1])


def round_about(m: ModuleType, x: Terms, compliance: Terms) -> tuple[Terms, ...]:
    """An axisymmetric field without dilatation, and `round_about_pressure`."""
    r, z = x[0], x[1]
    p = round_about_pressure(m, x, compliance)
    return (
        r * (1 - r**2 / 3) * m.cos(z) + p[0],
        (4 / 3 * r**2 - 2) * m.sin(z) + p[1],
    )


def round_about_pressure(m: ModuleType, x: Terms, compliance: Terms) -> tuple[Terms, ...]:
    """As `plane_pressure`; radial component odd in r, axial one even."""
    r, z = x[0], x[1]
    return (
        compliance * m.sin(1.2 * r) * m.cos(z + 0.3),
        compliance * m.cos(1.5 * r) * m.sin(1.1 * z),
    )


def solid(m: ModuleType, x: Terms, compliance: Terms) -> tuple[Terms, ...]:
    """A field in space without dilatation, and `solid_pressure`."""
    p = solid_pressure(m, x, compliance)
    return (
        m.sin(x[1] + 2 * x[2]) + p[0],
        m.cos(1.5 * x[0] - x[2]) + p[1],
        m.sin(x[0] + x[1]) + p[2],
    )


def solid_pressure(m: ModuleType, x: Terms, compliance: Terms) -> tuple[Terms, ...]:
    """As `plane_pressure`."""
    return (
        compliance * m.sin(x[0] + x[1]),
        compliance * m.cos(x[1] - 2 * x[2]),
        compliance * m.sin(x[0] + 1.3 * x[2]),
    )


@dataclass(frozen=True)
class Manufactured:
    """A known displacement field on a body.

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
        """Its values (nodes, components) at the nodes of a space."""
        x = space.tabulate_dof_coordinates().T
        return np.column_stack(self.field(np, x, self._compliance()))

    def load(self, rim: Marker) -> PETSc.Vec:
        """Load vector of the body force and of the tractions on the whole boundary."""
        force = assemble_vector(self._loaded_body().body_load(-self._divergence()))
        return force + self.traction_load(rim)

    def traction_load(self, where: Marker) -> PETSc.Vec:
        """Exact integrals of the traction times the element's own test functions."""
        plane = (
            [0, 1] if self.body.state is StressState.AXISYMMETRIC else range(len(self.displacement))
        )
        stress, normal = self.body.stress(self.displacement), ufl.FacetNormal(self.mesh)
        traction = ufl.as_vector([sum(stress[i, j] * normal[j] for j in plane) for i in plane])
        surface = boundary_measure(self.mesh, where, DEGREE)
        return assemble_vector(self.body.surface_load(traction, surface))

    def errors(self, u: fem.Function, gradient_of: fem.Function) -> dict[str, float]:
        """Relative errors of a displacement: H1 seminorm, L2, and L2 of its stress.

        Args:
            u: the displacement, from which the stress is, too.
            gradient_of: what the H1 seminorm is taken of.
        """
        exact = self.displacement
        pairs = {
            "H1": (self._gradient(gradient_of), self._gradient(exact)),
            "L2": (u, exact),
            "stress": (self.body.stress(u), self.body.stress(exact)),
        }
        squares = []
        for computed, known in pairs.values():
            difference = computed - known
            squares += [ufl.inner(difference, difference), ufl.inner(known, known)]
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

    def _loaded_body(self) -> Body:
        body = self.body
        return Body(body.spaces, body.material, body.state, quadrature_degree=DEGREE)

    def _gradient(self, u: Expr) -> Expr:
        """Gradient; in axisymmetry 3 x 3 with the hoop component u_r / r."""
        grad = ufl.grad(u)
        if self.body.state is not StressState.AXISYMMETRIC:
            return grad
        hoop = u[0] / self._radius()
        return ufl.as_tensor(
            [[grad[0, 0], grad[0, 1], 0], [grad[1, 0], grad[1, 1], 0], [0, 0, hoop]]
        )

    def _divergence(self) -> Expr:
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
