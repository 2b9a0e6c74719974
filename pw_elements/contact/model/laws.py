"""Interface laws: forces at contact nodes as functions of gap, slip, force and history.

A law gives the force r of a node, with its derivatives, as a function R of the gap g, the slip v,
the force r itself, and of history variables. Its equation at each node is

    r = R(g, v, r).

Newton's method linearises it as (1 - dR/dr) r - dR/d(g, v) (g; v) = constant. A law whose R does
not depend on r gives the force explicitly, such as an elastic layer. Contact and ties are implicit
laws: with a positive factor c (force per length), unilateral contact without friction is

    r_n = max(0, r_n - c g),    r_t = 0,

and a tie is r = r - c (g, v), so that gap and slip vanish. No active set decides at nodes with a
law, and no force has to be compressive.

All components are in the frame of a node: the normal points from the surface into the body, and
compression is positive. A law must not depend on the direction of the tangents, which may differ
between increments and between numbers of processes; slips may only enter by their size, or as a
direction of the force. Forces are nodal forces. A pressure is a force divided by the weight of the
node, which is the integral of its weight function over the undeformed surface; at small sliding of
two bodies, over the part that faces the other body.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

from petsc4py import PETSc

import numpy as np

from pw_elements.arrays import Array, Mask
from pw_elements.checks import arguments

# Largest error of a derivative, relative to the largest derivative at the same node that has the
# same units; and steps of finite differences, relative to the size of the variable
_DERIVATIVE_TOLERANCE = 1e-6
_RELATIVE_DIFFERENCE_STEPS = (1e-4, 1e-5, 1e-6, 1e-7)

# End of the message if an increment with softening laws fails
SNAP_BACK_EXPLANATION = (
    "If smaller increments fail, too, the interface softens faster than the body unloads (a "
    "snap-back): prescribed displacements then determine no path of equilibria, and a state beyond "
    "it is not accepted. Refine the mesh along the interface, so that fewer of its nodes soften at "
    "once and each of them faces a stiffer body, or give the law a larger toughness or a smaller "
    "strength"
)


@dataclass(frozen=True)
class InterfaceValues:
    """Gap, slip, force and history of m nodes, from which a law computes forces.

    Args:
        gap: (m,), gaps; negative where a node is inside of the surface.
        slip: (m, dim - 1), slips since the undeformed state, in components along the tangents. On
            curved surfaces, and where the surface turns with the body, the slip of earlier
            increments is turned into the present tangent plane without changing its length.
        slip_increment: (m, dim - 1), the part of the slip in this increment. The derivatives by
            `slip` and by `slip_increment` are the same.
        force: (m, dim), normal and tangential components of the present nodal forces of the surface
            on the body. Implicit laws use them.
        history: (m, h), history variables at the start of the increment.
        weight: (m,), integrals of the nodes' weight functions over the undeformed surface of the
            pair. In plane problems they are lengths (per unit thickness), in axisymmetry areas of
            the whole circumference. Between two bodies at small sliding, the part that faces no
            body does not count. They are zero at nodes that belong to no facet of the pair.
        stiffness: (m,), factor c of implicit laws: a force per length, of the order of the body's
            stiffness at the node. Solutions do not depend on it.
        position: (m, dim), undeformed positions of the nodes.
        fields: (m, n_fields), values of the pair's `interface_fields`, in their order; None if it
            has none. If the pair faces a body, a second set of columns in the same order has the
            values of the other side: the node's own value less the jump across the interface,
            which is averaged like the gap. Values are read at the start of an increment and are
            constant in it.
    """

    gap: Array
    slip: Array
    slip_increment: Array
    force: Array
    history: Array
    weight: Array
    stiffness: Array
    position: Array
    fields: Array | None = None


@dataclass(frozen=True)
class InterfaceResponse:
    """Forces that a law gives at m nodes, with derivatives and new history.

    Args:
        force: (m, dim), forces R in the components of `InterfaceValues.force`.
        by_motion: (m, dim, dim), derivatives of the forces by the gap (first column) and by the
            slip (other columns).
        by_force: (m, dim, dim), derivatives of the forces by `InterfaceValues.force`; zero for
            explicit laws.
        history: (m, h), history variables at the end of the increment, if the increment ended here.
        by_fields: (m, dim, n_fields), derivatives of the forces by `InterfaceValues.fields`;
            required if the pair has `interface_fields`.
    """

    force: Array
    by_motion: Array
    by_force: Array
    history: Array
    by_fields: Array | None = None


@runtime_checkable
class InterfaceLaw(Protocol):
    """Law of the forces at contact nodes. Any object with these members is a law.

        class Adhesive:
            '''Elastic layer with the stiffness 50, a traction per length.'''

            n_history = 0

            def initial_history(self, gap, weight):
                return np.zeros((len(gap), 0))

            def evaluate(self, values):
                k = 50.0 * values.weight
                motion = np.column_stack([values.gap, values.slip])
                by_motion = -k[:, None, None] * np.eye(motion.shape[1])
                force = -k[:, None] * motion
                return InterfaceResponse(force, by_motion, 0 * by_motion, values.history)

        ContactPair(bottom, Plane((0, 0), (0, 1)), interface_law=Adhesive())

    Attributes:
        n_history: number h of history variables of each node, which are scalars.
    """

    n_history: int

    def initial_history(self, gap: Array, weight: Array) -> Array:
        """Return the history variables (m, h) of the undeformed state.

        Args:
            gap: (m,), gaps before any motion.
            weight: (m,), weights of the nodes.
        """

    def evaluate(self, values: InterfaceValues) -> InterfaceResponse:
        """Return forces, derivatives and new history at some nodes, which may be none.

        Args:
            values: gaps, slips, forces, history and weights of the nodes.
        """


@runtime_checkable
class SofteningLaw(InterfaceLaw, Protocol):
    """Interface law whose force falls with the opening or slip, down to zero.

    Its states are checked for jumps across a snap-back (see `SNAP_BACK_EXPLANATION`).
    """

    def softened_fraction(self, history: Array) -> Array:
        """Return the part (m,) of the softening branch that nodes have passed, from 0 to 1.

        Args:
            history: (m, h), history variables.
        """


class InterfaceFieldValues(Protocol):
    """Fields of a pair, of which its interface law is a function, at the m points of a process.

    Attributes:
        names: names of the fields.
    """

    names: list[str]

    def differentiate_values(self, field_index: int, motion: PETSc.Mat) -> list[PETSc.Mat]:
        """Return matrices (m, n_T) that turn a field's unknowns into values on both sides."""


class InterfaceLawEvaluation(Protocol):
    """Interface laws of all pairs at the m contact points of a process.

    Attributes:
        has_law: (m,), mask of the points with a law.
        n_history: number of columns of a pair's history.
        initial_history: (m, n_history), history of the undeformed state.
    """

    has_law: Mask
    n_history: int
    initial_history: Array

    @property
    def fields(self) -> Sequence[InterfaceFieldValues | None]:
        """Fields of each pair; None for pairs without fields."""

    def read_fields(self, motion: PETSc.Mat) -> None:
        """Read the present values of the fields of all pairs; collective.

        Args:
            motion: matrix (m dim, n) that turns unknowns into displacements of the points relative
                to the other side.
        """

    @property
    def may_soften(self) -> bool:
        """Whether any law has a softening branch."""

    def raise_if_softened_too_fast(self, start_history: Array, history: Array) -> None:
        """Raise SolutionNotFound if a node has softened too much in one step; collective."""

    def evaluate(
        self,
        frame: Array,
        gap: Array,
        slip: Array,
        force: Array,
        start_history: Array,
        stiffness: Array,
    ) -> tuple[Mask, InterfaceResponse]:
        """Return a mask (m,) of the points at which laws were evaluated, and the responses."""

    def check_derivatives_at_state(
        self,
        frame: Array,
        gap: Array,
        slip: Array,
        force: Array,
        start_history: Array,
        stiffness: Array,
    ) -> None:
        """Raise ValueError if a derivative contradicts differences at a state; collective."""

    def raise_kept_error(self) -> None:
        """Raise an error that a law has raised on any process, on all processes; collective."""

    def sample_responses(self, pair_index: int) -> Array:
        """Return forces of one pair's law at fixed values, by which files are recognised."""


def evaluate_and_check_shapes(law: InterfaceLaw, values: InterfaceValues) -> InterfaceResponse:
    """Return the response of a law, whose arrays are checked.

    Raises:
        TypeError: if the law does not return an `InterfaceResponse`.
        ValueError: if an array has the wrong shape or is not real, or if the pair has fields and
            the response has no derivatives by them.
    """
    response = law.evaluate(values)
    arguments.check_type(
        "the result of an interface law", response, InterfaceResponse, "return that type"
    )
    m, dim = values.force.shape
    shapes: dict[str, tuple[int, ...]] = {
        "force": (m, dim),
        "by_motion": (m, dim, dim),
        "by_force": (m, dim, dim),
        "history": (m, law.n_history),
    }
    if values.fields is not None:
        if response.by_fields is None:
            raise ValueError(
                "the pair has interface_fields, and its interface law returns no by_fields: return "
                "InterfaceResponse(..., by_fields=...), the derivatives (m, dim, n_fields) of the "
                "force by InterfaceValues.fields"
            )
        shapes["by_fields"] = (m, dim, values.fields.shape[1])
    return InterfaceResponse(
        **{
            name: arguments.check_user_function_values(
                f"{name} of an interface law", getattr(response, name), shape, "it gives this shape"
            )
            for name, shape in shapes.items()
        }
    )


def find_wrong_derivatives(
    law: InterfaceLaw, values: InterfaceValues
) -> tuple[Mask, list[tuple[str, Array, Array]]]:
    """Compare the derivatives that a law gives with differences of its forces.

    Central differences with several steps are taken, and one-sided differences with the smallest
    step. A derivative counts as right if any of them confirms it, so that either derivative is
    accepted at a corner.

    Args:
        law: the law.
        values: values of m nodes at which derivatives are compared.

    Returns:
        Mask (m,) of the nodes at which a derivative is wrong; and for each kind of derivative its
        name, the derivatives (m, dim, columns) of the law, and the closest differences.
    """
    response, wrong = evaluate_and_check_shapes(law, values), np.zeros(len(values.gap), dtype=bool)
    compared = []
    motion = np.column_stack([values.gap, values.slip_increment])
    # sizes of the variables as lengths; motions or forces alone may be round-off
    size = np.maximum(
        np.abs(motion).max(axis=1, initial=0.0),
        np.abs(values.force).max(axis=1, initial=0.0) / values.stiffness,
    )
    size = np.where(size > 0, size, size.max(initial=0.0) or 1.0)
    dim = values.force.shape[1]
    kinds = [
        ("by_motion", np.tile(size[:, None], dim), response.by_motion),
        ("by_force", np.tile((size * values.stiffness)[:, None], dim), response.by_force),
    ]
    if values.fields is not None and response.by_fields is not None:
        field_size = np.abs(values.fields)
        largest = field_size.max(axis=0, initial=0.0)
        field_size = np.where(field_size > 0, field_size, np.where(largest > 0, largest, 1.0))
        kinds.append(("by_fields", field_size, response.by_fields))
    for kind, scales, given in kinds:
        closest = np.full_like(given, np.nan)
        for column, scale in enumerate(scales.T):
            for relative_step in _RELATIVE_DIFFERENCE_STEPS:
                step = relative_step * scale
                forward, backward = (
                    evaluate_and_check_shapes(
                        law, _shift_component(values, kind, column, sign * step)
                    ).force
                    for sign in (1.0, -1.0)
                )
                differences = [(forward - backward, 2 * step)]
                if relative_step == min(_RELATIVE_DIFFERENCE_STEPS):
                    differences.append((forward - response.force, step))
                    differences.append((response.force - backward, step))
                for difference, length in differences:
                    candidate = difference / length[:, None]
                    error = np.abs(candidate - given[:, :, column])
                    is_closer = ~(error >= np.abs(closest[:, :, column] - given[:, :, column]))
                    closest[:, :, column] = np.where(is_closer, candidate, closest[:, :, column])
        # fields differ in their units
        axes = 1 if kind == "by_fields" else (1, 2)
        largest = np.abs(given).max(axis=axes, initial=0.0, keepdims=True)
        # round-off of forces in differences with the largest step
        round_off = np.finfo(float).eps * np.abs(response.force).max(axis=1, initial=0.0)
        round_off = 4 * round_off[:, None] / (_RELATIVE_DIFFERENCE_STEPS[0] * scales)
        tolerance = _DERIVATIVE_TOLERANCE * largest + round_off[:, None, :]
        is_right = np.abs(closest - given) <= tolerance
        wrong |= ~is_right.all(axis=(1, 2))
        compared.append((kind, given, closest))
    return wrong, compared


def _shift_component(
    values: InterfaceValues, kind: str, column: int, shift: Array
) -> InterfaceValues:
    """Return values with one component of motion, force or fields shifted by `shift` (m,)."""
    if kind == "by_fields":
        assert values.fields is not None
        fields = values.fields.copy()
        fields[:, column] += shift
        return replace(values, fields=fields)
    if kind == "by_force":
        force = values.force.copy()
        force[:, column] += shift
        return replace(values, force=force)
    if column == 0:
        return replace(values, gap=values.gap + shift)
    slip, slip_increment = values.slip.copy(), values.slip_increment.copy()
    slip[:, column - 1] += shift
    slip_increment[:, column - 1] += shift
    return replace(values, slip=slip, slip_increment=slip_increment)
