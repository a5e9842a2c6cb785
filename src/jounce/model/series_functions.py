"""Evaluate functions and programs of quantities that vary in time, with rates.

Each is `from_rate` of its differential equation: ``y' = f(y, x) x'`` gives all rates by the product rule.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from jounce.core.scalars import cos, exp, reciprocal, sin, sqrt, tanh
from jounce.program import operations
from jounce.program.program import Program
from jounce.spatial.series import Series, from_rate


def sine_cosine(x: Series) -> tuple[Series, Series]:
    """Return sine and cosine of a series, with their rates."""
    S = from_rate(sin(x[0]), lambda _: C * x.dot)
    C = from_rate(cos(x[0]), lambda _: -(S * x.dot))
    return S, C


def inverse(x: Series) -> Series:
    """Return 1 / x, entry by entry: y' = -y^2 x'."""
    return from_rate(reciprocal(x[0]), lambda y: -(y * y * x.dot))


def hyperbolic_tangent(x: Series) -> Series:
    """Return the hyperbolic tangent: y' = x' / cosh(x)^2."""
    return from_rate(tanh(x[0]), lambda y: _square_sech(x, y) * x.dot)


def hyperbolic_slope(x: Series) -> Series:
    """Return 1 / cosh(x)^2, the derivative of the hyperbolic tangent."""
    return _square_sech(x, hyperbolic_tangent(x))


def _square_sech(x: Series, y: Series) -> Series:
    """Return 1 / cosh(x)^2 of y = tanh x, with all digits."""
    # The value 1 - y^2 loses its digits where y is near 1; its rates, -(y^2)', do not.
    return from_rate(operations.square_sech(x[0], y[0], exp), lambda _: -(y * y).dot)


def exponential(x: Series) -> Series:
    """Return the exponential function: y' = y x'."""
    return from_rate(exp(x[0]), lambda y: y * x.dot)


SERIES_RULES: Mapping[str, Callable[..., Series]] = {
    "mul": lambda x, y: x * y,
    "add": lambda x, y: x + y,
    "sub": lambda x, y: x - y,
    "neg": lambda x: -x,
    "inv": inverse,
    "sin": lambda x: sine_cosine(x)[0],
    "cos": lambda x: sine_cosine(x)[1],
    "tanh": hyperbolic_tangent,
    "exp": exponential,
    "sqrt": lambda x: from_rate(sqrt(x[0]), lambda y: inverse(y) * x.dot * 0.5),
}


def evaluate(program: Program, inputs: Sequence[Series]) -> list[Series]:
    """Return the outputs of a program for series as inputs."""
    values: list[Series] = []
    for step in program.steps:
        if step.kind == "input":
            values.append(inputs[int(step.value)])
        elif step.kind == "constant":
            values.append(Series.constant(np.asarray(step.value)))
        else:
            values.append(SERIES_RULES[step.kind](*(values[i] for i in step.operands)))
    return [values[i] for i in program.outputs]
