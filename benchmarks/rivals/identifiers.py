"""A log, and those who identify a robot from it: jounce, and the regressors of two packages.

All get the URDF file of the model, times, measured positions and torques; all are told that joints have viscous and
Coulomb friction and no other. Rates are for each to find. jounce fits a motion. A regressor gets positions through a
Butterworth filter without a phase, and central differences, as is common practice; NumPy solves for the parameters.
Cutoff, ends and the least speed are the best of a few that were tried.
"""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, filtfilt

from benchmarks.rivals.arms import Arm

Rates = Sequence[np.ndarray]  # q, qd, q2d, each (N, n)
Identify = Callable[["Log"], "Estimate"]

CUTOFF, ORDER = 10.0, 4  # Hz, of the filter: 20 times the fastest harmonic of the motion
ENDS = 0.5  # s at both ends that the filter may disturb
AT_REST = 0.05  # rad/s: slower samples are left out, as noise may turn the sign of their friction


@dataclass(frozen=True)
class Log:
    """What is known of a measurement: the model, its samples, and another motion whose forces are to be predicted.

    `base` maps the inertial parameters, 10 of each body, to those that forces depend on. `excited` are rows of the
    model's regressor along the planned motion over the sizes of the torques: they say what the motion determines.
    """

    title: str
    arm: Arm
    t: np.ndarray
    q: np.ndarray
    Q: np.ndarray
    other: tuple[np.ndarray, ...]
    base: np.ndarray
    excited: np.ndarray


@dataclass(frozen=True)
class Estimate:
    """What is found: base parameters, damping and friction, their covariance if stated, and forces along `Log.other`.

    Base parameters are those of `Log.base`.
    """

    values: np.ndarray
    covariance: np.ndarray | None
    forces: np.ndarray


def by_jounce(log: Log) -> Estimate:
    """Fit a motion to the positions, and identify the robot with it."""
    from jounce import JounceWarning, Motion, load

    robot = load(log.arm.path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", JounceWarning)
        found = robot.identify(Motion.fit(log.t, log.q), log.Q, t=log.t, drives=("damping", "friction"))
    # Its table begins with the base parameters, then all damping, then all friction, as `Estimate.values`.
    count = len(log.base) + 2 * log.arm.n
    values = np.array([row.value for row in found.table[:count]])
    return Estimate(values, found.covariance[:count, :count], found.robot.inverse_dynamics(*log.other))


def by_pinocchio(log: Log) -> Estimate:
    """Solve for the parameters by Pinocchio's regressor."""
    import pinocchio as pin

    model = pin.buildModelFromUrdf(log.arm.path)
    data = model.createData()
    return by_regressor(log, lambda *x: pin.computeJointTorqueRegressor(model, data, *x))


def by_mujoco_sysid(log: Log) -> Estimate:
    """Solve for the parameters by the regressor of the package mujoco_sysid."""
    import mujoco
    import mujoco_sysid as package

    model = mujoco.MjModel.from_xml_path(log.arm.path)
    data = mujoco.MjData(model)

    def regressor(q: np.ndarray, qd: np.ndarray, q2d: np.ndarray) -> np.ndarray:
        data.qpos[:], data.qvel[:], data.qacc[:] = q, qd, q2d
        mujoco.mj_inverse(model, data)
        mujoco.mj_rnePostConstraint(model, data)
        return package.joint_torque_regressor(model, data)

    return by_regressor(log, regressor)


def by_regressor(log: Log, regressor: Callable[..., np.ndarray]) -> Estimate:
    """Return the weighted least squares of the torques, with deviations by the variance of the residuals."""
    x, inner = filtered(log)
    Y, Q = with_friction(regressor, x), log.Q[inner]
    moving = np.abs(x[1]) > AT_REST
    deviations = np.ones(log.arm.n)
    # The first fit weights all torques alike, the second one by the variance of what the first one leaves of each.
    for _ in range(2):
        weights = moving / deviations
        solution, covariance, rank = solved((Y * weights[..., None]).reshape(-1, Y.shape[-1]), (Q * weights).ravel())
        residuals = (Q - Y @ solution) * moving
        deviations = np.sqrt((residuals**2).sum(axis=0) / (moving.sum(axis=0) - rank / log.arm.n))
    # What the forces depend on is the same in every solution of least squares: the covariance is that of it.
    to_base = with_drives(log)
    forces = with_friction(regressor, log.other) @ solution
    return Estimate(to_base @ solution, to_base @ covariance @ to_base.T, forces)


def filtered(log: Log) -> tuple[Rates, slice]:
    """Return q, qd, q2d of a log without its ends, and the slice of its samples."""
    step = log.t[1] - log.t[0]
    q = filtfilt(*butter(ORDER, CUTOFF * 2 * step), log.q, axis=0)
    qd = np.gradient(q, step, axis=0)
    q2d = np.gradient(qd, step, axis=0)
    inner = slice(round(ENDS / step), -round(ENDS / step))
    return (q[inner], qd[inner], q2d[inner]), inner


def with_friction(regressor: Callable[..., np.ndarray], x: Rates) -> np.ndarray:
    """Return the regressor (N, n, 12 n) of inertial parameters, damping and friction."""
    Y = np.array([regressor(*state) for state in zip(*x, strict=True)])
    eye = np.eye(Y.shape[1])
    return np.concatenate([Y, x[1][..., None] * eye, np.sign(x[1])[..., None] * eye], axis=-1)


def with_drives(log: Log) -> np.ndarray:
    """Return the map of inertial parameters, damping and friction to base parameters and these."""
    (k, p), n = log.base.shape, log.arm.n
    return np.block([[log.base, np.zeros((k, 2 * n))], [np.zeros((2 * n, p)), np.eye(2 * n)]])


def solved(A: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """Return the shortest least-squares solution, its covariance where b has unit variance, and the rank."""
    scale = np.linalg.norm(A, axis=0)
    scale[scale == 0] = 1.0
    _, s, V = np.linalg.svd(np.linalg.qr(A / scale, mode="r"))
    rank = int((s > 1e-8 * s[0]).sum())
    inverse = (V[:rank].T / s[:rank] ** 2) @ V[:rank] / np.outer(scale, scale)
    return inverse @ (A.T @ b), inverse, rank
