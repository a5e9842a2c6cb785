"""Data are equal by value, functions by identity."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import jounce
from jounce.core.equality import are_equal

T = np.linspace(0, 2, 101)
LOG = {"t": T, "joint1": np.sin(T), "joint2": np.cos(T)}
ARM = jounce.load("planar2r")

MAKERS = {
    "drives": lambda: jounce.load("panda").drives,
    "contact": lambda: jounce.Contact("foot", "plane", place=(0.1, 0, 0), friction=0.5, sole=(0.1, 0.05)),
    "loop": lambda: jounce.load("fivebar").mechanism.loops[0],
    "limits": lambda: jounce.load("panda").limits,
    "terms": lambda: jounce.load_motion("paper", jounce.load("iiwa14")),
    "spline": lambda: jounce.Motion.through(T, np.c_[np.sin(T), np.cos(T)]),
    "smoothed": lambda: jounce.load_motion(LOG, ARM, 0),
    "commands": lambda: jounce.load_motion(LOG, ARM, 0, as_="commands"),
}


@pytest.mark.parametrize("make", MAKERS.values(), ids=MAKERS)
def test_data_made_twice_are_equal(make):
    one, other = make(), make()
    assert one is not other
    assert one == other
    assert hash(one) == hash(other)
    assert one != 3


def test_a_single_other_number_makes_data_unequal():
    one = jounce.load("panda").drives
    damping = one.damping.copy()
    damping[3] += 1e-12
    assert one != replace(one, damping=damping)
    loop = jounce.load("fivebar").mechanism.loops[0]
    assert loop != replace(loop, joint="revolute")
    contact = jounce.Contact("foot", "point")
    assert contact != jounce.Contact("foot", "point", place=(0, 0, 1e-9))
    motion = jounce.load_motion(LOG, ARM, 0)
    assert motion != jounce.load_motion(LOG | {"joint2": np.cos(T) + 1e-9 * (T[50] == T)}, ARM, 0)


def test_mechanisms_are_equal_by_identity():
    one, other = jounce.load("planar2r").mechanism, jounce.load("planar2r").mechanism
    assert one == one
    assert one != other


class Holder:
    def __init__(self, x):
        self.x = x


EQUAL = {
    "nan": (np.nan, float("nan")),
    "arrays with nan": (np.array([1, np.nan]), np.array([1, np.nan])),
    "mappings": ({"a": np.ones(2)}, {"a": np.ones(2)}),
    "attributes": (Holder(np.ones(2)), Holder(np.ones(2))),
    "kinds of numbers": (np.ones(2), np.ones(2, dtype=int)),
    "objects": (np.array(["x", None], dtype=object), np.array(["x", None], dtype=object)),
}
UNEQUAL = {
    "types": (1, 1.0),
    "shapes": (np.ones(2), np.ones((2, 1))),
    "keys": ({"a": 1}, {"b": 1}),
    "lengths": ((1, 2), (1,)),
    "functions": (lambda: 1, lambda: 1),
    "arguments of functions": (partial(int, "1"), partial(int, "2")),
    "attributes": (Holder(1), Holder(2)),
}


@pytest.mark.parametrize(("one", "other"), EQUAL.values(), ids=EQUAL)
def test_equal_values(one, other):
    assert are_equal(one, other)


@pytest.mark.parametrize(("one", "other"), UNEQUAL.values(), ids=UNEQUAL)
def test_unequal_values(one, other):
    assert not are_equal(one, other)
