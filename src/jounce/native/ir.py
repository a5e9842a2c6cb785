"""Write LLVM IR: one function at a time, on vectors of states, and in it the operations of traced programs.

A `Writer` holds the text of a module. Values are named in their order, so that a program always gives the same text,
and operations are those of the rows of `program.operations`: all code does an operation by the same instructions.

What the forms of native code share stands behind it: `BlockCode` is what a form hands to `calls`, the code of a block
of states; `JointStep` is a program with places of its inputs and outputs in memory, and `define_step` makes a function
of it; `nan_masks` carry what is not finite in the inputs to all results that depend on it.
"""

import struct
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass
from typing import Self

from jounce.dynamics.computation import Port, Signature
from jounce.native.jit import Target
from jounce.program import operations
from jounce.program.operations import VectorFunction
from jounce.program.program import Program


def bits(x: float) -> int:
    """A double as the integer that has the same bits."""
    return int(struct.unpack("<Q", struct.pack("<d", x))[0])


class Writer:
    """The text of a module, and shorthand for what is often written."""

    def __init__(self, target: Target) -> None:
        self.fma = target.fma
        self._set_lanes(target.lanes)
        self.aligned = f"alignstack({8 * self.lanes})"  # of functions that keep vectors on the stack: none is split
        self.lines: list[str] = []
        self.declared: dict[str, None] = {}
        self.names = 0

    def _set_lanes(self, lanes: int) -> None:
        self.lanes = lanes
        self.V, self.I, self.B = (f"<{lanes} x {kind}>" for kind in ("double", "i64", "i1"))

    def twice_as_wide(self) -> Self:
        """A writer of functions of the same module, on vectors of twice as many lanes."""
        wide = copy(self)
        wide._set_lanes(2 * self.lanes)
        return wide

    def text(self) -> str:
        """The module."""
        wide = f'"prefer-vector-width"="{64 * self.lanes}" "min-legal-vector-width"="{64 * self.lanes}"'
        return "\n".join([*self.declared, *self.lines, f"attributes #0 = {{ nounwind {wide} }}", ""])

    @contextmanager
    def function(self, head: str) -> Iterator[None]:
        """A function, its body written inside; one without a value returns at the end."""
        self.lines.append(f"define {head} #0 {{")
        yield
        if " void @" in f" {head}" and not self.lines[-1].startswith("  ret"):
            self.do("ret void")
        self.lines.append("}")

    @contextmanager
    def loop_over_blocks(self, count: str, size: int) -> Iterator[str]:
        """A loop over blocks of a size, the last of which may be smaller, if there are any; yields the index."""
        with (
            self.only_if(self.let(f"icmp sgt i64 {count}, 0"), "some", "done"),
            self.loop(self.let(f"sdiv i64 {self.let(f'add i64 {count}, {size - 1}')}, {size}")) as index,
        ):
            yield index

    @contextmanager
    def only_if(self, condition: str, inside: str, after: str) -> Iterator[None]:
        """What is written inside is a block that runs if a condition holds; the two names are those of the labels."""
        self.do(f"br i1 {condition}, label %{inside}, label %{after}")
        self.label(inside)
        yield
        if not self.lines[-1].startswith(("  ret", "  br")):
            self.do(f"br label %{after}")
        self.label(after)

    def label(self, name: str) -> None:
        """The start of a block."""
        self.lines.append(f"{name}:")

    def do(self, text: str) -> None:
        """An instruction without a value."""
        self.lines.append(f"  {text}")

    def let(self, text: str) -> str:
        """The name of a new value."""
        self.names += 1
        self.lines.append(f"  %v{self.names - 1} = {text}")
        return f"%v{self.names - 1}"

    def number(self, x: float) -> str:
        """A constant, to the last bit."""
        return f"0x{bits(x):016X}"

    def vector(self, x: float) -> str:
        """A constant in all lanes."""
        return f"splat (double {self.number(x)})"

    def splat(self, x: str) -> str:
        """A number in all lanes."""
        one = self.let(f"insertelement {self.V} poison, double {x}, i64 0")
        return self.let(f"shufflevector {self.V} {one}, {self.V} poison, <{self.lanes} x i32> zeroinitializer")

    def shuffle(self, vectors: Sequence[str], order: Sequence[int], lanes: int | None = None) -> str:
        """Lanes of one or two vectors of a size, numbered through, as a vector."""
        kind, listed = f"<{lanes or self.lanes} x double>", ", ".join(f"i32 {j}" for j in order)
        return self.let(f"shufflevector {kind} {vectors[0]}, {kind} {vectors[-1]}, <{len(order)} x i32> <{listed}>")

    def integers(self, x: int) -> str:
        """An integer constant in all lanes."""
        return f"splat (i64 {x})"

    def call(self, name: str, kind: str, *operands: str) -> str:
        """The value of an intrinsic whose arguments are of its own type."""
        self.declared[f"declare {kind} @{name}({', '.join([kind] * len(operands))})"] = None
        return self.let(f"call {kind} @{name}({', '.join(f'{kind} {x}' for x in operands)})")

    def op(self, kind: str, *x: str) -> str:
        """An operation of a program on vectors, by the instructions of its row."""
        operation, values = operations.OPERATIONS[kind], list(x)
        for name, *taken in operation.llvm if self.fma else operation.unfused or operation.llvm:
            operands = [self.vector(y) if isinstance(y, float) else values[y] for y in taken]
            if name.startswith("llvm."):
                values.append(self.call(f"{name}.v{self.lanes}f64", self.V, *operands))
            else:
                values.append(self.let(f"{name} {self.V} {', '.join(operands)}"))
        return values[-1]

    def load(self, address: str, lanes: int | None = None) -> str:
        """A vector from memory, wherever it lies."""
        return self.let(f"load <{lanes or self.lanes} x double>, ptr {address}, align 8")

    def store(self, value: str, address: str, lanes: int | None = None) -> None:
        """A vector into memory."""
        self.do(f"store <{lanes or self.lanes} x double> {value}, ptr {address}, align 8")

    def prefetch(self, address: str) -> None:
        """Have a cache line at hand that is going to be written; the address may be any."""
        self.declared["declare void @llvm.prefetch.p0(ptr, i32, i32, i32)"] = None
        self.do(f"call void @llvm.prefetch.p0(ptr {address}, i32 1, i32 3, i32 1)")

    def at(self, base: str, index: str | int, kind: str = "double") -> str:
        """The address of an element."""
        return self.let(f"getelementptr {kind}, ptr {base}, i64 {index}")

    def horner(self, coefficients: Sequence[float], z: str) -> str:
        """A polynomial in z, lowest power first."""
        value = self.vector(coefficients[-1])
        for c in reversed(coefficients[:-1]):
            value = self.op("fma", value, z, self.vector(c))
        return value

    def table(self, name: str, numbers: Sequence[float] | Sequence[int], linkage: str = "internal") -> None:
        """Constants in memory: doubles, or integers if the first one is."""
        kind, write = ("double", self.number) if isinstance(numbers[0], float) else ("i64", str)
        listed = ", ".join(f"{kind} {write(x)}" for x in numbers)
        self.lines.append(f"@{name} = {linkage} constant [{len(numbers)} x {kind}] [{listed}]")

    def table_of_vectors(self, name: str, numbers: Sequence[float]) -> None:
        """Constants in memory, each in all lanes of a vector."""
        listed = ", ".join(f"{self.V} {self.vector(x)}" for x in numbers)
        self.lines.append(f"@{name} = internal constant [{len(numbers)} x {self.V}] [{listed}], align {8 * self.lanes}")

    @contextmanager
    def loop(self, count: str, start: str = "0") -> Iterator[str]:
        """A loop over an index from start to count, at least once; yields the index."""
        self.names += 1
        name = f"L{self.names}"
        before = f"{name}.before"
        self.do(f"br label %{before}")
        self.label(before)
        self.do(f"br label %{name}")
        self.label(name)
        index = self.let(f"phi i64 [ {start}, %{before} ], [ %{name}.next, %{name}.latch ]")
        yield index
        self.do(f"br label %{name}.latch")
        self.label(f"{name}.latch")
        self.do(f"%{name}.next = add i64 {index}, 1")
        self.do(f"%{name}.more = icmp slt i64 %{name}.next, {count}")
        self.do(f"br i1 %{name}.more, label %{name}, label %{name}.end")
        self.label(f"{name}.end")


@dataclass(frozen=True)
class BlockCode:
    """The code for blocks of states: the text of ``@block(in, out, bodies, count)``, and the positions of its results.

    It computes `count` blocks, at most as many as are `at_once`, `memory_layout.block_size` behind each other.
    """

    define: Callable[[Writer], None]
    places: Sequence[Sequence[int]]  # by result, the number of the vector of each scalar
    of_bodies: int = 0  # vectors that it works in besides
    short: bool = False  # whether a state alone has code of its own, which takes as long to compile again
    at_once: int = 1  # blocks
    define_wide: Callable[[Writer], None] | None = None  # what code for a state alone calls, in vectors all the same
    results_in_bodies: bool = False  # where places are counted from


@dataclass(frozen=True)
class JointStep:
    """A traced step, and where its inputs and outputs are: an offset in scalars in the memory of that name."""

    program: Program
    reads: tuple[tuple[str, int], ...]
    writes: tuple[tuple[str, int], ...]

    @property
    def memory(self) -> list[str]:
        """The names of the memory that it takes."""
        return sorted({memory for memory, _ in (*self.reads, *self.writes)})


def emit_steps(ir: Writer, program: Program, read: Callable[[int], str]) -> list[str]:
    """Write the steps of a program, as those of a joint are; the names of their values."""
    called, names, circles = vector_calls(program), list[str](), dict[int, str]()
    for i, step in enumerate(program.steps):
        operands = [names[j] for j in step.operands]
        if step.kind == "constant":
            names.append(ir.vector(step.value))
        elif step.kind == "input":
            names.append(read(int(step.value)))
        elif (function := called.get(i)) is None:
            names.append(ir.op(step.kind, *operands))
        elif function.result is None:
            names.append(ir.let(f"call {ir.V} @{function.name}({ir.V} {operands[0]})"))
        else:  # a sine or a cosine, of an angle that is taken twice
            if step.operands[0] not in circles:
                place = circles[step.operands[0]] = ir.let(f"alloca [2 x {ir.V}], align {8 * ir.lanes}")
                ir.do(f"call void @sincos({ir.V} {operands[0]}, {ir.V} {operands[0]}, ptr {place}, ptr {place})")
            names.append(ir.load(ir.at(circles[step.operands[0]], function.result, ir.V)))
    return names


def define_step(ir: Writer, name: str, step: JointStep, memory: Sequence[str]) -> None:
    """A step as a function of parts of memory: vectors, and constants, which are single numbers."""

    def read(i: int) -> str:
        part, place = step.reads[i]
        if part == "constants":
            return ir.splat(ir.let(f"load double, ptr {ir.at('%constants', place)}"))
        return ir.load(ir.at(f"%{part}", place, ir.V))

    with ir.function(f"internal void @{name}({pointers(*(f'%{part}' for part in memory))}) {ir.aligned}"):
        values = emit_steps(ir, step.program, read)
        for (part, place), i in zip(step.writes, step.program.outputs, strict=True):
            ir.store(values[i], ir.at(f"%{part}", place, ir.V))


def pointers(*names: str) -> str:
    """Arguments of a step."""
    return ", ".join(f"ptr {name}" for name in names)


def nan_masks(ir: Writer, signature: Signature, add: Callable[[str, Port], str]) -> Iterator[str]:
    """For each order of the outputs 0, or NaN where an input that it depends on is not finite.

    ``add(total, port)`` adds 0 times each scalar of an input.
    """
    total = ir.vector(0.0)
    for order in range(len(signature.outputs)):
        for port in signature.inputs:
            if port.first_order == order:
                total = add(total, port)
        yield total


def vector_calls(program: Program) -> dict[int, VectorFunction]:
    """The steps that call functions of vectors, and which."""
    rows = (
        (i, operations.OPERATIONS[step.kind])
        for i, step in enumerate(program.steps)
        if step.kind not in operations.LEAVES
    )
    return {i: row.function for i, row in rows if row.function is not None}
