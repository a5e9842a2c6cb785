"""Excitation motions keep all limits, tell all parameters, beat random motions, and come with exact gradients."""

from dataclasses import replace

import numpy as np
import pytest

import jounce
from jounce.identification.excitation import ExcitationOptions, prepare_search
from support.refusals import refusal

ARM = jounce.load("planar2r")
LIMITED = ARM.with_limits(
    lower=-2, upper=[2.5, 2], velocity=[2, 3], acceleration=8, jerk=60, effort=[60, 15]
).with_limits(effort_rate=150, of="Q - Qgrav")  # fmt: skip
ASKED = {"period": 4.0, "harmonics": 4}
COLUMNS = ("damping", "friction", "offset")


@pytest.fixture(scope="module")
def excitation():
    return LIMITED.excite(**ASKED, starts=2)


def information(robot, motion, weights, drives=False):
    """The information matrix of base parameters and drive terms along a motion."""
    rates = motion(np.linspace(motion.start, motion.stop, 128, endpoint=False), 2)
    Y = robot.regressor(*rates, drives=drives)
    own = len(robot.inertial_parameters)
    A = np.concatenate([Y[..., robot.base_parameters().columns], Y[..., own:]], axis=-1)
    return np.einsum("tij,i,tik->jk", A, weights, A) / len(A)


def test_all_limits_hold_between_samples_and_some_are_used(excitation):
    fine = LIMITED.check(excitation.motion.with_step(1e-3))
    assert fine.ok
    assert excitation.check.worst.ratio <= 0.99
    assert 0.97 < fine.worst.ratio < 0.9901
    assert {row.limit for row in excitation.limits} == {*LIMITED.limits.kinds}


def test_it_starts_and_ends_at_rest_to_q4d(excitation):
    for t in (0.0, ASKED["period"]):
        rates = excitation.motion(t, 4)
        assert all(np.abs(rate).max() < 1e-8 * excitation.motion.curve.terms[0].cosines[3].frequency ** k
                   for k, rate in enumerate(rates) if k)  # fmt: skip
    assert excitation.motion.breaks == ()
    twice = LIMITED.excite(**ASKED, starts=1, periods=2)
    assert twice.motion.duration == 8
    assert np.allclose(twice.motion(5.0)[4], twice.motion(1.0)[4])


def test_it_tells_all_base_parameters_and_states_its_criterion(excitation):
    base = LIMITED.base_parameters()
    assert excitation.parameters == base.names
    assert excitation.unseen == ()
    H = information(LIMITED, excitation.motion, LIMITED.limits.effort**-2)
    assert np.isclose(np.linalg.slogdet(H)[1], excitation.criterion, atol=1e-6)
    size = np.sqrt(np.diag(H))
    assert np.isclose(np.sqrt(np.linalg.cond(H / size / size[:, None])), excitation.condition, rtol=1e-6)
    assert excitation.condition < 5


def test_it_beats_random_motions_within_the_same_limits(excitation):
    rng, best = np.random.default_rng(1), -np.inf
    for _ in range(3):
        offset, series = rng.uniform(-1, 1, 2), rng.normal(size=(2, 4, 2)) / np.arange(1, 5)[:, None]

        def motion(size, offset=offset, series=series):
            return jounce.Motion.fourier(offset, *(size * series), np.pi / 2, 4.0).with_step(0.05)

        low, high = 0.0, 2.0
        for _ in range(8):
            middle = (low + high) / 2
            low, high = (middle, high) if LIMITED.check(motion(middle)).ok else (low, middle)
        H = information(LIMITED, motion(low), LIMITED.limits.effort**-2)
        best = max(best, np.linalg.slogdet(H)[1])
    assert best < excitation.criterion - 2


def test_a_seed_gives_the_same_motion_again(excitation):
    again = LIMITED.excite(**ASKED, starts=2)
    assert again.motion.curve == excitation.motion.curve
    assert LIMITED.excite(**ASKED, starts=1, seed=3).motion.curve != excitation.motion.curve


@pytest.mark.parametrize("limits", [{}, {"power": 40.0}, {"stall_effort": 100.0, "no_load_velocity": 3.0}], ids=str)
def test_gradients_are_those_of_differences(limits):
    robot = LIMITED.with_limits(**limits)
    rng = np.random.default_rng(0)
    search, _ = prepare_search(robot, ExcitationOptions(period=4.0, harmonics=3, drives=COLUMNS, reach=3.0), rng)
    for delta in (0.01, 0.5):  # with values on both sides of it
        u, way = search.random_start(rng), rng.normal(size=search.units.size)
        h = 1e-5
        slope = (search.loss(u + h * way, 3.0, delta)[0] - search.loss(u - h * way, 3.0, delta)[0]) / (2 * h)
        gradient = search.loss(u, 3.0, delta)[1]
        assert abs(gradient @ way - slope) < 1e-5 * np.linalg.norm(gradient) * np.linalg.norm(way)


def test_drive_terms_that_no_motion_tells_apart_are_named():
    found = LIMITED.excite(**ASKED, starts=1, drives=("armature", "friction"), weights=[1.0, 2.0])
    assert found.unseen == ("joint1 armature",)  # it turns as the inertia of both bodies about joint 1 does
    assert found.parameters[6:] == ("joint2 armature", "joint1 friction", "joint2 friction")
    H = information(LIMITED, found.motion, np.array([1.0, 2.0]), ("armature", "friction"))
    seen = [0, 1, 2, 3, 4, 5, 7, 8, 9]
    assert np.isclose(np.linalg.slogdet(H[np.ix_(seen, seen)])[1], found.criterion, atol=1e-6)


def test_a_joint_that_cannot_move_hides_parameters():
    still = LIMITED.with_limits(velocity={"joint1": 0.0})
    found = still.excite(**ASKED, starts=1)
    assert [row.joint for row in found.check.table if not row.ok] == ["joint1"]  # a limit of 0 is undecided
    q, _ = found.motion(np.linspace(0, 4, 9), 1)
    assert np.ptp(q[:, 0]) == 0 < np.ptp(q[:, 1])
    assert {*found.parameters} | {*found.unseen} == {*ARM.base_parameters().names}
    assert found.unseen == ("body1 mcy", "body1 Izz")  # of gravity on body 1 one number is left


def test_ranges_that_a_robot_does_not_state_are_taken_and_named():
    free = ARM.with_limits(velocity=3, lower={"joint2": -1.0})
    found = free.excite(**ASKED, starts=1, reach=0.5)
    q, _ = found.motion(np.linspace(0, 4, 200), 1)
    assert (np.abs(q - [0, -0.5]) <= 0.5).all()
    assert found.notes == (
        "joint 'joint1' states no range of positions; it is kept within -0.5 to 0.5 rad",
        "joint 'joint2' states no range of positions; it is kept within -1 to 0 rad",
        "not every joint states an effort limit: forces have equal weights",
    )


def test_friction_that_acts_enters_the_limits():
    data = ARM.mechanism
    rough = jounce.Robot(replace(data, drives=replace(data.drives, friction=np.array([4.0, 1.0]))))
    acting = rough.with_drives(["friction"]).with_limits(lower=-2, upper=2, effort=[60, 15], effort_rate=400)
    found = acting.excite(**ASKED, starts=1)
    assert acting.check(found.motion.with_step(1e-3)).ok


def test_it_is_shown_as_a_table(excitation):
    lines = str(excitation).splitlines()
    assert lines[0] == "Fourier series, 4 harmonics of 0.25 Hz, one period of 4 s"
    assert lines[1] == "6 parameters seen, unseen: -"
    assert [line.split()[0] for line in lines[4:]] == [
        "limit", "position", "velocity", "acceleration", "jerk", "effort", "effort",
    ]  # fmt: skip
    assert "effort rate of Q - Qgrav" in lines[-1]
    assert "6 parameters" in repr(excitation)


@pytest.mark.parametrize(("robot", "options", "said"), [
    (ARM, {}, "states no limit of a rate or a force"),
    (jounce.load("solo12", base="floating"), {}, "floats; expected one at rest, load(..., base='fixed')"),
    (LIMITED, {"period": 0}, "period is 0; expected a number of s > 0"),
    (LIMITED, {"period": -2.0}, "period is -2.0; expected a number of s > 0"),
    (LIMITED, {"periods": 0}, "periods is 0; expected 1 to 1000"),
    (LIMITED, {"harmonics": 2}, "harmonics is 2; expected 3 to 50"),
    (LIMITED, {"harmonics": 3.5}, "harmonics is 3.5; expected 3 to 50"),
    (LIMITED, {"margin": 1}, "margin is 1; expected a share of the limits, 0 <= margin < 1"),
    (LIMITED, {"reach": -1}, "reach is -1; expected a number of rad > 0"),
    (LIMITED, {"starts": 0}, "starts is 0; expected 1 to 1000"),
    (LIMITED, {"seed": -1}, "seed is -1; expected 0 or more"),
    (LIMITED, {"drives": "motor"}, "unknown linear drive term 'motor'"),
    (LIMITED, {"weights": [1, -1]}, "a weight is -1; expected inverse variances"),
    (LIMITED, {"weights": [0, 0]}, "all weights are 0; expected inverse variances"),
    (LIMITED, {"weights": [1]}, "weights have shape (1,); expected numbers (2,)"),
    (LIMITED.with_limits(velocity=0), {}, "let no joint move"),
    (LIMITED.with_limits(effort=0), {}, "'joint1' is 0; expected room on both sides of 0: state another"),
    (LIMITED.with_limits(lower=-0.1, upper=0.1, effort=5), {}, "no pose is found that the limits let the robot"),
    (ARM.with_limits(velocity=1e-4), {"drives": ["damping", "friction"]}, "does not separate the 10 parameters"),
    (LIMITED, {"period": 1e-3, "harmonics": 3}, "expected a longer period, more than 3 harmonics, or wider limits"),
])  # fmt: skip
def test_what_cannot_be_is_refused(robot, options, said):
    refusal(lambda: robot.excite(**{**ASKED, "starts": 1, **options}), said)


def test_the_motion_for_a_load_determines_it_better():
    """The information of its ten parameters against that along the motion for the robot."""
    arm, common = jounce.load("ur5"), {"period": 5.0, "starts": 1, "weights": np.ones(6)}
    log_dets = []
    for payload in ("tool0", False):
        found = arm.excite(payload=payload, **common)
        Y = arm.regressor(*found.motion(np.linspace(0, 5, 400, endpoint=False), 2))[..., -10:].reshape(-1, 10)
        log_dets.append(np.linalg.slogdet(Y.T @ Y / 400)[1])
        assert (found.parameters[0] == "wrist_3_link m") == bool(payload)
        assert found.check.ok
        assert (len(found.parameters) == 10) == bool(payload)
    assert log_dets[0] > log_dets[1] + 3
    refusal(lambda: arm.excite(payload="hand"), "unknown body 'hand'")
