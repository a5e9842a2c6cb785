"""Elastic joints: the equations of Spong's model, their inverse, what they control, and what is refused."""

import pickle
from dataclasses import replace

import jax
import numpy as np
import pytest
import sympy
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import jounce
from jounce.dynamics.computation import Computation
from jounce.native import cache
from jounce.native.code_forms import trace_program
from jounce.native.jit import host
from support.refusals import refusal
from support.robots import differentiated, golden, harmonic
from support.states import random_rates

PART = jounce.load("planar2r", L1=0.6, L2=0.4, m1=2.0, m2=1.5).mechanism
DRIVES = {"armature": [0.3, 0.2], "damping": [0.4, 0.1], "friction": [0.5, 0.3], "stiffness": [3.0, 2.0]}
DRIVEN = jounce.Robot.from_screws(PART.B, PART.X, PART.M, PART.parent, gravity=PART.gravity, drives=DRIVES)
K, B = np.array([80.0, 60.0]), np.array(DRIVES["armature"])


def elastic(robot, *arguments, **keywords):
    """The elastic joints of a robot whose acting drives move to the motors, which is said."""
    with pytest.warns(jounce.JounceWarning, match="no longer acts in Q, but on the motors"):
        return robot.elastic(*arguments, **keywords)


def assert_near(x, y, tolerance=1e-12):
    np.testing.assert_allclose(np.asarray(x, dtype=float), np.asarray(y, dtype=float), rtol=tolerance, atol=tolerance)


@pytest.fixture(scope="module")
def soft():
    """Two elastic joints with damping and friction on the motors, and springs of the file on the links."""
    return elastic(DRIVEN.with_drives(), K)


@pytest.fixture(scope="module")
def mixed():
    """Five joints of all kinds with damped motors, the second and the fourth rigid, one of them without a rotor."""
    stiffness, m = [900.0, np.inf, 4000.0, np.inf, 700.0], golden("mixed5")[0]
    damped = jounce.Robot(replace(m, drives=replace(m.drives, damping=np.full(5, 0.4)))).with_drives("damping")
    return elastic(damped, stiffness, rotor=[0.2, 0.3, 0.8, 0.0, 0.1])


def test_the_2r_obeys_lagranges_equations():
    t = sympy.Symbol("t")
    q, theta = ([sympy.Function(f"{x}{i}")(t) for i in (1, 2)] for x in ("q", "theta"))
    x1 = 0.6 * sympy.Matrix([sympy.cos(q[0]), sympy.sin(q[0])])
    x2 = x1 + 0.4 * sympy.Matrix([sympy.cos(q[0] + q[1]), sympy.sin(q[0] + q[1])])
    kinetic = (2.0 * x1.diff(t).dot(x1.diff(t)) + 1.5 * x2.diff(t).dot(x2.diff(t))) / 2
    rotors = sum(b * x.diff(t) ** 2 for b, x in zip(B, theta, strict=True)) / 2
    springs = sum(k * (y - x) ** 2 for k, x, y in zip(K, q, theta, strict=True)) / 2
    L = kinetic + rotors - 9.81 * (2.0 * x1[1] + 1.5 * x2[1]) - springs
    links, motors = ([L.diff(x.diff(t)).diff(t) - L.diff(x) for x in part] for part in (q, theta))
    # motors stand where nothing but the springs acts on the links
    path = dict(zip(q, [sympy.cos(3 * t) / 2, sympy.sin(2 * t + 1)], strict=True))
    solved = [(-x.subs(y, 0) / x.diff(y)).subs(path).doit() for x, y in zip(links, theta, strict=True)]
    arm = elastic(DRIVEN.with_drives("damping"), K)
    state, moved = (
        np.array([[x.diff(t, k).evalf(subs={t: 0.3}) for x in rates] for k in range(count)], dtype=float)
        for rates, count in ((path.values(), 5), (solved, 3))
    )
    here = {**dict(zip(q, state[0], strict=True)), **dict(zip(theta, moved[0], strict=True))}
    torques = [x.subs(y.diff(t, 2), a).subs(here) for x, y, a in zip(motors, theta, moved[2], strict=True)]
    assert_near(arm.motor_positions(*state), moved)
    assert_near(arm.motor_torques(*state), np.array(torques, dtype=float) + DRIVES["damping"] * moved[1])


def test_rates_are_derivatives_with_loads_too(soft):
    motion = harmonic(np.random.default_rng(2), 2, 7)
    load = lambda t: [np.full((2, 6), 3.0**k * np.cos(3 * t + k * np.pi / 2)) for k in range(5)]  # noqa: E731
    found = soft.motor_torques(*motion(0.0)[:7], wrench=tuple(load(0.0)))
    for k in (0, 1):
        before = lambda t, k=k: soft.motor_torques(*motion(t)[:7], wrench=tuple(load(t)))[k]  # noqa: E731
        assert_near(differentiated(before), found[k + 1], 1e-7)


@pytest.mark.parametrize("name", ["soft", "mixed"])
def test_forward_dynamics_inverts_motor_torques(name, request):
    arm = request.getfixturevalue(name)
    q, way = random_rates(arm.n, 5, 4, size=1.0), {"method": "recursion"}
    W = tuple(np.random.default_rng(1).uniform(-1, 1, (3, 4, arm.mechanism.nb, 6)))
    theta, thetad, theta2d = arm.motor_positions(*q, wrench=W, **way)
    tau = arm.motor_torques(*q, wrench=W, **way)
    found = arm.elastic_forward_dynamics(*q[:2], theta, thetad, tau, wrench=W[0], **way)
    assert_near(found[0], q[2], 1e-11)
    assert_near(found[1], theta2d, 1e-10)
    rigid = arm.elasticity.is_rigid
    unread = [np.where(rigid, 7.0, x) for x in (theta, thetad)]
    assert_near(arm.elastic_forward_dynamics(*q[:2], *unread, tau, wrench=W[0], **way), found)
    assert_near(arm.elastic_energy(*q[:2], *unread), arm.elastic_energy(*q[:2], theta, thetad))
    out = np.empty((4, arm.n)), np.empty((4, arm.n))
    assert arm.elastic_forward_dynamics(*q[:2], theta, thetad, tau, wrench=W[0], out=out, **way)[0] is out[0]
    assert_near(out, found, 0)


def test_torques_of_stiff_springs_approach_rigid_ones_as_1_by_k():
    q, rigid, way = (
        random_rates(DRIVEN.elastic(1.0).n, 5, 4, size=1.0),
        DRIVEN.with_drives("armature"),
        {"method": "recursion"},
    )
    Q, _, Q2d = DRIVEN.inverse_dynamics(*q, **way)
    expected = rigid.inverse_dynamics(*q[:3], **way)
    for k in (1e2, 1e4, 1e6):
        tau = DRIVEN.elastic(k).motor_torques(*q, **way)
        assert_near((tau - expected) * k, B * Q2d, 1e-8)
        assert_near((DRIVEN.elastic(k).motor_positions(*q[:3], **way) - q[0]) * k, Q, 1e-8)
    stiff = DRIVEN.elastic(np.inf)
    assert_near(stiff.motor_torques(*q, **way), expected)
    assert_near(stiff.motor_positions(*q, **way), q[:3], 0)
    found = stiff.elastic_forward_dynamics(q[0], q[1], q[0], q[1], expected, **way)
    assert_near(found, [rigid.forward_dynamics(*q[:2], expected, **way)] * 2)
    assert_near(found[0], q[2])


def test_energy_is_what_motors_give_and_friction_takes(soft):
    """Of links, rotors, springs and gravity, over two seconds, by quadrature of the power."""
    motion = harmonic(np.random.default_rng(4), 2, 4)
    nodes, weights = np.polynomial.legendre.leggauss(80)
    q = [np.stack(x) for x in zip(*(motion(1 + node) for node in [-1, *nodes, 1]), strict=True)]
    theta, thetad, _ = soft.motor_positions(*q, method="recursion")
    e = soft.elasticity
    lost = e.viscous * thetad + e.friction * np.tanh(thetad / e.eps)
    total = soft.elastic_energy(q[0], q[1], theta, thetad).total
    power = (thetad * (soft.motor_torques(*q, method="recursion") - lost)).sum(-1)
    tolerance = 1e-10 * np.ptp(total)
    assert abs(weights @ power[1:-1] - (total[-1] - total[0])) < tolerance
    assert abs(weights @ (thetad * lost).sum(-1)[1:-1]) > 1e3 * tolerance


def test_the_error_of_the_linearised_loop_has_the_placed_poles(soft):
    """(d/dt + p)^4 e = 0, from a state off the motion."""
    p, motion = 6.0, harmonic(np.random.default_rng(6), 2, 4)
    soft = DRIVEN.elastic(K)
    gains = np.array([p**4, 4 * p**3, 6 * p**2, 4 * p])

    def errors(t, x):
        """q to q3d less those of the motion, from the state."""
        q, qd, theta, thetad = x.reshape(4, 2)
        rates = q, qd, *soft.forward_dynamics(q, qd, K * (theta - q), K * (thetad - qd))
        return np.array(rates) - motion(t)[:4]

    def rate(t, x):
        q, qd, theta, thetad = x.reshape(4, 2)
        tau = soft.feedback_linearization(q, qd, theta, thetad, motion(t)[4] - gains @ errors(t, x))
        q2d, theta2d = soft.elastic_forward_dynamics(q, qd, theta, thetad, tau)
        return np.concatenate([qd, q2d, thetad, theta2d])

    off = [a + b for a, b in zip(motion(0.0), [[0.1, -0.05], [0.2, 0.3], [0.5, -1.0], [2.0, 1.0]], strict=False)]
    theta, thetad = soft.motor_positions(*off)
    start = np.concatenate([off[0], off[1], theta, thetad])
    found = solve_ivp(rate, (0, 1), start, "DOP853", [0.0, 0.4, 1.0], rtol=1e-12, atol=1e-13)
    companion = np.vstack([np.eye(4)[1:], -gains])
    for t, x in zip(found.t, found.y.T, strict=True):
        assert_near(errors(t, x), expm(companion * t) @ errors(0.0, start), 1e-9)


def test_feedback_and_energy_take_other_scalars(soft):
    """What the table of scalar types leaves out: joints that are all elastic, and what is no quantity."""
    one = soft.locked({"joint2": 0.3})
    x = random_rates(one.n, 5, size=1.0)
    exact = one.feedback_linearization(*(v.astype(np.longdouble) for v in x))
    assert exact.dtype == np.longdouble
    assert_near(exact, one.feedback_linearization(*x, method="recursion"))
    with jax.enable_x64(True):
        assert_near(jax.jit(one.elastic_energy)(*x[:4]), one.elastic_energy(*x[:4]))


def test_elastic_joints_start_from_the_drives_of_a_file():
    """Armature counts once; what acted moves to the motors; what did not act stays away."""
    plain, acting = DRIVEN.elastic(K), elastic(DRIVEN.with_drives(), K)
    assert_near(plain.elasticity.rotor, B)
    assert not plain.elasticity.viscous.any()
    assert_near(acting.elasticity.viscous, DRIVES["damping"])
    assert_near(acting.elasticity.friction, DRIVES["friction"])
    assert acting.mechanism.acting == ("spring",)
    assert_near(acting.elasticity.rotor, B)
    again = acting.elastic({"joint1": 90.0}, rotor={"joint2": 0.7})
    assert_near(again.elasticity.stiffness, [90.0, np.inf])
    assert_near(again.elasticity.rotor, [0.3, 0.7])
    assert_near(again.elasticity.viscous, DRIVES["damping"])
    said = "damping, friction, load_friction, stribeck would act on the links", "select drive terms before elastic()"
    refusal(acting.with_drives, *said)
    assert acting.with_drives("spring").mechanism.elasticity is acting.elasticity


def test_joints_that_follow_one_coordinate_add_up():
    G, drives = [[1.0], [-0.5]], DRIVES | {"eps": [0.2, 0.1]}
    robot = jounce.Robot.from_screws(PART.B, PART.X, PART.M, PART.parent, G=G, drives=drives).with_drives()
    e = elastic(robot, 50.0).elasticity
    for x, expected in ((e.rotor, 0.35), (e.viscous, 0.425), (e.friction, 0.65), (e.eps, 0.2)):
        assert_near(x, [expected])
    uneven = robot.with_drives(eps=0.1)
    refusal(lambda: uneven.elastic(50.0), "friction of joint1, joint2 turns over at different speeds")


def test_locked_joints_take_their_springs_away_and_copies_keep_them(soft):
    left = soft.locked({"joint1": 0.3}).mechanism.elasticity
    assert_near(left.stiffness, K[1:])
    assert pickle.loads(pickle.dumps(soft)) == soft != DRIVEN.elastic(K)
    assert hash(soft) == hash(pickle.loads(pickle.dumps(soft)))
    with pytest.raises(ValueError, match="read-only"):
        soft.elasticity.stiffness[0] = 1.0


def test_native_code_is_that_of_the_springs_it_was_compiled_for(soft):
    other = DRIVEN.with_drives("spring").elastic(2 * K).mechanism
    for name, same in (("motor_torques", False), ("motor_positions", False), ("inverse_dynamics", True)):
        keys = {cache.key(m, Computation(name, 0), host()) for m in (soft.mechanism, other)}
        assert (len(keys) == 1) is same
    q = random_rates(soft.n, 6, 4, size=1.0)
    kernel = soft.compile("motor_torques", order=1)
    assert_near(kernel(*q), soft.motor_torques(*q, method="recursion"))
    assert soft.compile("motor_positions").signature.outputs[0].name == "theta"


def test_the_head_of_generated_code_states_springs_and_motors(tmp_path):
    DRIVEN.elastic([80, np.inf]).codegen("c", 0, tmp_path / "c", outputs=["motor_torques"])
    head = (tmp_path / "c" / "robot.h").read_text()
    assert "By coordinate: stiffness K 80 inf; rotor inertia B 0.3 0.2." in head
    assert "These terms of the robot's drive trains are omitted: damping, friction, spring." in head  # not the armature


def test_torques_take_hardly_more_operations_than_forces_to_order_2():
    robot = jounce.load("panda")
    forces = len(trace_program(robot.mechanism, Computation("inverse_dynamics", 2)).steps)
    torques = len(trace_program(robot.elastic(1e4, rotor=0.5).mechanism, Computation("motor_torques", 0)).steps)
    assert torques < 1.05 * forces


def test_torques_along_a_motion_jump_where_snap_does():
    arm, coefficients = DRIVEN.elastic(K), np.zeros((5, 2, 2))
    coefficients[0, 1] = [1.0, 2.0]  # (t - 0.5)^4 from 0.5 on
    motion = jounce.Motion.piecewise([0, 0.5, 1], coefficients)
    found = arm.motors_along(motion, [0.2, 0.8], order=1)
    assert [len(x) for x in (found.rates, found.positions, found.torques)] == [6, 4, 2]
    assert_near(found.torques, arm.motor_torques(*found.rates))
    assert_near(found.positions, arm.motor_positions(*found.rates))
    [jump] = found.breaks
    assert (jump.t, jump.order, found.deviations) == (0.5, 0, None)
    assert_near(jump.jump, B / K * (DRIVEN.mass_matrix([0.0, 0.0]) @ [24.0, 48.0]))


NAN = float("nan")


@pytest.mark.parametrize(("given", "words"), [
    ({"stiffness": [80, 0]}, "stiffness of joint 'joint2' is 0; expected a positive number, N m/rad, or infinity"),
    ({"stiffness": {"joint1": -5}}, "stiffness of joint 'joint1' is -5; expected a positive number, N m/rad"),
    ({"stiffness": NAN}, "stiffness of joint 'joint1' is nan; expected"),
    ({"stiffness": [1, 2, 3]}, "stiffness has shape (3,); expected one number, (2,) one per coordinate"),
    ({"stiffness": {"joint3": 1}}, "unknown joint 'joint3'; did you mean 'joint2'? available: joint1, joint2"),
    ({"stiffness": {"joint1": [1, 2]}}, "stiffness of joint 'joint1' is [1, 2]; expected a number"),
    ({"rotor": 0}, "rotor of joint 'joint1' is 0; expected a positive number, kg m^2 as seen from the link"),
    ({"rotor": {"joint2": -1}}, "rotor of joint 'joint2' is -1; expected"),
    ({"rotor": [1, NAN]}, "rotor of joint 'joint2' is nan; expected"),
    ({"rotor": np.inf}, "rotor of joint 'joint1' is inf; expected"),
    ({"coupling": "level 9"}, "coupling is 'level 9'; expected 'spong'"),
])  # fmt: skip
def test_refusals_of_springs_and_rotors(given, words):
    refusal(lambda: DRIVEN.elastic(**{"stiffness": K} | given), words)


def test_other_refusals(soft):
    two, rigid = [0.1, 0.2], jounce.load("planar2r")
    missing = "the rotor inertia of joint 'joint1' is unknown, since it has no armature; give it with robot.elastic("
    refusal(lambda: rigid.elastic(K), missing)
    refusal(lambda: rigid.compile("motor_torques", 0), "its joints are rigid; robot.elastic(stiffness) makes them")
    refusal(lambda: rigid.codegen("c", outputs=["motor_torques"]), "its joints are rigid; robot.elastic(stiffness)")
    refusal(lambda: soft.motor_torques(two, two, two, two, None), "q4d is None; expected every rate up to the last")
    refusal(lambda: soft.elastic_forward_dynamics(two, two, None, two, two), "theta is None, yet thetad is given")
    refusal(lambda: soft.motor_torques(*[two] * 5, wrench=np.zeros((2, 6))), "order 0 takes a tuple (W, Wd, W2d)")
    half = DRIVEN.elastic({"joint1": 80})
    refusal(lambda: half.feedback_linearization(*[two] * 5), "needs elastic joints, but joint2 is rigid")


SPOILT = np.array([0.1, 0.2])
WOUND = {
    "joint1": jounce.Motor(gear=100, inertia=1e-5, resistance=0.5, inductance=2e-3, constant=0.05),
    "joint2": jounce.Motor(gear=-80, inertia=2e-5, resistance=0.8, constant=0.04),
}


def test_quantities_of_elastic_robots_are_those_of_their_links(soft):
    three, links = [SPOILT] * 3, jounce.Robot(replace(soft.mechanism, elasticity=None))
    Q = soft.inverse_dynamics(*three)
    assert_near(Q, links.inverse_dynamics(*three), 0)
    assert_near(soft.forward_dynamics(*three[:2], Q), SPOILT, 1e-11)
    assert_near(soft.compile(order=0)(*three), Q)
    assert np.abs(soft.motor_torques(*[SPOILT] * 5) - Q).max() > 1e-3


def test_what_only_elastic_joints_have_refuses_rigid_ones():
    motion, q = jounce.Motion.fourier([0, 0], [[0.1, 0.2]], [[0, 0]], 2.0, 3.0), [SPOILT] * 5
    rows = "motor_positions motor_torques motor_commands motor_currents motor_voltages"
    given = dict.fromkeys(f"{rows} elastic_forward_dynamics feedback_linearization".split(), q) | {
        "motors_along": [motion],
        "elastic_energy": q[:4],
        "damping_error": q,
    }
    for name, arguments in given.items():
        why = f"{name} of {DRIVEN.name!r}: its joints are rigid; robot.elastic(stiffness) makes them elastic"
        refusal(lambda name=name, arguments=arguments: getattr(DRIVEN, name)(*arguments), why)
    assert DRIVEN.elasticity is None


@pytest.mark.parametrize("loaded", [False, True])
def test_one_call_gives_what_two_calls_do(loaded):
    arm, rng = jounce.load("iiwa14").elastic(1e4, rotor=0.4), np.random.default_rng(9)
    q, W = rng.uniform(-1, 1, (5, 4, 7)), tuple(rng.uniform(-9, 9, (3, 4, 7, 6)))
    theta, thetad, tau = arm.motor_commands(*q, wrench=W if loaded else None)
    found = arm.motor_positions(*q[:4], wrench=W[:2] if loaded else None)
    for x, expected in zip((theta, thetad), found, strict=True):
        assert_near(x, expected)
    assert_near(tau / 1e3, arm.motor_torques(*q, wrench=W if loaded else None) / 1e3)


def test_motors_without_data_give_nan_and_refuse_expressions(tmp_path):
    arm = DRIVEN.elastic(K, motors=WOUND | {"joint2": jounce.Motor(inertia=1e-2)})
    assert np.isnan(arm.motor_voltages(*[SPOILT] * 6)).tolist() == [False, True]
    refusal(lambda: arm.symbolic().i, "a number is missing, as those of motors that do not state all")
    refusal(lambda: arm.codegen("c", 0, tmp_path / "c", outputs=["motor_currents"]), "would contain nan")


def test_symbols_are_the_equations_of_the_model():
    S = jounce.load("planar2r", g=10).elastic([80, np.inf], rotor=3).symbolic()
    assert sympy.expand(S.theta[0] - S.q[0] - S.Q[0] / 80) == 0
    assert S.theta[1] == S.q[1]
    assert sympy.expand(S.tau[0] - S.Q[0] - 3 * (S.q2d[0] + S.Q2d[0] / 80)) == 0
    assert sympy.expand(S.tau[1] - S.Q[1] - 3 * S.q2d[1]) == 0
    assert sympy.expand(S.dot(S.tau)[1] - S.taud[1]) == 0
