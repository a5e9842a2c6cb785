"""Waves: scalars in a normal form, so that what is equal looks equal and nothing is left to simplify.

A scalar is a sum of terms ``c x^a cos(k phi)`` and ``c x^a sin(k phi)``: a rational number, powers of variables, a wave
of a sum of angles. Products of waves become sums, ``2 cos v cos w = cos(v + w) + cos(v - w)``. The exponents a are the
digits of one whole number, and so are the multiples k: powers multiply, and angles add up, as numbers do.
"""

from collections.abc import Hashable, Iterator, Mapping
from fractions import Fraction
from typing import Any

from jounce.errors import JounceError

BASE = 2**16  # of the digits, each from -BASE/2 to BASE/2: far from what exponents and multiples grow to
Term = tuple[int, int, bool]  # powers, angle (0: no wave; never negative), whether a sine


class Alphabet:
    """The variables and the angles that waves are made of, in the order of their digits, and the work spent on them."""

    def __init__(self, most: int) -> None:
        self.variables: list[Any] = []  # SymPy expressions, to whoever reads or prints them
        self.angles: list[tuple[int, Fraction]] = []  # powers of variables, times a factor
        self.most = most
        self.work = 0

    def variable(self, x: Hashable, exponent: int = 1) -> "Waves":
        """The power of a variable, a new one where it does not occur yet."""
        return Waves(self, {(exponent * _digit(self.variables, x), 0, False): Fraction(1)})

    def angle(self, powers: int, factor: Fraction) -> int:
        """An angle as a multiple of a known one, of a new one where there is none."""
        for unit in (unit for known, unit in self.angles if known == powers):
            multiple = factor / unit
            if multiple.denominator == 1 and abs(multiple) < 100:
                return int(multiple) * _digit(self.angles, (powers, unit))
        sign = -1 if factor < 0 else 1
        return sign * _digit(self.angles, (powers, sign * factor))

    def spend(self, operations: int) -> None:
        """Count operations on terms.

        Raises
        ------
        JounceError : where they are more than the most there may be.
        """
        self.work += operations
        if self.work > self.most:
            raise JounceError(
                f"too large for symbolic form: it takes more than {self.most:,} operations on terms; "
                "jounce.codegen writes it as a program in C, Python, Rust and others"
            )


class Waves:
    """A sum of terms, each with its coefficient, none of them zero."""

    __slots__ = ("alphabet", "terms")
    __hash__ = None  # type: ignore[assignment]

    def __init__(self, alphabet: Alphabet, terms: Mapping[Term, Fraction]) -> None:
        self.alphabet, self.terms = alphabet, terms

    def __eq__(self, other: object) -> bool:
        return self.terms == self._lifted(other).terms

    def __add__(self, other: Any) -> "Waves":
        few, many = sorted((self.terms, self._lifted(other).terms), key=len)
        self.alphabet.spend(len(few))
        total = dict(many)
        for term, c in few.items():
            _add(total, term, c)
        return Waves(self.alphabet, total)

    def __neg__(self) -> "Waves":
        return Waves(self.alphabet, {term: -c for term, c in self.terms.items()})

    def __sub__(self, other: Any) -> "Waves":
        return self + -self._lifted(other)

    def __rsub__(self, other: Any) -> "Waves":
        return -self + other

    def __mul__(self, other: Any) -> "Waves":
        if not isinstance(other, Waves):
            number = exact(other)
            if number == 1:
                return self
            self.alphabet.spend(len(self.terms))
            return Waves(self.alphabet, {term: c * number for term, c in self.terms.items()} if number else {})
        self.alphabet.spend(len(self.terms) * len(other.terms))
        total: dict[Term, Fraction] = {}
        for (a, v, sine_v), c in self.terms.items():
            for (b, w, sine_w), d in other.terms.items():
                sine = sine_v is not sine_w
                if v and w:
                    half = c * d / 2
                    _put(total, a + b, v + w, sine, -half if sine_v and sine_w else half)
                    _put(total, a + b, v - w, sine, -half if sine_w and not sine_v else half)
                else:
                    _put(total, a + b, v + w, sine, c * d)
        return Waves(self.alphabet, total)

    __radd__, __rmul__ = __add__, __mul__

    def __truediv__(self, number: Any) -> "Waves":
        return self * (1 / exact(number))

    def sin(self) -> "Waves":
        """The sine of a scalar without waves."""
        return self._wave(sine=True)

    def cos(self) -> "Waves":
        """The cosine of a scalar without waves."""
        return self._wave(sine=False)

    @property
    def number(self) -> Fraction | None:
        """The number that it is, or None."""
        return self.terms.get((0, 0, False), Fraction(0)) if set(self.terms) <= {(0, 0, False)} else None

    @property
    def has_waves(self) -> bool:
        """Whether there is a sine or cosine in it."""
        return any(angle for _, angle, _ in self.terms)

    def _wave(self, sine: bool) -> "Waves":
        if self.has_waves:
            raise JounceError("the sine of a sine has no place in symbolic form")
        total: dict[Term, Fraction] = {}
        angle = sum(self.alphabet.angle(powers, c) for (powers, _, _), c in self.terms.items())
        _put(total, 0, angle, sine, Fraction(1))
        return Waves(self.alphabet, total)

    def _lifted(self, x: Any) -> "Waves":
        return x if isinstance(x, Waves) else Waves(self.alphabet, {(0, 0, False): Fraction(1)}) * x


def exact(x: Any) -> Fraction:
    """A number as a fraction, that of the decimals which a float prints: 0.1 is 1/10."""
    return Fraction(repr(float(x))) if isinstance(x, float) else Fraction(x)


def digits(number: int) -> Iterator[tuple[int, int]]:
    """The digits that are not zero, with their places."""
    place = 0
    while number:
        digit = (number + BASE // 2) % BASE - BASE // 2
        if digit:
            yield place, digit
        number, place = (number - digit) // BASE, place + 1


def _digit(known: list[Any], x: Hashable) -> int:
    """A 1 in the place of x among what is known, the next place if it is new."""
    if x not in known:
        known.append(x)
    return BASE ** known.index(x)


def _put(total: dict[Term, Fraction], powers: int, angle: int, sine: bool, c: Fraction) -> None:
    """Add a term, its angle made positive."""
    if angle < 0:
        angle, c = -angle, -c if sine else c
    if angle or not sine:
        _add(total, (powers, angle, sine), c)


def _add(total: dict[Term, Fraction], term: Term, c: Fraction) -> None:
    """Add to the coefficient of a term; none stays that is zero."""
    c += total.get(term, 0)
    if c:
        total[term] = c
    else:
        total.pop(term, None)
