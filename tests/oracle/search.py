"""A search of all statuses of contact nodes in the plane for a state.

Branch and bound. A branch allows each node some of the four statuses: open, sticking, slipping
forwards or backwards along its tangent. What these have in common is linear in the motions z:

    r_n >= 0,  g >= 0,  |r_t| <= mu r_n    always,
    r = 0                                  of nodes that can but be open,
    g = 0                                  of nodes that cannot,
    v >= 0,  r_t = -mu r_n                 of nodes that can but slip forwards,

and so on. A linear program asks by how much these conditions are violated at the least. If they
can all hold, Newton's method tries from there, and a node at which r_n g, or the friction's work,
is wrong has its statuses divided between two branches. If they cannot, the branch is closed.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linprog

# Sets of statuses that a branch may allow, and into which two of them each is divided
ANY, OPEN_ONLY, CLOSED, NOT_FORWARDS, FORWARDS, STICKING, BACKWARDS = range(7)
SUBSETS = {
    ANY: (OPEN_ONLY, CLOSED),
    CLOSED: (NOT_FORWARDS, FORWARDS),
    NOT_FORWARDS: (STICKING, BACKWARDS),
}
INFEASIBLE_VIOLATION, ZERO_VIOLATION = (
    1e-7,
    1e-9,
)  # violation over the largest force that closes a branch, and that is none
BRANCHING_CANDIDATES, MAX_NEWTON_STEPS, MAX_NEWTON_STARTS = 3, 8, 200
MAX_SEARCH_WORK = 2_500_000  # linear programs times nodes squared: some ten seconds
LINPROG_TOLERANCES = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}


@dataclass(frozen=True)
class LinearIncrement:
    """What the law of n nodes speaks of, as linear functions of (z; 1), each (n, k + 1).

    Args:
        normal: r_n, the normal forces.
        shear: r_t, along the tangents; zero where a support holds these.
        gap: where a surface faces the node.
        slip: along the tangents, since the increment's start.
        balance: (b, k + 1), zero in equilibrium: of free surfaces, R - P.
        mu: (n,).
        faced: (n,), whether a surface faces the node.
        stiffness: of a node, by which lengths are stated as forces.
    """

    normal: np.ndarray
    shear: np.ndarray
    gap: np.ndarray
    slip: np.ndarray
    balance: np.ndarray
    mu: np.ndarray
    faced: np.ndarray
    stiffness: float


def search_statuses(
    increment: LinearIncrement, max_work: float = MAX_SEARCH_WORK
) -> np.ndarray | None:
    """A state z (k,), if one is found by so many linear programs times nodes squared at most."""
    conditions = _BranchConditions(increment)
    max_work = max_work / max(1, len(conditions.faced)) ** 2
    root = np.zeros(len(conditions.faced), dtype=np.int8)
    first = conditions.minimise_violation(root)
    waiting = [] if first is None else [(root, first)]
    programs, attempts = 1, 0
    while waiting and programs <= max_work:
        codes, z = waiting.pop()
        if attempts < MAX_NEWTON_STARTS:
            attempts += 1
            state = _solve_by_newton(increment, z)
            if state is not None:
                return state
        options = []
        for k in conditions.nodes_to_split(codes, z):
            tried = [
                (part, conditions.minimise_violation(part)) for part in _split_at_node(codes, k)
            ]
            programs += len(tried)
            left = [(part, least) for part, least in tried if least is not None]
            if len(left) < len(tried):
                options = left
                break
            options = options or left
        waiting += sorted(
            options, key=lambda option: -conditions.law_violation_per_node(*option).sum()
        )
    return None


def _split_at_node(codes: np.ndarray, node: int) -> Iterator[np.ndarray]:
    for code in SUBSETS[int(codes[node])]:
        part = codes.copy()
        part[node] = code
        yield part


def _solve_by_newton(increment: LinearIncrement, z: np.ndarray) -> np.ndarray | None:
    """A state by Newton's method on the equations of the statuses that z tells, or None."""
    rows = (increment.normal, increment.shear, increment.gap, increment.slip)
    c, mu, faced = increment.stiffness, increment.mu, increment.faced
    rough = faced & (mu > 0) & np.any(increment.shear != 0, axis=1)
    for _ in range(MAX_NEWTON_STEPS):
        r_n, r_t, gap, slip = (part @ np.append(z, 1.0) for part in rows)
        pressed, rubbed = r_n - c * gap, r_t - c * slip
        if _satisfies_law(increment, z, rough):
            return z
        closed = faced & (pressed > 0)
        sticks = rough & closed & (np.abs(rubbed) <= mu * pressed)
        share = np.where(rough & closed, np.sign(rubbed) * mu, 0.0)[:, None]
        equations = np.concatenate(
            [
                np.where(closed[:, None], c * increment.gap, increment.normal),
                np.where(
                    sticks[:, None], c * increment.slip, increment.shear - share * increment.normal
                ),
                increment.balance,
            ]
        )
        z = np.linalg.lstsq(equations[:, :-1], -equations[:, -1], rcond=1e-12)[0]
    return z if _satisfies_law(increment, z, rough) else None


def _satisfies_law(increment: LinearIncrement, z: np.ndarray, rough: np.ndarray) -> bool:
    """Whether z violates no line of the law by more than 1e-9 of the largest force."""
    every = np.append(z, 1.0)
    r_n, r_t, gap, slip, lack = (
        part @ every
        for part in (
            increment.normal,
            increment.shear,
            increment.gap,
            increment.slip,
            increment.balance,
        )
    )
    c, faced = increment.stiffness, increment.faced
    size = np.abs(np.concatenate([r_n, r_t])).max() or 1.0
    cone = np.where(rough, increment.mu * r_n, 0.0)
    least = np.minimum(np.abs(cone - np.abs(r_t)), c * np.abs(slip))
    lines = [
        np.where(faced, np.maximum(-r_n, np.maximum(-c * gap, np.minimum(r_n, c * gap))), 0.0),
        np.where(faced, 0.0, np.abs(r_n)),
        np.abs(r_t) - cone,
        np.where(rough, least, 0.0),
        np.where(rough & (c * np.abs(slip) > ZERO_VIOLATION * size), r_t * np.sign(slip), 0.0),
        np.abs(lack),
    ]
    return all(line.max(initial=0.0) <= ZERO_VIOLATION * size for line in lines)


class _BranchConditions:
    """Conditions >= 0, <= 0 or both, linear in z: r_n, g, mu r_n + r_t, mu r_n - r_t, v, others.

    Lengths are stated as forces, by the nodes' stiffness, and forces over the largest one.
    """

    def __init__(self, increment: LinearIncrement) -> None:
        self.faced = np.flatnonzero(increment.faced)
        self._increment, faced = increment, self.faced
        slides = np.any(increment.shear != 0, axis=1)
        mu = increment.mu[faced]
        self._rough = slides[faced] & (mu > 0)
        # what is zero in any case: forces where nothing faces a node, smooth shear, balances
        self._unfaced = ~increment.faced
        self._smooth = slides & ~(increment.faced & (increment.mu > 0))
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
        every = np.concatenate(rows)
        self._row_norm = np.ones(len(every))
        self._row_norm[2 * len(faced) : 4 * len(faced)] = np.tile(np.sqrt(1 + mu**2), 2)
        self.force = np.abs(every[:, -1]).max(initial=0.0) or 1.0
        self._length = self.force / increment.stiffness
        self._slope = every[:, :-1] / increment.stiffness
        self._value = every[:, -1] / self.force
        self._scale_by_largest_normal_force()

    def _scale_by_largest_normal_force(self) -> None:
        """Takes the largest sum of normal forces for the scale, where there is one."""
        least, _ = self._lower_and_upper_masks(np.zeros(len(self.faced), dtype=np.int8))
        total = self._slope[: len(self.faced)].sum(axis=0)
        best = linprog(
            -total,
            A_ub=-self._slope[least],
            b_ub=self._value[least],
            bounds=(None, None),
            method="highs-ds",
        )
        if best.success:
            most = total @ best.x + self._value[: len(self.faced)].sum()
            share = float(np.clip(most, INFEASIBLE_VIOLATION, 1.0))
            self.force, self._length = share * self.force, share * self._length
            self._value = self._value / share

    def _lower_and_upper_masks(self, codes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Which conditions are >= 0, and which are <= 0."""
        nodes, rough = len(codes), self._rough
        least = np.ones((5, nodes), dtype=bool)
        least[2:4] = rough
        least[4] = rough & np.isin(codes, (FORWARDS, STICKING))
        most = np.zeros((5, nodes), dtype=bool)
        most[0] = codes == OPEN_ONLY
        most[1] = codes >= CLOSED
        most[2] = rough & np.isin(codes, (OPEN_ONLY, FORWARDS))
        most[3] = rough & np.isin(codes, (OPEN_ONLY, BACKWARDS))
        most[4] = rough & np.isin(codes, (NOT_FORWARDS, STICKING, BACKWARDS))
        always = np.ones(len(self._value) - 5 * nodes, dtype=bool)
        return np.append(least.ravel(), always), np.append(most.ravel(), always)

    def minimise_violation(self, codes: np.ndarray) -> np.ndarray | None:
        """The z at which the conditions of a branch are violated least; None closes the branch."""
        least, most = self._lower_and_upper_masks(codes)
        sign = np.repeat((1.0, -1.0), (least.sum(), most.sum()))
        row = np.concatenate([np.flatnonzero(least), np.flatnonzero(most)])
        n = self._slope.shape[1]
        best = linprog(
            np.append(np.zeros(n), 1.0),
            A_ub=np.column_stack([-sign[:, None] * self._slope[row], -self._row_norm[row]]),
            b_ub=sign * self._value[row],
            bounds=[(None, None)] * n + [(0.0, None)],
            method="highs-ds",
            options=LINPROG_TOLERANCES,
        )
        # HiGHS gives up at times
        return (
            self._length * best.x[:n] if best.success and best.fun <= INFEASIBLE_VIOLATION else None
        )

    def law_violation_per_node(self, codes: np.ndarray, z: np.ndarray) -> np.ndarray:
        """What each node's law is violated by, beyond the conditions of a branch; (n,)."""
        values = self._slope @ (z / self._length) + self._value
        r_n, gap, ahead, behind, slip = values[: 5 * len(codes)].reshape(5, -1)
        r_n, gap, ahead, behind = (np.maximum(0.0, part) for part in (r_n, gap, ahead, behind))
        rubs = self._rough & (codes != OPEN_ONLY) & (r_n > gap)
        forwards = np.minimum(np.maximum(0.0, slip), ahead) * (codes != FORWARDS)
        backwards = np.minimum(np.maximum(0.0, -slip), behind) * (codes != BACKWARDS)
        return np.where(codes == ANY, np.minimum(r_n, gap), 0.0) + rubs * (forwards + backwards)

    def nodes_to_split(self, codes: np.ndarray, z: np.ndarray) -> np.ndarray:
        """The nodes at which the law is violated most, and whose statuses can be divided."""
        wrong = np.where(np.isin(codes, list(SUBSETS)), self.law_violation_per_node(codes, z), 0.0)
        wrong[~self._rough & (codes != ANY)] = 0.0
        ranked = np.argsort(-wrong, kind="stable")[:BRANCHING_CANDIDATES]
        return ranked[wrong[ranked] > ZERO_VIOLATION]
