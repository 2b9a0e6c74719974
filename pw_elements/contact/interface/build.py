"""Construction of the contact interface from the user's contact pairs.

The other side of a pair may be a rigid surface, matching nodes of another body, or facets of
another body that are coupled by mortar integrals. The module guarantees that pairs, supports and
surfaces have been checked, and that user functions give the same values on all processes. All
functions except `_is_axisymmetric` are collective.
"""

import logging
from collections.abc import Callable, Sequence

from mpi4py import MPI

import numpy as np
from dolfinx import fem

from pw_elements.algebra import Reduction
from pw_elements.arrays import Array, LocalIndices
from pw_elements.checks import (
    arguments,
    call_user_function,
    format_points,
    list_bodies,
    raise_errors_on_all_processes,
)
from pw_elements.contact.interface.mortars import SlidingMortar
from pw_elements.contact.interface.operators import ContactInterface
from pw_elements.contact.interface.pair_points import (
    FACED_INDEX_OF_RIGID_SURFACE,
    BodyNodes,
    gather_points_and_local_slice,
    make_contact_points_at_nodes,
    make_large_sliding_mortar_points,
    make_small_sliding_mortar_points,
    match_opposite_nodes,
)
from pw_elements.contact.interface.probes import check_pairs_are_equal_on_all_processes
from pw_elements.contact.interface.shared_nodes import MIN_DEGREES_BETWEEN_NORMALS
from pw_elements.contact.model import (
    MAX_RELATIVE_GRADIENT_CHANGE_AT_HALF_STEP,
    ContactPair,
    DeformableSurface,
    FrictionCone,
    MatchingNodes,
    SignedDistance,
    Surface,
    measure_gradient_change_at_half_step,
    with_default_difference_step,
)
from pw_elements.elasticity import (
    StressState,
    exterior_facets_of_bodies_with_all_nodes,
    facet_nodes,
    mark_boundary_nodes,
)
from pw_elements.progress import log_on_root
from pw_elements.spaces import (
    AssemblyRecord,
    is_hybrid,
)

# Largest difference between the gaps of a node to two surfaces with the same normal that counts as
# zero, relative to the body's diagonal
_MAX_GAP_DIFFERENCE_PER_BODY_DIAGONAL = 1e-6
# Attributes of surfaces that are vectors (dim,)
_SURFACE_VECTOR_ATTRIBUTES = ("point", "direction", "apex", "centre")


def build_interface(
    pairs: Sequence[ContactPair],
    space: fem.FunctionSpace,
    reduction: Reduction,
    assembly: AssemblyRecord | None = None,
    large_sliding: bool = False,
) -> ContactInterface:
    """Build and check the interface of contact pairs; collective.

    All conditions that can be checked before the first increment are checked here.

    Args:
        pairs: contact pairs, as given by the user.
        space: space of all unknowns.
        reduction: supports of the body.
        assembly: record of how the stiffness was assembled; None if there is no record. It says
            whether the body is axisymmetric, so that areas are those of the whole circumference,
            and whether the unknowns are coefficients of the symmetric sibling element, so that gaps
            have to be transformed to its basis.
        large_sliding: whether two bodies may slide on each other over large distances. Mortar
            integrals are then evaluated at the deformed positions.

    Raises:
        ValueError: for pairs, supports or surfaces that do not define a contact problem.
    """
    dim = space.mesh.geometry.dim
    if not is_hybrid(space) and space.dofmap.index_map_bs != dim:
        raise ValueError("contact is stated on displacements: the space has to be one of vectors")
    if not pairs:
        raise ValueError("there is no contact pair")
    shapes: list[Surface] = [
        p.surface.shape if isinstance(p.surface, MatchingNodes) else p.surface  # type: ignore[misc]
        for p in pairs
    ]
    max_coordinate = np.abs(space.mesh.geometry.x).max(initial=0.0)
    max_coordinate = space.mesh.comm.allreduce(max_coordinate, MPI.MAX)
    shapes = [with_default_difference_step(shape, max_coordinate) for shape in shapes]
    for k, (shape, pair) in enumerate(zip(shapes, pairs, strict=True)):
        vectors = {
            f"the {name} of its surface": getattr(shape, name, None)
            for name in _SURFACE_VECTOR_ATTRIBUTES
        }
        for name, vector in {**vectors, "its pivot": pair.pivot}.items():
            if vector is not None and (size := np.size(vector)) != dim:
                raise ValueError(f"contact pair {k}: {name} has {size} components in {dim}-D")
        if pair.pivot is not None and not large_sliding:
            raise ValueError(
                f"contact pair {k} has a pivot, but surfaces rotate at large sliding only: use "
                "ContactProblem.of_residual"
            )
    body = BodyNodes(space, reduction)
    names = [f"contact pair {k}" for k in range(len(pairs))]
    nodes = [
        body.find_owned_nodes(name, pair.nodes) for name, pair in zip(names, pairs, strict=True)
    ]
    for name, node in zip(names, nodes, strict=True):
        _warn_of_nodes_without_facet(name, node, body)
    comm = space.mesh.comm
    cones = _evaluate_friction_of_each_pair(comm, pairs, [body.x[node] for node in nodes])
    body.mark_axis_nodes(assembly)
    points, opposite_nodes = [], []
    mortars: dict[int, SlidingMortar] = {}
    for k, (pair, node, cone) in enumerate(zip(pairs, nodes, cones, strict=True)):
        if isinstance(pair.surface, DeformableSurface):
            revolved = _is_axisymmetric(k, pair.surface, assembly or AssemblyRecord(), dim)
            if large_sliding:
                pair_points, shapes[k], mortars[k] = make_large_sliding_mortar_points(
                    k, pair, node, cone, body, revolved
                )
            else:
                depth = _evaluate_nominal_interference_if_coincident(comm, k, pair, body.x[node])
                pair_points, shapes[k] = make_small_sliding_mortar_points(
                    k, pair, node, cone, body, revolved, depth
                )
        elif isinstance(pair.surface, MatchingNodes):
            opposite = body.find_owned_nodes(f"contact pair {k}, opposite side", pair.surface.nodes)
            opposite_nodes.append(opposite)
            matched = match_opposite_nodes(k, pair.surface, node, opposite, cone.has_friction, body)
            pair_points = make_contact_points_at_nodes(body, node, cone, matched)
        else:
            pair_points = make_contact_points_at_nodes(body, node, cone, None)
        points.append(pair_points)
    allows_interference = [pair.interference is not False for pair in pairs]
    inverse = None if assembly is None or assembly.sibling is None else assembly.sibling.inverse
    interface = ContactInterface(
        points, shapes, body.displacements, allows_interference, inverse, mortars
    )
    _raise_error_for_interior_or_tied_nodes(body, np.concatenate([*nodes, *opposite_nodes]))
    _raise_error_for_shared_opposite_nodes(body, nodes, opposite_nodes)
    interface.check_laws_supports_and_initial_gaps(body.diagonal)
    _check_shared_nodes(interface, pairs, body.diagonal, is_sibling=inverse is not None)
    check_pairs_are_equal_on_all_processes(interface, pairs, shapes)
    _warn_of_large_finite_difference_steps(interface)
    return interface


def build_interface_with_other_friction(
    interface: ContactInterface, pairs: Sequence[ContactPair]
) -> ContactInterface | None:
    """Return an interface with the friction of other pairs that shares all else; collective.

    The result is None if points get or lose friction between two bodies, where friction also
    determines which supports are allowed: the interface then has to be built anew.

    Args:
        interface: interface that `build_interface` has returned.
        pairs: pairs that differ from those of the interface in their friction only.

    Raises:
        ValueError: for an invalid law, or laws that differ between processes.
    """
    positions = [interface.position[interface.pair == k] for k in range(interface.pairs)]
    changed = interface.with_friction(
        _evaluate_friction_of_each_pair(interface.comm, pairs, positions)
    )
    faces_body = interface.faced != FACED_INDEX_OF_RIGID_SURFACE
    differs = (changed.cone.has_friction != interface.cone.has_friction) & faces_body
    if interface.mortars or interface.comm.allreduce(bool(differs.any()), MPI.LOR):
        return None
    check_pairs_are_equal_on_all_processes(changed, pairs, changed.surfaces)
    return changed


def _evaluate_friction_of_each_pair(
    comm: MPI.Comm, pairs: Sequence[ContactPair], positions: Sequence[Array]
) -> list[FrictionCone]:
    """Return the friction law of each pair with its parameters at the pair's points; collective.

    Args:
        comm: communicator of the processes.
        pairs: contact pairs.
        positions: positions (k, dim) of this process' points of each pair.
    """
    cones = []
    for k, (pair, x) in enumerate(zip(pairs, positions, strict=True)):
        name = f"the friction of contact pair {k}"
        parameter = _evaluate_user_function_at_gathered_points(comm, name, pair.law.parameter_at, x)
        cones.append(FrictionCone([pair.law], [parameter]))
    return cones


def _warn_of_large_finite_difference_steps(interface: ContactInterface) -> None:
    """Log a warning for each `SignedDistance` whose difference step is too large; collective."""
    comm = interface.comm
    for k, surface in enumerate(interface.surfaces):
        if not isinstance(surface, SignedDistance):
            continue
        x = interface.gather_values(interface.position[interface.pair == k])
        with raise_errors_on_all_processes(comm):
            error = call_user_function(
                comm,
                f"the surface of contact pair {k}",
                measure_gradient_change_at_half_step,
                surface,
                x,
            )
        if error > MAX_RELATIVE_GRADIENT_CHANGE_AT_HALF_STEP:
            words = (
                f"contact pair {k}: halving the step of differences, {surface.step:.3g}, changes "
                f"the gradient of its SignedDistance by {error:.1e} of its size, and gaps and "
                "normals likewise. Give a smaller step (a small part of the smallest radius), no "
                "step, or the gradient"
            )
            log_on_root(comm, logging.WARNING, words, ".contact")


def _warn_of_nodes_without_facet(pair_name: str, nodes: LocalIndices, body: BodyNodes) -> None:
    """Log a warning for nodes of a pair that belong to none of its facets; collective.

    Such nodes have no pressure. Functions that write or plot pressures would reject the states, but
    only after the computation.
    """
    comm, index_map = body.space.mesh.comm, body.space.dofmap.index_map
    pair_nodes = np.concatenate(comm.allgather(index_map.local_to_global(nodes)))
    facets_of_bodies = exterior_facets_of_bodies_with_all_nodes(body.space, pair_nodes)
    on_facets = np.concatenate(
        [
            part.nodes[facet_nodes(part.space, facets)].ravel()
            for part, facets in zip(list_bodies(body.space), facets_of_bodies, strict=True)
        ]
    )
    on_facets = np.concatenate(comm.allgather(index_map.local_to_global(np.unique(on_facets))))
    isolated = body.x[nodes[~np.isin(index_map.local_to_global(nodes), on_facets)]]
    positions = np.concatenate(comm.allgather(isolated))
    if len(positions):
        words = (
            f"{pair_name}: its nodes at {format_points(positions)} belong to no facet that has all "
            "of its nodes in the pair: they may bear forces, but have no pressure, and "
            "ContactFields, write and plot will refuse the states. Let the pair end at vertices"
        )
        log_on_root(comm, logging.WARNING, words, ".contact")


def _raise_error_for_shared_opposite_nodes(
    body: BodyNodes, nodes: Sequence[LocalIndices], opposite_nodes: Sequence[LocalIndices]
) -> None:
    """Raise ValueError if a matching opposite node belongs to another side as well; collective.

    Args:
        body: nodes of the body.
        nodes: own nodes of each pair.
        opposite_nodes: opposite nodes of each pair with matching nodes.
    """
    own, opposite = (
        np.concatenate([np.empty(0, dtype=np.int64), *sides]) for sides in (nodes, opposite_nodes)
    )
    unique, count = np.unique(opposite, return_counts=True)
    body.raise_error_for_invalid_nodes(
        np.union1d(unique[count > 1], np.intersect1d(unique, own)).astype(np.int64),
        "belong to two contact pairs, as opposite nodes of one of them: leave a facet between them",
    )


def _check_shared_nodes(
    interface: ContactInterface,
    pairs: Sequence[ContactPair],
    body_diagonal: float,
    *,
    is_sibling: bool,
) -> None:
    """Check pairs with common nodes; collective.

    Pairs with an interface law may have equal surfaces, like springs in parallel.

    Args:
        interface: contact points of all pairs.
        pairs: contact pairs, as given by the user.
        body_diagonal: diagonal of the body's bounding box, to which gaps are compared.
        is_sibling: whether the unknowns are coefficients of the symmetric sibling element.

    Raises:
        ValueError: if forces at common nodes are not determined, or for the sibling element.
    """
    shared = interface.shared_nodes
    if not shared.exist:
        return
    interface.raise_error_for_invalid_points(
        shared.is_shared & is_sibling,
        "belong to two contact pairs, which the symmetric sibling element does not support: leave "
        "a facet between them",
    )
    gap, normal = interface.evaluate_undeformed_gaps_and_normals(None)
    has_law = np.array([pair.interface_law is not None for pair in pairs])[interface.pair]
    same = shared.find_points_on_equal_surfaces(
        np.where(has_law, np.inf, gap),
        normal,
        _MAX_GAP_DIFFERENCE_PER_BODY_DIAGONAL * body_diagonal,
    )
    interface.raise_error_for_invalid_points(
        same,
        "belong to two contact pairs whose surfaces have the same gap and, to within "
        f"{MIN_DEGREES_BETWEEN_NORMALS:g} degree, the same normal there: how they share the force "
        "is not determined; let each of these nodes belong to one of the pairs",
    )


def _raise_error_for_interior_or_tied_nodes(body: BodyNodes, nodes: LocalIndices) -> None:
    """Raise ValueError if any of the given nodes cannot be a contact node; collective.

    A node cannot be a contact node if it lies inside the body, or has a displacement that the
    reduction combines with others. `nodes` are the nodes of all pairs, including matching opposite
    nodes.
    """
    inside = nodes[~mark_boundary_nodes(body.space)[nodes]]
    body.raise_error_for_invalid_nodes(inside, "lie inside of the body, not on its boundary")
    with raise_errors_on_all_processes(body.space.mesh.comm):
        if np.any(body.reduced_column[nodes] < -1):
            raise ValueError(
                "the reduction combines the displacements of a contact node with others: it may "
                "only prescribe them or leave them free"
            )


def _evaluate_nominal_interference_if_coincident(
    comm: MPI.Comm, pair_index: int, pair: ContactPair, x: Array
) -> Array | None:
    """Return the nominal interference (n,) of a pair at positions x (n, dim).

    The result is None unless the pair's surface is declared `coincident`.
    """
    depth = pair.interference
    if not getattr(pair.surface, "coincident", False):
        return None
    if not arguments.is_user_function(depth):
        return np.full(len(x), float(depth))  # type: ignore[arg-type]
    return _evaluate_user_function_at_gathered_points(
        comm, f"the interference of contact pair {pair_index}", depth, x
    )


def _evaluate_user_function_at_gathered_points(
    comm: MPI.Comm, name_in_messages: str, function: Callable[[Array], Array | float], x: Array
) -> Array:
    """Return the values (n,) of a user's function at positions x (n, dim); collective.

    Each process evaluates the function at the points of all processes and keeps the values at its
    own points. All processes therefore call the function equally often. `name_in_messages` is the
    name of the function in error messages.
    """
    all_x, owned = gather_points_and_local_slice(comm, x)
    points = np.zeros((3, len(all_x)))
    points[: x.shape[1]] = all_x.T
    layout = "it takes points as columns (3, n) and gives (n,)"
    with raise_errors_on_all_processes(comm):
        values = (
            call_user_function(comm, name_in_messages, function, points)
            if len(all_x)
            else points[0]
        )
        if arguments.is_real_number(values):  # the function is constant
            values = np.full(len(all_x), values, dtype=float)
        return arguments.check_user_function_values(
            name_in_messages, values, (len(all_x),), layout
        )[owned]


def _is_axisymmetric(
    pair_index: int, master: DeformableSurface, assembly: AssemblyRecord, dim: int
) -> bool:
    """Return whether the areas of a pair are those of the whole circumference.

    The stress state in the record of the stiffness determines the result. If the record has no
    stress state, the result is given by `master.revolved`.

    Args:
        pair_index: index of the pair, used in error messages.
        master: deformable surface of the pair.
        assembly: record of how the stiffness was assembled.
        dim: dimension of space.

    Raises:
        ValueError: if the record has no stress state and `master.revolved` is not given in 2-D, or
            if the two contradict each other.
    """
    axisymmetric = StressState.AXISYMMETRIC.value in assembly.stress_states
    if dim == 2 and not assembly.stress_states and master.revolved is None:
        raise ValueError(
            f"contact pair {pair_index}: the stiffness has no record of whether it is "
            "axisymmetric, "
            "unlike that of a Body; give DeformableSurface(..., revolved=True or False)"
        )
    if assembly.stress_states and master.revolved not in (None, axisymmetric):
        raise ValueError(
            f"contact pair {pair_index}: its surface has revolved={master.revolved}, but the "
            "stiffness "
            f"is one in {' and '.join(sorted(assembly.stress_states))}"
        )
    return bool(axisymmetric or master.revolved)
