"""Analytic motions: exact rates of every order, the paper's own motion, and YAML that is refused in one line."""

import json
from importlib.resources import files

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial import Polynomial

import jounce
from jounce.io import motions, tables
from jounce.motion.analytic import AnalyticCurve, Cosine, Terms
from jounce.motion.spline import Spline
from support.commands import call
from support.motion_tables import from_table
from support.refusals import expect_refusal, refusal
from support.robots import RATES, golden, relative_error

PLANAR = jounce.load("planar2r").mechanism
IIWA = jounce.load("iiwa14").mechanism
numbers = st.floats(-3, 3).map(lambda x: round(x, 3))


@given(st.lists(numbers, min_size=1, max_size=6), st.lists(st.tuples(numbers, numbers, numbers), max_size=3))
def test_rates_are_those_of_the_sum_of_its_terms(powers, waves):
    """Polynomials against NumPy's, cosines against the real part of the complex exponential."""
    t = np.linspace(-1, 2, 7)
    others = Terms((1.0, 2.0), (Cosine(0.5, 2.0, 0.1),))
    terms = Terms(tuple(powers), tuple(Cosine(*wave) for wave in waves))
    for k, rate in enumerate(AnalyticCurve((others, terms), -1.0, 2.0).rates(t, 7)):
        expected = (Polynomial(powers).deriv(k) if k else Polynomial(powers))(t) + 0 * t
        for amplitude, frequency, phase in waves:
            expected = expected + (amplitude * (1j * frequency) ** k * np.exp(1j * (frequency * t + phase))).real
        assert np.abs(rate[:, 1] - expected).max() <= 1e-12 * (1 + np.abs(expected).max())


def test_the_motion_of_the_paper_is_that_of_the_golden_data(tmp_path):
    """Rates of all orders at the times of the golden cases, and the whole way through the command."""
    cases = [case for case in golden("iiwa")[1] if "t" in case]
    assert len(cases) >= 5
    text = (files(motions.__name__) / "paper.yaml").read_text()
    for case in cases[1:]:
        path = tmp_path / "at.yaml"
        path.write_text(text.replace("stop: 5, count: 10000", f"stop: {case['t']!r}, count: 2"))
        motion = motions.read(path, IIWA, 6)
        for rate, name in zip(motion(motion.stop, 6), RATES, strict=True):
            assert relative_error(rate, case[name]) < 1e-14


def test_run_takes_the_motion_of_the_paper_by_name(tmp_path):
    out = tmp_path / "forces.npz"
    result = call("run", "iiwa14", "paper", "-o", out, "--json")
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["states"] == 10_000
    columns, motion = tables.read(out), motions.read(motions.Path("paper"), IIWA, 4)
    Q, Qd, Q2d = jounce.load("iiwa14").inverse_dynamics(*motion(motion.times))
    assert (columns["joint3.Q2d"] == Q2d[:, 2]).all()
    h = motion.times[1]
    for below, exact in ((Q, Qd), (Qd, Q2d)):  # the rates are those of the forces, over the whole motion
        central = (below[:-4] - 8 * below[1:-3] + 8 * below[3:-1] - below[4:]) / (12 * h)
        assert relative_error(central, exact[2:-2]) < 1e-9


def test_the_papers_wrench_is_a_sine_with_exact_rates():
    motion = motions.read(motions.Path("paper-wrench"), IIWA, 4)
    same = motions.read(motions.Path("paper"), IIWA, 4)
    t = motion.times
    assert all((a == b).all() for a, b in zip(motion(t), same(t), strict=True))
    sines = [10 * np.sin(np.pi * t), 10 * np.pi * np.cos(np.pi * t), -10 * np.pi**2 * np.sin(np.pi * t)]
    for rate, expected in zip(motion.wrench(t), sines, strict=True):
        np.testing.assert_allclose(rate["link7"], np.repeat(expected[:, None], 6, axis=1), atol=1e-13)


def test_wrench_terms_act_as_wrench_columns_do(tmp_path):
    path = tmp_path / "m.yaml"
    path.write_text(BOTH + "wrenches:\n  body2: {fy: {polynomial: [1, 0, 2]}, mz: {offset: 3}}\n")
    motion = motions.read(path, PLANAR, 4)
    t = motion.times
    columns, zero = {"t": t}, 0 * t
    for j, joint in enumerate(PLANAR.coordinates):
        columns |= {f"{joint}.{name}": rate[:, j] for name, rate in zip(RATES, motion(t), strict=False)}
    columns |= {"body2.fy": 1 + 2 * t**2, "body2.fyd": 4 * t, "body2.fy2d": 4 + zero}
    columns |= {"body2.mz": 3 + zero, "body2.mzd": zero, "body2.mz2d": zero}
    expected = from_table(columns, PLANAR, 4, "m.csv").wrench(t)
    for rate, other in zip(motion.wrench(t), expected, strict=True):
        np.testing.assert_array_equal(rate["body2"], other["body2"])


def test_offset_and_polynomial_and_cosines_add_up(tmp_path):
    path = tmp_path / "m.yaml"
    path.write_text(
        "time: {start: 1, stop: 2, count: 3}\n"
        "joints:\n"
        "  joint2: {polynomial: [1, 0.5, 1e-1], offset: -1}\n"
        "  joint1: {offset: .25, cosines: [{amplitude: 2, frequency: 3}, {amplitude: 1, frequency: 1, phase: 0.5}]}\n"
    )
    motion = motions.read(path, PLANAR, 2)
    t = np.array([1, 1.5, 2])
    assert (motion.times == t).all()
    q, qd, q2d = motion(t, 2)
    np.testing.assert_allclose(q[:, 1], 0.5 * t + 0.1 * t**2, rtol=1e-15)
    np.testing.assert_allclose(q2d[:, 1], 0.2)
    np.testing.assert_allclose(q[:, 0], 0.25 + 2 * np.cos(3 * t) + np.cos(t + 0.5), rtol=1e-15)
    np.testing.assert_allclose(qd[:, 0], -6 * np.sin(3 * t) - np.sin(t + 0.5), rtol=1e-15)


def test_splines_of_degree_five():
    t = np.linspace(0, 1, 60)
    columns = {"t": t, "joint1": np.cos(3 * t), "joint2": t**5 / 7}
    motion = from_table(columns, PLANAR, 4, "m.csv", Spline(5))
    assert "degree 5 (C^4)" in motion.source
    np.testing.assert_allclose(motion(t)[4][:, 1], 120 * t / 7, atol=1e-4)
    refusal(lambda: from_table(columns, PLANAR, 6, "m.csv", Spline(5)), "q6d", "degree 5 ends at q5d")
    refusal(lambda: from_table(columns, PLANAR, 4, "m.csv", Spline(6)), "degree 6 is not supported; expected 5 or 7")


TIME = "time: {stop: 1, count: 5}\n"
BOTH = TIME + "joints:\n  joint1: {offset: 1}\n  joint2: {offset: 2}\n"
BAD = {
    "empty": ("", ["the motion is None", "expected keys and values"]),
    "not YAML": ("time: [1, 2", ["m.yaml:1: not YAML"]),
    "repeated key": (BOTH + "  joint1: {offset: 3}\n", ["m.yaml:5: not YAML", "joint1"]),
    "code": ("time: !!python/object:os.system x", ["unknown tag"]),
    "no joints": (TIME, ["the motion has no 'joints'"]),
    "unknown key": (BOTH.replace("time", "tiem"), ["m.yaml:1: the motion has no key 'tiem'; did you mean 'time'?"]),
    "unknown joint": (BOTH + "  joint3: {}\n", ["unknown 'joint3'; expected terms for each of joint1, joint2"]),
    "missing joint": (TIME + "joints: {joint1: {offset: 1}}",
        ["missing 'joint2'; expected terms for each of joint1, joint2"]),
    "unknown term": (BOTH.replace("offset: 1", "ofset: 1"),
        ["joint 'joint1' has no key 'ofset'; did you mean 'offset'?"]),
    "no amplitude": (BOTH.replace("offset: 1", "cosines: [{frequency: 1}]"),
        ["cosine of joint 'joint1' has no 'amplitude'"]),
    "text": (BOTH.replace("offset: 1", "offset: one"),
        ["m.yaml:3: offset of joint 'joint1' is 'one'; expected a finite number"]),
    "not finite": (BOTH.replace("offset: 1", "offset: .nan"), ["offset of joint 'joint1' is nan"]),
    "truth": (BOTH.replace("offset: 1", "offset: true"), ["is True; expected a finite number"]),
    "no list": (BOTH.replace("offset: 1", "polynomial: 3"), ["polynomial of joint 'joint1' is 3; expected a list"]),
    "empty list": (BOTH.replace("offset: 1", "polynomial: []"), ["polynomial of joint 'joint1' is empty"]),
    "backwards": (BOTH.replace("stop: 1", "stop: -1"), ["time runs from 0 to -1 in 5 states; expected stop > start"]),
    "beyond the doubles": ("time: {start: -1.0e+308, stop: 1.0e+308, count: 5}\njoints: {}",
        ["m.yaml:1: time runs from -1e+308 to 1e+308 in 5 states"]),
    "more states than any memory holds": (BOTH.replace("count: 5", f"count: {10**30}"), ["count 2 to 100000000"]),
    "frequency that overflows": (BOTH.replace("offset: 1", "cosines: [{amplitude: 1, frequency: 1.0e+200}]"),
        ["q2d of joint 'joint1' overflows at t = 0 s; expected a finite time derivative of order 2"]),
    "wrench that overflows": (BOTH + "wrenches: {body2: {fx: {polynomial: [1.0e+308, 1.0e+308]}}}",
        ["W of the wrench of 'body2' overflows", "order 0"]),
    "one name twice": (TIME + "joints: {1: {}, '1': {}, joint1: {}, joint2: {}}",
        ["joints is {", "expected keys with distinct names"]),
    "one state": (BOTH.replace("count: 5", "count: 1"), ["in 1 states"]),
    "half a state": (BOTH.replace("count: 5", "count: 2.5"), ["in 2.5 states"]),
    "wrench of no body": (BOTH + "wrenches: {bdy2: {fx: {offset: 1}}}", ["unknown body 'bdy2'; did you mean 'body2'?"]),
    "unknown component": (BOTH + "wrenches: {body2: {fw: {offset: 1}}}", ["the wrench of 'body2' has no key 'fw'"]),
    "joints as a list": (TIME + "joints: [1, 2]", ["joints is [1, 2]; expected keys and values"]),
}  # fmt: skip


@pytest.mark.parametrize(("text", "words"), BAD.values(), ids=BAD)
def test_refuses_bad_motions_in_one_line(tmp_path, text, words):
    path = tmp_path / "m.yaml"
    path.write_text(text)

    def use():
        motion = motions.read(path, PLANAR, 2)
        return motion(motion.times, 2), motion.wrench(motion.times, 0)

    refusal(use, *words)


def test_refuses_what_is_no_motion(tmp_path):
    with expect_refusal("unknown type of motion '.xls'", ".csv", ".yaml", "paper"):
        motions.read(tmp_path / "m.xls", PLANAR, 2)
    refusal(lambda: motions.read(tmp_path / "m.yaml", PLANAR, 2), "no such file")
    refusal(lambda: motions.read(motions.Path("papr"), PLANAR, 2), "unknown motion 'papr'; did you mean 'paper'?")
    refusal(lambda: motions.read(motions.Path("paper"), PLANAR, 2), "paper: unknown 'joint3'")
