"""What the study stores of a contact computation."""

from collections.abc import Sequence

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from pw_elements import reactions
from pw_elements.contact import OPEN, STICK, ContactState
from pw_elements.mechanics import Marker
from pw_elements.recovery import ContactSurface, force_transfer, forces_along
from study.elements import Discretisation
from study.store import Result

Array = npt.NDArray[np.float64]


def contact_result(
    body: Discretisation,
    states: Sequence[ContactState],
    load: PETSc.Vec,
    line: Marker,
    mean_pressure: float,
    **further: float,
) -> Result:
    """Scalars and curves of the last increment along one horizontal contact line.

    Args:
        body: the discretisation.
        states: all increments.
        load: of the last one.
        line: marker of the contact line's nodes, which alternate corner, mid-side, corner.
        mean_pressure: that pressures are stored relative to, in scalars only.
        further: scalars to store besides.
    """
    last = states[-1]
    (contact,) = last.pairs
    x, r_n = contact.position[:, 0], contact.force_normal
    r_t = -contact.force_tangential[:, 0]  # of the body on the surface, as it is pulled
    surface = ContactSurface.of(body.body, line)
    pressure = surface.pressure(r_n)
    closed = contact.status != OPEN
    curves = {
        "x": x,
        "force_n": r_n,
        "force_t": r_t,
        "pressure": pressure,
        "shear": surface.pressure(r_t),
        "pressure_tributary": surface.tributary_pressure(r_n),
        "shear_tributary": surface.tributary_pressure(r_t),
        "gap": contact.gap,
        "friction": contact.friction,
        "status": contact.status,
        "nodes": body.space.tabulate_dof_coordinates()[:, :2],
        "cells": body.space.dofmap.list.copy(),
        "displacement": last.displacement.array_r.reshape(-1, 2),
    }
    if body.element == "galerkin-T6":
        curves |= _transferred(body, last, load, line, contact.normal)
    sticking = x[contact.status == STICK]
    scalars = further | {
        "force_normal": r_n.sum(),
        "force_tangential": r_t.sum(),
        "iterations": sum(state.iterations for state in states),
        "iterations_most": max(state.iterations for state in states),
        "sawtooth": surface.sawtooth(r_n, closed),
        "unevenness": surface.unevenness(pressure, closed),
        "peak_pressure": pressure.max(),
        "peak_over_mean": pressure.max() / mean_pressure,
        "closed_from": x[closed].min(),
        "closed_to": x[closed].max(),
        "residual": max(state.residuals.largest() for state in states),
        "unique": float(all(state.unique for state in states)),
    }
    if len(sticking):
        scalars |= {"stick_from": sticking.min(), "stick_to": sticking.max()}
    return Result({k: float(v) for k, v in scalars.items()}, {}, curves, dofs=body.K.getSize()[0])


def _transferred(
    body: Discretisation, state: ContactState, load: PETSc.Vec, line: Marker, normal: Array
) -> dict[str, Array]:
    """Nodal forces of the standard element times T."""
    r = reactions(body.K, state.displacement, load)
    transferred = forces_along(body.space, force_transfer(body.space) * r, line).force
    along = transferred - np.sum(transferred * normal, axis=1)[:, None] * normal
    return {"force_n_T": np.sum(transferred * normal, axis=1), "force_t_T": -along[:, 0]}
