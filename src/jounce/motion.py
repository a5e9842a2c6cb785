"""Motions: coordinates over time with all the rates that higher-order inverse dynamics takes in."""

import re
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from jounce.errors import JounceError, JounceWarning, listed, no_such, one_line
from jounce.mechanism import Mechanism
from jounce.rates import rate_name

DEGREE = 7  # of the spline through samples: q is C^6, so that q4d is smooth and Q2d has no kinks
NOTICEABLE = 0.01  # share of rounding in a rate from which on a user should hear of it
RATE = re.compile(r"q(d|[2-9]d|[1-9]\d+d)?")


@dataclass(frozen=True)
class Motion:
    """Coordinates and their rates, each (N, n), at the times t, (N,)."""

    t: np.ndarray
    rates: tuple[np.ndarray, ...]
    source: str  # how the rates came about, in words


def from_table(columns: Mapping[str, np.ndarray], mechanism: Mechanism, highest: int, place: str) -> Motion:
    """The motion in a table, matched by joint name in any column order, with rates up to the one of order `highest`.

    Either `t` and one column per joint (samples: the rates are those of an interpolating spline of degree 7), or `t`
    and ``NAME.q, NAME.qd, NAME.q2d, ...`` for every joint (used as they are).

    Raises
    ------
    JounceError : where a joint or rate is missing, a column unknown, t does not increase, or there are too few samples.
    """
    joints, t = mechanism.coordinates, columns.get("t")
    if "t" in joints:
        raise JounceError(f"{place}: a joint is named 't', as the column of times is; give it another name")
    if t is None:
        raise JounceError(f"{place}: {no_such('column', 't', columns)}")
    steps = np.flatnonzero(np.diff(t) <= 0)
    if steps.size:
        i = int(steps[0])
        follows = f"{t[i]:.17g} is followed by {t[i + 1]:.17g}, rows {i} and {i + 1} counted from 0"
        raise JounceError(f"{place}: t does not increase: {follows}")
    given = [name for name in columns if name != "t"]
    wanted = [rate_name("q", k) for k in range(highest + 1)]
    sampled = not any(_is_rate(name, joints) for name in given)
    _check_columns(given, mechanism, [] if sampled else wanted, place)
    if sampled:
        return _spline(t, np.stack([columns[joint] for joint in joints], axis=1), highest, place)
    rates = tuple(np.stack([columns[f"{joint}.{rate}"] for joint in joints], axis=1) for rate in wanted)
    return Motion(t, rates, "all rates from the table")


def _is_rate(name: str, joints: Sequence[str]) -> bool:
    joint, _, rate = name.rpartition(".")
    return name not in joints and joint in joints and RATE.fullmatch(rate) is not None


def _check_columns(given: Sequence[str], mechanism: Mechanism, rates: Sequence[str], place: str) -> None:
    joints = mechanism.coordinates
    followers = set(mechanism.joints) - set(joints)
    expected = [f"{joint}.{rate}" for joint in joints for rate in rates] or list(joints)
    for name in given:
        if name in expected or (rates and _is_rate(name, joints)):  # rates beyond those needed do no harm
            continue
        if name in joints:
            raise JounceError(f"{place}: column {name!r} of samples beside columns of rates; expected one kind")
        if {name, name.rpartition(".")[0]} & followers:
            raise JounceError(f"{place}: column {name!r}: this joint follows another (mimic); leave it out")
        raise JounceError(f"{place}: {no_such('joint column', name, expected)}")
    missing = [repr(name) for name in expected if name not in given]
    if missing:
        columns = f"for each joint {', '.join(rates)}" if rates else listed(joints)
        raise JounceError(f"{place}: missing {', '.join(missing)}; expected t and {columns}")


def _spline(t: np.ndarray, q: np.ndarray, highest: int, place: str) -> Motion:
    from scipy.interpolate import make_interp_spline  # a second to import, and only for samples

    if len(t) <= DEGREE:
        raise JounceError(f"{place}: {len(t)} samples; a spline of degree {DEGREE} needs at least {DEGREE + 1}")
    if highest > DEGREE:
        asked = rate_name("q", highest)
        raise JounceError(f"{place}: {asked} asked of samples; a spline of degree {DEGREE} ends at q{DEGREE}d")
    try:
        spline = make_interp_spline(t, q, k=DEGREE)
    except ValueError as error:
        raise JounceError(f"{place}: no spline goes through these samples: {one_line(error)}") from None
    rates = (q, *(spline(t, nu=k) for k in range(1, highest + 1)))
    _warn_of_rounding(t, rates, place)
    return Motion(t, rates, f"samples, rates from a spline of degree {DEGREE} (C^{DEGREE - 1})")


@np.errstate(all="ignore")  # samples near the end of the doubles overflow here; their forces are refused later
def _warn_of_rounding(t: np.ndarray, rates: Sequence[np.ndarray], place: str) -> None:
    """Warn where the samples' own rounding shows in the highest rate: differentiation multiplies it by (1/dt)^k.

    A spline is linear in its samples, so the spline through random errors of their size tells what they do.
    """
    from scipy.interpolate import make_interp_spline

    highest = len(rates) - 1
    q, qd = rates[0], rates[min(1, highest)]
    of_t = np.finfo(float).eps * np.abs(t).max() * np.abs(qd).max(axis=0)
    size = np.nan_to_num(np.maximum([_resolution(column) for column in q.T], of_t))
    errors = np.random.default_rng(0).uniform(-1, 1, q.shape) * size
    error = np.abs(make_interp_spline(t, errors, k=DEGREE)(t, nu=highest)).max(axis=0)
    scales = [np.abs(rate).max(axis=0) / np.ptp(t) ** (highest - k) for k, rate in enumerate(rates)]
    share = float((error / np.maximum(np.max(scales, axis=0), np.finfo(float).tiny)).max())
    if share > NOTICEABLE:
        name = rate_name("q", highest)
        text = f"{place}: rounding of the samples makes up {min(share, 1):.0%} of the largest {name}"
        warnings.warn(f"{text}; give more digits, wider steps, or all rates", JounceWarning, stacklevel=3)


def _resolution(samples: np.ndarray) -> float:
    """Half a unit in the last place that the samples are given to: of their decimals, or of doubles."""
    ulp = np.finfo(float).eps * float(np.abs(samples).max()) / 2
    decimals = next((d for d in range(13) if np.array_equal(np.round(samples, d), samples)), None)
    return ulp if decimals is None or not np.ptp(samples) else max(ulp, 0.5 * 10.0**-decimals)
