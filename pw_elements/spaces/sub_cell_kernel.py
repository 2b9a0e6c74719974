"""C source of the element matrix of a bilinear form on a straight tetrahedron, by sub-cells.

FFCx evaluates the product of each pair of shape functions at each quadrature point: 10 x 10 pairs
of nodes at the points of twelve sub-cells. The kernel of this module needs fewer products, because
on a straight cell the slopes of the weight functions v are constant on each sub-cell, at most six
of ten weight functions differ from zero there, and the slopes of the trial functions u are linear
in the whole cell. Let the integrand of the bilinear form be

    sum over s, t of  A_st(x) D_s v D_t u,

where the operators D_s and D_t are components of the gradient and of the value. FFCx compiles only
the coefficients A_st, as an expression at the quadrature points x_q. Let P_r be the nodal basis of
the polynomials to which D_t u belongs, and U_rtm the value of D_t at the r-th node of this basis
for the shape function of node m. The matrix follows in three steps:

    moments on a sub-cell     M_rst = sum over its points of  w_q P_r(x_q) A_st(x_q)
    sum over sub-cells        T_nrt = sum over sub-cells and s of  D_s v_n M_rst
    matrix                    E_nm  = sum over r, t of  T_nrt U_rtm

The values of weight functions are not constant on sub-cells; their terms are added to T at each
quadrature point.

The module guarantees that the kernel integrates the given coefficients as FFCx would do, except for
round-off, or that `NotSeparableError` is raised.
"""

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import basix
import basix.ufl
import numpy as np
import numpy.typing as npt
from basix import CellType, ElementFamily, LagrangeVariant, PolysetType

from pw_elements.arrays import Array, Indices
from pw_elements.spaces.bilinear_coefficients import ArgumentComponent, NotSeparableError

_DIM = 3
_N_SUB_CELLS = 12
# Largest number of points over which a single expression in the source is a sum
_MAX_POINTS_PER_BATCH = 16
# Largest number of coefficients at all points of a cell, which the kernel keeps on the stack
_MAX_COEFFICIENTS = 2**17
# Largest difference between equal values of shape functions on reference cells
_TABLE_ROUND_OFF = 1e-10


@dataclass(frozen=True)
class _ScalarField:
    """One component of a test or trial function, and the unknowns of a cell that belong to it.

    Args:
        element: scalar element of the component.
        first, stride: number of its first unknown in the cell, and distance to the next ones.
    """

    element: basix.ufl._BasixElement
    first: int
    stride: int

    @classmethod
    def list_from_element(
        cls, element: basix.ufl._ElementBase, first: int = 0
    ) -> "list[_ScalarField]":
        """Return the components of a scalar, vector or mixed element, in UFL's order."""
        if isinstance(element, basix.ufl._MixedElement):
            sizes = [part.dim for part in element.sub_elements]
            starts = first + np.cumsum([0, *sizes[:-1]])
            pairs = zip(element.sub_elements, starts, strict=True)
            return [field for part, start in pairs for field in cls.list_from_element(part, start)]
        shape, size = element.reference_value_shape, 1
        if isinstance(element, basix.ufl._BlockedElement) and len(shape) == 1:
            element, size = element.sub_elements[0], element.block_size
        if not isinstance(element, basix.ufl._BasixElement) or element.reference_value_shape != ():
            raise NotSeparableError
        return [cls(element, int(first) + i, size) for i in range(size)]


@dataclass(frozen=True)
class _TestTable:
    """Weight functions of one element on the sub-cells, at nodes where they are not zero.

    Args:
        count: number (sub-cells,) of these nodes.
        node: their numbers (sub-cells, k); rows are filled up with zeros.
        value: values (q, k) at quadrature points, for the nodes of the sub-cell around the point.
        slope: slopes (sub-cells, k, dim) in the reference cell.
    """

    count: Indices
    node: Indices
    value: Array
    slope: Array

    @classmethod
    def from_element(
        cls, element: basix.ufl._BasixElement, points: Array, sub_cells: Indices, has_slopes: bool
    ) -> "_TestTable":
        """Tabulate an element at points (q, dim), whose numbers in each sub-cell are given.

        Raises:
            NotSeparableError: if slopes are needed and not constant on sub-cells.
        """
        table = element.tabulate(1, points)
        values, slopes = table[0][sub_cells], table[1:].transpose(1, 2, 0)[sub_cells]
        if has_slopes and np.ptp(slopes, axis=1).max() > _TABLE_ROUND_OFF:
            raise NotSeparableError
        size = np.maximum(np.abs(values), np.abs(slopes).max(axis=3)).max(axis=1)
        order = np.argsort(size <= _TABLE_ROUND_OFF, axis=1, kind="stable")
        count = (size > _TABLE_ROUND_OFF).sum(axis=1)
        node = order[:, : count.max()]
        value = np.zeros((len(points), node.shape[1]))
        value[sub_cells] = np.take_along_axis(values, node[:, None], axis=2)
        slope = np.take_along_axis(slopes[:, 0], node[:, :, None], axis=1)
        return cls(count, node, value, slope)

    def repeat_rows(self, n: int) -> "_TestTable":
        """Return the table with each row of sub-cells n times."""
        repeated = {
            name: getattr(self, name).repeat(n, axis=0) for name in ("count", "node", "slope")
        }
        return replace(self, **repeated)


@dataclass(frozen=True)
class _TrialBlock:
    """Columns of the array T for the value of a trial component, or for its slopes.

    Args:
        field: the trial component.
        degree: degree of the polynomials P_r.
        first: first column. The columns of the polynomials are adjacent; those of slopes in the
            next direction follow.
        table: values (columns, m) of the shape functions at the nodes of the polynomials. Slopes
            are those in the reference cell.
        is_slope: whether these are slopes.
    """

    field: _ScalarField
    degree: int
    first: int
    table: Array
    is_slope: bool

    @classmethod
    def from_field(
        cls, field: _ScalarField, is_slope: bool, first: int, points: Array
    ) -> "_TrialBlock":
        """Tabulate a trial component.

        Raises:
            NotSeparableError: if its values or slopes at the quadrature points are not those of
                polynomials in the whole cell.
        """
        degree = int(field.element.embedded_superdegree) - is_slope
        if not 0 <= degree <= field.element.embedded_superdegree <= 2:
            raise NotSeparableError
        basis = _polynomial_basis(degree)
        kinds = slice(1, None) if is_slope else slice(1)
        table = field.element.tabulate(1, basis.points)[kinds]
        expected = field.element.tabulate(1, points)[kinds]
        values = basis.tabulate(0, points)[0, :, :, 0] @ table
        if np.abs(values - expected).max() > _TABLE_ROUND_OFF:
            raise NotSeparableError
        return cls(field, degree, first, table.reshape(-1, table.shape[2]), is_slope)

    @property
    def n_columns(self) -> int:
        return len(self.table)

    @property
    def is_nodal(self) -> bool:
        """Whether the polynomials are the shape functions themselves."""
        n, width = self.table.shape
        return n == width and np.allclose(self.table, np.eye(n), atol=_TABLE_ROUND_OFF)


@dataclass(frozen=True)
class _Run:
    """Adjacent entries with the same test component and adjacent columns.

    Args:
        test: the test component.
        degree: degree of the polynomials of the trial components.
        entry, n_entries: number of the first entry, and number of entries.
        column, n_columns: first column, and number of columns.
    """

    test: ArgumentComponent
    degree: int
    entry: int
    n_entries: int
    column: int
    n_columns: int


def _polynomial_basis(degree: int) -> basix.finite_element.FiniteElement:
    variant = LagrangeVariant.gll_warped
    return basix.create_element(
        ElementFamily.P, CellType.tetrahedron, degree, variant, discontinuous=degree == 0
    )


class SubCellKernel:
    """Numbering, tables and source code of a kernel.

    Args:
        elements: elements of the test and the trial function.
        points: quadrature points (q, dim) in the reference cell.
        weights: weights (q,) of the points.
        keys: test and trial component of each coefficient that is not zero.

    Attributes:
        entries: the same components, in the order in which the kernel reads the coefficients.

    Raises:
        NotSeparableError: if there are not equally many points in each sub-cell, if slopes of test
            functions are not constant on sub-cells, if an element is of another kind, or if there
            are too many points and coefficients.
    """

    def __init__(
        self,
        elements: Sequence[basix.ufl._ElementBase],
        points: Array,
        weights: Array,
        keys: Iterable[tuple[ArgumentComponent, ArgumentComponent]],
    ) -> None:
        keys = list(keys)
        if len(keys) * len(points) > _MAX_COEFFICIENTS:
            raise NotSeparableError
        self._points = points
        self._tests, trials = map(_ScalarField.list_from_element, elements)
        self._n_rows, self._n_unknowns = (element.dim for element in elements)
        sub_cells = _group_points_by_sub_cell([f.element for f in self._tests], points)
        n_batches = -(-sub_cells.shape[1] // _MAX_POINTS_PER_BATCH)
        self._batches, self._batch_weights = _divide_into_batches(sub_cells, weights, n_batches)
        have_slopes = {self._tests[s.component].element for s, _ in keys if s.is_slope}
        self._test_elements = list(dict.fromkeys(f.element for f in self._tests))
        self._test_tables = [
            _TestTable.from_element(e, points, sub_cells, e in have_slopes).repeat_rows(n_batches)
            for e in self._test_elements
        ]
        self._blocks: dict[tuple[int, bool], _TrialBlock] = {}
        self._n_columns = 0
        for component, is_slope in sorted({(t.component, t.is_slope) for _, t in keys}):
            block = _TrialBlock.from_field(trials[component], is_slope, self._n_columns, points)
            self._blocks[component, is_slope] = block
            self._n_columns += block.n_columns
        self.entries = sorted(
            keys, key=lambda key: (not key[0].is_slope, key[0], self._column_range(key[1]))
        )
        self._runs = self._find_runs()

    def _column_range(self, trial: ArgumentComponent) -> tuple[int, int]:
        """Return the first column of a trial component, and the number of its columns."""
        block = self._blocks[trial.component, trial.is_slope]
        if not trial.is_slope:
            return block.first, block.n_columns
        size = block.n_columns // _DIM
        return block.first + trial.direction * size, size

    def _find_runs(self) -> list[_Run]:
        runs: list[_Run] = []
        for number, (test, trial) in enumerate(self.entries):
            degree = self._blocks[trial.component, trial.is_slope].degree
            column, size = self._column_range(trial)
            last = runs[-1] if runs else None
            if (
                last
                and (last.test, last.degree) == (test, degree)
                and last.column + last.n_columns == column
            ):
                n_entries, n_columns = last.n_entries + 1, last.n_columns + size
                runs[-1] = replace(last, n_entries=n_entries, n_columns=n_columns)
            else:
                runs.append(_Run(test, degree, number, 1, column, size))
        return runs

    def generate_source(self, gather_w: str, gather_c: str) -> str:
        """Return the C source of the kernel, which accumulates in the matrix A.

        Args:
            gather_w: C statements that define the array `own_w` of the values of coefficients that
                the expression reads, from the array `w` of those of the form.
            gather_c: the same for constants and the arrays `own_c` and `c`.
        """
        n_points, n_entries = len(self._points), len(self.entries)
        return "\n".join(
            [
                _SOURCE_HEAD,
                *self._declare_tables(),
                _FUNCTION_HEAD,
                gather_w,
                gather_c,
                f"double coefficient[{n_points}][{n_entries}];",
                "memset(coefficient, 0, sizeof coefficient);",
                "tabulate_coefficients(&coefficient[0][0], own_w, own_c, coordinate_dofs, entity,",
                "                      permutation CUSTOM_DATA);",
                _GEOMETRY,
                f"double T[{self._n_rows}][{self._n_columns}];",
                "memset(T, 0, sizeof T);",
                *self._sum_over_sub_cells(),
                *self._physical_slopes_of_trial_functions(),
                *self._multiply_by_trial_functions(),
                "}",
            ]
        )

    def _declare_tables(self) -> list[str]:
        degrees = {block.degree for block in self._blocks.values()}
        tables = [
            _c_table("point", self._batches),
            _c_table("weight", self._batch_weights),
            *(
                _c_table(
                    f"P{degree}", _polynomial_basis(degree).tabulate(0, self._points)[0, :, :, 0]
                )
                for degree in sorted(degrees)
            ),
        ]
        names = {
            (self._test_number(run.test.component), name)
            for run in self._runs
            for name in ("count", "node", "slope" if run.test.is_slope else "value")
        }
        tables += [
            _c_table(f"{name}{number}", getattr(self._test_tables[number], name))
            for number, name in sorted(names)
        ]
        blocks = [block for block in self._blocks.values() if not block.is_nodal]
        return tables + [_c_table(f"U{block.first}", block.table) for block in blocks]

    def _sum_over_sub_cells(self) -> list[str]:
        """Return the loop over sub-cells that computes T from the coefficients.

        The arrays M hold the moments for slopes of test functions. The arrays V hold the products
        w_q P_r(x_q) A_st(x_q) for values of test functions at one of the points. Sums over points
        and directions are single expressions, which is faster than to add to an array repeatedly.
        """
        points = range(self._batches.shape[1])
        slope_runs = [run for run in self._runs if run.test.is_slope]
        value_runs = [run for run in self._runs if not run.test.is_slope]
        lines = [f"for (int batch = 0; batch < {len(self._batches)}; ++batch)", "{"]
        lines += [f"const double* a{k} = coefficient[point[batch][{k}]];" for k in points]
        for degree in sorted({run.degree for run in self._runs}):
            size = self._polynomial_count(degree)
            lines += [
                f"double p{degree}[{len(points)}][{size}];",
                f"for (int k = 0; k < {len(points)}; ++k)",
                f"for (int r = 0; r < {size}; ++r)",
                f"p{degree}[k][r] = volume * weight[batch][k] * P{degree}[point[batch][k]][r];",
            ]
        # terms of the rows of each test component: factor at node n, and its multiplicand
        terms: dict[tuple[int, int, int], list[tuple[str, str]]] = {}
        for number, run in enumerate(slope_runs):
            total = " + ".join(f"a{k}[{run.entry} + e] * p{run.degree}[{k}][r]" for k in points)
            lines += self._declare_and_fill(f"M{number}", run, total)
            factor = f"s{self._test_number(run.test.component)}[n][{run.test.direction}]"
            key = run.test.component, run.column, run.n_columns
            terms.setdefault(key, []).append((factor, f"M{number}[i]"))
        for (number, run), k in itertools.product(enumerate(value_runs), points):
            product = f"a{k}[{run.entry} + e] * p{run.degree}[{k}][r]"
            lines += self._declare_and_fill(f"V{number}_{k}", run, product)
            factor = f"value{self._test_number(run.test.component)}[point[batch][{k}]][n]"
            key = run.test.component, run.column, run.n_columns
            terms.setdefault(key, []).append((factor, f"V{number}_{k}[i]"))
        for number in sorted({self._test_number(run.test.component) for run in slope_runs}):
            width = self._test_tables[number].node.shape[1]
            lines += [
                f"double s{number}[{width}][{_DIM}];",
                f"for (int n = 0; n < {width}; ++n)",
                f"for (int j = 0; j < {_DIM}; ++j)",
                f"s{number}[n][j] = "
                + " + ".join(f"slope{number}[batch][n][{i}] * K[{i}][j]" for i in range(_DIM))
                + ";",
            ]
        for (component, column, n_columns), products in terms.items():
            lines += self._add_to_rows(component, column, n_columns, products)
        return [*lines, "}"]

    def _declare_and_fill(self, array: str, run: _Run, value: str) -> list[str]:
        """Declare an array for the columns of a run; `value` depends on its entry e and on r."""
        size = self._polynomial_count(run.degree)
        return [
            f"double {array}[{run.n_columns}];",
            f"for (int e = 0; e < {run.n_entries}; ++e)",
            f"for (int r = 0; r < {size}; ++r)",
            f"{array}[{size} * e + r] = {value};",
        ]

    def _polynomial_count(self, degree: int) -> int:
        return int(_polynomial_basis(degree).dim)

    def _test_number(self, component: int) -> int:
        """Return the number of the table of a test component."""
        return self._test_elements.index(self._tests[component].element)

    def _add_to_rows(
        self, component: int, column: int, n_columns: int, products: list[tuple[str, str]]
    ) -> list[str]:
        """Return a loop over the nodes of a sub-cell that adds products to columns of T.

        Args:
            component: test component whose rows are changed.
            column: first column.
            n_columns: number of columns.
            products: factor at node n, and what it multiplies in column i.
        """
        field, number = self._tests[component], self._test_number(component)
        total = " + ".join(f"f{i} * {factor}" for i, (_, factor) in enumerate(products))
        return [
            f"for (int n = 0; n < count{number}[batch]; ++n)",
            "{",
            f"double* t = T[{field.first} + {field.stride} * node{number}[batch][n]] + {column};",
            *(f"const double f{i} = {factor};" for i, (factor, _) in enumerate(products)),
            f"for (int i = 0; i < {n_columns}; ++i) t[i] += {total};",
            "}",
        ]

    def _physical_slopes_of_trial_functions(self) -> list[str]:
        lines = []
        for block in self._blocks.values():
            if block.is_slope:
                n_columns, width = block.table.shape
                size, name = n_columns // _DIM, f"U{block.first}"
                lines.append(
                    f"double G{block.first}[{n_columns}][{width}];\n"
                    f"for (int j = 0; j < {_DIM}; ++j)\n"
                    f"for (int r = 0; r < {size}; ++r)\n"
                    f"for (int m = 0; m < {width}; ++m)\n"
                    f"G{block.first}[{size} * j + r][m] = "
                    + " + ".join(f"{name}[{size * i} + r][m] * K[{i}][j]" for i in range(_DIM))
                    + ";"
                )
        return lines

    def _multiply_by_trial_functions(self) -> list[str]:
        lines = []
        coupled = {(s.component, t.component, t.is_slope) for s, t in self.entries}
        for component, group in itertools.groupby(sorted(coupled), key=lambda item: item[0]):
            test = self._tests[component]
            lines += [
                f"for (int n = 0; n < {test.element.dim}; ++n)",
                "{",
                f"const double* t = T[{test.first} + {test.stride} * n];",
                f"double* row = A + {self._n_unknowns} * ({test.first} + {test.stride} * n);",
            ]
            for _, trial, is_slope in group:
                block = self._blocks[trial, is_slope]
                width, table = block.table.shape[1], f"{'G' if is_slope else 'U'}{block.first}"
                if block.is_nodal:
                    total = f"t[{block.first} + m]"
                else:
                    columns = range(block.n_columns)
                    total = " + ".join(f"t[{block.first + r}] * {table}[{r}][m]" for r in columns)
                lines += [
                    f"for (int m = 0; m < {width}; ++m)",
                    f"row[{block.field.first} + {block.field.stride} * m] += {total};",
                ]
            lines.append("}")
        return lines


def _group_points_by_sub_cell(
    elements: Sequence[basix.ufl._BasixElement], points: Array
) -> Indices:
    """Return the numbers (sub-cells, k) of the points in each sub-cell of one of the elements.

    The sub-cells are distinguished by the slopes of the element's functions.
    """
    macros = [element for element in elements if element.polyset_type is PolysetType.macroedge]
    if not macros:
        raise NotSeparableError
    slopes = macros[0].tabulate(1, points)[1:].swapaxes(0, 1).reshape(len(points), -1)
    _, sub_cell = np.unique(slopes.round(6), axis=0, return_inverse=True)
    counts = np.bincount(sub_cell.ravel())
    if len(counts) != _N_SUB_CELLS or np.any(counts != counts[0]):
        raise NotSeparableError
    return np.argsort(sub_cell.ravel(), kind="stable").reshape(len(counts), -1)


def _divide_into_batches(
    sub_cells: Indices, weights: Array, n_batches: int
) -> tuple[Indices, Array]:
    """Divide the points of each sub-cell into batches.

    Args:
        sub_cells: numbers (sub-cells, k) of the points in each sub-cell.
        weights: weights (q,) of all points.
        n_batches: number of batches of each sub-cell.

    Returns:
        Numbers and weights (sub-cells n_batches, points) of the points in each batch. Batches are
        filled up with points of weight zero.
    """
    n_added = -sub_cells.shape[1] % n_batches
    points = np.pad(sub_cells, ((0, 0), (0, n_added)), mode="edge")
    batch_weights = np.pad(weights[sub_cells], ((0, 0), (0, n_added)))
    shape = len(sub_cells) * n_batches, -1
    return points.reshape(shape), batch_weights.reshape(shape)


def _c_table(name: str, values: npt.NDArray) -> str:
    """Return the declaration of a constant C array."""
    kind = "int" if values.dtype.kind == "i" else "double"
    shape = "".join(f"[{n}]" for n in values.shape)
    return f"static const {kind} {name}{shape} = {_c_braces(values.tolist())};"


def _c_braces(values: Any) -> str:  # noqa: ANN401
    if not isinstance(values, list):
        return repr(values)
    return "{" + ", ".join(map(_c_braces, values)) + "}"


_SOURCE_HEAD = """\
#include <math.h>
#include <stdint.h>
#include <string.h>
#include <ufcx.h>

#if UFCX_VERSION_MINOR < 10
#define CUSTOM_DATA_PARAMETER
#define CUSTOM_DATA
#else
#define CUSTOM_DATA_PARAMETER , void* custom_data
#define CUSTOM_DATA , custom_data
#endif

static ufcx_tabulate_tensor_float64* tabulate_coefficients;
"""

_FUNCTION_HEAD = """\
static void tabulate_matrix(double* restrict A, const double* restrict w,
                            const double* restrict c, const double* restrict coordinate_dofs,
                            const int* restrict entity,
                            const uint8_t* restrict permutation CUSTOM_DATA_PARAMETER)
{"""

# Statements that compute the inverse K of the Jacobian, and the absolute value of its determinant
_GEOMETRY = """\
double J[3][3], K[3][3];
for (int i = 0; i < 3; ++i)
for (int j = 0; j < 3; ++j)
J[i][j] = coordinate_dofs[3 * (j + 1) + i] - coordinate_dofs[i];
for (int i = 0; i < 3; ++i)
for (int j = 0; j < 3; ++j)
{
const int a = (i + 1) % 3, b = (i + 2) % 3, u = (j + 1) % 3, v = (j + 2) % 3;
K[j][i] = J[a][u] * J[b][v] - J[a][v] * J[b][u];
}
const double det = J[0][0] * K[0][0] + J[0][1] * K[1][0] + J[0][2] * K[2][0];
for (int i = 0; i < 3; ++i)
for (int j = 0; j < 3; ++j)
K[i][j] /= det;
const double volume = fabs(det);"""
