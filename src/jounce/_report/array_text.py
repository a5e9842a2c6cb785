"""Arrays as text in a page: base64 of their bytes, as plotly.js reads them, and our own script too."""

from base64 import b64encode

import numpy as np

Packed = dict[str, str]
VISIBLE_SHARE = 1e-5  # of the width of a chart: less than a hundredth of a pixel


def pack_array(array: np.ndarray, dtype: str = "f8") -> Packed:
    """An array, in the order of its rows, as little-endian "f8", "f4" or "i4"."""
    return {"dtype": dtype, "bdata": b64encode(np.ascontiguousarray(array, dtype=f"<{dtype}").tobytes()).decode()}


def pack_times(t: np.ndarray) -> Packed:
    """Times to be drawn: in single precision where no screen shows the difference, as it does for stamps since 1970."""
    step = np.finfo(np.float32).eps * np.abs(t).max()
    return pack_array(t, "f4" if step < VISIBLE_SHARE * np.ptp(t) else "f8")


def list_finite(rows: np.ndarray) -> list[list[float | None]]:
    """Rows of numbers, None in the place of those that JSON has not: infinite and NaN."""
    return [[x if np.isfinite(x) else None for x in row] for row in rows.tolist()]
