"""A tracing scalar in fifty lines: records the operations of a program, each distinct one once."""

from __future__ import annotations

import math
from typing import Any


class Tape:
    """All nodes of one program; equal expressions are the same node."""

    def __init__(self) -> None:
        self.nodes: dict[tuple[Any, ...], Node] = {}

    def variable(self, name: str) -> Node:
        return self.node("var", name)

    def node(self, *key: Any) -> Node:
        return self.nodes.setdefault(key, Node(self, key))

    def wrap(self, x: Any) -> Node:
        return x if isinstance(x, Node) else self.node("const", float(x))


class Node:
    """A scalar of the program: folds 0, 1 and -1, keeps signs outside, multiplies and adds in one order."""

    __slots__ = ("key", "tape")

    def __init__(self, tape: Tape, key: tuple[Any, ...]) -> None:
        self.tape, self.key = tape, key

    @property
    def constant(self) -> float | None:
        return self.key[1] if self.key[0] == "const" else None

    def __add__(self, other: Any) -> Node:
        other = self.tape.wrap(other)
        if self.constant == 0:
            return other
        if other.constant == 0:
            return self
        if self.constant is not None and other.constant is not None:
            return self.tape.wrap(self.constant + other.constant)
        if self.key[0] == other.key[0] == "neg":
            return -(self.key[1] + other.key[1])
        if other.key[0] == "neg":
            return self._minus(other.key[1])
        if self.key[0] == "neg":
            return other._minus(self.key[1])
        return self.tape.node("add", *sorted((self, other), key=id))

    def _minus(self, other: Node) -> Node:
        if self is other:
            return self.tape.wrap(0)
        turned = self.tape.nodes.get(("sub", other, self))  # keep signs outside: y - x known, x - y is its negative
        return self.tape.node("sub", self, other) if turned is None else -turned

    def __neg__(self) -> Node:
        if self.constant is not None:
            return self.tape.wrap(-self.constant)
        if self.key[0] == "neg":
            return self.key[1]
        return self.tape.node("neg", self)

    def __mul__(self, other: Any) -> Node:
        other = self.tape.wrap(other)
        for one, two in ((self, other), (other, self)):
            if one.constant is not None:
                if two.constant is not None:
                    return self.tape.wrap(one.constant * two.constant)
                if one.constant in (0, 1, -1):
                    return {0: self.tape.wrap(0), 1: two}[one.constant] if one.constant >= 0 else -two
                if one.constant < 0:
                    return -(two * -one.constant)
            if one.key[0] == "neg":
                return -(one.key[1] * two)
        return self.tape.node("mul", *sorted((self, other), key=id))

    __radd__, __rmul__ = __add__, __mul__

    def __sub__(self, other: Any) -> Node:
        return self + -self.tape.wrap(other)

    def __rsub__(self, other: Any) -> Node:
        return self.tape.wrap(other) + -self

    def sin(self) -> Node:
        return self.tape.node("sin", self)

    def cos(self) -> Node:
        return self.tape.node("cos", self)


OPERATIONS = {
    "add": lambda x, y: x + y,
    "sub": lambda x, y: x - y,
    "mul": lambda x, y: x * y,
    "neg": lambda x: -x,
    "sin": math.sin,
    "cos": math.cos,
}


def program(outputs: list[Node]) -> list[Node]:
    """The nodes that the outputs need, operands first."""
    order: dict[Node, None] = {}
    stack = list(reversed(outputs))
    while stack:
        node = stack[-1]
        operands = [x for x in node.key[1:] if isinstance(x, Node) and x not in order]
        if operands:
            stack.extend(operands)
        else:
            order[stack.pop()] = None
    return list(order)


def run(outputs: list[Node], values: dict[str, float]) -> list[float]:
    """The outputs' values for given variables."""
    results: dict[Node, float] = {}
    for node in program(outputs):
        kind, *operands = node.key
        if kind == "var":
            results[node] = values[operands[0]]
        elif kind == "const":
            results[node] = operands[0]
        else:
            results[node] = OPERATIONS[kind](*(results[x] for x in operands))
    return [results[x] for x in outputs]
