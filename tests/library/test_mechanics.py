from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx.mesh import (
    CellType,
    compute_midpoints,
    create_box,
    create_rectangle,
    meshtags,
)

from pw_elements import Body, Material, assemble_matrix, assemble_scalar, solve
from pw_elements.meshes import move_nodes, triangles
from study.meshes.distortion import distort_unit_domain_smoothly
from tests.contact.cases import GALERKIN, PETROV_GALERKIN, ElasticBody, on_plane

ELASTIC_MATERIAL = Material(10.0, 0.3, density=2.0)


def make_triangle_square(cells_per_side=3):
    return triangles(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (cells_per_side, cells_per_side))


def make_quadrilateral_square():
    return create_rectangle(MPI.COMM_SELF, [(0, 0), (1, 1)], [3, 3], CellType.quadrilateral)


def make_cube(cell_type):
    return create_box(MPI.COMM_SELF, [(0, 0, 0), (1, 1, 1)], [2, 2, 2], cell_type)


@pytest.mark.parametrize(
    ("field", "energies"),
    [
        (lambda x: [x[0], 0 * x[0]], (5.0, -5.0)),  # stretch: form G gives S, J gives S - 2 S
        (lambda x: [-x[1], x[0]], (7.0, 7.0)),  # a rotation, which strains nothing
    ],
)
def test_geometric_stiffness_forms_differ_by_twice_the_stress_times_strains(field, energies):
    body = ElasticBody(make_triangle_square(), GALERKIN, "plane stress", 10.0)
    displacement = fem.Function(body.space)
    displacement.interpolate(lambda x: np.array(field(x)))
    u, stress = displacement.x.petsc_vec, ufl.as_tensor([[5.0, 0.0], [0.0, 2.0]])
    for form, energy in zip(("G", "J"), energies, strict=True):
        K_sigma = assemble_matrix(body.body.geometric_stiffness(stress, form))
        assert u.dot(K_sigma * u) == pytest.approx(energy)
    strained = u.dot(body.K * u)
    assert strained > 1.0 if energies[1] < 0 else abs(strained) < 1e-12


@pytest.mark.parametrize("method", [GALERKIN, PETROV_GALERKIN])
@pytest.mark.parametrize(
    ("make_mesh", "state"),
    [
        (make_triangle_square, "plane strain"),
        (make_quadrilateral_square, "plane strain"),
        (lambda: make_cube(CellType.tetrahedron), "solid"),
        (lambda: make_cube(CellType.hexahedron), "solid"),
    ],
    ids=["triangles", "parallelograms", "tetrahedra", "parallelepipeds"],
)
def test_quadrature_is_exact_with_no_more_points_than_needed(make_mesh, state, method):
    """Quadrature of stiffness and mass is exact, with no more points than necessary.

    If the degree is increased by four, the matrices do not change. With fewer points, they do. The
    cells are oblique.
    """
    mesh = make_mesh()
    mesh.geometry.x[:, 0] += 0.3 * mesh.geometry.x[:, 1] + 0.2 * mesh.geometry.x[:, 2]
    body = Body(method(mesh), ELASTIC_MATERIAL, state)
    boxes = mesh.topology.cell_name() in ("quadrilateral", "hexahedron")
    for form in (Body.stiffness, Body.mass):
        (integral,) = form(body).integrals()
        degree = integral.metadata()["quadrature_degree"]
        ours, crude, fine = (
            assemble_matrix(form(replace(body, quadrature_degree=d)))[:, :]
            for d in (None, degree - (2 if boxes else 1), degree + 4)
        )
        size = np.abs(fine).max()
        assert np.abs(ours - fine).max() < 1e-13 * size
        # the rules of degree 0 and 1 are the same point
        assert degree == 1 or np.abs(crude - fine).max() > 1e-4 * size


def test_quadrature_degree_is_higher_on_cells_that_are_no_parallelograms():
    meshes = (
        make_quadrilateral_square(),
        move_nodes(make_quadrilateral_square(), distort_unit_domain_smoothly),
    )
    bodies = [Body(PETROV_GALERKIN(mesh), ELASTIC_MATERIAL, "plane strain") for mesh in meshes]
    degrees = [b.stiffness().integrals()[0].metadata()["quadrature_degree"] for b in bodies]
    assert degrees == [3, 5]


def tag_halves(mesh, left_tag=3, right_tag=7):
    dim = mesh.topology.dim
    cells = np.arange(mesh.topology.index_map(dim).size_local, dtype=np.int32)
    right = compute_midpoints(mesh, dim, cells)[:, 0] > 0.5
    return meshtags(mesh, dim, cells, np.where(right, right_tag, left_tag).astype(np.int32))


def test_each_cell_tag_has_its_own_material():
    mesh = make_triangle_square(4)
    parts = {3: Material(2.0, 0.0, 1.0), 7: Material(5.0, 0.0, 4.0)}
    material = Material.by_tag(mesh, tag_halves(mesh), parts)
    bar = ElasticBody(mesh, GALERKIN, "plane stress", material=material)
    supports = bar.make_supports((0, on_plane(0, 0.0)), (1, on_plane(1, 0.0)))
    displacements = solve(bar.K, bar.traction_load((1.0, 0.0), on_plane(0, 1.0)), supports)
    x = bar.x[:, 0]
    exact = np.minimum(x, 0.5) / 2.0 + np.maximum(x - 0.5, 0.0) / 5.0
    assert displacements.array_r.reshape(-1, 2)[:, 0] == pytest.approx(exact, abs=1e-13)
    ones = bar.M.createVecRight()
    ones.set(1.0)
    assert ones.dot(bar.M * ones) == pytest.approx(2 * (0.5 * 1.0 + 0.5 * 4.0), rel=1e-13)
    plain = Body(bar.body.spaces, ELASTIC_MATERIAL, "plane stress")
    rules = [[part.metadata() for part in b.stiffness().integrals()] for b in (bar.body, plain)]
    assert rules[0] == rules[1]


def test_materials_without_matching_tags_are_refused():
    mesh = make_triangle_square(4)
    tags, soft, stiff = tag_halves(mesh), Material(1.0), Material(9.0)

    def assert_refused(materials, match, tags=tags, error=ValueError, mesh=mesh):
        with pytest.raises(error, match=match):
            Material.by_tag(mesh, tags, materials)

    assert_refused({3: soft}, r"no material is given for the tags \[7\], which cells have")
    assert_refused({3: soft, 7: stiff, 4: soft}, r"given for the tags \[4\], which no cell has")
    assert_refused({}, r"no material is given for the tags \[3, 7\]")
    words = "the mapping of tags is of the type list: give {tag: Material"
    assert_refused([soft, stiff], words, error=TypeError)
    assert_refused({3: soft, 7: 2.0}, "the material of tag 7 is 2.0: Material", error=TypeError)
    varying = Material(fem.Function(fem.functionspace(mesh, ("DG", 0)), name="E") + 1.0)
    assert_refused({3: soft, 7: varying}, "youngs_modulus of the material of tag 7")
    assert_refused({3: soft}, "the cells. tags is of the type ndarray", np.ones(32), TypeError)
    assert_refused(
        {3: soft, 7: stiff}, "tags are those of another mesh", tag_halves(make_triangle_square(4))
    )
    facets = meshtags(mesh, 1, np.arange(4, dtype=np.int32), np.full(4, 3, dtype=np.int32))
    assert_refused({3: soft}, "tags are those of 1-D entities: cells are 2-D", facets)
    few = meshtags(mesh, 2, np.arange(4, dtype=np.int32), np.full(4, 3, dtype=np.int32))
    assert_refused({3: soft}, "28 of 32 cells have no tag, so no material", few)


def test_plane_stress_allows_incompressible_materials():
    spaces = PETROV_GALERKIN(make_triangle_square())
    K = assemble_matrix(Body(spaces, Material(2.0, 0.5), "plane stress").stiffness())
    near = Body(spaces, Material(2.0, 0.5 - 1e-9), "plane stress")
    assert (K - assemble_matrix(near.stiffness())).norm() < 1e-8 * K.norm()


@pytest.mark.parametrize(
    ("state", "strain", "expected"),
    [
        ("plane stress", (1.0, -0.3), 10.0),  # a bar in tension
        ("plane strain", (1.0, 0.0), 10.0 / 1.3),  # uniaxial strain, stiffness E / (1 + nu)
        ("solid", (1.0, 0.0), 10.0 / 1.3),
        ("axisymmetric", (0.0, 1.0), 10.0 / 1.3),
    ],
)
def test_von_mises_stress_of_known_strains_is_exact(state, strain, expected):
    mesh = make_cube(CellType.tetrahedron) if state == "solid" else make_triangle_square()
    body = Body(GALERKIN(mesh), ELASTIC_MATERIAL, state)
    u = fem.Function(body.spaces.trial)
    u.interpolate(lambda x: np.array([strain[0] * x[0], strain[1] * x[1], 0 * x[2]])[: len(u)])
    assert assemble_scalar(body.von_mises(u) * ufl.dx) == pytest.approx(expected)
