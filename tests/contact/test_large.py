"""Contact at large strains: closest points, derivatives, known solutions, restart, refusals."""

import logging
from dataclasses import replace
from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx.mesh import CellType, create_box, create_unit_cube

from pw_elements import (
    Body,
    Direct,
    Iterative,
    Material,
    Spaces,
    SurfaceNodes,
    assemble_matrix,
    prescribe,
)
from pw_elements.contact import (
    ContactFields,
    ContactPair,
    ContactProblem,
    FlatPunch,
    Motion,
    Parabola,
    Plane,
    SignedDistance,
    SolutionNotFound,
    Sphere,
    SurfacePassed,
    plot,
    write,
)
from pw_elements.contact.interface import FACED_INDEX_OF_RIGID_SURFACE
from pw_elements.contact.iteration import CellInversionCheck
from pw_elements.contact.nodes import (
    SLIP,
    STICK,
    IncrementStart,
    LargeStrainKinematics,
    NoDeformablePairs,
    RigidSurfaceMotion,
)
from pw_elements.contact.system.krylov import KrylovTangent
from pw_elements.meshes import triangles
from pw_elements.solvers import Multigrid
from study.benchmarks.k_cost.measure import Measurement, measure_one_run_in_new_processes
from study.model.matrices import to_dense_array
from tests.contact.cases import (
    make_finite_strain_unknown_and_residual,
    neo_hookean_piola_stress,
    on_plane,
)
from tests.library import vtx
from tests.library.near_incompressible import make_distorted_mesh
from tests.parallel import assert_same_values

ON_TOP = on_plane(1, 0.0)
CIRCLE_MOTIONS = [Motion((0.0, -0.15)), Motion((0.05, -0.3)), Motion((0.3, -0.3))]
SOLVERS_BY_NAME = {"factors": Direct(), "krylov": Iterative()}


def saint_venant_kirchhoff_piola_stress(F):
    """Return the first Piola stress of a Saint Venant-Kirchhoff material (lambda = 1.5, mu = 1)."""
    E = (F.T * F - ufl.Identity(2)) / 2
    return F * (2 * E + 1.5 * ufl.tr(E) * ufl.Identity(2))


class RubberUnderCircle:
    """A 2 x 1 block on a fixed base, and a circle of radius 0.6 that touches its upper side."""

    def __init__(self, n=4, stress=neo_hookean_piola_stress, friction=0.3, mesh=None, **options):
        mesh = mesh or triangles(MPI.COMM_SELF, (-1.0, -1.0), (1.0, 0.0), (2 * n, n))
        self.u, self.residual = make_finite_strain_unknown_and_residual(
            spaces := Spaces.petrov_galerkin(mesh), stress
        )
        self.space = spaces.trial
        self.base_displacement = [fem.Constant(mesh, 0.0), fem.Constant(mesh, 0.0)]
        self.conditions = [
            prescribe(self.space, k, on_plane(1, -1.0), v)
            for k, v in enumerate(self.base_displacement)
        ]
        self.pair = ContactPair(ON_TOP, Sphere((0.0, 0.6), 0.6), friction=friction)
        self.problem = self.problem_with(options=options)

    def problem_with(self, conditions=None, options=None, **pair_changes):
        """Return the problem with changed attributes of the pair, or with other conditions."""
        pair, conditions = replace(self.pair, **pair_changes), conditions or self.conditions
        return ContactProblem.of_residual(self.residual, self.u, conditions, pair, **options or {})

    def press(self, problem=None, **options):
        problem = problem or self.problem
        return problem.step(problem.undeformed, motions=Motion((0.0, -0.1)), **options)


def step_through(problem, motions, start_state=None):
    """Return the states after each of the motions, without the start state."""
    states = [start_state or problem.undeformed]
    for motion in motions:
        states.append(problem.step(states[-1], motions=motion))
    return states[1:]


def make_hardening_rubber_and_hardness(comm=MPI.COMM_SELF, **options):
    """Return a block whose stiffness grows with a history function, and this function.

    The history function counts the increments.
    """
    mesh = triangles(comm, (-1.0, -1.0), (1.0, 0.0), (8, 4))
    hardness = fem.Function(fem.functionspace(mesh, ("DG", 0)))

    def increase_hardness():
        hardness.x.array[:] += 1.0

    stress = lambda F: (1 + 0.1 * hardness) * neo_hookean_piola_stress(F)  # noqa: E731
    return RubberUnderCircle(
        mesh=mesh, stress=stress, history=[hardness], update=increase_hardness, **options
    ), hardness


def ellipse_level_set(x):
    """Return the level-set function of an ellipse with semi-axes 2 and 1; it is not a distance."""
    return x[:, 0] ** 2 / 4 + x[:, 1] ** 2 - 1


SURFACES_BY_NAME = {
    "plane": Plane((0.1, 0.2), (0.3, 1.0)),
    "circle": Sphere((0.1, -0.2), 1.3),
    "sphere": Sphere((0.1, -0.2, 0.3), 1.3),
    "ellipse": SignedDistance(ellipse_level_set, lambda x: x * [0.5, 2.0]),
    "differences": SignedDistance(ellipse_level_set),
    "circle by its square": SignedDistance(
        lambda x: np.sum((x - [0.1, -0.2]) ** 2, axis=1) - 1.69, lambda x: 2 * (x - [0.1, -0.2])
    ),
}


@pytest.mark.parametrize("name", SURFACES_BY_NAME)
def test_closest_points_are_exact_and_their_derivatives_consistent(name):
    surface, rng = SURFACES_BY_NAME[name], np.random.default_rng(4)
    dim = 3 if name == "sphere" else 2
    directions = rng.normal(size=(40, dim))
    x = (
        directions
        / np.linalg.norm(directions, axis=1, keepdims=True)
        * rng.uniform(1.2, 2.2, (40, 1))
    )
    x *= [2.0, *[1.0] * (dim - 1)]
    gap, normal, normal_gradient = surface.gap_normal_and_curvature(x)
    closest_points = x - gap[:, None] * normal
    assert np.abs(surface.gap(closest_points)).max() < 1e-9
    assert np.abs(np.linalg.norm(normal, axis=1) - 1).max() < 1e-12
    angles = np.linspace(0, 2 * np.pi, 20001)
    if "ellipse" in name or name == "differences":
        ellipse_points = np.stack([2 * np.cos(angles), np.sin(angles)], axis=1)
        distances = np.linalg.norm(x[:, None] - ellipse_points, axis=2).min(axis=1)
        assert np.abs(gap - distances).max() < 1e-6
    difference_step, tolerance = (1e-2, 1e-3) if name == "differences" else (1e-5, 1e-8)
    for axis, h in enumerate(difference_step * np.eye(dim)):
        forward, backward = (
            surface.gap_normal_and_curvature(x + h),
            surface.gap_normal_and_curvature(x - h),
        )
        assert (
            np.abs((forward[0] - backward[0]) / (2 * difference_step) - normal[:, axis]).max()
            < tolerance
        )
        assert (
            np.abs(
                (forward[1] - backward[1]) / (2 * difference_step) - normal_gradient[:, :, axis]
            ).max()
            < tolerance
        )


def make_interface_stand_in(surface, positions, dim):
    """Return a stand-in for a contact interface of one surface at points (m, dim)."""
    return SimpleNamespace(
        position=positions,
        pair=np.zeros(len(positions), dtype=int),
        equation=np.zeros((len(positions), dim), dtype=int),
        held_components=np.zeros((len(positions), dim), dtype=bool),
        faced=np.full(len(positions), FACED_INDEX_OF_RIGID_SURFACE),
        evaluate_gaps_normals_and_curvatures=lambda displacement: surface.gap_normal_and_curvature(
            positions + displacement
        ),
        gather_values=lambda values: values,
    )


def test_slip_is_the_arc_length():
    for dim in (2, 3):
        angle = np.array([0.05, 0.4, 1.2])
        end = np.zeros((3, dim))
        end[:, 0], end[:, -1] = 2 * np.sin(angle), 2 * np.cos(angle)
        start = np.zeros((3, dim))
        start[:, -1] = 2.3  # above the surface
        sphere = Sphere((0.0,) * dim, 2.0)
        interface, rest_motion = (
            make_interface_stand_in(sphere, start, dim),
            np.zeros((1, dim + 1)),
        )
        surfaces = RigidSurfaceMotion(interface, [ContactPair(ON_TOP, sphere)])
        start_state = IncrementStart(np.zeros((3, dim)), np.zeros((3, dim)), rest_motion)
        kinematics = LargeStrainKinematics(interface, surfaces, start_state, NoDeformablePairs())
        linear_kinematics = kinematics.linearise(rest_motion, end - start, np.zeros((3, dim)))
        assert np.abs(np.linalg.norm(linear_kinematics.slip, axis=1) - 2 * angle).max() < 1e-12
        pressed = np.ones(3, dtype=bool)
        assert not kinematics.find_points_jumped_to_another_surface_part(
            linear_kinematics, pressed
        ).any()
        far = kinematics.linearise(rest_motion, -2.1 * start, np.zeros((3, dim)))
        assert kinematics.find_points_jumped_to_another_surface_part(far, pressed).all()


@pytest.mark.parametrize("stress", [neo_hookean_piola_stress, saint_venant_kirchhoff_piola_stress])
def test_no_accepted_state_has_inverted_cells(stress):
    """The cells of all accepted states have a positive volume ratio.

    This holds for any stress, even for one that stays finite in inverted cells.
    """
    rubber = RubberUnderCircle(2, stress=stress)
    guard, states = CellInversionCheck([(rubber.u, rubber.residual)]), [rubber.problem.undeformed]

    def press_and_check_volume_ratios():
        for k in range(1, 8):
            motion = Motion((0.0, -0.142 * k))  # the height of the block is 1
            states.append(rubber.problem.step(states[-1], motions=motion))
            assert guard.compute_min_volume_ratio() > 0

    with pytest.raises(SolutionNotFound, match="halved further") as raised:
        press_and_check_volume_ratios()
    assert len(states) > 1
    fraction, reached_state = raised.value.last_substate
    assert 0 < fraction < 1
    assert reached_state.converged
    assert reached_state.pairs[0].translation[1] <= states[-1].pairs[0].translation[1]
    assert np.array_equal(rubber.u.x.array, reached_state.unknowns.array_r)
    assert guard.compute_min_volume_ratio() > 0


@pytest.mark.parametrize("first", [0.0, 0.2])
def test_a_tool_that_would_pass_through_supports_is_refused(first):
    """A tool that would pass through supports is refused without solving any linear system."""
    solved = []
    problem = RubberUnderCircle(callback=solved.append).problem
    (pressed,) = step_through(problem, [Motion((0.0, -first))])
    del solved[:]
    with pytest.raises(SurfacePassed, match=r"through the supports at .* passes"):
        problem.step(pressed, motions=Motion((0.1, -3.0)))
    assert not solved
    beside = step_through(problem, [Motion((3.0, 0.0)), Motion((3.0, -3.0)), Motion((0.0, -3.0))])
    assert np.abs(beside[-1].pairs[0].force_vector).max() < 1e-15


def test_states_store_and_restore_history_functions():
    """A state stores the values of the history functions.

    A step starts with the values of its start state and updates them at its end.
    """
    rubber, hardness = make_hardening_rubber_and_hardness()
    first_state, second_state = step_through(rubber.problem, CIRCLE_MOTIONS[:2])
    assert [
        state.history[0].min() for state in (rubber.problem.undeformed, first_state, second_state)
    ] == [0, 1, 2]
    rubber.problem.step(first_state, motions=CIRCLE_MOTIONS[1])
    assert hardness.x.array.max() == 2.0


def collect_first_pair_fields(states_by_name, further_fields=()):
    """Return fields of the first pair of each state, keyed by the names of state and field."""
    names = ("force_vector", "slip", "gap", "status", "displacement", *further_fields)
    return {
        f"{name} {field}": getattr(state.pairs[0], field)
        for name, state in states_by_name.items()
        for field in names
    }


def solve_pressed_and_pushed_rubber(element_name, solver, comm=MPI.COMM_SELF):
    """Return the state of a rubber block after a ball is pressed into it and moved sideways.

    The block is plane for the element "T6", and a solid for all other names. There is friction.
    """
    dim, is_hybrid = (2 if element_name == "T6" else 3), element_name == "hybrid"
    low, high, n = [-1.0] * dim, [*[1.0] * (dim - 1), 0.0], [3] * (dim - 1) + [2]
    if dim == 2:
        mesh = triangles(comm, low, high, (16, 8))
    else:
        mesh = create_box(comm, [low, high], n, CellType.tetrahedron)
    spaces = (Spaces.hybrid if is_hybrid else Spaces.petrov_galerkin)(mesh)
    w, residual = make_finite_strain_unknown_and_residual(
        spaces, quadrature_degree=3, compressibility=1e-4
    )
    conditions = [prescribe(spaces.trial, k, on_plane(dim - 1, -1.0)) for k in range(dim)]
    sphere = Sphere((*[0.0] * (dim - 1), 1.0), 1.0)
    pair = ContactPair(on_plane(dim - 1, 0.0), sphere, friction=0.3)
    problem = ContactProblem.of_residual(residual, w, conditions, pair, solver=solver)
    state = problem.undeformed
    for motion in ((0.0, 0.0, -0.15), (0.0, 0.0, -0.3), (0.1, 0.05, -0.3)):
        state = problem.step(state, motions=Motion((motion[0], *motion[4 - dim :])))
    return state


@pytest.mark.parametrize("kind", ["T6", "T10", "hybrid"])
def test_iterative_and_direct_solvers_find_the_same_state(kind):
    direct, iterative = (
        collect_first_pair_fields({"end": solve_pressed_and_pushed_rubber(kind, solver)})
        for solver in SOLVERS_BY_NAME.values()
    )
    assert {STICK, SLIP} <= set(direct["end status"])
    assert_same_values(direct, iterative, 1e-9, kind)


@pytest.mark.random  # tests of this mark run at night
def test_half_a_million_unknowns_take_less_than_four_gigabytes(request):
    """A contact problem with half a million unknowns takes less than four gigabytes.

    A ball is pressed into rubber and dragged along it in two increments. The results agree with
    those on a mesh of a tenth of the size.
    """
    if not request.config.getoption("--nightly"):
        pytest.skip("takes a quarter of an hour, with --nightly")
    small, large = (
        measure_one_run_in_new_processes(Measurement("sliding", "pw-T10", n, "Iterative"))
        for n in (8, 17)
    )
    assert round(large["dofs"], -3) == 500_000
    assert large["megabytes"] * 2**20 < 4e9
    assert large["pressed"] == pytest.approx(small["pressed"], rel=0.03)
    assert large["pushed"] == pytest.approx(small["pushed"], rel=0.03)


def press_leaning_column(solver, depths):
    """Press a column down to each of the given depths, and yield the state at each depth.

    The column leans by a thousandth of its height.
    """
    mesh = triangles(MPI.COMM_SELF, (-0.5, 0.0), (0.5, 8.0), (2, 16))
    mesh.geometry.x[:, 0] += 1e-3 * mesh.geometry.x[:, 1]
    spaces = Spaces.petrov_galerkin(mesh)
    u, residual = make_finite_strain_unknown_and_residual(spaces)
    conditions = [prescribe(spaces.trial, k, on_plane(1, 0.0)) for k in (0, 1)]
    pair = ContactPair(on_plane(1, 8.0), Plane((0, 8.0), (0, -1)))
    problem = ContactProblem.of_residual(residual, u, conditions, pair, solver=solver)
    state = problem.undeformed
    for depth in depths:
        state = problem.step(state, motions=Motion((0.0, -depth)))
        yield state


def test_a_leaning_column_buckles_with_either_solver():
    """A leaning column that is compressed in small increments buckles to the side it leans to.

    Its force then grows less than in proportion to the depth. Both solvers give the same forces.
    """
    depths = (0.05, 0.06, 0.065, 0.07, 0.08, 0.1, 0.12)
    forces = []
    for solver in SOLVERS_BY_NAME.values():
        states = list(press_leaning_column(solver, depths))
        assert states[-1].displacement.array_r[::2].max() > 0.1
        forces.append([-state.pairs[0].force[1] for state in states])
    assert forces[0][-1] < 0.9 * depths[-1] / depths[0] * forces[0][0]
    assert np.allclose(*forces, rtol=1e-8)


def test_an_increment_beyond_the_critical_load_is_halved():
    """An increment that passes the critical load of a column is cut into substeps.

    The column may bend to either side.
    """
    *_, state = press_leaning_column(Direct(), (0.05, 0.12))
    assert state.substates
    assert np.abs(state.displacement.array_r[::2]).max() > 0.1


def test_multigrid_levels_are_rebuilt_only_when_it_pays(monkeypatch):
    """Multigrid levels are rebuilt only when this saves time.

    Most tangents reuse the levels of an earlier tangent at the cost of a few more iterations than
    if the levels were always rebuilt.
    """
    mesh, rebuilt = triangles(MPI.COMM_SELF, (-1.0, -1.0), (1.0, 0.0), (16, 8)), []
    renew = Multigrid.update_for_changed_matrix
    monkeypatch.setattr(
        Multigrid,
        "update_for_changed_matrix",
        lambda levels: (rebuilt.append(levels), renew(levels)),
    )

    def count_iterations_and_rebuilds():
        rebuilt.clear()
        states = step_through(
            RubberUnderCircle(mesh=mesh, solver=Iterative()).problem, CIRCLE_MOTIONS
        )
        n_iterations, n_krylov = np.sum(
            [(state.iterations, state.report.krylov_iterations) for state in states], axis=0
        )
        return n_iterations, n_krylov, len(rebuilt)

    n_iterations, n_krylov, n_rebuilt = count_iterations_and_rebuilds()
    monkeypatch.setattr(
        KrylovTangent, "_count_floating_point_operations", lambda _: 0.0
    )  # rebuilding seems to cost nothing in this computation
    _, n_krylov_rebuilding, n_rebuilt_always = count_iterations_and_rebuilds()
    assert 0 < n_rebuilt < n_iterations / 3 < n_rebuilt_always
    assert n_krylov < 1.5 * n_krylov_rebuilding


def test_nodes_stay_on_their_side_of_a_thin_tool():
    """An increment in which nodes would come to face the opposite side of a thin tool is cut.

    It is cut until, in every substep, all nodes face the side that they faced before.
    """
    rubber = RubberUnderCircle()

    plate = SignedDistance(
        lambda x: np.abs(x[:, 1] - 0.05) - 0.05,
        lambda x: np.stack([0 * x[:, 0], np.sign(x[:, 1] - 0.05)], axis=1),
    )
    problem = rubber.problem_with(surface=plate)
    state = problem.step(problem.undeformed, motions=Motion((0.0, -0.12)))
    assert state.substates
    (pair,) = state.pairs
    assert (pair.position + pair.displacement)[:, 1].max() < -0.12 + 1e-9
    assert pair.force[1] < 0


def test_surface_areas_include_the_stretch():
    rubber = RubberUnderCircle()
    (pair,) = step_through(rubber.problem, CIRCLE_MOTIONS)[-1].pairs
    scalars = Spaces.petrov_galerkin(rubber.space.mesh, 0)
    surface = SurfaceNodes.from_scalar_spaces(scalars, ON_TOP, SurfaceNodes.area_stretch(rubber.u))
    x = pair.position + pair.displacement
    current_length = np.linalg.norm(np.diff(x, axis=0), axis=1).sum()
    assert surface.weight_area.sum() == pytest.approx(current_length, rel=0.02)


@pytest.mark.parametrize("kind", ["plane strain", "axisymmetric", "solid", "hybrid"])
def test_nominal_and_true_pressure_of_uniform_compression_are_exact(kind, tmp_path):
    """Nominal and true pressure of a uniformly compressed block are exact.

    They are the normal components of the first Piola stress and of the Cauchy stress. Fields and
    files are compared with the exact values, and pictures are checked for the label.
    """
    is_solid, is_hybrid, is_ring = kind == "solid", kind == "hybrid", kind == "axisymmetric"
    if is_solid:
        mesh = create_unit_cube(MPI.COMM_SELF, 1, 1, 1, CellType.tetrahedron)
    else:
        mesh = triangles(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (2, 2))
    dim, spaces = 2 + is_solid, (Spaces.hybrid if is_hybrid else Spaces.petrov_galerkin)(mesh)
    w, tests = fem.Function(spaces.trial), ufl.TestFunction(spaces.test)
    (u, p), (v, q) = (ufl.split(f) if is_hybrid else (f, None) for f in (w, tests))

    def gradient_in_3d(f):  # gradient in three dimensions
        columns = [[f[i].dx(j) if max(i, j) < dim else 0 for j in range(3)] for i in range(3)]
        if is_ring:
            columns[2][2] = f[0] / ufl.SpatialCoordinate(mesh)[0]
        return ufl.as_matrix(columns)

    def piola_stress(F, pressure=None):  # first Piola stress
        inverse_transpose, J = ufl.inv(F).T, ufl.det(F)
        return (
            F
            - inverse_transpose
            + (1.5 * ufl.ln(J) if pressure is None else -pressure * J) * inverse_transpose
        )

    F = ufl.Identity(3) + gradient_in_3d(u)
    density = ufl.inner(piola_stress(F, p), gradient_in_3d(v))
    density -= q * (ufl.det(F) - 1 + p / 1e4) if is_hybrid else 0
    depth = 2 * np.pi * ufl.SpatialCoordinate(mesh)[0] if is_ring else 1.0
    residual = density * depth * ufl.dx(metadata={"quadrature_degree": 5})
    conditions = [prescribe(spaces.trial, k, on_plane(k, 0.0)) for k in range(dim)]
    axis_vector = np.eye(dim)[-1]
    pair = ContactPair(on_plane(dim - 1, 1.0), Plane(axis_vector, -axis_vector))
    problem = ContactProblem.of_residual(residual, w, conditions, pair)
    state = problem.step(problem.undeformed, motions=Motion(-0.3 * axis_vector))
    body = Body(spaces, Material(1.0, 0.3), "plane strain" if is_hybrid else kind)
    fields, (top,) = ContactFields.from_state(state, body), state.pairs
    width = 1 + top.displacement[:, 0].max()
    depth_stretch = width if is_solid or is_ring else 1.0
    area = width * depth_stretch
    # the sides are free: P = F - c F^-T vanishes there; c is therefore the square of their stretch
    nominal = width**2 / 0.7 - 0.7
    for field, exact in ((fields.pressure, nominal), (fields.true_pressure, nominal / area)):
        assert np.abs(field.x.array[top.node] / exact - 1).max() < 1e-7
    axes = plot(state, body)
    label = axes.child_axes[0].get_ylabel() if is_solid else axes.get_legend().texts[-1].get_text()
    assert label == "nominal pressure"
    if vtx.load_adios2_library() is not None:
        write(tmp_path / "block.bp", [problem.undeformed, state], body)
        (_, first_step), (_, last_step) = vtx.read_times_and_fields(tmp_path / "block.bp")
        assert not first_step["true_pressure"].any()
        assert abs(last_step["true_pressure"].max() * area / nominal - 1) < 1e-7
    problem.save(state, tmp_path / "state.npz")
    assert (
        ContactFields.from_state(problem.load(tmp_path / "state.npz"), body).true_pressure
        is not None
    )


SURFACE_WITHOUT_CLOSEST_POINT = SignedDistance(
    lambda x: (x[:, 1] - 1) ** 2 + 1.0, lambda x: 2 * (x - [0, 1]) * [0, 1]
)


@pytest.mark.parametrize(
    ("attempt", "kind", "message"),
    [
        (lambda it: it.problem_with(surface=Parabola((0.0, 0.0), 0.6)), ValueError, "Sphere"),
        (
            lambda it: it.problem_with(surface=FlatPunch((0, 0), (0, -1), 0.3)),
            ValueError,
            "rounded",
        ),
        (lambda it: it.problem_with(interference=True), ValueError, "interference"),
        (
            lambda it: it.press(load=it.problem.undeformed.displacement),
            TypeError,
            "of the fraction",
        ),
        (lambda _: RubberUnderCircle(update=3), TypeError, "update"),
        # a node is at the centre of curvature
        (
            lambda it: it.press(it.problem_with(surface=SURFACE_WITHOUT_CLOSEST_POINT)),
            SolutionNotFound,
            "no closest point",
        ),
    ],
)
def test_unsupported_options_are_refused_at_large_strains(attempt, kind, message):
    with pytest.raises(kind, match=message):
        attempt(RubberUnderCircle())


class NearlyIncompressibleBlock:
    """A linear elastic block with a variable bulk modulus, fixed below and pressed at one node."""

    def __init__(self, cell, mid_nodes, spaces=Spaces.petrov_galerkin):
        mesh = make_distorted_mesh(cell, 4, 0.05, 1, mid_nodes)
        self.spaces = spaces(mesh)
        self.lame = fem.Constant(mesh, 1.0)
        self.u, v = fem.Function(self.spaces.trial), ufl.TestFunction(self.spaces.test)
        strain, trial = (lambda w: ufl.sym(ufl.grad(w))), ufl.TrialFunction(self.spaces.trial)
        dx = ufl.dx(metadata={"quadrature_degree": 4})

        def virtual_work_density(u):
            return 2 * ufl.inner(strain(u), strain(v)) + self.lame * ufl.div(u) * ufl.div(v)

        self.stiffness = virtual_work_density(trial) * dx
        self.conditions = [prescribe(self.spaces.trial, k, on_plane(1, 0.0)) for k in (0, 1)]
        x = self.spaces.trial.tabulate_dof_coordinates()[:, :2]
        self.node = int(np.argmin(np.linalg.norm(x - [0.5, 1.0], axis=1)))
        pair = ContactPair(np.array([self.node]), Sphere(x[self.node] + [0.0, 1.0], 1.0))
        self.problem = ContactProblem.of_residual(
            virtual_work_density(self.u) * dx, self.u, self.conditions, pair
        )
        self.states = [self.problem.undeformed]

    def press(self, depth, lame_lambda):
        def set_lame_lambda(_):
            self.lame.value = lame_lambda

        self.states.append(
            self.problem.step(self.states[-1], set_lame_lambda, Motion((0.0, -depth)))
        )
        return self.states[-1]

    def reaction_by_numpy(self, depth):
        """Return the vertical force at the pressed node, computed with a dense matrix by NumPy."""
        K = to_dense_array(assemble_matrix(self.stiffness))
        prescribed_values = {
            int(d): 0.0 for condition in self.conditions for d in condition.dof_indices()[0]
        }
        prescribed_values[2 * self.node + 1] = -depth
        displacement, free_dofs = (
            np.zeros(len(K)),
            np.setdiff1d(np.arange(len(K)), [*prescribed_values]),
        )
        displacement[[*prescribed_values]] = [*prescribed_values.values()]
        displacement[free_dofs] = np.linalg.solve(
            K[np.ix_(free_dofs, free_dofs)], -(K @ displacement)[free_dofs]
        )
        return (K @ displacement)[2 * self.node + 1]


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_a_determinant_that_changes_sign_with_the_bulk_modulus_is_no_instability(cell, caplog):
    case, depth = NearlyIncompressibleBlock(cell, mid_nodes=True), 1e-5
    with caplog.at_level(logging.WARNING, "pw_elements.contact"):
        case.press(depth, 1.0)
        assert "bulk" not in caplog.text
        stiff_state = case.press(depth, 1e3)
        case.press(depth, 1e3)
    assert case.states[1].determinant_signs != stiff_state.determinant_signs
    assert stiff_state.pairs[0].force[1] == pytest.approx(case.reaction_by_numpy(depth), rel=1e-3)
    warnings = [record.message for record in caplog.records if "bulk stiffness" in record.message]
    assert len(warnings) == 1
    assert "1e+03 times its shear stiffness" in warnings[0]
    assert "Spaces.hybrid(mesh)" in warnings[0]


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_straight_plane_cells_and_standard_elements_get_no_bulk_warning(cell, caplog):
    cases = [
        NearlyIncompressibleBlock(cell, False),
        NearlyIncompressibleBlock(cell, True, Spaces.galerkin),
    ]
    with caplog.at_level(logging.WARNING, "pw_elements.contact"):
        for case in cases:
            case.press(1e-5, 1.0)
            state = case.press(1e-5, 1e3)
            assert state.pairs[0].force[1] == pytest.approx(case.reaction_by_numpy(1e-5), rel=1e-3)
    assert "bulk" not in caplog.text


class SphereWithNormalErrors(Sphere):
    """A user's circle with errors in its normals.

    Normals are rotated by approximately `normal_factor` - 1, in radians, and their derivatives are
    multiplied by `gradient_factor`.
    """

    normal_factor, gradient_factor = 1.0, 1.0

    def gap_normal_and_curvature(self, x):
        gap, normal, normal_gradient = super().gap_normal_and_curvature(x)
        rotation_error = (self.normal_factor - 1) * np.stack([-normal[:, 1], normal[:, 0]], axis=1)
        return gap, normal + rotation_error, self.gradient_factor * normal_gradient


class SphereWithRotatedNormals(SphereWithNormalErrors):
    normal_factor = 1.01


class SphereWithWrongNormalGradients(SphereWithNormalErrors):
    gradient_factor = 1.05


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        (SphereWithRotatedNormals, "have the normal"),
        (SphereWithWrongNormalGradients, "have the derivative of the normal"),
    ],
)
def test_a_surface_with_wrong_derivatives_is_refused(kind, message):
    rubber = RubberUnderCircle(n=2)
    valid_state = rubber.press(rubber.problem_with(surface=SphereWithNormalErrors((0.0, 0.6), 0.6)))
    assert valid_state.converged
    with pytest.raises(ValueError, match=message):
        rubber.press(rubber.problem_with(surface=kind((0.0, 0.6), 0.6)))


def flat_face_distance_and_gradient(half_width, distance_outside):
    """Return the signed distance of a horizontal face at y = 0 above the body, and its gradient.

    Where |x| exceeds `half_width`, the distance is `distance_outside`.
    """

    def distance(x):
        return np.where(np.abs(x[:, 0]) <= half_width, -x[:, 1], distance_outside)

    def gradient(x):
        return np.tile([0.0, -1.0], (len(x), 1))

    return distance, gradient


@pytest.mark.parametrize("with_gradient", [True, False])
def test_nodes_face_nothing_where_a_signed_distance_is_infinite(with_gradient):
    """Nodes at which a signed distance is infinite face nothing.

    As long as no node passes the edge of a face, the states agree with those of a plane that only
    the nodes below the face may touch. In a longer slide, nodes leave the face or come below it.
    """
    half_width = 0.53  # no node passes the edge of the face

    def solve(surface, nodes, path):
        mesh = triangles(MPI.COMM_SELF, (-1.0, -1.0), (1.0, 0.0), (16, 4))
        spaces = Spaces.petrov_galerkin(mesh)
        u, residual = make_finite_strain_unknown_and_residual(spaces)
        conditions = [prescribe(spaces.trial, k, on_plane(1, -1.0)) for k in (0, 1)]
        pair = ContactPair(nodes, surface, 0.3)
        problem = ContactProblem.of_residual(residual, u, conditions, pair)
        states = [problem.undeformed]
        for translation in path:
            states.append(problem.step(states[-1], motions=Motion(translation)))
        return states

    distance, gradient = flat_face_distance_and_gradient(half_width, np.inf)
    face = SignedDistance(distance, gradient if with_gradient else None)
    path = [(0.0, -0.02), (0.01, -0.05), (0.02, -0.05)]
    below_face = lambda x: on_plane(1, 0.0)(x) & (np.abs(x[0]) < half_width)  # noqa: E731
    plane_states = solve(Plane((0.0, 0.0), (0.0, -1.0)), below_face, path)
    face_states = solve(face, on_plane(1, 0.0), path)
    for state, plane_state in zip(face_states[1:], plane_states[1:], strict=True):
        assert (state.unknowns - plane_state.unknowns).norm() < 1e-9
        assert np.abs(state.pairs[0].force - plane_state.pairs[0].force).max() < 1e-9
        (pair,) = state.pairs
        is_unfaced = np.isinf(pair.gap)
        assert is_unfaced.sum() == len(pair.gap) - len(plane_state.pairs[0].gap)
        assert np.abs(pair.force_vector[is_unfaced]).max() < 1e-10
    # slid by more than a facet's width: some nodes leave the face and others come below it
    *_, last_state = solve(face, on_plane(1, 0.0), [(0.0, -0.02), (0.1, -0.02), (0.2, -0.02)])
    (pair,) = last_state.pairs
    x = pair.position[:, 0] + pair.displacement[:, 0] - 0.2
    assert np.array_equal(np.isinf(pair.gap), np.abs(x) > half_width)
    assert np.abs(pair.force_vector[np.abs(x) > half_width]).max() < 1e-10
    assert pair.force[1] < 0
    assert last_state.residuals.largest() < 1e-8
