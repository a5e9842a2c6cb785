"""``python -m benchmarks.mutants``: which changes of lines that decide a test notices, by room; writes MUTANTS.md.

The tests of a room that `make test` runs run once each, and the functions that each calls are recorded
(`benchmarks.callers`). Then mutations of its modules are drawn at random, and each is shown to the tests that call the
function around it until one fails, the quickest first (`benchmarks.judges`). A mutant that none notices is equivalent,
for a reason that `benchmarks.equivalent_mutants` states, or a test is missing. Records and fates are kept in
``build/mutants``.
"""

import json
import os
import random
import shutil
import subprocess
import sys
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import asdict, dataclass
from datetime import date
from hashlib import sha256
from math import ceil, log10
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import click

from benchmarks import machine
from benchmarks.equivalent_mutants import EQUIVALENT
from benchmarks.judges import BEGUN, HANGS, NOT_APPLIED, NOTICED, SURVIVES, changed
from benchmarks.mutations import Mutation, find_mutations
from benchmarks.tables import paragraph, table
from jounce.core.code_digest import BUILD_FILE, hash_modules
from jounce.io import files

ROOT = Path(__file__).parents[1]
KEPT = ROOT / "build" / "mutants"
TIER = "test"  # of the tests: a change that only `make test-all` notices stays in the code until a release
NO_TESTS = 5  # exit status of pytest where all tests of a file are of other tiers
TIER_FILES = "conftest.py", "long_tests.txt"  # in ``tests``, which choose the tests of a tier
LEAST_TIME = 15.0  # s of processor time before a test hangs: what is compiled again takes longer than was recorded
LONGEST_TESTS = 20.0  # s of processor time of all tests that a mutant is shown to: the quickest that fit


@dataclass(frozen=True)
class Room:
    """Modules of one purpose in ``src/jounce``, and the paths in ``tests`` that are to notice their mutants."""

    modules: tuple[str, ...]
    tests: tuple[str, ...]

    def test_files(self) -> list[str]:
        """The files of its tests, from the root of the checkout."""
        paths = [ROOT / "tests" / x for x in self.tests]
        files = [file for x in paths for file in (sorted(x.rglob("test_*.py")) if x.is_dir() else [x])]
        return [x.relative_to(ROOT).as_posix() for x in files]


ROOMS = {
    "certain digits": Room(
        ("engine/certain_digits.py", "engine/certain_digits.py"),
        ("loops/test_near_singular.py", *(f"dynamics/test_{x}.py" for x in ("steep_drives", "steepness"))),
    ),
    "verdicts": Room(
        tuple(f"limits/{x}.py" for x in ("check", "limited_motion", "worst_values", "verdicts")),
        ("limits", "contacts/test_contact_ratios.py"),
    ),
    "guard": Room(
        ("live/guard.py",),
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
    "limits": Room(  # long after verdicts, which record the same tests
        tuple(f"limits/{x}.py" for x in ("explanation", "ratios", "slowdown", "tried_speeds")),
        ("limits",),
    ),
}


@dataclass(frozen=True)
class Mutant:
    """A mutation of a module, and the seconds of the tests that are to notice it, in their order."""

    module: str
    mutation: Mutation
    tests: dict[str, float]
    whole: bool  # it is to be there before the module is imported


@dataclass(frozen=True)
class Fate:
    """What became of a mutant, and its lines before and after as one each."""

    module: str
    line: int
    before: str
    after: str
    tests: int
    found: str  # one of NOTICED, HANGS, SURVIVES, NOT_APPLIED

    @property
    def reason(self) -> str | None:
        """Why no test can notice it."""
        return EQUIVALENT.get((self.module, self.before, self.after))


@click.command()
@click.argument("rooms", nargs=-1, type=click.Choice(list(ROOMS)))
@click.option("--count", default=40, show_default=True, type=click.IntRange(1), help="Mutants drawn by each seed.")
@click.option(
    "--seed", "seeds", default=(2, 3), show_default=True, multiple=True, help="Of the mutants that are drawn."
)
@click.option("--survivors", is_flag=True, help="Judge again only what survived the last time.")
@click.option("--workers", default=machine.cores(), show_default=True, help="Rooms that are judged at once.")
@click.option(
    "-o", "--output", default=Path(__file__).parent / "MUTANTS.md", type=click.Path(path_type=Path),
    help="Page to write, of all rooms that have been judged.",
)  # fmt: skip
def main(**options: Any) -> None:
    """Change lines that decide, one at a time, and write which changes the tests notice."""
    KEPT.mkdir(parents=True, exist_ok=True)

    def judge_room(name: str) -> None:
        with TemporaryDirectory() as folder:
            copy = copy_sources(Path(folder).resolve())
            package, records = copy / "src" / "jounce", record_calls(ROOMS[name], copy)
            mutants = draw(ROOMS[name], records, package, options["seeds"], options["count"])
            fates = judge_all(mutants, copy, _read_fates(name)["fates"] if options["survivors"] else [])
        drawn = {"date": f"{date.today():%Y-%m-%d}", "seeds": options["seeds"], "count": options["count"]}
        with files.write_whole(KEPT / f"{name}.json") as part:
            part.write_text(json.dumps(drawn | {"fates": [asdict(x) for x in fates]}, indent=1), encoding="utf-8")
        click.echo(f"{name}: {dict(Counter(x.found for x in fates))}", err=True)

    with ThreadPoolExecutor(options["workers"]) as threads:
        list(threads.map(judge_room, options["rooms"] or ROOMS))
    found = {name: _read_fates(name) for name in ROOMS if (KEPT / f"{name}.json").exists()}
    with files.write_whole(options["output"]) as part:
        part.write_text("\n".join(page(found)), encoding="utf-8")


def _read_fates(name: str) -> dict[str, Any]:
    kept = json.loads((KEPT / f"{name}.json").read_text(encoding="utf-8"))
    return kept | {"fates": [Fate(**x) for x in kept["fates"]]}


def copy_sources(folder: Path) -> Path:
    """A checkout with the package alone, to be changed."""
    shutil.copytree(ROOT / "src", folder / "src", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy2(ROOT / BUILD_FILE, folder)  # by which kernels are kept: it is a checkout
    return folder


def run_plugin(plugin: str, given: Sequence[str], job: Mapping[str, Any], copy: Path) -> tuple[int, list[dict]]:
    """The exit status of pytest with a plugin on a copy of the package, and the lines that the plugin writes.

    What is given are files of tests, and further options.
    """
    described, output = copy / "job.json", copy / "output.jsonl"
    output.write_text("")
    described.write_text(json.dumps(dict(job) | {"output": str(output)}), encoding="utf-8")
    paths = os.pathsep.join(map(str, (copy / "src", ROOT / "tests", Path(__file__).parents[1])))
    setting = {"PYTHONPATH": paths, "JOUNCE_TEST_KERNELS": str(copy / "kernels"), "MUTANTS_JOB": str(described)}
    options = ["-p", plugin, "-p", "no:xdist", "-p", "no:cacheprovider", "--basetemp", str(copy / "tmp")]
    with (copy / "log.txt").open("w") as log:
        command = [sys.executable, "-m", "pytest", *options, *given]
        done = subprocess.run(command, cwd=ROOT, env=os.environ | setting, stdout=log, stderr=log, check=False)
    lines = output.read_text(encoding="utf-8").splitlines()
    return done.returncode, [json.loads(line) for line in lines]


def record_calls(room: Room, copy: Path) -> list[dict]:
    """Each test of a room with its seconds and the functions that it calls; kept until sources or the test change.

    Tests of other tiers are left out.
    """
    package, tests = copy / "src" / "jounce", ROOT / "tests"
    chosen = " ".join((tests / x).read_text(encoding="utf-8") for x in TIER_FILES)
    sources = f"{hash_modules(package)} {hash_modules(tests / 'support')} {TIER} {chosen}"
    modules = {str(package / module): module for x in ROOMS.values() for module in x.modules}
    records = []
    for file in room.test_files():
        digest = sha256(f"{sources} {(ROOT / file).read_text(encoding='utf-8')}".encode()).hexdigest()
        place = KEPT / f"{file.replace('/', '.')}-{digest[:12]}.json"
        if not place.exists():
            status, lines = run_plugin("benchmarks.callers", ["--tier", TIER, file], {"files": list(modules)}, copy)
            if failures := [x for line in lines for x in line["failures"]]:
                raise click.ClickException(f"a test fails without any change: {failures[0]}")
            if status not in (0, NO_TESTS):
                raise click.ClickException(f"{file} cannot be recorded: {(copy / 'log.txt').read_text()[-2000:]}")
            for line in lines:
                line["called"] = [(modules[path], name) for path, name in line["called"]]
            with files.write_whole(place) as part:
                part.write_text(json.dumps(lines), encoding="utf-8")
        records += json.loads(place.read_text(encoding="utf-8"))
    return records


def draw(
    room: Room, records: Iterable[Mapping[str, Any]], package: Path, seeds: Sequence[int], count: int
) -> list[Mutant]:
    """Some mutants of a room, drawn at random by each seed; all tests of a module see what importing it calls."""
    callers: dict[tuple[str, str], dict[str, float]] = defaultdict(dict)
    of_module: dict[str, dict[str, float]] = defaultdict(dict)
    imported = set()
    for line in records:
        for module, name in line["called"]:
            if line["test"]:
                callers[module, name][line["test"]] = of_module[module][line["test"]] = line["seconds"]
            else:
                imported.add((module, name))
    processes = {line["test"]: line["seconds"] for line in records if line["starts_processes"] and line["test"]}
    every = []
    for module in room.modules:
        for mutation in find_mutations((package / module).read_bytes()):
            whole = not mutation.scope or (module, mutation.scope) in imported
            tests = of_module[module] if whole else callers[module, mutation.scope]
            every.append(Mutant(module, mutation, _choose_quickest(tests | processes), whole))
    drawn = {i: None for seed in seeds for i in random.Random(seed).sample(range(len(every)), min(count, len(every)))}
    return [every[i] for i in drawn]


def _choose_quickest(tests: Mapping[str, float]) -> dict[str, float]:
    """The quickest tests that fit into the time for one mutant; among those of like time, by file, for its fixtures."""
    chosen, total = {}, 0.0
    for test, seconds in sorted(tests.items(), key=lambda x: x[1]):
        if chosen and total + seconds > LONGEST_TESTS:
            break
        chosen[test] = seconds
        total += seconds
    return dict(sorted(chosen.items(), key=lambda x: (ceil(log10(x[1] + 0.01)), x[0].partition("::")[0], x[1])))


def judge_all(mutants: Sequence[Mutant], copy: Path, kept: Sequence[Fate]) -> list[Fate]:
    """The fates of mutants, without judging again those that were noticed."""
    package = copy / "src" / "jounce"
    found = {}
    noticed = {(x.module, x.line, x.before, x.after): x.found for x in kept if x.found in (NOTICED, HANGS)}
    described = []
    for number, x in enumerate(mutants):
        lines = x.mutation.show((package / x.module).read_bytes())
        described.append((x.module, x.mutation.line, *lines))
        if described[-1] in noticed:
            found[number] = noticed[described[-1]]
        elif not x.tests:  # no test calls the function
            found[number] = SURVIVES
    left = [number for number in range(len(mutants)) if number not in found]
    inside = [number for number in left if not mutants[number].whole]
    for numbers in ([inside] if inside else []) + [[number] for number in left if mutants[number].whole]:
        found |= judge(mutants, numbers, copy)
    return [Fate(*described[k], len(x.tests), found[k]) for k, x in enumerate(mutants)]


def judge(mutants: Sequence[Mutant], numbers: Sequence[int], copy: Path) -> dict[int, str]:
    """The fates of several mutants of functions, or of one that is there before anything is imported."""
    package, first = copy / "src" / "jounce", mutants[numbers[0]]
    given = [
        {"number": k, "module": x.module, "mutation": asdict(x.mutation), "tests": x.tests}
        for k, x in ((k, mutants[k]) for k in numbers)
    ]
    files = sorted({test.partition("::")[0] for x in given for test in x["tests"]})
    job = {"package": str(package), "whole": first.whole, "least_time": LEAST_TIME, "mutants": given}
    before = changed(package / first.module, first.mutation, numbers[0]) if first.whole else nullcontext()
    with before:
        status, lines = run_plugin("benchmarks.judges", files, job, copy)
    found = {line["number"]: line["found"] for line in lines}
    begun = found.pop(BEGUN, None) is not None
    if first.whole and begun and status and not found:  # it cannot be imported, or takes too long
        found = {numbers[0]: NOTICED}
    if missing := set(numbers) - found.keys():
        raise click.ClickException(f"mutants {missing} were not judged: {(copy / 'log.txt').read_text()[-2000:]}")
    return found


def page(found: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """The page: counts by room, rooms that were not judged, and each mutant that survived."""
    lines = ["# Mutants", ""]
    lines += paragraph(
        "Lines that decide were changed one at a time, at places drawn at random by each seed. Each change was shown to"
        " those tests of the room that `make test` runs and that call the function around it, the quickest first, for"
        f" up to {LONGEST_TESTS:g} s of processor time of tests. A mutant that no test notices is equivalent, for the"
        " reason below, or survives: a test is missing. `make mutants` writes this page."
    )
    rows, explained, survivors = [], [], []
    for name, room in found.items():
        fates = room["fates"]
        unnoticed = [x for x in fates if x.found not in (NOTICED, HANGS)]
        equivalent = [x for x in unnoticed if x.found == SURVIVES and x.reason]
        others = [x for x in unnoticed if x not in equivalent]
        share = 1 - len(others) / len(fates)
        seeds = ", ".join(map(str, room["seeds"]))
        counts = len(fates), len(fates) - len(unnoticed), len(equivalent), len(others)
        rows.append([name, *map(str, counts), f"{share:.0%}", seeds, f"{room['count']}", room["date"]])
        explained += _list_mutants(name, equivalent)
        survivors += _list_mutants(name, others)
    head = ["room", "mutants", "noticed", "equivalent", "survive", "noticed or equivalent", "seeds", "drawn", "date"]
    lines += table(head, rows)
    if missing := [name for name in ROOMS if name not in found]:
        lines += paragraph(f"Not judged yet: {', '.join(missing)}.")
    lines += ["## Survivors", "", *survivors] if survivors else []
    lines += ["## Equivalent mutants", "", *explained] if explained else []
    return lines


def _list_mutants(name: str, fates: Iterable[Fate]) -> list[str]:
    """A section of mutants by module and line."""
    lines = []
    for x in sorted(fates, key=lambda x: (x.module, x.line)):
        why = x.reason or ("it could not be applied" if x.found == NOT_APPLIED else f"{x.tests} tests call it")
        lines.append(f"* `{x.module}`: `{x.before}` becomes `{x.after}`: {why}")
    return [f"### {name[0].upper()}{name[1:]}", "", *lines, ""] if lines else []


if __name__ == "__main__":
    main()
