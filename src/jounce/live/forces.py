"""Forces of estimated rates, with the deviations that follow from those of the rates."""

from typing import NamedTuple

import numpy as np

from jounce.engine.dispatch import compute
from jounce.engine.engine import Engine

SIGNAL_TIME = 1.0  # s, over which the mean square of Q2d is taken


class LiveForces(NamedTuple):
    """Forces and their rates (n,) of `LiveRates.forces`, N m or N, per s, per s^2.

    `deviations` are the standard deviations of the three. `certain` says whose Q2d has a smaller deviation than its
    rms over the last second without noise.

    Examples
    --------
    >>> import jounce
    >>> live = jounce.load("planar2r").live(1e-3, lag=0, bandwidth=10, noise=1e-5)
    >>> for _ in range(1000):
    ...     _ = live.update([0.1, 0.2])
    >>> found = live.forces()
    >>> found.Q.round(1), found.certain
    (array([28.9,  9.4]), array([False, False]))
    """

    Q: np.ndarray
    Qd: np.ndarray
    Q2d: np.ndarray
    deviations: tuple[np.ndarray, np.ndarray, np.ndarray]
    certain: np.ndarray


def estimate_forces(robot: Engine, rates: tuple[np.ndarray, ...], covariance: np.ndarray) -> tuple[np.ndarray, ...]:
    """Q, Qd, Q2d and their variances (2, 3, n) from rates q to q4d (n,) with covariances (n, 5, 5) of each joint.

    To first order: ``dQ = sum_j P[j] dq^(j)``, and the errors of different joints are independent.
    """
    forces = np.array(compute(robot, "inverse_dynamics", rates))
    partials = compute(robot, "inverse_dynamics_partials", rates)
    variances = [np.einsum("aij,jab,bij->i", P, covariance[:, : len(P), : len(P)], P) for P in partials]
    return forces, np.array(variances)
