"""Stamps that jump, go back, repeat, mix and wrap: `live` follows the last clock, and C does what Python does."""

import warnings

import numpy as np
import pytest
from hypothesis import strategies as st

import jounce
from live.test_live_code import Compiled
from support.tools import needs

ROBOT = jounce.load("planar2r")
GIVEN = {"dt": 1e-3, "bandwidth": 8, "noise": 1e-5, "lag": 0}
ROWS, TAIL = 120, 30  # the last rows are even, by a clock of any time
REFUSED, NEW_CLOCK = -1, 2  # what `live_update` of generated C returns
SEEDS = st.integers(0, 2**32 - 1)


def jump(rng, t, i):
    """The clock is set ahead or back."""
    t[i:] += rng.choice([-1, 1]) * 10 ** rng.uniform(-3, 9)


def spoil(rng, t, i):
    """Some stamps are of any time, or none."""
    rows = slice(i, i + rng.integers(1, 6))
    t[rows] = rng.choice([rng.uniform(-1e6, 1e6), 0.0, np.nan, np.inf, -np.inf])


def repeat(rng, t, i):
    """The clock stands still."""
    t[i : i + rng.integers(1, 20)] = t[i]


def mix(rng, t, i):
    """Every other row has another clock."""
    t[i : i + rng.integers(2, 60) : 2] += rng.uniform(-1, 1) * 10 ** rng.uniform(-3, 6)


def shuffle(rng, t, i):
    """Some rows come in another order."""
    rng.shuffle(t[i : i + rng.integers(2, 6)])


def wrap(rng, t, _):
    """The clock counts to the end of a period and begins again."""
    t %= 10 ** rng.uniform(-2.5, -1)


FAULTS = jump, spoil, repeat, mix, shuffle, wrap


def random_stamps(rng):
    """Stamps (N,) with faults, and an even end."""
    t = np.cumsum(1e-3 * rng.uniform(0.5, 1.5, ROWS))
    with np.errstate(invalid="ignore"):
        for fault in rng.choice(FAULTS, rng.integers(0, 5)):
            fault(rng, t, int(rng.integers(ROWS)))
    start = rng.choice([0.0, 10 ** rng.uniform(-3, 9)])
    return np.concatenate([t, start + 1e-3 * np.arange(TAIL)])


def followed_stamps(live, stamps):
    """What became of each stamp, as C says it, and the times of the estimator after it."""
    codes, times = [], []
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always", jounce.JounceWarning)
        for k, t in enumerate(stamps):
            before = len(said)
            try:
                live.update(position(k), t)
                codes.append(NEW_CLOCK if any("new clock" in str(x.message) for x in said[before:]) else 0)
            except jounce.JounceError:
                codes.append(REFUSED)
            times.append(live.t)
    return np.array(codes), np.array(times)


def position(k):
    return np.array([np.sin(1e-3 * k), 0.5 * np.cos(2e-3 * k)])


def check_clocks(seed):
    """No finite stamp after the last one is refused, no other one taken but as a new clock, and the end is followed."""
    stamps = random_stamps(np.random.default_rng(seed))
    codes, times = followed_stamps(ROBOT.live(**GIVEN), stamps)
    last = np.append(np.nan, times[:-1])
    later = np.isfinite(stamps) & ~(last >= stamps)
    assert np.array_equal(codes == 0, later)
    assert np.array_equal(times[codes != REFUSED], stamps[codes != REFUSED])
    assert (codes[-TAIL + 3 :] == 0).all()


@pytest.fixture(scope="module")
def compiled_clock(tmp_path_factory):
    return Compiled(tmp_path_factory.mktemp("c"), ROBOT.live(**GIVEN))


def test_clocks_are_followed(budget):
    budget.attack(check_clocks, 60, seed=SEEDS)


@needs("gcc")
def test_c_follows_clocks_as_python_does(budget, compiled_clock):
    def check(seed):
        stamps = random_stamps(np.random.default_rng(seed))
        codes, _ = followed_stamps(ROBOT.live(**GIVEN), stamps)
        compiled_clock.state[()] = np.zeros_like(compiled_clock.state)
        for k, t in enumerate(stamps):
            compiled_clock.update(position(k), np.inf if np.isnan(t) else t)  # NaN stands for no stamp there
            assert (compiled_clock.code == REFUSED, compiled_clock.code == NEW_CLOCK) == (
                codes[k] == REFUSED,
                codes[k] == NEW_CLOCK,
            )

    budget.attack(check, 40, seed=SEEDS)
