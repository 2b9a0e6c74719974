"""Contact of bodies in the hybrid element."""

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx.mesh import locate_entities_boundary, meshtags

from pw_elements import Reduction, Spaces, assemble_vector, prescribe, split
from pw_elements.contact import (
    ContactFields,
    ContactPair,
    ContactProblem,
    Motion,
    Parabola,
    Plane,
    Sphere,
    write,
)
from pw_elements.contact.interface import ROUND_OFF
from pw_elements.contact.steps.stepping import IncrementTarget
from pw_elements.meshes import triangles
from pw_elements.spaces import SubSpace
from study.elements import taylor_hood
from tests.contact.cases import PW, ElasticBody, finite_strain_residual, on_plane

COMM, HYBRID, TAYLOR_HOOD = MPI.COMM_SELF, Spaces.hybrid, taylor_hood


class Rubber(ElasticBody):
    """Block 4 x 2, fixed below, under a parabola of radius 8."""

    def __init__(self, method=HYBRID, nu=0.5, n=10):
        super().__init__(triangles(COMM, (-2.0, 0.0), (2.0, 2.0), (2 * n, n)), method, E=2e8, nu=nu)
        self.foot = self.clamp(on_plane(1, 0.0))

    def under(self, surface=None, mu=0.3, **options):
        pair = ContactPair(on_plane(1, 2.0), surface or Parabola((0.0, 2.0), 8.0), mu)
        return self.contact_problem(pair, self.foot, **options)


@pytest.mark.parametrize("nu", [0.3, 0.5])
@pytest.mark.parametrize("method", [HYBRID, TAYLOR_HOOD])
def test_even_pressure_on_a_rigid_plane_is_exact(method, nu):
    body = ElasticBody(triangles(COMM, (0.0, 0.0), (2.0, 1.0), (6, 3)), method, E=1e9, nu=nu)
    load, held = (
        body.traction_load((0.0, -1e5), on_plane(1, 1.0)),
        body.make_supports((0, on_plane(0, 0.0))),
    )
    (state,) = body.solve_contact(ContactPair(on_plane(1, 0.0), Plane((0, 0), (0, 1))), held, load)
    fields = ContactFields.from_state(state, body.body)
    (pair,) = state.pairs
    assert np.allclose(fields.pressure.x.array[pair.node], 1e5, rtol=1e-9)
    u, p = split(body.space, state.unknowns)
    assert np.array_equal(u.x.array, fields.displacement.x.array)
    assert np.allclose(p.x.array, 1e5 * nu, rtol=1e-8)
    ratio = pair.force_normal[1::2].mean() / pair.force_normal[2:-1:2].mean()
    assert ratio == pytest.approx(1.0 if method == HYBRID else 2.0, rel=1e-9)


def test_files_and_fields_have_the_pressure_of_the_body(tmp_path):
    case = Rubber(nu=0.4999)
    problem = case.under()
    pressed = problem.step(problem.undeformed, case.zero_load, Motion((0.0, -0.04)))
    problem.save(pressed, tmp_path / "pressed.npz")
    assert (problem.load(tmp_path / "pressed.npz").unknowns - pressed.unknowns).norm() == 0

    fields = ContactFields.from_state(pressed, case.body)
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
    assert ContactFields.from_state(pressed, case.space).body_pressure is not None

    plain = Rubber(PW, 0.3)
    other = plain.under()
    assert ContactFields.from_state(other.undeformed, plain.body).body_pressure is None
    other.save(other.undeformed, tmp_path / "plain.npz")
    with pytest.raises(ValueError, match="has the state of a problem without pressure"):
        problem.load(tmp_path / "plain.npz")


@pytest.mark.parametrize("on", ["U", "U.sub(0)"])
@pytest.mark.parametrize("finite", [False, True])
def test_tagged_facets_name_contact_nodes_supports_and_measures(on, finite):
    case = Rubber(nu=0.4999)
    U, mesh = case.space, case.space.mesh
    facets = {k: locate_entities_boundary(mesh, 1, on_plane(1, y)) for k, y in ((5, 2.0), (6, 0.0))}
    every = np.concatenate([*facets.values()])
    order = np.argsort(every)
    values = np.repeat(np.array([*facets], dtype=np.int32), [len(f) for f in facets.values()])
    tags = meshtags(mesh, 1, every[order], values[order])
    nodes = fem.locate_dofs_topological(U if on == "U" else U.sub(0), 1, tags.find(5))
    held = [prescribe(U, k, tags.find(6)) for k in (0, 1)]
    states = []
    for pair, conditions in (
        (ContactPair(nodes, Parabola((0.0, 2.0), 8.0), 0.3), held),
        (ContactPair(on_plane(1, 2.0), Parabola((0.0, 2.0), 8.0), 0.3), None),
    ):
        if finite:
            if conditions is None:
                conditions = [prescribe(U, k, on_plane(1, 0.0)) for k in (0, 1)]
            w, residual = finite_strain_residual(case.body.spaces)
            pair = ContactPair(pair.nodes, Sphere((0.0, 3.0), 1.0), 0.3)
            problem = ContactProblem.of_residual(residual, w, conditions, pair)
            states.append(problem.step(problem.undeformed, motions=Motion((0, -0.1))))
        else:
            reduction = case.foot if conditions is None else Reduction.dirichlet(U, conditions)
            problem = case.contact_problem(pair, reduction)
            states.append(problem.step(problem.undeformed, case.zero_load, Motion((0.0, -0.04))))
    by_tag, by_marker = states
    assert np.count_nonzero(by_tag.pairs[0].force_normal) > 3
    assert by_tag.pairs[0].force == pytest.approx(by_marker.pairs[0].force, rel=1e-9)
    u, p = split(U, by_tag)
    assert np.array_equal(p.x.array, split(U, by_tag.unknowns)[1].x.array)
    assert np.array_equal(u.x.array, by_tag.displacement.array_r)
    with pytest.raises(ValueError, match=r"split\(U, state\) has the pressure"):
        split(U, by_tag.displacement)


def test_round_off_of_volumes_is_allowed_in_the_equations_of_pressures_alone():
    """Each equation alone is violated: by how much it may be, over the volume around its vertex."""
    mesh = triangles(COMM, (0.0, 0.0), (2.0, 1.0), (2, 1), "crossed")
    U = (spaces := HYBRID(mesh)).trial
    w, residual = finite_strain_residual(spaces)
    held = [prescribe(U, k, on_plane(1, 0.0)) for k in (0, 1)]
    pair = ContactPair(on_plane(1, 1.0), Sphere((1.0, 2.0), 1.0))
    stepping = (problem := ContactProblem.of_residual(residual, w, held, pair))._finite
    rest = [Motion((0.0, 0.0))]
    target = IncrementTarget.from_motions(None, rest, stepping.interface, turning=True)
    state, system = problem.undeformed, stepping._system_for(target.free)
    increment, kinematics = stepping._start_increment(state, target, system, state.unknowns)
    equilibrium, start = increment.equilibrium, increment.start
    linearised = kinematics.linearise(start.q, start.displacement, start.force)
    alone = np.eye(equilibrium.linearise(linearised.torque_map).getLocalSize())
    allowed = 1 / np.array([equilibrium.violation(one, 0.0, None) for one in alone])

    q, pressure = ufl.TestFunctions(U)[1], SubSpace.pressure(U)
    volumes = system.reduction.left.createVecRight()
    system.reduction.left.multTranspose(assemble_vector(q * ufl.dx), volumes)
    known = volumes.array_r > 0
    assert known.sum() == pressure.sizes[0]
    assert np.ptp(allowed[~known]) == 0
    more = allowed[known] - allowed[~known][0]
    assert more / volumes.array_r[known] == pytest.approx(np.full(len(more), 2 * ROUND_OFF))


def test_numbers_that_are_not_those_of_the_hybrid_space_are_refused():
    case = Rubber()
    alone = case.body.spaces.displacements.trial
    facets = locate_entities_boundary(alone.mesh, 1, on_plane(1, 2.0))
    nodes = fem.locate_dofs_topological(alone, 1, facets)
    for wrong in (nodes, facets):
        with pytest.raises(ValueError, match="not whole nodes of the hybrid space U"):
            case.contact_problem(ContactPair(wrong, Parabola((0.0, 2.0), 8.0)), case.foot)
    with pytest.raises(ValueError, match="has facets within the body"):
        prescribe(case.space, 0, np.arange(9))


def test_without_active_sets_the_same_state_is_found():
    case, motion = Rubber(), Motion((0.02, None), (0.0, -1e7))
    state, other = (
        problem.step(problem.undeformed, case.zero_load, motion)
        for problem in (case.under(), case.under(max_iterations=2))
    )
    assert state.iterations > 2
    assert (state.displacement - other.displacement).norm() < 1e-9 * state.displacement.norm()
