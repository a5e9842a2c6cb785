"""Many states in one call, on several threads, written into arrays that are already there."""

from time import perf_counter

import numpy as np

import jounce

robot, count = jounce.load("panda"), 100_000
states = np.random.default_rng(0).normal(size=(5, count, robot.n))  # q, qd, q2d, q3d, q4d: batch axes lead

out = tuple(np.empty((3, count, robot.n)))
robot.compile(order=2)  # ahead of the first call, which would do it too
for threads in (1, 2):
    begin = perf_counter()
    robot.inverse_dynamics(*states, out=out, threads=threads)
    print(f"{threads} thread{'s' * (threads > 1)}: {1e9 * (perf_counter() - begin) / count:.0f} ns per state")

one = robot.inverse_dynamics(*states[:, 7])  # a state has the same digits alone and in a batch
assert all((x == y[7]).all() for x, y in zip(one, out, strict=True))
