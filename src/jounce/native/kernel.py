"""Compute a quantity of one robot by native code: a `Kernel` is called on arrays of states.

`compile_kernel` is the door: threads and callers that ask for one kernel share it, and its code is read from the cache
on disk where it is there. A call with arrays of NumPy is one of a ufunc: what does not fit is refused in words once
NumPy has refused it (`refuse_shapes`). Other types are looked at before, as NumPy would drop names and masks
(`refuse_names_and_masks`), and so are arrays to bind, which native code trusts (`check_bound_arrays`).

With several threads a batch is computed in parts that threads take one after the other, all its axes split: threads are
kept for later calls (`compute_in_parts`). Parts of large batches become smaller towards the end: threads that begin
late or run on slower processors take fewer of them, and all end at about the same time [1]. A caller takes parts
itself: no call waits for another one's, and a caller with the threads that are kept makes no more than there are
processors, whatever it asks for.

[1] S. F. Hummel, E. Schonberg, L. E. Flynn, Factoring: a method for scheduling parallel loops, Communications of the
ACM 35, 1992.
"""

import ctypes
import functools
import os
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from contextvars import copy_context
from copy import copy
from functools import partial
from itertools import accumulate, pairwise
from math import inf, prod
from threading import Lock
from typing import TYPE_CHECKING, Any, Never
from weakref import WeakValueDictionary

import numpy as np

from jounce.core import named_entries
from jounce.core.errors import JounceError, one_line, quote_value, warn
from jounce.core.foreign import has_mask
from jounce.core.progress import stage
from jounce.core.scalars import is_traced
from jounce.core.typing import ArrayLike, Floats
from jounce.dynamics.computation import Computation, Port, Shape, Signature
from jounce.model.mechanism import Mechanism
from jounce.native import cache, jit
from jounce.native.jit import host, make_ufunc
from jounce.native.products import DerivativeProducts, Results
from jounce.native.scratch_pool import make_pool

if TYPE_CHECKING:
    from concurrent.futures import ThreadPoolExecutor


Box = tuple[slice, ...]  # of a batch: a slice of each axis
ROUND_WEIGHTS = 4, 2, 1, 1  # of rounds of one part for each thread: half of what is left, the last one all of it
MIN_STATES_IN_ROUNDS = 2**13  # of a thread: the last parts, of 1,024 states, then take longer than to hand them out


class Kernel(DerivativeProducts[Results]):
    """A quantity of one robot with its rates, as native code. `Robot.compile` makes one.

    A kernel takes arrays only, in the order of the robot's joints: methods of `Robot` match names, kernels do not.
    Results do not depend, to the last bit, on the place in a batch or on the number of threads. Kernels can be
    pickled; an unpickled one is read from the cache on disk or compiled again.

    Examples
    --------
    >>> import jounce, numpy as np
    >>> kernel = jounce.load("iiwa14").compile(order=1)
    >>> kernel
    <Kernel: inverse_dynamics of 'iiwa14' to order 1>
    >>> Q, Qd = kernel(np.ones((1000, 7)), np.zeros(7), np.zeros(7), np.ones(7))
    >>> Qd.shape
    (1000, 7)
    """

    def __init__(self, mechanism: Mechanism, computation: Computation, patience: float = inf) -> None:
        self.mechanism, self.computation = mechanism, computation
        self.signature = computation.signature(mechanism)
        self._code = jit.load_object(_object_code(mechanism, computation, patience), host())
        self._pool = make_pool(self._code)
        self.addresses = self._code.address("states"), self._pool.address if self._pool else 0
        self.shapes = tuple([p.shape for p in ports] for ports in (self.signature.inputs, self.signature.outputs))
        self.ufunc, self._alive = make_ufunc(self.addresses[0], self.signature, computation.name, self.addresses[1])
        self._products = {}

    def __reduce__(self) -> tuple[Callable[..., "Kernel"], tuple[Mechanism, Computation]]:
        return compile_kernel, (self.mechanism, self.computation)

    def __repr__(self) -> str:
        return f"<Kernel: {self.computation.describe(self.mechanism.name)}>"

    def __call__(
        self, *arrays: ArrayLike, out: Floats | Sequence[Floats] | None = None, threads: int = 1, **fixed: Never
    ) -> Results:
        """Compute the quantity and its rates.

        Parameters
        ----------
        *arrays : (..., n), then (..., nb, 6), then (..., 4, 4) and (..., 6)
            q, qd, ..., as many as the quantity and its order take; W, Wd, ... after them if it was compiled with
            wrenches; C, V, Vd, ... if with the motion of the base. float64; batch axes lead and broadcast. Poses C
            are not checked, unlike those that methods of a Robot take. If loops are closed, the last array is
            q_dependent, (..., N - n): the positions of all other joints, in the order of
            ``mechanism.tree.coordinates``, where the loops are closed. They are not checked, and `Robot.coordinates`
            computes them.
        out : array or tuple of arrays, optional
            Arrays to write the results into.
        threads : int, optional
            Number of threads to split the batch among.

        Returns
        -------
        array, or for orders above 0 a tuple of arrays

        Raises
        ------
        JounceError
            If the number of arrays, a shape or a dtype is wrong, an array has names or a mask, or a keyword is given
            that `Robot.compile` has fixed, such as body and frame.

        Examples
        --------
        >>> import jounce, numpy as np
        >>> kernel = jounce.load("planar2r").compile("gravity_forces", order=1)
        >>> G, Gd = kernel(np.zeros((3, 2)), np.ones(2))
        >>> G.shape, Gd[0].round(12)
        ((3, 2), array([0., 0.]))
        """
        if len(fixed) > 0:
            raise self._fixed_at_compile_time(fixed)
        # NumPy would take one array too many for an output, and write into it.
        if len(arrays) != len(self.shapes[0]):
            came = f"expects {len(self.shapes[0])} arrays, got {len(arrays)}"
            raise JounceError(f"{self!r} {came}: {self._order_of_inputs()}")
        results: tuple[Any, ...] = ()
        if out is not None:
            results = tuple(out) if isinstance(out, (tuple, list)) else (out,)
        # Names and masks are of other types than plain arrays, which need no further look.
        for x in arrays if out is None else (*arrays, *results):
            if type(x) is not np.ndarray:
                refuse_names_and_masks(repr(self), arrays, results)
                break
        try:
            if type(threads) is not int or threads != 1:
                return self._split(arrays, None if out is None else results, threads)
            return self.ufunc(*arrays) if out is None else self.ufunc(*arrays, out=results)
        # Errors and warnings of arithmetic are those that np.errstate or a filter of the caller asks for.
        except (JounceError, FloatingPointError, Warning):
            raise
        # NumPy raises errors of several types, and a foreign type may raise anything when it is converted.
        except Exception as error:
            raise self._explain(error, arrays, results) from None

    def bind(self, *arrays: Floats, out: Floats | Sequence[Floats], **fixed: Never) -> Callable[[], None]:
        """Return a function without arguments that computes from these arrays into `out`.

        It has the lowest latency. Each call reads the current contents of the arrays.

        Parameters
        ----------
        *arrays : (n,) or (N, n), then (nb, 6) or (N, nb, 6)
            As in a call, all with the same batch axis or with none.
        out : array or tuple of arrays
            Arrays to write the results into; they must not share memory with the other arrays.

        Returns
        -------
        callable

        Raises
        ------
        JounceError
            If an array is not of float64, a shape is wrong, or `out` is read-only or shares memory.

        Examples
        --------
        >>> import jounce, numpy as np
        >>> kernel = jounce.load("planar2r").compile("gravity_forces", order=0)
        >>> q, G = np.zeros(2), np.empty(2)
        >>> call = kernel.bind(q, out=G)
        >>> call()
        >>> G
        array([29.43,  9.81])
        """
        if len(fixed) > 0:
            raise self._fixed_at_compile_time(fixed)
        results: list[Any] = list(out) if isinstance(out, tuple | list) else [out]
        refuse_names_and_masks(repr(self), arrays, results)
        batch = check_bound_arrays(repr(self), self.signature, arrays, results)
        # All that the loop takes is written into memory once, and a call passes one address. Whatever the addresses
        # point to lives as long as the function.
        everything = [*arrays, *results]
        called = jit.loop_arguments(everything, bool(batch))
        arguments = (ctypes.c_void_p * 4)(*map(ctypes.addressof, called), self.addresses[1])
        address = ctypes.c_void_p(ctypes.addressof(arguments))
        call = partial(jit.Bound(self._code.address("bound")), address)
        vars(call)["alive"] = self, everything, called, arguments
        return call

    def _compile(self, computation: Computation, patience: float) -> "Kernel":
        return compile_kernel(self.mechanism, computation, patience)

    def _explain(self, error: Exception, arrays: Sequence[Any], results: Sequence[Any]) -> JounceError:
        """Return the error of arrays that NumPy refuses, in words."""
        try:
            refuse_names_and_masks(repr(self), arrays, results)
            refuse_shapes(repr(self), self.signature.inputs, arrays)
        except JounceError as refusal:
            return copy(refusal)
        return JounceError(f"{self!r}: {one_line(error)}")

    def _order_of_inputs(self) -> str:
        return f"it takes {', '.join(port.name for port in self.signature.inputs)}"

    def _fixed_at_compile_time(self, options: Mapping[str, Any]) -> JounceError:
        """Return the error of a call with keywords.

        A kernel takes none.
        """
        # A keyword of a method may be an array that the kernel takes by position.
        name = next((name for name in options if len(self.signature.of_role(name)) > 0), None)
        if name is not None:
            return JounceError(f"{self!r} takes arrays one after the other, without {name}=: {self._order_of_inputs()}")
        # Any other one is an option of another kernel. Whether a kernel takes loads is chosen by a flag.
        flags = {"base": "moving_base", "wrench": "wrench"}
        cure = [
            f"{flags[name]}={quote_value(True)}" if name in flags else f"{name}={quote_value(x)}"
            for name, x in options.items()
        ]
        fixed = ", ".join(self.computation.keywords())
        return JounceError(
            f"robot.compile({fixed}) fixed what {self!r} computes; compile another one with {', '.join(cure)}"
        )

    def _split(self, arrays: Sequence[Any], out: Sequence[Any] | None, threads: Any) -> Any:
        """Compute a batch in parts by some threads.

        All its axes are split.
        """
        if not isinstance(threads, int | np.integer) or isinstance(threads, bool) or threads < 1:
            raise JounceError(f"threads = {quote_value(threads)}; expected how many, 1 or more")
        input_shapes, output_shapes = self.shapes
        inputs = [np.asarray(array) for array in arrays]
        # Arrays that do not fit go to one call, in which NumPy refuses them.
        inputs_and_shapes = list(zip(inputs, input_shapes, strict=True))
        fits = all(x.shape[x.ndim - len(shape) :] == shape for x, shape in inputs_and_shapes)
        batch: Shape = ()
        if fits:
            batch = np.broadcast_shapes(*(x.shape[: x.ndim - len(shape)] for x, shape in inputs_and_shapes))
        if fits and batch == () and threads > 1:
            warn(f"threads={threads} has no effect on one state: it splits a batch")
        shapes = [(*batch, *shape) for shape in output_shapes]
        results = [np.empty(shape) for shape in shapes] if out is None else out
        if prod(batch) < 2 or [getattr(y, "shape", None) for y in results] != shapes:
            return self(*arrays, out=out)
        # A part of a result may lie over another part of an input, which is not computed yet: such inputs are copied.
        separate = [x.copy() if any(np.may_share_memory(x, y) for y in results) else x for x in inputs]
        whole = [np.broadcast_to(x, (*batch, *shape)) for x, shape in zip(separate, input_shapes, strict=True)]

        def work(box: Box) -> None:
            self.ufunc(*(x[box] for x in whole), out=tuple(y[box] for y in results))

        compute_in_parts(work, batch, min(int(threads), prod(batch)))
        return results[0] if len(output_shapes) == 1 else tuple(results)


_living: WeakValueDictionary[tuple[Mechanism, Computation], Kernel] = WeakValueDictionary()
_compiling = Lock()  # threads that ask for one kernel at the same time share it


def compile_kernel(mechanism: Mechanism, computation: Computation, patience: float = inf) -> Kernel:
    """Return the kernel of a quantity of a mechanism of numbers.

    It is the one that is alive in this process, else one from the cache on disk, else a newly compiled one. Raises
    `LongCompilationError` where it is still to be compiled, which would take longer than `patience` seconds.
    """
    kernel = _living.get((mechanism, computation))
    if kernel is None:
        with _compiling:
            # Another thread may have compiled it while this one waited for the lock.
            kernel = _living.get((mechanism, computation))
            if kernel is None:
                kernel = Kernel(mechanism, computation, patience)
            _living[mechanism, computation] = kernel
    return kernel


def _object_code(mechanism: Mechanism, computation: Computation, patience: float) -> bytes:
    """Return object code of a computation, from the cache if possible."""
    target = host()

    @stage(f"compilation of {computation.name}")
    def make() -> bytes:
        from jounce.native.code_forms import kernel_modules  # imported here, as a warm cache needs none of it

        return jit.assemble(kernel_modules(mechanism, computation, target, patience), target)

    return cache.read_or_make(cache.key(mechanism, computation, target), make)


def refuse_names_and_masks(kernel: str, arrays: Sequence[Any], out: Sequence[Any]) -> None:
    """Raise `JounceError` for arrays with names or masks, and for traced arrays.

    NumPy would drop names and masks in silence.
    """
    if any(map(is_traced, arrays)):
        raise JounceError(
            f"{kernel} takes arrays of numbers, not those that JAX traces; the methods of a Robot take both, under"
            " jax.jit, jax.vmap and jax.grad"
        )
    if any(named_entries.entry_names(x) is not None or named_entries.names_along_axes(x) for x in (*arrays, *out)):
        raise JounceError(
            f"{kernel} takes arrays without names, in the order of its joints; a Robot's methods match names"
        )
    # A list may hold itself, which NumPy refuses.
    with suppress(RecursionError):
        if has_mask(list(arrays)):
            raise JounceError(f"{kernel} takes arrays without masks; x.astype(float).filled(numpy.nan) is one")
        if has_mask(list(out)):
            raise JounceError(f"{kernel} writes into arrays without masks; numpy.empty(shape) is one")


def refuse_shapes(kernel: str, ports: Sequence[Port], arrays: Sequence[Any]) -> None:
    """Raise `JounceError` for the first array whose last axes do not fit.

    NumPy refuses arrays without a shape.
    """
    for port, x in zip(ports, arrays, strict=True):
        try:
            shape = tuple(np.shape(x))
        # Ragged lists raise ValueError, foreign types may raise anything.
        except Exception:
            continue
        if shape[max(0, len(shape) - len(port.shape)) :] != port.shape:
            expected = ", ".join(map(str, ("...", *port.shape)))
            raise JounceError(f"{kernel}: {port.name} has shape {shape}; expected ({expected})")


def check_bound_arrays(
    kernel: str, signature: Signature, arrays: Sequence[np.ndarray], out: Sequence[np.ndarray]
) -> Shape:
    """Return the batch shape of arrays to bind.

    They are checked completely, as native code trusts them.
    """
    input_shapes, output_shapes = ([port.shape for port in ports] for ports in (signature.inputs, signature.outputs))
    if (len(arrays), len(out)) != (len(input_shapes), len(output_shapes)):
        raise JounceError(
            f"{kernel} binds {len(input_shapes)} arrays and {len(output_shapes)} to write into, not {len(arrays)} and"
            f" {len(out)}: it takes {', '.join(port.name for port in signature.inputs)}"
        )
    arrays_and_shapes = list(zip([*arrays, *out], [*input_shapes, *output_shapes], strict=True))
    labels = [*(port.name for port in signature.inputs), *(f"out[{k}]" for k in range(len(out)))]
    for label, (array, shape) in zip(labels, arrays_and_shapes, strict=True):
        if not isinstance(array, np.ndarray) or array.dtype != np.float64:
            came = f"dtype {array.dtype}" if isinstance(array, np.ndarray) else f"type {type(array).__name__}"
            cure = f"numpy.zeros({getattr(array, 'shape', shape)})"
            raise JounceError(
                f"{label} is of {came}, {cure} is one to fill: {kernel} binds float64 arrays of NumPy only"
            )
    # The first array determines the batch; all others must have the same.
    batch: Shape = arrays_and_shapes[0][0].shape[: -len(input_shapes[0])]
    wrong = [array.shape for array, shape in arrays_and_shapes if array.shape != (*batch, *shape)]
    if len(wrong) > 0 or len(batch) > 1:
        expected = ", ".join(str(shape) for shape in (*input_shapes, *output_shapes))
        shapes = str(wrong if len(wrong) > 0 else batch)
        raise JounceError(f"{kernel} binds arrays {expected}, all with one batch axis or none, not {shapes}")
    for k, result in enumerate(out):
        if not result.flags.writeable or any(np.shares_memory(result, x) for x in [*arrays, *out[:k]]):
            raise JounceError(f"out[{k}] is read-only or shares memory with another array; expected one of its own")
    return batch


def compute_in_parts(work: Callable[[Box], object], batch: tuple[int, ...], threads: int) -> None:
    """Call `work` on boxes of a batch in some threads.

    The caller's thread is one of them. Threads run in the caller's context, where `numpy.errstate` is kept. An error is
    raised once all have ended.
    """
    from concurrent.futures import wait  # imported here to keep start-up fast

    parts = deque(pairwise(_cuts(prod(batch), threads)))

    def take_parts() -> None:
        """Work on the next part until none is left."""
        while True:
            try:
                start, end = parts.popleft()
            except IndexError:
                return
            for box in boxes(batch, start, end):
                work(box)

    helpers = [_pool().submit(copy_context().run, take_parts) for _ in range(threads - 1)]
    # Whatever happens, no thread writes into the caller's arrays once this has returned. Threads that have not begun
    # are not waited for: calls of others may keep them busy.
    try:
        take_parts()
    finally:
        started = [helper for helper in helpers if not helper.cancel()]
        wait(started)
    for helper in started:
        helper.result()


def _cuts(count: int, threads: int) -> list[int]:
    """Return the numbers of states that bound the parts.

    They go from 0 to all states.
    """
    # Small batches take one part for each thread.
    rounds = ROUND_WEIGHTS if count >= threads * MIN_STATES_IN_ROUNDS else (1,)
    weights = [weight for weight in rounds for _ in range(threads)]
    return [count * x // sum(weights) for x in accumulate(weights, initial=0)]


def boxes(batch: tuple[int, ...], start: int, end: int) -> Iterator[Box]:
    """Yield few boxes that make up a range of states.

    States are counted row after row.

    >>> list(boxes((3, 4), 2, 9))
    [(slice(0, 1, None), slice(2, 4, None)), (slice(1, 2, None), slice(0, 4, None)), \
(slice(2, 3, None), slice(0, 1, None))]
    """
    if start >= end:
        return
    if len(batch) < 2:
        yield (slice(start, end),)
        return
    # Whole rows, of all further axes, are from `first` to `last`; parts of rows may lie before and after them.
    size = prod(batch[1:])
    first, last = -(-start // size), end // size
    if first > last:
        yield from _boxes_in_row(batch, last, start - last * size, end - last * size)
        return
    yield from _boxes_in_row(batch, first - 1, start - (first - 1) * size, size)
    if first < last:
        yield (slice(first, last), *(slice(0, length) for length in batch[1:]))
    yield from _boxes_in_row(batch, last, 0, end - last * size)


def _boxes_in_row(batch: tuple[int, ...], row: int, start: int, end: int) -> Iterator[Box]:
    """Return the boxes of some states of one row."""
    return ((slice(row, row + 1), *rest) for rest in boxes(batch[1:], start, end) if start < end)


@functools.cache
def _pool() -> "ThreadPoolExecutor":
    """Return the threads of this process besides callers.

    They are started when they are first needed.
    """
    from concurrent.futures import ThreadPoolExecutor

    return ThreadPoolExecutor(max(1, (os.cpu_count() or 1) - 1), thread_name_prefix="jounce")


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_pool.cache_clear)  # a forked process has none of its parent's threads
