"""What an argument may be: checks in the library's words, local unless they say otherwise.

Wrong types are a TypeError, wrong values a ValueError; each names the argument and a remedy.
"""

from collections.abc import Iterable, Sequence
from numbers import Integral, Real

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.mesh import Mesh
from ufl.core.expr import Expr

from pw_elements.collective import collective


def of_type(name: str, value: object, kind: type | tuple[type, ...], remedy: str) -> None:
    """Raises TypeError unless the value is of a kind; `remedy` says what to give instead."""
    if not isinstance(value, kind):
        raise TypeError(f"{name} is {described(value)}: {remedy}")


def mesh(name: str, value: object) -> None:
    """Raises TypeError unless it is a DOLFINx mesh."""
    of_type(name, value, Mesh, "it has to be a dolfinx.mesh.Mesh")


def space(name: str, value: object) -> None:
    """Raises TypeError unless it is a function space."""
    of_type(name, value, fem.FunctionSpace, "it has to be a function space, such as `Spaces.trial`")


def integer(name: str, value: object, least: int, most: int | None = None) -> int:
    """A whole number from `least` to `most`."""
    if not isinstance(value, Integral) or isinstance(value, bool):
        raise TypeError(f"{name} is {described(value)}: it has to be a whole number")
    if value < least or (most is not None and value > most):
        bounds = f"{least} at least" if most is None else f"from {least} to {most}"
        raise ValueError(f"{name} = {value}: it has to be {bounds}")
    return int(value)


def flag(name: str, value: object) -> None:
    """Raises TypeError unless it is True or False."""
    of_type(name, value, (bool, np.bool_), "it has to be True or False")


def number(name: str, value: object) -> float:
    """A real, finite number: Python's, NumPy's, or an array of no dimensions."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value.item()
    if not isinstance(value, Real) or isinstance(value, bool | np.bool_):
        raise TypeError(f"{name} is {described(value)}: it has to be a number")
    if not np.isfinite(float(value)):
        raise ValueError(f"{name} = {value}: it has to be a finite number")
    return float(value)


def numbers(name: str, values: object, count: int) -> npt.NDArray[np.float64]:
    """Real, finite numbers (count,)."""
    if isinstance(values, str | bytes) or not isinstance(values, Iterable):
        raise TypeError(f"{name} is {described(values)}: it has to be {count} numbers")
    every = [number(f"a component of {name}", value) for value in values]
    if len(every) != count:
        raise ValueError(f"{name} {list(every)} needs {count} finite components")
    return np.array(every)


def coefficient(name: str, value: object) -> float | Expr:
    """A number or a scalar UFL expression; numbers come back as floats.

    The value of a `fem.Constant` has to be finite, and so have those of a `fem.Function`, on all
    processes; what other expressions are worth cannot be told.
    """
    if not isinstance(value, Expr):
        return number(name, value)
    if value.ufl_shape != ():
        raise ValueError(f"{name} has the shape {value.ufl_shape}: it has to be a scalar")
    known = known_values(value)
    if isinstance(value, fem.Function):
        with collective(value.function_space.mesh.comm):
            _finite(name, known)
    else:
        _finite(name, known)
    return value


def known_values(value: float | Expr) -> npt.NDArray[np.float64]:
    """What a coefficient is worth: a number, a Constant's value, a nodal Function's values.

    None are known of other expressions; a Function's are those of this process, without ghosts.
    """
    if isinstance(value, fem.Constant):
        return np.atleast_1d(value.value)
    if isinstance(value, fem.Function):
        dofmap = value.function_space.dofmap
        return value.x.array[: dofmap.index_map.size_local * dofmap.index_map_bs]
    return np.empty(0) if isinstance(value, Expr) else np.array([value])


def in_range(name: str, value: float | Expr, fits: npt.NDArray[np.bool_], what: str) -> None:
    """Raises ValueError, on all processes, unless all known values fit."""
    known = known_values(value)
    comm = value.function_space.mesh.comm if isinstance(value, fem.Function) else MPI.COMM_SELF
    with collective(comm):
        if not fits.all():
            raise ValueError(f"{name} = {known[~fits][0]}: {what}")


def vector(name: str, value: object, size: int) -> Expr | npt.NDArray[np.float64]:
    """Finite numbers (size,), or a UFL expression of this shape."""
    if not isinstance(value, Expr):
        return numbers(name, value, size)
    if value.ufl_shape != (size,):
        raise ValueError(f"{name} has the shape {value.ufl_shape}: it needs {size} components")
    if isinstance(value, fem.Constant):
        _finite(name, known_values(value))
    return value


def shape(name: str, value: object) -> tuple[int, ...]:
    """A value shape: () for a scalar, (d,) for a vector."""
    if isinstance(value, str) or not isinstance(value, Sequence):
        raise TypeError(f"{name} is {described(value)}: it has to be () or (components,)")
    return tuple(integer(f"{name} {value}", extent, 1) for extent in value)


def matrix(name: str, value: object) -> None:
    """Raises unless it is a square, assembled PETSc matrix."""
    of_type(name, value, PETSc.Mat, "it has to be a PETSc matrix; assemble_matrix(form) makes one")
    assert isinstance(value, PETSc.Mat)
    if value.handle == 0 or value.getType() is None:
        raise ValueError(f"{name} is an empty handle: it was destroyed or never set up")
    rows, columns = value.getSize()
    if rows != columns:
        raise ValueError(f"{name} has the shape ({rows}, {columns}): it has to be square")
    if not value.isAssembled():
        raise ValueError(f"{name} is not assembled: call its assemble()")


def petsc_vector(name: str, value: object) -> None:
    """Raises unless it is a PETSc vector."""
    of_type(name, value, PETSc.Vec, "it has to be a PETSc vector; assemble_vector(form) makes one")
    assert isinstance(value, PETSc.Vec)
    if value.handle == 0 or value.getType() is None:
        raise ValueError(f"{name} is an empty handle: it was destroyed or never set up")


def fitting(
    name: str, sizes: tuple[int, int], whose: str, expected: tuple[int, int], comm: MPI.Comm
) -> None:
    """Raises ValueError unless local and global sizes are the expected ones."""
    if sizes[1] != expected[1]:
        raise ValueError(
            f"{name} has {sizes[1]} degrees of freedom, {whose} has {expected[1]}: all of them "
            "have to come from one space, with all rows and columns free"
        )
    if sizes[0] != expected[0]:
        raise ValueError(
            f"{name} has {sizes[0]} degrees of freedom on process {comm.rank}, {whose} has "
            f"{expected[0]}: they have to be distributed alike"
        )


def space_sizes(value: fem.FunctionSpace) -> tuple[int, int]:
    """Degrees of freedom of a space on this process and on all."""
    index_map, block = value.dofmap.index_map, value.dofmap.index_map_bs
    return index_map.size_local * block, index_map.size_global * block


def _finite(name: str, values: npt.NDArray[np.float64]) -> None:
    if not np.isfinite(values).all():
        raise ValueError(f"{name} has values that are not finite")


def described(value: object) -> str:
    """A value in short: a plain one itself, anything else by its type."""
    if value is None or isinstance(value, str | bytes | bool | int | float | complex):
        return repr(value)
    if isinstance(value, type):
        return f"the class {value.__name__}"
    return f"a {type(value).__module__.split('.')[0]} {type(value).__name__}"
