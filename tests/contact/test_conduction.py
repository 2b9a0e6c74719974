"""Heat conduction across interfaces: exact bars, even nodal flows, friction heat, refusals."""

from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx.mesh import create_rectangle

from pw_elements import Reduction, Spaces, assemble_matrix, prescribe, solve
from pw_elements.conduction import friction_heat, interface_conduction
from pw_elements.contact import ContactPair, Motion, Plane
from pw_elements.contact.model import MatchingNodes
from tests.contact.cases import ElasticBody, on_plane
from tests.contact.two_bodies import TOP_PRESSURE_OVER_MODULUS, StackedBlocks
from tests.parallel import assert_same_on_processes

CONDUCTIVITY, HOT = 2.0, 100.0
CONDUCTANCE_PER_PRESSURE = 1.5e3
EXACT_FLUX = HOT / (2 / CONDUCTIVITY + 1 / (CONDUCTANCE_PER_PRESSURE * TOP_PRESSURE_OVER_MODULUS))


def conductance_of_pressure(pressure, gap):
    assert gap.max(initial=0.0) < 1e-9
    return CONDUCTANCE_PER_PRESSURE * pressure


def refine_middle_of_first_axis(x):
    """Return nodes (n, 3) of the unit square or cube, moved along the first axis."""
    centred = 2 * x[:, 0] - 1
    return np.column_stack([0.5 + 0.5 * (0.4 * centred + 0.6 * centred**3), x[:, 1:]])


def solve_temperatures(state, blocks, make_spaces=Spaces.petrov_galerkin, tool_temperature=None):
    """Return the temperatures, the heat flows out of the bodies' nodes, and the spaces.

    The base at x_up = 0 is cold. Without a tool, the top at x_up = 2 has the temperature `HOT`.
    """
    heat, up = make_spaces(blocks.mesh, 0), blocks.dim - 1
    T, w = ufl.TrialFunction(heat.trial), ufl.TestFunction(heat.test)
    bodies = assemble_matrix(CONDUCTIVITY * ufl.inner(ufl.grad(T), ufl.grad(w)) * ufl.dx)
    exchange, load = interface_conduction(
        state, blocks.body, heat, conductance_of_pressure, tool_temperature=tool_temperature
    )
    supports = [prescribe(heat.trial, 0, on_plane(up, 0.0))]
    if tool_temperature is None:
        supports.append(prescribe(heat.trial, 0, on_plane(up, 2.0), HOT))
    temperature = solve(bodies + exchange, load, Reduction.dirichlet(heat.trial, supports))
    return temperature, bodies * temperature, heat


@pytest.mark.parametrize(
    ("cell", "divisions", "map_all"),
    [
        ("triangle", (3, 4), None),
        ("triangle", (3, 4), refine_middle_of_first_axis),
        ("quadrilateral", (2, 3), None),
        ("tetrahedron", (2, 3), None),
    ],
)
def test_bars_in_contact_have_exact_temperatures_and_even_flows(cell, divisions, map_all):
    """Two bars under pressure have linear temperatures with the exact jump at the interface.

    The conductance is proportional to the pressure. Each node's flow is the exact flux times the
    area of its weight function, which is its contact force divided by the pressure.
    """
    blocks = StackedBlocks(divisions, cell, nu=0.0, map_all=map_all)
    state = blocks.solve_uniaxial_compression()
    temperature, flows, heat = solve_temperatures(state, blocks)
    x, cells = heat.trial.tabulate_dof_coordinates(), heat.trial.dofmap.list
    height, slope = x[:, blocks.up], EXACT_FLUX / CONDUCTIVITY
    is_lower = np.zeros(len(x), dtype=bool)
    is_lower[cells[height[cells].mean(axis=1) < 1.0]] = True
    exact = np.where(is_lower, slope * height, HOT - slope * (2 - height))
    assert temperature.array == pytest.approx(exact, abs=1e-9 * HOT)
    (pair,) = state.pairs
    area = pair.force_normal / TOP_PRESSURE_OVER_MODULUS
    assert -flows.array[pair.node] == pytest.approx(EXACT_FLUX * area, rel=1e-8)


def solve_block_under_plate(method):
    """Return a block of T6 elements, and its state under a uniform pressure of a rigid plate."""
    mesh = create_rectangle(MPI.COMM_SELF, [(0.0, 0.0), (1.0, 1.0)], [3, 2])
    block = ElasticBody(mesh, method, E=1.0, nu=0.0)
    plate = ContactPair(on_plane(1, 1.0), Plane((0, 1), (0, -1)), motions=Motion((0, -1e-3)))
    supports = block.make_supports((1, on_plane(1, 0.0)), (0, on_plane(0, 0.0)))
    (state,) = block.solve_contact(plate, supports)
    return block, state


def test_nodal_flows_of_the_standard_element_form_a_sawtooth():
    """With the standard element, mid-side nodes take twice the heat of inner vertices.

    With the piecewise-linear weights the flows of inner nodes are equal (T6 with equal edges).
    """
    ratios = {}
    for name in ("petrov_galerkin", "galerkin"):
        method = getattr(Spaces, name)
        block, state = solve_block_under_plate(method)
        _, flows, _ = solve_temperatures(state, block, method, tool_temperature=HOT)
        middle, vertex = flows.array[state.pairs[0].node[1:3]]
        ratios[name] = middle / vertex
    assert ratios == pytest.approx({"petrov_galerkin": 1.0, "galerkin": 2.0}, rel=1e-9)


def test_a_rigid_tool_heats_the_body_that_it_presses():
    """A block pressed by a hot rigid plate has the linear temperature of the exact solution."""
    block, state = solve_block_under_plate(Spaces.petrov_galerkin)
    temperature, _, heat = solve_temperatures(state, block, tool_temperature=HOT)
    flux = HOT / (1 / CONDUCTIVITY + 1 / (CONDUCTANCE_PER_PRESSURE * 1e-3))
    exact = flux / CONDUCTIVITY * heat.trial.tabulate_dof_coordinates()[:, 1]
    assert temperature.array == pytest.approx(exact, abs=1e-9 * HOT)
    with pytest.raises(ValueError, match="give its tool_temperature"):
        solve_temperatures(state, block)


def test_nodes_that_face_each_other_exchange_heat():
    """Matching nodes give the same temperatures as the mortar on matching meshes."""
    blocks = StackedBlocks((3, 3), nu=0.0)
    matching = ContactPair(
        blocks.side_node_mask("upper"),
        MatchingNodes(blocks.side_node_mask("lower"), Plane((0, 1), (0, 1))),
    )
    load = blocks.traction_load(np.array([0.0, -TOP_PRESSURE_OVER_MODULUS]))
    supports = blocks.make_supports(*((i, on_plane(i, 0.0)) for i in range(2)))
    (state,) = blocks.solve_contact(matching, supports, load)
    temperature, _, _ = solve_temperatures(state, blocks)
    mortar, _, _ = solve_temperatures(blocks.solve_uniaxial_compression(), blocks)
    assert temperature.array == pytest.approx(mortar.array, abs=1e-9 * HOT)


def test_the_interface_neither_makes_nor_loses_heat():
    """Equal temperatures exchange nothing, flows sum to zero, and the heat of friction is its work.

    The contact is not uniform: one block is pushed over the other.
    """
    blocks = StackedBlocks((3, 4))
    state = blocks.solve_shifted_top(friction=0.05)
    heat = Spaces.petrov_galerkin(blocks.mesh, 0)
    exchange, load = interface_conduction(
        state, blocks.body, heat, lambda pressure, gap: 1 / (1 + gap) + pressure
    )
    one = exchange.createVecRight()
    one.set(1.0)
    size = exchange.norm()
    assert (exchange * one).norm() < 1e-12 * size
    assert exchange.isSymmetric(1e-12 * size)
    assert load.norm() == 0
    (pair,) = state.pairs
    work = -np.sum(pair.force_tangential * pair.slip)
    assert work > 1e-7
    for share in (0.0, 0.4, 1.0):
        heat_load = friction_heat(state, blocks.body, heat, duration=0.5, own_share=share)
        assert heat_load.sum() == pytest.approx(work / 0.5, rel=1e-12)
        assert heat_load.array[pair.node].sum() == pytest.approx(share * work / 0.5, rel=1e-12)


def test_work_of_friction_is_summed_over_substeps():
    """The heat of an increment solved in substeps is that of its parts."""
    blocks = StackedBlocks((3, 4))
    state = blocks.solve_shifted_top(friction=0.05)
    heat = Spaces.petrov_galerkin(blocks.mesh, 0)
    (pair,) = state.pairs
    both = replace(state, pairs=(replace(pair, slip=3 * pair.slip),), substates=((0.5, state),))
    single, doubled = (
        friction_heat(part, blocks.body, heat, duration=1.0).sum() for part in (state, both)
    )
    assert doubled == pytest.approx(3 * single, rel=1e-12)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"conductance": lambda p, _: -1.0 + 0 * p}, "negative or not finite"),
        ({"conductance": lambda p, _: np.nan * p}, "negative or not finite"),
        ({"conductance": lambda *_: np.ones(2)}, "it takes pressures"),
        ({"pair": 1}, "there is no contact pair 1"),
        ({"tool_temperature": 20.0}, "the pair faces a body"),
        ({"components": 2}, "scalar spaces"),
    ],
)
def test_invalid_arguments_are_refused(changes, message):
    blocks = StackedBlocks((1, 1), nu=0.0)
    state = blocks.solve_uniaxial_compression()
    arguments = {"conductance": conductance_of_pressure} | changes
    heat = Spaces.petrov_galerkin(blocks.mesh, arguments.pop("components", 0))
    with pytest.raises(ValueError, match=message):
        interface_conduction(state, blocks.body, heat, **arguments)


def solve_bars_and_collect_flows(comm):
    """Return sums of temperatures and flows of two bars, the latter at the contact nodes."""
    blocks = StackedBlocks((3, 4), nu=0.0, comm=comm)
    state = blocks.solve_shifted_top(friction=0.05)
    heat = Spaces.petrov_galerkin(blocks.mesh, 0)
    exchange, _ = interface_conduction(state, blocks.body, heat, conductance_of_any_gap)
    x = exchange.createVecRight()
    first = heat.trial.dofmap.index_map.size_local
    x.setArray(np.cos(heat.trial.tabulate_dof_coordinates()[:first] @ [1.0, 2.0, 0.0]))
    friction = friction_heat(state, blocks.body, heat, duration=0.5, own_share=0.3)
    return {
        "exchange": np.array([x.dot(exchange * x)]),
        "friction": np.array([x.dot(friction), friction.sum()]),
    }


def conductance_of_any_gap(pressure, gap):
    return 1 / (1 + gap) + pressure


def test_flows_are_the_same_on_several_processes():
    assert_same_on_processes(solve_bars_and_collect_flows, process_counts=(2,), rel=1e-9)
