"""The tables of an identification: parameters with deviations, and how far forces are from measured ones."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from jounce.core.typing import DriveTerm
from jounce.dynamics.base_parameters import LENGTH_POWERS, BaseParameters
from jounce.identification.averaging import CellAverages, number_cells, weighted_means
from jounce.identification.least_squares_problem import IdentificationProblem
from jounce.identification.regression import Regression
from jounce.model.coordinates import force_names, force_units
from jounce.model.mechanism import Mechanism
from jounce.motion.resmoothing import trusted_span
from jounce.spatial import inertia

INERTIAL_UNITS = ("kg", *["kg m"] * 3, *["kg m^2"] * 6)  # of the inertial parameters of one body
MIN_DRIVE_FORCE_SHARE = 0.01  # of a force: less is not worth the name of a drive term
TRACE_PLACES = [inertia.INERTIAL_PARAMETERS.index(name) for name in ("Ixx", "Iyy", "Izz")]


@dataclass(frozen=True)
class IdentifiedParameter:
    """A base parameter or a parameter of a drive term, as the data alone determine it.

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


def parameter_table(posed: IdentificationProblem, solution: Regression) -> tuple[IdentifiedParameter, ...]:
    """The table of a solution, which corrects the model."""
    m, base, model = posed.robot.mechanism, posed.base, posed.model_parameters[posed.places]
    revolute = [bool(np.any(X[:3])) for X in m.X]
    names = [*base.names, *(f"{joint} {term}" for term in posed.terms for joint in m.joints)]
    units = [INERTIAL_UNITS[column % len(INERTIAL_UNITS)] for column in base.columns]
    units += [_unit(term, turns) for term in posed.terms for turns in revolute]
    names, units = ([rows[k] for k in posed.places] for rows in (names, units))
    values, spreads = model + solution.x, np.sqrt(np.diag(solution.covariance))
    sizes = np.append(
        _inertial_sizes(m, base), _drive_sizes(posed.cells, solution.weights, posed.columns[base.count :])
    )
    seen = spreads <= np.maximum(sizes, np.maximum(np.abs(values), np.abs(model)))
    return tuple(
        IdentifiedParameter(name, unit, float(values[k]), float(spreads[k]), float(model[k]), bool(seen[k]))
        for k, (name, unit) in enumerate(zip(names, units, strict=True))
    )


def _inertial_sizes(m: Mechanism, base: BaseParameters) -> np.ndarray:
    """The sizes of the base parameters: m, m r or m r^2 of a body, r its radius about the origin of its frame."""
    p = inertia.parameters(m.M).astype(float)
    mass, moments = np.abs(p[:, 0]), np.abs(p[:, TRACE_PLACES].sum(axis=1)) / 2
    r = np.sqrt(np.divide(moments, mass, out=np.zeros_like(mass), where=mass > 0))
    mass, r = (np.where(x > 0, x, x[x > 0].mean() if x.any() else 0.0) for x in (mass, r))
    return (mass[:, None] * r[:, None] ** LENGTH_POWERS).ravel()[base.columns]


def _drive_sizes(cells: CellAverages, weights: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """The sizes of drive parameters: each alone makes forces as large as those that the model leaves where it acts.

    A hundredth of the measured forces counts too: of a model that leaves nothing it is seen that it leaves nothing.
    """
    left = (weights * (cells.off**2 + (MIN_DRIVE_FORCE_SHARE * (cells.off + cells.model)) ** 2)).sum(axis=0)
    power = (weights[..., None] * cells.Y[..., columns] ** 2).sum(axis=0)
    total = power.sum(axis=0)
    return np.sqrt(((power > 0) * left[:, None]).sum(axis=0) / np.where(total > 0, total, np.inf))


def _unit(term: DriveTerm, turns: bool) -> str:
    """The unit of a drive parameter of a revolute joint, or of a prismatic one."""
    if term == "armature":
        return "kg m^2" if turns else "kg"
    force, path = ("N m", "rad") if turns else ("N", "m")
    return {"damping": f"{force} s/{path}", "spring": f"{force}/{path}", "load_friction": "1"}.get(term, force)


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


def unused_spans(log: IdentifiedLog, t: np.ndarray) -> list[tuple[float, float]]:
    """The times between which samples of a log, at times t, were not used."""
    start, stop = log.span or (float(t[-1]), float(t[-1]))
    return [(a, b) for a, b in ((float(t[0]), start), (stop, float(t[-1]))) if b > a]


def describe_logs(posed: Sequence[IdentificationProblem]) -> tuple[IdentifiedLog, ...]:
    """The logs, whose rows follow each other."""
    ends = np.cumsum([0, *(len(one.given.t) for one in posed)]).tolist()
    found = []
    for one, first, last in zip(posed, ends, ends[1:], strict=False):
        used, cells = (0, 0) if one.tests else (len(one.samples.t), len(one.cells.off))
        span = None if one.tests else (float(one.samples.t[0]), float(one.samples.t[-1]))
        found.append(IdentifiedLog(one.log, slice(first, last), span, one.band, one.width, used, cells))
    return tuple(found)


@dataclass(frozen=True)
class ForceResidual:
    """How far predicted forces are from measured ones, as root mean squares of one force.

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


def force_residuals(
    posed: IdentificationProblem, predicted: np.ndarray, motion_errors: np.ndarray
) -> tuple[ForceResidual, ...]:
    """The residuals of the model, of the robot and of least squares, of which forces (2, N, nv) are predicted.

    Those of the samples that are fitted come first, then those of the rest. Samples in the uncertain ends of a
    smoothing do not count, where there are others: their accelerations are off by any amount.
    """
    fitted = posed.used & (not posed.tests)
    first, last = trusted_span(posed.motion)
    trusted = (posed.given.t >= first) & (posed.given.t <= last)
    parts = [
        (part, which & trusted if (which & trusted).any() else which)
        for part, which in (("used", fitted), ("rest", ~fitted))
    ]
    return tuple(
        row
        for part, which in parts
        if which.any()
        for row in _part_residuals(posed, predicted, motion_errors, part, which)
    )


def _part_residuals(
    posed: IdentificationProblem, predicted: np.ndarray, motion_errors: np.ndarray, part: str, which: np.ndarray
) -> Iterator[ForceResidual]:
    """The residuals of a part of the samples, of the forces that are measured there."""
    m, samples = posed.robot.mechanism, posed.given.part(which)
    place, w = number_cells(samples.t, posed.width), samples.weights
    off = [samples.forces, samples.forces - posed.model[which], *(samples.forces - predicted[:, which])]
    counts = weighted_means(np.ones_like(w), w, place)[1]
    band = [_rms(weighted_means(values, w, place)[0], counts) for values in off]
    columns = [*band, *(_rms(values, w) for values in off[1:3]), motion_errors]
    rows = np.stack(columns, axis=1).tolist()
    for j, (name, unit) in enumerate(zip(force_names(m), force_units(m), strict=True)):
        if counts[:, j].any():
            yield ForceResidual(name, unit, part, posed.log, *rows[j])


def _rms(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    total = np.maximum(weights.sum(axis=0), np.finfo(float).tiny)
    return np.sqrt((weights * values**2).sum(axis=0) / total)
