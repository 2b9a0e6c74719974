"""What the study stores of a contact computation."""

from collections.abc import Mapping, Sequence

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from pw_elements import SurfaceNodes, force_transfer, forces_along, reactions
from pw_elements.contact import OPEN, STICK
from pw_elements.contact.model import ContactState
from pw_elements.spaces import Marker
from study.model.discretisation import Discretisation, mesh_curves
from study.model.units import Units, units_of
from study.run.store import Result

Array = npt.NDArray[np.float64]

# Of the scalars that contact computations share, and of those that some of them add; names may
# end in the number of a surface
CONTACT_UNITS = {
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
    line: Marker,
    mean_pressure: float,
    units: Units,
    kinds: Mapping[str, str] | None = None,
    **further: float,
) -> Result:
    """Scalars and curves of the last increment along one horizontal contact line.

    Args:
        body: the discretisation.
        states: all increments.
        load: of the last one.
        line: marker of the contact line's nodes, which alternate corner, mid-side, corner.
        mean_pressure: that pressures are stored relative to, in scalars only.
        units: of forces, lengths and stresses.
        kinds: of further scalars that `CONTACT_UNITS` does not know, see `units_of`.
        further: scalars to store besides.
    """
    scalars, curves = surface_result(body, states[-1], 0, load, line, mean_pressure)
    scalars = further | scalars | solver_scalars(states)
    curves |= deformation_curves(body, states[-1])
    named = units_of(scalars, {**CONTACT_UNITS, **(kinds or {})}, units)
    return Result(scalars, named, curves, dofs=body.K.getSize()[0])


def surface_result(
    body: Discretisation,
    state: ContactState,
    pair: int,
    load: PETSc.Vec,
    line: Marker,
    mean_pressure: float,
) -> tuple[dict[str, float], dict[str, Array]]:
    """Scalars and curves of one contact pair along its horizontal line, see `contact_result`."""
    contact = state.pairs[pair]
    (x, y), r_n = contact.position.T, contact.force_normal
    r_t = -contact.force_tangential[:, 0]  # of the body on the surface, as it is pulled
    surface = SurfaceNodes.from_body(body.body, line)
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
        curves |= _transferred(body, state, load, line, contact.normal)
    sticking = x[contact.status == STICK]
    scalars = {
        "force_normal": r_n.sum(),
        "force_tangential": r_t.sum(),
        "sawtooth": surface.sawtooth(r_n, closed),
        "unevenness": surface.unevenness(pressure, closed),
        "peak_pressure": np.nanmax(pressure),  # on the axis a standard element has none
        "peak_over_mean": np.nanmax(pressure) / mean_pressure,
        "closed_from": x[closed].min(),
        "closed_to": x[closed].max(),
    }
    if len(sticking):
        scalars |= {"stick_from": sticking.min(), "stick_to": sticking.max()}
    judged = (contact.status == STICK) & ~np.isnan(curves["shear"])
    stuck = surface.edges[judged[surface.edges].all(axis=1)]
    if len(stuck):
        scalars["shear_second_difference"] = _second_difference(curves["shear"], stuck)
    return {name: float(value) for name, value in scalars.items()}, curves


def _second_difference(values: Array, edges: npt.NDArray[np.int_]) -> float:
    """Largest mid-side value less the mean of both corners', over the largest of all values.

    A kink, as where sliding begins, has one just as a zigzag has.
    """
    middle, first, last = values[edges].T
    return float(np.abs(middle - (first + last) / 2).max() / np.nanmax(np.abs(values)))


def solver_scalars(states: Sequence[ContactState]) -> dict[str, float]:
    """Iterations, the largest residual and uniqueness over all increments."""
    return {
        "iterations": float(sum(state.iterations for state in states)),
        "iterations_most": float(max(state.iterations for state in states)),
        "residual": max(state.residuals.largest() for state in states),
        "unique": float(all(state.unique for state in states)),
    }


def deformation_curves(body: Discretisation, state: ContactState) -> dict[str, Array]:
    """Nodes (n, 2), the nodes of each cell, and displacements (n, 2)."""
    displacement = state.displacement.array_r.reshape(-1, 2)
    return {**mesh_curves(body.space), "displacement": displacement}


def _transferred(
    body: Discretisation, state: ContactState, load: PETSc.Vec, line: Marker, normal: Array
) -> dict[str, Array]:
    """Nodal forces of the standard element times T."""
    r = reactions(body.K, state.displacement, load)
    transferred = forces_along(body.space, force_transfer(body.space) * r, line).force
    along = transferred - np.sum(transferred * normal, axis=1)[:, None] * normal
    return {"force_n_T": np.sum(transferred * normal, axis=1), "force_t_T": -along[:, 0]}
