"""Equations of motion without accelerations: the balance of momentum or energy through a low-pass filter.

Both are of the form ``d/dt (A theta) + R theta = b`` in the parameters theta, with A and R functions of q and qd: the
generalized momentum changes by the forces b = Q, one equation per force; the energy by their power b = qd . Q, one
equation. A filter of both sides takes the derivative away. The rows are averaged over cells of time, as those of forces
are. The power has twice the band of the forces, and a variance that grows with the velocities.

Algorithm: the power model of M. Gautier (IEEE ICRA 1997) and its counterpart of momentum, through `design_low_pass`,
which integrates d/dt by parts. Invariant: model and measurements pass the same filter, so that the parameters stay what
they are. Gaps that a line cannot bridge leave samples out until the filter has forgotten them. The power fails where a
force is not measured or a base moves.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, join_names
from jounce.core.typing import DriveTerm
from jounce.dynamics.quantities import DEFAULT_QUANTITY, find_row
from jounce.engine.along import forces_along
from jounce.engine.drives import regressor
from jounce.engine.engine import Engine
from jounce.engine.plan import compute
from jounce.identification.averaging import CellAverages, average_rows, number_cells
from jounce.identification.low_pass import LowPass, design_low_pass
from jounce.identification.measurements import Measurements
from jounce.model.coordinates import force_names
from jounce.motion.motion import Motion

POWER, MOMENTUM = (Remedy(f"method={name!r}", f"--method {name}") for name in ("power", "momentum"))
MAX_MISSING_SHARE = 1e-3  # of missing samples in a filtered one that counts: the filter has forgotten them, e^-7
MAX_GAP_TIME_CONSTANTS = 0.3  # of the filter: a line over shorter gaps has errors of a percent at most
MIN_POWER_VARIANCE_RATIO = 1e-3  # to its mean, added to the variance of the power, which is 0 of a robot at rest


# R and A at some times, the columns of the parameters and behind them the model as it is: (N, rows, P + 1) each
Balance = tuple[np.ndarray, np.ndarray]
BalanceLaw = Callable[[Engine, Motion, np.ndarray, Sequence[DriveTerm]], Balance]


def momentum_balance(robot: Engine, motion: Motion, t: np.ndarray, terms: Sequence[DriveTerm]) -> Balance:
    """The balance of the generalized momentum: one row per velocity, of parameters and drive terms."""
    (q, qd), base = motion(t, 1), motion.base(t, 1)
    base = base and (*base, 0 * base[1])
    still, W = 0 * q, motion.wrench(t, 0)
    Yp, Ypd = regressor(robot, "momentum_regressor", (q, qd, still), terms, base=base)
    p, pd = compute(robot, "generalized_momentum", (q, qd, still), base=base)
    Y = regressor(robot, "regressor", (q, qd, still), terms, base=base)
    Q = compute(robot, DEFAULT_QUANTITY.name, (q, qd, still), wrench=W, base=base)
    return _append_model(Y - Ypd, Q - pd), _append_model(Yp, p)


def energy_balance(robot: Engine, motion: Motion, t: np.ndarray, terms: Sequence[DriveTerm]) -> Balance:
    """The balance of the energy: one row, of parameters and drive terms."""
    q, qd = motion(t, 1)
    still, W = 0 * q, motion.wrench(t, 0)
    YE, YEd = regressor(robot, "energy_regressor", (q, qd, still), terms)
    (T, Td), (U, Ud) = compute(robot, "kinetic_energy", (q, qd, still)), compute(robot, "potential_energy", (q, qd))
    Y = regressor(robot, "regressor", (q, qd, still), terms)
    Q = compute(robot, DEFAULT_QUANTITY.name, (q, qd, still), wrench=W)
    power = np.einsum("ti,tij->tj", qd, _append_model(Y, Q))
    return (power - _append_model(YEd, Td + Ud))[:, None], _append_model(YE, T + U)[:, None]


def _append_model(columns: np.ndarray, model: np.ndarray) -> np.ndarray:
    """Columns of parameters, and the model as it is behind them."""
    return np.concatenate([columns, model[..., None]], axis=-1)


def filter_rows(
    law: BalanceLaw, robot: Engine, motion: Motion, terms: Sequence[DriveTerm], through: LowPass
) -> Iterator[tuple[slice, np.ndarray]]:
    """The filtered rows of a balance by pieces of samples: (n, rows, P + 1) that belong to the filtered right sides."""
    return through(lambda part: law(robot, motion, through.t[part], terms))


def average_momentum(
    robot: Engine, motion: Motion, samples: Measurements, terms: Sequence[DriveTerm], width: float, band: float
) -> CellAverages:
    """Average the filtered balance of momentum over cells of a width in s; the forces have a band in Hz."""
    through = design_low_pass(samples.t, band)
    whole, missing = _bridge_gaps(samples, through.cutoff)
    rows = filter_rows(momentum_balance, robot, motion, terms, through)
    weights = whole.weights * _settled_samples(missing, through)
    spread = _momentum_variances(robot, motion, through)
    return average_rows(rows, through.apply(whole.forces), weights, spread, number_cells(samples.t, width))


def average_power(
    robot: Engine, motion: Motion, samples: Measurements, terms: Sequence[DriveTerm], width: float, band: float
) -> CellAverages:
    """Average the filtered balance of energy over cells of half a width in s; the forces have a band in Hz."""
    if robot.mechanism.floats or motion.base_curve is not None:
        raise JounceError(f"{POWER} needs a base at rest: the wrench on it has power too; use {MOMENTUM}")
    measured = samples.weights.max(axis=0) > 0
    if not measured.all():
        names = force_names(robot.mechanism)
        absent = join_names(name for name, there in zip(names, measured, strict=True) if not there)
        raise JounceError(f"{POWER} needs all forces, and {absent} is not measured; use {MOMENTUM}")
    through, qd = design_low_pass(samples.t, 2 * band), motion(samples.t, 1)[1]
    whole, missing = _bridge_gaps(samples, through.cutoff)
    present = _settled_samples(missing.max(axis=1, keepdims=True), through)
    variance = through.apply((qd**2 / whole.weights).sum(axis=1, keepdims=True)).clip(0)  # by that of each force
    weights = present / (variance + (MIN_POWER_VARIANCE_RATIO * variance.mean() or 1.0))
    rows = filter_rows(energy_balance, robot, motion, terms, through)
    right = through.apply((qd * whole.forces).sum(axis=1, keepdims=True))
    spread = (qd**2 * _momentum_variances(robot, motion, through)).sum(axis=1, keepdims=True)
    return average_rows(rows, right, weights, spread, number_cells(samples.t, width / 2))


def _bridge_gaps(samples: Measurements, cutoff: float) -> tuple[Measurements, np.ndarray]:
    """Measurements with lines over gaps of each force, and which of them (N, nv) are in gaps too long for that."""
    t, forces, weights = samples.t, samples.forces.copy(), samples.weights.copy()
    missing = weights == 0
    for j in np.flatnonzero(weights.any(axis=0)):
        there = ~missing[:, j]
        known = t[there]
        forces[:, j], weights[:, j] = (np.interp(t, known, x[there, j]) for x in (forces, weights))
        later = np.searchsorted(known, t)
        gap = np.append(known, np.inf)[later] - np.append(-np.inf, known)[later]
        missing[:, j] &= gap * cutoff > MAX_GAP_TIME_CONSTANTS
    return Measurements(t, forces, weights), missing


def _settled_samples(missing: np.ndarray, through: LowPass) -> np.ndarray:
    """Which of the filtered samples hold next to nothing of missing ones."""
    return (through.apply(missing.astype(float)) < MAX_MISSING_SHARE) & ~missing


def _momentum_variances(robot: Engine, motion: Motion, through: LowPass) -> np.ndarray:
    """Variances (N, nv) of the filtered rate of the momentum that follow from those of the positions."""
    w, t = through.cutoff, through.t
    free = replace(motion, loads={})  # wrenches do not enter
    deviations = forces_along(robot, free, t, 0, None, None, find_row("generalized_momentum")).deviations
    if deviations is None:
        return np.zeros((len(t), robot.nv))
    variances = deviations[0] ** 2
    return w**2 * (variances + np.exp(-2 * w * (t - t[0]))[:, None] * variances[0])


FILTERED_METHODS = {"momentum": average_momentum, "power": average_power}
