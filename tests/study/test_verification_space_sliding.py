"""Test the exact solutions, meshes and measures of two bodies in space in section V18."""

from dataclasses import replace

import numpy as np
import pytest
from dolfinx.fem import locate_dofs_topological
from dolfinx.mesh import compute_midpoints

from study.benchmarks.v17_bodies.problems import SlidingHistory
from study.benchmarks.v18_bodies_in_space import problems
from study.meshes.two_body_meshes import mesh_two_blocks_in_space
from study.solutions.calculix import blocks_in_space
from study.solutions.calculix.blocks_in_space import (
    PATCHES,
    SLIDING_BLOCKS,
    solve_uniaxial_stress,
)
from study.solutions.calculix.blocks_in_space_forces import (
    compare_calculix_nodal_forces_with_exact,
    mesh_blocks,
)
from study.solutions.calculix.cylinder import BULK_MODULUS
from study.solutions.rubber import POISSONS_RATIO, NeoHookeanBody, compare_force_over_weight


def strain_energy(stretches, lame):
    volume_ratio = np.prod(stretches)
    if lame is None:  # the energy of CalculiX
        distortion = volume_ratio ** (-2 / 3) * np.sum(np.square(stretches)) - 3
        return distortion / 2 + BULK_MODULUS / 2 * (volume_ratio - 1) ** 2
    logarithm = np.log(volume_ratio)
    return (np.sum(np.square(stretches)) - 3) / 2 - logarithm + lame / 2 * logarithm**2


@pytest.mark.parametrize("lame", [2 * POISSONS_RATIO / (1 - 2 * POISSONS_RATIO), None])
def test_uniaxial_stress_follows_from_the_derivatives_of_the_energy(lame):
    stretches, pressure = solve_uniaxial_stress(0.9, lame)
    assert stretches[2] == 0.9
    step = 1e-6 * np.eye(3)
    nominal = [
        (strain_energy(stretches + d, lame) - strain_energy(stretches - d, lame)) / 2e-6
        for d in step
    ]
    assert nominal[:2] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert pressure == pytest.approx(-nominal[2] / stretches[0] ** 2, rel=1e-8)


@pytest.mark.parametrize("case", [*PATCHES, *SLIDING_BLOCKS])
def test_calculix_has_the_nodes_and_sides_of_our_mesh(case):
    problem = (PATCHES | SLIDING_BLOCKS)[case]
    mesh, (slave, master) = mesh_blocks(problem.grids, problem.curvatures)
    bodies = NeoHookeanBody("galerkin-T10", mesh, 2, calculix_energy=True)
    node = bodies.find_nodes(problem.nodes)
    assert sorted(node) == list(range(len(bodies.x)))
    slave_faces, master_faces = problem.slave_and_master_faces
    assert (len(slave_faces), len(master_faces)) == (len(slave), len(master))
    space = bodies.displacements.space
    slave_nodes = locate_dofs_topological(space, 2, slave.astype(np.int32))
    assert sorted(slave_nodes) == sorted(node[problem.slave_nodes - 1])
    with pytest.raises(ValueError, match="from the nearest node"):
        bodies.find_nodes(problem.nodes + 0.001)


def test_nodal_forces_of_uniform_displacement_gradients_have_the_exact_resultant():
    """The displacements are those of uniaxial stress, without the gap."""
    problem = PATCHES["patch-in-space-flat-surface"]
    stretches, _ = solve_uniaxial_stress(problems.PATCH_STRETCH)
    x = problem.nodes[problem.nodes_of_elements_at_contact - 1]
    displacement = ((stretches - 1) * x).ravel()
    errors = compare_calculix_nodal_forces_with_exact(problem, displacement)
    assert errors["force_over_weight_error"] < 1e-9
    assert errors["weightless_force"] < 1e-9


def test_sides_of_two_blocks_belong_to_the_right_block_and_lie_on_their_paraboloids():
    lines = [np.linspace(-1, 1, 3), np.linspace(-1, 1, 3), np.array([-1.0, 0.0])]
    upper_lines = [*lines[:2], np.array([0.0, 1.0])]
    mesh, (slave, master) = mesh_two_blocks_in_space(
        "tetrahedron", lines, upper_lines, (0.1, 0.3), 0.01
    )
    assert len(slave) == len(master) == 8
    assert (compute_midpoints(mesh, 2, slave.astype(np.int32))[:, 2] > 0.01).all()
    mesh.topology.create_connectivity(2, 3)
    cells = mesh.topology.connectivity(2, 3)
    for facets, curvature, gap, side in ((slave, 0.3, 0.01, 1), (master, 0.1, 0.0, -1)):
        for facet in facets:
            x = mesh.geometry.x[mesh.geometry.dofmap[cells.links(facet)[0]]]
            height = x[:, 2] - curvature / 2 * (x[:, 0] ** 2 + x[:, 1] ** 2) - gap
            assert np.sum(np.abs(height) < 1e-12) == 6  # three corners, three middles of edges
            assert (side * height > -1e-12).all()


def test_slave_ends_at_the_given_extent():
    lines = [np.linspace(-1, 1, 5), np.linspace(-1, 1, 5), np.array([-1.0, 0.0])]
    upper_lines = [*lines[:2], np.array([0.0, 1.0])]
    _, (slave, master) = mesh_two_blocks_in_space(
        "tetrahedron", lines, upper_lines, (0.0, 0.0), 0.01, 0.5
    )
    assert (len(slave), len(master)) == (8, 32)


@pytest.fixture
def small_patch(monkeypatch):
    cells = ((1, 1, 1), (2, 2, 1))
    grids = [replace(g, divisions=n) for g, n in zip(problems.PATCH_GRIDS, cells, strict=True)]
    monkeypatch.setattr(problems, "PATCH_GRIDS", grids)
    monkeypatch.setattr(problems, "PATCH_TIMES", [0.5, 1.0, 1.5, 2.0])
    for module in (problems, blocks_in_space):
        monkeypatch.setattr(module, "ROTATION_DEGREES", 30.0)


@pytest.mark.usefixtures("small_patch")
def test_forces_of_a_rotated_patch_add_up_to_pressure_times_area():
    result = problems.patch("pw-T10", 0.0)
    stretches, pressure = solve_uniaxial_stress(problems.PATCH_STRETCH, problems.LAME)
    for side in ("", "_master"):
        total = result.curves[f"force{side}"].sum()
        assert total == pytest.approx(pressure * stretches[0] ** 2, rel=1e-9)
        area = result.curves[f"weight{side}"].sum()
        assert area == pytest.approx(stretches[0] ** 2, rel=1e-9)


@pytest.mark.usefixtures("small_patch")
def test_only_the_new_element_has_even_pressures_in_a_small_patch():
    errors = {
        element: problems.patch(element, 0.0).scalars["force_over_weight_error_master"]
        for element in ("pw-T10", "galerkin-T10")
    }
    assert errors["pw-T10"] < 1e-8
    assert errors["galerkin-T10"] > 0.1


def test_pressures_are_compared_at_nodes_with_weight_only():
    force, weight = np.array([2.0, 1.2, 0.1]), np.array([1.0, 0.5, 0.0])
    measured = compare_force_over_weight(force, weight, np.full(3, 2.0))
    assert measured["force_over_weight_error"] == pytest.approx(0.2)
    assert measured["weightless_nodes"] == pytest.approx(1 / 3)
    assert measured["weightless_force"] == pytest.approx(0.1 / 1.1)


def test_ripple_is_what_a_parabola_over_the_path_leaves():
    path = np.linspace(0, 2, 15)
    smooth = 3 + 0.2 * path - 0.1 * path**2
    assert problems._measure_ripple(smooth) < 1e-12
    wave = 0.03 * np.cos(np.pi * np.arange(15))
    expected = 0.03 / smooth.mean()
    assert problems._measure_ripple(smooth + wave) == pytest.approx(expected, rel=0.3)


def test_convergence_order_of_a_quadratic_and_of_a_linear_sequence():
    quadratic = [1e-1, 1e-2, 1e-4, 1e-8, 1e-16]
    assert SlidingHistory([], [quadratic] * 3).median_convergence_order() == pytest.approx(2.0)
    linear = [10.0**-k for k in range(1, 8)]
    assert SlidingHistory([], [linear]).median_convergence_order() == pytest.approx(1.0)
