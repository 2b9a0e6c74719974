"""Contact in space: pressures on faces of tetrahedra and hexahedra against exact ones.

Corner nodes of a standard 10-node tetrahedron have no weight on its faces and carry nothing under
even pressure. Compared are the standard elements, those with piecewise-linear weights, and two
ways to even out the forces of the standard one, see `study.solutions.solids`.
"""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from dolfinx.mesh import Mesh
from scipy.spatial.transform import Rotation

from pw_elements import Material, prescribe
from pw_elements.contact import (
    ContactPair,
    FlatPunch,
    Motion,
    Parabola,
    Plane,
    solve_contact,
)
from study.meshes.mesh_families import on_cube
from study.meshes.mesh_lines import GROWTH, OUTER, depths, graded, growing
from study.meshes.solid_meshes import box, cell_of, quarter_disc
from study.run.cases import Case, mark_costly
from study.run.store import Result
from study.solutions.half_space import Elastic, FlatRound, HertzSphere, KnownContact
from study.solutions.half_space_shear import hertz_force
from study.solutions.solids import INNER, Solid, face_result
from study.verification.v10_partial_slip import mindlin

SECTION = "V10"
TITLE = "Contact in space"

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

# Lengths over the contact radius, stresses over E
YOUNGS_MODULUS, POISSONS_RATIO = 1.0, 0.3
RADIUS = 1e3  # of the sphere, so large that slopes are small
PRESSURE, SHEAR, FRICTION = 1e-3, 0.4e-3, 0.5  # of patch test and tilted block
SIDE = 0.25  # of their cells
MOVE = 0.12  # of nodes of hexahedra, over the side


def patch(element: str) -> Result:
    """A cube pressed evenly on a smooth rigid plane: uniaxial stress."""
    return _block(element, np.eye(3), 0.0, 0.0, POISSONS_RATIO)


def tilted(element: str) -> Result:
    """A cube askew in space on a rough rigid plane, pressed and pushed evenly, nu = 0."""
    return _block(element, _turn(), SHEAR, FRICTION, 0.0)


def sphere(element: str, elements: int, poissons_ratio: float = POISSONS_RATIO) -> Result:
    """A quarter of a rigid sphere on a half space, `elements` along its contact's radius."""
    body = Elastic(YOUNGS_MODULUS, poissons_ratio)
    known = HertzSphere(body, RADIUS, hertz_force(body, RADIUS))
    lines = graded(elements)
    mesh = box(cell_of(element), lines.beside, lines.beside, lines.below)

    def below(p: Array) -> Mask:
        return np.isclose(p[2], 0.0) & (np.maximum(p[0], p[1]) < lines.zone + 1e-9)

    paraboloid = Parabola((0.0, 0.0, 0.0), RADIUS)
    return _indented(element, mesh, known, paraboloid, below, _beyond_box)


def punch(element: str, elements: int) -> Result:
    """A quarter of a rigid circular flat punch on a half space; 2 x `elements` along its radius."""
    known = FlatRound(Elastic(YOUNGS_MODULUS, POISSONS_RATIO), 1.0, 1e-3)
    size = 0.5 / elements**2  # at the edge
    radii = 1 + growing(size, OUTER - 1, GROWTH)[1:]
    mesh = quarter_disc(cell_of(element), elements, radii, depths(size))

    def below(p: Array) -> Mask:
        return np.isclose(p[2], 0.0) & (np.hypot(p[0], p[1]) < 1 + 1e-9)

    def beyond(p: Array) -> Mask:
        # the middle of a straight side lies within the cylinder
        chord = OUTER * np.cos(np.pi / (8 * elements))
        return np.isclose(p[2], -OUTER) | (np.hypot(p[0], p[1]) > chord * (1 - 1e-9))

    face = FlatPunch((0.0, 0.0, 0.0), (0.0, 0.0, -1.0), 1.0)
    return _indented(element, mesh, known, face, below, beyond)


def _block(
    element: str, turn: Array, shear: float, friction: float, poissons_ratio: float
) -> Result:
    """A cube on a plane, turned in space, under even tractions; `shear` along its own x."""
    material = Material(YOUNGS_MODULUS, poissons_ratio)
    mesh = _cube(element)
    mesh.geometry.x[:] = mesh.geometry.x @ turn.T
    solid = Solid.of(element, mesh, material)

    def side(axis: int, end: float) -> Callable[[Array], Mask]:
        return lambda p: np.isclose(turn[:, axis] @ p, end, atol=1e-9)

    base = side(2, 0.0)
    # the stress, in the cube's own frame, and what it does on five of its sides
    stress = np.array([[0.0, 0.0, shear], [0.0, 0.0, 0.0], [shear, 0.0, -PRESSURE]])
    load = solid.surface_load(turn @ stress[:, 2], side(2, 1.0))
    if shear:
        for end, sign in ((0.0, -1.0), (1.0, 1.0)):
            load.axpy(sign, solid.surface_load(turn @ stress[:, 0], side(0, end)))
    conditions = []
    if not friction:  # symmetry planes; with friction contact alone holds the cube
        conditions = [prescribe(solid.space, i, side(i, 0.0)) for i in (0, 1)]
    plane = Plane((0.0, 0.0, 0.0), tuple(turn[:, 2]))
    pair = ContactPair(base, plane, friction)
    supports = solid.supports(conditions)
    states = solve_contact(solid.K, load, supports, [pair], solid.space)

    forces = solid.nodal_forces(states[-1], load, base) @ turn
    faces = solid.faces(base)
    off = np.abs(faces[0].pressure(forces)[:, 0] + shear) / PRESSURE
    return face_result(
        states,
        solid,
        faces,
        forces,
        np.full(len(forces), PRESSURE),
        PRESSURE,
        np.inf,
        force_error=float(np.linalg.norm(forces.sum(axis=0) + stress[:, 2])) / PRESSURE,
        **({"shear_error_max": np.nanmax(off)} if shear else {}),
    )


def _indented(
    element: str,
    mesh: Mesh,
    known: KnownContact,
    rigid: Parabola | FlatPunch,
    below: Callable[[Array], Mask],
    beyond: Callable[[Array], Mask],
) -> Result:
    """A quarter of a half space under a rigid indenter that moves to its known depth."""
    body = known.body
    solid = Solid.of(element, mesh, Material(body.youngs_modulus, body.poissons_ratio))

    def field(x: Array) -> Array:
        r = np.hypot(x[:, 0], x[:, 1])
        of_r = known.displacement(np.column_stack([r, x[:, 2]]))
        return np.column_stack([of_r[:, :1] * x[:, :2] / np.maximum(r, 1e-12)[:, None], of_r[:, 1]])

    def symmetry(axis: int) -> Callable[[Array], Mask]:
        return lambda p: np.isclose(p[axis], 0.0) & ~beyond(p)

    conditions = solid.held(beyond, field)
    conditions += [prescribe(solid.space, i, symmetry(i)) for i in (0, 1)]
    pair = ContactPair(below, rigid, 0.0, [Motion((0.0, 0.0, -known.approach))])
    nothing = solid.K.createVecLeft()
    supports = solid.supports(conditions)
    states = solve_contact(solid.K, nothing, supports, [pair], solid.space)
    faces = solid.faces(below)
    forces = -solid.nodal_forces(states[-1], nothing, below)
    r = np.linalg.norm(faces[0].position[:, :2], axis=1)
    with np.errstate(invalid="ignore"):
        exact = np.where(r < 1 - 1e-9, known.pressure(np.minimum(r, 1 - 1e-9)), 0.0)
    return face_result(
        states,
        solid,
        faces,
        forces,
        exact,
        1.5 * known.force / np.pi,
        INNER,
        force_error=abs(4 * forces[:, 2].sum() / known.force - 1),
    )


def _cube(element: str) -> Mesh:
    """Unit cube of unstructured tetrahedra, or of distorted hexahedra."""
    if cell_of(element) == "tetrahedron":
        return on_cube(element, SIDE)
    lines: Array = np.linspace(0, 1, round(1 / SIDE) + 1, dtype=np.float64)
    mesh = box("hexahedron", lines, lines, lines)
    x = mesh.geometry.x
    inside = ~np.isclose(np.abs(x - 0.5), 0.5)
    random = np.random.default_rng(1).uniform(-1, 1, (len(lines) ** 3, 3))
    number = np.rint(x / SIDE).astype(int) @ [len(lines) ** 2, len(lines), 1]
    x[:] += MOVE * SIDE * random[number] * inside
    return mesh


def _turn() -> Array:
    """A rotation about no axis of the mesh."""
    return np.asarray(Rotation.from_rotvec([0.5, -0.9, 0.4]).as_matrix())


def _beyond_box(p: Array) -> Mask:
    return np.isclose(p[2], -OUTER) | np.isclose(np.maximum(p[0], p[1]), OUTER)


TETRAHEDRA = ("galerkin-T10", "transferred-T10", "sibling-T10", "pw-T10")
ELEMENTS = (*TETRAHEDRA, "galerkin-H27", "pw-H27")
CASES = [
    Case("V10", f"{problem.__name__}-{element}", problem, {"element": element})
    for problem in (patch, tilted)
    for element in ELEMENTS
]
CASES += [
    Case(
        "V10",
        f"mindlin-{element}-3-nu0.3",
        mindlin,
        {"element": element, "elements": 3, "poissons_ratio": 0.3},
    )
    for element in ("galerkin-T10", "pw-T10")
]
CASES += [
    Case("V10", f"{problem.__name__}-{element}-{n}", problem, {"element": element, "elements": n})
    for problem, of in ((sphere, (3, 5)), (punch, (2, 4)), (mindlin, (2, 3)))
    for element in ELEMENTS
    for n in of
]
COMPARED = ("galerkin-T10", "sibling-T10", "pw-T10")
"""Of partial slip on the finer meshes."""


def _slipping(element: str, n: int) -> Case:
    return Case("V10", f"mindlin-{element}-{n}", mindlin, {"element": element, "elements": n})


CASES = mark_costly(
    CASES,
    *("mindlin-*-H27-3", "punch-*-H27-4", "sphere-*-H27-3", "*-H27-2", "*-H27"),
    *("*-transferred-*[234]", "*-transferred", "*-nu0.3"),
)
CASES += mark_costly([_slipping(element, n) for element in COMPARED for n in (4, 5, 6, 8)])
CASES += mark_costly(
    [_slipping(element, n) for element in ("galerkin-H27", "pw-H27") for n in (4, 5)]
)
