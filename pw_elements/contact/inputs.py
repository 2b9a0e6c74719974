"""What a caller states of a contact computation, checked on all processes at once."""

from collections.abc import Iterable, Sequence
from typing import Any

from petsc4py import PETSc

import numpy as np
from dolfinx import fem

from pw_elements.algebra import Reduction, is_finite
from pw_elements.collective import agree, collective
from pw_elements.contact.pairs import ContactPair, MatchingNodes, Motion
from pw_elements.contact.state import ContactState
from pw_elements.values import whole

# Largest difference of the positions of nodes that are the same, over the largest coordinate
_SAME = 1e-9


def each(given: Any, kind: type, what: str) -> list:  # noqa: ANN401
    """Things of a kind, one or several; local, for use under the guard.

    Raises:
        ValueError: for a thing of another kind.
    """
    things = list(given) if isinstance(given, Iterable) else [given]
    for thing in things:
        if not isinstance(thing, kind):
            raise ValueError(f"{what}: {type(thing).__name__} in place of {kind.__name__}")
    return things


def checked_problem(
    K: PETSc.Mat,
    reduction: Reduction,
    pairs: ContactPair | Sequence[ContactPair],
    space: fem.FunctionSpace,
    max_iterations: int,
) -> list[ContactPair]:
    """The pairs of a problem, one or several.

    Raises:
        ValueError: for arguments of another kind, a stiffness or reduction of another size, a
            stiffness that is not finite, no iterations, or what differs between processes.
    """
    comm = space.mesh.comm
    size = space.dofmap.index_map.size_global * space.dofmap.index_map_bs
    with collective(comm):
        whole("max_iterations", max_iterations, 1)
        stated = each(pairs, ContactPair, "contact pairs")
        each([K], PETSc.Mat, "the stiffness")
        if not isinstance(reduction, Reduction):
            raise ValueError(
                f"supports: {type(reduction).__name__} in place of a Reduction, such as "
                "Reduction.dirichlet(space, conditions)"
            )
        if K.getSize() != (size, size) or reduction.right.getSize()[0] != size:
            raise ValueError(
                f"the stiffness is {K.getSize()} and the reduction's R is "
                f"{reduction.right.getSize()}, but the space has {size} unknowns"
            )
    agree(comm, {"max_iterations": max_iterations, "the number of contact pairs": len(stated)})
    for k, pair in enumerate(stated):
        shape = pair.surface
        if isinstance(shape, MatchingNodes):  # nodes have local numbers
            agree(comm, {f"the offset of contact pair {k}": shape.offset})
            shape = shape.shape
        agree(
            comm,
            {
                f"the surface of contact pair {k}": shape,
                f"the friction of contact pair {k}": pair.friction,
                f"the motions of contact pair {k}": pair.motions,
            },
        )
    ones = K.createVecRight()
    ones.set(1.0)
    if not is_finite(K * ones):
        raise ValueError("the stiffness has entries that are not finite")
    return stated


def checked_step(
    space: fem.FunctionSpace,
    own: ContactState,
    state: ContactState,
    load: PETSc.Vec,
    motions: Motion | Sequence[Motion | None] | None,
    guess: ContactState | None,
) -> list[Motion | None]:
    """The motion of each pair in one increment; one of a single pair needs no list.

    Args:
        space: of the problem.
        own: a state of the problem.
        state: from which it goes on, as the others.
        load: at the end of the increment.
        motions: none, or one of each pair.
        guess: to start from.

    Raises:
        ValueError: for arguments of another kind, a load that is not finite or of another size,
            another number or dimension of motions, states of other pairs, or what differs between
            processes.
    """
    comm, pairs = space.mesh.comm, len(own.pairs)
    with collective(comm):
        each([state], ContactState, "the state")
        if guess is not None:
            each([guess], ContactState, "the state to start from")
            _same_pairs(guess, pairs)
        _check_load(load, space, "the load")
        moved = list(motions) if isinstance(motions, Iterable) else [motions]
        each([motion for motion in moved if motion is not None], Motion, "motions")
        if not moved or motions is None:
            moved = [None] * pairs
        if len(moved) != pairs:
            raise ValueError(f"{len(moved)} motions for {pairs} contact pairs")
        for k, motion in enumerate(moved):
            _check_motions([] if motion is None else [motion], space, k)
        check_belongs(state, own, "the state")
    agree(
        comm,
        {
            "the motions": moved,
            "the state": state.pairs,
            "the state to start from": guess and guess.pairs,
        },
    )
    if not is_finite(load):
        raise ValueError("the load is not finite")
    return moved


def checked_increments(
    loads: PETSc.Vec | Sequence[PETSc.Vec],
    pairs: Sequence[ContactPair],
    start: ContactState | Sequence[ContactState],
    space: fem.FunctionSpace,
) -> list[tuple[PETSc.Vec, list[Motion | None], ContactState | None]]:
    """Load, motion of each pair, and state to start from, of each increment.

    Raises:
        ValueError: as `checked_step`, for all increments.
    """
    comm = space.mesh.comm
    with collective(comm):
        given = [loads] if isinstance(loads, PETSc.Vec) else each(loads, PETSc.Vec, "loads")
        motions: list[list[Motion | None]] = []
        if not given:
            raise ValueError("there is no load increment")
        for k, load in enumerate(given):
            _check_load(load, space, f"the load of increment {k}")
        for k, pair in enumerate(pairs):
            moved = each(pair.motions, Motion, "motions")
            if moved and len(moved) != len(given):
                raise ValueError(
                    f"contact pair {k} has {len(moved)} motions for {len(given)} increments"
                )
            _check_motions(moved, space, k)
            motions.append(moved or [None] * len(given))
        guesses = each(start, ContactState, "states to start from")
        if guesses and len(guesses) != len(given):
            raise ValueError(f"{len(guesses)} states to start from for {len(given)} increments")
        for state in guesses:
            _same_pairs(state, len(pairs))
    numbers = {"the number of loads": len(given), "the number of states": len(guesses)}
    agree(comm, numbers)
    for k, load in enumerate(given):
        if not is_finite(load):
            raise ValueError(f"the load of increment {k} is not finite")
    steps = zip(*motions, strict=True)
    return list(zip(given, map(list, steps), guesses or [None] * len(given), strict=True))


def check_belongs(state: ContactState, own: ContactState, what: str) -> None:
    """Raises ValueError if a state has other contact nodes than a problem's own one."""
    alike = len(state.pairs) == len(own.pairs) and all(
        pair.position.shape == mine.position.shape
        and np.abs(pair.position - mine.position).max() <= _SAME * np.abs(mine.position).max()
        for pair, mine in zip(state.pairs, own.pairs, strict=True)
    )
    if not alike:
        raise ValueError(f"{what} belongs to other contact nodes than this problem's")


def _check_load(load: PETSc.Vec, space: fem.FunctionSpace, what: str) -> None:
    each([load], PETSc.Vec, what)
    size = space.dofmap.index_map.size_local * space.dofmap.index_map_bs
    if load.getLocalSize() != size:
        raise ValueError(f"{what} is no vector of the space: their sizes differ")


def _check_motions(motions: Sequence[Motion], space: fem.FunctionSpace, pair: int) -> None:
    dim = space.mesh.geometry.dim
    if any(len(motion.translation) != dim for motion in motions):
        raise ValueError(f"the motion of contact pair {pair} is not {dim}-D")


def _same_pairs(state: ContactState, pairs: int) -> None:
    if len(state.pairs) != pairs:
        raise ValueError("the state to start from has another number of contact pairs")
