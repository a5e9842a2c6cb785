"""Tracing: mathematics run on scalars that write down what is done with them.

Equal expressions are one node (hash-consing), sums and products have one order, signs stay outside, and what 0, 1 and
-1 make trivial is never written down.
"""

from collections.abc import Callable, Sequence
from math import inf
from typing import Any

import numpy as np

from jounce.program.operations import FUNCTIONS, OPERATIONS
from jounce.program.program import Program, Step, prune


class Node:
    """A scalar of a trace: the number of a step on its tape."""

    __slots__ = ("i", "tape")

    def __init__(self, tape: "Tape", i: int) -> None:
        self.tape, self.i = tape, i

    def __add__(self, other: Any) -> "Node":
        return self.tape.add(self, self.tape.node(other))

    def __sub__(self, other: Any) -> "Node":
        return self.tape.add(self, -self.tape.node(other))

    def __rsub__(self, other: Any) -> "Node":
        return self.tape.add(self.tape.node(other), -self)

    def __neg__(self) -> "Node":
        return self.tape.function("neg", self)

    def __mul__(self, other: Any) -> "Node":
        return self.tape.multiply(self, self.tape.node(other))

    __radd__, __rmul__ = __add__, __mul__

    def __truediv__(self, other: Any) -> "Node":
        return self * self.tape.function("inv", self.tape.node(other))

    def __rtruediv__(self, other: Any) -> "Node":
        return self.tape.node(other) / self

    def __getattr__(self, name: str) -> Callable[[], "Node"]:
        """The functions of one operand as NumPy's object arrays ask for them: x.sin()."""
        if name not in FUNCTIONS:
            raise AttributeError(f"a node of a tape has no {name}")
        return lambda: self.tape.function(name, self)

    @property
    def step(self) -> Step:
        """What the node stands for."""
        return self.tape.steps[self.i]


class TapeFullError(Exception):
    """A trace has more steps than its tape may hold."""


class Tape:
    """The steps written so far, each distinct one once, up to a number of them."""

    def __init__(self, most: float = inf) -> None:
        self.most = most
        self.steps: list[Step] = []
        self.nodes: dict[tuple[Any, ...], Node] = {}
        self.inputs = 0

    def variables(self, *shape: int) -> np.ndarray:
        """An array of new inputs."""
        nodes = np.empty(shape, dtype=object)
        for index in np.ndindex(*shape):
            nodes[index] = self.write("input", value=float(self.inputs))
            self.inputs += 1
        return nodes

    def write(self, kind: str, *operands: int, value: float = 0.0) -> Node:
        """The node of a step, written down when it is new."""
        key = (kind, operands, value)
        node = self.nodes.get(key)
        if node is None:
            if len(self.steps) >= self.most:
                raise TapeFullError
            node = self.nodes[key] = Node(self, len(self.steps))
            self.steps.append(Step(kind, operands, value))
        return node

    def known(self, i: int) -> Node:
        """The node of a step by its number: one step is one node, so that nodes can be compared by identity."""
        step = self.steps[i]
        return self.nodes[step.kind, step.operands, step.value]

    def node(self, x: Any) -> Node:
        """A number as a node; a node is one already."""
        return x if isinstance(x, Node) else self.write("constant", value=float(x) + 0.0)  # no -0.0

    def add(self, x: Node, y: Node) -> Node:
        """x + y."""
        for one, other in ((x, y), (y, x)):
            if _is(one, 0):
                return other
        if x.step.kind == y.step.kind == "constant":
            return self.node(x.step.value + y.step.value)
        minus_x, minus_y = x.step.kind == "neg", y.step.kind == "neg"
        if minus_x and minus_y:
            return -self.add(-x, -y)
        if minus_y:
            return self._subtract(x, -y)
        if minus_x:
            return self._subtract(y, -x)
        return self.write("add", *sorted((x.i, y.i)))

    def _subtract(self, x: Node, y: Node) -> Node:
        if x is y:
            return self.node(0)
        turned = self.nodes.get(("sub", (y.i, x.i), 0.0))  # y - x is known: x - y is its negative
        return self.write("sub", x.i, y.i) if turned is None else -turned

    def function(self, kind: str, x: Node) -> Node:
        """An operation of one operand."""
        operation = OPERATIONS[kind]
        if x.step.kind == "constant":
            return self.node(operation.value(x.step.value))
        if operation.involution and x.step.kind == kind:
            return self.known(x.step.operands[0])
        if kind == "inv" and x.step.kind == "neg":
            return -self.function(kind, -x)
        return self.write(kind, x.i)

    def multiply(self, x: Node, y: Node) -> Node:
        """x y."""
        if x.step.kind == "constant" and y.step.kind == "constant":
            return self.node(x.step.value * y.step.value)
        for one, other in ((x, y), (y, x)):
            if _is(one, 0):
                return self.node(0)
            if _is(one, 1):
                return other
            if one.step.kind == "neg":
                return -self.multiply(-one, other)
            if one.step.kind == "constant" and one.step.value < 0:
                return -self.multiply(-one, other)
            if one.step.kind == "constant" and other.step.kind == "mul":
                for inner, rest in (other.step.operands, other.step.operands[::-1]):
                    if self.steps[inner].kind == "constant":
                        return self.known(rest) * (one.step.value * self.steps[inner].value)
        return self.write("mul", *sorted((x.i, y.i)))

    def program(self, outputs: Sequence[Any]) -> Program:
        """What the outputs need of the tape."""
        roots = [self.node(x).i for x in outputs]
        return prune(self.steps, roots, self.inputs)


def _is(x: Node, value: float) -> bool:
    return x.step.kind == "constant" and x.step.value == value
