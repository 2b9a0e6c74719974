"""Plots of a contact state: pressure and shear along the contact line or on the contact face.

Labels have no units unless the user adds them:

    axes = plot(states[-1], body)
    axes.set(xlabel="x [mm]", ylabel="traction [MPa]")
    axes.figure.savefig("contact.png")

The module guarantees that a plot has the values of `ContactFields`. It assumes that Matplotlib is
installed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse import csgraph

from pw_elements.arrays import Indices
from pw_elements.checks import (
    arguments,
    check_same_arguments_on_all_processes,
    raise_errors_on_all_processes,
)
from pw_elements.contact.model import ContactState
from pw_elements.contact.nodes import HELD, OPEN, SLIP, STICK
from pw_elements.contact.output.fields import check_state_fits_space
from pw_elements.contact.output.sides import (
    ContactSideResults,
    make_own_and_opposite_surface,
    make_results_of_own_side,
)
from pw_elements.elasticity import Body, StressState, SurfaceNodes
from pw_elements.pictures import SUB_TRIANGLE_NODES_BY_NODE_COUNT, check_matplotlib_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes


_PRESSURE_COLOUR = "#0072B2"
_SHEAR_COLOUR = "#D55E00"
# Arrows shorter than this fraction of the longest one are left out
_MIN_ARROW_TO_LONGEST_RATIO = 1e-3


@check_same_arguments_on_all_processes
def plot(
    state: ContactState,
    body: Body,
    pair: int = 0,
    axes: Axes | None = None,
    along: int | None = None,
    opposite: bool = False,
    unit: str = "",
) -> Axes:
    """Plot pressure and shear of one pair with Matplotlib; collective.

    For plane and axisymmetric bodies the curves run along the contact line. They show the pressure
    p, the shear traction on the body in the direction of the line, and the friction bounds ± mu p
    of the shear, with the friction coefficient mu. Markers show the status of each node. In space,
    the undeformed face is viewed along its mean normal. Its colour shows the pressure, arrows show
    shear tractions, and a line surrounds the nodes that stick.

    Pressures are nodal forces divided by the integrals of the nodes' weight functions on the
    undeformed surface (measure 2 of `SurfaceNodes`), in units of the modulus. At large strains
    these pressures are labelled nominal; `ContactFields` has the true pressures.

    Args:
        state: contact state to plot.
        body: body of the contact problem.
        pair: number of the pair, counted from 0.
        axes: Matplotlib axes to plot into; by default the axes of a new figure.
        along: coordinate (0 or 1) for the abscissa of a contact line. By default the abscissa is
            the arc length from the end with the smallest coordinates. Not available for faces in
            space.
        opposite: whether to plot the results of the deformable surface that the pair faces.
        unit: unit of tractions in the labels, such as "MPa".

    Returns:
        The axes. Each process has axes of its own; let one process save the figure.

    Raises:
        TypeError: for arguments of the wrong type.
        ValueError: for a pair, coordinate or opposite surface that does not exist, and whenever
            `ContactFields.from_state` raises it.
    """
    import matplotlib.pyplot as plt

    arguments.check_type("body", body, Body, "pressures need the body's surface measure")
    arguments.check_flag("opposite", opposite)
    arguments.check_type("unit", unit, str, 'it has to be a string, such as "MPa"')
    with raise_errors_on_all_processes(body.spaces.mesh.comm):
        check_matplotlib_axes(axes)
    check_state_fits_space(state, body.spaces.displacements.trial)
    dim = body.spaces.mesh.geometry.dim
    if arguments.check_integer("pair", pair, 0) >= len(state.pairs):
        raise ValueError(f"pair {pair}: the state has {len(state.pairs)} pairs, counted from 0")
    if along is not None and (dim == 3 or arguments.check_integer("along", along, 0) > 1):
        raise ValueError(f"along = {along}: lines in the plane run along coordinate 0 or 1")
    surface, side = _make_surface_and_results_of_side(pair, state, body, opposite)
    axes = plt.subplots(layout="constrained")[1] if axes is None else axes
    name = "pressure" if state.smallness else "nominal pressure"
    if dim == 3:
        _plot_contact_face(axes, surface, side, name, unit)
    else:
        names = "rz" if body.state is StressState.AXISYMMETRIC else "xy"
        _plot_contact_line(axes, surface, side, along, name)
        axes.set(xlabel="arc length" if along is None else names[along])
        axes.set(ylabel=f"traction [{unit}]" if unit else "traction")
    return axes


def _make_surface_and_results_of_side(
    pair_number: int, state: ContactState, body: Body, opposite: bool
) -> tuple[SurfaceNodes, ContactSideResults]:
    """Return the surface nodes and results of a pair's own side, or of its opposite surface."""
    slave, master = make_own_and_opposite_surface(
        pair_number, state, body, body.spaces.displacements.trial
    )
    pair = state.pairs[pair_number]
    if not opposite:
        assert slave is not None
        return slave, make_results_of_own_side(slave, pair)
    if master is None or master.surface is None:
        raise ValueError(f"opposite = True: pair {pair_number} does not face a deformable surface")
    return master.surface, master.results(pair)


def _plot_contact_line(
    axes: Axes,
    surface: SurfaceNodes,
    side: ContactSideResults,
    along: int | None,
    pressure_label: str,
) -> None:
    """Plot pressure, shear and status along a contact line."""
    pressure, traction = side.pressure, side.traction
    has_friction, bounds_label = (
        bool(np.any(side.friction > 0)),
        rf"$\pm\mu\,\times$ {pressure_label}",
    )
    arc_length = 0.0
    for chain in _order_nodes_along_lines(surface.edges):
        position, normal = surface.position[chain], side.normal[chain]
        direction = np.gradient(position, axis=0)
        if along is None:
            lengths = np.linalg.norm(np.diff(position, axis=0), axis=1)
            abscissa = arc_length + np.append(0.0, np.cumsum(lengths))
            arc_length = abscissa[-1]
        else:
            abscissa = position[:, along]
            direction *= np.sign(direction[:, along, None])
        tangent = np.column_stack([normal[:, 1], -normal[:, 0]])
        tangent *= np.sign(np.sum(tangent * direction, axis=1, keepdims=True))
        is_closed = side.status[chain] != OPEN
        if has_friction:
            bound = side.friction[chain] * pressure[chain]
            shear = np.sum(traction[chain] * tangent, axis=1)
            sticks, slips = (side.status[chain] == status for status in (STICK, SLIP))
            axes.fill_between(abscissa, -bound, bound, color="0.88", lw=0, label=bounds_label)
            axes.plot(abscissa, shear, color=_SHEAR_COLOUR, lw=1)
            style: dict[str, Any] = {"color": _SHEAR_COLOUR, "ls": "", "marker": "o", "ms": 4}
            axes.plot(abscissa[sticks], shear[sticks], label="shear, stick", **style)
            axes.plot(abscissa[slips], shear[slips], label="shear, slip", mfc="white", **style)
        axes.plot(abscissa, pressure[chain], color=_PRESSURE_COLOUR, lw=1)
        axes.plot(
            abscissa[is_closed],
            pressure[chain][is_closed],
            ".",
            color=_PRESSURE_COLOUR,
            label=pressure_label,
        )
    axes.axhline(0.0, color="0.5", lw=0.5)
    handles, texts = axes.get_legend_handles_labels()
    handle_of_text = dict(zip(texts, handles, strict=True))
    axes.legend(handle_of_text.values(), handle_of_text.keys(), frameon=False)


def _plot_contact_face(
    axes: Axes, surface: SurfaceNodes, side: ContactSideResults, pressure_label: str, unit: str
) -> None:
    """Plot pressure, shear and the edges of the contact and stick regions on a contact face."""
    from matplotlib.lines import Line2D
    from matplotlib.tri import Triangulation

    pressure = side.pressure
    plotted_axes = np.delete(np.arange(3), np.abs(side.normal.sum(axis=0)).argmax())
    x, y = surface.position[:, plotted_axes].T
    has_pressure = np.isfinite(pressure)
    triangles = surface.facets[
        :, SUB_TRIANGLE_NODES_BY_NODE_COUNT[surface.facets.shape[1]]
    ].reshape(-1, 3)
    face, pressure_face = (Triangulation(x, y, triangles) for _ in range(2))
    pressure_face.set_mask(~has_pressure[triangles].all(axis=1))
    colours = axes.tripcolor(
        pressure_face, np.where(has_pressure, pressure, 0.0), shading="gouraud", cmap="Blues"
    )
    colour_bar = axes.inset_axes((1.04, 0.0, 0.04, 1.0))  # as high as the face
    axes.figure.colorbar(
        colours, cax=colour_bar, label=pressure_label + (f" [{unit}]" if unit else "")
    )
    legend = []
    edges = (((OPEN,), "edge of contact", "--"), ((STICK, HELD), "edge of stick", "-"))
    for statuses, text, style in edges:
        is_inside = np.isin(side.status, statuses).astype(float)
        if 0 < is_inside.sum() < len(is_inside):
            axes.tricontour(face, is_inside, [0.5], colors="0.2", linestyles=style)
            legend.append(Line2D([], [], color="0.2", ls=style, label=text))
    traction = side.traction[:, plotted_axes]
    shear_size = np.linalg.norm(np.nan_to_num(traction), axis=1)
    if np.any(side.friction > 0) and shear_size.max() > 0:
        spacing = np.sqrt(np.ptp(x) * np.ptp(y) / len(x))
        has_arrow = shear_size > _MIN_ARROW_TO_LONGEST_RATIO * shear_size.max()
        axes.quiver(
            *(x[has_arrow], y[has_arrow], *traction[has_arrow].T),
            color=_SHEAR_COLOUR,
            angles="xy",
            scale_units="xy",
            scale=shear_size.max() / (1.5 * spacing),
        )
        text = f"shear, at most {shear_size.max():.3g} {unit}".rstrip()
        arrow: dict[str, Any] = {
            "color": _SHEAR_COLOUR,
            "marker": r"$\rightarrow$",
            "ms": 12,
            "ls": "",
        }
        legend.append(Line2D([], [], label=text, **arrow))
    axes.set(aspect="equal", xlabel="xyz"[plotted_axes[0]], ylabel="xyz"[plotted_axes[1]])
    if legend:
        axes.legend(
            handles=legend,
            ncols=len(legend),
            frameon=False,
            loc="lower center",
            bbox_to_anchor=(0.5, 1.0),
        )


def _order_nodes_along_lines(edges: Indices) -> list[Indices]:
    """Return the nodes of each connected part of a line, in their order along the line.

    Args:
        edges: node numbers (edges, 3) of each edge: both ends and the mid-side node.

    Returns:
        For each part, the numbers of its nodes. For a closed line, the first number is repeated at
        the end.
    """
    segments = np.concatenate([edges[:, [1, 0]], edges[:, [0, 2]]]).T
    graph = sp.csr_array((np.ones(segments.shape[1]), segments), shape=(segments.max() + 1,) * 2)
    graph = graph + graph.T
    n_neighbours, (_, part_of_node) = (
        np.diff(graph.indptr),
        csgraph.connected_components(graph),
    )
    chains = []
    for part in np.unique(part_of_node[segments]):
        nodes = np.flatnonzero(part_of_node == part)
        # nodes are sorted by position: start at the first end, or at any node of a closed line
        start = nodes[n_neighbours[nodes].argmin()]
        chain, _ = csgraph.depth_first_order(graph, start)
        chains.append(chain if n_neighbours[start] == 1 else np.append(chain, start))
    return chains
