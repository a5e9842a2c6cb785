"""Motors that move several joints together: every quantity in coordinates of joints and of motors, against A^-T."""

import re
from dataclasses import replace

import numpy as np
import pytest

import jounce
from jounce.arguments.loops import MIN_RATIO_INVERSE_CONDITION
from jounce.limits.samples import reported_limits
from jounce.model.transmissions import with_followers
from jounce.motion.table import MAX_FOLLOWER_OFFSET
from support.refusals import expect_refusal, refusal

ALPHA = 40 / 65  # of iCub's shoulders: robotology/robots-configuration, iCubGenova04, left_arm-eb1-j0_3-mec.xml
MATRICES = {
    "parallel shafts": [[1, 0], [0.4, 1]],  # of a wrist, as Staubli's: phi6 = q6 + r q5
    "differential": [[50, 50], [50, -50]],
    "iCub's shoulder": np.linalg.inv([[1, 0, 0], [1, ALPHA, 0], [0, -ALPHA, ALPHA]]),  # their matrixM2J
}
STATE = np.random.default_rng(0).uniform(-1, 1, (5, 4, 7))  # q .. q4d of four states


def couple(matrix, **options):
    """The iiwa with some of its last joints coupled, its matrix for all joints, and phi0."""
    arm = jounce.load("iiwa14")
    k = len(matrix)
    whole = np.eye(7)
    whole[6 - k : 6, 6 - k : 6] = matrix
    offset = 0.1 * np.arange(1, k + 1)
    motors = [f"motor{j}" for j in range(7 - k, 7)]
    coupled = arm.with_transmission(matrix, motors, arm.joint_names[6 - k : 6], offset, **options)
    return arm, coupled, whole, np.pad(offset, (6 - k, 1))


@pytest.fixture(scope="module", params=MATRICES)
def cases(request):
    return couple(MATRICES[request.param])


def motor_states(whole, phi0):
    return [STATE[0] @ whole.T + phi0, *(STATE[1:] @ whole.T)]


def assert_each_close(found, expected, tolerance=1e-12):
    for x, y in zip(found, expected, strict=True):
        assert np.abs(x - y).max() <= tolerance * max(1, np.abs(y).max())


def test_motor_torques_are_those_of_joints_by_the_inverse_transpose(cases):
    arm, coupled, whole, phi0 = cases
    expected = [np.linalg.solve(whole.T, Q.T).T for Q in arm.inverse_dynamics(*STATE)]
    assert_each_close(coupled.inverse_dynamics(*STATE), arm.inverse_dynamics(*STATE))
    assert_each_close(coupled.actuator_forces(*STATE), expected)
    assert_each_close(coupled.closed().inverse_dynamics(*motor_states(whole, phi0)), expected)


def test_motors_take_the_places_of_joints(cases):
    _, coupled, _, _ = cases
    k = len(coupled.mechanism.joints) - 7
    own = coupled.joint_names
    assert coupled.closed().joint_names == (*own[: 6 - k], *(f"motor{j}" for j in range(7 - k, 7)), own[6])


def test_power_of_motors_is_that_of_joints_with_all_rates(cases):
    _, coupled, _, _ = cases
    names = coupled.mechanism.joints
    motors = [names.index(name) for name in coupled.closed().joint_names]
    tau, Q = coupled.actuator_forces(*STATE), coupled.inverse_dynamics(*STATE)
    _, *phi = coupled.coordinates(*STATE[:4])
    phi = [x[..., motors] for x in phi]
    for k in range(3):
        both = [
            sum(c * (x[j] * y[k - j]).sum(-1) for j, c in enumerate([[1], [1, 1], [1, 2, 1]][k]))
            for x, y in ((phi, tau), (list(STATE[1:4]), Q))
        ]
        assert_each_close(both[:1], both[1:], 1e-12)


def test_matrices_and_momenta_of_motors(cases):
    arm, coupled, whole, phi0 = cases
    motors, states = coupled.closed(), motor_states(whole, phi0)
    inverse = np.linalg.inv(whole)
    M, Md = motors.mass_matrix(*states[:2])
    assert_each_close([M, Md], [inverse.T @ x @ inverse for x in arm.mass_matrix(*STATE[:2])])
    assert_each_close([motors.kinetic_energy(*states[:2])[0]], [arm.kinetic_energy(*STATE[:2])[0]])
    forces = motors.inverse_dynamics(*states[:3])
    assert_each_close([motors.forward_dynamics(states[0], states[1], forces)], [states[2]], 1e-10)


@pytest.mark.parametrize("k", range(3))
def test_inertia_and_friction_of_motors_act_on_them(k):
    data = {"motor5": jounce.Motor(gear=-10, inertia=1e-3, damping=2e-2, friction=0.3), "motor6": None}
    arm, coupled, whole, phi0 = couple(MATRICES["differential"])
    coupled = arm.with_transmission(MATRICES["differential"], data, arm.joint_names[4:6], phi0[4:6])
    driven, at = coupled.with_drives(), motor_states(whole, phi0)
    added = driven.actuator_forces(*STATE)[k] - coupled.actuator_forces(*STATE)[k]
    v, slow = at[1][:, 4], coupled.drives.eps[7]
    y = np.tanh(v / slow)
    rates = [y, (1 - y * y) * at[2][:, 4] / slow]
    rates += [(1 - y * y) * (at[3][:, 4] / slow - 2 * y * (at[2][:, 4] / slow) ** 2)]
    expected = np.zeros((4, 7))
    expected[:, 4] = 0.1 * at[2 + k][:, 4] + 2.0 * at[1 + k][:, 4] + 3.0 * rates[k]
    assert_each_close([added], [expected], 1e-11)
    assert_each_close([driven.closed().inverse_dynamics(*at)[k]], [driven.actuator_forces(*STATE)[k]])


def test_more_motors_than_joints_share_by_weights():
    arm, A = jounce.load("planar2r"), np.array([[1, 0], [1, 1], [0, 1]])
    W = np.diag([1.0, 2.0, 3.0])
    names = ["joint1", "joint2"]
    robot = arm.with_transmission(A, ["a", "b", "c"]).closed(coordinates=names, weights=[1, 2, 3])
    assert robot.closed(coordinates=names) == robot
    state = STATE[:, :, :2]
    inverse = np.linalg.inv(W)
    share = inverse @ A @ np.linalg.inv(A.T @ inverse @ A)
    assert_each_close(robot.actuator_forces(*state), [Q @ share.T for Q in arm.inverse_dynamics(*state)])
    refusal(lambda: robot.closed(), "moves in 2 ways; name as many of a, b, c")
    motion = jounce.Motion.polynomial([[0, 0, 0, 0, 35, -84, 70, -20]] * 2, 1.0)
    found = robot.with_limits(effort={"a": 25.0}, effort_rate={"c": 50.0}, velocity=10.0).retime(motion)
    t = np.linspace(0, found.duration, 500)
    u, ud = (x @ share.T for x in arm.inverse_dynamics(*found.motion(t, 3)))
    assert 0.98 < max(np.abs(u[:, 0]).max() / 25, np.abs(ud[:, 2]).max() / 50) < 0.9901


def test_floating_robots_keep_the_wrench_on_their_base():
    dog = jounce.load("solo12", base="floating")
    coupled = dog.with_transmission([[1, 0], [-1, 1]], ["hip", "knee"], dog.joint_names[1:3])
    rng = np.random.default_rng(1)
    states, base = rng.uniform(-1, 1, (5, 12)), (np.eye(4), *rng.uniform(-1, 1, (4, 6)))
    whole = np.eye(12)
    whole[1:3, 1:3] = [[1, 0], [-1, 1]]
    Q = dog.inverse_dynamics(*states, base=base)
    expected = [np.concatenate([x[:6], np.linalg.solve(whole.T, x[6:])]) for x in Q]
    assert_each_close(coupled.closed().inverse_dynamics(*states @ whole.T, base=base), expected)
    assert_each_close(coupled.actuator_forces(*states, base=base), [x[6:] for x in expected])


def test_elastic_joints_of_motors():
    """With infinite stiffness motors are those of the coordinates; springs are at the motors."""
    _, coupled, whole, phi0 = couple(MATRICES["parallel shafts"])
    motors, at = coupled.closed(), motor_states(whole, phi0)
    tau = motors.elastic(np.inf).motor_torques(*at)
    assert_each_close([tau], [motors.inverse_dynamics(*at[:3])])
    theta = motors.elastic(1e4, rotor=0.1).motor_positions(*at[:3])
    assert_each_close([theta], [at[0] + motors.inverse_dynamics(*at[:3]) / 1e4])
    refusal(lambda: coupled.elastic(1e4), "robot.closed() has those of the motors")


def test_products_of_kernels_follow():
    _, coupled, whole, phi0 = couple(MATRICES["parallel shafts"])
    state, rng = STATE[:, 0], np.random.default_rng(2)
    kernels = [coupled.compile("actuator_forces", order=2), coupled.closed().compile(order=2)]
    assert [port.name for port in kernels[0].signature.inputs] == ["q", "qd", "q2d", "q3d", "q4d"]
    weights, along = tuple(rng.uniform(-1, 1, (3, 7))), tuple(rng.uniform(-1, 1, (5, 7)))
    at = [state, np.array([x[0] for x in motor_states(whole, phi0)])]
    gradients = [kernel.vjp(tuple(x), weights) for kernel, x in zip(kernels, at, strict=True)]
    tangents = kernels[0].jvp(tuple(state), along)
    assert_each_close(gradients[0], [x @ whole for x in gradients[1]], 1e-11)
    np.testing.assert_allclose(np.vdot(gradients[0], along), np.vdot(weights, tangents), rtol=1e-11)


def test_files_hold_motors_and_what_they_follow(tmp_path):
    _, coupled, _, _ = couple(MATRICES["iCub's shoulder"])
    coupled = coupled.with_limits(effort={"motor4": 3.0})
    for robot in (coupled, coupled.closed()):
        for file in ("robot.yaml", "robot.json"):
            jounce.save(robot, tmp_path / file)
            with pytest.warns(jounce.JounceWarning, match="inconsistent inertia"):
                assert jounce.load(tmp_path / file) == robot
    planar = jounce.load("planar2r").with_transmission([[1, 0], [1, 1], [0, 1]], ["a", "b", "c"])
    planar = planar.closed(coordinates=["joint1", "joint2"], weights={"b": 2.0})
    jounce.save(planar, tmp_path / "planar.yaml")
    assert "weights: {a: 1.0, b: 2.0, c: 1.0}" in (tmp_path / "planar.yaml").read_text()
    assert jounce.load(tmp_path / "planar.yaml") == planar


def test_a_mimic_joint_may_have_the_motor():
    """Q of the leader is that of the follower times the ratio."""
    panda = jounce.load("panda")
    names = panda.joint_names
    fingers = [*names[:7], "panda_finger_joint2"]
    moved = panda.closed(actuated=fingers, coordinates=names)
    state = np.random.default_rng(3).uniform(0, 1, (3, 8))
    assert_each_close([moved.actuator_forces(*state)], [panda.inverse_dynamics(*state)])  # the ratio is 1


def test_locked_joints_keep_the_motors_of_others():
    arm, coupled, whole, phi0 = couple(MATRICES["parallel shafts"])
    some = coupled.locked({"joint1": 0.3})
    plain = arm.locked({"joint1": 0.3})
    state = STATE[:3, 0, 1:]
    expected = np.linalg.solve(whole[1:, 1:].T, plain.inverse_dynamics(*state))
    assert_each_close([some.actuator_forces(*state)], [expected])
    held = coupled.closed().locked({"motor5": 0.2})
    joints = np.linalg.solve(whole, np.insert(STATE[0, 0, :6], 4, 0.2) - phi0)
    assert_each_close([held.coordinates(STATE[0, 0, :6])[:5]], [np.delete(joints, 4)[:5]])
    both = coupled.locked({"joint5": 0.1, "joint6": 0.2})
    assert both.mechanism.joints == both.joint_names == (*arm.joint_names[:4], "joint7")


def test_all_coordinates_are_taken_where_motors_are_in_their_places():
    _, coupled, _, _ = couple(MATRICES["parallel shafts"])
    whole = coupled.coordinates(STATE[0, 0])
    state = STATE[1:3, 0]
    assert_each_close([coupled.inverse_dynamics(whole, *state)], [coupled.inverse_dynamics(STATE[0, 0], *state)], 0)
    with expect_refusal("motor6 = … it follows … by constant ratios"):
        coupled.inverse_dynamics(whole + 1e-3 * (np.arange(9) == 8), *state)


@pytest.fixture(scope="module")
def limited_pair():
    """A robot with limits in both coordinates, with the same motion in each, and the robot without its motors."""
    arm, coupled, whole, phi0 = couple(MATRICES["parallel shafts"])
    stated = {"effort": {"motor6": 1.0, "joint2": 70.0}, "velocity": {"motor6": 2.2, "joint6": 2.0}}
    robots = [x.with_limits(effort_rate={"motor5": 20.0}, **stated) for x in (coupled, coupled.closed())]
    way = np.array([[a, 0, 0, 0, 35 * b, -84 * b, 70 * b, -20 * b] for a, b in STATE[:2, 0].T])
    motions = [jounce.Motion.polynomial(x, 1.0) for x in (way, whole @ way + np.outer(phi0, np.eye(8)[0]))]
    return arm, whole, list(zip(robots, motions, strict=True))


def test_limits_of_motors_are_judged_as_brute_force_does(limited_pair):
    arm, whole, cases = limited_pair
    rates = cases[0][1](np.linspace(0, 1, 20001), 3)
    tau, taud = (np.linalg.solve(whole.T, Q.T).T for Q in arm.inverse_dynamics(*rates))
    phid = rates[1] @ whole.T
    expected = {
        ("motor6", "effort"): tau[:, 5], ("joint2", "effort"): tau[:, 1], ("motor5", "effort_rate"): taud[:, 4],
        ("motor6", "velocity"): phid[:, 5], ("joint6", "velocity"): rates[1][:, 5],
    }  # fmt: skip
    for robot, motion in cases:
        found = {(row.joint, row.limit): abs(row.value) for row in robot.check(motion).table}
        assert found == {key: pytest.approx(np.abs(x).max(), rel=1e-6) for key, x in expected.items()}
        trips = robot.explain(motion.scaled(0.5), rate=1000).trips
        assert {x.joint for x in trips} & {"motor5", "motor6"}


def test_motions_become_as_fast_in_both_coordinates(limited_pair):
    durations, factors = [], []
    for robot, motion in limited_pair[2]:
        faster, slow = robot.retime(motion), robot.slowdown(motion, up_to_limits=True)
        assert robot.check(faster.motion).worst.ratio == pytest.approx(0.99, abs=1e-4)
        assert robot.check(slow.motion).worst.ratio == pytest.approx(1, abs=1e-6)
        assert {x.joint for x in faster.binding} & {"motor5", "motor6"}
        durations.append(faster.duration)
        factors.append(slow.factor)
    np.testing.assert_allclose(durations[0], durations[1], rtol=1e-6)
    np.testing.assert_allclose(factors[0], factors[1], rtol=1e-9)


def test_power_limits_of_motors_bound_retiming(limited_pair):
    """Of phi' tau, along the whole motion, where nothing else decides."""
    arm, whole, [(robot, motion), _] = limited_pair
    free = dict.fromkeys(["motor5", "motor6", "joint2"], np.inf)
    robot = robot.with_limits(effort=free, effort_rate=np.inf, velocity=50.0, power={"motor6": 1.0})
    found = robot.retime(motion)
    rates = found.motion(np.linspace(0, found.duration, 2001), 2)
    tau = np.linalg.solve(whole.T, arm.inverse_dynamics(*rates).T).T
    assert np.abs((tau * (rates[1] @ whole.T))[:, 5]).max() == pytest.approx(0.99, abs=1e-3)


@pytest.mark.parametrize("eps", [0.05, 0.002])
def test_friction_of_motors_that_turn_round_between_samples_is_seen(eps):
    """The rate of the friction peaks within eps / phi2d, 0.1 ms for the latter."""
    arm, *_ = couple(MATRICES["parallel shafts"])
    data = {"motor5": None, "motor6": jounce.Motor(friction=3.0)}
    robot = arm.with_transmission(MATRICES["parallel shafts"], data, arm.joint_names[4:6]).with_drives("friction", eps)
    t = np.linspace(0, 1, 21)
    q = 0.5 * np.sin(2 * np.pi * t[:, None] * (1 + 0.13 * np.arange(7)) + np.arange(7))
    motion = jounce.load_motion({"t": t, **dict(zip(arm.joint_names, q.T, strict=True))}, arm, degree=7)
    [row] = robot.with_limits(effort_rate={"motor6": 20.0}).check(motion).table
    rates = motion(row.t + np.linspace(-1e-3, 1e-3, 2001), 3)
    assert abs(row.value) == pytest.approx(np.abs(robot.actuator_forces(*rates)[1][:, 5]).max(), rel=2e-3)
    every = motion(np.linspace(0, 1, 20001), 3)
    assert abs(row.value) >= 0.999 * np.abs(robot.actuator_forces(*every)[1][:, 5]).max()


def test_identification_at_the_motors_finds_their_friction():
    planar = jounce.load("planar2r")
    A = np.array([[1, 0], [1, 1]])
    data = [{"a": None, "b": jounce.Motor(damping=x, friction=y)} for x, y in ((0.5, 0.8), (0.3, 0.5))]
    truth, guess = (planar.with_transmission(A, x).closed().with_drives() for x in data)
    t = np.linspace(0, 10, 2001)
    w = 2 * np.pi * t
    phi = np.stack([np.sin(0.3 * w) + 0.5 * np.sin(0.7 * w), np.sin(0.5 * w) + 0.5 * np.sin(0.9 * w)], axis=1)
    motion = jounce.load_motion({"t": t, "a": phi[:, 0], "b": phi[:, 1]}, truth)
    tau = truth.inverse_dynamics(*motion(t, 2)) + np.random.default_rng(4).normal(0, 0.05, (2001, 2))
    with pytest.warns(jounce.JounceWarning, match="do not determine joint1 damping, a damping"):  # a turns as joint1
        found = guess.identify(motion, tau, t=t, drives=["damping", "friction"])
    values = {row.name: row.value for row in found.table}
    assert values["b damping"] == pytest.approx(0.5, abs=0.02)
    assert values["b friction"] == pytest.approx(0.8, abs=0.02)


@pytest.mark.parametrize("friction", [0.0, 2.0])
def test_efforts_of_joints_bound_what_all_motors_make_together(friction):
    """Q of a joint, and the torques of motors, against a dense oracle: check, slowdown, retime, report."""
    m = jounce.load("planar2r").mechanism
    m = replace(m, drives=replace(m.drives, friction=np.array([friction, friction / 2])))
    arm = jounce.Robot(m).with_drives(["friction"] if friction else [])
    robot = arm.with_transmission([[20, 20], [20, -20]], ["a", "b"])
    robot = robot.with_limits(
        effort={"joint1": 36.0, "joint2": 14.0, "a": 1.5}, effort_rate={"joint1": 300.0}, velocity=50
    )
    motion = jounce.Motion.polynomial([[0, 0, 0, 0, 35 * b, -84 * b, 70 * b, -20 * b] for b in (0.4, 0.9)], 0.9)

    def ratios(moved):
        q, qd, q2d, q3d = moved(np.linspace(moved.start, moved.stop, 8001), 3)
        Q, Qd = robot.inverse_dynamics(q, qd, q2d, q3d)
        tau = robot.actuator_forces(q, qd, q2d)
        return {
            "joint1": np.abs(Q[:, 0]).max() / 36,
            "joint2": np.abs(Q[:, 1]).max() / 14,
            "a": np.abs(tau[:, 0]).max() / 1.5,
            "rate": np.abs(Qd[:, 0]).max() / 300,
        }

    found, oracle = robot.check(motion), ratios(motion)
    checked = {row.joint: row.ratio for row in found.table if row.limit == "effort"}
    assert not found.notes
    for name in ("joint1", "joint2", "a"):
        assert checked[name] == pytest.approx(oracle[name], rel=1e-4)
    [rate] = [row.ratio for row in found.table if row.limit == "effort_rate"]
    assert rate == pytest.approx(oracle["rate"], rel=1e-3)
    for bounded in (robot.slowdown(motion).motion, robot.retime(motion).motion):
        assert 0.9 < max(ratios(bounded).values()) < 1 + 1e-3


def test_audits_do_not_ask_rotors_for_mass():
    assert "massless tip" not in [x.kind for x in couple(MATRICES["differential"])[1].audit()]


def test_a_matrix_is_refused_only_where_digits_are_lost():
    arm, near = jounce.load("planar2r"), 1 + np.array([0.3, 30]) * MIN_RATIO_INVERSE_CONDITION
    with expect_refusal("motors a, b at rest leave joints free to move by 1 joint1, -1 joint2;"):
        arm.with_transmission([[1, 1], [1, near[0]]], ["a", "b"])
    robot = arm.with_transmission([[1, 1], [1, near[1]]], ["a", "b"])
    assert np.isfinite(robot.actuator_forces(*STATE[:3, 0, :2])).all()
    with expect_refusal(re.compile(r"motors a at rest leave joints free to move by -?1 joint1, -?1 joint2;")):
        arm.with_transmission([[1, 1]], ["a"])


@pytest.mark.parametrize(("given", "message"), [
    (([1, 0], ["a", "b"]), "matrix is [1.0, 0.0]; expected finite numbers (2, 2): a row for each of a, b"),
    (([[1, 0], [0, np.nan]], ["a", "b"]), "expected finite numbers"),
    ((np.eye(2), ["a", "a"]), "motors is ['a', 'a']; expected different names"),
    ((np.eye(2), ["a", "joint1"]), "motor 'joint1' or its rotor has the name of a joint"),
    ((np.eye(2), {"a": 3, "b": None}), "motor 'a' is 3; expected a jounce.Motor, or None"),
    ((np.eye(2), ["a", "b"], ["joint1", "joint3"]), "joints has no joint 'joint3'"),
    ((np.eye(2), ["a", "b"], ["joint1", "joint1"]), "joints names a joint twice"),
    ((np.eye(2), ["a", "b"], None, [1, 2, 3]), "offset is …; expected finite numbers (2,)"),
])  # fmt: skip
def test_what_is_no_transmission(given, message):
    refusal(lambda: jounce.load("planar2r").with_transmission(*given), message)


@pytest.mark.parametrize("name", ["fivebar", "elastic", "coupled"])
def test_robots_that_take_no_transmission(name):
    planar = jounce.load("planar2r")
    robot = {
        "fivebar": lambda: jounce.load("fivebar"),
        "elastic": lambda: planar.elastic(100.0, rotor=0.1),
        "coupled": lambda: planar.with_transmission(np.eye(2), ["c", "d"]),
    }[name]()
    with expect_refusal("has loops, a transmission or elastic joints; expected a tree of rigid"):
        robot.with_transmission(np.eye(2), ["a", "b"])


def test_coupled_robots_have_no_loops():
    robot = jounce.load("planar2r").with_transmission([[1, 0], [1, 1]], ["a", "b"])
    refusal(lambda: robot.loop_wrenches([0, 0], [0, 0], [0, 0]), "loop_wrenches of 'planar2r': no loop is closed")
    refusal(lambda: robot.closed([("body1", "body2")]), "actuated is None; expected a list of joints")
    with expect_refusal("coordinates joint1, a at rest leave joints free to move by 1 joint2"):
        robot.closed(coordinates=["joint1", "a"])
    assert with_followers(robot.mechanism).G.tolist() == [[1, 0], [0, 1], [1, 0], [1, 1]]


def test_runs_report_no_limits_of_motors_that_are_elsewhere():
    arm = jounce.load("planar2r").with_limits(velocity=5).with_transmission([[1, 0], [1, 1]], ["a", "b"])
    arm = arm.with_limits(effort={"a": 0.01})
    with pytest.warns(jounce.JounceWarning, match="limits of effort are of motors, which Q is not of; jounce check"):
        limits = reported_limits(arm.mechanism)
    assert limits.kinds == ("velocity",)


@pytest.mark.parametrize("field", ["resistance", "constant", "inductance", "body"])
def test_motors_of_transmissions_state_drive_terms_alone(field):
    motor = jounce.Motor(inertia=1e-4, **{field: "upper_arm" if field == "body" else 1.0})
    with expect_refusal(f"motor 'a' states {field}, of motors on elastic joints"):
        jounce.load("planar2r").with_transmission(np.eye(2), {"a": motor, "b": None})


@pytest.mark.parametrize(("off", "noted"), [(0.9, False), (1.1, True)])
def test_columns_of_motors_that_contradict_are_noted(off, noted):
    arm = jounce.load("planar2r").with_transmission([[1, 0], [1, 1]], ["a", "b"])
    t = np.linspace(0, 1, 50)
    columns = {"t": t, "joint1": np.sin(t), "joint2": t**2, "b": np.sin(t) + t**2 + off * MAX_FOLLOWER_OFFSET}
    notes = jounce.load_motion(columns, arm).notes
    assert any("b is up to 0.022 off where the coordinates take it" in note for note in notes) == noted
