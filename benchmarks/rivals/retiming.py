"""Retiming beside toppra, copp and ruckig: the fastest motion along a path, and whether it keeps its limits.

All get the same path and limits, without a margin. `retimers` calls them and turns each answer into the motion that a
controller is sent. One judge evaluates it at `FINER` times as many points as its grid has, between these: rates of q
exactly, torques and their rates by jounce's inverse dynamics, and no check of jounce's. The largest share of a limit is
1.0 where it is just kept.

A row has shares of the limits of its problem, and along the curved path of the torque rate, limited or not; `kept` says
whether the limits of the problem are. Or it has a note that says why it has no figures: the library is missing, fails,
or its motion does not begin and end at rest, jumps, leaves the path, or lasts another time than stated. Times are those
of the processor, each the least of several calls taken in turn.
"""

from collections.abc import Callable, Sequence
from functools import partial
from math import ceil
from time import process_time
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from benchmarks.retime import arms, on_path, path
from benchmarks.rivals import retimers
from benchmarks.rivals.retimers import Answer, Problem, Retimer
from jounce import Robot, load

FINER = 20  # points of the judge in each interval of a grid
PATH_POINTS = 20_001  # of the path, by whose tangents the distance from it is measured
OFF_PATH = 1e-4  # rad: motions further from the path, or from its ends, are wrong
AT_REST = 1e-3  # of the largest velocity: motions that begin or end faster, or whose velocity jumps by more, are wrong
JUMP = 1e-3  # of the largest acceleration: where it changes by more from one interval to the next, it jumps
KEPT = 1.001  # largest share of a limit that is kept: jounce and toppra, too, exceed it by 1e-4 between points
LONGEST_NOTE = 120  # characters
MISSTATED = 0.05  # of the duration: a motion that lasts as much longer than stated, or shorter, is wrong
SAMPLE = 4e-3  # s, at least, between two readings of the clock
TURNS, LEAST_ROUNDS = 30, 3  # turns of all, and how many of them a slow retimer takes part in
MEASURED = 3.0  # s of a retimer's calls in all turns, of slow ones more

# Kinds of limits: the titles in rows, and the fields of `Robot.limits`.
KINDS = {
    "velocity": "velocity", "acceleration": "acceleration", "jerk": "jerk", "torque": "effort",
    "torque rate": "effort_rate",
}  # fmt: skip
JUMPING = ("jerk", "torque rate")  # infinite where accelerations jump
Row = dict[str, Any]

DOES_MORE = {
    "toppra": "It keeps conic limits too, can find a time law of a given duration, and is there in C++.",
    "copp": "It minimizes other convex objectives than time, such as thermal energy, takes rows of its caller, and is "
    "there in Rust, C and C++.",
    "ruckig": "It works online, in microseconds, from any state to any other, with velocities and accelerations.",
}


def problems() -> list[tuple[Problem, list[Retimer]]]:
    """Return the problems, each with those who solve it; jounce is the first."""
    robots = arms()
    panda = load("panda", lock={"panda_finger_joint1": 0.0}).with_limits("panda")
    ur5 = robots["UR5"].with_limits(acceleration=10.0, jerk=100.0)
    straight = [
        Retimer("jounce", retimers.jounce()),
        Retimer("ruckig", retimers.ruckig),
        Retimer("copp, 1,001 points", retimers.copp(1_001)),
        Retimer("copp, 101 points", retimers.copp(101)),
        Retimer("copp, 201 points, closer at the ends", retimers.copp(201, close=True)),
        Retimer("toppra, its own grid", retimers.toppra()),
    ]
    found = [
        (_line("Panda, straight line: velocity, acceleration and jerk as published", panda), straight),
        (_line("UR5, straight line: velocity, acceleration 10 rad/s^2, jerk 100 rad/s^3", ur5), straight),
    ]
    at_once = [
        Retimer("jounce, smooth=False", retimers.jounce(smooth=False)),
        Retimer("jounce", retimers.jounce()),
        Retimer("toppra, its own grid", retimers.toppra()),
        Retimer("toppra, 1,001 points", retimers.toppra(1_001)),
        Retimer("copp, 1,001 points", retimers.copp(1_001)),
        Retimer("copp, 4,001 points", retimers.copp(4_001)),
    ]
    with_rates = [
        Retimer("jounce", retimers.jounce()),
        Retimer("copp, rows of torque rates by jounce, 101 points", retimers.copp(101)),
        Retimer("copp, rows of torque rates by jounce, 1,001 points", retimers.copp(1_001)),
        Retimer("copp without torque rates, 1,001 points", retimers.copp(1_001, rates=False)),
        Retimer("toppra without torque rates, its own grid", retimers.toppra()),
    ]
    for name in ("Panda", "UR5"):
        found.append((_curve(f"{name}, curved path: velocity and torque", robots[name], False), at_once))
        found.append((_curve(f"{name}, curved path: velocity, torque and torque rate", robots[name], True), with_rates))
    return sorted(found, key=lambda pair: "straight" in pair[0].title)


def _line(title: str, robot: Robot) -> Problem:
    """Return the straight line between the ends of the curved path, under limits of rates of q alone."""
    curve = path(robot, 0)
    line = np.stack([curve[:, 0], curve[:, 1:].sum(axis=1)], axis=1)
    kinematic = robot.with_limits(effort=np.inf, effort_rate=np.inf)
    return Problem(title, kinematic, kinematic, line, on_path(line))


def _curve(title: str, robot: Robot, rates: bool) -> Problem:
    """Return a curved path, under limits of velocity, torque, and its rate or not; shares are of all three."""
    curve = path(robot, 0)
    return Problem(title, robot if rates else robot.with_limits(effort_rate=np.inf), robot, curve, on_path(curve))


def measured(report: Callable[[str], None]) -> list[Row]:
    """Return a row for each problem and retimer: its duration, time of a call and shares of limits, or a note."""
    rows = []
    for problem, chosen in problems():
        report(problem.title)
        rows += measured_problem(problem, chosen)
    return rows


def measured_problem(problem: Problem, chosen: Sequence[Retimer]) -> list[Row]:
    """Return the rows of a problem."""
    rows = [judged(problem, retimer) for retimer in chosen]
    # The first calls compiled. The next ones say how many calls are made in a row, and in which turns: slow retimers
    # take part in few, far apart, so that a time of a busy machine slows all of them alike.
    for row, retimer in zip(rows, chosen, strict=True):
        add_sample(row, problem, retimer, 1)
    took = [row["seconds"] or MEASURED for row in rows]
    counts = [ceil(SAMPLE / seconds) for seconds in took]
    every = [TURNS // min(TURNS, max(LEAST_ROUNDS, round(MEASURED / seconds))) for seconds in took]
    for turn in range(TURNS):
        for row, retimer, count, apart in zip(rows, chosen, counts, every, strict=True):
            if turn % apart == 0:
                add_sample(row, problem, retimer, count)
    return rows


def add_sample(row: Row, problem: Problem, retimer: Retimer, count: int) -> None:
    """Time so many calls in a row, and keep the least of all such times; nothing where the row has a note."""
    if row["note"]:
        return
    start = process_time()
    for _ in range(count):
        _, note = _tried(partial(retimer.solve, problem))
        if note:
            row |= row_of(problem, retimer, note)
            return
    took = max((process_time() - start) / count, 1e-6)
    row["seconds"] = min(took, row["seconds"] or took)


def judged(problem: Problem, retimer: Retimer) -> Row:
    """Return the row of a retimer without its time; whatever it raises ends in the note."""

    def judge() -> Row:
        answer = retimer.solve(problem)
        rates = answer.rates(np.linspace(0, 1, FINER))
        note = fault(problem, answer, rates)
        if note:
            return row_of(problem, retimer, note)
        found = shares(problem.judge, rates)
        kept = all(found[kind] is not None and found[kind] <= KEPT for kind in found if problem.limits(KINDS[kind]))
        return row_of(problem, retimer) | {"duration": float(answer.duration), "shares": found, "kept": kept}

    row, note = _tried(judge)
    return row if row is not None else row_of(problem, retimer, note)


def row_of(problem: Problem, retimer: Retimer, note: str = "") -> Row:
    """Return a row without figures."""
    row: Row = {"problem": problem.title, "rival": retimer.name, "duration": None, "seconds": None}
    return row | {"shares": {}, "kept": None, "note": note}


def _tried(call: Callable[[], Any]) -> tuple[Any, str]:
    """Return what a call returns and no note, or nothing and a note on what it raises."""
    try:
        return call(), ""
    except (KeyboardInterrupt, SystemExit):
        raise
    except ImportError as error:
        return None, f"not installed: {error.name or error}"
    # Panics of Rust, which copp raises, are no `Exception`.
    except BaseException as error:
        text = (str(error).strip().splitlines() or [""])[0]
        return None, f"{type(error).__name__}: {text}"[:LONGEST_NOTE]


def fault(problem: Problem, answer: Answer, rates: Sequence[np.ndarray]) -> str:
    """Return what makes a motion none along the path from rest to rest, or nothing."""
    if not (np.isfinite(answer.duration) and all(np.isfinite(rate).all() for rate in rates)):
        return "wrong: numbers that are not finite"
    q, qd = rates[:2]
    fastest = np.abs(qd).max()
    ends = problem.derivatives(np.array([0.0, 1.0]), 0)[0]
    if np.abs(np.stack([q[0, 0], q[-1, -1]]) - ends).max() > OFF_PATH:
        return "wrong: it does not begin and end where the path does"
    if max(np.abs(qd[0, 0]).max(), np.abs(qd[-1, -1]).max()) > AT_REST * fastest:
        return "wrong: it does not begin and end at rest"
    if _gap(q) > OFF_PATH:
        return "wrong: its position jumps"
    if _gap(qd) > AT_REST * fastest:
        return "wrong: its velocity jumps"
    off = distance(problem, q.reshape(-1, q.shape[-1]))
    if off > OFF_PATH:
        return f"wrong: {off:.1g} rad off the path"
    lasts = length_of_time(q, qd)
    stated = abs(answer.duration / lasts - 1) < MISSTATED
    return "" if stated else f"wrong: it lasts {lasts:.3g} s, and states {answer.duration:.3g} s"


def _gap(rate: np.ndarray) -> float:
    """Return the largest change of a rate (intervals, p, n) from one interval to the next."""
    return float(np.abs(rate[1:, 0] - rate[:-1, -1]).max(initial=0.0))


def length_of_time(q: np.ndarray, qd: np.ndarray) -> float:
    """Return about how long a motion lasts, from the ways between its points and the mean speeds there."""
    way = np.linalg.norm(np.diff(q, axis=1), axis=-1)
    speed = np.linalg.norm(qd, axis=-1)
    return float((way / ((speed[:, 1:] + speed[:, :-1]) / 2)).sum())


def distance(problem: Problem, q: np.ndarray) -> float:
    """Return the largest distance of points (N, n) from the path: from its tangents at the points nearest to them."""
    points, tangents = problem.derivatives(np.linspace(0, 1, PATH_POINTS), 1)
    nearest = cKDTree(points).query(q)[1]
    off, along = q - points[nearest], tangents[nearest]
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    return float(np.linalg.norm(off - (off * along).sum(axis=1, keepdims=True) * along, axis=1).max())


def shares(robot: Robot, rates: Sequence[np.ndarray]) -> dict[str, float | None]:
    """Return the largest share of each finite limit of a robot; None where it is infinite, as accelerations jump."""
    q, qd, q2d, q3d = (np.ascontiguousarray(rate.reshape(-1, rate.shape[-1])) for rate in rates)
    Q, Qd = robot.inverse_dynamics(q, qd, q2d, q3d)
    values = {"velocity": qd, "acceleration": q2d, "jerk": q3d, "torque": Q, "torque rate": Qd}
    # A motion that starts from rest with an acceleration jumps there too.
    edges = max(np.abs(q2d[0]).max(), np.abs(q2d[-1]).max())
    jumps = max(_gap(rates[2]), edges) > JUMP * np.abs(q2d).max()
    found: dict[str, float | None] = {}
    for kind, value in values.items():
        limit = np.asarray(getattr(robot.limits, KINDS[kind]), float)
        if not np.isfinite(limit).any():
            continue
        found[kind] = None if jumps and kind in JUMPING else float(np.abs(value / limit).max())
    return found
