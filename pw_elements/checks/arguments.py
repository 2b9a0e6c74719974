"""Objects as users give them: meshes, spaces, matrices, coefficients of the right kind.

What is of the wrong type is a TypeError; each error names the thing and says what to give. Numbers
are real, finite and in range, of whatever type they are.
"""

from collections.abc import Callable, Collection, Iterable
from types import UnionType
from typing import Any, TypeGuard

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from basix import ElementFamily
from dolfinx import fem
from dolfinx.mesh import Mesh
from ufl import Measure
from ufl.core.expr import Expr
from ufl.form import BaseForm

from pw_elements.arrays import Array, Mask
from pw_elements.checks.guard import collective_errors, find_communicator

Sizes = tuple[int, int]  # of vectors, own and global

# Range of the sizes of numbers that are given: squares of their quotients are numbers, too. Beyond
# it norms become zero or infinite, and results lose their digits without a word
MIN_MAGNITUDE, MAX_MAGNITUDE = 1e-75, 1e75


def as_list(value: object) -> list[Any]:
    """Return the things of a list or another iterable, or a single thing in a list.

    Expressions and PETSc's objects are single ones, though some can be gone through.
    """
    if isinstance(value, Iterable) and not isinstance(value, Expr | PETSc.Object | str | bytes):
        try:
            return list(value)
        except Exception:  # of whatever kind: it is a user's
            return [value]
    return [value]


def is_one_of(value: object, names: Collection[str]) -> TypeGuard[str]:
    """Return whether a value is one of some strings: other things may refuse to be compared."""
    return isinstance(value, str) and value in names


def is_number(value: Any) -> bool:  # noqa: ANN401
    """Whether a value is one real number, a 0-d array being one, too: no truth value, no text."""
    plain = isinstance(value, int | float | np.number | np.ndarray)
    return plain and np.ndim(value) == 0 and np.asarray(value).dtype.kind in "iuf"


def is_user_function(value: object) -> TypeGuard[Callable[..., Any]]:
    """Return whether a value is a user's function.

    Expressions and forms of UFL, matrices of PETSc and classes can be called, too.
    """
    others = Expr | BaseForm | Measure | PETSc.Object | type
    return callable(value) and not isinstance(value, others)


def check_magnitude(name: str, magnitude: float, minimum: float = MIN_MAGNITUDE) -> None:
    """Raise ValueError for a size that is neither zero nor in the range of serviceable numbers."""
    if magnitude > MAX_MAGNITUDE or 0 < magnitude < minimum:
        raise ValueError(
            f"{name} is of the size {magnitude:.3g}, out of the range {MIN_MAGNITUDE:g} to "
            f"{MAX_MAGNITUDE:g} in which numbers keep their digits: choose units in which it is "
            "nearer to one"
        )


def check_number(name: str, value: Any) -> float:  # noqa: ANN401
    if not (is_number(value) and np.isfinite(value)):
        raise ValueError(f"{name} = {value!r}: has to be a finite number")
    check_magnitude(name, abs(float(value)), minimum=0.0)
    return float(value)


def check_positive(name: str, value: Any) -> float:  # noqa: ANN401
    if not check_number(name, value) > 0:
        raise ValueError(f"{name} = {value!r}: has to be positive")
    check_magnitude(name, float(value))
    return float(value)


def check_integer(name: str, value: Any, minimum: int) -> int:  # noqa: ANN401
    if not (is_number(value) and np.asarray(value).dtype.kind in "iu" and value >= minimum):
        raise ValueError(f"{name} = {value!r}: has to be a whole number, {minimum} at least")
    return int(value)


def check_vector(name: str, values: Any, length: int | None = None) -> Array:  # noqa: ANN401
    several = isinstance(values, Iterable) and not isinstance(values, PETSc.Object)
    each = as_list(values) if several else []
    finite = all(is_number(one) and np.isfinite(one) for one in each)
    if not (each and finite and len(each) == (length or len(each))):
        count = f"{length} finite" if length else "finite"
        raise ValueError(f"{name} {values!r}: it needs {count} components")
    found = np.array(each, dtype=float)
    check_magnitude(name, float(np.abs(found).max()), minimum=0.0)
    return found


def check_real_array(name: str, values: Any, shape: tuple[int, ...]) -> Array:  # noqa: ANN401
    """Return finite real numbers of a shape as floats; ValueError for anything else."""
    try:  # of vectors of PETSc empty ones end the process
        given = np.asarray(None if isinstance(values, PETSc.Object) else values)
    except ValueError:  # rows of different lengths
        given = np.empty(0, dtype=object)
    if given.shape != shape or given.dtype.kind not in "iuf" or not np.isfinite(given).all():
        raise ValueError(
            f"{name} of the shape {given.shape} and the type {given.dtype}: {shape} finite numbers "
            "are needed, all of them real"
        )
    return given.astype(float)


def check_function_values(
    name: str, values: object, shape: tuple[int, ...], layout: str, kind: type = float
) -> npt.NDArray[Any]:
    """Numbers, or truths, that a user's function gives at points; NaN and infinity pass."""
    given = np.asarray(values)
    if given.shape != shape or given.dtype.kind not in ("b" if kind is bool else "iuf"):
        raise ValueError(
            f"{name} gave {given.dtype} of the shape {given.shape} for {shape[0]} points: {layout}"
        )
    return given.astype(kind)


def check_type(
    name: str, value: object, kind: type | UnionType | tuple[type, ...], remedy: str
) -> None:
    """Raises TypeError unless the value is of a kind; `remedy` says what to give instead."""
    if not isinstance(value, kind):
        raise TypeError(f"{name} is {describe(value)}: {remedy}")


def check_communicator(value: object) -> None:
    check_type("comm", value, MPI.Comm, "it has to be a communicator, such as MPI.COMM_WORLD")


def check_mesh_type(value: Any) -> None:  # noqa: ANN401
    check_type("the mesh", value, Mesh, "it has to be a dolfinx.mesh.Mesh")
    if value.geometry.x.dtype != np.float64:
        raise ValueError(f"the mesh is one of {value.geometry.x.dtype}: make it with dtype=float64")


def check_space(value: Any, name: str = "the space") -> None:  # noqa: ANN401
    check_type(name, value, fem.FunctionSpace, "it has to be a fem.FunctionSpace, one of `Spaces`")
    check_mesh_type(value.mesh)
    if getattr(value, "component", list)():  # which not every version of DOLFINx may have
        raise ValueError(
            f"{name} is a part of another, {name}.sub(i): give the whole, or collapse it"
        )


def check_flag(name: str, value: object) -> None:
    check_type(name, value, (bool, np.bool_), "it has to be True or False")


def check_matrix(
    name: str, value: object, other_name: str = "", sizes: Sizes | None = None
) -> None:
    """Raises unless it is a square matrix; if sizes are given, of these."""
    check_type(name, value, PETSc.Mat, "assemble_matrix(form) makes a PETSc matrix")
    assert isinstance(value, PETSc.Mat)
    check_petsc_object(name, value)
    rows, columns = value.getSize()
    if rows != columns:
        raise ValueError(f"{name} has the shape ({rows}, {columns}): it has to be square")
    if not value.isAssembled():
        raise ValueError(f"{name} is not assembled: call its assemble()")
    if sizes is not None:
        check_sizes(name, value.getSizes()[0], other_name, sizes)


def check_petsc_vector(
    name: str, value: object, other_name: str = "", other: fem.FunctionSpace | Sizes | None = None
) -> None:
    """Raises unless it is a vector; if another thing is given, of its sizes."""
    check_type(name, value, PETSc.Vec, "assemble_vector(form) makes one, float(s) * vector a share")
    assert isinstance(value, PETSc.Vec)
    check_petsc_object(name, value)
    if other is not None:
        check_sizes(name, value.getSizes(), other_name, other)


def check_petsc_object(name: str, value: PETSc.Object) -> None:
    """Raise ValueError for an object of PETSc that was destroyed, or never set up."""
    if value.handle == 0 or value.getType() is None:
        kind = {"Mat": "matrix", "Vec": "vector"}.get(type(value).__name__, "object")
        raise ValueError(f"{name} is an empty {kind}: it was destroyed, or never set up")


def check_coefficient(
    name: str,
    value: object,
    is_valid: Callable[[Array], Mask],
    requirement: str,
    comm: MPI.Comm = MPI.COMM_SELF,
) -> float | Expr:
    """A number as a float, or a scalar UFL expression, in range as far as its values are known.

    Known are numbers, the value of a `fem.Constant`, and nodal values of a Lagrange `fem.Function`.
    It is refused on all processes of `comm` at once; a function's are known.
    """
    with collective_errors(find_communicator(comm, value)):
        if not isinstance(value, Expr):
            value = check_number(name, value)
        elif value.ufl_shape != ():
            raise ValueError(f"{name} has the shape {value.ufl_shape}: it has to be a scalar")
        values = available_values(value)
        wrong = ~(np.isfinite(values) & is_valid(values))
        if wrong.any():
            raise ValueError(f"{name} = {values[wrong][0]}: {requirement}")
    return value


def check_positive_coefficient(
    name: str, value: object, comm: MPI.Comm = MPI.COMM_SELF
) -> float | Expr:
    checked = check_coefficient(name, value, lambda values: values > 0, "has to be positive", comm)
    with collective_errors(find_communicator(comm, value)):
        values = available_values(checked)
        for size in (values.min(initial=1.0), values.max(initial=1.0)):
            check_magnitude(name, float(size))
    return checked


def available_values(value: float | Expr) -> Array:
    if isinstance(value, fem.Function):
        lagrange = value.function_space.element.basix_element.family is ElementFamily.P
        return value.x.array if lagrange else np.empty(0)
    if isinstance(value, fem.Constant):
        return np.atleast_1d(value.value)
    return np.empty(0) if isinstance(value, Expr) else np.array([value])


def check_components(name: str, value: object, size: int) -> Expr | Array:
    if not isinstance(value, Expr):
        return check_vector(name, value, size)
    if value.ufl_shape != (size,):
        raise ValueError(f"{name} has the shape {value.ufl_shape}: it needs {size} components")
    if isinstance(value, fem.Constant):
        check_vector(name, value.value, size)
    return value


def vector_sizes(space: fem.FunctionSpace) -> Sizes:
    index_map, block = space.dofmap.index_map, space.dofmap.index_map_bs
    return index_map.size_local * block, index_map.size_global * block


def check_sizes(name: str, sizes: Sizes, other_name: str, other: fem.FunctionSpace | Sizes) -> None:
    """Raises ValueError unless sizes are those of another thing; local."""
    if isinstance(other, fem.FunctionSpace):
        other = vector_sizes(other)
    if sizes[1] != other[1]:
        raise ValueError(
            f"{name} has {sizes[1]} degrees of freedom, {other_name} has {other[1]}: all of them "
            "have to come from one space, none left out"
        )
    if sizes[0] != other[0]:
        raise ValueError(f"{name} is distributed over the processes otherwise than {other_name}")


def describe(value: object) -> str:
    if value is None or isinstance(value, str | bytes | bool | int | float | complex):
        return repr(value)
    if isinstance(value, type):
        return f"the class {value.__name__}"
    return f"of the type {type(value).__name__}"
