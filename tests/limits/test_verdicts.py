"""Verdicts on measured motions: what samples decide is kept or broken up to their ends, and the rest is undecided."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import jounce
from jounce.io import tables
from jounce.limits import worst_values
from jounce.limits.limited_motion import compute_deviations, validate_limits
from jounce.limits.verdicts import describe_judged, join_spans
from jounce.limits.worst_values import Worst
from support.commands import call
from support.linkages import fourbar

ROBOT = jounce.load("planar2r")
TURNS = np.array([-0.25 + 2.1j, -0.2 + 3.3j])  # 1/s: motions that swing down, with their largest rates at the start
SIZES = np.array([0.8 * np.exp(0.4j), 0.5 * np.exp(1.9j)])
T = np.arange(0, 6, 0.002)
DENSE = np.linspace(0, T[-1], 60001)


def truth(t, order=0):
    return (SIZES * TURNS**order * np.exp(np.multiply.outer(t, TURNS))).real


def true_rates(t):
    """Q, Qd, Q2d of the truth."""
    return ROBOT.inverse_dynamics(*(truth(t, k) for k in range(5)))


def noisy_log(seed=1, noise=2e-4):
    return truth(T) + np.random.default_rng(seed).normal(0, noise, (len(T), 2))


@pytest.fixture(scope="module")
def fitted_motion():
    return jounce.Motion.fit(T, noisy_log())


def spans_of(beyond):
    edges = np.flatnonzero(np.diff(np.concatenate([[False], beyond, [False]]).astype(int)))
    return DENSE[edges.clip(max=len(DENSE) - 1)].reshape(-1, 2)


def test_positions_beyond_limits_at_both_ends_of_a_log_are_found(fitted_motion):
    first, last = truth(T[[0, -1]])[:, 0]
    upper, lower = first - 0.02, truth(DENSE)[:, 1].min() + 0.01
    found = ROBOT.with_limits(upper=[upper, 9], lower=[-9, lower]).check(fitted_motion)
    assert (found.verdict, found.ok) == ("broken", False)
    assert 0.99 < found.judged["position"] < 1  # less the time in which it passes its limit
    for row, beyond in zip(found.table, [truth(DENSE)[:, 0] > upper, truth(DENSE)[:, 1] < lower], strict=True):
        np.testing.assert_allclose(row.violations, spans_of(beyond), atol=0.01)
    ends = ROBOT.with_limits(upper=[last - 0.01, 9], lower=[-9, -9]).check(fitted_motion)
    assert ends.table[0].violations[-1][1] == T[-1]


def test_a_torque_rate_beyond_its_limit_counts_if_uncertain(fitted_motion):
    rate = np.abs(true_rates(DENSE)[1][:, 0])
    limited = ROBOT.with_limits(effort_rate=[9e3, 9e3])
    start = validate_limits(limited, fitted_motion).window("effort_rate")[0]
    bound = 1.02 * rate[start <= DENSE].max()
    assert rate[start > DENSE].max() > 1.1 * bound
    found = ROBOT.with_limits(effort_rate=[bound, 9e3]).check(fitted_motion)
    assert found.verdict == "broken"
    assert found.worst.t < start
    assert found.worst.ratio - 1 > 2 * found.worst.deviation
    assert abs(found.worst.ratio - rate.max() / bound) < 3 * found.worst.deviation
    assert 0.9 < found.judged["effort_rate"] < 1
    for start, stop in found.worst.undecided:
        assert all(stop <= low or high <= start for low, high in found.worst.violations)


@pytest.mark.parametrize("slower", [1, 20])
def test_the_worst_value_outside_of_uncertain_ends(fitted_motion, slower):
    """Stated where the worst one lies in such an end and is off by more than a twentieth."""
    motion, cases = fitted_motion.scaled(slower), set()
    for kind, order, values in (("velocity", 1, truth(DENSE, 1)), ("acceleration", 2, truth(DENSE, 2)),
                                ("effort_rate", 1, true_rates(DENSE)[1])):  # fmt: skip
        if kind == "effort_rate" and slower > 1:
            continue
        robot = ROBOT.with_limits(**{kind: 1e3})
        start, stop = validate_limits(robot, motion).window(kind)
        within = (start <= slower * DENSE) & (slower * DENSE <= stop)
        for row, column in zip(robot.check(motion).table, values.T / slower**order, strict=True):
            outside, uncertain = not start <= row.t <= stop, row.deviation > 0.05 * row.ratio
            cases.add((outside, uncertain))
            assert (row.certain is not None) == (outside and uncertain)
            if row.certain:
                value, t = row.certain
                assert start <= t <= stop
                assert abs(value) == pytest.approx(np.abs(column[within]).max(), rel=0.02)
    assert cases == {(False, False), (True, False), (True, True)}


@pytest.mark.parametrize(("slope", "end"), [(0.3, 1), (-0.3, 0)])
def test_an_undecided_value_at_an_end_that_is_known_well_is_shown(slope, end):
    t = np.arange(500) / 500
    q = np.outer(t, [slope, 0]) + np.random.default_rng(0).normal(0, 1e-4, (500, 2))
    motion = jounce.Motion.fit(t, q, allow_noise=True)
    last = (motion.start, motion.stop)[end]
    value, off = motion([last], 0)[0][0, 0], motion.deviations([last], 0)[0][0, 0]
    robot = ROBOT.with_limits(upper=[value + off, 9], lower=-9)
    assert validate_limits(robot, motion).windows == {}
    row = robot.check(motion).table[0]
    assert (row.verdict, row.t, row.value) == ("undecided", last, value)
    assert {row.undecided[0][0], row.undecided[-1][1]} >= {last}


def test_undecided_spans_reach_to_the_times_around_them(fitted_motion):
    """To the last time before at which the verdict is known and the first one after; those of the next part follow."""
    b = validate_limits(ROBOT.with_limits(velocity=1.0), fitted_motion)
    t, values, spans = np.arange(8) / 4 + 1, np.zeros((8, 2)), {}
    values[[0, 3, 4, 7], 0] = 1.0  # which is the limit
    found = [(1.0, 1.25), (1.5, 2.25), (2.5, 2.75)]
    for count in (1, 2):
        worst_values.judge_values(b, Worst(b), t, {"velocity": values}, spans)
        assert spans == {("velocity", 0): count * found}


@pytest.mark.parametrize("count", range(1, 12))
def test_parts_of_times_share_their_ends(monkeypatch, count):
    """So that what is judged part by part is judged at every time, and a span across two parts is one."""
    monkeypatch.setattr(worst_values, "_UNCERTAIN_TIMES_AT_ONCE", 4)
    parts = list(worst_values._overlapping_parts(np.arange(count)))
    assert np.concatenate([parts[0], *(part[1:] for part in parts[1:])]).tolist() == list(range(count))
    assert all(min(count, 2) <= len(part) <= 4 for part in parts)


def test_a_long_log_is_judged_as_a_short_one(monkeypatch, fitted_motion):
    robot = ROBOT.with_limits(effort_rate=[34.7, 9e3], upper=[0.7, 9], lower=-9)
    whole = robot.check(fitted_motion)
    monkeypatch.setattr(worst_values, "_UNCERTAIN_TIMES_AT_ONCE", 50)
    monkeypatch.setattr(worst_values, "_VALUES_AT_ONCE", 7)
    for row, other in zip(robot.check(fitted_motion).table, whole.table, strict=True):
        assert (str(row), row.verdict) == (str(other), other.verdict)
        for spans, known in ((row.violations, other.violations), (row.undecided, other.undecided)):
            np.testing.assert_allclose(spans, known, atol=1e-9)
    assert {len(row.violations) for row in whole.table} >= {0, 1}


def test_deviations_of_a_chain_are_those_of_the_fit(fitted_motion):
    b = validate_limits(ROBOT.with_limits(velocity=9, acceleration=99, snap=1e6), fitted_motion)
    t = np.array([0.004, 1.3, 2.9])
    for kind, order in (("velocity", 1), ("acceleration", 2), ("snap", 4)):
        np.testing.assert_array_equal(compute_deviations(b, t)[kind], fitted_motion.deviations(t, 4)[order])


def test_a_log_with_a_load_that_is_exact_is_measured(fitted_motion):
    load = jounce.Motion.fourier([0, 0, 1.0, 0, 0, 0], *np.zeros((2, 1, 6)), 1.0, 9.0)
    loaded = replace(fitted_motion, loads={ROBOT.body_names[1]: load.curve})
    rows = [ROBOT.with_limits(velocity=9).check(motion).table[0] for motion in (fitted_motion, loaded)]
    assert rows[0].deviation == rows[1].deviation > 0


@pytest.mark.parametrize("exact_first", [False, True])
def test_a_log_next_to_an_exact_motion_is_measured(fitted_motion, exact_first):
    """Which of them comes first changes nothing in the verdict on the log."""
    end = fitted_motion.start if exact_first else fitted_motion.stop
    taylor = np.stack([x[0] / k for x, k in zip(fitted_motion([end], 3), (1, 1, 2, 6), strict=True)], axis=1)
    shift = np.polynomial.Polynomial([-0.1 * exact_first, 1])  # the motion is of 0.1 s
    exact = jounce.Motion.polynomial([np.polynomial.Polynomial(c)(shift).coef for c in taylor], 0.1)
    joined = exact + fitted_motion if exact_first else fitted_motion + exact
    row = ROBOT.with_limits(acceleration=99.0).check(fitted_motion).table[1]
    limited = ROBOT.with_limits(acceleration=[99.0, abs(row.value)])
    rows = [limited.check(motion).table[1] for motion in (fitted_motion, joined)]
    assert [x.verdict for x in rows] == ["undecided"] * 2
    assert rows[1].deviation == pytest.approx(rows[0].deviation, rel=1e-6)


def test_deviations_of_joints_that_follow_in_a_loop():
    """Those of the crank, by the slopes of the closed positions over it."""
    t = np.arange(1000) / 500
    q = 0.9 + 0.4 * np.sin(2 * t) + np.random.default_rng(0).normal(0, 1e-4, t.shape)
    motion = jounce.Motion.fit(t, q[:, None])
    robot = fourbar(1.0, 0.4, 0.9, 0.7, [0.9, -0.6, 1.4])
    names = ("joint1", "joint2", "joint3")
    most = {kind: dict.fromkeys(names, 99.0) for kind in ("upper", "velocity", "acceleration")}
    b = validate_limits(robot.with_limits(lower=dict.fromkeys(names, -99.0), **most), motion)
    at, h = np.array([0.5, 1.1, 1.7]), 1e-4
    (crank, speed), (off, off_of_speed) = motion(at, 1), motion.deviations(at, 1)
    low, middle, high = (robot.coordinates(crank + x) for x in (-h, 0, h))
    slope, bend = (high - low) / (2 * h), (high - 2 * middle + low) / h**2
    found = compute_deviations(b, at)
    assert set(found) == {"position", "velocity", "acceleration"}
    np.testing.assert_allclose(found["position"], np.abs(slope) * off, rtol=1e-3)
    np.testing.assert_allclose(found["velocity"], np.hypot(slope * off_of_speed, bend * speed * off), rtol=1e-3)
    assert (found["acceleration"] > 0).all()


@pytest.mark.parametrize("kind", ["power", "stall_effort"])
def test_deviations_of_products_and_sums(fitted_motion, kind):
    """Those of values drawn about the torque and the velocity."""
    limits = {"power": 99.0} if kind == "power" else {"stall_effort": [99.0, 50.0], "no_load_velocity": 3.0}
    b = validate_limits(ROBOT.with_limits(effort=99, velocity=9, **limits), fitted_motion)
    t = np.array([0.004, 1.3, 2.9])
    off, values = compute_deviations(b, t), b.values(t)
    rng = np.random.default_rng(0)
    Q, qd = (rng.normal(values[x], off[x], (100_000, 3, 2)) for x in ("effort", "velocity"))
    drawn = Q * qd if kind == "power" else Q + [33.0, 50 / 3] * qd
    np.testing.assert_allclose(off[kind], drawn.std(axis=0), rtol=0.02)


@pytest.mark.parametrize("kind", ["velocity", "effort_rate", "effort"])
@pytest.mark.parametrize("options", [{}, {"rate": 250.0}])
def test_a_slowed_log_is_surely_kept(fitted_motion, kind, options):
    """The largest factor: of a tenth of a percent faster the same check says that it is not surely kept."""
    found = ROBOT.with_limits(**{kind: 1e6}).check(fitted_motion, **options)
    limited = ROBOT.with_limits(**{kind: [0.9 * abs(row.value) for row in found.table]})
    slow = limited.slowdown(fitted_motion, **options)
    assert (slow.verdict, slow.binding.limit, slow.factor < 1) == ("broken", kind, True)
    assert limited.check(slow.motion, **options).verdict == "kept"
    assert limited.check(fitted_motion.scaled(0.999 / slow.factor), **options).verdict != "kept"
    assert not any("not every limit" in note for note in slow.notes)


@pytest.mark.parametrize("deviations", [-1, 1, 3])
def test_a_slowed_log_says_what_stays_undecided(fitted_motion, deviations):
    """A position at its bound is decided at no speed: the velocity is surely kept all the same."""
    top = np.abs(fitted_motion.times[fitted_motion(fitted_motion.times, 0)[0][:, 0].argmax()])
    upper = fitted_motion(top, 0)[0][0] + deviations * fitted_motion.deviations([top], 0)[0][0, 0]
    limited = ROBOT.with_limits(upper=[upper, 9], lower=-9, velocity=[2, 9])
    slow = limited.slowdown(fitted_motion)
    verdicts = {row.limit: row.verdict for row in limited.check(slow.motion).table if row.joint == "joint1"}
    assert verdicts == {"position": "kept" if deviations > 2 else "undecided", "velocity": "kept"}
    assert [note for note in slow.notes if "position of joint1 at t = " in note] == list(
        slow.notes[len(slow.notes) - (deviations < 2) :]
    )


@pytest.mark.parametrize(("margin", "verdict"), [(0.0, "undecided"), (0.2, "kept")])
def test_a_retimed_log_says_what_it_does_not_surely_keep(margin, verdict):
    t = np.linspace(0, 2, 1001)
    way = np.polynomial.Polynomial([0, 0, 0, 10, -15, 6])(t / 2)
    motion = jounce.Motion.fit(
        t, np.stack([way, -way / 2], axis=1) + np.random.default_rng(0).normal(0, 1e-5, (1001, 2))
    )
    limited = ROBOT.with_limits(velocity=[2.0, 9], acceleration=99)
    fast = limited.retime(motion, margin=margin)
    found = limited.check(fast.motion)
    assert (found.verdict, len(fast.notes)) == (verdict, verdict == "undecided")
    for row in found.table:
        assert any(f"{row.limit} of {row.joint} at t = " in note for note in fast.notes) == (row.verdict != "kept")


def test_where_samples_do_not_decide_the_verdict_is_undecided(fitted_motion):
    bound = 1.1 * np.abs(truth(DENSE, 4)).max(axis=0)
    found = ROBOT.with_limits(snap=bound, velocity=99).check(fitted_motion)
    assert (found.verdict, found.ok) == ("undecided", False)
    assert {row.verdict for row in found.table} == {"kept", "undecided"}
    assert (found.judged["velocity"], found.judged["snap"] < 1) == (1, True)
    row = max(found.table, key=lambda row: len(row.undecided))
    assert {row.undecided[0][0], row.undecided[-1][1]} & {0.0, T[-1]}
    assert "of the time for snap" in repr(found)


@cache
def fitted(seed):
    """A motion through noisy samples, and the largest true rates and forces along it."""
    rng = np.random.default_rng(seed)
    t = T[: rng.integers(900, len(T))] + rng.uniform(-5, 5)
    motion = jounce.Motion.fit(t, noisy_log(seed, 10 ** rng.uniform(-5, -3.5))[: len(t)], allow_noise=True)
    at = DENSE[t[-1] - t[0] >= DENSE]
    rates = dict(zip(("position", "velocity", "acceleration", "jerk"), (truth(at, k) for k in range(4)), strict=True))
    rates |= dict(zip(("effort", "effort_rate"), true_rates(at)[:2], strict=True))
    return motion, {kind: np.abs(values).max(axis=0) for kind, values in rates.items()}


@pytest.mark.sweep(10)
@pytest.mark.parametrize("kind", ["velocity", "acceleration", "jerk", "effort", "effort_rate"])
@pytest.mark.parametrize("seed", range(6))
def test_verdicts_agree_with_the_truth(seed, kind):
    motion, peaks = fitted(seed)
    assert ROBOT.with_limits(**{kind: 1.4 * peaks[kind]}).check(motion).verdict != "broken"
    assert ROBOT.with_limits(**{kind: 0.7 * peaks[kind]}).check(motion).verdict != "kept"


@pytest.mark.filterwarnings("ignore:.*rounding of .* or t:jounce.JounceWarning")
@pytest.mark.parametrize("end", [0, -1])
def test_peaks_between_rows_count_where_stamps_are_uncertain(end):
    """Deviations of rounded stamps go with the next rate: rows at an end where that is large are outside of windows."""
    t = 1.7e9 + np.pi * np.array([0, 20.1, 40.3, 60.2, 80.4])
    rows = np.array([[0.4, 0.01, 1e-3, 1e-6]] * 5)
    rows[end, 3] = 1e-3 * (end == 0) or -1e-3
    rates = ("q", "qd", "q2d", "q3d")
    table = {f"{joint}.{rate}": rows[:, k] for joint in ROBOT.joint_names for k, rate in enumerate(rates)}
    motion = jounce.load_motion({"t": t, **table}, ROBOT, 1)
    rate = np.abs(motion(np.linspace(motion.start, motion.stop, 100001), 2)[2][:, 0])
    limited = ROBOT.with_limits(acceleration=0.999 * rate.max())
    window = validate_limits(limited, motion).windows["acceleration"]
    assert (window[0] == motion.start, window[1] == motion.stop) == (end == -1, end == 0)
    found = limited.check(motion)
    assert found.verdict == "broken"
    assert found.worst.ratio == pytest.approx(1 / 0.999, rel=1e-6)
    assert ROBOT.with_limits(acceleration=1.001 * rate.max()).check(motion).verdict == "kept"


def test_exact_motions_are_judged_all_the_time():
    motion = jounce.Motion.polynomial([[0, 1.0], [0, 0.5]], 1.0)
    for velocity, verdict in ((0.9, "broken"), (1.0, "kept")):
        found = ROBOT.with_limits(velocity=velocity, effort=1e3, upper=9, lower=-9).check(motion)
        assert (found.verdict, found.judged) == (verdict, {"velocity": 1.0, "effort": 1.0, "position": 1.0})
        assert {row.certain for row in found.table} == {None}
        assert {0.0, 1.0} <= {row.t for row in found.table}  # where the worst values are


@pytest.mark.parametrize(
    ("spans", "joined"),
    [
        ([], ()),
        ([(2, 3), (0, 1)], ((0, 1), (2, 3))),
        ([(0, 2), (1, 3)], ((0, 3),)),
        ([(0, 1), (1, 2), (5, 6)], ((0, 2), (5, 6))),
        ([(0, 3), (1, 2)], ((0, 3),)),
        ([(0, 1), (2, 4), (3, 5), (7, 7)], ((0, 1), (2, 5), (7, 7))),
    ],
)
def test_spans_that_overlap_or_meet_are_one(spans, joined):
    assert join_spans(spans) == joined


def test_kinds_that_are_judged_all_the_time_are_not_named():
    judged = {"velocity": 1.0, "effort_rate": 0.99996, "snap": 0.5, "power": 0.0}
    shares = "99.99% of the time for effort rate, 50.00% of the time for snap"
    assert describe_judged(judged) == [f"judged: {shares}", "not judged: power"]
    assert describe_judged({"velocity": 1.0}) == []


@pytest.fixture(scope="module")
def verdict_files(tmp_path_factory):
    """Robot files whose limits the log keeps, breaks and leaves undecided, by verdict."""
    folder = tmp_path_factory.mktemp("verdicts")
    snap = np.abs(truth(DENSE, 4)).max(axis=0)
    limits = {"kept": {"velocity": 99}, "broken": {"upper": 0.5}, "undecided": {"snap": 1.1 * snap}}
    files = {verdict: folder / f"{verdict}.yaml" for verdict in limits}
    for verdict, file in files.items():
        jounce.save(ROBOT.with_limits(**limits[verdict]), file)
    (folder / "logs").mkdir()
    q = noisy_log()
    tables.write(folder / "logs" / "log.csv", {"t": T, "joint1": q[:, 0], "joint2": q[:, 1]})
    return files


@pytest.mark.parametrize(("verdict", "code"), [("kept", 0), ("broken", 1), ("undecided", 3)])
def test_commands_state_verdict_share_and_exit_code(verdict_files, tmp_path, verdict, code):
    logs = verdict_files[verdict].parent / "logs"

    for motion in (logs / "log.csv", logs):
        result = call("check", verdict_files[verdict], motion, "--json")
        assert result.exit_code == code, result.output
        data = json.loads(result.stdout)
        assert (data["verdict"], data["ok"]) == (verdict, verdict == "kept")
        assert (min(data["judged"].values()) < 1) == (verdict == "undecided")
        words = call("check", verdict_files[verdict], motion).stdout
        assert ("of the time for snap" in words) == (verdict == "undecided")
        assert ("every limit is kept" in words) == (verdict == "kept")
        assert ("undecided" in words) == (verdict == "undecided")
    table = tmp_path / "limits.csv"
    assert call("check", verdict_files[verdict], logs, "-o", table).exit_code == code
    assert verdict in table.read_text()
    page = tmp_path / "report.html"
    result = call("report", verdict_files[verdict], logs / "log.csv", "-o", page, "--json")
    assert (result.exit_code, json.loads(result.stdout)["verdict"]) == (0, verdict)
    assert f'class="verdict {verdict}"' in page.read_text(encoding="utf-8")


ARM = jounce.load("planar2r").with_limits(effort=[60, 15])


def vibrating(frequency, amplitude, *, rest=False, noise=1e-5, rate=1000.0, count=2000):
    """Times and positions of a slow motion, or of rest, with a vibration of the first joint."""
    t = np.arange(count) / rate
    q = np.stack([0.3 * np.sin(1.1 * t), 0.4 * np.cos(0.9 * t)], axis=1) * (not rest)
    q[:, 0] += amplitude * np.sin(2 * np.pi * frequency * t + 0.3)
    return t, q + noise * np.random.default_rng(0).normal(size=q.shape)


@pytest.mark.sweep(8)
@pytest.mark.parametrize("rest", [False, True])
@pytest.mark.parametrize("amplitude", [1e-4, 1e-3])
@pytest.mark.parametrize("frequency", [145, 220, 333, 470])
@pytest.mark.parametrize("options", [{}, {"bandwidth": 10.0}])
def test_a_log_that_vibrates_beyond_its_band_is_not_kept(options, frequency, amplitude, rest):
    """M11 A w^2 is 8 to 2,000 times the limit; one rule for the default and for stated bandwidths."""
    t, q = vibrating(frequency, amplitude, rest=rest)
    motion = jounce.Motion.fit(t, q, allow_noise=True, **options)
    found = ARM.check(motion)
    assert (found.verdict, found.ok) != ("kept", True)
    for row in found.table:
        assert row.verdict in ("broken", "undecided"), row
        assert (row.cause is None) == (not row.undecided)
    assert ARM.check(motion.sampled(1000.0)).verdict != "kept"  # of commands likewise


@pytest.mark.parametrize(
    ("share", "verdict"), [(0.9, "broken"), (0.9999, "undecided"), (1.0001, "undecided"), (1.1, "kept")]
)
def test_two_deviations_decide_in_the_middle_of_a_log_too(share, verdict):
    t, q = vibrating(1, 0.0, noise=1e-4)
    motion = jounce.Motion.fit(t, q)
    robot = jounce.load("planar2r").with_limits(velocity=9.0)
    row = robot.check(motion).table[1]
    inside = 0.01 < row.t < t[-1] - 0.01
    found = robot.with_limits(velocity=[9.0, share * abs(row.value)]).check(motion).table[1]
    assert inside
    assert 5e-5 < row.deviation * 9 / abs(row.value) < 0.04
    assert found.verdict == verdict


@pytest.mark.parametrize("rest", [False, True])
@pytest.mark.parametrize("frequency", [145, 333, 470])
def test_a_short_burst_beyond_the_band_is_not_kept(frequency, rest):
    t, q = vibrating(1, 0.0, rest=rest, count=4000)
    q[:, 0] += 1e-3 * np.sin(2 * np.pi * frequency * t) * ((t > 1.5) & (t < 1.55))
    assert ARM.check(jounce.Motion.fit(t, q, allow_noise=True)).verdict != "kept"


def test_a_clean_log_is_kept():
    t, q = vibrating(1, 0.0)
    found = ARM.check(jounce.Motion.fit(t, q))
    assert (found.verdict, found.judged["effort"]) == ("kept", 1.0)
