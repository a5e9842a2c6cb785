"""Retiming: the algebra of paths, time laws, the fastest one, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

import jounce
from jounce import Motion
from jounce.limits import drive_terms, path_terms
from jounce.limits.barrier import BarrierProgram, Basis, minimize_duration
from jounce.limits.drive_terms import acting_friction
from jounce.limits.retime import DUALITY_GAP, GRID_POINTS_PER_POINT, WARM_START_GAP, Grid
from jounce.limits.retime_problem import build_problem, without_friction
from jounce.model.limits import LIMIT_KINDS
from jounce.motion.time_law import TimeLaw, TimeLawCurve
from support.refusals import expect_refusal, refusal
from support.robots import rubbing

PANDA = jounce.load("panda", lock={"panda_finger_joint1": 0.0})
UR5 = jounce.load("ur5")
IIWA = jounce.load("iiwa14").with_limits(
    velocity=np.deg2rad([85, 85, 100, 75, 130, 135, 135]), effort=[320, 320, 176, 176, 110, 40, 40]
)
HOME = [0, -0.785, 0, -2.356, 0, 1.571, 0.785]
LIMITS = {"effort_rate": 1000.0, "acceleration": 15.0, "jerk": 5000.0}
STATED_GAP = 1e-5  # of the duration, in docs/howto/retime.md
POWERS = np.array([0, 0, 0, 0, 35, -84, 70, -20.0])  # from rest to rest, C^3 there


def rest_to_rest(start, way, duration=2.0, powers=POWERS):
    c = np.outer(way, powers)
    c[:, 0] += start
    return Motion.polynomial(c / duration ** np.arange(len(powers)), duration)


def move(robot, seed=0, duration=2.0):
    rng = np.random.default_rng(seed)
    middle = np.nan_to_num(robot.limits.bounds("position"), posinf=0, neginf=0).mean(axis=0)
    start, way = rng.uniform(-0.7, 0.7, (2, robot.n))
    return rest_to_rest(start + middle, way, duration)


def wavy(robot, duration=2.0):
    """A motion that never rests, with a wrench on the last body."""
    rng = np.random.default_rng(3)
    middle = np.nan_to_num(robot.limits.bounds("position"), posinf=0, neginf=0).mean(axis=0)[: robot.n]
    motion, load = (
        Motion.fourier(offset, *0.3 * rng.normal(size=(2, 2, len(offset))), 1.3, duration)
        for offset in (middle, np.zeros(6))
    )
    return replace(motion, loads={robot.body_names[-1]: load.curve})


def law_of(motion, degree=5):
    s = np.linspace(motion.start, motion.stop, 31)
    return TimeLaw(make_interp_spline(s, 1.5 + np.sin(3 * s), k=degree), motion.start, motion.stop, 0.3)


def by_law(motion, law):
    loads = {body: TimeLawCurve(curve, law) for body, curve in motion.loads.items()}
    return replace(motion, curve=TimeLawCurve(motion.curve, law), loads=loads)


RUBBING = rubbing(UR5, [5.0, 4.0, 3.0, 2.0, 1.0, 1.0])


def largest_shares(robot, motion, count):
    """The largest share of each limit on a fine grid, by itself and not by the library's check."""
    t = np.linspace(motion.start, motion.stop, count)
    along, limits = robot.forces_along(motion, t), robot.limits
    gravity = robot.gravity_forces(*along.rates[:3])
    forces = {
        kind: Q - G * (kind in limits.without_gravity)
        for kind, Q, G in zip(("effort", "effort_rate", "second_effort_rate"), along.forces, gravity, strict=True)
    }
    rates = dict(zip(("velocity", "acceleration", "jerk", "snap"), along.rates[1:], strict=True))
    values = {**forces, **rates, "power": along.forces[0] * along.rates[1]}
    return {kind: np.abs(value / limits.bounds(kind)[1]).max() for kind, value in values.items()}


@pytest.mark.parametrize(
    "robot",
    [PANDA.with_drives(["damping"]), UR5, RUBBING, rubbing(jounce.load("panda"), np.arange(1.0, 10.0))],
    ids=["damped", "ur5", "rubbing", "rubbing, with a joint that follows"],
)
def test_path_algebra_gives_the_forces_of_composed_motions(robot):
    motion = wavy(robot)
    law = law_of(motion)
    composed = by_law(motion, law)
    t = np.linspace(composed.start, composed.stop, 57)
    sigma = law.sigma(t)
    path, jet = (
        path_terms.sample_path(without_friction(robot), motion, sigma, 2),
        np.stack([law.x(sigma, nu=k) for k in range(4)]),
    )
    along = robot.forces_along(composed, t)
    gravity = robot.gravity_forces(*along.rates[:3])
    coulomb, products, added = acting_friction(robot.mechanism), path_terms.products(jet), {}
    if coulomb:
        rubs = coulomb.along([path.rate(k) for k in (1, 2, 3)], (*LIMIT_KINDS.effort, "power"))
        products = np.concatenate([products, rubs.products(jet)])
        added = {kind: rubs.terms(kind, path.q[1] if kind == "power" else np.ones(robot.n)) for kind in rubs.kinds}

    def agrees(terms, expected, kind=None):
        found = sum(products[k][:, None] * term for k, term in (terms | added.get(kind, {})).items())
        assert np.linalg.norm(found - expected) < 1e-12 * np.linalg.norm(expected)

    for k, (kind, Q, G) in enumerate(zip(LIMIT_KINDS.effort, along.forces, gravity, strict=True)):
        agrees(path.force(k), Q, kind)
        agrees(path.force(k, without_gravity=True), Q - G, kind)
    for k in (1, 2, 3, 4):
        agrees(path.rate(k), along.rates[k])
    agrees(path.power(), along.forces[0] * along.rates[1], "power")


def test_products_have_the_derivatives_that_differences_give():
    rng = np.random.default_rng(0)
    jet, h = rng.uniform(0.5, 2, (4, 9)), 1e-6
    coulomb = acting_friction(rubbing(UR5, np.ones(6), 0.7).mechanism)
    path = path_terms.Path((np.empty(0), *rng.uniform(-1, 1, (3, 9, 6))), *[[]] * 5, np.arange(6))
    motors = {k: rng.uniform(-1, 1, (9, 6)) for k in (path_terms.S3, path_terms.S1_S2, path_terms.S1)}
    links = coulomb.along([path.rate(k) for k in (1, 2, 3)], (*LIMIT_KINDS.effort, "power"))
    for functions in (path_terms, links, coulomb.along([motors], ("motor_torque",))):
        first, second = functions.derivatives(jet)
        for i, step in enumerate(h * np.eye(4)[:, :, None]):
            ahead, back = jet + step, jet - step
            slope = (functions.products(ahead) - functions.products(back)) / (2 * h)
            np.testing.assert_allclose(first[:, i], slope, atol=1e-8 * np.abs(slope).max(initial=1))
            change = functions.derivatives(ahead)[0] - functions.derivatives(back)[0]
            np.testing.assert_allclose(second[:, i], change / (2 * h), atol=1e-7 * np.abs(change / h).max(initial=1))


def test_a_time_law_inverts_its_times_and_has_exact_rates():
    law = law_of(wavy(UR5))
    t = np.linspace(law.start, law.stop, 101)
    np.testing.assert_allclose(law.times(law.sigma(t)), t, rtol=0, atol=1e-14)
    h = 1e-4
    inner = t[1:-1]
    rates, ahead, back = (law.rates(x, 5) for x in (inner, inner + h, inner - h))
    for k in range(5):
        np.testing.assert_allclose((ahead[k] - back[k]) / (2 * h), rates[k + 1], rtol=1e-5, atol=1e-5)


def test_splines_are_refined_exactly_whatever_the_duration():
    rng = np.random.default_rng(0)
    for duration, start in zip(
        rng.uniform(0.1, 20, 400), rng.uniform(-50, 50, 400) * (rng.random(400) < 0.5), strict=True
    ):
        coarse, fine = (Basis(start, start + duration, intervals) for intervals in (6, 12))
        c = rng.uniform(0.5, 1.5, coarse.count)
        sigma = np.linspace(start, start + duration, 41)
        found = fine.spline(fine.refine(coarse.spline(c)))(sigma)
        np.testing.assert_allclose(found, coarse.spline(c)(sigma), rtol=1e-11)


def test_breaks_and_deviations_go_with_the_path():
    motion = Motion.trapezoidal(np.random.default_rng(0).uniform(-1, 1, (9, 2)), 1.0, 2.0)
    law = law_of(motion)
    composed = by_law(motion, law)
    assert [(found.joint, found.order) for found in composed.breaks] == [(b.joint, b.order) for b in motion.breaks]
    inside = [found for found in composed.breaks if composed.start < found.t < composed.stop]
    for found in inside:
        before, after = composed(found.t - 1e-9, 2)[2], composed(found.t + 1e-9, 2)[2]
        assert after[found.joint] - before[found.joint] == pytest.approx(found.jump, rel=1e-5)
        sides = [composed(found.t, 2, side)[2][found.joint] for side in ("right", "left")]
        assert sides[0] - sides[1] == pytest.approx(found.jump, rel=1e-12)
    rng = np.random.default_rng(0)
    t = np.linspace(0, 4, 401)
    q = np.sin(2 * t)[:, None] * [1.0, 0.5] + 1e-4 * rng.normal(size=(401, 2))
    fit = Motion.fit(t, q)
    half = replace(fit, curve=TimeLawCurve(fit.curve, TimeLaw(make_interp_spline(t, 0 * t + 0.25, k=5), 0.0, 4.0, 0.0)))
    for found, exact in zip(half.deviations(1.0), fit.scaled(2).deviations(1.0), strict=True):
        np.testing.assert_allclose(found, exact, rtol=1e-9)


@pytest.mark.sweep(2)
@pytest.mark.parametrize(
    ("robot", "limits"),
    [
        (PANDA, {"effort_rate": 1000.0, "of": {"effort_rate": "Q - Qgrav"}}),
        (PANDA, {**LIMITS, "snap": 1e6, "second_effort_rate": 1e5, "power": 60.0}),
        (UR5, {"effort_rate": 10 * UR5.limits.effort}),
        (IIWA, LIMITS),
        (PANDA.with_drives(["damping"]), {}),
    ],
    ids=["panda", "panda, all limits", "ur5", "iiwa", "panda, damped"],
)
def test_no_limit_is_broken_and_one_decides_nearly_everywhere(robot, limits):
    robot = robot.with_limits(**limits)
    motion = move(robot)
    found = robot.retime(motion)
    shares = largest_shares(robot, found.motion, 15_001)
    assert 0.985 < max(shares.values()) < 0.9902, shares
    assert found.duration == found.motion.duration <= robot.slowdown(motion, up_to_limits=True).motion.duration / 0.98
    assert found.motion.breaks == ()
    decided = sum(stretch.stop - stretch.start for stretch in found.binding)
    assert decided > 0.8 * found.duration
    for end in (found.motion.start, found.motion.stop):
        assert all(np.abs(rate).max() < 1e-9 for rate in found.motion(end, 1)[1:])
    t = np.linspace(found.motion.start, found.motion.stop, 9)
    sigma = found.law.sigma(t)
    np.testing.assert_allclose(found.motion(t, 0)[0], motion(sigma, 0)[0], atol=1e-12)


@pytest.mark.sweep(1)
@pytest.mark.parametrize("robot", [PANDA, UR5, IIWA], ids=["panda", "ur5", "iiwa"])
def test_it_is_never_slower_than_the_slowdown(robot):
    robot = robot.with_limits(effort_rate=1000.0)
    for seed in range(3):
        motion = move(robot, seed)
        slow = robot.slowdown(motion, up_to_limits=True)
        found = robot.retime(motion, margin=0)
        assert found.duration <= slow.motion.duration
        assert robot.check(found.motion).worst.ratio < 1.001


def test_effort_bounds_of_one_sign_decide_near_one_of_them_only():
    robot = jounce.load("planar2r").with_limits(velocity=0.2, acceleration=1.5, effort={"joint1": (5, 300)})
    found = robot.retime(rest_to_rest(np.array([0.3, 0.2]), np.array([0.3, 0.3])))
    assert {stretch.limit for stretch in found.binding} == {"velocity", "acceleration"}


def test_a_motion_that_moves_at_both_ends_is_fast_between():
    robot = jounce.load("planar2r").with_limits(velocity=1.0)
    motion = Motion.polynomial([[0, 0.5], [0, 0.25]], 2.0)
    found = robot.retime(motion)
    assert 1 / 0.99 < found.duration < 1.1 / 0.99
    np.testing.assert_allclose(found.motion([found.motion.start, found.motion.stop], 1)[1][:, 0], 0.5, rtol=1e-9)
    assert np.abs(found.motion(found.motion.times, 1)[1]).max() <= 0.99 + 1e-7


def test_the_program_finds_what_ipopt_finds():
    casadi = pytest.importorskip("casadi")
    from benchmarks.retime import ipopt

    del casadi
    robot = UR5.with_limits(effort_rate=10 * UR5.limits.effort)
    grid = Grid.build(build_problem(robot, move(robot), 0.99), 20, 20.0)
    inner = grid.inner(np.ones(grid.basis.count))
    c = grid.solve(inner, inner, 1.0)
    assert grid.basis.duration(c) == pytest.approx(ipopt(grid), rel=2e-3)


@pytest.mark.sweep(1)
@pytest.mark.parametrize(
    ("robot", "limits"),
    [
        (UR5, {"effort_rate": 500.0}),
        (UR5, {"acceleration": 5.0, "jerk": 60.0}),
        (RUBBING, {"effort_rate": 500.0}),
        (RUBBING, {"power": 60.0, "second_effort_rate": 5e4}),
    ],
    ids=["rates", "jerk", "friction, rates", "friction, second rates and power"],
)
def test_the_program_stops_at_the_gap_that_the_page_states(robot, limits):
    """IPOPT solves the same program: the same spline with the same rows at the same points."""
    pytest.importorskip("casadi")
    from benchmarks.retime import ipopt

    grid = Grid.build(build_problem(robot.with_limits(**limits), move(UR5, 2), 0.99), 20, 20.0)
    points = slice(None, grid.count, GRID_POINTS_PER_POINT)
    program = BarrierProgram(grid.basis, grid.at.select(points), grid.rows.select(points), grid.free)
    best, inner = ipopt(grid, points), grid.inner(np.ones(grid.basis.count))

    def gap(share, first):
        c = minimize_duration(program, inner, share, first)
        assert program.rows.excess(program.at.jets(c)).max() < 0
        return grid.basis.duration(c) / best - 1

    for first in (1.0, WARM_START_GAP):
        assert -1e-7 < gap(DUALITY_GAP, first) < STATED_GAP
    assert gap(30 * DUALITY_GAP, WARM_START_GAP) > STATED_GAP


@pytest.mark.outside
def test_with_velocity_and_torque_alone_it_is_as_fast_as_toppra():
    pytest.importorskip("toppra")
    from benchmarks.retime import on_path, path, toppra

    for robot in (UR5, IIWA):
        c = path(robot, 1)
        theirs, _ = toppra(robot, c, 301)
        assert robot.retime(on_path(c)).duration == pytest.approx(theirs, rel=0.01)


def test_end_velocities_remain():
    robot = UR5.with_limits(effort_rate=500.0)
    whole = move(robot, 1, 1.5)
    slow = robot.slowdown(whole, up_to_limits=True).motion.scaled(1.2)
    half = slow.start + slow.duration / 2
    times = np.linspace(slow.start, half, 41)
    part = Motion.through(times, slow(times, 0)[0])
    found = robot.retime(part)
    for k, rate in enumerate(part(part.stop, 2)):
        np.testing.assert_allclose(found.motion(found.motion.stop, 2)[k], rate, rtol=1e-6, atol=1e-6)
    assert found.duration < part.duration
    assert max(largest_shares(robot, found.motion, 8001).values()) < 1
    fast = part.scaled(0.2)
    refusal(lambda: robot.retime(fast), "^the motion moves at its end, and no time law keeps the velocity there")


def test_a_rest_within_a_motion_is_passed_quickly():
    robot = UR5.with_limits(effort_rate=500.0)
    there = move(robot, 1)
    stay = Motion.polynomial(there(there.stop, 0)[0][:, None], 1.0)
    whole = there + stay
    assert robot.retime(whole).duration == pytest.approx(robot.retime(there).duration, rel=0.05)


def test_the_pace_of_the_given_motion_does_not_matter():
    robot = UR5.with_limits(effort_rate=500.0)
    there = move(robot, 1)
    fast = robot.retime(there).duration
    for factor in (1e-3, 1e3):
        assert robot.retime(there.scaled(factor)).duration == pytest.approx(fast, rel=1e-6)
    end = there(there.stop, 0)[0]
    back = rest_to_rest(end, there(0.0, 0)[0] - end)
    both = robot.retime(there.scaled(5) + back)
    assert both.duration == pytest.approx(fast + robot.retime(back).duration, rel=0.01)
    there_and_back = there.scaled(1e6) + back
    refusal(lambda: robot.retime(there_and_back), "^retiming fails: the paces of the motion differ by too much")


def test_breaks_that_a_limit_allows():
    """Pieces of constant jerk: Qd jumps, and its limit holds on both sides."""
    ruckig = pytest.importorskip("ruckig")
    given = ruckig.InputParameter(7)
    given.current_position, given.target_position = HOME, [q + 0.5 for q in HOME]
    given.max_velocity, given.max_acceleration, given.max_jerk = [2.0] * 7, [10.0] * 7, [5000.0] * 7
    trajectory = ruckig.Trajectory(7)
    ruckig.Ruckig(7).calculate(given, trajectory)
    motion = Motion.from_ruckig(trajectory)
    robot = PANDA.with_limits(effort_rate=1000.0)
    found = robot.retime(motion)
    assert (
        max(largest_shares(robot, found.motion, 20_001)[kind] for kind in ("velocity", "effort", "effort_rate")) < 0.991
    )
    with expect_refusal("^q3d of joint … jumps at …; retime motion.blended("):
        robot.with_limits(second_effort_rate=1e5).retime(motion)


@pytest.mark.sweep(1)
@pytest.mark.parametrize("seed", [2, 5], ids=["a kink", "between points"])
def test_limits_are_kept_where_a_rate_peaks_between_points(seed):
    """q5d of blends jumps, where Q2d has kinks; `check` finds peaks wherever they are."""
    points = np.random.default_rng(seed).uniform(-1, 1, (4, 2))
    corners = Motion.trapezoidal(points, 1.0, 2.0)
    apart = np.diff([corners.start, *sorted({found.t for found in corners.breaks}), corners.stop]).min()
    robot = jounce.load("planar2r").with_limits(velocity=3.0, jerk=1e4, second_effort_rate=[2e5, 1e5])
    found = robot.retime(corners.blended(0.9 * apart), margin=0)
    assert 0.999 < robot.check(found.motion).worst.ratio < 1.0002


def test_friction_helps_to_brake():
    """Less time than under limits of effort from which all of the friction is subtracted, and more than without it."""
    robot = rubbing(UR5, [15.0, 15.0, 7.0, 2.0, 2.0, 2.0])
    motion, effort = move(robot, 3), robot.limits.effort
    room = UR5.with_limits(effort=effort - robot.mechanism.drives.friction)
    found = robot.retime(motion)
    assert UR5.retime(motion).duration < found.duration < 0.99 * room.retime(motion).duration
    assert 0.985 < max(largest_shares(robot, found.motion, 5001).values()) < 0.9902
    smooth = RUBBING.with_limits(effort_rate=500.0)
    assert 0.985 < max(largest_shares(smooth, smooth.retime(motion).motion, 5001).values()) < 0.9902


def turning_round(eps, powers=(0, 0, 3, -2)):
    """A robot with Coulomb friction, a motion on which joint 2 turns round, and when."""
    robot = rubbing(jounce.load("planar2r"), [3.0, 1.0], eps).with_limits(velocity=5.0, effort_rate=2000.0)
    there = np.polynomial.Polynomial(powers)
    back = 3 * there * (1 - 0.8 * there)
    [turn] = [root.real for root in (there - 0.625).roots() if abs(root.imag) < 1e-9 and 0 < root.real < 1]
    return robot, Motion.polynomial([[*powers, *[0] * (len(powers) - 1)], back.coef], 1.0), turn


@pytest.mark.sweep(1)
@pytest.mark.parametrize(("eps", "powers"), [(0.05, (0, 0, 3, -2)), (1e-3, POWERS)])
def test_a_joint_with_friction_turns_round_within_its_limits(eps, powers):
    """At the turn, and at rests, friction changes in less time than the points of the path are apart."""
    robot, motion, turn = turning_round(eps, powers)
    found = robot.retime(motion)
    near = turn + np.geomspace(1e-12, 0.1, 2000) * np.array([[1], [-1]])
    t = np.sort(found.law.times(np.concatenate([np.linspace(0, 1, 20_001), near.ravel()])))
    Qd = robot.forces_along(found.motion, t, 1).forces[1]
    assert 0.985 < np.abs(Qd / 2000).max() < 0.993
    assert robot.check(found.motion).worst.ratio < 0.993


def test_friction_in_closed_loops_is_known_where_the_coordinates_are():
    robot = jounce.load("fivebar").with_limits(velocity=5.0, effort=20.0, effort_rate=500.0)
    motion = rest_to_rest([2.2, 0.94], [0.2, 0.1])
    own = np.isin(robot.mechanism.joints, robot.joint_names)
    found = rubbing(robot, 1.0 * own).retime(motion)
    assert 0.985 < rubbing(robot, 1.0 * own).check(found.motion).worst.ratio < 0.9902
    with expect_refusal("follow others in closed loops (left_elbow, right_elbow); omit it"):
        rubbing(robot, np.ones(4)).retime(motion)


def test_a_time_law_that_misses_where_friction_turns_over_is_refused(monkeypatch):
    monkeypatch.setattr(drive_terms, "_TURN_OFFSETS", np.empty(0))
    robot, motion, _ = turning_round(1e-3)
    with expect_refusal("^retiming fails: effort rate of …, where at most 0.99 … within 0.001 rad/s"):
        robot.retime(motion)


@pytest.mark.parametrize(("robot", "motion", "margin", "message"), [
    (UR5, rest_to_rest(np.zeros(6), np.zeros(6)), 0.01, "the path does not move: every joint rests all the time"),
    (PANDA, rest_to_rest(np.zeros(7), np.ones(7)), 0.01, "joint 'panda_joint4' leaves its position limits at t = "),
    (UR5.with_limits(effort=[150, 20, 150, 28, 28, 28]), move(UR5), 0.01, "joint 'shoulder_lift_joint' holds "),
    (jounce.load("iiwa14"), move(IIWA), 0.01, "'iiwa14' has no limit of velocity, acceleration, ... or effort"),
    (jounce.load("iiwa14").with_limits(velocity={"joint1": 1.0}), rest_to_rest(np.zeros(7), np.eye(7)[1]), 0.01,
     "no limit bounds the speed along part of the path; velocity limits are missing for 'joint2'"),
    (UR5, Motion.trapezoidal([np.zeros(6), np.ones(6)], 1.0, 2.0).scaled(1), 1.0,
     "margin is 1.0; expected a number from 0 to below 1"),
    (UR5, move(UR5), "x", "margin is 'x'; expected a number"),
    (UR5.with_limits(jerk=10.0), Motion.trapezoidal([np.zeros(6), np.ones(6)], 1.0, 2.0), 0.01,
     "q2d of joint 'shoulder_pan_joint' jumps at t = 0.5 s, where the jerk of every time law is infinite;"
     " retime motion.blended(time, continuity=3) to meet jerk limits"),
    (UR5.with_limits(velocity=0.0), move(UR5), 0.01, "the velocity limit of joint 'shoulder_pan_joint' is 0"),
])  # fmt: skip
def test_refusals(robot, motion, margin, message):
    refusal(lambda: robot.retime(motion, margin), f"^{message}")
