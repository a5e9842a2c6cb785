"""adam on JAX, under `jit` as its README advises; its base stands at the origin, at rest."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from adam.jax import KinDynComputations

from benchmarks.rivals import under_jax
from benchmarks.rivals.arms import GRAVITY, Arm
from benchmarks.rivals.tasks import Call


class Library:
    """A robot of adam."""

    def __init__(self, arm: Arm) -> None:
        self.arm = arm
        gravity = jnp.array([0, 0, GRAVITY, 0, 0, 0])
        self.robot = KinDynComputations(arm.path, list(arm.joints), gravity=gravity)

    def forces(self, x: Sequence[np.ndarray]) -> Call:
        """Q."""
        return under_jax.compiled(under_jax.with_rates(self._forces, 0, 3), x)

    def force_rates(self, x: Sequence[np.ndarray]) -> Call:
        """Q, Qd, Q2d, by differentiating along the motion."""
        return under_jax.compiled(under_jax.with_rates(self._forces, 2, 3), x)

    def mass_matrix(self, x: Sequence[np.ndarray]) -> Call:
        """M."""
        return under_jax.compiled(under_jax.with_rates(self._mass_matrix, 0, 1), x)

    def mass_matrix_rates(self, x: Sequence[np.ndarray]) -> Call:
        """M, Md, M2d, by differentiating along the motion."""
        return under_jax.compiled(under_jax.with_rates(self._mass_matrix, 2, 1), x)

    def jacobian(self, x: Sequence[np.ndarray]) -> Call:
        """J."""
        return under_jax.compiled(under_jax.with_rates(self._jacobian, 0, 1), x)

    def jacobian_rate(self, x: Sequence[np.ndarray]) -> Call:
        """J and its rate."""
        return under_jax.compiled(under_jax.with_rates(self._jacobian, 1, 1), x)

    def accelerations(self, x: Sequence[np.ndarray]) -> Call:
        """Forward dynamics."""
        return under_jax.compiled(under_jax.with_rates(self._accelerations, 0, 3), x)

    def force_derivatives(self, x: Sequence[np.ndarray]) -> Call:
        """Derivatives of Q by q and qd."""
        return under_jax.compiled(under_jax.derivatives(self._forces, (0, 1)), x)

    def acceleration_derivatives(self, x: Sequence[np.ndarray]) -> Call:
        """Derivatives of accelerations by q, qd and Q."""
        return under_jax.compiled(under_jax.derivatives(self._accelerations, (0, 1, 2)), x)

    def _mass_matrix(self, q: jax.Array) -> jax.Array:
        return self.robot.mass_matrix(jnp.eye(4), q)[6:, 6:]

    def _bias(self, q: jax.Array, qd: jax.Array) -> jax.Array:
        return self.robot.bias_force(jnp.eye(4), q, jnp.zeros(6), qd)[6:]

    def _forces(self, q: jax.Array, qd: jax.Array, q2d: jax.Array) -> jax.Array:
        return self._mass_matrix(q) @ q2d + self._bias(q, qd)

    def _jacobian(self, q: jax.Array) -> jax.Array:
        J = self.robot.jacobian(self.arm.tip, jnp.eye(4), q)[:, 6:]
        return jnp.concatenate([J[3:], J[:3]])

    def _accelerations(self, q: jax.Array, qd: jax.Array, Q: jax.Array) -> jax.Array:
        return under_jax.solved(self._mass_matrix(q), Q - self._bias(q, qd))
