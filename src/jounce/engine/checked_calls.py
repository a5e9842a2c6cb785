"""Calls on checked arrays: what a robot needs around its backends, decided once for a computation.

Accelerations of robots whose mass matrix may be singular are marked where it is. Closed robots, and steep drives, take
results at displaced inputs too, which determine the digits that are certain. Contacts that may not balance the base
take a search for the active rows of their limits.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from jounce.arguments import requests
from jounce.arguments.convert import NATIVE
from jounce.core.scalars import Array, is_numeric
from jounce.dynamics.computation import Computation
from jounce.dynamics.mobility import is_singular, may_be_singular
from jounce.engine import certain_digits
from jounce.engine.backends import Call, closing_step, run_by_backend, with_constraints
from jounce.engine.contact_limits import compute_on_contacts, is_always_balanced
from jounce.engine.engine import Engine, with_mechanism
from jounce.engine.generic_methods import as_tuple, write_results

Way = Callable[[Call], Any]  # from a call on checked arrays to its results


def find_way(robot: Engine, asked: Computation, method: str | None) -> Way:
    """How a robot computes a quantity from checked arrays."""
    if is_searched_on_contacts(robot, asked):
        return lambda call: compute_on_contacts(call, run_by_backend)
    way = _mark_singular if needs_inverse(robot, asked) else run_by_backend
    if certain_digits.may_be_lost(robot.mechanism, asked):
        return _with_certain_digits(robot, asked, method, way)
    return way


def is_searched_on_contacts(robot: Engine, asked: Computation) -> bool:
    """Whether active rows of limits of contacts are sought for a quantity, or contacts may not balance the base."""
    m, row = robot.mechanism, asked.quantity
    return bool(m.contacts) and row.on_contacts and not is_always_balanced(m)


def needs_inverse(robot: Engine, asked: Computation) -> bool:
    """Whether a quantity takes the inverse of a mass matrix that may be singular at some positions."""
    m = robot.mechanism
    return asked.quantity.inverts and m.is_numeric and may_be_singular(requests.inverted_mechanism(m, asked.name))


def _with_certain_digits(robot: Engine, asked: Computation, method: str | None, way: Way) -> Way:
    """The way to results that are compared with those at displaced inputs where digits may be lost."""
    m, names = with_constraints(robot, asked), asked.quantity.names(asked.order)
    step = closing_step(robot) if method in (None, NATIVE) and m is robot.mechanism else None

    def compute(call: Call) -> Any:
        def run(arrays: Sequence[Array]) -> tuple[Array, ...]:
            return as_tuple(way(call._replace(arrays=arrays, out=None)))

        results = certain_digits.compute_certain_results(m, asked, names, call.arrays, run, step)
        return way(call) if results is None else write_results(results, call.out)

    return compute


def _mark_singular(call: Call) -> Any:
    """Results with infinite entries, and NumPy's warning, where pivots of the mass matrix are only rounding."""
    found = run_by_backend(call)
    if not all(map(is_numeric, call.arrays)):
        return found
    m, asked = call.robot.mechanism, call.computation
    inverted = requests.inverted_mechanism(m, asked.name)
    plant = call.robot if inverted is m else with_mechanism(call.robot, inverted)
    at = [call.arrays[0], *(call.arrays[-1:] if m.takes_dependent else [])]
    M = run_by_backend(Call(plant, Computation("mass_matrix", 0), at))
    regular = 1.0 - is_singular(inverted, np.asarray(call.arrays[0]), M)
    if not regular.all():
        for array, port in zip(as_tuple(found), asked.signature(m).outputs, strict=True):
            np.divide(array, regular.reshape(regular.shape + (1,) * len(port.shape)), out=array)
    return found
