"""Contact pairs as the user states them, and the contact nodes they become."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem, la
from dolfinx.mesh import exterior_facet_indices

from pw_elements.algebra import Reduction, assemble_vector
from pw_elements.contact.errors import listed
from pw_elements.contact.surfaces import Polyline, Surface
from pw_elements.mechanics import Marker

Array = npt.NDArray[np.float64]

# Largest initial penetration that passes for round-off and faceting, over the body's diagonal
_PENETRATION = 1e-6
# Largest normal component of a prescribed displacement, a cosine
_TANGENTIAL = 1e-8
# Largest difference of a normal's length from one
_UNIT = 1e-6
# Cosine from which on a push counts as outwards
_OUTWARDS = 0.1
# What surfaces have one component of per dimension
_VECTORS = ("point", "direction", "apex", "centre")


@dataclass(frozen=True)
class Motion:
    """Rigid translation of a surface at the end of one increment, from its initial place.

    Args:
        translation: (dim,); None for a component that is free and follows from its force.
        force: (dim,), total force of the surface on the body in the free components (on the
            whole circumference in axisymmetry, where radial ones are sums of nodal forces round
            the axis); without meaning in prescribed ones.

    Raises:
        ValueError: for values that are not finite, or a force in a prescribed component.
    """

    translation: Sequence[float | None]
    force: Sequence[float] | None = None

    def __post_init__(self) -> None:
        force = np.zeros(len(self.translation)) if self.force is None else np.asarray(self.force)
        if len(force) != len(self.translation):
            raise ValueError("translation and force of a motion differ in length")
        for component, (moved, pushed) in enumerate(zip(self.translation, force, strict=True)):
            if not np.isfinite(pushed) or not (moved is None or np.isfinite(moved)):
                raise ValueError(f"component {component} of a motion is not finite")
            if moved is not None and pushed:
                raise ValueError(
                    f"component {component} of a motion has a translation and a force: "
                    "one of them follows from the other"
                )

    def prescribed(self) -> Array:
        """Translations (dim,), NaN where they are free."""
        return np.array([np.nan if u is None else u for u in self.translation])

    def forces(self) -> Array:
        """Total forces (dim,)."""
        return np.zeros(len(self.translation)) if self.force is None else np.array(self.force)


@dataclass(frozen=True)
class ContactPair:
    """Nodes of the body that may touch a rigid surface.

    Args:
        nodes: marker of their positions, or their local numbers in the space, such as
            `fem.locate_dofs_topological` gives for tagged facets, or a mask of these (ghosts are
            passed over, so that every process may give all it knows).
        surface: the rigid surface at its initial place.
        friction: Coulomb's mu, or a function of positions (3, n) that gives it per node. A
            node between a smooth and a rough part is thereby assigned to one of them.
        motions: one per increment; the surface rests where there are none.
    """

    nodes: Marker | npt.NDArray[np.int32] | npt.NDArray[np.bool_]
    surface: Surface
    friction: float | Callable[[Array], Array] = 0.0
    motions: Sequence[Motion] = ()


@dataclass(frozen=True)
class ContactNodes:
    """All contact nodes owned by this process (n of them), pair after pair.

    Args:
        pairs: the pairs.
        pair: (n,), number of the node's pair.
        node: (n,), local number in the space.
        position: (n, dim).
        friction: (n,).
        column: (n, dim), column of each displacement component in the reduced system; -1
            where it is prescribed.
        comm: of the space.
    """

    pairs: Sequence[ContactPair]
    pair: npt.NDArray[np.int32]
    node: npt.NDArray[np.int32]
    position: Array
    friction: Array
    column: npt.NDArray[np.int64]
    comm: MPI.Comm

    @classmethod
    def collect(
        cls, pairs: Sequence[ContactPair], space: fem.FunctionSpace, reduction: Reduction
    ) -> "ContactNodes":
        """Looks the nodes up and checks what can be checked before any computation.

        Raises:
            ValueError: for no nodes, a node that does not exist, lies inside of the body or
                in two pairs, friction that is negative or not a number, a prescribed normal
                displacement, a surface of another dimension, without gap or unit normal at a
                node, or one that cuts the body.
        """
        dim = space.mesh.geometry.dim
        if space.dofmap.index_map_bs != dim:
            raise ValueError("contact is stated on displacements: the space has to be a vector's")
        if not pairs:
            raise ValueError("there is no contact pair")
        for k, pair in enumerate(pairs):
            _check_dimension(k, pair.surface, dim)
        comm = space.mesh.comm
        x = space.tabulate_dof_coordinates()
        found = [_owned_nodes(k, pair, space) for k, pair in enumerate(pairs)]
        node = np.concatenate(found).astype(np.int32)
        number = np.repeat(np.arange(len(pairs), dtype=np.int32), [len(f) for f in found])
        friction = _together(
            comm,
            lambda: np.concatenate(
                [_friction(pair, x[f].T) for pair, f in zip(pairs, found, strict=True)]
            ),
        )
        nodes = cls(
            pairs,
            number,
            node,
            x[node, :dim],
            friction,
            _columns(reduction, node, dim),
            comm,
        )
        nodes.refuse(~_on_boundary(space)[node], "lie inside of the body, not on its boundary")
        nodes.check(_diagonal(space))
        nodes.check_sides(_outward(space)[node])
        return nodes

    def check(self, diagonal: float) -> None:
        """Raises ValueError as `collect` says; `diagonal` is the body's size."""
        for k in range(len(self.pairs)):
            count = self.comm.allreduce(int(np.sum(self.pair == k)), MPI.SUM)
            if count == 0:
                raise ValueError(f"contact pair {k} has no nodes: its marker holds nowhere")
        unique, times = np.unique(self.node, return_counts=True)
        twice = np.isin(self.node, unique[times > 1])
        self.refuse(twice, "belong to two contact pairs")
        wrong = ~(np.isfinite(self.friction) & (self.friction >= 0))
        self.refuse(wrong, "have a friction coefficient that is negative or not finite")
        self.check_supports(None)
        self.refuse(
            ~(self.gaps(None) >= -_PENETRATION * diagonal),
            "lie inside the rigid surface before any motion; a motion has to press it in",
        )

    def check_supports(self, translations: Array | None) -> None:
        """Raises ValueError if a node that a surface faces cannot move along its normal."""
        normal, gap = self.normals(translations), self.gaps(translations)
        self.refuse(np.isnan(gap), "see a surface whose gap is not a number")
        faced = np.isfinite(gap)
        length = np.linalg.norm(normal, axis=1)
        self.refuse(~(np.abs(length - 1) < _UNIT), "see a surface whose normal is no unit vector")
        held = np.abs(np.where(self.column < 0, normal, 0.0)).max(axis=1, initial=0) > _TANGENTIAL
        self.refuse(
            held & faced, "have a prescribed normal displacement: they cannot be in contact"
        )

    def check_sides(self, outward: Array) -> None:
        """Raises ValueError for a pair whose surface pushes the body outwards at every node.

        `outward` (n, dim) has the direction of the body's normal, zero where there is none.
        """
        pushed = np.sum(self.normals(None) * outward, axis=1)
        wrong = pushed > _OUTWARDS * np.linalg.norm(outward, axis=1)
        known = np.any(outward != 0, axis=1) & np.isfinite(self.gaps(None))
        for k in range(len(self.pairs)):
            mine = known & (self.pair == k)
            some, right = (
                self.comm.allreduce(int(np.sum(flags)), MPI.SUM) for flags in (mine, mine & ~wrong)
            )
            if some and not right:
                raise ValueError(
                    f"the surface of contact pair {k} pushes the body outwards at each of its "
                    "nodes: its direction is to point from the rigid into the body; reverse it"
                )

    def refuse(self, wrong: npt.NDArray[np.bool_], what: str) -> None:
        """Raises a ValueError that names the positions of nodes, if there are any."""
        places = self.gathered(self.position[wrong])
        if len(places):
            raise ValueError(f"contact nodes at {listed(places)} {what}")

    def gathered(self, values: npt.NDArray) -> npt.NDArray:
        """Rows of all processes, on each of them."""
        return np.concatenate(self.comm.allgather(values))

    def shifts(self, translations: Array | None) -> Array:
        """Translation (n, dim) of each node's surface; `translations` are (pairs, dim)."""
        if translations is None:
            return np.zeros_like(self.position)
        return translations[self.pair]

    def gaps(self, translations: Array | None) -> Array:
        """Gap (n,) of the undeformed body to the translated surfaces."""
        return self._by_pair(lambda surface, x: surface.gap(x), translations, ())

    def normals(self, translations: Array | None) -> Array:
        """Normals (n, dim) of the translated surfaces at the undeformed body."""
        dim = self.position.shape[1]
        return self._by_pair(lambda surface, x: surface.normal(x), translations, (dim,))

    def _by_pair(
        self,
        ask: Callable[[Surface, Array], Array],
        translations: Array | None,
        shape: tuple[int, ...],
    ) -> Array:
        x = self.position - self.shifts(translations)
        values = np.empty((len(x), *shape))

        def fill() -> Array:
            for k, pair in enumerate(self.pairs):
                mine = self.pair == k
                if mine.any():
                    answer = np.asarray(ask(pair.surface, x[mine]))
                    if answer.shape != (mine.sum(), *shape):
                        raise ValueError(
                            f"the surface of contact pair {k} answers with the shape "
                            f"{answer.shape} to {mine.sum()} points, which are rows (n, dim)"
                        )
                    values[mine] = answer
            return values

        return _together(self.comm, fill)


def _together(comm: MPI.Comm, ask: Callable[[], Array]) -> Array:
    """What the user's functions give; where they fail on one process, all of them stop.

    Raises:
        ValueError: on the other processes.
    """
    error: Exception | None = None
    values: Array = np.empty(0)
    try:
        values = ask()
    except Exception as raised:
        error = raised
    if comm.allreduce(int(error is not None), MPI.MAX):
        raise error or ValueError("a surface or friction function failed on another process")
    return values


def _check_dimension(number: int, surface: Surface, dim: int) -> None:
    vectors = {name: getattr(surface, name, None) for name in _VECTORS}
    if isinstance(surface, Polyline):
        vectors["first point"] = surface.points[0]
    for name, vector in vectors.items():
        if vector is not None and len(vector) != dim:
            raise ValueError(
                f"contact pair {number}: the {name} of its surface has {len(vector)} components "
                f"in {dim}-D"
            )


def _owned_nodes(number: int, pair: ContactPair, space: fem.FunctionSpace) -> npt.NDArray[np.int32]:
    """Local numbers of a pair's nodes that this process owns.

    Raises:
        ValueError: for numbers that are no node's.
    """
    index_map = space.dofmap.index_map
    if callable(pair.nodes):
        nodes = fem.locate_dofs_geometrical(space, pair.nodes)
        return nodes[nodes < index_map.size_local]
    nodes, known = np.asarray(pair.nodes), index_map.size_local + index_map.num_ghosts
    wrong = False
    if nodes.dtype == bool:
        wrong = len(nodes) != known
        nodes = np.flatnonzero(nodes)
    elif len(nodes):
        wrong = nodes.min() < 0 or nodes.max() >= known
    if space.mesh.comm.allreduce(int(wrong), MPI.MAX):
        raise ValueError(
            f"contact pair {number}: its nodes are no local numbers of the space's {known} nodes, "
            "nor a mask of these"
        )
    nodes = np.unique(nodes).astype(np.int32)
    return nodes[nodes < index_map.size_local]


def _on_boundary(space: fem.FunctionSpace) -> npt.NDArray[np.bool_]:
    """Which owned nodes lie on an exterior facet, of whichever process."""
    mesh = space.mesh
    facet = mesh.topology.dim - 1
    mesh.topology.create_connectivity(facet, mesh.topology.dim)
    facets = exterior_facet_indices(mesh.topology)
    count = la.vector(space.dofmap.index_map, 1)
    count.array[:] = 0.0
    count.array[fem.locate_dofs_topological(space, facet, facets, remote=False)] = 1.0
    count.scatter_reverse(la.InsertMode.add)
    return np.asarray(count.array[: space.dofmap.index_map.size_local] > 0)


def _friction(pair: ContactPair, x: Array) -> Array:
    mu = np.asarray(pair.friction(x) if callable(pair.friction) else pair.friction, dtype=float)
    if mu.shape not in ((), (x.shape[1],)):
        raise ValueError(
            f"the friction function gave values of the shape {mu.shape} for {x.shape[1]} points: "
            "it takes points as columns (3, n) and gives (n,)"
        )
    return np.broadcast_to(mu, (x.shape[1],))


def _columns(reduction: Reduction, node: npt.NDArray[np.int32], dim: int) -> npt.NDArray[np.int64]:
    """Columns (n, dim) of the nodes' displacements under the reduction, -1: prescribed.

    Raises:
        ValueError: if the reduction makes a contact node's displacement a combination.
    """
    dofs = (node[:, None] * dim + np.arange(dim)).ravel()
    column = free_columns(reduction.right)[dofs]
    if reduction.right.comm.tompi4py().allreduce(int(np.any(column < -1)), MPI.MAX):
        raise ValueError(
            "the reduction combines the displacements of a contact node with others: it may "
            "prescribe them or keep them"
        )
    return column.reshape(-1, dim)


def free_columns(right: PETSc.Mat) -> npt.NDArray[np.int64]:
    """Column of each owned row of R that is a row of the identity.

    Empty rows (prescribed values) get -1, combinations -2.
    """
    indptr, indices, data = right.getValuesCSR()
    count = np.diff(indptr)
    column = np.where(count == 0, -1, -2).astype(np.int64)
    single = np.flatnonzero(count == 1)
    kept = single[data[indptr[single]] == 1.0]
    column[kept] = indices[indptr[kept]]
    return column


def _outward(space: fem.FunctionSpace) -> Array:
    """Outward normals (owned nodes, dim), integrated with the shape functions of the nodes."""
    v = ufl.TestFunction(space)
    total = assemble_vector(ufl.inner(ufl.FacetNormal(space.mesh), v) * ufl.ds)
    return np.asarray(total.array_r.reshape(-1, space.mesh.geometry.dim))


def _diagonal(space: fem.FunctionSpace) -> float:
    """Length of the bounding box's diagonal."""
    x, comm = space.mesh.geometry.x, space.mesh.comm
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    if len(x):
        low, high = x.min(axis=0), x.max(axis=0)
    comm.Allreduce(MPI.IN_PLACE, low, MPI.MIN)
    comm.Allreduce(MPI.IN_PLACE, high, MPI.MAX)
    return float(np.linalg.norm(high - low))
