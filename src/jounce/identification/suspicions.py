"""Measured forces that are not what they should be: of another sign or unit, missing, constant, or not explained."""

from collections.abc import Sequence

import numpy as np

from jounce.core.errors import listed, shortened
from jounce.core.typing import Equations
from jounce.identification.delay import find_delay
from jounce.identification.filtered import FILTERED
from jounce.identification.problem import Problem
from jounce.identification.regression import MIN_RELATIVE_DEVIATION
from jounce.identification.residuals import ForceResidual
from jounce.model.coordinates import force_names

MAX_OPPOSED_CORRELATION = -0.5  # of measured forces with those of the model: below it their sign is suspected
MIN_SIMILAR_CORRELATION = 0.8  # of the same: above it their sizes are compared
MAX_SIZE_RATIO = 10.0  # of these sizes, beyond which the unit is suspected: no parameters are that wrong
MAX_UNEXPLAINED_SHARE = 0.5  # of a force: what remains beyond it is more than friction or noise


def suspicions(posed: Problem, method: Equations) -> list[str]:
    """Return what is suspicious about measured forces next to the forces of the model.

    Equations of momentum and power are integrals, in which no delay is looked for.
    """
    names = force_names(posed.robot.mechanism)
    return [*_absent(posed, names), *_unlike(posed, names), *([] if method in FILTERED else _late(posed))]


def unexplained(rows: Sequence[ForceResidual]) -> list[str]:
    """Return which of the forces that were used the identified robot explains less than half of."""
    used = [row for row in rows if row.part == "used"]
    least = MIN_RELATIVE_DEVIATION * max((max(row.measured, row.model) for row in used), default=0.0)
    left = [row for row in used if row.identified > max(MAX_UNEXPLAINED_SHARE * row.measured, least)]
    if not left:
        return []
    worst = max(left, key=lambda row: row.identified)
    return [
        f"the identified robot does not explain the forces of {listed(row.force for row in left)}: it leaves"
        f" {worst.identified:.3g} of {worst.measured:.3g} {worst.unit} of {shortened(worst.force)}; expected torques of"
        " these joints at these times: check the order of columns, times, gravity, wild samples and noise"
        " (--plot shows them)"
    ]


def _absent(posed: Problem, names: tuple[str, ...]) -> list[str]:
    """What is said of forces that are not measured, but for those on a base, and of sensors that stand still."""
    samples, model = posed.given.part(posed.used), posed.model[posed.used]
    there, joints = samples.weights > 0, np.arange(len(names)) >= len(names) - posed.robot.n
    missing = joints & ~there.any(axis=0)
    first = np.take_along_axis(samples.forces, there.argmax(axis=0)[None], axis=0)
    same = (~there | (samples.forces == first)).all(axis=0) & (there.sum(axis=0) > 1)
    varies = np.ptp(model, axis=0) > MIN_RELATIVE_DEVIATION * np.abs(model).max()
    found = []
    if missing.any():
        found.append(f"forces of {_of(names, missing)} are not measured: no column, NaN or a weight of 0")
    if (still := same & varies).any():
        found.append(
            f"forces of {_of(names, still)} are constant, and those of the model are not; expected measured ones:"
            " leave the columns of dead sensors out"
        )
    return found


def _late(posed: Problem) -> list[str]:
    """What is said of a delay between forces and positions."""
    found = find_delay(posed)
    if found is None:
        return []
    delay, ratio = found
    return [
        f"measured forces seem to come {1e3 * abs(delay):.3g} ms {'after' if delay > 0 else 'before'} the positions:"
        f" {np.sqrt(ratio):.0%} of what is unexplained would remain if they came together; expected one clock and one"
        " filter: shift the times of the forces (t=), or filter positions and forces alike"
    ]


def _unlike(posed: Problem, names: tuple[str, ...]) -> list[str]:
    """What the correlation of measured forces with those of the model tells of their sign and unit."""
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
        found.append(
            f"forces of {_of(names, opposed)} seem to have the wrong sign: their correlation with the model's is"
            f" {worst:.2g}; expected Q = M q2d + C qd + Qgrav, which the drives exert on the robot"
        )
    if (odd := alike & (np.abs(np.log(size)) > np.log(MAX_SIZE_RATIO))).any():
        ratio = float(np.exp(np.log(size[odd]).mean()))
        found.append(
            f"forces of {_of(names, odd)} seem to have the wrong unit: they are {ratio:.3g} times those of the model;"
            " expected N m or N at the joints, behind the gears"
        )
    return found


def _of(names: tuple[str, ...], which: np.ndarray) -> str:
    return "all joints" if which.all() else listed(name for name, odd in zip(names, which, strict=True) if odd)
