"""Deviations of least squares whose noise is not white: the spectra of residuals, and what logs differ by.

Residuals of a fit to a robot are serially correlated: at low frequencies, where the regressor has its power, they hold
what the model leaves out. The fit takes the leverage h(f) of its rows at a frequency for itself, the share that the
orthonormal columns have there, and leaves E |r(f)|^2 = (1 - h(f)) S(f) of noise of the spectrum S.

Algorithm: the shape of S is the most likely one (Whittle's likelihood) of white noise and noise whose correlation
decays; its level is where the regressor has its power, sum h |r|^2 / sum h (1 - h) S. A level of few frequencies is
itself uncertain, which makes errors over deviations larger: Student's t. The covariance of the parameters is a
sandwich with S between the columns. Each log has a shape of its own, and all share a factor of the level. Where logs,
or the halves of the only one, then differ by more than this covariance lets them, all variances grow by that factor:
noise that is slower than a log, a robot that changes.

P. Whittle, "Estimation and information in stationary time series", Arkiv för Matematik 2, 1953.
"""

from collections.abc import Sequence

import numpy as np

MIN_STUDENT_FREEDOM = 4.0  # degrees: of fewer the variance of Student's t says nothing
WHITE_SHARES = (1.0, 0.9, 0.7, 0.5, 0.3, 0.1, 0.03, 0.0)  # of the variance of noise
MIN_CORRELATION_TIMES = 4.0  # in a log: noise that is slower shows in what logs, or its halves, differ by
MIN_PART_SHARE = 0.01  # of the variance in which a part differs, for a direction: less are known from others alone

Logs = Sequence[slice]  # the cells of each log
ONE_LOG: Logs = (slice(None),)
INDEPENDENT: Logs = ()  # cells that follow from no log: the noise of poses is white


def leverages(Z: np.ndarray, logs: Logs = ONE_LOG) -> np.ndarray:
    """Return the shares of frequencies of forces that a fit takes: (C, nv).

    Z (C, nv, P) are its orthonormal columns.
    """
    return np.asarray((np.abs(_lines(Z, logs)) ** 2).sum(axis=-1))


def _lines(rows: np.ndarray, logs: Logs) -> np.ndarray:
    """Return the spectral lines of rows (C, ...), log by log."""
    return np.concatenate([np.fft.fft(rows[log], axis=0, norm="ortho") for log in logs])


def noise_spectra(leverage: np.ndarray, residuals: np.ndarray, least: np.ndarray, logs: Logs = ONE_LOG) -> np.ndarray:
    """Return spectra of the noise behind residuals of a fit: (C, nv) both.

    The fit has leverages (C, nv); spectra are at least `least`.
    """
    # The shape S of each force in each log, by what the fit leaves of each frequency, E |r|^2 = (1 - h) S.
    free = (1 - leverage).clip(0)
    power = np.abs(_lines(residuals, logs)) ** 2
    pairs = [zip(power[log].T, free[log].T, strict=True) for log in logs]
    shape = np.concatenate([np.stack([_noise_shape(*of_force) for of_force in log], axis=1) for log in pairs])
    # Its level, where the regressor has its power: sum h |r|^2 / sum h (1 - h) S, one factor for all logs.
    share = leverage * free * shape
    expected, squares = share.sum(axis=0), (leverage * power).sum(axis=0)
    level = np.divide(squares, expected, out=np.ones_like(squares), where=expected > 0)
    # The level has f = (sum w)^2 / sum w^2 degrees of freedom, of weights w; Student's t has the variance f / (f - 2).
    share_squares = (share**2).sum(axis=0)
    freedom = np.divide(expected**2, share_squares, out=np.full_like(squares, np.inf), where=share_squares > 0)
    level *= 1 + 2 / (np.maximum(freedom, MIN_STUDENT_FREEDOM) - 2)
    return np.asarray(np.maximum(level * shape, least))


def independent_spectra(leverage: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Return the spectra (C, nv) of independent noise of variance 1.

    Its variance follows from `counts` (nv,) of measured cells less what the fit takes of them: by Student's t it is
    uncertain, as the level of any spectrum.
    """
    freedom = np.maximum(counts - leverage.sum(axis=0), MIN_STUDENT_FREEDOM)
    return np.broadcast_to(1 + 2 / (freedom - 2), leverage.shape)


def band_means(leverage: np.ndarray, spectra: np.ndarray) -> np.ndarray:
    """Return means (nv,) of spectra where columns of a fit have power."""
    total = leverage.sum(axis=0)
    return np.divide((leverage * spectra).sum(axis=0), total, out=spectra.mean(axis=0), where=total > 0)


def _noise_shape(power: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Return the most likely spectrum (C,) of white and of slow noise.

    The correlation of slow noise decays. Whittle's likelihood, of periodograms (C,) with a share of freedom each,
    decides among some correlation times and shares of white noise.
    """
    count, cosine = max(free.sum(), 1.0), np.cos(2 * np.pi * np.fft.fftfreq(len(power)))
    best, least = np.ones_like(power), np.inf
    # Times in cells, doubled up to a part of the log.
    for time in 2.0 ** np.arange(0, max(1.0, np.log2(len(power) / MIN_CORRELATION_TIMES))):
        # The spectrum of noise with the correlation decay^k over k cells, of variance 1.
        decay = np.exp(-1 / time)
        slow = (1 - decay**2) / (1 + decay**2 - 2 * decay * cosine)
        for white in WHITE_SHARES:
            shape = white + (1 - white) * slow
            # The likeliest level of this shape, and minus its log likelihood, sum of log S, up to constants.
            level = max((power / shape).sum() / count, np.finfo(float).tiny)
            likelihood = count * np.log(level) + (free * np.log(shape)).sum()
            if likelihood < least:
                best, least = level * shape, likelihood
    return best


def log_scatter(Z: np.ndarray, residuals: np.ndarray, spectra: np.ndarray, logs: Logs = ONE_LOG) -> np.ndarray:
    """Return by which factors logs differ more than their noise.

    Of one log its halves are compared. Z are orthonormal, and residuals orthogonal to them, so that the gradients of
    the parts add up to 0: that of a part is T^T n of the noise n, with T = Z (1 - H) in that part and -Z H elsewhere, H
    the information of the part.
    """
    # The root of F, the covariance (P, P) of Z^T n.
    root = np.linalg.cholesky(spectral_gram(Z, spectra, logs))
    factors = []
    # Of the halves of one log, the gradients are opposite: the first says all.
    for part in logs if len(logs) > 1 else (slice(len(Z) // 2),):
        T = -Z @ gram(Z[part], Z[part])
        T[part] += Z[part]
        # The variance of the part's gradient in the axes where F is 1: eigenvalues are its shares of F. Directions of
        # small shares are known from other parts alone.
        shares, axes = np.linalg.eigh(np.linalg.solve(root, np.linalg.solve(root, spectral_gram(T, spectra, logs)).T))
        known = shares > MIN_PART_SHARE
        gradients = axes[:, known].T @ np.linalg.solve(root, gradient(Z[part], residuals[part]))
        # chi^2 per degree of freedom: squares of the gradient over their variances.
        factors.append(np.mean(gradients**2 / shares[known]) if known.any() else 1.0)
    return np.array(factors)


def spectral_gram(rows: np.ndarray, spectra: np.ndarray, logs: Logs = ONE_LOG) -> np.ndarray:
    """Return the covariance of rows^T n: (P, P), of noise n with spectra (C, nv)."""
    # Spectral lines of stationary noise are independent: rows (C, nv, P) weigh them by their own lines.
    lines = _lines(rows, logs) * np.sqrt(spectra)[..., None]
    return np.asarray(gram(lines.conj(), lines).real)


def gram(A: np.ndarray, B: np.ndarray) -> np.ndarray:
    """Return A^T B of rows (C, nv, P)."""
    count = A.shape[0] * A.shape[1]
    return np.asarray(A.reshape(count, A.shape[2]).T @ B.reshape(count, B.shape[2]))


def gradient(A: np.ndarray, residuals: np.ndarray) -> np.ndarray:
    """Return A^T r: of rows A (C, nv, P) and residuals r (C, nv)."""
    return np.asarray(A.reshape(-1, A.shape[-1]).T @ residuals.ravel())
