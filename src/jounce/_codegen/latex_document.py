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
LETTERS = {"gravity": "g", "masses": "m", "lengths": "r", "mass": "m", "com": "c", "inertia": "I"}
AXIS_SUBSCRIPTS = {3: ("x", "y", "z"), 6: ("xx", "xy", "xz", "yy", "yz", "zz")}  # of positions and of moments
RATE_DOTS = ("", r"\dot", r"\ddot", r"\dddot", r"\ddddot")


@dataclass(frozen=True, eq=False)
class Document:
    """The content of a document: the symbols of the robot's parameters by name, and the equations in them."""

    symbols: dict[str, np.ndarray]
    form: Symbolic

    def printed(self, name: str) -> str:
        """The symbols of a parameter."""
        import sympy

        return ", ".join(f"${sympy.latex(x)}$" for x in self.symbols[name].flat)

    def equations(self, function: Function) -> Iterator[list[list[str]]]:
        """The equations of each output of a function: the lines of every entry."""
        asked = function.computation
        row, own, series = asked.quantity, asked.quantity.gives.symbol, self.form.series
        if reason := missing_form(row):
            raise JounceError(reason)
        if row.of_bodies:
            found = self.form.of_bodies(row.name, asked.body, asked.frame)
        else:
            found = series[own] + series[own + EXTERNAL] if asked.wrench else series[own]
        symbol = row.printed.tex_symbol or own
        return (list(_entries(found[port.rate], symbol, port)) for port in function.outputs)


def document(robot: ParametricRobot, base: bool = False) -> Document:
    """A robot in symbols that all look different, on a base that moves as symbols say, or on the ground at rest."""
    import sympy

    symbols = {name: _symbols(name, shape) if name in robot.own else np.array(sympy.Symbol(name), dtype=object)
               for name, shape in robot.shapes.items()}  # fmt: skip
    printed = [sympy.latex(x) for array in symbols.values() for x in array.flat]
    twice = next((text for text in printed if printed.count(text) > 1), None)
    if twice is not None:
        raise JounceError(
            f"two parameters would both be printed as {twice}; expected another name of the robot's symbol"
        )
    engine = Engine(robot.mechanism(symbols))
    if engine.mechanism.closure is not None:
        raise JounceError(
            f"{engine.mechanism.name!r} has closed loops, and its equations are no sums of products; robot.symbolic()"
            " has those in all coordinates, with the constraint"
        )
    return Document(symbols, symbolic(engine, base))


def tex(text: str) -> str:
    """A text as LaTeX prints it, m^2 with a square."""
    plain = re.sub(r"[\\&%$#_{}~<>|]", lambda found: f"\\char{ord(found[0])}{{}}", text)
    return re.sub(r"\^(\w?)", lambda found: f"$^{found[1]}$" if found[1] else "\\char94{}", plain)


def heading(asked: Computation) -> str:
    """The heading of a quantity: what it is, of which body and in which frame."""
    row = asked.quantity
    frame = f", frame {asked.frame}" if row.gives.frames else ""
    of_body = "" if asked.body is None else f": {printable(asked.body)}{frame}"
    return tex(f"{row.printed.caption[:1].upper()}{row.printed.caption[1:]}{of_body}")


def formula(asked: Computation) -> str:
    """The formula of a quantity, with what wrenches add."""
    row = asked.quantity
    return f"{row.printed.tex} + {row.printed.wrench_tex}" if asked.wrench else row.printed.tex


def _entries(matrix: Any, symbol: str, port: Port) -> Iterator[list[str]]:
    """The entries of a matrix, each in lines; such that are equal together."""
    from sympy import NDimArray

    alike: dict[Any, list[str]] = {}
    for index in np.ndindex(*(matrix.shape if isinstance(matrix, NDimArray) else port.shape)):
        entry = matrix if not index else matrix[index] if len(index) > 1 else matrix[index[0]]
        alike.setdefault(entry, []).append(_symbol(symbol, port.rate, index))
    for entry, names in alike.items():
        starts = [" = ".join(names[i : i + MAX_EQUAL_PER_LINE]) for i in range(0, len(names), MAX_EQUAL_PER_LINE)]
        room = MAX_LINE_GLYPHS - max(map(_width, starts))
        yield from (_break_lines(f"{start} ={{}} &", list(_pieces(entry, room))) for start in starts)


def _symbol(symbol: str, k: int, index: Sequence[int]) -> str:
    """A symbol as it is printed: dots for its rates, its entry below."""
    letter, _, below = symbol.partition("_")
    places = ("" if max(index, default=0) < 9 else ",").join(str(i + 1) for i in index)
    below = ",".join(x for x in (below[1:-1], places) if x)
    return (f"{RATE_DOTS[k]}{{{letter}}}" if k else letter) + (f"_{{{below}}}" if below else "")


def _pieces(x: Any, room: int) -> Iterator[str]:
    """The terms of an expression with their signs; a product with a sum in it that is too long term by term."""
    import sympy

    for term in x.as_ordered_terms() if x.is_Add else [x]:
        text = sympy.latex(term)
        sums = [factor for factor in sympy.Mul.make_args(term) if factor.is_Add]
        if _width(text) <= room or not sums:
            yield _with_sign(text)
            continue
        longest = max(sums, key=lambda factor: len(factor.args))
        others = term / longest  # SymPy may multiply a number into a sum
        front = {1: "", -1: "-"}.get(others, sympy.latex(others))
        first, *more, last = _pieces(longest, room)
        front = f"\\left({front}\\right)" if others.is_Add else front
        yield f"{_with_sign(front)} \\bigl({first.removeprefix('+ ')}"
        yield from more
        yield f"{last}\\bigr)"


def _with_sign(text: str) -> str:
    return f"- {text[1:].lstrip()}" if text.startswith("-") else f"+ {text}"


def _break_lines(start: str, pieces: Sequence[str]) -> list[str]:
    """A sum in lines that paper holds, the first behind what it is equal to."""
    lines = [f"{start} {pieces[0].removeprefix('+ ')}"]
    for piece in pieces[1:]:
        if _width(lines[-1]) + _width(piece) <= MAX_LINE_GLYPHS:
            lines[-1] += f" {piece}"
        else:
            lines.append(f"& {piece}")
    return lines


def _width(text: str) -> int:
    """About how many glyphs a text has when it is set."""
    text = re.sub(r"\\(left|right|bigl|bigr|mathrm|bar|dot|d+ot)\b", "", text)
    text = re.sub(r"\\[a-zA-Z]+", lambda found: found[0][1:] if found[0] in (r"\sin", r"\cos") else "x", text)
    return len(re.sub(r"[\s{}_^&]", "", text)) + len(re.findall(r" [-+=] ", text))


def _symbols(name: str, shape: Sequence[int]) -> np.ndarray:
    """The symbols of a parameter, as one writes them on paper: g_x, m_1, r_x1, m_p, c_x, ..."""
    import sympy

    stem, _, part = name.rpartition("_")
    number = stem.removeprefix("payload") if stem else ""
    letter = LETTERS[part]
    if not stem and len(shape) == 1 and part == "masses":
        names = [f"{letter}_{i + 1}" for i in range(*shape)]
    elif not shape:
        names = [f"{letter}_p{number}" if stem else letter]
    elif len(shape) == 1:
        names = [f"{letter}_{axis}{number}" for axis in AXIS_SUBSCRIPTS[shape[0]]]
    else:
        names = [f"{letter}_{axis}{i + 1}" for i in range(shape[0]) for axis in AXIS_SUBSCRIPTS[3]]
    return np.array([sympy.Symbol(x) for x in names], dtype=object).reshape(shape)
