"""``python -m benchmarks.mutants``: which changes of lines that decide a test notices, by room; writes MUTANTS.md.

The tests of a room run once, and the functions that each calls are recorded. Then mutations of its modules are drawn at
random, each is made in a copy of the sources, and the tests that call the function around it run until one fails, the
quickest first. A mutant that none notices survives: it is equivalent, or a test is missing.
"""

import json
import os
import random
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from queue import SimpleQueue
from tempfile import TemporaryDirectory

import click

from benchmarks import machine
from benchmarks.mutations import Mutation, find_mutations
from benchmarks.tables import paragraph, table
from jounce.core.code_digest import BUILD_FILE
from jounce.io.files import write_whole

ROOT = Path(__file__).parents[1]
LONGEST_TESTS = 90.0  # s of all tests that a mutant is shown to: the quickest that fit
PATIENCE = 5  # times as long as tests took, and a minute more, before a mutant counts as one that hangs
NOTICED, HANGS, SURVIVES = "noticed", "hangs", "survives"


@dataclass(frozen=True)
class Room:
    """Modules of one purpose in ``src/jounce``, and the paths in ``tests`` that are to notice their mutants."""

    modules: tuple[str, ...]
    tests: tuple[str, ...]


ROOMS = {
    "certain digits": Room(
        ("engine/certain_digits.py", "dynamics/steepness.py"),
        ("loops/test_near_singular.py", *(f"dynamics/test_{x}.py" for x in ("steep_drives", "steepness"))),
    ),
    "verdicts": Room(
        tuple(f"limits/{x}.py" for x in ("check", "deviations", "doubts", "uncertain_spans", "verdicts")),
        ("limits", "contacts/test_contact_ratios.py"),
    ),
    "limits": Room(
        tuple(f"limits/{x}.py" for x in ("command_speeds", "explanation", "peaks", "ratios", "slowdown")),
        ("limits",),
    ),
    "guard": Room(
        tuple(f"live/{x}.py" for x in ("guard", "guard_tables")),
        tuple(f"live/test_{x}.py" for x in ("guard", "guard_law", "guard_tables")),
    ),
    "cache": Room(
        ("native/cache.py", "core/code_digest.py"),
        (*(f"native/test_{x}.py" for x in ("kernel_cache", "code_digest")), "cli/test_cli_cache.py"),
    ),
    "readers": Room(
        tuple(f"io/{x}.py" for x in ("csv", "mat", "npz", "parquet", "tables")),
        tuple(
            f"io/test_{x}.py" for x in ("tables", "table_rows", "npz", "mat", "stamps", "log_rows", "defective_logs")
        ),
    ),
}


@dataclass(frozen=True)
class Mutant:
    """A mutation of a module, and the tests that are to notice it."""

    module: str
    mutation: Mutation
    tests: tuple[str, ...]
    seconds: float  # that these tests take


@dataclass(frozen=True)
class Fate:
    """What became of a mutant."""

    mutant: Mutant
    found: str  # one of NOTICED, HANGS, SURVIVES


@click.command()
@click.argument("rooms", nargs=-1, type=click.Choice(list(ROOMS)))
@click.option("--count", default=40, show_default=True, type=click.IntRange(1), help="Mutants drawn in each room.")
@click.option("--seed", default=0, show_default=True, help="Of the mutants that are drawn.")
@click.option(
    "-o", "--output", default=Path(__file__).parent / "MUTANTS.md", type=click.Path(path_type=Path),
    help="Page to write.",
)  # fmt: skip
def main(rooms: tuple[str, ...], count: int, seed: int, output: Path) -> None:
    """Change lines that decide, one at a time, and write which changes the tests notice."""
    found = {}
    with TemporaryDirectory() as folder:
        copies = [copy_sources(Path(folder, str(k))) for k in range(machine.cores())]
        for name in rooms or ROOMS:
            click.echo(f"{name}: recording", err=True)
            mutants = draw(ROOMS[name], record_calls(ROOMS[name], copies[0]), random.Random(seed), count)
            with click.progressbar(length=len(mutants), label=name, file=sys.stderr) as bar:
                found[name] = []
                for fate in judge_all(mutants, copies):
                    found[name].append(fate)
                    bar.update(1)
    with write_whole(output) as part:
        part.write_text("\n".join(page(found, count, seed)), encoding="utf-8")


def copy_sources(folder: Path) -> Path:
    """A checkout with the package alone, to be changed."""
    shutil.copytree(ROOT / "src", folder / "src", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy2(ROOT / BUILD_FILE, folder)  # by which kernels are kept: it is a checkout
    return folder


def run_tests(copy: Path, tests: Sequence[str], more: Mapping[str, str], timeout: float | None = None) -> int:
    """The exit status of pytest for tests on a copy of the package; kernels are kept for the next run."""
    listed = copy / "tests.txt"
    listed.write_text("\n".join(tests), encoding="utf-8")
    paths = os.pathsep.join(map(str, (copy / "src", ROOT / "tests", ROOT)))
    setting = {"PYTHONPATH": paths, "JOUNCE_TEST_KERNELS": str(copy / "kernels"), **more}
    options = ["-x", "-p", "no:xdist", "-p", "no:cacheprovider", "--basetemp", str(copy / "tmp")]
    if more:
        options += ["-p", "benchmarks.callers"]
    command = [sys.executable, "-m", "pytest", *options, f"@{listed}"]
    output = subprocess.DEVNULL
    return subprocess.run(
        command, cwd=ROOT, env=os.environ | setting, stdout=output, stderr=output, timeout=timeout, check=False
    ).returncode


def record_calls(room: Room, copy: Path) -> dict[str, dict[str, dict[str, float]]]:
    """By module and function, the tests that call it and the seconds that each takes."""
    files = {str(copy / "src" / "jounce" / module): module for module in room.modules}
    record = copy / "calls.json"
    more = {"RECORDED_MODULES": os.pathsep.join(files), "RECORDED_CALLS": str(record)}
    if run_tests(copy, [f"tests/{x}" for x in room.tests], more):
        raise click.ClickException(f"tests fail without any change: {', '.join(room.tests)}")
    found = json.loads(record.read_text(encoding="utf-8"))
    return {
        files[file]: {name: {x: found["seconds"][x] for x in tests} for name, tests in names.items()}
        for file, names in found["called"].items()
    }


def draw(
    room: Room, calls: Mapping[str, Mapping[str, Mapping[str, float]]], rng: random.Random, count: int
) -> list[Mutant]:
    """Some mutants of a room, drawn at random; those of lines outside of functions are shown to all tests."""
    every = []
    for module in room.modules:
        of_module = calls.get(module, {})
        anywhere = {test: seconds for tests in of_module.values() for test, seconds in tests.items()}
        for mutation in find_mutations((ROOT / "src" / "jounce" / module).read_bytes()):
            tests = of_module.get(mutation.scope, {}) if mutation.scope else anywhere
            every.append(Mutant(module, mutation, *_quickest(tests)))
    return rng.sample(every, min(count, len(every)))


def _quickest(tests: Mapping[str, float]) -> tuple[tuple[str, ...], float]:
    """The quickest tests that fit into the time for one mutant, and the time that they take."""
    chosen, total = [], 0.0
    for test, seconds in sorted(tests.items(), key=lambda item: item[1]):
        if chosen and total + seconds > LONGEST_TESTS:
            break
        chosen.append(test)
        total += seconds
    return tuple(chosen), total


def judge_all(mutants: Sequence[Mutant], copies: Sequence[Path]) -> Iterator[Fate]:
    """The fates of mutants, as many at once as there are copies of the package."""
    idle: SimpleQueue[Path] = SimpleQueue()
    for copy in copies:
        idle.put(copy)

    def judge_next(mutant: Mutant) -> Fate:
        copy = idle.get()
        try:
            return judge(mutant, copy)
        finally:
            idle.put(copy)

    with ThreadPoolExecutor(len(copies)) as threads:
        yield from threads.map(judge_next, mutants)


def judge(mutant: Mutant, copy: Path) -> Fate:
    """Whether a test notices a mutant."""
    if not mutant.tests:  # no test calls the function
        return Fate(mutant, SURVIVES)
    with changed(copy / "src" / "jounce" / mutant.module, mutant.mutation):
        try:
            status = run_tests(copy, mutant.tests, {}, PATIENCE * mutant.seconds + 60)
        except subprocess.TimeoutExpired:
            return Fate(mutant, HANGS)
    return Fate(mutant, NOTICED if status else SURVIVES)


@contextmanager
def changed(path: Path, mutation: Mutation) -> Iterator[None]:
    """Inside, a file is mutated."""
    before = path.read_bytes()
    path.write_bytes(mutation.apply(before))
    try:
        yield
    finally:
        path.write_bytes(before)


def page(found: Mapping[str, Sequence[Fate]], count: int, seed: int) -> list[str]:
    """The page: counts by room, and each mutant that survived."""
    lines = ["# Mutants", ""]
    lines += paragraph(
        f"Lines that decide were changed one at a time, up to {count} changes in each room, drawn at random (seed"
        f" {seed}). Each was shown to those tests of the room that call the function around it, the quickest first, for"
        f" up to {LONGEST_TESTS:g} s of tests. {date.today():%Y-%m-%d}; `make mutants` writes this page."
    )
    rows = []
    for name, fates in found.items():
        counts = Counter(fate.found for fate in fates)
        noticed = counts[NOTICED] + counts[HANGS]
        rows.append([name, f"{len(fates)}", f"{noticed}", f"{counts[SURVIVES]}", f"{noticed / len(fates):.0%}"])
    lines += table(["room", "mutants", "noticed", "survive", "share"], rows)
    lines += ["## Survivors", ""]
    for name, fates in found.items():
        survivors = [fate.mutant for fate in fates if fate.found == SURVIVES]
        lines += [f"### {name}", ""] if survivors else []
        for x in sorted(survivors, key=lambda x: (x.module, x.mutation.line)):
            m, shown = x.mutation, f"{len(x.tests)} tests" if x.tests else "no test calls it"
            lines.append(f"* `{x.module}` line {m.line}, {m.kind}: `{m.before}` becomes `{m.after}` ({shown})")
        lines += [""] if survivors else []
    return lines


if __name__ == "__main__":
    main()
