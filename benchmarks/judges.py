"""A plugin of pytest that shows mutants to tests: it imports and collects once, and judges each mutant in a child.

``MUTANTS_JOB`` is a file of JSON: the folder of the package, the mutants with their tests in order, and the file of
JSON lines to write, one of each mutant. The child gives the live functions the code of the mutated source, and the file
is changed as well: for modules that a test imports, for processes that it starts, and for digests of the code. Nothing
is set up before: fixtures, traced programs and all that is kept in memory are of the mutant, and go with the child.
Where a mutant is to be there before anything is imported ("whole"), the file was changed before this process began.
"""

import gc
import json
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from itertools import zip_longest
from pathlib import Path
from types import CodeType, FunctionType

import pytest

from benchmarks.forks import FAILED, OUT_OF_TIME, limit_time, run_forked, unlimit_time
from benchmarks.mutations import Mutation

SURVIVES, NOTICED, HANGS, NOT_APPLIED = "survives", "noticed", "hangs", "not applied"
FATES = (SURVIVES, NOTICED, HANGS, NOT_APPLIED)  # by the exit status of the child
BEGUN = -1  # in place of the number of a mutant, before anything is imported
# The time in s of the first file that is changed; each later one is of a second later, so that Python, which compares
# times, takes no bytecode of an earlier mutant for that of the file.
FIRST_TIME = 10**9
IMPORT_TIME = 4.0  # s of processor time that importing and collecting take
failed: list[str] = []


def _read_job() -> dict | None:
    """The job; none where the functions of this module are imported by others."""
    path = os.environ.get("MUTANTS_JOB")
    return json.loads(Path(path).read_text(encoding="utf-8")) if path else None


@contextmanager
def changed(path: Path, mutation: Mutation, number: int) -> Iterator[None]:
    """Inside, a file is mutated, with a time that no other mutant has."""
    before, stats = path.read_bytes(), path.stat()
    path.write_bytes(mutation.apply(before))
    os.utime(path, (FIRST_TIME + number, FIRST_TIME + number))
    try:
        yield
    finally:
        path.write_bytes(before)
        os.utime(path, ns=(stats.st_atime_ns, stats.st_mtime_ns))


def replace_code(path: Path, mutation: Mutation, source: bytes) -> bool:
    """Give all live functions of a module the code of its mutated source; False where that leaves the mutant out."""
    if all(getattr(module, "__file__", None) != str(path) for module in list(sys.modules.values())):
        return True  # not imported yet: a test imports the changed file
    old = _codes(compile(source, str(path), "exec"))
    new = _codes(compile(mutation.apply(source), str(path), "exec"))
    gc.unfreeze()  # tests/conftest.py has frozen what was imported, and what is frozen is not listed
    replaced = set()
    for f in gc.get_objects():
        if type(f) is not FunctionType or f.__code__.co_filename != str(path):
            continue
        key = _key(f.__code__)
        if key in new and new[key] != old[key]:
            f.__code__ = new[key]  # raises where the free variables differ
            replaced.add(key[0])
    return mutation.scope.partition(".<locals>")[0] in replaced


def _key(code: CodeType) -> tuple[str, int]:
    return code.co_qualname, code.co_firstlineno


def _codes(code: CodeType) -> dict[tuple[str, int], CodeType]:
    """The code of all functions and classes of compiled source."""
    found = {}
    for part in code.co_consts:
        if isinstance(part, CodeType):
            found |= {_key(part): part, **_codes(part)}
    return found


def judge(items: Sequence[pytest.Item], seconds: Sequence[float]) -> int:
    """Run tests until one fails."""
    try:
        for item, following, time in zip_longest(items, items[1:], seconds):
            limit_time(time, JOB["least_time"])
            item.ihook.pytest_runtest_protocol(item=item, nextitem=following)
            if failed:
                return FATES.index(NOTICED)
    except BaseException:  # a mutant may raise what pytest lets through
        return FATES.index(NOTICED)
    return FATES.index(SURVIVES)


def pytest_runtest_logreport(report):
    """Note that a test failed."""
    if report.failed:
        failed.append(report.nodeid)


def pytest_runtestloop(session):
    """Judge each mutant in a child."""
    unlimit_time()
    items = {item.nodeid: item for item in session.items}
    for given in JOB["mutants"]:
        mutation, path = Mutation(**given["mutation"]), Path(JOB["package"], given["module"])
        source, chosen, seconds = path.read_bytes(), [items[x] for x in given["tests"]], list(given["tests"].values())

        def show(mutation=mutation, path=path, source=source, chosen=chosen, seconds=seconds) -> int:
            if not JOB["whole"] and not replace_code(path, mutation, source):
                return FATES.index(NOT_APPLIED)
            return judge(chosen, seconds)

        with nullcontext() if JOB["whole"] else changed(path, mutation, given["number"]):
            fate = _name_fate(run_forked(show))
        _write(given["number"], fate)
    return True


def _write(number: int, found: str) -> None:
    with Path(JOB["output"]).open("a", encoding="utf-8") as file:
        file.write(json.dumps({"number": number, "found": found}) + "\n")


def _name_fate(status: int) -> str:
    if status in OUT_OF_TIME:
        return HANGS
    if status < 0:  # it crashed
        return NOTICED
    return NOT_APPLIED if status == FAILED else FATES[status]


JOB = _read_job()
if JOB is not None:
    _write(BEGUN, "")
    limit_time(IMPORT_TIME, JOB["least_time"])  # a mutant may hang already when it is imported
