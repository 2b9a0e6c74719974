"""Partial slip of two equal spheres whose nodes match: Mindlin's problem."""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from pw_elements import Material, prescribe
from pw_elements.contact import STICK, ContactPair, Motion, Parabola, solve_contact
from pw_elements.contact.model import MatchingNodes
from study.meshes.mesh_lines import BODY_SIZE, mesh_lines_of_body_under_sphere
from study.meshes.solid_meshes import add_mirrored_body, mesh_box_along_lines, solid_cell_name
from study.run.store import Result
from study.solutions.half_space import ElasticHalfSpace, HertzSphere
from study.solutions.half_space_shear import MindlinSphere, force_that_gives_contact_radius_1
from study.solutions.solids import (
    INNER_PART,
    SolidBody,
    error_norms_at_standard_and_other_nodes,
    evaluate_pressure_errors_on_face,
)

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

# Lengths are divided by the contact radius, stresses by E
YOUNGS_MODULUS = 1.0
CURVATURE_RADIUS = 1e3
"""Radius of the relative curvature; the radius of each sphere is twice as large."""
FRICTION = 0.4
FRICTION_FRACTION = 0.5
"""Tangential force over the friction limit, Q/(mu P)."""
MESH_DISTANCE = 1.0
"""Initial distance between the meshes of the two spheres, so that no nodes coincide."""
MIN_BORDER_DISTANCE = 0.15
"""Minimum distance from the border of the stick zone of nodes at which shear is compared."""


def mindlin(element: str, elements: int, poissons_ratio: float = 0.0) -> Result:
    """Press two equal spheres together, then push one along x; one half of them is modelled.

    The displacements of half spaces under the exact tractions are prescribed on the outer sides.
    Shear errors are relative to mu p0, where p0 is the peak pressure, and exclude nodes near the
    border of the stick zone. The scalar `sticking_area_own` is the sum of the sticking nodes'
    test-function integrals over the sum for the nodes inside the exact stick disc; `stick_radius`
    is the result of `fit_stick_radius_to_unused_friction` over the exact radius.

    Args:
        element: Element name such as "pw-T10" or "galerkin-T10".
        elements: Number of elements along the contact radius.
        poissons_ratio: Poisson's ratio of both bodies; Mindlin's solution is exact for 0.
    """
    body = ElasticHalfSpace(YOUNGS_MODULUS, poissons_ratio)
    sphere = HertzSphere(
        body, 2 * CURVATURE_RADIUS, force_that_gives_contact_radius_1(body, 2 * CURVATURE_RADIUS)
    )
    exact = MindlinSphere(sphere, FRICTION, FRICTION_FRACTION)
    lines = mesh_lines_of_body_under_sphere(elements)
    x_lines = np.concatenate([-lines.horizontal[:0:-1], lines.horizontal])
    lower = mesh_box_along_lines(
        solid_cell_name(element), x_lines, lines.horizontal, lines.vertical
    )
    mesh = add_mirrored_body(lower, MESH_DISTANCE)
    solid = SolidBody.from_mesh(element, mesh, Material(YOUNGS_MODULUS, poissons_ratio))

    def make_contact_face_marker(height: float) -> Callable[[Array], Mask]:
        def is_on_contact_face(p: Array) -> Mask:
            is_near = np.maximum(np.abs(p[0]), p[1]) < lines.contact_zone_size + 1e-9
            return np.isclose(p[2], height) & is_near

        return is_on_contact_face

    def is_outer_side(p: Array) -> Mask:
        ends = np.isclose(np.abs(p[2] - MESH_DISTANCE / 2), BODY_SIZE + MESH_DISTANCE / 2)
        return ends | np.isclose(np.abs(p[0]), BODY_SIZE) | np.isclose(p[1], BODY_SIZE)

    def make_far_displacement_function(is_pushed: bool) -> Callable[[Array], Array]:
        def evaluate_exact_displacement(x: Array) -> Array:
            is_upper = (x[:, 2] > MESH_DISTANCE / 2)[:, None]
            mirrored = [0.0, 0.0, MESH_DISTANCE] + x * [-1.0, 1.0, -1.0]
            u = exact.displacement(np.where(is_upper, mirrored, x), is_pushed)
            return np.where(is_upper, u * [-1.0, 1.0, -1.0], u)

        return evaluate_exact_displacement

    symmetry = prescribe(solid.space, 1, lambda p: np.isclose(p[1], 0.0))
    shape = Parabola((0.0, 0.0, 0.0), CURVATURE_RADIUS)
    upper = MatchingNodes(
        make_contact_face_marker(MESH_DISTANCE), shape, offset=(0.0, 0.0, MESH_DISTANCE)
    )
    # loads replace the prescribed far displacements, which differ between the increments
    loads = [
        solid.load_equivalent_to_prescribed_faces(
            is_outer_side, make_far_displacement_function(pushed)
        )
        for pushed in (False, True)
    ]
    sides = [prescribe(solid.space, i, is_outer_side) for i in range(3)]
    supports = solid.supports([symmetry, *sides])
    depth = -2 * exact.normal_contact.approach
    motions = [Motion((0.0, 0.0, depth)), Motion((2 * exact.tangential_approach, 0.0, depth))]
    pair = ContactPair(make_contact_face_marker(0.0), upper, FRICTION, motions)
    states = solve_contact(solid.K, loads, supports, [pair], solid.space)

    surface, standard = faces = solid.surface_nodes_with_own_and_standard_weights(
        make_contact_face_marker(0.0)
    )
    forces = solid.nodal_forces(states[-1], loads[-1], make_contact_face_marker(0.0))
    forces = forces * [1.0, 1.0, -1.0]  # normal components are positive in compression
    r = np.linalg.norm(surface.position[:, :2], axis=1)
    is_compared = (r < INNER_PART) & (np.abs(r - exact.stick_radius) > MIN_BORDER_DISTANCE)
    tractions = surface.pressure(forces)
    shear_error = np.abs(tractions[:, 0] - exact.shear(r)) / (
        FRICTION * exact.normal_contact.peak_pressure
    )
    scalars = error_norms_at_standard_and_other_nodes(
        "shear_error", np.where(is_compared, shear_error, np.nan), standard
    )
    if solid.T is None:  # with T, the stick zone is that of the standard element and is left out
        sticks = states[-1].pairs[0].status == STICK
        exact_area = surface.weight_area[r < exact.stick_radius].sum()
        scalars["sticking_area_own"] = surface.weight_area[sticks].sum() / exact_area
        scalars["stick_radius"] = (
            fit_stick_radius_to_unused_friction(r, tractions, sticks) / exact.stick_radius
        )
    return evaluate_pressure_errors_on_face(
        states,
        solid,
        faces,
        forces,
        exact.pressure(r),
        exact.normal_contact.peak_pressure,
        INNER_PART,
        force_error=abs(2 * forces[:, 2].sum() / exact.normal_contact.force - 1),
        shear_force_error=abs(2 * forces[:, 0].sum() / exact.tangential_force - 1),
        **scalars,
    )


def fit_stick_radius_to_unused_friction(
    distance_from_axis: Array, tractions: Array, sticks: Mask
) -> float:
    """Return the radius at which the unused friction, extrapolated from sticking nodes, vanishes.

    In Mindlin's solution (mu p - |t|)^2 is a linear function of r^2. A straight line is fitted to
    this quantity at the sticking nodes. Interpolation to the first slipping node, in contrast,
    would depend on the positions of the nodes.

    Args:
        distance_from_axis: Distances (m,) of the nodes from the axis.
        tractions: Tractions (m, 3), whose last component is the pressure; NaN at nodes whose test
            function has no integral over the surface.
        sticks: Mask (m,) of the sticking nodes.
    """
    unused = FRICTION * tractions[:, 2] - np.linalg.norm(tractions[:, :2], axis=1)
    is_fitted = sticks & np.isfinite(unused)
    slope, intercept = np.polyfit(distance_from_axis[is_fitted] ** 2, unused[is_fitted] ** 2, 1)
    return float(np.sqrt(intercept / -slope))
