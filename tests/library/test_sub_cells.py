"""Tangents computed sub-cell by sub-cell equal those of FFCx, and fall back to FFCx otherwise."""

import logging

from mpi4py import MPI
from petsc4py import PETSc

import basix.ufl
import cffi
import dolfinx.jit
import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx.fem.petsc import assemble_matrix, create_matrix
from dolfinx.mesh import CellType, compute_midpoints, create_box, create_unit_square, meshtags
from ufl.algorithms import expand_derivatives

from pw_elements import PetrovGalerkinProblem, Spaces
from pw_elements.meshes import curved_mesh
from pw_elements.spaces import (
    add_estimated_quadrature_degrees,
    add_sub_cell_quadrature_rules,
    compile_form,
    compile_tangent,
    sub_cell_kernel,
    sub_cells,
)
from pw_elements.spaces.bilinear_coefficients import (
    NotSeparableError,
    derive_bilinear_coefficients,
)
from pw_elements.spaces.elements import tetrahedron_twelve_cell_quadrature
from pw_elements.spaces.sub_cell_kernel import SubCellKernel
from tests.contact.cases import neo_hookean_piola_stress
from tests.parallel import assert_same_on_processes

# rules with 4, 5 and 31 points in each sub-cell
DX_2, DX_3, DX_7 = (ufl.dx(metadata={"quadrature_degree": degree}) for degree in (2, 3, 7))


def make_distorted_mesh(comm=MPI.COMM_SELF, n=2):
    mesh = create_box(comm, [(0, 0, 0), (1.0, 1.2, 0.9)], [n, n, n], CellType.tetrahedron)
    x = mesh.geometry.x
    x += 0.05 * np.sin(7 * x @ np.array([[1, 2, 3], [2, -1, 1], [1, 1, -2]]))
    return mesh


def make_unknown_and_weights(mesh, make_spaces=Spaces.petrov_galerkin):
    """Return an unknown function with large strains, and a test function."""
    spaces = make_spaces(mesh)
    u = fem.Function(spaces.trial)
    fields = [u.sub(0), u.sub(1)] if spaces.is_hybrid else [u]
    fields[0].interpolate(lambda x: 0.03 * np.sin([5 * x[0] * x[1], 4 * x[1] + x[2], 7 * x[2]]))
    for pressure in fields[1:]:
        pressure.interpolate(lambda x: np.cos(3 * x[0] + x[1] * x[2]))
    return u, ufl.TestFunction(spaces.test)


def neo_hookean(u):
    return neo_hookean_piola_stress(ufl.Identity(3) + ufl.grad(u), 2.0, 3.0)


def rubber_of_mooney_and_rivlin(u):
    """Return the first Piola-Kirchhoff stress as UFL's derivative of an energy."""
    F = ufl.variable(ufl.Identity(3) + ufl.grad(u))
    C, J = F.T * F, ufl.det(F)
    first, second = ufl.tr(C), (ufl.tr(C) ** 2 - ufl.tr(C * C)) / 2
    energy = J ** (-2 / 3) * first + 0.3 * J ** (-4 / 3) * second + 5 * (J - 1) ** 2
    return ufl.diff(energy, F)


def make_rubber_residual(mesh):
    u, v = make_unknown_and_weights(mesh)
    return u, ufl.inner(neo_hookean(u), ufl.grad(v)) * DX_2


def make_mooney_residual(mesh):
    u, v = make_unknown_and_weights(mesh)
    return u, ufl.inner(rubber_of_mooney_and_rivlin(u), ufl.grad(v)) * DX_3


def make_residual_with_following_load(mesh):
    """Return a body whose body force depends on its position, and which has a term of inertia."""
    (u, v), b = make_unknown_and_weights(mesh), fem.Constant(mesh, (1.0, -2.0, 0.5))
    density = fem.Constant(mesh, 3.0)
    x = ufl.SpatialCoordinate(mesh) + u
    force = ufl.det(ufl.Identity(3) + ufl.grad(u)) * ufl.sin(x[0]) * b - density * x
    return u, (ufl.inner(neo_hookean(u), ufl.grad(v)) - ufl.inner(force, v)) * DX_7


def make_hybrid_residual(mesh):
    w, weights = make_unknown_and_weights(mesh, Spaces.hybrid)
    (u, p), (v, q) = ufl.split(w), ufl.split(weights)
    F, swelling = ufl.Identity(3) + ufl.grad(u), fem.Constant(mesh, 0.1)
    J, inverse = ufl.det(F), ufl.inv(F).T
    density = ufl.inner(F - (1 + p * J) * inverse, ufl.grad(v)) - q * (J - 1 + 0.01 * p)
    return w, (density - swelling * p * u[0] * v[1] - ufl.inner(p * ufl.grad(p), v)) * DX_2


def make_residual_of_several_integrals(mesh):
    """Return a body of two materials with integrals of several degrees, and a pressure on it."""
    u, v = make_unknown_and_weights(mesh)
    n_cells = mesh.topology.index_map(3).size_local + mesh.topology.index_map(3).num_ghosts
    cells = np.arange(n_cells, dtype=np.int32)
    height = compute_midpoints(mesh, 3, cells)[:, 2]
    tags = meshtags(mesh, 3, cells, np.digitize(height, [0.3, 0.5]).astype(np.int32))
    dx = ufl.Measure("dx", domain=mesh, subdomain_data=tags)
    stress = ufl.inner(neo_hookean(u), ufl.grad(v))
    modulus = fem.Constant(mesh, 2.5)
    pressure, other = fem.Constant(mesh, 0.7), fem.Function(u.function_space)
    other.interpolate(lambda x: np.cos([x[0], 2 * x[1], x[2]]))
    F = ufl.Identity(3) + ufl.grad(u)
    follower = ufl.det(F) * ufl.inv(F).T * ufl.FacetNormal(mesh)
    return u, (
        stress * dx((0, 1), degree=2)
        + modulus * stress * dx(2, degree=3)
        + ufl.inner(other, u) * v[0] * dx(degree=2)
        + pressure * ufl.inner(follower, v) * ufl.ds(degree=3)
    )


def make_residual_with_history(mesh):
    """Return a body whose stress depends on a tensor that is stored at the quadrature points."""
    u, v = make_unknown_and_weights(mesh)
    points, weights = tetrahedron_twelve_cell_quadrature(2)
    element = basix.ufl.quadrature_element("tetrahedron", (3, 3), points=points, weights=weights)
    history = fem.Function(fem.functionspace(mesh, element))
    history.x.array[:] = 0.1 * np.cos(np.arange(len(history.x.array)))
    strain = ufl.sym(ufl.grad(u)) - history
    size = ufl.sqrt(ufl.inner(strain, strain))
    stress = strain * ufl.conditional(ufl.lt(size, 0.1), 1.0, 0.1 / size)
    metadata = {
        "quadrature_rule": "custom",
        "quadrature_points": tuple(map(tuple, points)),
        "quadrature_weights": tuple(weights),
    }
    return u, ufl.inner(stress, ufl.grad(v)) * ufl.dx(metadata=metadata)


def make_scalar_residual(mesh):
    spaces = Spaces.petrov_galerkin(mesh, 0)
    u, v = fem.Function(spaces.trial), ufl.TestFunction(spaces.test)
    u.interpolate(lambda x: np.sin(4 * x[0] + x[1] * x[2]))
    return u, ((1 + u**2) * ufl.inner(ufl.grad(u), ufl.grad(v)) + ufl.exp(u) * v) * DX_3


RESIDUAL_MAKERS = [
    make_rubber_residual,
    make_mooney_residual,
    make_residual_with_following_load,
    make_hybrid_residual,
    make_residual_of_several_integrals,
    make_residual_with_history,
    make_scalar_residual,
]


def derive_tangent(u, residual):
    form = add_estimated_quadrature_degrees(add_sub_cell_quadrature_rules(residual))
    return expand_derivatives(ufl.derivative(form, u, ufl.TrialFunction(u.function_space)))


def assemble_sum(forms):
    matrix = create_matrix(forms[0])
    for form in forms:
        assemble_matrix(matrix, form)
    matrix.assemble()
    return matrix


def relative_difference(A, B):
    difference = A.copy()
    difference.axpy(-1.0, B)
    largest = PETSc.NormType.INFINITY
    return difference.norm(largest) / B.norm(largest)


def count_forms_by_compiler(forms):
    """Return how many forms are computed by sub-cells, and how many FFCx has compiled."""
    by_ffcx = [form.ufcx_form is not None for form in forms]
    return by_ffcx.count(False), by_ffcx.count(True)


@pytest.mark.parametrize("make_residual", RESIDUAL_MAKERS)
def test_tangent_by_sub_cells_equals_the_one_of_ffcx(make_residual):
    tangent = derive_tangent(*make_residual(make_distorted_mesh()))
    forms = compile_tangent(tangent)
    n_on_facets = sum(part.integral_type() != "cell" for part in tangent.integrals())
    assert count_forms_by_compiler(forms) == (1, min(n_on_facets, 1))
    expected = assemble_sum([compile_form(tangent, 2, "a tangent")])
    assert relative_difference(assemble_sum(forms), expected) <= 1e-14


def test_tangent_follows_the_values_of_functions_and_constants():
    mesh = make_distorted_mesh()
    u, residual = make_residual_of_several_integrals(mesh)
    tangent = derive_tangent(u, residual)
    forms, expected = compile_tangent(tangent), [compile_form(tangent, 2, "a tangent")]
    before = assemble_sum(forms)
    u.x.array[:] *= 1.5
    for constant in residual.constants():
        constant.value *= 0.3
    after = assemble_sum(forms)
    assert relative_difference(after, before) > 0.1
    assert relative_difference(after, assemble_sum(expected)) <= 1e-14


def test_two_forms_with_the_same_kernel_keep_their_own_materials():
    mesh = make_distorted_mesh()
    tangents = [
        derive_tangent(*make(mesh)) for make in (make_rubber_residual, make_mooney_residual)
    ]
    compiled = [compile_tangent(tangent) for tangent in tangents]  # before any is assembled
    for tangent, forms in zip(tangents, compiled, strict=True):
        expected = assemble_sum([compile_form(tangent, 2, "a tangent")])
        assert relative_difference(assemble_sum(forms), expected) <= 1e-14


def make_curved_mesh():
    return curved_mesh(make_distorted_mesh(), lambda x: x + 0.02 * np.sin(9 * x[:, [1, 2, 0]]))


def make_triangle_residual():
    spaces = Spaces.petrov_galerkin(create_unit_square(MPI.COMM_SELF, 2, 2))
    u, v = fem.Function(spaces.trial), ufl.TestFunction(spaces.test)
    return u, (1 + ufl.inner(u, u)) * ufl.inner(ufl.grad(u), ufl.grad(v)) * DX_2


def make_residual_of_standard_element(mesh):
    u, v = make_unknown_and_weights(mesh, Spaces.galerkin)
    return u, ufl.inner(neo_hookean(u), ufl.grad(v)) * DX_2


def make_residual_on_some_cells_and_facets(mesh):
    """Return a residual whose integrals over facets have entries beyond the cells' integral."""
    u, residual = make_residual_of_several_integrals(mesh)
    kept = [p for p in residual.integrals() if p.subdomain_id() == 2 or p.integral_type() != "cell"]
    return u, ufl.Form(kept)


@pytest.mark.parametrize(
    "make_residual",
    [
        lambda: make_rubber_residual(make_curved_mesh()),
        make_triangle_residual,
        lambda: make_residual_of_standard_element(make_distorted_mesh()),
        lambda: make_residual_on_some_cells_and_facets(make_distorted_mesh()),
    ],
    ids=["curved cells", "triangles", "standard element", "part of the cells"],
)
def test_ffcx_compiles_tangents_that_do_not_fit(make_residual):
    assert count_forms_by_compiler(compile_tangent(derive_tangent(*make_residual()))) == (0, 1)


def test_ffcx_compiles_tangents_with_too_many_coefficients(monkeypatch):
    monkeypatch.setattr(sub_cell_kernel, "_MAX_COEFFICIENTS", 48 * 81 - 1)
    tangent = derive_tangent(*make_rubber_residual(make_distorted_mesh()))
    assert count_forms_by_compiler(compile_tangent(tangent)) == (0, 1)


def test_straight_cells_by_sub_cells_equal_cells_of_a_quadratic_mesh():
    straight = make_distorted_mesh()
    matrices = []
    for mesh in (straight, curved_mesh(straight, lambda x: x)):
        forms = compile_tangent(derive_tangent(*make_rubber_residual(mesh)))
        x = forms[0].function_spaces[1].tabulate_dof_coordinates()
        matrix = assemble_sum(forms)
        vector = matrix.createVecRight()
        vector.setArray(np.sin(3 * x + x[:, [1, 2, 0]]).ravel())
        forces = (matrix * vector).array.reshape(-1, 3)
        matrices.append(forces[np.lexsort(x.round(9).T)])
    assert np.abs(matrices[0] - matrices[1]).max() <= 1e-13 * np.abs(matrices[1]).max()


def test_second_slopes_of_arguments_are_left_to_ffcx():
    spaces = Spaces.petrov_galerkin(make_distorted_mesh(), 0)
    u, v = ufl.TrialFunction(spaces.trial), ufl.TestFunction(spaces.test)
    with pytest.raises(NotSeparableError):
        derive_bilinear_coefficients(ufl.grad(ufl.grad(u))[0, 0] * v)


def test_coefficients_that_are_zero_for_any_data_are_left_out():
    spaces = Spaces.petrov_galerkin(make_distorted_mesh())
    u, v = ufl.TrialFunction(spaces.trial), ufl.TestFunction(spaces.test)
    terms = derive_bilinear_coefficients(
        expand_derivatives((ufl.div(u) * v[1] + ufl.inner(u, v)) * ufl.dx)
        .integrals()[0]
        .integrand()
    )
    names = {((s.component, s.direction), (t.component, t.direction)) for s, t in terms}
    assert names == {((1, -1), (k, k)) for k in range(3)} | {((k, -1), (k, -1)) for k in range(3)}


def tangent_times_vector(comm):
    """Return norms of a tangent by sub-cells, and assert that it equals that of FFCx."""
    values = {}
    for make_residual in (make_residual_of_several_integrals, make_hybrid_residual):
        mesh = create_box(comm, [(0, 0, 0), (1.0, 1.2, 0.9)], [3, 3, 3], CellType.tetrahedron)
        tangent = derive_tangent(*make_residual(mesh))
        forms = compile_tangent(tangent)
        assert count_forms_by_compiler(forms)[0] == 1
        matrix = assemble_sum(forms)
        expected = assemble_sum([compile_form(tangent, 2, "a tangent")])
        assert relative_difference(matrix, expected) <= 1e-14
        values[make_residual.__name__] = np.array([matrix.norm()])
    return values


def test_tangent_on_two_processes_equals_the_one_on_one():
    assert_same_on_processes(tangent_times_vector, process_counts=[2], rel=1e-12)


def test_interrupted_compilation_leaves_the_cache_usable(tmp_path, monkeypatch):
    options = dolfinx.jit.DOLFINX_DEFAULT_JIT_OPTIONS
    monkeypatch.setitem(options, "cache_dir", (tmp_path, ""))
    tangent = derive_tangent(*make_scalar_residual(make_distorted_mesh()))

    def interrupt(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(sub_cells, "replace_file_atomically", interrupt)
        with pytest.raises(KeyboardInterrupt):
            compile_tangent(tangent)
    assert not list(tmp_path.glob("libpw_sub_cells*"))
    assert count_forms_by_compiler(compile_tangent(tangent)) == (1, 0)
    assert len(list(tmp_path.glob("libpw_sub_cells*"))) == 1


def make_tangent_in_empty_cache(folder, monkeypatch):
    """Return a tangent that FFCx has compiled into an empty cache in a folder."""
    monkeypatch.setitem(dolfinx.jit.DOLFINX_DEFAULT_JIT_OPTIONS, "cache_dir", (folder, ""))
    tangent = derive_tangent(*make_scalar_residual(make_distorted_mesh()))
    compile_form(tangent, 2, "a tangent")
    return tangent


def test_ffcx_compiles_tangents_if_the_kernel_cannot_be_stored(tmp_path, monkeypatch):
    tangent = make_tangent_in_empty_cache(tmp_path, monkeypatch)

    def refuse(*_, **__):
        raise PermissionError

    monkeypatch.setattr(sub_cells.tempfile, "TemporaryDirectory", refuse)
    assert count_forms_by_compiler(compile_tangent(tangent)) == (0, 1)


def test_tangents_that_ffcx_has_compiled_need_no_compiler(tmp_path, monkeypatch):
    tangent = make_tangent_in_empty_cache(tmp_path, monkeypatch)
    monkeypatch.setenv("CC", str(tmp_path / "no-compiler"))
    log_handlers = logging.root.handlers.copy()
    assert count_forms_by_compiler(compile_tangent(tangent)) == (0, 1)
    assert logging.root.handlers == log_handlers


def test_functions_at_other_quadrature_points_are_refused_by_ffcx():
    mesh = make_distorted_mesh()
    u, v = make_unknown_and_weights(mesh)
    element = basix.ufl.quadrature_element("tetrahedron", (), degree=2)
    stiffness = fem.Function(fem.functionspace(mesh, element))
    tangent = derive_tangent(u, stiffness * ufl.inner(ufl.grad(u), ufl.grad(v)) * DX_2)
    with pytest.raises(ValueError, match="the form cannot be compiled"):
        compile_tangent(tangent)


def test_errors_of_the_c_compiler_in_the_kernel_are_raised(tmp_path, monkeypatch):
    """A kernel that the C compiler refuses is a fault of the library, and is not hidden."""
    tangent = make_tangent_in_empty_cache(tmp_path, monkeypatch)
    generate_source = SubCellKernel.generate_source

    def generate_wrong_source(kernel, *statements):
        return generate_source(kernel, *statements) + "\nno declaration"

    monkeypatch.setattr(SubCellKernel, "generate_source", generate_wrong_source)
    with pytest.raises(cffi.VerificationError, match="CompileError"):
        compile_tangent(tangent)


@pytest.mark.parametrize("fault", [KeyError, ValueError, RuntimeError])
def test_errors_in_the_generation_of_the_kernel_are_raised(fault, monkeypatch):
    def fail(*_):
        raise fault("a fault of the library")

    monkeypatch.setattr(SubCellKernel, "generate_source", fail)
    with pytest.raises(fault, match="a fault of the library"):
        compile_tangent(derive_tangent(*make_scalar_residual(make_distorted_mesh())))


def test_problems_use_the_kernel():
    u, residual = make_rubber_residual(make_distorted_mesh())
    system = PetrovGalerkinProblem(residual, u).system
    system.assemble_tangent()
    expected = assemble_sum([compile_form(derive_tangent(u, residual), 2, "a tangent")])
    difference = relative_difference(system.tangent, expected)
    assert 0 < difference <= 1e-14  # round-off differs from that of FFCx
