"""The fit of a robot to its logs, by rounds: each round finds what the next one must know.

Residuals of a fit show friction that grows with the load, which needs the loads of that fit; the band up to which
torques confirm the motions, which are then smoothed to it; and rotors that the model lacks, which are then sought at
all joints. Each is known only once the rest is fitted, so that they come by turns: in each fit the loads, between fits
the bands, then the rotors, then the bands once more.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from jounce.core.errors import locate_errors
from jounce.core.typing import DriveTerm
from jounce.engine.engine import Engine
from jounce.identification.delays import pose_without_delays
from jounce.identification.friction_search import with_friction_laws
from jounce.identification.least_squares_problem import IdentificationProblem, join_problems, pose_problem
from jounce.identification.measured_logs import MeasuredLog
from jounce.identification.regression import Regression, fit_forces
from jounce.identification.torque_bands import ConfirmedBand, find_band
from jounce.identification.unmodelled_torques import ShownTorques, find_torques
from jounce.model.drives import ALL_DRIVE_TERMS, LOAD_FRICTION
from jounce.motion.resmoothing import smooth_motion_to

_LoadedFit = tuple[list[IdentificationProblem], Regression, list[ShownTorques]]  # with `LogFit.shown`

LOAD_ROUNDS = 3  # of fits with friction by the load, which leave c of 0.05 off by 1e-6, of 0.2 by 3e-4
BAND_ROUNDS = 2  # of bands: the first is found with parameters that are wrong where the motion is


@dataclass(frozen=True, eq=False)
class FitOptions:
    """What a caller states of a fit."""

    robot: Engine  # the model
    terms: tuple[DriveTerm, ...]  # drive terms that are sought
    known: bool = False  # whether weights are inverse variances
    given_eps: bool = False  # whether smoothing velocities of friction are stated
    band: float | None = None  # highest frequency of the forces, Hz
    delay: float | None = None  # of forces after positions, s


@dataclass(frozen=True, eq=False)
class LogFit:
    """A fit of logs without delays."""

    posed: list[IdentificationProblem]
    solution: Regression
    shown: list[ShownTorques]  # torques that no parameter holds, of the logs that are fitted
    late: list[float]  # delays that are taken out, s
    delayed: list[list[str]]  # what is said of them
    confirmed: tuple[ConfirmedBand | None, ...]  # of each log that is smoothed to what torques confirm
    notes: tuple[str, ...] = ()  # what rounds before this one found


def fit_in_rounds(options: FitOptions, logs: Sequence[MeasuredLog]) -> LogFit:
    """Fit logs whose motions are smoothed to what torques confirm, with rotors where residuals show them."""
    fit = _fit_confirmed(options, logs)
    rotors = [text for of in fit.shown for text in of.rotors]
    if not rotors:
        return fit
    terms = tuple(term for term in ALL_DRIVE_TERMS if term in {*options.terms, "armature"})
    fit = _fit_confirmed(replace(options, terms=terms), logs)
    what = ", ".join(dict.fromkeys(rotors))
    note = f"residuals show what the model lacks, {what}: the armature of all joints is identified too"
    return replace(fit, notes=(note,))


def _fit_confirmed(options: FitOptions, logs: Sequence[MeasuredLog]) -> LogFit:
    """Fit logs whose motions are smoothed to the bands that torques confirm, where that fit leaves less unexplained."""
    fit = fit_logs(options, logs)
    found = [find_band(one, fit.solution.x) for one in fit.posed]
    for _ in range(BAND_ROUNDS):
        if not any(of is not None and of.is_lower for of in found):
            break
        # smooth each log to what torques confirm now, where it is less than in the round before
        confirmed = tuple(
            of if of is not None and of.is_lower else own for of, own in zip(found, fit.confirmed, strict=True)
        )
        better = fit_logs(options, [_smoothed(of, band) for of, band in zip(logs, confirmed, strict=True)])
        again = [find_band(one, better.solution.x) for one in better.posed]
        if not all(map(_explains_more, again, found)):
            break
        fit, found = replace(better, confirmed=confirmed), again
    return fit


def _smoothed(log: MeasuredLog, band: ConfirmedBand | None) -> MeasuredLog:
    return log if band is None else replace(log, motion=smooth_motion_to(log.motion, band.frequency))


def _explains_more(later: ConfirmedBand | None, earlier: ConfirmedBand | None) -> bool:
    """Whether a fit explains accelerations better where they are smoothed: parameters near 0 of a free swing do not."""
    if earlier is None or not earlier.is_lower:
        return True
    return later is not None and later.total < earlier.total


def fit_logs(options: FitOptions, logs: Sequence[MeasuredLog]) -> LogFit:
    """Fit logs without the delays of their forces."""
    fits = list[_LoadedFit]()

    def pose(logs: Sequence[MeasuredLog]) -> list[IdentificationProblem]:
        fits.append(_fit_with_loads(options, _pose_logs(options, logs)))
        return fits[-1][0]

    posed, late, delayed = pose_without_delays(pose, logs, options.delay)
    _, solution, shown = fits[-1]
    return LogFit(posed, solution, shown, late, delayed, (None,) * len(posed))


def _fit_with_loads(options: FitOptions, posed: list[IdentificationProblem]) -> _LoadedFit:
    """Fit logs with friction by the load where residuals show it, if it is sought: by the loads of the last fit."""
    loaded, x = np.zeros(len(posed[0].robot.mechanism.joints), dtype=bool), np.zeros(0)
    for _ in range(1 + LOAD_ROUNDS):
        posed = [one.with_load_friction(x, loaded) for one in posed] if loaded.any() else posed
        fitted = [one for one in posed if not one.tests]
        joined, cells = join_problems(fitted)
        solution = fit_forces(joined.cells, joined.columns, joined.errors, options.known, cells, joined.offsets)
        parts = [replace(solution, weights=solution.weights[part]) for part in cells]
        shown = [find_torques(one, part) for one, part in zip(fitted, parts, strict=True)]
        sought = LOAD_FRICTION in options.terms
        loaded, x = np.any([loaded, *(of.loaded for of in shown)], axis=0) & sought, solution.x
        if not loaded.any():
            break
    return posed, solution, shown


def _pose_logs(options: FitOptions, logs: Sequence[MeasuredLog]) -> list[IdentificationProblem]:
    """The problem of each log, of the robot with the friction laws that they show."""
    fitted = [(of.motion, of.samples) for of in logs if not of.tests]
    terms = tuple(term for term in options.terms if term != LOAD_FRICTION)
    robot, terms, sought, weighed = with_friction_laws(options.robot, fitted, terms, options.given_eps, options.known)
    total, others, posed = sum(np.count_nonzero(of.weights) for of in weighed), iter(weighed), []
    for of in logs:
        samples = of.samples if of.tests else next(others)
        share = np.count_nonzero(samples.weights) / total
        with locate_errors(of.name):
            one = pose_problem(robot, of.motion, terms, sought, of.given, of.used, samples, options.band, share)
        posed.append(replace(one, log=of.name, tests=of.tests))
    return posed
