"""Documents of equations: what they print is right, read back from the LaTeX; what is too large is refused."""

import re
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
import sympy
from test_codegen import ALL, PARAMETERS, computed, in_equations, made_robot, requested, texts

import jounce
from jounce._codegen import latex_document
from support.refusals import refusal

CASES = {
    "symbols": ("symbols", {"order": 2, "outputs": in_equations(ALL), "wrench": True}),
    "all": ("planar2r", {"order": 1, "outputs": in_equations(ALL), "wrench": True, "parameters": PARAMETERS}),
    "numbers": ("planar2r", {"order": 4}),
    "floating": ("floating", {"order": 0, "wrench": True}),
    "moving ground": ("planar2r", {"order": 1, "outputs": ("momentum", "poses:body2"), "moving_base": True}),
    "mimic": ("mimic", {"order": 0, "wrench": True, "parameters": ("payload:body1", "gravity")}),
}
INDEXED = r"(.+?)(grav|G|(?<=Y)[pE]|(?<=F)j|)((?:\d?d)?)"  # a name of results: symbol, index, rate
RATES = {"dot": "d", "ddot": "2d", "dddot": "3d", "ddddot": "4d"}


def python(text):
    r"""LaTeX as Python: \ddot{q}_{1} is q2d_1, a blank is a product where it can be none else."""
    text = re.sub(r"\\(?:left|right|bigl|bigr|mathrm)\b|\\\\|&", " ", text)
    text = re.sub(r"\\bar\{C\}", "Cbar", text).replace("{grav},", "grav")
    text = re.sub(r"_\{([GpEj]),", r"_{\1", text)
    text = re.sub(r"(?<=\d),(?=\d)", "x", text)  # places from 10 on
    text = re.sub(r"\\(d+ot|dot)\{?\\?(\w+)\}?", lambda found: found[2] + RATES.get(found[1], "?"), text)
    text = re.sub(r"\^\{\((\d)\)\}", r"\1d", text)
    text = re.sub(r"_\{ *(\w+)\}", r"_\1", text)
    text = re.sub(r"\^\{(-?\d+)\}", r" ** \1", text)
    text = re.sub(r"(\\(?:sin|cos))\{([^{}]*)\}", r"\1 \2", text)
    while text != (text := re.sub(r"\\frac\{([^{}]*)\}\{([^{}]*)\}", r"((\1) / (\2))", text)):
        pass
    text = text.replace(r"\cdot", " ")
    words = re.findall(r"\*\*|\d[\d.]*|\w+|[-+()=/]", text.replace("{}", ""))
    joined = words[:1]
    for before, word in pairwise(words):
        product = re.match(r"[\w(]", word) and re.match(r"[\w)]", before) and before not in ("sin", "cos")
        joined += ["*", word] if product else [word]
    return " ".join(joined)


def symbol_values(arrays, k):
    """The numbers of a state by the names that `python` gives their symbols."""
    found = {}
    for name, array in arrays.items():
        kind, rate = re.fullmatch(r"(q|W|base_pose|base_twist)(\d?d)?", name).groups(default="")
        rows = array[k].reshape(array.shape[1], -1)
        for i, j in np.ndindex(rows.shape):
            words = {
                "q": f"q{rate}_{i + 1}",
                "W": f"{'mf'[j // 3]}{rate}_{'xyz'[j % 3]}{i + 1}",
                "base_pose": f"R_{i + 1}{j + 1}" if j < 3 else f"r_{'xyz?'[i % 4]}",
                "base_twist": f"{('omega', 'v')[i // 3 % 2]}{rate}_{'xyz'[i % 3]}",
            }
            found[words[kind]] = rows[i, j]
    return found


@cache
def latex_text(case):
    robot, options = CASES[case]
    return next(text for name, text in texts(robot, "latex", 3, **options).items() if name.endswith(".tex"))


@pytest.mark.parametrize("case", CASES)
def test_the_equations_that_are_printed_are_right(case):
    robot, options = CASES[case]
    blocks = re.findall(r"\\begin\{align\*\}\n(.*?)\\end\{align\*\}", latex_text(case), re.DOTALL)
    assert not re.search(r"\\frac\{[\d.]{2,}\}", "".join(blocks))  # decimals remain decimals
    symbols = latex_document.document(requested(robot, "latex", **options).robot).symbols
    for function, expected in zip(*computed(robot, 3, "recursion", **options), strict=True):
        for array in function.outputs:
            equations = [python(x).split(" = ") for x in re.split(r"\n(?=[^&])", blocks.pop(0))]
            for k, p in enumerate(expected.parameter_sets()):
                known = symbol_values(expected.inputs, k) | {"sin": np.sin, "cos": np.cos}
                for name, x in p.items():
                    words = [python(sympy.latex(symbol)) for symbol in symbols[name].flat]
                    known |= dict(zip(words, x.flat, strict=True))
                found = {name.strip(): eval(right, known) for *left, right in equations for name in left}
                for index in np.ndindex(array.shape):
                    row, *rest = index or (0,)  # of the matrices of P, which stand one below the other
                    places = (*divmod(row, array.shape[-1]), *rest) if array.name.startswith("P") else index
                    letter, part, rate = re.fullmatch(
                        r"(.+?)(grav|G|(?<=Y)[pE]|(?<=F)j|)((?:\d?d)?)", array.name
                    ).groups()
                    below = part + ("x" if max(places, default=0) > 8 else "").join(str(i + 1) for i in places)
                    name = "_".join([letter + rate, below]).rstrip("_")
                    error = found[name] - expected.outputs[array.name][(k, *index)]
                    assert abs(error) <= 1e-12 * expected.scale(array.name)
    assert blocks == []


def test_lines_are_as_long_as_paper_is_wide():
    widths = [latex_document._width(line) for line in latex_text("symbols").splitlines() if "& " in line]
    assert latex_document.MAX_LINE_GLYPHS / 2 < max(widths) <= latex_document.MAX_LINE_GLYPHS + 3


def test_text_is_escaped():
    assert latex_document.tex(r"a_b & 50% of \x, m^2") == r"a\char95{}b \char38{} 50\char37{} of \char92{}x, m$^2$"


@pytest.mark.parametrize(("robot", "options", "words"), [
    ("planar2r", {"outputs": ["gravity_forces.vjp"]}, ["gravity_forces.vjp is not written as equations"]),
    ("planar2r", {"outputs": ["forward_dynamics"]}, ["forward_dynamics has no symbolic form", "solve M q2d"]),
    ("planar2r", {"outputs": ["inverse_dynamics_second_partials"]}, ["has no symbolic form", "S.Q.diff(...)"]),
    ("iiwa14", {"order": 2}, ["takes 2213 operations; LaTeX is generated for up to 1200", "into c, ", "python"]),
    ("iiwa14", {"order": 0, "outputs": ["mass_matrix"]}, ["M of 'iiwa14': too large for symbolic form"]),
    ("planar2r", {"float32": True}, ["LaTeX has no single precision"]),
])  # fmt: skip
def test_refusals(robot, options, words, tmp_path):
    refusal(lambda: made_robot(robot).codegen("latex", directory=tmp_path / "new", **options), *words)
    assert list(tmp_path.iterdir()) == []


def test_symbols_that_would_look_alike_are_refused(tmp_path):
    robot = jounce.load("planar2r", L1=sympy.Symbol("c_x"))
    given = {"directory": tmp_path / "new", "parameters": ["payload"]}
    refusal(lambda: robot.codegen("latex", **given), "would both be printed as c_{x}")
