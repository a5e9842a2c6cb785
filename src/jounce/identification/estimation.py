"""Identify the inertial parameters and drive terms of a robot from measured forces.

`identify` is the door. It checks the logs of a caller, fits them by rounds (`fit_in_rounds`), asks for bodies that can
exist nearest to what the fit says (`fit_consistent_parameters`), compares the forces of that robot with measured ones,
and collects on the way what a user should know of the logs, as notes of the `Identification` and as warnings.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from jounce.core import scalars
from jounce.core.errors import JounceError, join_names, quote_value, warn
from jounce.core.progress import stage
from jounce.core.typing import ArrayLike, DriveTerm, DriveTerms
from jounce.engine.engine import R, with_mechanism
from jounce.identification.fits import ConfirmedBand, FitOptions, fit_in_rounds
from jounce.identification.force_checks import force_warnings, free_swing_warnings, unexplained_warnings
from jounce.identification.least_squares_problem import (
    IdentificationProblem,
    join_problems,
    with_smoothing_velocity,
)
from jounce.identification.measurements import Logs, check_logs, twin_notes
from jounce.identification.motion_errors import offset_notes
from jounce.identification.physical_consistency import ConsistentParameters, fit_consistent_parameters
from jounce.identification.result import (
    Identification,
    IdentifiedParameter,
    describe_calibration,
    describe_logs,
    force_residuals,
    parameter_table,
)
from jounce.model import body_parameters, drive_trains, positions
from jounce.model.mechanism import Mechanism

MAX_SCATTER = 4.0  # chi^2 per degree of freedom: a log beyond it differs from others by two deviations or more
MIN_PRIOR = 1e-9  # relative deviation: no model is better, and squares of smaller ones overflow


@stage("identification")
def identify(
    robot: R,
    motions: Logs,
    forces: ArrayLike | Sequence[ArrayLike | None] | None,
    t: ArrayLike | Sequence[ArrayLike | None] | None,
    drives: DriveTerms,
    eps: float | None,
    span: tuple[float, float] | None,
    band: float | None,
    weights: ArrayLike | Sequence[ArrayLike | None] | None,
    deviations: ArrayLike | Sequence[ArrayLike | None] | None,
    prior: float,
    test: int | str | Sequence[int | str],
    delay: float | None,
) -> Identification[R]:
    """Identify a robot from motions and measured forces, see `Robot.identify`."""
    terms = drive_trains.select_terms(drives)
    model = with_smoothing_velocity(robot, terms, eps)
    if not scalars.is_finite(prior) or not prior >= MIN_PRIOR:
        raise JounceError(
            f"prior is {quote_value(prior)}; expected a relative standard deviation, {MIN_PRIOR:g} or more"
        )
    positions.check_single_screws(model.mechanism, "identify()")
    measured = {"forces": forces, "t": t, "weights": weights, "deviations": deviations}
    logs, known = check_logs(model.mechanism, motions, measured, span, test), deviations is not None
    fit = fit_in_rounds(FitOptions(model, terms, known, eps is not None, band, delay), logs)
    posed, solution, offset_shares = fit.posed, fit.solution.with_offsets(), fit.solution.offset_shares
    joined = join_problems(fitted := [one for one in posed if not one.tests])[0]
    table = parameter_table(joined, solution)
    warned = _name_logs(posed, [[*force_warnings(one), *said] for one, said in zip(posed, fit.delayed, strict=True)])
    differ = _difference_notes([one.log for one in fitted], solution.scatter)
    rounds = [*_name_logs(posed, [_band_notes(band) for band in fit.confirmed]), *fit.notes]
    notes = [
        *twin_notes(logs),
        *rounds,
        *warned,
        *free_swing_warnings(joined),
        *differ,
        *_undetermined_notes(table, solution.rank, any(of.notes for of in fit.shown)),
    ]
    for text in notes:
        warn(text)
    estimate = joined.corrected_parameters(solution.x)
    information, x = np.zeros(2 * estimate.shape), estimate[joined.places]
    information[np.ix_(joined.places, joined.places)] = solution.information
    weight = float(prior) ** -2
    m = joined.robot.mechanism
    found = fit_consistent_parameters(m, joined.base, information, estimate, joined.terms, weight=weight)
    predicted = [one.predict(found.parameters, found.values[one.base.count :], solution.x) for one in posed]
    rows = [force_residuals(one, Q, solution.motion_errors) for one, Q in zip(posed, predicted, strict=True)]
    unexplained = [unexplained_warnings(one, of_log, x) for one, of_log in zip(posed, rows, strict=True)]
    left = [*_name_logs(fitted, [of.notes for of in fit.shown]), *_name_logs(posed, unexplained)]
    if any(of.gains for of in fit.shown):
        left.append(f"factors of torques: {describe_calibration()}")
    notes += left
    for text in left:
        warn(text)
    described, bands = describe_logs(posed), [band.frequency for band in fit.confirmed if band is not None]
    spans = [of.span for of in described if of.span]
    return Identification(
        robot=with_mechanism(
            robot, replace(_with_found(m, joined.terms, found), confirmed_band=min(bands, default=None))
        ),
        table=table,
        covariance=solution.covariance,
        rank=solution.rank,
        condition=solution.condition,
        deviations=solution.deviations,
        residuals=tuple(row for of_log in rows for row in of_log),
        span=(min(first for first, _ in spans), max(last for _, last in spans)),
        band=max(of.band for of in described if of.span),
        cell=min(of.cell for of in described if of.span),
        samples=sum(of.samples for of in described),
        cells=sum(of.cells for of in described),
        delay=max(fit.late, key=abs),
        t=np.concatenate([one.given.t for one in posed]),
        measured=np.concatenate([np.where(one.given.weights > 0, one.given.forces, np.nan) for one in posed]),
        model=np.concatenate([one.model for one in posed]),
        predicted=np.concatenate([forces[0] for forces in predicted]),
        notes=(*notes, *offset_notes([row.name for row in table], m.coordinates, offset_shares), *_body_notes(found)),
        logs=described,
        confirmed=tuple(None if band is None else band.frequency for band in fit.confirmed),
    )


def _with_found(mechanism: Mechanism, terms: Sequence[DriveTerm], found: ConsistentParameters) -> Mechanism:
    """The mechanism with what was found; its drive terms act."""
    m = body_parameters.with_inertial_parameters(mechanism, found.parameters)
    values = {drive_trains.AMOUNTS[term]: x for term, x in found.drives.items()}
    acting = tuple(term for term in drive_trains.ALL_DRIVE_TERMS if term in {*m.acting, *terms})
    return replace(m, drives=replace(m.drives, **values), acting=acting)


def _undetermined_notes(table: Sequence[IdentifiedParameter], rank: int, unmodelled: bool) -> list[str]:
    """What to know of parameters that the data do not determine; residuals may show unmodelled torques."""
    unseen = [row.name for row in table if not row.seen]
    known = f"deviations exceed sizes (rank {rank} of {len(table)})"
    cure = "a faster or longer motion of more joints determines them"
    if unmodelled:
        cure = "torques that no parameter holds make deviations large: see what residuals show"
    return [f"the data do not determine {join_names(unseen)}: {known}; {cure}"] if unseen else []


def _name_logs(posed: Sequence[IdentificationProblem], notes: Sequence[Sequence[str]]) -> list[str]:
    """The notes on each log, which name it if there are several."""
    return [f"{one.log}: {text}" if one.log else text for one, of in zip(posed, notes, strict=True) for text in of]


def _band_notes(band: ConfirmedBand | None) -> list[str]:
    """What is said of a log that is smoothed to what torques confirm, and of joints that are off where they turn."""
    if band is None:
        return []
    note = f"torques confirm the positions up to {band.frequency:.3g} Hz; smoothed to that"
    if band.turning:
        note += f"; encoders of {join_names(band.turning)} move as links do not where they turn back, as with play"
    return [note]


def _difference_notes(names: Sequence[str], scatter: np.ndarray) -> list[str]:
    """What is said of logs that differ from others by more than their noise explains."""
    which = [f"{name} ({x:.2g})" for name, x in zip(names, scatter, strict=True) if x > MAX_SCATTER]
    if len(names) < 2 or not which:
        return []
    why = f"chi^2 per degree of freedom of {join_names(which)}, and deviations grow with it"
    return [f"logs differ by more than their noise: {why}; expected logs of one robot, in one state"]


def _body_notes(found: ConsistentParameters) -> list[str]:
    said = {"have no mass, and keep none": found.massless, "were thin, and got an inside": found.thickened}
    return [f"bodies that {what}: {join_names(which)}" for what, which in said.items() if which]
