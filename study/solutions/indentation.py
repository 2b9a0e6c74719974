"""Indentation of half planes and half spaces: errors of computed contact pressures and forces."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.mesh import Mesh
from scipy.optimize import brentq

from pw_elements import Material, SurfaceNodes, force_transfer, forces_along, prescribe, reactions
from pw_elements.contact import OPEN, ContactPair, Motion, solve_contact
from pw_elements.contact.model import ContactState, Surface
from pw_elements.elasticity import StressState
from study.meshes.line_mesh import mesh_along_lines
from study.model.contact_result import CONTACT_QUANTITIES
from study.model.discretisation import (
    collapsed_displacement_space,
    discretise,
    mesh_nodes_and_cells,
    prescribe_node_displacements,
)
from study.model.reading import multiply_nodal_weights_by_T
from study.model.units import UNSTATED_UNITS, Units, assign_units_to_scalars
from study.run.store import Result
from study.solutions.half_space import BondedLinePunch, ExactIndentation

Array = npt.NDArray[Any]

# Side of the square body over the half width of the contact, and growth ratio of its elements
BODY_SIZE, GROWTH = 5.0, 1.3
# Inner part of the contact, over its half width, in which errors are also computed
INNER_PART = 0.8
# Coefficient of friction that prevents all slip below a bonded punch
STICKING_FRICTION = 1e3

INDENTATION_QUANTITIES = {
    **CONTACT_QUANTITIES,
    "error_*": "1",
    "order_*": "1",
    "penetration": "1",
    "off_edge": "1",
    "weightless": "1",
    "open_inside": "1",
    "contact_radius": "length",
}

ELEMENTS = ("galerkin-T6", "pw-T6", "composite-T6", "galerkin-Q8", "pw-Q8", "pw-Q9")


@dataclass(frozen=True)
class Indenter:
    """Rigid indenter whose contact with a half plane or half space has an exact solution.

    Args:
        exact_contact: Exact solution of the contact.
        surface: Rigid surface, whose lowest point is at the origin.
        state: Plane strain or axisymmetric.
        units: Units of force, length and stress.
    """

    exact_contact: ExactIndentation
    surface: Surface
    state: StressState
    units: Units = UNSTATED_UNITS


def solve_indentation_on_refined_meshes(
    element: str,
    indenter: Indenter,
    mesh_lines_by_level: Mapping[int, Sequence[Array]],
    body_size: float = BODY_SIZE,
    prescribes_exact_far_field: bool = True,
) -> Result:
    """Solve an indentation on increasingly fine meshes; return errors and orders of convergence.

    Args:
        element: Name of the element.
        indenter: Rigid surface and exact solution.
        mesh_lines_by_level: Meshes of each refinement level, by the number of elements over the
            half width of the contact. A mesh is given by the positions x >= 0 of its mesh lines in
            the zone that may touch. The error of a level with several meshes is their root mean
            square.
        body_size: Side length of the square body, relative to the half width of the contact.
        prescribes_exact_far_field: Whether the exact displacements are prescribed on the far sides,
            so that the finite size of the body causes no error; otherwise these sides are fixed.

    Returns:
        Errors as curves over `elements`, errors of the finest level and observed orders `order_*`
        (over the last two doublings) as scalars, and curves along the surface of the second level.
    """
    levels = [
        [
            solve_indentation_on_one_mesh(
                element, indenter, lines, body_size, prescribes_exact_far_field
            )
            for lines in of_level
        ]
        for of_level in mesh_lines_by_level.values()
    ]
    names = [name for name in levels[0][0].scalars if name.startswith("error")]
    errors = {
        name: np.array([_root_mean_square([r.scalars[name] for r in level]) for level in levels])
        for name in names
    }
    finest = levels[-1]
    scalars = {
        name: float(np.mean([r.scalars[name] for r in finest])) for name in finest[0].scalars
    }
    scalars |= {name: float(values[-1]) for name, values in errors.items()}
    scalars |= {
        name.replace("error", "order", 1): float(np.log2(values[-3] / values[-1]) / 2)
        for name, values in errors.items()
        if len(values) > 2 and name != "error_radius"  # the radius jumps from node to node
    }
    all_results = [r for level in levels for r in level]
    for name in ("iterations", "residual", "penetration", "off_edge"):
        scalars[name] = max(r.scalars[name] for r in all_results)
    curves = dict(levels[min(1, len(levels) - 1)][0].curves)
    curves |= {"elements": np.array([float(n) for n in mesh_lines_by_level])} | errors
    scalar_units = assign_units_to_scalars(scalars, INDENTATION_QUANTITIES, indenter.units)
    return Result(scalars, scalar_units, curves, dofs=finest[0].dofs)


def solve_indentation_on_one_mesh(
    element: str,
    indenter: Indenter,
    contact_lines: Array,
    body_size: float = BODY_SIZE,
    prescribes_exact_far_field: bool = True,
) -> Result:
    """Solve an indentation on one mesh of the half x >= 0 of the body.

    Args:
        element: Name of the element.
        indenter: Rigid surface and exact solution.
        contact_lines: Positions x >= 0 of the mesh lines in the zone that may touch.
        body_size: Side length of the square body, relative to the half width of the contact.
        prescribes_exact_far_field: Whether the exact displacements are prescribed on the far sides.

    Returns:
        Errors and other scalars, and curves along the surface.
    """
    exact = indenter.exact_contact
    side, zone = body_size * exact.half_width, contact_lines[-1]
    material = Material(exact.body.youngs_modulus, exact.body.poissons_ratio)
    body = discretise(
        element, partial(mesh_graded_square, contact_lines, side), material, indenter.state
    )

    def may_touch(x: Array) -> npt.NDArray[np.bool_]:
        return np.isclose(x[1], 0.0, atol=1e-9 * zone) & (x[0] < zone * (1 + 1e-9))

    conditions = _prescribe_exact_or_zero_on_far_sides(
        body.space, exact if prescribes_exact_far_field else None, side
    )
    conditions.append(prescribe(body.space, 0, lambda x: np.isclose(x[0], 0.0)))
    force_factor = 1.0 if indenter.state is StressState.AXISYMMETRIC else 0.5  # half the plane body
    down = Motion((0.0, None), (0.0, -force_factor * exact.force))
    friction = STICKING_FRICTION if isinstance(exact, BondedLinePunch) else 0.0
    pair = ContactPair(may_touch, indenter.surface, friction, [down])
    no_load = body.K.createVecLeft()
    (state,) = solve_contact(body.K, no_load, body.supports(conditions), [pair], body.space)

    surface = SurfaceNodes.from_body(body.body, may_touch)
    curves = _contact_curves_along_surface(state, exact, surface) | mesh_nodes_and_cells(body.space)
    if element == "galerkin-T6" and indenter.state is StressState.PLANE_STRAIN:
        T, r = force_transfer(body.space), reactions(body.K, state.displacement, no_load)
        curves["force_n_T"] = -forces_along(body.space, T * r, may_touch).force[:, 1]
        weighted = multiply_nodal_weights_by_T(surface, T)
        curves["pressure_T"] = weighted.pressure(curves["force_n_T"])
    scalars = _relative_errors_of_forces_and_pressures(curves, surface, exact)
    scalars |= _force_residual_and_radius_scalars(state, exact, surface)
    scalar_units = assign_units_to_scalars(scalars, INDENTATION_QUANTITIES, indenter.units)
    return Result(scalars, scalar_units, curves, dofs=body.K.getSize()[0])


def mesh_line_positions_growing_from_size(first_size: float, length: float) -> Array:
    """Return positions of mesh lines from 0 to `length`, at geometrically growing distances.

    The first distance is at most `first_size`, the ratio of successive ones at most `GROWTH`.
    """
    count = int(np.ceil(np.log1p(length / first_size * (GROWTH - 1)) / np.log(GROWTH)))
    if count <= length / first_size:
        powers = np.arange(count)
        factor = brentq(lambda g: first_size * np.sum(g**powers) - length, 1.0, 2 * GROWTH)
        return np.concatenate([[0.0], np.cumsum(first_size * factor**powers)])
    return np.linspace(0.0, length, count + 1)


def mesh_graded_square(contact_lines: Array, side_length: float, cell: str) -> Mesh:
    """Mesh the square 0 <= x <= side, -side <= y <= 0, with the finest cells in the contact zone.

    Args:
        contact_lines: Positions x of the mesh lines in the zone that may touch, from 0.
        side_length: Side length of the square.
        cell: Name of the cell type, "triangle" or "quadrilateral".
    """
    sizes = np.diff(contact_lines)
    x_lines = np.concatenate(
        [
            contact_lines,
            contact_lines[-1]
            + mesh_line_positions_growing_from_size(sizes[-1], side_length - contact_lines[-1])[1:],
        ]
    )
    y_lines = -mesh_line_positions_growing_from_size(sizes.min(), side_length)[::-1]
    return mesh_along_lines(MPI.COMM_SELF, x_lines, y_lines, cell)


def _prescribe_exact_or_zero_on_far_sides(
    space: fem.FunctionSpace, exact_contact: ExactIndentation | None, side_length: float
) -> list[fem.DirichletBC]:
    """Prescribe displacements on the sides x = side and y = -side.

    Args:
        space: Displacement space.
        exact_contact: Solution whose displacements are prescribed; None for zero displacements.
        side_length: Side length of the body.
    """

    def is_on_far_sides(x: Array) -> npt.NDArray[np.bool_]:
        return np.isclose(x[0], side_length) | np.isclose(x[1], -side_length)

    if exact_contact is None:
        return [prescribe(space, i, is_on_far_sides) for i in (0, 1)]
    x = collapsed_displacement_space(space).tabulate_dof_coordinates()
    nodes = np.flatnonzero(is_on_far_sides(x.T)).astype(np.int32)
    return [prescribe_node_displacements(space, nodes, exact_contact.displacement(x[nodes, :2]))]


def _contact_curves_along_surface(
    state: ContactState, exact_contact: ExactIndentation, surface: SurfaceNodes
) -> dict[str, Array]:
    """Return computed and exact forces, pressures and status of the nodes along the surface.

    From the edge of the contact outwards, the exact pressure is 0 if it is bounded, else NaN.
    """
    (contact,) = state.pairs
    x = contact.position[:, 0]
    inside = x < exact_contact.half_width * (1 - 1e-9)
    pressure_at_edge = 0.0 if exact_contact.has_bounded_pressure else np.nan
    exact = np.where(inside, exact_contact.pressure(np.where(inside, x, 0.0)), pressure_at_edge)
    return {
        "x": x,
        "force_n": contact.force_normal,
        "force_t": -contact.force_tangential[:, 0],
        "pressure": surface.pressure(contact.force_normal),
        "pressure_tributary": surface.tributary_pressure(contact.force_normal),
        "shear": surface.pressure(-contact.force_tangential[:, 0]),
        "gap": contact.gap,
        "status": contact.status,
        "exact_pressure": exact,
        "exact_force": np.diff(exact_contact.force_within(ends_of_tributary_lengths(x))),
    }


def _relative_errors_of_forces_and_pressures(
    curves: Mapping[str, Array], surface: SurfaceNodes, exact_contact: ExactIndentation
) -> dict[str, float]:
    """Return relative errors of nodal forces and pressures over the contact and its inner part.

    The error of forces is the sum of |nodal force - exact force on the node's tributary length|,
    divided by the sum of the exact forces. The error of pressures is the root mean square of the
    difference from the exact pressure at the nodes, divided by the root mean square of the exact
    pressure, both weighted with tributary areas. If the exact pressure is unbounded, errors of
    pressures are computed for the inner part only. Nodes whose test function has integral zero
    have no pressure and are omitted. Pressures from tributary areas, which node-to-surface codes
    print, are compared with bounded exact pressures only.
    """
    errors = {}
    inner = curves["x"] < INNER_PART * exact_contact.half_width
    for suffix, counts in (("", np.ones_like(inner)), ("_inner", inner)):
        exact = curves["exact_force"][counts]
        for name, curve in (("force", "force_n"), ("force_transferred", "force_n_T")):
            if curve in curves:
                difference = np.abs(curves[curve][counts] - exact)
                errors[f"error_{name}{suffix}"] = float(difference.sum() / exact.sum())
        if not (exact_contact.has_bounded_pressure or suffix):
            continue
        for name, curve in (
            ("own", "pressure"),
            ("tributary", "pressure_tributary"),
            ("transferred", "pressure_T"),
        ):
            if curve not in curves or (
                name == "tributary" and not exact_contact.has_bounded_pressure
            ):
                continue
            valid = counts & np.isfinite(curves[curve])
            weight, p = surface.tributary_area[valid], curves["exact_pressure"][valid]
            squares = weight @ (curves[curve][valid] - p) ** 2 / (weight @ p**2)
            errors[f"error_pressure_{name}{suffix}"] = float(np.sqrt(squares))
    return errors


def _force_residual_and_radius_scalars(
    state: ContactState, exact_contact: ExactIndentation, surface: SurfaceNodes
) -> dict[str, float]:
    """Return total forces, residuals, contact radius and other scalars of a contact state.

    `residual` is the largest residual of forces, `penetration` the largest penetration relative to
    the half width, and `error_approach` the relative error of the indentation depth. The contact
    radius is midway between the last closed and the first open node; `off_edge` is its error
    divided by the distance of these nodes, at most 1/2 if they enclose the exact radius. For
    unbounded pressures the radius is the position of the last closed node.
    """
    (contact,), residuals = state.pairs, state.residuals
    x, closed = contact.position[:, 0], contact.status != OPEN
    pressure = surface.pressure(contact.force_normal)
    last = np.flatnonzero(closed)[-1]
    scalars = {
        "force_normal": float(contact.force_normal.sum()),
        "force_tangential": float(-contact.force_tangential[:, 0].sum()),
        "iterations": float(state.iterations),
        "residual": max(residuals.equilibrium, residuals.tension, residuals.cone),
        "penetration": float(np.max(-contact.gap) / exact_contact.half_width),
        "sawtooth": surface.sawtooth(contact.force_normal, closed),
        "unevenness": surface.unevenness(pressure, closed),
        "peak_pressure": float(np.nanmax(pressure)),
        "weightless": float(np.isnan(pressure).sum()),
        "open_inside": float(np.sum(~closed[:last])),
        "contact_radius": float(x[last]),
        "off_edge": 0.0,
        "error_approach": float(abs(-contact.translation[1] / exact_contact.approach - 1)),
    }
    if exact_contact.has_bounded_pressure:
        radius = (x[last] + x[last + 1]) / 2
        scalars["contact_radius"] = float(radius)
        scalars["error_radius"] = float(abs(radius / exact_contact.half_width - 1))
        scalars["off_edge"] = float(
            abs(radius - exact_contact.half_width) / (x[last + 1] - x[last])
        )
        scalars["error_peak"] = float(
            abs(np.nanmax(pressure) / exact_contact.pressure(np.zeros(1))[0] - 1)
        )
    return scalars


def ends_of_tributary_lengths(x: Array) -> Array:
    """Return the ends (m + 1,) of the tributary lengths of nodes at increasing positions x (m,)."""
    return np.concatenate([x[:1], (x[1:] + x[:-1]) / 2, x[-1:]])


def _root_mean_square(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
