"""What a kernel computes: the arrays that it takes and gives, and the program of the law that gives them."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from jounce.kernel import emit, tree
from jounce.kernel.emit import Interface
from jounce.kernel.factor import factored
from jounce.kernel.fuse import fused
from jounce.kernel.ir import Writer
from jounce.kernel.program import Program
from jounce.kernel.steps import Sweeps
from jounce.kernel.trace import Tape
from jounce.mechanism import Mechanism, in_whole_numbers
from jounce.paths import COMPILED, PATHS
from jounce.series import Series, columns

STRAIGHT = (
    12  # joints, up to which straight-line code is no slower, and compiled in a second; see benchmarks/RESULTS.md
)
MOST = 1000  # joints, whose scratch memory the stack of a thread holds with ease
LOOPS = ("inverse_dynamics", "gravity_forces")  # the quantities that the steps of a joint make up


@dataclass(frozen=True)
class Quantity:
    """A quantity with its rates up to an order, with or without wrenches on the bodies, for a robot of some size."""

    name: str
    order: int
    loaded: bool
    n: int
    nb: int

    @property
    def most(self) -> int:
        """How many bodies there may be: matrices have no loop form."""
        return MOST if self.name in LOOPS else STRAIGHT

    @property
    def compilable(self) -> bool:
        """Whether there is a form of code for it."""
        return self.nb <= self.most

    @property
    def interface(self) -> Interface:
        """The arrays: q, qd, ..., then W, Wd, ... in; the quantity and its rates out."""
        rates, loads = self.order + COMPILED[self.name], self.order + 1 if self.loaded else 0
        given = (self.n, self.n) if "matrix" in self.name else (self.n,)
        return Interface(
            taken=((self.n,),) * rates + ((self.nb, 6),) * loads,
            given=(given,) * (self.order + 1),
            matters=(*(max(0, k + 1 - COMPILED[self.name]) for k in range(rates)), *range(loads)),
        )

    def block(self, mechanism: Mechanism) -> Callable[[Writer], None]:
        """What defines ``@block``: a straight line of operations, or for larger robots a loop over the joints."""
        if self.nb > STRAIGHT:
            sweeps = Sweeps(self.name, self.order, self.loaded)
            return lambda ir: tree.define_block(ir, mechanism, sweeps, self.interface)
        program = fused(self.program(mechanism))
        return lambda ir: emit.define_block(ir, program, self.interface)

    def program(self, mechanism: Mechanism) -> Program:
        """The operations, traced from the recursion."""
        tape = Tape()
        inputs = [tape.variables(*shape) for shape in self.interface.taken]
        least = self.order + COMPILED[self.name]
        loads = [x.reshape(-1, 1) for x in inputs[least:]]
        law = PATHS[self.name]["recursion"].law
        results = law(in_whole_numbers(mechanism), columns(inputs[:least]), Series.of(loads) if loads else None)
        return factored(tape.program([x for result in results.upto(self.order) for x in np.ravel(result)]))
