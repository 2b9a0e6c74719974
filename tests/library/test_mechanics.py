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
    exterior_facet_indices,
    meshtags,
)

from pw_elements import (
    Body,
    Material,
    Reduction,
    Spaces,
    assemble_matrix,
    assemble_scalar,
    assemble_vector,
    boundary_measure,
    prescribe,
    solve,
)
from pw_elements.elasticity import StressState, nodal_load
from pw_elements.meshes import curved, mapped, triangles
from study.verification.t_identity import distorted

MATERIAL = Material(10.0, 0.3, density=2.0)


def square(n=3):
    return triangles(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (n, n))


def quadrilaterals():
    return create_rectangle(MPI.COMM_SELF, [(0, 0), (1, 1)], [3, 3], CellType.quadrilateral)


def cube(cell):
    return create_box(MPI.COMM_SELF, [(0, 0, 0), (1, 1, 1)], [2, 2, 2], cell)


@pytest.mark.parametrize("method", [Spaces.galerkin, Spaces.petrov_galerkin])
def test_constant_strain_is_met_by_curved_cells(method):
    # patch test: boundary displacements of a linear field, which must come back inside
    spaces = method(curved(square(), distorted))
    body = Body(spaces, MATERIAL, "plane stress")
    exact = fem.Function(spaces.trial)
    exact.interpolate(lambda x: np.array([[1.0, 0.4], [-0.3, 0.7]]) @ x[:2])
    spaces.mesh.topology.create_connectivity(1, 2)
    rim = fem.locate_dofs_topological(spaces.trial, 1, exterior_facet_indices(spaces.mesh.topology))
    f = assemble_vector(body.body_load((0.0, 0.0)))
    held = Reduction.dirichlet(spaces.trial, [fem.dirichletbc(exact, rim)])
    a = solve(assemble_matrix(body.stiffness()), f, held)
    assert np.abs(a.array - exact.x.array).max() < 1e-12


@pytest.mark.parametrize("method", [Spaces.galerkin, Spaces.petrov_galerkin])
def test_lame_tube_in_axisymmetry(method):
    # u_r = A r + B / r under internal pressure, plane strain in z: third order in the nodes
    coarse, fine = (_lame_error(method, n) for n in (8, 16))
    assert fine < 1e-4
    assert coarse / fine > 2**2.7


def _lame_error(method, n):
    inner, outer, pressure = 1.0, 2.0, 1.0
    mesh = create_rectangle(MPI.COMM_SELF, [(inner, 0.0), (outer, 0.5)], [n, n // 2])
    body = Body(method(mesh), MATERIAL, StressState.AXISYMMETRIC)
    U = body.spaces.trial
    K = assemble_matrix(body.stiffness())
    bore = boundary_measure(mesh, lambda x: np.isclose(x[0], inner))
    f = assemble_vector(body.surface_load((pressure, 0.0), bore))
    assert f.sum() == pytest.approx(2 * np.pi * inner * 0.5 * pressure, rel=1e-13)
    ends = [prescribe(U, 1, lambda x, z=z: np.isclose(x[1], z)) for z in (0.0, 0.5)]
    a = solve(K, f, Reduction.dirichlet(U, ends)).array.reshape(-1, 2)
    E, nu = MATERIAL.youngs_modulus, MATERIAL.poissons_ratio
    r = U.tabulate_dof_coordinates()[:, 0]
    factor = (1 + nu) * pressure * inner**2 / E / (outer**2 - inner**2)
    exact = factor * ((1 - 2 * nu) * r + outer**2 / r)
    return np.hypot(a[:, 0] - exact, a[:, 1]).max() / exact.max()


def test_mass_and_loads_add_up():
    mesh = mapped(square(), distorted)
    for method in (Spaces.galerkin, Spaces.petrov_galerkin):
        body = Body(method(mesh), MATERIAL, StressState.PLANE_STRESS, thickness=0.5)
        area = fem.assemble_scalar(fem.form(1.0 * ufl.dx(domain=mesh)))
        M = assemble_matrix(body.mass())
        ones = M.createVecRight()
        ones.set(1.0)
        assert (M * ones).sum() == pytest.approx(2 * 2.0 * 0.5 * area, rel=1e-13)
        f = assemble_vector(body.body_load((0.0, -3.0)))
        assert f.sum() == pytest.approx(-3 * 0.5 * area, rel=1e-13)
        P = nodal_load(
            body.spaces.trial, lambda x: np.isclose(x[0], 0) & (x[1] == x[1].max()), (2.0, 1.0)
        )
        assert P.sum() == 3.0


@pytest.mark.parametrize(
    ("field", "energies"),
    [
        (lambda x: [x[0], 0 * x[0]], (5.0, -5.0)),  # a stretch: G gives S, J gives S - 2 S
        (lambda x: [-x[1], x[0]], (7.0, 7.0)),  # a rotation, which strains nothing
    ],
)
def test_geometric_stiffness_forms_differ_by_twice_the_stress_times_strains(field, energies):
    body = Body(Spaces.galerkin(square()), MATERIAL, "plane stress")
    moved = fem.Function(body.spaces.trial)
    moved.interpolate(lambda x: np.array(field(x)))
    u = moved.x.petsc_vec
    stress = ufl.as_tensor([[5.0, 0.0], [0.0, 2.0]])
    for form, energy in zip(("G", "J"), energies, strict=True):
        assert u.dot(assemble_matrix(body.initial_stress(stress, form)) * u) == pytest.approx(
            energy
        )
    strained = u.dot(assemble_matrix(body.stiffness()) * u)
    assert strained > 1.0 if energies[1] < 0 else abs(strained) < 1e-12


@pytest.mark.parametrize("method", [Spaces.galerkin, Spaces.petrov_galerkin])
@pytest.mark.parametrize(
    ("make_mesh", "state"),
    [
        (square, StressState.PLANE_STRAIN),
        (quadrilaterals, StressState.PLANE_STRAIN),
        (lambda: cube(CellType.tetrahedron), StressState.SOLID),
        (lambda: cube(CellType.hexahedron), StressState.SOLID),
    ],
    ids=["triangles", "parallelograms", "tetrahedra", "parallelepipeds"],
)
def test_quadrature_is_exact_and_no_more_than_that(make_mesh, state, method):
    """Another four degrees change nothing, a rule with fewer points does; so in oblique cells."""
    mesh = make_mesh()
    mesh.geometry.x[:, 0] += 0.3 * mesh.geometry.x[:, 1] + 0.2 * mesh.geometry.x[:, 2]
    body = Body(method(mesh), MATERIAL, state)
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
        # rules of degree 0 and 1 have one point both
        assert degree == 1 or np.abs(crude - fine).max() > 1e-4 * size


def test_cells_that_are_no_parallelograms_keep_three_points_a_direction():
    body = Body(Spaces.petrov_galerkin(quadrilaterals()), MATERIAL, "plane strain")
    askew = Body(
        Spaces.petrov_galerkin(mapped(quadrilaterals(), distorted)), MATERIAL, "plane strain"
    )
    degrees = [b.stiffness().integrals()[0].metadata()["quadrature_degree"] for b in (body, askew)]
    assert degrees == [3, 5]


def halves(mesh, first=3, second=7):
    """Tags of the cells on both sides of x = 1/2."""
    dim = mesh.topology.dim
    cells = np.arange(mesh.topology.index_map(dim).size_local, dtype=np.int32)
    right = compute_midpoints(mesh, dim, cells)[:, 0] > 0.5
    return meshtags(mesh, dim, cells, np.where(right, second, first).astype(np.int32))


def test_a_material_per_tag():
    """Two halves of a bar in plane stress, of given mass: stretches, and what a formula gives."""
    mesh = square(4)
    parts = {3: Material(2.0, 0.0, 1.0), 7: Material(5.0, 0.0, 4.0)}
    body = Body(Spaces.galerkin(mesh), Material.by_tag(mesh, halves(mesh), parts), "plane stress")
    U = body.spaces.trial
    K = assemble_matrix(body.stiffness())
    right = boundary_measure(mesh, lambda x: np.isclose(x[0], 1.0))
    held = Reduction.dirichlet(
        U, [prescribe(U, i, lambda x, i=i: np.isclose(x[i], 0.0)) for i in range(2)]
    )
    moved = solve(K, assemble_vector(body.surface_load((1.0, 0.0), right)), held)
    x = U.tabulate_dof_coordinates()[:, 0]
    exact = np.minimum(x, 0.5) / 2.0 + np.maximum(x - 0.5, 0.0) / 5.0
    assert moved.array_r.reshape(-1, 2)[:, 0] == pytest.approx(exact, abs=1e-13)
    assert assemble_matrix(body.mass()).norm() > 0
    ones = K.createVecRight()
    ones.set(1.0)
    total = ones.dot(assemble_matrix(body.mass()) * ones)
    assert total == pytest.approx(2 * (0.5 * 1.0 + 0.5 * 4.0), rel=1e-13)
    plain = Body(body.spaces, MATERIAL, "plane stress")
    rules = [[part.metadata() for part in one.stiffness().integrals()] for one in (body, plain)]
    assert rules[0] == rules[1]


def test_materials_that_do_not_go_with_tags_are_named():
    mesh = square(4)
    tags, soft, stiff = halves(mesh), Material(1.0), Material(9.0)

    def refused(materials, match, tags=tags, error=ValueError, mesh=mesh):
        with pytest.raises(error, match=match):
            Material.by_tag(mesh, tags, materials)

    refused({3: soft}, r"no material is given for the tags \[7\], which cells have")
    refused({3: soft, 7: stiff, 4: soft}, r"given for the tags \[4\], which no cell has")
    refused({}, r"no material is given for the tags \[3, 7\]")
    refused(
        [soft, stiff],
        "the mapping of tags is of the type list: give {tag: Material",
        error=TypeError,
    )
    refused({3: soft, 7: 2.0}, "the material of tag 7 is 2.0: Material", error=TypeError)
    varying = Material(fem.Function(fem.functionspace(mesh, ("DG", 0)), name="E") + 1.0)
    refused({3: soft, 7: varying}, "youngs_modulus of the material of tag 7")
    refused({3: soft}, "the cells. tags is of the type ndarray", np.ones(32), TypeError)
    refused({3: soft, 7: stiff}, "tags are those of another mesh", halves(square(4)))
    facets = meshtags(mesh, 1, np.arange(4, dtype=np.int32), np.full(4, 3, dtype=np.int32))
    refused({3: soft}, "tags are those of 1-D entities: cells are 2-D", facets)
    few = meshtags(mesh, 2, np.arange(4, dtype=np.int32), np.full(4, 3, dtype=np.int32))
    refused({3: soft}, "28 of 32 cells have no tag, so no material", few)


def test_incompressible_in_plane_stress_only():
    spaces, rubber = Spaces.petrov_galerkin(square()), Material(2.0, 0.5)
    K = assemble_matrix(Body(spaces, rubber, StressState.PLANE_STRESS).stiffness())
    near = Body(spaces, Material(2.0, 0.5 - 1e-9), StressState.PLANE_STRESS)
    assert (K - assemble_matrix(near.stiffness())).norm() < 1e-8 * K.norm()
    with pytest.raises(ValueError, match="in plane stress only"):
        Body(spaces, rubber, StressState.PLANE_STRAIN)


@pytest.mark.parametrize(
    ("state", "strain", "expected"),
    [
        ("plane stress", (1.0, -0.3), 10.0),  # a bar that is pulled
        ("plane strain", (1.0, 0.0), 10.0 / 1.3),  # uniaxial strain: E / (1 + nu)
        ("solid", (1.0, 0.0), 10.0 / 1.3),
        ("axisymmetric", (0.0, 1.0), 10.0 / 1.3),
    ],
)
def test_equivalent_stress_of_known_strains(state, strain, expected):
    mesh = (
        create_box(MPI.COMM_SELF, [[0, 0, 0], [1, 1, 1]], [1, 1, 1])
        if state == "solid"
        else square()
    )
    body = Body(Spaces.galerkin(mesh), MATERIAL, state)
    u = fem.Function(body.spaces.trial)
    u.interpolate(lambda x: np.array([strain[0] * x[0], strain[1] * x[1], 0 * x[2]])[: len(u)])
    assert assemble_scalar(body.von_mises(u) * ufl.dx) == pytest.approx(expected)


def test_equivalent_stress_of_a_hybrid_body_has_the_pressure():
    mesh = square()
    x = ufl.SpatialCoordinate(mesh)
    u = ufl.as_vector([x[0] * x[1], 0.3 * x[1] ** 2])
    alone = Body(Spaces.galerkin(mesh), MATERIAL, "plane strain")
    hybrid = Body(Spaces.hybrid(mesh), MATERIAL, "plane strain")
    lame = 10.0 * 0.3 / (1.3 * 0.4)
    both = ufl.as_vector([*u, -lame * ufl.div(u)])
    difference = hybrid.von_mises(both) - alone.von_mises(u)
    assert assemble_scalar(difference**2 * ufl.dx) < 1e-20
