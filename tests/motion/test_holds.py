"""Logs that are written faster than the sensor is read: rows hold older positions, of which the first ones count."""

import numpy as np
import pytest

import jounce
from jounce.motion.sample_curves import fit
from support.logs import encoder, harmonics, moves


def held(seed, sensor, rate=1000, bits=17, rests=False, joints=2):
    """A log of `rate` rows per second, whose sensor is read `sensor` times per second, at any phase if it can be."""
    rng = np.random.default_rng(seed)
    truth, duration = moves(rng, number=2) if rests else (harmonics(rng), rng.uniform(3, 6))
    t = np.arange(0, duration, 1 / rate)
    phase = 0 if float(rate / sensor).is_integer() else rng.uniform()
    read = (np.floor(t * sensor - phase + 1e-9) + phase) / sensor
    start = rng.choice([0, 3600])
    return start + t, encoder(truth(read), bits)[:, :joints], lambda s, k: truth(s - start, k)[..., :joints]


def held_apart(seed, rates, phases, rate=1000):
    """A log whose joints have sensors of their own rates, read first at their own phases, in rows."""
    rng = np.random.default_rng(seed)
    truth, t = harmonics(rng), np.arange(0, rng.uniform(3, 4), 1 / rate)
    q = np.empty((len(t), len(rates)))
    for joint, (sensor, phase) in enumerate(zip(rates, phases, strict=True)):
        read = (np.floor((t - phase / rate) * sensor + 1e-9) / sensor) + phase / rate
        q[:, joint] = truth(read)[:, joint]
    return t, encoder(q, 17), lambda s, k: truth(s, k)[..., : len(rates)]


def share_within(smooth, truth):
    s = np.linspace(*smooth.ends, 302)[1:-1]
    deviations = smooth.deviations(s)
    return [np.mean(np.abs(smooth.spline(s, nu=k) - truth(s, k)) < 1.96 * deviations[k]) for k in range(5)]


SENSORS = {
    "250 Hz": {"sensor": 250},
    "250 Hz, rests": {"sensor": 250, "rests": True},
    "100 Hz, 20 bits": {"sensor": 100, "bits": 20},
    "317.3 Hz": {"sensor": 317.3},
    "333 Hz, one joint": {"sensor": 333, "joints": 1},
    "125 Hz in 500 Hz": {"sensor": 125, "rate": 500, "bits": 14},
}


@pytest.mark.sweep(3)
@pytest.mark.parametrize("seed", [1])
@pytest.mark.parametrize("given", SENSORS.values(), ids=SENSORS)
def test_errors_of_held_samples_lie_within_the_stated_deviations(given, seed):
    """They were up to 45 deviations, in silence."""
    t, q, truth = held(seed, **given)
    smooth = fit(t, q)
    assert min(share_within(smooth, truth)) > 0.8
    [note] = [note for note in smooth.notes if "which rows hold" in note]
    assert f"the sensor gives {given['sensor']:.3g}"[:23] in note
    assert len(smooth.rows) == pytest.approx(np.ptp(t) * given["sensor"], rel=0.01)


APART = {
    "phases": ([250] * 4, range(4)),
    "rates": ([250, 500, 125, 1000, 333.3], [0.3, 0.6, 5.1, 0, 1.4]),
    "clocks of their own": ([250, 250.25, 250.5], [0.1, 2.5, 3.2]),
    "one": ([250, 1000, 1000], [0, 0, 0]),
}


@pytest.mark.sweep(3)
@pytest.mark.parametrize("seed", [2])
@pytest.mark.parametrize("given", APART.values(), ids=APART)
def test_joints_read_at_different_times_are_moved_to_common_ones(given, seed):
    """Errors were up to 343 deviations, and delays were reported as vibrations."""
    t, q, truth = held_apart(seed, *given)
    smooth = fit(t, q)
    s = np.linspace(*smooth.ends, 302)[1:-1]
    off = [(smooth.spline(s, nu=k) - truth(s, k)) / d for k, d in enumerate(smooth.deviations(s))]
    assert max(np.sqrt((x**2).mean()) for x in off) < 2
    [note] = [note for note in smooth.notes if "which rows hold" in note]
    assert f"sensors of {min(given[0])}" in note
    assert len(smooth.rows) == pytest.approx(np.ptp(t) * min(given[0]), abs=2)
    assert not any("vibrates" in note for note in smooth.notes)


@pytest.mark.sweep(2)
@pytest.mark.parametrize("missing", [1, 2, 3])
def test_a_log_may_begin_within_a_hold(missing):
    """The sensor's period was off by a thousandth, to make up for the first hold, and positions by 70 deviations."""
    t, q, truth = held(3, 250)
    t, q = t[missing:4000], q[missing:4000, :2]
    truth = (lambda whole: lambda s, k: whole(s, k)[..., :2])(truth)
    smooth = fit(t, q)
    assert min(share_within(smooth, truth)) > 0.95
    [note] = [note for note in smooth.notes if "which rows hold" in note]
    assert "up to 0.001 s late, which the deviations hold" in note


@pytest.mark.sweep(2)
@pytest.mark.parametrize("late", [0.0, 0.99, 0.5])
def test_deviations_include_a_sensor_read_before_the_first_row(late):
    """A sensor of a fourth of the log's rate is late by the same part of a row each time, which no row tells."""
    rng = np.random.default_rng(4)
    truth, t = harmonics(rng), np.arange(4000) / 1000
    q = encoder(truth(np.floor(t * 250 + 1e-9) / 250 - late / 1000), 17)[:, :2]
    smooth = fit(t, q)
    s = np.linspace(*smooth.ends, 302)[1:-1]
    off = [(smooth.spline(s, nu=k) - truth(s, k)[:, :2]) / d for k, d in enumerate(smooth.deviations(s))]
    assert max(np.sqrt((x**2).mean()) for x in off) < 1.9
    assert (np.sqrt((off[0] ** 2).mean()) > 1) == (late > 0.6)  # the root mean square of what is possible


def test_the_delay_of_a_hold_is_stated():
    t, q, _ = held(3, 250)
    [note] = fit(t, q).notes
    assert "gives 250 values per second, which rows hold, 0.0015 s late on average" in note  # of 0, 1, 2 and 3 ms
    assert "the others are at the sensor's times or up to 0.001 s late" in note


@pytest.mark.sweep(2)
@pytest.mark.parametrize(("bits", "rests"), [(12, False), (12, True), (17, True), (17, False)])
def test_encoders_that_stay_on_a_step_hold_nothing(bits, rests):
    t, q, _ = held(1, 1000, bits=bits, rests=rests)
    assert (np.diff(q, axis=0) == 0).all(axis=1).any() == (rests or bits == 12)
    smooth = fit(t, q)
    assert len(smooth.rows) == len(t)
    assert not any("hold" in note or "repeat" in note for note in smooth.notes)


def test_a_joint_creeping_over_encoder_steps_is_not_held():
    """Its value changes every 25 rows: by the encoder, not by the sensor."""
    t = np.arange(4000) / 1000
    q = encoder(40 * 2 * np.pi / 2**14 * t + 2e-3 * np.sin(t), 14)[:, None]
    smooth = fit(t, q)
    assert len(smooth.rows) == len(t)


def set_off_in_turn(joints, seconds, hold, seed=1):
    """A log whose joints set off after 0, 2 and 4 s; until then a brake holds them, and encoders flicker by a step."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * 1000)) / 1000
    read = np.arange(len(t)) // hold * hold
    start = np.array([0, 0, 2, 4])[np.arange(joints) % 4]
    w, noise, step = 2 * np.pi * rng.uniform(0.5, 3, joints), rng.normal(size=(len(t), joints)), 2 * np.pi / 2**17

    def truth(s):
        after = np.maximum(s[:, None] - start, 0)
        return 0.5 * np.sin(w * after) * after**6 / (after**6 + 0.2**6)

    q = encoder((truth(t) + 2e-4 * noise * (t[:, None] >= start))[read], 17)
    for joint in np.flatnonzero(start):
        flicker = hold * rng.integers(100 // hold, 1900 // hold)
        q[flicker : flicker + hold, joint] += step
    return t, q, truth


@pytest.mark.sweep(2)
@pytest.mark.parametrize(("joints", "seconds", "hold"), [(6, 8, 1), (6, 6, 4), (20, 9, 1)])
def test_joints_that_rest_for_seconds_are_smoothed(joints, seconds, hold):
    """Logs of 6,000 to 9,000 rows at 1 kHz were refused for too few samples: in a rest, one row of a joint changes."""
    t, q, truth = set_off_in_turn(joints, seconds, hold)
    smooth = fit(t, q)
    s = np.linspace(*smooth.ends, 302)[1:-1]
    [deviation] = smooth.deviations(s, 0)
    off = smooth.spline(s) - truth(s)
    assert np.sqrt((off**2).mean()) < 3e-4
    assert np.mean(np.abs(off) < 1.96 * np.hypot(deviation, 1e-4)) > 0.85
    assert any("which rows hold" in note for note in smooth.notes) == (hold > 1)
    assert len(smooth.rows) == pytest.approx(len(t) / hold, rel=0.03)


def test_a_joint_that_seldom_changes_is_smoothed_with_the_others():
    """Less than ten rows, at which it alone changes, determine no spline."""
    rng = np.random.default_rng(0)
    t = np.arange(3000) / 1000
    q = np.stack([0.4 * np.sin(3 * t) + 1e-4 * rng.normal(size=len(t)), np.zeros(len(t))], axis=1)
    for _ in range(5):
        q[rng.integers(200, 2800) :, 1] += rng.normal()
    smooth = fit(t, q)
    assert np.abs(smooth.spline(t)[:, 0] - 0.4 * np.sin(3 * t))[300:-300].max() < 1e-3


@pytest.mark.sweep(1)
@pytest.mark.parametrize("share", [0.3, 0.06])
@pytest.mark.parametrize("seed", [1])
def test_rows_that_repeat_at_random_are_left_out(seed, share):
    """They were taken for wrong stamps: of 0.3, errors were up to 20 deviations."""
    rng = np.random.default_rng(seed)
    t = np.arange(4000) / 1000
    whole = harmonics(rng)
    truth = lambda s, k=0: whole(s, k)[..., :3]  # noqa: E731
    q = encoder(truth(t), 17)
    stale = np.append(False, rng.random(len(t) - 1) < share)
    smooth = fit(t, q[np.maximum.accumulate(np.where(stale, 0, np.arange(len(t))))])
    assert np.count_nonzero(stale[smooth.rows]) < 0.05 * stale.sum()
    assert min(share_within(smooth, truth)) > 0.85
    assert not any("stamps scatter" in note for note in smooth.notes)


def test_a_motion_of_held_samples_has_no_jumps():
    t, q, _ = held(2, 250)
    motion = jounce.Motion.fit(t, q)  # a warning is an error
    assert any("which rows hold" in note for note in motion.notes)
