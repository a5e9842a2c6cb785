"""Positions of closed robots along a motion, continued from its start: the branch in which loops close stays the same.

Neighbouring positions belong together if velocities and accelerations of the dependent coordinates explain how far
these move, and no singular configuration lies between; if not, times between are looked at. A branch that jumps does so
at any distance.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

import numpy as np

from jounce.core.errors import JounceError, UncertainError, at, listed
from jounce.dynamics import closing, newton
from jounce.dynamics.assembly import LOST, crossing, inverse_conditions, inverse_conditions_of, solved_constraints
from jounce.dynamics.computation import Computation
from jounce.dynamics.loops import closure_of
from jounce.engine.backends import closing_step
from jounce.engine.engine import Engine
from jounce.engine.generic import compute_by_method
from jounce.model.loops import all_coordinates
from jounce.model.mechanism import Mechanism
from jounce.motion.curves import Arranged, Curve
from jounce.motion.hermite import Hermite
from jounce.motion.matching import unwrapped
from jounce.motion.motion import DEFAULT_TIME_STEP, Motion

FEWEST, MOST = 512, 2**20  # even intervals of a motion, at whose ends it is looked at
STRIDE = 8  # samples of a motion in such an interval
BLOCK = 1000  # times that are looked at together
HALVINGS = 8  # of an interval whose ends do not agree, before they count as a jump
FAILURES = 4  # of these, where loops cannot be closed at all
AGREEMENT = 0.5  # of the way between neighbours: what their rates may leave unexplained
FLOOR = 1e-10  # rad or sizes of the robot: shorter ways need no explanation
SAME = 1e-6  # rad or sizes of the robot: positions no further apart are of one branch
CURE = "expected a motion that keeps away from singular configurations"
COORDINATES = Computation("coordinates", 2)


@dataclass(frozen=True, eq=False)
class States:
    """Times (K,), all coordinates q (K, N) of the tree then, and two rates (2, K, N) of them after and before."""

    t: np.ndarray
    q: np.ndarray
    after: np.ndarray
    before: np.ndarray

    def taken(self, which: slice) -> "States":
        """Some of them."""
        return States(self.t[which], self.q[which], self.after[:, which], self.before[:, which])


def joined(parts: Sequence[States]) -> States:
    """States that follow each other."""
    t, q = (np.concatenate([getattr(part, name) for part in parts]) for name in ("t", "q"))
    return States(t, q, *(np.concatenate([getattr(part, x) for part in parts], axis=1) for x in ("after", "before")))


@dataclass(frozen=True, eq=False)
class ClosedCurve:
    """A closed robot on a curve of its independent coordinates."""

    m: Mechanism
    curve: Curve
    step: newton.Step | None  # that closes the loops, by default in NumPy

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
        q = closing.close_loops(self.m, rates[0], near, self.step)
        after = self.rates_of(q, rates)
        before, breaks = after.copy(), np.flatnonzero(np.isin(t, [jump.t for jump in self.curve.jumps(order)]))
        if breaks.size:
            left = self.curve.rates(t[breaks], order, True)
            before[:, breaks] = self.rates_of(closing.close_loops(self.m, left[0], q[breaks], self.step), left)
            before[:, breaks[(left[0] != rates[0][breaks]).any(axis=1)]] = np.nan  # where q jumps, nothing is continued
        return States(t, q, after, before)

    def rates_of(self, q: np.ndarray, rates: Sequence[np.ndarray]) -> np.ndarray:
        """The velocities and accelerations (2, K, N) of all coordinates; unknown ones count as 0."""
        known = [*rates, *[0 * rates[0]] * (COORDINATES.rates - len(rates))]
        return np.stack(compute_by_method(COORDINATES, "recursion", self.m, [*known, q[:, self.dependent]])[1:])

    def agreeing(self, s: States) -> np.ndarray:
        """Which neighbours, (K - 1,), are on one branch, by their rates, or are apart because q itself jumps."""
        sizes = newton.scales(self.m).coordinates[self.dependent]
        x, h = s.q[:, self.dependent] / sizes, np.diff(s.t)[:, None]
        (v, a), (w, b) = (rates[..., self.dependent] / sizes for rates in (s.after[:, :-1], s.before[:, 1:]))
        in_way = np.abs(np.diff(x, axis=0) - h / 2 * (v + w) + h**2 / 12 * (b - a))
        in_velocity = np.abs(w - v - h / 2 * (a + b))
        way = h * np.maximum(np.abs(v), np.abs(w)).max(axis=1, keepdims=True)
        explained = (in_way + h * in_velocity <= AGREEMENT * way + FLOOR).all(axis=1)
        return np.asarray(explained & ~self.crossing(s) | np.isnan(s.before[0, 1:]).any(axis=1))

    def crossing(self, s: States) -> np.ndarray:
        """Which neighbours, (K - 1,), have a singular configuration between them: a determinant changes its sign.

        Or the later one is singular itself.
        """
        A = solved_constraints(self.m, s.q)
        return np.asarray((inverse_conditions_of(A[1:]) < LOST) | crossing(A[:-1], A[1:]))

    def path(self, t: np.ndarray, start: np.ndarray) -> States:
        """States on one branch at times (K,), and between them where neighbours do not agree at once."""
        reach, longest = closing.FIRST_STEP * newton.scales(self.m).coordinates[self.own], np.diff(t).max()
        done, todo, size = [self.states(t[:1], start)], t[1:], BLOCK
        while todo.size:
            last = done[-1].taken(slice(-1, None))
            far = np.abs(self.curve.rates(todo[:size], 0)[0] - last.q[:, self.own]) > reach
            part = todo[: max(1, *np.flatnonzero(far.any(axis=1))[:1])] if far.any() else todo[:size]
            try:
                found: States | None = self.states(part, last.q[0])
            except JounceError:
                found = None
            agrees = np.zeros(1, dtype=bool) if found is None else self.agreeing(joined([last, found]))
            count = len(agrees) if agrees.all() else int(agrees.argmin())
            if found is not None and count:
                done.append(found.taken(slice(0, count)))
                todo = todo[count:]
            elif len(part) == 1:
                if part[0] - last.t[0] < longest / 2 ** (HALVINGS if found else FAILURES):
                    raise self.error(last, float(part[0]), found)
                todo = np.insert(todo, 0, (last.t[0] + part[0]) / 2)
            size = min(BLOCK, 2 * len(part)) if count == len(part) else 1
        return joined(done)

    def error(self, last: States, t: float, found: States | None) -> JounceError:
        """The error where a branch ends between two times, or jumps."""
        s = last if found is None else joined([last, found])
        if found is None or self.crossing(s).any():
            return lost(self.m, t, s.q, found is None)
        others, own = (listed(self.m.tree.coordinates[j] for j in places) for places in (self.dependent, self.own))
        inverse = inverse_conditions(self.m, s.q).min()
        return JounceError(
            f"{self.m.name!r}: the branch jumps along the motion at t = {t:.9g} s, where 1/cond is {inverse:.2g}: rates"
            f" of {others} jump, and those of {own} do not; {CURE}"
        )


def lost(m: Mechanism, t: float, q: np.ndarray, stuck: bool) -> JounceError:
    """The error where constraints are lost along a motion, near positions (K, N), and loops stay open or not."""
    inverse = inverse_conditions(m, q).min()
    beyond = ", and the loops cannot be closed beyond" if stuck else ""
    return JounceError(
        f"{m.name!r}: constraints are lost along the motion at t = {t:.9g} s, where 1/cond is {inverse:.2g}{beyond};"
        f" {CURE}"
    )


def positions(
    robot: Engine, motion: Motion, t: np.ndarray, side: Literal["right", "left"] = "right"
) -> np.ndarray | None:
    """All coordinates (K, N) of the tree of a closed robot at times of a motion; None for robots without loops.

    Raises
    ------
    JounceError : where loops cannot be closed along the motion, or the branch jumps, with the time.
    """
    m = robot.mechanism
    if m.closure is None:
        return None
    curve, inner, order = unwrapped(motion.curve, t)
    samples = (curve.stop - curve.start) / DEFAULT_TIME_STEP if motion.grid is None else len(motion.grid)
    count = max(FEWEST, min(MOST, int(samples / STRIDE)))
    fixed: Any = curve  # curves are immutable, hence keys
    step = closing_step(robot)
    path = _path(m, fixed, order, count, tuple(motion.branch.items()), step)
    near = path.q[(np.searchsorted(path.t, inner, side="right") - 1).clip(0)]
    u = motion(t, 0, side)[0]
    try:
        return closing.close_loops(m, u, near, step)
    except JounceError:
        first, last = 0, len(t)
        while last - first > 1:  # which of the times it is
            middle = (first + last) // 2
            try:
                closing.close_loops(m, u[first:middle], near[first:middle], step)
                first = middle
            except JounceError:
                last = middle
        raise lost(m, t[first], near[first:last], stuck=True) from None


@contextmanager
def named_by_time(t: np.ndarray) -> Iterator[None]:
    """Within this context, errors of results without certain digits begin with the first of the times (N,)."""
    try:
        yield
    except UncertainError as error:
        first = np.logical_or.reduce(error.uncertain).argmax()
        raise JounceError(f"along the motion at t = {t.flat[first]:.6g} s: {error}") from None


def on_tree(rates: tuple[np.ndarray, ...], q: np.ndarray | None) -> tuple[np.ndarray, ...]:
    """Rates of coordinates with all those of the tree first, as a closed robot takes them, if there are any."""
    return rates if q is None else (q, *rates[1:])


def positions_of_rows(robot: Engine, t: np.ndarray, rates: Sequence[np.ndarray], q: np.ndarray) -> np.ndarray:
    """All coordinates (K, N) at rows that state those (K, N) and rates of the independent ones, with loops closed.

    Raises
    ------
    JounceError : where the branch jumps between neighbouring rows, with the time.
    """
    m, step = robot.mechanism, closing_step(robot)
    q = closing.close_loops(m, rates[0], q, step)
    closed = ClosedCurve(m, Hermite(t, tuple(rates)), step)
    both = closed.rates_of(q, rates)
    for i in np.flatnonzero(~closed.agreeing(States(t, q, both, both))):
        off = np.abs((closed.path(t[i : i + 2], q[i]).q[-1] - q[i + 1]) / newton.scales(m).coordinates)
        if off.max() > SAME:
            joint = closure_of(m).coordinates[int(off.argmax())]
            raise JounceError(
                f"{m.name!r}: the branch jumps between the rows at t = {t[i]:.9g} and {t[i + 1]:.9g} s: joint"
                f" {joint!r} comes from {q[i, off.argmax()]:.4g} to {q[i + 1, off.argmax()]:.4g}, where its velocity"
                " leads elsewhere; expected rows of one branch"
            )
    return q


@lru_cache(maxsize=8)
def _path(
    m: Mechanism,
    curve: Curve,
    columns: tuple[int, ...],
    count: int,
    branch: tuple[tuple[str, float], ...],
    step: newton.Step | None,
) -> States:
    """States along some columns of a curve, so close together that positions between are near those before them."""
    c, curve = closure_of(m), Arranged(curve, np.array(columns))
    jumps = [jump.t for jump in curve.jumps(2) if curve.start < jump.t < curve.stop]
    t = np.unique([*np.linspace(curve.start, curve.stop, count + 1), *jumps])
    u, given = curve.rates(t[:1], 0)[0], dict(branch)
    whole = np.array([given.get(name, x) for name, x in zip(c.coordinates, c.start, strict=True)])
    with at(f"at t = {t[0]:.6g} s, the start of the motion"):
        q = closing.close_loops(m, u, all_coordinates(c, u, whole[None, list(c.dependent)]) if branch else None, step)
    return ClosedCurve(m, curve, step).path(t, q[0])
