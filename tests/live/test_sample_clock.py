"""Odd streams of stamps: what Python, the command and C lose of them, what they say, and that all three agree."""

import warnings

import numpy as np
import pytest

import jounce
from jounce import JounceError, JounceWarning
from live.test_live_code import Compiled
from support.commands import call
from support.refusals import refusal
from support.tools import needs

ROBOT = jounce.load("planar2r")
GIVEN = {"dt": 1e-3, "bandwidth": 8, "noise": 1e-5, "lag": 0}  # no gap is longer than 0.298 s
COUNT = 120
EVEN = 1e-3 * np.arange(COUNT)
INDEX = np.arange(COUNT)
Q = np.array([np.sin(EVEN), 0.5 * np.cos(2 * EVEN)]).T


def at(places, values):
    """Even stamps with others at some places."""
    stamps = EVEN.copy()
    stamps[places] = values
    return stamps


STREAMS = {  # stamps; samples that are lost, new clocks that begin
    "even": (EVEN, 0, 0),
    "one far ahead": (at(60, 1e6), 2, 1),
    "the first one far ahead": (at(0, 1e6), 2, 1),
    "one ahead by less than a gap": (at(60, 0.2), 2, 1),
    "one far back": (at(60, -5.0), 1, 0),
    "one equal to the last": (at(60, EVEN[59]), 1, 0),
    "equal first stamps": (at(1, 0.0), 1, 0),
    "three equal first stamps": (at(slice(3), 0.0), 2, 0),
    "stamps stand still for 20 ms": (at(slice(60, 80), EVEN[60]), 19, 0),
    "clock set back by 1 s": (EVEN - (INDEX >= 60), 2, 1),
    "clock set back by 2 ms": (EVEN - 2e-3 * (INDEX >= 60), 2, 0),
    "clock set back by 1e9 s": (EVEN - 1e9 * (INDEX >= 60), 2, 1),
    "clock set back before the last two": (EVEN - (INDEX >= COUNT - 2), 2, 0),
    "clock set ahead by 0.1 s": (EVEN + 0.1 * (INDEX >= 60), 0, 0),
    "clock set ahead by 10 s": (EVEN + 10 * (INDEX >= 60), 0, 0),
    "clock that wraps at 50 ms": (1e-3 * (INDEX % 50), 4, 2),
    "two clocks that alternate": (EVEN + 100 * (INDEX % 2), 59, 0),
    "two clocks that alternate in tens": (EVEN + 100 * (INDEX // 10 % 2), 10, 5),
    "two sensors, of which one is late": (1e-3 * (INDEX ^ 1), 60, 0),
    "two rows come late": (at([60, 61, 62], EVEN[[62, 60, 61]]), 2, 0),
    "three rows come late": (at([60, 61, 62, 63], EVEN[[63, 60, 61, 62]]), 2, 1),
    "three wrong ones, longer than a gap apart": (at([60, 61, 62], [-10, -5, -1]), 3, 0),
    "time runs back": (-EVEN, COUNT - 1, 0),
    "time runs back for 20 ms": (at(slice(60, 80), EVEN[58:38:-1]), 20, 0),
    "infinite": (at([60, 61, 62], np.inf), 3, 0),
    "infinite between those of a new clock": (np.where(INDEX == 61, np.inf, EVEN - (INDEX >= 60)), 3, 1),
}


def lost_by_python(live, stamps):
    """Rates, whether they are trusted and times after each sample; how many are lost, and new clocks."""
    found, lost = [], 0
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always", JounceWarning)
        for t, q in zip(stamps, Q, strict=True):
            try:
                live.update(q, t)
            except JounceError:
                lost += 1
            found.append((live.t, *np.ravel(live.rates), *np.ravel(live.deviations), *live.trust.good))
    return np.array(found, dtype=float), lost, sum("new clock" in str(x.message) for x in said)


@pytest.mark.parametrize("name", STREAMS)
def test_python_loses_what_no_rule_can_place(name):
    stamps, *expected = STREAMS[name]
    _, *found = lost_by_python(ROBOT.live(**GIVEN), stamps)
    assert found == expected


@pytest.mark.filterwarnings("always::jounce.JounceWarning")
@pytest.mark.parametrize("name", STREAMS)
def test_command_loses_the_same_and_says_so(name):
    stamps, lost, clocks = STREAMS[name]
    given = "t,joint1,joint2\n" + "".join(f"{t:.17g},{q[0]:.17g},{q[1]:.17g}\n" for t, q in zip(stamps, Q, strict=True))
    words = ["live", "planar2r", "-", "--dt", "1e-3", "--bandwidth", "8", "--lag", "0"]
    result = call(*words, given=given)
    assert result.exit_code == (3 if lost else 0)
    assert result.stdout.count("\n") == 1 + COUNT - lost
    assert result.stderr.count("is taken for that of a new clock") == clocks
    assert result.stderr.count("leave the row out") + result.stderr.count("has no time") == lost
    left_out = "1 row is left out" if lost == 1 else f"{lost} rows are left out"
    assert left_out in result.stderr or not lost


@pytest.fixture(scope="module")
def compiled_estimator(tmp_path_factory):
    return Compiled(tmp_path_factory.mktemp("c"), ROBOT.live(**GIVEN))


@needs("gcc")
@pytest.mark.parametrize("name", STREAMS)
def test_c_is_python_tick_for_tick(name, compiled_estimator):
    stamps, lost, clocks = STREAMS[name]
    compiled_estimator.state[()] = np.zeros_like(compiled_estimator.state)
    found, codes = [], []
    for t, q in zip(stamps, Q, strict=True):
        compiled_estimator.update(q, t)
        x = compiled_estimator.state
        found.append([float(x["t"]), *x["rates"].ravel(), *x["deviations"].ravel(), *x["good"]])
        codes.append(compiled_estimator.code)
    assert (codes.count(-1), codes.count(2)) == (lost, clocks)
    expected, *_ = lost_by_python(ROBOT.live(**GIVEN), stamps)
    scale = np.nanmax(np.abs(expected), axis=0)
    scale[scale == 0] = 1  # trust, of streams that are never followed for long
    np.testing.assert_allclose(np.array(found) / scale, expected / scale, rtol=1e-6, atol=1e-9)


def test_new_clock_begins_without_the_samples_before():
    """Rates and deviations of forces, too, are those of an estimator that has seen the new clock alone."""
    old, fresh = (ROBOT.live(**GIVEN) for _ in range(2))
    t = 1e-3 * np.arange(700)
    for k, time in enumerate(t):
        old.update([np.sin(time), 0.0], 1e3 + time)
        old.forces()
        if k >= 2:
            fresh.update([np.sin(time), 0.0], time)
            fresh.forces()
    for time in t[:2]:
        refusal(lambda time=time: old.update([np.sin(time), 0.0], time), "not after the last sample")
    with pytest.warns(JounceWarning, match="t = 0.002 s is taken for that of a new clock"):
        old.update([np.sin(t[2]), 0.0], t[2])
    old.forces()
    for time in t[3:]:
        old.update([np.sin(time), 0.0], time)
        old.forces()
    np.testing.assert_array_equal(old.rates, fresh.rates)
    np.testing.assert_array_equal(old.deviations, fresh.deviations)
    np.testing.assert_array_equal(old.forces().certain, fresh.forces().certain)


@pytest.mark.filterwarnings("ignore::jounce.JounceWarning")
def test_window_of_the_noise_does_not_join_two_clocks():
    live, random = ROBOT.live(1e-3), np.random.default_rng(0)
    for k, q in enumerate(np.sin(1e-3 * np.arange(4000)[:, None] + [0, 1]) + random.normal(0, 1e-4, (4000, 2))):
        try:
            live.update(q, 1e-3 * (k % 2000))
        except JounceError:
            assert k in (2000, 2001)
    assert live._noise.sigma == pytest.approx(1e-4, rel=0.2)
