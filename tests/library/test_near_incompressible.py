"""Displacement elements as Poisson's ratio tends to 1/2.

The tests cover the least singular values of the stiffness, the warnings, and the ratio of the bulk
stiffness to the shear stiffness of tangents.
"""

import logging

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg
import ufl
from dolfinx import fem
from dolfinx.mesh import CellType, create_box

from pw_elements import Body, Material, Spaces
from pw_elements.elasticity import TangentBulkShearMonitor, incompressibility
from pw_elements.elasticity.incompressibility import (
    MAX_BULK_OVER_SHEAR_CURVED_CELLS,
    MAX_BULK_OVER_SHEAR_STRAIGHT_CELLS,
    TangentBulkShearRatio,
    bulk_over_shear,
    has_only_parallelepiped_cells,
    has_only_straight_cells,
    max_bulk_over_shear_without_pressure,
)
from pw_elements.meshes import curved_mesh, triangles
from tests.contact.cases import make_finite_strain_unknown_and_residual, neo_hookean_piola_stress
from tests.library.near_incompressible import (
    CELLS_PER_SIDE_BY_CELL,
    make_distorted_mesh,
    measure_singularity,
)

SINGULAR_STIFFNESS_WARNING = "may be singular there"


@pytest.mark.parametrize("cell", CELLS_PER_SIDE_BY_CELL)
@pytest.mark.parametrize("mid_nodes", [False, True])
def test_up_to_the_limits_no_stiffness_is_nearly_singular(cell, mid_nodes):
    """Stiffness matrices are not nearly singular up to the limits of the bulk modulus.

    Some matrices are nearly singular above the limits, which shows that the limits are not too low.
    """
    distortion = 0.05 if mid_nodes else 0.2
    meshes = [
        make_distorted_mesh(cell, CELLS_PER_SIDE_BY_CELL[cell], distortion, seed, mid_nodes)
        for seed in range(3)
    ]
    limits = {max_bulk_over_shear_without_pressure(mesh) for mesh in meshes}
    (limit,) = limits
    # Poisson's ratio for which the ratio of bulk and shear modulus is at the limit
    safe = 0.49999 if np.isinf(limit) else (3 * limit - 2) / (6 * limit + 2)
    ratios = [measure_singularity(mesh, [safe, 0.4999, 0.49995, 0.49999]) for mesh in meshes]
    assert all(at_limit.sign == 1 for at_limit, *_ in ratios)
    beyond = [sample for _, *others in ratios for sample in others]
    if np.isinf(limit):
        # the least singular value falls like the root of 1 - 2 nu, in the same way on all meshes
        assert all(0.01 < sample.least < 0.15 and sample.sign == 1 for sample in beyond)
    else:
        assert all(at_limit.least > 0.07 for at_limit, *_ in ratios)
        assert any(sample.least < 0.005 for sample in beyond)
        assert any(sample.sign == -1 for sample in beyond)


def test_ratio_limits_equal_the_poissons_ratios_in_the_guide():
    assert bulk_over_shear(0.48) < MAX_BULK_OVER_SHEAR_CURVED_CELLS < bulk_over_shear(0.481)
    assert bulk_over_shear(0.495) < MAX_BULK_OVER_SHEAR_STRAIGHT_CELLS < bulk_over_shear(0.4951)
    assert bulk_over_shear(0.5) == np.inf


def make_skewed_brick_mesh():
    mesh = create_box(MPI.COMM_SELF, [(0, 0, 0), (1, 1, 1)], [2, 2, 2], CellType.hexahedron)
    mesh.geometry.x[:, 0] += 0.3 * mesh.geometry.x[:, 2]
    return mesh


# mesh, Poisson's ratio without a warning, and ratio with a warning, or None
MESHES_WITH_SAFE_AND_WARNED_POISSONS_RATIOS = {
    "straight triangles": (lambda: make_distorted_mesh("triangle", 2, 0.2, 0), 0.49999, None),
    "straight, of degree 2": (
        lambda: curved_mesh(make_distorted_mesh("triangle", 2, 0.2, 0), lambda x: x),
        0.49999,
        None,
    ),
    "straight quadrilaterals": (
        lambda: make_distorted_mesh("quadrilateral", 2, 0.2, 0),
        0.49999,
        None,
    ),
    "parallelepipeds": (make_skewed_brick_mesh, 0.49999, None),
    "curved triangles": (lambda: make_distorted_mesh("triangle", 2, 0.05, 0, True), 0.48, 0.482),
    "tetrahedra": (lambda: make_distorted_mesh("tetrahedron", 2, 0.0, 0), 0.495, 0.496),
    "hexahedra": (lambda: make_distorted_mesh("hexahedron", 2, 0.1, 0), 0.495, 0.496),
}


@pytest.mark.parametrize("name", MESHES_WITH_SAFE_AND_WARNED_POISSONS_RATIOS)
def test_a_body_warns_of_a_singular_stiffness_where_one_may_be(name, caplog):
    make, without, beyond = MESHES_WITH_SAFE_AND_WARNED_POISSONS_RATIOS[name]
    mesh = make()
    state = "plane strain" if mesh.geometry.dim == 2 else "solid"

    def is_warning_logged_for_body(spaces, nu, state=state):
        caplog.clear()
        with caplog.at_level(logging.WARNING, "pw_elements"):
            Body(spaces, Material(1.0, nu), state)
        return SINGULAR_STIFFNESS_WARNING in caplog.text

    assert not is_warning_logged_for_body(Spaces.petrov_galerkin(mesh), without)
    if beyond is not None:
        assert is_warning_logged_for_body(Spaces.petrov_galerkin(mesh), beyond)
        assert "Spaces.hybrid(mesh)" in caplog.text
        assert not is_warning_logged_for_body(Spaces.galerkin(mesh), beyond)
        assert not is_warning_logged_for_body(Spaces.hybrid(mesh), beyond)
    if mesh.geometry.dim == 2:
        assert not is_warning_logged_for_body(Spaces.petrov_galerkin(mesh), 0.4999, "plane stress")


def test_straight_and_parallel_cells_are_recognised():
    for cell in CELLS_PER_SIDE_BY_CELL:
        straight = make_distorted_mesh(cell, 2, 0.2, 0)
        assert has_only_straight_cells(straight)
        assert has_only_straight_cells(curved_mesh(straight, lambda x: x))
        assert not has_only_straight_cells(
            make_distorted_mesh(cell, 2, 1e-3, 0, moves_mid_nodes=True)
        )
    assert has_only_parallelepiped_cells(make_skewed_brick_mesh())
    assert has_only_parallelepiped_cells(curved_mesh(make_skewed_brick_mesh(), lambda x: x))
    assert not has_only_parallelepiped_cells(make_distorted_mesh("hexahedron", 2, 0.01, 0))


@pytest.mark.parametrize("cell", CELLS_PER_SIDE_BY_CELL)
@pytest.mark.parametrize("nu", [-0.2, 0.3, 0.4999])
def test_bulk_over_shear_of_an_elastic_tangent_is_that_of_its_moduli(cell, nu):
    mesh = make_distorted_mesh(cell, 2, 0.2, 0)
    spaces = Spaces.petrov_galerkin(mesh)
    u, v = fem.Function(spaces.trial), ufl.TestFunction(spaces.test)
    body = Body(spaces, Material(3e9, nu), "plane strain" if mesh.geometry.dim == 2 else "solid")
    residual = ufl.inner(body.stress(u), body.strain(v)) * ufl.dx - v[0] * ufl.dx
    ratios = TangentBulkShearRatio(residual, u).compute_in_cells()
    assert len(ratios) == mesh.topology.index_map(mesh.topology.dim).size_local
    assert ratios == pytest.approx(2 * (1 + nu) / (3 * (1 - 2 * nu)), rel=1e-9)


def neo_hookean_energy(F, shear_modulus, lame_parameter):
    """Return the energy per volume whose derivative is `neo_hookean_piola_stress`."""
    log = np.log(np.linalg.det(F))
    return shear_modulus * (np.sum(F**2) / 2 - log) + lame_parameter * log**2 / 2


def bulk_over_shear_by_differences(F, shear_modulus, lame_parameter, step=1e-4):
    """Return the bulk stiffness divided by the shear stiffness, from differences of the energy.

    Second differences by t are taken along exp(t H) F, with the deformation gradient F and a
    symmetric matrix H.
    """
    dim = len(F)
    rng = np.random.default_rng(0)
    moduli = []
    for _ in range(2 if dim == 2 else 5):
        H = rng.normal(size=(dim, dim))
        moduli.append((H + H.T) / 2 - np.trace(H) / dim * np.eye(dim))
    # an orthonormal basis of the symmetric matrices without trace
    basis = np.linalg.svd([H.ravel() for H in moduli], full_matrices=False)[2]
    basis = [np.eye(dim) / np.sqrt(dim), *basis.reshape(-1, dim, dim)]
    values = []
    for H in basis:
        energies = [
            neo_hookean_energy(scipy.linalg.expm(t * H) @ F, shear_modulus, lame_parameter)
            for t in (-step, 0.0, step)
        ]
        values.append((energies[0] - 2 * energies[1] + energies[2]) / step**2)
    return 2 * (values[0] - np.mean(values[1:])) / (dim * np.mean(values[1:])) + 2 / 3


@pytest.mark.parametrize("seed", range(4))
def test_bulk_over_shear_of_a_deformed_tangent_is_that_of_the_energy(seed):
    rng = np.random.default_rng(seed)
    dim, lame = 2 + seed % 2, 10 ** rng.uniform(0, 3)
    mesh = make_distorted_mesh("triangle" if dim == 2 else "tetrahedron", 1, 0.0, 0)
    spaces = Spaces.petrov_galerkin(mesh)
    u, residual = make_finite_strain_unknown_and_residual(
        spaces, lambda F: neo_hookean_piola_stress(F, 1.0, lame)
    )
    F = np.eye(dim) + rng.uniform(-0.3, 0.3, (dim, dim))
    u.interpolate(lambda x: (F - np.eye(dim)) @ x[:dim] + 2.0)
    ratios = TangentBulkShearRatio(residual, u).compute_in_cells()
    assert ratios == pytest.approx(bulk_over_shear_by_differences(F, 1.0, lame), rel=1e-5)
    # the same ratio after a rotation
    R = scipy.linalg.expm(np.array([[0, 1, 2], [-1, 0, 3], [-2, -3, 0]])[:dim, :dim] * 0.7)
    u.interpolate(lambda x: (R @ F - np.eye(dim)) @ x[:dim])
    assert TangentBulkShearRatio(residual, u).compute_in_cells() == pytest.approx(ratios, rel=1e-9)


def test_pressure_adds_nothing_to_the_shear_stiffness():
    """Pressure adds nothing to the shear stiffness.

    Even a pressure of many shear moduli does no work in shear, which preserves volume. The ratio of
    the stiffnesses has to agree with differences of the energy.
    """
    mesh = triangles(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (2, 2))
    spaces = Spaces.petrov_galerkin(mesh)
    for lame, scale in ((100.0, 0.9), (100.0, 1.05), (5.0, 0.5)):
        u, residual = make_finite_strain_unknown_and_residual(
            spaces, lambda F, lame=lame: neo_hookean_piola_stress(F, 1.0, lame)
        )
        u.interpolate(lambda x, scale=scale: (scale - 1) * x[:2])
        expected = bulk_over_shear_by_differences(scale * np.eye(2), 1.0, lame)
        ratios = TangentBulkShearRatio(residual, u).compute_in_cells()
        assert ratios == pytest.approx(expected, rel=1e-5)


def test_a_tangent_whose_ratio_cannot_be_measured_is_reported_and_faults_are_raised(
    caplog, monkeypatch
):
    """A form that cannot be compiled costs a warning; other errors are faults of the library."""
    mesh = create_box(MPI.COMM_SELF, [(0, 0, 0), (1, 1, 1)], [1, 1, 1], CellType.tetrahedron)
    u, residual = make_finite_strain_unknown_and_residual(
        Spaces.petrov_galerkin(mesh), lambda F: neo_hookean_piola_stress(F, 1.0, 1.0)
    )

    def fail_with(error):
        def fail(*_):
            raise error

        monkeypatch.setattr(incompressibility, "TangentBulkShearRatio", fail)

    fail_with(ValueError("the form cannot be compiled"))
    with caplog.at_level(logging.WARNING, "pw_elements"):
        monitor = TangentBulkShearMonitor(residual, u)
    assert "is not measured" in caplog.text
    assert not monitor.is_beyond_limit()
    fail_with(TypeError("a fault of the library"))
    with pytest.raises(TypeError, match="a fault of the library"):
        TangentBulkShearMonitor(residual, u)
