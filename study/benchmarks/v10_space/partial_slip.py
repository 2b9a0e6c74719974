"""Partial slip of two equal spheres with matching nodes: Mindlin's problem."""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from pw_elements import Material, prescribe
from pw_elements.contact import STICK, ContactPair, Motion, Parabola, solve_contact
from pw_elements.contact.model import MatchingNodes
from study.meshes.mesh_lines import BODY_SIZE, graded_body_lines
from study.meshes.solid_meshes import mesh_box, solid_cell_name, with_mirror_image
from study.run.store import Result
from study.solutions.half_space import ElasticHalfSpace, HertzSphere
from study.solutions.half_space_shear import MindlinSphere, force_of_unit_hertz_contact
from study.solutions.solids import INNER_PART, Solid, error_norms_beside_standard, face_result

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
"""Distance between the two meshes, so that no nodes coincide."""
MIN_BORDER_DISTANCE = 0.15
"""Least distance from the border of the stick zone at which shear is compared."""


def mindlin(element: str, elements: int, poissons_ratio: float = 0.0) -> Result:
    """Press two equal spheres together, then push them along x; one half is modelled.

    The displacements of half spaces under the exact tractions are prescribed on outer sides. Errors
    of the shear are relative to mu p0 and exclude the border of the stick zone. `sticking_area_own`
    is the sum of the sticking nodes' weights over that of the nodes inside the exact disc;
    `stick_radius` is the radius of `fit_stick_radius` over the exact one.

    Args:
        element: Name of the element.
        elements: Number of elements along the contact radius.
        poissons_ratio: Poisson's ratio of both bodies; Mindlin's solution is exact for 0.
    """
    body = ElasticHalfSpace(YOUNGS_MODULUS, poissons_ratio)
    sphere = HertzSphere(
        body, 2 * CURVATURE_RADIUS, force_of_unit_hertz_contact(body, 2 * CURVATURE_RADIUS)
    )
    exact = MindlinSphere(sphere, FRICTION, FRICTION_FRACTION)
    lines = graded_body_lines(elements)
    x_lines = np.concatenate([-lines.horizontal[:0:-1], lines.horizontal])
    lower = mesh_box(solid_cell_name(element), x_lines, lines.horizontal, lines.vertical)
    mesh = with_mirror_image(lower, MESH_DISTANCE)
    solid = Solid.from_mesh(element, mesh, Material(YOUNGS_MODULUS, poissons_ratio))

    def on_contact_face(height: float) -> Callable[[Array], Mask]:
        def marker(p: Array) -> Mask:
            is_near = np.maximum(np.abs(p[0]), p[1]) < lines.contact_zone_size + 1e-9
            return np.isclose(p[2], height) & is_near

        return marker

    def is_outer_side(p: Array) -> Mask:
        ends = np.isclose(np.abs(p[2] - MESH_DISTANCE / 2), BODY_SIZE + MESH_DISTANCE / 2)
        return ends | np.isclose(np.abs(p[0]), BODY_SIZE) | np.isclose(p[1], BODY_SIZE)

    def far_displacement(is_pushed: bool) -> Callable[[Array], Array]:
        def displacement(x: Array) -> Array:
            is_upper = (x[:, 2] > MESH_DISTANCE / 2)[:, None]
            mirrored = [0.0, 0.0, MESH_DISTANCE] + x * [-1.0, 1.0, -1.0]
            u = exact.displacement(np.where(is_upper, mirrored, x), is_pushed)
            return np.where(is_upper, u * [-1.0, 1.0, -1.0], u)

        return displacement

    symmetry = prescribe(solid.space, 1, lambda p: np.isclose(p[1], 0.0))
    shape = Parabola((0.0, 0.0, 0.0), CURVATURE_RADIUS)
    upper = MatchingNodes(on_contact_face(MESH_DISTANCE), shape, offset=(0.0, 0.0, MESH_DISTANCE))
    # loads replace the prescribed far displacements, which differ between the increments
    loads = [
        solid.load_of_prescribed_faces(is_outer_side, far_displacement(pushed))
        for pushed in (False, True)
    ]
    sides = [prescribe(solid.space, i, is_outer_side) for i in range(3)]
    supports = solid.supports([symmetry, *sides])
    depth = -2 * exact.normal_contact.approach
    motions = [Motion((0.0, 0.0, depth)), Motion((2 * exact.tangential_approach, 0.0, depth))]
    pair = ContactPair(on_contact_face(0.0), upper, FRICTION, motions)
    states = solve_contact(solid.K, loads, supports, [pair], solid.space)

    surface, standard = faces = solid.own_and_standard_nodes(on_contact_face(0.0))
    forces = solid.nodal_forces(states[-1], loads[-1], on_contact_face(0.0))
    forces = forces * [1.0, 1.0, -1.0]  # normal components are positive in compression
    r = np.linalg.norm(surface.position[:, :2], axis=1)
    is_compared = (r < INNER_PART) & (np.abs(r - exact.stick_radius) > MIN_BORDER_DISTANCE)
    tractions = surface.pressure(forces)
    shear_error = np.abs(tractions[:, 0] - exact.shear(r)) / (
        FRICTION * exact.normal_contact.peak_pressure
    )
    scalars = error_norms_beside_standard(
        "shear_error", np.where(is_compared, shear_error, np.nan), standard
    )
    if solid.T is None:  # with T, the stick zone is that of the standard element and is left out
        sticks = states[-1].pairs[0].status == STICK
        exact_area = surface.weight_area[r < exact.stick_radius].sum()
        scalars["sticking_area_own"] = surface.weight_area[sticks].sum() / exact_area
        scalars["stick_radius"] = fit_stick_radius(r, tractions, sticks) / exact.stick_radius
    return face_result(
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


def fit_stick_radius(r: Array, tractions: Array, sticks: Mask) -> float:
    """Return the radius at which the unused friction of the sticking nodes vanishes.

    In Mindlin's solution (mu p - |t|)² is a linear function of r²; it is fitted to the sticking
    nodes. Interpolation would end at the first slipping node, and so depend on node positions.

    Args:
        r: Distances (m,) of the nodes from the axis.
        tractions: Tractions (m, 3), the last component the pressure; NaN at nodes without a weight.
        sticks: Mask (m,) of the sticking nodes.
    """
    unused = FRICTION * tractions[:, 2] - np.linalg.norm(tractions[:, :2], axis=1)
    is_fitted = sticks & np.isfinite(unused)
    slope, intercept = np.polyfit(r[is_fitted] ** 2, unused[is_fitted] ** 2, 1)
    return float(np.sqrt(intercept / -slope))
