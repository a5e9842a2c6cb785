"""Say how far a smoothing spline is known: its standard deviations, and what they mean.

Problem: the covariance of q, qd, ... of each joint at a time, of the least-squares spline of its samples. It is a sum
of independent parts, each positive semidefinite (`SplineCovariances`):

1. noise: coefficients have the covariance ``(B^T B)^-1`` of the normal equations, times the variance of white noise in
   the interval of that time, as if it were the same everywhere: only samples near by count
2. corrected time stamps, by a parametric bootstrap (Efron & Tibshirani, An Introduction to the Bootstrap, 6.5)
3. what the spline does not follow: residuals that are no noise, and vibrations, as waves of their size
4. sensors that may be read earlier than the times say: one shift per joint, anywhere from 0 to a bound
5. the spline's own error, from a coarser one by Richardson's extrapolation

The third and the last part add to variances alone, without correlations of derivatives.

The sum says nothing of what neither spline resolves and the residuals do not show, such as a burst below the noise.
Across holes that are longer than the intervals around them any motion may have happened: `refuse_holes` raises.

What is known well follows from deviations. Towards the ends of a fit they rise by powers of ten, and the values with
them, so that the largest value alone says nothing. `peaks_and_shares` takes their deviations off the values,
`find_surest_rows` their bands of 95 %, and `find_window` leaves the ends out. The latter two serve channels of forces
and limits too.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from jounce.core.errors import JounceError
from jounce.motion import least_squares, smoothness
from jounce.motion.least_squares import SplineRows, SplineSolution
from jounce.motion.spline import INTERPOLATION_OPTION

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

    from jounce.motion.vibrations import Line


MAX_GATHERED_TIMES = 20000  # for which ten coefficients' covariances are gathered at once: 16 MB
ERROR_DECAY_POWER = 15  # of the interval's length, like which q errs: 10 of short ones, more at the limit of the band
BOOTSTRAP_DRAWS = 32  # of the scatter of stamps: deviations are known to 1 / sqrt(2 * 32) = 13 % then
DRAWS_PER_FIT = 4  # as columns of one problem
MAX_DEVIATION_ORDER = 6  # the highest derivative with a standard deviation
BAND_DEVIATIONS = 1.96  # standard deviations on either side: 95 % of a normal distribution
MAX_KNOWN_DEVIATION = 0.1  # of the peak of a known derivative: the deviation of mere noise is a third of its peak
MAX_COMPARED_TIMES = 4000  # at which peaks and deviations are compared
INTERVALS_AROUND_HOLE = 3  # on either side, which determine how fast the motion is
MAX_HOLE_TO_INTERVAL = 1.0  # times the usual interval: a longer hole cannot be bridged
MAX_DEVIATION_TO_MEDIAN = 10.0  # in a window: towards the ends of a fit deviations rise by powers of ten
MAX_CERTAIN_SHARE = 0.05  # of a value, that its deviation is: its band of 95 % reaches a tenth of it to either side
MAX_WINDOW_TIMES = 2000  # at which callers of `find_window` take deviations, which change slowly


@dataclass(frozen=True, eq=False)
class TimestampCovariances:
    """Covariances that the scatter of time stamps leaves after correction."""

    t: np.ndarray  # (T,), the times at which they are known
    values: np.ndarray  # (T, n, 7, 7), of q to q6d with each other

    def at(self, t: np.ndarray, order: int) -> np.ndarray:
        """Return covariances of q, qd, ... at times (P,).

        They are (P, n, order + 1, order + 1), linear between known ones.
        """
        some = self.values[:, :, : order + 1, : order + 1]
        # Each entry of each joint's matrix is a function of time: with k = order + 1, (T, n, k, k) -> (n k k, T).
        columns = some.reshape(len(self.t), -1).T
        return np.stack([np.interp(t, self.t, column) for column in columns], axis=1).reshape(-1, *some.shape[1:])


@dataclass(frozen=True, eq=False)
class SplineCovariances:
    """Covariances of a least-squares spline: the sum that the head names."""

    solution: SplineSolution  # the spline, of the joints that move
    variance: np.ndarray  # (M, n), of the white noise that would disturb the fit as much as the samples' noise does
    coarser: "BSpline | None" = None  # a spline of fewer intervals, by which the error of the spline itself is known
    ratio: float = 1.0  # how many times fewer intervals it has: above 1 with a coarser spline
    stamps: TimestampCovariances | None = None  # at times of their own: corrected rows may bear fewer breaks
    # (M, n), mean squares of residuals beyond noise, which count as a vibration at the end of the band.
    unfollowed: np.ndarray | None = None
    unsure: np.ndarray | None = None  # (n,), by how much sensors may be read earlier than the times say, s
    left_out: "tuple[Line, ...]" = ()  # vibrations that the spline does not follow

    def covariances(self, t: np.ndarray, order: int) -> np.ndarray:
        """Return covariances of q, qd, ... at times (P,).

        They are (P, n, order + 1, order + 1).
        """
        # No times make one empty part.
        starts = range(0, max(1, len(t)), MAX_GATHERED_TIMES)
        return np.concatenate([self._covariances(t[start : start + MAX_GATHERED_TIMES], order) for start in starts])

    def _covariances(self, t: np.ndarray, order: int) -> np.ndarray:
        """Return the covariances at times that are few enough for the memory."""
        breaks, spline = self.solution.breaks, self.solution.spline
        bases = [least_squares.basis(t.clip(breaks[0], breaks[-1]), breaks, k) for k in range(order + 1)]
        # Derivatives of the ten B-splines at each time, (P, order + 1, 10), and the interval of each time, (P,).
        values, interval = np.stack([derivatives for derivatives, _ in bases], axis=1), bases[0][1]
        # Noise: the derivatives b c of the spline with coefficients c have the covariance sigma^2 b (B^T B)^-1 b^T.
        # Variances of joints, (P, n, 1, 1), times what all joints share, (P, 1, order + 1, order + 1).
        total = self.variance[interval][:, :, None, None] * (values @ self._blocks[interval] @ values.mT)[:, None]
        # What the correction of time stamps leaves is known at times of its own.
        if self.stamps is not None:
            total += self.stamps.at(t, order)
        # Residuals that are no noise: a wave of half a period per interval, the fastest that the spline has, turns by
        # pi over its length, and each derivative is larger by that rate.
        if self.unfollowed is not None and self.unfollowed.any():
            rate = np.pi / np.diff(breaks)[interval, None]
            for k in range(order + 1):
                total[:, :, k, k] += self.unfollowed[interval] * rate ** (2 * k)
        # Vibrations that the spline leaves out. Neighbouring derivatives of a wave at any phase are uncorrelated. Those
        # two orders apart have opposite signs, which is left out here: only diagonals grow.
        for line in self.left_out:
            total[:, line.joint, *np.diag_indices(order + 1)] += line.mean_squares(t, order)
        # A sensor that is read earlier by d has q off by qd d, qd by q2d d, ...: all derivatives of a joint by one d,
        # which is anywhere from 0 to `unsure`, with the root mean square unsure / sqrt(3).
        if self.unsure is not None and self.unsure.any():
            rates = np.stack([spline(t, nu=k + 1) for k in range(order + 1)], axis=-1)
            errors = rates * self.unsure[:, None] / np.sqrt(3)
            total += errors[..., :, None] * errors[..., None, :]
        # The spline's own error is known per interval, and taken as linear between the middles of these.
        if self.coarser is not None:
            middles = (breaks[1:] + breaks[:-1]) / 2
            for k, squares in enumerate(self._model[: order + 1]):
                total[:, :, k, k] += np.stack([np.interp(t, middles, column) for column in squares.T], axis=1)
        return total

    @cached_property
    def _blocks(self) -> np.ndarray:
        """Blocks (M, 10, 10) of (B^T B)^-1, one per interval."""
        return least_squares.covariance_blocks(self.solution.factor)

    @cached_property
    def _model(self) -> list[np.ndarray]:
        """Mean squares (M, n) of the spline's own error, per derivative.

        Richardson's extrapolation: the error e of the k-th derivative falls with the interval to the power p
        = ERROR_DECAY_POWER - k. A spline of r times fewer intervals has the error r^p e, and differs from this one
        by (r^p - 1) e. Squares are averaged over three intervals.
        """
        assert self.coarser is not None
        breaks = self.solution.breaks
        t = _quarter_points(breaks)
        out = []
        for k in range(MAX_DEVIATION_ORDER + 1):
            # The error is the difference over r^p - 1, which is the difference times s / (1 - s) with s = r^-p.
            shrinkage = self.ratio ** -(ERROR_DECAY_POWER - k)
            error = (self.solution.spline(t, nu=k) - self.coarser(t, nu=k)) * shrinkage / (1 - shrinkage)
            squares = (error**2).reshape(len(breaks) - 1, 4, -1).mean(axis=1)
            # Two splines may agree in an interval by chance: its neighbours count as well.
            padded = np.pad(squares, ((1, 1), (0, 0)), mode="edge")
            out.append((padded[:-2] + padded[1:-1] + padded[2:]) / 3)
        return out


def timestamp_covariances(
    rows: SplineRows, raw: SplineSolution, sigma: float, variance: np.ndarray
) -> TimestampCovariances:
    """Return covariances that the scatter of stamps leaves after correction.

    `raw` is the fit to `rows` at the stamps as they came, which scatter by sigma in s; joints have noise of a
    `variance` D (n,) of their own. Shifts d of rows put samples at velocities v off by v d. The raw fit follows a
    part e of this as if it were motion. The correction takes shifts from what is left, v d - e: it finds d - tau
    and leaves stamps wrong by tau = (v^T D^-1 e) / (v^T D^-1 v). The fit at corrected times follows v tau. Random
    d, from a fixed seed, give covariances of that.
    """
    from scipy.interpolate import BSpline

    random = np.random.default_rng(0)
    v = raw.spline(rows.t, nu=1)
    # v^T D^-1 / (v^T D^-1 v), (P, n): the product with what the joints of a row are off is its shift. At rest it is 0.
    across = v / variance / np.maximum((v**2 / variance).sum(axis=1), np.finfo(float).tiny)[:, None]
    # Rows of cells are sums over orthonormal polynomials, times their weights already: each has the scatter of one
    # sample, whatever its weight.
    weight = rows.weight if rows.edges is None else np.ones(len(rows.t))
    equations = least_squares.factorize(rows.t, rows.weight, raw.breaks, in_cells=rows.edges is not None)
    times = _quarter_points(raw.breaks)
    total = np.zeros((len(times), v.shape[1], MAX_DEVIATION_ORDER + 1, MAX_DEVIATION_ORDER + 1))
    for _ in range(BOOTSTRAP_DRAWS // DRAWS_PER_FIT):
        # The part e that the raw fit follows of random shifts d: right sides less residuals, without their weights.
        # Several draws are columns of one problem, (P, n, draws).
        d = sigma * random.normal(size=(len(v), 1, DRAWS_PER_FIT))
        right = (weight[:, None, None] * v[:, :, None] * d).reshape(len(v), -1)
        followed = ((right - equations.fit(right)[1]) / rows.weight[:, None]).reshape(*v.shape, DRAWS_PER_FIT)
        # One shift tau of all joints per row, (P, 1, draws), and the spline that follows v tau: corrected times differ
        # so little from the raw ones that the same equations serve.
        tau = (across[:, :, None] * followed).sum(axis=1, keepdims=True)
        remainder = rows.weight[:, None] * (v[:, :, None] * tau).reshape(len(v), -1)
        curve = BSpline(raw.spline.t, equations.fit(remainder)[0], least_squares.FIT_DEGREE)
        # Its derivatives are errors of q, qd, ... with the mean 0: their products, averaged over all draws, are
        # covariances, (T, n, 7, draws) -> (T, n, 7, 7).
        rates = [curve(times, nu=k).reshape(len(times), -1, DRAWS_PER_FIT) for k in range(MAX_DEVIATION_ORDER + 1)]
        errors = np.stack(rates, axis=2)
        total += errors @ errors.mT / BOOTSTRAP_DRAWS
    return TimestampCovariances(times, total)


def _quarter_points(breaks: np.ndarray) -> np.ndarray:
    """Return four times in each interval, the middles of its quarters."""
    return (breaks[:-1, None] + np.diff(breaks)[:, None] * np.array([0.125, 0.375, 0.625, 0.875])).ravel()


# What can be trusted: no holes, peaks beyond their bands, windows.
def refuse_holes(t: np.ndarray, breaks: np.ndarray) -> None:
    """Raise `JounceError` where a hole is longer than intervals around it.

    Any motion may have happened there. Where no interval is around it, it is compared with the time that all
    other samples span.
    """
    gaps = np.diff(t)
    lengths = np.diff(breaks)
    for k in np.flatnonzero(gaps > smoothness.MIN_HOLE_TO_SPACING * np.median(gaps)):
        # The hole begins in interval first - 1 and ends in interval last - 1. These have too few samples to show how
        # fast the motion is: some intervals before and after them do.
        first, last = np.searchsorted(breaks, [t[k], t[k + 1]]).clip(1, len(breaks) - 1)
        before = lengths[max(0, first - 1 - INTERVALS_AROUND_HOLE) : first - 1]
        around = np.concatenate([before, lengths[last : last + INTERVALS_AROUND_HOLE]])
        usual = float(np.median(around)) if around.size > 0 else float(np.ptp(t) - gaps[k])
        if gaps[k] > MAX_HOLE_TO_INTERVAL * usual:
            raise JounceError(
                f"no samples from t = {t[k]:.6g} to {t[k + 1]:.6g} s: {gaps[k]:.3g} s, where the motion can be"
                f" continued over {usual:.3g} s; split the log there, or set a lower bandwidth"
            )


def describe_undetermined(t: np.ndarray) -> str:
    """Describe samples at times t (N,) that determine no spline.

    The longest gap is where they leave coefficients undetermined, most likely.
    """
    gaps = np.diff(t)
    k = int(gaps.argmax())
    return (
        f"no spline of degree 9 follows from samples that are {gaps.min():.3g} to {gaps[k]:.3g} s apart, the latter"
        f" from t = {t[k]:.9g} to {t[k + 1]:.9g} s; split the log there, or interpolate it by"
        f" {INTERPOLATION_OPTION}"
    )


def peaks_and_shares(
    spline: "BSpline", deviations: Callable[[np.ndarray], np.ndarray], ends: tuple[float, float], q: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return peaks of q, qd, ..., and deviations as shares of them.

    Peaks (7, n) are the largest values between the ends: of q less the mean of samples q (N, n), of qd, .... Shares
    (7,) are root mean squares of the worst joint's deviations over the peak of all joints, from which deviations
    are taken off. Where a derivative is known, the peak of the next counts for no less than that of half a wave
    over the duration. `deviations` of times (T,) are (7, T, n), 0 of joints that rest.
    """
    # Four times for each interval, without the ends themselves.
    inside = np.linspace(*ends, min(MAX_COMPARED_TIMES, 4 * (len(spline.t) - 2 * spline.k)) + 2)[1:-1]
    # Sizes and deviations of each derivative, (7, T, n), and root mean squares of the worst joint, (7,).
    size = np.abs([spline(inside, nu=k) - (k == 0) * q.mean(axis=0) for k in range(MAX_DEVIATION_ORDER + 1)])
    off = deviations(inside)
    usual = np.sqrt((off**2).mean(axis=1).max(axis=1))
    # Noise makes peaks as well: what stands out of its deviation is motion. Where nothing stands out, a tenth of the
    # peak counts.
    sure = np.maximum((size - off).max(axis=(1, 2)), size.max(axis=(1, 2)) / 10)
    # Where all joints rest in all digits, peaks are 0 and so are deviations: shares are 0 over a tiny number.
    reference = np.maximum(sure, np.finfo(float).tiny)
    # A steady motion has no peaks of high derivatives, and any deviation is large beside them: those of a slow wave
    # sin(pi t / duration) count then, each pi / duration times the one before.
    duration = np.ptp(spline.t)
    for k in range(1, len(reference)):
        if usual[k - 1] < MAX_KNOWN_DEVIATION * reference[k - 1]:
            reference[k] = max(reference[k], reference[k - 1] * np.pi / duration)
    return size.max(axis=1), usual / reference


def find_surest_rows(values: np.ndarray, deviations: np.ndarray) -> np.ndarray:
    """Return where along the first axis absolute values are surely largest.

    Each counts less what its band of 95 % reaches to one side. NaN do not count, unless all are.
    """
    sure = np.abs(values) - BAND_DEVIATIONS * deviations
    return np.asarray(np.argmax(np.where(np.isnan(sure), -np.inf, sure), axis=0))


def find_window(t: np.ndarray, deviations: np.ndarray, values: np.ndarray | None = None) -> tuple[float, float]:
    """Return the first and the last time at which deviations are usual.

    At these of the times (T,) all deviations (T, n) are at most ten times the medians of their columns, or so small
    next to their values (T, n) that bands of 95 % reach a tenth of them: a fast start is no uncertain end. Outside are
    the uncertain ends of a fit. Columns with deviations that are not known, NaN, do not count.
    """
    has_deviations = ~np.isnan(deviations).any(axis=0)
    off = deviations[:, has_deviations]
    is_certain = off <= MAX_DEVIATION_TO_MEDIAN * np.median(off, axis=0)
    if values is not None:
        is_certain |= off <= MAX_CERTAIN_SHARE * np.abs(values[:, has_deviations])
    # Where no time is certain, the window is the first time alone.
    rows = np.flatnonzero(is_certain.all(axis=1))
    first, last = (rows[0], rows[-1]) if rows.size > 0 else (0, 0)
    return float(t[first]), float(t[last])
