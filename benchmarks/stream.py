"""``python -m benchmarks.stream``: forces of states in Parquet files, whose time is compared with that of its pieces.

Of the pieces: the kernel on arrays in memory, reading the columns of the files, writing as many columns again. The run
is killed at random moments and continued, and its output compared with that of an uninterrupted one.
"""

import os
import random
import subprocess
import sys
from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path
from shutil import rmtree
from tempfile import TemporaryDirectory
from time import perf_counter, sleep

import click
import numpy as np

import jounce
from benchmarks import machine
from jounce.io import parquet
from jounce.io.columns import Columns
from jounce.io.files import written_whole
from jounce.io.spans import format_of
from jounce.spatial.series import rate_name

ROBOT = jounce.load("iiwa14")
OF_FILE = 1_000_000  # rows
BLOCK = 1 << 16  # rows that are computed at a time
ORDER = 2
SEED = 20210


@click.command()
@click.option("--rows", default=10_000_000, show_default=True, type=click.IntRange(1000), help="Number of states.")
@click.option("--kills", default=3, show_default=True, help="Number of times that a run is killed.")
@click.option("--folder", type=click.Path(path_type=Path), help="Folder for the files; default: a temporary one.")
@click.option(
    "-o", "--output", default=Path(__file__).with_name("STREAM.md"), type=click.Path(path_type=Path), help="Page."
)
def main(rows: int, kills: int, folder: Path | None, output: Path) -> None:
    """Measure jounce run over tables of many states, and write a page about it."""
    with TemporaryDirectory(dir=folder) as place:
        before = machine.load()
        lines = list(measured(Path(place), rows, kills))
        about = [f"* {name}: {value}" for name, value in machine.described()]
        load = f"* load before and after: {before}, {machine.load()}"
    text = "\n".join(["# Streaming", "", *lines, "", "## Machine", "", *about, load, ""])
    with written_whole(output) as part:
        part.write_text(text, encoding="utf-8")
    click.echo(text)


def measured(folder: Path, rows: int, kills: int) -> Iterator[str]:
    """The lines of the page."""
    source = folder / "states"
    generate(source, rows)
    kernel, reading, writing = in_memory(), read(source) / rows, written(source, folder / "written") / rows
    pieces = kernel + reading + writing
    whole, memory = run(source, folder / "whole")
    small = folder / "small"
    small.mkdir()
    first = min(source.iterdir())
    (small / first.name).symlink_to(first)
    _, less = run(small, folder / "few")
    per_state = whole / rows
    yield f"{rows:,} states of the iiwa at order {ORDER}, {len(list(source.iterdir()))} Parquet files;"
    yield "times of one thread per state, the process with its imports included in that of the run."
    yield ""
    yield "| what | ns a state |"
    yield "|---|---|"
    for name, time in (
        ("kernel, arrays in memory", kernel),
        ("reading the columns", reading),
        ("writing the columns of Q, Qd, Q2d", writing),
        ("their sum", pieces),
        ("jounce run", per_state),
    ):
        yield f"| {name} | {time * 1e9:.0f} |"
    yield ""
    yield f"* jounce run takes {per_state / pieces:.2f} times the sum of its pieces"
    yield f"* peak memory {memory / 2**20:.0f} MiB; {less / 2**20:.0f} MiB for the first file alone"
    for line in killed(source, folder / "killed", kills, whole):
        yield f"* {line}"
    yield f"* its output is {'bit-identical' if sums(folder / 'killed') == sums(folder / 'whole') else 'NOT the same'}"


def generate(folder: Path, rows: int) -> None:
    """Write files of smooth motions of all joints, with all rates."""
    folder.mkdir()
    for number, first in enumerate(range(0, rows, OF_FILE)):
        parquet.write(folder / f"motion{number:04d}.parquet", states(number, min(OF_FILE, rows - first)))


def states(seed: int, rows: int) -> Iterator[Columns]:
    """The columns of a motion, some rows at a time."""
    random = np.random.default_rng([SEED, seed])
    amplitude, frequency, phase = random.uniform((0.1, 0.5, 0.0), (0.5, 2.0, 6.0), (ROBOT.n, 3)).T
    for first in range(0, rows, BLOCK):
        t = np.arange(first, min(first + BLOCK, rows)) * 1e-3
        columns = {"t": t}
        for j, name in enumerate(ROBOT.joint_names):
            for k in range(ORDER + 3):
                wave = np.cos(frequency[j] * t + phase[j] + k * np.pi / 2)
                columns[f"{name}.{rate_name('q', k)}"] = amplitude[j] * frequency[j] ** k * wave
        yield columns


def in_memory(count: int = 16) -> float:
    """Seconds per state of the kernel on a block of states; the median of some."""
    columns = next(states(0, BLOCK))
    rates = [
        np.stack([columns[f"{name}.{rate_name('q', k)}"] for name in ROBOT.joint_names], 1) for k in range(ORDER + 3)
    ]
    out = ROBOT.inverse_dynamics(*rates)
    return float(np.median([timed(lambda: ROBOT.inverse_dynamics(*rates, out=out)) for _ in range(count)])) / BLOCK


def read(folder: Path) -> float:
    """Seconds to read all columns of the files by pyarrow."""

    def columns() -> None:
        import pyarrow.parquet as pq

        for path in sorted(folder.iterdir()):
            with pq.ParquetFile(path, pre_buffer=True) as file:
                for batch in file.iter_batches(BLOCK, use_threads=False):
                    for column in batch.columns:
                        column.to_numpy()

    return timed(columns)


def written(source: Path, folder: Path) -> float:
    """Seconds to write as many columns as the forces have, of as many rows."""
    folder.mkdir()
    names = [f"{joint}.{rate_name('Q', k)}" for joint in ROBOT.joint_names for k in range(ORDER + 1)]
    total = 0.0
    for path in sorted(source.iterdir()):
        table = format_of(path)
        spans = table.spans(path, 1 << 40)
        some = [
            chunk for span in spans for chunk in table.chunks(path, table.names(path)[: len(names) + 1], None, span)
        ]
        columns = [dict(zip(["t", *names], chunk.columns.values(), strict=True)) for chunk in some]
        total += timed(lambda: parquet.write(folder / path.name, columns))  # noqa: B023
    rmtree(folder)
    return total


def run(source: Path, output: Path) -> tuple[float, int]:
    """Seconds that the command takes, and its peak memory in bytes."""
    process = start(source, output)
    begin = perf_counter()
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"jounce run ends with {process.returncode}")
    return perf_counter() - begin, usage.ru_maxrss * 1024


def start(source: Path, output: Path) -> subprocess.Popen[bytes]:
    """Start the command."""
    command = [sys.executable, "-m", "jounce", "run", "iiwa14", str(source), "-o", str(output)]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL)


def killed(source: Path, output: Path, kills: int, whole: float) -> Iterator[str]:
    """Kill the command at random moments, and let it end at last; tells when and how far it was."""
    moments = random.Random(SEED)
    for _ in range(kills):
        process = start(source, output)
        after = moments.uniform(0.1, 0.9) * whole / kills
        sleep(after)
        process.kill()
        process.wait()
        done = len(list(output.with_name(f"{output.name}.unfinished").glob("part-*.json")))
        yield f"killed after {after:.1f} s: {done} parts are finished"
    time, _ = run(source, output)
    yield f"the run that follows them takes {time:.1f} s instead of {whole:.1f} s"


def sums(folder: Path) -> dict[str, str]:
    """The checksums of the tables in a folder."""
    return {path.name: sha256(path.read_bytes()).hexdigest() for path in sorted(folder.glob("*.parquet"))}


def timed(call: object) -> float:
    """Seconds that a call takes."""
    begin = perf_counter()
    call()  # type: ignore[operator]
    return perf_counter() - begin


if __name__ == "__main__":
    main()
