"""Ways to compute Q, Qd, Q2d: jounce's own and those of others, all called on the same arrays."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from jounce import JounceError, Robot

Arrays = Sequence[np.ndarray]  # q, qd, ... or Q, Qd, ..., each (states, n)
Call = Callable[[], object]  # returns Q, Qd, ... or, where they were written into arrays, None
Prepared = Callable[[Arrays, Arrays], Call]  # from q, qd, ... and arrays to write into


def alone(arrays: Arrays) -> Arrays:
    """A single state as users hold it, without a batch axis; batches as they are."""
    return [x[0] for x in arrays] if len(arrays[0]) == 1 else arrays


class MissingError(JounceError):
    """What a peer needs and this machine has not."""


@dataclass(frozen=True)
class Peer:
    """A way to compute the forces of a robot and their rates.

    `build` makes it for a robot and an order, and raises `MissingError` or ImportError where it cannot.
    """

    name: str
    build: Callable[[Robot, int], Prepared]
    orders: Sequence[int] = range(5)
    batches: Sequence[int] = (1, 1_000, 100_000)
