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


class Library(under_jax.Tasks):
    """A robot of frax; a chain without branches has Jacobians of its last link."""

    def __init__(self, arm: Arm) -> None:
        kind = frax.Manipulator if arm.name != "g1" else frax.Robot
        self.robot = kind(arm.path, joint_ordering=list(arm.joints))
        if kind is frax.Robot:
            self.jacobian = self.jacobian_rate = None

    def jacobian_rate(self, x: Sequence[np.ndarray]) -> Call:
        """J and its rate."""
        return under_jax.compiled(lambda q, qd: tuple(map(_swapped, self.robot.ee_jacobian_and_derivative(q, qd))), x)

    def _forces(self, q: jax.Array, qd: jax.Array, q2d: jax.Array) -> jax.Array:
        return self.robot.rnea(q, qd, q2d, jnp.array(UP), None)

    def _mass_matrix(self, q: jax.Array) -> jax.Array:
        return self.robot.mass_matrix(q)

    def _jacobian(self, q: jax.Array) -> jax.Array:
        return _swapped(self.robot.ee_jacobian(q))

    def _accelerations(self, q: jax.Array, qd: jax.Array, Q: jax.Array) -> jax.Array:
        return under_jax.solved(self._mass_matrix(q), Q - self.robot.rnea(q, qd, None, jnp.array(UP), None))


def _swapped(J: jax.Array) -> jax.Array:
    """Return (linear; angular) as (angular; linear)."""
    return jnp.concatenate([J[3:], J[:3]])
