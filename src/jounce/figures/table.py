"""Panels of a table: the columns ``NAME.Q, NAME.Qd, ...`` and ``NAME.q, NAME.qd, ...``, one panel per quantity."""

import re
from collections.abc import Mapping, Sequence

import numpy as np

from jounce.core.errors import JounceError, join_names, quote_value, shorten, unknown_name_error
from jounce.figures.curves import SAMPLE_STYLE
from jounce.figures.panels import CurvePanel, TableRun
from jounce.model.coordinates import BASE_FORCES, coordinate_limits, coordinate_units, force_names
from jounce.model.limit_kinds import BOUNDED_UNITS, EFFORT_KINDS, LIMIT_KINDS, MOTION_KINDS
from jounce.model.mechanism import Mechanism
from jounce.spatial.series import RATE_SUFFIX

KINDS_BY_SYMBOL = {LIMIT_KINDS[kind].symbol: kind for kind in (*MOTION_KINDS, *EFFORT_KINDS)}  # by the quantity
MAX_DRAWN_VALUE = 1e300  # matplotlib cannot number an axis of larger values: its margins overflow
FIELDS_BY_SUFFIX = {"_sd": "deviations", "_sample": "points", "_measured": "points"}
# a name may be of any characters, or of none
COLUMN_NAME = re.compile(rf"(.*)\.([qQ])({RATE_SUFFIX})(_sd|_sample|_measured)?", re.DOTALL)


def make_run(
    columns: Mapping[str, np.ndarray],
    place: str,
    joints: Sequence[str] = (),
    quantities: Sequence[str] = (),
    mechanism: Mechanism | None = None,
) -> TableRun:
    """The panels and breaks of a table, under its name: all that it holds, or some joints and quantities (Q, Qd) only.

    The mechanism gives the order of the joints, their units and limits; without it the table's order holds. Raises
    `JounceError` if columns are missing, numbers are too large, or the mechanism has no such joint.
    """
    found, extra = _collect_curves(columns, place)
    shown = _select_curves(found, place, joints, quantities, mechanism)
    _check_sizes(columns, shown, place)
    units = dict(zip(BASE_FORCES, ["rad"] * 3 + ["m"] * 3, strict=True))
    if mechanism is not None:
        units |= dict(zip(mechanism.coordinates, coordinate_units(mechanism), strict=True))
    limits = {} if mechanism is None else _limits(mechanism)
    drawn = []
    for quantity, curves in shown.items():
        given = {kind: of.get(quantity, {}) for kind, of in extra.items()}
        unit, of_joints = _units(quantity), limits.get(quantity, {})
        if curves:
            drawn.append(CurvePanel(quantity, curves, None, **given, units=unit, joint_units=units, limits=of_joints))
        points = given.get("points", {}) if quantity == "q" else {}
        if residuals := {joint: points[joint] - values for joint, values in curves.items() if joint in points}:
            drawn.append(CurvePanel("residual of q", residuals, units=unit, joint_units=units, style=SAMPLE_STYLE))
    breaks = columns["t"][columns["break"] >= 0].tolist() if "break" in columns else []  # as `jounce motion` marks them
    return TableRun(columns["t"], drawn, breaks, place)


def select_rows(
    columns: Mapping[str, np.ndarray], place: str, between: tuple[float, float] | None
) -> Mapping[str, np.ndarray]:
    """The rows of a table between two times, both included, or all; `JounceError` if no row lies between them."""
    if between is None or "t" not in columns:
        return columns
    t = columns["t"]
    rows = (between[0] <= t) & (t <= between[1])
    if not rows.any():
        came = f"no rows between t = {between[0]:g} and {between[1]:g} s"
        raise JounceError(f"{place}: {came}; the table has t = {t.min():g} .. {t.max():g} s")
    return {name: values[rows] for name, values in columns.items()}


def _collect_curves(
    columns: Mapping[str, np.ndarray], place: str
) -> tuple[dict[str, dict[str, np.ndarray]], dict[str, dict[str, dict[str, np.ndarray]]]]:
    """The curves by quantity and joint; and by what else there is to a curve, its points and deviations."""
    found: dict[str, dict[str, np.ndarray]] = {}
    extra: dict[str, dict[str, dict[str, np.ndarray]]] = {}
    for name, values in columns.items():
        if match := COLUMN_NAME.fullmatch(name):
            kind = match[len(match.groups())]
            of = found if kind is None else extra.setdefault(FIELDS_BY_SUFFIX[kind], {})
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


def _check_sizes(columns: Mapping[str, np.ndarray], shown: Mapping[str, Mapping[str, np.ndarray]], place: str) -> None:
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


def _units(quantity: str) -> dict[str, str]:
    """``N m/s², N/s²`` of Q2d, by the unit of the joint."""
    k = _order(quantity)
    per = "" if not k else "/s" if k == 1 else f"/s$^{{{k}}}$"
    return {joint_unit: unit + per for joint_unit, unit in zip(("rad", "m"), BOUNDED_UNITS[quantity[0]], strict=True)}
