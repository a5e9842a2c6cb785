"""The slow-down is the largest factor below which every limit is kept: against brute force, and by its definition."""

import numpy as np
import pytest
from test_check import fourier

import jounce
from jounce.limits import slowdown as slowing
from jounce.limits.feasible_factors import polynomials, positive_roots
from jounce.limits.limited_motion import validate_limits
from support.refusals import refusal


def pendulum(**limits):
    """Hangs at -90 degrees, where a slow swing needs gravity's torque and a fast one the opposite: rates cancel."""
    return jounce.load("planar2r", m2=0.5).locked({"joint2": 0.0}).with_limits(**limits)


def planar2r_with_drives(**drives):
    m = jounce.load("planar2r").mechanism
    return jounce.Robot.from_screws(m.B, m.X, m.M, gravity=m.gravity, drives=drives).with_drives(bool(drives))


def slow_swing(seed):
    rng = np.random.default_rng(seed)
    frequency, size = rng.uniform(1.5, 2.5), rng.uniform(0.05, 0.2)
    return jounce.Motion.fourier([-np.pi / 2], [[0.0]], [[size]], frequency, 2 * np.pi / frequency).with_step(0.05)


def dense_ratio(robot, motion, kinds, c, t):
    """The largest ratio of a motion at speeds c, straight from the inverse dynamics at many times."""
    worst = np.zeros(len(c))
    rates = motion(t)
    for i, factor in enumerate(c):
        scaled = [rate * factor**k for k, rate in enumerate(rates)]
        Q, Qd, Q2d = robot.inverse_dynamics(*scaled)
        known = {"velocity": scaled[1], "acceleration": scaled[2], "effort": Q, "effort_rate": Qd}
        known |= {"second_effort_rate": Q2d, "power": scaled[1] * Q}
        worst[i] = max((np.abs(known[kind]) / bound).max() for kind, bound in kinds.items())
    return worst


def brute_force(robot, motion, kinds):
    """The first factor that breaks a limit and the last that breaks none, by a grid and bisection."""
    t = np.linspace(motion.start, motion.stop, 2001)
    c = np.linspace(0, 6, 601)[1:]
    ok = dense_ratio(robot, motion, kinds, c, t) <= 1

    def border(low, high):
        denser = np.linspace(motion.start, motion.stop, 8001)
        for _ in range(18):
            middle = (low + high) / 2
            feasible = dense_ratio(robot, motion, kinds, [middle], denser)[0] <= 1
            low, high = (middle, high) if feasible else (low, middle)
        return low

    first, last = int(np.argmin(ok)), int(np.flatnonzero(ok)[-1])
    return border(c[first - 1], c[first]), border(c[last], c[last + 1])


@pytest.mark.parametrize("seed", range(10))
def test_holes_in_the_feasible_set(seed):
    motion = slow_swing(seed)
    t = np.linspace(motion.start, motion.stop, 2001)
    c = np.linspace(0, 3, 600)[1:]
    free = pendulum(effort_rate=1.0)
    rates = dense_ratio(free, motion, {"effort_rate": 1.0}, c, t)
    peak = rates[np.argmax(rates[1:] < rates[:-1])]  # where gravity's part is largest, before inertia's takes over
    kinds = {"effort_rate": peak * np.random.default_rng(seed).uniform(0.6, 0.999)}
    robot = pendulum(**kinds)
    slow = robot.slowdown(motion, up_to_limits=True)
    factor, largest = brute_force(robot, motion, kinds)
    assert slow.largest > 1.01 * slow.factor
    assert (slow.factor, slow.largest) == pytest.approx((factor, largest), rel=1e-6)
    assert robot.check(slow.motion).worst.ratio == pytest.approx(1, abs=1e-9)
    assert robot.check(motion.scaled(1 / slow.largest)).worst.ratio == pytest.approx(1, abs=1e-9)


def test_a_hole_in_the_feasible_set_ends_between_samples():
    """At another time than it begins, since a second harmonic takes the two apart."""
    harmonics = [[0.045], [0.0075]], [[0.15], [0.0]]
    motion = jounce.Motion.fourier([-np.pi / 2], *harmonics, 2.0, np.pi).with_step(0.05)
    robot = pendulum(effort_rate=2.9)
    slow = robot.slowdown(motion, up_to_limits=True)
    factor, largest = brute_force(robot, motion, {"effort_rate": 2.9})
    assert slow.largest > 1.01 * slow.factor
    assert (slow.factor, slow.largest) == pytest.approx((factor, largest), rel=1e-6)


@pytest.mark.sweep(4)
@pytest.mark.parametrize("seed", range(10))
def test_slowdown_is_that_of_brute_force(seed):
    rng = np.random.default_rng(seed)
    robot = jounce.load("planar2r" if seed % 2 else "ur5")
    motion = fourier(seed, robot.n, size=0.1).with_step(0.05)
    some = {"effort": 120, "effort_rate": 200, "second_effort_rate": 4e3, "velocity": 1, "acceleration": 4, "power": 40}
    drawn = [kind for kind in some if kind == "effort" or rng.random() < 0.5]
    kinds = {kind: some[kind] * rng.uniform(0.7, 2) for kind in drawn}
    robot = robot.with_limits(**some | dict.fromkeys(some, np.inf) | kinds, lower=-9, upper=9)
    slow = robot.slowdown(motion, up_to_limits=True)
    factor, largest = brute_force(robot, motion, kinds)
    assert (slow.factor, slow.largest) == pytest.approx((factor, largest), rel=1e-6)
    found = robot.check(slow.motion)
    assert found.ok
    assert found.worst.ratio == pytest.approx(1, abs=1e-9)
    assert (found.worst.joint, found.worst.limit) == slow.binding[:2]
    assert found.worst.t - motion.start == pytest.approx((slow.binding.t - motion.start) / slow.factor, abs=1e-6)
    assert robot.check(motion.scaled(1 / (1.001 * slow.factor))).worst.ratio > 1


def test_scaling_is_that_of_composed_motions():
    """With wrenches over time, viscous friction, springs and armature: Q, Qd, Q2d at a factor, to rounding."""
    robot = planar2r_with_drives(damping=[0.5, 2], stiffness=[3, 1], rest=[0.1, 0], armature=[0.2, 0.1])
    robot = robot.with_limits(effort=1, effort_rate=1, second_effort_rate=1, power=1, of={"effort_rate": "Q - Qgrav"})
    t = np.linspace(0, 2, 21)
    table = {"t": t, "joint1": np.sin(t), "joint2": np.cos(2 * t), "body2.fx": 3 * np.sin(3 * t), "body2.mz": t**2}
    motion = jounce.load_motion(table, robot, degree=7)
    b = validate_limits(robot, motion)
    for c in (0.3, 1.0, 1.7):
        scaled = validate_limits(robot, motion.scaled(1 / c))
        exact = scaled.values(scaled.motion.start + (t - motion.start) / c)
        for kind, coefficients in polynomials(b, t).items():
            value = sum(x * c**k for k, x in enumerate(coefficients))
            assert np.abs(value - exact[kind]).max() <= 1e-12 * np.abs(exact[kind]).max()


def test_roots_of_polynomials():
    rng = np.random.default_rng(0)
    for degree in (1, 2, 3, 4):
        f = rng.normal(size=(degree + 1, 200))
        f[0] = -np.abs(f[0])
        f[-1, :20] = 0
        for column, found in zip(f.T, positive_roots(f), strict=True):
            expected = np.roots(column[::-1])
            expected = np.sort(expected[(np.abs(expected.imag) < 1e-9) & (expected.real > 0)].real)
            np.testing.assert_allclose(found[np.isfinite(found)], expected, rtol=1e-9)


@pytest.mark.parametrize("drives", [{"friction": [8, 3]}, {"stribeck": [8, 3], "stribeck_velocity": [2, 1.5]}])
def test_friction_is_bracketed(drives):
    robot = planar2r_with_drives(**drives).with_limits(effort=[45, 16])
    motion = fourier(3, 2, size=0.1).with_step(0.05)
    slow = robot.slowdown(motion)
    assert slow.largest is None
    assert slow.factor < 1
    assert robot.check(slow.motion).worst.ratio == pytest.approx(1, abs=1e-9)
    for factor in np.linspace(0.1, 0.999, 7):
        assert robot.check(motion.scaled(1 / (factor * slow.factor))).ok
    assert not robot.check(motion.scaled(1 / (1.001 * slow.factor))).ok


@pytest.mark.sweep(4)
@pytest.mark.parametrize(
    ("limits", "drives"),
    [({"velocity": 2.0}, {}), ({"effort": 300.0}, {}), ({"effort": 300.0}, {"friction": [8, 3]})],
)
@pytest.mark.parametrize("speed", [0.2, 0.999, 1.0, 1.001, 3.0])
def test_a_motion_that_is_kept_is_the_result_itself(limits, drives, speed):
    """`speed` times that at which a limit is met: up to it the same object, beyond it one that meets the limit."""
    robot = planar2r_with_drives(**drives).with_limits(**limits)
    most = robot.slowdown(fourier(3, 2, size=0.1).with_step(0.05), up_to_limits=True).motion
    motion = most.scaled(1 / speed)
    slow, fast = robot.slowdown(motion), robot.slowdown(motion, up_to_limits=True)
    assert fast.factor == pytest.approx(1 / speed, rel=1e-9)
    assert fast.binding is not None
    assert not any("some factors of speed" in note for note in (*slow.notes, *fast.notes))
    if speed <= 1:
        assert slow.motion is slowing.slowdown(robot, motion).motion is motion
        assert (slow.factor, slow.binding, slow.verdict) == (1.0, None, "kept")
        assert slow.largest == pytest.approx(1 / speed, rel=1e-9)
        reserve = f"could be up to {slow.largest:.6g} times as fast" if speed < 1 else "could not be faster"
        assert reserve in repr(slow)
    else:
        assert (slow.factor, slow.binding, slow.verdict) == (fast.factor, fast.binding, "broken")


@pytest.mark.parametrize("seed", range(3))
def test_a_motion_kept_between_broken_speeds_is_the_result_itself(seed):
    """Gravity and inertia cancel at its speed; slower ones break the limit, which a note says."""
    motion = slow_swing(seed)
    c = np.linspace(0, 3, 600)[1:]
    rates = dense_ratio(
        pendulum(effort_rate=1.0), motion, {"effort_rate": 1.0}, c, np.linspace(motion.start, motion.stop, 2001)
    )
    peak = rates[np.argmax(rates[1:] < rates[:-1])]
    robot = pendulum(effort_rate=0.8 * peak)
    both = robot.slowdown(motion, up_to_limits=True)
    at = both.largest * 0.999
    given = motion.scaled(1 / at)
    slow = robot.slowdown(given)
    assert robot.check(given).ok
    assert slow.motion is given
    assert slow.largest == pytest.approx(1 / 0.999, rel=1e-9)
    assert slow.notes[-1] == f"some factors of speed between {both.factor / at:.6g} and {1 / 0.999:.6g} break a limit"


def test_a_motion_that_nothing_bounds_is_the_result_itself():
    robot = jounce.load("planar2r").with_limits(effort=100)
    slow = robot.slowdown(STILL)
    assert (slow.motion, slow.factor, slow.largest) == (STILL, 1.0, np.inf)
    assert repr(slow) == "<Slowdown: every limit is kept; no limit bounds the speed of the motion>"


@pytest.mark.parametrize(
    ("largest", "words"),
    [
        (None, "how much faster the motion could be is not known"),
        (np.inf, "no limit bounds the speed of the motion"),
        (1.0, "one is just met, so that the motion could not be faster"),
        (1 + 4e-6, "one is just met, so that the motion could not be faster"),
        (1 + 5e-6, "one is just met, so that the motion could not be faster"),  # which six digits show as 1
        (1 + 6e-6, "the motion could be up to 1.00001 times as fast"),
        (2.5, "the motion could be up to 2.5 times as fast"),
    ],
)
def test_the_words_for_a_reserve(largest, words):
    assert slowing.describe_reserve(largest) == words


@pytest.mark.parametrize(
    ("largest", "noted"), [(None, False), (2.0, False), (2 * (1 + 1e-10), False), (2 * (1 + 4e-10), True), (3.0, True)]
)
def test_a_gap_below_a_larger_factor_is_noted(largest, noted):
    """Where it is larger by more than factors are exact to."""
    assert bool(slowing._describe_gap(slowing.SpeedLimit(2.0, None, largest))) == noted


@pytest.mark.parametrize(("factor", "largest"), [(0.5, None), (1.0, 1.0), (2.0, 2.0)])
def test_the_bracketed_factor_of_a_motion_that_is_kept_is_its_largest(monkeypatch, factor, largest):
    """Of a slower one it is not known whether factors above it keep every limit too."""
    place = "velocity", 0, 0.5
    monkeypatch.setattr(slowing, "is_polynomial", lambda b: False)
    monkeypatch.setattr(slowing, "bracket_factor", lambda b: (factor, place))
    b = validate_limits(jounce.load("planar2r").with_limits(velocity=1.0), MOVING)
    assert slowing._limit_derivatives(b) == (factor, place, largest)


@pytest.mark.parametrize(("speed", "works"), [(1.6e-9, True), (0.6e-9, False)])
def test_a_billionth_of_the_speed_is_none(speed, works):
    robot, motion = jounce.load("planar2r").with_limits(velocity=[speed, np.inf]), MOVING.with_step(0.5).scaled(0.3)
    if works:
        assert robot.slowdown(motion).factor == pytest.approx(speed, rel=1e-6)
    else:
        refusal(lambda: robot.slowdown(motion), "'joint1' moves at t = 0 s, and its limit of velocity is 0")


def test_an_undecided_motion_is_the_result_itself():
    robot = jounce.load("planar2r").with_limits(velocity=[0, 1])
    slow = robot.slowdown(MOVING)
    assert (slow.factor, slow.binding, slow.largest, slow.verdict) == (1.0, None, None, "undecided")
    assert slow.motion is MOVING
    assert slow.words == "no limit is known to be broken, and some are undecided; the motion is returned as it is"
    fast = robot.slowdown(MOVING, up_to_limits=True)
    assert (fast.factor, fast.binding[:2]) == (pytest.approx(5), ("joint2", "velocity"))


STILL = jounce.Motion.polynomial([[0.0], [0.5]], 1.0)
SWING = jounce.Motion.polynomial([[0.0, 1.0, -1.0], [0.0, 0.0, 0.0]], 1.0).with_step(0.3)
MOVING = jounce.Motion.polynomial([[0.0, 0.3], [0.5, 0.2]], 1.0)


@pytest.mark.parametrize(("limits", "motion", "words"), [
    ({"effort": [20, 50]}, MOVING,
     ["joint 'joint1' cannot hold itself up at t = 0 s: it takes 28.", "N m at rest, and its limit is 20 N m",
      "slowing down does not help"]),
    ({"upper": [0.1, 1], "velocity": 1}, MOVING, ["'joint1' is at 0.3 rad at t = 1 s", "limit of 0.1 rad"]),
    ({"effort": 100}, STILL, ["no limit bounds the speed", "does not move"]),
    ({"upper": [0.2499, 9]}, SWING, ["'joint1' is at 0.25 rad at t = 0.5 s", "limit of 0.2499 rad"]),
    ({"upper": 1}, MOVING, ["no limit bounds the speed"]),
    ({"velocity": 0, "effort": 0}, MOVING, ["no limit bounds the speed"]),
    ({}, MOVING, ["has no limits"]),
    ({"velocity": {"joint1": (-1, 0), "joint2": 1}}, MOVING,
     ["'joint1' moves at t = 0 s, and its limit of velocity is 0"]),
    ({"effort_rate": 100}, jounce.Motion.trapezoidal([[0, 0], [1, 1]], 1.0, 4.0),
     ["break at t = 0.25 s: the effort rate of joint 'joint1' is infinite there at every speed", "motion.blended"]),
])  # fmt: skip
def test_what_slowing_down_does_not_help_is_refused(limits, motion, words):
    refusal(lambda: jounce.load("planar2r").with_limits(**limits).slowdown(motion, up_to_limits=True), *words)
