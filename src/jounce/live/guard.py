"""Guard a motion: follow its path within limits, able to stop at any tick.

Along the path, the speed v = s' obeys v'' = -2k v' - k^2 (v - r), with one of several k, and with r constant over a
tick; r = 0 is a stop. Each tick tries the set point for r, then less, quick laws first, and takes the first whose tick
and whole stop after it keep every limit and end on the path; if no try does, the stop that was verified goes on.
Invariants: every tick was verified before, and what goes on is possible if standing still is. With c = v' + k v, which
obeys c' = -k c + k^2 r, c and v stay 0 or more: the path is never followed backwards.

Before the first tick `build_tables` computes what limits bound along the path, as factors over s. With v, a, j the
rates of s, each limit is a row ``lower <= sum of factors(s) * products(v, a, j) <= upper`` in units of the limit, see
`jounce.limits.retime_problem`. Factors are linear between nodes; cells are halved until the rows at their middles are
exact to TABLE_ERROR, which is left of each limit. Nodes at breaks stand twice: before and after.

`Guard.c_source` writes C99 of the same algorithm, from guard.c, on the same tables as constant arrays.
"""

import re
from dataclasses import dataclass, replace
from math import ceil
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jounce.core import scalars
from jounce.core.cures import WITHOUT_TRANSMISSIONS
from jounce.core.errors import JounceError, door, join_names, quote_value, warn
from jounce.core.progress import count_through, stage
from jounce.core.version import __version__
from jounce.engine import along
from jounce.engine.engine import Engine
from jounce.limits import path_terms
from jounce.limits.joints import joint_names
from jounce.limits.retime_problem import LimitRows, RetimeProblem, build_problem, check_path
from jounce.limits.slowdown import Binding
from jounce.model import positions
from jounce.model.limits import LIMIT_KINDS
from jounce.motion import Motion

Rates = tuple[Any, Any, Any]  # s, v, a: numbers, or arrays of many times
Place = tuple[int, float]  # a row of the tables, and s
UNSUPPORTED_KINDS = ("snap", "second_effort_rate", *LIMIT_KINDS.totals)  # of limits: rows of a tick lack them
TABLE_ERROR = 2e-4  # of a limit: interpolation stays below the 5e-4 by which a guarded motion may exceed it
REST_SHARE = 1e-3  # of a limit, which standing still must leave for moving
LAW_RATES = (30.0, 10.0)  # k of the laws, 1/s: quick where limits allow it; the slow one makes better use of limits
TRIES = ((1.0, 0.0), (0.3, 0.7), (0.1, 0.9), (0.0, 1.0), (0.0, 0.8), (0.01, 0.0), (0.001, 0.0))  # r by set point and v
MAX_WORK = 250_000  # multiply-adds of a tick, after which the verified stop goes on
STUCK_SPEED, STUCK_TIME = 1e-3, 1.0  # of the set point, and s: slower for longer, it cannot go on
END_SHARE = 1e-6  # of the path: where a stop at its end, which takes infinitely long, counts as done
OVERSHOOT = 1e-9  # of v beyond the set point, which rounding may make
_PRODUCTS = path_terms.S3 + 1  # how many take v, a, j
_STOP_SPEEDS = 0.5 * 0.8 ** np.arange(60)  # down to 1e-6; a stop from the first takes 1 / k of the path
_FIRST_NODES, FIRST_SPACING = 101, 0.005  # at least, and s of the motion at most: what is shorter may stay unseen
_NODES_PER_BLOCK = 1000  # sampled together, so that what a block takes stays in the cache
_MAX_NODES = 200_000  # these take 80 MB for seven joints
_REST_RATE = 1e-9  # of the largest q', q'' along the path: less is rest
_SPEED_CAP = 10.0  # of the row of velocities where no joint moves: v is 1 at most
SOURCE = Path(__file__).with_name("guard.c")


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
        """The rates q, qd, q2d, q3d of the joints."""
        # The chain rule for q(s(t)), by the derivatives q1, q2, q3 of the path by s.
        (q, q1, q2, q3), (v, a, j) = self.motion(self.s, 3), self[1:4]
        return q, q1 * v, q1 * a + q2 * v**2, q1 * j + 3 * q2 * v * a + q3 * v**3


def advance(x: Rates, r: float, k: float, dt: Any) -> Rates:
    """Return s, v, a after dt by a law, in closed form: v - r = (u + c t) exp(-k t)."""
    s, v, a = x
    u, c, e = v - r, a + k * (v - r), np.exp(-k * dt)
    s = s + (r * dt + u * ((1 - e) / k) + c * ((1 - e * (1 + k * dt)) / k**2))
    return s, r + (u + c * dt) * e, (a - k * c * dt) * e


@door
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
        if not scalars.is_finite(dt) or not dt > 0:
            raise JounceError(f"dt is {quote_value(dt)}; expected the spacing of ticks in s, above 0")
        self.dt, self.tables = float(dt), build_tables(robot, motion)
        self.checks = MAX_WORK // self.tables.work
        times, lowest = self.dt * np.arange(self.checks), self.tables.stop_speed.min()
        # As v + a / k <= 1, a stop has v <= (1 + k t) exp(-k t), and is done at the last of these times, or too long.
        self._stop_times = [times[: 2 + np.sum((1 + k * times) * np.exp(-k * times) > lowest)] for k in LAW_RATES]
        self.state: GuardState | None = None
        self._law, self._slow, self._next = 0, 0.0, (float(self.tables.s[0]), 0.0, 0.0)

    def step(self, setpoint: float = 1.0) -> GuardState:
        """Return the state at the next tick: the first is at rest at the start.

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
        if not scalars.is_finite(setpoint) or not 0 <= setpoint <= 1:
            raise JounceError(f"setpoint is {quote_value(setpoint)}; expected 0 to 1, times the speed of the motion")
        tables, x = self.tables, self._next
        # The end of the path may be passed at a speed, where the motion itself rests.
        end = tables.problem.motion.stop
        if x[0] >= end:
            x = (end, 0.0, 0.0)
        arrived = end - x[0] <= END_SHARE * tables.problem.motion.duration
        top = 0.0 if arrived else float(setpoint)
        # The verified law of this tick, and its jerk j = v'' = -2k v' - k^2 (v - r).
        r, self._law, place = self._choose(x, top)
        s, v, a, k = *map(float, x), LAW_RATES[self._law]
        j = -k * (2 * a + k * (v - r))
        self._slow = self._slow + self.dt if v < STUCK_SPEED * top else 0.0
        status = "follow"
        if arrived:
            status = "end"
        elif self._slow > STUCK_TIME:
            status = "stuck"
        elif r < top:
            status = "limited"
        # Row -1, the end of the path, is no limit.
        limit = None
        if place is not None and place[0] >= 0:
            limit = tables.describe(*place)
        self.state, self._next = GuardState(s, v, a, j, status, limit, tables.problem.motion), advance(x, r, k, self.dt)
        return self.state

    def c_source(self, prefix: str = "guard") -> str:
        """Write a header file of C99 with this guard and its motion.

        See the page on guards.

        Parameters
        ----------
        prefix : str, optional
            The prefix of all names in it.

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
        """Choose r and the law of a tick, with the first obstacle."""
        # Where the guard goes too slowly, each try is the first in turn, so that work never ends before its turn.
        left, first_place, begin = self.checks, None, int(self._slow / STUCK_TIME * 10)
        for i in range(len(TRIES) * len(LAW_RATES) if top > 0 else 0):
            turn, law = divmod(i, len(LAW_RATES))
            setpoint_share, speed_share = TRIES[(turn + begin) % len(TRIES)]
            r = min(setpoint_share * top + speed_share * x[1], top)
            count, place = self._verify(x, r, law, max(top, x[1]), left)
            left = left - count
            if first_place is None:
                first_place = place
            if place is None:
                return r, law, first_place
            if left < 0:
                break
        # The stop that was verified in an earlier tick goes on.
        return 0.0, self._law, first_place

    def _verify(self, x: Rates, r: float, law: int, top: float, left: int) -> tuple[int, Place | None]:
        """Verify a tick and its stop, and count the states checked.

        Returns also which row breaks where, if any does. Row -1 is the end of the path, speeds beyond `top`, and stops
        of more states than are left. Runs up to fourteen times per tick.
        """
        # A stop goes on by (2 v + a / k) / k. With c = a + k v, c stays below k top, and 0 or more.
        tables, k = self.tables, LAW_RATES[law]
        y, end = advance(x, r, k, self.dt), tables.problem.motion.stop
        passes_end = y[0] + (2 * y[1] + y[2] / k) / k > end and not tables.rests
        if passes_end or y[2] + k * (y[1] - top) > OVERSHOOT or y[2] + k * y[1] < 0:
            return 0, (-1, y[0])
        # The states at the ends of the tick, with the jerk of its law; beyond the path there is nothing to check.
        s, v, a = np.transpose([x, y])[:, : 1 + (y[0] < end)]
        count, place = self._find_broken(s, v, a, -k * (2 * a + k * (v - r)), left)
        if place is None:
            # The stop tick by tick, until it is so slow that no row can break on the rest of its way, or leaves the
            # path.
            s, v, a = advance(y, 0.0, k, self._stop_times[law])
            done = ((v <= tables.stop_speed[law, tables.cells(s)]) & (a <= 0)) | (s >= end)
            s, v, a = (z[: np.append(done, True).argmax()] for z in (s, v, a))
            stop_count, place = self._find_broken(s, v, a, -k * (2 * a + k * v), left - count)
            count += stop_count
        return count, place

    def _find_broken(self, s: Any, v: Any, a: Any, j: Any, left: int) -> tuple[int, Place | None]:
        """Return the count of states checked, and the first row that breaks."""
        # More states than are left cannot be verified.
        rows = self.tables.values(*(z[:left] for z in (s, v, a, j)))
        broken = ~((rows <= self.tables.upper) & (rows >= self.tables.lower))
        if broken.any():
            state = int(broken.any(axis=1).argmax())
            return state + 1, (int(broken[state].argmax()), float(s[state]))
        return (len(s), None) if len(s) <= left else (left + 1, (-1, float(s[0])))


# Tables: what limits bound along the path.
@dataclass(frozen=True, eq=False)
class GuardTables:
    """Tables of the limits over the nodes s (N,) of a path.

    Factors (N, T) are those of T terms, of which term t takes product[t], and terms first[i] to first[i + 1] are summed
    to row i, a limit of kinds[i] of joints[:, i]. A stop by a law that slows down breaks no limit below stop_speed
    (L, N). `rests` is whether the motion ends at rest, so that the end is passed at any speed.
    """

    problem: RetimeProblem
    s: np.ndarray
    factors: np.ndarray
    product: np.ndarray
    first: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    kinds: tuple[str, ...]
    joints: np.ndarray
    stop_speed: np.ndarray
    rests: bool

    @property
    def work(self) -> int:
        """The multiply-adds of the rows at one state, and of the law."""
        return 2 * len(self.product) + 20

    def cells(self, s: np.ndarray) -> np.ndarray:
        """Return the nodes before s (M,)."""
        return np.clip(np.searchsorted(self.s, s, side="right") - 1, 0, len(self.s) - 2)

    def values(self, s: np.ndarray, v: np.ndarray, a: np.ndarray, j: np.ndarray) -> np.ndarray:
        """Return the rows (M, R) at states (M,)."""
        # Factors linear between nodes, (M, T), times products of the rates, then summed by row.
        cell = self.cells(s)
        low, w = self.factors[cell], (s - self.s[cell]) / (self.s[cell + 1] - self.s[cell])
        factors = low + w[:, None] * (self.factors[cell + 1] - low)
        products = np.stack([v**0, v, v * v, a, v * v * v, v * a, j], axis=1)
        return np.add.reduceat(factors * products[:, self.product], self.first[:-1], axis=1)

    def describe(self, row: int, s: float) -> Binding:
        """Describe the limit of a row at s."""
        joint = joint_names(self.problem.robot.mechanism)[self.joints[self.cells(np.array(s)), row]]
        return Binding(joint, self.kinds[row], s)


@stage("tables of the guard")
def build_tables(robot: Engine, motion: Motion) -> GuardTables:
    """Build the tables of a motion, or refuse what they cannot hold."""
    problem = _build_problem(robot, motion)
    s, F, joints, rows = _refine(problem)
    # Standing still must keep all limits anywhere on the path, and leave a share of them to move.
    standing = replace(problem, share=problem.share - REST_SHARE)
    check_path(standing, s, path_terms.sample_path(problem.robot, problem.motion, s, problem.order))
    # Terms that are zero along the whole path are left out, and rows without terms with them. What the terms at rest
    # leave of each limit is the slack of a stop.
    row, product = np.nonzero(F.any(axis=0))
    kept = np.unique(row)
    slack = np.minimum(rows.upper - F[:, :, 0], F[:, :, 0] - rows.lower)
    return GuardTables(
        problem=problem,
        s=s,
        factors=F[:, row, product],
        product=product,
        first=np.append(np.searchsorted(row, kept), len(row)),
        lower=rows.lower[kept],
        upper=rows.upper[kept],
        kinds=tuple(rows.kinds[i] for i in kept),
        joints=joints[:, kept],
        stop_speed=np.stack([_find_stop_speeds(k, s, np.abs(F), slack) for k in LAW_RATES]),
        rests=all(np.abs(x[-1]).max() <= _REST_RATE * np.abs(x).max() for x in problem.motion(s, 2, "left")[1:]),
    )


def _build_problem(robot: Engine, motion: Motion) -> RetimeProblem:
    """Return the path of a motion with its limits, or refuse them."""
    m = robot.mechanism
    if not (m.is_fixed_tree and m.is_numeric):
        raise JounceError(
            f"guard() of {m.name!r}; expected a robot on a fixed base without loops, symbols and coupled drives:"
            f" {WITHOUT_TRANSMISSIONS} leaves out those of a file"
        )
    positions.check_single_screws(m, "guard()")
    path = along.check_motion(m, motion)
    base = path.base(path.times, 2)
    if base is not None and any(np.abs(V).max() > 0 for V in base[1:]):
        raise JounceError("guard(): the ground moves, and goes on where the guard slows down; leave the base out")
    # Limits whose rows take more than v, a, j, or are no sums of products.
    problem = build_problem(robot, path, 1 - TABLE_ERROR)
    limits, friction = problem.limits, problem.friction
    unsupported = [kind for kind in limits.kinds if kind in UNSUPPORTED_KINDS or LIMIT_KINDS[kind].takes]
    what = join_names(unsupported)
    if len(unsupported) == 0 and friction is not None and "power" in limits.kinds:
        unsupported, what = ["power"], "power with Coulomb friction"
    if len(unsupported) > 0:
        raise JounceError(f"guard() supports no limits of {what}; remove them: with_limits({unsupported[0]}=inf)")
    if friction is None:
        return problem
    # Coulomb friction with either sign: bounds of forces are narrower by its size on both sides.
    if "effort_rate" in limits.kinds:
        warn("guard(): limits of effort_rate do not bound the rate of Coulomb friction where joints turn round or rest")
    table, force = limits.table.copy(), np.abs(friction.onto).sum(axis=0)
    for kind in ("effort", "stall_effort"):
        table[list(LIMIT_KINDS).index(kind)] += [force, -force]
    return replace(problem, limits=replace(limits, table=table), friction=None)


def _refine(problem: RetimeProblem) -> tuple[np.ndarray, np.ndarray, np.ndarray, LimitRows]:
    """Refine nodes s (N,) until factors are linear between them: (N, R, 7).

    Returns also joints (N, R), and rows that are the same everywhere.
    """
    first = max(_FIRST_NODES, ceil(problem.motion.duration / FIRST_SPACING) + 1)
    if first > _MAX_NODES:
        most = (_MAX_NODES - 1) * FIRST_SPACING
        raise JounceError(
            f"guard(): the motion takes {problem.motion.duration:.6g} s; expected up to {most:g} s, divide it"
        )
    # Nodes before and after breaks, then even ones: sorted by s, those of equal s keep this order.
    sigma, count = problem.points(first)
    sides = (problem.breaks, True), (problem.breaks, False), (sigma[:count], False)
    parts = [(block, left) for points, left in sides for block in _split(points)]
    label = "nodes of the guard"
    blocks = [_sample_rows(problem, *part) for part in count_through(label, parts, len(parts))]
    t, *tables = (np.concatenate(column) for column in zip(*blocks, strict=True))
    order = np.argsort(t, kind="stable")
    s, F, joints = (x[order] for x in (t, *tables))
    # Cells are the spans between nodes of different s. Each round halves those that are not exact, and looks at their
    # halves next.
    cells = np.flatnonzero(np.diff(s))
    while cells.size > 0:
        if len(s) > _MAX_NODES:
            raise JounceError(f"guard(): limits along the path change too fast for tables of {_MAX_NODES} nodes")
        halves = _split(cells)
        rough = [_find_rough(problem, s, F, block) for block in count_through(label, halves, len(halves))]
        places, *middles = (np.concatenate(column) for column in zip(*rough, strict=True))
        s, F, joints = (np.insert(x, places, y, axis=0) for x, y in zip((s, F, joints), middles, strict=True))
        # Each new node moves those after it by one: the cells on both sides of new nodes.
        cells = np.union1d(places + np.arange(len(places)) - 1, places + np.arange(len(places)))
    return s, F, joints, _rows_at(problem, s[:1])


def _find_rough(problem: RetimeProblem, s: np.ndarray, F: np.ndarray, cells: np.ndarray) -> list[np.ndarray]:
    """Find the cells that are not exact to TABLE_ERROR.

    Returns the nodes after them, and s, factors and joints in their middles.
    """
    t, exact, joints = _sample_rows(problem, (s[cells] + s[cells + 1]) / 2)
    # Within limits no product exceeds what makes the largest of its terms twice a limit; v is 1 at most.
    k, largest = max(LAW_RATES), np.abs(exact).max(axis=1)
    products = np.minimum([1, 1, 1, k, 1, k, k * k], 2 / np.maximum(largest, 1e-300))
    errors = np.abs(exact - (F[cells] + F[cells + 1]) / 2)
    is_rough = np.einsum("nrk,nk->nr", errors, products).max(axis=1) > TABLE_ERROR
    return [x[is_rough] for x in (cells + 1, t, exact, joints)]


def _sample_rows(problem: RetimeProblem, t: np.ndarray, left: bool = False) -> tuple[np.ndarray, ...]:
    """Sample factors and joints of the rows: times (N,), (N, R, 7) and (N, R).

    At breaks from the right, or from the left.
    """
    rows = _rows_at(problem, t, left)
    factors = np.zeros((*rows.joints.shape, _PRODUCTS))
    factors[:, :, rows.used] = rows.factors
    return t, factors, rows.joints


def _rows_at(problem: RetimeProblem, t: np.ndarray, left: bool = False) -> LimitRows:
    return problem.rows(path_terms.sample_path(problem.robot, problem.motion, t, problem.order, left), _SPEED_CAP)


def _split(x: np.ndarray) -> list[np.ndarray]:
    """Split numbers (N,) into blocks."""
    return [x[i : i + _NODES_PER_BLOCK] for i in range(0, len(x), _NODES_PER_BLOCK)]


def _find_stop_speeds(k: float, s: np.ndarray, size: np.ndarray, slack: np.ndarray) -> np.ndarray:
    """Find the speeds (N,) below which a stop breaks no limit.

    On its way, 2 v / k at most, a stop slows down: v falls, and a and j are within k v and k^2 v. `size` (N, R, 7) is
    that of factors.
    """
    speeds = np.append(0.0, _STOP_SPEEDS[::-1])
    low, high = np.zeros(len(s), dtype=int), np.full(len(s), len(speeds))
    # All products rise with v: bisect the speeds at all nodes at once.
    while (high - low > 1).any():
        middle = (low + high) // 2
        v = speeds[middle]
        products = np.stack([np.zeros_like(v), v, v**2, k * v, v**3, k * v**2, k**2 * v], axis=1)
        keeps = (np.matmul(size, products[:, :, None])[:, :, 0] <= slack).all(axis=1)
        low, high = np.where(keeps, middle, low), np.where(keeps, high, middle)
    # The least of these speeds over all nodes that a stop from within the cell may pass, [first, reach) of each node.
    node_speeds = speeds[low]
    reach = np.searchsorted(s, np.append(s[1:], s[-1]) + 2 * _STOP_SPEEDS[0] / k, side="right")
    first = np.arange(len(s))
    spans = np.stack([first, np.maximum(reach, first + 1)], axis=1)
    # `reduceat` takes the spans between two of them as well: every other result is of a span.
    return np.minimum.reduceat(np.append(node_speeds, np.inf), spans.ravel())[::2]


# C99 of the same guard.
def c_source(tables: GuardTables, dt: float, checks: int, prefix: str) -> str:
    """Write the header file of a guard and its motion, see `Guard.c_source`."""
    if not isinstance(prefix, str) or not re.fullmatch("[A-Za-z][A-Za-z0-9_]{,50}", prefix):
        raise JounceError(f"prefix is {quote_value(prefix)}; expected up to 51 letters, digits and _, a letter first")
    sizes = {"TERMS": len(tables.product), "ROWS": len(tables.kinds), "LAWS": len(LAW_RATES), "TRIES": len(TRIES)}
    numbers = {"dt": dt, "end_share": END_SHARE, "overshoot": OVERSHOOT}
    numbers |= {"stuck_speed": STUCK_SPEED, "stuck_time": STUCK_TIME}
    # What `advance` computes from k and dt alone, as constants.
    k = np.array(LAW_RATES)
    e = np.exp(-k * dt)
    laws = np.stack([k, e, (1 - e) / k, (1 - e * (1 + k * dt)) / k**2], axis=1)
    small = {"tries": TRIES, "laws": laws, "lower": tables.lower, "upper": tables.upper}
    large = {"s": tables.s, "factors": tables.factors, "stop_speed": tables.stop_speed}
    rows = [tables.describe(i, tables.s[0]) for i in range(sizes["ROWS"])]
    names = [row.limit if row.limit == "velocity" else f"{row.limit} of {row.joint}" for row in rows]
    text = "\n".join([
        f"/* Generated by jounce {__version__}. Rows: {re.sub(r'[^ ,.:a-zA-Z0-9_-]', '?', ', '.join(names))}. */",
        "#include <string.h>",
        f"enum {{ {', '.join(f'guard_{x} = {y}' for x, y in (sizes | {'CHECKS': checks}).items())} }};",
        f"static const double {', '.join(f'guard_{x} = {y!r}' for x, y in numbers.items())};",
        *(_array("double", name, x) for name, x in small.items()),
        *(_array("int", name, x) for name, x in {"first": tables.first, "product": tables.product}.items()),
        SOURCE.read_text(encoding="utf-8"),
        *(_array("double", name, x) for name, x in large.items()),
        "static const guard_path guard_motion = {"
        f"{len(tables.s)}, {int(tables.rests)}, guard_s, guard_factors[0], guard_stop_speed[0]}};\n",
    ])  # fmt: skip
    return re.sub(r"\bguard_", f"{prefix}_", text)


def _array(kind: str, name: str, values: Any) -> str:
    """Write a constant array: a line for each entry of the first axis of several."""
    x = np.asarray(values)
    sizes = "".join(f"[{n}]" for n in x.shape)
    entries = str(x.tolist()).replace("[", "{").replace("]", "}").replace("}, ", "},\n")
    return f"static const {kind} guard_{name}{sizes} = {entries};"
