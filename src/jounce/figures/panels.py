"""Makes panels: the curves of a quantity over time, by joint.

A `Panel` is a quantity in a row of axes; a `DrawnRun` is the panels of a table or a motion. `columns_of` selects the
joints that share axes, and `thin_points` the samples that a page shows.

`make_run` makes the panels of a table from the columns ``NAME.Q, NAME.Qd, ...`` and ``NAME.q, NAME.qd, ...``, one per
quantity, with the deviations, samples and measured values that stand next to them.
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

MAX_POINTS_DRAWN = 2000  # of a curve, roughly: a page has no more pixels across
MIN_VISIBLE_SHARE = 0.1  # of the largest value: a smaller curve looks flat in the same axes
MAX_CURVES_PER_AXES = 10  # a reader can follow no more in the same axes
MAX_CROWD_COLUMNS = 6  # of axes over which many curves are spread: a page has no space for more
EITHER = " or "  # between the two possible units of a quantity of an unknown joint
JOINT_UNITS = dict(zip(BOUNDED_UNITS["Q"], BOUNDED_UNITS["q"], strict=True))  # by the unit of the force


@dataclass(frozen=True, eq=False)
class Panel:
    """A quantity in a row of axes, with its bands and points."""

    channel: Channel
    points: Channel | None = None  # measured values, which the curves should follow
    differentiated: Channel | None = None  # values by numerical differentiation
    style: Style = field(default_factory=dict)  # of values that are points, not curves

    def curve(self, name: str) -> np.ndarray:
        """Return the values of a joint."""
        return find_column(self.channel, name)

    def limits(self, name: str) -> tuple[float, float]:
        """Return the lower and upper limit of a joint, infinite if unlimited."""
        if not self.channel.bounds:
            return -np.inf, np.inf
        lower, upper = self.channel.bounds[0][:, self.channel.names.index(name)].tolist()
        return lower, upper

    def has_band(self, name: str) -> bool:
        """Whether any deviation of a curve is known."""
        deviations = self.channel.deviations
        return deviations is not None and not np.isnan(deviations[0][:, self.channel.names.index(name)]).all()

    def reach(self, name: str) -> np.ndarray:
        """Return the half-width of the band of a curve."""
        if not self.has_band(name) or self.channel.deviations is None:
            return np.zeros(len(self.channel.times))
        return reliability.BAND_DEVIATIONS * self.channel.deviations[0][:, self.channel.names.index(name)]

    def band(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Return the lower and upper edge of the band of a curve."""
        return self.curve(name) - self.reach(name), self.curve(name) + self.reach(name)

    @property
    def peaks(self) -> dict[str, float]:
        """The largest absolute value of each curve, without uncertain ends."""
        return dict(zip(self.channel.names, self.channel.surest_peaks()[1].tolist(), strict=True))


@dataclass(frozen=True, eq=False)
class DrawnRun:
    """The panels of a table or a motion under its title.

    A break of any panel is an upright line in all of them.
    """

    panels: Sequence[Panel]
    title: str = ""

    @property
    def breaks(self) -> list[Discontinuity]:
        """The breaks of the panels, each once."""
        return list({id(jump): jump for panel in self.panels for jump in panel.channel.breaks}.values())


def find_column(channel: Channel, name: str) -> np.ndarray:
    """Return the values of one of the names of a channel."""
    return channel.values[:, channel.names.index(name)]


def drawn_names(panels: Sequence[Panel]) -> list[str]:
    """Return the joints of all panels.

    A table need not hold every quantity of every joint.
    """
    return list(dict.fromkeys(name for panel in panels for name in panel.channel.names))


def find_joint_unit(unit: str) -> str | None:
    """Return the unit of the joint of a quantity: rad of N m/s^2.

    It is None where the joint may have either unit.
    """
    stem = unit.partition("/s")[0]
    return None if EITHER in unit else JOINT_UNITS.get(stem, stem)


def columns_of(panels: Sequence[Panel]) -> list[list[str]]:
    """Return the joints of each column of axes.

    They have one unit and similar sizes, and are not too many.
    """
    # Joints are grouped by unit, then by size, then into columns of at most `max_curves`.
    names = drawn_names(panels)
    units = {
        name: find_joint_unit(unit)
        for panel in panels
        for name, unit in zip(panel.channel.names, panel.channel.units, strict=True)
    }
    joints_by_unit = [
        [name for name in names if units.get(name) == unit] for unit in dict.fromkeys(map(units.get, names))
    ]
    max_curves = max(MAX_CURVES_PER_AXES, -(-len(names) // MAX_CROWD_COLUMNS))
    return [
        [str(name) for name in column]
        for group in joints_by_unit for visible_joints in split_by_size(panels, group)
        for column in np.array_split(visible_joints, -(-len(visible_joints) // max_curves))
    ]  # fmt: skip


def split_by_size(panels: Sequence[Panel], names: Sequence[str]) -> list[list[str]]:
    """Split curves into large and small ones.

    Small ones are hidden by the largest curve of their panel.
    """
    small = set()
    for panel in panels:
        peaks = {name: peak for name, peak in panel.peaks.items() if name in names}
        small |= {name for name, peak in peaks.items() if peak < MIN_VISIBLE_SHARE * max(peaks.values())}
    columns = [[name for name in names if (name in small) == is_small] for is_small in (False, True)]
    return [column for column in columns if column]


def thin_points(values: np.ndarray, max_points: int = MAX_POINTS_DRAWN) -> np.ndarray:
    """Return the indices of the samples that a page shows.

    Of many samples they are the ends and, in each short piece, the first one and the extremes. Extremes alone would
    make a ring of a cloud of dots.
    """
    if len(values) <= max_points:
        return np.arange(len(values))
    starts = np.linspace(0, len(values), max_points // 3, endpoint=False).astype(int)
    extremes = [
        start + offset for start, piece in zip(starts, np.split(values, starts[1:]), strict=True)
        for offset in (0, piece.argmin(), piece.argmax())
    ]  # fmt: skip
    return np.unique([*extremes, len(values) - 1])


SAMPLE_STYLE: Any = {"marker": ".", "linestyle": "none", "ms": 2.5, "alpha": 0.25, "zorder": 1.5}
# Panels of a table.
KINDS_BY_SYMBOL = {
    LIMIT_KINDS[kind].symbol: kind for kind in (*LIMIT_KINDS.motion, *LIMIT_KINDS.effort)
}  # by the quantity
MAX_DRAWN_VALUE = 1e300  # matplotlib cannot number an axis of larger values: its margins overflow
EXTRAS_BY_SUFFIX = {"_sd": "deviations", "_sample": "points", "_measured": "points"}
# A name may consist of any characters, or of none.
COLUMN_NAME = re.compile(rf"(.*)\.([qQ])({RATE_SUFFIX})(_sd|_sample|_measured)?", re.DOTALL)
Curves = Mapping[str, np.ndarray]  # by joint


class TableBreak(NamedTuple):
    """A row of a table at which a rate of q jumps.

    `jounce motion` writes such rows.
    """

    t: float
    order: int


def make_run(
    columns: Curves,
    place: str,
    joints: Sequence[str] = (),
    quantities: Sequence[str] = (),
    mechanism: Mechanism | None = None,
) -> DrawnRun:
    """Make the panels and breaks of a table.

    They are all of the table, or some joints and quantities (Q, Qd) only. The place is the title.

    The mechanism gives the order of the joints, their units and limits; without it the table's order holds. Raises
    `JounceError` if columns are missing, numbers are too large, or the mechanism has no such joint.
    """
    curves_by_quantity, extras_by_kind = _collect_curves(columns, place)
    shown = _select_curves(curves_by_quantity, place, joints, quantities, mechanism)
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

    # One panel per quantity; samples of q also have one of residuals.
    panels = []
    for quantity, curves in shown.items():
        deviations, points = (
            {
                joint: values
                for joint, values in extras_by_kind.get(kind, {}).get(quantity, {}).items()
                if joint in curves
            }
            for kind in ("deviations", "points")
        )
        if len(curves) > 0:
            drawn_channel = channel(quantity, curves)
            bounds = [limits.get(quantity, {}).get(joint, (-np.inf, np.inf)) for joint in curves]
            no_deviation = np.full(len(t), np.nan)
            deviation_columns = np.column_stack([deviations.get(joint, no_deviation) for joint in curves])
            drawn_channel = replace(
                drawn_channel, bounds=(np.array(bounds).T,), deviations=(deviation_columns,) if deviations else None
            )
            panels.append(Panel(drawn_channel, channel(quantity, points) if points else None))
        if quantity == "q" and points:
            residuals = {joint: points[joint] - values for joint, values in curves.items() if joint in points}
            panels.append(Panel(channel("q", residuals, "residual of q"), style=SAMPLE_STYLE))
    return DrawnRun(panels, place)


def select_rows(columns: Curves, place: str, between: tuple[float, float] | None) -> Curves:
    """Return the rows of a table between two times, or all rows.

    Both times are included. Raise `JounceError` if no row lies between them.
    """
    if between is None or "t" not in columns:
        return columns
    t = columns["t"]
    rows = (between[0] <= t) & (t <= between[1])
    if not rows.any():
        description = f"no rows between t = {between[0]:g} and {between[1]:g} s"
        raise JounceError(f"{place}: {description}; the table has t = {t.min():g} .. {t.max():g} s")
    return {name: values[rows] for name, values in columns.items()}


def _find_breaks(columns: Curves) -> tuple[TableBreak, ...]:
    """Return the rows that `jounce motion` marks as breaks."""
    order = columns.get("break", np.full(len(columns["t"]), -1.0))
    break_rows = np.flatnonzero(order >= 0)
    return tuple(map(TableBreak, columns["t"][break_rows].tolist(), order[break_rows].astype(int).tolist()))


def _collect_curves(
    columns: Curves, place: str
) -> tuple[dict[str, dict[str, np.ndarray]], dict[str, dict[str, dict[str, np.ndarray]]]]:
    """Collect curves by quantity and joint, and their samples and deviations."""
    curves: dict[str, dict[str, np.ndarray]] = {}
    extras: dict[str, dict[str, dict[str, np.ndarray]]] = {}
    for name, values in columns.items():
        match = COLUMN_NAME.fullmatch(name)
        if match is not None:
            # The last group is the suffix of deviations and samples; curves have none.
            kind = match[len(match.groups())]
            target = curves if kind is None else extras.setdefault(EXTRAS_BY_SUFFIX[kind], {})
            target.setdefault(match[2] + (match[3] or ""), {})[match[1]] = values
    if len(curves) == 0:
        cure = f"for samples, make a table with `jounce motion ROBOT {place} -o OUT`"
        raise JounceError(
            f"{place}: no columns NAME.Q, NAME.Qd, ... or NAME.q, NAME.qd, ...; available:"
            f" {join_names(columns)}; {cure}"
        )
    if "t" not in columns:
        raise JounceError(f"{place}: no column 't'; available: {join_names(columns)}")
    return curves, extras


def _select_curves(
    curves_by_quantity: Mapping[str, Mapping[str, np.ndarray]],
    place: str,
    joints: Sequence[str],
    quantities: Sequence[str],
    mechanism: Mechanism | None,
) -> dict[str, dict[str, np.ndarray]]:
    """Select the curves to draw, by quantity and joint.

    q comes before Q, and low rates before high ones.
    """
    known_joints = list(dict.fromkeys(joint for curves in curves_by_quantity.values() for joint in curves))
    # Joints stand in the order of the robot, if there is one, which must have all of them.
    if mechanism is not None:
        names = coordinates.force_names(mechanism)
        for joint in known_joints:
            if joint not in names:
                missing = errors.unknown_name_error(f"joint of {errors.shorten(mechanism.name)}", joint, names)
                raise JounceError(f"{place}: {missing}; expected a table of this robot")
        known_joints = [joint for joint in names if joint in known_joints]
    for kind, requested_names, existing_names in (
        ("joint", joints, known_joints),
        ("quantity", quantities, list(curves_by_quantity)),
    ):
        for name in requested_names:
            if name not in existing_names:
                raise JounceError(f"{place}: {errors.unknown_name_error(kind, name, existing_names)}")
    chosen = [joint for joint in known_joints if joint in (joints or known_joints)]
    selected_curves = {
        quantity: {
            joint: curves_by_quantity[quantity][joint] for joint in chosen if joint in curves_by_quantity[quantity]
        }
        for quantity in sorted(quantities or curves_by_quantity, key=lambda name: (name[0] == "Q", _order(name)))
    }
    if not any(selected_curves.values()):
        raise JounceError(f"{place}: none of {join_names(joints)} has a column of {join_names(quantities)}")
    return selected_curves


def _check_sizes(columns: Curves, shown: Mapping[str, Mapping[str, np.ndarray]], place: str) -> None:
    """Raise `JounceError` if a column is too large to be drawn."""
    for name in ["t", *(f"{joint}.{quantity}" for quantity, curves in shown.items() for joint in curves)]:
        peak = np.abs(columns[name]).max()
        if peak > MAX_DRAWN_VALUE:
            description = f"column {quote_value(name)} holds {peak:g}"
            raise JounceError(f"{place}: {description}; expected no more than {MAX_DRAWN_VALUE:g} to draw it")


def _limits(mechanism: Mechanism) -> dict[str, dict[str, tuple[float, float]]]:
    """Return the limits of a robot by quantity and joint."""
    limits = coordinates.limits(mechanism)
    return {
        quantity: dict(zip(mechanism.coordinates, zip(*limits.bounds(kind).tolist(), strict=True), strict=True))
        for quantity, kind in KINDS_BY_SYMBOL.items()
        if kind not in limits.without_gravity  # of another force than the table holds
    }


def _order(quantity: str) -> int:
    """Return the rate of a quantity: 2 of Q2d."""
    return 1 if quantity[1:] == "d" else int(quantity[1:-1] or 0)


def _unit(quantity: str, joint_unit: str | None) -> str:
    """Return the unit of a quantity: N m/s^2 of Q2d in rad.

    A joint that is not known has ``N m/s^2 or N/s^2``.
    """
    unit_by_joint_unit = dict(zip(("rad", "m"), BOUNDED_UNITS[quantity[0]], strict=True))
    unit = EITHER.join(unit_by_joint_unit.values()) if joint_unit is None else unit_by_joint_unit[joint_unit]
    return channel.divide_by_seconds(unit, _order(quantity))
