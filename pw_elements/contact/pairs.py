"""What the user states: contact pairs and the motions of their surfaces."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from pw_elements.contact.surfaces import Surface
from pw_elements.mechanics import Marker, Part

Array = npt.NDArray[np.float64]
# Marker of positions (3, n), or local numbers, or a mask of these
Nodes: TypeAlias = Marker | npt.NDArray[np.int32] | npt.NDArray[np.bool_]


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
class MatchingNodes:
    """Another part of the same mesh's boundary, each node of which faces one of the pair's.

    It takes the place of a rigid surface, for two bodies (disconnected parts of one mesh) whose
    meshes match along the contact. What a `Motion` says of a rigid surface, it says of a rigid
    motion that the opposite body makes in addition to its displacements: a given or, under a
    given force, free approach of two bodies that are both supported.

    Args:
        nodes: of the opposite part, as `ContactPair.nodes`.
        shape: what a rigid surface in the opposite part's place would be: gap (n,) to it and
            normal (n, dim) towards the pair's own nodes, at their positions (n, dim).
        offset: (dim,), from the pair's nodes to the ones that they face; zero unless given.
    """

    nodes: Nodes
    shape: Surface
    offset: Sequence[float] | None = None


@dataclass(frozen=True)
class DeformableSurface:
    """Another part of the same mesh's boundary, whose nodes need not face the pair's.

    It takes the place of a rigid surface, for two bodies (disconnected parts of one mesh). The
    pair's own side is the mortar's slave: contact is stated at its nodes, so the finer mesh
    should be the pair's. What a `Motion` says of a rigid surface, it says of a rigid motion that
    this side makes in addition to its displacements, as for `MatchingNodes`.

    Args:
        where: marker of positions (3, n), which holds at every vertex of a facet, or facets.
        revolved: whether areas are round the axis of the first coordinate's origin.
    """

    where: Part
    revolved: bool = False


@dataclass(frozen=True)
class ContactPair:
    """Nodes of the body that may touch a rigid surface, or the nodes of another part of it.

    Args:
        nodes: marker of their positions (3, n), or their local numbers in the space, such as
            `fem.locate_dofs_topological` gives for tagged facets, or a mask of these (ghosts are
            passed over, so that every process may give all it knows).
        surface: the rigid surface at its initial place, or what faces the nodes instead.
        friction: Coulomb's mu, or a function of positions (3, n) that gives it per node. A
            node between a smooth and a rough part is thereby assigned to one of them.
        motions: one per increment of `solve_contact`; the surface rests where there are none.
    """

    nodes: Nodes
    surface: Surface | MatchingNodes | DeformableSurface
    friction: float | Callable[[Array], Array] = 0.0
    motions: Sequence[Motion] = ()
