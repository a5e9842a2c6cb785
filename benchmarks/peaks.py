"""What the processor can do: fused multiply-adds and additions in registers, and copying in memory.

The loops are written as LLVM IR and compiled as kernels are, with chains of operations that do not wait for each other.
"""

import ctypes
from functools import partial

import numpy as np

from benchmarks.measure import Case
from jounce.native import jit
from jounce.native.ir import Writer
from jounce.native.jit import host

CHAINS = 12  # independent ones: more than latency times pipes, and all fit into sixteen registers with their constants
LENGTH = 8  # operations of each chain in a turn of the loop
TURNS = 20_000
MIXES = {"fma": ("fma",), "add": ("add",), "both": ("fma", "add")}
LOOP = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)
COPIED = 2**26  # bytes, more than caches hold


def cases() -> list[Case]:
    """The loops and the copy; their times are per vector instruction, and per byte read or written."""
    source, target = np.ones(COPIED // 8), np.zeros(COPIED // 8)
    loops = [Case(("peak", name), loop(kinds), TURNS * CHAINS * LENGTH) for name, kinds in MIXES.items()]
    return [*loops, Case(("peak", "copy"), partial(np.copyto, target, source), 2 * COPIED)]


def loop(kinds: tuple[str, ...]) -> partial[None]:
    """A call of the loop, its chains of these kinds in turn."""
    machine = host()
    code = jit.load_object(jit.assemble([_text(kinds)], machine), machine)
    room = np.zeros(CHAINS * machine.lanes)
    arrays, turns = (ctypes.c_void_p * 1)(room.ctypes.data), (ctypes.c_ssize_t * 1)(TURNS)
    call = partial(LOOP(code.address("states")), *(ctypes.c_void_p(ctypes.addressof(x)) for x in (arrays, turns)))
    vars(call)["alive"] = code, room, arrays, turns
    return call


def _text(kinds: tuple[str, ...]) -> str:
    ir = Writer(host())
    factor, summand = ir.vector(0.5), ir.vector(1.0)  # x/2 + 1 tends to 2: no number grows beyond all bounds
    with ir.function("void @states(ptr %args, ptr %dimensions)"):
        ir.label("start")
        room, turns = ir.let("load ptr, ptr %args"), ir.let("load i64, ptr %dimensions")
        firsts = [ir.load(ir.at(room, j, ir.V)) for j in range(CHAINS)]
        ir.do("br label %turn")
        ir.label("turn")
        ir.do("%i = phi i64 [ 0, %start ], [ %next, %turn ]")
        for j, first in enumerate(firsts):
            ir.do(f"%x{j} = phi {ir.V} [ {first}, %start ], [ %last{j}, %turn ]")
        chains = [f"%x{j}" for j in range(CHAINS)]
        for _ in range(LENGTH):
            for j, x in enumerate(chains):
                kind = kinds[j % len(kinds)]
                chains[j] = ir.op("fma", x, factor, summand) if kind == "fma" else ir.op("add", x, summand)
        for j, x in enumerate(chains):
            ir.do(f"%last{j} = bitcast {ir.V} {x} to {ir.V}")
        ir.do("%next = add i64 %i, 1")
        ir.do(f"br i1 {ir.let(f'icmp slt i64 %next, {turns}')}, label %turn, label %done")
        ir.label("done")
        for j in range(CHAINS):
            ir.store(f"%last{j}", ir.at(room, j, ir.V))
        ir.do("ret void")
    return ir.text()
