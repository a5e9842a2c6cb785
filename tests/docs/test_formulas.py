"""Formulas of the documentation in MathML: names of functions stand apart from their neighbours, as TeX sets them."""

import re

import formulas
import pytest


@pytest.mark.parametrize(
    ("latex", "text"),
    [
        (r"\sin q", "sin q"),
        (r"\cos 2 q_2", "cos 2q2"),
        (r"10 \sin(\pi t)", "10 sin(\u03c0t)"),
        (r"2\sin{\left(q\right)}", "2 sin(q)"),
        (r"- q^2 \cot q", "\u2212q2 cot q"),
        (r"a \tanh^2(x)", "a tanh2(x)"),
        (r"(\sin q)", "(sin q)"),
    ],
)
def test_functions_are_spaced(latex, text):
    pytest.importorskip("latex2mathml")
    markup = formulas.mathml(latex, False).replace(formulas.THIN_SPACE, " ")
    assert formulas.unescape(re.sub("<[^>]*>", "", markup)) == text
