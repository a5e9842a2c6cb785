"""How far loops are open, in words: angles up to half a turn, and what the digits of a file leave of closed ones."""

import re

import numpy as np
import pytest

import jounce
from jounce.dynamics import loop_assembly
from jounce.model.frame import Frame
from support.refusals import refusal


def flat_loop(out_of_plane, turned=0.0):
    """A planar four-bar linkage whose last pivot lies off the plane of the others: no position closes it exactly."""
    rod = jounce.inertia_matrix(1.0, [0.25, 0, 0], np.diag([0.01, 0.02, 0.02]))
    along = np.eye(4)
    along[0, 3] = 0.5
    ground = np.eye(4)
    ground[0, 3], ground[2, 3] = 0.5, out_of_plane
    ground[1:3, 1:3] = [[np.cos(turned), -np.sin(turned)], [np.sin(turned), np.cos(turned)]]
    arm = jounce.Robot.from_screws([np.eye(4), along, along], [[0, 0, 1, 0, 0, 0]] * 3, [rod] * 3)
    tip = Frame("tip", 2, along)
    pivot = Frame("pivot", -1, ground)
    return arm, jounce.Loop(tip, pivot, "revolute", np.array([0.0, 0.0, 1.0]))


ROUNDED, OPEN = "closes to", "is open by"
START = {"joint1": 1.2, "joint2": -1.2, "joint3": -1.9}


@pytest.mark.parametrize(("off", "words"), [(9e-8, ROUNDED), (4e-6, ROUNDED), (2e-5, OPEN), (0.01, OPEN)])
def test_gaps_below_the_digits_of_files_are_not_called_open(off, words):
    arm, loop = flat_loop(off)
    said = refusal(lambda: arm.closed([loop], ["joint1"], start=START), words)
    assert ("state more digits" in said) == (words == ROUNDED)
    assert float(re.search(r"(?:to|by) ([\d.e-]+) m", said)[1]) == pytest.approx(off, rel=0.1)


@pytest.mark.parametrize("turn", [0.5, 2.0, 3.1])
def test_angles_of_gaps_are_those_between_axes(turn):
    arm, loop = flat_loop(0.0, turn)
    said = loop_assembly._describe_gap(loop, np.array([2 * np.tan(turn / 2), 0, 0.1, 0, 0]))
    assert said == f"0.1 m and {turn:.3g} rad"
    said = refusal(lambda: arm.closed([loop], ["joint1"], start=START), "is open by")
    assert float(re.search(r"and ([\d.e-]+) rad", said)[1]) == pytest.approx(turn, rel=1e-2)
