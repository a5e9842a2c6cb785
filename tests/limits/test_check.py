"""Limits along a motion: nothing between samples is missed, breaks are told, ratios mean the same on both sides."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import jounce
from jounce.limits import motion_polynomials, root_finding
from jounce.limits.limited_motion import LimitedMotion, validate_limits
from jounce.limits.motion_polynomials import split_motion
from jounce.motion import hermite, smoothness
from jounce.motion.analytic import AnalyticCurve, Cosine, Terms
from jounce.motion.motion import Motion
from support.refusals import refusal

HOME = np.array([0, -0.785, 0, -2.356, 0, 1.571, 0.785])
ALL = {
    "effort": 100, "effort_rate": 300, "second_effort_rate": 1e4, "velocity": 1.7, "acceleration": 6, "jerk": 30,
    "snap": 200, "power": 60, "lower": -2, "upper": 2,
}  # fmt: skip


def fourier(seed, n, duration=2.0, size=0.3):
    rng = np.random.default_rng(seed)
    return jounce.Motion.fourier(
        rng.normal(size=n) * 0.3, *(size * rng.normal(size=(2, 3, n)) / np.arange(1, 4)[:, None]), 2.5, duration
    )


@pytest.fixture(scope="module")
def limited_ur5():
    return jounce.load("ur5").with_limits(**ALL, of={"effort_rate": "Q - Qgrav"})


def rows(found):
    return {(row.joint, row.limit): row for row in found.table}


def test_coarse_samples_find_what_fine_ones_find(limited_ur5):
    motion = fourier(0, 6)
    coarse, fine = limited_ur5.check(motion.with_step(0.02)), limited_ur5.check(motion.with_step(1e-4))
    for row, other in zip(coarse.table, fine.table, strict=True):
        assert row.ratio == pytest.approx(other.ratio, rel=1e-7)
        assert len(row.violations) == len(other.violations)
        np.testing.assert_allclose(row.violations, other.violations, atol=1e-6)


def test_worst_values_are_those_of_a_dense_grid(limited_ur5):
    motion = fourier(1, 6)
    t = np.linspace(motion.start, motion.stop, 20001)
    rates = motion(t)
    Q, Qd, Q2d = limited_ur5.inverse_dynamics(*rates)
    _, Gd = limited_ur5.gravity_forces(*rates[:2])
    dense = {
        "velocity": rates[1], "acceleration": rates[2], "jerk": rates[3], "snap": rates[4], "effort": Q,
        "effort_rate": Qd - Gd, "second_effort_rate": Q2d, "power": rates[1] * Q,
    }  # fmt: skip
    found = rows(limited_ur5.check(motion.with_step(0.02)))
    for kind, values in dense.items():
        for joint, column in zip(limited_ur5.joint_names, values.T, strict=True):
            row = found[joint, kind]
            assert abs(row.value) == pytest.approx(np.abs(column).max(), rel=1e-6)
            assert abs(row.value) >= np.abs(column).max() * (1 - 1e-12)
            assert row.ratio == pytest.approx(abs(row.value) / ALL[kind])
            assert row.margin == pytest.approx(ALL[kind] - abs(row.value))
            beyond = sum(stop - start for start, stop in row.violations)
            assert beyond == pytest.approx((np.abs(column) > ALL[kind]).mean() * motion.duration, abs=5e-4)


def test_a_violation_planted_between_two_samples_is_found():
    """A pendulum without gravity: Q = q2d, whose peak is known; samples stand on either side of it."""
    inertia = jounce.inertia_matrix(1.0, [1, 0, 0], np.zeros((3, 3)))
    pendulum = jounce.Robot.from_screws([np.eye(4)], [[0, 0, 1, 0, 0, 0]], [inertia], gravity=[0, 0, 0])
    peak, step = 0.5 + 0.0123456, 0.1
    w = 2 * np.pi
    phase = w * (peak - 0.5)
    motion = jounce.Motion.fourier([0], [[np.cos(phase)]], [[np.sin(phase)]], w, 1.0).with_step(step)
    samples = motion(motion.times)[2][:, 0]  # -w^2 cos(w t - phase)
    bound = float(samples.max()) * 1.0001
    found = pendulum.with_limits(effort=[[-1e3, bound]]).check(motion)
    assert (found.worst.t, found.worst.value) == pytest.approx((peak, w**2), abs=1e-8)
    assert not found.ok
    half = np.arccos(bound / w**2) / w
    assert found.worst.violations == (pytest.approx((peak - half, peak + half), abs=1e-8),)


def test_both_sides_of_a_break_are_checked(panda):
    """Constant jerk: the torque rate jumps at every change of it, and is largest there."""
    step, size = 0.1, 5.0
    jerks = size * np.array([1, -1, 1])
    q, qd, q2d, c = 0.0, 0.0, 0.0, []
    for jerk in jerks:
        c.append([jerk / 6, q2d / 2, qd, q])
        q, qd, q2d = np.polyval(c[-1], step), np.polyval(np.polyder(c[-1]), step), q2d + jerk * step
    coefficients = np.array(c).T[:, :, None] * np.eye(7)[0] + np.array([0, 0, 0, 1])[:, None, None] * HOME
    motion = jounce.Motion.piecewise(step * np.arange(4), coefficients)
    found = panda.check(motion.with_step(0.05))
    row = rows(found)["panda_joint1", "effort_rate"]
    t = np.array([step, 2 * step])
    either = [
        np.abs(panda.inverse_dynamics(*motion(t, 3, side))[1] - panda.gravity_forces(*motion(t, 1, side))[1]).max(
            axis=0
        )
        for side in ("left", "right")
    ]
    ends = motion([0, 3 * step], 3)
    outer = np.abs(panda.inverse_dynamics(*ends)[1] - panda.gravity_forces(*ends[:2])[1]).max(axis=0)
    assert abs(row.value) >= max(np.max(either, axis=0)[0], outer[0]) * (1 - 1e-12)
    assert len(found.breaks) == 2
    assert found.notes == ()


def test_where_acceleration_jumps_no_torque_rate_is_met(panda):
    motion = jounce.Motion.trapezoidal([HOME, HOME + 0.3], 0.5, 2.0)
    found = panda.check(motion)
    assert found.worst.limit in ("jerk", "effort_rate")
    assert np.isinf([found.worst.ratio, found.worst.value]).all()
    assert not found.ok
    row = rows(found)["panda_joint1", "effort_rate"]
    assert {span[0] for span in row.violations if span[0] == span[1]} == {met.t for met in found.breaks}
    [note] = found.notes
    assert "Q jumps because of panda_joint1" in note
    assert "no limit of effort rate can be met there; motion.blended" in note
    assert panda.check(motion.blended(0.05)).notes == ()


def test_where_velocity_jumps_no_torque_is_met():
    corner = jounce.Motion.polynomial([[0, 1], [0, 1]], 1.0) + jounce.Motion.polynomial([[1, 2], [1, 1]], 1.0)
    for bounds in ([[-999, np.inf]] * 2, [[-np.inf, 999]] * 2):
        found = jounce.load("planar2r").with_limits(effort=bounds).check(corner)
        assert (found.worst.ratio, found.worst.t, found.breaks[0].order) == (np.inf, 1.0, -1)
    found = jounce.load("planar2r").with_limits(acceleration={"joint1": 9}).check(corner)
    assert (found.worst.value, found.worst.joint, found.breaks) == (np.inf, "joint1", ())


@pytest.mark.parametrize(("kind", "broken"), [("acceleration", False), ("jerk", True), ("snap", True)])
def test_rates_two_orders_above_a_jump_have_impulses_of_either_sign(kind, broken):
    """qd falls: q2d has an impulse below zero, q3d one below and one above."""
    falls = jounce.Motion.polynomial([[0, 1]], 1.0) + jounce.Motion.polynomial([[1, 0.5]], 1.0)
    arm = jounce.load("planar2r").locked({"joint2": 0.0})
    for sign in (1, -1):
        found = arm.with_limits(**{kind: [[-9, np.inf] if sign > 0 else [-np.inf, 9]]}).check(falls)
        assert (found.verdict == "broken") == (broken or sign > 0)
    assert arm.with_limits(second_effort_rate=[[-np.inf, 1e9]]).check(falls).worst.ratio == np.inf


def test_rates_of_forces_that_jump_where_forces_do_not_are_infinite():
    """A mass on a rail that turns: the force along the rail has no part of the rail's acceleration, its rate has."""
    inertia = jounce.inertia_matrix(1.0, [1, 0, 0], np.diag([1, 1, 2]))
    polar = jounce.Robot.from_screws(
        [np.eye(4)] * 2, [[0, 0, 1, 0, 0, 0], [0, 0, 0, 1, 0, 0]], [inertia, inertia], gravity=[0, 0, 0]
    )
    turns = jounce.Motion.polynomial([[0, 0.5], [1, 0.2]], 1.0)
    turns += jounce.Motion.polynomial([[0.5, 0.5, 1], [1.2, 0.2, 0]], 1.0)
    for kind, verdict in (("effort", "kept"), ("effort_rate", "kept"), ("second_effort_rate", "broken")):
        limited = polar.with_limits(**{kind: [np.inf, 1e6]})
        found = limited.check(turns)
        assert found.verdict == verdict
        assert found.breaks[0].jump[1] == 0
    refusal(lambda: limited.slowdown(turns), "second effort rate", "is infinite there at every speed")


def test_peaks_of_the_highest_rate_that_a_table_states_are_exact():
    """The next rate is not known, and jumps at rows; between them the polynomials of the rows have peaks."""
    rng = np.random.default_rng(0)
    t, rows = np.linspace(0, 1.2, 7), rng.normal(size=(7, 3, 2)) * np.array([1, 5, 25])[:, None]
    robot = jounce.load("planar2r")
    names = (
        (j, joint, k, rate) for j, joint in enumerate(robot.joint_names) for k, rate in enumerate(("q", "qd", "q2d"))
    )
    table = {f"{joint}.{rate}": rows[:, k, j] for j, joint, k, rate in names}
    motion = jounce.load_motion({"t": t, **table}, robot, 0)
    dense = np.linspace(0, 1.2, 60001)
    rates = motion(dense, 2)
    Q = robot.inverse_dynamics(*rates)
    for kind, values in (("acceleration", rates[2]), ("effort", Q), ("power", rates[1] * Q)):
        for row, column in zip(robot.with_limits(**{kind: 1.0}).check(motion).table, values.T, strict=True):
            assert row.ratio == pytest.approx(np.abs(column).max(), rel=1e-7)
            assert row.ratio >= np.abs(column).max() * (1 - 1e-12)


def test_rates_that_vanish_in_the_middle_and_at_both_ends():
    """From rest to rest all rates of even order do; their peaks lie at a quarter."""
    robot, rates = jounce.load("planar2r"), ("q", "qd", "q2d", "q3d", "q4d")
    table = {f"{joint}.{rate}": [float(k == 0), 0.0] for joint in robot.joint_names for k, rate in enumerate(rates)}
    motion = jounce.load_motion({"t": [0.0, 2.0], **table}, robot)
    values = motion(np.linspace(0, 2, 40001))
    for kind, order in (("acceleration", 2), ("snap", 4)):
        found = robot.with_limits(**{kind: 1.0}).check(motion)
        assert found.worst.ratio == pytest.approx(np.abs(values[order]).max(), rel=1e-7)


@pytest.mark.parametrize(("bound", "verdict"), [(0.0, "undecided"), (-0.0, "undecided"), (1e-6, "kept")])
def test_rounding_of_a_rate_that_vanishes_is_not_followed(bound, verdict):
    """At a constant velocity gravity alone acts on the first joint: Qd less that of gravity is what rounding leaves."""
    motion = jounce.Motion.polynomial([[0, 1.0], [0.5, 0]], 4.0).with_step(0.01)
    limited = jounce.load("planar2r").with_limits(effort_rate=[bound, np.inf], of="Q - Qgrav")
    assert sum(len(pieces.start) for pieces in split_motion(validate_limits(limited, motion))) < 4 * len(motion.times)
    assert limited.check(motion).verdict == verdict  # files state a limit of 0 where they do not know it


def test_two_sided_limits_and_ranges_away_from_zero():
    robot = jounce.load("planar2r").with_limits(
        lower=[1, -np.inf], upper=[3, 2.5], effort=[[-50, 10], [-3, 100]], velocity=[[-0.1, 5], [-5, 5]]
    )
    motion = jounce.Motion.polynomial([[2.0, -0.2], [0.0, 1.0]], 2.0)
    found = rows(robot.check(motion))
    assert found["joint1", "velocity"].bound == -0.1
    assert found["joint1", "velocity"].ratio == pytest.approx(2)
    assert found["joint1", "position"].ratio == pytest.approx(0.4)  # 1.6 in 1 .. 3
    assert found["joint2", "position"].ratio == pytest.approx(0.5)  # 0.5 before its only bound
    assert found["joint2", "position"].margin == pytest.approx(0.5)


def test_wrenches_act_and_measured_motions_have_deviations(limited_ur5):
    q = fourier(2, 6)(np.linspace(0, 2, 401), 0)[0]
    noisy = q + 1e-4 * np.random.default_rng(0).normal(size=q.shape)
    measured = jounce.Motion.fit(np.linspace(0, 2, 401), noisy)
    limited_ur5 = limited_ur5.with_limits(snap=np.inf, second_effort_rate=np.inf)
    for row in limited_ur5.check(measured).table:
        assert row.deviation is not None
        assert row.deviation > 0
    t = np.linspace(0, 2, 9)
    table = {"t": t, **dict.fromkeys(limited_ur5.joint_names, 0 * t), "tool0.fx": -50 * np.sin(t)}
    loaded = jounce.load_motion(table, limited_ur5, 0, degree=5)
    Q = limited_ur5.forces_along(loaded, np.linspace(0, 2, 2001), order=0).forces[0]
    free = limited_ur5.gravity_forces(np.zeros(6))
    found = rows(limited_ur5.check(loaded))
    assert np.abs(Q - free).max() > 5
    for joint, column in zip(limited_ur5.joint_names, Q.T, strict=True):
        assert abs(found[joint, "effort"].value) == pytest.approx(np.abs(column).max(), rel=1e-5)


def test_a_follower_is_named_where_its_effort_is_not_checked():
    robot = jounce.load("panda")
    found = robot.check(jounce.Motion.polynomial(np.array([*HOME, 0.02])[:, None] * [1.0], 1.0))
    assert [note for note in found.notes if "'panda_finger_joint2'" in note and "follows" in note]


@pytest.mark.parametrize("friction", [0.0, 0.1])
def test_a_motion_of_one_state_is_checked_and_slowed_down(friction):
    m = jounce.load("planar2r").mechanism
    robot = jounce.Robot.from_screws(
        m.B, m.X, m.M, gravity=m.gravity, drives={"friction": [friction] * 2, "damping": [0.1] * 2}
    )
    robot = robot.with_drives().with_limits(velocity=1.0, effort=50, effort_rate=900)
    names = [f"{joint}.{rate}" for joint in robot.joint_names for rate in ("q", "qd", "q2d", "q3d", "q4d")]
    motion = jounce.load_motion({"t": [0.5], **{name: [0.0] for name in names}, names[1]: [2.0]}, robot)
    found = robot.check(motion)
    assert (found.verdict, found.worst.limit, found.worst.ratio) == ("broken", "velocity", 2.0)
    assert found.worst.violations == ((0.5, 0.5),)
    assert robot.slowdown(motion).factor == pytest.approx(1 / 2)
    refusal(lambda: robot.retime(motion), "the motion is one state at t = 0.5 s")


@pytest.mark.parametrize(("call", "words"), [
    (lambda: jounce.load("iiwa14").check(fourier(0, 7)),
     ["has no limits", "with_limits(NAME), published limits of an arm"]),
    (lambda: jounce.load("ur5").check(fourier(0, 7)), ["7"]),
])  # fmt: skip
def test_what_cannot_be_checked_is_refused(call, words):
    refusal(call, *words)


def test_the_uncertain_ends_of_a_measured_motion_break_no_limit():
    """Jerks of a fit are off by powers of ten there; between them they are those of the motion."""
    t = np.arange(0, 10, 0.004)
    q = np.column_stack([0.8 * np.sin(0.9 * t), 0.5 * np.cos(1.3 * t)])
    robot = jounce.load("planar2r").with_limits(jerk=2)
    noisy = q + np.random.default_rng(0).normal(0, 2e-3, q.shape)
    exact, found = (robot.check(motion) for motion in (jounce.Motion.through(t, q), jounce.Motion.fit(t, noisy)))
    assert exact.verdict == "kept"
    assert found.verdict == "undecided"
    assert found.judged["jerk"] > 0.98
    assert abs(found.worst.ratio - exact.worst.ratio) < 3 * found.worst.deviation
    slow = [
        robot.slowdown(motion, up_to_limits=True)
        for motion in (jounce.Motion.through(t, q), jounce.Motion.fit(t, noisy))
    ]
    assert slow[1].factor < 0.8 * slow[0].factor  # two deviations of the ends lie below the limit too
    assert robot.check(slow[1].motion).verdict == "kept"


def test_stamps_since_1970_are_checked_as_those_since_the_start():
    """They are rounded to parts of a microsecond, which no piece may be halved for."""
    t = np.arange(0, 0.3, 0.001)
    q = np.stack([np.sin(9 * t), np.cos(80 * t) / 50], axis=1)
    robot = jounce.load("planar2r").with_limits(velocity=3, effort_rate=2000)
    slower = [jounce.Motion.fit(start + t, q).scaled(3.2) for start in (0, 1.7e9)]
    counts = [sum(len(pieces.start) for pieces in split_motion(validate_limits(robot, motion))) for motion in slower]
    assert counts[1] <= 1.05 * counts[0]


def rows_of(digits, count=300, known=4):
    """A table of all rates of sines, a row each ms: rounded digits of q make ripples between rows."""
    t, w, turns = 1e-3 * np.arange(count), np.array([2, 5]), np.array([0, 1])
    rates = [w**k * [1, 1 / 3] * np.sin(np.outer(t, w) + np.pi / 2 * (turns + k)) for k in range(known + 1)]
    return Motion(hermite.HermiteCurve(t, tuple(rate.round(digits) for rate in rates)), None, "rows")


def evaluations(monkeypatch, call):
    """What a call returns, and at how many times it asks for what limits bound."""
    counts, channels = [], LimitedMotion.channels

    def count(b, t, side="right"):
        counts.append(len(t))
        return channels(b, t, side)

    monkeypatch.setattr(LimitedMotion, "channels", count)
    return call(), sum(counts)


@pytest.mark.sweep(4)
@pytest.mark.filterwarnings("ignore:.*rounding of .* or t:jounce.JounceWarning")
@pytest.mark.parametrize("digits", [15, 9, 7])
@pytest.mark.parametrize("kind", ["acceleration", "jerk", "snap", "second_effort_rate"])
def test_ripples_between_rows_of_few_digits_take_few_evaluations(monkeypatch, kind, digits):
    """They are the motion: nothing of them is missed, and no row is split many times to follow them."""
    motion, robot = rows_of(digits), jounce.load("planar2r")
    rates = motion(np.linspace(motion.start, motion.stop, 40 * len(motion.times)), 4)
    Q2d = robot.inverse_dynamics(*rates)[2]
    dense = dict(zip(("acceleration", "jerk", "snap", "second_effort_rate"), (*rates[2:], Q2d), strict=True))[kind]
    peak = np.abs(dense).max(axis=0)
    for share, verdict in ((0.99, "broken"), (1.02, "kept")):
        limited = robot.with_limits(**{kind: share * peak})
        assert sum(len(pieces.start) for pieces in split_motion(validate_limits(limited, motion))) < 5 * len(
            motion.times
        )
        found, count = evaluations(monkeypatch, lambda limited=limited: limited.check(motion))
        assert found.verdict == verdict
        assert count < 1500 * len(motion.times)  # each row has peaks that are placed
        for row in found.table:
            assert row.ratio * share >= 1 - 1e-9
            assert row.ratio * share < 1.02


@pytest.mark.parametrize("start", [0.0, 1.7e9])
@pytest.mark.parametrize("w", [5.0, 400.0])
def test_rounding_of_phases_since_1970_is_no_peak(monkeypatch, start, w):
    """Rows 20 us apart: polynomials of rates would divide the rounding of w t, 1e-6, by the square of that."""
    t = start + 20e-6 * np.arange(200)
    terms = [Terms((0.1,), (Cosine(0.3, w * (1 + j / 2), 0.2), Cosine(0.02, 2.2 * w, 1.0))) for j in range(2)]
    motion = Motion(AnalyticCurve(tuple(terms), t[0], t[-1]), None, "analytic terms", grid=t)
    robot = jounce.load("planar2r")
    peak = np.abs(robot.inverse_dynamics(*motion(np.linspace(t[0], t[-1], 4001)))[2]).max(axis=0)
    for share, verdict in ((0.99, "broken"), (1.01, "kept")):
        limited = robot.with_limits(second_effort_rate=share * peak)
        found, count = evaluations(monkeypatch, lambda limited=limited: limited.check(motion))
        assert found.verdict == verdict
        assert count < 20 * len(t)


STEP = 2.0**-7  # s, which doubles of seconds since 1970 hold


def _wave_samples(count=200):
    t = STEP * np.arange(count)
    return t, np.stack([np.sin(2 * t), np.cos(5 * t) / 3], axis=1)


def _fit(start):
    t, q = _wave_samples()
    return jounce.Motion.fit(start + t, q + 1e-5 * np.random.default_rng(0).normal(size=q.shape))


def _piecewise(start):
    t, q = _wave_samples(50)
    c = [CubicSpline(t, column).c for column in q.T]
    return jounce.Motion.piecewise(start + t, np.stack(c, axis=2)).with_step(STEP)


@pytest.mark.filterwarnings("ignore:the motion. rounding of the samples:jounce.JounceWarning")  # of such doubles
@pytest.mark.parametrize("limit", ["velocity", "effort", "effort_rate", "power"])
@pytest.mark.parametrize(
    "motion",
    [
        lambda start: jounce.Motion.through(start + _wave_samples()[0], _wave_samples()[1]),
        _fit,
        _piecewise,
        lambda start: fourier(2, 2).shifted(start).with_step(STEP),
        lambda start: jounce.Motion.polynomial([[0, 1, -0.4], [0, 0, 0.3]], 2.0, start=start).with_step(STEP),
    ],
    ids=["through samples", "fit", "piecewise", "Fourier series", "polynomial"],
)
def test_times_since_1970_give_the_verdict_of_times_from_zero(motion, limit):
    """Times are those of the motion, to the step of its doubles, and so are the ends of violations."""
    since, step = 1.7e9, np.spacing(1.7e9)
    robot = jounce.load("planar2r")
    largest = robot.with_limits(**{limit: 1.0}).check(motion(0.0)).worst.value
    for share in (0.8, 1.2):
        arm = robot.with_limits(**{limit: share * abs(largest)})
        zero, late = (arm.check(motion(start)) for start in (0.0, since))
        assert late.verdict == zero.verdict
        assert (zero.verdict == "broken") == (share < 1)  # a fit leaves its ends undecided
        assert late.judged == pytest.approx(zero.judged)
        for a, b in zip(zero.table, late.table, strict=True):
            assert b.ratio == pytest.approx(a.ratio, rel=1e-6)
            assert len(b.violations) == len(a.violations)
            np.testing.assert_allclose(np.subtract(b.violations, since), a.violations, atol=4 * step, rtol=0)
        assert late.worst.joint == zero.worst.joint
        assert late.worst.t - since == pytest.approx(zero.worst.t, abs=1e-5)  # a peak is flat


def test_digits_of_a_table_are_counted_once(monkeypatch):
    """A check asks for the rates between rows hundreds of times; the digits of all rows are those of the table."""
    counted = []

    def count(column):
        counted.append(column)
        return find_error(column)

    find_error = smoothness.rounding_error
    monkeypatch.setattr(smoothness, "rounding_error", count)
    t, q = _wave_samples()
    w, turns = np.array([2, 5]), np.array([0, 1])
    rates = [w**k * [1, 1 / 3] * np.sin(np.outer(t, w) + np.pi / 2 * (turns + k)) for k in range(1, 5)]
    curve = hermite.HermiteCurve(t, (q, *rates))
    robot = jounce.load("planar2r").with_limits(velocity=1.0, effort_rate=5)
    assert robot.check(Motion(curve, None, "rows")).verdict == "broken"
    assert len(counted) == q.shape[1]


@pytest.mark.filterwarnings("ignore:the motion. rounding of the samples:jounce.JounceWarning")
@pytest.mark.parametrize(("start", "jitter"), [(0.0, 0.0), (3600.0, 0.0), (0.0, 1e-5), (3600.0, 1e-5)])
@pytest.mark.parametrize("kind", ["snap", "second_effort_rate"])
def test_rounding_of_the_highest_rates_is_not_looked_into(kind, start, jitter):
    """Differentiation magnifies it beyond what polynomials are trusted to; halving pieces does not lessen it."""
    t = 1e-3 * np.arange(300)
    q = np.stack([np.sin(2 * t), np.cos(3 * t)], axis=1)
    stamps = start + t + jitter * np.random.default_rng(0).uniform(-1, 1, len(t))
    motion = jounce.Motion.through(stamps, q)
    robot = jounce.load("planar2r").with_limits(**{kind: 1e3})
    pieces = sum(len(pieces.start) for pieces in split_motion(validate_limits(robot, motion)))
    assert pieces < (4 if jitter == 0 else 8) * len(t)
    row = robot.check(motion).worst
    rates = motion(np.linspace(motion.start, motion.stop, 20001))
    dense = rates[4] if kind == "snap" else robot.inverse_dynamics(*rates)[2]
    assert row.ratio >= np.abs(dense).max() / 1e3 * (1 - 1e-4)


def test_rows_a_step_of_doubles_from_a_break_hide_no_peaks():
    """Between them lies no time at which a piece could be split; peaks of the pieces around it are looked for."""
    x = 1.7e9 + np.array([0, 1.0, 2.0])
    c = np.array([[[-1.0], [0]], [[1.0], [-1.0]], [[0], [0]]])  # q falls by t - t^2, then on
    motion = jounce.Motion.piecewise(x, c)
    motion = replace(motion, grid=np.array([x[0], np.nextafter(x[1], 0), x[2]]))
    arm = jounce.load("planar2r").locked({"joint2": 0.0})
    found = arm.with_limits(upper=0.24).check(motion)
    assert (found.verdict, found.worst.value) == ("broken", pytest.approx(0.25))


@pytest.mark.parametrize("peak", [0.05, 0.5, 0.9, 0.93, 0.96, 0.999])
@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize(("share", "verdict"), [(1 - 1e-4, "broken"), (1 + 1e-4, "kept")])
def test_a_peak_near_a_break_is_found_whatever_comes_behind_it(peak, side, share, verdict):
    """q2d = 1 - (t - peak)^2 in the first second, then it jumps and rises: its slope there has another sign."""
    first = np.array([-1 / 12, peak / 3, (1 - peak**2) / 2, 0, 0])
    then = np.array([0, 1 / 6, -1 / 2, np.polyval(np.polyder(first), 1), np.polyval(first, 1)])
    motion = jounce.Motion.piecewise([0.0, 1, 2], side * np.stack([first, then], axis=1)[:, :, None]).with_step(1.0)
    arm = jounce.load("planar2r").locked({"joint2": 0.0})
    found = arm.with_limits(acceleration=[[-share, np.inf] if side < 0 else [-np.inf, share]]).check(motion)
    assert (found.verdict, found.worst.value) == (verdict, pytest.approx(side, abs=1e-9))


@pytest.mark.parametrize("first", [0.9, 0.991, 0.995, 0.999, 0.99999])
@pytest.mark.parametrize(("share", "verdict"), [(1 - 1e-5, "broken"), (1 + 1e-5, "kept")])
def test_a_higher_peak_of_a_later_block_is_found_off_the_grid(monkeypatch, first, share, verdict):
    """Quintics from rest to rest: accelerations reach 10 / sqrt(3), 1 % more than at any sixteenth of the way."""
    monkeypatch.setattr(motion_polynomials, "_PIECES_PER_BLOCK", 1)
    arm = jounce.load("planar2r").locked({"joint2": 0.0})
    table = {"joint1.q": [0, first, first + 1], "joint1.qd": np.zeros(3), "joint1.q2d": np.zeros(3)}
    motion = jounce.load_motion({"t": [0.0, 1.0, 2.0], **table}, arm, 0)
    found = arm.with_limits(acceleration=share * 10 / np.sqrt(3)).check(motion)
    assert (found.verdict, abs(found.worst.value)) == (verdict, pytest.approx(10 / np.sqrt(3), rel=1e-9))


@pytest.mark.parametrize(("share", "exact"), [(1.1e-3, True), (0.9e-3, False)])
def test_peaks_below_a_thousandth_of_a_limit_are_those_of_rows(share, exact):
    motion = jounce.Motion.fourier([0], [[0.0]], [[1.0]], 1.0, 6.0).with_step(0.7)  # qd is 1 at most, at pi too
    arm = jounce.load("planar2r").locked({"joint2": 0.0}).with_limits(velocity=[[-1 / share, np.inf]])
    value = arm.check(motion).worst.value
    assert value == pytest.approx(-1, abs=0.02)
    assert (abs(value + 1) < 1e-12) == exact


def test_a_peak_between_neighbouring_doubles_is_found():
    low = np.array([3600.0, 1.7e9])
    high = np.nextafter(low, np.inf)
    t = root_finding.find_maxima(lambda t: -((t - low[:, None]) ** 2), low, high)
    assert ((low <= t) & (t <= high)).all()


def test_zeros_are_found_to_rounding_each_at_its_own_pace():
    zeros = np.array([0.1, 0.25, 0.9, 0.5])

    def f(t, at):
        return np.choose(at, [t - 0.1, (t - 0.25) ** 3, np.sign(t - 0.9), np.exp(9 * t) - np.exp(4.5)])

    np.testing.assert_allclose(root_finding.find_roots(f, np.zeros(4), np.ones(4)), zeros, atol=1e-5)
    np.testing.assert_allclose(
        root_finding.find_roots(f, np.zeros(4), np.ones(4))[[0, 2, 3]], zeros[[0, 2, 3]], atol=1e-14
    )
    ends = np.stack([f(np.full(4, t), np.arange(4)) for t in (0.0, 1.0)])
    low, high = np.zeros(4), np.ones(4)
    np.testing.assert_array_equal(root_finding.find_roots(f, low, high, ends), root_finding.find_roots(f, low, high))
    assert root_finding.find_roots(lambda t, at: t + 1, np.zeros(1), np.ones(1)) == 0
