"""What tiers leave out is there."""

import ast

import pytest

from support.tiers import (
    ALWAYS,
    LIMITS,
    LONG_CASE,
    LONG_CASE_OF_LIMITS,
    LONG_TESTS,
    OUTSIDE,
    SLOW_TESTS,
    TESTS,
    is_long,
    listed_tests,
)


@pytest.mark.parametrize("path", [SLOW_TESTS, LONG_TESTS], ids=lambda path: path.stem)
def test_every_listed_test_exists(path):
    """As a function, or a method of a class, of its file."""
    for line in listed_tests(path):
        path, *names = line.split("::")
        tree = ast.parse((TESTS.parent / path).read_text(encoding="utf-8"))
        defined = {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.ClassDef)}
        assert set(names) <= defined, line


def test_what_notices_mutants_is_never_long():
    names = [f"{TESTS.name}/{path}::test" for path in (*ALWAYS, "motion/test_fit.py")]
    assert [name for name in names if is_long(name, 2 * LONG_CASE)] == names[-1:]
    assert not is_long(names[-1], LONG_CASE)
    of_limits = [f"{TESTS.name}/{path}::test" for path in LIMITS]
    assert not any(is_long(name, LONG_CASE_OF_LIMITS) for name in of_limits)
    assert all(is_long(name, 1.01 * LONG_CASE_OF_LIMITS) for name in of_limits)
    assert [name for name in listed_tests(LONG_TESTS) if not is_long(name, 2 * LONG_CASE_OF_LIMITS)] == []
    assert [path for path in ALWAYS if not list(TESTS.glob(f"{path}*"))] == []


def test_every_path_outside_exists():
    assert [path for path in OUTSIDE if not (TESTS / path).exists()] == []
