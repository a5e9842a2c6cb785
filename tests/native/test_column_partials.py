"""The columns form of partial derivatives: the recursion's results, whatever the tree, the base and the batch."""

import numpy as np
import pytest

import jounce
from jounce.dynamics.computation import Computation
from jounce.native import code_forms, memory_layout
from jounce.native.memory_layout import LongCompilationError
from support.natives import assembled, target
from support.quantities import tupled
from support.robots import floating, random_mechanism, relative_error
from support.states import random_inputs

QUANTITIES = memory_layout.COLUMN_QUANTITIES
KINDS = ["revolute", "helical", "prismatic", "revolute", "revolute", "prismatic"]
TREES = {"chain": [-1, 0, 1, 2, 3, 4], "star": [-1, 0, 0, 0, 0, 0], "forest": [-1, 0, -1, 2, 0, 3]}


@pytest.fixture(autouse=True)
def _fresh_layouts():
    """Layouts are kept by what they are of, not by the limit."""
    memory_layout.column_layout.cache_clear()
    yield
    memory_layout.column_layout.cache_clear()


@pytest.fixture
def _always(monkeypatch):
    """Small robots take this form too."""
    monkeypatch.setattr(memory_layout, "MIN_VELOCITIES_IN_COLUMNS", 1)


def tree_robot(tree, afloat=False):
    rng = np.random.default_rng(len(tree))
    mechanism = random_mechanism(rng, TREES[tree], KINDS, [1.0, 2.0, 0.5, 3.0, 1.0, 0.2])
    return jounce.Robot(floating(mechanism, rng) if afloat else mechanism)


def native_partials(found, quantity, way="host"):
    computation = Computation(quantity, 0, base=found.mechanism.floats)
    texts = code_forms.kernel_modules(found.mechanism, computation, target(way))
    assert "@sweep" in texts[0]
    return assembled(texts, computation.signature(found.mechanism), way), computation.signature(found.mechanism)


def traced_results(found, quantity, arrays):
    """The results of one state by the recursion, operation by operation."""
    computation = Computation(quantity, 0, base=found.mechanism.floats)
    program = code_forms.trace_program(found.mechanism, computation)
    values = np.array(program.run(np.concatenate([np.ravel(x) for x in arrays]).tolist()))
    return [
        values[port.start : port.end].reshape(port.shape) for port in computation.signature(found.mechanism).outputs
    ]


@pytest.mark.sweep(5)
@pytest.mark.usefixtures("_always")
@pytest.mark.parametrize("way", ["host", "4 lanes, 16 registers", "2 lanes"])
@pytest.mark.parametrize("afloat", [False, True])
@pytest.mark.parametrize("tree", TREES)
@pytest.mark.parametrize("quantity", QUANTITIES)
def test_columns_are_those_of_the_recursion(quantity, tree, afloat, way):
    found = tree_robot(tree, afloat)
    function, signature = native_partials(found, quantity, way)
    arrays = random_inputs(signature.inputs, 19, seed=1)
    results = tupled(function(*arrays))
    for i in (0, 7, 18):
        one = [np.ascontiguousarray(x[i]) for x in arrays]
        for x, y, z in zip(tupled(function(*one)), results, traced_results(found, quantity, one), strict=True):
            np.testing.assert_array_equal(x, y[i])
            assert relative_error(x, z) < 1e-11
    strided = tupled(function(*(np.asfortranarray(x) for x in arrays)))
    for x, y in zip(strided, results, strict=True):
        np.testing.assert_array_equal(x, y)


@pytest.mark.usefixtures("_always")
@pytest.mark.parametrize("quantity", QUANTITIES)
def test_what_is_not_finite_spoils_its_own_state_alone(quantity):
    function, signature = native_partials(tree_robot("forest", afloat=True), quantity)
    arrays = random_inputs(signature.inputs, 11, seed=2)
    expected = tupled(function(*arrays))
    for x in arrays:
        spoilt = [y.copy() for y in arrays]
        k = next(k for k, y in enumerate(arrays) if y is x)
        spoilt[k].reshape(11, -1)[4, -1] = np.nan
        with np.errstate(invalid="ignore"):
            results = tupled(function(*spoilt))
        for y, z in zip(results, expected, strict=True):
            assert np.isnan(y[4]).all()
            np.testing.assert_array_equal(np.delete(y, 4, axis=0), np.delete(z, 4, axis=0))


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_large_robots_of_joints_of_one_screw_take_this_form(quantity, monkeypatch):
    m = tree_robot("chain").mechanism
    asked = Computation(quantity, 0)
    for least, taken in ((m.nv, True), (m.nv + 1, False)):
        monkeypatch.setattr(memory_layout, "MIN_VELOCITIES_IN_COLUMNS", least)
        memory_layout.column_layout.cache_clear()
        assert (memory_layout.column_layout(asked, m) is not None) == taken
    monkeypatch.setattr(memory_layout, "MIN_VELOCITIES_IN_COLUMNS", 1)
    others = [(Computation(quantity, 0, wrench=True), m), (asked, jounce.load("delta").mechanism)]
    following = random_mechanism(np.random.default_rng(0), [-1, 0], KINDS[:2], [1, 1], mimic=True)
    others.append((asked, following))
    others.append((Computation("mass_matrix", 0), m))
    for computation, mechanism in others:
        assert memory_layout.column_layout(computation, mechanism) is None


@pytest.mark.usefixtures("_always")
def test_nobody_waits_for_the_factors_of_long_chains():
    m = tree_robot("chain").mechanism
    operations = sum(k * (k + 1) for k in range(1, m.nv + 1))
    seconds = operations * code_forms.SECONDS_PER_STEP
    forward, inverse = (Computation(name, 0) for name in sorted(QUANTITIES))
    code_forms.kernel_modules(m, forward, target("host"), 1.01 * seconds)
    code_forms.kernel_modules(m, inverse, target("host"), 0.99 * seconds)
    with pytest.raises(LongCompilationError):
        code_forms.kernel_modules(m, forward, target("host"), 0.99 * seconds)
