"""Motions from tables: samples, or all rates, matched by joint name in any column order."""

import re
import warnings
from collections.abc import Mapping, Sequence
from itertools import count, takewhile

import numpy as np

from jounce.arguments import names
from jounce.errors import JounceError, JounceWarning, at, listed
from jounce.model.mechanism import Mechanism
from jounce.motion import loads, smoothness
from jounce.motion.hermite import Hermite
from jounce.motion.motion import Motion
from jounce.motion.spline import Spline, curve_of, residual_of
from jounce.spatial.series import SUFFIX, rate_name

THROUGH = Spline()
RATE = re.compile("q" + SUFFIX)


def from_table(
    columns: Mapping[str, np.ndarray], mechanism: Mechanism, highest: int, place: str, spline: Spline = THROUGH
) -> Motion:
    """The motion in a table, matched by joint name in any column order, with rates up to the one of order `highest`.

    Either `t` and one column per joint (samples: the rates are those of a spline through them, or fitted to them), or
    `t` and ``NAME.q, NAME.qd, NAME.q2d, ...`` for every joint (used as they are). Wrenches that bodies or merged links
    exert come in columns ``BODY.mx .. BODY.fz``, again as samples or with all rates, ``BODY.fxd, BODY.fx2d, ...``.

    Raises
    ------
    JounceError : where a joint or rate is missing, a column unknown, t does not increase, or there are too few samples.
    """
    joints = mechanism.coordinates
    if "t" in joints:
        raise JounceError(f"{place}: a joint is named 't', as the column of times is; give it another name")
    of_wrenches = loads.named(list(columns), mechanism)
    given = [name for name in columns if name not in of_wrenches]
    wanted = [rate_name("q", k) for k in range(highest + 1)]
    sampled = not any(_is_rate(name, joints) for name in given)
    with at(place):
        _check_columns(given, mechanism, [] if sampled else wanted)
    t = columns["t"]
    steps = np.flatnonzero(np.diff(t) <= 0)
    if steps.size:
        i = int(steps[0])
        follows = f"{t[i]:.17g} is followed by {t[i + 1]:.17g}, rows {i} and {i + 1} counted from 0"
        raise JounceError(f"{place}: t does not increase: {follows}")
    W = loads.wrenches(t, {name: columns[name] for name in of_wrenches}, mechanism, max(highest - 2, 0), spline, place)
    if not sampled:
        rows = tuple(_stacked(columns, [f"{joint}.{rate}" for joint in joints]) for rate in _rates_in(columns, joints))
        _warn_of(smoothness.of_rates(rows), place)
        return Motion(Hermite(t, rows), joints, "all rates from the table", W, grid=t)
    samples = _stacked(columns, joints)
    if spline.intervals is None:  # what a fit does not follow, its residual tells
        _warn_of(smoothness.of_samples(t, samples), place)
    curve = curve_of(t, samples, spline, place, highest)
    return Motion(
        curve, joints, f"samples, rates from a {spline}", W, (t, samples), residual_of(curve, spline, t, samples), t
    )


def _stacked(columns: Mapping[str, np.ndarray], names: Sequence[str]) -> np.ndarray:
    return np.stack([columns[name] for name in names], axis=1)


def _rates_in(columns: Mapping[str, np.ndarray], joints: Sequence[str]) -> list[str]:
    """q, qd, ...: the rates that a table states of every joint, none skipped."""
    names = (rate_name("q", k) for k in count())
    return list(takewhile(lambda rate: all(f"{joint}.{rate}" in columns for joint in joints), names))


def _warn_of(jumps: str | None, place: str) -> None:
    if jumps:
        warnings.warn(f"{place}: {jumps}", JounceWarning, stacklevel=3)


def _is_rate(name: str, joints: Sequence[str]) -> bool:
    joint, _, rate = name.rpartition(".")
    return name not in joints and joint in joints and RATE.fullmatch(rate) is not None


def _check_columns(given: Sequence[str], mechanism: Mechanism, rates: Sequence[str]) -> None:
    joints, follows = mechanism.coordinates, names.followers(mechanism)
    expected = ["t", *([f"{joint}.{rate}" for joint in joints for rate in rates] or joints)]
    others = set(given) - set(expected)
    higher = {name for name in others if rates and _is_rate(name, joints)}  # than those needed: they do no harm
    unfit = {name: "samples beside columns of rates" for name in others if name in joints}
    unfit |= {name: follows[joint] for name in others for joint in (name, name.rpartition(".")[0]) if joint in follows}
    asked = f"for each joint {', '.join(rates)}" if rates else listed(joints)
    names.check([name for name in given if name not in higher], expected, unfit, f"t and {asked}")
