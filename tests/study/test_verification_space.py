"""Section V10: its exact fields, its meshes, and the symmetric sibling."""

import numpy as np
import pytest
import ufl
from dolfinx import fem

from study.verification import v10_partial_slip as v10
from study.verification.half_space import Elastic, HertzSphere
from study.verification.half_space_shear import MindlinSphere, _cerruti, hertz_force
from study.verification.mesh_lines import graded
from study.verification.solid_meshes import box, quarter_disc, with_mirror_image

BODY = Elastic(2.0, 0.3)


def stress_and_unbalance(field, x, h=1e-3):
    """Stress (3, 3) of a displacement field at x, and its divergence, by differences."""

    def stress(x):
        gradient = np.array(
            [(field(x + step) - field(x - step)) / (2 * h) for step in h * np.eye(3)]
        ).T
        strain, nu = (gradient + gradient.T) / 2, BODY.poissons_ratio
        lame = 2 * BODY.shear_modulus * nu / (1 - 2 * nu)
        return 2 * BODY.shear_modulus * strain + lame * np.trace(strain) * np.eye(3)

    divergence = sum(
        (stress(x + step)[:, k] - stress(x - step)[:, k]) / (2 * h)
        for k, step in enumerate(h * np.eye(3))
    )
    return stress(x), divergence


def cerruti(x):
    return _cerruti(BODY, x[None], np.array([[0.0, 0.0]]), np.array([1.0]))[0]


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
    known = MindlinSphere(HertzSphere(Elastic(1.0, 0.0), 10.0, hertz_force(BODY, 10.0)), 0.4, 0.5)
    a = known.normal.half_width
    r = np.linspace(0, a, 4001)
    force = 2 * np.pi * np.trapezoid(known.shear(r) * r, r)
    assert force == pytest.approx(known.force, rel=1e-4)
    # at nu = 0 the middle moves by the sum of 2 q dA / (4 pi G r)
    moved = np.trapezoid(known.shear(r), r) / known.normal.body.shear_modulus
    assert moved == pytest.approx(known.shift, rel=1e-3)
    assert known.shear(np.array([known.stick])) == pytest.approx(
        0.4 * known.pressure(np.array([known.stick]))
    )


def test_stick_radius_of_mindlins_tractions_is_that_of_its_disc():
    """At any nodes that stick, without those that have no traction."""
    known = MindlinSphere(HertzSphere(BODY, 1e3, hertz_force(BODY, 1e3)), v10.SLIDING, v10.SHARE)
    r = np.random.default_rng(3).uniform(0, 1, 200)
    tractions = np.column_stack([known.shear(r), 0 * r, known.pressure(r)])
    tractions[::7] = np.nan
    sticks = r < known.stick
    assert v10._vanishing(r, tractions, sticks) == pytest.approx(known.stick, rel=1e-9)


@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
def test_meshes_have_their_volume_and_their_edge(cell):
    lines = graded(3)
    mesh = box(cell, lines.beside, lines.beside, lines.below)
    assert volume(mesh) == pytest.approx(2.5**3)
    mesh = quarter_disc(cell, 2, np.array([1.5, 2.0]), np.array([-1.0, -0.4, 0.0]))
    assert volume(mesh) == pytest.approx(np.sin(np.pi / 8) / (np.pi / 8) * np.pi, rel=1e-12)
    r = np.hypot(*mesh.geometry.x[:, :2].T)
    assert np.isclose(r, 1.0).sum() == 3 * 5
    both = with_mirror_image(mesh, 1.0)
    assert volume(both) == pytest.approx(2 * volume(mesh))


def volume(mesh):
    return fem.assemble_scalar(fem.form(fem.Constant(mesh, 1.0) * ufl.dx))
