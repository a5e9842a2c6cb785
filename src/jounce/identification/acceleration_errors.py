"""Errors of the accelerations that a smoothed motion has, and the forces that they make.

The smoothed motion has accelerations a + e, and the forces are affine in them: those of the motion are off by M(p) e,
with the mass matrix M of the parameters p. Only accelerations are taken: errors of q and qd make far smaller forces.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from jounce.core.typing import DriveTerm
from jounce.engine.drives import regressor
from jounce.engine.engine import Engine
from jounce.engine.plan import compute
from jounce.identification.averaging import weighted_means
from jounce.motion.motion import Motion
from jounce.motion.resmoothing import trusted_span


@dataclass(frozen=True, eq=False)
class AccelerationErrors:
    """Variances of n accelerations in C cells of time, and the robot through which they reach nv forces."""

    robot: Engine
    terms: tuple[DriveTerm, ...]
    columns: np.ndarray  # (P,) of the regressor, those of the parameters
    q: np.ndarray  # (C, n) in the middle of the cells
    variances: np.ndarray  # (C, n)
    trusted: np.ndarray  # (C,) cells that are not in the uncertain ends of a smoothing

    def part(self, cells: slice | np.ndarray) -> "AccelerationErrors":
        """Those in some of the cells."""
        return replace(self, q=self.q[cells], variances=self.variances[cells], trusted=self.trusted[cells])

    def regressor(self, a: np.ndarray) -> np.ndarray:
        """The regressor (C, nv, P) of accelerations (C, n) alone, of a robot at rest without gravity."""
        return self._regressor(a) - self._still

    @cached_property
    def _still(self) -> np.ndarray:
        return self._regressor(np.zeros_like(self.q))

    def _regressor(self, a: np.ndarray) -> np.ndarray:
        """The regressor (C, nv, P) of a robot at rest with accelerations (C, n)."""
        states = (self.q, np.zeros_like(self.q), a)
        return np.asarray(regressor(self.robot, "regressor", states, self.terms, base=self._base))[..., self.columns]

    @property
    def _base(self) -> tuple[np.ndarray, ...] | None:
        """A base that floats, at rest: what accelerations add to forces in its own axes does not depend on its pose."""
        C = len(self.q)
        return (np.tile(np.eye(4), (C, 1, 1)), *np.zeros((2, C, 6))) if self.robot.mechanism.floats else None

    def mass_matrix(self, corrections: np.ndarray) -> np.ndarray:
        """The mass matrix (C, nv, n) of the model with corrections (P,) of its parameters."""
        units = np.eye(self.q.shape[1])
        added = [self.regressor(np.broadcast_to(unit, self.q.shape)) @ corrections for unit in units]
        return np.asarray(self._model_mass_matrix + np.stack(added, axis=-1))

    @cached_property
    def _model_mass_matrix(self) -> np.ndarray:
        M = compute(self.robot, "mass_matrix", (self.q,), base=self._base and self._base[:1])
        return np.asarray(M)[..., -self.q.shape[1] :]


def find_acceleration_errors(
    robot: Engine,
    motion: Motion,
    t: np.ndarray,
    place: np.ndarray,
    terms: tuple[DriveTerm, ...],
    columns: np.ndarray,
    deviations: tuple[np.ndarray, ...] | None,
) -> AccelerationErrors:
    """The errors of the accelerations at times (N,) in cells of numbers (N,), by deviations of q, qd, q2d (N, n) each.

    Those of a motion that is exact have variances 0.
    """
    ones = np.ones((len(t), 1))
    middle = weighted_means(t[:, None], ones, place)[0][:, 0]
    q, (first, last) = motion(middle, 0)[0], trusted_span(motion)
    trusted = (middle >= first) & (middle <= last)
    variances = np.zeros_like(q) if deviations is None else weighted_means(deviations[2] ** 2, ones, place)[0]
    return AccelerationErrors(robot, terms, columns, q, variances, trusted)


def join_errors(of_logs: Sequence[AccelerationErrors]) -> AccelerationErrors:
    """The errors in the cells of all logs."""
    names = ("q", "variances", "trusted")
    q, variances, trusted = (np.concatenate([getattr(errors, name) for errors in of_logs]) for name in names)
    return replace(of_logs[0], q=q, variances=variances, trusted=trusted)


def error_band(deviations: tuple[np.ndarray, ...] | None) -> float:
    """The frequency in Hz that errors of a motion with deviations of q, qd, q2d reach; infinite of an exact motion.

    Of white noise up to f they are in the ratio of roots of the integrals of 1 and (2 pi f)^4: 1 to (2 pi f)^2 / 5^1/2.
    """
    if deviations is None:
        return np.inf
    q, q2d = (np.median(deviations[k], axis=0) for k in (0, 2))
    moving = (q > 0) & (q2d > 0)
    return float(np.sqrt(np.sqrt(5) * q2d[moving] / q[moving]).max() / (2 * np.pi)) if moving.any() else np.inf
