"""Computes what doubles lose of the numbers in a table.

Stamps since 1970 have more digits than a double holds. A reader that is asked for the column ``remainder_name(name)``
gives the numbers of the column `name` less the doubles that they are read as. Only the column of times is read so: its
first stamp is subtracted in all digits.
"""

import re
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from jounce.motion.table import MIN_LARGE_STAMP, shortest_decimal

REMAINDER_MARK = "\0remainder"  # no name of a column ends in this
MAX_INTEGER = 2.0**62  # doubles beyond may overflow when cast to int64
DECIMAL = re.compile(r"\s*\d+(?:\.(\d*))?\s*")


def remainder_name(name: str) -> str:
    """Return the name under which the remainder of a column is requested."""
    return name + REMAINDER_MARK


def split_names(names: Iterable[str]) -> tuple[list[str], list[str]]:
    """Return the names of columns, and of columns whose remainder is requested."""
    names = list(names)
    columns = [name for name in names if not name.endswith(REMAINDER_MARK)]
    bases = [name.removesuffix(REMAINDER_MARK) for name in names if name.endswith(REMAINDER_MARK)]
    return columns, bases


def with_remainders(
    columns: Mapping[str, np.ndarray], bases: Sequence[str], numbers: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """Return the columns with the remainders of some of them.

    `numbers` are the arrays of these columns as the table holds them.
    """
    return {**columns, **{remainder_name(name): array_remainders(numbers[name]) for name in bases}}


def array_remainders(numbers: np.ndarray) -> np.ndarray:
    """Return the remainders of integers or doubles.

    Doubles are taken for the shortest decimals that doubles distinguish: a double of 1732287600.001 s is off by 7e-8 s,
    and no other decimal of microseconds is read as it.
    """
    if numbers.ndim != 1 or numbers.dtype.kind not in "fiu" or not _are_large(numbers):
        return np.zeros(numbers.shape)
    high = numbers.astype(float)
    # Numbers beyond, and NaN, have no remainder.
    is_inside = np.abs(high) < MAX_INTEGER
    high = np.where(is_inside, high, 0)
    whole = np.floor(high)
    if numbers.dtype.kind in "iu":
        # The difference is exact in integers.
        differences = np.where(is_inside, numbers, 0).astype(np.int64) - whole.astype(np.int64)
        return np.where(is_inside, differences, 0).astype(float)
    # The candidate is the multiple of the shortest decimal unit that is nearest to the double. It is what the table
    # held where no double is farther from its candidate than the spacing of doubles; otherwise nothing is known of it.
    unit = shortest_decimal(float(np.abs(high[is_inside]).max(initial=1)))
    if unit >= 1:
        k = np.rint(whole / unit).astype(np.int64)
        remainders = (k * int(unit) - whole.astype(np.int64)).astype(float) - (high - whole)
    else:
        units_per_one = round(1 / unit)
        remainders = np.rint((high - whole) * units_per_one) / units_per_one - (high - whole)
    are_decimals = (np.abs(remainders[is_inside]) <= np.spacing(np.abs(high[is_inside]))).all()
    return np.where(is_inside & are_decimals, remainders, 0.0)


def text_remainders(cells: Sequence[str], high: np.ndarray) -> np.ndarray:
    """Return the remainders of cells, which are the doubles `high` when read.

    The remainder is 0 where a cell is no plain decimal. Cells whose last digits are those of a double, as `%.9f` writes
    one, hold no more than it.
    """
    if not _are_large(high):
        return np.zeros(len(high))
    # The digits behind the point of each cell, None where a cell is no plain decimal.
    matches = [DECIMAL.fullmatch(cell) for cell in cells]
    digits = [None if match is None else match[1] for match in matches]
    if all(x is None or x == "" for x in digits):
        integers = [0 if match is None else int(cell) for cell, match in zip(cells, matches, strict=True)]
        fits = all(abs(x) < MAX_INTEGER for x in integers)
        return array_remainders(np.array(integers) if fits else high)
    # The cell is whole + 0.digits, and the double is whole + (high - whole), where both differences are exact.
    is_decimal = np.array([match is not None for match in matches])
    whole = np.array([float(c.partition(".")[0]) if is_d else 0 for c, is_d in zip(cells, is_decimal, strict=True)])
    fractions = np.array([0.0 if x is None else float(f"0.{x}") for x in digits])
    remainders = np.where(is_decimal, fractions - (high - whole), 0.0)
    # Remainders of less than half a unit of the last digit are those of a double that was printed.
    half_unit = 0.5 * 10.0 ** -np.array([0 if x is None else len(x) for x in digits], dtype=float)
    return array_remainders(high) if (np.abs(remainders) <= half_unit).all() else remainders


def _are_large(numbers: np.ndarray) -> bool:
    """Return whether doubles lose digits of numbers that count."""
    return bool(np.nanmax(np.abs(numbers), initial=0) >= MIN_LARGE_STAMP)
