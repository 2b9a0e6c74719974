"""Solvability and uniqueness (section E): matrices of the map, guards, and two solutions."""

import logging

import numpy as np
import pytest
import sympy as sp
from scipy.spatial import cKDTree

from pw_elements import Body, Material, Reduction, Spaces, assemble_matrix, prescribe
from pw_elements.contact import ContactPair, Plane, solve_contact
from pw_elements.elasticity.incompressibility import (
    bulk_over_shear,
    max_bulk_over_shear_without_pressure,
)
from study.benchmarks.e_element.page import AMBIGUOUS_CONTACT, ELEMENTS, GEOMETRIES
from study.benchmarks.e_element.solvability import (
    CELL_BY_ELEMENT,
    POISSONS_RATIOS,
    MeshParameters,
    closed_sets,
    contact_stiffness,
    list_meshes,
    make_mesh,
    measure_displacements,
    node_positions,
    topology_of,
    two_solutions,
)
from study.model.matrices import to_dense_array
from study.run import records
from tests.library.near_incompressible import measure_singularity

# linear maps of regular meshes would tilt the base, which the library's function finds by x = 0
SHIFT_BY_GEOMETRY = {"affine": 0.0, "straight": 0.2, "curved": 0.05}


@pytest.mark.parametrize("element", sorted(set(CELL_BY_ELEMENT) - {"Q8"}))
@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_matrices_of_the_map_are_those_of_the_library(element, geometry):
    parameters = MeshParameters(element, geometry, "layers", 3.0, SHIFT_BY_GEOMETRY[geometry], 5)
    ratios = (0.3, 0.499)
    measured = measure_displacements(parameters, ratios)
    expected = measure_singularity(make_mesh(parameters), ratios)
    for mine, library in zip(measured, expected, strict=True):
        assert mine.sigma_min == pytest.approx(library.least, rel=1e-8)
        assert mine.symmetric_min == pytest.approx(library.energy, rel=1e-8)
        assert mine.is_negative == (library.sign < 0)


def recorded_map(element, geometry):
    return records.read_rows(records.COSTLY_CASES)[f"E/map-{element}-{geometry}"].content["scalars"]


@pytest.mark.parametrize("element", sorted(set(ELEMENTS) - {"pw-Q8"}))
@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_bodies_warn_of_the_worst_meshes_of_the_map(element, geometry, caplog):
    """Beyond the limit a body warns of the worst mesh, and up to the limit no mesh is bad."""
    scalars = recorded_map(element, geometry)
    for nu in POISSONS_RATIOS:
        sigma = scalars[f"sigma_min_compact_{nu:g}"]
        n_negative = scalars[f"negative_compact_{nu:g}"]
        place = int(scalars[f"worst_compact_{nu:g}"])
        mesh = make_mesh(list_meshes(element.removeprefix("pw-"), geometry, "compact")[place])
        is_beyond = bulk_over_shear(nu) > max_bulk_over_shear_without_pressure(mesh)
        if n_negative or sigma < 0.005:
            assert is_beyond
        if not is_beyond:
            continue
        caplog.clear()
        state = "plane strain" if mesh.geometry.dim == 2 else "solid"
        with caplog.at_level(logging.WARNING, "pw_elements"):
            Body(Spaces.petrov_galerkin(mesh), Material(1.0, nu), state)
        assert "may be singular there" in caplog.text


@pytest.mark.parametrize("case", AMBIGUOUS_CONTACT)
def test_the_library_finds_one_of_two_solutions(case):
    """A plane above the body and nodal loads have two solutions, both exact.

    They are checked with the library's stiffness, and the library's contact finds one of them.
    """
    element, geometry, nu, shift, seed = case
    parameters = MeshParameters(element.removeprefix("pw-"), geometry, "layers", 1.0, shift, seed)
    S = contact_stiffness(parameters, nu)
    gap_1, force_1, gap_2, force_2 = two_solutions(S, closed_sets(len(S), seed))
    assert all(np.minimum(g, r).max() == 0 for g, r in ((gap_1, force_1), (gap_2, force_2)))
    assert np.abs(gap_1 - gap_2).max() > 0

    mesh = make_mesh(parameters)
    dim = mesh.geometry.dim
    spaces = Spaces.petrov_galerkin(mesh)
    U = spaces.trial
    body = Body(spaces, Material(2 * (1 + nu), nu), "plane strain" if dim == 2 else "solid")
    K = assemble_matrix(body.stiffness())
    base = [prescribe(U, i, lambda x: np.isclose(x[dim - 1], 0.0)) for i in range(dim)]
    dense = to_dense_array(K)
    x = U.tabulate_dof_coordinates()
    lattice = topology_of(parameters.element).lattice
    positions = node_positions(parameters)[lattice[:, -1] == lattice[:, -1].max()]
    distances, top = cKDTree(x[:, :dim]).query(positions)
    assert len(top) == len(S)
    assert distances.max() < 1e-12
    held = np.flatnonzero(np.isclose(x[:, dim - 1], 0.0))
    contact = top * dim + dim - 1
    free = np.setdiff1d(
        np.arange(len(dense)), np.concatenate([contact, (held[:, None] * dim + range(dim)).ravel()])
    )
    response = np.linalg.solve(dense[np.ix_(free, free)], dense[np.ix_(free, contact)])
    schur = dense[np.ix_(contact, contact)] - dense[np.ix_(contact, free)] @ response
    assert schur == pytest.approx(S, abs=1e-8 * np.abs(S).max())

    scale = 0.01 / max(gap_1.max(), gap_2.max())
    height = x[top, dim - 1].max()
    initial_gap = height - x[top, dim - 1]
    loads = K.createVecRight()
    values = np.zeros(len(dense))
    values[contact] = scale * (force_1 - S @ gap_1) + schur @ initial_gap
    loads.setArray(values)
    normal = np.zeros(dim)
    normal[-1] = -1.0
    point = np.zeros(dim)
    point[-1] = height
    pair = ContactPair(
        lambda y: cKDTree(positions).query(y[:dim].T)[0] < 1e-12,
        Plane(point, normal),
    )
    (state,) = solve_contact(K, loads, Reduction.dirichlet(U, base), pair, U)
    found = initial_gap - state.unknowns.array_r[contact]
    differences = [np.abs(found - scale * gap).max() / 0.01 for gap in (gap_1, gap_2)]
    assert min(differences) < 1e-6 < max(differences)


def test_contact_minors_of_straight_triangles_are_those_of_the_proof():
    """Principal minors of T S, with a symmetric S, in exact fractions.

    If each vertex of a set of nodes has its neighbours in the set, the minor is that of T times
    that of S. Otherwise reactions at other middles, R = S_ma S_aa^-1, enter.
    """
    n = 5
    T = sp.diag(1, sp.Rational(3, 4), 1, sp.Rational(3, 4), 1)
    for middle in (1, 3):
        for end in (middle - 1, middle + 1):
            T[end, middle] = sp.Rational(1, 8)
    A = sp.Matrix(n, n, lambda i, j: (3 * i + 5 * j + i * j) % 7 - 3)
    S = A.T * A + sp.eye(n)
    for a in ([0, 1], [1], [1, 2, 3], [0, 1, 2, 3, 4], [1, 3]):
        assert (T * S).extract(a, a).det() == (T.extract(a, a).det() * S.extract(a, a).det())
    for a in ([2], [0, 2], [2, 3], [0, 2, 4]):
        middles = [m for m in (1, 3) if m not in a]
        R = S.extract(middles, a) * S.extract(a, a).inv()
        factor = T.extract(a, a) + T.extract(a, middles) * R
        assert (T * S).extract(a, a) == factor * S.extract(a, a)
        assert (T * S).extract(a, a).det() != T.extract(a, a).det() * S.extract(a, a).det()
