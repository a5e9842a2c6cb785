"""``python -m benchmarks.waits``: how long checks, guards and slower motions take, and one time of every kind of these.

Seconds of the processor, the least of some rounds after a first one. The path of a Panda takes 458 s. A solo12 stands
on four points with friction for 0.3 s, with 31 samples, and sways up and down: at the lower friction its feet slip.
"""

from collections.abc import Callable
from pathlib import Path
from time import process_time
from warnings import catch_warnings, simplefilter

import click
import numpy as np

import jounce
from benchmarks import machine
from benchmarks.tables import figure, paragraph, table
from jounce.io import files
from jounce.limits import contact_ratios

HOME = np.array([0, -0.785, 0, -2.356, 0, 1.571, 0.785])
PAWS = [f"{leg}_FOOT" for leg in ("FL", "FR", "HL", "HR")]
GUARDED = 458.0  # s
CALLS = 20  # of a motion, at times of their own
SEED = 5


def panda() -> jounce.Robot:
    """A Panda without its fingers and with the limits that its maker publishes."""
    return jounce.load("panda", lock={"panda_finger_joint1": 0.0}).with_limits("panda")


def postures(count: int) -> np.ndarray:
    """Random postures within the limits of positions."""
    low, high = np.sort(panda().limits.bounds("position"), axis=0)
    return low + (high - low) * np.random.default_rng(SEED).uniform(0.2, 0.8, (count, 7))


def profiles(count: int) -> jounce.Motion:
    """Trapezoidal profiles through postures, whose breaks are blended."""
    motion = jounce.Motion.trapezoidal(postures(count), 2.0, 10.0)
    times = [[at.t for at in motion.breaks if at.joint == j] for j in range(7)]
    return motion.blended(min(0.1, 0.9 * min(np.diff(np.unique(t)).min() for t in times)))


def swaying(friction: float, amplitude: float) -> tuple[jounce.Robot, jounce.Motion]:
    """A solo12 on four points, and a motion up and down."""
    feet = [jounce.Contact(paw, "point", normal=(0, 0, 1), friction=friction) for paw in PAWS]
    stand, t = jounce.load("solo12", base="floating").contacts(feet), np.linspace(0, 0.3, 31)
    q = np.tile([0, 0.6, -1.4], 4) + amplitude * np.sin(21 * t)[:, None] * np.tile([0, 1, 0], 4)
    return stand, stand.project(jounce.Motion.through(t, q), base=np.eye(4))


def work() -> dict[str, Callable[[], object]]:
    """What is measured by name."""
    robot, short, long = panda(), profiles(2), profiles(200)
    long = long.scaled(GUARDED / long.duration)
    waves = np.random.default_rng(SEED).normal(scale=0.02, size=(2, 5, 7))
    harmonics = jounce.Motion.fourier(HOME, *waves, 0.5, GUARDED)
    stands = {mu: swaying(mu, amplitude) for mu, amplitude in ((0.6, 0.005), (0.2, 0.03))}
    return {
        "guard of a Panda, blended profiles": lambda: robot.guard(long),
        "guard of a Panda, harmonics": lambda: robot.guard(harmonics),
        "slowdown of a Panda between two postures": lambda: robot.slowdown(short),
    } | {f"check of a solo12, friction {mu}": lambda at=at: at[0].check(at[1]) for mu, at in stands.items()}


def motions() -> dict[str, jounce.Motion]:
    """A motion of every kind."""
    t = np.linspace(0, 22, 1201)
    wave = HOME + 0.3 * np.sin(np.outer(t, np.linspace(0.5, 1.2, 7)))
    random, part = np.random.default_rng(SEED), slice(0, 220, 4)
    blended, through = profiles(12), jounce.Motion.through(t[part], wave[part])
    noisy = wave + 1e-5 * random.normal(size=wave.shape)
    slowed = blended.scaled(1.5)
    return {
        "trapezoidal": jounce.Motion.trapezoidal(postures(12), 1.0, 5.0),
        "blended": blended,
        "slowed": slowed,
        "slowed twice": slowed.scaled(1.2),
        "through samples": jounce.Motion.through(t, wave),
        "smoothed": jounce.Motion.fit(t, noisy),
        "least squares": jounce.Motion.fit(t, wave, intervals=4, degree=7),
        "polynomial": jounce.Motion.polynomial(random.normal(size=(7, 8)), 2.0),
        "Fourier series": jounce.Motion.fourier(HOME, *(0.1 * random.normal(size=(2, 5, 7))), 0.5, 12.0),
        "piecewise": jounce.Motion.piecewise(np.arange(51.0), random.normal(size=(8, 50, 7))),
        "retimed": panda().retime(through).motion,
        "on contacts": swaying(0.6, 0.005)[1],
    }


def seconds(run: Callable[[], object], rounds: int) -> float:
    """The least time of some rounds, after a first one."""
    times = []
    for _ in range(rounds + 1):
        begin = process_time()
        run()
        times.append(process_time() - begin)
    return min(times[1:])


def count_judged(run: Callable[[], object]) -> int:
    """The times at which the limits of contacts are judged in a check."""
    judge, counts = contact_ratios._find_ratios, list[int]()

    def counted(b: object, t: np.ndarray, least: float = 0.0) -> object:
        counts.append(len(t))
        return judge(b, t, least)

    contact_ratios._find_ratios = counted
    try:
        run()
    finally:
        contact_ratios._find_ratios = judge
    return sum(counts)


def milliseconds_of_calls(motion: jounce.Motion, rounds: int) -> tuple[float, float]:
    """The first call, and the next ones: one time each, rates to q4d."""
    t = np.linspace(motion.start, motion.stop, CALLS + 2)[1:-1]
    begin = process_time()
    motion(t[0])
    first = process_time() - begin
    return 1e3 * first, 1e3 * seconds(lambda: [motion(x) for x in t], rounds) / CALLS


@click.command()
@click.option("--rounds", default=3, show_default=True, type=click.IntRange(1), help="Repetitions of every figure.")
@click.option(
    "-o", "--output", default=Path(__file__).with_name("WAITS.md"), type=click.Path(path_type=Path), help="Page."
)
def main(rounds: int, output: Path) -> None:
    """Measure how long work takes, and write a page about it."""
    before, works = machine.load(), []
    with catch_warnings():
        simplefilter("ignore", jounce.JounceWarning)
        for name, run in work().items():
            took, judged = seconds(run, rounds), count_judged(run)
            works.append([name, figure(took), str(judged or "-"), figure(1e3 * took / judged if judged else None)])
        calls = [[name, *map(figure, milliseconds_of_calls(x, rounds))] for name, x in motions().items()]
    text = ["# Waits", "", *paragraph(__doc__.partition("\n\n")[2])]
    text += table(["work", "s", "times judged", "ms for each"], works)
    text += ["## One time of a motion", "", *table(["motion", "first call, ms", "next ones, ms"], calls)]
    text += ["## Machine", "", *(f"* {name}: {value}" for name, value in machine.described())]
    text += [f"* load average before and after: {before}, {machine.load()}", ""]
    with files.write_whole(output) as part:
        part.write_text("\n".join(text), encoding="utf-8")


if __name__ == "__main__":
    main()
