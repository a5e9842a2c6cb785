"""Splines through sampled motions, and a warning where the samples' rounding would drown their rates."""

import warnings
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from jounce.errors import JounceError, JounceWarning, one_line
from jounce.motion.smoothness import resolution
from jounce.rates import rate_name

DEGREES = (5, 7)  # q is C^4 or C^6
DEGREE = 7  # unless asked otherwise: q4d is smooth then, and Q2d has no kinks
NOTICEABLE = 0.01  # share of rounding in a rate from which on a user should hear of it


def rates_through(
    t: np.ndarray, q: np.ndarray, highest: int, degree: int, place: str, symbol: str = "q"
) -> tuple[np.ndarray, ...]:
    """Samples q, (N, n), and the rates of the spline that interpolates them, up to the one of order `highest`."""
    from scipy.interpolate import make_interp_spline  # a second to import, and only for samples

    if degree not in DEGREES:
        raise JounceError(f"a spline of degree {degree} is not offered; there are: {', '.join(map(str, DEGREES))}")
    if len(t) <= degree:
        raise JounceError(f"{place}: {len(t)} samples; a spline of degree {degree} needs at least {degree + 1}")
    if highest > degree:
        asked = rate_name(symbol, highest)
        raise JounceError(f"{place}: {asked} asked of samples; a spline of degree {degree} ends at {symbol}{degree}d")
    interpolate = partial(make_interp_spline, t, k=degree)
    try:
        spline = interpolate(q)
    except ValueError as error:
        raise JounceError(f"{place}: no spline goes through these samples: {one_line(error)}") from None
    rates = (q, *(spline(t, nu=k) for k in range(1, highest + 1)))
    _warn_of_rounding(t, rates, interpolate, place, symbol)
    return rates


@np.errstate(all="ignore")  # samples near the end of the doubles overflow here; their forces are refused later
def _warn_of_rounding(
    t: np.ndarray, rates: Sequence[np.ndarray], interpolate: Callable[[np.ndarray], Any], place: str, symbol: str
) -> None:
    """Warn where the samples' own rounding shows in the highest rate: differentiation multiplies it by (1/dt)^k.

    A spline is linear in its samples, so the spline through random errors of their size tells what they do.
    """
    highest = len(rates) - 1
    q, qd = rates[0], rates[min(1, highest)]
    of_t = np.finfo(float).eps * np.abs(t).max() * np.abs(qd).max(axis=0)
    size = np.nan_to_num(np.maximum([resolution(column) for column in q.T], of_t))
    errors = np.random.default_rng(0).uniform(-1, 1, q.shape) * size
    error = np.abs(interpolate(errors)(t, nu=highest)).max(axis=0)
    scales = [np.abs(rate).max(axis=0) / np.ptp(t) ** (highest - k) for k, rate in enumerate(rates)]
    share = float((error / np.maximum(np.max(scales, axis=0), np.finfo(float).tiny)).max())
    if share > NOTICEABLE:
        name = rate_name(symbol, highest)
        text = f"{place}: rounding of the samples makes up {min(share, 1):.0%} of the largest {name}"
        warnings.warn(f"{text}; give more digits, wider steps, or all rates", JounceWarning, stacklevel=3)
