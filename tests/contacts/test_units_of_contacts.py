"""Robots on contacts in other units of length and mass: the same wrenches, ratios and refusals."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import jounce
from contacts.test_contact_ratios import RATE, G, X, Y, cart, cop_ratio, hinged
from jounce.limits.check import find_limited_breaks
from jounce.limits.limited_motion import validate_limits
from support.refusals import expect_refusal
from support.units import SI, UNIT_IDS, UNITS, in_units

ANY_UNITS = pytest.mark.parametrize("u", UNITS, ids=UNIT_IDS)


def sliding_in_units(u, amplitude, stop, count=1):
    """The slider of a cart moves by sin, and other joints rest; the base does too."""
    t = np.arange(0, stop, 0.02)
    q = u.length * amplitude * np.sin(RATE * t)[:, None] * (np.arange(count) == 0)
    return t, jounce.Motion.through(t, q).with_base(None, np.eye(4))


@pytest.mark.sweep(6)
@ANY_UNITS
@pytest.mark.parametrize("share", [0.999, 1.001])
def test_a_centre_of_pressure_leaves_the_sole_at_its_edge(u, share):
    amplitude = share / cop_ratio(1.0)
    robot = jounce.Robot(in_units(cart(friction=0.9).mechanism, u))
    _, motion = sliding_in_units(u, amplitude, 0.6)
    found = robot.check(replace(motion, joint_names=robot.joint_names))
    assert found.worst.limit == "centre of pressure along x"
    assert found.worst.ratio == pytest.approx(share, rel=2e-5)
    assert found.verdict == ("kept" if share < 1 else "broken")
    a = RATE**2 * amplitude
    rates = [np.array([u.length * x]) for x in (amplitude, 0, -a)]
    base = np.eye(4), np.zeros(6), np.zeros(6)
    if share > 1:
        with expect_refusal("no contact wrenches within friction and soles"):
            robot.contact_wrenches(*rates, base=base, method="recursion")
    else:
        [wrench] = robot.contact_wrenches(*rates, base=base, method="recursion") / u.wrench
        np.testing.assert_allclose(wrench[[1, 3, 5]], [-3 * G * X * share, -a, 3 * G], rtol=1e-9)


@cache
def wrenches_and_switches(u):
    """Of two soles: wrenches in N and N m, and when rows of their limits begin and end to be active."""
    stand = jounce.Robot(in_units(hinged(friction=0.25, sole=(X, Y)).mechanism, u))
    t, motion = sliding_in_units(u, 0.3, 1.6, 2)
    motion = replace(motion, joint_names=stand.joint_names)
    wrenches = stand.contact_wrenches(*motion(t, 2), base=motion.base(t, 2), method="recursion")
    switches = [x.t for x in find_limited_breaks(validate_limits(stand.with_limits(effort=1e99), motion))]
    return wrenches / u.wrench, np.array(switches)


@ANY_UNITS
def test_wrenches_of_two_soles_switch_at_the_same_times(u):
    """Rows of friction and of soles are active at some of the times."""
    (before, switches), (after, others) = wrenches_and_switches(SI), wrenches_and_switches(u)
    assert len(switches) >= 2
    np.testing.assert_allclose(others, switches, rtol=0, atol=1e-8)
    np.testing.assert_allclose(after, before, rtol=0, atol=1e-8 * np.abs(before).max())


@ANY_UNITS
@pytest.mark.parametrize(("width", "balanced"), [(1e-3, True), (1e-4, False)])
def test_three_points_are_off_a_line_by_a_share_of_the_robot(u, width, balanced):
    """A body with a slide, whose lengths are those between its contacts."""
    body = jounce.inertia_matrix(2.0, [0, 0, 0.1], np.eye(3) / 50)
    robot = jounce.Robot.from_screws([np.eye(4)], [np.eye(6)[5]], [body], base=body, base_name="box")
    robot = jounce.Robot(in_units(robot.mechanism, u))
    points = u.length * np.array([(-0.5, 0, 0), (0.5, 0, 0), (0, width, 0)])
    contacts = [jounce.Contact("box", "point", place=place) for place in points]
    if balanced:
        assert robot.contacts(contacts).mechanism.contacts
        return
    with expect_refusal(re.compile(r"never balance the moment about the axis \(-?1, -?0, 0\) through")):
        robot.contacts(contacts)
