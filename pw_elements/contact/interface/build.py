"""Interfaces whose points are nodes: against rigid surfaces, and between matching nodes."""

from collections.abc import Callable, Sequence

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from dolfinx import fem

from pw_elements.algebra import Reduction
from pw_elements.checks import answer, collective, field, is_number
from pw_elements.contact.interface.mortar import mortar_points
from pw_elements.contact.interface.nodes import BodyNodes, opposite_nodes, owned_nodes
from pw_elements.contact.interface.operators import RIGID, Interface, Points
from pw_elements.contact.model import (
    Cone,
    ContactPair,
    DeformableSurface,
    MatchingNodes,
    Surface,
)
from pw_elements.elasticity import StressState
from pw_elements.spaces import Assembled, is_hybrid

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

# What surfaces have one component of per dimension
_VECTORS = ("point", "direction", "apex", "centre")


def nodal_interface(
    pairs: Sequence[ContactPair],
    space: fem.FunctionSpace,
    reduction: Reduction,
    known: Assembled | None = None,
) -> Interface:
    """Contact points of pairs, and checks of what can be checked before any computation.

    What is `known` of the stiffness tells whether areas are those of a circumference, and whether
    the unknowns are a sibling's coefficients; gaps are theirs then.

    Raises:
        ValueError: for no nodes, a node that does not exist, lies inside of the body, is in two
            pairs or without counterpart, friction that is negative or not a number, a prescribed
            normal displacement, a surface of another dimension, without gap or unit normal at a
            node, or one that cuts the body.
    """
    dim = space.mesh.geometry.dim
    if not is_hybrid(space) and space.dofmap.index_map_bs != dim:
        raise ValueError("contact is stated on displacements: the space has to be a vector's")
    if not pairs:
        raise ValueError("there is no contact pair")
    shapes: list[Surface] = [
        p.surface.shape if isinstance(p.surface, MatchingNodes) else p.surface  # type: ignore[misc]
        for p in pairs
    ]
    for k, shape in enumerate(shapes):
        _check_dimension(k, shape, dim)
    body = BodyNodes.of(space, reduction)
    found = [
        owned_nodes(f"contact pair {k}", pair.nodes, body.space) for k, pair in enumerate(pairs)
    ]
    with collective(space.mesh.comm):
        cones = [
            _cone(space.mesh.comm, k, pair, body.x[node])
            for k, (pair, node) in enumerate(zip(pairs, found, strict=True))
        ]
    points, faced = [], []
    for k, (pair, node, cone) in enumerate(zip(pairs, found, cones, strict=True)):
        opposite = None
        if isinstance(pair.surface, DeformableSurface):
            revolved = _revolved(k, pair.surface, known or Assembled(), dim)
            depth = _depth(space.mesh.comm, k, pair, body.x[node])
            of_pair, shapes[k] = mortar_points(k, pair, node, cone, body, revolved, depth)
            points.append(of_pair)
            continue
        if isinstance(pair.surface, MatchingNodes):
            whose = f"contact pair {k}, opposite side"
            faced.append(owned_nodes(whose, pair.surface.nodes, body.space))
            opposite = opposite_nodes(k, pair.surface, node, faced[-1], cone.rough, body)
        points.append(_points(body, node, cone, opposite))
    interfering = [pair.interference is not False for pair in pairs]
    inverse = None if known is None or known.sibling is None else known.sibling.inverse
    interface = Interface(points, shapes, body.field, interfering, inverse)
    _check_nodes(body, np.concatenate([*found, *faced]))
    interface.check(body.diagonal)
    return interface


def _points(
    body: BodyNodes, node: npt.NDArray[np.int32], cone: Cone, opposite: Indices | None
) -> Points:
    """Points at owned nodes; `opposite` has the global numbers of the nodes that they face."""
    dim = body.x.shape[1]
    own = (node + body.space.dofmap.index_map.local_range[0]).astype(np.int64)
    ends = [(own, 1.0)] + ([] if opposite is None else [(opposite, -1.0)])
    dofs = [(end[:, None] * dim + np.arange(dim)).ravel() for end, _ in ends]
    value = np.repeat([sign for _, sign in ends], len(node) * dim)
    row = np.tile(np.arange(len(node) * dim), len(ends))
    shape = (len(node) * dim, body.field.sizes[1])
    motion = sp.csr_matrix((value, (row, np.concatenate(dofs))), shape)
    return Points(
        body.x[node],
        cone,
        body.column[node],
        motion,
        motion,
        body.beside[node],
        body.outward[node],
        own,
        np.full_like(own, RIGID) if opposite is None else opposite,
        np.zeros(len(node)),
    )


def _check_nodes(body: BodyNodes, node: npt.NDArray[np.int32]) -> None:
    unique, times = np.unique(node, return_counts=True)
    body.refuse(unique[times > 1], "belong to two contact pairs")
    body.refuse(node[~body.on_boundary[node]], "lie inside of the body, not on its boundary")
    with collective(body.space.mesh.comm):
        if np.any(body.column[node] < -1):
            raise ValueError(
                "the reduction combines the displacements of a contact node with others: it may "
                "prescribe them or keep them"
            )


def _check_dimension(number: int, surface: Surface, dim: int) -> None:
    vectors = {name: getattr(surface, name, None) for name in _VECTORS}
    for name, vector in vectors.items():
        if vector is not None and (size := np.size(vector)) != dim:
            raise ValueError(
                f"contact pair {number}: the {name} of its surface has {size} components in {dim}-D"
            )


def _cone(comm: MPI.Comm, number: int, pair: ContactPair, x: Array) -> Cone:
    """What the law of friction says at positions (n, dim); local, for use under the guard."""
    whose = f"the friction of contact pair {number}"
    return Cone([pair.law], [_at_nodes(comm, whose, pair.law.at, x)])


def _depth(comm: MPI.Comm, number: int, pair: ContactPair, x: Array) -> Array | None:
    """The nominal interference (n,) at positions (n, dim); None where sides do not coincide."""
    depth = pair.interference
    if not getattr(pair.surface, "coincident", False):
        return None
    if not callable(depth):
        return np.full(len(x), float(depth))
    with collective(comm):
        return _at_nodes(comm, f"the interference of contact pair {number}", depth, x)


def _at_nodes(
    comm: MPI.Comm, whose: str, function: Callable[[Array], Array | float], x: Array
) -> Array:
    """What a user's function says at positions (n, dim); local, for use under the guard."""
    points = np.zeros((3, len(x)))
    points[: x.shape[1]] = x.T
    given = answer(comm, whose, function, points) if len(x) else points[0]
    if is_number(given):  # the same everywhere
        given = np.full(len(x), given, dtype=float)
    layout = "it takes points as columns (3, n) and gives (n,)"
    return field(whose, given, (len(x),), layout)


def _revolved(number: int, master: DeformableSurface, known: Assembled, dim: int) -> bool:
    """Whether areas are those of a circumference, by what is known of the stiffness if it is."""
    axisymmetric = StressState.AXISYMMETRIC.value in known.states
    if dim == 2 and not known.states and master.revolved is None:
        raise ValueError(
            f"contact pair {number}: the stiffness does not tell whether it is axisymmetric, as "
            "that of a Body does; give DeformableSurface(..., revolved=True or False)"
        )
    if known.states and master.revolved not in (None, axisymmetric):
        raise ValueError(
            f"contact pair {number}: its surface is said to be revolved={master.revolved}, but the "
            f"stiffness is one in {' and '.join(sorted(known.states))}"
        )
    return bool(axisymmetric or master.revolved)
