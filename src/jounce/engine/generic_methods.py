"""Evaluate methods on arrays of any scalar type.

Long batches are computed in pieces, and results are written into `out`.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import combinations, starmap
from typing import Any

import numpy as np

from jounce.core.errors import JounceError
from jounce.core.foreign import has_mask
from jounce.core.scalars import Array, broadcast, common_batch_shape, is_jax, is_numeric
from jounce.dynamics.computation import Computation, Port
from jounce.dynamics.loops import closure_of
from jounce.dynamics.quantities import Quantity
from jounce.model.mechanism import Mechanism
from jounce.model.spring_deflection import UnreachableError
from jounce.spatial.series import Series

Law = Callable[[Sequence[Array]], Series]  # from the arrays of the ports to a quantity

MAX_WORKING_BYTES = 2**20  # of a working array of a piece: longer batches are cut, to stay near the cache


def evaluate(law: Law, ports: Sequence[Port], arrays: Sequence[Array], count: int, width: int) -> tuple[Array, ...]:
    """Return the first `count` terms of a law for the whole batch.

    `width` is the number of working scalars per state.
    """
    arrays = broadcast(arrays, *_axes(ports))
    batch = arrays[0].shape[:-1]
    size, piece = int(np.prod(batch)), max(1, MAX_WORKING_BYTES // (8 * width))
    if size <= piece or not all(is_numeric(x) for x in arrays):
        with _name_failed_state(batch, 0):
            return law(arrays).upto(count - 1)
    # Pieces are of one batch axis: (batch, ...) -> (N, ...) -> (batch, ...).
    flat = [x.reshape((size, *x.shape[len(batch) :])) for x in arrays]
    pieces = []
    for i in range(0, size, piece):
        with _name_failed_state(batch, i):
            pieces.append(law([x[i : i + piece] for x in flat]).upto(count - 1))
    joined = (np.concatenate(terms) for terms in zip(*pieces, strict=True))
    return tuple(x.reshape((*batch, *x.shape[1:])) for x in joined)


@contextmanager
def _name_failed_state(batch: tuple[int, ...], first: int) -> Iterator[None]:
    """Name the state in errors of one state of a batch.

    `first` is the number of the first state of the piece.
    """
    try:
        yield
    except UnreachableError as error:
        state = first + error.state
        index = ", ".join(str(k) for k in np.unravel_index(state, batch))
        message = f"{error}; state [{index}]" if len(batch) > 0 else str(error)
        raise UnreachableError(message, state) from None


def compute_by_method(
    computation: Computation, method: str, mechanism: Mechanism, arrays: Sequence[Array]
) -> tuple[Array, ...]:
    """Compute a quantity and its rates by a method.

    Arrays and the data of the mechanism have one scalar type.
    """
    ports = computation.signature(mechanism).inputs
    width = working_scalars(computation.quantity, method, mechanism.nb)

    def law(x: Sequence[Array]) -> Series:
        # JAX differentiates through the law: dependent coordinates then have to follow q.
        if mechanism.takes_dependent and is_jax(x[-1]):
            x = [*x[:-1], _follow_dependent(mechanism, x[0], x[-1])]
        return computation.series(method, mechanism, x)

    return evaluate(law, ports, arrays, computation.count, width)


def working_scalars(row: Quantity, method: str, nb: int) -> int:
    """Return the size of the largest arrays of a state.

    It has nb bodies.
    """
    # Closed forms have system matrices.
    if method != "recursion":
        return (6 * nb) ** 2
    # Regressors have ten parameters of each body, as columns of wrenches where they have a row for each velocity.
    if "parameters" in row.gives.shape:
        return 10 * nb * (6 * nb if "nv" in row.gives.shape else 1)
    return 6 * nb


def _follow_dependent(mechanism: Mechanism, q: Array, dependent: Array) -> Array:
    """Return the dependent coordinates, arrays of JAX, as functions of q.

    Their derivatives are those along motions of the closed robot.
    """
    import jax

    @jax.custom_jvp
    def following(q: Array, dependent: Array) -> Array:
        return dependent

    @following.defjvp
    def rates(state: tuple[Array, Array], directions: tuple[Array, Array]) -> tuple[Array, Array]:
        # A call of the function itself, so that values follow in further derivatives too.
        value = following(*state)
        velocities = Computation("coordinates", 1).series("recursion", mechanism, [state[0], directions[0], value])[1]
        return value, velocities[..., list(closure_of(mechanism).dependent)]

    return following(q, dependent)


def batch_shape(ports: Sequence[Port], arrays: Sequence[Array]) -> tuple[int, ...]:
    """Return the batch shape of arrays, or raise by their names."""
    return common_batch_shape(arrays, *_axes(ports))


def _axes(ports: Sequence[Port]) -> tuple[list[int], list[str]]:
    """Return the axes of a state and the name of each array."""
    return [len(port.shape) for port in ports], [port.name for port in ports]


def write_results(results: tuple[Array, ...], out: Any) -> Any:
    """Return one result alone, several as a tuple.

    They are copied into `out` if that is given.
    """
    if out is not None:
        arrays = check_out(out, [result.shape for result in results], np.asarray(results[0]).dtype)
        for result, array in zip(results, arrays, strict=True):
            np.copyto(array, result, casting="same_kind")
        results = arrays
    # Results without axes are scalars, not arrays of no axes, as native code has them.
    results = tuple(x[()] if isinstance(x, np.ndarray) and x.ndim == 0 else x for x in results)
    return results[0] if len(results) == 1 else results


def as_tuple(results: Any) -> tuple[Any, ...]:
    """Return the results of a call as a tuple."""
    return results if isinstance(results, tuple) else (results,)


def check_out(out: Any, shapes: Sequence[tuple[int, ...]], dtype: np.dtype) -> tuple[np.ndarray, ...]:
    """Check `out`, the arrays for results of these shapes."""
    arrays = tuple(out) if isinstance(out, tuple | list) else (out,)
    if len(arrays) != len(shapes):
        raise JounceError(f"out has {len(arrays)} arrays; expected {len(shapes)}, one for each result")
    for k, (array, shape) in enumerate(zip(arrays, shapes, strict=True)):
        if not isinstance(array, np.ndarray) or array.shape != shape:
            came = f"shape {array.shape}" if isinstance(array, np.ndarray) else f"type {type(array).__name__}"
            raise JounceError(f"out[{k}] has {came}; expected a NumPy array of shape {shape}")
        if has_mask(array):
            raise JounceError(f"out[{k}] is masked; expected an array without a mask to write into")
        if not array.flags.writeable:
            raise JounceError(f"out[{k}] is read-only; expected an array to write into")
        if not np.can_cast(dtype, array.dtype, "same_kind"):
            raise JounceError(f"out[{k}] is of dtype {array.dtype}; expected {dtype}")
    for j, k in combinations(range(len(arrays)), 2):
        if np.shares_memory(arrays[j], arrays[k]):
            raise JounceError(f"out[{j}] and out[{k}] share memory; expected arrays of their own")
    return arrays


def are_fit(out: Sequence[Any], shapes: Sequence[tuple[int, ...]]) -> bool:
    """Return whether arrays can take results of these shapes.

    NumPy itself checks types, and whether arrays are read-only. This runs once per call of a control loop.
    """
    count, owners = 0, set()
    if len(out) != len(shapes):
        return False
    # Without zip, which would take longer than the rest.
    for array in out:
        if type(array) is not np.ndarray or array.shape != shapes[count]:
            return False
        count += 1
        if array.flags.owndata:
            owners.add(id(array))
    # Different arrays that own their memory share none.
    if count == 1 or count == len(owners):
        return True
    return not any(starmap(np.shares_memory, combinations(out, 2)))
