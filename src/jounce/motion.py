"""Motions: coordinates over time with all the rates that higher-order inverse dynamics takes in."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from jounce.errors import JounceError, no_such
from jounce.mechanism import Mechanism
from jounce.rates import rate_name

DEGREE = 7  # of the spline through samples: q is C^6, so that q4d is smooth and Q2d has no kinks


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
    if t is None:
        raise JounceError(f"{place}: no column 't'; there are: {', '.join(columns)}")
    steps = np.flatnonzero(np.diff(t) <= 0)
    if steps.size:
        i = int(steps[0])
        raise JounceError(
            f"{place}: t does not increase: {t[i]:.17g} is followed by {t[i + 1]:.17g}, rows {i} and {i + 1} from 0"
        )
    given = [name for name in columns if name != "t"]
    wanted = [rate_name("q", k) for k in range(highest + 1)]
    sampled = not any(name not in joints and _splits(name, joints) for name in given)
    _check_columns(given, mechanism, None if sampled else wanted, place)
    if sampled:
        return _spline(t, np.stack([columns[joint] for joint in joints], axis=1), highest, place)
    rates = tuple(np.stack([columns[f"{joint}.{rate}"] for joint in joints], axis=1) for rate in wanted)
    return Motion(t, rates, "all rates from the table")


def _splits(name: str, joints: Sequence[str]) -> bool:
    joint, _, rate = name.rpartition(".")
    return joint in joints and (rate == "q" or (rate[:1] == "q" and rate[-1:] == "d"))


def _check_columns(given: Sequence[str], mechanism: Mechanism, rates: Sequence[str] | None, place: str) -> None:
    joints = mechanism.coordinates
    expected = list(joints) if rates is None else [f"{joint}.{rate}" for joint in joints for rate in rates]
    for name in given:
        if name.partition(".")[0] in set(mechanism.joints) - set(joints):
            raise JounceError(f"{place}: column {name!r}: this joint follows another (mimic); leave it out")
        if name not in expected and not (rates and _splits(name, joints)):  # rates beyond those needed do no harm
            raise JounceError(f"{place}: {no_such('joint', name, joints)}")
    missing = [name for name in expected if name not in given]
    if missing:
        raise JounceError(f"{place}: missing {', '.join(map(repr, missing))}; expected t and {', '.join(expected)}")


def _spline(t: np.ndarray, q: np.ndarray, highest: int, place: str) -> Motion:
    from scipy.interpolate import make_interp_spline  # a second to import, and only for samples

    if len(t) <= DEGREE:
        raise JounceError(f"{place}: {len(t)} samples; a spline of degree {DEGREE} needs at least {DEGREE + 1}")
    if highest > DEGREE:
        asked = rate_name("q", highest)
        raise JounceError(f"{place}: {asked} asked of samples; a spline of degree {DEGREE} ends at q{DEGREE}d")
    spline = make_interp_spline(t, q, k=DEGREE)
    rates = (q, *(spline(t, nu=k) for k in range(1, highest + 1)))
    return Motion(t, rates, f"samples, rates from a spline of degree {DEGREE} (C^{DEGREE - 1})")
