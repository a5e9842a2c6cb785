"""Find delays of measured forces, and take them out of their times.

Forces that pass another filter, another bus or another clock than positions are late: tau(t + d) = Y(t) p + n. Sought
is d. Parameters p adapt to a delay, but cannot take the place of one.

Algorithm: variable projection. For each delay of a coarse grid the forces are read at times as much later, averaged
over the same cells, and what no p explains is compared. From the least, one Newton step along the derivative of the
forces by the delay, with an instrument: the derivative of what p explains of them. That of measured forces has their
noise, and squared it is too large, by so much where cells hold few samples that a step ends next to where it began
(errors in variables). Delays are whole samples: a mean of two has half of the noise, which is no better match. The
deviation follows from the spectra of the residuals and from the halves of the log, as those of parameters do (see
`noise_spectra`). A delay of several deviations is taken out, the problem is posed without it, since laws of friction
were chosen with it, and the rest of the delay is sought again.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Protocol, TypeVar

import numpy as np

from jounce.core import cures, scalars
from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, quote_value
from jounce.identification import noise_spectra
from jounce.identification.averaging import CellAverages, number_cells, weighted_means
from jounce.identification.measurements import MeasuredLog, Measurements, median_step

MAX_DELAY = 0.2  # s, beyond which forces and positions hardly come from one log
MAX_DELAY_SHARE = 0.1  # of the time that is used: the ends, which are left out, are twice as much
MAX_DELAY_COUNT = 40  # of the delays that are tried on either side of 0: they are 5 ms apart, or a sample
MIN_DELAY_COUNT = 2  # of these, where samples are as far apart as MAX_DELAY
MIN_DELAY_DEVIATIONS = 4.0  # of a delay that is taken out: chance makes one of 16,000 logs that late
MIN_DELAY_STEPS = 0.1  # of samples: stamps are hardly better
MAX_DELAY_ROUNDS = 3  # each leaves a tenth of a delay at most
MAX_MATCH_SHARE = 0.5  # of mean squares left by the best delay to usual ones: forces that follow no motion have no best
DELAY_RANK_TOLERANCE = 1e-9  # of singular values to the largest: directions with less hold no data


class PosedEquations(Protocol):
    """Equations of forces, averaged over cells: what a delay is found from."""

    @property
    def samples(self) -> Measurements: ...  # noqa: D102
    @property
    def cells(self) -> CellAverages: ...  # noqa: D102
    @property
    def columns(self) -> np.ndarray: ...  # noqa: D102  those that are fitted
    @property
    def width(self) -> float: ...  # noqa: D102  of the cells, s


P = TypeVar("P", bound=PosedEquations)


def pose_without_delays(
    pose: Callable[[Sequence[MeasuredLog]], list[P]],
    logs: Sequence[MeasuredLog],
    stated: float | None = None,
) -> tuple[list[P], list[float], list[list[str]]]:
    """Pose the problems of logs with forces at times without their delay.

    Returns also the delays in s, and notes on them, by log. A stated delay is taken as it is; one that is left then is
    named.
    """
    shortest = min(of.motion.duration for of in logs)
    if stated is not None and not (scalars.is_finite(stated) and abs(stated) < shortest / 2):
        expected = f"seconds by which forces come after positions, less than half of the motion's {shortest:.3g}"
        raise JounceError(f"delay is {quote_value(stated)}; expected {expected}")
    # Of each log: the delay taken out so far, and the share of the mean squares that remains.
    total, share = np.full(len(logs), 0.0 if stated is None else float(stated)), np.ones(len(logs))
    notes: list[list[str]] = [[] for _ in logs]
    posed = pose([log.earlier(d) for log, d in zip(logs, total.tolist(), strict=True)])
    for _ in range(MAX_DELAY_ROUNDS):
        last_total = total.copy()
        for k, problem in enumerate(posed):
            # A delay once found is certain: what is left of it needs few deviations.
            fitted = replace(problem.cells, Y=problem.cells.Y[..., problem.columns])
            certain = MIN_DELAY_DEVIATIONS if len(notes[k]) == 0 else 1.0
            delay = _find_delay(fitted, problem.samples, problem.width, certain)
            if delay is None:
                continue
            late, deviation, remainder = delay
            # A stated delay is not corrected.
            if stated is not None:
                besides = cures.option_value("delay", stated)
                notes[k] = [f"measured forces come {_describe(late, deviation)}, besides {besides}"]
                continue
            total[k], share[k] = total[k] + late, share[k] * remainder
            effect = (
                f"{np.sqrt(share[k]):.0%} of what is unexplained remains; {Remedy('delay=0', '--delay 0')} leaves it in"
            )
            notes[k] = [f"measured forces come {_describe(total[k], deviation)}, which is taken out: {effect}"]
        # Laws of friction were chosen with the delays: logs are posed again, once for all of them.
        if (total == last_total).all():
            break
        posed = pose([log.earlier(d) for log, d in zip(logs, total.tolist(), strict=True)])
    return posed, total.tolist(), notes


def _describe(late: float, deviation: float) -> str:
    return f"{1e3 * abs(late):.3g} +- {1e3 * deviation:.2g} ms {'after' if late > 0 else 'before'} the positions"


def _find_delay(
    cells: CellAverages, samples: Measurements, width: float, certain: float
) -> tuple[float, float, float] | None:
    """Return the delay of measured forces, its deviation, and the remaining share.

    The delay is in s, the share that of the mean squares of residuals. None if a delay has fewer deviations than are
    certain, or is too short to matter. Early forces have a negative one. Runs once per log and round.
    """
    t, place = samples.t, number_cells(samples.t, width)
    delays = _tried_delays(t)
    longest, no_delay = float(delays[-1]), len(delays) // 2
    # Cells near the ends are left out, so that all delays are compared on the same cells.
    centres = weighted_means(t[:, None], np.ones((len(t), 1)), place)[0]
    inside = (cells.counts > 0) & (centres > t[0] + longest) & (centres < t[-1] - longest)
    if no_delay < MIN_DELAY_COUNT or len(inside) < 3 or np.count_nonzero(inside) <= 2 * cells.Y.shape[-1]:
        return None
    # Forces read later by each delay, and without those of the model: (C, nv, delays).
    read = np.stack([_delayed_averages(samples, place, delay) for delay in delays], axis=-1)
    off = (read - cells.model[..., None]) * inside[..., None]
    # Variable projection: what no parameters explain of the forces, for all delays at once. Forces of all sizes count
    # alike at first, then as exact as they are found to be.
    weights = np.sqrt(cells.counts) * inside
    for _ in range(2):
        roots = weights
        Z = _orthonormal(cells.Y * roots[..., None])
        residuals = off * roots[..., None]
        residuals = residuals - Z @ noise_spectra.gram(Z, residuals)
        total = (residuals**2).sum(axis=(0, 1))
        # The best delay that has a neighbour on either side, for the slope.
        best = int(total[1:-1].argmin()) + 1
        means = (residuals[..., best] ** 2).sum(axis=0) / np.maximum(inside.sum(axis=0), 1)
        # Forces that are exactly explained have no noise to compare a delay with.
        if not (means[inside.any(axis=0)] > 0).all():
            return None
        weights = weights / np.sqrt(np.where(means > 0, means, 1.0))
    # The Newton step from the best of these delays, along the instrument z (C, nv, 1): the slope of what parameters
    # explain, as far as no parameters take it, of length 1.
    best_residuals = residuals[..., best]
    slope = (residuals[..., best + 1] - residuals[..., best - 1]) / (delays[2] - delays[0])
    z = _explained_slope(read[..., best], best_residuals, roots, centres[:, 0])
    z = z - Z @ noise_spectra.gram(Z, z)
    z = z / max(float(np.linalg.norm(z)), np.finfo(float).tiny)
    # z^T (r + step slope) = 0. Constant forces, or parameters that do not explain them, have no slope along z.
    size = float(noise_spectra.gradient(z, slope)[0])
    if not size > 0:
        return None
    step = -float(noise_spectra.gradient(z, best_residuals)[0]) / size
    rest = best_residuals + step * size * z[..., 0]
    # Its deviation, by the spectra of what is left then, and by the halves of the log.
    leverages = noise_spectra.leverages(np.concatenate([Z, z], axis=-1))
    spectra = noise_spectra.noise_spectra(leverages, rest, np.zeros(rest.shape[1]))
    halves = max(1.0, float(noise_spectra.log_scatter(z, rest, spectra)[0]))
    deviation = float(np.sqrt(halves * noise_spectra.spectral_gram(z, spectra)[0, 0])) / size
    delay = float(delays[best]) + step
    follows = total[best] < MAX_MATCH_SHARE * np.median(total)
    if not follows or abs(delay) < max(certain * deviation, MIN_DELAY_STEPS * median_step(t)):
        return None
    return delay, deviation, float((rest**2).sum() / total[no_delay])


def _tried_delays(t: np.ndarray) -> np.ndarray:
    """Return the delays in s to try: whole samples of times (N,), 0 in the middle."""
    longest, sample = MAX_DELAY_SHARE * float(t[-1] - t[0]), median_step(t)
    # The fewest samples between delays with which MAX_DELAY_COUNT of them reach far enough, but for rounding.
    spacing = sample * max(1, np.ceil(min(MAX_DELAY, longest) / (MAX_DELAY_COUNT * sample) * (1 - 1e-9)))
    count = int(min(max(MAX_DELAY, MIN_DELAY_COUNT * spacing), longest) / spacing * (1 + 1e-9))
    return spacing * np.arange(-count, count + 1)


def _explained_slope(forces: np.ndarray, residuals: np.ndarray, roots: np.ndarray, centres: np.ndarray) -> np.ndarray:
    """Return time derivatives of what is explained of forces: (C, nv, 1).

    They are times the roots of the weights, as residuals are, and 0 where a force is not measured in a cell or in one
    next to it.
    """
    measured = roots > 0
    explained = forces - np.divide(residuals, roots, out=np.zeros_like(residuals), where=measured)
    inside = measured & np.roll(measured, 1, axis=0) & np.roll(measured, -1, axis=0)
    return np.asarray((np.gradient(explained, centres, axis=0) * roots * inside)[..., None])


def _delayed_averages(samples: Measurements, place: np.ndarray, delay: float) -> np.ndarray:
    """Return averages over cells of forces, read later by a delay: (C, nv)."""
    read = np.zeros_like(samples.forces)
    for j in np.flatnonzero((samples.weights > 0).any(axis=0)):
        measured = samples.weights[:, j] > 0
        read[:, j] = np.interp(samples.t + delay, samples.t[measured], samples.forces[measured, j])
    return weighted_means(read, samples.weights, place)[0]


def _orthonormal(rows: np.ndarray) -> np.ndarray:
    """Return orthonormal columns with the span of columns: (C, nv, P) -> (C, nv, r)."""
    # Columns of unit length, so that units of parameters do not decide on the rank.
    A = rows.reshape(-1, rows.shape[-1])
    U, sizes, _ = np.linalg.svd(A / np.maximum(np.linalg.norm(A, axis=0), 1e-300), full_matrices=False)
    return np.asarray(U[:, sizes > DELAY_RANK_TOLERANCE * sizes[0]].reshape(*rows.shape[:2], -1))
