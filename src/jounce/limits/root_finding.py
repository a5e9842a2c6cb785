"""Find zeros and maxima of many functions of time at once.

Each is sought between two times. Zeros are bracketed by Chandrupatla's method [1]: inverse quadratic interpolation
where the latest three points make it safe, else halving. The bracket always holds the zero and shrinks at every step;
functions without a change of sign return an end. Maxima are those of even grids, narrowed about the best point; of a
function with several peaks between two points of a grid any may be returned.

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
    """Find where functions, one at each place, change sign between two times.

    `f` takes times and the places that they belong to; `ends` (2, N) are its values at the two times, if known.
    Where a function does not change sign, its zero is taken at the end where it is smaller.
    """
    # Places whose brackets are still open: all arrays of a step have an entry for each of them.
    places = np.arange(len(low))
    a, b = low, high
    fa, fb = (f(a, places), f(b, places)) if ends is None else ends
    # The better end is the answer of places that close at once: those without a change of sign.
    zeros = np.where(np.abs(fa) <= np.abs(fb), a, b)
    places = places[np.sign(fa) * np.sign(fb) <= 0]
    a, b, fa, fb = (x[places] for x in (a, b, fa, fb))
    # The next time is looked for at a share of the way from a to b. Nothing is known yet: halve.
    share = np.full(len(a), 0.5)
    for _ in range(_MAX_CROSSING_STEPS):
        if places.size == 0:
            break
        # Evaluate all open places at once, and keep the part of each bracket that holds the change of sign: between
        # the newest point a and the point b on the other side. The point c is the one that both replace.
        t = a + share * (b - a)
        ft = f(t, places)
        keeps = np.sign(ft) == np.sign(fa)
        c, fc = np.where(keeps, a, b), np.where(keeps, fa, fb)
        b, fb = np.where(keeps, b, a), np.where(keeps, fb, fa)
        a, fa = t, ft
        # The better end is the answer so far; brackets as narrow as rounding are closed.
        zeros[places] = best = np.where(np.abs(fa) < np.abs(fb), a, b)
        tolerance = 4 * _ROOT_TOLERANCE * np.maximum(np.abs(best), (high - low)[places])
        width = np.abs(b - a)
        least_share = tolerance / np.maximum(width, np.finfo(float).tiny)
        share = _next_share((a, b, c), (fa, fb, fc), least_share)
        is_open = (width > 2 * tolerance) & (fa != 0)
        places, a, b, fa, fb, share = (x[is_open] for x in (places, a, b, fa, fb, share))
    return zeros


Three = tuple[np.ndarray, np.ndarray, np.ndarray]  # of the points a, b, c of each bracket, (N,) each


@np.errstate(all="ignore")
def _next_share(times: Three, values: Three, least: np.ndarray) -> np.ndarray:
    """Return the share of the way from a to b to take.

    The zero is between a and b; c is the point before. The share is that of inverse quadratic interpolation where this
    is monotone [1], else one half. It keeps `least` (N,) away from both ends, so that the bracket shrinks.
    """
    (a, b, c), (fa, fb, fc) = times, values
    # The parabola t(f) through the three points is monotone between a and b inside of these two curves of xi and phi.
    xi, phi = (a - b) / (c - b), (fa - fb) / (fc - fb)
    is_monotone = (phi**2 < xi) & ((1 - phi) ** 2 < 1 - xi)
    # Lagrange's form of the parabola at f = 0, as a share: (t - a) / (b - a).
    t = fa / (fb - fa) * fc / (fb - fc) + (c - a) / (b - a) * fa / (fc - fa) * fb / (fc - fb)
    least = np.minimum(least, 0.5)
    return np.clip(np.where(is_monotone & np.isfinite(t), t, 0.5), least, 1 - least)


def find_maxima(f: Callable[[np.ndarray], np.ndarray], low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Find where functions are largest between two times.

    Times are exact to the square root of rounding. `f` takes a grid (N, G) of times, one row for each function, and
    returns its values.
    """
    a, b = low, high
    for _ in range(_MAX_NARROWINGS):
        # (N,) -> (N, 17): an even grid of each bracket.
        t = a[:, None] + (b - a)[:, None] * np.linspace(0, 1, _SAMPLES_PER_BRACKET)
        # The best inner point and its neighbours are the next bracket; the ends are never its middle.
        best = f(t)[:, 1:-1].argmax(axis=1) + 1
        a, b = (t[np.arange(len(t)), best + side] for side in (-1, 1))
        # Stop where a finer grid would have no new times: its steps are below the spacing of doubles.
        if (b - a <= _SAMPLES_PER_BRACKET * np.spacing(np.abs(b))).all():
            break
    return (a + b) / 2
