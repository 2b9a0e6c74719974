"""Refusal of increments that drive bodies, or a tool and a body, through each other.

Supports and prescribed tools have known ways. Where one is led through the other no state is worth
looking for; and where two bodies have passed each other in one step, what is found is none.
"""

from collections.abc import Mapping

from mpi4py import MPI

import numpy as np

from pw_elements.arrays import Array, Mask
from pw_elements.checks import collective, listed
from pw_elements.contact.interface import Interface, SlidingReference
from pw_elements.contact.iteration import Tools
from pw_elements.contact.model import SurfacePassed

# Depth of a support within a tool, and of a side within another one, over the extent of the side,
# by which it has been driven through; and the offset along the side up to which it still meets it
_SUPPORT_DEPTH, _DEPTH, _OFFSET = 0.1, 0.25, 0.5


def refuse_tools_through_supports(
    interface: Interface, tools: Tools, positions: Array, fixed: Mask, ways: Array, paths: Array
) -> None:
    """Raise SurfacePassed if a rigid surface is led through nodes that are held.

    Args:
        interface: the contact points.
        tools: their surfaces.
        positions: (n, dim), undeformed, of nodes of this process.
        fixed: (n,), whether all components of a node are prescribed.
        ways: (samples, pairs, dim + 1), placements of the surfaces; NaN where they are free.
        paths: (samples, n, dim), prescribed displacements.
    """
    for k, surface in enumerate(interface.surfaces):
        if k in interface.mortars or np.isnan(ways[:, k]).any():
            continue
        within = [
            tools.see_from_surface(k, ways[j, k], positions[fixed] + paths[j][fixed])
            for j in range(len(ways))
        ]
        count, other = int(fixed.sum()), interface.first_nodes[k]
        with collective(interface.comm), np.errstate(all="ignore"):
            asked = [surface.gap(x if count else other) for x in within]
            gaps: Array = np.array([np.asarray(one, dtype=float)[:count] for one in asked])
        gaps = np.where(np.isnan(gaps), np.inf, gaps)
        deep = gaps.min(axis=0, initial=np.inf) < -_SUPPORT_DEPTH * _extent(interface, k)
        places = interface.gathered(positions[fixed][deep & (gaps[0] > 0)])
        if len(places):
            raise SurfacePassed(
                f"the motion of the surface of contact pair {k} leads it through the supports at "
                f"{listed(places)}: it passes through the body; end it before"
            )


def refuse_supports_through_each_other(
    interface: Interface,
    references: Mapping[int, SlidingReference],
    positions: Array,
    fixed: Mask,
    paths: Array,
) -> None:
    """Raise SurfacePassed if supports of two bodies, which face each other, change sides.

    Args:
        interface: the contact points.
        references: of pairs of bodies, at the start.
        positions: (n, dim), undeformed, of nodes of this process.
        fixed: (n,), whether all components of a node are prescribed.
        paths: (samples, n, dim), prescribed displacements, the first ones at the start.
    """
    comm = interface.comm
    for k, reference in references.items():
        if not reference.faced.any():
            continue
        slaves = reference.x[: len(reference.faced)][reference.faced]
        tangent = reference.tangents[reference.faced].mean(axis=0)
        tangent /= max(float(np.linalg.norm(tangent)), np.finfo(float).tiny)
        normal = np.array([tangent[1], -tangent[0]])
        start = positions[fixed] + paths[0][fixed]
        above = (start - slaves.mean(axis=0)) @ normal > 0
        means = []
        for side in (above, ~above):
            total = comm.allreduce(np.sum((positions + paths)[:, fixed][:, side], axis=1), MPI.SUM)
            count = comm.allreduce(int(side.sum()), MPI.SUM)
            means.append(total / max(count, 1))
            if not count:
                break
        else:
            apart = means[0] - means[1]  # (samples, dim)
            offset = np.abs((apart - apart[0]) @ tangent)
            extent = _extent(interface, k)
            through = (apart @ normal < 0) & (offset < _OFFSET * extent)
            if through.any():
                raise SurfacePassed(
                    f"the supports of both bodies of contact pair {k} pass each other by "
                    f"{-float((apart @ normal).min()):.3g}: the bodies are driven through each "
                    "other; end the motion before"
                )


def find_passed(interface: Interface, pair: int, start: Array, end: Array) -> Array:
    """Return undeformed positions (p, dim) of slave nodes that go through the master's side.

    On the straight path between positions (n, dim) of both sides, deeper than part of their extent.
    """
    mortar = interface.mortars[pair]
    depth = mortar.measure_depth(start, end)
    return np.asarray(mortar.x[: mortar.slaves][depth > _DEPTH * _extent(interface, pair)])


def _extent(interface: Interface, pair: int) -> float:
    """Return the largest extent of a pair's contact nodes, or of the smaller side of two bodies."""
    sides = [interface.in_order(pair, interface.position)]
    if pair in interface.mortars:
        mortar = interface.mortars[pair]
        sides = [mortar.x[: mortar.slaves], mortar.x[mortar.slaves :]]
    return min(float(np.ptp(side, axis=0).max()) for side in sides)
