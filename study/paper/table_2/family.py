"""Models of Table 2's beam: a family of assumptions and the critical stresses that follow.

They are recorded: `./run python3 -m study.publish.renew_records 'table-2/*'` computes all anew, in
six CPU minutes.

The paper prints neither the mesh nor the supports, nor how its programs form the matrices. The
family is the product of what they may have been:

* mesh: `DIVISIONS` of the half beam into squares, `PATTERNS` of their diagonals. The pattern "left"
  is "right" mirrored in the beam's axis, and "left_right" is "right_left" mirrored if the number of
  squares over the height is odd: they have the same critical stresses and are left out.
* set-up: a load (`LOADS`), the part of the end face where v = 0 (`ENDS`), and for mode 2 the part
of
  the mid-section where v = 0 (`MIDDLES`) and the supports under which the prestress is computed
  (`PRESTRESS_SUPPORTS`): those of the antisymmetric model, or those of the symmetric one, as in
  codes that change the supports between the two steps. Under the uniform load only the former are
  used, because the prestress is uniform anyway.
* form of the geometric stiffness: G or J, see section 7.6.
* prestress that enters it: the stress at each integration point, or the mean over an element.
* integration of the geometric stiffness: 1 or 3 points per triangle (of the new element per
  sub-triangle), or an exact rule. The stiffness itself is exact. With one point the standard
  element's stiffness would be singular.
* new element's matrices: as derived; symmetric parts in both steps; or in the eigenvalue step only.

Modes 1 and 2 of a model share all assumptions, and CPS6 and the user element share mesh and set-up.
Each distinct eigenvalue problem is solved once.
"""

from dataclasses import dataclass
from functools import cache
from itertools import product
from typing import Literal, NamedTuple

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, SuperLU, eigs, splu

from pw_elements import Body, Material, Spaces, assemble_matrix, assemble_vector, boundary_measure
from pw_elements.elasticity import StressState
from pw_elements.meshes import DiagonalPattern, triangles
from study.run import records
from study.run.records import RecordRow

Array = npt.NDArray[np.float64]
Form = Literal["G", "J"]
FORMS: tuple[Form, Form] = ("G", "J")

YOUNGS_MODULUS, HALF_LENGTH, HEIGHT = 2.07e11, 4.0, 1.0
"""Young's modulus as printed, in Pa, and lengths that follow from the printed Euler stresses.

Poisson's ratio is 0, the thickness 1.
"""

DIVISIONS = tuple(product((2, 3, 4, 5, 6, 7, 8, 9, 10, 12), (1, 2, 3, 4)))
"""Numbers of squares along and across the half beam; if the latter is even, A is a corner node."""
PATTERNS: tuple[DiagonalPattern, ...] = ("right", "right_left", "left_right", "crossed")
LOADS = ("point", "uniform")
ENDS = MIDDLES = ("centre", "face")
PRESTRESS_SUPPORTS = ("antisymmetric", "symmetric")

FACTOR_TOLERANCE = 1e-10
"""Relative tolerance of the eigenvalue solver."""
MAX_IMAGINARY_RATIO = 1e-6
"""|Im| / |Re| above which a factor is complex: the model has no critical stress."""
PASCALS_PER_DIGIT = 1e3
"""Unit of critical stresses in the record; those of the first mode have seven digits then."""
RECORD_TOLERANCE = 2
"""Largest difference, in units of the record, of a recomputed critical stress from the record."""


class SetUp(NamedTuple):
    """Load and supports of the models of both modes."""

    load: str
    end: str
    middle: str
    prestress: str


class Treatment(NamedTuple):
    """How an element's matrices are formed.

    `points` is the number of integration points of the geometric stiffness per triangle or
    sub-triangle, or 0 for an exact rule; `stress` is "point" or "mean"; `symmetrised` is "no",
    "both" (steps), or "eigenvalue" (step only).
    """

    form: Form
    stress: str
    points: int
    symmetrised: str = "no"


SET_UPS = tuple(
    SetUp(*choice)
    for choice in product(LOADS, ENDS, MIDDLES, PRESTRESS_SUPPORTS)
    if choice[0] == "point" or choice[3] == "antisymmetric"
)
MODE_1_SET_UPS = tuple(product(LOADS, ENDS))
"""Combinations of load and end support, on which alone mode 1 depends."""

# With the mean stress the integrand has a lower degree: one point is exact for the new element, and
# three points are exact for the standard one. Three points are exact for the new element with any
# stress. With one point in a triangle the standard element uses the mean stress anyway
TREATMENTS: dict[str, tuple[Treatment, ...]] = {
    "standard": tuple(
        Treatment(form, stress, points)
        for form in FORMS
        for stress, points in (("point", 0), ("point", 3), ("point", 1), ("mean", 3))
    ),
    "new": tuple(
        Treatment(form, stress, points, symmetrised)
        for symmetrised in ("no", "both", "eigenvalue")
        for form in FORMS
        for stress, points in (("point", 3), ("point", 1), ("mean", 1))
    ),
}
QUADRATURE_DEGREE = {0: None, 3: 2, 1: 1}
"""Degree of the quadrature rule by number of points; None selects the library's exact rule."""


class Mesh(NamedTuple):
    """Mesh of the half beam: pattern of diagonals, and numbers of squares along and across."""

    pattern: DiagonalPattern
    nx: int
    ny: int


MESHES = tuple(
    Mesh(pattern, nx, ny)
    for nx, ny in DIVISIONS
    for pattern in PATTERNS
    if not (pattern == "left_right" and ny % 2)
)


class MeshModels:
    """Critical stresses of all models on one mesh."""

    def __init__(self, mesh: Mesh) -> None:
        corners = (0.0, -HEIGHT / 2), (HALF_LENGTH, HEIGHT / 2)
        self._mesh = triangles(MPI.COMM_SELF, *corners, (mesh.nx, mesh.ny), mesh.pattern)
        self._elements = {
            "standard": _Element(Spaces.galerkin(self._mesh)),
            "new": _Element(Spaces.petrov_galerkin(self._mesh)),
        }

    def mode_1(self, element: str, load: str, end: str) -> list[float]:
        """Return the critical stresses of mode 1, one for each treatment; NaN if there is none."""
        supports = _Supports(1, end, "")
        return [
            self._elements[element].critical_stress(load, supports, supports, treatment)
            for treatment in TREATMENTS[element]
        ]

    def mode_2(self, element: str, set_up: SetUp) -> list[float]:
        """Return the critical stresses of mode 2, one for each treatment; NaN if there is none."""
        supports = static = _Supports(2, set_up.end, set_up.middle)
        if set_up.prestress == "symmetric":
            static = _Supports(1, set_up.end, "")
        return [
            self._elements[element].critical_stress(set_up.load, static, supports, treatment)
            for treatment in TREATMENTS[element]
        ]


class _Supports(NamedTuple):
    """Supports of the model of one mode, in the terms of `SetUp`."""

    mode: int
    end: str
    middle: str


@dataclass(frozen=True)
class _Factors:
    """Factorised stiffness of the free unknowns."""

    free: npt.NDArray[np.intp]
    lu: SuperLU
    is_definite: bool


class _Element:
    """One element on one mesh, with the matrices that its models share."""

    def __init__(self, spaces: Spaces) -> None:
        self._spaces = spaces
        self._body = self._make_body(None)
        self._x = spaces.trial.tabulate_dof_coordinates()[:, :2]
        K = _to_scipy(assemble_matrix(self._body.stiffness()))
        self._stiffness = {False: K, True: _symmetric_part(K)}
        self._displacement = fem.Function(spaces.trial)
        self._point_stress = self._body.stress(self._displacement)
        stresses = fem.functionspace(spaces.mesh, ("DG", 0, (2, 2)))
        self._mean_stress = fem.Function(stresses)
        # The stress is linear within an element, so its mean is the value at the centroid
        self._centroid_stress = fem.Expression(self._point_stress, np.array([[1 / 3, 1 / 3]]))
        self._forms: dict[tuple[Form, str, int], fem.Form] = {}
        self._geometric_stiffness = cache(self._assemble_geometric_stiffness)
        self._factors = cache(self._factorise)

    def critical_stress(
        self, load: str, static: _Supports, supports: _Supports, treatment: Treatment
    ) -> float:
        """Return the smallest positive factor of unit nominal stress; NaN if there is none.

        Args:
            load: "point" or "uniform".
            static: Supports under which the prestress is computed.
            supports: Supports of the buckling mode.
            treatment: How the matrices are formed.
        """
        symmetrised = treatment.symmetrised != "no"
        factors = self._factors(supports, symmetrised)
        if not factors.is_definite:
            return float("nan")
        K_sigma = self._geometric_stiffness(
            load,
            static,
            treatment.symmetrised == "both",
            treatment.form,
            treatment.stress,
            treatment.points,
        )
        if symmetrised:
            K_sigma = _symmetric_part(K_sigma)
        return _smallest_positive_factor(factors.lu, K_sigma[factors.free][:, factors.free])

    def _assemble_geometric_stiffness(
        self, load: str, static: _Supports, symmetrised: bool, form: Form, stress: str, points: int
    ) -> csr_matrix:
        self._displacement.x.array[:] = self._solve_prestress(load, static, symmetrised)
        if stress == "mean":
            self._mean_stress.interpolate(self._centroid_stress)
        key = form, stress, points
        if key not in self._forms:
            tensor = self._mean_stress if stress == "mean" else self._point_stress
            body = self._make_body(QUADRATURE_DEGREE[points])
            self._forms[key] = fem.form(body.geometric_stiffness(tensor, form))
        return fem.assemble_matrix(self._forms[key]).to_scipy().tocsr()

    def _solve_prestress(self, load: str, static: _Supports, symmetrised: bool) -> Array:
        factors = self._factors(static, symmetrised)
        displacement = np.zeros(2 * len(self._x))
        displacement[factors.free] = factors.lu.solve(self._load(load, static.mode)[factors.free])
        return displacement

    def _load(self, load: str, mode: int) -> Array:
        """Return the load vector of unit nominal stress.

        A point load acts at A only. For mode 2 a uniform load acts on the mid-section, too.
        """
        if load == "point":
            vector = np.zeros(2 * len(self._x))
            vector[2 * np.flatnonzero(self._on_end_face() & self._on_axis())] = HEIGHT
            return vector
        end_face = boundary_measure(self._spaces.mesh, lambda x: np.isclose(x[0], 0.0))
        vector = assemble_vector(self._body.surface_load((1.0, 0.0), end_face)).array_r.copy()
        if mode == 2:
            middle = boundary_measure(self._spaces.mesh, lambda x: np.isclose(x[0], HALF_LENGTH))
            vector += assemble_vector(self._body.surface_load((-1.0, 0.0), middle)).array_r
        return vector

    def _factorise(self, supports: _Supports, symmetrised: bool) -> _Factors:
        parts = {"centre": self._on_axis(), "face": np.ones(len(self._x), dtype=bool)}
        fixed = np.zeros((len(self._x), 2), dtype=bool)
        fixed[:, 1] |= self._on_end_face() & parts[supports.end]
        if supports.mode == 1:
            fixed[:, 0] |= self._on_mid_section()
        else:
            fixed[:, 0] |= self._on_mid_section() & self._on_axis()
            fixed[:, 1] |= self._on_mid_section() & parts[supports.middle]
        free = np.flatnonzero(~fixed.ravel())
        K = self._stiffness[symmetrised][free][:, free].tocsc()
        return _Factors(free, splu(K), not symmetrised or _is_positive_definite(K.toarray()))

    def _on_end_face(self) -> npt.NDArray[np.bool_]:
        return np.isclose(self._x[:, 0], 0.0)

    def _on_mid_section(self) -> npt.NDArray[np.bool_]:
        return np.isclose(self._x[:, 0], HALF_LENGTH)

    def _on_axis(self) -> npt.NDArray[np.bool_]:
        return np.isclose(self._x[:, 1], 0.0)

    def _make_body(self, quadrature_degree: int | None) -> Body:
        material, state = Material(YOUNGS_MODULUS, 0.0), StressState.PLANE_STRESS
        return Body(self._spaces, material, state, quadrature_degree=quadrature_degree)


def _to_scipy(matrix: PETSc.Mat) -> csr_matrix:
    pointers, columns, entries = matrix.getValuesCSR()
    return csr_matrix((entries, columns, pointers))


def _symmetric_part(matrix: csr_matrix) -> csr_matrix:
    return ((matrix + matrix.T) / 2).tocsr()


def _is_positive_definite(matrix: Array) -> bool:
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        return False
    return True


def _smallest_positive_factor(lu: SuperLU, K_sigma: csr_matrix) -> float:
    """Return the smallest positive s of (K + s K_sigma) d = 0; NaN if there is none or it is complex.

    1 / s are the eigenvalues of -K^-1 K_sigma.
    """
    n = K_sigma.shape[0]
    inverse = LinearOperator((n, n), lambda d: -lu.solve(K_sigma @ d), dtype=float)
    start = np.random.default_rng(0).standard_normal(n)
    options = {"which": "LR", "v0": start, "tol": FACTOR_TOLERANCE, "return_eigenvectors": False}
    try:
        values = eigs(inverse, k=2, ncv=min(24, n), maxiter=1000, **options)
    except ArpackNoConvergence:
        values = np.linalg.eigvals(-lu.solve(K_sigma.toarray()))
    largest = values[np.argmax(values.real)]
    if largest.real <= 0 or abs(largest.imag) > MAX_IMAGINARY_RATIO * largest.real:
        return float("nan")
    return float(1 / largest.real)


# The record


class Family(NamedTuple):
    """Critical stresses in Pa of all models, NaN where a model has none.

    `stresses[element]` has the shape (meshes, set-ups, treatments, 2 modes).
    """

    stresses: dict[str, Array]


def compute_mesh(mesh: Mesh) -> dict[str, dict[str, Array]]:
    """Return critical stresses on one mesh: arrays (set-ups, treatments) by element and mode."""
    models = MeshModels(mesh)
    return {
        element: {
            "mode_1": np.array([models.mode_1(element, *set_up) for set_up in MODE_1_SET_UPS]),
            "mode_2": np.array([models.mode_2(element, set_up) for set_up in SET_UPS]),
        }
        for element in TREATMENTS
    }


def list_keys() -> list[str]:
    """Return the keys of all rows, such as "table-2/right-6x1"."""
    return [_row_key(mesh) for mesh in MESHES]


def digest_input(mesh: Mesh) -> str:
    """Return the digest of a mesh, the material, and all set-ups and treatments."""
    beam = [YOUNGS_MODULUS, HALF_LENGTH, HEIGHT]
    return records.digest_input([mesh, beam, MODE_1_SET_UPS, SET_UPS, TREATMENTS])


def compute_row(key: str) -> RecordRow:
    """Compute the critical stresses of all models on the mesh of a key."""
    mesh = MESHES[list_keys().index(key)]
    content: dict[str, object] = {"mesh": list(mesh)}
    for element, modes in compute_mesh(mesh).items():
        for mode, stresses in modes.items():
            content[f"{element}_{mode}"] = [
                [None if np.isnan(s) else round(s / PASCALS_PER_DIGIT) for s in set_up]
                for set_up in stresses
            ]
    return records.create_row_with_current_date(key, digest_input(mesh), content)


def difference_of_rows(row: RecordRow, recorded: RecordRow) -> float:
    """Return the largest difference of two rows in last digits; infinite if others are missing.

    Args:
        row: Computed row.
        recorded: Recorded row with the same key.
    """
    worst = 0.0
    for name in (name for name in row.content if name != "mesh"):
        worst = max(worst, records.largest_difference(row.content[name], recorded.content[name]))
    return worst


def read_stresses(mesh: Mesh, element: str, mode: str) -> Array:
    """Return recorded critical stresses (set-ups, treatments) in Pa.

    Args:
        mesh: One of `MESHES`.
        element: "standard" or "new".
        mode: "mode_1" or "mode_2".
    """
    return _stresses_of_row(records.read_rows(records.TABLE_2)[_row_key(mesh)], element, mode)


def read_family() -> Family:
    """Return the recorded critical stresses of all models."""
    rows = records.read_rows(records.TABLE_2)
    mode_1_indices = [MODE_1_SET_UPS.index(set_up[:2]) for set_up in SET_UPS]
    stresses = {}
    for element in TREATMENTS:
        stresses_by_mesh = [
            np.stack(
                [
                    _stresses_of_row(rows[key], element, "mode_1")[mode_1_indices],
                    _stresses_of_row(rows[key], element, "mode_2"),
                ],
                axis=-1,
            )
            for key in list_keys()
        ]
        stresses[element] = np.array(stresses_by_mesh)
    return Family(stresses)


def _stresses_of_row(row: RecordRow, element: str, mode: str) -> Array:
    return np.array(row.content[f"{element}_{mode}"], dtype=float) * PASCALS_PER_DIGIT


def _row_key(mesh: Mesh) -> str:
    return f"table-2/{mesh.pattern}-{mesh.nx}x{mesh.ny}"
