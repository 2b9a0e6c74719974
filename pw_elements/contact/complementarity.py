"""Contact and friction as a linear complementarity problem, solved by Lemke's pivots.

With polygonal cones of friction (in the plane there are no others) a point's law is

    0 <= r_n  _|_  g >= 0,
    0 <= b_k  _|_  d_k.v + s >= 0,        r_t = sum b_k d_k,
    0 <= s    _|_  mu r_n - sum b_k >= 0,

s being the speed of slip. Where the points have a compliance that is positive definite the matrix
is copositive, and Lemke's method ends at a solution whatever the friction is (Cottle, Pang and
Stone, The Linear Complementarity Problem, theorem 4.4.13; Klarbring, Ing. Arch. 56 (1986)
529-541, doi:10.1007/BF00533830). Free translations and bodies that float have none: small springs
at the points and at the free surfaces give one. Their ends are moved to where the points were
found, so that they let go.
"""

import numpy as np
import numpy.typing as npt
from scipy.linalg.blas import dger

from pw_elements.contact.condensed import CondensedIncrement

Array = npt.NDArray[np.float64]

# Sides of the polygon that stands for the circle of friction
_SIDES = 8
# Smallest pivot over the largest entry of its column, and what counts as equal ratios
_PIVOT = 1e-11
_TIE = 1e-12
# Pivots per unknown
_MOST = 20


def lemke(M: Array, q: Array) -> Array | None:
    """Finds x >= 0 with M x + q >= 0 and x.(M x + q) = 0; None if the method ends on a ray.

    Ties are broken lexicographically, so that no basis comes back.
    """
    n = len(q)
    if np.all(q >= 0):
        return np.zeros(n)
    # basic = table[:, -1] - table[:, :-1] @ others; variables are w, x and the artificial one
    artificial = 2 * n
    table = np.asfortranarray(np.column_stack([-M, -np.ones(n), q]))
    basic, other = np.arange(n), np.arange(n, artificial + 1)
    row, column = int(np.argmin(q)), n
    for _ in range(_MOST * n):
        _pivot(table, row, column)
        leaving, basic[row], other[column] = basic[row], other[column], basic[row]
        if leaving == artificial:
            x = np.zeros(artificial + 1)
            x[basic] = table[:, -1]
            return np.maximum(x[n:artificial], 0.0)
        entering = leaving + n if leaving < n else leaving - n
        column = int(np.flatnonzero(other == entering)[0])
        row = _leaving(table, column, basic, other)
        if row < 0:
            return None
    return None


def _pivot(table: Array, row: int, column: int) -> None:
    """Exchanges a basic variable with another one, in place."""
    pivot, entering = table[row, column], table[:, column].copy()
    scaled = table[row] / pivot
    entering[row] = scaled[column] = 0.0
    dger(-1.0, entering, scaled, a=table, overwrite_a=1)
    table[row] = scaled
    table[:, column] = -entering / pivot
    table[row, column] = 1.0 / pivot


def _leaving(
    table: Array, column: int, basic: npt.NDArray[np.intp], other: npt.NDArray[np.intp]
) -> int:
    """The row that limits the entering variable; the artificial one's if it does; or -1."""
    n = len(basic)
    entering = table[:, column]
    rows = np.flatnonzero(entering > _PIVOT * max(1.0, np.abs(entering).max()))
    if len(rows) == 0:
        return -1
    rows = _smallest(rows, np.maximum(table[rows, -1], 0.0) / entering[rows])
    last = rows[basic[rows] == 2 * n]
    if len(last):
        return int(last[0])
    for k in range(n):  # by columns of the basis' inverse
        if len(rows) == 1:
            break
        place = np.flatnonzero(other == k)
        values = table[rows, place[0]] if len(place) else (basic[rows] == k).astype(float)
        rows = _smallest(rows, values / entering[rows])
    return int(rows[0])


def _smallest(rows: npt.NDArray[np.intp], ratio: Array) -> npt.NDArray[np.intp]:
    """The rows of the smallest ratio, ties and all."""
    least = ratio.min()
    return np.asarray(rows[ratio <= least + _TIE * max(1.0, abs(least))])


def unknowns(points: int, dim: int) -> int:
    """Size of the complementarity problem, at most."""
    return points * (2 + (2 if dim == 2 else _SIDES))


def sprung(problem: CondensedIncrement, spring: float, near: Array) -> Array | None:
    """The z of a problem with polygonal cones and springs; None if there is none.

    Args:
        problem: condensed to its points.
        spring: stiffness over the mean of the points' own.
        near: z at which the springs are at rest.
    """
    faced = np.flatnonzero(problem.faced)
    directions = _directions(problem, faced)
    rough = np.array([k for k, d in enumerate(directions) if len(d)], dtype=np.intp)
    sides = np.array([len(directions[k]) for k in rough], dtype=np.intp)
    pressed, count = len(faced), int(sides.sum())
    owner = np.repeat(rough, sides)  # of each side, among those that are faced
    d = np.concatenate([np.zeros((0, problem.frame.shape[1] - 1)), *directions])
    # z of forces along the frames, x = (r_n, b)
    points, dim = problem.frame.shape[:2]
    along = np.zeros((points, dim, pressed + count))
    along[faced, 0, np.arange(pressed)] = 1.0
    along[faced[owner], 1:, pressed + np.arange(count)] = d
    law = problem.in_components(problem.force)
    given = problem.in_components(type(problem.force)(along, np.zeros((points, dim)))).slope
    S = problem.condensation.stiffness
    springs = spring * np.abs(np.diag(S)).mean()
    springs = springs * np.append(np.ones(problem.unknowns), problem.sums.sum(axis=1))
    matrix = np.vstack([law.slope, problem.balance.slope]) + np.diag(springs)
    right = np.vstack([given, np.zeros((len(problem.free), pressed + count))])
    fixed = springs * near - np.append(law.value, problem.balance.value)
    try:
        z = np.linalg.solve(matrix, np.column_stack([right, fixed]))
    except np.linalg.LinAlgError:
        return None
    slope, value = z[:, :-1], z[:, -1]

    c = problem.scale[faced]
    size = pressed + count + len(rough)
    M, q = np.zeros((size, size)), np.zeros(size)
    M[:pressed, : pressed + count] = c[:, None] * (problem.gap.slope @ slope)[faced]
    q[:pressed] = c * problem.gap.at(value)[faced]
    sliding = (problem.slip.slope @ slope)[faced[owner]]
    side = pressed + np.arange(count)
    M[side, : pressed + count] = c[owner, None] * np.einsum("kt,ktx->kx", d, sliding)
    q[side] = c[owner] * np.sum(d * problem.slip.at(value)[faced[owner]], axis=1)
    speed = pressed + count + np.repeat(np.arange(len(rough)), sides)
    M[side, speed], M[speed, side] = 1.0, -1.0
    M[pressed + count + np.arange(len(rough)), rough] = problem.friction[faced[rough]]
    scale = np.abs(q).max(initial=0.0) or 1.0
    x = lemke(M, q / scale)
    return None if x is None else slope @ (scale * x[: pressed + count]) + value


def _directions(problem: CondensedIncrement, faced: npt.NDArray[np.intp]) -> list[Array]:
    """Corners (k, dim - 1) of each point's unit polygon of friction; none where it is smooth."""
    angle = 2 * np.pi * np.arange(_SIDES) / _SIDES
    polygon = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    each = []
    for n in faced:
        tangents = np.flatnonzero(np.linalg.norm(problem.frame[n, 1:], axis=1) > 0.5)
        if problem.friction[n] == 0:
            tangents = tangents[:0]
        one = np.eye(problem.frame.shape[1] - 1)[tangents]
        each.append(polygon if len(one) == 2 else np.concatenate([one, -one]))
    return each
