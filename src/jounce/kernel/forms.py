"""The two forms of native code: operations in a straight line, or for larger robots the steps of a joint in a loop."""

from collections.abc import Callable

import numpy as np

from jounce.kernel import emit, tree
from jounce.kernel.factor import factored
from jounce.kernel.fuse import fused
from jounce.kernel.ir import Writer
from jounce.kernel.program import Program
from jounce.kernel.quantity import Quantity
from jounce.kernel.steps import Sweeps
from jounce.kernel.target import Target
from jounce.kernel.trace import Tape
from jounce.mechanism import Mechanism, in_whole_numbers
from jounce.paths import COMPILED, PATHS
from jounce.series import Series, columns


def module(mechanism: Mechanism, quantity: Quantity, target: Target) -> str:
    """The LLVM IR of a quantity of a robot."""
    return emit.emitted(_block(mechanism, quantity), quantity.interface, target)


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


def _block(mechanism: Mechanism, quantity: Quantity) -> Callable[[Writer], None]:
    """What defines ``@block``."""
    if not quantity.straight:
        acting = mechanism.acting if quantity.name == "inverse_dynamics" else ()
        sweeps = Sweeps(quantity.name, quantity.order, quantity.loaded, acting)
        return lambda ir: tree.define_block(ir, mechanism, sweeps, quantity.interface)
    steps = fused(program(mechanism, quantity))
    return lambda ir: emit.define_block(ir, steps, quantity.interface)
