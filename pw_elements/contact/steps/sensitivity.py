"""Derivatives of what a history results in by what it has been computed from.

With the tangent A of the law's active set at the end of increment k, A_k dx_k = b_k dp - P_k dx_k-1
forwards, and A_k^T l_k = w_k - P_k+1^T l_k+1 backwards: see the guide's page on theory
("Derivatives"; P. Michaleris, D. A. Tortorelli, C. A. Vidal, 1994, doi:10.1002/nme.1620371408).
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

from pw_elements.algebra import Reduction, is_finite
from pw_elements.arrays import Array
from pw_elements.checks import arguments, format_points
from pw_elements.contact.interface import Interface
from pw_elements.contact.iteration import Increment, NewtonState
from pw_elements.contact.model import ContactPair, ContactState, Coulomb
from pw_elements.contact.nodes import (
    LinearisedLaw,
    assemble_node_equations,
    eliminate_known_motions,
)
from pw_elements.contact.system import AssembledTangent
from pw_elements.spaces import assemble_scalar, assemble_vector

Output: TypeAlias = ufl.Form | PETSc.Vec | tuple[Literal["force", "translation"], int, int]
Parameter: TypeAlias = (
    fem.Constant
    | tuple[Literal["friction"], int]
    | tuple[Literal["motion"], int, Any]
    | tuple[fem.Constant | PETSc.Vec, Any]
)

# Force, over the largest one of a node, by which a status may be another
_MARGIN = 1e-6
# Violation of the law over its tolerance beyond which a state is not the end of its increment
_NO_END = 10.0


@dataclass(frozen=True)
class Part:
    """An increment, or a part of one."""

    number: int  # of the increment, from 0
    start: ContactState  # of the increment
    before: ContactState  # where the part starts
    state: ContactState  # at its end
    share: float  # of the increment, there
    load: Any  # of the increment, as its step has had it


def parts_of(states: Sequence[ContactState], loads: Sequence[Any]) -> Iterator[Part]:
    """All parts of a history under loads, one per increment."""
    for k, ((start, end), load) in enumerate(zip(pairwise(states), loads, strict=True)):
        if k and end.substates and start.free_motions != end.free_motions:
            raise ValueError(
                f"state {k + 1} was found in parts, on which a surface became free or held: no "
                "rates are given of what moved it there. Make smaller increments"
            )
        before = start
        for share, state in (*end.substates, (1.0, end)):
            yield Part(k, start, before, state, share, load)
            before = state


@dataclass(frozen=True)
class Change:
    """How a state changes, per unit of a parameter; or weights of all that."""

    unknowns: PETSc.Vec  # (n,)
    translations: Array  # (pairs, dim), the same on all processes
    force: Array  # at the points of this process, (m, dim)

    def plus(self, factor: float, other: "Change") -> "Change":
        unknowns = self.unknowns.copy()
        unknowns.axpy(factor, other.unknowns)
        return Change(
            unknowns,
            self.translations + factor * other.translations,
            self.force + factor * other.force,
        )

    def weighing(self, change: "Change") -> float:
        """The sum of a change, with these weights."""
        comm = self.unknowns.comm.tompi4py()
        forces = comm.allreduce(float(np.sum(self.force * change.force)), MPI.SUM)
        moved = float(np.sum(self.translations * change.translations))
        return float(self.unknowns.dot(change.unknowns)) + forces + moved


@dataclass(frozen=True)
class Given:
    """How what is given at the end of an increment changes, per unit of a parameter."""

    load: PETSc.Vec  # (n,)
    offset: PETSc.Vec  # (n,), of prescribed displacements
    motions: Array  # (pairs, dim), of translations, and of forces where they are free
    friction: Array  # (pairs,), of coefficients


class Linearised:
    """Equations of an increment, or of a part of one, linearised at its end.

    Args:
        increment: in which equilibrium is at the end.
        end: the solution.
        K: tangent (n, n), free.
        reduction: by the supports.
        by_start: (m, dim - 1, dim), derivatives of slips by the points' motions at the start.

    Raises:
        ValueError: if it is no solution, or a status is about to change.
    """

    def __init__(
        self,
        increment: Increment,
        end: NewtonState,
        K: PETSc.Mat,
        reduction: Reduction,
        by_start: Array,
    ) -> None:
        if end.violation > _NO_END:
            raise ValueError(
                "is not the end of a step from the one before under this load: give `states` and "
                "`loads` as they were"
            )
        self._system, self._K, self._reduction = increment.system, K, reduction
        self._check_margin(end)
        active, kinematics = end.nodes.active_set, end.kinematics
        self._law = kinematics.linearise_law(active, self._system.law_scale)
        self._torque_map = kinematics.torque_map
        to_nodes = np.swapaxes(kinematics.frame, 1, 2)
        of_slip = assemble_node_equations(active, self._system.law_scale)[1][:, :, 1:]
        self._by_start = to_nodes @ of_slip @ by_start
        friction = end.nodes.force[:, :1] * active.direction
        self._by_friction = np.einsum("nat,nt->na", to_nodes[:, :, 1:], friction)

    def _check_margin(self, end: NewtonState) -> None:
        interface, nodes = self._system.interface, end.nodes
        closed = nodes.trial_pressure > 0
        on_supports = closed & (nodes.held_tangents & (nodes.force[:, 1:] != 0)).any(axis=1)
        on_supports |= closed & (nodes.is_dragged | nodes.is_coupled)
        places = interface.gathered(interface.position[on_supports])
        if len(places):
            raise ValueError(
                f"has contact nodes, first at {format_points(places)}, with friction along a "
                "direction in which supports hold them: no derivatives are given of it. Let the "
                "pair end before these nodes, or take friction away there"
            )
        free = nodes.frame[:, 1:].any(axis=2) & ~nodes.held_tangents
        slides = closed & nodes.cone.has_friction & free.any(axis=1)
        apart = np.abs(np.linalg.norm(nodes.trial_friction, axis=1) - nodes.friction_limits[0])
        margin = np.minimum(np.abs(nodes.trial_pressure), np.where(slides, apart, np.inf))
        largest = np.linalg.norm(nodes.force, axis=1).max(initial=0.0)
        largest = self._system.comm.allreduce(largest, MPI.MAX)
        near = margin < _MARGIN * largest + end.round_off
        places, least = interface.gathered(interface.position[near]), interface.gathered(margin)
        if len(places):
            raise ValueError(
                f"has contact nodes, first at {format_points(places)}, about to change their "
                f"status: a force of {least.min():.1e} is left, beside the largest one of "
                f"{largest:.1e}, and derivatives differ on either side. Take states a little "
                "before or after"
            )

    def change(self, given: Given, before: Change) -> Change:
        """How the end changes with what is given there, and with the start."""
        system = self._system
        load, law, totals, moved, offset = self._right(given)
        start = (
            system.point_displacements(before.unknowns) - before.translations[system.interface.pair]
        )
        law = replace(law, c=law.c - np.einsum("nab,nb->na", self._by_start, start))
        found = system.solve(load, law, totals, torque_map=self._torque_map)
        for at, value in zip(system.free_motions, found.free_motions, strict=True):
            moved[at] = value
        unknowns, unbalanced = offset.duplicate(), load.duplicate()
        self._reduction.right.multAdd(found.reduced_unknowns, offset, unknowns)
        system.stiffness.mult(found.reduced_unknowns, unbalanced)
        unbalanced.axpy(-1.0, load)
        return Change(unknowns, moved, system.split_residual(unbalanced)[0])

    def gradient(self, weights: Change, each: Sequence[Given]) -> tuple[Array, Change]:
        """Derivatives (parameters,) of the weighted end by what is given; weights of the start."""
        system, motion = self._system, self._system.interface.motion
        force, right = (
            system.make_equation_weights(weights.force),
            self._reduction.right.createVecRight(),
        )
        self._reduction.right.multTranspose(weights.unknowns, right)
        system.stiffness.multTransposeAdd(force, right, right)
        free = np.array([weights.translations[at] for at in system.free_motions])
        assert isinstance(system.tangent, AssembledTangent)
        found = system.tangent.solve_transposed(right.array_r, free, self._law)
        slopes = np.zeros(len(each))
        for k, given in enumerate(each):
            load, law, totals, moved, offset = self._right(given)
            known = np.append(
                *system.assemble_right_hand_sides(load, law, totals, self._torque_map)
            )[: len(found)]
            slopes[k] = found @ known - force.array_r @ load.array_r
            slopes[k] += weights.unknowns.array_r @ offset.array_r
            slopes[k] += np.sum(weights.translations * moved) * (system.comm.rank == 0)
        start = -np.einsum("nab,na->nb", self._by_start, system.extract_at_points(found))
        points, unknowns = motion.createVecLeft(), motion.createVecRight()
        points.setArray(start)
        motion.multTranspose(points, unknowns)
        translations = np.zeros_like(weights.translations)
        np.add.at(translations, system.interface.pair, -start)
        for sums in (slopes, translations):
            system.comm.Allreduce(MPI.IN_PLACE, sums, MPI.SUM)
        return slopes, Change(unknowns, translations, np.zeros_like(start))

    def _right(self, given: Given) -> tuple[PETSc.Vec, LinearisedLaw, Array, Array, PETSc.Vec]:
        """Reduced load, law, totals, prescribed translations and displacements."""
        system, moved = self._system, given.motions.copy()
        totals = np.array([moved[at] for at in system.free_motions])
        for at in system.free_motions:
            moved[at] = 0.0
        reduction = replace(self._reduction, offset=given.offset).for_load(self._K, given.load)
        pair = system.interface.pair
        law = replace(self._law, c=given.friction[pair, None] * self._by_friction)
        still = law.D.shape[2] - moved.shape[1]  # surfaces that may turn do not
        known = np.pad(moved[pair], [(0, 0), (0, still)])
        law = eliminate_known_motions(law, known, system.point_motions(reduction.offset))
        return reduction.load(self._K, given.load), law, totals, moved, reduction.offset


class Residual(Protocol):
    """What increments of a residual have besides those of a stiffness."""

    form: ufl.Form
    u: fem.Function

    def depends_on(self, constant: fem.Constant) -> bool:
        """Whether the residual or one of its Dirichlet conditions depends on a constant."""

    def evaluate_prescribed_values(self) -> PETSc.Vec:
        """Prescribed displacements (n,), as conditions have them now."""


@dataclass(frozen=True)
class Derivatives:
    """Derivatives of outputs by parameters, both of them checked."""

    interface: Interface
    at_end: Callable[[Part], Linearised]  # of a part, where it leaves u, constants, conditions
    residual: Residual | None
    parts: Sequence[Part]
    outputs: Sequence[Output]
    parameters: Sequence[tuple[Parameter, Array]]  # with their rates (states, ...)

    def direct(self) -> Array:
        """All derivatives, (increments, outputs, parameters)."""
        shape = self.parts[-1].number + 1, len(self.outputs), len(self.parameters)
        found, changes = np.zeros(shape), [self._none()] * len(self.parameters)
        for part in self.parts:
            here, each = self._linearised(part), self._given(part)
            changes = [here.change(one, before) for one, before in zip(each, changes, strict=True)]
            for i, output in enumerate(self.outputs if part.share == 1 else ()):
                weights = self._weights(output)
                found[part.number, i] = [weights.weighing(change) for change in changes]
                found[part.number, i] += self._explicit(output, part)
        return found

    def adjoint(self, weights: Array) -> Array:
        """Gradient (parameters,) of the sum of all outputs by weights (increments, outputs)."""
        found, carried = np.zeros(len(self.parameters)), self._none()
        for part in reversed(self.parts):
            here, each = self._linearised(part), self._given(part)
            for i, output in enumerate(self.outputs if part.share == 1 else ()):
                weight = weights[part.number, i]
                carried = carried.plus(weight, self._weights(output))
                found += weight * self._explicit(output, part)
            gradient, carried = here.gradient(carried, each)
            found += gradient
        return found

    def _linearised(self, part: Part) -> Linearised:
        try:
            return self.at_end(part)
        except ValueError as error:
            where = "" if part.share == 1 else f", at {part.share:.4g} of its increment,"
            raise ValueError(f"state {part.number + 1}{where} {error}") from error

    def _nothing(self) -> PETSc.Vec:
        nothing = self.parts[0].start.unknowns.duplicate()
        nothing.set(0.0)
        return nothing

    def _none(self) -> Change:
        start, position = self.parts[0].start, self.interface.position
        return Change(self._nothing(), np.zeros_like(start.translations), np.zeros_like(position))

    def _given(self, part: Part) -> list[Given]:
        """Rates of each parameter at the end of a part."""
        each, k, share = [], part.number, part.share
        for parameter, rates in self.parameters:
            rate = (1 - share) * rates[k] + share * rates[k + 1]
            load, offset = self._nothing(), self._nothing()
            motions = np.zeros_like(part.state.translations)
            friction = np.zeros(len(motions))
            match _thing(parameter):
                case fem.Constant() as constant:
                    load, offset = self._by(constant, rate)
                case PETSc.Vec() as vector:
                    load.axpy(float(rate), vector)
                case "friction":
                    friction[parameter[1]] = rate
                case _:
                    motions[parameter[1]] = rate
            each.append(Given(load, offset, motions, friction))
        return each

    def _by(self, constant: fem.Constant, rate: Array) -> tuple[PETSc.Vec, PETSc.Vec]:
        """Changes of the load, and of prescribed displacements, along the rate of a constant."""
        residual = self.residual
        assert residual is not None  # others have no constants
        change, load = _by_constant(residual.form, constant, rate), self._nothing()
        if not change.empty():
            load.axpy(-1.0, assemble_vector(change))
        value = constant.value.copy()
        # differences are exact: conditions hold a constant as it is
        constant.value = value + rate
        offset = residual.evaluate_prescribed_values()
        constant.value = value - rate
        offset.axpy(-1.0, residual.evaluate_prescribed_values())
        offset.scale(0.5)
        constant.value = value
        return load, offset

    def _weights(self, output: Output) -> Change:
        """What makes an output of changes, where u is now."""
        weights = self._none()
        if isinstance(output, ufl.Form):
            assert self.residual is not None
            u = self.residual.u
            weight = ufl.TestFunction(u.function_space)
            form = expand_derivatives(ufl.derivative(output, u, weight))
            return weights if form.empty() else replace(weights, unknowns=assemble_vector(form))
        if isinstance(output, PETSc.Vec):
            return replace(weights, unknowns=output)
        what, pair, axis = output
        if what == "translation":
            weights.translations[pair, axis] = 1.0
        else:
            weights.force[self.interface.pair == pair, axis] = 1.0
        return weights

    def _explicit(self, output: Output, part: Part) -> Array:
        """Derivatives (parameters,) of an output's own constants."""
        found = np.zeros(len(self.parameters))
        if isinstance(output, ufl.Form):
            for i, (parameter, rates) in enumerate(self.parameters):
                if isinstance(thing := _thing(parameter), fem.Constant):
                    change = _by_constant(output, thing, rates[part.number + 1])
                    found[i] = 0.0 if change.empty() else assemble_scalar(change)
        return found


_NO_RESIDUAL = (
    "a stiffness K tells neither its constants nor its u: give vectors of weights and of loads, or "
    "state the problem by its residual"
)


def checked_outputs(
    given: Sequence[Any], pairs: int, space: fem.FunctionSpace, forms: bool
) -> list[Output]:
    """Outputs; functionals where `forms` are known."""
    for output in given:
        match output:
            case ("force" | "translation", pair, axis):
                _number(pair, pairs, "contact pairs")
                _number(axis, space.mesh.geometry.dim, "components")
            case ufl.Form() if forms:
                pass
            case ufl.Form():
                raise ValueError(_NO_RESIDUAL)
            case PETSc.Vec():
                _check_vector("the output, a vector of weights,", output, space)
            case _:
                raise ValueError(
                    f"the output {output!r}: give a functional, a vector of weights, "
                    '("force", pair, axis) or ("translation", pair, axis), in a list'
                )
    return list(given)


def checked_parameters(
    given: Sequence[Any],
    states: int,
    pairs: Sequence[ContactPair],
    space: fem.FunctionSpace,
    forms: bool,
) -> list[tuple[Parameter, Array]]:
    """Parameters with their rates (states, ...); constants where `forms` are known."""
    found: list[tuple[Parameter, Array]] = []
    for parameter in given:
        rates: Any = np.ones(states)
        shape: tuple[int, ...] = (states,)
        if isinstance(_thing(parameter), fem.Constant) and not forms:
            raise ValueError(_NO_RESIDUAL)
        match parameter:
            case fem.Constant():
                if parameter.value.shape:
                    raise ValueError("a constant with components needs rates: (constant, rates)")
            case (fem.Constant() as constant, rates):
                shape += constant.value.shape
            case (PETSc.Vec() as load, rates):
                _check_vector("the load that is a parameter", load, space)
            case ("friction", pair):
                law = pairs[_number(pair, len(pairs), "contact pairs")].law
                if not (isinstance(law, Coulomb) and type(law).limit is Coulomb.limit):
                    raise ValueError(f"the law of friction of contact pair {pair} is not Coulomb's")
            case ("motion", pair, rates):
                _number(pair, len(pairs), "contact pairs")
                shape += (space.mesh.geometry.dim,)
            case _:
                raise ValueError(
                    f'the parameter {parameter!r}: give a constant, ("friction", pair), ("motion", '
                    "pair, rates), (constant, rates) or (vector, rates), in a list"
                )
        found.append((parameter, arguments.check_real_array("rates", rates, shape)))
    return found


def check_constants(
    parameters: Sequence[tuple[Parameter, Array]], outputs: Sequence[Output], residual: Residual
) -> None:
    """Raise ValueError for a constant on which neither the states nor the outputs depend."""
    in_outputs = [
        c for output in outputs if isinstance(output, ufl.Form) for c in output.constants()
    ]
    for parameter, _ in parameters:
        constant = _thing(parameter)
        if not isinstance(constant, fem.Constant) or residual.depends_on(constant):
            continue
        if not any(constant is other for other in in_outputs):
            raise ValueError(
                f"the constant of value {constant.value.tolist()} is no parameter: neither the "
                "residual, nor a Dirichlet condition, nor a functional among the outputs contain "
                "it. Give the fem.Constant that the forms were made with"
            )


def check_loads(loads: Sequence[Any], steps: int, of_residual: bool) -> None:
    """Raise unless loads are none, or of a residual: a function or None for each step."""
    remedy = "give a list of functions of the share (0, 1], or nothing"
    arguments.check_type("loads", loads, (list, tuple), remedy)
    if not of_residual and len(loads):
        raise ValueError(
            "`loads` are those of a residual; a problem with a stiffness K needs none, its states "
            "follow from their contact forces: leave `loads` out"
        )
    if len(loads) not in (0, steps):
        raise ValueError(f"{len(loads)} loads for {steps} steps: give the load of each, or none")
    for k, load in enumerate(loads):
        if not (load is None or arguments.is_user_function(load)):
            raise TypeError(
                f"the load of step {k} is {arguments.describe(load)}: give the function of the "
                "share (0, 1] of the increment that `step` had, or None"
            )


def _check_vector(name: str, vector: PETSc.Vec, space: fem.FunctionSpace) -> None:
    arguments.check_petsc_vector(name, vector, "the space", space)
    if not is_finite(vector):
        raise ValueError(f"{name} is not finite")


def _number(given: Any, count: int, what: str) -> int:  # noqa: ANN401
    if arguments.check_integer("a number", given, 0) >= count:
        raise ValueError(f"number {given} of {count} {what}: they count from 0")
    return int(given)


def _thing(parameter: Parameter) -> Any:  # noqa: ANN401
    return parameter[0] if isinstance(parameter, tuple) else parameter


def _by_constant(form: ufl.Form, constant: fem.Constant, rate: Array) -> ufl.Form:
    """The derivative of a form along the rate of a constant in it; empty without it."""
    (domain,) = form.ufl_domains()
    way = ufl.variable(fem.Constant(domain, 0.0))
    moved = ufl.replace(form, {constant: constant + way * fem.Constant(domain, rate)})
    return expand_derivatives(ufl.diff(moved, way))
