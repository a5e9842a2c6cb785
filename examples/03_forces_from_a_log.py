"""Measured joint angles, with noise: smooth them, and compute joint forces with their standard deviations."""

import numpy as np

import jounce

robot = jounce.load("iiwa14")
rng, t = np.random.default_rng(0), np.arange(0, 4, 0.002)  # 500 Hz
true = np.sin(np.outer(t, 1 + 0.2 * np.arange(7)))
log = {"t": t} | {name: q + 1e-5 * rng.normal(size=len(t)) for name, q in zip(robot.joint_names, true.T, strict=True)}

motion = jounce.load_motion(log, robot)  # or the path of a CSV, NPZ, MAT or JSON lines file, or of a ROS bag
print(motion.source)
along = robot.forces_along(motion)
Q, Qd, Q2d = along.forces
assert along.deviations is not None
for name, force, deviation in zip(("Q", "Qd", "Q2d"), along.forces, along.deviations, strict=True):
    print(f"{name:4} up to {np.abs(force).max():8.3g}, standard deviation {np.median(deviation):.2g}")

rates = [np.sin(np.outer(t, w) + k * np.pi / 2) * w**k for k in range(3) for w in [1 + 0.2 * np.arange(7)]]
error = np.abs(Q - robot.inverse_dynamics(*rates))[100:-100]  # away from the ends
print(f"largest error of Q: {error.max():.2g} N m")
