"""Encoders that stand still at reversals for longer than a parabola stays within a step."""

import numpy as np
import pytest

from jounce.motion import resmoothing
from jounce.motion.resmoothing import Reversals

T = np.arange(0, 8, 1e-3)


def reported_swing(play, bits, frequency=1.0):
    """An encoder behind some play, on a link that swings by 0.5 rad, and its step."""
    q, step = 0.5 * np.sin(2 * np.pi * frequency * T), 2 * np.pi / 2**bits
    rotor = q.copy()
    for k in range(1, len(T)):
        rotor[k] = np.clip(rotor[k - 1], q[k] - play / 2, q[k] + play / 2)
    return step * np.floor(rotor / step + 0.3), step


@pytest.mark.parametrize("bits", [12, 14, 17])
@pytest.mark.parametrize("frequency", [0.7, 1.0, 2.0])
def test_encoders_that_follow_stand_as_long_as_a_parabola(bits, frequency):
    found = resmoothing.find_reversals(T, *reported_swing(0.0, bits, frequency))
    assert found.count >= 2 * 8 * frequency - 2
    assert (found.long, found.show_play) == (0, False)


@pytest.mark.parametrize(("steps", "shown"), [(0.2, False), (8.0, True)])
@pytest.mark.parametrize("bits", [12, 14])
def test_play_shows_where_it_is_larger_than_a_step(bits, steps, shown):
    play = steps * 2 * np.pi / 2**bits
    found = resmoothing.find_reversals(T, *reported_swing(play, bits))
    assert found.show_play == shown
    if shown:  # while the link crosses the play from rest, and comes to rest within a step
        crossing = np.arccos(1 - play / 0.5) / (2 * np.pi)
        assert crossing < found.usual < 1.4 * crossing


def test_the_acceleration_is_that_of_the_reversal():
    """A parabola of 8 rad/s^2 from one side to the other: 2 sqrt(2 s / a) at most."""
    t, step = np.arange(-0.1, 0.1, 1e-4), 1e-4
    q = step * np.floor(4 * t**2 / step)
    [longest] = {resmoothing.find_reversals(t, q, step).usual}
    assert longest == pytest.approx(2 * np.sqrt(2 * step / 8), abs=2e-4)
    assert resmoothing.find_reversals(t, q, step).long == 0


def test_reversals_near_the_ends_or_of_few_steps_do_not_count():
    small = 15 * 1e-3 * np.sin(2 * np.pi * T)  # of 15 steps
    assert resmoothing.find_reversals(T, 1e-3 * np.floor(small / 1e-3), 1e-3).count == 0
    q, step = reported_swing(0.0, 14)
    assert resmoothing.find_reversals(T[:260], q[:260], step).count == 0, "the only one is 10 ms before the end"


@pytest.mark.parametrize(
    ("count", "long", "shown"),
    [
        (resmoothing.MIN_REVERSALS, resmoothing.MIN_REVERSALS, True),
        (resmoothing.MIN_REVERSALS - 1, resmoothing.MIN_REVERSALS - 1, False),
        (40, 31, True),
        (40, 30, False),
    ],
)
def test_most_of_enough_reversals_show_play(count, long, shown):
    assert resmoothing.MAX_LONG_SHARE * 40 == 30
    assert Reversals(count, long, 0.01).show_play == shown


def test_a_joint_that_rests_has_none():
    assert resmoothing.find_reversals(T, np.zeros_like(T), 1e-3) == Reversals(0, 0, 0.0)
