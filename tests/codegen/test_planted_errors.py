"""An error of 1e-9 of the values fails the test that is generated with the code, in every output of every quantity."""

import re

import numpy as np
import pytest
from test_codegen import (
    ALL,
    LANGUAGES,
    OF_MOTORS,
    PRODUCTS,
    PROGRAMS,
    ROBOTS,
    STANDING,
    computed,
    passes,
    passes_in_python,
    texts,
    write_files,
)

import jounce
from jounce._codegen.test_vectors import MAX_TERMS_OVER_VALUES, TEST_TOLERANCES, ZERO_OVER_TERMS, Vectors
from jounce.dynamics.quantities import QUANTITIES
from jounce.dynamics.quantities.row import CLOSED
from support.tools import needs

PLANTED = 1 + 1e-9
STATES = 3
ROBOTS |= {  # forces of 1e7 N m, whose gradients by wrenches are lengths
    "heavy": lambda: jounce.load("planar2r", m1=4e5, m2=4e5),
    "fivebar": lambda: jounce.load("fivebar"),
}
LOOPS = tuple(row.name for row in QUANTITIES.values() if CLOSED in row.needs and row.name != "passive_accelerations")
ASKED = {  # robot: what is generated and how
    "planar2r": ((*ALL, *PRODUCTS), {"order": 1, "wrench": True}),
    "heavy": (PRODUCTS, {"order": 1, "wrench": True}),
    "panda": (("forward_dynamics", "forward_dynamics_second_partials"), {"order": 0}),
    "wound": (OF_MOTORS, {"order": 0}),
    "stiffening": (("motor_positions", "motor_torques"), {"order": 1}),
    "fivebar": (("inverse_dynamics", *LOOPS), {"order": 0}),
    "standing": (STANDING, {"order": 1, "wrench": True, "moving_base": True}),
}


def wrong_by(factor, code, output):
    """Code, all of whose entries of an output are too large by a factor."""
    entry = rf"(?m)^([ \t]*)({output}[\[(][^=\n]*) = ([^\n;]+)(;?)$"
    changed, count = re.subn(entry, rf"\1\2 = \3\4\n\1\2 = {factor!r} * \2\4", code)
    assert count
    return changed


@pytest.mark.parametrize(
    ("robot", "output"), [(robot, output) for robot, (outputs, _) in ASKED.items() for output in outputs]
)
def test_the_generated_test_notices_it(robot, output):
    options = ASKED[robot][1] | {"outputs": (output,)}
    if not QUANTITIES[output.partition(".")[0].partition(":")[0]].takes.wrenches:
        options |= {"wrench": False}
    files = texts(robot, "python", STATES, **options)
    [test] = [text for name, text in files.items() if re.fullmatch(r"test_.*\.py", name)]
    [code] = [text for name, text in files.items() if re.fullmatch(r"(?!test_).*\.py", name)]
    assert passes_in_python(code, test)
    _, [expected] = computed(robot, STATES, "recursion", **options)
    for name, values in expected.outputs.items():
        assert np.abs(values).max() > 0, name
        assert not passes_in_python(wrong_by(PLANTED, code, name), test), name


@pytest.mark.parametrize(
    ("lang", "robot", "quantity", "name"),
    [
        *(
            pytest.param(lang, "standing", "contact_wrenches", "f", marks=needs(*LANGUAGES[lang][0]))
            for lang in PROGRAMS
        ),
        pytest.param("casadi", "planar2r", "inverse_dynamics", "Q", marks=needs(*LANGUAGES["casadi"][0])),
    ],
)
def test_the_generated_test_of_every_language_notices_it(lang, robot, quantity, name, tmp_path):
    """Of contact wrenches, which follow from a solution of equations; CasADi has Hessians, which take long."""
    files = texts(robot, lang, STATES, order=0, outputs=(quantity,), moving_base=robot == "standing")
    [code] = [file for file, text in files.items() if re.search(rf"(?m)^\s*{name}[\[(].* = ", text)]
    passed, output = passes(write_files(tmp_path, files), lang)
    assert passed, output
    (tmp_path / code).write_text(wrong_by(PLANTED, files[code], name))
    passed, output = passes(tmp_path, lang)
    [error] = re.findall(r"worst relative error (\S+)", output)
    assert not passed
    assert 1e-12 < float(error) <= 1.1e-9


def scale(values, magnitude):
    """The scale of an output of one state."""
    return Vectors({}, {}, {"x": np.array([values])}, {"x": np.array([magnitude])}).scale("x")


@pytest.mark.parametrize(
    ("value", "terms", "expected"),
    [
        (2.0, 1.0, 2.0),  # nothing cancels
        (2.0, 150.0, 150.0),  # terms that cancel leave their rounding errors
        (2.0, 250.0, 2.0 * MAX_TERMS_OVER_VALUES),  # a wrong ninth digit counts, however large the terms are said to be
        (2.0, 1.9 / ZERO_OVER_TERMS, 2.0 * MAX_TERMS_OVER_VALUES),
        (2.0, 2.1 / ZERO_OVER_TERMS, 2.1 / ZERO_OVER_TERMS),  # the value is the rounding error of its terms
        (0.0, 5.0, 5.0),
        (0.0, 0.0, 1.0),
    ],
)
def test_errors_are_compared_with_values_and_with_what_cancels(value, terms, expected):
    assert scale(value, terms) == pytest.approx(expected, rel=5e-3)
    if value and expected <= 1e3 * value:
        assert value * (PLANTED - 1) / scale(value, terms) > TEST_TOLERANCES[False]
