"""The expressions of the planar 2R in the page of the paper's examples are those that jounce derives."""

import re
from pathlib import Path

import pytest

import jounce

PAGE = Path(__file__).parents[2] / "docs" / "derivation" / "examples.md"
sympy = pytest.importorskip("sympy")


def page_expressions():
    """The formulas of the page in SymPy, by their left sides; a formula that begins with a space goes on."""
    joined = re.sub(r"\$\$\s+\$\$\\qquad ", " ", PAGE.read_text(encoding="utf-8"))
    for name, formula in re.findall(r"^\$\$((?:\\d+ot)?\\tau_\d) = (.*)\$\$$", joined, re.MULTILINE):
        text = re.sub(r"\\(d+)ot q_(\d)", lambda found: f"q{found[1]}ot{found[2]}", formula)
        text = re.sub(r"_\{?(\d+)\}?", r"\1", text)
        text = re.sub(r"(?<=[\w)]) (?=[\w(])", "*", text).replace("^", "**")
        yield name, sympy.sympify(text)


def test_formulas_of_the_planar_2r():
    names = ("L1", "L2", "m1", "m2", "g")
    S = jounce.load("planar2r", **dict(zip(names, sympy.symbols(names), strict=True))).symbolic()
    q1, q2 = S.q
    short = {f(sum(angle)): sympy.Symbol(f"{f.__name__[0]}{name}") for f in (sympy.sin, sympy.cos)
             for name, angle in (("1", [q1]), ("2", [q2]), ("12", [q1, q2]))}  # fmt: skip
    found = dict(page_expressions())
    assert len(found) == 6
    for dots, tau in (("", S.Q), (r"\dot", S.Qd), (r"\ddot", S.Q2d)):
        for i in range(2):
            difference = tau[i].expand().subs(short) - found[rf"{dots}\tau_{i + 1}"]
            assert difference.expand() == 0
