"""The motion of links from encoders on their motors: recovered along simulated motions, with honest deviations."""

import json

import numpy as np
import pytest

import jounce
from jounce import Motion
from jounce.actuators import link_motion
from jounce.actuators.link_motion import MAX_BAND_TO_RESONANCE
from support.commands import call
from support.refusals import refusal

IIWA = jounce.load("iiwa14")
SOFT = jounce.load("panda_elastic")  # its lowest resonance is at 3.3 Hz
HOME = np.array([0, -0.785, 0, -2.356, 0, 1.571, 0.785])
STIFF = IIWA.elastic(1e4, rotor=0.4)  # 11.6 Hz


def fourier_waves(frequency, n=7, duration=4.0):
    rng = np.random.default_rng(0)
    parts = 0.2 * rng.normal(size=(2, 2, n)) / np.array([[1], [2]])
    return Motion.fourier(HOME[:n], *parts, 2 * np.pi * frequency, duration)


def encoder_table(arm, motion, noise=0.0):
    """The columns of encoders on the motors, wider apart where they are exact: less of them is rounding."""
    step = 1e-3 if noise else 1e-2
    t = motion.start + step * np.arange(round(motion.duration / step) + 1)
    theta = arm.motors_along(motion, t).positions[0] + noise * np.random.default_rng(1).normal(size=(len(t), arm.n))
    return {"t": t, **dict(zip(arm.joint_names, theta.T, strict=True))}


def middle(motion):
    return np.linspace(motion.start + 0.1 * motion.duration, motion.stop - 0.1 * motion.duration, 501)


CASES = {
    "soft": (SOFT, fourier_waves(0.3), 1e-9, 1e-5),
    "stiff": (STIFF, fourier_waves(0.6), 1e-11, 1e-6),
    "one joint": (IIWA.elastic({"joint2": 5e3}, rotor=0.4), fourier_waves(0.6), 1e-10, 1e-6),
    "bent springs with dampers": (
        IIWA.elastic(spring=jounce.CubicSpring(8e3, 5e6), rotor=0.5, damping=2.0),
        fourier_waves(0.6, duration=2.0), 1e-10, 1e-6,
    ),
    "closed": (
        jounce.load("fivebar").elastic(90.0, rotor=0.01),
        Motion.fourier([2.2, 0.94], [[0.05, 0.1]], [[0.1, 0.1]], 3.0, 2.0), 1e-12, 1e-6,
    ),
}  # fmt: skip


@pytest.mark.parametrize(("arm", "motion", "of_q", "of_Q2d"), CASES.values(), ids=CASES)
def test_exact_motors_give_q_and_the_forces_of_the_links(arm, motion, of_q, of_Q2d):
    found = jounce.load_motion(encoder_table(arm, motion), arm, measured="motors")
    t = middle(motion)
    known, exact = found(t, 4), motion(t, 4)
    assert np.abs(known[0] - exact[0]).max() < of_q
    Q, expected = (arm.forces_along(x, t).forces for x in (found, motion))
    for rate, right in zip(Q, expected, strict=True):
        np.testing.assert_allclose(rate, right, rtol=0, atol=of_Q2d * np.abs(right).max())
    for rate, right, off in zip(known, exact, found.deviations(t), strict=True):
        assert np.sqrt((((rate - right) / (off + 1e-14)) ** 2).mean()) < 1
    assert found.breaks == ()


@pytest.mark.parametrize("noise", [1e-6, 1e-5])
@pytest.mark.parametrize(("arm", "frequency"), [(SOFT, 0.3), (STIFF, 0.6), (STIFF, 1.0)], ids=["soft", "stiff", "fast"])
def test_deviations_are_those_of_the_errors(arm, frequency, noise):
    motion = fourier_waves(frequency, duration=8.0)
    found = jounce.load_motion(encoder_table(arm, motion, noise), arm, measured="motors")
    t = middle(motion)
    for rate, right, off in zip(found(t), motion(t), found.deviations(t), strict=True):
        assert 0.1 < np.sqrt((((rate - right) / off) ** 2).mean()) < 1.6
    Q, exact = arm.forces_along(found, t), arm.forces_along(motion, t).forces
    for rate, right, off in zip(Q.forces, exact, Q.deviations, strict=True):
        assert np.sqrt((((rate - right) / off) ** 2).mean()) < 1.6
        assert np.median(off.max(axis=1)) < 0.1 * np.abs(right).max()


def slider(stiffness, mass=2.0):
    """A mass on a spring behind a motor, without gravity."""
    M = np.diag([0.1, 0.1, 0.1, mass, mass, mass])
    screw = np.array([[0.0, 0, 0, 1, 0, 0]])
    robot = jounce.Robot.from_screws(np.eye(4)[None], screw, M[None], gravity=[0, 0, 0])
    return robot.elastic(stiffness, rotor=0.1)


@pytest.mark.parametrize("share", [0.1, 0.3])
def test_a_wave_is_that_of_the_motor_over_its_response(share):
    """q = theta / (1 - w^2 / w_r^2): by hand, without the library's dynamics."""
    resonance, t = 5.0, np.linspace(0, 4, 2001)
    w = 2 * np.pi * share * resonance
    [joint] = (arm := slider(2.0 * (2 * np.pi * resonance) ** 2)).joint_names
    found = jounce.load_motion({"t": t, joint: np.sin(w * t)}, arm, measured="motors")
    assert f"from {resonance:g} Hz on" in found.notes[-1]
    assert f"up to {MAX_BAND_TO_RESONANCE * resonance:.3g} Hz" in found.notes[-1]
    inner = np.linspace(0.5, 3.5, 301)
    expected = np.sin(w * inner) / (1 - share**2)
    np.testing.assert_allclose(found(inner, 0)[0][:, 0], expected, rtol=0, atol=1e-9 if share < 0.2 else 1e-5)


def test_noise_is_multiplied_as_deviations_say():
    """At the end of the band, where the response is 1 / (1 - 0.8^2)."""
    resonance, t = 5.0, np.linspace(0, 4, 4001)
    arm = slider(2.0 * (2 * np.pi * resonance) ** 2)
    [joint] = arm.joint_names
    samples = 0.3 * np.sin(2 * t) + 1e-5 * np.random.default_rng(0).normal(size=len(t))
    columns = {"t": t, joint: samples}
    links, motors = (jounce.load_motion(columns, arm, bandwidth=8.0, measured=side) for side in ("motors", "links"))
    gain = 1 / (1 - MAX_BAND_TO_RESONANCE**2)
    np.testing.assert_allclose(links.deviations(2.0)[0], gain * motors.deviations(2.0)[0], rtol=0.05)


def test_wrenches_of_the_table_bend_the_springs():
    arm, motion = STIFF, fourier_waves(0.6)
    tool = arm.body_names[-1]
    t = np.linspace(0, 4, 4001)
    q = motion(t, 4)
    W = np.zeros((len(t), 6))
    W[:, 5] = 20 * np.sin(3 * t)
    theta = arm.motor_positions(*q[:3], wrench={tool: W})
    columns = {"t": t, **dict(zip(arm.joint_names, theta.T, strict=True))}
    columns |= {f"{tool}.{name}": W[:, k] for k, name in enumerate(("mx", "my", "mz", "fx", "fy", "fz"))}
    found = jounce.load_motion(columns, arm, measured="motors")
    inner = middle(motion)
    np.testing.assert_allclose(found(inner, 0)[0], motion(inner, 0)[0], rtol=0, atol=1e-9)


def test_motors_that_links_do_not_follow_are_refused():
    quick = encoder_table(SOFT, fourier_waves(1.0))  # two waves, of 1 and 2 Hz
    refusal(
        lambda: jounce.load_motion(quick, SOFT, measured="motors"),
        "measured='motors'", "moves too fast for the links to follow", "from 3.32 Hz on", "a lower bandwidth",
    )  # fmt: skip
    fair = jounce.load_motion(encoder_table(SOFT, fourier_waves(0.6)), SOFT, measured="motors")
    t = middle(fair)
    assert np.abs(fair(t, 0)[0] - fourier_waves(0.6)(t, 0)[0]).max() < 1e-5
    rigid = {"t": np.linspace(0, 1, 101), **dict.fromkeys(IIWA.joint_names, np.linspace(0, 1, 101) ** 3)}
    refusal(lambda: jounce.load_motion(rigid, IIWA, measured="motors"), "measured='motors'", "its joints are rigid")
    refusal(lambda: jounce.load_motion(rigid, STIFF, measured="encoders"), "'encoders'", "links", "motors")
    spring = jounce.CubicSpring(300.0, 2e4)
    pair = jounce.load("planar2r").elastic(spring=jounce.AntagonisticSprings(spring, spring), rotor=0.1)
    both = {"t": rigid["t"], "joint1": rigid["t"] ** 3, "joint2": rigid["t"] ** 3}
    refusal(lambda: jounce.load_motion(both, pair, measured="motors"), "needs one motor per joint", "has two at joint1")


def test_newtons_method_that_does_not_end_is_refused(monkeypatch):
    monkeypatch.setattr(link_motion, "_MAX_LINK_STEPS", 1)
    columns = encoder_table(STIFF, fourier_waves(0.6, duration=1.0))
    refusal(lambda: jounce.load_motion(columns, STIFF, measured="motors"), "no motion of the links was found", "lower")


def test_deviations_end_where_those_of_the_motors_do():
    columns = encoder_table(STIFF, fourier_waves(0.6), 1e-6)
    links, motors = (jounce.load_motion(columns, STIFF, measured=side) for side in ("motors", "links"))
    assert (links.deviations(2.0, 7), motors.deviations(2.0, 7)) == (None, None)
    assert len(links.deviations(2.0, 6)) == 7


def test_commands_take_it(tmp_path):
    motion = fourier_waves(0.3)
    columns = encoder_table(SOFT, motion, 1e-6)
    np.savetxt(
        tmp_path / "log.csv", np.stack([*columns.values()], axis=1), "%.12g", ",", header=",".join(columns), comments=""
    )

    options = ("--measured", "motors")
    found = call("motors", "panda_elastic", tmp_path / "log.csv", *options, "-o", tmp_path / "motors.csv", "--json")
    assert found.exit_code == 0, found.output
    assert any("links from motors behind springs" in note for note in json.loads(found.stdout)["notes"])
    made = np.genfromtxt(tmp_path / "motors.csv", delimiter=",", names=True, deletechars="")
    inner = slice(400, -400)
    for name in SOFT.joint_names:
        np.testing.assert_allclose(made[f"{name}.theta"][inner], columns[name][inner], rtol=0, atol=1e-5)
    parts = call("run", "panda_elastic", tmp_path / "log.csv", *options, "-o", tmp_path / "q.csv", "--reduce", "peak")
    assert (parts.exit_code, "--measured motors needs the whole motion" in parts.output) == (2, True), parts.output
