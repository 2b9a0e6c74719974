"""Two deformable blocks in space at large sliding: balance, friction, symmetry, output, errors."""

import itertools
from dataclasses import replace
from functools import partial

from mpi4py import MPI

import numpy as np
import pytest
from dolfinx import fem
from dolfinx.mesh import CellType, create_box
from scipy.spatial.transform import Rotation

from pw_elements import Spaces, prescribe
from pw_elements.contact import (
    OPEN,
    SLIP,
    STICK,
    ContactFields,
    ContactPair,
    ContactProblem,
    DeformableSurface,
    Motion,
    SurfacePassed,
    write,
)
from pw_elements.contact.interface import SpaceSlidingMortar
from pw_elements.contact.interface.mortars import facing_in_space
from pw_elements.meshes import curved_mesh
from tests.contact.blocks_in_space import BLOCK_PATH, INITIAL_GAP, BlocksInSpace, add_mirror_image
from tests.contact.cases import (
    list_states_and_substates,
    make_finite_strain_unknown_and_residual,
    on_plane,
)
from tests.contact.sides_in_space import compare_mortar_with_verification
from tests.contact.two_bodies import join_meshes
from tests.library import vtx

FRICTION = 0.3
MATCHING_BOXES = ((-0.8, -0.6, -0.5), (0.8, 0.6, 0.0)), ((-0.4, -0.4, 0.0), (0.4, 0.4, 0.5))
SHAFT_RADIUS = 0.998
SHAFT_MOTIONS = [(0.0, 0.0), (0.02, 0.0), (0.02, 0.03), (0.02, 0.06)]
"""Radial displacements of the shaft's inner side, and its displacements along the axis."""
BLOCK_OPTIONS_BY_NAME = {
    "crowned": {},
    "flat": {"crown": 0.0},
    "matching": {"crown": 0.0, "boxes": MATCHING_BOXES},
    "lower slave": {"upper_is_slave": False},
    "nearly incompressible": {"element": "hybrid", "compressibility": 1e-3},
    "hexahedra": {"cell": CellType.hexahedron},
    "matching hexahedra": {"cell": CellType.hexahedron, "crown": 0.0, "boxes": MATCHING_BOXES},
    "nearly incompressible hexahedra": {
        "cell": CellType.hexahedron,
        "element": "hybrid",
        "compressibility": 1e-3,
    },
}


@pytest.fixture(scope="module", params=BLOCK_OPTIONS_BY_NAME)
def blocks_states_and_violations(request):
    """Return blocks, the states along their path, and the violations in all iterations.

    The violations of the contact law are given as pairs (increment, violation).
    """
    violations = []

    def record_violation(progress):
        if progress.state is None:
            violations.append((progress.increment, progress.violation * 1e-9))

    blocks = BlocksInSpace(
        friction=FRICTION, callback=record_violation, **BLOCK_OPTIONS_BY_NAME[request.param]
    )
    return blocks, blocks.slide(), violations


def test_blocks_slide_by_more_than_a_cell(blocks_states_and_violations):
    """Forces balance, each node obeys Coulomb's law, and Newton's method converges quadratically.

    Friction opposes the slip.
    """
    _, states, violations = blocks_states_and_violations
    for k, state in enumerate(states):
        (pair,) = state.pairs
        largest = np.abs(pair.force).max()
        assert np.abs(pair.opposite_force.sum(axis=0) + pair.force).max() < 1e-10 * largest
        shear, limit = np.linalg.norm(pair.force_tangential, axis=1), FRICTION * pair.force_normal
        slips = pair.status == SLIP
        error = np.where(slips, np.abs(shear - limit), shear - limit)
        assert error.max() < 1e-8 * np.abs(pair.force_vector).max()
        if not state.substates:  # slips are those since the last substate
            work = np.sum(pair.force_tangential * pair.slip, axis=1)
            expected_work = limit * np.linalg.norm(pair.slip, axis=1)
            assert np.abs(work + expected_work)[slips].max() < 1e-8 * largest
        assert np.abs(pair.slip[pair.status == STICK]).max(initial=0.0) < 1e-10
        previous, last = [violation for increment, violation in violations if increment == k][-2:]
        assert last < max(1e-11, 1e3 * previous**2)
    assert (pair.status == SLIP).sum() > 10
    assert np.abs(pair.slip).max() > 0.2  # half a cell of the upper block is 0.2
    ratio = np.linalg.norm(pair.force[:2]) / abs(pair.force[2])
    assert 0.9 * FRICTION < ratio < FRICTION


def test_the_verification_of_states_agrees_with_the_iteration(blocks_states_and_violations):
    blocks, states, _ = blocks_states_and_violations
    mortar = blocks.problem._large_strain_stepping.interface.mortars[0]
    positions = [mortar.x]
    for state in list_states_and_substates(states):
        fields = ContactFields.from_state(state, blocks.space)
        displacement = fields.displacement.x.array.reshape(-1, 3)
        positions.append(mortar.x + displacement[mortar.nodes])
    for start, end in itertools.pairwise(positions):
        assert max(compare_mortar_with_verification(mortar, start, end).values()) < 1e-10


def test_a_resumed_history_is_the_same_history(blocks_states_and_violations, tmp_path):
    blocks, states, _ = blocks_states_and_violations
    blocks.problem.save(states[1], tmp_path / "state.npz")
    loaded_state = blocks.problem.load(tmp_path / "state.npz")
    (state,) = blocks.slide(BLOCK_PATH[2:], loaded_state, BLOCK_PATH[1])
    for name in ("force_vector", "opposite_force", "slip", "status"):
        value, expected = getattr(state.pairs[0], name), getattr(states[-1].pairs[0], name)
        assert np.abs(value - expected).max() <= 1e-12 * np.abs(expected).max()


SYMMETRIC_CASES = pytest.mark.parametrize(
    ("axes", "path"),
    [((0,), [(0.0, 0.0, -0.04), (0.0, 0.1, -0.04)]), ((0, 1), [(0.0, 0.0, -0.05)])],
    ids=["half", "quarter"],
)


def slide_part_and_whole_model(axes, path):
    """Return the contact of a half or quarter model and of the whole model at the end of a path.

    For both models, the areas of the slave's nodes that face the master follow.
    """
    boxes = (
        ((0.0, -0.7 * (1 not in axes), -0.5), (0.7, 0.7, 0.0)),
        ((0.0, -0.3 * (1 not in axes), 0.0), (0.4, 0.3, 0.4)),
    )
    results = []
    for name in ("symmetry_axes", "mirror_axes"):
        blocks = BlocksInSpace(((2, 2, 1), (2, 2, 1)), boxes, **{name: axes})
        results.append(get_pair_and_facing_areas(blocks.problem, blocks.slide(path)[-1]))
    return results


def get_pair_and_facing_areas(problem, state):
    """Return the pair of a state, and the areas (m,) of its nodes that face the master."""
    (pair,) = state.pairs
    mortar = problem._large_strain_stepping.interface.mortars[0]
    displacement = state.displacement.array_r.reshape(-1, 3)[mortar.nodes]
    areas = mortar.linearise(mortar.x + displacement).areas
    return pair, areas[np.searchsorted(mortar.nodes[: mortar.n_slave_nodes], pair.node)]


def compare_part_and_whole_model(axes, results):
    """Return differences of forces, slips and gaps, lost fractions of areas, and a mask of nodes.

    The differences are the largest ones, by name, relative to the largest values. Areas (m,) that
    face the master in the whole model only are lost. The mask (m,) is that of nodes on planes of
    symmetry.
    """
    (part, part_areas), (whole, whole_areas) = results
    distance = np.linalg.norm(part.position[:, None] - whole.position, axis=2)
    same = distance.argmin(axis=1)
    assert distance.min(axis=1).max() < 1e-12
    on_planes = np.isclose(part.position[:, list(axes)], 0.0)
    n_images = 2.0 ** on_planes.sum(axis=1)
    differences = {}
    for name, factor in (("force_vector", n_images[:, None]), ("slip", 1.0), ("gap", 1.0)):
        value, expected = getattr(part, name) * factor, getattr(whole, name)[same].copy()
        if name == "force_vector":
            # forces along the normals of the planes are those of the supports
            value[:, list(axes)] *= ~on_planes
            expected[:, list(axes)] *= ~on_planes
        assert np.array_equal(np.isfinite(value), np.isfinite(expected))
        finite = np.isfinite(value)
        size = max(np.abs(expected[finite]).max(), 1e-3)
        differences[name] = np.abs(value - expected)[finite].max() / size
    for side in ("force_vector", "opposite_force"):
        expected = 2 ** len(axes) * getattr(part, side).sum(axis=0)
        expected[list(axes)] = 0.0
        error = np.abs(getattr(whole, side).sum(axis=0) - expected).max()
        differences[f"sum of {side}"] = error / np.abs(expected).max()
    return differences, 1 - n_images * part_areas / whole_areas[same], on_planes.any(axis=1)


@SYMMETRIC_CASES
def test_a_part_model_is_the_whole_model_if_no_triangles_across_planes_of_symmetry_are_paired(
    axes, path, monkeypatch
):
    """The only difference of both models are pairs of triangles on different sides of a plane."""

    def keep_pairs_on_same_side(x, slave_triangles, master_triangles, pairs):
        middles = (
            x[triangles[number]].mean(axis=1)[:, list(axes)]
            for triangles, number in zip((slave_triangles, master_triangles), pairs, strict=True)
        )
        same_side = (np.multiply(*middles) > 0).all(axis=1)
        return tuple(number[same_side] for number in pairs)

    find_pairs = SpaceSlidingMortar._find_near_facing_facet_pairs
    find_pairs_independently = facing_in_space._find_near_facing_sub_facets
    monkeypatch.setattr(
        SpaceSlidingMortar,
        "_find_near_facing_facet_pairs",
        lambda mortar, x: keep_pairs_on_same_side(
            x, mortar.sides.slave_sub_facets, mortar.sides.master_sub_facets, find_pairs(mortar, x)
        ),
    )
    monkeypatch.setattr(
        facing_in_space,
        "_find_near_facing_sub_facets",
        lambda sides, x: keep_pairs_on_same_side(
            x, sides.slave_sub_facets, sides.master_sub_facets, find_pairs_independently(sides, x)
        ),
    )
    results = slide_part_and_whole_model(axes, path)
    differences, lost, _ = compare_part_and_whole_model(axes, results)
    assert max(differences.values()) < 1e-11
    assert np.abs(lost).max() < 1e-11


@SYMMETRIC_CASES
def test_a_part_model_has_the_forces_of_the_whole_model(axes, path):
    """They differ by less than the largest fraction of a node's area that the part model loses.

    Triangles of the slave are projected along their own normals. Where these are not parallel to a
    plane of symmetry, a strip beside it faces the mirror image of the master, which the part model
    lacks. Its width is the distance of the sides times the normal's component across the plane.
    Weighted means over the areas of nodes, as gaps and forces, change by the lost fraction at most.
    """
    results = slide_part_and_whole_model(axes, path)
    differences, lost, on_planes = compare_part_and_whole_model(axes, results)
    assert lost.max() < 1e-4
    assert max(differences.values()) < lost.max()
    assert max(differences[f"sum of {side}"] for side in ("force_vector", "opposite_force")) < 1e-7
    # other nodes lose nothing; their areas change with the positions
    assert np.abs(lost[~on_planes]).max() < 1e-2 * lost.max()


def push_shaft_through_bore(is_whole):
    """Widen a shaft in a bore and push it through, and return its contact and facing areas.

    Both are sectors of 90 or, if `is_whole`, 180 degrees about the z axis. The plane of symmetry,
    on which supports hold the sector of 90 degrees, is y = 0.
    """

    def make_sector(inner, outer, divisions):
        corners = (inner[0], 0.0, inner[1]), (outer[0], np.pi / 2, outer[1])
        mesh = create_box(MPI.COMM_SELF, corners, divisions, CellType.tetrahedron)
        if is_whole:
            mesh = add_mirror_image(mesh, axis=1)
        return curved_mesh(
            mesh,
            lambda x: np.column_stack(
                [x[:, 0] * np.cos(x[:, 1]), x[:, 0] * np.sin(x[:, 1]), x[:, 2]]
            ),
        )

    shaft = make_sector((0.5, -0.1), (SHAFT_RADIUS, 0.7), (1, 2, 1))
    mesh = join_meshes(shaft, make_sector((1.0, 0.0), (1.6, 0.8), (1, 3, 2)))
    spaces = Spaces.petrov_galerkin(mesh)
    u, residual = make_finite_strain_unknown_and_residual(spaces, quadrature_degree=4)
    x = spaces.trial.tabulate_dof_coordinates()
    radius = np.hypot(x[:, 0], x[:, 1])
    inside, outside = (np.flatnonzero(np.isclose(radius, r)).astype(np.int32) for r in (0.5, 1.6))
    displacement = fem.Function(spaces.trial)
    supports = [fem.dirichletbc(displacement, nodes) for nodes in (inside, outside)]
    if not is_whole:
        supports.insert(0, prescribe(spaces.trial, 1, on_plane(1, 0.0)))
    bore, shaft_side = (
        partial(lambda x, r: np.isclose(np.hypot(x[0], x[1]), r), r=r) for r in (1.0, SHAFT_RADIUS)
    )
    pair = ContactPair(bore, DeformableSurface(shaft_side), friction=0.2)
    problem = ContactProblem.of_residual(residual, u, supports, pair)
    state = problem.undeformed
    for start, end in itertools.pairwise(SHAFT_MOTIONS):

        def move_shaft(load_factor, start=start, end=end):
            widening, push = (1 - load_factor) * np.array(start) + load_factor * np.array(end)
            moved = displacement.x.array.reshape(-1, 3)[inside]
            moved[:, :2], moved[:, 2] = widening * x[inside, :2] / 0.5, push
            displacement.x.array.reshape(-1, 3)[inside] = moved

        state = problem.step(state, move_shaft)
        assert not state.substates
    return get_pair_and_facing_areas(problem, state)


def test_half_of_a_fit_that_slides_along_a_plane_of_symmetry_is_the_whole_fit():
    """The sides are curved across the plane of symmetry, so that slips point slightly out of it."""
    results = [push_shaft_through_bore(is_whole) for is_whole in (False, True)]
    differences, lost, _ = compare_part_and_whole_model((1,), results)
    assert all((pair.status == SLIP).all() for pair, _ in results)
    assert lost.max() < 1e-7
    assert max(differences[name] for name in ("force_vector", "gap")) < lost.max()
    assert differences["slip"] < 1e-6


def slide_block_in_from_beside(rotation_vector):
    """Return blocks, and the state after one increment in which nodes come in from beside.

    Half of the upper block is beside the lower one at the start. It is moved over it and pressed
    onto it, while base and top are rotated together.
    """
    boxes = ((-0.9, -0.7, -0.5), (0.9, 0.7, 0.0)), ((0.5, -0.4, 0.0), (1.3, 0.35, 0.5))
    blocks = BlocksInSpace(boxes=boxes, divisions=((3, 2, 1), (2, 2, 1)), crown=0.0)
    displacement, x = fem.Function(blocks.space), blocks.owned_positions
    base, top = (np.isclose(x[:, 2], height) for height in (-0.5, 0.5))
    blocks.conditions[:] = [
        fem.dirichletbc(displacement, np.flatnonzero(mask).astype(np.int32)) for mask in (base, top)
    ]

    def rotate_base_and_top(load_factor):
        moved = x + load_factor * np.where(top[:, None], [-0.45, 0.1, -0.05], 0.0)
        rotated = Rotation.from_rotvec(load_factor * np.array(rotation_vector)).apply(moved)
        displacement.x.array[:] = np.where((base | top)[:, None], rotated - x, 0.0).ravel()

    return blocks, blocks.problem.step(blocks.problem.undeformed, rotate_base_and_top)


@pytest.fixture(scope="module")
def unrotated_pair():
    blocks, state = slide_block_in_from_beside([0.0, 0.0, 0.0])
    return blocks, state.pairs[0]


@pytest.mark.parametrize("rotation_vector", [[0.0, 0.0, 0.3], [0.2, -0.3, 0.3]])
def test_friction_of_entering_nodes_turns_with_both_bodies(unrotated_pair, rotation_vector):
    """A rotation of both bodies in the increment turns all forces and slips with the bodies."""
    blocks, pair = unrotated_pair
    mortar = blocks.problem._large_strain_stepping.interface.mortars[0]
    faced = mortar.linearise(mortar.x).faces_master
    entered = ~faced[np.searchsorted(mortar.nodes[: mortar.n_slave_nodes], pair.node)]
    largest = np.abs(pair.force_vector).max()
    assert np.linalg.norm(pair.force_tangential[entered], axis=1).max() > 0.2 * largest
    _, state = slide_block_in_from_beside(rotation_vector)
    assert not state.substates
    rotation = Rotation.from_rotvec(rotation_vector)
    for name in ("force_vector", "opposite_force", "force_tangential", "slip"):
        values, expected = getattr(state.pairs[0], name), rotation.apply(getattr(pair, name))
        assert np.abs(values - expected).max() < 1e-10 * np.abs(expected).max()


def test_fields_contain_pressures_and_forces_of_both_sides(tmp_path):
    """A uniform pressure is transferred exactly between blocks with non-matching meshes.

    The blocks have the same width and lie between frictionless walls. All fields of both sides are
    written and, if the library for reading is installed, read.
    """
    boxes = ((0.0, 0.0, -0.5), (1.0, 0.8, 0.0)), ((0.0, 0.0, 0.0), (1.0, 0.8, 0.5))
    blocks = BlocksInSpace(((3, 2, 1), (2, 2, 1)), boxes, crown=0.0, friction=0.0)
    blocks.conditions[:0] = [
        prescribe(blocks.space, i, lambda x, i=i, end=end: np.isclose(x[i] * (end - x[i]), 0.0))
        for i, end in ((0, 1.0), (1, 0.8))
    ]
    states = blocks.slide([(0.0, 0.0, -0.05), (0.0, 0.0, -0.1)])
    fields = ContactFields.from_state(states[0], blocks.body)
    fields.fill(states[-1])
    (pair,) = states[-1].pairs
    forces = fields.force.x.array.reshape(-1, 3)
    assert np.abs(forces[pair.opposite_node] - pair.opposite_force).max() < 1e-15
    both_sides = np.concatenate([pair.node, pair.opposite_node])
    assert np.abs(forces[both_sides].sum(axis=0)).max() < 1e-12 * pair.force[2]
    mean_pressure = pair.force[2] / 0.8
    for function in (fields.pressure, fields.true_pressure, fields.tributary_pressure):
        values = function.x.array[both_sides]
        assert np.abs(values / mean_pressure - 1).max() < 1e-9, function.name
    (opposite_fields,) = fields.opposite
    assert opposite_fields.results(pair).tension_ratio < 1e-9
    refilled_fields = ContactFields.from_state(states[-1], blocks.body)
    for function, refilled in zip(fields.functions(), refilled_fields.functions(), strict=True):
        assert np.array_equal(function.x.array, refilled.x.array, equal_nan=True), function.name
    write(tmp_path / "blocks.bp", states, blocks.body)
    if vtx.load_adios2_library():
        (_, _), (_, step) = vtx.read_times_and_fields(tmp_path / "blocks.bp")
        assert np.nanmax(step["pressure"]) == pytest.approx(mean_pressure)
        pressed = step["pressure"] > 0.5 * mean_pressure
        assert pressed.sum() == len(both_sides)


@pytest.mark.parametrize("upper_is_slave", [True, False])
def test_a_block_slides_off_the_other_one(upper_is_slave):
    blocks = BlocksInSpace(upper_is_slave=upper_is_slave)
    path = [(0.0, 0.0, -0.06), (0.6, 0.0, -0.06), (1.6, 0.1, -0.06)]
    states = blocks.slide(path)
    assert all(state.pairs[0].force[2] * (2 * upper_is_slave - 1) > 1e-3 for state in states[:2])
    (pair,) = states[-1].pairs
    assert np.abs(pair.force_vector).max() < 1e-12
    assert (pair.status == OPEN).all()
    assert np.abs(pair.displacement - np.array(path[-1]) * upper_is_slave).max() < 1e-9


@pytest.mark.parametrize("upper_is_slave", [True, False])
def test_blocks_driven_through_each_other_are_refused(upper_is_slave):
    calls = []
    blocks = BlocksInSpace(upper_is_slave=upper_is_slave, callback=calls.append)
    with pytest.raises(SurfacePassed, match="the bodies are driven through"):
        blocks.slide([(0.0, 0.0, -2.0)])
    assert not calls


def test_unsupported_pairs_are_refused():
    blocks = BlocksInSpace()
    surface = blocks.pair.surface

    def on_bottom_and_one_side(x):
        return blocks.on_upper_bottom(x) | (np.isclose(x[0], 0.3) & (x[2] > INITIAL_GAP / 2))

    cases = [
        (replace(surface, coincident=True), {}, "`coincident` sides are supported for small"),
        (surface, {"nodes": on_bottom_and_one_side}, "has an edge at .*a pair of its own"),
        (surface, {"nodes": on_plane(2, 0.5)}, "faces the opposite part"),
    ]
    for case_surface, changes, message in cases:
        with pytest.raises(ValueError, match=message):
            blocks.make_problem(replace(blocks.pair, surface=case_surface, **changes))
    with pytest.raises(ValueError, match="cannot have free motions"):
        blocks.problem.step(blocks.problem.undeformed, motions=Motion((0.0, 0.0, None)))
