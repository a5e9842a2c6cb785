"""``python -m benchmarks.stream``: forces of states in Parquet files, whose time is compared with that of its pieces.

Of the pieces: the kernel on arrays in memory, reading the columns of the files, writing as many columns again. The run
is killed at random moments and continued, and its output compared with that of an uninterrupted one.
"""

import os
import random
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from pstats import Stats
from shutil import rmtree
from tempfile import TemporaryDirectory
from time import perf_counter, process_time, sleep
from typing import NamedTuple

import click
import numpy as np

from benchmarks import machine
from benchmarks.state_files import BLOCK, OF_FILE, ORDER, ROBOT, SEED, generate, states, sums
from jounce.io import files
from jounce.io.tables import PARQUET
from jounce.spatial.series import rate_name

STAGES = {  # of the main thread: files and functions
    "waiting for rows": ("io/motions/part_rows.py", "read_ahead"),
    "checking rows": ("io/motions/part_rows.py", "_check_rows"),
    "states, results and their columns": ("io/motions/part_rows.py", "compute_rows"),
    "of these the kernel, compiled meanwhile": ("engine/plan.py", "compute"),
    "peaks and sums": ("motion/extremes.py", "find_extremes"),
    "all of writing and what it takes rows from": ("io/parquet.py", "_write_groups"),
    "checksums": ("io/files.py", "checksum"),
    "the plan": ("io/motions/table_parts.py", "divide_tables"),
}


class Times(NamedTuple):
    """Seconds on the clock, and of processors: the second says more where a machine is busy with other things."""

    elapsed: float
    processor: float

    def plus(self, other: "Times") -> "Times":
        """The sum."""
        return Times(self.elapsed + other.elapsed, self.processor + other.processor)

    def of(self, count: int) -> "Times":
        """The times of one of several."""
        return Times(self.elapsed / count, self.processor / count)


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
    with files.write_whole(output) as part:
        part.write_text(text, encoding="utf-8")
    click.echo(text)


def measured(folder: Path, rows: int, kills: int) -> Iterator[str]:
    """The lines of the page."""
    source = folder / "states"
    generate(source, rows)
    kernel = in_memory()
    reading, writing = read(source).of(rows), written(source, folder / "written").of(rows)
    pieces = kernel.plus(reading).plus(writing)
    whole, memory = run(source, folder / "whole")
    small = folder / "small"
    small.mkdir()
    first = min(source.iterdir())
    (small / first.name).symlink_to(first)
    _, less = run(small, folder / "few")
    yield f"{rows:,} states of the iiwa at order {ORDER}, {len(list(source.iterdir()))} Parquet files;"
    yield "times per state; that of the run includes the start of the interpreter and all imports."
    yield ""
    yield "| what | elapsed, ns per state | processor, ns per state |"
    yield "|---|---|---|"
    for name, time in (
        ("kernel, arrays in memory", kernel),
        ("reading the columns", reading),
        ("writing the columns of Q, Qd, Q2d", writing),
        ("their sum", pieces),
        ("jounce run", whole.of(rows)),
    ):
        yield f"| {name} | {time.elapsed * 1e9:.0f} | {time.processor * 1e9:.0f} |"
    yield ""
    run_to_pieces = whole.elapsed / rows / pieces.elapsed, whole.processor / rows / pieces.processor
    yield "* jounce run takes {:.2f} times the sum of its pieces, {:.2f} times its processor time".format(
        *run_to_pieces
    )
    yield f"* peak memory {memory / 2**20:.0f} MiB; {less / 2**20:.0f} MiB for the first file alone"
    yield from profiled(small, folder / "profiled")
    for line in killed(source, folder / "killed", kills, whole.elapsed):
        yield f"* {line}"
    yield f"* its output is {'bit-identical' if sums(folder / 'killed') == sums(folder / 'whole') else 'NOT the same'}"


def profiled(source: Path, output: Path) -> Iterator[str]:
    """What the main thread of a run of one file spends its time on; reading and writing have threads of their own."""
    kept = output.with_suffix(".profile")
    command = [sys.executable, "-m", "cProfile", "-o", kept, "-m", "jounce", "run", "iiwa14", source, "-o", output]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    spent: dict[str, float] = {}
    for (path, _, name), (_, _, _, seconds, _) in vars(Stats(str(kept)))["stats"].items():
        for what, (file, function) in STAGES.items():
            if path.endswith(file) and name == function:
                spent[what] = spent.get(what, 0.0) + seconds
    parts = ", ".join(f"{what} {1e9 * seconds / OF_FILE:.0f}" for what, seconds in spent.items())
    yield f"* the main thread, ns per state of {OF_FILE:,} with a profiler: {parts}"


def in_memory(count: int = 16) -> Times:
    """Times per state of the kernel on a block of states; the median of some."""
    columns = next(states(0, BLOCK))
    rates = [
        np.stack([columns[f"{name}.{rate_name('q', k)}"] for name in ROBOT.joint_names], 1) for k in range(ORDER + 3)
    ]
    out = ROBOT.inverse_dynamics(*rates)
    times = [timed(lambda: ROBOT.inverse_dynamics(*rates, out=out)) for _ in range(count)]
    return Times(*np.median(times, axis=0).tolist()).of(BLOCK)


def read(folder: Path) -> Times:
    """Times to read all columns of the files by pyarrow."""

    def columns() -> None:
        import pyarrow.parquet as pq

        for path in sorted(folder.iterdir()):
            with pq.ParquetFile(path, pre_buffer=True) as file:
                for batch in file.iter_batches(BLOCK, use_threads=False):
                    for column in batch.columns:
                        column.to_numpy()

    return timed(columns)


def written(source: Path, folder: Path) -> Times:
    """Times to write as many columns as the forces have, of as many rows."""
    folder.mkdir()
    names = [f"{joint}.{rate_name('Q', k)}" for joint in ROBOT.joint_names for k in range(ORDER + 1)]
    total = Times(0.0, 0.0)
    for path in sorted(source.iterdir()):
        table = PARQUET
        spans = table.spans(path, 1 << 40)
        some = [
            chunk for span in spans for chunk in table.chunks(path, table.names(path)[: len(names) + 1], None, span)
        ]
        columns = [dict(zip(["t", *names], chunk.columns.values(), strict=True)) for chunk in some]
        total = total.plus(timed(lambda: PARQUET.write(folder / path.name, columns)))  # noqa: B023
    rmtree(folder)
    return total


def run(source: Path, output: Path) -> tuple[Times, int]:
    """Times that the command takes, and its peak memory in bytes."""
    process = start(source, output)
    begin, peak, pid = perf_counter(), 0, 0
    while not pid:
        peak = max(peak, peak_memory(process.pid))
        sleep(0.02)
        pid, status, usage = os.wait4(process.pid, os.WNOHANG)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"jounce run ends with {process.returncode}")
    return Times(perf_counter() - begin, usage.ru_utime + usage.ru_stime), peak


def peak_memory(process: int) -> int:
    """The peak memory of a process so far, as Linux tells; that of its usage counts the process that started it."""
    try:
        status = Path(f"/proc/{process}/status").read_text()
    except OSError:
        return 0
    found = re.search(r"VmHWM:\s+(\d+)", status)
    return int(found[1]) * 1024 if found else 0


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
    yield f"the run that follows them takes {time.elapsed:.1f} s instead of {whole:.1f} s"


def timed(call: Callable[[], object]) -> Times:
    """Times that a call takes."""
    begin, before = perf_counter(), process_time()
    call()
    return Times(perf_counter() - begin, process_time() - before)


if __name__ == "__main__":
    main()
