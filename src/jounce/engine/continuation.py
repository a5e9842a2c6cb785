"""Positions of closed robots along a motion, continued from its start: the branch in which loops close stays the same.

Problem: all coordinates q(t) that close the loops, given the independent ones over time, on the branch of the start.

Algorithm: numerical continuation in time [1]. Newton's method (`dynamics.loop_closure`) closes the loops at the next
times from the last position. Neighbours belong together if velocities and accelerations of the dependent coordinates
explain how far these move, by the trapezoidal rule with its end correction, and no singular configuration lies between:
no determinant of the constraints changes its sign. If not, the interval is halved.

Invariant: states that are kept agree with their predecessors. Failure: a branch that jumps does so at any distance, so
that an interval halved several times without agreement raises `JounceError`, with the time; so does one at whose end
loops cannot be closed.

[1] E. L. Allgower, K. Georg, Introduction to Numerical Continuation Methods, 2003.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jounce.core.errors import JounceError, join_names
from jounce.dynamics import loop_closure, loop_newton
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
from jounce.engine.generic_methods import compute_by_method
from jounce.model.mechanism import Mechanism
from jounce.motion.curves import Curve

_MAX_STATES_AT_ONCE = 1000  # times continued from one position together
_MAX_BRANCH_HALVINGS = 8  # of an interval whose ends do not agree, before they count as a jump
_MAX_CLOSING_HALVINGS = 4  # of an interval at whose end loops cannot be closed, before that counts as their limit
_MAX_UNEXPLAINED_WAY_SHARE = 0.5  # of the way between neighbours: what their rates may leave unexplained
_MIN_EXPLAINED_WAY = 1e-10  # rad or sizes of the robot: shorter ways are rounding
_SINGULAR_CURE = "expected a motion that keeps away from singular configurations"
_COORDINATE_RATES = Computation("coordinates", 2)


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


def join_states(parts: Sequence[States]) -> States:
    """States that follow each other."""
    t, q = (np.concatenate([getattr(part, name) for part in parts]) for name in ("t", "q"))
    return States(t, q, *(np.concatenate([getattr(part, x) for part in parts], axis=1) for x in ("after", "before")))


@dataclass(frozen=True, eq=False)
class ClosedCurve:
    """A closed robot on a curve of its independent coordinates."""

    m: Mechanism
    curve: Curve
    step: loop_newton.NewtonStep | None  # that closes the loops, by default in NumPy

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
        return np.stack(compute_by_method(_COORDINATE_RATES, "recursion", self.m, [*known, q[:, self.dependent]])[1:])

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
