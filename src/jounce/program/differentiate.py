"""Differentiate programs by reverse and forward accumulation.

Derivatives are written on the tape of the values.

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
    """Inputs of a program that displacements change: a pose, a quaternion.

    From `start` on they are as many as `shape` has entries. Displacements have fewer components, `directions` of them;
    `change` makes a change of the inputs, linear in a displacement.
    """

    start: int
    shape: tuple[int, ...]
    directions: int
    change: Callable[[np.ndarray, np.ndarray], np.ndarray]

    @property
    def places(self) -> slice:
        """The places of the entries among the inputs."""
        return slice(self.start, self.start + prod(self.shape))

    def change_entries(self, inputs: np.ndarray, directions: Any) -> np.ndarray:
        """Return the changes of all entries by a displacement."""
        return self.change(inputs[self.places].reshape(self.shape), np.array(directions)).ravel()


@dataclass(frozen=True, eq=False)
class FreeInputs:
    """The inputs that derivatives are by: all but the first ones, the `parameters`.

    Derivatives by `displaced` inputs are by the components of their displacements. There is no derivative by
    `followers`: what changes through them is part of the derivative by their leaders.
    """

    parameters: int = 0
    displaced: Sequence[DisplacedInputs] = ()
    followers: Followers | None = None

    def directions(self, inputs: int) -> int:
        """Return the number of directions of a program."""
        end = inputs if self.followers is None else self.followers.start
        return end - self.parameters - sum(prod(x.shape) - x.directions for x in self.displaced)

    def groups(self, count: int) -> list[int]:
        """Return a number for each direction, equal within displaced inputs.

        Derivatives along directions of one group do not commute.
        """
        # The number of an input exceeds that of its direction by the parameters, and by the entries of displaced
        # inputs before it that have no direction.
        groups, offset = list(range(count)), self.parameters
        for x in sorted(self.displaced, key=lambda x: x.start):
            first = x.start - offset
            groups[first : first + x.directions] = [first] * x.directions
            offset += prod(x.shape) - x.directions
        return groups

    def changes(self, tape: Tape, inputs: np.ndarray, directions: Sequence[Any]) -> list[Any]:
        """Return the changes of all inputs along a direction."""
        # Parameters do not change; all other inputs change by their own component of the direction.
        changes = [*[0] * self.parameters, *directions]
        # From the first displaced input on, the components of a displacement give way to the changes of its entries,
        # which are more: the inputs behind it move to their own places.
        for x in sorted(self.displaced, key=lambda x: x.start):
            components = slice(x.start, x.start + x.directions)
            changes[components] = x.change_entries(inputs, changes[components])
        # Followers are the last inputs. Their changes are rates, linear in those of their leaders.
        followers = self.followers
        if followers is not None:
            count = followers.rates.inputs - len(inputs)
            leader_changes = changes[followers.leader : followers.leader + count]
            changes += evaluate(followers.rates, tape, [*inputs, *leader_changes]).outputs
        return changes

    def gradient(self, tape: Tape, inputs: np.ndarray, by_inputs: Sequence[Node]) -> list[Node]:
        """Return the derivatives along all directions, from the derivatives by all inputs.

        This is the transpose of `changes`, and its steps come in the reverse order.
        """
        gradient = [*by_inputs]
        # Derivatives by followers are added to those by their leaders. The rates of followers are linear in the rates
        # of leaders, so that their adjoints are the same at any rates, 0 among them.
        followers = self.followers
        if followers is not None:
            count = followers.rates.inputs - len(inputs)
            rates = evaluate(followers.rates, tape, [*inputs, *[0] * count])
            by_leaders = adjoints(rates, gradient[followers.start :])[len(inputs) :]
            for j, term in enumerate(by_leaders, followers.leader):
                gradient[j] = gradient[j] + term
            del gradient[followers.start :]
        # From the last displaced input to the first, so that the places of those before it are still right:
        # rows (directions, entries) of changes by unit displacements, times the derivatives by the entries.
        for x in sorted(self.displaced, key=lambda x: x.start, reverse=True):
            changes = [x.change_entries(inputs, unit) for unit in np.eye(x.directions, dtype=int)]
            gradient[x.places] = np.array(changes, dtype=object) @ np.array(gradient[x.places], dtype=object)
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
        """Return the operands of a step with its partial derivatives.

        Constant operands are left out.
        """
        derivatives = operations.OPERATIONS[step.kind].partials(*(self.nodes[j] for j in step.operands))
        pairs = zip(step.operands, derivatives, strict=True)
        return [(j, partial) for j, partial in pairs if self.program.steps[j].kind != "constant"]


def evaluate(program: Program, tape: Tape, inputs: Sequence[Any]) -> Evaluation:
    """Write a program on a tape, with nodes or numbers as inputs.

    Steps that the tape holds already are shared.
    """
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
    # sums[i] is the adjoint of step i: the derivative of the weighted sum by the value of that step.
    sums, gradient = [zero] * len(program.steps), [zero] * program.inputs
    # Seeds: the derivative of the sum by each output is its weight.
    for i, weight in zip(program.outputs, weights, strict=True):
        sums[i] = sums[i] + weight
    # From the last step to the first: when a step is reached, all steps that use it have added to its sum. Steps that
    # no output depends on keep the adjoint 0, and write nothing.
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
    zero, changes = tape.node(0), list[Node]()
    # changes[i] is the tangent of step i: its derivative along the direction.
    for step in evaluation.program.steps:
        total = tape.node(directions[int(step.value)]) if step.kind == "input" else zero
        # Partial derivatives write steps of their own, so that they are left out where no operand changes.
        if any(changes[j] is not zero for j in step.operands):
            for j, partial in evaluation.partials(step):
                total = total + changes[j] * partial
        changes.append(total)
    return [changes[i] for i in evaluation.program.outputs]


def vjp(program: Program, free: FreeInputs = ALL_INPUTS, most: float = inf) -> Program:
    """Return the program of the vector-Jacobian product J^T w.

    After the inputs it takes a weight for each output. Derivatives are by those inputs that are `free`. The tape holds
    up to `most` steps.
    """
    # Weights are inputs like any other: the product is a program of both.
    tape = Tape(most)
    inputs = tape.variables(program.inputs)
    gradient = adjoints(evaluate(program, tape, [*inputs]), [*tape.variables(len(program.outputs))])
    return factor(tape.program(free.gradient(tape, inputs, gradient)))


def jvp(program: Program, free: FreeInputs = ALL_INPUTS, most: float = inf) -> Program:
    """Return the program of the Jacobian-vector product J d.

    After the inputs it takes a direction, with a component for each input that is `free`.
    """
    return _derive_along(program, program.inputs, free, most)


def hvp(program: Program, free: FreeInputs = ALL_INPUTS, most: float = inf) -> Program:
    """Return the program of the derivatives of `vjp` along a direction.

    The direction follows the weights. This is forward over reverse accumulation.
    """
    return _derive_along(vjp(program, free, most), program.inputs, free, most)


def jjvp(program: Program, free: FreeInputs = ALL_INPUTS, most: float = inf) -> Program:
    """Return the program of the derivatives of `jvp` along a second direction.

    The second direction follows the first. This is forward over forward accumulation.
    """
    return _derive_along(jvp(program, free, most), program.inputs, free, most)


def hessian(program: Program, free: FreeInputs = ALL_INPUTS, most: float = inf) -> Program:
    """Return the program of the derivatives of `vjp` along all directions.

    Entry (i, j), row by row, is the derivative of component i of the gradient along direction j. What all directions
    share is computed once.
    """
    # The gradient is written once on the tape, with inputs and weights; weights do not change along a direction.
    tape = Tape(most)
    gradient, count = vjp(program, free, most), free.directions(program.inputs)
    variables = tape.variables(gradient.inputs)
    evaluation, inputs = evaluate(gradient, tape, [*variables]), variables[: program.inputs]
    weight_changes = [0] * (gradient.inputs - program.inputs)
    rows = [
        tangents(evaluation, [*free.changes(tape, inputs, unit), *weight_changes])
        for unit in np.eye(count, dtype=int).tolist()
    ]
    # Directions commute but for those of one displaced input. Entries right of the diagonal take twice the operations,
    # so that they are those on its other side wherever directions commute.
    group = free.groups(count)
    order = [(i, j) if i >= j or group[i] == group[j] else (j, i) for i in range(count) for j in range(count)]
    return factor(tape.program([rows[j][i] for i, j in order]))


def _derive_along(program: Program, count: int, free: FreeInputs, most: float) -> Program:
    """Return the program of derivatives along a direction.

    The direction is one of the first `count` inputs, and follows all inputs of the program. Inputs behind the
    first `count`, weights or an earlier direction, do not change.
    """
    tape = Tape(most)
    variables = tape.variables(program.inputs)
    inputs, other_changes = variables[:count], [0] * (program.inputs - count)
    evaluation = evaluate(program, tape, [*variables])
    changes = free.changes(tape, inputs, [*tape.variables(free.directions(count))])
    return factor(tape.program(tangents(evaluation, [*changes, *other_changes])))


PRODUCTS = {"vjp": vjp, "jvp": jvp, "hvp": hvp, "jjvp": jjvp, "hessian": hessian}
