"""SymPy expressions to trigonometric polynomials, and back in readable form: common factors stand in front."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import reduce
from math import gcd
from operator import add, mul
from typing import Any

from jounce._codegen.symbolic.trig_polynomial import TrigPolynomial, Variables, digits, exact_fraction
from jounce.core.errors import JounceError

MAX_EXPANDED_EXPONENT = 100  # powers from here on are variables of their own, so that exponents stay within a digit
MAX_FACTORED_TERMS = 10  # of a sum that is factored: the square of a sum of four rates has so many
Powers = Mapping[int, int]  # exponents by the place of the variable
Monomial = tuple[Fraction, Powers]


def polynomial(x: Any, variables: Variables) -> Any:
    """A number as a `Fraction`, a SymPy expression as a `TrigPolynomial`.

    Whatever is not a sum, product, power, sine or cosine becomes a variable.
    """
    import sympy

    if not isinstance(x, sympy.Expr):
        try:
            return exact_fraction(x)
        except (TypeError, ValueError):
            raise JounceError(f"it is of type {type(x).__name__}; expected a number or a SymPy expression") from None
    if x.has(sympy.nan, sympy.oo, sympy.zoo, sympy.I):
        raise JounceError(f"it is {x}; expected a real expression")
    result = _convert(x, variables)
    return result if result.number is None else result.number


def _convert(x: Any, variables: Variables) -> TrigPolynomial:
    import sympy

    if x.is_Rational or x.is_Float:
        return variables.variable(x, 0) * (Fraction(x.p, x.q) if x.is_Rational else float(x))
    if x.is_Add or x.is_Mul:
        return reduce(add if x.is_Add else mul, (_convert(part, variables) for part in x.args))
    if x.is_Pow and x.exp.is_Integer and abs(x.exp) < MAX_EXPANDED_EXPONENT:
        if x.exp > 0:
            return reduce(mul, [_convert(x.base, variables)] * int(x.exp))
        if x.base.is_Symbol:
            return variables.variable(x.base, int(x.exp))
    if isinstance(x, sympy.sin | sympy.cos):
        angle = _convert(x.args[0], variables)
        if not angle.is_trigonometric:
            return angle.sin() if isinstance(x, sympy.sin) else angle.cos()
    return variables.variable(x)


@dataclass(frozen=True)
class Factor:
    """The common factor of the terms of a sum: a number and a monomial."""

    number: Fraction
    powers: Powers

    def divide(self, c: Fraction, powers: Powers) -> Monomial:
        """The term divided by the factor."""
        return c / self.number, {i: k - self.powers.get(i, 0) for i, k in powers.items() if k != self.powers.get(i, 0)}


@dataclass(frozen=True)
class Printer:
    """The conversion of scalars to SymPy expressions.

    What multiplies the same sine or cosine is joined, with common factors in front. It is a sum of products P R: sums R
    of products of rates that are equal but for a number stand once, with the sum P of their parameters, the first
    variables, and coordinates. With `decimals`, numbers are floats, except for integers and their halves, quarters, ...
    """

    variables: Variables
    parameters: int  # the number of parameters
    coordinates: frozenset[Any]
    decimals: bool

    def expression(self, x: Any) -> Any:
        """The expression of a scalar."""
        import sympy

        if not isinstance(x, TrigPolynomial):
            return self._number(exact_fraction(x))
        terms = [(c, dict(digits(powers)), angle, sine) for (powers, angle, sine), c in x.terms.items()]
        factor = self._factor([(c, powers) for c, powers, _, _ in terms])
        groups: dict[Any, list[Monomial]] = defaultdict(list)
        for c, powers, angle, sine in terms:
            groups[angle, sine].append(factor.divide(c, powers))
        parts = [self._product(group, *trig) for trig, group in groups.items()]
        return sympy.Mul(*self._prefactors(factor), sympy.Add(*parts))

    def _product(self, terms: Sequence[Monomial], angle: int, sine: bool) -> Any:
        """A sum times a sine or cosine, or, of angle 0, the sum."""
        import sympy

        sign, trig = self._trig(angle, sine).as_coeff_Mul()  # sin(q1 - q2) where the angle is q2 - q1
        terms = [(c * int(sign), powers) for c, powers in terms]
        factor = self._factor(terms) if angle else Factor(Fraction(1), {})
        sums: dict[Any, list[tuple[Fraction, Any]]] = defaultdict(list)  # of rates, by parameters and coordinates
        for c, powers in (factor.divide(*term) for term in terms):
            own = tuple((i, k) for i, k in powers.items() if not self._is_rate(i))
            sums[own].append((c, tuple((i, k) for i, k in powers.items() if self._is_rate(i))))
        products: dict[Any, list[Monomial]] = defaultdict(list)  # of parameters and coordinates, by sums of rates
        for own, found in sums.items():
            found.sort(key=lambda term: term[1])
            number = abs(self._content([c for c, _ in found])) * (1 if found[0][0] > 0 else -1)
            products[tuple((c / number, others) for c, others in found)].append((number, dict(own)))
        parts = (
            sympy.Mul(*self._sum(P), self._factored([(c, dict(powers)) for c, powers in R]))
            for R, P in products.items()
        )
        return sympy.Mul(*self._prefactors(factor), sympy.Add(*parts), trig)

    def _is_rate(self, i: int) -> bool:
        return i >= self.parameters and self.variables.expressions[i] not in self.coordinates

    def _factored(self, terms: Sequence[Monomial]) -> Any:
        """A sum with its common factors in front; a short one of products as the product of sums that it is."""
        import sympy

        found = sympy.Mul(*self._sum(terms))
        squares = len(terms) > 2 and any(k > 1 for _, powers in terms for k in powers.values())
        return sympy.factor(found) if squares and len(terms) <= MAX_FACTORED_TERMS and not self.decimals else found

    def _sum(self, terms: Sequence[Monomial]) -> tuple[Any, ...]:
        """The factors of a sum: a number apart, which SymPy would multiply into a sum that is alone."""
        import sympy

        factor = self._factor(terms)
        rest = (factor.divide(*term) for term in terms)
        return *self._prefactors(factor), sympy.Add(*(self._number(c) * self._monomial(powers) for c, powers in rest))

    def _prefactors(self, factor: Factor) -> tuple[Any, Any]:
        return self._number(factor.number), self._monomial(factor.powers)

    def _factor(self, terms: Sequence[Monomial]) -> Factor:
        everything = [powers for _, powers in terms]
        least = set.intersection(*map(set, everything)) if everything else set()
        shared = {i: min(powers[i] for powers in everything) for i in sorted(least)}
        return Factor(self._content([c for c, _ in terms]) if terms else Fraction(1), shared)

    def _content(self, coefficients: Sequence[Fraction]) -> Fraction:
        sign = -1 if all(c < 0 for c in coefficients) else 1
        if self.decimals:
            return sign * (abs(coefficients[0]) if len(set(map(abs, coefficients))) == 1 else Fraction(1))
        return sign * Fraction(gcd(*(c.numerator for c in coefficients)), gcd(*(c.denominator for c in coefficients)))

    def _number(self, c: Fraction) -> Any:
        import sympy

        rounded = self.decimals and c.denominator & (c.denominator - 1)
        return sympy.Float(float(c)) if rounded else sympy.Rational(c.numerator, c.denominator)

    def _monomial(self, powers: Powers) -> Any:
        import sympy

        return sympy.Mul(*(self.variables.expressions[i] ** k for i, k in powers.items()))

    def _trig(self, angle: int, sine: bool) -> Any:
        import sympy

        parts = []
        for place, k in digits(angle):
            powers, unit = self.variables.angles[place]
            parts.append(self._number(k * unit) * self._monomial(dict(digits(powers))))
        return (sympy.sin if sine else sympy.cos)(sympy.Add(*parts))  # cos(0) is 1
