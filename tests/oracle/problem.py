"""A problem's numbers beside the oracle's: what the problems of all sections need.

Only the mesh is taken from a result; loads, supports, materials and surfaces are stated anew.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu

from tests.oracle.assembly import Body
from tests.oracle.eigen import guyan_reduction

NORMAL_UP, NORMAL_DOWN = (0.0, 1.0), (0.0, -1.0)
ValuesByName = dict[str, np.ndarray]
TOLERANCE = 1e-8
# The 8-node quadrilateral of two triangles condenses a node that carries no load: the oracle keeps
# it and gets the same. In vibration condensing changes the answer
STATIC_ELEMENTS = ("galerkin-T6", "pw-T6", "galerkin-Q8", "pw-Q8", "pw-Q9")


@dataclass(frozen=True)
class StudyComparison:
    """Numbers of the study, and the same by the oracle."""

    study_values: ValuesByName
    compute_oracle_values: Callable[[bool], ValuesByName]
    scales: dict[str, float] = field(default_factory=dict)

    def differences(self, linear_weights: bool) -> dict[str, float]:
        ours, found = self.compute_oracle_values(linear_weights), {}
        for name, theirs in self.study_values.items():
            scale = self.scales.get(name, np.abs(theirs).max())
            assert 0 < scale < np.inf, name
            found[name] = float(np.abs(theirs - ours[name]).max() / scale)
        return found


def assert_agrees(problem, element):
    """The oracle finds all numbers of an element, relative to the largest of each name."""
    differences = problem.differences(element.startswith("pw"))
    assert len(differences) > 0
    assert max(differences.values()) < TOLERANCE, differences


def assert_differs(problem):
    differences = problem.differences(False)
    assert max(differences.values()) > 1e3 * TOLERANCE, differences


def assert_agrees_with_these_weights_alone(problem, element):
    """Both: weights of another kind would be noticed."""
    assert_agrees(problem, element)
    if element == "pw-T6":
        assert_differs(problem)


def rows_on_plane(axis, value):
    return lambda x: np.isclose(x[:, axis], value)


def rows_within(limit):
    return lambda x: np.abs(x[:, 0]) < limit + 1e-9


def all_of(*conditions):
    return lambda x: np.all([condition(x) for condition in conditions], axis=0)


def any_of(*conditions):
    return lambda x: np.any([condition(x) for condition in conditions], axis=0)


def sorted_nodes(curves, where):
    """Numbers of the nodes that a condition holds on, by x and then y."""
    x = curves["nodes"]
    nodes = np.flatnonzero(where(x))
    return nodes[np.lexsort((x[nodes, 1], x[nodes, 0].round(9)))]


def oracle_body(result, element, linear, state, E, nu, **more):
    """The oracle's body on the mesh of a result; pw-Q8 are triangles, its inner nodes kept."""
    kind = element.removeprefix("pw-").removeprefix("pwsym-").removeprefix("galerkin-")
    kind = "T6" if element == "pw-Q8" else kind
    curves = result.curves
    return Body(curves["nodes"], curves["cells"], kind, linear, state, E, nu, **more)


def plane_functions(normal, level=0.0):
    """Gap and normal of a horizontal plane, for a `Pair`."""
    return (lambda x: (x[:, 1] - level) * normal[1], lambda x: np.tile(normal, (len(x), 1)))


def parabola_functions(apex, radius):
    """A punch that presses downwards."""
    return (lambda x: x[:, 0] ** 2 / (2 * radius) - (x[:, 1] - apex)), plane_functions(NORMAL_DOWN)[
        1
    ]


def no_prescribed_displacements(body):
    return np.zeros(body.nodes.shape, dtype=bool)


def compare_contact_line(
    result, solve_by_oracle, normal, tangent=(-1.0, 0.0), with_displacement=True, **further
):
    """Forces along one contact line and their sums; displacements and more, where stored."""
    names = ["force_n", "force_t"] + ["displacement"] * with_displacement
    theirs = {name: result.curves[name] for name in names}
    theirs |= {name: result.scalars[name] for name in ("force_normal", "force_tangential")}
    theirs |= {name: number for name, (number, _) in further.items()}

    def ours(linear):
        state = solve_by_oracle(linear)
        force_n, force_t = state.forces[0] @ normal, state.forces[0] @ tangent
        found = {"force_n": force_n, "force_t": force_t, "displacement": state.displacement}
        found |= {"force_normal": force_n.sum(), "force_tangential": force_t.sum()}
        return found | {name: of(state) for name, (_, of) in further.items()}

    scales = {"force_t": theirs["force_n"].max(), "force_tangential": theirs["force_normal"]}
    return StudyComparison(theirs, ours, scales)


def solve_displacement(K, f, held):
    kept = np.flatnonzero(~held.ravel())
    u = np.zeros(len(f))
    u[kept] = splu(K[kept][:, kept].tocsc()).solve(f[kept])
    return u


def symmetric_part(A):
    return (A + A.T) / 2


def condense_inner_nodes(body, element, prescribed_mask):
    """Stiffness, mass and mask of held displacements after Guyan's reduction, if there is one."""
    K, M, inner = body.stiffness(), body.mass(), _inner_nodes(body, element)
    if not len(inner):
        return K, M, prescribed_mask
    kept = np.setdiff1d(np.arange(len(body.nodes)), inner)
    return *map(csc_matrix, guyan_reduction(K, M, inner)), prescribed_mask[kept]


def _inner_nodes(body, element):
    """Those that Guyan's reduction takes out: on the diagonals, or in the centres of cells."""
    if element == "pw-Q9":
        return body.cells[:, 8]
    if element != "pw-Q8":
        return np.empty(0, dtype=int)
    ends = body.nodes[body.cells[:, [[1, 2], [0, 2], [0, 1]]]]  # of the sides of nodes 3, 4, 5
    longest = np.linalg.norm(np.diff(ends, axis=2)[:, :, 0], axis=2).argmax(axis=1)
    return np.unique(body.cells[np.arange(len(body.cells)), 3 + longest])
