"""Makes panels: the curves of a quantity over time, by joint.

A `Panel` is a quantity in a row of axes; a `DrawnRun` is the panels of a table or a motion. `columns_of` says which
joints stand in the same axes, and `thin_points` which samples of many a page shows.

`make_run` is the door for tables: it makes panels of the columns ``NAME.Q, NAME.Qd, ...`` and ``NAME.q, NAME.qd, ...``,
one per quantity, with the deviations, samples and measured values that stand next to them.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from jounce.core import errors
from jounce.core.errors import JounceError, join_names, quote_value
from jounce.figures.canvas import Style
from jounce.model import coordinates
from jounce.model.limits import BOUNDED_UNITS, LIMIT_KINDS
from jounce.model.mechanism import Mechanism
from jounce.motion import channel, reliability
from jounce.motion.channel import Channel, Discontinuity
from jounce.spatial.series import RATE_SUFFIX

MAX_POINTS_DRAWN = 2000  # of a curve, about: a page has no more pixels across
MIN_VISIBLE_SHARE = 0.1  # of the largest value: a smaller curve looks flat in the same axes
MAX_CURVES_PER_AXES = 10  # a reader can follow no more in the same axes
MAX_CROWD_COLUMNS = 6  # of axes over which many curves are spread: a page has room for no more
EITHER = " or "  # between the units that a quantity may have, of a joint that is not known
JOINT_UNITS = dict(zip(BOUNDED_UNITS["Q"], BOUNDED_UNITS["q"], strict=True))  # by the unit of the force


@dataclass(frozen=True, eq=False)
class Panel:
    """A quantity in a row of axes: its curves with bands and limits, and what is drawn on them."""

    channel: Channel
    points: Channel | None = None  # measured ones, which the curves should follow
    differentiated: Channel | None = None  # what differentiation makes of the values
    style: Style = field(default_factory=dict)  # of values that are no curves

    def curve(self, name: str) -> np.ndarray:
        """The values of a joint."""
        return find_column(self.channel, name)

    def limits(self, name: str) -> tuple[float, float]:
        """The lower and the upper limit of a joint, infinite where none is stated."""
        if not self.channel.bounds:
            return -np.inf, np.inf
        lower, upper = self.channel.bounds[0][:, self.channel.names.index(name)].tolist()
        return lower, upper

    def has_band(self, name: str) -> bool:
        """Whether any deviation of a curve is known."""
        off = self.channel.deviations
        return off is not None and not np.isnan(off[0][:, self.channel.names.index(name)]).all()

    def reach(self, name: str) -> np.ndarray:
        """How far the band of a curve reaches on either side of it."""
        if not self.has_band(name) or self.channel.deviations is None:
            return np.zeros(len(self.channel.times))
        return reliability.BAND_DEVIATIONS * self.channel.deviations[0][:, self.channel.names.index(name)]

    def band(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """The lower and the upper edge of the band of a curve."""
        return self.curve(name) - self.reach(name), self.curve(name) + self.reach(name)

    @property
    def peaks(self) -> dict[str, float]:
        """The largest absolute value of each curve, that of its wild ends left out."""
        return dict(zip(self.channel.names, self.channel.surest_peaks()[1].tolist(), strict=True))


@dataclass(frozen=True, eq=False)
class DrawnRun:
    """The panels of a table or a motion under its title; breaks of any of them are upright lines in all."""

    panels: Sequence[Panel]
    title: str = ""

    @property
    def breaks(self) -> list[Discontinuity]:
        """The breaks of the panels, one that several share once."""
        return list({id(found): found for panel in self.panels for found in panel.channel.breaks}.values())


def find_column(channel: Channel, name: str) -> np.ndarray:
    """The values of one of the names of a channel."""
    return channel.values[:, channel.names.index(name)]


def drawn_names(panels: Sequence[Panel]) -> list[str]:
    """The joints of all panels: a table need not hold every quantity of every joint."""
    return list(dict.fromkeys(name for panel in panels for name in panel.channel.names))


def find_joint_unit(unit: str) -> str | None:
    """rad of N m/s^2, m of N: the unit of the joint that has a quantity of a unit; None where it may be either."""
    stem = unit.partition("/s")[0]
    return None if EITHER in unit else JOINT_UNITS.get(stem, stem)


def columns_of(panels: Sequence[Panel]) -> list[list[str]]:
    """The joints of each column of axes: of one unit, of sizes that can be seen together, and not too many."""
    names = drawn_names(panels)
    units = {
        name: find_joint_unit(unit)
        for panel in panels
        for name, unit in zip(panel.channel.names, panel.channel.units, strict=True)
    }
    alike = [[name for name in names if units.get(name) == unit] for unit in dict.fromkeys(map(units.get, names))]
    most = max(MAX_CURVES_PER_AXES, -(-len(names) // MAX_CROWD_COLUMNS))
    return [
        [str(name) for name in column]
        for group in alike for sized in split_by_size(panels, group)
        for column in np.array_split(sized, -(-len(sized) // most))
    ]  # fmt: skip


def split_by_size(panels: Sequence[Panel], names: Sequence[str]) -> list[list[str]]:
    """Curves in one column, or in two, large and small, if one is hidden by the largest of its panel."""
    small = set()
    for panel in panels:
        peaks = {name: peak for name, peak in panel.peaks.items() if name in names}
        small |= {name for name, peak in peaks.items() if peak < MIN_VISIBLE_SHARE * max(peaks.values())}
    columns = [[name for name in names if (name in small) == side] for side in (False, True)]
    return [column for column in columns if column]


def thin_points(values: np.ndarray, most: int = MAX_POINTS_DRAWN) -> np.ndarray:
    """The indices of the samples that a page shows: of many the ends, in each short piece the first and the extremes.

    Extremes alone would make a ring of a cloud of dots.
    """
    if len(values) <= most:
        return np.arange(len(values))
    starts = np.linspace(0, len(values), most // 3, endpoint=False).astype(int)
    extremes = [
        start + at for start, piece in zip(starts, np.split(values, starts[1:]), strict=True)
        for at in (0, piece.argmin(), piece.argmax())
    ]  # fmt: skip
    return np.unique([*extremes, len(values) - 1])


SAMPLE_STYLE: Any = {"marker": ".", "linestyle": "none", "ms": 2.5, "alpha": 0.25, "zorder": 1.5}
# Panels of a table.
KINDS_BY_SYMBOL = {
    LIMIT_KINDS[kind].symbol: kind for kind in (*LIMIT_KINDS.motion, *LIMIT_KINDS.effort)
}  # by the quantity
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
    joint_units = dict(zip(coordinates.BASE_FORCES, ["rad"] * 3 + ["m"] * 3, strict=True))
    if mechanism is not None:
        joint_units |= dict(zip(mechanism.coordinates, coordinates.units(mechanism), strict=True))
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
        names = coordinates.force_names(mechanism)
        for joint in known:
            if joint not in names:
                missing = errors.unknown_name_error(f"joint of {errors.shorten(mechanism.name)}", joint, names)
                raise JounceError(f"{place}: {missing}; expected a table of this robot")
        known = [joint for joint in names if joint in known]
    for kind, asked, existing in (("joint", joints, known), ("quantity", quantities, list(found))):
        for name in asked:
            if name not in existing:
                raise JounceError(f"{place}: {errors.unknown_name_error(kind, name, existing)}")
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
    limits = coordinates.limits(mechanism)
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
    return channel.divide_by_seconds(unit, _order(quantity))
