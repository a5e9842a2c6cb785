"""The result of an identification: parameters with deviations, which the data determine, residuals, and the robot."""

from dataclasses import dataclass
from typing import Generic

import numpy as np

from jounce.core.cures import Remedy
from jounce.core.display import HtmlDisplay, align_columns, print_table
from jounce.core.errors import join_names, shorten
from jounce.engine.engine import R
from jounce.identification.result_tables import ForceResidual, IdentifiedLog, IdentifiedParameter
from jounce.model.coordinates import force_names, force_units
from jounce.motion.channel import Channel

RESIDUAL_COLUMNS = ("force", "measured", "model leaves", "identified leaves", "unit")
PART_TITLES = {"used": "residual", "rest": "rest of the data"}  # of the samples, and their titles
LOG_COLUMNS = ("log", "samples", "from, s", "to, s", "cells", "cell, s", "band, Hz")


@dataclass(frozen=True, eq=False, repr=False)
class Identification(HtmlDisplay, Generic[R]):
    """A robot identified from a motion and measured forces. `identify` makes one.

    Attributes
    ----------
    robot : Robot
        The robot with identified inertial parameters, of bodies that can exist, and drive terms, which act.
    table : tuple of IdentifiedParameter
        Base parameters and drive parameters as the data alone determine them.
    covariance : (K, K)
        Of the parameters of the table.
    rank : int
        Number of directions of these parameters on which the data hold information.
    condition : float
        Ratio of the largest singular value of the scaled problem to the smallest that counts.
    deviations : (nv,)
        Standard deviations of the averages of each force over cells, in the band of the motion; infinite for those
        that are not measured.
    residuals : tuple of ForceResidual
        By log, and per force: of the samples that were used, then of the rest.
    span : (float, float)
        The times between which samples were used, s; of several logs the earliest and the latest.
    band, cell : float
        The highest frequency of the forces in Hz, and the width of the cells that are averaged over in s; of several
        logs the highest and the least.
    samples, cells : int
        The number of samples that were used, and of the cells, of all logs.
    delay : float
        By how much measured forces come after the positions, s, which is taken out of their times; of several logs the
        largest.
    t : (N,)
        Times of all measured forces without the delay, s; those of several logs follow each other.
    measured, model, predicted : (N, nv)
        Measured forces, NaN for those not measured, those of the model as it was, and those of the identified robot.
    notes : tuple of str
        What is suspicious, and what the data do not determine.
    logs : tuple of IdentifiedLog
        What each log was used for, and where its rows are.
    confirmed : tuple of float or None
        Of each log, the frequency in Hz up to which torques confirm its positions, where it is below the bandwidth of
        their smoothing: the log was smoothed to that. None of all others.

    Examples
    --------
    >>> import jounce
    >>> robot = jounce.load("planar2r")
    >>> motion = jounce.Motion.fourier([0, 0], [[0.5, 0.2], [0.1, 0.4]], [[0.1, 0.3], [0.5, 0.2]], 3.0, 4.0)
    >>> found = robot.identify(motion, robot.forces_along(motion, order=0).forces[0])
    >>> found.rank, found.unseen
    (12, ())
    """

    robot: R
    table: tuple[IdentifiedParameter, ...]
    covariance: np.ndarray
    rank: int
    condition: float
    deviations: np.ndarray
    residuals: tuple[ForceResidual, ...]
    span: tuple[float, float]
    band: float
    cell: float
    samples: int
    cells: int
    delay: float
    t: np.ndarray
    measured: np.ndarray
    model: np.ndarray
    predicted: np.ndarray
    notes: tuple[str, ...] = ()
    logs: tuple[IdentifiedLog, ...] = ()
    confirmed: tuple[float | None, ...] = ()

    @property
    def channels(self) -> tuple[Channel, Channel, Channel]:
        """The forces measured, of the model as it was, and of the identified robot, at the times of all logs."""
        m = self.robot.mechanism
        names, units = force_names(m), tuple(force_units(m))
        measured, model, identified = (
            Channel(what, names, units, self.t, (values,))
            for what, values in (("measured", self.measured), ("model", self.model), ("identified", self.predicted))
        )
        return measured, model, identified

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the parameters."""
        return tuple(row.name for row in self.table)

    @property
    def unseen(self) -> tuple[str, ...]:
        """The parameters whose deviation exceeds their size: the model or a prior decides on them, not the data."""
        return tuple(row.name for row in self.table if not row.seen)

    @property
    def assumption(self) -> str:
        """What is taken for granted since no residual shows it, and how to find it."""
        return describe_torque_scale()

    @property
    def summary(self) -> str:
        """How many parameters the data determine, from how many samples and logs, in one line."""
        seen = sum(row.seen for row in self.table)
        logs = f" of {len(self.logs)} logs" if len(self.logs) > 1 else ""
        return (
            f"Identification of {shorten(self.robot.name)}: {seen} of {len(self.table)} parameters seen,"
            f" {self.samples} samples{logs}"
        )

    @property
    def residual_rows(self) -> list[tuple[str, ...]]:
        """Per log and force that is used, its root mean square, and what the model and the result leave of it."""
        return [
            (f"{of.log}: {of.force}" if of.log else of.force,
             *(f"{x:.4g}" for x in (of.measured, of.model, of.identified)), of.unit)
            for of in self.residuals if of.part == "used"
        ]  # fmt: skip

    def __repr__(self) -> str:
        """At most twelve lines: what is left of the forces, in root mean squares, and what is not seen."""
        unseen = [f"not seen: {join_names(self.unseen)}"] if self.unseen else []
        return print_table(self.summary, RESIDUAL_COLUMNS, self.residual_rows, [*unseen, *self.notes])

    def __str__(self) -> str:
        several = len(self.logs) > 1
        fitted = sum(of.span is not None for of in self.logs)
        where = f"{fitted} of {len(self.logs)} logs" if several else f"t = {self.span[0]:g} .. {self.span[1]:g} s"
        averages = f"averaged to {self.cells} cells of {self.cell:.3g} s"
        counts = f"{self.samples} samples, {where}, {averages}"
        rank = f"rank {self.rank} of {len(self.table)}, condition {self.condition:.3g}"
        head = [f"{shorten(self.robot.name)}: {counts}, up to {self.band:.3g} Hz", rank, *self.notes, ""]
        if "friction" in (m := self.robot.mechanism).acting:
            speeds = (f"{joint} {eps:g}" for joint, eps in zip(m.joints, m.drives.eps, strict=True))
            head.insert(2, f"friction turns over at eps, rad/s or m/s: {', '.join(speeds)}")
        if several:
            head += [*align_columns([LOG_COLUMNS, *map(_describe_log, self.logs)]), ""]
        rows: list[tuple[str, ...]] = [("parameter", "value", "deviation", "model", "unit", "")]
        for row in self.table:
            values = (f"{row.value:.6g}", f"{row.deviation:.2g}", f"{row.model:.6g}")
            rows.append((row.name, *values, row.unit, "" if row.seen else "not seen"))
        lines = align_columns(rows)
        tests = {of.name for of in self.logs if of.span is None}
        for log, part in dict.fromkeys((of.log, of.part) for of in self.residuals):
            some = [of for of in self.residuals if (of.log, of.part) == (log, part)]
            titles = ("measured", "model", "identified", "without prior", "unit", "all samples: model", "identified")
            title = "test" if log in tests else PART_TITLES[part]
            rows = [(f"{log}: {title}" if log else title, *titles)]
            for of in some:
                numbers = (of.measured, of.model, of.identified, of.least_squares)
                samples = (f"{x:.4g}" for x in (of.model_samples, of.identified_samples))
                rows.append((of.force, *(f"{x:.4g}" for x in numbers), of.unit, *samples))
            lines += ["", *align_columns(rows)]
        return "\n".join([*head, *lines, "", self.assumption])


def describe_torque_scale() -> str:
    """What no residual shows, and how to find it."""
    return f"one factor of all torques leaves no residual; {describe_calibration()}"


def describe_calibration() -> str:
    """How factors of torques are found."""
    cure = Remedy("robot.payload(log, without, mass=KG)", "`jounce payload --mass KG`")
    return f"a load of known mass calibrates them: {cure}"


def _describe_log(log: IdentifiedLog) -> tuple[str, ...]:
    if log.span is None:
        return (log.name, "tests", *[""] * (len(LOG_COLUMNS) - 2))
    counts, times = (f"{log.samples}", f"{log.cells}"), (*log.span, log.cell, log.band)
    first, last, cell, band = (f"{x:.4g}" for x in times)
    return log.name, counts[0], first, last, counts[1], cell, band
