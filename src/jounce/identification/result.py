"""Hold the result of an identification: the robot, parameters with deviations, residuals.

An `Identification` is made of three tables. `parameter_table` has base parameters and drive terms as the data alone
determine them, and says which of them are seen: those whose deviation is below the size of such a parameter.
`describe_logs` says what each log was used for, and `force_residuals` how far forces of the model, of the identified
robot and of least squares are from measured ones.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Generic

import numpy as np

from jounce.core import display, errors
from jounce.core.cures import Remedy
from jounce.core.display import HtmlDisplay
from jounce.core.errors import join_names
from jounce.core.typing import DriveTerm
from jounce.dynamics import base_parameters
from jounce.dynamics.base_parameters import BaseParameters
from jounce.engine.engine import R
from jounce.identification.averaging import CellAverages, number_cells, weighted_means
from jounce.identification.least_squares_problem import IdentificationProblem
from jounce.identification.regression import Regression
from jounce.model import coordinates
from jounce.model.mechanism import Mechanism
from jounce.motion import resmoothing
from jounce.motion.channel import Channel
from jounce.spatial import inertia

RESIDUAL_COLUMNS = ("force", "measured", "model leaves", "identified leaves", "unit")
PART_TITLES = {"used": "residual", "rest": "rest of the data"}  # of the samples, and their titles
LOG_COLUMNS = ("log", "samples", "from, s", "to, s", "cells", "cell, s", "band, Hz")
INERTIAL_UNITS = ("kg", *["kg m"] * 3, *["kg m^2"] * 6)  # of the inertial parameters of one body
MIN_DRIVE_FORCE_SHARE = 0.01  # of a force: less is not worth the name of a drive term
TRACE_PLACES = [inertia.INERTIAL_PARAMETERS.index(name) for name in ("Ixx", "Iyy", "Izz")]


@dataclass(frozen=True)
class IdentifiedParameter:
    """A base or drive parameter, as the data alone determine it.

    Attributes
    ----------
    name, unit : str
        A base parameter is named after the inertial parameter that it contains with the factor 1.
    value, deviation : float
        The least-squares estimate and its standard deviation, which is infinite if the data hold nothing on it.
    model : float
        The value of the model as it was.
    seen : bool
        Whether the deviation is smaller than the size of the parameter: the largest of its value, that of the model,
        and what mass and extent of its body suggest; for drive terms, what forces and their residuals suggest.

    Examples
    --------
    >>> import jounce
    >>> robot = jounce.load("planar2r")
    >>> motion = jounce.Motion.fourier([0, 0], [[0.5, 0.2], [0.1, 0.4]], [[0.1, 0.3], [0.5, 0.2]], 3.0, 4.0)
    >>> found = robot.identify(motion, robot.forces_along(motion, order=0).forces[0])
    >>> row = found.table[0]
    >>> row.name, row.unit, round(row.value, 6), row.seen
    ('body1 mcx', 'kg m', 2.0, True)
    """

    name: str
    unit: str
    value: float
    deviation: float
    model: float
    seen: bool


@dataclass(frozen=True)
class IdentifiedLog:
    """A log of an identification.

    Attributes
    ----------
    name : str
        Its name; "" of the only one.
    rows : slice
        Its rows of the times and forces of the result.
    span : (float, float), or None
        The times between which its samples were used, s; None of a log that only tests.
    band, cell : float
        The highest frequency of its forces in Hz, and the width of the cells that are averaged over in s.
    samples, cells : int
        The number of its samples that were used, and of the cells.

    Examples
    --------
    >>> import jounce
    >>> robot = jounce.load("planar2r")
    >>> motion = jounce.Motion.fourier([0, 0], [[0.5, 0.2], [0.1, 0.4]], [[0.1, 0.3], [0.5, 0.2]], 3.0, 4.0)
    >>> found = robot.identify(motion, robot.forces_along(motion, order=0).forces[0])
    >>> found.logs[0].rows, found.logs[0].span
    (slice(0, 4001, None), (0.0, 4.0))
    """

    name: str
    rows: slice
    span: tuple[float, float] | None
    band: float
    cell: float
    samples: int
    cells: int


@dataclass(frozen=True)
class ForceResidual:
    """The distance of predicted forces from measured ones, in root mean squares.

    Attributes
    ----------
    force, unit : str
        The coordinate that it acts on, or the component of the wrench on a base that floats.
    part : {"used", "rest"}
        The samples of its log that the result is fitted to, or the others; without those in the uncertain ends of its
        smoothing.
    log : str
        The name of the log; "" if there is one.
    measured : float
        The measured force itself, in the band of the motion.
    model, identified : float
        What the model as it was leaves, and what the identified robot leaves, in the band of the motion.
    least_squares : float
        What the estimate of the data alone leaves there: the prior, and bodies that can exist, make the difference.
    model_samples, identified_samples : float
        The same of single samples, with all that is faster.
    motion_errors : float
        Forces that errors of the smoothed accelerations make, of all logs, in the band of the motion: part of what is
        left.

    Examples
    --------
    >>> import jounce
    >>> robot = jounce.load("planar2r")
    >>> motion = jounce.Motion.fourier([0, 0], [[0.5, 0.2], [0.1, 0.4]], [[0.1, 0.3], [0.5, 0.2]], 3.0, 4.0)
    >>> found = robot.identify(motion, 2 * robot.forces_along(motion, order=0).forces[0], prior=1.0)
    >>> row = found.residuals[0]
    >>> row.force, row.part, row.identified < 0.01 * row.model
    ('joint1', 'used', True)
    """

    force: str
    unit: str
    part: str
    log: str
    measured: float
    model: float
    identified: float
    least_squares: float
    model_samples: float
    identified_samples: float
    motion_errors: float


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
    undetermined : tuple of str
        What poses at rest do not determine: it has no rows in the table, and stays as it is in the model. Empty of
        logs. Of poses, `t` and `span` are their numbers from 0, and band and cell NaN.

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
    undetermined: tuple[str, ...] = ()

    @property
    def at_rest(self) -> bool:
        """Whether the data are poses at rest."""
        return len(self.undetermined) > 0

    @property
    def channels(self) -> tuple[Channel, Channel, Channel]:
        """The forces of all logs: measured, of the model, and of the identified robot."""
        m = self.robot.mechanism
        names, units = coordinates.force_names(m), tuple(coordinates.force_units(m))
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
        """The parameters whose deviation exceeds their size.

        The model or a prior decides on them, not the data.
        """
        return tuple(row.name for row in self.table if not row.seen)

    @property
    def assumption(self) -> str:
        """The assumption that no residual shows, and how to test it."""
        return describe_torque_scale()

    @property
    def rest_notes(self) -> tuple[str, ...]:
        """Words on what poses at rest do not determine."""
        if not self.at_rest:
            return ()
        return (f"rest does not determine {join_names(self.undetermined)}: these follow the model",)

    @property
    def summary(self) -> str:
        """The counts of parameters seen, samples and logs, in one line."""
        seen_count = sum(row.seen for row in self.table)
        logs = f" of {len(self.logs)} logs" if len(self.logs) > 1 else ""
        data = f"{self.samples} poses at rest" if self.at_rest else f"{self.samples} samples{logs}"
        return (
            f"Identification of {errors.shorten(self.robot.name)}: {seen_count} of {len(self.table)} parameters seen,"
            f" {data}"
        )

    @property
    def residual_rows(self) -> list[tuple[str, ...]]:
        """The root mean squares per log and used force: measured, and residuals."""
        return [
            (f"{row.log}: {row.force}" if row.log != "" else row.force,
             *(f"{x:.4g}" for x in (row.measured, row.model, row.identified)), row.unit)
            for row in self.residuals if row.part == "used"
        ]  # fmt: skip

    def __repr__(self) -> str:
        """Return at most twelve lines: what is left of the forces, in root mean squares, and what is not seen."""
        unseen = [f"not seen: {join_names(self.unseen)}"] if len(self.unseen) > 0 else []
        notes = [*self.rest_notes, *unseen, *self.notes]
        return display.print_table(self.summary, RESIDUAL_COLUMNS, self.residual_rows, notes)

    def __str__(self) -> str:
        if self.at_rest:
            return self._describe_at_rest()
        # What was fitted to what, with notes, and of several logs a line each.
        has_logs = len(self.logs) > 1
        fitted = sum(log.span is not None for log in self.logs)
        source = f"{fitted} of {len(self.logs)} logs" if has_logs else f"t = {self.span[0]:g} .. {self.span[1]:g} s"
        averages = f"averaged to {self.cells} cells of {self.cell:.3g} s"
        counts = f"{self.samples} samples, {source}, {averages}"
        rank = f"rank {self.rank} of {len(self.table)}, condition {self.condition:.3g}"
        head = [f"{errors.shorten(self.robot.name)}: {counts}, up to {self.band:.3g} Hz", rank, *self.notes, ""]
        m = self.robot.mechanism
        if "friction" in m.acting:
            speeds = (f"{joint} {eps:g}" for joint, eps in zip(m.joints, m.drives.eps, strict=True))
            head.insert(2, f"friction turns over at eps, rad/s or m/s: {', '.join(speeds)}")
        if has_logs:
            head += [*display.align_columns([LOG_COLUMNS, *map(_describe_log, self.logs)]), ""]
        lines = self._parameter_lines()
        # Residuals, a table for each log and part of its samples.
        tests = {log.name for log in self.logs if log.span is None}
        for log, part in dict.fromkeys((row.log, row.part) for row in self.residuals):
            part_rows = [row for row in self.residuals if (row.log, row.part) == (log, part)]
            titles = ("measured", "model", "identified", "without prior", "unit", "all samples: model", "identified")
            title = "test" if log in tests else PART_TITLES[part]
            rows: list[tuple[str, ...]] = [(f"{log}: {title}" if log != "" else title, *titles)]
            for residual in part_rows:
                numbers = (residual.measured, residual.model, residual.identified, residual.least_squares)
                samples = (f"{x:.4g}" for x in (residual.model_samples, residual.identified_samples))
                rows.append((residual.force, *(f"{x:.4g}" for x in numbers), residual.unit, *samples))
            lines += ["", *display.align_columns(rows)]
        return "\n".join([*head, *lines, "", self.assumption])

    def _describe_at_rest(self) -> str:
        """Return the text of poses at rest, without times and bands."""
        rank = f"rank {self.rank}, condition {self.condition:.3g}"
        head = [f"{errors.shorten(self.robot.name)}: {self.samples} poses at rest", rank, *self.rest_notes]
        rows: list[tuple[str, ...]] = [("residual", "measured", "model", "identified", "without prior", "unit")]
        for row in self.residuals:
            numbers = (row.measured, row.model, row.identified, row.least_squares)
            rows.append((row.force, *(f"{x:.4g}" for x in numbers), row.unit))
        residuals = display.align_columns(rows)
        return "\n".join([*head, *self.notes, "", *self._parameter_lines(), "", *residuals, "", self.assumption])

    def _parameter_lines(self) -> list[str]:
        """Return the table of parameters."""
        rows: list[tuple[str, ...]] = [("parameter", "value", "deviation", "model", "unit", "")]
        for row in self.table:
            values = (f"{row.value:.6g}", f"{row.deviation:.2g}", f"{row.model:.6g}")
            rows.append((row.name, *values, row.unit, "" if row.seen else "not seen"))
        return display.align_columns(rows)


def describe_torque_scale() -> str:
    """Describe what no residual shows, and how to find it."""
    return f"one factor of all torques leaves no residual; {describe_calibration()}"


def describe_calibration() -> str:
    """Describe how factors of torques are found."""
    cure = Remedy("robot.payload(log, without, mass=KG)", "`jounce payload --mass KG`")
    return f"a load of known mass calibrates them: {cure}"


def _describe_log(log: IdentifiedLog) -> tuple[str, ...]:
    if log.span is None:
        return (log.name, "tests", *[""] * (len(LOG_COLUMNS) - 2))
    counts, times = (f"{log.samples}", f"{log.cells}"), (*log.span, log.cell, log.band)
    first, last, cell, band = (f"{x:.4g}" for x in times)
    return log.name, counts[0], first, last, counts[1], cell, band


# The tables of a result.
def parameter_table(posed: IdentificationProblem, solution: Regression) -> tuple[IdentifiedParameter, ...]:
    """Return the table of a solution, which corrects the model."""
    # Names and units of all base and drive parameters, of which the sought ones are taken.
    m, base, model = posed.robot.mechanism, posed.base, posed.model_parameters[posed.places]
    revolute = [bool(np.any(X[:3])) for X in m.X]
    names = [*base.names, *(f"{joint} {term}" for term in posed.terms for joint in m.joints)]
    units = [INERTIAL_UNITS[column % len(INERTIAL_UNITS)] for column in base.columns]
    units += [_unit(term, turns) for term in posed.terms for turns in revolute]
    names, units = ([rows[k] for k in posed.places] for rows in (names, units))
    # A parameter is seen if its deviation is not above its size: the largest of what it may be.
    values, deviations = model + solution.x, np.sqrt(np.diag(solution.covariance))
    sizes = np.append(
        _inertial_sizes(m, base), _drive_sizes(posed.cells, solution.weights, posed.columns[base.count :])
    )
    seen = deviations <= np.maximum(sizes, np.maximum(np.abs(values), np.abs(model)))
    return tuple(
        IdentifiedParameter(name, unit, float(values[k]), float(deviations[k]), float(model[k]), bool(seen[k]))
        for k, (name, unit) in enumerate(zip(names, units, strict=True))
    )


def _inertial_sizes(m: Mechanism, base: BaseParameters) -> np.ndarray:
    """Return the sizes of the base parameters: m, m r or m r^2 of a body.

    r is its radius about the origin of its frame.
    """
    # Half the trace of the inertia is m r^2. Bodies without mass or extent have the means of the others.
    p = inertia.parameters(m.M).astype(float)
    mass, moments = np.abs(p[:, 0]), np.abs(p[:, TRACE_PLACES].sum(axis=1)) / 2
    r = np.sqrt(np.divide(moments, mass, out=np.zeros_like(mass), where=mass > 0))
    mass, r = (np.where(x > 0, x, x[x > 0].mean() if x.any() else 0.0) for x in (mass, r))
    return (mass[:, None] * r[:, None] ** base_parameters.LENGTH_POWERS).ravel()[base.columns]


def _drive_sizes(cells: CellAverages, weights: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Return the sizes of drive parameters by forces they would make.

    Each alone makes forces as large as those that the model leaves where it acts. A hundredth of the measured forces
    counts too: of a model that leaves nothing it is seen that it leaves nothing.
    """
    # Squares of a unit of each parameter, (nv, P), and of what the model leaves of the forces that it acts on, (nv,).
    squares = (weights * (cells.off**2 + (MIN_DRIVE_FORCE_SHARE * (cells.off + cells.model)) ** 2)).sum(axis=0)
    power = (weights[..., None] * cells.Y[..., columns] ** 2).sum(axis=0)
    total = power.sum(axis=0)
    return np.sqrt(((power > 0) * squares[:, None]).sum(axis=0) / np.where(total > 0, total, np.inf))


def _unit(term: DriveTerm, turns: bool) -> str:
    """Return the unit of a drive parameter: of a revolute or a prismatic joint."""
    if term == "armature":
        return "kg m^2" if turns else "kg"
    force, path = ("N m", "rad") if turns else ("N", "m")
    return {"damping": f"{force} s/{path}", "spring": f"{force}/{path}", "load_friction": "1"}.get(term, force)


def unused_spans(log: IdentifiedLog, t: np.ndarray) -> list[tuple[float, float]]:
    """Return the spans of a log, at times t, without used samples."""
    # Of a log that only tests, all of it: up to a start at its end.
    start, stop = (float(t[-1]), float(t[-1])) if log.span is None else log.span
    return [(a, b) for a, b in ((float(t[0]), start), (stop, float(t[-1]))) if b > a]


def describe_logs(posed: Sequence[IdentificationProblem]) -> tuple[IdentifiedLog, ...]:
    """Describe the logs, whose rows follow each other in the result."""
    ends = np.cumsum([0, *(len(problem.measurements.t) for problem in posed)]).tolist()
    logs = []
    for problem, first, last in zip(posed, ends, ends[1:], strict=False):
        span, sample_count, cell_count = None, 0, 0
        if not problem.tests:
            span = float(problem.samples.t[0]), float(problem.samples.t[-1])
            sample_count, cell_count = len(problem.samples.t), len(problem.cells.off)
        rows = slice(first, last)
        logs.append(IdentifiedLog(problem.log, rows, span, problem.band, problem.width, sample_count, cell_count))
    return tuple(logs)


def force_residuals(
    posed: IdentificationProblem, predicted: np.ndarray, motion_errors: np.ndarray
) -> tuple[ForceResidual, ...]:
    """Return the residuals of the model, the robot and least squares.

    The forces (2, N, nv) of the latter two are predicted. Residuals of the samples that are fitted come first, then
    those of the rest. Samples in the uncertain ends of a smoothing do not count, where there are others: their
    accelerations are off by any amount.
    """
    fitted = posed.used & (not posed.tests)
    first, last = resmoothing.trusted_span(posed.motion)
    trusted = (posed.measurements.t >= first) & (posed.measurements.t <= last)
    residuals: list[ForceResidual] = []
    for part, samples in (("used", fitted), ("rest", ~fitted)):
        mask = samples & trusted if (samples & trusted).any() else samples
        if mask.any():
            residuals += _part_residuals(posed, predicted, motion_errors, part, mask)
    return tuple(residuals)


def _part_residuals(
    posed: IdentificationProblem, predicted: np.ndarray, motion_errors: np.ndarray, part: str, mask: np.ndarray
) -> Iterator[ForceResidual]:
    """Yield the residuals of a part of the samples, by measured force."""
    m, samples = posed.robot.mechanism, posed.measurements.part(mask)
    place, w = number_cells(samples.t, posed.width), samples.weights
    # Measured forces, then residuals of the model, of the robot and of least squares: averaged over cells, that is in
    # the band of the motion, and two of them sample by sample.
    values = [samples.forces, samples.forces - posed.model[mask], *(samples.forces - predicted[:, mask])]
    counts = weighted_means(np.ones_like(w), w, place)[1]
    in_band = [_rms(weighted_means(column, w, place)[0], counts) for column in values]
    columns = [*in_band, *(_rms(column, w) for column in values[1:3]), motion_errors]
    rows = np.stack(columns, axis=1).tolist()
    for j, (name, unit) in enumerate(zip(coordinates.force_names(m), coordinates.force_units(m), strict=True)):
        if counts[:, j].any():
            yield ForceResidual(name, unit, part, posed.log, *rows[j])


def _rms(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    total = np.maximum(weights.sum(axis=0), np.finfo(float).tiny)
    return np.sqrt((weights * values**2).sum(axis=0) / total)
