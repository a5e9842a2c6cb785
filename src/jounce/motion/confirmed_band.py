"""The band up to which what is known of accelerations confirms those of a smoothed motion.

Problem: a smoothing follows all of a motion that stands out of the noise of its encoders. Where an encoder moves as the
link does not, by play, give or teeth between rotor and link, its samples hold accelerations a that no link has, whose
deviations are right for the encoder. No noise of positions shows it: torques do, which ask for accelerations a + e.

Algorithm: if the motion were smoothed to F, it would keep the errors e below F, and would lose the true motion a + e
above:

    S(F) = sum_{f <= F} |E(f)|^2 + sum_{f > F} |A(f) + E(f)|^2,    summed over joints, each over its sum of |A|^2,

with the transforms A, E of a and e. The band ends at the F of the least S. Noise of torques makes e as well, but of any
sign: both sums hold it alike, and S hardly changes with F where a is small.

Invariant: a band is lower only where it takes MIN_GAIN of S away and F is well below what the smoothing chose: neither
noise of torques nor errors of parameters do that.
"""

from dataclasses import dataclass

import numpy as np

MIN_GAIN = 1.3  # S(all) over S(F): play makes 1.5 to 10, and logs without it 1.1 at most
MAX_CONFIRMED_SHARE = 0.8  # of F to the bandwidth of the smoothing: more is the same bandwidth, but for its roll-off
UNCERTAIN_END_SHARE = 0.03  # of the cells at either end, whose accelerations have deviations that rise by powers of ten
MIN_CONFIRMED_CELLS = 16  # between the ends: of fewer, a transform has too few lines to find a band: all of it counts


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
