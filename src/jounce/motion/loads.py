"""Wrench columns of a motion table: ``BODY.mx .. BODY.fz``, what each body exerts, as samples or with all rates."""

import re
from collections.abc import Mapping, Sequence

import numpy as np

from jounce.errors import JounceError, at, listed, quoted
from jounce.model.mechanism import Mechanism
from jounce.motion.spline import Spline, rates_of
from jounce.motion.states import COMPONENTS
from jounce.spatial.series import SUFFIX, rate_name

COLUMN = re.compile(r"(.*)\.([mf][xyz])" + SUFFIX, re.DOTALL)


def named(names: Sequence[str], mechanism: Mechanism) -> list[str]:
    """Those column names that are of wrenches; a body may be called as a joint is, and a joint ``arm.fx``."""
    joints = set(mechanism.coordinates)
    others = joints - {*mechanism.bodies, *(frame.name for frame in mechanism.frames)}
    return [name for name in names if name not in joints and (m := COLUMN.fullmatch(name)) and m[1] not in others]


def wrenches(
    columns: Mapping[str, np.ndarray], mechanism: Mechanism, order: int, spline: Spline, place: str
) -> tuple[dict[str, np.ndarray], ...] | None:
    """W by body and its rates up to `order`, as `inverse_dynamics` takes them; components left out are zero."""
    parts = [match.groups() for name in columns if (match := COLUMN.fullmatch(name))]
    given = list(dict.fromkeys((body, component) for body, component, _ in parts))
    with at(place):
        for body, _ in given:
            mechanism.frame(body)
    if not given:
        return None
    if any(rate for _, _, rate in parts):
        rates = [_as_given(columns, given, k, place) for k in range(order + 1)]
    else:
        t, samples = columns["t"], np.stack([columns[".".join(key)] for key in given], axis=1)
        rates = list(rates_of(t, samples, order, spline, place, "W"))
    return tuple(_by_body(rate, given) for rate in rates)


def _as_given(columns: Mapping[str, np.ndarray], given: Sequence[tuple[str, str]], k: int, place: str) -> np.ndarray:
    names = [f"{body}.{rate_name(component, k)}" for body, component in given]
    missing = [quoted(name) for name in names if name not in columns]
    if missing:
        raise JounceError(f"{place}: missing {listed(missing)}; expected every wrench column with all its rates")
    return np.stack([columns[name] for name in names], axis=1)


def _by_body(rate: np.ndarray, given: Sequence[tuple[str, str]]) -> dict[str, np.ndarray]:
    found: dict[str, np.ndarray] = {}
    for (body, component), column in zip(given, rate.T, strict=True):
        found.setdefault(body, np.zeros((len(rate), 6)))[:, COMPONENTS.index(component)] = column
    return found
