"""A delay between measured forces and the motion, by which the identified robot would explain them better.

Forces that pass another filter, another bus or another clock than positions are late. For each of some delays the
forces are read at times as much later, the same equations are solved, and what they leave is compared. Parameters adapt
to a delay, but cannot take the place of one.
"""

import numpy as np

from jounce.identification.cells import averages, places
from jounce.identification.problem import Problem

MAX_DELAY = 0.2  # s, beyond which forces and positions hardly come from one log
MAX_DELAY_SHARE = 0.1  # of the time that is used: the ends, which are left out, are twice as much
DELAY_COUNT = 81  # of the delays that are tried, 5 ms apart; odd, so that one of them is 0
MAX_REMAINDER_RATIO = 0.8  # of mean squares left with the best delay to those without one, for a delay to be reported
DELAY_RANK_TOLERANCE = 1e-9  # of singular values to the largest: directions with less hold no data


def find_delay(posed: Problem) -> tuple[float, float] | None:
    """Return how late measured forces are, s, and which share of what is left without a delay remains then.

    None if no delay explains a fifth of what is left. Forces that are early have a negative delay.
    """
    samples = posed.given.part(posed.used)
    t, place = samples.t, places(samples.t, posed.width)
    longest = min(MAX_DELAY, MAX_DELAY_SHARE * (t[-1] - t[0]))
    centres, there = averages(t[:, None], np.ones((len(t), 1)), place)[0][:, 0], posed.cells.counts > 0
    inner = (centres > t[0] + longest) & (centres < t[-1] - longest)
    kept = there & inner[:, None]
    columns = posed.cells.Y[..., posed.columns][kept]
    if longest <= 0 or len(columns) <= 2 * columns.shape[1]:
        return None
    delays = np.linspace(-longest, longest, DELAY_COUNT)
    late = np.stack([_read_later(samples.forces, samples.weights, t, place, delay) for delay in delays])
    off = (late - posed.cells.model)[:, kept].T  # (rows, delays)
    force = np.nonzero(kept)[1]
    weights = np.sqrt(posed.cells.counts[kept])
    for _ in range(2):  # forces of all sizes alike at first, then as exact as they are found to be
        left = _remainders(columns * weights[:, None], off * weights[:, None])
        here = left[:, DELAY_COUNT // 2] ** 2
        means = np.bincount(force, here) / np.maximum(np.bincount(force), 1)
        if not (means[force] > 0).all():
            return None  # exactly explained
        weights = weights / np.sqrt(means[force])
    total = (left**2 / means[force][:, None]).sum(axis=0)
    best = int(total.argmin())
    ratio = float(total[best] / total[DELAY_COUNT // 2])
    return None if ratio > MAX_REMAINDER_RATIO else (float(delays[best]), ratio)


def _read_later(forces: np.ndarray, weights: np.ndarray, t: np.ndarray, place: np.ndarray, delay: float) -> np.ndarray:
    """The averages over cells of forces (N, nv) at times that are later by a delay."""
    read = np.zeros_like(forces)
    for j, (column, weight) in enumerate(zip(forces.T, weights.T, strict=True)):
        if (there := weight > 0).any():
            read[:, j] = np.interp(t + delay, t[there], column[there])
    return averages(read, weights, place)[0]


def _remainders(columns: np.ndarray, right: np.ndarray) -> np.ndarray:
    """What least squares leaves of right sides."""
    U, sizes, _ = np.linalg.svd(columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300), full_matrices=False)
    U = U[:, sizes > DELAY_RANK_TOLERANCE * sizes[0]]
    return np.asarray(right - U @ (U.T @ right))
