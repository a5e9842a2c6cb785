"""A guard that follows a path as fast as limits allow, tick by tick, and can stop within them at any time.

Along the path, the speed v = s' obeys v'' = -2k v' - k^2 (v - r), with one of several k, and with r constant over a
tick; r = 0 is a stop. Each tick tries the set point for r, then less, quick laws first, and takes the first whose tick
and whole stop after it keep every limit and end on the path; if no try does, the stop that was verified goes on.
Invariants: every tick was verified before, and what goes on is possible if standing still is. With c = v' + k v, which
obeys c' = -k c + k^2 r, c and v stay 0 or more: the path is never followed backwards.
"""

from typing import Any, NamedTuple

import numpy as np

from jounce.core.errors import JounceError, quote_value
from jounce.core.scalars import is_finite
from jounce.engine.engine import Engine
from jounce.limits.slowdown import Binding
from jounce.live.guard_code import c_source
from jounce.live.guard_tables import (
    END_SHARE,
    LAW_RATES,
    MAX_WORK,
    OVERSHOOT,
    STUCK_SPEED,
    STUCK_TIME,
    TRIES,
    build_tables,
)
from jounce.motion import Motion

Rates = tuple[Any, Any, Any]  # s, v, a: numbers, or arrays of many times
Place = tuple[int, float]  # a row of the tables, and s


class GuardState(NamedTuple):
    """A tick of a `Guard`.

    Attributes
    ----------
    s, v, a, j : float
        The place on the path, in s of the motion, and its rates: v = 1 is the speed of the motion; j begins here.
    status : str
        "follow" if the set point is followed, "limited" if a limit or the end of the path keeps the speed below,
        "stuck" if it is below 1/1000 of the set point for a second, "end" at the end of the path.
    limit : Binding or None
        The joint, the limit and the place t on the path that keep the set point from being followed.
    motion : Motion
        The planned one.

    Examples
    --------
    >>> import jounce
    >>> robot = jounce.load("planar2r").with_limits(velocity=3)
    >>> guard = robot.guard(jounce.Motion.polynomial([[0, 1], [0, 1]], 1.0))
    >>> states = [guard.step(0.5) for _ in range(500)]
    >>> states[-1].status, states[-1].rates[1].round(3)
    ('follow', array([0.5, 0.5]))
    """

    s: float
    v: float
    a: float
    j: float
    status: str
    limit: Binding | None
    motion: Motion

    @property
    def rates(self) -> tuple[np.ndarray, ...]:
        """q, qd, q2d, q3d of the joints."""
        (q, way, bend, twist), (v, a, j) = self.motion(self.s, 3), self[1:4]
        return q, way * v, way * a + bend * v**2, way * j + 3 * bend * v * a + twist * v**3


def advance(x: Rates, r: float, k: float, dt: Any) -> Rates:
    """s, v, a after dt by a law, in closed form: v - r = (u + c t) exp(-k t)."""
    s, v, a = x
    u, c, e = v - r, a + k * (v - r), np.exp(-k * dt)
    s = s + (r * dt + u * ((1 - e) / k) + c * ((1 - e * (1 + k * dt)) / k**2))
    return s, r + (u + c * dt) * e, (a - k * c * dt) * e


class Guard:
    """A motion that is followed tick by tick within limits. `Robot.guard` makes one.

    `tables` are what limits bound along the path, and `state` is that of the last tick.

    Examples
    --------
    >>> import jounce
    >>> robot = jounce.load("planar2r").with_limits(velocity=[0.5, 2])
    >>> guard = robot.guard(jounce.Motion.polynomial([[0, 1], [0, 1]], 1.0))
    >>> state = [guard.step() for _ in range(500)][-1]
    >>> state.status, state.limit.joint, state.limit.limit, round(state.v, 2)
    ('limited', 'joint1', 'velocity', 0.5)
    """

    def __init__(self, robot: Engine, motion: Motion, dt: float) -> None:
        if not is_finite(dt) or not dt > 0:
            raise JounceError(f"dt is {quote_value(dt)}; expected the spacing of ticks in s, above 0")
        self.dt, self.tables = float(dt), build_tables(robot, motion)
        self.checks = MAX_WORK // self.tables.work
        times, lowest = self.dt * np.arange(self.checks), self.tables.stop_speed.min()
        # As v + a / k <= 1, a stop has v <= (1 + k t) exp(-k t), and is done at the last of these times, or too long.
        self._stop_times = [times[: 2 + np.sum((1 + k * times) * np.exp(-k * times) > lowest)] for k in LAW_RATES]
        self.state: GuardState | None = None
        self._law, self._slow, self._next = 0, 0.0, (float(self.tables.s[0]), 0.0, 0.0)

    def step(self, setpoint: float = 1.0) -> GuardState:
        """The state at the next tick; the first is at rest at the start of the path.

        Parameters
        ----------
        setpoint : float, optional
            The speed to follow, from 0 to 1 times that of the motion.

        Returns
        -------
        GuardState

        Raises
        ------
        JounceError
            If the set point is not such a number; the guard stays as it was.

        Examples
        --------
        >>> import jounce
        >>> robot = jounce.load("planar2r").with_limits(velocity=3)
        >>> guard = robot.guard(jounce.Motion.polynomial([[0, 1], [0, 1]], 1.0))
        >>> guard.step().v, round(guard.step().v, 6)
        (0.0, 0.000441)
        """
        if not is_finite(setpoint) or not 0 <= setpoint <= 1:
            raise JounceError(f"setpoint is {quote_value(setpoint)}; expected 0 to 1, times the speed of the motion")
        tables, x = self.tables, self._next
        end = tables.problem.motion.stop
        if x[0] >= end:
            x = (end, 0.0, 0.0)
        arrived = end - x[0] <= END_SHARE * tables.problem.motion.duration
        top = 0.0 if arrived else float(setpoint)
        r, self._law, place = self._choose(x, top)
        s, v, a, k = *map(float, x), LAW_RATES[self._law]
        j = -k * (2 * a + k * (v - r))
        self._slow = self._slow + self.dt if v < STUCK_SPEED * top else 0.0
        status = "end" if arrived else "stuck" if self._slow > STUCK_TIME else "limited" if r < top else "follow"
        limit = tables.describe(*place) if place and place[0] >= 0 else None
        self.state, self._next = GuardState(s, v, a, j, status, limit, tables.problem.motion), advance(x, r, k, self.dt)
        return self.state

    def c_source(self, prefix: str = "guard") -> str:
        """A header file of C99 with this guard and its motion, see the page on guards.

        Parameters
        ----------
        prefix : str, optional
            What its names begin with.

        Returns
        -------
        str

        Raises
        ------
        JounceError
            If the prefix is not the beginning of a name.

        Examples
        --------
        >>> import jounce
        >>> robot = jounce.load("planar2r").with_limits(velocity=3)
        >>> text = robot.guard(jounce.Motion.polynomial([[0, 1], [0, 1]], 1.0)).c_source("arm")
        >>> "void arm_step(const arm_path *path, arm_state *g, double setpoint)" in text
        True
        """
        return c_source(self.tables, self.dt, self.checks, prefix)

    def _choose(self, x: Rates, top: float) -> tuple[float, int, Place | None]:
        """r and the law of a tick, and what the first try breaks."""
        left, first, begin = self.checks, None, int(self._slow / STUCK_TIME * 10)
        for i in range(len(TRIES) * len(LAW_RATES) if top else 0):
            turn, law = divmod(i, len(LAW_RATES))
            of_setpoint, of_speed = TRIES[
                (turn + begin) % len(TRIES)
            ]  # where it goes too slowly, each is first in turn
            r = min(of_setpoint * top + of_speed * x[1], top)
            count, place = self._verify(x, r, law, max(top, x[1]), left)
            left, first = left - count, first or place
            if place is None:
                return r, law, first
            if left < 0:
                break
        return 0.0, self._law, first  # the stop that was verified goes on

    def _verify(self, x: Rates, r: float, law: int, top: float, left: int) -> tuple[int, Place | None]:
        """How many states of a tick and its stop are checked, and which row breaks where, if any does.

        Row -1 is the end of the path, speeds beyond `top`, and stops of more states than are left.
        """
        tables, k = self.tables, LAW_RATES[law]
        y, end = advance(x, r, k, self.dt), tables.problem.motion.stop
        beyond = y[0] + (2 * y[1] + y[2] / k) / k > end and not tables.rests
        if beyond or y[2] + k * (y[1] - top) > OVERSHOOT or y[2] + k * y[1] < 0:
            return 0, (-1, y[0])
        s, v, a = np.transpose([x, y])[:, : 1 + (y[0] < end)]  # the ends of the tick
        count, place = self._find_broken(s, v, a, -k * (2 * a + k * (v - r)), left)
        if place is None:
            s, v, a = advance(y, 0.0, k, self._stop_times[law])
            done = ((v <= tables.stop_speed[law, tables.cells(s)]) & (a <= 0)) | (s >= end)
            s, v, a = (z[: np.append(done, True).argmax()] for z in (s, v, a))
            more, place = self._find_broken(s, v, a, -k * (2 * a + k * v), left - count)
            count += more
        return count, place

    def _find_broken(self, s: Any, v: Any, a: Any, j: Any, left: int) -> tuple[int, Place | None]:
        """How many of some states are checked, and the first row that breaks, if any does."""
        rows = self.tables.values(*(z[:left] for z in (s, v, a, j)))
        broken = ~((rows <= self.tables.upper) & (rows >= self.tables.lower))
        if broken.any():
            state = int(broken.any(axis=1).argmax())
            return state + 1, (int(broken[state].argmax()), float(s[state]))
        return (len(s), None) if len(s) <= left else (left + 1, (-1, float(s[0])))
