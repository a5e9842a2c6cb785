"""Quantities of a robot in a user's own graph of Dask, on arrays and data frames larger than memory.

Dask is imported by `apply`, never by this package.
"""

from jounce.dask.arrays import apply

__all__ = ["apply"]
