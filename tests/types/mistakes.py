"""A user's program full of mistakes, each of which type checkers find before it runs."""

import numpy as np

import jounce

robot = jounce.load("panda")
jounce.load("panda", drive=True)  # mistake: drives
jounce.load("panda", drives="dampings")  # mistake
jounce.load("g1", base="free")  # mistake
robot.with_drives(["armature", "viscosity"])  # mistake
robot.locked(["panda_finger_joint1"])  # mistake: {joint: value}
robot.total_mass()  # mistake

q, qd, q2d, q3d, q4d = np.zeros((5, robot.n))
robot.mass_matrix("0.1 0.2")  # mistake
robot.mass_matrix({"panda_joint1": "0.1"})  # mistake
robot.coriolis_matrix(q)  # mistake: qd
robot.coriolis_matrix(q, qd, form="passive")  # mistake
robot.jacobian(q, body="panda_hand", frame="local")  # mistake
robot.poses(q, body="panda_hand", frame="world")  # mistake: poses have no frame
robot.inverse_dynamics(q, qd, q2d, wrenches={"panda_hand": [0.0] * 6})  # mistake: wrench
robot.gravity_forces(q, method="rnea")  # mistake
robot.wrench(q, body="panda_hand", force=[0, 0, 1], frame="spatial")  # mistake

Q, Qd = robot.inverse_dynamics(q, qd, q2d, q3d, q4d)  # mistake: Q2d
M, Md, M2d = robot.mass_matrix(q, qd)  # mistake: q2d
robot.mass_matrix(q, qd).trace()  # mistake: a tuple
robot.mass_matrix(q).tracee()  # mistake

robot.compile("mass_matrx")  # mistake
kernel = robot.compile("jacobian", order=1, body="panda_hand")
J, Jd, J2d = kernel(q, qd)  # mistake: J and Jd
kernel(q, qd, frame="world")  # mistake: robot.compile has fixed it
robot.codegen("fortran")  # mistake
robot.casadi_function("inertia_matrix")  # mistake
jounce.inertia_matrix("2 kg", [0, 0, 0], np.eye(3))  # mistake

jounce.load_motion("paper")  # mistake: robot
motion = jounce.load_motion("paper", robot, angles="degrees")  # mistake
robot.forces_along("paper")  # mistake: a Motion
