"""Kernel: a quantity of one robot as CUDA code, to call on arrays on a GPU."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from math import prod
from typing import TYPE_CHECKING, Any

import numpy as np

from jounce.core.errors import JounceError, one_line
from jounce.core.scalars import is_jax
from jounce.cuda import arrays as device
from jounce.cuda.source import THREADS_PER_BLOCK, compile_source, require_gpu, source
from jounce.dynamics.computation import Computation
from jounce.engine.generic_methods import batch_shape
from jounce.model.mechanism import Mechanism
from jounce.native.arguments import refuse_names_and_masks, refuse_shapes

if TYPE_CHECKING:
    import cupy


class CudaKernel:
    """A quantity of one robot with its rates up to an order on a GPU. `jounce.cuda.compile` makes one.

    It can be pickled; an unpickled one is read from CuPy's cache on disk or compiled again.

    Examples
    --------
    >>> import cupy, jounce.cuda  # doctest: +SKIP
    >>> kernel = jounce.cuda.compile(jounce.load("iiwa14"), order=1)  # doctest: +SKIP
    >>> kernel  # doctest: +SKIP
    <cuda.Kernel, float64: inverse_dynamics of 'iiwa14' to order 1>
    >>> Q, Qd = kernel(*cupy.ones((4, 1000, 7)))  # doctest: +SKIP
    """

    def __init__(self, mechanism: Mechanism, computation: Computation, dtype: str) -> None:
        self.mechanism, self.computation, self.dtype = mechanism, computation, np.dtype(dtype)
        self.signature = computation.signature(mechanism)
        require_gpu()
        self._function = compile_source(source(mechanism, computation, dtype == "float32"))

    def __reduce__(self) -> tuple[Callable[..., "CudaKernel"], tuple[Mechanism, Computation, str]]:
        return CudaKernel, (self.mechanism, self.computation, self.dtype.name)

    def __repr__(self) -> str:
        return f"<cuda.Kernel, {self.dtype.name}: {self.computation.describe(self.mechanism.name)}>"

    def __call__(self, *arrays: Any, out: Any = None) -> Any:
        """Compute the quantity and its rates on the GPU where the arrays are.

        Parameters
        ----------
        *arrays : (..., n), then (..., nb, 6), then (..., 4, 4) and (..., 6)
            q, qd, ..., as many as the quantity and its order take; W, Wd, ... after them if it was compiled with
            wrenches; C, V, Vd, ... if it was compiled with the motion of the base. Arrays of CuPy, of JAX on a GPU, or
            of another library with `__cuda_array_interface__`, of the kernel's dtype; batch axes lead and broadcast.
            Arrays are read in place where the step from state to state is the same all over, and so is the step from
            entry to entry; others are copied, as are those that share memory with `out`.
        out : array or tuple of arrays, optional
            Arrays to write the results into, in place where they have steps as above; those of JAX cannot be written
            into.

        Returns
        -------
        array, or for orders above 0 a tuple of arrays
            Arrays of JAX where the first argument is one, else of CuPy. The call returns before the GPU is done, as
            those of CuPy do, except where arrays are of another library.

        Raises
        ------
        JounceError
            If the number of arrays, a shape or a dtype is wrong, an array is not on the GPU of the first one, or the
            memory of the GPU is too small for the results.

        Examples
        --------
        >>> import cupy, jounce.cuda  # doctest: +SKIP
        >>> kernel = jounce.cuda.compile(jounce.load("planar2r"), "gravity_forces", order=0)  # doctest: +SKIP
        >>> kernel(cupy.zeros((1000, 2))).shape  # doctest: +SKIP
        (1000, 2)
        """
        import cupy

        ports = self.signature.inputs
        into = None if out is None else tuple(out) if type(out) in (tuple, list) else (out,)
        if len(arrays) != len(ports):
            raise JounceError(f"{self!r} expects {len(ports)} arrays, got {len(arrays)}")
        refuse_names_and_masks(repr(self), arrays, into or ())
        if into is not None and any(map(is_jax, into)):
            raise JounceError("out holds arrays of JAX, which cannot be written into; leave out= away")
        with _report_gpu_errors(self):
            given = [device.as_gpu_array(port.name, x) for port, x in zip(ports, arrays, strict=True)]
            results = None if into is None else [device.as_gpu_array(f"out[{k}]", x) for k, x in enumerate(into)]
            self._check(given, results or [])
            with given[0].device:
                found = self._run(given, results)
                if not all(isinstance(x, cupy.ndarray) for x in (*arrays, *(into or ()))):
                    cupy.cuda.get_current_stream().synchronize()  # others may reuse the memory of theirs at once
        if into is None and is_jax(arrays[0]):
            import jax

            found = [jax.dlpack.from_dlpack(x) for x in found]
        returned = tuple(found) if into is None else into
        return returned[0] if len(returned) == 1 else returned

    def _check(self, given: Sequence["cupy.ndarray"], results: Sequence["cupy.ndarray"]) -> None:
        """Raise `JounceError` for shapes, precisions and places that do not fit."""
        ports = self.signature.inputs
        refuse_shapes(repr(self), ports, given)
        for port, x in zip(ports, given, strict=True):
            device.check_dtype(port.name, x, self.dtype)
        places = {x.device.id for x in (*given, *results)}
        if len(places) > 1:
            raise JounceError(f"{self!r}: arrays are on GPUs {', '.join(map(str, sorted(places)))}; expected one GPU")

    def _run(self, given: Sequence["cupy.ndarray"], out: Sequence["cupy.ndarray"] | None) -> Sequence["cupy.ndarray"]:
        """The results of checked arrays of one GPU, written into `out` if it is given."""
        import cupy

        ports, batch = self.signature, batch_shape(self.signature.inputs, given)
        shapes = [(*batch, *port.shape) for port in ports.outputs]
        if out is None:
            out = [cupy.empty(shape, self.dtype) for shape in shapes]
        else:
            device.check_out(out, shapes, self.dtype)
        if prod(batch) == 0:
            return out
        written = [
            x if device.steps(x, len(port.shape)) is not None else cupy.empty(x.shape, self.dtype)
            for x, port in zip(out, ports.outputs, strict=True)
        ]
        apart = [x.copy() if any(cupy.may_share_memory(x, y) for y in written) else x for x in given]
        whole = [device.with_steps(x, port, batch) for x, port in zip(apart, ports.inputs, strict=True)]
        both = zip([*whole, *written], [*ports.inputs, *ports.outputs], strict=True)
        passed = [value for x, port in both for value in device.kernel_arguments(x, len(port.shape))]
        blocks = -(-prod(batch) // THREADS_PER_BLOCK)
        self._function((blocks,), (THREADS_PER_BLOCK,), (np.int64(prod(batch)), *passed))
        for x, y in zip(out, written, strict=True):
            if x is not y:
                x[...] = y
        return out


@contextmanager
def _report_gpu_errors(kernel: CudaKernel) -> Iterator[None]:
    """Within this context, errors of CuPy are those of jounce, in one line; first of all that memory is short."""
    import cupy

    try:
        yield
    except JounceError:
        raise
    except cupy.cuda.memory.OutOfMemoryError as error:
        raise JounceError(f"{kernel!r}: not enough memory on the GPU; use fewer states: {one_line(error)}") from None
    except (cupy.cuda.runtime.CUDARuntimeError, cupy.cuda.driver.CUDADriverError) as error:
        local = "; threads keep values in its memory, too: use fewer states, float32 or a lower order"
        said = f"{one_line(error)}{local if 'memory' in str(error).lower() else ''}"
        raise JounceError(f"{kernel!r} failed on the GPU: {said}") from None
