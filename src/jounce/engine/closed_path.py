"""Continue the positions of closed robots along a motion, or the rows of a log, on one branch.

Problem: all coordinates q(t) that close the loops, given the independent ones over time, on the branch of the start.

Algorithm: numerical continuation in time [1]. Newton's method (`dynamics.loop_closure`) closes the loops at the next
times from the last position. Neighbours belong together if velocities and accelerations of the dependent coordinates
explain how far these move, by the trapezoidal rule with its end correction, and no singular configuration lies between:
no determinant of the constraints changes its sign. If not, the interval is halved.

Invariant: states that are kept agree with their predecessors. Failure: a branch that jumps does so at any distance, so
that an interval halved several times without agreement raises `JounceError`, with the time; so does one at whose end
loops cannot be closed.

`continue_positions` is the door for times of a motion, `continue_rows` for rows of a log that state all coordinates.

[1] E. L. Allgower, K. Georg, Introduction to Numerical Continuation Methods, 2003.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

import numpy as np

from jounce.core.errors import JounceError, UncertainError, join_names, locate_errors
from jounce.dynamics import loop_assembly, loop_closure
from jounce.dynamics.computation import Computation
from jounce.dynamics.loop_assembly import (
    MIN_INVERSE_CONDITION,
    compute_inverse_conditions,
    crosses_singularity,
    inverse_conditions,
    solved_constraints,
)
from jounce.dynamics.loop_branches import scales
from jounce.dynamics.loops import closure_of
from jounce.engine import generic_methods
from jounce.engine.backends import closing_step
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


@dataclass(frozen=True, eq=False)
class States:
    """Times (K,), all coordinates q (K, N) of the tree then, and two rates (2, K, N) of them after and before."""

    t: np.ndarray
    q: np.ndarray
    after: np.ndarray
    before: np.ndarray

    def select(self, which: slice) -> "States":
        """Some of them."""
        return States(self.t[which], self.q[which], self.after[:, which], self.before[:, which])


@lru_cache(maxsize=8)
def _continue_path(
    m: Mechanism,
    curve: Curve,
    columns: tuple[int, ...],
    count: int,
    branch: tuple[tuple[str, float], ...],
    step: loop_assembly.NewtonStep | None,
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


_MAX_STATES_AT_ONCE = 1000  # times continued from one position together
_MAX_BRANCH_HALVINGS = 8  # of an interval whose ends do not agree, before they count as a jump
_MAX_CLOSING_HALVINGS = 4  # of an interval at whose end loops cannot be closed, before that counts as their limit
_MAX_UNEXPLAINED_WAY_SHARE = 0.5  # of the way between neighbours: what their rates may leave unexplained
_MIN_EXPLAINED_WAY = 1e-10  # rad or sizes of the robot: shorter ways are rounding
_SINGULAR_CURE = "expected a motion that keeps away from singular configurations"
_COORDINATE_RATES = Computation("coordinates", 2)


def join_states(parts: Sequence[States]) -> States:
    """States that follow each other."""
    t, q = (np.concatenate([getattr(part, name) for part in parts]) for name in ("t", "q"))
    return States(t, q, *(np.concatenate([getattr(part, x) for part in parts], axis=1) for x in ("after", "before")))


@dataclass(frozen=True, eq=False)
class ClosedCurve:
    """A closed robot on a curve of its independent coordinates."""

    m: Mechanism
    curve: Curve
    step: loop_assembly.NewtonStep | None  # that closes the loops, by default in NumPy

    @property
    def own(self) -> list[int]:
        """The places of the independent coordinates."""
        return list(closure_of(self.m).independent)

    @property
    def dependent(self) -> list[int]:
        """The places of the dependent coordinates."""
        return list(closure_of(self.m).dependent)

    def states(self, t: np.ndarray, near: np.ndarray) -> States:
        """The states at times, continued from positions (N,) nearby."""
        order = 2 if self.curve.highest is None else min(2, self.curve.highest)
        rates = self.curve.rates(t, order)
        q = loop_closure.close_loops(self.m, rates[0], near, self.step)
        after = self.rates_of(q, rates)
        before, breaks = after.copy(), np.flatnonzero(np.isin(t, [jump.t for jump in self.curve.jumps(order)]))
        if breaks.size:
            left = self.curve.rates(t[breaks], order, True)
            before[:, breaks] = self.rates_of(loop_closure.close_loops(self.m, left[0], q[breaks], self.step), left)
            before[:, breaks[(left[0] != rates[0][breaks]).any(axis=1)]] = np.nan  # where q jumps, nothing is continued
        return States(t, q, after, before)

    def rates_of(self, q: np.ndarray, rates: Sequence[np.ndarray]) -> np.ndarray:
        """The velocities and accelerations (2, K, N) of all coordinates; unknown ones count as 0."""
        known = [*rates, *[0 * rates[0]] * (_COORDINATE_RATES.rates - len(rates))]
        return np.stack(
            generic_methods.compute_by_method(_COORDINATE_RATES, "recursion", self.m, [*known, q[:, self.dependent]])[
                1:
            ]
        )

    def find_agreeing(self, s: States) -> np.ndarray:
        """Which neighbours, (K - 1,), are on one branch, by their rates, or are apart because q itself jumps."""
        sizes = scales(self.m).coordinates[self.dependent]
        x, h = s.q[:, self.dependent] / sizes, np.diff(s.t)[:, None]
        (v, a), (w, b) = (rates[..., self.dependent] / sizes for rates in (s.after[:, :-1], s.before[:, 1:]))
        in_way = np.abs(np.diff(x, axis=0) - h / 2 * (v + w) + h**2 / 12 * (b - a))
        in_velocity = np.abs(w - v - h / 2 * (a + b))
        way = h * np.maximum(np.abs(v), np.abs(w)).max(axis=1, keepdims=True)
        explained = (in_way + h * in_velocity <= _MAX_UNEXPLAINED_WAY_SHARE * way + _MIN_EXPLAINED_WAY).all(axis=1)
        return np.asarray(explained & ~self.crossing(s) | np.isnan(s.before[0, 1:]).any(axis=1))

    def crossing(self, s: States) -> np.ndarray:
        """Which neighbours, (K - 1,), have a singular configuration between them: a determinant changes its sign.

        Or the later one is singular itself.
        """
        A = solved_constraints(self.m, s.q)
        return np.asarray(
            (compute_inverse_conditions(A[1:]) < MIN_INVERSE_CONDITION) | crosses_singularity(A[:-1], A[1:])
        )

    def path(self, t: np.ndarray, start: np.ndarray) -> States:
        """States on one branch at times (K,), and between them where neighbours do not agree at once."""
        reach, longest = (
            loop_closure.FIRST_CONTINUATION_STEP * scales(self.m).coordinates[self.own],
            np.diff(t).max(),
        )
        done, todo, size = [self.states(t[:1], start)], t[1:], _MAX_STATES_AT_ONCE
        while todo.size:
            # As many times together as lie within the first step that Newton's method is trusted with.
            last = done[-1].select(slice(-1, None))
            far = np.abs(self.curve.rates(todo[:size], 0)[0] - last.q[:, self.own]) > reach
            part = todo[: max(1, *np.flatnonzero(far.any(axis=1))[:1])] if far.any() else todo[:size]
            try:
                found: States | None = self.states(part, last.q[0])
            except JounceError:
                found = None
            # Keep the states up to the first that does not agree with its predecessor.
            agrees = np.zeros(1, dtype=bool) if found is None else self.find_agreeing(join_states([last, found]))
            count = len(agrees) if agrees.all() else int(agrees.argmin())
            if found is not None and count:
                done.append(found.select(slice(0, count)))
                todo = todo[count:]
            elif len(part) == 1:  # the next one alone does not agree: look halfway, or give up
                if part[0] - last.t[0] < longest / 2 ** (_MAX_BRANCH_HALVINGS if found else _MAX_CLOSING_HALVINGS):
                    raise self.error(last, float(part[0]), found)
                todo = np.insert(todo, 0, (last.t[0] + part[0]) / 2)
            size = min(_MAX_STATES_AT_ONCE, 2 * len(part)) if count == len(part) else 1
        return join_states(done)

    def error(self, last: States, t: float, found: States | None) -> JounceError:
        """The error where a branch ends between two times, or jumps."""
        s = last if found is None else join_states([last, found])
        if found is None or self.crossing(s).any():
            return constraint_error(self.m, t, s.q, found is None)
        others, own = (join_names(self.m.tree.coordinates[j] for j in places) for places in (self.dependent, self.own))
        inverse = inverse_conditions(self.m, s.q).min()
        return JounceError(
            f"{self.m.name!r}: the branch jumps along the motion at t = {t:.9g} s, where 1/cond is {inverse:.2g}: rates"
            f" of {others} jump, and those of {own} do not; {_SINGULAR_CURE}"
        )


def constraint_error(m: Mechanism, t: float, q: np.ndarray, stuck: bool) -> JounceError:
    """The error where constraints are lost along a motion, near positions (K, N), and loops stay open or not."""
    inverse = inverse_conditions(m, q).min()
    beyond = ", and the loops cannot be closed beyond" if stuck else ""
    return JounceError(
        f"{m.name!r}: constraints are lost along the motion at t = {t:.9g} s, where 1/cond is {inverse:.2g}{beyond};"
        f" {_SINGULAR_CURE}"
    )
