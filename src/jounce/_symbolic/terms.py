"""SymPy expressions into waves, and out of them as one reads them: what terms share stands in front."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import reduce
from math import gcd
from operator import add, mul
from typing import Any

from jounce._symbolic.trig_polynomial import Alphabet, Waves, digits, exact
from jounce.errors import JounceError

LARGEST = 100  # exponent, below which a power is multiplied out; others are variables, not to leave their digit
Powers = Mapping[int, int]  # exponents by variable, by its place in the alphabet


def waves(x: Any, alphabet: Alphabet) -> Any:
    """A number as a `Fraction`, a SymPy expression as `Waves`; what is neither sum, product nor wave is a variable."""
    import sympy

    if not isinstance(x, sympy.Expr):
        try:
            return exact(x)
        except (TypeError, ValueError):
            raise JounceError(f"it is of type {type(x).__name__}; expected a number or a SymPy expression") from None
    if x.has(sympy.nan, sympy.oo, sympy.zoo, sympy.I):
        raise JounceError(f"it is {x}; expected a real expression")
    converted = _converted(x, alphabet)
    return converted if converted.number is None else converted.number


def _converted(x: Any, alphabet: Alphabet) -> Waves:
    import sympy

    if x.is_Rational or x.is_Float:
        return alphabet.variable(x, 0) * (Fraction(x.p, x.q) if x.is_Rational else float(x))
    if x.is_Add or x.is_Mul:
        return reduce(add if x.is_Add else mul, (_converted(part, alphabet) for part in x.args))
    if x.is_Pow and x.exp.is_Integer and abs(x.exp) < LARGEST:
        if x.exp > 0:
            return reduce(mul, [_converted(x.base, alphabet)] * int(x.exp))
        if x.base.is_Symbol:
            return alphabet.variable(x.base, int(x.exp))
    if isinstance(x, sympy.sin | sympy.cos):
        angle = _converted(x.args[0], alphabet)
        if not angle.has_waves:
            return angle.sin() if isinstance(x, sympy.sin) else angle.cos()
    return alphabet.variable(x)


@dataclass(frozen=True)
class Front:
    """What all terms of a sum share: a number and a monomial."""

    number: Fraction
    powers: Powers

    def divides(self, c: Fraction, powers: Powers) -> tuple[Fraction, Powers]:
        """A term without it."""
        return c / self.number, {i: k - self.powers.get(i, 0) for i, k in powers.items() if k != self.powers.get(i, 0)}


@dataclass(frozen=True)
class Print:
    """How scalars become SymPy expressions.

    Terms stand together that differ in parameters only, which are so many variables at the front. Where `decimals` are
    wanted numbers are floats, except for whole ones and what halving makes of them.
    """

    alphabet: Alphabet
    parameters: int
    decimals: bool

    def expression(self, x: Any) -> Any:
        """The expression of a scalar."""
        import sympy

        if not isinstance(x, Waves):
            return self._number(exact(x))
        terms = [(c, dict(digits(powers)), angle, sine) for (powers, angle, sine), c in x.terms.items()]
        front = self._front([(c, powers) for c, powers, _, _ in terms])
        groups: dict[Any, list[tuple[Fraction, Powers]]] = defaultdict(list)
        for c, powers, angle, sine in terms:
            moved = tuple((i, k) for i, k in powers.items() if i >= self.parameters)
            groups[moved, angle, sine].append(front.divides(c, powers))
        parts = (self._group(group) * self._wave(angle, sine) for (_, angle, sine), group in groups.items())
        return self._number(front.number) * self._monomial(front.powers) * sympy.Add(*parts)

    def _group(self, terms: Sequence[tuple[Fraction, Powers]]) -> Any:
        import sympy

        front = self._front(terms)
        rest = (front.divides(*term) for term in terms)
        inner = sympy.Add(*(self._number(c) * self._monomial(powers) for c, powers in rest))
        return self._number(front.number) * self._monomial(front.powers) * inner

    def _front(self, terms: Sequence[tuple[Fraction, Powers]]) -> Front:
        everything = [powers for _, powers in terms]
        least = set.intersection(*map(set, everything)) if everything else set()
        shared = {i: min(powers[i] for powers in everything) for i in sorted(least)}
        return Front(self._content([c for c, _ in terms]) if shared else Fraction(1), shared)

    def _content(self, coefficients: Sequence[Fraction]) -> Fraction:
        sign = -1 if all(c < 0 for c in coefficients) else 1
        if self.decimals:
            return Fraction(sign)
        return sign * Fraction(gcd(*(c.numerator for c in coefficients)), gcd(*(c.denominator for c in coefficients)))

    def _number(self, c: Fraction) -> Any:
        import sympy

        rounded = self.decimals and c.denominator & (c.denominator - 1)
        return sympy.Float(float(c)) if rounded else sympy.Rational(c.numerator, c.denominator)

    def _monomial(self, powers: Powers) -> Any:
        import sympy

        return sympy.Mul(*(self.alphabet.variables[i] ** k for i, k in powers.items()))

    def _wave(self, angle: int, sine: bool) -> Any:
        import sympy

        parts = []
        for place, k in digits(angle):
            powers, unit = self.alphabet.angles[place]
            parts.append(self._number(k * unit) * self._monomial(dict(digits(powers))))
        return (sympy.sin if sine else sympy.cos)(sympy.Add(*parts))  # cos(0) is 1
