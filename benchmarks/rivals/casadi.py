"""CasADi: the equations of adam, differentiated by CasADi, as C code that gcc compiles, called through buffers.

That is what CasADi's page on code generation names as the fastest way. Equations of more than some ten thousand
operations take gcc longer than a run allows: those cells say so.
"""

import subprocess
from collections.abc import Sequence
from itertools import count
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
from adam.casadi import KinDynComputations

import casadi as ca
from benchmarks.rivals.arms import GRAVITY, Arm
from benchmarks.rivals.tasks import Call

FLAGS = ("-O3", "-march=native", "-ffast-math", "-fPIC", "-shared")


class Library:
    """Expressions of a robot that stands: its base at the origin, at rest."""

    def __init__(self, arm: Arm) -> None:
        self.arm = arm
        self.robot = KinDynComputations(arm.path, list(arm.joints), gravity=np.array([0, 0, GRAVITY, 0, 0, 0]))
        self.q, self.qd, self.q2d, self.q3d, self.q4d = (ca.SX.sym(f"x{k}", arm.n) for k in range(5))
        self.folder, self.numbers = Path(mkdtemp()), count()
        self.kept: list[object] = []  # buffers and their arrays, which calls read and write without owning them

    def forces(self, x: Sequence[np.ndarray]) -> Call:
        """Q."""
        return self._compiled([self._forces()], x)

    def force_rates(self, x: Sequence[np.ndarray]) -> Call:
        """Q, and its derivatives along the motion."""
        Q = self._forces()
        Qd = self._rate(Q)
        return self._compiled([Q, Qd, self._rate(Qd)], x)

    def mass_matrix(self, x: Sequence[np.ndarray]) -> Call:
        """M."""
        return self._compiled([self._mass_matrix()], x)

    def mass_matrix_rates(self, x: Sequence[np.ndarray]) -> Call:
        """M and its derivatives along the motion."""
        M = self._mass_matrix()
        Md = self._rate(M)
        return self._compiled([M, Md, self._rate(Md)], x)

    def jacobian(self, x: Sequence[np.ndarray]) -> Call:
        """J."""
        return self._compiled([self._jacobian()], x)

    def jacobian_rate(self, x: Sequence[np.ndarray]) -> Call:
        """J and its derivative along the motion."""
        J = self._jacobian()
        return self._compiled([J, self._rate(J)], x)

    def accelerations(self, x: Sequence[np.ndarray]) -> Call:
        """Forward dynamics."""
        return self._compiled([self._accelerations()], x)

    def force_derivatives(self, x: Sequence[np.ndarray]) -> Call:
        """Derivatives of Q by q and qd."""
        Q = self._forces()
        return self._compiled([ca.jacobian(Q, self.q), ca.jacobian(Q, self.qd)], x)

    def acceleration_derivatives(self, x: Sequence[np.ndarray]) -> Call:
        """Derivatives of accelerations by q, qd and Q, which stands in the place of q2d."""
        found = self._accelerations()
        return self._compiled([ca.jacobian(found, y) for y in (self.q, self.qd, self.q2d)], x)

    def _forces(self) -> ca.SX:
        bias = self.robot.bias_force(np.eye(4), self.q, np.zeros(6), self.qd)
        return ca.mtimes(self._mass_matrix(), self.q2d) + bias[6:]

    def _mass_matrix(self) -> ca.SX:
        return self.robot.mass_matrix(np.eye(4), self.q)[6:, 6:]

    def _jacobian(self) -> ca.SX:
        J = self.robot.jacobian(self.arm.tip, np.eye(4), self.q)[:, 6:]
        return ca.vertcat(J[3:, :], J[:3, :])

    def _accelerations(self) -> ca.SX:
        """Return q2d of the forces that stand in its place: adam's `aba` is that of a robot that floats."""
        bias = self.robot.bias_force(np.eye(4), self.q, np.zeros(6), self.qd)[6:]
        return ca.solve(self._mass_matrix(), self.q2d - bias)

    def _rate(self, x: ca.SX) -> ca.SX:
        """Return the derivative of an expression along the motion."""
        state = ca.vertcat(self.q, self.qd, self.q2d, self.q3d)
        rates = ca.vertcat(self.qd, self.q2d, self.q3d, self.q4d)
        return ca.reshape(ca.jtimes(ca.vec(x), state, rates), x.shape)

    def _compiled(self, results: list[ca.SX], x: Sequence[np.ndarray]) -> Call:
        """Compile expressions of as many inputs as there are in x, and bind them to arrays."""
        inputs = [self.q, self.qd, self.q2d, self.q3d, self.q4d][: len(x)]
        dense = [ca.densify(result) for result in results]
        name = f"f{next(self.numbers)}"
        ca.Function(name, inputs, dense, {"cse": True}).generate(f"{name}.c", {"main": False, "with_header": False})
        Path(f"{name}.c").rename(self.folder / f"{name}.c")
        library = self.folder / f"{name}.so"
        subprocess.run(["gcc", *FLAGS, str(self.folder / f"{name}.c"), "-o", str(library), "-lm"], check=True)
        f = ca.external(name, str(library))

        # CasADi keeps matrices by columns: a state is a column, and a matrix comes back transposed.
        states = 1 if x[0].ndim == 1 else len(x[0])
        if states > 1:
            f = f.map(states)
        buffer, run = f.buffer()
        arrays = [np.ascontiguousarray(array) for array in x]
        out = [np.empty((states, result.shape[1], result.shape[0])) for result in results]
        for i, array in enumerate(arrays):
            buffer.set_arg(i, memoryview(array))
        for i, array in enumerate(out):
            buffer.set_res(i, memoryview(array))
        self.kept = [buffer, arrays, out]
        return Call(run, lambda: [_ours(array, x[0].ndim == 1) for array in out])


def _ours(found: np.ndarray, single: bool) -> np.ndarray:
    """Return results (states, columns, rows) as (states, rows, columns), vectors as (states, rows)."""
    array = found.swapaxes(1, 2)
    if array.shape[2] == 1:
        array = array[:, :, 0]
    return array[0] if single else array
