"""Identification of the inertial parameters and drive terms of a robot from a motion and measured forces."""

from collections.abc import Sequence
from dataclasses import replace
from typing import get_args

import numpy as np

from jounce.core.errors import JounceError, check_choice, join_names, locate_errors, quote_value, warn
from jounce.core.progress import stage
from jounce.core.scalars import is_finite
from jounce.core.typing import ArrayLike, DriveTerm, DriveTerms, Equations
from jounce.engine.engine import Engine, R, with_mechanism
from jounce.identification.delays import pose_without_delays
from jounce.identification.filtered_balances import FILTERED_METHODS
from jounce.identification.force_warnings import force_warnings, unexplained_warnings
from jounce.identification.friction_search import with_friction_laws
from jounce.identification.least_squares_problem import (
    IdentificationProblem,
    join_problems,
    pose_problem,
    with_smoothing_velocity,
)
from jounce.identification.measured_logs import Logs, MeasuredLog, check_logs, twin_notes
from jounce.identification.physical_consistency import ConsistentParameters, fit_consistent_parameters
from jounce.identification.regression import Regression, fit_forces
from jounce.identification.result import Identification
from jounce.identification.result_tables import IdentifiedParameter, describe_logs, force_residuals, parameter_table
from jounce.identification.unmodelled_torques import find_torques
from jounce.model.drives import ALL_DRIVE_TERMS, AMOUNTS, LOAD_FRICTION, select_terms
from jounce.model.mechanism import Mechanism
from jounce.model.parameters import with_inertial_parameters
from jounce.model.positions import check_single_screws

FittedLogs = tuple[list[IdentificationProblem], Regression, list[list[str]]]  # warnings are of those that are fitted
MAX_SCATTER = 4.0  # chi^2 per degree of freedom: a log beyond it differs from others by two deviations or more
LOAD_ROUNDS = 3  # of fits with friction by the load, which leave c of 0.05 off by 1e-6, of 0.2 by 3e-4
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
    method: Equations,
    test: int | str | Sequence[int | str],
    delay: float | None,
) -> Identification[R]:
    """Identify a robot from motions and measured forces, see `Robot.identify`."""
    check_choice("method", method, get_args(Equations))
    terms = select_terms(drives)
    model = with_smoothing_velocity(robot, terms, eps, method)
    if not is_finite(prior) or not prior >= MIN_PRIOR:
        raise JounceError(
            f"prior is {quote_value(prior)}; expected a relative standard deviation, {MIN_PRIOR:g} or more"
        )
    check_single_screws(model.mechanism, "identify()")
    measured = {"forces": forces, "t": t, "weights": weights, "deviations": deviations}
    logs, known = check_logs(model.mechanism, motions, measured, span, test), deviations is not None
    fits = list[FittedLogs]()

    def pose(logs: Sequence[MeasuredLog]) -> list[IdentificationProblem]:
        posed = pose_logs(model, logs, terms, eps is not None, known, band, method)
        fits.append(fit_with_loads(posed, method, LOAD_FRICTION in terms, known))
        return fits[-1][0]

    posed, late, delayed = pose_without_delays(pose, logs, delay, method not in FILTERED_METHODS)
    _, solution, hidden = fits[-1]
    joined = join_problems(fitted := [one for one in posed if not one.tests])[0]
    table = parameter_table(joined, solution)
    warned = _name_logs(posed, [[*force_warnings(one), *said] for one, said in zip(posed, delayed, strict=True)])
    differ = _difference_notes([one.log for one in fitted], solution.scatter)
    notes = [*twin_notes(logs), *warned, *differ, *_undetermined_notes(table, solution.rank)]
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
    notes += (left := [*_name_logs(fitted, hidden), *_name_logs(posed, unexplained)])
    for text in left:
        warn(text)
    described = describe_logs(posed)
    spans = [of.span for of in described if of.span]
    return Identification(
        robot=with_mechanism(robot, _with_found(m, joined.terms, found)),
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
        delay=max(late, key=abs),
        t=np.concatenate([one.given.t for one in posed]),
        measured=np.concatenate([np.where(one.given.weights > 0, one.given.forces, np.nan) for one in posed]),
        model=np.concatenate([one.model for one in posed]),
        predicted=np.concatenate([forces[0] for forces in predicted]),
        notes=(*notes, *_body_notes(found)),
        logs=described,
    )


def fit_with_loads(posed: list[IdentificationProblem], method: Equations, sought: bool, known: bool) -> FittedLogs:
    """Fit logs with friction by the load where residuals show it, if it is sought: by the loads of the last fit."""
    loaded, x = np.zeros(len(posed[0].robot.mechanism.joints), dtype=bool), np.zeros(0)
    for _ in range(1 + LOAD_ROUNDS):
        posed = [one.with_load_friction(x, loaded) for one in posed] if loaded.any() else posed
        fitted = [one for one in posed if not one.tests]
        joined, cells = join_problems(fitted)
        solution = fit_forces(joined.cells, joined.columns, joined.errors, known, cells)
        parts = [replace(solution, weights=solution.weights[part]) for part in cells]
        shown = [find_torques(one, part, method) for one, part in zip(fitted, parts, strict=True)]
        loaded, x = np.any([loaded, *(joints for joints, _ in shown)], axis=0) & sought, solution.x
        if not loaded.any():
            break
    return posed, solution, [notes for _, notes in shown]


def pose_logs(
    robot: Engine,
    logs: Sequence[MeasuredLog],
    terms: tuple[DriveTerm, ...],
    given_eps: bool,
    known: bool,
    band: float | None,
    method: Equations,
) -> list[IdentificationProblem]:
    """The problem of each log, of the robot with the friction laws that they show."""
    fitted = [(of.motion, of.samples) for of in logs if not of.tests]
    terms = tuple(term for term in terms if term != LOAD_FRICTION)
    robot, terms, sought, weighed = with_friction_laws(robot, fitted, terms, given_eps, known)
    total, others, posed = sum(np.count_nonzero(of.weights) for of in weighed), iter(weighed), []
    for of in logs:
        samples = of.samples if of.tests else next(others)
        share = np.count_nonzero(samples.weights) / total
        with locate_errors(of.name):
            one = pose_problem(robot, of.motion, terms, sought, of.given, of.used, samples, band, method, share)
        posed.append(replace(one, log=of.name, tests=of.tests))
    return posed


def _with_found(mechanism: Mechanism, terms: Sequence[DriveTerm], found: ConsistentParameters) -> Mechanism:
    """The mechanism with what was found; its drive terms act."""
    m = with_inertial_parameters(mechanism, found.parameters)
    values = {AMOUNTS[term]: x for term, x in found.drives.items()}
    acting = tuple(term for term in ALL_DRIVE_TERMS if term in {*m.acting, *terms})
    return replace(m, drives=replace(m.drives, **values), acting=acting)


def _undetermined_notes(table: Sequence[IdentifiedParameter], rank: int) -> list[str]:
    """What to know of parameters that the data do not determine."""
    unseen = [row.name for row in table if not row.seen]
    known = f"deviations exceed sizes (rank {rank} of {len(table)})"
    cure = "a faster or longer motion of more joints determines them"
    return [f"the data do not determine {join_names(unseen)}: {known}; {cure}"] if unseen else []


def _name_logs(posed: Sequence[IdentificationProblem], notes: Sequence[Sequence[str]]) -> list[str]:
    """The notes on each log, which name it if there are several."""
    return [f"{one.log}: {text}" if one.log else text for one, of in zip(posed, notes, strict=True) for text in of]


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
