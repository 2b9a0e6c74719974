"""Values of users' surfaces and friction laws at sample points, for comparisons and checks.

Functions given by the user can be compared only by their values. These values are compared between
processes, and they identify a problem. Derivatives are compared with finite differences. The sample
points are derived from the positions of the contact nodes and do not depend on the partition of the
mesh. Therefore the values have to be equal on all processes.
"""

from collections.abc import Callable, Sequence
from typing import Any

from mpi4py import MPI

import numpy as np

from pw_elements.arrays import Array, Mask
from pw_elements.checks import (
    MAX_RELATIVE_DIFFERENCE_BETWEEN_RANKS,
    arguments,
    call_user_function,
    check_same_values,
    evenly_spaced_rows,
    raise_errors_on_all_processes,
)
from pw_elements.contact.interface.operators import ContactInterface, TangentPlaneSurface
from pw_elements.contact.model import (
    BUILT_IN_SURFACE_TYPES_WITH_CLOSEST_POINTS,
    ClosestPointSurface,
    ContactPair,
    Surface,
    describe_wrong_derivatives,
)

# Number of points in a box around a pair's nodes at which a surface is evaluated; and margin of the
# box around the nodes, relative to its diagonal
_N_SAMPLED_SURFACE_POINTS, _BOX_MARGIN_PER_DIAGONAL = 32, 0.5
# Number of nodes of a pair at which functions of positions are evaluated; and normal forces at
# which friction laws are evaluated
_N_SAMPLED_NODES_PER_PAIR = 32
_SAMPLED_NORMAL_FORCES: Array = 10.0 ** np.linspace(-6, 6, 13)
# Step of finite differences of closest points, relative to the extent of the contact nodes
_DIFFERENCE_STEP_PER_CONTACT_EXTENT = 1e-6


def check_pairs_are_equal_on_all_processes(
    interface: ContactInterface, pairs: Sequence[ContactPair], surfaces: Sequence[Surface]
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
                f"the surface of contact pair {k}": sample_surface_around_pair(
                    interface, k, surface
                ),
                f"the friction of contact pair {k}": sample_friction_coefficients(
                    interface, k, pair
                ),
                f"the interference of contact pair {k}": sample_interference(interface, k, pair),
            }
        check_same_values(interface.comm, values, MAX_RELATIVE_DIFFERENCE_BETWEEN_RANKS)


def sample_surface_around_pair(
    interface: ContactInterface, pair_index: int, surface: Surface
) -> Array:
    """Return values of a rigid surface's methods at points around a pair's nodes; collective.

    Gaps, normals and closest points are made dimensionless and put into one array. The array is
    empty for a deformable surface. A method that raises an error on all processes contributes NaN.

    Args:
        interface: all contact points.
        pair_index: index of the pair.
        surface: surface of the pair.
    """
    if isinstance(surface, TangentPlaneSurface) or pair_index in interface.mortars:
        return np.empty(0)
    x = _make_points_in_box_around_nodes(
        interface.gather_pair_in_position_order(pair_index, interface.position)
    )
    names = [
        "gap",
        "normal",
        *(["gap_normal_and_curvature"] if isinstance(surface, ClosestPointSurface) else []),
    ]
    size, values = interface.max_extent_of_points or 1.0, []
    for name in names:
        whose = f"the {name} of the surface of contact pair {pair_index}"
        parts = _evaluate_user_function_or_nan(interface.comm, whose, getattr(surface, name), x)
        # gaps are divided by a length, curvatures are multiplied by it
        scales = {
            "gap": [1 / size],
            "normal": [1.0],
            "gap_normal_and_curvature": [1 / size, 1.0, size],
        }[name]
        values += [np.ravel(part) * scale for part, scale in zip(parts, scales, strict=False)]
    return np.concatenate(values)


def sample_friction_coefficients(
    interface: ContactInterface, pair_index: int, pair: ContactPair
) -> Array:
    """Return friction coefficients at some nodes for several normal forces; collective.

    `pair_index` is the index of the pair.
    """
    x = evenly_spaced_rows(
        interface.gather_pair_in_position_order(pair_index, interface.position),
        _N_SAMPLED_NODES_PER_PAIR,
    )
    columns = np.zeros((3, len(x)))
    columns[: x.shape[1]] = x.T

    def coefficients_at_sampled_normal_forces(points: Array) -> Array:
        parameter = np.broadcast_to(pair.law.parameter_at(points), len(x))
        return np.array(
            [
                pair.law.limit(parameter, np.full(len(x), force))[0] / force
                for force in _SAMPLED_NORMAL_FORCES
            ]
        )

    whose = f"the friction of contact pair {pair_index}"
    return _evaluate_user_function_or_nan(
        interface.comm, whose, coefficients_at_sampled_normal_forces, columns
    )[0].ravel()


def sample_interference(interface: ContactInterface, pair_index: int, pair: ContactPair) -> Array:
    """Return the interference of a pair at some of its nodes; collective.

    If the interference is not a function, the result is this single value. `pair_index` is the
    index of the pair.
    """
    depth: Any = pair.interference
    if not arguments.is_user_function(depth):
        return np.array([float(depth)])
    x = evenly_spaced_rows(
        interface.gather_pair_in_position_order(pair_index, interface.position),
        _N_SAMPLED_NODES_PER_PAIR,
    )
    columns = np.zeros((3, len(x)))
    columns[: x.shape[1]] = x.T
    whose = f"the interference of contact pair {pair_index}"
    return _evaluate_user_function_or_nan(interface.comm, whose, depth, columns)[0].ravel()


def _evaluate_user_function_or_nan(
    comm: MPI.Comm, name_in_messages: str, function: Callable[[Array], Any], x: Array
) -> list[Array]:
    """Return the arrays that a user's function returns at points x, or NaN; collective.

    The result is NaN if the function raises an error on all processes. An error that occurs on only
    some of the processes is raised. In error messages the function is called `name_in_messages`.
    """
    values, error = [np.array(np.nan)], None
    with raise_errors_on_all_processes(comm), np.errstate(all="ignore"):
        try:
            result = call_user_function(comm, name_in_messages, function, x)
            parts = result if isinstance(result, tuple) else (result,)
            values = [np.asarray(part, dtype=float) for part in parts]
        except Exception as raised:  # a user's function may raise any error
            error = raised
    failed = comm.allreduce(int(error is not None), MPI.SUM)
    with raise_errors_on_all_processes(comm):
        if error is not None and failed < comm.size:
            raise error
    return values


def _make_points_in_box_around_nodes(node_positions: Array) -> Array:
    """Return points (n, dim) that evenly fill a box around nodes at positions (m, dim).

    The points are a Kronecker sequence: their coordinates, relative to the box, are the fractional
    parts of multiples of the inverse powers of r, the real root of r^(dim+1) = r + 1.
    """
    lower, upper = node_positions.min(axis=0), node_positions.max(axis=0)
    margin = _BOX_MARGIN_PER_DIAGONAL * (
        np.linalg.norm(upper - lower) or np.abs(upper).max() or 1.0
    )
    dim = node_positions.shape[1]
    root = np.real(max(np.roots([1.0] + [0.0] * (dim - 1) + [-1.0, -1.0]), key=np.real))
    steps = root ** -np.arange(1.0, dim + 1)
    fractions = np.outer(np.arange(1.0, _N_SAMPLED_SURFACE_POINTS + 1), steps) % 1.0
    return lower - margin + fractions * (upper - lower + 2 * margin)


def check_user_surface_derivatives(
    interface: ContactInterface, motion_in_surface_frame: Array, pressed: Mask
) -> None:
    """Compare the derivatives of users' surfaces with finite differences; collective.

    Args:
        interface: all contact points.
        motion_in_surface_frame: (m, dim), motions of the points in the frames of their surfaces.
        pressed: (m,), mask of the points at which the surfaces are checked.

    Raises:
        ValueError: if a surface gives wrong derivatives.
    """
    x, step = (
        interface.position + motion_in_surface_frame,
        _DIFFERENCE_STEP_PER_CONTACT_EXTENT * (interface.max_extent_of_points or 1.0),
    )
    users = [
        (k, surface, interface.gather_values(x[(interface.pair == k) & pressed]))
        for k, surface in enumerate(interface.surfaces)
        if k not in interface.mortars
        and type(surface) not in BUILT_IN_SURFACE_TYPES_WITH_CLOSEST_POINTS
    ]
    with raise_errors_on_all_processes(interface.comm):
        for k, surface, points in users:
            if not isinstance(surface, ClosestPointSurface) or not len(points):
                continue
            subject = f"the closest points of the surface of contact pair {k}"
            fault = call_user_function(
                interface.comm, subject, describe_wrong_derivatives, surface, points, step
            )
            if fault:
                raise ValueError(f"{subject} have the {fault}: correct it")
