"""Functions: what generated code computes, as a program and the named arrays that it takes and gives."""

from dataclasses import dataclass
from itertools import accumulate
from math import prod

from jounce._codegen.parametric import Parametric
from jounce.dynamics.computation import Computation, Shape
from jounce.dynamics.quantities import QUANTITIES
from jounce.program.program import Program

OUTPUTS = tuple(name for name, quantity in QUANTITIES.items() if not quantity.of_bodies)


@dataclass(frozen=True)
class Array:
    """An array of reals by its name; () is a single one. Its scalars are numbered from `start` on in the program."""

    name: str
    shape: Shape
    start: int = 0

    @property
    def size(self) -> int:
        """How many scalars it holds."""
        return prod(self.shape)


@dataclass(frozen=True)
class Function:
    """A quantity with its rates up to an order: parameters, coordinates and wrenches in, the quantity out."""

    computation: Computation
    parameters: tuple[Array, ...]
    inputs: tuple[Array, ...]
    outputs: tuple[Array, ...]
    program: Program

    @property
    def name(self) -> str:
        """Of the quantity."""
        return self.computation.name

    @property
    def operations(self) -> int:
        """The number of operations on scalars."""
        return self.program.operations


def in_a_row(shapes: dict[str, Shape], start: int = 0) -> tuple[Array, ...]:
    """Arrays whose scalars are numbered one array after the other."""
    starts = accumulate(map(prod, shapes.values()), initial=start)
    return tuple(Array(name, shape, first) for (name, shape), first in zip(shapes.items(), starts, strict=False))


def trace(robot: Parametric, name: str, order: int, loaded: bool) -> Function:
    """A quantity of a robot, traced."""
    from jounce.native.forms import program
    from jounce.program.trace import Tape

    tape = Tape()
    parameters = in_a_row(robot.shapes)
    mechanism = robot.mechanism({array.name: tape.variables(*array.shape) for array in parameters})
    computation = Computation(name, order, loaded)
    signature = computation.signature(mechanism.n, mechanism.nb)
    taken, given = ({port.name: port.shape for port in ports} for ports in (signature.inputs, signature.outputs))
    inputs = in_a_row(taken, tape.inputs)
    return Function(computation, parameters, inputs, in_a_row(given), program(mechanism, computation, tape))
