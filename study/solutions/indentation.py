"""Rigid indenters on half planes and half spaces: contact pressures against the exact ones."""

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
from study.meshes.line_mesh import on_lines
from study.model.contact_result import CONTACT_UNITS
from study.model.discretisation import discretise, displacement_space, held_nodes, mesh_curves
from study.model.reading import transferred
from study.model.units import UNSTATED, Units, units_of
from study.run.store import Result
from study.solutions.half_space import BondedLine, KnownContact

Array = npt.NDArray[Any]

# The body is a square of this many half widths of the contact; elements grow away from it
OUTER, GROWTH = 5.0, 1.3
# Part of the half width that counts as away from the edge of the contact
INNER = 0.8
# Friction that lets nothing slip below a bonded punch
STICKING = 1e3

INDENTATION_UNITS = {
    **CONTACT_UNITS,
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
    """A rigid surface whose contact with a half plane or half space is known.

    Args:
        known: the solution.
        surface: the rigid, its lowest point at the origin.
        state: plane strain, or axisymmetric.
        units: of forces, lengths and stresses.
    """

    known: KnownContact
    surface: Surface
    state: StressState
    units: Units = UNSTATED


def series(
    element: str,
    indenter: Indenter,
    meshes: Mapping[int, Sequence[Array]],
    outer: float = OUTER,
    far_field: bool = True,
) -> Result:
    """Errors on meshes of growing fineness.

    The outer sides have the exact displacements of the half space, so that no error is due to
    the body's finite size; or they are held.

    Args:
        element: name.
        indenter: what presses.
        meshes: several meshes, each given by its lines x >= 0 where nodes may touch, for each
            number of elements over the half width; their errors' root mean square counts.
        outer: side of the body over the half width of the contact.
        far_field: whether the exact displacements are prescribed.

    Returns:
        Errors as curves over `elements`, those of the finest level as scalars, and the observed
        `order_…` over the last two doublings; curves along the surface of the second level.
    """
    levels = [
        [indented(element, indenter, lines, outer, far_field) for lines in of_level]
        for of_level in meshes.values()
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
        if len(values) > 2 and name != "error_radius"  # that one jumps from node to node
    }
    every = [r for level in levels for r in level]
    for name in ("iterations", "residual", "penetration", "off_edge"):
        scalars[name] = max(r.scalars[name] for r in every)
    curves = dict(levels[min(1, len(levels) - 1)][0].curves)
    curves |= {"elements": np.array([float(n) for n in meshes])} | errors
    named = units_of(scalars, INDENTATION_UNITS, indenter.units)
    return Result(scalars, named, curves, dofs=finest[0].dofs)


def indented(
    element: str,
    indenter: Indenter,
    lines: Array,
    outer: float = OUTER,
    far_field: bool = True,
) -> Result:
    """One half of an indented body on one mesh."""
    known, half_width = indenter.known, indenter.known.half_width
    side, zone = outer * half_width, lines[-1]
    material = Material(known.body.youngs_modulus, known.body.poissons_ratio)
    body = discretise(element, partial(graded_square, lines, side), material, indenter.state)

    def touching(x: Array) -> npt.NDArray[np.bool_]:
        return np.isclose(x[1], 0.0, atol=1e-9 * zone) & (x[0] < zone * (1 + 1e-9))

    conditions = _outer_conditions(body.space, known if far_field else None, side)
    conditions.append(prescribe(body.space, 0, lambda x: np.isclose(x[0], 0.0)))
    part = 1.0 if indenter.state is StressState.AXISYMMETRIC else 0.5  # of the force on this half
    down = Motion((0.0, None), (0.0, -part * known.force))
    friction = STICKING if isinstance(known, BondedLine) else 0.0
    pair = ContactPair(touching, indenter.surface, friction, [down])
    nothing = body.K.createVecLeft()
    (solved,) = solve_contact(body.K, nothing, body.supports(conditions), [pair], body.space)

    surface = SurfaceNodes.from_body(body.body, touching)
    curves = _along(solved, known, surface) | mesh_curves(body.space)
    if element == "galerkin-T6" and indenter.state is StressState.PLANE_STRAIN:
        T, r = force_transfer(body.space), reactions(body.K, solved.displacement, nothing)
        curves["force_n_T"] = -forces_along(body.space, T * r, touching).force[:, 1]
        weighted = transferred(surface, T)
        curves["pressure_T"] = weighted.pressure(curves["force_n_T"])
    scalars = _errors(curves, surface, known) | _summary(solved, known, surface)
    named = units_of(scalars, INDENTATION_UNITS, indenter.units)
    return Result(scalars, named, curves, dofs=body.K.getSize()[0])


def growing(smallest: float, length: float) -> Array:
    """Mesh lines from 0 to the length, elements growing from the smallest by GROWTH at most."""
    count = int(np.ceil(np.log1p(length / smallest * (GROWTH - 1)) / np.log(GROWTH)))
    if count <= length / smallest:
        powers = np.arange(count)
        factor = brentq(lambda g: smallest * np.sum(g**powers) - length, 1.0, 2 * GROWTH)
        return np.concatenate([[0.0], np.cumsum(smallest * factor**powers)])
    return np.linspace(0.0, length, count + 1)


def graded_square(lines: Array, side: float, cell: str) -> Mesh:
    """The square 0 <= x <= side, -side <= y <= 0, finest at the surface and along the lines."""
    sizes = np.diff(lines)
    x_lines = np.concatenate([lines, lines[-1] + growing(sizes[-1], side - lines[-1])[1:]])
    y_lines = -growing(sizes.min(), side)[::-1]
    return on_lines(MPI.COMM_SELF, x_lines, y_lines, cell)


def _outer_conditions(
    space: fem.FunctionSpace, known: KnownContact | None, side: float
) -> list[fem.DirichletBC]:
    """A known displacement field, or none, on the sides x = side and y = -side."""

    def outside(x: Array) -> npt.NDArray[np.bool_]:
        return np.isclose(x[0], side) | np.isclose(x[1], -side)

    if known is None:
        return [prescribe(space, i, outside) for i in (0, 1)]
    x = displacement_space(space).tabulate_dof_coordinates()
    nodes = np.flatnonzero(outside(x.T)).astype(np.int32)
    return [held_nodes(space, nodes, known.displacement(x[nodes, :2]))]


def _along(solved: ContactState, known: KnownContact, surface: SurfaceNodes) -> dict[str, Array]:
    """Curves along the surface; the exact pressure is NaN where it is infinite."""
    (contact,) = solved.pairs
    x = contact.position[:, 0]
    inside = x < known.half_width * (1 - 1e-9)
    edge = 0.0 if known.bounded else np.nan
    exact = np.where(inside, known.pressure(np.where(inside, x, 0.0)), edge)
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
        "exact_force": np.diff(known.force_within(borders(x))),
    }


def _errors(
    curves: Mapping[str, Array], surface: SurfaceNodes, known: KnownContact
) -> dict[str, float]:
    """Errors of forces and pressures over the whole contact, and over its inner part.

    Forces: sum of |r_i - exact force on the node's tributary length| over the sum of the latter.
    Pressures: root mean square of the difference from the exact pressure at the node, over that
    of the exact pressure, both weighted with tributary areas; there is none over the whole
    contact if the pressure is unbounded. Nodes without weight have no own-function pressure.
    Pressures over tributary areas, as node-to-surface codes print them, are compared below
    bounded pressures alone: there is no more to learn of them from the others.
    """
    errors = {}
    inner = curves["x"] < INNER * known.half_width
    for suffix, counts in (("", np.ones_like(inner)), ("_inner", inner)):
        exact = curves["exact_force"][counts]
        for name, curve in (("force", "force_n"), ("force_transferred", "force_n_T")):
            if curve in curves:
                difference = np.abs(curves[curve][counts] - exact)
                errors[f"error_{name}{suffix}"] = float(difference.sum() / exact.sum())
        if not (known.bounded or suffix):
            continue
        for name, curve in (
            ("own", "pressure"),
            ("tributary", "pressure_tributary"),
            ("transferred", "pressure_T"),
        ):
            if curve not in curves or (name == "tributary" and not known.bounded):
                continue
            valid = counts & np.isfinite(curves[curve])
            weight, p = surface.tributary_area[valid], curves["exact_pressure"][valid]
            squares = weight @ (curves[curve][valid] - p) ** 2 / (weight @ p**2)
            errors[f"error_pressure_{name}{suffix}"] = float(np.sqrt(squares))
    return errors


def _summary(solved: ContactState, known: KnownContact, surface: SurfaceNodes) -> dict[str, float]:
    """What else is stored of one mesh; `off_edge` is the miss of the contact's edge.

    The residual is one of forces; what is left of the gap is the penetration over the half width.
    The contact's radius is midway between the last closed and the first open node; `off_edge`
    counts its error in distances of these two, so that it is 1/2 at most if they enclose it.
    """
    (contact,), residuals = solved.pairs, solved.residuals
    x, closed = contact.position[:, 0], contact.status != OPEN
    own = surface.pressure(contact.force_normal)
    last = np.flatnonzero(closed)[-1]
    scalars = {
        "force_normal": float(contact.force_normal.sum()),
        "force_tangential": float(-contact.force_tangential[:, 0].sum()),
        "iterations": float(solved.iterations),
        "residual": max(residuals.equilibrium, residuals.tension, residuals.cone),
        "penetration": float(np.max(-contact.gap) / known.half_width),
        "sawtooth": surface.sawtooth(contact.force_normal, closed),
        "unevenness": surface.unevenness(own, closed),
        "peak_pressure": float(np.nanmax(own)),
        "weightless": float(np.isnan(own).sum()),
        "open_inside": float(np.sum(~closed[:last])),
        "contact_radius": float(x[last]),
        "off_edge": 0.0,
        "error_approach": float(abs(-contact.translation[1] / known.approach - 1)),
    }
    if known.bounded:
        radius = (x[last] + x[last + 1]) / 2
        scalars["contact_radius"] = float(radius)
        scalars["error_radius"] = float(abs(radius / known.half_width - 1))
        scalars["off_edge"] = float(abs(radius - known.half_width) / (x[last + 1] - x[last]))
        scalars["error_peak"] = float(abs(np.nanmax(own) / known.pressure(np.zeros(1))[0] - 1))
    return scalars


def borders(x: Array) -> Array:
    """Ends of the tributary lengths of nodes (m,) on a line: (m + 1,)."""
    return np.concatenate([x[:1], (x[1:] + x[:-1]) / 2, x[-1:]])


def _root_mean_square(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
