"""What a kernel computes: the arrays that it takes and gives, and the program of the law that gives them."""

from dataclasses import dataclass

import numpy as np

from jounce.kernel.emit import Interface
from jounce.kernel.factor import factored
from jounce.kernel.program import Program
from jounce.kernel.trace import Tape
from jounce.mechanism import Mechanism, in_whole_numbers
from jounce.paths import COMPILED, PATHS
from jounce.series import Series, columns


@dataclass(frozen=True)
class Quantity:
    """A quantity with its rates up to an order, with or without wrenches on the bodies, for a robot of some size."""

    name: str
    order: int
    loaded: bool
    n: int
    nb: int

    @property
    def interface(self) -> Interface:
        """The arrays: q, qd, ..., then W, Wd, ... in; the quantity and its rates out."""
        rates, loads = self.order + COMPILED[self.name], self.order + 1 if self.loaded else 0
        given = (self.n, self.n) if self.name.endswith("matrix") else (self.n,)
        return Interface(
            taken=((self.n,),) * rates + ((self.nb, 6),) * loads,
            given=(given,) * (self.order + 1),
            matters=(*(max(0, k + 1 - COMPILED[self.name]) for k in range(rates)), *range(loads)),
        )

    @property
    def arrays(self) -> int:
        """How many arrays it takes and gives."""
        return COMPILED[self.name] + self.order + (self.order + 1) * (2 if self.loaded else 1)

    def program(self, mechanism: Mechanism) -> Program:
        """The operations, traced from the recursion."""
        tape = Tape()
        inputs = [tape.variables(*shape) for shape in self.interface.taken]
        least = self.order + COMPILED[self.name]
        loads = [x.reshape(-1, 1) for x in inputs[least:]]
        law = PATHS[self.name]["recursion"].law
        results = law(in_whole_numbers(mechanism), columns(inputs[:least]), Series.of(loads) if loads else None)
        return factored(tape.program([x for result in results.upto(self.order) for x in np.ravel(result)]))
