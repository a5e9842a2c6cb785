"""Write LLVM IR: functions on vectors of states, one at a time.

The operations in them are those of traced programs. A `Writer` holds the text of a module. Values are named in their
order, so that a program always gives the same text, and operations are those of the rows of `program.operations`: all
code does an operation by the same instructions.

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
    """Return a double as the integer that has the same bits."""
    return int(struct.unpack("<Q", struct.pack("<d", x))[0])


class Writer:
    """The text of a module, and shorthand for what is often written.

    `V`, `I` and `B` are the types of vectors of doubles, of integers of 64 bits, and of bits, with `lanes` lanes.
    """

    def __init__(self, target: Target) -> None:
        self.fma = target.fma
        self._set_lanes(target.lanes)
        # The attribute of functions that keep vectors on the stack: no vector is split between two cache lines.
        self.aligned = f"alignstack({8 * self.lanes})"
        self.lines: list[str] = []
        self.declared: dict[str, None] = {}
        self.names = 0

    def _set_lanes(self, lanes: int) -> None:
        self.lanes = lanes
        self.V, self.I, self.B = (f"<{lanes} x {kind}>" for kind in ("double", "i64", "i1"))

    def twice_as_wide(self) -> Self:
        """Return a writer of this module with twice as many lanes."""
        # Lines and declarations are shared. The names of values are not: they are local to a function.
        wide = copy(self)
        wide._set_lanes(2 * self.lanes)
        return wide

    def text(self) -> str:
        """Return the module."""
        wide = f'"prefer-vector-width"="{64 * self.lanes}" "min-legal-vector-width"="{64 * self.lanes}"'
        return "\n".join([*self.declared, *self.lines, f"attributes #0 = {{ nounwind {wide} }}", ""])

    @contextmanager
    def function(self, head: str) -> Iterator[None]:
        """Write a function, its body inside.

        One without a value returns at the end.
        """
        self.lines.append(f"define {head} #0 {{")
        yield
        if " void @" in f" {head}" and not self.lines[-1].startswith("  ret"):
            self.do("ret void")
        self.lines.append("}")

    @contextmanager
    def loop_over_blocks(self, count: str, size: int) -> Iterator[str]:
        """Write a loop over blocks of a size; yield the index.

        The last block may be smaller.
        """
        # The loop itself runs at least once: a count of 0 skips it.
        with (
            self.only_if(self.let(f"icmp sgt i64 {count}, 0"), "some", "done"),
            self.loop(self.let(f"sdiv i64 {self.let(f'add i64 {count}, {size - 1}')}, {size}")) as index,
        ):
            yield index

    @contextmanager
    def only_if(self, condition: str, inside: str, after: str) -> Iterator[None]:
        """Write a block that runs if a condition holds.

        It has the label `inside`; `after` is that of what follows.
        """
        self.do(f"br i1 {condition}, label %{inside}, label %{after}")
        self.label(inside)
        yield
        if not self.lines[-1].startswith(("  ret", "  br")):
            self.do(f"br label %{after}")
        self.label(after)

    def label(self, name: str) -> None:
        """Write the start of a block."""
        self.lines.append(f"{name}:")

    def do(self, text: str) -> None:
        """Write an instruction without a value."""
        self.lines.append(f"  {text}")

    def let(self, text: str) -> str:
        """Write an instruction, and return the name of its value."""
        self.names += 1
        self.lines.append(f"  %v{self.names - 1} = {text}")
        return f"%v{self.names - 1}"

    def number(self, x: float) -> str:
        """Return a constant, to the last bit."""
        return f"0x{bits(x):016X}"

    def vector(self, x: float) -> str:
        """Return a constant in all lanes."""
        return f"splat (double {self.number(x)})"

    def splat(self, x: str) -> str:
        """Return a number in all lanes."""
        one = self.let(f"insertelement {self.V} poison, double {x}, i64 0")
        return self.let(f"shufflevector {self.V} {one}, {self.V} poison, <{self.lanes} x i32> zeroinitializer")

    def shuffle(self, vectors: Sequence[str], order: Sequence[int], lanes: int | None = None) -> str:
        """Return lanes of one or two vectors, numbered through, as one vector."""
        kind, listed = f"<{lanes or self.lanes} x double>", ", ".join(f"i32 {j}" for j in order)
        return self.let(f"shufflevector {kind} {vectors[0]}, {kind} {vectors[-1]}, <{len(order)} x i32> <{listed}>")

    def integers(self, x: int) -> str:
        """Return an integer constant in all lanes."""
        return f"splat (i64 {x})"

    def call(self, name: str, kind: str, *operands: str) -> str:
        """Return the value of an intrinsic of one type."""
        self.declared[f"declare {kind} @{name}({', '.join([kind] * len(operands))})"] = None
        return self.let(f"call {kind} @{name}({', '.join(f'{kind} {x}' for x in operands)})")

    def op(self, kind: str, *x: str) -> str:
        """Write an operation of a program, by instructions of its row."""
        operation, values = operations.OPERATIONS[kind], list(x)
        # A processor that does not fuse a product and a sum takes other instructions for operations that have some.
        is_unfused = not self.fma and len(operation.unfused) > 0
        # The operands of an instruction are constants, or numbers of the operands and of the values before it.
        for name, *arguments in operation.unfused if is_unfused else operation.llvm:
            operands = [self.vector(y) if isinstance(y, float) else values[y] for y in arguments]
            if name.startswith("llvm."):
                values.append(self.call(f"{name}.v{self.lanes}f64", self.V, *operands))
            else:
                values.append(self.let(f"{name} {self.V} {', '.join(operands)}"))
        return values[-1]

    def load(self, address: str, lanes: int | None = None) -> str:
        """Load a vector from memory, at any multiple of 8 bytes."""
        return self.let(f"load <{lanes or self.lanes} x double>, ptr {address}, align 8")

    def store(self, value: str, address: str, lanes: int | None = None) -> None:
        """Store a vector into memory."""
        self.do(f"store <{lanes or self.lanes} x double> {value}, ptr {address}, align 8")

    def prefetch(self, address: str) -> None:
        """Fetch a cache line that is going to be written.

        The address may be any.
        """
        self.declared["declare void @llvm.prefetch.p0(ptr, i32, i32, i32)"] = None
        self.do(f"call void @llvm.prefetch.p0(ptr {address}, i32 1, i32 3, i32 1)")

    def at(self, base: str, index: str | int, kind: str = "double") -> str:
        """Return the address of an element."""
        return self.let(f"getelementptr {kind}, ptr {base}, i64 {index}")

    def horner(self, coefficients: Sequence[float], z: str) -> str:
        """Return the value of a polynomial in z, lowest power first."""
        value = self.vector(coefficients[-1])
        for c in reversed(coefficients[:-1]):
            value = self.op("fma", value, z, self.vector(c))
        return value

    def table(self, name: str, numbers: Sequence[float] | Sequence[int], linkage: str = "internal") -> None:
        """Define constants in memory: doubles, or integers if the first one is."""
        kind, write = ("double", self.number) if isinstance(numbers[0], float) else ("i64", str)
        listed = ", ".join(f"{kind} {write(x)}" for x in numbers)
        self.lines.append(f"@{name} = {linkage} constant [{len(numbers)} x {kind}] [{listed}]")

    def table_of_vectors(self, name: str, numbers: Sequence[float]) -> None:
        """Define constants in memory, each in all lanes of a vector."""
        listed = ", ".join(f"{self.V} {self.vector(x)}" for x in numbers)
        self.lines.append(f"@{name} = internal constant [{len(numbers)} x {self.V}] [{listed}], align {8 * self.lanes}")

    @contextmanager
    def loop(self, count: str, start: str = "0") -> Iterator[str]:
        """Write a loop that runs at least once; yield the index.

        The index goes from `start` to `count`.
        """
        self.names += 1
        name = f"L{self.names}"
        # The index comes from a block of its own before the loop and from one at its end: what is written inside may
        # have blocks of any names.
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
    of_bodies: int = 0  # vectors behind the results that it works in
    short: bool = False  # whether a state alone has code of its own, which takes as long to compile again
    at_once: int = 1  # the largest number of blocks in a call
    define_wide: Callable[[Writer], None] | None = None  # functions on vectors that code for a state alone calls
    results_in_bodies: bool = False  # whether places are counted from the working memory, not from the results


@dataclass(frozen=True)
class JointStep:
    """A traced step, and where its inputs and outputs are: an offset in scalars in the memory of that name."""

    program: Program
    reads: tuple[tuple[str, int], ...]
    writes: tuple[tuple[str, int], ...]

    @property
    def memory(self) -> list[str]:
        """The names of the parts of memory that it takes."""
        return sorted({memory for memory, _ in (*self.reads, *self.writes)})


def emit_steps(ir: Writer, program: Program, read: Callable[[int], str]) -> list[str]:
    """Write the steps of a program; return the names of their values.

    `read` loads an input by its number. Programs of the steps of joints are short: all values stay in registers.
    """
    called, names, circles = vector_calls(program), list[str](), dict[int, str]()
    for i, step in enumerate(program.steps):
        operands, function = [names[j] for j in step.operands], called.get(i)
        if step.kind == "constant":
            names.append(ir.vector(step.value))
        elif step.kind == "input":
            names.append(read(int(step.value)))
        elif function is None:
            names.append(ir.op(step.kind, *operands))
        elif function.result is None:
            names.append(ir.let(f"call {ir.V} @{function.name}({ir.V} {operands[0]})"))
        else:
            # A sine or a cosine: one call writes both of an angle, and takes two angles, here twice the same one.
            if step.operands[0] not in circles:
                place = circles[step.operands[0]] = ir.let(f"alloca [2 x {ir.V}], align {8 * ir.lanes}")
                ir.do(f"call void @sincos({ir.V} {operands[0]}, {ir.V} {operands[0]}, ptr {place}, ptr {place})")
            names.append(ir.load(ir.at(circles[step.operands[0]], function.result, ir.V)))
    return names


def define_step(ir: Writer, name: str, step: JointStep, memory: Sequence[str]) -> None:
    """Define a step as a function of parts of memory: vectors, and constants, which are numbers."""

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
    """Return arguments of a call or a function, all pointers."""
    return ", ".join(f"ptr {name}" for name in names)


def nan_masks(ir: Writer, signature: Signature, add: Callable[[str, Port], str]) -> Iterator[str]:
    """Yield the mask of each order of the outputs.

    It is 0, or NaN in lanes of states in which an input that the order takes is not finite. ``add(total, port)``
    adds 0 times each scalar of an input.
    """
    # The output of order k takes all inputs whose first order is k or lower: sums go on from order to order.
    total = ir.vector(0.0)
    for order in range(len(signature.outputs)):
        for port in signature.inputs:
            if port.first_order == order:
                total = add(total, port)
        yield total


def vector_calls(program: Program) -> dict[int, VectorFunction]:
    """Return the steps that call functions of vectors, with these functions."""
    rows = (
        (i, operations.OPERATIONS[step.kind])
        for i, step in enumerate(program.steps)
        if step.kind not in operations.LEAVES
    )
    return {i: row.function for i, row in rows if row.function is not None}
