"""Test exact fields, meshes and published values that sections V1 to V8 and V10 refer to."""

import numpy as np
import pytest
import ufl
from dolfinx import fem
from scipy.integrate import quad

from pw_elements import Material
from pw_elements.elasticity import StressState
from study.benchmarks import v4_spence
from study.benchmarks.v8_vibration.exact_eigenvalues import (
    AxisymmetricRodBetweenWalls,
    squared_dilatational_and_shear_wave_speeds,
)
from study.benchmarks.v10_space import partial_slip
from study.meshes.mesh_lines import mesh_lines_of_body_under_sphere
from study.meshes.solid_meshes import add_mirrored_body, mesh_box_along_lines, mesh_quarter_cylinder
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
    _displacement_by_tangential_point_forces,
    force_that_gives_contact_radius_1,
)
from study.solutions.stick_slip import CattaneoPartialSlip

STIFF_HALF_SPACE = ElasticHalfSpace(1000.0, 0.3)
EXACT_SOLUTIONS = [
    HertzLine(STIFF_HALF_SPACE, 10.0, 20.0),
    HertzSphere(STIFF_HALF_SPACE, 10.0, 20.0),
    FlatLinePunch(STIFF_HALF_SPACE, 1.0, 3.0),
    BondedLinePunch(STIFF_HALF_SPACE, 1.0, 3.0),
    FlatRoundPunch(STIFF_HALF_SPACE, 1.0, 3.0),
]
AXISYMMETRIC_SOLUTION_CLASSES = (HertzSphere, FlatRoundPunch)


def stress_by_differences(exact_solution, x):
    """Return the stresses (4, n) xx, yy, xy and hoop at points (n, 2).

    They are computed from central differences of the exact displacements by Hooke's law.
    """
    h = 1e-4 * exact_solution.half_width
    by_x, by_y = (
        (exact_solution.displacement(x + step) - exact_solution.displacement(x - step)) / (2 * h)
        for step in (np.array([h, 0.0]), np.array([0.0, h]))
    )
    hoop_strain = (
        exact_solution.displacement(x)[:, 0] / x[:, 0]
        if isinstance(exact_solution, AXISYMMETRIC_SOLUTION_CLASSES)
        else 0.0
    )
    nu, shear = STIFF_HALF_SPACE.poissons_ratio, STIFF_HALF_SPACE.shear_modulus
    volumetric_stress = 2 * shear * nu / (1 - 2 * nu) * (by_x[:, 0] + by_y[:, 1] + hoop_strain)
    normal_stresses = [
        volumetric_stress + 2 * shear * strain for strain in (by_x[:, 0], by_y[:, 1], hoop_strain)
    ]
    return np.array(
        [
            normal_stresses[0],
            normal_stresses[1],
            shear * (by_x[:, 1] + by_y[:, 0]),
            normal_stresses[2],
        ]
    )


@pytest.mark.parametrize("exact_solution", EXACT_SOLUTIONS, ids=lambda k: type(k).__name__)
class TestExactFields:
    def test_body_is_in_equilibrium(self, exact_solution):
        a = exact_solution.half_width
        x = np.array([[2.3, -0.4], [1.1, -2.2], [3.0, -3.0]]) * a
        h = 1e-2 * a
        by_x, by_y = (
            (
                stress_by_differences(exact_solution, x + step)
                - stress_by_differences(exact_solution, x - step)
            )
            / (2 * h)
            for step in (np.array([h, 0.0]), np.array([0.0, h]))
        )
        stresses, r = (
            stress_by_differences(exact_solution, x),
            x[:, 0] if isinstance(exact_solution, AXISYMMETRIC_SOLUTION_CLASSES) else np.inf,
        )
        residual = [
            by_x[0] + by_y[2] + (stresses[0] - stresses[3]) / r,
            by_x[2] + by_y[1] + stresses[2] / r,
        ]
        assert np.abs(residual).max() < 1e-3 * np.abs(by_x).max()

    def test_surface_beside_the_contact_is_free_of_traction(self, exact_solution):
        a = exact_solution.half_width
        surface_stress = stress_by_differences(exact_solution, np.array([[2.5 * a, -2e-4 * a]]))
        interior_stress = stress_by_differences(exact_solution, np.array([[2.5 * a, -2.5 * a]]))
        assert np.abs(surface_stress[[1, 2]]).max() < 1e-3 * np.abs(interior_stress[:3]).max()

    def test_stresses_on_a_box_balance_the_contact_force(self, exact_solution):
        side, n = 3 * exact_solution.half_width, 400
        s = (np.arange(n) + 0.5) * side / n
        bottom_stress = stress_by_differences(
            exact_solution, np.stack([s, np.full(n, -side)], axis=1)
        )[1]
        side_shear = stress_by_differences(
            exact_solution, np.stack([np.full(n, side), -s], axis=1)
        )[2]
        circumference = (
            2 * np.pi * np.array([s, np.full(n, side)])
            if isinstance(exact_solution, AXISYMMETRIC_SOLUTION_CLASSES)
            else 2.0
        )
        width, height = circumference * np.ones((2, n))
        total_force = (-bottom_stress @ width + side_shear @ height) * side / n
        assert total_force == pytest.approx(exact_solution.force, rel=1e-4)

    def test_force_within_a_radius_is_the_integral_of_the_pressure(self, exact_solution):
        radius = 0.7 * exact_solution.half_width

        def force_density(x):
            circumference = (
                2 * np.pi * x if isinstance(exact_solution, AXISYMMETRIC_SOLUTION_CLASSES) else 1.0
            )
            return circumference * exact_solution.pressure(np.array([x]))[0]

        assert exact_solution.force_within(np.array([radius]))[0] == pytest.approx(
            quad(force_density, 0, radius)[0]
        )
        total_force = (
            exact_solution.force
            if isinstance(exact_solution, AXISYMMETRIC_SOLUTION_CLASSES)
            else exact_solution.force / 2
        )
        assert exact_solution.force_within(np.array([exact_solution.half_width]))[
            0
        ] == pytest.approx(total_force)


SOFT_HALF_SPACE = ElasticHalfSpace(2.0, 0.3)


def stress_and_its_divergence(field, x, h=1e-3):
    """Return the stress (3, 3) of a displacement field at x (3,), and its divergence (3,).

    Both are computed by central differences with step h.
    """

    def stress(x):
        gradient = np.array(
            [(field(x + step) - field(x - step)) / (2 * h) for step in h * np.eye(3)]
        ).T
        strain, nu = (gradient + gradient.T) / 2, SOFT_HALF_SPACE.poissons_ratio
        lame = 2 * SOFT_HALF_SPACE.shear_modulus * nu / (1 - 2 * nu)
        return 2 * SOFT_HALF_SPACE.shear_modulus * strain + lame * np.trace(strain) * np.eye(3)

    divergence = sum(
        (stress(x + step)[:, k] - stress(x - step)[:, k]) / (2 * h)
        for k, step in enumerate(h * np.eye(3))
    )
    return stress(x), divergence


def cerruti_displacement(x):
    return _displacement_by_tangential_point_forces(
        SOFT_HALF_SPACE, x[None], np.array([[0.0, 0.0]]), np.array([1.0])
    )[0]


def test_cerruti_field_is_in_equilibrium_with_a_traction_free_surface():
    for x in np.array([[1.0, 0.5, -0.7], [-0.4, 0.9, -1.5]]):
        stress, divergence = stress_and_its_divergence(cerruti_displacement, x)
        assert divergence == pytest.approx(0.0, abs=1e-5 * np.abs(stress).max())
    stress, _ = stress_and_its_divergence(cerruti_displacement, np.array([0.7, -0.4, -2e-3]))
    assert stress[:, 2] == pytest.approx(0.0, abs=5e-3 * np.abs(stress).max())


def test_cerruti_tractions_on_a_half_ball_balance_the_unit_force():
    """The tractions of Cerruti's field on a half sphere around a unit force balance this force.

    They are integrated by Gauss's rule over the cosine of the polar angle and at evenly spaced
    azimuths.
    """
    gauss_points, weight = np.polynomial.legendre.leggauss(10)
    total = np.zeros(3)
    for cosine, w in zip((gauss_points - 1) / 2, weight / 2, strict=True):
        for angle in 2 * np.pi * np.arange(16) / 16:
            sine = np.sqrt(1 - cosine**2)
            n = np.array([sine * np.cos(angle), sine * np.sin(angle), cosine])
            total += stress_and_its_divergence(cerruti_displacement, n)[0] @ n * w * 2 * np.pi / 16
    assert total == pytest.approx([-1.0, 0.0, 0.0], abs=1e-4)


def test_mindlin_shear_gives_force_approach_and_friction_limit_at_stick_radius():
    mindlin = MindlinSphere(
        HertzSphere(
            ElasticHalfSpace(1.0, 0.0),
            10.0,
            force_that_gives_contact_radius_1(SOFT_HALF_SPACE, 10.0),
        ),
        0.4,
        0.5,
    )
    a = mindlin.normal_contact.half_width
    r = np.linspace(0, a, 4001)
    force = 2 * np.pi * np.trapezoid(mindlin.shear(r) * r, r)
    assert force == pytest.approx(mindlin.tangential_force, rel=1e-4)
    # for nu = 0, the displacement of the centre is the integral of 2 q / (4 pi G r) over the area
    centre_displacement = (
        np.trapezoid(mindlin.shear(r), r) / mindlin.normal_contact.body.shear_modulus
    )
    assert centre_displacement == pytest.approx(mindlin.tangential_approach, rel=1e-3)
    assert mindlin.shear(np.array([mindlin.stick_radius])) == pytest.approx(
        0.4 * mindlin.pressure(np.array([mindlin.stick_radius]))
    )


def test_stick_radius_fitted_to_mindlins_tractions_is_exact():
    """The stick radius fitted to exact tractions is exact, even if some nodes have no traction."""
    sphere = HertzSphere(
        SOFT_HALF_SPACE, 1e3, force_that_gives_contact_radius_1(SOFT_HALF_SPACE, 1e3)
    )
    exact = MindlinSphere(sphere, partial_slip.FRICTION, partial_slip.FRICTION_FRACTION)
    r = np.random.default_rng(3).uniform(0, 1, 200)
    tractions = np.column_stack([exact.shear(r), 0 * r, exact.pressure(r)])
    tractions[::7] = np.nan
    radius = partial_slip.fit_stick_radius_to_unused_friction(r, tractions, r < exact.stick_radius)
    assert radius == pytest.approx(exact.stick_radius, rel=1e-9)


@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
def test_solid_meshes_have_the_exact_volume_and_nodes_on_the_contact_edge(cell):
    lines = mesh_lines_of_body_under_sphere(3)
    mesh = mesh_box_along_lines(cell, lines.horizontal, lines.horizontal, lines.vertical)
    assert mesh_volume(mesh) == pytest.approx(2.5**3)
    mesh = mesh_quarter_cylinder(cell, 2, np.array([1.5, 2.0]), np.array([-1.0, -0.4, 0.0]))
    assert mesh_volume(mesh) == pytest.approx(np.sin(np.pi / 8) / (np.pi / 8) * np.pi, rel=1e-12)
    r = np.hypot(*mesh.geometry.x[:, :2].T)
    assert np.isclose(r, 1.0).sum() == 3 * 5
    mirrored_pair = add_mirrored_body(mesh, 1.0)
    assert mesh_volume(mirrored_pair) == pytest.approx(2 * mesh_volume(mesh))


def mesh_volume(mesh):
    return fem.assemble_scalar(fem.form(fem.Constant(mesh, 1.0) * ufl.dx))


def test_cattaneo_tractions_balance_the_forces_and_obey_the_friction_law():
    cattaneo = CattaneoPartialSlip(
        half_width=2.0, force=3.0, friction=0.3, friction_utilisation=0.6
    )
    x = np.linspace(-2, 2, 200_001)
    assert np.trapezoid(cattaneo.pressure(x), x) == pytest.approx(3.0, rel=1e-6)
    assert np.trapezoid(cattaneo.shear(x), x) == pytest.approx(0.6 * 0.3 * 3.0, rel=1e-6)
    slipping = np.abs(x) > cattaneo.stick_half_width
    assert cattaneo.shear(x)[slipping] == pytest.approx(0.3 * cattaneo.pressure(x)[slipping])
    assert np.all(cattaneo.shear(x)[~slipping] <= 0.3 * cattaneo.pressure(x)[~slipping])


@pytest.mark.parametrize(("material", "reference_radius"), v4_spence.REFERENCE_STICK_RADII.items())
def test_stick_radius_below_a_flat_punch_agrees_with_published_values(material, reference_radius):
    scalars = v4_spence.stick_radius("pw-T6", *material, elements=32).scalars
    tolerance = scalars["stick_between"] / 2 + v4_spence.REFERENCE_RADIUS_ACCURACY
    assert abs(scalars["stick"] - reference_radius) < tolerance
    assert scalars["pass_change"] < 1e-6
    assert scalars["force_normal"] == pytest.approx(v4_spence.FORCE / 2, rel=1e-9)


MATERIAL = Material(1.0, 0.3)


def test_rod_eigenvalues_agree_with_published_ones():
    published = [8.32708524, 18.69438659, 21.0458481, 24.33204579, 32.8373545, 41.46258448]
    assert AxisymmetricRodBetweenWalls(MATERIAL, 0.5, 1.0).eigenvalues(6) == pytest.approx(
        published, rel=2e-9
    )


def test_thin_rod_eigenvalues_are_those_of_a_bar_with_rayleighs_correction():
    # eigenvalues with Rayleigh's correction for lateral inertia: E k^2 / rho (1 - (nu k a)^2 / 2)
    material, radius, length = Material(7.0, 0.3, density=2.0), 0.02, 3.0
    wavenumbers = np.pi * np.arange(1, 4) / length
    bar_eigenvalues = 7.0 / 2.0 * wavenumbers**2
    rod_eigenvalues = np.array(AxisymmetricRodBetweenWalls(material, radius, length).eigenvalues(3))
    assert rod_eigenvalues == pytest.approx(
        bar_eigenvalues * (1 - (0.3 * wavenumbers * radius) ** 2 / 2), rel=1e-6
    )
    assert np.all(rod_eigenvalues < bar_eigenvalues * (1 - 1e-5))


def test_squared_wave_speeds_in_plane_states_agree_with_theory():
    solid_pressure_wave, solid_shear_wave = squared_dilatational_and_shear_wave_speeds(
        MATERIAL, StressState.PLANE_STRAIN
    )
    plate_pressure_wave, plate_shear_wave = squared_dilatational_and_shear_wave_speeds(
        MATERIAL, StressState.PLANE_STRESS
    )
    assert solid_shear_wave == plate_shear_wave == pytest.approx(1 / 2.6)
    assert plate_pressure_wave / solid_shear_wave == pytest.approx(2 / (1 - 0.3))
    assert solid_pressure_wave / solid_shear_wave == pytest.approx(2 * (1 - 0.3) / (1 - 0.6))
