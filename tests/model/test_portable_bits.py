"""Data of robot files have the same bits on every processor: those of Python's floats, from which BLAS may differ."""

import math

import numpy as np

import jounce
from jounce.model import screws
from jounce.model.frame import UNIT_ROUNDING
from jounce.spatial.inertia import symmetric_matrix
from support.robots import random_rotation


def test_inertias_about_the_com_come_to_the_same_bits():
    for mass, x, y, z, *six in np.random.default_rng(0).normal(size=(200, 10)).tolist():
        M = jounce.inertia_matrix(mass, [x, y, z], symmetric_matrix(np.array(six)))
        squares = y * y + z * z, x * x + z * z, x * x + y * y
        assert np.diag(M[:3, :3]).tolist() == [six[i] + mass * s for i, s in zip((0, 3, 5), squares, strict=True)]
        products = six[1] - mass * (x * y), six[2] - mass * (x * z), six[4] - mass * (y * z)
        assert (M[0, 1], M[0, 2], M[1, 2]) == products


def test_the_same_rotations_and_screws_are_made_exact():
    """Those that are farther from unit length than rounding, by the products of Python's floats."""
    rng, left = np.random.default_rng(1), []
    for _ in range(500):
        T, X = np.eye(4), np.zeros(6)
        T[:3, :3] = random_rotation(rng) * (1 + rng.uniform(-1.2e-15, 1.2e-15))
        columns = T[:3, :3].T.tolist()
        errors = [abs(a * d + b * e + c * f - (i == j))
                  for i, (a, b, c) in enumerate(columns) for j, (d, e, f) in enumerate(columns)]  # fmt: skip
        left += [np.array_equal(screws.exact_pose(T, "T"), T)]
        assert left[-1] == (max(errors) <= UNIT_ROUNDING)
        X[:3] = columns[0]
        x, y, z = columns[0]
        assert np.array_equal(screws.exact_screw(X, "X"), X) == (
            abs(math.sqrt(x * x + y * y + z * z) - 1) <= UNIT_ROUNDING
        )
    assert {*left} == {True, False}
