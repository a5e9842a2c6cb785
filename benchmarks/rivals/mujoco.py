"""MuJoCo by its Python functions, which compute one state; forward dynamics of batches by its `Batch`, one thread."""

from collections.abc import Callable, Sequence
from typing import Any

import mujoco as mj
import numpy as np
from mujoco.batch import Batch

from benchmarks.rivals.arms import GRAVITY, Arm
from benchmarks.rivals.tasks import Call

STEP = 1e-6  # of the finite differences by which it differentiates


class Library:
    """A model and its data."""

    def __init__(self, arm: Arm) -> None:
        self.model = mj.MjModel.from_xml_path(arm.path)
        self.model.opt.gravity[:] = 0, 0, GRAVITY
        self.data = mj.MjData(self.model)
        self.tip = self.model.body(arm.tip).id
        # Column i of ours is column `order[i]` of MuJoCo's.
        self.order = [self.model.joint(name).dofadr[0] for name in arm.joints]
        self.n = arm.n

    def forces(self, x: Sequence[np.ndarray]) -> Call:
        """Q."""
        return self._each(x, mj.mj_inverse, lambda d: (d.qfrc_inverse[self.order],))

    def mass_matrix(self, x: Sequence[np.ndarray]) -> Call:
        """M."""
        M = np.empty((self.n, self.n))

        def run(model: Any, data: Any) -> None:
            mj.mj_kinematics(model, data)
            mj.mj_comPos(model, data)
            mj.mj_crb(model, data)
            mj.mj_fullM(model, data, M)

        return self._each(x, run, lambda d: (M[np.ix_(self.order, self.order)],))

    def jacobian(self, x: Sequence[np.ndarray]) -> Call:
        """J."""
        J = np.empty((2, 3, self.n))

        def run(model: Any, data: Any) -> None:
            mj.mj_kinematics(model, data)
            mj.mj_comPos(model, data)
            mj.mj_jacBody(model, data, J[1], J[0], self.tip)

        return self._each(x, run, lambda d: (J.reshape(6, -1)[:, self.order],))

    def jacobian_rate(self, x: Sequence[np.ndarray]) -> Call:
        """J and its rate."""
        J, Jd = np.empty((2, 2, 3, self.n))

        def run(model: Any, data: Any) -> None:
            mj.mj_kinematics(model, data)
            mj.mj_comPos(model, data)
            mj.mj_comVel(model, data)
            mj.mj_jacBody(model, data, J[1], J[0], self.tip)
            mj.mj_jacDot(model, data, Jd[1], Jd[0], data.xpos[self.tip], self.tip)

        return self._each(x, run, lambda d: tuple(y.reshape(6, -1)[:, self.order] for y in (J, Jd)))

    def accelerations(self, x: Sequence[np.ndarray]) -> Call:
        """Forward dynamics."""
        if x[0].ndim == 1:
            return self._each((*x[:2], None, x[2]), mj.mj_forward, lambda d: (d.qacc[self.order],))
        batch = Batch(self.model, nsim=len(x[0]), nthread=1)
        for name, array in zip(("qpos", "qvel", "qfrc_applied"), x, strict=True):
            batch.bind(name)[:] = self._theirs(array)
        found = batch.bind("qacc")
        return Call(batch.forward, lambda: (found[:, self.order],))

    def force_derivatives(self, x: Sequence[np.ndarray]) -> Call:
        """Derivatives of Q by q and qd, by finite differences."""
        n = self.n
        by_q, by_qd, by_q2d = np.empty((3, n, n))

        def run(model: Any, data: Any) -> None:
            mj.mjd_inverseFD(model, data, STEP, 1, by_q, by_qd, by_q2d, None, None, None, None)

        rows = np.ix_(self.order, self.order)
        return self._each(x, run, lambda d: (by_q.T[rows], by_qd.T[rows]))

    def _each(
        self, x: Sequence[np.ndarray | None], run: Callable[[Any, Any], None],
        read: Callable[[Any], tuple[np.ndarray, ...]],
    ) -> Call:  # fmt: skip
        """Write each state into the data and call; `read` takes the results of the last call from there."""
        model, data = self.model, self.data
        places = (data.qpos, data.qvel, data.qacc, data.qfrc_applied)
        given = [(place, self._theirs(array)) for place, array in zip(places, x, strict=False) if array is not None]

        def compute(index: Any) -> None:
            for place, array in given:
                place[:] = array[index]
            run(model, data)

        if x[0].ndim == 1:
            return Call(lambda: compute(...), lambda: (compute(...), read(data))[1])
        count = len(x[0])

        def compute_all() -> None:
            for i in range(count):
                compute(i)

        def results() -> list[np.ndarray]:
            found = []
            for i in range(count):
                compute(i)
                found.append([array.copy() for array in read(data)])
            return [np.stack(arrays) for arrays in zip(*found, strict=True)]

        return Call(compute_all, results)

    def _theirs(self, x: np.ndarray) -> np.ndarray:
        """Return an input (..., n) in the order of the model."""
        found = np.empty_like(x)
        found[..., self.order] = x
        return found
