"""The forms of the literature compute what the library computes, and the table counts them."""

import re
from pathlib import Path

import numpy as np
import pytest
from benchmarks.peers import buondonno
from benchmarks.robots import ARMS, load, states

import jounce
from benchmarks import literature
from support.refusals import refusal
from support.robots import relative_error

ROWS = {
    cells[0]: cells[1:]
    for cells in (
        [cell.strip() for cell in line.strip("|\n").split("|")]
        for line in Path(literature.__file__).with_name("LITERATURE.md").read_text(encoding="utf-8").splitlines()
        if line.startswith("| ")
    )
}


@pytest.mark.parametrize("order", [0, 1, 2, 3])
@pytest.mark.parametrize("arm", ARMS)
def test_the_recursion_has_the_forces_of_the_library(arm, order):
    robot, rates = load(arm), states(7, 5, order)
    expected = robot.inverse_dynamics(*rates)
    bodies = buondonno.links(robot.mechanism)
    found = [buondonno.inverse_dynamics(bodies, robot.gravity, [x[k] for x in rates]) for k in range(5)]
    for Q, exact in zip(np.swapaxes(found, 0, 1), expected if order else (expected,), strict=True):
        assert relative_error(Q, exact) < 1e-12


def test_the_recursion_takes_trees():
    m = load(ARMS[1]).mechanism
    tree = jounce.Robot.from_screws(m.B, m.X, m.M, parent=[-1, 0, 1, 1, 3, 0, 5])
    rates = states(7, 1, 2)
    found = buondonno.inverse_dynamics(buondonno.links(tree.mechanism), tree.gravity, [x[0] for x in rates])
    for Q, exact in zip(found, tree.inverse_dynamics(*rates), strict=True):
        assert relative_error(Q, exact[0]) < 1e-12


def test_the_recursion_refuses_other_joints():
    sliding = jounce.Robot.from_screws([np.eye(4)], [[0, 0, 0, 0, 0, 1]], [np.eye(6)])
    refusal(lambda: buondonno.links(sliding.mechanism), "revolute joints about axes through the origins")


@pytest.mark.parametrize("arm", ARMS)
@pytest.mark.parametrize("form", literature.FORMS)
def test_every_form_agrees_with_the_library(form, arm):
    rates = [x[0] for x in states(7, 1, literature.ORDER)]
    found = literature.FORMS[form](load(arm).mechanism, rates)
    for Q, exact in zip(found, load(arm).inverse_dynamics(*rates), strict=True):
        assert relative_error(Q.astype(float), exact) < 1e-12


def test_errors_are_those_of_doubles_against_fifty_digits():
    form = "Buondonno and De Luca: recursion of vectors"
    assert all(0 < error < 1e-14 for error in literature.errors(form, ARMS[0], 2))


def test_operations_as_written_are_those_of_the_formulas():
    x = np.array([[literature.Counted(1.0)] * 2] * 2)
    literature.Counted.operations = 0
    y = x @ x - x @ np.eye(2)
    assert literature.Counted.operations == 2 * (8 + 4) + 4
    assert [[z.value for z in row] for row in y] == [[1, 1], [1, 1]]
    literature.Counted.operations = 0
    _ = 1 - np.cos(x[0, 0]) * -x[0, 0]
    assert literature.Counted.operations == 3


@pytest.mark.parametrize("form", [name for name in literature.FORMS if "dense" not in name])
def test_the_page_states_the_operations_of_today(form):
    traced = [literature.program(form, ARMS[0], order).operations for order in range(3)]
    counts = [literature.written(form), *traced, literature.program(form, ARMS[1], 2).operations]
    assert ROWS[form][:5] == [f"{count:,}" for count in counts]


def test_the_page_states_the_operations_of_native_code():
    assert ROWS["jounce, `kernel`: factored"][1:5] == literature.factored_counts()


def test_every_error_on_the_page_is_rounding():
    errors = [float(cell) for form, cells in ROWS.items() if re.search("[a-z]: |jounce", form) for cell in cells[-2:]]
    assert len(errors) == 2 * (len(literature.FORMS) + 1)
    assert max(errors) < 1e-14
