"""User elements for Abaqus: equal to the library, through the interface of UEL.

Nothing here runs in Abaqus. `HostProgram` plays its part.
"""

import ctypes
import shutil
import subprocess
import sys
from pathlib import Path

from mpi4py import MPI

import basix
import basix.ufl
import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx.mesh import create_mesh

from pw_elements import Body, Material, Spaces, as_function, assemble_matrix, assemble_vector
from pw_elements import boundary_measure
from pw_elements._compat import cell_geometry_nodes
from pw_elements.abaqus import abaqus_nodes_and_facets_in_dolfinx_order
from pw_elements.elasticity import StressState
from pw_elements.user_element import generate_user_element
from tests.library.uel_host import (
    FORCE,
    FREQUENCY,
    MASS,
    PERTURBATION,
    STIFFNESS,
    call_user_element,
    compile_user_element,
)

COMM = MPI.COMM_SELF
TOLERANCE = 1e-12
KINDS = [
    ("triangle", "plane strain", "linear"),
    ("triangle", "plane stress", "linear"),
    ("triangle", "axisymmetric", "linear"),
    ("tetrahedron", "solid", "linear"),
    ("triangle", "plane strain", "neo-hookean"),
]
YOUNGS_MODULUS, POISSONS_RATIO, DENSITY, THICKNESS = 210e3, 0.3, 7.85e-9, 2.5
N_RANDOM_CELLS = 200  # per kind; half of them are curved


class RandomCells:
    """Random disjoint cells as a body of the library, and as user elements.

    Args:
        kind: cell, state of stress and law.
        degree: 1 for straight cells, 2 for curved ones.
    """

    def __init__(self, kind, degree):
        self.cell, self.state, self.law = kind
        random = np.random.default_rng(59)
        self.node_order, facet_order = abaqus_nodes_and_facets_in_dolfinx_order(self.cell, 2)
        self.dolfinx_facets = [facet_order.index(n) for n in range(len(facet_order))]
        points = basix.create_element(
            basix.ElementFamily.P, basix.CellType[self.cell], 2, basix.LagrangeVariant.gll_warped
        ).points
        dim = points.shape[1]
        self.dim, n_cells = dim, N_RANDOM_CELLS // 2
        x = []
        while len(x) < n_cells:
            edges = random.uniform(-1, 1, (dim, dim)) * 10 ** random.uniform(-1, 1)
            size = np.linalg.norm(edges, axis=0).prod()
            if abs(np.linalg.det(edges)) < 0.25 * size:
                continue
            nodes = points @ edges
            if degree == 2:
                shift = random.uniform(-0.02, 0.02, (len(points) - dim - 1, dim))
                nodes[dim + 1 :] += shift * np.abs(edges).max(axis=0)
            nodes[:, 0] += 50.0 * (1 + len(x))  # disjoint, and away from the axis of rotation
            x.append(nodes)
        x = np.array(x)
        n_geometry = len(points) if degree == 2 else dim + 1
        mesh = create_mesh(
            COMM,
            cells=np.arange(n_cells * n_geometry).reshape(n_cells, -1),
            x=x[:, :n_geometry].reshape(-1, dim),
            e=basix.ufl.element("Lagrange", self.cell, degree, shape=(dim,)),
        )
        self.mesh = mesh
        # in the library's order of the cells, whose nodes keep their order in a cell
        self.x = x[mesh.topology.original_cell_index]
        assert np.allclose(
            mesh.geometry.x[cell_geometry_nodes(mesh)][:, :, :dim], self.x[:, :n_geometry]
        )
        material = Material(YOUNGS_MODULUS, POISSONS_RATIO, DENSITY)
        thickness = THICKNESS if self.state.startswith("plane") else 1.0
        self.body = Body(Spaces.petrov_galerkin(mesh), material, self.state, thickness)
        space = self.body.spaces.trial
        self.dofs = (space.dofmap.list[:, :, None] * dim + np.arange(dim)).reshape(n_cells, -1)
        self.u = fem.Function(space)
        scale = 0.015 if self.law == "neo-hookean" else 1e-3
        extent = np.ptp(self.x, axis=1).min(axis=1)
        for dofs, size in zip(self.dofs, extent, strict=True):
            self.u.x.array[dofs] = random.uniform(-scale, scale, len(dofs)) * size
        self.properties = [YOUNGS_MODULUS, POISSONS_RATIO, DENSITY]
        self.properties += [THICKNESS] if self.state.startswith("plane") else []

    def to_abaqus(self, values):
        """Reorder the rows (dofs, ...) of an element from the library's order to Abaqus'."""
        reordered = np.empty_like(values)
        nodes = np.array(self.node_order)
        reordered[(nodes[:, None] * self.dim + np.arange(self.dim)).ravel()] = values
        return reordered

    def matrices(self, form):
        """Return the element matrices (cells, dofs, dofs) of a form in Abaqus' order."""
        matrix = assemble_matrix(form)
        rows = [matrix.getValues(dofs.astype(np.int32), dofs.astype(np.int32)) for dofs in self.dofs]
        return np.array([self.to_abaqus(self.to_abaqus(A).T).T for A in rows])

    def vectors(self, form):
        """Return the element vectors (cells, dofs) of a form in Abaqus' order."""
        vector = assemble_vector(form).array_r
        return np.array([self.to_abaqus(vector[dofs]) for dofs in self.dofs])

    def call(self, function, **request):
        """Call the user element for all cells, at the displacement u."""
        answers = []
        for x, dofs in zip(self.x, self.dofs, strict=True):
            coordinates = np.empty_like(x)
            coordinates[self.node_order] = x
            displacement = self.to_abaqus(self.u.x.array[dofs])
            answer = call_user_element(
                function, coordinates, self.properties, displacement, **request
            )
            assert answer.error == 0
            answers.append(answer)
        return answers


def assert_equal_per_cell(computed, expected):
    """Compare arrays (cells, ...) relative to the largest value of each cell."""
    computed, expected = np.array(computed), np.array(expected)
    assert computed.shape == expected.shape
    assert np.isfinite(computed).all()
    axes = tuple(range(1, expected.ndim))
    size = np.abs(expected).max(axis=axes)
    assert size.min() > 0
    assert (np.abs(computed - expected).max(axis=axes) / size).max() < TOLERANCE


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """Return a function that returns the UEL of a kind, compiled without warnings."""
    libraries = {}

    def compile_kind(kind):
        if kind not in libraries:
            cell, state, law = kind
            element = generate_user_element(cell, StressState(state), law)
            library = compile_user_element(element, tmp_path_factory.mktemp("uel"))
            libraries[kind] = library.uel_, getattr(library, f"{element.name}_")
        return libraries[kind]

    return compile_kind


def neo_hookean_stress(body, u):
    """Return the deformation gradient and the first Piola-Kirchhoff stress, as in the guide."""
    mu = YOUNGS_MODULUS / (2 * (1 + POISSONS_RATIO))
    ratio = 2 * POISSONS_RATIO / (1 - 2 * POISSONS_RATIO)  # of Lamé's constant to mu
    F = ufl.Identity(2) + ufl.grad(u)
    F_T = ufl.inv(F).T
    return F, mu * (F - F_T + ratio * ufl.ln(ufl.det(F)) * F_T)


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("kind", KINDS, ids=" ".join)
def test_element_matrices_and_vectors_are_those_of_the_library(compiled, kind, degree):
    cells, (uel, _) = RandomCells(kind, degree), compiled(kind)
    body, u, is_linear = cells.body, cells.u, kind[2] == "linear"
    if is_linear:
        stiffness = body.stiffness()
        residual = ufl.action(stiffness, u)
    else:
        _, P = neo_hookean_stress(body, u)
        v = ufl.TestFunction(body.spaces.test)
        dx = ufl.dx(metadata={"quadrature_degree": 4})
        residual = THICKNESS * ufl.inner(P, ufl.grad(v)) * dx
        stiffness = ufl.derivative(residual, u, ufl.TrialFunction(body.spaces.trial))
    static = cells.call(uel, is_large=not is_linear)
    stiffnesses, forces = cells.matrices(stiffness), cells.vectors(residual)
    assert_equal_per_cell([answer.matrix for answer in static], stiffnesses)
    assert_equal_per_cell([-answer.force[0] for answer in static], forces)
    asymmetry = np.abs(stiffnesses - stiffnesses.transpose(0, 2, 1)).max()
    assert asymmetry > 0.01 * np.abs(stiffnesses).max()

    frequency = {"procedure": FREQUENCY, "is_perturbation": True, "is_large": not is_linear}
    only_stiffness = cells.call(uel, request=STIFFNESS, **frequency)
    assert_equal_per_cell([answer.matrix for answer in only_stiffness], stiffnesses)
    assert all(np.all(answer.force == 0) for answer in only_stiffness)
    masses = cells.call(uel, request=MASS, **frequency)
    assert_equal_per_cell([answer.matrix for answer in masses], cells.matrices(body.mass()))
    if is_linear:
        # steps that follow one with NLGEOM: the initial stress, as large as the stiffness here
        cells.u.x.array[:] *= 1e3
        prestressed = cells.call(uel, request=STIFFNESS, **frequency | {"is_large": True})
        initial = cells.matrices(body.geometric_stiffness(body.stress(u)))
        assert_equal_per_cell([answer.matrix for answer in prestressed], stiffnesses + initial)
        assert np.abs(initial).max() > 0.1 * np.abs(stiffnesses).max()


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("kind", KINDS, ids=" ".join)
def test_loads_are_those_of_the_library(compiled, kind, degree):
    cells, (uel, _) = RandomCells(kind, degree), compiled(kind)
    cells.u.x.array[:] = 0.0
    mesh, dim, body = cells.mesh, cells.dim, cells.body
    normal, n_facets = ufl.FacetNormal(mesh), dim + 1
    mesh.topology.create_connectivity(dim, dim - 1)
    facets_of_cell = mesh.topology.connectivity(dim, dim - 1).array.reshape(-1, n_facets)
    options = {"request": FORCE, "is_large": kind[2] != "linear"}
    for face, facet in enumerate(cells.dolfinx_facets):
        mask = np.zeros(facets_of_cell.max() + 1, dtype=bool)
        mask[facets_of_cell[:, facet]] = True
        surface = boundary_measure(mesh, mask)
        pressed = cells.call(uel, loads=[(face + 1, 3.0)], **options)
        expected = cells.vectors(body.surface_load(-3.0 * normal, surface))
        assert_equal_per_cell([answer.force[0] for answer in pressed], expected)
        axis = face % dim
        traction = np.eye(dim)[axis] * 4.0
        pulled = cells.call(uel, loads=[(10 * (axis + 1) + face + 1, 4.0)], **options)
        expected = cells.vectors(body.surface_load(traction, surface))
        assert_equal_per_cell([answer.force[0] for answer in pulled], expected)
    force = np.arange(1.0, dim + 1)
    weight = cells.call(uel, loads=[(41 + i, force[i]) for i in range(dim)], **options)
    expected = cells.vectors(body.body_load(force))
    assert_equal_per_cell([answer.force[0] for answer in weight], expected)


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("kind", KINDS, ids=" ".join)
def test_state_variables_are_stresses_of_the_library(compiled, kind, degree):
    cells, (uel, _) = RandomCells(kind, degree), compiled(kind)
    body, u = cells.body, cells.u
    if cells.dim == 3:
        points = basix.geometry(basix.CellType.tetrahedron)
    else:  # centres of the sub-triangles at the corners, and in the middle
        corners = basix.geometry(basix.CellType.triangle)
        points = np.vstack([corners / 2 + 1 / 6, [1 / 3, 1 / 3]])
    if kind[2] == "linear":
        S = body.stress(u)
        out_of_plane = {
            "plane strain": POISSONS_RATIO * (S[0, 0] + S[1, 1]),
            "plane stress": ufl.zero(),
        }.get(kind[1]) if cells.dim == 2 and kind[1] != "axisymmetric" else S[2, 2]
    else:
        F, P = neo_hookean_stress(body, u)
        S = P * F.T / ufl.det(F)
        lame = YOUNGS_MODULUS * POISSONS_RATIO / (1 + POISSONS_RATIO) / (1 - 2 * POISSONS_RATIO)
        out_of_plane = lame * ufl.ln(ufl.det(F)) / ufl.det(F)
    components = [S[0, 0], S[1, 1], out_of_plane, S[0, 1]]
    if cells.dim == 3:
        components += [S[0, 2], S[1, 2]]
    expression = fem.Expression(ufl.as_vector(components), points)
    numbers = np.arange(len(cells.x), dtype=np.int32)
    expected = expression.eval(cells.mesh, numbers).reshape(len(cells.x), -1)
    n_state_variables = expected.shape[1]
    answers = cells.call(
        uel, is_large=kind[2] != "linear", n_state_variables=n_state_variables
    )
    assert n_state_variables == (24 if cells.dim == 3 else 16)
    assert_equal_per_cell([answer.state for answer in answers], expected)
