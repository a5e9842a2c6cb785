"""Programs: scalar operations in an order in which they can be done, from inputs to outputs."""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from heapq import heappop, heappush
from typing import Any, NamedTuple

from jounce.program.operations import FREE_KINDS, OPERATIONS


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
        return sum(count for kind, count in self.counts().items() if kind not in FREE_KINDS)

    def run(self, inputs: Sequence[float]) -> list[float]:
        """Compute the outputs for given inputs: the reference for native code."""
        values: list[float] = []
        for step in self.steps:
            if step.kind == "input":
                values.append(inputs[int(step.value)])
            elif step.kind == "constant":
                values.append(step.value)
            else:
                values.append(OPERATIONS[step.kind].value(*(values[i] for i in step.operands)))
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
