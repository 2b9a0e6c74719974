"""Contact of two deformable bodies with non-matching meshes at small displacements."""

from dataclasses import replace

from mpi4py import MPI

import matplotlib as mpl
import numpy as np
import pytest
from dolfinx import fem
from dolfinx.mesh import CellType, create_rectangle

from pw_elements import Sibling, prescribe, reactions, split
from pw_elements.contact import (
    HELD,
    OPEN,
    SLIP,
    STICK,
    ContactFields,
    ContactPair,
    DeformableSurface,
    FreeBody,
    Motion,
    NoEquilibrium,
    Plane,
    plot,
    write,
)
from pw_elements.contact.interface import gather_boundary_facets
from pw_elements.contact.interface.mortars.overlap import evaluate_corner_shape_functions
from pw_elements.spaces import SubSpace
from tests.contact.cases import ElasticBody, on_plane
from tests.contact.test_friction import assert_friction_law
from tests.contact.two_bodies import (
    PLANE_CELLS,
    TOP_PRESSURE_OVER_MODULUS,
    StackedBlocks,
    join_meshes,
    split_facets_by_side,
)


def nodal_values(function, nodes):
    """Return the values (m,) or (m, dim) of a function at nodes."""
    block = function.function_space.dofmap.index_map_bs
    rows = function.x.array.reshape(-1, block)[nodes]
    return rows[:, 0] if block == 1 else rows


def contact_and_support_forces(stack, state, load):
    """Return the nodal forces (n, dim) that contact and supports exert on the bodies."""
    field = SubSpace.displacements(stack.space)
    return field.extract(reactions(stack.K, state.unknowns, load)).array.reshape(-1, stack.dim)


def relative_imbalance_of_contact(stack, state, load):
    """Return the largest component of the resultant force and moment of contact, without unit.

    The forces on both bodies are added and should cancel. The result is divided by the sum of the
    magnitudes of all components of the nodal forces.
    """
    interface_mask = stack.side_node_mask("upper") | stack.side_node_mask("lower")
    force, x = (
        contact_and_support_forces(stack, state, load)[interface_mask],
        stack.x[interface_mask],
    )
    moment = np.cross(x, force) if stack.dim == 3 else x[:, 0] * force[:, 1] - x[:, 1] * force[:, 0]
    total_magnitude = np.abs(force).sum()
    return max(np.abs(force.sum(axis=0)).max(), np.abs(moment.sum(axis=0)).max()) / total_magnitude


def assert_uniaxial_displacements(stack, state, nu=0.3, relative_tolerance=1e-11):
    """Assert that the displacements of a state are those of uniaxial stress."""
    exact = stack.uniaxial_displacement(nu)
    displacement = state.displacement.array.reshape(exact.shape)
    assert displacement == pytest.approx(exact, abs=relative_tolerance * np.abs(exact).max())


@pytest.mark.parametrize(
    ("cell", "slave", "friction", "element", "nu", "state"),
    [
        *(
            (cell, slave, 0.3, "petrov_galerkin", 0.3, None)
            for cell in (*PLANE_CELLS, "tetrahedron", "hexahedron")
            for slave in ("upper", "lower")
        ),
        ("quadrilateral", "lower", 0.0, "petrov_galerkin", 0.3, None),
        ("tetrahedron", "upper", 0.0, "petrov_galerkin", 0.3, None),
        ("triangle", "upper", 0.0, "petrov_galerkin", 0.3, "axisymmetric"),
        ("triangle", "lower", 0.0, "petrov_galerkin", 0.3, "axisymmetric"),
        ("triangle", "upper", 0.3, "hybrid", 0.5, None),
        ("triangle", "lower", 0.3, "hybrid", 0.3, None),
        ("tetrahedron", "lower", 0.3, "hybrid", 0.5, None),
        ("hexahedron", "upper", 0.3, "hybrid", 0.5, None),
    ],
)
def test_patch_test_passes(cell, slave, friction, element, nu, state):
    divisions = (4, 7) if cell in PLANE_CELLS else (2, 3)
    stack = StackedBlocks(divisions, cell, element=element, nu=nu, state=state)
    solution = stack.solve_uniaxial_compression(slave, friction)
    assert_uniaxial_displacements(stack, solution, nu)
    assert solution.residuals.largest() < 1e-11
    if element == "hybrid":
        stress_ratio = nu if stack.dim == 2 else nu / (1 + nu)
        _, pressure = split(stack.space, solution.unknowns)
        assert pressure.x.array == pytest.approx(TOP_PRESSURE_OVER_MODULUS * stress_ratio, rel=1e-9)
    fields = ContactFields.from_state(solution, stack.body)
    for side in ("upper", "lower"):
        nodes = stack.side_node_mask(side)
        for pressure_field in (fields.pressure, fields.tributary_pressure):
            assert nodal_values(pressure_field, nodes) == pytest.approx(
                TOP_PRESSURE_OVER_MODULUS, rel=1e-8
            )
        assert np.abs(nodal_values(fields.traction, nodes)).max() < 1e-9 * TOP_PRESSURE_OVER_MODULUS
        assert np.abs(nodal_values(fields.gap, nodes)).max() < 1e-12
        assert set(nodal_values(fields.status, nodes)) <= {STICK, HELD} or not friction


@pytest.mark.parametrize(("slave", "amplitude"), [("upper", 0.15), ("lower", 0.05)])
def test_patch_test_passes_on_distorted_quadrilaterals(slave, amplitude):
    """The patch test passes on distorted quadrilaterals, whose weights are not polynomials.

    They are the flat faces of hexahedra, and are not parallelograms.
    """

    def distort(x):
        bubble = amplitude * np.sin(np.pi * x[:, 0]) * np.sin(np.pi * x[:, 1])
        direction = np.stack(
            [np.cos(3 * x[:, 1] + 1), np.sin(2 * x[:, 0] + 0.3), 0 * bubble], axis=1
        )
        return x + bubble[:, None] * direction

    stack = StackedBlocks((2, 3), "hexahedron", map_upper=distort)
    assert_uniaxial_displacements(
        stack, stack.solve_uniaxial_compression(slave), relative_tolerance=1e-10
    )


@pytest.mark.parametrize("slave", ["upper", "lower"])
@pytest.mark.parametrize("cell", ["triangle", "hexahedron"])
def test_patch_test_passes_where_facets_are_partly_covered(cell, slave):
    """The patch test passes where the upper block covers only a part of the lower block's facets.

    The upper block ends inside facets of the lower one. A load presses the uncovered part of the
    lower block with the same pressure.
    """
    end, h = (0.81, 0.1) if cell in PLANE_CELLS else (0.83, 1 / 6)
    stack = StackedBlocks(
        (5, 4) if cell in PLANE_CELLS else (3, 2), cell, map_upper=lambda x: x * [end, 1.0, 1.0]
    )
    load = stack.traction_load(-TOP_PRESSURE_OVER_MODULUS * np.eye(stack.dim)[stack.up])
    nodes, corners, _ = gather_boundary_facets(
        stack.space, stack.sides["lower"]
    ).sub_facet_nodes_corners_and_normals
    forces = -TOP_PRESSURE_OVER_MODULUS * integrate_hat_functions_beyond(corners, end)
    np.add.at(load.array.reshape(-1, stack.dim)[:, stack.up], nodes, forces)
    state = stack.solve_uniaxial_compression(slave, 0.3 if cell == "hexahedron" else 0.0, load)
    assert_uniaxial_displacements(stack, state, relative_tolerance=1e-9)
    assert np.isinf(state.pairs[0].gap).any() == (slave == "lower")
    pressure = ContactFields.from_state(state, stack.body).pressure
    assert nodal_values(pressure, stack.side_node_mask("upper")) == pytest.approx(
        TOP_PRESSURE_OVER_MODULUS, rel=1e-8
    )
    lower_nodes = np.flatnonzero(stack.side_node_mask("lower"))
    x, pressures = stack.x[lower_nodes, 0], nodal_values(pressure, lower_nodes)
    is_uncovered = x > end + h - 1e-9
    assert is_uncovered.any()
    assert np.abs(pressures[is_uncovered]).max() < 1e-12 * TOP_PRESSURE_OVER_MODULUS
    # in the plane, only a 200th of the last covered nodes' weights is covered; in space far more
    is_hardly_covered = ~is_uncovered & (x > end) & (cell == "triangle")
    assert np.isnan(pressures[is_hardly_covered]).all()
    assert is_hardly_covered.any() == (cell == "triangle")
    assert pressures[~is_uncovered & ~is_hardly_covered] == pytest.approx(
        TOP_PRESSURE_OVER_MODULUS, rel=1e-8
    )


def integrate_hat_functions_beyond(corners, end_x):
    """Return integrals (s, k) of the hat functions of axis-parallel sub-facets over x > end.

    `corners` (s, k, dim) are the corners of the sub-facets.
    """
    ends = corners[:, [0, -1]]
    left, width = ends[:, :, 0].min(axis=1), np.abs(ends[:, 1] - ends[:, 0])
    u = np.clip((end_x - left) / width[:, 0], 0.0, 1.0)
    line_weights = np.stack([(1 - u) ** 2 / 2, (1 - u**2) / 2], axis=1) * width[:, :1]
    backwards = ends[:, 1, 0] < ends[:, 0, 0]
    line_weights[backwards] = line_weights[backwards, ::-1]
    return line_weights if corners.shape[1] == 2 else np.tile(line_weights, 2) * width[:, 1:2] / 2


def test_shape_functions_are_found_in_any_convex_quadrilateral():
    """They interpolate the points, also where a quadrilateral is almost a triangle."""
    generator = np.random.default_rng(1)
    corners = generator.uniform(-1, 1, (20_000, 4, 2))  # in tensor-product order
    edges = np.roll(corners[:, [0, 1, 3, 2]], -1, axis=1) - corners[:, [0, 1, 3, 2]]
    following = np.roll(edges, -1, axis=1)
    turns = edges[..., 0] * following[..., 1] - edges[..., 1] * following[..., 0]
    corners = corners[(turns > 1e-3).all(axis=1)]
    u, v = generator.uniform(0, 1, (2, len(corners), 5))
    functions = np.stack([(1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v], axis=2)
    found = evaluate_corner_shape_functions(corners, functions @ corners)
    assert len(corners) > 1000
    np.testing.assert_allclose(found, functions, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("cell", "slave", "element", "nu"),
    [
        ("triangle", "upper", "petrov_galerkin", 0.3),
        ("triangle", "lower", "hybrid", 0.5),
        ("tetrahedron", "upper", "hybrid", 0.5),
        ("tetrahedron", "lower", "petrov_galerkin", 0.3),
        ("hexahedron", "upper", "petrov_galerkin", 0.3),
        ("hexahedron", "lower", "hybrid", 0.5),
    ],
)
def test_forces_and_moments_balance_and_fields_contain_them(cell, slave, element, nu):
    low, high = 0.13, 0.83
    divisions = (5, 4) if cell in PLANE_CELLS else (3, 2)
    stack = StackedBlocks(divisions, cell, upper_range=(low, high), element=element, nu=nu)
    state = stack.solve_shifted_top(slave)
    assert state.residuals.largest() < 1e-9
    assert relative_imbalance_of_contact(stack, state, stack.zero_load) < 1e-12
    fields, (pair,) = ContactFields.from_state(state, stack.body), state.pairs
    assert_friction_law(pair, lambda r, _: 0.2 * r, None)
    force = nodal_values(fields.force, slice(None))
    interface_mask = stack.side_node_mask("upper") | stack.side_node_mask("lower")
    unbalanced = contact_and_support_forces(stack, state, stack.zero_load)
    assert force[interface_mask] == pytest.approx(
        unbalanced[interface_mask], abs=1e-10 * np.abs(unbalanced[interface_mask]).max()
    )
    assert not force[~interface_mask].any()
    for name in ("gap", "status", "slip"):
        field_values = getattr(fields, name).x.array.reshape(len(stack.x), -1)
        expected = np.nan_to_num(getattr(pair, name).reshape(len(pair.node), -1), posinf=-1.0)
        assert np.array_equal(np.nan_to_num(field_values[pair.node], nan=-1.0), expected)
    pressures = fields.pressure.x.array[pair.node]
    assert np.array_equal(
        pressures[np.isfinite(pressures)] > 0, pair.force_normal[np.isfinite(pressures)] > 0
    )


@pytest.mark.parametrize("motion", [Motion((0.0, 0.02)), Motion((0.0, None), (0.0, 0.01))])
def test_a_motion_moves_the_opposite_body_closer(motion):
    stack = StackedBlocks((4, 5), nu=0.0)
    (state,) = stack.solve_contact(
        stack.make_pair("upper", 0.0, [motion]), stack.fixed_base_moved_top_supports((0.0, 0.0))
    )
    assert state.pairs[0].translation == pytest.approx([0.0, 0.02], rel=1e-9)
    assert state.pairs[0].force == pytest.approx([0.0, 0.01], rel=1e-9, abs=1e-12)


STACKED_BLOCKS = StackedBlocks((3, 2))
UPPER_SIDE_NODE_MASK, LOWER_SIDE_FACETS = (
    STACKED_BLOCKS.side_node_mask("upper"),
    STACKED_BLOCKS.sides["lower"],
)


@pytest.mark.parametrize(
    ("nodes", "facets", "kind", "message"),
    [
        (UPPER_SIDE_NODE_MASK, STACKED_BLOCKS.sides["upper"], ValueError, "belong to both sides"),
        (
            UPPER_SIDE_NODE_MASK & (STACKED_BLOCKS.x[:, 0] > 0.9),
            LOWER_SIDE_FACETS,
            ValueError,
            "belong to no facet that is all in their pair",
        ),
        (on_plane(1, 2.0), LOWER_SIDE_FACETS, ValueError, "on the far side of its body"),
        (UPPER_SIDE_NODE_MASK, lambda x: x[1] > 3, ValueError, "has no opposite facets"),
        (
            UPPER_SIDE_NODE_MASK,
            lambda x: np.isclose(x[0], 0.0) & (x[1] < 1),
            ValueError,
            "do not overlap",
        ),
        (
            UPPER_SIDE_NODE_MASK,
            Plane((0, 0), (0, 1)),
            TypeError,
            "a surface is given in place of facets",
        ),
    ],
)
def test_invalid_mortar_pairs_are_refused(nodes, facets, kind, message):
    with pytest.raises(kind, match=message):
        STACKED_BLOCKS.solve_contact(
            ContactPair(nodes, DeformableSurface(facets)),
            STACKED_BLOCKS.fixed_base_moved_top_supports([0.0, -0.01]),
        )


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral", "tetrahedron", "hexahedron"])
def test_elements_without_piecewise_linear_weights_are_refused(cell):
    """Elements without piecewise-linear weights are refused as slaves of a mortar contact.

    With such elements the patch test fails, by up to 60 % of the pressure.
    """
    raises_error = pytest.raises(ValueError, match="forces by piecewise-linear weights")
    for element in ("galerkin", "taylor_hood"):
        with raises_error:
            StackedBlocks((3, 2), cell, element=element).solve_uniaxial_compression()
    if cell == "triangle":
        StackedBlocks((3, 2), cell, element="composite").solve_uniaxial_compression()
        stack = StackedBlocks((3, 2), element="galerkin")
        sibling = Sibling.from_space(stack.space)
        stack.K = sibling.matrix(stack.K)
        supports = sibling.dirichlet([prescribe(stack.space, i, on_plane(1, 0.0)) for i in (0, 1)])
        with raises_error:
            stack.contact_problem(stack.make_pair(), supports)


def test_a_coarse_slave_is_logged_as_a_warning(caplog):
    stack = StackedBlocks((3, 12))
    for slave, is_warned in (("upper", False), ("lower", True)):
        caplog.clear()
        stack.solve_contact(
            stack.make_pair(slave), stack.fixed_base_moved_top_supports([0.0, -0.01])
        )
        assert ("facets are 4.0 times as large as those they face" in caplog.text) == is_warned


@pytest.mark.parametrize(
    ("traction", "friction", "kind", "message"),
    [
        ((0.0, -TOP_PRESSURE_OVER_MODULUS), 0.0, FreeBody, "translation x of the body around"),
        (
            (0.4 * TOP_PRESSURE_OVER_MODULUS, -TOP_PRESSURE_OVER_MODULUS),
            0.3,
            NoEquilibrium,
            "slides along",
        ),
        ((0.0, TOP_PRESSURE_OVER_MODULUS), 0.3, NoEquilibrium, "lifts off pair 0"),
    ],
)
def test_a_loose_body_is_named_in_the_refusal(traction, friction, kind, message):
    with pytest.raises(kind, match=message):
        STACKED_BLOCKS.solve_contact(
            STACKED_BLOCKS.make_pair("upper", friction),
            STACKED_BLOCKS.make_clamping_supports(on_plane(1, 0.0)),
            STACKED_BLOCKS.traction_load(traction),
        )


@pytest.mark.parametrize("cell", ["triangle", "tetrahedron"])
def test_friction_on_a_slave_that_supports_move_along_is_refused(cell):
    """Friction at slave nodes that supports move along the other body is refused.

    The friction law cannot be imposed at such nodes. If slave and master are exchanged, the problem
    is solved, and friction acts at the nodes of the other body.
    """
    stack = StackedBlocks((3, 2), cell)
    up = stack.up
    translation = np.array([0.02] + [0.0] * (up - 1) + [-0.01])
    slave_nodes = np.flatnonzero(stack.side_node_mask("upper"))
    side_conditions = [
        (i, lambda x: np.isin(np.arange(x.shape[1]), slave_nodes), translation[i])
        for i in range(up)
    ]
    supports = stack.fixed_base_moved_top_supports(translation, side_conditions)
    with pytest.raises(ValueError, match="would get no friction: exchange both sides"):
        stack.solve_contact(stack.make_pair("upper", 0.3), supports)
    stack.solve_contact(stack.make_pair("upper"), supports)
    (state,) = stack.solve_contact(stack.make_pair("lower", 0.3), supports)
    (pair,) = state.pairs
    assert pair.force[0] == pytest.approx(-0.3 * pair.force[up], rel=5e-3)
    assert pair.opposite_force.sum(axis=0) == pytest.approx(-pair.force, rel=1e-9, abs=1e-12)


def test_overlapping_bodies_are_refused():
    stack = StackedBlocks((3, 2), map_upper=lambda x: x - 0.01 * (2 - x[:, 1:2]) * [0, 1, 0])
    with pytest.raises(ValueError, match="lie inside the body that they face"):
        stack.solve_contact(stack.make_pair(), stack.fixed_base_moved_top_supports([0.0, 0.0]))


def hat_functions(x, node_positions):
    """Return the piecewise-linear hat functions (n, m) of sorted nodes (m,) at points (n,)."""
    return np.stack(
        [np.interp(x, node_positions, row) for row in np.eye(len(node_positions))], axis=1
    )


@pytest.mark.parametrize("slave", ["upper", "lower"])
def test_gap_slip_and_status_of_the_master_are_means_of_those_of_the_slave(slave):
    """Gap, slip and status on the master are weighted means of those on the slave.

    The weights are computed independently, by sampling the hat functions of both sides at points
    along the interface.
    """
    low, high = 0.13, 0.83
    stack = StackedBlocks((5, 4), upper_range=(low, high))
    state = stack.solve_shifted_top(slave, lambda x: 0.1 + 0.2 * x[0])
    (pair,) = state.pairs
    assert set(pair.status) >= {STICK, SLIP}
    fields, fields_of_space = (
        ContactFields.from_state(state, part) for part in (stack.body, stack.space)
    )
    x = low + (high - low) * (np.arange(100_000) + 0.5) / 100_000
    slave_hats, master_hats = (
        hat_functions(x, pair.position[:, 0]),
        hat_functions(x, stack.x[pair.opposite_node, 0]),
    )
    weight = master_hats.T @ slave_hats
    faced = weight.sum(axis=1) > 0
    mean = weight[faced] / weight[faced].sum(axis=1, keepdims=True)
    faced_nodes = pair.opposite_node[faced]
    gap = np.where(np.isfinite(pair.gap), pair.gap, 0.0)
    for contact_fields in (fields, fields_of_space):
        assert nodal_values(contact_fields.gap, faced_nodes) == pytest.approx(mean @ gap, abs=1e-9)
        assert nodal_values(contact_fields.slip, faced_nodes) == pytest.approx(
            -mean @ pair.slip, abs=1e-9
        )
        status_fractions = mean @ np.eye(3)[pair.status]
        assert np.array_equal(
            nodal_values(contact_fields.status, faced_nodes), status_fractions.argmax(axis=1)
        )
        unfaced_nodes = pair.opposite_node[~faced]
        assert np.isnan(nodal_values(contact_fields.gap, unfaced_nodes)).all()
        assert not nodal_values(contact_fields.slip, unfaced_nodes).any()
        assert (nodal_values(contact_fields.status, unfaced_nodes) == OPEN).all()


def make_rectangle_mesh(low, high, divisions):
    return create_rectangle(MPI.COMM_SELF, [low, high], divisions, CellType.triangle)


def test_two_slaves_on_one_master_and_a_rigid_floor_have_uniform_pressure():
    """The pressure is uniform between two slaves and one master, which lies on a rigid floor.

    The two upper blocks meet above the interior of a facet of the master. The thickness of all
    blocks is 0.4.
    """
    end = 0.47
    lower_mesh = make_rectangle_mesh((0.0, 0.0), (1.0, 1.0), (5, 4))
    upper_meshes = join_meshes(
        make_rectangle_mesh((0.0, 1.0), (end, 2.0), (3, 3)),
        make_rectangle_mesh((end, 1.0), (1.0, 2.0), (4, 4)),
    )
    body = ElasticBody(join_meshes(lower_mesh, upper_meshes), E=1.0, nu=0.0, thickness=0.4)
    master_facets, slave_facets = split_facets_by_side(
        body, on_plane(1, 1.0), lambda x: x[:, 1] > 1
    )
    left, right = (
        np.intersect1d(
            slave_facets, split_facets_by_side(body, on_plane(1, 1.0), lambda x: x[:, 0] > end)[k]
        )
        for k in (0, 1)
    )
    nodes = [fem.locate_dofs_topological(body.space, 1, side) for side in (left, right)]
    master, floor = (
        DeformableSurface(master_facets),
        ContactPair(on_plane(1, 0.0), Plane((0, 0), (0, 1))),
    )
    pairs = [ContactPair(nodes[0], master), floor, ContactPair(nodes[1], master)]
    supports = body.make_supports(*((0, on_plane(0, x)) for x in (0.0, end, 1.0)))
    (state,) = body.solve_contact(
        pairs, supports, body.traction_load((0.0, -TOP_PRESSURE_OVER_MODULUS), on_plane(1, 2.0))
    )
    fields = ContactFields.from_state(state, body.body)
    on_master = fem.locate_dofs_topological(body.space, 1, master_facets)
    for face_nodes in (*nodes, on_master, state.pairs[1].node):
        assert nodal_values(fields.pressure, face_nodes) == pytest.approx(
            TOP_PRESSURE_OVER_MODULUS, rel=1e-9
        )
    assert fields.opposite[1] is None
    changed_state = replace(
        state, pairs=(*state.pairs[:2], replace(state.pairs[2], opposite_node=nodes[0]))
    )
    for part in (body.body, body.space):
        with pytest.raises(ValueError, match="other contact nodes than the fields"):
            ContactFields.from_state(state, part).fill(changed_state)


def test_a_body_between_two_others_has_the_pressure_of_each_pair():
    levels = [
        make_rectangle_mesh((0.0, k), (1.0, k + 1.0), (n, 3)) for k, n in enumerate((4, 7, 5))
    ]
    body = ElasticBody(join_meshes(join_meshes(levels[0], levels[1]), levels[2]), E=1.0)
    pairs, faces = [], []
    for height in (1.0, 2.0):
        lower_facets, upper_facets = split_facets_by_side(
            body, on_plane(1, height), lambda x, h=height: x[:, 1] > h
        )
        faces += [
            fem.locate_dofs_topological(body.space, 1, side)
            for side in (lower_facets, upper_facets)
        ]
        pairs.append(ContactPair(faces[-1], DeformableSurface(lower_facets), 0.3))
    supports = body.make_supports(*((i, on_plane(i, 0.0)) for i in range(2)))
    (state,) = body.solve_contact(
        pairs, supports, body.traction_load((0.0, -TOP_PRESSURE_OVER_MODULUS), on_plane(1, 3.0))
    )
    fields = ContactFields.from_state(state, body.body)
    for nodes in faces:
        assert nodal_values(fields.pressure, nodes) == pytest.approx(
            TOP_PRESSURE_OVER_MODULUS, rel=1e-8
        )
        assert set(nodal_values(fields.status, nodes)) <= {STICK, HELD}


@pytest.mark.parametrize("element", ["petrov_galerkin", "hybrid"])
def test_pictures_of_the_opposite_side_show_its_tractions(element, tmp_path):
    mpl.use("Agg")
    stack = StackedBlocks((5, 4), upper_range=(0.13, 0.83), element=element)
    state = stack.solve_shifted_top()
    write(tmp_path / "two.bp", [state], stack.body)
    (pair,), fields = state.pairs, ContactFields.from_state(state, stack.body)
    curves = [line.get_xydata() for line in plot(state, stack.body, along=0, opposite=True).lines]
    shear = nodal_values(fields.traction, pair.opposite_node)[:, 0]
    for expected in (nodal_values(fields.pressure, pair.opposite_node), shear):
        curve = np.column_stack([stack.x[pair.opposite_node, 0], expected])
        assert any(c.shape == curve.shape and np.allclose(c, curve, equal_nan=True) for c in curves)
    solid = StackedBlocks((3, 2), "tetrahedron", upper_range=(0.13, 0.83), element=element)
    state = solid.solve_shifted_top()
    axes = plot(state, solid.body, opposite=True)
    (coloured_faces,) = (c for c in axes.collections if hasattr(c, "_triangulation"))
    assert len(coloured_faces.get_array()) == len(state.pairs[0].opposite_node)
