"""Extremes of channels: largest values, those that are known well, sums of squares, and those of stretches."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import jounce
from jounce.motion.extremes import (
    Peak,
    find_extremes,
    find_motion_extremes,
    merge_peaks,
    surest_peak,
    tabulate_peaks,
)

T = np.linspace(0, 3, 301)
X = np.column_stack([np.sin(3 * T), -2 * np.cos(T) * T])
OFF = 0.01 + 10 * np.exp(-30 * T)[:, None] * np.ones(2)  # an uncertain start
EXACT = jounce.Channel("Q", ("a", "b"), ("N m", "N"), T, (X, 3 * X))
KNOWN = jounce.Channel("Q", ("a", "b"), ("N m", "N"), T, (X,), (OFF,), ((0.5, 3.0),))


def test_the_largest_values_are_those_of_the_columns():
    found = find_extremes([EXACT])
    assert list(found) == ["a", "b"]
    assert list(found["a"]) == ["Q", "Qd"]
    for j, name in enumerate("ab"):
        at = np.abs(X[:, j]).argmax()
        assert found[name]["Q"].largest == Peak(abs(X[at, j]), 0.0, T[at]) == found[name]["Q"].certain
        assert found[name]["Qd"].squares == pytest.approx(9 * (X[:, j] ** 2).sum())


def test_a_value_within_its_band_is_no_candidate():
    """The largest value of the first joint lies where its deviation is larger than it."""
    spoilt = X.copy()
    spoilt[0] = 50.0, -50.0
    off = OFF.copy()
    off[0] = 100.0
    found = find_extremes([jounce.Channel("Q", ("a", "b"), ("N m", "N"), T, (spoilt,), (off,))])
    sure = np.abs(X[1:]) - 1.96 * off[1:]
    for j, name in enumerate("ab"):
        assert found[name]["Q"].largest.t == T[1 + sure[:, j].argmax()]


def test_certain_values_lie_in_their_windows():
    early = np.zeros_like(X)
    early[20] = 30.0  # large, and uncertain: before the window
    channel = jounce.Channel("Q", ("a", "b"), ("N m", "N"), T, (X + early,), (3 + 0 * X,), ((0.5, 3.0),))
    found = find_extremes([channel])["a"]["Q"]
    assert found.largest.t == T[20]
    assert found.certain.t >= 0.5
    assert find_extremes([jounce.Channel("Q", ("a",), ("N m",), T, (X[:, :1] + early[:, :1],), (0.1 + 0 * X[:, :1],),
                                         ((0.5, 3.0),))])["a"]["Q"].certain.t == T[20]  # fmt: skip  # 0.3 % is certain


def test_of_several_peaks_the_one_beyond_its_band_counts():
    """5 lies within a band of 1.96 times 3."""
    doubtful, sure = Peak(5.0, 3.0, 0.0), Peak(4.0, 0.1, 1.0)
    assert surest_peak([doubtful, sure]) == surest_peak([sure, doubtful]) == sure
    assert surest_peak([Peak(5.0, 0.3, 0.0), sure]).value == 5.0


def test_missing_values_are_no_peaks():
    values = X.copy()
    values[np.abs(X[:, 0]).argmax(), 0] = np.nan
    values[:, 1] = np.nan
    found = find_extremes([jounce.Channel("Q", ("a", "b"), ("N m", "N"), T, (values,))])
    assert found["a"]["Q"].largest.value == np.nanmax(np.abs(values[:, 0]))
    assert np.isnan(found["b"]["Q"].largest.value)
    assert surest_peak([found["b"]["Q"].largest, found["a"]["Q"].largest]) == found["a"]["Q"].largest


@given(st.lists(st.integers(1, 300), min_size=1, max_size=5, unique=True), st.sampled_from([EXACT, KNOWN]))
def test_stretches_have_the_extremes_of_the_whole(cuts, channel):
    bounds = [0, *sorted(cuts), len(T)]
    merged = None
    for start, stop in pairwise(bounds):
        part = find_extremes([channel.rows(slice(start, stop))])
        merged = part if merged is None else merge_peaks(merged, part)
    whole = find_extremes([channel])
    for name, of in whole.items():
        for quantity, found in of.items():
            assert merged[name][quantity].largest == found.largest
            assert merged[name][quantity].squares == pytest.approx(found.squares)
            if (found.certain.t >= 0.5) or channel is EXACT:
                assert merged[name][quantity].certain == found.certain


def test_extremes_along_a_motion_do_not_depend_on_the_stretches(monkeypatch):
    motion = jounce.Motion.polynomial([[0, 2, -1], [0, 0.5, 0]], duration=1.0)
    whole = find_motion_extremes(motion, ("a", "b"), 1, [(0.0, 1.0)] * 2)
    monkeypatch.setattr("jounce.motion.extremes.MAX_PEAK_ROWS", 37)
    parts = find_motion_extremes(motion, ("a", "b"), 1, [(0.0, 1.0)] * 2)
    assert {x: {k: v.largest for k, v in of.items()} for x, of in parts.items()} == {
        x: {k: v.largest for k, v in of.items()} for x, of in whole.items()
    }
    assert whole["a"]["qd"].largest == Peak(2.0, 0.0, 0.0)


def test_a_table_has_a_row_per_motion_and_joint():
    one, two = find_extremes([EXACT]), find_extremes([EXACT.columns([1]).upto(0)])
    found = tabulate_peaks({"one": (301, one), "two": (301, two)}, ["peak", "rms"])
    assert list(found) == ["motion", "joint", "rows", "Q_peak", "Qd_peak", "Q_rms", "Qd_rms"]
    assert found["joint"].tolist() == ["a", "b", "b"]
    np.testing.assert_allclose(found["Q_rms"], np.sqrt((X**2).mean(axis=0))[[0, 1, 1]])
    np.testing.assert_array_equal(np.isnan(found["Qd_peak"]), [False, False, True])
