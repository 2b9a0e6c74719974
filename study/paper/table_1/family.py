"""Treatments of the user elements, and the shifts of eigenvalues that follow on fitted columns.

They are recorded: `./run python3 -m study.publish.renew_records 'table-1-shifts/*'` computes all
anew, in two CPU minutes.

The paper prints neither how its programs formed the mass of an unsymmetric element, nor how they
passed it to a symmetric eigenvalue solver, nor the supports of the vibration. The family, written
down before its values were computed, is the product of what these may have been:

* supports: those under which columns fit CAX6 and CAX8, see `ensemble`. Standard and user elements
  share them.
* integration of stiffness and new mass: exact, or 3 points or 1 in each sub-triangle.
* mass of the 6-node element: its own, consistent; row sums of that; or the standard element's.
* mass of the 8-node element: one of these, of its two triangles, condensed with the left matrix of
  the transposed problem or with L = R; row sums of the condensed mass; or CAX8's own mass.
* symmetric parts of stiffness and mass: not taken; of the matrices that enter the eigenvalue
  problem; or, of the 8-node element, of its triangles' matrices before the condensation.

A shift is a user element's eigenvalue over that of CAX6 or CAX8 on the same column, less 1.
"""

from functools import cache
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.sparse import bsr_matrix, csr_matrix, diags

from pw_elements import Spaces
from study.paper.table_1.columns import (
    Array,
    FactorisedStiffness,
    Indices,
    MovingMesh,
    MovingMeshElement,
    Shape,
    Supports,
    Topology,
    compute_standard_element_eigenvalues,
    make_standard_quadrilateral_element,
)
from study.paper.table_1.ensemble import read_columns
from study.run import records
from study.run.records import RecordRow

UNIT = 1e-5
"""Unit in which the record has shifts, in per cent."""
RECORD_TOLERANCE = 3
"""Units by which a shift that is computed again may differ from the record."""

QUADRATURE_DEGREE = {0: None, 3: 2, 1: 1}
"""Degree of the rule with so many points in a sub-triangle; 0 points: the library's exact one."""


class Treatment(NamedTuple):
    """How a user element's matrices are formed.

    Args:
        points: in each sub-triangle; 0 for an exact rule.
        mass: "new", "standard", "lumped"; of the 8-node element also "lumped_after" (condensation)
            and "quadrilateral" (CAX8's).
        symmetrised: "no", "yes", or "before" condensation.
        left: left matrix of the mass's condensation, "transposed" or "same"; "" if there is none.
    """

    points: int
    mass: str
    symmetrised: str = "no"
    left: str = ""


SIX_NODE_TREATMENTS = tuple(
    Treatment(*choice)
    for choice in product(QUADRATURE_DEGREE, ("new", "standard", "lumped"), ("no", "yes"))
)
EIGHT_NODE_TREATMENTS = tuple(
    Treatment(points, mass, symmetrised, left)
    for points, mass, (symmetrised, left) in product(
        QUADRATURE_DEGREE,
        ("new", "standard", "lumped", "lumped_after", "quadrilateral"),
        (
            ("no", "transposed"),
            ("no", "same"),
            ("yes", "transposed"),
            ("yes", "same"),
            ("before", "same"),
        ),
    )
    # CAX8's mass is not condensed, so that there is no choice of L
    if not (mass == "quadrilateral" and (symmetrised, left) in (("no", "same"), ("yes", "same")))
)
TREATMENTS = {"six": SIX_NODE_TREATMENTS, "eight": EIGHT_NODE_TREATMENTS}


class Shifts(NamedTuple):
    """Results on one column.

    Args:
        standard: eigenvalues (2, 6) of CAX6 and CAX8.
        six: shifts (treatments, 6) of the 6-node user element in per cent; NaN if there is none.
        eight: shifts (treatments, 6) of the 8-node user element.
        axis: largest change of CAX6's eigenvalues, in per cent, if its nodes on the axis, which
            carry no contact force, do not support it.
    """

    standard: Array
    six: Array
    eight: Array
    axis: float


class UserElements:
    """Standard and user elements on the meshes of one topology; `triangle` is the standard one."""

    def __init__(self, topology: Topology) -> None:
        triangles = MovingMesh(topology, "triangle")
        self.triangle = MovingMeshElement(triangles, Spaces.galerkin(triangles.mesh))
        degrees = tuple(QUADRATURE_DEGREE.values())
        self._new = MovingMeshElement(triangles, Spaces.petrov_galerkin(triangles.mesh), degrees)
        self._quadrilateral = make_standard_quadrilateral_element(topology)
        self._quadrilateral_order = _match_nodes(self._new, self._quadrilateral)

    def compute_shifts(self, shape: Shape, supports: Supports) -> Shifts:
        """Return the shifts by all treatments on one column."""
        standard = np.array(
            [
                compute_standard_element_eigenvalues(element, shape, supports)
                for element in (self.triangle, self._quadrilateral)
            ]
        )
        open_axis = compute_standard_element_eigenvalues(
            self.triangle, shape, supports._replace(axis_open=True)
        )
        rows: dict[str, Array] = {}
        for reference, (name, treatments) in zip(standard, TREATMENTS.items(), strict=True):
            values = dict.fromkeys(treatments, np.full(reference.shape, np.nan))
            for points in QUADRATURE_DEGREE:
                values |= self._eigenvalues(name, points, supports)
            rows[name] = np.array([100 * (values[t] / reference - 1) for t in treatments])
        axis = float(np.abs(100 * (open_axis / standard[0] - 1)).max())
        return Shifts(standard, rows["six"], rows["eight"], axis)

    def _eigenvalues(self, name: str, points: int, supports: Supports) -> dict[Treatment, Array]:
        """Return the eigenvalues (6,) of all treatments with so many points, as the mesh lies."""
        degree = QUADRATURE_DEGREE[points]
        K, new_mass = self._new.stiffness(degree), self._new.mass(degree)
        masses = {"new": new_mass, "standard": self.triangle.mass(), "lumped": _row_sums(new_mass)}
        free = self._new.free_dofs(supports)
        if name == "six":
            return {
                Treatment(points, mass, symmetrised): values
                for symmetrised, symmetrise in (("no", False), ("yes", True))
                for mass, values in _solve(K, masses, free, symmetrise).items()
            }
        return self._condensed_eigenvalues(points, K, masses, free)

    def _condensed_eigenvalues(
        self, points: int, K: csr_matrix, masses: dict[str, csr_matrix], free: Indices
    ) -> dict[Treatment, Array]:
        outer = np.setdiff1d(np.arange(K.shape[0]), self._new.inner_dofs)
        free_outer = np.flatnonzero(np.isin(outer, free))
        order = self._quadrilateral_order
        quadrilateral_mass = self._quadrilateral.mass()[order][:, order]
        values: dict[Treatment, Array] = {}
        for before in (False, True):
            matrices = {name: _symmetric_part(M) if before else M for name, M in masses.items()}
            stiffness = _symmetric_part(K) if before else K
            left, right = condensation(stiffness, self._new.inner_dofs)
            reduced_stiffness = left.T @ stiffness @ right
            for kind in ("same",) if before else ("transposed", "same"):
                mass_left = right if kind == "same" else left
                reduced = {name: mass_left.T @ M @ right for name, M in matrices.items()}
                reduced["lumped_after"] = _row_sums(reduced["new"])
                if before or kind == "transposed":
                    reduced["quadrilateral"] = quadrilateral_mass
                for symmetrised in ("before",) if before else ("no", "yes"):
                    solved = _solve(reduced_stiffness, reduced, free_outer, symmetrised == "yes")
                    values |= {
                        Treatment(points, mass, symmetrised, kind): value
                        for mass, value in solved.items()
                    }
        return values


def condensation(K: csr_matrix, inner: Indices) -> tuple[csr_matrix, csr_matrix]:
    """Return the matrices L and R (n, n - m) that condense inner unknowns (m,), node by node.

    L^T K R has the order of the remaining unknowns; L is that of the transposed problem.
    """
    outer = np.setdiff1d(np.arange(K.shape[0]), inner)
    blocks = K[inner][:, inner].tobsr((2, 2))
    if not np.array_equal(blocks.indices, np.arange(len(inner) // 2)):
        raise ValueError("inner nodes are coupled to each other")
    inverse = bsr_matrix((np.linalg.inv(blocks.data), blocks.indices, blocks.indptr)).tocsr()
    select = csr_matrix(
        (np.ones(len(outer)), (outer, np.arange(len(outer)))), (K.shape[0], len(outer))
    )
    place = csr_matrix(
        (np.ones(len(inner)), (inner, np.arange(len(inner)))), (K.shape[0], len(inner))
    )
    right = select - place @ (inverse @ K[inner][:, outer])
    left = select - place @ (inverse.T @ K[outer][:, inner].T)
    return left.tocsr(), right.tocsr()


def _solve(
    K: csr_matrix, masses: dict[str, csr_matrix], free: Indices, symmetrised: bool
) -> dict[str, Array]:
    stiffness = FactorisedStiffness(_symmetric_part(K) if symmetrised else K, free)
    return {
        name: stiffness.lowest_eigenvalues(_symmetric_part(M) if symmetrised else M)
        for name, M in masses.items()
    }


def _symmetric_part(matrix: csr_matrix) -> csr_matrix:
    return ((matrix + matrix.T) / 2).tocsr()


def _row_sums(mass: csr_matrix) -> csr_matrix:
    """Return the diagonal matrix of the sums over the columns of the row's component."""
    component = np.arange(mass.shape[0]) % 2
    sums = [mass @ (component == k).astype(float) for k in (0, 1)]
    return diags(np.where(component == 0, *sums)).tocsr()


def _match_nodes(triangles: MovingMeshElement, quadrilaterals: MovingMeshElement) -> Indices:
    """Return where the triangles' outer unknowns are among the quadrilaterals'."""
    x = triangles.node_points
    outer = np.setdiff1d(np.arange(2 * len(x)), triangles.inner_dofs)[::2] // 2
    distances = np.abs(x[outer, None] - quadrilaterals.node_points[None]).sum(axis=2)
    nodes = distances.argmin(axis=1)
    if len(outer) != len(quadrilaterals.node_points) or distances.min(axis=1).max() > 1e-9:
        raise ValueError("triangles and quadrilaterals have other nodes")
    return np.asarray((2 * nodes[:, None] + [0, 1]).ravel())


# The record


def list_keys() -> list[str]:
    """Return the keys of all rows, such as "table-1-shifts/14-tangential-1"."""
    return [f"table-1-shifts/{column}" for column in read_columns()]


def digest_input(column: str) -> str:
    """Return the digest of a column, named as by `read_columns`, and of the treatments."""
    supports, topology, shape = read_columns()[column]
    lengths = [shape.lengths.tolist(), *shape[1:]]
    return records.digest_input([supports[:2], topology, lengths, TREATMENTS])


def compute_row(key: str) -> RecordRow:
    """Compute the shifts on the column of a key."""
    column = key.partition("/")[2]
    supports, topology, shape = read_columns()[column]
    shifts = _user_elements(topology).compute_shifts(shape, supports)
    content = {
        "standard": [[float(f"{value:.9g}") for value in values] for values in shifts.standard],
        "axis": float(f"{shifts.axis:.1g}"),
    }
    for name in TREATMENTS:
        content[name] = [
            [None if np.isnan(x) else round(x / UNIT) for x in values]
            for values in getattr(shifts, name)
        ]
    return records.create_row_with_current_date(key, digest_input(column), content)


def difference_of_rows(row: RecordRow, recorded: RecordRow) -> float:
    """Return the largest difference of two rows in last digits; infinite if others are missing.

    Args:
        row: Computed row.
        recorded: Recorded row with the same key.
    """
    worst = 0.0
    for name in TREATMENTS:
        worst = max(worst, records.largest_difference(row.content[name], recorded.content[name]))
    ratio = np.array(row.content["standard"]) / np.array(recorded.content["standard"])
    return max(worst, float(np.abs(100 * (ratio - 1)).max()) / UNIT)


def read_shifts(name: str) -> Array:
    """Return all shifts (columns, treatments, 6) of "six" or "eight" nodes, in per cent.

    The columns are in the order of `study.paper.table_1.ensemble.read_columns`.
    """
    rows = records.read_rows(records.TABLE_1_SHIFTS)
    values = [rows[key].content[name] for key in list_keys()]
    return np.array(values, dtype=float) * UNIT


@cache
def _user_elements(topology: Topology) -> UserElements:
    return UserElements(topology)
