"""From checked arrays to results: series made of them, long batches worked in pieces, `out=` filled at the end."""

from collections.abc import Callable, Sequence
from itertools import combinations
from typing import Any

import numpy as np

from jounce._scalars import FLOAT, Array, is_numeric
from jounce.arguments.rates import batch_of, broadcast, rate_name
from jounce.errors import JounceError
from jounce.native.kernel import Kernel
from jounce.spatial.series import Series, columns

Law = Callable[[Series, Series | None], Series]  # a law of `paths` for one mechanism

PIECE = 2**20  # bytes that a working array of a piece may take: longer batches are cut, to stay near the cache


def evaluate(law: Law, q: Sequence[Array], W: Sequence[Array], order: int, width: int) -> tuple[Array, ...]:
    """The terms 0 .. order of a law, for the whole batch; `width` is the number of scalars a state works on."""
    arrays = broadcast(*_axes(q, W))
    batch = arrays[0].shape[:-1]
    size, piece = int(np.prod(batch)), max(1, PIECE // (8 * width))
    if size <= piece or not all(is_numeric(x) for x in arrays):
        return _terms(law, arrays[: len(q)], arrays[len(q) :], order)
    flat = [x.reshape((size, *x.shape[len(batch) :])) for x in arrays]
    pieces = [
        _terms(law, [x[i : i + piece] for x in flat[: len(q)]], [x[i : i + piece] for x in flat[len(q) :]], order)
        for i in range(0, size, piece)
    ]
    joined = (np.concatenate(terms) for terms in zip(*pieces, strict=True))
    return tuple(x.reshape((*batch, *x.shape[1:])) for x in joined)


def _terms(law: Law, q: Sequence[Array], W: Sequence[Array], order: int) -> tuple[Array, ...]:
    loads = Series.of([w.reshape((*w.shape[:-2], 6 * w.shape[-2], 1)) for w in W]) if W else None
    return law(columns(q), loads).upto(order)


def _axes(q: Sequence[Array], W: Sequence[Array]) -> tuple[list[Array], list[int], list[str]]:
    """The arrays, how many of their axes are no batch axes, and their names."""
    labels = [rate_name("q", k) for k in range(len(q))] + [rate_name("W", k) for k in range(len(W))]
    return [*q, *W], [1] * len(q) + [2] * len(W), labels


def by_kernel(kernel: Kernel, q: Sequence[Array], W: Sequence[Array], out: Any, threads: int) -> Any:
    """The results of native code, written straight into `out` where it is given."""
    if out is not None:
        batch = batch_of(*_axes(q, W))
        shapes = [(*batch, *shape) for shape in kernel.quantity.interface.given]
        results = kernel(*q, *W, out=_checked(out, shapes, FLOAT), threads=threads)
        return out if isinstance(out, np.ndarray) else results
    try:
        return kernel(*q, *W, threads=threads)
    except JounceError:
        batch_of(*_axes(q, W))  # which says what does not fit
        raise


def delivered(results: tuple[Array, ...], out: Any) -> Any:
    """The one rule of all results: a plain array where there is one, else a tuple; written into `out` where given."""
    if out is not None:
        arrays = _checked(out, [result.shape for result in results], np.asarray(results[0]).dtype)
        for result, array in zip(results, arrays, strict=True):
            np.copyto(array, result, casting="same_kind")
        results = arrays
    return results[0] if len(results) == 1 else results


def _checked(out: Any, shapes: Sequence[tuple[int, ...]], dtype: np.dtype) -> tuple[np.ndarray, ...]:
    """The arrays to write results of these shapes into."""
    arrays = tuple(out) if isinstance(out, tuple | list) else (out,)
    if len(arrays) != len(shapes):
        raise JounceError(f"out has {len(arrays)} arrays; expected {len(shapes)}, one for each result")
    for k, (array, shape) in enumerate(zip(arrays, shapes, strict=True)):
        if not isinstance(array, np.ndarray) or array.shape != shape:
            came = f"shape {array.shape}" if isinstance(array, np.ndarray) else f"type {type(array).__name__}"
            raise JounceError(f"out[{k}] has {came}; expected a NumPy array of shape {shape}")
        if not array.flags.writeable or isinstance(array, np.ma.MaskedArray):
            state = "masked" if array.flags.writeable else "read-only"
            raise JounceError(f"out[{k}] is {state}; expected an array to write into")
        if not np.can_cast(dtype, array.dtype, "same_kind"):
            raise JounceError(f"out[{k}] is of dtype {array.dtype}; expected {dtype}")
    for j, k in combinations(range(len(arrays)), 2):
        if np.shares_memory(arrays[j], arrays[k]):
            raise JounceError(f"out[{j}] and out[{k}] share memory; expected arrays of their own")
    return arrays
