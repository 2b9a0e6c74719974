"""Sections 7.1, 7.2 and 7.6 by user elements: a host program reads decks, assembles and solves.

The element is used only through the interface of Abaqus' user subroutine UEL. Nothing here runs in
Abaqus.
"""

import re
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from pw_elements import Material
from pw_elements.abaqus import abaqus_nodes_and_facets_in_dolfinx_order
from pw_elements.elasticity import StressState
from pw_elements.user_element import generate_user_element
from study.model.discretisation import discretise, mesh_nodes_and_cells
from study.paper import s7_1_two_triangles, s7_2_block, s7_6_buckling
from tests.library.uel_host import HostProgram, compile_user_element, write_deck

TOLERANCE = 1e-12
# Nominal stress in section 7.6, so large that the initial stress is not lost in round-off
NOMINAL_STRESS = 1e12


@pytest.fixture(scope="module")
def uel(tmp_path_factory):
    element = generate_user_element("triangle", "plane stress")
    return compile_user_element(element, tmp_path_factory.mktemp("uel")).uel_


@pytest.fixture
def make_host(uel, tmp_path):
    """Return a function that writes a deck and returns the host program that has read it."""

    def write_and_read(nodes, cells, properties, node_sets, history, loaded_side=None, pressure=0):
        node_order, _ = abaqus_nodes_and_facets_in_dolfinx_order("triangle", 2)
        elements = np.empty_like(cells)
        elements[:, node_order] = cells
        element_sets = {}
        if loaded_side:  # elements with a face on the loaded side, by the number of the face
            is_loaded = loaded_side(nodes)[elements]
            for face in range(3):
                on_side = is_loaded[:, face] & is_loaded[:, (face + 1) % 3]
                if on_side.any():
                    element_sets[f"LOADED{face + 1}"] = np.flatnonzero(on_side)
            history += "\n*DLOAD"
            history += "".join(f"\n{name}, U{name[-1]}, {pressure}" for name in element_sets)
        path = tmp_path / "deck.inp"
        sets = {name: np.flatnonzero(where(nodes)) for name, where in node_sets.items()}
        write_deck(path, nodes, elements, properties, element_sets, sets, history)
        return HostProgram(path, uel)

    return write_and_read


def assert_close(computed, expected):
    assert np.shape(computed) == np.shape(expected)
    assert np.abs(np.subtract(computed, expected)).max() < TOLERANCE * np.abs(expected).max()


@pytest.mark.parametrize("squares", [1, 6])
def test_reactions_of_section_7_1(make_host, squares):
    result = s7_1_two_triangles.structure("pw-T6", squares)
    host = make_host(
        result.curves["nodes"],
        result.curves["cells"],
        [s7_1_two_triangles.YOUNGS_MODULUS, s7_1_two_triangles.POISSONS_RATIO, 1.0, 1.0],
        {"BASE": lambda x: np.isclose(x[:, 1], 0.0), "CORNER": lambda x: ~np.any(x != 0, axis=1)},
        "*BOUNDARY\nBASE, 2, 2\nCORNER, 1, 1\n*STEP\n*STATIC",
        lambda x: np.isclose(x[:, 1], 1.0),
        pressure=1.0,
    )
    _, reactions = host.solve_static()
    base = host.node_sets["BASE"]
    base = base[np.argsort(host.x[base, 0])]
    assert_close(reactions[2 * base + 1], result.curves["reaction"])
    stresses = np.array(host.states).reshape(len(host.states), 4, 4)
    assert_close(stresses[:, :, 1], np.full(stresses.shape[:2], -1.0))  # uniform, Eq. (22)


def test_the_deck_of_the_guide_gives_even_reactions(uel, tmp_path):
    page = Path(__file__).parents[2] / "docs" / "how-to" / "user-element.md"
    (deck,) = re.findall(r'^deck = """\\\n(.*?)"""', page.read_text(), re.M | re.S)
    (tmp_path / "two.inp").write_text(deck)
    host = HostProgram(tmp_path / "two.inp", uel)
    _, reactions = host.solve_static()
    assert_close(reactions[2 * np.array([0, 4, 1]) + 1], [0.25, 0.5, 0.25])
    assert np.allclose(np.reshape(host.states, (-1, 4)), [0.0, -1.0, 0.0, 0.0], atol=1e-12)


def test_pressed_state_of_section_7_2(make_host):
    body = discretise(
        "pw-T6",
        partial(s7_2_block.mesh_block, s7_2_block.DIVISIONS),
        Material(s7_2_block.YOUNGS_MODULUS, s7_2_block.POISSONS_RATIO),
        StressState.PLANE_STRESS,
    )
    load = s7_2_block.assemble_loads_of_increments(body, s7_2_block.PULL)[0]
    (state,) = s7_2_block.solve_contact_on_foundation(body, [load], s7_2_block.FRICTION, True)
    (pair,) = state.pairs
    curves = mesh_nodes_and_cells(body.space)
    host = make_host(
        curves["nodes"],
        curves["cells"],
        [s7_2_block.YOUNGS_MODULUS, s7_2_block.POISSONS_RATIO, 1.0, 1.0],
        {"BASE": lambda x: np.isclose(x[:, 1], 0.0)},
        "*STEP\n*STATIC",
        lambda x: np.isclose(x[:, 1], s7_2_block.HEIGHT),
        pressure=s7_2_block.PRESSURE,
    )
    base = host.node_sets["BASE"]
    base = base[np.argsort(host.x[base, 0])]
    x = host.x[base, 0]
    margin = s7_2_block.SMOOTH_LENGTH - 1e-9
    is_rough = (x > margin) & (x < s7_2_block.LENGTH - margin)
    _, normal, tangential = host.solve_contact(base, s7_2_block.FRICTION * is_rough)
    order = np.argsort(pair.position[:, 0])
    assert_close(x, pair.position[order, 0])
    assert_close(normal, pair.force_normal[order])
    assert_close(tangential, pair.force_tangential[order, 0])
    slips = np.isclose(np.abs(tangential), s7_2_block.FRICTION * normal) & is_rough
    assert 0 < slips.sum() < is_rough.sum()  # both cases of Coulomb's law occur


@pytest.mark.parametrize(("element", "symmetrised"), [("pw-T6", False), ("pwsym-T6", True)])
@pytest.mark.parametrize("mode", [s7_6_buckling.SYMMETRIC, s7_6_buckling.ANTISYMMETRIC])
def test_critical_stress_of_section_7_6(make_host, element, symmetrised, mode):
    """The static step is unsymmetric; a host program symmetrises in the eigenvalue step only."""
    arguments = {"divisions": s7_6_buckling.PAPER_DIVISIONS, **s7_6_buckling.POINT_LOAD}
    result = s7_6_buckling.beam(element, "G", prestress_symmetrised=False, **arguments)
    half, force = s7_6_buckling.LENGTH / 2, s7_6_buckling.HEIGHT * s7_6_buckling.THICKNESS
    supports = {
        s7_6_buckling.SYMMETRIC: "END, 2, 2\nMIDDLE, 1, 1",
        s7_6_buckling.ANTISYMMETRIC: "END, 2, 2\nCENTRE, 1, 2",
    }
    host = make_host(
        result.curves["nodes"],
        result.curves["cells"],
        [s7_6_buckling.YOUNGS_MODULUS, s7_6_buckling.POISSONS_RATIO, 1.0, s7_6_buckling.THICKNESS],
        {
            "END": lambda x: np.isclose(x, [0.0, 0.0]).all(axis=1),
            "MIDDLE": lambda x: np.isclose(x[:, 0], half),
            "CENTRE": lambda x: np.isclose(x, [half, 0.0]).all(axis=1),
        },
        f"*BOUNDARY\n{supports[mode]}\n*STEP, NLGEOM=YES\n*STATIC\n"
        f"*CLOAD\nEND, 1, {force * NOMINAL_STRESS!r}",
    )
    u, _ = host.solve_static()
    factor, condition = host.solve_buckling(u, symmetrised)
    # the largest change of the factor if the matrices differ by round-off
    tolerance = np.finfo(float).eps * condition
    assert tolerance < 1e-9
    assert factor * NOMINAL_STRESS == pytest.approx(
        result.scalars[f"sigma_cr_{mode}"], rel=tolerance
    )
    # what is symmetrised matters
    other_factor, _ = host.solve_buckling(u, not symmetrised)
    assert abs(other_factor / factor - 1) > 1e-3
