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
    """A quantity of one robot with its rates up to an order, as native code. `Robot.compile` makes one.

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
        if fixed:
            raise self._fixed_at_compile_time(fixed)
        if len(arrays) != len(self.shapes[0]):  # NumPy would write into what comes after
            came = f"expects {len(self.shapes[0])} arrays, got {len(arrays)}"
            raise JounceError(f"{self!r} {came}: {self._order_of_inputs()}")
        into = None if out is None else tuple(out) if isinstance(out, (tuple, list)) else (out,)
        for x in arrays if into is None else (*arrays, *into):
            if type(x) is not np.ndarray:
                refuse_names_and_masks(repr(self), arrays, into or ())
                break
        try:
            if type(threads) is not int or threads != 1:
                return self._split(arrays, into, threads)
            return self.ufunc(*arrays) if into is None else self.ufunc(*arrays, out=into)
        except (JounceError, FloatingPointError, Warning):  # the latter where np.errstate or a filter asks for it
            raise
        except Exception as error:  # NumPy, or a foreign type, which may raise anything when it is converted
            refuse_names_and_masks(repr(self), arrays, into or ())
            refuse_shapes(repr(self), self.signature.inputs, arrays)
            raise JounceError(f"{self!r}: {one_line(error)}") from None

    def bind(self, *arrays: Floats, out: Floats | Sequence[Floats], **fixed: Never) -> Callable[[], None]:
        """Return a function without arguments that computes from these arrays into `out`, with the lowest latency.

        Each call reads the current contents of the arrays.

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
        if fixed:
            raise self._fixed_at_compile_time(fixed)
        results: list[Any] = list(out) if isinstance(out, tuple | list) else [out]
        refuse_names_and_masks(repr(self), arrays, results)
        batch = check_bound_arrays(repr(self), self.signature, arrays, results)
        everything = [*arrays, *results]
        called = jit.loop_arguments(everything, bool(batch))
        arguments = (ctypes.c_void_p * 4)(*map(ctypes.addressof, called), self.addresses[1])
        address = ctypes.c_void_p(ctypes.addressof(arguments))
        call = partial(jit.Bound(self._code.address("bound")), address)
        vars(call)["alive"] = self, everything, called, arguments
        return call

    def _compile(self, computation: Computation, patience: float) -> "Kernel":
        return compile_kernel(self.mechanism, computation, patience)

    def _order_of_inputs(self) -> str:
        return f"it takes {', '.join(port.name for port in self.signature.inputs)}"

    def _fixed_at_compile_time(self, asked: Mapping[str, Any]) -> JounceError:
        if name := next((name for name in asked if self.signature.of_role(name)), None):
            return JounceError(f"{self!r} takes arrays one after the other, without {name}=: {self._order_of_inputs()}")
        flags = {"base": {"moving_base": True}, "wrench": {"wrench": True}}  # what is given selects arrays by a flag
        asked = {key: x for name, given in asked.items() for key, x in flags.get(name, {name: given}).items()}
        own, other = (
            ", ".join(self.computation.keywords()),
            ", ".join(f"{k}={quote_value(x)}" for k, x in asked.items()),
        )
        return JounceError(f"robot.compile({own}) fixed what {self!r} computes; compile another one with {other}")

    def _split(self, arrays: Sequence[Any], out: Sequence[Any] | None, threads: Any) -> Any:
        """The batch in as many parts as there are threads, all its axes split; what does not fit, NumPy says."""
        if not isinstance(threads, int | np.integer) or isinstance(threads, bool) or threads < 1:
            raise JounceError(f"threads = {quote_value(threads)}; expected how many, 1 or more")
        taken, given = self.shapes
        inputs = [np.asarray(array) for array in arrays]
        both = list(zip(inputs, taken, strict=True))
        fits = all(x.shape[x.ndim - len(shape) :] == shape for x, shape in both)
        batch = np.broadcast_shapes(*(x.shape[: x.ndim - len(shape)] for x, shape in both)) if fits else ()
        if fits and not batch and threads > 1:
            warn(f"threads={threads} has no effect on one state: it splits a batch")
        shapes = [(*batch, *shape) for shape in given]
        results = [np.empty(shape) for shape in shapes] if out is None else out
        if prod(batch) < 2 or [getattr(y, "shape", None) for y in results] != shapes:
            return self(*arrays, out=out)
        apart = [x.copy() if any(np.may_share_memory(x, y) for y in results) else x for x in inputs]
        whole = [np.broadcast_to(x, (*batch, *shape)) for x, shape in zip(apart, taken, strict=True)]

        def work(box: Box) -> None:
            self.ufunc(*(x[box] for x in whole), out=tuple(y[box] for y in results))

        compute_in_parts(work, batch, min(int(threads), prod(batch)))
        return results[0] if len(given) == 1 else tuple(results)


_living: WeakValueDictionary[tuple[Mechanism, Computation], Kernel] = WeakValueDictionary()
_compiling = Lock()  # threads that ask for one kernel at the same time share it


def compile_kernel(mechanism: Mechanism, computation: Computation, patience: float = inf) -> Kernel:
    """The kernel of a quantity of a mechanism of numbers: the one there is, else from the cache, else compiled.

    Raises `LongCompilationError` where it is still to be compiled, which would take longer than `patience` seconds.
    """
    kernel = _living.get((mechanism, computation))
    if kernel is None:
        with _compiling:
            kernel = _living.get((mechanism, computation)) or Kernel(mechanism, computation, patience)
            _living[mechanism, computation] = kernel
    return kernel


def _object_code(mechanism: Mechanism, computation: Computation, patience: float) -> bytes:
    """Object code, from the cache where it is there."""
    target = host()

    @stage(f"compilation of {computation.name}")
    def make() -> bytes:
        from jounce.native.code_forms import kernel_modules  # imported here, as a warm cache needs none of it

        return jit.assemble(kernel_modules(mechanism, computation, target, patience), target)

    return cache.read_or_make(cache.key(mechanism, computation, target), make)


def refuse_names_and_masks(kernel: str, arrays: Sequence[Any], out: Sequence[Any]) -> None:
    """Raise `JounceError` for arrays with names or masks, both of which NumPy would drop, and for traced ones."""
    if any(map(is_traced, arrays)):
        raise JounceError(
            f"{kernel} takes arrays of numbers, not those that JAX traces; the methods of a Robot take both, under"
            " jax.jit, jax.vmap and jax.grad"
        )
    if any(named_entries.entry_names(x) is not None or named_entries.names_along_axes(x) for x in (*arrays, *out)):
        raise JounceError(
            f"{kernel} takes arrays without names, in the order of its joints; a Robot's methods match names"
        )
    with suppress(RecursionError):  # a list may hold itself, which NumPy refuses
        if has_mask(list(arrays)):
            raise JounceError(f"{kernel} takes arrays without masks; x.astype(float).filled(numpy.nan) is one")
        if has_mask(list(out)):
            raise JounceError(f"{kernel} writes into arrays without masks; numpy.empty(shape) is one")


def refuse_shapes(kernel: str, ports: Sequence[Port], arrays: Sequence[Any]) -> None:
    """Raise `JounceError` for the first array whose last axes do not fit; what has no shape, NumPy refuses."""
    for port, x in zip(ports, arrays, strict=True):
        try:
            shape = tuple(np.shape(x))
        except Exception:  # ragged lists, or foreign types, which may raise anything
            continue
        if shape[max(0, len(shape) - len(port.shape)) :] != port.shape:
            expected = ", ".join(map(str, ("...", *port.shape)))
            raise JounceError(f"{kernel}: {port.name} has shape {shape}; expected ({expected})")


def check_bound_arrays(
    kernel: str, signature: Signature, arrays: Sequence[np.ndarray], out: Sequence[np.ndarray]
) -> Shape:
    """Return the batch shape of arrays to bind, checked as native code trusts them."""
    taken, given = ([port.shape for port in ports] for ports in (signature.inputs, signature.outputs))
    if (len(arrays), len(out)) != (len(taken), len(given)):
        raise JounceError(
            f"{kernel} binds {len(taken)} arrays and {len(given)} to write into, not {len(arrays)} and {len(out)}:"
            f" it takes {', '.join(port.name for port in signature.inputs)}"
        )
    both = list(zip([*arrays, *out], [*taken, *given], strict=True))
    labels = [*(port.name for port in signature.inputs), *(f"out[{k}]" for k in range(len(out)))]
    for label, (array, shape) in zip(labels, both, strict=True):
        if not isinstance(array, np.ndarray) or array.dtype != np.float64:
            came = f"dtype {array.dtype}" if isinstance(array, np.ndarray) else f"type {type(array).__name__}"
            one = f"numpy.zeros({getattr(array, 'shape', shape)})"
            raise JounceError(
                f"{label} is of {came}, {one} is one to fill: {kernel} binds float64 arrays of NumPy only"
            )
    batch: Shape = both[0][0].shape[: -len(taken[0])]
    wrong = [array.shape for array, shape in both if array.shape != (*batch, *shape)]
    if wrong or len(batch) > 1:
        expected = ", ".join(str(shape) for shape in (*taken, *given))
        raise JounceError(f"{kernel} binds arrays {expected}, all with one batch axis or none, not {wrong or batch}")
    for k, result in enumerate(out):
        if not result.flags.writeable or any(np.shares_memory(result, x) for x in [*arrays, *out[:k]]):
            raise JounceError(f"out[{k}] is read-only or shares memory with another array; expected one of its own")
    return batch


def compute_in_parts(work: Callable[[Box], object], batch: tuple[int, ...], threads: int) -> None:
    """Call `work` on boxes that make up a batch, in a number of threads, the caller's among them.

    Threads run in the caller's context, where `numpy.errstate` is kept. An error is raised once all have ended.
    """
    from concurrent.futures import wait  # imported here to keep start-up fast

    parts = deque(pairwise(_cuts(prod(batch), threads)))

    def take_parts() -> None:
        while parts:
            try:
                start, end = parts.popleft()
            except IndexError:  # another thread took the last one
                return
            for box in boxes(batch, start, end):
                work(box)

    others = [_pool().submit(copy_context().run, take_parts) for _ in range(threads - 1)]
    try:
        take_parts()
    finally:  # whatever happens, no thread writes into the caller's arrays any more
        begun = [one for one in others if not one.cancel()]
        wait(begun)
    for one in begun:
        one.result()


def _cuts(count: int, threads: int) -> list[int]:
    """The numbers of states between which the parts lie, from 0 to all."""
    rounds = ROUND_WEIGHTS if count >= threads * MIN_STATES_IN_ROUNDS else (1,)
    weights = [weight for weight in rounds for _ in range(threads)]
    return [count * x // sum(weights) for x in accumulate(weights, initial=0)]


def boxes(batch: tuple[int, ...], start: int, end: int) -> Iterator[Box]:
    """The boxes of the states from one number to another, counted row after row: few, and in this order.

    >>> list(boxes((3, 4), 2, 9))
    [(slice(0, 1, None), slice(2, 4, None)), (slice(1, 2, None), slice(0, 4, None)), \
(slice(2, 3, None), slice(0, 1, None))]
    """
    if start >= end:
        return
    if len(batch) < 2:
        yield (slice(start, end),)
        return
    size = prod(batch[1:])
    first, last = -(-start // size), end // size  # whole rows
    if first > last:  # within one row
        yield from _boxes_in_row(batch, last, start - last * size, end - last * size)
        return
    yield from _boxes_in_row(batch, first - 1, start - (first - 1) * size, size)
    if first < last:
        yield (slice(first, last), *(slice(0, length) for length in batch[1:]))
    yield from _boxes_in_row(batch, last, 0, end - last * size)


def _boxes_in_row(batch: tuple[int, ...], row: int, start: int, end: int) -> Iterator[Box]:
    return ((slice(row, row + 1), *rest) for rest in boxes(batch[1:], start, end) if start < end)


@functools.cache
def _pool() -> "ThreadPoolExecutor":
    """The threads of this process besides callers; they are started when they are first needed."""
    from concurrent.futures import ThreadPoolExecutor

    return ThreadPoolExecutor(max(1, (os.cpu_count() or 1) - 1), thread_name_prefix="jounce")


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_pool.cache_clear)  # a forked process has none of its parent's threads
