"""The first stamp of a log, where it is large: times are since then, subtracted in all digits of the file.

Doubles of seconds since 1970 step by 2.4e-7 s. At 1 rad/s and 1 kHz, fourth differences make 1e6 rad/s^4 of that.
"""

from dataclasses import dataclass
from datetime import UTC, datetime
from decimal import Decimal

import numpy as np

from jounce.spatial.series import rate_name

MIN_LARGE_STAMP = 86400.0  # s: up to a day doubles step by 1.5e-11 s at most, such differences by 100 rad/s^4
EPOCH_SECONDS = 1e8, 1e10  # since 1970: 1973 to 2286. No clock since a start shows as much
STAMP_GRID_TOLERANCE = 1e-3  # of a step, by which multiples of it may be off


@dataclass(frozen=True)
class TimeOrigin:
    """A stamp in the unit of its column, a double and what that leaves of the stamp; and the seconds of that unit."""

    high: float
    low: float
    factor: float

    def since(self, high: np.ndarray, low: np.ndarray) -> np.ndarray:
        """Stamps less this one, in the unit of the column."""
        return np.asarray((high - self.high) + (low - self.low))

    def rounding(self, t: np.ndarray) -> float:
        """The standard deviation in s of the rounding of stamps at times t (N,) since this one; 0 if they are exact.

        They are rounded where they are multiples of the step of doubles, and not of a decimal that doubles resolve.
        """
        step = float(np.spacing(abs(self.high)))
        since = t / self.factor
        is_rounded = _is_on_grid(since, step) and not _is_on_grid(since, shortest_decimal(self.high))
        return step * self.factor / np.sqrt(12) if is_rounded else 0.0

    @property
    def notes(self) -> tuple[str, ...]:
        """When the first row was, in one sentence."""
        return (f"times are since the first row, at {self}",)

    def __str__(self) -> str:
        seconds = (Decimal(self.high) + Decimal(self.low)) * Decimal(repr(self.factor))
        text = f"{seconds:.9f}".rstrip("0").rstrip(".")
        if not EPOCH_SECONDS[0] <= seconds < EPOCH_SECONDS[1]:
            return f"{text} s"
        return f"{text} s, {datetime.fromtimestamp(float(seconds), UTC):%Y-%m-%d %H:%M:%S} UTC"


def find_origin(high: float, low: float, factor: float) -> TimeOrigin | None:
    """The origin of stamps whose first one is given; None where doubles hold such stamps well enough."""
    return TimeOrigin(high, low, factor) if MIN_LARGE_STAMP <= abs(high) * factor < np.inf else None


def rounding_notes(rounding: float, highest: int) -> tuple[str, ...]:
    """What a user should know of stamps that are rounded, of which rates up to `highest` are asked."""
    if not rounding:
        return ()
    step = f"{rounding * np.sqrt(12):.2g}"
    return (f"the stamps are doubles, in steps of {step} s; the deviations of q to {rate_name('q', highest)} hold it",)


def shortest_decimal(largest: float) -> float:
    """The power of ten whose multiples doubles up to the largest are certain to resolve."""
    return float(10.0 ** np.ceil(np.log10(2 * np.spacing(abs(largest)))))


def _is_on_grid(x: np.ndarray, step: float) -> bool:
    return bool((np.abs(x / step - np.rint(x / step)) < STAMP_GRID_TOLERANCE).all())
