"""Zeros and maxima of many functions of time at once, each between two times.

Zeros are bracketed by Chandrupatla's method [1]: inverse quadratic interpolation where the latest three points make it
safe, else halving. The bracket always holds the zero and shrinks at every step; functions without a change of sign
return an end. Maxima are those of even grids, narrowed about the best point; of a function with several peaks between
two points of a grid any may be returned.

[1] T. R. Chandrupatla, A new hybrid quadratic/bisection algorithm for finding the zero of a nonlinear function without
    using derivatives, Advances in Engineering Software 28 (1997).
"""

from collections.abc import Callable

import numpy as np

_MAX_CROSSING_STEPS = 60  # bisection alone takes 53 for all digits of a double
_ROOT_TOLERANCE = 1e-15  # relative, of times: about 4 units in the last place
_SAMPLES_PER_BRACKET = 17  # of a function, at even times: each round narrows the bracket to two of sixteen parts
_MAX_NARROWINGS = 9  # each to an eighth: after 1e-8 of the bracket a peak is as high as its neighbours


def find_roots(
    f: Callable[[np.ndarray, np.ndarray], np.ndarray], low: np.ndarray, high: np.ndarray, ends: np.ndarray | None = None
) -> np.ndarray:
    """Where functions, one at each place, change sign between two times.

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
    for _ in range(_MAX_CROSSING_STEPS):
        if not left.size:
            break
        # Evaluate all open places at once, and keep the part of each bracket that holds the change of sign.
        t = a + share * (b - a)
        ft = f(t, left)
        keeps = np.sign(ft) == np.sign(fa)
        c, fc = np.where(keeps, a, b), np.where(keeps, fa, fb)
        b, fb = np.where(keeps, b, a), np.where(keeps, fb, fa)
        a, fa = t, ft
        # The better end is the answer so far; brackets as narrow as rounding are closed.
        found[left] = best = np.where(np.abs(fa) < np.abs(fb), a, b)
        tolerance = 4 * _ROOT_TOLERANCE * np.maximum(np.abs(best), (high - low)[left])
        width = np.abs(b - a)
        share = _next_share(a, b, c, fa, fb, fc, tolerance / np.maximum(width, np.finfo(float).tiny))
        on = (width > 2 * tolerance) & (fa != 0)
        left, a, b, fa, fb, share = (x[on] for x in (left, a, b, fa, fb, share))
    return found


@np.errstate(all="ignore")
def _next_share(
    a: np.ndarray, b: np.ndarray, c: np.ndarray, fa: np.ndarray, fb: np.ndarray, fc: np.ndarray, least: np.ndarray
) -> np.ndarray:
    """Where to look next between a and b (Chandrupatla 1997): by inverse interpolation where that is monotone."""
    xi, phi = (a - b) / (c - b), (fa - fb) / (fc - fb)
    fits = (phi**2 < xi) & ((1 - phi) ** 2 < 1 - xi)
    t = fa / (fb - fa) * fc / (fb - fc) + (c - a) / (b - a) * fa / (fc - fa) * fb / (fc - fb)
    least = np.minimum(least, 0.5)
    return np.clip(np.where(fits & np.isfinite(t), t, 0.5), least, 1 - least)


def find_maxima(f: Callable[[np.ndarray], np.ndarray], low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Where functions are largest between two times, to the square root of rounding: the best of a grid, again."""
    a, b = low, high
    for _ in range(_MAX_NARROWINGS):
        t = a[:, None] + (b - a)[:, None] * np.linspace(0, 1, _SAMPLES_PER_BRACKET)
        best = f(t)[:, 1:-1].argmax(axis=1) + 1
        a, b = (t[np.arange(len(t)), best + side] for side in (-1, 1))
        if (b - a <= _SAMPLES_PER_BRACKET * np.spacing(np.abs(b))).all():  # no times of a finer grid are doubles
            break
    return (a + b) / 2
