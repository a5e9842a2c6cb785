"""Steps of encoders in numbers that are written with some digits, whose last one is not of the same unit everywhere."""

import numpy as np
import pytest

from jounce.motion import noise
from jounce.motion.sample_curves import fit

STEP = 2 * np.pi / 201_326  # rad: 31.2 microrad, no multiple of a decimal unit


def with_digits(values, digits):
    """As a file has them that writes so many digits, whatever the size."""
    return np.array([float(f"{x:.{digits}g}") for x in values.ravel()]).reshape(values.shape)


def sweep(first, last):
    """Readings of an encoder that goes from one angle to another, (900,)."""
    return STEP * np.round(np.linspace(first, last, 900) ** 3 / STEP)


@pytest.mark.parametrize("write", [lambda q: with_digits(q, 9), lambda q: q.round(9), lambda q: q], ids="gfr")
@pytest.mark.parametrize("ends", [(0.02, 0.9), (0.3, 1.3), (-0.3, 0.5), (1.2, 2.4)])
def test_step_of_an_encoder_is_found_however_it_is_written(write, ends):
    """Numbers below 1, below 0.1 and below 0.001 have one, two and three decimals more than those above."""
    step, kind = noise.find_step(write(sweep(*ends)))
    assert (kind, step) == ("encoder step", pytest.approx(STEP, rel=1e-5))


@pytest.mark.parametrize(("digits", "unit"), [(4, 1e-3), (6, 1e-5), (9, 1e-8)])
def test_unit_of_written_digits_is_that_of_the_largest_numbers(digits, unit):
    q = np.sin(np.linspace(0, 3, 900)) * 1.9
    assert noise.find_step(with_digits(q, digits)) == (unit, "written digits")


@pytest.mark.parametrize("scale", [1e-5, 1.0, 50.0])
def test_doubles_have_no_step(scale):
    """Nor do those that have a few round numbers among them."""
    q = scale * np.sin(np.linspace(0, 3, 900)) + scale / 3
    q[:4] = (scale / 3).__round__(3)
    assert noise.find_step(q)[0] == 0


def test_round_numbers_of_a_smaller_decade_are_no_step_of_doubles():
    q = np.concatenate([np.arange(10, 60) / 1000, 1 + np.random.default_rng(0).random(50)])
    assert noise.find_step(q)[0] == 0


@pytest.mark.parametrize("digits", [9, 7])
def test_log_of_a_robot_that_pauses_is_read_whole(digits):
    """Six joints move from rest to rest, one stays: their rows repeat where they are slow, and are no older ones."""
    t = np.arange(5000) / 1000
    random = np.random.default_rng(0)
    q = np.tile([0.12, 1.1, -0.95, 0.05, 1.5, -0.3], (len(t), 1))
    for start, stop in ((0.5, 2.0), (2.5, 4.5)):
        x = np.clip((t - start) / (stop - start), 0, 1)[:, None]
        q += random.normal(size=6) * [0.3, 0.3, 0.3, 0.3, 0, 0.3] * x**3 * (10 - 15 * x + 6 * x * x)
    found = fit(t, with_digits(STEP * np.round(q / STEP), digits))
    assert [noise.kind for noise in found.noise] == ["encoder step"] * 4 + ["rest", "encoder step"]
    assert found.notes == ("at rest but for noise, hence constant: column 5",)
    assert len(found.rows) == len(t)
    assert np.abs(found.spline(t[300:-300]) - q[300:-300]).max() < 3 * STEP
