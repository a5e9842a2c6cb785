"""Errors of the accelerations that a smoothed motion has, and the forces that they make.

The smoothed motion has accelerations a + e, and the forces are affine in them: those of the motion are off by M(p) e,
with the mass matrix M of the parameters p. Only accelerations are taken: errors of q and qd make far smaller forces.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jounce.core.typing import DriveTerm
from jounce.engine.dispatch import compute
from jounce.engine.drives import regressor
from jounce.engine.engine import Engine
from jounce.identification.averaging import weighted_means
from jounce.motion.motion import Motion


@dataclass(frozen=True, eq=False)
class AccelerationErrors:
    """Variances of n accelerations in C cells of time, and the robot through which they reach nv forces."""

    robot: Engine
    terms: tuple[DriveTerm, ...]
    columns: np.ndarray  # (P,) of the regressor, those of the parameters
    q: np.ndarray  # (C, n) in the middle of the cells
    base: tuple[np.ndarray, ...] | None  # pose of the base there, at rest
    variances: np.ndarray  # (C, n)

    def regressor(self, a: np.ndarray) -> np.ndarray:
        """The regressor (C, nv, P) of accelerations (C, n) alone, of a robot at rest without gravity."""
        rest = np.zeros_like(self.q)
        moving, still = (
            regressor(self.robot, "regressor", (self.q, rest, x), self.terms, base=self.base) for x in (a, rest)
        )
        return np.asarray(moving - still)[..., self.columns]

    def mass_matrix(self, corrections: np.ndarray) -> np.ndarray:
        """The mass matrix (C, nv, n) of the model with corrections (P,) of its parameters."""
        model = np.asarray(compute(self.robot, "mass_matrix", (self.q,), base=self.base and self.base[:1]))
        units = np.eye(self.q.shape[1])
        added = [self.regressor(np.broadcast_to(unit, self.q.shape)) @ corrections for unit in units]
        return np.asarray(model[..., -len(units) :] + np.stack(added, axis=-1))


def find_acceleration_errors(
    robot: Engine,
    motion: Motion,
    t: np.ndarray,
    place: np.ndarray,
    terms: tuple[DriveTerm, ...],
    columns: Sequence[int] | np.ndarray,
) -> AccelerationErrors | None:
    """The errors of the accelerations at times (N,) in cells of numbers (N,); None of a motion that is exact."""
    deviations = motion.deviations(t, 2)
    if deviations is None or not deviations[2].any():
        return None
    ones = np.ones((len(t), 1))
    middles = weighted_means(t[:, None], ones, place)[0][:, 0]
    variances = weighted_means(deviations[2] ** 2, np.broadcast_to(ones, deviations[2].shape), place)[0]
    base = motion.base(middles, 0)
    still = base and (base[0], *np.zeros((2, len(middles), 6)))
    return AccelerationErrors(robot, terms, np.asarray(columns), motion(middles, 0)[0], still, variances)
