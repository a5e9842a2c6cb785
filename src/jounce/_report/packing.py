"""Arrays as text in a page: base64 of their bytes, as plotly.js reads them, and our own script too."""

from base64 import b64encode

import numpy as np

Packed = dict[str, str]


def packed(array: np.ndarray, dtype: str = "f8") -> Packed:
    """An array, in the order of its rows, as little-endian "f8", "f4" or "u2"."""
    return {"dtype": dtype, "bdata": b64encode(np.ascontiguousarray(array, dtype=f"<{dtype}").tobytes()).decode()}
