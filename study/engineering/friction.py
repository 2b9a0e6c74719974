"""Partial slip where friction falls with the pressure of each node: mu(p) = mu0 / (1 + p / p1).

A rigid parabola (in space a paraboloid) is pressed on an elastic half plane to its exact depth,
without friction, and then moved along with it. The far sides keep Hertz' exact displacements.
Lengths are over the half width of the contact, stresses over E.
"""

from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx.mesh import Mesh

from pw_elements import Body, Material, Reduction, SurfaceNodes, assemble_matrix, prescribe
from pw_elements.contact import STICK, ContactPair, ContactProblem, Coulomb, Motion, Parabola
from pw_elements.contact.model import Friction, PairState
from pw_elements.elasticity import StressState
from study.engineering.readings import reading as read_by
from study.meshes import mesh_lines
from study.meshes.line_mesh import on_lines
from study.meshes.mesh_lines import PLACE
from study.meshes.solid_meshes import box, cell_of
from study.model.discretisation import held_nodes, spaces
from study.rivals.problem import NU, OUTER, RADIUS, ZONE, E
from study.solutions.half_space import Elastic, HertzLine, HertzSphere
from study.solutions.half_space_shear import hertz_force
from study.solutions.indentation import growing

Array = npt.NDArray[Any]
Mask = npt.NDArray[np.bool_]

STEEPEST, HALVING = 0.6, 0.5  # mu0; p1 over Hertz' peak
SHIFT = {1: 0.3, 2: 0.1}  # in the plane and in space, over the approach
OUTERMOST = 0.6  # from this part of the sticking zone on its end is extrapolated
CLOSE, MOST = 1e-6, 30  # of coefficients by projected pressures; repetitions


@dataclass(frozen=True)
class Falling:
    """The library's law of friction |r_t| <= mu0 r / (1 + r / (p1 A)) of nodes of areas A.

    Args:
        position: (m, dim) of nodes.
        most: (m,), p1 A; a node without area has no friction.
    """

    position: Array
    most: Array

    def parameter_at(self, x: Array) -> Array:
        """p1 A (n,) of nodes at columns (3, n)."""
        return _given(self.position, self.most, x)

    def limit(self, parameter: Array, force: Array) -> tuple[Array, Array]:
        """Largest tangential forces (n,), and their slopes."""
        share = parameter / np.where(parameter + force > 0, parameter + force, 1.0)
        return STEEPEST * share * force, STEEPEST * share**2


class Slip(NamedTuple):
    """Results of partial slip.

    Args:
        force: tangential, over mu0 times the pressing force.
        stick: half width or radius of what sticks.
        dofs: unknowns.
        x, pressure, shear: of nodes of the surface; the latter over the peak pressure.
    """

    force: float
    stick: float
    dofs: int
    x: Array
    pressure: Array
    shear: Array


def slipping(element: str, reading: str, edges: int, halving: float = HALVING) -> Slip:
    """The state after both increments.

    Args:
        element: name.
        reading: of the pressure that the law has: "own" or "tributary" areas, at nodes, "skip"
            (no friction where own weights vanish), or "projected", by coefficients that are
            repeated until they do not change.
        edges: over the half width of the contact.
        halving: pressure at which the coefficient has halved, over Hertz' peak.
    """
    solid = element.endswith("T10")
    mesh, zone, outer = _solid(edges) if solid else _plane(edges)
    up = mesh.geometry.dim - 1
    elastic = Elastic(E, NU)
    known = (
        HertzSphere(elastic, RADIUS, hertz_force(elastic, RADIUS))
        if solid
        else HertzLine(elastic, RADIUS, np.pi * elastic.plane_modulus / (4 * RADIUS))
    )
    state = StressState.SOLID if solid else StressState.PLANE_STRAIN
    body = Body(spaces(element, mesh), Material(E, NU), state)
    K, space = assemble_matrix(body.stiffness()), body.spaces.trial

    def touching(x: Array) -> Mask:
        return np.asarray(np.isclose(x[up], 0) & (np.abs(x[:up]).max(axis=0) < zone + 1e-9))

    def far(x: Array) -> Mask:
        return np.isclose(np.abs(x[: up + 1]).max(axis=0), outer)

    x = space.tabulate_dof_coordinates()
    nodes = np.flatnonzero(far(x.T)).astype(np.int32)
    conditions = [held_nodes(space, nodes, _field(known, x[nodes], up))]
    if solid:
        conditions.append(prescribe(space, 1, lambda p: np.isclose(p[1], 0.0) & ~far(p)))
    surface = SurfaceNodes.from_body(body, touching)
    origin, down = (0.0,) * up, -known.approach
    aside = (SHIFT[up] * known.approach, *origin[1:], down)
    p1 = halving * known.peak
    pair = ContactPair(touching, Parabola((*origin, 0.0), RADIUS), 0.0)
    held, nothing = Reduction.dirichlet(space, conditions), K.createVecLeft()

    smooth = ContactProblem(K, held, pair, space)
    pressed = smooth.step(smooth.undeformed, nothing, Motion((*origin, down)))

    def solved(friction: Friction) -> PairState:
        rough = ContactProblem(K, held, replace(pair, friction=friction), space)
        return rough.step(pressed, nothing, Motion(aside)).pairs[0]

    read = read_by(reading, surface)
    if reading == "projected":
        mu: Array = np.full(len(read), STEEPEST)
        for _ in range(MOST):
            found = solved(Coulomb(partial(_given, surface.position, mu)))
            pressure = np.maximum(0.0, read @ found.force_normal)
            before, mu = mu, STEEPEST / (1 + pressure / p1)
            if np.abs(mu - before).max() < CLOSE:
                break
        limit = mu * found.force_normal
    else:
        area = surface.tributary_area if reading == "tributary" else surface.weight_area
        law = Falling(surface.position, p1 * np.maximum(area, 0.0) * (area > 1e-9 * area.max()))
        found = solved(law)
        limit = law.limit(law.most, found.force_normal)[0]
    along = found.force_tangential
    left = read @ (limit - np.linalg.norm(along, axis=1))
    return Slip(
        float(along[:, 0].sum() / (STEEPEST * found.force_normal.sum())),
        _sticking(surface.position[:, :up], left, found.status == STICK),
        K.getSize()[0],
        surface.position,
        read @ found.force_normal / known.peak,
        read @ along[:, 0] / known.peak,
    )


def _sticking(x: Array, left: Array, sticks: Mask) -> float:
    """Half the width, or the radius, of what sticks, beyond its outermost nodes.

    The square of what is `left` of friction vanishes there as the distance does (see V10): a
    straight line through the outer nodes that stick is extrapolated, in the plane on each side.
    """
    r = np.linalg.norm(x, axis=1)
    sides = [x[:, 0] > 0, x[:, 0] < 0] if x.shape[1] == 1 else [r > 0]
    ends = []
    for side in sides:
        of = sticks & side
        of &= r > OUTERMOST * r[of].max()
        slope, start = np.polyfit(r[of] ** 2, left[of] ** 2, 1)
        ends.append(np.sqrt(start / -slope))
    return float(np.mean(ends))


def _given(position: Array, values: Array, x: Array) -> Array:
    """Values (m,) of nodes, of those at columns (3, n)."""
    dim = position.shape[1]
    distance = np.linalg.norm(x[:dim].T[:, None] - position, axis=2)
    return np.asarray(values[distance.argmin(axis=1)])


def _plane(edges: int) -> tuple[Mesh, float, float]:
    """The plane's mesh, where nodes may touch, and how far it goes."""
    size = 1 / (edges + PLACE)
    near = size * np.arange(np.ceil(ZONE / size) + 1)
    right = np.concatenate([near, near[-1] + growing(size, OUTER - near[-1])[1:]])
    along = np.concatenate([-right[:0:-1], right])
    below = -growing(size, OUTER)[::-1]
    return on_lines(MPI.COMM_SELF, along, below, "triangle"), float(near[-1]), OUTER


def _solid(edges: int) -> tuple[Mesh, float, float]:
    """One half, y >= 0."""
    lines = mesh_lines.graded(edges)
    along = np.concatenate([-lines.beside[:0:-1], lines.beside])
    mesh = box(cell_of("T10"), along, lines.beside, lines.below)
    return mesh, lines.zone, mesh_lines.OUTER


def _field(known: HertzLine | HertzSphere, x: Array, up: int) -> Array:
    """Exact displacements (n, dim) of points (n, 3) far from the contact."""
    if up == 1:
        right = known.displacement(np.column_stack([np.abs(x[:, 0]), x[:, 1]]))
        return right * np.column_stack([np.sign(x[:, 0]), np.ones(len(x))])
    r = np.hypot(x[:, 0], x[:, 1])
    of_r = known.displacement(np.column_stack([r, x[:, 2]]))
    return np.column_stack([of_r[:, :1] * x[:, :2] / np.maximum(r, 1e-12)[:, None], of_r[:, 1]])
