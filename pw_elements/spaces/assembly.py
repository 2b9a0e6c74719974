"""Assembly of forms without boundary conditions, with suitable quadrature rules.

Weight functions on tetrahedra are linear on twelve sub-cells, which FFCx does not know. Their
integrals need a quadrature rule with points in each sub-cell. The stiffness of straight cells needs
only four points instead of twelve: stresses of quadratic displacements are linear, and a rule with
the vertices as points, at which the mean slopes of the weight functions are used, is exact. For all
other elements, and on the faces of tetrahedra, FFCx itself chooses a suitable rule: wherever a test
or trial function is piecewise linear, the rule for the cell with halved edges.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
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
from pw_elements.checks import (
    arguments,
    check_same_arguments_on_all_processes,
    find_compiler_problem,
)
from pw_elements.progress import report_activity
from pw_elements.spaces.elements import (
    TwelveCellTetrahedron,
    tetrahedron_twelve_cell_quadrature,
    tetrahedron_vertex_quadrature,
)
from pw_elements.spaces.spaces import Spaces

# Key under which the metadata of a body's integrals store the state of stress
STRESS_STATE_METADATA_KEY = "stress_state"

MatOrVec = TypeVar("MatOrVec", PETSc.Mat, PETSc.Vec)


@dataclass(frozen=True)
class AssemblyRecord:
    """Record of how a matrix or vector was assembled, attached to the PETSc object.

    Functions use the records to refuse matrices and vectors that do not fit together.

    Args:
        form: compiled form; None if the matrix or vector was not assembled by this library.
        sibling: the `Sibling` that has transformed the matrix or vector; None if it was not
            transformed.
        stress_states: states of stress of the bodies in the form, if they are known.
        lumped: whether the object is a diagonal mass matrix, which is valid for any weight
            functions.
    """

    form: fem.Form | None = None
    sibling: Any = None
    stress_states: frozenset[str] = frozenset()
    lumped: bool = False

    @classmethod
    def from_form(cls, compiled_form: fem.Form, form: ufl.Form) -> "AssemblyRecord":
        return cls(compiled_form, stress_states=collect_stress_states(form))

    def attach(self, tensor: MatOrVec) -> MatOrVec:
        """Attach the record, which contains the form, to a matrix or vector; return the latter."""
        tensor.setAttr("assembled", self)
        return tensor

    @cached_property
    def mesh(self) -> Any:  # noqa: ANN401
        """C++ mesh of the form; None if the form is not known."""
        return None if self.form is None else self.form.function_spaces[0].mesh

    @cached_property
    def test_space(self) -> Any:  # noqa: ANN401
        """C++ space of the test functions; None for unknown forms and for lumped masses."""
        return None if self.form is None or self.lumped else self.form.function_spaces[0]


_EMPTY_RECORD = AssemblyRecord()


def collect_stress_states(form: ufl.Form) -> frozenset[str]:
    """Return the states of stress of the bodies whose forms a form contains."""
    states = {part.metadata().get(STRESS_STATE_METADATA_KEY) for part in form.integrals()}
    return frozenset(states - {None})


def read_record(tensor: PETSc.Mat | PETSc.Vec) -> AssemblyRecord:
    """Return the record attached to a matrix or vector, or an empty record if it has none."""
    return tensor.getAttr("assembled") or _EMPTY_RECORD


@check_same_arguments_on_all_processes
def assemble_matrix(form: ufl.Form, blocked: bool = False) -> PETSc.Mat:
    """Assemble the matrix of a bilinear form, without boundary conditions.

    Integrals of piecewise-linear functions over tetrahedra get a suitable quadrature rule.
    The matrix holds a reference to the form, which keeps the mesh and the spaces alive.

    Args:
        form: bilinear form, with a trial and a test function.
        blocked: whether the matrix of a vector field is stored in nodal blocks (PETSc's format
            BAIJ), which needs 0.7 of the memory. `Iterative` uses this format and copies matrices
            of other formats into it; all other functions convert a blocked matrix to the usual
            format. The option has no effect for scalar and hybrid spaces.

    Raises:
        TypeError: if the argument is not a UFL form.
        ValueError: if the form is not bilinear, cannot be compiled, or has a measure with a
            quadrature rule that does not suit the weight functions.
    """
    arguments.check_flag("blocked", blocked)
    compiled = compile_form(form, 2, "a matrix")
    nodal = all(space.dofmap.index_map_bs > 1 for space in compiled.function_spaces)
    matrix = create_matrix(compiled, "baij" if blocked and nodal else None)
    _assemble_matrix(matrix, compiled)
    matrix.assemble()
    return AssemblyRecord.from_form(compiled, form).attach(matrix)


@check_same_arguments_on_all_processes
def assemble_vector(form: ufl.Form) -> PETSc.Vec:
    """Assemble the vector (n,) of a linear form, summed over all processes.

    Integrals of piecewise-linear functions over tetrahedra get a suitable quadrature rule.

    Args:
        form: linear form, with a test function.

    Raises:
        TypeError: if the argument is not a UFL form.
        ValueError: if the form is not linear, cannot be compiled, or has a measure with a
            quadrature rule that does not suit the weight functions.
    """
    compiled = compile_form(form, 1, "a vector")
    vector = _assemble_vector(compiled)
    vector.ghostUpdate(PETSc.InsertMode.ADD, PETSc.ScatterMode.REVERSE)
    return AssemblyRecord.from_form(compiled, form).attach(vector)


@check_same_arguments_on_all_processes
def assemble_scalar(form: ufl.Form) -> float:
    """Compute the value of a functional, such as an energy, summed over all processes.

        area = assemble_scalar(1.0 * boundary_measure(mesh, where))

    Integrals of piecewise-linear functions over tetrahedra get a suitable quadrature rule.

    Args:
        form: form without test and trial functions.

    Raises:
        TypeError: if the argument is not a UFL form.
        ValueError: if the form has a test function, belongs to no mesh, cannot be compiled, or has
            a measure with a quadrature rule that does not suit the weight functions.
    """
    compiled = compile_form(form, 0, "a functional")
    return float(compiled.mesh.comm.allreduce(fem.assemble_scalar(compiled), MPI.SUM))


def compile_form(form: ufl.Form, rank: int, result_name: str) -> fem.Form:
    """Check a form and compile it.

    Args:
        form: form to be compiled.
        rank: required number of test and trial functions of the form.
        result_name: name of the assembled object (for example "a matrix"), used in error messages.

    Raises:
        TypeError: if `form` is not a UFL form.
        ValueError: if the form has another rank, mixes meshes, has no mesh, has several measures
            of one kind, or cannot be compiled.
        RuntimeError: if there is no C compiler, or no headers of Python, and the form is not in
            DOLFINx's cache.
    """
    arguments.check_type(
        "the form", form, ufl.Form, "an integrand times a measure makes a ufl.Form"
    )
    kinds = {0: "a number (no test function)", 1: "linear", 2: "bilinear"}
    n_arguments = len(form.arguments())
    if n_arguments != rank:
        needed = f"a {kinds[rank]} form" if rank else "a form without test functions"
        kind = kinds.get(n_arguments, n_arguments)
        raise ValueError(f"{result_name} needs {needed}; this one is {kind}")
    spaces = [argument.ufl_function_space() for argument in form.arguments()]
    for space in spaces:
        arguments.check_function_space(space, "the space of a form's argument")
    functions = [f for f in form.coefficients() if isinstance(f, fem.Function)]
    meshes = [space.mesh for space in (*spaces, *(f.function_space for f in functions))]
    domains = form.ufl_domains()
    if any(mesh is not meshes[0] for mesh in meshes) or len(domains) != 1:
        raise ValueError("the form mixes meshes: its functions and measures have to share one")
    if (mesh := domains[0].ufl_cargo()) is None:
        raise ValueError("the form belongs to no mesh: give its measure a domain")
    for integral_type, tags in form.subdomain_data()[domains[0]].items():
        if any(part is not tags[0] for part in tags):
            entities = integral_type.replace("_", " ")
            raise ValueError(
                f"the form has several measures of {entities}s, of which DOLFINx takes one: "
                "assemble a form of each and add the results"
            )
    plain = _replace_metadata(
        form,
        lambda part: {k: v for k, v in part.metadata().items() if k != STRESS_STATE_METADATA_KEY},
    )
    with_rules = add_sub_cell_quadrature_rules(plain)
    try:
        with report_activity(mesh.comm, "compiling a form"):
            return fem.form(with_rules)
    except Exception as error:
        # only now: forms in the cache need no compiler
        if problem := find_compiler_problem():
            raise RuntimeError(problem) from None
        raise ValueError(f"the form cannot be compiled: {error}") from error


def cell_measure(space: fem.FunctionSpace, degree: int) -> ufl.Measure:
    """Create a cell measure dx with a quadrature rule that suits the test functions of a space.

    Unlike an ordinary measure, it can be used with DOLFINx's own assembly functions:

        dx = cell_measure(W, 2)
        load = fem.assemble_vector(fem.form(f * ufl.TestFunction(W) * dx))

    Args:
        space: the test space.
        degree: degree up to which polynomials are integrated exactly on each sub-cell.
    """
    arguments.check_function_space(space)
    arguments.check_integer("degree", degree, 0)
    metadata: dict[str, Any] = {"quadrature_degree": degree}
    if _find_piecewise_linear_tetrahedra(space.ufl_element()):
        metadata |= _custom_quadrature_metadata(*tetrahedron_twelve_cell_quadrature(degree))
    return ufl.Measure("dx", domain=space.mesh, metadata=metadata)


@check_same_arguments_on_all_processes
def history_space(
    spaces: Spaces, shape: tuple[int, ...] = (), quadrature_degree: int = 4
) -> tuple[fem.FunctionSpace, ufl.Measure]:
    """Create a space of functions at quadrature points, and the cell measure with these points.

    The points are those of the rule that suits the weight functions: points in each sub-cell where
    the weights are linear on sub-cells. Plastic strains and other history variables belong there,
    because forms and updates then evaluate the material law at the same points.

        S, dx = history_space(spaces, (3, 3))
        plastic_strain = fem.Function(S)
        residual = ufl.inner(stress(strain(u) - plastic_strain), strain(v)) * dx

    Spaces of the same `spaces` and degree have equal points, so that one of the measures serves
    all of them. A form with functions of these spaces needs this measure.

    Args:
        spaces: spaces of the displacements, which may be hybrid.
        shape: shape of the values: () for a number, (3, 3) for a tensor.
        quadrature_degree: degree up to which polynomials are integrated exactly on each sub-cell.
    """
    arguments.check_type("spaces", spaces, Spaces, "create them by Spaces.petrov_galerkin(mesh)")
    arguments.check_integer("quadrature_degree", quadrature_degree, 0)
    if not (isinstance(shape, tuple) and all(isinstance(n, int) and n > 0 for n in shape)):
        raise ValueError(f"shape is {shape!r}: give a tuple of positive integers, such as (3, 3)")
    element = spaces.displacements.test.ufl_element()
    if _find_piecewise_linear_tetrahedra(element):
        points, weights = tetrahedron_twelve_cell_quadrature(quadrature_degree)
    else:
        points, weights = basix.make_quadrature(
            element.cell_type, quadrature_degree, polyset_type=element.polyset_type
        )
    points_element = basix.ufl.quadrature_element(
        element.cell_type.name, value_shape=shape, points=points, weights=weights
    )
    dx = ufl.Measure(
        "dx", domain=spaces.mesh, metadata=_custom_quadrature_metadata(points, weights)
    )
    return fem.functionspace(spaces.mesh, points_element), dx


def add_sub_cell_quadrature_rules(form: ufl.Form) -> ufl.Form:
    """Return a form whose integrals have quadrature points in sub-cells of tetrahedra if needed."""
    return _replace_metadata(form, _metadata_with_sub_cell_rule)


def add_estimated_quadrature_degrees(form: ufl.Form) -> ufl.Form:
    """Return a form in which all measures have a quadrature degree.

    A measure without a degree gets the degree that UFL estimates. Derivatives of the returned form
    then have the same quadrature points as the form itself. Newton's method needs this in order to
    converge quadratically.
    """

    def metadata_with_degree(part: ufl.Integral) -> dict[str, Any]:
        metadata: dict[str, Any] = part.metadata()
        if metadata.keys() & {"quadrature_degree", "quadrature_rule"}:
            return metadata
        return {**metadata, "quadrature_degree": _estimated_polynomial_degree(part)}

    return _replace_metadata(form, metadata_with_degree)


def _replace_metadata(
    form: ufl.Form, new_metadata: Callable[[ufl.Integral], dict[str, Any]]
) -> ufl.Form:
    return ufl.Form([part.reconstruct(metadata=new_metadata(part)) for part in form.integrals()])


def _metadata_with_sub_cell_rule(integral: ufl.Integral) -> dict[str, Any]:
    """Return the metadata of an integral, with a rule on sub-cells if its elements need one."""
    metadata: dict[str, Any] = integral.metadata()
    rule = metadata.get("quadrature_rule", "default")
    cell_type = integral.ufl_domain().ufl_coordinate_element().cell_type
    if integral.integral_type() != "cell" or rule == "custom":
        return metadata
    if cell_type is not CellType.tetrahedron or not any(
        map(_find_piecewise_linear_tetrahedra, extract_elements(integral))
    ):
        return metadata
    if rule != "default":
        raise ValueError(
            f"the measure's quadrature_rule {rule!r} is one of the whole tetrahedron, but weights "
            "are linear on sub-cells: give the quadrature_degree alone"
        )
    degree = metadata.get("quadrature_degree", -1)
    if degree < 0:
        degree = _estimated_polynomial_degree(integral)
    if degree == 1 and _is_exact_by_vertex_rule(integral):
        return {**metadata, **_custom_quadrature_metadata(*tetrahedron_vertex_quadrature())}
    return {**metadata, **_custom_quadrature_metadata(*tetrahedron_twelve_cell_quadrature(degree))}


def _is_exact_by_vertex_rule(integral: ufl.Integral) -> bool:
    """Return whether `tetrahedron_vertex_quadrature` is exact for an integral.

    The integrand has to be a linear function times the slopes of a single weight function of
    `TwelveCellTetrahedron`; the weight function itself must not occur in it.
    """
    functions = [*extract_arguments(integral), *extract_coefficients(integral)]
    weights = [f for f in functions if _find_piecewise_linear_tetrahedra(f.ufl_element())]
    if len(weights) > 1 or _estimated_polynomial_degree(integral) > 1:
        return False
    nodes = (
        node
        for part in _expand_for_ffcx(integral)
        for node in unique_pre_traversal(part.integrand())
    )
    underived = {
        operand for node in nodes if not isinstance(node, Grad) for operand in node.ufl_operands
    }
    elements = _find_piecewise_linear_tetrahedra(weights[0].ufl_element())
    are_means = all(isinstance(element, TwelveCellTetrahedron) for element in elements)
    return are_means and weights[0] not in underived


def _estimated_polynomial_degree(integral: ufl.Integral) -> int:
    parts = _expand_for_ffcx(integral)
    return max(int(part.metadata()["estimated_polynomial_degree"]) for part in parts)


def _expand_for_ffcx(integral: ufl.Integral) -> list[ufl.Integral]:
    """Return the integrals that FFCx compiles, with derivatives applied only to functions."""
    data = compute_form_data(
        ufl.Form([integral]), do_apply_integral_scaling=True, do_append_everywhere_integrals=False
    )
    return [part for group in data.integral_data for part in group.integrals]


def _custom_quadrature_metadata(points: Array, weights: Array) -> dict[str, Any]:
    return {  # tuples, because UFL abbreviates arrays in the signature of a form
        "quadrature_rule": "custom",
        "quadrature_points": tuple(tuple(map(float, x)) for x in points),
        "quadrature_weights": tuple(map(float, weights)),
    }


def _find_piecewise_linear_tetrahedra(
    element: basix.ufl._ElementBase,
) -> list[basix.ufl._BasixElement]:
    """Return the piecewise-linear tetrahedral elements among an element and its sub-elements."""
    return [
        part
        for part in extract_sub_elements([element])
        if isinstance(part, basix.ufl._BasixElement)
        and part.cell_type is CellType.tetrahedron
        and part.polyset_type is PolysetType.macroedge
    ]
