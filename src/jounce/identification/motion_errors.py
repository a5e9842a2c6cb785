"""Say what errors of a motion do to forces: of accelerations, and of encoders.

The smoothed motion has accelerations a + e, and the forces are affine in them: those of the motion are off by M(p) e,
with the mass matrix M of the parameters p (`AccelerationErrors`). Only accelerations are taken: errors of q and qd that
differ from sample to sample make far smaller forces.

Constant errors of q are another matter (`EncoderOffsets`). An encoder that floors reports positions that are half a
step low on average, one that rounds does not, and one whose zero lies anywhere between two steps is up to half a step
off. Parameters adapt: a robot whose gravity is turned by the offset makes the same forces, so that no fit can see which
it is. Each joint has an offset of mean 0 and a standard deviation of half its step, the same in all logs: errors of
flooring encoders are one deviation of it, and those of all others less. Parameters change by it as by the forces that
it makes, dQ/dq_j times half a step (see `Regression`).

Both are found once per log, in cells of time; the regression asks for mass matrices in each of its rounds, and for the
forces of offsets once, at its end.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from jounce.core.errors import join_names
from jounce.core.typing import DriveTerm
from jounce.engine.drives import regressor
from jounce.engine.engine import Engine
from jounce.engine.plan import compute
from jounce.identification.averaging import weighted_means
from jounce.motion import resmoothing
from jounce.motion.motion import Motion

MIN_NAMED_SHARE = 0.25  # of a parameter's variance that an offset makes, where it is named: half of the deviation


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
    q, (first, last) = motion(middle, 0)[0], resmoothing.trusted_span(motion)
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


# Constant offsets of encoders.
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
    steps = resmoothing.position_steps(motion) if not motion.several and motion.curve.columns == n else np.zeros(n)
    return EncoderOffsets(robot, terms, columns, parameters, states, base, steps / 2)


def offset_notes(names: Sequence[str], joints: Sequence[str], shares: np.ndarray) -> list[str]:
    """What is said where offsets make most of deviations: of the shares (P, n) of joints in parameters' variances."""
    large = shares > MIN_NAMED_SHARE
    if not large.any():
        return []
    of, which = (join_names(np.array(x)[large.any(axis=k)]) for x, k in ((joints, 0), (names, 1)))
    what = f"half a step of the encoder of {of} makes more than half of the deviation of {which}"
    return [f"{what}: no fit sees whether it floors or rounds; a finer encoder would do"]
