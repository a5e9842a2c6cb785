"""State what errors of accelerations and of encoders do to forces.

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
from jounce.engine.drives import compute_regressor
from jounce.engine.engine import Engine
from jounce.engine.plan import compute
from jounce.identification.averaging import weighted_means
from jounce.motion import resmoothing
from jounce.motion.motion import Motion

MIN_NAMED_SHARE = 0.25  # of a parameter's variance that an offset makes, where it is named: half of the deviation


@dataclass(frozen=True, eq=False)
class AccelerationErrors:
    """Variances of n accelerations in C cells, and how they reach forces.

    The regression asks for a mass matrix and a regressor in each reweighting; what does not depend on its parameters is
    kept.
    """

    robot: Engine
    terms: tuple[DriveTerm, ...]
    columns: np.ndarray  # (P,) of the regressor, those of the parameters
    q: np.ndarray  # (C, n) in the middle of the cells
    variances: np.ndarray  # (C, n)
    trusted: np.ndarray  # (C,) cells that are not in the uncertain ends of a smoothing

    def part(self, cells: slice | np.ndarray) -> "AccelerationErrors":
        """Return the errors in some of the cells."""
        return replace(self, q=self.q[cells], variances=self.variances[cells], trusted=self.trusted[cells])

    def regressor(self, a: np.ndarray) -> np.ndarray:
        """Return the regressor of accelerations (C, n) alone, without gravity: (C, nv, P)."""
        # Forces are affine in accelerations: the difference is linear, and of gravity and friction nothing is left.
        return self._regressor(a) - self._regressor_at_rest

    @cached_property
    def _regressor_at_rest(self) -> np.ndarray:
        return self._regressor(np.zeros_like(self.q))

    def _regressor(self, a: np.ndarray) -> np.ndarray:
        """Return the regressor (C, nv, P) at accelerations (C, n), without velocities."""
        states = (self.q, np.zeros_like(self.q), a)
        return np.asarray(compute_regressor(self.robot, "regressor", states, self.terms, base=self._base))[
            ..., self.columns
        ]

    @property
    def _base(self) -> tuple[np.ndarray, ...] | None:
        """The pose, twist and acceleration of a base at rest, or None.

        What accelerations of the joints add to forces, in the axes of the base, does not depend on its pose.
        """
        if not self.robot.mechanism.floats:
            return None
        C = len(self.q)
        return (np.tile(np.eye(4), (C, 1, 1)), *np.zeros((2, C, 6)))

    def mass_matrix(self, corrections: np.ndarray) -> np.ndarray:
        """Return the mass matrix of the model with corrections (P,): (C, nv, n)."""
        # M is linear in the parameters: its column j is the force by a unit of acceleration j alone.
        units = np.eye(self.q.shape[1])
        added = [self.regressor(np.broadcast_to(unit, self.q.shape)) @ corrections for unit in units]
        return np.asarray(self._model_mass_matrix + np.stack(added, axis=-1))

    @cached_property
    def _model_mass_matrix(self) -> np.ndarray:
        pose = None if self._base is None else self._base[:1]
        M = compute(self.robot, "mass_matrix", (self.q,), base=pose)
        # Accelerations of a base are not among the errors: columns of joints are left, (C, nv, nv) -> (C, nv, n).
        return np.asarray(M)[..., -self.q.shape[1] :]


def find_acceleration_errors(
    robot: Engine,
    motion: Motion,
    cells: tuple[np.ndarray, np.ndarray],
    terms: tuple[DriveTerm, ...],
    *,
    columns: np.ndarray,
    deviations: tuple[np.ndarray, ...] | None,
) -> AccelerationErrors:
    """Find the errors of the accelerations in cells.

    Cells are times (N,) and the numbers (N,) of their cells. Errors follow from deviations of q, qd, q2d (N, n) each;
    those of an exact motion have variances 0.
    """
    t, place = cells
    ones = np.ones((len(t), 1))
    middle = weighted_means(t[:, None], ones, place)[0][:, 0]
    q, (first, last) = motion(middle, 0)[0], resmoothing.trusted_span(motion)
    trusted = (middle >= first) & (middle <= last)
    # Errors are hardly faster than cells: that of an average is as large as those of its samples.
    variances = np.zeros_like(q)
    if deviations is not None:
        variances = weighted_means(deviations[2] ** 2, ones, place)[0]
    return AccelerationErrors(robot, terms, columns, q, variances, trusted)


def join_errors(of_logs: Sequence[AccelerationErrors]) -> AccelerationErrors:
    """Join the errors in the cells of all logs."""
    names = ("q", "variances", "trusted")
    q, variances, trusted = (np.concatenate([getattr(errors, name) for errors in of_logs]) for name in names)
    return replace(of_logs[0], q=q, variances=variances, trusted=trusted)


def error_band(deviations: tuple[np.ndarray, ...] | None) -> float:
    """Return the frequency that errors reach, by deviations of q, qd, q2d.

    It is in Hz, and infinite of an exact motion. Of white noise up to f, deviations of q and q2d are in the ratio of
    the roots of the integrals of 1 and (2 pi f)^4: 1 to (2 pi f)^2 / 5^1/2.
    """
    if deviations is None:
        return np.inf
    # The median over the times leaves the ends of a smoothing out, where deviations grow.
    q, q2d = (np.median(deviations[k], axis=0) for k in (0, 2))
    uncertain = (q > 0) & (q2d > 0)
    if not uncertain.any():
        return np.inf
    return float(np.sqrt(np.sqrt(5) * q2d[uncertain] / q[uncertain]).max() / (2 * np.pi))


# Constant offsets of encoders.
@dataclass(frozen=True, eq=False)
class EncoderOffsets:
    """The states of a robot in C cells, with deviations of offsets."""

    robot: Engine
    terms: tuple[DriveTerm, ...]
    columns: np.ndarray  # (P,) of the regressor, of the sought parameters
    parameters: np.ndarray  # of all columns, as the model has them
    states: tuple[np.ndarray, ...]  # q, qd, q2d (C, n) in the middle of the cells
    base: tuple[np.ndarray, ...] | None
    deviations: np.ndarray  # (n,) of the offsets: half the steps of the positions

    def forces(self, corrections: np.ndarray) -> np.ndarray:
        """Return the forces by one deviation of each joint's offset: (C, nv, n)."""
        p = self.parameters.copy()
        p[self.columns] += corrections
        C, n = self.states[0].shape
        changes = np.zeros((C, self.robot.nv, n))
        if self.deviations.any():
            # One joint at a time; the difference to the forces without an offset is dQ/dq_j times half a step.
            forces = self._forces(p, 0.0)
            for j in np.flatnonzero(self.deviations):
                changes[..., j] = self._forces(p, self.deviations * (np.arange(n) == j)) - forces
        return changes

    def _forces(self, p: np.ndarray, offset: np.ndarray | float) -> np.ndarray:
        """Return the forces of all parameters at positions with an offset: (C, nv)."""
        q, *rates = self.states
        return np.asarray(
            compute_regressor(self.robot, "regressor", (q + offset, *rates), self.terms, base=self.base) @ p
        )


def find_offsets(
    robot: Engine,
    motion: Motion,
    cells: tuple[np.ndarray, np.ndarray],
    terms: tuple[DriveTerm, ...],
    *,
    columns: np.ndarray,
    parameters: np.ndarray,
) -> EncoderOffsets:
    """Find the offsets of encoders in cells.

    Cells are times (N,) and the numbers (N,) of their cells. Deviations are 0 of positions without steps.
    """
    t, place = cells
    # Offsets are constant, so that the state in the middle of each cell says what they do there.
    middle = weighted_means(t[:, None], np.ones((len(t), 1)), place)[0][:, 0]
    states, base = tuple(motion(middle, 2)), motion.base(middle, 2)
    n = states[0].shape[1]
    # Columns of balls and planar joints are not those of q: their steps are no steps of one coordinate.
    steps = np.zeros(n)
    if not motion.several and motion.curve.columns == n:
        steps = resmoothing.position_steps(motion)
    return EncoderOffsets(robot, terms, columns, parameters, states, base, steps / 2)


def offset_notes(names: Sequence[str], joints: Sequence[str], shares: np.ndarray) -> list[str]:
    """Name joints whose offsets make most of a deviation: by shares (P, n) in variances."""
    large = shares > MIN_NAMED_SHARE
    if not large.any():
        return []
    encoders = join_names(np.array(joints)[large.any(axis=0)])
    parameters = join_names(np.array(names)[large.any(axis=1)])
    what = f"half a step of the encoder of {encoders} makes more than half of the deviation of {parameters}"
    return [f"{what}: no fit sees whether it floors or rounds; a finer encoder would do"]
