"""Pinocchio by its Python functions, which compute one state; Q and q2d of batches by its pools, on one thread."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from benchmarks.rivals.arms import GRAVITY, Arm
from benchmarks.rivals.tasks import Call

Compute = Callable[..., Any]
AXES = pin.LOCAL_WORLD_ALIGNED


class Library:
    """A model, its data, and where its joints and its last link are."""

    def __init__(self, arm: Arm) -> None:
        self.model = pin.buildModelFromUrdf(arm.path)
        self.model.gravity.linear = np.array([0, 0, GRAVITY])
        self.data = self.model.createData()
        self.tip = self.model.getFrameId(arm.tip)
        # Column i of ours is column `order[i]` of Pinocchio's, whose joints have another order in trees.
        self.order = [self.model.joints[self.model.getJointId(name)].idx_v for name in arm.joints]

    def forces(self, x: Sequence[np.ndarray]) -> Call:
        """Q; `rneaInParallel` wants a state in each column."""
        if x[0].ndim == 1:
            return self._each(x, pin.rnea, lambda d: (self._vector(d.tau),))
        return self._parallel(x, pin.rneaInParallel)

    def mass_matrix(self, x: Sequence[np.ndarray]) -> Call:
        """M, whose lower triangle `crba` leaves out."""
        return self._each(x, pin.crba, lambda d: (self._matrix(np.triu(d.M) + np.triu(d.M, 1).T),))

    def jacobian(self, x: Sequence[np.ndarray]) -> Call:
        """J."""
        found: list[np.ndarray] = [np.empty(0)]

        def run(model: Any, data: Any, q: np.ndarray) -> None:
            found[0] = pin.computeFrameJacobian(model, data, q, self.tip, AXES)

        return self._each(x, run, lambda d: (self._twists(found[0]),))

    def jacobian_rate(self, x: Sequence[np.ndarray]) -> Call:
        """J and its rate."""
        found: list[np.ndarray] = []

        def run(model: Any, data: Any, q: np.ndarray, qd: np.ndarray) -> None:
            pin.computeJointJacobiansTimeVariation(model, data, q, qd)
            pin.updateFramePlacement(model, data, self.tip)
            rate = pin.getFrameJacobianTimeVariation(model, data, self.tip, AXES)
            found[:] = pin.getFrameJacobian(model, data, self.tip, AXES), rate

        return self._each(x, run, lambda d: tuple(map(self._twists, found)))

    def accelerations(self, x: Sequence[np.ndarray]) -> Call:
        """Forward dynamics."""
        if x[0].ndim == 1:
            return self._each(x, pin.aba, lambda d: (self._vector(d.ddq),))
        return self._parallel(x, pin.abaInParallel)

    def force_derivatives(self, x: Sequence[np.ndarray]) -> Call:
        """Derivatives of Q by q and qd, and M."""
        read = lambda d: (self._matrix(d.dtau_dq), self._matrix(d.dtau_dv))  # noqa: E731
        return self._each(x, pin.computeRNEADerivatives, read)

    def acceleration_derivatives(self, x: Sequence[np.ndarray]) -> Call:
        """Derivatives of accelerations by q, qd and Q."""

        def read(d: Any) -> tuple[np.ndarray, ...]:
            Minv = np.triu(d.Minv) + np.triu(d.Minv, 1).T
            return self._matrix(d.ddq_dq), self._matrix(d.ddq_dv), self._matrix(Minv)

        return self._each(x, pin.computeABADerivatives, read)

    def _each(self, x: Sequence[np.ndarray], run: Compute, read: Callable[[Any], tuple[np.ndarray, ...]]) -> Call:
        """Call for each state; `read` takes the results of the last call from the data."""
        model, data = self.model, self.data
        inputs = [self._theirs(array) for array in x]
        if x[0].ndim == 1:
            return Call(lambda: run(model, data, *inputs), lambda: (run(model, data, *inputs), read(data))[1])
        states = list(zip(*inputs, strict=True))

        def run_all() -> None:
            for state in states:
                run(model, data, *state)

        def results() -> tuple[np.ndarray, ...]:
            found = []
            for state in states:
                run(model, data, *state)
                found.append([array.copy() for array in read(data)])
            return tuple(np.stack(arrays) for arrays in zip(*found, strict=True))

        return Call(run_all, results)

    def _parallel(self, x: Sequence[np.ndarray], compute: Compute) -> Call:
        """Call a function of many states, on one thread."""
        pool = pin.ModelPool(self.model, 1)
        inputs = [np.asfortranarray(self._theirs(array).T) for array in x]
        out = np.empty_like(inputs[0])
        return Call(lambda: compute(1, pool, *inputs, out), lambda: (self._vector(out.T),))

    def _theirs(self, x: np.ndarray) -> np.ndarray:
        """Return an input (..., n) in the order of the model."""
        found = np.empty_like(x)
        found[..., self.order] = x
        return found

    def _vector(self, x: np.ndarray) -> np.ndarray:
        """Return a vector or vectors in our order."""
        return x[..., self.order]

    def _matrix(self, x: np.ndarray) -> np.ndarray:
        """Return a matrix (n, n) in our order."""
        return x[np.ix_(self.order, self.order)]

    def _twists(self, J: np.ndarray) -> np.ndarray:
        """Return a Jacobian (linear; angular) as (angular; linear), in our order."""
        return J[[3, 4, 5, 0, 1, 2]][:, self.order]
