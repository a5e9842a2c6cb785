"""Arrays on a GPU as kernels take them: an address, the step between states, and that between entries of a state."""

from collections.abc import Sequence
from itertools import pairwise
from math import prod
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from jounce.core.errors import JounceError, one_line
from jounce.core.scalars import is_jax
from jounce.dynamics.computation import Port, Shape

if TYPE_CHECKING:
    import cupy


def as_gpu_array(name: str, x: Any) -> "cupy.ndarray":
    """Return an array on one GPU, of CuPy, JAX or another library, as one of CuPy, without a copy; or refuse it."""
    import cupy

    if isinstance(x, cupy.ndarray):
        return x
    kind = f"{type(x).__module__.partition('.')[0]}.{type(x).__name__}"
    try:
        if is_jax(x):
            return cupy.from_dlpack(_check_one_gpu(name, x))
        if hasattr(x, "__cuda_array_interface__"):
            return cupy.asarray(x)
    except JounceError:
        raise
    except Exception as error:  # foreign types may refuse for reasons of their own
        raise JounceError(f"{name} is a {kind} that CuPy does not take: {one_line(error)}") from None
    raise JounceError(f"{name} is a {kind}; expected an array on the GPU, which cupy.asarray makes of one of NumPy")


def _check_one_gpu(name: str, x: Any) -> Any:
    """An array of JAX, which is on one GPU."""
    places = sorted(map(str, x.devices()))
    if len(places) > 1 or any(device.platform != "gpu" for device in x.devices()):
        raise JounceError(
            f"{name} is an array of JAX on {', '.join(places)}; expected one GPU: jax.device_put moves it"
        )
    return x


def check_dtype(name: str, x: "cupy.ndarray", dtype: np.dtype) -> None:
    """Raise `JounceError` for an array of another precision: to convert it would take a copy."""
    if x.dtype != dtype:
        raise JounceError(
            f"{name} has dtype {x.dtype}, but the kernel computes in {dtype}: x.astype({dtype.name!r}) converts it,"
            " jounce.cuda.compile(..., dtype=) chooses the precision"
        )


def single_step(lengths: Shape, strides: Shape) -> int | None:
    """Return the stride between the elements of some axes counted row after row; None if it varies."""
    axes = [(length, stride) for length, stride in zip(lengths, strides, strict=True) if length > 1]
    for (_, outer), (length, inner) in pairwise(axes):
        if outer != length * inner:
            return None
    return axes[-1][1] if axes else 0


def steps(x: "cupy.ndarray", inner: int) -> tuple[int, int] | None:
    """Return the steps between states and between entries, in numbers, `inner` axes being of entries; or None.

    It is None where a step varies, as between the rows of every other matrix, or is no multiple of the item size.
    """
    cut = x.ndim - inner
    outer = single_step(x.shape[:cut], x.strides[:cut])
    entry = single_step(x.shape[cut:], x.strides[cut:])
    if outer is None or entry is None or outer % x.itemsize or entry % x.itemsize:
        return None
    return outer // x.itemsize, entry // x.itemsize


def kernel_arguments(x: "cupy.ndarray", inner: int) -> tuple[Any, ...]:
    """What a kernel takes of an array that has steps: where it begins, and both of them."""
    found = steps(x, inner)
    assert found is not None
    return (x, *map(np.int64, found))


def with_steps(x: "cupy.ndarray", port: Port, batch: Shape) -> "cupy.ndarray":
    """Return an array broadcast to a batch, copied where the steps between its states vary."""
    import cupy

    whole = cupy.broadcast_to(x, (*batch, *port.shape))
    return whole if steps(whole, len(port.shape)) is not None else cupy.ascontiguousarray(whole)


def addresses(x: "cupy.ndarray") -> np.ndarray:
    """Return an array of NumPy over the addresses of an array on a GPU, to ask what memory it shares; never read."""
    interface = {
        "data": (x.data.ptr, True), "shape": x.shape, "strides": x.strides, "typestr": x.dtype.str, "version": 3
    }  # fmt: skip
    return np.asarray(SimpleNamespace(__array_interface__=interface))


def check_out(out: Sequence["cupy.ndarray"], shapes: Sequence[Shape], dtype: np.dtype) -> None:
    """Raise `JounceError` for arrays that results of these shapes cannot be written into."""
    if len(out) != len(shapes):
        raise JounceError(f"out has {len(out)} arrays; expected {len(shapes)}, one for each result")
    for k, (x, shape) in enumerate(zip(out, shapes, strict=True)):
        if x.shape != shape:
            raise JounceError(f"out[{k}] has shape {x.shape}; expected {shape}")
        check_dtype(f"out[{k}]", x, dtype)
        if any(stride == 0 for length, stride in zip(x.shape, x.strides, strict=True) if length > 1):
            raise JounceError(f"out[{k}] is broadcast, several entries lie in one place; expected places of their own")
    for k, x in enumerate(out):
        if prod(x.shape) and any(np.shares_memory(addresses(x), addresses(y)) for y in out[:k]):
            raise JounceError(f"out[{k}] shares memory with another array of out; expected arrays of their own")
