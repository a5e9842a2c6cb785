"""Accelerations and their rates in the loop form: those of the recursion, whatever the tree, the base and the batch."""

from dataclasses import replace

import numpy as np
import pytest

import jounce
from jounce.dynamics.computation import Computation
from jounce.model.drive_trains import AMOUNTS, DRIVE_TERMS, Drives
from jounce.native import code_forms, memory_layout
from support.natives import assembled, target
from support.quantities import tupled
from support.robots import floating, random_mechanism, relative_error
from support.states import random_inputs

KINDS = ["revolute", "helical", "prismatic", "revolute"]
TREES = {"chain": [-1, 0, 1, 2], "star": [-1, 0, 0, 0], "forest": [-1, 0, -1, 2]}
CASES = [
    ("chain", "fixed", {}, 2, "host"),
    ("star", "fixed", {"wrench": True}, 1, "2 lanes"),
    ("forest", "afloat", {"base": True}, 1, "4 lanes, 16 registers"),
    ("forest", "fixed", {"base": True}, 1, "host"),
    ("chain", "driven", {"base": True, "wrench": True}, 0, "2 lanes"),
    ("star", "driven", {}, 1, "host"),
    ("chain", "afloat", {"base": True, "wrench": True}, 1, "host"),
]


def mechanism(tree, case):
    rng = np.random.default_rng(len(tree))
    m = random_mechanism(rng, TREES[tree], KINDS, [1.0, 2.0, 0.5, 3.0])
    if case == "driven":
        amounts = [AMOUNTS[term] for term in DRIVE_TERMS]
        terms = {name: rng.uniform(0.1, 1, m.nb) for name in (*amounts, "rest", "load_eps")}
        speeds = dict.fromkeys(("eps", "stribeck_velocity"), np.full(m.nb, 0.5))
        drives = Drives(**speeds, **terms, load_friction=np.zeros(m.nb))
        return replace(m, drives=drives, acting=DRIVE_TERMS)
    return floating(m, rng) if case == "afloat" else m


@pytest.mark.sweep(5)
@pytest.mark.parametrize(("tree", "case", "options", "order", "way"), CASES)
def test_accelerations_are_those_of_the_recursion(tree, case, options, order, way, monkeypatch):
    m, computation = mechanism(tree, case), Computation("forward_dynamics", order, **options)
    signature = computation.signature(m)
    program = code_forms.trace_program(m, computation)
    monkeypatch.setattr(memory_layout, "MAX_STRAIGHT_NUMBERS", 0)
    texts = code_forms.kernel_modules(m, computation, target(way))
    assert "@accelerate" in texts[0]
    function = assembled(texts, signature, way)
    arrays = random_inputs(signature.inputs, 19)
    results = tupled(function(*arrays))
    for i in (0, 7, 18):
        one = [np.ascontiguousarray(x[i]) for x in arrays]
        values = np.array(program.run(np.concatenate([np.ravel(x) for x in one]).tolist()))
        for x, y, port in zip(tupled(function(*one)), results, signature.outputs, strict=True):
            np.testing.assert_array_equal(x, y[i])
            assert relative_error(x, values[port.start : port.end]) < 1e-9
    for x, y in zip(tupled(function(*(np.asfortranarray(x) for x in arrays))), results, strict=True):
        np.testing.assert_array_equal(x, y)
    arrays[-1].reshape(19, -1)[4, -1] = np.nan
    with np.errstate(invalid="ignore"):
        spoilt = tupled(function(*arrays))
    assert np.isnan(spoilt[-1][4]).all()
    for x, y in zip(spoilt, results, strict=True):
        np.testing.assert_array_equal(np.delete(x, 4, axis=0), np.delete(y, 4, axis=0))


def test_robots_of_many_numbers_take_the_loop(monkeypatch):
    m, asked = mechanism("chain", "fixed"), Computation("forward_dynamics", 0)
    numbers = memory_layout._count_numbers(m)
    for most, straight in ((numbers * 4 / 3, True), (numbers * 4 / 3 - 1, False)):
        monkeypatch.setattr(memory_layout, "MAX_STRAIGHT_NUMBERS", most)
        assert memory_layout.is_straight(asked, m) == straight
    following = random_mechanism(np.random.default_rng(0), [-1, 0, 1], KINDS[:3], [1.0] * 3, mimic=True)
    assert memory_layout.is_straight(asked, following)
    assert memory_layout.is_straight(asked, jounce.load("delta").mechanism)
