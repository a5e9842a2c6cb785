"""Motions from tables: samples get their rates from a spline, rates are taken as they are, by name in any order."""

from pathlib import Path

import numpy as np
import pytest

import jounce
from jounce import JounceWarning
from jounce.motion.spline import Smoothing, Spline
from support.files import BODY, LINKS, joint, link, robot_file
from support.motion_tables import from_table
from support.refusals import expect_refusal, refusal
from support.robots import relative_error

PANDA = Path(__file__).parents[2] / "examples" / "panda.urdf"
PLANAR = jounce.load("planar2r").mechanism
RATES = ("q", "qd", "q2d", "q3d", "q4d", "q5d", "q6d", "q7d")
SAMPLES = {"t": np.arange(9) / 4, "joint1": np.sin(np.arange(9.0)), "joint2": np.cos(np.arange(9.0))}


def full(highest, rows=3):
    """A table with all rates up to `highest`, of as many rows as asked."""
    names = [f"{joint}.{rate}" for joint in ("joint1", "joint2") for rate in RATES[: highest + 1]]
    numbers = np.random.default_rng(1).normal(size=(len(names), rows))
    return {"t": np.arange(float(rows)), **dict(zip(names, numbers, strict=True))}


@pytest.mark.parametrize("highest", range(2, 8))
def test_spline_reproduces_a_polynomial_of_its_degree(highest):
    rng = np.random.default_rng(highest)
    t = np.cumsum(rng.uniform(0.1, 0.4, 14))
    curves = [np.polynomial.Polynomial(rng.normal(size=8)) for _ in range(2)]
    columns = {"joint2": curves[1](t), "t": t, "joint1": curves[0](t)}
    motion = from_table(columns, PLANAR, highest, "m.csv", Spline())
    assert np.array_equal(motion.times, t)
    assert np.array_equal(motion.samples[1], np.stack([columns["joint1"], columns["joint2"]], axis=1))
    for k, rate in enumerate(motion(t, highest)):
        expected = np.stack([(curve.deriv(k) if k else curve)(t) for curve in curves], axis=1)
        assert np.abs(rate - expected).max() < 1e-6 * np.abs(expected).max(), k
    assert "degree 7" in motion.source


def test_all_rates_are_used_as_they_are():
    columns = full(4)
    shuffled = dict(sorted(columns.items(), reverse=True))
    for highest in (2, 3, 4):  # rates beyond those needed do no harm
        motion = from_table(shuffled, PLANAR, highest, "m.csv")
        for k, rate in enumerate(motion(motion.times, highest)):
            expected = np.stack([columns[f"joint1.{RATES[k]}"], columns[f"joint2.{RATES[k]}"]], axis=1)
            assert np.array_equal(rate, expected)
        assert "table" in motion.source


def without(columns, *names):
    return {name: column for name, column in columns.items() if name not in names}


def samples_at(*t):
    return {name: column[: len(t)] for name, column in SAMPLES.items()} | {"t": np.array(t)}


BAD_MOTIONS = {
    "no t": (without(SAMPLES, "t"), 4, ["'t'", "joint1, joint2"]),
    "line break in a name": ({"a\nb": np.zeros(3)}, 4, ["'t'"]),
    "joint missing": (without(SAMPLES, "joint2"), 4, ["missing 'joint2'", "t and joint1, joint2"]),
    "all that is wrong": ({**without(SAMPLES, "t", "joint2"), "jont2": np.zeros(9), "body": np.zeros(9)}, 4,
        ["missing 't', 'joint2'; unknown 'jont2' (did you mean 'joint2'?), 'body'; expected t and joint1, joint2"]),
    "only t": ({"t": SAMPLES["t"]}, 4, ["missing 'joint1', 'joint2'"]),
    "a misspelt joint": ({**without(SAMPLES, "joint1"), "jont1": np.zeros(3)}, 4,
        ["missing 'joint1'; unknown 'jont1' (did you mean 'joint1'?); expected t and joint1, joint2;",
         "try: rename={'jont1': 'joint1'}"]),
    "no hint at a joint that is there": ({**without(SAMPLES, "joint1"), "joint3": np.zeros(3)}, 4,
        ["unknown 'joint3' (did you mean 'joint1'?)"]),
    "unknown rate": ({**full(4), "joint1.qzzd": np.zeros(3)}, 4, ["'joint1.qzzd'"]),
    "rate missing": (without(full(4), "joint2.q3d"), 4, ["missing 'joint2.q3d'"]),
    "order beyond the rates": (full(4), 5, ["missing 'joint1.q5d', 'joint2.q5d'"]),
    "samples among rates": ({**without(full(4), "joint1.q"), "joint1": np.zeros(3)}, 4,
        ["leave out 'joint1', both samples and"]),
    "seven samples": (samples_at(*range(7)), 4, ["7 samples", "at least 8"]),
    "beyond the spline": (SAMPLES, 8, ["q8d", "degree 7"]),
    "samples whose rates overflow": ({**SAMPLES, "joint1": 1e308 * (-1.0) ** np.arange(9)}, 4,
        ["of the spline of degree 7", "overflows"]),
    "t too close for a spline": ({**SAMPLES, "t": np.arange(9) * 1e-320}, 4, ["t"]),
}  # fmt: skip


@pytest.mark.parametrize(("columns", "highest", "words"), BAD_MOTIONS.values(), ids=BAD_MOTIONS)
def test_refuses_motions(columns, highest, words):
    message = refusal(lambda: from_table(columns, PLANAR, highest, "m.csv", Spline()), "m.csv: ", *words)
    for name in PLANAR.coordinates:
        assert f"unknown '{name}'" not in message


def test_eight_samples_are_enough_for_a_spline():
    assert from_table(samples_at(*range(8)), PLANAR, 4, "m.csv", Spline())(3.5)[4].shape == (2,)


@pytest.mark.parametrize("rate", ["", ".q"])
def test_joints_that_follow_others_are_left_alone(rate):
    panda = jounce.load(PANDA).mechanism
    columns = {name + rate: -0.5 + 0.01 * np.sin(np.arange(9.0)) for name in panda.joints} | {"t": np.arange(9.0)}
    columns[f"panda_finger_joint1{rate}"] = columns[f"panda_joint6{rate}"] = np.full(9, 0.02)
    motion = from_table(columns, panda, 0, "m.csv", Smoothing() if rate else Spline())
    assert motion.joint_names == panda.coordinates
    assert motion.notes == (f"other columns, ignored: panda_finger_joint2{rate}",)
    refusal(
        lambda: from_table(without(columns, f"panda_finger_joint1{rate}"), panda, 0, "m.csv"),
        f"m.csv: missing 'panda_finger_joint1{rate}'; expected", "hold panda_finger_joint1 by lock= of jounce.load",
    )  # fmt: skip


def test_a_joint_whose_name_starts_like_that_of_a_follower(tmp_path):
    """`grip` follows `grip.lead`: the dot belongs to the name."""
    items = (link("tip", BODY), joint("grip", "arm", "tip", inner='<mimic joint="grip.lead"/>'))
    robot = jounce.load(robot_file(tmp_path, *LINKS, joint("grip.lead", "base", "arm"), *items))
    t = np.sqrt(np.arange(9.0))
    assert from_table({"t": t, "grip.lead": t}, robot.mechanism, 4, "m.csv", Spline()).joint_names == ("grip.lead",)
    assert from_table({"t": t, "grip.lead.q": t}, robot.mechanism, 0, "m.csv").joint_names == ("grip.lead",)
    for name in ("grip", "grip.q"):
        found = from_table({"t": t, "grip.lead": t, name: t}, robot.mechanism, 0, "m.csv", Spline())
        assert found.notes == (f"other columns, ignored: {name}",)


def rounded(step, decimals, start=0.0):
    t = np.arange(0, 1 + step / 2, step)
    q = np.cos(3 * t) if decimals is None else np.round(np.cos(3 * t), decimals)
    return {"t": t + start, "joint1": q, "joint2": np.full_like(t, 0.3)}


@pytest.mark.parametrize(
    "table",
    [rounded(0.01, 6), rounded(0.1, 2), rounded(1e-4, None), rounded(0.01, None, 1.7e9)],
    ids=["six decimals", "two decimals", "too dense", "seconds since 1970"],
)
def test_warns_where_rounding_of_samples_drowns_their_rates(table):
    with pytest.warns(jounce.JounceWarning, match=r"m\.csv: rounding of the samples makes up \d+% of the largest q4d"):
        from_table(table, PLANAR, 4, "m.csv", Spline())


def test_warns_of_rounding_in_samples_too_dense_by_default():
    with pytest.warns(jounce.JounceWarning, match=r"m\.csv: rounding of the samples makes up \d+% of the largest q4d"):
        from_table(rounded(1e-4, None), PLANAR, 4, "m.csv")


@pytest.mark.parametrize("table", [rounded(0.01, None), rounded(0.05, 12)])
def test_says_nothing_of_samples_with_enough_digits(table):
    from_table(table, PLANAR, 4, "m.csv", Spline())


def test_a_fit_evens_out_the_noise_of_measured_samples():
    """Rates through noisy samples are noise; those of a fit are near the truth, and its residual is the noise."""
    t, noise = np.linspace(0, 2, 1001), 1e-5
    truth = [3.0**k * np.cos(3 * t + k * np.pi / 2) for k in range(5)]
    measured = truth[0] + np.random.default_rng(1).uniform(-noise, noise, t.shape)
    columns = {"t": t, "joint1": measured, "joint2": measured}
    with pytest.warns(JounceWarning, match="rounding"):
        rough = from_table({name: np.round(x, 5) for name, x in columns.items()}, PLANAR, 4, "m.csv", Spline())
    fit = from_table(columns, PLANAR, 4, "m.csv", Spline(7, 6))
    for k, exact in enumerate(truth):
        assert relative_error(fit(t)[k][100:-100, 0], exact[100:-100]) < 10 ** (k - 4.8)  # its ends are worse
    assert relative_error(rough(t)[4][:, 0], truth[4]) > 1e3
    assert rough.residual is None
    assert noise / 2 < fit.residual.min() <= fit.residual.max() < 2 * noise
    assert fit.residual[0] == np.abs(fit(t, 0)[0][:, 0] - measured).max()
    assert "degree 7 (C^6), fitted by least squares in 6 intervals" in fit.source


@pytest.mark.parametrize("intervals", [1, 3, 13])
@pytest.mark.parametrize("degree", [5, 7])
def test_a_fit_to_a_polynomial_of_its_degree_is_that_polynomial(degree, intervals):
    """On uneven samples, and with the most intervals that they bear."""
    t = np.sort(np.random.default_rng(2).uniform(0, 1, 13 + degree))
    power = np.polynomial.Polynomial(np.random.default_rng(3).normal(size=degree + 1))
    motion = from_table({"t": t, "joint1": power(t), "joint2": power(t)}, PLANAR, 3, "m.csv", Spline(degree, intervals))
    for k, rate in enumerate(motion(t, 3)):
        np.testing.assert_allclose(rate[:, 1], (power.deriv(k) if k else power)(t), rtol=1e-4, atol=1e-6 * 100**k)


@pytest.mark.parametrize("way", ["through", "fit", "piecewise"])
def test_times_in_milliseconds_are_warned_of(way):
    s = np.arange(200) * 0.01
    q = np.sin(s)[:, None] + [0.1, 0.2]
    ways = {
        "through": jounce.Motion.through,
        "fit": lambda t, q: jounce.Motion.fit(t, q, degree=7, intervals=20),
        "piecewise": lambda t, q: jounce.Motion.piecewise(
            t, np.stack([np.diff(q, axis=0) / np.diff(t)[:, None], q[:-1]])
        ),
    }
    with pytest.warns(JounceWarning, match="^the motion: rows are 10 s apart, .* t looks like ms; expected seconds$"):
        ways[way](1e3 * s, q)
    ways[way](s, q)


@pytest.mark.parametrize("intervals", [0, -1, 6])
def test_intervals_that_samples_do_not_bear(intervals):
    t = np.arange(12.0)
    columns = {"t": t, "joint1": t, "joint2": t}
    with expect_refusal(f"m.csv: {intervals} intervals for 12 samples; expected 1 to 5"):
        from_table(columns, PLANAR, 3, "m.csv", Spline(7, intervals))
