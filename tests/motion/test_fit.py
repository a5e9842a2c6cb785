"""Smoothing of measured samples: against truth where it is known, and what is said where samples do not carry it."""

import re
from functools import cache

import numpy as np
import pytest
from scipy.interpolate import BPoly, make_lsq_spline

import jounce
from jounce.motion import knots, least_squares
from jounce.motion.sample_curves import fit
from support.logs import NAMES, encoder, harmonics, log
from support.refusals import expect_refusal, refusal


@cache
def fitted_log(name):
    measured = log(name)
    return measured, fit(measured.t, measured.q)


@cache
def iiwa():
    return jounce.load("iiwa14")


def ideal_deviation(sigma, spacing, bandwidth, order):
    """The standard deviation of a derivative of samples smoothed by an ideal low-pass filter.

    White noise of sigma at spacing dt has the density 2 sigma^2 dt per Hz. Up to B Hz, its k-th derivative has the
    variance 2 sigma^2 dt B (2 pi B)^(2 k) / (2 k + 1); a spline with intervals of 1 / (2 B) comes within some percent.
    """
    variance = 2 * sigma**2 * spacing * bandwidth * (2 * np.pi * bandwidth) ** (2 * order) / (2 * order + 1)
    return np.sqrt(variance)


def inner_times(smooth, number=300):
    return np.linspace(*smooth.ends, number + 2)[1:-1]


def spline_rates(spline, t):
    return [spline(t, nu=k) for k in range(5)]


def force_errors(given, true):
    """Root mean squares of the errors of Q, Qd, Q2d over the peak, of the worst joint."""
    forces = zip(iiwa().inverse_dynamics(*given), iiwa().inverse_dynamics(*true), strict=True)
    return np.array([(np.sqrt(((a - b) ** 2).mean(0)) / np.abs(b).max(0)).max() for a, b in forces])


def best(measured, t, true):
    """The errors of least squares with evenly spaced knots, their number chosen by the truth for each rate."""
    found = []
    for intervals in np.unique(np.geomspace(12, 150, 24).astype(int)):
        knots = np.pad(np.linspace(measured.t[0], measured.t[-1], intervals + 1), 9, mode="edge")
        found.append(force_errors(spline_rates(make_lsq_spline(measured.t, measured.q, knots, 9), t), true))
    return np.min(found, axis=0)


@pytest.mark.sweep(2)
@pytest.mark.parametrize("name", NAMES)
def test_a_fit_is_nearly_as_good_as_one_that_knows_the_truth(name):
    measured, smooth = fitted_log(name)
    t = inner_times(smooth, 200)
    true = [measured.truth(t, k) for k in range(5)]
    assert (force_errors(spline_rates(smooth.spline, t), true) <= np.array([2, 2, 3]) * best(measured, t, true)).all()


@pytest.mark.sweep(6)
@pytest.mark.parametrize("name", NAMES)
def test_errors_lie_within_the_stated_deviations(name):
    measured, smooth = fitted_log(name)
    t = inner_times(smooth)
    deviations = smooth.deviations(t)
    within = [np.abs(smooth.spline(t, nu=k) - measured.truth(t, k)) < 1.96 * deviations[k] for k in range(5)]
    assert 0.90 <= np.mean(within) <= 0.995


@pytest.mark.sweep(6)
@pytest.mark.parametrize("name", NAMES)
def test_the_ends_are_flagged_where_deviations_rise(name):
    measured, smooth = fitted_log(name)
    deviation = smooth.deviations(np.array([measured.t[0], *smooth.ends, measured.t[-1]]))[4].max(axis=1)
    assert measured.t[0] < smooth.ends[0] < smooth.ends[1] < measured.t[-1]
    assert deviation[0] > 20 * deviation[1]
    assert deviation[3] > 20 * deviation[2]


def test_a_clean_log_of_17_bits_carries_second_rates_of_the_forces():
    measured, smooth = fitted_log("17 bits, six digits")
    t = inner_times(smooth)
    wrong = force_errors(spline_rates(smooth.spline, t), [measured.truth(t, k) for k in range(5)])
    assert wrong[2] < 0.01
    assert smooth.shortfall(2) is None
    assert {noise.kind for noise in smooth.noise} == {"encoder step"}
    assert [noise.step for noise in smooth.noise] == pytest.approx([2 * np.pi / 2**17] * 7, rel=1e-3)
    assert "17 bits" in str(smooth.noise[0])


@pytest.mark.parametrize(
    ("name", "kind", "sigma"),
    [
        ("12 bits", "encoder step", 2 * np.pi / 2**12 / np.sqrt(12)),
        ("noise 1e-4", "white", 1e-4),
        ("noise 1e-5, 19 bits, gaps, 2 kHz", "white", np.hypot(1e-5, 2 * np.pi / 2**19 / np.sqrt(12))),
    ],
)
def test_noise_is_estimated_per_joint(name, kind, sigma):
    _, smooth = fitted_log(name)
    assert [noise.kind for noise in smooth.noise] == [kind] * 7
    assert [noise.sigma for noise in smooth.noise] == pytest.approx([sigma] * 7, rel=0.05)


def test_written_digits_are_noise_of_their_own():
    t = np.arange(4000) / 500
    smooth = fit(t, np.round(harmonics(np.random.default_rng(3))(t), 4))
    assert {noise.kind for noise in smooth.noise} == {"written digits"}
    assert {noise.step for noise in smooth.noise} == {1e-4}


def test_stamps_are_corrected_by_one_shift_per_row():
    measured, smooth = fitted_log("stamps")
    t = inner_times(smooth)
    moved = np.sqrt(((smooth.spline(measured.t) - measured.q) ** 2).mean())
    assert any("repeat the row before" in note for note in smooth.notes)
    assert any("time stamps scatter by 0.00029 s" in note for note in smooth.notes)  # 1e-3 / sqrt(12)
    assert max(noise.sigma for noise in smooth.noise) < 0.05 * moved
    assert np.sqrt(((smooth.spline(t) - measured.truth(t)) ** 2).mean()) < 0.1 * moved


def covered(errors, deviations):
    return np.mean([np.abs(e) < 1.96 * d for e, d in zip(errors, deviations, strict=True)])


@pytest.mark.sweep(1)
@pytest.mark.parametrize("seeds", [[2], range(3)], ids=["one log", "three logs"])
def test_ripple_is_motion_and_no_noise(seeds):
    """Of it both halves of the rows tell the same, but for the stated deviations."""
    at, shares = np.arange(4001) / 1000, []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        truth = harmonics(rng, base=0.075)
        amplitude, rate, phase = 2e-4 * rng.uniform(0.5, 2, 7), 2 * np.pi * rng.uniform(1, 2, 7), rng.uniform(0, 6, 7)
        t = np.sort(at + rng.uniform(-5e-4, 5e-4, len(at)))
        q = np.round(truth(at) + amplitude * np.sin(rate * at[:, None] + phase), 7)
        even, odd = fit(t[::2], q[::2]), fit(t[1::2], q[1::2])
        s = np.linspace(1.2, 2.8, 200)
        first, second = (spline_rates(one.spline, s) for one in (even, odd))
        both = [np.hypot(a, b) for a, b in zip(even.deviations(s), odd.deviations(s), strict=True)]
        ripple = [amplitude * rate**k * np.sin(rate * s[:, None] + phase + k * np.pi / 2) for k in range(5)]
        off = [a - truth(s, k) for k, a in enumerate(first)]
        shares.append([
            covered([a - b for a, b in zip(first, second, strict=True)], both),
            covered([a - b for a, b in zip(off, ripple, strict=True)], even.deviations(s)),
            covered(off, even.deviations(s)),
        ])  # fmt: skip
    halves, truly, without = np.mean(shares, axis=0)
    assert 0.88 <= halves <= 0.99
    assert 0.88 <= truly <= 0.99
    assert without < 0.3


@pytest.mark.sweep(1)
@pytest.mark.parametrize("seed", range(3))
def test_stamps_of_neighbouring_rows_may_be_wrong_alike(seed):
    """As a controller's are, whose clock drifts for some rows."""
    at, rng = np.arange(4001) / 1000, np.random.default_rng(seed)
    truth = harmonics(rng, base=0.075)
    drift = np.convolve(rng.normal(size=len(at) + 9), np.ones(10) / 10, "valid")
    t = np.sort(at + rng.uniform(-2e-4, 2e-4, len(at)) + 5e-4 * drift)
    smooth = fit(t, np.round(truth(at), 7))
    s = inner_times(smooth)
    off = [rate - truth(s, k) for k, rate in enumerate(spline_rates(smooth.spline, s))]
    assert 0.88 <= covered(off, smooth.deviations(s)) <= 0.99


def test_deviations_are_those_of_an_ideal_low_pass_filter():
    _, smooth = fitted_log("noise 1e-4")
    t = inner_times(smooth)[100:-100]
    for k, deviation in enumerate(smooth.deviations(t, 3)):
        ideal = ideal_deviation(1e-4, 1e-3, smooth.bandwidth, k)
        assert np.sqrt((deviation**2).mean()) == pytest.approx(ideal, rel=0.25)


def test_covariances_hold_the_squared_deviations():
    _, smooth = fitted_log("stamps")
    t = np.array([[3.0, 4.0, 5.0], [5.5, 6.0, 7.0]])
    covariances = smooth.covariances(t, 3)
    assert covariances.shape == (2, 3, 7, 4, 4)
    assert np.allclose(np.sqrt(np.einsum("...kk->...k", covariances)), np.stack(smooth.deviations(t, 3), axis=-1))
    assert (np.linalg.eigvalsh(covariances / covariances[..., -1:, -1:]) > -1e-9).all()
    assert smooth.deviations(4.0, 0)[0].shape == (7,)


def test_samples_without_noise_are_interpolated():
    t = np.arange(1001) / 100
    truth = harmonics(np.random.default_rng(0))
    smooth = fit(t, truth(t))
    assert np.abs(smooth.spline(t) - truth(t)).max() < 1e-14
    assert {noise.kind for noise in smooth.noise} == {"rounding"}
    assert any("goes through all of them" in note for note in smooth.notes)
    middle = t[100:-100] + 0.005
    assert np.abs(smooth.spline(middle, nu=4) - truth(middle, 4)).max() < 1e-4


STEADY = {
    "in all digits": (np.zeros(3), 0.0),
    "white": (np.array([1e-5, 1e-6, 1e-4]), 0.0),
    "encoder": (np.zeros(3), 2 * np.pi / 2**17),
}


@pytest.mark.parametrize(("sigma", "step"), STEADY.values(), ids=STEADY)
@pytest.mark.parametrize("speeds", [(0.3, -0.2, 0.5), (0, 0, 0)], ids=["steady", "at rest"])
def test_joints_that_keep_their_speed_need_no_peak_of_q4d(sigma, step, speeds):
    t = np.arange(2001) / 1000
    q = 0.1 + t[:, None] * speeds + sigma * np.random.default_rng(0).normal(size=(2001, 3))
    smooth = fit(t, step * np.round(q / step) if step else q)
    assert smooth.shortfall(2) is None
    s = inner_times(smooth)
    off, deviations = np.abs(smooth.spline(s, nu=4)), smooth.deviations(s, 4)[4]
    assert (off <= 4 * deviations + 1e-2).all()
    assert {noise.kind for noise in smooth.noise} <= {"white", "rounding", "rest", "encoder step"}
    assert all(noise.step in (0, pytest.approx(step, rel=1e-6)) for noise in smooth.noise)


def test_a_bandwidth_smooths_exact_samples_too():
    t = np.arange(1001) / 100
    truth = harmonics(np.random.default_rng(0))
    ripple = 1e-3 * np.sin(2 * np.pi * 8 * t)[:, None]
    smooth = fit(t, truth(t) + ripple, bandwidth=2)
    assert smooth.bandwidth == pytest.approx(2, rel=0.05)
    s = inner_times(smooth)
    assert np.abs(smooth.spline(s) - truth(s)).max() < 2e-4
    assert "smoothed" in jounce.Motion.fit(t, truth(t), bandwidth=5).source


def test_joints_at_rest_are_constant_which_is_said_once():
    rng = np.random.default_rng(1)
    t = np.arange(3000) / 500
    q = harmonics(rng)(t) + 1e-5 * rng.normal(size=(3000, 7))
    q[:, 2] = 0.3 + 1e-5 * rng.normal(size=3000)
    q[:, 4] = -1.0
    smooth = fit(t, q, names=[f"j{k}" for k in range(7)])
    assert [note for note in smooth.notes if "rest" in note] == ["at rest but for noise, hence constant: j2, j4"]
    assert np.abs(smooth.spline(t, nu=1)[:, [2, 4]]).max() < 1e-12
    assert smooth.spline(1.0)[2] == pytest.approx(0.3, abs=1e-6)
    assert smooth.deviations(1.0)[0][2] == pytest.approx(1e-5, rel=0.1)


def test_a_robot_at_rest_is_constant():
    smooth = fit(np.arange(100) / 100, 1 + 1e-4 * np.random.default_rng(0).normal(size=(100, 2)))
    assert np.abs(smooth.spline(0.5, nu=1)).max() < 1e-12
    assert smooth.ends == (0.0, 0.99)


def test_one_joint_is_enough():
    measured = log("16 bits, uneven, 100 Hz")
    smooth = fit(measured.t, measured.q[:, 0])
    t = inner_times(smooth)
    assert np.abs(smooth.spline(t, nu=4)[:, 0] - measured.truth(t, 4)[:, 0]).max() < 0.05 * smooth.peaks[4, 0]


def test_a_bandwidth_is_kept_but_for_sudden_changes():
    measured = log("blend, 18 bits")
    rng = np.random.default_rng(0)
    ripple = 2e-4 * np.sin(2 * np.pi * 9 * measured.t + rng.uniform(0, 6, 7)[:, None]).T
    smooth = fit(measured.t, measured.q + ripple, bandwidth=1.5)
    assert smooth.bandwidth == pytest.approx(1.5, rel=0.05)
    breaks = smooth.spline.t[9:-9]
    assert np.diff(breaks[breaks < 0.6]).max() < 0.51 * np.diff(breaks[breaks > 2]).min()
    t = np.linspace(2, 9, 200)
    wrong = force_errors(spline_rates(smooth.spline, t), [measured.truth(t, k) for k in range(5)])
    assert (wrong < [1e-3, 5e-3, 1e-2]).all()


def test_a_long_log_is_compressed_and_gives_the_same(monkeypatch):
    monkeypatch.setattr(least_squares, "MIN_CELLS", 1024)
    monkeypatch.setattr(knots, "MIN_LONG_LOG", 20 * 1024)
    rng = np.random.default_rng(5)
    truth = harmonics(rng)
    t = np.arange(21_000) / 500
    q = truth(t)[:, :2] + 1e-5 * rng.normal(size=(len(t), 2))  # what is long are its rows
    smooth = fit(t, q)
    s = inner_times(smooth)
    deviations = smooth.deviations(s)
    within = [np.abs(smooth.spline(s, nu=k) - truth(s, k)[:, :2]) < 1.96 * deviations[k] for k in range(5)]
    assert 0.90 <= np.mean(within) <= 0.99
    direct = make_lsq_spline(t, q, smooth.spline.t, 9)
    assert np.abs(direct.c - smooth.spline.c).max() < 1e-9


def test_a_single_wild_row_counts_less():
    measured, smooth = fitted_log("noise 1e-4")
    wild = measured.q.copy()
    wild[4000] += 0.5
    again = fit(measured.t, wild)
    assert any("1 rows lie far from their neighbours" in note for note in again.notes)
    t = inner_times(smooth)
    assert (np.abs(again.spline(t, nu=2) - measured.truth(t, 2)) < 8 * smooth.deviations(t)[2]).all()


def test_samples_that_do_not_carry_a_rate_say_why_and_what_would_help():
    rng = np.random.default_rng(2)
    t = np.arange(120) / 20
    smooth = fit(t, 0.3 * np.sin(4 * np.pi * t)[:, None] + 0.1 * rng.normal(size=(120, 1)))
    assert smooth.highest < 4
    text = smooth.shortfall(2)
    assert text.startswith("the samples do not carry Q2d: the standard deviation of q")
    assert all(word in text for word in ("white", "at 20 Hz", "bits more", "a rate of", "bandwidth="))
    assert "\n" not in text


HARMONIC = np.sin(np.arange(1000)[:, None] / 50)
SECONDS = np.arange(1000) / 100


def test_positions_that_no_joint_has_are_smoothed_without_overflow():
    found = fit(SECONDS, 0.9e30 * HARMONIC / np.abs(HARMONIC).max())
    assert np.isfinite(found.spline(SECONDS, nu=4)).all()


@pytest.mark.parametrize("hole", [0.5, 0.8, 1.5, 1e9])
def test_hole_in_the_only_interval_is_as_long_as_all_else_at_most(hole):
    """Of few samples and a slow motion; 1e9 s are a wrong stamp, and even times in them would fill the memory."""
    t = 0.02 * np.arange(51.0)
    t[25:] += hole
    q = 0.1 * t[:, None] / t[-1] + 1e-3 * np.random.default_rng(0).normal(size=(51, 1))
    if hole < 1:
        assert np.isfinite(fit(t, q).spline(t, nu=1)).all()
        return
    refusal(lambda: fit(t, q), "from t = 0.48 to … s… split the log there")


def with_entry(array, index, value):
    array = array.copy()
    array[index] = value
    return array


@pytest.mark.parametrize(("t", "q", "options", "message"), [
    (SECONDS, with_entry(HARMONIC, (7, 0), np.nan), {"names": ["elbow"]}, "elbow is nan at t = 0.07 s"),
    (SECONDS, with_entry(HARMONIC, (7, 0), 1.1e30), {"names": ["elbow"]},
     "elbow is 1.1e+30 at t = 0.07 s; expected numbers up to 1e+30"),
    (with_entry(SECONDS, 7, np.nan), HARMONIC, {}, "the time of sample 7 is not a number"),
    (with_entry(SECONDS, 7, 0.01), HARMONIC, {}, "time goes from 0.06 to 0.01 s at sample 7"),
    (with_entry(SECONDS, 7, 0.06), HARMONIC, {}, "write the time with more digits"),
    (SECONDS[: least_squares.MIN_FIT_SAMPLES - 1], HARMONIC[: least_squares.MIN_FIT_SAMPLES - 1], {},
     f"{least_squares.MIN_FIT_SAMPLES - 1} samples; smoothing needs at least {least_squares.MIN_FIT_SAMPLES}"),
    (SECONDS, HARMONIC.astype(str), {}, "expected an array of numbers"),
    (SECONDS[:-1], HARMONIC, {}, "expected (N,) and (N, n)"),
    (SECONDS, HARMONIC, {"names": ["a", "b"]}, "2 names for 1 columns"),
    (SECONDS, HARMONIC, {"bandwidth": -1}, "expected a frequency in Hz above 0"),
    (SECONDS, np.round(HARMONIC, 4), {"bandwidth": 1000}, "these samples carry at most"),
])  # fmt: skip
def test_what_cannot_be_smoothed_is_refused_in_one_line(t, q, options, message):
    refusal(lambda: fit(t, q, **options), message)


@pytest.mark.parametrize("count", [least_squares.MIN_FIT_SAMPLES, 30, 33])
def test_a_few_noisy_samples_are_smoothed(count):
    """Below 33 they were divided by zero intervals."""
    t = np.arange(count) / 10
    smooth = fit(t, np.sin(t) + 0.01 * np.random.default_rng(0).normal(size=count))
    assert np.abs(smooth.spline(t)[:, 0] - np.sin(t)).max() < 0.03


@pytest.mark.parametrize("noise", [0, 1e-3])
def test_times_that_determine_no_spline_are_the_cause_that_is_named(noise):
    t = np.geomspace(1e-12, 1, 26)
    q = np.sin(6 * t) + noise * np.random.default_rng(0).normal(size=26)
    message = refusal(lambda: fit(t, q))
    assert "samples that are 2.02e-12 to 0.669 s apart, the latter from t = 0.331" in message
    assert "more of them" not in message


def test_a_hole_that_the_motion_cannot_be_continued_over_is_refused():
    measured = log("noise 1e-4")
    kept = (measured.t < 3) | (measured.t > 5)
    with expect_refusal(re.compile(r"no samples from t = 2\.999 to 5\.001 s: 2 s, .* continued over 0\.\d+ s")):
        fit(measured.t[kept], measured.q[kept])


@pytest.mark.sweep(2)
@pytest.mark.parametrize("seed", range(12))
def test_bandwidths_suit_logs_of_any_duration_and_jitter(seed):
    """Corrected rows may bear fewer breaks than those as they are stamped, as that of seed 6."""
    rng = np.random.default_rng(seed)
    truth, rate, start = harmonics(rng), rng.choice([100, 250, 500, 1000]), rng.choice([0, 3600, 1e5])
    at = np.arange(0, rng.uniform(2, 5), 1 / rate)
    t = np.sort(at + rng.uniform(-0.5, 0.5, len(at)) / rate)
    q = np.round(truth(at), 6)
    stale = 1 + np.flatnonzero(rng.random(len(t) - 1) < 0.06)
    q[stale] = q[stale - 1]
    smooth = fit(t + start, q, bandwidth=rng.uniform(0.08, 0.14) * rate)
    s = inner_times(smooth, 50)
    off = [rate - truth(s - start, k) for k, rate in enumerate(spline_rates(smooth.spline, s))]
    assert smooth.stamps
    assert covered(off, smooth.deviations(s)) > 0.8


def reach(t, start, seconds, order):
    """A derivative of a C^5 step from 0 to 1 in some seconds."""
    step = BPoly.from_derivatives([0, 1], [[0, 0, 0, 0, 0, 0], [1, 0, 0, 0, 0, 0]])
    x = (t - start) / seconds
    return np.where((x < 0) | (x > 1), (order == 0) * (x >= 1), step(x.clip(0, 1), nu=order)) / seconds**order


def fast_reach(seed, joints, rate=50, seconds=0.15):
    """Slow harmonics with a reach of 0.3 rad, and its truth."""
    rng = np.random.default_rng(seed)
    start, size = rng.uniform(3, 5), rng.uniform(0.2, 0.3, joints) * rng.choice([-1, 1], joints)
    slow = harmonics(rng, base=0.02, amplitude=0.3)
    t = np.arange(0, rng.uniform(7, 9), 1 / rate)

    def truth(t, k=0):
        return slow(t, k)[..., :joints] + size * reach(t, start, seconds, k)[..., None]

    return t, encoder(truth(t) + 1e-5 * rng.normal(size=(len(t), joints)), 17), truth, (start - 0.1, start + 0.25)


@pytest.mark.sweep(3)
@pytest.mark.parametrize("joints", [1, 7])
@pytest.mark.parametrize("seed", range(4))
def test_a_fast_move_in_a_slow_log_is_no_outlier_or_clock_error(seed, joints):
    """Seven rows hold it: the fit is off it, and its deviations hold that; errors were up to 8 of them."""
    t, q, truth, around = fast_reach(seed, joints)
    smooth = fit(t, q)
    assert not any("count less" in note or "stamps" in note for note in smooth.notes)
    assert any("does not follow the samples" in note for note in smooth.notes)
    s = np.linspace(*around, 200)
    off = [(smooth.spline(s, nu=k) - truth(s, k)) / d for k, d in enumerate(smooth.deviations(s))]
    assert (np.sqrt([(x**2).mean() for x in off]) < [2, 2, 3, 3.5, 4.5]).all()


def test_wild_rows_alone_or_in_pairs_count_less():
    measured = log("noise 1e-4")
    wild = measured.q.copy()
    wild[[2000, 4000, 4001, 6000]] += 0.003
    smooth = fit(measured.t, wild)
    assert len(smooth.rows) == len(wild) - 1  # the one far from its neighbours on either side
    assert any("3 rows lie far from the others and count less" in note for note in smooth.notes)
    t = inner_times(smooth)
    assert (np.abs(smooth.spline(t) - measured.truth(t)) < 5 * smooth.deviations(t)[0]).mean() > 0.97
