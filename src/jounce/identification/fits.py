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
from jounce.identification.force_checks import ShownTorques, find_torques, refuse_odd_scale
from jounce.identification.least_squares_problem import FitOptions, IdentificationProblem, join_problems, pose_problem
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


@dataclass(frozen=True)
class ConfirmedBand(BandErrors):
    """The band up to which torques confirm the accelerations of a motion."""

    turning: tuple[str, ...]  # joints whose accelerations are off where they turn back, as with play


@dataclass(frozen=True, eq=False)
class LogFit:
    """A fit of logs without delays."""

    posed: list[IdentificationProblem]
    solution: Regression
    shown: list[ShownTorques]  # torques that no parameter holds, of the logs that are fitted
    late: list[float]  # delays that are taken out, s
    delayed: list[list[str]]  # notes on the delays
    confirmed: tuple[ConfirmedBand | None, ...]  # of each log that is smoothed to what torques confirm
    notes: tuple[str, ...] = ()  # of earlier rounds


def fit_in_rounds(options: FitOptions, logs: Sequence[MeasuredLog]) -> LogFit:
    """Fit logs in rounds, with confirmed bands, and rotors that residuals show."""
    fit = _fit_confirmed(options, logs)
    rotors = [text for torques in fit.shown for text in torques.rotors]
    if len(rotors) == 0:
        return fit
    # Bands were chosen with accelerations that the missing rotors spoil: they are sought once more, from the logs.
    terms = tuple(term for term in drive_trains.ALL_DRIVE_TERMS if term in {*options.terms, "armature"})
    fit = _fit_confirmed(replace(options, terms=terms), logs)
    what = ", ".join(dict.fromkeys(rotors))
    note = f"residuals show what the model lacks, {what}: the armature of all joints is identified too"
    return replace(fit, notes=(note,))


def _fit_confirmed(options: FitOptions, logs: Sequence[MeasuredLog]) -> LogFit:
    """Fit logs, smoothed to confirmed bands where that explains more."""
    fit = fit_logs(options, logs)
    bands = [find_band(problem, fit.solution.x) for problem in fit.posed]
    for _ in range(BAND_ROUNDS):
        if not any(band is not None and band.is_lower for band in bands):
            break
        # Smooth each log to what torques confirm now, where it is less than in the round before.
        confirmed = tuple(
            band if band is not None and band.is_lower else last_band
            for band, last_band in zip(bands, fit.confirmed, strict=True)
        )
        smoothed = [_smooth_to(log, band) for log, band in zip(logs, confirmed, strict=True)]
        next_fit = fit_logs(options, smoothed)
        next_bands = [find_band(problem, next_fit.solution.x) for problem in next_fit.posed]
        # The last fit stays where smoothing does not explain accelerations better.
        if not all(map(_explains_more, next_bands, bands)):
            break
        fit, bands = replace(next_fit, confirmed=confirmed), next_bands
    return fit


def _smooth_to(log: MeasuredLog, band: ConfirmedBand | None) -> MeasuredLog:
    return log if band is None else replace(log, motion=resmoothing.smooth_motion_to(log.motion, band.frequency))


def _explains_more(later: ConfirmedBand | None, earlier: ConfirmedBand | None) -> bool:
    """Return whether a fit of smoothed motions explains accelerations better.

    Parameters near 0, as of a free swing, do not.
    """
    if earlier is None or not earlier.is_lower:
        return True
    return later is not None and later.total < earlier.total


def fit_logs(options: FitOptions, logs: Sequence[MeasuredLog]) -> LogFit:
    """Fit logs without the delays of their forces."""
    fits = list[_LoadedFit]()

    # Laws of friction and loads depend on the delays: each time that delays change, all of it is fitted again.
    def pose(logs: Sequence[MeasuredLog]) -> list[IdentificationProblem]:
        fits.append(_fit_with_loads(options, _pose_logs(options, logs)))
        return fits[-1][0]

    posed, late, delayed = pose_without_delays(pose, logs, options.delay)
    # The last fit is that of the problems that are returned.
    _, solution, shown = fits[-1]
    return LogFit(posed, solution, shown, late, delayed, (None,) * len(posed))


def _fit_with_loads(options: FitOptions, posed: list[IdentificationProblem]) -> _LoadedFit:
    """Fit logs, with friction by the load where residuals show it."""
    loaded, x = np.zeros(len(posed[0].robot.mechanism.joints), dtype=bool), np.zeros(0)
    is_sought = drive_trains.LOAD_FRICTION in options.terms
    # Each round takes the loads of the last fit, and adds joints; the first round has none of them.
    for _ in range(1 + LOAD_ROUNDS):
        if loaded.any():
            posed = [problem.with_load_friction(x, loaded) for problem in posed]
        fitted = [problem for problem in posed if not problem.tests]
        joined, cells = join_problems(fitted)
        solution = fit_forces(joined.cells, joined.columns, joined.errors, options.known, cells, joined.offsets)
        # Residuals are searched log by log, with the weights of the cells of each.
        parts = [replace(solution, weights=solution.weights[part]) for part in cells]
        shown = [find_torques(problem, part) for problem, part in zip(fitted, parts, strict=True)]
        loaded = np.any([loaded, *(torques.loaded for torques in shown)], axis=0) & is_sought
        x = solution.x
        if not loaded.any():
            break
    return posed, solution, shown


def _pose_logs(options: FitOptions, logs: Sequence[MeasuredLog]) -> list[IdentificationProblem]:
    """Pose the problem of each log, with friction laws of all."""
    # Friction by the load is no law of the speed: `_fit_with_loads` adds it after a first fit.
    fitted = [(log.motion, log.samples) for log in logs if not log.tests]
    terms = tuple(term for term in options.terms if term != drive_trains.LOAD_FRICTION)
    robot, terms, sought, weighed = with_friction_laws(options.robot, fitted, terms, options.given_eps, options.known)
    # Each log has a share of the measured forces, by which it has its share of the cells that parameters need.
    total = sum(np.count_nonzero(samples.weights) for samples in weighed)
    weighed_samples, posed = iter(weighed), []
    for log in logs:
        samples = log.samples if log.tests else next(weighed_samples)
        share = np.count_nonzero(samples.weights) / total
        with errors.locate_errors(log.name):
            law_options = replace(options, robot=robot, terms=terms)
            posed.append(pose_problem(law_options, log, samples, sought=sought, share=share))
            refuse_odd_scale(posed[-1], options.as_given)
    return posed


@dataclass(frozen=True, eq=False)
class FrictionLaws:
    """The laws of friction that are tried: each eps of a joint with each fading velocity."""

    eps: np.ndarray  # (joints, number) smoothing velocities, the model's own first
    fades: np.ndarray  # (number,) Stribeck velocities, after inf of a law without such a term


@dataclass(frozen=True, eq=False)
class FrictionCells:
    """The forces of C cells without friction, and the columns of parameters."""

    Y: np.ndarray  # (C, nv, P) of all parameters but those of friction
    own: tuple[int, ...]  # where in P damping and offset of the joints begin: they are refitted with friction
    onto: np.ndarray  # (C, nv, joints) a unit force of each joint
    shapes: np.ndarray  # (C, joints, laws) forces of a unit of friction at each joint
    fades: int  # number of laws of one eps: the first is Coulomb's, and others add a Stribeck term
    off: np.ndarray  # (C, nv) forces
    counts: np.ndarray  # (C, nv) sums of the weights of the samples
    bins: np.ndarray  # (C, nv) of the speed

    def columns(self, j: int, law: int) -> np.ndarray:
        """Return the forces of the parameters of a joint's law: (C, nv, 1 or 2)."""
        # Laws of one eps stand together: its Coulomb term is the first, and a Stribeck term acts in addition.
        terms = sorted({law - law % self.fades, law})
        return np.asarray(self.onto[..., j, None] * self.shapes[:, None, j, terms])


@dataclass(frozen=True, eq=False)
class FrictionFit:
    """Least squares of all parameters, with a law for each joint."""

    residuals: np.ndarray  # (C, nv)
    roots: np.ndarray  # (C, nv) square roots of the weights, which are inverse variances
    explained: list[np.ndarray]  # (C, nv) by joint: what its damping, friction and offset explain


# Before a fit: laws of friction, and weights of slow samples.
def with_friction_laws(
    robot: R,
    logs: Sequence[tuple[Motion, Measurements]],
    terms: tuple[DriveTerm, ...],
    given_eps: bool,
    known: bool,
) -> tuple[R, tuple[DriveTerm, ...], np.ndarray, list[Measurements]]:
    """Choose the laws of friction that the samples of all logs show.

    Returns the robot with these laws, the terms, which of their parameters (terms * joints,) are sought, and by log
    samples with other weights. Without friction among the terms, all is as it was. A given eps is that of the robot,
    and stays, as do weights that are known inverse variances. Runs once for each posing of the logs.
    """
    m, d, count = robot.mechanism, robot.mechanism.drives, len(robot.mechanism.joints)
    if "friction" not in terms:
        return robot, terms, np.ones(len(terms) * count, dtype=bool), [samples for _, samples in logs]
    # Candidates: of each joint the model's own eps, and further ones unless it is stated.
    further_eps = () if given_eps else SMOOTHING_VELOCITIES
    eps = np.tile([np.nan, *further_eps], (count, 1))  # (joints, number)
    eps[:, 0] = d.eps
    fades = np.array([np.inf, *(STRIBECK_VELOCITIES if "stribeck" in terms else ())])
    laws = FrictionLaws(eps, fades)
    cells = _join_cells([_average_cells(robot, log, terms, laws, MAX_CELLS // len(logs)) for log in logs])
    # Laws: start with the model's own at all joints; in each sweep every joint chooses at the last fit of all, then
    # all parameters are refitted with the laws chosen.
    chosen = [0] * count
    fit = _fit_laws(cells, chosen, np.ones_like(cells.off))
    has_choice = cells.shapes.shape[-1] > 1
    for _ in range(SWEEPS if has_choice else 0):
        chosen = [_choose_law(cells, fit, j) for j in range(count)]
        fit = _fit_laws(cells, chosen, np.ones_like(cells.off))
    # Weights of slow samples and residuals, by turns: factors (nv, bins) -> (C, nv) of the cells.
    factors, forces = np.ones((cells.off.shape[1], len(SPEED_BINS) + 1)), np.arange(cells.off.shape[1])
    for _ in range(0 if known else WEIGHT_ROUNDS):
        factors = _speed_factors(cells, fit.residuals)
        fit = _fit_laws(cells, chosen, factors[forces, cells.bins])
    weighed = [
        replace(samples, weights=samples.weights * factors[forces, _speed_bins(motion, samples)])
        for motion, samples in logs
    ]
    # The robot with these laws. A Stribeck term is sought only at joints that chose one.
    chosen_eps, chosen_fade = np.divmod(chosen, len(fades))
    drives = replace(d, eps=eps[np.arange(count), chosen_eps])
    if "stribeck" in terms:
        speeds = np.where(chosen_fade > 0, fades[chosen_fade], d.stribeck_velocity)
        drives = replace(drives, stribeck=d.stribeck * (chosen_fade > 0), stribeck_velocity=speeds)
        terms = tuple(term for term in terms if term != "stribeck" or chosen_fade.any())
    sought = np.concatenate([(chosen_fade > 0) | (term != "stribeck") for term in terms])
    return with_mechanism(robot, replace(m, drives=drives)), terms, sought, weighed


def _average_cells(
    robot: Engine,
    log: tuple[Motion, Measurements],
    terms: tuple[DriveTerm, ...],
    laws: FrictionLaws,
    max_cells: int,
) -> FrictionCells:
    """Average the forces and the laws of a log over cells."""
    (motion, samples), m = log, robot.mechanism
    base = base_parameters.base_parameters(m)
    # Every k-th cell serves, numbered without gaps.
    place = number_cells(samples.t, MAX_CELL_WIDTH)
    every = place[-1] // max(max_cells, 1) + 1
    samples, place = samples.part(place % every == 0), place[place % every == 0] // every
    # The model without friction leaves all of it to the laws.
    frictionless = tuple(term for term in m.acting if term not in FRICTION_TERMS)
    bare = with_mechanism(robot, replace(m, acting=frictionless))
    pieces = list(along.compute_pieces(bare, motion, samples.t, 0))
    model = np.concatenate([piece.forces[0] for piece in pieces])
    v = np.concatenate([piece.rates[1] for piece in pieces]) @ m.G.T
    other_terms = (*(term for term in terms if term not in (*FRICTION_TERMS, "offset")), "offset")
    cells = average_forces(bare, motion, samples, model, other_terms, place)
    # Shapes tanh(v / eps) exp(-(v / vs)^2) of all laws at each joint, averaged: (N, eps, fades) -> (C, laws). With vs
    # infinite the second factor is 1, and the law is Coulomb's.
    law_count = laws.eps.shape[1] * len(laws.fades)
    shapes = np.empty((len(cells.off), len(laws.eps), law_count))
    for j, eps in enumerate(laws.eps):
        by_eps, by_fade = np.tanh(v[:, j, None] / eps), np.exp(-((v[:, j, None] / laws.fades) ** 2))
        by_law = (by_eps[..., None] * by_fade[:, None]).reshape(len(v), law_count)
        shapes[:, j] = weighted_means(by_law, np.ones((len(v), 1)), place)[0]
    # Columns of parameters: inertial ones, those of other drive terms, and the offsets if these are sought. Columns of
    # offsets are there in any case, as they are the unit forces of the joints.
    n, first = len(m.joints), len(base.parameters)
    places = np.append(base.columns, np.arange(first, first + n * len(other_terms)))
    onto, Y = cells.Y[..., -n:], cells.Y[..., places if "offset" in terms else places[:-n]]
    own = [base.count + n * k for k, term in enumerate(other_terms) if term in terms and term in ("damping", "offset")]
    # A cell has the bin of its mean speed, rounded.
    means = weighted_means(_speed_bins(motion, samples), np.ones_like(model), place)[0]
    bins = np.rint(means).astype(int)
    return FrictionCells(Y, tuple(own), onto, shapes, len(laws.fades), cells.off, cells.counts, bins)


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
    """Return the speed bins of forces: (N, nv), forces on a base count as fast."""
    bins = np.digitize(np.abs(motion(samples.t, 1)[1]), SPEED_BINS)
    base_forces = samples.forces.shape[1] - bins.shape[1]
    return np.pad(bins, ((0, 0), (base_forces, 0)), constant_values=len(SPEED_BINS))


def _fit_laws(cells: FrictionCells, chosen: Sequence[int], factors: np.ndarray) -> FrictionFit:
    """Fit all parameters to forces with the variances of their residuals.

    Weights have factors (C, nv). Accelerations count as exact here: laws differ by more than their errors do.
    """
    law_columns = [cells.columns(j, law) for j, law in enumerate(chosen)]
    A, residuals = np.concatenate([cells.Y, *law_columns], axis=-1), cells.off
    # Twice: with the forces themselves for residuals at first, so that forces of all sizes count alike.
    for _ in range(2):
        roots = np.sqrt(cells.counts * factors / _mean_squares(cells, residuals, factors))
        white = (A * roots[..., None]).reshape(-1, A.shape[-1])
        # With X^T A^T W A X = 1, the least-squares solution is X X^T A^T W b.
        X = informed_directions(white.T @ white)[0]
        x = X @ (X.T @ (white.T @ (cells.off * roots).ravel()))
        residuals = cells.off - A @ x
    # What the terms of each joint explain is refitted with other laws, while all else stays.
    ends = np.cumsum([cells.Y.shape[-1], *(columns.shape[-1] for columns in law_columns)])
    explained = [
        columns @ x[ends[j] : ends[j + 1]] + sum(cells.Y[..., k + j] * x[k + j] for k in cells.own)
        for j, columns in enumerate(law_columns)
    ]
    return FrictionFit(residuals, roots, explained)


def _mean_squares(cells: FrictionCells, residuals: np.ndarray, factors: np.ndarray) -> np.ndarray:
    """Return mean squares (nv,) of residuals, not below the best sensor's."""
    weights, cell_count = cells.counts * factors, np.maximum((cells.counts > 0).sum(axis=0), 1)
    least = MIN_RELATIVE_DEVIATION**2 * (cells.counts * cells.off**2).sum(axis=0) / cell_count
    # A force that is 0 throughout takes the least of the largest force, so that no variance is 0.
    largest = least.max() if least.max() > 0 else 1.0
    return np.maximum((weights * residuals**2).sum(axis=0) / cell_count, np.where(least > 0, least, largest))


def _choose_law(cells: FrictionCells, fit: FrictionFit, j: int) -> int:
    """Choose the law of a joint with the least Bayesian information criterion.

    All other parameters are those of the fit.
    """
    # First each eps with some Stribeck velocities, then the best eps with all of them: their valley is broad.
    fades = np.arange(cells.shapes.shape[-1]) % cells.fades
    residuals = _try_laws(cells, fit, j, np.flatnonzero((fades == 0) | (fades % COARSE_STEP == 1)))
    first = _find_least(cells.fades, residuals) // cells.fades * cells.fades
    residuals |= _try_laws(cells, fit, j, np.arange(first, first + cells.fades))
    return _find_least(cells.fades, residuals)


def _try_laws(cells: FrictionCells, fit: FrictionFit, j: int, laws: np.ndarray) -> dict[int, np.ndarray]:
    """Return the residuals of laws of a joint, over their deviations: (C, k).

    Laws with a negative Stribeck term are left out.
    """
    # Only the k forces on which the joint acts matter; what its last law explained is theirs to explain again.
    acts, residuals = cells.onto[..., j].any(axis=0), {}
    roots = fit.roots[:, acts]
    target = (fit.residuals + fit.explained[j])[:, acts] * roots
    own_columns = cells.Y[:, acts][..., [k + j for k in cells.own]]
    for law in laws.tolist():
        A = np.concatenate([own_columns, cells.columns(j, law)[:, acts]], axis=-1) * roots[..., None]
        x = np.linalg.lstsq(A.reshape(-1, A.shape[-1]), target.ravel())[0]
        # The last column of a law with a Stribeck term is that term; Coulomb's laws serve with either sign.
        if law % cells.fades == 0 or x[-1] > 0:
            residuals[law] = target - A @ x
    return residuals


def _find_least(fades: int, residuals: dict[int, np.ndarray]) -> int:
    """Return the law with the least n log(mean square) + k log(n).

    A law of more parameters needs smaller residuals than chance makes of them.
    """
    squares = {law: (rest**2).sum() for law, rest in residuals.items()}
    # The number of independent residuals, by the correlation c of neighbours in the best law: n (1 - c) / (1 + c).
    best = residuals[min(squares, key=squares.__getitem__)]
    correlation = (best[1:] * best[:-1]).sum() / max((best**2).sum(), np.finfo(float).tiny)
    n = max(np.count_nonzero(best) * (1 - correlation) / (1 + correlation), 2.0)
    # Rounding, where one law explains all: below it no law is better than another.
    rounding = MIN_RELATIVE_DEVIATION**2 * max(squares.values())
    if rounding == 0:
        rounding = 1.0
    sizes = {law: 2 * (law % fades > 0) + (law >= fades) for law in squares}

    def criterion(law: int) -> float:
        return float(n * np.log(squares[law] + rounding) + sizes[law] * np.log(n))

    return min(squares, key=criterion)


def _speed_factors(cells: FrictionCells, residuals: np.ndarray) -> np.ndarray:
    """Return the factors of weights by the mean squares of residuals: (nv, bins)."""
    factors = np.ones((residuals.shape[1], len(SPEED_BINS) + 1))
    for i, bins in enumerate(cells.bins.T):
        measured = cells.counts[:, i] > 0
        number = np.bincount(bins[measured], minlength=factors.shape[1])
        squares = np.bincount(bins[measured], (cells.counts * residuals**2)[measured, i], factors.shape[1])
        means = squares / np.maximum(number, 1)
        # (m0 / m)^2, at most 1, where the last bin, of fast cells, is full enough to know m0.
        if number[-1] >= MIN_FAST_CELLS and means[-1] > 0:
            factors[i] = 1 / np.maximum(1.0, means / means[-1]) ** 2
    return factors


# After a fit: the band up to which torques confirm a motion.
def find_band(posed: IdentificationProblem, x: np.ndarray) -> ConfirmedBand | None:
    """Find the band up to which torques confirm a motion: by corrections x.

    None where torques say nothing of the motion.
    """
    # Only a bandwidth that the smoothing chose by itself may be lowered, and only torques of all joints give e.
    bandwidth, counts = resmoothing.chosen_bandwidth(posed.motion), posed.cells.counts
    if bandwidth is None or not (counts > 0).any(axis=0).all():
        return None
    M = posed.errors.mass_matrix(x)
    if M.shape[1] != M.shape[2] or not _are_inertias(M):
        return None
    # e = M^-1 (tau - Y p), what torques ask for beyond the accelerations: nothing in cells where one is not measured.
    t, place = posed.samples.t, number_cells(posed.samples.t, posed.width)
    residuals = (posed.cells.off - posed.cells.Y[..., posed.columns] @ x) * (counts > 0).all(axis=1, keepdims=True)
    e, ones = np.linalg.solve(M, residuals[..., None])[..., 0], np.ones((len(t), 1))
    _, qd, q2d = posed.motion(t, 2)
    v, a, times = (weighted_means(values, ones, place)[0] for values in (qd, q2d, t[:, None]))
    band_errors = resmoothing.band_errors(times[:, 0], a, e, bandwidth)
    if band_errors is None:
        return None
    pairs = zip(posed.robot.mechanism.coordinates, v.T, e.T, strict=True)
    turning = tuple(name for name, speed, error in pairs if _is_off_where_it_turns(speed, error))
    return ConfirmedBand(**vars(band_errors), turning=turning)


def _is_off_where_it_turns(v: np.ndarray, e: np.ndarray) -> bool:
    """Return whether most errors of a joint's accelerations are at reversals.

    Errors e are (C,), and reversals are where its velocity v (C,) changes its sign.
    """
    end = int(resmoothing.UNCERTAIN_END_SHARE * len(e))
    v, e = (x[end : len(x) - end] for x in (v, e))
    # A reversal between two cells marks the two cells before it, and the two after: (C - 1,) -> (C,).
    turns = v[1:] * v[:-1] < 0
    near_reversal = np.convolve(turns, np.ones(4))[1 : len(e) + 1] > 0
    if near_reversal.mean() >= MAX_REVERSAL_TIME:
        return False
    return bool((e[near_reversal] ** 2).sum() > MIN_REVERSAL_SHARE * (e**2).sum())


def _are_inertias(M: np.ndarray) -> bool:
    """Return whether mass matrices (C, n, n) are positive definite beyond rounding."""
    diagonal = np.diagonal(M, axis1=1, axis2=2)
    if not (diagonal > 0).all():
        return False
    # Ones on the diagonal make eigenvalues of joints of all sizes comparable.
    scaled = M / np.sqrt(diagonal[:, :, None] * diagonal[:, None, :])
    return bool((np.linalg.eigvalsh(scaled)[:, 0] > MIN_MASS_RATIO).all())
