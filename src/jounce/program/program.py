"""A program holds scalar operations in their order; a tape records it.

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
    """An operation on earlier steps, a constant, or an input.

    `value` is the constant, or the number of the input.
    """

    kind: str
    operands: tuple[int, ...] = ()
    value: float = 0.0


@dataclass(frozen=True)
class Program:
    """Steps, each of which takes earlier ones, and the outputs."""

    steps: tuple[Step, ...]
    outputs: tuple[int, ...]
    inputs: int  # how many there are, used or not

    def counts(self) -> Counter[str]:
        """Return the number of operations of each kind."""
        return Counter(step.kind for step in self.steps)

    @property
    def operations(self) -> int:
        """The number of operations on scalars; signs, inputs and constants are free."""
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
        """Return the number of uses of each step.

        A use is by another step or as an output.
        """
        return Counter([*(i for step in self.steps for i in step.operands), *self.outputs])


def prune(steps: Sequence[Any], outputs: Sequence[int], inputs: int) -> Program:
    """Return the program of the steps that the outputs need.

    Steps may be nodes of a tape.
    """
    # From the last step to the first: operands come before the steps that take them, so that one pass marks all.
    needed = set(outputs)
    for i in range(len(steps) - 1, -1, -1):
        if i in needed:
            needed.update(steps[i].operands)
    # The order stays, and steps are numbered again without gaps.
    order = sorted(needed)
    place = {old: new for new, old in enumerate(order)}
    needed_steps = [steps[i] for i in order]
    numbered = [Step(step.kind, tuple([place[j] for j in step.operands]), step.value) for step in needed_steps]
    return Program(tuple(numbered), tuple([place[i] for i in outputs]), inputs)


def topological_order(roots: Sequence[int], operands: Callable[[int], Sequence[int]]) -> list[int]:
    """Return all nodes that the roots need, operands first, each once.

    The order is depth first, in the order of the roots.
    """
    # A node is pushed twice: first as i, to push its operands, then as ~i < 0, to be listed when these are done. An
    # explicit stack takes the place of recursion, since programs are thousands of steps deep.
    order: list[int] = []
    seen: set[int] = set()
    stack = [*reversed(roots)]
    while stack:
        i = stack.pop()
        if i < 0:
            order.append(~i)
        elif i not in seen:
            seen.add(i)
            stack.append(~i)
            stack.extend(reversed(operands(i)))
    return order


def reuse_places(spans: Iterable[tuple[int, int]]) -> list[int]:
    """Assign places to values that are kept for a time.

    Each value has a first and a last time. The values come in the order of their first times. This is linear-scan
    register allocation without spilling: the lowest free place, or a new one without any. No other assignment needs
    fewer places.
    """
    # Two heaps: free places, the lowest first, and places in use with the last time of their values, the earliest
    # first.
    places, free, in_use, count = list[int](), list[int](), list[tuple[int, int]](), 0
    for first, last in spans:
        while len(in_use) > 0 and in_use[0][0] < first:
            heappush(free, heappop(in_use)[1])
        if len(free) == 0:
            free, count = [count], count + 1
        places.append(heappop(free))
        heappush(in_use, (last, places[-1]))
    return places


# Tracing: scalars that record the operations on them.
class Node(Recorder):
    """A scalar of a trace: a step on its tape, and its number there.

    Most operations on dense matrices are trivial, times 0 and plus 0: these are tested first. Operators run once for
    each scalar operation of a trace, up to millions of times, so that they compare identities before anything else.
    """

    __slots__ = ("i", "kind", "operands", "opposite", "tape", "value")

    def __init__(self, tape: "Tape", i: int, kind: str, operands: tuple[int, ...], value: float) -> None:
        self.tape, self.i, self.kind, self.operands, self.value = tape, i, kind, operands, value
        self.opposite: Node | None = None  # -x, from the first negation on

    def __add__(self, other: Any) -> "Node":
        x, y, tape = self, other, self.tape
        zero = tape.zero
        # x + 0 = x, also for a number 0 that is no node yet; every node is true.
        if y is zero or not y:
            return x
        if y.__class__ is not Node:
            y = tape.node(y)
        if x is zero:
            return y
        if x.kind == y.kind == "constant":
            return tape.node(x.value + y.value)
        # Signs stay outside: (-a) + (-b) = -(a + b), and x + (-y) = x - y. The negative operand comes second.
        if x.kind == "neg":
            x, y = y, x
        if y.kind == "neg":
            return -(-x + -y) if x.kind == "neg" else tape.subtract(x, -y)
        # a + b and b + a are one node: the operand that was written first comes first.
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
        # 0 y = 0 and 1 y = y.
        if x is zero or y is zero or not y:
            return zero
        if y.__class__ is not Node:
            y = tape.node(y)
        one = tape.one
        if x is one:
            return y
        if y is one:
            return x
        # A constant comes first.
        if y.kind == "constant":
            if x.kind == "constant":
                return tape.node(x.value * y.value)
            x, y = y, x
        # Signs stay outside, so that x y and (-x) y share their product.
        if x.kind == "neg" or (x.kind == "constant" and x.value < 0):
            return -(-x * y)
        if y.kind == "neg":
            return -(x * -y)
        # c (d z) = (c d) z: products hold one constant at most.
        if x.kind == "constant" and y.kind == "mul":
            for i, other_i in (y.operands, y.operands[::-1]):
                factor = tape.nodes[i]
                if factor.kind == "constant":
                    return tape.nodes[other_i] * (x.value * factor.value)
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
        """Return tanh(x) cosh(x), which keeps its digits near 0."""
        return self.tape.function("tanh", self) * self.cosh()

    def cosh(self) -> "Node":
        """Return the mean of exp(x) and exp(-x)."""
        e = self.tape.function("exp", self)
        return (e + 1 / e) * 0.5

    def check_recording(self) -> None:
        """Raise TapeFullError if the tape is full."""
        self.tape.check()


def _method(kind: str) -> Callable[[Node], Node]:
    """Return the method that records a function of one operand."""
    return lambda x: x.tape.function(kind, x)


# NumPy calls a method of each entry of an object array: np.sin(x) is x.sin().
for kind in operations.FUNCTION_KINDS:
    setattr(Node, kind, _method(kind))


class TapeFullError(Exception):
    """A trace has more steps than its tape may hold."""


@contextmanager
def interruptible() -> Iterator[None]:
    """Raise KeyboardInterrupt for Ctrl-C within this context.

    NumPy's loops over nodes go on after Ctrl-C and end in a SystemError.
    """
    try:
        yield
    except SystemError as error:
        # The interrupt may be a cause of a cause.
        cause: BaseException | None = error
        while cause is not None and not isinstance(cause, KeyboardInterrupt):
            cause = cause.__cause__ or cause.__context__
        if cause is None:
            raise
        raise KeyboardInterrupt from None


@contextmanager
def uncollected() -> Iterator[None]:
    """Keep Python from collecting cycles of garbage within this context.

    Nodes are many, and every one lives as long as its tape.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


class Tape:
    """The distinct steps that are written so far.

    Their number is limited. A full tape records no more: every new step is the number 0 from then on. TapeFullError is
    raised by `program`, and between the terms of series, but never by an operator: NumPy's products of object arrays
    with batch axes go on calling operators after one of them has raised, which ends in a SystemError.
    """

    def __init__(self, most: float = inf) -> None:
        self.most, self.full = most, False
        self.nodes: list[Node] = []
        self.inputs = 0
        self._written: dict[tuple[Any, ...], Node] = {}  # by kind, operands and value: equal steps are one node
        self._numbers: dict[Any, Node] = {}  # by the number as it came, of any type
        self.zero, self.one = self.node(0), self.node(1)

    def variables(self, *shape: int) -> np.ndarray:
        """Return an array of new inputs."""
        nodes = np.empty(shape, dtype=object)
        for index in np.ndindex(*shape):
            nodes[index] = self.write("input", value=float(self.inputs))
            self.inputs += 1
        return nodes

    def write(self, kind: str, *operands: int, value: float = 0.0) -> Node:
        """Return the node of a step, recorded if it is new."""
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
        """Return x - y."""
        if x is y:
            return self.zero
        # Where y - x is written already, x - y is its negative.
        reversed_difference = self._written.get(("sub", (y.i, x.i), 0.0))
        return self.write("sub", x.i, y.i) if reversed_difference is None else -reversed_difference

    def function(self, kind: str, x: Node) -> Node:
        """Return the node of an operation of one operand."""
        if x.kind == "constant":
            return self.node(operations.OPERATIONS[kind].value(x.value))
        # -(-x) = x and 1 / (1 / x) = x.
        if x.kind == kind and operations.OPERATIONS[kind].involution:
            return self.nodes[x.operands[0]]
        # 1 / (-x) = -(1 / x): signs stay outside.
        if kind == "inv" and x.kind == "neg":
            return -self.function(kind, -x)
        return self.write(kind, x.i)

    def check(self) -> None:
        """Raise TapeFullError if the tape could not hold all steps."""
        if self.full:
            raise TapeFullError

    def program(self, outputs: Sequence[Any]) -> Program:
        """Return the program of the steps that the outputs need.

        Raises `TapeFullError` if the tape is full.
        """
        self.check()
        return prune(self.nodes, [self.node(x).i for x in outputs], self.inputs)
