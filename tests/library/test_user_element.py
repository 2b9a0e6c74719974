"""User elements for Abaqus: equal to the library, through the interface of UEL.

Nothing here runs in Abaqus. `HostProgram` plays its part.
"""

import ctypes
import os
import re
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

from pw_elements import Body, Material, Spaces, assemble_matrix, assemble_vector, boundary_measure
from pw_elements._compat import cell_geometry_nodes
from pw_elements.abaqus import abaqus_nodes_and_facets_in_dolfinx_order
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
        rows = [
            matrix.getValues(dofs.astype(np.int32), dofs.astype(np.int32)) for dofs in self.dofs
        ]
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
            element = generate_user_element(cell, state, law)
            library = compile_user_element(element, tmp_path_factory.mktemp("uel"))
            libraries[kind] = library.uel_, getattr(library, f"{element.name}_")
        return libraries[kind]

    return compile_kind


def neo_hookean_stress(u):
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
        _, P = neo_hookean_stress(u)
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
        out_of_plane = (
            {
                "plane strain": POISSONS_RATIO * (S[0, 0] + S[1, 1]),
                "plane stress": ufl.zero(),
            }.get(kind[1])
            if cells.dim == 2 and kind[1] != "axisymmetric"
            else S[2, 2]
        )
    else:
        F, P = neo_hookean_stress(u)
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
    answers = cells.call(uel, is_large=kind[2] != "linear", n_state_variables=n_state_variables)
    assert n_state_variables == (24 if cells.dim == 3 else 16)
    assert_equal_per_cell([answer.state for answer in answers], expected)


def make_small_triangle(kind=KINDS[0]):
    """Return coordinates (6, 2) of a straight triangle, and its properties."""
    corners = np.array([[2.0, 0.0], [5.0, 0.5], [3.0, 4.0]])
    middles = (corners + np.roll(corners, -1, axis=0)) / 2
    properties = [YOUNGS_MODULUS, POISSONS_RATIO, DENSITY]
    if kind[1].startswith("plane"):
        properties.append(THICKNESS)
    return np.vstack([corners, middles]), properties


def test_perturbation_steps_and_riks_load_vector(compiled):
    uel, _ = compiled(KINDS[0])
    x, properties = make_small_triangle()
    random = np.random.default_rng(1)
    base, change = random.uniform(-1e-3, 1e-3, (2, 12))
    general = call_user_element(uel, x, properties, base, loads=[(2, 7.0)])
    K = general.matrix
    load = general.force[0] + K @ base
    assert np.allclose(general.energy, [0, base @ K @ base / 2, 0, 0, 0, 0, 0, 0], rtol=1e-12)
    # magnitude 7 in the base state, 3 in the perturbation
    options = {"is_perturbation": True, "loads": [(2, 7.0)], "load_changes": [3.0]}
    state = np.arange(16.0)
    perturbed = call_user_element(uel, x, properties, base, state=state, **options)
    assert np.allclose(perturbed.matrix, K, rtol=1e-14)
    assert np.allclose(perturbed.force[0], load * 3 / 7, rtol=1e-12)
    assert np.array_equal(perturbed.state, state)
    output = call_user_element(
        uel, x, properties, base, change, request=PERTURBATION, state=state, **options
    )
    assert np.allclose(output.force[0], load * 3 / 7 - K @ change, rtol=1e-12)
    by_itself = call_user_element(uel, x, properties, change, n_state_variables=16)
    assert np.allclose(output.state, by_itself.state, rtol=1e-12)
    with_nlgeom = call_user_element(uel, x, properties, base, loads=[(2, 7.0)], is_large=True)
    assert np.array_equal(with_nlgeom.matrix, K)  # a general step of small strains is linear
    assert np.array_equal(with_nlgeom.force, general.force)
    riks = call_user_element(
        uel, x, properties, base, n_columns=2, loads=[(2, 7.0)], load_changes=[0.5]
    )
    assert np.allclose(riks.force, [general.force[0], load * 0.5 / 7], rtol=1e-12)


def test_coordinates_may_have_a_third_component(compiled):
    uel, _ = compiled(KINDS[0])
    x, properties = make_small_triangle()
    plane = call_user_element(uel, x, properties)
    in_space = call_user_element(uel, x, properties, coordinates_per_node=3)
    assert np.array_equal(plane.matrix, in_space.matrix)


def flatten(x):
    return x * [1.0, 0.0]


def fold(x):
    return np.vstack([x[:3], [x[2]], x[4:]])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"procedure": 11}, "only static steps"),
        ({"request": 6}, "not supported"),
        ({"loads": [(4, 1.0)]}, "distributed load"),
        ({"loads": [(-1, 1.0)]}, "distributed load"),
        ({"loads": [(31, 1.0)]}, "distributed load"),
        ({"loads": [(43, 1.0)]}, "distributed load"),
        ({"n_state_variables": 15}, "too few PROPERTIES or VARIABLES"),
        ({"properties": [1.0, 0.5, 1.0, 1.0]}, "Poisson's ratio > -1 and < 0.5"),
        ({"properties": [1.0, 0.3, 1.0, 0.0]}, "thickness > 0"),
        ({"properties": [1.0, 0.3, 1.0]}, "too few PROPERTIES"),
        ({"coordinates": flatten}, "flat, or folded"),
        ({"coordinates": fold}, "flat, or folded"),
        ({"coordinates": lambda x: x[:3]}, "wrong number of nodes"),
    ],
)
def test_what_an_element_cannot_do_is_an_error(compiled, capfd, changes, message):
    _, function = compiled(KINDS[0])
    x, properties = make_small_triangle()
    changes = changes.copy()
    arguments = changes.pop("coordinates", lambda x: x)(x), changes.pop("properties", properties)
    answer = call_user_element(function, *arguments, **changes)
    assert answer.error == 1
    assert message in capfd.readouterr().err
    assert call_user_element(function, x, properties).error == 0


def test_negative_radii_are_an_error(compiled, capfd):
    _, function = compiled(KINDS[2])
    x, properties = make_small_triangle(KINDS[2])
    assert call_user_element(function, x, properties).error == 0
    assert call_user_element(function, x - [2.5, 0.0], properties).error == 1
    assert "radius" in capfd.readouterr().err


def test_large_strains_need_nlgeom_and_ask_for_smaller_increments(compiled, capfd):
    _, function = compiled(KINDS[4])
    x, properties = make_small_triangle()
    assert call_user_element(function, x, properties).error == 1
    assert "NLGEOM" in capfd.readouterr().err
    inside_out = (x * [-2.0, 0.0]).ravel()
    answer = call_user_element(function, x, properties, inside_out, is_large=True)
    assert answer.error == 0
    assert answer.next_increment_ratio < 1
    assert np.all(answer.force == 0)
    stretched = (x * [0.2, 0.0]).ravel()
    answer = call_user_element(function, x, properties, stretched, is_large=True)
    assert answer.next_increment_ratio > 1
    assert np.abs(answer.force).max() > 0


def test_an_error_ends_the_program_that_calls_uel(compiled):
    """UEL itself has no flag of errors, so that it ends the program."""
    compiled(KINDS[0])
    library = next(
        line.split()[-1]
        for line in Path("/proc/self/maps").read_text().splitlines()
        if line.endswith("pw_t6_plane_strain.so")
    )
    assert ctypes.CDLL(library).uel_
    program = (
        "import ctypes, numpy as np\n"
        "from tests.library.uel_host import call_user_element\n"
        f"uel = ctypes.CDLL({library!r}).uel_\n"
        "call_user_element(uel, np.zeros((6, 2)), [1.0, 0.3, 1.0, 1.0])\n"
        "print('alive')\n"
    )
    process = subprocess.run(
        [sys.executable, "-c", program],
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        check=False,
    )
    assert process.returncode == 1
    assert "alive" not in process.stdout
    assert "element 7: it is flat" in process.stderr


def run_command(*arguments):
    return subprocess.run(
        [sys.executable, "-m", "pw_elements.user_element", *map(str, arguments)],
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        check=False,
    )


def test_the_command_writes_both_files_and_replaces_only_its_own(tmp_path):
    options = ["--cell", "triangle", "--state", "plane-stress", "--out", tmp_path / "my element.c"]
    for _ in range(2):  # the second time, the files are replaced
        assert run_command(*options).returncode == 0
        element = generate_user_element("triangle", "plane stress")
        # the order of statements in FFCx's functions differs from process to process
        written, generated = (
            text.split("typedef void kernel")[0]
            for text in ((tmp_path / "my element.c").read_text(), element.c_source)
        )
        assert written == generated
        assert (tmp_path / "my element.f").read_text() == element.fortran_source
        (tmp_path / "my element.c").write_text("NEVER RUN IN ABAQUS, and old")
    (tmp_path / "my element.f").write_text("      SUBROUTINE UMAT\n")
    refused = run_command(*options)
    assert refused.returncode == 2
    assert "my element.f" in refused.stderr
    assert (tmp_path / "my element.f").read_text() == "      SUBROUTINE UMAT\n"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--cell", "triangle", "--state", "solid", "--out", "x.c"], "tetrahedra need 'solid'"),
        (["--cell", "tetrahedron", "--state", "axisymmetric", "--out", "x.c"], "triangles another"),
        (["--cell", "triangle", "--state", "plane-strain", "--out", "x.f"], "end with .c"),
        (
            [
                *("--cell", "triangle", "--state", "axisymmetric"),
                "--law",
                "neo-hookean",
                "--out",
                "x.c",
            ],
            "plane strain only",
        ),
        (["--cell", "triangle", "--state", "plane-strain", "--out", "no/x.c"], "no"),
    ],
)
def test_the_command_refuses_other_elements(options, message):
    process = run_command(*options)
    assert process.returncode == 2
    assert message in process.stderr
    assert "Traceback" not in process.stderr


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("hexahedron", "solid"), "cell 'hexahedron': the cells are triangle, tetrahedron"),
        (("triangle", "plane"), "state 'plane': the states are 'plane stress'"),
        (("triangle", "plane strain", "mooney"), "law 'mooney': the laws are linear"),
    ],
)
def test_unknown_elements_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        generate_user_element(*arguments)


@pytest.mark.parametrize("kind", KINDS, ids=" ".join)
def test_the_text_at_the_top_describes_the_element(kind):
    cell, state, law = kind
    element = generate_user_element(cell, state, law)
    top, _, code = element.c_source.partition("*/")
    assert "NEVER RUN IN ABAQUS" in top
    assert "NEVER RUN IN ABAQUS" in element.fortran_source
    assert "Python.h" not in code
    assert "ufcx" not in code
    assert set(re.findall(r"#include <(.*)>", code)) == {
        "math.h",
        "stdio.h",
        "stdlib.h",
        "string.h",
    }
    assert re.search(r"Eq\. \((10|12)\)", top)
    n_nodes, n_properties, n_variables = (
        (10, 3, 24) if cell == "tetrahedron" else (6, 4 if state.startswith("plane") else 3, 16)
    )
    line = (
        f"*USER ELEMENT, TYPE=U1, NODES={n_nodes}, COORDINATES={n_nodes // 4 + 1}, "
        f"PROPERTIES={n_properties}, VARIABLES={n_variables}, UNSYMM"
    )
    assert line in top
    assert max(map(len, element.fortran_source.splitlines())) <= 72  # fixed form


FORTRAN_COMPILER = os.environ.get("FC") or shutil.which("gfortran")
XIT_THAT_ENDS_WITH_STATUS_3 = "      SUBROUTINE XIT\n      STOP 3\n      END\n"


@pytest.mark.skipif(
    FORTRAN_COMPILER is None, reason="there is no gfortran: UEL in Fortran is NOT TESTED here"
)
@pytest.mark.parametrize("kind", [KINDS[0], KINDS[3]], ids=" ".join)
def test_uel_in_fortran_equals_that_in_c(compiled, tmp_path, kind):
    cell, state, law = kind
    element = generate_user_element(cell, state, law)
    sources = {"element.c": element.c_source, "uel.f": element.fortran_source}
    sources["xit.f"] = XIT_THAT_ENDS_WITH_STATUS_3
    objects = []
    for name, text in sources.items():
        path = tmp_path / name
        path.write_text(text)
        objects.append(path.with_suffix(".o"))
        if name.endswith(".c"):
            compiler = [*os.environ.get("CC", "gcc").split(), "-DPW_UEL_IN_FORTRAN"]
        else:
            compiler = [*FORTRAN_COMPILER.split(), "-Wall", "-Wextra", "-Wpedantic", "-Werror"]
        command = [*compiler, "-fPIC", "-O2", "-c", path, "-o", objects[-1]]
        subprocess.run([str(part) for part in command], check=True)
    library = tmp_path / "uel.so"
    command = [*FORTRAN_COMPILER.split(), "-shared", "-o", library, *objects, "-lm"]
    subprocess.run([str(part) for part in command], check=True)
    in_fortran = ctypes.CDLL(str(library)).uel_
    cells, (in_c, _) = RandomCells(kind, 2), compiled(kind)
    loads = [(1, 3.0), (12, 4.0), (42, 5.0)]
    for answer, expected in zip(
        cells.call(in_fortran, loads=loads), cells.call(in_c, loads=loads), strict=True
    ):
        for name in ("force", "matrix", "state", "energy"):
            assert np.allclose(
                getattr(answer, name), getattr(expected, name), rtol=1e-12, atol=1e-12
            )
    n_nodes, dim = cells.x.shape[1:]
    program = (
        "import ctypes, numpy as np\n"
        "from tests.library.uel_host import call_user_element\n"
        f"uel = ctypes.CDLL({str(library)!r}).uel_\n"
        f"call_user_element(uel, np.zeros(({n_nodes}, {dim})), {cells.properties})\n"
    )
    process = subprocess.run(
        [sys.executable, "-c", program],
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        check=False,
    )
    assert process.returncode == 3  # by XIT
    assert "element 7: it is flat" in process.stderr
