"""Costs of contact solutions as numbers of systems, factorisations, iterations and products.

Times depend on the machine, but these numbers do not: an algorithm that has become slower changes
them on every machine. `./run python3 -m tests.contact.test_costs` prints the numbers of all cases.
"""

from collections.abc import Callable
from unittest.mock import patch

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest

from pw_elements import Direct, Iterative
from pw_elements.algebra.nonlinear import ResidualSystem
from pw_elements.contact import ContactPair, Motion, Parabola, Plane, Sphere, solve_contact
from pw_elements.contact.nodes import SmallStrainKinematics
from tests.contact.cases import BlockOnFloor, PunchedBlock, on_plane
from tests.contact.iterative import SolidBlock, nearly_sliding_contact_arguments
from tests.contact.sliding import make_die_on_block, slide_along_path
from tests.contact.test_large import (
    RubberUnderCircle,
    solve_pressed_and_pushed_rubber,
    step_through,
)
from tests.contact.two_bodies import StackedBlocks, refine_middle, round_lower_side

# Over all increments: numbers of linear systems, of factorisations, of iterations of Krylov's
# method or of the refinement of corrected factors, of assemblies of residuals and tangents, and of
# products of matrices and vectors, those of multigrid levels included
COSTS_BY_NAME = {
    "plane block, factors": (33, 1, 34, 0, 286),
    "plane block, Krylov": (45, 0, 274, 0, 3248),
    "punched block": (12, 1, 12, 0, 96),
    "solid on a floor, factors": (6, 1, 92, 0, 47),
    "solid on a floor, Krylov": (6, 0, 27, 0, 381),
    "finer solid on a floor, factors": (7, 1, 210, 0, 53),
    "solid under a pushed plate, factors": (12, 2, 187, 0, 90),
    "nearly sliding solid, Krylov": (21, 0, 129, 0, 1629),
    "plane rubber": (18, 18, 0, 44, 126),
    "solid rubber, factors": (5, 5, 0, 38, 108),
    "solid rubber, Krylov": (6, 0, 38, 40, 1385),
    "hybrid solid rubber, Krylov": (5, 0, 68, 38, 3384),
    "two plane blocks": (1, 1, 0, 0, 18),
    "two solid blocks, Krylov": (6, 0, 58, 0, 1051),
    "two solid blocks of hexahedra, Krylov": (6, 0, 41, 0, 572),
    "round block on a block, hexahedra with a coarse rim, Krylov": (7, 0, 58, 0, 1137),
}
# Accepted growth, as round-off differs between versions of PETSc and compilers: of the number of
# systems, and of the number of iterations
MAX_ADDED_SYSTEMS = 1
MAX_ITERATION_GROWTH = 1.1


def solve_block_on_floor(solver):
    """Return the states of a plane block that is pressed on a floor and pulled in ten steps."""
    block = BlockOnFloor(16)
    loads = block.press_then_pull_loads(90.0)
    return block.solve_contact(block.floor_pair(0.3), block.no_supports, loads, solver=solver)


def solve_punched_block():
    """Return the states of a plane block under a punch that is pressed and moved sideways."""
    motions = [Motion((0.0, -0.02)), Motion((0.004, -0.02)), Motion((0.02, -0.02))]
    return PunchedBlock().solve(0.3, motions)


def solve_solid(case, solver, n=3):
    """Return the states of a solid block that is n cells high.

    `case` is a name in `SOLID_CASE_MAKERS_BY_NAME`.
    """
    return solve_contact(*SolidBlock(n=n).contact_arguments_of_case(case), solver=solver)


def press_and_drag_circle_over_rubber():
    """Return the states of plane rubber into which a circle is pressed and then dragged."""
    motions = [Motion((0.0, -0.15)), Motion((0.05, -0.3)), Motion((0.3, -0.3))]
    return step_through(RubberUnderCircle().problem, motions)


def solve_round_block_on_block():
    """Return the state of a round block on another one; cells are coarse at the rim of contact."""
    stack = StackedBlocks((4, 5), "hexahedron", map_all=refine_middle, map_upper=round_lower_side)
    return stack.solve_shifted_top(friction=0.3, solver=Iterative())


STATE_MAKERS_BY_NAME: dict[str, Callable] = {
    "plane block, factors": lambda: solve_block_on_floor(Direct()),
    "plane block, Krylov": lambda: solve_block_on_floor(Iterative()),
    "punched block": solve_punched_block,
    "solid on a floor, factors": lambda: solve_solid("rough floor", Direct()),
    "solid on a floor, Krylov": lambda: solve_solid("rough floor", Iterative()),
    "finer solid on a floor, factors": lambda: solve_solid("rough floor", Direct(), n=5),
    "solid under a pushed plate, factors": lambda: solve_solid("plate by forces", Direct()),
    "nearly sliding solid, Krylov": lambda: solve_contact(
        *nearly_sliding_contact_arguments(SolidBlock()), solver=Iterative()
    ),
    "plane rubber": press_and_drag_circle_over_rubber,
    "solid rubber, factors": lambda: [solve_pressed_and_pushed_rubber("T10", Direct())],
    "solid rubber, Krylov": lambda: [solve_pressed_and_pushed_rubber("T10", Iterative())],
    "hybrid solid rubber, Krylov": lambda: [solve_pressed_and_pushed_rubber("hybrid", Iterative())],
    "two plane blocks": lambda: [StackedBlocks((8, 11)).solve_shifted_top()],
    "two solid blocks of hexahedra, Krylov": lambda: [
        StackedBlocks((2, 3), "hexahedron").solve_shifted_top(solver=Iterative())
    ],
    "two solid blocks, Krylov": lambda: [
        StackedBlocks((3, 4), "tetrahedron").solve_shifted_top(solver=Iterative())
    ],
    "round block on a block, hexahedra with a coarse rim, Krylov": lambda: [
        solve_round_block_on_block()
    ],
}


def count_costs(make_states):
    """Return the numbers that `COSTS_BY_NAME` has, for states that a function computes."""
    PETSc.Log.begin()
    n_products = PETSc.Log.Event("MatMult").getPerfInfo()["count"]
    assemblies = [
        patch.object(ResidualSystem, name, autospec=True, side_effect=getattr(ResidualSystem, name))
        for name in ("assemble_residual", "assemble_tangent")
    ]
    with assemblies[0] as assemble_residual, assemblies[1] as assemble_tangent:
        states = make_states()
    return (
        sum(state.iterations for state in states),
        sum(state.report.factorisations for state in states),
        sum(state.report.krylov_iterations for state in states),
        assemble_residual.call_count + assemble_tangent.call_count,
        int(PETSc.Log.Event("MatMult").getPerfInfo()["count"] - n_products),
    )


@pytest.mark.parametrize("name", COSTS_BY_NAME)
def test_a_contact_solution_costs_no_more_than_stored(name):
    """No number has become larger than the stored one, but for round-off."""
    costs = count_costs(STATE_MAKERS_BY_NAME[name])
    n_systems, n_factorisations, n_iterations, n_assemblies, n_products = COSTS_BY_NAME[name]
    n_added_systems = max(costs[0] - n_systems, 0)
    assert n_added_systems <= MAX_ADDED_SYSTEMS
    assert costs[1] <= n_factorisations + n_added_systems
    assert costs[2] <= MAX_ITERATION_GROWTH * n_iterations + 2
    assert costs[3] <= n_assemblies + 2 * n_added_systems
    assert costs[4] <= MAX_ITERATION_GROWTH * n_products + 20 + 20 * n_added_systems


@pytest.mark.parametrize(
    ("surface", "n_linearisations"),
    [(Plane((0, 4), (0, -1)), 1), (Parabola((0, 4), 8.0), 1), (Sphere((0, 12), 8.0), 2)],
)
def test_only_curved_distances_are_linearised_again_at_a_solution(surface, n_linearisations):
    """A pressed surface is linearised at the start, and again if its gaps do not change linearly.

    In both cases the reported gaps are those of the surface in its final position.
    """
    block = PunchedBlock()
    motions = [Motion((0.0, None), force=(0.0, -0.05))]
    pair = ContactPair(on_plane(1, 4.0), surface, 0.3, motions)
    linearise = SmallStrainKinematics.linearise
    with patch.object(SmallStrainKinematics, "linearise", autospec=True) as counter:
        counter.side_effect = linearise
        (state,) = block.solve_contact(pair, block.base_supports)
    assert counter.call_count == n_linearisations
    (end,) = state.pairs
    assert end.translation[1] < 0
    undeformed = end.position - end.translation
    displaced = np.sum(surface.normal(undeformed) * end.displacement, axis=1)
    assert end.gap == pytest.approx(surface.gap(undeformed) + displaced, abs=1e-14)


def test_krylov_iterations_do_not_grow_while_bodies_slide():
    """With the smoother's eigenvalues of the first springs, they grow to 25 per solution."""
    bodies = make_die_on_block(divisions=((60, 12), (40, 12)), half_width=2.0, solver=Iterative())
    states = slide_along_path(bodies, [(0.0, -0.12), (0.15, -0.12), (0.3, -0.12)])
    assert all(state.report.krylov_iterations < 18 * state.iterations for state in states)


if __name__ == "__main__" and MPI.COMM_WORLD.rank == 0:
    for name, make_states in STATE_MAKERS_BY_NAME.items():
        print(f'    "{name}": {count_costs(make_states)},')
