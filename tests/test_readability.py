"""Code that is read once: one decision a line, steps that say what they do, few arguments, docstrings with a verb.

Counts are upper bounds, kept at what was reached: who has to raise one says why in the commit.
"""

import ast
import io
import re
import tokenize
from functools import cache

import pytest

from support.imports import GENERATED, module_paths, room_of

CORES = "limits", "identification", "motion", "native", "dynamics", "engine"  # folders of numerical algorithms
CODE_PER_COMMENT = 100 / 6  # lines: a comment before a step of some ten lines, none in functions of five
MOST_WALRUSES = 0  # in conditions of if and while: there they hide that a name gets its value
MOST_PARAMETERS = 6  # below the facade; what travels together is a frozen dataclass
MOST_WORDS = 12  # of the first sentence of a docstring; symbols of a formula do not count
WORD = re.compile(r"[(`]?([a-z]{2,}|a|A|[A-Z][a-z]+|[A-Z]{2,})('s)?[)`',;]*")
WIDE = {  # functions of more parameters, with the reason
    "actuators.motors.motors_along": "the facade, reports and streams call it with the arguments of users",
    "cuda.compile": "public: the arguments of Robot.compile and those of the GPU",
    "dask.apply": "public: a method's name and the arguments of that method",
    "dynamics.paper.C21": "the factors of one printed equation",
    "dynamics.paper.C22": "the factors of one printed equation",
    "engine.plan.compute": "the keywords that all methods of quantities share, on the path of every call",
}
FACADE = "robot", "cli", "motion.motion"  # signatures of users
NO_VERB = re.compile(
    r"(Those|That|These|Such|What|Which|Whose|Where|When|Why|How|By|Of|In|At|From|Within|Inside|Between|Some|One|Its)\b"
)


@cache
def parsed_modules() -> dict[str, tuple[str, ast.Module]]:
    """The text and the tree of each module that somebody edits."""
    texts = {name: path.read_text(encoding="utf-8") for name, path in module_paths().items()}
    edited = {name: text for name, text in texts.items() if GENERATED not in "\n".join(text.splitlines()[:6]).lower()}
    return {name: (text, ast.parse(text)) for name, text in edited.items()}


def nodes(kinds):
    """(module, node) for all nodes of some kinds."""
    return [
        (name, node)
        for name, (_, tree) in parsed_modules().items()
        for node in ast.walk(tree)
        if isinstance(node, kinds)
    ]


def inner_nodes(node):
    return [inner for inner in ast.walk(node) if inner is not node]


def docstring_lines(tree):
    kinds = ast.Module, ast.ClassDef, ast.FunctionDef
    documented = [node for node in ast.walk(tree) if isinstance(node, kinds) and ast.get_docstring(node) is not None]
    return {line for node in documented for line in range(node.body[0].lineno, node.body[0].end_lineno + 1)}


def comment_lines(text):
    """Lines that are a comment alone."""
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    return {token.start[0] for token in tokens if token.type == tokenize.COMMENT and token.line.lstrip()[0] == "#"}


def test_conditional_expressions_are_not_nested():
    nested = [
        f"{module}:{node.lineno}"
        for module, node in nodes(ast.IfExp)
        if any(isinstance(inner, ast.IfExp) for inner in inner_nodes(node))
    ]
    assert nested == []


def test_conditions_rarely_assign():
    walruses = [
        f"{module}:{inner.lineno}"
        for module, node in nodes((ast.If, ast.While))
        for inner in ast.walk(node.test)
        if isinstance(inner, ast.NamedExpr)
    ]
    assert len(walruses) <= MOST_WALRUSES, walruses


def test_functions_take_few_arguments():
    """Those of seven parameters or more below the facade are listed with their reasons, and no others."""
    wide = set()
    for module, node in nodes((ast.FunctionDef, ast.AsyncFunctionDef)):
        arguments = node.args
        names = [argument.arg for argument in (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs)]
        count = len(names) - (names[:1] in (["self"], ["cls"]))
        if count > MOST_PARAMETERS and room_of(module) not in FACADE and module not in FACADE:
            wide.add(f"{module}.{node.name}")
    assert wide == set(WIDE)


@pytest.mark.parametrize("function", ["exec", "eval", "locals"])
def test_no_names_are_looked_up_in_namespaces(function):
    calls = [
        f"{module}:{node.lineno}"
        for module, node in nodes(ast.Call)
        if isinstance(node.func, ast.Name) and node.func.id == function
    ]
    assert calls == []


def test_steps_of_numerical_cores_say_what_they_do():
    code = comments = 0
    for module, (text, tree) in parsed_modules().items():
        if room_of(module) in CORES:
            silent = comment_lines(text)
            skipped = silent | docstring_lines(tree)
            comments += len(silent)
            code += sum(bool(line.strip()) for i, line in enumerate(text.splitlines(), 1) if i not in skipped)
    assert code / comments <= CODE_PER_COMMENT


def first_sentence(node):
    paragraph = " ".join((ast.get_docstring(node) or "").split("\n\n")[0].split())
    return re.split(r"(?<=[a-z0-9)\]`])[.:](?:\s|$)", paragraph)[0]


def docstrings():
    for module, node in nodes((ast.Module, ast.ClassDef, ast.FunctionDef)):
        yield f"{module}.{getattr(node, 'name', '')}", node, first_sentence(node)


def test_first_sentences_of_docstrings_are_short():
    lengths = {
        f"{name}: {sentence}": sum(WORD.fullmatch(word) is not None for word in sentence.split())
        for name, _, sentence in docstrings()
    }
    assert [sentence for sentence, length in lengths.items() if length > MOST_WORDS] == []


def test_docstrings_of_functions_begin_with_a_verb_or_a_noun():
    pronouns = [
        f"{name}: {sentence}"
        for name, node, sentence in docstrings()
        if isinstance(node, ast.FunctionDef) and NO_VERB.match(sentence)
    ]
    assert pronouns == []
