"""Accepted forms of input: facets, masks, numbers of any type, one object instead of a list."""

from types import UnionType
from typing import Union, get_args, get_origin, get_type_hints

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx.mesh import exterior_facet_indices, meshtags

from pw_elements import (
    Body,
    Material,
    PetrovGalerkinProblem,
    Reduction,
    Spaces,
    assemble_vector,
    boundary_measure,
    prescribe,
    solve,
)
from pw_elements.checks import call_user_function, raise_errors_on_all_processes
from pw_elements.contact import (
    ContactPair,
    ContactProblem,
    FlatPunch,
    Motion,
    Parabola,
    Plane,
    Sphere,
    solve_contact,
    write,
)
from pw_elements.elasticity import StressState, nodal_load
from pw_elements.meshes import curved_mesh, move_nodes, triangles
from pw_elements.spaces import evaluate_marker
from tests.contact.cases import BlockOnFloor, on_plane

BLOCK_ON_FLOOR = BlockOnFloor(4)
DISPLACEMENT_SPACE, K, MESH = (
    BLOCK_ON_FLOOR.space,
    BLOCK_ON_FLOOR.K,
    BLOCK_ON_FLOOR.body.spaces.mesh,
)
FLOOR, BOTTOM_MARKER = Plane((0, 0), (0, 1)), on_plane(1, 0.0)
EXTERIOR_FACETS = exterior_facet_indices(MESH.topology)


def solve_for_pair_state(pair, **options):
    (state,) = solve_contact(
        K,
        BLOCK_ON_FLOOR.pressure_load,
        BLOCK_ON_FLOOR.no_supports,
        pair,
        DISPLACEMENT_SPACE,
        **options,
    )
    return state.pairs[0]


@pytest.mark.parametrize("kind", [np.int32, np.int64, np.uint8, bool, list])
def test_facets_may_be_integers_of_any_type_or_a_mask(kind):
    """Facets may be given by numbers of any integer type or by a mask.

    A mask must not be mistaken for the facet numbers 0 and 1, which give a load of 1 instead of 12.
    """
    n_facets = MESH.topology.index_map(1).size_local
    if kind is bool:
        facets = np.isin(np.arange(n_facets), EXTERIOR_FACETS)
    else:
        facets = list(EXTERIOR_FACETS) if kind is list else EXTERIOR_FACETS.astype(kind)
    load = assemble_vector(
        BLOCK_ON_FLOOR.body.surface_load((0, 1.0), boundary_measure(MESH, facets))
    )
    assert load.sum() == pytest.approx(12.0)


def test_a_marker_may_return_a_strided_array():
    marked = boundary_measure(MESH, lambda x: np.repeat(np.isclose(x[1], 0.0), 2)[::2])
    load = assemble_vector(BLOCK_ON_FLOOR.body.surface_load((0, 1.0), marked))
    assert load.sum() == pytest.approx(4.0)


def test_markers_are_not_called_without_points():
    """A marker is not called on a process that has no points.

    Without points, the maximum of the coordinates in this marker is undefined.
    """
    assert evaluate_marker(
        MPI.COMM_SELF, "it", lambda x: x[0] == x[0].max(), np.zeros((3, 0))
    ).shape == (0,)


def test_nodes_located_on_tagged_facets_make_a_contact_pair():
    tags = meshtags(MESH, 1, EXTERIOR_FACETS, np.ones(len(EXTERIOR_FACETS), dtype=np.int32))
    nodes = fem.locate_dofs_topological(DISPLACEMENT_SPACE, 1, tags.find(1))
    low = nodes[np.isclose(DISPLACEMENT_SPACE.tabulate_dof_coordinates()[nodes, 1], 0.0)]
    assert len(solve_for_pair_state(ContactPair(low, FLOOR, 0.3)).position) == len(low)


def test_mesh_maps_may_return_two_components_and_failed_ones_change_nothing():
    mesh = triangles(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (2, 2))
    original = mesh.geometry.x.copy()
    for map_mesh in (move_nodes, curved_mesh):
        with pytest.raises(ValueError, match="the image of the mesh"):
            map_mesh(mesh, lambda x: x.fill(0.0))
        assert np.array_equal(mesh.geometry.x, original)
    largest = curved_mesh(mesh, lambda x: 2 * x[:, :2]).geometry.x.max()
    assert largest == move_nodes(mesh, lambda x: 2 * x[:, :2]).geometry.x.max() == 2.0


def test_a_single_pair_motion_or_condition_needs_no_list():
    pair = solve_for_pair_state(ContactPair(BOTTOM_MARKER, FLOOR, 0.3, Motion((0, 0.1))))
    assert pair.translation == pytest.approx((0, 0.1))
    problem = ContactProblem(
        K, BLOCK_ON_FLOOR.no_supports, ContactPair(BOTTOM_MARKER, FLOOR, 0.3), DISPLACEMENT_SPACE
    )
    state = problem.step(problem.undeformed, BLOCK_ON_FLOOR.pressure_load, Motion((0, 0.1)))
    assert np.array_equal(state.pairs[0].force_normal, pair.force_normal)
    unmoved = problem.step(problem.undeformed, BLOCK_ON_FLOOR.pressure_load, None)
    assert unmoved.pairs[0].translation == pytest.approx((0, 0))
    condition = prescribe(DISPLACEMENT_SPACE, 0, on_plane(0, 0.0))
    size_of_one, size_of_list = (
        Reduction.dirichlet(DISPLACEMENT_SPACE, conditions).right.getSize()
        for conditions in (condition, [condition])
    )
    assert size_of_one == size_of_list


def test_numbers_may_be_of_any_type_and_friction_functions_may_return_one_number():
    for radius in (1, np.float32(1), np.array(1.0), np.int64(1)):
        assert Sphere((0, 0), radius).gap(np.array([[0.0, 2.0]])) == pytest.approx([1.0])
    for mu in (np.array(0.25), lambda _: 0.25):
        pair = solve_for_pair_state(
            ContactPair(BOTTOM_MARKER, FLOOR, mu), max_iterations=np.int64(50)
        )
        assert np.all(pair.friction == 0.25)
    integers = Motion(np.array([0, 1]))
    assert integers.translation_and_rotation().dtype == integers.force_and_torque().dtype == float
    assert np.all(
        prescribe(DISPLACEMENT_SPACE, np.int64(1), BOTTOM_MARKER, np.float32(0.5)).g.value == 0.5
    )
    body = Body(Spaces.galerkin(MESH), BLOCK_ON_FLOOR.body.material, "axisymmetric")
    assert body.state is StressState.AXISYMMETRIC


def test_component_0_of_a_scalar_space_can_be_prescribed():
    V = fem.functionspace(MESH, ("Lagrange", 2))
    condition = prescribe(V, 0, BOTTOM_MARKER, 2.0)
    assert (
        Reduction.dirichlet(V, condition).offset.sum() == 2.0 * len(condition.dof_indices()[0]) > 0
    )


def test_conditions_that_say_the_same_do_not_contradict():
    """Two conditions that prescribe the same value at a node do not contradict each other.

    Conditions on the test space, which has the same nodes, do not contradict either.
    """
    condition = prescribe(BLOCK_ON_FLOOR.body.spaces.test, 0, BOTTOM_MARKER)
    assert Reduction.dirichlet(DISPLACEMENT_SPACE, condition).right.getSize()[1] < K.getSize()[0]
    conditions = [
        prescribe(DISPLACEMENT_SPACE, 0, marker, 0.0)
        for marker in (on_plane(0, 0.0), BOTTOM_MARKER)
    ]
    assert Reduction.dirichlet(DISPLACEMENT_SPACE, conditions).right.getSize()[1] < K.getSize()[0]


def test_user_function_errors_are_the_cause_of_the_library_error():
    comm = MPI.COMM_SELF
    message = r"^the marker failed: KeyError: 'x'$"
    with pytest.raises(ValueError, match=message) as raised, raise_errors_on_all_processes(comm):
        call_user_function(comm, "the marker", {}.__getitem__, "x")
    assert isinstance(raised.value.__cause__, KeyError)


def make_load_of_size(max_entry):
    load = BLOCK_ON_FLOOR.pressure_load.copy()
    load.scale(max_entry / load.norm(3))
    return load


def make_stretch_reduction(displacement):
    clamped = [prescribe(DISPLACEMENT_SPACE, k, on_plane(1, 0.0)) for k in (0, 1)]
    return Reduction.dirichlet(
        DISPLACEMENT_SPACE,
        [*clamped, prescribe(DISPLACEMENT_SPACE, 1, on_plane(1, 1.0), displacement)],
    )


def solve_residual_problem(modulus=1.0, load=0.0, depth=0.0, contact=False):
    mesh = triangles(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (2, 2))
    spaces = Spaces.petrov_galerkin(mesh)
    E, body_force = fem.Constant(mesh, modulus), fem.Constant(mesh, load)
    u, v = fem.Function(spaces.trial), ufl.TestFunction(spaces.test)
    residual = (
        E * ufl.inner(ufl.sym(ufl.grad(u)), ufl.grad(v)) * ufl.dx - body_force * v[0] * ufl.dx
    )
    clamped = [prescribe(spaces.trial, k, on_plane(1, 0.0)) for k in (0, 1)]
    if not contact:
        clamped.append(prescribe(spaces.trial, 1, on_plane(1, 1.0), depth))
        return PetrovGalerkinProblem(residual, u, clamped).solve()
    pair = ContactPair(on_plane(1, 1.0), Plane((0, 1), (0, -1)))
    problem = ContactProblem.of_residual(residual, u, clamped, pair)
    return problem.step(problem.undeformed, motions=Motion((0.0, -depth)))


CALLS_WITH_OUT_OF_RANGE_NUMBERS = {
    "a small load": lambda: solve(
        K, make_load_of_size(1e-300), BLOCK_ON_FLOOR.make_clamping_supports(BOTTOM_MARKER)
    ),
    "a large load": lambda: solve(
        K, make_load_of_size(1e300), BLOCK_ON_FLOOR.make_clamping_supports(BOTTOM_MARKER)
    ),
    "a load of contact": lambda: solve_floor_contact(make_load_of_size(1e-300)),
    "a modulus": lambda: Material(1e-300),
    "a modulus's nodal values": lambda: Material(constant_function(1e-300)),
    "a stiffness": lambda: solve(
        1e-300 * K,
        BLOCK_ON_FLOOR.pressure_load,
        BLOCK_ON_FLOOR.make_clamping_supports(BOTTOM_MARKER),
    ),
    "a large stiffness": lambda: solve(
        1e300 * K,
        BLOCK_ON_FLOOR.pressure_load,
        BLOCK_ON_FLOOR.make_clamping_supports(BOTTOM_MARKER),
    ),
    "a prescribed displacement": lambda: make_stretch_reduction(1e300),
    "a motion": lambda: Motion((0.0, 1e300)),
    "a force on a surface": lambda: Motion((0.0, None), (0.0, 1e300)),
    "a traction": lambda: BLOCK_ON_FLOOR.body.surface_load(
        (0, 1e300), boundary_measure(MESH, EXTERIOR_FACETS)
    ),
    "a residual's modulus": lambda: solve_residual_problem(modulus=1e-300),
    "a residual's load": lambda: solve_residual_problem(load=1e-300),
    "a residual's condition": lambda: solve_residual_problem(depth=1e300),
    "a residual's modulus in contact": lambda: solve_residual_problem(1e-300, contact=True),
    "a residual's load in contact": lambda: solve_residual_problem(load=1e-300, contact=True),
}


def solve_floor_contact(load):
    solve_contact(
        K,
        load,
        BLOCK_ON_FLOOR.no_supports,
        ContactPair(BOTTOM_MARKER, FLOOR, 0.3),
        DISPLACEMENT_SPACE,
    )


def constant_function(value):
    function = fem.Function(fem.functionspace(MESH, ("Lagrange", 1)))
    function.x.array[:] = value
    return function


@pytest.mark.parametrize("call_name", CALLS_WITH_OUT_OF_RANGE_NUMBERS)
def test_numbers_that_lose_their_digits_are_refused(call_name):
    """Numbers so small or large that they lose their digits are refused.

    Norms of such numbers underflow or overflow, because they are computed from squares.
    """
    with pytest.raises(ValueError, match="choose units in which it is nearer to one"):
        CALLS_WITH_OUT_OF_RANGE_NUMBERS[call_name]()


@pytest.mark.parametrize("unit", [1e-60, 1e60])
def test_numbers_in_range_keep_their_digits(unit):
    reference = solve(
        K, BLOCK_ON_FLOOR.pressure_load, BLOCK_ON_FLOOR.make_clamping_supports(BOTTOM_MARKER)
    )
    solution = solve(
        unit * K, BLOCK_ON_FLOOR.pressure_load, BLOCK_ON_FLOOR.make_clamping_supports(BOTTOM_MARKER)
    )
    solution.scale(unit)
    assert (solution - reference).norm() < 1e-10 * reference.norm()
    small_load = min(unit, 1 / unit)
    u, small_u = solve_residual_problem(load=1.0), solve_residual_problem(load=small_load)
    assert small_u.x.array / small_load == pytest.approx(u.x.array, rel=1e-9, abs=1e-15)
    assert solve_residual_problem(depth=0.01, contact=True).pairs[0].force[1] < 0


def accepted_types(function, name):
    """Return the set of types that the annotation of an argument admits, without parameters."""
    hint = get_type_hints(function)[name]
    members = get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)
    types = [get_origin(member) or member for member in members]
    # NumPy's NDArray is an alias of a type in new versions
    values = [getattr(accepted, "__value__", accepted) for accepted in types]
    return {get_origin(value) or value for value in values}


def test_annotations_admit_what_is_accepted():
    """A type checker accepts strings as states of stress, and arrays as vectors, as the checks do.

    An attribute that is always converted has the converted type.
    """
    for function in (Body.__init__, Body.from_mesh):
        assert accepted_types(function, "state") == {str, StressState}
    assert get_type_hints(Body)["state"] is StressState
    vectors = [
        (Motion, "translation"),
        (Motion, "force"),
        (ContactPair, "pivot"),
        (ContactPair, "axis"),
        (Plane, "point"),
        (Plane, "direction"),
        (Sphere, "centre"),
        (Parabola, "apex"),
        (FlatPunch, "direction"),
        (write, "times"),
        (nodal_load, "force"),
    ]
    for accepting, name in vectors:
        assert np.ndarray in accepted_types(accepting, name), name
