"""Forces on the hand: a load that acts on it, a payload that moves with it, and the reaction wrench of the ground."""

import numpy as np

import jounce

robot = jounce.load("panda", lock={"panda_finger_joint1": 0.02})
q, qd, q2d, q3d = 0.3 * np.random.default_rng(0).normal(size=(4, robot.n)) + np.array([0, -0.8, 0, -2.4, 0, 1.6, 0.8])

# 20 N push the hand down, in the axes of the world: robot.wrench makes W of it, what the hand exerts, with its rate
W, Wd = robot.wrench(q, qd, body="panda_hand_tcp", force=(0, 0, -20))
Q, Qd = robot.inverse_dynamics(q, qd, q2d, q3d)
pushed, pushed_d = robot.inverse_dynamics(q, qd, q2d, q3d, wrench=(W, Wd))
print("forces of the load:", (pushed - Q).round(2))
J = robot.jacobian(q, body="panda_hand_tcp", frame="world")
assert np.allclose(pushed - Q, -J.T @ [0, 0, 0, 0, 0, -20])  # the motors hold against it

# 2 kg in the hand weigh, and have inertia as well: they belong to the robot
m, hand = robot.mechanism, robot.mechanism.frame("panda_hand")
R, r = hand.T[:3, :3], hand.T[:3, 3]
M = m.M.copy()
M[hand.body] += jounce.inertia_matrix(2.0, R @ [0, 0, 0.1] + r, 0.004 * np.eye(3), rotation=R)
loaded = jounce.Robot.from_screws(m.B, m.X, M, m.parent, names=m.bodies, joint_names=m.coordinates, gravity=m.gravity)
print("forces of the payload:", (loaded.inverse_dynamics(q, qd, q2d) - Q).round(2))

F = loaded.base_wrench(q, qd, q2d)  # (moment; force) of the ground on the robot
print("the ground carries", F[5].round(1), "N; what moves weighs", (9.81 * M[:, 3, 3].sum()).round(1), "N")
