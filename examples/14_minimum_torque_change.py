"""Minimum torque change of a 7-joint arm under limits, around obstacles: IPOPT with exact Hessians in native code."""

import time
from math import factorial

import numpy as np
from scipy.interpolate import BSpline

import casadi
import jounce

arm = jounce.load("panda", lock={"panda_finger_joint1": 0.02}).with_limits(effort_rate=100)  # N m/s
begin = np.array([0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8])  # rad
end = np.array([1.6, 0.4, 0.0, -1.2, 0.0, 1.8, 0.8])
seconds, pieces, margin = 1.0, 9, 0.98  # of limits, which hold at the points only
obstacles = [  # half-spaces normal . x <= distance, in m, for points of the arm
    ("panda_hand_tcp", (0.6, 0.8, 0.0), 0.56),  # a wall in the way of the hand
    ("panda_hand_tcp", (0.0, 0.0, -1.0), -0.45),  # a table below it
    ("panda_link6", (0.0, 0.0, 1.0), 0.7),  # a shelf above the wrist
]

# Each joint follows a spline of degree 5 from rest to rest: its first and last three coefficients are the postures.
breaks = np.linspace(0, seconds, pieces + 1)
spline = BSpline(np.r_[[0.0] * 5, breaks, [seconds] * 5], np.eye(pieces + 5), 5)
t = np.linspace(0, seconds, 4 * pieces + 1)
w = np.r_[0.5, np.ones(t.size - 2), 0.5] * t[1]  # the trapezoidal rule

opti = casadi.Opti()
c = opti.variable(arm.n, pieces - 1)
coefficients = casadi.horzcat(np.outer(begin, np.ones(3)), c, np.outer(end, np.ones(3)))
rates = [coefficients @ casadi.sparsify(casadi.DM(spline(t, k).T)) for k in range(4)]  # q to q3d at all points
Q, Qd = arm.casadi_function(order=1, native=True, points=t.size)(*rates)
opti.minimize(casadi.dot(Qd**2, np.tile(w, (arm.n, 1))) / 2e3)
for x, most in ((rates[1], arm.limits.velocity), (Q, arm.limits.effort), (Qd, arm.limits.effort_rate)):
    bound = margin * np.tile(most, t.size)
    opti.subject_to(opti.bounded(-bound, casadi.vec(x), bound))
for body, normal, distance in obstacles:
    pose = arm.casadi_function("poses", 0, body=body, native=True, points=t.size)(rates[0])
    opti.subject_to(sum(n * pose[i, 3::4] for i, n in enumerate(normal)) <= distance - 0.002)
opti.set_initial(c, begin[:, None] + np.outer(end - begin, np.linspace(0, 1, pieces - 1)))
opti.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes"})

clock = time.process_time()
found = opti.solve()  # raises if it does not converge
print(f"{opti.return_status()}: {opti.stats()['iter_count']} iterations, {time.process_time() - clock:.2f} s")
print(f"integral of |Qd|^2 / 2: {1e3 * found.value(opti.f):.0f} N^2 m^2/s")

C = found.value(coefficients).T
powers = np.array([spline(breaks[:-1], k) @ C / factorial(k) for k in range(5, -1, -1)])
motion = jounce.Motion.piecewise(breaks, powers, joint_names=arm.joint_names)
print(arm.check(motion))  # between the points too
places = {body: arm.poses(motion(np.linspace(0, seconds, 501), 0)[0], body=body)[:, :3, 3] for body, *_ in obstacles}
for body, normal, distance in obstacles:
    print(f"{body}: {distance - (places[body] @ normal).max():.3f} m from the obstacle")
assert arm.check(motion).ok
