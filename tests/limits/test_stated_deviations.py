"""Verdicts along polynomials with stated deviations: each value, time and share follows by hand."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

import jounce
from jounce.limits import worst_values
from jounce.limits.limited_motion import compute_deviations, validate_limits
from jounce.limits.motion_polynomials import split_part
from jounce.limits.ratios import LIMIT_TOLERANCE
from jounce.limits.worst_values import Worst
from jounce.motion import reliability
from jounce.motion.curves import DerivedCurve
from support.linkages import fourbar

ROBOT = jounce.load("planar2r")


@dataclass(frozen=True, eq=False)
class OffCurve(DerivedCurve):
    """A curve whose k-th rates are stated to be off by off[k], one for all joints or of each, more before `sure`.

    Rates above `known` are not known.
    """

    off: tuple
    sure: float = 0.0
    known: int | None = None

    @property
    def highest(self):
        return self.known

    def rates(self, t, order, left=False):
        return self.base.rates(t, order, left)

    def jumps(self, order):
        return self.base.jumps(order)

    def deviations(self, t, order):
        share = np.where(t < self.sure, 100.0, 1.0)[:, None]
        return [share * np.broadcast_to(x, self.columns) for x in (*self.off, *[0.0] * 9)[: order + 1]]


def off_motion(coefficients, *off, **options):
    """A motion of 1 s by polynomials, in steps of 0.1 s, with these deviations of q, qd, ..."""
    motion = jounce.Motion.polynomial(coefficients, 1.0).with_step(0.1)
    return replace(motion, curve=OffCurve(motion.curve, off, **options))


FASTER = off_motion([[0, 0, 0.5], [0, 0.1, 0]], 0, 0.01)  # velocities t and 0.1


def test_two_deviations_on_either_side_of_a_limit_are_undecided():
    """Of a velocity t with the limit 0.5 these are 0.48 to 0.52, told by the times around."""
    robot = ROBOT.with_limits(velocity=[0.5, 9])
    found = robot.check(FASTER)
    row = found.table[0]
    t = worst_values._collect_times(validate_limits(robot, FASTER))
    span = t[t < 0.48][-1], t[t > 0.52][0]
    assert (row.violations, row.undecided) == (((span[1], 1.0),), (span,))
    assert (row.verdict, row.value, row.t, row.margin, row.certain) == ("broken", 1.0, 1.0, -0.5, None)
    assert row.deviation == pytest.approx(0.02)
    assert found.judged == pytest.approx({"velocity": 1 - (span[1] - span[0])})


def test_the_worst_value_in_a_window_is_shown_although_undecided():
    row = ROBOT.with_limits(velocity=[1.0, 9]).check(FASTER).table[0]
    assert (row.verdict, row.value, row.t) == ("undecided", 1.0, 1.0)


def test_an_undecided_value_in_an_uncertain_start_is_not_shown():
    """Of a velocity 1 - t, off by 1 before 0.15 s: the limit is two deviations away nowhere there."""
    motion = off_motion([[0, 1, -0.5], [0, 0, 0]], 0, 0.01, sure=0.15)
    row = ROBOT.with_limits(velocity=[1.05, 9]).check(motion).table[0]
    assert (row.verdict, row.value, row.t) == ("undecided", pytest.approx(0.8), pytest.approx(0.2))


def test_undecided_differences_of_commands_are_shown():
    row = ROBOT.with_limits(velocity=[1.0, 9]).check(FASTER, rate=100, differences=1).table[0]
    assert (row.verdict, row.value) == ("undecided", pytest.approx(0.995))


def test_rates_that_no_limit_takes_need_not_be_known():
    motion = off_motion([[0, 0, 0.5], [0, 0.1, 0]], 0, 0.01, known=1)
    assert ROBOT.with_limits(velocity=[1.1, 9]).check(motion).verdict == "kept"


def test_exact_values_have_no_deviation():
    """Of motions that are exact, and of limits of 0, from which no ratio is measured."""
    exact = jounce.Motion.polynomial([[0, 0, 0.5], [0, 0.1, 0]], 1.0)
    assert {row.deviation for row in ROBOT.with_limits(velocity=9).check(exact).table} == {None}
    rows = ROBOT.with_limits(velocity=[0, 9]).check(FASTER).table
    assert [row.deviation is None for row in rows] == [True, False]


def test_kinds_that_are_stated_and_not_judged_have_no_share():
    found = ROBOT.with_limits(velocity=9, motor_velocity=9).check(FASTER)
    assert found.judged == {"velocity": 1.0, "motor_velocity": 0.0}


def test_the_certain_value_is_the_worst_one_after_an_uncertain_start():
    """Of either sign: the velocity rises from -5, through -0.54 where it is known, to 0.3."""
    velocity = 0.3 - 5 * np.polynomial.Polynomial([1, -1]) ** 8
    motion = off_motion([[0, *velocity.integ().coef[1:]], np.zeros(10)], 0, 0.01, sure=0.15)
    row = ROBOT.with_limits(velocity=99).check(motion).table[0]
    assert (row.value, row.t) == (pytest.approx(velocity(0)), 0.0)
    assert row.certain == (pytest.approx(velocity(0.2)), pytest.approx(0.2))


def test_the_window_of_a_motion_follows_from_some_of_its_times(monkeypatch):
    """Of 11 times from 0 to 1 s the first, the third, the sixth, ...: 0.3 s is known well, and not looked at."""
    monkeypatch.setattr(reliability, "MAX_WINDOW_TIMES", 5)
    robot = ROBOT.with_limits(velocity=9)
    late = off_motion([[0, 0, 0.5], [0, 0.1, 0]], 0, 0.01, sure=0.25)
    assert validate_limits(robot, late).windows["velocity"] == pytest.approx((0.5, 1.0))
    assert validate_limits(robot, FASTER).windows == {}


def test_undecided_spans_reach_to_the_times_around():
    """To the last time before at which the verdict is known and the first one after; those of the next part follow."""
    b = validate_limits(ROBOT.with_limits(velocity=1.0), FASTER)
    t, values, spans = np.arange(8) / 8, {kind: np.zeros((8, 2)) for kind in b.kinds}, {}
    values["velocity"][[0, 3, 4, 7], 0] = 1.0  # which is the limit
    found = [(0.0, 0.125), (0.25, 0.625), (0.75, 0.875)]
    for count in (1, 2):
        worst_values.judge_values(b, Worst(b), t, values, spans)
        assert spans == {("velocity", 0): count * found}


def test_exact_values_on_a_bound_are_kept_where_others_are_measured():
    """At the bound to rounding, as of exact motions."""
    motion = off_motion([[0, 0.2], [0, 1 + LIMIT_TOLERANCE]], 0, [0.01, 0])
    rows = ROBOT.with_limits(velocity=1.0).check(motion).table
    assert [row.verdict for row in rows] == ["kept", "kept"]


@pytest.mark.parametrize(
    ("velocity", "peaks"),
    [
        ([0.5, 0, 1e-9, 0, -1e-9], []),  # above the ends by less than rounding
        ([0.5, 0, 1e-7, 0, -1e-7], [np.sqrt(0.5)]),
        ([0, 0.03, -0.2, 1 / 3], []),  # at 0.1 s, below the end of the piece
    ],
)
def test_peaks_above_the_ends_of_their_piece_are_judged(velocity, peaks):
    motion = off_motion([np.polynomial.Polynomial(velocity).integ().coef, np.zeros(len(velocity) + 1)], 0, 1e-3)
    b = validate_limits(ROBOT.with_limits(velocity=[[-np.inf, 1], [-np.inf, np.inf]]), motion.with_step(1.0))
    [pieces] = split_part(b, b.whole)
    ends = [*pieces.start, *pieces.stop]
    assert [t for t in worst_values._collect_times(b) if t not in ends] == pytest.approx(peaks)


def test_deviations_of_joints_that_follow_a_crank():
    """Those of the crank, by the slopes of the closed positions over it."""
    robot = fourbar(1.0, 0.4, 0.9, 0.7, [0.9, -0.6, 1.4])
    names = ("joint1", "joint2", "joint3")
    most = {kind: dict.fromkeys(names, 99.0) for kind in ("upper", "velocity")}
    motion, at, h = off_motion([[0.9, 0.3]], 1e-4, 1e-3), np.array([0.0, 0.6]), 1e-4
    low, middle, high = robot.coordinates(np.array([-h, 0, h])[:, None, None] + motion(at, 0)[0])
    slope, bend = (high - low) / (2 * h), (high - 2 * middle + low) / h**2
    b = validate_limits(robot.with_limits(lower=dict.fromkeys(names, -99.0), **most), motion)
    found = compute_deviations(b, at)
    assert set(found) == {"position", "velocity"}
    np.testing.assert_allclose(found["position"], np.abs(slope) * 1e-4, rtol=1e-3)
    np.testing.assert_allclose(found["velocity"], np.hypot(slope * 1e-3, bend * 0.3 * 1e-4), rtol=1e-3)
