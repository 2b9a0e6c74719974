"""Nodal fluxes: exact where the field is linear, conserved always, refused where they are none."""

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx.mesh import CellType, create_box, create_rectangle, exterior_facet_indices

from pw_elements import (
    Reduction,
    Spaces,
    assemble_matrix,
    assemble_vector,
    nodal_flux,
    reactions,
    solve,
)
from pw_elements.meshes import mapped
from study.verification.t_identity import distorted

CELLS = {
    CellType.triangle: 2,
    CellType.quadrilateral: 2,
    CellType.tetrahedron: 3,
    CellType.hexahedron: 3,
}
SLOPE = np.array([1.3, -0.7, 0.4])


def side(x):
    return np.isclose(x[0], 0.0)


def solved(cell, method, components=0, n=3, field=None, source=0.0):
    """Reactions of div grad u = -source with u prescribed all around, u linear unless given."""
    dim = CELLS[cell]
    build, corners = (create_rectangle if dim == 2 else create_box), [(0.0,) * dim, (1.0,) * dim]
    mesh = mapped(build(MPI.COMM_SELF, corners, [n] * dim, cell), distorted)
    spaces = method(mesh, components)
    U = spaces.trial
    u, v = ufl.TrialFunction(U), ufl.TestFunction(spaces.test)
    g = fem.Function(U)

    def linear(x):
        value = SLOPE[:dim] @ x[:dim]
        return np.array([(k + 1) * value for k in range(components)]) if components else value

    g.interpolate(field or linear)
    mesh.topology.create_connectivity(dim - 1, dim)
    rim = fem.locate_dofs_topological(U, dim - 1, exterior_facet_indices(mesh.topology))
    K = assemble_matrix(ufl.inner(ufl.grad(u), ufl.grad(v)) * ufl.dx)
    q = fem.Constant(mesh, np.full(components, source) if components else np.float64(source))
    f = assemble_vector(ufl.inner(q, v) * ufl.dx)
    a = solve(K, f, Reduction.dirichlet(U, fem.dirichletbc(g, rim)))
    return spaces, reactions(K, a, f), f


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("components", [0, 2])
def test_an_even_flux_is_exact_at_every_node(cell, components):
    expected = -SLOPE[0] * np.arange(1, components + 1) if components else -SLOPE[0]
    ways = [
        (Spaces.petrov_galerkin, {}),
        (Spaces.petrov_galerkin, {"area": "own"}),
        (Spaces.galerkin, {"evened": True}),
    ]
    if cell != CellType.tetrahedron:
        ways.append((Spaces.galerkin, {"area": "own"}))
    for method, options in ways:
        spaces, r, _ = solved(cell, method, components)
        heat = nodal_flux(spaces, r, side, **options)
        inside = ~heat.surface.rim
        assert inside.any()
        assert np.abs(heat.flux[inside] - expected).max() < 1e-12, options


def test_reactions_of_standard_elements_zigzag_over_geometric_areas():
    spaces, r, _ = solved(CellType.triangle, Spaces.galerkin)
    heat = nodal_flux(spaces, r, side)
    share = np.sort(heat.flux[~heat.surface.rim] / -SLOPE[0])
    assert share == pytest.approx([2 / 3] * 2 + [4 / 3] * 3, rel=1e-12)


def test_corners_of_standard_tetrahedra_have_no_flux_over_own_areas():
    spaces, r, _ = solved(CellType.tetrahedron, Spaces.galerkin)
    heat = nodal_flux(spaces, r, side, area="own")
    vertices = np.unique(heat.surface.edges[:, 1:])
    assert np.isnan(heat.flux[vertices]).all()
    assert np.isnan(heat.flux).sum() == len(vertices)


@pytest.mark.parametrize("method", [Spaces.galerkin, Spaces.petrov_galerkin])
def test_all_that_enters_is_what_the_source_takes(method):
    def field(x):
        return np.sin(3 * x[0]) * x[1]

    spaces, r, f = solved(CellType.tetrahedron, method, field=field, source=-2.0)
    heat = nodal_flux(spaces, r, lambda x: x[0] > -1.0)
    assert heat.reaction.sum() == pytest.approx(-f.sum(), abs=1e-12)
    assert heat.surface.tributary_area.sum() == pytest.approx(6.0, rel=0.1)  # moved vertices
    assert (heat.flux * heat.surface.tributary_area).sum() == pytest.approx(-f.sum(), abs=1e-12)


def test_a_depth_divides():
    spaces, r, _ = solved(CellType.triangle, Spaces.petrov_galerkin)
    thin, thick = (nodal_flux(spaces, r, side, depth=depth) for depth in (1.0, 4.0))
    assert np.allclose(thin.flux, 4 * thick.flux, rtol=1e-14)
