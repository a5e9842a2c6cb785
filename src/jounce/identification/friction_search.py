"""How the friction of each joint depends on its speed, and how much slow samples count, whose friction no model has.

Coulomb friction is f tanh(v / eps): eps belongs to the joint, and the forces are not linear in it. For each joint, some
of them are tried, alone and with a term of Stribeck, s tanh(v / eps) exp(-(v / vs)^2), with some vs: damping, friction
and offset of the joint are refitted to what the other parameters leave, and the least Bayesian information criterion
n log(mean square) + k log(n) decides. n is the number of independent residuals, as their correlation from one cell to
the next has it; k are 2 parameters of a Stribeck term, and 1 if eps is not the model's. Then all parameters are
refitted; two sweeps do.

Real friction near rest depends on more than the speed. Samples are sorted by the speed of their joint, and those of a
bin of which the mean square m of the residuals is above that of the fast ones, m0, get the weight (m0 / m)^2: less than
the m0 / m of noise with that variance, as such residuals are no noise, but all of one sign. Residuals and weights
follow from each other, by turns.

Cells of time are at most 20 ms wide, so that the turning of a joint shows.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from jounce.core.typing import DriveTerm
from jounce.dynamics.base_parameters import base_parameters
from jounce.engine.along import compute_pieces
from jounce.engine.engine import Engine, R, with_mechanism
from jounce.identification.averaging import average_forces, number_cells, weighted_means
from jounce.identification.measurements import Measurements
from jounce.identification.regression import MIN_RELATIVE_DEVIATION, informed_directions
from jounce.motion.motion import Motion

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
    m, base = robot.mechanism, base_parameters(robot.mechanism)
    place = number_cells(samples.t, MAX_CELL_WIDTH)
    every = place[-1] // max(most, 1) + 1
    samples, place = samples.part(place % every == 0), place[place % every == 0] // every
    bare = with_mechanism(robot, replace(m, acting=tuple(term for term in m.acting if term not in FRICTION_TERMS)))
    pieces = list(compute_pieces(bare, motion, samples.t, 0))
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
