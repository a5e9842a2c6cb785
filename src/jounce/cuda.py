"""`compile` makes kernels for NVIDIA GPUs: quantities of a robot on arrays there.

The CUDA code is that of `codegen`, one state per thread. Neighbouring threads read and write neighbouring numbers:
directly where the states of an entry lie one behind the other, through a tile of shared memory where the entries of a
state do. It is compiled once, through CuPy, for the current GPU.

A call takes arrays on the GPU as they are: an address, the step between states, and that between entries of a state.
Arrays whose steps vary are copied. CuPy is imported by `compile`, never by this module.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from math import prod
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from jounce._codegen import generate
from jounce._codegen.function import make_parametric
from jounce._codegen.languages import language
from jounce._codegen.options import CodePlan, check_size
from jounce.arguments import requests
from jounce.core import errors, scalars
from jounce.core.errors import JounceError, door, quote_value
from jounce.core.typing import Frame, Product
from jounce.dynamics import computation, elastic
from jounce.dynamics.computation import Computation, Port, Shape
from jounce.dynamics.quantities.names import QuantityName
from jounce.dynamics.quantities.row import ELASTIC
from jounce.engine import generic_methods
from jounce.engine.engine import Engine
from jounce.model.mechanism import Mechanism
from jounce.native.kernel import refuse_names_and_masks, refuse_shapes

if TYPE_CHECKING:
    import cupy


DTYPES = ("float64", "float32")


class CudaKernel:
    """A quantity of one robot with its rates on a GPU.

    It has rates up to an order. It can be pickled; an unpickled one is read from CuPy's cache on disk or compiled
    again.


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
        """Compute the quantity and its rates on the GPU of the arrays.

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
        into: tuple[Any, ...] | None = None
        if out is not None:
            into = tuple(out) if type(out) in (tuple, list) else (out,)
        if len(arrays) != len(ports):
            raise JounceError(f"{self!r} expects {len(ports)} arrays, got {len(arrays)}")
        refuse_names_and_masks(repr(self), arrays, into or ())
        if into is not None and any(map(scalars.is_jax, into)):
            raise JounceError("out holds arrays of JAX, which cannot be written into; leave out= away")
        with _report_gpu_errors(self):
            given = [as_gpu_array(port.name, x) for port, x in zip(ports, arrays, strict=True)]
            results = None if into is None else [as_gpu_array(f"out[{k}]", x) for k, x in enumerate(into)]
            self._check(given, results or [])
            with given[0].device:
                found = self._run(given, results)
                if not all(isinstance(x, cupy.ndarray) for x in (*arrays, *(into or ()))):
                    cupy.cuda.get_current_stream().synchronize()  # others may reuse the memory of theirs at once
        if into is None and scalars.is_jax(arrays[0]):
            import jax

            found = [jax.dlpack.from_dlpack(x) for x in found]
        returned = tuple(found) if into is None else into
        return returned[0] if len(returned) == 1 else returned

    def _check(self, given: Sequence["cupy.ndarray"], results: Sequence["cupy.ndarray"]) -> None:
        """Raise `JounceError` for shapes, precisions and places that do not fit."""
        ports = self.signature.inputs
        refuse_shapes(repr(self), ports, given)
        for port, x in zip(ports, given, strict=True):
            check_dtype(port.name, x, self.dtype)
        places = {x.device.id for x in (*given, *results)}
        if len(places) > 1:
            raise JounceError(f"{self!r}: arrays are on GPUs {', '.join(map(str, sorted(places)))}; expected one GPU")

    def _run(self, given: Sequence["cupy.ndarray"], out: Sequence["cupy.ndarray"] | None) -> Sequence["cupy.ndarray"]:
        """Return the results of checked arrays of one GPU.

        They are written into `out` if it is given.
        """
        import cupy

        ports, batch = self.signature, generic_methods.batch_shape(self.signature.inputs, given)
        shapes = [(*batch, *port.shape) for port in ports.outputs]
        if out is None:
            out = [cupy.empty(shape, self.dtype) for shape in shapes]
        else:
            check_out(out, shapes, self.dtype)
        if prod(batch) == 0:
            return out
        # Results without constant steps go into arrays of their own first, and are copied.
        written = [
            x if steps(x, len(port.shape)) is not None else cupy.empty(x.shape, self.dtype)
            for x, port in zip(out, ports.outputs, strict=True)
        ]
        # Threads run in any order, so that inputs must not share memory with results.
        separate = [x.copy() if any(cupy.may_share_memory(x, y) for y in written) else x for x in given]
        broadcast = [with_steps(x, port, batch) for x, port in zip(separate, ports.inputs, strict=True)]
        # The kernel takes for each array its address, the step between states, and that between entries.
        array_ports = zip([*broadcast, *written], [*ports.inputs, *ports.outputs], strict=True)
        passed = [value for x, port in array_ports for value in kernel_arguments(x, len(port.shape))]
        blocks = -(-prod(batch) // THREADS_PER_BLOCK)
        self._function((blocks,), (THREADS_PER_BLOCK,), (np.int64(prod(batch)), *passed))
        for x, y in zip(out, written, strict=True):
            if x is not y:
                x[...] = y
        return out


# A public door: its arguments are those of `Robot.compile`, so that no object stands between a caller and the quantity.
@door
def compile(  # noqa: A001  # what Robot.compile is to processors
    robot: Engine,
    quantity: QuantityName = "inverse_dynamics",
    order: int = 2,
    wrench: bool = False,
    *,
    body: str | None = None,
    frame: Frame = "body",
    product: Product | None = None,
    moving_base: bool = False,
    dtype: Any = "float64",
) -> CudaKernel:
    """Compile a quantity and its rates up to an order for a GPU.

    The code is that of `Robot.codegen`, straight-line CUDA for this robot, one state per thread. NVRTC compiles it
    through CuPy, which keeps it on disk.

    Parameters
    ----------
    robot : Robot
        A robot of numbers.
    quantity : str, optional
        The name of the method: "inverse_dynamics", "mass_matrix", "jacobian", ...
    order : int, optional
        The highest rate of the quantity, up to 4: 2 gives Q, Qd, Q2d.
    wrench : bool, optional
        Whether wrenches W, Wd, ... (..., nb, 6) follow the coordinates' rates in its calls.
    body, frame : str, optional
        Body or merged link, and frame, of poses, twists and Jacobians; all bodies by default.
    product : {"vjp", "jvp"}, optional
        Products of the derivatives by all inputs instead of the values, see `Robot.compile`.
    moving_base : bool, optional
        Whether the motion of the base, C, V, Vd, ..., follows in its calls; it always does if the robot floats.
    dtype : {"float64", "float32"}, optional
        Precision of the arrays and of the computation.

    Returns
    -------
    Kernel
        To call as ``kernel(q, qd, q2d, q3d, q4d)`` on arrays on a GPU.

    Raises
    ------
    JounceError
        If a name is unknown, the robot holds symbols or is too large for straight-line code, CuPy is missing, or there
        is no GPU.

    Examples
    --------
    >>> import cupy, jounce, jounce.cuda  # doctest: +SKIP
    >>> kernel = jounce.cuda.compile(jounce.load("iiwa14"), order=2)  # doctest: +SKIP
    >>> q, qd, q2d, q3d, q4d = cupy.ones((5, 100_000, 7))  # doctest: +SKIP
    >>> Q, Qd, Q2d = kernel(q, qd, q2d, q3d, q4d)  # doctest: +SKIP
    """
    if not isinstance(robot, Engine):
        raise JounceError(f"jounce.cuda.compile() expects a jounce.Robot, got {type(robot).__name__}; try jounce.load")
    request = requests.ComputationRequest(quantity, order, wrench, body, frame, product, moving_base)
    asked = requests.build_computation(robot.mechanism, request)
    if product in computation.SECOND_PRODUCTS:
        raise JounceError(f"CUDA code has no {product}; robot.compile(..., product={product!r}) runs on the CPU")
    if not robot.mechanism.is_numeric:
        raise JounceError("CUDA code needs a robot of numbers; this one contains symbols")
    obstacle = elastic.native_obstacle(robot.mechanism) if ELASTIC in asked.quantity.needs else None
    if obstacle:
        raise JounceError(f"CUDA code {obstacle}")
    return CudaKernel(robot.mechanism, asked, _precision(dtype))


def _precision(dtype: Any) -> str:
    """Return the name of a precision.

    A caller gives a string, a type or a dtype.
    """
    try:
        name = dtype if isinstance(dtype, str) or dtype is None else np.dtype(dtype).name
    except TypeError:
        name = quote_value(dtype)
    return errors.check_choice("dtype", name, DTYPES)


Kernel = CudaKernel  # as users name it


@contextmanager
def _report_gpu_errors(kernel: CudaKernel) -> Iterator[None]:
    """Raise errors of CuPy as those of jounce.

    They are in one line, within this context.
    """
    import cupy

    try:
        yield
    except JounceError:
        raise
    except cupy.cuda.memory.OutOfMemoryError as error:
        raise JounceError(
            f"{kernel!r}: not enough memory on the GPU; use fewer states: {errors.one_line(error)}"
        ) from None
    except (cupy.cuda.runtime.CUDARuntimeError, cupy.cuda.driver.CUDADriverError) as error:
        # A launch fails, too, where the local memory of all threads does not fit.
        cure = "; threads keep values in its memory, too: use fewer states, float32 or a lower order"
        message = f"{errors.one_line(error)}{cure if 'memory' in str(error).lower() else ''}"
        raise JounceError(f"{kernel!r} failed on the GPU: {message}") from None


# Arrays on a GPU as kernels take them.
def as_gpu_array(name: str, x: Any) -> "cupy.ndarray":
    """Return an array on one GPU as one of CuPy.

    It is not copied. It may be of CuPy, JAX or another library; anything else raises `JounceError`.
    """
    import cupy

    if isinstance(x, cupy.ndarray):
        return x
    kind = f"{type(x).__module__.partition('.')[0]}.{type(x).__name__}"
    try:
        if scalars.is_jax(x):
            return cupy.from_dlpack(_check_one_gpu(name, x))
        if hasattr(x, "__cuda_array_interface__"):
            return cupy.asarray(x)
    except JounceError:
        raise
    except Exception as error:  # foreign types may refuse for reasons of their own
        raise JounceError(f"{name} is a {kind} that CuPy does not take: {errors.one_line(error)}") from None
    raise JounceError(f"{name} is a {kind}; expected an array on the GPU, which cupy.asarray makes of one of NumPy")


def _check_one_gpu(name: str, x: Any) -> Any:
    """Return an array of JAX that is on one GPU.

    Raises `JounceError` for any other.
    """
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
    """Return the stride between elements of some axes, or None.

    Elements are counted row after row; it is None if the stride varies.
    """
    # Axes of length 1 have no step. The stride of an axis is that of the next one times the length of that.
    axes = [(length, stride) for length, stride in zip(lengths, strides, strict=True) if length > 1]
    for (_, outer), (length, inner) in pairwise(axes):
        if outer != length * inner:
            return None
    return axes[-1][1] if axes else 0


def steps(x: "cupy.ndarray", inner: int) -> tuple[int, int] | None:
    """Return the steps between states and between entries, or None.

    They are counted in numbers. The last `inner` axes are those of entries. It is None where a step varies, as between
    the rows of every other matrix, or is no multiple of the item size.
    """
    cut = x.ndim - inner
    outer = single_step(x.shape[:cut], x.strides[:cut])
    entry = single_step(x.shape[cut:], x.strides[cut:])
    if outer is None or entry is None or outer % x.itemsize or entry % x.itemsize:
        return None
    return outer // x.itemsize, entry // x.itemsize


def kernel_arguments(x: "cupy.ndarray", inner: int) -> tuple[Any, ...]:
    """Return what a kernel takes of an array: its beginning, and both steps."""
    both_steps = steps(x, inner)
    assert both_steps is not None
    return (x, *map(np.int64, both_steps))


def with_steps(x: "cupy.ndarray", port: Port, batch: Shape) -> "cupy.ndarray":
    """Return an array broadcast to a batch.

    It is copied where the steps between its states vary.
    """
    import cupy

    broadcast = cupy.broadcast_to(x, (*batch, *port.shape))
    return broadcast if steps(broadcast, len(port.shape)) is not None else cupy.ascontiguousarray(broadcast)


def addresses(x: "cupy.ndarray") -> np.ndarray:
    """Return an array of NumPy over addresses on a GPU.

    It says what memory arrays share, and is never read.
    """
    interface = {
        "data": (x.data.ptr, True), "shape": x.shape, "strides": x.strides, "typestr": x.dtype.str, "version": 3
    }  # fmt: skip
    return np.asarray(SimpleNamespace(__array_interface__=interface))


def check_out(out: Sequence["cupy.ndarray"], shapes: Sequence[Shape], dtype: np.dtype) -> None:
    """Raise `JounceError` for arrays that cannot hold the results."""
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


# Source, and its compilation.
THREADS_PER_BLOCK = 128  # with 255 registers each, two blocks fit on a multiprocessor
KERNEL_NAME = "states"  # of the function in the template


def source(mechanism: Mechanism, computation: Computation, single: bool) -> str:
    """Return CUDA source of a computation for a robot of numbers.

    Raises `JounceError` if the robot is too large for straight-line code.
    """
    check_size(mechanism, computation.order)
    plan = CodePlan(
        make_parametric(mechanism, ()), language("cuda"), computation.order, {"compute": computation}, single, "jounce"
    )
    states = generate.render_template(plan, generate.trace_functions(plan), "_states.cu")
    return f"#define THREADS {THREADS_PER_BLOCK}\n{states}"


def require_gpu() -> None:
    """Raise `JounceError` if CuPy or a GPU is missing."""
    try:
        import cupy
    except ImportError:
        raise JounceError(
            "jounce.cuda needs CuPy; install it by: pip install 'jounce[cuda12]', or 'jounce[cuda13]' for drivers of"
            " CUDA 13"
        ) from None
    try:
        has_gpu, why = cupy.cuda.runtime.getDeviceCount() > 0, ""
    except Exception as error:  # no driver, or one too old
        has_gpu, why = False, f": {errors.one_line(error)}"
    if not has_gpu:
        raise JounceError(f"jounce.cuda needs an NVIDIA GPU; CuPy finds none{why}")


def compile_source(code: str) -> "cupy.RawKernel":
    """Return the kernel of CUDA source, compiled for the current GPU.

    For other GPUs it is compiled at the first call there.
    """
    import cupy

    try:
        function = cupy.RawKernel(code, KERNEL_NAME, options=("-std=c++17",))
        function.compile()
    except Exception as error:  # libraries that are missing, and what NVRTC says
        raise JounceError(f"CUDA code was not compiled: {errors.one_line(error)}") from None
    return function
