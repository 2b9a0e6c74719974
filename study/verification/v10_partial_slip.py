"""Partial slip of two equal bodies in space: Mindlin's sphere, with matching nodes."""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from pw_elements import Material, prescribe
from pw_elements.contact import STICK, ContactPair, Motion, Parabola, solve_contact
from pw_elements.contact.model import MatchingNodes
from study.meshes.mesh_lines import OUTER, graded
from study.meshes.solid_meshes import box, cell_of, with_mirror_image
from study.run.store import Result
from study.solutions.half_space import Elastic, HertzSphere
from study.solutions.half_space_shear import MindlinSphere, hertz_force
from study.solutions.solids import INNER, Solid, errors_beside, face_result

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

# Lengths over the contact's radius, stresses over E; both spheres have twice the radius of their
# relative curvature
YOUNGS_MODULUS, RADIUS = 1.0, 1e3
SHARE, SLIDING = 0.5, 0.4  # Q/(mu P), mu
DISTANCE = 1.0  # between both meshes
APART = 0.15  # from the border of the disc that sticks, where shear is compared


def mindlin(element: str, elements: int, poissons_ratio: float = 0.0) -> Result:
    """Half of two equal bodies, pressed and then pushed along x; they would slide at twice that.

    The outer sides have the displacements of half spaces under the known tractions. Errors of
    the shear are over mu p0, away from the border of the disc that sticks. `sticking_area_own` is
    the sum of the sticking nodes' own weights, over that of the nodes inside the exact disc.
    `stick_radius`, over the disc's, is where (mu p - |t|)² would vanish: the exact one is a
    straight line over r², and one is fitted through the nodes that stick. (Interpolation would
    reach zero at the first slipping node, and so count nodes again.)
    """
    body = Elastic(YOUNGS_MODULUS, poissons_ratio)
    known = MindlinSphere(
        HertzSphere(body, 2 * RADIUS, hertz_force(body, 2 * RADIUS)), SLIDING, SHARE
    )
    lines = graded(elements)
    along = np.concatenate([-lines.beside[:0:-1], lines.beside])
    lower = box(cell_of(element), along, lines.beside, lines.below)
    solid = Solid.of(
        element, with_mirror_image(lower, DISTANCE), Material(YOUNGS_MODULUS, poissons_ratio)
    )

    def facing(height: float) -> Callable[[Array], Mask]:
        def marker(p: Array) -> Mask:
            near = np.maximum(np.abs(p[0]), p[1]) < lines.zone + 1e-9
            return np.isclose(p[2], height) & near

        return marker

    def beyond(p: Array) -> Mask:
        ends = np.isclose(np.abs(p[2] - DISTANCE / 2), OUTER + DISTANCE / 2)
        return ends | np.isclose(np.abs(p[0]), OUTER) | np.isclose(p[1], OUTER)

    def field(pushed: bool) -> Callable[[Array], Array]:
        def displacement(x: Array) -> Array:
            upper = (x[:, 2] > DISTANCE / 2)[:, None]
            turned = np.where(upper, [0.0, 0.0, DISTANCE] + x * [-1.0, 1.0, -1.0], x)
            moved = known.displacement(turned, pushed)
            return np.where(upper, moved * [-1.0, 1.0, -1.0], moved)

        return displacement

    middle = prescribe(solid.space, 1, lambda p: np.isclose(p[1], 0.0))
    shape = Parabola((0.0, 0.0, 0.0), RADIUS)
    upper = MatchingNodes(facing(DISTANCE), shape, offset=(0.0, 0.0, DISTANCE))
    # two far fields: loads stand for their prescribed values
    loads = [solid.held_by_load(beyond, field(pushed)) for pushed in (False, True)]
    sides = [prescribe(solid.space, i, beyond) for i in range(3)]
    supports = solid.supports([middle, *sides])
    down = -2 * known.normal.approach
    motions = [Motion((0.0, 0.0, down)), Motion((2 * known.shift, 0.0, down))]
    pair = ContactPair(facing(0.0), upper, SLIDING, motions)
    states = solve_contact(solid.K, loads, supports, [pair], solid.space)

    surface, standard = faces = solid.faces(facing(0.0))
    forces = solid.nodal_forces(states[-1], loads[-1], facing(0.0))
    forces = forces * [1.0, 1.0, -1.0]  # pressing is positive, and pulling
    r = np.linalg.norm(surface.position[:, :2], axis=1)
    away = (r < INNER) & (np.abs(r - known.stick) > APART)
    tractions = surface.pressure(forces)
    off = np.abs(tractions[:, 0] - known.shear(r)) / (SLIDING * known.normal.peak)
    further = errors_beside("shear_error", np.where(away, off, np.nan), standard)
    if solid.T is None:  # else the standard element's zone
        sticks = states[-1].pairs[0].status == STICK
        inside = surface.weight_area[r < known.stick].sum()
        further["sticking_area_own"] = surface.weight_area[sticks].sum() / inside
        further["stick_radius"] = _vanishing(r, tractions, sticks) / known.stick
    return face_result(
        states,
        solid,
        faces,
        forces,
        known.pressure(r),
        known.normal.peak,
        INNER,
        force_error=abs(2 * forces[:, 2].sum() / known.normal.force - 1),
        shear_force_error=abs(2 * forces[:, 0].sum() / known.force - 1),
        **further,
    )


def _vanishing(r: Array, tractions: Array, sticks: Mask) -> float:
    """Radius at which what is left of friction at the sticking nodes would vanish."""
    left = SLIDING * tractions[:, 2] - np.linalg.norm(tractions[:, :2], axis=1)
    of = sticks & np.isfinite(left)
    slope, start = np.polyfit(r[of] ** 2, left[of] ** 2, 1)
    return float(np.sqrt(start / -slope))
