"""A seal at large strains: an O-ring of incompressible rubber squeezed between two plates.

Both plates are flat and smooth, so that a node in contact has a known displacement across them:
contact at large strains is a set of such nodes, which are let go where a plate would pull and
caught where they would pass. Nodal forces decide it, those of the residual.

Known is what Lindley found (Engineer 218 (1964) 765; P. K. Freakley, A. R. Payne, "Theory and
Practice of Engineering with Rubber" (1978)) for long cords of the diameter d and squeezes C d: the
force E d (1.25 C^1.5 + 50 C^6) over the length, on a width of some 2.4 C d.
"""

import gmsh
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from pw_elements import PetrovGalerkinProblem, assemble_scalar, assemble_vector
from pw_elements.spaces import SubSpace
from study.meshes.mesh_families import meshed
from study.model.discretisation import mesh_curves, spaces
from study.model.units import dimensionless
from study.run.store import Result

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

# Lengths over the cord's radius, stresses over the shear modulus
RING = 8.0  # mean radius
SQUEEZE, STEPS = 0.25, 10  # over the cord's diameter
DEGREE = 6
# Active sets that are tried in a step, and how often a node is caught in it: a node at the rim may
# be pulled where it is held and pass where it is not, and is let go then
_MOST, _CAUGHT = 30, 2


def seal(element: str, n: int) -> Result:
    """The ring on cells with sides of 1/n, squeezed by a quarter of its cord in ten steps."""
    ring = _Ring(element, n)
    steps = np.arange(1, STEPS + 1) * SQUEEZE / STEPS
    forces, tried, newton = [], [], []
    for squeeze in steps:
        sets, iterations = ring.press(1 - squeeze)
        force = ring.force()
        forces.append(-force[ring.upper, 1].sum())
        tried.append(sets)
        newton.append(iterations)
    force = ring.force()
    plates = force[ring.upper, 1].sum(), force[ring.lower, 1].sum()
    long = 2 * np.pi * RING * 2 * 3  # length times E d
    lindley = 1.25 * steps**1.5 + 50 * steps**6
    x, pressure = ring.pressure(force)
    order = np.argsort(x)
    middle = ring.is_middle[ring.upper][order]
    each = -force[ring.upper, 1][order]
    ratio = each / np.interp(x[order], x[order][~middle], each[~middle])
    x, pressure = x[order], pressure[order]
    scalars = {
        "force": forces[-1] / long,
        "force_lindley": float(lindley[-1]),
        "width": float(np.ptp(x)) / 2,
        "width_lindley": 2.4 * SQUEEZE,
        "balance": float(abs(plates[0] + plates[1]) / abs(plates[0])),
        "volume_error": ring.volume_error(),
        "sawtooth": float(np.median(ratio[2:-2][middle[2:-2]])),
        "penetration": float(ring.penetration),
        "peak": float(pressure.max()),
        "sets": float(max(tried)),
        "newton_iterations": float(sum(newton)),
    }
    curves = {
        "squeeze": steps,
        "force": np.array(forces) / long,
        "lindley": lindley,
        "x": x,
        "pressure": pressure,
        "nodal_force": each / each.mean(),
        "deformed": ring.x + ring.displacement,
        "body_pressure": ring.body_pressure,
        **mesh_curves(ring.space),
    }
    return Result(scalars, dimensionless(scalars), curves, dofs=len(ring.w.x.array))


class _Ring:
    """Spaces, unknowns and residual of the ring, and the nodes that its plates hold."""

    def __init__(self, element: str, n: int) -> None:
        mesh = meshed(_cord, 2, 1 / n, order=2)
        pair = spaces(element, mesh)
        self.space, self.w = pair.trial, fem.Function(pair.trial)
        self.field, self.fluid = SubSpace.displacements(self.space), SubSpace.pressure(self.space)
        self.x: Array = self.field.space.tabulate_dof_coordinates()[:, :2]
        self._outside: Mask = np.hypot(self.x[:, 0] - RING, self.x[:, 1]) > 1 - 1e-9
        corners = self.fluid.space.tabulate_dof_coordinates()[:, :2]
        apart = np.abs(self.x[:, None] - corners).max(axis=2).min(axis=1)
        self.is_middle: Mask = apart > 1e-9
        self.penetration = 0.0
        self.upper: Mask = np.zeros(len(self.x), dtype=bool)
        self.lower: Mask = self.upper
        r = ufl.SpatialCoordinate(mesh)[0]
        u, p = ufl.split(self.w)
        self._v, q = ufl.split(ufl.TestFunction(pair.test))
        self._around = 2 * np.pi * r
        rule = {"quadrature_degree": DEGREE}
        self._dx, self._ds = (of(domain=mesh, metadata=rule) for of in (ufl.dx, ufl.ds))
        self._F = ufl.Identity(3) + _gradient(u, r)
        self._J = ufl.det(self._F)
        inverse = ufl.inv(self._F).T
        stress = self._F - inverse - p * self._J * inverse
        residual = ufl.inner(stress, _gradient(self._v, r)) - q * (self._J - 1)
        self._conditions: list[fem.DirichletBC] = []
        self._problem = PetrovGalerkinProblem(
            residual * self._around * self._dx, self.w, self._conditions
        )

    @property
    def displacement(self) -> Array:
        """Of the nodes, (n, 2)."""
        return np.asarray(self.w.x.array[self.field.unknowns])

    @property
    def body_pressure(self) -> Array:
        """At the nodes (n,), linear between vertices."""
        p, everywhere = (
            fem.Function(self.fluid.space),
            fem.Function(fem.functionspace(self.space.mesh, ("Lagrange", 2))),
        )
        p.x.array[:] = self.w.x.array[self.fluid.unknowns[:, 0]]
        everywhere.interpolate(p)
        return np.asarray(everywhere.x.array)

    def force(self) -> Array:
        """Nodal forces (n, 2) of the plates on the ring."""
        return np.asarray(self._problem.reactions().array_r[self.field.unknowns])

    def press(self, height: float) -> tuple[int, int]:
        """Moves both plates to +- a height; numbers of active sets and of Newton's iterations."""
        iterations = 0
        y = self.x[:, 1] + self.displacement[:, 1]
        self.upper, self.lower = (
            held | (self._outside & (side * y > height))
            for held, side in ((self.upper, 1), (self.lower, -1))
        )
        caught = np.zeros(len(self.x), dtype=int)
        for tried in range(1, _MOST + 1):
            self._solve(height)
            iterations += sum(len(part.relative_corrections) for part in self._problem.increments)
            force, y = self.force()[:, 1], self.x[:, 1] + self.displacement[:, 1]
            passed = self._outside & (np.abs(y) > height)
            may = passed & (caught < _CAUGHT)
            upper, lower = (
                np.where(held, side * force < 0, may & (side * y > 0))
                for held, side in ((self.upper, 1), (self.lower, -1))
            )
            caught[(upper & ~self.upper) | (lower & ~self.lower)] += 1
            if np.array_equal(upper, self.upper) and np.array_equal(lower, self.lower):
                free = passed & ~upper & ~lower
                self.penetration = max(
                    self.penetration, (np.abs(y[free]) - height).max(initial=0.0)
                )
                return tried, iterations
            self.upper, self.lower = upper, lower
        raise RuntimeError(f"no active set in {_MOST}")

    def _solve(self, height: float) -> None:
        target = fem.Function(self.space)
        across = self.field.unknowns[:, 1]
        for held, side in ((self.upper, 1), (self.lower, -1)):
            target.x.array[across[held]] = side * height - self.x[held, 1]
        dofs = np.sort(across[self.upper | self.lower])
        self._conditions[:] = [fem.dirichletbc(target, dofs)]
        self._problem.solve()

    def pressure(self, force: Array) -> tuple[Array, Array]:
        """Radii (m,) of the upper plate's nodes, and forces over deformed areas of the weights."""
        normal = ufl.FacetNormal(self.space.mesh)
        outwards = ufl.as_vector([normal[0], normal[1], 0])
        stretched = ufl.sqrt(ufl.inner(*[self._J * ufl.inv(self._F).T * outwards] * 2))
        area = assemble_vector(stretched * self._v[1] * self._around * self._ds).array_r[
            self.field.unknowns[:, 1]
        ]
        x = self.x[:, 0] + self.displacement[:, 0]
        return x[self.upper], -force[self.upper, 1] / area[self.upper]

    def volume_error(self) -> float:
        """Of the whole ring, over its volume."""
        change = assemble_scalar((self._J - 1) * self._around * self._dx)
        return float(abs(change) / (2 * np.pi**2 * RING))


def _gradient(u: Expr, r: Expr) -> Expr:
    """In axisymmetry (3, 3)."""
    g = ufl.grad(u)
    return ufl.as_tensor([[g[0, 0], g[0, 1], 0], [g[1, 0], g[1, 1], 0], [0, 0, u[0] / r]])


def _cord() -> None:
    gmsh.model.occ.addDisk(RING, 0, 0, 1, 1)
