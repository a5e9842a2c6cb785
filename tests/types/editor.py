"""A user's program as an editor sees it: ten methods, each called wrongly."""

import numpy as np

import jounce

robot = jounce.load("panda")
q, qd, q2d, q3d, Q = np.zeros((5, robot.n))

robot.mass_matrix("0.1 0.2")
robot.inverse_dynamics(q, qd, q2d, wrench="payload")
robot.forward_dynamics(q, qd, "10 N m")
robot.coriolis_matrix(q, qd, form="passive")
robot.gravity_forces(q, method="rnea")
robot.jacobian(q, body="panda_hand", frame="local")
robot.poses({"panda_joint1": "0.1"})
robot.regressor(q, qd, q2d, drives="viscosity")
robot.kinetic_energy(q, "0.1")
robot.loop_wrenches(q, qd, q2d, q3d="0.1")
