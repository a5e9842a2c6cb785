"""Mutants are judged as they are: applied wherever their code runs, noticed where a test fails, and else survivors."""

import pytest
from benchmarks.equivalent_mutants import EQUIVALENT
from benchmarks.mutations import find_mutations

pytest.importorskip("resource")  # children are forked, which Windows cannot

from benchmarks.judges import HANGS, NOT_APPLIED, NOTICED, SURVIVES

from benchmarks import mutants

DECISIONS = """
from functools import cache

LIMIT = 3


class Scale:
    def __init__(self, unit=5):
        self.unit = unit


def is_beyond(x):
    return x > LIMIT


@cache
def largest(values):
    return max(values)


def doubled(x):
    def times(y):
        return 2 * y

    return times(x)


def make_law(gain):
    def law(x):
        return gain + x

    return law


LAW = make_law(1)


def count_down(n):
    while n > 0:
        n = n - 1
    return n


def unread(x):
    return x + 7


def from_a_process(x):
    return x + 9


def borrowed(x):
    return x + 13


borrowed.__code__ = compile("def borrowed(x): return x + 13", "elsewhere", "exec").co_consts[0]
"""
LONG = """
from jounce.decisions import unread


def test_long():
    assert unread(1) == 8
"""
CONFTEST = """
def pytest_addoption(parser):
    parser.addoption("--tier", default="all")


def pytest_collection_modifyitems(config, items):
    if config.option.tier == "test":
        items[:] = [item for item in items if item.name != "test_long"]
"""
LATER = "def kept(x):\n    return x + 11\n"
TESTS = """
import subprocess
import sys

import pytest
from jounce import decisions
from jounce.decisions import LAW, LIMIT, Scale, count_down, doubled, from_a_process, is_beyond, largest, unread


@pytest.fixture(scope="module")
def of_fixture():
    return doubled(2)


def test_bound():
    assert is_beyond(3.5)
    assert not is_beyond(2)


def test_limit():
    assert LIMIT == 3
    assert Scale().unit == 5


def test_cached():
    assert largest((1, 2)) == 2


def test_fixture_first(of_fixture):
    assert of_fixture > 0


def test_fixture_next(of_fixture):
    assert of_fixture == 4


def test_law():
    assert LAW(2) == 3


def test_count():
    assert count_down(3) == 0


def test_unread():
    unread(1)


def test_later():
    from jounce import later

    assert later.kept(1) == 12


def test_process():
    program = "from jounce.decisions import from_a_process; print(from_a_process(1))"
    assert subprocess.run([sys.executable, "-c", program], capture_output=True, check=True).stdout == b"10\\n"
"""
FATES = {  # by the mutated line and what becomes of it
    ("LIMIT = 3", "LIMIT = (6)"): NOTICED,
    ("def __init__(self, unit=5):", "def __init__(self, unit=(10)):"): NOTICED,
    ("return x > LIMIT", "return (x >= LIMIT)"): SURVIVES,
    ("return x > LIMIT", "return (x <= LIMIT)"): NOTICED,
    ("return max(values)", "return min(values)"): NOTICED,
    ("return 2 * y", "return ((2) / (y))"): NOTICED,
    ("return 2 * y", "return (4) * y"): NOTICED,
    ("return gain + x", "return ((gain) - (x))"): NOTICED,
    ("LAW = make_law(1)", "LAW = make_law((2))"): NOTICED,
    ("while n > 0:", "while (n >= 0):"): NOTICED,
    ("while n > 0:", "while (n <= 0):"): NOTICED,
    ("while n > 0:", "while n > (1):"): NOTICED,
    ("n = n - 1", "n = ((n) + (1))"): HANGS,
    ("n = n - 1", "n = n - (2)"): NOTICED,
    ("return x + 7", "return ((x) - (7))"): SURVIVES,
    ("return x + 7", "return x + (14)"): SURVIVES,
    ("return x + 9", "return ((x) - (9))"): NOTICED,
    ("return x + 9", "return x + (18)"): NOTICED,
    ("return x + 13", "return ((x) - (13))"): NOT_APPLIED,
    ("return x + 13", "return x + (26)"): NOT_APPLIED,
    (
        'borrowed.__code__ = compile("def borrowed(x): return x + 13", "elsewhere", "exec").co_consts[0]',
        'borrowed.__code__ = compile("def borrowed(x): return x + 13", "elsewhere", "exec").co_consts[(1)]',
    ): NOTICED,
    ("return x + 11", "return ((x) - (11))"): NOTICED,
    ("return x + 11", "return x + (22)"): NOTICED,
}


@pytest.fixture
def checkout(tmp_path, monkeypatch):
    """A checkout of two small modules with their tests, in the place of that of jounce."""
    package = tmp_path / "src" / "jounce"
    package.mkdir(parents=True)
    (tmp_path / "tests" / "support").mkdir(parents=True)
    (tmp_path / mutants.BUILD_FILE).touch()
    (package / "__init__.py").touch()
    (package / "decisions.py").write_text(DECISIONS)
    (package / "later.py").write_text(LATER)
    (tmp_path / "tests" / "conftest.py").write_text(CONFTEST)
    (tmp_path / "tests" / "long_tests.txt").touch()
    (tmp_path / "tests" / "test_decisions.py").write_text(TESTS)
    (tmp_path / "tests" / "test_long.py").write_text(LONG)
    room = mutants.Room(("decisions.py", "later.py"), ("test_decisions.py", "test_long.py"))
    monkeypatch.setattr(mutants, "ROOT", tmp_path)
    monkeypatch.setattr(mutants, "KEPT", tmp_path)
    monkeypatch.setattr(mutants, "ROOMS", {"decisions": room})
    monkeypatch.setattr(mutants, "LEAST_TIME", 2)
    return mutants.copy_sources(tmp_path / "copy"), room


def judge_checkout(checkout):
    copy, room = checkout
    drawn = mutants.draw(room, mutants.record_calls(room, copy), copy / "src" / "jounce", [0], 1000)
    return {(x.before, x.after): x.found for x in mutants.judge_all(drawn, copy, [])}


def test_mutants_are_applied_wherever_their_code_runs(checkout):
    assert judge_checkout(checkout) == FATES


def test_the_page_counts_and_explains(monkeypatch):
    monkeypatch.setattr(mutants, "ROOMS", {"guard": None})
    monkeypatch.setattr(mutants, "EQUIVALENT", {("a.py", "x < 1", "(x <= 1)"): "x is never 1"})
    found = [("x < 1", "(x <= 1)", SURVIVES), ("x < 2", "(x <= 2)", SURVIVES), ("x < 3", "(x <= 3)", NOT_APPLIED)]
    found += [("x < 4", "(x <= 4)", NOTICED), ("x < 5", "(x <= 5)", HANGS)]
    fates = [mutants.Fate("a.py", 7, before, after, 3, fate) for before, after, fate in found]
    text = "\n".join(mutants.page({"guard": {"fates": fates, "seeds": [2, 3], "count": 40, "date": "2026-01-01"}}))
    assert "| guard | 5 | 2 | 1 | 2 | 60% | 2, 3 | 40 | 2026-01-01 |" in text
    survivors, explained = text.split("## Equivalent mutants")
    assert "* `a.py`: `x < 1` becomes `(x <= 1)`: x is never 1" in explained
    assert "* `a.py`: `x < 2` becomes `(x <= 2)`: 3 tests call it" in survivors
    assert "* `a.py`: `x < 3` becomes `(x <= 3)`: it could not be applied" in survivors
    assert "x < 4" not in text
    assert "Not judged yet" not in text


def test_the_page_names_what_was_not_judged(monkeypatch):
    monkeypatch.setattr(mutants, "ROOMS", dict.fromkeys(["guard", "cache", "readers"]))
    fates = [mutants.Fate("a.py", 7, "x < 1", "(x <= 1)", 3, NOTICED)]
    text = mutants.page({"cache": {"fates": fates, "seeds": [2], "count": 1, "date": "2026-01-01"}})
    assert "Not judged yet: guard, readers." in text


def test_every_reason_belongs_to_a_mutant_of_the_sources():
    package, shown = mutants.ROOT / "src" / "jounce", set()
    for module in {module for module, _, _ in EQUIVALENT}:
        source = (package / module).read_bytes()
        shown |= {(module, *mutation.show(source)) for mutation in find_mutations(source)}
    assert EQUIVALENT.keys() - shown == set()
