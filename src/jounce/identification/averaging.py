"""Average regressor and measured forces over short cells of time.

What is faster than the motion averages out.

Measured torques hold ripple of gears and noise far above the motion's band, and samples at a kilohertz repeat each
other. Averages over cells are the same linear map of both sides of Q = Y theta, so that the parameters stay what they
are, while the rows become few and nearly independent (the parallel decimation of M. Gautier, "Dynamic identification of
robots with power model", IEEE ICRA 1997).

Cells have one width, at most half the shortest period of the band: the frequency below which the forces of the model
have 99 % of their power, by a discrete Fourier transform. Samples count by their weights; empty cells are left out.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from jounce.core.typing import DriveTerm
from jounce.engine.drives import compute_regressor
from jounce.engine.engine import Engine
from jounce.identification.measurements import Measurements, median_step
from jounce.motion.motion import Motion

MAX_REGRESSOR_SAMPLES = 2000  # whose regressors are held at once: 8 MB of an arm of seven joints
BAND_POWER_SHARE = 0.99  # of the power of the model's forces: the band of a motion ends where it holds this much
MAX_SPECTRUM_SAMPLES = 1 << 16  # from which the band is found; a power of 2, of which FFTs are fast
CELLS_PER_PERIOD = 2.0  # of the highest frequency of the band: the Nyquist rate
MIN_RELATIVE_VARIATION = 1e-9  # of a standard deviation to the values: a column with less is constant but for rounding


@dataclass(frozen=True, eq=False)
class CellAverages:
    """Averages over C cells of time, of nv forces and P parameters."""

    Y: np.ndarray  # (C, nv, P) regressor
    off: np.ndarray  # (C, nv) measured forces less those of the model as it is
    model: np.ndarray  # (C, nv) forces of the model as it is
    counts: np.ndarray  # (C, nv) sums of the weights of the samples; 0 where nothing is measured
    spread: np.ndarray  # (C, nv) known variances of the averages, such as those that errors of the motion make


def average_forces(
    robot: Engine,
    motion: Motion,
    samples: Measurements,
    model: np.ndarray,
    terms: Sequence[DriveTerm],
    place: np.ndarray,
) -> CellAverages:
    """Average the regressor and the forces over cells of numbers (N,)."""
    # Weighted sums (C, nv, P + 1) of regressor and model, piece by piece: a cell may have samples of two pieces.
    total = np.zeros(())
    for part, Y in regressor_pieces(robot, motion, samples.t, terms):
        with_model = np.concatenate([Y, model[part, :, None]], axis=-1)
        if total.ndim == 0:
            total = np.zeros((place[-1] + 1, *with_model.shape[1:]))
        _add_rows(total, with_model * samples.weights[part, :, None], place[part])
    # Means, the same of both sides of Q = Y theta; cells without a force are 0 in both.
    measured, counts = weighted_means(samples.forces, samples.weights, place)
    total /= np.maximum(counts, np.finfo(float).tiny)[..., None]
    model = total[..., -1]
    return CellAverages(total[..., :-1], measured - model, model, counts, np.zeros_like(counts))


def regressor_pieces(
    robot: Engine, motion: Motion, t: np.ndarray, terms: Sequence[DriveTerm]
) -> Iterator[tuple[slice, np.ndarray]]:
    """Yield the regressor along a motion in pieces, drive terms included."""
    for start in range(0, len(t), MAX_REGRESSOR_SAMPLES):
        part = slice(start, start + MAX_REGRESSOR_SAMPLES)
        yield (
            part,
            np.asarray(compute_regressor(robot, "regressor", motion(t[part], 2), terms, base=motion.base(t[part], 2))),
        )


def number_cells(t: np.ndarray, width: float) -> np.ndarray:
    """Return the numbers of the cells of increasing times (N,).

    Cells have a width in s; empty ones do not count.
    """
    # Times on an edge belong to the later cell, also if they are rounded below it.
    return np.asarray(np.unique(np.floor((t - t[0]) / width * (1 + 1e-12)), return_inverse=True)[1])


def weighted_means(values: np.ndarray, weights: np.ndarray, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return weighted means over cells and sums of weights: (N, k) -> (C, k).

    Weights are (N, k), or (N, 1) for all columns.
    """
    total, sums = (np.zeros((place[-1] + 1, x.shape[1])) for x in (values, weights))
    _add_rows(total, values * weights, place)
    _add_rows(sums, weights, place)
    return total / np.maximum(sums, np.finfo(float).tiny), sums


def _add_rows(total: np.ndarray, values: np.ndarray, place: np.ndarray) -> None:
    """Add rows of values to a total, at increasing places."""
    # One sum for each run of equal places.
    starts = np.flatnonzero(np.diff(place, prepend=-1))
    total[place[starts]] += np.add.reduceat(values, starts)


def force_band(t: np.ndarray, forces: np.ndarray, velocities: np.ndarray, eps: np.ndarray) -> float:
    """Return the frequency below which forces have nearly all their power, Hz.

    Forces are (N, nv), and friction is included: it follows from the velocities (N, nc) of joints with smoothing
    velocities eps. Times (N,) increase.
    """
    # Even times for the Fourier transform, of the start of a log that is very long.
    step = median_step(t)
    even = t[0] + step * np.arange(min(MAX_SPECTRUM_SAMPLES, int((t[-1] - t[0]) / step) + 1))
    forces_with_friction = np.concatenate([forces, np.tanh(velocities / eps)], axis=1)
    columns = np.stack([np.interp(even, t, column) for column in forces_with_friction.T], axis=1)
    columns = columns - columns.mean(axis=0)
    # All columns count alike, whatever their units and sizes; constant ones have no band.
    sizes = columns.std(axis=0)
    varying = sizes > MIN_RELATIVE_VARIATION * np.abs(forces_with_friction).max(axis=0)
    power = np.cumsum((np.abs(np.fft.rfft(columns[:, varying] / sizes[varying], axis=0)) ** 2).sum(axis=1))
    return float(np.searchsorted(power, BAND_POWER_SHARE * power[-1]) / (len(even) * step))
