"""Applications in which nodal forces or pressures enter contact laws: wear, friction, impact.

1. `wear_punch`: Archard wear of an elastic punch on a rigid plate that slides below it, normal to
   the plane of the model.
2. `solve_partial_slip`: friction whose coefficient decreases with the pressure at each node.
3. `throw_block_at_rough_dome`: explicit impact of a block that is thrown obliquely onto a rough
    rigid dome.
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
from study.benchmarks.w_engineering.pressures import nodal_force_to_pressure_matrix
from study.meshes import mesh_lines
from study.meshes.line_mesh import mesh_along_lines
from study.meshes.solid_meshes import mesh_box_along_lines
from study.model.discretisation import make_element_spaces, prescribe_node_displacements
from study.solutions.half_space import ElasticHalfSpace, HertzLine, HertzSphere
from study.solutions.half_space_shear import force_that_gives_contact_radius_1
from study.solutions.hertz_problem import BODY_SIZE, CONTACT_ZONE_SIZE, NU, RADIUS, E, use_mumps_lu
from study.solutions.indentation import mesh_line_positions_growing_from_size

Array = npt.NDArray[Any]
Mask = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.int64]

# Elements


def is_two_dimensional_element(element: str) -> bool:
    """Return whether an element is two-dimensional, given its name."""
    return element.endswith(("T6", "Q9"))


def cell_name_of_element(element: str) -> str:
    """Return the DOLFINx name of the cells of an element, given the element's name."""
    cells = {"T6": "triangle", "Q9": "quadrilateral", "T10": "tetrahedron", "H27": "hexahedron"}
    return cells[element.split("-")[1]]


def make_spaces_of_element(element: str, mesh: Mesh) -> Spaces:
    """Make the spaces of an element; "galerkin-Q9" is available for reference solutions only."""
    return Spaces.galerkin(mesh) if element == "galerkin-Q9" else make_element_spaces(element, mesh)


# Wear. Lengths are over the punch's height, stresses over the mean pressure

PUNCH_MODULUS, PUNCH_POISSONS_RATIO, MEAN_PRESSURE = 100.0, 0.3, 1.0
PATH = 0.06
"""Product k s of the wear coefficient k (depth per pressure and path) and the total path s.

As the mean pressure is one, this is also the mean wear depth at the end.
"""
LOADED_WIDTH = 0.5
"""Half width of the loaded middle part of the punch's back."""
N_FREE_CHANGES, MAX_CHANGES = 10, 2000
"""Number of updates of the touching nodes that change all violating nodes, and maximum number of
all updates.
"""
ROUND_OFF = 1e-12
"""Round-off of nodal forces, over the total force, and of gaps."""


@dataclass(frozen=True)
class CondensedElasticPunch:
    """Elastic punch, condensed to the normal displacements of its face nodes.

    It is a block 2 wide (2 x 2 in three dimensions) and 1 high, with a uniform load on the middle
    of its back.

    Args:
        surface: The m nodes of the face.
        flexibility: Normal displacements (m, m) due to unit nodal forces, up to a translation.
        load_displacement: Normal displacements (m,) due to the load, up to a translation.
        force: Total force on the modelled half or quarter.
        dofs: Number of unknowns before condensation.
    """

    surface: SurfaceNodes
    flexibility: Array
    load_displacement: Array
    force: float
    dofs: int

    @classmethod
    def from_element_and_mesh_size(
        cls, element: str, cells: int, offset: float = 0.0
    ) -> "CondensedElasticPunch":
        """Make the condensed model of one half of the punch, or of a quarter in three dimensions.

        Args:
            element: Element name such as "pw-T6" or "galerkin-T10".
            cells: Number of cells over the height and over the half width.
            offset: Twice the largest shift of mesh lines through the face, in cell sizes. The edge
                of the load stays on a mesh line.
        """
        lines: npt.NDArray[np.float64] = np.linspace(0.0, 1.0, cells + 1, dtype=np.float64)
        beside = lines + offset / 2 / cells * np.sin(2 * np.pi * lines)
        if is_two_dimensional_element(element):
            mesh, state = (
                mesh_along_lines(MPI.COMM_SELF, beside, lines, cell_name_of_element(element)),
                "plane strain",
            )
        else:
            mesh, state = (
                mesh_box_along_lines(cell_name_of_element(element), beside, beside, lines),
                "solid",
            )
        up = mesh.geometry.dim - 1
        material = Material(PUNCH_MODULUS, PUNCH_POISSONS_RATIO)
        body = Body(make_spaces_of_element(element, mesh), material, StressState(state))
        K, space = assemble_matrix(body.stiffness()), body.spaces.trial

        def is_on_loaded_back(x: Array) -> Mask:
            is_in_middle = np.max(x[:up], axis=0) < LOADED_WIDTH + 1e-9
            return np.asarray(np.isclose(x[up], 1.0) & is_in_middle)

        def is_top_node_on_axis(x: Array) -> Mask:  # one node, to fix the translation; no reaction
            return np.asarray(np.isclose(x, np.eye(3)[up][:, None]).all(axis=0))

        def is_on_face(x: Array) -> Mask:
            return np.isclose(x[up], 0.0)

        traction = -MEAN_PRESSURE * np.eye(up + 1)[up] / LOADED_WIDTH**up
        back = boundary_measure(mesh, is_on_loaded_back)
        load = assemble_vector(body.surface_load(traction, back)).array
        supports = [prescribe(space, i, _make_symmetry_plane_marker(i)) for i in range(up)]
        supports.append(prescribe(space, up, is_top_node_on_axis))
        supported_dofs = [dof for support in supports for dof in support.dof_indices()[0]]
        free_dofs = np.setdiff1d(np.arange(len(load)), supported_dofs)
        surface = SurfaceNodes.from_body(body, is_on_face)
        rows = np.searchsorted(free_dofs, (up + 1) * surface.node + up)
        unit_forces_and_load = np.zeros((len(free_dofs), len(rows) + 1))
        unit_forces_and_load[rows, np.arange(len(rows))] = 1.0
        unit_forces_and_load[:, -1] = load[free_dofs]
        displacement = _solve_for_free_dofs(K, free_dofs, unit_forces_and_load)[rows]
        force = float(-load[up :: up + 1].sum())
        return cls(surface, displacement[:, :-1], displacement[:, -1], force, len(load))

    def forces(self, depth: Array, touching: Mask) -> tuple[Array, Mask]:
        """Solve frictionless contact of the worn face with the plate by active sets.

        In each update, all nodes that violate the contact law change their status. As this may
        cycle, only the first such node is changed after `N_FREE_CHANGES` updates, which terminates
        for every stiffness with positive principal minors (K. G. Murty, 1974).

        Args:
            depth: Wear depths (m,).
            touching: Mask (m,) of nodes that are first assumed to touch.

        Returns:
            Nodal forces (m,), and mask (m,) of the touching nodes.

        Raises:
            RuntimeError: If the touching nodes still change after `MAX_CHANGES` updates.
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
        """Return minus the derivatives (m, m) of nodal forces by wear depths as all nodes touch."""
        m = len(self.load_displacement)
        return np.asarray(np.linalg.inv(self._system(np.arange(m)))[:m, :m])

    def _system(self, touching_nodes: Indices) -> Array:
        """Return the bordered matrix of zero gaps at touching nodes and of the balance of forces.

        The unknowns are the nodal forces and a translation of the punch.

        Args:
            touching_nodes: Indices (t,) of the touching nodes.

        Returns:
            Matrix (t + 1, t + 1).
        """
        border = np.ones((len(touching_nodes), 1))
        flexibility = self.flexibility[np.ix_(touching_nodes, touching_nodes)]
        return np.block([[flexibility, border], [border.T, np.zeros((1, 1))]])


def _make_symmetry_plane_marker(axis: int) -> Callable[[Array], Mask]:
    return lambda x: np.isclose(x[axis], 0.0)


def _solve_for_free_dofs(K: PETSc.Mat, free_dofs: Indices, right_sides: Array) -> Array:
    """Solve for the unsupported unknowns by sparse LU factorisation (MUMPS).

    Args:
        K: Stiffness matrix without supports.
        free_dofs: Indices (n,) of the unsupported unknowns.
        right_sides: Right-hand sides (n, k).

    Returns:
        Solutions (n, k).
    """
    rows = PETSc.IS().createGeneral(free_dofs.astype(PETSc.IntType))
    ksp = PETSc.KSP().create(K.comm)
    ksp.setOperators(K.createSubMatrix(rows, rows))
    use_mumps_lu(ksp)
    ksp.setUp()
    B = PETSc.Mat().createDense(right_sides.shape, array=right_sides)
    B.assemble()
    X = B.duplicate()
    ksp.pc.getFactorMatrix().matSolve(B, X)
    return np.array(X.getDenseArray())


class WearResult(NamedTuple):
    """Result of the wear of a punch.

    Args:
        punch: Punch before wear.
        depth_at_half_path: Wear depths (m,) at half of the path.
        depth: Wear depths (m,) at the end of the path.
        pressure: Pressures (m,) at the end, by the pressure rule of the wear law.
        step_over_stability_limit: Step over the largest stable step.
        relative_volume_error: Relative difference of the integrated wear depths from k F s, with
            the wear coefficient k, the force F and the path s.
        final_pressure_deviation: Largest relative deviation of a final pressure from the mean
            pressure, by the rule "own", or "projected" if the integral of a test function vanishes.
    """

    punch: CondensedElasticPunch
    depth_at_half_path: Array
    depth: Array
    pressure: Array
    step_over_stability_limit: float
    relative_volume_error: float
    final_pressure_deviation: float


def wear_punch(
    element: str, pressure_rule: str, cells: int, n_steps: int, offset: float = 0.0
) -> WearResult:
    """Integrate the wear of the punch's face by equal explicit steps of the sliding path.

    A step ds is stable if k ds times the largest eigenvalue of R S is below 2, where k is the wear
    coefficient, R converts nodal forces to pressures, and S is the negative derivative of the
    forces by the wear depths while the whole face touches. The path is so long that the pressure
    becomes uniform; the final state is therefore known.

    Args:
        element: Element name such as "pw-T6" or "galerkin-T10".
        pressure_rule: Pressure rule of the wear law (see `nodal_force_to_pressure_matrix`).
        cells: Number of cells over the height of the punch.
        n_steps: Number of steps.
        offset: Twice the largest shift of mesh lines through the face, in cell sizes.

    Raises:
        ValueError: If the steps are not stable.
    """
    punch = CondensedElasticPunch.from_element_and_mesh_size(element, cells, offset)
    R = nodal_force_to_pressure_matrix(pressure_rule, punch.surface)
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
    weights = surface.tributary_area if pressure_rule == "tributary" else surface.weight_area
    volume_error = float(abs(weights @ depth / (punch.force * PATH) - 1))
    has_own_weights = surface.weight_area.min() > 1e-9 * surface.tributary_area.min()
    best_matrix = nodal_force_to_pressure_matrix("own" if has_own_weights else "projected", surface)
    end_error = float(np.abs(best_matrix @ force / MEAN_PRESSURE - 1).max())
    return WearResult(punch, half_depth, depth, R @ force, step_over_bound, volume_error, end_error)


# Friction that falls with the pressure. Lengths are over the half width of the contact, stresses
# over Young's modulus

LARGEST_FRICTION = 0.6
"""Coefficient mu0 in the law mu(p) = mu0 / (1 + p / p1)."""
HALVING_PRESSURE = 0.5
"""Pressure p1, at which the coefficient of friction is mu0 / 2, over Hertz's peak pressure."""
SHIFT = {1: 0.3, 2: 0.1}
"""Sideways displacement of the parabola over its approach, by the axis normal to the surface.

The axis is 1 in two dimensions and 2 in three.
"""
OUTER_STICKING = 0.6 * (1 - 1e-9)
"""Radius over that of the outermost sticking node, beyond which nodes are extrapolated.

Meshes of the half space have nodes at exactly 0.6 of this radius; the margin includes them all,
whatever the round-off.
"""
FRICTION_TOLERANCE, MAX_REPETITIONS = 1e-6, 30
"""Tolerance and maximum number of fixed-point iterations for the coefficients of friction."""


@dataclass(frozen=True)
class FrictionFallingWithPressure:
    """Friction law |r_t| <= mu0 r / (1 + r / (p1 A)) for nodes with normal forces r and areas A.

    Args:
        position: Positions (m, dim) of the nodes.
        halving_force: Forces p1 A (m,) at which the coefficient is mu0 / 2; a node for which it is
            zero has no friction.
    """

    position: Array
    halving_force: Array

    def parameter_at(self, x: Array) -> Array:
        """Return the forces p1 A (n,) of the nodes at points (3, n)."""
        return _values_of_nearest_nodes(self.position, self.halving_force, x)

    def limit(self, parameter: Array, force: Array) -> tuple[Array, Array]:
        """Return friction limits (n,) and their derivatives (n,) by the normal forces.

        Args:
            parameter: Forces p1 A (n,).
            force: Normal forces (n,).
        """
        total = parameter + force
        fraction = parameter / np.where(total > 0, total, 1.0)
        return LARGEST_FRICTION * fraction * force, LARGEST_FRICTION * fraction**2


class PartialSlipResult(NamedTuple):
    """Result after a parabola has been pressed on a body and moved along its surface.

    Args:
        force: Tangential force over mu0 times the normal force.
        stick: Half width or radius of the stick zone.
        dofs: Number of unknowns.
        x: Positions (m, dim) of the surface nodes.
        pressure: Pressures (m,) over Hertz's peak pressure.
        shear: Shear tractions (m,) along x over Hertz's peak pressure.
    """

    force: float
    stick: float
    dofs: int
    x: Array
    pressure: Array
    shear: Array


def solve_partial_slip(
    element: str,
    pressure_rule: str,
    edges: int,
    halving_pressure: float = HALVING_PRESSURE,
    offset: float = 0.0,
) -> PartialSlipResult:
    """Press a rigid parabola on an elastic half plane or space, then move it along the surface.

    Pressing is frictionless and goes to the exact depth. Then friction with a pressure-dependent
    coefficient acts. Hertz's exact displacements are prescribed on the far sides.

    Args:
        element: Element name such as "pw-T6" or "galerkin-T10".
        pressure_rule: Pressure rule of the friction law: "own", "tributary" or "skip" at each node
            (with "skip", a node whose test function has no integral has no friction), or
            "projected", with coefficients that are computed by fixed-point iteration.
        edges: Number of edges over the half width of the contact.
        halving_pressure: Pressure at which the coefficient is halved, over Hertz's peak pressure.
        offset: Shift of the contact's end within its edge, over the length of this edge.
    """
    is_solid = not is_two_dimensional_element(element)
    make_mesh = _mesh_half_of_half_space if is_solid else _mesh_half_plane
    mesh, zone, outer = make_mesh(cell_name_of_element(element), edges + offset)
    up = mesh.geometry.dim - 1
    exact = _make_exact_hertz_solution(is_solid)
    state = StressState.SOLID if is_solid else StressState.PLANE_STRAIN
    body = Body(make_spaces_of_element(element, mesh), Material(E, NU), state)
    K, space = assemble_matrix(body.stiffness()), body.spaces.trial

    def may_touch(x: Array) -> Mask:
        return np.asarray(np.isclose(x[up], 0) & (np.abs(x[:up]).max(axis=0) < zone + 1e-9))

    origin, down = (0.0,) * up, -exact.approach
    pair = ContactPair(may_touch, Parabola((*origin, 0.0), RADIUS), 0.0)
    supports = Reduction.dirichlet(space, _make_far_and_symmetry_supports(space, exact, up, outer))
    no_load = K.createVecLeft()
    smooth = ContactProblem(K, supports, pair, space)
    pressed = smooth.step(smooth.undeformed, no_load, Motion((*origin, down)))
    shift = Motion((SHIFT[up] * exact.approach, *origin[1:], down))

    def shift_with_friction(friction: Friction) -> PairState:
        rough = ContactProblem(K, supports, replace(pair, friction=friction), space)
        return rough.step(pressed, no_load, shift).pairs[0]

    surface = SurfaceNodes.from_body(body, may_touch)
    R = nodal_force_to_pressure_matrix(pressure_rule, surface)
    p1 = halving_pressure * exact.peak_pressure
    if pressure_rule == "projected":
        contact, limit = _iterate_pressure_dependent_friction(shift_with_friction, surface, R, p1)
    else:
        area = surface.tributary_area if pressure_rule == "tributary" else surface.weight_area
        has_area = area > 1e-9 * area.max()
        law = FrictionFallingWithPressure(surface.position, p1 * np.maximum(area, 0.0) * has_area)
        contact = shift_with_friction(law)
        limit = law.limit(law.halving_force, contact.force_normal)[0]
    tangential = contact.force_tangential
    unused_friction = R @ (limit - np.linalg.norm(tangential, axis=1))
    stick = _extrapolate_stick_radius(
        surface.position[:, :up], unused_friction, contact.status == STICK
    )
    return PartialSlipResult(
        float(tangential[:, 0].sum() / (LARGEST_FRICTION * contact.force_normal.sum())),
        stick,
        K.getSize()[0],
        surface.position,
        R @ contact.force_normal / exact.peak_pressure,
        R @ tangential[:, 0] / exact.peak_pressure,
    )


def _iterate_pressure_dependent_friction(
    solve_shift: Callable[[Friction], PairState],
    surface: SurfaceNodes,
    R: Array,
    halving_pressure: float,
) -> tuple[PairState, Array]:
    """Solve by fixed-point iteration of friction coefficients that depend on projected pressures.

    Args:
        solve_shift: Function that moves the parabola with a given friction law.
        surface: The m surface nodes.
        R: Matrix (m, m) that converts nodal forces to pressures.
        halving_pressure: Pressure at which the coefficient of friction is halved.

    Returns:
        State of the contact pair, and friction limits (m,).
    """
    mu: Array = np.full(len(R), LARGEST_FRICTION)
    for _ in range(MAX_REPETITIONS):
        contact = solve_shift(Coulomb(partial(_values_of_nearest_nodes, surface.position, mu)))
        pressure = np.maximum(0.0, R @ contact.force_normal)
        previous, mu = mu, LARGEST_FRICTION / (1 + pressure / halving_pressure)
        if np.abs(mu - previous).max() < FRICTION_TOLERANCE:
            break
    return contact, mu * contact.force_normal


def _extrapolate_stick_radius(x: Array, unused_friction: Array, sticks: Mask) -> float:
    """Return the half width or radius of the stick zone, extrapolated from its outer nodes.

    The square of the unused friction vanishes at the border of the zone, and is a linear function
    of the squared radius near it (see section V10). A straight line is fitted to the outer sticking
    nodes. In two dimensions this is done on each side, and the mean of both radii is returned.

    Args:
        x: Positions (m, 1) or (m, 2) along the surface.
        unused_friction: Friction limit minus shear (m,), as tractions.
        sticks: Mask (m,) of the sticking nodes.
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


def _values_of_nearest_nodes(position: Array, values: Array, x: Array) -> Array:
    """Return the values of the nearest nodes at points.

    Args:
        position: Positions (m, dim) of the nodes.
        values: Values (m,) at the nodes.
        x: Points (3, n).

    Returns:
        Values (n,).
    """
    dim = position.shape[1]
    distance = np.linalg.norm(x[:dim].T[:, None] - position, axis=2)
    return np.asarray(values[distance.argmin(axis=1)])


def _mesh_half_plane(cell: str, edges: float) -> tuple[Mesh, float, float]:
    """Mesh the half plane.

    Args:
        cell: Cell type of the mesh.
        edges: Number of edges over the half width of the contact.

    Returns:
        Mesh, half width of the zone that may touch, and size of the body.
    """
    size = 1 / (edges + mesh_lines.CONTACT_EDGE_POSITION)
    near = size * np.arange(np.ceil(CONTACT_ZONE_SIZE / size) + 1)
    right = np.concatenate(
        [near, near[-1] + mesh_line_positions_growing_from_size(size, BODY_SIZE - near[-1])[1:]]
    )
    along = np.concatenate([-right[:0:-1], right])
    below = -mesh_line_positions_growing_from_size(size, BODY_SIZE)[::-1]
    return mesh_along_lines(MPI.COMM_SELF, along, below, cell), float(near[-1]), BODY_SIZE


def _mesh_half_of_half_space(cell: str, edges: float) -> tuple[Mesh, float, float]:
    """Mesh the half y >= 0 of the half space.

    Args:
        cell: Cell type of the mesh.
        edges: Number of edges over the radius of the contact.

    Returns:
        Mesh, half width of the zone that may touch, and size of the body.
    """
    lines = mesh_lines.mesh_lines_of_body_under_sphere(edges)
    along = np.concatenate([-lines.horizontal[:0:-1], lines.horizontal])
    mesh = mesh_box_along_lines(cell, along, lines.horizontal, lines.vertical)
    return mesh, lines.contact_zone_size, mesh_lines.BODY_SIZE


def _make_exact_hertz_solution(is_solid: bool) -> HertzLine | HertzSphere:
    elastic = ElasticHalfSpace(E, NU)
    if is_solid:
        return HertzSphere(elastic, RADIUS, force_that_gives_contact_radius_1(elastic, RADIUS))
    return HertzLine(elastic, RADIUS, np.pi * elastic.plane_strain_modulus / (4 * RADIUS))


def _make_far_and_symmetry_supports(
    space: fem.FunctionSpace, exact: HertzLine | HertzSphere, normal_axis: int, outer: float
) -> list[fem.DirichletBC]:
    """Prescribe Hertz's exact displacements on the far sides, and in 3D symmetry about y = 0.

    Args:
        space: Space of the displacements.
        exact: Exact solution of the contact.
        normal_axis: Axis normal to the surface: 1 in two dimensions, 2 in three.
        outer: Distance of the far sides from the origin.
    """

    def is_far(x: Array) -> Mask:
        return np.isclose(np.abs(x[: normal_axis + 1]).max(axis=0), outer)

    x = space.tabulate_dof_coordinates()
    nodes = np.flatnonzero(is_far(x.T)).astype(np.int32)
    supports = [
        prescribe_node_displacements(
            space, nodes, _exact_far_displacements(exact, x[nodes], normal_axis)
        )
    ]
    if normal_axis == 2:
        supports.append(prescribe(space, 1, lambda p: np.isclose(p[1], 0.0) & ~is_far(p)))
    return supports


def _exact_far_displacements(exact: HertzLine | HertzSphere, x: Array, normal_axis: int) -> Array:
    """Return the exact displacements (n, dim) at points far from the contact.

    Args:
        exact: Exact solution of the contact.
        x: Points (n, 3).
        normal_axis: Axis normal to the surface: 1 in two dimensions, 2 in three.
    """
    if normal_axis == 1:
        mirrored = exact.displacement(np.column_stack([np.abs(x[:, 0]), x[:, 1]]))
        return mirrored * np.column_stack([np.sign(x[:, 0]), np.ones(len(x))])
    r = np.hypot(x[:, 0], x[:, 1])
    radial, axial = exact.displacement(np.column_stack([r, x[:, 2]])).T
    in_plane = radial[:, None] * x[:, :2] / np.maximum(r, 1e-12)[:, None]
    return np.column_stack([in_plane, axial])


# Impact. Density, speed of sound (in uniaxial strain) and height of the block are one

SCHEMES = {"galerkin": "hrz", "sibling": "sibling"}
"""Names of the stiffness and lumped mass by kind of element.

The standard element uses the Hinton-Rock-Zienkiewicz lumping, the sibling row sums.
"""
DOME_RADIUS, DOME_FRICTION = 10.0, 0.3
SPEED_DOWN = 0.01
SPEED_RATIO = 0.2
"""Initial speed along x over the initial downward speed."""
END_TIME = 8.0
"""Time at which the integration ends, after the block has left the dome."""


class ImpactResult(NamedTuple):
    """Result of the impact of a block on a dome.

    Args:
        rebound_speed_ratio: Mean upward speed at the end over the downward speed at the start.
        slip: Impulse of friction over mu times the normal impulse.
        energy: Energy that friction dissipates over the initial energy.
        imbalance: Relative imbalance of energies and work.
        steps: Number of time steps.
        time: Times (s,).
        force: Total forces (s, dim) of the dome on the block.
        dofs: Number of unknowns.
    """

    rebound_speed_ratio: float
    slip: float
    energy: float
    imbalance: float
    steps: int
    time: Array
    force: Array
    dofs: int


def throw_block_at_rough_dome(element: str, cells: int, offset: float = 0.0) -> ImpactResult:
    """Compute the explicit impact of a block on a rough rigid dome.

    The block is 2 x 1 (2 x 1 x 1 in three dimensions, of which one half is modelled). The library
    integrates all schemes, each with 0.9 times its own critical step. The contact law uses nodal
    forces and no pressures.

    Args:
        element: Element name such as "sibling-T6" or "galerkin-T10".
        cells: Number of cells over the height of the block.
        offset: Shift of the mesh lines above the apex of the dome, in cell sizes.
    """
    along = np.linspace(-1.0, 1.0, 2 * cells + 1, dtype=np.float64)
    along += offset / cells * (1 - along**2)
    up = np.linspace(0.0, 1.0, cells + 1, dtype=np.float64)
    cell = cell_name_of_element(element)
    if is_two_dimensional_element(element):
        mesh = mesh_along_lines(MPI.COMM_SELF, along, up, cell)
    else:
        mesh = mesh_box_along_lines(
            cell, along, np.linspace(0.0, 0.5, cells // 2 + 1, dtype=np.float64), up
        )
    scheme, dim = _make_stiffness_and_lumped_mass(element, mesh), mesh.geometry.dim
    symmetry = [prescribe(scheme.space, 1, _make_symmetry_plane_marker(1))] if dim == 3 else []
    if scheme.sibling is None:
        supports = Reduction.dirichlet(scheme.space, symmetry)
    else:
        supports = scheme.sibling.dirichlet(symmetry)
    velocity = scheme.K.createVecRight()
    start = SPEED_DOWN * np.array([SPEED_RATIO, *[0.0] * (dim - 2), -1.0])
    velocity.setArray(np.tile(start, velocity.getLocalSize() // dim))
    # With shifted nodes the apex lies between nodes, and some of the sibling's coefficients would
    # start inside the dome without this gap
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


def _make_stiffness_and_lumped_mass(element: str, mesh: Mesh) -> StiffnessMassPair:
    """Assemble the stiffness and the lumped mass of an element.

    For elements of reference solutions, the mass is integrated by Simpson's rule.

    Args:
        element: Element name.
        mesh: Mesh of the block.
    """
    kind, cell = element.split("-")
    if cell in ("T6", "T10"):
        return StiffnessMassPair.from_scheme_name(SCHEMES[kind], mesh)
    body = Body(
        make_spaces_of_element(element, mesh),
        MATERIAL,
        STRESS_STATE_BY_DIMENSION[mesh.geometry.dim],
    )
    mass = lumped_mass(assemble_matrix(body.mass()), body.spaces.trial)
    return StiffnessMassPair(body, assemble_matrix(body.stiffness()), mass)
