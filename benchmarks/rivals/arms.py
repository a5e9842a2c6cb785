"""A robot that is measured, and states for it: all that the process of a library gets, without any of jounce."""

from dataclasses import dataclass

import numpy as np

GRAVITY = -9.80665  # m/s^2 along z: the one value that dynibo has, so all others get it too
STATES = 1_000  # of a batch


@dataclass(frozen=True)
class Arm:
    """A robot: its file, its joints in the order of columns, their links, and a link at an end."""

    name: str
    path: str
    joints: tuple[str, ...]
    links: tuple[str, ...]  # that the joints move
    tip: str

    @property
    def n(self) -> int:
        """The number of joints."""
        return len(self.joints)


def states(n: int, count: int | None) -> tuple[np.ndarray, ...]:
    """Return q, qd, q2d, q3d, q4d, each (count, n), or (n,) of one state, uniform in -1 .. 1."""
    shape = (n,) if count is None else (count, n)
    rng = np.random.default_rng(n)
    return tuple(rng.uniform(-1, 1, shape) for _ in range(5))
