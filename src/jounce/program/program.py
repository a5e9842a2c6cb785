"""A program holds scalar operations in an order of computation; a tape records it.

A `Program` has steps, from inputs to outputs, each of which takes earlier steps only. A `Tape` writes them: mathematics
runs on scalars of type `Node`, which record the operations on them, and `Tape.program` takes the steps that some nodes
need. Equal expressions are one node (hash-consing), sums and products have a canonical order, signs stay outside, and
operations that are trivial because of 0, 1 or -1 are not recorded.

`prune` and `topological_order` select and sort the steps of programs and of tapes, `reuse_places` assigns places to
values that are kept for a while. A trace that outgrows its tape ends in `TapeFullError`.
"""

import gc
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import reduce
from heapq import heappop, heappush
from math import inf
from operator import mul
from typing import Any, NamedTuple

import numpy as np

from jounce.core.scalars import Recorder
from jounce.program import operations


class Step(NamedTuple):
    """One step: an operation on earlier steps, a constant of this value, or the input of this number."""

    kind: str
    operands: tuple[int, ...] = ()
    value: float = 0.0


@dataclass(frozen=True)
class Program:
    """Steps, each taking earlier ones only, and which of them are the outputs."""

    steps: tuple[Step, ...]
    outputs: tuple[int, ...]
    inputs: int  # how many there are, used or not

    def counts(self) -> Counter[str]:
        """The number of operations of each kind."""
        return Counter(step.kind for step in self.steps)

    @property
    def operations(self) -> int:
        """The number of operations on scalars, including sines and cosines; inputs and constants are free."""
        return sum(count for kind, count in self.counts().items() if kind not in operations.FREE_KINDS)

    def run(self, inputs: Sequence[float]) -> list[float]:
        """Compute the outputs for given inputs: the reference for native code."""
        values: list[float] = []
        for step in self.steps:
            if step.kind == "input":
                values.append(inputs[int(step.value)])
            elif step.kind == "constant":
                values.append(step.value)
            else:
                values.append(operations.OPERATIONS[step.kind].value(*(values[i] for i in step.operands)))
        return [values[i] for i in self.outputs]

    def uses(self) -> Counter[int]:
        """Return how often each step is used, by other steps and as an output."""
        return Counter([*(i for step in self.steps for i in step.operands), *self.outputs])


def prune(steps: Sequence[Any], outputs: Sequence[int], inputs: int) -> Program:
    """The program of those steps, or nodes of a tape, that the outputs need, in their order."""
    needed = set(outputs)
    for i in range(len(steps) - 1, -1, -1):  # operands come before the steps that take them
        if i in needed:
            needed.update(steps[i].operands)
    order = sorted(needed)
    place = {old: new for new, old in enumerate(order)}
    taken = [steps[i] for i in order]
    kept = [Step(step.kind, tuple([place[j] for j in step.operands]), step.value) for step in taken]
    return Program(tuple(kept), tuple([place[i] for i in outputs]), inputs)


def topological_order(roots: Sequence[int], operands: Callable[[int], Sequence[int]]) -> list[int]:
    """Return all nodes that the roots need, operands first, each once: depth first, in the order of the roots."""
    order: list[int] = []
    seen: set[int] = set()
    stack = [*reversed(roots)]
    while stack:
        i = stack.pop()
        if i < 0:  # its operands are done
            order.append(~i)
        elif i not in seen:
            seen.add(i)
            stack.append(~i)
            stack.extend(reversed(operands(i)))
    return order


def reuse_places(spans: Iterable[tuple[int, int]]) -> list[int]:
    """Assign places to values that are kept from a first time to a last; they come in the order of the first.

    This is linear-scan register allocation without spilling: the lowest free place, or a new one without any. No other
    assignment needs fewer places.
    """
    places, free, taken, count = list[int](), list[int](), list[tuple[int, int]](), 0
    for first, last in spans:
        while taken and taken[0][0] < first:
            heappush(free, heappop(taken)[1])
        if not free:
            free, count = [count], count + 1
        places.append(heappop(free))
        heappush(taken, (last, places[-1]))
    return places


# Tracing: scalars that record the operations on them.
class Node(Recorder):
    """A scalar of a trace: a step on its tape, and its number there.

    Most operations on dense matrices are trivial, times 0 and plus 0: these are tested first.
    """

    __slots__ = ("i", "kind", "operands", "opposite", "tape", "value")

    def __init__(self, tape: "Tape", i: int, kind: str, operands: tuple[int, ...], value: float) -> None:
        self.tape, self.i, self.kind, self.operands, self.value = tape, i, kind, operands, value
        self.opposite: Node | None = None  # -x, once it was asked for

    def __add__(self, other: Any) -> "Node":
        x, y, tape = self, other, self.tape
        zero = tape.zero
        if y is zero or not y:
            return x
        if y.__class__ is not Node:
            y = tape.node(y)
        if x is zero:
            return y
        if x.kind == y.kind == "constant":
            return tape.node(x.value + y.value)
        if x.kind == "neg":
            x, y = y, x
        if y.kind == "neg":
            return -(-x + -y) if x.kind == "neg" else tape.subtract(x, -y)
        return tape.write("add", x.i, y.i) if x.i < y.i else tape.write("add", y.i, x.i)

    def __sub__(self, other: Any) -> "Node":
        return self + -self.tape.node(other)

    def __rsub__(self, other: Any) -> "Node":
        return self.tape.node(other) + -self

    def __neg__(self) -> "Node":
        if self.opposite is None:
            self.opposite = self.tape.function("neg", self)
        return self.opposite

    def __mul__(self, other: Any) -> "Node":
        x, y, tape = self, other, self.tape
        zero = tape.zero
        if x is zero or y is zero or not y:
            return zero
        if y.__class__ is not Node:
            y = tape.node(y)
        one = tape.one
        if x is one:
            return y
        if y is one:
            return x
        if y.kind == "constant":
            if x.kind == "constant":
                return tape.node(x.value * y.value)
            x, y = y, x
        if x.kind == "neg" or (x.kind == "constant" and x.value < 0):
            return -(-x * y)
        if y.kind == "neg":
            return -(x * -y)
        if x.kind == "constant" and y.kind == "mul":
            for inner, rest in (y.operands, y.operands[::-1]):
                if (factor := tape.nodes[inner]).kind == "constant":
                    return tape.nodes[rest] * (x.value * factor.value)
        return tape.write("mul", x.i, y.i) if x.i < y.i else tape.write("mul", y.i, x.i)

    __radd__, __rmul__ = __add__, __mul__

    def __truediv__(self, other: Any) -> "Node":
        return self * self.tape.function("inv", self.tape.node(other))

    def __rtruediv__(self, other: Any) -> "Node":
        return self.tape.node(other) / self

    def __pow__(self, exponent: int) -> "Node":
        if not isinstance(exponent, int | np.integer):
            return NotImplemented
        power = reduce(mul, [self] * abs(int(exponent)), self.tape.node(1))
        return power if exponent >= 0 else 1 / power

    def sinh(self) -> "Node":
        """tanh cosh, which keeps its digits near 0."""
        return self.tape.function("tanh", self) * self.cosh()

    def cosh(self) -> "Node":
        """The mean of exp x and exp -x."""
        e = self.tape.function("exp", self)
        return (e + 1 / e) * 0.5

    def check_recording(self) -> None:
        """Raise TapeFullError if the tape is full."""
        self.tape.check()


def _method(kind: str) -> Callable[[Node], Node]:
    return lambda x: x.tape.function(kind, x)


for kind in operations.FUNCTION_KINDS:  # as NumPy's object arrays ask for them: x.sin()
    setattr(Node, kind, _method(kind))


class TapeFullError(Exception):
    """A trace has more steps than its tape may hold."""


@contextmanager
def interruptible() -> Iterator[None]:
    """Inside, Ctrl-C is a KeyboardInterrupt: NumPy's loops over nodes go on after it and end in a SystemError."""
    try:
        yield
    except SystemError as error:
        cause: BaseException | None = error
        while cause is not None and not isinstance(cause, KeyboardInterrupt):
            cause = cause.__cause__ or cause.__context__
        if cause is None:
            raise
        raise KeyboardInterrupt from None


@contextmanager
def uncollected() -> Iterator[None]:
    """Inside, Python does not look for cycles of garbage: every node lives as long as its tape, and they are many."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


class Tape:
    """The steps written so far, each distinct one once, up to a number of them.

    A full tape records no more: every new step is the number 0 from then on. TapeFullError is raised by `program`, and
    between the terms of series, but never by an operator: NumPy's products of object arrays with batch axes go on
    calling operators after one of them has raised, which ends in a SystemError.
    """

    def __init__(self, most: float = inf) -> None:
        self.most, self.full = most, False
        self.nodes: list[Node] = []
        self.inputs = 0
        self._written: dict[tuple[Any, ...], Node] = {}
        self._numbers: dict[Any, Node] = {}
        self.zero, self.one = self.node(0), self.node(1)

    def variables(self, *shape: int) -> np.ndarray:
        """An array of new inputs."""
        nodes = np.empty(shape, dtype=object)
        for index in np.ndindex(*shape):
            nodes[index] = self.write("input", value=float(self.inputs))
            self.inputs += 1
        return nodes

    def write(self, kind: str, *operands: int, value: float = 0.0) -> Node:
        """Return the node of a step, which is recorded if it is new."""
        key = (kind, operands, value)
        node = self._written.get(key)
        if node is None:
            if self.full or len(self.nodes) >= self.most:
                self.full = True
                return self.zero
            node = self._written[key] = Node(self, len(self.nodes), kind, operands, value)
            self.nodes.append(node)
        return node

    def node(self, x: Any) -> Node:
        """Convert a number to a node; a node is returned unchanged."""
        if x.__class__ is Node:
            return x
        node = self._numbers.get(x)
        if node is None:
            node = self._numbers[x] = self.write("constant", value=float(x) + 0.0)  # no -0.0
        return node

    def subtract(self, x: Node, y: Node) -> Node:
        """x - y."""
        if x is y:
            return self.zero
        turned = self._written.get(("sub", (y.i, x.i), 0.0))  # y - x is known: x - y is its negative
        return self.write("sub", x.i, y.i) if turned is None else -turned

    def function(self, kind: str, x: Node) -> Node:
        """An operation of one operand."""
        if x.kind == "constant":
            return self.node(operations.OPERATIONS[kind].value(x.value))
        if x.kind == kind and operations.OPERATIONS[kind].involution:
            return self.nodes[x.operands[0]]
        if kind == "inv" and x.kind == "neg":
            return -self.function(kind, -x)
        return self.write(kind, x.i)

    def check(self) -> None:
        """Raise TapeFullError if the tape could not hold all steps."""
        if self.full:
            raise TapeFullError

    def program(self, outputs: Sequence[Any]) -> Program:
        """Return the program of the outputs, the steps of the tape that they need; `TapeFullError` if it is full."""
        self.check()
        return prune(self.nodes, [self.node(x).i for x in outputs], self.inputs)
