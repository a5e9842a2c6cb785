"""The arrays that native code takes and gives."""

from dataclasses import dataclass
from itertools import accumulate
from math import prod

Shape = tuple[int, ...]


@dataclass(frozen=True)
class Interface:
    """The shapes of the arrays for one state, and the order of the outputs from which on each input matters."""

    taken: tuple[Shape, ...]
    given: tuple[Shape, ...]
    matters: tuple[int, ...]

    def places(self) -> tuple[list[int], list[int]]:
        """Where the arrays of inputs, and of outputs, begin and end in scratch memory."""
        taken, given = (list(accumulate(map(prod, shapes), initial=0)) for shapes in (self.taken, self.given))
        return taken, given
