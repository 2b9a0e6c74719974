"""States of a contact computation: results, and data that the next increment needs."""

from dataclasses import dataclass
from typing import TypeAlias

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from pw_elements.arrays import Array, Indices
from pw_elements.solvers import SolverReport

FreeMotions: TypeAlias = tuple[tuple[int, int], ...]
NO_SOLVER_REPORT = SolverReport("nothing", 0)


@dataclass(frozen=True)
class PairState:
    """State of one pair at the end of one increment; its m nodes are sorted by position.

    Arrays are read-only and the same on every process.

    Args:
        position: (m, dim), undeformed, sorted by the first coordinate, then the next.
        normal: (m, dim), from the surface into the body.
        force_normal: (m,), nodal force along the normal; compression is positive.
        force_tangential: (m, dim), tangential part of the nodal force of the surface on the body,
            even if supports bear it. Where supports hold a node and the surface does not move along
            them, it is that of the increment's start, reduced to the limit of friction.
        gap: (m,), infinite for nodes that face nothing.
        slip: (m, dim), tangential displacement relative to the surface in this increment;
            zero for open nodes.
        path_slip: (m, dim), slip integrated along the straight path of the material points of both
            sides in this increment, by formulas that the law does not use; zero for open nodes. A
            warning is logged where it differs from the slip.
        friction: (m,), Coulomb's mu; for other laws the limit of friction over the normal force.
        status: (m,), OPEN, STICK or SLIP; or HELD, for nodes in rough contact with a deformable
            surface where supports prescribe the same motion of both sides: there is no friction
            along them. Nodes that supports move along a rigid surface slip if the surface moves
            differently.
        translation: (dim,) of the surface from its initial position.
        force: (dim,), total force of the surface on the body; in axisymmetry sums round the
            axis, so that the radial component is no resultant.
        rotation: (), angle of the surface about its pivot.
        torque: (), of the surface on the body about the current position of the pivot.
        displacement: (m, dim), of the nodes; relative to the opposite nodes where nodes match.
        direction: (m, dim), unit direction of the tangential force of slipping nodes, else zero.
        friction_ratio: (m,), ratio of the limit of friction to the trial friction at slipping
            nodes, from which the next increment's linearised law starts.
        node: (m,), global node numbers, valid for the current number of processes; component i of
            node k is entry dim k + i of `ContactState.displacement`.
        faced_node: (m,), global number of the node that each node faces; -1 for a rigid surface,
            -2 for a deformable one.
        opposite_node: (k,), global numbers of a deformable surface's nodes, sorted by position.
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
    friction_ratio: Array
    node: Indices
    faced_node: Indices
    opposite_node: Indices
    opposite_force: Array

    def __post_init__(self) -> None:
        for values in vars(self).values():
            values.flags.writeable = False

    @property
    def friction_capacity(self) -> float:
        """Sum of the largest tangential forces that the normal forces of this state admit."""
        return float(np.sum(self.friction * np.maximum(0.0, self.force_normal)))

    @property
    def force_vector(self) -> Array:
        """Nodal force (m, dim) of the surface on the body, with both its parts."""
        return self.force_normal[:, None] * self.normal + self.force_tangential


@dataclass(frozen=True)
class Residuals:
    """Largest violation of each contact condition over all nodes, relative to a scale.

    Forces are divided by the largest nodal contact force, lengths by the largest displacement of a
    contact node or its surface (for two bodies, of both), where the largest values of this state
    and of all earlier ones with contact count (`ResidualScale`). If these are only round-off,
    lengths are divided by the largest coordinate of a contact node, and forces by a node's
    stiffness times it.

    Residuals are evaluated from displacements, form or stiffness, surfaces and law, independently
    of the iteration. A state is returned only if each is at most 1e-9 plus its allowance, see
    `ContactState.allowance`: possible round-off, 1e-13 of displacements and 1e-15 of coordinates,
    and both times the stiffness; the noise of a surface's differences; and for lengths 1e-9 of the
    force over a node's stiffness. The allowance is large where a body is much stiffer than its
    supports, or moves far under small forces.

    Args:
        equilibrium: unbalanced force at all nodes but the contact nodes.
        penetration: -g where it is positive.
        tension: -r_n where it is positive.
        complementarity: smaller one of r_n and g, where both are positive.
        cone: |r_t| minus the limit l of friction (Coulomb's mu r_n), where it is positive.
        stick: smaller one of the slip |v| and of l - |r_t|.
        direction: | |v| r_t + l v |, over a force and a length or the slip: r_t opposes the slip.
        balance: total force (or torque over its arm) minus the prescribed one, on free motions.
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
        """Return the largest violation of any condition."""
        return max(vars(self).values())


@dataclass(frozen=True)
class ResidualScale:
    """Largest force and length in a history from the undeformed body on, during contact."""

    force: float = 0.0  # nodal contact force; 0 as long as it has been only round-off
    length: float = 0.0  # displacement of a contact node or its surface


@dataclass(frozen=True)
class Smallness:
    """Measures of displacements, equal to the relative size of neglected second-order terms.

    Args:
        strain: largest principal strain by magnitude; without the hoop strain u_r/r of bodies
            of revolution, since the stiffness does not tell whether a body is one.
        rotation: largest angle, in radians.
        slip: largest slip of a node in contact over the size of the smallest adjacent facet: in
            this increment against rigid surfaces, as contact is stated at their current position;
            since the undeformed body between two bodies, whose nodes keep their opposite parts.
    """

    strain: float = 0.0
    rotation: float = 0.0
    slip: float = 0.0


@dataclass(frozen=True)
class ContactState:
    """State of the body at the end of one increment, from which `ContactProblem.step` continues.

    `ContactProblem.save` writes a state to a file, for any number of processes.

    Args:
        displacement: full vector in the numbering of the displacements' space, which is the trial
            space unless that is hybrid.
        pairs: one state per contact pair.
        iterations: number of linear systems solved, including those of failed attempts and of
            substeps.
        unique: False if the determinants of the tangents that the problem has factorised so far
            (including those of a loaded state that was continued) differ in sign: friction is so
            large that several states may be in equilibrium with the same loads, and smaller
            increments may lead to another one. Also False if friction is exhausted, so that a body
            may slide without limit. None for solvers without determinants, and for
            `ContactProblem.of_residual`.
        residuals: of all conditions.
        allowance: part of each residual that round-off and noise explain, besides the tolerance of
            1e-9.
        report: report of the solver of this increment's linear systems.
        increment: number of increments since the undeformed body, where it is 0.
        free_motions: (pair, component) of the free motions of surfaces; component dim is the angle.
        determinant_signs: signs of the determinants that `unique` compares; for
            `ContactProblem.of_residual` that of the last tangent, which distinguishes unstable
            states from stable ones. Empty with `Iterative()`, which searches for negative
            eigenvalues of the preconditioned tangent by Arnoldi's method, without a proof.
        scale: force and length by which `residuals` are divided.
        smallness: largest strain, rotation and slip; a warning is logged when they leave the range
            of small displacements. None for `ContactProblem.of_residual`, where they may be large.
        substates: (load factor, state) at the end of each substep but the last one, if the
            increment was cut (see `ContactProblem`); the factor is 0 at the loads and motions
            before the increment and 1 at its own. `slip` and `iterations` of this state are sums
            over all substeps. Files do not include substates.
        converged: False for the `state` of an error, which is no solution and from which no
            increment can start.
        unknowns: full vector (n,) in the trial space's numbering; `split` gives displacement and
            pressure of a hybrid space. By default the displacement.
        history: values on this process of each function in the `history` of a residual.
    """

    displacement: PETSc.Vec
    pairs: tuple[PairState, ...]
    iterations: int = 0
    unique: bool | None = None
    residuals: Residuals = Residuals()
    allowance: Residuals = Residuals()
    report: SolverReport = NO_SOLVER_REPORT
    increment: int = 0
    free_motions: FreeMotions = ()
    determinant_signs: frozenset[int] = frozenset()
    scale: ResidualScale = ResidualScale()
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
        """Translations (pairs, dim) of all surfaces from their initial positions."""
        return np.array([pair.translation for pair in self.pairs])

    @property
    def placements(self) -> Array:
        """Translations and, in the last column, angles of all surfaces, (pairs, dim + 1)."""
        return np.array([[*pair.translation, pair.rotation] for pair in self.pairs])
