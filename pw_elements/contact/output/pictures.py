"""Pictures of a state: pressure and shear along the contact line, or over the contact face.

Labels name no units:

    axes = plot(states[-1], body)
    axes.set(xlabel="x [mm]", ylabel="traction [MPa]")
    axes.figure.savefig("contact.png")
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse import csgraph

from pw_elements.arrays import Indices
from pw_elements.checks import arguments, check_same_arguments, collective_errors
from pw_elements.contact.model import ContactState
from pw_elements.contact.nodes import HELD, OPEN, SLIP, STICK
from pw_elements.contact.output.fields import SideResults, check_state, mortar_sides, own_results
from pw_elements.elasticity import Body, StressState, SurfaceNodes
from pw_elements.pictures import SUB_TRIANGLES, check_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes


_BLUE = "#0072B2"
_ORANGE = "#D55E00"
# Arrows shorter than this, over the longest one, are none
_INVISIBLE = 1e-3


@check_same_arguments
def plot(
    state: ContactState,
    body: Body,
    pair: int = 0,
    axes: Axes | None = None,
    along: int | None = None,
    opposite: bool = False,
    unit: str = "",
) -> Axes:
    """Draws pressure and shear of one pair with Matplotlib; every process calls it.

    In the plane and in axisymmetry they are drawn along the contact line: the pressure, the shear
    traction on the body in the direction of the line, the bounds ± mu p between which it lies, and
    the status of each node. In space the pressure is a colour on the undeformed face, seen along
    the mean normal, arrows are shear tractions, and a line surrounds the nodes that stick.

    Pressures are nodal forces over the integrals of the nodes' own test functions (measure 2 of
    `SurfaceNodes`) on the undeformed surface, in units of the modulus. At large strains these
    are named nominal, and `ContactFields` has the true ones.

    Args:
        state: whose contact is drawn.
        body: whose contact it is.
        pair: number of the pair, from 0.
        axes: to draw in; by default those of a new figure.
        along: coordinate (0 or 1) that is the abscissa of a line; by default the arc length from
            the end with the least coordinates. Not for faces in space.
        opposite: whether to draw them on the deformable surface that the pair faces.
        unit: of tractions, for the labels, such as "MPa".

    Returns:
        The axes. Each process has its own; let one of them save the figure.

    Raises:
        TypeError: for arguments of the wrong type.
        ValueError: for a pair, coordinate or opposite surface that does not exist, and as
            `ContactFields.of`.
    """
    import matplotlib.pyplot as plt

    arguments.check_type("body", body, Body, "pressures need the body's surface measure")
    arguments.check_flag("opposite", opposite)
    arguments.check_type("unit", unit, str, 'it has to be a string, such as "MPa"')
    with collective_errors(body.spaces.mesh.comm):
        check_axes(axes)
    check_state(state, body.spaces.displacements.trial)
    dim = body.spaces.mesh.geometry.dim
    if arguments.check_integer("pair", pair, 0) >= len(state.pairs):
        raise ValueError(f"pair {pair}: the state has {len(state.pairs)}, counted from 0")
    if along is not None and (dim == 3 or arguments.check_integer("along", along, 0) > 1):
        raise ValueError(f"along = {along}: lines in the plane run along coordinate 0 or 1")
    surface, side = _side(pair, state, body, opposite)
    axes = plt.subplots(layout="constrained")[1] if axes is None else axes
    name = "pressure" if state.smallness else "nominal pressure"
    if dim == 3:
        _face(axes, surface, side, name, unit)
    else:
        names = "rz" if body.state is StressState.AXISYMMETRIC else "xy"
        _line(axes, surface, side, along, name)
        axes.set(xlabel="arc length" if along is None else names[along])
        axes.set(ylabel=f"traction [{unit}]" if unit else "traction")
    return axes


def _side(
    number: int, state: ContactState, body: Body, opposite: bool
) -> tuple[SurfaceNodes, SideResults]:
    own, other = mortar_sides(number, state, body, body.spaces.displacements.trial)
    pair = state.pairs[number]
    if not opposite:
        assert own is not None
        return own, own_results(own, pair)
    if other is None or other.surface is None:
        raise ValueError(f"opposite = True: what pair {number} faces is no deformable surface")
    return other.surface, other.results(pair)


def _line(
    axes: Axes, surface: SurfaceNodes, side: SideResults, along: int | None, name: str
) -> None:
    pressure, traction = side.pressure, side.traction
    rough, bounds = bool(np.any(side.friction > 0)), rf"$\pm\mu\,\times$ {name}"
    end = 0.0
    for chain in _chains(surface.edges):
        x, normal = surface.position[chain], side.normal[chain]
        onwards = np.gradient(x, axis=0)
        if along is None:
            steps = np.linalg.norm(np.diff(x, axis=0), axis=1)
            where = end + np.append(0.0, np.cumsum(steps))
            end = where[-1]
        else:
            where = x[:, along]
            onwards *= np.sign(onwards[:, along, None])
        tangent = np.column_stack([normal[:, 1], -normal[:, 0]])
        tangent *= np.sign(np.sum(tangent * onwards, axis=1, keepdims=True))
        closed = side.status[chain] != OPEN
        if rough:
            bound = side.friction[chain] * pressure[chain]
            shear = np.sum(traction[chain] * tangent, axis=1)
            sticks, slips = (side.status[chain] == status for status in (STICK, SLIP))
            axes.fill_between(where, -bound, bound, color="0.88", lw=0, label=bounds)
            axes.plot(where, shear, color=_ORANGE, lw=1)
            style: dict[str, Any] = {"color": _ORANGE, "ls": "", "marker": "o", "ms": 4}
            axes.plot(where[sticks], shear[sticks], label="shear, stick", **style)
            axes.plot(where[slips], shear[slips], label="shear, slip", mfc="white", **style)
        axes.plot(where, pressure[chain], color=_BLUE, lw=1)
        axes.plot(where[closed], pressure[chain][closed], ".", color=_BLUE, label=name)
    axes.axhline(0.0, color="0.5", lw=0.5)
    handles, texts = axes.get_legend_handles_labels()
    once = dict(zip(texts, handles, strict=True))
    axes.legend(once.values(), once.keys(), frameon=False)


def _face(axes: Axes, surface: SurfaceNodes, side: SideResults, name: str, unit: str) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.tri import Triangulation

    pressure = side.pressure
    seen = np.delete(np.arange(3), np.abs(side.normal.sum(axis=0)).argmax())
    x, y = surface.position[:, seen].T
    known = np.isfinite(pressure)
    triangles = surface.facets[:, SUB_TRIANGLES[surface.facets.shape[1]]].reshape(-1, 3)
    face, weighed = (Triangulation(x, y, triangles) for _ in range(2))
    weighed.set_mask(~known[triangles].all(axis=1))
    shown = axes.tripcolor(weighed, np.where(known, pressure, 0.0), shading="gouraud", cmap="Blues")
    beside = axes.inset_axes((1.04, 0.0, 0.04, 1.0))  # as tall as the face
    axes.figure.colorbar(shown, cax=beside, label=name + (f" [{unit}]" if unit else ""))
    legend = []
    edges = (((OPEN,), "edge of contact", "--"), ((STICK, HELD), "edge of stick", "-"))
    for statuses, text, style in edges:
        inside = np.isin(side.status, statuses).astype(float)
        if 0 < inside.sum() < len(inside):
            axes.tricontour(face, inside, [0.5], colors="0.2", linestyles=style)
            legend.append(Line2D([], [], color="0.2", ls=style, label=text))
    traction = side.traction[:, seen]
    size = np.linalg.norm(np.nan_to_num(traction), axis=1)
    if np.any(side.friction > 0) and size.max() > 0:
        spacing = np.sqrt(np.ptp(x) * np.ptp(y) / len(x))
        pulled = size > _INVISIBLE * size.max()
        axes.quiver(
            *(x[pulled], y[pulled], *traction[pulled].T),
            color=_ORANGE,
            angles="xy",
            scale_units="xy",
            scale=size.max() / (1.5 * spacing),
        )
        text = f"shear, at most {size.max():.3g} {unit}".rstrip()
        arrow: dict[str, Any] = {"color": _ORANGE, "marker": r"$\rightarrow$", "ms": 12, "ls": ""}
        legend.append(Line2D([], [], label=text, **arrow))
    axes.set(aspect="equal", xlabel="xyz"[seen[0]], ylabel="xyz"[seen[1]])
    if legend:
        axes.legend(
            handles=legend,
            ncols=len(legend),
            frameon=False,
            loc="lower center",
            bbox_to_anchor=(0.5, 1.0),
        )


def _chains(edges: Indices) -> list[Indices]:
    """Nodes of each connected part of a line in their order, corners and mid-side nodes."""
    ends = np.concatenate([edges[:, [1, 0]], edges[:, [0, 2]]]).T
    line = sp.csr_array((np.ones(ends.shape[1]), ends), shape=(ends.max() + 1,) * 2)
    line = line + line.T
    neighbours, (_, part) = np.diff(line.indptr), csgraph.connected_components(line)
    chains = []
    for k in np.unique(part[ends]):
        nodes = np.flatnonzero(part == k)
        # nodes count in the order of their positions: from an end, or anywhere on a closed line
        first = nodes[neighbours[nodes].argmin()]
        chain, _ = csgraph.depth_first_order(line, first)
        chains.append(chain if neighbours[first] == 1 else np.append(chain, first))
    return chains
