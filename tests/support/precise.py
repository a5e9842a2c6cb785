"""Forces of closed robots in 50 digits: traced programs, and Newton's steps, evaluated with mpmath."""

from typing import Any

import mpmath
from mpmath import mpf

from jounce.dynamics import loop_newton
from jounce.dynamics.computation import Computation
from jounce.model.scalar_casting import with_exact_integers
from jounce.native.code_forms import trace_program
from jounce.program.trace import Tape

RULES: dict[str, Any] = {
    "mul": lambda a, b: a * b,
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "neg": lambda a: -a,
    "inv": lambda a: 1 / a,
    "sin": mpmath.sin,
    "cos": mpmath.cos,
}
DIGITS, STEPS = 50, 60


def run(traced: Any, given: list[Any]) -> list[Any]:
    """The outputs of a program of numbers of mpmath."""
    values: list[Any] = []
    for step in traced.steps:
        if step.kind == "input":
            values.append(given[int(step.value)])
        elif step.kind == "constant":
            values.append(mpf(step.value))
        else:
            values.append(RULES[step.kind](*(values[i] for i in step.operands)))
    return [values[i] for i in traced.outputs]


class Precise:
    """Generalized forces of a closed robot with their rates."""

    def __init__(self, robot: Any, order: int = 2) -> None:
        self.m, self.order, tape = robot.mechanism, order, Tape()
        q, change = tape.variables(self.m.tree.n), tape.variables(self.m.n)
        found, measures, _ = loop_newton.newton_step(with_exact_integers(self.m), q, change)
        self.step = tape.program([*found, *measures])
        self.law = trace_program(self.m, Computation("inverse_dynamics", order))

    def forces(self, q: Any, rates: Any) -> list[list[float]]:
        """Q, Qd, ... where all coordinates q are nearly closed."""
        c = self.m.closure
        with mpmath.workdps(DIGITS):
            x = [mpf(float(value)) for value in q]
            for _ in range(STEPS):
                found = run(self.step, x + [mpf(0)] * self.m.n)
                for j, value in zip(c.dependent, found[:-2], strict=True):
                    x[j] = value
                if found[-2] < mpf(10) ** (4 - 2 * DIGITS):
                    break
            else:
                raise AssertionError("the loops are not closed")
            given = [x[j] for j in c.independent] + [mpf(float(value)) for rate in rates for value in rate]
            Q = run(self.law, given + [x[j] for j in c.dependent])
            return [[float(value) for value in Q[k * self.m.n : (k + 1) * self.m.n]] for k in range(self.order + 1)]
