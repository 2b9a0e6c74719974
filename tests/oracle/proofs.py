"""Whether a refused problem's rigid velocity proves that it has no equilibrium.

By the problem's own data alone: positions, K, loads, supports, pairs. Of the library's contact,
nothing is asked but for the velocity that its error carries. It is a proof if

- each node moves with its connected piece, which K^T takes to nothing, and not at supports,
- loads and forces on free surfaces do work,
- at every node that a surface faces, the velocity relative to it parts from it at least mu times
  as fast as it slides along it; so no contact force in Coulomb's cone does negative work.

A curved surface that is free to move is asked for its normals at many places: they may not turn.
"""

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from pw_elements.contact import ContactPair, NoEquilibrium
from pw_elements.contact.model import MatchingNodes
from tests.contact.residuals import contact_nodes_and_friction, prescribed_displacements
from tests.oracle.search import LinearIncrement

Array = npt.NDArray[np.float64]


def measure_proof_defects(problem, increment: int, error: NoEquilibrium) -> dict[str, float]:
    """What the proof lacks, each as a small number if it lacks nothing; in serial.

    Strain forces, motion of supports and overstepping of cones over what velocities of that size
    could do, and turning of normals; under "work" the work over the sum of magnitudes.
    """
    space = problem.space
    dim = space.mesh.geometry.dim
    x = space.tabulate_dof_coordinates()[:, :dim]
    v = node_velocities(space, error)
    held, _ = prescribed_displacements(problem.conditions, len(x), dim)
    size = np.linalg.norm(v, axis=1).max()
    surfaces = error.velocity.surface
    size = max(size, np.abs(surfaces).max())
    image, mode = problem.K.createVecLeft(), problem.K.createVecRight()
    mode.setArray(np.where(held, 0.0, v).ravel())
    problem.K.multTranspose(mode, image)
    load = problem.loads[increment].array_r
    work, parts = load @ v.ravel(), np.abs(load) @ np.abs(v.ravel())
    found = {
        "strain": np.abs(image.array_r).max() / np.abs(problem.K.getValuesCSR()[2]).max() / size,
        "supports": np.abs(np.where(held, v, 0.0)).max() / size,
        "cones": 0.0,
        "turning": 0.0,
    }
    for k, pair in enumerate(problem.pairs):
        motion = pair.motions[increment] if pair.motions else None
        place, free = np.zeros(dim), np.zeros(dim, dtype=bool)
        if motion is not None:
            free = np.array([u is None for u in motion.translation])
            place = np.array([0.0 if u is None else u for u in motion.translation])
            forces = np.zeros(dim) if motion.force is None else np.array(motion.force)
            work += np.where(free, forces, 0.0) @ surfaces[k]
            parts += np.abs(np.where(free, forces, 0.0)) @ np.abs(surfaces[k])
        found["supports"] = max(found["supports"], np.abs(surfaces[k][~free]).max(initial=0.0))
        found["cones"] = max(
            found["cones"],
            _largest_cone_violation(pair, space, place, free, v, surfaces[k], held) / size,
        )
        if free.any() and _largest_relative_velocity(pair, space, v, surfaces[k]) > 1e-9 * size:
            found["turning"] = max(found["turning"], _largest_normal_change(pair, x, place, free))
    return {name: float(value) for name, value in found.items()} | {"work": float(work / parts)}


def is_valid_proof(found: dict[str, float]) -> bool:
    """Whether what `flaws` finds leaves the proof as it is.

    Contact forces would have to be a thousand times the loads to undo it by round-off.
    """
    exact = all(found[name] < 1e-9 for name in ("strain", "supports", "turning", "cones"))
    return exact and found["work"] > 1e-9 + 1e3 * found["cones"]


def node_velocities(space, error: NoEquilibrium) -> Array:
    """Velocities (n, dim) of nodes by the connected piece that each one belongs to."""
    x = space.tabulate_dof_coordinates()
    dim = space.mesh.geometry.dim
    cells = space.dofmap.list
    row = np.repeat(np.arange(len(cells)), cells.shape[1]) + len(x)
    links = sp.csr_matrix((np.ones(cells.size), (row, cells.ravel())), [len(x) + len(cells)] * 2)
    count, piece = connected_components(links, directed=False)
    piece, stated = piece[: len(x)], error.velocity
    assert count == len(stated.centre)
    v = np.zeros((len(x), dim))
    for k in range(count):
        mine = piece == k
        near = np.linalg.norm(stated.centre - x[mine, :dim].mean(axis=0), axis=1)
        j = int(np.argmin(near))
        assert near[j] < 1e-9 * np.ptp(x, axis=0).max()
        arm = x[mine, :dim] - stated.centre[j]
        if dim == 2:
            turned = stated.rotation[j, 0] * np.column_stack([-arm[:, 1], arm[:, 0]])
        else:
            turned = np.cross(stated.rotation[j], arm)
        v[mine] = stated.translation[j] + turned
    return v


def _relative_velocities(
    pair: ContactPair, space, nodes: npt.NDArray, v: Array, surface: Array
) -> Array:
    relative = v[nodes] - surface
    if isinstance(pair.surface, MatchingNodes):
        other, _ = contact_nodes_and_friction(
            ContactPair(pair.surface.nodes, pair.surface.shape), space
        )
        x = space.tabulate_dof_coordinates()[:, : v.shape[1]]
        offset = 0.0 if pair.surface.offset is None else np.asarray(pair.surface.offset)
        relative = relative - v[other[cKDTree(x[other]).query(x[nodes] + offset)[1]]]
    return relative


def _rigid_shape(pair: ContactPair):
    return pair.surface.shape if isinstance(pair.surface, MatchingNodes) else pair.surface


def _largest_cone_violation(
    pair: ContactPair,
    space,
    place: Array,
    free: npt.NDArray[np.bool_],
    v: Array,
    surface: Array,
    held: npt.NDArray[np.bool_],
) -> float:
    """Largest mu |v_t| - v_n over the length of (1, mu)."""
    nodes, mu = contact_nodes_and_friction(pair, space)
    x = space.tabulate_dof_coordinates()[nodes, : v.shape[1]] - place
    # which nodes a surface faces that is free to move, is not known
    faced = np.isfinite(_rigid_shape(pair).gap(x)) | free.any()
    normal = _rigid_shape(pair).normal(x)[faced]
    nodes, mu = nodes[faced], mu[faced]
    relative = np.where(held[nodes], 0.0, _relative_velocities(pair, space, nodes, v, surface))
    parting = np.sum(relative * normal, axis=1)
    sliding = np.where(held[nodes], 0.0, relative - parting[:, None] * normal)
    short = mu * np.linalg.norm(sliding, axis=1) - parting
    return float((short / np.sqrt(1 + mu**2)).max(initial=0.0))


def _largest_relative_velocity(pair: ContactPair, space, v: Array, surface: Array) -> float:
    nodes, _ = contact_nodes_and_friction(pair, space)
    return float(np.abs(_relative_velocities(pair, space, nodes, v, surface)).max())


def _largest_normal_change(
    pair: ContactPair, x: Array, place: Array, free: npt.NDArray[np.bool_]
) -> float:
    """Largest change of a normal as the surface moves freely by up to the body's size."""
    shape, rng = _rigid_shape(pair), np.random.default_rng(0)
    extent = np.ptp(x, axis=0).max()
    here = shape.normal(x - place)
    moves = np.where(free, rng.uniform(-1, 1, (20, len(place))), 0.0) * extent
    return max(float(np.abs(shape.normal(x - place - move) - here).max()) for move in moves)


def linear_increment(problem, states) -> LinearIncrement:
    """The increment after some states, of a problem in the plane, by the whole K; in serial.

    Surfaces that are free to move have to be flat.
    """
    space = problem.space
    dim, number = space.mesh.geometry.dim, len(states)
    x = space.tabulate_dof_coordinates()[:, :dim]
    K = problem.K[:, :]
    f = problem.loads[number].array_r
    held, values = prescribed_displacements(problem.conditions, len(x), dim)
    where = [
        (k, int(n), mu)
        for k, pair in enumerate(problem.pairs)
        for n, mu in zip(*contact_nodes_and_friction(pair, space), strict=True)
        if not held[n].all()
    ]
    nodes, pair_of = np.array([n for _, n, _ in where]), np.array([k for k, _, _ in where])
    contact = np.zeros(x.shape, dtype=bool)
    contact[nodes] = True
    moved = np.flatnonzero((contact & ~held).ravel())
    inner = np.flatnonzero((~contact & ~held).ravel())
    place, was = np.zeros((2, len(problem.pairs), dim))
    before = np.zeros((len(x), dim))
    if states:
        was = np.array([pair.translation for pair in states[-1].pairs])
        before = states[-1].displacement.array_r.reshape(-1, dim)
    free, asked = [], []
    for k, pair in enumerate(problem.pairs):
        motion = pair.motions[number] if pair.motions else None
        for axis in range(dim):
            u = 0.0 if motion is None else motion.translation[axis]
            place[k, axis] = was[k, axis] if u is None else u
            if u is None:
                free.append((k, axis))
                asked.append(0.0 if motion.force is None else motion.force[axis])
    size = len(moved) + len(free) + 1
    a = np.zeros((x.size, size))
    a[:, -1] = np.where(held, values, 0.0).ravel()
    a[moved, np.arange(len(moved))] = 1.0
    right = -K[inner] @ a
    right[:, -1] += f[inner]
    a[inner] = np.linalg.solve(K[np.ix_(inner, inner)], right)
    r = K @ a
    r[:, -1] -= f
    r[held.ravel()] = 0.0  # forces of supports
    a, r = a.reshape(-1, dim, size)[nodes], r.reshape(-1, dim, size)[nodes]
    U = np.zeros((len(problem.pairs), dim, size))
    U[..., -1] = place
    for k, at in enumerate(free):
        U[at] = 0.0
        U[at][len(moved) + k] = 1.0
    balance = np.zeros((len(free), size))
    for k, (pair, axis) in enumerate(free):
        balance[k] = r[pair_of == pair, axis].sum(axis=0)
        balance[k, -1] -= asked[k]
    shapes = [problem.pairs[k].surface for k in pair_of]
    points = x[nodes] - place[pair_of]
    normal = np.array([s.normal(p[None])[0] for s, p in zip(shapes, points, strict=True)])
    gap = np.array([s.gap(p[None])[0] for s, p in zip(shapes, points, strict=True)])
    faced = np.isfinite(gap)
    tangent = np.where(held[nodes], 0.0, np.column_stack([-normal[:, 1], normal[:, 0]]))
    tangent *= np.linalg.norm(tangent, axis=1, keepdims=True) > 0.5
    relative = a - U[pair_of]
    towards = np.einsum("na,nab->nb", normal, relative)
    towards[:, -1] += np.where(faced, gap, 0.0) + np.sum(normal * place[pair_of], axis=1)
    relative[..., -1] -= before[nodes] - was[pair_of]
    return LinearIncrement(
        np.einsum("na,nab->nb", normal, r),
        np.einsum("na,nab->nb", tangent, r),
        towards,
        np.einsum("na,nab->nb", tangent, relative),
        balance,
        np.array([mu for _, _, mu in where]),
        faced,
        float(np.abs(np.diag(K)).mean()),
    )
