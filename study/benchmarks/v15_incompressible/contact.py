"""Contact of nearly incompressible bodies: Hertz's line and sphere, friction, and a rubber seal."""

from functools import partial

from mpi4py import MPI

import gmsh
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from dolfinx.mesh import Mesh
from ufl.core.expr import Expr

from pw_elements import (
    Material,
    PetrovGalerkinProblem,
    SurfaceNodes,
    assemble_scalar,
    assemble_vector,
    prescribe,
)
from pw_elements.contact import OPEN, STICK, ContactPair, Motion, Parabola, solve_contact
from pw_elements.contact.model import ContactState
from pw_elements.elasticity import StressState
from pw_elements.spaces import SubSpace
from study.benchmarks.v10_space.page import sphere as pressed_sphere
from study.meshes.line_mesh import mesh_along_lines
from study.meshes.mesh_families import mesh_with_gmsh
from study.meshes.mesh_lines import geometrically_growing_lines
from study.model.discretisation import (
    collapsed_displacement_space,
    discretise,
    make_element_spaces,
    mesh_nodes_and_cells,
    prescribe_node_displacements,
)
from study.model.units import DIMENSIONLESS_UNITS, assign_unit_one_to_scalars
from study.run.store import Result
from study.solutions.half_space import ElasticHalfSpace, HertzLine
from study.solutions.indentation import (
    BODY_SIZE,
    INNER_PART,
    Indenter,
    mesh_graded_square,
    solve_indentation_on_one_mesh,
)

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

POISSONS_RATIO, FRICTION = 0.4999, 0.35

# Contact on a half plane whose exact displacements are prescribed on the outer sides
RADIUS, YOUNGS_MODULUS, HALF_WIDTH = 1e3, 1.0, 1.0
EDGE_POSITION = 0.375
"""Position of the edge of contact within an element, as a fraction of its length."""
CONTACT_ZONE = 1.3
"""Distance from the middle, over the contact's half width, within which nodes may touch."""
N_LOAD_STEPS = 4

# A block that replaces a half plane which is pressed and pushed, in consistent units
BLOCK_MODULUS, BLOCK_RADIUS, BLOCK_FORCE, PUSH_FRACTIONS = 1000.0, 20.0, 4.0, (0.2, 0.4)
"""Young's modulus, radius of the parabola, normal force P, and tangential forces over mu P."""
BLOCK_DEPTH, BLOCK_CELL_GROWTH = 75.0, 1.2
"""Depth of the block over the contact's half width, and size ratio of adjacent elements."""


def hertz(element: str, n: int, nu: float = 0.4999) -> Result:
    """Press a rigid parabola on a nearly incompressible half plane; return errors of the pressure.

    The scalar `pressure_rms` is the root mean square error of the nodal pressures over the peak
    pressure p0, at nodes away from the edge of contact; `pressure_rms_all` is the same for all
    nodes in contact. A nodal pressure is the nodal force over the integral of the node's test
    function.

    Args:
        element: Element name such as "pw-hybrid-T6".
        n: Number of elements over the half width of the contact.
        nu: Poisson's ratio.
    """
    body = ElasticHalfSpace(YOUNGS_MODULUS, nu)
    force = np.pi * HALF_WIDTH**2 * body.plane_strain_modulus / (4 * RADIUS)
    exact = HertzLine(body, RADIUS, force)
    indenter = Indenter(
        exact, Parabola((0.0, 0.0), RADIUS), StressState.PLANE_STRAIN, DIMENSIONLESS_UNITS
    )
    size = HALF_WIDTH / (n + EDGE_POSITION)
    lines = size * np.arange(np.ceil(CONTACT_ZONE * (n + EDGE_POSITION)) + 1)
    result = solve_indentation_on_one_mesh(element, indenter, lines)
    curves = result.curves
    error = (curves["pressure"] - curves["exact_pressure"]) / exact.peak_pressure

    def rms_pressure_error_within(fraction: float) -> float:
        return float(np.sqrt(np.mean(error[curves["x"] < fraction * HALF_WIDTH] ** 2)))

    scalars = {
        "pressure_rms": rms_pressure_error_within(INNER_PART),
        "pressure_rms_all": rms_pressure_error_within(1.0),
        "sawtooth": result.scalars["sawtooth"],
        "iterations": result.scalars["iterations"],
        "residual": result.scalars["residual"],
    }
    names = ("x", "force_n", "pressure", "exact_pressure", "status")
    stored_curves = {name: curves[name] for name in names}
    return Result(scalars, assign_unit_one_to_scalars(scalars), stored_curves, dofs=result.dofs)


def sphere(element: str, n: int) -> Result:
    """Press a rigid sphere on a nearly incompressible half space, of which a quarter is modelled.

    Args:
        element: Element name such as "pw-T10".
        n: Number of elements along the contact radius.
    """
    return pressed_sphere(element, n, POISSONS_RATIO)


def presses(element: str, n: int) -> Result:
    """Press a rough rigid parabola on a nearly incompressible half plane in several load steps.

    The surface of an incompressible half plane has no tangential displacement, so any shear is a
    discretisation error. The scalar `shear_spurious` is the largest nodal shear traction over mu
    p0, where p0 is the peak pressure; `shear_spurious_inner` is the largest one for x < 0.8 a,
    where a is the half width of the contact. A nodal traction is the nodal force over the integral
    of the node's test function.

    Args:
        element: Element name such as "pw-hybrid-T6".
        n: Number of elements over the half width of the contact.
    """
    body = ElasticHalfSpace(YOUNGS_MODULUS, POISSONS_RATIO)
    force = np.pi * body.plane_strain_modulus / (4 * RADIUS)
    steps = [HertzLine(body, RADIUS, force * (k + 1) / N_LOAD_STEPS) for k in range(N_LOAD_STEPS)]
    per_half_width = n + EDGE_POSITION  # number of elements
    lines = np.arange(np.ceil(CONTACT_ZONE * per_half_width) + 1) / per_half_width
    block = discretise(
        element,
        partial(mesh_graded_square, lines, BODY_SIZE),
        Material(YOUNGS_MODULUS, POISSONS_RATIO),
        StressState.PLANE_STRAIN,
    )
    space, exact = block.space, steps[-1]
    x = collapsed_displacement_space(space).tabulate_dof_coordinates()[:, :2]
    is_outer = np.isclose(x[:, 0], BODY_SIZE) | np.isclose(x[:, 1], -BODY_SIZE)
    outer_nodes = np.flatnonzero(is_outer).astype(np.int32)
    symmetry = prescribe(space, 0, lambda p: np.isclose(p[0], 0.0))

    # loads that replace the prescribed displacements of the half plane on the outer sides
    loads = []
    for step in steps:
        sides = prescribe_node_displacements(space, outer_nodes, step.displacement(x[outer_nodes]))
        load = block.K * block.supports([sides, symmetry]).offset
        load.scale(-1.0)
        loads.append(load)
    supports = block.supports(
        [prescribe_node_displacements(space, outer_nodes, 0 * x[outer_nodes]), symmetry]
    )

    def may_touch(p: Array) -> Mask:
        return np.isclose(p[1], 0.0) & (p[0] < lines[-1] * (1 + 1e-9))

    motions = [Motion((0.0, None), (0.0, -step.force / 2)) for step in steps]
    pair = ContactPair(may_touch, Parabola((0.0, 0.0), RADIUS), FRICTION, motions)
    states = solve_contact(block.K, loads, supports, pair, space)
    surface = SurfaceNodes.from_body(block.body, may_touch)
    (contact,) = states[-1].pairs
    position = contact.position[:, 0]
    shear = surface.pressure(-contact.force_tangential[:, 0]) / (FRICTION * exact.peak_pressure)
    pressure = surface.pressure(contact.force_normal) / exact.peak_pressure
    error = pressure - exact.pressure(position) / exact.peak_pressure
    scalars = {
        "shear_spurious": float(np.nanmax(np.abs(shear))),
        "shear_spurious_inner": float(np.nanmax(np.abs(shear[position < INNER_PART]))),
        "pressure_rms_all": float(np.sqrt(np.mean(error[position < 1] ** 2))),
        **_summarise_iterations_and_residuals(states),
    }
    curves = {"x": position, "shear": shear, "pressure": pressure, "status": contact.status}
    return Result(scalars, assign_unit_one_to_scalars(scalars), curves, dofs=block.K.getSize()[0])


def pushed(element: str, n: int) -> Result:
    """Press a rough rigid parabola on a nearly incompressible block, then push it in two steps.

    The scalar `stick` is the half width of the stick zone over the half width of the contact. On an
    incompressible half plane under normal force P and tangential force Q it is sqrt(1 - Q/(mu P))
    (Cattaneo, Mindlin).

    Args:
        element: Element name such as "pw-hybrid-T6".
        n: Number of elements over 1.3 half widths of the contact.
    """
    plane_modulus = BLOCK_MODULUS / (1 - POISSONS_RATIO**2)
    a = float(np.sqrt(4 * BLOCK_FORCE * BLOCK_RADIUS / (np.pi * plane_modulus)))
    zone, bottom = CONTACT_ZONE * a, -BLOCK_DEPTH * a
    block = discretise(
        element,
        partial(_mesh_block_instead_of_half_plane, a, n),
        Material(BLOCK_MODULUS, POISSONS_RATIO),
        StressState.PLANE_STRAIN,
    )

    def may_touch(p: Array) -> Mask:
        return np.isclose(p[1], 0.0) & (np.abs(p[0]) < zone * (1 + 1e-9))

    base = [prescribe(block.space, k, lambda p: np.isclose(p[1], bottom)) for k in (0, 1)]
    motions = [Motion((0.0, None), (0.0, -BLOCK_FORCE))]
    motions += [
        Motion((None, None), (q * FRICTION * BLOCK_FORCE, -BLOCK_FORCE)) for q in PUSH_FRACTIONS
    ]
    pair = ContactPair(may_touch, Parabola((0.0, 0.0), BLOCK_RADIUS), FRICTION, motions)
    no_load = [block.K.createVecLeft()] * len(motions)
    states = solve_contact(block.K, no_load, block.supports(base), pair, block.space)
    (contact,) = states[-1].pairs
    x, status = np.abs(contact.position[:, 0]), contact.status
    is_slipping = (status != STICK) & (status != OPEN)
    stick_half_width = (x[status == STICK].max() + x[is_slipping].min()) / 2
    scalars = {"stick": float(stick_half_width / a), **_summarise_iterations_and_residuals(states)}
    curves = {"x": contact.position[:, 0] / a, "status": status}
    return Result(scalars, assign_unit_one_to_scalars(scalars), curves, dofs=block.K.getSize()[0])


def _mesh_block_instead_of_half_plane(
    contact_half_width: float, n_zone_elements: int, cell: str
) -> Mesh:
    """Mesh a block that represents a half plane below a contact.

    Args:
        contact_half_width: Half width of the contact.
        n_zone_elements: Number of elements over the half width of the zone that may touch.
        cell: Cell type, "triangle" or "quadrilateral".
    """
    zone = CONTACT_ZONE * contact_half_width
    size = zone / n_zone_elements
    outside = (
        zone
        + geometrically_growing_lines(
            size * BLOCK_CELL_GROWTH, BLOCK_DEPTH * contact_half_width - zone, BLOCK_CELL_GROWTH
        )[1:]
    )
    right = np.concatenate([np.linspace(0, zone, n_zone_elements + 1), outside])
    depths = -geometrically_growing_lines(
        size, BLOCK_DEPTH * contact_half_width, BLOCK_CELL_GROWTH
    )[::-1]
    return mesh_along_lines(MPI.COMM_SELF, np.concatenate([-right[:0:-1], right]), depths, cell)


def _summarise_iterations_and_residuals(states: list[ContactState]) -> dict[str, float]:
    return {
        "iterations_most": float(max(state.iterations for state in states)),
        "iterations": float(sum(state.iterations for state in states)),
        "residual": max(state.residuals.largest() for state in states),
    }


# A seal at large strains. Both plates are flat and smooth, so that the vertical position of a node
# in contact is known. An active set of such nodes is updated by the signs of nodal forces and gaps:
# nodes in tension are released, and nodes that penetrate a plate are held.
#
# The reference is Lindley's formula (Engineer 218 (1964) 765; P. K. Freakley, A. R. Payne, "Theory
# and Practice of Engineering with Rubber" (1978)) for long cords of the diameter d and squeezes
# C d: the force E d (1.25 C^1.5 + 50 C^6) over the length, on a width of some 2.4 C d.

# Lengths over the cord's radius, stresses over the shear modulus
RING_RADIUS = 8.0
MAX_SQUEEZE, N_SQUEEZE_STEPS = 0.25, 10
"""Largest squeeze over the diameter of the ring's cross-section, and number of its increments."""
DEGREE = 6
"""Degree of quadrature for the O-ring."""
MAX_ACTIVE_SETS, MAX_RECAPTURES = 30, 2
"""Maximum number of active sets in a step, and of times that a node is held again within a step.

A node at the rim of the contact may be in tension if it is held and penetrate if it is released. It
is left free when the second maximum is reached.
"""


def seal(element: str, n: int) -> Result:
    """Squeeze an O-ring seal by a quarter of its cross-section's diameter, in ten steps.

    Args:
        element: Element name such as "pw-hybrid-T6".
        n: Number of cells over the radius of the cross-section (cell size 1/n).
    """
    ring = ORing(element, n)
    steps = np.arange(1, N_SQUEEZE_STEPS + 1) * MAX_SQUEEZE / N_SQUEEZE_STEPS
    plate_forces, n_sets, n_iterations = [], [], []
    for squeeze in steps:
        sets, iterations = ring.squeeze_to_half_height(1 - squeeze)
        plate_forces.append(-ring.nodal_forces()[ring.is_held_by_upper_plate, 1].sum())
        n_sets.append(sets)
        n_iterations.append(iterations)
    force = ring.nodal_forces()
    upper_force, lower_force = (
        force[ring.is_held_by_upper_plate, 1].sum(),
        force[ring.is_held_by_lower_plate, 1].sum(),
    )
    force_scale = 2 * np.pi * RING_RADIUS * 2 * 3  # length times E d
    lindley = 1.25 * steps**1.5 + 50 * steps**6
    x, pressure = ring.radii_and_pressures_on_upper_plate(force)
    order = np.argsort(x)
    is_midside_node = ring.is_midside_node[ring.is_held_by_upper_plate][order]
    x, pressure = x[order], pressure[order]
    nodal_force = -force[ring.is_held_by_upper_plate, 1][order]
    ratio = nodal_force / np.interp(x, x[~is_midside_node], nodal_force[~is_midside_node])
    scalars = {
        "force": plate_forces[-1] / force_scale,
        "force_lindley": float(lindley[-1]),
        "width": float(np.ptp(x)) / 2,
        "width_lindley": 2.4 * MAX_SQUEEZE,
        "balance": float(abs(upper_force + lower_force) / abs(upper_force)),
        "volume_error": ring.relative_volume_change(),
        "sawtooth": float(np.median(ratio[2:-2][is_midside_node[2:-2]])),
        "penetration": float(ring.max_penetration),
        "peak": float(pressure.max()),
        "sets": float(max(n_sets)),
        "newton_iterations": float(sum(n_iterations)),
    }
    curves = {
        "squeeze": steps,
        "force": np.array(plate_forces) / force_scale,
        "lindley": lindley,
        "x": x,
        "pressure": pressure,
        "nodal_force": nodal_force / nodal_force.mean(),
        "deformed": ring.x + ring.displacement,
        "body_pressure": ring.body_pressure,
        **mesh_nodes_and_cells(ring.space),
    }
    return Result(
        scalars, assign_unit_one_to_scalars(scalars), curves, dofs=len(ring.solution.x.array)
    )


class ORing:
    """Axisymmetric model of an O-ring of incompressible rubber between two rigid plates.

    The radius of the ring's cross-section is one, and contact is frictionless.

    Args:
        element: Element name such as "pw-hybrid-T6".
        n: Number of cells over the radius of the cross-section (cell size 1/n).

    Attributes:
        space: Mixed space of displacements and pressures.
        solution: Displacements and pressures.
        x: Positions (n, 2) of the undeformed nodes.
        is_midside_node: Mask (n,) of nodes that are not vertices.
        is_held_by_upper_plate: Mask (n,) of nodes in contact with the upper plate.
        is_held_by_lower_plate: Mask (n,) of nodes in contact with the lower plate.
        max_penetration: Largest penetration among nodes that were left free to end a cycle.
    """

    def __init__(self, element: str, n: int) -> None:
        mesh = mesh_with_gmsh(_add_ring_cross_section_disk, 2, 1 / n, order=2)
        pair = make_element_spaces(element, mesh)
        self.space, self.solution = pair.trial, fem.Function(pair.trial)
        self._displacements = SubSpace.displacements(self.space)
        self._pressures = SubSpace.pressure(self.space)
        self.x: Array = self._displacements.space.tabulate_dof_coordinates()[:, :2]
        self._is_outside: Mask = np.hypot(self.x[:, 0] - RING_RADIUS, self.x[:, 1]) > 1 - 1e-9
        vertices = self._pressures.space.tabulate_dof_coordinates()[:, :2]
        distance = np.abs(self.x[:, None] - vertices).max(axis=2).min(axis=1)
        self.is_midside_node: Mask = distance > 1e-9
        self.max_penetration = 0.0
        self.is_held_by_upper_plate: Mask = np.zeros(len(self.x), dtype=bool)
        self.is_held_by_lower_plate: Mask = self.is_held_by_upper_plate
        r = ufl.SpatialCoordinate(mesh)[0]
        u, p = ufl.split(self.solution)
        self._v, q = ufl.split(ufl.TestFunction(pair.test))
        self._circumference = 2 * np.pi * r
        rule = {"quadrature_degree": DEGREE}
        self._dx = ufl.dx(domain=mesh, metadata=rule)
        self._ds = ufl.ds(domain=mesh, metadata=rule)
        self._F = ufl.Identity(3) + _axisymmetric_gradient(u, r)
        self._J = ufl.det(self._F)
        inverse = ufl.inv(self._F).T
        stress = self._F - inverse - p * self._J * inverse
        residual = ufl.inner(stress, _axisymmetric_gradient(self._v, r)) - q * (self._J - 1)
        self._supports: list[fem.DirichletBC] = []
        self._problem = PetrovGalerkinProblem(
            residual * self._circumference * self._dx, self.solution, self._supports
        )

    @property
    def displacement(self) -> Array:
        """Nodal displacements (n, 2)."""
        return np.asarray(self.solution.x.array[self._displacements.unknowns])

    @property
    def body_pressure(self) -> Array:
        """Pressures (n,) in the rubber at the nodes, interpolated linearly between vertices."""
        p = fem.Function(self._pressures.space)
        at_nodes = fem.Function(fem.functionspace(self.space.mesh, ("Lagrange", 2)))
        p.x.array[:] = self.solution.x.array[self._pressures.unknowns[:, 0]]
        at_nodes.interpolate(p)
        return np.asarray(at_nodes.x.array)

    def nodal_forces(self) -> Array:
        """Return the forces (n, 2) of the plates on the nodes."""
        return np.asarray(self._problem.reactions().array_r[self._displacements.unknowns])

    def squeeze_to_half_height(self, half_height: float) -> tuple[int, int]:
        """Move the plates to y = height and y = -height; solve by an active-set iteration.

        Args:
            half_height: Half of the distance between the plates.

        Returns:
            Number of active sets, and number of Newton iterations.

        Raises:
            RuntimeError: If the active set has not converged.
        """
        iterations = 0
        y = self.x[:, 1] + self.displacement[:, 1]
        self.is_held_by_upper_plate, self.is_held_by_lower_plate = (
            is_held | (self._is_outside & (side * y > half_height))
            for is_held, side in (
                (self.is_held_by_upper_plate, 1),
                (self.is_held_by_lower_plate, -1),
            )
        )
        n_catches = np.zeros(len(self.x), dtype=int)
        for n_sets in range(1, MAX_ACTIVE_SETS + 1):
            self._solve_with_nodes_held_by_plates(half_height)
            iterations += sum(len(part.relative_corrections) for part in self._problem.increments)
            force, y = self.nodal_forces()[:, 1], self.x[:, 1] + self.displacement[:, 1]
            penetrates = self._is_outside & (np.abs(y) > half_height)
            may_be_caught = penetrates & (n_catches < MAX_RECAPTURES)
            upper, lower = (
                np.where(is_held, side * force < 0, may_be_caught & (side * y > 0))
                for is_held, side in (
                    (self.is_held_by_upper_plate, 1),
                    (self.is_held_by_lower_plate, -1),
                )
            )
            n_catches[
                (upper & ~self.is_held_by_upper_plate) | (lower & ~self.is_held_by_lower_plate)
            ] += 1
            if np.array_equal(upper, self.is_held_by_upper_plate) and np.array_equal(
                lower, self.is_held_by_lower_plate
            ):
                is_released = penetrates & ~upper & ~lower
                penetration = (np.abs(y[is_released]) - half_height).max(initial=0.0)
                self.max_penetration = max(self.max_penetration, penetration)
                return n_sets, iterations
            self.is_held_by_upper_plate, self.is_held_by_lower_plate = upper, lower
        raise RuntimeError(
            f"the active set has not converged after {MAX_ACTIVE_SETS} solutions; "
            "use smaller squeeze steps or a finer mesh"
        )

    def _solve_with_nodes_held_by_plates(self, half_height: float) -> None:
        prescribed = fem.Function(self.space)
        vertical = self._displacements.unknowns[:, 1]
        for is_held, side in ((self.is_held_by_upper_plate, 1), (self.is_held_by_lower_plate, -1)):
            prescribed.x.array[vertical[is_held]] = side * half_height - self.x[is_held, 1]
        dofs = np.sort(vertical[self.is_held_by_upper_plate | self.is_held_by_lower_plate])
        self._supports[:] = [fem.dirichletbc(prescribed, dofs)]
        self._problem.solve()

    def radii_and_pressures_on_upper_plate(self, force: Array) -> tuple[Array, Array]:
        """Return radii (m,) and contact pressures (m,) of the nodes on the upper plate.

        A pressure is the nodal force over the integral of the node's test function on the deformed
        surface.

        Args:
            force: Forces (n, 2) of the plates on all nodes.
        """
        normal = ufl.FacetNormal(self.space.mesh)
        outwards = ufl.as_vector([normal[0], normal[1], 0])
        area_vector = self._J * ufl.inv(self._F).T * outwards
        stretch = ufl.sqrt(ufl.inner(area_vector, area_vector))
        vertical = self._displacements.unknowns[:, 1]
        area = assemble_vector(stretch * self._v[1] * self._circumference * self._ds)
        x = self.x[:, 0] + self.displacement[:, 0]
        upper = self.is_held_by_upper_plate
        return x[upper], -force[upper, 1] / area.array_r[vertical][upper]

    def relative_volume_change(self) -> float:
        """Return the magnitude of the volume change of the ring over its undeformed volume."""
        change = assemble_scalar((self._J - 1) * self._circumference * self._dx)
        return float(abs(change) / (2 * np.pi**2 * RING_RADIUS))


def _axisymmetric_gradient(u: Expr, r: Expr) -> Expr:
    """Return the displacement gradient (3, 3) in cylindrical coordinates.

    Args:
        u: Axisymmetric displacement (u_r, u_z).
        r: Undeformed radius.
    """
    g = ufl.grad(u)
    return ufl.as_tensor([[g[0, 0], g[0, 1], 0], [g[1, 0], g[1, 1], 0], [0, 0, u[0] / r]])


def _add_ring_cross_section_disk() -> None:
    gmsh.model.occ.addDisk(RING_RADIUS, 0, 0, 1, 1)
