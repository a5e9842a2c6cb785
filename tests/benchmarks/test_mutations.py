"""Mutations of sources: what is changed, what is left alone, and that each change is Python again."""

import ast
from pathlib import Path
from types import CodeType

import pytest
from benchmarks.mutations import find_mutations

import jounce

SOURCES = sorted(Path(jounce.__file__).parent.glob("limits/*.py"))
CHANGES = {
    "bound": ("x = a < b", {("bound", "(a <= b)"), ("comparison", "(a >= b)")}),
    "chain": (
        "x = 0 < a <= 1",
        {
            ("bound", "(0 <= a <= 1)"),
            ("bound", "(0 < a < 1)"),
            ("comparison", "(0 >= a <= 1)"),
            ("comparison", "(0 < a > 1)"),
            ("constant", "(1)"),
            ("constant", "(2)"),
        },
    ),
    "operator": ("x = a + b * c", {("operator", "((a) - (b * c))"), ("operator", "((b) / (c))")}),
    "condition": ("x = a and not b", {("condition", "((a) or (not b))"), ("condition", "(b)")}),
    "choice": ("x = a if b else c", {("condition", "((c) if (b) else (a))")}),
    "sign": ("x = -a", {("sign", "(a)")}),
    "word": ("x = np.max(a)", {("call", "np.min(a)")}),
    "flag": ("x = True", {("constant", "(False)")}),
    "default": ("def f(a=2):\n    return a", {("constant", "(4)")}),
    "annotation": ("x: tuple[int, 3] = a", set()),
    "alias": ("X = Callable[[], 3]", set()),
    "error": ("def f(a):\n    raise ValueError(a + 1)", set()),
    "text": ("x = f'{a + 1}'", set()),
    "lengths of zip": ("x = zip(a, b, strict=True)", set()),
    "strict elsewhere": ("x = reader(a, strict=True)", {("constant", "(False)")}),
    "umlauts before": ("x = 'ä', a < b", {("bound", "(a <= b)"), ("comparison", "(a >= b)")}),
}


@pytest.mark.parametrize(("source", "changes"), CHANGES.values(), ids=CHANGES)
def test_changes(source, changes):
    assert {(x.kind, x.after) for x in find_mutations(source.encode())} == changes


@pytest.mark.sweep(6)
@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.stem)
def test_mutants_are_python_and_no_longer_the_module(path):
    source = path.read_bytes()
    whole = ast.dump(ast.parse(source))
    for mutation in find_mutations(source):
        assert ast.dump(ast.parse(mutation.apply(source))) != whole, mutation


def test_a_mutant_has_as_many_lines_as_the_source():
    source = b"x = (\n    a\n    < b\n)\ny = f(\n    c and\n    d,\n)\n"
    for mutation in find_mutations(source):
        mutated = mutation.apply(source)
        assert mutated.count(b"\n") == source.count(b"\n"), mutation
        ast.parse(mutated)


def test_a_mutation_shows_its_lines():
    source = b"first = 0\nx = (\n    a\n    < b\n)\nlast = 0\n"
    [bound] = [x for x in find_mutations(source) if x.kind == "bound"]
    assert bound.show(source) == ("a < b", "(a <= b)")


def code_names(code):
    """The qualified names of functions and classes of compiled source."""
    parts = [x for x in code.co_consts if isinstance(x, CodeType)]
    return {x.co_qualname for x in parts}.union(*map(code_names, parts))


def test_scopes_are_those_that_python_names():
    source = b"x = 1\nclass A:\n    def f(self):\n        def g():\n            return 2\n        return g\n"
    scopes = {x.scope for x in find_mutations(source)}
    assert "" in scopes
    assert scopes - {""} == {"A.f.<locals>.g"} < code_names(compile(source, "a.py", "exec"))
