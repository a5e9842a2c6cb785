"""Jumps of velocity, acceleration and jerk are told, by number; smooth motions raise no alarm."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline, make_interp_spline

import jounce
from jounce.motion import smoothness
from support.motion_tables import from_table

PLANAR = jounce.load("planar2r").mechanism
KNOTS, HEIGHTS = np.linspace(0, 3, 8), np.array([0.12, -0.13, 0.64, 0.1, -0.53, 0.36, 1.3, 0.95])  # seven segments


def blend(t, coefficients):
    """Rest, a polynomial blend from 0 to 1 between 0.5 and 2.5, rest."""
    s = np.clip((t - 0.5) / 2, 0, 1)
    return np.polynomial.Polynomial(coefficients)(s)


JUMPY = {
    "linear": (
        lambda t: np.interp(t, KNOTS, HEIGHTS),
        "velocity jumps at 6 knots: qd is discontinuous there, Q undefined",
    ),
    "trapezoidal": (
        lambda t: np.where(t < 1, t**2 / 2, np.where(t < 2, t - 0.5, 1.5 + (t - 2) - (t - 2) ** 2 / 2)),
        "acceleration jumps at 2 knots: Q is discontinuous there, Qd undefined",
    ),
    "cubic": (CubicSpline(KNOTS, HEIGHTS), "jerk jumps at 4 knots: Qd is discontinuous there, Q2d undefined"),
    "quintic": (lambda t: blend(t, [0, 0, 0, 10, -15, 6]), "jerk jumps at 2 knots: Qd is discontinuous there"),
}
SMOOTH = {
    "cosine": lambda t: np.cos(3 * t) + 0.3 * np.sin(7 * t),
    "blend of degree nine": lambda t: blend(t, [0, 0, 0, 0, 0, 126, -420, 540, -315, 70]),
    "spline of degree five": make_interp_spline(KNOTS, HEIGHTS, k=5),
    "rest": lambda t: 0 * t + 0.5,
    "ramp": lambda t: 0.3 * t,
}


@pytest.mark.parametrize("count", [400, 1000, 3000])
@pytest.mark.parametrize(("path", "told"), JUMPY.values(), ids=JUMPY)
def test_tells_what_jumps_and_where_that_leaves_the_forces(path, told, count):
    t = np.linspace(0, 3, count)
    assert smoothness.describe_sample_jumps(t, np.stack([path(t), np.cos(t)], axis=1)).startswith(told)


@pytest.mark.parametrize("count", [60, 200, 1000, 3000])
@pytest.mark.parametrize("path", SMOOTH.values(), ids=SMOOTH)
def test_says_nothing_of_smooth_motions(path, count):
    t = np.linspace(0, 3, count)
    assert smoothness.describe_sample_jumps(t, path(t)[:, None]) is None


DIGITS = {"exact": lambda q: q, "six digits": lambda q: np.round(q, 6), "noise": lambda q: q + NOISE[: len(q)]}
NOISE = 1e-5 * np.random.default_rng(0).normal(size=(401, 2))


@pytest.mark.sweep(5)
@pytest.mark.parametrize("count", [41, 101, 401])
@pytest.mark.parametrize("written", DIGITS.values(), ids=DIGITS)
def test_a_kink_is_told_however_samples_are_smoothed(count, written):
    t = np.linspace(0, 1, count)
    q = np.stack([np.abs(t - 0.5), 0.3 * np.sin(2 * t)], axis=1)
    with pytest.warns(jounce.JounceWarning, match="velocity jumps at 1 knot"):
        jounce.Motion.fit(t, written(q), allow_noise=True)


def test_rates_of_a_table_are_judged_as_they_are():
    t = np.linspace(0, 3, 301)
    spline = CubicSpline(KNOTS, HEIGHTS)
    rates = [np.stack([spline(t, nu=k), np.cos(t + k * np.pi / 2)], axis=1) for k in range(4)]
    assert smoothness.describe_rate_jumps(rates).startswith("jerk jumps at 4 knots")
    assert smoothness.describe_rate_jumps(rates[:3]) is None
    names = ("q", "qd", "q2d", "q3d")
    columns = {f"joint{j + 1}.{name}": rates[k][:, j] for k, name in enumerate(names) for j in (0, 1)} | {"t": t}
    with pytest.warns(jounce.JounceWarning, match=r"m\.csv: jerk jumps at 4 knots"):
        from_table(columns, PLANAR, 3, "m.csv")


def test_a_table_of_samples_is_warned_of():
    t = np.linspace(0, 3, 300)
    with pytest.warns(jounce.JounceWarning, match=r"m\.csv: acceleration jumps at 2 knots"):
        from_table({"t": t, "joint1": JUMPY["trapezoidal"][0](t), "joint2": np.cos(t)}, PLANAR, 4, "m.csv")
