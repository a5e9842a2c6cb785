"""Names of the package and of its tests: each stands for one thing, and says what it is of."""

import ast
import math
import re
from collections import defaultdict
from functools import cache
from pathlib import Path

import numpy as np
import pytest

TESTS = Path(__file__).parent
SOURCE = TESTS.parent / "src" / "jounce"
LONGEST = 60  # letters of a test's name behind "test_": it fits a line of a report
LOCAL = {"arm", "load"}  # names that functions of several files of tests may have
PREPOSITIONS = {
    "about", "above", "across", "after", "against", "along", "among", "around", "as", "at", "before", "behind",
    "below", "beside", "between", "beyond", "by", "despite", "during", "except", "for", "from", "in", "inside",
    "into", "like", "near", "of", "off", "on", "onto", "outside", "over", "past", "per", "since", "than",
    "through", "to", "toward", "towards", "under", "until", "upon", "via", "where", "with", "within", "without",
}  # fmt: skip
CONSTRUCTORS = {"as", "from", "to", "with", "without"}  # from_matrix, to_degrees, with_limits: a noun follows
NUMBERS = (ast.Constant, ast.Tuple, ast.List, ast.UnaryOp, ast.BinOp, ast.operator, ast.unaryop, ast.Load)


@cache
def modules():
    """The trees of all modules by path."""
    return {path.relative_to(SOURCE).as_posix(): ast.parse(path.read_text("utf-8")) for path in SOURCE.rglob("*.py")}


def is_numeric(node):
    """Whether an expression is one of numbers alone, or of functions of NumPy and math of these."""
    return all(
        isinstance(x, (*NUMBERS, ast.Attribute, ast.Call, ast.keyword))
        or (isinstance(x, ast.Name) and x.id in ("np", "math"))
        for x in ast.walk(node)
    ) and not any(isinstance(x, ast.Constant) and not isinstance(x.value, int | float) for x in ast.walk(node))


def constants():
    """(name, module, value) of numeric constants of modules, names without leading underscores."""
    for module, tree in modules().items():
        for node in tree.body:
            if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None:
                continue
            [target] = node.targets if isinstance(node, ast.Assign) else [node.target]
            if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
                pairs = zip(target.elts, node.value.elts, strict=True)
            else:
                pairs = [(target, node.value)]
            for name, value in pairs:
                if isinstance(name, ast.Name) and name.id.isupper() and is_numeric(value):
                    yield name.id.lstrip("_"), module, ast.unparse(value)


def test_no_constant_has_two_values():
    values = defaultdict(dict)
    for name, module, text in constants():
        value = eval(text, {"np": np, "math": math})
        values[name].setdefault(np.asarray(value, dtype=object).tolist().__repr__(), []).append(module)
    assert {name: of_value for name, of_value in values.items() if len(of_value) > 1} == {}


def test_no_class_name_stands_twice():
    places = defaultdict(list)
    for module, tree in modules().items():
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef):
                places[node.name].append(module)
    assert {name: found for name, found in places.items() if len(found) > 1} == {}


def test_no_function_is_a_preposition_or_begins_with_one():
    found = [
        f"{module}: {node.name}"
        for module, tree in modules().items()
        for node in tree.body
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        for first, *rest in [node.name.strip("_").split("_")]
        if first in PREPOSITIONS and not (rest and first in CONSTRUCTORS)
    ]
    assert found == []


def test_no_function_of_tests_is_defined_in_two_files():
    """What several need is in tests/support, what means something else is called something else."""
    places = defaultdict(set)
    for path in TESTS.rglob("*.py"):
        for node in ast.parse(path.read_text(encoding="utf-8")).body if "golden" not in path.parts else ():
            if isinstance(node, ast.FunctionDef) and not node.name.startswith("test_"):
                places[node.name].add(path.relative_to(TESTS).as_posix())
    assert {name: found for name, found in places.items() if len(found) > 1 and name not in LOCAL} == {}


def test_no_file_of_tests_has_the_name_of_another():
    """Pytest imports files of tests by their names alone: the second of a name ends the run."""
    names = [path.name for path in sorted(TESTS.rglob("test_*.py")) if "golden" not in path.parts]
    assert sorted(name for name in set(names) if names.count(name) > 1) == []


@pytest.mark.parametrize("path", sorted(TESTS.rglob("test_*.py")), ids=lambda path: path.stem)
def test_names_of_tests_are_short(path):
    names = re.findall(r"^(?:def )?test_(\w+)(?: =|\()", path.read_text(encoding="utf-8"), re.MULTILINE)
    assert [name for name in names if len(name) > LONGEST] == []
