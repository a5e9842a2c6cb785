"""Positions of closed robots at times of a motion, and at rows of a log, all on one branch."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from typing import Any, Literal

import numpy as np

from jounce.core.errors import JounceError, UncertainError, locate_errors
from jounce.dynamics import loop_closure, loop_newton
from jounce.dynamics.loop_branches import scales
from jounce.dynamics.loops import closure_of
from jounce.engine.backends import closing_step
from jounce.engine.continuation import ClosedCurve, States, constraint_error
from jounce.engine.engine import Engine
from jounce.model.loops import all_coordinates
from jounce.model.mechanism import Mechanism
from jounce.motion.curves import ArrangedCurve, Curve
from jounce.motion.hermite import HermiteCurve
from jounce.motion.joint_matching import unwrap_curve
from jounce.motion.motion import DEFAULT_TIME_STEP, Motion

_MIN_PATH_INTERVALS = 512  # even intervals of any motion, at whose ends positions are known
_MAX_PATH_INTERVALS = 2**20  # of long logs, which bounds time and memory
_SAMPLES_PER_PATH_INTERVAL = 8  # of a motion, which rarely moves far between
_BRANCH_TOLERANCE = 1e-6  # rad or sizes of the robot: positions no further apart are of one branch


def continue_positions(
    robot: Engine, motion: Motion, t: np.ndarray, side: Literal["right", "left"] = "right"
) -> np.ndarray | None:
    """All coordinates (K, N) of the tree of a closed robot at times of a motion; None for robots without loops.

    Raises
    ------
    JounceError : where loops cannot be closed along the motion, or the branch jumps, with the time.
    """
    m = robot.mechanism
    if not m.takes_dependent:
        return loop_closure.close_loops(m, motion(t, 0, side)[0]) if m.closure else None
    curve, inner, order = unwrap_curve(motion.curve, t)
    samples = (curve.stop - curve.start) / DEFAULT_TIME_STEP if motion.grid is None else len(motion.grid)
    count = max(_MIN_PATH_INTERVALS, min(_MAX_PATH_INTERVALS, int(samples / _SAMPLES_PER_PATH_INTERVAL)))
    fixed: Any = curve  # curves are immutable, hence keys
    step = closing_step(robot)
    path = _continue_path(m, fixed, order, count, tuple(motion.branch.items()), step)
    near = path.q[(np.searchsorted(path.t, inner, side="right") - 1).clip(0)]
    u = motion(t, 0, side)[0]
    try:
        return loop_closure.close_loops(m, u, near, step)
    except JounceError:
        first, last = 0, len(t)
        while last - first > 1:  # which of the times it is
            middle = (first + last) // 2
            try:
                loop_closure.close_loops(m, u[first:middle], near[first:middle], step)
                first = middle
            except JounceError:
                last = middle
        raise constraint_error(m, t[first], near[first:last], stuck=True) from None


@contextmanager
def name_errors_by_time(t: np.ndarray) -> Iterator[None]:
    """Within this context, errors of results without certain digits begin with the first of the times (N,)."""
    try:
        yield
    except UncertainError as error:
        first = np.logical_or.reduce(error.uncertain).argmax()
        raise JounceError(f"along the motion at t = {t.flat[first]:.6g} s: {error}") from None


def with_tree_positions(rates: tuple[np.ndarray, ...], q: np.ndarray | None) -> tuple[np.ndarray, ...]:
    """Rates of coordinates with all those of the tree first, as a closed robot takes them, if there are any."""
    return rates if q is None else (q, *rates[1:])


def continue_rows(robot: Engine, t: np.ndarray, rates: Sequence[np.ndarray], q: np.ndarray) -> np.ndarray:
    """All coordinates (K, N) at rows that state those (K, N) and rates of the independent ones, with loops closed.

    Raises
    ------
    JounceError : where the branch jumps between neighbouring rows, with the time.
    """
    m, step = robot.mechanism, closing_step(robot)
    q = loop_closure.close_loops(m, rates[0], q, step)
    closed = ClosedCurve(m, HermiteCurve(t, tuple(rates)), step)
    both = closed.rates_of(q, rates)
    for i in np.flatnonzero(~closed.find_agreeing(States(t, q, both, both))):
        off = np.abs((closed.path(t[i : i + 2], q[i]).q[-1] - q[i + 1]) / scales(m).coordinates)
        if off.max() > _BRANCH_TOLERANCE:
            joint = closure_of(m).coordinates[int(off.argmax())]
            raise JounceError(
                f"{m.name!r}: the branch jumps between the rows at t = {t[i]:.9g} and {t[i + 1]:.9g} s: joint"
                f" {joint!r} comes from {q[i, off.argmax()]:.4g} to {q[i + 1, off.argmax()]:.4g}, where its velocity"
                " leads elsewhere; expected rows of one branch"
            )
    return q


@lru_cache(maxsize=8)
def _continue_path(
    m: Mechanism,
    curve: Curve,
    columns: tuple[int, ...],
    count: int,
    branch: tuple[tuple[str, float], ...],
    step: loop_newton.NewtonStep | None,
) -> States:
    """States along some columns of a curve, so close together that positions between are near those before them."""
    c, curve = closure_of(m), ArrangedCurve(curve, np.array(columns))
    jumps = [jump.t for jump in curve.jumps(2) if curve.start < jump.t < curve.stop]
    t = np.unique([*np.linspace(curve.start, curve.stop, count + 1), *jumps])
    u, given = curve.rates(t[:1], 0)[0], dict(branch)
    whole = np.array([given.get(name, x) for name, x in zip(c.coordinates, c.start, strict=True)])
    with locate_errors(f"at t = {t[0]:.6g} s, the start of the motion"):
        q = loop_closure.close_loops(
            m, u, all_coordinates(c, u, whole[None, list(c.dependent)]) if branch else None, step
        )
    return ClosedCurve(m, curve, step).path(t, q[0])
