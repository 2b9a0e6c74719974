"""What the study stores of a contact computation."""

from collections.abc import Sequence

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from pw_elements import reactions
from pw_elements.contact import OPEN, STICK, ContactState
from pw_elements.mechanics import Marker
from pw_elements.recovery import force_transfer, forces_along
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
    own = _own_area(body, line)
    tributary = _tributary_length(x) * _thickness(body)
    pressure = r_n / own
    curves = {
        "x": x,
        "force_n": r_n,
        "force_t": r_t,
        "pressure": pressure,
        "shear": r_t / own,
        "pressure_tributary": r_n / tributary,
        "shear_tributary": r_t / tributary,
        "gap": contact.gap,
        "friction": contact.friction,
        "status": contact.status,
        "nodes": body.space.tabulate_dof_coordinates()[:, :2],
        "cells": body.space.dofmap.list.copy(),
        "displacement": last.displacement.array_r.reshape(-1, 2),
    }
    if body.element == "galerkin-T6":
        curves |= _transferred(body, last, load, line)
    sticking = x[contact.status == STICK]
    closed = x[contact.status != OPEN]
    scalars = further | {
        "force_normal": r_n.sum(),
        "force_tangential": r_t.sum(),
        "iterations": sum(state.iterations for state in states),
        "iterations_most": max(state.iterations for state in states),
        "sawtooth": sawtooth(r_n, contact.status),
        "peak_pressure": pressure.max(),
        "peak_over_mean": pressure.max() / mean_pressure,
        "closed_from": closed.min(),
        "closed_to": closed.max(),
        "residual": max(state.residuals.largest() for state in states),
        "unique": float(all(state.unique for state in states)),
    }
    if len(sticking):
        scalars |= {"stick_from": sticking.min(), "stick_to": sticking.max()}
    return Result({k: float(v) for k, v in scalars.items()}, {}, curves, dofs=body.K.getSize()[0])


def sawtooth(force: Array, status: npt.NDArray[np.int8]) -> float:
    """Median over interior closed mid-side nodes of force over the mean of both corners'.

    2: the standard element under even pressure; 1: even forces.
    """
    middle = np.arange(1, len(force) - 1, 2)
    inner = middle[(middle > 1) & (middle < len(force) - 2)]
    closed = status != OPEN
    used = inner[closed[inner] & closed[inner - 1] & closed[inner + 1]]
    return float(np.median(2 * force[used] / (force[used - 1] + force[used + 1])))


def _own_area(body: Discretisation, line: Marker) -> Array:
    """Integral of each node's own test function over the contact line's area."""
    unit = body.surface_load((0.0, 1.0), line)
    return forces_along(body.space, unit, line).force[:, 1]


def _tributary_length(x: Array) -> Array:
    """Half of the distance between both neighbours, one-sided at the ends."""
    return np.convolve(np.diff(x), [0.5, 0.5])


def _thickness(body: Discretisation) -> float:
    return float(body.body.thickness)


def _transferred(
    body: Discretisation, state: ContactState, load: PETSc.Vec, line: Marker
) -> dict[str, Array]:
    """Nodal forces of the standard element times T."""
    r = reactions(body.K, state.displacement, load)
    transferred = forces_along(body.space, force_transfer(body.space) * r, line).force
    return {"force_n_T": transferred[:, 1], "force_t_T": -transferred[:, 0]}
