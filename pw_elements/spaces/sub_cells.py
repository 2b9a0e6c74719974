"""Bilinear forms whose cell integrals are computed sub-cell by sub-cell.

UFL derives the coefficients of an integrand, FFCx compiles them, and `SubCellKernel` generates the
function that contracts them with the shape functions. The function is compiled with the compiler
options of DOLFINx's forms and stored in their cache. What does not fit is left to FFCx: integrals
over facets, curved cells, cells other than tetrahedra (where FFCx's functions are about as fast),
and test functions that are not piecewise linear. Errors in the kernel itself are raised.
"""

import hashlib
import importlib.machinery
import importlib.util
import logging
import sysconfig
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

from mpi4py import MPI

import cffi
import dolfinx.jit
import ffcx.codegeneration
import ffcx.compiler
import ffcx.options
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from dolfinx.fem.forms import get_integration_domains
from dolfinx.mesh import CellType
from ufl.algorithms import extract_coefficients
from ufl.algorithms.analysis import extract_constants
from ufl.core.expr import Expr

from pw_elements._compat import create_form_from_cell_kernels
from pw_elements.arrays import Array, LocalIndices
from pw_elements.checks import find_compiler_problem
from pw_elements.files import replace_file_atomically
from pw_elements.progress import log_on_root, report_activity
from pw_elements.spaces.assembly import add_sub_cell_quadrature_rules, compile_form
from pw_elements.spaces.bilinear_coefficients import (
    NotSeparableError,
    derive_bilinear_coefficients,
)
from pw_elements.spaces.sub_cell_kernel import SubCellKernel

FormInput = TypeVar("FormInput", fem.Function, fem.Constant)


@dataclass(frozen=True)
class _CellIntegral:
    """Compiled function of a cell integral, and the data that it reads.

    Args:
        address: address of the function, which has the interface of UFCx's `tabulate_tensor`.
        cells: local numbers of the cells of the integral, without ghosts.
        coefficients: numbers (int8) of the form's coefficients that the function reads.
        modules: compiled modules, which have to live as long as the function is called.
    """

    address: int
    cells: LocalIndices
    coefficients: npt.NDArray[np.int8]
    modules: tuple[ModuleType, ModuleType]


def compile_tangent(form: ufl.Form) -> list[fem.Form]:
    """Compile a tangent: forms whose sum it is; the first one has the sparsity pattern of all.

    Args:
        form: bilinear form, to which derivatives have been applied. All its measures have a
            quadrature degree or a rule.

    Raises:
        ValueError: if the form cannot be compiled.
    """
    (domain,) = form.ufl_domains()
    mesh = domain.ufl_cargo()
    is_straight = domain.is_piecewise_linear_simplex_domain()
    if mesh.topology.cell_type != CellType.tetrahedron or not is_straight:
        return [compile_form(form, 2, "a tangent")]
    integrals: list[_CellIntegral] = []
    rest: list[ufl.Integral] = []
    with report_activity(mesh.comm, "compiling a form"):
        for parts in _group_by_measure(add_sub_cell_quadrature_rules(form)):
            try:
                integrals.append(_compile_integral(parts, form.coefficients(), form.constants()))
            except NotSeparableError:
                rest += parts
    n_cells = mesh.topology.index_map(mesh.topology.dim).size_local
    cells = np.concatenate([np.empty(0, dtype=np.int32), *(part.cells for part in integrals)])
    contains_all_cells = mesh.comm.allreduce(len(np.unique(cells)) == n_cells, MPI.LAND)
    if not integrals or (rest and not contains_all_cells):
        return [compile_form(form, 2, "a tangent")]
    cpp_form = create_form_from_cell_kernels(
        [argument.ufl_function_space() for argument in form.arguments()],
        [(part.address, part.cells, part.coefficients) for part in integrals],
        form.coefficients(),
        form.constants(),
    )
    modules = [module for integral in integrals for module in integral.modules]
    others = [compile_form(ufl.Form(rest), 2, "a tangent")] if rest else []
    return [fem.Form(cpp_form, module=modules), *others]


def _group_by_measure(form: ufl.Form) -> list[list[ufl.Integral]]:
    groups: dict[tuple[Any, ...], list[ufl.Integral]] = {}
    for part in form.integrals():
        key = part.integral_type(), part.subdomain_id(), repr(sorted(part.metadata().items()))
        groups.setdefault(key, []).append(part)
    return list(groups.values())


def _compile_integral(
    parts: Sequence[ufl.Integral],
    coefficients: Sequence[fem.Function],
    constants: Sequence[fem.Constant],
) -> _CellIntegral:
    """Compile the sum of integrals with the same measure.

    Args:
        parts: the integrals.
        coefficients: coefficients of the whole form.
        constants: constants of the whole form.

    Raises:
        NotSeparableError: if FFCx has to compile the integrals.
        cffi.VerificationError: if the C compiler refuses the source of the kernel. On several
            processes, it is a RuntimeError.
    """
    first, mesh = parts[0], parts[0].ufl_domain().ufl_cargo()
    cells, metadata = _find_cells(first), first.metadata()
    if metadata.get("quadrature_rule") != "custom":
        raise NotSeparableError
    points, weights = (np.array(metadata[f"quadrature_{name}"]) for name in ("points", "weights"))
    arguments = sorted(ufl.algorithms.extract_arguments(first), key=lambda a: a.number())
    elements = [argument.ufl_function_space().ufl_element() for argument in arguments]
    terms = derive_bilinear_coefficients(sum(part.integrand() for part in parts))
    kernel = SubCellKernel(elements, points, weights, terms)
    expression = ufl.as_vector([terms[entry] for entry in kernel.entries])
    with _leave_to_ffcx_what_cannot_be_compiled_here(mesh.comm, expression, points):
        compiled, expression_module, _ = dolfinx.jit.ffcx_jit(mesh.comm, (expression, points))
    occurring = extract_coefficients(expression)
    positions = compiled.original_coefficient_positions
    functions = [occurring[positions[i]] for i in range(compiled.num_coefficients)]
    source = kernel.generate_source(
        _gather_values(
            "w", functions, coefficients, lambda f: f.function_space.element.space_dimension
        ),
        _gather_values("c", extract_constants(expression), constants, lambda c: c.value.size),
    )
    with _leave_to_ffcx_what_cannot_be_compiled_here(mesh.comm, expression, points):
        kernel_module = _load_kernel_module(mesh.comm, source, expression_module.__name__)
    evaluate = cffi.FFI().cast("uintptr_t", compiled.tabulate_tensor_float64)
    kernel_module.lib.set_coefficient_function(int(evaluate))
    return _CellIntegral(
        kernel_module.lib.kernel_address(),
        cells,
        np.array([coefficients.index(function) for function in functions], dtype=np.int8),
        (expression_module, kernel_module),
    )


@contextmanager
def _leave_to_ffcx_what_cannot_be_compiled_here(
    comm: MPI.Comm, expression: Expr, points: Array
) -> Iterator[None]:
    """Turn an error in a `with` block into NotSeparableError if the kernel is not its cause.

    FFCx may have compiled the form before, so that it needs neither a compiler nor a cache in which
    it may write. Where FFCx cannot generate the coefficients, it says what is wrong with the form.
    Any other error, such as one of the C compiler, is raised. The call is collective, and so has to
    be the error.

    Args:
        comm: communicator of the mesh.
        expression: coefficients, a vector.
        points: quadrature points (q, dim) in the reference cell.
    """
    log_handlers = logging.root.handlers.copy()
    try:
        yield
    except Exception as error:
        logging.root.handlers = log_handlers  # FFCx has replaced them if the C compiler failed
        reason = comm.bcast(
            _find_reason_for_failed_compilation(expression, points) if comm.rank == 0 else None
        )
        if reason is None:
            raise
        message = f"no tangent by sub-cells: {reason}"
        log_on_root(comm, logging.DEBUG, message, ".linear_solver")
        raise NotSeparableError from error


def _find_reason_for_failed_compilation(expression: Expr, points: Array) -> str | None:
    """Return why neither a kernel nor its coefficients can be compiled; None if they can be.

    The function does not communicate.
    """
    if problem := find_compiler_problem():
        return problem
    try:
        with tempfile.TemporaryDirectory(dir=dolfinx.jit.get_options()["cache_dir"]):
            pass
    except OSError as error:
        return f"the cache of compiled forms is not writable: {error}"
    try:
        ffcx.compiler.compile_ufl_objects([(expression, points)], ffcx.options.get_options())
    except Exception as error:  # FFCx has no errors of its own
        return f"FFCx generates no coefficients: {error}"
    return None


def _find_cells(integral: ufl.Integral) -> LocalIndices:
    """Return the local numbers of the cells of an integral, without ghosts."""
    topology = integral.ufl_domain().ufl_cargo().topology
    number, data = integral.subdomain_id(), integral.subdomain_data()
    if integral.integral_type() != "cell":
        raise NotSeparableError
    if number == "everywhere":
        return np.arange(topology.index_map(topology.dim).size_local, dtype=np.int32)
    numbers = list(number) if isinstance(number, tuple) else [number]
    if data is None or not all(isinstance(n, int) for n in numbers):
        raise NotSeparableError
    domains = get_integration_domains(fem.IntegralType.cell, data, sorted(numbers))
    cells = [cells for n, cells in domains if n in numbers]
    return np.concatenate([np.empty(0, dtype=np.int32), *cells]).astype(np.int32)


def _gather_values(
    name: str,
    wanted: Sequence[FormInput],
    available: Sequence[FormInput],
    count_values: Callable[[FormInput], int],
) -> str:
    """Return C statements that copy values from an array of a form to one of an expression.

    Args:
        name: name of the form's array; that of the expression begins with `own_`.
        wanted: coefficients or constants of the expression.
        available: coefficients or constants of the form.
        count_values: function that returns the number of values of one of them in a cell.
    """
    starts = np.cumsum([0, *map(count_values, available)])
    if not wanted or list(wanted) == list(available):
        return f"const double* own_{name} = {name};"
    sizes = [count_values(item) for item in wanted]
    lines, position = [f"double own_{name}[{sum(sizes)}];"], 0
    for item, size in zip(wanted, sizes, strict=True):
        start = starts[available.index(item)]
        lines.append(f"memcpy(own_{name} + {position}, {name} + {start}, {size} * sizeof(double));")
        position += size
    return "\n".join(lines)


@dolfinx.jit.mpi_jit_decorator
def _load_kernel_module(source: str, expression_name: str) -> ModuleType:
    """Load the module of a kernel from the cache of DOLFINx's forms, and compile it if needed.

    With a communicator as first argument, the first process compiles and the others wait. A module
    appears in the cache only when it is complete.

    Args:
        source: C source of the kernel.
        expression_name: name of the compiled expression of the coefficients. Each expression needs
            a module of its own, because the module stores the address of the expression.
    """
    options = dolfinx.jit.get_options()
    flags = ["-std=c17", *options["cffi_extra_compile_args"]]
    suffix = sysconfig.get_config_var("EXT_SUFFIX")
    identity = repr((source + _MODULE_INTERFACE, expression_name, flags, suffix))
    name = f"libpw_sub_cells_{hashlib.sha256(identity.encode()).hexdigest()[:40]}"
    folder = Path(options["cache_dir"])
    path = folder / f"{name}{suffix}"
    if not path.exists():
        builder = cffi.FFI()
        builder.cdef(_MODULE_DECLARATIONS)
        builder.set_source(
            name,
            source + _MODULE_INTERFACE,
            include_dirs=[ffcx.codegeneration.get_include_path()],
            extra_compile_args=flags,
        )
        with tempfile.TemporaryDirectory(dir=folder, prefix=name) as scratch:
            replace_file_atomically(path, Path(builder.compile(tmpdir=scratch)).read_bytes())
    loader = importlib.machinery.ExtensionFileLoader(name, str(path))
    spec = importlib.util.spec_from_loader(name, loader)
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    loader.exec_module(module)
    return module


_MODULE_DECLARATIONS = """
void set_coefficient_function(uintptr_t address);
uintptr_t kernel_address(void);
"""

_MODULE_INTERFACE = """
void set_coefficient_function(uintptr_t address)
{
tabulate_coefficients = (ufcx_tabulate_tensor_float64*)address;
}

uintptr_t kernel_address(void)
{
return (uintptr_t)tabulate_matrix;
}
"""
