"""Continue the positions of closed robots along a motion on one branch.

Problem: all coordinates q(t) that close the loops, given the independent ones over time, on the branch of the start:
of the several ways in which the loops close, the one that the start is in.

Algorithm: numerical continuation in time [1]. Newton's method (`dynamics.loop_closure`) closes the loops at the next
times from the last position. Neighbours agree, and so are on one branch, if velocities and accelerations of the
dependent coordinates explain how far these move, by the trapezoidal rule with its end correction, and no singular
position lies between: the determinant of the constraints keeps its sign. If they do not agree, the interval is halved.

Invariant: states that are kept agree with their predecessors. Failure: where a branch jumps, it does so over intervals
of any length. So an interval that is halved several times without agreement raises `JounceError`, with the time, and so
does one at whose end the loops cannot be closed.

`continue_positions` is the door for times of a motion, `continue_rows` for rows of a log that state all coordinates.
Both rest on `ClosedCurve.path`. Two helpers serve callers that go on from its positions: `with_tree_positions` and
`name_errors_by_time`.

How often what runs: a path is continued once per motion (`_continue_path`, cached by robot and curve), at even times
close together. Each call then closes the loops at its own times, from the last position of the path before them.

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

_MIN_PATH_INTERVALS = 512  # of even length, for any motion: positions are known at their ends
_MAX_PATH_INTERVALS = 2**20  # of long logs, to bound time and memory
_SAMPLES_PER_PATH_INTERVAL = 8  # of a motion: it rarely moves far within as many
_BRANCH_TOLERANCE = 1e-6  # rad or sizes of the robot: positions no farther apart are on one branch


def continue_positions(
    robot: Engine, motion: Motion, t: np.ndarray, side: Literal["right", "left"] = "right"
) -> np.ndarray | None:
    """Return all coordinates (K, N) at times of a motion.

    They are None for robots whose coordinates are all independent.

    Raises
    ------
    JounceError : where loops cannot be closed along the motion, or the branch jumps, with the time.
    """
    m = robot.mechanism
    # Without loops, dependent coordinates follow at fixed ratios: there is one branch, and nothing to continue.
    if not m.takes_dependent:
        return None if m.closure is None else loop_closure.close_loops(m, motion(t, 0, side)[0])
    # Motions that are retimed or rearranged share the path of the curve inside them, at times and columns of its own.
    curve, curve_times, order = unwrap_curve(motion.curve, t)
    # Intervals are short enough that Newton's method closes the loops within them from their starts.
    samples = (curve.stop - curve.start) / DEFAULT_TIME_STEP if motion.grid is None else len(motion.grid)
    intervals = max(_MIN_PATH_INTERVALS, min(_MAX_PATH_INTERVALS, int(samples / _SAMPLES_PER_PATH_INTERVAL)))
    # Curves are immutable, hence keys of the cache of paths: Any tells type checkers that they have a hash.
    hashable_curve: Any = curve
    step = closing_step(robot)
    path = _continue_path(m, hashable_curve, order, intervals, tuple(motion.branch.items()), step)
    # Each time starts from the position of the path at or before it.
    near = path.q[(np.searchsorted(path.t, curve_times, side="right") - 1).clip(0)]
    u = motion(t, 0, side)[0]
    try:
        return loop_closure.close_loops(m, u, near, step)
    except JounceError:
        # Bisection finds the first time at which the loops cannot be closed, which the error names: it is within
        # t[first:last], and those before `first` close.
        first, last = 0, len(t)
        while last - first > 1:
            middle = (first + last) // 2
            try:
                loop_closure.close_loops(m, u[first:middle], near[first:middle], step)
                first = middle
            except JounceError:
                last = middle
        raise constraint_error(m, t[first], near[first:last], stuck=True) from None


@contextmanager
def name_errors_by_time(t: np.ndarray) -> Iterator[None]:
    """Name the time in errors of results whose digits are uncertain.

    `t` are the times of the results.
    """
    try:
        yield
    except UncertainError as error:
        # The error states where each rate is uncertain: the first such time of any of them counts.
        first = np.logical_or.reduce(error.uncertain).argmax()
        raise JounceError(f"along the motion at t = {t.flat[first]:.6g} s: {error}") from None


def with_tree_positions(rates: tuple[np.ndarray, ...], q: np.ndarray | None) -> tuple[np.ndarray, ...]:
    """Return rates with all coordinates of the tree in place of q.

    A closed robot takes rates in this form; q is None for robots that are not closed.
    """
    return rates if q is None else (q, *rates[1:])


def continue_rows(robot: Engine, t: np.ndarray, rates: Sequence[np.ndarray], q: np.ndarray) -> np.ndarray:
    """Return all coordinates (K, N) at rows, with loops closed.

    `q` are all coordinates as the rows of a log state them; `rates` are the independent ones with their rates.

    Raises
    ------
    JounceError : where the branch jumps between neighbouring rows, with the time.
    """
    m, step = robot.mechanism, closing_step(robot)
    q = loop_closure.close_loops(m, rates[0], q, step)
    # Between two rows, the curve of least degree that has the rates of both stands for the motion.
    closed_curve = ClosedCurve(m, HermiteCurve(t, tuple(rates)), step)
    tree_rates = closed_curve.rates_of(q, rates)
    # Neighbours that do not agree at once may only be far apart in time: a path from one shows whether it leads to the
    # other.
    for i in np.flatnonzero(~closed_curve.find_agreeing(States(t, q, tree_rates, tree_rates))):
        distances = np.abs((closed_curve.path(t[i : i + 2], q[i]).q[-1] - q[i + 1]) / scales(m).coordinates)
        if distances.max() > _BRANCH_TOLERANCE:
            worst = int(distances.argmax())
            joint = closure_of(m).coordinates[worst]
            raise JounceError(
                f"{m.name!r}: the branch jumps between the rows at t = {t[i]:.9g} and {t[i + 1]:.9g} s: joint"
                f" {joint!r} comes from {q[i, worst]:.4g} to {q[i + 1, worst]:.4g}, where its velocity"
                " leads elsewhere; expected rows of one branch"
            )
    return q


@dataclass(frozen=True, eq=False)
class States:
    """Times, positions and rates of a closed robot.

    Times are (K,), all coordinates q (K, N). `after` and `before` are velocities and accelerations (2, K, N) just after
    and just before each time: they differ where a rate of the motion jumps.
    """

    t: np.ndarray
    q: np.ndarray
    after: np.ndarray
    before: np.ndarray

    def select(self, part: slice) -> "States":
        """Return the states of a part of the times."""
        return States(self.t[part], self.q[part], self.after[:, part], self.before[:, part])


@lru_cache(maxsize=8)
def _continue_path(
    m: Mechanism,
    curve: Curve,
    columns: tuple[int, ...],
    count: int,
    branch: tuple[tuple[str, float], ...],
    step: loop_assembly.NewtonStep | None,
) -> States:
    """Return states along some columns of a curve, `count` intervals or more.

    They are so close together that Newton's method closes loops between them from the state before. `branch` are
    positions of joints, by name, at the start of the motion.
    """
    c, curve = closure_of(m), ArrangedCurve(curve, np.array(columns))
    # Rates jump at ends of intervals only, where states have them on both sides.
    jumps = [jump.t for jump in curve.jumps(2) if curve.start < jump.t < curve.stop]
    t = np.unique([*np.linspace(curve.start, curve.stop, count + 1), *jumps])
    # The start determines the branch. Where the motion states positions, loops are closed near these, and near those of
    # the robot for joints that it does not name. Where it states none, they are continued from the start of the robot.
    u, stated = curve.rates(t[:1], 0)[0], dict(branch)
    near = None
    if len(stated) > 0:
        stated_start = np.array([stated.get(name, x) for name, x in zip(c.coordinates, c.start, strict=True)])
        near = all_coordinates(c, u, stated_start[None, list(c.dependent)])
    with locate_errors(f"at t = {t[0]:.6g} s, the start of the motion"):
        q = loop_closure.close_loops(m, u, near, step)
    return ClosedCurve(m, curve, step).path(t, q[0])


# Continuation along one curve: what decides whether neighbours agree, and how often an interval is halved.
_MAX_STATES_AT_ONCE = 1000  # times continued from one position together
_MAX_BRANCH_HALVINGS = 8  # of an interval whose ends do not agree, before that counts as a jump
_MAX_CLOSING_HALVINGS = 4  # of an interval at whose end loops do not close, before that counts as the end of a branch
_MAX_UNEXPLAINED_WAY_SHARE = 0.5  # of the way between neighbours: what their rates may leave unexplained
_MIN_EXPLAINED_WAY = 1e-10  # rad or sizes of the robot: shorter ways are rounding
_SINGULAR_CURE = "expected a motion that keeps away from singular configurations"
_COORDINATE_RATES = Computation("coordinates", 2)


def join_states(parts: Sequence[States]) -> States:
    """Join states that follow each other."""
    t, q = (np.concatenate([getattr(part, name) for part in parts]) for name in ("t", "q"))
    return States(t, q, *(np.concatenate([getattr(part, x) for part in parts], axis=1) for x in ("after", "before")))


@dataclass(frozen=True, eq=False)
class ClosedCurve:
    """A closed robot on a curve of its independent coordinates."""

    m: Mechanism
    curve: Curve
    step: loop_assembly.NewtonStep | None  # closes the loops; None for the one in NumPy

    @property
    def own(self) -> list[int]:
        """The places of the independent coordinates."""
        return list(closure_of(self.m).independent)

    @property
    def dependent(self) -> list[int]:
        """The places of the dependent coordinates."""
        return list(closure_of(self.m).dependent)

    def states(self, t: np.ndarray, near: np.ndarray) -> States:
        """Return the states at times, closed from one position (N,) nearby."""
        # A curve may have no acceleration, such as one through samples without rates.
        order = 2 if self.curve.highest is None else min(2, self.curve.highest)
        rates = self.curve.rates(t, order)
        q = loop_closure.close_loops(self.m, rates[0], near, self.step)
        after = self.rates_of(q, rates)
        before, breaks = after.copy(), np.flatnonzero(np.isin(t, [jump.t for jump in self.curve.jumps(order)]))
        # Rates before a time differ from those after it at breaks only. True asks the curve for these, from the left.
        if breaks.size > 0:
            rates_before = self.curve.rates(t[breaks], order, True)
            q_before = loop_closure.close_loops(self.m, rates_before[0], q[breaks], self.step)
            before[:, breaks] = self.rates_of(q_before, rates_before)
            # Where independent coordinates themselves jump, nothing is continued, and NaN marks the state.
            before[:, breaks[(rates_before[0] != rates[0][breaks]).any(axis=1)]] = np.nan
        return States(t, q, after, before)

    def rates_of(self, q: np.ndarray, rates: Sequence[np.ndarray]) -> np.ndarray:
        """Return the velocities and accelerations (2, K, N) of all coordinates.

        Rates that the curve does not have count as 0.
        """
        padded = [*rates, *[0 * rates[0]] * (_COORDINATE_RATES.rates - len(rates))]
        arrays = [*padded, q[:, self.dependent]]
        return np.stack(generic_methods.compute_by_method(_COORDINATE_RATES, "recursion", self.m, arrays)[1:])

    def find_agreeing(self, states: States) -> np.ndarray:
        """Return which neighbours, (K - 1,), agree: they are on one branch.

        So do neighbours between which the independent coordinates jump, where nothing is continued.
        """
        # Dependent coordinates x, their velocities v, w and accelerations a, b at the first and the second end of
        # intervals h, without units.
        sizes = scales(self.m).coordinates[self.dependent]
        x, h = states.q[:, self.dependent] / sizes, np.diff(states.t)[:, None]
        (v, a), (w, b) = (rates[..., self.dependent] / sizes for rates in (states.after[:, :-1], states.before[:, 1:]))
        # The trapezoidal rule with its end correction, h/2 (v + w) + h^2/12 (a - b), leaves a part of the way
        # unexplained, and the one without it, h/2 (a + b), a part of the change of velocity.
        in_way = np.abs(np.diff(x, axis=0) - h / 2 * (v + w) + h**2 / 12 * (b - a))
        in_velocity = np.abs(w - v - h / 2 * (a + b))
        # Half of the way at the largest velocity may stay unexplained: other branches are farther away.
        way = h * np.maximum(np.abs(v), np.abs(w)).max(axis=1, keepdims=True)
        explained = (in_way + h * in_velocity <= _MAX_UNEXPLAINED_WAY_SHARE * way + _MIN_EXPLAINED_WAY).all(axis=1)
        return np.asarray(explained & ~self.crossing(states) | np.isnan(states.before[0, 1:]).any(axis=1))

    def crossing(self, states: States) -> np.ndarray:
        """Return which neighbours, (K - 1,), have a singular position between them.

        The determinant of the constraints changes its sign there, or the later neighbour is singular itself.
        """
        A = solved_constraints(self.m, states.q)
        return np.asarray(
            (compute_inverse_conditions(A[1:]) < MIN_INVERSE_CONDITION) | crosses_singularity(A[:-1], A[1:])
        )

    def path(self, t: np.ndarray, start: np.ndarray) -> States:
        """Return states on one branch, at times (K,) and between.

        They continue from a start (N,). States between the times are added where neighbours do not agree at once.
        """
        reach = loop_closure.FIRST_CONTINUATION_STEP * scales(self.m).coordinates[self.own]
        longest_interval = np.diff(t).max()
        kept_parts, times_left, most_times = [self.states(t[:1], start)], t[1:], _MAX_STATES_AT_ONCE
        while times_left.size > 0:
            # Close loops together at the next times that lie within one step of continuation from the last state.
            last = kept_parts[-1].select(slice(-1, None))
            is_far = (np.abs(self.curve.rates(times_left[:most_times], 0)[0] - last.q[:, self.own]) > reach).any(axis=1)
            next_times = times_left[: max(1, int(is_far.argmax()))] if is_far.any() else times_left[:most_times]
            try:
                states: States | None = self.states(next_times, last.q[0])
            except JounceError:
                states = None
            # Keep the states up to the first that does not agree with its predecessor.
            agrees = np.zeros(1, dtype=bool) if states is None else self.find_agreeing(join_states([last, states]))
            count = len(agrees) if agrees.all() else int(agrees.argmin())
            if states is not None and count > 0:
                kept_parts.append(states.select(slice(0, count)))
                times_left = times_left[count:]
            # If the next state does not agree though it is alone, look halfway first. Give up if the interval is a
            # small share of the longest one: it has been halved too often.
            elif len(next_times) == 1:
                halvings = _MAX_CLOSING_HALVINGS if states is None else _MAX_BRANCH_HALVINGS
                if next_times[0] - last.t[0] < longest_interval / 2**halvings:
                    raise self.error(last, float(next_times[0]), states)
                times_left = np.insert(times_left, 0, (last.t[0] + next_times[0]) / 2)
            # Try twice as many together after success, one alone after failure.
            most_times = min(_MAX_STATES_AT_ONCE, 2 * len(next_times)) if count == len(next_times) else 1
        return join_states(kept_parts)

    def error(self, last: States, t: float, following: States | None) -> JounceError:
        """Return the error where a branch ends or jumps after a state.

        `following` is the state at t, None where loops cannot be closed there.
        """
        states = last if following is None else join_states([last, following])
        if following is None or self.crossing(states).any():
            return constraint_error(self.m, t, states.q, following is None)
        dependent_names, own_names = (
            join_names(self.m.tree.coordinates[j] for j in places) for places in (self.dependent, self.own)
        )
        inverse = inverse_conditions(self.m, states.q).min()
        return JounceError(
            f"{self.m.name!r}: the branch jumps along the motion at t = {t:.9g} s, where 1/cond is {inverse:.2g}: rates"
            f" of {dependent_names} jump, and those of {own_names} do not; {_SINGULAR_CURE}"
        )


def constraint_error(m: Mechanism, t: float, q: np.ndarray, stuck: bool) -> JounceError:
    """Return the error where constraints are lost along a motion.

    `q` are positions (K, N) near it. If `stuck`, loops stay open from there on.
    """
    inverse = inverse_conditions(m, q).min()
    failure = ", and the loops cannot be closed beyond" if stuck else ""
    return JounceError(
        f"{m.name!r}: constraints are lost along the motion at t = {t:.9g} s, where 1/cond is {inverse:.2g}{failure};"
        f" {_SINGULAR_CURE}"
    )
