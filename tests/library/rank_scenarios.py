"""Named calls in which arguments or results on one process differ from those on the others.

If an argument is wrong, different or NaN on one process, all processes have to raise the same
error. If the difference is allowed, or if a user's function communicates, all have to succeed.
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
    history_space,
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
BOTTOM_MARKER, TOP_MARKER, FLOOR, ZERO_MOTION = (
    on_plane(1, 0.0),
    on_plane(1, 2.0),
    Plane((0, 0), (0, 1)),
    Motion((0, 0)),
)
NAN, INF = float("nan"), float("inf")


class BlockWithDifferingRank:
    """Block on a floor, for calls that differ on one process.

    This is the last process that owns nodes on the floor.
    """

    def __init__(self):
        self.block = BlockOnFloor(8, comm=COMM)
        self.U, self.K, self.mesh = self.block.space, self.block.K, self.block.mesh
        self.spaces, self.load, self.free = (
            self.block.body.spaces,
            self.block.pressure_load,
            self.block.no_supports,
        )
        owned = self.block.x[: self.U.dofmap.index_map.size_local]
        candidate = COMM.rank if np.isclose(owned[:, 1], 0.0).any() else -1
        self.rank = COMM.allreduce(candidate, MPI.MAX)
        self.is_selected = COMM.rank == self.rank
        self.foot_conditions = [prescribe(self.U, i, BOTTOM_MARKER) for i in (0, 1)]
        self.clamped = Reduction.dirichlet(self.U, self.foot_conditions)

    def pick(self, on_differing_rank, elsewhere):
        """Return the first value on the process that differs, and the second one on the others."""
        return on_differing_rank if self.is_selected else elsewhere

    def make_body(self, *material_arguments, **material_options):
        return Body(self.spaces, Material(*material_arguments, **material_options), "plane strain")

    def solve_contact(self, pair=None, **options):
        arguments = {"K": self.K, "loads": self.load, "reduction": self.free, "space": self.U}
        return solve_contact(pairs=pair or floor_pair(), **arguments | options)

    def solve_step(self, motions=(), state=None, load=None):
        problem = ContactProblem(self.K, self.free, floor_pair(), self.U)
        return problem.step(state or problem.undeformed, load or self.load, motions)

    def solve_residual_step(
        self, surface=FLOOR, load=None, history=(), conditions=(), friction=0.3, **options
    ):
        """Solve one increment of a problem that is given by a residual."""
        u, v = fem.Function(self.U), ufl.TestFunction(self.spaces.test)
        top_conditions = [prescribe(self.U, i, TOP_MARKER) for i in (0, 1)]
        form = ufl.inner(ufl.grad(u), ufl.grad(v)) * ufl.dx
        for history_function in history:
            form += history_function * v[1] * ufl.dx
        pair = ContactPair(BOTTOM_MARKER, surface, friction)
        problem = ContactProblem.of_residual(
            form, u, [*top_conditions, *conditions], pair, history=history, **options
        )
        return problem.step(problem.undeformed, load, Motion((0, 0.01)))

    def solve_impact(self, **options):
        zero_velocity = self.K.createVecRight()
        unit_masses = self.K.createVecRight()
        unit_masses.set(1.0)
        mass = diagonal_matrix(self.K, unit_masses)
        arguments = {
            "duration": 1e-4,
            "velocity": zero_velocity,
            "pairs": floor_pair(0.0),
            "space": self.U,
        }
        return solve_impact(symmetric_part(self.K), mass, self.free, **arguments | options)

    def make_function(self, value=1.0, space=None):
        function = fem.Function(space or fem.functionspace(self.mesh, ("Lagrange", 1)))
        function.x.array[:] = value
        return function

    def make_history_number(self):
        """Return a function with one value at each material point."""
        return fem.Function(history_space(self.spaces)[0])

    def make_constant(self, value):
        return fem.Constant(self.mesh, value)

    def load_differing_on_one_rank(self, value):
        load = self.load.copy()
        if self.is_selected:
            load.array[:] = value
        return load

    def solve_nonlinear(self, initial_displacement=0.0, load=None, **options):
        u, v = fem.Function(self.U), ufl.TestFunction(self.spaces.test)
        u.x.array[:] = initial_displacement
        form = ufl.inner((1 + ufl.inner(u, u)) * ufl.grad(u), ufl.grad(v)) * ufl.dx - v[1] * ufl.dx
        return PetrovGalerkinProblem(form, u, self.foot_conditions, **options).solve(load)


def floor_pair(friction=0.3, surface=FLOOR, motions=(), **options):
    return ContactPair(BOTTOM_MARKER, surface, friction, motions, **options)


class PlaneWithPrivateData:
    """Plane with private attributes, which are not compared between processes."""

    def __init__(self, height, far_slope=0.0):
        self._height, self._far_slope = height, far_slope

    def gap(self, x):
        return x[:, 1] - self._height + self._far_slope * np.maximum(0.0, x[:, 0] - 4.1)

    def normal(self, x):
        return np.tile([0.0, 1.0], (len(x), 1))

    def gap_normal_and_curvature(self, x):
        return self.gap(x), self.normal(x), np.zeros((*x.shape, x.shape[1]))


class PlaneWithWrongClosestPoints(PlaneWithPrivateData):
    """Plane with wrong derivatives of its closest points."""

    def gap_normal_and_curvature(self, x):
        gap, normal, bend = super().gap_normal_and_curvature(x)
        return gap, normal, bend + self._height

    def gap(self, x):
        return x[:, 1]


class FrictionLawWithPrivateData:
    """Friction law with private attributes, which are not compared between processes."""

    def __init__(self, mu=0.3, max_force=1e3, size=None):
        self._mu, self._max_force, self._size = mu, max_force, size

    def parameter_at(self, _):
        return self._mu

    def limit(self, mu, force):
        reduction = self._max_force / (self._max_force + force)
        return (mu * reduction * force)[: self._size], (mu * reduction**2)[: self._size]


def return_after_collective_call(values):
    """Return values after a collective call, so all processes have to call this equally often."""
    COMM.allreduce(1)
    return values


class CommunicatingPlane(PlaneWithPrivateData):
    """Plane that communicates with other processes in each of its methods."""

    def gap(self, x):
        return return_after_collective_call(super().gap(x))

    def normal(self, x):
        return return_after_collective_call(super().normal(x))

    def gap_normal_and_curvature(self, x):
        return return_after_collective_call(super().gap_normal_and_curvature(x))


class CommunicatingFrictionLaw(FrictionLawWithPrivateData):
    """Friction law that communicates with other processes in each of its methods."""

    def parameter_at(self, x):
        return return_after_collective_call(super().parameter_at(x))

    def limit(self, mu, force):
        return return_after_collective_call(super().limit(mu, force))


def signed_distance_to_circle(x, radius=50.0):
    return np.linalg.norm(x - [2.0, -radius], axis=1) - radius


def gradient_of_distance_to_circle(x, radius=50.0):
    from_centre = x - [2.0, -radius]
    return from_centre / np.linalg.norm(from_centre, axis=1)[:, None]


def make_value_setter(function, value):
    """Return a function of the load factor that sets all values of a finite-element function."""

    def set_values(load_factor=1.0):
        function.x.array[:] = value * load_factor

    return set_values


# Calls with an argument w.pick(wrong, right), which is wrong on one process
CALLS_INVALID_ON_ONE_RANK = {
    "shape of a new value of the history": lambda w: w.solve_residual_step(
        history={(number := w.make_history_number()): w.pick(ufl.grad(number), 1.5 * number)}
    ),
    "shape of a history space": lambda w: history_space(w.spaces, w.pick((0,), (3,))),
    "modulus -1": lambda w: w.make_body(w.pick(-1.0, 1.0), 0.3),
    "modulus nan": lambda w: w.make_body(w.pick(NAN, 1.0), 0.3),
    "modulus a word": lambda w: w.make_body(w.pick("x", 1.0), 0.3),
    "modulus missing": lambda w: w.make_body(w.pick(None, 1.0), 0.3),
    "ratio .7": lambda w: w.make_body(1.0, w.pick(0.7, 0.3)),
    "ratio a list": lambda w: w.make_body(1.0, w.pick([0.3], 0.3)),
    "density 0": lambda w: w.make_body(1.0, 0.3, w.pick(0.0, 1.0)),
    "density inf": lambda w: w.make_body(1.0, 0.3, w.pick(INF, 1.0)),
    "modulus, a constant, nan": lambda w: w.make_body(w.make_constant(w.pick(NAN, 1.0))),
    "modulus, a function, 0": lambda w: w.make_body(w.make_function(w.pick(0.0, 1.0))),
    "modulus, a function, nan": lambda w: w.make_body(w.make_function(w.pick(NAN, 1.0))),
    "modulus, a vector": lambda w: w.make_body(w.make_constant(w.pick((1.0, 2.0), 1.0))),
    "ratio, a function, .8": lambda w: w.make_body(1.0, w.make_function(w.pick(0.8, 0.3))),
    "motion nan": lambda w: w.solve_step([Motion((0, w.pick(NAN, 0.1)))]),
    "motion a word": lambda w: w.solve_step([Motion(w.pick("x", (0, 0)))]),
    "motion a number": lambda w: w.solve_step([Motion(w.pick(0.1, (0, 0)))]),
    "motion with a force": lambda w: w.solve_step([Motion((0, 0), w.pick((0, 1.0), None))]),
    "motion with a torque": lambda w: w.solve_step([Motion((0, 0), torque=w.pick(1.0, 0.0))]),
    "motion's force too long": lambda w: w.solve_step(
        [Motion((0, None), w.pick((0, 1, 2), (0, 1)))]
    ),
    "rotation nan": lambda w: w.solve_step([Motion((0, 0), rotation=w.pick(NAN, 0.0))]),
    "plane without direction": lambda w: w.solve_contact(
        floor_pair(surface=Plane((0, 0), w.pick((0, 0), (0, 1))))
    ),
    "plane at nan": lambda w: w.solve_contact(
        floor_pair(surface=Plane((0, w.pick(NAN, 0)), (0, 1)))
    ),
    "parabola flat": lambda w: w.solve_contact(
        floor_pair(surface=Parabola((0, 0), w.pick(0.0, -9.0)))
    ),
    "sphere inside out": lambda w: w.solve_contact(
        floor_pair(surface=Sphere((2, -9), w.pick(-9.0, 9.0)))
    ),
    "punch of no width": lambda w: w.solve_contact(
        floor_pair(surface=FlatPunch((2, 0), (0, 1), w.pick(0.0, 3.0)))
    ),
    "distance without function": lambda w: w.solve_contact(
        floor_pair(surface=SignedDistance(w.pick(None, signed_distance_to_circle)))
    ),
    "distance with a gradient 1": lambda w: w.solve_contact(
        floor_pair(surface=SignedDistance(signed_distance_to_circle, w.pick(1.0, None)))
    ),
    "distance with step 0": lambda w: w.solve_contact(
        floor_pair(surface=SignedDistance(signed_distance_to_circle, step=w.pick(0.0, 1e-6)))
    ),
    "friction -1": lambda w: w.solve_contact(floor_pair(w.pick(-1.0, 0.3))),
    "friction nan": lambda w: w.solve_contact(floor_pair(w.pick(NAN, 0.3))),
    "friction a word": lambda w: w.solve_contact(floor_pair(w.pick("x", 0.3))),
    "interference a word": lambda w: w.solve_contact(floor_pair(interference=w.pick("x", False))),
    "no surface": lambda w: w.solve_contact(floor_pair(surface=w.pick(None, FLOOR))),
    "no nodes": lambda w: w.solve_contact(ContactPair(w.pick(None, BOTTOM_MARKER), FLOOR)),
    "surface and nodes exchanged": lambda w: w.solve_contact(
        ContactPair(*w.pick((FLOOR, BOTTOM_MARKER), (BOTTOM_MARKER, FLOOR)))
    ),
    "motions of a pair 0.1": lambda w: w.solve_contact(
        floor_pair(motions=w.pick([0.1], ZERO_MOTION))
    ),
    "axis without pivot": lambda w: w.solve_contact(floor_pair(axis=w.pick((0, 0, 1), None))),
    "deformable, no facets": lambda w: w.solve_contact(
        floor_pair(surface=DeformableSurface(w.pick(None, TOP_MARKER)))
    ),
    "deformable, revolved a word": lambda w: w.solve_contact(
        floor_pair(surface=DeformableSurface(TOP_MARKER, w.pick("x", False)))
    ),
    "matching without shape": lambda w: w.solve_contact(
        floor_pair(surface=MatchingNodes(TOP_MARKER, w.pick(0.3, FLOOR)))
    ),
    "matching, offset nan": lambda w: w.solve_contact(
        floor_pair(surface=MatchingNodes(TOP_MARKER, FLOOR, (0, w.pick(NAN, 2.0))))
    ),
    "direct, options 3": lambda w: solve(w.K, w.load, w.clamped, Direct(w.pick(3, {}))),
    "direct, an option None": lambda w: solve(
        w.K, w.load, w.clamped, Direct(w.pick({"ksp_rtol": None}, {}))
    ),
    "direct, endless": lambda w: solve(
        w.K, w.load, w.clamped, Direct(w.pick({"ksp_max_it": -3}, {}))
    ),
    "iterative, tolerance 2": lambda w: solve(w.K, w.load, w.clamped, Iterative(w.pick(2.0, 1e-9))),
    "iterative, other levels": lambda w: solve(
        w.K, w.load, w.clamped, Iterative(options=w.pick({"pc_type": "lu"}, {}))
    ),
    "iterative, endless": lambda w: solve(
        w.K, w.load, w.clamped, Iterative(options=w.pick({"mg_levels_1_ksp_max_it": -3}, {}))
    ),
    "material by tag": lambda w: Body.from_mesh(
        w.mesh, Material(w.pick(-2.0, 2.0)), "plane strain"
    ),
    "motion in a sequence": lambda w: w.solve_contact(
        floor_pair(motions=[Motion((0, w.pick(INF, 0)))])
    ),
}

# Calls with valid arguments or functions that differ on one process
CALLS_DIFFERENT_ON_ONE_RANK = {
    "modulus": lambda w: w.make_body(w.pick(2.0, 1.0), 0.3),
    "modulus by the last digit": lambda w: w.make_body(w.pick(1.0 + 2**-52, 1.0), 0.3),
    "density": lambda w: w.make_body(1.0, 0.3, w.pick(2.0, 1.0)),
    "modulus, a constant": lambda w: w.make_body(w.make_constant(w.pick(2.0, 1.0))),
    "state of stress": lambda w: Body.from_mesh(
        w.mesh, Material(1.0, 0.3), w.pick("plane stress", "plane strain")
    ),
    "height of a plane": lambda w: w.solve_contact(
        floor_pair(surface=Plane((0, w.pick(-0.1, 0)), (0, 1)))
    ),
    "kind of a surface": lambda w: w.solve_contact(
        floor_pair(surface=w.pick(Parabola((2, 0), -9.0), FLOOR))
    ),
    "hidden height": lambda w: w.solve_contact(
        floor_pair(surface=PlaneWithPrivateData(w.pick(-0.1, 0.0)))
    ),
    "hidden height, hardly": lambda w: w.solve_contact(
        floor_pair(surface=PlaneWithPrivateData(w.pick(-1e-4, 0.0)))
    ),
    "hidden and far away": lambda w: w.solve_contact(
        floor_pair(surface=PlaneWithPrivateData(0.0, w.pick(0.5, 0.0)))
    ),
    "hidden closest points": lambda w: w.solve_residual_step(
        PlaneWithWrongClosestPoints(w.pick(0.1, 0.0))
    ),
    "distance": lambda w: w.solve_contact(
        floor_pair(surface=SignedDistance(w.pick(lambda x: x[:, 1] + 0.1, lambda x: x[:, 1])))
    ),
    "radius in a function": lambda w: w.solve_residual_step(
        SignedDistance(
            w.pick(lambda x: signed_distance_to_circle(x, 51.0), signed_distance_to_circle)
        )
    ),
    "gradient, of other sign": lambda w: w.solve_residual_step(
        SignedDistance(
            signed_distance_to_circle,
            w.pick(lambda x: -gradient_of_distance_to_circle(x), gradient_of_distance_to_circle),
        )
    ),
    "gradient missing": lambda w: w.solve_residual_step(
        SignedDistance(signed_distance_to_circle, w.pick(None, gradient_of_distance_to_circle))
    ),
    "friction in a function": lambda w: w.solve_contact(
        floor_pair(w.pick(lambda x: 0.4 + 0 * x[0], lambda x: 0.3 + 0 * x[0]))
    ),
    "friction at one node": lambda w: w.solve_contact(
        floor_pair(w.pick(lambda x: 0.3 + (x[0] > 3.9), lambda x: 0.3 + 0 * x[0]))
    ),
    "hidden coefficient of a law": lambda w: w.solve_contact(
        floor_pair(FrictionLawWithPrivateData(w.pick(0.4, 0.3)))
    ),
    "hidden limit of a law": lambda w: w.solve_contact(
        floor_pair(FrictionLawWithPrivateData(max_force=w.pick(1e2, 1e3)))
    ),
    "kind of a law": lambda w: w.solve_contact(
        floor_pair(w.pick(FrictionLawWithPrivateData(), Coulomb(0.3)))
    ),
    "size of a law's answer": lambda w: w.solve_contact(
        floor_pair(FrictionLawWithPrivateData(size=w.pick(1, None)))
    ),
    "depth of an interference": lambda w: w.solve_contact(
        floor_pair(interference=w.pick(True, False))
    ),
    "number of motions": lambda w: w.solve_contact(
        floor_pair(motions=[ZERO_MOTION] * w.pick(2, 1))
    ),
    "number of loads": lambda w: w.solve_contact(loads=[w.load] * w.pick(2, 1)),
    "maximum of iterations": lambda w: w.solve_contact(max_iterations=w.pick(40, 50)),
    "remedies": lambda w: w.solve_contact(remedies=w.pick(("springs",), ("cutback",))),
    "solver": lambda w: w.solve_contact(solver=w.pick(Direct(), None)),
    "solver's options": lambda w: w.solve_contact(
        solver=Direct({"mat_mumps_icntl_14": w.pick(50, 60)})
    ),
    "tolerance": lambda w: w.solve_contact(solver=Iterative(w.pick(1e-10, 1e-11))),
    "marker of a pair": lambda w: w.solve_contact(
        ContactPair(w.pick(lambda x: BOTTOM_MARKER(x) & (x[0] < 3.6), BOTTOM_MARKER), FLOOR, 0.3)
    ),
    "marker of supports": lambda w: prescribe(w.U, 0, w.pick(TOP_MARKER, BOTTOM_MARKER)),
    "marker of a load": lambda w: nodal_load(w.U, w.pick(TOP_MARKER, BOTTOM_MARKER), (1.0, 0.0)),
    "marker of facets": lambda w: boundary_measure(w.mesh, w.pick(TOP_MARKER, BOTTOM_MARKER)),
    "marker of a surface": lambda w: SurfaceNodes.from_body(
        w.block.body, w.pick(TOP_MARKER, BOTTOM_MARKER)
    ),
    "marker of forces": lambda w: forces_along(w.U, w.load, w.pick(BOTTOM_MARKER, TOP_MARKER)),
    "prescribed value": lambda w: prescribe(w.U, 0, BOTTOM_MARKER, w.pick(0.1, 0.0)),
    "prescribed component": lambda w: prescribe(w.U, w.pick(1, 0), BOTTOM_MARKER),
    "prescribed constant": lambda w: Reduction.dirichlet(
        w.U, [prescribe(w.U, 0, BOTTOM_MARKER, w.make_constant(w.pick(0.1, 0.0)))]
    ),
    "conditions": lambda w: Reduction.dirichlet(w.U, w.foot_conditions[: w.pick(1, 2)]),
    "image": lambda w: move_nodes(square_mesh(), w.pick(lambda x: 1.1 * x, lambda x: x)),
    "image of a curved mesh": lambda w: curved_mesh(
        square_mesh(), w.pick(lambda x: 1.1 * x, lambda x: x)
    ),
    "divisions": lambda w: triangles(COMM, (0, 0), (1, 1), (4, w.pick(5, 4))),
    "path in time": lambda w: w.solve_impact(paths=w.pick(lambda t: (0, 2 * t), lambda t: (0, t))),
    "path of another time": lambda w: w.solve_impact(
        duration=1e-2, paths=lambda t: (0, t * (1 + w.pick(t > 5e-3, 0)))
    ),
    "duration": lambda w: w.solve_impact(duration=w.pick(2e-4, 1e-4)),
    "load of a step": lambda w: solve_step_with_prescribed_constant(w, w.pick(2.0, 1.0)),
    "load of a problem": lambda w: w.solve_nonlinear(
        load=lambda share: w.foot_conditions[0].g.value.__setitem__((), w.pick(0.1, 0.0) * share)
    ),
    "load missing": lambda w: w.solve_nonlinear(load=w.pick(None, lambda share: None)),
    "history": lambda w: w.solve_residual_step(history=[w.make_function(0.0)] * w.pick(0, 1)),
    "new value of the history": lambda w: w.solve_residual_step(
        history={(number := w.make_history_number()): number + w.pick(0.1, 0.2)}
    ),
    "new value of the history missing": lambda w: w.solve_residual_step(
        history=w.pick([number := w.make_history_number()], {number: 1.5 * number})
    ),
    "motion": lambda w: w.solve_step([Motion((0, w.pick(-0.1, 0.0)))]),
    "motion missing": lambda w: w.solve_step(w.pick([], [Motion((0, -0.1))])),
    "count": lambda w: vibration_modes(
        w.K, assemble_matrix(w.block.body.mass()), w.clamped, w.pick(2, 1)
    ),
    "force of a load": lambda w: assemble_vector(w.block.body.body_load((0.0, w.pick(1.0, 2.0)))),
    "form": lambda w: assemble_scalar(w.pick(2.0, 1.0) * w.make_constant(1.0) * ufl.dx),
    "file to be read": lambda w: ContactProblem(w.K, w.free, floor_pair(), w.U).load(
        w.pick("/nowhere/a.npz", "/nowhere/b.npz")
    ),
    "what has changed": lambda w: ContactProblem(w.K, w.free, floor_pair(), w.U).load(
        "/nowhere/a.npz", w.pick(["friction"], [])
    ),
    "depth of a flux": lambda w: nodal_flux(
        Spaces.petrov_galerkin(w.mesh, 0),
        make_scalar_reaction_vector(w),
        BOTTOM_MARKER,
        depth=w.pick(2.0, 1.0),
    ),
    "times of a file": lambda w: write(
        "/nowhere/a.bp", make_undeformed_states(w), w.block.body, [w.pick(1.0, 2.0)]
    ),
    "axis of a picture": lambda w: plot(
        make_undeformed_states(w)[0], w.block.body, along=w.pick(1, 0)
    ),
    "pivot": lambda w: w.solve_contact(floor_pair(pivot=w.pick((0, 0), None))),
}

# Calls in which arguments or results of users' functions are not finite on one process
CALLS_NAN_ON_ONE_RANK = {
    "gap": lambda w: w.solve_contact(floor_pair(surface=PlaneWithPrivateData(w.pick(NAN, 0.0)))),
    "gap far away": lambda w: w.solve_contact(
        floor_pair(surface=PlaneWithPrivateData(0.0, w.pick(NAN, 0.0)))
    ),
    "closest points": lambda w: w.solve_residual_step(
        PlaneWithWrongClosestPoints(w.pick(NAN, 0.0))
    ),
    "law": lambda w: w.solve_contact(
        floor_pair(FrictionLawWithPrivateData(max_force=w.pick(NAN, 1e3)))
    ),
    "law's parameter": lambda w: w.solve_contact(
        floor_pair(FrictionLawWithPrivateData(w.pick(NAN, 0.3)))
    ),
    "friction": lambda w: w.solve_contact(floor_pair(lambda x: w.pick(NAN, 0.3) + 0 * x[0])),
    "distance": lambda w: w.solve_contact(
        floor_pair(surface=SignedDistance(lambda x: w.pick(NAN, 1.0) * x[:, 1]))
    ),
    "gradient": lambda w: w.solve_residual_step(
        SignedDistance(
            signed_distance_to_circle,
            lambda x: w.pick(NAN, 1.0) * gradient_of_distance_to_circle(x),
        )
    ),
    "load": lambda w: solve(w.K, w.load_differing_on_one_rank(NAN), w.clamped),
    "load of contact": lambda w: w.solve_contact(loads=w.load_differing_on_one_rank(NAN)),
    "load of a step": lambda w: w.solve_step(load=w.load_differing_on_one_rank(INF)),
    "velocity": lambda w: w.solve_impact(velocity=w.load_differing_on_one_rank(NAN)),
    "load in time": lambda w: w.solve_impact(load=lambda t: w.load_differing_on_one_rank(NAN)),
    "path": lambda w: w.solve_impact(paths=lambda t: (0, w.pick(NAN, 0.0))),
    "image": lambda w: move_nodes(square_mesh(), lambda x: w.pick(NAN, 1.0) * x),
    "prescribed function": lambda w: Reduction.dirichlet(
        w.U,
        [
            fem.dirichletbc(
                w.make_function(w.pick(NAN, 0.0), w.U),
                fem.locate_dofs_geometrical(w.U, BOTTOM_MARKER),
            )
        ],
    ),
    "guess": lambda w: w.solve_nonlinear(w.pick(NAN, 0.0)),
    "displacement of a picture": lambda w: ContactFields.from_state(
        state_with_nan_on_differing_rank(w), w.block.body
    ),
    "state": lambda w: w.solve_step(state=state_with_nan_on_differing_rank(w)),
    "history that update sets": lambda w: w.solve_residual_step(
        history=[(variable := w.make_function(0.0))],
        update=make_value_setter(variable, w.pick(NAN, 0.0)),
        load=lambda share: None,
        max_iterations=25,
        callback=None,
    ),
    "history that a new value sets": lambda w: w.solve_residual_step(
        history={(number := w.make_history_number()): number / w.make_function(w.pick(0.0, 1.0))}
    ),
    "history from the start": lambda w: w.solve_residual_step(
        history=[w.make_function(w.pick(NAN, 0.0))]
    ),
    "reactions": lambda w: forces_along(w.U, w.load_differing_on_one_rank(NAN), BOTTOM_MARKER),
    "flux": lambda w: nodal_flux(
        Spaces.petrov_galerkin(w.mesh, 0), make_scalar_reaction_vector(w, NAN), BOTTOM_MARKER
    ),
    "prescribed value": lambda w: prescribe(w.U, 0, BOTTOM_MARKER, w.pick(NAN, 0.0)),
    "traction": lambda w: w.block.body.surface_load(
        (0.0, w.pick(NAN, 1.0)), boundary_measure(w.mesh, TOP_MARKER)
    ),
    "traction, a function": lambda w: solve(
        w.K,
        assemble_vector(
            w.block.body.body_load(ufl.as_vector([0.0, 1.0]) * w.make_function(w.pick(NAN, 1.0)))
        ),
        w.clamped,
    ),
    "thickness": lambda w: Body(
        w.spaces, Material(1.0), "plane stress", w.make_function(w.pick(NAN, 1.0))
    ),
    "coefficients": lambda w: Sibling.from_space(Spaces.galerkin(w.mesh).trial).displacement(
        w.load_differing_on_one_rank(NAN)
    ),
    "mass": lambda w: lumped_mass(diagonal_matrix(w.K, w.load_differing_on_one_rank(NAN)), w.U),
    "force": lambda w: reactions(w.K, w.load_differing_on_one_rank(NAN), w.load),
}

# Calls with functions that communicate, or with differences that are allowed
CALLS_SUCCEEDING_ON_ALL_RANKS = {
    "surface talks": lambda w: w.solve_contact(floor_pair(surface=CommunicatingPlane(0.0))),
    "surface talks at large strains": lambda w: w.solve_residual_step(CommunicatingPlane(0.0)),
    "distance talks": lambda w: w.solve_contact(
        floor_pair(surface=SignedDistance(lambda x: return_after_collective_call(x[:, 1])))
    ),
    "distance talks at large strains": lambda w: w.solve_residual_step(
        SignedDistance(lambda x: return_after_collective_call(signed_distance_to_circle(x)))
    ),
    "gradient talks": lambda w: w.solve_residual_step(
        SignedDistance(
            signed_distance_to_circle,
            lambda x: return_after_collective_call(gradient_of_distance_to_circle(x)),
        )
    ),
    "infinite distance talks": lambda w: w.solve_residual_step(
        SignedDistance(
            lambda x: return_after_collective_call(
                np.where(np.abs(x[:, 0] - 2) < 1.3, signed_distance_to_circle(x), np.inf)
            )
        )
    ),
    "law talks": lambda w: w.solve_contact(floor_pair(CommunicatingFrictionLaw())),
    "friction talks": lambda w: w.solve_contact(
        floor_pair(lambda x: return_after_collective_call(0.3 + 0 * x[0]))
    ),
    "marker talks": lambda w: prescribe(
        w.U, 0, lambda x: return_after_collective_call(BOTTOM_MARKER(x))
    ),
    "load talks": lambda w: w.solve_residual_step(
        load=lambda share: return_after_collective_call(None)
    ),
    "update talks": lambda w: w.solve_residual_step(
        update=lambda: return_after_collective_call(None)
    ),
    "new value of the history": lambda w: w.solve_residual_step(
        history={(number := w.make_history_number()): 1.5 * number}
    ),
    "path talks": lambda w: w.solve_impact(paths=lambda t: return_after_collective_call((0, 0))),
    "callback of one process": lambda w: w.solve_contact(
        callback=w.pick(lambda progress: None, None)
    ),
    "numbers of nodes": lambda w: w.solve_contact(
        ContactPair(fem.locate_dofs_geometrical(w.U, BOTTOM_MARKER), FLOOR, 0.3)
    ),
    "zero of either sign": lambda w: w.solve_contact(
        floor_pair(surface=Plane((0, w.pick(-0.0, 0.0)), (0, 1)))
    ),
    "list and tuple": lambda w: w.solve_contact(
        floor_pair(surface=Plane(w.pick([0, 0], (0, 0)), (0, 1)))
    ),
    "statement of one process": lambda w: w.pick(Material(2.0, 0.3), None) and None,
}


def square_mesh():
    return triangles(COMM, (0, 0), (1, 1), (4, 4))


def make_undeformed_states(block):
    return [ContactProblem(block.K, block.free, floor_pair(), block.U).undeformed]


def state_with_nan_on_differing_rank(block):
    (state,) = make_undeformed_states(block)
    (pair,) = state.pairs
    force = pair.force_normal + block.pick(NAN, 0.0)
    return replace(state, pairs=(replace(pair, force_normal=force),))


def make_scalar_reaction_vector(block, value_on_differing_rank=0.0):
    scalars = Spaces.petrov_galerkin(block.mesh, 0).trial.dofmap.index_map
    vector = PETSc.Vec().createMPI((scalars.size_local, scalars.size_global), comm=COMM)
    if block.is_selected:
        vector.array[:] += value_on_differing_rank
    return vector


def diagonal_matrix(K, vector):
    """Return a matrix with the parallel layout of K and with a vector on its diagonal."""
    matrix = K.duplicate()
    matrix.setDiagonal(vector)
    matrix.assemble()
    return matrix


def solve_step_with_prescribed_constant(block, displacement):
    load = block.make_constant(0.0)

    def set_load(load_factor):
        load.value = displacement * load_factor

    return block.solve_residual_step(
        load=set_load,
        conditions=[prescribe(block.U, 0, lambda x: on_plane(0, 0.0)(x) & (x[1] > 1), load)],
    )
