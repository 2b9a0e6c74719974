"""What surfaces and laws of contact pairs give at fixed points, the same ones on all processes.

By that a problem is told from others, and processes are compared: a user's functions have no other
identity than their values. All points follow from positions of contact nodes, so that no partition
enters.
"""

from collections.abc import Callable, Sequence
from typing import Any

from mpi4py import MPI

import numpy as np

from pw_elements.arrays import Array
from pw_elements.checks import (
    RANK_DIFFERENCE_TOLERANCE,
    arguments,
    call_user_function,
    check_same_values,
    collective_errors,
    evenly_spaced_rows,
)
from pw_elements.contact.interface.operators import InitialGap, Interface
from pw_elements.contact.model import ContactPair, RigidBody, Surface

# Points at which a surface is asked, in a box around a pair's nodes, and how far that reaches
# beyond them, over the diagonal of the box
_SURFACE_POINTS, _MARGIN = 32, 0.5
# Nodes of a pair at which functions of positions are asked, and normal forces for laws of friction
_NODES = 32
_FORCES: Array = 10.0 ** np.linspace(-6, 6, 13)


def compare_pairs(
    interface: Interface, pairs: Sequence[ContactPair], surfaces: Sequence[Surface]
) -> None:
    """Raise ValueError on all processes where functions of pairs differ between them; collective.

    Args:
        interface: of the pairs.
        pairs: as the user states them, on this process.
        surfaces: of the pairs, at their initial places.
    """
    if interface.comm.size > 1:
        values: dict[str, Array] = {}
        for k, (pair, surface) in enumerate(zip(pairs, surfaces, strict=True)):
            values |= {
                f"the surface of contact pair {k}": probe_surface(interface, k, surface),
                f"the friction of contact pair {k}": probe_friction(interface, k, pair),
                f"the interference of contact pair {k}": probe_interference(interface, k, pair),
            }
        check_same_values(interface.comm, values, RANK_DIFFERENCE_TOLERANCE)


def probe_surface(interface: Interface, number: int, surface: Surface) -> Array:
    """Return gaps and normals of a rigid surface, and its closest points, around a pair's nodes.

    There is nothing of another body, whose place its nodes tell, and NaN of what raises an error
    beyond the nodes, on all processes. Collective.
    """
    if isinstance(surface, InitialGap) or number in interface.mortars:
        return np.empty(0)
    x = _spread_points(interface.in_order(number, interface.position))
    names = ["gap", "normal", *(["closest"] if isinstance(surface, RigidBody) else [])]
    size, values = interface.extent or 1.0, []
    for name in names:
        whose = f"the {name} of the surface of contact pair {number}"
        given = _evaluate_or_nan(interface.comm, whose, getattr(surface, name), x)
        # gaps over a length, and curvatures times one
        lengths = {"gap": [1 / size], "normal": [1.0], "closest": [1 / size, 1.0, size]}[name]
        values += [np.ravel(part) * scale for part, scale in zip(given, lengths, strict=False)]
    return np.concatenate(values)


def probe_friction(interface: Interface, number: int, pair: ContactPair) -> Array:
    """Return coefficients of a pair's law at some of its nodes, under many forces; collective."""
    x = evenly_spaced_rows(interface.in_order(number, interface.position), _NODES)
    columns = np.zeros((3, len(x)))
    columns[: x.shape[1]] = x.T

    def coefficients(points: Array) -> Array:
        at = np.broadcast_to(pair.law.at(points), len(x))
        return np.array([pair.law.limit(at, np.full(len(x), one))[0] / one for one in _FORCES])

    whose = f"the friction of contact pair {number}"
    return _evaluate_or_nan(interface.comm, whose, coefficients, columns)[0].ravel()


def probe_interference(interface: Interface, number: int, pair: ContactPair) -> Array:
    """Return the depths of a pair's interference at some of its nodes; collective."""
    depth: Any = pair.interference
    if not arguments.is_user_function(depth):
        return np.array([float(depth)])
    x = evenly_spaced_rows(interface.in_order(number, interface.position), _NODES)
    columns = np.zeros((3, len(x)))
    columns[: x.shape[1]] = x.T
    whose = f"the interference of contact pair {number}"
    return _evaluate_or_nan(interface.comm, whose, depth, columns)[0].ravel()


def _evaluate_or_nan(
    comm: MPI.Comm, whose: str, function: Callable[[Array], Any], x: Array
) -> list[Array]:
    """Return the arrays that a function gives; NaN where it raises an error on all processes."""
    values, error = [np.array(np.nan)], None
    with collective_errors(comm), np.errstate(all="ignore"):
        try:
            given = call_user_function(comm, whose, function, x)
            parts = given if isinstance(given, tuple) else (given,)
            values = [np.asarray(part, dtype=float) for part in parts]
        except Exception as raised:  # of whatever kind: it is a user's
            error = raised
    failed = comm.allreduce(int(error is not None), MPI.SUM)
    with collective_errors(comm):
        if error is not None and failed < comm.size:
            raise error
    return values


def _spread_points(nodes: Array) -> Array:
    """Return points (n, dim) all over a box around nodes (m, dim): none of them is a special one.

    They are multiples of the inverse powers of the real root of r^(dim+1) = r + 1, less whole
    numbers, which fill a box evenly.
    """
    lower, upper = nodes.min(axis=0), nodes.max(axis=0)
    margin = _MARGIN * (np.linalg.norm(upper - lower) or np.abs(upper).max() or 1.0)
    dim = nodes.shape[1]
    root = np.real(max(np.roots([1.0] + [0.0] * (dim - 1) + [-1.0, -1.0]), key=np.real))
    steps = root ** -np.arange(1.0, dim + 1)
    shares = np.outer(np.arange(1.0, _SURFACE_POINTS + 1), steps) % 1.0
    return lower - margin + shares * (upper - lower + 2 * margin)
