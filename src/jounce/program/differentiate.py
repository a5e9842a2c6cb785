"""Derivatives of programs by reverse and forward accumulation, written on the tape of the values.

Both multiply the partial derivatives of operations along all ways from inputs to outputs. Reverse accumulation begins
at the outputs: all derivatives of one weighted sum of them take about three times the operations of the values, however
many inputs there are. Forward accumulation begins at the inputs: the derivatives of all outputs along one direction.
Weights and directions are nodes or numbers; what is multiplied by the number 0 or 1 writes no step.

Invariants: a product is a program itself, in which values and partial derivatives share steps; it is exact but for
rounding. It fails where the tape is full, with TapeFullError when the program is taken from it; where an operation has
no derivative, as sqrt at 0, results are inf or NaN.

[1] A. Griewank, A. Walther, Evaluating Derivatives, 2nd ed., SIAM 2008, chapter 3.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf, prod
from typing import Any

import numpy as np

from jounce.program import operations
from jounce.program.passes import factor
from jounce.program.program import Node, Program, Step, Tape


@dataclass(frozen=True, eq=False)
class Followers:
    """The inputs of a program that follow others along a motion.

    From `start` on they are the last inputs. Their rates are the outputs of `rates`, of all inputs and of the rates of
    those that they follow, which are the inputs from `leader` on.
    """

    start: int
    leader: int
    rates: Program


@dataclass(frozen=True, eq=False)
class DisplacedInputs:
    """Inputs of a program that are changed by displacements, of which there are fewer: a pose, a quaternion.

    From `start` on they are as many as `shape` has entries; `change` makes a change of them, linear in a displacement.
    """

    start: int
    shape: tuple[int, ...]
    directions: int
    change: Callable[[np.ndarray, np.ndarray], np.ndarray]

    @property
    def own(self) -> slice:
        """Their places among the inputs."""
        return slice(self.start, self.start + prod(self.shape))

    def change_entries(self, inputs: np.ndarray, directions: Any) -> np.ndarray:
        """The changes of all entries by a displacement."""
        return self.change(inputs[self.own].reshape(self.shape), np.array(directions)).ravel()


@dataclass(frozen=True, eq=False)
class FreeInputs:
    """What derivatives are by: all inputs but for the first ones, as many as are `parameters`, which are constants.

    Derivatives by those that are `displaced` are by their displacements. There is no derivative by `followers`: what
    follows through them is in that by their leaders.
    """

    parameters: int = 0
    displaced: Sequence[DisplacedInputs] = ()
    followers: Followers | None = None

    def directions(self, inputs: int) -> int:
        """How many there are, of a program with that number of inputs."""
        end = self.followers.start if self.followers else inputs
        return end - self.parameters - sum(prod(x.shape) - x.directions for x in self.displaced)

    def groups(self, count: int) -> list[int]:
        """A number for each direction, equal where they are of the same displaced input: these do not commute."""
        groups, fewer = list(range(count)), self.parameters
        for x in sorted(self.displaced, key=lambda x: x.start):
            first = x.start - fewer
            groups[first : first + x.directions] = [first] * x.directions
            fewer += prod(x.shape) - x.directions
        return groups

    def changes(self, tape: Tape, inputs: np.ndarray, directions: Sequence[Any]) -> list[Any]:
        """The changes of all inputs along a direction."""
        changes = [*[0] * self.parameters, *directions]
        for x in sorted(self.displaced, key=lambda x: x.start):
            own = slice(x.start, x.start + x.directions)
            changes[own] = x.change_entries(inputs, changes[own])
        if self.followers:
            led = changes[self.followers.leader :][: self.followers.rates.inputs - len(inputs)]
            changes += evaluate(self.followers.rates, tape, [*inputs, *led]).outputs
        return changes

    def gradient(self, tape: Tape, inputs: np.ndarray, by_inputs: Sequence[Node]) -> list[Node]:
        """The derivatives along all directions, of what has derivatives by all inputs: the transpose of `changes`."""
        gradient = [*by_inputs]
        if led := self.followers:
            count = led.rates.inputs - len(inputs)
            rates = evaluate(led.rates, tape, [*inputs, *[0] * count])  # linear in the rates of their leaders
            for j, more in enumerate(adjoints(rates, gradient[led.start :])[len(inputs) :], led.leader):
                gradient[j] = gradient[j] + more
            del gradient[led.start :]
        for x in sorted(self.displaced, key=lambda x: x.start, reverse=True):
            changes = [x.change_entries(inputs, unit) for unit in np.eye(x.directions, dtype=int)]
            gradient[x.own] = np.array(changes, dtype=object) @ np.array(gradient[x.own], dtype=object)
        return gradient[self.parameters :]


ALL_INPUTS = FreeInputs()


@dataclass(frozen=True, eq=False)
class Evaluation:
    """A program written on a tape: the node of each of its steps."""

    program: Program
    tape: Tape
    nodes: Sequence[Node]

    @property
    def outputs(self) -> list[Node]:
        """The nodes of the outputs."""
        return [self.nodes[i] for i in self.program.outputs]

    def partials(self, step: Step) -> list[tuple[int, Any]]:
        """The operands of a step that are not constants, and the partial derivative of its value by each."""
        derivatives = operations.OPERATIONS[step.kind].partials(*(self.nodes[j] for j in step.operands))
        both = zip(step.operands, derivatives, strict=True)
        return [(j, partial) for j, partial in both if self.program.steps[j].kind != "constant"]


def evaluate(program: Program, tape: Tape, inputs: Sequence[Any]) -> Evaluation:
    """Write a program on a tape, with these nodes or numbers as inputs; what the tape holds already is shared."""
    nodes: list[Node] = []
    for step in program.steps:
        operands = [nodes[j] for j in step.operands]
        if step.kind == "input":
            node = inputs[int(step.value)]
        elif step.kind == "constant":
            node = step.value
        elif len(operands) == 1:
            node = tape.function(step.kind, *operands)
        else:  # sums and products, which nodes add up and multiply as numbers do
            node = operations.OPERATIONS[step.kind].value(*operands)
        nodes.append(tape.node(node))
    return Evaluation(program, tape, nodes)


def adjoints(evaluation: Evaluation, weights: Sequence[Any]) -> list[Node]:
    """Return the derivatives of sum(weight * output) by every input: reverse accumulation."""
    program, tape = evaluation.program, evaluation.tape
    zero = tape.node(0)
    sums, gradient = [zero] * len(program.steps), [zero] * program.inputs
    # Seeds: the derivative of the sum by each output is its weight.
    for i, weight in zip(program.outputs, weights, strict=True):
        sums[i] = sums[i] + weight
    # From the last step to the first, by when all that use a step have been added to its sum.
    for i in reversed(range(len(sums))):
        step, total = program.steps[i], sums[i]
        if step.kind == "input":
            gradient[int(step.value)] += total
        elif step.operands and total is not zero:
            for j, partial in evaluation.partials(step):
                sums[j] = sums[j] + total * partial
    return gradient


def tangents(evaluation: Evaluation, directions: Sequence[Any]) -> list[Node]:
    """Return the derivatives of every output along sum(direction * d/d input): forward accumulation."""
    tape = evaluation.tape
    zero, made = tape.node(0), list[Node]()
    for step in evaluation.program.steps:
        total = tape.node(directions[int(step.value)]) if step.kind == "input" else zero
        if any(made[j] is not zero for j in step.operands):
            for j, partial in evaluation.partials(step):
                total = total + made[j] * partial
        made.append(total)
    return [made[i] for i in evaluation.program.outputs]


def vjp(program: Program, free: FreeInputs = ALL_INPUTS, most: float = inf) -> Program:
    """The vector-Jacobian product: after the inputs it takes a weight for each output, and gives J^T weights.

    Derivatives are by those inputs that are `free`. The tape holds up to `most` steps.
    """
    tape = Tape(most)
    inputs = tape.variables(program.inputs)
    gradient = adjoints(evaluate(program, tape, [*inputs]), [*tape.variables(len(program.outputs))])
    return factor(tape.program(free.gradient(tape, inputs, gradient)))


def jvp(program: Program, free: FreeInputs = ALL_INPUTS, most: float = inf) -> Program:
    """The Jacobian-vector product: after the inputs it takes a direction for each that is `free`; J directions."""
    return _derive_along(program, program.inputs, free, most)


def hvp(program: Program, free: FreeInputs = ALL_INPUTS, most: float = inf) -> Program:
    """The derivatives of `vjp` along one direction, which follows the weights: forward over reverse accumulation."""
    return _derive_along(vjp(program, free, most), program.inputs, free, most)


def jjvp(program: Program, free: FreeInputs = ALL_INPUTS, most: float = inf) -> Program:
    """The derivatives of `jvp` along a second direction, which follows the first: forward over forward accumulation."""
    return _derive_along(jvp(program, free, most), program.inputs, free, most)


def hessian(program: Program, free: FreeInputs = ALL_INPUTS, most: float = inf) -> Program:
    """The derivatives of `vjp` along all directions, row by row: entry (i, j) is that of gradient i along j.

    What all directions share is computed once. Directions commute but for those of one of the `displaced` inputs:
    other entries right of the diagonal, which take twice the operations, are those on its other side.
    """
    tape = Tape(most)
    gradient, count = vjp(program, free, most), free.directions(program.inputs)
    given = tape.variables(gradient.inputs)
    evaluation, inputs = evaluate(gradient, tape, [*given]), given[: program.inputs]
    constant = [0] * (gradient.inputs - program.inputs)
    rows = [
        tangents(evaluation, [*free.changes(tape, inputs, unit), *constant])
        for unit in np.eye(count, dtype=int).tolist()
    ]
    group = free.groups(count)
    order = [(i, j) if i >= j or group[i] == group[j] else (j, i) for i in range(count) for j in range(count)]
    return factor(tape.program([rows[j][i] for i, j in order]))


def _derive_along(program: Program, count: int, free: FreeInputs, most: float) -> Program:
    """The derivatives of a program along a direction of its first `count` inputs, which follows all of its inputs."""
    tape = Tape(most)
    given = tape.variables(program.inputs)
    inputs, constant = given[:count], [0] * (program.inputs - count)
    evaluation = evaluate(program, tape, [*given])
    changes = free.changes(tape, inputs, [*tape.variables(free.directions(count))])
    return factor(tape.program(tangents(evaluation, [*changes, *constant])))


PRODUCTS = {"vjp": vjp, "jvp": jvp, "hvp": hvp, "jjvp": jjvp, "hessian": hessian}
