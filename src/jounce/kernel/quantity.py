"""What a kernel computes, and for which robots there is a form of code for it."""

from dataclasses import dataclass

from jounce.kernel.interface import Interface
from jounce.paths import COMPILED

STRAIGHT = 12  # bodies, up to which straight-line code is no slower than a loop, and compiled in a second
LOOPS = ("inverse_dynamics", "gravity_forces")  # the quantities that the steps of a joint make up
MOST = 1000  # bodies, whose scratch memory the stack of a thread holds with ease
ARRAYS = 64  # of a ufunc, results among them: a limit of NumPy


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
    def obstacle(self) -> str | None:
        """Why there is no native code for it."""
        arrays = COMPILED[self.name] + self.order + (self.order + 1) * (2 if self.loaded else 1)
        if arrays > ARRAYS:
            return f"order {self.order} takes and gives {arrays} arrays, and {ARRAYS} is the most"
        most = MOST if self.name in LOOPS else STRAIGHT
        return None if self.nb <= most else f"of {self.name} it is for at most {most} bodies, not {self.nb}"
