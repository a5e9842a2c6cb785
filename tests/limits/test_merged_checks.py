"""The check of a motion from those of its parts: of motions that are cut at their rows, and of rows that are given."""

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

import jounce
from jounce.engine.along import ForceBreak
from jounce.limits.verdicts import Check, CheckedLimit, least_judged, worst_limits
from jounce.motion import hermite
from jounce.motion.motion import Motion

COUNT = 61  # rows, with all rates up to q4d: a motion that is as smooth where it is cut as elsewhere
TABLE = {
    "planar2r": {
        "lower": -0.2,
        "upper": 0.28,
        "velocity": 0.5,
        "acceleration": 2.0,
        "effort": 10.0,
        "effort_rate": 1.0,
        "power": 5.0,
    },
    "ur5": {"velocity": 0.6, "jerk": 4.0, "effort": [150, 150, 60, 28, 28, 28], "second_effort_rate": 300.0},
    "panda_elastic": {"acceleration": 1.5, "motor_velocity": 0.7, "motor_torque": 30.0},
}  # by robot: some of these limits are kept, some broken, on either side
CUTS = {"halves": (30,), "a row before the end": (59,), "thirds": (20, 41), "every tenth": range(10, 60, 10)}


@cache
def moving_rows(name):
    """A robot with limits, and the times and the rates of sines."""
    robot, rng = jounce.load(name).with_limits(**TABLE[name]), np.random.default_rng(3)
    t, w, phase = np.linspace(0.5, 2.5, COUNT), rng.uniform(1, 3, robot.n), rng.uniform(0, 6, robot.n)
    return robot, t, [0.3 * w**k * np.sin(np.outer(t, w) + phase + k * np.pi / 2) for k in range(5)]


@cache
def check_of_rows(name, first=0, last=COUNT - 1):
    robot, t, rates = moving_rows(name)
    part = slice(first, last + 1)
    return robot.check(Motion(hermite.HermiteCurve(t[part], tuple(x[part] for x in rates)), None, "rows"))


def checks_of_parts(name, cuts):
    ends = [0, *cuts, COUNT - 1]
    return [check_of_rows(name, *span) for span in pairwise(ends)]


@pytest.mark.parametrize("cuts", CUTS.values(), ids=CUTS)
@pytest.mark.parametrize("name", TABLE)
def test_the_check_of_parts_is_that_of_the_motion(name, cuts):
    whole, merged = check_of_rows(name), Check.merge(checks_of_parts(name, cuts))
    assert {row.verdict for row in whole.table} == {"kept", "broken"}
    assert (merged.span, merged.notes, merged.breaks) == (whole.span, whole.notes, whole.breaks)
    assert merged.judged == pytest.approx(whole.judged, rel=1e-14)
    assert merged.words == whole.words
    for row, expected in zip(merged.table, whole.table, strict=True):
        same = ("joint", "limit", "of", "unit", "bound", "deviation", "undecided", "certain", "cause", "verdict")
        assert [getattr(row, of) for of in same] == [getattr(expected, of) for of in same]
        assert (row.value, row.ratio, row.margin) == pytest.approx((expected.value, expected.ratio, expected.margin))
        assert row.t == pytest.approx(expected.t, abs=1e-3)  # of flat peaks that are sought on grids
        assert len(row.violations) == len(expected.violations)
        np.testing.assert_allclose(row.violations, expected.violations, atol=1e-9)


def test_cuts_fall_in_violations_and_next_to_worst_values():
    """Else the checks of parts would not have to be joined."""
    whole, t = check_of_rows("planar2r"), moving_rows("planar2r")[1]
    spans = [span for row in whole.table for span in row.violations]
    for cuts in CUTS.values():
        assert any(start < t[k] < stop for start, stop in spans for k in cuts)
    owners = {
        max(checks_of_parts("planar2r", (20, 41)), key=lambda x: x.table[i].ratio).span for i in range(len(whole.table))
    }
    assert len(owners) > 1


@pytest.mark.parametrize("name", TABLE)
def test_checks_merge_in_any_grouping(name):
    a, b, c, d = checks_of_parts(name, (15, 30, 45))
    expected = Check.merge([a, b, c, d])
    for grouped in (
        [Check.merge([a, b]), Check.merge([c, d])],
        [a, Check.merge([b, c]), d],
        [Check.merge([a, b, c]), d],
    ):
        found = Check.merge(grouped)
        assert found.judged == pytest.approx(expected.judged, rel=1e-14)
        assert replace(found, judged={}) == replace(expected, judged={})


def test_one_check_is_its_own_merge():
    given = check_of_rows("planar2r")
    assert Check.merge([given]) is given


def checked_row(ratio=0.5, limit="velocity", **more):
    """The row of a bound of 2 rad/s."""
    value = 2 * ratio
    given = {
        "joint": "joint1",
        "limit": limit,
        "of": None,
        "unit": "rad/s",
        "value": value,
        "bound": 2.0,
        "ratio": ratio,
    }
    return CheckedLimit(**({**given, "margin": 2 - value, "t": 0.0, "deviation": None, "violations": ()} | more))


def check_with(start, stop, *rows, **more):
    return Check(rows or (checked_row(),), **({"judged": {"velocity": 1.0}, "span": (start, stop)} | more))


def test_the_worse_row_counts_and_the_first_of_equal_ones():
    low, high = checked_row(0.5, t=0.5), checked_row(0.75, t=1.5)
    assert Check.merge([check_with(0, 1, low), check_with(1, 2, high)]).worst == high
    assert Check.merge([check_with(0, 1, high), check_with(1, 2, low)]).worst == high
    assert Check.merge([check_with(0, 1, high), check_with(1, 2, replace(high, t=2.0))]).worst.t == 1.5


def test_times_of_both_parts_are_joined_where_they_meet():
    first = checked_row(1.5, violations=((0.0, 0.25), (0.5, 1.0)), undecided=((0.25, 0.5),))
    second = checked_row(1.25, violations=((1.0, 1.5),), undecided=((1.75, 2.0),))
    [row] = Check.merge([check_with(0, 1, first), check_with(1, 2, second)]).table
    assert row.violations == ((0.0, 0.25), (0.5, 1.5))
    assert row.undecided == ((0.25, 0.5), (1.75, 2.0))


@pytest.mark.parametrize("worse", [0, 1])
def test_the_cause_is_that_of_the_worse_row_or_else_the_other(worse):
    ratios = (0.9, 0.5) if worse == 0 else (0.5, 0.9)

    def cause(*causes):
        rows = [checked_row(ratio, cause=of) for ratio, of in zip(ratios, causes, strict=True)]
        return Check.merge([check_with(0, 1, rows[0]), check_with(1, 2, rows[1])]).worst.cause

    assert cause("noise", "play") == ("noise", "play")[worse]
    assert (cause("noise", None), cause(None, "play"), cause(None, None)) == ("noise", "play", None)


def test_judged_shares_are_weighted_by_time():
    parts = check_with(0, 3, judged={"velocity": 1.0}), check_with(3, 4, judged={"velocity": 0.5})
    assert Check.merge(parts).judged == {"velocity": 0.875}
    still = check_with(1, 1, judged={"velocity": 0.0})
    assert Check.merge([still, still]).judged == {"velocity": 0.0}
    assert Check.merge([still, check_with(1, 2)]).judged == {"velocity": 1.0}


def test_notes_are_said_once_and_breaks_follow_each_other():
    first, second = ForceBreak(0.5, -1, None, ()), ForceBreak(1.5, -1, None, ())
    parts = check_with(0, 1, notes=("a", "b"), breaks=(first,)), check_with(1, 2, notes=("b", "c"), breaks=(second,))
    merged = Check.merge(parts)
    assert (merged.notes, merged.breaks, merged.span) == (("a", "b", "c"), (first, second), (0, 2))


def test_parts_may_leave_a_gap_that_counts_for_nothing():
    merged = Check.merge([check_with(0, 1), check_with(5, 6, judged={"velocity": 0.5})])
    assert (merged.span, merged.judged) == ((0, 6), {"velocity": 0.75})


def test_checks_that_are_not_of_parts_are_refused():
    with pytest.raises(jounce.JounceError, match=r"^Check\.merge\(\) of no checks; expected one or more$"):
        Check.merge([])
    for other in (checked_row(limit="jerk"), checked_row(joint="joint2")):
        with pytest.raises(jounce.JounceError, match=r"^checks of 1 and of 1 limits are of different robots; expected"):
            Check.merge([check_with(0, 1), check_with(1, 2, other)])
    with pytest.raises(jounce.JounceError, match=r"^checks of 1 and of 2 limits are of different robots"):
        Check.merge([check_with(0, 1), check_with(1, 2, checked_row(), checked_row(limit="jerk"))])
    with pytest.raises(jounce.JounceError, match="of different robots"):
        Check.merge([check_with(0, 1), check_with(1, 2, judged={"velocity": 1.0, "motor_torque": 0.0})])
    with pytest.raises(
        jounce.JounceError, match=r"^a check begins at t = 0.5 s, and the one before it ends at t = 1 s; ex"
    ):
        Check.merge([check_with(0, 1), check_with(0.5, 2)])
    with pytest.raises(jounce.JounceError, match=r"in the order of time$"):
        Check.merge([check_with(1, 2), check_with(0, 1)])


def test_the_worst_row_of_each_limit_has_the_name_of_its_motion():
    slow = check_with(0, 1, checked_row(0.5), checked_row(0.9, "jerk"))
    fast = check_with(0, 1, checked_row(0.75), checked_row(0.9, "jerk"), checked_row(0.1, joint="joint2"))
    assert worst_limits({"slow": slow, "fast": fast}) == [
        ("fast", fast.table[0]), ("slow", slow.table[1]), ("fast", fast.table[2]),
    ]  # fmt: skip
    assert worst_limits({}) == []


def test_the_least_share_of_each_kind_is_that_of_any_motion():
    shares = [{"velocity": 0.5, "jerk": 1.0}, {"velocity": 0.75, "jerk": 0.25}, {"effort": 0.0}]
    assert least_judged(check_with(0, 1, judged=of) for of in shares) == {"velocity": 0.5, "jerk": 0.25, "effort": 0.0}
    assert least_judged([]) == {}


def test_values_outside_of_uncertain_ends_are_the_worst_of_both_parts():
    """Towards the bound of the worst value, which lies in such an end."""
    worst = checked_row(0.9, certain=(1.0, 0.5))

    def certain(row, other):
        parts = [check_with(0, 1, row), check_with(1, 2, other)], [check_with(0, 1, other), check_with(1, 2, row)]
        [found] = {Check.merge(of).worst.certain for of in parts}
        return found

    assert certain(worst, checked_row(0.75, t=1.5)) == (1.5, 1.5)
    assert certain(worst, checked_row(0.75, t=1.5, certain=(1.25, 1.75))) == (1.25, 1.75)
    assert certain(worst, checked_row(0.25, t=1.5)) == (1.0, 0.5)
    assert certain(checked_row(0.9), checked_row(0.75, certain=(1.0, 0.5))) is None
    assert certain(checked_row(1.25, certain=(1.0, 0.5)), checked_row(0.75, t=1.5)) == (1.5, 1.5)
    lower = replace(worst, value=-1.8, bound=-2.0, certain=(-1.0, 0.5))
    assert certain(lower, replace(lower, ratio=0.75, value=-1.5, t=1.5, certain=None)) == (-1.5, 1.5)
    assert certain(lower, checked_row(0.75, t=1.5)) == (-1.0, 0.5)
