"""Panels of curves: the values of a quantity over time by joint, and which of them stand in the same axes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from jounce.motion.reliability import BAND_DEVIATIONS, find_surest_rows

MAX_POINTS_DRAWN = 2000  # of a curve, about: a page has no more pixels across
MIN_VISIBLE_SHARE = 0.1  # of the largest value: a smaller curve looks flat in the same axes
MAX_CURVES_PER_AXES = 10  # a reader can follow no more in the same axes
MAX_CROWD_COLUMNS = 6  # of axes over which many curves are spread: a page has room for no more


@dataclass(frozen=True)
class CurvePanel:
    """A quantity over time: its values by joint, and if given those that differentiation makes of them."""

    label: str
    curves: Mapping[str, np.ndarray]
    differentiated: Mapping[str, np.ndarray] | None = None
    points: Mapping[str, np.ndarray] = field(default_factory=dict)  # measured ones, which the curves should follow
    deviations: Mapping[str, np.ndarray] = field(default_factory=dict)  # standard ones, drawn as bands of 95 %
    units: Mapping[str, str] = field(default_factory=dict)  # of the quantity, by the unit of the joint: rad, m
    joint_units: Mapping[str, str] = field(default_factory=dict)  # by joint; of some or of none where unknown
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)  # by joint, infinite where not stated
    style: Mapping[str, Any] = field(default_factory=dict)  # of values that are no curves

    def reach(self, name: str) -> np.ndarray:
        """How far the band of a curve reaches on either side of it."""
        return BAND_DEVIATIONS * self._deviations(name)

    def band(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """The lower and the upper edge of the band of a curve."""
        return self.curves[name] - self.reach(name), self.curves[name] + self.reach(name)

    def peak(self, name: str) -> float:
        """The largest absolute value of a curve, that of its wild ends left out."""
        return float(np.abs(self.curves[name][find_surest_rows(self.curves[name], self._deviations(name))]))

    def _deviations(self, name: str) -> np.ndarray:
        return self.deviations.get(name, np.zeros(len(self.curves[name])))


@dataclass(frozen=True)
class TableRun:
    """The panels of a table over its times; breaks are upright lines."""

    t: np.ndarray
    panels: Sequence[CurvePanel]
    breaks: Sequence[float] = ()
    title: str = ""


def joint_names(panels: Sequence[CurvePanel]) -> list[str]:
    """The joints of all panels: a table need not hold every quantity of every joint."""
    return list(dict.fromkeys(name for panel in panels for name in panel.curves))


def columns_of(panels: Sequence[CurvePanel]) -> list[list[str]]:
    """The joints of each column of axes: of one unit, of sizes that can be seen together, and not too many."""
    names = joint_names(panels)
    units = {name: unit for panel in panels for name, unit in panel.joint_units.items()}
    alike = [[name for name in names if units.get(name) == unit] for unit in dict.fromkeys(map(units.get, names))]
    most = max(MAX_CURVES_PER_AXES, -(-len(names) // MAX_CROWD_COLUMNS))
    return [
        [str(name) for name in column]
        for group in alike for sized in split_by_size(panels, group)
        for column in np.array_split(sized, -(-len(sized) // most))
    ]  # fmt: skip


def split_by_size(panels: Sequence[CurvePanel], names: Sequence[str]) -> list[list[str]]:
    """Curves in one column, or in two, large and small, if one is hidden by the largest of its panel."""
    small = set()
    for panel in panels:
        peaks = {name: panel.peak(name) for name in names if name in panel.curves}
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
