"""Wrench columns of a motion table: ``BODY.mx .. BODY.fz``, what each body exerts, as samples or with all rates."""

import re
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from jounce.core.errors import JounceError, at, listed, quoted
from jounce.model.mechanism import Mechanism
from jounce.motion.curves import COMPONENTS, Arranged, Curve
from jounce.motion.hermite import Hermite
from jounce.motion.smoothed import found_from
from jounce.motion.spline import Sampled, Smoothing, Spline
from jounce.spatial.series import SUFFIX, rate_name

WRENCH_COLUMN = re.compile(r"(.*)\.([mf][xyz])" + SUFFIX, re.DOTALL)


def named(names: Sequence[str], mechanism: Mechanism) -> list[str]:
    """Those column names that are of wrenches; a body may be called as a joint is, and a joint ``arm.fx``."""
    joints = set(mechanism.coordinates)
    others = joints - {*mechanism.frame_names}
    return [
        name for name in names if name not in joints and (m := WRENCH_COLUMN.fullmatch(name)) and m[1] not in others
    ]


def are_sampled(columns: Iterable[str]) -> bool:
    """Whether wrench columns are samples, without rates of their own."""
    rates = [match[3] for name in columns if (match := WRENCH_COLUMN.fullmatch(name))]
    return bool(rates) and not any(rates)


def wrenches(
    t: np.ndarray,
    columns: Mapping[str, np.ndarray],
    mechanism: Mechanism,
    order: int,
    way: Smoothing | Spline,
    place: str,
) -> tuple[dict[str, Curve], tuple[str, ...]]:
    """W over time by body, with rates up to `order` at least, and notes; components left out are zero."""
    parts = [match.groups() for name in columns if (match := WRENCH_COLUMN.fullmatch(name))]
    given = list(dict.fromkeys((body, component) for body, component, _ in parts))
    with at(place):
        for body, _ in given:
            mechanism.frame(body)
    sampled, notes = are_sampled(columns), []
    found: dict[str, Curve] = {}
    for body in dict.fromkeys(body for body, _ in given):
        components = [component for name, component in given if name == body]
        names = tuple(f"{body}.{component}" for component in components)
        rows = [_stacked(columns, body, components, k, place) for k in range(1 if sampled else order + 1)]
        curve: Curve
        if sampled:
            samples = found_from(Sampled(t, rows[0], order, f"{place}: wrench of {quoted(body)}", names, "W"), way)
            curve = samples.curve
            if samples.notes:
                notes += [f"wrench of {quoted(body)}: {text}" for text in (samples.source, *samples.notes)]
        else:
            curve = Hermite(t, tuple(rows), table=place, names=names)
        places = [components.index(component) if component in components else -1 for component in COMPONENTS]
        found[body] = Arranged(curve, np.array(places))
    return found, tuple(notes)


def _stacked(columns: Mapping[str, np.ndarray], body: str, components: Sequence[str], k: int, place: str) -> np.ndarray:
    names = [f"{body}.{rate_name(component, k)}" for component in components]
    missing = [quoted(name) for name in names if name not in columns]
    if missing:
        raise JounceError(f"{place}: missing {listed(missing)}; expected every wrench column with all its rates")
    return np.stack([columns[name] for name in names], axis=1)
