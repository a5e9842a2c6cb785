"""A target language: the syntax of its statements, and which names it takes.

A `Language` is a row of the table in `languages`; all that differs between languages is data or a short function of a
row. `digits` and `from_one` write numbers and subscripts for them.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from jounce.core.errors import JounceError, quote_value
from jounce.dynamics.computation import Port


def digits(x: float, single: bool) -> str:
    """Return the shortest decimal that reads back as x.

    It has a point or an exponent.
    """
    with np.errstate(over="ignore"):
        text = str(np.float32(x)) if single else repr(float(x))
    if not text.strip("-")[0].isdigit():
        raise JounceError(
            f"the generated code would contain {x!r}, which overflows {'float32' if single else 'float64'}"
        )
    return text if set(text) & set(".e") else f"{text}.0"


def from_one(port: Port, i: int) -> str:
    """Return the subscripts of a scalar, counted from one.

    It is the i-th scalar of an array. Scalars are counted row after row; a single one has the subscript 1.
    """
    return ", ".join(str(k + 1) for k in np.unravel_index(i, port.shape)) or "1"


@dataclass(frozen=True, kw_only=True)
class Language:
    """A target language: what its statements look like.

    Sums, differences, products and signs look alike in all languages. Its folder holds templates of the files to write;
    PREFIX in their names stands for that of the code.
    """

    name: str  # of the folder, and on the command line
    title: str
    reserved: str  # words that can name nothing
    taken: str = ""  # words that can be no prefix, besides
    longest: int = 200  # letters of a name, and of a file
    real: tuple[str, str] = ("double", "float")  # types, in double and single precision
    literal: Callable[[str, bool], str] = lambda digits, single: digits + "f" if single else digits
    function: Callable[[str, str, bool], str] = lambda kind, x, single: f"{kind}{'f' if single else ''}({x})"
    element: Callable[[Port, int], str] = lambda port, i: f"{port.name}[{i}]"  # the i-th scalar of an array
    parameter: Callable[[Port, int], str] = lambda port, i: f"params->{port.name}" + (f"[{i}]" if port.shape else "")
    scratch: Callable[[int], str] = lambda i: f"scratch[{i}]"
    first: int = 0  # the index with which arrays begin
    let: str = "const {real} {name} = {value};"  # a statement that defines a name
    put: str = "{place} = {value};"  # one that writes into an array
    helpers: Mapping[str, Callable[..., Any]] = field(default_factory=dict)  # what its templates call, by name
    single: bool = True  # whether there is single precision
    largest: int = 60_000  # operations of a function: compilers take seconds, and code stays below a megabyte

    def check_name(self, name: str, what: str, added: int = 0) -> None:
        """Raise `JounceError` if a string is not a valid identifier.

        It has to be short enough with `added` more characters.
        """
        if not isinstance(name, str) or not (name.isascii() and name.isidentifier()) or name.startswith("_"):
            raise JounceError(
                f"{what} {quote_value(name)} is not a valid identifier; expected ASCII letters, digits and _,"
                " a letter first"
            )
        if name in self.reserved.split():
            raise JounceError(f"{what} {name!r} is a reserved word of {self.title}; choose another name")
        letters = len(name) + added
        if letters > self.longest:
            raise JounceError(
                f"{what} {quote_value(name)} makes identifiers of {letters} characters; generated {self.title} allows"
                f" at most {self.longest}"
            )

    def check_prefix(self, name: str, endings: Sequence[str]) -> None:
        """Raise `JounceError` if a prefix of names is not valid.

        Names have these endings.
        """
        self.check_name(name, "prefix", max(map(len, endings)))
        if name in self.taken.split():
            raise JounceError(f"prefix {name!r} is already a name in {self.title}; choose another prefix")
