"""States of a contact computation, with results and with data that the next increment needs."""

from dataclasses import dataclass
from typing import TypeAlias

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from pw_elements.arrays import Array, Indices, Mask
from pw_elements.solvers import SolverReport

FreeMotionIndices: TypeAlias = tuple[tuple[int, int], ...]
EMPTY_SOLVER_REPORT = SolverReport("nothing", 0)
# Largest slip of a node that counts as sticking, relative to the largest displacement in contact
_MAX_SLIP_OF_STICKING_NODE_PER_LENGTH = 1e-9


@dataclass(frozen=True)
class PairState:
    """State of one pair at the end of one increment; its m nodes are sorted by position.

    Arrays are read-only and the same on every process.

    Args:
        position: (m, dim), undeformed positions of the nodes, sorted by the first coordinate, then
            by the next.
        normal: (m, dim), unit normals from the surface into the body.
        force_normal: (m,), nodal forces along the normals; compression is positive.
        force_tangential: (m, dim), tangential parts of the nodal forces of the surface on the body,
            even if supports carry them. Where supports hold a node and the surface does not move
            along the supports, it is the tangential force at the start of the increment, reduced to
            the limit of friction.
        gap: (m,), gaps between nodes and surface, infinite for nodes that face nothing.
        slip: (m, dim), tangential displacements relative to the surface in this increment, zero for
            open nodes.
        path_slip: (m, dim), slips integrated along the straight paths of the material points of
            both sides in this increment, zero for open nodes. The formulas are independent of those
            in the contact law. A warning is logged where the values differ from `slip`.
        friction: (m,), Coulomb's coefficient mu. For other laws it is the limit of friction divided
            by the normal force.
        status: (m,), OPEN, STICK, SLIP or HELD. Nodes of pairs with an interface law are OPEN if
            they have no force, and STICK otherwise. Nodes in frictional contact with a deformable
            surface are HELD where supports prescribe the same motion of both sides, so that there
            is no friction along the supports. Nodes that supports move along a rigid surface slip
            if the surface moves differently.
        translation: (dim,), translation of the surface from its initial position.
        force: (dim,), total force of the surface on the body. In axisymmetry, components are sums
            of nodal forces round the axis, so that the radial component is not a resultant.
        rotation: (), angle of the surface about its pivot.
        torque: (), torque of the surface on the body about the current position of the pivot.
        displacement: (m, dim), displacements of the nodes. For `MatchingNodes` they are relative to
            the opposite nodes.
        direction: (m, dim), unit vectors along the tangential forces of slipping nodes, zero at
            other nodes.
        friction_ratio: (m,), ratio of the limit of friction to the trial friction at slipping
            nodes. The linearised law of the next increment starts from it.
        node: (m,), global node numbers, valid for the current number of processes. Component i of
            node k is entry dim k + i of `ContactState.displacement`.
        faced_node: (m,), global number of the node that each node faces, -1 if it faces a rigid
            surface, and -2 if it faces a deformable surface with many nodes.
        opposite_node: (k,), global numbers of the nodes of a deformable surface, sorted by
            position.
        opposite_force: (k, dim), nodal forces on the nodes of a deformable surface.
        law_history: (m, dim + h), for pairs with an interface law: slips since the undeformed state
            in global components, followed by the history variables of the law. If several pairs
            have laws, h is the largest number of their variables. It is (m, 0) if no pair has a
            law.
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
    law_history: Array

    def __post_init__(self) -> None:
        for values in vars(self).values():
            values.flags.writeable = False

    @property
    def friction_capacity(self) -> float:
        """Sum of the limits of friction of all nodes at the normal forces of this state."""
        return float(np.sum(self.friction * np.maximum(0.0, self.force_normal)))

    @property
    def force_vector(self) -> Array:
        """Nodal forces (m, dim) of the surface on the body, with normal and tangential parts."""
        return self.force_normal[:, None] * self.normal + self.force_tangential


@dataclass(frozen=True)
class Residuals:
    """Largest violation of each contact condition at any node, relative to a force or length.

    Forces are divided by the largest nodal contact force. Lengths are divided by the largest
    displacement of a contact node or of its surface (for two bodies, of both sides). The largest
    values of this state and of all earlier states with contact are used (`ResidualScale`). If the
    largest values are only round-off, lengths are divided by the largest coordinate of a contact
    node, and forces by this coordinate times a node's stiffness.

    Residuals are evaluated from displacements, form or stiffness, surfaces and law, independently
    of the iteration. A state is returned only if each residual is at most 1e-9 plus its allowance
    (`ContactState.allowance`). The allowance has several parts. One part is possible round-off:
    1e-13 of displacements and 1e-15 of coordinates, multiplied by the stiffness if the residual is
    a force. Another part is the noise of a surface whose derivatives are finite differences. The
    allowance of lengths also includes 1e-9 times the force divided by a node's stiffness. The
    allowance is large where a body is much stiffer than its supports, or moves far under small
    forces.

    In the following, g is the gap, r_n the normal and r_t the tangential force, v the slip and l
    the limit of friction, which is mu r_n for Coulomb's law. Each violation is a magnitude.

    Args:
        equilibrium: unbalanced force at all nodes that are not contact nodes.
        penetration: -g, where the gap is negative.
        tension: -r_n, where the normal force is negative.
        complementarity: the smaller of r_n and g, where both are positive.
        cone: |r_t| - l, where it is positive.
        stick: the smaller of |v| and l - |r_t|, where both are positive.
        direction: | |v| r_t + l v |, which vanishes if r_t opposes the slip. It is divided by a
            force, and by a length or by the slip if this is larger.
        balance: difference between total and prescribed force of each free motion of a surface.
            For free rotations it is the difference of torques divided by the lever arm.
        law: difference between the force and that of the interface law, at nodes with such a law.
            For laws that are stiffer than the body at the node, it is divided by the ratio of both
            stiffnesses. The conditions of unilateral contact do not count at these nodes.
    """

    equilibrium: float = 0.0
    penetration: float = 0.0
    tension: float = 0.0
    complementarity: float = 0.0
    cone: float = 0.0
    stick: float = 0.0
    direction: float = 0.0
    balance: float = 0.0
    law: float = 0.0

    def largest(self) -> float:
        """Return the largest of all residuals."""
        return max(vars(self).values())


@dataclass(frozen=True)
class ResidualScale:
    """Largest force and length that have occurred during contact since the undeformed state."""

    force: float = 0.0  # largest nodal contact force; 0 if all forces have been only round-off
    length: float = 0.0  # largest displacement of a contact node or its surface


@dataclass(frozen=True)
class SmallDisplacementMeasures:
    """Measures of how small displacements are.

    Each measure is of the order of the neglected second-order terms relative to the first-order
    terms.

    Args:
        strain: largest magnitude of a principal strain. The hoop strain u_r/r of bodies of
            revolution is not included, since the stiffness does not show whether a body is
            axisymmetric.
        rotation: largest angle of rotation in the body, in radians.
        slip: largest slip of a node in contact, divided by the size of the smallest adjacent facet.
            Against rigid surfaces it is the slip in this increment, since contact is evaluated at
            the current positions of the surfaces. Between two bodies it is the slip since the
            undeformed state, since nodes keep their opposite facets.
    """

    strain: float = 0.0
    rotation: float = 0.0
    slip: float = 0.0


@dataclass(frozen=True)
class ContactState:
    """State of the body at the end of one increment, from which `ContactProblem.step` continues.

    `ContactProblem.save` writes a state to a file, which can be read on any number of processes.

    Args:
        displacement: full vector in the numbering of the space of displacements. This is the trial
            space, or its displacement part if the trial space is hybrid.
        pairs: one state per contact pair.
        iterations: number of linear systems that have been solved, including the systems of failed
            attempts and of substeps.
        unique: False in two cases, in which the solution may not be unique. In the first case, the
            determinants of all tangent matrices that the problem has factorised so far differ in
            sign. If the problem has continued from a loaded state, the determinants of that state
            count. Friction is then so large that several states may be in equilibrium with the same
            loads, and smaller increments may lead to another state. In the second case, friction is
            exhausted, so that a body may slide without limit. None for solvers without
            determinants, and for `ContactProblem.of_residual`. It says nothing about the friction
            at nodes in several pairs, see `find_undetermined_friction`.
        residuals: violations of all contact conditions.
        allowance: part of each residual that round-off and noise explain. It is added to the
            tolerance of 1e-9.
        report: report of the solver of this increment's linear systems.
        increment: number of increments since the undeformed state, which has number 0.
        free_motions: (pair, component) of each free motion of a surface. Component dim is the
            angle.
        determinant_signs: signs of the determinants that `unique` compares. For
            `ContactProblem.of_residual` it is the sign of the last tangent's determinant, which
            distinguishes unstable states from stable ones. It is empty with `Iterative()`, which
            searches for negative eigenvalues of the preconditioned tangent by Arnoldi's method; the
            search may miss some of them.
        scale: force and length by which `residuals` are divided.
        smallness: largest strain, rotation and slip. A warning is logged when they leave the range
            of small displacements. None for `ContactProblem.of_residual`, where they may be large.
        substates: fraction of the increment and state at the end of each substep except the last,
            if the increment was solved in substeps (see `ContactProblem`). The fraction is 0 for
            the loads and motions before the increment, and 1 for those of the increment. `slip` and
            `iterations` of this state are sums over all substeps. Files do not include substates.
        converged: False for the `state` of a `ContactFailed` and for frames of an impact. They are
            not solutions, and no increment can start from them.
        unknowns: full vector (n,) in the numbering of the trial space. `split` returns displacement
            and pressure of a hybrid space. By default `unknowns` is the displacement.
        history: values on this process of each function in the `history` of a residual.
    """

    displacement: PETSc.Vec
    pairs: tuple[PairState, ...]
    iterations: int = 0
    unique: bool | None = None
    residuals: Residuals = Residuals()
    allowance: Residuals = Residuals()
    report: SolverReport = EMPTY_SOLVER_REPORT
    increment: int = 0
    free_motions: FreeMotionIndices = ()
    determinant_signs: frozenset[int] = frozenset()
    scale: ResidualScale = ResidualScale()
    smallness: SmallDisplacementMeasures | None = SmallDisplacementMeasures()
    converged: bool = True
    substates: tuple[tuple[float, "ContactState"], ...] = ()
    unknowns: PETSc.Vec = None
    history: tuple[Array, ...] = ()

    def __post_init__(self) -> None:
        if self.unknowns is None:
            object.__setattr__(self, "unknowns", self.displacement)

    def find_undetermined_friction(self) -> tuple[Mask, ...]:
        """Return for each pair a mask (m,) of the nodes whose friction the law does not determine.

        If several surfaces press a node, equilibrium gives only the sum of their forces. A force
        with friction that does not slip may then have many values. The state has one of them, which
        docs/theory.md ("Nodes in several pairs") defines. Displacements, the sum of the forces at
        each node, gaps and slips do not depend on the choice; the forces of single pairs do.
        Interface laws do not count: where several ties or other laws without a finite stiffness
        hold a node, the section says how they share the sum.
        """
        pressed = [pair.force_normal > 0 for pair in self.pairs]
        nodes = np.concatenate([pair.node[p] for pair, p in zip(self.pairs, pressed, strict=True)])
        number, count = np.unique(nodes, return_counts=True)
        shared_nodes = number[count > 1]
        max_slip = _MAX_SLIP_OF_STICKING_NODE_PER_LENGTH * self.scale.length
        return tuple(
            is_pressed
            & np.isin(pair.node, shared_nodes)
            & (pair.friction > 0)
            & (np.linalg.norm(pair.slip, axis=1) <= max_slip)
            for pair, is_pressed in zip(self.pairs, pressed, strict=True)
        )

    @property
    def translations(self) -> Array:
        """Translations (pairs, dim) of all surfaces from their initial positions."""
        return np.array([pair.translation for pair in self.pairs])

    @property
    def translations_and_rotations(self) -> Array:
        """Motions (pairs, dim + 1) of all surfaces: translations, and angles in the last column."""
        return np.array([[*pair.translation, pair.rotation] for pair in self.pairs])
