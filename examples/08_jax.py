"""Forces under JAX: compiled, over a batch, and differentiated."""

import jax
import jax.numpy as jnp

import jounce

robot = jounce.load("planar2r", L1=0.8, m2=0.5)


def effort(q, qd, q2d):
    """The sum of squares of the forces of a state."""
    return jnp.sum(robot.inverse_dynamics(q, qd, q2d) ** 2)


with jax.enable_x64(True):
    states = jax.random.normal(jax.random.key(0), (3, 50, robot.n), dtype=jnp.float64)
    forces = jax.jit(robot.inverse_dynamics)(*states)  # batch axes lead, as with NumPy
    gradients = jax.jit(jax.vmap(jax.grad(effort, argnums=(0, 1, 2))))(*states)
    stiffness = jax.jit(jax.vmap(jax.jacfwd(robot.gravity_forces)))(states[0])  # dQgrav/dq
    assert jnp.allclose(stiffness, stiffness.mT)  # gravity has a potential
print(forces.shape, [gradient.shape for gradient in gradients], stiffness.shape)
