"""Partial derivatives of forces of every order, and of accelerations, from those of the forces themselves.

K, D and M are dQ/dq, dQ/dqd and dQ/dq2d along a motion. They and their rates are all the partial derivatives of all the
rates of Q, since a partial derivative and the time derivative d/dt commute but for one term:

    d(dx/dt)/dq^(j) = d/dt (dx/dq^(j)) + dx/dq^(j - 1)
"""

from collections.abc import Sequence
from functools import reduce
from math import comb
from operator import add

import numpy as np

from jounce._scalars import Array, concatenate
from jounce.dynamics import system
from jounce.dynamics.closed_form import closed_form
from jounce.model.coordinates import generalized_matrix
from jounce.model.mechanism import Mechanism
from jounce.spatial.linear import Factors
from jounce.spatial.series import Series


def dense(m: Mechanism, q: Series, W: Series | None = None) -> tuple[Series, Series, Series]:
    """K, D and M by the closed form, (..., n, n) each, with wrenches W on the bodies, (..., 6nb, 1), fixed in them.

    A velocity dq of the coordinates displaces the bodies by J dq. Seen from them, it changes their twists by the rate
    of J dq in space, and hence their forces. It turns the forces with the bodies: where joint j lies outward of joint
    i, they have turned seen from the screw S_i.
    """
    x, M = closed_form(m, q, W), system.system_M(m)
    J, b, P = x.J, x.b, M @ x.V
    J1 = J.dot + b @ J  # rates of the screws in space
    J2 = J1.dot + b @ J1 + x.UG.map(system.system_b) @ J  # relative to free fall
    B = -(b.mT @ M) - M @ b + P.map(system.system_moved)
    force = P.dot - b.mT @ P + M @ x.UG
    S = x.A @ system.system_S(m)
    turned = S.mT @ (force if W is None else force + W).map(system.system_moved) @ S
    outward = turned * np.tri(m.nb, k=-1, dtype=int).T
    K = J.mT @ (M @ J2 + B @ J1) + generalized_matrix(m, outward)
    D = J.mT @ (2 * (M @ J1) + B @ J)
    return K, D, x.gM


def of_all_rates(K: Series, D: Series, M: Series) -> Series:
    """P, whose k-th term has the partial derivatives of Q^(k) by q, qd, ..., q^(k+2): (..., 3 + k, n, n).

    dQ^(k)/dq^(j) = sum of binom(k, i) d^i/dt^i (dQ/dq^(j - k + i)), where 0 <= j - k + i <= 2.
    """
    return Series(lambda k: _stack([_of_rate((K, D, M), k, j) for j in range(k + 3)]))


def _of_rate(partials: Sequence[Series], k: int, j: int) -> Array:
    """dQ^(k)/dq^(j)."""
    orders = [k - j + m for m in range(3)]
    return reduce(add, [comb(k, i) * X[i] for i, X in zip(orders, partials, strict=True) if 0 <= i <= k])


def of_accelerations(P: Array) -> tuple[Array, Array, Array]:
    """dq2d/dq = -M^-1 K, dq2d/dqd = -M^-1 D and M^-1 from K, D and M, (..., 3, n, n)."""
    K, D, M = (P[..., j, :, :] for j in range(3))
    n = M.shape[-1]
    solution = Factors.of(M).solve(concatenate([-K, -D, np.eye(n, dtype=int)], axis=-1))
    return solution[..., :n], solution[..., n : 2 * n], solution[..., 2 * n :]


def _stack(matrices: Sequence[Array]) -> Array:
    return concatenate([matrix[..., None, :, :] for matrix in matrices], axis=-3)
