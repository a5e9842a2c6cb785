"""jounce by the methods of `Robot`, which is what a reader of its README calls."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

import jounce
from benchmarks.rivals.arms import GRAVITY, Arm
from benchmarks.rivals.tasks import Call


class Library:
    """A robot of jounce."""

    def __init__(self, arm: Arm) -> None:
        self.arm = arm
        self.robot = jounce.load(arm.path, gravity=(0, 0, GRAVITY))

    def forces(self, x: Sequence[np.ndarray]) -> Call:
        """Q, with its rates where x has those of q."""
        return self._call("inverse_dynamics", x, len(x) - 3)

    force_rates = forces

    def mass_matrix(self, x: Sequence[np.ndarray]) -> Call:
        """M, with rates where x has them."""
        return self._call("mass_matrix", x, len(x) - 1)

    mass_matrix_rates = mass_matrix

    def jacobian(self, x: Sequence[np.ndarray]) -> Call:
        """J, with its rate where x has it."""
        return self._call("jacobian", x, len(x) - 1, body=self.arm.tip, frame="world")

    jacobian_rate = jacobian

    def accelerations(self, x: Sequence[np.ndarray]) -> Call:
        """Forward dynamics."""
        return self._call("forward_dynamics", x, 0)

    def force_derivatives(self, x: Sequence[np.ndarray]) -> Call:
        """Derivatives of Q by q and qd, and M, which the method returns with them."""
        call = self._call("inverse_dynamics_partials", x, 0)
        return Call(call.run, lambda: first_two(call.results()[0]))

    def acceleration_derivatives(self, x: Sequence[np.ndarray]) -> Call:
        """Derivatives of accelerations by q, qd and Q."""
        return self._call("forward_dynamics_partials", x, 0)

    def second_derivatives(self, x: Sequence[np.ndarray]) -> Call:
        """All tensors of second derivatives of Q."""
        return self._call("inverse_dynamics_second_partials", x, 0)

    def _call(self, quantity: str, x: Sequence[np.ndarray], order: int, **of_body: str) -> Call:
        """Compile a quantity with `order` rates first, as the page on speed advises, and call the method."""
        self.robot.compile(quantity, order=order, **of_body)
        method: Callable[..., Any] = getattr(self.robot, quantity)
        run = lambda: method(*x, **of_body)  # noqa: E731
        return Call(run, lambda: as_tuple(run()))


def as_tuple(found: Any) -> tuple[np.ndarray, ...]:
    """Return the results of a method as a tuple, where it returns one array too."""
    if isinstance(found, tuple):
        return found
    return (found,)


def first_two(found: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return the derivatives of Q by q and qd, from the array (..., 3, n, n) of all three."""
    return found[..., 0, :, :], found[..., 1, :, :]
