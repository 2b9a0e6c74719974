"""The equations of one increment: equilibrium, kinematics and the law, solved and evaluated.

The module guarantees that the violation of a state counts every condition of the law, every free
equation and every balance. A linear equilibrium is the case whose tangent is constant: its factors
are kept by the contact system. It assumes that arguments have been checked where the user calls.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from pw_elements.algebra import reduce_load
from pw_elements.arrays import Array
from pw_elements.contact.interface import ROUND_OFF, Interface
from pw_elements.contact.iteration.support_friction import SupportFriction
from pw_elements.contact.model import NotFound, NotUnique
from pw_elements.contact.nodes import (
    TOLERANCE,
    ActiveSet,
    ContactNodes,
    IncrementStart,
    Kinematics,
    LinearisedKinematics,
    TorqueMap,
    count_statuses,
    eliminate_known_motions,
)
from pw_elements.contact.system import Accuracy, ContactSystem
from pw_elements.solvers import SingularSystem

# Round-off in K a, relative to |K| |a|
DISPLACEMENT_ROUND_OFF = 1e-13
# Relative change of friction beside a singular tangent, and of a solution that goes on there
_FRICTION_PERTURBATION = 1e-6
_MAX_SOLUTION_CHANGE = 1e-3


class Equilibrium(Protocol):
    """Equilibrium of a body with its contact forces, K a = f + H r where it is linearised.

    Attributes:
        offset: (n,), displacements that supports prescribe at the end.
        needs_final_solution: whether the last linear system has to be solved to the final accuracy.
            It need not where forces are computed anew from the displacements.
    """

    @property
    def offset(self) -> PETSc.Vec: ...

    @property
    def needs_final_solution(self) -> bool: ...

    def linearise(self, torque_map: TorqueMap) -> PETSc.Vec:
        """Set the tangent of the contact system, with torques; return the reduced load f."""

    def line_search_to(self, reduced: PETSc.Vec) -> float:
        """Go to a solution of the linear equations; return the accepted part of the step."""

    def residual(self, reduced: PETSc.Vec) -> PETSc.Vec:
        """Return the reduced forces that no load balances: where nothing touches they vanish."""

    def displacements(self, reduced: PETSc.Vec) -> PETSc.Vec:
        """Return all unknowns (n,)."""

    def violation(self, unbalanced: Array, contact_allowance: float, full: PETSc.Vec) -> float:
        """Return unbalanced forces over what is allowed, of which that of contact is a part."""


@dataclass(frozen=True)
class LinearEquilibrium:
    """Equilibrium K a = f + H r of a body under small strains, reduced by its supports.

    Args:
        stiffness: K, reduced: the tangent at any a.
        load: f, reduced.
        right: R, (n, n_r), of all unknowns R a_r + a_0.
        offset: a_0, (n,).
        max_row_sum: largest sum of magnitudes in a row of K.
    """

    stiffness: PETSc.Mat
    load: PETSc.Vec
    right: PETSc.Mat
    offset: PETSc.Vec
    max_row_sum: float = 0.0

    needs_final_solution = True

    @classmethod
    def from_stiffness(
        cls, system: ContactSystem, K: PETSc.Mat, load: PETSc.Vec, load_factor: float = 1.0
    ) -> "LinearEquilibrium":
        """Reduce K (n, n) and f (n,) by the supports, whose displacements `load_factor` scales."""
        reduction = system.reduction
        if load_factor != 1:
            reduction = replace(reduction, offset=load_factor * reduction.offset)
        reduction, reduced_load = reduce_load(reduction, K, load)
        max_row_sum = K.norm(PETSc.NormType.INFINITY)
        return cls(system.stiffness, reduced_load, reduction.right, reduction.offset, max_row_sum)

    def linearise(self, torque_map: TorqueMap) -> PETSc.Vec:  # noqa: ARG002
        return self.load

    def line_search_to(self, reduced: PETSc.Vec) -> float:  # noqa: ARG002
        return 1.0

    def violation(self, unbalanced: Array, contact_allowance: float, full: PETSc.Vec) -> float:
        load, displacement = (v.norm(PETSc.NormType.INFINITY) for v in (self.load, full))
        round_off = DISPLACEMENT_ROUND_OFF * self.max_row_sum * displacement
        allowed = contact_allowance + TOLERANCE * load + round_off
        largest = float(unbalanced.max(initial=0.0))
        return largest / allowed if largest else 0.0

    def residual(self, reduced: PETSc.Vec) -> PETSc.Vec:
        residual = self.load.duplicate()
        self.stiffness.mult(reduced, residual)
        residual.axpy(-1.0, self.load)
        return residual

    def displacements(self, reduced: PETSc.Vec) -> PETSc.Vec:
        full = self.offset.duplicate()
        self.right.multAdd(reduced, self.offset, full)
        return full


@dataclass(frozen=True)
class NewtonState:
    """An iterate: the solution of one linear system, and the law evaluated there.

    Args:
        reduced: displacements, reduced by the supports.
        unknowns: all of them, (n,).
        q: motions of the surfaces, (pairs, k).
        displacement: of the points, (m, dim).
        force: of the surfaces on the points, (m, dim).
        unbalanced: sizes of unbalanced forces in the equations of this process.
        nodes: gaps, slips and forces in the frames.
        kinematics: through which they are seen.
        displacement_size: (m, dim), how far a point and what it faces have moved together.
        allowance: force by which the law may be violated.
        round_off: force that may be nothing but round-off, a part of the allowance.
        violation: of the law, equilibrium and balances, over what is allowed.
        is_solution: whether nothing is violated, by a system that was solved exactly enough.
        is_exact: whether the same system, solved again, would give nothing better.
        is_final: whether it was solved exactly enough for an end.
    """

    reduced: PETSc.Vec
    unknowns: PETSc.Vec
    q: Array
    displacement: Array
    force: Array
    unbalanced: Array
    nodes: ContactNodes
    kinematics: LinearisedKinematics
    displacement_size: Array
    allowance: float
    round_off: float
    violation: float
    is_solution: bool
    is_exact: bool
    is_final: bool


class Increment:
    """The equations of one increment.

    Args:
        system: linear systems of the contact nodes.
        equilibrium: of the body at the increment's end.
        kinematics: of the contact points since its start.
        start: the state from which slip counts.
        prescribed: motions of the surfaces (pairs, k), NaN where they are free.
        totals: (free,), forces on the free motions, and torques.

    Attributes:
        nearest: the state with the least violation so far.
    """

    def __init__(
        self,
        system: ContactSystem,
        equilibrium: Equilibrium,
        kinematics: Kinematics,
        start: IncrementStart,
        *,
        prescribed: Array,
        totals: Array,
    ) -> None:
        self.system, self.equilibrium, self.start = system, equilibrium, start
        self.interface: Interface = system.interface
        self.kinematics = kinematics
        self.prescribed, self.totals = prescribed, totals
        self.nearest: NewtonState | None = None
        self._support_displacement = system.point_displacements(equilibrium.offset)

    @cached_property
    def support_friction(self) -> SupportFriction:
        """Friction on supports, which is made where supports hold nodes along a rough surface."""
        return SupportFriction(self.system, self.start, self.prescribed, self._support_displacement)

    def make_first_set(self, active: ActiveSet, kinematics: LinearisedKinematics) -> ActiveSet:
        """Return an active set with the friction on supports of the increment's start."""
        if not self.interface.holds_friction:
            return active
        return self.support_friction.start_set(active, kinematics)

    def solve(
        self, active: ActiveSet, kinematics: LinearisedKinematics, accuracy: Accuracy
    ) -> NewtonState:
        """Solve the linear system of an active set and evaluate the law at its solution.

        Raises:
            SingularSystem: if the tangent is singular.
            NotConverged: if an iterative solver fails.
        """
        system, equilibrium = self.system, self.equilibrium
        known_q = np.nan_to_num(self.prescribed)[self.interface.pair]
        torque_map = kinematics.torque_map.eliminate_known(known_q, self._support_displacement)
        load = equilibrium.linearise(torque_map)
        known_v = system.point_motions(equilibrium.offset)
        law = kinematics.linearise_law(active, system.law_scale)
        law = eliminate_known_motions(law, known_q, known_v)
        totals: Array = self.totals
        springs: Array = np.zeros(len(system.free_motions))
        if self.interface.holds_friction and system.free_motions:
            totals, springs = self.support_friction.reduce_totals(totals, active, kinematics)
        solution = system.solve(
            load,
            law,
            totals,
            torque_map=torque_map,
            accuracy=accuracy,
            friction_springs=springs,
        )
        q = system.fill_free_motions(self.prescribed, solution.free_motions)
        step_length = equilibrium.line_search_to(solution.reduced_unknowns)
        if step_length < 1:
            q = kinematics.q0 + step_length * (q - kinematics.q0)
            system.set_initial_iterate(
                lambda: equilibrium.displacements(solution.reduced_unknowns), q
            )
        return self.evaluate(
            solution.reduced_unknowns,
            q,
            kinematics,
            support_friction=active.support_friction,
            is_exact=solution.is_exact,
            is_final=solution.is_final or not equilibrium.needs_final_solution,
        )

    def evaluate(
        self,
        reduced: PETSc.Vec,
        q: Array,
        kinematics: LinearisedKinematics,
        *,
        support_friction: Array | None = None,
        is_exact: bool = True,
        is_final: bool = True,
    ) -> NewtonState:
        """Evaluate the law at reduced displacements and motions q (pairs, k) of the surfaces.

        `support_friction` (m, dim - 1) is that of the iteration before, by default of the
        increment's start; the others are explained at `NewtonState`.
        """
        interface, system = self.interface, self.system
        unknowns = self.equilibrium.displacements(reduced)
        residual = self.equilibrium.residual(reduced)
        displacement = system.point_displacements(unknowns)
        displacement_size = system.displacement_sizes(unknowns)
        force, unbalanced = system.split_residual(residual)
        kinematics, v = self.kinematics.evaluate_iterate(kinematics, q, displacement, force)
        nodes = kinematics.evaluate_nodes(v, q, force, cone=interface.cone, scale=system.law_scale)
        if interface.holds_friction:
            if support_friction is None:
                support_friction = self.support_friction.at_start(kinematics)
            nodes, force = self.support_friction.add_to_nodes(
                nodes, kinematics, force, support_friction
            )
        largest_force, of_displacements, of_coordinates = self._force_sizes(
            force, displacement_size, kinematics.torque_map
        )
        state = NewtonState(
            reduced=reduced,
            unknowns=unknowns,
            q=q,
            displacement=displacement,
            force=force,
            unbalanced=unbalanced,
            nodes=nodes,
            kinematics=kinematics,
            displacement_size=displacement_size,
            allowance=TOLERANCE * largest_force + (of_displacements + of_coordinates),
            round_off=of_displacements + of_coordinates,
            violation=np.inf,
            is_solution=False,
            is_exact=is_exact,
            is_final=is_final,
        )
        allowed = TOLERANCE * largest_force + of_displacements
        violation = self.violation(state, allowed, of_coordinates)
        return replace(state, violation=violation, is_solution=violation <= 1 and is_final)

    def relinearise(self, state: NewtonState) -> NewtonState:
        """Evaluate the law again at a solution, with kinematics linearised there."""
        if not state.is_solution:
            return state
        kinematics = self.kinematics.evaluate_solution(
            state.kinematics, state.q, state.displacement, state.force
        )
        if kinematics is state.kinematics:
            return state
        held_friction = np.where(kinematics.held_tangents, state.nodes.force[:, 1:], 0.0)
        there = self.evaluate(
            state.reduced,
            state.q,
            kinematics,
            support_friction=held_friction,
            is_exact=state.is_exact,
            is_final=state.is_final,
        )
        if there.violation > 1 and self._is_settled(state):
            return state  # a surface's function has noise, as differences have
        return there

    def record(self, state: NewtonState) -> None:
        """Remember the state if none came nearer to a solution."""
        if self.nearest is None or state.violation < self.nearest.violation:
            self.nearest = state

    def residuals(
        self, state: NewtonState, force: float, length: Array | float
    ) -> dict[str, Array]:
        """Return the fields of `Residuals` on this process, over a force and lengths (m,)."""
        return state.nodes.residuals(force, length) | {
            "equilibrium": np.asarray(state.unbalanced / force, dtype=float),
            "balance": self.system.balance_residuals(
                state.force, state.q, self.totals, state.kinematics.torque_map, force
            ),
        }

    def max_over_ranks(self, *arrays: Array) -> list[float]:
        """Return the largest value of each array on all processes, 0 without any."""
        largest = [np.max(values, initial=0.0) for values in arrays]
        return [float(value) for value in np.max(self.system.comm.allgather(largest), axis=0)]

    def violation(self, state: NewtonState, allowed: float, of_coordinates: float) -> float:
        """Return the largest of the residuals over a force, lengths being forces of the nodes.

        Coordinates' round-off is allowed for besides in gaps and balances, and in friction at
        points which are not pressed by more: slips have no coordinates, but friction's limit has
        the gap.
        """
        nodes = state.nodes
        if self.interface.cone.has_user_law:
            self.interface.check_laws(nodes.force[:, 0])
        residuals = self.residuals(state, 1.0, 1 / nodes.scale)
        of_friction = nodes.friction_round_off(of_coordinates)
        worst = self.equilibrium.violation(
            residuals.pop("equilibrium"), allowed + of_coordinates, state.unknowns
        )
        for name, values in residuals.items():
            is_friction = name in ("cone", "stick", "direction")
            limit = allowed + (of_friction if is_friction else of_coordinates)
            ratio = np.divide(values, limit, out=np.zeros_like(values), where=values != 0)
            largest = float(ratio.max(initial=0.0))
            worst = max(worst, np.inf if np.isnan(largest) else largest)
        return float(self.system.comm.allreduce(worst, MPI.MAX))

    def _is_settled(self, state: NewtonState) -> bool:
        """Return whether the surfaces are where they were linearised, to the law's tolerance."""
        change = np.abs(state.q - state.kinematics.q0).max()
        largest = self.max_over_ranks(np.abs(state.displacement))[0]
        return bool(change <= TOLERANCE * largest)

    def _force_sizes(
        self, force: Array, displacement_size: Array, torque_map: TorqueMap
    ) -> list[float]:
        """Return the largest force, and those that may be nothing but round-off.

        The latter are of displacements and of coordinates.
        """
        position, scale = self.interface.position, self.system.law_scale[:, None]
        arms = torque_map.V[:, :, position.shape[1] :].sum(axis=2)
        of_displacements = scale * (DISPLACEMENT_ROUND_OFF * displacement_size)
        of_coordinates = scale * (ROUND_OFF * (np.abs(position) + np.abs(arms)))
        return self.max_over_ranks(np.abs(force), of_displacements, of_coordinates)


class LinearIncrement(Increment):
    """An `Increment` at small strains, which tells what a singular tangent means.

    Its rigid motions are all held. So the tangent is singular by friction alone.
    """

    def solve(
        self, active: ActiveSet, kinematics: LinearisedKinematics, accuracy: Accuracy
    ) -> NewtonState:
        """Solve the linear system of an active set and evaluate the law at its solution.

        Raises:
            NotUnique: if the tangent is singular at a solution.
            NotFound: if it is singular elsewhere.
            NotConverged: if an iterative solver fails.
        """
        try:
            return super().solve(active, kinematics, accuracy)
        except SingularSystem as error:
            solve = super().solve
            raise self._diagnose(
                active, error, lambda other: solve(other, kinematics, accuracy)
            ) from error

    def _diagnose(
        self,
        active: ActiveSet,
        error: SingularSystem,
        solve: Callable[[ActiveSet], NewtonState],
    ) -> NotUnique | NotFound:
        """Return the error that a singular tangent stands for.

        With a little more or less friction the tangent is regular. If the equations of the set have
        solutions, they have about the same one then; else one runs away, to either side.
        """
        counts, neighbours = count_statuses(active, self.system.comm), []
        for factor in (1 - _FRICTION_PERTURBATION, 1 + _FRICTION_PERTURBATION):
            perturbed = replace(
                active, slope=factor * active.slope, intercept=factor * active.intercept
            )
            try:
                neighbours.append(solve(perturbed))
            except SingularSystem:
                break
        else:
            less, more = neighbours
            change = (less.unknowns - more.unknowns).norm()
            is_continuous = change <= _MAX_SOLUTION_CHANGE * less.unknowns.norm()
            if is_continuous and less.violation * TOLERANCE <= _MAX_SOLUTION_CHANGE:
                self.nearest = less
                return NotUnique(
                    f"{error}: no rigid motion is free, so the friction of the {counts} is too "
                    "large for a unique answer"
                )
        return NotFound(
            f"{error}, though no rigid motion is free: with the friction of the {counts} the "
            "equations have no solution"
        )
