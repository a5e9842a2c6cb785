"""Rates: the names q, qd, q2d, ... of a quantity's time derivatives, and the check of those that a caller gives."""

from collections.abc import Sequence

import numpy as np

from jounce._scalars import FLOAT, Array, asarray, namespace
from jounce.errors import JounceError

SUFFIX = r"(d|[2-9]d|[1-9]\d+d)?"  # what `rate_name` adds to a symbol, as a regular expression


def rate_name(symbol: str, k: int) -> str:
    """The name of the k-th time derivative: q, qd, q2d, q3d, ..."""
    return symbol + ("" if k == 0 else "d" if k == 1 else f"{k}d")


def has_rates(given: object, axes: int) -> bool:
    """Whether a caller's tuple or list holds a quantity of so many axes with its rates, not the quantity's own rows."""
    return isinstance(given, tuple | list) and not (len(given) > 0 and np.ndim(given[0]) == axes - 1)


def checked(given: Sequence[Array | None], least: int, names: Sequence[str]) -> list[Array]:
    """The coordinates and their rates as arrays (..., n): at least `least` of them, none skipped."""
    terms = list(given)
    while len(terms) > least and terms[-1] is None:
        terms.pop()
    return [_column(term, k, names, terms) for k, term in enumerate(terms)]


def _skipped(terms: Sequence[Array | None]) -> JounceError:
    k = next(k for k, term in enumerate(terms) if term is None)
    after = [rate_name("q", j) for j in range(k + 1, len(terms)) if terms[j] is not None]
    skipped = f", yet {after[0]} is given" if after else ""
    return JounceError(f"{rate_name('q', k)} is None{skipped}; expected every rate up to the last")


def _column(term: Array | None, k: int, names: Sequence[str], terms: Sequence[Array | None]) -> Array:
    if type(term) is np.ndarray and term.dtype is FLOAT and term.shape[-1:] == (len(names),):
        return term  # as most are, and some a thousand times a second
    if term is None:
        raise _skipped(terms)
    label = rate_name("q", k)
    array = asarray(term, label)
    if array.ndim == 0 or array.shape[-1] != len(names):
        raise JounceError(f"{label} has shape {array.shape}; expected (..., {len(names)}): {', '.join(names)}")
    return array


def batch_of(arrays: Sequence[Array], tails: Sequence[int], labels: Sequence[str]) -> tuple[int, ...]:
    """The shape to which the leading (batch) axes broadcast, all but the last `tails` axes of each array."""
    batches = [x.shape[: x.ndim - tail] for x, tail in zip(arrays, tails, strict=True)]
    try:
        return np.broadcast_shapes(*batches)
    except ValueError:
        shapes = ", ".join(f"{label} {b}" for label, b in zip(labels, batches, strict=True))
        raise JounceError(f"batch axes do not fit together: {shapes}") from None


def broadcast(arrays: Sequence[Array], tails: Sequence[int], labels: Sequence[str]) -> list[Array]:
    """The arrays with their leading (batch) axes broadcast against each other; the last `tails` axes stay."""
    batch, xp = batch_of(arrays, tails, labels), namespace(*arrays)
    return [xp.broadcast_to(x, batch + x.shape[x.ndim - tail :]) for x, tail in zip(arrays, tails, strict=True)]
