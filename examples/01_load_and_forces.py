"""Load a robot from its URDF, and compute the joint forces Q of a state with their time derivatives Qd and Q2d."""

from pathlib import Path

import numpy as np

import jounce

robot = jounce.load(Path(__file__).parent / "panda.urdf", lock={"panda_finger_joint1": 0.02})
print(robot, robot.joint_names)

q = np.array([0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8])  # rad
qd, q2d, q3d, q4d = np.random.default_rng(0).normal(size=(4, robot.n))

Q = robot.inverse_dynamics(q, qd, q2d)  # N m
Q, Qd, Q2d = robot.inverse_dynamics(q, qd, q2d, q3d, q4d)  # each further rate gives one more derivative
print("Q  ", Q.round(2), "\nQd ", Qd.round(2), "\nQ2d", Q2d.round(2))

M, C, Qgrav = robot.mass_matrix(q), robot.coriolis_matrix(q, qd), robot.gravity_forces(q)
assert np.allclose(M @ q2d + C @ qd + Qgrav, Q)  # the equations of motion

V = robot.twists(q, qd, body="panda_hand_tcp", frame="world")  # (angular; linear)
J = robot.jacobian(q, body="panda_hand_tcp", frame="world")
assert np.allclose(J @ qd, V)
