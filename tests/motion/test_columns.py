"""Columns and units of real tables: found by name, converted, suspected, or refused with the option that cures it."""

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

import jounce
from jounce.io import tables
from support.commands import call
from support.refusals import refusal

EXAMPLES = Path(__file__).parents[2] / "examples"
PLANAR = jounce.load("planar2r")
PANDA = jounce.load(EXAMPLES / "panda.urdf", lock={"panda_finger_joint1": 0.02})
T = np.linspace(0, 2, 401)
Q = np.stack([np.sin(2 * T), 0.5 * np.cos(3 * T)], axis=1)
PLAIN = {"t": T, "joint1": Q[:, 0], "joint2": Q[:, 1]}
POSTURE = np.array([0, -0.785, 0, -2.356, 0, 1.571, 0.785])
ARM = POSTURE + 0.3 * np.sin(T)[:, None]
NAMES = PANDA.joint_names
RATES = ("q", "qd", "q2d", "q3d", "q4d")


def angles(scale=1.0, pattern="{}"):
    return {pattern.format(name): scale * ARM[:, j] for j, name in enumerate(NAMES)}


def rate_rows(scale=lambda k: 1.0, title=lambda name, k: f"{name}.{RATES[k]}"):
    exact = [ARM, *(0.3 * np.sin(T + k * np.pi / 2)[:, None] * np.ones(7) for k in range(1, 5))]
    return {title(name, k): scale(k) * exact[k][:, j] for j, name in enumerate(NAMES) for k in range(5)}


def same(motion, expected=Q):
    np.testing.assert_allclose(motion(T, 0)[0], expected, atol=1e-12)
    return motion


DEGREES = 180 / np.pi
READ = {
    "time": ({"time": T, **PLAIN} | {}, {"time": "time"}),
    "Timestamp": ({"Timestamp": T, "joint1": Q[:, 0], "joint2": Q[:, 1]}, {}),
    "a column of times": ({"clock": T, "t": T[::-1], "joint1": Q[:, 0], "joint2": Q[:, 1]}, {"time": "clock"}),
    "a pattern": ({"t": T, "q_joint1": Q[:, 0], "q_joint2": Q[:, 1], "joint1": 0 * T}, {"columns": "q_{joint}"}),
    "numbers": ({"t": T, "q1": Q[:, 0], "q2": Q[:, 1]}, {"columns": "q{number}"}),
    "an array": ({"t": T, "q": Q}, {"columns": "q[{index}]"}),
    "units in names": ({"time [ms]": 1e3 * T, "joint1 [deg]": DEGREES * Q[:, 0], "joint2 (rad)": Q[:, 1]}, {}),
    "degrees": ({"t": T, "joint1": DEGREES * Q[:, 0], "joint2": DEGREES * Q[:, 1]}, {"angles": "deg"}),
    "milliseconds": ({"t": 1e3 * T, "joint1": Q[:, 0], "joint2": Q[:, 1]}, {"time_unit": "ms"}),
}


@pytest.mark.parametrize(("columns", "options"), READ.values(), ids=READ)
def test_columns_are_found_and_converted(columns, options):
    same(jounce.load_motion(columns, PLANAR, **options))


def test_units_of_rates():
    titles = ("deg", "deg/s", "deg/s^2", "deg/s3", "deg/s⁴")
    table = rate_rows(lambda k: DEGREES, lambda name, k: f"{name}.{RATES[k]} [{titles[k]}]")
    motion = jounce.load_motion({"t": T} | table, PANDA)
    for k, rate in enumerate(motion(T)):
        np.testing.assert_allclose(rate[:, 2], rate_rows()[f"{NAMES[2]}.{RATES[k]}"], atol=1e-12)


def test_other_columns_are_left_alone_and_listed():
    other = {"state": ["moving"] * len(T), "joint1.current": np.full(len(T), np.nan), "load [kg]": T}
    motion = same(jounce.load_motion(PLAIN | {"tau_joint2": 3 * T} | other, PLANAR))
    assert motion.notes == ("other columns, ignored: state, joint1.current, load [kg]",)
    np.testing.assert_array_equal(motion.torques[1][:, 1], 3 * T)
    assert np.isnan(motion.torques[1][:, 0]).all()


def test_measured_torques_are_found_by_a_pattern_in_N_m():
    log = {"t": T, "q1": Q[:, 0], "q2": Q[:, 1], "tau1 [N m]": T, "tau2 [Nm]": 2 * T}
    motion = same(jounce.load_motion(log, PLANAR, columns="q{number}", torques="tau{number}"))
    np.testing.assert_array_equal(motion.torques[1], np.stack([T, 2 * T], axis=1))
    assert motion.notes == ()
    load = partial(jounce.load_motion, PLAIN | {"tau_joint1 [mNm]": T}, PLANAR)
    refusal(load, "column 'tau_joint1 [mNm]': unknown unit 'mNm'", "N, N m")
    refusal(lambda: load(torques="m{number}"), "torques 'm{number}': no column 'm1', 'm2'")
    refusal(lambda: load(torques="m"), "torques 'm' names 'm' for every joint; expected {joint}")


@pytest.mark.parametrize("separator", [",", ";", "\t", "  "])
@pytest.mark.parametrize("decimal", [".", ","])
def test_separators_of_csv(tmp_path, separator, decimal):
    if separator == decimal:
        return
    path = tmp_path / "m.csv"
    lines = [separator.join(f"{x!r}".replace(".", decimal) for x in row) for row in np.c_[T, Q, T].tolist()]
    path.write_text("\n".join([separator.join(["time", "joint1", "joint2", "mode"]), *lines]))
    same(jounce.load_motion(path, PLANAR))


def test_only_the_columns_of_the_motion_have_to_be_numbers(tmp_path):
    path = tmp_path / "m.csv"
    path.write_text(
        "t,state,joint1,joint2\n" + "".join(f"{t!r},at rest,{a!r},{b!r}\n" for t, (a, b) in zip(T, Q, strict=True))
    )
    text = path.read_text().replace("np.float64(", "").replace(")", "")
    path.write_text(text)
    same(jounce.load_motion(path, PLANAR))
    path.write_text(text.replace("at rest,0.0,", "at rest,none,", 1))
    words = (
        "m.csv:2: column 'joint1' holds 'none'; expected a finite number; repair or remove the row",
        "or lock= of jounce.load",
    )
    refusal(lambda: jounce.load_motion(path, PLANAR), *words)
    path.write_text(text.replace("at rest,0.0,", "at rest,nan,", 1))
    refusal(lambda: jounce.load_motion(path, PLANAR), "holds 'nan'", "lock= of jounce.load")


def test_matlab_files(tmp_path):
    path = tmp_path / "m.mat"
    savemat(path, {"t": T[:, None], "q": Q, "log": {"joint1": Q[:, 0], "name": "x"}, "note": "text"})
    same(jounce.load_motion(path, PLANAR, columns="q[{index}]"))
    savemat(path, {"log": {"time": T, "joint1": Q[:, 0], "joint2": Q[:, 1]}})
    same(jounce.load_motion(path, PLANAR, time="log.time", columns="log.{joint}"))
    path.write_bytes(b"MATLAB 7.3 MAT-file" + bytes(200))
    refusal(lambda: jounce.load_motion(path, PLANAR), "m.mat: ", "MAT file")


def test_json_lines(tmp_path, monkeypatch):
    monkeypatch.setattr(jounce.io.whole_tables, "ROWS_PER_JSON_PIECE", 7)
    path = tmp_path / "m.jsonl"
    path.write_text(
        "\n".join(json.dumps({"t": t, "q": list(q), "state": {"mode": "x"}}) for t, q in zip(T, Q, strict=True))
    )
    motion = same(jounce.load_motion(path, PLANAR, columns="q[{index}]"))
    assert motion.notes == ("other columns, ignored: state.mode",)
    for text, words in (
        (
            '{"t": 0, "joint1": 1, "joint2": null}',
            ["m.jsonl:1: column 'joint2' holds 'None'; expected a finite number"],
        ),
        ('{"t": 0, "joint1": 1, "joint2": 2}\n{"t": 1}', ["m.jsonl:2: no 'joint1' in this row; it has: t"]),
        ("[1]", ["m.jsonl:1: not a line of JSON"]),
        ("", ["the table is empty"]),
    ):
        path.write_text(text)
        refusal(lambda: jounce.load_motion(path, PLANAR), *words)


REFUSED = {
    "degrees, by the limits": (PANDA, {"t": T} | angles(DEGREES), {},
        ["would be within limits if they were degrees", "angles='deg' or"]),
    "degrees, without limits": (PLANAR, {"t": T, "joint1": 90 * Q[:, 0], "joint2": T}, {},
        ["joint 'joint1' goes from -68.11 to 90 rad", "more than four turns", "angles='deg'"]),
    "degrees per second": (PANDA, {"t": T} | rate_rows(lambda k: DEGREES if k else 1), {},
        ["qd looks like degrees per second: name the column NAME.qd [deg/s]"]),
    "milliseconds": (PANDA, {"t": 1e3 * T} | angles(), {},
        ["rows are 5 s apart", "t looks like ms; state the unit by time_unit='ms' or"]),
    "nanoseconds": (PANDA, {"t": 1e9 * T + 1e9} | angles(), {}, ["t looks like ns; state the unit by time_unit='ns'"]),
    "milliseconds beside rates": (PANDA, {"t": 1e3 * T} | rate_rows(), {}, ["t looks like ms", "time_unit='ms'"]),
    "unordered stamps": (PLANAR, PLAIN | {"t": T[::-1]}, {},
        ["column 't' does not increase: 2.0 comes before 0.0", "with time, columns"]),
    "no times": (PLANAR, {"joint1": T, "joint2": T}, {}, ["missing 't'", "name another column of times by time="]),
    "an unknown column of times": (PLANAR, PLAIN, {"time": "tiem"},
        ["time: unknown column 'tiem'", "t, joint1, joint2"]),
    "a missing joint": (PLANAR, {"t": T, "joint1": T}, {}, ["missing 'joint2'", "hold joint2 by lock=", "columns="]),
    "an unknown unit": (PLANAR, {"t": T, "joint1 [gon]": T, "joint2": T}, {},
        ["column 'joint1 [gon]': unknown unit 'gon'", "rad, deg"]),
    "the unit of another rate": (PLANAR, {"t": T, "joint1 [deg/s]": T, "joint2": T}, {},
        ["'joint1 [deg/s]': the unit is 'deg/s'; expected deg"]),
    "two units": (PLANAR, {"t": T, "joint1 [rad]": T, "joint2": T}, {"angles": "deg"},
        ["states its unit, but 'deg' is asked for"]),
    "one name in two units": (PLANAR, PLAIN | {"joint1 [deg]": T}, {},
        ["columns 'joint1' and 'joint1 [deg]' have the same"]),
    "no such unit": (PLANAR, PLAIN, {"angles": "grad"}, ["unknown unit of angles 'grad'", "rad, deg"]),
    "no such unit of time": (PLANAR, PLAIN, {"time_unit": 1}, ["unknown unit of time_unit 1", "s, ms, us, ns"]),
    "a pattern without joints": (PLANAR, PLAIN, {"columns": "q"},
        ["columns 'q' names 'q' for every joint; expected {joint}"]),
    "a pattern of something else": (PLANAR, PLAIN, {"columns": "q_{name}"}, ["columns 'q_{name}'", "expected {joint}"]),
    "a pattern that fits nothing": (PLANAR, PLAIN, {"columns": "q_{joint}"}, ["no column 'q_joint1', 'q_joint2'"]),
    "forces": (PLANAR, {"t": T, "joint1.Q": T, "joint2.Q": T}, {},
        ["holds forces, 'joint1.Q', ..., and not the motion; expected t and joint1, joint2: 'jounce run --rates'"]),
    "too few samples": (PLANAR, {k: v[:5] for k, v in PLAIN.items()}, {}, ["5 samples", "degree=7"]),
}  # fmt: skip


@pytest.mark.parametrize(("robot", "columns", "options", "words"), REFUSED.values(), ids=REFUSED)
def test_refuses_with_what_cures_it(robot, columns, options, words):
    refusal(lambda: jounce.load_motion(columns, robot, **options), "the motion: " if not options else "", *words)


@pytest.mark.parametrize("columns", [angles(), rate_rows()], ids=["samples", "rates"])
def test_right_units_and_those_that_are_stated_raise_no_suspicion(columns):
    jounce.load_motion({"t": T} | columns, PANDA)
    jounce.load_motion({"t": 1e3 * T} | columns, PANDA, time_unit="s") if "panda_joint1" in columns else None


def test_broken_limits_are_warned_of():
    far = {"t": T} | angles() | {"panda_joint1": 6 * np.sin(T)}
    with pytest.warns(jounce.JounceWarning, match=r"'panda_joint1' goes from 0 to 6 rad .* but its limits are -2\.897"):
        jounce.load_motion(far, PANDA, angles="rad")
    open_hand = {"t": T} | angles() | {"panda_finger_joint1": np.full(len(T), 0.9)}
    with pytest.warns(jounce.JounceWarning, match=r"'panda_finger_joint1' goes from 0\.9 to 0\.9 m"):
        jounce.load_motion(open_hand, jounce.load(EXAMPLES / "panda.urdf"))


def turning_samples(speed):
    """Samples of a joint without limits that turns over at a speed, rad/s or deg/s, next to one that swings."""
    t = np.linspace(0, 20, 201)
    return {"t": t, "joint1": speed * t, "joint2": 0.3 * np.sin(t)}


def test_a_joint_that_turns_over_is_not_refused():
    """Its range is nowhere stated, and its speed is one of radians: 40 rad in 20 s."""
    with pytest.warns(jounce.JounceWarning, match="'joint1' goes from 0 to 40 rad .* right if it turns over"):
        jounce.load_motion(turning_samples(2.0), PLANAR)
    jounce.load_motion(turning_samples(2.0), PLANAR, angles="rad")
    jounce.load_motion(turning_samples(1.2), PLANAR)  # 24 rad are less than four turns
    refusal(lambda: jounce.load_motion(turning_samples(70.0), PLANAR), "would be within limits if they were degrees")
    slow = PLANAR.with_limits(velocity=[0.5, np.inf])
    refusal(lambda: jounce.load_motion(turning_samples(2.0), slow), "would be within limits if they were degrees")
    bounded = PLANAR.with_limits(lower=[-3, -np.inf], upper=[3, np.inf])
    refusal(lambda: jounce.load_motion(turning_samples(2.0), bounded), "would be within limits if they were degrees")


def test_the_command_takes_the_same_options(tmp_path):
    table = {"stamp": 1e3 * T} | {f"q_{name}": DEGREES * ARM[:, j] for j, name in enumerate(NAMES)} | {"load": T}
    tables.write(tmp_path / "log.csv", table)
    tables.write(tmp_path / "plain.csv", {"t": T} | angles())
    robot = [str(EXAMPLES / "panda.urdf"), "--lock", "panda_finger_joint1=0.02"]
    stated = ["--time", "stamp", "--time-unit", "ms", "--angles", "deg", "--columns", "q_{joint}"]
    results = [
        call("run", *robot, tmp_path / name, "-o", tmp_path / f"{i}.npz", *options)
        for i, (name, options) in enumerate([("log.csv", stated), ("plain.csv", [])])
    ]
    assert [result.exit_code for result in results] == [0, 0], results[0].output
    assert "other columns, ignored: load" in results[0].output
    a, b = (tables.read(tmp_path / f"{i}.npz") for i in (0, 1))
    for name, column in b.items():
        np.testing.assert_allclose(a[name], column, rtol=1e-4, atol=1e-3, err_msg=name)
