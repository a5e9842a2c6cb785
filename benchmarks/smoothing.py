"""``python -m benchmarks.smoothing``: logs of a million rows of seven joints, smoothed; times on one core.

One log has moves between poses, and rests between these; the other has harmonics at time stamps that scatter.
"""

from pathlib import Path
from time import perf_counter, process_time
from warnings import catch_warnings, simplefilter

import click
import numpy as np

import jounce
from benchmarks import machine
from jounce.io import files

JOINTS, ROW = 7, 1e-3  # s from row to row
STEP = 2 * np.pi / 2**19  # of the encoders, rad
MOVES, RESTS, REACH = (1.5, 3.0), (0.5, 2.0), 1.5  # s, s, rad
SCATTER = 1.5e-4  # standard deviation of time stamps, s
SEED = 36


@click.command()
@click.option("--rows", default=1_000_000, show_default=True, type=click.IntRange(1000), help="Number of rows.")
@click.option("--runs", default=3, show_default=True, help="Number of times that each log is smoothed.")
@click.option(
    "-o", "--output", default=Path(__file__).with_name("SMOOTHING.md"), type=click.Path(path_type=Path), help="Page."
)
def main(rows: int, runs: int, output: Path) -> None:
    """Measure how long it takes to smooth logs, and write a page about it."""
    before = machine.load()
    logs = {"with rests": log_with_rests(rows), "with time stamps that scatter": log_with_scatter(rows)}
    lines = [f"| {name} | {measure(*log, runs)} |" for name, log in logs.items()]
    about = [f"* {name}: {value}" for name, value in machine.described()]
    head = ["| log | elapsed, s | processor, s | band |", "|---|---|---|---|"]
    title = ["# Smoothing", "", f"`Motion.fit` of {rows:,} rows of {JOINTS} joints, least of {runs} runs:", ""]
    load = f"* load before and after: {before}, {machine.load()}"
    text = "\n".join([*title, *head, *lines, "", "## Machine", "", *about, load, ""])
    with files.write_whole(output) as part:
        part.write_text(text, encoding="utf-8")
    click.echo(text)


def measure(t: np.ndarray, q: np.ndarray, runs: int) -> str:
    """The least times to smooth a log, and the band that its spline holds."""
    times = []
    for _ in range(runs):
        begin = perf_counter(), process_time()
        with catch_warnings():
            simplefilter("ignore", jounce.JounceWarning)
            motion = jounce.Motion.fit(t, q)
        times.append((perf_counter() - begin[0], process_time() - begin[1]))
    elapsed, processor = np.min(times, axis=0)
    band = motion.source.partition("up to ")[2].partition(" (")[0]
    return f"{elapsed:.1f} | {processor:.1f} | {band}"


def log_with_rests(rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Moves with four continuous derivatives between random poses, at which the arm rests."""
    random, t = np.random.default_rng(SEED), np.arange(rows) * ROW
    q, pose, now = np.empty((rows, JOINTS)), np.zeros(JOINTS), 0.0
    while now <= t[-1]:
        move, rest = random.uniform(*MOVES), random.uniform(*RESTS)
        last, pose = pose, random.uniform(-REACH, REACH, JOINTS)
        here = slice(*np.searchsorted(t, [now, now + move + rest]))
        s = np.minimum((t[here] - now) / move, 1)[:, None]
        q[here] = last + (pose - last) * s**5 * (126 - 420 * s + 540 * s**2 - 315 * s**3 + 70 * s**4)
        now += move + rest
    return t, np.round(q / STEP) * STEP


def log_with_scatter(rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Harmonics, whose rows are stamped at other times than those at which they are read."""
    random, t = np.random.default_rng(SEED), np.arange(rows) * ROW
    frequency, amplitude, phase = random.uniform((0.1, 0.1, 0.0), (0.6, 0.5, 6.0), (3, JOINTS, 3)).T
    read = t + random.normal(0, SCATTER, rows)
    waves = (
        a * np.sin(2 * np.pi * f * read[:, None] + p) for f, a, p in zip(frequency.T, amplitude.T, phase.T, strict=True)
    )
    return t, np.round(sum(waves) / STEP) * STEP


if __name__ == "__main__":
    main()
