"""What sections V1 to V8 and V10 are judged by: exact fields, meshes, published answers."""

import numpy as np
import pytest
import ufl
from dolfinx import fem
from scipy.integrate import quad

from pw_elements import Material
from pw_elements.elasticity import StressState
from study.benchmarks import v4_spence
from study.benchmarks.v8_vibration.exact_eigenvalues import Rod, squared_wave_speeds
from study.benchmarks.v10_space import partial_slip
from study.meshes.mesh_lines import graded_body_lines
from study.meshes.solid_meshes import mesh_box, mesh_quarter_cylinder, with_mirror_image
from study.solutions.half_space import (
    BondedLinePunch,
    ElasticHalfSpace,
    FlatLinePunch,
    FlatRoundPunch,
    HertzLine,
    HertzSphere,
)
from study.solutions.half_space_shear import (
    MindlinSphere,
    _cerruti_displacement,
    force_of_unit_hertz_contact,
)
from study.solutions.stick_slip import Cattaneo

BODY = ElasticHalfSpace(1000.0, 0.3)
KNOWN = [
    HertzLine(BODY, 10.0, 20.0),
    HertzSphere(BODY, 10.0, 20.0),
    FlatLinePunch(BODY, 1.0, 3.0),
    BondedLinePunch(BODY, 1.0, 3.0),
    FlatRoundPunch(BODY, 1.0, 3.0),
]
ROUND = (HertzSphere, FlatRoundPunch)


def stress(known, x):
    """Stresses xx, yy, xy and hoop at points (n, 2), by central differences of displacements."""
    h = 1e-4 * known.half_width
    by_x, by_y = (
        (known.displacement(x + step) - known.displacement(x - step)) / (2 * h)
        for step in (np.array([h, 0.0]), np.array([0.0, h]))
    )
    hoop = known.displacement(x)[:, 0] / x[:, 0] if isinstance(known, ROUND) else 0.0
    nu, shear = BODY.poissons_ratio, BODY.shear_modulus
    volume = 2 * shear * nu / (1 - 2 * nu) * (by_x[:, 0] + by_y[:, 1] + hoop)
    direct = [volume + 2 * shear * strain for strain in (by_x[:, 0], by_y[:, 1], hoop)]
    return np.array([direct[0], direct[1], shear * (by_x[:, 1] + by_y[:, 0]), direct[2]])


@pytest.mark.parametrize("known", KNOWN, ids=lambda k: type(k).__name__)
class TestExactFields:
    def test_body_is_in_equilibrium(self, known):
        a = known.half_width
        x = np.array([[2.3, -0.4], [1.1, -2.2], [3.0, -3.0]]) * a
        h = 1e-2 * a
        by_x, by_y = (
            (stress(known, x + step) - stress(known, x - step)) / (2 * h)
            for step in (np.array([h, 0.0]), np.array([0.0, h]))
        )
        s, r = stress(known, x), x[:, 0] if isinstance(known, ROUND) else np.inf
        residual = [by_x[0] + by_y[2] + (s[0] - s[3]) / r, by_x[2] + by_y[1] + s[2] / r]
        assert np.abs(residual).max() < 1e-3 * np.abs(by_x).max()

    def test_surface_beside_the_contact_is_free(self, known):
        a = known.half_width
        near = stress(known, np.array([[2.5 * a, -2e-4 * a]]))
        inside = stress(known, np.array([[2.5 * a, -2.5 * a]]))
        assert np.abs(near[[1, 2]]).max() < 1e-3 * np.abs(inside[:3]).max()

    def test_stresses_carry_the_force(self, known):
        side, n = 3 * known.half_width, 400
        s = (np.arange(n) + 0.5) * side / n
        below = stress(known, np.stack([s, np.full(n, -side)], axis=1))[1]
        beside = stress(known, np.stack([np.full(n, side), -s], axis=1))[2]
        around = 2 * np.pi * np.array([s, np.full(n, side)]) if isinstance(known, ROUND) else 2.0
        width, height = around * np.ones((2, n))
        carried = (-below @ width + beside @ height) * side / n
        assert carried == pytest.approx(known.force, rel=1e-4)

    def test_force_is_the_integral_of_the_pressure(self, known):
        end = 0.7 * known.half_width

        def density(x):
            around = 2 * np.pi * x if isinstance(known, ROUND) else 1.0
            return around * known.pressure(np.array([x]))[0]

        assert known.force_within(np.array([end]))[0] == pytest.approx(quad(density, 0, end)[0])
        whole = known.force if isinstance(known, ROUND) else known.force / 2
        assert known.force_within(np.array([known.half_width]))[0] == pytest.approx(whole)


HALF_SPACE = ElasticHalfSpace(2.0, 0.3)


def stress_and_unbalance(field, x, h=1e-3):
    """Stress (3, 3) of a displacement field at x, and its divergence, by differences."""

    def stress(x):
        gradient = np.array(
            [(field(x + step) - field(x - step)) / (2 * h) for step in h * np.eye(3)]
        ).T
        strain, nu = (gradient + gradient.T) / 2, HALF_SPACE.poissons_ratio
        lame = 2 * HALF_SPACE.shear_modulus * nu / (1 - 2 * nu)
        return 2 * HALF_SPACE.shear_modulus * strain + lame * np.trace(strain) * np.eye(3)

    divergence = sum(
        (stress(x + step)[:, k] - stress(x - step)[:, k]) / (2 * h)
        for k, step in enumerate(h * np.eye(3))
    )
    return stress(x), divergence


def cerruti(x):
    return _cerruti_displacement(HALF_SPACE, x[None], np.array([[0.0, 0.0]]), np.array([1.0]))[0]


def test_cerruti_is_in_equilibrium_and_free_of_tractions():
    for x in np.array([[1.0, 0.5, -0.7], [-0.4, 0.9, -1.5]]):
        stress, divergence = stress_and_unbalance(cerruti, x)
        assert divergence == pytest.approx(0.0, abs=1e-5 * np.abs(stress).max())
    stress, _ = stress_and_unbalance(cerruti, np.array([0.7, -0.4, -2e-3]))
    assert stress[:, 2] == pytest.approx(0.0, abs=5e-3 * np.abs(stress).max())


def test_cerruti_carries_the_force():
    """Tractions on a half ball around it, by Gauss' rule and even angles."""
    s, weight = np.polynomial.legendre.leggauss(10)
    total = np.zeros(3)
    for cosine, w in zip((s - 1) / 2, weight / 2, strict=True):
        for angle in 2 * np.pi * np.arange(16) / 16:
            sine = np.sqrt(1 - cosine**2)
            n = np.array([sine * np.cos(angle), sine * np.sin(angle), cosine])
            total += stress_and_unbalance(cerruti, n)[0] @ n * w * 2 * np.pi / 16
    assert total == pytest.approx([-1.0, 0.0, 0.0], abs=1e-4)


def test_mindlin_holds_what_it_says():
    known = MindlinSphere(
        HertzSphere(
            ElasticHalfSpace(1.0, 0.0), 10.0, force_of_unit_hertz_contact(HALF_SPACE, 10.0)
        ),
        0.4,
        0.5,
    )
    a = known.normal_contact.half_width
    r = np.linspace(0, a, 4001)
    force = 2 * np.pi * np.trapezoid(known.shear(r) * r, r)
    assert force == pytest.approx(known.tangential_force, rel=1e-4)
    # at nu = 0 the middle moves by the sum of 2 q dA / (4 pi G r)
    moved = np.trapezoid(known.shear(r), r) / known.normal_contact.body.shear_modulus
    assert moved == pytest.approx(known.tangential_approach, rel=1e-3)
    assert known.shear(np.array([known.stick_radius])) == pytest.approx(
        0.4 * known.pressure(np.array([known.stick_radius]))
    )


def test_stick_radius_fitted_to_mindlins_tractions_is_exact():
    """The nodes are random, and some of them have no traction."""
    sphere = HertzSphere(HALF_SPACE, 1e3, force_of_unit_hertz_contact(HALF_SPACE, 1e3))
    exact = MindlinSphere(sphere, partial_slip.FRICTION, partial_slip.FRICTION_FRACTION)
    r = np.random.default_rng(3).uniform(0, 1, 200)
    tractions = np.column_stack([exact.shear(r), 0 * r, exact.pressure(r)])
    tractions[::7] = np.nan
    radius = partial_slip.fit_stick_radius(r, tractions, r < exact.stick_radius)
    assert radius == pytest.approx(exact.stick_radius, rel=1e-9)


@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
def test_meshes_have_their_volume_and_their_edge(cell):
    lines = graded_body_lines(3)
    mesh = mesh_box(cell, lines.horizontal, lines.horizontal, lines.vertical)
    assert volume(mesh) == pytest.approx(2.5**3)
    mesh = mesh_quarter_cylinder(cell, 2, np.array([1.5, 2.0]), np.array([-1.0, -0.4, 0.0]))
    assert volume(mesh) == pytest.approx(np.sin(np.pi / 8) / (np.pi / 8) * np.pi, rel=1e-12)
    r = np.hypot(*mesh.geometry.x[:, :2].T)
    assert np.isclose(r, 1.0).sum() == 3 * 5
    both = with_mirror_image(mesh, 1.0)
    assert volume(both) == pytest.approx(2 * volume(mesh))


def volume(mesh):
    return fem.assemble_scalar(fem.form(fem.Constant(mesh, 1.0) * ufl.dx))


def test_partial_slip_formulas_balance_the_forces():
    known = Cattaneo(half_width=2.0, force=3.0, friction=0.3, friction_utilisation=0.6)
    x = np.linspace(-2, 2, 200_001)
    assert np.trapezoid(known.pressure(x), x) == pytest.approx(3.0, rel=1e-6)
    assert np.trapezoid(known.shear(x), x) == pytest.approx(0.6 * 0.3 * 3.0, rel=1e-6)
    slipping = np.abs(x) > known.stick_half_width
    assert known.shear(x)[slipping] == pytest.approx(0.3 * known.pressure(x)[slipping])
    assert np.all(known.shear(x)[~slipping] <= 0.3 * known.pressure(x)[~slipping])


@pytest.mark.parametrize(("material", "known"), v4_spence.REFERENCE_STICK_RADII.items())
def test_stick_radius_below_a_flat_punch(material, known):
    scalars = v4_spence.stick_radius("pw-T6", *material, elements=32).scalars
    reach = scalars["stick_between"] / 2 + v4_spence.REFERENCE_RADIUS_ACCURACY
    assert abs(scalars["stick"] - known) < reach
    assert scalars["pass_change"] < 1e-6
    assert scalars["force_normal"] == pytest.approx(v4_spence.FORCE / 2, rel=1e-9)


MATERIAL = Material(1.0, 0.3)


def test_rod_eigenvalues_agree_with_published_ones():
    published = [8.32708524, 18.69438659, 21.0458481, 24.33204579, 32.8373545, 41.46258448]
    assert Rod(MATERIAL, 0.5, 1.0).eigenvalues(6) == pytest.approx(published, rel=2e-9)


def test_thin_rod_eigenvalues_tend_to_those_of_a_bar():
    # Rayleigh's correction for lateral inertia: E k^2 / rho (1 - (nu k a)^2 / 2)
    material, radius, length = Material(7.0, 0.3, density=2.0), 0.02, 3.0
    k = np.pi * np.arange(1, 4) / length
    bar = 7.0 / 2.0 * k**2
    exact = np.array(Rod(material, radius, length).eigenvalues(3))
    assert exact == pytest.approx(bar * (1 - (0.3 * k * radius) ** 2 / 2), rel=1e-6)
    assert np.all(exact < bar * (1 - 1e-5))


def test_wave_speeds_in_plane_states_agree_with_theory():
    solid, shear = squared_wave_speeds(MATERIAL, StressState.PLANE_STRAIN)
    plate, same = squared_wave_speeds(MATERIAL, StressState.PLANE_STRESS)
    assert shear == same == pytest.approx(1 / 2.6)
    assert plate / shear == pytest.approx(2 / (1 - 0.3))
    assert solid / shear == pytest.approx(2 * (1 - 0.3) / (1 - 0.6))
