"""Stamps that scatter: their share of the noise, the bandwidth in spite of it, and what is none of theirs."""

import numpy as np
import pytest
from benchmarks.live import HOME, MOTIONS, follow, force_errors, panda, pick_and_place

from jounce.live.innovations import NoiseWindows, StampJitter

DT, ROWS = 1e-3, 4000
RANDOM = np.random.default_rng(0)
WHITE = RANDOM.normal(size=ROWS)
SAME = [1.0, 1.0, 1.0]


def slow_moves(t, seed):
    """The sum of two series of slow moves from rest."""
    moves = [pick_and_place(t, seed + k, move, rest=1.0) for k, move in ((0, 3.0), (1, 2.2))]
    q, *rates = [a + b for a, b in zip(*moves, strict=True)]
    return [q - HOME, *rates]


def jittering_log(motion=slow_moves, jitter=3e-4, resonance=0.0, noise=3e-6, duration=4.5):
    """Stamps that are off and samples, each 16th a repeat, of a motion from rest with a resonance of 30 Hz."""
    random = np.random.default_rng(3)
    read = np.cumsum(random.uniform(0.8e-3, 1.2e-3, round(duration / DT)))
    stamps = np.maximum.accumulate(read + jitter * random.normal(size=len(read))) + 1e-12 * np.arange(len(read))

    def truth(t):
        phases = 60 * np.pi * t[:, None] + np.arange(7)
        swing = [resonance * (60 * np.pi) ** k * np.sin(phases + k * np.pi / 2) for k in range(5)]
        return [rate + part for rate, part in zip(motion(np.maximum(t, 0), 1), swing, strict=True)]

    q = truth(read)[0] + random.normal(0, noise, (len(read), 7))
    for k in np.flatnonzero(random.random(len(read)) < 0.06)[1:]:
        q[k] = q[k - 1]
    return stamps, q, truth


def test_bank_finds_a_slow_motion_whose_stamps_jitter():
    stamps, q, truth = jittering_log()
    found = follow(panda().live(DT, lag=0.2), stamps, q, skip=1.5)
    z = np.abs(found.rates - np.stack(truth(found.t), axis=1)) / found.deviations
    _, Qd, Q2d = force_errors(panda(), found.rates, truth(found.t))
    assert Qd < 0.02
    assert Q2d < 0.1
    assert found.good.all(axis=1).mean() > 0.5
    assert np.where(found.good[:, None], z, 0).max() < 5
    assert (z < 2).mean() > 0.95


@pytest.mark.sweep(3)
@pytest.mark.parametrize(
    ("motion", "jitter", "resonance", "lag"),
    [
        (slow_moves, 3e-4, 3e-5, 0.2),
        (slow_moves, 3e-4, 3e-4, 0.2),
        (slow_moves, 8e-5, 3e-5, 0.2),
        (slow_moves, 0.0, 3e-5, 0.2),
        (MOTIONS["harmonics"], 3e-4, 1e-4, 0.02),
        (MOTIONS["harmonics"], 8e-5, 3e-5, 0.02),
        (MOTIONS["pick and place"], 3e-4, 3e-5, 0.02),
        (MOTIONS["pick and place"], 8e-5, 3e-5, 0.02),
        (MOTIONS["pick and place"], 8e-5, 1e-4, 0.02),
    ],
)
def test_resonance_below_the_noise_of_stamps_is_not_trusted(motion, jitter, resonance, lag):
    stamps, q, _ = jittering_log(motion, jitter, resonance, noise=1e-5, duration=2.5)
    assert not follow(panda().live(DT, lag=lag), stamps, q, skip=0.5).good.any()


@pytest.mark.parametrize("motion", [slow_moves, MOTIONS["pick and place"]])
def test_joint_of_a_resonance_alone_is_not_trusted(motion):
    resonant, calm = (jittering_log(motion, 8e-5, size, noise=1e-5, duration=3.0) for size in (3e-5, 0))
    q = np.where(np.arange(7) == 2, resonant[1], calm[1])
    good = follow(panda().live(DT, lag=0.1), calm[0], q, skip=1.5).good
    assert not good[:, 2].any()
    assert np.delete(good, 2, axis=1).mean() > 0.3


def watched(errors, moving, own, vibration=0.0):
    """What is found of stamps off by `errors` (N,), of joints that move, with own noise and a vibration of 30 Hz."""
    n, jitter = len(moving), StampJitter.start(1, len(moving))
    noise = NoiseWindows(np.full(n, 1e-4), np.zeros(n))
    phases = 60 * np.pi * DT * np.arange(ROWS)[:, None] + 2 * np.arange(n)
    nu = own * np.random.default_rng(1).normal(size=(ROWS, n)) + vibration * np.sin(phases)
    for x, error in zip(nu, errors, strict=True):
        jitter.add(DT, x + np.array(moving) * error, np.array(moving), noise, np.zeros((1, n)))
    return jitter


@pytest.mark.parametrize("deviation", [1e-4, 3e-4])
@pytest.mark.parametrize("vibration", [0.0, 4e-6])
def test_errors_of_stamps_are_found(deviation, vibration):
    found = watched(deviation * WHITE, [1.0, -2.0, 0.5], deviation / 20, vibration).noise(DT, np.zeros(3, int))
    np.testing.assert_allclose(found, np.broadcast_to(deviation * np.array([1, 2, 0.5]), (2, 3)), rtol=0.15)


@pytest.mark.parametrize(
    ("errors", "moving", "own", "vibration", "dt"),
    [
        (0 * WHITE, SAME, 1e-4, 0, DT),  # noise of single joints
        (1e-4 * WHITE, SAME, 5e-5, 0, DT),  # as large as half of that of stamps
        (3e-4 * WHITE, [1.0, 0.0, 0.0], 1e-6, 0, DT),  # a single joint moves: it may be its own
        (3e-4 * WHITE, [1.0], 1e-6, 0, DT),  # a robot of one joint
        (3e-4 * np.sin(60 * np.pi * DT * np.arange(ROWS)), SAME, 1e-6, 0, DT),  # a motion of all joints that is missed
        (1e-4 * WHITE, SAME, 1e-6, 1.5e-5, DT),  # a vibration within the noise of stamps
        (6e-4 * WHITE, SAME, 1e-6, 0, DT),  # more than half of a spacing
        (1e-4 * WHITE, SAME, 1e-6, 0, 4 * DT),  # samples so rare that vibrations look white
    ],
)
def test_what_may_be_none_of_stamps_is_none(errors, moving, own, vibration, dt):
    assert not watched(errors, moving, own, vibration).noise(dt, np.zeros(len(moving), int)).any()


@pytest.mark.parametrize(
    ("errors", "own", "vibration", "vibrates"),
    [
        (0 * WHITE, 1e-5, 0, False),  # white noise of joints
        (3e-4 * WHITE, 1e-5, 0, False),  # of joints and of stamps
        (3e-4 * WHITE, 1e-6, 1e-5, False),  # a slow part of 7e-6 rad, and of 2 % of all
        (3e-4 * WHITE, 1e-6, 3e-5, True),  # of 2e-5 rad
        (4e-5 * WHITE, 1e-6, 8e-6, True),  # of 14 % of all
        (3e-4 * WHITE, 4e-5, 2e-5, False),  # of 11 % of the rest, which passes for noise of joints
        (0 * WHITE, 1e-5, 3e-5, True),  # without errors of stamps
    ],
)
def test_vibration_is_a_slow_part_across_the_velocities(errors, own, vibration, vibrates):
    assert watched(errors, SAME, own, vibration).vibrating.tolist() == [vibrates] * 3


def test_stated_noise_is_that_of_stamps_too():
    live = panda().live(DT, 2.25, noise=1e-4)
    stamps, q, _ = jittering_log(duration=1.5)
    for t, sample in zip(stamps, q, strict=True):
        live.update(sample, t)
    assert not live._jitter.noise(DT, live._used).any()
