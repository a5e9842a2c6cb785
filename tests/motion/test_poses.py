"""Poses at rest: rows of tables without times, and the holds of logs."""

from itertools import pairwise

import numpy as np
import pytest

import jounce
from support.refusals import refusal, refusals

ROBOT = jounce.load("planar2r")
STEP = 0.01  # s
VISITED = np.array([[0.0, 0.0], [0.5, -0.4], [1.0, 0.4], [0.2, 0.4], [0.8, -0.2]])


def write_hold_log(rest=1.0, noise=1e-5, step=STEP, visited=VISITED, seed=0):
    """Columns of a log that rests in some poses, and moves smoothly between them; torques tell the pose."""
    rng = np.random.default_rng(seed)
    s = np.arange(0, 1, step)[:, None]
    parts = [np.repeat(visited[:1], round(rest / step), axis=0)]
    for start, stop in pairwise(visited):
        parts += [start + (stop - start) * (10 * s**3 - 15 * s**4 + 6 * s**5)]
        parts += [np.repeat(stop[None], round(rest / step), axis=0)]
    q = np.concatenate(parts)
    Q = ROBOT.gravity_forces(q) + 0.1 * rng.normal(size=q.shape)
    q = q + noise * rng.normal(size=q.shape)
    return {"t": step * np.arange(len(q)), **name_columns(q, Q)}


def name_columns(q, Q):
    return {"joint1": q[:, 0], "joint2": q[:, 1], "tau_joint1": Q[:, 0], "tau_joint2": Q[:, 1]}


@pytest.mark.parametrize("noise", [0.0, 1e-5, 1e-4])
def test_holds_of_a_log_are_its_poses(noise):
    poses = jounce.load_poses(write_hold_log(noise=noise), ROBOT)
    assert poses.q == pytest.approx(VISITED, abs=2e-4)
    assert poses.torques == pytest.approx(ROBOT.gravity_forces(VISITED), abs=0.06)
    # Joints that stay have no direction, as joint2 from the third pose to the fourth.
    assert poses.approach.tolist() == np.sign(np.diff(VISITED, axis=0, prepend=VISITED[:1])).tolist()
    assert poses.places[0].startswith("hold from 0 to 0.")
    assert "5 holds of" in poses.notes[-1]


def test_an_encoder_of_12_bits_rests_within_its_steps():
    log, step = write_hold_log(noise=4e-4), 2 * np.pi / 4096
    log |= {name: np.round(log[name] / step) * step for name in ("joint1", "joint2")}
    poses = jounce.load_poses(log, ROBOT)
    assert poses.q == pytest.approx(VISITED, abs=step)


def test_holds_between_which_nothing_moves_are_one():
    """A knock, or a wild sample, does not make two poses of one, whose friction is the same."""
    log = write_hold_log(rest=3.0)
    log["joint1"][450] += 0.02
    assert len(jounce.load_poses(log, ROBOT)) == 6  # 0.02 rad are a motion
    log["joint1"][450] -= 0.0195
    assert len(jounce.load_poses(log, ROBOT)) == 5


def test_where_rows_are_missing_nothing_is_a_hold():
    log = write_hold_log(rest=2.0)
    kept = (log["t"] < 3.2) | (log["t"] > 4.6)
    poses = jounce.load_poses({name: x[kept] for name, x in log.items()}, ROBOT)
    assert poses.q == pytest.approx(np.delete(VISITED, 1, axis=0), abs=1e-4)


def test_signs_follow_an_overshoot():
    """What counts is the side from which a joint came last."""
    log = write_hold_log(rest=2.0)
    t = log["t"]
    log["joint1"] = log["joint1"] + 0.05 * np.exp(-(((t - 3.2) / 0.1) ** 2))
    assert jounce.load_poses(log, ROBOT).approach[1].tolist() == [-1, -1]


def test_torques_that_are_missing_in_a_hold():
    log = write_hold_log()
    log["tau_joint2"][:120] = np.nan
    poses = jounce.load_poses(log, ROBOT)
    assert np.isnan(poses.torques).tolist() == [[False, True], *[[False, False]] * 4]


def test_rows_of_a_table_without_times():
    q = np.linspace([0, 1], [2, 0], 12)
    columns = name_columns(q, ROBOT.gravity_forces(q))
    poses = jounce.load_poses(columns | {"temperature": q[:, 0], "joint2.approach": np.tile([1, -1], 6)}, ROBOT)
    assert (poses.q == q).all()
    assert (poses.approach == np.stack([np.zeros(12), np.tile([1, -1], 6)], axis=1)).all()
    assert poses.notes == ("other columns, ignored: temperature",)
    assert jounce.load_poses(columns, ROBOT).approach is None


def test_units_names_and_rates_are_those_of_tables():
    q = np.linspace([0, 1], [2, 0], 12)
    Q = ROBOT.gravity_forces(q)
    columns = {"a [deg]": np.rad2deg(q[:, 0]), "b": q[:, 1], "load1": Q[:, 0], "load2": Q[:, 1]}
    read = {"columns": {"joint1": "a", "joint2": "b"}, "torques": "load{number}"}
    assert jounce.load_poses(columns, ROBOT, **read).q == pytest.approx(q)
    rates = {f"joint{j}.q{d}": q[:, j - 1] if d == "" else np.full(12, 1e-3) for j in (1, 2) for d in ("", "d")}
    torques = {"tau_joint1": Q[:, 0], "tau_joint2": Q[:, 1]}
    assert (jounce.load_poses(rates | torques, ROBOT).q == q).all()


def test_rows_that_are_said_to_be_poses_are_taken():
    rows = {name: x for name, x in write_hold_log().items() if name != "t"}
    assert len(jounce.load_poses(rows, ROBOT, holds=False)) == len(rows["joint1"])
    assert len(jounce.load_poses({name: x[:199] for name, x in rows.items()}, ROBOT)) == 199
    scattered = np.random.default_rng(0).permutation(len(rows["joint1"]))
    assert len(jounce.load_poses({name: x[scattered] for name, x in rows.items()}, ROBOT)) == len(scattered)


def test_a_file_is_read_by_rows(tmp_path):
    q = np.linspace([0, 1], [2, 0], 12)
    table = name_columns(q, ROBOT.gravity_forces(q))
    lines = [",".join(table), *(",".join(map(repr, row)) for row in np.stack([*table.values()], axis=1).tolist())]
    path = tmp_path / "poses.csv"
    path.write_text("\n".join(lines))
    poses = jounce.load_poses(path, ROBOT)
    assert (poses.q == q).all()
    assert poses.places[3] == f"{path}:5"
    message = refusal(lambda: jounce.load_motion(path, ROBOT), "missing 't'", "time=", "jounce.load_poses reads poses")
    assert message.startswith(str(path))


STILL, LONG = write_hold_log(), write_hold_log(rest=3.0)
DRIFTING = {**STILL, "joint1": STILL["joint1"] + 0.004 * np.clip(STILL["t"] - 2.0, 0, 1)}
CREEPING = {**LONG, "joint1": LONG["joint1"] + 0.0015 * np.clip(LONG["t"] - 4.0, 0, 3)}
ROWS = {name: x[::100] for name, x in STILL.items() if name != "t"}
MOVING = np.linspace(0, 3, 301)
SWING = {"t": MOVING, **name_columns(np.stack([np.sin(MOVING), MOVING], axis=1), np.ones((301, 2)))}
TURNING = {f"joint{j}.q{d}": np.arange(9) * 0.1 for j in (1, 2) for d in ("", "d")}


def leave_out(columns, word):
    return {name: x for name, x in columns.items() if word not in name}


def loading(columns, **options):
    return lambda: jounce.load_poses(columns, ROBOT, **options)


def poses(*given, **options):
    return lambda: jounce.Poses(*given, **options)


test_refuses = refusals({
    "a hold that drifts": (
        loading(DRIFTING), ["joint1 drifts by 0.00", "in the hold from 2", "leave these rows out"],
    ),
    "a hold that creeps": (loading(CREEPING), ["joint1 drifts by 0.002", "hold the pose until it stands"]),
    "a log that never rests": (
        loading(SWING), ["no hold in which all joints rest for 0.5 s", "expected a log that stops in each pose"],
    ),
    "a row for each pose, with times": (
        loading({"t": 10.0 * np.arange(9), **ROWS}), ["rows are 10 s apart", "leave the column of times out"],
    ),
    "a log that lost its times": (
        loading({name: x for name, x in STILL.items() if name != "t"}),
        ["900 rows without times move by less than 2% of their range", "add the column of times", "holds=False"],
    ),
    "holds of a table without times": (loading(ROWS, holds=True), ["has no times", "leave holds out"]),
    "poses of a log": (loading(STILL, holds=False), ["has times", "holds=True takes"]),
    "no torques": (
        loading(leave_out(ROWS, "tau")), ["none of 9 poses has a torque", "tau_JOINT", "torques='tau{number}'"],
    ),
    "no torques in a log": (loading(leave_out(STILL, "tau")), ["none of 5 poses has a torque", "tau_JOINT"]),
    "a pose that moves": (
        loading(TURNING | leave_out(leave_out(ROWS, "joint1"), "joint2") | {"tau_joint1": ROWS["tau_joint1"]}),
        ["row 1 from 0: joint1 moves at 0.1 rad/s", "leave this row out, or add the column of times"],
    ),
    "a direction of another size": (
        loading(ROWS | {"joint1.approach": np.full(9, 2.0)}),
        ["row 0 from 0: column 'joint1.approach' holds 2", "expected 1 of a joint that moved up"],
    ),
    "a joint without a column": (
        loading({name: x for name, x in ROWS.items() if name != "joint2"}), ["missing 'joint2'"],
    ),
    "no table": (loading(3), ["expects a path of a table, or named columns, got int"]),
    "no robot": (lambda: jounce.load_poses(ROWS, 3), ["expects a jounce.Robot, got int"]),
    "positions that are no rows": (poses([0, 1], [0, 1]), ["expected numbers (N, n)"]),
    "positions that are not known": (poses([[0, np.nan]], [[0, 1]]), ["q holds nan", "rad or m"]),
    "torques of another shape": (poses([[0, 1]], [[0, 1, 2]]), ["torques", "expected numbers (1, 2), as q"]),
    "torques that are infinite": (poses([[0, 1]], [[0, np.inf]]), ["NaN for those not measured"]),
    "names of other joints": (poses([[0, 1]], [[0, 1]], ["a", "b", "c"]), ["expected numbers (N, 3)"]),
    "a name that comes twice": (poses([[0, 1]], [[0, 1]], ["a", "a"]), ["expected each joint once"]),
    "directions by how much": (poses([[0, 1]], [[0, 1]], approach=[[0.5, 1]]), ["approach holds 0.5"]),
})  # fmt: skip
