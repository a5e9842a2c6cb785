"""Panels of curves: the values of a quantity over time by joint, and which of them stand in the same axes."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from jounce.figures.canvas import Style
from jounce.model.limit_kinds import BOUNDED_UNITS
from jounce.motion.channel import Channel, Discontinuity
from jounce.motion.reliability import BAND_DEVIATIONS

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
        return BAND_DEVIATIONS * self.channel.deviations[0][:, self.channel.names.index(name)]

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
