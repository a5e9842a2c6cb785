"""The page of what tests share names every module of it and nothing that is gone; heads of oracles agree with it."""

import ast
import re
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1]
PAGE = (TESTS / "README.md").read_text(encoding="utf-8")
MODULES = dict(re.findall(r"^\| `(\w+)` \|.*\| (.*) \|$", PAGE, re.MULTILINE))  # and what they define
ORACLES = dict(re.findall(r"^\| `(\w+/[^`]+)` \|.*\| (.*) \|$", PAGE, re.MULTILINE))  # and what they share


def names_defined(path):
    """The functions, classes and constants of a module."""
    body = ast.parse(path.read_text(encoding="utf-8")).body
    targets = [node for statement in body if isinstance(statement, ast.Assign) for node in ast.walk(statement)]
    constants = {node.id for node in targets if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)}
    constants |= {node.target.id for node in body if isinstance(node, ast.AnnAssign)}
    return constants | {node.name for node in body if isinstance(node, ast.FunctionDef | ast.ClassDef)}


def test_every_support_module_is_listed():
    there = {path.stem for path in (TESTS / "support").glob("*.py")}
    assert set(MODULES) == {name for name in there if not name.startswith(("test_", "_"))}


@pytest.mark.parametrize("module", MODULES)
def test_every_listed_name_exists(module):
    listed = set(re.findall(r"`(\w+)`", MODULES[module]))
    assert listed
    assert listed - names_defined(TESTS / "support" / f"{module}.py") == set()


def test_every_listed_fixture_exists():
    [line] = [line for line in PAGE.splitlines() if line.startswith("Fixtures of all folders")]
    assert set(re.findall(r"`(\w+)`", line)) - names_defined(TESTS / "conftest.py") == set()


@pytest.mark.parametrize("oracle", ORACLES)
def test_heads_of_oracles_state_what_they_share(oracle):
    files = sorted(TESTS.glob(oracle))
    assert files
    if oracle.endswith(".py"):
        head = ast.get_docstring(ast.parse(files[0].read_text(encoding="utf-8")))
        assert f"Shares with jounce: {ORACLES[oracle]}" in " ".join(head.split())


def test_every_head_that_states_it_is_listed():
    stating = {
        path.relative_to(TESTS).as_posix()
        for path in TESTS.rglob("*.py")
        if path != Path(__file__) and "\nShares with jounce: " in path.read_text(encoding="utf-8")
    }
    assert stating <= set(ORACLES)
