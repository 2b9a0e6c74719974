"""What a caller states of a contact computation, checked on all processes at once."""

from collections.abc import Callable, Collection, Iterable, Sequence
from pathlib import Path
from typing import Any, TypeAlias

from petsc4py import PETSc

import numpy as np
from dolfinx import fem

from pw_elements import arguments
from pw_elements.choice import chosen
from pw_elements.collective import agree, collective
from pw_elements.contact.mortar import check_weights
from pw_elements.contact.pairs import ContactPair, DeformableSurface, MatchingNodes, Motion
from pw_elements.contact.remedies import REMEDIES, Remedy
from pw_elements.contact.state import ContactState
from pw_elements.given import Problem, check_load, is_finite
from pw_elements.hybrid import is_hybrid
from pw_elements.iterative import Iterative, Solver
from pw_elements.linear_solver import LinearSolver
from pw_elements.reduction import Reduction
from pw_elements.values import whole

PathInTime: TypeAlias = Callable[[float], Sequence[float]]

_STIFFNESS = "the stiffness"
# Largest difference of the positions of nodes that are the same, over the largest coordinate
_SAME = 1e-9


def checked_problem(
    K: PETSc.Mat,
    reduction: Reduction,
    pairs: ContactPair | Sequence[ContactPair],
    space: fem.FunctionSpace,
    max_iterations: int,
    solver: Solver,
) -> list[ContactPair]:
    """The pairs of a problem, one or several.

    Raises:
        TypeError: for arguments of the wrong type.
        ValueError: for what does not make one problem (see `given.Problem` and, of two bodies,
            `mortar.check_weights`), no iterations, or what differs between processes.
    """
    arguments.space(space)
    comm = space.mesh.comm
    with collective(comm):
        whole("max_iterations", max_iterations, 1)
        stated = _each(pairs, ContactPair, "a contact pair")
    Problem({_STIFFNESS: K}, reductions=(reduction,), space=space, solver=solver)
    agree(comm, {"max_iterations": max_iterations, "the number of contact pairs": len(stated)})
    for k, pair in enumerate(stated):
        surface = pair.surface
        shape: object = surface
        offset = None
        if isinstance(surface, MatchingNodes):  # whose nodes have local numbers
            shape, offset = surface.shape, surface.offset
        if isinstance(surface, DeformableSurface):  # whose facets have
            check_weights(K, space)
            shape = surface.revolved, surface.coincident
        agree(
            comm,
            {
                f"the surface of contact pair {k}": shape,
                f"the offset of contact pair {k}": offset,
                f"the friction of contact pair {k}": pair.friction,
                f"the motions of contact pair {k}": pair.motions,
            },
        )
    return stated


def solver_for(solver: Solver, reduction: Reduction) -> LinearSolver:
    """The solver that is meant.

    Raises:
        ValueError: if an iterative solver does not serve the reduction.
    """
    why = ""
    if reduction.space is not None and is_hybrid(reduction.space):
        why = "contact of hybrid bodies needs factors"
    taken = chosen(solver, reduction.supports, why)
    if why and isinstance(taken, Iterative):
        raise ValueError(f"Iterative() knows contact of displacements alone, {why}: use Direct()")
    return taken


def checked_paths(
    paths: PathInTime | Sequence[PathInTime | None],
    pairs: Sequence[ContactPair],
    space: fem.FunctionSpace,
) -> list[PathInTime | None]:
    """The path of each pair's surface in explicit dynamics; one of a single pair needs no list.

    Raises:
        TypeError: for anything but functions of time.
        ValueError: for another number than that of the pairs, or pairs of two bodies.
    """
    with collective(space.mesh.comm):
        if any(isinstance(pair.surface, (MatchingNodes, DeformableSurface)) for pair in pairs):
            raise ValueError("impact is one against rigid surfaces, not of two bodies")
        if is_hybrid(space):
            raise ValueError(
                "a pressure has no mass: impact is one of displacements alone, as of "
                "Spaces.petrov_galerkin(mesh)"
            )
        each: list[PathInTime | None] = [paths] if callable(paths) else list(paths)
        each = each or [None] * len(pairs)
        if len(each) != len(pairs):
            raise ValueError(f"{len(each)} paths for {len(pairs)} contact pairs")
        for k, path in enumerate(each):
            if not (path is None or callable(path)):
                raise TypeError(
                    f"the path of contact pair {k} is {arguments.described(path)}: it has to be a "
                    "function of time"
                )
    return each


def checked_remedies(remedies: Collection[Remedy], space: fem.FunctionSpace) -> tuple[Remedy, ...]:
    """The remedies of a problem.

    Raises:
        ValueError: for one that there is not, or what differs between processes.
    """
    with collective(space.mesh.comm):
        each = tuple(remedies) if isinstance(remedies, Collection) else (remedies,)
        if isinstance(remedies, str) or any(one not in REMEDIES for one in each):
            raise ValueError(
                f"remedies {remedies!r}: give some of {', '.join(map(repr, REMEDIES))}"
            )
    agree(space.mesh.comm, {"the remedies": each})
    return each


def checked_step(
    K: PETSc.Mat,
    space: fem.FunctionSpace,
    own: ContactState,
    state: ContactState,
    load: PETSc.Vec,
    motions: Motion | Sequence[Motion | None] | None,
    guess: ContactState | None,
) -> list[Motion | None]:
    """The motion of each pair in one increment; one of a single pair needs no list.

    Args:
        K: stiffness of the problem.
        space: of the problem.
        own: a state of the problem.
        state: from which it goes on, as the others.
        load: at the end of the increment.
        motions: none, or one of each pair.
        guess: to start from.

    Raises:
        TypeError: for arguments of the wrong type.
        ValueError: for a load that is not finite or not of the problem, another number or
            dimension of motions, states of other pairs or that are not finite, or what differs
            between processes.
    """
    comm, pairs = space.mesh.comm, len(own.pairs)
    with collective(comm):
        _each([state], ContactState, "the state")
        check_belongs(state, own, "the state")
        if not state.converged:
            raise ValueError("the state at the start is no solution: it can be a guess only")
        if guess is not None:
            _check_guess(guess, pairs)
        moved = list(motions) if isinstance(motions, Iterable) else [motions]
        if motions is None or not moved:
            moved = [None] * pairs
        if len(moved) != pairs:
            raise ValueError(f"{len(moved)} motions for {pairs} contact pairs")
        for k, motion in enumerate(moved):
            if motion is not None:
                _check_motions([motion], space, k)
        check_load("the load", load, _STIFFNESS, K)
    start = None if guess is None else [pair.status for pair in guess.pairs]
    agree(comm, {"the state": state.pairs, "the motions": moved, "the state to start from": start})
    if not is_finite(load):
        raise ValueError("the load is not finite")
    return moved


def checked_increments(
    K: PETSc.Mat,
    loads: PETSc.Vec | Sequence[PETSc.Vec],
    pairs: Sequence[ContactPair],
    start: ContactState | Sequence[ContactState],
    space: fem.FunctionSpace,
) -> list[tuple[PETSc.Vec, list[Motion | None], ContactState | None]]:
    """Load, motion of each pair, and state to start from, of each increment.

    Raises:
        TypeError, ValueError: as `checked_step`, for all increments.
    """
    comm = space.mesh.comm
    motions: list[list[Motion | None]] = []
    with collective(comm):
        given = _each([loads] if isinstance(loads, PETSc.Vec) else loads, PETSc.Vec, "a load")
        if not given:
            raise ValueError("there is no load increment")
        for k, load in enumerate(given):
            check_load(f"the load of increment {k}", load, _STIFFNESS, K)
        for k, pair in enumerate(pairs):
            moved = _each(pair.motions, Motion, "a motion")
            if moved and len(moved) != len(given):
                raise ValueError(
                    f"contact pair {k} has {len(moved)} motions for {len(given)} increments"
                )
            _check_motions(moved, space, k)
            motions.append(moved or [None] * len(given))
        guesses = _each(start, ContactState, "a state to start from")
        if guesses and len(guesses) != len(given):
            raise ValueError(f"{len(guesses)} states to start from for {len(given)} increments")
        for state in guesses:
            _check_guess(state, len(pairs))
    agree(comm, {"the number of loads": len(given), "the number of states": len(guesses)})
    for k, load in enumerate(given):
        if not is_finite(load):
            raise ValueError(f"the load of increment {k} is not finite")
    steps = map(list, zip(*motions, strict=True))
    return list(zip(given, steps, guesses or [None] * len(given), strict=True))


def check_state(state: ContactState, own: ContactState, space: fem.FunctionSpace) -> None:
    """Raises unless a state is one of a problem's contact nodes."""
    with collective(space.mesh.comm):
        _each([state], ContactState, "the state")
        check_belongs(state, own, "the state")


def checked_path(path: str | Path, space: fem.FunctionSpace) -> Path:
    """A file's path.

    Raises:
        TypeError: for what is none.
    """
    with collective(space.mesh.comm):
        arguments.of_type("the path", path, (str, Path), "give a file's name or pathlib.Path")
    return Path(path)


def check_belongs(state: ContactState, own: ContactState, what: str) -> None:
    """Raises ValueError for a state of other contact nodes than a problem's own, or with NaN."""
    alike = len(state.pairs) == len(own.pairs) and all(
        pair.position.shape == mine.position.shape
        and np.abs(pair.position - mine.position).max() <= _SAME * np.abs(mine.position).max()
        for pair, mine in zip(state.pairs, own.pairs, strict=True)
    )
    if not alike:
        raise ValueError(f"{what} belongs to other contact nodes than this problem's")
    _check_finite(state, what)


def _each(given: Any, kind: type, what: str) -> list:  # noqa: ANN401
    """Things of a kind, one or several."""
    things = list(given) if isinstance(given, Iterable) else [given]
    for thing in things:
        arguments.of_type(what, thing, kind, f"it has to be a {kind.__name__}")
    return things


def _check_finite(state: ContactState, what: str) -> None:
    for pair in state.pairs:
        known = (pair.force_normal, pair.force_tangential, pair.displacement, pair.translation)
        if not all(np.isfinite(values).all() for values in known):
            raise ValueError(f"{what} has forces or displacements that are not finite")


def _check_guess(state: ContactState, pairs: int) -> None:
    _each([state], ContactState, "a state to start from")
    if len(state.pairs) != pairs:
        raise ValueError("the state to start from has another number of contact pairs")
    _check_finite(state, "the state to start from")


def _check_motions(motions: Sequence[Motion], space: fem.FunctionSpace, pair: int) -> None:
    dim = space.mesh.geometry.dim
    for motion in _each(motions, Motion, f"a motion of contact pair {pair}"):
        if len(motion.translation) != dim:
            raise ValueError(f"the motion of contact pair {pair} is not {dim}-D")
