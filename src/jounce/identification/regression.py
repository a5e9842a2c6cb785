"""Weighted least squares of forces on a regressor, with one variance per force, estimated from the residuals.

Residuals of a fit to a robot are serially correlated, and as a rule they are not white: at low frequencies, where the
regressor has its power, they hold what the model leaves out. Deviations of parameters follow from the power of the
residuals at these frequencies. So the variance of a force is the mean of its residuals' periodogram, weighted with the
leverage h(f) of the rows at each frequency, the share of the data that the fit takes for itself; what it leaves is
E |r(f)|^2 = (1 - h(f)) S(f), and S(f) = sum h |r|^2 / sum h (1 - h). White residuals give the usual sum of squares.

Algorithm: iteratively reweighted least squares, a fixed-point iteration of the variances from those of the forces that
the model leaves; each solution by the eigenvalues of the normal matrix in columns scaled to one. Invariant: variances
are at least those of the best sensor. Where the iteration has not settled in MAX_REWEIGHTINGS, its last weights
serve. Directions without information get no correction, and the parameters in them infinite variances.
"""

from dataclasses import dataclass

import numpy as np

from jounce.identification.averaging import CellAverages

INFORMATION_RANK_TOLERANCE = 1e-12  # of eigenvalues of the scaled information to the largest: smaller ones are rounding
NULL_SPACE_TOLERANCE = 1e-8  # squared share of directions without information in a parameter: below, it is rounding
MAX_REWEIGHTINGS = 30  # good data take fewer than 20
LOG_VARIANCE_TOLERANCE = 1e-3  # change of the logarithm at which variances stay: far less than they are known to
MIN_RELATIVE_DEVIATION = 1e-6  # of forces to their size: no sensor is better


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """The normal equations of corrections x of the parameters of a model, and the variances W^-1 that weigh them."""

    information: np.ndarray  # (P, P) sum of Y^T W Y of all columns
    right: np.ndarray  # (P,) sum of Y^T W times the forces that the model leaves
    variances: np.ndarray  # (nv,) of one sample of each force in the band of the motion; infinite if not measured
    deviations: np.ndarray  # (nv,) standard deviations of averages over cells


@dataclass(frozen=True, eq=False)
class InformedSolution:
    """The solution of a least-squares problem by its information, as far as the data determine it."""

    x: np.ndarray  # (P,) the shortest solution, in the scales of the columns
    covariance: np.ndarray  # (P, P) of x; infinite on the diagonal where the data do not determine a parameter
    rank: int  # number of directions with information
    condition: float  # ratio of the singular values of the scaled problem, the largest to the smallest that counts


def solve_normal_equations(information: np.ndarray, right: np.ndarray) -> InformedSolution:
    """Solve information x = right in columns scaled to one."""
    directions, values, blind = _informed_directions(information)
    covariance = directions @ directions.T
    covariance[blind, blind] = np.inf
    condition = float(np.sqrt(values.max() / values.min())) if len(values) else np.inf
    return InformedSolution(directions @ (directions.T @ right), covariance, len(values), condition)


def weigh_forces(cells: CellAverages, chosen: np.ndarray, known: bool) -> NormalEquations:
    """Weigh the cells by iterated variances; `chosen` (K,) are columns that span those of all.

    If the variances are `known`, the counts of the cells are their sums of inverse variances.
    """
    measured = (cells.counts > 0).any(axis=0)
    # the start: deviations as large as what the model leaves, so that forces of all sizes count alike
    largest = _mean_square(cells, cells.model + cells.off)
    least = MIN_RELATIVE_DEVIATION**2 * np.where(largest > 0, largest, largest.max() or 1.0)
    start = 1.0 if known else np.maximum(_mean_square(cells, cells.off), least)
    variances = np.where(measured, start, np.inf)
    for _ in range(0 if known else MAX_REWEIGHTINGS):
        # the variances of residuals weighted by those before, until they reproduce themselves
        before, variances = variances, np.maximum(variances * _variance_ratios(cells, chosen, variances), least)
        if np.abs(np.log(variances[measured] / before[measured])).max() < LOG_VARIANCE_TOLERANCE:
            break
    Y, off = _weighted_rows(cells, variances)
    deviations = np.sqrt(variances / np.where(measured, cells.counts.mean(axis=0), 1.0))
    return NormalEquations(Y.T @ Y, Y.T @ off, variances, deviations)


def row_weights(cells: CellAverages, variances: np.ndarray) -> np.ndarray:
    """The inverse variances (C, nv) of the averages over cells."""
    measured = cells.counts > 0
    own = np.divide(variances, cells.counts, out=np.full(cells.counts.shape, np.inf), where=measured)
    return np.asarray(1 / (own + cells.spread))


def _variance_ratios(cells: CellAverages, chosen: np.ndarray, variances: np.ndarray) -> np.ndarray:
    """How many times as large the residuals' variances (nv,) are as those that weigh them, by their periodograms."""
    Y, off = _weighted_rows(cells, variances)
    Y = Y[:, chosen]
    orthonormal = Y @ _informed_directions(Y.T @ Y)[0]
    rest = (off - orthonormal @ (orthonormal.T @ off)).reshape(cells.off.shape)
    orthonormal = orthonormal.reshape(*rest.shape, -1)
    leverage = (np.abs(np.fft.fft(orthonormal, axis=0, norm="ortho")) ** 2).sum(axis=-1)
    power = np.abs(np.fft.fft(rest, axis=0, norm="ortho")) ** 2
    expected = (leverage * (1 - leverage).clip(0)).sum(axis=0)
    found = (leverage * power).sum(axis=0)
    return np.divide(found, expected, out=np.ones_like(found), where=expected > 0)


def _weighted_rows(cells: CellAverages, variances: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Regressor (C nv, P) and forces that the model leaves (C nv,) over the deviations of the rows."""
    roots = np.sqrt(row_weights(cells, variances))
    return (cells.Y * roots[..., None]).reshape(-1, cells.Y.shape[-1]), (cells.off * roots).ravel()


def _mean_square(cells: CellAverages, values: np.ndarray) -> np.ndarray:
    """Mean squares (nv,) of averages over cells, of one sample each."""
    there = np.maximum((cells.counts > 0).sum(axis=0), 1)
    return np.asarray((cells.counts * values**2).sum(axis=0) / there)


def _informed_directions(information: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Directions X (P, r) with X^T information X = 1, their eigenvalues in columns scaled to one, and a mask (P,).

    The mask is of parameters that the data do not determine, alone or in combination.
    """
    scale = np.sqrt(np.diag(information))
    scale = np.where(scale > 0, scale, 1.0)
    values, vectors = np.linalg.eigh(information / scale / scale[:, None])
    seen = values > INFORMATION_RANK_TOLERANCE * values.max(initial=0.0)
    blind = (vectors[:, ~seen] ** 2).sum(axis=1) > NULL_SPACE_TOLERANCE
    return vectors[:, seen] / scale[:, None] / np.sqrt(values[seen]), values[seen], blind
