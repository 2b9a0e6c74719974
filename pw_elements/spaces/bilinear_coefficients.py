"""Coefficients of the values and slopes of test and trial functions in a bilinear integrand.

The integrand is linear in the values and slopes of the test function v, and also in those of the
trial function u. Each coefficient is therefore a derivative with respect to one component of v or
of its gradient and one component of u or of its gradient. The coefficients depend on neither v nor
u. Those that are zero for any data are left out.
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import ufl
from ufl.algorithms.apply_algebra_lowering import apply_algebra_lowering
from ufl.algorithms.apply_derivatives import apply_derivatives
from ufl.algorithms.remove_complex_nodes import remove_complex_nodes
from ufl.classes import (
    Argument,
    ComponentTensor,
    Conditional,
    Division,
    Expr,
    FixedIndex,
    Grad,
    Identity,
    Indexed,
    IndexSum,
    ListTensor,
    MultiIndex,
    Product,
    ScalarValue,
    Sum,
    Variable,
    Zero,
)
from ufl.corealg.map_dag import map_expr_dag
from ufl.corealg.multifunction import MultiFunction
from ufl.corealg.traversal import unique_pre_traversal

TEST, TRIAL = 0, 1  # UFL's numbers of the arguments


class NotSeparableError(Exception):
    """The integrand contains other operators on its arguments than values and first slopes."""


@dataclass(frozen=True, order=True)
class ArgumentComponent:
    """One component of the value of a test or trial function, or of its gradient.

    Args:
        component: number of the component of the function, 0 for a scalar function.
        direction: direction of the derivative; -1 for the value.
    """

    component: int
    direction: int

    @property
    def is_slope(self) -> bool:
        return self.direction >= 0


def derive_bilinear_coefficients(
    integrand: Expr,
) -> dict[tuple[ArgumentComponent, ArgumentComponent], Expr]:
    """Return the scalar coefficients of a bilinear integrand that are not zero.

    Args:
        integrand: integrand with a test and a trial function, to which derivatives have been
            applied.

    Returns:
        The coefficients, keyed by the component of the test function and that of the trial
        function.

    Raises:
        NotSeparableError: if the integrand has second slopes of an argument, for example.
    """
    arguments = {
        node.number(): node
        for node in unique_pre_traversal(integrand)
        if isinstance(node, Argument)
    }
    replacement = _ArgumentReplacement(arguments)
    separated = map_expr_dag(replacement, remove_complex_nodes(apply_algebra_lowering(integrand)))
    coefficients = {}
    for test, trial in itertools.product(*(replacement.variables_of(n) for n in (TEST, TRIAL))):
        derivative = ufl.diff(ufl.diff(separated, test), trial)
        derivative = apply_derivatives(apply_algebra_lowering(derivative))
        if isinstance(derivative, Zero):
            continue
        zeros = _ZeroFinder()
        test_rank = len(test.ufl_shape)
        for index in np.ndindex(derivative.ufl_shape):
            if not zeros.is_zero(derivative, index, {}):
                key = (
                    _component_of(index[:test_rank], arguments[TEST]),
                    _component_of(index[test_rank:], arguments[TRIAL]),
                )
                coefficients[key] = derivative[index] if index else derivative
    return coefficients


def _component_of(index: tuple[int, ...], argument: Argument) -> ArgumentComponent:
    """Return the component with an index (i,) or () of the value, or (i, j) or (j,) of slopes."""
    value_rank = len(argument.ufl_shape)
    component = index[0] if value_rank else 0
    return ArgumentComponent(component, index[-1] if len(index) > value_rank else -1)


class _ArgumentReplacement(MultiFunction):
    """Replaces test and trial functions and their gradients by independent variables."""

    def __init__(self, arguments: dict[int, Argument]) -> None:
        super().__init__()
        if arguments.keys() != {TEST, TRIAL} or any(
            len(a.ufl_shape) > 1 for a in arguments.values()
        ):
            raise NotSeparableError
        self._values, self._slopes = {}, {}
        for number, argument in arguments.items():
            domain = ufl.domain.extract_unique_domain(argument)
            gradient_shape = ufl.grad(argument).ufl_shape
            self._values[number] = ufl.variable(ufl.Constant(domain, argument.ufl_shape))
            self._slopes[number] = ufl.variable(ufl.Constant(domain, gradient_shape))

    def variables_of(self, number: int) -> Iterator[Variable]:
        return iter((self._slopes[number], self._values[number]))

    expr = MultiFunction.reuse_if_untouched

    def argument(self, argument: Argument) -> Variable:
        return self._values[argument.number()]

    def grad(self, gradient: Grad, operand: Expr) -> Expr:
        (function,) = gradient.ufl_operands
        if isinstance(function, Argument):
            return self._slopes[function.number()]
        if operand is not function:
            raise NotSeparableError
        return gradient

    def restricted(self, *_: Expr) -> Expr:
        raise NotSeparableError

    def reference_value(self, *_: Expr) -> Expr:
        raise NotSeparableError


class _ZeroFinder:
    """Finds components of a tensor-valued expression that are zero for any data."""

    def __init__(self) -> None:
        self._results: dict[tuple[Expr, tuple[int, ...], tuple[int, ...]], bool] = {}

    def is_zero(
        self, expression: Expr, component: tuple[int, ...], indices: dict[int, int]
    ) -> bool:
        """Return whether a component is zero.

        Args:
            expression: expression with algebra and derivatives in their basic forms.
            component: component of the expression.
            indices: values of UFL's free indices, keyed by their numbers.
        """
        free = tuple(indices[number] for number in expression.ufl_free_indices)
        key = expression, component, free
        if key not in self._results:
            self._results[key] = self._derive_whether_zero(expression, component, indices)
        return self._results[key]

    def _derive_whether_zero(
        self, expression: Expr, component: tuple[int, ...], indices: dict[int, int]
    ) -> bool:
        operands = expression.ufl_operands
        match expression:
            case Zero():
                return True
            case Identity():
                return component[0] != component[1]
            case ScalarValue():
                return bool(expression.value() == 0)
            case Sum():
                return all(self.is_zero(term, component, indices) for term in operands)
            case Product():
                return any(self.is_zero(factor, component, indices) for factor in operands)
            case Division() | Variable():
                return self.is_zero(operands[0], component, indices)
            case Conditional():
                return all(self.is_zero(value, component, indices) for value in operands[1:])
            case ListTensor():
                return self.is_zero(operands[component[0]], component[1:], indices)
            case Indexed():
                return self.is_zero(operands[0], _index_values(operands[1], indices), indices)
            case ComponentTensor():
                bound = {
                    index.count(): value
                    for index, value in zip(operands[1], component, strict=True)
                }
                return self.is_zero(operands[0], (), indices | bound)
            case IndexSum():
                (index,) = operands[1]
                return all(
                    self.is_zero(operands[0], component, indices | {index.count(): value})
                    for value in range(expression.dimension())
                )
        return False


def _index_values(index: MultiIndex, indices: dict[int, int]) -> tuple[int, ...]:
    return tuple(int(i) if isinstance(i, FixedIndex) else indices[i.count()] for i in index)
