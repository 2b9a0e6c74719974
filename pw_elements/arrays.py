"""Type aliases of NumPy arrays, and an array class for automatic differentiation."""

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.int64]
# Components of a vector that a user gives
RealVector: TypeAlias = Sequence[float] | npt.NDArray[np.floating | np.integer]
# Local numbers of nodes, facets or cells, with the integer type that DOLFINx uses for them
LocalIndices = npt.NDArray[np.int32]


class AutoDiffArray:
    """Numbers (n,) and their derivatives (n, k), for automatic differentiation in forward mode."""

    __array_ufunc__ = None  # makes NumPy leave operations of both array types to this class

    def __init__(self, value: Array, derivative: Array) -> None:
        self.value, self.derivative = value, derivative

    def __add__(self, other: "AutoDiffOperand") -> "AutoDiffArray":
        if isinstance(other, AutoDiffArray):
            return AutoDiffArray(self.value + other.value, self.derivative + other.derivative)
        return AutoDiffArray(self.value + other, self.derivative)

    def __mul__(self, other: "AutoDiffOperand") -> "AutoDiffArray":
        if isinstance(other, AutoDiffArray):
            derivative = self.derivative * other.value[:, None]
            derivative = derivative + other.derivative * self.value[:, None]
            return AutoDiffArray(self.value * other.value, derivative)
        return AutoDiffArray(self.value * other, (self.derivative.T * other).T)

    def __pow__(self, power: float) -> "AutoDiffArray":
        factor = power * self.value ** (power - 1)
        return AutoDiffArray(self.value**power, self.derivative * factor[:, None])

    def __getitem__(self, rows: Indices) -> "AutoDiffArray":
        return AutoDiffArray(self.value[rows], self.derivative[rows])

    def __neg__(self) -> "AutoDiffArray":
        return self * -1.0

    def __sub__(self, other: "AutoDiffOperand") -> "AutoDiffArray":
        return self + -other

    def __rsub__(self, other: "AutoDiffOperand") -> "AutoDiffArray":
        return -self + other

    def __truediv__(self, other: "AutoDiffOperand") -> "AutoDiffArray":
        return self * other**-1.0

    __radd__, __rmul__ = __add__, __mul__


# Operands of arithmetic expressions, with or without derivatives
AutoDiffOperand: TypeAlias = AutoDiffArray | Array | float


def stack_values_and_derivatives(numbers: Sequence[AutoDiffArray]) -> tuple[Array, Array]:
    """Stack j arrays (q,) and their derivatives (q, k) to values (q, j), derivatives (q, j, k)."""
    parts = ([v.value for v in numbers], [v.derivative for v in numbers])
    return np.stack(parts[0], axis=1), np.stack(parts[1], axis=1)
