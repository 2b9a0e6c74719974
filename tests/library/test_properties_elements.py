"""Properties of the elements, tested by Hypothesis on random meshes."""

import functools
import gc
import weakref

import numpy as np
import pytest
from dolfinx import fem
from hypothesis import assume, event, given
from hypothesis import strategies as st

from pw_elements import (
    Material,
    Reduction,
    TooFewModes,
    as_function,
    assemble_matrix,
    assemble_vector,
    boundary_measure,
    buckling,
    force_transfer,
    reactions,
    solve,
    vibration_modes,
)
from pw_elements.contact import ContactPair, Motion, Sphere, solve_contact
from pw_elements.spaces import piecewise_linear_sub_cell_element
from tests.library.properties import (
    SPACE_MAKERS_BY_METHOD,
    PlacedElasticBody,
    assert_small,
    boundary_dofs,
    eigenvalue_and_error_bound,
    max_nonzeros_per_row,
    rigid_modes,
    to_dense_array,
)
from tests.library.random_meshes import (
    BODY_CELL_NAMES,
    CELL_NAMES,
    LENGTH_UNIT_STRATEGY,
    MACHINE_EPSILON,
    SEED_STRATEGY,
    YOUNGS_MODULUS_STRATEGY,
    AffinePlacement,
    grids,
    log_uniform_strategy,
    match_nodes,
    random_cell_points,
    random_deformation_gradient,
    random_rotation_matrix,
    structured_grid,
)

pytestmark = pytest.mark.random

cached_weight_element = functools.cache(piecewise_linear_sub_cell_element)
STRESS_STATES_BY_DIMENSION = {2: ("plane stress", "plane strain"), 3: ("solid",)}


@st.composite
def random_bodies(draw, cells=BODY_CELL_NAMES, methods=tuple(SPACE_MAKERS_BY_METHOD)):
    """Draw a skewed body of random material on a random mesh."""
    grid = draw(grids(cells))
    return PlacedElasticBody(
        grid,
        AffinePlacement(1.0, random_deformation_gradient(grid.dim, draw(SEED_STRATEGY))),
        draw(st.sampled_from(methods)),
        draw(st.sampled_from(STRESS_STATES_BY_DIMENSION[grid.dim])),
        Material(draw(YOUNGS_MODULUS_STRATEGY), draw(st.floats(-0.5, 0.45))),
    )


@given(st.sampled_from(CELL_NAMES), SEED_STRATEGY)
def test_weights_sum_to_one_and_reproduce_linear_functions(cell, seed):
    element, points = cached_weight_element(cell), random_cell_points(cell, 20, seed)
    nodes = element._element.points
    values, *slopes = element.tabulate(1, points)
    # sums of at most 27 numbers of size one, each of which is computed from 27 others
    bound = len(nodes) ** 2 * MACHINE_EPSILON
    assert values.min() > -bound
    assert_small(values.sum(axis=1) - 1, bound)
    assert_small(values @ nodes - points, bound)
    for axis, slope in enumerate(slopes):
        bound = len(nodes) ** 2 * MACHINE_EPSILON * np.abs(slope).max()
        assert_small(slope.sum(axis=1), bound)
        assert_small(slope @ nodes - np.eye(nodes.shape[1])[axis], bound)


@given(random_bodies(), SEED_STRATEGY)
def test_load_vectors_have_the_resultant_and_moment_of_the_loads(elastic, seed):
    dim, A, body = elastic.grid.dim, elastic.placement.matrix, elastic.body
    force = np.random.default_rng(seed).uniform(-1, 1, dim)
    side = np.eye(dim)[0]
    volume = np.linalg.det(A)  # volume of the skewed unit box; `area` is that of its side x = 0
    area = volume * np.linalg.norm(np.linalg.solve(A.T, side))
    centre = np.full(dim, 0.5)
    surface = boundary_measure(body.spaces.mesh, elastic.side_marker(0))
    for form, size, middle in [
        (body.body_load(force), volume, A @ centre),
        (body.surface_load(force, surface), area, A @ (centre - side / 2)),
    ]:
        f = assemble_vector(form).array.reshape(-1, dim)
        # the relative error of each term is the round-off of its cell's size
        bound = len(f) * elastic.relative_gradient_round_off * np.abs(f).sum()
        assert_small(f.sum(axis=0) - size * force, bound)
        assert_small(elastic.x.T @ f - size * np.outer(middle, force), bound * 4)
    # node by node, the load equals the mass of density one times a uniform acceleration
    f = assemble_vector(body.body_load(force)).array
    needed = to_dense_array(assemble_matrix(body.mass())) @ np.tile(force, len(f) // dim)
    assert_small(needed - f, len(f) * elastic.relative_gradient_round_off * np.abs(f).max())


@given(random_bodies())
def test_stiffness_is_blind_to_rigid_motions_and_gives_balanced_forces(elastic):
    K, modes = to_dense_array(elastic.K), rigid_modes(elastic.x)
    modes = modes.reshape(len(K), -1)
    bound = (
        max_nonzeros_per_row(K) * elastic.relative_gradient_round_off * np.abs(K).sum(axis=1).max()
    )
    assert_small(K @ modes, bound)
    # forces of any displacement have no resultant, and no moment about the undeformed nodes
    bound = len(K) * elastic.relative_gradient_round_off * np.abs(K).sum(axis=0).max()
    assert_small(modes.T @ K, bound)


@given(grids(("triangle", "quadrilateral")), st.sampled_from(list(SPACE_MAKERS_BY_METHOD)))
def test_axisymmetric_stiffness_is_blind_to_the_translation_along_the_axis(grid, method):
    K = to_dense_array(PlacedElasticBody(grid, method=method, state="axisymmetric").K)
    axial_translation = np.tile([0.0, 1.0], len(K) // 2)
    bound = len(K) * grid.relative_gradient_round_off() * np.abs(K).sum(axis=1).max()
    assert_small(K @ axial_translation, bound)
    assert_small(axial_translation @ K, bound)
    # radial translations, however, strain the hoops
    assert np.abs(K @ (1 - axial_translation)).max() > 1e-3 * np.abs(K).max()


@given(
    grids(("triangle",)),
    SEED_STRATEGY,
    st.floats(-0.5, 0.45),
    st.sampled_from(STRESS_STATES_BY_DIMENSION[2]),
    YOUNGS_MODULUS_STRATEGY,
)
def test_new_stiffness_and_loads_are_transferred_galerkin_ones(grid, seed, nu, state, modulus):
    placement, material = (
        AffinePlacement(1.0, random_deformation_gradient(2, seed)),
        Material(modulus, nu),
    )
    galerkin, pw = (
        PlacedElasticBody(grid, placement, m, state, material) for m in ("galerkin", "pw")
    )
    T = to_dense_array(force_transfer(galerkin.space))
    K, K_pw = to_dense_array(galerkin.K), to_dense_array(pw.K)
    # each compared entry is a sum of entries of K, weighted by a row of T
    bound = max_nonzeros_per_row(K) * pw.relative_gradient_round_off * (np.abs(T) @ np.abs(K)).max()
    assert_small(T @ K - K_pw, bound)
    # a wrong T is detected: transposed, or with 1/6, 2/3, 1/6 in place of 1/8, 3/4, 1/8
    wrong = np.eye(len(T)) + (T - np.eye(len(T))) * 4 / 3
    for candidate in (T.T, wrong):
        assert np.abs(candidate @ K - K_pw).max() > 1e-3 * np.abs(K).max()
    force = np.random.default_rng(seed).uniform(-1, 1, 2)
    for load in ("body", "surface"):
        f, f_pw = (_assemble_load(elastic, load, force) for elastic in (galerkin, pw))
        bound = len(T) * pw.relative_gradient_round_off * np.abs(f_pw).max()
        assert_small(T @ f - f_pw, bound)
        assert np.abs(T.T @ f - f_pw).max() > 1e-3 * np.abs(f_pw).max()


def _assemble_load(elastic, load_kind, force):
    if load_kind == "body":
        return assemble_vector(elastic.body.body_load(force)).array
    surface = boundary_measure(elastic.body.spaces.mesh, elastic.side_marker(0))
    return assemble_vector(elastic.body.surface_load(force, surface)).array


@given(random_bodies(), SEED_STRATEGY)
def test_linear_displacement_fields_are_exact(elastic, seed):
    U, dim = elastic.space, elastic.grid.dim
    gradient = np.random.default_rng(seed).uniform(-1, 1, (dim, dim))
    exact = fem.Function(U)
    exact.interpolate(lambda x: gradient @ x[:dim])
    rim = boundary_dofs(U)
    assume(len(rim) < len(elastic.x))  # a cube of five tetrahedra has no inner node
    reduction, f = Reduction.dirichlet(U, [fem.dirichletbc(exact, rim)]), elastic.K.createVecLeft()
    a = solve(elastic.K, f, reduction)
    r = reactions(elastic.K, a, f).array.reshape(-1, dim)
    a = a.array.reshape(-1, dim)
    bound = elastic.bound_errors_of_displacements_and_forces(reduction, a, f.array)[0]
    assert_small(a - exact.x.array.reshape(-1, dim), bound)
    balance = np.einsum("nak,na->k", rigid_modes(elastic.x), r)
    assert_small(balance, len(r) * elastic.bound_round_off_of_forces(a))


@given(random_bodies(), SEED_STRATEGY)
def test_reactions_balance_the_loads(elastic, seed):
    force = np.random.default_rng(seed).uniform(-1, 1, elastic.grid.dim)
    a, r, f = elastic.solve_statics(force)
    balance = np.einsum("nak,na->k", rigid_modes(elastic.x), r + f)
    assert_small(balance, len(r) * elastic.bound_round_off_of_forces(a))
    # there are no reactions at nodes without supports
    free = to_dense_array(elastic.clamped_side_reduction().right).any(axis=1)
    assert_small(r.ravel()[free], elastic.bound_round_off_of_forces(a))


@st.composite
def unit_bodies_with_body_force(draw, cells=BODY_CELL_NAMES):
    """Draw a body of unit size with Young's modulus 1, and a body force (dim,)."""
    grid = draw(grids(cells))
    method, nu = draw(st.sampled_from(list(SPACE_MAKERS_BY_METHOD))), draw(st.floats(-0.5, 0.45))
    state = draw(st.sampled_from(STRESS_STATES_BY_DIMENSION[grid.dim]))
    force = np.random.default_rng(draw(SEED_STRATEGY)).uniform(-1, 1, grid.dim)
    return PlacedElasticBody(grid, AffinePlacement(), method, state, Material(1.0, nu)), force


def assert_same_solution(elastic, transformed, force, modulus):
    """Assert that a body and its transformed copy have the same displacements and reactions.

    They are compared after transformation, with a bound that follows from round-off.
    """
    placement, dim = transformed.placement, elastic.grid.dim
    a, r, f = elastic.solve_statics(force)
    # forces per volume scale like modulus / length, nodal forces like modulus times area
    b, s, _ = transformed.solve_statics(
        placement.map_vectors_by_matrix(force) * modulus / placement.unit
    )
    at = match_nodes(elastic.x, transformed.x, placement)
    # round-off of both bodies; the body far from the origin has the larger error of shape
    displacement_bound, forced = elastic.bound_errors_of_displacements_and_forces(
        elastic.clamped_side_reduction(),
        a,
        f,
        elastic.relative_gradient_round_off + transformed.relative_gradient_round_off,
    )
    assert_small(
        b / placement.unit - placement.map_vectors_by_matrix(a)[at], dim * displacement_bound
    )
    scale = modulus * placement.unit ** (dim - 1)
    assert_small(s / scale - placement.map_vectors_by_matrix(r)[at], dim * forced)


@given(unit_bodies_with_body_force(), LENGTH_UNIT_STRATEGY, YOUNGS_MODULUS_STRATEGY)
def test_same_statics_in_other_units(problem, unit, modulus):
    elastic, force = problem
    assert_same_solution(
        elastic, elastic.make_transformed_copy(AffinePlacement(unit), modulus), force, modulus
    )


@given(
    unit_bodies_with_body_force(),
    log_uniform_strategy(-2, 6),
    SEED_STRATEGY,
    st.booleans(),
    st.booleans(),
)
def test_same_statics_when_moved_rotated_and_renumbered(
    problem, max_offset, seed, is_rotated, is_renumbered
):
    """A body has the same solution after translation, rotation and renumbering.

    The body is moved away from the origin by up to 1e6 times its size.
    """
    elastic, force = problem
    moved_body = make_moved_copy(elastic, max_offset, seed, is_rotated, is_renumbered)
    assert_same_solution(elastic, moved_body, force, 1.0)


def make_moved_copy(elastic, max_offset, seed, is_rotated, is_renumbered):
    grid, dim = elastic.grid, elastic.grid.dim
    offset = max_offset * np.random.default_rng(seed).uniform(-1, 1, dim)
    placement = AffinePlacement(
        1.0, random_rotation_matrix(dim, seed) if is_rotated else np.eye(dim), offset
    )
    return elastic.make_transformed_copy(
        placement, grid=grid.make_renumbered_copy(seed) if is_renumbered else grid
    )


@given(unit_bodies_with_body_force(), SEED_STRATEGY)
def test_same_contact_when_rotated_and_renumbered(problem, seed):
    """A body in contact has the same solution after rotation and renumbering.

    The body is clamped on one side. In one increment, a ball is pressed with friction into the
    opposite side and moved along it.
    """
    elastic, _ = problem
    dim, down = elastic.grid.dim, np.array([-0.02, 0.01, 0.005])

    def solve_ball_contact(body):
        placement, above = body.placement, np.array([3.0, 0.45, 0.55])[:dim]
        ball = Sphere(placement.place_points(above), 2.0)
        motion = Motion(placement.map_vectors_by_matrix(down[:dim]).tolist())
        pair = ContactPair(body.side_marker(0, 1.0), ball, 0.2, [motion])
        load, supports = body.K.createVecLeft(), body.clamped_side_reduction()
        (state,) = solve_contact(body.K, load, supports, pair, body.space)
        return state.displacement.array.reshape(-1, dim), state.pairs[0].force

    moved_body = make_moved_copy(elastic, 1.0, seed, True, True)
    (a, force), (b, other_force) = solve_ball_contact(elastic), solve_ball_contact(moved_body)
    at = match_nodes(elastic.x, moved_body.x, moved_body.placement)
    event(f"touches: {force.any()}")
    assert_small(b - moved_body.placement.map_vectors_by_matrix(a)[at], 1e-8 * np.abs(a).max())
    assert_small(
        other_force - moved_body.placement.map_vectors_by_matrix(force), 1e-8 * np.abs(force).max()
    )


@given(
    unit_bodies_with_body_force(("triangle", "quadrilateral")),
    LENGTH_UNIT_STRATEGY,
    YOUNGS_MODULUS_STRATEGY,
    log_uniform_strategy(-12, 4),
)
def test_frequencies_scale_with_the_units(problem, unit, modulus, density):
    elastic, _ = problem
    rescaled = elastic.make_transformed_copy(AffinePlacement(unit), modulus, density)
    values = [
        vibration_modes(b.K, b.M, b.clamped_side_reduction()).eigenvalues[0]
        for b in (elastic, rescaled)
    ]
    K, M = (
        to_dense_array(rescaled.clamped_side_reduction().matrix(A))
        for A in (rescaled.K, rescaled.M)
    )
    wrong = len(K) * (elastic.relative_gradient_round_off + rescaled.relative_gradient_round_off)
    sizes = [wrong * np.linalg.norm(A, 2) for A in (K, M)]

    def index_of_lowest_positive_eigenvalue(mu):
        return np.argmin(np.where(mu.real > 0, mu.real, np.inf))

    exact, error = eigenvalue_and_error_bound(K, M, index_of_lowest_positive_eigenvalue, *sizes)
    error += 1e-11 * abs(exact)  # the solver stops at 1e-12 of its own residual
    # the eigenvalue is compared with SciPy's dense one, and with the one in units of 1
    assert_small(values[1] - exact, error)
    assert_small(values[0] * modulus / (density * unit**2) - values[1], 2 * error)


@given(
    unit_bodies_with_body_force(("triangle", "quadrilateral")),
    LENGTH_UNIT_STRATEGY,
    YOUNGS_MODULUS_STRATEGY,
    log_uniform_strategy(-6, 6),
)
def test_buckling_factors_do_not_depend_on_units(problem, unit, modulus, load):
    elastic, _ = problem
    rescaled, factors = elastic.make_transformed_copy(AffinePlacement(unit), modulus), []
    for body, pressure in ((elastic, 1.0), (rescaled, load * modulus)):
        top = boundary_measure(body.body.spaces.mesh, body.side_marker(0, 1.0))
        f = assemble_vector(body.body.surface_load((-pressure, 0.0), top))
        a = solve(body.K, f, body.clamped_side_reduction())
        stress = body.body.stress(as_function(body.space, a))
        K_sigma = assemble_matrix(body.body.geometric_stiffness(stress))
        try:
            factors.append(buckling(body.K, K_sigma, body.clamped_side_reduction()).factors[0])
        except TooFewModes:
            factors.append(None)
    event(f"buckles: {factors[0] is not None}")
    assert (factors[0] is None) == (factors[1] is None)
    assume(factors[0] is not None)
    K, S = (
        to_dense_array(rescaled.clamped_side_reduction().matrix(A)) for A in (rescaled.K, K_sigma)
    )
    bound = rescaled.bound_errors_of_displacements_and_forces(
        rescaled.clamped_side_reduction(),
        a.array,
        f.array,
        elastic.relative_gradient_round_off + rescaled.relative_gradient_round_off,
    )[0]
    # stresses have the relative error of displacement gradients, and K_sigma that of stresses
    wrong_S = bound / np.abs(a.array).max() * np.linalg.norm(S, 2)
    wrong_K = (
        len(K)
        * (elastic.relative_gradient_round_off + rescaled.relative_gradient_round_off)
        * np.linalg.norm(K, 2)
    )
    mu, error = eigenvalue_and_error_bound(-S, K, lambda mu: np.argmax(mu.real), wrong_S, wrong_K)
    error += 1e-11 * abs(mu)
    assert_small(1 / factors[1] - mu, error)
    assert_small(load / factors[0] - 1 / factors[1], 2 * error)


def test_vibration_modes_keep_no_form_alive():
    body = PlacedElasticBody(structured_grid("triangle", [np.linspace(0, 1, 3)] * 2))
    form = weakref.ref(body.K.getAttr("assembled").form)
    vibration_modes(body.K, body.M, body.clamped_side_reduction())
    del body
    gc.collect()
    assert form() is None
