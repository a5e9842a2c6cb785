"""Calls of kernels with one state past NumPy's ufuncs, which take microseconds to look at their arguments.

Problem: a kernel of an arm computes one state in a third of a microsecond. Algorithm: a function of CPython's
vectorcall protocol in LLVM IR compares each argument with its port by the public fields of arrays (type, dtype, number
of axes, lengths, contiguous and aligned) or copies a list of numbers, allocates results by NumPy's C interface, and
calls the kernel. Invariants: it runs no Python code and writes nothing before it has accepted all arguments, and it
runs the code of `Kernel.ufunc`, hence the same bits. All it does not accept, batches and subclasses among it, and
states at which the processor reports what NumPy would warn of, go to the callable that it is made with. There is no
failure: where fields are not where they are expected, on interpreters without a global lock and on processors on which
it has not been tested, that callable serves alone.
"""

import ctypes
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

from jounce.dynamics.computation import Port, Signature
from jounce.native import direct_interpreter, pose_check
from jounce.native.direct_interpreter import DirectBinding
from jounce.native.direct_layout import MAX_AXES, MAX_CLOSING_NUMBERS, MAX_PORTS, TABLE_WORDS
from jounce.native.loop_closure import NativeStep

PROTOCOL = 0x0080 | 0x0002  # METH_FASTCALL | METH_KEYWORDS
MAX_CHECKED_PORTS = 16  # of a base whose motion does not enter


class Definition(ctypes.Structure):
    """PyMethodDef of CPython."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("function", ctypes.c_void_p),
        ("flags", ctypes.c_int),
        ("doc", ctypes.c_char_p),
    )


def decline(*arguments: Any, **options: Any) -> None:
    """Serve no call."""


class Keyword(NamedTuple):
    """A keyword that a direct call takes: arrays of some ports from `start` on, or one value."""

    name: str
    start: int = 0
    ports: int = 0
    value: Any = None


class ClosingTable:
    """The words by which native code closes loops that are nearly closed, up to a condition number."""

    def __init__(self, step: NativeStep, limit: float) -> None:
        self.count = step.count
        numbers = step.still, np.array(step.max_measures(limit)), np.ascontiguousarray(step.in_place, dtype=float)
        places = [np.ascontiguousarray(x, dtype=np.int64) for x in (step.own, step.others, step.following)]
        strides = _strides((*step.signature.inputs, *step.signature.outputs))
        addresses = *step.addresses, strides.ctypes.data
        words = (
            *addresses,
            *map(len, places),
            *(x.ctypes.data for x in (*places, *numbers)),
        )  # in the order of CLOSING_WORDS
        self.words, self._kept = np.array(words, dtype=np.int64), (step, numbers, places, strides)
        self.is_possible = sum(port.size for port in step.signature.outputs) + len(step.own) <= MAX_CLOSING_NUMBERS


class DirectCalls:
    """The direct calls of one kernel; its code and scratch memory, and the code of the calls, live as long as they."""

    def __init__(self, addresses: tuple[int, int], signature: Signature, *alive: Any) -> None:
        self._addresses, self._alive = addresses, alive
        self._inputs, self._ports = len(signature.inputs), (*signature.inputs, *signature.outputs)
        self._strides = _strides(self._ports)
        self.are_possible = len(self._ports) + MAX_CHECKED_PORTS <= MAX_PORTS and direct_interpreter.code() is not None

    def make(
        self,
        others: Callable[..., Any],
        keywords: Sequence[Keyword] = (),
        checked: Sequence[Port] = (),
        pose: int = -1,
        closing: ClosingTable | None = None,
        name: str = "",
        doc: str = "",
        owner: Any = None,
    ) -> Callable[..., Any]:
        """A callable that takes one state: the kernel's arrays that no keyword takes, these keywords, and out.

        `checked` are ports, numbered after those of the kernel, whose arrays do not enter; `pose` is the number of a
        port whose matrix is checked to be one. With a table for `closing` loops, the first array is of all coordinates
        of the tree, and the last input is not given. `others` serves all other calls.
        """
        code = direct_interpreter.code() if self.are_possible else None
        if code is None:
            return others
        ports, given = [*self._ports, *checked], self._inputs - bool(closing)
        if closing:
            ports[0] = replace(ports[0], shape=(closing.count,))
        check, strides = pose_check.code_address() if pose >= 0 else (0, _strides(()))
        rows = [[id(sys.intern(x.name)), x.start, x.ports, id(x.value)] for x in keywords]
        listed = np.array(rows, dtype=np.int64)
        words = {
            "code": self._addresses[0], "pool": self._addresses[1], "strides": self._strides.ctypes.data,
            "given": given, "inputs": self._inputs, "end": len(self._ports), "all": len(ports),
            "positional": given - sum(x.ports for x in keywords if x.start < self._inputs),
            "required": len(rows), "keywords": listed.ctypes.data,
            "pose": pose, "check": check, "check_strides": strides.ctypes.data,
            "closing": closing.words.ctypes.data if closing else 0,
        }  # fmt: skip
        described = [[len(p.shape), p.size, *p.shape, *[1] * (MAX_AXES - len(p.shape))] for p in ports]
        table = np.array([*map(words.__getitem__, TABLE_WORDS), *chain.from_iterable(described)], dtype=np.int64)
        definition = Definition(name.encode(), code.address("compute"), PROTOCOL, doc.encode())
        kept = code, definition, listed, strides, keywords, closing, self
        return direct_interpreter.function_maker()(
            ctypes.byref(definition), DirectBinding(table, others, owner, kept), None
        )


def _strides(ports: Sequence[Port]) -> np.ndarray:
    """The strides of arrays as native code takes them: from state to state, of which there is one, then within it."""
    within = [stride for port in ports for stride in np.empty(port.shape).strides]
    return np.array([0] * len(ports) + within, dtype=np.int64)
