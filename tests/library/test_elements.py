"""Weight functions on all types of cells, and their quadrature on tetrahedra.

The octahedron inside a tetrahedron can be cut into sub-cells along each of its three diagonals. On
tetrahedra, integrals of weight functions are means over these three cuts.
"""

from mpi4py import MPI

import basix
import basix.ufl
import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx.fem.petsc import assemble_matrix as dolfinx_matrix
from dolfinx.mesh import (
    CellType,
    create_box,
    create_interval,
    create_rectangle,
    create_unit_cube,
    meshtags,
)

import pw_elements
from pw_elements import (
    Reduction,
    assemble_matrix,
    assemble_vector,
    boundary_measure,
    cell_measure,
    solve,
)
from pw_elements.meshes import curved_mesh
from pw_elements.spaces import (
    add_sub_cell_quadrature_rules,
    piecewise_linear_sub_cell_element,
    quadratic_element,
)
from pw_elements.spaces.elements import SUPPORTED_CELL_NAMES, tetrahedron_twelve_cell_quadrature
from study.model.elements import p1_iso_p2_tetrahedron, p1_iso_p2_weight_spaces, serendipity_element
from study.model.matrices import to_dense_array
from tests.contact.cases import PETROV_GALERKIN
from tests.library.random_meshes import Grid, random_cell_points, structured_grid
from tests.oracle.elements import (
    REFERENCE_ELEMENTS,
    gauss_points_and_weights,
    shape_functions_and_gradients,
)


@pytest.mark.parametrize("cell", SUPPORTED_CELL_NAMES)
def test_weight_functions_equal_basixs_macro_element(cell):
    points = random_cell_points(cell, 200, 1)
    builtin = basix.ufl.element("iso", cell, 1)
    ours = (
        p1_iso_p2_tetrahedron()
        if cell == "tetrahedron"
        else piecewise_linear_sub_cell_element(cell)
    )
    ours = ours.tabulate(0, points)
    assert np.abs(ours - builtin.tabulate(0, points)).max() < 1e-14


@pytest.mark.parametrize("cell", SUPPORTED_CELL_NAMES)
def test_weight_gradients_equal_differences_of_the_values(cell):
    # Basix 0.9's own slopes are wrong on intervals, quadrilaterals and hexahedra
    element, step = piecewise_linear_sub_cell_element(cell), 1e-3
    points = random_cell_points(cell, 200, 1)
    table = element.tabulate(1, points)
    for direction, slope in enumerate(table[1:]):
        h = step * np.eye(points.shape[1])[direction]
        above, below = (element.tabulate(0, points + s * h)[0] for s in (1, -1))
        # weights are piecewise (multi)linear: differences are exact inside a sub-cell
        within = np.abs(above - 2 * table[0] + below).max(axis=1) < 1e-13
        assert within.mean() > 0.9
        difference = (above - below) / (2 * step)
        assert np.abs(slope - difference)[within].max() < 1e-11


def test_serendipity_is_nodal_and_holds_the_right_polynomials():
    element = serendipity_element()
    nodes = quadratic_element("quadrilateral")._element.points[:8]
    assert element.dim == 8
    assert np.abs(element.tabulate(0, nodes)[0] - np.eye(8)).max() < 1e-13
    points = random_cell_points("quadrilateral", 200, 1)
    table = element.tabulate(0, points)[0]

    def interpolation_error(f):
        return np.abs(table @ f(*nodes.T) - f(*points.T)).max()

    assert interpolation_error(lambda x, y: x**2 * y - 3 * x * y**2 + y**2 - x * y + 2) < 1e-13
    assert interpolation_error(lambda x, y: x**2 * y**2) > 1e-2  # contained in Q9, not in Q8


UNIT_SQUARE_OPPOSITE_CORNERS = [(0.0, 0.0), (1.0, 1.0)]
UNIT_CUBE_OPPOSITE_CORNERS = [(0.0, 0.0, 0.0), (1.0, 1.0, 1.0)]


def create_meshes_of_all_cell_types():
    comm = MPI.COMM_WORLD
    yield create_interval(comm, 5, [0.0, 1.0])
    yield create_rectangle(comm, UNIT_SQUARE_OPPOSITE_CORNERS, [4, 3], CellType.triangle)
    yield create_rectangle(comm, UNIT_SQUARE_OPPOSITE_CORNERS, [4, 3], CellType.quadrilateral)
    yield create_box(comm, UNIT_CUBE_OPPOSITE_CORNERS, [2, 3, 2], CellType.tetrahedron)
    yield create_box(comm, UNIT_CUBE_OPPOSITE_CORNERS, [2, 3, 2], CellType.hexahedron)


@pytest.mark.parametrize(
    "mesh", list(create_meshes_of_all_cell_types()), ids=lambda mesh: mesh.topology.cell_name()
)
def test_poisson_reproduces_a_quadratic_solution(mesh):
    # a quadratic solution is in the trial space, so any consistent test space reproduces it
    V = fem.functionspace(mesh, ("Lagrange", 2))
    d = mesh.geometry.dim
    u, v = ufl.TrialFunction(V), ufl.TestFunction(pw_elements.test_space(V))
    K = assemble_matrix(ufl.inner(ufl.grad(u), ufl.grad(v)) * ufl.dx)
    f = assemble_vector(-2.0 * d * v * ufl.dx)
    exact = fem.Function(V)
    exact.interpolate(lambda x: sum(x[i] ** 2 for i in range(d)) + x[0])
    rim = fem.locate_dofs_geometrical(
        V, lambda x: np.any(np.isclose(x[:d], 0) | np.isclose(x[:d], 1), axis=0)
    )
    a = solve(K, f, Reduction.dirichlet(V, [fem.dirichletbc(exact, rim)]))
    assert np.abs(a.array - exact.x.array[: a.getLocalSize()]).max() < 1e-12


STANDARD_POLYSET, MACROEDGE_POLYSET = basix.PolysetType.standard, basix.PolysetType.macroedge
QUADRATURE_DEGREES = (0, 1, 2, 4, 5, 7, 20)
TETRAHEDRON_NODES = np.array(REFERENCE_ELEMENTS["T10"].nodes) / 2


def yield_tetrahedron_sub_cells_per_cut():
    """Yield, for each of the three cuts, the nodes (8, 4) of the sub-cells of a tetrahedron.

    The diagonals 4-9, 5-8 and 6-7 of the octahedron join the middles of opposite edges.
    """
    corners = [(0, 7, 8, 9), (1, 5, 6, 9), (2, 4, 6, 8), (3, 4, 5, 7)]
    diagonals = [(4, 9), (5, 8), (6, 7)]
    for diagonal in diagonals:
        (a, b), (c, d) = (diagonal_2 for diagonal_2 in diagonals if diagonal_2 != diagonal)
        yield corners + [(*diagonal, *pair) for pair in ((a, c), (c, b), (b, d), (d, a))]


def integrate_mean_over_cuts(integrand):
    """Return the integral over the sub-cells of a cut, averaged over the three cuts.

    The integrand takes weights (q, 10), their gradients (3, 10) and points (q, 3).
    """
    points, measure = gauss_points_and_weights(True, 3, 4)
    hats = np.column_stack([1 - points.sum(axis=1), points])
    total = 0.0
    for cells in yield_tetrahedron_sub_cells_per_cut():
        for cell in map(list, cells):
            corners = np.column_stack([np.ones(4), TETRAHEDRON_NODES[cell]])
            weights, slopes = np.zeros((len(points), 10)), np.zeros((3, 10))
            weights[:, cell], slopes[:, cell] = hats, np.linalg.inv(corners)[1:]
            parts = integrand(weights, slopes, hats @ TETRAHEDRON_NODES[cell])
            total = total + abs(np.linalg.det(corners)) * np.tensordot(measure, parts, 1) / 3
    return total


def make_random_tetrahedron_grid(seed):
    return structured_grid("tetrahedron", [np.linspace(0, 1, 3)] * 3, seed, 1.0)


def test_stiffness_mass_and_load_are_the_mean_of_the_three_cuts():
    spaces = PETROV_GALERKIN(
        Grid("tetrahedron", TETRAHEDRON_NODES[:4], np.array([[0, 1, 2, 3]])).mesh(), 0
    )
    u, v = ufl.TrialFunction(spaces.trial), ufl.TestFunction(spaces.test)
    cell = spaces.trial.dofmap.list[0]
    K = to_dense_array(assemble_matrix(ufl.inner(ufl.grad(u), ufl.grad(v)) * ufl.dx))[
        np.ix_(cell, cell)
    ]
    M = to_dense_array(assemble_matrix(u * v * ufl.dx))[np.ix_(cell, cell)]
    f = assemble_vector(v * ufl.dx).array[cell]
    exact_K = integrate_mean_over_cuts(
        lambda _, dw, x: np.einsum("dm,qnd->qmn", dw, shape_functions_and_gradients("T10", x)[1])
    )
    exact_M = integrate_mean_over_cuts(
        lambda w, _, x: np.einsum("qm,qn->qmn", w, shape_functions_and_gradients("T10", x)[0])
    )
    assert np.abs(K - exact_K).max() < 1e-14 * np.abs(K).max()
    assert np.abs(M - exact_M).max() < 1e-14 * np.abs(M).max()
    volume = 1 / 6
    assert np.abs(f - volume * np.repeat([1 / 32, 7 / 48], (4, 6))).max() < 1e-16
    assert np.abs(M.sum(axis=1) - f).max() < 1e-16


@pytest.mark.parametrize("degree", [0, 1, 2, 3, 5, 8, 12, 15])
def test_twelve_cell_rule_is_exact_on_each_cell_of_every_cut(degree):
    points, weights = tetrahedron_twelve_cell_quadrature(degree)
    assert len(points) % 12 == 0
    gauss_points, gauss_weights = gauss_points_and_weights(True, 3, (degree + 4) // 2)
    hats = np.column_stack([1 - gauss_points.sum(axis=1), gauss_points])
    direction = np.array([0.3, -0.7, 0.5])
    for cells in yield_tetrahedron_sub_cells_per_cut():
        for cell in map(list, cells):
            corners = np.column_stack([np.ones(4), TETRAHEDRON_NODES[cell]])
            hat = np.column_stack([np.ones(len(points)), points]) @ np.linalg.inv(corners)
            inside = hat.min(axis=1) > 0
            exact = gauss_weights @ (1 + hats @ TETRAHEDRON_NODES[cell] @ direction) ** degree
            exact *= abs(np.linalg.det(corners))
            ours = weights[inside] @ (1 + points[inside] @ direction) ** degree
            assert ours == pytest.approx(exact, rel=1e-12)


@pytest.mark.parametrize("degree", [2, 4])
def test_weight_gradients_are_not_taken_on_sides_of_sub_cells(degree):
    """Gradients of weights are evaluated inside sub-cells, never on their sides.

    Basix's rules of degree 4, 5 and 7 have points on these sides, where gradients jump. Therefore
    the matrix that DOLFINx assembles with these rules is wrong.
    """
    spaces = p1_iso_p2_weight_spaces(make_random_tetrahedron_grid(5).mesh(), ())
    u, v = ufl.TrialFunction(spaces.trial), ufl.TestFunction(spaces.test)
    form = ufl.inner(ufl.grad(u), ufl.grad(v)) * ufl.dx(metadata={"quadrature_degree": degree})
    exact = to_dense_array(assemble_matrix(ufl.inner(ufl.grad(u), ufl.grad(v)) * ufl.dx))
    assert np.abs(to_dense_array(assemble_matrix(form)) - exact).max() < 1e-13 * np.abs(exact).max()
    theirs = dolfinx_matrix(fem.form(form))
    theirs.assemble()
    difference = np.abs(to_dense_array(theirs) - exact).max() / np.abs(exact).max()
    assert difference < 1e-13 if degree == 2 else difference > 1e-2


def test_user_forms_are_integrated_on_the_twelve_cells():
    spaces = PETROV_GALERKIN(make_random_tetrahedron_grid(7).mesh(), 0)
    mesh, W = spaces.mesh, spaces.test
    u, v = ufl.TrialFunction(spaces.trial), ufl.TestFunction(W)
    x, fine = ufl.SpatialCoordinate(mesh), cell_measure(W, 12)
    w = fem.Function(W)
    w.x.array[:] = np.sin(np.arange(len(w.x.array)))
    on_side = boundary_measure(mesh, lambda x: np.isclose(x[0], 0))

    def yield_user_forms(volume_measure):
        """Yield forms of matrices and vectors; some contain a finite-element function of W."""
        wind = ufl.as_vector((1.0, 2.0, x[0]))
        yield (
            ufl.inner((1 + x[0] * x[1]) * ufl.grad(u), ufl.grad(v)) * volume_measure
            + u * v * volume_measure
        )
        yield ufl.dot(wind, ufl.grad(u)) * v * volume_measure + u * v * on_side
        yield ufl.derivative(ufl.inner(ufl.grad(w), ufl.grad(w)) / 2 * volume_measure, w, v)
        yield w**2 * v * volume_measure + v * ufl.ds
        yield ufl.inner(ufl.grad(u), ufl.grad(v)) * volume_measure
        yield x[0] * ufl.inner(ufl.grad(w), ufl.grad(v)) * volume_measure
        yield (x[0] * v.dx(1) + v) * volume_measure
        yield w * ufl.TestFunction(spaces.trial) * volume_measure

    for plain, exact in zip(yield_user_forms(ufl.dx), yield_user_forms(fine), strict=True):
        assemble = assemble_matrix if len(plain.arguments()) == 2 else assemble_vector
        ours, reference = assemble(plain), assemble(exact)
        size = reference.norm()
        ours.axpy(-1.0, reference)
        assert ours.norm() < 1e-14 * size

    # four points are enough for gradients times linear functions on straight cells
    slopes = x[0] * v.dx(1)
    for number, integrand in ((4, slopes), (12, slopes + v), (48, x[1] * slopes)):
        (integral,) = add_sub_cell_quadrature_rules(integrand * ufl.dx).integrals()
        assert len(integral.metadata()["quadrature_points"]) == number

    # a degree given by the user is kept
    crude = assemble_matrix(u * v * ufl.dx(metadata={"quadrature_degree": 1}))
    same = dolfinx_matrix(fem.form(u * v * cell_measure(W, 1)))
    same.assemble()
    assert np.abs(to_dense_array(crude) - to_dense_array(same)).max() == 0
    exact = to_dense_array(assemble_matrix(u * v * ufl.dx))
    assert np.abs(to_dense_array(crude) - exact).max() > 1e-2 * np.abs(exact).max()


def test_mixed_spaces_and_curved_cells_are_integrated_on_the_twelve_cells():
    scalar = basix.ufl.element("Lagrange", "tetrahedron", 1)
    weights = piecewise_linear_sub_cell_element("tetrahedron", (3,))
    for degree in (1, 2):
        box = create_unit_cube(MPI.COMM_SELF, 1, 1, 1)
        mesh = box if degree == 1 else curved_mesh(box, lambda x: x + 0.1 * x**2)
        V = fem.functionspace(
            mesh,
            basix.ufl.mixed_element([quadratic_element("tetrahedron", (3,)), scalar]),
        )
        W = fem.functionspace(mesh, basix.ufl.mixed_element([weights, scalar]))
        (u, p), (w, q) = ufl.TrialFunctions(V), ufl.TestFunctions(W)
        integrand = ufl.inner(ufl.grad(u), ufl.grad(w)) - p * ufl.div(w) - q * ufl.div(u)
        ours = assemble_matrix(integrand * ufl.dx)
        fine = assemble_matrix(integrand * cell_measure(W, 14))
        fine.axpy(-1.0, ours)
        assert fine.norm() < (1e-13 if degree == 1 else 1e-3) * ours.norm()


def test_subdomain_tags_are_kept_in_assembled_loads():
    mesh = create_unit_cube(MPI.COMM_SELF, 2, 2, 2)
    v = ufl.TestFunction(PETROV_GALERKIN(mesh, 0).test)
    cells = np.arange(20, dtype=np.int32)
    tags = meshtags(mesh, 3, cells, np.where(cells < 5, 1, 2).astype(np.int32))
    dx = ufl.Measure("dx", domain=mesh, subdomain_data=tags)
    load = assemble_vector(v * dx(1) + 3.0 * v * dx(2))
    assert load.sum() == pytest.approx((5 + 3 * 15) / 48, rel=1e-13)


@pytest.mark.parametrize("degree", QUADRATURE_DEGREES)
@pytest.mark.parametrize("polyset", [STANDARD_POLYSET, MACROEDGE_POLYSET])
def test_tabulation_at_basixs_quadrature_points_is_refused(degree, polyset):
    points, _ = basix.make_quadrature(basix.CellType.tetrahedron, degree, polyset_type=polyset)
    for derivatives in (0, 1):
        with pytest.raises(ValueError, match="cell_measure"):
            piecewise_linear_sub_cell_element("tetrahedron").tabulate(derivatives, points)
    p1_iso_p2_tetrahedron().tabulate(1, points)


def test_dolfinx_own_integrals_of_weight_functions_are_refused():
    spaces = PETROV_GALERKIN(create_unit_cube(MPI.COMM_SELF, 1, 1, 1), 0)
    u, v = ufl.TrialFunction(spaces.trial), ufl.TestFunction(spaces.test)
    w = fem.Function(spaces.test)
    for form in (
        v * ufl.dx,
        ufl.inner(ufl.grad(u), ufl.grad(v)) * ufl.dx,
        w * ufl.dx,
        u * v * ufl.dx,
    ):
        with pytest.raises(ValueError, match="cell_measure"):
            fem.form(form)
    w.x.array[:] = 1.0
    for degree in (0, 1, 4):
        volume = fem.assemble_scalar(fem.form(w * cell_measure(spaces.test, degree)))
        assert volume == pytest.approx(1.0, rel=1e-14)
    # on faces, the rule of FFCx is sufficient
    area = fem.assemble_vector(fem.form(v * ufl.ds)).array
    assert area.sum() == pytest.approx(6.0, rel=1e-14)
    with pytest.raises(ValueError, match="quadrature_degree"):
        assemble_vector(v * ufl.dx(metadata={"quadrature_rule": "vertex", "quadrature_degree": 1}))


def test_weights_can_be_tabulated_and_interpolated_at_nodes():
    element, nodes = piecewise_linear_sub_cell_element("tetrahedron"), TETRAHEDRON_NODES
    assert np.abs(element.tabulate(1, nodes)[0] - np.eye(10)).max() < 1e-15
    somewhere = np.array([[0.2, 0.3, 0.1]])
    assert np.abs(element.tabulate(0, somewhere)[0].sum() - 1) < 1e-15
    middle = np.array([[0.25, 0.25, 0.25], [0.0, 0.0, 0.0]])
    assert element.tabulate(0, middle)[0][0] == pytest.approx([0] * 4 + [1 / 6] * 6, abs=1e-15)

    mesh = create_unit_cube(MPI.COMM_SELF, 2, 1, 1)
    W, V = (PETROV_GALERKIN(mesh, 0).test, fem.functionspace(mesh, ("Lagrange", 2)))
    w, f = fem.Function(W), fem.Function(V)
    w.interpolate(lambda x: x[0] + x[1] * x[2])
    f.interpolate(w)
    f.interpolate(fem.Expression(w, _get_interpolation_points(V)))
    assert np.abs(f.x.array - w.x.array).max() < 1e-14
    gradient = fem.Function(fem.functionspace(mesh, ("DG", 1, (3,))))
    gradient.interpolate(
        fem.Expression(ufl.grad(w), _get_interpolation_points(gradient.function_space))
    )


def _get_interpolation_points(space):
    points = space.element.interpolation_points
    return points() if callable(points) else points  # in DOLFINx up to 0.9 this is a method
