"""A Panda on springs: positions and torques of its motors for a motion of its links, and what Q2d has in them."""

import numpy as np

import jounce

HOME = [0, -0.785, 0, -2.356, 0, 1.571, 0.785]
GOAL = [1.0, 0.2, -0.4, -1.6, 0.5, 2.3, -0.4]

arm = jounce.load("panda_elastic")  # its file states springs and rotors; arm.elastic(stiffness, rotor) others

t = np.linspace(0, 1, 101)
s = t**5 * (126 - 420 * t + 540 * t**2 - 315 * t**3 + 70 * t**4)  # four rates are zero at both ends: tau does not jump
samples = np.array(HOME) + np.outer(s, np.subtract(GOAL, HOME))
motion = jounce.Motion.through(t, samples, joint_names=arm.joint_names)

along = arm.motors_along(motion)
[tau], theta = along.torques, along.positions[0]
lead = np.degrees(np.abs(theta - along.rates[0]).max(axis=0))
rigid = arm.inverse_dynamics(*along.rates[:3]) + arm.elasticity.rotor * along.rates[2]
print("joint          motor leads by   largest torque   of it by Q2d")
for j, joint in enumerate(arm.joint_names):
    share = np.abs(tau - rigid)[:, j].max()
    print(f"{joint}   {lead[j]:8.2f} deg   {np.abs(tau[:, j]).max():8.2f} N m   {share:8.2f} N m")
