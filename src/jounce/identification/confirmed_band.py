"""The band up to which measured torques confirm the accelerations of a smoothed motion.

Problem: a smoothing follows all of a motion that stands out of the noise of its encoders. Where an encoder moves as the
link does not, by play, give or teeth between rotor and link, its samples hold accelerations that no link has, whose
deviations are right for the encoder. No noise of positions shows it: torques do.

Algorithm: of each cell, e = M(p)^-1 (tau - Y p) is the acceleration that torques ask for beyond the smoothed one, a.
If the motion were smoothed to F, it would keep the errors e below F, and would lose the true motion a + e above:

    S(F) = sum_{f <= F} |E(f)|^2 + sum_{f > F} |A(f) + E(f)|^2,    summed over joints, each over its sum of |A|^2,

with the transforms A, E of a and e. The band ends at the F of the least S. Noise of torques makes e as well, but of any
sign: both sums hold it alike, and S hardly changes with F where a is small.

Invariants: a motion is smoothed to F only where that takes MIN_GAIN of S away and F is well below what its smoothing
chose: neither noise of torques nor errors of p do that. Without torques of all joints, with a mass matrix that is not
positive definite (parameters that no robot has), of motions that are no smoothed samples, or have a bandwidth that
their user states, nothing is said.
"""

from dataclasses import dataclass

import numpy as np

from jounce.identification.averaging import number_cells, weighted_means
from jounce.identification.least_squares_problem import IdentificationProblem
from jounce.motion.resmoothing import chosen_bandwidth

MIN_GAIN = 1.3  # S(all) over S(F): play makes 1.5 to 10, and logs without it 1.1 at most
MAX_CONFIRMED_SHARE = 0.8  # of F to the bandwidth of the smoothing: more is the same bandwidth, but for its roll-off
UNCERTAIN_END_SHARE = 0.03  # of the cells at either end, whose accelerations have deviations that rise by powers of ten
MIN_CONFIRMED_CELLS = 16  # between the ends: of fewer, a transform has too few lines to find a band: all of it counts
MIN_MASS_RATIO = 1e-6  # of eigenvalues of a mass matrix with ones on its diagonal: less is no robot


@dataclass(frozen=True)
class BandErrors:
    """Squares of the errors of accelerations, over those of accelerations: S, as torques show them."""

    frequency: float  # F of the least S, Hz
    least: float  # S(F)
    total: float  # S of all frequencies
    chosen: float  # the bandwidth that the motion is smoothed to, Hz

    @property
    def is_lower(self) -> bool:
        """Whether torques confirm less than what the motion is smoothed to."""
        return 0 < self.frequency < MAX_CONFIRMED_SHARE * self.chosen and self.total > MIN_GAIN * self.least


def find_band(posed: IdentificationProblem, x: np.ndarray) -> BandErrors | None:
    """The band up to which torques confirm a motion, by corrections x; None where they say nothing of it."""
    chosen, counts = chosen_bandwidth(posed.motion), posed.cells.counts
    if chosen is None or posed.errors is None or not (counts > 0).any(axis=0).all():
        return None
    M = posed.errors.mass_matrix(x)
    if M.shape[1] != M.shape[2] or not _are_inertias(M):
        return None
    # what torques ask for beyond the accelerations: nothing where one of them is not measured
    t, place = posed.samples.t, number_cells(posed.samples.t, posed.width)
    rest = (posed.cells.off - posed.cells.Y[..., posed.columns] @ x) * (counts > 0).all(axis=1, keepdims=True)
    e, ones = np.linalg.solve(M, rest[..., None])[..., 0], np.ones((len(t), 1))
    a, times = (weighted_means(of, ones, place)[0] for of in (posed.motion(t, 2)[2], t[:, None]))
    return band_errors(times[:, 0], a, e, chosen)


def band_errors(t: np.ndarray, a: np.ndarray, e: np.ndarray, chosen: float) -> BandErrors | None:
    """The least S of accelerations a (C, n) and what is missing of them, e (C, n), at even times (C,)."""
    end = int(UNCERTAIN_END_SHARE * len(t))
    t, a, e = (x[end : len(x) - end] for x in (t, a, e))
    if len(t) < 2:
        return None
    window = np.hanning(len(t))[:, None]
    A, E = (np.fft.rfft(x * window, axis=0) for x in (a, e))
    power = (np.abs(A) ** 2).sum(axis=0)
    if not (moves := power > 0).any():
        return None
    kept, lost = ((np.abs(x[:, moves]) ** 2 / power[moves]).sum(axis=1) for x in (E, A + E))
    S = np.cumsum(kept) + lost.sum() - np.cumsum(lost)
    best = int(S.argmin()) if len(t) >= MIN_CONFIRMED_CELLS else len(S) - 1
    return BandErrors(best / (len(t) * float(np.median(np.diff(t)))), float(S[best]), float(S[-1]), chosen)


def _are_inertias(M: np.ndarray) -> bool:
    """Whether all mass matrices (C, n, n) are positive definite, well beyond rounding."""
    diagonal = np.diagonal(M, axis1=1, axis2=2)
    if not (diagonal > 0).all():
        return False
    scaled = M / np.sqrt(diagonal[:, :, None] * diagonal[:, None, :])
    return bool((np.linalg.eigvalsh(scaled)[:, 0] > MIN_MASS_RATIO).all())
