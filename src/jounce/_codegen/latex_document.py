"""Write equations for readers: the symbolic form of a quantity as lines of LaTeX, broken where a line of paper ends.

`document` is the door: the templates of LaTeX call it for a robot whose parameters become symbols that all look
different, and print the equations of each function of the `Document`. An entry of a matrix is a sum of terms with their
signs (`_pieces`); a product with a sum in it that is too long is written term by term. Widths are counted in glyphs.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from jounce._codegen.function import Function, ParametricRobot
from jounce._codegen.header import printable
from jounce._codegen.symbolic import EXTERNAL, Symbolic, missing_form, symbolic
from jounce.core.errors import JounceError
from jounce.dynamics.computation import Computation, Port
from jounce.engine.engine import Engine

MAX_LINE_GLYPHS = 72  # which fit between the margins of the document
MAX_EQUAL_PER_LINE = 4  # names of equal entries before "=": the expression still fits behind them
LETTERS = {
    "gravity": "g", "masses": "m", "lengths": "r", "mass": "m", "com": "c", "inertia": "I", "stiffness": "K",
    "rotor": "B",
}  # fmt: skip
PER_BODY_OR_JOINT = ("masses", "stiffness", "rotor")  # parameters with a number for each body or coordinate
AXIS_SUBSCRIPTS = {3: ("x", "y", "z"), 6: ("xx", "xy", "xz", "yy", "yz", "zz")}  # of positions and of moments
RATE_DOTS = ("", r"\dot", r"\ddot", r"\dddot", r"\ddddot")


@dataclass(frozen=True, eq=False)
class Document:
    """The symbols of a robot's parameters, and its equations."""

    symbols: dict[str, np.ndarray]
    form: Symbolic

    def printed(self, name: str) -> str:
        """Return the symbols of a parameter as LaTeX."""
        import sympy

        return ", ".join(f"${sympy.latex(x)}$" for x in self.symbols[name].flat)

    def equations(self, function: Function) -> Iterator[list[list[str]]]:
        """Return the equations of each output of a function.

        Every entry comes in lines.
        """
        asked = function.computation
        row, symbol, all_series = asked.quantity, asked.quantity.gives.symbol, self.form.series
        reason = missing_form(row)
        if reason is not None:
            raise JounceError(reason)
        # The part of wrenches is a series of its own.
        if row.of_bodies:
            series = self.form.of_bodies(row.name, asked.body, asked.frame)
        elif asked.wrench:
            series = all_series[symbol] + all_series[symbol + EXTERNAL]
        else:
            series = all_series[symbol]
        tex_symbol = row.printed.tex_symbol or symbol
        return (list(_entries(series[port.rate], tex_symbol, port)) for port in function.outputs)


def document(robot: ParametricRobot, base: bool = False) -> Document:
    """Return the document of a robot in symbols.

    Its parameters become symbols that all look different. With `base`, its base moves as symbols say; else it is the
    ground at rest.
    """
    import sympy

    symbols = {name: _symbols(name, shape) if name in robot.own else np.array(sympy.Symbol(name), dtype=object)
               for name, shape in robot.shapes.items()}  # fmt: skip
    # q_1 and q1 are two symbols that SymPy prints alike.
    printed = [sympy.latex(x) for array in symbols.values() for x in array.flat]
    repeated = next((text for text in printed if printed.count(text) > 1), None)
    if repeated is not None:
        raise JounceError(
            f"two parameters would both be printed as {repeated}; expected another name of the robot's symbol"
        )
    engine = Engine(robot.mechanism(symbols))
    if engine.mechanism.closure is not None:
        raise JounceError(
            f"{engine.mechanism.name!r} has closed loops, and its equations are no sums of products; robot.symbolic()"
            " has those in all coordinates, with the constraint"
        )
    return Document(symbols, symbolic(engine, base))


def tex(text: str) -> str:
    """Return a text as LaTeX prints it, m^2 with a square."""
    plain = re.sub(r"[\\&%$#_{}~<>|]", lambda found: f"\\char{ord(found[0])}{{}}", text)
    return re.sub(r"\^(\w?)", lambda found: f"$^{found[1]}$" if found[1] else "\\char94{}", plain)


def heading(asked: Computation) -> str:
    """Return the heading of a quantity: its caption, its body and its frame."""
    row = asked.quantity
    frame = f", frame {asked.frame}" if row.gives.frames else ""
    of_body = "" if asked.body is None else f": {printable(asked.body)}{frame}"
    return tex(f"{row.printed.caption[:1].upper()}{row.printed.caption[1:]}{of_body}")


def formula(asked: Computation) -> str:
    """Return the formula of a quantity, with what wrenches add."""
    row = asked.quantity
    return f"{row.printed.tex} + {row.printed.wrench_tex}" if asked.wrench else row.printed.tex


def _entries(matrix: Any, symbol: str, port: Port) -> Iterator[list[str]]:
    """Yield the entries of a matrix in lines.

    Equal entries come together.
    """
    from sympy import NDimArray

    # A column is indexed by one number, a single expression by none.
    names_by_entry: dict[Any, list[str]] = {}
    for index in np.ndindex(*(matrix.shape if isinstance(matrix, NDimArray) else port.shape)):
        if len(index) == 0:
            entry = matrix
        elif len(index) == 1:
            entry = matrix[index[0]]
        else:
            entry = matrix[index]
        names_by_entry.setdefault(entry, []).append(_symbol(symbol, port.rate, index))
    for entry, names in names_by_entry.items():
        starts = [" = ".join(names[i : i + MAX_EQUAL_PER_LINE]) for i in range(0, len(names), MAX_EQUAL_PER_LINE)]
        glyphs_left = MAX_LINE_GLYPHS - max(map(_width, starts))
        yield from (_break_lines(f"{start} ={{}} &", list(_pieces(entry, glyphs_left))) for start in starts)


def _symbol(symbol: str, k: int, index: Sequence[int]) -> str:
    """Return a symbol as it is printed: dots for its rates, its entry below."""
    letter, _, below = symbol.partition("_")
    places = ("" if max(index, default=0) < 9 else ",").join(str(i + 1) for i in index)
    below = ",".join(x for x in (below[1:-1], places) if x)
    return (f"{RATE_DOTS[k]}{{{letter}}}" if k else letter) + (f"_{{{below}}}" if below else "")


def _pieces(x: Any, max_glyphs: int) -> Iterator[str]:
    """Yield the terms of an expression with their signs.

    A product with a sum in it that is too long for a line comes term by term.
    """
    import sympy

    for term in x.as_ordered_terms() if x.is_Add else [x]:
        text = sympy.latex(term)
        sums = [factor for factor in sympy.Mul.make_args(term) if factor.is_Add]
        if _width(text) <= max_glyphs or len(sums) == 0:
            yield _with_sign(text)
            continue
        # f (a + b + c) as the pieces f (a, + b, + c): the longest sum is broken, all other factors stand in front.
        longest = max(sums, key=lambda factor: len(factor.args))
        others = term / longest  # SymPy may multiply a number into a sum
        front = {1: "", -1: "-"}.get(others, sympy.latex(others))
        first, *middle, last = _pieces(longest, max_glyphs)
        front = f"\\left({front}\\right)" if others.is_Add else front
        yield f"{_with_sign(front)} \\bigl({first.removeprefix('+ ')}"
        yield from middle
        yield f"{last}\\bigr)"


def _with_sign(text: str) -> str:
    return f"- {text[1:].lstrip()}" if text.startswith("-") else f"+ {text}"


def _break_lines(start: str, pieces: Sequence[str]) -> list[str]:
    """Return a sum in lines that fit on paper.

    The first line begins with what the sum is equal to.
    """
    lines = [f"{start} {pieces[0].removeprefix('+ ')}"]
    for piece in pieces[1:]:
        if _width(lines[-1]) + _width(piece) <= MAX_LINE_GLYPHS:
            lines[-1] += f" {piece}"
        else:
            lines.append(f"& {piece}")
    return lines


def _width(text: str) -> int:
    """Return about how many glyphs a text has when it is set."""
    # Commands that make no glyph are dropped, Greek letters count as one, sin and cos as three, signs with their space.
    text = re.sub(r"\\(left|right|bigl|bigr|mathrm|bar|dot|d+ot)\b", "", text)
    text = re.sub(r"\\[a-zA-Z]+", lambda found: found[0][1:] if found[0] in (r"\sin", r"\cos") else "x", text)
    return len(re.sub(r"[\s{}_^&]", "", text)) + len(re.findall(r" [-+=] ", text))


def _symbols(name: str, shape: Sequence[int]) -> np.ndarray:
    """Return the symbols of a parameter as on paper: g_x, m_1, r_x1, m_p, c_x, ..."""
    import sympy

    # payload2_mass is m_p2: its stem numbers the payload, its part says what it is.
    stem, _, part = name.rpartition("_")
    number = stem.removeprefix("payload") if stem else ""
    letter = LETTERS[part]
    if stem == "" and len(shape) == 1 and part in PER_BODY_OR_JOINT:
        names = [f"{letter}_{i + 1}" for i in range(*shape)]
    elif len(shape) == 0:
        names = [f"{letter}_p{number}" if stem else letter]
    elif len(shape) == 1:
        names = [f"{letter}_{axis}{number}" for axis in AXIS_SUBSCRIPTS[shape[0]]]
    else:
        names = [f"{letter}_{axis}{i + 1}" for i in range(shape[0]) for axis in AXIS_SUBSCRIPTS[3]]
    return np.array([sympy.Symbol(x) for x in names], dtype=object).reshape(shape)
