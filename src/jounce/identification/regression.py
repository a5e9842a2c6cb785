"""Fit corrections of parameters to forces by weighted least squares.

The regressor is uncertain too, as the motion has errors, and the variances of forces and motion are fitted as well.

Problem: forces tau = Y(a) p + n, averaged over cells of time, at the true accelerations a. The noise n of force j has
the variance s_j^2 / count in a cell. The motion has accelerations a + e, whose errors e have variances k_j v_j where
its smoothing states v_j. Its regressor Y = Y(a + e) leaves residuals r = tau - Y p = n - M(p) e, with the mass matrix
M. Their covariances S = diag(s^2 / count) + M diag(k v) M^T change with p; variances that are known besides, the
spread, add to the diagonal. Sought are p, s and k. In the code, x corrects the model's p, so that r = off - Y x. All
logs share s: if each had its own, a log that others contradict would be taken for noise, and one log alone would
decide.

Algorithm: iteratively reweighted least squares with an instrument. From each of a few starts, these steps repeat: S at
the last p; the likeliest errors, -k v M^T S^-1 r; the regressor Z at the accelerations without them, the instrument; p
from Z^T S^-1 (tau - Y p) = 0; s and k by one round of the fixed point of restricted maximum likelihood. With Y in place
of Z, p would be too small (errors in variables). The fit with the least score is kept, the negative log density of the
accelerations. Its term -log |det M| rejects p = 0, which explains a joint without torque exactly. The score only
chooses: if it is minimised itself, it diverges.

Deviations follow from the spectra of the whitened residuals, see `noise_spectra`. Offsets of encoders make forces d
that change p by B^-1 Z^T S^-1 d, with B = Z^T S^-1 Y. They are found apart, see `motion_errors`: p takes up most of d,
so that the residuals do not show them.

Door: `fit_forces`, once per fit. `_iterate` runs on some of the cells from each start, if there are several, and then
on all cells. Each of its rounds runs `_whiten`, `_step` and `_variance_ratios` once. `_estimate` runs once, at the end.

Invariants: variances of forces are at least those of the best sensors, unless they are known, and variances of
accelerations at least those that the smoothing states. Where the iteration has not settled after MAX_REWEIGHTINGS
rounds, its last weights serve. Directions of x without information get no correction, and parameters with a share in
them have infinite variances.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from jounce.identification import noise_spectra
from jounce.identification.averaging import CellAverages
from jounce.identification.motion_errors import AccelerationErrors, EncoderOffsets

INFORMATION_RANK_TOLERANCE = 1e-12  # of eigenvalues of the scaled information to the largest: smaller ones are rounding
NULL_SPACE_TOLERANCE = 1e-8  # squared share of directions without information in a parameter: below, it is rounding
MAX_REWEIGHTINGS = 40  # good data take fewer than 20
LOG_VARIANCE_TOLERANCE = 1e-3  # change of a variance's logarithm below which it has settled: known far less precisely
STEP_TOLERANCE = 1e-2  # length of a step, in deviations of the parameters, below which they have settled
MIN_RELATIVE_DEVIATION = 1e-6  # of averages of forces to their size: no sensor is better
MAX_COMPETING_CELLS = 500  # on which starts are compared, or up to twice as many: few do, as scores differ by far
MIN_NOISE_SHARE = 1e-4  # of the usual square of residuals: this much is noise of forces, whatever the motion's errors
NORMAL_MEDIAN_SQUARE = 0.455  # median of the square of a normal number of variance 1
MAX_VARIANCE_FACTOR = 4.0  # of variances of accelerations to stated ones: with more, fits of good logs wander off


@dataclass(frozen=True, eq=False)
class Regression:
    """Corrections x of P parameters, as far as the data determine them."""

    x: np.ndarray  # (P,) the shortest of those that fit, if columns of the regressor are scaled to one length
    covariance: np.ndarray  # (P, P) of x; infinite on the diagonal where the data do not determine a parameter
    rank: int  # number of directions with information
    condition: float  # ratio of the singular values of the scaled problem, the largest to the smallest that counts
    information: np.ndarray  # (P, P) inverse of the covariance in the directions with information, 0 in the others
    deviations: np.ndarray  # (nv,) standard deviations of averages of forces over cells; infinite if not measured
    weights: np.ndarray  # (C, nv) inverse variances of the cells' forces, those by errors of the motion included
    scatter: np.ndarray  # (L,) chi^2 per degree of freedom by which each log differs from all: 1 by chance
    motion_errors: np.ndarray  # (nv,) root mean squares of forces by errors of the motion, without its uncertain ends
    offsets: np.ndarray  # (P, n) change of x by one deviation of each joint's offset, not in the covariance above

    @property
    def offset_shares(self) -> np.ndarray:
        """The shares of offsets of encoders in the variances: (P, n).

        They are 0 where the variances without offsets are infinite.
        """
        squares = self.offsets**2
        return np.asarray(squares / (np.diag(self.covariance) + squares.sum(axis=1))[:, None])

    def with_offsets(self) -> "Regression":
        """Return the corrections with unknown offsets of encoders in covariance and information."""
        # In units of its deviation, each offset has the variance 1: all add G G^T to the covariance C of x.
        G, IG = self.offsets, self.information @ self.offsets
        # Woodbury's identity, (C + G G^T)^-1 = I - I G (1 + G^T I G)^-1 G^T I, holds in the directions that have
        # information I = C^-1, so that the singular covariance is never inverted.
        change = IG @ np.linalg.solve(np.eye(G.shape[1]) + G.T @ IG, IG.T)
        return replace(self, covariance=self.covariance + G @ G.T, information=self.information - change)


@dataclass(frozen=True, eq=False)
class Equations:
    """The forces of C cells: what is fitted, and what makes their covariances."""

    Y: np.ndarray  # (C, nv, P) regressor
    off: np.ndarray  # (C, nv) measured forces less those of the model: what Y x is to explain
    model: np.ndarray  # (C, nv) forces of the model
    counts: np.ndarray  # (C, nv) sums of the weights of the samples; 0 where nothing is measured
    spread: np.ndarray  # (C, nv) known variances of the averages, which add to s^2 / counts
    errors: AccelerationErrors | None  # None of a motion whose accelerations are exact
    known: bool  # whether the counts are sums of inverse variances, so that s = 1
    least: np.ndarray  # (nv,) bounds of s^2 from below: variances of one sample of the best sensors

    @property
    def measured(self) -> np.ndarray:
        """A mask (nv,) of the forces that are measured at all."""
        return np.asarray((self.counts > 0).any(axis=0))

    def part(self, cells: slice) -> "Equations":
        """Return the equations of some of the cells."""
        arrays = {name: getattr(self, name)[cells] for name in ("Y", "off", "model", "counts", "spread")}
        errors = None if self.errors is None else self.errors.part(cells)
        return replace(self, **arrays, errors=errors)

    def mean_square(self, values: np.ndarray) -> np.ndarray:
        """Return mean squares (nv,) of averages, scaled to one sample each.

        Values (C, nv) are averages over cells.
        """
        # An average over `count` samples has 1 / count of the variance of one sample.
        cell_count = np.maximum((self.counts > 0).sum(axis=0), 1)
        return np.asarray((self.counts * values**2).sum(axis=0) / cell_count)

    def usual_square(self, values: np.ndarray) -> np.ndarray:
        """Return robust mean squares (nv,), scaled to one sample each.

        A few large values, such as those at the uncertain ends of a smoothing, hardly move them. They follow from the
        median of the squares as those of normal numbers, and are at most the mean squares of all cells. Where the
        median is 0, as half of the cells have nothing, the mean squares of all cells count.
        """
        # The median leaves out cells without a measurement; forces without any would leave it none.
        squares = np.where(self.counts > 0, self.counts * values**2, np.nan)
        squares[:, ~self.measured] = 0.0
        usual, mean = np.nanmedian(squares, axis=0) / NORMAL_MEDIAN_SQUARE, self.mean_square(values)
        return np.asarray(np.where(usual > 0, np.minimum(usual, mean), mean))


@dataclass(frozen=True, eq=False)
class FittedCorrections:
    """Corrections with the variances of forces, and factors of those of accelerations."""

    x: np.ndarray  # (P,)
    noise: np.ndarray  # (nv,) s^2 of one sample
    factors: np.ndarray  # (n,) k, from 1 to MAX_VARIANCE_FACTOR


@dataclass(frozen=True, eq=False)
class WhiteRows:
    """Equations multiplied by the inverse roots of their covariances.

    Z, Y, residuals and parts are those of the equations times L^-1, where S = L L^T. Their rows have the variance one,
    and are 0 where nothing is measured.
    """

    Z: np.ndarray  # (C, nv, P) regressor at the accelerations without their estimated errors
    Y: np.ndarray  # (C, nv, P) regressor
    residuals: np.ndarray  # (C, nv)
    parts: np.ndarray  # (C, nv, nv + n) roots of the parts of S: columns g, of which s_j^2 and k_j multiply g g^T
    L: np.ndarray  # (C, nv, nv)
    error_variances: np.ndarray  # (C, nv) variances of the forces that errors of the motion make, diag(M diag(k v) M^T)
    log_mass: float  # mean of log |det M|


def fit_forces(
    cells: CellAverages,
    columns: np.ndarray,
    errors: AccelerationErrors | None,
    known: bool,
    logs: noise_spectra.Logs = noise_spectra.ONE_LOG,
    offsets: Sequence[EncoderOffsets] = (),
) -> Regression:
    """Fit corrections of some parameters to the forces of cells.

    `columns` (P,) of the regressor are those of the parameters, `logs` the cells of each log, and `offsets` those of
    the encoders in each log. If the variances are `known`, the counts of the cells are their sums of inverse variances.
    """
    equations = _equations(cells, columns, errors, known)
    starts = list(_starts(equations))
    # Starts compete on some cells, spread evenly, as their scores differ by far. The fit of the best one becomes the
    # only start. An exact motion has one start from the first.
    if len(starts) > 1:
        every = max(1, len(cells.off) // MAX_COMPETING_CELLS)
        competing = equations.part(slice(None, None, every))
        fits = [_iterate(competing, start) for start in starts]
        starts = [min(fits, key=lambda fit: _score(competing, fit))]
    fit = _iterate(equations, *starts)
    # Offsets of encoders are known to be small: their forces are taken once, at the corrections found.
    forces = [offsets_of_log.forces(fit.x) for offsets_of_log in offsets]
    offset_forces = np.concatenate(forces) if len(forces) > 0 else np.zeros((*cells.off.shape, 0))
    return _estimate(equations, fit, logs, offset_forces)


def _equations(cells: CellAverages, columns: np.ndarray, errors: AccelerationErrors | None, known: bool) -> Equations:
    """Return the equations of cells, with variances of the best sensors."""
    # Errors of variance 0 are left out: S is then diagonal, and no mass matrix is needed. The variances of the best
    # sensors follow from the equations, so that they start without.
    has_errors = errors is not None and bool(errors.variances.any())
    equations = Equations(
        cells.Y[..., columns],
        cells.off,
        cells.model,
        cells.counts,
        cells.spread,
        errors if has_errors else None,
        known,
        np.zeros(()),
    )
    # The best sensor is off by a share of the measured force. A force that is 0 takes the share of the largest one.
    squares = equations.mean_square(cells.model + cells.off)
    largest = squares.max() if squares.max() > 0 else 1.0
    least = MIN_RELATIVE_DEVIATION**2 * np.where(squares > 0, squares, largest)
    return replace(equations, least=least)


def _starts(equations: Equations) -> Iterator[FittedCorrections]:
    """Yield the starts of the iteration: the model, and least squares.

    The noise of the first two is all that the model does not explain, so that forces of all sizes count alike. Where
    the motion has larger errors than it states, so much noise hides the parameters, and these starts end at p near 0.
    Two more starts have little noise, unless it is known. The last of them, the model with the largest errors of the
    motion, finds the parameters then too. An exact motion has the first start alone.
    """
    n = 0 if equations.errors is None else equations.errors.variances.shape[1]
    unexplained = np.maximum(equations.usual_square(equations.off), equations.least)
    # Counts that are inverse variances make s^2 = 1.
    noise = np.ones_like(unexplained) if equations.known else unexplained
    at_model = FittedCorrections(np.zeros(equations.Y.shape[-1]), noise, np.ones(n))
    yield at_model
    if equations.errors is None:
        return
    # Least squares as if accelerations were exact: too small where their errors are large, but near enough to start.
    exact = replace(equations, errors=None)
    rows = _whiten(exact, replace(at_model, factors=np.zeros(0)))
    x = _step(rows, informed_directions(noise_spectra.gram(rows.Z, rows.Z))[0])
    yield replace(at_model, x=x)
    # Little noise of forces leaves the residuals to the errors of the motion. Known variances leave no such choice.
    if not equations.known:
        little_noise = np.maximum(MIN_NOISE_SHARE * unexplained, equations.least)
        yield replace(at_model, x=x, noise=little_noise)
        yield replace(at_model, noise=little_noise, factors=np.full(n, MAX_VARIANCE_FACTOR))


def _iterate(equations: Equations, fit: FittedCorrections) -> FittedCorrections:
    """Find parameters and variances by turns, until both stay."""
    measured = equations.measured
    nv = len(measured)
    for _ in range(MAX_REWEIGHTINGS):
        # Parameters: one step at the covariances S and the instrument Z of the last fit. The information of whitened
        # rows is Z^T Z, so that |Z step| is the length of the step in deviations of the parameters.
        rows = _whiten(equations, fit)
        X = informed_directions(noise_spectra.gram(rows.Z, rows.Z))[0]
        step = _step(rows, X)
        step_is_small = np.linalg.norm(rows.Z @ step) < STEP_TOLERANCE
        x = fit.x + step
        # Variances: each is multiplied by the squares that residuals after the step have, over those expected of it.
        # Errors of the motion are at least those that are stated; the upper bound keeps good logs from wandering off.
        ratios = _variance_ratios(rows, X, rows.residuals - rows.Y @ step)
        factors = (fit.factors * ratios[nv:]).clip(1.0, MAX_VARIANCE_FACTOR)
        # Known variances of forces stay. Others have a floor, as errors of the motion do not explain all residuals.
        noise = fit.noise
        if not equations.known:
            usual = equations.usual_square(equations.off - equations.Y @ x)
            floor = np.maximum(equations.least, MIN_NOISE_SHARE * usual)
            noise = np.maximum(fit.noise * ratios[:nv], floor)
        # Variances have settled where their logarithms stay, whatever their sizes; those of forces that are not
        # measured say nothing.
        changes = np.append(np.log(noise / fit.noise)[measured], np.log(factors / fit.factors))
        fit = FittedCorrections(x, noise, factors)
        if step_is_small and np.abs(changes).max(initial=0.0) < LOG_VARIANCE_TOLERANCE:
            break
    return fit


def _whiten(equations: Equations, fit: FittedCorrections) -> WhiteRows:
    """Divide the equations by the roots of their covariances, at a fit."""
    errors, is_measured = equations.errors, equations.counts > 0
    C, nv = is_measured.shape
    # The mass matrix (C, nv, n) at the parameters of the fit, and the variances (C, n) of the accelerations.
    M, kv = np.zeros((C, nv, 0)), np.zeros((C, 0))
    if errors is not None:
        M, kv = errors.mass_matrix(fit.x), fit.factors * errors.variances
    # log |det M| = log det(M^T M) / 2, also where M is not square: on a floating base, nv > n.
    log_mass = float(np.linalg.slogdet(M.mT @ M)[1].mean()) / 2
    # S = diag(s^2 / count + spread) + M diag(k v) M^T in each cell: (C, nv, nv). Forces that are not measured have
    # the variance 1 and no part in M, so that L exists and leaves their rows alone.
    M = M * is_measured[..., None]
    root_of_errors = M * np.sqrt(kv)[:, None]  # (C, nv, n)
    counts = np.where(is_measured, equations.counts, 1.0)
    force_variances = np.where(is_measured, fit.noise / counts + equations.spread, 1.0)
    L = np.linalg.cholesky(force_variances[..., None] * np.eye(nv) + root_of_errors @ root_of_errors.mT)
    residuals = (equations.off - equations.Y @ fit.x) * is_measured
    Y = equations.Y * is_measured[..., None]
    # The regressor Y holds the errors e of accelerations, as the residuals do: this correlation makes parameters too
    # small. The instrument Z is the regressor without the estimate of e, -k v M^T S^-1 r: minus e is added.
    Z = Y
    if errors is not None:
        weighted_residuals = np.linalg.solve(L.mT, np.linalg.solve(L, residuals[..., None]))  # S^-1 r
        minus_e = kv * (M.mT @ weighted_residuals)[..., 0]  # (C, n)
        Z = Y + errors.regressor(minus_e) * is_measured[..., None]
    # Roots of the parts of S. That of s_j^2 is 1 / count in row and column j, that of k_j is v_j M_j M_j^T with the
    # column M_j of M. Factors of fits are at least 1, so that none is replaced by 1.
    force_parts = (is_measured / np.sqrt(counts))[..., None] * np.eye(nv)
    error_parts = root_of_errors / np.where(fit.factors > 0, np.sqrt(fit.factors), 1.0)
    # All right sides share L: one call.
    right_sides = np.concatenate([Z, Y, residuals[..., None], force_parts, error_parts], axis=-1)
    white = np.linalg.solve(L, right_sides)
    P = Y.shape[-1]
    return WhiteRows(
        white[..., :P],
        white[..., P : 2 * P],
        white[..., 2 * P],
        white[..., 2 * P + 1 :],
        L,
        (root_of_errors**2).sum(axis=-1),
        log_mass,
    )


def _step(rows: WhiteRows, X: np.ndarray) -> np.ndarray:
    """Return the step (P,) after which residuals are orthogonal to Z.

    Steps X u in the directions X with information solve X^T Z^T (r - Y X u) = 0, one equation per direction.
    """
    B = X.T @ noise_spectra.gram(rows.Z, rows.Y) @ X
    return np.asarray(X @ np.linalg.solve(B, X.T @ noise_spectra.gradient(rows.Z, rows.residuals)))


def _variance_ratios(rows: WhiteRows, X: np.ndarray, residuals: np.ndarray) -> np.ndarray:
    """Return the factors of variances that residuals ask for: (nv + n,).

    Restricted maximum likelihood has the fixed point |G^T r|^2 = tr(G^T (1 - Q Q^T) G) for the root G of each part,
    with orthonormal Q = Z X. The right side is what is expected if the variances are those that whiten the rows, less
    what the fit takes; the ratio of both sides is the factor.
    """
    Q = rows.Z @ X
    squares = ((rows.parts.mT @ residuals[..., None])[..., 0] ** 2).sum(axis=0)
    # Noise of different cells is independent, so that products of Q and G add up cell by cell.
    taken_by_fit = ((Q.mT @ rows.parts) ** 2).sum(axis=(0, 1))
    expected = (rows.parts**2).sum(axis=(0, 1)) - taken_by_fit
    # Parts of which nothing is expected, such as those of forces that are not measured, keep their variances.
    return np.divide(squares, expected, out=np.ones_like(squares), where=expected > 0)


def _score(equations: Equations, fit: FittedCorrections) -> float:
    """Return the mean negative log density of the accelerations at a fit."""
    rows = _whiten(equations, fit)
    # Up to a constant, a cell's forces have the negative log density log det L + |L^-1 r|^2 / 2. Accelerations have a
    # density |det M| times as large.
    of_forces = np.log(np.diagonal(rows.L, axis1=1, axis2=2)).sum(axis=1) + (rows.residuals**2).sum(axis=1) / 2
    return float(of_forces.mean() - rows.log_mass)


def _estimate(
    equations: Equations, fit: FittedCorrections, logs: noise_spectra.Logs, offset_forces: np.ndarray
) -> Regression:
    """Return the solution at a fit, with its deviations.

    Deviations follow from the spectra of the residuals, and from the differences between logs. Offsets of encoders make
    forces (C, nv, n).
    """
    rows, is_measured = _whiten(equations, fit), equations.counts > 0
    # Directions X (P, r) with information, and the orthonormal columns Q (C, nv, r) of Z in them.
    information = noise_spectra.gram(rows.Z, rows.Z)
    X, values, blind = informed_directions(information)
    Q = rows.Z @ X
    # The spectra (C, nv) of the noise of whitened rows. They are 1 of known variances, else those that the residuals
    # show, not below those of the best sensors. All variances grow where logs contradict each other.
    are_independent, logs = len(logs) == 0, logs if len(logs) > 0 else noise_spectra.ONE_LOG
    leverages, least = noise_spectra.leverages(Q, logs), equations.least / fit.noise
    spectra = np.ones(rows.residuals.shape)
    if not equations.known and are_independent:
        spectra = noise_spectra.independent_spectra(leverages, is_measured.sum(axis=0))
    elif not equations.known:
        spectra = noise_spectra.noise_spectra(leverages, rows.residuals, least, logs)
    # Independent cells have no parts that could differ: those of poses are as they come.
    scatter = np.ones(1) if are_independent else noise_spectra.log_scatter(Q, rows.residuals, spectra, logs)
    growth = max(1.0, float(scatter.mean()))
    # The sandwich B^-1 F B^-T in the directions: (r, r). F, the covariance of Q^T n, is 1 if the noise n is white.
    B_inverse = np.linalg.inv(X.T @ noise_spectra.gram(rows.Z, rows.Y) @ X)
    F = noise_spectra.spectral_gram(Q, spectra, logs)
    direction_covariance = growth * B_inverse @ F @ B_inverse.T
    # Back to the parameters, (r, r) -> (P, P). On the diagonal, parameters that are not determined get infinity.
    covariance = X @ direction_covariance @ X.T
    covariance[blind, blind] = np.inf
    # `dual` (P, r) has X^T dual = 1. So dual D^-1 dual^T is the inverse of the covariance X D X^T in the directions.
    dual = information @ X
    # The model lacks the forces d of offsets, so that they move x by B^-1 Z^T S^-1 d. Whitened, they are L^-1 d.
    white_offsets = np.linalg.solve(rows.L, offset_forces * is_measured[..., None])
    # Variances of one sample where the regressor has its power, then those of the averages over cells.
    noise = fit.noise * growth * noise_spectra.band_means(leverages, spectra)
    mean_counts = np.where(equations.measured, equations.counts.mean(axis=0), 0.0)
    force_variances = np.divide(noise, equations.counts, out=np.full(is_measured.shape, np.inf), where=is_measured)
    # At the uncertain ends of a smoothing, errors of the motion have any size: they are reported without these ends.
    trusted = np.ones(len(is_measured), dtype=bool)
    if equations.errors is not None and equations.errors.trusted.any():
        trusted = equations.errors.trusted
    return Regression(
        x=fit.x,
        covariance=covariance,
        rank=len(values),
        condition=float(np.sqrt(values.max() / values.min())) if len(values) > 0 else np.inf,
        information=dual @ np.linalg.inv(direction_covariance) @ dual.T,
        deviations=np.sqrt(np.divide(noise, mean_counts, out=np.full(len(noise), np.inf), where=mean_counts > 0)),
        weights=1 / (force_variances + equations.spread + rows.error_variances),
        scatter=scatter,
        motion_errors=np.sqrt(rows.error_variances[trusted].mean(axis=0)),
        offsets=X @ B_inverse @ noise_spectra.gram(Q, white_offsets),
    )


def informed_directions(information: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Find the directions X with information: (P, r), where X^T information X = 1.

    Returns also the eigenvalues (r,) of the information in these directions, its diagonal scaled to 1, and a mask (P,)
    of parameters that the data do not determine, alone or in combination.
    """
    # Columns of unit length make the eigenvalues of parameters in different units comparable.
    scale = np.sqrt(np.diag(information))
    scale = np.where(scale > 0, scale, 1.0)
    values, vectors = np.linalg.eigh(information / scale / scale[:, None])
    informed = values > INFORMATION_RANK_TOLERANCE * values.max(initial=0.0)
    # A parameter is undetermined if directions without information have a share in it.
    blind = (vectors[:, ~informed] ** 2).sum(axis=1) > NULL_SPACE_TOLERANCE
    return vectors[:, informed] / scale[:, None] / np.sqrt(values[informed]), values[informed], blind
