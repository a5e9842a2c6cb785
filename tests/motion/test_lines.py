"""Vibrations below the step of an encoder: lines in what a fit leaves, which are motion unless a bandwidth is given."""

import numpy as np
import pytest

import jounce
from jounce.motion.sample_curves import fit
from support.logs import encoder, harmonics


def rippled(seed, joints=2, frequency=15.0, amplitude=1e-5, rate=1000):
    """A slow motion by 17 bits, steps of 4.8e-5 rad, with a ripple, and its truth."""
    rng = np.random.default_rng(seed)
    slow, start = harmonics(rng, base=0.03, amplitude=0.5), rng.choice([0, 3600])
    t = start + np.arange(0, rng.uniform(6, 12), 1 / rate)
    phase, w = rng.uniform(0, 6, joints), 2 * np.pi * frequency

    def truth(s, k=0):
        ripple = amplitude * w**k * np.sin(w * (s - start)[:, None] + phase + k * np.pi / 2)
        return slow(s - start, k)[:, :joints] + ripple

    return t, encoder(truth(t), 17), truth


def errors(smooth, truth):
    """Errors in standard deviations, root mean squares by derivative."""
    s = np.linspace(*smooth.ends, 402)[1:-1]
    return [
        np.sqrt(np.mean(((smooth.spline(s, nu=k) - truth(s, k)) / d) ** 2)) for k, d in enumerate(smooth.deviations(s))
    ]


@pytest.mark.sweep(2)
@pytest.mark.parametrize("seed", [0])
@pytest.mark.parametrize("given", [{"joints": 3}, {"joints": 1}, {"frequency": 20.0}, {"frequency": 31.0}])
def test_a_ripple_below_the_step_is_followed_and_said(seed, given):
    """Its q4d was off by thousands of deviations."""
    t, q, truth = rippled(seed, **given)
    smooth = fit(t, q)
    frequency, amplitude = given.get("frequency", 15.0), given.get("amplitude", 1e-5)
    notes = [note for note in smooth.notes if "vibrates" in note]
    assert len(notes) == q.shape[1]
    words = notes[0].split()
    assert float(words[words.index("at") + 1]) == pytest.approx(frequency, rel=0.02)
    assert float(words[words.index("by") + 1]) == pytest.approx(amplitude, rel=0.2)
    assert float(words[words.index("is") + 1]) == pytest.approx(amplitude * (2 * np.pi * frequency) ** 4, rel=0.3)
    assert smooth.bandwidth > frequency
    assert max(errors(smooth, truth)) < 1.5


def test_a_bandwidth_makes_a_ripple_noise_which_is_said():
    t, q, truth = rippled(1)
    smooth = fit(t, q, bandwidth=3)
    assert smooth.bandwidth < 3.1
    notes = [note for note in smooth.notes if "vibrates at" in note]
    assert len(notes) == 2
    assert all("the fit leaves it out, and its deviations hold it" in note for note in notes)
    assert not any(vibration.followed for vibration in smooth.vibrations)
    off = errors(smooth, truth)
    assert max(off) < 1.3  # 1,000 without
    assert min(off[2:]) > 0.7


@pytest.mark.parametrize("amplitude", [1e-4, 1e-3])
def test_a_vibration_above_a_bandwidth_is_no_noise(amplitude):
    """The deviations of a bandwidth are those without the vibration, and the mean square of its rates."""
    rng, t = np.random.default_rng(0), np.arange(0, 6, 0.002)
    q = np.stack([0.5 * np.sin(t), 0.4 * np.cos(1.3 * t)], axis=1) + 1e-5 * rng.normal(size=(t.size, 2))
    w, middle = 2 * np.pi * 150.0, np.array([3.0])
    quiet, loud = (fit(t, q + a * np.sin(w * t)[:, None] * [1, 0], bandwidth=6) for a in (0.0, amplitude))
    assert (loud.shortfall(2), quiet.shortfall(2)) == (None, None)
    for k in range(5):
        held = np.hypot(quiet.deviations(middle, 4)[k], np.array([amplitude * w**k / np.sqrt(2), 0]))
        np.testing.assert_allclose(loud.deviations(middle, 4)[k], held, rtol=0.3)


def burst(seed, frequency=25.0, width=0.06, amplitude=2e-4, joints=1):
    """A slow motion with a wave under a Gaussian bell of a standard deviation in s, and its truth."""
    rng = np.random.default_rng(seed)
    slow, t = harmonics(rng, base=0.05, amplitude=0.5), np.arange(0, rng.uniform(4, 6), 1e-3)
    middle, phase, w = rng.uniform(1.5, t[-1] - 1.5), rng.uniform(0, 6, joints), 2 * np.pi * frequency
    bells = [np.polynomial.Polynomial([1.0 + 0j])]
    for _ in range(4):  # d/dx p exp(-x^2 / 2 s^2 + i w x) = (p' + p (i w - x / s^2)) exp(...)
        bells.append(bells[-1].deriv() + bells[-1] * np.polynomial.Polynomial([1j * w, -1 / width**2]))

    def truth(s, k=0):
        x = (s - middle)[:, None]
        return (
            slow(s, k)[:, :joints]
            + amplitude * (bells[k](x) * np.exp(-((x / width) ** 2) / 2 + 1j * (w * x + phase))).real
        )

    noise = 1e-5 * rng.normal(size=(len(t), joints))
    return t, encoder(truth(t) + noise, 17), truth, (middle - 4 * width, middle + 4 * width)


BURSTS = [{}, {"amplitude": 2e-3}, {"frequency": 40.0, "width": 0.1, "joints": 2}, {"width": 0.3}]


@pytest.mark.sweep(2)
@pytest.mark.parametrize("seed", [0])
@pytest.mark.parametrize("given", BURSTS, ids=str)
def test_a_burst_is_followed_with_its_flanks(seed, given):
    """Of a weak one nothing was, in silence; flanks of others were off by up to 190 deviations."""
    t, q, truth, around = burst(seed, **given)
    smooth = fit(t, q)
    notes = [note for note in smooth.notes if "vibrates at" in note and " from t = " in note]
    assert len(notes) == 1 or smooth.bandwidth > 10  # all of the log is followed that far
    assert all(v.followed and not v.line.lasts for v in smooth.vibrations)
    assert not any("per turn" in note for note in smooth.notes)  # of 40 Hz it was 881
    s = np.linspace(*around, 400)
    off = [(smooth.spline(s, nu=k) - truth(s, k)) / d for k, d in enumerate(smooth.deviations(s))]
    assert max(np.sqrt((x**2).mean()) for x in off) < 2.5
    assert max(errors(smooth, truth)) < 1.5


@pytest.mark.parametrize("bandwidth", [None, 1.0])
def test_a_vibration_is_stated_in_second_rates_of_the_forces(bandwidth):
    """It is what they differ by, with the vibration and without it, to the first order."""
    robot, t, rng = jounce.load("planar2r"), np.arange(0, 6, 1e-3), np.random.default_rng(0)
    noise, w = 1e-5 * rng.normal(size=(len(t), 2)), 2 * np.pi * 20.0
    ripple = 8e-6 * np.sin(w * t)
    columns = {"t": t, "joint2": np.cos(t) + noise[:, 0], "joint1": np.sin(t) + ripple + noise[:, 1]}
    notes = jounce.load_motion(columns, robot, bandwidth=bandwidth).notes
    [words] = [note.split() for note in notes if "in Q2d" in note]
    slow = [np.stack([np.sin(t + k * np.pi / 2), np.cos(t + k * np.pi / 2)], axis=1) for k in range(5)]
    fast = [rate.copy() for rate in slow]
    for k in range(5):
        fast[k][:, 0] += 8e-6 * w**k * np.sin(w * t + k * np.pi / 2)
    differ = np.abs(robot.inverse_dynamics(*fast)[2] - robot.inverse_dynamics(*slow)[2]).max(axis=0)
    assert words[3] == "joint1"
    assert float(words[words.index("Q2d") - 2]) == pytest.approx(differ.max(), rel=0.15)
    assert words[words.index("Q2d") + 2].strip(",") == f"joint{np.argmax(differ) + 1}"


def test_deviations_hold_a_burst_that_a_bandwidth_leaves_out():
    t, q, truth, around = burst(1, amplitude=2e-3)
    smooth = fit(t, q, bandwidth=3)
    assert not any(v.followed for v in smooth.vibrations)
    s = np.linspace(*around, 400)
    off = [(smooth.spline(s, nu=k) - truth(s, k)) / d for k, d in enumerate(smooth.deviations(s))]
    assert max(np.sqrt((x**2).mean()) for x in off) < 3


@pytest.mark.sweep(1)
@pytest.mark.parametrize("seed", range(2))
def test_noise_and_the_steps_of_steady_joints_are_no_vibrations(seed):
    rng = np.random.default_rng(seed)
    t = np.arange(0, rng.uniform(4, 9), 1e-3)
    speeds = rng.uniform(0.005, 0.5, 2)
    for q in (encoder(0.1 + t[:, None] * speeds, 17), t[:, None] * speeds + 1e-5 * rng.normal(size=(len(t), 2))):
        smooth = fit(t, q)
        assert not any("vibrates" in note for note in smooth.notes)
    t, q, truth = rippled(seed, amplitude=0.0)
    smooth = fit(t, q)
    assert not any("vibrates" in note or "per turn" in note for note in smooth.notes)
    assert max(errors(smooth, truth)) < 1.5


@pytest.mark.sweep(2)
@pytest.mark.parametrize("seed", range(4))
def test_noise_at_half_the_rate_of_the_rows_is_no_burst(seed):
    """Powers there are squares of one normal number: large ones are more frequent than those of two."""
    rng, t = np.random.default_rng(seed), np.arange(0, 4, 0.002)
    q = np.sin(np.outer(t, 1 + 0.2 * np.arange(7))) + 1e-5 * rng.normal(size=(len(t), 7))
    assert not any("vibrates" in note for note in fit(t, q).notes)


@pytest.mark.sweep(2)
@pytest.mark.parametrize(("count", "amplitude"), [(32, 2e-5), (64, 5e-5), (128, 1e-4), (512, 1e-5)])
def test_an_encoders_interpolation_error_has_its_count_per_turn(count, amplitude):
    rng = np.random.default_rng(0)
    truth, t = harmonics(rng, base=0.05, amplitude=0.5), np.arange(0, 10, 1e-3)
    q = truth(t)[:, :2]
    q[:, 1] += amplitude * np.sin(count * q[:, 1] + 1)
    [note] = [note for note in fit(t, encoder(q, 17)).notes if "per turn" in note]
    assert note.startswith(f"column 2 is off by a wave of about {count} per turn")


@pytest.mark.sweep(1)
@pytest.mark.parametrize("seed", [0, 1])
def test_half_a_second_of_noise_hides_no_encoder_error(seed):
    rng = np.random.default_rng(seed)
    truth, t = harmonics(rng, base=0.05, amplitude=0.5), np.arange(0, 10, 1e-3)
    q = truth(t)[:, :2]
    q[:, 1] += 2e-5 * np.sin(128 * q[:, 1] + 1)
    q += rng.standard_normal(q.shape) * np.where((t > 4) & (t < 4.5), 3e-4, 1e-5)[:, None]
    [note] = [note for note in fit(t, encoder(q, 17)).notes if "per turn" in note]
    assert note.startswith("column 2 is off by a wave of about 128 per turn")
