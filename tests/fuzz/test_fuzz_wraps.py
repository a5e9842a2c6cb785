"""Logs of encoders that wrap are read as if they did not, or refused: any motions, ranges, rates, noise and holes."""

import numpy as np
from hypothesis import strategies as st

import jounce
from support.refusals import refusal

SEEDS = st.integers(0, 2**32 - 1)
TURN = 2 * np.pi
MAX_PASSED = 0.25  # rad, from row to row, holes included: half a turn would be taken for the other way round


def random_log(rng):
    """Times (N,) and angles (N, n) of joints that swing over several turns, with noise and holes."""
    joints, rows = int(rng.integers(1, 5)), int(rng.integers(60, 600))
    spacing = 10 ** rng.uniform(-3, -1.5)
    t = np.cumsum(spacing * rng.uniform(0.5, 1.5, rows))
    size = rng.uniform(-2, 10, joints)
    fastest = MAX_PASSED / (4 * spacing)  # a hole has up to two rows
    w = np.minimum(rng.uniform(0.2, 1, joints) * fastest / np.abs(size), rng.uniform(1, 6) * TURN / np.ptp(t))
    noise = rng.choice([0, 1e-4, 0.02]) * rng.normal(size=(rows, joints))
    q = size * np.sin(w * (t[:, None] - t[0]) + rng.uniform(0, TURN, joints)) + rng.uniform(-9, 9, joints) + noise
    kept = rng.random(rows) > rng.choice([0, 0.02])
    kept &= ~(np.roll(~kept, 1) | np.roll(~kept, 2))  # never more than three rows apart
    return (t[kept], q[kept]) if kept.sum() > 40 else (t, q)


def check_wraps(seed):
    rng = np.random.default_rng(seed)
    t, q = random_log(rng)
    low = rng.choice([0, -np.pi, rng.uniform(-9, 9)])
    turns = rng.random(q.shape[1]) < 0.8
    given = np.where(turns, (q - low) % (TURN * rng.integers(1, 3)) + low, q)
    steps = np.abs(np.diff(given, axis=0)) > TURN / 2
    way = {"degree": 7, "intervals": 6}
    if steps.any():
        row, joint = np.argwhere(steps)[0]
        refusal(lambda: jounce.Motion.fit(t, given, **way), f"'column {joint + 1}' wraps from", f"row {row + 1} from 0")
    found = jounce.Motion.fit(t, given, unwrap=True, **way)
    plain = jounce.Motion.fit(t, q, **way)
    assert np.abs(found.samples[1] - found.samples[1][0] - (q - q[0])).max() < 1e-9
    assert np.array_equal(found.samples[1][0], given[0])
    off = found(t, 1)[0] - plain(t, 1)[0] - (given[0] - q[0])
    assert np.abs(off).max() < 1e-6 * max(1, np.abs(plain(t, 0)[0]).max())


def test_wraps_are_taken_off_or_refused(budget):
    budget.attack(check_wraps, 60, seed=SEEDS)
