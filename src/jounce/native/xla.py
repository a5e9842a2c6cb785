"""Kernels as custom calls of XLA, the compiler of JAX: a handler in LLVM IR that reads the frame of a call itself.

A handler is compiled in each process, since it holds the address of its kernel, and calls it without Python. XLA keeps
handlers for the life of the process, so they and their kernels are kept too, one for each kernel: robots of equal data
share it.

The structures are those of XLA's C interface for custom calls, version 0.1 and those that XLA accepts in its place:
OpenXLA, xla/ffi/api/c_api.h.
"""

from dataclasses import replace
from threading import Lock

import numpy as np

from jounce.dynamics.computation import Signature
from jounce.native import cache, jit
from jounce.native.ir import Writer
from jounce.native.jit import Code, host
from jounce.native.kernel import Kernel

VERSION = 0, 1  # of the interface that handlers are written for
EXTENSION, ARGUMENTS, RESULTS = 8, 72, 112  # offsets in bytes in XLA_FFI_CallFrame
TYPE, METADATA, OF_METADATA = 8, 24, 1  # in XLA_FFI_Metadata_Extension, by which XLA asks for the version; its type
MAJOR, MINOR, TRAITS = 24, 28, 32  # in XLA_FFI_Metadata
DATA, RANK, DIMENSIONS = 24, 32, 40  # in XLA_FFI_Buffer

_lock = Lock()
_targets: dict[str, tuple[Kernel, Code] | None] = {}  # by name; None where this jaxlib refuses the handler


def target(kernel: Kernel) -> str | None:
    """Return the name under which XLA calls a kernel, registered once; None if the jaxlib does not fit.

    Arguments are float64, row-major, (N, ...) or one state for all, (...); results are (N, ...).
    """
    name = f"jounce_{cache.key(kernel.mechanism, kernel.computation, host())}"
    with _lock:
        if name not in _targets:
            code = jit.load_object(jit.assemble([_handler(kernel)], host()), host())
            _targets[name] = (kernel, code) if _is_registered(name, code.address("call")) else None
        return name if _targets[name] else None


def _is_registered(name: str, address: int) -> bool:
    """Register a handler; whether XLA accepts its version, which it tells only once it has begun to run."""
    import jax

    try:
        jax.local_devices(backend="cpu")
        jax.ffi.register_ffi_target(name, jax.ffi.pycapsule(address), platform="cpu")
    except (AttributeError, RuntimeError):
        return False
    return True


def _handler(kernel: Kernel) -> str:
    """The module of ``@call(frame)``, which calls the kernel on the buffers of a frame and returns no error."""
    ir, signature = Writer(replace(host(), lanes=1)), kernel.signature
    ports = [*signature.inputs, *signature.outputs]
    steps = len(ports) + sum(len(port.shape) for port in ports)
    with ir.function("ptr @call(ptr %frame)"):
        ir.label("start")
        arrays, strides = ir.let(f"alloca [{len(ports)} x ptr]"), ir.let(f"alloca [{steps} x i64]")
        extension = _read(ir, "%frame", EXTENSION)
        ir.do(f"br i1 {ir.let(f'icmp eq ptr {extension}, null')}, label %run, label %extended")
        ir.label("extended")
        asked = ir.let(f"icmp eq i32 {_read(ir, extension, TYPE, 'i32')}, {OF_METADATA}")
        ir.do(f"br i1 {asked}, label %version, label %run")
        ir.label("version")
        metadata = _read(ir, extension, METADATA)
        for offset, number in ((MAJOR, VERSION[0]), (MINOR, VERSION[1]), (TRAITS, 0)):
            ir.do(f"store i32 {number}, ptr {ir.at(metadata, offset, 'i8')}")
        ir.do("ret ptr null")
        ir.label("run")
        count = _store_arrays(ir, signature, arrays, strides)
        states, pool = (ir.let(f"inttoptr i64 {address} to ptr") for address in kernel.addresses)
        ir.do(f"call void {states}(ptr {arrays}, ptr {count}, ptr {strides}, ptr {pool})")
        ir.do("ret ptr null")
    return ir.text()


def _store_arrays(ir: Writer, signature: Signature, arrays: str, strides: str) -> str:
    """Store where the arrays begin, and their strides, as the kernel takes them; return where their length is."""
    ports = [*signature.inputs, *signature.outputs]
    within = (bytes_ for port in ports for bytes_ in np.empty(port.shape).strides)
    for k, bytes_ in enumerate(within, start=len(ports)):
        ir.do(f"store i64 {bytes_}, ptr {ir.at(strides, k, 'i64')}")
    places = [(ARGUMENTS, k) for k in range(len(signature.inputs))]
    places += [(RESULTS, k) for k in range(len(signature.outputs))]
    for j, (port, (offset, k)) in enumerate(zip(ports, places, strict=True)):
        buffer = _read(ir, _read(ir, "%frame", offset), 8 * k)
        ir.do(f"store ptr {_read(ir, buffer, DATA)}, ptr {ir.at(arrays, j, 'ptr')}")
        shared = ir.let(f"icmp eq i64 {_read(ir, buffer, RANK, 'i64')}, {len(port.shape)}")
        stride = ir.let(f"select i1 {shared}, i64 0, i64 {8 * port.size}")
        ir.do(f"store i64 {stride}, ptr {ir.at(strides, j, 'i64')}")
    return _read(ir, buffer, DIMENSIONS)  # of the last result, whose first axis is the batch


def _read(ir: Writer, structure: str, offset: int, kind: str = "ptr") -> str:
    """The field of a structure at an offset in bytes."""
    return ir.let(f"load {kind}, ptr {ir.at(structure, offset, 'i8')}")
