"""Motions as functions of time: exact rates at any time, on both sides of a break, at any pace, in a row."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial import Polynomial
from scipy.interpolate import PPoly, make_interp_spline

import jounce
from jounce import Motion
from jounce.motion.time_law import TimeLaw, TimeLawCurve
from support.motion_tables import from_table
from support.refusals import refusal

PLANAR = jounce.load("planar2r")
SLIDES = jounce.Robot.from_screws(
    np.tile(np.eye(4), (3, 1, 1)), np.eye(6)[3:], np.tile(np.eye(6), (3, 1, 1)), range(-1, 2)
).with_limits(velocity=1e6, jerk=1e9, effort_rate=1e12)
RNG = np.random.default_rng(5)
X = np.array([0.5, 0.9, 1.7, 2.0])
C = RNG.normal(size=(6, 3, 2))
PIECES = Motion.piecewise(X, C, joint_names=("joint1", "joint2"))
T = np.linspace(0.5, 2.0, 91)
FOURIER = Motion.fourier([0.1, 0.2], RNG.normal(size=(3, 2)), RNG.normal(size=(3, 2)), 1.5, 2.0, start=0.5)
RATES = ("q", "qd", "q2d", "q3d", "q4d")


def times_inside(motion):
    return np.linspace(motion.start, motion.stop, 57)[1:-1]


def differences(motion, t, k):
    """The derivative of the rate of order k by a scheme of sixth order."""
    h = 3e-3 * motion.duration
    return sum(w * (motion(t + j * h, k)[k] - motion(t - j * h, k)[k]) for j, w in ((1, 45), (2, -9), (3, 1))) / (
        60 * h
    )


SMOOTH = {
    "fourier": FOURIER,
    "polynomial": Motion.polynomial(RNG.normal(size=(2, 6)), 2.0, start=-1.0),
    "through samples": Motion.through(T, np.stack([np.sin(2 * T), np.cos(T)], axis=1)),
    "scaled": FOURIER.scaled(0.7),
    "shifted": FOURIER.shifted(100.0),
    "a table of rates": from_table(
        {"t": T[::6]}
        | {f"joint{j}.{r}": np.sin(T[::6] + j + k * np.pi / 2) for j in (1, 2) for k, r in enumerate(RATES)},
        PLANAR.mechanism, 4, "m.csv",
    ),
}  # fmt: skip


@pytest.mark.parametrize("motion", SMOOTH.values(), ids=SMOOTH)
def test_each_rate_is_the_derivative_of_the_one_before(motion):
    t = np.linspace(motion.start, motion.stop, 41)[2:-2]
    for k, rate in enumerate(motion(t)[1:]):
        assert np.abs(differences(motion, t, k) - rate).max() < 1e-5 * np.abs(rate).max(), k
    assert motion.breaks == ()
    assert motion.deviations(t) is None


def test_polynomials_and_fourier_series_are_what_they_say():
    powers = RNG.normal(size=(2, 5))
    motion = Motion.polynomial(powers, 2.0, start=3.0)
    t = times_inside(motion)
    for k, rate in enumerate(motion(t)):
        expected = [(Polynomial(p).deriv(k) if k else Polynomial(p))(t - 3.0) + 0 * t for p in powers]
        np.testing.assert_allclose(rate, np.transpose(expected), atol=1e-12)
    a, b = np.array([[1.0, 0.0], [0.5, 2.0]]), np.array([[0.3, 0.0], [0.0, -1.0]])
    motion = Motion.fourier([0.1, -0.2], a, b, 1.5, 4.0)
    t = times_inside(motion)[:, None]
    expected = np.array([0.1, -0.2]) + sum(
        a[k] * np.cos((k + 1) * 1.5 * t) + b[k] * np.sin((k + 1) * 1.5 * t) for k in (0, 1)
    )
    np.testing.assert_allclose(motion(t[:, 0], 0)[0], expected, atol=1e-14)


@pytest.mark.parametrize("side", ["left", "right"])
def test_pieces_are_scipys_and_at_a_break_those_of_either_side(side):
    ours = PIECES(T, 6)
    for k, rate in enumerate(ours):
        np.testing.assert_allclose(rate, PPoly(C, X)(T, nu=k), rtol=1e-12, atol=1e-9)
    for i in (1, 2):
        piece = i - (side == "left")
        for k, rate in enumerate(PIECES(X[i], 4, side)):
            exact = PPoly(C[:, [piece]], X[[piece, piece + 1]], extrapolate=True)(X[i], nu=k)
            np.testing.assert_allclose(rate, exact, rtol=1e-12)


def test_breaks_name_derivative_joint_and_size_of_a_jump():
    """Joint a goes on at the first break and jumps in jerk at the second, joint b there in velocity."""
    p = Polynomial([0.3, -1.0, 0.5, 2.0])
    c = np.zeros((4, 3, 2))
    c[:, :, 0] = np.transpose([(p(Polynomial([x - 0.5, 1]))).coef[::-1] for x in X[:-1]])
    c[0, 2, 0] += 0.25
    c[3, :, 1], c[2, :, 1] = [0.0, 0.4, 1.2], [1.0, 1.0, -2.0]
    breaks = Motion.piecewise(X, c, joint_names=("a", "b")).breaks
    assert [(found.t, found.joint, found.order) for found in breaks] == [(1.7, "a", 3), (1.7, "b", 1)]
    np.testing.assert_allclose([found.jump for found in breaks], [6 * 0.25, -3.0])
    assert Motion.piecewise(X, c).breaks[0].joint == 0


@pytest.mark.parametrize("duration", [0.31, 1.0, 2.7])
@pytest.mark.parametrize("joined", [True, False])
def test_rounding_at_a_rest_at_zero_is_no_jump(duration, joined):
    """There q, qd and q2d vanish, and differences of their rounding are as large as they are."""
    rng = np.random.default_rng(0)
    for away in rng.normal(size=(15, 3)):
        c = np.array([10, -15, 6])[:, None] * away / duration ** np.array([3, 4, 5])[:, None]
        there, back = ([away, 0 * away, 0 * away, *-c], [*(0 * c), *c])
        if joined:
            motion = Motion.polynomial(np.transpose(there), duration) + Motion.polynomial(np.transpose(back), duration)
        else:
            pieces = np.stack([there, back], axis=1)[::-1]
            motion = Motion.piecewise(duration * np.arange(3), pieces)
        assert motion.breaks_to(2) == ()
        assert {found.order for found in motion.breaks_to(4)} == {3}


SEPTIC = np.array([-20.0, 70, -84, 35, 0, 0, 0, 0])  # from rest to rest


def piecewise_and_parts(points, lasting):
    """Straight from point to point, at rest in each, as pieces and as motions one after the other."""
    c = SEPTIC[:, None, None] * np.diff(points, axis=0) / lasting[:, None] ** np.arange(7, -1, -1)[:, None, None]
    c[-1] += points[:-1]
    parts = [Motion.polynomial(c[::-1, i].T, float(T)) for i, T in enumerate(lasting)]
    return Motion.piecewise(np.concatenate([[0], np.cumsum(lasting)]), c), sum(parts[1:], parts[0])


@pytest.mark.parametrize("size", [1e-6, 1, 1e3])
@pytest.mark.parametrize("closed", [False, True])
def test_what_rounding_leaves_of_rates_at_rests_is_no_jump(size, closed):
    """Legs that end where a coordinate is 0 or the motion rests for a while had jumps of 1e-16 in q or qd."""
    rng = np.random.default_rng(3)
    points = size * rng.choice([0, 1], (12, 3)) * rng.normal(size=(12, 3))
    points[6:8] = points[6]
    points = np.concatenate([points[:3], points[1:2], points[:1]]) if closed else points
    for motion in piecewise_and_parts(points, rng.uniform(0.3, 1.5, len(points) - 1)):
        t = np.linspace(0, motion.stop, 9)
        law = TimeLaw(make_interp_spline(t, 2 + np.sin(t), k=5), 0.0, motion.stop, 0.0)
        for found in (motion, motion.scaled(1e-2).shifted(50), replace(motion, curve=TimeLawCurve(motion.curve, law))):
            assert {jump.order for jump in found.breaks_to(4)} == {4}
        assert SLIDES.check(motion).ok


@pytest.mark.parametrize("order", [0, 1, 2, 3])
@pytest.mark.parametrize("share", [1e-7, -1e-3])
def test_small_jumps_are_found(order, share):
    """Of a rate that is 0 on both sides but for the jump, a share of its largest value."""
    there, back = (Motion.polynomial([SEPTIC[::-1] * way + np.eye(8)[0] * at], 1.0) for way, at in ((1, 0), (-1, 1)))
    largest = np.abs(there(np.linspace(0, 1, 99), order)[order]).max()
    c = back.curve.c.copy()
    c[-1 - order] += share * largest / np.prod(np.arange(1, order + 1))
    whole = Motion.piecewise([0, 1, 2], np.concatenate([there.curve.c, c], axis=1))
    [found] = whole.breaks_to(order)
    assert (found.order, found.jump) == (order, pytest.approx(share * largest, rel=1e-4))


@given(st.floats(0.1, 10))
def test_pace_scales_rates_and_jumps(factor):
    slow = PIECES.scaled(factor)
    assert slow.start == PIECES.start
    assert slow.duration == pytest.approx(factor * PIECES.duration)
    t = times_inside(PIECES)
    for k, (rate, of) in enumerate(zip(slow(0.5 + (t - 0.5) * factor), PIECES(t), strict=True)):
        np.testing.assert_allclose(rate, of / factor**k, rtol=1e-6, atol=1e-9)
    for found, of in zip(slow.breaks, PIECES.breaks, strict=True):
        assert (found.joint, found.order) == (of.joint, of.order)
        assert found.jump == pytest.approx(of.jump / factor**of.order)


def test_motions_one_after_the_other():
    there = Motion.polynomial([[0, 0, 1.0], [0, 1, 0]], 1.0)
    on = Motion.polynomial([[1, 2.0, 1.5], [1, 0.5, 0]], 1.0, start=7.0)
    motion = there + on
    assert (motion.start, motion.stop) == (0.0, 2.0)
    assert [(found.t, found.joint, found.order) for found in motion.breaks] == [(1.0, 0, 2), (1.0, 1, 1)]
    np.testing.assert_allclose([found.jump for found in motion.breaks], [1.0, -0.5])
    for side, expected in (("left", there(1.0)), ("right", on(7.0))):
        np.testing.assert_allclose(motion(1.0, side=side), expected)
    refusal(lambda: on + on, "the motions do not meet: joint 0 ends at 4.5 and goes on from 1")
    refusal(lambda: there + PIECES, "motions of other joints: 2 without names and joint1, joint2")


def test_wrenches_follow_the_motion():
    t = np.linspace(0, 1, 30)
    motion = jounce.load_motion({"t": t, "joint1": t, "joint2": t, "body2.fx": np.sin(t)}, PLANAR)
    bare = jounce.load_motion({"t": t, "joint1": 1 + t, "joint2": 1 + t}, PLANAR)
    both = motion + bare
    np.testing.assert_allclose(
        [W["body2"][3] for W in both.wrench(0.5)], [np.sin(0.5), np.cos(0.5), -np.sin(0.5)], atol=1e-7
    )
    assert not both.wrench(1.5)[0]["body2"].any()
    np.testing.assert_allclose(motion.scaled(2).wrench(1.0)[1]["body2"][3], np.cos(0.5) / 2, atol=1e-7)
    assert np.array_equal(both.times, np.concatenate([t, 1 + t[1:]]))


def test_rates_of_a_table_hold_at_rows_polynomials_between():
    """Degree 2 m - 1 of m rates: a polynomial of that degree comes back, and whatever stands in the rows."""
    powers = [Polynomial(RNG.normal(size=10)) for _ in range(2)]
    t = np.cumsum(RNG.uniform(0.3, 0.6, 6))
    rows = {
        f"joint{j + 1}.{rate}": (p.deriv(k) if k else p)(t)
        for j, p in enumerate(powers)
        for k, rate in enumerate(RATES)
    }
    motion = from_table({"t": t} | rows, PLANAR.mechanism, 4, "m.csv")
    for j in (0, 1):
        for k, rate in enumerate(motion(t)):
            assert np.array_equal(rate[:, j], rows[f"joint{j + 1}.{RATES[k]}"])
    s = times_inside(motion)
    for k, rate in enumerate(motion(s)):
        exact = np.transpose([(p.deriv(k) if k else p)(s) for p in powers])
        np.testing.assert_allclose(rate, exact, rtol=1e-8, atol=1e-9 * np.abs(exact).max())
    refusal(lambda: motion(s, 5), "q5d is not known along this motion (all rates from the table); it ends at q4d")


def test_warns_if_digits_of_a_table_are_too_few_for_its_rates():
    t = np.linspace(0, 1, 1001)
    rows = {
        f"joint{j}.{rate}": np.round(np.sin(3 * t + k * np.pi / 2) * 3.0**k, 6)
        for j in (1, 2)
        for k, rate in enumerate(RATES)
    }
    motion = from_table({"t": t} | rows, PLANAR.mechanism, 4, "m.csv")
    motion(t)
    text = r"m.csv: rounding of joint1.q or t may make up 100% of joint1.q4d between its rows, .* more digits or rows"
    with pytest.warns(jounce.JounceWarning, match=text):
        motion(0.50005)


@pytest.mark.parametrize(("step", "warned"), [(3.3e-3, False), (2.9e-3, True)])
def test_doubles_carry_rates_between_rows_not_too_close(step, warned):
    """Rounding makes up 1 % of q4d 3.1 ms apart; limits that take lower rates alone hear nothing of it."""
    t = np.arange(0, 2, step)
    rates = [0.5**k * np.sin(0.5 * t + k * np.pi / 2) for k in range(5)]
    columns = {f"joint{j}.{rate}": x * j for j in (1, 2) for rate, x in zip(RATES, rates, strict=True)}
    motion = from_table({"t": t} | columns, PLANAR.mechanism, 4, "m.csv")
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        PLANAR.with_limits(velocity=3, acceleration=3, jerk=3, effort=300, effort_rate=300).check(motion)
        assert not said
        motion(0.5 * step)
    cure = "expected rows at least 0.0034 s apart"
    assert [cure in str(w.message) for w in said] == [True] * warned


@pytest.mark.parametrize(("turn", "warned"), [(64, False), (1e4, True)])
def test_rates_of_joints_at_rest_are_compared_with_moving_ones(turn, warned):
    """A joint at rest but for some units in the last place has rates that are rounding, and no jump."""
    t = np.linspace(0, 2, 201)
    ripple = turn / 4 * np.finfo(float).eps * np.where(np.arange(201) == 90, 1, 0)
    moves = [3.0**k * np.sin(3 * t + k * np.pi / 2) for k in range(5)]
    rests = [(k == 0) + 100.0**k * ripple for k in range(5)]
    both = {"joint1": moves, "joint2": rests}
    table = {f"{joint}.{rate}": x for joint, rates in both.items() for rate, x in zip(RATES, rates, strict=True)}
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        motion = from_table({"t": t} | table, PLANAR.mechanism, 4, "m.csv")
        motion(0.005)
    assert bool(said) == warned


def test_forces_at_breaks_jump_as_the_one_sided_forces_do():
    c = np.zeros((4, 3, 2))
    c[1, :, 0], c[0, :, 1] = [1.0, 2.0, 2.0], [1.0, 1.0, 2.0]
    c[2, 1:, 0] = [0.8, 4.0]
    motion = Motion.piecewise(X, c, joint_names=("joint1", "joint2"))
    along = PLANAR.forces_along(motion)
    assert [found.order for found in along.breaks] == [-1, -1]
    smooth = Motion.piecewise(
        [0, 1, 2], np.array([[[0, 1.0], [0, 1.0]], [[1, 0], [0.5, 3.0]], [[0, 0], [2, 3]], [[0, 0], [1, 1]]])
    )
    [found] = PLANAR.forces_along(smooth).breaks
    assert (found.t, found.order, [(b.joint, b.order) for b in found.causes]) == (1.0, 0, [(0, 2)])
    sides = [PLANAR.inverse_dynamics(*smooth(1.0, 2, side)) for side in ("left", "right")]
    np.testing.assert_allclose(found.jump, sides[1] - sides[0], atol=1e-13)
    assert PLANAR.forces_along(smooth, [0.2, 0.7]).breaks == ()


REFUSED = {
    "before": (lambda: PIECES(0.4), ["t = 0.40000000000000002 s is outside", "from 0.5 to 2 s"]),
    "no side": (lambda: PIECES(1.0, 2, "up"), ["unknown side 'up'", "right, left"]),
    "pace zero": (lambda: PIECES.scaled(0), ["factor is 0; expected a finite number > 0"]),
    "no shift": (lambda: PIECES.shifted("1"), ["seconds is '1'"]),
    "spline beyond its degree": (lambda: SMOOTH["through samples"](1.0, 8), ["q8d is not known", "it ends at q7d"]),
    "samples of other times": (lambda: Motion.through(T, np.zeros((3, 2))), ["t has 91 times and q 3 rows"]),
    "backward": (lambda: Motion.piecewise([0, 2, 1], np.zeros((2, 2, 1))), ["does not increase: 2 is followed by 1"]),
    "pieces": (lambda: Motion.piecewise(X[:3], np.zeros((2, 3, 1))), ["(2, 3, 1) for 3 breaks", "(degree + 1, 2, n)"]),
    "names": (lambda: Motion.piecewise(X, C, joint_names=["a"]), ["joint_names is ['a']; expected 2 different names"]),
    "duration": (lambda: Motion.polynomial([[1.0]], -1), ["duration is -1; expected a number > 0"]),
    "harmonics": (lambda: Motion.fourier([0, 1], [[1.0]], [[1.0, 2.0]], 1, 1), ["cosines has shape (1, 1)"]),
    "not finite": (lambda: Motion.polynomial([[np.nan]], 1), ["coefficients holds nan; expected finite numbers"]),
    "intervals": (lambda: Motion.fit(T, np.zeros((91, 1)), intervals=0), ["0 intervals for 91 samples"]),
}  # fmt: skip


@pytest.mark.parametrize(("call", "words"), REFUSED.values(), ids=REFUSED)
def test_refuses(call, words):
    refusal(call, *words)


def test_what_a_curve_keeps_is_of_the_order_asked_for():
    """Jumps of a trapezoidal profile: none of q and qd, those of q2d and of its derivatives."""
    curve = Motion.trapezoidal([[0.0, 0.0], [1.0, 0.5]], 1.0, 2.0).curve
    found = [len(curve.jumps(order)) for order in (1, 2, 1, 2)]
    assert found[0] == found[2] == 0
    assert found[1] == found[3] > 0
