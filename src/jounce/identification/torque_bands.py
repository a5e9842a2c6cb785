"""The band up to which measured torques confirm the accelerations of a log that is identified.

Of each cell, e = M(p)^-1 (tau - Y p) is the acceleration that torques ask for beyond the smoothed one
(`jounce.motion.confirmed_band`). Without torques of all joints, with a mass matrix that is not positive definite
(parameters that no robot has), of motions that are not made of samples, or whose bandwidth their user states, nothing
is said.
"""

import numpy as np

from jounce.identification.averaging import number_cells, weighted_means
from jounce.identification.least_squares_problem import IdentificationProblem
from jounce.motion.confirmed_band import BandErrors, band_errors
from jounce.motion.resmoothing import chosen_bandwidth

MIN_MASS_RATIO = 1e-6  # of eigenvalues of a mass matrix with ones on its diagonal: less is no robot


def find_band(posed: IdentificationProblem, x: np.ndarray) -> BandErrors | None:
    """The band up to which torques confirm a motion, by corrections x; None where they say nothing of it."""
    chosen, counts = chosen_bandwidth(posed.motion), posed.cells.counts
    if chosen is None or posed.errors is None or not (counts > 0).any(axis=0).all():
        return None
    M = posed.errors.mass_matrix(x)
    if M.shape[1] != M.shape[2] or not _are_inertias(M):
        return None
    # what torques ask for beyond the accelerations: nothing where one of them is not measured
    t, place = posed.samples.t, number_cells(posed.samples.t, posed.width)
    rest = (posed.cells.off - posed.cells.Y[..., posed.columns] @ x) * (counts > 0).all(axis=1, keepdims=True)
    e, ones = np.linalg.solve(M, rest[..., None])[..., 0], np.ones((len(t), 1))
    a, times = (weighted_means(of, ones, place)[0] for of in (posed.motion(t, 2)[2], t[:, None]))
    return band_errors(times[:, 0], a, e, chosen)


def _are_inertias(M: np.ndarray) -> bool:
    """Whether all mass matrices (C, n, n) are positive definite, well beyond rounding."""
    diagonal = np.diagonal(M, axis1=1, axis2=2)
    if not (diagonal > 0).all():
        return False
    scaled = M / np.sqrt(diagonal[:, :, None] * diagonal[:, None, :])
    return bool((np.linalg.eigvalsh(scaled)[:, 0] > MIN_MASS_RATIO).all())
