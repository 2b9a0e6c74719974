"""Check whether a refused problem's rigid velocity proves that it has no equilibrium.

The check uses the problem's data: positions, stiffness matrix K, loads, supports and pairs. From
the library it uses nothing but the velocity in the error. This velocity is a proof if

- each node moves rigidly with its connected body, K^T of the motion is zero, and supports rest,
- loads and forces on free surfaces do positive work,
- at every node that a surface faces, the gap opens at least mu times as fast as the node slides
  along the surface; then no contact force in Coulomb's cone does negative work.

The normals of a surface that is free to move must not change with its position. They are sampled at
many positions.
"""

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from pw_elements.contact import ContactPair, NoEquilibrium
from pw_elements.contact.model import MatchingNodes
from tests.contact.residuals import contact_nodes_and_friction, prescribed_mask_and_displacements
from tests.oracle.search import LinearIncrement

Array = npt.NDArray[np.float64]


def measure_proof_defects(problem, increment: int, error: NoEquilibrium) -> dict[str, float]:
    """Return, by name, how much the conditions of a proof are violated (on one process only).

    The forces K^T v ("strain"), the motion of supports and the violation of cones are relative to
    the largest ones that velocities of this size could cause. "turning" is the change of normals.
    "work" is not a violation: it is the work of the loads, divided by the sum of the magnitudes of
    its terms, and has to be positive.
    """
    space = problem.space
    dim = space.mesh.geometry.dim
    x = space.tabulate_dof_coordinates()[:, :dim]
    v = node_velocities(space, error)
    prescribed_mask, _ = prescribed_mask_and_displacements(problem.conditions, len(x), dim)
    speed = np.linalg.norm(v, axis=1).max()
    surfaces = error.velocity.surface
    speed = max(speed, np.abs(surfaces).max())
    image, mode = problem.K.createVecLeft(), problem.K.createVecRight()
    mode.setArray(np.where(prescribed_mask, 0.0, v).ravel())
    problem.K.multTranspose(mode, image)
    load = problem.loads[increment].array_r
    work, work_magnitude = load @ v.ravel(), np.abs(load) @ np.abs(v.ravel())
    defects = {
        "strain": np.abs(image.array_r).max() / np.abs(problem.K.getValuesCSR()[2]).max() / speed,
        "supports": np.abs(np.where(prescribed_mask, v, 0.0)).max() / speed,
        "cones": 0.0,
        "turning": 0.0,
    }
    for k, pair in enumerate(problem.pairs):
        motion = pair.motions[increment] if pair.motions else None
        translation, free = np.zeros(dim), np.zeros(dim, dtype=bool)
        if motion is not None:
            free = np.array([u is None for u in motion.translation])
            translation = np.array([0.0 if u is None else u for u in motion.translation])
            forces = np.zeros(dim) if motion.force is None else np.array(motion.force)
            work += np.where(free, forces, 0.0) @ surfaces[k]
            work_magnitude += np.abs(np.where(free, forces, 0.0)) @ np.abs(surfaces[k])
        defects["supports"] = max(
            defects["supports"], np.abs(surfaces[k][~free]).max(initial=0.0) / speed
        )
        defects["cones"] = max(
            defects["cones"],
            _largest_velocity_cone_violation(
                pair, space, translation, free, v, surfaces[k], prescribed_mask
            )
            / speed,
        )
        if free.any() and _largest_relative_velocity(pair, space, v, surfaces[k]) > 1e-9 * speed:
            defects["turning"] = max(
                defects["turning"], _largest_normal_change(pair, x, translation, free)
            )
    return {name: float(value) for name, value in defects.items()} | {
        "work": float(work / work_magnitude)
    }


def is_valid_proof(defects: dict[str, float]) -> bool:
    """Return whether the defects are small enough for a valid proof.

    The work has to be a thousand times the violation of cones. Contact forces would therefore have
    to be a thousand times the loads to compensate the work.
    """
    exact = all(defects[name] < 1e-9 for name in ("strain", "supports", "turning", "cones"))
    return exact and defects["work"] > 1e-9 + 1e3 * defects["cones"]


def node_velocities(space, error: NoEquilibrium) -> Array:
    """Return the velocities (n, dim) of nodes in the rigid motions of their connected bodies."""
    x = space.tabulate_dof_coordinates()
    dim = space.mesh.geometry.dim
    cells = space.dofmap.list
    row = np.repeat(np.arange(len(cells)), cells.shape[1]) + len(x)
    links = sp.csr_matrix((np.ones(cells.size), (row, cells.ravel())), [len(x) + len(cells)] * 2)
    n_bodies, body_of_node = connected_components(links, directed=False)
    body_of_node, velocity = body_of_node[: len(x)], error.velocity
    assert n_bodies == len(velocity.centre)
    v = np.zeros((len(x), dim))
    for k in range(n_bodies):
        of_body = body_of_node == k
        distances = np.linalg.norm(velocity.centre - x[of_body, :dim].mean(axis=0), axis=1)
        j = int(np.argmin(distances))
        assert distances[j] < 1e-9 * np.ptp(x, axis=0).max()
        arm = x[of_body, :dim] - velocity.centre[j]
        if dim == 2:
            rotational = velocity.rotation[j, 0] * np.column_stack([-arm[:, 1], arm[:, 0]])
        else:
            rotational = np.cross(velocity.rotation[j], arm)
        v[of_body] = velocity.translation[j] + rotational
    return v


def _relative_velocities(
    pair: ContactPair, space, nodes: npt.NDArray, velocities: Array, surface_velocity: Array
) -> Array:
    """Return the velocities of nodes relative to the surface, or to the nodes that they face."""
    relative = velocities[nodes] - surface_velocity
    if isinstance(pair.surface, MatchingNodes):
        opposite_nodes, _ = contact_nodes_and_friction(
            ContactPair(pair.surface.nodes, pair.surface.shape), space
        )
        x = space.tabulate_dof_coordinates()[:, : velocities.shape[1]]
        offset = 0.0 if pair.surface.offset is None else np.asarray(pair.surface.offset)
        relative = (
            relative
            - velocities[opposite_nodes[cKDTree(x[opposite_nodes]).query(x[nodes] + offset)[1]]]
        )
    return relative


def _rigid_surface_of_pair(pair: ContactPair):
    """Return the rigid surface of a pair, or the shape between matching nodes."""
    return pair.surface.shape if isinstance(pair.surface, MatchingNodes) else pair.surface


def _largest_velocity_cone_violation(
    pair: ContactPair,
    space,
    translation: Array,
    is_free: npt.NDArray[np.bool_],
    velocities: Array,
    surface_velocity: Array,
    prescribed_mask: npt.NDArray[np.bool_],
) -> float:
    """Return the largest violation of the condition that gaps open fast enough compared with slip.

    The condition is v_n >= mu |v_t|, with v_t and v_n the tangential and normal relative velocity.
    Its violation is divided by the length of the vector (1, mu).
    """
    nodes, mu = contact_nodes_and_friction(pair, space)
    x = space.tabulate_dof_coordinates()[nodes, : velocities.shape[1]] - translation
    # a surface that is free to move may face any of the nodes
    faced = np.isfinite(_rigid_surface_of_pair(pair).gap(x)) | is_free.any()
    normal = _rigid_surface_of_pair(pair).normal(x)[faced]
    nodes, mu = nodes[faced], mu[faced]
    relative = np.where(
        prescribed_mask[nodes],
        0.0,
        _relative_velocities(pair, space, nodes, velocities, surface_velocity),
    )
    normal_velocity = np.sum(relative * normal, axis=1)
    tangential_velocity = np.where(
        prescribed_mask[nodes], 0.0, relative - normal_velocity[:, None] * normal
    )
    violation = mu * np.linalg.norm(tangential_velocity, axis=1) - normal_velocity
    return float((violation / np.sqrt(1 + mu**2)).max(initial=0.0))


def _largest_relative_velocity(
    pair: ContactPair, space, velocities: Array, surface_velocity: Array
) -> float:
    """Return the largest component of the velocities of a pair's nodes relative to its surface."""
    nodes, _ = contact_nodes_and_friction(pair, space)
    return float(
        np.abs(_relative_velocities(pair, space, nodes, velocities, surface_velocity)).max()
    )


def _largest_normal_change(
    pair: ContactPair, x: Array, translation: Array, is_free: npt.NDArray[np.bool_]
) -> float:
    """Return the largest change of a normal while the surface moves by up to the body's size."""
    shape, rng = _rigid_surface_of_pair(pair), np.random.default_rng(0)
    extent = np.ptp(x, axis=0).max()
    initial_normals = shape.normal(x - translation)
    translations = np.where(is_free, rng.uniform(-1, 1, (20, len(translation))), 0.0) * extent
    return max(
        float(np.abs(shape.normal(x - translation - further_translation) - initial_normals).max())
        for further_translation in translations
    )


def linearise_next_increment(problem, states) -> LinearIncrement:
    """Return the next increment of a plane problem as linear functions of unknown motions.

    `states` are the states before this increment. The matrix K is converted into a dense one, on
    one process. Surfaces that are free to move have to be flat.
    """
    space = problem.space
    dim, i_increment = space.mesh.geometry.dim, len(states)
    x = space.tabulate_dof_coordinates()[:, :dim]
    K = problem.K[:, :]
    f = problem.loads[i_increment].array_r
    prescribed_mask, values = prescribed_mask_and_displacements(problem.conditions, len(x), dim)
    contact_points = [
        (k, int(n), mu)
        for k, pair in enumerate(problem.pairs)
        for n, mu in zip(*contact_nodes_and_friction(pair, space), strict=True)
        if not prescribed_mask[n].all()
    ]
    nodes, pair_of = (
        np.array([n for _, n, _ in contact_points]),
        np.array([k for k, _, _ in contact_points]),
    )
    contact = np.zeros(x.shape, dtype=bool)
    contact[nodes] = True
    contact_dofs = np.flatnonzero((contact & ~prescribed_mask).ravel())
    inner_dofs = np.flatnonzero((~contact & ~prescribed_mask).ravel())
    translation, previous_translation = np.zeros((2, len(problem.pairs), dim))
    previous_displacement = np.zeros((len(x), dim))
    if states:
        previous_translation = np.array([pair.translation for pair in states[-1].pairs])
        previous_displacement = states[-1].displacement.array_r.reshape(-1, dim)
    free, prescribed_force = [], []
    for k, pair in enumerate(problem.pairs):
        motion = pair.motions[i_increment] if pair.motions else None
        for axis in range(dim):
            u = 0.0 if motion is None else motion.translation[axis]
            translation[k, axis] = previous_translation[k, axis] if u is None else u
            if u is None:
                free.append((k, axis))
                prescribed_force.append(0.0 if motion.force is None else motion.force[axis])
    size = len(contact_dofs) + len(free) + 1
    a = np.zeros((x.size, size))
    a[:, -1] = np.where(prescribed_mask, values, 0.0).ravel()
    a[contact_dofs, np.arange(len(contact_dofs))] = 1.0
    right_side = -K[inner_dofs] @ a
    right_side[:, -1] += f[inner_dofs]
    a[inner_dofs] = np.linalg.solve(K[np.ix_(inner_dofs, inner_dofs)], right_side)
    r = K @ a
    r[:, -1] -= f
    r[prescribed_mask.ravel()] = 0.0  # excludes the reactions of supports
    a, r = a.reshape(-1, dim, size)[nodes], r.reshape(-1, dim, size)[nodes]
    U = np.zeros((len(problem.pairs), dim, size))
    U[..., -1] = translation
    for k, at in enumerate(free):
        U[at] = 0.0
        U[at][len(contact_dofs) + k] = 1.0
    balance = np.zeros((len(free), size))
    for k, (pair, axis) in enumerate(free):
        balance[k] = r[pair_of == pair, axis].sum(axis=0)
        balance[k, -1] -= prescribed_force[k]
    shapes = [problem.pairs[k].surface for k in pair_of]
    points = x[nodes] - translation[pair_of]
    normal = np.array([s.normal(p[None])[0] for s, p in zip(shapes, points, strict=True)])
    gap = np.array([s.gap(p[None])[0] for s, p in zip(shapes, points, strict=True)])
    faced = np.isfinite(gap)
    tangent = np.where(prescribed_mask[nodes], 0.0, np.column_stack([-normal[:, 1], normal[:, 0]]))
    tangent *= np.linalg.norm(tangent, axis=1, keepdims=True) > 0.5
    relative = a - U[pair_of]
    gap_function = np.einsum("na,nab->nb", normal, relative)
    gap_function[:, -1] += np.where(faced, gap, 0.0) + np.sum(normal * translation[pair_of], axis=1)
    relative[..., -1] -= previous_displacement[nodes] - previous_translation[pair_of]
    return LinearIncrement(
        np.einsum("na,nab->nb", normal, r),
        np.einsum("na,nab->nb", tangent, r),
        gap_function,
        np.einsum("na,nab->nb", tangent, relative),
        balance,
        np.array([mu for _, _, mu in contact_points]),
        faced,
        float(np.abs(np.diag(K)).mean()),
    )
