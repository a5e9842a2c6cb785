"""Vibrations that samples hide: larger ones show, and smaller ones add no more than is stated."""

import numpy as np
import pytest

import jounce
from jounce.engine.hidden_vibrations import describe_hidden_vibration, find_hidden_vibrations
from jounce.motion import clocks
from jounce.motion.clocks import TimestampScatter
from jounce.motion.sample_curves import fit
from support.logs import encoder, harmonics

LOGS = {
    "white noise": lambda q, rng: q + 1e-4 * rng.normal(size=q.shape),
    "encoder of 17 bits": lambda q, rng: encoder(q, 17),
}


def vibrating_log(kind, seed, vibration=0.0, frequency=1.0, joint=0, rate=500, seconds=8):
    """Harmonics of seven joints, of which one vibrates; two calls differ by the vibration alone."""
    rng, t = np.random.default_rng(seed), np.arange(0, seconds, 1 / rate)
    truth = harmonics(rng)
    wave = vibration * np.sin(2 * np.pi * frequency * t[:, None] + 1) * (np.arange(7) == joint)
    return t, LOGS[kind](truth(t) + wave, rng), truth


@pytest.mark.sweep(2)
@pytest.mark.parametrize("kind", LOGS)
@pytest.mark.parametrize("frequency", [4.5, 23.0, 170.0])
def test_vibrations_above_the_bound_are_found(kind, frequency):
    t, q, _ = vibrating_log(kind, 1)
    still = fit(t, q)
    assert frequency > 2 * still.bandwidth
    found = {
        share: fit(*vibrating_log(kind, 1, share * still.hidden[0], frequency)[:2]).vibrations for share in (0.4, 1.15)
    }
    assert found[0.4] == ()
    assert [(v.joint, pytest.approx(v.line.frequency, rel=0.02)) for v in found[1.15]] == [(0, frequency)]


@pytest.mark.sweep(2)
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("frequency", [7.0, 40.0])
def test_forces_of_hidden_vibrations_are_below_the_bound(seed, frequency):
    """The bound is that at the end of the band, and at most 2^4 times as much an octave above."""
    robot = jounce.load("iiwa14")
    t, q, truth = vibrating_log("white noise", seed)
    names = robot.joint_names
    still = find_hidden_vibrations(robot, jounce.load_motion({"t": t, **dict(zip(names, q.T, strict=True))}, robot), 2)
    for j, stated in enumerate(still):
        A = 0.4 * stated.amplitude
        if j == 2:  # it hides
            assert fit(*vibrating_log("white noise", seed, A, frequency, joint=j)[:2]).vibrations == ()
        s = np.linspace(t[0], t[-1], 200)
        slow, w = [truth(s, k) for k in range(5)], 2 * np.pi * frequency
        fast = [
            rate + A * w**k * np.sin(w * s[:, None] + 1 + k * np.pi / 2) * (np.arange(7) == j)
            for k, rate in enumerate(slow)
        ]
        differ = np.abs(robot.inverse_dynamics(*fast)[2] - robot.inverse_dynamics(*slow)[2]).max()
        bound = stated.adds * stated.per_octave ** np.log2(frequency / stated.bandwidth)
        assert 0.02 * bound < differ / 0.4 < bound


def test_the_bound_is_what_a_wave_adds_at_most():
    """To the first order, whatever its phase: lower rates count next to the mass matrix."""
    robot = jounce.load("iiwa14")
    t, q, _ = vibrating_log("white noise", 0)
    motion = jounce.load_motion({"t": t, **dict(zip(robot.joint_names, q.T, strict=True))}, robot)
    for order in range(3):
        for j, stated in enumerate(find_hidden_vibrations(robot, motion, order)):
            w, i, eps = 2 * np.pi * stated.bandwidth, robot.joint_names.index(stated.of), 1e-3
            s = np.linspace(*motion.curve.fit.ends, 50)
            rates, most = motion(s, order + 2), 0.0
            for phase in np.linspace(0, np.pi, 7):
                wave = [eps * w**k * np.sin(phase + k * np.pi / 2) * (np.arange(7) == j) for k in range(order + 3)]
                sides = [
                    robot.inverse_dynamics(*(x + sign * y for x, y in zip(rates, wave, strict=True)))
                    for sign in (1, -1)
                ]
                high, low = ((x[order] if order else x)[:, i] for x in sides)
                most = max(most, np.abs(high - low).max() / 2 / eps)
            assert 0.5 * stated.adds < most * stated.amplitude < 1.001 * stated.adds
            assert stated.to == ("Q", "Qd", "Q2d")[order]
            assert stated.per_octave == 4 * 2**order


def test_corrected_stamps_may_take_a_part_of_a_vibration():
    """Shifts of rows explain waves of a joint that moves fast: a larger wave hides, up to the one that is stated."""
    rng, at = np.random.default_rng(4), np.arange(3000) / 1000
    truth = harmonics(rng)
    t = np.sort(at + rng.uniform(-5e-4, 5e-4, len(at)))
    q = truth(at) + 1e-6 * rng.normal(size=(len(at), 7))
    still = fit(t, q)
    assert still.stamps
    fastest, slowest = np.argsort(np.mean(truth(at, 1) ** 2, axis=0))[[-1, 0]]
    for joint in (fastest, slowest):
        wave = 1.2 * still.hidden[joint] * np.sin(2 * np.pi * 20 * at)
        shown = fit(t, q + wave[:, None] * (np.arange(7) == joint))
        assert joint in [v.joint for v in shown.vibrations]
    v, own = np.array([[3.0, 4.0], [0.0, 1.0]]), np.ones(2)
    assert clocks.remaining_share(v, TimestampScatter(1e9, own)) == pytest.approx([(16 / 25 + 1) / 2, (9 / 25 + 0) / 2])
    assert clocks.remaining_share(v, TimestampScatter(1e-9, own)) == pytest.approx([1, 1])


def test_without_a_spectrum_all_scatter_may_be_hidden():
    t, rng = np.arange(0, 4, 1e-2), np.random.default_rng(2)
    noise = 1e-4 * rng.normal(size=(len(t), 3))
    q = np.stack([np.sin(3 * t), 0.5 * t, np.zeros(len(t))], axis=1) + noise  # moves, is steady, rests
    hidden = fit(t, q).hidden
    assert hidden[1:] == pytest.approx(np.sqrt(2) * 1e-4, rel=0.1)
    short = fit(t[:200], q[:200, :1])
    assert short.hidden[0] == pytest.approx(np.sqrt(2) * 1e-4, rel=0.15)  # too few rows for a spectrum


def test_the_line_states_numbers_and_units():
    robot = jounce.load("iiwa14")
    t, q, _ = vibrating_log("white noise", 0)
    columns = {"t": t, **dict(zip(robot.joint_names, q.T, strict=True))}
    motion = jounce.load_motion(columns, robot)
    found = find_hidden_vibrations(robot, motion, 2)[0]
    said = describe_hidden_vibration(found)
    assert said.startswith(f"joint1 is resolved up to {motion.curve.fit.bandwidth:.3g} Hz; faster vibrations below ")
    more = "and by 16 times as much at twice the frequency"
    assert f"could change Q2d of {found.of} by up to {found.adds:.2g} N m/s^2, {more}" in said
    of_q = find_hidden_vibrations(robot, motion, 4, "q")[0]
    assert (of_q.to, of_q.of, of_q.added_unit) == ("q4d", "joint1", "rad/s^4")
    w = 2 * np.pi * of_q.bandwidth
    assert of_q.adds == pytest.approx(of_q.amplitude * w**4)


def test_floating_robots_get_q4d_and_exact_motions_nothing():
    robot = jounce.load("solo12", base="floating")
    t, rng = np.arange(0, 4, 5e-3), np.random.default_rng(0)
    q = 0.3 * np.sin(2 * t[:, None] + np.arange(12)) + 1e-4 * rng.normal(size=(len(t), 12))
    columns = {"t": t, **dict(zip(robot.joint_names, q.T, strict=True))}
    columns |= {f"base.{x}": np.full(len(t), float(x == "qw")) for x in ("x", "y", "z", "qw", "qx", "qy", "qz")}
    found = find_hidden_vibrations(robot, jounce.load_motion(columns, robot), 2)
    assert {(x.to, x.per_octave) for x in found} == {("q4d", 16)}
    assert len(found) == 12
    assert find_hidden_vibrations(robot, jounce.Motion.polynomial([[0, 0.1]] * 12, 1.0), 2) == ()
