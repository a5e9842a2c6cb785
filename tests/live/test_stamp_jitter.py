"""Stamps that scatter: their share of the noise, the bandwidth in spite of it, and what is none of theirs."""

import numpy as np
import pytest
from benchmarks.live import HOME, follow, force_errors, panda, pick_and_place

from jounce.live.stamp_jitter import StampJitter

DT, ROWS = 1e-3, 4000
RANDOM = np.random.default_rng(0)
WHITE = RANDOM.normal(size=ROWS)
SAME = [1.0, 1.0, 1.0]


def jittering_log(resonance=0.0, duration=4.5):
    """Stamps off by 0.3 ms and samples, each 16th a repeat, of a slow motion from rest with a resonance of 30 Hz."""
    random = np.random.default_rng(3)
    read = np.cumsum(random.uniform(0.8e-3, 1.2e-3, round(duration / DT)))
    stamps = np.maximum.accumulate(read + 3e-4 * random.normal(size=len(read))) + 1e-12 * np.arange(len(read))

    def truth(t):
        moves = [pick_and_place(np.maximum(t, 0), seed, move, rest=1.0) for seed, move in ((1, 3.0), (2, 2.2))]
        phases = 60 * np.pi * t[:, None] + np.arange(7)
        swing = [resonance * (60 * np.pi) ** k * np.sin(phases + k * np.pi / 2) for k in range(5)]
        q, *rates = [sum(parts) for parts in zip(*moves, swing, strict=True)]
        return [q - HOME, *rates]

    q = truth(read)[0] + random.normal(0, 3e-6, (len(read), 7))
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


@pytest.mark.parametrize("resonance", [3e-5, 3e-4])
def test_resonance_is_not_taken_for_stamps(resonance):
    stamps, q, _ = jittering_log(resonance, duration=3.0)
    assert follow(panda().live(DT, lag=0.2), stamps, q, skip=1.5).good.all(axis=1).mean() == 0


def watched(errors, moving, own, vibration=0.0, dt=DT):
    """The deviations found of stamps off by `errors` (N,), of joints that move, with own noise and one of 30 Hz."""
    n, jitter = len(moving), StampJitter.start(1, len(moving))
    phases = 60 * np.pi * DT * np.arange(ROWS)[:, None] + 2 * np.arange(n)
    nu = own * np.random.default_rng(1).normal(size=(ROWS, n)) + vibration * np.sin(phases)
    for x, error in zip(nu, errors, strict=True):
        jitter.add(DT, x + np.array(moving) * error, np.array(moving), np.full(n, 1e-4), np.zeros((1, n)))
    return jitter.noise(dt)


@pytest.mark.parametrize("deviation", [1e-4, 3e-4])
@pytest.mark.parametrize("vibration", [0.0, 4e-6])
def test_errors_of_stamps_are_found(deviation, vibration):
    found = watched(deviation * WHITE, [1.0, -2.0, 0.5], deviation / 20, vibration)
    np.testing.assert_allclose(found, np.broadcast_to(deviation * np.array([1, 2, 0.5]), (2, 1, 3)), rtol=0.15)


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
    assert not watched(errors, moving, own, vibration, dt).any()


def test_stated_noise_is_that_of_stamps_too():
    live = panda().live(DT, 2.25, noise=1e-4)
    stamps, q, _ = jittering_log(duration=1.5)
    for t, sample in zip(stamps, q, strict=True):
        live.update(sample, t)
    assert not live._jitter.noise(DT).any()
