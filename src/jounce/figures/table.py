"""Panels of a table: the columns ``NAME.Q, NAME.Qd, ...`` and ``NAME.q, NAME.qd, ...``, one panel per quantity."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from jounce.core.errors import JounceError, join_names, quote_value, shorten, unknown_name_error
from jounce.figures.curves import SAMPLE_STYLE
from jounce.figures.panels import EITHER, DrawnRun, Panel
from jounce.model.coordinates import BASE_FORCES, coordinate_limits, coordinate_units, force_names
from jounce.model.limit_kinds import BOUNDED_UNITS, EFFORT_KINDS, LIMIT_KINDS, MOTION_KINDS
from jounce.model.mechanism import Mechanism
from jounce.motion.channel import Channel, divide_by_seconds
from jounce.spatial.series import RATE_SUFFIX

KINDS_BY_SYMBOL = {LIMIT_KINDS[kind].symbol: kind for kind in (*MOTION_KINDS, *EFFORT_KINDS)}  # by the quantity
MAX_DRAWN_VALUE = 1e300  # matplotlib cannot number an axis of larger values: its margins overflow
EXTRAS_BY_SUFFIX = {"_sd": "deviations", "_sample": "points", "_measured": "points"}
# a name may be of any characters, or of none
COLUMN_NAME = re.compile(rf"(.*)\.([qQ])({RATE_SUFFIX})(_sd|_sample|_measured)?", re.DOTALL)


Curves = Mapping[str, np.ndarray]  # by joint


class TableBreak(NamedTuple):
    """A row of a table at which `jounce motion` found a rate of an order to jump."""

    t: float
    order: int


def make_run(
    columns: Curves,
    place: str,
    joints: Sequence[str] = (),
    quantities: Sequence[str] = (),
    mechanism: Mechanism | None = None,
) -> DrawnRun:
    """The panels and breaks of a table, under its name: all that it holds, or some joints and quantities (Q, Qd) only.

    The mechanism gives the order of the joints, their units and limits; without it the table's order holds. Raises
    `JounceError` if columns are missing, numbers are too large, or the mechanism has no such joint.
    """
    found, extra = _collect_curves(columns, place)
    shown = _select_curves(found, place, joints, quantities, mechanism)
    _check_sizes(columns, shown, place)
    t, breaks = columns["t"], _find_breaks(columns)
    joint_units = dict(zip(BASE_FORCES, ["rad"] * 3 + ["m"] * 3, strict=True))
    if mechanism is not None:
        joint_units |= dict(zip(mechanism.coordinates, coordinate_units(mechanism), strict=True))
    limits = {} if mechanism is None else _limits(mechanism)

    def channel(quantity: str, curves: Curves, symbol: str = "") -> Channel:
        units = tuple(_unit(quantity, joint_units.get(name)) for name in curves)
        return Channel(
            symbol or quantity, tuple(curves), units, t, (np.column_stack([*curves.values()]),), breaks=breaks
        )

    drawn = []
    for quantity, curves in shown.items():
        deviations, points = (
            {joint: values for joint, values in extra.get(kind, {}).get(quantity, {}).items() if joint in curves}
            for kind in ("deviations", "points")
        )
        if curves:
            of = channel(quantity, curves)
            bounds = [limits.get(quantity, {}).get(joint, (-np.inf, np.inf)) for joint in curves]
            unknown = np.full(len(t), np.nan)
            spread = np.column_stack([deviations.get(joint, unknown) for joint in curves])
            of = replace(of, bounds=(np.array(bounds).T,), deviations=(spread,) if deviations else None)
            drawn.append(Panel(of, channel(quantity, points) if points else None))
        if quantity == "q" and points:
            residuals = {joint: points[joint] - values for joint, values in curves.items() if joint in points}
            drawn.append(Panel(channel("q", residuals, "residual of q"), style=SAMPLE_STYLE))
    return DrawnRun(drawn, place)


def select_rows(columns: Curves, place: str, between: tuple[float, float] | None) -> Curves:
    """The rows of a table between two times, both included, or all; `JounceError` if no row lies between them."""
    if between is None or "t" not in columns:
        return columns
    t = columns["t"]
    rows = (between[0] <= t) & (t <= between[1])
    if not rows.any():
        came = f"no rows between t = {between[0]:g} and {between[1]:g} s"
        raise JounceError(f"{place}: {came}; the table has t = {t.min():g} .. {t.max():g} s")
    return {name: values[rows] for name, values in columns.items()}


def _find_breaks(columns: Curves) -> tuple[TableBreak, ...]:
    """The rows that `jounce motion` marks as breaks."""
    order = columns.get("break", np.full(len(columns["t"]), -1.0))
    at = np.flatnonzero(order >= 0)
    return tuple(map(TableBreak, columns["t"][at].tolist(), order[at].astype(int).tolist()))


def _collect_curves(
    columns: Curves, place: str
) -> tuple[dict[str, dict[str, np.ndarray]], dict[str, dict[str, dict[str, np.ndarray]]]]:
    """The curves by quantity and joint; and by what else there is to a curve, its points and deviations."""
    found: dict[str, dict[str, np.ndarray]] = {}
    extra: dict[str, dict[str, dict[str, np.ndarray]]] = {}
    for name, values in columns.items():
        if match := COLUMN_NAME.fullmatch(name):
            kind = match[len(match.groups())]
            of = found if kind is None else extra.setdefault(EXTRAS_BY_SUFFIX[kind], {})
            of.setdefault(match[2] + (match[3] or ""), {})[match[1]] = values
    if not found:
        cure = f"of samples `jounce motion ROBOT {place} -o OUT` makes a table to be drawn"
        raise JounceError(
            f"{place}: no columns NAME.Q, NAME.Qd, ... or NAME.q, NAME.qd, ...; available:"
            f" {join_names(columns)}; {cure}"
        )
    if "t" not in columns:
        raise JounceError(f"{place}: no column 't'; available: {join_names(columns)}")
    return found, extra


def _select_curves(
    found: Mapping[str, Mapping[str, np.ndarray]],
    place: str,
    joints: Sequence[str],
    quantities: Sequence[str],
    mechanism: Mechanism | None,
) -> dict[str, dict[str, np.ndarray]]:
    """The curves that are drawn by quantity and joint: q before Q, low rates before high ones, joints in order."""
    known = list(dict.fromkeys(joint for curves in found.values() for joint in curves))
    if mechanism is not None:
        names = force_names(mechanism)
        for joint in known:
            if joint not in names:
                missing = unknown_name_error(f"joint of {shorten(mechanism.name)}", joint, names)
                raise JounceError(f"{place}: {missing}; expected a table of this robot")
        known = [joint for joint in names if joint in known]
    for kind, asked, existing in (("joint", joints, known), ("quantity", quantities, list(found))):
        for name in asked:
            if name not in existing:
                raise JounceError(f"{place}: {unknown_name_error(kind, name, existing)}")
    chosen = [joint for joint in known if joint in (joints or known)]
    shown = {
        quantity: {joint: found[quantity][joint] for joint in chosen if joint in found[quantity]}
        for quantity in sorted(quantities or found, key=lambda name: (name[0] == "Q", _order(name)))
    }
    if not any(shown.values()):
        raise JounceError(f"{place}: none of {join_names(joints)} has a column of {join_names(quantities)}")
    return shown


def _check_sizes(columns: Curves, shown: Mapping[str, Mapping[str, np.ndarray]], place: str) -> None:
    for name in ["t", *(f"{joint}.{quantity}" for quantity, curves in shown.items() for joint in curves)]:
        peak = np.abs(columns[name]).max()
        if peak > MAX_DRAWN_VALUE:
            came = f"column {quote_value(name)} holds {peak:g}"
            raise JounceError(f"{place}: {came}; expected no more than {MAX_DRAWN_VALUE:g} to draw it")


def _limits(mechanism: Mechanism) -> dict[str, dict[str, tuple[float, float]]]:
    """The limits of a robot by quantity and joint."""
    limits = coordinate_limits(mechanism)
    return {
        quantity: dict(zip(mechanism.coordinates, zip(*limits.bounds(kind).tolist(), strict=True), strict=True))
        for quantity, kind in KINDS_BY_SYMBOL.items()
        if kind not in limits.without_gravity  # of another force than the table holds
    }


def _order(quantity: str) -> int:
    return 1 if quantity[1:] == "d" else int(quantity[1:-1] or 0)


def _unit(quantity: str, joint_unit: str | None) -> str:
    """N m/s^2 of Q2d of a joint in rad; ``N m/s^2 or N/s^2`` of one that is not known."""
    of_either = dict(zip(("rad", "m"), BOUNDED_UNITS[quantity[0]], strict=True))
    unit = EITHER.join(of_either.values()) if joint_unit is None else of_either[joint_unit]
    return divide_by_seconds(unit, _order(quantity))
