"""Wrench columns of a motion table: ``BODY.mx .. BODY.fz``, what each body exerts, as samples or with all rates."""

import re
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from jounce.core.errors import JounceError, join_names, locate_errors, quote_value
from jounce.model.mechanism import Mechanism
from jounce.motion.curves import COMPONENTS, ArrangedCurve, Curve
from jounce.motion.hermite import HermiteCurve
from jounce.motion.sample_curves import fit_curve
from jounce.motion.spline import SampledColumns, Smoothing, Spline
from jounce.spatial.series import RATE_SUFFIX, rate_name

WRENCH_COLUMN = re.compile(r"(.*)\.([mf][xyz])" + RATE_SUFFIX, re.DOTALL)


def select_wrench_columns(names: Sequence[str], mechanism: Mechanism) -> list[str]:
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


def build_wrenches(
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
    with locate_errors(place):
        for body, _ in given:
            mechanism.frame(body)
    sampled, notes = are_sampled(columns), []
    found: dict[str, Curve] = {}
    for body in dict.fromkeys(body for body, _ in given):
        components = [component for name, component in given if name == body]
        names = tuple(f"{body}.{component}" for component in components)
        rows = [_stack_rates(columns, body, components, k, place) for k in range(1 if sampled else order + 1)]
        curve: Curve
        if sampled:
            samples = fit_curve(
                SampledColumns(t, rows[0], order, f"{place}: wrench of {quote_value(body)}", names, "W"), way
            )
            curve = samples.curve
            if samples.notes:
                notes += [f"wrench of {quote_value(body)}: {text}" for text in (samples.source, *samples.notes)]
        else:
            curve = HermiteCurve(t, tuple(rows), table=place, names=names)
        places = [components.index(component) if component in components else -1 for component in COMPONENTS]
        found[body] = ArrangedCurve(curve, np.array(places))
    return found, tuple(notes)


def _stack_rates(
    columns: Mapping[str, np.ndarray], body: str, components: Sequence[str], k: int, place: str
) -> np.ndarray:
    names = [f"{body}.{rate_name(component, k)}" for component in components]
    missing = [quote_value(name) for name in names if name not in columns]
    if missing:
        raise JounceError(f"{place}: missing {join_names(missing)}; expected every wrench column with all its rates")
    return np.stack([columns[name] for name in names], axis=1)
