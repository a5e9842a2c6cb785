"""A double pendulum in a vertical plane, its motion under drives of its first joint or of both, and its encoders."""

import numpy as np
from scipy.integrate import solve_ivp

import jounce

DAMPING = np.array([0.02, 0.01])  # N m s/rad
RATE, SECONDS = 500, 10.0


def double_pendulum() -> jounce.Robot:
    """Two links of 0.6 kg, which hang at q = (-pi/2, 0)."""
    elbow = np.eye(4)
    elbow[0, 3] = 0.2
    links = [(0.15, 4e-3), (0.26, 1.1e-2)]  # m from the joint, kg m^2 about the COM
    M = [jounce.inertia_matrix(0.6, [c, 0, 0], np.diag([1e-4, theta, theta])) for c, theta in links]
    joints = [[0, 0, 1, 0, 0, 0]] * 2
    return jounce.Robot.from_screws([np.eye(4), elbow], joints, M, gravity=[0, -9.81, 0], name="double pendulum")


def swing(
    robot: jounce.Robot, seed: int, bits: int, passive: bool, noise: float = 0.02
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, positions that encoders of some bits report, and torques with noise; `passive`: no motor at joint 2."""
    rng = np.random.default_rng(seed)
    frequencies, phases = rng.uniform(0.3, 1.6, (2, 5)), rng.uniform(0, 2 * np.pi, (2, 5))
    sizes = rng.normal(size=(2, 5)) * [[0.3], [0.0 if passive else 0.12]]

    def torques(t):
        return (sizes * np.sin(2 * np.pi * frequencies * np.asarray(t)[..., None, None] + phases)).sum(axis=-1)

    def rates(t, y):
        return np.append(y[2:], robot.forward_dynamics(y[:2], y[2:], torques(t) - DAMPING * y[2:]))

    t = np.arange(0, SECONDS, 1 / RATE)
    start = [-np.pi / 2, 0, 0, 0] + 0.3 * rng.normal(size=4) * [1, 1, 0, 0]
    q = solve_ivp(rates, (0, SECONDS), start, t_eval=t, rtol=1e-9, atol=1e-11, method="DOP853").y[:2].T
    step = 2 * np.pi / 2**bits
    reported = np.floor(q / step + rng.uniform(size=2)) * step
    return t, reported, torques(t) + noise * rng.normal(size=q.shape)
