"""For which computations and robots there is native code, and in which of its two forms."""

from jounce.dynamics.computation import Computation

STRAIGHT = 12  # bodies, up to which straight-line code is no slower than a loop
WORK = 250  # bodies times orders squared, with which operations grow, up to which it is compiled in a second
HIGHEST = 12  # order, up to which the step of a joint takes no more than 40 KiB of a thread's stack


class LongCompilationError(Exception):
    """Compiling takes longer than a caller waits for it."""


def is_straight(computation: Computation, nb: int) -> bool:
    """Whether the code is a straight line, not a loop over the bodies."""
    return nb <= STRAIGHT and nb * (computation.order + 1) ** 2 <= WORK


def obstacle(computation: Computation, nb: int) -> str | None:
    """Why there is no native code for a computation, as the end of a sentence about native code."""
    name, order = computation.name, computation.order
    if order > HIGHEST:
        return f"goes to order {HIGHEST}, not {order}"
    if not is_straight(computation, nb) and computation.quantity.sweep is None:
        most = min(STRAIGHT, WORK // (order + 1) ** 2)
        return f"for {name} to order {order} supports up to {most} bodies; this robot has {nb}"
    return None
