"""Native code bound to its arrays: the shortest call, for control loops."""

from time import perf_counter

import numpy as np

import jounce

robot = jounce.load("iiwa14")
kernel = robot.compile("inverse_dynamics", order=2)  # kept on disk for the next process
q, qd, q2d, q3d, q4d = np.zeros((5, robot.n))
Q, Qd, Q2d = np.empty((3, robot.n))
compute = kernel.bind(q, qd, q2d, q3d, q4d, out=(Q, Qd, Q2d))  # reads and writes these very arrays

begin, count = perf_counter(), 10_000
for k in range(count):
    q[:] = 1e-4 * k  # the next state
    compute()
print(f"{1e6 * (perf_counter() - begin) / count:.2f} us per state, its assignment included")
assert np.allclose(Q2d, robot.inverse_dynamics(q, qd, q2d, q3d, q4d)[2])

jacobian = robot.compile("jacobian", order=1, body="link7", frame="world")
J, Jd = jacobian(q, qd)
print("J", J.shape, "Jd", Jd.shape)
