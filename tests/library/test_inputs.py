"""What users give by mistake is named: markers, facets, numbers, one for several, swapped ones."""

from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest
from dolfinx import fem
from dolfinx.mesh import exterior_facet_indices, meshtags

from pw_elements import (
    Reduction,
    SurfaceNodes,
    assemble_matrix,
    assemble_vector,
    boundary_measure,
    forces_along,
    lumped_mass,
    prescribe,
)
from pw_elements.contact import (
    ContactPair,
    ContactProblem,
    FlatPunch,
    Motion,
    Parabola,
    Plane,
    SignedDistance,
    Sphere,
    solve_contact,
)
from pw_elements.contact.model import MatchingNodes
from pw_elements.elasticity import nodal_load
from pw_elements.meshes import curved, mapped, on_lines, quadrilaterals, triangles
from pw_elements.spaces import marked
from tests.contact.cases import Block, at

BLOCK = Block(4)
U, K, LOAD, MESH = BLOCK.space, BLOCK.K, BLOCK.pressure, BLOCK.body.spaces.mesh
COMM = MPI.COMM_SELF
FLOOR, BOTTOM = Plane((0, 0), (0, 1)), at(1, 0.0)
FACETS = exterior_facet_indices(MESH.topology)
TAGS = meshtags(MESH, 1, FACETS, np.ones(len(FACETS), dtype=np.int32))

MARKERS = {
    "one value": lambda x: True,  # noqa: ARG005
    "numbers": lambda x: x[1],
    "integers": lambda x: np.isclose(x[1], 0.0).astype(int),
    "transposed": lambda x: np.isclose(x.T[1], 0.0),
    "nothing": lambda x: None,  # noqa: ARG005
}


def taken(marker):
    """The calls that take a marker."""
    return {
        "prescribe": lambda: prescribe(U, 0, marker),
        "nodal_load": lambda: nodal_load(U, marker, (1.0, 0.0)),
        "boundary_measure": lambda: boundary_measure(MESH, marker),
        "SurfaceNodes": lambda: SurfaceNodes.of(BLOCK.body, marker),
        "forces_along": lambda: forces_along(U, LOAD, marker),
        "pair": lambda: solve_contact(K, LOAD, BLOCK.free, ContactPair(marker, FLOOR), U),
    }


@pytest.mark.parametrize("call", taken(None))
@pytest.mark.parametrize("marker", MARKERS)
def test_a_marker_gives_a_truth_value_for_each_point(marker, call):
    with pytest.raises(ValueError, match=r"marker .* gave .* points as columns \(3, n\) and gives"):
        taken(MARKERS[marker])[call]()


@pytest.mark.parametrize("call", taken(None))
def test_a_marker_that_fails_is_named_and_its_error_is_the_cause(call):
    with pytest.raises(ValueError, match=r"^the marker of .* failed: KeyError: 'x'$") as caught:
        taken(lambda _: {}["x"])[call]()
    assert isinstance(caught.value.__cause__, KeyError)


@pytest.mark.parametrize("call", ["prescribe", "nodal_load", "forces_along"])
def test_what_is_no_marker(call):
    with pytest.raises(
        TypeError, match=r"is of the type ndarray: give a function of points.*tagged"
    ):
        taken(FACETS)[call]()


@pytest.mark.parametrize(
    ("facets", "message"),
    [
        (np.ones(3, dtype=bool), "facets are a mask of 3: it is one of all, "),
        (FACETS.astype(float), "facets are float64"),
        (FACETS.reshape(1, -1), "facets are int32 of the shape"),
        (np.array([10**9]), "facets have the numbers 1000000000 to 1000000000"),
    ],
)
def test_facets_are_integers_or_a_mask(facets, message):
    for call in ("boundary_measure", "SurfaceNodes"):
        with pytest.raises(ValueError, match=message):
            taken(facets)[call]()


@pytest.mark.parametrize("call", ["boundary_measure", "SurfaceNodes"])
def test_tags_are_no_facets(call):
    with pytest.raises(TypeError, match=r"facets are tags: give the tagged ones, tags\.find\(val"):
        taken(TAGS)[call]()


@pytest.mark.parametrize("kind", [np.int32, np.int64, np.uint8, bool, list])
def test_facets_of_any_integer_type_and_masks(kind):
    """A mask read as numbers 0 and 1 once made a load of 1 in place of 12."""
    count = MESH.topology.index_map(1).size_local
    if kind is bool:
        facets = np.isin(np.arange(count), FACETS)
    else:
        facets = list(FACETS) if kind is list else FACETS.astype(kind)
    load = assemble_vector(BLOCK.body.surface_load((0, 1.0), boundary_measure(MESH, facets)))
    assert load.sum() == pytest.approx(12.0)
    empty = boundary_measure(MESH, np.append(FACETS, []).astype(np.int32))
    assert assemble_vector(BLOCK.body.surface_load((0, 1.0), empty)).sum() == pytest.approx(12.0)


def test_no_facets_at_all():
    with pytest.raises(ValueError, match="no exterior facet"):
        boundary_measure(MESH, [])
    with pytest.raises(ValueError, match="a mask of 0"):
        boundary_measure(MESH, np.zeros(0, dtype=bool))


def test_a_marker_may_give_every_second_value_of_an_array():
    marked = boundary_measure(MESH, lambda x: np.repeat(np.isclose(x[1], 0.0), 2)[::2])
    load = assemble_vector(BLOCK.body.surface_load((0, 1.0), marked))
    assert load.sum() == pytest.approx(4.0)


def test_a_friction_function_may_give_one_number():
    (state,) = contact(ContactPair(BOTTOM, FLOOR, lambda _: 0.25))
    assert np.all(state.pairs[0].friction == 0.25)


def steps(**arguments):
    problem = ContactProblem(K, BLOCK.free, ContactPair(BOTTOM, FLOOR, 0.3), U)
    given = {"state": problem.undeformed, "load": LOAD} | arguments
    return problem.step(**given)


def contact(pairs=None, loads=LOAD, reduction=BLOCK.free, matrix=K, **options):
    pairs = ContactPair(BOTTOM, FLOOR, 0.3) if pairs is None else pairs
    return solve_contact(matrix, loads, reduction, pairs, U, **options)


def nan_matrix():
    matrix = K.copy()
    matrix.setValue(0, 0, np.nan)
    matrix.assemble()
    return matrix


def both_loads():
    below, beside = (boundary_measure(MESH, at(axis, 0.0)) for axis in (1, 0))
    return BLOCK.body.surface_load((0, 1.0), below) + BLOCK.body.surface_load((1.0, 0), beside)


def nan_mass():
    mass = assemble_matrix(BLOCK.body.mass())
    mass.setValue(0, 0, np.nan)
    mass.assemble()
    return mass


def nan_state():
    state = ContactProblem(K, BLOCK.free, ContactPair(BOTTOM, FLOOR, 0.3), U).undeformed
    (pair,) = state.pairs
    return replace(state, pairs=(replace(pair, force_normal=np.full_like(pair.gap, np.nan)),))


LEFT = [prescribe(U, 0, at(0, 0.0), value) for value in (0.0, 1.0)]

# numbers, whatever their type, sizes and values
REFUSED = {
    "component by name": (lambda: prescribe(U, "x", BOTTOM), "component x: the space has 2"),
    "component True": (lambda: prescribe(U, True, BOTTOM), "component True: the space has 2"),
    "component 0.5": (lambda: prescribe(U, 0.5, BOTTOM), "component 0.5: the space has 2"),
    "value": (lambda: prescribe(U, 0, BOTTOM, np.array(np.nan)), "has to be a finite number"),
    "values": (lambda: prescribe(U, 0, BOTTOM, [1.0, 2.0]), "has to be a finite number"),
    "force": (lambda: nodal_load(U, BOTTOM, ("1", 0)), "it needs 2 finite components"),
    "one force": (lambda: nodal_load(U, BOTTOM, 1.0), "it needs 2 finite components"),
    "degree": (lambda: boundary_measure(MESH, BOTTOM, 2.5), "quadrature_degree = 2.5"),
    "axis": (lambda: forces_along(U, LOAD, BOTTOM, 3), "axis 3"),
    "two measures": (lambda: assemble_vector(both_loads()), "several measures of exterior facets"),
    "mass": (lambda: lumped_mass(nan_mass(), U), "not finite"),
    "radius": (lambda: Sphere((0, 0), np.array(-1.0)), "radius = .*has to be positive"),
    "radius by name": (lambda: Sphere((0, 0), "1"), "radius = '1'"),
    "radius true": (lambda: Sphere((0, 0), True), "radius = True"),
    "infinite radius": (lambda: Sphere((0, 0), np.inf), "radius = inf"),
    "radius of a parabola": (lambda: Parabola((0, 0), "1"), "radius = '1'"),
    "apex": (lambda: Parabola((0, np.nan), 1.0), "the apex of a parabola"),
    "centre and radius": (lambda: Sphere(1.0, (0, 0)), "the centre of a sphere 1.0"),
    "half width": (lambda: FlatPunch((0, 0), (0, 1), np.float32(0)), "half_width"),
    "point": (lambda: Plane((0, np.nan), (0, 1)), "the point of a plane"),
    "direction": (lambda: Plane((0, 0), "up"), "direction 'up'"),
    "step": (lambda: SignedDistance(lambda x: x[:, 1], step=0.0), "step = 0.0"),
    "friction": (lambda: ContactPair(BOTTOM, FLOOR, -0.1), "friction = -0.1"),
    "friction in an array": (lambda: ContactPair(BOTTOM, FLOOR, np.array(np.nan)), "friction = "),
    "friction by name": (lambda: ContactPair(BOTTOM, FLOOR, "0.3"), "friction = '0.3'"),
    "friction true": (lambda: ContactPair(BOTTOM, FLOOR, True), "friction = True"),
    "offset": (lambda: MatchingNodes(BOTTOM, FLOOR, (0, np.nan)), "the offset of matching nodes"),
    "translation": (lambda: Motion((0, "1")), "component 1 of a motion's translation = '1'"),
    "translation true": (lambda: Motion((0, True)), "component 1 of a motion's translation"),
    "one translation": (lambda: Motion(0.1), "translation 0.1 of a motion"),
    "force of a motion": (lambda: Motion((0, None), (0, "1")), "component 1 of a motion's force"),
    "max_iterations": (lambda: contact(max_iterations=2.5), "max_iterations = 2.5"),
    "state": (lambda: steps(state=nan_state()), "the state has forces .* not finite"),
    "guess": (lambda: steps(guess=nan_state()), "the state to start from has forces .* not fin"),
    "stiffness": (lambda: contact(matrix=nan_matrix()), "stiffness has entries that are not fin"),
    "nodes of a pair": (
        lambda: contact(ContactPair(np.array([0.0]), FLOOR)),
        "the nodes of contact pair 0 are float64",
    ),
    "load of another mesh": (lambda: contact(loads=Block(2).pressure), "has 30 degrees of freedom"),
    "stiffness of another mesh": (lambda: contact(matrix=Block(2).K), "the stiffness has 30"),
    "contradiction": (lambda: Reduction.dirichlet(U, LEFT), r"contradict each other at \(0, 0\)"),
    "condensed -1": (lambda: Reduction.condensation(K, U, np.array([-1])), "counted from 0"),
    "condensed far": (lambda: Reduction.condensation(K, U, np.array([10**6])), "counted from 0"),
    "condensed mask": (lambda: Reduction.condensation(K, U, np.ones(3, bool)), "a mask of 3"),
    "cell": (lambda: on_lines(COMM, [0, 1], [0, 1], "triangel"), "cell 'triangel': the cells are"),
    "lines": (lambda: on_lines(COMM, [0, "1"], [0, 1], "triangle"), "x_lines"),
    "corner": (lambda: triangles(COMM, (0, 0, 0), (1, 1, 1), (2, 2)), "lower .* needs 2 finite"),
    "corner nan": (lambda: quadrilaterals(COMM, (0, 0), (1, np.nan), (2, 2)), "upper .* needs 2"),
    "half a division": (lambda: triangles(COMM, (0, 0), (1, 1), (2, 2.5)), "at least one in each"),
}

# things of another kind, exchanged ones, one for several
OF_ANOTHER_KIND = {
    "signed distance": (lambda: SignedDistance(1.0), "function = 1.0"),
    "gradient": (lambda: SignedDistance(lambda x: x[:, 1], 1.0), "gradient = 1.0"),
    "exchanged pair": (lambda: ContactPair(FLOOR, BOTTOM), "a surface is given in place of nodes"),
    "exchanged nodes": (lambda: MatchingNodes(FLOOR, BOTTOM), "a surface is given in place of n"),
    "class of a surface": (lambda: ContactPair(BOTTOM, Plane), "is the class Plane: it has to"),
    "friction in the place of the surface": (lambda: ContactPair(BOTTOM, 0.3), "is 0.3: it has to"),
    "shape": (lambda: MatchingNodes(BOTTOM, 0.3), "the shape of matching nodes is 0.3"),
    "nodes": (lambda: ContactPair("bottom", FLOOR), "the nodes are 'bottom'"),
    "tags of nodes": (lambda: ContactPair(TAGS, FLOOR), "tags are given in place of nodes"),
    "translations for motions": (
        lambda: ContactPair(BOTTOM, FLOOR, 0.3, [(0, 0.1)]),
        "a motion of a contact pair is of the type tuple",
    ),
    "number for motions": (
        lambda: ContactPair(BOTTOM, FLOOR, 0.3, 0.1),
        "motion of a contact pair is 0.1",
    ),
    "surface for a pair": (lambda: contact(FLOOR), "a contact pair is of the type Plane"),
    "conditions for supports": (
        lambda: contact(reduction=LEFT),
        "reduction is Dirichlet conditions",
    ),
    "array for a load": (lambda: contact(loads=np.zeros(4)), "a load is np.float64"),
    "load for the stiffness": (lambda: contact(matrix=LOAD), "the stiffness is of the type Vec"),
    "start": (lambda: contact(start=[LOAD]), "a state to start from is of the type"),
    "load for a state": (lambda: steps(state=LOAD), "the state is of the type Vec"),
    "loads for a load": (lambda: steps(load=[LOAD]), "the load is of the type list"),
    "translation for motions": (lambda: steps(motions=[(0, 0.1)]), "pair 0 is of the type tuple"),
    "guess": (lambda: steps(guess=LOAD), "a state to start from is of the type"),
    "vector for displacements": (
        lambda: BLOCK.body.von_mises(LOAD),
        r"displacement is of the type Vec: as_function\(U, a\)",
    ),
    "condition": (lambda: Reduction.dirichlet(U, [None]), "a condition is None"),
    "no list": (lambda: Reduction.dirichlet(U, 1.0), "the list of conditions is 1.0"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_wrong_values_are_named(name):
    call, message = REFUSED[name]
    with pytest.raises(ValueError, match=message):
        call()


@pytest.mark.parametrize("name", OF_ANOTHER_KIND)
def test_things_of_another_kind_are_named(name):
    call, message = OF_ANOTHER_KIND[name]
    with pytest.raises(TypeError, match=message):
        call()


IMAGES = {
    "columns": lambda x: x.T,
    "one row": lambda x: x[0],
    "in place": lambda x: x.fill(0.0),
    "not finite": lambda x: x * np.nan,
    "words": lambda x: x.astype(str),
}


@pytest.mark.parametrize("make", [mapped, curved])
@pytest.mark.parametrize("image", IMAGES)
def test_images_of_meshes_are_rows_of_finite_numbers(image, make):
    mesh = triangles(COMM, (0.0, 0.0), (1.0, 1.0), (2, 2))
    before = mesh.geometry.x.copy()
    with pytest.raises(ValueError, match="the image of the mesh"):
        make(mesh, IMAGES[image])
    assert np.array_equal(mesh.geometry.x, before)


def test_images_in_the_plane_may_have_two_components():
    mesh = triangles(COMM, (0.0, 0.0), (1.0, 1.0), (2, 2))
    twice = curved(mesh, lambda x: 2 * x[:, :2]).geometry.x.max()
    assert twice == mapped(mesh, lambda x: 2 * x[:, :2]).geometry.x.max() == 2.0


def test_one_of_a_kind_needs_no_list():
    (state,) = contact(ContactPair(BOTTOM, FLOOR, 0.3, Motion((0, 0.1))))
    assert state.pairs[0].translation == pytest.approx((0, 0.1))
    same = steps(motions=Motion((0, 0.1)))
    assert np.array_equal(same.pairs[0].force_normal, state.pairs[0].force_normal)
    assert steps(motions=None).pairs[0].translation == pytest.approx((0, 0))
    one = Reduction.dirichlet(U, LEFT[0])
    assert one.right.getSize() == Reduction.dirichlet(U, LEFT[:1]).right.getSize()


def test_numbers_may_be_of_any_type():
    for radius in (1, np.float32(1), np.array(1.0), np.int64(1)):
        assert Sphere((0, 0), radius).gap(np.array([[0.0, 2.0]])) == pytest.approx([1.0])
    (state,) = contact(ContactPair(BOTTOM, FLOOR, np.array(0.25)), max_iterations=np.int64(50))
    assert np.all(state.pairs[0].friction == 0.25)
    integers = Motion(np.array([0, 1]))
    assert integers.prescribed().dtype == integers.forces().dtype == float
    mask = prescribe(U, np.int64(1), BOTTOM, np.float32(0.5))
    assert np.all(mask.g.value == 0.5)


def test_scalar_spaces_have_a_component_to_prescribe():
    V = fem.functionspace(MESH, ("Lagrange", 2))
    one = prescribe(V, 0, BOTTOM, 2.0)
    assert Reduction.dirichlet(V, one).offset.sum() == 2.0 * len(one.dof_indices()[0]) > 0


def test_conditions_that_say_the_same_do_not_contradict():
    both = [*LEFT[:1], prescribe(U, 0, BOTTOM, 0.0)]
    assert Reduction.dirichlet(U, both).right.getSize()[1] < K.getSize()[0]


def test_a_process_without_points_does_not_ask_a_marker():
    """There the largest coordinate is not defined."""
    assert marked(COMM, "it", lambda x: x[0] == x[0].max(), np.zeros((3, 0))).shape == (0,)


def test_nodes_of_tagged_facets_as_the_refusal_of_tags_says():
    nodes = fem.locate_dofs_topological(U, 1, TAGS.find(1))
    low = nodes[np.isclose(U.tabulate_dof_coordinates()[nodes, 1], 0.0)]
    (state,) = contact(ContactPair(low, FLOOR, 0.3))
    assert len(state.pairs[0].position) == len(low)
