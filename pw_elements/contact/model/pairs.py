"""What the user states: contact pairs and the motions of their surfaces."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from dolfinx.mesh import MeshTags

from pw_elements.arrays import Array
from pw_elements.checks import arguments, defer_errors_if_parallel
from pw_elements.contact.model.friction import Coulomb, Friction
from pw_elements.contact.model.surfaces import Surface, unit
from pw_elements.spaces import Part


@dataclass(frozen=True)
class Motion:
    """Rigid motion of a surface at the end of one increment, from its initial place.

    At large sliding, where its pair has a pivot, it may turn about that, too, by any angle, in
    parts of at most an eighth of a turn; the pivot moves with the translation.

        ContactPair(top, Sphere((0, 1), 1), friction=0.3, pivot=(0, 1))
        Motion((0.4, None), force=(0, -20.0), rotation=-0.4)  # rolls to the right under a weight
        Motion((0.4, -0.1), rotation=None, torque=0.0)         # is dragged, on a shaft without any

    Args:
        translation: (dim,); None for a component that is free and follows from its force.
        force: (dim,), total force of the surface on the body in the free components (on the
            whole circumference in axisymmetry, where radial ones are sums of nodal forces round
            the axis), and zero in prescribed ones.
        rotation: angle in radians, right-handed about the pair's axis, in the plane
            anticlockwise; None if it is free and follows from its torque.
        torque: of the surface on the body about the pivot's present place, where rotation is None.

    Raises:
        ValueError: for values that are not finite numbers, a force and a translation of different
            sizes, or a force or torque on a given motion.
    """

    translation: Sequence[float | None]
    force: Sequence[float] | None = None
    rotation: float | None = 0.0
    torque: float = 0.0

    @defer_errors_if_parallel
    def __post_init__(self) -> None:
        for name in ("translation", "force"):
            given = getattr(self, name)
            several = isinstance(given, Sequence) and not isinstance(given, str | bytes)
            several |= isinstance(given, np.ndarray) and given.ndim == 1
            if not several and (given is not None or name == "translation"):
                raise ValueError(f"{name} {given!r} of a motion: it has to be a vector")
        if self.force is not None and len(self.force) != len(self.translation):
            raise ValueError("translation and force of a motion differ in length")
        for k, (moved, pushed) in enumerate(zip(*self._parts, strict=True)):
            who, way, push = f"component {k} of a motion", "translation", "force"
            if k == len(self.translation):
                who, way, push = "a motion", "rotation", "torque"
            arguments.check_number(f"{who}'s {push}", pushed)
            if moved is not None:
                arguments.check_number(f"{who}'s {way}", moved)
            if moved is not None and pushed:
                raise ValueError(
                    f"{who} has a {way} and a {push}: one of them follows from the other"
                )

    @property
    def _parts(self) -> tuple[list[float | None], list[float]]:
        force = [0.0] * len(self.translation) if self.force is None else self.force
        return [*self.translation, self.rotation], [*force, self.torque]

    def prescribed(self) -> Array:
        """Translations and angle (dim + 1,), NaN where they are free."""
        return np.array([np.nan if u is None else u for u in self._parts[0]], dtype=float)

    def forces(self) -> Array:
        """Total forces and torque (dim + 1,), zero where none is given."""
        return np.array(self._parts[1], dtype=float)


@dataclass(frozen=True)
class MatchingNodes:
    """Another part of the same mesh's boundary, each node of which faces one of the pair's.

    It replaces the rigid surface in contact of two bodies (disconnected parts of one mesh) whose
    meshes match along the contact. A `Motion` then is a rigid motion of the opposite body in
    addition to its displacements: an approach, prescribed or found from a force, of two bodies that
    are both supported.

    Args:
        nodes: of the opposite part: a marker of positions as columns (3, n), local numbers, or a
            mask.
        shape: what a rigid surface in the opposite part's place would be: gap (n,) to it and
            normal (n, dim) towards the pair's own nodes, at their positions (n, dim).
        offset: (dim,), from the pair's nodes to the ones that they face; zero by default.

    Raises:
        TypeError: for arguments of the wrong type, such as exchanged ones.
        ValueError: for an offset that is not finite.
    """

    nodes: Part
    shape: Surface
    offset: Sequence[float] | None = None

    @defer_errors_if_parallel
    def __post_init__(self) -> None:
        _check_part("nodes", self.nodes, "MatchingNodes(nodes, shape)")
        if not _is_surface(self.shape):
            raise TypeError(
                f"the shape of matching nodes is {arguments.describe(self.shape)}: it has to be a "
                "surface, with a gap and a normal"
            )
        if self.offset is not None:
            arguments.check_vector("the offset of matching nodes", self.offset)


@dataclass(frozen=True)
class DeformableSurface:
    """Another part of the same mesh's boundary, whose nodes need not match the pair's.

    It replaces the rigid surface in contact of two bodies (disconnected parts of one mesh). The
    pair's own side is the mortar's slave: contact is stated at its nodes, so the finer mesh
    should be the pair's. A `Motion` then is a rigid motion of this side in addition to its
    displacements, as for `MatchingNodes`.

        materials = {STEEL: Material(210e3, 0.3), ALUMINIUM: Material(70e3, 0.33)}
        material = Material.by_tag(mesh, cell_tags, materials)
        body = Body(Spaces.petrov_galerkin(mesh), material, "plane strain")
        own = fem.locate_dofs_topological(body.spaces.trial, 1, facet_tags.find(FINE))
        pair = ContactPair(own, DeformableSurface(facet_tags.find(COARSE)), friction=0.2)

    Contact is stated at the pair's own nodes: `PairState` has their results, and the nodal forces
    of the opposite side; `ContactFields` has pressures, gaps, slips and statuses of both. The
    guide's page on theory says what is exact and what is not ("Two bodies"). Large sliding needs
    `ContactProblem.of_residual`, in the plane or in axisymmetry.

    Args:
        where: marker of positions as columns (3, n), which holds at every vertex of a facet; or
            local numbers of facets, as `MeshTags.find` gives them; or a mask of all.
        revolved: whether areas are those of the whole circumference, as in axisymmetry. Needed in
            the plane only, and unless the stiffness is that of a `Body`, which knows it.
        coincident: whether both sides are one and the same surface before any motion, as of a tube
            and its liner. The small gaps that meshes leave on a curved one are then ignored.

    Raises:
        TypeError: for arguments of the wrong type.
    """

    where: Part
    revolved: bool | None = None
    coincident: bool = False

    @defer_errors_if_parallel
    def __post_init__(self) -> None:
        _check_part("facets", self.where, "DeformableSurface(where)")
        if self.revolved is not None:
            arguments.check_flag("revolved", self.revolved)
        arguments.check_flag("coincident", self.coincident)


@dataclass(frozen=True)
class ContactPair:
    """Nodes of a body that may touch a rigid surface, or another part of the mesh.

    Args:
        nodes: marker of their positions as columns (3, n), or their local numbers in the space,
            such as `fem.locate_dofs_topological` gives for tagged facets, or a mask of these
            (ghosts are skipped, so every process may pass all it knows).
        surface: the rigid surface at its initial place, or the other part of the mesh, as
            `DeformableSurface` or `MatchingNodes`.
        friction: Coulomb's mu, or a function of positions as columns (3, n) that returns it for
            each node, (n,), or another law, see `Friction`. A node where a smooth and a rough part
            meet has the value that the function gives there.
        motions: one per increment of `solve_contact`; without them the surface rests. A single one
            needs no list.
        interference: whether the surface may cut into the body before any motion, as in a shrink
            fit; the first increment then pushes the nodes out of it. With a `coincident`
            `DeformableSurface` it is the nominal depth instead: a number, or a function of
            positions as columns (3, n) that returns it for each node, (n,); the gaps that meshes
            leave on curved faces, perhaps larger than the depth, are then ignored.
        pivot: (dim,), initial place of the point about which a rigid surface may turn, for
            `ContactProblem.of_residual` alone; nothing turns in axisymmetry.
        axis: (3,), in space only: direction, of any length, of the axis through the pivot.

    Raises:
        TypeError: for arguments of the wrong type, such as exchanged ones.
        ValueError: for a friction that is negative or not a number, an interference of a kind that
            the surface does not take, a pivot of a deformable body, or one in space without axis.
    """

    nodes: Part
    surface: Surface | MatchingNodes | DeformableSurface
    friction: float | Callable[[Array], Array] | Friction = 0.0
    motions: Motion | Sequence[Motion] = ()
    interference: bool | float | Callable[[Array], Array] = False
    pivot: Sequence[float] | None = None
    axis: Sequence[float] | None = None

    @defer_errors_if_parallel
    def __post_init__(self) -> None:
        _check_part("nodes", self.nodes, "ContactPair(nodes, surface)")
        bodies = (MatchingNodes, DeformableSurface)
        if self.pivot is not None and isinstance(self.surface, bodies):
            raise ValueError("a body has no pivot: what turns it are its supports")
        if (0 if self.pivot is None else len(arguments.check_vector("the pivot", self.pivot))) == 3:
            unit(list(arguments.check_vector("the axis of a pivot in space", self.axis, 3)))
        elif self.axis is not None:
            raise ValueError("an axis belongs to a pivot in space")
        if not (isinstance(self.surface, bodies) or _is_surface(self.surface)):
            raise TypeError(
                f"the surface of a contact pair is {arguments.describe(self.surface)}: it has to "
                "have a gap and a normal, or to be a DeformableSurface or MatchingNodes"
            )
        mu = self.law.mu if isinstance(self.law, Coulomb) else 0.0
        if isinstance(mu, type) or not (
            arguments.is_user_function(mu) or (arguments.is_number(mu) and 0 <= float(mu) < np.inf)  # type: ignore[arg-type]
        ):
            raise ValueError(
                f"friction = {mu!r}: it has to be a number that is finite and not negative, a "
                "function of positions, or a law of friction"
            )
        coincide = getattr(self.surface, "coincident", False)
        if (self.interference is True) if coincide else not isinstance(self.interference, bool):
            raise ValueError(
                "the interference is a depth where sides are coincident, whose own gaps do not "
                "count, and True or False elsewhere"
            )
        if not (
            arguments.is_user_function(self.interference) or isinstance(self.interference, bool)
        ):
            arguments.check_number("the interference", self.interference)
        motions = tuple(arguments.as_list(self.motions))
        for motion in motions:
            arguments.check_type(
                "a motion of a contact pair", motion, Motion, "it has to be a Motion"
            )
        object.__setattr__(self, "motions", motions)

    @property
    def law(self) -> Friction:
        """The law of friction: Coulomb's, unless another one is given."""
        if isinstance(self.friction, Friction) and not isinstance(self.friction, type):
            return self.friction
        return Coulomb(self.friction)

    def spin(self, dim: int) -> tuple[Array, Array]:
        """Pivot c (dim,) and matrix J (dim, dim) by which points turn: their velocity is J (x - c).

        Args:
            dim: of space; J is zero where there is no pivot.
        """
        arguments.check_integer("dim", dim, 2)
        if self.pivot is None:
            return np.zeros(dim), np.zeros((dim, dim))
        axis = (0.0, 0.0, 1.0) if self.axis is None else unit(self.axis)
        cross = np.asarray(np.cross(axis, np.eye(3)).T, dtype=float)
        return np.array(self.pivot, dtype=float), cross[:dim, :dim]


def _is_surface(thing: object) -> bool:
    both = all(callable(getattr(thing, name, None)) for name in ("gap", "normal"))
    return both and not isinstance(thing, type)


def _check_part(name: Literal["nodes", "facets"], part: object, call: str) -> None:
    """Raises TypeError for what names no nodes or facets."""
    if isinstance(part, MatchingNodes | DeformableSurface) or _is_surface(part):
        raise TypeError(f"a surface is given in place of {name}: {call} has them first")
    if isinstance(part, MeshTags):
        use = "tags.find(value)"
        if name == "nodes":
            use = f"those of the tagged facets, fem.locate_dofs_topological(space, tags.dim, {use})"
        raise TypeError(f"tags are given in place of {name}: use {use}")
    listed = isinstance(part, Sequence | np.ndarray) and not isinstance(part, str)
    if not (arguments.is_user_function(part) or listed):
        raise TypeError(
            f"the {name} are {arguments.describe(part)}: give a marker, numbers or a mask"
        )
