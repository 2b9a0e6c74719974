"""Contact of bodies that consist of hybrid elements."""

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
from pw_elements.contact.interface import RELATIVE_COORDINATE_ROUND_OFF
from pw_elements.contact.iteration import TargetLoadsAndMotions
from pw_elements.meshes import triangles
from pw_elements.spaces import SubSpace
from study.model.elements import taylor_hood_spaces
from tests.contact.cases import (
    PETROV_GALERKIN,
    ElasticBody,
    make_finite_strain_unknown_and_residual,
    on_plane,
)

COMM, HYBRID, TAYLOR_HOOD = MPI.COMM_SELF, Spaces.hybrid, taylor_hood_spaces


class HybridBlock(ElasticBody):
    """A 4 x 2 block of hybrid elements that is fixed at its base, under a parabola of radius 8."""

    def __init__(self, method=HYBRID, nu=0.5, n=10):
        super().__init__(triangles(COMM, (-2.0, 0.0), (2.0, 2.0), (2 * n, n)), method, E=2e8, nu=nu)
        self.base_supports = self.make_clamping_supports(on_plane(1, 0.0))

    def contact_problem_under(self, surface=None, mu=0.3, **options):
        pair = ContactPair(on_plane(1, 2.0), surface or Parabola((0.0, 2.0), 8.0), mu)
        return self.contact_problem(pair, self.base_supports, **options)


@pytest.mark.parametrize("nu", [0.3, 0.5])
@pytest.mark.parametrize("method", [HYBRID, TAYLOR_HOOD])
def test_uniform_pressure_on_a_rigid_plane_is_exact(method, nu):
    body = ElasticBody(triangles(COMM, (0.0, 0.0), (2.0, 1.0), (6, 3)), method, E=1e9, nu=nu)
    load, supports = (
        body.traction_load((0.0, -1e5), on_plane(1, 1.0)),
        body.make_supports((0, on_plane(0, 0.0))),
    )
    (state,) = body.solve_contact(
        ContactPair(on_plane(1, 0.0), Plane((0, 0), (0, 1))), supports, load
    )
    fields = ContactFields.from_state(state, body.body)
    (pair,) = state.pairs
    assert np.allclose(fields.pressure.x.array[pair.node], 1e5, rtol=1e-9)
    u, p = split(body.space, state.unknowns)
    assert np.array_equal(u.x.array, fields.displacement.x.array)
    assert np.allclose(p.x.array, 1e5 * nu, rtol=1e-8)
    ratio = pair.force_normal[1::2].mean() / pair.force_normal[2:-1:2].mean()
    assert ratio == pytest.approx(1.0 if method == HYBRID else 2.0, rel=1e-9)


def test_files_and_fields_contain_the_pressure_of_the_body(tmp_path):
    case = HybridBlock(nu=0.4999)
    problem = case.contact_problem_under()
    pressed_state = problem.step(problem.undeformed, case.zero_load, Motion((0.0, -0.04)))
    problem.save(pressed_state, tmp_path / "pressed.npz")
    assert (problem.load(tmp_path / "pressed.npz").unknowns - pressed_state.unknowns).norm() == 0

    fields = ContactFields.from_state(pressed_state, case.body)
    _, p = split(case.space, pressed_state.unknowns)
    x = p.function_space.tabulate_dof_coordinates()
    field_x = fields.body_pressure.function_space.tabulate_dof_coordinates()
    values = fields.body_pressure.x.array
    for node_x, value in zip(x, p.x.array, strict=True):
        assert values[np.linalg.norm(field_x - node_x, axis=1).argmin()] == pytest.approx(value)
    # below the parabola, the pressure unknown equals the contact pressure
    middle_node = np.linalg.norm(field_x - [0, 2, 0], axis=1).argmin()
    assert values[middle_node] == pytest.approx(fields.pressure.x.array[middle_node], rel=0.05)
    write(tmp_path / "rubber.bp", [problem.undeformed, pressed_state], case.body)
    assert ContactFields.from_state(pressed_state, case.space).body_pressure is not None

    plain_block = HybridBlock(PETROV_GALERKIN, 0.3)
    plain_problem = plain_block.contact_problem_under()
    assert (
        ContactFields.from_state(plain_problem.undeformed, plain_block.body).body_pressure is None
    )
    plain_problem.save(plain_problem.undeformed, tmp_path / "plain.npz")
    with pytest.raises(ValueError, match="has the state of a problem without pressure"):
        problem.load(tmp_path / "plain.npz")


@pytest.mark.parametrize("on", ["U", "U.sub(0)"])
@pytest.mark.parametrize("finite", [False, True])
def test_tagged_facets_define_contact_nodes_and_supports(on, finite):
    case = HybridBlock(nu=0.4999)
    U, mesh = case.space, case.space.mesh
    facets = {k: locate_entities_boundary(mesh, 1, on_plane(1, y)) for k, y in ((5, 2.0), (6, 0.0))}
    all_facets = np.concatenate([*facets.values()])
    order = np.argsort(all_facets)
    values = np.repeat(np.array([*facets], dtype=np.int32), [len(f) for f in facets.values()])
    tags = meshtags(mesh, 1, all_facets[order], values[order])
    nodes = fem.locate_dofs_topological(U if on == "U" else U.sub(0), 1, tags.find(5))
    conditions_by_tag = [prescribe(U, k, tags.find(6)) for k in (0, 1)]
    states = []
    for pair, conditions in (
        (ContactPair(nodes, Parabola((0.0, 2.0), 8.0), 0.3), conditions_by_tag),
        (ContactPair(on_plane(1, 2.0), Parabola((0.0, 2.0), 8.0), 0.3), None),
    ):
        if finite:
            if conditions is None:
                conditions = [prescribe(U, k, on_plane(1, 0.0)) for k in (0, 1)]
            w, residual = make_finite_strain_unknown_and_residual(case.body.spaces)
            pair = ContactPair(pair.nodes, Sphere((0.0, 3.0), 1.0), 0.3)
            problem = ContactProblem.of_residual(residual, w, conditions, pair)
            states.append(problem.step(problem.undeformed, motions=Motion((0, -0.1))))
        else:
            reduction = (
                case.base_supports if conditions is None else Reduction.dirichlet(U, conditions)
            )
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


def test_round_off_of_volumes_is_tolerated_in_pressure_equations_alone():
    """The tolerance for round-off of volumes applies to pressure equations only.

    The tolerance of each equation is found by violating this equation alone. That of a pressure
    equation is larger by an amount that is proportional to the volume around its vertex.
    """
    mesh = triangles(COMM, (0.0, 0.0), (2.0, 1.0), (2, 1), "crossed")
    U = (spaces := HYBRID(mesh)).trial
    w, residual = make_finite_strain_unknown_and_residual(spaces)
    conditions = [prescribe(U, k, on_plane(1, 0.0)) for k in (0, 1)]
    pair = ContactPair(on_plane(1, 1.0), Sphere((1.0, 2.0), 1.0))
    stepping = (
        problem := ContactProblem.of_residual(residual, w, conditions, pair)
    )._large_strain_stepping
    zero_motion = [Motion((0.0, 0.0))]
    target = TargetLoadsAndMotions.from_load_and_motions(None, zero_motion, n_motions_per_surface=3)
    state, system = problem.undeformed, stepping._cached_contact_system_for(target.free_motions)
    increment, kinematics = stepping._make_equations_and_kinematics(
        state, target, system, state.unknowns
    )
    equilibrium, start = increment.equilibrium, increment.start
    linearised = kinematics.linearise(start.q, start.displacement, start.force)
    unit_residuals = np.eye(
        equilibrium.linearise_and_return_load(linearised.torque_map).getLocalSize()
    )
    tolerances = 1 / np.array(
        [
            equilibrium.max_imbalance_to_tolerance_ratio(residual_vector, 0.0, None)
            for residual_vector in unit_residuals
        ]
    )

    q, pressure = ufl.TestFunctions(U)[1], SubSpace.pressure(U)
    volumes = system.reduction.left.createVecRight()
    system.reduction.left.multTranspose(assemble_vector(q * ufl.dx), volumes)
    is_pressure = volumes.array_r > 0
    assert is_pressure.sum() == pressure.local_and_global_size[0]
    assert np.ptp(tolerances[~is_pressure]) == 0
    added_tolerances = tolerances[is_pressure] - tolerances[~is_pressure][0]
    assert added_tolerances / volumes.array_r[is_pressure] == pytest.approx(
        np.full(len(added_tolerances), 2 * RELATIVE_COORDINATE_ROUND_OFF)
    )


def test_node_numbers_of_another_space_are_refused():
    case = HybridBlock()
    displacement_space = case.body.spaces.displacements.trial
    facets = locate_entities_boundary(displacement_space.mesh, 1, on_plane(1, 2.0))
    nodes = fem.locate_dofs_topological(displacement_space, 1, facets)
    for numbers in (nodes, facets):
        with pytest.raises(ValueError, match="not whole nodes of the hybrid space U"):
            case.contact_problem(
                ContactPair(numbers, Parabola((0.0, 2.0), 8.0)), case.base_supports
            )
    with pytest.raises(ValueError, match="has facets within the body"):
        prescribe(case.space, 0, np.arange(9))


def test_the_fallback_finds_the_state_of_the_active_set_iteration():
    case, motion = HybridBlock(), Motion((0.02, None), (0.0, -1e7))
    state, fallback_state = (
        problem.step(problem.undeformed, case.zero_load, motion)
        for problem in (case.contact_problem_under(), case.contact_problem_under(max_iterations=2))
    )
    assert state.iterations > 2
    assert (
        state.displacement - fallback_state.displacement
    ).norm() < 1e-9 * state.displacement.norm()
