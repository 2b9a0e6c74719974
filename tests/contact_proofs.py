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

from pw_elements.contact import ContactPair, MatchingNodes, NoEquilibrium, NoSolution
from tests.contact_residuals import _contact_nodes, _supports

Array = npt.NDArray[np.float64]


def flaws(problem, increment: int, error: NoEquilibrium) -> dict[str, float]:
    """What the proof lacks, each as a small number if it lacks nothing; in serial.

    Args:
        problem: it has `K`, `space`, `loads`, `conditions` (of the supports) and `pairs`.
        increment: that was refused.
        error: with the velocity.

    Returns:
        Strain forces, motion of supports and overstepping of cones over what velocities of that
        size could do, and turning of normals; under "work" the work over the sum of magnitudes.
    """
    space = problem.space
    dim = space.mesh.geometry.dim
    x = space.tabulate_dof_coordinates()[:, :dim]
    v = node_velocities(space, error)
    held, _ = _supports(problem.conditions, len(x), dim)
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
            found["cones"], _overstepped(pair, space, place, free, v, surfaces[k], held) / size
        )
        if free.any() and _moved_by(pair, space, v, surfaces[k]) > 1e-9 * size:
            found["turning"] = max(found["turning"], _turned(pair, x, place, free))
    return {name: float(value) for name, value in found.items()} | {"work": float(work / parts)}


def sound(found: dict[str, float]) -> bool:
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


def _relative(pair: ContactPair, space, nodes: npt.NDArray, v: Array, surface: Array) -> Array:
    relative = v[nodes] - surface
    if isinstance(pair.surface, MatchingNodes):
        other, _ = _contact_nodes(ContactPair(pair.surface.nodes, pair.surface.shape), space)
        x = space.tabulate_dof_coordinates()[:, : v.shape[1]]
        offset = 0.0 if pair.surface.offset is None else np.asarray(pair.surface.offset)
        relative = relative - v[other[cKDTree(x[other]).query(x[nodes] + offset)[1]]]
    return relative


def _shape(pair: ContactPair):
    return pair.surface.shape if isinstance(pair.surface, MatchingNodes) else pair.surface


def _overstepped(
    pair: ContactPair,
    space,
    place: Array,
    free: npt.NDArray[np.bool_],
    v: Array,
    surface: Array,
    held: npt.NDArray[np.bool_],
) -> float:
    """Largest mu |v_t| - v_n over the length of (1, mu)."""
    nodes, mu = _contact_nodes(pair, space)
    x = space.tabulate_dof_coordinates()[nodes, : v.shape[1]] - place
    # which nodes a surface faces that is free to move, is not known
    faced = np.isfinite(_shape(pair).gap(x)) | free.any()
    normal = _shape(pair).normal(x)[faced]
    nodes, mu = nodes[faced], mu[faced]
    relative = np.where(held[nodes], 0.0, _relative(pair, space, nodes, v, surface))
    parting = np.sum(relative * normal, axis=1)
    sliding = np.where(held[nodes], 0.0, relative - parting[:, None] * normal)
    short = mu * np.linalg.norm(sliding, axis=1) - parting
    return float((short / np.sqrt(1 + mu**2)).max(initial=0.0))


def _moved_by(pair: ContactPair, space, v: Array, surface: Array) -> float:
    nodes, _ = _contact_nodes(pair, space)
    return float(np.abs(_relative(pair, space, nodes, v, surface)).max())


def _turned(pair: ContactPair, x: Array, place: Array, free: npt.NDArray[np.bool_]) -> float:
    """Largest change of a normal as the surface moves freely by up to the body's size."""
    shape, rng = _shape(pair), np.random.default_rng(0)
    extent = np.ptp(x, axis=0).max()
    here = shape.normal(x - place)
    moves = np.where(free, rng.uniform(-1, 1, (20, len(place))), 0.0) * extent
    return max(float(np.abs(shape.normal(x - place - move) - here).max()) for move in moves)


# -- searches ---------------------------------------------------------------------------------


def contradictions(problem, states, error: NoSolution) -> dict[str, float]:
    """What a search's proof lacks, each as a small number if it lacks nothing; in serial, 2-D.

    That its branches hold each set of statuses once; that each one's multipliers make a number
    of -1 of all motions of the contact nodes and free surfaces; and that they are of the sign
    which the law of the statuses asks for. The nodal forces of a motion are those of the whole K.

    Args:
        problem: as in `flaws`; its free surfaces are flat.
        states: before the increment.
        error: with its branches.

    Returns:
        "cover": how many sets of statuses are left out or there twice; "signs": wrong multipliers
        over the largest; "motions": what the sum changes by in motions of a thousand times those
        under the loads, over one.
    """
    where = [(k, node) for k, pair in enumerate(error.state.pairs) for node in pair.node]
    linear = _Linear(problem, states, where)
    found = {"cover": float(_uncovered([branch.allowed for branch in error.branches]))}
    found |= {"signs": 0.0, "motions": 0.0}
    length = 1e3 * linear.motion
    for branch in error.branches:
        of_force = np.einsum("na,nab->b", branch.force, linear.force)
        of_gap = np.where(linear.faced, branch.gap, 0.0) @ linear.gap
        total = of_force + of_gap + np.einsum("na,nab->b", branch.slip, linear.slip)
        total += branch.total @ linear.balance
        found["motions"] = max(
            found["motions"], abs(total[-1] + 1), length * np.abs(total[:-1]).sum()
        )
        found["signs"] = max(found["signs"], linear.wrong_sign(branch))
    return {name: float(value) for name, value in found.items()}


def contradicts(found: dict[str, float]) -> bool:
    """Whether what `contradictions` finds leaves the proof as it is."""
    return found["cover"] == 0 and found["signs"] < 1e-9 and found["motions"] < 0.5


def _uncovered(allowed: list[npt.NDArray[np.bool_]]) -> int:
    """Sets of statuses that no branch has, and pairs of branches that have one in common."""
    boxes = np.array(allowed)
    every = boxes.any(axis=0).sum(axis=1)
    size = sum(int(np.prod(box.sum(axis=1).astype(object))) for box in boxes)
    twice = 0
    for k in range(1, len(boxes)):
        common = np.any(boxes[:k] & boxes[k], axis=2).all(axis=1)
        twice += int(common.sum())
    return abs(int(np.prod(every.astype(object))) - size) + twice


class _Linear:
    """Forces, gaps and slips of contact nodes as functions of (motions, translations, 1)."""

    def __init__(self, problem, states, where: list[tuple[int, int]]) -> None:
        space = problem.space
        dim, number = space.mesh.geometry.dim, len(states)
        x = space.tabulate_dof_coordinates()[:, :dim]
        K = problem.K[:, :]
        f = problem.loads[number].array_r
        held, values = _supports(problem.conditions, len(x), dim)
        held, values = held.ravel(), values.ravel()
        nodes = np.array([node for _, node in where])
        contact = np.zeros(x.size, dtype=bool)
        contact[(nodes[:, None] * dim + np.arange(dim)).ravel()] = True
        moved, inner = np.flatnonzero(contact & ~held), np.flatnonzero(~contact & ~held)
        place = np.zeros((len(problem.pairs), dim))
        was = np.zeros((len(problem.pairs), dim))
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
        a[:, -1] = np.where(held, values, 0.0)
        a[moved, np.arange(len(moved))] = 1.0
        right = -K[inner] @ a
        right[:, -1] += f[inner]
        a[inner] = np.linalg.solve(K[np.ix_(inner, inner)], right)
        r = K @ a
        r[:, -1] -= f
        r[held] = 0.0  # forces of supports
        a, r = a.reshape(-1, dim, size), r.reshape(-1, dim, size)
        U = np.zeros((len(problem.pairs), dim, size))
        U[..., -1] = place
        for k, at in enumerate(free):
            U[at] = 0.0
            U[at][len(moved) + k] = 1.0
        self.force, self.slip = np.zeros((2, len(nodes), dim, size))
        self.gap, self.faced = np.zeros((len(nodes), size)), np.zeros(len(nodes), dtype=bool)
        self.normal, self.mu = np.zeros((len(nodes), dim)), np.zeros(len(nodes))
        self.tangential = np.zeros((len(nodes), dim))
        supported = held.reshape(-1, dim)
        for k, pair in enumerate(problem.pairs):
            own, friction = _contact_nodes(pair, space)
            friction_at = dict(zip(own.tolist(), friction, strict=True))
            for i in [i for i, (number_, _) in enumerate(where) if number_ == k]:
                n = nodes[i]
                point = (x[n] - place[k])[None]
                normal = pair.surface.normal(point)[0]
                gap = pair.surface.gap(point)[0]
                self.faced[i], self.normal[i], self.mu[i] = np.isfinite(gap), normal, friction_at[n]
                tangent = np.where(supported[n], 0.0, [-normal[1], normal[0]])
                self.tangential[i] = tangent if np.linalg.norm(tangent) > 0.5 else 0.0
                relative = a[n] - U[k]
                self.gap[i] = normal @ relative
                self.gap[i, -1] += (gap if self.faced[i] else 0.0) + normal @ place[k]
                since = relative.copy()
                since[:, -1] -= before[n] - was[k]
                self.slip[i] = since
                self.force[i] = r[n]
        pair_of = np.array([k for k, _ in where])
        self.balance = np.zeros((len(free), size))
        for k, (pair, axis) in enumerate(free):
            self.balance[k] = self.force[pair_of == pair, axis].sum(axis=0)
            self.balance[k, -1] -= asked[k]
        rest = np.abs(self.force[..., -1]).max() / np.abs(np.diag(K)).mean()
        self.motion = max(rest, np.abs(self.gap[self.faced, -1]).max())

    def wrong_sign(self, branch) -> float:
        """Largest multiplier of the wrong sign over the largest of its kind."""
        force, slip = branch.force, np.sum(branch.slip * branch.forwards, axis=1)
        wrong, tangent = [0.0], branch.forwards
        across = np.abs(np.sum(tangent * self.normal, axis=1)).max()
        size = np.linalg.norm(force, axis=1).max() or 1.0
        widest, steepest = np.abs(branch.gap).max() or 1.0, np.abs(slip).max() or 1.0
        for i, statuses in enumerate(branch.allowed):
            rough = self.mu[i] > 0 and self.faced[i] and np.any(self.tangential[i])
            rays = {1: [0.0], 2: [], 3: []}
            if rough:
                rays = {1: [-self.mu[i], self.mu[i]], 2: [-self.mu[i]], 3: [self.mu[i]]}
            elif statuses[2:].any():
                wrong.append(np.inf)
            if not self.faced[i]:
                wrong += [abs(branch.gap[i]) / widest, np.inf if statuses[1:].any() else 0.0]
            if statuses[0]:
                wrong += [-branch.gap[i] / widest, abs(slip[i]) / steepest]
            for status in np.flatnonzero(statuses[1:]) + 1:
                for ray in rays[int(status)]:
                    r = self.normal[i] + ray * tangent[i]
                    wrong.append(-(force[i] @ r) / size / np.linalg.norm(r))
            if statuses[2]:
                wrong.append(-slip[i] / steepest)
            if statuses[3]:
                wrong.append(slip[i] / steepest)
            if not rough:
                wrong.append(abs(slip[i]) / steepest)
        return max(*wrong, across)
