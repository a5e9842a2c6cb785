"""Short names of sines and cosines in expressions: s_1 of sin(q1), c_12 of cos(q1 + q2)."""

from collections.abc import Mapping, Sequence
from typing import Any

from jounce.core.errors import JounceError, quote_value

MAX_DIGITS = 9  # coordinates that one digit numbers; the numbers of more are separated by commas


def abbreviate(x: Any, coordinates: Sequence[Any]) -> tuple[Any, Mapping[Any, Any]]:
    """Return an expression in short names, and what each of them stands for; other angles stay as they are."""
    import sympy

    if not isinstance(x, sympy.Expr | sympy.MatrixBase | sympy.NDimArray):
        raise JounceError(f"abbreviate() expects a SymPy expression, matrix or array, got {quote_value(x)}")
    names = {f: sympy.Symbol(name) for f in x.atoms(sympy.sin, sympy.cos) if (name := _name(f, coordinates))}
    taken = sorted(str(name) for name in x.free_symbols.intersection(names.values()))
    if taken:
        raise JounceError(f"abbreviate(): the expression contains the symbol {taken[0]}, a short name; rename it")
    ordered = sorted(names.items(), key=lambda pair: str(pair[1]))
    return x.xreplace(names), {name: f for f, name in ordered}


def _name(f: Any, coordinates: Sequence[Any]) -> str | None:
    """The name of a sine or cosine of a sum of coordinates, multiples listed as often: c_112 of cos(2 q1 + q2).

    Braces keep differences apart from what follows: c_{1-2}.
    """
    multiples = f.args[0].as_coefficients_dict()
    if any(symbol not in coordinates or not count.is_Integer for symbol, count in multiples.items()):
        return None
    numbers = [
        f"{'-' if multiples[q] < 0 else ''}{i + 1}"
        for i, q in enumerate(coordinates) if q in multiples for _ in range(abs(multiples[q]))
    ]  # fmt: skip
    below = ("," if len(coordinates) > MAX_DIGITS else "").join(numbers)
    return f"{f.func.__name__[0]}_{f'{{{below}}}' if '-' in below else below}"
