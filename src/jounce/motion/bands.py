"""Bands of 95 % about uncertain values, and the largest value that stands out of its band.

Towards the ends of a fit deviations rise by powers of ten, and the values with them: the largest one says nothing.
"""

import numpy as np

BAND_DEVIATIONS = 1.96  # standard deviations on either side: 95 % of a normal distribution


def surest_peaks(values: np.ndarray, deviations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The absolute values along the first axis that are largest less their bands, and their deviations; no NaN."""
    sure = np.abs(values) - BAND_DEVIATIONS * deviations
    at = np.argmax(np.where(np.isnan(sure), -np.inf, sure), axis=0)[None]
    return np.abs(np.take_along_axis(values, at, 0)[0]), np.take_along_axis(deviations, at, 0)[0]
