"""Robots are equal where all their data are."""

import copy
import pickle
from dataclasses import fields, replace

import numpy as np
import pytest

import jounce
from jounce.model.mechanism import Mechanism
from support.robots import on_base


@pytest.fixture(scope="module")
def panda_on_trunk():
    arm = jounce.load("panda", lock={"panda_joint4": -1.0}).mechanism  # with limits, drives and frames
    return jounce.Robot(on_base(arm, np.eye(6), "trunk"))


def changed_value(x):
    """Something of the same type that differs in one place."""
    if isinstance(x, np.ndarray):
        if not x.size:
            return np.zeros(1)
        other = x.copy()
        other.flat[-1] = np.nextafter(np.float64(other.flat[-1]), -np.inf)
        return other
    if isinstance(x, float):
        return float(np.nextafter(x, -np.inf))
    if isinstance(x, str):
        return x + "_"
    if isinstance(x, bool):
        return not x
    if isinstance(x, int):
        return x + 1
    if isinstance(x, tuple):
        return (*x[:-1], changed_value(x[-1])) if x else ("damping",)
    if x is None:
        return jounce.load("panda_elastic").mechanism.elasticity
    last = fields(x)[-1].name
    return replace(x, **{last: changed_value(getattr(x, last))})


@pytest.mark.parametrize(
    "same", [copy.deepcopy, lambda r: pickle.loads(pickle.dumps(r)), lambda r: r.with_drives(False)]
)
def test_copies_are_equal_and_found_among_others(panda_on_trunk, same):
    assert same(panda_on_trunk) is not panda_on_trunk
    assert same(panda_on_trunk) == panda_on_trunk
    assert hash(same(panda_on_trunk)) == hash(panda_on_trunk)
    assert same(panda_on_trunk) in {panda_on_trunk}


def test_what_is_saved_and_loaded_is_equal(panda_on_trunk, tmp_path):
    jounce.save(panda_on_trunk, tmp_path / "arm.yaml")
    assert jounce.load(tmp_path / "arm.yaml") == panda_on_trunk


@pytest.mark.parametrize("name", [field.name for field in fields(Mechanism) if field.compare])
def test_any_difference_counts(panda_on_trunk, name):
    panda_on_trunk = jounce.load("fivebar") if name in ("loops", "closure") else panda_on_trunk
    other = replace(panda_on_trunk.mechanism, **{name: changed_value(getattr(panda_on_trunk.mechanism, name))})
    assert jounce.Robot(other) != panda_on_trunk
    assert panda_on_trunk != jounce.Robot(other)


def test_a_robot_that_floats_is_another_than_one_that_stands(panda_on_trunk):
    arm = jounce.load("panda", lock={"panda_joint4": -1.0}).mechanism
    assert panda_on_trunk == jounce.Robot(on_base(arm, np.eye(6), "trunk"))
    for other in (arm, on_base(arm, np.eye(6), "torso"), on_base(arm, 2 * np.eye(6), "trunk")):
        assert jounce.Robot(other) != panda_on_trunk


def test_robots_of_other_shapes_and_other_things_differ(panda_on_trunk):
    assert panda_on_trunk != jounce.load("panda")
    assert panda_on_trunk != panda_on_trunk.mechanism
    assert panda_on_trunk != "panda"


def test_symbols_are_compared_as_such():
    sympy = pytest.importorskip("sympy")
    m = sympy.Symbol("m")
    assert jounce.load("planar2r", m1=m) == jounce.load("planar2r", m1=sympy.Symbol("m"))
    assert jounce.load("planar2r", m1=m) != jounce.load("planar2r", m1=m + 1)
    assert jounce.load("planar2r", m1=m) != jounce.load("planar2r")


def test_symbols_without_truth_values_are_equal_if_known_to_be(panda_on_trunk):
    casadi = pytest.importorskip("casadi")

    def pulled_by(g):
        gravity = np.zeros(3, dtype=object)
        gravity[2] = g
        return jounce.Robot(replace(panda_on_trunk.mechanism, gravity=gravity))

    x, y = casadi.SX.sym("g"), casadi.SX.sym("g")
    assert pulled_by(x) == pulled_by(x)
    assert pulled_by(2 * x) == pulled_by(2 * x)
    assert pulled_by(x) != pulled_by(y)


def test_whole_numbers_equal_floats():
    assert jounce.load("planar2r", m1=2) == jounce.load("planar2r", m1=2.0)
