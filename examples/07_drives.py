"""Armature, damping and friction of the drive trains, which a file states, as parts of Q and of its derivatives."""

import numpy as np

import jounce

base = jounce.load("iiwa14").mechanism
drives = {"armature": np.full(7, 0.3), "damping": np.full(7, 0.5), "friction": np.full(7, 2.0)}  # kg m^2, N m s, N m
robot = jounce.Robot.from_screws(base.B, base.X, base.M, drives=drives)
rng = np.random.default_rng(0)
q, qd, q2d, q3d = rng.normal(size=(4, 7))

rigid, rigid_d = robot.inverse_dynamics(q, qd, q2d, q3d)  # drives are stated, and left out until they are selected
driven = robot.with_drives(eps=0.1)  # friction is smoothed over 0.1 rad/s
Q, Qd = driven.inverse_dynamics(q, qd, q2d, q3d)
share, share_d = robot.drive_forces(q, qd, q2d, q3d)
assert np.allclose(Q - rigid, driven.drive_forces(q, qd, q2d))
print("rigid ", rigid.round(2), "\ndrives", (Q - rigid).round(2), "\nrate  ", (Qd - rigid_d).round(2))

for term in ("armature", "damping", "friction"):
    print(f"{term:9}", robot.drive_forces(q, qd, q2d, terms=term).round(2))
assert np.allclose(driven.mass_matrix(q) - robot.mass_matrix(q), np.diag(drives["armature"]))
