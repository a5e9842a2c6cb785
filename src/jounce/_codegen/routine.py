"""Routines: what generated code computes, as a program and the named arrays that it takes and gives."""

from dataclasses import dataclass
from itertools import accumulate
from math import prod

from jounce._codegen.parametric import Parametric
from jounce.arguments.rates import rate_name
from jounce.dynamics.quantities import COMPILED
from jounce.native.interface import Shape
from jounce.program.program import Program

OUTPUTS = {  # by name the quantity of `paths`, and its symbol
    "inverse_dynamics": ("inverse_dynamics", "Q"),
    "gravity_forces": ("gravity_forces", "Qgrav"),
    "mass_matrix": ("mass_matrix", "M"),
    "coriolis_matrix": ("coriolis_matrix of form 'paper'", "C"),
    "skew_coriolis_matrix": ("coriolis_matrix of form 'skew'", "Cbar"),
}


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
class Routine:
    """A quantity with its rates up to an order: parameters, coordinates and wrenches in, the quantity out."""

    name: str
    parameters: tuple[Array, ...]
    inputs: tuple[Array, ...]
    outputs: tuple[Array, ...]
    program: Program

    @property
    def operations(self) -> int:
        """The number of operations on scalars."""
        return self.program.operations


def in_a_row(shapes: dict[str, Shape], start: int = 0) -> tuple[Array, ...]:
    """Arrays whose scalars are numbered one array after the other."""
    starts = accumulate(map(prod, shapes.values()), initial=start)
    return tuple(Array(name, shape, first) for (name, shape), first in zip(shapes.items(), starts, strict=False))


def interface(name: str, order: int, loaded: bool, n: int, nb: int) -> tuple[dict[str, Shape], dict[str, Shape]]:
    """The arrays of a quantity by name, in and out: q, qd, ..., W, Wd, ... and Q, Qd, ..., say."""
    quantity, symbol = OUTPUTS[name]
    taken: dict[str, Shape] = {rate_name("q", k): (n,) for k in range(order + COMPILED[quantity])}
    if loaded:
        taken |= {rate_name("W", k): (nb, 6) for k in range(order + 1)}
    given: Shape = (n, n) if "matrix" in name else (n,)
    return taken, {rate_name(symbol, k): given for k in range(order + 1)}


def routine(robot: Parametric, name: str, order: int, loaded: bool) -> Routine:
    """A quantity of a robot, traced."""
    from jounce.native.forms import program
    from jounce.native.quantity import Quantity
    from jounce.program.trace import Tape

    tape = Tape()
    parameters = in_a_row(robot.shapes)
    mechanism = robot.mechanism({array.name: tape.variables(*array.shape) for array in parameters})
    n, nb = mechanism.n, mechanism.nb
    taken, given = interface(name, order, loaded, n, nb)
    quantity = Quantity(OUTPUTS[name][0], order, loaded, n, nb)
    inputs = in_a_row(taken, tape.inputs)
    return Routine(name, parameters, inputs, in_a_row(given), program(mechanism, quantity, tape))
