"""Values of the user's surfaces and laws at selected points, to compare and to check them.

Functions of the user can be compared by their values only. The values are compared between
processes, and identify a problem. Derivatives are compared with finite differences. The selected
points follow from the positions of the contact nodes and are independent of the partition of the
mesh, so that values are equal on all processes.
"""

from collections.abc import Callable, Sequence
from typing import Any

from mpi4py import MPI

import numpy as np

from pw_elements.arrays import Array, Mask
from pw_elements.checks import (
    RANK_DIFFERENCE_TOLERANCE,
    arguments,
    call_user_function,
    check_same_values,
    collective_errors,
    evenly_spaced_rows,
)
from pw_elements.contact.interface.operators import Interface, KnownGapSurface
from pw_elements.contact.model import (
    BUILT_IN_CLOSEST_POINTS,
    ClosestPointSurface,
    ContactPair,
    Surface,
    describe_wrong_derivatives,
)

# Number of points in a box around a pair's nodes at which a surface is evaluated; and margin of the
# box around the nodes, relative to its diagonal
_N_SURFACE_POINTS, _BOX_MARGIN = 32, 0.5
# Number of nodes of a pair at which functions of positions are evaluated; and normal forces at
# which friction laws are evaluated
_N_PROBE_NODES = 32
_PROBE_FORCES: Array = 10.0 ** np.linspace(-6, 6, 13)
# Step of finite differences of closest points, relative to the extent of the contact nodes
_DIFFERENCE_STEP = 1e-6


def compare_pairs_between_processes(
    interface: Interface, pairs: Sequence[ContactPair], surfaces: Sequence[Surface]
) -> None:
    """Raise ValueError if surfaces, laws or interferences differ between processes; collective.

    Args:
        interface: all contact points.
        pairs: contact pairs, as given by the user on this process.
        surfaces: surfaces of the pairs at their initial positions.
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
    """Return values of a rigid surface's methods at points around a pair's nodes; collective.

    Gaps, normals and closest points are made dimensionless and put into one array. It is empty for
    a deformable surface. A method that raises an error on all processes contributes NaN.

    Args:
        interface: all contact points.
        number: index of the pair.
        surface: surface of the pair.
    """
    if isinstance(surface, KnownGapSurface) or number in interface.mortars:
        return np.empty(0)
    x = _spread_points(interface.gather_in_order(number, interface.position))
    names = ["gap", "normal", *(["closest"] if isinstance(surface, ClosestPointSurface) else [])]
    size, values = interface.extent or 1.0, []
    for name in names:
        whose = f"the {name} of the surface of contact pair {number}"
        parts = _evaluate_or_nan(interface.comm, whose, getattr(surface, name), x)
        # gaps are divided by a length, curvatures are multiplied by it
        scales = {"gap": [1 / size], "normal": [1.0], "closest": [1 / size, 1.0, size]}[name]
        values += [np.ravel(part) * scale for part, scale in zip(parts, scales, strict=False)]
    return np.concatenate(values)


def probe_friction(interface: Interface, number: int, pair: ContactPair) -> Array:
    """Return friction coefficients at some nodes of a pair for several forces; collective.

    `number` is the index of the pair.
    """
    x = evenly_spaced_rows(interface.gather_in_order(number, interface.position), _N_PROBE_NODES)
    columns = np.zeros((3, len(x)))
    columns[: x.shape[1]] = x.T

    def coefficients(points: Array) -> Array:
        parameter = np.broadcast_to(pair.law.parameter_at(points), len(x))
        return np.array(
            [
                pair.law.limit(parameter, np.full(len(x), force))[0] / force
                for force in _PROBE_FORCES
            ]
        )

    whose = f"the friction of contact pair {number}"
    return _evaluate_or_nan(interface.comm, whose, coefficients, columns)[0].ravel()


def probe_interference(interface: Interface, number: int, pair: ContactPair) -> Array:
    """Return the interference of a pair at some of its nodes; collective.

    `number` is the index of the pair.
    """
    depth: Any = pair.interference
    if not arguments.is_user_function(depth):
        return np.array([float(depth)])
    x = evenly_spaced_rows(interface.gather_in_order(number, interface.position), _N_PROBE_NODES)
    columns = np.zeros((3, len(x)))
    columns[: x.shape[1]] = x.T
    whose = f"the interference of contact pair {number}"
    return _evaluate_or_nan(interface.comm, whose, depth, columns)[0].ravel()


def _evaluate_or_nan(
    comm: MPI.Comm, whose: str, function: Callable[[Array], Any], x: Array
) -> list[Array]:
    """Return the arrays that a user's function returns at points x, or NaN; collective.

    The result is NaN if the function raises an error on all processes. An error on only some of the
    processes is raised. `whose` is the name of the function in error messages.
    """
    values, error = [np.array(np.nan)], None
    with collective_errors(comm), np.errstate(all="ignore"):
        try:
            result = call_user_function(comm, whose, function, x)
            parts = result if isinstance(result, tuple) else (result,)
            values = [np.asarray(part, dtype=float) for part in parts]
        except Exception as raised:  # a user's function may raise any error
            error = raised
    failed = comm.allreduce(int(error is not None), MPI.SUM)
    with collective_errors(comm):
        if error is not None and failed < comm.size:
            raise error
    return values


def _spread_points(nodes: Array) -> Array:
    """Return points (n, dim) that fill a box around nodes (m, dim) evenly.

    The points are a Kronecker sequence. Their coordinates are the fractional parts of multiples of
    the inverse powers of r, which is the real root of r^(dim+1) = r + 1.
    """
    lower, upper = nodes.min(axis=0), nodes.max(axis=0)
    margin = _BOX_MARGIN * (np.linalg.norm(upper - lower) or np.abs(upper).max() or 1.0)
    dim = nodes.shape[1]
    root = np.real(max(np.roots([1.0] + [0.0] * (dim - 1) + [-1.0, -1.0]), key=np.real))
    steps = root ** -np.arange(1.0, dim + 1)
    fractions = np.outer(np.arange(1.0, _N_SURFACE_POINTS + 1), steps) % 1.0
    return lower - margin + fractions * (upper - lower + 2 * margin)


def check_closest_points(interface: Interface, motion: Array, pressed: Mask) -> None:
    """Check the derivatives of users' surfaces by finite differences; collective.

    Args:
        interface: all contact points.
        motion: (m, dim), motions of the points in the frames of their surfaces.
        pressed: (m,), mask of the points at which the surfaces are checked.

    Raises:
        ValueError: if a surface gives wrong derivatives.
    """
    x, step = interface.position + motion, _DIFFERENCE_STEP * (interface.extent or 1.0)
    users = [
        (k, surface, interface.gather_values(x[(interface.pair == k) & pressed]))
        for k, surface in enumerate(interface.surfaces)
        if k not in interface.mortars and type(surface) not in BUILT_IN_CLOSEST_POINTS
    ]
    with collective_errors(interface.comm):
        for k, surface, points in users:
            if not isinstance(surface, ClosestPointSurface) or not len(points):
                continue
            subject = f"the closest points of the surface of contact pair {k}"
            fault = call_user_function(
                interface.comm, subject, describe_wrong_derivatives, surface, points, step
            )
            if fault:
                raise ValueError(f"{subject} have the {fault}: correct it")
