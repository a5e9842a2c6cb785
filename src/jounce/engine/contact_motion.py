"""Follow contacts along a motion: whether they rest, and when their limits begin to act.

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
    """Yield the times at which active rows change, with jumps.

    The jumps are those of a quantity and its rates. They are between times that are given in order.
    """
    m = robot.mechanism

    def balance_at(t: np.ndarray) -> Balance:
        with contact_limits.unbalanced_at(t):
            return contact_limits.find_balance(
                _call_at(robot, motion, t, QUANTITIES["contact_wrenches"], 0), run_by_backend
            )

    def gives_solution(active: np.ndarray, balance: Balance, i: int = 0) -> bool:
        """Return whether these rows give the solution in a state."""
        # Components in N and N m are compared as the weighted sum takes them.
        sizes = np.where(balance.scales[i] > 0, balance.scales[i], 1.0)
        f, best = (contact_limits.solve_components(m, balance, i, rows) / sizes for rows in (active, balance.active[i]))
        return bool(np.abs(f - best).max() <= SAME_SOLUTION_TOLERANCE * np.abs(best).max())

    at_times = balance_at(times)
    changes = (at_times.active[1:] != at_times.active[:-1]).any(axis=1).nonzero()[0]
    for i in count_through("switches of contacts", changes, len(changes)):
        # In this interval, from `low` on, the rows `before` hold, until they no longer give the solution at its end.
        before, low, stop = at_times.active[i], times[i], times[i + 1]
        while not gives_solution(before, at_times, i + 1):
            # Bisection: at `low` the rows give the solution, at `high` they do not, and the rows `after` do.
            high, after = stop, at_times.active[i + 1]
            while high - low > SWITCH_RESOLUTION * (stop - times[i]):
                middle = (low + high) / 2
                at_middle = balance_at(np.array([middle]))
                if gives_solution(before, at_middle):
                    low = middle
                else:
                    high, after = middle, at_middle.active[0]
            # Both sets of rows at this one time: the quantity and its rates jump by the difference.
            call = _call_at(robot, motion, np.array([high]), row, order)
            sides = [contact_limits.solve_active(call, call.arrays, active[None]) for active in (before, after)]
            yield high, tuple(y[0] - x[0] for x, y in zip(*sides, strict=True))
            before, low = after, high


def _call_at(robot: Engine, motion: Motion, t: np.ndarray, row: Quantity, order: int) -> Call:
    """Return the call for a quantity at times of a motion."""
    return MotionStates.sample(robot, motion, t, [(row, order)]).call(robot, row.name)


def predict_switch(robot: Engine, rates: Sequence[Any], base: Any, wrench: Any) -> tuple[float, str]:
    """Predict how soon the active limits change, and which first.

    It takes the series of the margins of all limits, of as many terms as there are rates.
    """
    m, free = robot.mechanism, DEFAULT_QUANTITY.free_law("recursion", robot.mechanism)
    if not contact_limits.are_limited(m):
        raise JounceError(f"{m.name!r} has no contacts with limits that begin and end; state friction= or sole=")
    computation, arrays = convert_arguments(m, QuantityRequest("contact_wrenches"), Given(rates, wrench, base))
    if computation.order == 0 or arrays[0].ndim > 1:
        raise JounceError(
            f"q is {arrays[0].shape}, with {computation.rates - 1} rates; expected one state, with q3d at least"
        )
    call = Call(robot, computation, arrays)
    balance, soonest = contact_limits.find_balance(call, run_by_backend), (np.inf, "")
    margins = contact_limits.solve_active(
        call, balance.arrays, balance.active, lambda m, x: Stance(m, x).margins(free(m, x))
    )
    names = [f"{name} of {quote_value(contact.frame)}" for contact in m.contacts for name, _ in contact.named_limits]
    for name, row in zip(names, np.array(margins)[:, 0, :, 0].T, strict=True):
        # The margin of a limit as a Taylor polynomial in time, (order + 1,): its first root to come is a change. A root
        # where it only touches 0 is double, and rounding gives it a small imaginary part.
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
    """Return times at which contacts are looked at between two others."""
    return np.linspace(start, stop, max(_CONTACT_SAMPLES, int((stop - start) / _SPACING) + 2))


def refuse_sliding(m: Mechanism, path: Motion) -> None:
    """Raise `JounceError` if a contact moves in a direction that it holds."""
    # Between two ends of stances, the same contacts are there.
    t = np.concatenate([_even_times(*ends) for ends in pairwise(path.stance_ends)])
    rates, base, engine = path(t, 1), path.base(t, 1), Engine(m)
    assert base is not None, m.name
    # Speeds are compared with the fastest turn and the fastest slide of all bodies, (6,).
    body_speeds = np.abs(compute(engine, "twists", rates, base=base, method="recursion"))
    fastest = np.repeat([body_speeds[..., :3].max(), body_speeds[..., 3:].max()], 3)
    sizes, worst = np.repeat([1.0, robot_size(m)], 3), []
    for contact, present in zip(m.contacts, are_present(m, path, t).T, strict=True):
        held = contact.held
        # The twist of the contact in its own axes, or in those of the ground where these are stated: (N, 6, 1).
        V = compute(engine, "twists", rates, base=base, body=contact.frame, method="recursion")
        V = Ad(inverse(contact.place)) @ V[..., None]
        if contact.ground_axes is not None:
            H = compute(engine, "poses", rates[:1], base=base[:1], body=contact.frame, method="recursion")
            V = np.kron(np.eye(2), contact.ground_axes.T @ rotation(H @ contact.place)) @ V
        # Only while it is there, and only components that it holds: (N, held).
        V = V * present[:, None, None]
        speeds = np.abs(V[:, held, 0])
        excess = speeds - SLIDING_TOLERANCE * fastest[held] - _STILL * sizes[held]
        i, j = np.unravel_index(np.argmax(excess), excess.shape)
        distance = np.abs(np.trapezoid(V[:, held[j], 0], t))
        unit = "rad" if held[j] < 3 else "m"
        name = f"{quote_value(contact.frame)} {_TWIST_COMPONENTS[held[j]]}"
        speed = f"by up to {speeds[i, j]:.3g} {unit}/s, at t = {t[i]:.6g} s"
        worst.append((excess[i, j], f"contact {name} {speed}, and {distance:.3g} {unit} in all"))
    largest_excess, text = max(worst)
    if largest_excess > 0:
        raise JounceError(
            f"the motion moves {text}; contacts stay where they are. Plan the base from a foot that stays,"
            " with_base(t, C), or project(motion), or leave this contact out while it moves"
        )


def refuse_hovering(robot: Engine, motion: Motion) -> None:
    """Refuse bases that do not fall freely without contacts.

    Raise `JounceError` if no contact is there and the base takes a wrench.
    """
    m, row = robot.mechanism, QUANTITIES["inverse_dynamics"]
    if len(m.contacts) == 0 or motion.presence is None:
        return
    even = _even_times(motion.start, motion.stop)
    t = even[~are_present(m, motion, even).any(axis=1)]
    if t.size == 0:
        return
    # In free fall, the wrench on the base, the first six forces, is 0. N m count by the size of the robot.
    forces = np.abs(MotionStates.sample(robot, motion, t, [(row, 0)]).compute(robot, row.name)[0])
    levers = np.where(np.isin(coordinates.force_units(m), ("N m",)), robot_size(m), 1.0)
    weight = float(np.linalg.norm(m.gravity) * np.asarray(m.M)[:, 3, 3].sum())
    base_forces = (forces / levers)[:, :6].max(axis=1)
    # Without gravity, the largest force of all takes the place of the weight.
    reference = weight if weight != 0 else (forces / levers).max()
    largest, worst_time = base_forces.max(), t[base_forces.argmax()]
    if largest > FREE_FALL_TOLERANCE * reference:
        raise JounceError(
            f"no contact is there at t = {worst_time:.6g} s, and the base takes {largest:.3g} N, or N m per"
            " size of the robot, that nothing exerts; expected a base that falls freely, or a stance with contacts"
        )
