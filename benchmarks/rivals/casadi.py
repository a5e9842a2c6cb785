"""CasADi: the equations of adam, differentiated by CasADi, as C code that gcc compiles, called through buffers.

That is what CasADi's page on code generation names as the fastest way. Equations of more than some ten thousand
operations take gcc longer than a run allows: those cells say so.
"""

import subprocess
from collections.abc import Callable, Sequence
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
        self.folder = Path(mkdtemp())
        self.functions: dict[str, ca.Function] = {}
        self.kept: list[object] = []  # buffers and their arrays, which calls read and write without owning them

    def forces(self, x: Sequence[np.ndarray]) -> Call:
        """Q."""
        return self._bind("forces", lambda: [self._forces()], x)

    def force_rates(self, x: Sequence[np.ndarray]) -> Call:
        """Q, and its derivatives along the motion."""
        return self._bind("force_rates", lambda: self._with_rates(self._forces(), 2), x)

    def mass_matrix(self, x: Sequence[np.ndarray]) -> Call:
        """M."""
        return self._bind("mass_matrix", lambda: [self._mass_matrix()], x)

    def mass_matrix_rates(self, x: Sequence[np.ndarray]) -> Call:
        """M and its derivatives along the motion."""
        return self._bind("mass_matrix_rates", lambda: self._with_rates(self._mass_matrix(), 2), x)

    def jacobian(self, x: Sequence[np.ndarray]) -> Call:
        """J."""
        return self._bind("jacobian", lambda: [self._jacobian()], x)

    def jacobian_rate(self, x: Sequence[np.ndarray]) -> Call:
        """J and its derivative along the motion."""
        return self._bind("jacobian_rate", lambda: self._with_rates(self._jacobian(), 1), x)

    def accelerations(self, x: Sequence[np.ndarray]) -> Call:
        """Forward dynamics."""
        return self._bind("accelerations", lambda: [self._accelerations()], x)

    def force_derivatives(self, x: Sequence[np.ndarray]) -> Call:
        """Derivatives of Q by q and qd."""
        return self._bind("force_derivatives", lambda: _jacobians(self._forces(), self.q, self.qd), x)

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

    def _with_rates(self, x: ca.SX, order: int) -> list[ca.SX]:
        """Return an expression and its derivatives along the motion up to an order."""
        found = [x]
        state = ca.vertcat(self.q, self.qd, self.q2d, self.q3d)
        rates = ca.vertcat(self.qd, self.q2d, self.q3d, self.q4d)
        for _ in range(order):
            found.append(ca.reshape(ca.jtimes(ca.vec(found[-1]), state, rates), x.shape))
        return found

    def _bind(self, task: str, results: Callable[[], list[ca.SX]], x: Sequence[np.ndarray]) -> Call:
        """Bind the function of a task to arrays; it is compiled once, for one state and for batches."""
        if task not in self.functions:
            self.functions[task] = self._compile(task, results(), len(x))
        f = self.functions[task]

        # CasADi keeps matrices by columns: a state is a column, and a matrix comes back transposed.
        states = 1 if x[0].ndim == 1 else len(x[0])
        shapes = [f.size_out(i) for i in range(f.n_out())]
        if states > 1:
            f = f.map(states)
        buffer, run = f.buffer()
        arrays = [np.ascontiguousarray(array) for array in x]
        out = [np.empty((states, columns, rows)) for rows, columns in shapes]
        for i, array in enumerate(arrays):
            buffer.set_arg(i, memoryview(array))
        for i, array in enumerate(out):
            buffer.set_res(i, memoryview(array))
        self.kept = [buffer, arrays, out]
        return Call(run, lambda: [_ours(array, x[0].ndim == 1) for array in out])

    def _compile(self, task: str, results: list[ca.SX], count: int) -> ca.Function:
        """Write expressions of the first inputs as C, and compile that."""
        inputs = [self.q, self.qd, self.q2d, self.q3d, self.q4d][:count]
        f = ca.Function(task, inputs, [ca.densify(result) for result in results], {"cse": True})
        generated = Path(f.generate(f"{task}.c", {"main": False, "with_header": False}))
        source, library = self.folder / generated.name, self.folder / f"{task}.so"
        generated.rename(source)
        subprocess.run(["gcc", *FLAGS, str(source), "-o", str(library), "-lm"], check=True)
        return ca.external(task, str(library))


def _jacobians(x: ca.SX, *by: ca.SX) -> list[ca.SX]:
    """Return the derivatives of an expression by some of the inputs."""
    return [ca.jacobian(x, y) for y in by]


def _ours(found: np.ndarray, single: bool) -> np.ndarray:
    """Return results (states, columns, rows) as (states, rows, columns), vectors as (states, rows)."""
    array = found.swapaxes(1, 2)
    if array.shape[2] == 1:
        array = array[:, :, 0]
    return array[0] if single else array
