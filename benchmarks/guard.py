"""``python -m benchmarks.guard``: what a guard keeps of limits on Q and Qd along random paths, and how fast it is.

Paths are pick and place, splines through random points and series of harmonics, planned without regard to the limits;
set points are random steps, 0 among them. The generated C runs at 1 kHz. What it does is judged by inverse dynamics of
the motion, not by its tables: at ticks with the jerk before and after them, and at three times between.
"""

import ctypes
import subprocess
import warnings
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory, mkdtemp

import click
import numpy as np

import jounce
from benchmarks import machine
from benchmarks.tables import paragraph, table
from jounce.io import files
from jounce.live.guard import LAW_RATES, Guard, GuardTables, advance

DT = 1e-3
HOMES = {
    "panda": [0, -0.785, 0, -2.0, 0, 1.8, 0.785],
    "ur5": [0, -1.2, 1.2, -1, -1.5, 0],
    "iiwa14": [0, 0.5, 0, -1.4, 0, 1.0, 0],
}
RATE_OF_EFFORT = 10.0  # 1/s: the limit on Qd over that on Q, but 1000 N m/s of a Panda
BLEND = np.array([0, 0, 0, 0, 0, 126, -420, 540, -315, 70.0])  # from rest to rest in a unit of time
MOST_TICKS, MOST_GREEDY_TICKS = 20_000, 3000
GREEDY_JERKS = np.geomspace(0.1, 1e6, 60)
RUN = """
#include "guard.h"
long run(const guard_path *path, const double *setpoints, long most, double *rates, int *found)
{
    guard_state g;
    long i = 0;
    guard_start(path, &g);
    for (g.status = guard_FOLLOW; i < most && g.status != guard_END; ++i, rates += 4, found += 3) {
        guard_step(path, &g, setpoints[i]);
        rates[0] = g.s; rates[1] = g.v; rates[2] = g.a; rates[3] = g.j;
        found[0] = g.status; found[1] = g.law; found[2] = g.checks;
    }
    return i;
}
"""
STATUSES = ("follow", "limited", "stuck", "end")
SIDES = ("at ticks", "between ticks")


class CPath(ctypes.Structure):
    """The `guard_path` of C."""

    _fields_ = (
        ("nodes", ctypes.c_int), ("rests", ctypes.c_int), ("s", ctypes.c_void_p), ("factors", ctypes.c_void_p),
        ("stop_speed", ctypes.c_void_p),
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Run:
    """The ticks of a path: s, v, a, j (N, 4), and by tick status, law and checked states (N, 3)."""

    rates: np.ndarray
    found: np.ndarray


def compile_guard(guard: Guard, folder: Path, flags: tuple[str, ...] = ("-O2", "-ffp-contract=off")) -> ctypes.CDLL:
    """The generated C of a guard as a library, whose `run` takes the tables of any path of the robot."""
    folder = Path(mkdtemp(dir=folder))  # as libraries are loaded once by path
    (folder / "guard.h").write_text(guard.c_source(), encoding="utf-8")
    (folder / "run.c").write_text(RUN, encoding="utf-8")
    warned = ("-std=c99", "-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror", "-Wno-unused-variable")
    library = folder / f"run{''.join(flags)}.so"
    subprocess.run(["gcc", *warned, *flags, "-shared", "-fPIC", "-o", library, folder / "run.c"], check=True)
    found = ctypes.CDLL(str(library))
    found.run.restype = ctypes.c_long
    return found


def run_compiled(library: ctypes.CDLL, tables: GuardTables, setpoints: np.ndarray) -> Run:
    """The ticks along a path until its end, or as many as there are set points."""
    arrays = [np.ascontiguousarray(x) for x in (tables.s, tables.factors, tables.stop_speed, setpoints)]
    rates, found = np.empty((len(setpoints), 4)), np.empty((len(setpoints), 3), np.int32)
    s, factors, stop_speed, given, *logs = (ctypes.c_void_p(x.ctypes.data) for x in (*arrays, rates, found))
    path = CPath(len(tables.s), int(tables.rests), s, factors, stop_speed)
    ticks = library.run(ctypes.byref(path), given, ctypes.c_long(len(setpoints)), *logs)
    return Run(rates[:ticks], found[:ticks])


def load(name: str) -> jounce.Robot:
    """A robot with limits on Q, Qd and velocities."""
    if name == "panda":
        return jounce.load(name, lock={"panda_finger_joint1": 0.0}).with_limits(effort_rate=1000.0)
    robot = jounce.load(name).with_limits(name)
    return robot.with_limits(effort_rate=RATE_OF_EFFORT * robot.limits.effort)


def random_motion(home: np.ndarray, random: np.random.Generator) -> jounce.Motion:
    """A path near a pose."""
    n, kind = len(home), random.integers(3)
    if kind == 0:
        poses = np.concatenate([[home], home + random.uniform(-0.8, 0.8, (random.integers(2, 5), n))])
        moves = []
        for a, b in pairwise(poses):
            T = random.uniform(0.35, 0.9)
            c = np.outer(b - a, BLEND / T ** np.arange(10))
            c[:, 0] += a
            moves.append(jounce.Motion.polynomial(c, T))
        return sum(moves[1:], moves[0])
    if kind == 1:
        t = np.linspace(0, random.uniform(1, 2.5), 10)
        return jounce.Motion.through(t, home + random.uniform(-0.4, 0.4, (10, n)))
    period = random.uniform(2, 4)
    a, b = random.normal(0, 0.15, (2, 4, n))
    return jounce.Motion.fourier(home, a, b, period, period)


def random_setpoints(count: int, random: np.random.Generator) -> np.ndarray:
    """Steps of 0.1 to 0.6 s: in three of ten 0 to 1, in one 0, else 1."""
    steps = [
        np.full(random.integers(100, 600), random.choice([1.0, random.uniform(), 0.0], p=[0.6, 0.3, 0.1]))
        for _ in range(count // 100)
    ]
    return np.concatenate(steps)[:count]


def joint_rates(motion: jounce.Motion, x: np.ndarray) -> tuple[np.ndarray, ...]:
    """q to q3d (N, n) of s, v, a, j (N, 4)."""
    v, a, j = x.T[1:, :, None]
    q, way, bend, twist = motion(np.minimum(x[:, 0], motion.stop), 3)
    return q, way * v, way * a + bend * v**2, way * j + 3 * bend * v * a + twist * v**3


def ratios(robot: jounce.Robot, motion: jounce.Motion, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Q and Qd (N, n) over their limits at states of the path, by inverse dynamics."""
    Q, Qd = robot.inverse_dynamics(*joint_rates(motion, x))
    return np.abs(Q) / robot.limits.effort, np.abs(Qd) / robot.limits.effort_rate


def within_ticks(run: Run, shares: tuple[float, ...]) -> np.ndarray:
    """States at shares of each tick, by the law of the tick, as far as the path goes."""
    s, v, a, j = run.rates.T
    k = np.array(LAW_RATES)[run.found[:, 1]]
    r, found = v + (2 * a + j / k) / k, []
    for share in shares:
        x = advance((s, v, a), r, k, share * DT)
        found.append(np.stack([*x, -k * (2 * x[2] + k * (x[1] - r))], axis=1))
    moving = run.found[:, 0] != STATUSES.index("end")
    return np.concatenate([x[moving] for x in found])


def run_greedily(tables: GuardTables, most: int) -> np.ndarray:
    """s, v, a, j (N, 4) with the largest j whose tick keeps limits, the one that exceeds them least, no look ahead."""
    jerks = np.concatenate([-GREEDY_JERKS[::-1], [0], GREEDY_JERKS])
    s, v, a, found = float(tables.s[0]), 0.0, 0.0, []
    while s < tables.s[-1] - 1e-6 and len(found) < most:
        speed, rise = v + a * DT + jerks * DT**2 / 2, a + jerks * DT
        ahead = np.minimum(s + v * DT + a * DT**2 / 2 + jerks * DT**3 / 6, tables.s[-1])
        over = np.maximum(rows := tables.values(ahead, speed, rise, jerks), -rows).max(axis=1)
        over[(speed < 0) | (speed > 1)] = np.inf
        kept = np.flatnonzero(over <= 1)
        i = kept[-1] if kept.size else int(over.argmin())
        s, v, a = float(ahead[i]), float(speed[i].clip(0, 1)), float(rise[i])
        found.append((s, v, a, jerks[i]))
    return np.array(found)


@dataclass
class Totals:
    """What was measured along the paths of one robot."""

    paths: int = 0
    ticks: int = 0
    refused: int = 0  # paths that leave position limits
    stuck: int = 0
    unfinished: int = 0
    at: np.ndarray = field(default_factory=lambda: np.zeros(2))  # largest ratios of Q and Qd at ticks
    between: np.ndarray = field(default_factory=lambda: np.zeros(2))
    over_margin: float = -np.inf  # how far Q between ticks is beyond limit and margin, over the limit
    work: list[np.ndarray] = field(default_factory=list)
    durations: list[tuple[float, float, float]] = field(default_factory=list)  # guard, slowdown, retime over it
    greedy: list[float] = field(default_factory=list)  # the largest ratio of each path


def measure(name: str, paths: int, compared: int, seed: int, folder: Path) -> Totals:
    """Run a robot along random paths, some of which are compared with the offline optimum and with greedy scaling."""
    robot, random, found = load(name), np.random.default_rng(seed), Totals()
    margin = 1 + robot.limits.effort_rate * DT / 2 / robot.limits.effort
    library, constants = None, None
    while found.paths < paths:
        motion = random_motion(np.array(HOMES[name]), random)
        try:
            guard = robot.guard(motion, dt=DT)
        except jounce.JounceError as error:
            if "position limits" not in str(error):
                raise
            found.refused += 1
            continue
        tables = guard.tables
        if library is None:
            library, constants = (
                compile_guard(guard, folder),
                (tables.product, tables.first, tables.lower, tables.upper),
            )
        assert all(map(np.array_equal, constants, (tables.product, tables.first, tables.lower, tables.upper)))
        run = run_compiled(library, tables, random_setpoints(MOST_TICKS, random))
        found.paths += 1
        found.ticks += len(run.rates)
        found.stuck += bool((run.found[:, 0] == STATUSES.index("stuck")).any())
        found.unfinished += run.found[-1, 0] != STATUSES.index("end")
        found.work.append(run.found[:, 2] * tables.work)
        ends = np.concatenate([run.rates, within_ticks(run, (1.0,))])
        found.at = np.maximum(found.at, [x.max() for x in ratios(robot, motion, ends)])
        Q, Qd = ratios(robot, motion, within_ticks(run, (0.25, 0.5, 0.75)))
        found.between = np.maximum(found.between, [Q.max(), Qd.max()])
        found.over_margin = max(found.over_margin, float((Q - margin).max()))
        if found.paths <= compared:
            found.durations.append(compare(robot, motion, tables, library))
            found.greedy.append(max(x.max() for x in ratios(robot, motion, run_greedily(tables, MOST_GREEDY_TICKS))))
    return found


def compare(
    robot: jounce.Robot, motion: jounce.Motion, tables: GuardTables, library: ctypes.CDLL
) -> tuple[float, float, float]:
    """How long a path takes: by the guard, by `slowdown` to at most the planned speed, and `retime`."""
    guarded = len(run_compiled(library, tables, np.ones(MOST_TICKS)).rates) * DT
    slow = robot.slowdown(motion).motion.duration
    try:
        return guarded, slow, robot.retime(motion).duration
    except jounce.JounceError:  # it moves at an end
        return guarded, slow, np.nan


def describe(name: str, found: Totals) -> list[str]:
    """A row of the table of limits."""
    work = np.concatenate(found.work)
    figures = [f"{x:.5f}" for x in (*found.at, *found.between)]
    counts = f"{found.paths}", f"{found.ticks:,}"
    stuck = f"{found.stuck}", f"{found.unfinished}"
    return [name, *counts, *figures, f"{found.over_margin:.4f}", *stuck, f"{work.max():,}", f"{np.median(work):,.0f}"]


def describe_times(name: str, found: Totals) -> list[str]:
    """A row of the table of durations."""
    guarded, slow, fast = np.array(found.durations).T
    known = np.isfinite(fast)
    broken = sum(x > 1.0005 for x in found.greedy)
    return [
        name, str(len(guarded)), f"{np.median(guarded / slow):.2f} ({(guarded / slow).max():.2f})",
        str(known.sum()), f"{np.median((guarded / fast)[known]):.2f} ({(guarded / fast)[known].max():.2f})",
        f"{broken} of {len(found.greedy)}", f"{np.median(found.greedy):.1f} ({max(found.greedy):.0f})",
    ]  # fmt: skip


def draw(path: Path, folder: Path) -> None:
    """The picture of a run: speed and set point, and the largest value over its limit: planned, greedy, guarded."""
    from matplotlib.figure import Figure

    from jounce.figures import canvas

    robot, home = load("panda"), np.array(HOMES["panda"])
    away = home + np.array([0.5, 0.4, -0.3, 0.5, 0.4, -0.5, 0.6])
    moves = [np.outer(b - a, BLEND / 0.4 ** np.arange(10)) for a, b in ((home, away), (away, home))]
    for coefficients, begin in zip(moves, (home, away), strict=True):
        coefficients[:, 0] += begin
    motion = jounce.Motion.polynomial(moves[0], 0.4) + jounce.Motion.polynomial(moves[1], 0.4)
    guard = robot.guard(motion, dt=DT)
    setpoints = np.ones(4000)
    setpoints[500:900] = 0.3
    run = run_compiled(compile_guard(guard, folder), guard.tables, setpoints)
    greedy, planned = run_greedily(guard.tables, 4000), np.linspace(motion.start, motion.stop, 1001)
    still = np.stack([planned, *np.broadcast_to([[1.0], [0], [0]], (3, len(planned)))], axis=1)
    figure = Figure(figsize=(9, 4.2), layout="constrained")
    speeds, values = figure.subplots(2, 1, sharex=True)
    for x, label, color in (
        (still, "planned", canvas.COLOURS[2]),
        (greedy, "greedy", canvas.COLOURS[1]),
        (run.rates, "guarded", canvas.COLOURS[0]),
    ):
        t = planned if label == "planned" else DT * np.arange(len(x))
        speeds.plot(t, x[:, 1], color=color, label=label)
        speed = np.abs(joint_rates(motion, x)[1]) / robot.limits.velocity
        values.semilogy(t, np.max([speed, *ratios(robot, motion, x)], axis=(0, 2)), color=color)
    speeds.plot(DT * np.arange(len(run.rates)), setpoints[: len(run.rates)], ":", color="0.4", label="set point")
    speeds.set(ylabel="speed v")
    values.axhline(1, color="0.4", linewidth=0.8)
    values.set(ylabel="largest value / limit", xlabel="time in s", ylim=(0.05, None))
    for panel in (speeds, values):
        panel.grid(alpha=0.3)
    figure.legend(*speeds.get_legend_handles_labels(), loc="outside upper center", ncols=4, frameon=False)
    canvas.save(figure, path)


@click.command()
@click.option("--paths", default=340, show_default=True, help="Of each robot.")
@click.option("--compared", default=34, show_default=True, help="Of these, with the offline optimum and greedily.")
@click.option("--seed", default=0, show_default=True)
@click.option(
    "-o", "--output", default=Path(__file__).with_name("GUARD.md"), type=click.Path(path_type=Path), help="Page."
)
@click.option("--picture", type=click.Path(path_type=Path), help="Draw a run, and leave the page.")
def main(paths: int, compared: int, seed: int, output: Path, picture: Path | None) -> None:
    """Run guards along random paths, and write a page about it."""
    warnings.simplefilter("ignore", jounce.JounceWarning)
    before = machine.load()
    with TemporaryDirectory() as folder:
        if picture is not None:
            draw(picture, Path(folder))
            return
        found = {name: measure(name, paths, compared, seed, Path(folder)) for name in HOMES}
    text = ["# A guard of limits on Q and Qd", "", *paragraph((__doc__ or "").partition("\n\n")[2])]
    head = ["robot", "paths", "ticks", "Q at ticks", "Qd at ticks", "Q between", "Qd between", "Q beyond margin"]
    head += ["cannot go on", "no end", "most work", "median work"]
    text += [*table(head, [describe(name, x) for name, x in found.items()])]
    text += paragraph("""
        Largest values over their limits. The margin of Q between ticks is the limit on Qd times dt / 2; negative is
        within. Paths on which the guard cannot go on stay below 1/1000 of the set point for a second; of "no end" are
        those that take more than 20 s. Work is multiply-adds of a tick, bounded by 250,000.
    """)
    head = ["robot", "paths", "guard / slowdown", "paths", "guard / retime", "greedy breaks limits", "by a factor"]
    text += ["## Time", "", *table(head, [describe_times(name, x) for name, x in found.items()])]
    text += paragraph("""
        Durations at the full set point, median (largest): over those of `slowdown` to at most the planned speed, the
        same factor along the whole path, and of `retime`, which may be faster than planned, where it serves. Greedy
        scaling takes the largest jerk whose tick keeps limits; factors are the median (largest) of the worst value.
    """)
    text += ["## Machine", "", *(f"* {name}: {value}" for name, value in machine.described())]
    text += [f"* load before and after: {before}, {machine.load()}", ""]
    with files.write_whole(output) as part:
        part.write_text("\n".join(text), encoding="utf-8")


if __name__ == "__main__":
    main()
