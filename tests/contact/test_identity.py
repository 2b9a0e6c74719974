"""Refusal of files that contain states of other problems, and of forged files."""

import json
from functools import partial

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem

from pw_elements import Material, Spaces, prescribe
from pw_elements.contact import (
    ContactPair,
    ContactProblem,
    DeformableSurface,
    Motion,
    Plane,
    SignedDistance,
    Sphere,
)
from pw_elements.contact.output import storage
from pw_elements.meshes import triangles
from tests.contact.cases import ElasticBody, on_plane
from tests.contact.two_bodies import StackedBlocks
from tests.parallel import run_on_processes

SELF_COMM = MPI.COMM_SELF
PRESSING_MOTION, ON_TOP = Motion((0, -0.05)), on_plane(1, 0.0)


class HiddenSaturationFriction:
    """A friction law whose saturation force has no effect as long as the body is undeformed."""

    def __init__(self, saturation_force):
        self.saturation_force = saturation_force

    def parameter_at(self, _):
        return 0.3

    def limit(self, mu, force):
        reduction = self.saturation_force / (self.saturation_force + force)
        return mu * reduction * force, mu * reduction**2


def circle_changed_far_from_nodes(slope_beyond_nodes):
    """Return a circle whose signed distance is changed far from the contact nodes.

    Where x exceeds 2.2, it additionally grows by `slope_beyond_nodes` per unit of length.
    """

    def distance(x):
        return (
            np.linalg.norm(x - [0, 1], axis=1)
            - 1
            + slope_beyond_nodes * np.maximum(0.0, x[:, 0] - 2.2)
        )

    return SignedDistance(distance)


class VariableRubberProblem:
    """A finite-strain contact problem whose parts can all be changed by arguments."""

    def __init__(
        self,
        shear=1.0,
        lame=1.5,
        quadratic=0.0,
        stiffer=0.0,
        friction=0.3,
        surface=None,
        held_components=(0, 1),
        load=0.0,
        warm=0.0,
        pivot=None,
        comm=SELF_COMM,
        divisions=(12, 4),
    ):
        mesh = triangles(comm, (-2, -1), (2, 0), divisions)
        spaces = Spaces.petrov_galerkin(mesh)
        self.u, v = fem.Function(spaces.trial), ufl.TestFunction(spaces.test)
        self.shear, self.load = fem.Constant(mesh, shear), fem.Constant(mesh, load)
        self.heat = fem.Function(fem.functionspace(mesh, ("Lagrange", 1)))
        self.heat.x.array[:] = warm
        self.modulus = fem.Function(fem.functionspace(mesh, ("DG", 0)))
        self.modulus.interpolate(lambda x: 1.0 + stiffer * (x[0] > 1.5))
        F = ufl.Identity(2) + ufl.grad(self.u)
        inverse_transpose, J = ufl.inv(F).T, ufl.det(F)
        stress = (
            self.shear * self.modulus * (F - inverse_transpose)
            + lame * ufl.ln(J) * inverse_transpose
        )
        stress += quadratic * (ufl.tr(F.T * F) - 2) * F - 0.01 * self.heat * inverse_transpose
        residual = ufl.inner(stress, ufl.grad(v)) - self.load * v[1]
        conditions = [prescribe(spaces.trial, i, on_plane(1, -1.0)) for i in held_components]
        if len(held_components) == 1:
            conditions.append(
                prescribe(spaces.trial, 0, lambda x: on_plane(0, 2.0)(x) & (x[1] < -0.4))
            )
        pair = ContactPair(ON_TOP, surface or Sphere((0, 1), 1.0), friction, pivot=pivot)
        measure = ufl.dx(metadata={"quadrature_degree": 4})
        self.problem = ContactProblem.of_residual(residual * measure, self.u, conditions, pair)

    def press(self, load=None, start_state=None):
        return self.problem.step(start_state or self.problem.undeformed, load, PRESSING_MOTION)


@pytest.fixture(scope="module")
def saved_state_path(tmp_path_factory):
    """Return the path of a file with a state of the default problem."""
    path, case = tmp_path_factory.mktemp("kept") / "state.npz", VariableRubberProblem()
    case.problem.save(case.press(), path)
    return path


PROBLEM_CHANGES_BY_MESSAGE = {
    "constant 0 of the residual: it is 1.01 here, and 1 in the file": {"shear": 1.01},
    "function 1 of the residual: it differs by": {"stiffer": 1e-4},
    "residual: it differs by": {"lame": 1.5001},
    "residual: it differs by 0": {"quadratic": 1e-3},
    "friction of contact pair 0: it differs by 0.033": {"friction": 0.31},
    "friction of contact pair 0": {"friction": HiddenSaturationFriction(1.0)},
    "surface of contact pair 0": {"surface": Plane((0, -0.0), (0, -1))},
    "surface of contact pair 0: it differs by": {"surface": Sphere((0, 1.0), 1.0 - 1e-5)},
    "supports: it differs by": {"held_components": (1,)},
    "pivot of contact pair 0: it differs by": {"pivot": (0, 1.0)},
    "constant 1 of the residual: it is 0.2 here, and 0 in the file": {"load": 0.2},
    "function 0 of the residual: it differs by": {"warm": 1.0},
    "state of another mesh": {"divisions": (14, 4)},
}


def catch_load_error_message(load_call):
    """Return the message of the ValueError that a call of `load` has to raise."""
    with pytest.raises(ValueError, match=r"state\.npz ") as caught:
        load_call()
    return str(caught.value)


def test_a_second_object_of_the_same_problem_loads_the_state(saved_state_path):
    case = VariableRubberProblem()
    state = case.problem.load(saved_state_path)
    assert state.increment == 1
    assert case.press(start_state=state).residuals.largest() < 1e-9


@pytest.mark.parametrize("message", PROBLEM_CHANGES_BY_MESSAGE)
def test_each_changed_part_of_a_problem_is_named(message, saved_state_path):
    assert message in catch_load_error_message(
        lambda: VariableRubberProblem(**PROBLEM_CHANGES_BY_MESSAGE[message]).problem.load(
            saved_state_path
        )
    )


def test_laws_and_surfaces_differ_even_if_their_values_on_the_undeformed_body_agree(tmp_path):
    path = tmp_path / "state.npz"
    for make_case, make_other_case in (
        (
            partial(VariableRubberProblem, friction=HiddenSaturationFriction(0.1)),
            partial(VariableRubberProblem, friction=HiddenSaturationFriction(0.11)),
        ),
        (
            partial(VariableRubberProblem, surface=circle_changed_far_from_nodes(0.0)),
            partial(VariableRubberProblem, surface=circle_changed_far_from_nodes(0.3)),
        ),
    ):
        case, other_case = make_case(), make_other_case()
        (pair,), (other_pair,) = (c.problem.undeformed.pairs for c in (case, other_case))
        assert np.array_equal(pair.gap, other_pair.gap)
        assert np.array_equal(pair.friction, other_pair.friction)
        case.problem.save(case.problem.undeformed, path)
        assert "it differs by" in catch_load_error_message(
            lambda case=other_case: case.problem.load(path)
        )
        assert make_case().problem.load(path).increment == 0


def test_intended_changes_have_to_be_named(saved_state_path):
    case = VariableRubberProblem(shear=1.1, friction=0.2)
    for changed in ([], ["friction"], [case.shear], ["constants"], ["residual", "friction"]):
        assert "of a problem with another" in catch_load_error_message(
            lambda changed=changed: case.problem.load(saved_state_path, changed=changed)
        )
    for changed in (["friction", case.shear], ("constants", "friction")):
        assert case.problem.load(saved_state_path, changed=changed).increment == 1
    quadratic_case = VariableRubberProblem(quadratic=1e-3)
    assert quadratic_case.problem.load(saved_state_path, changed=["residual"]).increment == 1
    with pytest.raises(ValueError, match="changed 'material': the names are constants, friction"):
        case.problem.load(saved_state_path, changed=["material"])
    with pytest.raises(TypeError, match="changed is 'friction': give a list"):
        case.problem.load(saved_state_path, changed="friction")


def test_constants_and_functions_that_loads_change_may_differ(tmp_path):
    path, case = tmp_path / "state.npz", VariableRubberProblem()

    def apply_load(load_factor):
        case.load.value = -0.01 * load_factor
        case.heat.x.array[:] = 0.1 * load_factor

    case.problem.save(case.press(apply_load), path)
    for other_case in (VariableRubberProblem(), VariableRubberProblem(load=0.3, warm=0.7)):
        state = other_case.problem.load(path)
        other_case.problem.save(
            state, tmp_path / "again.npz"
        )  # the file still contains the values of the loads
        assert VariableRubberProblem(load=0.5).problem.load(tmp_path / "again.npz").increment == 1
    assert "constant 0 of" in catch_load_error_message(
        lambda: VariableRubberProblem(shear=1.1, load=0.3).problem.load(path)
    )
    unloaded_case = VariableRubberProblem()  # the values of its load differ from those in the file
    unloaded_case.problem.save(unloaded_case.problem.undeformed, path)
    assert case.problem.load(path).increment == 0


def test_saving_and_loading_do_not_change_the_problem(tmp_path):
    case = VariableRubberProblem(load=0.1, warm=0.2)
    state = case.press()
    arrays = [case.u.x.array, case.heat.x.array, case.load.value, case.shear.value]
    copies = [array.copy() for array in arrays]
    case.problem.save(state, tmp_path / "state.npz")
    case.problem.load(tmp_path / "state.npz")
    for array, values in zip(arrays, copies, strict=True):
        assert np.array_equal(array, values)


def make_block_of_two_moduli_and_problem(left_modulus, right_modulus):
    """Return a block whose halves have different Young's moduli, and its contact problem.

    The mesh of the block is symmetric.
    """
    mesh = triangles(SELF_COMM, (-2.0, 0.0), (2.0, 1.0), (8, 2), "crossed")
    modulus = fem.Function(fem.functionspace(mesh, ("DG", 0)))
    modulus.interpolate(lambda x: np.where(x[0] < 0, left_modulus, right_modulus))
    case = ElasticBody(mesh, material=Material(modulus, 0.3))
    return case, case.contact_problem(
        ContactPair(on_plane(1, 1.0), Plane((0, 1), (0, -1))), case.make_clamping_supports(ON_BASE)
    )


ON_BASE = on_plane(1, 0.0)


def test_stiffnesses_of_equal_norm_are_told_apart(tmp_path):
    path = tmp_path / "state.npz"
    (case, problem), (mirrored_case, mirrored_problem) = (
        make_block_of_two_moduli_and_problem(100.0, 200.0),
        make_block_of_two_moduli_and_problem(200.0, 100.0),
    )
    assert case.K.norm() == pytest.approx(mirrored_case.K.norm(), rel=1e-12)
    problem.save(problem.undeformed, path)
    assert "with another stiffness: it differs by" in catch_load_error_message(
        lambda: mirrored_problem.load(path)
    )
    assert make_block_of_two_moduli_and_problem(100.0, 200.0)[1].load(path).increment == 0
    assert mirrored_problem.load(path, changed=["stiffness"]).increment == 0


def test_other_supports_and_other_facets_are_refused(tmp_path):
    path, stack = tmp_path / "state.npz", StackedBlocks((4, 3))
    supports = stack.make_clamping_supports(on_plane(1, 0.0))
    problem = stack.contact_problem(stack.make_pair("upper"), supports)
    problem.save(problem.undeformed, path)
    problem_on_rollers = stack.contact_problem(
        stack.make_pair("upper"), stack.make_supports((0, on_plane(0, 0.0)), (1, on_plane(1, 0.0)))
    )
    assert "with other supports: it differs by" in catch_load_error_message(
        lambda: problem_on_rollers.load(path)
    )
    partial_surface = DeformableSurface(stack.sides["lower"][1:])
    problem_on_part = stack.contact_problem(
        ContactPair(stack.make_pair("upper").nodes, partial_surface), supports
    )
    assert "contact pair 0" in catch_load_error_message(lambda: problem_on_part.load(path))


def evaluate_problem_identity(comm, state_path):
    """Return the values that identify a problem.

    If there are several processes, they first load the state that one process has saved.
    """
    case = VariableRubberProblem(comm=comm, load=0.1, warm=0.2, stiffer=0.5)
    if comm.size > 1:
        case.problem.load(state_path)
    return case.problem._make_fingerprint().evaluate_all_values()


def test_identity_does_not_depend_on_the_number_of_processes(tmp_path):
    case, path = VariableRubberProblem(load=0.1, warm=0.2, stiffer=0.5), tmp_path / "state.npz"
    case.problem.save(case.press(), path)
    serial = evaluate_problem_identity(SELF_COMM, path)
    for parallel in run_on_processes(3, evaluate_problem_identity, path):
        assert parallel.keys() == serial.keys()
        for name, values in serial.items():
            if values.dtype.kind == "f":
                largest = np.abs(values[np.isfinite(values)]).max(initial=0.0)
                assert np.allclose(parallel[name], values, rtol=0, atol=1e-11 * largest), name


def test_another_dolfinx_version_is_named_where_a_residual_differs(tmp_path):
    path, case = tmp_path / "state.npz", VariableRubberProblem()
    case.problem.save(case.problem.undeformed, path)
    forge_state_file(path, lambda arrays, _: arrays.update({"problem version": np.array("0.8.0")}))
    assert case.problem.load(path).increment == 0
    message = catch_load_error_message(
        lambda: VariableRubberProblem(quadratic=1e-3).problem.load(path)
    )
    assert "The file was written with DOLFINx 0.8.0" in message


# -- forged files ----------------------------------------------------------------------------------


def forge_state_file(path, change):
    """Change arrays and plain values in a state's file, and update the file's digest.

    `change` is a function that changes both mappings in place.
    """
    with np.load(path) as archive:
        arrays = dict(archive)
    values = json.loads(str(arrays["state"]))
    change(arrays, values)
    arrays["state"] = np.array(json.dumps(values))
    arrays.pop(storage._DIGEST_ARRAY_NAME)
    arrays[storage._DIGEST_ARRAY_NAME] = storage._compute_digest(arrays)
    np.savez(path, **arrays)


def value_setter(name, value):
    """Return a function that sets a plain value of a file."""
    return lambda _, values: values.update({name: value})


def dictionary_entry_setter(name, entry, value):
    """Return a function that sets an entry of a dictionary among the plain values of a file."""
    return lambda _, values: values[name].update({entry: value})


def array_changer(name, change):
    """Return a function that replaces an array of a file by its image under `change`."""
    return lambda arrays, _: arrays.update({name: change(arrays[name])})


def array_item_setter(value, index=0):
    """Return a function that copies an array and sets one of its items."""

    def copy_and_set_item(values):
        values = values.copy()
        values.flat[index] = value
        return values

    return copy_and_set_item


# fmt: off
FORGERIES_BY_MESSAGE = {
    "the scale of forces is 1e+30": dictionary_entry_setter("scale", "force", 1e30),
    "the scale of lengths is 1e+30": dictionary_entry_setter("scale", "length", 1e30),
    "force of scale = nan": dictionary_entry_setter("scale", "force", np.nan),
    "length of scale is -1": dictionary_entry_setter("scale", "length", -1.0),
    "contact pair 0: status has [0, 1, 7]": array_changer("status_0", array_item_setter(7)),
    "contact pair 0: status has the shape": array_changer("status_0", lambda v: v.astype(float)),
    "residuals does not have the fields": value_setter("residuals", {}),
    "allowance does not have the fields": value_setter("allowance", None),
    "equilibrium of residuals = None": dictionary_entry_setter("residuals", "equilibrium", None),
    "displacement is of the type complex128": array_changer("displacement", lambda v: v + 0j),
    "displacement of the shape (225, 1)": array_changer("displacement", lambda v: v[:, :1]),
    "displacement of the shape (225, 2) and the type float64":
        array_changer("displacement", array_item_setter(np.nan)),
    "a displacement is 1e+30": array_changer("displacement", array_item_setter(1e30)),
    "contact pair 0: displacement differs": array_changer("displacement_0", lambda v: v + 0.01),
    "contact pair 0: force_normal has values that": array_changer(
        "force_normal_0", array_item_setter(np.inf)
    ),
    "contact pair 0: force_normal is 1e+40": array_changer(
        "force_normal_0", array_item_setter(1e40)
    ),
    "contact pair 0: gap has values that are": array_changer("gap_0", array_item_setter(np.nan)),
    "contact pair 0: slip has the shape (24, 2)": array_changer("slip_0", lambda v: v[1:]),
    "contact pair 0: normal has vectors": array_changer("normal_0", lambda v: 2 * v),
    "contact pair 0: friction is negative": array_changer("friction_0", lambda v: -v),
    "contact pair 0: node has numbers of other": array_changer(
        "node_0", lambda v: v[[0, *range(24)]]
    ),
    "node has numbers of other nodes": array_changer("node_0", array_item_setter(10**6)),
    "contact pair 0: translation is 1e+12": array_changer("translation_0", array_item_setter(1e12)),
    "iterations is -1": value_setter("iterations", -1),
    "iterations is True": value_setter("iterations", True),
    "increment is 0.5": value_setter("increment", 0.5),
    "an undeformed body has displacements": value_setter("increment", 0),
    "unique is 'yes'": value_setter("unique", "yes"),
    "free_motions has [0, 7]": value_setter("free_motions", [[0, 7]]),
    "free_motions has [3, 0]": value_setter("free_motions", [[3, 0]]),
    "the surface of contact pair 0 is free to turn": value_setter("free_motions", [[0, 2]]),
    "determinant_signs [5]": value_setter("determinant_signs", [5]),
    "rotation of smallness is -0.1":
        value_setter("smallness", {"strain": 0.0, "rotation": -0.1, "slip": 0.0}),
    "report does not have the fields": value_setter("report", {"method": "LU"}),
    "factorisations is '3'": dictionary_entry_setter("report", "factorisations", "3"),
    "pairs is 'one'": value_setter("pairs", "one"),
}
# fmt: on


@pytest.mark.parametrize("message", FORGERIES_BY_MESSAGE)
def test_invalid_values_are_refused_in_spite_of_a_valid_digest(message, saved_state_path, tmp_path):
    path = tmp_path / "state.npz"
    path.write_bytes(saved_state_path.read_bytes())
    forge_state_file(path, lambda *_: None)
    case = VariableRubberProblem()
    assert case.problem.load(path).increment == 1
    forge_state_file(path, FORGERIES_BY_MESSAGE[message])
    assert f"holds no contact state: {message}" in catch_load_error_message(
        lambda: case.problem.load(path)
    )
