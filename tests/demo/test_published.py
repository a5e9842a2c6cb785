"""The paper's figure of Q: its points are met by the authors' code with the wrench, and by nothing else."""

from dataclasses import replace

import numpy as np
import pytest

from jounce._report.paper_example import (
    FIGURE,
    FORMULAS,
    STEINER,
    WRENCH,
    deviations,
    example,
    forces_of,
    published,
    read_figure,
)
from jounce.engine.engine import Engine
from jounce.io.bundled import iiwa14

FIGURE_RESOLUTION = 4e-4  # N m, of the plot


@pytest.fixture(scope="module")
def examples():
    return example("paper", 2000), example("paper-wrench", 2000)


def test_the_figure_has_points_of_every_joint():
    t, Q = read_figure()
    assert np.array_equal(t, np.arange(21) / 4)
    assert Q.shape == (21, 7)
    assert np.abs(Q).max() == 100.3943


def test_the_authors_code_with_the_wrench_meets_the_figure(examples):
    alone, loaded = examples
    t, Q = read_figure()
    by_joint = np.abs(published(loaded, t)[0] - Q).max(0)
    assert np.all(by_joint < FIGURE_RESOLUTION)
    assert np.all(np.abs(published(alone, t)[0] - Q).max(0) > 1e4 * FIGURE_RESOLUTION)


def test_the_figure_knows_its_gravity(examples):
    """It is 9.80665 m/s^2: 9.81 is visible, in the second joint."""
    _, loaded = examples
    t, Q = read_figure()
    other = replace(loaded, robot=Engine(iiwa14((0, 0, -9.81))))
    assert np.abs(published(other, t)[0] - Q).max(0).argmax() == 1
    assert 0.018 < np.abs(published(other, t)[0] - Q).max() < 0.020


def test_in_the_wrist_the_figure_is_the_wrench(examples):
    """Joints 5 to 7 turn against it alone: without it the formulas look nothing like the figure."""
    alone, loaded = examples
    t, Q = read_figure()
    without, given = (forces_of(found.robot, found.motion, t)[0][:, 4:] for found in (alone, loaded))
    assert np.all(np.abs(without - Q[:, 4:]).max(0) > 0.8 * np.abs(Q[:, 4:]).max(0))
    assert np.all(np.abs(given - Q[:, 4:]).max(0) < 0.02 * np.abs(Q[:, 4:]).max(0))


def test_what_each_cause_makes_out(examples):
    found = deviations(*examples)
    assert found[FORMULAS].largest == (0, 0, 0)
    np.testing.assert_allclose(found[STEINER].shares, [0.031, 0.034, 0.081], atol=1e-3)
    np.testing.assert_allclose(found[WRENCH].shares, [0.186, 0.196, 0.413], atol=1e-3)
    np.testing.assert_allclose(found[FIGURE].largest, [21.5, 94.4, 577], rtol=2e-3)
    np.testing.assert_allclose(found[FIGURE].shares, [0.199, 0.230, 0.392], atol=1e-3)
    assert [found[cause].from_figure for cause in (FORMULAS, WRENCH, STEINER)] == pytest.approx(
        [20.1, 3.19, 20.1], 1e-2
    )
    assert found[FIGURE].from_figure < FIGURE_RESOLUTION
