"""A problem in other units, elsewhere, turned or renumbered has the same solution."""

import gc
import weakref

import numpy as np
import pytest
from dolfinx import fem
from hypothesis import assume, event, given
from hypothesis import strategies as st

from pw_elements import (
    Material,
    NoModes,
    assemble_matrix,
    assemble_vector,
    boundary_measure,
    buckling,
    solve,
    vibration_modes,
)
from tests.library.properties import METHODS, Elastic, assert_small, dense, eigenvalue_error
from tests.library.random_meshes import (
    BODIES,
    MODULI,
    SEEDS,
    UNITS,
    Placement,
    grids,
    powers,
    same_nodes,
    structured,
)
from tests.library.random_meshes import rotation as random_rotation

pytestmark = pytest.mark.random

STATES = {2: ("plane stress", "plane strain"), 3: ("solid",)}
POISSON = st.floats(-0.5, 0.45)


@st.composite
def statics(draw, cells=BODIES):
    """A body of size one and modulus one, and the body force on it."""
    grid = draw(grids(cells))
    method, nu = draw(st.sampled_from(list(METHODS))), draw(POISSON)
    state = draw(st.sampled_from(STATES[grid.dim]))
    force = np.random.default_rng(draw(SEEDS)).uniform(-1, 1, grid.dim)
    return Elastic(grid, Placement(), method, state, Material(1.0, nu)), force


def assert_same_solution(elastic, other, force, modulus):
    """Displacements and reactions of one body are those of the other, placed elsewhere."""
    place, dim = other.placement, elastic.grid.dim
    a, r, f = elastic.solved(force)
    # forces per volume scale like modulus over length, nodal forces like modulus times area
    b, s, _ = other.solved(place.vector(force) * modulus / place.unit)
    at = same_nodes(elastic.x, other.x, place)
    # of both of them; the one far from the origin knows its shape less well
    moved, forced = elastic.error_of_solution(
        elastic.clamped(), a, f, elastic.round_off + other.round_off
    )
    assert_small(b / place.unit - place.vector(a)[at], dim * moved)
    scale = modulus * place.unit ** (dim - 1)
    assert_small(s / scale - place.vector(r)[at], dim * forced)


@given(statics(), UNITS, MODULI)
def test_same_statics_in_other_units(problem, unit, modulus):
    elastic, force = problem
    material = Material(modulus, elastic.material.poissons_ratio)
    other = Elastic(elastic.grid, Placement(unit), elastic.method, elastic.state, material)
    assert_same_solution(elastic, other, force, modulus)


@given(statics(), powers(-2, 6), SEEDS, st.booleans(), st.booleans())
def test_same_statics_elsewhere_turned_and_renumbered(problem, far, seed, turned, renumbered):
    """Up to 1e6 sizes away."""
    elastic, force = problem
    grid, dim = elastic.grid, elastic.grid.dim
    if renumbered:
        grid = grid.renumbered(seed)
    offset = far * np.random.default_rng(seed).uniform(-1, 1, dim)
    place = Placement(1.0, random_rotation(dim, seed) if turned else np.eye(dim), offset)
    other = Elastic(grid, place, elastic.method, elastic.state, elastic.material)
    assert_same_solution(elastic, other, force, 1.0)


def _lowest(mu):
    return np.argmin(np.where(mu.real > 0, mu.real, np.inf))


def _largest(mu):
    return np.argmax(mu.real)


@given(statics(("triangle", "quadrilateral")), UNITS, MODULI, powers(-12, 4))
def test_frequencies_in_other_units(problem, unit, modulus, density):
    elastic, _ = problem
    nu = elastic.material.poissons_ratio
    other = Elastic(
        elastic.grid,
        Placement(unit),
        elastic.method,
        elastic.state,
        Material(modulus, nu, density),
    )
    values = []
    for body in (elastic, other):
        M, held = assemble_matrix(body.body.mass()), body.clamped()
        values.append(vibration_modes(body.K, M, held).eigenvalues[0])
    K, M = (dense(other.clamped().matrix(A)) for A in (other.K, M))
    wrong = len(K) * (elastic.round_off + other.round_off)
    sizes = [wrong * np.linalg.norm(A, 2) for A in (K, M)]
    exact, error = eigenvalue_error(K, M, _lowest, *sizes)
    error += 1e-11 * abs(exact)  # where the solver stops, 1e-12 of its own residual
    # SciPy's dense eigenvalues are the same, and so are those in units of one
    assert_small(values[1] - exact, error)
    assert_small(values[0] * modulus / (density * unit**2) - values[1], 2 * error)


@given(statics(("triangle", "quadrilateral")), UNITS, MODULI, powers(-6, 6))
def test_buckling_factors_have_no_unit(problem, unit, modulus, load):
    elastic, _ = problem
    material = Material(modulus, elastic.material.poissons_ratio)
    other = Elastic(elastic.grid, Placement(unit), elastic.method, elastic.state, material)
    factors = []
    for body, pressure in ((elastic, 1.0), (other, load * modulus)):
        top = boundary_measure(body.body.spaces.mesh, body.side(0, 1.0))
        f = assemble_vector(body.body.surface_load((-pressure, 0.0), top))
        a = solve(body.K, f, body.clamped())
        u = fem.Function(body.space)
        u.x.array[:] = a.array
        K_sigma = assemble_matrix(body.body.initial_stress(body.body.stress(u)))
        try:
            factors.append(buckling(body.K, K_sigma, body.clamped()).factors[0])
        except NoModes:
            factors.append(None)
    event(f"buckles: {factors[0] is not None}")
    assert (factors[0] is None) == (factors[1] is None)
    assume(factors[0] is not None)
    K, S = (dense(other.clamped().matrix(A)) for A in (other.K, K_sigma))
    moved = other.error_of_solution(
        other.clamped(), a.array, f.array, elastic.round_off + other.round_off
    )[0]
    # stresses are wrong like slopes of displacements, and K_sigma like stresses
    wrong_S = moved / np.abs(a.array).max() * np.linalg.norm(S, 2)
    wrong_K = len(K) * (elastic.round_off + other.round_off) * np.linalg.norm(K, 2)
    mu, error = eigenvalue_error(-S, K, _largest, wrong_S, wrong_K)
    error += 1e-11 * abs(mu)
    assert_small(1 / factors[1] - mu, error)
    assert_small(load / factors[0] - 1 / factors[1], 2 * error)


def test_frequencies_let_go_of_the_mesh():
    body = Elastic(structured("triangle", [np.linspace(0, 1, 3)] * 2))
    form = weakref.ref(body.K.getAttr("assembled").form)
    vibration_modes(body.K, assemble_matrix(body.body.mass()), body.clamped())
    del body
    gc.collect()
    assert form() is None
