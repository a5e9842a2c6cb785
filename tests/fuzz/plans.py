"""Random motions whose pieces are known: their times, and the rates on each piece from either side.

Shares with jounce: nothing, in rates of polynomials; of a smooth motion, what the motion states itself.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import factorial

import numpy as np
from scipy.interpolate import BPoly, PPoly

import jounce

STARTS = (0.0, -5.0, 3600.25, 1.7e9)
SHORT = 10.0  # s: rows of shorter motions are so close that stamps since 1970 leave few digits of their rates
MOST_ROWS = 600  # of a motion, so that an example takes a fraction of a second

Rates = list[np.ndarray]


@dataclass(frozen=True)
class Plan:
    """A motion, the ends (m + 1,) of its smooth pieces, and its rates at shares 0 to 1 of the pieces given.

    `known` is the order of the last rate that it states, `smooth` that of the last one that does not jump. `carry` maps
    pieces and shares (N,) to q, qd, ... (N, n); it evaluates polynomials of its own, from either side of their ends.
    """

    motion: jounce.Motion
    x: np.ndarray
    carry: Callable[[np.ndarray, np.ndarray, int], Rates]
    known: int
    smooth: int = -1


def of_polynomials(motion: jounce.Motion, x: np.ndarray, c: np.ndarray, known: int, smooth: int = -1) -> Plan:
    """A plan of coefficients (degree + 1, m, n), highest power first, of the time since the begin of each piece."""

    def carry(piece: np.ndarray, share: np.ndarray, order: int) -> Rates:
        s, part, found = (share * np.diff(x)[piece])[:, None], c, []
        for _ in range(order + 1):
            value = np.zeros((len(piece), c.shape[2]))
            for coefficient in part[:, piece]:
                value = value * s + coefficient
            found.append(value)
            powers = np.arange(len(part) - 1, 0, -1)[:, None, None]
            part = part[:-1] * powers if len(part) > 1 else 0 * part
        return found

    return Plan(motion, x, carry, known, smooth)


def of_motion(motion: jounce.Motion, x: np.ndarray, known: int) -> Plan:
    """A plan that is what a smooth motion says of itself."""

    def carry(piece: np.ndarray, share: np.ndarray, order: int) -> Rates:
        return list(motion((x[piece] + share * np.diff(x)[piece]).clip(x[0], x[-1]), order))

    return Plan(motion, x, carry, known, known)


def random_plan(rng: np.random.Generator, robot: jounce.Robot, kind: str) -> Plan:
    """A plan of a kind, at another pace or shifted, with times of evaluation from far apart to close."""
    duration, start = float(10 ** rng.uniform(-2, 3)), float(rng.choice([*STARTS, rng.uniform(-1e4, 1e4)]))
    if duration < SHORT and start == STARTS[-1]:
        start = 0.0
    plan = KINDS[kind](rng, robot, duration, start)
    if rng.random() < 0.25:
        plan = slowed_plan(plan, float(10 ** rng.uniform(-1, 1)))
    if rng.random() < 0.25:
        seconds = float(rng.choice([1.0, 0.1, 86400.5, -3.3]))
        plan = replace(plan, motion=plan.motion.shifted(seconds), x=plan.x + seconds)
    if plan.motion.grid is None:
        steps = int(rng.choice([1, 2, 7, 50, MOST_ROWS]))
        plan = replace(plan, motion=plan.motion.with_step(plan.motion.duration / steps * rng.uniform(1, 1.3)))
    return plan


def slowed_plan(plan: Plan, factor: float) -> Plan:
    """The plan, some times as long."""

    def carry(piece: np.ndarray, share: np.ndarray, order: int) -> Rates:
        return [rate / factor**k for k, rate in enumerate(plan.carry(piece, share, order))]

    x = plan.x[0] + (plan.x - plan.x[0]) * factor
    return replace(plan, motion=plan.motion.scaled(factor), x=x, carry=carry)


def _ends(rng: np.random.Generator, count: int, duration: float, start: float) -> np.ndarray:
    """Increasing times: even, uneven by 1e-5 s, or of any distances."""
    if rng.random() < 0.4:
        steps = np.full(count, duration / count) + 1e-5 * rng.uniform(-0.4, 0.4, count) * rng.integers(2)
    else:
        steps = duration * (w := 10 ** rng.uniform(-3 * rng.random(), 0, count)) / w.sum()
    x = start + np.concatenate([[0.0], np.cumsum(steps)])
    return x[np.concatenate([[True], np.diff(x) > 1e-5])]


def _pieces(rng: np.random.Generator, robot: jounce.Robot, duration: float, start: float) -> Plan:
    """Pieces of polynomials: from some order on rates of some joints jump between them."""
    x, degree = _ends(rng, int(rng.integers(1, 8)), duration, start), int(rng.integers(1, 8))
    lowest, n, m = rng.integers(1, 6, robot.n), robot.n, len(x) - 1
    c = np.zeros((degree + 1, m, n))
    size = np.array([factorial(k) / duration**k for k in range(degree + 1)])[:, None]
    state = size * rng.normal(size=(degree + 1, n))
    for i, h in enumerate(np.diff(x)):
        if i:
            jumping = (np.arange(degree + 1)[:, None] >= lowest) & (rng.random(n) < 0.7)
            state = state + jumping * size * rng.choice([-1, 1], (degree + 1, n)) * rng.uniform(0.1, 1, (degree + 1, n))
        c[:, i] = (state / np.array([factorial(k) for k in range(degree + 1)])[:, None])[::-1]
        state = np.array(
            [sum(state[k + j] * h**j / factorial(j) for j in range(degree + 1 - k)) for k in range(degree + 1)]
        )
    return of_polynomials(jounce.Motion.piecewise(x, c), x, c, 99)


def _rows(rng: np.random.Generator, robot: jounce.Robot, duration: float, start: float) -> Plan:
    """A table of rows with all rates, from one row on, some of them at rest and repeated."""
    t, known = _ends(rng, int(rng.integers(1, 10)), duration, start), int(rng.integers(2, 5))
    t = t[:1] if rng.random() < 0.1 else t
    rows = rng.normal(size=(len(t), known + 1, robot.n)) / (duration / len(t)) ** np.arange(known + 1)[:, None]
    for i in np.flatnonzero(rng.random(len(t)) < 0.3):
        rows[i, 1:] = 0
        if i + 1 < len(t):
            rows[i + 1] = rows[i]
    rates = ["q", "qd", *(f"q{k}d" for k in range(2, known + 1))]
    names = robot.mechanism.coordinates
    table = {f"{joint}.{rate}": rows[:, k, j] for j, joint in enumerate(names) for k, rate in enumerate(rates)}
    motion = jounce.load_motion({"t": t, **table}, robot, known - 2)
    if len(t) == 1:
        return Plan(
            motion, t[[0, 0]], lambda piece, share, order: [rows[0, [k] * len(piece)] for k in range(order + 1)], known
        )
    c = PPoly.from_bernstein_basis(BPoly.from_derivatives(t - t[0], rows)).c
    still = np.flatnonzero((rows[1:] == rows[:-1]).all(axis=(1, 2)))
    c[:-1, still], c[-1, still] = 0, rows[still, 0]  # rests: rounding of the coefficients would be a motion
    return of_polynomials(motion, t, c, known, known)


def _points(rng: np.random.Generator, robot: jounce.Robot, duration: float, start: float) -> Plan:
    """A trajectory as ROS has it: linear, cubic or quintic between points."""
    t = _ends(rng, int(rng.integers(1, 8)), duration, start)
    t = t if len(t) > 1 else np.array([t[0], t[0] + duration])
    count = rng.integers(1, 4, len(t)) if rng.random() < 0.5 else np.full(len(t), rng.integers(1, 4))
    rows = rng.normal(size=(len(t), 3, robot.n)) / (duration / len(t)) ** np.arange(3)[:, None]
    rows[rng.random(len(t)) < 0.3, 1:] = 0
    fields = ("positions", "velocities", "accelerations")
    points = [
        {"time_from_start": float(at), **{name: row[k].tolist() for k, name in enumerate(fields[:m])}}
        for at, row, m in zip(t, rows, count, strict=True)
    ]
    message = {"joint_names": list(robot.mechanism.coordinates), "points": points}
    c = np.zeros((6, len(t) - 1, robot.n))
    for i, h in enumerate(np.diff(t)):
        m = int(min(count[i], count[i + 1]))
        c[6 - 2 * m :, i] = PPoly.from_bernstein_basis(BPoly.from_derivatives([0, h], rows[i : i + 2, :m])).c[:, 0]
    return of_polynomials(jounce.Motion.from_joint_trajectory(message), t, c, 99)


def _plan_of_samples(rng: np.random.Generator, robot: jounce.Robot, duration: float, start: float) -> Plan:
    """A spline through samples of a smooth motion."""
    t = _ends(rng, int(rng.integers(12, 60)), duration, start)
    return of_motion(jounce.Motion.through(t, wave_samples(rng, robot, t), int(rng.choice([5, 7]))), t, 4)


def wave_samples(rng: np.random.Generator, robot: jounce.Robot, t: np.ndarray) -> np.ndarray:
    """Samples (N, n) of a wave of each joint, of up to three periods."""
    w, phase = rng.uniform(0.5, 3, robot.n) * 2 * np.pi / (t[-1] - t[0]), rng.uniform(0, 6, robot.n)
    return rng.uniform(0.1, 1, robot.n) * np.sin((t - t[0])[:, None] * w + phase)


def _fourier(rng: np.random.Generator, robot: jounce.Robot, duration: float, start: float) -> Plan:
    """A Fourier series, of which a row may hold several periods."""
    harmonics = int(rng.integers(1, 4))
    a, b = rng.normal(size=(2, harmonics, robot.n)) / np.arange(1, harmonics + 1)[:, None] ** 2
    start = start if abs(start) < 1e4 else 0.0  # else w t loses the digits of the phase
    w = 2 * np.pi / duration * float(rng.choice([rng.uniform(0.1, 2), 1, 2]))
    motion = jounce.Motion.fourier(rng.normal(size=robot.n), a, b, w, duration, start=start)
    return of_motion(motion, np.linspace(motion.start, motion.stop, 9), 99)


def _profile(rng: np.random.Generator, robot: jounce.Robot, duration: float, start: float) -> Plan:
    """Trapezoidal velocities through positions, some of them twice, or triangles."""
    points = np.cumsum(rng.normal(size=(int(rng.integers(2, 5)), robot.n)), axis=0)
    speed = np.abs(np.diff(points, axis=0)).max() / duration
    motion = jounce.Motion.trapezoidal(points, speed, speed / duration * float(10 ** rng.uniform(-1, 1)))
    plan = of_polynomials(motion, motion.curve.x, motion.curve.c, 99)
    return replace(plan, motion=motion.shifted(start), x=plan.x + start)


KINDS = {
    "pieces": _pieces,
    "rows": _rows,
    "points": _points,
    "samples": _plan_of_samples,
    "fourier": _fourier,
    "profile": _profile,
}
