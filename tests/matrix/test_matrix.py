"""The matrix: every quantity of every robot by every backend, with rates, or the reason why it does not exist."""

import re
from dataclasses import replace
from itertools import starmap

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import jounce
from jounce.dynamics.quantities import QUANTITIES
from matrix.axes import ABSENT, BACKENDS, MOST, ROBOTS, Case, lacks, serves, with_all_drives
from support.bases import moved_mechanisms
from support.random_loops import LOOPED
from support.refusals import refusal
from support.robots import GOLDEN_NAMES, golden, rates_of, relative_error

CELLS = [
    (name, backend, cell)
    for name, case in ROBOTS.items()
    for backend in case.backends.split(", ")
    for cell in case.cells
    if serves(backend, *cell)
]
OWN_BACKENDS = ("closed form", "paper", "native")  # the others trace and compile for seconds
COMPILED_IN_PART = ("iiwa", "floats", "moving ground", "several screws")  # the forest has all they have but the base


def of_quantities(cells):
    """Cells backend by backend and quantity by quantity: a sweep meets each quantity by each, with robots in turn."""
    order = list(QUANTITIES)
    return sorted(cells, key=lambda cell: (cell[1], order.index(cell[2][0]), cell[2][1] or "", cell[2][2]))


KERNELS = of_quantities(cell for cell in CELLS if cell[1] == "native" and cell[0] in COMPILED_IN_PART)
SPATIAL_LOOPS = of_quantities(cell for cell in CELLS if cell[1] == "closed form" and cell[0] in LOOPED)
OTHERS = of_quantities(cell for cell in CELLS if cell not in KERNELS and cell not in SPATIAL_LOOPS)
MISSING = [
    (backend, name, words) for backend, said in ABSENT.items() for words, names in said.items() for name in names
]


def label(name, backend, cell):
    quantity, body, frame = cell
    return "-".join((name, backend, f"{quantity}:{body}:{frame}" if body else quantity))


def assert_agrees(name, backend, cell):
    """The results of a cell are those of the recursion."""
    request = ROBOTS[name].request(*cell, MOST.get(backend))
    assert_rates_agree(BACKENDS[backend](request), request.expected, ROBOTS[name].tolerance)


def assert_rates_agree(found, expected, tolerance, least=1e-3):
    """Norm-wise, each rate by itself; what is zero in exact arithmetic is rounding of other rates, or of terms."""
    size = max(np.abs(y).max() for y in expected)
    for rate, (x, y) in enumerate(zip(found, expected, strict=True)):
        of_states = y[: len(x)]
        assert x.shape == of_states.shape
        scale = max(np.abs(of_states).max(), 1e-2 * size, least)
        assert np.abs(x - of_states).max() <= tolerance * scale, f"rate {rate}"


@pytest.mark.sweep(sum(cell[1] in OWN_BACKENDS for cell in OTHERS) * 2 // 3)  # each quantity is met by each backend
@pytest.mark.parametrize(
    ("name", "backend", "cell"),
    [
        pytest.param(*cell, id=label(*cell), marks=() if cell[1] in OWN_BACKENDS else pytest.mark.outside)
        for cell in OTHERS
    ],
)
def test_backends_agree_with_the_recursion(name, backend, cell):
    assert_agrees(name, backend, cell)


@pytest.mark.sweep(len(KERNELS) // 3)  # of the four robots in turn
@pytest.mark.parametrize(("name", "backend", "cell"), KERNELS, ids=starmap(label, KERNELS))
def test_kernels_of_other_robots_agree(name, backend, cell):
    assert_agrees(name, backend, cell)


@pytest.mark.sweep(len(SPATIAL_LOOPS) // 3)
@pytest.mark.parametrize(("name", "backend", "cell"), SPATIAL_LOOPS, ids=starmap(label, SPATIAL_LOOPS))
def test_closed_forms_of_spatial_loops_agree(name, backend, cell):
    assert_agrees(name, backend, cell)


OF_TREES = [row for row in QUANTITIES.values() if row.everywhere and len(row.laws) > 1 and not row.takes.forces]


@settings(max_examples=12)
@given(drawn=moved_mechanisms(), moving=st.booleans(), acting=st.booleans())
def test_methods_agree_on_drawn_trees(drawn, moving, acting):
    """Of all quantities; accelerations undo forces in tests of their own."""
    m = with_all_drives(*drawn) if acting else drawn[0]
    case = Case(lambda: jounce.Robot(m), "", order=3, large=2, moving=moving and not m.floats, bodies=())
    for row in OF_TREES:
        for frame in row.gives.frames or ("body",):
            request = case.request(row.name, None, frame)
            for method in [*row.laws][1:]:
                if method == "paper":  # which has no third rates
                    request = replace(case, order=2).request(row.name, None, frame)
                try:
                    assert_rates_agree(request.by(method), request.expected, 1e-11, 0.1)
                except AssertionError as error:
                    raise AssertionError(f"{row.name} in frame {frame} by {method}: {error}") from error


@pytest.mark.parametrize("backend", BACKENDS)
def test_every_quantity_is_computed_or_refused(backend):
    computed = {cell[0] for _, other, cell in CELLS if other == backend}
    refused = {name for other, name, _ in MISSING if other == backend}
    assert computed | refused == set(QUANTITIES)
    assert not computed & refused


@pytest.mark.parametrize(("backend", "name", "words"), MISSING, ids=["-".join(x[:2]) for x in MISSING])
def test_what_no_robot_has_is_refused(backend, name, words):
    if backend == "symbolic":
        with pytest.raises(AttributeError, match=words):
            getattr(ROBOTS["drives"].symbolic, name)
        return
    case = next(case for case in ROBOTS.values() if name in case.only and not lacks(case, QUANTITIES[name]))
    request = case.request(name, None, "body")
    refusal(lambda: BACKENDS[backend](request), words)


@pytest.mark.parametrize("case", ROBOTS.values(), ids=ROBOTS)
def test_what_a_robot_lacks_is_refused(case):
    for row in QUANTITIES.values():
        if words := lacks(case, row):
            refusal(lambda row=row: getattr(case.robot, row.name)(*np.zeros((row.takes.rates, case.robot.n))), words)


@pytest.mark.parametrize("case", ROBOTS.values(), ids=ROBOTS)
def test_reasons_end_a_sentence_on_quantity_and_robot(case):
    reasons = [row.obstacle(case.robot.mechanism) for row in QUANTITIES.values()]
    assert all(re.match(r":? \w", reason) for reason in reasons if reason)


METHODS = {"recursion": 4, "closed_form": 4, "paper": 2, "kernel": 2}  # the orders that are compared


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", GOLDEN_NAMES)
def test_values_are_those_of_lagrange_in_50_digits(name, method):
    """Data that share nothing with the formulas of the paper; forces of wrenches are those without masses."""
    m, cases = golden(name)
    assert len(cases) >= 5
    robot, light = jounce.Robot(m), jounce.Robot(replace(m, M=0 * m.M))
    q, W = (list(map(np.stack, zip(*x, strict=True))) for x in zip(*map(rates_of, cases), strict=True))
    order = METHODS[method]
    wrenches = {"wrench": tuple(W[: order + 1]), "method": method}
    compared = {
        "Q Qd Q2d Q3d Q4d": robot.inverse_dynamics(*q[: order + 3], **wrenches),
        "M Mdot Mddot": robot.mass_matrix(*q[:3], method=method),
        "Qgrav Qgrav_dot Qgrav_ddot": robot.gravity_forces(*q[:3], method=method),
        "Qext Qext_dot Qext_ddot": light.inverse_dynamics(*q[:5], wrench=tuple(W[:3]), method=method),
    }
    for keys, found in compared.items():
        sharp = method == "kernel" and name == "iiwa" and keys.startswith("Q ")
        for key, x in zip(keys.split(), found, strict=False):
            for one, case in zip(x, cases, strict=True):
                assert relative_error(one, case[key]) < (1e-13 if sharp else 1e-12), (case["name"], key)
