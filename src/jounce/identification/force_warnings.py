"""Measured forces that are not what they should be: of another sign or unit, missing, constant, late, unexplained.

Forces that pass another filter, another bus or another clock than positions are late. For each of some delays the
forces are read at times as much later, the same equations are solved, and what they leave is compared. Parameters adapt
to a delay, but cannot take the place of one.
"""

from collections.abc import Sequence

import numpy as np

from jounce.core.errors import join_names, shorten
from jounce.core.typing import Equations
from jounce.identification.averaging import number_cells, weighted_means
from jounce.identification.filtered_balances import FILTERED_METHODS
from jounce.identification.least_squares_problem import IdentificationProblem
from jounce.identification.measurements import Measurements
from jounce.identification.regression import MIN_RELATIVE_DEVIATION
from jounce.identification.result_tables import ForceResidual
from jounce.model.coordinates import force_names

MAX_OPPOSED_CORRELATION = -0.5  # of measured forces with those of the model: below it their sign is suspected
MIN_SIMILAR_CORRELATION = 0.8  # of the same: above it their sizes are compared
MAX_SIZE_RATIO = 10.0  # of these sizes, beyond which the unit is suspected: no parameters are that wrong
MAX_UNEXPLAINED_SHARE = 0.5  # of a force: what remains beyond it is more than friction or noise
MAX_PASSIVE_SHARE = 0.1  # of a force to the forces of single parameters, of which no motor makes them cancel
MAX_DELAY = 0.2  # s, beyond which forces and positions hardly come from one log
MAX_DELAY_SHARE = 0.1  # of the time that is used: the ends, which are left out, are twice as much
DELAY_COUNT = 81  # of the delays that are tried, 5 ms apart; odd, so that one of them is 0
MAX_REMAINDER_RATIO = 0.8  # of mean squares left with the best delay to those without one, for a delay to be reported
DELAY_RANK_TOLERANCE = 1e-9  # of singular values to the largest: directions with less hold no data


def force_warnings(posed: IdentificationProblem, method: Equations) -> list[str]:
    """Return what is suspicious about measured forces next to the forces of the model.

    Equations of momentum and power are integrals, in which no delay is looked for.
    """
    names = force_names(posed.robot.mechanism)
    return [
        *_missing_forces(posed, names),
        *_sign_and_unit(posed, names),
        *([] if method in FILTERED_METHODS else _delay_warning(posed)),
    ]


def unexplained_warnings(
    posed: IdentificationProblem, rows: Sequence[ForceResidual], parameters: np.ndarray
) -> list[str]:
    """Return which of the forces that were used the identified robot explains less than half of.

    Errors of the motion explain a part. A force that is next to nothing, as of a joint without a motor, is held against
    the forces of single parameters (P,), which nearly cancel.
    """
    used = [row for row in rows if row.part == "used"]
    least = MIN_RELATIVE_DEVIATION * max((max(row.measured, row.model) for row in used), default=0.0)
    names, sizes = force_names(posed.robot.mechanism), {row.force: row.measured for row in used}
    if posed.errors is not None and posed.errors.variances.any():
        parts = np.sqrt(((posed.cells.Y[..., posed.columns] * parameters) ** 2).sum(axis=-1).mean(axis=0))
        of_parts = dict(zip(names, parts, strict=True))
        sizes |= {name: of_parts[name] for name, x in sizes.items() if x < MAX_PASSIVE_SHARE * of_parts[name]}
    left = [
        row
        for row in used
        if row.identified**2 - row.motion_errors**2 > max(MAX_UNEXPLAINED_SHARE * sizes[row.force], least) ** 2
    ]
    if not left:
        return []
    worst = max(left, key=lambda row: row.identified)
    return [
        f"the identified robot does not explain the forces of {join_names(row.force for row in left)}: it leaves"
        f" {worst.identified:.3g} of {worst.measured:.3g} {worst.unit} of {shorten(worst.force)}; expected torques of"
        " these joints at these times: check the order of columns, times, gravity, wild samples and noise"
        " (--plot shows them)"
    ]


def _missing_forces(posed: IdentificationProblem, names: tuple[str, ...]) -> list[str]:
    """What is said of forces that are not measured, but for those on a base, and of sensors that stand still."""
    samples, model = posed.samples, posed.model[posed.used]
    there, joints = samples.weights > 0, np.arange(len(names)) >= len(names) - posed.robot.n
    missing = joints & ~there.any(axis=0)
    first = np.take_along_axis(samples.forces, there.argmax(axis=0)[None], axis=0)
    same = (~there | (samples.forces == first)).all(axis=0) & (there.sum(axis=0) > 1)
    varies = np.ptp(model, axis=0) > MIN_RELATIVE_DEVIATION * np.abs(model).max()
    found = []
    if missing.any():
        found.append(f"{_forces_of(names, missing)} are not measured: no column, NaN or a weight of 0")
    if (still := same & varies).any():
        cure = "expected measured ones: leave the columns of dead sensors out"
        found.append(f"{_forces_of(names, still)} are constant, and those of the model are not; {cure}")
    return found


def _delay_warning(posed: IdentificationProblem) -> list[str]:
    if (found := find_delay(posed)) is None:
        return []
    delay, ratio = found
    return [
        f"measured forces seem to come {1e3 * abs(delay):.3g} ms {'after' if delay > 0 else 'before'} the positions:"
        f" {np.sqrt(ratio):.0%} of what is unexplained would remain if they came together; expected one clock and one"
        " filter: shift the times of the forces (t=), or filter positions and forces alike"
    ]


def _sign_and_unit(posed: IdentificationProblem, names: tuple[str, ...]) -> list[str]:
    """What is said of their sign and unit, by the correlation of measured forces with those of the model."""
    cells = posed.cells
    measured = cells.off + cells.model
    shared = (cells.counts * measured * cells.model).sum(axis=0)
    of_model = (cells.counts * cells.model**2).sum(axis=0)
    of_forces = (cells.counts * measured**2).sum(axis=0)
    there = (of_model > 0) & (of_forces > 0)
    correlation = np.where(there, shared / np.sqrt(np.where(there, of_model * of_forces, 1.0)), 0.0)
    size = np.where(there, np.sqrt(of_forces / np.where(there, of_model, 1.0)), 1.0)
    alike = np.abs(correlation) > MIN_SIMILAR_CORRELATION
    found = []
    if (opposed := correlation < MAX_OPPOSED_CORRELATION).any():
        worst = correlation[opposed].min()
        why = f"their correlation with the model's is {worst:.2g}"
        cure = "expected Q = M q2d + C qd + Qgrav, which the drives exert on the robot"
        found.append(f"{_forces_of(names, opposed)} seem to have the wrong sign: {why}; {cure}")
    if (odd := alike & (np.abs(np.log(size)) > np.log(MAX_SIZE_RATIO))).any():
        ratio = float(np.exp(np.log(size[odd]).mean()))
        why = f"they are {ratio:.3g} times those of the model; expected N m or N at the joints, behind the gears"
        found.append(f"{_forces_of(names, odd)} seem to have the wrong unit: {why}")
    return found


def _forces_of(names: tuple[str, ...], which: np.ndarray) -> str:
    some = join_names(name for name, odd in zip(names, which, strict=True) if odd)
    return f"forces of {'all joints' if which.all() else some}"


def find_delay(posed: IdentificationProblem) -> tuple[float, float] | None:
    """Return how late measured forces are, s, and which share of what is left without a delay remains then.

    None if no delay explains a fifth of what is left. Forces that are early have a negative delay.
    """
    samples = posed.samples
    t, place = samples.t, number_cells(samples.t, posed.width)
    longest = min(MAX_DELAY, MAX_DELAY_SHARE * (t[-1] - t[0]))
    centres, there = weighted_means(t[:, None], np.ones((len(t), 1)), place)[0][:, 0], posed.cells.counts > 0
    inner = (centres > t[0] + longest) & (centres < t[-1] - longest)
    kept = there & inner[:, None]
    columns = posed.cells.Y[..., posed.columns][kept]
    if longest <= 0 or len(columns) <= 2 * columns.shape[1]:
        return None
    delays = np.linspace(-longest, longest, DELAY_COUNT)
    late = np.stack([_delayed_averages(samples, place, delay) for delay in delays])
    off = (late - posed.cells.model)[:, kept].T  # (rows, delays)
    force = np.nonzero(kept)[1]
    weights = np.sqrt(posed.cells.counts[kept])
    for _ in range(2):  # forces of all sizes alike at first, then as exact as they are found to be
        left = _remainders(columns * weights[:, None], off * weights[:, None])
        here = left[:, DELAY_COUNT // 2] ** 2
        means = np.bincount(force, here) / np.maximum(np.bincount(force), 1)
        if not (means[force] > 0).all():
            return None  # exactly explained
        weights = weights / np.sqrt(means[force])
    total = (left**2 / means[force][:, None]).sum(axis=0)
    best = int(total.argmin())
    ratio = float(total[best] / total[DELAY_COUNT // 2])
    return None if ratio > MAX_REMAINDER_RATIO else (float(delays[best]), ratio)


def _delayed_averages(samples: Measurements, place: np.ndarray, delay: float) -> np.ndarray:
    """The averages over cells of forces (N, nv) at times that are later by a delay."""
    read = np.zeros_like(samples.forces)
    for j in np.flatnonzero((samples.weights > 0).any(axis=0)):
        there = samples.weights[:, j] > 0
        read[:, j] = np.interp(samples.t + delay, samples.t[there], samples.forces[there, j])
    return weighted_means(read, samples.weights, place)[0]


def _remainders(columns: np.ndarray, right: np.ndarray) -> np.ndarray:
    """What least squares leaves of right sides."""
    U, sizes, _ = np.linalg.svd(columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300), full_matrices=False)
    U = U[:, sizes > DELAY_RANK_TOLERANCE * sizes[0]]
    return np.asarray(right - U @ (U.T @ right))
