"""dynibo by its methods, which compute one state, into arrays that are there."""

from collections.abc import Callable, Sequence
from functools import partial

import dynibo
import numpy as np

from benchmarks.rivals.arms import Arm
from benchmarks.rivals.tasks import Call


class Library:
    """A robot, whose gravity is 9.80665 m/s^2."""

    def __init__(self, arm: Arm) -> None:
        self.robot = dynibo.Robot.from_urdf(arm.path)
        self.tip = self.robot.link_id(arm.tip)
        self.n = arm.n
        # Its joints are in the order of the numbers of their links: column i of ours is column `order[i]` of its.
        numbers = [self.robot.link_id(link) for link in arm.links]
        self.order = [sorted(numbers).index(number) for number in numbers]

    def forces(self, x: Sequence[np.ndarray]) -> Call:
        """Q."""
        return self._each(x, self.robot.inverse_dynamics, [(self.n,)])

    def mass_matrix(self, x: Sequence[np.ndarray]) -> Call:
        """M."""
        call = self._each(x, self.robot.mass_matrix, [(self.n, self.n)])
        return Call(call.run, lambda: [M[..., self.order, :] for M in call.results()])

    def jacobian(self, x: Sequence[np.ndarray]) -> Call:
        """J, which it stores by columns."""
        return self._each(x, self._jacobian, [(6, self.n)])

    def jacobian_rate(self, x: Sequence[np.ndarray]) -> Call:
        """J and its rate."""

        def run(q: np.ndarray, qd: np.ndarray, out: tuple[np.ndarray, np.ndarray]) -> None:
            self._jacobian(q, out=out[0])
            self.robot.jacobian_derivative(q, qd, self.tip, out=out[1])

        return self._each(x, run, [(6, self.n), (6, self.n)])

    def accelerations(self, x: Sequence[np.ndarray]) -> Call:
        """Forward dynamics."""
        return self._each(x, self.robot.forward_dynamics, [(self.n,)])

    def _jacobian(self, q: np.ndarray, out: np.ndarray) -> None:
        self.robot.jacobian(q, self.tip, out=out)

    def _each(self, x: Sequence[np.ndarray], run: Callable[..., object], shapes: list[tuple[int, ...]]) -> Call:
        """Call for each state, into flat arrays in which matrices of these shapes lie by columns."""
        batch = x[0].shape[:-1]
        inputs = [self._theirs(array) for array in x]
        out = [np.empty((*batch, int(np.prod(shape)))) for shape in shapes]

        def read() -> list[np.ndarray]:
            by_columns = [array.reshape(*batch, *shape[::-1]) for array, shape in zip(out, shapes, strict=True)]
            found = [a.swapaxes(-1, -2) if len(shape) > 1 else a for a, shape in zip(by_columns, shapes, strict=True)]
            return [array[..., self.order] for array in found]

        if not batch:
            return Call(partial(run, *inputs, out=out[0] if len(out) == 1 else tuple(out)), read)
        states = list(zip(*inputs, strict=True))
        places = list(out[0]) if len(out) == 1 else list(zip(*out, strict=True))

        def run_all() -> None:
            for state, place in zip(states, places, strict=True):
                run(*state, out=place)

        return Call(run_all, read)

    def _theirs(self, x: np.ndarray) -> np.ndarray:
        """Return an input (..., n) in its order."""
        found = np.empty_like(x)
        found[..., self.order] = x
        return found
