"""States of a contact computation: results, and all that the next increment has to know."""

from dataclasses import dataclass
from typing import TypeAlias

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from pw_elements.arrays import Array, Indices
from pw_elements.solvers import SolverReport

Free: TypeAlias = tuple[tuple[int, int], ...]
NOTHING_DONE = SolverReport("nothing", 0)


@dataclass(frozen=True)
class PairState:
    """One pair at the end of one increment; its m nodes in the order of their positions.

    Arrays are read-only and the same on every process.

    Args:
        position: (m, dim), undeformed, sorted by the first coordinate, then the next.
        normal: (m, dim), from the rigid surface into the body.
        force_normal: (m,), nodal force along the normal; compression is positive.
        force_tangential: (m, dim), the rest of the nodal force of the surface on the body, be it
            borne by supports. Where these hold a node and the surface rests along them, it is what
            it was before the increment, within its limit.
        gap: (m,), infinite for nodes that nothing faces.
        slip: (m, dim), tangential displacement relative to the surface in this increment;
            zero for open nodes.
        path_slip: (m, dim), the same from the straight path of the material points of both sides
            in this increment, by other formulas than the law's; zero for open nodes. A warning is
            logged where both are apart.
        friction: (m,), Coulomb's mu; of another law its limit over the normal force.
        status: (m,), OPEN, STICK or SLIP; or HELD, of nodes in rough contact with a deformable
            surface where supports move both sides alike: there is no friction along them. Nodes
            that supports move along a rigid surface slip where the surface moves otherwise.
        translation: (dim,) of the surface from its initial place.
        force: (dim,), total force of the surface on the body; in axisymmetry sums round the
            axis, so that the radial one is no resultant.
        rotation: (), angle of the surface about its pivot.
        torque: (), of the surface on the body about the pivot's present place.
        displacement: (m, dim), of the nodes; relative to what they face where nodes match.
        direction: (m, dim), unit direction of the tangential force of slipping nodes, else zero.
        turning: (m,), of the law's linearisation at slipping nodes, which the next iteration needs.
        node: (m,), global node numbers, valid for the present number of processes; component i of
            node k is entry dim k + i of `ContactState.displacement`.
        faced: (m,), global number of the node that each of them faces; -1 where it faces a rigid
            surface, -2 where a deformable one.
        opposite: (k,), global numbers of a deformable surface's nodes, sorted by position.
        opposite_force: (k, dim), nodal forces on these.
    """

    position: Array
    normal: Array
    force_normal: Array
    force_tangential: Array
    gap: Array
    slip: Array
    path_slip: Array
    friction: Array
    status: npt.NDArray[np.int8]
    translation: Array
    force: Array
    rotation: Array
    torque: Array
    displacement: Array
    direction: Array
    turning: Array
    node: Indices
    faced: Indices
    opposite: Indices
    opposite_force: Array

    def __post_init__(self) -> None:
        for values in vars(self).values():
            values.flags.writeable = False

    @property
    def friction_capacity(self) -> float:
        """Sum of the largest tangential forces beside the normal forces of this state."""
        return float(np.sum(self.friction * np.maximum(0.0, self.force_normal)))

    @property
    def force_vector(self) -> Array:
        """Nodal force (m, dim) of the surface on the body, its normal part and the rest."""
        return self.force_normal[:, None] * self.normal + self.force_tangential


@dataclass(frozen=True)
class Residuals:
    """How well each condition is satisfied: the largest violation over all nodes.

    Forces are divided by the largest nodal contact force, lengths by the largest displacement of a
    contact node or its surface (of two bodies: of both together), each the largest of this state
    and of all earlier ones with contact (`Scale`). Where these are only round-off, lengths are
    divided by the largest coordinate of a contact node, and forces by a node's stiffness times it.

    They are computed anew from displacements, form or stiffness, surfaces and law: nothing of the
    iteration enters. No state is returned of which one exceeds 1e-9 plus its allowance, which
    `ContactState.allowance` has: possible round-off, 1e-13 of displacements and 1e-15 of
    coordinates, and of both times the stiffness; the noise of a surface's differences; and
    for lengths 1e-9 of the force over a node's stiffness. It is large where a body is far stiffer
    than what holds it, or moves far under small forces.

    Args:
        equilibrium: unbalanced force at all other nodes than the pairs' own.
        penetration: -g where it is positive.
        tension: -r_n where it is positive.
        complementarity: smaller of r_n and g, where both are positive.
        cone: |r_t| less the limit of friction (Coulomb's mu r_n), where it is positive.
        stick: smaller of the slip |v| and of what |r_t| lacks to the limit l.
        direction: | |v| r_t + l v |, over a force and a length or the slip: r_t opposes the slip.
        balance: total force (or torque over its arm) less the one given, on free motions.
    """

    equilibrium: float = 0.0
    penetration: float = 0.0
    tension: float = 0.0
    complementarity: float = 0.0
    cone: float = 0.0
    stick: float = 0.0
    direction: float = 0.0
    balance: float = 0.0

    def largest(self) -> float:
        """The largest violation of any condition."""
        return max(vars(self).values())


@dataclass(frozen=True)
class Scale:
    """Largest force and length of a history from the undeformed body on, while there is contact."""

    force: float = 0.0  # nodal contact force; 0 as long as it was nothing but round-off
    length: float = 0.0  # displacement of a contact node or its surface


@dataclass(frozen=True)
class Smallness:
    """How small displacements are: neglected second-order terms are of this relative size.

    Args:
        strain: largest principal strain by magnitude; without the hoop strain u_r/r of bodies
            of revolution, since the stiffness does not tell what it is of.
        rotation: largest angle, in radians.
        slip: largest slip of a node in contact over the size of the smallest facet around it: of
            this increment against rigid surfaces, which are met where they are now; from the
            undeformed body on between two bodies, whose nodes keep their partners.
    """

    strain: float = 0.0
    rotation: float = 0.0
    slip: float = 0.0


@dataclass(frozen=True)
class ContactState:
    """The body at the end of one increment; `ContactProblem.step` continues from it.

    `ContactProblem.save` writes a state to a file, for any number of processes.

    Args:
        displacement: full vector in the numbering of the displacements' space, which is the trial
            space unless that is hybrid.
        pairs: one state per contact pair.
        iterations: linear systems solved, including those of failed attempts and of parts.
        unique: False if the determinants of the tangents that the problem has factorised so far
            (and those on the way to a loaded state) differ in sign: friction is so large that
            several states may be in equilibrium with the same loads, and smaller increments may
            lead to another one. False, too, if friction is used up, so that a body may slide on for
            ever. None by a solver without determinants, and of `ContactProblem.of_residual`.
        residuals: of all conditions.
        allowance: what of each residual may be round-off or noise, beside the tolerance of 1e-9.
        report: what solved the linear systems of this increment.
        increment: number of increments from the undeformed body, where it is 0.
        free: (pair, component) of the surfaces' free translations; component dim is the angle.
        orientations: signs of the determinants that `unique` compares; of
            `ContactProblem.of_residual` that of the last tangent, by which an unstable state is
            told from a stable one. Empty with `Iterative()`, which looks for negative
            eigenvalues of the preconditioned tangent by Arnoldi's method: no proof.
        scale: what `residuals` are relative to.
        smallness: largest strain, rotation and slip; a warning is logged when they leave the range
            of small displacements. None for `ContactProblem.of_residual`, where they may be large.
        substates: (share, state) at the end of each part but the last, if the increment was cut
            into parts (see `ContactProblem`); the share runs from 0 at the loads and motions before
            the increment to 1 at its own. This state's `slip` and `iterations` are those of all
            parts together. Files do not include substates.
        converged: False in the `state` of an error, which is no solution: nothing can continue from
            it.
        unknowns: full vector (n,) in the trial space's numbering; `split` gives displacement and
            pressure of a hybrid one. By default the displacement.
        history: of a residual's `history`, the values of each function on this process.
    """

    displacement: PETSc.Vec
    pairs: tuple[PairState, ...]
    iterations: int = 0
    unique: bool | None = None
    residuals: Residuals = Residuals()
    allowance: Residuals = Residuals()
    report: SolverReport = NOTHING_DONE
    increment: int = 0
    free: Free = ()
    orientations: frozenset[int] = frozenset()
    scale: Scale = Scale()
    smallness: Smallness | None = Smallness()
    converged: bool = True
    substates: tuple[tuple[float, "ContactState"], ...] = ()
    unknowns: PETSc.Vec = None
    history: tuple[Array, ...] = ()

    def __post_init__(self) -> None:
        if self.unknowns is None:
            object.__setattr__(self, "unknowns", self.displacement)

    @property
    def translations(self) -> Array:
        """Translations (pairs, dim) of all pairs' surfaces from their initial places."""
        return np.array([pair.translation for pair in self.pairs])

    @property
    def placements(self) -> Array:
        """Translations and, last, angles (pairs, dim + 1) of all pairs' surfaces."""
        return np.array([[*pair.translation, pair.rotation] for pair in self.pairs])
