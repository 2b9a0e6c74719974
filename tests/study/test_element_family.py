"""Proofs, in exact fractions, about the family P_k: hat functions on k^2 sub-triangles as weights.

All functions are defined here. The integrals of s . grad(f) over the reference triangle are
computed for all vector fields s of degree k - 1, to which stresses of displacements of degree k
belong on any straight triangle. If those of a weight function are combined from those of shape
functions, so are the rows of the stiffness matrices, for any constant law.
"""

from fractions import Fraction
from itertools import combinations, pairwise, permutations, product
from math import factorial

import numpy as np
import pytest
from sympy import QQ
from sympy.polys.matrices import DomainMatrix

from study.benchmarks.e_element.family import DEGREES, make_triangle, transfer_defects


def lattice_points(degree, dim=2):
    """Return the barycentric coordinates, multiplied by the degree, of the nodes of a simplex."""
    sums = product(range(degree + 1), repeat=dim + 1)
    return [point for point in sums if sum(point) == degree]


def sub_triangles(degree):
    """Return the corners of the sub-triangles, of both orientations."""
    upright = lattice_points(degree - 1)
    e = np.eye(3, dtype=int)
    triangles = [[tuple(np.array(p) + e[i]) for i in range(3)] for p in upright]
    inverted = lattice_points(degree - 2) if degree > 1 else []
    return triangles + [[tuple(np.array(p) + 1 - e[i]) for i in range(3)] for p in inverted]


def multiply(p, q):
    """Multiply polynomials, dictionaries of coefficients by exponents."""
    result = {}
    for (a, x), (b, y) in product(p.items(), q.items()):
        key = tuple(i + j for i, j in zip(a, b, strict=True))
        result[key] = result.get(key, 0) + x * y
    return result


def shape_function(node, degree):
    """Return a shape function of degree k as a homogeneous polynomial in L1, L2, L3."""
    L, total = np.eye(3, dtype=int), {(0, 0, 0): Fraction(1)}
    for axis, share in enumerate(node):
        for j in range(share):
            # (k L - j) / (share - j), where j = j (L1 + L2 + L3)
            factor = {tuple(L[b].tolist()): Fraction(-j, share - j) for b in range(3)}
            factor[tuple(L[axis].tolist())] += Fraction(degree, share - j)
            total = multiply(total, factor)
    return total


def integrate_over_triangle(polynomial, corners):
    """Integrate a polynomial in L1, L2, L3 over a triangle with these barycentric corners.

    The area of the whole triangle is 1/2.
    """
    corners = [[Fraction(int(c)) for c in corner] for corner in corners]
    degree = sum(corners[0])
    local = [
        {tuple(int(b == v) for b in range(3)): corners[v][axis] / degree for v in range(3)}
        for axis in range(3)
    ]
    total = Fraction(0)
    for exponents, coefficient in polynomial.items():
        term = {(0, 0, 0): coefficient}
        for axis, exponent in enumerate(exponents):
            for _ in range(exponent):
                term = multiply(term, local[axis])
        for powers, value in term.items():
            total += (
                value
                * np.prod([factorial(p) for p in powers], dtype=object)
                / factorial(sum(powers) + 2)
            )
    (x0, x1, x2) = [np.array(c[1:]) / degree for c in corners]
    a, b = x1 - x0, x2 - x0
    return total * abs(a[0] * b[1] - a[1] * b[0])


def derivative(polynomial, axis):
    """Differentiate a polynomial in L1, L2, L3 by x = L2 (axis 0) or y = L3 (axis 1)."""
    result = {}
    for exponents, value in polynomial.items():
        for variable, sign in ((axis + 1, 1), (0, -1)):
            if exponents[variable]:
                lower = list(exponents)
                lower[variable] -= 1
                key = tuple(lower)
                result[key] = result.get(key, 0) + sign * exponents[variable] * value
    return result


def hat_slopes(corners):
    """Return the slopes (3, 2) of the linear functions that are 1 at one corner."""
    degree = sum(corners[0])
    x = [[Fraction(int(v), int(degree)) for v in corner[1:]] for corner in corners]
    (ax, ay), (bx, by) = ([x[k][d] - x[0][d] for d in range(2)] for k in (1, 2))
    det = ax * by - ay * bx
    first, second = (by / det, -bx / det), (-ay / det, ax / det)
    return [(-first[0] - second[0], -first[1] - second[1]), first, second]


def integral_matrices(degree):
    """Return the integrals of s . grad(f): rows of weights and of shape functions, (n, m) each."""
    nodes = lattice_points(degree)
    monomials = lattice_points(degree - 1)
    whole = [(1, 0, 0), (0, 1, 0), (0, 0, 1)]
    standard = [
        [
            integrate_over_triangle(multiply({s: Fraction(1)}, derivative(N, axis)), whole)
            for axis in range(2)
            for s in monomials
        ]
        for N in (shape_function(node, degree) for node in nodes)
    ]
    new = np.zeros((len(nodes), 2 * len(monomials)), dtype=object)
    for corners in sub_triangles(degree):
        integrals = [integrate_over_triangle({s: Fraction(1)}, corners) for s in monomials]
        for corner, slope in zip(corners, hat_slopes(corners), strict=True):
            row = nodes.index(tuple(int(c) for c in corner))
            new[row] += np.array([slope[axis] * i for axis in range(2) for i in integrals])
    return nodes, new.tolist(), standard


def rank(rows):
    return DomainMatrix(
        [[QQ(x.numerator, x.denominator) for x in map(Fraction, row)] for row in rows],
        (len(rows), len(rows[0])),
        QQ,
    ).rank()


def is_combination(row, rows):
    return rank(rows) == rank([*rows, row])


def may_combine(row_node, column_node):
    """Return whether a matrix T that is assembled may have an entry.

    The equation of the column's node is a sum over all triangles around it. Each of them must
    contain the row's node: it lies on all sides on which the column's node lies.
    """
    return all(r == 0 for r, c in zip(row_node, column_node, strict=True) if c == 0)


INTEGRALS = {degree: integral_matrices(degree) for degree in (2, 3, 4, 5)}


@pytest.mark.parametrize("degree", INTEGRALS)
def test_each_matrix_of_a_triangle_is_transferred_up_to_degree_three_only(degree):
    nodes, new, standard = INTEGRALS[degree]
    representable = [is_combination(row, standard) for row in new]
    assert all(representable) == (degree <= 3)
    # vertices and, of degree 4, nodes in the middle of sides and inside are, whatever the degree
    assert all(
        representable[nodes.index(tuple(v))] for v in (degree * np.eye(3, dtype=int)).tolist()
    )


@pytest.mark.parametrize("degree", INTEGRALS)
def test_assembled_matrices_are_transferred_for_degree_two_only(degree):
    nodes, new, standard = INTEGRALS[degree]
    representable = [
        is_combination(
            row,
            [other for node, other in zip(nodes, standard, strict=True) if may_combine(at, node)],
        )
        for at, row in zip(nodes, new, strict=True)
    ]
    assert all(representable) == (degree == 2)
    if degree == 3:  # the obstacle is in the nodes of sides
        assert [nodes[i] for i, fits in enumerate(representable) if not fits] == [
            node for node in nodes if sorted(node) == [0, 1, 2]
        ]


@pytest.mark.parametrize("degree", INTEGRALS)
def test_sums_of_weights_over_layers_are_transferred_for_any_degree(degree):
    """This is the first part of the proof for degrees 2 and 3.

    A sum over a layer of nodes parallel to a side depends on one coordinate, so that a polynomial
    of this coordinate has the same integrals. These sums span 3 k dimensions: all six weight
    functions for k = 2, and all but the alternating sum of side nodes for k = 3.
    """
    nodes, new, standard = INTEGRALS[degree]
    layers = [
        [int(node[axis] == level) for node in nodes]
        for axis in range(3)
        for level in range(degree + 1)
    ]
    for layer in layers:
        total = [
            sum(c * x for c, x in zip(layer, column, strict=True))
            for column in zip(*new, strict=True)
        ]
        assert is_combination(total, standard)
    assert rank(layers) == 3 * degree
    assert rank([*layers, alternating_signs(nodes)]) == min(3 * degree + 1, len(nodes))


def alternating_signs(nodes):
    """Return 1 for nodes next to the first end of a side, -1 for those next to the other end."""
    return [
        sum(
            (node[i] == 0) * (node[j] * node[k] > 0) * ((node[j] > node[k]) - (node[j] < node[k]))
            for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1))
        )
        for node in nodes
    ]


@pytest.mark.parametrize("degree", [3, 4])
def test_alternating_sum_of_side_nodes_is_transferred_for_degree_three_only(degree):
    """This is the second part of the proof for degree 3, and the obstacle for degree 4.

    On each side the sum is odd. For k = 3 it has one odd moment, which the cubic polynomial with
    the same signs can match; for k = 4 it has two, with a ratio of 3/32 instead of 3/28.
    """
    nodes, new, standard = INTEGRALS[degree]
    signs = alternating_signs(nodes)
    totals = [
        [
            sum(c * x for c, x in zip(signs, column, strict=True))
            for column in zip(*rows, strict=True)
        ]
        for rows in (new, standard)
    ]
    assert is_combination(totals[0], standard) == (degree == 3)
    assert is_combination(totals[0], totals[1:]) == (degree == 3)
    positions = [Fraction(j, degree) - Fraction(1, 2) for j in range(degree + 1)]
    values = [0, 1, *[0] * (degree - 3), -1, 0]
    hat = [integrate_side(positions, values, power) for power in (1, 3)]
    t = [Fraction(0), Fraction(1, 4), Fraction(0), Fraction(-1)]  # t (1/4 - t^2)
    cubic = [sum(c * even_moment(power + p) for p, c in enumerate(t)) for power in (1, 3)]
    if degree == 4:
        assert (hat[1] / hat[0], cubic[1] / cubic[0]) == (Fraction(3, 32), Fraction(3, 28))


def test_side_nodes_of_degree_three_are_the_obstacle_of_assembly():
    """The two side nodes' hats have another ratio of second moment and mean than their cubics.

    In a row of an assembled T, only the functions of the side itself do not vanish on it.
    """
    positions = [Fraction(j, 3) - Fraction(1, 2) for j in range(4)]
    hats = [integrate_side(positions, [0, 1, 1, 0], power) for power in (0, 2)]
    parabola = [even_moment(power) / 4 - even_moment(power + 2) for power in (0, 2)]
    assert (hats[1] / hats[0], parabola[1] / parabola[0]) == (Fraction(5, 108), Fraction(1, 20))


def even_moment(power):
    """Return the integral of t^power from -1/2 to 1/2."""
    return Fraction(0) if power % 2 else Fraction(2, (power + 1) * 2 ** (power + 1))


def integrate_side(positions, values, power):
    """Return the integral of t^power times a piecewise linear function of t."""
    total = Fraction(0)
    for (a, b), (u, v) in zip(pairwise(positions), pairwise(values), strict=True):
        slope = (v - u) / (b - a)
        for exponent, factor in ((power, u - slope * a), (power + 1, slope)):
            total += factor * (b ** (exponent + 1) - a ** (exponent + 1)) / (exponent + 1)
    return total


@pytest.mark.parametrize("degree", INTEGRALS)
def test_the_study_finds_the_same_defects(degree):
    element, assembled = transfer_defects(degree)
    assert (element < 1e-13) == (degree <= 3)
    assert (assembled < 1e-13) == (degree == 2)
    assert min(element, assembled) < 1e-13 or element > 1e-4


@pytest.mark.parametrize("degree", DEGREES)
def test_a_uniform_load_is_shared_evenly(degree):
    """The new shares are those of the areas around nodes; standard ones differ, or are negative."""
    shares = dict.fromkeys(lattice_points(degree), Fraction(0))
    for corners in sub_triangles(degree):
        for corner in corners:
            shares[tuple(int(c) for c in corner)] += Fraction(1, 3 * degree**2)
    for node, share in shares.items():
        n_sides = sum(x == 0 for x in node)
        assert share * degree**2 == {0: 2, 1: 1, 2: Fraction(1, 3)}[n_sides]
    points, dx, values, _ = make_triangle(degree).sub_triangle_rule(2)
    lattice = [tuple(point) for point in make_triangle(degree).lattice.tolist()]
    assert 2 * dx @ values == pytest.approx([float(shares[node]) for node in lattice], rel=1e-12)
    assert len(points) == len(dx)


def test_standard_shares_of_a_uniform_load():
    whole = [(1, 0, 0), (0, 1, 0), (0, 0, 1)]

    def standard_share(*node):
        return 2 * integrate_over_triangle(shape_function(node, sum(node)), whole)

    assert [standard_share(2, 0, 0), standard_share(1, 1, 0)] == [0, Fraction(1, 3)]
    assert [standard_share(3, 0, 0), standard_share(2, 1, 0), standard_share(1, 1, 1)] == [
        Fraction(1, 30),
        Fraction(3, 40),
        Fraction(9, 20),
    ]
    assert standard_share(2, 2, 0) < 0


# Tetrahedra of degree 3


def cut_tetrahedron(diagonal):
    """Return the sub-tetrahedra of a tetrahedron of degree 3 and their weights.

    Ten are similar to the whole, one is inverted; each of four octahedra is cut along one of its
    three diagonals, or along all of them with weights 1/3 if `diagonal` is None.
    """
    e = np.eye(4, dtype=int)
    cut = [
        ([tuple(p + e[i]) for i in range(4)], Fraction(1))
        for p in map(np.array, lattice_points(2, 3))
    ]
    cut.append(([tuple(1 - e[i]) for i in range(4)], Fraction(1)))
    for origin in lattice_points(1, 3):
        corner = {
            pair: tuple(np.array(origin) + e[pair[0]] + e[pair[1]])
            for pair in combinations(range(4), 2)
        }
        diagonals = [((0, 1), (2, 3)), ((0, 2), (1, 3)), ((0, 3), (1, 2))]
        chosen = diagonals if diagonal is None else [diagonals[diagonal]]
        for ends in chosen:
            ring = [pair for pair in corner if pair not in ends]
            for a, b in combinations(ring, 2):
                if set(a) & set(b):
                    corners = [corner[p] for p in (*ends, a, b)]
                    cut.append((corners, Fraction(1, len(chosen))))
    return cut


def volume(corners):
    """Return the volume relative to that of the whole tetrahedron."""
    return Fraction(abs(round(np.linalg.det(np.array(corners)))), 81)


def shares_of_body_load(cut):
    shares = dict.fromkeys(lattice_points(3, 3), Fraction(0))
    for corners, weight in cut:
        for corner in corners:
            shares[tuple(int(c) for c in corner)] += weight * volume(corners) / 4
    return shares


def test_the_mean_of_three_cuts_of_a_tetrahedron_does_not_depend_on_the_order_of_vertices():
    for diagonal in (None, 0, 1, 2):
        cut = cut_tetrahedron(diagonal)
        assert sum(weight * volume(corners) for corners, weight in cut) == 1
        shares = shares_of_body_load(cut)
        depends_on_order = any(
            shares[tuple(node[i] for i in order)] != share
            for node, share in shares.items()
            for order in permutations(range(4))
        )
        assert depends_on_order == (diagonal is not None)
    mean = shares_of_body_load(cut_tetrahedron(None))
    assert all(share > 0 for share in mean.values())
    by_kind = {tuple(sorted(node)): share for node, share in mean.items()}
    assert by_kind == {
        (0, 0, 0, 3): Fraction(1, 108),
        (0, 0, 1, 2): Fraction(7, 162),
        (0, 1, 1, 1): Fraction(1, 9),
    }
    # on a face the sub-tetrahedra leave the nine sub-triangles of the triangle, whatever the cut
    for diagonal in (None, 0, 1, 2):
        facets = {
            tuple(sorted(corner for corner in corners if corner[0] == 0))
            for corners, _ in cut_tetrahedron(diagonal)
            if sum(corner[0] == 0 for corner in corners) == 3
        }
        assert len(facets) == 9
