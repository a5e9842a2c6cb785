"""Rates and forces while a robot moves: honest deviations, uneven times, and samples that are no good."""

from functools import cache

import numpy as np
import pytest
from benchmarks.live import GIVEN, MOTIONS, encoder_noise, follow, given_rates, harmonics, pick_and_place, rounded

import jounce
from jounce import JounceWarning
from jounce.live.innovations import estimate_noise
from support.refusals import refusal

ROBOT = jounce.load("iiwa14")
PLANAR = jounce.load("planar2r").with_limits(lower=-3, upper=3, velocity=3)
QUIET = {"noise": 1e-5, "bandwidth": 8}


def two_sines(t):
    return np.array([np.sin(t), 0.5 * np.cos(2 * t)])


def fed(live, times, stamps=True, spoil=lambda k, q: q):
    """The rates after each sample of `sine`, which `spoil` may change."""
    return np.array([live.update(spoil(k, two_sines(t)), t if stamps else None) for k, t in enumerate(times)])


@cache
def z_scores(kind, bits, dt, lag, bandwidth):
    """Errors of trusted rates over their deviations, and of which joints move."""
    t = np.arange(round(2.5 / dt)) * dt
    found = follow(ROBOT.live(dt, bandwidth, lag), t, rounded(MOTIONS[kind](t, seed=bits)[0], bits), skip=1.0)
    z = (found.rates - np.stack(MOTIONS[kind](found.t, seed=bits), axis=1)) / found.deviations
    return np.where(found.good[:, None], z, np.nan), np.broadcast_to(found.moving[:, None], z.shape)


LOGS = [
    ("harmonics", 16, 2e-3, 0.0, None),
    ("harmonics", 20, 2e-3, 0.02, None),
    ("harmonics", 12, 1e-3, 0.005, 6),
    ("pick and place", 16, 2e-3, 0.0, None),
    ("pick and place", 20, 2e-3, 0.02, 20),
    ("pick and place", 14, 1e-3, 0.02, None),
]


@pytest.mark.sweep(2)
@pytest.mark.parametrize("log", LOGS, ids=str)
def test_no_trusted_error_exceeds_five_deviations(log):
    z, _ = z_scores(*log)
    assert np.isfinite(z).mean() > 0.4
    assert np.nanmax(np.abs(z)) < 5


def test_deviations_are_neither_small_nor_large():
    squares = [np.nanmean(np.where(moving, z, np.nan) ** 2) for z, moving in (z_scores(*log) for log in LOGS)]
    assert 0.9 < np.sqrt(np.mean(squares)) < 1.15


def measured(seed, dt, duration, stamp_error, resonance=0.0, noise=1e-5, slower=1.0):
    """Stamps, samples and true rates of a log as robots write them.

    Spacings vary by 25 %, stamps are off by errors with heavy tails, 6 % of the rows repeat the last one, and a
    resonance of 30 Hz, above all bandwidths of the bank, may go on all the time.
    """
    random, omega = np.random.default_rng(seed), 2 * np.pi * 30
    read = np.cumsum(dt * random.uniform(0.9, 1.15, round(duration / dt)))
    late = stamp_error * random.normal(size=len(read)) * np.where(random.random(len(read)) < 0.02, 4, 1)
    stamps = np.maximum.accumulate(read + late) + 1e-12 * np.arange(len(read))

    def truth(t):
        slow = [slower**k * rate for k, rate in enumerate(harmonics(slower * t, seed))]
        phases = omega * t[:, None] + np.arange(7)
        return [rate + resonance * omega**k * np.sin(phases + k * np.pi / 2) for k, rate in enumerate(slow)]

    q = truth(read)[0] + random.normal(0, noise, (len(read), 7))
    for k in np.flatnonzero(random.random(len(read)) < 0.06)[1:]:
        q[k] = q[k - 1]
    return stamps, q, truth


@pytest.mark.parametrize(
    ("log", "lag", "least", "most"),
    [
        ({"seed": 0, "dt": 1e-3, "duration": 2.5, "stamp_error": 1e-4}, 0.02, 0.1, 0.9),
        ({"seed": 0, "dt": 4e-3, "duration": 6, "stamp_error": 3e-4, "slower": 0.3}, 0.0, 0.05, 0.9),
        ({"seed": 1, "dt": 1e-3, "duration": 2, "stamp_error": 0, "resonance": 3e-5}, 0.02, 0, 0),
        ({"seed": 0, "dt": 1e-3, "duration": 2, "stamp_error": 1e-4, "resonance": 3e-3}, 0.0, 0, 0),
    ],
)
def test_trust_of_logs_with_repeats_jitter_and_resonances(log, lag, least, most):
    stamps, q, truth = measured(**log)
    found = follow(ROBOT.live(log["dt"], lag=lag), stamps, q, skip=stamps[0] + 2 * lag)
    z = np.abs(found.rates - np.stack(truth(found.t), axis=1)) / found.deviations
    assert least <= found.good.mean() <= most
    assert np.where(found.good[:, None], z, 0).max() < 5


def test_bandwidth_below_that_of_the_motion_is_not_trusted():
    t = 2e-3 * np.arange(1000)
    found = follow(ROBOT.live(2e-3, 4, noise=encoder_noise(16)), t, rounded(pick_and_place(t, 3)[0], 16), skip=0.5)
    assert found.good.mean() < 0.1


def test_rates_of_a_polynomial_are_exact_at_uneven_times():
    times, live = np.cumsum(np.random.default_rng(0).uniform(5e-4, 2e-3, 1500)), PLANAR.live(1e-3, lag=0.03, **QUIET)
    for t in times:
        rates = live.update([0.2 * t**3 - 0.4 * t, 1.0 - t**2 / 4], t)
    s = live.t
    assert s == pytest.approx(times[-1] - 0.03)
    expected = [[0.2 * s**3 - 0.4 * s, 1 - s**2 / 4], [0.6 * s**2 - 0.4, -s / 2], [1.2 * s, -0.5], [1.2, 0], [0, 0]]
    np.testing.assert_allclose(rates, expected, atol=1e-5)


def test_stamps_of_uneven_samples_are_worth_a_factor_of_twenty():
    times = 1e-3 * np.arange(1500) + np.random.default_rng(0).uniform(-3e-4, 3e-4, 1500)
    exact = np.array([np.cos(times - 0.02), -np.sin(2 * (times - 0.02))]).T[800:]
    with_stamps, without = (fed(PLANAR.live(1e-3, **QUIET), times, stamps)[800:, 1] for stamps in (True, False))
    assert np.abs(without - exact).max() > 20 * np.abs(with_stamps - exact).max()


def test_first_sample_is_the_start_of_rates():
    live = PLANAR.live(0.01, lag=0.03, **QUIET)
    found = fed(live, 0.01 * np.arange(5))
    assert np.isnan(found[:3]).all()
    assert np.isfinite(found[3:]).all()
    assert np.isnan(PLANAR.live(0.01).forces().Q).all()


def test_lost_sample_is_that_of_a_row_left_out():
    times, kept = 1e-3 * np.arange(600), [k for k in range(600) if not 500 <= k < 510]
    lost, left_out = PLANAR.live(1e-3, **QUIET), PLANAR.live(1e-3, **QUIET)
    with_nan = fed(lost, times, spoil=lambda k, q: q if k in kept else q * [1, np.nan])
    without = fed(left_out, times[kept])
    np.testing.assert_allclose(with_nan[-1], without[-1], rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(lost.deviations, left_out.deviations, rtol=1e-3)


def test_deviations_grow_while_samples_are_lost():
    live = PLANAR.live(1e-3, lag=0, **QUIET)
    fed(live, 1e-3 * np.arange(500))
    before = live.deviations
    for _ in range(20):
        live.update([np.nan, np.nan])
    assert (live.deviations > 1.2 * before).all()


def test_long_gap_starts_anew():
    live = PLANAR.live(1e-3, lag=0, **QUIET)
    fed(live, 1e-3 * np.arange(500))
    assert live.trust.good.all()
    live.update(two_sines(3.0), 3.0)
    assert not live.trust.good.any()
    assert (live.deviations[1:] > 1e-2).all()


def test_row_that_repeats_the_last_one_while_joints_move_is_lost():
    times = 1e-3 * np.arange(700)
    repeated = fed(PLANAR.live(1e-3, **QUIET), times, spoil=lambda k, q: two_sines(times[k - (k % 10 == 9)]))
    lost = fed(PLANAR.live(1e-3, **QUIET), times, spoil=lambda k, q: q if k % 10 != 9 else q * np.nan)
    np.testing.assert_allclose(repeated[-1], lost[-1], atol=1e-6)


def test_encoder_that_wraps_is_followed():
    arm, times = jounce.load("planar2r"), 1e-3 * np.arange(700)
    found = [arm.live(1e-3, **QUIET) for _ in range(2)]
    for t in times:
        q = np.array([3.0 + t, -9 * t])
        found[0].update(q, t)
        found[1].update((q + np.pi) % (2 * np.pi) - np.pi, t)
    np.testing.assert_allclose(found[1].rates[1:], found[0].rates[1:], atol=1e-6)


def test_encoder_that_sticks_loses_trust():
    live, times = PLANAR.live(1e-3, lag=0, **QUIET), 1e-3 * np.arange(600)
    fed(live, times, spoil=lambda k, q: np.array([two_sines(times[min(k, 560)])[0], q[1]]))
    assert live.trust.good.tolist() == [False, True]


def test_rate_that_changes_is_taken_from_stamps():
    times = np.cumsum(np.where(np.arange(900) < 500, 1e-3, 2.5e-3))
    live = PLANAR.live(1e-3, **QUIET)
    fed(live, times)
    errors = np.array(live.rates[:2]) - [two_sines(live.t), [np.cos(live.t), -np.sin(2 * live.t)]]
    assert (np.abs(errors) < 5 * live.deviations[:2]).all()
    assert live.trust.good.all()


@pytest.mark.parametrize(("sample", "t", "says"), [
    ([0.1], None, "q has shape (1,); expected (..., 2)"),
    ([[0.1, 0.2]], None, "expected (2,) numbers"),
    ([np.inf, 0], None, "expected (2,) numbers"),
    ({"joint1": 0.1}, None, "joint2"),
    ([0.1, 0.2], 0.0, "not after the last sample at 0.1 s"),
    ([0.1, 0.2], -1.0, "not after the last sample"),
    ([0.1, 0.2], np.nan, "expected the time of the sample"),
    ([0.9, 0.2], None, "joint 'joint1' jumps from 0.1 to 0.9"),
    ([5.73, 11.5], None, "would be within limits if they were degrees"),
])  # fmt: skip
def test_wrong_sample_is_refused_and_left_out(sample, t, says):
    live, other = (PLANAR.live(1e-3, lag=0, **QUIET) for _ in range(2))
    for each in (live, other):
        each.update([0.1, 0.2], 0.1)
    refusal(lambda: live.update(sample, t), says)
    np.testing.assert_array_equal(live.update([0.1001, 0.2]), other.update([0.1001, 0.2]))


def test_first_sample_in_degrees_is_warned_of():
    with pytest.warns(JounceWarning, match="degrees"):
        PLANAR.live(1e-3).update([30.0, 45.0])


@pytest.mark.parametrize(("given", "says"), [
    ({"dt": 0}, "dt is 0; expected the spacing of samples in s, above 0"),
    ({"dt": -1e-3}, "above 0"),
    ({"lag": -0.1}, "lag is -0.1; expected 0 to 1 s"),
    ({"lag": 1.5}, "what the buffer holds"),
    ({"bandwidth": 0}, "bandwidth 0 Hz does not fit"),
    ({"bandwidth": 300}, "above 0 to 250 Hz"),
    ({"dt": 1.0}, "the bank from 1 Hz on does not fit samples every 1 s"),
    ({"states": 4}, "states is 4; expected 5 to 8"),
    ({"noise": 0}, "standard deviations above 0"),
    ({"noise": [1e-5]}, "noise has shape (1,)"),
])  # fmt: skip
def test_wrong_settings_are_refused(given, says):
    refusal(lambda: PLANAR.live(**({"dt": 1e-3} | given)), says)


@pytest.mark.parametrize("robot", [jounce.load("fivebar"), jounce.load("g1", base="floating")], ids=lambda x: x.name)
def test_robots_that_float_or_have_loops_are_refused(robot):
    refusal(lambda: robot.live(1e-3), "a robot on a fixed base without loops")


@pytest.mark.parametrize("bits", [12, 16, 20])
def test_noise_of_an_encoder_is_found_by_its_step(bits):
    t = 1e-3 * np.arange(256)
    sigma, step = estimate_noise(t, rounded(np.sin(3 * t), bits))
    assert step == pytest.approx(2 * np.pi / 2**bits, rel=1e-4)
    assert sigma == pytest.approx(encoder_noise(bits), rel=0.3)
    assert estimate_noise(t, np.full(256, 0.3)) == (0, 0)


def test_white_noise_is_found_at_uneven_times():
    random = np.random.default_rng(0)
    t = np.cumsum(random.uniform(5e-4, 2e-3, 256))
    sigma, step = estimate_noise(t, np.sin(3 * t) + random.normal(0, 1e-4, 256))
    assert (sigma, step) == (pytest.approx(1e-4, rel=0.15), 0)


def test_deviations_of_forces_are_those_of_their_linearization():
    live = ROBOT.live(1e-3, 10, noise=1e-5)
    t = 1e-3 * np.arange(600)
    for time, sample in zip(t, harmonics(t, 1)[0] + np.random.default_rng(0).normal(0, 1e-5, (600, 7)), strict=True):
        live.update(sample, time)
    forces = live.forces(keep_uncertain=True)
    np.testing.assert_allclose(forces[:3], ROBOT.inverse_dynamics(*live.rates), rtol=1e-12)
    roots = np.linalg.cholesky(live._covariance)
    random = np.random.default_rng(1).normal(size=(4000, 7, 5))
    moved = np.array(live.rates)[:, None] + np.einsum("jab,sjb->asj", roots, random)
    np.testing.assert_allclose(forces.deviations, np.std(ROBOT.inverse_dynamics(*moved), axis=1), rtol=0.06)


def test_uncertain_second_rate_is_nan_unless_kept():
    t, live, shares = 2e-3 * np.arange(750), ROBOT.live(2e-3, 8, lag=0), []
    for time, sample in zip(t, rounded(pick_and_place(t, 1)[0], 12), strict=True):
        live.update(sample, time)
        forces, kept = live.forces(), live.forces(keep_uncertain=True)
        np.testing.assert_array_equal(np.isnan(forces.Q2d), ~forces.certain | np.isnan(kept.Q2d))
        assert not (np.abs(forces.Q2d) <= forces.deviations[2]).any()
        shares.append(forces.certain.mean())
    assert np.isfinite(kept.Q2d).all()
    assert np.mean(shares) < 0.5


def test_second_rate_smaller_than_its_deviation_is_nan():
    """Of a joint whose Q2d is a sine far above its noise: both signs are kept, what lies between them is not."""
    live, found, t = PLANAR.live(1e-3, **QUIET | {"noise": 1e-6}, lag=0.05), [], 1e-3 * np.arange(3000)
    random = np.random.default_rng(0)
    for time in t:
        live.update(two_sines(3 * time) / 3 + random.normal(0, 1e-6, 2), time)
        forces = live.forces()
        found.append([forces.Q2d, live.forces(keep_uncertain=True).Q2d, forces.deviations[2]])
    Q2d, kept, deviation = np.array(found)[1500:].swapaxes(0, 1)
    np.testing.assert_array_equal(np.isnan(Q2d), np.abs(kept) <= deviation)
    assert (np.isnan(Q2d).mean(axis=0) > 0).all()
    assert (np.isnan(Q2d).mean(axis=0) < 0.5).all()


def test_benchmark_of_given_bandwidths_is_that_of_the_estimator():
    t = 1e-3 * np.arange(700)
    q = rounded(harmonics(t, 1)[0], 16)
    [(times, rates)] = [(times, rates) for lag, times, rates in given_rates(t, q, 0.65) if lag == 0.02]
    found = follow(ROBOT.live(1e-3, GIVEN[3], 0.02), t, q, 0.65)
    np.testing.assert_allclose(times, found.t, atol=1e-12)
    np.testing.assert_allclose(rates[:, 3], found.rates, rtol=1e-4, atol=1e-3)
