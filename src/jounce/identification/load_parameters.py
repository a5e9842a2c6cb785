"""The ten inertial parameters of a load from fits of logs, each with parameters of the robot and friction of its own.

Problem: the fit of log l alone has base parameters and drive terms z_l with the information A_l, which is all that the
log holds. With p the robot's own base parameters, d_l the drive terms in log l, and x the inertial parameters of the
load in a frame of a body, z_l = (p + K x; d_l), where K maps the parameters of that body to base parameters; without a
load, or with p known, terms fall away. Sought are p, d_l and x, by least squares: the sum of (z - z_l)^T A_l (z - z_l).

That is the same as one fit of all rows of all logs, with friction that may differ from log to log, and the minimum is
chi^2 of what a load does not explain: it shows a log of another robot. Deviations grow with its root.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jounce.identification.regression import Regression, informed_directions
from jounce.spatial import inertia
from jounce.spatial.lie import hat

COMPLEX_STEP = 1e-100  # of complex-step differentiation, which has no rounding


@dataclass(frozen=True, eq=False)
class LoadFit:
    """Inertial parameters of H loads."""

    x: np.ndarray  # (H, 10)
    covariance: np.ndarray  # (10 H, 10 H); infinite on the diagonal where the logs do not determine a parameter
    information: np.ndarray  # (10 H, 10 H) of x alone
    mismatch: float  # chi^2 over its degrees of freedom, of what the loads do not explain


def fit_loads(logs: Sequence[Regression], loads: Sequence[int | None], K: np.ndarray, known: bool) -> LoadFit:
    """Fit the loads with the numbers that logs have, None without one; the robot's base parameters may be `known`."""
    base = len(K)
    count, own = 1 + max(load for load in loads if load is not None), 0 if known else base
    ends = own + np.cumsum([0, *(len(log.x) - base for log in logs)])  # of the drive terms of each log
    first = int(ends[-1])
    maps = [np.zeros((len(log.x), first + 10 * count)) for log in logs]
    for L, load, start, end in zip(maps, loads, ends, ends[1:], strict=False):
        L[:own, :own] = np.eye(own)
        L[base:, start:end] = np.eye(end - start)
        if load is not None:
            L[:base, first + 10 * load : first + 10 * (load + 1)] = K
    A = np.sum([L.T @ log.information @ L for L, log in zip(maps, logs, strict=True)], axis=0)
    X, values, blind = informed_directions(A)
    u = X @ (X.T @ np.sum([L.T @ log.information @ log.x for L, log in zip(maps, logs, strict=True)], axis=0))
    left = [log.x - L @ u for L, log in zip(maps, logs, strict=True)]
    freedom = sum(log.rank for log in logs) - len(values)
    chi_square = sum(float(r @ log.information @ r) for r, log in zip(left, logs, strict=True))
    mismatch = chi_square / freedom if freedom > 0 else 1.0
    scale = max(1.0, mismatch)
    covariance = scale * X[first:] @ X[first:].T
    covariance[blind[first:], blind[first:]] = np.inf
    others = informed_directions(A[:first, :first])[0]
    part = others.T @ A[:first, first:]
    return LoadFit(u[first:].reshape(count, 10), covariance, (A[first:, first:] - part.T @ part) / scale, mismatch)


def central_parameters(x: np.ndarray) -> np.ndarray:
    """Mass, centre of mass, and moments of inertia about it, from inertial parameters (10,) of a mass that is not 0."""
    mass, h, cross = x[:1], x[1:4], hat(x[1:4])
    central = inertia.from_parameters(x)
    central[:3, :3] += cross @ cross / mass  # Steiner, back to the COM
    return np.concatenate([mass, h / mass, inertia.parameters(central)[4:]])


def central_covariance(x: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """The covariance of `central_parameters` by the delta method; what depends on infinite variances has them."""
    J = np.stack([central_parameters(x + 1j * COMPLEX_STEP * unit).imag / COMPLEX_STEP for unit in np.eye(10)], axis=1)
    blind = np.isinf(np.diag(covariance))
    found = J @ np.where(blind | blind[:, None], 0.0, covariance) @ J.T
    lost = (J[:, blind] != 0).any(axis=1)
    found[lost, lost] = np.inf
    return np.asarray(found)
