"""Checks of what the user states, made once where a public method is called.

The module guarantees that increments are solved for arguments of the right types, sizes and
numbers alone: nothing of the iteration checks them again.
"""

import logging
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, TypeAlias

from petsc4py import PETSc

import numpy as np
from dolfinx import fem

from pw_elements.algebra import Reduction, check_problem
from pw_elements.checks import arguments, collective_errors
from pw_elements.contact.interface import check_piecewise_linear_weights
from pw_elements.contact.model import (
    ClosestPointSurface,
    ContactPair,
    ContactState,
    DeformableSurface,
    MatchingNodes,
    Motion,
)
from pw_elements.contact.output import Callback
from pw_elements.contact.steps.stepping import MAX_COST_RATIO, REMEDIES, Remedy
from pw_elements.progress import log_on_root
from pw_elements.solvers import Solver
from pw_elements.spaces import is_hybrid

# by name, or by name and how many times the first attempt's cost they may take
Remedies: TypeAlias = Collection[Remedy] | Mapping[Remedy, float]
PathInTime: TypeAlias = Callable[[float], Sequence[float]]

# Largest difference of the positions of nodes that are the same, over the largest coordinate
_SAME_PLACE = 1e-9


def check_contact_arguments(
    K: PETSc.Mat,
    reduction: Reduction,
    pairs: ContactPair | Sequence[ContactPair],
    space: fem.FunctionSpace,
    max_iterations: int,
    solver: Solver,
    callback: Callback | None = None,
) -> tuple[ContactPair, ...]:
    """Return the pairs of a problem; raise an error for arguments that do not fit together."""
    arguments.check_space(space)
    arguments.check_integer("max_iterations", max_iterations, 1)
    with collective_errors(space.mesh.comm):  # only some processes may have one
        check_function("callback", callback, "it has to be a function")
    stated = list_of_type(pairs, ContactPair, "a contact pair")
    check_problem({"the stiffness": K}, reductions=(reduction,), space=space, solver=solver)
    if any(isinstance(pair.surface, DeformableSurface) for pair in stated):
        check_piecewise_linear_weights(K, space)
    return tuple(stated)


def list_paths(
    paths: PathInTime | Sequence[PathInTime | None],
    pairs: Sequence[ContactPair],
    space: fem.FunctionSpace,
) -> list[PathInTime | None]:
    """Return the path of each pair's surface in explicit dynamics; a single one needs no list."""
    if any(isinstance(pair.surface, (MatchingNodes, DeformableSurface)) for pair in pairs):
        raise ValueError("impact is one against rigid surfaces, not of two bodies")
    if is_hybrid(space):
        raise ValueError(
            "a pressure has no mass: impact is one of displacements alone, as of "
            "Spaces.petrov_galerkin(mesh)"
        )
    each = list_per_pair("paths", paths, len(pairs))
    for k, path in enumerate(each):
        check_function(f"the path of contact pair {k}", path, "it has to be a function of time")
    return each


def list_remedy_cost_ratios(remedies: Remedies) -> dict[Remedy, float]:
    """Return the remedies of a problem, and the cost that each may have over the first attempt."""
    named = isinstance(remedies, Collection) and not isinstance(remedies, str)
    if not named or any(one not in REMEDIES for one in remedies):
        raise ValueError(f"remedies {remedies!r}: give some of {', '.join(map(repr, REMEDIES))}")
    some = remedies if isinstance(remedies, Mapping) else dict.fromkeys(remedies, MAX_COST_RATIO)
    return {
        k: arguments.check_positive(f"the multiple of {k}", some[k]) for k in REMEDIES if k in some
    }


def check_large_strain_surfaces(pairs: Sequence[ContactPair], space: fem.FunctionSpace) -> None:
    """Raise a ValueError that says what to use where deformed bodies cannot touch a surface."""
    for k, pair in enumerate(pairs):
        surface, wrong = pair.surface, ""
        if getattr(surface, "gradient", True) is None:
            words = f"contact pair {k}: differences stand in for a gradient function"
            log_on_root(space.mesh.comm, logging.WARNING, words, ".contact")
        if pair.interference:
            wrong = (
                "it has interference, which small displacements only can have: start with the "
                "surface outside of the body, and move it in"
            )
        elif isinstance(surface, DeformableSurface):
            if space.mesh.geometry.dim == 3 or surface.coincident:
                wrong = (
                    "two deformed bodies slide on each other in the plane and in axisymmetry only, "
                    "and from where they are: sides cannot count as coincident"
                )
        elif not isinstance(surface, ClosestPointSurface):
            wrong = (
                f"deformed bodies cannot touch a {type(surface).__name__}, which knows no closest "
                "points; use Sphere (a circle in the plane), Plane or SignedDistance, such as one "
                "of a punch with rounded edges"
            )
        if wrong:
            raise ValueError(f"contact pair {k}: {wrong}")


def check_state_of_problem(state: ContactState, own: ContactState, what: str) -> None:
    """Raise an error for a state of other contact nodes than a problem's own, or with NaN."""
    list_of_type([state], ContactState, what)
    alike = len(state.pairs) == len(own.pairs) and all(
        pair.position.shape == mine.position.shape
        and np.abs(pair.position - mine.position).max() <= _SAME_PLACE * np.abs(mine.position).max()
        for pair, mine in zip(state.pairs, own.pairs, strict=True)
    )
    if not alike:
        raise ValueError(f"{what} belongs to other contact nodes than this problem's")
    for pair in state.pairs:
        names = ("force_normal", "force_tangential", "displacement", "translation", "rotation")
        if not all(np.isfinite(getattr(pair, name)).all() for name in names):
            raise ValueError(f"{what} has forces or displacements that are not finite")


def list_of_type(given: Any, kind: type, what: str) -> list:  # noqa: ANN401
    """Return a list of one or several things; raise TypeError for one that is of another kind."""
    things = arguments.as_list(given)
    for thing in things:
        arguments.check_type(what, thing, kind, f"it has to be a {kind.__name__}")
    return things


def list_per_pair(what: str, given: Any, pairs: int) -> list:  # noqa: ANN401
    """Return a list with one thing for each pair, None if none are given."""
    each = arguments.as_list(given)
    if len(each or [None] * pairs) != pairs:
        raise ValueError(f"{len(each)} {what} for {pairs} contact pairs")
    return each or [None] * pairs


def check_function(name: str, given: object, remedy: str) -> None:
    if not (given is None or arguments.is_user_function(given)):
        raise TypeError(f"{name} is {arguments.describe(given)}: {remedy}")


def check_motions(motions: Sequence[Motion | None], pairs: Sequence[ContactPair], dim: int) -> None:
    for k, (motion, pair) in enumerate(zip(motions, pairs, strict=True)):
        if motion is None:
            continue
        list_of_type([motion], Motion, f"a motion of contact pair {k}")
        if len(motion.translation) != dim:
            raise ValueError(f"the motion of contact pair {k} is not {dim}-D")
        if pair.pivot is None and motion.rotation != 0:
            raise ValueError(f"contact pair {k} turns about nothing: give it a pivot")
