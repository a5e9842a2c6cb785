"""Peaks between samples: found on the polynomials of pieces, then placed by exact evaluation.

Polynomials whose Bernstein coefficients stay below a floor have no peak above it (the convex hull property [1]), which
discards most of them. On the others a change of sign of the slope between even samples brackets a peak, unless the
tangents there meet below the floor. Its place is the zero of the exact derivative, or, where the derivative is not
known or does not change its sign, the maximum on ever finer grids. Values are always exact; two peaks between the same
two samples of a polynomial count as one.

[1] G. Farin, Curves and Surfaces for CAGD, 5th edition, 2002.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from jounce.limits.limited_motion import LimitedMotion
from jounce.limits.motion_polynomials import Pieces, bernstein_coefficients, evaluate_polynomials
from jounce.limits.ratios import SIGNS
from jounce.limits.root_finding import find_maxima, find_roots
from jounce.model.limit_kinds import LIMIT_KINDS

_SAMPLES_PER_PIECE = 17  # of a polynomial: many for the six extremes of degree 7
_MIN_PEAK_HEIGHT = 1e-12  # of the values of a polynomial: lower peaks are rounding, and the ends as high


class Peaks(NamedTuple):
    """Local extremes, one each: of which kind, joint and sign (1: a maximum), the piece, the time and the value."""

    kind: np.ndarray  # of text
    joint: np.ndarray
    sign: np.ndarray
    t: np.ndarray
    value: np.ndarray


def find_peaks(b: LimitedMotion, pieces: Pieces, floor: Callable[[Pieces, str, int], np.ndarray]) -> Peaks:
    """The extremes inside pieces that pass a floor (K, n), given by kind and sign; each is exact."""
    found: list[tuple[np.ndarray, ...]] = []
    u = np.linspace(0, 1, _SAMPLES_PER_PIECE)
    for kind in pieces.kinds if pieces.width.all() else ():
        c = pieces.polynomials[kind]
        bernstein = bernstein_coefficients(c)
        for sign in SIGNS:
            # Discard polynomials that cannot reach the floor.
            least = floor(pieces, kind, sign)
            i, j = np.nonzero((sign * bernstein).max(axis=0) > least)
            if not i.size:
                continue
            # Samples between which the slope changes its sign, and the tangents meet above the floor.
            near = c[:, i, j]
            y, slope = (
                sign * evaluate_polynomials(x, u[:, None])
                for x in (near, near[:-1] * np.arange(len(c) - 1, 0, -1)[:, None])
            )
            inner = (slope[:-1] > 0) & (slope[1:] <= 0)
            tangents = np.maximum(
                y[:-1] + slope[:-1] / (_SAMPLES_PER_PIECE - 1), y[1:] - slope[1:] / (_SAMPLES_PER_PIECE - 1)
            )  # above any peak
            inner &= tangents > least[i, j]
            inner &= (slope[:-1] - slope[1:]) / _SAMPLES_PER_PIECE > _MIN_PEAK_HEIGHT * np.abs(y).max(axis=0)
            # Brackets in time, one sample wider on both sides: the polynomial may misplace the peak.
            at, which = np.nonzero(inner)
            start, width = pieces.start[i[which]], pieces.width[i[which], 0]
            low, high = (u[at_end.clip(0, _SAMPLES_PER_PIECE - 1)] * width + start for at_end in (at - 1, at + 2))
            high = np.minimum(high, np.nextafter(pieces.stop[i[which]], start))  # at a break another piece begins
            count = len(which)
            found.append((np.full(count, kind), j[which], np.full(count, sign), low, high))
    if not found:
        return _place_peaks(b, np.array([], dtype=str), *(np.array([], dtype=int),) * 2, *(np.array([]),) * 2)
    return _place_peaks(b, *(np.concatenate(column) for column in zip(*found, strict=True)))


def _place_peaks(
    b: LimitedMotion, kind: np.ndarray, joint: np.ndarray, sign: np.ndarray, low: np.ndarray, high: np.ndarray
) -> Peaks:
    """The exact extremes between two times each: where the derivative is 0, or on finer and finer grids."""
    if not kind.size:
        return Peaks(kind, joint, sign, low, low)

    def value(t: np.ndarray) -> np.ndarray:
        return pick_values(b, t, kind, joint, 0)

    channels = b.select_kinds(set(kind.tolist())).channels(low[:1])
    known = np.array([len(channels[k].rates) > LIMIT_KINDS[k].derivative + 1 for k in kind.tolist()])
    t, places = np.empty(len(low)), np.flatnonzero(known)
    if places.size:

        def slope(t: np.ndarray, at: np.ndarray) -> np.ndarray:
            return sign[at] * pick_values(b, t, kind[at], joint[at], 1)

        ends = np.stack([slope(end[places], places) for end in (low, high)])
        crosses = ends[0] * ends[1] <= 0  # else the polynomial and the value do not rise and fall alike
        known[places[~crosses]] = False
        places = places[crosses]
        t[places] = find_roots(lambda t, at: slope(t, places[at]), low[places], high[places], ends[:, crosses])
    if not known.all():

        def height(t: np.ndarray) -> np.ndarray:
            of, at = (np.repeat(column[~known], t.shape[1]) for column in (kind, joint))
            return sign[~known, None] * pick_values(b, t.ravel(), of, at, 0).reshape(t.shape)

        t[~known] = find_maxima(height, low[~known], high[~known])
    return Peaks(kind, joint, sign, t, value(t))


def pick_values(b: LimitedMotion, t: np.ndarray, kind: np.ndarray, joint: np.ndarray, derivative: int) -> np.ndarray:
    """What limits bound, of one kind and joint at each time, or a derivative of it."""
    found = np.empty(len(t))
    for name, channel in b.select_kinds(set(kind.tolist())).channels(t).items():
        mine = np.flatnonzero(kind == name)
        found[mine] = channel.rates[LIMIT_KINDS[name].derivative + derivative][mine, joint[mine]]
    return found
