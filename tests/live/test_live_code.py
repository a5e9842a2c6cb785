"""Live estimators in C and C++ are those of Python, and stay so for long."""

import ctypes
import subprocess

import numpy as np
import pytest
from benchmarks.live import encoder_noise, harmonics, rounded

import jounce
from support.commands import call
from support.refusals import refusal
from support.robots import golden
from support.tools import needs

WARNINGS = "-Wall -Wextra -Wpedantic -Wconversion -Wdouble-promotion -Wfloat-conversion -Werror"
EXACT = "-ffp-contract=off"
ROBOTS = {"iiwa14": jounce.load("iiwa14"), "mixed5": jounce.Robot(golden("mixed5")[0])}
SIGMA = encoder_noise(16)
GIVEN = {"dt": 1e-3, "bandwidth": 8, "noise": SIGMA}


class Compiled:
    """An estimator of generated code; `state` is its struct, `code` what the last update returned."""

    def __init__(self, folder, live, lang="c", float32=False, flags=f"-O2 {EXACT}"):
        s, real, kind = live.settings, np.float32 if float32 else float, "float" if float32 else "double"
        live._robot.codegen(lang, 0, folder, float32=float32, prefix="arm", live=live)
        call = f"int arm_live_update(arm::live_rates *x, const {kind} *q, double t)"
        (folder / "arm.cpp").write_text(
            f'#include "arm.hpp"\nextern "C" {call};\n{call} {{ return arm::live_update(x, q, t); }}\n'
        )
        compiler, source = (["gcc", "-std=c99"], "arm.c") if lang == "c" else (["g++", "-std=c++11"], "arm.cpp")
        command = [*compiler, *WARNINGS.split(), *flags.split(), "-shared", "-fPIC", source, "-o", "arm.so", "-lm"]
        subprocess.run(command, check=True, cwd=folder)
        self._update, self.real = ctypes.CDLL(str(folder / "arm.so")).arm_live_update, real
        self._update.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_double]
        n, m, kept = s.mechanism.n, s.states, s.kept
        fields = [
            ("t", float), ("rates", real, (5, n)), ("deviations", real, (5, n)), ("innovation_rms", real, n),
            ("good", np.int32, n), ("moving", np.int32, n), ("flags", np.int32, 4), ("times", float, 4 + kept),
            ("y", real, n), ("z", real, (kept, m, n + m)), ("memory", real, m * kept * m + 20 * n + 1),
        ]  # fmt: skip
        self.state = np.zeros((), np.dtype(fields, align=True))

    def update(self, q, t=None):
        sample = np.ascontiguousarray(q, self.real)
        self.code = self._update(self.state.ctypes.data, sample.ctypes.data, np.nan if t is None else t)
        return self.state["rates"].copy()


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """The estimator of the iiwa, compiled once; each test zeroes it."""
    return Compiled(tmp_path_factory.mktemp("c"), ROBOTS["iiwa14"].live(**GIVEN))


def spoilt(count, turns, seed=0, gap=1.0):
    """Uneven times, and samples of encoders of 16 bits that wrap, are lost, repeat the last ones, and leave a gap."""
    random = np.random.default_rng(seed)
    t = np.cumsum(random.uniform(0.7e-3, 1.3e-3, count)) + gap * (np.arange(count) > 0.6 * count)
    q = rounded(3 + harmonics(t, seed)[0][:, : len(turns)], 16)
    q = np.where(turns, (q + np.pi) % (2 * np.pi) - np.pi, q)
    for k in np.flatnonzero(random.random(count) < 0.03)[1:]:
        q[k] = q[k - 1]
    q[random.random(count) < 0.02, 0] = np.nan
    return t, q


CASES = {
    "iiwa14": ("iiwa14", {}),
    "no lag, no stamps": ("iiwa14", {"bandwidth": 5, "lag": 0}),
    "joints that slide, five states": (
        "mixed5", {"bandwidth": 12, "lag": 0.05, "states": 5, "noise": [1e-5, 2e-5, SIGMA, SIGMA, 1e-4]},
    ),
    "eight states, a lag between samples": ("iiwa14", {"bandwidth": 15, "states": 8, "lag": 0.0033}),
}  # fmt: skip


@needs("gcc")
@pytest.mark.parametrize("name", CASES)
def test_c_is_python(name, tmp_path):
    robot, options = CASES[name]
    live, stamps, found, expected = ROBOTS[robot].live(**GIVEN | options), "no stamps" not in name, [], []
    compiled, codes = Compiled(tmp_path, live), []
    for t, q in zip(*spoilt(1000, live.settings.turns, gap=stamps), strict=True):
        expected.append([*live.update(q, t if stamps else None), *live.deviations, *live.trust])
        compiled.update(q, t if stamps else None)
        x = compiled.state
        found.append(np.array([*x["rates"], *x["deviations"], x["innovation_rms"], x["good"], x["moving"]]))
        codes.append(compiled.code)
        np.testing.assert_array_equal(x["t"], live.t)
    found, expected = np.array(found), np.array(expected, dtype=float)
    np.testing.assert_array_equal(found[:, 11:], expected[:, 11:])
    np.testing.assert_array_equal(np.isnan(found), np.isnan(expected))
    np.testing.assert_allclose(found[:, 5:11], expected[:, 5:11], rtol=1e-6, atol=1e-9)
    scale = np.nanmax(np.abs(expected[:, :5]), axis=(0, 2))
    assert (np.nanmax(np.abs(found - expected)[:, :5], axis=(0, 2)) < 1e-10 * scale).all()
    assert set(codes) == {0, 1}


@needs("gcc")
def test_a_minute_of_c_is_that_of_python(tmp_path):
    """At 62.5 Hz, so that the test is short, from the fifth second on, when the unknown start is forgotten."""
    t = 16e-3 * np.arange(3750)
    live = ROBOTS["iiwa14"].live(**GIVEN | {"dt": 16e-3, "bandwidth": 6})
    compiled = Compiled(tmp_path, live)
    samples = zip(t, rounded(harmonics(t, 3)[0], 16), strict=True)
    rates = np.array([(compiled.update(q, time), live.update(q, time)) for time, q in samples])[312:]
    errors = np.abs(rates[:, 0] - rates[:, 1]).max(axis=(0, 2)) / np.abs(rates).max(axis=(0, 1, 3))
    assert (errors < 1e-12).all()


@needs("gcc", "g++")
def test_bits_depend_neither_on_optimization_nor_on_the_language(tmp_path):
    live = ROBOTS["iiwa14"].live(**GIVEN)
    others = [("c", f"-O0 {EXACT}"), ("c", f"-O3 {EXACT}"), ("cpp", f"-O2 {EXACT}")]
    compiled = [Compiled(tmp_path / str(k), live, lang, flags=flags) for k, (lang, flags) in enumerate(others)]
    for t, q in zip(*spoilt(600, live.settings.turns), strict=True):
        first, *rest = [x.update(q, t) for x in compiled]
        for other in rest:
            np.testing.assert_array_equal(first, other)
    for name in ("deviations", "z", "innovation_rms"):
        np.testing.assert_array_equal(compiled[0].state[name], compiled[1].state[name])


@needs("gcc")
@pytest.mark.parametrize("float32", [False, True])
def test_covariance_stays_positive_and_does_not_drift(float32, tmp_path):
    live = ROBOTS["iiwa14"].live(**GIVEN)
    compiled, random, spectra = Compiled(tmp_path, live, float32=float32), np.random.default_rng(0), []
    k = np.arange(30_000)
    uneven = np.where(k % 10_000 < 7_000, random.uniform(5e-4, 1.5e-3, len(k)), 1e-3)  # even before it is looked at
    for k, t in enumerate(np.cumsum(uneven)):
        compiled.update(np.sin(2 * t + np.arange(7)), t)
        if k % 10_000 == 9_999:
            P = np.roll(compiled.state["z"][:, :, 7:].astype(float), -compiled.state["flags"][2], axis=0)
            scale = np.sqrt(np.diagonal(P, axis1=1, axis2=2))
            spectra.append(np.linalg.eigvalsh(P / scale[:, :, None] / scale[:, None]))
    assert np.min(spectra) > 1e-4
    np.testing.assert_allclose(spectra[1:], [spectra[0]] * 2, rtol=1e-2 if float32 else 1e-9)


@needs("gcc")
def test_single_precision_loses_a_part_of_a_deviation(tmp_path, compiled):
    single, double = Compiled(tmp_path, ROBOTS["iiwa14"].live(**GIVEN), float32=True), compiled
    double.state[()] = np.zeros_like(double.state)
    t = 1e-3 * np.arange(2000)
    found = [
        (single.update(q, time), double.update(q, time), double.state["deviations"].copy())
        for time, q in zip(t, rounded(harmonics(t, 2)[0], 16), strict=True)
    ]
    error = np.abs([(a - b) / off for a, b, off in found[500:]])
    assert error.max() < 0.5
    assert np.sqrt((error**2).mean()) < 0.03


@needs("gcc")
@pytest.mark.parametrize(
    ("q", "t"),
    [
        ([0.1] * 7, 0.2),
        ([0.1] * 7, 0.1),
        ([0.1] * 7, np.inf),
        ([0.9, *[0.1] * 6], 0.201),
        ([0.1, 5.73, *[0.1] * 5], None),
    ],
)
def test_bad_sample_is_left_out(q, t, compiled):
    compiled.state[()] = np.zeros_like(compiled.state)
    compiled.update([0.1] * 7, 0.2)
    before = compiled.state.copy()
    compiled.update(q, t)
    assert compiled.code == -1
    np.testing.assert_array_equal(compiled.state["z"], before["z"])
    now_and_kept = np.arange(26) != 1  # without the stamp that was refused
    np.testing.assert_array_equal(compiled.state["times"][now_and_kept], before["times"][now_and_kept])
    compiled.update([0.9, np.nan, *[0.1] * 5])
    assert compiled.code == 1


@pytest.mark.parametrize(("lang", "live", "words"), [
    ("c", lambda robot: robot.live(1e-3, noise=1e-5), ["live in C99 is", "robot.live(dt, bandwidth=HZ, noise=RAD)"]),
    ("c", lambda robot: robot.live(1e-3, 8), ["noise=RAD"]),
    ("rust", lambda robot: robot.live(1e-3, 8, noise=1e-5), ["live in Rust is", "in c or cpp"]),
    ("c", lambda robot: jounce.load("planar2r").live(1e-3, 8, noise=1e-5), ["of this robot"]),
    ("c", lambda robot: True, ["live in C99 is a bool; expected that of robot.live(dt,"]),
])  # fmt: skip
def test_what_has_no_code_is_refused(lang, live, words, tmp_path):
    robot = ROBOTS["iiwa14"]
    refusal(lambda: robot.codegen(lang, directory=tmp_path / "new", live=live(robot)), *words)
    assert list(tmp_path.iterdir()) == []


def test_command_takes_the_settings_together(tmp_path):
    command = ["codegen", "planar2r", "--lang", "c", "-o", str(tmp_path / "new")]
    settings = ["--live", "--dt", "0.001", "--bandwidth", "8", "--noise", "1e-5", "--lag", "0", "--states", "5"]
    for left_out in ("--live", "--dt", "--bandwidth", "--noise"):
        k = settings.index(left_out)
        said = call(*command, *settings[:k], *settings[k + 1 + (k > 0) :])
        assert said.exit_code != 0
        assert "expected --live, --dt, --bandwidth and --noise together" in said.output
    assert call(*command, *settings).exit_code == 0
    assert "z[1][5][2 + 5]" in (tmp_path / "new" / "planar2r.h").read_text()
