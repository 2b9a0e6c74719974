"""Checks of users' arguments: numbers, arrays, meshes, spaces, matrices and coefficients.

A wrong type raises TypeError, a wrong value raises ValueError. The parameter `name` of a check is
the name of the user's argument; error messages begin with it. Numbers of any type are accepted if
they are real and finite. Most checks also refuse magnitudes above `MAX_ARGUMENT_MAGNITUDE`, and
checks of positive numbers refuse those below `MIN_ARGUMENT_MAGNITUDE`.
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
from pw_elements.checks.guard import find_largest_communicator, raise_errors_on_all_processes
from pw_elements.checks.joined import JoinedSpace

LocalAndGlobalSize = tuple[int, int]  # local and global size of a distributed vector

# Range of magnitudes in which squares of quotients neither underflow nor overflow. Outside this
# range, norms become zero or infinite, and results lose digits without a warning
MIN_ARGUMENT_MAGNITUDE, MAX_ARGUMENT_MAGNITUDE = 1e-75, 1e75


def as_list(value: object) -> list[Any]:
    """Return the items of an iterable as a list, or a single object in a list.

    UFL expressions, PETSc objects and strings are treated as single objects.
    """
    if isinstance(value, Iterable) and not isinstance(value, Expr | PETSc.Object | str | bytes):
        try:
            return list(value)
        except Exception:  # raised by a user's iterator
            return [value]
    return [value]


def is_one_of(value: object, names: Collection[str]) -> TypeGuard[str]:
    """Return whether a value is a string that is in `names`; False for values of other types."""
    return isinstance(value, str) and value in names


def is_real_number(value: Any) -> bool:  # noqa: ANN401
    """Return whether a value is a real number or a 0-d array with a real number.

    Truth values and strings are not numbers.
    """
    is_numeric = isinstance(value, int | float | np.number | np.ndarray)
    return is_numeric and np.ndim(value) == 0 and np.asarray(value).dtype.kind in "iuf"


def is_user_function(value: object) -> TypeGuard[Callable[..., Any]]:
    """Return whether a value is a user's function.

    UFL expressions and forms, PETSc matrices and classes are callable, but they are not users'
    functions.
    """
    other_callables = Expr | BaseForm | Measure | PETSc.Object | type
    return callable(value) and not isinstance(value, other_callables)


def check_magnitude(
    name: str, magnitude: float, min_nonzero: float = MIN_ARGUMENT_MAGNITUDE
) -> None:
    """Raise ValueError unless a magnitude is zero or between `min_nonzero` and the maximum."""
    if magnitude > MAX_ARGUMENT_MAGNITUDE or 0 < magnitude < min_nonzero:
        raise ValueError(
            f"{name} is of the size {magnitude:.3g}, out of the range {MIN_ARGUMENT_MAGNITUDE:g} "
            f"to {MAX_ARGUMENT_MAGNITUDE:g} in which numbers keep their digits: choose units in "
            "which it is nearer to one"
        )


def check_finite_number(name: str, value: Any) -> float:  # noqa: ANN401
    """Return a finite real number as a float; raise ValueError for other values."""
    if not (is_real_number(value) and np.isfinite(value)):
        raise ValueError(f"{name} = {value!r}: has to be a finite number")
    check_magnitude(name, abs(float(value)), min_nonzero=0.0)
    return float(value)


def check_positive(name: str, value: Any) -> float:  # noqa: ANN401
    """Return a positive real number as a float; raise ValueError for other values."""
    if not check_finite_number(name, value) > 0:
        raise ValueError(f"{name} = {value!r}: has to be positive")
    check_magnitude(name, float(value))
    return float(value)


def check_integer(name: str, value: Any, minimum: int) -> int:  # noqa: ANN401
    """Return an integer that is `minimum` or larger; raise ValueError for other values."""
    if not (is_real_number(value) and np.asarray(value).dtype.kind in "iu" and value >= minimum):
        raise ValueError(f"{name} = {value!r}: has to be a whole number, {minimum} at least")
    return int(value)


def check_vector(name: str, values: Any, length: int | None = None) -> Array:  # noqa: ANN401
    """Return finite components (length,) as floats; raise ValueError for other values.

    If `length` is None, any number of components except zero is accepted.
    """
    is_sequence = isinstance(values, Iterable) and not isinstance(values, PETSc.Object)
    components = as_list(values) if is_sequence else []
    are_finite = all(
        is_real_number(component) and np.isfinite(component) for component in components
    )
    if not (components and are_finite and len(components) == (length or len(components))):
        requirement = f"{length} finite" if length else "finite"
        raise ValueError(f"{name} {values!r}: it needs {requirement} components")
    vector = np.array(components, dtype=float)
    check_magnitude(name, float(np.abs(vector).max()), min_nonzero=0.0)
    return vector


def check_real_array(name: str, values: Any, shape: tuple[int, ...]) -> Array:  # noqa: ANN401
    """Return an array of real finite numbers with a given shape as floats.

    Raises:
        ValueError: for other values.
    """
    try:  # converting an empty PETSc vector by NumPy would crash the process
        array = np.asarray(None if isinstance(values, PETSc.Object) else values)
    except ValueError:  # rows of different lengths
        array = np.empty(0, dtype=object)
    if array.shape != shape or array.dtype.kind not in "iuf" or not np.isfinite(array).all():
        raise ValueError(
            f"{name} of the shape {array.shape} and the type {array.dtype}: {shape} finite numbers "
            "are needed, all of them real"
        )
    return array.astype(float)


def check_user_function_values(
    name: str,
    values: object,
    shape: tuple[int, ...],
    layout_description: str,
    value_type: type = float,
) -> npt.NDArray[Any]:
    """Check the values that a user's function returned at points, and return them as an array.

    NaN and infinity are accepted.

    Args:
        name: name of the function, such as "the marker".
        values: return value of the function.
        shape: required shape of the values, with the number of points as first entry.
        layout_description: description of the required layout, used in the error message.
        value_type: required type of the values: float for real numbers, bool for truth values.

    Raises:
        ValueError: for values of another shape or type.
    """
    array = np.asarray(values)
    if array.shape != shape or array.dtype.kind not in ("b" if value_type is bool else "iuf"):
        raise ValueError(
            f"{name} gave {array.dtype} of the shape {array.shape} for {shape[0]} points: "
            f"{layout_description}"
        )
    return array.astype(value_type)


def check_type(
    name: str, value: object, kind: type | UnionType | tuple[type, ...], remedy: str
) -> None:
    """Raise TypeError unless a value is of the type `kind`; `remedy` tells users what to pass."""
    if not isinstance(value, kind):
        raise TypeError(f"{name} is {describe_value_or_type(value)}: {remedy}")


def check_communicator(value: object) -> None:
    check_type("comm", value, MPI.Comm, "it has to be a communicator, such as MPI.COMM_WORLD")


def check_double_precision_mesh(value: Any) -> None:  # noqa: ANN401
    """Raise TypeError or ValueError unless a value is a mesh in double precision."""
    check_type("the mesh", value, Mesh, "it has to be a dolfinx.mesh.Mesh")
    if value.geometry.x.dtype != np.float64:
        raise ValueError(f"the mesh is one of {value.geometry.x.dtype}: make it with dtype=float64")


def check_function_space(value: Any, name: str = "the space") -> None:  # noqa: ANN401
    """Raise TypeError or ValueError unless a value is a function space in double precision.

    Sub-spaces of a mixed space, such as `space.sub(0)`, are not accepted.
    """
    if isinstance(value, JoinedSpace):
        for body in value.bodies:
            check_function_space(body.space, name)
        return
    check_type(name, value, fem.FunctionSpace, "it has to be a fem.FunctionSpace, one of `Spaces`")
    check_double_precision_mesh(value.mesh)
    if getattr(value, "component", list)():  # missing in some versions of DOLFINx
        raise ValueError(
            f"{name} is a part of another, {name}.sub(i): give the whole, or collapse it"
        )


def check_flag(name: str, value: object) -> None:
    check_type(name, value, (bool, np.bool_), "it has to be True or False")


def check_assembled_square_matrix(
    name: str, value: object, other_name: str = "", required_size: LocalAndGlobalSize | None = None
) -> None:
    """Raise TypeError or ValueError unless a value is an assembled square matrix.

    Args:
        name: name of the matrix, used in error messages.
        value: object to be checked.
        other_name: name of the object that has `required_size`, used in error messages.
        required_size: required local and global number of rows; None accepts any size.
    """
    check_type(name, value, PETSc.Mat, "assemble_matrix(form) makes a PETSc matrix")
    assert isinstance(value, PETSc.Mat)
    refuse_empty_petsc_object(name, value)
    rows, columns = value.getSize()
    if rows != columns:
        raise ValueError(f"{name} has the shape ({rows}, {columns}): it has to be square")
    if not value.isAssembled():
        raise ValueError(f"{name} is not assembled: call its assemble()")
    if required_size is not None:
        check_equal_vector_sizes(name, value.getSizes()[0], other_name, required_size)


def check_petsc_vector(
    name: str,
    value: object,
    other_name: str = "",
    required_space_or_size: fem.FunctionSpace | LocalAndGlobalSize | None = None,
) -> None:
    """Raise TypeError or ValueError unless a value is a PETSc vector.

    Args:
        name: name of the vector, used in error messages.
        value: object to be checked.
        other_name: name of the required space or of the object with the required size, used in
            error messages.
        required_space_or_size: function space to which the vector has to belong, or required local
            and global size; None accepts any size.
    """
    check_type(
        name, value, PETSc.Vec, "assemble_vector(form) makes one; float(s) * vector scales it"
    )
    assert isinstance(value, PETSc.Vec)
    refuse_empty_petsc_object(name, value)
    if required_space_or_size is not None:
        check_equal_vector_sizes(name, value.getSizes(), other_name, required_space_or_size)


def refuse_empty_petsc_object(name: str, value: PETSc.Object) -> None:
    """Raise ValueError for a PETSc object that was destroyed or never set up."""
    if value.handle == 0 or value.getType() is None:
        noun = {"Mat": "matrix", "Vec": "vector"}.get(type(value).__name__, "object")
        raise ValueError(f"{name} is an empty {noun}: it was destroyed, or never set up")


def check_coefficient(
    name: str,
    value: object,
    is_valid: Callable[[Array], Mask],
    requirement: str,
    comm: MPI.Comm = MPI.COMM_SELF,
) -> float | Expr:
    """Check a coefficient; return a number as a float, or a scalar UFL expression unchanged.

    The values of numbers, `fem.Constant`s and Lagrange functions are checked; the values of other
    expressions are not available. Errors are raised on all processes of the coefficient's mesh, or
    on all processes of `comm` if the coefficient has no mesh.

    Args:
        name: name of the coefficient, used in error messages.
        value: number or scalar expression.
        is_valid: function that takes values (n,) and returns a mask (n,) of the valid ones.
        requirement: requirement on the values (for example "has to be positive"), used in the error
            message.
        comm: communicator for coefficients without a mesh.

    Raises:
        ValueError: if the expression is not scalar, or a value is invalid.
    """
    with raise_errors_on_all_processes(find_largest_communicator(comm, value)):
        if not isinstance(value, Expr):
            value = check_finite_number(name, value)
        elif value.ufl_shape != ():
            raise ValueError(f"{name} has the shape {value.ufl_shape}: it has to be a scalar")
        values = coefficient_values_if_available(value)
        is_wrong = ~(np.isfinite(values) & is_valid(values))
        if is_wrong.any():
            raise ValueError(f"{name} = {values[is_wrong][0]}: {requirement}")
    return value


def check_positive_coefficient(
    name: str, value: object, comm: MPI.Comm = MPI.COMM_SELF
) -> float | Expr:
    coefficient = check_coefficient(
        name, value, lambda values: values > 0, "has to be positive", comm
    )
    with raise_errors_on_all_processes(find_largest_communicator(comm, value)):
        values = coefficient_values_if_available(coefficient)
        for value_bound in (values.min(initial=1.0), values.max(initial=1.0)):
            check_magnitude(name, float(value_bound))
    return coefficient


def coefficient_values_if_available(value: float | Expr) -> Array:
    """Return the values (n,) of a number, a `fem.Constant` or a Lagrange function.

    The array is empty for other expressions, whose values are not available.
    """
    if isinstance(value, fem.Function):
        is_lagrange = value.function_space.element.basix_element.family is ElementFamily.P
        return value.x.array if is_lagrange else np.empty(0)
    if isinstance(value, fem.Constant):
        return np.atleast_1d(value.value)
    return np.empty(0) if isinstance(value, Expr) else np.array([value])


def check_vector_or_expression(name: str, value: object, n_components: int) -> Expr | Array:
    """Return a vector with `n_components` components, given as numbers or as a UFL expression.

    Raises:
        ValueError: for any other value.
    """
    if not isinstance(value, Expr):
        return check_vector(name, value, n_components)
    if value.ufl_shape != (n_components,):
        raise ValueError(
            f"{name} has the shape {value.ufl_shape}: it needs {n_components} components"
        )
    if isinstance(value, fem.Constant):
        check_vector(name, value.value, n_components)
    return value


def count_local_and_global_dofs(space: fem.FunctionSpace) -> LocalAndGlobalSize:
    """Return the local and global number of degrees of freedom of a space."""
    index_map, block = space.dofmap.index_map, space.dofmap.index_map_bs
    return index_map.size_local * block, index_map.size_global * block


def check_equal_vector_sizes(
    name: str,
    sizes: LocalAndGlobalSize,
    other_name: str,
    other_sizes: fem.FunctionSpace | LocalAndGlobalSize,
) -> None:
    """Raise ValueError on this process unless two objects have equal local and global sizes.

    Args:
        name: name of the first object, used in error messages.
        sizes: local and global size of the first object.
        other_name: name of the second object.
        other_sizes: function space, or local and global size of the second object.
    """
    if isinstance(other_sizes, fem.FunctionSpace | JoinedSpace):
        other_sizes = count_local_and_global_dofs(other_sizes)
    if sizes[1] != other_sizes[1]:
        raise ValueError(
            f"{name} has {sizes[1]} degrees of freedom, {other_name} has {other_sizes[1]}: all of "
            "them have to come from one space, none left out"
        )
    if sizes[0] != other_sizes[0]:
        raise ValueError(f"{name} is distributed over the processes otherwise than {other_name}")


def describe_value_or_type(value: object) -> str:
    """Return a short description of a value for error messages: the value or its type."""
    if value is None or isinstance(value, str | bytes | bool | int | float | complex):
        return repr(value)
    if isinstance(value, type):
        return f"the class {value.__name__}"
    return f"of the type {type(value).__name__}"
