"""Derivatives of outputs of a load history with respect to its parameters.

At the end of increment k, x_k are the unknowns, A_k is the tangent for the current contact status,
P_k is the derivative of the equations with respect to x_k-1, and b_k is the derivative of the data
with respect to a parameter p. The direct mode solves A_k dx_k = b_k dp - P_k dx_k-1. With the
weights w_k of the outputs, the adjoint mode solves A_k^T l_k = w_k - P_k+1^T l_k+1 for the
multipliers l_k. See the guide's page on theory ("Derivatives"), and P. Michaleris,
D. A. Tortorelli, C. A. Vidal, 1994, doi:10.1002/nme.1620371408.

The module guarantees derivatives of the discrete problem that are exact to the accuracy of the
solver. It assumes Coulomb friction, and states at which no node is about to change its status.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Literal, Protocol, TypeAlias

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import fem
from ufl.algorithms import expand_derivatives

from pw_elements.algebra import PetrovGalerkinProblem, Reduction
from pw_elements.arrays import Array
from pw_elements.checks import format_points
from pw_elements.contact.interface import ContactInterface
from pw_elements.contact.iteration import IncrementEquations, NewtonIterate
from pw_elements.contact.model import ContactState
from pw_elements.contact.nodes import (
    LinearisedContactLaw,
    assemble_active_set_equations,
    eliminate_known_motions,
)
from pw_elements.contact.system import AssembledTangent
from pw_elements.spaces import assemble_scalar, assemble_vector

SensitivityOutput: TypeAlias = (
    ufl.Form | PETSc.Vec | tuple[Literal["force", "translation"], int, int]
)
SensitivityParameter: TypeAlias = (
    fem.Constant
    | tuple[Literal["friction"], int]
    | tuple[Literal["motion"], int, Any]
    | tuple[fem.Constant | PETSc.Vec, Any]
)

# Smallest distance of a node's force from a change of status, relative to the largest nodal force
_MIN_STATUS_MARGIN_PER_MAX_FORCE = 1e-6
# Largest violation of the contact law, relative to its tolerance, that is accepted in the state at
# the end of an increment
_MAX_END_STATE_VIOLATION_PER_TOLERANCE = 10.0


@dataclass(frozen=True)
class IncrementOrSubstep:
    """An increment, or one of the substeps in which an increment was solved. Both are called parts.

    Args:
        increment: number of the increment, counted from 0.
        increment_start: state at the start of the increment.
        part_start: state at the start of the part.
        part_end: state at the end of the part.
        fraction: fraction of the increment's loads and motions that is applied at the end of the
            part.
        load: load of the increment, as it was given to `step`.
    """

    increment: int
    increment_start: ContactState
    part_start: ContactState
    part_end: ContactState
    fraction: float
    load: Any


def iterate_increments_and_substeps(
    states: Sequence[ContactState], loads: Sequence[Any]
) -> Iterator[IncrementOrSubstep]:
    """Yield each increment of a load history, or each of its substeps, in order.

    Args:
        states: states at the start and at the end of all increments.
        loads: load of each increment.

    Raises:
        ValueError: if the free motions of surfaces change in an increment with substeps.
    """
    for k, ((start, end), load) in enumerate(zip(pairwise(states), loads, strict=True)):
        if k and end.substates and start.free_motions != end.free_motions:
            raise ValueError(
                f"state {k + 1} was found in parts while a surface became free or prescribed: the "
                "rates of its motion in the parts are not known. Make smaller increments"
            )
        part_start = start
        for fraction, state in (*end.substates, (1.0, end)):
            yield IncrementOrSubstep(k, start, part_start, state, fraction, load)
            part_start = state


@dataclass(frozen=True)
class StateDerivativeOrWeights:
    """Derivative of a state with respect to a parameter, or weights of all components of a state.

    Args:
        unknowns: derivative or weights (n,) of the unknowns.
        translations: derivative or weights (pairs, dim) of the surfaces' translations, the same on
            all processes.
        force: derivative or weights (m, dim) of the forces on the contact nodes of this process.
    """

    unknowns: PETSc.Vec
    translations: Array
    force: Array

    def add_multiple(
        self, factor: float, other: "StateDerivativeOrWeights"
    ) -> "StateDerivativeOrWeights":
        """Return the sum of this object and `factor` times `other`."""
        unknowns = self.unknowns.copy()
        unknowns.axpy(factor, other.unknowns)
        return StateDerivativeOrWeights(
            unknowns,
            self.translations + factor * other.translations,
            self.force + factor * other.force,
        )

    def inner_product(self, other: "StateDerivativeOrWeights") -> float:
        """Return the sum of the products of all components with those of `other`; collective."""
        comm = self.unknowns.comm.tompi4py()
        of_forces = comm.allreduce(float(np.sum(self.force * other.force)), MPI.SUM)
        of_translations = float(np.sum(self.translations * other.translations))
        return float(self.unknowns.dot(other.unknowns)) + of_forces + of_translations


@dataclass(frozen=True)
class ProblemDataDerivatives:
    """Derivatives of the data at the end of an increment with respect to a parameter.

    Args:
        load: derivative (n,) of the load vector.
        offset: derivative (n,) of the prescribed displacements.
        motions: derivatives (pairs, dim) of prescribed translations, and of prescribed forces where
            a translation is free.
        friction: derivatives (pairs,) of the friction coefficients.
    """

    load: PETSc.Vec
    offset: PETSc.Vec
    motions: Array
    friction: Array


class EquationsLinearisedAtEnd:
    """Equations of an increment or substep, linearised at its end.

    Args:
        increment: equations of the increment or substep.
        end: solution of these equations.
        K: tangent stiffness (n, n), assembled without supports.
        reduction: reduction by the supports.
        by_start: derivatives (m, dim - 1, dim) of the slips of the nodes with respect to their
            motions relative to the surfaces at the start.

    Raises:
        ValueError: if `end` is not a solution, if the status of a node is about to change, if
            friction acts along a direction in which supports hold a node, or if nodes belong to
            several pairs.
    """

    def __init__(
        self,
        increment: IncrementEquations,
        end: NewtonIterate,
        K: PETSc.Mat,
        reduction: Reduction,
        by_start: Array,
    ) -> None:
        if end.violation > _MAX_END_STATE_VIOLATION_PER_TOLERANCE:
            raise ValueError(
                "is not the end of a step from the state before under this load: give the `states` "
                "and `loads` of the computation"
            )
        self._system, self._K, self._reduction = increment.system, K, reduction
        self._raise_if_not_differentiable(end)
        active, kinematics = end.nodes.active_set, end.kinematics
        self._law = kinematics.linearise_law(active, self._system.law_scale)
        self._torque_map = kinematics.torque_map
        to_global = np.swapaxes(kinematics.frame, 1, 2)
        slip_equations = assemble_active_set_equations(active, self._system.law_scale)[1][:, :, 1:]
        self._by_start = to_global @ slip_equations @ by_start
        friction = end.nodes.force[:, :1] * active.direction
        self._by_friction = np.einsum("nat,nt->na", to_global[:, :, 1:], friction)

    def _raise_if_not_differentiable(self, end: NewtonIterate) -> None:
        """Raise ValueError if derivatives do not exist or are not available.

        The causes are a status about to change, friction that supports carry, and nodes that belong
        to several pairs.
        """
        interface, nodes = self._system.interface, end.nodes
        if interface.shared_nodes.exist:
            raise ValueError(
                "has contact nodes that belong to several pairs: its derivatives are not "
                "available. Leave a facet between the pairs"
            )
        is_closed = nodes.trial_pressure > 0
        on_supports = is_closed & (nodes.held_tangents & (nodes.force[:, 1:] != 0)).any(axis=1)
        on_supports |= is_closed & (nodes.has_prescribed_slip | nodes.is_coupled_to_surface)
        positions = interface.gather_values(interface.position[on_supports])
        if len(positions):
            raise ValueError(
                f"has contact nodes, first at {format_points(positions)}, with friction along a "
                "direction in which supports hold them: its derivatives are not available. Let the "
                "pair end before these nodes, or remove the friction there"
            )
        has_free_tangent = nodes.frame[:, 1:].any(axis=2) & ~nodes.held_tangents
        may_slip = is_closed & nodes.cone.has_friction & has_free_tangent.any(axis=1)
        friction_margin = np.abs(
            np.linalg.norm(nodes.trial_friction, axis=1) - nodes.friction_limits_and_slopes[0]
        )
        margin = np.minimum(
            np.abs(nodes.trial_pressure), np.where(may_slip, friction_margin, np.inf)
        )
        max_force = np.linalg.norm(nodes.force, axis=1).max(initial=0.0)
        max_force = self._system.comm.allreduce(max_force, MPI.MAX)
        is_near_change = margin < _MIN_STATUS_MARGIN_PER_MAX_FORCE * max_force + end.round_off
        positions, margins = (
            interface.gather_values(interface.position[is_near_change]),
            interface.gather_values(margin),
        )
        if len(positions):
            raise ValueError(
                f"has contact nodes, first at {format_points(positions)}, about to change their "
                f"status: a force of {margins.min():.1e} is left, beside the largest one of "
                f"{max_force:.1e}, and derivatives differ on either side. Take states a little "
                "before or after"
            )

    def propagate_derivative_to_end(
        self, data_derivatives: ProblemDataDerivatives, start_derivative: StateDerivativeOrWeights
    ) -> StateDerivativeOrWeights:
        """Return the derivative of the state at the end with respect to a parameter.

        Args:
            data_derivatives: derivatives of the data at the end.
            start_derivative: derivative of the state at the start.
        """
        system = self._system
        load, law, totals, translations, offset = self._assemble_derivative_right_hand_side(
            data_derivatives
        )
        start_motion = (
            system.evaluate_relative_point_displacements(start_derivative.unknowns)
            - start_derivative.translations[system.interface.pair]
        )
        law = replace(law, c=law.c - np.einsum("nab,nb->na", self._by_start, start_motion))
        solution = system.solve(load, law, totals, torque_map=self._torque_map)
        for pair_and_axis, value in zip(system.free_motions, solution.free_motions, strict=True):
            translations[pair_and_axis] = value
        unknowns, residual = offset.duplicate(), load.duplicate()
        self._reduction.right.multAdd(solution.reduced_unknowns, offset, unknowns)
        system.stiffness.mult(solution.reduced_unknowns, residual)
        residual.axpy(-1.0, load)
        return StateDerivativeOrWeights(
            unknowns,
            translations,
            system.split_residual_into_contact_and_unbalanced_forces(residual)[0],
        )

    def propagate_weights_to_start(
        self,
        end_weights: StateDerivativeOrWeights,
        data_derivatives_by_parameter: Sequence[ProblemDataDerivatives],
    ) -> tuple[Array, StateDerivativeOrWeights]:
        """Return derivatives of a weighted sum, and the weights of the state at the start.

        The sum is taken over all components of the state at the end, with the given weights.

        Args:
            end_weights: weights of the state at the end.
            data_derivatives_by_parameter: derivatives of the data with respect to each parameter.

        Returns:
            Derivatives (parameters,) of the weighted sum for a fixed state at the start; and the
            derivative of the sum with respect to the state at the start, as weights.
        """
        system, motion = self._system, self._system.interface.motion
        force, right = (
            system.convert_force_weights_to_equation_weights(end_weights.force),
            self._reduction.right.createVecRight(),
        )
        self._reduction.right.multTranspose(end_weights.unknowns, right)
        system.stiffness.multTransposeAdd(force, right, right)
        free_weights = np.array(
            [end_weights.translations[pair_and_axis] for pair_and_axis in system.free_motions]
        )
        assert isinstance(system.tangent, AssembledTangent)
        adjoint = system.tangent.solve_transposed(right.array_r, free_weights, self._law)
        derivatives = np.zeros(len(data_derivatives_by_parameter))
        for number, rates in enumerate(data_derivatives_by_parameter):
            load, law, totals, motion_rates, offset = self._assemble_derivative_right_hand_side(
                rates
            )
            right_hand_sides = np.append(
                *system.assemble_right_hand_sides(load, law, totals, self._torque_map)
            )[: len(adjoint)]
            derivatives[number] = adjoint @ right_hand_sides - force.array_r @ load.array_r
            derivatives[number] += end_weights.unknowns.array_r @ offset.array_r
            derivatives[number] += np.sum(end_weights.translations * motion_rates) * (
                system.comm.rank == 0
            )
        start_weights = -np.einsum(
            "nab,na->nb", self._by_start, system.extract_own_equation_values(adjoint)
        )
        node_weights, unknowns = motion.createVecLeft(), motion.createVecRight()
        node_weights.setArray(start_weights)
        motion.multTranspose(node_weights, unknowns)
        translations = np.zeros_like(end_weights.translations)
        np.add.at(translations, system.interface.pair, -start_weights)
        for values in (derivatives, translations):
            system.comm.Allreduce(MPI.IN_PLACE, values, MPI.SUM)
        return derivatives, StateDerivativeOrWeights(
            unknowns, translations, np.zeros_like(start_weights)
        )

    def _assemble_derivative_right_hand_side(
        self, data_derivatives: ProblemDataDerivatives
    ) -> tuple[PETSc.Vec, LinearisedContactLaw, Array, Array, PETSc.Vec]:
        """Return the right-hand sides of the linearised equations for derivatives of the data.

        Returns:
            Derivative (n_r,) of the reduced load; linearised law, with the derivative of its
            right-hand side; and derivatives of the total forces (free,) of the free motions, of the
            prescribed translations (pairs, dim), and of the prescribed displacements (n,).
        """
        system, translations = self._system, data_derivatives.motions.copy()
        totals = np.array([translations[pair_and_axis] for pair_and_axis in system.free_motions])
        for pair_and_axis in system.free_motions:
            translations[pair_and_axis] = 0.0
        reduction = replace(self._reduction, offset=data_derivatives.offset).with_offset_for_load(
            self._K, data_derivatives.load
        )
        pair = system.interface.pair
        law = replace(self._law, c=data_derivatives.friction[pair, None] * self._by_friction)
        # angles of surfaces that may turn have zero derivatives
        n_angles = law.D.shape[2] - translations.shape[1]
        known_motions = np.pad(translations[pair], [(0, 0), (0, n_angles)])
        law = eliminate_known_motions(
            law, known_motions, system.evaluate_point_motions(reduction.offset)
        )
        return (
            reduction.load(self._K, data_derivatives.load),
            law,
            totals,
            translations,
            reduction.offset,
        )


class ParametricResidual(Protocol):
    """Residual of a body that may depend on parameters, with its Dirichlet conditions."""

    bodies: list[PetrovGalerkinProblem]

    def has_constant_in_residual_or_conditions(self, constant: fem.Constant) -> bool:
        """Return whether the residual or one of its Dirichlet conditions depends on a constant."""

    def prescribed_displacements(self) -> PETSc.Vec:
        """Return the displacements (n,) that conditions prescribe for the current constants."""


@dataclass(frozen=True)
class OutputDerivatives:
    """Derivatives of outputs with respect to parameters, in the direct and the adjoint mode.

    Args:
        interface: the contact nodes.
        linearise_end: function that returns the equations linearised at the end of a part. After
            the call, the unknown function, constants and conditions have their values at this end.
        residual: residual of the body; None if the problem is defined by a stiffness matrix.
        parts: increments and substeps of the load history.
        outputs: outputs, checked by `checks.check_outputs`.
        parameters: parameters with their rates (states, ...), checked by
            `checks.check_and_list_parameters_with_rates`. A rate is the derivative of the data of
            each state with respect to the parameter.
    """

    interface: ContactInterface
    linearise_end: Callable[[IncrementOrSubstep], EquationsLinearisedAtEnd]
    residual: ParametricResidual | None
    parts: Sequence[IncrementOrSubstep]
    outputs: Sequence[SensitivityOutput]
    parameters: Sequence[tuple[SensitivityParameter, Array]]

    def compute_all_by_direct_mode(self) -> Array:
        """Return all derivatives (increments, outputs, parameters), computed in the direct mode."""
        shape = self.parts[-1].increment + 1, len(self.outputs), len(self.parameters)
        derivatives, changes = (
            np.zeros(shape),
            [self._zero_state_derivative()] * len(self.parameters),
        )
        for part in self.parts:
            linearised, rates = (
                self._linearise_or_raise_error_with_location(part),
                self._evaluate_data_derivatives(part),
            )
            changes = [
                linearised.propagate_derivative_to_end(rate, start_change)
                for rate, start_change in zip(rates, changes, strict=True)
            ]
            for i, output in enumerate(self.outputs if part.fraction == 1 else ()):
                weights = self._differentiate_output_by_state(output)
                derivatives[part.increment, i] = [
                    weights.inner_product(change) for change in changes
                ]
                derivatives[part.increment, i] += self._explicit_output_derivatives_by_parameters(
                    output, part
                )
        return derivatives

    def compute_gradient_by_adjoint_mode(self, output_weights: Array) -> Array:
        """Return the gradient of a weighted sum of all outputs, computed in the adjoint mode.

        Args:
            output_weights: weights (increments, outputs) of the outputs at the end of each
                increment.

        Returns:
            Derivatives (parameters,) of the weighted sum.
        """
        gradient, adjoint_weights = np.zeros(len(self.parameters)), self._zero_state_derivative()
        for part in reversed(self.parts):
            linearised, rates = (
                self._linearise_or_raise_error_with_location(part),
                self._evaluate_data_derivatives(part),
            )
            for i, output in enumerate(self.outputs if part.fraction == 1 else ()):
                weight = output_weights[part.increment, i]
                adjoint_weights = adjoint_weights.add_multiple(
                    weight, self._differentiate_output_by_state(output)
                )
                gradient += weight * self._explicit_output_derivatives_by_parameters(output, part)
            part_gradient, adjoint_weights = linearised.propagate_weights_to_start(
                adjoint_weights, rates
            )
            gradient += part_gradient
        return gradient

    def _linearise_or_raise_error_with_location(
        self, part: IncrementOrSubstep
    ) -> EquationsLinearisedAtEnd:
        try:
            return self.linearise_end(part)
        except ValueError as error:
            location = "" if part.fraction == 1 else f", at {part.fraction:.4g} of its increment,"
            raise ValueError(f"state {part.increment + 1}{location} {error}") from error

    def _zero_vector(self) -> PETSc.Vec:
        vector = self.parts[0].increment_start.unknowns.duplicate()
        vector.set(0.0)
        return vector

    def _zero_state_derivative(self) -> StateDerivativeOrWeights:
        start, position = self.parts[0].increment_start, self.interface.position
        return StateDerivativeOrWeights(
            self._zero_vector(), np.zeros_like(start.translations), np.zeros_like(position)
        )

    def _evaluate_data_derivatives(self, part: IncrementOrSubstep) -> list[ProblemDataDerivatives]:
        """Return derivatives of the data at the end of a part with respect to each parameter."""
        rates_of_parameters, number, fraction = [], part.increment, part.fraction
        for parameter, rates in self.parameters:
            rate = (1 - fraction) * rates[number] + fraction * rates[number + 1]
            load, offset = self._zero_vector(), self._zero_vector()
            motions = np.zeros_like(part.part_end.translations)
            friction = np.zeros(len(motions))
            match constant_vector_or_kind_of_parameter(parameter):
                case fem.Constant() as constant:
                    load, offset = self._differentiate_load_and_supports_by_constant(constant, rate)
                case PETSc.Vec() as vector:
                    load.axpy(float(rate), vector)
                case "friction":
                    friction[parameter[1]] = rate
                case _:
                    motions[parameter[1]] = rate
            rates_of_parameters.append(ProblemDataDerivatives(load, offset, motions, friction))
        return rates_of_parameters

    def _differentiate_load_and_supports_by_constant(
        self, constant: fem.Constant, rate: Array
    ) -> tuple[PETSc.Vec, PETSc.Vec]:
        """Return derivatives (n,) of load and prescribed displacements for a constant's rate."""
        residual = self.residual
        assert residual is not None  # only residuals have constants
        change, load = (
            _differentiate_form_by_constant(residual.bodies[0].form, constant, rate),
            self._zero_vector(),
        )
        if not change.empty():
            load.axpy(-1.0, assemble_vector(change))
        value = constant.value.copy()
        # central differences are exact, since the conditions are linear in their constants
        constant.value = value + rate
        offset = residual.prescribed_displacements()
        constant.value = value - rate
        offset.axpy(-1.0, residual.prescribed_displacements())
        offset.scale(0.5)
        constant.value = value
        return load, offset

    def _differentiate_output_by_state(self, output: SensitivityOutput) -> StateDerivativeOrWeights:
        """Return the derivative of an output with respect to the state, as weights.

        A functional is linearised at the current values of the unknown function.
        """
        weights = self._zero_state_derivative()
        if isinstance(output, ufl.Form):
            assert self.residual is not None
            u = self.residual.bodies[0].u
            weight = ufl.TestFunction(u.function_space)
            form = expand_derivatives(ufl.derivative(output, u, weight))
            return weights if form.empty() else replace(weights, unknowns=assemble_vector(form))
        if isinstance(output, PETSc.Vec):
            return replace(weights, unknowns=output)
        quantity, pair, axis = output
        if quantity == "translation":
            weights.translations[pair, axis] = 1.0
        else:
            weights.force[self.interface.pair == pair, axis] = 1.0
        return weights

    def _explicit_output_derivatives_by_parameters(
        self, output: SensitivityOutput, part: IncrementOrSubstep
    ) -> Array:
        """Return derivatives (parameters,) of an output at a fixed state.

        The derivatives are zero for all parameters except constants that the output contains.
        """
        derivatives = np.zeros(len(self.parameters))
        if isinstance(output, ufl.Form):
            for i, (parameter, rates) in enumerate(self.parameters):
                if isinstance(
                    constant := constant_vector_or_kind_of_parameter(parameter), fem.Constant
                ):
                    change = _differentiate_form_by_constant(
                        output, constant, rates[part.increment + 1]
                    )
                    derivatives[i] = 0.0 if change.empty() else assemble_scalar(change)
        return derivatives


def constant_vector_or_kind_of_parameter(parameter: SensitivityParameter) -> Any:  # noqa: ANN401
    """Return the constant or vector of a parameter, or its kind, "friction" or "motion"."""
    return parameter[0] if isinstance(parameter, tuple) else parameter


def _differentiate_form_by_constant(
    form: ufl.Form, constant: fem.Constant, rate: Array
) -> ufl.Form:
    """Return the derivative of a form in the direction of a constant's rate.

    The derivative is an empty form if the form does not contain the constant.
    """
    (domain,) = form.ufl_domains()
    step = ufl.variable(fem.Constant(domain, 0.0))
    shifted = ufl.replace(form, {constant: constant + step * fem.Constant(domain, rate)})
    return expand_derivatives(ufl.diff(shifted, step))
