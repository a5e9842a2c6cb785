"""Comparisons of arrays by the largest of their numbers."""

from collections.abc import Iterable
from typing import Any

import numpy as np


def assert_close(found: Any, expected: Any, tolerance: float = 1e-12) -> None:
    """Norm-wise, by the largest number of the expected array, or absolutely where all are small."""
    found, expected = np.asarray(found, dtype=float), np.asarray(expected, dtype=float)
    assert found.shape == expected.shape
    assert np.abs(found - expected).max(initial=0) <= tolerance * (1 + np.abs(expected).max(initial=0))


def assert_all_close(found: Iterable[Any], expected: Iterable[Any], tolerance: float = 1e-12) -> None:
    """Each array of several close to the expected one."""
    for x, y in zip(found, expected, strict=True):
        assert_close(x, y, tolerance)
