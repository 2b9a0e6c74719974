"""Comparison of the study's results with those of the oracle, for the problems of all sections.

Only the mesh is taken from the study's result. Loads, supports, materials and surfaces are defined
independently.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu

from tests.oracle.assembly import LinearElasticBody
from tests.oracle.eigen import guyan_reduction

NORMAL_UP, NORMAL_DOWN = (0.0, 1.0), (0.0, -1.0)
ValuesByName = dict[str, np.ndarray]
RELATIVE_DIFFERENCE_TOLERANCE = 1e-8
# The 8-node quadrilateral made of two triangles (pw-Q8) condenses its inner node. The oracle keeps
# this node and obtains the same result in statics. In vibration, condensation changes the result
ELEMENT_NAMES_IN_STATICS = ("galerkin-T6", "pw-T6", "galerkin-Q8", "pw-Q8", "pw-Q9")


@dataclass(frozen=True)
class StudyComparison:
    """Values of the study by name, and a function that computes the same values with the oracle.

    The argument of this function states whether the oracle's weights are piecewise linear. `scales`
    has the scales of differences by name; by default they are the largest study values.
    """

    study_values: ValuesByName
    compute_oracle_values: Callable[[bool], ValuesByName]
    scales: dict[str, float] = field(default_factory=dict)

    def largest_relative_differences(self, linear_weights: bool) -> dict[str, float]:
        """Return the largest difference of each value, divided by its scale.

        The oracle's weights are piecewise linear if `linear_weights`, otherwise quadratic.
        """
        oracle_values, differences = self.compute_oracle_values(linear_weights), {}
        for name, values in self.study_values.items():
            scale = self.scales.get(name, np.abs(values).max())
            assert 0 < scale < np.inf, name
            differences[name] = float(np.abs(values - oracle_values[name]).max() / scale)
        return differences


def assert_study_agrees_with_oracle(comparison, element_name):
    """Assert that the oracle reproduces all of the study's values for an element.

    Differences are relative to the scale of each value, see `StudyComparison`.
    """
    differences = comparison.largest_relative_differences(element_name.startswith("pw"))
    assert len(differences) > 0
    assert max(differences.values()) < RELATIVE_DIFFERENCE_TOLERANCE, differences


def assert_quadratic_weights_differ(comparison):
    """Assert that values of the oracle with quadratic weights differ from those of the study."""
    differences = comparison.largest_relative_differences(False)
    assert max(differences.values()) > 1e3 * RELATIVE_DIFFERENCE_TOLERANCE, differences


def assert_agrees_with_own_weights_alone(comparison, element_name):
    """Assert that the oracle agrees with the study, and for pw-T6 only with the right weights."""
    assert_study_agrees_with_oracle(comparison, element_name)
    if element_name == "pw-T6":
        assert_quadratic_weights_differ(comparison)


def make_plane_row_marker(axis, coordinate):
    """Return a function that marks the rows of points (n, dim) with x[axis] = coordinate."""
    return lambda x: np.isclose(x[:, axis], coordinate)


def make_abs_x_below_row_marker(limit):
    """Return a function that marks the rows of points (n, dim) whose |x| is below a limit."""
    return lambda x: np.abs(x[:, 0]) < limit + 1e-9


def combine_markers_by_and(*markers):
    """Return a function that marks the points that satisfy all conditions."""
    return lambda x: np.all([condition(x) for condition in markers], axis=0)


def combine_markers_by_or(*markers):
    """Return a function that marks the points that satisfy at least one condition."""
    return lambda x: np.any([condition(x) for condition in markers], axis=0)


def marked_nodes_sorted_by_x(curves, where):
    """Return the numbers of the nodes that satisfy a condition, sorted by x, then y."""
    x = curves["nodes"]
    nodes = np.flatnonzero(where(x))
    return nodes[np.lexsort((x[nodes, 1], x[nodes, 0].round(9)))]


def make_oracle_body(result, element_name, linear_weights, state, E, nu, **options):
    """Return the oracle's body on the mesh of a study result.

    For pw-Q8 the body consists of T6 triangles, and the nodes that the study condenses are kept.
    """
    kind = element_name.removeprefix("pw-").removeprefix("pwsym-").removeprefix("galerkin-")
    kind = "T6" if element_name == "pw-Q8" else kind
    curves = result.curves
    return LinearElasticBody(
        curves["nodes"], curves["cells"], kind, linear_weights, state, E, nu, **options
    )


def plane_gap_and_normal_functions(normal, level=0.0):
    """Return the gap and normal functions of a horizontal plane, for `NodesAndSurface`."""
    return (lambda x: (x[:, 1] - level) * normal[1], lambda x: np.tile(normal, (len(x), 1)))


def parabola_gap_and_normal_functions(apex_height, radius):
    """Return the gap and normal functions of a parabolic punch that presses downwards."""
    return (
        lambda x: x[:, 0] ** 2 / (2 * radius) - (x[:, 1] - apex_height)
    ), plane_gap_and_normal_functions(NORMAL_DOWN)[1]


def mask_without_prescribed_displacements(body):
    return np.zeros(body.nodes.shape, dtype=bool)


def make_contact_line_comparison(
    result, solve_by_oracle, normal, tangent=(-1.0, 0.0), with_displacement=True, **further_values
):
    """Return a comparison of the forces along a contact line, and of their sums.

    Displacements are included if `with_displacement`. `further_values` maps names to pairs of a
    value of the study and a function that extracts the corresponding value from the oracle's state.
    """
    names = ["force_n", "force_t"] + ["displacement"] * with_displacement
    study_values = {name: result.curves[name] for name in names}
    study_values |= {name: result.scalars[name] for name in ("force_normal", "force_tangential")}
    study_values |= {name: number for name, (number, _) in further_values.items()}

    def compute_oracle_values(linear_weights):
        state = solve_by_oracle(linear_weights)
        force_n, force_t = state.forces[0] @ normal, state.forces[0] @ tangent
        values = {"force_n": force_n, "force_t": force_t, "displacement": state.displacement}
        values |= {"force_normal": force_n.sum(), "force_tangential": force_t.sum()}
        return values | {name: of_state(state) for name, (_, of_state) in further_values.items()}

    scales = {
        "force_t": study_values["force_n"].max(),
        "force_tangential": study_values["force_normal"],
    }
    return StudyComparison(study_values, compute_oracle_values, scales)


def solve_with_zero_supports(K, f, prescribed_mask):
    """Solve K u = f with zero displacements where `prescribed_mask` is True."""
    free_dofs = np.flatnonzero(~prescribed_mask.ravel())
    u = np.zeros(len(f))
    u[free_dofs] = splu(K[free_dofs][:, free_dofs].tocsc()).solve(f[free_dofs])
    return u


def symmetric_part(A):
    return (A + A.T) / 2


def condensed_stiffness_mass_and_mask(body, element, prescribed_mask):
    """Return stiffness, mass and support mask, without the inner nodes that the study condenses.

    The matrices are reduced by Guyan's method. They are unchanged for elements without such nodes.
    """
    K, M, inner = body.stiffness(), body.mass(), _nodes_to_condense(body, element)
    if not len(inner):
        return K, M, prescribed_mask
    outer_nodes = np.setdiff1d(np.arange(len(body.nodes)), inner)
    return *map(csc_matrix, guyan_reduction(K, M, inner)), prescribed_mask[outer_nodes]


def _nodes_to_condense(body, element):
    """Return the nodes that Guyan's reduction removes.

    They are the centres of cells (pw-Q9) or the middles of diagonals between triangles (pw-Q8).
    """
    if element == "pw-Q9":
        return body.cells[:, 8]
    if element != "pw-Q8":
        return np.empty(0, dtype=int)
    ends = body.nodes[body.cells[:, [[1, 2], [0, 2], [0, 1]]]]  # ends of the sides of nodes 3, 4, 5
    longest = np.linalg.norm(np.diff(ends, axis=2)[:, :, 0], axis=2).argmax(axis=1)
    return np.unique(body.cells[np.arange(len(body.cells)), 3 + longest])
