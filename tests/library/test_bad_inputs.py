"""Bad inputs over the whole public API: the library says what is wrong, and returns nothing.

Each case is one small call. It has to end in an error of a documented type, which the library
raises itself: a `raise` in one of its files is the last line of the traceback.
"""

# ruff: noqa: ARG001, ARG005 (cases are functions of what they do not need)

import signal
import traceback
from functools import cached_property
from pathlib import Path

from mpi4py import MPI
from petsc4py import PETSc

import basix.ufl
import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx.mesh import CellType, create_mesh, create_unit_cube, meshtags

import pw_elements
from pw_elements import (
    Body,
    Direct,
    Material,
    NoModes,
    Reduction,
    SingularSystem,
    Spaces,
    SurfaceNodes,
    as_function,
    assemble_matrix,
    assemble_vector,
    boundary_measure,
    buckling,
    force_transfer,
    forces_along,
    lumped_mass,
    prescribe,
    reactions,
    solve,
    test_space,
    vibration_modes,
)
from pw_elements._compat import cell_nodes
from pw_elements.algebra import symmetric_part
from pw_elements.contact import (
    ContactFailed,
    ContactPair,
    ContactProblem,
    FlatPunch,
    Motion,
    Parabola,
    Plane,
    SignedDistance,
    Sphere,
    solve_contact,
)
from pw_elements.contact.model import MatchingNodes
from pw_elements.elasticity import by_position, nodal_load
from pw_elements.meshes import curved, mapped, on_lines, quadrilaterals, triangles
from pw_elements.spaces import (
    NumberingError,
    composite_element,
    macro_element,
    quadratic_element,
    serendipity_element,
)

LIBRARY = Path(pw_elements.__file__).parent
DOCUMENTED = (
    TypeError,
    ValueError,
    OSError,
    SingularSystem,
    NoModes,
    NumberingError,
    ContactFailed,
)
SECONDS = 60
COMM = MPI.COMM_SELF
PLANE = "plane stress"
STEEL = Material(10.0, 0.3)
NAN, INF = float("nan"), float("inf")


def left(x):
    return np.isclose(x[0], 0.0)


def right(x):
    return np.isclose(x[0], 2.0)


def below(x):
    return np.isclose(x[1], 0.0) & (x[0] > 0.9)


def nowhere(x):
    return x[0] > 99.0


def failing(x):
    raise KeyError("a user's mistake")


def square(n=2, kind=triangles):
    return kind(COMM, (0.0, 0.0), (2.0, 1.0), (2 * n, n))


def made(kind, x, cells):
    """A mesh of given nodes and cells."""
    x = np.array(x, dtype=float)
    element = basix.ufl.element("Lagrange", kind, 1, shape=(x.shape[1],))
    return create_mesh(COMM, cells=np.array(cells), x=x, e=element)


def two_squares(shift):
    one = square()
    x, cells = one.geometry.x[:, :2], cell_nodes(one)
    return made("triangle", np.vstack([x, x + shift]), np.vstack([cells, cells + len(x)]))


class World:
    """Good things, to be combined with a bad one."""

    def __init__(self):
        self.mesh, self.other, self.fine = square(), square(), square(3)
        self.quads = square(kind=quadrilaterals)
        self.bent = curved(square(), lambda x: x + 0.02 * np.sin(3 * x[:, [1, 0, 2]]))
        self.spaces = Spaces.petrov_galerkin(self.mesh)
        self.standard = Spaces.galerkin(self.mesh)
        self.scalar = Spaces.petrov_galerkin(self.mesh, 0)
        self.U = self.spaces.trial
        self.P1 = fem.functionspace(self.mesh, ("Lagrange", 1))
        self.body = Body(self.spaces, STEEL, PLANE)
        self.K, self.M = (assemble_matrix(form()) for form in (self.body.stiffness, self.body.mass))
        self.f = assemble_vector(self.body.body_load((0.0, -1.0)))
        self.ds = boundary_measure(self.mesh, right)
        self.left = [prescribe(self.U, i, left) for i in (0, 1)]
        self.held = Reduction.dirichlet(self.U, self.left)
        self.a = solve(self.K, self.f, self.held)
        self.floor = Plane((0, 0), (0, 1))
        self.pair = ContactPair(below, self.floor, 0.3)
        self.v, self.u = ufl.TestFunction(self.U), ufl.TrialFunction(self.U)

    @cached_property
    def K_sigma(self):
        moved = as_function(self.U, self.a)
        return assemble_matrix(self.body.initial_stress(self.body.stress(moved)))

    @cached_property
    def galerkin(self):
        body = Body(self.standard, STEEL, PLANE)
        return assemble_matrix(body.stiffness()), assemble_vector(body.body_load((0.0, -1.0)))

    @cached_property
    def larger(self):
        """Stiffness, load, supports of a finer mesh."""
        return self.on(self.fine)

    @cached_property
    def twin(self):
        """The same of a mesh of equal size."""
        return self.on(self.other)

    def on(self, mesh):
        body = Body(Spaces.petrov_galerkin(mesh), STEEL, PLANE)
        U = body.spaces.trial
        held = Reduction.dirichlet(U, [prescribe(U, i, left) for i in (0, 1)])
        load = assemble_vector(body.body_load((0.0, -1.0)))
        return assemble_matrix(body.stiffness()), load, held, U

    def constant(self, value):
        return fem.Constant(self.mesh, value)

    def function(self, value, space=None, elsewhere=1.0):
        made = fem.Function(space or self.P1)
        made.x.array[:] = elsewhere
        made.x.array[3] = value
        return made

    def vector(self, value):
        changed = self.f.copy()
        changed.array[3] = value
        return changed

    def matrix(self, value):
        changed = self.K.copy()
        changed.setValue(0, 0, value)
        changed.assemble()
        return changed

    def scaled(self, matrix, factor):
        changed = matrix.copy()
        changed.scale(factor)
        return changed

    def empty(self, rows=30, columns=30, assembled=True):
        matrix = PETSc.Mat().createAIJ((rows, columns), nnz=1, comm=COMM)
        if assembled:
            matrix.assemble()
        return matrix

    def destroyed(self, thing):
        thing.destroy()
        return thing

    def short(self):
        return PETSc.Vec().createSeq(7)

    def box(self):
        return Spaces.petrov_galerkin(create_unit_cube(COMM, 1, 1, 1))

    def surface(self):
        return SurfaceNodes.of(self.body, below)

    def contact(self, **changes):
        given = {
            "K": self.K,
            "loads": self.f,
            "reduction": self.held,
            "pairs": self.pair,
            "space": self.U,
        }
        return solve_contact(**{**given, **changes})

    def folded_contact(self):
        mesh = square()
        K, _, held, U = self.on(mesh)
        moved(mesh, (1.0, 0.5), (2.0, 0.0))
        return ContactProblem(K, held, self.pair, U)

    def problem(self):
        return ContactProblem(self.K, self.held, self.pair, self.U)

    def modes(self, **changes):
        return vibration_modes(
            **{"K": self.K, "M": self.M, "reduction": self.held, "count": 2, **changes}
        )

    def buckles(self, **changes):
        return buckling(**{"K": self.K, "K_sigma": self.K_sigma, "reduction": self.held, **changes})


@pytest.fixture(scope="module")
def w():
    return World()


def moved(mesh, where, by):
    near = np.isclose(mesh.geometry.x[:, :2], where).all(axis=1)
    assert near.any()
    mesh.geometry.x[near, :2] += by
    return mesh


def inverted_curved():
    return moved(curved(square(1), lambda x: x), (0.5, 0.5), (0.6, -0.4))


def moved_later():
    mesh = square()
    Body(Spaces.galerkin(mesh), STEEL, PLANE)
    return moved(mesh, (1.0, 0.5), (2.0, 0.0))


TORN = [[0, 0], [1, 0], [1, 1], [0, 1], [2, 0], [2, 1], [1, 0.5]]
MESHES = {
    "a cell without volume": lambda: made("triangle", [[0, 0], [1, 0], [2, 0]], [[0, 1, 2]]),
    "a quadrilateral that is not convex": lambda: made(
        "quadrilateral", [[0, 0], [1, 0], [0, 1], [0.3, 0.3]], [[0, 1, 2, 3]]
    ),
    "a quadrilateral numbered round": lambda: made(
        "quadrilateral", [[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2, 3]]
    ),
    "a folded mesh": lambda: moved(square(), (1.0, 0.5), (2.0, 0.0)),
    "a curved triangle inside out": inverted_curved,
    "parts that overlap": lambda: two_squares([1.0, 0.5]),
    "the same part twice": lambda: two_squares([0.0, 0.0]),
    "hanging nodes": lambda: made(
        "triangle", TORN, [[0, 1, 2], [0, 2, 3], [1, 4, 6], [6, 4, 5], [6, 5, 2]]
    ),
    "nodes at NaN": lambda: moved(square(), (1.0, 0.5), (NAN, 0.0)),
    "nodes that moved after a first body": moved_later,
    "a line": lambda: made("interval", [[0.0], [1.0]], [[0, 1]]),
    "a surface in space": lambda: made("triangle", [[0, 0, 0], [1, 0, 0], [0, 1, 1]], [[0, 1, 2]]),
}

# a scalar for the modulus, which is to be refused
MODULI = {
    "zero": lambda w: 0.0,
    "negative": lambda w: -5,
    "NaN": lambda w: NAN,
    "infinite": lambda w: INF,
    "a string": lambda w: "210",
    "None": lambda w: None,
    "a bool": lambda w: True,
    "complex": lambda w: 1.0 + 1.0j,
    "a negative 0-d array": lambda w: np.array(-5.0),
    "an array": lambda w: np.array([1.0, 2.0]),
    "a list": lambda w: [1.0],
    "a negative NumPy scalar": lambda w: np.float32(-1.0),
    "a negative integer of NumPy": lambda w: np.int64(-1),
    "a negative Constant": lambda w: w.constant(-5.0),
    "a Constant of NaN": lambda w: w.constant(NAN),
    "a vector Constant": lambda w: w.constant((1.0, 2.0)),
    "a Function negative at a node": lambda w: w.function(-1.0),
    "a Function of NaN at a node": lambda w: w.function(NAN),
    "a vector expression": lambda w: ufl.SpatialCoordinate(w.mesh),
}

CASES = {f"modulus: {name}": lambda w, v=v: Material(v(w)) for name, v in MODULI.items()}
CASES |= {
    f"body on {name}": lambda w, mesh=mesh: Body(Spaces.galerkin(mesh()), STEEL, PLANE)
    for name, mesh in MESHES.items()
}
CASES |= {
    # elements
    "macro_element of a pentagon": lambda w: macro_element("pentagon"),
    "macro_element of None": lambda w: macro_element(None),
    "macro_element of shape 2": lambda w: macro_element("triangle", 2),
    "macro_element of shape (0,)": lambda w: macro_element("triangle", (0,)),
    "macro_element of shape (-1,)": lambda w: macro_element("triangle", (-1,)),
    "macro_element of shape (1.5,)": lambda w: macro_element("triangle", (1.5,)),
    "macro_element of shape xy": lambda w: macro_element("triangle", "xy"),
    "quadratic_element of a prism": lambda w: quadratic_element("prism"),
    "quadratic_element of a CellType": lambda w: quadratic_element(CellType.triangle),
    "serendipity_element of shape 2": lambda w: serendipity_element(2),
    "composite_element of shape (0,)": lambda w: composite_element((0,)),
    # spaces
    "Spaces of None": lambda w: Spaces(None, None),
    "Spaces of two meshes": lambda w: Spaces(w.U, Spaces.galerkin(w.fine).trial),
    "Spaces of two degrees": lambda w: Spaces(w.scalar.trial, w.P1),
    "Spaces of a mesh": lambda w: Spaces(w.mesh, w.mesh),
    "petrov_galerkin of None": lambda w: Spaces.petrov_galerkin(None),
    "petrov_galerkin of a space": lambda w: Spaces.petrov_galerkin(w.U),
    "petrov_galerkin of -1 components": lambda w: Spaces.petrov_galerkin(w.mesh, -1),
    "petrov_galerkin of 1.5 components": lambda w: Spaces.petrov_galerkin(w.mesh, 1.5),
    "galerkin of '2' components": lambda w: Spaces.galerkin(w.mesh, "2"),
    "galerkin of True components": lambda w: Spaces.galerkin(w.mesh, True),
    "serendipity of triangles": lambda w: Spaces.serendipity(w.mesh),
    "serendipity of None": lambda w: Spaces.serendipity(None),
    "composite of quadrilaterals": lambda w: Spaces.composite(w.quads),
    "composite of curved cells": lambda w: Spaces.composite(w.bent),
    "composite of -2 components": lambda w: Spaces.composite(w.mesh, -2),
    "test_space of a linear space": lambda w: test_space(w.P1),
    "test_space of None": lambda w: test_space(None),
    "test_space of a mesh": lambda w: test_space(w.mesh),
    "test_space of a test space": lambda w: test_space(w.spaces.test),
    "as_function on a mesh": lambda w: as_function(w.mesh, w.f),
    "as_function of an array": lambda w: as_function(w.U, w.f.array),
    "as_function of a short vector": lambda w: as_function(w.U, w.short()),
    "as_function of another space": lambda w: as_function(w.P1, w.f),
    "as_function named 3": lambda w: as_function(w.U, w.f, 3),
    # material, body
    "nu 0.6": lambda w: Material(1.0, 0.6),
    "nu -1": lambda w: Material(1.0, -1.0),
    "nu a 0-d array of 0.7": lambda w: Material(1.0, np.array(0.7)),
    "nu a Constant of 0.7": lambda w: Material(1.0, w.constant(0.7)),
    "nu a Function of 0.7": lambda w: Material(1.0, w.function(0.7, elsewhere=0.3)),
    "nu a string": lambda w: Material(1.0, "0.3"),
    "density 0": lambda w: Material(1.0, 0.3, 0.0),
    "density a 0-d array of -1": lambda w: Material(1.0, 0.3, np.array(-1.0)),
    "density None": lambda w: Material(1.0, 0.3, None),
    "body of one space": lambda w: Body(w.U, STEEL, PLANE),
    "body of a mesh": lambda w: Body(w.mesh, STEEL, PLANE),
    "body of a number for a material": lambda w: Body(w.spaces, 210.0, PLANE),
    "body with material and spaces exchanged": lambda w: Body(STEEL, w.spaces, PLANE),
    "body of scalars": lambda w: Body(w.scalar, STEEL, PLANE),
    "body of three components in 2-D": lambda w: Body(Spaces.galerkin(w.mesh, 3), STEEL, PLANE),
    "body in no state": lambda w: Body(w.spaces, STEEL, None),
    "body in the state 3": lambda w: Body(w.spaces, STEEL, 3),
    "body in a misspelt state": lambda w: Body(w.spaces, STEEL, "plane stres"),
    "body in 2-D as a solid": lambda w: Body(w.spaces, STEEL, "solid"),
    "body in 3-D in plane strain": lambda w: Body(w.box(), STEEL, "plane strain"),
    "body across the axis": lambda w: Body(
        Spaces.galerkin(triangles(COMM, (-1.0, 0.0), (1.0, 1.0), (2, 1))), STEEL, "axisymmetric"
    ),
    "nu 0.5 in plane strain": lambda w: Body(w.spaces, Material(1.0, 0.5), "plane strain"),
    "nu a Constant of 0.5 in plane strain": lambda w: Body(
        w.spaces, Material(1.0, w.constant(0.5)), "plane strain"
    ),
    "nu a Function of 0.5 in plane strain": lambda w: Body(
        w.spaces, Material(1.0, w.function(0.5, elsewhere=0.3)), "plane strain"
    ),
    "thickness 0": lambda w: Body(w.spaces, STEEL, PLANE, 0.0),
    "thickness a 0-d array of -1": lambda w: Body(w.spaces, STEEL, PLANE, np.array(-1.0)),
    "thickness NaN": lambda w: Body(w.spaces, STEEL, PLANE, NAN),
    "thickness a string": lambda w: Body(w.spaces, STEEL, PLANE, "1"),
    "thickness None": lambda w: Body(w.spaces, STEEL, PLANE, None),
    "thickness a negative Constant": lambda w: Body(w.spaces, STEEL, PLANE, w.constant(-1.0)),
    "thickness a negative Function": lambda w: Body(w.spaces, STEEL, PLANE, w.function(-1.0)),
    "quadrature degree -1": lambda w: Body(w.spaces, STEEL, PLANE, 1.0, -1),
    "quadrature degree 2.5": lambda w: Body(w.spaces, STEEL, PLANE, 1.0, 2.5),
    "quadrature degree True": lambda w: Body(w.spaces, STEEL, PLANE, 1.0, True),
    "quadrature degree a string": lambda w: Body(w.spaces, STEEL, PLANE, 1.0, "4"),
    "material on another mesh": lambda w: assemble_matrix(
        Body(
            w.spaces, Material(1.0 + w.function(1.0, fem.functionspace(w.other, ("DG", 0)))), PLANE
        ).stiffness()
    ),
    # loads
    "traction a number": lambda w: w.body.surface_load(1.0, w.ds),
    "traction a string": lambda w: w.body.surface_load("xy", w.ds),
    "traction of three components": lambda w: w.body.surface_load((1.0, 2.0, 3.0), w.ds),
    "traction of NaN": lambda w: w.body.surface_load((NAN, 0.0), w.ds),
    "traction of complex numbers": lambda w: w.body.surface_load((1j, 0.0), w.ds),
    "traction a scalar expression": lambda w: w.body.surface_load(w.ds, w.ds),
    "traction a matrix expression": lambda w: w.body.surface_load(ufl.Identity(2), w.ds),
    "traction a Constant of infinity": lambda w: w.body.surface_load(w.constant((INF, 0.0)), w.ds),
    "traction and surface exchanged": lambda w: w.body.surface_load(w.ds, (1.0, 0.0)),
    "traction over the volume": lambda w: w.body.surface_load((1.0, 0.0), ufl.dx),
    "traction over a marker": lambda w: w.body.surface_load((1.0, 0.0), right),
    "traction over another mesh": lambda w: w.body.surface_load(
        (1.0, 0.0), boundary_measure(w.other, right)
    ),
    "body load None": lambda w: w.body.body_load(None),
    "body load of one component": lambda w: w.body.body_load((1.0,)),
    "body load of strings": lambda w: w.body.body_load(("a", "b")),
    "body load of 2 x 2": lambda w: w.body.body_load(np.eye(2)),
    "prestress None": lambda w: w.body.initial_stress(None),
    "prestress an array": lambda w: w.body.initial_stress(np.eye(2)),
    "prestress a vector": lambda w: w.body.initial_stress(ufl.as_vector([1.0, 2.0])),
    "prestress in 3 x 3": lambda w: w.body.initial_stress(ufl.Identity(3)),
    "prestress of the form K": lambda w: w.body.initial_stress(ufl.Identity(2), "K"),
    "boundary of None": lambda w: boundary_measure(None, right),
    "boundary of a space": lambda w: boundary_measure(w.U, right),
    "boundary nowhere": lambda w: boundary_measure(w.mesh, nowhere),
    "boundary where None": lambda w: boundary_measure(w.mesh, None),
    "boundary by a failing marker": lambda w: boundary_measure(w.mesh, failing),
    "boundary by a scalar marker": lambda w: boundary_measure(w.mesh, lambda x: True),
    "boundary by a number marker": lambda w: boundary_measure(w.mesh, lambda x: x[0]),
    "boundary by a marker of rows": lambda w: boundary_measure(w.mesh, lambda x: x > 0),
    "boundary by a short mask": lambda w: boundary_measure(w.mesh, np.array([True, False])),
    "boundary by floats": lambda w: boundary_measure(w.mesh, np.array([1.0, 2.0])),
    "boundary by facet -1": lambda w: boundary_measure(w.mesh, np.array([-1])),
    "boundary by facet 10**6": lambda w: boundary_measure(w.mesh, np.array([10**6])),
    "boundary by tags": lambda w: boundary_measure(
        w.mesh, meshtags(w.mesh, 1, np.array([0], np.int32), np.array([1], np.int32))
    ),
    "boundary of degree -1": lambda w: boundary_measure(w.mesh, right, -1),
    "boundary of degree '4'": lambda w: boundary_measure(w.mesh, right, "4"),
    "prescribe on None": lambda w: prescribe(None, 0, left),
    "prescribe on Spaces": lambda w: prescribe(w.spaces, 0, left),
    "prescribe component 2": lambda w: prescribe(w.U, 2, left),
    "prescribe component -1": lambda w: prescribe(w.U, -1, left),
    "prescribe component 'x'": lambda w: prescribe(w.U, "x", left),
    "prescribe component 0.5": lambda w: prescribe(w.U, 0.5, left),
    "prescribe nowhere": lambda w: prescribe(w.U, 0, nowhere),
    "prescribe where None": lambda w: prescribe(w.U, 0, None),
    "prescribe by a failing marker": lambda w: prescribe(w.U, 0, failing),
    "prescribe NaN": lambda w: prescribe(w.U, 0, left, NAN),
    "prescribe a string": lambda w: prescribe(w.U, 0, left, "1"),
    "prescribe an array": lambda w: prescribe(w.U, 0, left, np.zeros(2)),
    "prescribe None": lambda w: prescribe(w.U, 0, left, None),
    "prescribe with marker and component exchanged": lambda w: prescribe(w.U, left, 0),
    "nodal load on a mesh": lambda w: nodal_load(w.mesh, right, (1.0, 0.0)),
    "nodal load of one component": lambda w: nodal_load(w.U, right, (1.0,)),
    "nodal load of NaN": lambda w: nodal_load(w.U, right, (NAN, 0.0)),
    "nodal load a number": lambda w: nodal_load(w.U, right, 1.0),
    "nodal load a string": lambda w: nodal_load(w.U, right, "ab"),
    "nodal load nowhere": lambda w: nodal_load(w.U, nowhere, (1.0, 0.0)),
    "nodal load with force and marker exchanged": lambda w: nodal_load(w.U, (1.0, 0.0), right),
    "lumped mass of None": lambda w: lumped_mass(None, w.U),
    "lumped mass of another size": lambda w: lumped_mass(w.empty(), w.U),
    "lumped mass of another space": lambda w: lumped_mass(w.M, w.P1),
    "lumped mass on None": lambda w: lumped_mass(w.M, None),
    "lumped mass of a standard matrix": lambda w: lumped_mass(
        assemble_matrix(Body(w.standard, STEEL, PLANE).mass()), w.U
    ),
    "lumped mass of NaN": lambda w: lumped_mass(w.matrix(NAN), w.U),
    # assembly, reduction, solve
    "matrix of None": lambda w: assemble_matrix(None),
    "matrix of an expression": lambda w: assemble_matrix(ufl.inner(w.u, w.v)),
    "matrix of a compiled form": lambda w: assemble_matrix(fem.form(w.body.stiffness())),
    "matrix of a linear form": lambda w: assemble_matrix(w.body.body_load((1.0, 0.0))),
    "matrix of a number": lambda w: assemble_matrix(w.constant(1.0) * ufl.dx),
    "matrix of two meshes": lambda w: assemble_matrix(
        ufl.inner(ufl.TrialFunction(Spaces.galerkin(w.other).trial), w.v) * ufl.dx(domain=w.mesh)
    ),
    "vector of None": lambda w: assemble_vector(None),
    "vector of a bilinear form": lambda w: assemble_vector(w.body.stiffness()),
    "vector of a function on another mesh": lambda w: assemble_vector(
        ufl.inner(fem.Function(Spaces.galerkin(w.other).trial), w.v) * ufl.dx(domain=w.mesh)
    ),
    "vector of 0": lambda w: assemble_vector(0),
    "conditions on None": lambda w: Reduction.dirichlet(None, w.left),
    "conditions None": lambda w: Reduction.dirichlet(w.U, None),
    "conditions of None": lambda w: Reduction.dirichlet(w.U, [None]),
    "conditions a marker": lambda w: Reduction.dirichlet(w.U, left),
    "conditions and space exchanged": lambda w: Reduction.dirichlet(w.left, w.U),
    "conditions on another mesh": lambda w: Reduction.dirichlet(
        w.U, [prescribe(w.twin[3], 0, left)]
    ),
    "conditions that contradict": lambda w: Reduction.dirichlet(
        w.U, [prescribe(w.U, 0, left, 0.0), prescribe(w.U, 0, left, 1.0)]
    ),
    "conditions everywhere": lambda w: Reduction.dirichlet(
        w.U, [prescribe(w.U, i, lambda x: x[0] > -1) for i in (0, 1)]
    ),
    "conditions of NaN": lambda w: Reduction.dirichlet(
        w.U,
        [
            fem.dirichletbc(
                w.function(NAN, w.U), fem.locate_dofs_geometrical(w.U, lambda x: x[0] < 9)
            )
        ],
    ),
    "condensation of None": lambda w: Reduction.condensation(None, w.U, np.array([0])),
    "condensation of node -1": lambda w: Reduction.condensation(w.K, w.U, np.array([-1])),
    "condensation of node 10**6": lambda w: Reduction.condensation(w.K, w.U, np.array([10**6])),
    "condensation of node 0.5": lambda w: Reduction.condensation(w.K, w.U, np.array([0.5])),
    "condensation of None nodes": lambda w: Reduction.condensation(w.K, w.U, None),
    "condensation of neighbours": lambda w: Reduction.condensation(w.K, w.U, np.arange(6)),
    "condensation of another size": lambda w: Reduction.condensation(w.empty(), w.U, np.array([0])),
    "condensation of a twin": lambda w: Reduction.condensation(w.K, w.twin[3], np.array([0])),
    "condensation of NaN": lambda w: Reduction.condensation(w.matrix(NAN), w.U, np.array([0])),
    "condensation without stiffness": lambda w: Reduction.condensation(
        w.scaled(w.K, 0.0), w.U, np.array([0])
    ),
    "condensation with K and space exchanged": lambda w: Reduction.condensation(
        w.U, w.K, np.array([0])
    ),
    "reduction of None": lambda w: Reduction(None, None, None),
    "reduction of sizes that differ": lambda w: Reduction(
        w.held.left, w.larger[2].right, w.held.offset
    ),
    "reduction of a short offset": lambda w: Reduction(w.held.left, w.held.right, w.short()),
    "reduced matrix of None": lambda w: w.held.matrix(None),
    "reduced matrix of another size": lambda w: w.held.matrix(w.larger[0]),
    "reduced matrix of a vector": lambda w: w.held.matrix(w.f),
    "reduced load of None": lambda w: w.held.load(w.K, None),
    "reduced load of another size": lambda w: w.held.load(w.K, w.short()),
    "expand None": lambda w: w.held.expand(None),
    "expand a full vector": lambda w: w.held.expand(w.f),
    "reduction under another matrix": lambda w: w.held.under(w.larger[0], w.f),
    "guyan of a wrong name": lambda w: w.held.guyan("both"),
    "solve None": lambda w: solve(None, w.f, w.held),
    "solve an array": lambda w: solve(np.eye(30), w.f, w.held),
    "solve a form": lambda w: solve(w.body.stiffness(), w.f, w.held),
    "solve K and f exchanged": lambda w: solve(w.f, w.K, w.held),
    "solve f None": lambda w: solve(w.K, None, w.held),
    "solve f an array": lambda w: solve(w.K, w.f.array, w.held),
    "solve under a list of conditions": lambda w: solve(w.K, w.f, w.left),
    "solve under one condition": lambda w: solve(w.K, w.f, w.left[0]),
    "solve under no conditions": lambda w: solve(w.K, w.f, []),
    "solve under None": lambda w: solve(w.K, w.f, None),
    "solve under the class": lambda w: solve(w.K, w.f, Reduction),
    "solve without supports": lambda w: solve(w.K, w.f, Reduction.dirichlet(w.U, [])),
    "solve by a class": lambda w: solve(w.K, w.f, w.held, Direct),
    "solve by a word": lambda w: solve(w.K, w.f, w.held, "mumps"),
    "solve by options": lambda w: solve(w.K, w.f, w.held, {"pc_type": "lu"}),
    "solve K of another size": lambda w: solve(w.larger[0], w.f, w.held),
    "solve f of another size": lambda w: solve(w.K, w.larger[1], w.held),
    "solve a reduction of another size": lambda w: solve(w.K, w.f, w.larger[2]),
    "solve K of a twin": lambda w: solve(w.twin[0], w.f, w.held),
    "solve f of a twin": lambda w: solve(w.K, w.twin[1], w.held),
    "solve a reduction of a twin": lambda w: solve(w.K, w.f, w.twin[2]),
    "solve a rectangular matrix": lambda w: solve(w.empty(60, 30), w.f, w.held),
    "solve an unassembled matrix": lambda w: solve(
        w.empty(*w.K.getSize(), assembled=False), w.f, w.held
    ),
    "solve a destroyed matrix": lambda w: solve(w.destroyed(w.K.copy()), w.f, w.held),
    "solve a destroyed vector": lambda w: solve(w.K, w.destroyed(w.f.copy()), w.held),
    "solve a matrix never made": lambda w: solve(PETSc.Mat(), w.f, w.held),
    "solve K of NaN": lambda w: solve(w.matrix(NAN), w.f, w.held),
    "solve K of infinity": lambda w: solve(w.matrix(INF), w.f, w.held),
    "solve K of zeros": lambda w: solve(w.scaled(w.K, 0.0), w.f, w.held),
    "solve f of NaN": lambda w: solve(w.K, w.vector(NAN), w.held),
    "solve f of infinity": lambda w: solve(w.K, w.vector(INF), w.held),
    "solve a standard K with a new load": lambda w: solve(w.galerkin[0], w.f, w.held),
    "solve a new K with a standard load": lambda w: solve(w.K, w.galerkin[1], w.held),
    "reactions of None": lambda w: reactions(w.K, None, w.f),
    "reactions of a function": lambda w: reactions(w.K, as_function(w.U, w.a), w.f),
    "reactions of another size": lambda w: reactions(w.K, w.short(), w.f),
    "reactions of NaN": lambda w: reactions(w.K, w.vector(NAN), w.f),
    "reactions of a matrix of NaN": lambda w: reactions(w.matrix(NAN), w.a, w.f),
    "reactions of another mesh": lambda w: reactions(w.twin[0], w.a, w.f),
    "reactions of other weights": lambda w: reactions(w.K, w.a, w.galerkin[1]),
    "symmetric part of None": lambda w: symmetric_part(None),
    "symmetric part of a rectangle": lambda w: symmetric_part(w.empty(4, 5)),
    # solver
    "options a number": lambda w: Direct(3),
    "options a list": lambda w: Direct(["ksp_view"]),
    "options numbered": lambda w: Direct({1: 2}),
    "options without a name": lambda w: Direct({"": 2}),
    "options of None": lambda w: Direct({"mat_mumps_icntl_14": None}),
    "options of an array": lambda w: Direct({"mat_mumps_icntl_14": np.zeros(3)}),
    "options of no preconditioner": lambda w: solve(
        w.K, w.f, w.held, Direct({"pc_type": "nonsense"})
    ),
    "options of no package": lambda w: solve(
        w.K, w.f, w.held, Direct({"pc_factor_mat_solver_type": "nonsense"})
    ),
    "prepare None": lambda w: Direct().prepare(None),
    "prepare a rectangle": lambda w: Direct().prepare(w.empty(4, 5)),
    # eigenvalues
    "modes of M None": lambda w: w.modes(M=None),
    "modes of M of another size": lambda w: w.modes(M=w.empty()),
    "modes of M of a twin": lambda w: w.modes(M=w.twin[0]),
    "modes of K of NaN": lambda w: w.modes(K=w.matrix(NAN)),
    "modes of M of NaN": lambda w: w.modes(M=w.matrix(NAN)),
    "modes of negative K": lambda w: w.modes(K=w.scaled(w.K, -1.0)),
    "modes of negative M": lambda w: w.modes(M=w.scaled(w.M, -1.0)),
    "modes of M of zeros": lambda w: w.modes(M=w.scaled(w.M, 0.0)),
    "modes of a list of conditions": lambda w: w.modes(reduction=w.left),
    "modes of a twin's reduction": lambda w: w.modes(reduction=w.twin[2]),
    "0 modes": lambda w: w.modes(count=0),
    "-1 modes": lambda w: w.modes(count=-1),
    "1.5 modes": lambda w: w.modes(count=1.5),
    "'2' modes": lambda w: w.modes(count="2"),
    "True modes": lambda w: w.modes(count=True),
    "10**6 modes": lambda w: w.modes(count=10**6),
    "modes symmetrised 'no'": lambda w: w.modes(symmetrised="no"),
    "modes from the shift NaN": lambda w: w.modes(shift=NAN),
    "modes from the shift '0'": lambda w: w.modes(shift="0"),
    "modes from an array of shifts": lambda w: w.modes(shift=np.zeros(2)),
    "modes by a class": lambda w: w.modes(solver=Direct),
    "buckling by None": lambda w: w.buckles(K_sigma=None),
    "buckling by zeros": lambda w: w.buckles(K_sigma=w.scaled(w.K_sigma, 0.0)),
    "buckling by NaN": lambda w: w.buckles(K_sigma=w.matrix(NAN)),
    "buckling of another size": lambda w: w.buckles(K_sigma=w.empty()),
    "buckling by other weights": lambda w: w.buckles(K=w.galerkin[0]),
    "buckling of negative K": lambda w: w.buckles(K=w.scaled(w.K, -1.0)),
    "buckling without supports": lambda w: w.buckles(reduction=Reduction.dirichlet(w.U, [])),
    "buckling under None": lambda w: w.buckles(reduction=None),
    "buckling 0 times": lambda w: w.buckles(count=0),
    "buckling 1.5 times": lambda w: w.buckles(count=1.5),
    "buckling by a solver's name": lambda w: w.buckles(solver="mumps"),
    # recovery
    "force transfer on 8-node quadrilaterals": lambda w: force_transfer(
        Spaces.serendipity(w.quads).trial
    ),
    "force transfer on None": lambda w: force_transfer(None),
    "force transfer on linear triangles": lambda w: force_transfer(w.P1),
    "forces along None": lambda w: forces_along(None, w.f, left),
    "forces along of an array": lambda w: forces_along(w.U, w.f.array, left),
    "forces along of another size": lambda w: forces_along(w.U, w.short(), left),
    "forces along nowhere": lambda w: forces_along(w.U, w.f, nowhere),
    "forces along where None": lambda w: forces_along(w.U, w.f, None),
    "forces along axis 5": lambda w: forces_along(w.U, w.f, left, 5),
    "forces along axis 'y'": lambda w: forces_along(w.U, w.f, left, "y"),
    "surface of None": lambda w: SurfaceNodes.of(None, below),
    "surface of Spaces": lambda w: SurfaceNodes.of(w.spaces, below),
    "surface nowhere": lambda w: SurfaceNodes.of(w.body, nowhere),
    "surface where None": lambda w: SurfaceNodes.of(w.body, None),
    "pressure of too few forces": lambda w: w.surface().pressure(np.ones(2)),
    "pressure of None": lambda w: w.surface().pressure(None),
    "pressure of a number": lambda w: w.surface().tributary_pressure(1.0),
    "pressure of strings": lambda w: w.surface().pressure(["a"] * 5),
    "sawtooth of too few forces": lambda w: w.surface().sawtooth(np.ones(2)),
    "sawtooth of vectors": lambda w: w.surface().sawtooth(np.ones((5, 2))),
    "sawtooth of a short mask": lambda w: w.surface().sawtooth(np.ones(5), np.array([True])),
    "sawtooth of a mask of numbers": lambda w: w.surface().sawtooth(np.ones(5), np.arange(5)),
    "unevenness of None": lambda w: w.surface().unevenness(None),
    "by_position of a list of numbers": lambda w: by_position(np.arange(4.0)),
    "by_position of None": lambda w: by_position(None),
    "by_position beside too few": lambda w: by_position(np.zeros((3, 2)), np.zeros((2, 2))),
    # meshes
    "triangles on None": lambda w: triangles(None, (0, 0), (1, 1), (1, 1)),
    "triangles of no area": lambda w: triangles(COMM, (0, 0), (0, 1), (1, 1)),
    "triangles from NaN": lambda w: triangles(COMM, (NAN, 0), (1, 1), (1, 1)),
    "triangles in 3-D": lambda w: triangles(COMM, (0, 0, 0), (1, 1, 1), (1, 1, 1)),
    "triangles of 0 divisions": lambda w: triangles(COMM, (0, 0), (1, 1), (0, 1)),
    "triangles of 1.5 divisions": lambda w: triangles(COMM, (0, 0), (1, 1), (1.5, 1)),
    "triangles of one division": lambda w: triangles(COMM, (0, 0), (1, 1), 3),
    "triangles of an unknown pattern": lambda w: triangles(COMM, (0, 0), (1, 1), (1, 1), "up"),
    "quadrilaterals between words": lambda w: quadrilaterals(COMM, "ab", "cd", (1, 1)),
    "quadrilaterals turned": lambda w: quadrilaterals(COMM, (1, 1), (0, 0), (1, 1)),
    "on_lines of triangels": lambda w: on_lines(COMM, [0, 1], [0, 1], "triangel"),
    "on_lines of None": lambda w: on_lines(COMM, [0, 1], [0, 1], None),
    "on_lines that decrease": lambda w: on_lines(COMM, [0, 2, 1], [0, 1], "triangle"),
    "on_lines of one line": lambda w: on_lines(COMM, [0.0], [0, 1], "triangle"),
    "on_lines at NaN": lambda w: on_lines(COMM, [0, NAN], [0, 1], "triangle"),
    "on_lines of 2 x 2": lambda w: on_lines(COMM, np.eye(2), [0, 1], "triangle"),
    "on_lines of an unknown pattern": lambda w: on_lines(COMM, [0, 1], [0, 1], "triangle", "up"),
    "on_lines on 3": lambda w: on_lines(3, [0, 1], [0, 1], "triangle"),
    "mapped None": lambda w: mapped(None, lambda x: x),
    "mapped by None": lambda w: mapped(square(), None),
    "mapped to another shape": lambda w: mapped(square(), lambda x: x[:3]),
    "mapped as columns": lambda w: mapped(square(), lambda x: x.T),
    "mapped to NaN": lambda w: mapped(square(), lambda x: x * NAN),
    "mapped by a failing function": lambda w: mapped(square(), failing),
    "curved None": lambda w: curved(None, lambda x: x),
    "curved to a number": lambda w: curved(square(), lambda x: 1.0),
    "curved to infinity": lambda w: curved(square(), lambda x: x + INF),
    "curved by a failing function": lambda w: curved(square(), failing),
    # inner nodes
    # contact
    "contact of K None": lambda w: w.contact(K=None),
    "contact of K of NaN": lambda w: w.contact(K=w.matrix(NAN)),
    "contact of K of another size": lambda w: w.contact(K=w.empty()),
    "contact of K of a twin": lambda w: w.contact(K=w.twin[0]),
    "contact under a list of conditions": lambda w: w.contact(reduction=w.left),
    "contact under a twin's reduction": lambda w: w.contact(reduction=w.twin[2]),
    "contact on None": lambda w: w.contact(space=None),
    "contact on Spaces": lambda w: w.contact(space=w.spaces),
    "contact on a twin's space": lambda w: w.contact(space=w.twin[3]),
    "contact on scalars": lambda w: w.contact(space=w.scalar.trial),
    "contact of no pairs": lambda w: w.contact(pairs=[]),
    "contact of None": lambda w: w.contact(pairs=None),
    "contact of surfaces": lambda w: w.contact(pairs=[w.floor]),
    "contact without loads": lambda w: w.contact(loads=[]),
    "contact of loads None": lambda w: w.contact(loads=None),
    "contact of a load of NaN": lambda w: w.contact(loads=[w.f, w.vector(NAN)]),
    "contact of a short load": lambda w: w.contact(loads=w.short()),
    "contact of a standard load": lambda w: w.contact(loads=w.galerkin[1]),
    "contact of a twin's load": lambda w: w.contact(loads=w.twin[1]),
    "contact of an array for a load": lambda w: w.contact(loads=w.f.array),
    "contact in 0 iterations": lambda w: w.contact(max_iterations=0),
    "contact in 1.5 iterations": lambda w: w.contact(max_iterations=1.5),
    "contact in '9' iterations": lambda w: w.contact(max_iterations="9"),
    "contact by a class": lambda w: w.contact(solver=Direct),
    "contact from a wrong start": lambda w: w.contact(start=[None]),
    "contact on a folded mesh": lambda w: w.folded_contact(),
    "pair exchanged": lambda w: w.contact(pairs=ContactPair(w.floor, below)),
    "pair without nodes": lambda w: w.contact(pairs=ContactPair(nowhere, w.floor)),
    "pair of node -1": lambda w: w.contact(pairs=ContactPair(np.array([-1]), w.floor)),
    "pair of node 0.5": lambda w: w.contact(pairs=ContactPair(np.array([0.5]), w.floor)),
    "pair of None": lambda w: w.contact(pairs=ContactPair(None, w.floor)),
    "pair by a failing marker": lambda w: w.contact(pairs=ContactPair(failing, w.floor)),
    "pair with None": lambda w: w.contact(pairs=ContactPair(below, None)),
    "pair with a class": lambda w: w.contact(pairs=ContactPair(below, Plane)),
    "pair with a plane in space": lambda w: w.contact(
        pairs=ContactPair(below, Plane((0, 0, 0), (0, 0, 1)))
    ),
    "pair pushed outwards": lambda w: w.contact(pairs=ContactPair(below, Plane((0, 0), (0, -1)))),
    "pair of two opposite nodes": lambda w: w.contact(
        pairs=ContactPair(below, MatchingNodes(right, w.floor))
    ),
    "friction -0.1": lambda w: w.contact(pairs=ContactPair(below, w.floor, -0.1)),
    "friction NaN": lambda w: w.contact(pairs=ContactPair(below, w.floor, NAN)),
    "friction a string": lambda w: w.contact(pairs=ContactPair(below, w.floor, "0.3")),
    "friction None": lambda w: w.contact(pairs=ContactPair(below, w.floor, None)),
    "friction a failing function": lambda w: w.contact(pairs=ContactPair(below, w.floor, failing)),
    "friction of another shape": lambda w: w.contact(
        pairs=ContactPair(below, w.floor, lambda x: np.zeros(3))
    ),
    "motions of another number": lambda w: w.contact(
        pairs=ContactPair(below, w.floor, 0.0, [Motion((0, 0))] * 3)
    ),
    "motions in space": lambda w: w.contact(
        pairs=ContactPair(below, w.floor, 0.0, [Motion((0, 0, 0))])
    ),
    "motions of numbers": lambda w: w.contact(pairs=ContactPair(below, w.floor, 0.0, [0.1])),
    "motion of NaN": lambda w: Motion((0, NAN)),
    "motion a number": lambda w: Motion(0.1),
    "motion a string": lambda w: Motion("ab"),
    "motion of None": lambda w: Motion(None),
    "motion with a short force": lambda w: Motion((0, None), (1.0,)),
    "motion with a force it is not free for": lambda w: Motion((0, 0), (1.0, 0.0)),
    "plane of no direction": lambda w: Plane((0, 0), (0, 0)),
    "plane of NaN": lambda w: Plane((0, 0), (NAN, 1)),
    "plane at a word": lambda w: Plane("ab", (0, 1)),
    "plane of None": lambda w: Plane(None, (0, 1)),
    "plane at NaN": lambda w: Plane((0, NAN), (0, 1)),
    "parabola of radius 0": lambda w: Parabola((0, 0), 0.0),
    "parabola of radius NaN": lambda w: Parabola((0, 0), NAN),
    "parabola of radius '1'": lambda w: Parabola((0, 0), "1"),
    "sphere of radius -1": lambda w: Sphere((0, 0), -1.0),
    "sphere of radius infinity": lambda w: Sphere((0, 0), INF),
    "sphere exchanged": lambda w: Sphere(1.0, (0, 0)),
    "punch of width 0": lambda w: FlatPunch((0, 0), (0, 1), 0.0),
    "punch of width None": lambda w: FlatPunch((0, 0), (0, 1), None),
    "signed distance of None": lambda w: w.contact(pairs=ContactPair(below, SignedDistance(None))),
    "signed distance of columns": lambda w: w.contact(
        pairs=ContactPair(below, SignedDistance(lambda x: x))
    ),
    "signed distance that fails": lambda w: w.contact(
        pairs=ContactPair(below, SignedDistance(failing))
    ),
    "signed distance of step 0": lambda w: SignedDistance(lambda x: x[:, 1], step=0.0),
    "step from None": lambda w: w.problem().step(None, w.f),
    "step by an array": lambda w: w.problem().step(w.problem().undeformed, w.f.array),
    "step by a standard load": lambda w: w.problem().step(w.problem().undeformed, w.galerkin[1]),
    "step by two motions": lambda w: w.problem().step(
        w.problem().undeformed, w.f, [Motion((0, 0))] * 2
    ),
    "step by a number": lambda w: w.problem().step(w.problem().undeformed, w.f, 0.1),
    "step with a guess of a word": lambda w: w.problem().step(
        w.problem().undeformed, w.f, guess="start"
    ),
    "step of the body without supports and friction": lambda w: ContactProblem(
        w.K, Reduction.dirichlet(w.U, []), ContactPair(below, w.floor), w.U
    ).step(w.problem().undeformed, w.f),
    "load a file that is not there": lambda w: w.problem().load("/nonexistent/state.npz"),
    "load a file of another kind": lambda w: w.problem().load(__file__),
    "load None": lambda w: w.problem().load(None),
    "save None": lambda w: w.problem().save(None, "/nonexistent/state.npz"),
    "save to None": lambda w: w.problem().save(w.problem().undeformed, None),
    "save to no folder": lambda w: w.problem().save(
        w.problem().undeformed, "/nonexistent/state.npz"
    ),
}


def judged(call, world):
    """What comes of a call: None if the library refuses it as it should, or what is wrong."""

    def late(*_):
        raise TimeoutError

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(SECONDS)
    try:
        call(world)
    except TimeoutError:
        return "a hang"
    except Exception as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        raised = Path(last.filename).is_relative_to(LIBRARY) and last.line.startswith("raise ")
        if raised and isinstance(error, DOCUMENTED) and str(error):
            return None
        said = f"{type(error).__name__}: {error}"
        return f"a traceback from {Path(last.filename).name}:{last.lineno}, {said[:200]}"
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
    return "an answer"


def test_there_are_many_cases():
    assert len(CASES) >= 150


def test_what_cases_change_is_right_without_it(w):
    assert w.contact()[0].residuals.largest() < 1e-9
    assert w.problem().step(w.problem().undeformed, w.f).increment == 1
    assert w.modes().rigid == 0
    assert w.buckles().factors[0] > 0
    assert np.abs(w.surface().pressure(np.ones(5))).max() > 0


@pytest.mark.parametrize("name", CASES)
def test_bad_input_is_refused_in_the_words_of_the_library(name, w):
    assert judged(CASES[name], w) is None
