"""Compile LLVM IR to native code, and make NumPy ufuncs of it.

llvmlite compiles it for this machine. NumPy then does the broadcasting, casting, strides and `out`, and releases the
interpreter lock. Code is compiled once per kernel (`assemble`), or read from the cache, and loaded once per process
(`load_object`).
"""

import ctypes
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from math import prod
from typing import Any, cast

import numpy as np

from jounce.core.errors import JounceError, quote_value, warn
from jounce.dynamics.computation import Signature

Bound = ctypes.CFUNCTYPE(None, ctypes.c_void_p)
Loop = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 4)  # the inner loop of a ufunc
# Places in the table of NumPy's C interface to ufuncs, part of its ABI: of PyUFunc_Type, of
# PyUFunc_FromFuncAndDataAndSignature; then PyUFunc_None, as which a ufunc has no identity.
UFUNC_TYPE_ENTRY, FROM_SIGNATURE_ENTRY, NO_IDENTITY = 0, 31, -1


NARROWER = {"2": "-avx", "4": "-avx512f", "8": ""}  # by lanes, the features of LLVM without which they are the widest


@dataclass(frozen=True)
class Target:
    """The processor for which a program is compiled."""

    cpu: str
    features: str
    lanes: int  # doubles in a vector
    registers: int  # that hold vectors
    fma: bool
    triple: str = ""  # LLVM's name of the machine, if it is not this one


def host() -> Target:
    """Return this machine's processor; ``$JOUNCE_LANES`` selects narrower vectors than it has."""
    widest, asked_lanes = _widest_target(), os.environ.get("JOUNCE_LANES", "")
    if asked_lanes in ("", str(widest.lanes)):
        return widest
    if asked_lanes not in NARROWER or int(asked_lanes) > widest.lanes:
        fitting = ", ".join(lanes for lanes in NARROWER if int(lanes) <= widest.lanes)
        raise JounceError(
            f"JOUNCE_LANES is {quote_value(asked_lanes)}; this processor has vectors of {fitting} doubles"
        )
    # Without AVX there are no fused products and sums either, and only AVX-512 has 32 registers.
    features = f"{widest.features},{NARROWER[asked_lanes]}"
    return Target(widest.cpu, features, int(asked_lanes), 16, widest.fma and asked_lanes != "2")


@cache
def _widest_target() -> Target:
    """Return this machine's processor with its widest vectors."""
    import llvmlite.binding as llvm

    features = llvm.get_host_cpu_features()
    arm = features.get("neon") or features.get("fp-armv8") or False
    # Vectors of SSE2 and of Neon have two doubles, those of AVX four, those of AVX-512 eight.
    lanes = 2
    if features.get("avx"):
        lanes = 4
    if features.get("avx512f"):
        lanes = 8
    registers = 32 if arm or features.get("avx512f") else 16
    return Target(llvm.get_host_cpu_name(), features.flatten(), lanes, registers, bool(arm or features.get("fma")))


def _make_code_generator(target: Target) -> Any:
    """Return a new code generator of LLVM for a target: an engine takes it over."""
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    triple = llvm.Target.from_triple(target.triple or llvm.get_default_triple())
    # Code of opt=2 is no faster, and takes longer to compile.
    return triple.create_target_machine(cpu=target.cpu, features=target.features, opt=1, jit=True)


def assemble(texts: Sequence[str], target: Target) -> bytes:
    """Return the object code of modules linked together."""
    code, module = link(texts, target)
    return code.emit_object(module)


def link(texts: Sequence[str], target: Target) -> tuple[Any, Any]:
    """Return LLVM's code generator for a target and linked modules."""
    import llvmlite.binding as llvm

    code = _make_code_generator(target)
    module, *others = map(llvm.parse_assembly, texts)
    for other in others:
        module.link_in(other)
    module.triple, module.data_layout = code.triple, str(code.target_data)
    return code, module


@dataclass(frozen=True)
class Code:
    """Native code in memory; it lives as long as its engine."""

    engine: Any

    def address(self, name: str) -> int:
        """Return the address of a function."""
        return int(self.engine.get_function_address(name))


def load_object(code: bytes, target: Target) -> Code:
    """Load object code into memory."""
    import llvmlite.binding as llvm

    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), _make_code_generator(target))
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    return Code(engine)


def make_ufunc(address: int, signature: Signature, name: str, pool: int | None) -> tuple[Callable[..., Any], Any]:
    """Return the ufunc of a loop, and what must live with it.

    The loop is called with the address of a pool. If NumPy's table of functions is not the expected one, a plain
    function does the same, more slowly.
    """
    if not has_known_table():
        return PlainCall(address, signature, pool), None
    input_shapes, output_shapes = ([port.shape for port in ports] for ports in (signature.inputs, signature.outputs))
    count = len(input_shapes) + len(output_shapes)
    # NumPy keeps these pointers, not what they point to: one loop, for doubles everywhere, with the pool as its data.
    loops, data = (ctypes.c_void_p * 1)(address), (ctypes.c_void_p * 1)(pool)
    types = ctypes.create_string_buffer(bytes([np.dtype(float).num] * count))
    # The signature of a generalized ufunc, as NumPy reads it: the core shapes of inputs and outputs, sizes for names.
    axes = "->".join(
        ",".join(f"({','.join(map(str, shape))})" for shape in shapes) for shapes in (input_shapes, output_shapes)
    )
    texts = name.encode(), b"", axes.encode()
    ufunc = _ufunc_constructor()(
        loops, data, types, 1, len(input_shapes), len(output_shapes), NO_IDENTITY, *texts[:2], 0, texts[2]
    )
    return ufunc, (loops, data, types, texts)


class PlainCall:
    """A loop that is called as a generalized ufunc is."""

    def __init__(self, address: int, signature: Signature, pool: int | None) -> None:
        self.inputs, self.outputs = ([port.shape for port in ports] for ports in (signature.inputs, signature.outputs))
        self._loop, self._pool = Loop(address), pool

    def __call__(self, *arrays: Any, out: Sequence[np.ndarray] | None = None) -> Any:
        """Compute from arrays with leading batch axes.

        The results are returned, in `out` if given. As in calls of ufuncs, arrays of `out` may also follow the
        others.
        """
        if len(arrays) > len(self.inputs):
            arrays, out = arrays[: len(self.inputs)], arrays[len(self.inputs) :]
        inputs = list(zip([np.asarray(array, dtype=float) for array in arrays], self.inputs, strict=True))
        for x, shape in inputs:
            if x.shape[x.ndim - len(shape) :] != shape:
                raise ValueError(f"an array has shape {x.shape}; expected (..., {', '.join(map(str, shape))})")
        # All arrays get all batch axes, which the loop takes as one: (..., shape) -> (N, shape).
        batch = np.broadcast_shapes(*(x.shape[: x.ndim - len(shape)] for x, shape in inputs))
        whole = [np.ascontiguousarray(np.broadcast_to(x, (*batch, *shape))) for x, shape in inputs]
        results = [np.empty((*batch, *shape)) for shape in self.outputs]
        arrays_and_shapes = zip([*whole, *results], [*self.inputs, *self.outputs], strict=True)
        rows = [x.reshape(prod(batch), *shape) for x, shape in arrays_and_shapes]
        self._loop(*loop_arguments(rows, True), self._pool)
        if out is not None:
            for array, result in zip(out, results, strict=True):
                array[...] = result
            results = list(out)
        return results[0] if len(results) == 1 else tuple(results)


def loop_arguments(arrays: Sequence[np.ndarray], batched: bool) -> tuple[ctypes.Array[Any], ...]:
    """Return the arguments of a loop for batches or one state.

    All arrays have one batch axis, or none has. The arguments are the addresses, the number of states, and the
    strides: from state to state, then within a state.
    """
    steps = [x.strides[0] if batched else 0 for x in arrays]
    strides = [*steps, *(stride for x in arrays for stride in x.strides[batched:])]
    return (
        (ctypes.c_void_p * len(arrays))(*(x.ctypes.data for x in arrays)),
        (ctypes.c_ssize_t * 1)(len(arrays[0]) if batched else 1),
        (ctypes.c_ssize_t * len(strides))(*strides),
    )


@cache
def has_known_table() -> bool:
    """Return whether NumPy's table of functions is the known one.

    Warn once if it is not.
    """
    table = c_table("_UFUNC_API")
    is_table = table is not None and entry(table, UFUNC_TYPE_ENTRY) == id(np.ufunc)
    if table is not None and is_table and entry(table, FROM_SIGNATURE_ENTRY) is not None:
        return True
    warn(f"the table of C functions of NumPy {np.__version__} is not the known one: native code takes longer to call")
    return False


def c_table(name: str) -> int | None:
    """Return the address of a table of NumPy's C interface: of ufuncs, or of arrays."""
    get = ctypes.pythonapi.PyCapsule_GetPointer
    get.restype, get.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    try:
        return cast("int | None", get(getattr(np._core._multiarray_umath, name), None))  # type: ignore[attr-defined]
    # NumPy may have another module, or no capsule in it.
    except (AttributeError, ValueError):
        return None


def entry(table: int, place: int) -> int | None:
    """Return the address at a place of a table."""
    return ctypes.c_void_p.from_address(table + place * ctypes.sizeof(ctypes.c_void_p)).value


def _ufunc_constructor() -> Any:
    """Return PyUFunc_FromFuncAndDataAndSignature of NumPy, as a Python function."""
    table = c_table("_UFUNC_API")
    assert table is not None
    address = entry(table, FROM_SIGNATURE_ENTRY)
    text, integer, pointer = ctypes.c_char_p, ctypes.c_int, ctypes.c_void_p
    kinds = [pointer, pointer, pointer, integer, integer, integer, integer, text, text, integer, text]
    return ctypes.PYFUNCTYPE(ctypes.py_object, *kinds)(address or 0)
