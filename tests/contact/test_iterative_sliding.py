"""Two bodies at large sliding, solved by `Iterative()`: comparison with factors, and on processes.

The bodies are plane, axisymmetric and solid; some are held by contact alone, and some have nodes in
several pairs.
"""

import logging

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx.mesh import CellType, compute_midpoints, locate_entities_boundary

from pw_elements import (
    Body,
    Direct,
    Iterative,
    Material,
    NotConverged,
    boundary_measure,
    prescribe,
)
from pw_elements.contact import (
    SLIP,
    STICK,
    ContactPair,
    ContactProblem,
    DeformableSurface,
    Motion,
    SolutionNotFound,
)
from pw_elements.solvers import automatic
from tests.contact.blocks_in_space import BLOCK_PATH, INITIAL_GAP, BlocksInSpace
from tests.contact.cases import make_finite_strain_unknown_and_residual, on_plane
from tests.contact.sliding import make_die_on_block, slide_along_path
from tests.contact.test_several_pairs import CornerOfThreeBlocks
from tests.parallel import assert_same_on_processes

# Largest difference of displacements and slips from those by factors, relative to the largest
# displacement, and of forces, relative to the largest force
MAX_DIFFERENCE_FROM_FACTORS = 1e-9
# Largest difference between numbers of processes: each state satisfies the contact law to 1e-9 of
# the largest force
MAX_DIFFERENCE_BETWEEN_PROCESS_COUNTS = 2e-9
# increments of less than a cell, which need no substeps; where substeps differ, friction does
SHORT_PATH = [(0.0, 0.0, -0.06), (0.03, 0.0, -0.06), (0.06, 0.02, -0.06)]
# loads per area on the top of a block that only friction holds
TOP_TRACTIONS = [(0.0, 0.0, -0.05), (0.01, 0.0, -0.05), (0.013, 0.002, -0.05)]
HYBRID = {"element": "hybrid", "compressibility": 1e-3}
HEXAHEDRA = {"cell": CellType.hexahedron}


def slide_die(**options):
    return slide_along_path(make_die_on_block(**options))


def slide_rings(friction, solver, comm=MPI.COMM_SELF):
    """Return states of an annulus that is pressed on a wider one, then moved outwards."""
    die = make_die_on_block(comm=comm)
    die.space.mesh.geometry.x[:, 0] += 2.0
    body = Body(die.body.spaces, Material(1.0, 0.3), "axisymmetric")
    u, (v,) = die.u, die.residual.arguments()
    r = ufl.SpatialCoordinate(die.space.mesh)[0]
    work = 2 * np.pi * r * ufl.inner(body.stress(u), body.strain(v))
    residual = work * ufl.dx(metadata={"quadrature_degree": 4})

    def on_upper_bottom(x):
        height = 0.01 + 0.6 * (x[0] - 2.0) ** 2
        return (x[1] > 0.005) & (np.abs(x[1] - height) < 0.02) & (np.abs(x[0] - 2.0) < 0.51)

    surface = DeformableSurface(on_plane(1, 0.0), revolved=True)
    pair = ContactPair(on_upper_bottom, surface, friction)
    die.problem = ContactProblem.of_residual(residual, u, die.conditions, pair, solver=solver)
    return slide_along_path(die)


def slide_blocks(path=BLOCK_PATH, **options):
    return BlocksInSpace(**options).slide(path)


def load_block_held_by_friction(friction, solver, comm=MPI.COMM_SELF):
    """Return states of a block that lies on a fixed one and has loads on its top alone."""
    top_of_lower = INITIAL_GAP + 1e-7  # the blocks have to touch each other at the start
    boxes = ((-0.8, -0.6, -0.5), (0.8, 0.6, top_of_lower)), ((-0.4, -0.4, 0.0), (0.4, 0.4, 0.5))
    blocks = BlocksInSpace(boxes=boxes, crown=0.0, comm=comm)
    mesh = blocks.mesh
    facets = locate_entities_boundary(
        mesh, 2, lambda x: np.isclose(x[2], INITIAL_GAP, rtol=0, atol=1e-6)
    )
    mesh.topology.create_connectivity(2, 3)
    links = mesh.topology.connectivity(2, 3).links
    cells = np.array([links(facet)[0] for facet in facets], dtype=np.int32)
    is_upper = compute_midpoints(mesh, 3, cells).reshape(-1, 3)[:, 2] > INITIAL_GAP
    nodes = fem.locate_dofs_topological(blocks.space, 2, facets[is_upper])
    pair = ContactPair(nodes, DeformableSurface(facets[~is_upper]), friction)
    traction, (v,) = fem.Constant(mesh, (0.0, 0.0, 0.0)), blocks.residual.arguments()
    work = ufl.inner(traction, v) * boundary_measure(mesh, on_plane(2, 0.5))
    problem = ContactProblem.of_residual(
        blocks.residual - work, blocks.u, blocks.conditions[:3], pair, solver=solver
    )
    states = [problem.undeformed]
    for begin, end in zip([(0.0, 0.0, 0.0), *TOP_TRACTIONS], TOP_TRACTIONS, strict=False):

        def load_top(load_factor, begin=begin, end=end):
            traction.value[:] = (1 - load_factor) * np.array(begin) + load_factor * np.array(end)

        states.append(problem.step(states[-1], load_top))
    return states[1:]


def press_into_corner_of_two_blocks(friction, solver, comm=MPI.COMM_SELF):
    """Return states of a block that plates press into a corner of two bodies, one of which slides.

    Nodes at the edges of the block are in two pairs.
    """
    bodies = CornerOfThreeBlocks(comm)
    u, residual = make_finite_strain_unknown_and_residual(bodies.body.spaces)
    clamped = [
        prescribe(bodies.space, component, on_plane(axis, -1.0))
        for axis in (0, 1)
        for component in (0, 1)
    ]
    pairs = [*bodies.corner_pairs(friction), *bodies.plate_pairs()]
    problem = ContactProblem.of_residual(residual, u, clamped, pairs, solver=solver)
    states = [problem.undeformed]
    for depth, shift in ((0.03, 0.0), (0.06, 0.0), (0.06, 0.1)):
        plates = [Motion((0, -depth)), Motion((-depth, 0))]
        motions = [None, Motion((0, shift)), *plates]
        states.append(problem.step(states[-1], motions=motions))
    return states[1:]


SLIDING_CASES = {
    "plane": (slide_die, {}),
    "lower slave in the plane": (slide_die, {"upper_is_slave": False}),
    "axisymmetric": (slide_rings, {}),
    "corner": (press_into_corner_of_two_blocks, {}),
    "tetrahedra": (slide_blocks, {}),
    "lower slave": (slide_blocks, {"upper_is_slave": False, "path": SHORT_PATH}),
    "hexahedra": (slide_blocks, HEXAHEDRA),
    "hybrid tetrahedra": (slide_blocks, HYBRID),
    "hybrid hexahedra": (slide_blocks, HYBRID | HEXAHEDRA),
}


def assert_equal_states(states, expected_states):
    """Check displacements, forces, slips and statuses of states against those by factors."""
    for state, expected in zip(states, expected_states, strict=True):
        u, expected_u = (s.displacement.array_r for s in (state, expected))
        max_difference = MAX_DIFFERENCE_FROM_FACTORS * np.abs(expected_u).max()
        assert np.abs(u - expected_u).max() < max_difference
        largest_force = max(np.abs(pair.force_vector).max() for pair in expected.pairs)
        for pair, expected_pair in zip(state.pairs, expected.pairs, strict=True):
            for name in ("force_vector", "opposite_force"):
                difference = np.abs(getattr(pair, name) - getattr(expected_pair, name))
                assert difference.max(initial=0.0) < MAX_DIFFERENCE_FROM_FACTORS * largest_force
            assert np.abs(pair.slip - expected_pair.slip).max() < max_difference
            assert np.array_equal(pair.status, expected_pair.status)
        assert state.report.krylov_iterations
        assert not state.report.factorisations


# slip without friction depends on substeps, which differ in the corner
CASES_AND_FRICTION = [
    (name, friction)
    for name in SLIDING_CASES
    for friction in (0.0, 0.3)
    if (name, friction) != ("corner", 0.0)
]


@pytest.mark.parametrize(("name", "friction"), CASES_AND_FRICTION)
def test_sliding_bodies_are_those_by_factors(name, friction):
    solve, options = SLIDING_CASES[name]
    states, expected = (
        solve(friction=friction, solver=solver, **options) for solver in (Iterative(), Direct())
    )
    assert_equal_states(states, expected)
    assert max((pair.status == SLIP).sum() for pair in states[-1].pairs) > 3


def test_block_held_by_friction_alone_is_that_by_factors():
    states, expected = (
        load_block_held_by_friction(0.3, solver) for solver in (Iterative(), Direct())
    )
    assert_equal_states(states, expected)
    for state, traction in zip(states, TOP_TRACTIONS, strict=True):
        np.testing.assert_allclose(state.pairs[0].force, -0.64 * np.array(traction), atol=1e-10)
    statuses = states[-1].pairs[0].status
    assert (statuses == SLIP).any()
    assert (statuses == STICK).any()


def collect_results_of_all_cases(comm):
    cases = SLIDING_CASES | {"held by friction": (load_block_held_by_friction, {})}
    results = {}
    for name, (solve, options) in cases.items():
        states = solve(friction=0.3, solver=Iterative(), comm=comm, **options)
        for number, state in enumerate(states):
            for pair_number, pair in enumerate(state.pairs):
                for field in ("force_vector", "opposite_force", "slip", "gap"):
                    values = np.nan_to_num(getattr(pair, field), posinf=-1.0)
                    results[f"{name} {number} {pair_number} {field}"] = values
    return results


def test_sliding_bodies_are_the_same_on_several_processes():
    assert_same_on_processes(
        collect_results_of_all_cases,
        process_counts=(2, 3),
        rel=MAX_DIFFERENCE_BETWEEN_PROCESS_COUNTS,
    )


def test_automatic_choice_includes_sliding_bodies(monkeypatch):
    """Above its limit, "auto" solves two sliding bodies in space by GMRES."""
    (state,) = BlocksInSpace(solver="auto").slide(BLOCK_PATH[:1])
    assert state.report.method.startswith("LU")
    monkeypatch.setattr(automatic, "_MIN_KRYLOV_DOFS", 100)
    monkeypatch.setattr(automatic, "_MIN_KRYLOV_DOFS_IF_HELD_BY_CONTACT", 100)
    (state,) = BlocksInSpace(solver="auto").slide(BLOCK_PATH[:1])
    assert state.report.method.startswith("GMRES")


@pytest.mark.parametrize(("holds_top", "solver"), [(False, Direct()), (True, Iterative())])
def test_auto_selects_direct_for_larger_sliding_bodies_that_only_contact_holds(
    monkeypatch, holds_top, solver
):
    monkeypatch.setattr(automatic, "_MIN_KRYLOV_DOFS", 100)
    blocks = BlocksInSpace(solver="auto")
    if not holds_top:
        del blocks.conditions[3:]
    assert blocks.problem._large_strain_stepping.solver == solver


def test_auto_falls_back_to_the_direct_solver_where_bodies_slide(monkeypatch, caplog):
    """A Krylov solver that fails is replaced by factors, also in the following increments."""
    divisions, path = ((2, 2, 1), (2, 2, 1)), BLOCK_PATH[:2]
    expected = BlocksInSpace(divisions=divisions).slide(path)
    few_iterations = Iterative(options={"ksp_max_it": 1})
    with pytest.raises(SolutionNotFound, match=r"use Direct\(\)"):
        BlocksInSpace(divisions=divisions, solver=few_iterations).slide(path)
    for limit in ("_MIN_KRYLOV_DOFS", "_MIN_KRYLOV_DOFS_IF_HELD_BY_CONTACT"):
        monkeypatch.setattr(automatic, limit, 100)
    monkeypatch.setattr(automatic, "Iterative", lambda: few_iterations)
    blocks = BlocksInSpace(divisions=divisions, solver="auto")
    with caplog.at_level(logging.INFO, logger="pw_elements"):
        states = blocks.slide(path)
    said = [record.getMessage() for record in caplog.records]
    assert sum("Iterative gave up, Direct goes on" in message for message in said) == 1
    for state, exact in zip(states, expected, strict=True):
        assert state.report == exact.report
        assert np.array_equal(state.displacement.array_r, exact.displacement.array_r)
    blocks._problem = blocks.problem.with_changes(friction=0.0)
    (state,) = blocks.slide(path[:1])
    assert state.report.method == expected[0].report.method
    (pair,) = state.pairs
    assert np.abs(pair.force_tangential).max() < 1e-9 * np.abs(pair.force_vector).max()
    monkeypatch.setattr(automatic, "total_free_memory_in_bytes", lambda _: 1e3)
    with pytest.raises(NotConverged, match='"auto" does not use'):
        BlocksInSpace(divisions=divisions, solver="auto").slide(path)
