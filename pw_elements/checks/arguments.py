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
from pw_elements.checks.guard import collective, processes

Sizes = tuple[int, int]  # of vectors, own and global

# Range of the sizes of numbers that are given: squares of their quotients are numbers, too. Beyond
# it norms become zero or infinite, and results lose their digits without a word
SMALLEST, LARGEST = 1e-75, 1e75


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


def is_function(value: object) -> TypeGuard[Callable[..., Any]]:
    """Return whether a value is a user's function.

    Expressions and forms of UFL, matrices of PETSc and classes can be called, too.
    """
    others = Expr | BaseForm | Measure | PETSc.Object | type
    return callable(value) and not isinstance(value, others)


def check_range(name: str, size: float, least: float = SMALLEST) -> None:
    """Raise ValueError for a size that is neither zero nor in the range of serviceable numbers."""
    if size > LARGEST or 0 < size < least:
        raise ValueError(
            f"{name} is of the size {size:.3g}, out of the range {SMALLEST:g} to {LARGEST:g} in "
            "which numbers keep their digits: choose units in which it is nearer to one"
        )


def number(name: str, value: Any) -> float:  # noqa: ANN401
    if not (is_number(value) and np.isfinite(value)):
        raise ValueError(f"{name} = {value!r}: has to be a finite number")
    check_range(name, abs(float(value)), least=0.0)
    return float(value)


def positive(name: str, value: Any) -> float:  # noqa: ANN401
    if not number(name, value) > 0:
        raise ValueError(f"{name} = {value!r}: has to be positive")
    check_range(name, float(value))
    return float(value)


def whole(name: str, value: Any, least: int) -> int:  # noqa: ANN401
    if not (is_number(value) and np.asarray(value).dtype.kind in "iu" and value >= least):
        raise ValueError(f"{name} = {value!r}: has to be a whole number, {least} at least")
    return int(value)


def vector(name: str, values: Any, length: int | None = None) -> Array:  # noqa: ANN401
    several = isinstance(values, Iterable) and not isinstance(values, PETSc.Object)
    each = as_list(values) if several else []
    finite = all(is_number(one) and np.isfinite(one) for one in each)
    if not (each and finite and len(each) == (length or len(each))):
        count = f"{length} finite" if length else "finite"
        raise ValueError(f"{name} {values!r}: it needs {count} components")
    found = np.array(each, dtype=float)
    check_range(name, float(np.abs(found).max()), least=0.0)
    return found


def real_array(name: str, values: Any, shape: tuple[int, ...]) -> Array:  # noqa: ANN401
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


def field(
    whose: str, values: object, shape: tuple[int, ...], layout: str, kind: type = float
) -> npt.NDArray[Any]:
    """Numbers, or truths, that a user's function gives at points; NaN and infinity pass."""
    given = np.asarray(values)
    if given.shape != shape or given.dtype.kind not in ("b" if kind is bool else "iuf"):
        raise ValueError(
            f"{whose} gave {given.dtype} of the shape {given.shape} for {shape[0]} points: {layout}"
        )
    return given.astype(kind)


def of_type(
    name: str, value: object, kind: type | UnionType | tuple[type, ...], remedy: str
) -> None:
    """Raises TypeError unless the value is of a kind; `remedy` says what to give instead."""
    if not isinstance(value, kind):
        raise TypeError(f"{name} is {described(value)}: {remedy}")


def communicator(value: object) -> None:
    of_type("comm", value, MPI.Comm, "it has to be a communicator, such as MPI.COMM_WORLD")


def mesh(value: Any) -> None:  # noqa: ANN401
    of_type("the mesh", value, Mesh, "it has to be a dolfinx.mesh.Mesh")
    if value.geometry.x.dtype != np.float64:
        raise ValueError(f"the mesh is one of {value.geometry.x.dtype}: make it with dtype=float64")


def space(value: Any, name: str = "the space") -> None:  # noqa: ANN401
    of_type(name, value, fem.FunctionSpace, "it has to be a fem.FunctionSpace, one of `Spaces`")
    mesh(value.mesh)
    if getattr(value, "component", list)():  # which not every version of DOLFINx may have
        raise ValueError(
            f"{name} is a part of another, {name}.sub(i): give the whole, or collapse it"
        )


def flag(name: str, value: object) -> None:
    of_type(name, value, (bool, np.bool_), "it has to be True or False")


def matrix(name: str, value: object, whose: str = "", sizes: Sizes | None = None) -> None:
    """Raises unless it is a square matrix; if sizes are given, of these."""
    of_type(name, value, PETSc.Mat, "assemble_matrix(form) makes a PETSc matrix")
    assert isinstance(value, PETSc.Mat)
    refuse_empty(name, value)
    rows, columns = value.getSize()
    if rows != columns:
        raise ValueError(f"{name} has the shape ({rows}, {columns}): it has to be square")
    if not value.isAssembled():
        raise ValueError(f"{name} is not assembled: call its assemble()")
    if sizes is not None:
        same_sizes(name, value.getSizes()[0], whose, sizes)


def petsc_vector(
    name: str, value: object, whose: str = "", other: fem.FunctionSpace | Sizes | None = None
) -> None:
    """Raises unless it is a vector; if another thing is given, of its sizes."""
    of_type(name, value, PETSc.Vec, "assemble_vector(form) makes one, float(s) * vector a share")
    assert isinstance(value, PETSc.Vec)
    refuse_empty(name, value)
    if other is not None:
        same_sizes(name, value.getSizes(), whose, other)


def refuse_empty(name: str, value: PETSc.Object) -> None:
    """Raise ValueError for an object of PETSc that was destroyed, or never set up."""
    if value.handle == 0 or value.getType() is None:
        kind = {"Mat": "matrix", "Vec": "vector"}.get(type(value).__name__, "object")
        raise ValueError(f"{name} is an empty {kind}: it was destroyed, or never set up")


def coefficient(
    name: str,
    value: object,
    holds: Callable[[Array], Mask],
    what: str,
    comm: MPI.Comm = MPI.COMM_SELF,
) -> float | Expr:
    """A number as a float, or a scalar UFL expression, in range as far as its values are known.

    Known are numbers, the value of a `fem.Constant`, and nodal values of a Lagrange `fem.Function`.
    It is refused on all processes of `comm` at once; a function's are known.
    """
    with collective(processes(comm, value)):
        if not isinstance(value, Expr):
            value = number(name, value)
        elif value.ufl_shape != ():
            raise ValueError(f"{name} has the shape {value.ufl_shape}: it has to be a scalar")
        values = known_values(value)
        wrong = ~(np.isfinite(values) & holds(values))
        if wrong.any():
            raise ValueError(f"{name} = {values[wrong][0]}: {what}")
    return value


def positive_coefficient(name: str, value: object, comm: MPI.Comm = MPI.COMM_SELF) -> float | Expr:
    checked = coefficient(name, value, lambda values: values > 0, "has to be positive", comm)
    with collective(processes(comm, value)):
        values = known_values(checked)
        for size in (values.min(initial=1.0), values.max(initial=1.0)):
            check_range(name, float(size))
    return checked


def known_values(value: float | Expr) -> Array:
    if isinstance(value, fem.Function):
        lagrange = value.function_space.element.basix_element.family is ElementFamily.P
        return value.x.array if lagrange else np.empty(0)
    if isinstance(value, fem.Constant):
        return np.atleast_1d(value.value)
    return np.empty(0) if isinstance(value, Expr) else np.array([value])


def components(name: str, value: object, size: int) -> Expr | Array:
    if not isinstance(value, Expr):
        return vector(name, value, size)
    if value.ufl_shape != (size,):
        raise ValueError(f"{name} has the shape {value.ufl_shape}: it needs {size} components")
    if isinstance(value, fem.Constant):
        vector(name, value.value, size)
    return value


def sizes_of(space: fem.FunctionSpace) -> Sizes:
    index_map, block = space.dofmap.index_map, space.dofmap.index_map_bs
    return index_map.size_local * block, index_map.size_global * block


def same_sizes(name: str, sizes: Sizes, whose: str, other: fem.FunctionSpace | Sizes) -> None:
    """Raises ValueError unless sizes are those of another thing; local."""
    if isinstance(other, fem.FunctionSpace):
        other = sizes_of(other)
    if sizes[1] != other[1]:
        raise ValueError(
            f"{name} has {sizes[1]} degrees of freedom, {whose} has {other[1]}: all of them "
            "have to come from one space, none left out"
        )
    if sizes[0] != other[0]:
        raise ValueError(f"{name} is distributed over the processes otherwise than {whose}")


def described(value: object) -> str:
    if value is None or isinstance(value, str | bytes | bool | int | float | complex):
        return repr(value)
    if isinstance(value, type):
        return f"the class {value.__name__}"
    return f"of the type {type(value).__name__}"
