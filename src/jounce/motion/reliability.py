"""Say how far a smoothing spline is known: its standard deviations, and what they mean.

Problem: the covariance of q, qd, ... of each joint at a time, of the least-squares spline of its samples. It is a sum
of independent parts, each positive semidefinite (`SplineCovariances`):

1. noise: ``(B^T B)^-1`` of the normal equations times the variance of white noise in that interval
2. corrected time stamps, by a parametric bootstrap (Efron & Tibshirani, An Introduction to the Bootstrap, 6.5)
3. residuals that are no noise, and vibrations that the spline leaves out: waves of their size
4. sensors that may be read earlier than the times say: a shift that is anywhere from 0 to that
5. the spline's own error, from a coarser one by Richardson's extrapolation

It says nothing of what neither spline resolves and the residuals do not show, as a burst below the noise. Across holes
that are longer than the intervals around them any motion may have happened: `refuse_holes` raises.

What is known well follows from deviations (`peaks_and_shares`, `find_surest_rows`, `find_window`). Towards the ends of
a fit they rise by powers of ten, and the values with them, so that the largest value says nothing: peaks are those that
stand out of their bands of 95 %. These functions serve channels of forces and limits too.
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
ERROR_DECAY_POWER = 15  # of the interval, with which the error of q falls: 10, and more near the limit of the band
BOOTSTRAP_DRAWS = 32  # of the scatter of stamps: deviations are known to 1 / sqrt(2 * 32) = 13 % then
DRAWS_PER_FIT = 4  # as columns of one problem
MAX_DEVIATION_ORDER = 6  # the highest derivative with a standard deviation
BAND_DEVIATIONS = 1.96  # standard deviations on either side: 95 % of a normal distribution
MAX_KNOWN_DEVIATION = 0.1  # of the peak of a derivative: noise alone is a third of its own
MAX_COMPARED_TIMES = 4000  # at which peaks and deviations are compared
INTERVALS_AROUND_HOLE = 3  # on either side, which determine how fast the motion is
MAX_HOLE_TO_INTERVAL = 1.0  # times the usual interval: a longer hole cannot be bridged
MAX_DEVIATION_TO_MEDIAN = 10.0  # in a window: towards the ends of a fit deviations rise by powers of ten
MAX_CERTAIN_SHARE = 0.05  # of a value, that its deviation is: its band of 95 % is a tenth of it
MAX_WINDOW_TIMES = 2000  # of a motion, for the median of deviations, which change slowly


@dataclass(frozen=True, eq=False)
class TimestampCovariances:
    """Covariances that the scatter of corrected time stamps leaves."""

    t: np.ndarray  # (T,), the times at which they are known
    values: np.ndarray  # (T, n, 7, 7), of q to q6d with each other

    def at(self, t: np.ndarray, order: int) -> np.ndarray:
        """Return covariances of q, qd, ... at times (P,).

        They are (P, n, order + 1, order + 1), linear between known ones.

        They are (P, n, order + 1, order + 1).
        """
        some = self.values[:, :, : order + 1, : order + 1]
        # Each entry of each joint's matrix is a function of time, (T, n, k, k) -> (n k k, T).
        columns = some.reshape(len(self.t), -1).T
        return np.stack([np.interp(t, self.t, column) for column in columns], axis=1).reshape(-1, *some.shape[1:])


@dataclass(frozen=True, eq=False)
class SplineCovariances:
    """Covariances of a least-squares spline: the sum that the head names."""

    solution: SplineSolution  # the spline, of the joints that move
    variance: np.ndarray  # (M, n), of white noise that is fitted as the samples' noise is
    coarser: "BSpline | None" = None  # a spline of fewer intervals, from which the error of the spline itself follows
    ratio: float = 1.0  # how many times fewer they are
    stamps: TimestampCovariances | None = None  # at times of their own: corrected rows may bear fewer breaks
    # (M, n), squares of residuals beyond noise, which count as a vibration at the end of the band.
    unfollowed: np.ndarray | None = None
    unsure: np.ndarray | None = None  # (n,), by how much sensors may be read earlier than the times say, s
    left_out: "tuple[Line, ...]" = ()  # vibrations that the spline does not follow

    def covariances(self, t: np.ndarray, order: int) -> np.ndarray:
        """Return covariances of q, qd, ... at times (P,).

        They are (P, n, order + 1, order + 1).
        """
        starts = range(0, max(1, len(t)), MAX_GATHERED_TIMES)
        return np.concatenate([self._covariances(t[start : start + MAX_GATHERED_TIMES], order) for start in starts])

    def _covariances(self, t: np.ndarray, order: int) -> np.ndarray:
        """Return the same at times that are gathered at once."""
        breaks, spline = self.solution.breaks, self.solution.spline
        bases = [least_squares.basis(t.clip(breaks[0], breaks[-1]), breaks, k) for k in range(order + 1)]
        # Derivatives of the ten B-splines at each time, (P, order + 1, 10), and the interval of each time, (P,).
        values, place = np.stack([row for row, _ in bases], axis=1), bases[0][1]
        # Noise: b^T (B^T B)^-1 b sigma^2 for derivatives b of the B-splines, (P, 1, k, k) times (P, n, 1, 1).
        total = self.variance[place][:, :, None, None] * (values @ self._blocks[place] @ values.mT)[:, None]
        # Corrected time stamps.
        if self.stamps is not None:
            total += self.stamps.at(t, order)
        if self.unfollowed is not None and self.unfollowed.any():
            # Residuals that are no noise: a wave of half a period per interval has rates that grow by pi / length.
            rate = np.pi / np.diff(breaks)[place, None]
            for k in range(order + 1):
                total[:, :, k, k] += self.unfollowed[place] * rate ** (2 * k)
        # Vibrations that the spline leaves out have uncorrelated rates: they add to diagonals alone.
        for line in self.left_out:
            total[:, line.joint, *np.diag_indices(order + 1)] += line.mean_squares(t, order)
        if self.unsure is not None and self.unsure.any():
            # A sensor that is read earlier by d has q off by qd d, qd by q2d d, ...: all rates of a joint by one d,
            # which is anywhere from 0 to `unsure`, with the root mean square unsure / sqrt(3).
            rates = np.stack([spline(t, nu=k + 1) for k in range(order + 1)], axis=-1)
            shifted = rates * self.unsure[:, None] / np.sqrt(3)
            total += shifted[..., :, None] * shifted[..., None, :]
        if self.coarser is not None:
            # The spline's own error is known per interval, and linear between their middles.
            middles = (breaks[1:] + breaks[:-1]) / 2
            for k, model in enumerate(self._model[: order + 1]):
                total[:, :, k, k] += np.stack([np.interp(t, middles, column) for column in model.T], axis=1)
        return total

    @cached_property
    def _blocks(self) -> np.ndarray:
        return least_squares.covariance_blocks(self.solution.factor)

    @cached_property
    def _model(self) -> list[np.ndarray]:
        """Return mean squares (M, n) of the spline's own error, per derivative.

        Richardson's extrapolation: the error e of the k-th derivative falls with the interval to the power p
        = ERROR_DECAY_POWER - k, so that a spline of r times fewer intervals differs by (r^p - 1) e. Squares
        are averaged over three intervals.
        """
        assert self.coarser is not None
        breaks = self.solution.breaks
        t = _quarter_points(breaks)
        out = []
        for k in range(MAX_DEVIATION_ORDER + 1):
            # With s = r^-p, the error is the difference over r^p - 1, which is the difference times s / (1 - s).
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

    Stamps scattered by sigma before, and joints have noise of a variance (n,) of their own. Corrected stamps are
    wrong by what a fit to the raw ones takes of their scatter: tau = (v^T D^-1 e) / (v^T D^-1 v), where e are
    splines fitted to v d with random d. The fit at corrected times takes v tau. Draws of d, from a fixed seed,
    give the covariances.
    """
    from scipy.interpolate import BSpline

    random = np.random.default_rng(0)
    v = raw.spline(rows.t, nu=1)
    # v^T D^-1 / (v^T D^-1 v), (P, n): it makes a shift tau of each row from what its joints are off.
    across = v / variance / np.maximum((v**2 / variance).sum(axis=1), np.finfo(float).tiny)[:, None]
    # Rows of cells are sums over orthonormal polynomials: each has the noise of one sample, whatever its weight.
    weight = rows.weight if rows.edges is None else np.ones(len(rows.t))
    equations = least_squares.factorize(rows.t, rows.weight, raw.breaks, in_cells=rows.edges is not None)
    times = _quarter_points(raw.breaks)
    total = np.zeros((len(times), v.shape[1], MAX_DEVIATION_ORDER + 1, MAX_DEVIATION_ORDER + 1))
    for _ in range(BOOTSTRAP_DRAWS // DRAWS_PER_FIT):
        # e: what the raw fit takes of random shifts d, several draws as columns of one problem, (P, n, draws).
        d = sigma * random.normal(size=(len(v), 1, DRAWS_PER_FIT))
        noise = (weight[:, None, None] * v[:, :, None] * d).reshape(len(v), -1)
        followed = ((noise - equations.fit(noise)[1]) / rows.weight[:, None]).reshape(*v.shape, DRAWS_PER_FIT)
        # tau: what correction makes of e, one shift of all joints per row, and the spline that follows v tau.
        tau = (across[:, :, None] * followed).sum(axis=1, keepdims=True)
        remainder = rows.weight[:, None] * (v[:, :, None] * tau).reshape(len(v), -1)
        curve = BSpline(raw.spline.t, equations.fit(remainder)[0], least_squares.FIT_DEGREE)
        # Its rates are errors of q, qd, ...: their products are averaged over draws, (T, n, 7, draws) -> (T, n, 7, 7).
        rates = [curve(times, nu=k).reshape(len(times), -1, DRAWS_PER_FIT) for k in range(MAX_DEVIATION_ORDER + 1)]
        e = np.stack(rates, axis=2)
        total += e @ e.mT / BOOTSTRAP_DRAWS
    return TimestampCovariances(times, total)


def _quarter_points(breaks: np.ndarray) -> np.ndarray:
    """Return four times in each interval, the middles of its quarters."""
    return (breaks[:-1, None] + np.diff(breaks)[:, None] * np.array([0.125, 0.375, 0.625, 0.875])).ravel()


# What can be trusted: no holes, peaks beyond their bands, windows.
def refuse_holes(t: np.ndarray, breaks: np.ndarray) -> None:
    """Raise `JounceError` where a hole is longer than intervals around it.

    Any motion may have happened there. Where no interval is around it, it is compared with the time that all
    other samples take.
    """
    gaps = np.diff(t)
    lengths = np.diff(breaks)
    for k in np.flatnonzero(gaps > smoothness.MIN_HOLE_TO_SPACING * np.median(gaps)):
        # The intervals that contain the hole have no samples to show how fast the motion is: those next to them do.
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
    """Describe samples that determine no spline of degree 9, by their gaps.

    Samples at times t (N,) leave coefficients undetermined.
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

    Peaks (7, n) are of q less the mean of samples q (N, n), of qd, ..., between the ends; shares are (7,).
    `deviations` of times (T,) are (7, T, n), 0 of joints that rest. Where a derivative is known, the next is no
    less than that of half a wave over the duration.
    """
    inside = np.linspace(*ends, min(MAX_COMPARED_TIMES, 4 * (len(spline.t) - 2 * spline.k)) + 2)[1:-1]
    # Sizes and deviations of each derivative, (7, T, n), and root mean squares of the worst joint, (7,).
    size = np.abs([spline(inside, nu=k) - (k == 0) * q.mean(axis=0) for k in range(MAX_DEVIATION_ORDER + 1)])
    off = deviations(inside)
    usual = np.sqrt((off**2).mean(axis=1).max(axis=1))
    # Noise makes peaks as well: what stands out of its deviation is motion, or a tenth where nothing stands out.
    certain = np.maximum((size - off).max(axis=(1, 2)), size.max(axis=(1, 2)) / 10)
    # Joints that rest in all digits have no peak, by which nothing can be divided.
    largest = np.maximum(certain, np.finfo(float).tiny)
    # A wave sin(pi t / duration) has the k-th peak pi / duration times the one before: a steady motion has less.
    duration = np.ptp(spline.t)
    for k in range(1, len(largest)):
        if usual[k - 1] < MAX_KNOWN_DEVIATION * largest[k - 1]:
            largest[k] = max(largest[k], largest[k - 1] * np.pi / duration)
    return size.max(axis=1), usual / largest


def find_surest_rows(values: np.ndarray, deviations: np.ndarray) -> np.ndarray:
    """Return where along the first axis absolute values are surely largest.

    Each counts less its band of 95 %. NaN do not count, unless all are.
    """
    sure = np.abs(values) - BAND_DEVIATIONS * deviations
    return np.asarray(np.argmax(np.where(np.isnan(sure), -np.inf, sure), axis=0))


def find_window(t: np.ndarray, deviations: np.ndarray, values: np.ndarray | None = None) -> tuple[float, float]:
    """Return the first and the last time at which deviations are usual.

    At these of the times (T,) all deviations (T, n) are at most ten times their medians. Values (T, n) whose
    band of 95 % is a tenth of them are known as well: a fast start is no uncertain end. Outside are the
    uncertain ends of a fit. Deviations that are not known, NaN, do not count.
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
