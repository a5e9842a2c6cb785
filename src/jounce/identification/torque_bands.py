"""The band up to which measured torques confirm the accelerations of a log that is identified.

Of each cell, e = M(p)^-1 (tau - Y p) is the acceleration that torques ask for beyond the smoothed one
(`jounce.motion.confirmed_band`). Without torques of all joints, with a mass matrix that is not positive definite
(parameters that no robot has), of motions that are not made of samples, or whose bandwidth their user states, nothing
is said.
"""

from dataclasses import dataclass

import numpy as np

from jounce.identification.averaging import number_cells, weighted_means
from jounce.identification.least_squares_problem import IdentificationProblem
from jounce.motion.confirmed_band import UNCERTAIN_END_SHARE, BandErrors, band_errors
from jounce.motion.resmoothing import chosen_bandwidth

MIN_REVERSAL_SHARE = 0.5  # of the squares of e next to reversals, which last a tenth of the time: play makes 0.8
MAX_REVERSAL_TIME = 0.2  # share of cells next to reversals, beyond which they say nothing
MIN_MASS_RATIO = 1e-6  # of eigenvalues of a mass matrix with ones on its diagonal: less is no robot


@dataclass(frozen=True)
class ConfirmedBand(BandErrors):
    """What torques say of the accelerations of a motion."""

    turning: tuple[str, ...]  # joints whose accelerations are off where they turn back, as with play


def find_band(posed: IdentificationProblem, x: np.ndarray) -> ConfirmedBand | None:
    """The band up to which torques confirm a motion, by corrections x; None where they say nothing of it."""
    chosen, counts = chosen_bandwidth(posed.motion), posed.cells.counts
    if chosen is None or not (counts > 0).any(axis=0).all():
        return None
    M = posed.errors.mass_matrix(x)
    if M.shape[1] != M.shape[2] or not _are_inertias(M):
        return None
    # what torques ask for beyond the accelerations: nothing where one of them is not measured
    t, place = posed.samples.t, number_cells(posed.samples.t, posed.width)
    rest = (posed.cells.off - posed.cells.Y[..., posed.columns] @ x) * (counts > 0).all(axis=1, keepdims=True)
    e, ones = np.linalg.solve(M, rest[..., None])[..., 0], np.ones((len(t), 1))
    _, qd, q2d = posed.motion(t, 2)
    v, a, times = (weighted_means(of, ones, place)[0] for of in (qd, q2d, t[:, None]))
    if (errors := band_errors(times[:, 0], a, e, chosen)) is None:
        return None
    pairs = zip(posed.robot.mechanism.coordinates, v.T, e.T, strict=True)
    turning = tuple(name for name, speed, off in pairs if _is_off_where_it_turns(speed, off))
    return ConfirmedBand(**vars(errors), turning=turning)


def _is_off_where_it_turns(v: np.ndarray, e: np.ndarray) -> bool:
    """Whether most of the errors of accelerations (C,) of a joint are where its velocity (C,) changes its sign."""
    end = int(UNCERTAIN_END_SHARE * len(e))
    v, e = (x[end : len(x) - end] for x in (v, e))
    turns = v[1:] * v[:-1] < 0
    near = np.convolve(turns, np.ones(4))[1 : len(e) + 1] > 0  # the two cells before it, and the two after
    return bool(near.mean() < MAX_REVERSAL_TIME and (e[near] ** 2).sum() > MIN_REVERSAL_SHARE * (e**2).sum())


def _are_inertias(M: np.ndarray) -> bool:
    """Whether all mass matrices (C, n, n) are positive definite, well beyond rounding."""
    diagonal = np.diagonal(M, axis1=1, axis2=2)
    if not (diagonal > 0).all():
        return False
    scaled = M / np.sqrt(diagonal[:, :, None] * diagonal[:, None, :])
    return bool((np.linalg.eigvalsh(scaled)[:, 0] > MIN_MASS_RATIO).all())
