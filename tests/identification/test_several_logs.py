"""Several logs as one fit: their order does not matter, what they differ by makes deviations large, some only test."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

import jounce
from identification.conftest import table_values
from jounce.identification.averaging import CellAverages
from jounce.identification.measurements import check_logs
from jounce.identification.regression import fit_forces
from support.refusals import refusal

ROBOT = jounce.load("planar2r")
TRUE = ROBOT.with_inertial_parameters(1.2 * ROBOT.inertial_parameters)
NOISE = 0.05
RATES, SECONDS = (250, 100, 400), (6.0, 9.0, 4.0)


def arm_log(k, factor=1.0, smoothed=True):
    """A motion and the torques of the true arm, of a rate and a length of their own."""
    rng = np.random.default_rng(k)
    exact = jounce.Motion.fourier([0.3, 0.5], *rng.uniform(-0.4, 0.4, (2, 3, 2)), 1.5 + 0.3 * k, SECONDS[k])
    t = np.arange(0, SECONDS[k], 1 / RATES[k])
    q, qd, q2d = exact(t, 2)
    Q = factor * TRUE.inverse_dynamics(q, qd, q2d) + 0.3 * qd + NOISE * rng.normal(size=q.shape)
    motion = jounce.Motion.fit(t, q + 1e-5 * rng.normal(size=q.shape)) if smoothed else exact
    return replace(motion, torques=(t, Q))


LOGS = [arm_log(k) for k in range(3)]


def identify(logs, **options):
    return ROBOT.identify(logs, drives=("damping",), prior=10.0, **options)


def test_the_order_of_logs_does_not_matter():
    """Spectra and sums never run from one log into the next; each has its rate, its band and its cells."""
    one, other = identify(LOGS), identify(LOGS[::-1])
    np.testing.assert_allclose(table_values(one), table_values(other), rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(one.covariance, other.covariance, rtol=1e-4, atol=1e-12)
    assert [log.band for log in one.logs] == [log.band for log in other.logs][::-1]
    assert one.samples == sum(len(log.torques[0]) for log in LOGS)
    expected = [*TRUE.base_parameters().values, 0.3, 0.3]
    assert (np.abs(table_values(one) - expected) < 4 * np.sqrt(np.diag(one.covariance))).all()


def test_a_log_in_a_list_is_a_log():
    alone, listed = identify(LOGS[0]), identify(LOGS[:1])
    np.testing.assert_array_equal(table_values(alone), table_values(listed))
    assert [row.log for row in alone.residuals] == ["", ""]
    assert [row.log for row in listed.residuals] == ["motion[0]"] * 2


def test_a_log_tests_what_others_say():
    named = dict(zip("abc", LOGS, strict=True))
    found, without = identify(named, test="b"), identify([LOGS[0], LOGS[2]])
    np.testing.assert_array_equal(table_values(found), table_values(without))
    assert [(row.log, row.part) for row in found.residuals[::2]] == [("a", "used"), ("b", "rest"), ("c", "used")]
    _, b, c = found.logs
    assert (b.span, b.samples, b.cells) == (None, 0, 0)
    np.testing.assert_array_equal(found.t[b.rows], LOGS[1].torques[0])
    assert np.median(np.abs(found.predicted[c.rows] - LOGS[2].torques[1])) < NOISE
    assert "b: test" in str(found)
    assert "c: residual" in str(found)
    left = found.residuals[2]
    assert left.identified_samples == pytest.approx(NOISE, rel=0.2)
    assert left.identified < 0.05 * left.model


def test_logs_that_differ_make_deviations_large():
    """Torque constants that are off by 5 % in one log: with variances of its own, each log alone would be believed."""
    other = [LOGS[0], arm_log(1, 1.05)]
    difference = np.abs(table_values(identify(other[1])) - table_values(identify(other[0])))
    with pytest.warns(jounce.JounceWarning, match=r"differ by more than their noise: .* of motion\[0\] \("):
        found = identify(other)
    large = difference > 0.05
    assert (np.sqrt(np.diag(found.covariance)) > 0.3 * difference)[large].all()
    assert np.count_nonzero(large) == 4
    assert not [note for note in identify(LOGS).notes if "differ by" in note]


@pytest.mark.parametrize("known", [False, True])
def test_samples_count_by_the_time_between_them(known):
    """Errors that matter are slow, whatever the rate; deviations that are known are those of samples."""
    given = {"forces": None, "t": None, "weights": None, "deviations": 0.5 if known else None}
    weights = [log.measurements.weights.mean() for log in check_logs(ROBOT.mechanism, LOGS, given, None, ())]
    assert weights == pytest.approx([4.0] * 3 if known else RATES[0] / np.array(RATES))


@pytest.mark.parametrize(("rho", "drift"), [(0.0, 0.0), (0.95, 0.0), (0.0, 0.3)])
def test_deviations_hold_for_several_logs(rho, drift):
    """Root mean squares of errors over deviations, of noise of two logs or of logs whose parameters differ."""
    rng, over, sizes = np.random.default_rng(5), [], (150, 90, 240, 120)
    log, ends = np.repeat(np.arange(len(sizes)), sizes), np.cumsum([0, *sizes])
    logs = list(map(slice, ends, ends[1:]))
    s = np.concatenate([np.arange(size) / size + k for k, size in enumerate(sizes)])
    Y = np.stack([np.sin(6 * np.pi * s), np.cos(14 * np.pi * s), np.sin(31 * s)], axis=-1)[:, None]
    one = np.ones((len(s), 1))
    for _ in range(60):
        draws = [rng.normal(size=(size + 300, 1)) for size in sizes]
        noise = np.concatenate([lfilter([np.sqrt(1 - rho**2)], [1, -rho], x, axis=0)[300:] for x in draws])
        moved = drift * rng.normal(size=(len(sizes), 3))
        off = noise + (Y @ moved[log][..., None])[..., 0]
        found = fit_forces(CellAverages(Y, off, 0 * one, one, 0 * one), np.arange(3), None, known=False, logs=logs)
        over.append(found.x / np.sqrt(np.diag(found.covariance)))
    assert 0.6 < np.sqrt(np.mean(np.square(over))) < (1.7 if drift else 1.3)


def test_exact_motions_join_smoothed_ones():
    found = identify([arm_log(0, smoothed=False), LOGS[1]])
    expected = [*TRUE.base_parameters().values, 0.3, 0.3]
    assert (np.abs(table_values(found) - expected) < 4 * np.sqrt(np.diag(found.covariance))).all()


def test_a_log_that_comes_twice_is_reported():
    with pytest.warns(jounce.JounceWarning, match=r"motion\[0\], motion\[2\] hold the same forces"):
        found = identify([LOGS[0], LOGS[1], LOGS[0]])
    assert found.notes[0].startswith("motion[0], motion[2] hold the same forces")
    assert not [note for note in identify(LOGS).notes if "same forces" in note]


def test_warnings_name_their_log():
    t, Q = LOGS[1].torques
    with pytest.warns(jounce.JounceWarning):
        found = identify([LOGS[0], replace(LOGS[1], torques=(t, -Q))])
    assert found.notes[0].startswith("motion[1]: forces of all joints seem to have the wrong sign")


OTHER = jounce.Motion.fit(np.linspace(0, 1, 200), np.sin(np.linspace(0, 3, 200))[:, None], joint_names=["elbow"])


@pytest.mark.parametrize(("logs", "given", "words"), [
    ([], {}, ("motion is []", "expected a log")),
    (LOGS[:2], {"test": 5}, ("unknown log of test 5", "0, 1")),
    ({"a": LOGS[0], "b": LOGS[1]}, {"test": ["c"]}, ("unknown log of test 'c'", "a, b")),
    (LOGS[:2], {"test": (0, 1)}, ("names every log",)),
    (LOGS[0], {"test": 0}, ("names every log",)),
    (LOGS[:2], {"test": True}, ("unknown log of test True", "0, 1")),
    (LOGS[:2], {"deviations": [0.1, None]}, ("deviations has None for a log",)),
    (LOGS[:2], {"forces": [None]}, ("forces has 1 entries", "expected 2")),
    ({"a": LOGS[0], "b": replace(LOGS[1], torques=None)}, {}, ("b: the motion has no measured forces",)),
    ({"a": LOGS[0], "b": OTHER}, {}, ("b: the motion", "elbow")),
    ({"a": LOGS[0], "b": LOGS[2]}, {"span": (5, 6)}, ("b: span is (5, 6)", "from 0 to 3.99")),
    ({"a": LOGS[0], "b": LOGS[1]}, {"band": 100.0}, ("b: band is 100.0", "50 Hz")),
])  # fmt: skip
def test_refuses(logs, given, words):
    refusal(lambda: identify(logs, **given), *words)


def cut(log, *pieces):
    t, Q = log.torques
    return [replace(log, torques=(t[piece], Q[piece])) for piece in pieces]


def test_logs_too_short_alone_are_enough_together():
    """Forces are counted over all logs, and so are the cells that parameters need."""
    three, two = (arm_log(0, smoothed=False), arm_log(1, smoothed=False)), {"drives": False, "band": None}
    few = [piece for log in three for piece in cut(log, slice(0, 400, 200))]
    refusal(lambda: ROBOT.identify(few[0], **two), "4 measured forces for 6 parameters")
    found = ROBOT.identify(few, **two)
    assert (found.rank, found.samples) == (6, 4)
    refusal(lambda: ROBOT.identify(few), "8 measured forces for 12 parameters")
    whole = identify(LOGS[0], band=0.6)
    thirds = identify(cut(LOGS[0], slice(500), slice(500, 1000), slice(1000, 1500)), band=0.6)
    assert abs(thirds.cells - whole.cells) <= 3
