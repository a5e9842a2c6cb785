"""Quantities of robots in 50 digits: traced programs, and Newton's steps of closed loops, evaluated with mpmath.

Shares with jounce: its equations. What they lose by rounding is seen here, what is wrong in them is not.
"""

from functools import cache
from math import prod
from typing import Any

import mpmath
import numpy as np
from mpmath import mpf

from jounce.dynamics import loop_assembly
from jounce.dynamics.computation import Computation
from jounce.model.mechanism import with_exact_integers
from jounce.native.code_forms import trace_program
from jounce.program.program import Tape
from support.programs import run_exactly

DIGITS, STEPS = 50, 60


@cache
def _traced(m: Any, asked: Computation) -> Any:
    return trace_program(m, asked)


@cache
def _closing_step(m: Any) -> Any:
    """A step of Newton's method for the dependent coordinates, and how far from closed the loops were."""
    tape = Tape()
    q, change = tape.variables(m.tree.n), tape.variables(m.n)
    found, measures, _ = loop_assembly.newton_step(with_exact_integers(m), q, change)
    return tape.program([*found, measures[0]])


def close_loops(m: Any, q: Any) -> list[Any]:
    """All coordinates, with loops closed from coordinates q where they nearly are."""
    x, c = [mpf(float(value)) for value in q], m.closure
    for _ in range(STEPS):
        *found, gap = run_exactly(_closing_step(m), x + [mpf(0)] * m.n)
        for j, value in zip(c.dependent, found, strict=True):
            x[j] = value
        if gap < mpf(10) ** (4 - 2 * DIGITS):
            return x
    raise AssertionError("the loops are not closed")


def results(robot: Any, asked: Computation, arrays: Any) -> list[np.ndarray]:
    """The results of a computation for one state, rounded to doubles.

    `arrays` are q, qd, ... and what else it takes; q of a closed robot are all coordinates, from which its loops are
    closed.
    """
    m = robot.mechanism
    with mpmath.workdps(DIGITS):
        q, *others = arrays
        given, closing = [mpf(float(x)) for array in others for x in np.ravel(array)], []
        if m.closure:
            whole = close_loops(m, q)
            own, closing = ([whole[j] for j in places] for places in (m.closure.independent, m.closure.dependent))
        else:
            own = [mpf(float(x)) for x in q]
        found = [float(x) for x in run_exactly(_traced(m, asked), own + given + closing)]
    shapes = [port.shape for port in asked.signature(m).outputs]
    ends = np.cumsum([prod(shape) for shape in shapes])[:-1]
    return [part.reshape(shape) for part, shape in zip(np.split(np.array(found), ends), shapes, strict=True)]
