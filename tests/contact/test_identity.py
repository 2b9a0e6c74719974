"""Whose state a file holds: other problems and forged files are refused."""

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
from tests.parallel import run_on

COMM = MPI.COMM_SELF
PRESSED, TOP = Motion((0, -0.05)), on_plane(1, 0.0)


class Saturating:
    """Friction that a nodal force of some size limits."""

    def __init__(self, most):
        self.most = most

    def parameter_at(self, _):
        return 0.3

    def limit(self, mu, force):
        share = self.most / (self.most + force)
        return mu * share * force, mu * share**2


def stepped(rise):
    """A circle that far from the contact nodes is another surface."""

    def distance(x):
        return np.linalg.norm(x - [0, 1], axis=1) - 1 + rise * np.maximum(0.0, x[:, 0] - 2.2)

    return SignedDistance(distance)


class Rubber:
    """A problem of a residual, of which one thing may be another one."""

    def __init__(
        self,
        shear=1.0,
        lame=1.5,
        quadratic=0.0,
        stiffer=0.0,
        friction=0.3,
        surface=None,
        held=(0, 1),
        load=0.0,
        warm=0.0,
        pivot=None,
        comm=COMM,
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
        inverse, J = ufl.inv(F).T, ufl.det(F)
        stress = self.shear * self.modulus * (F - inverse) + lame * ufl.ln(J) * inverse
        stress += quadratic * (ufl.tr(F.T * F) - 2) * F - 0.01 * self.heat * inverse
        residual = ufl.inner(stress, ufl.grad(v)) - self.load * v[1]
        foot = [prescribe(spaces.trial, i, on_plane(1, -1.0)) for i in held]
        if len(held) == 1:
            foot.append(prescribe(spaces.trial, 0, lambda x: on_plane(0, 2.0)(x) & (x[1] < -0.4)))
        pair = ContactPair(TOP, surface or Sphere((0, 1), 1.0), friction, pivot=pivot)
        measure = ufl.dx(metadata={"quadrature_degree": 4})
        self.problem = ContactProblem.of_residual(residual * measure, self.u, foot, pair)

    def press(self, load=None, state=None):
        return self.problem.step(state or self.problem.undeformed, load, PRESSED)


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """A file of the problem as it is by default."""
    path, case = tmp_path_factory.mktemp("kept") / "state.npz", Rubber()
    case.problem.save(case.press(), path)
    return path


OTHERS = {
    "constant 0 of the residual: it is 1.01 here, and 1 in the file": {"shear": 1.01},
    "function 1 of the residual: it differs by": {"stiffer": 1e-4},
    "residual: it differs by": {"lame": 1.5001},
    "residual: it differs by 0": {"quadratic": 1e-3},
    "friction of contact pair 0: it differs by 0.033": {"friction": 0.31},
    "friction of contact pair 0": {"friction": Saturating(1.0)},
    "surface of contact pair 0": {"surface": Plane((0, -0.0), (0, -1))},
    "surface of contact pair 0: it differs by": {"surface": Sphere((0, 1.0), 1.0 - 1e-5)},
    "supports: it differs by": {"held": (1,)},
    "pivot of contact pair 0: it differs by": {"pivot": (0, 1.0)},
    "constant 1 of the residual: it is 0.2 here, and 0 in the file": {"load": 0.2},
    "function 0 of the residual: it differs by": {"warm": 1.0},
    "state of another mesh": {"divisions": (14, 4)},
}


def said(call):
    with pytest.raises(ValueError, match=r"state\.npz ") as caught:
        call()
    return str(caught.value)


def test_the_same_problem_made_once_more_takes_the_state(kept):
    case = Rubber()
    state = case.problem.load(kept)
    assert state.increment == 1
    assert case.press(state=state).residuals.largest() < 1e-9


@pytest.mark.parametrize("words", OTHERS)
def test_each_part_in_which_a_problem_is_another_one_is_named(words, kept):
    assert words in said(lambda: Rubber(**OTHERS[words]).problem.load(kept))


def test_laws_and_surfaces_are_told_apart_where_the_undeformed_body_sees_no_difference(tmp_path):
    path = tmp_path / "state.npz"
    for first, other in (
        (partial(Rubber, friction=Saturating(0.1)), partial(Rubber, friction=Saturating(0.11))),
        (partial(Rubber, surface=stepped(0.0)), partial(Rubber, surface=stepped(0.3))),
    ):
        mine, theirs = first(), other()
        (own,), (differing,) = (case.problem.undeformed.pairs for case in (mine, theirs))
        assert np.array_equal(own.gap, differing.gap)
        assert np.array_equal(own.friction, differing.friction)
        mine.problem.save(mine.problem.undeformed, path)
        assert "it differs by" in said(lambda case=theirs: case.problem.load(path))
        assert first().problem.load(path).increment == 0


def test_what_is_changed_on_purpose_is_named(kept):
    case = Rubber(shear=1.1, friction=0.2)
    for changed in ([], ["friction"], [case.shear], ["constants"], ["residual", "friction"]):
        assert "of a problem with another" in said(
            lambda c=changed: case.problem.load(kept, changed=c)
        )
    for changed in (["friction", case.shear], ("constants", "friction")):
        assert case.problem.load(kept, changed=changed).increment == 1
    other = Rubber(quadratic=1e-3)
    assert other.problem.load(kept, changed=["residual"]).increment == 1
    with pytest.raises(ValueError, match="changed 'material': the names are constants, friction"):
        case.problem.load(kept, changed=["material"])
    with pytest.raises(TypeError, match="changed is 'friction': give a list"):
        case.problem.load(kept, changed="friction")


def test_constants_and_functions_that_loads_have_changed_may_differ(tmp_path):
    path, case = tmp_path / "state.npz", Rubber()

    def weigh(share):
        case.load.value = -0.01 * share
        case.heat.x.array[:] = 0.1 * share

    case.problem.save(case.press(weigh), path)
    for other in (Rubber(), Rubber(load=0.3, warm=0.7)):
        state = other.problem.load(path)
        other.problem.save(state, tmp_path / "again.npz")  # which still knows what loads change
        assert Rubber(load=0.5).problem.load(tmp_path / "again.npz").increment == 1
    assert "constant 0 of" in said(lambda: Rubber(shear=1.1, load=0.3).problem.load(path))
    before = Rubber()  # whose own load has changed what the file's had not
    before.problem.save(before.problem.undeformed, path)
    assert case.problem.load(path).increment == 0


def test_a_file_is_written_and_read_without_a_change_of_the_problem(tmp_path):
    case = Rubber(load=0.1, warm=0.2)
    state = case.press()
    things = [case.u.x.array, case.heat.x.array, case.load.value, case.shear.value]
    before = [thing.copy() for thing in things]
    case.problem.save(state, tmp_path / "state.npz")
    case.problem.load(tmp_path / "state.npz")
    for thing, values in zip(things, before, strict=True):
        assert np.array_equal(thing, values)


def halves(left, right):
    """A block whose halves have moduli of elasticity of their own; the mesh is symmetric."""
    mesh = triangles(COMM, (-2.0, 0.0), (2.0, 1.0), (8, 2), "crossed")
    modulus = fem.Function(fem.functionspace(mesh, ("DG", 0)))
    modulus.interpolate(lambda x: np.where(x[0] < 0, left, right))
    case = ElasticBody(mesh, material=Material(modulus, 0.3))
    return case, case.contact_problem(
        ContactPair(on_plane(1, 1.0), Plane((0, 1), (0, -1))), case.clamp(FLOOR)
    )


FLOOR = on_plane(1, 0.0)


def test_stiffnesses_of_one_norm_are_told_apart(tmp_path):
    path = tmp_path / "state.npz"
    (one, problem), (other, mirrored) = halves(100.0, 200.0), halves(200.0, 100.0)
    assert one.K.norm() == pytest.approx(other.K.norm(), rel=1e-12)
    problem.save(problem.undeformed, path)
    assert "with another stiffness: it differs by" in said(lambda: mirrored.load(path))
    assert halves(100.0, 200.0)[1].load(path).increment == 0
    assert mirrored.load(path, changed=["stiffness"]).increment == 0


def test_supports_of_a_stiffness_and_other_sides_are_told_apart(tmp_path):
    path, stack = tmp_path / "state.npz", StackedBlocks((4, 3))
    supports = stack.clamp(on_plane(1, 0.0))
    problem = stack.contact_problem(stack.make_pair("upper"), supports)
    problem.save(problem.undeformed, path)
    beside = stack.contact_problem(
        stack.make_pair("upper"), stack.make_supports((0, on_plane(0, 0.0)), (1, on_plane(1, 0.0)))
    )
    assert "with other supports: it differs by" in said(lambda: beside.load(path))
    part = DeformableSurface(stack.sides["lower"][1:])
    partly = stack.contact_problem(ContactPair(stack.make_pair("upper").nodes, part), supports)
    assert "contact pair 0" in said(lambda: partly.load(path))


def numbers_of(comm, path):
    """A problem's numbers on any number of processes; there it takes a file of another number."""
    case = Rubber(comm=comm, load=0.1, warm=0.2, stiffer=0.5)
    if comm.size > 1:
        case.problem.load(path)
    return case.problem._identify().evaluate()


def test_the_numbers_are_the_same_on_any_number_of_processes(tmp_path):
    case, path = Rubber(load=0.1, warm=0.2, stiffer=0.5), tmp_path / "state.npz"
    case.problem.save(case.press(), path)
    serial = numbers_of(COMM, path)
    for found in run_on(3, numbers_of, path):
        assert found.keys() == serial.keys()
        for name, values in serial.items():
            if values.dtype.kind == "f":
                size = np.abs(values[np.isfinite(values)]).max(initial=0.0)
                assert np.allclose(found[name], values, rtol=0, atol=1e-11 * size), name


def test_another_version_is_said_where_a_residual_differs(tmp_path):
    path, case = tmp_path / "state.npz", Rubber()
    case.problem.save(case.problem.undeformed, path)
    forge(path, lambda arrays, _: arrays.update({"problem version": np.array("0.8.0")}))
    assert case.problem.load(path).increment == 0
    words = said(lambda: Rubber(quadratic=1e-3).problem.load(path))
    assert "The file was written with DOLFINx 0.8.0" in words


# -- forged files ----------------------------------------------------------------------------------


def forge(path, change):
    """Change a file's arrays and plain numbers, and give it the digest of what it has then."""
    with np.load(path) as archive:
        arrays = dict(archive)
    numbers = json.loads(str(arrays["state"]))
    change(arrays, numbers)
    arrays["state"] = np.array(json.dumps(numbers))
    arrays.pop(storage._DIGEST_NAME)
    arrays[storage._DIGEST_NAME] = storage._compute_digest(arrays)
    np.savez(path, **arrays)


def set_number(name, value):
    return lambda _, numbers: numbers.update({name: value})


def set_part(name, part, value):
    return lambda _, numbers: numbers[name].update({part: value})


def set_array(name, change):
    return lambda arrays, _: arrays.update({name: change(arrays[name])})


def put(value, index=0):
    def changed(values):
        values = values.copy()
        values.flat[index] = value
        return values

    return changed


# fmt: off
FORGED = {
    "the scale of forces is 1e+30": set_part("scale", "force", 1e30),
    "the scale of lengths is 1e+30": set_part("scale", "length", 1e30),
    "force of scale = nan": set_part("scale", "force", np.nan),
    "length of scale is -1": set_part("scale", "length", -1.0),
    "contact pair 0: status has [0, 1, 7]": set_array("status_0", put(7)),
    "contact pair 0: status has the shape": set_array("status_0", lambda v: v.astype(float)),
    "residuals does not have the fields": set_number("residuals", {}),
    "allowance does not have the fields": set_number("allowance", None),
    "equilibrium of residuals = None": set_part("residuals", "equilibrium", None),
    "displacement is of the type complex128": set_array("displacement", lambda v: v + 0j),
    "displacement of the shape (225, 1)": set_array("displacement", lambda v: v[:, :1]),
    "displacement of the shape (225, 2) and the type float64":
        set_array("displacement", put(np.nan)),
    "a displacement is 1e+30": set_array("displacement", put(1e30)),
    "contact pair 0: displacement differs": set_array("displacement_0", lambda v: v + 0.01),
    "contact pair 0: force_normal has values that": set_array("force_normal_0", put(np.inf)),
    "contact pair 0: force_normal is 1e+40": set_array("force_normal_0", put(1e40)),
    "contact pair 0: gap has values that are": set_array("gap_0", put(np.nan)),
    "contact pair 0: slip has the shape (24, 2)": set_array("slip_0", lambda v: v[1:]),
    "contact pair 0: normal has vectors": set_array("normal_0", lambda v: 2 * v),
    "contact pair 0: friction is negative": set_array("friction_0", lambda v: -v),
    "contact pair 0: node has numbers of other": set_array("node_0", lambda v: v[[0, *range(24)]]),
    "node has numbers of other nodes": set_array("node_0", put(10**6)),
    "contact pair 0: translation is 1e+12": set_array("translation_0", put(1e12)),
    "iterations is -1": set_number("iterations", -1),
    "iterations is True": set_number("iterations", True),
    "increment is 0.5": set_number("increment", 0.5),
    "an undeformed body has displacements": set_number("increment", 0),
    "unique is 'yes'": set_number("unique", "yes"),
    "free_motions has [0, 7]": set_number("free_motions", [[0, 7]]),
    "free_motions has [3, 0]": set_number("free_motions", [[3, 0]]),
    "the surface of contact pair 0 is free to turn": set_number("free_motions", [[0, 2]]),
    "orientations [5]": set_number("orientations", [5]),
    "rotation of smallness is -0.1":
        set_number("smallness", {"strain": 0.0, "rotation": -0.1, "slip": 0.0}),
    "report does not have the fields": set_number("report", {"method": "LU"}),
    "factorisations is '3'": set_part("report", "factorisations", "3"),
    "pairs is 'one'": set_number("pairs", "one"),
}
# fmt: on


@pytest.mark.parametrize("words", FORGED)
def test_values_that_no_state_has_are_refused_with_a_right_digest(words, kept, tmp_path):
    path = tmp_path / "state.npz"
    path.write_bytes(kept.read_bytes())
    forge(path, lambda *_: None)
    case = Rubber()
    assert case.problem.load(path).increment == 1
    forge(path, FORGED[words])
    assert f"holds no contact state: {words}" in said(lambda: case.problem.load(path))
