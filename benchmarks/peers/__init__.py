"""Ways to compute Q, Qd, Q2d: jounce's own and those of others, all called on the same arrays."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from jounce import JounceError, Robot

Call = Callable[[], Sequence[np.ndarray]]  # computes Q, Qd, ... anew, each (states, n)
Prepared = Callable[[Sequence[np.ndarray]], Call]  # from q, qd, ..., each (states, n)


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
