"""Verdicts on limits, and slowdowns, agree with a dense oracle: any rows, breaks, rests, stamps and kinds of limits."""

import signal
import warnings
from contextlib import contextmanager

import numpy as np
import pytest
from hypothesis import strategies as st

import jounce
from fuzz import dense, plans
from fuzz.planted import (
    FACTORS,
    LEAST,
    ROBOTS,
    TOLERANCE,
    arm_or_tree,
    excess,
    is_infinite,
    plan_for,
    rounding,
    with_planted_limits,
)
from jounce.limits import slowdown, worst_values
from jounce.limits.worst_values import Peaks
from jounce.model.limits import LIMIT_KINDS

NAMES = (*ROBOTS, "tree")
FASTEST = 1e4  # of factors of speed that are compared
PATIENCE = 120  # s, for a call
SEEDS = st.integers(0, 2**32 - 1)


@contextmanager
def in_time():
    """Inside, nothing is warned of, and what takes long fails."""

    def stop(*_):
        pytest.fail(f"no answer in {PATIENCE} s")  # no Exception, which a call might catch

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(PATIENCE)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", jounce.JounceWarning)
            yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def case_of(kind, name, seed):
    """A plan, and a robot with limits for it as `with_planted_limits` returns them."""
    rng = np.random.default_rng(seed)
    robot = arm_or_tree(rng, name)
    plan = plan_for(rng, robot, kind)
    return plan, *with_planted_limits(rng, robot, plan)


def check_verdict(kind, name, seed):
    with in_time():
        plan, robot, given, peaks, infinite = case_of(kind, name, seed)
        if not robot.limits.kinds:
            return
        found = robot.check(plan.motion)
    rows = {(row.limit, row.joint): row for row in found.table}
    for of, bounds in given.items():
        for j, joint in enumerate(robot.joint_names):
            if np.isfinite(bounds[:, j]).any():
                jumps, row = [infinite[of, sign][j] for sign in (-1, 1)], rows.pop((of, joint))
                there = value_at(robot, plan, of, row.t)[j]  # a peak between the points of the grid
                values = min(-peaks[of, -1][j], there), max(peaks[of, 1][j], there)
                compare_row(row, found.notes, plan, bounds[:, j], values, jumps)
    assert not rows, rows


def value_at(robot, plan, kind, t):
    """What a limit bounds at a time, (n,)."""
    piece = np.clip(np.searchsorted(plan.x, t, side="right") - 1, 0, len(plan.x) - 2)
    length = plan.x[piece + 1] - plan.x[piece]  # 0 where the plan is one row
    share = np.clip((t - plan.x[piece]) / length, 0, 1) if length else 0.0
    return dense.values_at(robot, plan, [kind], np.array([piece]), np.array([share]))[kind][0]


def compare_row(row, notes, plan, bounds, values, infinite):
    """A row of the table against the true extremes, and the sides on which it is infinite."""
    said = f"true {values} in {bounds}: {row}"
    idle = row.cause is not None and not np.any(values)  # the joint moves no inertia
    if (infinite & np.isfinite(bounds)).any():
        verdict = "undecided" if idle else "broken"
        assert (row.ratio, row.verdict) == (np.inf, verdict), f"a lower rate jumps; {said}"
        return
    share, least = rounding(plan, row.limit)
    allowed = share * max(*map(abs, values), LEAST[row.limit] / 10) + least
    beyond = max(bounds[0] - values[0], values[1] - bounds[1])
    if row.undecided:
        too_fast = f"the {row.limit.replace('_', ' ')} of joint '{row.joint}' may be beyond its limit between samples"
        noted = any(note.startswith(too_fast) for note in notes)
        assert noted or idle or plan.motion.deviations(plan.motion.start, 0) is not None, said
        assert row.verdict != "broken" or beyond > -allowed, said
        return
    if abs(beyond) > allowed:
        assert (row.verdict == "broken") == (beyond > 0), said
        assert bool(row.violations) == (beyond > 0), f"{row.violations}; {said}"
    known = abs(row.margin + beyond) <= allowed or min(abs(row.value - value) for value in values) <= allowed
    assert known or row.ratio < 1e-3, said


def check_slowdown(kind, name, seed):
    """The factor is the first one at which a limit is met, by a grid of smaller ones, and `largest` the last one."""
    with in_time():
        plan, robot, given, _, infinite = case_of(kind, name, seed)
        if not robot.limits.kinds:
            return
        try:
            slow = robot.slowdown(plan.motion, up_to_limits=True)
        except jounce.JounceError as error:
            check_refusal(str(error), robot, plan, given, is_infinite(given, infinite))
            return
    assert not is_infinite(given, infinite), f"a lower rate jumps: {slow}"
    if slow.factor > FASTEST:
        return
    allowed, largest = max(10 * rounding(plan, of)[0] for of in given), slow.largest or 0
    for factor in {slow.factor, max(slow.factor, largest)}:
        met = excess(robot, plan, given, factor, refined=True)
        assert abs(met) <= allowed, f"at {factor} a limit is exceeded by {met}: {slow}, largest {largest}"
    for share in np.linspace(0, 1, 25)[1:-1]:
        assert excess(robot, plan, given, share * slow.factor) <= allowed, f"{slow}: a limit is broken at {share} of it"
    beyond = 1.001 * max(slow.factor, largest)
    assert excess(robot, plan, given, beyond, refined=True) > 0, f"a factor of {beyond} keeps all limits"


def check_refusal(words, robot, plan, given, infinite):
    """A refusal is right where a limit is broken at rest or infinite, or where none bounds the speed."""
    if "infinite there at every speed" in words:
        assert infinite, words
    elif "no limit bounds the speed" in words:
        still = np.abs(plan.motion(plan.motion.times, 1)[1]).max() < LEAST["velocity"]
        assert still or excess(robot, plan, given, FASTEST) <= 0, words
    else:
        assert "slowing down does not help" in words, words
        assert excess(robot, plan, given, 1e-9, refined=True) > -TOLERANCE, words


def check_measured(seed):
    """Fits: what lies two deviations beyond is broken, what lies as far within is kept, and the rest is undecided."""
    rng = np.random.default_rng(seed)
    robot, count = ROBOTS["planar2r"], int(rng.integers(200, 900))
    steps = 10 ** rng.uniform(-3.5, -1) * (1 + 0.2 * rng.random() * rng.uniform(-1, 1, count))
    t = float(rng.choice([*plans.STARTS[:3], rng.uniform(-1e4, 1e4)])) + np.cumsum(steps)
    q = plans.wave_samples(rng, robot, t) + rng.normal(size=(count, 2)) * 10 ** rng.uniform(-6, -3)
    kinds = LIMIT_KINDS.motion[: int(rng.integers(1, 6))]
    with in_time():
        motion = jounce.Motion.fit(t, q, allow_noise=True)
        at = np.linspace(motion.start, motion.stop, 20001)
        values, off = motion(at, 4), motion.deviations(at, 4)
        bounds = [np.quantile(np.abs(x), rng.choice([0.9, 0.99, 1.0]), axis=0) * rng.choice(FACTORS, 2) for x in values]
        keys = {kind: bound for kind, bound in zip(kinds, bounds, strict=False) if kind != "position"}
        limited = robot.with_limits(lower=-bounds[0], upper=bounds[0], **keys)
        rows = {(row.limit, row.joint): row for row in limited.check(motion).table}
    for k, kind in enumerate(kinds):
        beyond, allowed = np.abs(values[k]) - bounds[k], 10 * TOLERANCE * np.abs(values[k]).max(axis=0)
        broken = (beyond > 2.001 * off[k] + allowed).any(axis=0)
        unclear, near = (
            (np.abs(beyond) < share * off[k] + room).any(axis=0)
            for share, room in ((1.999, -allowed), (2.001, allowed))
        )
        for j, joint in enumerate(robot.joint_names):
            row = rows[kind, joint]
            if broken[j]:
                assert row.verdict == "broken", f"{kind}: {row}"
            elif unclear[j]:
                assert row.verdict != "kept", f"{kind}: {row}"
            elif not near[j]:
                assert row.verdict == "kept", f"{kind}: {row}"


@pytest.mark.parametrize("kind", plans.KINDS)
def test_verdicts(budget, kind):
    budget.attack(check_verdict, 3, kind=st.just(kind), name=st.sampled_from(NAMES), seed=SEEDS)


@pytest.mark.parametrize("kind", plans.KINDS)
def test_slowdowns(budget, kind):
    budget.attack(check_slowdown, 1, kind=st.just(kind), name=st.sampled_from(NAMES), seed=SEEDS)


def test_measured_motions(budget):
    budget.attack(check_measured, 1, seed=SEEDS)


NO_PEAKS = Peaks(*(np.array([], dtype=kind) for kind in (str, int, int, float, float)))
FAULTS = {
    "peaks between rows": (worst_values, "find_peaks", lambda *_: NO_PEAKS, check_verdict, "samples", 0),
    "jumps": (worst_values.Worst, "take_jumps", lambda *_: None, check_verdict, "points", 1),
    "refined factors": (slowdown, "find_times_beyond", lambda *_: np.empty(0), check_slowdown, "samples", 0),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_the_oracle_sees_what_is_left_out(monkeypatch, fault):
    place, name, nothing, check, kind, seed = FAULTS[fault]
    check(kind, "planar2r", seed)
    monkeypatch.setattr(place, name, nothing)
    with pytest.raises(AssertionError, match=r"true|exceeded"):
        check(kind, "planar2r", seed)
