"""What adam and frax share: functions of JAX under `jit`, for batches under `vmap`, results awaited.

Rates and derivatives are those that JAX makes of the library's own functions.
"""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np

from benchmarks.rivals.tasks import Call

Function = Callable[..., Any]


class Tasks:
    """The tasks that both serve, by four functions of the library: Q, M, J and accelerations."""

    def _forces(self, q: jax.Array, qd: jax.Array, q2d: jax.Array) -> jax.Array:
        raise NotImplementedError

    def _mass_matrix(self, q: jax.Array) -> jax.Array:
        raise NotImplementedError

    def _jacobian(self, q: jax.Array) -> jax.Array:
        """Return (angular; linear) of the tip."""
        raise NotImplementedError

    def _accelerations(self, q: jax.Array, qd: jax.Array, Q: jax.Array) -> jax.Array:
        raise NotImplementedError

    def forces(self, x: Sequence[np.ndarray]) -> Call:
        """Q."""
        return compiled(with_rates(self._forces, 0, 3), x)

    def force_rates(self, x: Sequence[np.ndarray]) -> Call:
        """Q, Qd, Q2d, by differentiating along the motion."""
        return compiled(with_rates(self._forces, 2, 3), x)

    def mass_matrix(self, x: Sequence[np.ndarray]) -> Call:
        """M."""
        return compiled(with_rates(self._mass_matrix, 0, 1), x)

    def mass_matrix_rates(self, x: Sequence[np.ndarray]) -> Call:
        """M, Md, M2d, by differentiating along the motion."""
        return compiled(with_rates(self._mass_matrix, 2, 1), x)

    def jacobian(self, x: Sequence[np.ndarray]) -> Call:
        """J."""
        return compiled(with_rates(self._jacobian, 0, 1), x)

    def jacobian_rate(self, x: Sequence[np.ndarray]) -> Call:
        """J and its rate."""
        return compiled(with_rates(self._jacobian, 1, 1), x)

    def accelerations(self, x: Sequence[np.ndarray]) -> Call:
        """Forward dynamics."""
        return compiled(with_rates(self._accelerations, 0, 3), x)

    def force_derivatives(self, x: Sequence[np.ndarray]) -> Call:
        """Derivatives of Q by q and qd."""
        return compiled(derivatives(self._forces, (0, 1)), x)

    def acceleration_derivatives(self, x: Sequence[np.ndarray]) -> Call:
        """Derivatives of accelerations by q, qd and Q."""
        return compiled(derivatives(self._accelerations, (0, 1, 2)), x)

    def second_derivatives(self, x: Sequence[np.ndarray]) -> Call:
        """All second derivatives of Q."""
        return compiled(second_derivatives(self._forces), x)


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
