"""Scalars and curves that the study stores for a contact computation."""

from collections.abc import Mapping, Sequence

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from pw_elements import SurfaceNodes, force_transfer, forces_along, reactions
from pw_elements.contact import OPEN, STICK
from pw_elements.contact.model import ContactState
from pw_elements.spaces import Marker
from study.model.discretisation import Discretisation, mesh_nodes_and_cells
from study.model.units import Units, assign_units_to_scalars
from study.run.store import Result

Array = npt.NDArray[np.float64]

# Physical quantity of each scalar of a contact computation, by pattern of its name; names may end
# in the number of a surface
CONTACT_QUANTITIES = {
    "force_*": "force",
    "translation": "length",
    "peak_pressure*": "stress",
    "peak_over_mean*": "1",
    "closed_from*": "length",
    "closed_to*": "length",
    "stick_from*": "length",
    "stick_to*": "length",
    "sawtooth*": "1",
    "unevenness*": "1",
    "shear_second_difference*": "1",
    "edge_force_*": "force",
    "iterations": "1",
    "iterations_most": "1",
    "residual": "1",
    "unique": "1",
}


def contact_result(
    body: Discretisation,
    states: Sequence[ContactState],
    load: PETSc.Vec,
    on_contact_line: Marker,
    mean_pressure: float,
    units: Units,
    extra_quantities: Mapping[str, str] | None = None,
    **extra_scalars: float,
) -> Result:
    """Return the scalars of a contact problem, and curves along its horizontal contact line.

    Curves and contact forces belong to the last increment.

    Args:
        body: Discretised body.
        states: Contact states at the ends of all increments.
        load: Load vector of the last increment.
        on_contact_line: Marker of the contact nodes, which must be alternately corner and mid-side
            nodes, beginning with a corner.
        mean_pressure: Pressure by which the peak pressure is divided for `peak_over_mean`.
        units: Units of force, length and stress.
        extra_quantities: Quantities of scalars that are not in `CONTACT_QUANTITIES`, see
            `assign_units_to_scalars`.
        extra_scalars: Further scalars to store.
    """
    scalars, curves = compute_pair_scalars_and_curves(
        body, states[-1], 0, load, on_contact_line, mean_pressure
    )
    scalars = extra_scalars | scalars | summarise_solver_statistics(states)
    curves |= mesh_and_displacement_curves(body, states[-1])
    scalar_units = assign_units_to_scalars(
        scalars, {**CONTACT_QUANTITIES, **(extra_quantities or {})}, units
    )
    return Result(scalars, scalar_units, curves, dofs=body.K.getSize()[0])


def compute_pair_scalars_and_curves(
    body: Discretisation,
    state: ContactState,
    pair_index: int,
    load: PETSc.Vec,
    on_contact_line: Marker,
    mean_pressure: float,
) -> tuple[dict[str, float], dict[str, Array]]:
    """Return the scalars and curves of one contact pair along a horizontal contact line.

    `pair_index` is the position of the pair in the state; see `contact_result` for the other
    arguments.
    """
    contact = state.pairs[pair_index]
    (x, y), r_n = contact.position.T, contact.force_normal
    r_t = -contact.force_tangential[:, 0]  # force of the body on the surface
    surface = SurfaceNodes.from_body(body.body, on_contact_line)
    pressure = surface.pressure(r_n)
    closed = contact.status != OPEN
    curves = {
        "x": x,
        "y": y,
        "force_n": r_n,
        "force_t": r_t,
        "pressure": pressure,
        "shear": surface.pressure(r_t),
        "pressure_tributary": surface.tributary_pressure(r_n),
        "shear_tributary": surface.tributary_pressure(r_t),
        "gap": contact.gap,
        "friction": contact.friction,
        "status": contact.status,
    }
    if body.element == "galerkin-T6":
        curves |= _curves_of_standard_forces_times_T(
            body, state, load, on_contact_line, contact.normal
        )
    sticking = x[contact.status == STICK]
    scalars = {
        "force_normal": r_n.sum(),
        "force_tangential": r_t.sum(),
        "sawtooth": surface.sawtooth(r_n, closed),
        "unevenness": surface.unevenness(pressure, closed),
        "peak_pressure": np.nanmax(pressure),  # NaN at a standard element's node on the axis
        "peak_over_mean": np.nanmax(pressure) / mean_pressure,
        "closed_from": x[closed].min(),
        "closed_to": x[closed].max(),
    }
    if len(sticking):
        scalars |= {"stick_from": sticking.min(), "stick_to": sticking.max()}
    sticks_with_shear = (contact.status == STICK) & ~np.isnan(curves["shear"])
    sticking_edges = surface.edges[sticks_with_shear[surface.edges].all(axis=1)]
    if len(sticking_edges):
        scalars["shear_second_difference"] = _max_relative_second_difference(
            curves["shear"], sticking_edges
        )
    return {name: float(value) for name, value in scalars.items()}, curves


def _max_relative_second_difference(values: Array, edges: npt.NDArray[np.int_]) -> float:
    """Return the largest second difference of nodal values along edges over the largest value.

    The second difference is the mid-side value minus the mean of both corner values. It is large
    for zigzags, but also for kinks, e.g. at the beginning of sliding.

    Args:
        values: Nodal values (n,).
        edges: Nodes (m, 3) of edges, in the order mid-side node, first corner, last corner.
    """
    middle, first, last = values[edges].T
    return float(np.abs(middle - (first + last) / 2).max() / np.nanmax(np.abs(values)))


def summarise_solver_statistics(states: Sequence[ContactState]) -> dict[str, float]:
    """Return statistics of the contact solver over all increments.

    Returns:
        Total and largest number of iterations, largest residual, and whether all solutions are
        unique (1.0 or 0.0).
    """
    return {
        "iterations": float(sum(state.iterations for state in states)),
        "iterations_most": float(max(state.iterations for state in states)),
        "residual": max(state.residuals.largest() for state in states),
        "unique": float(all(state.unique for state in states)),
    }


def mesh_and_displacement_curves(body: Discretisation, state: ContactState) -> dict[str, Array]:
    """Return the curves `nodes` (n, 2), `cells` (nodes of each cell) and `displacement` (n, 2)."""
    displacement = state.displacement.array_r.reshape(-1, 2)
    return {**mesh_nodes_and_cells(body.space), "displacement": displacement}


def _curves_of_standard_forces_times_T(
    body: Discretisation,
    state: ContactState,
    load: PETSc.Vec,
    on_contact_line: Marker,
    normal: Array,
) -> dict[str, Array]:
    """Return normal and tangential components of the nodal forces, multiplied by the matrix T.

    T is the matrix of `force_transfer`, which converts forces of the standard triangle.
    """
    r = reactions(body.K, state.displacement, load)
    transferred = forces_along(body.space, force_transfer(body.space) * r, on_contact_line).force
    normal_force = np.sum(transferred * normal, axis=1)
    tangential_force = transferred - normal_force[:, None] * normal
    return {"force_n_T": normal_force, "force_t_T": -tangential_force[:, 0]}
