"""Forces along a motion, computed piece by piece: working memory is bounded, and a callback reports the progress."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby
from typing import NamedTuple

import numpy as np

from jounce.arguments.rates import checked_order
from jounce.core.errors import JounceError, UncertainError, at, quoted, warn
from jounce.core.typing import ArrayLike
from jounce.dynamics import closing
from jounce.dynamics.computation import Computation
from jounce.dynamics.quantities import FORCES, Quantity
from jounce.engine import digits
from jounce.engine.backends import closing_step
from jounce.engine.engine import Engine
from jounce.engine.motion_states import MotionStates, Rates, Side
from jounce.model.mechanism import Mechanism
from jounce.motion.base import motion_of, perturbed, states_of
from jounce.motion.matching import matched
from jounce.motion.motion import Break, Motion
from jounce.motion.units import warn_of_degrees

_STATES_PER_PIECE = 1000  # computed together: bounds working memory, and each piece reports progress
_MAX_PERTURBED_STATES = 200_000  # computed for deviations of forces, which change slowly: linear between fewer times
_UNIT_SAMPLES = 200  # even times of a motion by which its unit, rad or degrees, is judged
_FORCE_JUMP_TOLERANCE = 1e-12  # of the largest rate of all joints: smaller differences at a break are rounding
Q_RATE_ORDER = FORCES.rates - 1  # the order of the rate of q that Q itself takes: q2d

SIDES: tuple[Side, Side] = ("left", "right")  # of a break: before it and after it

Progress = Callable[[int, int], object]  # of the number of states done, and of all


class ForceBreak(NamedTuple):
    """A time at which the forces are not smooth: a rate of Q jumps, and higher rates do not exist.

    `order` is the order of the rate that jumps (0 is Q), `jump` (nv,) the size of the jump; they are -1 and None if q
    or qd jumps, so that Q itself does not exist. `causes` are the breaks of the motion at this time. `higher` (nv,) are
    the jumps of the rates after it: a joint whose Q does not jump may have a Qd that does.
    """

    t: float
    order: int
    jump: np.ndarray | None
    causes: tuple[Break, ...]
    higher: tuple[np.ndarray, ...] = ()


@dataclass(frozen=True, eq=False)
class Along:
    """The forces along a motion, and the states that they belong to. `Robot.forces_along` makes one.

    Attributes
    ----------
    t : (N,)
        Times in s.
    rates : tuple of (N, n)
        q, qd, q2d, ... of the motion at these times: rad or m, per s, per s^2, ...; at a break those after it.
    forces : tuple of (N, nv)
        Q, Qd, ...: N m for revolute and N for prismatic coordinates, per s, ...; a tuple for order 0 too. If the robot
        floats, the first 6 columns are the wrench (moment; force) that acts on its base, in its axes. NaN where loops
        are so nearly singular that no digits are certain: a `JounceWarning` counts these rows.
    deviations : tuple of (N, nv), or None
        Standard deviations of the forces that follow from those of q, qd, ...; None where these are exact.
    breaks : tuple of ForceBreak
        Times at which Q or one of its rates jumps or does not exist, with order, jump and causes.
    base : tuple of arrays, or None
        C (N, 4, 4), V, Vd, ... (N, 6) of the motion at these times; None if it has no base.

    Examples
    --------
    >>> import jounce
    >>> robot = jounce.load("planar2r")
    >>> motion = jounce.load_motion({"t": range(9), "joint1": [0.1] * 9, "joint2": [0.2] * 9}, robot, 0, degree=7)
    >>> along = robot.forces_along(motion, order=0)
    >>> along.forces[0].shape
    (9, 2)
    """

    t: np.ndarray
    rates: Rates
    forces: Rates
    deviations: Rates | None = None
    breaks: tuple[ForceBreak, ...] = ()
    base: Rates | None = None


def forces_along(
    robot: Engine,
    motion: object,
    t: ArrayLike | None = None,
    order: object = 2,
    method: str | None = None,
    progress: Progress | None = None,
    row: Quantity = FORCES,
) -> Along:
    """Compute the forces and their rates at given times of a motion, or at its own times.

    `row` may be another quantity (n,) that takes as many rates of q or more, such as motor torques.
    """
    path, highest = checked_motion(robot.mechanism, motion), checked_order(order)
    q, qd = path(np.linspace(path.start, path.stop, _UNIT_SAMPLES), 1)
    warn_of_degrees(q, qd, robot.mechanism, "the motion")
    times = path.times if t is None else path.checked(t)
    if times.ndim != 1 or not times.size:
        raise JounceError(f"t is {quoted(t)}; expected an array (N,) of times in s, or None for those of the motion")
    if progress is not None and not callable(progress):
        raise JounceError(f"progress is {quoted(progress)}; expected a function of two numbers, (done, total)")
    parts = list(pieces_along(robot, path, times, highest, method, progress, row))
    rates, forces = (_join([getattr(part, name) for part in parts]) for name in ("rates", "forces"))
    deviations = None if parts[0].deviations is None else _join([part.deviations or () for part in parts])
    breaks = force_breaks(robot, path, times, highest, method, row)
    base = None if parts[0].base is None else _join([part.base or () for part in parts])
    return Along(times, rates, forces, deviations, breaks, base)


def checked_motion(mechanism: Mechanism, motion: object) -> Motion:
    """Check that a motion is one of the robot's joints, and put it in their order."""
    if not isinstance(motion, Motion):
        raise JounceError(f"motion is {quoted(motion)}; expected a jounce.Motion, as jounce.load_motion makes one")
    with at("the motion"):
        if mechanism.floats and motion.base_curve is None:
            raise JounceError(
                f"{mechanism.name!r} floats, and the motion has no base; columns base.x, ..., base.qz of a table state"
                " one, and motion.with_base(t, C) gives it poses C (N, 4, 4), or one pose with t=None"
            )
        return matched(motion, mechanism)


def pieces_along(
    robot: Engine,
    motion: Motion,
    times: np.ndarray,
    order: int,
    method: str | None = None,
    progress: Progress | None = None,
    row: Quantity = FORCES,
) -> Iterator[Along]:
    """Yield the forces along a motion in pieces of some states, without breaks.

    After each piece, `progress` is called with the number of states done and the total. A warning in the end counts
    rows without certain digits, which are NaN.
    """
    uncertain: list[list[np.ndarray]] = []  # times of each piece, by order
    spread = _spreads(robot, motion, times, order, method, row)
    for start in range(0, len(times), _STATES_PER_PIECE):
        t = times[start : start + _STATES_PER_PIECE]
        states = MotionStates.sample(robot, motion, t, [(row, order)])
        try:
            forces = states.compute(robot, row.name, method)
        except UncertainError as error:
            forces = error.results
            uncertain.append([t[where] for where in error.uncertain])
        if progress is not None:
            progress(start + len(t), len(times))
        yield Along(t, states.rates, forces, spread and spread(t), base=states.base)
    if uncertain:
        by_order = map(np.concatenate, zip(*uncertain, strict=True))
        warn(digits.describe(robot.mechanism, row.names(order), by_order, len(times)))


def force_breaks(
    robot: Engine, motion: Motion, times: np.ndarray, order: int, method: str | None = None, row: Quantity = FORCES
) -> tuple[ForceBreak, ...]:
    """Find the times between the first and the last given time at which the forces up to an order are not smooth."""
    known = [
        (t, tuple(causes))
        for t, causes in groupby(motion.breaks_to(order + row.rates - 1), key=lambda found: found.t)
        if times.min() <= t <= times.max()
    ]
    taken = {"q": row.rates, "base": row.rates, "W": row.wrench_rates}  # how many rates the quantity itself takes
    lowest = [min(cause.order - taken[cause.symbol] + 1 for cause in causes) for _, causes in known]
    t = np.array([t for t, _ in known])
    jumps = np.zeros((order + 1, len(t), _size(robot, row)))
    for start in range(0, len(t), _STATES_PER_PIECE):
        part = slice(start, start + _STATES_PER_PIECE)
        before, after = (
            _compute_certain(robot, MotionStates.sample(robot, motion, t[part], [(row, order)], side), method, row)
            for side in SIDES
        )
        size = np.maximum(np.abs(before), np.abs(after)).max(axis=2, keepdims=True)
        difference = np.subtract(after, before)
        jumps[:, part] = np.where(np.abs(difference) > _FORCE_JUMP_TOLERANCE * size, difference, 0)
    return tuple(
        ForceBreak(time, k, jumps[k, i], causes, tuple(jumps[k + 1 :, i]))
        if k >= 0
        else ForceBreak(time, -1, None, causes)
        for i, (k, (time, causes)) in enumerate(zip(lowest, known, strict=True))
    )


def _compute_certain(robot: Engine, states: MotionStates, method: str | None, row: Quantity) -> Rates:
    """A quantity with its rates, NaN where no digits are certain."""
    try:
        return states.compute(robot, row.name, method)
    except UncertainError as error:
        return error.results


def _size(robot: Engine, row: Quantity) -> int:
    """The number of entries of a quantity for one state: n, or nv of the forces on a robot that floats."""
    [size] = Computation(row.name, 0).shape(robot.mechanism)
    return size


def _spreads(
    robot: Engine, motion: Motion, times: np.ndarray, order: int, method: str | None, row: Quantity
) -> Callable[[np.ndarray], Rates] | None:
    """The standard deviations of the forces over time: computed with each entry of q, W and the base off by its own.

    The rates are assumed independent, which overestimates slightly: the highest rates dominate.
    """
    highest = order + row.rates - 1
    smoothed = [body for body, load in motion.loads.items() if load.deviations(times[:1], 0) is not None]
    on_base = motion.base_curve is not None and motion.base_curve.deviations(times[:1], 0) is not None
    if motion.deviations(times[:1], 0) is None and not smoothed and not on_base:
        return None
    every = np.unique(times)
    entries = motion.curve.columns + 7 * on_base + 6 * len(smoothed)
    count = max(2, _MAX_PERTURBED_STATES // (entries * (highest + 1)))
    t = every[np.unique(np.linspace(0, len(every) - 1, min(count, len(every))).astype(int))]
    total = np.zeros((order + 1, len(t), _size(robot, row)))
    for start in range(0, len(t), _STATES_PER_PIECE):
        part = t[start : start + _STATES_PER_PIECE]
        states = MotionStates.sample(robot, motion, part, [(row, order)])
        true = np.array(_compute_certain(robot, states, method, row))
        for moved in _perturbed(motion, part, states):
            if moved.near is not None:
                near = closing.close_loops(robot.mechanism, moved.rates[0], moved.near, closing_step(robot))
                moved = replace(moved, near=near)
            found = np.array(_compute_certain(robot, moved, method, row))
            total[:, start : start + _STATES_PER_PIECE] += (found - true) ** 2
    certain = np.isfinite(total).all(axis=(0, 2))
    t, known = (t[certain], np.sqrt(total[:, certain])) if certain.any() else (t, np.sqrt(total))

    def interpolate(times: np.ndarray) -> Rates:
        return tuple(np.stack([np.interp(times, t, column) for column in rate.T], axis=1) for rate in known)

    return interpolate


def _perturbed(motion: Motion, t: np.ndarray, states: MotionStates) -> Iterator[MotionStates]:
    """States at times with each entry of q, W and the base off by its standard deviation, one by one."""
    highest, W = len(states.rates) - 1, states.wrench or ()
    for q in perturbed(motion.curve, t, highest, partial(states_of, motion.several)):
        yield replace(states, rates=q)
    for k, by_body in enumerate(motion.wrench_deviations(t, len(W) - 1) if W else ()):
        for body, off in by_body.items():
            for j in np.flatnonzero(off.any(axis=0)).tolist():
                moved = {**W[k], body: W[k][body] + off * (np.arange(6) == j)}
                yield replace(states, wrench=(*W[:k], moved, *W[k + 1 :]))
    for base in perturbed(motion.base_curve, t, highest, motion_of) if motion.base_curve else ():
        yield replace(states, base=base)


def _join(parts: list[Rates]) -> Rates:
    return tuple(np.concatenate(terms) for terms in zip(*parts, strict=True))
