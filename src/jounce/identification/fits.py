"""Fit a robot to its logs by rounds: each finds what the next must know.

Residuals of a fit show friction that grows with the load, which needs the loads of that fit; the band up to which
torques confirm the motions, which are then smoothed to it; and rotors that the model lacks, which are then sought at
all joints. Each is known only once the rest is fitted, so that they come by turns: in each fit the loads, between fits
the bands, then the rotors, then the bands once more. `fit_in_rounds` is the door, and `fit_logs` is one such fit, which
takes delays of forces out.

Each fit poses its logs again, and first asks with `with_friction_laws` how the friction of each joint depends on its
speed, and how much slow samples count, whose friction no model has. Coulomb friction is f tanh(v / eps): eps belongs to
the joint, and the forces are not linear in it. For each joint, some of them are tried, alone and with a term of
Stribeck, s tanh(v / eps) exp(-(v / vs)^2), with some vs: damping, friction and offset of the joint are refitted to what
the other parameters leave, and the least Bayesian information criterion n log(mean square) + k log(n) decides. n is the
number of independent residuals, as their correlation from one cell to the next has it; k are 2 parameters of a Stribeck
term, and 1 if eps is not the model's. Then all parameters are refitted; two sweeps do. Cells of time are at most 20 ms
wide, so that the turning of a joint shows.

Real friction near rest depends on more than the speed. Samples are sorted by the speed of their joint, and those of a
bin of which the mean square m of the residuals is above that of the fast ones, m0, get the weight (m0 / m)^2: less than
the m0 / m of noise with that variance, as such residuals are no noise, but all of one sign. Residuals and weights
follow from each other, by turns.

After a fit `find_band` asks up to which frequency torques confirm the motion of each log. Of each cell,
e = M(p)^-1 (tau - Y p) is the acceleration that torques ask for beyond the smoothed one (see
`jounce.motion.resmoothing`). Without torques of all joints, with a mass matrix that is not positive definite
(parameters that no robot has), of motions that are not made of samples, or whose bandwidth their user states, nothing
is said.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from jounce.core import errors
from jounce.core.typing import DriveTerm
from jounce.dynamics import base_parameters
from jounce.engine import along
from jounce.engine.engine import Engine, R, with_mechanism
from jounce.identification.averaging import average_forces, number_cells, weighted_means
from jounce.identification.delays import pose_without_delays
from jounce.identification.force_checks import ShownTorques, find_torques
from jounce.identification.least_squares_problem import IdentificationProblem, join_problems, pose_problem
from jounce.identification.measurements import MeasuredLog, Measurements
from jounce.identification.regression import MIN_RELATIVE_DEVIATION, Regression, fit_forces, informed_directions
from jounce.model import drive_trains
from jounce.motion import resmoothing
from jounce.motion.motion import Motion
from jounce.motion.resmoothing import BandErrors

LOAD_ROUNDS = 3  # of fits with friction by the load, which leave c of 0.05 off by 1e-6, of 0.2 by 3e-4
BAND_ROUNDS = 2  # of bands: the first is found with parameters that are wrong where the motion is
SMOOTHING_VELOCITIES = (0.1, 0.05, 0.03, 0.02, 0.01, 0.005, 0.002, 0.001)  # rad/s or m/s, after the model's own
STRIBECK_VELOCITIES = (0.03, 0.038, 0.048, 0.06, 0.076, 0.096, 0.12, 0.15, 0.2, 0.25)  # rad/s or m/s: of greased gears
COARSE_STEP = 3  # of the first, fourth, ... of these, which are tried with each eps; the others with the best one
SPEED_BINS = (0.01, 0.02, 0.04, 0.08, 0.15)  # rad/s or m/s, edges: friction above the last is the model's
FRICTION_TERMS = ("friction", "stribeck")
MAX_CELL_WIDTH = 0.02  # s: averages over wider cells hide how a joint turns round
MAX_CELLS = 4000  # of which the rows are held at once; of a longer log every second, third, ... cell serves
SWEEPS = 2  # over all joints: a third changes nothing
WEIGHT_ROUNDS = 4  # by which weights have settled
MIN_FAST_CELLS = 20  # from which the mean square of a fast joint's residuals is known to a third
MIN_REVERSAL_SHARE = 0.5  # of the squares of e next to reversals, which last a tenth of the time: play makes 0.8
MAX_REVERSAL_TIME = 0.2  # share of cells next to reversals, beyond which they say nothing
MIN_MASS_RATIO = 1e-6  # of eigenvalues of a mass matrix with ones on its diagonal: less is no robot
_LoadedFit = tuple[list[IdentificationProblem], Regression, list[ShownTorques]]  # with `LogFit.shown`


@dataclass(frozen=True, eq=False)
class FitOptions:
    """What a caller states of a fit."""

    robot: Engine  # the model
    terms: tuple[DriveTerm, ...]  # drive terms that are sought
    known: bool = False  # whether weights are inverse variances
    given_eps: bool = False  # whether smoothing velocities of friction are stated
    band: float | None = None  # highest frequency of the forces, Hz
    delay: float | None = None  # of forces after positions, s


@dataclass(frozen=True)
class ConfirmedBand(BandErrors):
    """What torques say of the accelerations of a motion."""

    turning: tuple[str, ...]  # joints whose accelerations are off where they turn back, as with play


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
    terms = tuple(term for term in drive_trains.ALL_DRIVE_TERMS if term in {*options.terms, "armature"})
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
    return log if band is None else replace(log, motion=resmoothing.smooth_motion_to(log.motion, band.frequency))


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
        sought = drive_trains.LOAD_FRICTION in options.terms
        loaded, x = np.any([loaded, *(of.loaded for of in shown)], axis=0) & sought, solution.x
        if not loaded.any():
            break
    return posed, solution, shown


def _pose_logs(options: FitOptions, logs: Sequence[MeasuredLog]) -> list[IdentificationProblem]:
    """The problem of each log, of the robot with the friction laws that they show."""
    fitted = [(of.motion, of.samples) for of in logs if not of.tests]
    terms = tuple(term for term in options.terms if term != drive_trains.LOAD_FRICTION)
    robot, terms, sought, weighed = with_friction_laws(options.robot, fitted, terms, options.given_eps, options.known)
    total, others, posed = sum(np.count_nonzero(of.weights) for of in weighed), iter(weighed), []
    for of in logs:
        samples = of.samples if of.tests else next(others)
        share = np.count_nonzero(samples.weights) / total
        with errors.locate_errors(of.name):
            one = pose_problem(robot, of.motion, terms, sought, of.given, of.used, samples, options.band, share)
        posed.append(replace(one, log=of.name, tests=of.tests))
    return posed


@dataclass(frozen=True, eq=False)
class FrictionCells:
    """The forces of C cells that the model without friction leaves, and what parameters add to them."""

    Y: np.ndarray  # (C, nv, P) of all parameters but those of friction
    own: tuple[int, ...]  # where in P damping and offset of the joints begin, which are refitted with friction
    onto: np.ndarray  # (C, nv, joints) a force of each joint
    shapes: np.ndarray  # (C, joints, laws) forces of a unit of friction at each joint
    fades: int  # number of laws of one eps: the first is Coulomb's, and others add a Stribeck term
    off: np.ndarray  # (C, nv) forces
    counts: np.ndarray  # (C, nv) sums of the weights of the samples
    bins: np.ndarray  # (C, nv) of the speed

    def columns(self, j: int, law: int) -> np.ndarray:
        """The forces (C, nv, 1 or 2) of the parameters of the law of a joint."""
        terms = sorted({law - law % self.fades, law})
        return np.asarray(self.onto[..., j, None] * self.shapes[:, None, j, terms])


@dataclass(frozen=True, eq=False)
class FrictionFit:
    """Least squares of all parameters, of those laws that were chosen."""

    rest: np.ndarray  # (C, nv) residuals
    roots: np.ndarray  # (C, nv) square roots of the weights: of inverse variances
    taken: list[np.ndarray]  # (C, nv) by joint: what its damping, friction and offset explain


# Before a fit: laws of friction, and weights of slow samples.
def with_friction_laws(
    robot: R,
    logs: Sequence[tuple[Motion, Measurements]],
    terms: tuple[DriveTerm, ...],
    given_eps: bool,
    known: bool,
) -> tuple[R, tuple[DriveTerm, ...], np.ndarray, list[Measurements]]:
    """The robot with the laws of friction that the samples of all logs show, and what is sought then.

    Returns the terms, which of their parameters (terms * joints,) are sought, and by log samples with other weights.
    Without friction among the terms, all is as it was. A given eps is that of the robot, and stays, as do weights that
    are known inverse variances.
    """
    m, d, count = robot.mechanism, robot.mechanism.drives, len(robot.mechanism.joints)
    if "friction" not in terms:
        return robot, terms, np.ones(len(terms) * count, dtype=bool), [samples for _, samples in logs]
    eps = np.tile([np.nan, *SMOOTHING_VELOCITIES[: 0 if given_eps else None]], (count, 1))  # (joints, number)
    eps[:, 0] = d.eps
    fades = np.array([np.inf, *STRIBECK_VELOCITIES[: None if "stribeck" in terms else 0]])
    cells = _join_cells([_average_cells(robot, *log, terms, eps, fades, MAX_CELLS // len(logs)) for log in logs])
    chosen = [0] * count
    fit = _fit_laws(cells, chosen, np.ones_like(cells.off))
    for _ in range(SWEEPS if cells.shapes.shape[-1] > 1 else 0):
        chosen = [_choose_law(cells, fit, j) for j in range(count)]
        fit = _fit_laws(cells, chosen, np.ones_like(cells.off))
    factors, forces = np.ones((cells.off.shape[1], len(SPEED_BINS) + 1)), np.arange(cells.off.shape[1])
    for _ in range(0 if known else WEIGHT_ROUNDS):
        factors = _speed_factors(cells, fit.rest)
        fit = _fit_laws(cells, chosen, factors[forces, cells.bins])
    weighed = [
        replace(samples, weights=samples.weights * factors[forces, _speed_bins(motion, samples)])
        for motion, samples in logs
    ]
    width, fade = np.divmod(chosen, len(fades))
    drives = replace(d, eps=eps[np.arange(count), width])
    if "stribeck" in terms:
        speeds = np.where(fade > 0, fades[fade], d.stribeck_velocity)
        drives = replace(drives, stribeck=d.stribeck * (fade > 0), stribeck_velocity=speeds)
        terms = tuple(term for term in terms if term != "stribeck" or fade.any())
    sought = np.concatenate([(fade > 0) | (term != "stribeck") for term in terms])
    return with_mechanism(robot, replace(m, drives=drives)), terms, sought, weighed


def _average_cells(
    robot: Engine,
    motion: Motion,
    samples: Measurements,
    terms: tuple[DriveTerm, ...],
    eps: np.ndarray,
    fades: np.ndarray,
    most: int,
) -> FrictionCells:
    """The cells of a log, of which at most some serve."""
    m, base = robot.mechanism, base_parameters.base_parameters(robot.mechanism)
    place = number_cells(samples.t, MAX_CELL_WIDTH)
    every = place[-1] // max(most, 1) + 1
    samples, place = samples.part(place % every == 0), place[place % every == 0] // every
    bare = with_mechanism(robot, replace(m, acting=tuple(term for term in m.acting if term not in FRICTION_TERMS)))
    pieces = list(along.compute_pieces(bare, motion, samples.t, 0))
    model = np.concatenate([piece.forces[0] for piece in pieces])
    v = np.concatenate([piece.rates[1] for piece in pieces]) @ m.G.T
    others = (*(term for term in terms if term not in (*FRICTION_TERMS, "offset")), "offset")
    cells = average_forces(bare, motion, samples, model, others, place)
    # laws at each joint
    laws = eps.shape[1] * len(fades)
    shapes = np.empty((len(cells.off), len(eps), laws))
    for j, of_joint in enumerate(eps):
        by_eps, by_fade = np.tanh(v[:, j, None] / of_joint), np.exp(-((v[:, j, None] / fades) ** 2))
        by_law = (by_eps[..., None] * by_fade[:, None]).reshape(len(v), laws)
        shapes[:, j] = weighted_means(by_law, np.ones((len(v), 1)), place)[0]
    # columns of parameters: inertial ones, those of other drive terms, and the offsets if these are sought
    n, first = len(m.joints), len(base.parameters)
    places = np.append(base.columns, np.arange(first, first + n * len(others)))
    onto, Y = cells.Y[..., -n:], cells.Y[..., places if "offset" in terms else places[:-n]]
    own = [base.count + n * k for k, term in enumerate(others) if term in terms and term in ("damping", "offset")]
    means = weighted_means(_speed_bins(motion, samples), np.ones_like(model), place)[0]
    return FrictionCells(Y, tuple(own), onto, shapes, len(fades), cells.off, cells.counts, np.rint(means).astype(int))


def _join_cells(of_logs: Sequence[FrictionCells]) -> FrictionCells:
    return replace(
        of_logs[0],
        Y=np.concatenate([x.Y for x in of_logs]),
        onto=np.concatenate([x.onto for x in of_logs]),
        shapes=np.concatenate([x.shapes for x in of_logs]),
        off=np.concatenate([x.off for x in of_logs]),
        counts=np.concatenate([x.counts for x in of_logs]),
        bins=np.concatenate([x.bins for x in of_logs]),
    )


def _speed_bins(motion: Motion, samples: Measurements) -> np.ndarray:
    """The bin of the speed of each force (N, nv); forces on a base count as fast."""
    bins = np.digitize(np.abs(motion(samples.t, 1)[1]), SPEED_BINS)
    of_base = samples.forces.shape[1] - bins.shape[1]
    return np.pad(bins, ((0, 0), (of_base, 0)), constant_values=len(SPEED_BINS))


def _fit_laws(cells: FrictionCells, chosen: Sequence[int], factors: np.ndarray) -> FrictionFit:
    """Fit all parameters, weighted with factors (C, nv), to forces of which each has the variance of its residuals."""
    of_joints = [cells.columns(j, law) for j, law in enumerate(chosen)]
    A, rest = np.concatenate([cells.Y, *of_joints], axis=-1), cells.off
    for _ in range(2):
        roots = np.sqrt(cells.counts * factors / _mean_squares(cells, rest, factors))
        white = (A * roots[..., None]).reshape(-1, A.shape[-1])
        X = informed_directions(white.T @ white)[0]
        x = X @ (X.T @ (white.T @ (cells.off * roots).ravel()))
        rest = cells.off - A @ x
    ends = np.cumsum([cells.Y.shape[-1], *(columns.shape[-1] for columns in of_joints)])
    taken = [
        columns @ x[ends[j] : ends[j + 1]] + sum(cells.Y[..., k + j] * x[k + j] for k in cells.own)
        for j, columns in enumerate(of_joints)
    ]
    return FrictionFit(rest, roots, taken)


def _mean_squares(cells: FrictionCells, rest: np.ndarray, factors: np.ndarray) -> np.ndarray:
    """Mean squares (nv,) of residuals of one sample, not below what the best sensor has."""
    weights, there = cells.counts * factors, np.maximum((cells.counts > 0).sum(axis=0), 1)
    least = MIN_RELATIVE_DEVIATION**2 * (cells.counts * cells.off**2).sum(axis=0) / there
    return np.maximum((weights * rest**2).sum(axis=0) / there, np.where(least > 0, least, least.max() or 1.0))


def _choose_law(cells: FrictionCells, fit: FrictionFit, j: int) -> int:
    """The law of a joint of the least Bayesian information criterion, at the other parameters of a fit."""
    fades = np.arange(cells.shapes.shape[-1]) % cells.fades
    rests = _try_laws(cells, fit, j, np.flatnonzero((fades == 0) | (fades % COARSE_STEP == 1)))
    first = _find_least(cells.fades, rests) // cells.fades * cells.fades
    rests |= _try_laws(cells, fit, j, np.arange(first, first + cells.fades))
    return _find_least(cells.fades, rests)


def _try_laws(cells: FrictionCells, fit: FrictionFit, j: int, laws: np.ndarray) -> dict[int, np.ndarray]:
    """The residuals (C, k) that laws of a joint leave, over their deviations; Stribeck terms are not negative."""
    acts, rests = cells.onto[..., j].any(axis=0), {}
    roots = fit.roots[:, acts]
    left = (fit.rest + fit.taken[j])[:, acts] * roots
    own = cells.Y[:, acts][..., [k + j for k in cells.own]]
    for law in laws.tolist():
        A = np.concatenate([own, cells.columns(j, law)[:, acts]], axis=-1) * roots[..., None]
        x = np.linalg.lstsq(A.reshape(-1, A.shape[-1]), left.ravel())[0]
        if law % cells.fades == 0 or x[-1] > 0:
            rests[law] = left - A @ x
    return rests


def _find_least(fades: int, rests: dict[int, np.ndarray]) -> int:
    """The law with the least criterion: of more parameters only where residuals are smaller than chance makes them."""
    squares = {law: (rest**2).sum() for law, rest in rests.items()}
    best = rests[min(squares, key=squares.__getitem__)]
    correlation = (best[1:] * best[:-1]).sum() / max((best**2).sum(), np.finfo(float).tiny)
    n = max(np.count_nonzero(best) * (1 - correlation) / (1 + correlation), 2.0)
    least = MIN_RELATIVE_DEVIATION**2 * max(squares.values()) or 1.0  # rounding, where one law explains all
    sizes = {law: 2 * (law % fades > 0) + (law >= fades) for law in squares}
    return min(squares, key=lambda law: n * np.log(squares[law] + least) + sizes[law] * np.log(n))


def _speed_factors(cells: FrictionCells, rest: np.ndarray) -> np.ndarray:
    """The factors (nv, bins) of weights, by the mean squares of residuals."""
    found = np.ones((rest.shape[1], len(SPEED_BINS) + 1))
    for i, bins in enumerate(cells.bins.T):
        there = cells.counts[:, i] > 0
        number = np.bincount(bins[there], minlength=found.shape[1])
        squares = np.bincount(bins[there], (cells.counts * rest**2)[there, i], found.shape[1])
        means = squares / np.maximum(number, 1)
        if number[-1] >= MIN_FAST_CELLS and means[-1] > 0:
            found[i] = 1 / np.maximum(1.0, means / means[-1]) ** 2
    return found


# After a fit: the band up to which torques confirm a motion.
def find_band(posed: IdentificationProblem, x: np.ndarray) -> ConfirmedBand | None:
    """The band up to which torques confirm a motion, by corrections x; None where they say nothing of it."""
    chosen, counts = resmoothing.chosen_bandwidth(posed.motion), posed.cells.counts
    if chosen is None or not (counts > 0).any(axis=0).all():
        return None
    M = posed.errors.mass_matrix(x)
    if M.shape[1] != M.shape[2] or not _are_inertias(M):
        return None
    # what torques ask for beyond the accelerations: nothing where one of them is not measured
    t, place = posed.samples.t, number_cells(posed.samples.t, posed.width)
    rest = (posed.cells.off - posed.cells.Y[..., posed.columns] @ x) * (counts > 0).all(axis=1, keepdims=True)
    e, ones = np.linalg.solve(M, rest[..., None])[..., 0], np.ones((len(t), 1))
    _, qd, q2d = posed.motion(t, 2)
    v, a, times = (weighted_means(of, ones, place)[0] for of in (qd, q2d, t[:, None]))
    if (errors := resmoothing.band_errors(times[:, 0], a, e, chosen)) is None:
        return None
    pairs = zip(posed.robot.mechanism.coordinates, v.T, e.T, strict=True)
    turning = tuple(name for name, speed, off in pairs if _is_off_where_it_turns(speed, off))
    return ConfirmedBand(**vars(errors), turning=turning)


def _is_off_where_it_turns(v: np.ndarray, e: np.ndarray) -> bool:
    """Whether most of the errors of accelerations (C,) of a joint are where its velocity (C,) changes its sign."""
    end = int(resmoothing.UNCERTAIN_END_SHARE * len(e))
    v, e = (x[end : len(x) - end] for x in (v, e))
    turns = v[1:] * v[:-1] < 0
    near = np.convolve(turns, np.ones(4))[1 : len(e) + 1] > 0  # the two cells before it, and the two after
    return bool(near.mean() < MAX_REVERSAL_TIME and (e[near] ** 2).sum() > MIN_REVERSAL_SHARE * (e**2).sum())


def _are_inertias(M: np.ndarray) -> bool:
    """Whether all mass matrices (C, n, n) are positive definite, well beyond rounding."""
    diagonal = np.diagonal(M, axis1=1, axis2=2)
    if not (diagonal > 0).all():
        return False
    scaled = M / np.sqrt(diagonal[:, :, None] * diagonal[:, None, :])
    return bool((np.linalg.eigvalsh(scaled)[:, 0] > MIN_MASS_RATIO).all())
