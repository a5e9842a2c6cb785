"""Newton by its experimental inverse dynamics, on the CPU, in single precision; a batch is a world for each state."""

from collections.abc import Callable, Sequence
from typing import Any

import newton
import numpy as np
import warp as wp

from benchmarks.rivals.arms import GRAVITY, Arm
from benchmarks.rivals.tasks import Call


class Library:
    """The path of a robot: models are made for each number of states."""

    def __init__(self, arm: Arm) -> None:
        wp.config.quiet = True
        wp.set_device("cpu")
        self.arm = arm

    def forces(self, x: Sequence[np.ndarray]) -> Call:
        """Q = M q2d + C qd + g, from its three terms."""
        model, state, M = self._world(x)
        gravity, coriolis, Q = (wp.zeros(model.joint_dof_count, dtype=wp.float32) for _ in range(3))
        q2d = wp.array(x[2].ravel(), dtype=wp.float32)

        def run() -> None:
            newton.eval_fk(model, state.joint_q, state.joint_qd, state)
            newton.eval_inverse_dynamics_passive(
                model, state, mass_matrix=M, gravity_force=gravity, coriolis_force=coriolis
            )
            newton.eval_inverse_dynamics_force(
                model, state, mass_matrix=M, joint_qdd=q2d, coriolis_force=coriolis, gravity_force=gravity, joint_f=Q
            )

        return Call(run, _read(run, lambda: Q.numpy().reshape(x[0].shape)))

    def mass_matrix(self, x: Sequence[np.ndarray]) -> Call:
        """M."""
        model, state, M = self._world(x)

        def run() -> None:
            newton.eval_fk(model, state.joint_q, state.joint_qd, state)
            newton.eval_inverse_dynamics_passive(model, state, mass_matrix=M)

        return Call(run, _read(run, lambda: M.numpy().reshape(*x[0].shape, self.arm.n)))

    def _world(self, x: Sequence[np.ndarray]) -> tuple[Any, Any, Any]:
        """Return a model of one robot for each state, its state, and a place for the mass matrices."""
        one = newton.ModelBuilder(gravity=(0, 0, GRAVITY))
        one.add_urdf(self.arm.path, floating=False, collapse_fixed_joints=True)
        builder = newton.ModelBuilder(gravity=(0, 0, GRAVITY))
        builder.replicate(one, x[0].size // self.arm.n)
        model = builder.finalize()
        names = [label.rpartition("/")[2] for label in one.joint_label]
        if [name for name in names if name in self.arm.joints] != list(self.arm.joints):
            raise ValueError(f"its joints are in the order {names}")
        state = model.state()
        state.joint_q.assign(x[0].ravel().astype(np.float32))
        if len(x) > 1:
            state.joint_qd.assign(x[1].ravel().astype(np.float32))
        M = wp.zeros((model.articulation_count, self.arm.n, self.arm.n), dtype=wp.float32)
        return model, state, M


def _read(run: Callable[[], None], read: Callable[[], np.ndarray]) -> Callable[[], list[np.ndarray]]:
    """Return a function that computes and reads."""

    def results() -> list[np.ndarray]:
        run()
        return [read()]

    return results
