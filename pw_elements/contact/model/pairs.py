"""Input of contact problems: contact pairs and the motions of their surfaces."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from dolfinx import fem
from dolfinx.mesh import MeshTags

from pw_elements.arrays import Array, RealVector
from pw_elements.checks import arguments, defer_errors_if_parallel
from pw_elements.contact.model.friction import Coulomb, Friction
from pw_elements.contact.model.laws import InterfaceLaw
from pw_elements.contact.model.surfaces import Surface, unit_vector
from pw_elements.spaces import EntitySelection, separate_mesh


@dataclass(frozen=True)
class Motion:
    """Rigid motion of a surface from its initial position to its position after one increment.

    At large sliding, a surface whose pair has a pivot may rotate about the pivot by any angle. The
    increment is then solved in substeps of at most an eighth of a turn. The pivot moves with the
    translation.

        ContactPair(top, Sphere((0, 1), 1), friction=0.3, pivot=(0, 1))
        Motion((0.4, None), force=(0, -20.0), rotation=-0.4)  # rolls to the right under a weight
        Motion((0.4, -0.1), rotation=None, torque=0.0)        # is dragged, on a frictionless shaft

    Args:
        translation: (dim,), translation of the surface. A component that is None is free and
            follows from the force. In axisymmetry the radial component is the radial displacement
            of all points of the surface: it is 0 for a rigid surface, and another value changes
            its radius, as in an expanding mandrel. It must not be free.
        force: (dim,), total force of the surface on the body. It is given in the free components
            and is zero in the prescribed ones. In axisymmetry it is the force on the whole
            circumference.
        rotation: angle in radians. A positive angle is right-handed about the pair's axis in space,
            and anticlockwise in the plane. None means that the rotation is free and follows from
            the torque.
        torque: torque of the surface on the body about the current position of the pivot, if the
            rotation is free.

    Raises:
        ValueError: for values that are not finite numbers, for a force and a translation of
            different sizes, and for a force or torque on a prescribed component.
    """

    translation: Sequence[float | None] | RealVector
    force: RealVector | None = None
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
        for k, (motion, force) in enumerate(zip(*self._motion_and_force_components, strict=True)):
            who, motion_name, force_name = f"component {k} of a motion", "translation", "force"
            if k == len(self.translation):
                who, motion_name, force_name = "a motion", "rotation", "torque"
            arguments.check_finite_number(f"{who}'s {force_name}", force)
            if motion is not None:
                arguments.check_finite_number(f"{who}'s {motion_name}", motion)
            if motion is not None and force:
                raise ValueError(
                    f"{who} has a {motion_name} and a {force_name}: one of them follows from the "
                    "other"
                )

    @property
    def _motion_and_force_components(self) -> tuple[list[float | None], list[float]]:
        """Return two lists with dim + 1 entries: translation and rotation, force and torque."""
        force = [0.0] * len(self.translation) if self.force is None else self.force
        return [*self.translation, self.rotation], [*force, self.torque]

    def translation_and_rotation(self) -> Array:
        """Return the translation and the angle as an array (dim + 1,); free components are NaN."""
        return np.array(
            [np.nan if u is None else u for u in self._motion_and_force_components[0]], dtype=float
        )

    def force_and_torque(self) -> Array:
        """Return the total force and the torque as an array (dim + 1,), zero if not given."""
        return np.array(self._motion_and_force_components[1], dtype=float)


@dataclass(frozen=True)
class MatchingNodes:
    """Another part of the boundary of the mesh, with one opposite node for each node of the pair.

    It takes the place of the rigid surface in contact of two bodies whose meshes match along the
    contact. The bodies are disconnected parts of one mesh. A `Motion` of the pair is then a rigid
    motion of the opposite body, which is added to the displacements of that body. With it, two
    supported bodies can be moved towards each other by a prescribed distance, or under a force.

    Args:
        nodes: nodes of the opposite part, given by a marker of positions as columns (3, n), by
            local numbers, or by a mask.
        shape: rigid surface that coincides with the opposite part. Its gap (n,) and its normal
            (n, dim) towards the pair's own nodes are evaluated at the positions (n, dim) of the
            pair's own nodes.
        offset: (dim,), vector from each node of the pair to its opposite node; zero by default.

    Raises:
        TypeError: for arguments of the wrong type, for example in the wrong order.
        ValueError: for an offset that is not finite.
    """

    nodes: EntitySelection
    shape: Surface
    offset: RealVector | None = None

    @defer_errors_if_parallel
    def __post_init__(self) -> None:
        _check_part_selects_nodes_or_facets("nodes", self.nodes, "MatchingNodes(nodes, shape)")
        if not _is_surface(self.shape):
            raise TypeError(
                f"the shape of matching nodes is {arguments.describe_value_or_type(self.shape)}: "
                "it has to be a "
                "surface, with a gap and a normal"
            )
        if self.offset is not None:
            arguments.check_vector("the offset of matching nodes", self.offset)


@dataclass(frozen=True)
class DeformableSurface:
    """Another part of the boundary of the same mesh, whose nodes need not match the pair's nodes.

    It takes the place of the rigid surface in contact of two bodies, which are disconnected parts
    of one mesh. In the mortar method, the pair's own side is the slave and this part is the master.
    The contact conditions are stated at the slave's nodes, so the slave should have the finer mesh.
    A `Motion` of the pair is a rigid motion of the master, which is added to the displacements of
    the master's body.

        materials = {STEEL: Material(210e3, 0.3), ALUMINIUM: Material(70e3, 0.33)}
        material = Material.by_tag(mesh, cell_tags, materials)
        body = Body(Spaces.petrov_galerkin(mesh), material, "plane strain")
        own = fem.locate_dofs_topological(body.spaces.trial, 1, facet_tags.find(FINE))
        pair = ContactPair(own, DeformableSurface(facet_tags.find(COARSE)), friction=0.2)

    `PairState` has results at the slave's nodes, and the nodal forces on the master.
    `ContactFields` has pressures, gaps, slips and statuses of both sides. The theory page states
    which quantities are exact ("Two bodies"). Large sliding needs `ContactProblem.of_residual`.

    Args:
        where: facets of the master, given by a marker of positions as columns (3, n) that holds at
            every vertex of a facet, by local numbers of facets, as returned by `MeshTags.find`, or
            by a mask of all facets. If bodies have a mesh each, give the body's mesh and one of
            these.
        revolved: whether areas are those of the whole circumference, as in axisymmetry. The value
            is required in two dimensions only, and not if the stiffness has been assembled by a
            `Body`, which records it.
        coincident: whether both sides are the same surface before any motion, as in a tube and its
            liner. Small gaps between the meshes of a curved surface are then ignored.

    Raises:
        TypeError: for arguments of the wrong type.
    """

    where: EntitySelection
    revolved: bool | None = None
    coincident: bool = False

    @defer_errors_if_parallel
    def __post_init__(self) -> None:
        _check_part_selects_nodes_or_facets("facets", self.where, "DeformableSurface(where)")
        if self.revolved is not None:
            arguments.check_flag("revolved", self.revolved)
        arguments.check_flag("coincident", self.coincident)


@dataclass(frozen=True)
class ContactPair:
    """Nodes of a body that may touch a rigid surface, or another part of the mesh.

    Args:
        nodes: nodes of the pair, given by a marker of positions as columns (3, n), by local numbers
            of nodes in the space, as returned by `fem.locate_dofs_topological` for tagged facets,
            or by a mask of all local nodes. Ghosts are skipped, so that every process may pass all
            its nodes. If bodies have a mesh each, give the body's mesh and one of these, for
            example `(punch, nodes)`.
        surface: the rigid surface at its initial position, or the other part of the mesh as a
            `DeformableSurface` or `MatchingNodes`.
        friction: Coulomb's coefficient mu, or a function that takes positions as columns (3, n) and
            returns mu at each of them, (n,), or another law (see `Friction`). A node on the border
            between parts with and without friction has the function's value at its position.
        motions: motions of the surface, one for each increment of `solve_contact`. A single motion
            needs no list. Without motions, the surface remains in its initial position.
        interference: whether the surface may penetrate the body before any motion, as in a shrink
            fit. The first increment then pushes the nodes out of the surface. With a `coincident`
            `DeformableSurface` it is the nominal depth instead, given by a number or by a function
            that takes positions as columns (3, n) and returns the depth at each of them, (n,). Gaps
            between meshes of curved faces, which may exceed the depth, are then ignored.
        pivot: (dim,), initial position of the point about which a rigid surface may rotate. Only
            `ContactProblem.of_residual` allows a pivot, and not in axisymmetry.
        axis: (3,), direction of the axis of rotation through the pivot, in space only. It may have
            any length.
        interface_law: law of the forces between both sides, in place of unilateral contact with
            `friction`: an elastic layer, a tie, cohesion, contact with wear, or your own law (see
            `InterfaceLaw`).
        interface_fields: scalar functions of continuous Lagrange spaces on the mesh of the body, by
            name, for example {"temperature": T}. The interface law gets their values at the nodes
            as `InterfaceValues.fields`. They are read at the start of every increment.

    Raises:
        TypeError: for arguments of the wrong type, for example in the wrong order.
        ValueError: for a friction coefficient that is negative or not a number, an interference of
            the wrong kind for the surface, a pivot of a deformable surface, a pivot in space
            without an axis, an interface law with friction or a pivot, or interface fields
            without a law or in unsuitable spaces.
    """

    nodes: EntitySelection
    surface: Surface | MatchingNodes | DeformableSurface
    friction: float | Callable[[Array], Array] | Friction = 0.0
    motions: Motion | Sequence[Motion] = ()
    interference: bool | float | Callable[[Array], Array] = False
    pivot: RealVector | None = None
    axis: RealVector | None = None
    interface_law: InterfaceLaw | None = None
    interface_fields: Mapping[str, fem.Function] | None = None

    @defer_errors_if_parallel
    def __post_init__(self) -> None:
        _check_part_selects_nodes_or_facets("nodes", self.nodes, "ContactPair(nodes, surface)")
        self._check_interface_law()
        self._check_interface_fields()
        bodies = (MatchingNodes, DeformableSurface)
        if self.pivot is not None and isinstance(self.surface, bodies):
            raise ValueError("a deformable body has no pivot: supports rotate it")
        if (0 if self.pivot is None else len(arguments.check_vector("the pivot", self.pivot))) == 3:
            unit_vector(list(arguments.check_vector("the axis of a pivot in space", self.axis, 3)))
        elif self.axis is not None:
            raise ValueError("an axis belongs to a pivot in space")
        if not (isinstance(self.surface, bodies) or _is_surface(self.surface)):
            raise TypeError(
                "the surface of a contact pair is "
                f"{arguments.describe_value_or_type(self.surface)}: it has to "
                "have a gap and a normal, or to be a DeformableSurface or MatchingNodes"
            )
        mu = self.law.mu if isinstance(self.law, Coulomb) else 0.0
        if isinstance(mu, type) or not (
            arguments.is_user_function(mu)
            or (arguments.is_real_number(mu) and 0 <= float(mu) < np.inf)  # type: ignore[arg-type]
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
            arguments.check_finite_number("the interference", self.interference)
        motions = tuple(arguments.as_list(self.motions))
        for motion in motions:
            arguments.check_type(
                "a motion of a contact pair", motion, Motion, "it has to be a Motion"
            )
        object.__setattr__(self, "motions", motions)

    def _check_interface_law(self) -> None:
        law = self.interface_law
        if law is None:
            return
        if not isinstance(law, InterfaceLaw) or isinstance(law, type):
            raise TypeError(
                f"the interface law is {arguments.describe_value_or_type(law)}: it has to have "
                "n_history, initial_history and evaluate, as InterfaceLaw says"
            )
        arguments.check_integer("n_history of an interface law", law.n_history, 0)
        if not (arguments.is_real_number(self.friction) and self.friction == 0):
            raise ValueError(
                "a pair has an interface law and friction: give the friction to the law, as in "
                "interface_law=UnilateralContact(friction=0.3)"
            )
        if self.pivot is not None:
            raise ValueError(
                "a pair has an interface law and a pivot: laws are available for surfaces that do "
                "not turn"
            )

    def _check_interface_fields(self) -> None:
        fields = self.interface_fields
        if fields is None:
            return
        remedy = 'give a dictionary of functions by name, {"temperature": T}'
        arguments.check_type("interface_fields", fields, Mapping, remedy)
        if not fields:
            raise ValueError(f"interface_fields is empty: {remedy}, or leave it out")
        if self.interface_law is None:
            raise ValueError(
                "a pair has interface_fields and no interface law: the law is the function of the "
                "fields, so give it as interface_law"
            )
        for name, function in fields.items():
            arguments.check_type("a name of interface_fields", name, str, remedy)
            arguments.check_type(f"interface field {name!r}", function, fem.Function, remedy)
            if function.dtype != np.float64:
                raise ValueError(
                    f"interface field {name!r} has values of type {function.dtype}: give a "
                    "function of real numbers with double precision"
                )
            space = function.function_space
            if space.value_shape:
                raise ValueError(
                    f"interface field {name!r} has values of shape {tuple(space.value_shape)}: "
                    "give a scalar function, one for each component"
                )
            element = space.ufl_element()
            if element.family_name != "P" or element.discontinuous or element.degree < 1:
                raise ValueError(
                    f"interface field {name!r} is in {element}: its space has to be a continuous "
                    'Lagrange space, such as fem.functionspace(mesh, ("P", 1))'
                )

    @property
    def law(self) -> Friction:
        """Friction law of the pair, which is Coulomb's law unless another one is given."""
        if isinstance(self.friction, Friction) and not isinstance(self.friction, type):
            return self.friction
        return Coulomb(self.friction)

    def pivot_and_spin_matrix(self, dim: int) -> tuple[Array, Array]:
        """Return the pivot c (dim,) and the matrix J (dim, dim) of the axis of rotation.

        J (x - c) is the velocity of a point x at unit angular velocity. J is zero without a pivot.

        Args:
            dim: dimension of space.
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


def _check_part_selects_nodes_or_facets(
    expected_kind: Literal["nodes", "facets"], part: object, example_call: str
) -> None:
    """Raise TypeError unless `part` can select nodes or facets.

    `example_call` is an example of a correct call, which the message shows.
    """
    _, part = separate_mesh(part)  # type: ignore[arg-type]
    if isinstance(part, MatchingNodes | DeformableSurface) or _is_surface(part):
        raise TypeError(
            f"a surface is given in place of {expected_kind}: {example_call} has them first"
        )
    if isinstance(part, MeshTags):
        use = "tags.find(value)"
        if expected_kind == "nodes":
            use = f"those of the tagged facets, fem.locate_dofs_topological(space, tags.dim, {use})"
        raise TypeError(f"tags are given in place of {expected_kind}: use {use}")
    is_sequence = isinstance(part, Sequence | np.ndarray) and not isinstance(part, str)
    if not (arguments.is_user_function(part) or is_sequence):
        raise TypeError(
            f"the {expected_kind} are {arguments.describe_value_or_type(part)}: give a marker, "
            "numbers or a mask"
        )
