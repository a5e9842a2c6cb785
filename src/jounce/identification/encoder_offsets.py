"""What constant offsets of positions, of half a step of their encoders, change in identified parameters.

An encoder that floors reports positions that are half a step low on average, one that rounds does not, and one whose
zero lies anywhere between two steps is up to half a step off. Parameters adapt: a robot whose gravity is turned by the
offset makes the same forces, so that no fit can see which it is. Each joint has an offset of mean 0 and a standard
deviation of half its step, the same in all logs: errors of flooring encoders are one deviation of it, and those of all
others less. Parameters change by it as by the forces that it makes, dQ/dq_j times half a step (see `Regression`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jounce.core.errors import join_names
from jounce.core.typing import DriveTerm
from jounce.engine.drives import regressor
from jounce.engine.engine import Engine
from jounce.identification.averaging import weighted_means
from jounce.motion.motion import Motion
from jounce.motion.resmoothing import position_steps

MIN_NAMED_SHARE = 0.25  # of a parameter's variance that an offset makes, where it is named: half of the deviation


@dataclass(frozen=True, eq=False)
class EncoderOffsets:
    """The states of a robot in C cells of time of a log, and half the steps of its n positions."""

    robot: Engine
    terms: tuple[DriveTerm, ...]
    columns: np.ndarray  # (P,) of the regressor, those that are sought
    parameters: np.ndarray  # of all columns, as the model has them
    states: tuple[np.ndarray, ...]  # q, qd, q2d (C, n) in the middle of the cells
    base: tuple[np.ndarray, ...] | None
    deviations: np.ndarray  # (n,)

    def forces(self, corrections: np.ndarray) -> np.ndarray:
        """The forces (C, nv, n) that the offset of each joint makes, of the model with corrections (P,)."""
        p = self.parameters.copy()
        p[self.columns] += corrections
        C, n = self.states[0].shape
        made = np.zeros((C, self.robot.nv, n))
        if self.deviations.any():
            here = self._forces(p, 0.0)
            for j in np.flatnonzero(self.deviations):
                made[..., j] = self._forces(p, self.deviations * (np.arange(n) == j)) - here
        return made

    def _forces(self, p: np.ndarray, offset: np.ndarray | float) -> np.ndarray:
        """The forces (C, nv) of all parameters at positions with an offset."""
        q, *rates = self.states
        return np.asarray(regressor(self.robot, "regressor", (q + offset, *rates), self.terms, base=self.base) @ p)


def find_offsets(
    robot: Engine,
    motion: Motion,
    cells: tuple[np.ndarray, np.ndarray],
    terms: tuple[DriveTerm, ...],
    columns: np.ndarray,
    parameters: np.ndarray,
) -> EncoderOffsets:
    """The offsets in cells, of times (N,) and the numbers (N,) of their cells; 0 of positions without steps."""
    t, place = cells
    middle = weighted_means(t[:, None], np.ones((len(t), 1)), place)[0][:, 0]
    states, base = tuple(motion(middle, 2)), motion.base(middle, 2)
    n = states[0].shape[1]
    # columns of balls and planar joints are not those of q
    steps = position_steps(motion) if not motion.several and motion.curve.columns == n else np.zeros(n)
    return EncoderOffsets(robot, terms, columns, parameters, states, base, steps / 2)


def offset_notes(names: Sequence[str], joints: Sequence[str], shares: np.ndarray) -> list[str]:
    """What is said where offsets make most of deviations: of the shares (P, n) of joints in parameters' variances."""
    large = shares > MIN_NAMED_SHARE
    if not large.any():
        return []
    of, which = (join_names(np.array(x)[large.any(axis=k)]) for x, k in ((joints, 0), (names, 1)))
    what = f"half a step of the encoder of {of} makes more than half of the deviation of {which}"
    return [f"{what}: no fit sees whether it floors or rounds; a finer encoder would do"]
