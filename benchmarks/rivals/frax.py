"""frax under `jit`, with the settings that its README recommends for a CPU."""

from collections.abc import Sequence

import frax
import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.rivals import under_jax
from benchmarks.rivals.arms import GRAVITY, Arm
from benchmarks.rivals.tasks import Call

UP = (0.0, 0.0, -GRAVITY, 0.0, 0.0, 0.0)  # the acceleration (linear; angular) of the ground that acts as gravity


class Library:
    """A robot of frax; a chain without branches has Jacobians of its last link."""

    def __init__(self, arm: Arm) -> None:
        kind = frax.Manipulator if arm.name != "g1" else frax.Robot
        self.robot = kind(arm.path, joint_ordering=list(arm.joints))
        if kind is frax.Robot:
            self.jacobian = self.jacobian_rate = None

    def forces(self, x: Sequence[np.ndarray]) -> Call:
        """Q."""
        return under_jax.compiled(under_jax.with_rates(self._forces, 0, 3), x)

    def force_rates(self, x: Sequence[np.ndarray]) -> Call:
        """Q, Qd, Q2d, by differentiating along the motion."""
        return under_jax.compiled(under_jax.with_rates(self._forces, 2, 3), x)

    def mass_matrix(self, x: Sequence[np.ndarray]) -> Call:
        """M."""
        return under_jax.compiled(under_jax.with_rates(self.robot.mass_matrix, 0, 1), x)

    def mass_matrix_rates(self, x: Sequence[np.ndarray]) -> Call:
        """M, Md, M2d, by differentiating along the motion."""
        return under_jax.compiled(under_jax.with_rates(self.robot.mass_matrix, 2, 1), x)

    def jacobian(self, x: Sequence[np.ndarray]) -> Call:
        """J."""
        return under_jax.compiled(lambda q: (_swapped(self.robot.ee_jacobian(q)),), x)

    def jacobian_rate(self, x: Sequence[np.ndarray]) -> Call:
        """J and its rate."""
        return under_jax.compiled(lambda q, qd: tuple(map(_swapped, self.robot.ee_jacobian_and_derivative(q, qd))), x)

    def accelerations(self, x: Sequence[np.ndarray]) -> Call:
        """Forward dynamics."""
        return under_jax.compiled(under_jax.with_rates(self._accelerations, 0, 3), x)

    def force_derivatives(self, x: Sequence[np.ndarray]) -> Call:
        """Derivatives of Q by q and qd."""
        return under_jax.compiled(under_jax.derivatives(self._forces, (0, 1)), x)

    def acceleration_derivatives(self, x: Sequence[np.ndarray]) -> Call:
        """Derivatives of accelerations by q, qd and Q."""
        return under_jax.compiled(under_jax.derivatives(self._accelerations, (0, 1, 2)), x)

    def second_derivatives(self, x: Sequence[np.ndarray]) -> Call:
        """All second derivatives of Q."""
        return under_jax.compiled(under_jax.second_derivatives(self._forces), x)

    def _forces(self, q: jax.Array, qd: jax.Array, q2d: jax.Array) -> jax.Array:
        return self.robot.rnea(q, qd, q2d, jnp.array(UP), None)

    def _accelerations(self, q: jax.Array, qd: jax.Array, Q: jax.Array) -> jax.Array:
        return under_jax.solved(self.robot.mass_matrix(q), Q - self.robot.rnea(q, qd, None, jnp.array(UP), None))


def _swapped(J: jax.Array) -> jax.Array:
    """Return (linear; angular) as (angular; linear)."""
    return jnp.concatenate([J[3:], J[:3]])
