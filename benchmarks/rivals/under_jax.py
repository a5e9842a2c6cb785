"""What adam and frax share: functions of JAX under `jit`, for batches under `vmap`, results awaited."""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.rivals.tasks import Call

Function = Callable[..., Any]


def compiled(f: Function, x: Sequence[np.ndarray]) -> Call:
    """Return the call of a function that returns a tuple; a batch is mapped."""
    mapped = f if x[0].ndim == 1 else jax.vmap(f)
    jitted = jax.jit(mapped)
    run = lambda: jax.block_until_ready(jitted(*x))  # noqa: E731
    return Call(run, lambda: [np.asarray(array) for array in run()])


def with_rates(f: Function, order: int, of: int) -> Function:
    """Return f and its derivatives along the motion up to an order; f takes `of` of q, qd, ..."""

    def rates(*x: jax.Array) -> tuple[jax.Array, ...]:
        found = [f(*x[:of])]
        g = f
        for k in range(1, order + 1):
            g = _rate(g, of + k - 1)
            found.append(g(*x[: of + k]))
        return tuple(found)

    return rates


def _rate(g: Function, takes: int) -> Function:
    """Return the derivative along the motion of a function of q, qd, ...: the rate of each is the next."""
    return lambda *x: jax.jvp(g, x[:takes], x[1 : takes + 1])[1]


def derivatives(f: Function, by: tuple[int, ...]) -> Function:
    """Return the Jacobians of a function by some of its arguments."""
    return lambda *x: tuple(jax.jacfwd(f, argnums=i)(*x) for i in by)


def second_derivatives(f: Function) -> Function:
    """Return the tensors of Q by (q, q), (q, qd), (qd, qd) and (q, q2d)."""
    pairs = ((0, 0), (0, 1), (1, 1), (0, 2))
    return lambda *x: tuple(jax.jacfwd(jax.jacrev(f, argnums=i), argnums=k)(*x) for i, k in pairs)


def solved(M: jax.Array, Q: jax.Array) -> jax.Array:
    """Return M^-1 Q by a Cholesky factor."""
    return jax.scipy.linalg.cho_solve(jax.scipy.linalg.cho_factor(M), Q)


def inverse(M: jax.Array) -> jax.Array:
    """Return M^-1."""
    return solved(M, jnp.eye(len(M)))
