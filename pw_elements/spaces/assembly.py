"""Free assembly of forms, with the rules that their functions need.

Weights on tetrahedra need points on sub-cells FFCx knows nothing of. Stiffnesses need four points
instead of twelve: stresses of quadratic displacements are linear in straight cells, and the means
of slopes at the vertices integrate their products exactly. For all other elements FFCx takes the
right rule by itself: that of the halved cell wherever a test or trial function is piecewise linear.
So it does on the faces of tetrahedra.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

from mpi4py import MPI
from petsc4py import PETSc

import basix.ufl
import ufl
from basix import CellType, PolysetType
from dolfinx import fem
from dolfinx.fem.petsc import assemble_matrix as _assemble_matrix
from dolfinx.fem.petsc import assemble_vector as _assemble_vector
from dolfinx.fem.petsc import create_matrix
from ufl.algorithms import (
    compute_form_data,
    extract_arguments,
    extract_coefficients,
    extract_elements,
    extract_sub_elements,
)
from ufl.classes import Grad
from ufl.corealg.traversal import unique_pre_traversal

from pw_elements.arrays import Array
from pw_elements.checks import arguments, check_same_arguments
from pw_elements.progress import report_activity
from pw_elements.spaces.elements import TwelveCellElement, twelve_cell_rule, vertex_rule

# Key under which the metadata of a body's integrals hold its state of stress
STRESS_STATE_KEY = "stress_state"

T = TypeVar("T", PETSc.Mat, PETSc.Vec)


@dataclass(frozen=True)
class AssemblyRecord:
    """What a matrix or vector was assembled from, so that mismatched ones can be refused."""

    form: fem.Form | None = None  # compiled; None of what was made by hand
    sibling: Any = None  # that transformed it; None of what was assembled plainly
    stress_states: frozenset[str] = (
        frozenset()
    )  # of stress, of the bodies of the forms; if these tell
    lumped: bool = False  # a diagonal of nodal masses, which suit any weights

    @classmethod
    def from_form(cls, compiled: fem.Form, form: ufl.Form) -> "AssemblyRecord":
        states = {integral.metadata().get(STRESS_STATE_KEY) for integral in form.integrals()}
        return cls(compiled, stress_states=frozenset(states - {None}))

    @classmethod
    def read(cls, thing: PETSc.Mat | PETSc.Vec) -> "AssemblyRecord":
        return thing.getAttr("assembled") or cls()

    def attach(self, thing: T) -> T:
        """The thing, of which this is known from now on; the form lives as long as it does."""
        thing.setAttr("assembled", self)
        return thing

    @property
    def mesh(self) -> Any:  # noqa: ANN401
        """C++ mesh of the form, None if it is not known."""
        return None if self.form is None else self.form.function_spaces[0].mesh

    @property
    def test_space(self) -> Any:  # noqa: ANN401
        """Space of the test functions, None if there are none or they do not count."""
        return None if self.form is None or self.lumped else self.form.function_spaces[0]


@check_same_arguments
def assemble_matrix(form: ufl.Form, blocked: bool = False) -> PETSc.Mat:
    """Matrix of a bilinear form, all rows and columns free.

    Integrals of piecewise-linear functions over tetrahedra get the quadrature rule that they need.
    The form (and by it mesh and spaces) lives as long as the matrix.

    Args:
        form: of trial and test functions.
        blocked: stores a vector field's matrix by nodal blocks (PETSc's BAIJ), in 0.7 of the
            memory. `Iterative` works with these, and copies a matrix in another format; all else
            converts them. Without effect on scalar and hybrid spaces.

    Raises:
        TypeError: if it is not a UFL form.
        ValueError: if it is not bilinear, cannot be compiled, or has a measure with a quadrature
            rule that does not suit the weights.
    """
    arguments.check_flag("blocked", blocked)
    compiled = compile_form(form, 2, "a matrix")
    nodal = all(space.dofmap.index_map_bs > 1 for space in compiled.function_spaces)
    matrix = create_matrix(compiled, "baij" if blocked and nodal else None)
    _assemble_matrix(matrix, compiled)
    matrix.assemble()
    return AssemblyRecord.from_form(compiled, form).attach(matrix)


@check_same_arguments
def assemble_vector(form: ufl.Form) -> PETSc.Vec:
    """Vector (n,) of a linear form, contributions of all processes added.

    Integrals of piecewise-linear functions over tetrahedra get the quadrature rule that they need.

    Args:
        form: of a test function.

    Raises:
        TypeError: if it is not a UFL form.
        ValueError: if it is not linear, cannot be compiled, or has a measure with a quadrature
            rule that does not suit the weights.
    """
    compiled = compile_form(form, 1, "a vector")
    vector = _assemble_vector(compiled)
    vector.ghostUpdate(PETSc.InsertMode.ADD, PETSc.ScatterMode.REVERSE)
    return AssemblyRecord.from_form(compiled, form).attach(vector)


@check_same_arguments
def assemble_scalar(form: ufl.Form) -> float:
    """Value of a functional (an energy, an error's square), summed over all processes.

        area = assemble_scalar(1.0 * boundary_measure(mesh, where))

    Integrals of piecewise-linear functions over tetrahedra get the quadrature rule that they need.

    Args:
        form: without arguments.

    Raises:
        TypeError: if it is not a UFL form.
        ValueError: if it has a test function, belongs to no mesh, cannot be compiled, or has a
            measure with a quadrature rule that does not suit the weights.
    """
    compiled = compile_form(form, 0, "a functional")
    return float(compiled.mesh.comm.allreduce(fem.assemble_scalar(compiled), MPI.SUM))


def compile_form(form: ufl.Form, rank: int, of: str) -> fem.Form:
    arguments.check_type(
        "the form", form, ufl.Form, "an integrand times a measure makes a ufl.Form"
    )
    kinds = {0: "a number (no test function)", 1: "linear", 2: "bilinear"}
    found = len(form.arguments())
    if found != rank:
        needed = f"a {kinds[rank]} form" if rank else "a form without test functions"
        raise ValueError(f"{of} needs {needed}; this one is {kinds.get(found, found)}")
    spaces = [argument.ufl_function_space() for argument in form.arguments()]
    for space in spaces:
        arguments.check_space(space, "the space of a form's argument")
    functions = [f for f in form.coefficients() if isinstance(f, fem.Function)]
    meshes = [thing.mesh for thing in (*spaces, *(f.function_space for f in functions))]
    domains = form.ufl_domains()
    if any(mesh is not meshes[0] for mesh in meshes) or len(domains) != 1:
        raise ValueError("the form mixes meshes: its functions and measures have to share one")
    if (mesh := domains[0].ufl_cargo()) is None:
        raise ValueError("the form belongs to no mesh: give its measure a domain")
    for kind, marked in form.subdomain_data()[domains[0]].items():
        if any(other is not marked[0] for other in marked):
            raise ValueError(
                f"the form has several measures of {kind.replace('_', ' ')}s, of which DOLFINx "
                "takes one: assemble a form of each and add the results"
            )
    plain = _with(
        form, lambda part: {k: v for k, v in part.metadata().items() if k != STRESS_STATE_KEY}
    )
    ruled = add_sub_cell_rules(plain)
    try:
        with report_activity(mesh.comm, "compiling a form"):
            return fem.form(ruled)
    except Exception as error:
        raise ValueError(f"the form cannot be compiled: {error}") from error


def cell_measure(space: fem.FunctionSpace, degree: int) -> ufl.Measure:
    """Measure dx for integrals of test functions, also in DOLFINx's own assembly.

        dx = cell_measure(W, 2)
        load = fem.assemble_vector(fem.form(f * ufl.TestFunction(W) * dx))

    Args:
        space: the test space.
        degree: of the polynomials that are integrated exactly on each sub-cell.
    """
    arguments.check_space(space)
    arguments.check_integer("degree", degree, 0)
    metadata: dict[str, Any] = {"quadrature_degree": degree}
    if _halved_tetrahedra(space.ufl_element()):
        metadata |= _custom(*twelve_cell_rule(degree))
    return ufl.Measure("dx", domain=space.mesh, metadata=metadata)


def add_sub_cell_rules(form: ufl.Form) -> ufl.Form:
    """The form, with points on sub-cells in integrals over tetrahedra whose functions need them."""
    return _with(form, _ruled)


def add_estimated_degrees(form: ufl.Form) -> ufl.Form:
    """The form with UFL's estimate of the degree written into measures that state none.

    A derivative of the form then has the same points, of which Newton's method has its order.
    """

    def stated(part: ufl.Integral) -> dict[str, Any]:
        known: dict[str, Any] = part.metadata()
        if known.keys() & {"quadrature_degree", "quadrature_rule"}:
            return known
        return {**known, "quadrature_degree": _estimated_degree(part)}

    return _with(form, stated)


def _with(form: ufl.Form, metadata: Callable[[ufl.Integral], dict[str, Any]]) -> ufl.Form:
    return ufl.Form([part.reconstruct(metadata=metadata(part)) for part in form.integrals()])


def _ruled(integral: ufl.Integral) -> dict[str, Any]:
    """The metadata of an integral, with points on sub-cells if it needs and has none."""
    metadata: dict[str, Any] = integral.metadata()
    rule = metadata.get("quadrature_rule", "default")
    halved = any(map(_halved_tetrahedra, extract_elements(integral)))
    if integral.integral_type() != "cell" or rule == "custom" or not halved:
        return metadata
    if rule != "default":
        raise ValueError(
            f"the measure's quadrature_rule {rule!r} is one of the whole tetrahedron, but weights "
            "are linear on sub-cells: give the quadrature_degree alone"
        )
    degree = metadata.get("quadrature_degree", -1)
    if degree < 0:
        degree = _estimated_degree(integral)
    if degree == 1 and _is_linear_times_slopes(integral):
        return {**metadata, **_custom(*vertex_rule())}
    return {**metadata, **_custom(*twelve_cell_rule(degree))}


def _is_linear_times_slopes(integral: ufl.Integral) -> bool:
    """Whether it has slopes of one function that is the mean of three cuts, times linear ones."""
    functions = [*extract_arguments(integral), *extract_coefficients(integral)]
    halved = [f for f in functions if _halved_tetrahedra(f.ufl_element())]
    if len(halved) > 1 or _estimated_degree(integral) > 1:
        return False
    nodes = (
        node for part in _prepared(integral) for node in unique_pre_traversal(part.integrand())
    )
    valued = {
        operand for node in nodes if not isinstance(node, Grad) for operand in node.ufl_operands
    }
    means = all(
        isinstance(e, TwelveCellElement) for e in _halved_tetrahedra(halved[0].ufl_element())
    )
    return means and halved[0] not in valued


def _estimated_degree(integral: ufl.Integral) -> int:
    parts = _prepared(integral)
    return max(int(part.metadata()["estimated_polynomial_degree"]) for part in parts)


def _prepared(integral: ufl.Integral) -> list[ufl.Integral]:
    """The integrals that FFCx makes of it, of derivatives of functions alone."""
    data = compute_form_data(
        ufl.Form([integral]), do_apply_integral_scaling=True, do_append_everywhere_integrals=False
    )
    return [part for group in data.integral_data for part in group.integrals]


def _custom(points: Array, weights: Array) -> dict[str, Any]:
    return {  # tuples, for UFL's signature of a form abbreviates arrays
        "quadrature_rule": "custom",
        "quadrature_points": tuple(tuple(map(float, x)) for x in points),
        "quadrature_weights": tuple(map(float, weights)),
    }


def _halved_tetrahedra(element: basix.ufl._ElementBase) -> list[basix.ufl._BasixElement]:
    """The weights on tetrahedra that an element is, or holds; the twelve cells halve all."""
    return [
        part
        for part in extract_sub_elements([element])
        if isinstance(part, basix.ufl._BasixElement)
        and part.cell_type is CellType.tetrahedron
        and part.polyset_type is PolysetType.macroedge
    ]
