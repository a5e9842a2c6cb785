"""Weighted least squares of forces on a regressor that errors of the motion spoil, with variances from the residuals.

Problem: forces tau = Y(a) p + n of cells of time; the noise n of force j has the variance s_j^2 over the count of the
cell, and the accelerations of the motion have errors e of variances k_j v_j, v those that the smoothing states. So the
residuals have covariances S = diag(s^2) + M(p) diag(k v) M(p)^T, which move with p. Sought are p, s and k. All logs
share s: with s of its own, a log that others contradict would be taken for noise, and one log alone would decide.

Algorithm: iteratively reweighted least squares with an instrument. From each of some starts, by turns: S at p; the best
estimate of the errors, k v M^T S^-1 r; the regressor Z at the accelerations without them; p from Z^T S^-1 (tau - Y p)
= 0, as Y alone would make p too small (errors in variables); s and k by the fixed point of restricted maximum
likelihood. The start with the least score is kept, the negative log density of the accelerations: it holds -log |det M|
and rejects p = 0, which explains a joint without torque exactly. It only chooses: minimised, it diverges.

Deviations follow from the spectra of the whitened residuals, see `noise_spectra`. Offsets of encoders make forces d
that change p by B^-1 Z^T S^-1 d, with B = Z^T S^-1 Y: no part of the residuals, as p takes most of d, see
`motion_errors`.

Invariants: variances are at least those of the best sensor, and those of the smoothing at least as stated. Where the
iteration has not settled in MAX_REWEIGHTINGS, its last weights serve. Directions without information get no correction,
and the parameters in them infinite variances.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from jounce.identification import noise_spectra
from jounce.identification.averaging import CellAverages
from jounce.identification.motion_errors import AccelerationErrors, EncoderOffsets
from jounce.identification.noise_spectra import Logs

INFORMATION_RANK_TOLERANCE = 1e-12  # of eigenvalues of the scaled information to the largest: smaller ones are rounding
NULL_SPACE_TOLERANCE = 1e-8  # squared share of directions without information in a parameter: below, it is rounding
MAX_REWEIGHTINGS = 40  # good data take fewer than 20
LOG_VARIANCE_TOLERANCE = 1e-3  # change of the logarithm at which variances stay: far less than they are known to
STEP_TOLERANCE = 1e-2  # change of parameters, in their deviations, at which they stay
MIN_RELATIVE_DEVIATION = 1e-6  # of forces to their size: no sensor is better
MAX_COMPETING_CELLS = 500  # on which starts are compared: they differ by far
MIN_NOISE_SHARE = 1e-4  # of the usual square of residuals that is noise of forces: the motion's errors are not all
NORMAL_MEDIAN_SQUARE = 0.455  # median of the square of a normal number of variance 1
MAX_VARIANCE_FACTOR = 4.0  # of the accelerations' variances to stated ones: more spoils good logs, which then wander


@dataclass(frozen=True, eq=False)
class Regression:
    """Corrections x of P parameters of a model that forces ask for, as far as the data determine them."""

    x: np.ndarray  # (P,) the shortest, in the scales of the columns
    covariance: np.ndarray  # (P, P) of x; infinite on the diagonal where the data do not determine a parameter
    rank: int  # number of directions with information
    condition: float  # ratio of the singular values of the scaled problem, the largest to the smallest that counts
    information: np.ndarray  # (P, P) sum of Z^T S^-1 Z
    deviations: np.ndarray  # (nv,) standard deviations of averages of forces over cells; infinite if not measured
    weights: np.ndarray  # (C, nv) inverse variances of the forces of the cells, with what errors of the motion make
    scatter: np.ndarray  # (L,) chi^2 of what each log differs by from all, per degree of freedom: 1 by chance
    motion_errors: np.ndarray  # (nv,) root mean squares of the forces that errors of the motion make, but in its ends
    offsets: np.ndarray  # (P, n) what the offset of each joint's encoder changes in x, in no covariance above

    @property
    def offset_shares(self) -> np.ndarray:
        """The shares (P, n) of offsets of encoders in variances with them, 0 of those that are infinite."""
        squares = self.offsets**2
        return np.asarray(squares / (np.diag(self.covariance) + squares.sum(axis=1))[:, None])

    def with_offsets(self) -> "Regression":
        """The same corrections, with covariances and an information that hold the offsets of encoders, unknown."""
        G, of_offsets = self.offsets, self.information @ self.offsets
        # by Woodbury's identity, in the directions that have information
        left = np.linalg.solve(np.eye(G.shape[1]) + G.T @ of_offsets, of_offsets.T)
        return replace(self, covariance=self.covariance + G @ G.T, information=self.information - of_offsets @ left)


@dataclass(frozen=True, eq=False)
class Equations:
    """The forces of C cells: what is fitted, and what their covariances are made of."""

    Y: np.ndarray  # (C, nv, P) regressor
    off: np.ndarray  # (C, nv) forces that the model leaves
    model: np.ndarray  # (C, nv) forces of the model
    counts: np.ndarray  # (C, nv) sums of the weights of the samples; 0 where nothing is measured
    spread: np.ndarray  # (C, nv) known variances
    errors: AccelerationErrors | None
    known: bool  # whether the counts are sums of inverse variances
    least: np.ndarray  # (nv,) variances of the best sensors

    @property
    def measured(self) -> np.ndarray:
        """Which forces (nv,) are measured at all."""
        return np.asarray((self.counts > 0).any(axis=0))

    def part(self, cells: slice) -> "Equations":
        """Those of some of the cells."""
        arrays = {name: getattr(self, name)[cells] for name in ("Y", "off", "model", "counts", "spread")}
        return replace(self, **arrays, errors=self.errors and self.errors.part(cells))

    def mean_square(self, values: np.ndarray) -> np.ndarray:
        """Mean squares (nv,) of averages over cells, of one sample each."""
        there = np.maximum((self.counts > 0).sum(axis=0), 1)
        return np.asarray((self.counts * values**2).sum(axis=0) / there)

    def usual_square(self, values: np.ndarray) -> np.ndarray:
        """Mean squares (nv,) of normal averages with the medians of these: of most cells, without uncertain ends.

        Where half of the cells have next to nothing, those of all.
        """
        squares = np.where(self.counts > 0, self.counts * values**2, np.nan)
        squares[:, ~self.measured] = 0.0
        usual, mean = np.nanmedian(squares, axis=0) / NORMAL_MEDIAN_SQUARE, self.mean_square(values)
        return np.asarray(np.where(usual > 0, np.minimum(usual, mean), mean))


@dataclass(frozen=True, eq=False)
class FittedCorrections:
    """Corrections of the parameters, and the variances of forces and factors of those of accelerations."""

    x: np.ndarray  # (P,)
    noise: np.ndarray  # (nv,) s^2 of one sample
    factors: np.ndarray  # (n,) k


@dataclass(frozen=True, eq=False)
class WhiteRows:
    """Equations over the roots L of their covariances S = L L^T: rows of variance one, 0 where nothing is measured."""

    Z: np.ndarray  # (C, nv, P) regressor at the accelerations without their estimated errors
    Y: np.ndarray  # (C, nv, P) regressor
    rest: np.ndarray  # (C, nv) residuals
    parts: np.ndarray  # (C, nv, nv + n) roots of the parts of S that s_j^2 and k_j multiply
    L: np.ndarray  # (C, nv, nv)
    made: np.ndarray  # (C, nv) variances of the forces that errors of the motion make
    log_mass: float  # mean of log |det M|


def fit_forces(
    cells: CellAverages,
    columns: np.ndarray,
    errors: AccelerationErrors | None,
    known: bool,
    logs: Logs = noise_spectra.ONE_LOG,
    offsets: Sequence[EncoderOffsets] = (),
) -> Regression:
    """Fit corrections of the parameters of some columns (P,) to the forces of cells, each of one of the logs.

    If the variances are `known`, the counts of the cells are their sums of inverse variances.
    """
    equations = _equations(cells, columns, errors, known)
    starts = list(_starts(equations))
    if len(starts) > 1:
        few = equations.part(slice(None, None, max(1, len(cells.off) // MAX_COMPETING_CELLS)))
        starts = [min((_iterate(few, start) for start in starts), key=lambda fit: _score(few, fit))]
    fit = _iterate(equations, *starts)
    made = [of.forces(fit.x) for of in offsets]
    return _estimate(equations, fit, logs, np.concatenate(made) if made else np.zeros((*cells.off.shape, 0)))


def _equations(cells: CellAverages, columns: np.ndarray, errors: AccelerationErrors | None, known: bool) -> Equations:
    errors = errors if errors is not None and errors.variances.any() else None
    posed = Equations(
        cells.Y[..., columns], cells.off, cells.model, cells.counts, cells.spread, errors, known, np.zeros(())
    )
    largest = posed.mean_square(cells.model + cells.off)
    least = MIN_RELATIVE_DEVIATION**2 * np.where(largest > 0, largest, largest.max() or 1.0)
    return replace(posed, least=least)


def _starts(equations: Equations) -> Iterator[FittedCorrections]:
    """The model as it is; with errors of the motion also least squares without them, and either with little noise.

    Variances as large as what the model leaves make forces of all sizes count alike. Where the motion has larger errors
    than it states, that much noise hides the parameters: all starts with it end near 0.
    """
    n = 0 if equations.errors is None else equations.errors.variances.shape[1]
    left = np.maximum(equations.usual_square(equations.off), equations.least)
    model = FittedCorrections(
        np.zeros(equations.Y.shape[-1]), np.ones_like(left) if equations.known else left, np.ones(n)
    )
    yield model
    if n:
        plain = replace(equations, errors=None)
        rows = _whiten(plain, replace(model, factors=np.zeros(0)))
        x = _step(rows, informed_directions(noise_spectra.gram(rows.Z, rows.Z))[0])
        yield replace(model, x=x)
        if not equations.known:
            little = np.maximum(MIN_NOISE_SHARE * left, equations.least)
            yield replace(model, x=x, noise=little)
            yield replace(model, noise=little, factors=np.full(n, MAX_VARIANCE_FACTOR))


def _iterate(equations: Equations, fit: FittedCorrections) -> FittedCorrections:
    """Parameters and variances by turns, until both stay."""
    measured = equations.measured
    for _ in range(MAX_REWEIGHTINGS):
        # the parameters, at the errors of the motion that residuals tell
        rows = _whiten(equations, fit)
        X = informed_directions(noise_spectra.gram(rows.Z, rows.Z))[0]
        step = _step(rows, X)
        settled = np.linalg.norm(rows.Z @ step) < STEP_TOLERANCE
        x = fit.x + step
        # variances: those of the residuals over what is expected of them, until they reproduce themselves
        ratios = _variance_ratios(rows, X, rows.rest - rows.Y @ step)
        noise, factors = fit.noise, (fit.factors * ratios[len(measured) :]).clip(1.0, MAX_VARIANCE_FACTOR)
        if not equations.known:
            left = equations.usual_square(equations.off - equations.Y @ x)
            floor = np.maximum(equations.least, MIN_NOISE_SHARE * left)
            noise = np.maximum(fit.noise * ratios[: len(measured)], floor)
        changes = np.append(np.log(noise / fit.noise)[measured], np.log(factors / fit.factors))
        fit = FittedCorrections(x, noise, factors)
        if settled and np.abs(changes).max(initial=0.0) < LOG_VARIANCE_TOLERANCE:
            break
    return fit


def _whiten(equations: Equations, fit: FittedCorrections) -> WhiteRows:
    """The equations over the roots of their covariances, at a fit."""
    errors, there = equations.errors, equations.counts > 0
    C, nv = there.shape
    M, v = (np.zeros((C, nv, 0)), np.zeros((C, 0)))
    if errors is not None:
        M, v = errors.mass_matrix(fit.x), fit.factors * errors.variances
    log_mass = float(np.linalg.slogdet(M.mT @ M)[1].mean()) / 2
    M = M * there[..., None]
    reach = M * np.sqrt(v)[:, None]
    counts = np.where(there, equations.counts, 1.0)
    own = np.where(there, fit.noise / counts + equations.spread, 1.0)
    L = np.linalg.cholesky(own[..., None] * np.eye(nv) + reach @ reach.mT)
    rest = (equations.off - equations.Y @ fit.x) * there
    Y = equations.Y * there[..., None]
    Z = Y
    if errors is not None:
        precise = np.linalg.solve(L.mT, np.linalg.solve(L, rest[..., None]))
        Z = Y + errors.regressor(v * (M.mT @ precise)[..., 0]) * there[..., None]
    alone = (there / np.sqrt(counts))[..., None] * np.eye(nv)
    unscaled = reach / np.where(fit.factors > 0, np.sqrt(fit.factors), 1.0)
    white = np.linalg.solve(L, np.concatenate([Z, Y, rest[..., None], alone, unscaled], axis=-1))
    P = Y.shape[-1]
    return WhiteRows(
        white[..., :P], white[..., P : 2 * P], white[..., 2 * P], white[..., 2 * P + 1 :],
        L, (reach**2).sum(axis=-1), log_mass,
    )  # fmt: skip


def _step(rows: WhiteRows, X: np.ndarray) -> np.ndarray:
    """The corrections (P,) that leave nothing of the residuals along Z, of directions X with information."""
    return np.asarray(
        X
        @ np.linalg.solve(X.T @ noise_spectra.gram(rows.Z, rows.Y) @ X, X.T @ noise_spectra.gradient(rows.Z, rows.rest))
    )


def _variance_ratios(rows: WhiteRows, X: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """How many times as large the parts (nv + n,) of the covariances are as those that whiten, by the residuals."""
    orthonormal = rows.Z @ X
    found = ((rows.parts.mT @ rest[..., None])[..., 0] ** 2).sum(axis=0)
    taken = ((orthonormal.mT @ rows.parts) ** 2).sum(axis=(0, 1))
    expected = (rows.parts**2).sum(axis=(0, 1)) - taken
    return np.divide(found, expected, out=np.ones_like(found), where=expected > 0)


def _score(equations: Equations, fit: FittedCorrections) -> float:
    """The mean negative log density of the accelerations at a fit."""
    rows = _whiten(equations, fit)
    density = np.log(np.diagonal(rows.L, axis1=1, axis2=2)).sum(axis=1) + (rows.rest**2).sum(axis=1) / 2
    return float(density.mean() - rows.log_mass)


def _estimate(equations: Equations, fit: FittedCorrections, logs: Logs, by_offsets: np.ndarray) -> Regression:
    """The solution at a fit, with deviations by the spectra of the residuals and by what logs differ in.

    Offsets of encoders make forces (C, nv, n).
    """
    rows, there = _whiten(equations, fit), equations.counts > 0
    information = noise_spectra.gram(rows.Z, rows.Z)
    X, values, blind = informed_directions(information)
    Z = rows.Z @ X
    h, least = noise_spectra.leverages(Z, logs), equations.least / fit.noise
    spectra = np.ones(rows.rest.shape) if equations.known else noise_spectra.noise_spectra(h, rows.rest, least, logs)
    scatter = noise_spectra.log_scatter(Z, rows.rest, spectra, logs)
    size = max(1.0, float(scatter.mean()))
    # the sandwich B^-1 F B^-T, with the noise's spectrum between the regressor's
    inverse = np.linalg.inv(X.T @ noise_spectra.gram(rows.Z, rows.Y) @ X)
    of_directions = size * inverse @ noise_spectra.spectral_gram(Z, spectra, logs) @ inverse.T
    covariance = X @ of_directions @ X.T
    covariance[blind, blind] = np.inf
    white = np.linalg.solve(rows.L, by_offsets * there[..., None])
    dual = information @ X  # of which the products with X are 0 and 1
    noise = fit.noise * size * noise_spectra.band_means(h, spectra)
    average = np.where(equations.measured, equations.counts.mean(axis=0), 0.0)
    own = np.divide(noise, equations.counts, out=np.full(there.shape, np.inf), where=there)
    trusted = np.ones(len(there), dtype=bool) if equations.errors is None else equations.errors.trusted
    made = rows.made[trusted] if trusted.any() else rows.made
    return Regression(
        x=fit.x,
        covariance=covariance,
        rank=len(values),
        condition=float(np.sqrt(values.max() / values.min())) if len(values) else np.inf,
        information=dual @ np.linalg.inv(of_directions) @ dual.T,
        deviations=np.sqrt(np.divide(noise, average, out=np.full(len(noise), np.inf), where=average > 0)),
        weights=1 / (own + equations.spread + rows.made),
        scatter=scatter,
        motion_errors=np.sqrt(made.mean(axis=0)),
        offsets=X @ inverse @ noise_spectra.gram(Z, white),
    )


def informed_directions(information: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Directions X (P, r) with X^T information X = 1, their eigenvalues in columns scaled to one, and a mask (P,).

    The mask is of parameters that the data do not determine, alone or in combination.
    """
    scale = np.sqrt(np.diag(information))
    scale = np.where(scale > 0, scale, 1.0)
    values, vectors = np.linalg.eigh(information / scale / scale[:, None])
    seen = values > INFORMATION_RANK_TOLERANCE * values.max(initial=0.0)
    blind = (vectors[:, ~seen] ** 2).sum(axis=1) > NULL_SPACE_TOLERANCE
    return vectors[:, seen] / scale[:, None] / np.sqrt(values[seen]), values[seen], blind
