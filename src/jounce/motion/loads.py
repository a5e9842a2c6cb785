"""Wrench columns of a motion table: ``BODY.mx .. BODY.fz``, what each body exerts, as samples or with all rates."""

import re
from collections.abc import Mapping, Sequence

import numpy as np

from jounce.errors import JounceError, at, listed, quoted
from jounce.model.mechanism import Mechanism
from jounce.motion.curves import Curve
from jounce.motion.hermite import Hermite
from jounce.motion.spline import Spline, curve_of
from jounce.spatial.series import SUFFIX, rate_name

COMPONENTS = ("mx", "my", "mz", "fx", "fy", "fz")  # of a wrench, (moment; force), in files
COLUMN = re.compile(r"(.*)\.([mf][xyz])" + SUFFIX, re.DOTALL)


def named(names: Sequence[str], mechanism: Mechanism) -> list[str]:
    """Those column names that are of wrenches; a body may be called as a joint is, and a joint ``arm.fx``."""
    joints = set(mechanism.coordinates)
    others = joints - {*mechanism.bodies, *(frame.name for frame in mechanism.frames)}
    return [name for name in names if name not in joints and (m := COLUMN.fullmatch(name)) and m[1] not in others]


def wrenches(
    t: np.ndarray, columns: Mapping[str, np.ndarray], mechanism: Mechanism, order: int, spline: Spline, place: str
) -> dict[str, Curve]:
    """W over time by body, with rates up to `order` at least; components left out are zero."""
    parts = [match.groups() for name in columns if (match := COLUMN.fullmatch(name))]
    given = list(dict.fromkeys((body, component) for body, component, _ in parts))
    with at(place):
        for body, _ in given:
            mechanism.frame(body)
    whole = any(rate for _, _, rate in parts)
    found: dict[str, Curve] = {}
    for body in dict.fromkeys(body for body, _ in given):
        components = [component for name, component in given if name == body]
        rows = [_filled(columns, body, components, k, len(t), place) for k in range(order + 1 if whole else 1)]
        found[body] = Hermite(t, tuple(rows)) if whole else curve_of(t, rows[0], spline, place, order, "W")
    return found


def _filled(
    columns: Mapping[str, np.ndarray], body: str, components: Sequence[str], k: int, rows: int, place: str
) -> np.ndarray:
    names = {component: f"{body}.{rate_name(component, k)}" for component in components}
    missing = [quoted(name) for name in names.values() if name not in columns]
    if missing:
        raise JounceError(f"{place}: missing {listed(missing)}; expected every wrench column with all its rates")
    found = np.zeros((rows, 6))
    for component, name in names.items():
        found[:, COMPONENTS.index(component)] = columns[name]
    return found
