"""The two forms of native code: operations in a straight line, or for larger robots the steps of a joint in a loop."""

from collections.abc import Callable
from math import inf

import numpy as np

from jounce.dynamics.quantities import COMPILED, PATHS
from jounce.model.mechanism import Mechanism, in_whole_numbers
from jounce.native import emit, loop
from jounce.native.ir import Writer
from jounce.native.loop_steps import Sweeps, kinds
from jounce.native.memory import vectors_of_bodies
from jounce.native.quantity import LongCompilationError, Quantity
from jounce.native.target import Target
from jounce.program.factor import factored
from jounce.program.fuse import fused
from jounce.program.program import Program
from jounce.program.trace import Tape, TapeFullError
from jounce.spatial.series import Series, columns

# What compiling takes, in seconds, as measured on one core of a Zen 4:
OPERATION = 75e-6  # for an operation in a straight line, as traced
BODY = 1.2e-3  # for a body in the tables of the loop form
STEP = 6e-3  # for a kind of joint there, times the square of how many rates


def module(mechanism: Mechanism, quantity: Quantity, target: Target, patience: float = inf) -> str:
    """The LLVM IR of a quantity of a robot.

    Raises
    ------
    LongCompilationError : where compiling it is likely to take longer than `patience` seconds.
    """
    of_bodies = vectors_of_bodies(quantity, mechanism.parent)
    return emit.emitted(_block(mechanism, quantity, patience), quantity.interface, target, of_bodies)


def program(mechanism: Mechanism, quantity: Quantity, tape: Tape | None = None) -> Program:
    """The operations of a quantity, traced from the recursion, products with shared factors grouped.

    Where the mechanism holds nodes of a tape, that tape is written on, and the quantity's inputs follow those on it.
    """
    tape = Tape() if tape is None else tape
    inputs = [tape.variables(*shape) for shape in quantity.interface.taken]
    least = quantity.order + COMPILED[quantity.name]
    loads = [x.reshape(-1, 1) for x in inputs[least:]]
    law = PATHS[quantity.name]["recursion"].law
    results = law(in_whole_numbers(mechanism), columns(inputs[:least]), Series.of(loads) if loads else None)
    return factored(tape.program([x for result in results.upto(quantity.order) for x in np.ravel(result)]))


def _block(mechanism: Mechanism, quantity: Quantity, patience: float) -> Callable[[Writer], None]:
    """What defines ``@block``."""
    if not quantity.straight:
        steps_of_joints = len(set(kinds(mechanism))) * (quantity.order + 1) ** 2
        if quantity.nb * BODY + steps_of_joints * STEP > patience:
            raise LongCompilationError
        acting = mechanism.acting if quantity.name == "inverse_dynamics" else ()
        sweeps = Sweeps(quantity, acting)
        return lambda ir: loop.define_block(ir, mechanism, sweeps, quantity.interface)
    try:
        steps = fused(program(mechanism, quantity, Tape(patience / OPERATION)))
    except TapeFullError:
        raise LongCompilationError from None
    return lambda ir: emit.define_block(ir, steps, quantity.interface)
