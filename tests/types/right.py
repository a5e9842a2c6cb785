"""A user's program without mistakes: type checkers find none, and it runs."""

import numpy as np
from numpy.typing import NDArray

import jounce

robot = jounce.load("panda", drives=True, lock={"panda_finger_joint1": 0.02}, gravity=(0, 0, -9.81))
same: bool = robot == jounce.load("panda").with_drives(["armature", "damping"]) or robot.n == 7
assert same

q, qd, q2d, q3d, q4d = np.zeros((5, robot.n))
samples: NDArray[np.float64] = np.zeros((10, robot.n))
rates = [q, qd, q2d, q3d, q4d]
named = dict.fromkeys(robot.joint_names, 0.1)

Q = robot.inverse_dynamics(q, qd, q2d)
Q, Qd, Q2d = robot.inverse_dynamics(q, qd, q2d, q3d, q4d)
Q, Qd, Q2d, Q3d = robot.inverse_dynamics(*rates, q4d)
Q, Qd, Q2d = robot.inverse_dynamics(*rates, method="recursion")
Q = robot.inverse_dynamics(samples, 0 * samples, [0.0] * robot.n, wrench={"panda_hand": [0, 0, 0, 0, 0, 5.0]})
Q, Qd = robot.inverse_dynamics(named, named, named, dict.fromkeys(named, samples[:, 0]), out=[0 * samples, 0 * samples])
M = robot.mass_matrix(range(robot.n))
assert M.shape == (robot.n, robot.n)
M, Md = robot.mass_matrix(q, qd=qd)
C = robot.coriolis_matrix(q.tolist(), [[0.1] * robot.n] * 3, form="skew")
J, Jd = robot.jacobian(q, qd, body="panda_hand", frame="world")
energy: float = robot.kinetic_energy(q, qd) + robot.potential_energy(q)
W, Wd = robot.wrench(q, qd, body="panda_hand", force=((0, 0, -1), (0, 0, 0)), point=[0, 0, 0.1])
F, Fd = robot.base_wrench(q, qd, q2d, q3d, wrench=(W, Wd))
F, Fd = robot.base_wrench(q, qd, q2d, q3d, wrench=({"panda_hand": W[0]}, {"panda_hand": Wd[0]}))

kernel = robot.compile(order=1)
Q, Qd = kernel(samples, q, q, q, threads=2)
gq = robot.compile("gravity_forces", 0, product="vjp")(q, q)
bound = kernel.bind(q, qd, q2d, q3d, out=(Q[0].copy(), Qd[0].copy()))
bound()


def highest(kernel: jounce.Kernel, limits: jounce.Limits) -> np.float64:
    return np.max(kernel(q, qd, q2d, q3d)[0] / limits.effort)


highest(kernel, robot.limits)
m = np.array([1, 2], dtype=object)
planar = jounce.load("planar2r", m1=m[0], L2=0.5)
pendulum = jounce.Robot.from_screws(
    [np.eye(4)], [[0, 1, 0, 0, 0, 0]], [jounce.inertia_matrix(2.0, [0, 0, 1], 0 * np.eye(3))]
)
flying = jounce.Robot.from_screws([np.eye(4)], [[0, 1, 0, 0, 0, 0]], [np.eye(6)], base=np.eye(6), base_name="trunk")
floating = jounce.load("g1", base="floating")
arm = jounce.Robot.from_dh([{"theta": 0, "d": 0, "a": 1, "alpha": 0}], np.eye(6)[None], "standard")
arm = jounce.Robot.from_dh([[1.0, 0, 0, 0]], np.eye(6)[None], "modified", types=["revolute"])
motion = jounce.load_motion({"t": range(20), "joint1": [0.1] * 20, "joint2": np.zeros(20)}, planar, degree=7)
along = planar.forces_along(motion, order=0)
