"""Programs for the tests: one of each operation, functions of functions, and exact random expressions.

Shares with jounce: the program, of which `run_exactly` computes every operation with mpmath.
"""

from collections.abc import Callable
from typing import Any

import mpmath
from hypothesis import assume
from hypothesis import strategies as st

from jounce.program import operations
from jounce.program.program import Step, Tape, prune


def one_of_each():
    """A program whose outputs are one of each operation, of the first inputs, none traced away."""
    steps = [Step("input", value=float(i)) for i in range(3)]
    steps += [Step(name, tuple(range(operation.arity))) for name, operation in operations.OPERATIONS.items()]
    return prune(steps, range(3, len(steps)), 3)


EXACT_OPERATIONS: dict[str, Callable[..., Any]] = {  # on numbers of mpmath, written down once more
    "mul": lambda a, b: a * b,
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "neg": lambda a: -a,
    "inv": lambda a: 1 / a,
    "fma": lambda a, b, c: a * b + c,
    "fms": lambda a, b, c: a * b - c,
    "fnma": lambda a, b, c: c - a * b,
    "sin": mpmath.sin,
    "cos": mpmath.cos,
    "tanh": mpmath.tanh,
    "exp": mpmath.exp,
    "sqrt": mpmath.sqrt,
}


def run_exactly(program, inputs):
    """The outputs of a program on numbers of mpmath."""
    values = []
    for step in program.steps:
        if step.kind == "input":
            values.append(inputs[int(step.value)])
        elif step.kind == "constant":
            values.append(mpmath.mpf(step.value))
        else:
            values.append(EXACT_OPERATIONS[step.kind](*(values[i] for i in step.operands)))
    return [values[i] for i in program.outputs]


def nested(x, y, z):
    """A node that every operation which is not fused leads to, by more than one way."""
    return (
        (x * y - z).sin() / (y + (x - z).cos() * 3)
        - (-x * z).tanh()
        + 1 / (2 + z * z)
        - (y * z).exp()
        + (x * x + 1).sqrt()
    )


@st.composite
def expressions(draw):
    """A program of sums and products of three integers and of constants, and the integers."""
    values = [draw(st.integers(-3, 3)) for _ in range(3)]
    tape = Tape()
    made = [*zip(tape.variables(3), values, map(abs, values), strict=True)]
    for _ in range(draw(st.integers(1, 25))):
        kind = draw(st.sampled_from(["add", "sub", "mul", "neg", "constant"]))
        x, a, largest_a = draw(st.sampled_from(made))
        y, b, largest_b = draw(st.sampled_from(made))
        match kind:
            case "constant":
                c = draw(st.sampled_from([0, 1, -1, 2, -3]))
                made.append((x * c + y, a * c + b, largest_a * abs(c) + largest_b))
            case "neg":
                made.append((-x, -a, largest_a))
            case "mul":
                made.append((x * y, a * b, largest_a * largest_b))
            case _:
                sign = 1 if kind == "add" else -1
                made.append((x + y if sign > 0 else x - y, a + sign * b, largest_a + largest_b))
    assume(max(largest for _, _, largest in made) < 2**50)  # so that doubles hold all of it exactly
    outputs = draw(st.lists(st.sampled_from(made), min_size=1, max_size=5))
    return tape.program([node for node, _, _ in outputs]), values, [value for _, value, _ in outputs]
