"""What tiers leave out is there."""

import ast

from support.tiers import OUTSIDE, SLOW_TESTS, TESTS


def test_every_slow_test_exists():
    """As a function, or a method of a class, of its file."""
    for line in SLOW_TESTS.read_text(encoding="utf-8").splitlines():
        path, *names = line.split("::")
        tree = ast.parse((TESTS.parent / path).read_text(encoding="utf-8"))
        defined = {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.ClassDef)}
        assert set(names) <= defined, line


def test_every_path_outside_exists():
    assert [path for path in OUTSIDE if not (TESTS / path).exists()] == []
