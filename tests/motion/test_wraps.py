"""Angles that wrap at a turn are refused by name, and read as if they did not where that is asked for."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import jounce
from jounce.io import tables
from jounce.motion.wraps import MAX_DOUBT, MAX_OFF_TURNS, TURN, Turning, refuse_wraps, unwrap
from support.commands import call
from support.files import BODY, joint, link, robot_file
from support.refusals import expect_refusal, refusal

WRAPPED = Path(__file__).with_name("wrapped.csv")
T = np.arange(600) / 100
SWEEP = np.stack([4 * np.sin(T), 3 + 2 * np.cos(1.3 * T), 0.3 * np.sin(2 * T)], axis=1)
JOINTS = Turning.of_columns(("a", "b", "c"))


@pytest.fixture
def continuous_arm(tmp_path):
    """Two continuous joints, a slide, and a joint with limits."""
    limit = '<limit lower="-0.5" upper="0.5" velocity="3" effort="9"/>'
    slide = '<limit lower="-9" upper="9" velocity="3" effort="9"/>'
    kinds = {"a": ("continuous", ""), "b": ("continuous", ""), "x": ("prismatic", slide), "c": ("revolute", limit)}
    items, parent = [link("base")], "base"
    for name, (kind, inner) in kinds.items():
        items += [link(f"{name}_link", BODY), joint(name, parent, f"{name}_link", kind, inner=inner)]
        parent = f"{name}_link"
    return jounce.load(robot_file(tmp_path, *items))


def wrapped(q, low, period=TURN):
    return (q - low) % period + low


def first_wrap(q):
    row, column = np.argwhere(np.abs(np.diff(q, axis=0)) > 2)[0]
    return int(row) + 1, "abc"[column]


def test_a_log_in_degrees_has_its_right_values(tmp_path):
    """It was called white noise that wants 5 bits more."""
    names = ("ja", "jb", "jc")
    items = [link(x, BODY) for x in ("base", *names)]
    chain = [joint(x, y, x, "continuous") for x, y in zip(names, ("base", *names), strict=False)]
    robot = jounce.load(robot_file(tmp_path, *items, *chain))
    refusal(
        lambda: jounce.load_motion(WRAPPED, robot, 0, angles="deg"),
        "joint 'jc' wraps from 0.0003176 to 6.279 at t = 1.58 s, row 158 from 0",
        "angles wrap: ja 1 time, jc 2 times; unwrap=True removes the turns",
    )
    refusal(lambda: jounce.load_motion(WRAPPED, robot, 0), "joint 'ja' jumps", "a turn in degrees; state the unit")
    motion = jounce.load_motion(WRAPPED, robot, 0, angles="deg", unwrap=True)
    t = np.linspace(0.5, 5.5, 200)
    truth = np.stack([2.2 * np.sin(0.9 * t), 2.6 + 0.9 * np.sin(0.7 * t), 0.4 * np.cos(t)], axis=1)
    assert np.abs(motion(t, 0)[0] - truth).max() < 2e-5  # the noise of one row
    assert any("turns are counted from the first row on" in note for note in motion.notes)


@pytest.mark.parametrize("low", [0, -np.pi, -1.3])
@pytest.mark.parametrize("noise", [0, 1e-3, 0.02])
@pytest.mark.parametrize("gap", [0, 20])
def test_unwrapped_angles_are_the_original_ones_but_for_whole_turns(low, noise, gap):
    """Several wraps, back and forth in noise at the end of the range, and one in a gap of rows."""
    rng = np.random.default_rng(1)
    q = SWEEP + noise * rng.normal(size=SWEEP.shape)
    row, _ = first_wrap(wrapped(q, low))
    kept = np.r_[: row - gap // 2, row + gap - gap // 2 : len(T)]
    t, q = T[kept], q[kept]
    given = wrapped(q, low)
    number, name = first_wrap(given)
    refusal(lambda: refuse_wraps(t, given, JOINTS, "log"), f"log: joint '{name}' wraps from", f"row {number} from 0")
    found, notes = unwrap(t, given, JOINTS, "log")
    assert np.allclose(found - found[0], q - q[0], atol=1e-12, rtol=0)
    assert np.array_equal(found[0], given[0])
    assert len(notes) == 1


@pytest.mark.parametrize("period", [2 * TURN, 4 * TURN])
def test_encoders_of_several_turns_wrap_at_whole_turns(period):
    q = np.stack([3 * TURN * np.sin(0.5 * T)], axis=1)
    found, _ = unwrap(T, wrapped(q, 0, period), Turning.of_columns(("a",)), "log")
    assert np.allclose(found, q, atol=1e-12)


@pytest.mark.parametrize("period", [0.6, 5.0, 7.0, 40.0, 4000.0])
@pytest.mark.parametrize("read", [refuse_wraps, unwrap])
def test_wraps_at_another_period_are_refused_by_name(period, read):
    q = np.stack([0 * T, period * 1.3 * np.sin(T)], axis=1)
    q[:, 1] = wrapped(q[:, 1], 0, period)
    row = int(np.argmax(np.abs(np.diff(q[:, 1])) > period / 2)) + 1
    refusal(
        lambda: read(T, q, Turning.of_columns(("a", "b")), "log"),
        "joint 'b' jumps against its motion",
        "at the end of a range, which is not 2 pi but",
        f"t = {T[row]:.9g} s, row {row} from 0",
    )


def stepped_sweep(size, at_rest=True):
    q = 0 * SWEEP if at_rest else SWEEP.copy()
    q[300:, 1] += size
    return q


OTHERS = {
    "step": stepped_sweep(3.5),
    "step of a moving joint": stepped_sweep(5.0, at_rest=False),
    "nearly a turn": stepped_sweep(TURN - 1.05 * MAX_OFF_TURNS),
    "pulse": stepped_sweep(1.0) - np.roll(stepped_sweep(1.0), 40, axis=0) * (T[:, None] < 5),
    "wild row": SWEEP + 900.5 * (np.arange(600) == 300)[:, None],
    "fast joint": np.stack([300 * T, -290 * T, 0 * T], axis=1),
    "step in noise": stepped_sweep(3.5) + 1e-4 * np.random.default_rng(0).normal(size=SWEEP.shape),
    "joint of 4 rad a row": np.stack([400 * T, -700 * T, 0 * T], axis=1),
    "few rows": stepped_sweep(TURN)[290:310],
}


@pytest.mark.parametrize("q", OTHERS.values(), ids=OTHERS)
def test_what_jumps_otherwise_does_not_wrap(q):
    t = T[: len(q)]
    refuse_wraps(t, q, JOINTS, "log")
    found, notes = unwrap(t, q, JOINTS, "log")
    assert (np.array_equal(found, q) and not notes) == (len(q) > 20)


@pytest.mark.parametrize(("off", "wraps"), [(0.95, True), (1.05, False)])
def test_a_wrap_may_miss_whole_turns_a_little(off, wraps):
    _, notes = unwrap(T, stepped_sweep(TURN - off * MAX_OFF_TURNS), JOINTS, "log")
    assert bool(notes) == wraps


@pytest.mark.parametrize(("off", "wraps"), [(0.95, True), (1.05, False)])
def test_steps_that_differ_leave_a_bounded_doubt(off, wraps):
    q = 0 * SWEEP
    q[:, 0] = 0.5 * (np.arange(600) % 2)  # a joint that jitters by 0.5 rad up and down, here up
    q[301:, 0] += TURN + off * MAX_DOUBT
    _, notes = unwrap(T, q, JOINTS, "log")
    assert bool(notes) == wraps


def test_a_wrap_is_faster_than_its_joint_without_being_asked_for():
    slow = stepped_sweep(TURN)[::50]
    slow = np.concatenate([slow] * 4)
    t = np.arange(len(slow)) / 2  # a turn in half a second: 12.6 rad/s
    refuse_wraps(t, slow, JOINTS, "plan")
    refusal(lambda: refuse_wraps(t, slow, replace(JOINTS, fastest=np.full(3, 9.0)), "plan"), "joint 'b' wraps")


@pytest.mark.parametrize(
    ("lower", "upper", "turns"),
    [(-0.5, 0.5, -1), (-TURN, TURN, 0), (0.5, 0.9, 0), (-np.inf, 0.5, 0), (-0.5, np.inf, 0), (8, 13, 1)],
)
def test_angles_are_moved_by_turns_to_within_limits(lower, upper, turns):
    q = TURN - 0.2 + 0.1 * np.sin(T)[:, None]
    joints = replace(Turning.of_columns(("a",)), lower=np.array([lower]), upper=np.array([upper]))
    found, notes = unwrap(T, q, joints, "log")
    assert np.allclose(found, q + turns * TURN)
    assert notes == ((f"angles are moved by whole turns to within their limits: a by {turns:+d}",) if turns else ())


def test_slides_do_not_wrap_and_limits_say_where_a_joint_is(continuous_arm):
    q = np.stack([wrapped(4 * np.sin(T), 0), np.cos(T), 0.3 * np.sin(T), wrapped(0.3 * np.sin(2 * T) - 0.1, 0)], axis=1)
    q += 1e-5 * np.random.default_rng(0).normal(size=q.shape)
    log = {"t": T, **dict(zip("abxc", q.T, strict=True))}
    with expect_refusal("the motion: joint 'c' wraps from", "unwrap=True removes the turns"):
        jounce.load_motion(log, continuous_arm, 0)
    motion = jounce.load_motion(log, continuous_arm, 0, unwrap=True)
    _, samples = motion.samples
    truth = np.stack([4 * np.sin(T), np.cos(T), 0.3 * np.sin(T), 0.3 * np.sin(2 * T) - 0.1], axis=1)
    assert np.abs(samples - truth).max() < 1e-4
    slid = Turning.of_robot(continuous_arm.mechanism)
    assert slid.turns.tolist() == [True, True, False, True]
    jumping = np.zeros((600, 4))
    jumping[300:, 2] = TURN
    refuse_wraps(T, jumping, slid, "log")
    found, _ = unwrap(T, jumping, slid, "log")
    assert np.array_equal(found, jumping)


@pytest.mark.parametrize("way", [{}, {"degree": 7, "intervals": 20}])
def test_a_motion_of_samples_unwraps(way):
    q = SWEEP + 1e-5 * np.random.default_rng(0).normal(size=SWEEP.shape)
    given = wrapped(q, 0)
    refusal(lambda: jounce.Motion.fit(T, given, **way), "the motion: joint 'column 3' wraps", "unwrap")
    found = jounce.Motion.fit(T, given, unwrap=True, **way)
    plain = jounce.Motion.fit(T, q, **way)
    turns = np.round((given[0] - q[0]) / TURN) * TURN
    assert np.abs(found(T, 2)[0] - turns - plain(T, 2)[0]).max() < 1e-7
    assert np.abs(found(T, 2)[2] - plain(T, 2)[2]).max() < 1e-3
    refusal(lambda: jounce.Motion.fit(T, q, unwrap=1), "unwrap is 1; expected True or False")


def test_tables_of_all_rates_and_commands_unwrap(tmp_path):
    robot = "planar2r"
    rates = [[2.0**k * 4 * np.sin(2 * T + k * np.pi / 2), np.cos(T + k * np.pi / 2)] for k in range(5)]
    names = ["q", "qd", "q2d", "q3d", "q4d"]
    table = {"t": T} | {f"joint{j + 1}.{x}": rates[k][j] for k, x in enumerate(names) for j in (0, 1)}
    tables.write(tmp_path / "plain.csv", table)
    tables.write(tmp_path / "wrapped.csv", table | {"joint1.q": wrapped(table["joint1.q"], 0)})

    def run(name, *options):
        words = ["run", robot, str(tmp_path / name), "-o", str(tmp_path / "out.csv"), *options]
        return call(*words)

    refused = run("wrapped.csv")
    assert refused.exit_code == 2
    assert "joint 'joint1' wraps from" in refused.output
    assert run("plain.csv").exit_code == 0
    expected = dict(tables.read(tmp_path / "out.csv"))
    found = run("wrapped.csv", "--unwrap")
    assert found.exit_code == 0, found.output
    for name, x in tables.read(tmp_path / "out.csv").items():
        assert np.allclose(x, expected[name], atol=1e-9), name


def test_a_file_of_options_states_that_angles_wrap(tmp_path):
    q = SWEEP[:, :2] + 1e-5 * np.random.default_rng(0).normal(size=(600, 2))
    tables.write(tmp_path / "log.csv", {"t": T, **dict(zip(("joint1", "joint2"), wrapped(q, 0).T, strict=True))})
    words = ["motion", "planar2r", str(tmp_path / "log.csv"), "-o", str(tmp_path / "out.csv"), "--order", "2"]
    saved = str(tmp_path / "read.yaml")
    assert call(*words, "--unwrap", "--save-read", saved).exit_code == 0
    assert Path(saved).read_text() == "unwrap: true\n"
    result = call(*words, "--read", saved)
    assert result.exit_code == 0, result.output
    assert "angles wrap: joint1 1 time: turns are counted from the first row on" in result.output
