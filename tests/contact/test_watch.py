"""Checks for large displacements and passing surfaces, and residuals of unloaded states."""

import logging
from itertools import pairwise

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx.mesh import CellType, create_box

from pw_elements import Spaces, assemble_vector
from pw_elements.contact import (
    ContactPair,
    FlatPunch,
    Motion,
    Parabola,
    Plane,
    SignedDistance,
    Sphere,
    SurfacePassed,
)
from pw_elements.contact.interface import integrate_outward_normals
from pw_elements.contact.model import SmallDisplacementMeasures
from pw_elements.contact.rescue.smallness import (
    measure_max_strain_and_rotation,
    prepare_gradients_at_vertices,
)
from pw_elements.meshes import curved_mesh, move_nodes, quadrilaterals, triangles
from study.model.elements import composite_spaces, serendipity_spaces
from tests.contact.cases import BlockOnFloor, ElasticBody, PunchedBlock, on_plane
from tests.contact.polyline import PolylineSurface
from tests.contact.test_matching import MatchingBlocks

BLOCK_4_BY_2 = BlockOnFloor(16)  # 4 x 2, on a clamped base in these tests
BASE_SUPPORTS = BLOCK_4_BY_2.make_clamping_supports(on_plane(1, 0.0))
BALL_ABOVE = Sphere((2, 3), 1)
PLATE_ABOVE = Plane((0, 2), (0, -1))


def solve_under_moved_surface(
    surface,
    *motions,
    friction=0.0,
    body=BLOCK_4_BY_2,
    supports=BASE_SUPPORTS,
    contact_face_height=2.0,
):
    """Return the states of the block under a surface that is moved by the given translations."""
    motions = [motion if isinstance(motion, Motion) else Motion(motion) for motion in motions]
    on_surface = on_plane(len(motions[0].translation) - 1, contact_face_height)
    return body.solve_contact(ContactPair(on_surface, surface, friction, motions), supports)


# -- strain and rotation ---------------------------------------------------------------------


def bend_points(points):
    """Map points by a smooth function that is invertible on the unit square and the unit cube."""
    return points + 0.08 * np.sin(2 * points[:, [1, 0, 2]] + np.array([0.0, 1.0, 2.0]))


def make_unit_square_mesh(build_mesh):
    return build_mesh(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (4, 3))


def make_unit_cube_mesh(cell_type):
    return create_box(MPI.COMM_SELF, [(0, 0, 0), (1, 1, 1)], (2, 2, 2), cell_type)


SPACE_MAKERS_BY_NAME = {
    "triangles": lambda: Spaces.galerkin(move_nodes(make_unit_square_mesh(triangles), bend_points)),
    "curved triangles": lambda: Spaces.petrov_galerkin(
        curved_mesh(make_unit_square_mesh(triangles), bend_points)
    ),
    "quadrilaterals": lambda: Spaces.petrov_galerkin(
        move_nodes(make_unit_square_mesh(quadrilaterals), bend_points)
    ),
    "8 nodes": lambda: serendipity_spaces(make_unit_square_mesh(quadrilaterals)),
    "composite": lambda: composite_spaces(
        move_nodes(make_unit_square_mesh(triangles), bend_points)
    ),
    "tetrahedra": lambda: Spaces.petrov_galerkin(
        move_nodes(make_unit_cube_mesh(CellType.tetrahedron), bend_points)
    ),
    "hexahedra": lambda: Spaces.galerkin(
        move_nodes(make_unit_cube_mesh(CellType.hexahedron), bend_points)
    ),
}


def make_nodal_vector_of_field(space, field_at_positions):
    """Return the vector of the nodal values of a field, given as a function of positions (n, 3)."""
    owned = space.dofmap.index_map.size_local
    values = field_at_positions(space.tabulate_dof_coordinates()[:owned])[
        :, : space.mesh.geometry.dim
    ]
    return PETSc.Vec().createWithArray(np.ascontiguousarray(values).ravel(), comm=MPI.COMM_SELF)


@pytest.mark.parametrize("name", SPACE_MAKERS_BY_NAME)
def test_uniform_gradients_are_measured_exactly(name):
    space = SPACE_MAKERS_BY_NAME[name]().trial
    dim = space.mesh.geometry.dim
    u, rng = fem.Function(space), np.random.default_rng(8)
    evaluate_gradients = prepare_gradients_at_vertices(u)
    rotation_gradient = np.zeros((3, 3))
    rotation_gradient[:2, :2] = [[0.0, -1e-3], [1e-3, 0.0]]
    shortening = np.zeros((3, 3))
    shortening[0, 0] = -0.02
    for A in [shortening, rotation_gradient, *rng.normal(size=(5, 3, 3))]:
        displacement = make_nodal_vector_of_field(space, lambda x, A=A: x @ A.T + 7.0)
        strain, rotation = measure_max_strain_and_rotation(evaluate_gradients, u, displacement)
        gradient = A[:dim, :dim]
        assert strain == pytest.approx(np.linalg.norm(gradient + gradient.T, 2) / 2, abs=1e-12)
        assert rotation == pytest.approx(np.linalg.norm(gradient - gradient.T, 2) / 2, abs=1e-12)


@pytest.mark.parametrize(
    "name", ["triangles", "quadrilaterals", "8 nodes", "composite", "tetrahedra"]
)
def test_outward_normals_of_flat_facets_are_integrals_of_shape_functions(name):
    space = SPACE_MAKERS_BY_NAME[name]().trial
    v = ufl.TestFunction(space)
    expected = assemble_vector(ufl.inner(ufl.FacetNormal(space.mesh), v) * ufl.ds).array
    normals = integrate_outward_normals(space)
    assert normals == pytest.approx(expected.reshape(normals.shape), abs=1e-14)
    assert np.abs(normals).max() > 0.01


# -- what states report ----------------------------------------------------------------------


def test_states_report_strain_rotation_and_slip():
    """States report the largest strain, rotation and slip.

    If a block of height h is compressed uniaxially by a depth d, the strain is d/h and the rotation
    is zero. The block widens and therefore slips along the plate.
    """
    supports = BLOCK_4_BY_2.make_supports((1, on_plane(1, 0.0)), (0, on_plane(0, 0.0)))
    shear_motion = Motion((-0.3, -0.02))
    first_state, resting_state, lifted_state = solve_under_moved_surface(
        PLATE_ABOVE, shear_motion, shear_motion, (3.0, 1.0), supports=supports
    )
    widened, edge = 0.3 * 0.01 * 4, 4 / 16
    expected = SmallDisplacementMeasures(0.01, 0.0, (0.3 + widened) / edge)
    assert vars(first_state.smallness) == pytest.approx(vars(expected), abs=1e-12)
    assert resting_state.smallness.slip == pytest.approx(0.0, abs=1e-12)  # slip of this increment
    assert lifted_state.smallness.slip == 0.0  # only touching nodes have a slip


def test_the_slip_of_matching_nodes_is_the_total_one():
    """States of matching nodes report the total slip since the undeformed state.

    The reason is that the pairing of the nodes never changes.
    """
    blocks = MatchingBlocks()
    problem = blocks.contact_problem(blocks.make_pair(0.0), blocks.base_supports)
    state, slips = problem.undeformed, []
    for translation_x in (0.02, 0.05):
        state = problem.step(
            state, blocks.traction_load((0.0, -0.1)), [Motion((translation_x, 0.0))]
        )
        (pair,) = state.pairs
        relative = np.abs(pair.displacement[:, 0] - translation_x).max()
        assert state.smallness.slip == pytest.approx(relative * 3)  # edges have a length of 1/3
        slips.append(state.smallness.slip)
    assert slips[1] == pytest.approx(0.15, rel=0.1)


def test_leaving_the_range_of_small_displacements_is_logged_once(caplog):
    with caplog.at_level(logging.WARNING, "pw_elements.contact"):
        solve_under_moved_surface(
            PLATE_ABOVE, (0, -0.001), (0, -0.2), (0, -0.25), (0, 0.0), friction=0.3
        )
    (record,) = caplog.records
    assert record.name == "pw_elements.contact"
    message = record.getMessage()
    assert message.startswith("increment 1 leaves the range of small displacements: largest strain")
    assert "(above 0.05)" in message


# -- surfaces that pass through ---------------------------------------------------------------

BALL_LEVEL_SET = SignedDistance(lambda x: (x[:, 0] - 2) ** 2 + (x[:, 1] - 3) ** 2 - 1)
TIP_POLYLINE = PolylineSurface([(6, 4), (2, 2), (-2, 4)])
SMALL_DOWNWARD_TRANSLATIONS = [(0, -0.1 * k) for k in range(1, 25)]

REFUSED_SURFACE_PATHS = {
    "ball pulls": (BALL_ABOVE, [(0, -1.1)], "passes through .* nodes at .1.125, 2., .1.25, 2"),
    "ball is below": (BALL_ABOVE, [(0, -2.2)], "passes through"),
    "ball is far below": (BALL_ABOVE, [(0, -1e3)], "passes through"),
    "ball in steps": (
        BALL_ABOVE,
        SMALL_DOWNWARD_TRANSLATIONS,
        "passes through .* nodes at .2, 2.;",
    ),
    "ball in fine steps": (
        BALL_ABOVE,
        [(0, -0.93 - 0.02 * k) for k in range(9)],
        "outwards|passes",
    ),
    "ball from afar": (BALL_ABOVE, [(0, 20), (0, -2.2)], "passes through"),
    "ball goes through sideways": (BALL_ABOVE, [(-4, -1), (4, -1.5)], "passes through"),
    "level set": (BALL_LEVEL_SET, [(0, -2.2)], "passes through"),
    "plate": (PLATE_ABOVE, [(0, -10)], "whole thickness .* at .0, 2., .0.125, 2."),
    "plate just through": (PLATE_ABOVE, [(0, -2.001)], "whole thickness"),
    "slanted plate": (Plane((0, 2), (0.3, -1)), [(0, -4)], "whole thickness"),
    "flat punch": (FlatPunch((2, 2), (0, -1), 1), [(0, -3)], "whole thickness"),
    "parabola": (Parabola((2, 2), 1), [(0, -3)], "whole thickness"),
    "tip": (TIP_POLYLINE, [(0, -3)], "whole thickness"),
}


@pytest.mark.parametrize("name", REFUSED_SURFACE_PATHS)
def test_surfaces_that_pass_through_the_body_are_refused(name):
    surface, motions, message = REFUSED_SURFACE_PATHS[name]
    with pytest.raises(SurfacePassed, match="contact pair 0 .*" + message) as caught:
        solve_under_moved_surface(surface, *motions)
    assert len(caught.value.states) < len(motions)


ALLOWED_SURFACE_PATHS = {
    "deep": (PLATE_ABOVE, [(0, -1.999998)]),
    "far along": (PLATE_ABOVE, [(1e2, -0.1)]),
    "lifted far": (PLATE_ABOVE, [(0, -0.1), (100, 1e5), (0, -0.1)]),
    "ball rolls by": (BALL_ABOVE, [(20, -0.01), (-30, -0.01), (0, -0.01)]),
    "ball comes from afar": (BALL_ABOVE, [(0, 1e5), (0, -0.01)]),
    "ball passes over the corner": (BALL_ABOVE, [(-3, -0.1), (0, -0.1)]),
    "ball goes round the side": (BALL_ABOVE, [(10, 0), (10, -10), (0, -10)]),
    "level set": (BALL_LEVEL_SET, [(5, -0.3), (-5, -0.3), (0, -0.3)]),
    "punch slides off": (FlatPunch((2, 2), (0, -1), 1), [(0, -0.1), (1.5, -0.1), (9, -5)]),
    "tip ploughs": (TIP_POLYLINE, [(-1, -0.2), (1, -0.2)]),
    "parabola": (Parabola((2, 2), 4), [(50, -0.1), (-50, -0.1), (0, -0.1)]),
}


@pytest.mark.parametrize("name", ALLOWED_SURFACE_PATHS)
def test_surfaces_may_move_freely_outside_the_body(name):
    surface, motions = ALLOWED_SURFACE_PATHS[name]
    states = solve_under_moved_surface(surface, *motions, friction=0.3)
    assert len(states) == len(motions)
    assert all(state.residuals.largest() < 1e-10 for state in states)


def test_a_plate_from_below_may_approach_the_far_side_as_far_as_one_from_above():
    options = {
        "supports": BLOCK_4_BY_2.make_clamping_supports(on_plane(1, 2.0)),
        "contact_face_height": 0.0,
    }
    assert solve_under_moved_surface(Plane((0, 0), (0, 1)), (0, 1.999998), **options)
    with pytest.raises(SurfacePassed, match="whole thickness"):
        solve_under_moved_surface(Plane((0, 0), (0, 1)), (0, 2.000002), **options)


@pytest.mark.parametrize("cell", [CellType.tetrahedron, CellType.hexahedron])
def test_surfaces_that_pass_through_the_thickness_are_refused_in_space(cell):
    mesh = create_box(MPI.COMM_SELF, [(0, 0, 0), (2, 2, 1)], (4, 4, 2), cell)
    body = ElasticBody(mesh, state="solid")
    options = {
        "body": body,
        "supports": body.make_clamping_supports(on_plane(2, 0.0)),
        "contact_face_height": 1.0,
    }
    plate, ball = Plane((0, 0, 1), (0, 0, -1)), Sphere((1, 1, 1.5), 0.5)
    assert solve_under_moved_surface(plate, (0, 0, -0.9), **options)[0].smallness.strain > 0.9
    assert solve_under_moved_surface(ball, (0, 0, -0.02), **options)
    for surface, depth, message in (
        (plate, 1.01, "whole thickness"),
        *((ball, depth, "passes through") for depth in (0.6, 1.6, 10.0)),
    ):
        with pytest.raises(SurfacePassed, match=message):
            solve_under_moved_surface(surface, (0, 0, -depth), **options)


def test_random_paths_through_the_body_agree_with_dense_sampling():
    """Balls on random paths are refused where dense sampling shows that they pass through the body.

    The paths lead above and below the top surface of the body. Paths close to the limit between
    both cases may be refused or not.
    """
    rng = np.random.default_rng(1)
    # nodes of the top, without those at the sides of the block
    x = BLOCK_4_BY_2.x[
        np.isclose(BLOCK_4_BY_2.x[:, 1], 2.0) & (np.abs(BLOCK_4_BY_2.x[:, 0] - 2) < 1.99)
    ]
    refusals = []
    for _ in range(20):
        translation = rng.uniform((-3, -3), (3, 0.2))
        centres = np.array([2.0, 3.0]) + np.linspace(0, 1, 4001)[:, None] * translation
        from_centres = x[:, None] - centres
        distance = np.linalg.norm(from_centres, axis=2)
        inside = 1 - distance
        upward_component = from_centres[:, :, 1] / distance
        passes_clearly = np.any((inside > 0.05) & (upward_component > 0.2))
        may_pass = np.any((inside > 0) & (upward_component > 0.1))
        message = ""
        try:
            solve_under_moved_surface(BALL_ABOVE, tuple(translation))
        except SurfacePassed as error:
            message = str(error)
        is_refused = "passes through" in message or "outwards" in message
        assert is_refused >= passes_clearly
        assert is_refused <= may_pass
        refusals.append(is_refused)
    assert 3 < sum(refusals) < 17


# -- residuals of unloaded states ------------------------------------------------------------


def test_states_carry_the_scale_of_their_history(tmp_path):
    """States carry the largest force and length of their history.

    A punch is pressed down and then released, in the end by tiny steps, until no force is left.
    """
    case = PunchedBlock()
    problem = case.contact_problem(case.punch_pair(0.6), case.base_supports)
    depths, states = (-0.2, -0.1, -1e-5, -1e-9, -1e-13, 0.0, 5.0, -0.05), [problem.undeformed]
    for depth in depths:
        motion = [Motion((0.01 if depth < -0.01 else 0.0, depth))]
        states.append(problem.step(states[-1], case.zero_load, motion))
    for previous, state in pairwise(states):
        assert state.scale.force >= previous.scale.force
        assert state.residuals.largest() < 1e-10
    largest_force = np.hypot(
        states[1].pairs[0].force_normal, np.abs(states[1].pairs[0].force_tangential[:, 0])
    ).max()
    assert states[-1].scale.force == pytest.approx(largest_force)
    assert states[-1].scale.length < 0.3  # the motion of the surface without contact is not counted
    problem.save(states[-2], tmp_path / "lifted.npz")
    loaded_state = problem.load(tmp_path / "lifted.npz")
    assert (loaded_state.scale, loaded_state.smallness) == (states[-2].scale, states[-2].smallness)
