"""Input of contact problems: contact pairs and the motions of their surfaces."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from dolfinx.mesh import MeshTags

from pw_elements.arrays import Array
from pw_elements.checks import arguments, defer_errors_if_parallel
from pw_elements.contact.model.friction import Coulomb, Friction
from pw_elements.contact.model.surfaces import Surface, unit_vector
from pw_elements.spaces import Part


@dataclass(frozen=True)
class Motion:
    """Rigid motion of a surface from its initial position, at the end of one increment.

    At large sliding a surface whose pair has a pivot may also rotate about it, by any angle; the
    increment is then solved in substeps of at most an eighth of a turn. The pivot moves with the
    translation.

        ContactPair(top, Sphere((0, 1), 1), friction=0.3, pivot=(0, 1))
        Motion((0.4, None), force=(0, -20.0), rotation=-0.4)  # rolls to the right under a weight
        Motion((0.4, -0.1), rotation=None, torque=0.0)        # is dragged, on a frictionless shaft

    Args:
        translation: (dim,); None for a component that is free and follows from its force.
        force: (dim,), total force of the surface on the body in the free components (on the
            whole circumference in axisymmetry, where radial ones are sums of nodal forces round
            the axis), and zero in prescribed ones.
        rotation: angle in radians, right-handed about the pair's axis, in the plane
            anticlockwise; None if it is free and follows from its torque.
        torque: of the surface on the body about the current position of the pivot, if the rotation
            is free.

    Raises:
        ValueError: for values that are not finite numbers, a force and a translation of different
            sizes, or a force or torque on a prescribed component.
    """

    translation: Sequence[float | None]
    force: Sequence[float] | None = None
    rotation: float | None = 0.0
    torque: float = 0.0

    @defer_errors_if_parallel
    def __post_init__(self) -> None:
        for name in ("translation", "force"):
            vector = getattr(self, name)
            is_vector = isinstance(vector, Sequence) and not isinstance(vector, str | bytes)
            is_vector |= isinstance(vector, np.ndarray) and vector.ndim == 1
            if not is_vector and (vector is not None or name == "translation"):
                raise ValueError(f"{name} {vector!r} of a motion: it has to be a vector")
        if self.force is not None and len(self.force) != len(self.translation):
            raise ValueError("translation and force of a motion differ in length")
        for k, (motion, force) in enumerate(zip(*self._components, strict=True)):
            who, motion_name, force_name = f"component {k} of a motion", "translation", "force"
            if k == len(self.translation):
                who, motion_name, force_name = "a motion", "rotation", "torque"
            arguments.check_number(f"{who}'s {force_name}", force)
            if motion is not None:
                arguments.check_number(f"{who}'s {motion_name}", motion)
            if motion is not None and force:
                raise ValueError(
                    f"{who} has a {motion_name} and a {force_name}: one of them follows from the "
                    "other"
                )

    @property
    def _components(self) -> tuple[list[float | None], list[float]]:
        """Translation and rotation, and force and torque, (dim + 1) components each."""
        force = [0.0] * len(self.translation) if self.force is None else self.force
        return [*self.translation, self.rotation], [*force, self.torque]

    def translation_and_rotation(self) -> Array:
        """Return translation and angle (dim + 1,), NaN in free components."""
        return np.array([np.nan if u is None else u for u in self._components[0]], dtype=float)

    def force_and_torque(self) -> Array:
        """Return total force and torque (dim + 1,), zero where none is given."""
        return np.array(self._components[1], dtype=float)


@dataclass(frozen=True)
class MatchingNodes:
    """Another part of the boundary of the same mesh, with one node opposite to each of the pair's.

    It replaces the rigid surface in contact of two bodies (disconnected parts of one mesh) whose
    meshes match along the contact. A `Motion` is then a rigid motion of the opposite body in
    addition to its displacements: an approach of two supported bodies, prescribed or computed from
    a force.

    Args:
        nodes: nodes of the opposite part: a marker of positions as columns (3, n), local numbers,
            or a mask.
        shape: surface of the opposite part, as if it were rigid: its gap (n,) and its normal
            (n, dim) towards the pair's own nodes are evaluated at their positions (n, dim).
        offset: (dim,), from the pair's nodes to the opposite ones; zero by default.

    Raises:
        TypeError: for arguments of the wrong type, such as interchanged ones.
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
    """Another part of the boundary of the same mesh, whose nodes need not match the pair's.

    It replaces the rigid surface in contact of two bodies (disconnected parts of one mesh). The
    pair's own side is the slave of the mortar: contact is stated at its nodes, so that its mesh
    should be the finer one. A `Motion` is then a rigid motion of the master in addition to its
    displacements, as for `MatchingNodes`.

        materials = {STEEL: Material(210e3, 0.3), ALUMINIUM: Material(70e3, 0.33)}
        material = Material.by_tag(mesh, cell_tags, materials)
        body = Body(Spaces.petrov_galerkin(mesh), material, "plane strain")
        own = fem.locate_dofs_topological(body.spaces.trial, 1, facet_tags.find(FINE))
        pair = ContactPair(own, DeformableSurface(facet_tags.find(COARSE)), friction=0.2)

    `PairState` has results at the slave's nodes, and nodal forces of the master; `ContactFields`
    has pressures, gaps, slips and statuses of both. The theory page tells which quantities are
    exact ("Two bodies"). Large sliding needs `ContactProblem.of_residual`, in the plane or in
    axisymmetry.

    Args:
        where: facets: a marker of positions as columns (3, n) that holds at every vertex of a
            facet; or local numbers of facets, such as those of `MeshTags.find`; or a mask of all
            facets.
        revolved: whether areas are those of the whole circumference, as in axisymmetry. Required in
            two dimensions only, unless the stiffness is that of a `Body`, which records it.
        coincident: whether both sides are the same surface before any motion, such as those of a
            tube and its liner. Small gaps between the meshes of a curved surface are then ignored.

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
            such as those of `fem.locate_dofs_topological` for tagged facets, or a mask of these
            (ghosts are skipped, so that every process may pass all its nodes).
        surface: the rigid surface at its initial position, or the other part of the mesh, as
            `DeformableSurface` or `MatchingNodes`.
        friction: Coulomb's mu, or a function of positions as columns (3, n) that returns it for
            each node, (n,), or another law, see `Friction`. A node between a smooth and a rough
            part has the function's value at its position.
        motions: one per increment of `solve_contact`; a single one needs no list. Without motions
            the surface rests.
        interference: whether the surface may penetrate the body before any motion, as in a shrink
            fit; the first increment then pushes the nodes out of it. With a `coincident`
            `DeformableSurface` it is the nominal depth instead: a number, or a function of
            positions as columns (3, n) that returns it for each node, (n,); gaps between meshes of
            curved faces, which may exceed the depth, are then ignored.
        pivot: (dim,), initial position of the point about which a rigid surface may rotate, for
            `ContactProblem.of_residual` only; not in axisymmetry.
        axis: (3,), in space only: direction, of any length, of the axis through the pivot.

    Raises:
        TypeError: for arguments of the wrong type, such as interchanged ones.
        ValueError: for a friction that is negative or not a number, an interference of the wrong
            kind for the surface, a pivot of a deformable body, or one in space without axis.
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
            raise ValueError("a deformable body has no pivot: supports rotate it")
        if (0 if self.pivot is None else len(arguments.check_vector("the pivot", self.pivot))) == 3:
            unit_vector(list(arguments.check_vector("the axis of a pivot in space", self.axis, 3)))
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
                "the interference of coincident sides is a depth, as their gaps are ignored; that "
                "of other surfaces is True or False"
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
        """The friction law: Coulomb's, unless another one is given."""
        if isinstance(self.friction, Friction) and not isinstance(self.friction, type):
            return self.friction
        return Coulomb(self.friction)

    def pivot_and_spin(self, dim: int) -> tuple[Array, Array]:
        """Return pivot c (dim,) and matrix J (dim, dim); J (x - c) is the velocity of a point x.

        Args:
            dim: dimension of space. J is zero without a pivot.
        """
        arguments.check_integer("dim", dim, 2)
        if self.pivot is None:
            return np.zeros(dim), np.zeros((dim, dim))
        axis = (0.0, 0.0, 1.0) if self.axis is None else unit_vector(self.axis)
        cross = np.asarray(np.cross(axis, np.eye(3)).T, dtype=float)
        return np.array(self.pivot, dtype=float), cross[:dim, :dim]


def _is_surface(thing: object) -> bool:
    has_methods = all(callable(getattr(thing, name, None)) for name in ("gap", "normal"))
    return has_methods and not isinstance(thing, type)


def _check_part(name: Literal["nodes", "facets"], part: object, call: str) -> None:
    """Raise TypeError unless a part selects nodes or facets; `call` shows the right arguments."""
    if isinstance(part, MatchingNodes | DeformableSurface) or _is_surface(part):
        raise TypeError(f"a surface is given in place of {name}: {call} has them first")
    if isinstance(part, MeshTags):
        use = "tags.find(value)"
        if name == "nodes":
            use = f"those of the tagged facets, fem.locate_dofs_topological(space, tags.dim, {use})"
        raise TypeError(f"tags are given in place of {name}: use {use}")
    is_sequence = isinstance(part, Sequence | np.ndarray) and not isinstance(part, str)
    if not (arguments.is_user_function(part) or is_sequence):
        raise TypeError(
            f"the {name} are {arguments.describe(part)}: give a marker, numbers or a mask"
        )
