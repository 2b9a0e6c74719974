"""What holds for the elements on any mesh: hypothesis looks for one on which it does not."""

import functools

import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx.fem.petsc import interpolation_matrix
from dolfinx.mesh import exterior_facet_indices
from hypothesis import assume, given
from hypothesis import strategies as st

from pw_elements import (
    Material,
    Reduction,
    Spaces,
    assemble_matrix,
    assemble_vector,
    boundary_measure,
    force_transfer,
    reactions,
    solve,
)
from pw_elements.spaces import macro_element
from tests.library.properties import METHODS, Elastic, assert_small, dense, rigid_modes, terms
from tests.library.random_meshes import (
    BODIES,
    CELLS,
    EPS,
    MODULI,
    SEEDS,
    SIMPLICES,
    Placement,
    grids,
    points_within,
    skew,
)

pytestmark = pytest.mark.random

weights_of = functools.cache(macro_element)
STATES = {2: ("plane stress", "plane strain"), 3: ("solid",)}


@st.composite
def bodies(draw, cells=BODIES, methods=tuple(METHODS)):
    """A skewed body of any material on a random mesh."""
    grid = draw(grids(cells))
    return Elastic(
        grid,
        Placement(1.0, skew(grid.dim, draw(SEEDS))),
        draw(st.sampled_from(methods)),
        draw(st.sampled_from(STATES[grid.dim])),
        Material(draw(MODULI), draw(st.floats(-0.5, 0.45))),
    )


@given(st.sampled_from(CELLS), SEEDS)
def test_weights_sum_to_one_and_reproduce_linear_functions(cell, seed):
    element, points = weights_of(cell), points_within(cell, 20, seed)
    nodes = element._element.points
    values, *slopes = element.tabulate(1, points)
    # sums of at most 27 numbers of size one; each is made from 27 others
    bound = len(nodes) ** 2 * EPS
    assert values.min() > -bound
    assert_small(values.sum(axis=1) - 1, bound)
    assert_small(values @ nodes - points, bound)
    for axis, slope in enumerate(slopes):
        bound = len(nodes) ** 2 * EPS * np.abs(slope).max()
        assert_small(slope.sum(axis=1), bound)
        assert_small(slope @ nodes - np.eye(nodes.shape[1])[axis], bound)


@given(bodies(), SEEDS)
def test_loads_have_the_resultant_and_moment_of_what_they_stand_for(elastic, seed):
    dim, A, body = elastic.grid.dim, elastic.placement.matrix, elastic.body
    force = np.random.default_rng(seed).uniform(-1, 1, dim)
    side = np.eye(dim)[0]
    volume = np.linalg.det(A)  # of the skewed unit box; next, the area of its side x = 0
    area = volume * np.linalg.norm(np.linalg.solve(A.T, side))
    centre = np.full(dim, 0.5)
    surface = boundary_measure(body.spaces.mesh, elastic.side(0))
    for form, size, middle in [
        (body.body_load(force), volume, A @ centre),
        (body.surface_load(force, surface), area, A @ (centre - side / 2)),
    ]:
        f = assemble_vector(form).array.reshape(-1, dim)
        # each of the terms is right up to the round-off of its cell's size
        bound = len(f) * elastic.round_off * np.abs(f).sum()
        assert_small(f.sum(axis=0) - size * force, bound)
        assert_small(elastic.x.T @ f - size * np.outer(middle, force), bound * 4)
    # node by node: what the mass, of density one here, needs for a uniform acceleration
    f = assemble_vector(body.body_load(force)).array
    needed = dense(assemble_matrix(body.mass())) @ np.tile(force, len(f) // dim)
    assert_small(needed - f, len(f) * elastic.round_off * np.abs(f).max())


@given(bodies())
def test_mass_integrates_cubics(elastic):
    """Quadratic trial functions hold x², the weights y: what remains is the rule of integration."""
    dim, A = elastic.grid.dim, elastic.placement.matrix
    point, weight = np.polynomial.legendre.leggauss(2)  # exact for cubics
    y = np.array(np.meshgrid(*[(point + 1) / 2] * dim)).reshape(dim, -1)
    weights = np.prod(np.meshgrid(*[weight / 2] * dim), axis=0).ravel()
    x = A @ y
    exact = np.linalg.det(A) * (weights * x[0] ** 2) @ x[1]
    M = dense(assemble_matrix(elastic.body.mass()))[::dim, ::dim]
    x = elastic.x.T
    bound = len(M) * elastic.round_off * (np.abs(x[1]) @ np.abs(M) @ x[0] ** 2)
    assert_small(x[1] @ M @ x[0] ** 2 - exact, bound)


@given(bodies())
def test_stiffness_is_blind_to_rigid_motions_and_gives_balanced_forces(elastic):
    K, modes = dense(elastic.K), rigid_modes(elastic.x)
    modes = modes.reshape(len(K), -1)
    bound = terms(K) * elastic.round_off * np.abs(K).sum(axis=1).max()
    assert_small(K @ modes, bound)
    # forces of any displacement: no resultant, and no moment about the undeformed nodes
    bound = len(K) * elastic.round_off * np.abs(K).sum(axis=0).max()
    assert_small(modes.T @ K, bound)


@given(grids(("triangle", "quadrilateral")), st.sampled_from(list(METHODS)))
def test_axisymmetric_stiffness_is_blind_to_the_translation_along_the_axis(grid, method):
    K = dense(Elastic(grid, method=method, state="axisymmetric").K)
    along = np.tile([0.0, 1.0], len(K) // 2)
    bound = len(K) * grid.round_off() * np.abs(K).sum(axis=1).max()
    assert_small(K @ along, bound)
    assert_small(along @ K, bound)
    # widening, though, strains the hoops
    assert np.abs(K @ (1 - along)).max() > 1e-3 * np.abs(K).max()


@given(grids(), SEEDS)
def test_contains_the_linear_element(grid, seed):
    """P^T A P is the standard linear element's matrix of the same form, P its interpolation."""
    dim = grid.dim
    grid = grid.moved(Placement(1.0, skew(dim, seed)).point)
    spaces = Spaces.petrov_galerkin(grid.mesh(), 0)
    mesh = spaces.mesh
    V = fem.functionspace(mesh, ("Lagrange", 1))
    wind = fem.Constant(mesh, np.random.default_rng(seed).uniform(1, 2, dim))

    def matrix(trial, test):
        u, v = ufl.TrialFunction(trial), ufl.TestFunction(test)
        form = ufl.inner(ufl.dot(wind, ufl.grad(u)) + u, v)
        if grid.cell in SIMPLICES:  # elsewhere no polynomial, so the rules' points would matter
            form += ufl.inner(ufl.grad(u), ufl.grad(v))
        return assemble_matrix(form * ufl.dx(metadata={"quadrature_degree": 2 * dim + 2}))

    P = interpolation_matrix(V, spaces.trial)
    P.assemble()
    P, A, linear = dense(P), dense(matrix(spaces.trial, spaces.test)), dense(matrix(V, V))
    sizes = np.abs(P.T) @ np.abs(A) @ np.abs(P)
    bound = len(A) * grid.round_off() * sizes.max()
    assert_small(P.T @ A @ P - linear, bound)
    # rows and columns must not be mixed up: the wind would turn
    assert np.abs(P.T @ A.T @ P - linear).max() > 1e-3 * np.abs(linear).max()


@given(grids(("triangle",)), SEEDS, st.floats(-0.5, 0.45), st.sampled_from(STATES[2]), MODULI)
def test_is_galerkin_with_transferred_forces(grid, seed, nu, state, modulus):
    placement, material = Placement(1.0, skew(2, seed)), Material(modulus, nu)
    galerkin, pw = (Elastic(grid, placement, m, state, material) for m in ("galerkin", "pw"))
    T = dense(force_transfer(galerkin.space))
    K, K_pw = dense(galerkin.K), dense(pw.K)
    # what is compared are sums over a row of T of entries of K
    bound = terms(K) * pw.round_off * (np.abs(T) @ np.abs(K)).max()
    assert_small(T @ K - K_pw, bound)
    # a wrong T shows: transposed, or shares 1/6, 2/3, 1/6 in place of 1/8, 3/4, 1/8
    wrong = np.eye(len(T)) + (T - np.eye(len(T))) * 4 / 3
    for other in (T.T, wrong):
        assert np.abs(other @ K - K_pw).max() > 1e-3 * np.abs(K).max()
    force = np.random.default_rng(seed).uniform(-1, 1, 2)
    for load in ("body", "surface"):
        f, f_pw = (_load(elastic, load, force) for elastic in (galerkin, pw))
        bound = len(T) * pw.round_off * np.abs(f_pw).max()
        assert_small(T @ f - f_pw, bound)
        assert np.abs(T.T @ f - f_pw).max() > 1e-3 * np.abs(f_pw).max()


def _load(elastic, kind, force):
    if kind == "body":
        return assemble_vector(elastic.body.body_load(force)).array
    surface = boundary_measure(elastic.body.spaces.mesh, elastic.side(0))
    return assemble_vector(elastic.body.surface_load(force, surface)).array


@given(bodies(), SEEDS)
def test_patch_test(elastic, seed):
    """A linear field prescribed around comes back inside, and the reactions are in balance."""
    U, mesh, dim = elastic.space, elastic.body.spaces.mesh, elastic.grid.dim
    gradient = np.random.default_rng(seed).uniform(-1, 1, (dim, dim))
    exact = fem.Function(U)
    exact.interpolate(lambda x: gradient @ x[:dim])
    mesh.topology.create_connectivity(dim - 1, dim)
    rim = fem.locate_dofs_topological(U, dim - 1, exterior_facet_indices(mesh.topology))
    assume(len(rim) < len(elastic.x))  # a cube of five tetrahedra has no node inside
    held, f = Reduction.dirichlet(U, [fem.dirichletbc(exact, rim)]), elastic.K.createVecLeft()
    a = solve(elastic.K, f, held)
    r = reactions(elastic.K, a, f).array.reshape(-1, dim)
    a = a.array.reshape(-1, dim)
    moved = elastic.error_of_solution(held, a, f.array)[0]
    assert_small(a - exact.x.array.reshape(-1, dim), moved)
    balance = np.einsum("nak,na->k", rigid_modes(elastic.x), r)
    assert_small(balance, len(r) * elastic.error_of_forces(a))


@given(bodies(), SEEDS)
def test_reactions_balance_the_loads(elastic, seed):
    force = np.random.default_rng(seed).uniform(-1, 1, elastic.grid.dim)
    a, r, f = elastic.solved(force)
    balance = np.einsum("nak,na->k", rigid_modes(elastic.x), r + f)
    assert_small(balance, len(r) * elastic.error_of_forces(a))
    # and there are none where nothing holds
    free = dense(elastic.clamped().right).any(axis=1)
    assert_small(r.ravel()[free], elastic.error_of_forces(a))
