"""Contact of bodies in the hybrid element."""

from mpi4py import MPI

import numpy as np
import pytest

from pw_elements import (
    Body,
    Material,
    Reduction,
    Spaces,
    assemble_matrix,
    assemble_vector,
    boundary_measure,
    force_transfer,
    prescribe,
    reactions,
    split,
)
from pw_elements.contact import (
    ContactFields,
    ContactPair,
    ContactProblem,
    Motion,
    Parabola,
    Plane,
    solve_contact,
    write,
)
from pw_elements.contact.model import MatchingNodes
from pw_elements.meshes import triangles
from pw_elements.spaces import SubSpace
from tests.contact.cases import at
from tests.contact.test_matching import doubled

COMM = MPI.COMM_SELF


class Rubber:
    """Block 4 x 2, fixed below, under a parabola of radius 8."""

    def __init__(self, method=Spaces.hybrid, nu=0.5, n=10):
        mesh = triangles(COMM, (-2.0, 0.0), (2.0, 2.0), (2 * n, n))
        self.body = Body(method(mesh), Material(2e8, nu), "plane strain")
        self.space = self.body.spaces.trial
        self.K = assemble_matrix(self.body.stiffness())
        foot = [prescribe(self.space, k, at(1, 0.0)) for k in range(2)]
        self.foot = Reduction.dirichlet(self.space, foot)
        self.nothing = self.K.createVecLeft()

    def problem(self, mu):
        pair = ContactPair(at(1, 2.0), Parabola((0.0, 2.0), 8.0), mu)
        return ContactProblem(self.K, self.foot, pair, self.space)


@pytest.mark.parametrize("nu", [0.3, 0.4999, 0.5])
@pytest.mark.parametrize("method", [Spaces.hybrid, Spaces.taylor_hood])
def test_even_pressure_on_a_rigid_plane_is_exact(method, nu):
    mesh = triangles(COMM, (0.0, 0.0), (2.0, 1.0), (6, 3))
    body = Body(method(mesh), Material(1e9, nu), "plane strain")
    W = body.spaces.trial
    top = boundary_measure(mesh, at(1, 1.0))
    f = assemble_vector(body.surface_load((0.0, -1e5), top))
    pair = ContactPair(at(1, 0.0), Plane((0.0, 0.0), (0.0, 1.0)))
    held = Reduction.dirichlet(W, prescribe(W, 0, at(0, 0.0)))
    (state,) = solve_contact(assemble_matrix(body.stiffness()), f, held, pair, W)
    fields = ContactFields.of(state, body)
    nodes = state.pairs[0].node
    assert np.allclose(fields.pressure.x.array[nodes], 1e5, rtol=1e-9)
    u, p = split(W, state.unknowns)
    assert np.array_equal(u.x.array, fields.displacement.x.array)
    assert np.allclose(p.x.array, 1e5 * nu, rtol=1e-8)
    ratio = state.pairs[0].force_normal[1::2].mean() / state.pairs[0].force_normal[2:-1:2].mean()
    assert ratio == pytest.approx(1.0 if method == Spaces.hybrid else 2.0, rel=1e-9)


def test_where_all_stick_forces_are_taylor_and_hoods_shared_out():
    """In the plane displacements are the same, and forces T times the others."""
    found = {}
    for method in (Spaces.hybrid, Spaces.taylor_hood):
        case = Rubber(method)
        # so wide that every node is in contact
        plate = ContactPair(at(1, 2.0), Plane((0.0, 2.0), (0.0, -1.0)), 1e3)
        motions = [Motion((0.03, -0.05))]
        problem = ContactProblem(case.K, case.foot, plate, case.space)
        state = problem.step(problem.undeformed, case.nothing, motions)
        r = SubSpace.displacements(case.space).part(reactions(case.K, state.unknowns, case.nothing))
        found[method] = state, r
    new, standard = found.values()
    difference = new[0].displacement - standard[0].displacement
    assert difference.norm() < 1e-11 * standard[0].displacement.norm()
    T = force_transfer(SubSpace.displacements(case.space).space)
    assert (T * standard[1] - new[1]).norm() < 1e-10 * new[1].norm()
    pair = new[0].pairs[0]
    assert np.allclose(pair.force_vector, new[1].array.reshape(-1, 2)[pair.node])


def test_histories_go_on_from_files(tmp_path):
    case = Rubber(nu=0.4999)
    problem = case.problem(0.3)
    pressed = problem.step(problem.undeformed, case.nothing, Motion((0.0, -0.04)))
    pushed = problem.step(pressed, case.nothing, Motion((0.02, -0.05)))
    problem.save(pressed, tmp_path / "pressed.npz")
    kept = problem.load(tmp_path / "pressed.npz")
    again = problem.step(kept, case.nothing, Motion((0.02, -0.05)))
    assert (again.displacement - pushed.displacement).norm() < 1e-12
    assert (kept.unknowns - pressed.unknowns).norm() == 0
    plain = Rubber(Spaces.petrov_galerkin, 0.3).problem(0.3)
    plain.save(plain.undeformed, tmp_path / "plain.npz")
    with pytest.raises(ValueError, match="has the state of a body without pressure"):
        problem.load(tmp_path / "plain.npz")


def test_pictures_have_the_pressure_of_the_body(tmp_path):
    case = Rubber(nu=0.4999)
    problem = case.problem(0.3)
    pressed = problem.step(problem.undeformed, case.nothing, Motion((0.0, -0.04)))
    fields = ContactFields.of(pressed, case.body)
    _, p = split(case.space, pressed.unknowns)
    x = p.function_space.tabulate_dof_coordinates()
    of = fields.body_pressure.function_space.tabulate_dof_coordinates()
    values = fields.body_pressure.x.array
    for place, value in zip(x, p.x.array, strict=True):
        assert values[np.linalg.norm(of - place, axis=1).argmin()] == pytest.approx(value)
    # below the parabola the body is pressed as hard as the contact
    middle = np.linalg.norm(of - [0, 2, 0], axis=1).argmin()
    assert values[middle] == pytest.approx(fields.pressure.x.array[middle], rel=0.05)
    write(tmp_path / "rubber.bp", [problem.undeformed, pressed], case.body)
    assert ContactFields.of(pressed, case.space).body_pressure is not None
    plain = Rubber(Spaces.petrov_galerkin, 0.3)
    problem = plain.problem(0.3)
    assert ContactFields.of(problem.undeformed, plain.body).body_pressure is None


def test_without_active_sets_the_same_state_is_found():
    case = Rubber()
    problem = case.problem(0.3)
    motion = Motion((0.02, None), (0.0, -1e7))
    state = problem.step(problem.undeformed, case.nothing, motion)
    pair = ContactPair(at(1, 2.0), Parabola((0.0, 2.0), 8.0), 0.3)
    one = ContactProblem(case.K, case.foot, pair, case.space, max_iterations=2)
    other = one.step(one.undeformed, case.nothing, motion)
    assert state.iterations > 2
    assert (state.displacement - other.displacement).norm() < 1e-9 * state.displacement.norm()


def test_two_incompressible_blocks_press_evenly_where_their_nodes_match():
    mesh = doubled(triangles(COMM, (0.0, 0.0), (2.0, 1.0), (6, 3)), (0.0, 1.1, 0.0), COMM)
    body = Body(Spaces.hybrid(mesh), Material(1e3, 0.5), "plane strain")
    W = body.spaces.trial
    held = Reduction.dirichlet(W, [prescribe(W, 1, at(1, 0.0)), prescribe(W, 0, at(0, 0.0))])
    f = assemble_vector(body.surface_load((0.0, -3.0), boundary_measure(mesh, at(1, 2.1))))
    lower = MatchingNodes(at(1, 1.0), Plane((0.0, 1.0), (0.0, 1.0)), (0.0, -0.1))
    pair = ContactPair(at(1, 1.1), lower, 0.3)
    (state,) = solve_contact(assemble_matrix(body.stiffness()), f, held, pair, W)
    pressure = ContactFields.of(state, body).pressure.x.array[state.pairs[0].node]
    assert np.allclose(pressure, 3.0, rtol=1e-8)
