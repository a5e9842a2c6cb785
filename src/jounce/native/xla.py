"""Make kernels custom calls of XLA, the compiler of JAX.

A handler in LLVM IR reads the frame of a call itself.

A handler is compiled in each process, since it holds the address of its kernel, and calls it without Python. XLA keeps
handlers for the life of the process, so they and their kernels are kept too, one for each kernel: robots of equal data
share it. Handlers of single precision convert some states at a time to doubles, and their results back.

The structures are those of XLA's C interface for custom calls, version 0.1 and those that XLA accepts in its place:
OpenXLA, xla/ffi/api/c_api.h.
"""

from collections.abc import Sequence
from threading import Lock
from typing import Any

import numpy as np

from jounce.dynamics.computation import Port
from jounce.native import cache, jit, scratch_pool
from jounce.native.ir import Writer
from jounce.native.jit import host
from jounce.native.kernel import Kernel
from jounce.native.scratch_pool import Pool

# Offsets in bytes and codes of XLA's C interface, of this version:
FFI_VERSION = 0, 1
FRAME_EXTENSION, FRAME_ARGUMENTS, FRAME_RESULTS = 8, 72, 112  # in XLA_FFI_CallFrame
EXTENSION_TYPE, EXTENSION_METADATA = 8, 24  # in XLA_FFI_Metadata_Extension, by which XLA asks for the version
METADATA_TYPE = 1  # of this extension: XLA_FFI_Extension_Metadata
METADATA_MAJOR, METADATA_MINOR, METADATA_TRAITS = 24, 28, 32  # in XLA_FFI_Metadata
BUFFER_DATA, BUFFER_RANK, BUFFER_DIMENSIONS = 24, 32, 40  # in XLA_FFI_Buffer
MAX_CONVERTED_BYTES = 2**17  # of states as doubles at a time: they stay in the cache

_lock = Lock()
_targets: dict[str, tuple[Any, ...] | None] = {}  # what lives as long; None where this jaxlib refuses the handler


def register_target(kernel: Kernel, dtype: np.dtype) -> str | None:
    """Return the name under which XLA calls a kernel, or None.

    It is registered once; None is for a jaxlib that does not fit. Arguments are of the type, float64 or float32,
    row-major, (N, ...) or one state for all, (...); results are (N, ...).
    """
    name = f"jounce_{dtype}_{cache.key(kernel.mechanism, kernel.computation, host())}"
    with _lock:
        if name not in _targets:
            # The kernel, the code and its scratch memory live as long as the process, as XLA may call them.
            text, needed = _handler(kernel, dtype)
            code = jit.load_object(jit.assemble([text], host()), host())
            _targets[name] = (kernel, code, needed) if _is_registered(name, code.address("call")) else None
        return None if _targets[name] is None else name


def _is_registered(name: str, address: int) -> bool:
    """Register a handler; return whether XLA accepts its version.

    XLA reports that only once it runs.
    """
    import jax

    # Platforms register when they start: the CPU is started first.
    try:
        jax.local_devices(backend="cpu")
        jax.ffi.register_ffi_target(name, jax.ffi.pycapsule(address), platform="cpu")
    except (AttributeError, RuntimeError):
        return False
    return True


def _handler(kernel: Kernel, dtype: np.dtype) -> tuple[str, Pool | None]:
    """Return the module of ``@call(frame)`` and the scratch memory that it needs.

    ``@call`` runs the kernel on the buffers of a frame.
    """
    ir, inputs, outputs = Writer(host()), kernel.signature.inputs, kernel.signature.outputs
    ports, memory = [*inputs, *outputs], None
    states, scratch = kernel.addresses
    # Arrays of singles are converted some states at a time, in scratch memory for as many doubles. Their number is a
    # multiple of the lanes, so that all blocks but the last are full.
    if dtype == np.float32:
        chunk = max(ir.lanes, MAX_CONVERTED_BYTES // (8 * (inputs[-1].end + outputs[-1].end)) // ir.lanes * ir.lanes)
        size = 8 * chunk * (inputs[-1].end + outputs[-1].end)
        memory = Pool(size)
        _define_conversions(ir, kernel, chunk)
        scratch_pool.define_on_heap(ir, size, "@singles")
    with ir.function("ptr @call(ptr %frame)"):
        arrays, strides = (ir.let(f"alloca [{count} x {kind}]") for count, kind in _sizes(ports))
        # A frame with an extension may only ask for the version of the interface. It is answered without a call.
        extension = _read(ir, "%frame", FRAME_EXTENSION)
        ir.do(f"br i1 {ir.let(f'icmp eq ptr {extension}, null')}, label %run, label %extended")
        ir.label("extended")
        asks_version = ir.let(f"icmp eq i32 {_read(ir, extension, EXTENSION_TYPE, 'i32')}, {METADATA_TYPE}")
        ir.do(f"br i1 {asks_version}, label %version, label %run")
        ir.label("version")
        metadata = _read(ir, extension, EXTENSION_METADATA)
        offsets = METADATA_MAJOR, METADATA_MINOR, METADATA_TRAITS
        for offset, number in zip(offsets, (*FFI_VERSION, 0), strict=True):
            ir.do(f"store i32 {number}, ptr {ir.at(metadata, offset, 'i8')}")
        ir.do("ret ptr null")
        # Any other frame is a call: its buffers as the arrays, the length and the strides that a kernel takes.
        ir.label("run")
        count = _store_arrays(ir, inputs, outputs, arrays, strides, dtype.itemsize)
        if memory is None:
            called, place = _pointer(ir, states), scratch
        else:
            called, place = "@singles", memory.address
        ir.do(f"call void {called}(ptr {arrays}, ptr {count}, ptr {strides}, ptr {_pointer(ir, place)})")
        ir.do("ret ptr null")
    return ir.text(), memory


def _sizes(ports: Sequence[Port]) -> tuple[tuple[int, str], tuple[int, str]]:
    """Return how many pointers and strides a kernel takes.

    Each number comes with its type.
    """
    return (len(ports), "ptr"), (len(ports) + sum(len(port.shape) for port in ports), "i64")


def _store_arrays(
    ir: Writer, inputs: Sequence[Port], outputs: Sequence[Port], arrays: str, strides: str, width: int
) -> str:
    """Store the addresses and strides of arrays for a kernel.

    Return the address of the number of states.
    """
    _store_inner_strides(ir, [*inputs, *outputs], strides)
    places = [(FRAME_ARGUMENTS, k) for k in range(len(inputs))] + [(FRAME_RESULTS, k) for k in range(len(outputs))]
    for j, (port, (offset, k)) in enumerate(zip([*inputs, *outputs], places, strict=True)):
        buffer = _read(ir, _read(ir, "%frame", offset), 8 * k)
        ir.do(f"store ptr {_read(ir, buffer, BUFFER_DATA)}, ptr {ir.at(arrays, j, 'ptr')}")
        # An argument without a batch axis is one state for all: its stride is 0.
        shared = ir.let(f"icmp eq i64 {_read(ir, buffer, BUFFER_RANK, 'i64')}, {len(port.shape)}")
        stride = ir.let(f"select i1 {shared}, i64 0, i64 {width * port.size}")
        ir.do(f"store i64 {stride}, ptr {ir.at(strides, j, 'i64')}")
    # The first axis of every result is the batch; here that of the last one is taken.
    return _read(ir, buffer, BUFFER_DIMENSIONS)


def _store_inner_strides(ir: Writer, ports: Sequence[Port], strides: str) -> None:
    """Store the strides within a state of doubles.

    They come after those from state to state.
    """
    within = (stride for port in ports for stride in np.empty(port.shape).strides)
    for k, stride in enumerate(within, start=len(ports)):
        ir.do(f"store i64 {stride}, ptr {ir.at(strides, k, 'i64')}")


def _define_conversions(ir: Writer, kernel: Kernel, chunk: int) -> None:
    """Define ``@blocks(args, dimensions, steps, memory)``: the kernel on arrays of singles.

    Some states at a time are converted to doubles, computed, and their results converted back.
    """
    _define_copy(ir, "widen", "float", "fpext", "double")
    _define_copy(ir, "narrow", "double", "fptrunc", "float")
    inputs, outputs = kernel.signature.inputs, kernel.signature.outputs
    ports, end = [*inputs, *outputs], inputs[-1].end
    with ir.function("internal void @blocks(ptr %args, ptr %dimensions, ptr %steps, ptr %memory)"):
        arrays, strides, count = (ir.let(f"alloca [{n} x {kind}]") for n, kind in (*_sizes(ports), (1, "i64")))
        _store_inner_strides(ir, ports, strides)
        # In memory, each array has a part for `chunk` states, inputs before outputs.
        starts = [port.start for port in inputs] + [end + port.start for port in outputs]
        doubles = [ir.at("%memory", chunk * start) for start in starts]
        singles = [_read(ir, "%args", 8 * j) for j in range(len(ports))]
        steps = [_read(ir, "%steps", 8 * j, "i64") for j in range(len(ports))]
        # The kernel sees these parts: doubles are twice as far apart as singles, or 0 where one state serves all.
        for j, (place, step) in enumerate(zip(doubles, steps, strict=True)):
            ir.do(f"store ptr {place}, ptr {ir.at(arrays, j, 'ptr')}")
            ir.do(f"store i64 {ir.let(f'mul i64 {step}, 2')}, ptr {ir.at(strides, j, 'i64')}")
        total = ir.let("load i64, ptr %dimensions")
        with ir.loop_over_blocks(total, chunk) as index:
            first = ir.let(f"mul i64 {index}, {chunk}")
            left = ir.call("llvm.smin.i64", "i64", ir.let(f"sub i64 {total}, {first}"), str(chunk))
            ir.do(f"store i64 {left}, ptr {count}")
            places = [
                ir.at(x, ir.let(f"mul i64 {first}, {step}"), "i8") for x, step in zip(singles, steps, strict=True)
            ]
            for j, port in enumerate(inputs):
                rows = ir.let(f"select i1 {ir.let(f'icmp eq i64 {steps[j]}, 0')}, i64 1, i64 {left}")
                numbers = ir.let(f"mul i64 {rows}, {port.size}")
                ir.do(f"call void @widen(ptr {places[j]}, ptr {doubles[j]}, i64 {numbers})")
            states, scratch = (_pointer(ir, address) for address in kernel.addresses)
            ir.do(f"call void {states}(ptr {arrays}, ptr {count}, ptr {strides}, ptr {scratch})")
            for j, port in enumerate(outputs, start=len(inputs)):
                numbers = ir.let(f"mul i64 {left}, {port.size}")
                ir.do(f"call void @narrow(ptr {doubles[j]}, ptr {places[j]}, i64 {numbers})")


def _define_copy(ir: Writer, name: str, source: str, conversion: str, target: str) -> None:
    """Define a function (from, to, count) that converts numbers: whole vectors, then the rest."""
    with ir.function(f"internal void @{name}(ptr %from, ptr %to, i64 %count)"):
        vectors = ir.let(f"sdiv i64 %count, {ir.lanes}")
        whole = ir.let(f"mul i64 {vectors}, {ir.lanes}")
        for label, lanes, start, end in (
            ("vectors", f"<{ir.lanes} x {{}}>", "0", vectors),
            ("rest", "{}", whole, "%count"),
        ):
            with ir.only_if(ir.let(f"icmp slt i64 {start}, {end}"), label, f"{label}.none"), ir.loop(end, start) as i:
                kinds = lanes.format(source), lanes.format(target)
                x = ir.let(f"load {kinds[0]}, ptr {ir.at('%from', i, kinds[0])}, align 4")
                y = ir.let(f"{conversion} {kinds[0]} {x} to {kinds[1]}")
                ir.do(f"store {kinds[1]} {y}, ptr {ir.at('%to', i, kinds[1])}, align 4")


def _pointer(ir: Writer, address: int) -> str:
    """Return an address of this process as a pointer."""
    return ir.let(f"inttoptr i64 {address} to ptr")


def _read(ir: Writer, structure: str, offset: int, kind: str = "ptr") -> str:
    """Return the field of a structure at an offset in bytes."""
    return ir.let(f"load {kind}, ptr {ir.at(structure, offset, 'i8')}")
