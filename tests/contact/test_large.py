"""Contact at large strains: closest points, derivatives, known answers, restart, refusals."""

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
    NotFound,
    Parabola,
    Plane,
    SignedDistance,
    Sphere,
    SurfacePassed,
    plot,
    write,
)
from pw_elements.contact.interface import RIGID
from pw_elements.contact.iteration import CellGuard
from pw_elements.contact.nodes import (
    SLIP,
    STICK,
    DeformedKinematics,
    IncrementStart,
    RigidSurfaceMotion,
    RigidSurfacesOnly,
)
from pw_elements.contact.system.krylov import KrylovTangent
from pw_elements.meshes import triangles
from pw_elements.solvers import Multigrid
from study.cost.measure import Row, alone
from study.matrices import dense
from tests.contact.cases import finite_strain_residual, neo_hookean_stress, on_plane
from tests.library import vtx
from tests.library.near_incompressible import distorted_mesh
from tests.parallel import assert_same

on_top = on_plane(1, 0.0)
CIRCLE_MOTIONS = [Motion((0.0, -0.15)), Motion((0.05, -0.3)), Motion((0.3, -0.3))]
SOLVERS = {"factors": Direct(), "krylov": Iterative()}


def saint_venant(F):
    E = (F.T * F - ufl.Identity(2)) / 2
    return F * (2 * E + 1.5 * ufl.tr(E) * ufl.Identity(2))


class RubberUnderCircle:
    """A block 2 x 1 on a held base, and a circle of radius 0.6 that touches its upper side."""

    def __init__(self, n=4, stress=neo_hookean_stress, friction=0.3, mesh=None, **options):
        mesh = mesh or triangles(MPI.COMM_SELF, (-1.0, -1.0), (1.0, 0.0), (2 * n, n))
        self.u, self.residual = finite_strain_residual(
            spaces := Spaces.petrov_galerkin(mesh), stress
        )
        self.space = spaces.trial
        self.base_displacement = [fem.Constant(mesh, 0.0), fem.Constant(mesh, 0.0)]
        self.conditions = [
            prescribe(self.space, k, on_plane(1, -1.0), v)
            for k, v in enumerate(self.base_displacement)
        ]
        self.pair = ContactPair(on_top, Sphere((0.0, 0.6), 0.6), friction=friction)
        self.problem = self.problem_with(options=options)

    def problem_with(self, conditions=None, options=None, **changes):
        """The problem of a changed pair."""
        pair, conditions = replace(self.pair, **changes), conditions or self.conditions
        return ContactProblem.of_residual(self.residual, self.u, conditions, pair, **options or {})

    def press(self, problem=None, **given):
        problem = problem or self.problem
        return problem.step(problem.undeformed, motions=Motion((0.0, -0.1)), **given)


def step_through(problem, motions, start=None):
    states = [start or problem.undeformed]
    for motion in motions:
        states.append(problem.step(states[-1], motions=motion))
    return states[1:]


def make_hardening_rubber(comm=MPI.COMM_SELF, **options):
    """The block, with a function that counts accepted increments, and is stored."""
    mesh = triangles(comm, (-1.0, -1.0), (1.0, 0.0), (8, 4))
    hardness = fem.Function(fem.functionspace(mesh, ("DG", 0)))

    def update():
        hardness.x.array[:] += 1.0

    stress = lambda F: (1 + 0.1 * hardness) * neo_hookean_stress(F)  # noqa: E731
    return RubberUnderCircle(
        mesh=mesh, stress=stress, history=[hardness], update=update, **options
    ), hardness


def _ellipse(x):
    return x[:, 0] ** 2 / 4 + x[:, 1] ** 2 - 1


SURFACES = {
    "plane": Plane((0.1, 0.2), (0.3, 1.0)),
    "circle": Sphere((0.1, -0.2), 1.3),
    "sphere": Sphere((0.1, -0.2, 0.3), 1.3),
    "ellipse": SignedDistance(_ellipse, lambda x: x * [0.5, 2.0]),
    "differences": SignedDistance(_ellipse),
    "circle by its square": SignedDistance(
        lambda x: np.sum((x - [0.1, -0.2]) ** 2, axis=1) - 1.69, lambda x: 2 * (x - [0.1, -0.2])
    ),
}


@pytest.mark.parametrize("name", SURFACES)
def test_closest_points_and_their_derivatives(name):
    surface, rng = SURFACES[name], np.random.default_rng(4)
    dim = 3 if name == "sphere" else 2
    away = rng.normal(size=(40, dim))
    x = away / np.linalg.norm(away, axis=1, keepdims=True) * rng.uniform(1.2, 2.2, (40, 1))
    x *= [2.0, *[1.0] * (dim - 1)]
    gap, normal, bend = surface.closest(x)
    on = x - gap[:, None] * normal
    assert np.abs(surface.gap(on)).max() < 1e-9
    assert np.abs(np.linalg.norm(normal, axis=1) - 1).max() < 1e-12
    along = np.linspace(0, 2 * np.pi, 20001)
    if "ellipse" in name or name == "differences":
        rim = np.stack([2 * np.cos(along), np.sin(along)], axis=1)
        least = np.linalg.norm(x[:, None] - rim, axis=2).min(axis=1)
        assert np.abs(gap - least).max() < 1e-6
    step, close = (1e-2, 1e-3) if name == "differences" else (1e-5, 1e-8)
    for axis, h in enumerate(step * np.eye(dim)):
        ahead, behind = surface.closest(x + h), surface.closest(x - h)
        assert np.abs((ahead[0] - behind[0]) / (2 * step) - normal[:, axis]).max() < close
        assert np.abs((ahead[1] - behind[1]) / (2 * step) - bend[:, :, axis]).max() < close


def interface_of_one_surface(surface, x, dim):
    """Points (m, dim) as an interface of one surface."""
    return SimpleNamespace(
        position=x,
        pair=np.zeros(len(x), dtype=int),
        equation=np.zeros((len(x), dim), dtype=int),
        held_components=np.zeros((len(x), dim), dtype=bool),
        faced=np.full(len(x), RIGID),
        closest=lambda moved: surface.closest(x + moved),
        gathered=lambda values: values,
    )


def test_slip_is_the_arc():
    for dim in (2, 3):
        angle = np.array([0.05, 0.4, 1.2])
        end = np.zeros((3, dim))
        end[:, 0], end[:, -1] = 2 * np.sin(angle), 2 * np.cos(angle)
        start = np.zeros((3, dim))
        start[:, -1] = 2.3  # above the surface
        ball = Sphere((0.0,) * dim, 2.0)
        points, still = interface_of_one_surface(ball, start, dim), np.zeros((1, dim + 1))
        surfaces = RigidSurfaceMotion(points, [ContactPair(on_top, ball)])
        at_rest = IncrementStart(np.zeros((3, dim)), np.zeros((3, dim)), still)
        kinematics = DeformedKinematics(points, surfaces, at_rest, RigidSurfacesOnly())
        place = kinematics.linearise(still, end - start, np.zeros((3, dim)))
        assert np.abs(np.linalg.norm(place.slip, axis=1) - 2 * angle).max() < 1e-12
        pressed = np.ones(3, dtype=bool)
        assert not kinematics.find_jumped(place, pressed).any()
        far = kinematics.linearise(still, -2.1 * start, np.zeros((3, dim)))
        assert kinematics.find_jumped(far, pressed).all()


@pytest.mark.parametrize("stress", [neo_hookean_stress, saint_venant])
def test_no_cell_is_turned(stress):
    """Whatever the stress is, which may stay finite there, no accepted state has turned cells."""
    rubber = RubberUnderCircle(2, stress=stress)
    guard, states = CellGuard(rubber.u, rubber.residual), [rubber.problem.undeformed]

    def press():
        for k in range(1, 8):
            motion = Motion((0.0, -0.142 * k))  # there is room for the block up to 1
            states.append(rubber.problem.step(states[-1], motions=motion))
            assert guard.min_determinant() > 0

    with pytest.raises(NotFound, match="halved further") as raised:
        press()
    assert len(states) > 1
    share, reached = raised.value.last_substate
    assert 0 < share < 1
    assert reached.converged
    assert reached.pairs[0].translation[1] <= states[-1].pairs[0].translation[1]
    assert np.array_equal(rubber.u.x.array, reached.unknowns.array_r)
    assert guard.min_determinant() > 0


@pytest.mark.parametrize("first", [0.0, 0.2])
def test_a_tool_is_not_led_through_supports(first):
    """Without any linear system."""
    solved = []
    problem = RubberUnderCircle(callback=solved.append).problem
    (pressed,) = step_through(problem, [Motion((0.0, -first))])
    del solved[:]
    with pytest.raises(SurfacePassed, match=r"through the supports at .* passes"):
        problem.step(pressed, motions=Motion((0.1, -3.0)))
    assert not solved
    beside = step_through(problem, [Motion((3.0, 0.0)), Motion((3.0, -3.0)), Motion((0.0, -3.0))])
    assert np.abs(beside[-1].pairs[0].force_vector).max() < 1e-15


def test_history_belongs_to_the_state():
    """A function that remembers is restored where a step starts anew, and updated at its end."""
    rubber, hardness = make_hardening_rubber()
    first, second = step_through(rubber.problem, CIRCLE_MOTIONS[:2])
    assert [s.history[0].min() for s in (rubber.problem.undeformed, first, second)] == [0, 1, 2]
    rubber.problem.step(first, motions=CIRCLE_MOTIONS[1])
    assert hardness.x.array.max() == 2.0


def collect_pair_fields(ends, further_fields=()):
    names = ("force_vector", "slip", "gap", "status", "displacement", *further_fields)
    return {f"{end} {n}": getattr(state.pairs[0], n) for end, state in ends.items() for n in names}


def solve_pressed_and_pushed(kind, solver, comm=MPI.COMM_SELF):
    """The state of a block of rubber under a ball that is rough, in space or in the plane."""
    dim, hybrid = (2 if kind == "T6" else 3), kind == "hybrid"
    low, high, n = [-1.0] * dim, [*[1.0] * (dim - 1), 0.0], [3] * (dim - 1) + [2]
    if dim == 2:
        mesh = triangles(comm, low, high, (16, 8))
    else:
        mesh = create_box(comm, [low, high], n, CellType.tetrahedron)
    spaces = (Spaces.hybrid if hybrid else Spaces.petrov_galerkin)(mesh)
    w, residual = finite_strain_residual(spaces, degree=3, compressibility=1e-4)
    base = [prescribe(spaces.trial, k, on_plane(dim - 1, -1.0)) for k in range(dim)]
    ball = Sphere((*[0.0] * (dim - 1), 1.0), 1.0)
    pair = ContactPair(on_plane(dim - 1, 0.0), ball, friction=0.3)
    problem = ContactProblem.of_residual(residual, w, base, pair, solver=solver)
    state = problem.undeformed
    for motion in ((0.0, 0.0, -0.15), (0.0, 0.0, -0.3), (0.1, 0.05, -0.3)):
        state = problem.step(state, motions=Motion((motion[0], *motion[4 - dim :])))
    return state


@pytest.mark.parametrize("kind", ["T6", "T10", "hybrid"])
def test_krylov_finds_what_factors_find(kind):
    factors, krylov = (
        collect_pair_fields({"end": solve_pressed_and_pushed(kind, solver)})
        for solver in SOLVERS.values()
    )
    assert {STICK, SLIP} <= set(factors["end status"])
    assert_same(factors, krylov, 1e-9, kind)


@pytest.mark.random  # for those are what runs at night
def test_half_a_million_unknowns_take_less_than_four_gigabytes(request):
    """Two increments of a ball that is pressed and dragged, as on a mesh of a tenth of that."""
    if not request.config.getoption("--nightly"):
        pytest.skip("takes a quarter of an hour, with --nightly")
    few, many = (alone(Row("sliding", "pw-T10", n, "Iterative")) for n in (8, 17))
    assert round(many["dofs"], -3) == 500_000
    assert many["megabytes"] * 2**20 < 4e9
    assert many["pressed"] == pytest.approx(few["pressed"], rel=0.03)
    assert many["pushed"] == pytest.approx(few["pushed"], rel=0.03)


def leaning_column(solver, depths):
    """States of a column that leans by a thousandth, pressed down to the depths."""
    mesh = triangles(MPI.COMM_SELF, (-0.5, 0.0), (0.5, 8.0), (2, 16))
    mesh.geometry.x[:, 0] += 1e-3 * mesh.geometry.x[:, 1]
    spaces = Spaces.petrov_galerkin(mesh)
    u, residual = finite_strain_residual(spaces)
    foot = [prescribe(spaces.trial, k, on_plane(1, 0.0)) for k in (0, 1)]
    pair = ContactPair(on_plane(1, 8.0), Plane((0, 8.0), (0, -1)))
    problem = ContactProblem.of_residual(residual, u, foot, pair, solver=solver)
    state = problem.undeformed
    for depth in depths:
        state = problem.step(state, motions=Motion((0.0, -depth)))
        yield state


def test_a_column_buckles_by_either_solver():
    """Small increments follow the branch to the side to which the column leans."""
    depths = (0.05, 0.06, 0.065, 0.07, 0.08, 0.1, 0.12)
    forces = []
    for solver in SOLVERS.values():
        states = list(leaning_column(solver, depths))
        assert states[-1].displacement.array_r[::2].max() > 0.1
        forces.append([-state.pairs[0].force[1] for state in states])
    assert forces[0][-1] < 0.9 * depths[-1] / depths[0] * forces[0][0]
    assert np.allclose(*forces, rtol=1e-8)


def test_an_unstable_straight_column_is_refused():
    """One increment beyond the critical load is halved; to which side it bends is left open."""
    *_, state = leaning_column(Direct(), (0.05, 0.12))
    assert state.substates
    assert np.abs(state.displacement.array_r[::2]).max() > 0.1


def test_levels_are_made_anew_when_it_pays(monkeypatch):
    """Most tangents take those of an earlier one, at the price of few more iterations."""
    mesh, made = triangles(MPI.COMM_SELF, (-1.0, -1.0), (1.0, 0.0), (16, 8)), []
    renew = Multigrid.refresh
    monkeypatch.setattr(Multigrid, "refresh", lambda levels: (made.append(levels), renew(levels)))

    def work():
        made.clear()
        states = step_through(
            RubberUnderCircle(mesh=mesh, solver=Iterative()).problem, CIRCLE_MOTIONS
        )
        steps, krylov = np.sum([(s.iterations, s.report.krylov_iterations) for s in states], axis=0)
        return steps, krylov, len(made)

    steps, krylov, kept = work()
    monkeypatch.setattr(KrylovTangent, "_operations", lambda _: 0.0)  # new ones cost nothing
    _, least, always = work()
    assert 0 < kept < steps / 3 < always
    assert krylov < 1.5 * least


def test_a_thin_tool_keeps_its_side():
    """An increment in which nodes would find the tool's other side is cut until they do not."""
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


def test_areas_of_a_stretched_surface():
    rubber = RubberUnderCircle()
    (pair,) = step_through(rubber.problem, CIRCLE_MOTIONS)[-1].pairs
    scalars = Spaces.petrov_galerkin(rubber.space.mesh, 0)
    surface = SurfaceNodes.from_scalar_spaces(scalars, on_top, SurfaceNodes.stretch(rubber.u))
    x = pair.position + pair.displacement
    length = np.linalg.norm(np.diff(x, axis=0), axis=1).sum()
    assert surface.weight_area.sum() == pytest.approx(length, rel=0.02)


@pytest.mark.parametrize("kind", ["plane strain", "axisymmetric", "solid", "hybrid"])
def test_pressures_of_uniform_compression(kind, tmp_path):
    """Nominal and true pressure are Piola's and Cauchy's stress, in fields, files and pictures."""
    solid, hybrid, ring = kind == "solid", kind == "hybrid", kind == "axisymmetric"
    if solid:
        mesh = create_unit_cube(MPI.COMM_SELF, 1, 1, 1, CellType.tetrahedron)
    else:
        mesh = triangles(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (2, 2))
    dim, spaces = 2 + solid, (Spaces.hybrid if hybrid else Spaces.petrov_galerkin)(mesh)
    w, tests = fem.Function(spaces.trial), ufl.TestFunction(spaces.test)
    (u, p), (v, q) = (ufl.split(f) if hybrid else (f, None) for f in (w, tests))

    def gradient(f):  # in three dimensions
        columns = [[f[i].dx(j) if max(i, j) < dim else 0 for j in range(3)] for i in range(3)]
        if ring:
            columns[2][2] = f[0] / ufl.SpatialCoordinate(mesh)[0]
        return ufl.as_matrix(columns)

    def stress(F, pressure=None):  # Piola's
        inverse, J = ufl.inv(F).T, ufl.det(F)
        return F - inverse + (1.5 * ufl.ln(J) if pressure is None else -pressure * J) * inverse

    F = ufl.Identity(3) + gradient(u)
    density = ufl.inner(stress(F, p), gradient(v))
    density -= q * (ufl.det(F) - 1 + p / 1e4) if hybrid else 0
    depth = 2 * np.pi * ufl.SpatialCoordinate(mesh)[0] if ring else 1.0
    residual = density * depth * ufl.dx(metadata={"quadrature_degree": 5})
    held = [prescribe(spaces.trial, k, on_plane(k, 0.0)) for k in range(dim)]
    up = np.eye(dim)[-1]
    pair = ContactPair(on_plane(dim - 1, 1.0), Plane(up, -up))
    problem = ContactProblem.of_residual(residual, w, held, pair)
    state = problem.step(problem.undeformed, motions=Motion(-0.3 * up))
    body = Body(spaces, Material(1.0, 0.3), "plane strain" if hybrid else kind)
    fields, (top,) = ContactFields.from_state(state, body), state.pairs
    wide = 1 + top.displacement[:, 0].max()
    deep = wide if solid or ring else 1.0
    area = wide * deep
    # sides are free: P = F - c F^-T vanishes there, so that c is the square of their stretch
    nominal = wide**2 / 0.7 - 0.7
    for field, exact in ((fields.pressure, nominal), (fields.true_pressure, nominal / area)):
        assert np.abs(field.x.array[top.node] / exact - 1).max() < 1e-7
    axes = plot(state, body)
    label = axes.child_axes[0].get_ylabel() if solid else axes.get_legend().texts[-1].get_text()
    assert label == "nominal pressure"
    if vtx.library() is not None:
        write(tmp_path / "block.bp", [problem.undeformed, state], body)
        (_, first), (_, last) = vtx.read(tmp_path / "block.bp")
        assert not first["true_pressure"].any()
        assert abs(last["true_pressure"].max() * area / nominal - 1) < 1e-7
    problem.save(state, tmp_path / "state.npz")
    assert (
        ContactFields.from_state(problem.load(tmp_path / "state.npz"), body).true_pressure
        is not None
    )


FAR = SignedDistance(lambda x: (x[:, 1] - 1) ** 2 + 1.0, lambda x: 2 * (x - [0, 1]) * [0, 1])


@pytest.mark.parametrize(
    ("attempt", "kind", "words"),
    [
        (lambda it: it.problem_with(surface=Parabola((0.0, 0.0), 0.6)), ValueError, "Sphere"),
        (
            lambda it: it.problem_with(surface=FlatPunch((0, 0), (0, -1), 0.3)),
            ValueError,
            "rounded",
        ),
        (lambda it: it.problem_with(interference=True), ValueError, "interference"),
        (lambda it: it.press(load=it.problem.undeformed.displacement), TypeError, "of the share"),
        (lambda _: RubberUnderCircle(update=3), TypeError, "update"),
        # a point at the centre of curvature
        (lambda it: it.press(it.problem_with(surface=FAR)), NotFound, "no closest point"),
    ],
)
def test_what_large_strains_have_not_is_refused(attempt, kind, words):
    with pytest.raises(kind, match=words):
        attempt(RubberUnderCircle())


class NearlyIncompressible:
    """A linear elastic block whose bulk modulus grows, held below and touched at one node."""

    def __init__(self, cell, mid_nodes, spaces=Spaces.petrov_galerkin):
        mesh = distorted_mesh(cell, 4, 0.05, 1, mid_nodes)
        self.spaces = spaces(mesh)
        self.lame = fem.Constant(mesh, 1.0)
        self.u, v = fem.Function(self.spaces.trial), ufl.TestFunction(self.spaces.test)
        strain, trial = (lambda w: ufl.sym(ufl.grad(w))), ufl.TrialFunction(self.spaces.trial)
        dx = ufl.dx(metadata={"quadrature_degree": 4})

        def work(u):
            return 2 * ufl.inner(strain(u), strain(v)) + self.lame * ufl.div(u) * ufl.div(v)

        self.stiffness = work(trial) * dx
        self.held = [prescribe(self.spaces.trial, k, on_plane(1, 0.0)) for k in (0, 1)]
        x = self.spaces.trial.tabulate_dof_coordinates()[:, :2]
        self.node = int(np.argmin(np.linalg.norm(x - [0.5, 1.0], axis=1)))
        pair = ContactPair(np.array([self.node]), Sphere(x[self.node] + [0.0, 1.0], 1.0))
        self.problem = ContactProblem.of_residual(work(self.u) * dx, self.u, self.held, pair)
        self.states = [self.problem.undeformed]

    def press(self, depth, lame):
        def load(_):
            self.lame.value = lame

        self.states.append(self.problem.step(self.states[-1], load, Motion((0.0, -depth))))
        return self.states[-1]

    def reaction(self, depth):
        """The force at the node by NumPy."""
        K = dense(assemble_matrix(self.stiffness))
        known = {int(d): 0.0 for c in self.held for d in c.dof_indices()[0]}
        known[2 * self.node + 1] = -depth
        a, free = np.zeros(len(K)), np.setdiff1d(np.arange(len(K)), [*known])
        a[[*known]] = [*known.values()]
        a[free] = np.linalg.solve(K[np.ix_(free, free)], -(K @ a)[free])
        return (K @ a)[2 * self.node + 1]


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_a_determinant_that_turns_with_the_bulk_modulus_is_no_instability(cell, caplog):
    case, depth = NearlyIncompressible(cell, mid_nodes=True), 1e-5
    with caplog.at_level(logging.WARNING, "pw_elements.contact"):
        case.press(depth, 1.0)
        assert "bulk" not in caplog.text
        stiff = case.press(depth, 1e3)
        case.press(depth, 1e3)
    assert case.states[1].orientations != stiff.orientations
    assert stiff.pairs[0].force[1] == pytest.approx(case.reaction(depth), rel=1e-3)
    told = [r.message for r in caplog.records if "bulk stiffness" in r.message]
    assert len(told) == 1
    assert "1e+03 times its shear stiffness" in told[0]
    assert "Spaces.hybrid(mesh)" in told[0]


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_straight_cells_of_the_plane_and_standard_elements_get_no_warning(cell, caplog):
    cases = [NearlyIncompressible(cell, False), NearlyIncompressible(cell, True, Spaces.galerkin)]
    with caplog.at_level(logging.WARNING, "pw_elements.contact"):
        for case in cases:
            case.press(1e-5, 1.0)
            state = case.press(1e-5, 1e3)
            assert state.pairs[0].force[1] == pytest.approx(case.reaction(1e-5), rel=1e-3)
    assert "bulk" not in caplog.text


class OwnSphere(Sphere):
    """A user's circle, with factors of what it says of its normal and of its derivative."""

    normals, bends = 1.0, 1.0

    def closest(self, x):
        gap, normal, bend = super().closest(x)
        turn = (self.normals - 1) * np.stack([-normal[:, 1], normal[:, 0]], axis=1)
        return gap, normal + turn, self.bends * bend


class TurnedNormals(OwnSphere):
    normals = 1.01


class WrongBends(OwnSphere):
    bends = 1.05


@pytest.mark.parametrize(
    ("kind", "words"),
    [(TurnedNormals, "have the normal"), (WrongBends, "have the derivative of the normal")],
)
def test_a_surface_whose_derivatives_are_none_is_refused(kind, words):
    rubber = RubberUnderCircle(n=2)
    right = rubber.press(rubber.problem_with(surface=OwnSphere((0.0, 0.6), 0.6)))
    assert right.converged
    with pytest.raises(ValueError, match=words):
        rubber.press(rubber.problem_with(surface=kind((0.0, 0.6), 0.6)))


def flat_face(half_width, outside):
    """A face at y = 0 above the body, as a signed distance, and its gradient."""

    def distance(x):
        return np.where(np.abs(x[:, 0]) <= half_width, -x[:, 1], outside)

    def gradient(x):
        return np.tile([0.0, -1.0], (len(x), 1))

    return distance, gradient


@pytest.mark.parametrize("with_gradient", [True, False])
def test_nothing_faces_points_where_a_signed_distance_is_infinite(with_gradient):
    """As against a plane whose pair has the nodes below the face only; then they leave it."""
    half_width = 0.53  # no node passes its edge

    def solved(surface, nodes, way):
        mesh = triangles(MPI.COMM_SELF, (-1.0, -1.0), (1.0, 0.0), (16, 4))
        spaces = Spaces.petrov_galerkin(mesh)
        u, residual = finite_strain_residual(spaces)
        held = [prescribe(spaces.trial, k, on_plane(1, -1.0)) for k in (0, 1)]
        pair = ContactPair(nodes, surface, 0.3)
        problem = ContactProblem.of_residual(residual, u, held, pair)
        states = [problem.undeformed]
        for place in way:
            states.append(problem.step(states[-1], motions=Motion(place)))
        return states

    distance, gradient = flat_face(half_width, np.inf)
    face = SignedDistance(distance, gradient if with_gradient else None)
    way = [(0.0, -0.02), (0.01, -0.05), (0.02, -0.05)]
    below = lambda x: on_plane(1, 0.0)(x) & (np.abs(x[0]) < half_width)  # noqa: E731
    known = solved(Plane((0.0, 0.0), (0.0, -1.0)), below, way)
    found = solved(face, on_plane(1, 0.0), way)
    for one, other in zip(found[1:], known[1:], strict=True):
        assert (one.unknowns - other.unknowns).norm() < 1e-9
        assert np.abs(one.pairs[0].force - other.pairs[0].force).max() < 1e-9
        (pair,) = one.pairs
        away = np.isinf(pair.gap)
        assert away.sum() == len(pair.gap) - len(other.pairs[0].gap)
        assert np.abs(pair.force_vector[away]).max() < 1e-10
    # slid by more than the width of a facet, so that nodes leave the face and others come below it
    *_, last = solved(face, on_plane(1, 0.0), [(0.0, -0.02), (0.1, -0.02), (0.2, -0.02)])
    (pair,) = last.pairs
    x = pair.position[:, 0] + pair.displacement[:, 0] - 0.2
    assert np.array_equal(np.isinf(pair.gap), np.abs(x) > half_width)
    assert np.abs(pair.force_vector[np.abs(x) > half_width]).max() < 1e-10
    assert pair.force[1] < 0
    assert last.residuals.largest() < 1e-8
