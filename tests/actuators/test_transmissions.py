"""Robots whose springs are not linear, have dampers or two motors a joint: plants, energies, limits, and refusals."""

import pickle

import numpy as np
import pytest
import sympy

import jounce
from jounce import AntagonisticSprings, CubicSpring, Motion, Motor, SpringFunction, SpringTable
from jounce.engine import generic_methods
from support.refusals import expect_refusal, refusal
from support.states import sine_rates

ROBOT = jounce.load("planar2r")
K = 500.0
ROW = np.linspace(-0.3, 0.3, 241)
SINH = SpringFunction.of(lambda d: 150 * np.sinh(6 * d) / 6)
CUBIC = CubicSpring(K, 2e4)
PAIR = AntagonisticSprings(SINH, SINH)
SPRINGS = {
    "cubic": CUBIC,
    "softening": CubicSpring(K, -300.0),
    "function": lambda d: K * d + 2e4 * d**3,
    "table": SpringTable(ROW, CUBIC.force(ROW)),
}
springs = pytest.mark.parametrize("name", SPRINGS)
SLOW = {"method": "recursion"}
GAUSS = np.polynomial.legendre.leggauss(40)


def smooth_step(duration=1.0):
    """From rest to rest, with five rates that vanish at the ends."""
    step = np.polynomial.Polynomial([0, 1]) ** 5 * np.polynomial.Polynomial([1, -1]) ** 5
    step = step.integ() / step.integ()(1.0)
    powers = step.coef / duration ** np.arange(len(step.coef))
    return Motion.polynomial(np.outer([0.9, -0.7], powers) + np.eye(2, len(powers)) * 0.2, duration)


def waves(t, order, speed=3.0):
    return sine_rates(t, order, 0.4, speed, [0, 1])


def undo(arm, q, theta, tau, tolerance=1e-9, wrench=None):
    """The plant accelerates as the motion from which the torques were computed."""
    found = arm.elastic_forward_dynamics(q[0], q[1], theta[0], theta[1], tau, wrench=wrench)
    np.testing.assert_allclose(found[0], q[2], atol=tolerance)
    np.testing.assert_allclose(found[1], theta[2], atol=tolerance * max(1, np.abs(theta[2]).max()))


def work(times, power):
    """Integrals of the power over the pieces between times, by Gauss-Legendre quadrature."""
    return np.diff(times) / 2 * (power.reshape(len(times) - 1, -1) @ GAUSS[1])


def quadrature_points(times):
    """The points of the quadrature, and the times themselves."""
    inner = (times[:-1, None] + times[1:, None]) / 2 + np.diff(times)[:, None] / 2 * GAUSS[0]
    return np.concatenate([inner.ravel(), times])


@springs
def test_plants_follow_the_torques_of_springs_of_every_kind(name):
    arm, q = ROBOT.elastic(spring=SPRINGS[name], rotor=0.1), waves(np.linspace(0, 1, 5), 5)
    theta, (tau, taud) = arm.motor_positions(*q[:5], **SLOW), arm.motor_torques(*q, **SLOW)
    undo(arm, q, theta, tau)
    h = 1e-4
    before, after = (arm.motor_torques(*waves(np.linspace(0, 1, 5) + side * h, 4), **SLOW) for side in (-1, 1))
    np.testing.assert_allclose(taud, (after - before) / (2 * h), rtol=1e-5, atol=1e-4)
    reference = ROBOT.elastic(spring=CUBIC, rotor=0.1).motor_torques(*q, **SLOW)
    if name != "softening":
        np.testing.assert_allclose(tau, reference[0], atol=1e-8)


def test_native_code_has_cubic_springs_and_linear_ones_beside_others(tmp_path):
    arm, q = ROBOT.elastic({"joint2": K}, spring={"joint1": CUBIC}, rotor=0.1), waves(np.linspace(0, 1, 9), 5)
    for found, expected in zip(arm.motor_torques(*q, method="kernel"), arm.motor_torques(*q, **SLOW), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)
    linear = ROBOT.elastic(K, rotor=0.1).motor_torques(*q, **SLOW)
    np.testing.assert_allclose(arm.motor_torques(*q)[0][:, 1], linear[0][:, 1], rtol=1e-12)
    other = ROBOT.elastic(spring=SPRINGS["function"], rotor=0.1)
    said = "stiffen cubically from a stiffness k above 0; that of joint 'joint1' is another"
    refusal(lambda: other.motor_torques(*q, method="kernel"), said)
    with expect_refusal("needs NumPy arrays of floats"):
        other.codegen("c", 0, tmp_path / "c", outputs=["motor_torques"])
    assert pickle.loads(pickle.dumps(other)) == other


@pytest.mark.parametrize("k", [1e-3, 0.5, 500.0])
def test_native_code_inverts_springs_whatever_they_carry(k):
    """Forces are 4e-3 to 8e7 times as large as k sqrt(k / k3)."""
    arm, q = ROBOT.elastic(spring=CubicSpring(k, 1e4), rotor=0.1), waves(np.linspace(0, 1, 9), 5)
    found = [*arm.motor_positions(*q, method="kernel"), *arm.motor_torques(*q, method="kernel")]
    expected = [*arm.motor_positions(*q, **SLOW), *arm.motor_torques(*q, **SLOW)]
    for x, y in zip(found, expected, strict=True):
        np.testing.assert_allclose(x, y, rtol=1e-10, atol=1e-12 * np.abs(y).max())
    np.testing.assert_allclose(CubicSpring(k, 1e4).force(found[0] - q[0]), ROBOT.inverse_dynamics(*q[:3]), rtol=1e-12)


def test_a_spring_soft_at_rest_has_positions_but_refuses_rates(tmp_path):
    spring = CubicSpring(0, 1e4)
    arm = ROBOT.elastic(spring={"joint1": spring}, stiffness={"joint2": K}, rotor=0.1)
    upright, zero = np.array([[0.3, 0.2], [np.pi / 2, 0.0]]), np.zeros((2, 2))
    theta = arm.motor_positions(upright, zero, zero)
    np.testing.assert_allclose(spring.force((theta - upright)[:, 0]), ROBOT.gravity_forces(upright)[:, 0], atol=1e-14)
    said = "joint 'joint1': the spring has no stiffness where it carries 1.8", "give CubicSpring a k above 0"
    refusal(lambda: arm.motor_positions(upright, zero, zero, zero), *said, "; state [1]")
    refusal(lambda: arm.motor_positions(upright[1], zero[1], zero[1], [1.0, 0]), *said)
    swing = Motion.polynomial([[np.pi / 2 - 0.5, 1.0], [0.0, 0.0]], 1.0)
    refusal(lambda: arm.motors_along(swing, np.linspace(0, 1, 11)), *said, "t = 0.5 s")
    crossing = "joint 'joint1': the force of its spring crosses zero between t = 0.4 s and 0.6 s", "k above 0"
    refusal(lambda: arm.motors_along(swing, [0.0, 0.6, 0.4, 0.2]), *crossing)
    for kind in ("motor_position", "motor_velocity", "motor_torque"):
        with expect_refusal("joint 'joint1'", f"limits of {kind} need"):
            arm.with_limits(**{kind: 9.0}).check(swing)
    still = Motion.polynomial([[0.3, 0.4], [0.2, 0.1]], 0.5)
    along = arm.motors_along(still, np.linspace(0, 0.5, 3))
    np.testing.assert_allclose(spring.force((along.positions[0] - along.rates[0])[:, 0]), force_of(along), rtol=1e-12)
    native = "stiffen cubically from a stiffness k above 0; that of joint 'joint1' is another"
    refusal(lambda: arm.motor_positions(upright, zero, zero, method="kernel"), native)
    refusal(lambda: arm.compile("motor_positions", order=0), native)
    with expect_refusal("has no stiffness k at rest needs NumPy arrays"):
        arm.codegen("c", 0, tmp_path / "c", outputs=["motor_positions"])
    refusal(lambda: ROBOT.elastic(spring=spring, rotor=0.1, damping=1.0), "'joint1' has no stiffness at rest")
    refusal(lambda: AntagonisticSprings(SINH, spring), "AntagonisticSprings: second has no stiffness at rest")


def force_of(along):
    return ROBOT.inverse_dynamics(*along.rates[:3])[:, 0]


def test_long_batches_name_the_state_without_stiffness(monkeypatch):
    """Batches are cut in pieces, and the index is that in the whole."""
    monkeypatch.setattr(generic_methods, "MAX_WORKING_BYTES", 1)
    arm = ROBOT.elastic(spring=CubicSpring(0, 1e4), rotor=0.1)
    q, zero = np.tile([0.3, 0.2], (2, 3, 1)), np.zeros((2, 3, 2))
    q[1, 0] = np.pi / 2, 0
    refusal(lambda: arm.motor_positions(q, zero, zero, zero + 1.0), "joint 'joint1'", "; state [1, 0]")


def test_limits_of_motors_hold_springs_and_couplings_of_every_kind():
    """`check` finds the largest velocity, and `slowdown` the factor at which it is the limit."""
    motors = {
        name: Motor(gear=50, inertia=4e-5, body=body) for name, body in (("joint1", "world"), ("joint2", "body1"))
    }
    motion = smooth_step()
    coupled = ROBOT.elastic(K, coupling=1, motors=motors)
    for arm in (ROBOT.elastic(spring=CUBIC, rotor=0.1), coupled):
        thetad = arm.motors_along(motion, np.linspace(0, 1, 501)).positions[1]
        found = arm.with_limits(motor_velocity=1.0).check(motion).worst
        np.testing.assert_allclose(found.ratio, np.abs(thetad).max(), rtol=1e-4)
    slow = coupled.with_limits(motor_velocity=1.0).slowdown(motion)
    thetad = coupled.motors_along(slow.motion, np.linspace(0, slow.motion.stop, 501)).positions[1]
    np.testing.assert_allclose(np.abs(thetad).max(), 1.0, rtol=1e-4)


@springs
def test_the_energy_of_a_spring_is_in_the_balance(name):
    arm, times = ROBOT.elastic(spring=SPRINGS[name], rotor=0.1), np.linspace(0, 1, 5)
    q = waves(quadrature_points(times), 4)
    theta, tau = arm.motor_positions(*q[:4], **SLOW), arm.motor_torques(*q, **SLOW)
    energy = arm.elastic_energy(q[0], q[1], theta[0], theta[1]).total[-5:]
    power = (tau * theta[1]).sum(-1)[:-5]
    np.testing.assert_allclose(np.diff(energy), work(times, power), atol=1e-10 * np.ptp(energy))


def test_feedback_linearisation_of_springs_that_are_not_linear():
    arm, q = ROBOT.elastic(spring=CUBIC, rotor=0.1), waves(0.3, 4)
    theta, thetad = arm.motor_positions(*q[:4], **SLOW)
    found = arm.feedback_linearization(q[0], q[1], theta, thetad, q[4], **SLOW)
    np.testing.assert_allclose(found, arm.motor_torques(*q, **SLOW), rtol=1e-10)


DAMPED = {"linear": {"stiffness": K}, "cubic": {"spring": CUBIC}}
damped = pytest.mark.parametrize("name", DAMPED)


@damped
@pytest.mark.parametrize("D", [0.05, 60.0])
def test_plants_with_dampers_follow_the_torques_along_a_motion(name, D):
    """tau takes q3d only; energy is taken up by the dampers: D delta'^2."""
    arm, times = ROBOT.elastic(rotor=0.1, damping=D, **DAMPED[name]), np.linspace(0, 1, 9)
    along = arm.motors_along(smooth_step(), np.sort(quadrature_points(times)))
    order = np.argsort(np.argsort(quadrature_points(times), kind="stable"), kind="stable")
    q, theta, [tau] = ([x[order] for x in found] for found in (along.rates, along.positions, along.torques))
    assert len(q) == 4
    undo(arm, q, theta, tau, 1e-8)
    energy = arm.elastic_energy(q[0], q[1], theta[0], theta[1]).total[-9:]
    power = (tau * theta[1] - D * (theta[1] - q[1]) ** 2).sum(-1)[:-9]
    np.testing.assert_allclose(np.diff(energy), work(times, power), atol=1e-10 * np.ptp(energy))


@damped
def test_deflections_of_dampers_are_integrals_of_their_rates(name):
    arm = ROBOT.elastic(rotor=0.1, damping=8.0, **DAMPED[name])
    times = np.linspace(0, 1, 9)
    along = arm.motors_along(smooth_step(), np.sort(quadrature_points(times)))
    order = np.argsort(np.argsort(quadrature_points(times), kind="stable"), kind="stable")
    theta, thetad = (x[order] for x in along.positions[:2])
    for j in range(2):
        np.testing.assert_allclose(np.diff(theta[-9:, j]), work(times, thetad[:-9, j]), atol=1e-11)


@damped
def test_torques_without_damping_are_those_of_the_spring(name):
    """d theta / d D = -delta' / phi' at D = 0."""
    t = np.linspace(0.1, 0.9, 9)
    arm = ROBOT.elastic(rotor=0.1, **DAMPED[name])
    at_rest = arm.motors_along(smooth_step(), t)
    q, theta = at_rest.rates, at_rest.positions
    delta = theta[0] - q[0]
    stiffness = K if name == "linear" else CUBIC.stiffness(delta)
    errors = []
    for D in (0.2, 0.1):
        found = ROBOT.elastic(rotor=0.1, damping=D, **DAMPED[name]).motors_along(smooth_step(), t)
        slope = (found.positions[0] - theta[0]) / D
        errors.append(np.abs(slope + (theta[1] - q[1]) / stiffness).max())
        assert np.abs(found.torques[0] - at_rest.torques[0]).max() < 40 * D
    assert errors[1] < 0.52 * errors[0] < 1e-4


def test_the_series_of_dampers_agrees_with_their_integral():
    t, D = np.linspace(0.1, 0.9, 9), 2.0
    q = smooth_step()(t, 8)
    exact = ROBOT.elastic(K, 0.1, damping=D).motors_along(smooth_step(), t)
    errors = []
    for terms in (1, 2, 3, 4, 5):
        arm = ROBOT.elastic(K, 0.1, damping=D, damping_terms=terms)
        theta = arm.motor_positions(*q[: 2 + terms])
        errors.append(np.abs(theta - exact.positions[0]).max())
        estimate = np.abs(arm.damping_error(*q[: 2 + terms])).max()
        assert terms == 1 or errors[-1] < estimate < 1.3 * errors[-2]
        tau = arm.motor_torques(*q[: 4 + terms])
        assert np.abs(tau - exact.torques[0]).max() < 300 * errors[-1] + 1e-9
    assert errors[-1] < 1e-5 * errors[0]
    slow = ROBOT.elastic(K, 0.1, damping=80.0)
    with expect_refusal("joint 'joint1': the series of the damper", "D/K is 0.16 s; use motors_along"):
        slow.motor_positions(*q[:6])
    refusal(lambda: slow.motor_positions(*q[:3]), "q2d is the last rate given", "take q5d too")
    refusal(lambda: ROBOT.elastic(K, 0.1).damping_error(*q[:3]), "no joint has a damper")
    state = [x[0] for x in q]
    refusal(lambda: slow.feedback_linearization(*state[:2], *state[:2], state[4]), "is not available with dampers")


def test_dampers_may_be_replaced_and_taken_away():
    arm = ROBOT.elastic(K, 0.1, damping=2.0)
    other = arm.elastic(damping={"joint1": 3.0}).elasticity
    assert [law.damping for law in other.springs] == [3.0, 2.0]
    q = smooth_step()(0.3, 4)
    without = arm.elastic(damping=0).motor_torques(*q, **SLOW)
    np.testing.assert_allclose(without, ROBOT.elastic(K, 0.1).motor_torques(*q, **SLOW), rtol=1e-12)


def test_motions_that_steps_do_not_resolve_are_refused(monkeypatch):
    """The exact deflection of a linear spring by quadrature: Q over the memory of 40 time constants, e^-40 = 4e-18."""
    arm, end = ROBOT.elastic(K, rotor=0.1, damping=5.0), 0.9
    motion = Motion.fourier([0.3, 0.2], [[1e-4, 2e-4]], [[1e-4, 1e-4]], 2 * np.pi * 250, 1.0)
    times = np.linspace(end - 0.4, end, 301)
    s = quadrature_points(times)[: -len(times)]
    Q = ROBOT.inverse_dynamics(*motion(s, 2)) * np.exp(-K / 5.0 * (end - s))[:, None] / 5.0
    expected = [work(times, Q[:, j]).sum() for j in range(2)]

    def check(t):
        found = arm.motors_along(motion, t)
        delta = found.positions[0] - found.rates[0]
        np.testing.assert_allclose(delta[-1], expected, atol=1e-10 * np.abs(expected).max())

    check([end])
    monkeypatch.setattr("jounce.actuators.motors._MAX_DAMPER_HALVINGS", 4)
    with expect_refusal("joint 'joint1': the deflection of", "by 3200 steps", "give more times t"):
        arm.motors_along(motion, [end])
    check(np.linspace(0, end, 2001))


@pytest.mark.parametrize("spring", [SpringTable(ROW / 6, CUBIC.force(ROW / 6)), CubicSpring(K, -3e4)])
def test_springs_with_dampers_end_where_those_without_do(spring):
    """At rest near the upright pose, which takes no force, the first arm then falls."""
    coefficients = np.zeros((2, 7))
    coefficients[:, [0, 5, 6]] = [np.pi / 2, -2, 1], [0, 0.2, -0.1]
    motion, said = Motion.polynomial(coefficients, 1.2), "joint 'joint1': "
    for D in (0.5, 20.0):
        arm = ROBOT.elastic(spring=spring, rotor=0.1, damping=D)
        refusal(lambda arm=arm: arm.motors_along(motion, [0.5, 1.2]), said, "deflected beyond its ends", "at t = 0.")
        arm.motors_along(motion, [0.5])
    arm = ROBOT.elastic(spring=spring, rotor=0.1)
    refusal(lambda: arm.motors_along(motion, np.linspace(0, 1.2, 31)), said, "no deflection of the spring carries")


def test_a_motion_with_a_jump_leaves_deflections_continuous():
    """q2d jumps: the force does, and a damper bears it at once."""
    motion = Motion.piecewise([0, 0.5, 1], [[[0.4, 0.2], [-0.4, 0.3]], [[0, 0], [0.4, 0.2]], [[0, 0], [0.1, 0.05]]])
    arm = ROBOT.elastic(K, rotor=0.1, damping=10.0)
    theta, thetad = arm.motors_along(motion, [0.5 - 1e-9, 0.5]).positions[:2]
    np.testing.assert_allclose(theta[0], theta[1], atol=1e-7)
    assert (np.abs(thetad[1] - thetad[0]) > 0.01).all()
    assert [(b.t, b.order) for b in arm.motors_along(motion).breaks] == [(0.5, -1)]


@pytest.mark.parametrize("seconds", [10.0, -1e5, 123456.789])
def test_jumps_of_motions_that_are_shifted_keep_their_sides(seconds):
    """Times of jumps are rounded; both sides were those after or before it, so that dampers were integrated wrongly."""
    motion = Motion.piecewise(
        [0, 0.37, 1], [[[0.4, 0.2], [-0.4, 0.3]], [[0, 0], [0.296, 0.148]], [[1, 0], [1.05, 0.03]]]
    )
    shifted = motion.shifted(seconds)
    [time] = {b.t for b in shifted.breaks_to(2)} - {shifted.start, shifted.stop}
    for side in ("left", "right"):
        np.testing.assert_allclose(shifted([time], 2, side)[2], motion([0.37], 2, side)[2])
    arm = ROBOT.elastic(K, rotor=0.1, damping=10.0)
    found, expected = (arm.motors_along(m, [0.9 + by]).positions[0] for m, by in ((shifted, seconds), (motion, 0.0)))
    np.testing.assert_allclose(found, expected, atol=1e-9)


@pytest.fixture(scope="module")
def variable():
    """A joint of variable stiffness, and a linear one."""
    return ROBOT.elastic({"joint2": K}, spring={"joint1": PAIR}, rotor={"joint1": 0.05, "joint2": 0.1})


def stiffness(t, order):
    return tuple(
        (k == 0) * 700.0 + 80 * 2.0**k * np.sin(2 * np.asarray(t) + k * np.pi / 2)[..., None] for k in range(order + 1)
    )


def test_plants_with_two_motors_follow_the_torques(variable):
    t = np.linspace(0, 1, 5)
    q, S = waves(t, 5), stiffness(t, 3)
    theta = variable.motor_positions(*q[:5], stiffness=S[:3])
    tau, taud = variable.motor_torques(*q, stiffness=S)
    assert [x.shape for x in (*theta, tau, taud)] == [(5, 3)] * 5
    undo(variable, q, theta, tau)
    first, second = (SINH.stiffness(theta[0][:, i] - q[0][:, 0]) for i in (0, 1))
    np.testing.assert_allclose(first + second, S[0][:, 0], rtol=1e-12)
    h = 1e-4
    before, after = (
        variable.motor_torques(*waves(t + side * h, 4), stiffness=stiffness(t + side * h, 2)) for side in (-1, 1)
    )
    np.testing.assert_allclose(taud, (after - before) / (2 * h), rtol=1e-5, atol=1e-4)
    linear = ROBOT.elastic(K, rotor=0.1).motor_torques(*q[:5], **SLOW)
    np.testing.assert_allclose(tau[:, 2], linear[:, 1], rtol=1e-12)
    W = tuple(np.random.default_rng(k).normal(size=(2, 6)) for k in range(3))
    tau, theta = (
        variable.motor_torques(*q[:5], stiffness=S[:3], wrench=W),
        variable.motor_positions(*q[:5], stiffness=S[:3], wrench=W),
    )
    undo(variable, q, theta, tau, wrench=W[0])


def test_energy_of_two_motors(variable):
    times = np.linspace(0, 1, 5)
    t = quadrature_points(times)
    q, S = waves(t, 4), stiffness(t, 2)
    theta = variable.motor_positions(*q[:4], stiffness=S[:2])
    power = (variable.motor_torques(*q, stiffness=S) * theta[1]).sum(-1)[:-5]
    energy = variable.elastic_energy(q[0], q[1], theta[0], theta[1]).total[-5:]
    np.testing.assert_allclose(np.diff(energy), work(times, power), atol=1e-10 * np.ptp(energy))


def test_two_motors_along_a_motion(variable):
    t = np.linspace(0, 1, 3)
    along = variable.motors_along(smooth_step(), t, 1, stiffness=stiffness(t, 3))
    expected = variable.motor_torques(*smooth_step()(t, 5), stiffness=stiffness(t, 3))
    for found, known in zip(along.torques, expected, strict=True):
        np.testing.assert_allclose(found, known, rtol=1e-11, atol=1e-10)
    constant = variable.motors_along(smooth_step(), t, stiffness={"joint1": 700.0})
    zeros = np.zeros((3, 1))
    expected = variable.motor_torques(*smooth_step()(t, 4), stiffness=(zeros + 700, zeros, zeros))
    np.testing.assert_allclose(constant.torques[0], expected, rtol=1e-11, atol=1e-10)


def test_what_two_motors_cannot_do_is_refused(variable):
    q, S = waves(0.3, 4), stiffness(0.3, 2)
    refusal(lambda: variable.motor_torques(*q), "stiffness is None; expected the stiffness of the joints", "joint1")
    refusal(lambda: variable.motor_torques(*q, stiffness=S[0]), "stiffness has 1 terms; expected a tuple (S, Sd, S2d)")
    refusal(lambda: variable.motor_positions(*q[:3], stiffness=[1, 2]), "stiffness has shape (2,); expected (..., 1)")
    with expect_refusal("stiffness: missing 'joint1'; unknown 'joint2'"):
        variable.motor_positions(*q[:3], stiffness={"joint2": 5})
    symbols = [np.array(sympy.symbols("x y"))] * 5
    refusal(lambda: variable.motor_torques(*symbols, stiffness=S), "joint 'joint1': two springs of one joint need")
    low = "joint 'joint1': no setting has stiffness 200 at force", "it is above 3"
    refusal(lambda: variable.motor_positions(*q[:3], stiffness=200), *low)
    where = low[0], ", at t = 0.2 s"
    rising = np.array([[900.0], [200.0], [900.0]])
    S = (rising, 0 * rising, 0 * rising)
    refusal(lambda: variable.motors_along(smooth_step(), [0, 0.2, 0.4], stiffness=S), *where)
    with expect_refusal("stiffness has shape (3, 1); expected (2, 1)"):
        variable.motors_along(smooth_step(), [0, 0.2], stiffness=S)
    refusal(lambda: variable.compile("motor_torques"), "joints with two motors take a stiffness, as native and")
    refusal(lambda: variable.feedback_linearization(q[0], q[1], [0] * 3, [0] * 3, q[4]), "joints with two motors")
    one = ROBOT.elastic(K, rotor=0.1)
    refusal(lambda: one.motor_torques(*q, stiffness=S), "stiffness is given; expected None, as no joint has two")
    motors = Motor(gear=50, inertia=1e-5, body="world")
    with expect_refusal("is not available for joints with two motors"):
        ROBOT.elastic(spring=PAIR, motors=motors, coupling=0)
    with expect_refusal("joint 'joint1' has two motors; expected no damp"):
        ROBOT.elastic(spring=PAIR, rotor=0.1, damping=1.0)


def test_a_table_that_is_left_tells_joint_time_and_bound():
    short = SpringTable(np.linspace(-0.03, 0.03, 31), CUBIC.force(np.linspace(-0.03, 0.03, 31)))
    arm = ROBOT.elastic({"joint1": K}, spring={"joint2": short}, rotor=0.1)
    said = "joint 'joint2': no deflection of the spring carries", "it carries -15.54 to 15.54"
    fast = smooth_step(0.3)
    refusal(lambda: arm.motors_along(fast, np.linspace(0, 0.3, 31)), *said, ", at t = 0.")


@pytest.mark.parametrize(("given", "said"), [
    ({}, "is unknown; give it with robot.elastic(stiffness) or spring=, infinity for rigid joints"),
    ({"stiffness": K, "spring": {"joint3": CUBIC}}, "unknown joint 'joint3'"),
    ({"spring": 5}, "spring of joint 'joint1' is 5; expected a CubicSpring, a SpringTable or a function"),
    ({"spring": lambda d: -d}, "spring of joint 'joint1': a spring function has stiffness -1 at rest"),
    ({"stiffness": [K, K], "spring": {"joint1": CUBIC}}, "joint 'joint1' has a stiffness and a spring; expected one"),
    ({"stiffness": {"joint1": K}, "spring": CUBIC}, "joint 'joint1' has a stiffness and a spring"),
    ({"stiffness": K, "damping": -1}, "damping of joint 'joint1' is -1; expected 0 or more"),
    ({"stiffness": K, "damping": np.nan}, "damping of joint 'joint1' is nan"),
    ({"stiffness": K, "damping": 1, "damping_terms": 0}, "damping_terms is 0; expected a whole number, 1 or more"),
    ({"stiffness": {"joint1": K}, "damping": 1}, "joint 'joint2' is rigid; expected no damper"),
    ({"stiffness": K, "motors": 5}, "motor of joint 'joint1' is 5; expected a jounce.Motor"),
    ({"stiffness": K, "motors": Motor(inertia=1e-5)}, "has the inertia of its rotor by rotor= and by its motor"),
])  # fmt: skip
def test_transmissions_that_cannot_be_are_refused(given, said):
    refusal(lambda: ROBOT.elastic(**({"rotor": 0.1} | given)), said)


@pytest.mark.parametrize(("given", "said"), [
    ({"gear": 0}, "gear of a motor is 0; expected a finite number, not 0"),
    ({"inertia": 0.0}, "inertia of a motor is 0.0; expected a finite number, above 0"),
    ({"resistance": np.nan}, "resistance of a motor is nan; expected a finite number, above 0"),
    ({"damping": -1}, "damping of a motor is -1; expected a finite number, 0 or more"),
    ({"body": 3}, "body of a motor is 3; expected the name of the body that carries it"),
    ({"axis": (0, 0, 0)}, "axis of a motor is (0, 0, 0); expected three finite numbers, not all 0"),
])  # fmt: skip
def test_motors_that_cannot_be_are_refused(given, said):
    refusal(lambda: Motor(**given), said)


MOTORS = {
    "joint1": Motor(
        gear=100, inertia=1e-5, damping=2e-5, friction=1e-3, resistance=0.5, inductance=2e-3, constant=0.05
    ),
    "joint2": Motor(gear=-80, inertia=2e-5, resistance=0.8, constant=0.04),
}


def test_motors_are_seen_through_their_gears():
    arm, q = ROBOT.elastic(K, motors=MOTORS), waves(np.linspace(0, 1, 5), 5)
    np.testing.assert_allclose(arm.elasticity.rotor, [0.1, 0.128])
    np.testing.assert_allclose(arm.elasticity.viscous, [0.2, 0.0])
    np.testing.assert_allclose(arm.elasticity.friction, [0.1, 0.0])
    tau, taud = arm.motor_torques(*q, **SLOW)
    theta = arm.motor_positions(*q, **SLOW)
    undo(arm, q, theta, tau)
    i, id_ = arm.motor_currents(*q)
    np.testing.assert_allclose(i, tau / [5.0, -3.2], rtol=1e-12)
    np.testing.assert_allclose(id_, taud / [5.0, -3.2], rtol=1e-12)
    u = arm.motor_voltages(*q)
    np.testing.assert_allclose(u, [0.5, 0.8] * i + [2e-3, 0] * id_ + [5.0, -3.2] * theta[1], rtol=1e-12)
    along = arm.motors_along(smooth_step(), [0.2, 0.5], 1)
    expected = smooth_step()([0.2, 0.5], 5)
    np.testing.assert_allclose(along.currents[1], arm.motor_currents(*expected)[1], rtol=1e-10)
    np.testing.assert_allclose(along.voltages[0], arm.motor_voltages(*expected), rtol=1e-10)
    assert arm.motors_along(smooth_step(), [0.2]).voltages is None


def test_electric_power_is_mechanical_power_plus_losses():
    """u i = R i^2 + L i i' + tau thetad."""
    arm, q = ROBOT.elastic(K, motors=MOTORS), waves(np.linspace(0, 1, 5), 5)
    (i, id_), u, thetad = arm.motor_currents(*q), arm.motor_voltages(*q), arm.motor_positions(*q[:4])[1]
    tau = arm.motor_torques(*q[:5])
    np.testing.assert_allclose(u * i, [0.5, 0.8] * i**2 + [2e-3, 0] * i * id_ + tau * thetad, rtol=1e-11)


def test_electrical_outputs_need_the_data_of_motors():
    q = waves(0.3, 5)
    bare = ROBOT.elastic(K, rotor=0.1)
    refusal(lambda: bare.motor_currents(*q[:5]), "motor_currents of 'planar2r' needs the torque constant of a motor")
    half = ROBOT.elastic(K, motors={"joint1": Motor(inertia=1e-2, constant=0.1), "joint2": Motor(inertia=1e-2)})
    assert np.isnan(half.motor_currents(*q[:5])).tolist() == [False, True]
    refusal(lambda: half.motor_voltages(*q), "motor_voltages of 'planar2r' needs the resistance of a motor")
    arm = ROBOT.elastic(K, motors=MOTORS)
    refusal(lambda: arm.motor_voltages(*q[:5]), "q4d is the last rate given", "take q5d too")
    along = bare.motors_along(smooth_step(), [0.2])
    assert along.currents is along.voltages is None
