"""Measured samples are smoothed by default, by Python and by the commands, and refused where noise drowns Q2d."""

import json

import numpy as np
import pytest

import jounce
from jounce.io import tables
from support.commands import call
from support.refusals import refusal

PLANAR = jounce.load("planar2r")
T = np.arange(5000) / 1000
STEP = 2 * np.pi / 2**17
EXACT = [
    np.stack([3.0**k * np.cos(3 * T + k * np.pi / 2), 2.0**k * np.sin(2 * T + k * np.pi / 2)], 1) for k in range(5)
]
ENCODER = STEP * np.round(EXACT[0] / STEP)
LOG = {"t": T, "joint1": ENCODER[:, 0], "joint2": ENCODER[:, 1]}
RANDOM = np.random.default_rng(0).normal(0, 0.005, (2, 300))
NOISE = {"t": T[:300], "joint1": T[:300] + RANDOM[0], "joint2": T[:300] + RANDOM[1]}


def test_a_log_of_encoders_is_smoothed_by_default(tmp_path):
    inside = slice(1200, -1200)
    truth = PLANAR.inverse_dynamics(*EXACT)[2][inside]
    motion = jounce.load_motion(LOG, PLANAR)
    assert "smoothed" in motion.source
    along = PLANAR.forces_along(motion)
    assert np.abs(along.forces[2][inside] - truth).max() < 0.05 * np.abs(truth).max()
    assert 0 < along.deviations[2][inside].max() < 0.05 * np.abs(truth).max()
    tables.write(tmp_path / "log.npz", LOG)
    result = call("run", "planar2r", tmp_path / "log.npz", "-o", tmp_path / "out.npz", "--json")
    assert result.exit_code == 0, result.output
    assert "smoothed" in json.loads(result.stdout)["source"]
    assert np.array_equal(tables.read(tmp_path / "out.npz")["joint1.Q2d"], along.forces[2][:, 0])


def test_samples_too_noisy_for_the_highest_rate_are_refused(tmp_path):
    cures = ("a lower bandwidth= smooths them more", "allow_noise=True accepts them")
    refusal(lambda: jounce.load_motion(NOISE, PLANAR), "do not carry", *cures)
    assert any("do not carry" in note for note in jounce.load_motion(NOISE, PLANAR, allow_noise=True).notes)
    tables.write(tmp_path / "log.npz", NOISE)
    asked = ("run", "planar2r", tmp_path / "log.npz", "-o", tmp_path / "out.npz")
    refused = call(*asked)
    assert refused.exit_code == 2
    options = ("do not carry", "a lower --bandwidth HZ smooths them more", "--allow-noise accepts them")
    assert all(word in refused.stderr for word in options)
    assert len(refused.stderr.splitlines()) == 1
    assert call(*asked, "--allow-noise").exit_code == 0


RATES = {"t": T} | {
    f"joint{j + 1}.{rate}": EXACT[k][:, j] for j in (0, 1) for k, rate in enumerate(("q", "qd", "q2d", "q3d", "q4d"))
}
OPTIONS = {"degree": 7, "intervals": 5, "bandwidth": 2.0, "allow_noise": True}
NAMING = {"time": "t", "columns": "{joint}", "angles": "rad", "time_unit": "s"}
NO_EFFECT = {
    **{f"{name} of terms": ("paper", {name: value}, "exact") for name, value in (OPTIONS | NAMING).items()},
    **{f"{name} of rates": (RATES, {name: value}, "all rates are in the table") for name, value in OPTIONS.items()},
    "topic of terms": ("paper", {"topic": "x"}, "topic is for bags"),
    "topic of columns": (LOG, {"topic": "x"}, "topic is for ROS bags"),
}


@pytest.mark.parametrize(("source", "options", "reason"), NO_EFFECT.values(), ids=NO_EFFECT)
def test_an_option_without_effect_is_refused(source, options, reason):
    refusal(lambda: jounce.load_motion(source, PLANAR, **options), reason, *options, "leave it out")


@pytest.mark.parametrize(("size", "inside"), [(1e-3, False), (1e-9, True)])
def test_a_note_names_the_ends_of_a_log_that_are_unreliable(size, inside):
    t = np.arange(0, 4, 0.005)
    q = np.c_[1.2 * np.sin(1.5 * t), 0.9 * np.cos(2 * t)] + size * np.random.default_rng(1).normal(size=(len(t), 2))
    motion = jounce.Motion.fit(t, q)
    assert (motion.curve.fit.ends != (t[0], t[-1])) == inside
    assert any("trustworthy" in note for note in motion.notes) == inside


@pytest.mark.parametrize("smooth", [{"bandwidth": 2.0}, {"allow_noise": True}])
@pytest.mark.parametrize("by_hand", [{"degree": 7}, {"intervals": 5}])
def test_options_of_smoothing_and_of_splines_exclude_each_other(smooth, by_hand):
    """The message names those that came."""
    words = [f"{name} is for" for name in (*smooth, *by_hand)]
    refusal(lambda: jounce.load_motion(LOG, PLANAR, **smooth, **by_hand), *words, "leave one of them out")


def test_few_samples_name_the_option_that_takes_them():
    few = {name: column[:23] for name, column in LOG.items()}
    refusal(lambda: jounce.load_motion(few, PLANAR), "23 samples; smoothing needs at least 24; degree=7 takes")


def test_round_numbers_by_chance_are_no_step():
    """A cosine starts at 1, which is a multiple of many steps."""
    t = np.arange(0, 1.005, 0.01)
    motion = jounce.Motion.fit(t, np.round(np.cos(3 * t), 6)[:, None])
    assert motion.residual.max() < 2e-6


@pytest.mark.parametrize("count", range(24, 34))
def test_the_fewest_samples_are_smoothed_by_one_interval(count):
    """A wave of a sixth of a period, rounded to 1e-9: noise far below the motion."""
    t = 0.016 * np.arange(count)
    fitted = jounce.Motion.fit(t, np.c_[np.cos(2 * t), np.sin(3 * t)].round(9))
    np.testing.assert_allclose(fitted(t, 1)[1], np.c_[-2 * np.sin(2 * t), 3 * np.cos(3 * t)], atol=1e-5)
