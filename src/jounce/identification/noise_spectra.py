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


def leverages(Z: np.ndarray, logs: Logs = ONE_LOG) -> np.ndarray:
    """The share (C, nv) of each frequency of each force that a fit with orthonormal columns Z (C, nv, P) takes."""
    return np.asarray((np.abs(_lines(Z, logs)) ** 2).sum(axis=-1))


def _lines(rows: np.ndarray, logs: Logs) -> np.ndarray:
    """The spectral lines of rows (C, ...): of each log those of its frequencies."""
    return np.concatenate([np.fft.fft(rows[log], axis=0, norm="ortho") for log in logs])


def noise_spectra(leverage: np.ndarray, rest: np.ndarray, least: np.ndarray, logs: Logs = ONE_LOG) -> np.ndarray:
    """Spectra (C, nv), at least `least`, of noise of which a fit with leverages (C, nv) leaves residuals (C, nv)."""
    free = (1 - leverage).clip(0)  # what the fit leaves of each frequency
    power = np.abs(_lines(rest, logs)) ** 2
    pairs = [zip(power[log].T, free[log].T, strict=True) for log in logs]
    shape = np.concatenate([np.stack([_noise_shape(*of_force) for of_force in log], axis=1) for log in pairs])
    # the level, where the regressor has its power
    share = leverage * free * shape
    expected, found = share.sum(axis=0), (leverage * power).sum(axis=0)
    level = np.divide(found, expected, out=np.ones_like(found), where=expected > 0)
    squares = (share**2).sum(axis=0)
    freedom = np.divide(expected**2, squares, out=np.full_like(found, np.inf), where=squares > 0)
    level *= 1 + 2 / (np.maximum(freedom, MIN_STUDENT_FREEDOM) - 2)
    return np.asarray(np.maximum(level * shape, least))


def band_means(leverage: np.ndarray, spectra: np.ndarray) -> np.ndarray:
    """Means (nv,) of spectra (C, nv), where the columns of a fit have their power, by its leverages (C, nv)."""
    total = leverage.sum(axis=0)
    return np.divide((leverage * spectra).sum(axis=0), total, out=spectra.mean(axis=0), where=total > 0)


def _noise_shape(power: np.ndarray, free: np.ndarray) -> np.ndarray:
    """The most likely spectrum (C,) of white noise and noise whose correlation decays.

    By Whittle's likelihood, of periodograms (C,) with a share of freedom each; over some correlation times and shares.
    """
    count, cosine = max(free.sum(), 1.0), np.cos(2 * np.pi * np.fft.fftfreq(len(power)))
    best, least = np.ones_like(power), np.inf
    for time in 2.0 ** np.arange(0, max(1.0, np.log2(len(power) / MIN_CORRELATION_TIMES))):
        decay = np.exp(-1 / time)
        slow = (1 - decay**2) / (1 + decay**2 - 2 * decay * cosine)
        for white in WHITE_SHARES:
            shape = white + (1 - white) * slow
            level = max((power / shape).sum() / count, np.finfo(float).tiny)
            if (likelihood := count * np.log(level) + (free * np.log(shape)).sum()) < least:
                best, least = level * shape, likelihood
    return best


def log_scatter(Z: np.ndarray, rest: np.ndarray, spectra: np.ndarray, logs: Logs = ONE_LOG) -> np.ndarray:
    """How many times as large variances are by how each log, or the first half of the only one, differs from others.

    Z are orthonormal, and the rest is orthogonal to them, so that the gradients of the parts add up to 0: that of a
    part is T^T n of the noise n, with T = Z (1 - H) in that part and -Z H elsewhere, H the information of the part.
    """
    root = np.linalg.cholesky(spectral_gram(Z, spectra, logs))
    found = []
    for part in logs if len(logs) > 1 else (slice(len(Z) // 2),):
        T = -Z @ gram(Z[part], Z[part])
        T[part] += Z[part]
        shares, axes = np.linalg.eigh(np.linalg.solve(root, np.linalg.solve(root, spectral_gram(T, spectra, logs)).T))
        kept = shares > MIN_PART_SHARE
        left = axes[:, kept].T @ np.linalg.solve(root, gradient(Z[part], rest[part]))
        found.append(np.mean(left**2 / shares[kept]) if kept.any() else 1.0)
    return np.array(found)


def spectral_gram(rows: np.ndarray, spectra: np.ndarray, logs: Logs = ONE_LOG) -> np.ndarray:
    """The covariance (P, P) of rows^T n, of rows (C, nv, P) and noise n with spectra (C, nv)."""
    lines = _lines(rows, logs) * np.sqrt(spectra)[..., None]
    return np.asarray(gram(lines.conj(), lines).real)


def gram(A: np.ndarray, B: np.ndarray) -> np.ndarray:
    """A^T B of rows (C, nv, P)."""
    count = A.shape[0] * A.shape[1]
    return np.asarray(A.reshape(count, A.shape[2]).T @ B.reshape(count, B.shape[2]))


def gradient(A: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """A^T rest of rows (C, nv, P) and (C, nv)."""
    return np.asarray(A.reshape(-1, A.shape[-1]).T @ rest.ravel())
