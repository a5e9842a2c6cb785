"""Times at which rows of the limits of contacts begin or end to be active: along a motion, and predicted from a state.

Problem: all t between two samples at which the set of active rows changes.

Algorithm: where the set at a sample does not give the solution at the next one, bisection finds the first time from
which on it does not, and the rest of the interval is searched in the same way. Rates on both sides are those of both
sets at this time. Invariant: at the left end its set gives the solution; sets differ where a foot carries nothing,
and give the same. Failure: a set that is there between two samples only is not seen.
"""

from collections.abc import Iterator, Sequence
from math import factorial
from typing import Any

import numpy as np

from jounce.arguments.convert import Given, QuantityRequest, convert_arguments
from jounce.core.errors import JounceError, quote_value
from jounce.core.progress import count_through
from jounce.dynamics.contacts import Stance
from jounce.dynamics.quantities import DEFAULT_QUANTITY, QUANTITIES, Quantity
from jounce.engine.backends import Call, run_by_backend
from jounce.engine.contact_limits import (
    Balance,
    are_limited,
    find_balance,
    solve_active,
    solve_components,
    unbalanced_at,
)
from jounce.engine.engine import Engine
from jounce.engine.motion_states import MotionStates
from jounce.motion.motion import Motion

SWITCH_RESOLUTION = 1e-10  # of an interval: times are known no better where forces have ten digits
ROOT_ROUNDING = 1e-6  # of a root: what rounding makes of the imaginary part of one that touches 0
SAME_SOLUTION_TOLERANCE = 1e-9  # of the largest component, weighted, as that of limits


def find_switches(
    robot: Engine, motion: Motion, times: np.ndarray, row: Quantity, order: int
) -> Iterator[tuple[float, tuple[np.ndarray, ...]]]:
    """The times between given ones at which active rows change, with the jumps of a quantity and its rates."""
    m = robot.mechanism

    def balance(t: np.ndarray) -> Balance:
        with unbalanced_at(t):
            return find_balance(_call_at(robot, motion, t, QUANTITIES["contact_wrenches"], 0), run_by_backend)

    def solves(active: np.ndarray, at: Balance, i: int = 0) -> bool:
        """Whether these rows give the solution in a state."""
        sizes = np.where(at.scales[i] > 0, at.scales[i], 1.0)  # of components, N and N m
        f, best = (solve_components(m, at, i, rows) / sizes for rows in (active, at.active[i]))
        return bool(np.abs(f - best).max() <= SAME_SOLUTION_TOLERANCE * np.abs(best).max())

    known = balance(times)
    changes = (known.active[1:] != known.active[:-1]).any(axis=1).nonzero()[0]
    for i in count_through("switches of contacts", changes, len(changes)):
        left, low, stop = known.active[i], times[i], times[i + 1]
        while not solves(left, known, i + 1):
            high, right = stop, known.active[i + 1]
            while high - low > SWITCH_RESOLUTION * (stop - times[i]):
                middle = (low + high) / 2
                found = balance(np.array([middle]))
                low, high, right = (middle, high, right) if solves(left, found) else (low, middle, found.active[0])
            call = _call_at(robot, motion, np.array([high]), row, order)
            sides = [solve_active(call, call.arrays, active[None]) for active in (left, right)]
            yield high, tuple(after[0] - before[0] for before, after in zip(*sides, strict=True))
            left, low = right, high


def _call_at(robot: Engine, motion: Motion, t: np.ndarray, row: Quantity, order: int) -> Call:
    """The call for a quantity at times of a motion."""
    return MotionStates.sample(robot, motion, t, [(row, order)]).call(robot, row.name)


def predict_switch(robot: Engine, rates: Sequence[Any], base: Any, wrench: Any) -> tuple[float, str]:
    """How soon, after one state, the series of the margins of limits say that the active ones change, and where."""
    m, free = robot.mechanism, DEFAULT_QUANTITY.free_law("recursion", robot.mechanism)
    if not are_limited(m):
        raise JounceError(f"{m.name!r} has no contacts with limits that begin and end; state friction= or sole=")
    asked, given = convert_arguments(m, QuantityRequest("contact_wrenches"), Given(rates, wrench, base))
    if not asked.order or given[0].ndim > 1:
        raise JounceError(f"q is {given[0].shape}, with {asked.rates - 1} rates; expected one state, with q3d at least")
    call = Call(robot, asked, given)
    at, soonest = find_balance(call, run_by_backend), (np.inf, "")
    margins = solve_active(call, at.arrays, at.active, lambda m, x: Stance(m, x).margins(free(m, x)))
    names = [f"{name} of {quote_value(contact.frame)}" for contact in m.contacts for name, _ in contact.named_limits]
    for name, row in zip(names, np.array(margins)[:, 0, :, 0].T, strict=True):
        roots = np.polynomial.Polynomial([x / factorial(k) for k, x in enumerate(row)]).roots()
        later = roots.real[(np.abs(roots.imag) <= ROOT_ROUNDING * np.abs(roots)) & (roots.real > 0)]
        soonest = min(soonest, (float(later.min(initial=np.inf)), name))
    return soonest
