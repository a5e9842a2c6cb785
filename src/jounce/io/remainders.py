"""What doubles leave of the numbers in a table: stamps since 1970 have more digits than a double holds.

A reader that is asked for the column ``remainder_of(name)`` gives the numbers of the column `name` less the doubles
that these are read as. Only the column of times is read so: its first stamp is subtracted in all digits.
"""

import re
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from jounce.motion.table import MIN_LARGE_STAMP, shortest_decimal

REMAINDER_MARK = "\0remainder"  # no name of a column ends in this
MAX_INTEGER = 2.0**62  # doubles beyond may overflow when cast to int64
DECIMAL = re.compile(r"\s*\d+(?:\.(\d*))?\s*")


def remainder_name(name: str) -> str:
    """The name under which the remainder of a column is requested."""
    return name + REMAINDER_MARK


def split_names(names: Iterable[str]) -> tuple[list[str], list[str]]:
    """Names of columns, and of those whose remainder is requested."""
    names = list(names)
    return [n for n in names if not n.endswith(REMAINDER_MARK)], [
        n.removesuffix(REMAINDER_MARK) for n in names if n.endswith(REMAINDER_MARK)
    ]


def with_remainders(
    columns: Mapping[str, np.ndarray], bases: Sequence[str], numbers: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """The columns with the remainders of some of them, of which `numbers` are the arrays as the table holds them."""
    return {**columns, **{remainder_name(name): array_remainders(numbers[name]) for name in bases}}


def array_remainders(numbers: np.ndarray) -> np.ndarray:
    """The remainders of integers, and of doubles that are the shortest decimals that doubles distinguish.

    A double of 1732287600.001 s is off by 7e-8 s, and no other decimal of microseconds is read as it.
    """
    if numbers.ndim != 1 or numbers.dtype.kind not in "fiu" or not _are_large(numbers):
        return np.zeros(numbers.shape)
    high = numbers.astype(float)
    inside = np.abs(high) < MAX_INTEGER  # neither NaN
    high = np.where(inside, high, 0)
    whole = np.floor(high)
    if numbers.dtype.kind in "iu":
        return np.where(inside, np.where(inside, numbers, 0).astype(np.int64) - whole.astype(np.int64), 0).astype(float)
    # The candidate is the multiple of the shortest decimal unit that is nearest to the double. It is what the table
    # held where no double is farther from its candidate than the spacing of doubles; otherwise nothing is known of it.
    unit = shortest_decimal(float(np.abs(high[inside]).max(initial=1)))
    if unit >= 1:
        k = np.rint(whole / unit).astype(np.int64)
        left = (k * int(unit) - whole.astype(np.int64)).astype(float) - (high - whole)
    else:
        per = round(1 / unit)
        left = np.rint((high - whole) * per) / per - (high - whole)
    are_decimals = (np.abs(left[inside]) <= np.spacing(np.abs(high[inside]))).all()
    return np.where(inside & are_decimals, left, 0.0)


def text_remainders(cells: Sequence[str], high: np.ndarray) -> np.ndarray:
    """The remainders of cells, which are the doubles `high` when read; 0 where a cell is no plain decimal.

    Cells whose last digits are those of a double, as `%.9f` writes one, hold no more than it.
    """
    if not _are_large(high):
        return np.zeros(len(high))
    plain = [DECIMAL.fullmatch(cell) for cell in cells]
    if not any(found and found[1] for found in plain):
        integers = [int(cell) if found else 0 for cell, found in zip(cells, plain, strict=True)]
        fits = all(abs(x) < MAX_INTEGER for x in integers)
        return array_remainders(np.array(integers) if fits else high)
    digits = [(found[1] or "") if found else "" for found in plain]
    of_cells = np.array([found is not None for found in plain])
    whole = np.array([float(c.partition(".")[0]) if known else 0 for c, known in zip(cells, of_cells, strict=True)])
    left = np.where(of_cells, np.array([float(f"0.{rest}") for rest in digits]) - (high - whole), 0.0)
    half_unit = 0.5 * 10.0 ** -np.array([len(rest) for rest in digits], dtype=float)
    return array_remainders(high) if (np.abs(left) <= half_unit).all() else left


def _are_large(numbers: np.ndarray) -> bool:
    return bool(np.nanmax(np.abs(numbers), initial=0) >= MIN_LARGE_STAMP)
