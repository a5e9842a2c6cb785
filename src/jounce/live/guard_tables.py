"""What limits bound along a path, as factors over s of products of v, a, j: the tables of a guard.

With v, a, j the rates of s, each limit is a row ``lower <= sum of factors(s) * products(v, a, j) <= upper`` in units of
the limit, see `jounce.limits.limit_rows`. Factors are linear between nodes; cells are halved until the rows at their
middles are exact to TABLE_ERROR, which is left of each limit. Nodes at breaks stand twice: before and after.
"""

from dataclasses import dataclass, replace
from math import ceil

import numpy as np

from jounce.core.errors import JounceError, join_names, warn
from jounce.core.progress import count_through, stage
from jounce.engine.along import check_motion
from jounce.engine.engine import Engine
from jounce.limits import path_velocity
from jounce.limits.joints import joint_names
from jounce.limits.limit_rows import LimitRows
from jounce.limits.path import sample_path
from jounce.limits.retime_problem import RetimeProblem, build_problem, check_path
from jounce.limits.slowdown import Binding
from jounce.model.limit_kinds import LIMIT_KINDS
from jounce.model.positions import check_single_screws
from jounce.motion import Motion

TABLE_ERROR = 2e-4  # of a limit: interpolation stays below the 5e-4 by which a guarded motion may exceed it
REST_SHARE = 1e-3  # of a limit, which standing still must leave for moving
LAW_RATES = (30.0, 10.0)  # k of the laws, 1/s: quick where limits allow it; the slow one makes better use of limits
TRIES = ((1.0, 0.0), (0.3, 0.7), (0.1, 0.9), (0.0, 1.0), (0.0, 0.8), (0.01, 0.0), (0.001, 0.0))  # r by set point and v
MAX_WORK = 250_000  # multiply-adds of a tick, after which the verified stop goes on
STUCK_SPEED, STUCK_TIME = 1e-3, 1.0  # of the set point, and s: slower for longer, it cannot go on
END_SHARE = 1e-6  # of the path: where a stop at its end, which takes infinitely long, counts as done
OVERSHOOT = 1e-9  # of v beyond the set point, which rounding may make
_PRODUCTS = path_velocity.S3 + 1  # how many take v, a, j
_STOP_SPEEDS = 0.5 * 0.8 ** np.arange(60)  # down to 1e-6; a stop from the first takes 1 / k of the path
_FIRST_NODES, FIRST_SPACING = 101, 0.005  # at least, and s of the motion at most: what is shorter may stay unseen
_NODES_PER_BLOCK = 1000  # sampled together, so that what a block takes stays in the cache
_MAX_NODES = 200_000  # these take 80 MB for seven joints
_REST_RATE = 1e-9  # of the largest q', q'' along the path: less is rest
_SPEED_CAP = 10.0  # of the row of velocities where no joint moves: v is 1 at most


@dataclass(frozen=True, eq=False)
class GuardTables:
    """Tables over the nodes s (N,) of a path.

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
        """Multiply-adds of the rows at a state, and of the law."""
        return 2 * len(self.product) + 20

    def cells(self, s: np.ndarray) -> np.ndarray:
        """The nodes before s."""
        return np.clip(np.searchsorted(self.s, s, side="right") - 1, 0, len(self.s) - 2)

    def values(self, s: np.ndarray, v: np.ndarray, a: np.ndarray, j: np.ndarray) -> np.ndarray:
        """The rows (M, R) at states (M,)."""
        cell = self.cells(s)
        low, w = self.factors[cell], (s - self.s[cell]) / (self.s[cell + 1] - self.s[cell])
        factors = low + w[:, None] * (self.factors[cell + 1] - low)
        products = np.stack([v**0, v, v * v, a, v * v * v, v * a, j], axis=1)
        return np.add.reduceat(factors * products[:, self.product], self.first[:-1], axis=1)

    def describe(self, row: int, s: float) -> Binding:
        """The limit of a row at s."""
        joint = joint_names(self.problem.robot.mechanism)[self.joints[self.cells(np.array(s)), row]]
        return Binding(joint, self.kinds[row], s)


@stage("tables of the guard")
def build_tables(robot: Engine, motion: Motion) -> GuardTables:
    """The tables of a motion; a robot, limits or a path that are not served are refused."""
    problem = _build_problem(robot, motion)
    s, F, joints, rows = _refine(problem)
    holding = replace(problem, share=problem.share - REST_SHARE)
    check_path(holding, s, sample_path(problem.robot, problem.motion, s, problem.order))
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
    """The path of a motion and the limits along it; what the law or the tables do not serve is refused."""
    m = robot.mechanism
    if not (m.is_fixed_tree and m.is_numeric):
        raise JounceError(f"guard() of {m.name!r}; expected a robot on a fixed base without loops and symbols")
    check_single_screws(m, "guard()")
    path = check_motion(m, motion)
    if path.base_curve and any(np.abs(V).max() > 0 for V in (path.base(path.times, 2) or ())[1:]):
        raise JounceError("guard(): the ground moves, and goes on where the guard slows down; leave the base out")
    problem = build_problem(robot, path, 1 - TABLE_ERROR)
    limits, friction = problem.limits, problem.friction
    odd = [kind for kind in limits.kinds if kind in ("snap", "second_effort_rate") or LIMIT_KINDS[kind].takes]
    if odd or (friction and "power" in limits.kinds):
        what = join_names(odd) if odd else "power with Coulomb friction"
        raise JounceError(
            f"guard() supports no limits of {what}; remove them: with_limits({(odd or ['power'])[0]}=inf)"
        )
    if friction is None:
        return problem
    if "effort_rate" in limits.kinds:
        warn("guard(): limits of effort_rate do not bound the rate of Coulomb friction where joints turn round or rest")
    table, force = limits.table.copy(), np.abs(friction.onto).sum(axis=0)
    for kind in ("effort", "stall_effort"):
        table[list(LIMIT_KINDS).index(kind)] += [force, -force]
    return replace(problem, limits=replace(limits, table=table), friction=None)


def _refine(problem: RetimeProblem) -> tuple[np.ndarray, np.ndarray, np.ndarray, LimitRows]:
    """Nodes s (N,), factors (N, R, 7) of all products, joints (N, R), and rows that are the same everywhere."""
    first = max(_FIRST_NODES, ceil(problem.motion.duration / FIRST_SPACING) + 1)
    if first > _MAX_NODES:
        most = (_MAX_NODES - 1) * FIRST_SPACING
        raise JounceError(
            f"guard(): the motion takes {problem.motion.duration:.6g} s; expected up to {most:g} s, divide it"
        )
    sigma, count = problem.points(first)
    sides = (problem.breaks, True), (problem.breaks, False), (sigma[:count], False)
    parts = [(block, left) for points, left in sides for block in _split(points)]
    label = "nodes of the guard"
    blocks = [_sample_rows(problem, *part) for part in count_through(label, parts, len(parts))]
    t, *tables = (np.concatenate(column) for column in zip(*blocks, strict=True))
    order = np.argsort(t, kind="stable")  # before and after breaks, then even points
    s, F, joints = (x[order] for x in (t, *tables))
    cells = np.flatnonzero(np.diff(s))
    while cells.size:
        if len(s) > _MAX_NODES:
            raise JounceError(f"guard(): limits along the path change too fast for tables of {_MAX_NODES} nodes")
        halves = _split(cells)
        rough = [_find_rough(problem, s, F, block) for block in count_through(label, halves, len(halves))]
        at, *middles = (np.concatenate(column) for column in zip(*rough, strict=True))
        s, F, joints = (np.insert(x, at, y, axis=0) for x, y in zip((s, F, joints), middles, strict=True))
        cells = np.union1d(at + np.arange(len(at)) - 1, at + np.arange(len(at)))
    return s, F, joints, _rows_at(problem, s[:1])


def _find_rough(problem: RetimeProblem, s: np.ndarray, F: np.ndarray, cells: np.ndarray) -> list[np.ndarray]:
    """Of some cells those that are not exact to TABLE_ERROR: the nodes after them, and s, factors, joints amid them."""
    t, exact, joints = _sample_rows(problem, (s[cells] + s[cells + 1]) / 2)
    # Within limits no product exceeds what makes the largest of its terms twice a limit; v is 1 at most.
    k, largest = max(LAW_RATES), np.abs(exact).max(axis=1)
    products = np.minimum([1, 1, 1, k, 1, k, k * k], 2 / np.maximum(largest, 1e-300))
    off = np.abs(exact - (F[cells] + F[cells + 1]) / 2)
    wrong = np.einsum("nrk,nk->nr", off, products).max(axis=1) > TABLE_ERROR
    return [x[wrong] for x in (cells + 1, t, exact, joints)]


def _sample_rows(problem: RetimeProblem, t: np.ndarray, left: bool = False) -> tuple[np.ndarray, ...]:
    """Times (N,), factors (N, R, 7) of all products, and joints (N, R); at breaks from the right, or from the left."""
    rows = _rows_at(problem, t, left)
    factors = np.zeros((*rows.joints.shape, _PRODUCTS))
    factors[:, :, rows.used] = rows.factors
    return t, factors, rows.joints


def _rows_at(problem: RetimeProblem, t: np.ndarray, left: bool = False) -> LimitRows:
    return problem.rows(sample_path(problem.robot, problem.motion, t, problem.order, left), _SPEED_CAP)


def _split(x: np.ndarray) -> list[np.ndarray]:
    """Numbers (N,) in blocks."""
    return [x[i : i + _NODES_PER_BLOCK] for i in range(0, len(x), _NODES_PER_BLOCK)]


def _find_stop_speeds(k: float, s: np.ndarray, size: np.ndarray, slack: np.ndarray) -> np.ndarray:
    """The speeds (N,) below which a stop that slows down breaks no limit on its way, 2 v / k at most.

    There v falls, and a and j are within k v and k^2 v. `size` (N, R, 7) is that of factors.
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
    found = speeds[low]
    reach = np.searchsorted(s, np.append(s[1:], s[-1]) + 2 * _STOP_SPEEDS[0] / k, side="right")
    first = np.arange(len(s))
    spans = np.stack([first, np.maximum(reach, first + 1)], axis=1)
    return np.minimum.reduceat(np.append(found, np.inf), spans.ravel())[::2]  # every other span is between two
