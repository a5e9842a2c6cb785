"""Errors of the accelerations that a smoothed motion has, and the forces that they make.

The smoothed motion has accelerations a + e, and the forces are affine in them: those of the motion are off by M(p) e,
with the mass matrix M of the parameters p. Only accelerations are taken: errors of q and qd make far smaller forces.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

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

    def part(self, cells: slice | np.ndarray) -> "AccelerationErrors":
        """Those in some of the cells."""
        base = self.base and tuple(x[cells] for x in self.base)
        return replace(self, q=self.q[cells], base=base, variances=self.variances[cells])

    def regressor(self, a: np.ndarray) -> np.ndarray:
        """The regressor (C, nv, P) of accelerations (C, n) alone, of a robot at rest without gravity."""
        return self._regressor(a) - self._still

    def force_sizes(self, corrections: np.ndarray) -> np.ndarray:
        """Root mean squares (nv,) of the forces that they make, of the model with corrections (P,)."""
        return np.sqrt((self.mass_matrix(corrections) ** 2 @ self.variances[..., None])[..., 0].mean(axis=0))

    @cached_property
    def _still(self) -> np.ndarray:
        return self._regressor(np.zeros_like(self.q))

    def _regressor(self, a: np.ndarray) -> np.ndarray:
        """The regressor (C, nv, P) of a robot at rest with accelerations (C, n)."""
        states = (self.q, np.zeros_like(self.q), a)
        return np.asarray(regressor(self.robot, "regressor", states, self.terms, base=self.base))[..., self.columns]

    def mass_matrix(self, corrections: np.ndarray) -> np.ndarray:
        """The mass matrix (C, nv, n) of the model with corrections (P,) of its parameters."""
        units = np.eye(self.q.shape[1])
        added = [self.regressor(np.broadcast_to(unit, self.q.shape)) @ corrections for unit in units]
        return np.asarray(self._model_mass_matrix + np.stack(added, axis=-1))

    @cached_property
    def _model_mass_matrix(self) -> np.ndarray:
        M = compute(self.robot, "mass_matrix", (self.q,), base=self.base and self.base[:1])
        return np.asarray(M)[..., -self.q.shape[1] :]


def find_acceleration_errors(
    robot: Engine,
    motion: Motion,
    t: np.ndarray,
    place: np.ndarray,
    terms: tuple[DriveTerm, ...],
    columns: np.ndarray,
    deviations: tuple[np.ndarray, ...] | None,
) -> AccelerationErrors | None:
    """The errors of the accelerations at times (N,) in cells of numbers (N,), by deviations of q, qd, q2d (N, n) each.

    None of a motion that is exact.
    """
    if deviations is None or not deviations[2].any():
        return None
    ones = np.ones_like(deviations[2])
    middles = weighted_means(t[:, None], ones[:, :1], place)[0][:, 0]
    variances = weighted_means(deviations[2] ** 2, ones, place)[0]
    base = motion.base(middles, 0)
    still = base and (base[0], *np.zeros((2, len(middles), 6)))
    return AccelerationErrors(robot, terms, columns, motion(middles, 0)[0], still, variances)


def join_errors(of_logs: Sequence[AccelerationErrors | None], counts: Sequence[int]) -> AccelerationErrors | None:
    """The errors in the cells of all logs, of which there are some counts; None if all motions are exact.

    Poses of another log stand for those of exact motions, whose variances are 0: no covariance depends on them.
    """
    some = next((errors for errors in of_logs if errors is not None), None)
    if some is None:
        return None
    whole = []
    for errors, count in zip(of_logs, counts, strict=True):
        found = errors or some.part(np.arange(count) % len(some.q))
        base = found.base or (np.tile(np.eye(4), (count, 1, 1)), *np.zeros((2, count, 6)))
        whole.append((found.q, found.variances if errors else 0 * found.variances, *base))
    q, variances, *base = map(np.concatenate, zip(*whole, strict=True))
    moves = any(errors is not None and errors.base is not None for errors in of_logs)
    return replace(some, q=q, variances=variances, base=tuple(base) if moves else None)


def error_band(deviations: tuple[np.ndarray, ...] | None) -> float:
    """The frequency in Hz that errors of a motion with deviations of q, qd, q2d reach; infinite of an exact motion.

    Of white noise up to f they are in the ratio of roots of the integrals of 1 and (2 pi f)^4: 1 to (2 pi f)^2 / 5^1/2.
    """
    if deviations is None:
        return np.inf
    q, q2d = (np.median(deviations[k], axis=0) for k in (0, 2))
    moving = (q > 0) & (q2d > 0)
    return float(np.sqrt(np.sqrt(5) * q2d[moving] / q[moving]).max() / (2 * np.pi)) if moving.any() else np.inf
