"""Three problems whose law of contact has nodal forces or pressures: wear, friction, impact.

1. `wear_punch`: an elastic punch on a rigid plate that slides across its plane wears by Archard's
   law.
2. `solve_partial_slip`: friction whose coefficient falls with the pressure of each node.
3. `throw_block`: explicit impact of a block that is thrown askew on a rough rigid dome.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.mesh import Mesh

from pw_elements import (
    Body,
    Material,
    Reduction,
    Spaces,
    SurfaceNodes,
    assemble_matrix,
    assemble_vector,
    boundary_measure,
    lumped_mass,
    prescribe,
)
from pw_elements.contact import (
    STICK,
    ContactPair,
    ContactProblem,
    Coulomb,
    Motion,
    Parabola,
    solve_impact,
)
from pw_elements.contact.model import Friction, PairState
from pw_elements.elasticity import StressState
from study.benchmarks.v12_impact.schemes import (
    MATERIAL,
    STRESS_STATE_BY_DIMENSION,
    StiffnessMassPair,
)
from study.benchmarks.w_engineering.pressures import pressure_matrix
from study.meshes import mesh_lines
from study.meshes.line_mesh import mesh_along_lines
from study.meshes.solid_meshes import mesh_box
from study.model.discretisation import prescribe_nodes, spaces
from study.solutions.half_space import ElasticHalfSpace, HertzLine, HertzSphere
from study.solutions.half_space_shear import force_of_unit_hertz_contact
from study.solutions.hertz_problem import BODY_SIZE, CONTACT_ZONE_SIZE, NU, RADIUS, E, use_lu
from study.solutions.indentation import growing_lines_from_size

Array = npt.NDArray[Any]
Mask = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.int64]

# Elements


def is_plane(element: str) -> bool:
    """Return whether an element's cells are plane."""
    return element.endswith(("T6", "Q9"))


def cell_of(element: str) -> str:
    """Return the cell of an element by its name."""
    cells = {"T6": "triangle", "Q9": "quadrilateral", "T10": "tetrahedron", "H27": "hexahedron"}
    return cells[element.split("-")[1]]


def make_spaces(element: str, mesh: Mesh) -> Spaces:
    """Return the spaces of an element; those of "galerkin-Q9" are for references."""
    return Spaces.galerkin(mesh) if element == "galerkin-Q9" else spaces(element, mesh)


# Wear. Lengths are over the punch's height, stresses over the mean pressure

PUNCH_MODULUS, PUNCH_POISSONS_RATIO, MEAN_PRESSURE = 100.0, 0.3, 1.0
PATH = 0.06
"""k s with the wear k per pressure and path, and the path s: the mean depth at the end."""
LOADED_WIDTH = 0.5
"""Half width of the part of the back that is loaded."""
N_FREE_CHANGES, MAX_CHANGES = 10, 2000
"""Changes of the set of touching nodes: with all nodes at once, and the most in all."""
ROUND_OFF = 1e-12
"""Of nodal forces, relative to the whole force, and of gaps."""


@dataclass(frozen=True)
class Punch:
    """The punch on one element, condensed to the normal displacements of its face's nodes.

    It is a block 2 wide (in space 2 x 2) and 1 high, on whose back an even load acts in the middle.

    Args:
        surface: the face, m nodes.
        flexibility: (m, m), displacements by nodal forces, but for a translation.
        load_displacement: (m,), displacements by the load, but for a translation.
        force: on the half or quarter that is modelled.
        dofs: unknowns.
    """

    surface: SurfaceNodes
    flexibility: Array
    load_displacement: Array
    force: float
    dofs: int

    @classmethod
    def make(cls, element: str, cells: int, offset: float = 0.0) -> "Punch":
        """Make one half, or in space a quarter, with `cells` along its height and half width.

        Args:
            element: its name.
            cells: number of them.
            offset: how far mesh lines across the face are moved, over the size of a cell; half of
                it at most. The load's edge stays on a line.
        """
        lines: npt.NDArray[np.float64] = np.linspace(0.0, 1.0, cells + 1, dtype=np.float64)
        beside = lines + offset / 2 / cells * np.sin(2 * np.pi * lines)
        if is_plane(element):
            mesh, state = (
                mesh_along_lines(MPI.COMM_SELF, beside, lines, cell_of(element)),
                "plane strain",
            )
        else:
            mesh, state = mesh_box(cell_of(element), beside, beside, lines), "solid"
        up = mesh.geometry.dim - 1
        material = Material(PUNCH_MODULUS, PUNCH_POISSONS_RATIO)
        body = Body(make_spaces(element, mesh), material, StressState(state))
        K, space = assemble_matrix(body.stiffness()), body.spaces.trial

        def is_loaded(x: Array) -> Mask:
            is_in_middle = np.max(x[:up], axis=0) < LOADED_WIDTH + 1e-9
            return np.asarray(np.isclose(x[up], 1.0) & is_in_middle)

        def is_top(x: Array) -> Mask:  # one node: held against a translation, it has no reaction
            return np.asarray(np.isclose(x, np.eye(3)[up][:, None]).all(axis=0))

        def is_on_face(x: Array) -> Mask:
            return np.isclose(x[up], 0.0)

        traction = -MEAN_PRESSURE * np.eye(up + 1)[up] / LOADED_WIDTH**up
        back = boundary_measure(mesh, is_loaded)
        load = assemble_vector(body.surface_load(traction, back)).array
        supports = [prescribe(space, i, _symmetry_plane(i)) for i in range(up)]
        supports.append(prescribe(space, up, is_top))
        supported_dofs = [dof for support in supports for dof in support.dof_indices()[0]]
        free_dofs = np.setdiff1d(np.arange(len(load)), supported_dofs)
        surface = SurfaceNodes.from_body(body, is_on_face)
        rows = np.searchsorted(free_dofs, (up + 1) * surface.node + up)
        unit_forces_and_load = np.zeros((len(free_dofs), len(rows) + 1))
        unit_forces_and_load[rows, np.arange(len(rows))] = 1.0
        unit_forces_and_load[:, -1] = load[free_dofs]
        displacement = _solve_free(K, free_dofs, unit_forces_and_load)[rows]
        force = float(-load[up :: up + 1].sum())
        return cls(surface, displacement[:, :-1], displacement[:, -1], force, len(load))

    def forces(self, depth: Array, touching: Mask) -> tuple[Array, Mask]:
        """Return nodal forces (m,) on a face that is worn to depths (m,), and which nodes touch.

        All nodes that violate the law change; if that goes in circles, the first of them alone,
        which ends for every stiffness whose principal minors are positive (K. G. Murty, 1974).

        Raises:
            RuntimeError: if the set of touching nodes still changes after `MAX_CHANGES` changes.
        """
        n_nodes = len(depth)
        unloaded_gap = depth + self.load_displacement
        for n_changes in range(MAX_CHANGES):
            nodes = np.flatnonzero(touching)
            right = np.append(-unloaded_gap[nodes], self.force)
            solution = np.linalg.solve(self._system(nodes), right)
            force = np.zeros(n_nodes)
            force[nodes] = solution[:-1]
            gap = unloaded_gap + self.flexibility @ force + solution[-1]
            should_touch = np.where(touching, force >= -ROUND_OFF * self.force, gap < -ROUND_OFF)
            violating = np.flatnonzero(should_touch != touching)
            if not len(violating):
                return force, touching
            if n_changes > N_FREE_CHANGES:
                violating = violating[:1]
            touching = touching.copy()
            touching[violating] = ~touching[violating]
        raise RuntimeError(f"the touching nodes still change after {MAX_CHANGES} changes")

    def stiffness(self) -> Array:
        """Return the change of forces (m, m) by depths, sign reversed, while all nodes touch."""
        m = len(self.load_displacement)
        return np.asarray(np.linalg.inv(self._system(np.arange(m)))[:m, :m])

    def _system(self, nodes: Indices) -> Array:
        """Return the matrix of touching nodes, moved by forces and a translation, and balance."""
        border = np.ones((len(nodes), 1))
        flexibility = self.flexibility[np.ix_(nodes, nodes)]
        return np.block([[flexibility, border], [border.T, np.zeros((1, 1))]])


def _symmetry_plane(axis: int) -> Callable[[Array], Mask]:
    return lambda x: np.isclose(x[axis], 0.0)


def _solve_free(K: PETSc.Mat, free_dofs: Indices, right: Array) -> Array:
    """Return solutions (n, k) by MUMPS of the free rows and columns."""
    rows = PETSc.IS().createGeneral(free_dofs.astype(PETSc.IntType))
    ksp = PETSc.KSP().create(K.comm)
    ksp.setOperators(K.createSubMatrix(rows, rows))
    use_lu(ksp)
    ksp.setUp()
    B = PETSc.Mat().createDense(right.shape, array=right)
    B.assemble()
    X = B.duplicate()
    ksp.pc.getFactorMatrix().matSolve(B, X)
    return np.array(X.getDenseArray())


class WearResult(NamedTuple):
    """The worn punch.

    Args:
        punch: the punch before wear.
        half_depth: depths (m,) at half of the path.
        depth: depths at the end.
        pressure: pressures at the end, by the reading of the law.
        step_over_bound: the step over the largest that is stable.
        volume_error: of the worn volume by the reading's own weights, over k x force x path.
        end_error: largest distance of pressures at the end from the mean one, by own weights or,
            where these vanish, projected.
    """

    punch: Punch
    half_depth: Array
    depth: Array
    pressure: Array
    step_over_bound: float
    volume_error: float
    end_error: float


def wear_punch(
    element: str, reading: str, cells: int, n_steps: int, offset: float = 0.0
) -> WearResult:
    """Wear the face, at its nodes, by equal explicit steps of the path.

    A step of the path is stable while k ds times the largest eigenvalue of R S is below 2, where R
    reads pressures and S is the change of forces with depths while all of the face touches. Wear
    goes on until pressures are even, so that the end is known.

    Raises:
        ValueError: if a step is not stable.
    """
    punch = Punch.make(element, cells, offset)
    R = pressure_matrix(reading, punch.surface)
    step = PATH / n_steps
    largest_eigenvalue = float(np.abs(np.linalg.eigvals(R @ punch.stiffness())).max())
    step_over_bound = step * largest_eigenvalue / 2
    if step_over_bound >= 1:
        n_stable = int(np.ceil(n_steps * step_over_bound))
        raise ValueError(f"{n_steps} steps are not stable; take {n_stable} at least")
    depth: Array = np.zeros(len(R))
    touching: Mask = np.ones(len(R), dtype=bool)
    half_depth = depth
    for k in range(n_steps):
        force, touching = punch.forces(depth, touching)
        depth = depth + step * np.maximum(0.0, R @ force)
        if k == n_steps // 2 - 1:
            half_depth = depth
    force, _ = punch.forces(depth, touching)
    surface = punch.surface
    weights = surface.tributary_area if reading == "tributary" else surface.weight_area
    volume_error = float(abs(weights @ depth / (punch.force * PATH) - 1))
    has_own_weights = surface.weight_area.min() > 1e-9 * surface.tributary_area.min()
    best_matrix = pressure_matrix("own" if has_own_weights else "projected", surface)
    end_error = float(np.abs(best_matrix @ force / MEAN_PRESSURE - 1).max())
    return WearResult(punch, half_depth, depth, R @ force, step_over_bound, volume_error, end_error)


# Friction that falls with the pressure. Lengths are over the half width of the contact, stresses
# over Young's modulus

LARGEST_FRICTION = 0.6
"""mu0 in mu(p) = mu0 / (1 + p / p1)."""
HALVING_PRESSURE = 0.5
"""p1, at which the coefficient has halved, over Hertz' peak pressure."""
SHIFT = {1: 0.3, 2: 0.1}
"""Shift of the parabola over the approach, in the plane and in space (by the axis across)."""
OUTER_STICKING = 0.6
"""Nodes beyond this fraction of the outermost sticking node's radius give the radius."""
FRICTION_TOLERANCE, MAX_REPETITIONS = 1e-6, 30
"""Of coefficients by projected pressures: change that ends the repetition, and the most."""


@dataclass(frozen=True)
class FallingFriction:
    """The law of friction |r_t| <= mu0 r / (1 + r / (p1 A)) of nodes of areas A.

    Args:
        position: (m, dim) of nodes.
        halving_force: (m,), p1 A; a node without area has no friction.
    """

    position: Array
    halving_force: Array

    def parameter_at(self, x: Array) -> Array:
        """Return p1 A (n,) of nodes at columns (3, n)."""
        return _value_at_nearest(self.position, self.halving_force, x)

    def limit(self, parameter: Array, force: Array) -> tuple[Array, Array]:
        """Return the largest tangential forces (n,), and their slopes."""
        total = parameter + force
        fraction = parameter / np.where(total > 0, total, 1.0)
        return LARGEST_FRICTION * fraction * force, LARGEST_FRICTION * fraction**2


class PartialSlipResult(NamedTuple):
    """The state after pressing and shifting.

    Args:
        force: tangential, over mu0 times the pressing force.
        stick: half width or radius of the sticking zone.
        dofs: unknowns.
        x: (m, dim), nodes of the surface.
        pressure: (m,), over Hertz' peak pressure.
        shear: (m,), over Hertz' peak pressure.
    """

    force: float
    stick: float
    dofs: int
    x: Array
    pressure: Array
    shear: Array


def solve_partial_slip(
    element: str,
    reading: str,
    edges: int,
    halving_pressure: float = HALVING_PRESSURE,
    offset: float = 0.0,
) -> PartialSlipResult:
    """Press a rigid parabola to its exact depth, without friction, and move it along the surface.

    The body is an elastic half plane or half space; its far sides keep Hertz' exact displacements.

    Args:
        element: its name.
        reading: of the pressure that the law has: "own" or "tributary" areas, at nodes, "skip"
            (no friction where own weights vanish), or "projected", by coefficients that are
            repeated until they do not change.
        edges: over the half width of the contact.
        halving_pressure: at which the coefficient has halved, over Hertz' peak pressure.
        offset: how much farther in its edge of the mesh the contact ends, over the edge's length.
    """
    is_solid = not is_plane(element)
    make_mesh = _half_of_space if is_solid else _plane
    mesh, zone, outer = make_mesh(cell_of(element), edges + offset)
    up = mesh.geometry.dim - 1
    exact = _hertz_solution(is_solid)
    state = StressState.SOLID if is_solid else StressState.PLANE_STRAIN
    body = Body(make_spaces(element, mesh), Material(E, NU), state)
    K, space = assemble_matrix(body.stiffness()), body.spaces.trial

    def may_touch(x: Array) -> Mask:
        return np.asarray(np.isclose(x[up], 0) & (np.abs(x[:up]).max(axis=0) < zone + 1e-9))

    origin, down = (0.0,) * up, -exact.approach
    pair = ContactPair(may_touch, Parabola((*origin, 0.0), RADIUS), 0.0)
    supports = Reduction.dirichlet(space, _far_supports(space, exact, up, outer))
    no_load = K.createVecLeft()
    smooth = ContactProblem(K, supports, pair, space)
    pressed = smooth.step(smooth.undeformed, no_load, Motion((*origin, down)))
    shift = Motion((SHIFT[up] * exact.approach, *origin[1:], down))

    def solve_shift(friction: Friction) -> PairState:
        rough = ContactProblem(K, supports, replace(pair, friction=friction), space)
        return rough.step(pressed, no_load, shift).pairs[0]

    surface = SurfaceNodes.from_body(body, may_touch)
    R = pressure_matrix(reading, surface)
    p1 = halving_pressure * exact.peak_pressure
    if reading == "projected":
        contact, limit = _repeat_coefficients(solve_shift, surface, R, p1)
    else:
        area = surface.tributary_area if reading == "tributary" else surface.weight_area
        has_area = area > 1e-9 * area.max()
        law = FallingFriction(surface.position, p1 * np.maximum(area, 0.0) * has_area)
        contact = solve_shift(law)
        limit = law.limit(law.halving_force, contact.force_normal)[0]
    tangential = contact.force_tangential
    unused_friction = R @ (limit - np.linalg.norm(tangential, axis=1))
    stick = _extrapolate_stick(surface.position[:, :up], unused_friction, contact.status == STICK)
    return PartialSlipResult(
        float(tangential[:, 0].sum() / (LARGEST_FRICTION * contact.force_normal.sum())),
        stick,
        K.getSize()[0],
        surface.position,
        R @ contact.force_normal / exact.peak_pressure,
        R @ tangential[:, 0] / exact.peak_pressure,
    )


def _repeat_coefficients(
    solve_shift: Callable[[Friction], PairState], surface: SurfaceNodes, R: Array, p1: float
) -> tuple[PairState, Array]:
    """Solve with coefficients by projected pressures until these do not change.

    Returns:
        State of the pair, and largest tangential forces (m,).
    """
    mu: Array = np.full(len(R), LARGEST_FRICTION)
    for _ in range(MAX_REPETITIONS):
        contact = solve_shift(Coulomb(partial(_value_at_nearest, surface.position, mu)))
        pressure = np.maximum(0.0, R @ contact.force_normal)
        previous, mu = mu, LARGEST_FRICTION / (1 + pressure / p1)
        if np.abs(mu - previous).max() < FRICTION_TOLERANCE:
            break
    return contact, mu * contact.force_normal


def _extrapolate_stick(x: Array, unused_friction: Array, sticks: Mask) -> float:
    """Return half the width, or the radius, of the sticking zone, beyond its outermost nodes.

    The square of the friction that is not used vanishes there as the distance does (see V10): a
    straight line through the outer nodes that stick is extrapolated, in the plane on each side.
    """
    r = np.linalg.norm(x, axis=1)
    sides = [x[:, 0] > 0, x[:, 0] < 0] if x.shape[1] == 1 else [r > 0]
    radii = []
    for side in sides:
        is_fitted = sticks & side
        is_fitted &= r > OUTER_STICKING * r[is_fitted].max()
        slope, start = np.polyfit(r[is_fitted] ** 2, unused_friction[is_fitted] ** 2, 1)
        radii.append(np.sqrt(start / -slope))
    return float(np.mean(radii))


def _value_at_nearest(position: Array, values: Array, x: Array) -> Array:
    """Return the values (m,) of nodes that are nearest to columns (3, n)."""
    dim = position.shape[1]
    distance = np.linalg.norm(x[:dim].T[:, None] - position, axis=2)
    return np.asarray(values[distance.argmin(axis=1)])


def _plane(cell: str, edges: float) -> tuple[Mesh, float, float]:
    """Return the plane's mesh, the distance up to which nodes may touch, and the far sides'."""
    size = 1 / (edges + mesh_lines.CONTACT_EDGE_POSITION)
    near = size * np.arange(np.ceil(CONTACT_ZONE_SIZE / size) + 1)
    right = np.concatenate(
        [near, near[-1] + growing_lines_from_size(size, BODY_SIZE - near[-1])[1:]]
    )
    along = np.concatenate([-right[:0:-1], right])
    below = -growing_lines_from_size(size, BODY_SIZE)[::-1]
    return mesh_along_lines(MPI.COMM_SELF, along, below, cell), float(near[-1]), BODY_SIZE


def _half_of_space(cell: str, edges: float) -> tuple[Mesh, float, float]:
    """Return the same of the half y >= 0 of space."""
    lines = mesh_lines.graded_body_lines(edges)
    along = np.concatenate([-lines.horizontal[:0:-1], lines.horizontal])
    mesh = mesh_box(cell, along, lines.horizontal, lines.vertical)
    return mesh, lines.contact_zone_size, mesh_lines.BODY_SIZE


def _hertz_solution(is_solid: bool) -> HertzLine | HertzSphere:
    elastic = ElasticHalfSpace(E, NU)
    if is_solid:
        return HertzSphere(elastic, RADIUS, force_of_unit_hertz_contact(elastic, RADIUS))
    return HertzLine(elastic, RADIUS, np.pi * elastic.plane_modulus / (4 * RADIUS))


def _far_supports(
    space: fem.FunctionSpace, exact: HertzLine | HertzSphere, up: int, outer: float
) -> list[fem.DirichletBC]:
    """Return Hertz' displacements on the far sides, and in space the symmetry plane y = 0."""

    def is_far(x: Array) -> Mask:
        return np.isclose(np.abs(x[: up + 1]).max(axis=0), outer)

    x = space.tabulate_dof_coordinates()
    nodes = np.flatnonzero(is_far(x.T)).astype(np.int32)
    supports = [prescribe_nodes(space, nodes, _far_displacements(exact, x[nodes], up))]
    if up == 2:
        supports.append(prescribe(space, 1, lambda p: np.isclose(p[1], 0.0) & ~is_far(p)))
    return supports


def _far_displacements(exact: HertzLine | HertzSphere, x: Array, up: int) -> Array:
    """Return exact displacements (n, dim) of points (n, 3) far from the contact."""
    if up == 1:
        mirrored = exact.displacement(np.column_stack([np.abs(x[:, 0]), x[:, 1]]))
        return mirrored * np.column_stack([np.sign(x[:, 0]), np.ones(len(x))])
    r = np.hypot(x[:, 0], x[:, 1])
    radial, axial = exact.displacement(np.column_stack([r, x[:, 2]])).T
    in_plane = radial[:, None] * x[:, :2] / np.maximum(r, 1e-12)[:, None]
    return np.column_stack([in_plane, axial])


# Impact. Density, speed of sound (in uniaxial strain) and height of the block are one

SCHEMES = {"galerkin": "hrz", "sibling": "sibling"}
"""Lumped mass of Hinton, Rock and Zienkiewicz for the standard element, row sums for the sibling."""
DOME_RADIUS, DOME_FRICTION = 10.0, 0.3
SPEED_DOWN = 0.01
SPEED_RATIO = 0.2
"""Speed along x over that downwards."""
END_TIME = 8.0
"""The block has left the dome before."""


class ImpactResult(NamedTuple):
    """The impact, and the block after it.

    Args:
        rebound: mean speed upwards at the end, over that downwards at the start.
        slip: impulse of friction over mu times that of pressing.
        energy: work of friction over the energy at the start.
        imbalance: of energies and work, relative.
        steps: of time.
        time: (s,).
        force: (s, dim), total force of the dome.
        dofs: unknowns.
    """

    rebound: float
    slip: float
    energy: float
    imbalance: float
    steps: int
    time: Array
    force: Array
    dofs: int


def throw_block(element: str, cells: int, offset: float = 0.0) -> ImpactResult:
    """Compute the impact of a block with so many cells along its height.

    The block is 2 x 1 (in space 2 x 1 x 1, one half of it). The library integrates all schemes,
    each with 0.9 of its own critical step. Nodal forces alone enter the law: nothing is read.

    Args:
        element: its name.
        cells: number of them.
        offset: how far mesh lines above the dome's apex are moved, over the size of a cell.
    """
    along = np.linspace(-1.0, 1.0, 2 * cells + 1, dtype=np.float64)
    along += offset / cells * (1 - along**2)
    up = np.linspace(0.0, 1.0, cells + 1, dtype=np.float64)
    cell = cell_of(element)
    if is_plane(element):
        mesh = mesh_along_lines(MPI.COMM_SELF, along, up, cell)
    else:
        mesh = mesh_box(cell, along, np.linspace(0.0, 0.5, cells // 2 + 1, dtype=np.float64), up)
    scheme, dim = _make_scheme(element, mesh), mesh.geometry.dim
    symmetry = [prescribe(scheme.space, 1, _symmetry_plane(1))] if dim == 3 else []
    if scheme.sibling is None:
        supports = Reduction.dirichlet(scheme.space, symmetry)
    else:
        supports = scheme.sibling.dirichlet(symmetry)
    velocity = scheme.K.createVecRight()
    start = SPEED_DOWN * np.array([SPEED_RATIO, *[0.0] * (dim - 2), -1.0])
    velocity.setArray(np.tile(start, velocity.getLocalSize() // dim))
    # an apex between shifted nodes: the sibling's coefficients would begin inside the dome
    start_gap = 1 / (8 * DOME_RADIUS * cells**2) if offset else 0.0  # sagitta over half a cell
    dome = Parabola((*[0.0] * (dim - 1), -start_gap), -DOME_RADIUS)
    pair = ContactPair(lambda x: np.isclose(x[dim - 1], 0.0), dome, DOME_FRICTION)
    history = solve_impact(scheme.K, scheme.M, supports, pair, scheme.space, END_TIME, velocity)
    mass = scheme.M.getDiagonal().array_r.reshape(-1, dim)
    end_momentum = (mass * history.velocity.array_r.reshape(-1, dim)).sum(axis=0)
    end_velocity = end_momentum / mass.sum(axis=0)
    energies, force = history.energies, history.pairs[0].total_force
    normal_impulse, tangential_impulse = (history.step * np.sum(force[:, axis]) for axis in (-1, 0))
    return ImpactResult(
        float(end_velocity[-1] / SPEED_DOWN),
        float(-tangential_impulse / (DOME_FRICTION * normal_impulse)),
        float(-energies.friction_work[-1] / energies.total[0]),
        energies.imbalance,
        len(force),
        history.time[:-1],
        force,
        scheme.K.getSize()[0],
    )


def _make_scheme(element: str, mesh: Mesh) -> StiffnessMassPair:
    """Return stiffness and lumped mass; for references those of Simpson's rule."""
    kind, cell = element.split("-")
    if cell in ("T6", "T10"):
        return StiffnessMassPair.from_name(SCHEMES[kind], mesh)
    body = Body(make_spaces(element, mesh), MATERIAL, STRESS_STATE_BY_DIMENSION[mesh.geometry.dim])
    mass = lumped_mass(assemble_matrix(body.mass()), body.spaces.trial)
    return StiffnessMassPair(body, assemble_matrix(body.stiffness()), mass)
