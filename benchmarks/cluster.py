"""``python -m benchmarks.cluster``: forces of states in Parquet files on workers of Dask, one process and several.

Each run is compared with one without a cluster, to the last bit; in one of them a worker is killed.
"""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from shutil import rmtree, which
from tempfile import TemporaryDirectory
from threading import Timer
from time import perf_counter, process_time
from typing import NamedTuple

import click

from benchmarks import machine
from benchmarks.state_files import ORDER, generate, sums
from jounce.io import files


class Measured(NamedTuple):
    """A run: its seconds on the clock, those of processors of the command and of workers, and whether bits agree."""

    name: str
    elapsed: float
    command: float
    workers: float | None
    same: bool


@click.command()
@click.option("--rows", default=4_000_000, show_default=True, type=click.IntRange(1000), help="Number of states.")
@click.option("--folder", type=click.Path(path_type=Path), help="Folder for the files; default: a temporary one.")
@click.option(
    "-o", "--output", default=Path(__file__).with_name("CLUSTER.md"), type=click.Path(path_type=Path), help="Page."
)
def main(rows: int, folder: Path | None, output: Path) -> None:
    """Measure jounce run --cluster over tables of many states, and write a page about it."""
    with TemporaryDirectory(dir=folder) as place:
        before = machine.load()
        found = list(measured(Path(place), rows))
    lines = [
        "# Clusters",
        "",
        f"{rows:,} states of the iiwa at order {ORDER} in Parquet files. Workers are processes of one thread on this",
        "machine that have imported jounce; the time of a run includes the start of the command. Processor times say",
        "more than elapsed ones where the machine is busy with other things.",
        "",
        "| run | elapsed, s | processor time of the command, s | of the workers, s | bits of the output |",
        "|---|---|---|---|---|",
    ]
    for row in found:
        workers = "-" if row.workers is None else f"{row.workers:.1f}"
        bits = "the same" if row.same else "NOT the same"
        lines.append(f"| {row.name} | {row.elapsed:.1f} | {row.command:.1f} | {workers} | {bits} |")
    lines += ["", "## Machine", "", f"* topology: {topology()}"]
    lines += [f"* {name}: {value}" for name, value in machine.described()]
    lines += [f"* load before and after: {before}, {machine.load()}", ""]
    with files.write_whole(output) as part:
        part.write_text("\n".join(lines), encoding="utf-8")
    click.echo("\n".join(lines))


def measured(folder: Path, rows: int) -> Iterator[Measured]:
    """The runs: without a cluster, on as many workers as there are cores and on one, and with one that is killed."""
    source = folder / "states"
    generate(source, rows)
    first, expected = run("no cluster", source, folder / "out", [])
    yield first
    for count in sorted({1, machine.cores()}):
        with cluster(count) as client:
            address = client.scheduler.address
            for kill in (False, True)[: 1 + (count > 1)]:
                name = f"{count} worker{'s' * (count > 1)}" + ", one killed in the middle" * kill
                before = sum(client.run(process_time).values())
                if kill:
                    [process, *_] = client.run(os.getpid).values()
                    Timer(first.elapsed / 2, os.kill, (process, signal.SIGKILL)).start()
                found, bits = run(name, source, folder / "out", ["--cluster", address])
                workers = None if kill else sum(client.run(process_time).values()) - before
                yield found._replace(workers=workers, same=bits == expected)


def run(name: str, source: Path, output: Path, options: list[str]) -> tuple[Measured, dict[str, str]]:
    """Run the command; returns the times and the checksums of the output, which is removed."""
    command = [sys.executable, "-m", "jounce", "run", "iiwa14", str(source), "-o", str(output), *options]
    begin = perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    elapsed = perf_counter() - begin
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"jounce run ends with {process.returncode}")
    found = sums(output)
    rmtree(output)
    return Measured(name, elapsed, usage.ru_utime + usage.ru_stime, None, True), found


@contextmanager
def cluster(count: int) -> Iterator:  # type: ignore[type-arg]
    """A client of some workers, which have imported jounce."""
    from distributed import Client, LocalCluster

    from jounce.stream.cluster import version

    with (
        LocalCluster(
            n_workers=count, threads_per_worker=1, memory_limit=0, silence_logs=50,
            dashboard_address=":0", scheduler_kwargs={"dashboard": False},
        ) as found,
        Client(found) as client,
    ):  # fmt: skip
        client.run(version)
        yield client


def topology() -> str:
    """How the cores of this machine hang together, as far as the system tells."""
    if which("lscpu") is None:
        return f"{machine.cores()} cores"
    said = subprocess.run(["lscpu"], capture_output=True, text=True, check=True).stdout
    wanted = ("CPU(s)", "Socket(s)", "Core(s) per socket", "Thread(s) per core", "NUMA node(s)", "Hypervisor vendor")
    pairs = (line.split(":", 1) for line in said.splitlines() if ":" in line)
    return ", ".join(f"{name.strip()} {value.strip()}" for name, value in pairs if name.strip() in wanted)


if __name__ == "__main__":
    main()
