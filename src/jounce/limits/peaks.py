"""Peaks between samples: found on the polynomials, then placed by exact evaluation."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from jounce.limits.bounded import DERIVATIVE, Bounded
from jounce.limits.pieces import Pieces, hull

GRID = 17  # values of a polynomial on its piece, between which a peak is bracketed
FLAT = 1e-12  # of the values of a polynomial: lower peaks are rounding, and its ends as high
STEPS = 60  # of a search: far more than it takes
NARROWINGS = 9  # of a bracket, each to an eighth: closer than 1e-8 of it a peak is as high as its neighbours
EXACT = 1e-15


class Peaks(NamedTuple):
    """Local extremes, one each: of which kind, joint and sign (1: a maximum), the piece, the time and the value."""

    kind: np.ndarray  # of text
    joint: np.ndarray
    sign: np.ndarray
    t: np.ndarray
    value: np.ndarray


def peaks_of(b: Bounded, pieces: Pieces, floor: Callable[[Pieces, str, int], np.ndarray]) -> Peaks:
    """The extremes inside pieces that pass a floor (K, n), given by kind and sign; each is exact."""
    found: list[tuple[np.ndarray, ...]] = []
    u = np.linspace(0, 1, GRID)
    for kind in pieces.kinds if pieces.width.all() else ():
        c = pieces.polynomials[kind]
        bernstein = hull(c)
        for sign in (1, -1):
            least = floor(pieces, kind, sign)
            i, j = np.nonzero((sign * bernstein).max(axis=0) > least)
            if not i.size:
                continue
            near = c[:, i, j]
            y, slope = (sign * _on_grid(x, u) for x in (near, near[:-1] * np.arange(len(c) - 1, 0, -1)[:, None]))
            inner = (slope[:-1] > 0) & (slope[1:] <= 0) & (np.maximum(y[:-1], y[1:]) > least[i, j])
            inner &= (slope[:-1] - slope[1:]) / GRID > FLAT * np.abs(y).max(axis=0)
            at, which = np.nonzero(inner)
            start, width = pieces.start[i[which]], pieces.width[i[which], 0]
            low, high = (u[at_end.clip(0, GRID - 1)] * width + start for at_end in (at - 1, at + 2))
            count = len(which)
            found.append((np.full(count, kind), j[which], np.full(count, sign), low, high))
    if not found:
        return _placed(b, np.array([], dtype=str), *(np.array([], dtype=int),) * 2, *(np.array([]),) * 2)
    return _placed(b, *(np.concatenate(column) for column in zip(*found, strict=True)))


def _placed(
    b: Bounded, kind: np.ndarray, joint: np.ndarray, sign: np.ndarray, low: np.ndarray, high: np.ndarray
) -> Peaks:
    """The exact extremes between two times each: where the derivative is 0, or on finer and finer grids."""
    if not kind.size:
        return Peaks(kind, joint, sign, low, low)

    def value(t: np.ndarray) -> np.ndarray:
        return picked(b, t, kind, joint, 0)

    series = b.of_kinds(set(kind.tolist())).series(low[:1])
    known = np.array([len(series[k]) > DERIVATIVE.get(k, 0) + 1 for k in kind.tolist()])
    t = np.empty(len(low))
    if known.any():

        def slope(t: np.ndarray, at: np.ndarray) -> np.ndarray:
            return sign[known][at] * picked(b, t, kind[known][at], joint[known][at], 1)

        t[known] = root(slope, low[known], high[known])
    if not known.all():

        def height(t: np.ndarray) -> np.ndarray:
            of, at = (np.repeat(column[~known], t.shape[1]) for column in (kind, joint))
            return sign[~known, None] * picked(b, t.ravel(), of, at, 0).reshape(t.shape)

        t[~known] = narrowed(height, low[~known], high[~known])
    return Peaks(kind, joint, sign, t, value(t))


def picked(b: Bounded, t: np.ndarray, kind: np.ndarray, joint: np.ndarray, derivative: int) -> np.ndarray:
    """What limits bound, of one kind and joint at each time, or a derivative of it."""
    series = b.of_kinds(set(kind.tolist())).series(t)
    found = np.empty(len(t))
    for name, known in series.items():
        mine = np.flatnonzero(kind == name)
        found[mine] = known[DERIVATIVE.get(name, 0) + derivative][mine, joint[mine]]
    return found


def root(
    f: Callable[[np.ndarray, np.ndarray], np.ndarray], low: np.ndarray, high: np.ndarray, ends: np.ndarray | None = None
) -> np.ndarray:
    """Where functions, one at each place, change sign between two times: inverse interpolation, halving where it fails.

    `f` takes times and the places that they belong to; `ends` (2, N) are its values at the two times, if known.
    Where a function does not change sign, its zero is taken at the end where it is smaller.
    """
    left = np.arange(len(low))  # places that are not found yet
    a, b = low, high
    fa, fb = (f(a, left), f(b, left)) if ends is None else ends
    found = np.where(np.abs(fa) <= np.abs(fb), a, b)
    left = left[np.sign(fa) * np.sign(fb) <= 0]
    a, b, fa, fb = (x[left] for x in (a, b, fa, fb))
    share = np.full(len(a), 0.5)
    for _ in range(STEPS):
        if not left.size:
            break
        t = a + share * (b - a)
        ft = f(t, left)
        keeps = np.sign(ft) == np.sign(fa)
        c, fc = np.where(keeps, a, b), np.where(keeps, fa, fb)
        b, fb = np.where(keeps, b, a), np.where(keeps, fb, fa)
        a, fa = t, ft
        found[left] = best = np.where(np.abs(fa) < np.abs(fb), a, b)
        tolerance = 4 * EXACT * np.maximum(np.abs(best), (high - low)[left])
        width = np.abs(b - a)
        share = _share(a, b, c, fa, fb, fc, tolerance / np.maximum(width, np.finfo(float).tiny))
        on = (width > 2 * tolerance) & (fa != 0)
        left, a, b, fa, fb, share = (x[on] for x in (left, a, b, fa, fb, share))
    return found


@np.errstate(all="ignore")
def _share(
    a: np.ndarray, b: np.ndarray, c: np.ndarray, fa: np.ndarray, fb: np.ndarray, fc: np.ndarray, least: np.ndarray
) -> np.ndarray:
    """Where to look next between a and b (Chandrupatla 1997): by inverse interpolation where that is monotone."""
    xi, phi = (a - b) / (c - b), (fa - fb) / (fc - fb)
    fits = (phi**2 < xi) & ((1 - phi) ** 2 < 1 - xi)
    t = fa / (fb - fa) * fc / (fb - fc) + (c - a) / (b - a) * fa / (fc - fa) * fb / (fc - fb)
    least = np.minimum(least, 0.5)
    return np.clip(np.where(fits & np.isfinite(t), t, 0.5), least, 1 - least)


def narrowed(f: Callable[[np.ndarray], np.ndarray], low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Where functions are largest between two times, to the square root of rounding: the best of a grid, again."""
    a, b = low, high
    for _ in range(NARROWINGS):
        t = a[:, None] + (b - a)[:, None] * np.linspace(0, 1, GRID)
        best = f(t)[:, 1:-1].argmax(axis=1) + 1
        a, b = (t[np.arange(len(t)), best + side] for side in (-1, 1))
        if (b - a <= GRID * np.spacing(np.abs(b))).all():  # no times of a finer grid are doubles
            break
    return (a + b) / 2


def _on_grid(c: np.ndarray, u: np.ndarray) -> np.ndarray:
    """The values (grid, C) of polynomials with coefficients (degree + 1, C)."""
    value = np.zeros((len(u), c.shape[1]))
    for coefficient in c:
        value = value * u[:, None] + coefficient
    return value
