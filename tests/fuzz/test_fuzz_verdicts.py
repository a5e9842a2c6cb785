"""Verdicts where a file or a log leaves something open: massless bodies, inertias of no body, vibrations."""

import warnings
from dataclasses import replace

import numpy as np
from hypothesis import strategies as st

import jounce
from fuzz.trees import random_tree, robot_of_tree
from jounce.spatial import inertia

SEEDS = st.integers(0, 2**32 - 1)
ARM = jounce.load("planar2r")
DENSE = 20_001  # times of the truth
BEYOND = 1.02  # times a bound: a truth that is surely broken


def tree_and_motion(rng):
    """A random tree whose joints have limits of their own, and a motion of all its coordinates."""
    tree = random_tree(rng, nb := int(rng.integers(1, 6)))
    robot = robot_of_tree(replace(tree, coupling=np.eye(nb), offset=np.zeros(nb)))
    motion = jounce.Motion.polynomial(rng.normal(size=(robot.n, 4)), 1.0).with_step(0.05)
    return robot, motion


def with_inertias(robot, M):
    """The robot with other inertia matrices (nb, 6, 6)."""
    return robot.with_inertial_parameters(inertia.parameters(np.asarray(M)).ravel())


def forces_at_random(rng, robot):
    """Q at random states, (20, n)."""
    return robot.inverse_dynamics(*rng.normal(size=(3, 20, robot.n)))


def check_massless(seed):
    """A force row is undecided if and only if no mass, whatever it is at its own bodies, could have made its force."""
    rng = np.random.default_rng(seed)
    robot, motion = tree_and_motion(rng)
    M = np.array(robot.mechanism.M) * (rng.random(robot.mechanism.nb) < 0.5)[:, None, None]
    bare = with_inertias(robot, M)
    Q = forces_at_random(rng, bare)
    idle = np.abs(Q).max(axis=0) <= 1e-9 * max(1.0, np.abs(Q).max())
    bounds = np.abs(bare.forces_along(motion, order=0).forces[0]).max(axis=0) * rng.choice([0.9, 1.1], robot.n)
    found = bare.with_limits(effort=np.where(bounds > 1e-9, bounds, 1.0)).check(motion)
    for j, joint in enumerate(robot.joint_names):
        row = next(row for row in found.table if (row.joint, row.limit) == (joint, "effort"))
        if idle[j]:
            assert (row.verdict, row.violations) == ("undecided", ()), row
            assert "moves no inertia" in row.cause
        else:
            assert row.verdict != "undecided", row
    assert found.ok == all(row.verdict == "kept" for row in found.table)


def check_inertias(seed):
    """No body that can exist is nearer, and a row is undecided if and only if the nearest one changes its verdict."""
    rng = np.random.default_rng(seed)
    robot, motion = tree_and_motion(rng)
    M, body = np.array(robot.mechanism.M), int(rng.integers(robot.mechanism.nb))
    M[body] = inertia.inertia_matrix(rng.uniform(0.1, 3), rng.normal(size=3), np.eye(3))
    m, h, _ = inertia.moments(M[body])
    axes, spread = np.linalg.qr(rng.normal(size=(3, 3)))[0], rng.uniform(-1, 1, 3) * 10 ** rng.uniform(-3, 1)
    M[body] = inertia.from_moments(m, h, axes * spread @ axes.T + h @ h.T / m)
    nearest = inertia.nearest_consistent(M[body])
    distance = np.linalg.norm(inertia.moments(nearest)[2] - inertia.moments(M[body])[2])
    for _ in range(50):  # brute force: bodies near to it, none nearer
        L = np.linalg.cholesky(inertia.moments(nearest)[2] - h @ h.T / m + 1e-9 * np.eye(3))
        L = L + rng.normal(size=(3, 3)) * 10 ** rng.uniform(-4, 0)
        assert np.linalg.norm(L @ L.T + h @ h.T / m - inertia.moments(M[body])[2]) >= distance * (1 - 1e-9) - 1e-9
    given, other = (with_inertias(robot, of) for of in (M, [inertia.nearest_consistent(of) for of in M]))
    peaks = [np.abs(arm.forces_along(motion, order=0).forces[0]).max(axis=0) for arm in (given, other)]
    bounds = (peaks[0] + peaks[1]) / 2 * rng.choice([0.5, 1, 2], robot.n)
    bounds = np.where(bounds > 1e-9, bounds, 1.0)
    rows, others = (arm.with_limits(effort=bounds).check(motion).table for arm in (given, other))
    for row, of_nearest in zip(rows, others, strict=True):
        wide = abs(row.ratio - 1) > 1e-3 < abs(of_nearest.ratio - 1)  # beyond what polynomials between rows decide
        if wide and "moves no inertia" not in (row.cause or ""):
            assert (row.verdict == "undecided") == ((row.ratio > 1) != (of_nearest.ratio > 1)), (row, of_nearest)


def planted_log(rng):
    """A log of planar2r that vibrates, its rate, and its true rates q, qd, q2d at dense times."""
    rate, count = 10 ** rng.uniform(2, 3.5), int(rng.integers(100, 3000))
    t = np.arange(count) / rate
    dense = np.linspace(t[0], t[-1], DENSE)
    slow, size = 2 * np.pi * rng.uniform(0.1, 0.5, 2) / t[-1], rng.choice([0.0, 0.1, 1.0], 2)
    f, phase = rate * rng.uniform(1 / 7, 0.49), rng.uniform(0, 2 * np.pi, 2)
    A = 10 ** rng.uniform(-4, -3) * rng.choice([[1, 0], [0, 1], [1, 1]])
    steady = rng.choice([0.0, 0.3]) * rng.normal(size=2)

    def rates(t):
        s, v = slow * t[:, None], 2 * np.pi * f * t[:, None] + phase
        w = 2 * np.pi * f
        return (
            size * np.sin(s) + steady * t[:, None] + A * np.sin(v),
            size * slow * np.cos(s) + steady + A * w * np.cos(v),
            -size * slow**2 * np.sin(s) - A * w**2 * np.sin(v),
        )

    noise = rng.choice([0.0, 1e-7, 1e-6, 1e-5, 2e-5]) * rng.normal(size=(count, 2))
    step = rng.choice([0.0, 2 * np.pi / 2**17, 2 * np.pi / 2**20])
    q = rates(t)[0] + noise
    return t, step * np.round(q / step) if step else q, rate, rates(dense)


def check_vibrations(seed):
    """A log that vibrates between a seventh and half of its rate is refused, broken or undecided if the truth is."""
    rng = np.random.default_rng(seed)
    t, q, rate, truth = planted_log(rng)
    Q = ARM.inverse_dynamics(*truth)
    peaks = [np.abs(x).max(axis=0) for x in (truth[1], truth[2], Q)]
    bounds = [peak / rng.choice([0.5, 1.1, 2.0, 30.0, 1000.0], 2) + 1e-9 for peak in peaks]
    options = rng.choice([{}, {"bandwidth": rate * rng.uniform(0.002, 0.05)}])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", jounce.JounceWarning)
        try:
            motion = jounce.Motion.fit(t, q, allow_noise=bool(rng.random() < 0.7), angles="rad", **options)
        except jounce.JounceError:
            return
        kinds = ("velocity", "acceleration", "effort")
        found = ARM.with_limits(**dict(zip(kinds, bounds, strict=True))).check(motion)
    for kind, peak, bound in zip(kinds, peaks, bounds, strict=True):
        for j, joint in enumerate(ARM.joint_names):
            row = next(row for row in found.table if (row.joint, row.limit) == (joint, kind))
            if peak[j] > BEYOND * bound[j]:
                assert row.verdict != "kept", (row, peak[j] / bound[j], motion.notes)


def test_massless_robots(budget):
    budget.attack(check_massless, 20, seed=SEEDS)


def test_inertias_of_no_body(budget):
    budget.attack(check_inertias, 20, seed=SEEDS)


def test_vibrations(budget):
    budget.attack(check_vibrations, 20, seed=SEEDS)
