"""Measured forces that are not what they should be: of another sign or unit, missing, constant, unexplained."""

from collections.abc import Sequence

import numpy as np

from jounce.core.cures import Remedy
from jounce.core.errors import join_names, shorten
from jounce.identification.least_squares_problem import IdentificationProblem
from jounce.identification.regression import MIN_RELATIVE_DEVIATION
from jounce.identification.result_tables import ForceResidual
from jounce.model.coordinates import force_names

MAX_OPPOSED_CORRELATION = -0.5  # of measured forces with those of the model: below it their sign is suspected
MIN_SIMILAR_CORRELATION = 0.8  # of the same: above it their sizes are compared
MAX_SIZE_RATIO = 10.0  # of these sizes, beyond which the unit is suspected: no parameters are that wrong
MAX_UNEXPLAINED_SHARE = 0.5  # of a force: what remains beyond it is more than friction or noise
MAX_PASSIVE_SHARE = 0.1  # of a force to the forces of single parameters, of which no motor makes them cancel
MAX_FREE_SHARE = 0.05  # of all forces to those of single parameters: no motor acts


def force_warnings(posed: IdentificationProblem) -> list[str]:
    """Return what is suspicious about measured forces next to the forces of the model."""
    names, cells = force_names(posed.robot.mechanism), posed.cells
    return [*_missing_forces(posed, names), *compare_forces(names, cells.counts, cells.off + cells.model, cells.model)]


def free_swing_warnings(posed: IdentificationProblem) -> list[str]:
    """Return what to know of logs whose forces are all next to nothing: parameters times any factor explain them."""
    cells, model = posed.cells, posed.model_parameters[posed.places]
    measured = np.sqrt(((cells.off + cells.model) ** 2).mean(axis=0))
    parts = posed.single_forces(model)
    if not (measured < MAX_FREE_SHARE * parts).all():
        return []
    share = float((measured / parts).max())
    return [
        f"measured forces are at most {share:.2g} of what single parameters make: a free swing determines ratios, and"
        " their size only by the rotors and friction that the model states; expected a log with torques of a motor"
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
    if posed.errors.variances.any():
        of_parts = dict(zip(names, posed.single_forces(parameters), strict=True))
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
        f"{Remedy('', ' (--plot shows them)')}"
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


def compare_forces(names: tuple[str, ...], weights: np.ndarray, measured: np.ndarray, model: np.ndarray) -> list[str]:
    """What is said of their sign and unit, by the correlation of measured forces (N, nv) with those of the model."""
    shared = (weights * measured * model).sum(axis=0)
    of_model = (weights * model**2).sum(axis=0)
    of_forces = (weights * measured**2).sum(axis=0)
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
