"""Users read plain technical English: phrases that had to be read twice do not come back."""

import ast
import re
from pathlib import Path

import click
import pytest

from jounce.cli import main

ROOT = Path(__file__).parents[1]
SOURCES = sorted((ROOT / "src/jounce").rglob("*.py"))
PAGES = [*ROOT.glob("*.md"), *sorted((ROOT / "docs").rglob("*.md")), *sorted((ROOT / "src/jounce").rglob("*.jinja"))]
UNITS = "joint|body|row|state|quantity|coordinate|line|file|block"
FORBIDDEN = re.compile(
    r"\b(tell|tells|telling|told)\b|"
    r"\b(is|are) none\b|\bis not one\b(?! of)|\bso many\b|\bwhere asked\b|\bbeside\b|\banew\b|\bof yours\b|, say\b"
    rf"|\bthe house\b|\brooms\b|\bwitness\b|\b(rows?|columns?|curve|panel|entry|entries|numbers?|ns|one) a ({UNITS})\b"
    # Sentences that newcomers stumbled over: relative clauses in place of nouns, things that speak or cure.
    r"|(?i:\bwould not show\b|\bdo(es)? not stand out\b|\bserves no feedback\b|\bnames begin with\b)"
    r"|(?i:\bwhose positions they\b|\bcommand line win\b|\bstates no (limits|stiffness)\b|\bis itself beyond\b)"
    r"|(?i:\bneither \w+ nor \w+ cures?\b|\bwith not the\b|\benter otherwise\b|\bhas no armature to take\b)"
    r"|(?i:\bbodies can exist\b|\bfollow them too\b)"
)


def strings_of(path):
    """The strings of a module, docstrings among them, or the paragraphs of a page or template."""
    source = path.read_text(encoding="utf-8")
    if path.suffix != ".py":
        return source.split("\n\n")
    return [
        node.value
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    ]


@pytest.mark.parametrize("path", [*SOURCES, *PAGES], ids=lambda path: str(path.relative_to(ROOT)))
def test_no_text_has_a_forbidden_phrase(path):
    assert [match.group() for text in strings_of(path) for match in FORBIDDEN.finditer(" ".join(text.split()))] == []


def commands(command):
    inner = command.commands.values() if isinstance(command, click.Group) else ()
    return [command, *(found for each in inner for found in commands(each))]


@pytest.mark.parametrize("command", commands(main), ids=lambda command: command.name)
def test_every_option_says_what_it_does(command):
    helps = [option.help for option in command.params if isinstance(option, click.Option)]
    assert [text for text in helps if not text or text.startswith(("Of ", "In ", "Such "))] == []


def test_the_glossary_has_the_terms_of_the_field():
    glossary = (ROOT / "docs/glossary.md").read_text(encoding="utf-8")
    terms = re.findall(r"^\| ([^|]+) \|", glossary, re.MULTILINE)[1:]
    assert terms == sorted(terms, key=str.lower)
    assert {"rate", "twist", "wrench", "screw", "base wrench", "RNEA", "CRBA", "ABA", "regressor"} <= set(terms)
