"""Bad input to any public function raises an error of the library that names the argument.

`REFUSED_CALLS_WITH_MESSAGES` lists the beginnings of error messages with calls that raise them.
`REFUSED_VALUES_BY_MESSAGE` lists values of one argument that raise the same error.
"""

# ruff: noqa: ARG005 (make_valid_collective_calls are functions of what they do not need)

from dataclasses import replace
from functools import cached_property
from itertools import product
from traceback import extract_tb

from mpi4py import MPI
from petsc4py import PETSc

import basix.ufl
import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx.mesh import create_mesh, create_unit_interval, exterior_facet_indices, meshtags

from pw_elements import (
    Body,
    Direct,
    Iterative,
    Material,
    Reduction,
    Sibling,
    Spaces,
    SurfaceNodes,
    as_function,
    assemble_matrix,
    assemble_vector,
    boundary_measure,
    buckling,
    draw,
    force_transfer,
    forces_along,
    history_space,
    lumped_mass,
    nodal_flux,
    prescribe,
    reactions,
    solve,
    split,
    test_space,
    vibration_modes,
)
from pw_elements.contact import (
    ContactPair,
    ContactProblem,
    DeformableSurface,
    FlatPunch,
    Motion,
    Parabola,
    Plane,
    SignedDistance,
    Sphere,
    solve_contact,
)
from pw_elements.contact.model import MatchingNodes
from pw_elements.elasticity import nodal_load
from pw_elements.meshes import curved_mesh, move_nodes, quadrilaterals, triangles
from pw_elements.spaces import piecewise_linear_sub_cell_element
from tests.contact.cases import on_plane
from tests.library.public_calls import make_valid_collective_calls

COMM = MPI.COMM_SELF
PLANE_STRESS, PLANE_STRAIN = "plane stress", "plane strain"
ELASTIC_MATERIAL = Material(10.0, 0.3)
NAN, INF = float("nan"), float("inf")
FLOOR, ZERO_MOTION, UPWARD_VECTOR, NODE_0 = (
    Plane((0, 0), (0, 1)),
    Motion((0, 0)),
    (0.0, 1.0),
    np.array([0]),
)
COINCIDENT_SURFACE = DeformableSurface([0], coincident=True)
LOWER_CORNER, UPPER_CORNER = (0.0, 0.0), (1.0, 1.0)
MESH_CROSSING_AXIS = triangles(
    COMM, (-1.0, 0.0), UPPER_CORNER, (2, 1)
)  # a mesh on both sides of x = 0
is_on_left_side, is_on_right_side = on_plane(0, 0.0), on_plane(0, 2.0)


def everywhere(x):
    return x[0] > -1.0


def is_on_right_part_of_bottom(x):
    return on_plane(1, 0.0)(x) & (x[0] > 0.9)


def nowhere(x):
    return x[0] > 99.0


def rectangle_mesh(n_rows=2, make_mesh=triangles):
    return make_mesh(COMM, (0.0, 0.0), (2.0, 1.0), (2 * n_rows, n_rows))


def make_single_triangle_in_space():
    element = basix.ufl.element("Lagrange", "triangle", 1, shape=(3,))
    x = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 1]])
    return create_mesh(COMM, cells=np.array([[0, 1, 2]]), x=x, e=element)


def move_node(mesh, shift, position=(1.0, 0.5)):
    is_near = np.isclose(mesh.geometry.x[:, :2], position).all(axis=1)
    assert is_near.any()
    mesh.geometry.x[is_near, :2] += shift
    return mesh


def make_body_after_folding_mesh():
    mesh = rectangle_mesh()
    Body(Spaces.galerkin(mesh), ELASTIC_MATERIAL, PLANE_STRESS)
    Body(Spaces.galerkin(move_node(mesh, (2.0, 0.0))), ELASTIC_MATERIAL, PLANE_STRESS)


def make_body_with_inverted_cell():
    mesh = move_node(curved_mesh(rectangle_mesh(1), lambda x: x), (0.6, -0.4), (0.5, 0.5))
    Body(Spaces.galerkin(mesh), ELASTIC_MATERIAL, PLANE_STRESS)


def copy_with_first_entry(matrix, first_entry):
    copy = matrix.copy()
    copy.setValue(0, 0, first_entry)
    copy.assemble()
    return copy


def scaled_copy(matrix, factor):
    copy = matrix.copy()
    copy.scale(factor)
    return copy


def empty_matrix(rows=30, columns=30, assembled=True):
    matrix = PETSc.Mat().createAIJ((rows, columns), nnz=1, comm=COMM)
    if assembled:
        matrix.assemble()
    return matrix


def destroy_and_return(petsc_object):
    petsc_object.destroy()
    return petsc_object


def state_with_nan_forces(state):
    (pair,) = state.pairs
    return replace(state, pairs=(replace(pair, force_normal=np.full_like(pair.gap, NAN)),))


class ValidObjects:
    """Valid objects for calls in which one argument is invalid."""

    def __init__(self):
        self.mesh, self.other = rectangle_mesh(), rectangle_mesh()
        self.spaces, self.standard = (
            f(self.mesh) for f in (Spaces.petrov_galerkin, Spaces.galerkin)
        )
        self.scalar = Spaces.petrov_galerkin(self.mesh, 0)
        self.U = self.spaces.trial
        self.P1 = fem.functionspace(self.mesh, ("Lagrange", 1))
        self.body = Body(self.spaces, ELASTIC_MATERIAL, PLANE_STRESS)
        self.K, self.f, self.clamped, _ = self.assemble_clamped_problem(self.mesh)
        self.M = assemble_matrix(self.body.mass())
        self.ds = boundary_measure(self.mesh, is_on_right_side)
        self.left = [prescribe(self.U, i, is_on_left_side) for i in (0, 1)]
        self.clamped = Reduction.dirichlet(self.U, self.left)
        self.a = solve(self.K, self.f, self.clamped)
        self.u, self.v = ufl.TrialFunction(self.U), ufl.TestFunction(self.U)
        self.x = ufl.SpatialCoordinate(self.mesh)[0]
        self.short = PETSc.Vec().createSeq(7)
        facets = exterior_facet_indices(self.mesh.topology)
        self.tags = meshtags(self.mesh, 1, facets, np.ones(len(facets), dtype=np.int32))

    @cached_property
    def K_sigma(self):
        pressed = as_function(self.U, self.a)
        return assemble_matrix(self.body.geometric_stiffness(self.body.stress(pressed)))

    @cached_property
    def galerkin_stiffness_load_and_mass(self):
        body = Body(self.standard, ELASTIC_MATERIAL, PLANE_STRESS)
        load = assemble_vector(body.body_load((0.0, -1.0)))
        return assemble_matrix(body.stiffness()), load, assemble_matrix(body.mass())

    @cached_property
    def axisymmetric_body(self):
        return Body(self.spaces, ELASTIC_MATERIAL, "axisymmetric")

    @cached_property
    def cell_tags_of_other_mesh(self):
        cells = np.arange(16, dtype=np.int32)
        return meshtags(self.other, 2, cells, cells % 2)

    @cached_property
    def state_of_finer_problem(self):
        K, _, clamped, U = self.finer_problem
        return ContactProblem(
            K, clamped, ContactPair(is_on_right_part_of_bottom, FLOOR), U
        ).undeformed

    @cached_property
    def finer_problem(self):
        """Return the stiffness, load, reduction and space of a problem on a finer mesh."""
        return self.assemble_clamped_problem(rectangle_mesh(3))

    @cached_property
    def problem_on_other_mesh(self):
        return self.assemble_clamped_problem(self.other)

    def assemble_clamped_problem(self, mesh):
        body = Body(Spaces.petrov_galerkin(mesh), ELASTIC_MATERIAL, PLANE_STRESS)
        U = body.spaces.trial
        clamped = Reduction.dirichlet(U, [prescribe(U, i, is_on_left_side) for i in (0, 1)])
        load = assemble_vector(body.body_load((0.0, -1.0)))
        return assemble_matrix(body.stiffness()), load, clamped, U

    def constant(self, value):
        return fem.Constant(self.mesh, value)

    def function_with_value(self, value, space=None, elsewhere=1.0):
        function = fem.Function(space or self.P1)
        function.x.array[:] = elsewhere
        function.x.array[3] = value
        return function

    def load_with_entry(self, value):
        copy = self.f.copy()
        copy.array[3] = value
        return copy

    @cached_property
    def surface_nodes(self):
        return SurfaceNodes.from_body(self.body, is_on_right_part_of_bottom)

    @cached_property
    def contact_problem(self):
        return ContactProblem(
            self.K, self.clamped, ContactPair(is_on_right_part_of_bottom, FLOOR, 0.3), self.U
        )

    @property
    def undeformed_state(self):
        return self.contact_problem.undeformed

    def solve_contact(self, *pair, **changes):
        arguments = {"K": self.K, "loads": self.f, "reduction": self.clamped, "space": self.U}
        arguments["pairs"] = ContactPair(*(pair or (is_on_right_part_of_bottom, FLOOR, 0.3)))
        return solve_contact(**arguments | changes)

    def contact_problem_on_folded_mesh(self):
        mesh = rectangle_mesh()
        K, _, clamped, U = self.assemble_clamped_problem(mesh)
        move_node(mesh, (2.0, 0.0))
        return ContactProblem(K, clamped, ContactPair(is_on_right_part_of_bottom, FLOOR), U)

    def vibration_modes(self, **changes):
        arguments = {"K": self.K, "M": self.M, "reduction": self.clamped, "count": 2}
        return vibration_modes(**arguments | changes)

    def nodal_flux(self, spaces=None, r=None, where=is_on_left_side, value=1.0, **options):
        if r is None:
            r = PETSc.Vec().createSeq(self.scalar.trial.dofmap.index_map.size_local)
            r.set(value)
        return nodal_flux(spaces or self.scalar, r, where, **options)

    def hybrid_stress_without_pressure(self):
        spaces = Spaces.hybrid(self.mesh)
        return Body(spaces, ELASTIC_MATERIAL, PLANE_STRAIN).von_mises(
            fem.Function(spaces.displacements.trial)
        )

    def hybrid_vibration_modes(self, **changes):
        spaces = Spaces.hybrid(self.mesh)
        body = Body(spaces, ELASTIC_MATERIAL, PLANE_STRAIN)
        clamped = Reduction.dirichlet(spaces.trial, prescribe(spaces.trial, 0, is_on_left_side))
        K, M = assemble_matrix(body.stiffness()), assemble_matrix(body.mass())
        return vibration_modes(K, M, clamped, **changes)

    def buckling_modes(self, **changes):
        return buckling(
            **{"K": self.K, "K_sigma": self.K_sigma, "reduction": self.clamped} | changes
        )

    def make_dirichlet_reduction(self, *conditions):
        return Reduction.dirichlet(self.U, conditions)

    def condense(self, nodes=NODE_0, K=None, U=None):
        return Reduction.condensation(K or self.K, U or self.U, nodes)

    def surface_load(self, traction, surface=None):
        return self.body.surface_load(traction, surface or self.ds)

    def mixed_mesh_form(self, argument_type):
        foreign_argument = argument_type(Spaces.galerkin(self.other).trial)
        return ufl.inner(foreign_argument, self.v) * ufl.dx(domain=self.mesh)

    def load_on_two_sides(self):
        ds_below, ds_left = (boundary_measure(self.mesh, on_plane(axis, 0.0)) for axis in (1, 0))
        return self.body.surface_load(UPWARD_VECTOR, ds_below) + self.body.surface_load(
            (1.0, 0), ds_left
        )


@pytest.fixture(scope="module")
def valid_objects():
    return ValidObjects()


# A function that calls the library with a value, and values that are refused, by the beginning of
# the error message
REFUSED_VALUES_BY_MESSAGE = {
    "youngs_modulus = ": (
        lambda w, E: Material(E(w) if callable(E) else E),
        [0.0, -5, NAN, INF, "210", None, True, 1j, np.array(-5.0), np.ones(2), [1.0]]
        # both numbers, and constants and functions that are not positive
        + [lambda w, E=E: w.constant(E) for E in (-1.0, NAN)]
        + [lambda w, E=E: w.function_with_value(E) for E in (-1.0, NAN)],
    ),
    "radius = ": (lambda w, r: Sphere((0, 0), r), [-1.0, 0.0, np.array(-1.0), "1", True, INF]),
    "quadrature_degree = ": (
        lambda w, d: boundary_measure(w.mesh, is_on_right_side, d),
        [-1, 2.5, True, "4"],
    ),
    "count = ": (lambda w, n: w.vibration_modes(count=n), [0, -1, 1.5, "2", True]),
    "traction ": (
        lambda w, t: w.body.surface_load(t, w.ds),
        [1.0, "xy", (1.0, 2.0, 3.0), (NAN, 0.0), (1j, 0.0), ("1", 0), np.eye(2), None],
    ),
    "friction = ": (
        lambda w, mu: ContactPair(is_on_right_part_of_bottom, FLOOR, mu),
        [-0.1, NAN, "0.3", None, True],
    ),
    "the interference ": (
        lambda w, depth: ContactPair(
            is_on_right_part_of_bottom, COINCIDENT_SURFACE, interference=depth
        ),
        ["no", NAN, None, True],
    ),
    "component ": (lambda w, i: prescribe(w.U, i, is_on_left_side), [2, -1, "x", 0.5, True]),
    "the marker of the prescribed nodes gave ": (
        lambda w, marker: prescribe(w.U, 0, marker),
        [lambda x: True, lambda x: x[1], lambda x: 0 * x[1].astype(int), np.transpose, print],
    ),
    "the image of the mesh ": (
        lambda w, image: curved_mesh(w.mesh, image),
        [np.transpose, lambda x: x[0], lambda x: x * NAN, lambda x: x.astype(str)],
    ),
    "option mg_levels_1_ksp_max_it = ": (
        lambda w, count: Iterative(options={"mg_levels_1_ksp_max_it": count}),
        [-3, "-3", "unlimited", 0, -1, 10**9, 2.5, True, NAN],
    ),
    "option mg_coarse_mg_levels_pc_sor_its = ": (
        lambda w, count: Iterative(options={"mg_coarse_mg_levels_pc_sor_its": count}),
        [-3, 10**9],
    ),
    "state ": (lambda w, state: Body(w.spaces, ELASTIC_MATERIAL, state), [None, 3, "plane stres"]),
}

REFUSED_CALLS_WITH_MESSAGES = [
    ("density = 0.0: has to be positive", lambda w: Material(1.0, 0.3, 0.0)),
    (
        "a 2-D mesh cannot be in the state 'solid'",
        lambda w: Body(w.spaces, ELASTIC_MATERIAL, "solid"),
    ),
    ("no quadratic element on a None", lambda w: piecewise_linear_sub_cell_element(None)),
    ("DifferentNodeNumbering: trial and test space number", lambda w: Spaces(w.scalar.trial, w.P1)),
    ("components = -1", lambda w: Spaces.petrov_galerkin(w.mesh, -1)),
    ("components = '2'", lambda w: Spaces.galerkin(w.mesh, "2")),
    ("the trial space has the element Basix element", lambda w: test_space(w.P1)),
    ("the vector has 90 degrees of freedom, the space", lambda w: as_function(w.P1, w.f)),
    ("TypeError: name is 3: it has to be a string", lambda w: as_function(w.U, w.f, 3)),
    ("poissons_ratio = 0.6", lambda w: Material(1.0, 0.6)),
    ("poissons_ratio = '0.3'", lambda w: Material(1.0, "0.3")),
    (
        "TypeError: material is 210.0: Material(E, nu)",
        lambda w: Body(w.spaces, 210.0, PLANE_STRESS),
    ),
    (
        "the values of the spaces have the shape ()",
        lambda w: Body(w.scalar, ELASTIC_MATERIAL, PLANE_STRESS),
    ),
    (
        "the mesh crosses the axis of rotation",
        lambda w: Body(Spaces.galerkin(MESH_CROSSING_AXIS), ELASTIC_MATERIAL, "axisymmetric"),
    ),
    ("poissons_ratio = 0.5", lambda w: Body(w.spaces, Material(1.0, 0.5), "plane strain")),
    (
        "thickness = 0.0: has to be positive",
        lambda w: Body(w.spaces, ELASTIC_MATERIAL, PLANE_STRESS, 0.0),
    ),
    (
        "thickness = nan: has to be a finite number",
        lambda w: Body(w.spaces, ELASTIC_MATERIAL, PLANE_STRESS, NAN),
    ),
    ("quadrature_degree = -1", lambda w: Body(w.spaces, ELASTIC_MATERIAL, PLANE_STRESS, 1.0, -1)),
    ("the form mixes meshes", lambda w: assemble_matrix(w.mixed_mesh_form(ufl.TrialFunction))),
    ("traction has the shape (2, 2)", lambda w: w.surface_load(ufl.Identity(2))),
    ("traction array([inf,  0.])", lambda w: w.surface_load(w.constant((INF, 0.0)))),
    ("the measure is one of cells", lambda w: w.surface_load(UPWARD_VECTOR, ufl.dx)),
    (
        "the measure is one of another",
        lambda w: w.surface_load(UPWARD_VECTOR, boundary_measure(w.other, is_on_right_side)),
    ),
    ("force None: it needs 2 finite components", lambda w: w.body.body_load(None)),
    (
        "TypeError: stress is None: body.stress(u) makes one",
        lambda w: w.body.geometric_stiffness(None),
    ),
    ("stress has the shape (3, 3)", lambda w: w.body.geometric_stiffness(ufl.Identity(3))),
    ("geometric stiffness 'K'", lambda w: w.body.geometric_stiffness(ufl.Identity(2), "K")),
    ("the marker holds on no exterior facet", lambda w: boundary_measure(w.mesh, nowhere)),
    ("facets are object of the shape ()", lambda w: boundary_measure(w.mesh, None)),
    ("facets are a mask of 2", lambda w: boundary_measure(w.mesh, np.array([True, False]))),
    ("facets have the numbers -1 to -1", lambda w: boundary_measure(w.mesh, NODE_0 - 1)),
    ("TypeError: facets are tags", lambda w: boundary_measure(w.mesh, w.tags)),
    ("the marker holds at no node of the space", lambda w: prescribe(w.U, 0, nowhere)),
    ("the prescribed value = nan", lambda w: prescribe(w.U, 0, is_on_left_side, NAN)),
    (
        "nodal force 1.0: it needs 2 finite components",
        lambda w: nodal_load(w.U, is_on_right_side, 1.0),
    ),
    ("the mass matrix has 90 degrees of freedom, the space", lambda w: lumped_mass(w.M, w.P1)),
    (
        "15 nodes have no positive lumped mass",
        lambda w: lumped_mass(w.galerkin_stiffness_load_and_mass[2], w.U),
    ),
    (
        "the mass matrix has entries that are not",
        lambda w: lumped_mass(copy_with_first_entry(w.K, NAN), w.U),
    ),
    ("a matrix needs a bilinear form", lambda w: assemble_matrix(w.constant(1.0) * ufl.dx)),
    ("a vector needs a linear form", lambda w: assemble_vector(w.body.stiffness())),
    (
        "a Dirichlet condition was made on",
        lambda w: w.make_dirichlet_reduction(
            prescribe(w.problem_on_other_mesh[3], 0, is_on_left_side)
        ),
    ),
    (
        "Dirichlet conditions",
        lambda w: w.make_dirichlet_reduction(prescribe(w.U, 0, is_on_left_side, 1.0), *w.left),
    ),
    (
        "the Dirichlet conditions leave no degree of",
        lambda w: w.make_dirichlet_reduction(*(prescribe(w.U, i, everywhere) for i in (0, 1))),
    ),
    (
        "a prescribed value is not a finite number",
        lambda w: w.make_dirichlet_reduction(
            fem.dirichletbc(w.function_with_value(NAN, w.U), np.arange(9))
        ),
    ),
    ("the nodes to be condensed have the numbers -1 to -1", lambda w: w.condense(NODE_0 - 1)),
    ("the stiffness couples nodes that are to be condensed", lambda w: w.condense(np.arange(6))),
    ("the stiffness has 30 degrees of freedom, the space", lambda w: w.condense(K=empty_matrix())),
    ("the space belongs to another mesh than", lambda w: w.condense(U=w.problem_on_other_mesh[3])),
    (
        "the stiffness has entries that are not",
        lambda w: w.condense(K=copy_with_first_entry(w.K, NAN)),
    ),
    (
        "SingularSystem: a node that is to be condensed",
        lambda w: w.condense(K=scaled_copy(w.K, 0.0)),
    ),
    ("left and right matrix of a", lambda w: Reduction(w.clamped.left, w.clamped.right, w.short)),
    (
        "the matrix has 182 degrees of freedom, the reduction",
        lambda w: w.clamped.matrix(w.finer_problem[0]),
    ),
    ("the load has 7 degrees of freedom, the reduction", lambda w: w.clamped.load(w.K, w.short)),
    ("the reduced vector has 90 degrees of freedom", lambda w: w.clamped.expand(w.f)),
    ("TypeError: the reduction is Dirichlet conditions", lambda w: solve(w.K, w.f, [])),
    (
        "SingularSystem: the system matrix is",
        lambda w: solve(scaled_copy(w.K, 0.0), w.f, w.clamped),
    ),
    ("TypeError: the solver is the class Direct", lambda w: solve(w.K, w.f, w.clamped, Direct)),
    ("the reduction has 182 degrees of freedom", lambda w: solve(w.K, w.f, w.finer_problem[2])),
    (
        "the reduction belongs to another mesh than",
        lambda w: solve(w.K, w.f, w.problem_on_other_mesh[2]),
    ),
    ("the stiffness has the shape (60, 30)", lambda w: solve(empty_matrix(60, 30), w.f, w.clamped)),
    (
        "the stiffness is not",
        lambda w: solve(empty_matrix(90, 90, assembled=False), w.f, w.clamped),
    ),
    ("the stiffness is an empty matrix", lambda w: solve(PETSc.Mat(), w.f, w.clamped)),
    (
        "the load is an empty vector",
        lambda w: solve(w.K, destroy_and_return(w.f.copy()), w.clamped),
    ),
    (
        "the stiffness has entries that are not",
        lambda w: solve(copy_with_first_entry(w.K, NAN), w.f, w.clamped),
    ),
    ("the load is not finite", lambda w: solve(w.K, w.load_with_entry(NAN), w.clamped)),
    (
        "the load was made with other weight functions",
        lambda w: solve(w.galerkin_stiffness_load_and_mass[0], w.f, w.clamped),
    ),
    ("TypeError: the displacement is None", lambda w: reactions(w.K, None, w.f)),
    ("the displacement has 7 degrees of freedom", lambda w: reactions(w.K, w.short, w.f)),
    ("the displacement is not finite", lambda w: reactions(w.K, w.load_with_entry(NAN), w.f)),
    (
        "the stiffness has entries that are not",
        lambda w: reactions(copy_with_first_entry(w.K, NAN), w.a, w.f),
    ),
    (
        "the load belongs to another mesh than",
        lambda w: reactions(w.problem_on_other_mesh[0], w.a, w.f),
    ),
    (
        "the load was made with other weight functions",
        lambda w: reactions(w.K, w.a, w.galerkin_stiffness_load_and_mass[1]),
    ),
    ("TypeError: options is 3: give PETSc options such as {'ksp_view'", lambda w: Direct(3)),
    ("option 1: its name has to be a string", lambda w: Direct({1: 2})),
    ("TypeError: option 'ksp_view' is None", lambda w: Direct({"ksp_view": None})),
    ("PETSc cannot solve with", lambda w: solve(w.K, w.f, w.clamped, Direct({"pc_type": "no"}))),
    (
        "the mass has 30 degrees of freedom, the stiffness",
        lambda w: w.vibration_modes(M=empty_matrix()),
    ),
    (
        "the mass belongs to another mesh than",
        lambda w: w.vibration_modes(M=w.problem_on_other_mesh[0]),
    ),
    (
        "the stiffness has entries that are not",
        lambda w: w.vibration_modes(K=copy_with_first_entry(w.K, NAN)),
    ),
    (
        "the diagonal of the stiffness adds up to -1.82e",
        lambda w: w.vibration_modes(K=scaled_copy(w.K, -1.0)),
    ),
    (
        "the diagonal of the mass adds up to -2.15",
        lambda w: w.vibration_modes(M=scaled_copy(w.M, -1.0)),
    ),
    (
        "TooFewModes: the mass or stiffness matrix is zero or not",
        lambda w: w.vibration_modes(M=scaled_copy(w.M, 0.0)),
    ),
    (
        "TooFewModes: 1000000 eigenvalues of 80 degrees of freedom",
        lambda w: w.vibration_modes(count=10**6),
    ),
    ("TypeError: symmetrised is 'no'", lambda w: w.vibration_modes(symmetrised="no")),
    (
        "TooFewModes: the initial stress matrix is",
        lambda w: w.buckling_modes(K_sigma=scaled_copy(w.K_sigma, 0.0)),
    ),
    (
        "the initial stress has entries that are not",
        lambda w: w.buckling_modes(K_sigma=copy_with_first_entry(w.K, NAN)),
    ),
    (
        "the initial stress has 30 degrees of freedom",
        lambda w: w.buckling_modes(K_sigma=empty_matrix()),
    ),
    (
        "the initial stress was made with other weight",
        lambda w: w.buckling_modes(K=w.galerkin_stiffness_load_and_mass[0]),
    ),
    (
        "SingularSystem: the system matrix is",
        lambda w: w.buckling_modes(reduction=w.make_dirichlet_reduction()),
    ),
    ("count = 0: has to be a whole number", lambda w: w.buckling_modes(count=0)),
    ("the force transfer T exists for quadratic", lambda w: force_transfer(w.P1)),
    (
        "the vector of forces has 7 degrees of freedom",
        lambda w: forces_along(w.U, w.short, is_on_left_side),
    ),
    (
        "TypeError: body is None: Body(spaces",
        lambda w: SurfaceNodes.from_body(None, is_on_right_part_of_bottom),
    ),
    ("2 values for the 5 nodes", lambda w: w.surface_nodes.pressure(np.ones(2))),
    ("values are object of the shape ()", lambda w: w.surface_nodes.pressure(None)),
    ("values are float64 of the shape ()", lambda w: w.surface_nodes.tributary_pressure(1.0)),
    (
        "closed: it has to be True or False",
        lambda w: w.surface_nodes.sawtooth(np.ones(5), np.arange(5)),
    ),
    ("a rectangle from (0, 0) to (0, 1) has", lambda w: triangles(COMM, (0, 0), (0, 1), (1, 1))),
    ("lower (nan, 0): it needs 2 finite", lambda w: triangles(COMM, (NAN, 0), (1, 1), (1, 1))),
    ("divisions (0, 1)", lambda w: triangles(COMM, LOWER_CORNER, UPPER_CORNER, (0, 1))),
    (
        "divisions 3: it needs 2 finite components",
        lambda w: triangles(COMM, LOWER_CORNER, UPPER_CORNER, 3),
    ),
    ("diagonal pattern 'up'", lambda w: triangles(COMM, LOWER_CORNER, UPPER_CORNER, (1, 1), "up")),
    ("lower 'ab': it needs 2 finite", lambda w: quadrilaterals(COMM, "ab", "cd", (1, 1))),
    (
        "a rectangle from (1.0, 1.0) to (0.0,",
        lambda w: quadrilaterals(COMM, UPPER_CORNER, LOWER_CORNER, (1, 1)),
    ),
    ("the image of the mesh failed", lambda w: move_nodes(rectangle_mesh(), None)),
    ("the image of the mesh gave float64", lambda w: move_nodes(rectangle_mesh(), lambda x: x.T)),
    (
        "the image of the mesh is not finite",
        lambda w: move_nodes(rectangle_mesh(), lambda x: x * NAN),
    ),
    (
        "DegenerateMesh: a node of the mesh has a coordinate of 2e+200, and volumes",
        lambda w: Body(
            Spaces.galerkin(move_nodes(rectangle_mesh(), lambda x: 1e200 * x)),
            ELASTIC_MATERIAL,
            PLANE_STRESS,
        ),
    ),
    (
        "the stiffness has entries that are not",
        lambda w: w.solve_contact(K=copy_with_first_entry(w.K, NAN)),
    ),
    ("the reduction has 90 degrees of freedom", lambda w: w.solve_contact(K=empty_matrix())),
    (
        "the reduction belongs to another mesh than",
        lambda w: w.solve_contact(K=w.problem_on_other_mesh[0]),
    ),
    (
        "the stiffness has 90 degrees of freedom, the",
        lambda w: w.solve_contact(space=w.scalar.trial),
    ),
    ("there is no contact pair", lambda w: w.solve_contact(pairs=[])),
    ("there is no load increment", lambda w: w.solve_contact(loads=[])),
    (
        "the load of increment 1 is not finite",
        lambda w: w.solve_contact(loads=[w.f, w.load_with_entry(NAN)]),
    ),
    ("the load of increment 0 has 7 degrees of freedom", lambda w: w.solve_contact(loads=w.short)),
    (
        "the load of increment 0 belongs to another",
        lambda w: w.solve_contact(loads=w.problem_on_other_mesh[1]),
    ),
    ("max_iterations = 0", lambda w: w.solve_contact(max_iterations=0)),
    ("DegenerateMesh: cells around (1.333, 0.1667)", lambda w: w.contact_problem_on_folded_mesh()),
    (
        "TypeError: a surface is given in place of nodes",
        lambda w: w.solve_contact(FLOOR, is_on_right_part_of_bottom),
    ),
    ("contact pair 0 has no nodes", lambda w: w.solve_contact(nowhere, FLOOR)),
    (
        "the nodes of contact pair 0 have the numbers -1 to -1",
        lambda w: w.solve_contact(NODE_0 - 1, FLOOR),
    ),
    ("the nodes of contact pair 0 are float64", lambda w: w.solve_contact(NODE_0 + 0.5, FLOOR)),
    (
        "contact pair 0: the point of its",
        lambda w: w.solve_contact(is_on_right_part_of_bottom, Plane((0, 0, 0), (0, 0, 1))),
    ),
    (
        "the surface of contact pair 0 pushes",
        lambda w: w.solve_contact(is_on_right_part_of_bottom, Plane((0, 0), (0, -1))),
    ),
    (
        "contact nodes at (1, 0), (1.25, 0)",
        lambda w: w.solve_contact(
            is_on_right_part_of_bottom, MatchingNodes(is_on_right_side, FLOOR)
        ),
    ),
    (
        "the friction of contact pair 0",
        lambda w: w.solve_contact(is_on_right_part_of_bottom, FLOOR, lambda x: np.zeros(3)),
    ),
    (
        "contact pair 0 has 3 motions for 1",
        lambda w: w.solve_contact(is_on_right_part_of_bottom, FLOOR, 0.0, [ZERO_MOTION] * 3),
    ),
    (
        "the motion of contact pair 0 is",
        lambda w: w.solve_contact(is_on_right_part_of_bottom, FLOOR, 0.0, Motion((0, 0, 0))),
    ),
    (
        "TypeError: a motion of a contact pair is 0.1",
        lambda w: w.solve_contact(is_on_right_part_of_bottom, FLOOR, 0.0, [0.1]),
    ),
    ("component 1 of a motion's translation = nan", lambda w: Motion((0, NAN))),
    ("translation 0.1 of a motion", lambda w: Motion(0.1)),
    ("translation and force of a motion differ in", lambda w: Motion((0, None), (1.0,))),
    ("a motion has a rotation and a torque", lambda w: Motion((0, 0), rotation=0.1, torque=1.0)),
    ("a motion's rotation = nan", lambda w: Motion((0, 0), rotation=NAN)),
    ("a motion's torque = inf", lambda w: Motion((0, 0), rotation=None, torque=INF)),
    ("component 0 of a motion has a translation and a force", lambda w: Motion((0, 0), (1.0, 0.0))),
    ("direction [0, 0]: needs a finite length", lambda w: Plane((0, 0), (0, 0))),
    ("direction (nan, 1): it needs finite components", lambda w: Plane((0, 0), (NAN, 1))),
    ("the point of a plane 'ab'", lambda w: Plane("ab", (0, 1))),
    ("radius = 0.0: a parabola needs a radius that is", lambda w: Parabola((0, 0), 0.0)),
    ("radius = nan: has to be a finite number", lambda w: Parabola((0, 0), NAN)),
    ("the centre of a sphere 1.0", lambda w: Sphere(1.0, (0, 0))),
    ("half_width = 0.0: has to be positive", lambda w: FlatPunch((0, 0), (0, 1), 0.0)),
    ("half_width = None: has to be a finite number", lambda w: FlatPunch((0, 0), (0, 1), None)),
    (
        "TypeError: function = None",
        lambda w: w.solve_contact(is_on_right_part_of_bottom, SignedDistance(None)),
    ),
    ("step = 0.0: has to be positive", lambda w: SignedDistance(lambda x: x[:, 1], step=0.0)),
    (
        "TypeError: the load is of the type ndarray",
        lambda w: w.contact_problem.step(w.undeformed_state, w.f.array),
    ),
    (
        "the load was made with other weight",
        lambda w: w.contact_problem.step(w.undeformed_state, w.galerkin_stiffness_load_and_mass[1]),
    ),
    (
        "2 motions for 1 contact pairs",
        lambda w: w.contact_problem.step(w.undeformed_state, w.f, [ZERO_MOTION] * 2),
    ),
    (
        "TypeError: a motion of contact pair 0 is 0.1",
        lambda w: w.contact_problem.step(w.undeformed_state, w.f, 0.1),
    ),
    (
        "FreeBody: increment 0:",
        lambda w: w.solve_contact(
            is_on_right_part_of_bottom, FLOOR, reduction=w.make_dirichlet_reduction()
        ),
    ),
    (
        "FileNotFoundError: the state cannot be read",
        lambda w: w.contact_problem.load("/no/where.npz"),
    ),
    (f"{__file__} holds no contact state", lambda w: w.contact_problem.load(__file__)),
    ("youngs_modulus has the shape (2,)", lambda w: Material(w.constant((1.0, 2.0)))),
    (
        "DegenerateMesh: the mesh is a surface or line in space",
        lambda w: Body(Spaces.galerkin(make_single_triangle_in_space()), ELASTIC_MATERIAL, "solid"),
    ),
    (
        "a 1-D mesh cannot be in the state",
        lambda w: Body(
            Spaces.galerkin(create_unit_interval(COMM, 3)), ELASTIC_MATERIAL, PLANE_STRESS
        ),
    ),
    (
        "DegenerateMesh: a node of the mesh has",
        lambda w: Body(
            Spaces.galerkin(move_node(rectangle_mesh(), NAN)), ELASTIC_MATERIAL, PLANE_STRESS
        ),
    ),
    ("DegenerateMesh: cells around (1.333, 0.1667)", lambda w: make_body_after_folding_mesh()),
    (
        "DegenerateMesh: cells around (0.6667, 0.3333) are turned",
        lambda w: make_body_with_inverted_cell(),
    ),
    (
        "poissons_ratio = 0.5: in plane stress only",
        lambda w: Body(
            w.spaces, Material(1.0, w.function_with_value(0.5, elsewhere=0.3)), PLANE_STRAIN
        ),
    ),
    (
        "a Dirichlet condition was made",
        lambda w: w.make_dirichlet_reduction(prescribe(w.finer_problem[3], 0, is_on_left_side)),
    ),
    (
        "a pair of hybrid spaces has no symmetrised twin",
        lambda w: w.hybrid_vibration_modes(symmetrised=True),
    ),
    ("TypeError: displacement", lambda w: draw(w.mesh, displacement=np.zeros(3))),
    ("a mesh of 1-D cells in 1-D space is", lambda w: draw(create_unit_interval(COMM, 3))),
    (
        "the displacement has the shape ()",
        lambda w: draw(w.mesh, displacement=w.function_with_value(1.0)),
    ),
    ("the function f belongs to another mesh", lambda w: draw(w.other, w.function_with_value(1.0))),
    ("values", lambda w: draw(w.mesh, ufl.SpatialCoordinate(w.mesh))),
    ("scale = nan", lambda w: draw(w.mesh, scale=NAN)),
    ("the displacement times scale", lambda w: draw(w.mesh, None, w.function_with_value(NAN, w.U))),
    ("view", lambda w: draw(w.mesh, view=(1, 2, 3))),
    ("limits", lambda w: draw(w.mesh, limits=(1,))),
    ("the vector of reactions has 90 degrees of", lambda w: w.nodal_flux(r=w.f)),
    ("the vector of reactions is not finite", lambda w: w.nodal_flux(value=NAN)),
    ("area 'mine': it is 'geometric' or 'weight'", lambda w: w.nodal_flux(area="mine")),
    ("depth = 0.0: has to be positive", lambda w: w.nodal_flux(depth=0.0)),
    (
        "the form has several measures of exterior facets",
        lambda w: assemble_vector(w.load_on_two_sides()),
    ),
    ("the apex of a parabola (0, nan)", lambda w: Parabola((0, NAN), 1.0)),
    (
        "the offset of matching nodes (0, nan)",
        lambda w: MatchingNodes(is_on_right_part_of_bottom, FLOOR, (0, NAN)),
    ),
    ("facets are float64", lambda w: boundary_measure(w.mesh, NODE_0 + 0.5)),
    ("facets are int64 of the shape (1, 1)", lambda w: boundary_measure(w.mesh, [NODE_0])),
    ("facets are a mask of 0", lambda w: boundary_measure(w.mesh, np.zeros(0, dtype=bool))),
    (
        "the state has forces or displacements",
        lambda w: w.contact_problem.step(state_with_nan_forces(w.undeformed_state), w.f),
    ),
    (
        "TypeError: the shape of matching nodes is 0.3",
        lambda w: MatchingNodes(is_on_right_part_of_bottom, 0.3),
    ),
    ("TypeError: tags are given in place of nodes", lambda w: ContactPair(w.tags, FLOOR)),
    ("TypeError: displacement is of the type Vec", lambda w: w.body.von_mises(w.f)),
    ("stresses of hybrid spaces need the pressure", lambda w: w.hybrid_stress_without_pressure()),
    ("TypeError: gradient = 1.0", lambda w: SignedDistance(lambda x: x[:, 1], 1.0)),
    (
        "the trial space has the element Basix element (iso",
        lambda w: test_space(fem.functionspace(w.mesh, basix.ufl.element("iso", "triangle", 1))),
    ),
    (
        "hybrid spaces are of no",
        lambda w: Body(Spaces.hybrid(w.mesh), Material(1.0, 0.4), PLANE_STRESS),
    ),
    (
        "poissons_ratio = 0.0:",
        lambda w: Body(Spaces.hybrid(w.mesh), Material(1.0, 0.0), PLANE_STRAIN),
    ),
    ("the space has no pressure", lambda w: split(w.U, w.f)),
    ("the normal of a surface is not", lambda w: Sphere((0, 0), 1.0).normal(np.zeros((1, 2)))),
    (
        "the state belongs to other contact nodes",
        lambda w: w.contact_problem.step(w.state_of_finer_problem, w.f),
    ),
    (
        "one of the mass and the stiffness belongs to the symmetric",
        lambda w: w.vibration_modes(
            K=Sibling.from_space(w.standard.trial).matrix(w.galerkin_stiffness_load_and_mass[0]),
            M=w.galerkin_stiffness_load_and_mass[2],
        ),
    ),
    (
        "the mass was made with other weight functions",
        lambda w: w.vibration_modes(M=w.galerkin_stiffness_load_and_mass[2]),
    ),
    (
        "the mass is one in axisymmetric, the stiffness in plane stress",
        lambda w: w.vibration_modes(M=assemble_matrix(w.axisymmetric_body.mass())),
    ),
    (
        "the load is one in axisymmetric, the stiffness in plane stress",
        lambda w: solve(
            w.K, assemble_vector(w.axisymmetric_body.body_load(UPWARD_VECTOR)), w.clamped
        ),
    ),
    ("the force transfer T exists", lambda w: Sibling.from_space(w.spaces.test)),
    ("parts", lambda w: Spaces.hybrid(w.mesh, w.cell_tags_of_other_mesh)),
    ("the depth or thickness is not", lambda w: w.nodal_flux(depth=-1 - w.x)),
    ("the space is a part of another", lambda w: prescribe(w.U.sub(0), 0, is_on_left_side)),
    (
        "the vector of forces is not finite",
        lambda w: forces_along(w.U, w.load_with_entry(NAN), is_on_left_side),
    ),
    (
        "the coefficients is not finite",
        lambda w: Sibling.from_space(w.standard.trial).displacement(w.load_with_entry(NAN)),
    ),
    ("the displacement has the shape ()", lambda w: w.body.strain(w.function_with_value(1.0))),
    (
        "the displacement does not belong to the body's mesh",
        lambda w: w.body.stress(fem.Function(w.problem_on_other_mesh[3])),
    ),
    ("values are a constant: there is", lambda w: draw(w.mesh, w.constant(1.0))),
    (
        "the values contain a history function",
        lambda w: draw(w.mesh, 2 * fem.Function(history_space(w.body.spaces)[0])),
    ),
    (
        "the values contain a history function",
        lambda w: draw(w.mesh, fem.Function(history_space(w.body.spaces, (3, 3))[0])[0, 1]),
    ),
    ("the path '\\x00' has a null character", lambda w: w.contact_problem.load("\0")),
    ("TypeError: the image is of the type Mat", lambda w: move_nodes(rectangle_mesh(), w.K)),
    ("its part `left` is an empty matrix", lambda w: replace(w.clamped, left=PETSc.Mat())),
    ("component 0 of a motion's translation = [0, 1]", lambda w: Motion([[0, 1], [2]])),
    (
        "option ksp_max_it = -3: it has to be a whole number, at least 1.",
        lambda w: Direct({"ksp_max_it": -3}),
    ),
    ("the depth or thickness is not", lambda w: w.nodal_flux(depth=ufl.max_value(w.x - 9, 0.0))),
]


def catch_error_message(call, *arguments):
    """Return the error message of a call, preceded by the error's type unless it is ValueError."""
    with pytest.raises(Exception) as caught:  # noqa: PT011
        call(*arguments)
    kind = "" if caught.type is ValueError else f"{caught.type.__name__}: "
    return f"{kind}{caught.value}"


def test_calls_with_valid_objects_succeed(valid_objects):
    assert valid_objects.solve_contact()[0].residuals.largest() < 1e-9
    assert (
        valid_objects.contact_problem.step(
            valid_objects.undeformed_state, valid_objects.f
        ).increment
        == 1
    )
    assert valid_objects.vibration_modes().n_rigid == 0
    assert valid_objects.buckling_modes().factors[0] > 0
    assert np.abs(valid_objects.surface_nodes.pressure(np.ones(5))).max() > 0
    assert valid_objects.condense(NODE_0) is not None
    assert valid_objects.surface_load(UPWARD_VECTOR) is not None


@pytest.mark.parametrize(
    ("words", "call"),
    REFUSED_CALLS_WITH_MESSAGES,
    ids=lambda item: item if isinstance(item, str) else "",
)
def test_bad_input_is_refused_in_the_words_of_the_library(words, call, valid_objects):
    assert catch_error_message(call, valid_objects).startswith(words)


@pytest.mark.parametrize("words", REFUSED_VALUES_BY_MESSAGE)
def test_errors_for_wrong_values_begin_with_the_argument(words, valid_objects):
    call, values = REFUSED_VALUES_BY_MESSAGE[words]
    for value in values:
        assert catch_error_message(call, valid_objects, value).startswith(words), value


# Values that are wrong for most arguments
WRONG_VALUES = [None, object(), "x", -1, np.nan, np.array([]), PETSc.Mat(), ufl.as_ufl(1), ufl.dx]
NIGHTLY_WRONG_VALUES = [PETSc.Vec(), PETSc.KSP(), ufl.Form([]), "\0", [[0], [1, 2]], MPI.COMM_NULL]
NIGHTLY_WRONG_VALUES += [
    0,
    np.inf,
    [],
    {},
    True,
    1e308,
    1j,
    int,
    [np.nan] * 2,
    [[1.0]],
    10**400,
    b"x",
    {1},
    [None],
]
ALLOWED_ERROR_TYPES = (TypeError, ValueError, OSError, RuntimeError)


def test_any_value_of_any_argument_is_accepted_or_refused_by_the_library(
    request, tmp_path, monkeypatch
):
    """Any value of any argument is accepted, or refused by an error that the library raises.

    Errors of foreign code, for example of PETSc or NumPy, must not reach the user.
    """
    monkeypatch.chdir(tmp_path)
    values = (
        WRONG_VALUES + NIGHTLY_WRONG_VALUES
        if request.config.getoption("--nightly")
        else WRONG_VALUES
    )
    foreign_errors, accepted = [], []
    for name, (function, arguments) in make_valid_collective_calls(MPI.COMM_SELF).items():
        for argument, value in product(arguments, values):
            try:
                function(**arguments | {argument: value})
            except Exception as error:
                raised_in = extract_tb(error.__traceback__)[-1].filename
                if "pw_elements" not in raised_in or not isinstance(error, ALLOWED_ERROR_TYPES):
                    foreign_errors.append((name, argument, value, repr(error)))
            else:
                accepted.append((name, argument, value))
    assert foreign_errors == []
    assert not [call for call in accepted if type(call[2]) is object or call[2] is int]
