"""Contact of bodies that have a mesh each, with cells of different types."""

from dataclasses import replace

import numpy as np
import pytest
import ufl
from dolfinx import fem

from pw_elements import Body, Iterative, Material, Spaces, prescribe
from pw_elements.contact import ContactProblem, DeformableSurface
from pw_elements.contact.model import Tie
from tests.contact.cases import on_plane
from tests.contact.several_meshes import BlocksWithAMeshEach, forces_and_positions_of_both_sides
from tests.parallel import assert_same_on_processes

SPACE_CELLS = [("hexahedron", "tetrahedron"), ("tetrahedron", "hexahedron")]
PLANE_CELLS = [("quadrilateral", "triangle"), ("triangle", "quadrilateral")]
SAME_SECTION_BOXES = (((0.0, 0.0, -1.0), (1.0, 0.8, 0.0)), ((0.0, 0.0, 0.0), (1.0, 0.8, 0.7)))
SLIDING_PATH = [(0.0, 0.0, -0.03), (0.3, 0.1, -0.03), (0.9, 0.2, -0.03)]


def path_in_dimension(path, dim):
    """Return a path in space, or without the second component in the plane."""
    return path if dim == 3 else [(x, z) for x, _, z in path]


@pytest.mark.parametrize("is_finite_strain", [False, True])
@pytest.mark.parametrize("cells", SPACE_CELLS + PLANE_CELLS)
def test_a_uniform_pressure_is_transferred_between_different_cells(cells, is_finite_strain):
    """Both blocks are in uniaxial stress; the faces do not match. Forces and moments balance.

    A second increment with the same end makes the error of Newton's method negligible.
    """
    blocks = BlocksWithAMeshEach(
        cells,
        ((2, 3, 1), (3, 2, 2)),
        SAME_SECTION_BOXES,
        is_finite_strain,
        rollers=True,
        friction=0.0,
    )
    path = path_in_dimension([(0.0, 0.0, -0.1)] * 2, blocks.dim)
    state = blocks.move(path)[-1]
    for u, space in zip(blocks.functions, blocks.spaces, strict=True):
        x = space.tabulate_dof_coordinates()[:, : blocks.dim]
        affine = np.column_stack([np.ones(len(x)), x])
        displacement = u.x.array.reshape(len(x), blocks.dim)
        coefficients = np.linalg.lstsq(affine, displacement)[0]
        assert np.abs(affine @ coefficients - displacement).max() < 1e-11
        gradient = coefficients[1:]
        assert np.abs(gradient - np.diag(gradient.diagonal())).max() < 1e-11
        assert gradient[-1, -1] == pytest.approx(-0.1 / 1.7, rel=1e-10)
    force, x = forces_and_positions_of_both_sides(blocks, state)
    moment = (
        np.cross(x, force) if blocks.dim == 3 else x[:, 0] * force[:, 1] - x[:, 1] * force[:, 0]
    )
    size = np.abs(force).sum()
    assert np.abs(force.sum(axis=0)).max() < 1e-12 * size
    assert np.abs(moment.sum(axis=0)).max() < 1e-12 * size
    assert np.abs(state.pairs[0].gap).max() < 1e-12


@pytest.mark.parametrize(
    ("cell", "is_finite_strain"), [("tetrahedron", True), ("hexahedron", False), ("triangle", True)]
)
def test_blocks_with_a_mesh_each_have_the_states_of_blocks_in_one_mesh(cell, is_finite_strain):
    forces, displacements = [], []
    for is_in_one_mesh in (False, True):
        blocks = BlocksWithAMeshEach(
            (cell, cell),
            ((2, 2, 1), (2, 1, 1)),
            is_finite_strain=is_finite_strain,
            is_in_one_mesh=is_in_one_mesh,
            gap=0.01,
        )
        state = blocks.move(path_in_dimension(SLIDING_PATH[:2], blocks.dim))[-1]
        (pair,) = state.pairs
        forces.append(np.concatenate([pair.force_normal[:, None], pair.force_tangential], axis=1))
        displacements.append(pair.displacement)
    assert np.abs(forces[0]).max() > 0
    assert forces[0] == pytest.approx(forces[1], abs=1e-11 * np.abs(forces[1]).max())
    assert displacements[0] == pytest.approx(displacements[1], abs=1e-12)


@pytest.fixture(scope="module", params=[False, True], ids=["small strains", "finite strains"])
def sliding_punch(request):
    """Return a punch of tetrahedra on a block of hexahedra, and states in which it slides."""
    blocks = BlocksWithAMeshEach(is_finite_strain=request.param)
    return blocks, blocks.move(SLIDING_PATH)


def test_a_punch_of_tetrahedra_slides_on_hexahedra(sliding_punch):
    """It slides by more than a cell and off the rim; forces on both sides balance."""
    blocks, states = sliding_punch
    for state in states:
        assert state.residuals.largest() < 1e-9
        force, _ = forces_and_positions_of_both_sides(blocks, state)
        assert np.abs(force.sum(axis=0)).max() < 1e-12 * np.abs(force).sum()
    (pair,) = states[-1].pairs
    friction = np.linalg.norm(pair.force_tangential, axis=1)
    assert pair.force_normal.max() > 0
    assert friction == pytest.approx(0.3 * pair.force_normal, abs=1e-9 * pair.force_normal.max())
    assert np.isinf(pair.gap).any()


def test_states_of_bodies_with_a_mesh_each_are_saved(sliding_punch, tmp_path):
    blocks, states = sliding_punch
    blocks.problem.save(states[0], tmp_path / "state.npz")
    loaded = blocks.problem.load(tmp_path / "state.npz")
    assert np.array_equal(loaded.unknowns.array_r, states[0].unknowns.array_r)
    (resumed,) = blocks.move(SLIDING_PATH[1:2], loaded, SLIDING_PATH[0])
    expected = states[1].pairs[0].force_normal
    assert resumed.pairs[0].force_normal == pytest.approx(expected, abs=1e-11 * expected.max())


def slide_and_return_forces(comm, cells):
    """Return forces, statuses and displacements of a small punch that slides on a block."""
    blocks = BlocksWithAMeshEach(cells, ((2, 2, 1), (2, 1, 1)), comm=comm)
    path = [(0.0, 0.0, -0.03), (0.2, 0.1, -0.03)]
    state = blocks.move(path_in_dimension(path, blocks.dim))[-1]
    names = ("force_normal", "force_tangential", "status", "displacement")
    return {name: getattr(state.pairs[0], name) for name in names}


@pytest.mark.parametrize("cells", [SPACE_CELLS[0], PLANE_CELLS[1]])
def test_several_processes_give_the_same_numbers(cells):
    assert_same_on_processes(slide_and_return_forces, cells, process_counts=(2, 3), rel=1e-9)


def test_bodies_that_do_not_make_a_problem_are_refused():
    blocks = BlocksWithAMeshEach(PLANE_CELLS[0], ((1, 1, 1), (1, 1, 1)))
    (lower, upper), conditions, pair = blocks.meshes, blocks.conditions, blocks.pair
    residuals, functions = blocks.residuals, blocks.functions

    def state_problem(residuals=residuals, functions=functions, pair=pair, **options):
        return ContactProblem.of_residual(residuals, functions, conditions, pair, **options)

    top = on_plane(1, 0.0)
    with pytest.raises(ValueError, match="2 residuals and 1 unknown functions"):
        state_problem(functions=functions[:1])
    with pytest.raises(ValueError, match="two unknown functions are on one mesh"):
        state_problem(functions=[functions[0], functions[0]])
    with pytest.raises(ValueError, match="mesh of none of the bodies"):
        state_problem(residuals[:1], functions[:1])
    with pytest.raises(ValueError, match=r"solved by Direct\(\) only"):
        state_problem(solver=Iterative())
    with pytest.raises(ValueError, match="contact pair 0 has a side on several meshes"):
        state_problem(pair=replace(pair, surface=DeformableSurface(top, revolved=False)))
    with pytest.raises(ValueError, match=r"give the mesh before them, \(mesh, numbers\)"):
        state_problem(pair=replace(pair, nodes=np.array([0, 1])))
    other_mesh = BlocksWithAMeshEach(PLANE_CELLS[0], ((1, 1, 1), (1, 1, 1))).meshes[0]
    with pytest.raises(ValueError, match="a mesh that none of the bodies has"):
        state_problem(pair=replace(pair, nodes=(other_mesh, top)))
    with pytest.raises(ValueError, match="belong to both sides of their pair"):
        state_problem(pair=replace(pair, nodes=(lower, top)))
    with pytest.raises(ValueError, match="interface laws are supported for bodies in one mesh"):
        state_problem(pair=replace(pair, friction=0.0, interface_law=Tie()))
    hybrid = fem.Function(Spaces.hybrid(upper).trial)
    with pytest.raises(ValueError, match="a body has a pressure as an unknown"):
        state_problem(functions=[functions[0], hybrid])
    body = Body(Spaces.galerkin(upper), Material(1.0, 0.3), "plane strain")
    u = fem.Function(body.spaces.trial)
    conditions = [*blocks.conditions[:2], prescribe(u.function_space, 1, on_plane(1, 0.6))]
    with pytest.raises(ValueError, match="transfers forces by piecewise-linear weights"):
        state_problem([residuals[0], ufl.action(body.stiffness(), u)], [functions[0], u])


def test_forces_of_mixed_and_equal_cells_approach_each_other():
    """Under refinement, forces on triangles and quadrilaterals approach those on equal cells."""
    path = path_in_dimension([(0.0, 0.0, -0.03), (0.3, 0.0, -0.03)], 2)
    differences = []
    for n in (1, 2):
        divisions = (3 * n, 1, 2 * n), (2 * n, 1, 2 * n)
        mixed, *equal = (
            BlocksWithAMeshEach(cells, divisions).move(path)[-1].pairs[0].force
            for cells in (PLANE_CELLS[0], ("triangle",) * 2, ("quadrilateral",) * 2)
        )
        size = np.linalg.norm(mixed)
        differences.append([np.linalg.norm(force - mixed) / size for force in equal])
    assert 0 < max(differences[0]) < 0.01
    assert max(differences[1]) < 0.6 * max(differences[0])
