"""Identify inertial parameters and drive terms of a robot from measured forces.

`identify` is the door. It checks the logs of a caller, fits them by rounds (`fit_in_rounds`), asks for bodies that can
exist nearest to what the fit says (`fit_consistent_parameters`), compares the forces of that robot with measured ones,
and collects on the way what a user should know of the logs, as notes of the `Identification` and as warnings.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import cast

import numpy as np

from jounce.core import cures, errors, scalars
from jounce.core.errors import JounceError, join_names, quote_value, warn
from jounce.core.progress import stage
from jounce.core.typing import ArrayLike, DriveTerm, DriveTerms
from jounce.engine.engine import Engine, R, with_mechanism
from jounce.identification.fits import ConfirmedBand, fit_in_rounds
from jounce.identification.force_checks import force_warnings, free_swing_warnings, unexplained_warnings
from jounce.identification.least_squares_problem import (
    FitOptions,
    IdentificationProblem,
    join_problems,
    with_smoothing_velocity,
)
from jounce.identification.measurements import Logs, check_logs, twin_notes
from jounce.identification.motion_errors import offset_notes
from jounce.identification.physical_consistency import ConsistentParameters, fit_consistent_parameters
from jounce.identification.regression import Regression
from jounce.identification.result import (
    Identification,
    IdentifiedParameter,
    describe_calibration,
    describe_logs,
    force_residuals,
    parameter_table,
)
from jounce.identification.static_poses import fit_poses
from jounce.model import body_parameters, drive_trains, positions
from jounce.model.mechanism import Mechanism
from jounce.motion.poses import Poses

MAX_SCATTER = 4.0  # chi^2 per degree of freedom: a log beyond it differs from others by two deviations or more
MIN_PRIOR = 1e-9  # relative deviation: no model is better, and squares of smaller ones overflow
LogValues = ArrayLike | Sequence[ArrayLike | None] | None  # one for all logs, or a list of one per log


@dataclass(frozen=True, eq=False)
class IdentifyOptions:
    """The options of `Robot.identify`.

    Drive terms and the prior are checked here, what is measured with the logs, the band and the delay with the times of
    the samples.
    """

    forces: LogValues = None
    t: LogValues = None
    weights: LogValues = None
    deviations: LogValues = None
    drives: DriveTerms = ()
    eps: float | None = None
    span: tuple[float, float] | None = None
    band: float | None = None
    prior: float = 0.3
    test: int | str | Sequence[int | str] = ()
    delay: float | None = None
    as_given: bool = False

    terms: tuple[DriveTerm, ...] = field(init=False)  # the drive terms that are sought

    def __post_init__(self) -> None:
        object.__setattr__(self, "terms", drive_trains.select_terms(self.drives))
        if not scalars.is_finite(self.prior) or not self.prior >= MIN_PRIOR:
            expected = f"expected a relative standard deviation, {MIN_PRIOR:g} or more"
            raise JounceError(f"prior is {quote_value(self.prior)}; {expected}")

    def refuse_times(self) -> None:
        """Raise `JounceError` of options that poses at rest have not."""
        has_test = not isinstance(self.test, list | tuple) or len(self.test) > 0
        given = {"forces": self.forces, "t": self.t, "eps": self.eps, "span": self.span, "band": self.band,
                 "delay": self.delay, "test": self.test if has_test else None}  # fmt: skip
        for name, value in given.items():
            if value is not None:
                raise JounceError(
                    f"{cures.option_name(name)} is for logs, and poses at rest have no times; leave it out"
                )

    @property
    def measured(self) -> dict[str, LogValues]:
        """The name of what is measured along the logs."""
        return {"forces": self.forces, "t": self.t, "weights": self.weights, "deviations": self.deviations}


@stage("identification")
def identify(robot: R, motions: Logs | Poses, options: IdentifyOptions) -> Identification[R]:
    """Identify a robot from motions or poses and measured forces, see `Robot.identify`."""
    model = with_smoothing_velocity(robot, options.terms, options.eps)
    positions.check_single_screws(model.mechanism, "identify()")
    if isinstance(motions, Poses):
        return _identify_at_rest(robot, model, motions, options)
    given = motions.values() if isinstance(motions, Mapping) else errors.as_list(motions)
    if any(isinstance(log, Poses) for log in given):
        raise JounceError("poses at rest are among several logs; expected them alone: join them in one jounce.Poses")
    logs = check_logs(model.mechanism, motions, options.measured, options.span, options.test)
    # The fit: parameters with deviations, as the data alone determine them.
    known, given_eps = options.deviations is not None, options.eps is not None
    fit_options = FitOptions(model, options.terms, known, given_eps, options.band, options.delay, options.as_given)
    fit = fit_in_rounds(fit_options, logs)
    posed, solution = fit.posed, fit.solution.with_offsets()
    fitted = [problem for problem in posed if not problem.tests]
    joined = join_problems(fitted)[0]
    table = parameter_table(joined, solution)
    # Notes and warnings of all that led to the fit.
    forces_and_delays = [
        [*force_warnings(problem), *delay_notes] for problem, delay_notes in zip(posed, fit.delayed, strict=True)
    ]
    unmodelled = any(len(torques.notes) > 0 for torques in fit.shown)
    notes = [
        *twin_notes(logs),
        *_name_logs(posed, [_band_notes(band) for band in fit.confirmed]),
        *fit.notes,
        *_name_logs(posed, forces_and_delays),
        *free_swing_warnings(joined),
        *_difference_notes([problem.log for problem in fitted], solution.scatter),
        *_undetermined_notes(table, solution.rank, unmodelled),
    ]
    for text in notes:
        warn(text)
    # The robot: bodies that can exist, nearest to the estimate.
    estimate, m = joined.corrected_parameters(solution.x), joined.robot.mechanism
    consistent = _fit_bodies(joined, solution, options.prior)
    # Its forces, next to those of least squares alone: (2, N, nv) of each log, those that only test included.
    drives = consistent.values[joined.base.count :]
    predicted = [problem.predict(consistent.parameters, drives, solution.x) for problem in posed]
    rows = [force_residuals(problem, Q, solution.motion_errors) for problem, Q in zip(posed, predicted, strict=True)]
    sought_parameters = estimate[joined.places]
    unexplained = [
        unexplained_warnings(problem, rows_of_log, sought_parameters)
        for problem, rows_of_log in zip(posed, rows, strict=True)
    ]
    residual_notes = [*_name_logs(fitted, [torques.notes for torques in fit.shown]), *_name_logs(posed, unexplained)]
    if any(torques.gains for torques in fit.shown):
        residual_notes.append(f"factors of torques: {describe_calibration()}")
    for text in residual_notes:
        warn(text)
    names = [row.name for row in table]
    notes += [*residual_notes, *offset_notes(names, m.coordinates, fit.solution.offset_shares)]
    # Sizes of the result: logs that only test have no span.
    described = describe_logs(posed)
    used_logs = [log for log in described if log.span is not None]
    spans = [log.span for log in described if log.span is not None]
    bands = tuple(None if band is None else band.frequency for band in fit.confirmed)
    lowest_band = min((band for band in bands if band is not None), default=None)
    identified = replace(_with_parameters(m, joined.terms, consistent), confirmed_band=lowest_band)
    return Identification(
        robot=with_mechanism(robot, identified),
        table=table,
        covariance=solution.covariance,
        rank=solution.rank,
        condition=solution.condition,
        deviations=solution.deviations,
        residuals=tuple(row for rows_of_log in rows for row in rows_of_log),
        span=(min(first for first, _ in spans), max(last for _, last in spans)),
        band=max(log.band for log in used_logs),
        cell=min(log.cell for log in used_logs),
        samples=sum(log.samples for log in described),
        cells=sum(log.cells for log in described),
        delay=max(fit.late, key=abs),
        t=np.concatenate([problem.measurements.t for problem in posed]),
        measured=np.concatenate([
            np.where(problem.measurements.weights > 0, problem.measurements.forces, np.nan) for problem in posed
        ]),
        model=np.concatenate([problem.model for problem in posed]),
        predicted=np.concatenate([forces[0] for forces in predicted]),
        notes=(*notes, *_body_notes(consistent)),
        logs=described,
        confirmed=bands,
    )  # fmt: skip


def _identify_at_rest(robot: R, model: Engine, poses: Poses, options: IdentifyOptions) -> Identification[R]:
    """Identify a robot from poses at rest."""
    options.refuse_times()
    known = options.deviations is not None
    weights, deviations = cast("ArrayLike | None", options.weights), cast("ArrayLike | None", options.deviations)
    fit = fit_poses(FitOptions(model, options.terms, known), poses, weights, deviations)
    posed, solution, determined = fit.without_nuisance()
    # Rows of what poses do not determine would hold numbers of the model: they are named instead.
    table = tuple(
        row for row, is_determined in zip(parameter_table(posed, solution), determined, strict=True) if is_determined
    )
    _check_any_seen(table, poses)
    warnings = [*fit.warnings, *fit.unseen_warnings([row.name for row in table if not row.seen])]
    # The robot: bodies that can exist, nearest to the estimate, with the model's own where rest says nothing.
    m = posed.robot.mechanism
    consistent = _fit_bodies(posed, solution, options.prior)
    drives = consistent.values[posed.base.count :]
    predicted = posed.predict(consistent.parameters, drives, solution.x)
    rows = force_residuals(posed, predicted, solution.motion_errors)
    warnings += fit.unexplained_warnings(rows, posed.corrected_parameters(solution.x)[posed.places])
    for text in warnings:
        warn(text)
    count = len(posed.samples.t)
    return Identification(
        robot=with_mechanism(robot, _with_parameters(m, posed.terms, consistent)),
        table=table,
        covariance=solution.covariance[np.ix_(determined, determined)],
        rank=solution.rank,
        condition=solution.condition,
        deviations=solution.deviations,
        residuals=rows,
        span=(0.0, float(count - 1)),
        band=np.nan,
        cell=np.nan,
        samples=count,
        cells=count,
        delay=0.0,
        t=posed.samples.t,
        measured=np.where(posed.samples.weights > 0, posed.samples.forces, np.nan),
        model=posed.model,
        predicted=predicted[0],
        notes=(*poses.notes, *fit.notes, *warnings, *_body_notes(consistent)),
        logs=describe_logs([posed]),
        confirmed=(None,),
        undetermined=fit.undetermined,
    )  # fmt: skip


def _check_any_seen(table: Sequence[IdentifiedParameter], poses: Poses) -> None:
    """Raise `JounceError` of poses that determine no mass or first moment."""
    if any(row.seen for row in table if "kg" in row.unit):
        return
    spread = np.ptp(poses.q, axis=0).max()
    came = f"{len(poses)} poses determine no inertial parameter, all deviations exceed sizes"
    raise JounceError(f"{came}: joints differ by {spread:.2g} rad or m at most; expected poses that differ more")


def _fit_bodies(posed: IdentificationProblem, solution: Regression, prior: float) -> ConsistentParameters:
    """Fit bodies that can exist, nearest to an estimate and the model."""
    # The information (K, K) is of all base and drive parameters, and 0 for those that are not sought.
    estimate = posed.corrected_parameters(solution.x)
    information = np.zeros(2 * estimate.shape)
    information[np.ix_(posed.places, posed.places)] = solution.information
    weight = float(prior) ** -2
    return fit_consistent_parameters(
        posed.robot.mechanism, posed.base, information, estimate, posed.terms, weight=weight
    )


def _with_parameters(mechanism: Mechanism, terms: Sequence[DriveTerm], fitted: ConsistentParameters) -> Mechanism:
    """Return the mechanism with fitted parameters; its drive terms act."""
    m = body_parameters.with_inertial_parameters(mechanism, fitted.parameters)
    values = {drive_trains.AMOUNTS[term]: x for term, x in fitted.drives.items()}
    acting = tuple(term for term in drive_trains.ALL_DRIVE_TERMS if term in {*m.acting, *terms})
    return replace(m, drives=replace(m.drives, **values), acting=acting)


def _undetermined_notes(table: Sequence[IdentifiedParameter], rank: int, unmodelled: bool) -> list[str]:
    """Name the parameters that the data do not determine, with a cure.

    Residuals may show unmodelled torques.
    """
    undetermined = [row.name for row in table if not row.seen]
    if len(undetermined) == 0:
        return []
    reason = f"deviations exceed sizes (rank {rank} of {len(table)})"
    cure = "a faster or longer motion of more joints determines them"
    if unmodelled:
        cure = "torques that no parameter holds make deviations large: see what residuals show"
    return [f"the data do not determine {join_names(undetermined)}: {reason}; {cure}"]


def _name_logs(posed: Sequence[IdentificationProblem], notes: Sequence[Sequence[str]]) -> list[str]:
    """Return the notes on each log, with names of several."""
    return [
        f"{problem.log}: {text}" if problem.log != "" else text
        for problem, notes_of_log in zip(posed, notes, strict=True)
        for text in notes_of_log
    ]


def _band_notes(band: ConfirmedBand | None) -> list[str]:
    """Return notes on a confirmed band, and on play at reversals."""
    if band is None:
        return []
    note = f"torques confirm the positions up to {band.frequency:.3g} Hz; smoothed to that"
    if len(band.turning) > 0:
        note += f"; encoders of {join_names(band.turning)} move as links do not where they turn back, as with play"
    return [note]


def _difference_notes(names: Sequence[str], scatter: np.ndarray) -> list[str]:
    """Name logs that differ from others by more than their noise explains."""
    differing = [f"{name} ({x:.2g})" for name, x in zip(names, scatter, strict=True) if x > MAX_SCATTER]
    if len(names) < 2 or len(differing) == 0:
        return []
    why = f"chi^2 per degree of freedom of {join_names(differing)}, and deviations grow with it"
    return [f"logs differ by more than their noise: {why}; expected logs of one robot, in one state"]


def _body_notes(fitted: ConsistentParameters) -> list[str]:
    """Name bodies without mass, and flat or impossible ones that were changed."""
    kinds = {"have no mass, and keep none": fitted.massless, "were thin, and got an inside": fitted.thickened}
    return [f"bodies that {what}: {join_names(bodies)}" for what, bodies in kinds.items() if len(bodies) > 0]
