"""Proof, in exact fractions, that the new stiffness is T times the standard one.

A counterexample is given for each condition. All functions are defined here. Only the last test
uses the library, to compare its force transfer matrix T. Nodes are numbered as in Basix: vertices,
then the middles of the sides opposite them.
"""

from itertools import combinations

from mpi4py import MPI

import numpy as np
import pytest
import sympy as sp

from pw_elements import Spaces, force_transfer
from pw_elements.meshes import triangles

X, Y, Z = sp.symbols("x y z")
SIDE_ENDS_BY_DIMENSION = {
    1: ((0, 1),),
    2: ((1, 2), (0, 2), (0, 1)),
    3: ((2, 3), (1, 3), (1, 2), (0, 3), (0, 2), (0, 1)),
}
ZERO = sp.Integer(0)


def reference_nodes(dim):
    vertices = [sp.zeros(dim, 1), *(sp.eye(dim)[:, k] for k in range(dim))]
    return [*vertices, *((vertices[a] + vertices[b]) / 2 for a, b in SIDE_ENDS_BY_DIMENSION[dim])]


def quadratic_shape_functions(*coordinates):
    L = [1 - sum(coordinates), *coordinates]
    return [
        *(k * (2 * k - 1) for k in L),
        *(4 * L[a] * L[b] for a, b in SIDE_ENDS_BY_DIMENSION[len(coordinates)]),
    ]


def force_transfer_matrix(dim):
    """Return the matrix T, which adds an eighth of a mid-side node's equation to both side ends.

    The mid-side node keeps three quarters of its equation.
    """
    T = sp.diag(*[1] * (dim + 1), *[sp.Rational(3, 4)] * len(SIDE_ENDS_BY_DIMENSION[dim]))
    for middle, ends in enumerate(SIDE_ENDS_BY_DIMENSION[dim], start=dim + 1):
        for end in ends:
            T[end, middle] = sp.Rational(1, 8)
    return T


def triangle_weight_functions():
    """Return the corners of each sub-triangle and the weights there, Eqs (15)-(20) of the paper."""
    printed = {
        (1, 4, 6): (1 - 2 * X - 2 * Y, ZERO, ZERO, 2 * X, ZERO, 2 * Y),
        (4, 2, 5): (ZERO, 2 * X - 1, ZERO, 2 - 2 * X - 2 * Y, 2 * Y, ZERO),
        (6, 5, 3): (ZERO, ZERO, 2 * Y - 1, ZERO, 2 * X, 2 - 2 * X - 2 * Y),
        (4, 5, 6): (ZERO, ZERO, ZERO, 1 - 2 * Y, 2 * X + 2 * Y - 1, 1 - 2 * X),
    }
    paper_numbers = (1, 2, 3, 5, 6, 4)  # the paper's numbers of Basix's nodes
    position_of = dict(zip(paper_numbers, reference_nodes(2), strict=True))
    return [
        ([position_of[n] for n in sub], [w[n - 1] for n in paper_numbers])
        for sub, w in printed.items()
    ]


def tetrahedron_weight_functions(diagonal):
    """Return the corners of each sub-tetrahedron and the weight functions there.

    Four sub-tetrahedra are at the vertices. The others result from cutting the octahedron along a
    diagonal.
    """
    middles = {4 + k: set(ends) for k, ends in enumerate(SIDE_ENDS_BY_DIMENSION[3])}
    subs = [(v, *(m for m, ends in middles.items() if v in ends)) for v in range(4)]
    ring = [m for m in middles if m not in diagonal]
    subs += [(*diagonal, a, b) for a, b in combinations(ring, 2) if middles[a] & middles[b]]
    pieces = []
    for sub in subs:
        corners = [reference_nodes(3)[n] for n in sub]
        basis = sp.Matrix([[1, X, Y, Z]]) * sp.Matrix([[1, *c] for c in corners]).inv()
        pieces.append((corners, [basis[sub.index(n)] if n in sub else ZERO for n in range(10)]))
    return pieces


OCTAHEDRON_DIAGONALS = ((4, 9), (5, 8), (6, 7))  # middles of two sides without a common end


def integrate_over_simplex(polynomial, corners, variables):
    """Return the integral of a polynomial over a simplex."""
    local = sp.symbols(f"s1:{len(corners)}")
    edges = sp.Matrix.hstack(*(corner - corners[0] for corner in corners[1:]))
    position = corners[0] + edges * sp.Matrix(local)
    integrand = sp.sympify(polynomial).subs(
        list(zip(variables, position, strict=True)), simultaneous=True
    )
    total = sum(
        factor * sp.prod(map(sp.factorial, powers)) / sp.factorial(sum(powers) + len(local))
        for powers, factor in sp.Poly(integrand, *local).terms()
    )
    return total * sp.sqrt((edges.T * edges).det())


def transfer_defect(weights, variables, form):
    """Return the integrals of `form` of the weights minus T times those of the shape functions."""
    N = quadratic_shape_functions(*variables)
    new = sp.Matrix(
        [
            sum(integrate_over_simplex(form(w[i]), c, variables) for c, w in weights)
            for i in range(len(N))
        ]
    )
    corners = reference_nodes(len(variables))[: len(variables) + 1]
    standard = sp.Matrix([integrate_over_simplex(form(n), corners, variables) for n in N])
    return new - force_transfer_matrix(len(variables)) * standard


def is_transfer_exact(weights, variables, *forms):
    return all(not any(transfer_defect(weights, variables, form)) for form in forms)


def stiffness_column_integrands(variables, weight_derivative, shape_derivative, factor=1):
    """Return the integrands of a stiffness matrix as functions of a weight, one for each column.

    Each is `factor` times the weight's derivative by `weight_derivative`, times the derivative of
    the column's shape function by `shape_derivative`.
    """
    return [
        lambda w, n=n: factor * sp.diff(w, weight_derivative) * sp.diff(n, shape_derivative)
        for n in quadratic_shape_functions(*variables)
    ]


TRIANGLE_WEIGHT_FUNCTIONS = triangle_weight_functions()


def test_weights_and_transferred_shape_functions_have_equal_moments():
    """Weights w and transferred shape functions T N have equal means and moments.

    The mean of w - T N vanishes over the triangle. Along each side, its mean and its first moment
    vanish.
    """
    assert is_transfer_exact(TRIANGLE_WEIGHT_FUNCTIONS, (X, Y), lambda w: w)
    for a, b in SIDE_ENDS_BY_DIMENSION[2]:
        ends, middle = (
            (reference_nodes(2)[a], reference_nodes(2)[b]),
            (reference_nodes(2)[a] + reference_nodes(2)[b]) / 2,
        )
        for moment in (1, X + 2 * Y):  # X + 2 Y is not constant on any side
            side_moments = {}
            for half in ((ends[0], middle), (middle, ends[1])):
                (functions,) = [
                    w for corners, w in TRIANGLE_WEIGHT_FUNCTIONS if all(h in corners for h in half)
                ]
                for i, w in enumerate(functions):
                    side_moments[i] = side_moments.get(i, 0) + integrate_over_simplex(
                        moment * w, half, (X, Y)
                    )
            whole = sp.Matrix(
                [
                    integrate_over_simplex(moment * n, ends, (X, Y))
                    for n in quadratic_shape_functions(X, Y)
                ]
            )
            assert sp.Matrix(list(side_moments.values())) == force_transfer_matrix(2) * whole
            assert any(whole)


def test_new_stiffness_is_transferred_for_any_triangle_and_constant_elasticity():
    """The new stiffness is T times the standard one for any triangle and any constant elasticity.

    The entries of the Jacobian and nine moduli are symbols. Each entry of the stiffness times the
    determinant is a polynomial in them.
    """
    jacobian = sp.Matrix(2, 2, sp.symbols("x1:3 y1:3"))
    D = sp.Matrix(3, 3, sp.symbols("d1:10"))

    def B(function, point):
        reference = sp.Matrix(
            [sp.diff(function, v).subs({X: point[0], Y: point[1]}) for v in (X, Y)]
        )
        gx, gy = jacobian.adjugate().T * reference  # gradient times the determinant
        return sp.Matrix([[gx, 0], [0, gy], [gy, gx]])

    def stiffness_of(corners_and_weight_functions):
        """Return the stiffness by quadrature at the middles of sides, exact for degree 2."""
        K = sp.zeros(12, 12)
        for corners, functions in corners_and_weight_functions:
            for a, b in combinations(corners, 2):
                left, right = (
                    sp.Matrix.hstack(*(B(f, (a + b) / 2) for f in values_set))
                    for values_set in (functions, quadratic_shape_functions(X, Y))
                )
                K += integrate_over_simplex(1, corners, (X, Y)) / 3 * left.T * D * right
        return K.applyfunc(sp.expand)

    new, standard = (
        stiffness_of(TRIANGLE_WEIGHT_FUNCTIONS),
        stiffness_of([(reference_nodes(2)[:3], quadratic_shape_functions(X, Y))]),
    )
    T = sp.kronecker_product(force_transfer_matrix(2), sp.eye(2))
    assert (new - T * standard).applyfunc(sp.expand) == sp.zeros(12, 12)
    assert new != standard


def test_new_stiffness_of_an_interval_is_transferred():
    start, end, middle = reference_nodes(1)
    weights = [
        ([start, middle], [1 - 2 * X, ZERO, 2 * X]),
        ([middle, end], [ZERO, 2 * X - 1, 2 - 2 * X]),
    ]
    assert is_transfer_exact(weights, (X,), *stiffness_column_integrands((X,), X, X))


def test_transfer_is_exact_for_uniform_loads_and_not_for_linear_ones():
    """The new load vector is T times the standard one for uniform loads and forces at vertices.

    Tractions are covered by `test_weights_and_transferred_shape_functions_have_equal_moments`. The
    relation does not hold for linear body loads and for forces at mid-side nodes.
    """
    assert force_transfer_matrix(2)[:, :3] == sp.eye(6)[:, :3]
    assert not is_transfer_exact(
        TRIANGLE_WEIGHT_FUNCTIONS, (X, Y), lambda w: X * w
    )  # a linear body load
    assert force_transfer_matrix(2)[:, 3:] != sp.eye(6)[:, 3:]  # a force at a mid-side node


@pytest.mark.parametrize(
    "forms",
    [
        # a linear modulus or prestress
        stiffness_column_integrands((X, Y), X, Y, factor=1 + X),
        # the mass matrix
        [lambda w, n=n: w * n for n in quadratic_shape_functions(X, Y)],
        # axisymmetry: in axial rows, the terms with the shear modulus have the radius as a factor
        stiffness_column_integrands((X, Y), X, X, factor=1 + X),
        # one mid-side node moved by c: x = X + 4 c X Y, y = Y, with the determinant 1 + 4 c Y; this
        # is the derivative by c at c = 0 of the stiffness part with both derivatives by x
        stiffness_column_integrands((X, Y), X, X, factor=-4 * Y),
    ],
)
def test_transfer_fails_without_constant_data_or_straight_sides(forms):
    assert is_transfer_exact(
        TRIANGLE_WEIGHT_FUNCTIONS, (X, Y), *stiffness_column_integrands((X, Y), X, Y)
    )
    assert not is_transfer_exact(TRIANGLE_WEIGHT_FUNCTIONS, (X, Y), *forms)


@pytest.mark.parametrize("cuts", [OCTAHEDRON_DIAGONALS[:1], OCTAHEDRON_DIAGONALS], ids=str)
def test_tetrahedra_have_no_force_transfer_matrix(cuts):
    """No matrix T relates the stiffness matrices of tetrahedra.

    For any cut, a mid-side node's row of the new element is not a multiple of its standard row.
    Within one tetrahedron, it could be combined from rows of other nodes. After assembly it could
    not, because those rows also have contributions of other elements. The rows are represented by
    integrals of derivatives times 1 and times the coordinates, by which a linear stress is
    multiplied.
    """

    def mid_side_node_integral_rows(variables, pieces):
        forms = [lambda f, v=v, p=p: p * sp.diff(f, v) for v in (X, Y) for p in (1, *variables)]
        return [
            sp.Matrix(
                [
                    [
                        sum(integrate_over_simplex(g(w[i]), c, variables) for c, w in pieces)
                        for g in forms
                    ]
                ]
            )
            for i in range(len(variables) + 1, len(pieces[0][1]))
        ]

    def are_rows_multiples_of_standard_ones(variables, pieces):
        standard = [
            (
                reference_nodes(len(variables))[: len(variables) + 1],
                quadratic_shape_functions(*variables),
            )
        ]
        pairs_of_rows = zip(
            mid_side_node_integral_rows(variables, pieces),
            mid_side_node_integral_rows(variables, standard),
            strict=True,
        )
        return [new.col_join(old).rank() == 1 for new, old in pairs_of_rows]

    assert are_rows_multiples_of_standard_ones((X, Y), TRIANGLE_WEIGHT_FUNCTIONS) == [True] * 3
    pieces = [piece for cut in cuts for piece in tetrahedron_weight_functions(cut)]
    assert are_rows_multiples_of_standard_ones((X, Y, Z), pieces) == [False] * 6


def test_transferred_forces_violate_contact_laws_at_status_changes():
    """Transferred nodal forces T r violate the contact law where statuses change along a side.

    T couples nodes with different statuses: slip and stick, or closed and open.
    """
    edge = [1, 4, 2, 4, 1]  # standard nodal forces of a uniform pressure
    T = sp.Matrix(5, 5, lambda i, j: sp.Rational(1, 8) if i % 2 == 0 and abs(i - j) == 1 else 0)
    T += sp.diag(1, sp.Rational(3, 4), 1, sp.Rational(3, 4), 1)
    normal, mu = sp.Matrix(edge), sp.symbols("mu", positive=True)
    sliding = sp.Matrix([mu * n for n in edge[:3]] + [0, 0])  # the middle corner slips last
    assert all(sliding[i] == mu * normal[i] for i in range(3))
    assert (T * sliding)[2] < mu * (T * normal)[2]  # inside the friction cone
    open_at_the_middle = sp.Matrix([1, 4, 0, 0, 0])
    assert (T * open_at_the_middle)[2] > 0  # an open node gets a force


def test_the_librarys_force_transfer_equals_that_of_the_proof():
    U = Spaces.galerkin(triangles(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (1, 1))).trial
    T = force_transfer(U)
    for cell in U.dofmap.list:
        cell_T = T.getValues(2 * cell, 2 * cell)
        assert cell_T == pytest.approx(np.array(force_transfer_matrix(2), dtype=float), abs=0)
