"""Stiffness: springs within their deviations, delays, hysteresis, and logs that are not what they should be."""

import re
from dataclasses import replace

import numpy as np
import pytest

import jounce
from identification.conftest import table_values
from support.refusals import refusal

T = np.arange(0, 8, 0.004)
K = np.array([800.0, 600.0])
ARM = jounce.load("planar2r").elastic(K, rotor=0.1)
RIGID = jounce.load("planar2r")
MOTION = jounce.Motion.fourier([0.3, 0.2], [[0.5, 0.2], [0.1, 0.4]], [[0.1, 0.3], [0.5, 0.2]], 2.5, 8.0)
(Q_LINK, QD, Q2D), (Q,) = (lambda along: (along.rates, along.forces))(ARM.forces_along(MOTION, T, order=0))
DELTA = Q / K
QUIET = pytest.mark.filterwarnings("ignore::jounce.JounceWarning")  # what notes hold
OFF = np.array([0.3, -0.1])


def link_log(deflection=DELTA, tau=Q, q=Q_LINK, gear=1.0, noise=0.0, seed=0):
    """The motions of links and motors, by their samples; the rates of links are exact."""
    rng = np.random.default_rng(seed)
    measured, theta = q + noise * rng.normal(size=q.shape), gear * (q + deflection + noise * rng.normal(size=q.shape))
    links = replace(MOTION, samples=(T, measured), torques=None if tau is None else (T, tau))
    return links, replace(MOTION, samples=(T, theta), torques=None)


def late(values, delay):
    return np.stack([np.interp(T - delay, T, x, np.nan, np.nan) for x in values.T], axis=1)


def test_exact_positions_give_the_stiffness():
    """Whether the robot has springs already or not; offsets of encoders do not matter."""
    for robot, own in ((ARM, K), (RIGID, np.inf)):
        found = robot.identify_stiffness(*link_log(DELTA + OFF), rotor=0.2)
        assert table_values(found, "stiffness") == pytest.approx(K)
        assert found.robot.elasticity.stiffness == pytest.approx(K)
        assert found.robot.elasticity.rotor == pytest.approx(0.2)
        assert (found.delay, found.notes, found.rank) == (0.0, (), 6)
        assert [row.model for row in found.table[::3]] == pytest.approx(np.broadcast_to(own, 2))
        assert found.predicted == pytest.approx(DELTA + OFF)
        motors = found.robot.motor_torques(*np.full((5, 2), 0.1))
        assert motors == pytest.approx(RIGID.elastic(K, rotor=0.2).motor_torques(*np.full((5, 2), 0.1)))


def test_errors_are_as_large_as_their_deviations():
    over = []
    for seed in range(16):
        found = ARM.identify_stiffness(*link_log(noise=1e-4, seed=seed))
        over += [(row.value - k) / row.deviation for row, k in zip(found.table[::3], K, strict=True)]
        assert 1e-5 < found.table[0].deviation / K[0] < 1e-3
        assert found.notes == ()
    assert 0.75 < np.sqrt(np.mean(np.square(over))) < 1.25


def test_noise_of_torques_is_in_the_deviation():
    """It makes K too large by its share of their power, ripple that averages leave: 4 % here."""
    ripple = 0.2 * Q.std(axis=0) * np.sqrt(2) * np.sin(20 * T)[:, None]
    for row, k in zip(ARM.identify_stiffness(*link_log(tau=Q + ripple)).table[::3], K, strict=True):
        assert 0.03 * k < row.value - k < row.deviation < 0.06 * k


def test_hysteresis_and_encoders_that_are_apart():
    found = ARM.identify_stiffness(*link_log(DELTA + 3.0 / K * np.sign(QD) - 0.0015 * QD, noise=1e-5))
    assert table_values(found, "stiffness") == pytest.approx(K, rel=2e-3)
    assert table_values(found, "hysteresis") == pytest.approx([3.0, 3.0], rel=5e-3)
    assert table_values(found, "encoder delay") == pytest.approx([0.0015, 0.0015], rel=0.02)


@QUIET
@pytest.mark.parametrize("delay", [0.0007, 0.005, 0.06, -0.013])
def test_late_torques_are_put_in_time(delay):
    found = ARM.identify_stiffness(*link_log(tau=late(Q, delay), noise=2e-5))
    assert found.delay == pytest.approx(delay, abs=3e-4)
    assert table_values(found, "stiffness") == pytest.approx(K, rel=1e-3)
    assert re.match(r"measured forces come .* ms (after|before) the positions, which is taken out: ", found.notes[0])
    kept = ARM.identify_stiffness(*link_log(tau=late(Q, delay), noise=2e-5), delay=delay)
    assert (kept.delay, kept.notes) == (delay, ())


def test_missing_samples_do_not_count():
    """Torques that are NaN for a while, at which others would spoil the fit."""
    tau = Q.copy()
    tau[300:700, 0] = np.nan
    found = ARM.identify_stiffness(*link_log(np.where(np.isnan(tau), 1.0, DELTA), tau))
    assert table_values(found, "stiffness") == pytest.approx(K)
    assert np.isnan(found.measured[500, 0])


@QUIET
def test_torques_of_the_model_serve_where_none_are_measured():
    some = np.stack([Q[:, 0], np.full(len(T), np.nan)], axis=1)
    for tau, names in ((None, "joint1, joint2"), (some, "joint2")):
        found = ARM.identify_stiffness(*link_log(tau=tau, noise=1e-5))
        assert table_values(found, "stiffness") == pytest.approx(K, rel=1e-3)
        assert found.notes == (
            f"torques of {names} are not measured: those of the model are used, with the errors of its masses",
        )


@QUIET
@pytest.mark.parametrize("what", ["constant torque", "deflection of noise", "no deflection", "another motion"])
def test_a_stiffness_that_the_log_does_not_determine_is_no_number(what):
    deflection, tau = DELTA.copy(), Q.copy()
    if what == "constant torque":
        tau[:, 1] = 5.0
    else:
        deflection[:, 1] = 0.05 * np.sin(1.7 * T) * (what == "another motion")
    found = RIGID.identify_stiffness(*link_log(deflection, tau, noise=1e-4 * (what != "no deflection")), rotor=0.1)
    row = found.table[3]
    assert (row.name, row.seen, row.deviation) == ("joint2 stiffness", False, np.inf)
    assert np.isnan(row.value)
    assert any("does not determine the stiffness of joint2; expected" in note for note in found.notes)
    assert found.robot.elasticity.stiffness[1] == np.inf
    assert ARM.identify_stiffness(*link_log(deflection, tau)).robot.elasticity.stiffness[1] == 600.0


@pytest.mark.parametrize(("given", "options", "message"), [
    ({"deflection": -DELTA}, {}, "joint1, joint2 is negative; expected motors in the columns of motors"),
    ({"tau": -Q}, {},
     "is negative; torques seem to have the wrong sign: they are those of the model times -1 at joint1"),
    ({"tau": 0 * Q}, {}, "all torques of the log are 0; expected measured ones"),
    ({"tau": np.ones_like(Q)}, {},
     "the log determines the stiffness of no joint; torques of joint1, joint2 are constant"),
    ({"deflection": np.full_like(Q, 0.1)}, {}, "the log determines the stiffness of no joint"),
    ({"gear": 100.0}, {}, "gear ratios (gear=), which are about 8… of joint1, 9… of joint2$"),
    ({"gear": -50.0}, {}, "about -4… of joint1, -4"),
    ({}, {"gear": 0.0}, "gear is [0.0, 0.0]; expected speeds of motors"),
    ({}, {"gear": {"joint9": 2.0}}, "unknown joint 'joint9'"),
    ({}, {"delay": "late"}, "delay is 'late'; expected seconds"),
])  # fmt: skip
@QUIET
def test_refuses(given, options, message):
    refusal(lambda: ARM.identify_stiffness(*link_log(**given), **options), message)


def test_refuses_robots_and_logs_that_do_not_fit():
    short = [replace(motion, samples=(T[:10], motion.samples[1][:10])) for motion in link_log()]
    refusal(lambda: ARM.identify_stiffness(*short), "motors and links share 10 times; expected 16")
    refusal(lambda: RIGID.identify_stiffness(*link_log()), "since it has no armature")
    damped = RIGID.elastic(K, rotor=0.1, damping=1.0)
    refusal(lambda: damped.identify_stiffness(*link_log()), "springs that are not linear, or have dampers")


@QUIET
def test_gears_stand_between_motors_and_links():
    found = ARM.identify_stiffness(*link_log(gear=np.array([100.0, -50.0])), gear={"joint1": 100.0, "joint2": -50.0})
    assert table_values(found, "stiffness") == pytest.approx(K)


@QUIET
@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"tau": Q / 100}, "torques seem to have the wrong unit: they are those of the model times 0.01 at joint1"),
        ({"gear": 1.01}, "deflections of joint1, joint2 move with their links; expected exact gear ratios"),
        ({"tau": Q + 0.6 * Q2D}, "deflections of joint1, joint2 follow accelerations; expected torques of the springs"),
        ({"deflection": DELTA + 20 * DELTA**3}, "deflections of joint1, joint2 follow powers of torques"),
    ],
)
def test_what_is_suspicious_is_named(given, message):
    found = ARM.identify_stiffness(*link_log(**given, noise=1e-5), torques_as_given=True)
    assert any(note.startswith(message) for note in found.notes), found.notes


def at_joint(joint, change):
    """A change of the column of one joint."""
    return lambda x: np.where(np.arange(x.shape[1]) == joint, change(x), x)


def swap(x):
    return x[:, ::-1]


def clip(share):
    """Torques that saturate at both ends, where a share of the samples is beyond."""
    return lambda x: x.clip(*np.quantile(x, [share / 2, 1 - share / 2], axis=0))


THETA = Q_LINK + DELTA
# q, theta and tau as they come by mistake, and what is said of them
WRONG = {
    "motor columns": ({"theta": swap}, "motors follow the links of other joints: that of joint1 follows"),
    "link columns": ({"q": swap}, "motors follow the links of other joints: that of joint"),
    "torque columns": ({"tau": swap}, "torques follow the model's of other joints: those of joint1 are like joint2's"),
    "all columns": ({"q": swap, "theta": swap, "tau": swap}, "those of the model times 0.41"),
    "copies": ({"theta": lambda x: Q_LINK}, "positions of motors are those of links, of joint1, joint2; expected"),
    "deflections": ({"theta": lambda x: x - Q_LINK}, "motors of joint1, joint2 do not move with their links; expected"),
    "motors in degrees": ({"theta": np.rad2deg}, "of joint2; or all positions in rad, as 57.3 is 180 / pi"),
    "links in degrees": ({"q": np.rad2deg}, "of joint2; or all positions in rad, as 57.3 is 180 / pi"),
    "sign of motors": ({"theta": at_joint(1, np.negative)}, "gear=), which are about -0.9"),
    "a gear of 101": ({"theta": lambda x: 1.01 * x}, "ratios, gear=, which are about 1.01 of joint1, 1.01 of joint2"),
    "a gear of 98": ({"theta": lambda x: 0.98 * x}, "ratios, gear=, which are about 0.98 of joint1, 0.98 of joint2"),
    "a scale": ({"tau": at_joint(1, lambda x: 1.3 * x)}, "the wrong scale, or the model another load: they are those"
                " of the model times 1.3 at joint2; expected those of these joints"),
    "a sign": ({"tau": at_joint(1, np.negative)}, "the wrong sign: they are those of the model times -1 at joint2;"),
    "a unit": ({"tau": at_joint(1, lambda x: x / 50)},
               "the wrong unit: they are those of the model times 0.02 at joint2;"),
    "no torque": ({"tau": at_joint(1, lambda x: 0 * x + 5)}, "torques of joint2 are constant; expected measured ones"),
    "saturated": ({"tau": clip(0.3)}, "torques of joint1, joint2 stay at an end of their range; expected no saturated"),
    "another run": ({"tau": lambda x: np.roll(x, 900, axis=0)}, "torques of joint1, joint2 do not follow the model's;"),
    "late motors": ({"theta": lambda x: late(x, 0.1)}, "motors seem to come after their links, by "),
}  # fmt: skip


@QUIET
@pytest.mark.parametrize("kind", WRONG)
@pytest.mark.parametrize("stiffer", [1.0, 15.0])
def test_wrong_columns_are_named(kind, stiffer):
    """Refused, or said of a result: K is never wrong without a word."""
    changes, message = WRONG[kind]
    given = {"q": Q_LINK, "theta": Q_LINK + DELTA / stiffer, "tau": Q}
    given = {name: np.nan_to_num(changes.get(name, np.array)(x)) for name, x in given.items()}
    links, motors = link_log(given["theta"] - given["q"], given["tau"], given["q"], noise=1e-5)
    if kind == "copies":
        motors = replace(motors, samples=links.samples)
    if kind == "all columns":  # rates follow from the samples
        links = replace(jounce.Motion.fit(T, links.samples[1]), torques=links.torques)
    try:
        found = ARM.identify_stiffness(links, motors)
        said = found.notes
        assert kind not in ("torque columns", "saturated") or not any(row.seen for row in found.table[::3])
    except jounce.JounceError as error:
        said = (str(error),)
    assert any(message in text for text in said), said


@QUIET
@pytest.mark.parametrize("gain", [0.5, 0.9, 0.97, 1.02, 1.04, 1.06, 1.3, 2.0])
def test_deviations_hold_the_scale_of_torques(gain):
    """Small ones are not named, and all are in the deviation."""
    found = ARM.identify_stiffness(*link_log(tau=gain * Q, noise=1e-5))
    for row, k in zip(found.table[::3], K, strict=True):
        assert row.value == pytest.approx(gain * k, rel=2e-3)
        assert abs(row.value - k) < 1.1 * row.deviation < 1.3 * abs(row.value - k)
    assert any("wrong scale" in note for note in found.notes) == (abs(gain - 1) > 0.05)


@QUIET
@pytest.mark.parametrize("error", [1e-5, 3e-5, 1e-4, 3e-4, 1e-3, 3e-3])
@pytest.mark.parametrize("seed", range(3))
def test_deviations_hold_errors_of_gear_ratios(error, seed):
    """Whether they are named or not."""
    found = ARM.identify_stiffness(*link_log(gear=1 + error, noise=3e-5, seed=seed))
    for row, k in zip(found.table[::3], K, strict=True):
        assert not row.seen or abs(row.value - k) < 5 * row.deviation


@QUIET
@pytest.mark.parametrize(
    ("given", "named"),
    [
        ({"tau": np.where([False, True], clip(0.01)(Q), Q)}, False),
        ({"tau": np.where([False, True], clip(0.1)(Q), Q)}, True),
        ({"tau": np.round(Q)}, False),  # a coarse sensor
        ({"deflection": late(THETA, 0.007) - Q_LINK}, False),
        ({"deflection": late(THETA, 0.015) - Q_LINK}, True),
    ],
)
def test_what_is_nearly_right_is_not_named(given, named):
    given = {name: np.where(np.isnan(x), DELTA if name == "deflection" else Q, x) for name, x in given.items()}
    notes = ARM.identify_stiffness(*link_log(**given, noise=1e-5)).notes
    assert any("end of their range" in note or "after their links" in note for note in notes) == named, notes


@QUIET
def test_a_robot_at_rest_has_no_saturated_sensors():
    """Torques stay at an end of their range, as those of the model do."""
    q = MOTION(T[np.arange(len(T)).clip(500, 1500)], 0)[0]
    still = RIGID.inverse_dynamics(q, 0 * q, 0 * q)
    links = replace(jounce.Motion.through(T, q), samples=(T, q), torques=(T, still))
    notes = ARM.identify_stiffness(links, replace(links, samples=(T, q + still / K), torques=None)).notes
    assert not any("end of their range" in note for note in notes), notes


@QUIET
@pytest.mark.parametrize(("inertia", "doubted"), [(1e-3, False), (5e-2, True)])
def test_a_thousandth_of_a_deflection_is_no_reason_for_doubt(inertia, doubted):
    """Of exact logs everything is certain: rotors of 1e-3 kg m^2 make 1e-4 of these torques, others 5e-3."""
    found = ARM.identify_stiffness(*link_log(tau=Q + inertia * Q2D))
    assert any("follow accelerations" in note for note in found.notes) == doubted
