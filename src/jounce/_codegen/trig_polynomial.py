"""Compute with trigonometric polynomials in a normal form: equal scalars look equal, and nothing is left to simplify.

A scalar is a sum of terms ``c x^a cos(k phi)`` and ``c x^a sin(k phi)``: a rational coefficient, powers of variables,
and a cosine or sine of a sum of angles. Products become sums, ``2 cos v cos w = cos(v + w) + cos(v - w)``. The
exponents a of a term are the digits of one integer, and so are the multiples k of its angles: terms multiply by adding
integers.

Invariants: coefficients are exact and not zero, angles not negative, and each term stands once, so equality of scalars
is equality of terms. A product of m and n terms counts as m n operations; their number is limited, and beyond the
limit `check` raises. Sines of what holds sines have no such form, and raise JounceError.

`polynomial` makes them of SymPy's expressions, once for each number of a robot's data. A `Printer` converts them back
in readable form, each entry of each result: common factors stand in front.
"""

from collections import defaultdict
from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import reduce
from math import gcd, prod
from operator import add, mul
from typing import Any

from jounce.core.errors import JounceError
from jounce.core.scalars import Recorder

DIGIT_BASE = 2**16  # digits lie within +-DIGIT_BASE/2: far beyond what exponents and multiples grow to
Term = tuple[int, int, bool]  # powers, angle (never negative; 0: neither sine nor cosine), whether a sine
MAX_EXPANDED_EXPONENT = 100  # powers from here on are variables of their own, so that exponents stay within a digit
MAX_FACTORED_TERMS = 10  # of a sum that is factored: the square of a sum of four rates has ten
Powers = Mapping[int, int]  # exponents by the place of the variable
Monomial = tuple[Fraction, Powers]


class Variables:
    """The variables and angles of a set of polynomials.

    They are in the order of their digits. It counts the operations that are spent. Polynomials that are added or
    multiplied share one of these. Beyond a limit of operations every result is zero, as of a full `Tape` and for its
    reason: `check` is called between the terms of series.
    """

    def __init__(self, limit: int) -> None:
        self.expressions: list[Any] = []  # the variables: any hashable objects, here SymPy expressions
        self.angles: list[tuple[int, Fraction]] = []  # powers of variables, times a factor
        self.limit = limit
        self.work = 0

    def variable(self, x: Hashable, exponent: int = 1) -> "TrigPolynomial":
        """Return the power of a variable, added if it is new."""
        return TrigPolynomial(self, {(exponent * _unit(self.expressions, x), 0, False): Fraction(1)})

    def angle(self, powers: int, factor: Fraction) -> int:
        """Return the digit of an angle: a multiple of a known one if possible, else a new one."""
        # q and 2 q share a digit, so that products of their sines stay sums of multiples.
        for unit in (unit for known, unit in self.angles if known == powers):
            multiple = factor / unit
            if multiple.denominator == 1 and abs(multiple) < 100:
                return int(multiple) * _unit(self.angles, (powers, unit))
        sign = -1 if factor < 0 else 1
        return sign * _unit(self.angles, (powers, sign * factor))

    def spend(self, operations: int) -> bool:
        """Count operations on terms; return whether their number keeps the limit."""
        self.work += operations
        return self.work <= self.limit

    def check(self) -> None:
        """Raise `JounceError` if the number of operations exceeds the limit."""
        if self.work > self.limit:
            raise JounceError(
                f"too large for symbolic form: it takes more than {self.limit:,} operations on terms; "
                "robot.codegen writes it as a program in C, Python, Rust and others"
            )


class TrigPolynomial(Recorder):
    """A sum of terms with their coefficients, none of which is zero. It is never changed in place."""

    __slots__ = ("terms", "variables")
    __hash__ = None  # type: ignore[assignment]

    def __init__(self, variables: Variables, terms: Mapping[Term, Fraction]) -> None:
        self.variables, self.terms = variables, terms

    def check_recording(self) -> None:
        """Raise `JounceError` if the limit of operations is exceeded."""
        self.variables.check()

    def __eq__(self, other: object) -> bool:
        return self.terms == self._cast(other).terms

    def __add__(self, other: Any) -> "TrigPolynomial":
        # The shorter sum is added to a copy of the longer one.
        few, many = sorted((self.terms, self._cast(other).terms), key=len)
        if not self.variables.spend(len(few)):
            return TrigPolynomial(self.variables, {})
        total = dict(many)
        for term, c in few.items():
            _add(total, term, c)
        return TrigPolynomial(self.variables, total)

    def __neg__(self) -> "TrigPolynomial":
        return TrigPolynomial(self.variables, {term: -c for term, c in self.terms.items()})

    def __sub__(self, other: Any) -> "TrigPolynomial":
        return self + -self._cast(other)

    def __rsub__(self, other: Any) -> "TrigPolynomial":
        return -self + other

    def __mul__(self, other: Any) -> "TrigPolynomial":
        if not isinstance(other, TrigPolynomial):
            number = exact_fraction(other)
            if number == 1:
                return self
            if not self.variables.spend(len(self.terms)) or number == 0:
                return TrigPolynomial(self.variables, {})
            return TrigPolynomial(self.variables, {term: c * number for term, c in self.terms.items()})
        total: dict[Term, Fraction] = {}
        if not self.variables.spend(len(self.terms) * len(other.terms)):
            return TrigPolynomial(self.variables, total)
        for (a, v, sine_v), c in self.terms.items():
            for (b, w, sine_w), d in other.terms.items():
                # 2 cos v cos w = cos(v + w) + cos(v - w)     2 sin v sin w = -cos(v + w) + cos(v - w)
                # 2 sin v cos w = sin(v + w) + sin(v - w)     2 cos v sin w = sin(v + w) - sin(v - w)
                # An angle of 0 is no factor at all: the other one stays.
                sine = sine_v is not sine_w
                if v != 0 and w != 0:
                    half = c * d / 2
                    _add_normal(total, a + b, v + w, sine, -half if sine_v and sine_w else half)
                    _add_normal(total, a + b, v - w, sine, -half if sine_w and not sine_v else half)
                else:
                    _add_normal(total, a + b, v + w, sine, c * d)
        return TrigPolynomial(self.variables, total)

    __radd__, __rmul__ = __add__, __mul__

    def __truediv__(self, number: Any) -> "TrigPolynomial":
        return self * (1 / exact_fraction(number))

    def __rtruediv__(self, number: Any) -> "TrigPolynomial":
        """Return the quotient by a polynomial without sines and cosines.

        A sum becomes a variable, to the power of -1.
        """
        if self.is_trigonometric or not self.terms:
            return NotImplemented if self.variables.spend(0) else self
        if len(self.terms) > 1:
            return self.variables.variable(self._expression(), -1) * number
        [((powers, _, _), c)] = self.terms.items()
        return TrigPolynomial(self.variables, {(-powers, 0, False): 1 / c}) * number

    def _expression(self) -> Any:
        """Return the sum in terms of the variables."""
        x = self.variables.expressions
        return sum(prod([x[i] ** k for i, k in digits(powers)]) * c for (powers, _, _), c in self.terms.items())

    def sin(self) -> "TrigPolynomial":
        """Return the sine of a polynomial without sines and cosines."""
        return self._trig(sine=True)

    def cos(self) -> "TrigPolynomial":
        """Return the cosine of a polynomial without sines and cosines."""
        return self._trig(sine=False)

    def sqrt(self) -> "TrigPolynomial":
        """Return the square root as a variable.

        The polynomial has no sines and cosines.
        """
        if self.is_trigonometric:
            raise JounceError("symbolic form does not support the root of a sine or cosine")
        return self.variables.variable(self._expression() ** Fraction(1, 2))

    @property
    def number(self) -> Fraction | None:
        """The value of a constant polynomial, otherwise None."""
        return self.terms.get((0, 0, False), Fraction(0)) if set(self.terms) <= {(0, 0, False)} else None

    @property
    def is_trigonometric(self) -> bool:
        """Whether it contains a sine or cosine."""
        return any(angle for _, angle, _ in self.terms)

    def _trig(self, sine: bool) -> "TrigPolynomial":
        """Return the sine or cosine of a sum: one term, whose angle has a digit for each term of the sum."""
        if self.is_trigonometric:
            raise JounceError("symbolic form does not support the sine or cosine of a sine or cosine")
        total: dict[Term, Fraction] = {}
        angle = sum(self.variables.angle(powers, c) for (powers, _, _), c in self.terms.items())
        _add_normal(total, 0, angle, sine, Fraction(1))
        return TrigPolynomial(self.variables, total)

    def _cast(self, x: Any) -> "TrigPolynomial":
        return x if isinstance(x, TrigPolynomial) else TrigPolynomial(self.variables, {(0, 0, False): Fraction(1)}) * x


def exact_fraction(x: Any) -> Fraction:
    """Return a number as a fraction.

    A float is the decimals that it prints as: 0.1 is 1/10.
    """
    if isinstance(x, float) and x != x:
        raise JounceError("a number is missing, as those of motors that do not state all; expressions need every one")
    return Fraction(repr(float(x))) if isinstance(x, float) else Fraction(x)


def digits(number: int) -> Iterator[tuple[int, int]]:
    """Yield the places and values of the digits that are not zero."""
    # Balanced digits, from -DIGIT_BASE/2 on: exponents and multiples may be negative.
    place = 0
    while number != 0:
        digit = (number + DIGIT_BASE // 2) % DIGIT_BASE - DIGIT_BASE // 2
        if digit != 0:
            yield place, digit
        number, place = (number - digit) // DIGIT_BASE, place + 1


def _unit(known: list[Any], x: Hashable) -> int:
    """Return the integer with digit 1 at the place of x.

    The place is that in a list, to which a new x is added.
    """
    if x not in known:
        known.append(x)
    return DIGIT_BASE ** known.index(x)


def _add_normal(total: dict[Term, Fraction], powers: int, angle: int, sine: bool, c: Fraction) -> None:
    """Add a term in normal form: its angle is made positive."""
    # sin(-v) = -sin v, cos(-v) = cos v, and sin 0 = 0.
    if angle < 0:
        angle, c = -angle, -c if sine else c
    if angle != 0 or not sine:
        _add(total, (powers, angle, sine), c)


def _add(total: dict[Term, Fraction], term: Term, c: Fraction) -> None:
    """Add to the coefficient of a term.

    The term is dropped if it becomes zero.
    """
    c += total.get(term, 0)
    if c != 0:
        total[term] = c
    else:
        total.pop(term, None)


def polynomial(x: Any, variables: Variables) -> Any:
    """Return a number as a `Fraction`, a SymPy expression as a `TrigPolynomial`.

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
    """Return an expression as a polynomial, part by part."""
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
        """Return a term divided by the factor."""
        quotient = {i: k - self.powers.get(i, 0) for i, k in powers.items()}
        return c / self.number, {i: k for i, k in quotient.items() if k != 0}


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
        """Return the expression of a scalar: a common factor times a sum over its sines and cosines."""
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
        """Return a sum times a sine or cosine.

        It is the sum alone where the angle is 0.
        """
        import sympy

        # SymPy has a sign of its own for angles, sin(q1 - q2) where the angle is q2 - q1.
        sign, trig = self._trig(angle, sine).as_coeff_Mul()
        terms = [(c * int(sign), powers) for c, powers in terms]
        factor = self._factor(terms) if angle else Factor(Fraction(1), {})
        # 1. Split each term into parameters and coordinates, and rates: sums of rates by what they are multiplied with.
        sums: dict[Any, list[tuple[Fraction, Any]]] = defaultdict(list)
        for c, powers in (factor.divide(*term) for term in terms):
            constants = tuple((i, k) for i, k in powers.items() if not self._is_rate(i))
            sums[constants].append((c, tuple((i, k) for i, k in powers.items() if self._is_rate(i))))
        # 2. Sums of rates that are equal but for a number stand once: what they are multiplied with is added up.
        products: dict[Any, list[Monomial]] = defaultdict(list)
        for constants, rate_terms in sums.items():
            rate_terms.sort(key=lambda term: term[1])
            number = abs(self._content([c for c, _ in rate_terms])) * (1 if rate_terms[0][0] > 0 else -1)
            products[tuple((c / number, rates) for c, rates in rate_terms)].append((number, dict(constants)))
        # 3. Each product P R, and the common factor of all of them in front.
        parts = (
            sympy.Mul(*self._sum(P), self._factored([(c, dict(powers)) for c, powers in R]))
            for R, P in products.items()
        )
        return sympy.Mul(*self._prefactors(factor), sympy.Add(*parts), trig)

    def _is_rate(self, i: int) -> bool:
        return i >= self.parameters and self.variables.expressions[i] not in self.coordinates

    def _factored(self, terms: Sequence[Monomial]) -> Any:
        """Return a sum with its common factors in front.

        A short sum with squares is factored: it may be the square of a sum.
        """
        import sympy

        total = sympy.Mul(*self._sum(terms))
        has_squares = len(terms) > 2 and any(k > 1 for _, powers in terms for k in powers.values())
        if has_squares and len(terms) <= MAX_FACTORED_TERMS and not self.decimals:
            return sympy.factor(total)
        return total

    def _sum(self, terms: Sequence[Monomial]) -> tuple[Any, ...]:
        """Return the factors of a sum.

        The number is a factor apart, which SymPy would multiply into a sum that is alone.
        """
        import sympy

        factor = self._factor(terms)
        rest = (factor.divide(*term) for term in terms)
        return *self._prefactors(factor), sympy.Add(*(self._number(c) * self._monomial(powers) for c, powers in rest))

    def _prefactors(self, factor: Factor) -> tuple[Any, Any]:
        return self._number(factor.number), self._monomial(factor.powers)

    def _factor(self, terms: Sequence[Monomial]) -> Factor:
        """Return the common factor of terms: variables of all of them, to their lowest power."""
        if len(terms) == 0:
            return Factor(Fraction(1), {})
        all_powers = [powers for _, powers in terms]
        shared_variables = set.intersection(*map(set, all_powers))
        lowest = {i: min(powers[i] for powers in all_powers) for i in sorted(shared_variables)}
        return Factor(self._content([c for c, _ in terms]), lowest)

    def _content(self, coefficients: Sequence[Fraction]) -> Fraction:
        """Return the number in front of a sum.

        It is negative if all coefficients are.
        """
        sign = -1 if all(c < 0 for c in coefficients) else 1
        # Decimals have no common divisor that is worth reading, but may all be the same.
        if self.decimals:
            return sign * (abs(coefficients[0]) if len(set(map(abs, coefficients))) == 1 else Fraction(1))
        return sign * Fraction(gcd(*(c.numerator for c in coefficients)), gcd(*(c.denominator for c in coefficients)))

    def _number(self, c: Fraction) -> Any:
        """Return a coefficient in SymPy; halves, quarters, ... stay exact among decimals."""
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
