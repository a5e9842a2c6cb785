"""What a kernel computes, and for which robots there is a form of code for it."""

from dataclasses import dataclass

from jounce.dynamics.quantities import COMPILED
from jounce.native.interface import Interface

STRAIGHT = 12  # bodies, up to which straight-line code is no slower than a loop
WORK = 250  # bodies times orders squared, with which operations grow, up to which it is compiled in a second
LOOPS = ("inverse_dynamics", "gravity_forces")  # the quantities that the steps of a joint make up
HIGHEST = 12  # order, up to which the step of a joint takes no more than 40 KiB of a thread's stack


class LongCompilationError(Exception):
    """Compiling takes longer than a caller waits for it."""


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
        given = (self.n, self.n) if "matrix" in self.name else (self.n,)
        return Interface(
            taken=((self.n,),) * rates + ((self.nb, 6),) * loads,
            given=(given,) * (self.order + 1),
            matters=(*(max(0, k + 1 - COMPILED[self.name]) for k in range(rates)), *range(loads)),
        )

    @property
    def moving(self) -> bool:
        """Whether bodies move: gravity alone is felt at rest."""
        return self.name != "gravity_forces"

    @property
    def straight(self) -> bool:
        """Whether its code is a straight line, not a loop."""
        return self.nb <= STRAIGHT and self.nb * (self.order + 1) ** 2 <= WORK

    @property
    def obstacle(self) -> str | None:
        """Why there is no native code for it."""
        if self.order > HIGHEST:
            return f"it goes to order {HIGHEST}, not {self.order}"
        if not self.straight and self.name not in LOOPS:
            return f"of {self.name} to order {self.order} it is for fewer than {self.nb} bodies"
        return None
