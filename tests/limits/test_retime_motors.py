"""Retiming under limits of motors behind elastic joints: terms along the path, the least time, and what is refused."""

import numpy as np
import pytest
from scipy.interpolate import BSpline
from scipy.optimize import minimize
from test_motor_limits import ROTOR, STIFFNESS, soft_arm
from test_retime import STATED_GAP, UR5, by_law, law_of, move, rest_to_rest, wavy

import jounce
from jounce import Motion
from jounce.limits import path_terms
from jounce.limits.barrier import BarrierProgram, minimize_duration
from jounce.limits.drive_terms import MotorTerms
from jounce.limits.retime import DUALITY_GAP, GRID_POINTS_PER_POINT, WARM_START_GAP, Grid
from jounce.limits.retime_problem import build_problem
from jounce.model.limits import LIMIT_KINDS
from support.refusals import refusal

MOTOR = jounce.Motor(gear=-50, inertia=1e-4, friction=0.1, resistance=0.5, constant=0.05)
START, WAY = np.array([0.3, 0.2]), np.array([0.8, -0.7])
MOVE = rest_to_rest(START, WAY)
STIFF = UR5.elastic([8e3, 8e3, 6e3, np.inf, 3e3, 3e3], rotor=0.3)  # one joint is rigid
SMALL = jounce.load("planar2r")


def values(robot, rates):
    """What limits of motors bound, as the library's methods compute it."""
    theta, tau = robot.motor_positions(*rates[:4]), robot.motor_torques(*rates[:5])
    found = dict(zip(LIMIT_KINDS.motor, (*theta[:2], tau), strict=False))
    if robot.elasticity.motors:
        found |= {"motor_current": robot.motor_currents(*rates[:5]), "motor_voltage": robot.motor_voltages(*rates[:5])}
    return {kind: value for kind, value in found.items() if kind in robot.limits.kinds}


@pytest.mark.parametrize(
    "robot",
    [
        soft_arm(0.5),
        SMALL.elastic(STIFFNESS, motors=MOTOR),
        STIFF,
        jounce.load("fivebar").elastic(90.0, rotor=0.01),
    ],
    ids=["friction", "currents", "ur5", "closed"],
)
def test_terms_along_the_path_give_motors_of_composed_motions(robot):
    robot = robot.with_limits(**dict.fromkeys(LIMIT_KINDS.motor[: 5 if robot.elasticity.motors else 3], 9.0))
    closed = robot.mechanism.closure is not None
    motion = Motion.fourier([2.2, 0.94], [[0.05, 0.1]], [[0.1, 0.1]], 3.0, 2.0) if closed else wavy(robot)
    motors, law = MotorTerms(robot.mechanism, robot.elasticity), law_of(motion)
    t = np.linspace(law.start, law.stop, 41)
    sigma = law.sigma(t)
    path, jet = path_terms.sample_path(robot, motion, sigma, 2), np.stack([law.x(sigma, nu=k) for k in range(4)])
    along = robot.motors_along(by_law(motion, law), t)
    columns = [robot.mechanism.tree.coordinates.index(name) for name in robot.joint_names]
    exact = dict(zip(LIMIT_KINDS.motor, (*along.positions[:2], along.torques[0]), strict=False))
    if along.currents and along.voltages:
        exact |= {"motor_current": along.currents[0], "motor_voltage": along.voltages[0]}
    products, added = path_terms.products(jet), motors.friction()
    of_tau = tuple(kind for kind in exact if kind not in LIMIT_KINDS.motor[:2])
    rubs = added and added.along([motors.position(path, 1)], of_tau)
    for kind, expected in exact.items():
        terms, known = motors.terms(path, kind), products
        if rubs and kind in of_tau:
            terms |= rubs.terms(kind, motors.shares(kind)[0])
            known = np.concatenate([products, rubs.products(jet)])
        found = sum(known[k][:, None] * term for k, term in terms.items())[:, columns]
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


CASES = {
    "torque": (soft_arm(motor_torque=45.0), MOVE),
    "torque, friction": (soft_arm(2.0, motor_torque=45.0), MOVE),
    "torque of one sign, velocity": (soft_arm(motor_torque=[[-20.0, 60.0], [-15.0, 20.0]], motor_velocity=2.0), MOVE),
    "position": (soft_arm(motor_position=[[0.0, 1.18], [-2.0, 2.0]], velocity=3.0), MOVE),
    "current, voltage": (
        SMALL.elastic(STIFFNESS, motors=MOTOR).with_limits(motor_current=20, motor_voltage=9, effort_rate=500.0), MOVE,
    ),
    "ur5": (STIFF.with_limits(motor_torque=UR5.limits.effort, motor_velocity=3.0), move(UR5, 1)),
}  # fmt: skip


@pytest.mark.sweep(3)
@pytest.mark.parametrize(("robot", "motion"), CASES.values(), ids=CASES)
def test_limits_are_kept_between_samples_and_the_slowdown_is_slower(robot, motion):
    found = robot.retime(motion)
    t = np.linspace(found.motion.start, found.motion.stop, 10_001)
    for kind, value in values(robot, found.motion(t, 4)).items():
        lower, upper = robot.limits.bounds(kind)
        assert (value <= 0.9902 * upper).all(), kind
        assert (value >= 0.9902 * lower).all(), kind
    assert 0.985 < robot.check(found.motion).worst.ratio < 0.9902
    assert found.duration < robot.slowdown(motion, up_to_limits=True).motion.duration
    assert sum(stretch.stop - stretch.start for stretch in found.binding) > 0.5 * found.duration


def fastest(robot, intervals=24, degree=6, points=161):
    """The least duration of a motion from START by WAY, both ends C^3 at rest: sequential quadratic programs over time.

    s(t) is a spline, and limits hold at points; nothing of it is the library's retiming.
    """
    knots, u = np.pad(np.linspace(0, 1, intervals + 1), degree, mode="edge"), np.linspace(0, 1, points)
    splines = BSpline(knots, np.eye(intervals + degree), degree)
    bases = [splines(u, nu=k) for k in range(5)]

    def room(z):
        c = np.concatenate([np.zeros(4), z[:-1], np.ones(4)])
        s = [basis @ c / z[-1] ** k for k, basis in enumerate(bases)]
        found = values(robot, [WAY * x[:, None] + START * (k == 0) for k, x in enumerate(s)])
        shares = [(x / robot.limits.bounds(kind)[1]).ravel() for kind, x in found.items()]
        return np.concatenate([1 - x for x in shares] + [1 + x for x in shares])

    smooth = np.polynomial.Polynomial([0, 0, 0, 0, 35, -84, 70, -20])
    start = np.append(np.linalg.lstsq(bases[0], smooth(u), rcond=None)[0][4:-4], 2.0)
    found = minimize(
        lambda z: z[-1], start, jac=lambda z: np.eye(len(z))[-1], method="SLSQP", options={"ftol": 1e-7},
        constraints={"type": "ineq", "fun": room}, bounds=[(-1, 2)] * (len(start) - 1) + [(0.2, 3)],
    )  # fmt: skip
    assert found.success, found.message
    assert room(found.x).min() > -1e-6
    return found.x[-1]


@pytest.mark.parametrize(
    "limits",
    [{"motor_torque": 45.0}, {"motor_torque": 60.0}, {"motor_torque": 60.0, "motor_velocity": 2.0}],
    ids=lambda limits: " ".join(f"{kind} {bound:g}" for kind, bound in limits.items()),
)
def test_the_duration_is_that_of_an_optimization_over_time(limits):
    robot = soft_arm(**limits)
    found = robot.retime(MOVE, margin=0)
    assert found.duration == pytest.approx(fastest(robot), rel=0.01)


@pytest.mark.parametrize("friction", [0.0, 2.0])
def test_the_program_stops_at_the_gap_that_the_page_states(friction):
    pytest.importorskip("casadi")
    from benchmarks.retime import ipopt

    grid = Grid.build(build_problem(soft_arm(friction, motor_torque=45.0), MOVE, 0.99), 20, 20.0)
    points = slice(None, grid.count, GRID_POINTS_PER_POINT)
    program = BarrierProgram(grid.basis, grid.at.select(points), grid.rows.select(points), grid.free)
    inner = grid.inner(np.ones(grid.basis.count))
    c = minimize_duration(program, inner, DUALITY_GAP, WARM_START_GAP)
    assert -1e-7 < grid.basis.duration(c) / ipopt(grid, points) - 1 < STATED_GAP


def test_stiff_joints_are_as_fast_as_rigid_ones_with_their_rotors():
    motion, bounds = move(UR5, 2), UR5.limits.effort
    rigid = UR5.elastic(np.inf, rotor=0.3).with_limits(motor_torque=bounds).retime(motion)
    stiff = UR5.elastic(1e9, rotor=0.3).with_limits(motor_torque=bounds).retime(motion)
    assert stiff.duration == pytest.approx(rigid.duration, rel=2e-3)


def test_what_has_no_terms_along_the_path_is_refused():
    pair = jounce.AntagonisticSprings(jounce.CubicSpring(300.0, 2e4), jounce.CubicSpring(300.0, 2e4))
    inductive = jounce.Motor(gear=50, inertia=1e-4, resistance=0.5, constant=0.05, inductance=1e-3)
    for options, words in (
        ({"spring": jounce.CubicSpring(300.0, 2e4)}, "springs that are not linear"),
        ({"stiffness": 300.0, "damping": 0.6}, "springs with dampers"),
        ({"spring": {"joint1": pair, "joint2": jounce.CubicSpring(9.0)}}, "two motors on a joint"),
    ):
        robot = SMALL.elastic(rotor=ROTOR, **options).with_limits(motor_torque=45.0, motor_velocity=9.0)
        refusal(
            lambda robot=robot: robot.retime(MOVE),
            "limits of motors (motor_velocity, motor_torque)",
            words,
            "robot.with_limits(motor_velocity=float('inf'), motor_torque=float('inf'))",
        )
    robot = SMALL.elastic(STIFFNESS, motors=inductive).with_limits(motor_current=20.0)
    assert robot.check(robot.retime(MOVE).motion).ok  # currents take no inductance
    refusal(lambda: robot.with_limits(motor_voltage=9.0).retime(MOVE), "inductance under limits of voltage")
    carried = SMALL.elastic(300.0, motors=jounce.Motor(gear=50, inertia=1e-4, body="world", axis=[0, 0, 1]), coupling=0)
    refusal(lambda: carried.with_limits(motor_torque=45.0).retime(MOVE), "rotors that links carry (coupling)")
    refusal(
        lambda: soft_arm().with_limits(motor_voltage={"joint2": 9}).retime(MOVE), "states no constant and no resistance"
    )
    refusal(lambda: soft_arm(motor_torque=45.0).retime(MOVE, smooth=False), "limits of motor torque; omit smooth=False")
    refusal(lambda: soft_arm(motor_torque=5.0).retime(MOVE), "at rest", "its motor torque limit is 5 N m")
    refusal(lambda: soft_arm(motor_position=0.5).retime(MOVE), "at rest", "its motor position limit is 0.5 rad")
