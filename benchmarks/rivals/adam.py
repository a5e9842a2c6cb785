"""adam on JAX, under `jit` as its README advises; its base stands at the origin, at rest."""

import jax
import jax.numpy as jnp
from adam.jax import KinDynComputations

from benchmarks.rivals import under_jax
from benchmarks.rivals.arms import GRAVITY, Arm


class Library(under_jax.Tasks):
    """A robot of adam."""

    def __init__(self, arm: Arm) -> None:
        self.arm = arm
        gravity = jnp.array([0, 0, GRAVITY, 0, 0, 0])
        self.robot = KinDynComputations(arm.path, list(arm.joints), gravity=gravity)

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
