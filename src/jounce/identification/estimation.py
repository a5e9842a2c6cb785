"""Identification of the inertial parameters and drive terms of a robot from a motion and measured forces."""

from collections.abc import Sequence
from dataclasses import replace
from typing import get_args

import numpy as np

from jounce.core.errors import JounceError, check_choice, join_names, quote_value, warn
from jounce.core.scalars import asarray, is_finite
from jounce.core.typing import ArrayLike, DriveTerm, DriveTerms, Equations
from jounce.engine.along import check_motion
from jounce.engine.engine import R, with_mechanism
from jounce.identification.force_warnings import force_warnings, unexplained_warnings
from jounce.identification.friction_search import with_friction_laws
from jounce.identification.least_squares_problem import pose_problem, with_smoothing_velocity
from jounce.identification.measurements import check_measurements
from jounce.identification.physical_consistency import ConsistentParameters, fit_consistent_parameters
from jounce.identification.regression import fit_forces
from jounce.identification.result import Identification
from jounce.identification.result_tables import IdentifiedParameter, force_residuals, parameter_table
from jounce.identification.unmodelled_torques import unmodelled_warnings
from jounce.model.drives import AMOUNTS, DRIVE_TERMS, select_terms
from jounce.model.parameters import with_inertial_parameters
from jounce.model.positions import check_single_screws
from jounce.motion.motion import Motion

MIN_PRIOR = 1e-9  # relative deviation: no model is better, and squares of smaller ones overflow


def identify(
    robot: R,
    motion: Motion,
    forces: ArrayLike | None,
    t: ArrayLike | None,
    drives: DriveTerms,
    eps: float | None,
    span: tuple[float, float] | None,
    band: float | None,
    weights: ArrayLike | None,
    deviations: ArrayLike | None,
    prior: float,
    method: Equations,
) -> Identification[R]:
    """Identify a robot from a motion and measured forces, see `Robot.identify`."""
    check_choice("method", method, get_args(Equations))
    terms = select_terms(drives)
    model = with_smoothing_velocity(robot, terms, eps)
    if not is_finite(prior) or not prior >= MIN_PRIOR:
        raise JounceError(
            f"prior is {quote_value(prior)}; expected a relative standard deviation, {MIN_PRIOR:g} or more"
        )
    check_single_screws(model.mechanism, "identify()")
    path = check_motion(model.mechanism, motion)
    given = check_measurements(model.mechanism, path, forces, t, weights, deviations)
    used = _select_samples(span, given.t)
    known = deviations is not None
    model, terms, sought, samples = with_friction_laws(model, path, terms, given.part(used), eps is not None, known)
    posed = pose_problem(model, path, terms, sought, given, used, samples, band, method)
    solution = fit_forces(posed.cells, posed.columns, posed.errors, known)
    table = parameter_table(posed, solution)
    notes = [*force_warnings(posed, method), *_undetermined_notes(table, solution.rank)]
    for text in notes:
        warn(text)
    estimate, information = posed.model_parameters, np.zeros(2 * posed.model_parameters.shape)
    estimate[posed.places] += solution.x
    information[np.ix_(posed.places, posed.places)] = solution.information
    weight = float(prior) ** -2
    found = fit_consistent_parameters(model.mechanism, posed.base, information, estimate, terms, weight=weight)
    predicted = posed.predict(found.parameters, found.values[posed.base.count :], solution.x)
    rows, times = force_residuals(posed, predicted, solution.motion_errors), given.t[posed.used]
    left = unmodelled_warnings(posed, solution, method) + unexplained_warnings(posed, rows, estimate[posed.places])
    for text in left:
        warn(text)
    return Identification(
        robot=_build_robot(model, terms, found),
        table=table,
        covariance=solution.covariance,
        rank=solution.rank,
        condition=solution.condition,
        deviations=solution.deviations,
        residuals=rows,
        span=(float(times[0]), float(times[-1])),
        band=posed.band,
        cell=posed.width,
        samples=len(times),
        cells=len(posed.cells.off),
        t=given.t,
        measured=np.where(given.weights > 0, given.forces, np.nan),
        model=posed.model,
        predicted=predicted[0],
        notes=(*notes, *left, *_body_notes(found)),
    )


def _select_samples(span: tuple[float, float] | None, t: np.ndarray) -> np.ndarray:
    if span is None:
        return np.ones(len(t), dtype=bool)
    times = np.asarray(asarray(span, "span"))
    if times.shape != (2,) or times.dtype.kind != "f":
        raise JounceError(f"span is {quote_value(span)}; expected two times in s")
    first, last = times
    inside = (t >= first) & (t <= last)
    if not inside.any():
        raise JounceError(
            f"span is {quote_value(span)}; expected times from {t[0]:.6g} to {t[-1]:.6g} s, which forces have"
        )
    return inside


def _build_robot(robot: R, terms: Sequence[DriveTerm], found: ConsistentParameters) -> R:
    """The robot with what was found; its drive terms act."""
    m = with_inertial_parameters(robot.mechanism, found.parameters)
    values = {AMOUNTS[term]: x for term, x in found.drives.items()}
    acting = tuple(term for term in DRIVE_TERMS if term in {*m.acting, *terms})
    return with_mechanism(robot, replace(m, drives=replace(m.drives, **values), acting=acting))


def _undetermined_notes(table: Sequence[IdentifiedParameter], rank: int) -> list[str]:
    """What to know of parameters that the data do not determine."""
    unseen = [row.name for row in table if not row.seen]
    known = f"deviations exceed sizes (rank {rank} of {len(table)})"
    cure = "a faster or longer motion of more joints determines them"
    return [f"the data do not determine {join_names(unseen)}: {known}; {cure}"] if unseen else []


def _body_notes(found: ConsistentParameters) -> list[str]:
    said = {"have no mass, and keep none": found.massless, "were thin, and got an inside": found.thickened}
    return [f"bodies that {what}: {join_names(which)}" for what, which in said.items() if which]
