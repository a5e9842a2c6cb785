"""jounce by kernels that are bound to their arrays, which its page on speed names for control loops."""

from collections.abc import Callable, Sequence

import numpy as np

import jounce
from benchmarks.rivals.arms import GRAVITY, Arm
from benchmarks.rivals.ours import first_two
from benchmarks.rivals.tasks import Call


class Library:
    """A robot of jounce, its kernels bound."""

    def __init__(self, arm: Arm) -> None:
        self.arm = arm
        self.robot = jounce.load(arm.path, gravity=(0, 0, GRAVITY))

    def forces(self, x: Sequence[np.ndarray]) -> Call:
        """Q, with its rates where x has those of q."""
        return self._bind("inverse_dynamics", x, len(x) - 3, ("n",))

    force_rates = forces

    def mass_matrix(self, x: Sequence[np.ndarray]) -> Call:
        """M, with rates where x has them."""
        return self._bind("mass_matrix", x, len(x) - 1, ("n", "n"))

    mass_matrix_rates = mass_matrix

    def jacobian(self, x: Sequence[np.ndarray]) -> Call:
        """J, with its rate where x has it."""
        return self._bind("jacobian", x, len(x) - 1, (6, "n"), body=self.arm.tip, frame="world")

    jacobian_rate = jacobian

    def accelerations(self, x: Sequence[np.ndarray]) -> Call:
        """Forward dynamics."""
        return self._bind("forward_dynamics", x, 0, ("n",))

    def force_derivatives(self, x: Sequence[np.ndarray]) -> Call:
        """Derivatives of Q by q and qd, and M."""
        call = self._bind("inverse_dynamics_partials", x, 0, (3, "n", "n"))
        return Call(call.run, lambda: first_two(call.results()[0]))

    def acceleration_derivatives(self, x: Sequence[np.ndarray]) -> Call:
        """Derivatives of accelerations by q, qd and Q."""
        return self._bind("forward_dynamics_partials", x, 0, *[("n", "n")] * 3)

    def second_derivatives(self, x: Sequence[np.ndarray]) -> Call:
        """All tensors of second derivatives of Q."""
        return self._bind("inverse_dynamics_second_partials", x, 0, *[("n", "n", "n")] * 4)

    def _bind(self, quantity: str, x: Sequence[np.ndarray], order: int, *shapes: tuple, **of_body: str) -> Call:
        """Bind the kernel of a quantity with `order` rates, or of several; "n" in shapes is the number of joints."""
        sizes = [tuple(self.arm.n if size == "n" else size for size in shape) for shape in shapes * (order + 1)]
        out = [np.empty((*x[0].shape[:-1], *shape)) for shape in sizes]
        run: Callable[[], None] = self.robot.compile(quantity, order=order, **of_body).bind(*x, out=out)
        return Call(run, lambda: out)
