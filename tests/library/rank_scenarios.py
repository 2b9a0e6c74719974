"""Calls in which one process of several differs from the others, by name.

What fails, differs or is no number on one process has to end all of them in the same words. Where a
difference is legitimate, or a function communicates, all have to come to the same end.
"""

# ruff: noqa: ARG005 (functions of what they do not need)

from dataclasses import replace

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import fem

from pw_elements import (
    Body,
    Direct,
    Iterative,
    Material,
    PetrovGalerkinProblem,
    Reduction,
    Sibling,
    Spaces,
    SurfaceNodes,
    assemble_matrix,
    assemble_scalar,
    assemble_vector,
    boundary_measure,
    forces_along,
    lumped_mass,
    nodal_flux,
    prescribe,
    reactions,
    solve,
    vibration_modes,
)
from pw_elements.algebra import symmetric_part
from pw_elements.contact import (
    ContactFields,
    ContactPair,
    ContactProblem,
    Coulomb,
    DeformableSurface,
    FlatPunch,
    Motion,
    Parabola,
    Plane,
    SignedDistance,
    Sphere,
    plot,
    solve_contact,
    solve_impact,
    write,
)
from pw_elements.contact.model import MatchingNodes
from pw_elements.elasticity import nodal_load
from pw_elements.meshes import curved_mesh, move_nodes, triangles
from tests.contact.cases import BlockOnFloor, on_plane

COMM = MPI.COMM_WORLD
FOOT, TOP, FLOOR, STILL = on_plane(1, 0.0), on_plane(1, 2.0), Plane((0, 0), (0, 1)), Motion((0, 0))
NAN, INF = float("nan"), float("inf")


class RankProblem:
    """A block on a floor, and the process that differs: the last one with nodes on the floor."""

    def __init__(self):
        self.block = BlockOnFloor(8, comm=COMM)
        self.U, self.K, self.mesh = self.block.space, self.block.K, self.block.mesh
        self.spaces, self.load, self.free = (
            self.block.body.spaces,
            self.block.pressure_load,
            self.block.no_supports,
        )
        owned = self.block.x[: self.U.dofmap.index_map.size_local]
        mine = COMM.rank if np.isclose(owned[:, 1], 0.0).any() else -1
        self.wrong = COMM.allreduce(mine, MPI.MAX)
        self.bad = COMM.rank == self.wrong
        self.foot = [prescribe(self.U, i, FOOT) for i in (0, 1)]
        self.held = Reduction.dirichlet(self.U, self.foot)

    def one(self, wrong, right):
        """The one on the process that differs, the other one elsewhere."""
        return wrong if self.bad else right

    def body(self, *material, **named):
        return Body(self.spaces, Material(*material, **named), "plane strain")

    def contact(self, pair=None, **options):
        given = {"K": self.K, "loads": self.load, "reduction": self.free, "space": self.U}
        return solve_contact(pairs=pair or floor(), **given | options)

    def step(self, motions=(), state=None, load=None):
        problem = ContactProblem(self.K, self.free, floor(), self.U)
        return problem.step(state or problem.undeformed, load or self.load, motions)

    def residual(
        self, surface=FLOOR, load=None, history=(), conditions=(), friction=0.3, **options
    ):
        """A step at large strains, of a stretched square."""
        u, v = fem.Function(self.U), ufl.TestFunction(self.spaces.test)
        top = [prescribe(self.U, i, TOP) for i in (0, 1)]
        form = ufl.inner(ufl.grad(u), ufl.grad(v)) * ufl.dx
        for one in history:
            form += one * v[1] * ufl.dx
        pair = ContactPair(FOOT, surface, friction)
        problem = ContactProblem.of_residual(
            form, u, [*top, *conditions], pair, history=list(history), **options
        )
        return problem.step(problem.undeformed, load, Motion((0, 0.01)))

    def impact(self, **options):
        still = self.K.createVecRight()
        mass = self.K.duplicate()
        ones = self.K.createVecRight()
        ones.set(1.0)
        mass.setDiagonal(ones)
        mass.assemble()
        given = {"duration": 1e-4, "velocity": still, "pairs": floor(0.0), "space": self.U}
        return solve_impact(symmetric_part(self.K), mass, self.free, **given | options)

    def function(self, value=1.0, space=None):
        made = fem.Function(space or fem.functionspace(self.mesh, ("Lagrange", 1)))
        made.x.array[:] = value
        return made

    def constant(self, value):
        return fem.Constant(self.mesh, value)

    def vector(self, value):
        changed = self.load.copy()
        if self.bad:
            changed.array[:] = value
        return changed

    def nonlinear(self, value=0.0, load=None, **options):
        u, v = fem.Function(self.U), ufl.TestFunction(self.spaces.test)
        u.x.array[:] = value
        form = ufl.inner((1 + ufl.inner(u, u)) * ufl.grad(u), ufl.grad(v)) * ufl.dx - v[1] * ufl.dx
        return PetrovGalerkinProblem(form, u, self.foot, **options).solve(load)


def floor(friction=0.3, surface=FLOOR, motions=(), **options):
    return ContactPair(FOOT, surface, friction, motions, **options)


class Hidden:
    """A surface whose numbers are no attributes that are compared."""

    def __init__(self, height, far=0.0):
        self._height, self._far = height, far

    def gap(self, x):
        return x[:, 1] - self._height + self._far * np.maximum(0.0, x[:, 0] - 4.1)

    def normal(self, x):
        return np.tile([0.0, 1.0], (len(x), 1))

    def closest(self, x):
        return self.gap(x), self.normal(x), np.zeros((*x.shape, x.shape[1]))


class Bent(Hidden):
    """Closest points that are others."""

    def closest(self, x):
        gap, normal, bend = super().closest(x)
        return gap, normal, bend + self._height

    def gap(self, x):
        return x[:, 1]


class Law:
    """Friction whose numbers are no attributes that are compared."""

    def __init__(self, mu=0.3, most=1e3, size=None):
        self._mu, self._most, self._size = mu, most, size

    def parameter_at(self, _):
        return self._mu

    def limit(self, mu, force):
        share = self._most / (self._most + force)
        return (mu * share * force)[: self._size], (mu * share**2)[: self._size]


def talk(values):
    """Communicate within a user's function, which is called equally often everywhere."""
    COMM.allreduce(1)
    return values


class Talking(Hidden):
    """A surface that communicates."""

    def gap(self, x):
        return talk(super().gap(x))

    def normal(self, x):
        return talk(super().normal(x))

    def closest(self, x):
        return talk(super().closest(x))


class TalkingLaw(Law):
    """A law of friction that communicates."""

    def parameter_at(self, x):
        return talk(super().parameter_at(x))

    def limit(self, mu, force):
        return talk(super().limit(mu, force))


def circle(x, radius=50.0):
    return np.linalg.norm(x - [2.0, -radius], axis=1) - radius


def slope(x, radius=50.0):
    away = x - [2.0, -radius]
    return away / np.linalg.norm(away, axis=1)[:, None]


def set_on(function, value):
    """A function of the share that sets another."""

    def act(share=1.0):
        function.x.array[:] = value * share

    return act


# fmt: off
# A statement that is wrong on one process, and its use by all: w.one(wrong, right)
REFUSED_ON_ONE = {
    "modulus -1": lambda w: w.body(w.one(-1.0, 1.0), 0.3),
    "modulus nan": lambda w: w.body(w.one(NAN, 1.0), 0.3),
    "modulus a word": lambda w: w.body(w.one("x", 1.0), 0.3),
    "modulus missing": lambda w: w.body(w.one(None, 1.0), 0.3),
    "ratio .7": lambda w: w.body(1.0, w.one(0.7, 0.3)),
    "ratio a list": lambda w: w.body(1.0, w.one([0.3], 0.3)),
    "density 0": lambda w: w.body(1.0, 0.3, w.one(0.0, 1.0)),
    "density inf": lambda w: w.body(1.0, 0.3, w.one(INF, 1.0)),
    "modulus, a constant, nan": lambda w: w.body(w.constant(w.one(NAN, 1.0))),
    "modulus, a function, 0": lambda w: w.body(w.function(w.one(0.0, 1.0))),
    "modulus, a function, nan": lambda w: w.body(w.function(w.one(NAN, 1.0))),
    "modulus, a vector": lambda w: w.body(w.constant(w.one((1.0, 2.0), 1.0))),
    "ratio, a function, .8": lambda w: w.body(1.0, w.function(w.one(0.8, 0.3))),
    "motion nan": lambda w: w.step([Motion((0, w.one(NAN, 0.1)))]),
    "motion a word": lambda w: w.step([Motion(w.one("x", (0, 0)))]),
    "motion a number": lambda w: w.step([Motion(w.one(0.1, (0, 0)))]),
    "motion with a force": lambda w: w.step([Motion((0, 0), w.one((0, 1.0), None))]),
    "motion with a torque": lambda w: w.step([Motion((0, 0), torque=w.one(1.0, 0.0))]),
    "motion's force too long": lambda w: w.step([Motion((0, None), w.one((0, 1, 2), (0, 1)))]),
    "rotation nan": lambda w: w.step([Motion((0, 0), rotation=w.one(NAN, 0.0))]),
    "plane without direction":
        lambda w: w.contact(floor(surface=Plane((0, 0), w.one((0, 0), (0, 1))))),
    "plane at nan": lambda w: w.contact(floor(surface=Plane((0, w.one(NAN, 0)), (0, 1)))),
    "parabola flat": lambda w: w.contact(floor(surface=Parabola((0, 0), w.one(0.0, -9.0)))),
    "sphere inside out": lambda w: w.contact(floor(surface=Sphere((2, -9), w.one(-9.0, 9.0)))),
    "punch of no width":
        lambda w: w.contact(floor(surface=FlatPunch((2, 0), (0, 1), w.one(0.0, 3.0)))),
    "distance without function":
        lambda w: w.contact(floor(surface=SignedDistance(w.one(None, circle)))),
    "distance with a gradient 1":
        lambda w: w.contact(floor(surface=SignedDistance(circle, w.one(1.0, None)))),
    "distance with step 0":
        lambda w: w.contact(floor(surface=SignedDistance(circle, step=w.one(0.0, 1e-6)))),
    "friction -1": lambda w: w.contact(floor(w.one(-1.0, 0.3))),
    "friction nan": lambda w: w.contact(floor(w.one(NAN, 0.3))),
    "friction a word": lambda w: w.contact(floor(w.one("x", 0.3))),
    "interference a word": lambda w: w.contact(floor(interference=w.one("x", False))),
    "no surface": lambda w: w.contact(floor(surface=w.one(None, FLOOR))),
    "no nodes": lambda w: w.contact(ContactPair(w.one(None, FOOT), FLOOR)),
    "surface and nodes exchanged":
        lambda w: w.contact(ContactPair(*w.one((FLOOR, FOOT), (FOOT, FLOOR)))),
    "motions of a pair 0.1": lambda w: w.contact(floor(motions=w.one([0.1], STILL))),
    "axis without pivot": lambda w: w.contact(floor(axis=w.one((0, 0, 1), None))),
    "deformable, no facets":
        lambda w: w.contact(floor(surface=DeformableSurface(w.one(None, TOP)))),
    "deformable, revolved a word":
        lambda w: w.contact(floor(surface=DeformableSurface(TOP, w.one("x", False)))),
    "matching without shape":
        lambda w: w.contact(floor(surface=MatchingNodes(TOP, w.one(0.3, FLOOR)))),
    "matching, offset nan":
        lambda w: w.contact(floor(surface=MatchingNodes(TOP, FLOOR, (0, w.one(NAN, 2.0))))),
    "direct, options 3": lambda w: solve(w.K, w.load, w.held, Direct(w.one(3, {}))),
    "direct, an option None":
        lambda w: solve(w.K, w.load, w.held, Direct(w.one({"ksp_rtol": None}, {}))),
    "direct, endless": lambda w: solve(w.K, w.load, w.held, Direct(w.one({"ksp_max_it": -3}, {}))),
    "iterative, tolerance 2": lambda w: solve(w.K, w.load, w.held, Iterative(w.one(2.0, 1e-9))),
    "iterative, other levels":
        lambda w: solve(w.K, w.load, w.held, Iterative(options=w.one({"pc_type": "lu"}, {}))),
    "iterative, endless": lambda w: solve(
        w.K, w.load, w.held, Iterative(options=w.one({"mg_levels_1_ksp_max_it": -3}, {}))),
    "material by tag": lambda w: Body.on(w.mesh, Material(w.one(-2.0, 2.0)), "plane strain"),
    "motion in a sequence": lambda w: w.contact(floor(motions=[Motion((0, w.one(INF, 0)))])),
}

# Right statements and functions that differ
DIFFERENT_ON_ONE = {
    "modulus": lambda w: w.body(w.one(2.0, 1.0), 0.3),
    "modulus by the last digit": lambda w: w.body(w.one(1.0 + 2**-52, 1.0), 0.3),
    "density": lambda w: w.body(1.0, 0.3, w.one(2.0, 1.0)),
    "modulus, a constant": lambda w: w.body(w.constant(w.one(2.0, 1.0))),
    "state of stress": lambda w: Body.on(
        w.mesh, Material(1.0, 0.3), w.one("plane stress", "plane strain")),
    "height of a plane": lambda w: w.contact(floor(surface=Plane((0, w.one(-0.1, 0)), (0, 1)))),
    "kind of a surface": lambda w: w.contact(floor(surface=w.one(Parabola((2, 0), -9.0), FLOOR))),
    "hidden height": lambda w: w.contact(floor(surface=Hidden(w.one(-0.1, 0.0)))),
    "hidden height, hardly": lambda w: w.contact(floor(surface=Hidden(w.one(-1e-4, 0.0)))),
    "hidden and far away": lambda w: w.contact(floor(surface=Hidden(0.0, w.one(0.5, 0.0)))),
    "hidden closest points": lambda w: w.residual(Bent(w.one(0.1, 0.0))),
    "distance": lambda w: w.contact(
        floor(surface=SignedDistance(w.one(lambda x: x[:, 1] + 0.1, lambda x: x[:, 1])))),
    "radius in a function": lambda w: w.residual(
        SignedDistance(w.one(lambda x: circle(x, 51.0), circle))),
    "gradient, of other sign": lambda w: w.residual(
        SignedDistance(circle, w.one(lambda x: -slope(x), slope))),
    "gradient missing": lambda w: w.residual(SignedDistance(circle, w.one(None, slope))),
    "friction in a function": lambda w: w.contact(
        floor(w.one(lambda x: 0.4 + 0 * x[0], lambda x: 0.3 + 0 * x[0]))),
    "friction at one node": lambda w: w.contact(
        floor(w.one(lambda x: 0.3 + (x[0] > 3.9), lambda x: 0.3 + 0 * x[0]))),
    "hidden coefficient of a law": lambda w: w.contact(floor(Law(w.one(0.4, 0.3)))),
    "hidden limit of a law": lambda w: w.contact(floor(Law(most=w.one(1e2, 1e3)))),
    "kind of a law": lambda w: w.contact(floor(w.one(Law(), Coulomb(0.3)))),
    "size of a law's answer": lambda w: w.contact(floor(Law(size=w.one(1, None)))),
    "depth of an interference": lambda w: w.contact(floor(interference=w.one(True, False))),
    "number of motions": lambda w: w.contact(floor(motions=[STILL] * w.one(2, 1))),
    "number of loads": lambda w: w.contact(loads=[w.load] * w.one(2, 1)),
    "most iterations": lambda w: w.contact(max_iterations=w.one(40, 50)),
    "remedies": lambda w: w.contact(remedies=w.one(("springs",), ("cutback",))),
    "solver": lambda w: w.contact(solver=w.one(Direct(), None)),
    "solver's options": lambda w: w.contact(
        solver=Direct({"mat_mumps_icntl_14": w.one(50, 60)})),
    "tolerance": lambda w: w.contact(solver=Iterative(w.one(1e-10, 1e-11))),
    "marker of a pair": lambda w: w.contact(
        ContactPair(w.one(lambda x: FOOT(x) & (x[0] < 3.6), FOOT), FLOOR, 0.3)),
    "marker of supports": lambda w: prescribe(w.U, 0, w.one(TOP, FOOT)),
    "marker of a load": lambda w: nodal_load(w.U, w.one(TOP, FOOT), (1.0, 0.0)),
    "marker of facets": lambda w: boundary_measure(w.mesh, w.one(TOP, FOOT)),
    "marker of a surface": lambda w: SurfaceNodes.from_body(w.block.body, w.one(TOP, FOOT)),
    "marker of forces": lambda w: forces_along(w.U, w.load, w.one(FOOT, TOP)),
    "prescribed value": lambda w: prescribe(w.U, 0, FOOT, w.one(0.1, 0.0)),
    "prescribed component": lambda w: prescribe(w.U, w.one(1, 0), FOOT),
    "prescribed constant": lambda w: Reduction.dirichlet(
        w.U, [prescribe(w.U, 0, FOOT, w.constant(w.one(0.1, 0.0)))]),
    "conditions": lambda w: Reduction.dirichlet(w.U, w.foot[: w.one(1, 2)]),
    "image": lambda w: move_nodes(square(), w.one(lambda x: 1.1 * x, lambda x: x)),
    "image of a curved mesh": lambda w: curved_mesh(
        square(), w.one(lambda x: 1.1 * x, lambda x: x)),
    "divisions": lambda w: triangles(COMM, (0, 0), (1, 1), (4, w.one(5, 4))),
    "path in time": lambda w: w.impact(paths=w.one(lambda t: (0, 2 * t), lambda t: (0, t))),
    "path of another time": lambda w: w.impact(
        duration=1e-2, paths=lambda t: (0, t * (1 + w.one(t > 5e-3, 0)))),
    "duration": lambda w: w.impact(duration=w.one(2e-4, 1e-4)),
    "load of a step": lambda w: constant_load(w, w.one(2.0, 1.0)),
    "load of a problem": lambda w: w.nonlinear(
        load=lambda share: w.foot[0].g.value.__setitem__((), w.one(0.1, 0.0) * share)),
    "load missing": lambda w: w.nonlinear(load=w.one(None, lambda share: None)),
    "history": lambda w: w.residual(history=[w.function(0.0)] * w.one(0, 1)),
    "motion": lambda w: w.step([Motion((0, w.one(-0.1, 0.0)))]),
    "motion missing": lambda w: w.step(w.one([], [Motion((0, -0.1))])),
    "count": lambda w: vibration_modes(
        w.K, assemble_matrix(w.block.body.mass()), w.held, w.one(2, 1)),
    "force of a load": lambda w: assemble_vector(
        w.block.body.body_load((0.0, w.one(1.0, 2.0)))),
    "form": lambda w: assemble_scalar(w.one(2.0, 1.0) * w.constant(1.0) * ufl.dx),
    "file to be read": lambda w: ContactProblem(w.K, w.free, floor(), w.U).load(
        w.one("/nowhere/a.npz", "/nowhere/b.npz")),
    "what has changed": lambda w: ContactProblem(w.K, w.free, floor(), w.U).load(
        "/nowhere/a.npz", w.one(["friction"], [])),
    "depth of a flux": lambda w: nodal_flux(
        Spaces.petrov_galerkin(w.mesh, 0), flux(w), FOOT, depth=w.one(2.0, 1.0)),
    "times of a file": lambda w: write("/nowhere/a.bp", states(w), w.block.body, [w.one(1.0, 2.0)]),
    "axis of a picture": lambda w: plot(states(w)[0], w.block.body, along=w.one(1, 0)),
    "pivot": lambda w: w.contact(floor(pivot=w.one((0, 0), None))),
}

# What is no number, or fails, on one process
NAN_ON_ONE = {
    "gap": lambda w: w.contact(floor(surface=Hidden(w.one(NAN, 0.0)))),
    "gap far away": lambda w: w.contact(floor(surface=Hidden(0.0, w.one(NAN, 0.0)))),
    "closest points": lambda w: w.residual(Bent(w.one(NAN, 0.0))),
    "law": lambda w: w.contact(floor(Law(most=w.one(NAN, 1e3)))),
    "law's parameter": lambda w: w.contact(floor(Law(w.one(NAN, 0.3)))),
    "friction": lambda w: w.contact(floor(lambda x: w.one(NAN, 0.3) + 0 * x[0])),
    "distance": lambda w: w.contact(
        floor(surface=SignedDistance(lambda x: w.one(NAN, 1.0) * x[:, 1]))),
    "gradient": lambda w: w.residual(
        SignedDistance(circle, lambda x: w.one(NAN, 1.0) * slope(x))),
    "load": lambda w: solve(w.K, w.vector(NAN), w.held),
    "load of contact": lambda w: w.contact(loads=w.vector(NAN)),
    "load of a step": lambda w: w.step(load=w.vector(INF)),
    "velocity": lambda w: w.impact(velocity=w.vector(NAN)),
    "load in time": lambda w: w.impact(load=lambda t: w.vector(NAN)),
    "path": lambda w: w.impact(paths=lambda t: (0, w.one(NAN, 0.0))),
    "image": lambda w: move_nodes(square(), lambda x: w.one(NAN, 1.0) * x),
    "prescribed function": lambda w: Reduction.dirichlet(w.U, [fem.dirichletbc(
        w.function(w.one(NAN, 0.0), w.U), fem.locate_dofs_geometrical(w.U, FOOT))]),
    "guess": lambda w: w.nonlinear(w.one(NAN, 0.0)),
    "displacement of a picture": lambda w: ContactFields.from_state(nan_state(w), w.block.body),
    "state": lambda w: w.step(state=nan_state(w)),
    "history that update sets": lambda w: w.residual(
        history=[(one := w.function(0.0))], update=set_on(one, w.one(NAN, 0.0)),
        load=lambda share: None, max_iterations=25, callback=None),
    "history from the start": lambda w: w.residual(history=[w.function(w.one(NAN, 0.0))]),
    "reactions": lambda w: forces_along(w.U, w.vector(NAN), FOOT),
    "flux": lambda w: nodal_flux(Spaces.petrov_galerkin(w.mesh, 0), flux(w, NAN), FOOT),
    "prescribed value": lambda w: prescribe(w.U, 0, FOOT, w.one(NAN, 0.0)),
    "traction": lambda w: w.block.body.surface_load(
        (0.0, w.one(NAN, 1.0)), boundary_measure(w.mesh, TOP)),
    "traction, a function": lambda w: solve(w.K, assemble_vector(w.block.body.body_load(
        ufl.as_vector([0.0, 1.0]) * w.function(w.one(NAN, 1.0)))), w.held),
    "thickness": lambda w: Body(
        w.spaces, Material(1.0), "plane stress", w.function(w.one(NAN, 1.0))),
    "coefficients": lambda w: Sibling.from_space(Spaces.galerkin(w.mesh).trial).displacement(
        w.vector(NAN)),
    "mass": lambda w: lumped_mass(diagonal(w, w.vector(NAN)), w.U),
    "force": lambda w: reactions(w.K, w.vector(NAN), w.load),
}

# Functions that communicate, and differences that are legitimate: all come to the same end
SAME_OUTCOME = {
    "surface talks": lambda w: w.contact(floor(surface=Talking(0.0))),
    "surface talks at large strains": lambda w: w.residual(Talking(0.0)),
    "distance talks": lambda w: w.contact(floor(surface=SignedDistance(lambda x: talk(x[:, 1])))),
    "distance talks at large strains":
        lambda w: w.residual(SignedDistance(lambda x: talk(circle(x)))),
    "gradient talks": lambda w: w.residual(SignedDistance(circle, lambda x: talk(slope(x)))),
    "infinite distance talks": lambda w: w.residual(
        SignedDistance(lambda x: talk(np.where(np.abs(x[:, 0] - 2) < 1.3, circle(x), np.inf)))),
    "law talks": lambda w: w.contact(floor(TalkingLaw())),
    "friction talks": lambda w: w.contact(floor(lambda x: talk(0.3 + 0 * x[0]))),
    "marker talks": lambda w: prescribe(w.U, 0, lambda x: talk(FOOT(x))),
    "load talks": lambda w: w.residual(load=lambda share: talk(None)),
    "update talks": lambda w: w.residual(update=lambda: talk(None)),
    "path talks": lambda w: w.impact(paths=lambda t: talk((0, 0))),
    "callback of one process": lambda w: w.contact(callback=w.one(lambda progress: None, None)),
    "numbers of nodes": lambda w: w.contact(ContactPair(
        fem.locate_dofs_geometrical(w.U, FOOT), FLOOR, 0.3)),
    "zero of either sign": lambda w: w.contact(floor(surface=Plane((0, w.one(-0.0, 0.0)), (0, 1)))),
    "list and tuple": lambda w: w.contact(floor(surface=Plane(w.one([0, 0], (0, 0)), (0, 1)))),
    "statement of one process": lambda w: w.one(Material(2.0, 0.3), None) and None,
}
# fmt: on


def square():
    return triangles(COMM, (0, 0), (1, 1), (4, 4))


def states(w):
    return [ContactProblem(w.K, w.free, floor(), w.U).undeformed]


def nan_state(w):
    (state,) = states(w)
    (pair,) = state.pairs
    force = pair.force_normal + w.one(NAN, 0.0)
    return replace(state, pairs=(replace(pair, force_normal=force),))


def flux(w, value=0.0):
    scalars = Spaces.petrov_galerkin(w.mesh, 0).trial.dofmap.index_map
    vector = PETSc.Vec().createMPI((scalars.size_local, scalars.size_global), comm=COMM)
    if w.bad:
        vector.array[:] += value
    return vector


def diagonal(w, vector):
    matrix = w.K.duplicate()
    matrix.setDiagonal(vector)
    matrix.assemble()
    return matrix


def constant_load(w, value):
    load = w.constant(0.0)

    def act(share):
        load.value = value * share

    return w.residual(
        load=act, conditions=[prescribe(w.U, 0, lambda x: on_plane(0, 0.0)(x) & (x[1] > 1), load)]
    )
