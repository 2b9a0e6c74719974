"""Search for a state among all statuses of contact nodes, for plane problems.

The search is branch and bound. A branch allows each node some of the four statuses open, sticking,
slipping forwards and slipping backwards along its tangent. The conditions that these statuses have
in common are linear in the motions z of nodes and surfaces:

    r_n >= 0,  g >= 0,  |r_t| <= mu r_n    always,
    r = 0                                  at nodes that can only be open,
    g = 0                                  at nodes that cannot be open,
    v >= 0,  r_t = -mu r_n                 at nodes that can only slip forwards,

and so on. Here r_n and r_t are the normal and tangential force, g the gap, v the slip and mu the
friction coefficient. A linear program finds the smallest violation of these conditions. If they
cannot all hold, the branch is discarded. If they can, Newton's method starts from the solution of
the linear program. If it finds no state, a node is selected at which this solution violates
r_n g = 0 or the direction of friction, and its statuses are split between two branches.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linprog

# Sets of statuses that a branch may allow, and the two subsets into which each set is split
(
    ANY_STATUS,
    OPEN_ONLY,
    CLOSED_ONLY,
    NOT_SLIPPING_FORWARDS,
    SLIPPING_FORWARDS,
    STICKING,
    SLIPPING_BACKWARDS,
) = range(7)
STATUS_SET_SPLITS = {
    ANY_STATUS: (OPEN_ONLY, CLOSED_ONLY),
    CLOSED_ONLY: (NOT_SLIPPING_FORWARDS, SLIPPING_FORWARDS),
    NOT_SLIPPING_FORWARDS: (STICKING, SLIPPING_BACKWARDS),
}
INFEASIBLE_VIOLATION_OVER_LARGEST_FORCE, ZERO_VIOLATION_OVER_LARGEST_FORCE = (
    1e-7,
    1e-9,
)  # violations above the first value discard a branch; those below the second count as zero
MAX_CANDIDATE_NODES_PER_BRANCHING, MAX_NEWTON_STEPS, MAX_NEWTON_STARTS = 3, 8, 200
# limit of the search, which takes some ten seconds
MAX_LINEAR_PROGRAMS_TIMES_NODES_SQUARED = 2_500_000
LINPROG_TOLERANCES = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}


@dataclass(frozen=True)
class LinearIncrement:
    """An increment in which forces, gaps and slips at n nodes are linear in unknown motions z (k,).

    Each field of shape (n, k + 1) is a matrix whose product with (z; 1) is the quantity.

    Args:
        normal: normal forces r_n (n, k + 1).
        shear: tangential forces r_t (n, k + 1), zero if a support prescribes the tangential motion.
        gap: gaps (n, k + 1) at nodes that a surface faces.
        slip: slips (n, k + 1) along the tangents since the increment's start.
        balance: contact force minus prescribed force (b, k + 1) for each free translation of a
            surface, zero in equilibrium.
        mu: friction coefficients (n,).
        faced: mask (n,) of the nodes that a surface faces.
        stiffness: stiffness of a node, which converts lengths into forces.
    """

    normal: np.ndarray
    shear: np.ndarray
    gap: np.ndarray
    slip: np.ndarray
    balance: np.ndarray
    mu: np.ndarray
    faced: np.ndarray
    stiffness: float


def find_state_by_status_search(
    increment: LinearIncrement,
    max_linear_programs_times_nodes_squared: float = MAX_LINEAR_PROGRAMS_TIMES_NODES_SQUARED,
) -> np.ndarray | None:
    """Return the motions z (k,) of a state that obeys the law, or None if none is found.

    The search is limited by `max_linear_programs_times_nodes_squared`, the number of linear
    programs times the squared number of nodes.
    """
    conditions = _BranchConditions(increment)
    max_programs = max_linear_programs_times_nodes_squared / max(1, len(conditions.faced)) ** 2
    root = np.zeros(len(conditions.faced), dtype=np.int8)
    root_z = conditions.motions_of_smallest_violation(root)
    open_branches = [] if root_z is None else [(root, root_z)]
    n_programs, n_newton_starts = 1, 0
    while open_branches and n_programs <= max_programs:
        codes, z = open_branches.pop()
        if n_newton_starts < MAX_NEWTON_STARTS:
            n_newton_starts += 1
            state = _find_state_by_newton(increment, z)
            if state is not None:
                return state
        branches = []
        for k in conditions.nodes_to_split(codes, z):
            children = [
                (child, conditions.motions_of_smallest_violation(child))
                for child in _split_status_set_at_node(codes, k)
            ]
            n_programs += len(children)
            feasible = [(child, child_z) for child, child_z in children if child_z is not None]
            if len(feasible) < len(children):
                branches = feasible
                break
            branches = branches or feasible
        open_branches += sorted(
            branches, key=lambda branch: -conditions.law_violation_per_node(*branch).sum()
        )
    return None


def _split_status_set_at_node(status_sets: np.ndarray, node: int) -> Iterator[np.ndarray]:
    """Yield, for each of two branches, the status sets (n,) after splitting the set of a node."""
    for code in STATUS_SET_SPLITS[int(status_sets[node])]:
        child = status_sets.copy()
        child[node] = code
        yield child


def _find_state_by_newton(increment: LinearIncrement, motions: np.ndarray) -> np.ndarray | None:
    """Return the motions of a state found by Newton's method from the given motions, or None."""
    rows = (increment.normal, increment.shear, increment.gap, increment.slip)
    c, mu, faced = increment.stiffness, increment.mu, increment.faced
    has_friction = faced & (mu > 0) & np.any(increment.shear != 0, axis=1)
    for _ in range(MAX_NEWTON_STEPS):
        r_n, r_t, gap, slip = (part @ np.append(motions, 1.0) for part in rows)
        trial_normal, trial_shear = r_n - c * gap, r_t - c * slip
        if _satisfies_law(increment, motions, has_friction):
            return motions
        closed = faced & (trial_normal > 0)
        sticks = has_friction & closed & (np.abs(trial_shear) <= mu * trial_normal)
        signed_mu = np.where(has_friction & closed, np.sign(trial_shear) * mu, 0.0)[:, None]
        equations = np.concatenate(
            [
                np.where(closed[:, None], c * increment.gap, increment.normal),
                np.where(
                    sticks[:, None],
                    c * increment.slip,
                    increment.shear - signed_mu * increment.normal,
                ),
                increment.balance,
            ]
        )
        motions = np.linalg.lstsq(equations[:, :-1], -equations[:, -1], rcond=1e-12)[0]
    return motions if _satisfies_law(increment, motions, has_friction) else None


def _satisfies_law(
    increment: LinearIncrement, motions: np.ndarray, has_friction: np.ndarray
) -> bool:
    """Return whether motions satisfy the law up to `ZERO_VIOLATION_OVER_LARGEST_FORCE`."""
    z_and_1 = np.append(motions, 1.0)
    r_n, r_t, gap, slip, imbalance = (
        rows @ z_and_1
        for rows in (
            increment.normal,
            increment.shear,
            increment.gap,
            increment.slip,
            increment.balance,
        )
    )
    c, faced = increment.stiffness, increment.faced
    largest = np.abs(np.concatenate([r_n, r_t])).max() or 1.0
    cone = np.where(has_friction, increment.mu * r_n, 0.0)
    smaller_factor = np.minimum(np.abs(cone - np.abs(r_t)), c * np.abs(slip))
    violations = [
        np.where(faced, np.maximum(-r_n, np.maximum(-c * gap, np.minimum(r_n, c * gap))), 0.0),
        np.where(faced, 0.0, np.abs(r_n)),
        np.abs(r_t) - cone,
        np.where(has_friction, smaller_factor, 0.0),
        np.where(
            has_friction & (c * np.abs(slip) > ZERO_VIOLATION_OVER_LARGEST_FORCE * largest),
            r_t * np.sign(slip),
            0.0,
        ),
        np.abs(imbalance),
    ]
    return all(
        violation.max(initial=0.0) <= ZERO_VIOLATION_OVER_LARGEST_FORCE * largest
        for violation in violations
    )


class _BranchConditions:
    """Inequalities and equations of a branch, which are linear in the motions z.

    At faced nodes, a branch requires each of r_n, g, mu r_n + r_t, mu r_n - r_t and v (see the
    module) to be non-negative, non-positive, zero, or nothing at all. Further equations hold in all
    branches. Lengths are converted into forces by the stiffness of nodes, and forces are divided by
    the largest one.
    """

    def __init__(self, increment: LinearIncrement) -> None:
        self.faced = np.flatnonzero(increment.faced)
        self._increment, faced = increment, self.faced
        has_tangent = np.any(increment.shear != 0, axis=1)
        mu = increment.mu[faced]
        self._has_friction = has_tangent[faced] & (mu > 0)
        # zero in all branches: forces at nodes that face nothing, frictionless shears, imbalances
        self._unfaced = ~increment.faced
        self._smooth = has_tangent & ~(increment.faced & (increment.mu > 0))
        normal, shear = increment.normal[faced], increment.shear[faced]
        rows = [
            normal,
            increment.stiffness * increment.gap[faced],
            mu[:, None] * normal + shear,
            mu[:, None] * normal - shear,
            increment.stiffness * increment.slip[faced],
            increment.normal[self._unfaced],
            increment.shear[self._smooth],
            increment.balance,
        ]
        coefficients = np.concatenate(rows)
        self._row_norm = np.ones(len(coefficients))
        self._row_norm[2 * len(faced) : 4 * len(faced)] = np.tile(np.sqrt(1 + mu**2), 2)
        self.force = np.abs(coefficients[:, -1]).max(initial=0.0) or 1.0
        self._length = self.force / increment.stiffness
        self._slope = coefficients[:, :-1] / increment.stiffness
        self._value = coefficients[:, -1] / self.force
        self._scale_by_largest_sum_of_normal_forces()

    def _scale_by_largest_sum_of_normal_forces(self) -> None:
        """Scale forces by the largest possible sum of normal forces, if the sum is bounded."""
        lower_mask, _ = self._masks_of_lower_and_upper_bounds(
            np.zeros(len(self.faced), dtype=np.int8)
        )
        total_slope = self._slope[: len(self.faced)].sum(axis=0)
        solution = linprog(
            -total_slope,
            A_ub=-self._slope[lower_mask],
            b_ub=self._value[lower_mask],
            bounds=(None, None),
            method="highs-ds",
        )
        if solution.success:
            largest_sum = total_slope @ solution.x + self._value[: len(self.faced)].sum()
            factor = float(np.clip(largest_sum, INFEASIBLE_VIOLATION_OVER_LARGEST_FORCE, 1.0))
            self.force, self._length = factor * self.force, factor * self._length
            self._value = self._value / factor

    def _masks_of_lower_and_upper_bounds(
        self, status_sets: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the masks of the values that must be >= 0 and of those that must be <= 0."""
        n_nodes, has_friction = len(status_sets), self._has_friction
        lower_mask = np.ones((5, n_nodes), dtype=bool)
        lower_mask[2:4] = has_friction
        lower_mask[4] = has_friction & np.isin(status_sets, (SLIPPING_FORWARDS, STICKING))
        upper_mask = np.zeros((5, n_nodes), dtype=bool)
        upper_mask[0] = status_sets == OPEN_ONLY
        upper_mask[1] = status_sets >= CLOSED_ONLY
        upper_mask[2] = has_friction & np.isin(status_sets, (OPEN_ONLY, SLIPPING_FORWARDS))
        upper_mask[3] = has_friction & np.isin(status_sets, (OPEN_ONLY, SLIPPING_BACKWARDS))
        upper_mask[4] = has_friction & np.isin(
            status_sets, (NOT_SLIPPING_FORWARDS, STICKING, SLIPPING_BACKWARDS)
        )
        always = np.ones(len(self._value) - 5 * n_nodes, dtype=bool)
        return np.append(lower_mask.ravel(), always), np.append(upper_mask.ravel(), always)

    def motions_of_smallest_violation(self, status_sets: np.ndarray) -> np.ndarray | None:
        """Return the motions z that violate the conditions least, or None if infeasible."""
        lower_mask, upper_mask = self._masks_of_lower_and_upper_bounds(status_sets)
        sign = np.repeat((1.0, -1.0), (lower_mask.sum(), upper_mask.sum()))
        row = np.concatenate([np.flatnonzero(lower_mask), np.flatnonzero(upper_mask)])
        n = self._slope.shape[1]
        solution = linprog(
            np.append(np.zeros(n), 1.0),
            A_ub=np.column_stack([-sign[:, None] * self._slope[row], -self._row_norm[row]]),
            b_ub=sign * self._value[row],
            bounds=[(None, None)] * n + [(0.0, None)],
            method="highs-ds",
            options=LINPROG_TOLERANCES,
        )
        # a failure of HiGHS counts as infeasible
        return (
            self._length * solution.x[:n]
            if solution.success and solution.fun <= INFEASIBLE_VIOLATION_OVER_LARGEST_FORCE
            else None
        )

    def law_violation_per_node(self, status_sets: np.ndarray, motions: np.ndarray) -> np.ndarray:
        """Return each node's violation (n,) of the conditions that a branch does not impose."""
        values = self._slope @ (motions / self._length) + self._value
        r_n, gap, forward_limit, backward_limit, slip = values[: 5 * len(status_sets)].reshape(
            5, -1
        )
        r_n, gap, forward_limit, backward_limit = (
            np.maximum(0.0, row) for row in (r_n, gap, forward_limit, backward_limit)
        )
        has_friction_force = self._has_friction & (status_sets != OPEN_ONLY) & (r_n > gap)
        forwards = np.minimum(np.maximum(0.0, slip), forward_limit) * (
            status_sets != SLIPPING_FORWARDS
        )
        backwards = np.minimum(np.maximum(0.0, -slip), backward_limit) * (
            status_sets != SLIPPING_BACKWARDS
        )
        return np.where(
            status_sets == ANY_STATUS, np.minimum(r_n, gap), 0.0
        ) + has_friction_force * (forwards + backwards)

    def nodes_to_split(self, status_sets: np.ndarray, motions: np.ndarray) -> np.ndarray:
        """Return the nodes with the largest violations among those whose statuses can be split."""
        violation = np.where(
            np.isin(status_sets, list(STATUS_SET_SPLITS)),
            self.law_violation_per_node(status_sets, motions),
            0.0,
        )
        violation[~self._has_friction & (status_sets != ANY_STATUS)] = 0.0
        ranked = np.argsort(-violation, kind="stable")[:MAX_CANDIDATE_NODES_PER_BRANCHING]
        return ranked[violation[ranked] > ZERO_VIOLATION_OVER_LARGEST_FORCE]
