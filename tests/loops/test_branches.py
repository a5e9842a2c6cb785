"""Branches of closed robots: positions along a straight line stay on that of the start, against circles that meet."""

import numpy as np
import pytest

import jounce
from jounce import JounceError
from support.linkages import elbows, elbows_along, fivebar
from support.refusals import expect_refusal

FIVEBARS = 30


def random_fivebar(rng):
    """The lengths of a random five-bar, its shoulders and elbows at the start, and the side on which circles meet."""
    while True:
        base, left, right = rng.uniform(0.2, 2), rng.uniform(0.3, 1.5, 2), rng.uniform(0.3, 1.5, 2)
        shoulders, side = rng.uniform(-3, 3, 2), rng.choice([-1, 1])
        found, reach = elbows(base, left, right, shoulders, side)
        if reach > 1e-3:
            return (base, left, right), shoulders, found, side


def joint_order(shoulders, found):
    return np.array([shoulders[0], found[0], shoulders[1], found[1]])


def branch_outcome(rng):
    """What a random five-bar returns for a random step of up to 2 rad: "right", "wrong", "refused" or "outside"."""
    lengths, shoulders, found, side = random_fivebar(rng)
    robot = fivebar(*lengths, start=joint_order(shoulders, found))
    stop = shoulders + rng.uniform(-2, 2, 2)
    turned, reach = elbows_along(*lengths, shoulders, stop, side)
    try:
        q = robot.coordinates(stop, method="recursion")
    except JounceError:
        return "outside" if reach < 1e-12 else "refused"
    if reach < -1e-12:
        return "wrong"
    return "right" if np.abs(q - joint_order(stop, found + turned)).max() < 1e-6 else "wrong"


def test_straight_lines_stay_on_their_branch():
    rng = np.random.default_rng(11)
    found = [branch_outcome(rng) for _ in range(FIVEBARS)]
    assert found.count("wrong") == 0
    assert found.count("refused") == 0
    assert found.count("right") > FIVEBARS / 3


def test_one_step_is_many_small_ones(bundled_fivebar):
    """Of two steps of the predictor one had crossed to elbows (-4.137, 5.438), where nothing is near singular."""
    start, stop = bundled_fivebar.mechanism.closure.start, np.array([1.543625, -2.797733])
    q = start
    for s in np.linspace(0, 1, 400)[1:]:
        q = bundled_fivebar.coordinates(joint_order(start[[0, 2]] + s * (stop - start[[0, 2]]), q[[1, 3]]))
    np.testing.assert_allclose(q[[1, 3]], [-2.045, 3.346], atol=1e-3)
    np.testing.assert_allclose(bundled_fivebar.coordinates(stop), q, atol=1e-9)
    motion = jounce.Motion.polynomial(np.stack([start[[0, 2]], stop - start[[0, 2]]], axis=1), 1.0)
    static = bundled_fivebar.forces_along(motion, [0.0, 1.0], order=0).forces[0]
    np.testing.assert_allclose(static[-1], bundled_fivebar.inverse_dynamics(q, stop - start[[0, 2]], [0, 0]), atol=1e-9)


@pytest.mark.parametrize(("base", "left", "right", "start", "side", "stop"), [
    (0.716, (1.324, 0.825), (0.973, 0.983), (1.941, 1.671), -1, (0.857, 1.628)),
    (1.412, (0.475, 1.422), (1.134, 0.653), (-2.385, -1.688), -1, (-2.828, -3.585)),
    (1.413, (1.186, 0.855), (0.381, 1.461), (1.272, -0.864), 1, (-0.695, 0.137)),
])  # fmt: skip
def test_a_line_that_leaves_the_workspace_is_refused(base, left, right, start, side, stop):
    """Outside it two branches have ended: the determinant changes its sign twice, and only tangents differ."""
    start, stop = np.array(start), np.array(stop)
    found, _ = elbows(base, left, right, start, side)
    _, reach = elbows_along(base, left, right, start, stop, side)
    assert reach < -0.01
    with expect_refusal("no straight line of the coordinates leads there"):
        fivebar(base, left, right, joint_order(start, found)).coordinates(stop, method="recursion")


def test_positions_of_a_batch_along_a_line_are_those_of_each(bundled_fivebar):
    start = bundled_fivebar.mechanism.closure.start[[0, 2]]
    line = start + np.linspace(0, 1, 101)[:, None] * (np.array([1.543625, -2.797733]) - start)
    q = bundled_fivebar.coordinates(line)
    assert np.abs(np.diff(q, axis=0)).max() < 0.2
    for k in (30, 77, 100):
        assert (bundled_fivebar.coordinates(line[k]) == q[k]).all()
