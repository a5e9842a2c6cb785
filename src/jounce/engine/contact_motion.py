"""Follow contacts along a motion: whether they hold still, and when rows of their limits begin or end to be active.

Motions whose feet slide, and bases that hover, are refused (`refuse_sliding`, `refuse_hovering`).

Problem: all t between two samples at which the set of active rows changes (`find_switches`).

Algorithm: where the set at a sample does not give the solution at the next one, bisection finds the first time from
which on it does not, and the rest of the interval is searched in the same way. Rates on both sides are those of both
sets at this time. Invariant: at the left end its set gives the solution; sets differ where a foot carries nothing,
and give the same. Failure: a set that is there between two samples only is not seen.

`predict_switch` says of one state, by the series of the margins of all limits, when the next row becomes active.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from math import factorial
from typing import Any

import numpy as np

from jounce.arguments.convert import Given, QuantityRequest, convert_arguments
from jounce.core.errors import JounceError, quote_value
from jounce.core.progress import count_through
from jounce.dynamics.contacts import Stance
from jounce.dynamics.quantities import DEFAULT_QUANTITY, QUANTITIES, Quantity
from jounce.engine import contact_limits
from jounce.engine.backends import Call, run_by_backend
from jounce.engine.contact_limits import Balance
from jounce.engine.engine import Engine
from jounce.engine.motion_states import MotionStates, are_present
from jounce.engine.plan import compute
from jounce.model import coordinates
from jounce.model.mechanism import Mechanism, robot_size
from jounce.motion.motion import Motion
from jounce.spatial.lie import Ad, inverse, rotation

SWITCH_RESOLUTION = 1e-10  # of an interval: times are known no better where forces have ten digits
ROOT_ROUNDING = 1e-6  # of a root: what rounding makes of the imaginary part of one that touches 0
SAME_SOLUTION_TOLERANCE = 1e-9  # of the largest component, weighted, as that of limits


def find_switches(
    robot: Engine, motion: Motion, times: np.ndarray, row: Quantity, order: int
) -> Iterator[tuple[float, tuple[np.ndarray, ...]]]:
    """The times between given ones at which active rows change, with the jumps of a quantity and its rates."""
    m = robot.mechanism

    def balance(t: np.ndarray) -> Balance:
        with contact_limits.unbalanced_at(t):
            return contact_limits.find_balance(
                _call_at(robot, motion, t, QUANTITIES["contact_wrenches"], 0), run_by_backend
            )

    def solves(active: np.ndarray, at: Balance, i: int = 0) -> bool:
        """Whether these rows give the solution in a state."""
        sizes = np.where(at.scales[i] > 0, at.scales[i], 1.0)  # of components, N and N m
        f, best = (contact_limits.solve_components(m, at, i, rows) / sizes for rows in (active, at.active[i]))
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
            sides = [contact_limits.solve_active(call, call.arrays, active[None]) for active in (left, right)]
            yield high, tuple(after[0] - before[0] for before, after in zip(*sides, strict=True))
            left, low = right, high


def _call_at(robot: Engine, motion: Motion, t: np.ndarray, row: Quantity, order: int) -> Call:
    """The call for a quantity at times of a motion."""
    return MotionStates.sample(robot, motion, t, [(row, order)]).call(robot, row.name)


def predict_switch(robot: Engine, rates: Sequence[Any], base: Any, wrench: Any) -> tuple[float, str]:
    """How soon, after one state, the series of the margins of limits say that the active ones change, and where."""
    m, free = robot.mechanism, DEFAULT_QUANTITY.free_law("recursion", robot.mechanism)
    if not contact_limits.are_limited(m):
        raise JounceError(f"{m.name!r} has no contacts with limits that begin and end; state friction= or sole=")
    asked, given = convert_arguments(m, QuantityRequest("contact_wrenches"), Given(rates, wrench, base))
    if not asked.order or given[0].ndim > 1:
        raise JounceError(f"q is {given[0].shape}, with {asked.rates - 1} rates; expected one state, with q3d at least")
    call = Call(robot, asked, given)
    at, soonest = contact_limits.find_balance(call, run_by_backend), (np.inf, "")
    margins = contact_limits.solve_active(call, at.arrays, at.active, lambda m, x: Stance(m, x).margins(free(m, x)))
    names = [f"{name} of {quote_value(contact.frame)}" for contact in m.contacts for name, _ in contact.named_limits]
    for name, row in zip(names, np.array(margins)[:, 0, :, 0].T, strict=True):
        roots = np.polynomial.Polynomial([x / factorial(k) for k, x in enumerate(row)]).roots()
        later = roots.real[(np.abs(roots.imag) <= ROOT_ROUNDING * np.abs(roots)) & (roots.real > 0)]
        soonest = min(soonest, (float(later.min(initial=np.inf)), name))
    return soonest


_CONTACT_SAMPLES, _SPACING = 200, 0.01  # even times at least, and s between them at most, at which contacts are seen
SLIDING_TOLERANCE = 1e-3  # of the fastest turn or slide of a body: contact wrenches have that little of the power
FREE_FALL_TOLERANCE = 1e-3  # of the weight, or of the largest force without any: what a base in flight may lack
_TWIST_COMPONENTS = ("about x", "about y", "about z", "along x", "along y", "along z")
_STILL = 1e-9  # rad/s, and sizes of the robot per s: rounding of a robot at rest


def _even_times(start: float, stop: float) -> np.ndarray:
    return np.linspace(start, stop, max(_CONTACT_SAMPLES, int((stop - start) / _SPACING) + 2))


def refuse_sliding(m: Mechanism, path: Motion) -> None:
    """Raise `JounceError` if a contact moves in a direction in which it transmits a force or moment."""
    t = np.concatenate([_even_times(*ends) for ends in pairwise(path.stance_ends)])
    rates, base, engine = path(t, 1), path.base(t, 1), Engine(m)
    assert base is not None, m.name
    moving = np.abs(compute(engine, "twists", rates, base=base, method="recursion"))
    fastest = np.repeat([moving[..., :3].max(), moving[..., 3:].max()], 3)
    sizes, worst = np.repeat([1.0, robot_size(m)], 3), []
    for contact, present in zip(m.contacts, are_present(m, path, t).T, strict=True):
        held = contact.held
        V = compute(engine, "twists", rates, base=base, body=contact.frame, method="recursion")
        V = Ad(inverse(contact.place)) @ V[..., None]
        if contact.ground_axes is not None:
            H = compute(engine, "poses", rates[:1], base=base[:1], body=contact.frame, method="recursion")
            V = np.kron(np.eye(2), contact.ground_axes.T @ rotation(H @ contact.place)) @ V
        V = V * present[:, None, None]
        speeds = np.abs(V[:, held, 0])
        excess = speeds - SLIDING_TOLERANCE * fastest[held] - _STILL * sizes[held]
        i, j = np.unravel_index(np.argmax(excess), excess.shape)
        far = np.abs(np.trapezoid(V[:, held[j], 0], t))
        unit = "rad" if held[j] < 3 else "m"
        name = f"{quote_value(contact.frame)} {_TWIST_COMPONENTS[held[j]]}"
        text = f"contact {name} by up to {speeds[i, j]:.3g} {unit}/s, at t = {t[i]:.6g} s, and {far:.3g} {unit} in all"
        worst.append((excess[i, j], text))
    beyond, text = max(worst)
    if beyond > 0:
        raise JounceError(
            f"the motion moves {text}; contacts stay where they are. Plan the base from a foot that stays,"
            " with_base(t, C), or project(motion), or leave this contact out while it moves"
        )


def refuse_hovering(robot: Engine, motion: Motion) -> None:
    """Raise `JounceError` if the base does not fall freely while no contact is there."""
    m, row = robot.mechanism, QUANTITIES["inverse_dynamics"]
    if not m.contacts or motion.presence is None:
        return
    even = _even_times(motion.start, motion.stop)
    t = even[~are_present(m, motion, even).any(axis=1)]
    if not t.size:
        return
    forces = np.abs(MotionStates.sample(robot, motion, t, [(row, 0)]).compute(robot, row.name)[0])
    levers = np.where(np.isin(coordinates.force_units(m), ("N m",)), robot_size(m), 1.0)
    weight = float(np.linalg.norm(m.gravity) * np.asarray(m.M)[:, 3, 3].sum())
    lacks = (forces / levers)[:, :6].max(axis=1)
    if lacks.max() > FREE_FALL_TOLERANCE * (weight or (forces / levers).max()):
        raise JounceError(
            f"no contact is there at t = {t[lacks.argmax()]:.6g} s, and the base takes {lacks.max():.3g} N, or N m per"
            " size of the robot, that nothing exerts; expected a base that falls freely, or a stance with contacts"
        )
