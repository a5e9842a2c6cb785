"""Make splines through samples, or fitted to samples over intervals.

`SampledColumns` are samples with what messages need, `Smoothing` and `Spline` the ways from them to a curve. A spline
does not know the noise of its samples: `fit_spline` warns where their rounding shows in the highest rate.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jounce.core.cures import Remedy, option_name
from jounce.core.errors import JounceError, check_bool, check_choice, one_line, quote_value, warn
from jounce.motion import smoothness
from jounce.motion.curves import SmoothCurve
from jounce.spatial.series import rate_name

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

SPLINE_DEGREES = (5, 7)  # q is C^4 or C^6
INTERPOLATION_OPTION = Remedy("degree=7", "--degree 7")
ROW_KINDS = ("samples", "commands")  # what the rows of a table are: of a motion, or for a controller


@dataclass(frozen=True)
class Smoothing:
    """The default way from samples to a curve: smoothing by `fit`."""

    bandwidth: float | None = None  # Hz
    allow_noise: bool = False  # whether samples count that cannot carry the highest rate


@dataclass(frozen=True)
class Spline:
    """The manual way from samples to a curve: a spline.

    It interpolates, or is fitted by least squares over a number of intervals.
    """

    degree: int = 7  # q4d is smooth then, and Q2d has no kinks
    intervals: int | None = None  # few of them even out the noise of measured samples

    def __str__(self) -> str:
        spline = f"spline of degree {self.degree} (C^{self.degree - 1})"
        if self.intervals is None:
            return spline
        plural = "" if self.intervals == 1 else "s"
        return f"{spline}, fitted by least squares in {self.intervals} interval{plural}"

    def of(self, t: np.ndarray, q: np.ndarray) -> "BSpline":
        """Return the curve of samples q (N, ...)."""
        from scipy.interpolate import make_interp_spline, make_lsq_spline  # a second to import, and only for samples

        if self.intervals is None:
            return make_interp_spline(t, q, k=self.degree)
        # As many samples lie in each interval.
        knots = np.interp(np.linspace(0, len(t) - 1, self.intervals + 1), range(len(t)), t)
        all_knots = np.pad(knots, self.degree, mode="edge")
        fitted = make_lsq_spline(t, q, all_knots, self.degree)
        # A second fit, to the residual, mends the rounding of the normal equations.
        fitted.c += make_lsq_spline(t, q - fitted(t), all_knots, self.degree).c
        return fitted

    def check(self, samples: int, place: str) -> None:
        """Raise `JounceError` if there are too few samples for the spline."""
        if not isinstance(self.degree, int) or self.degree not in SPLINE_DEGREES:
            degrees = " or ".join(map(str, SPLINE_DEGREES))
            raise JounceError(f"a spline of degree {quote_value(self.degree)} is not supported; expected {degrees}")
        most = samples - self.degree
        if most < 1:
            least = f"a spline of degree {self.degree} needs at least {self.degree + 1}"
            raise JounceError(f"{place}: {samples} samples; {least}")
        if self.intervals is not None and not (type(self.intervals) is int and 1 <= self.intervals <= most):
            raise JounceError(
                f"{place}: {quote_value(self.intervals)} intervals for {samples} samples; expected 1 to {most}"
            )


class CommandRows(Spline):
    """The way from rows of commands to a curve: see `motion.commands`.

    A controller takes one row per period.
    """

    def __str__(self) -> str:
        return "commands"


@dataclass(frozen=True, eq=False)
class SplineCurve(SmoothCurve):
    """A B-spline with values (columns,).

    `start` and `stop` are where its samples begin and end. Its jumps of the degree, at every knot, are of the
    method and not of the motion: they do not count.
    """

    spline: "BSpline"
    start: float
    stop: float

    @property
    def columns(self) -> int:
        return self.spline.c.shape[1]

    @property
    def highest(self) -> int:
        """The degree: derivatives beyond it are zero, and say nothing of the samples."""
        return int(self.spline.k)

    @np.errstate(over="ignore", invalid="ignore")  # whoever asks refuses what is not finite
    def rates(self, t: np.ndarray, order: int, left: bool = False) -> list[np.ndarray]:
        return [self.spline(t, nu=k) for k in range(order + 1)]


@dataclass(frozen=True, eq=False)
class SampledColumns:
    """Samples q (N, n) at times t (N,), and what messages need.

    The derivative of order `highest` is asked of them. Messages begin with `place` and call the columns `names`.
    `rounding` is the standard deviation of the rounding of t in s, beyond that of doubles.
    """

    t: np.ndarray
    q: np.ndarray
    highest: int
    place: str
    names: Sequence[str] | None = None
    symbol: str = "q"
    rounding: float = 0.0


def fit_spline(sampled: SampledColumns, spline: Spline) -> SplineCurve:
    """Return the spline of samples, and warn where rounding dominates."""
    t, highest, place, symbol = sampled.t, sampled.highest, sampled.place, sampled.symbol
    spline.check(len(t), place)
    if highest > spline.degree:
        wanted, last = rate_name(symbol, highest), f"{symbol}{spline.degree}d"
        raise JounceError(f"{place}: {wanted} asked of samples; a spline of degree {spline.degree} ends at {last}")
    try:
        curve = SplineCurve(spline.of(t, sampled.q), float(t[0]), float(t[-1]))
    except (ValueError, np.linalg.LinAlgError) as error:
        raise JounceError(f"{place}: no {spline} follows from these samples: {one_line(error)}") from None
    rates = curve.rates(t, highest)
    for k, rate in enumerate(rates):
        if not np.isfinite(rate).all():
            raise JounceError(f"{place}: {rate_name(symbol, k)} of the {spline} overflows; expected smaller samples")
    _warn_of_rounding(sampled, rates, spline)
    return curve


def select_smoothing(
    degree: int | None, intervals: int | None, bandwidth: float | None, allow_noise: bool, as_: str | None = None
) -> Smoothing | Spline:
    """Return the way from samples to a curve that a caller selects.

    `as_` is what the samples are, one of `ROW_KINDS`.
    """
    check_bool("allow_noise", allow_noise, "whether to accept samples whose noise dominates the highest rate")
    check_bandwidth(bandwidth)
    manual, smoothing = {"degree": degree, "intervals": intervals}, {"bandwidth": bandwidth, "allow_noise": allow_noise}
    by_hand = [option_name(name) for name, x in manual.items() if x is not None]
    smooth = [option_name(name) for name, x in smoothing.items() if x]
    if len(by_hand) > 0 and len(smooth) > 0:
        came = f"{smooth[0]} is for samples that are smoothed, and {by_hand[0]} is for ones that are not"
        raise JounceError(f"{came}; leave one of them out")
    if as_ is not None and check_choice("kind of rows", as_, ROW_KINDS) == ROW_KINDS[1]:
        if len(by_hand + smooth) > 0:
            raise JounceError(f"commands are taken as they are; leave out {(by_hand + smooth)[0]}")
        return CommandRows()
    if len(by_hand) == 0:
        return Smoothing(bandwidth, allow_noise)
    return Spline(7 if degree is None else degree, intervals)


def refuse_smoothing(way: Smoothing | Spline, place: str, reason: str) -> None:
    """Raise `JounceError` where options are for samples that are missing.

    The options say how samples become a curve; the reason says why there are no samples.
    """
    if isinstance(way, CommandRows):
        options = ["as_"]
    elif isinstance(way, Spline):
        options = ["degree" if way.intervals is None else "intervals"]
    else:
        options = [name for name, value in vars(way).items() if value]
    if len(options) > 0:
        raise JounceError(f"{place}: {reason}; {option_name(options[0])} is for samples: leave it out")


def check_bandwidth(bandwidth: object) -> None:
    """Raise `JounceError` where a bandwidth is neither None nor a frequency."""
    is_number = isinstance(bandwidth, int | float) and not isinstance(bandwidth, bool)
    if bandwidth is not None and not (is_number and 0 < bandwidth < np.inf):  # type: ignore[operator]
        raise JounceError(f"bandwidth is {quote_value(bandwidth)}; expected a frequency in Hz above 0")


@np.errstate(all="ignore")  # samples near the end of the doubles overflow here, and no more
def _warn_of_rounding(sampled: SampledColumns, rates: Sequence[np.ndarray], spline: Spline) -> None:
    """Warn where the samples' own rounding shows in the highest rate.

    Differentiation multiplies it by (1/dt)^k. A spline is linear in its samples, so the spline of random errors
    of their size shows what they do.
    """
    t, q, names, highest = sampled.t, sampled.q, sampled.names, sampled.highest
    # An error of q by its own rounding, and by that of t at the largest velocity, (n,).
    of_t = (np.finfo(float).eps * np.abs(t).max() + sampled.rounding) * np.abs(rates[min(1, highest)]).max(axis=0)
    size = np.nan_to_num(np.maximum([smoothness.rounding_error(column) for column in q.T], of_t))
    errors = np.random.default_rng(0).uniform(-1, 1, q.shape) * size
    error = np.abs(spline.of(t, errors)(t, nu=highest)).max(axis=0)
    shares = error / smoothness.rate_sizes(rates, float(np.ptp(t)))[highest]
    share, j = float(shares.max()), int(shares.argmax())
    worst = f"joint {j}" if names is None else names[j]
    if share > smoothness.MAX_ROUNDING_SHARE:
        came = f"{min(share, 1):.0%} of the largest {rate_name(sampled.symbol, highest)}, that of {worst}"
        warn(f"{sampled.place}: rounding of the samples makes up {came}; give more digits, wider steps, or all rates")
