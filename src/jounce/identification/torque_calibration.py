"""Torque constants from a load of known mass: the factor per joint that makes measured torques true.

Problem: joint j measures g_j times its torque. The rows of that joint alone, in log l, have base parameters z_jl with
the information A_jl, once friction is eliminated, and z_jl = g_j (p + K x), with the mass in x known and without x in
the log without the load. Sought are p, x and all g_j, by least squares. Joints share p and x, so that the mass sets the
factors of those too that hardly lift it.

Algorithm: Gauss-Newton from the load that torques as they are give. Errors of the motion enter as known variances.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from jounce.identification.averaging import CellAverages
from jounce.identification.least_squares_problem import IdentificationProblem
from jounce.identification.load_parameters import LoadFit
from jounce.identification.regression import Regression, fit_forces, informed_directions

MAX_CALIBRATION_STEPS = 30  # of Gauss and Newton; fewer than 10 as a rule
CALIBRATION_STEP_TOLERANCE = 1e-3  # of steps, in deviations
EXACT_MASS_TOLERANCE = 1e-6  # relative deviation of a known mass for the body that can exist


def calibrate_torques(
    posed: Sequence[IdentificationProblem], fits: Sequence[Regression], start: LoadFit, K: np.ndarray, mass: float
) -> tuple[np.ndarray, np.ndarray, LoadFit]:
    """Factors (nv,) of torques by logs with a load of known mass and without it, their deviations, and the load."""
    base = len(K)
    measured = np.flatnonzero([np.isfinite(x) for x in fits[0].deviations + fits[1].deviations])
    pairs = [*enumerate(zip(posed, fits, strict=True))]
    rows = [(j, log, *_fit_force(one, fit, int(j), base)) for j in measured for log, (one, fit) in pairs]
    maps = np.stack([np.hstack([np.eye(base), K]), np.hstack([np.eye(base), 0 * K])])
    free = np.delete(np.arange(base + 10), base)  # without the mass
    scale = float(start.x[0, 0]) / mass
    g = np.full(len(fits[0].deviations), scale)
    u = np.append(posed[0].base.values + fits[1].x[:base], start.x[0]) / scale
    u[base] = mass
    for _ in range(MAX_CALIBRATION_STEPS):
        A, b, chi_square = np.zeros((len(free) + len(g),) * 2), np.zeros(len(free) + len(g)), 0.0
        for j, log, z, information in rows:
            J = np.zeros((base, len(b)))
            J[:, : len(free)], J[:, len(free) + j] = g[j] * maps[log][:, free], maps[log] @ u
            left = z - g[j] * maps[log] @ u
            A += J.T @ information @ J
            b += J.T @ information @ left
            chi_square += float(left @ information @ left)
        X, values, blind = informed_directions(A)
        step = X.T @ b
        u[free] += (X @ step)[: len(free)]
        g += (X @ step)[len(free) :]
        if np.linalg.norm(step) < CALIBRATION_STEP_TOLERANCE:
            break
    freedom = sum(np.linalg.matrix_rank(information, hermitian=True) for *_, information in rows) - len(values)
    mismatch = chi_square / freedom if freedom > 0 else 1.0
    covariance = max(1.0, mismatch) * X @ X.T
    covariance[blind, blind] = np.inf
    spread = np.sqrt(np.diag(covariance)[len(free) :])
    spread[np.diag(A)[len(free) :] == 0] = np.inf
    whole = np.zeros((10, 10))
    whole[1:, 1:] = covariance[base : base + 9, base : base + 9]
    information = np.linalg.pinv(np.where(np.isinf(whole), 0.0, whole), hermitian=True)
    information[0, 0] = (EXACT_MASS_TOLERANCE * mass) ** -2
    load = LoadFit(u[None, base:], whole, information, mismatch)
    return 1 / g, spread / g**2, load


def _fit_force(posed: IdentificationProblem, fit: Regression, j: int, base: int) -> tuple[np.ndarray, np.ndarray]:
    """The base parameters that the rows of one force alone have, and their information without drive terms."""
    cells = posed.cells
    cells = CellAverages(*(values[:, [j]] for values in vars(cells).values()))
    cells = replace(cells, spread=cells.spread + fit.motion_errors[j] ** 2)
    found = fit_forces(cells, posed.columns, None, known=False)
    X = informed_directions(found.information[base:, base:])[0]
    part = X.T @ found.information[base:, :base]
    return posed.base.values + found.x[:base], found.information[:base, :base] - part.T @ part
