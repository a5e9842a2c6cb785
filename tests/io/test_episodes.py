"""Data sets of LeRobot: episodes are motions, lists are columns, degrees are never taken as radians."""

import json
from dataclasses import dataclass

import numpy as np
import pytest

import jounce
from jounce.io import tables
from support.commands import run, summary
from support.refusals import expect_refusal, refusal, refused

arrow = pytest.importorskip("pyarrow")
parquet = pytest.importorskip("pyarrow.parquet")

FPS = 30
ROBOT = jounce.load("planar2r")
FILES = {0: (0, 1), 1: (2,)}  # episodes by file
PATTERN = "observation.state[{index}]"
EFFORTS = "observation.effort[{index}]"
QUIET = pytest.mark.filterwarnings("ignore::jounce.JounceWarning")  # what notes hold


@dataclass(frozen=True)
class Truth:
    """What an episode holds, in SI units."""

    t: np.ndarray
    q: np.ndarray
    forces: np.ndarray


def episode_truth(number):
    rng = np.random.default_rng(number)
    motion = jounce.Motion.fourier([0.3, 0.2], *rng.uniform(-0.4, 0.4, (2, 3, 2)), 2.0, 10.0)
    t = np.arange(150 + 10 * number) / FPS
    rates = motion(t, 2)
    return Truth(t, rates[0], 1.2 * ROBOT.inverse_dynamics(*rates))


def lists(values, fixed):
    """A column of lists of float32, whose type states their length or not."""
    kind = arrow.list_(arrow.float32(), values.shape[1]) if fixed else arrow.list_(arrow.float32())
    return arrow.array([*map(list, values.astype(np.float32))], kind)


def episode_table(number, fixed=False, width=2):
    """The rows of an episode: degrees, currents of 2 and 5 N m/A, and counters."""
    truth = episode_truth(number)
    state = np.degrees(truth.q)
    frames = np.arange(len(truth.t))
    padded = np.column_stack([state, *[np.zeros(len(frames))] * (width - 2)])
    return arrow.table({
        "action": lists(state + 30, fixed),
        "observation.state": lists(padded, fixed),
        "observation.effort": lists(truth.forces, fixed),
        "observation.current": lists(truth.forces / [2.0, 5.0], fixed),
        "timestamp": arrow.array(truth.t.astype(np.float32)),
        "frame_index": arrow.array(frames),
        "episode_index": arrow.array(np.full(len(frames), number)),
        "index": arrow.array(frames),
        "task_index": arrow.array(0 * frames),
    })  # fmt: skip


def write_data_set(folder, names=None, fixed=False):
    for file, episodes in FILES.items():
        path = folder / "data" / "chunk-000" / f"file-{file:03d}.parquet"
        path.parent.mkdir(parents=True, exist_ok=True)
        parquet.write_table(arrow.concat_tables([episode_table(k, fixed) for k in episodes]), path)
    features = {"observation.state": {"dtype": "float32", "shape": [2], "names": names}}
    (folder / "meta").mkdir()
    text = json.dumps({"codebase_version": "v3.0", "fps": FPS, "total_episodes": 3, "features": features})
    (folder / "meta" / "info.json").write_text(text)
    return folder


@pytest.fixture(scope="module", params=[False, True], ids=["lists", "fixed"])
def data_set(request, tmp_path_factory):
    return write_data_set(tmp_path_factory.mktemp("data"), fixed=request.param)


@pytest.fixture(scope="module")
def plain_data_set(tmp_path_factory):
    return write_data_set(tmp_path_factory.mktemp("plain"))


def data_table(data_set, file=0):
    return data_set / "data" / "chunk-000" / f"file-{file:03d}.parquet"


def load(source, **options):
    return jounce.load_motion(source, ROBOT, order=0, **{"columns": PATTERN, "angles": "deg", "degree": 7} | options)


@pytest.mark.parametrize("number", [0, 1, 2])
def test_an_episode_is_a_motion(data_set, number):
    truth = episode_truth(number)
    file = next(file for file, episodes in FILES.items() if number in episodes)
    for source in (data_set, data_table(data_set, file)):
        motion = load(source, episode=number, torques=EFFORTS)
        t, q = motion.samples
        # float32 holds times and degrees to 24 bits, of which half is the largest error.
        np.testing.assert_allclose(t, truth.t, atol=8 * 2.0**-24)
        np.testing.assert_allclose(q, truth.q, atol=np.radians(64 * 2.0**-24))
        np.testing.assert_allclose(motion.torques[1], truth.forces, rtol=2.0**-24)


def test_the_only_episode_needs_no_number_and_others_do(plain_data_set):
    only, chosen = load(data_table(plain_data_set, 1)), load(plain_data_set, episode=2)
    np.testing.assert_array_equal(only.samples[1], chosen.samples[1])
    refusal(lambda: load(plain_data_set), "3 episodes, 0 to 2; select one by episode=N")
    refusal(lambda: load(data_table(plain_data_set)), "2 episodes, 0 to 1; select one by episode=N")
    refusal(lambda: load(plain_data_set, episode=3), "no episode 3; it has 3, 0 to 2")
    refusal(lambda: load(plain_data_set, episode=-1), "no episode -1; it has 3, 0 to 2")
    refusal(lambda: load(plain_data_set, episode=True), "episode is True; expected its number, from 0")
    refusal(lambda: load({"t": [0, 1]}, episode=0), "episode is for files of LeRobot's data sets; leave it out")
    refusal(lambda: jounce.load_motion("paper", jounce.load("iiwa14"), episode=0), "episode", "leave it out")


def test_degrees_are_never_taken_as_radians(plain_data_set):
    for columns in (PATTERN, "action[{index}]", {"joint1": "observation.state[0]", "joint2": "observation.state[1]"}):
        with expect_refusal("data sets of LeRobot state no unit of angles", "angles='deg' or angles='rad'"):
            load(plain_data_set, episode=0, columns=columns, angles=None)
    assert np.abs(load(plain_data_set, episode=0, angles="rad").samples[1]).max() > 10


def test_a_refusal_suggests_the_measured_positions(plain_data_set):
    refusal(lambda: load(plain_data_set, episode=0, columns=None), "try: columns='observation.state[{index}]'")


def test_info_names_the_joints(tmp_path):
    folder = write_data_set(tmp_path, names={"motors": ["joint2.pos", "joint1.pos"]})
    stated = {"joint1": "observation.state[1]", "joint2": "observation.state[0]"}
    expected = load(folder, episode=1, columns=stated).samples[1]
    np.testing.assert_array_equal(load(folder, episode=1, columns=None).samples[1], expected)
    with expect_refusal(
        "columns 'observation.state[{index}]' reads 'observation.state[0]' as 'joint1'", "'joint2'; leave"
    ):
        load(folder, episode=1)
    with expect_refusal("torques 'observation.effort[{index}]' reads 'observation.effort[0]' as 'joint1'", "rename="):
        load(folder, episode=1, columns=None, torques=EFFORTS)
    other = jounce.load("iiwa14")
    refusal(lambda: jounce.load_motion(folder, other, episode=1, angles="deg"), "'joint3'")


def test_commands_run_all_episodes_or_one(data_set, tmp_path):
    options = "--columns", PATTERN, "--angles", "deg", "--degree", 7, "--order", 0
    out, one = tmp_path / "all.parquet", tmp_path / "one.csv"
    run("run", "planar2r", data_set, *options, "-o", out)
    motions = [str(x) for x in parquet.read_table(out).column("motion").unique().to_pylist()]
    assert motions == ["0", "1", "2"]
    run("run", "planar2r", data_set, *options, "--episode", 1, "-o", one)
    found, expected = dict(tables.read(one)), episode_truth(1)
    Q = np.stack([found["joint1.Q"], found["joint2.Q"]], axis=1)
    inner = slice(15, -15)
    assert Q[inner] == pytest.approx(expected.forces[inner] / 1.2, abs=0.02)
    is_second = np.array(parquet.read_table(out).column("motion").to_pylist()) == "1"
    np.testing.assert_array_equal(parquet.read_table(out).column("joint1.Q").to_numpy()[is_second], Q[:, 0])


@QUIET
def test_check_and_identify_take_them(plain_data_set, tmp_path):
    options = "--columns", PATTERN, "--angles", "deg", "--degree", 7
    limits = tmp_path / "limits.yaml"
    limits.write_text("units: SI\njoints: {joint1: {velocity: 100}, joint2: {velocity: 100}}\n")
    checked = summary("check", "planar2r", plain_data_set, *options, "--limits", limits)
    assert checked["motions"] == 3
    limits.write_text("units: SI\njoints: {joint1: {velocity: 0.1}, joint2: {velocity: 100}}\n")
    one = summary("check", "planar2r", plain_data_set, *options, "--limits", limits, "--episode", 2, codes=(1,))
    assert one["verdict"] == "broken"
    # All episodes are logs of one fit; currents with constants give what torques give.
    asked = "identify", "planar2r", plain_data_set, *options, "-o", tmp_path / "found.yaml", "--drives", "none"
    by_efforts = summary(*asked, "--torques", EFFORTS, "--test", "episode 2")
    constants = "--torques", "observation.current[{index}]", "--torque-constants", "2,5"
    by_currents = summary(*asked, *constants, "--test", "episode 2")
    assert [log["name"] for log in by_efforts["logs"]] == ["episode 0", "episode 1", "episode 2"]
    values = [[row["value"] for row in found["parameters"]] for found in (by_efforts, by_currents)]
    np.testing.assert_allclose(*values, rtol=1e-5, atol=1e-5)
    robot = jounce.load(tmp_path / "found.yaml")
    assert robot.gravity_forces([0, 0]) == pytest.approx(1.2 * ROBOT.gravity_forces([0, 0]), rel=1e-3)
    alone = summary(*asked, "--torques", EFFORTS, "--episode", 0)
    assert [log["samples"] for log in alone["logs"]] == [150]
    with expect_refusal("column 'observation.current[0]' holds a current, and torques are expected"):
        load(plain_data_set, episode=0, torques="observation.current[{index}]")


def test_options_are_kept_in_a_file(plain_data_set, tmp_path):
    options = "--columns", PATTERN, "--angles", "deg", "--episode", 0
    run("motion", "planar2r", plain_data_set, *options, "-o", tmp_path / "q.csv", "--save-read", tmp_path / "read.yaml")
    assert "episode: 0" in (tmp_path / "read.yaml").read_text()
    run("motion", "planar2r", plain_data_set, "--read", tmp_path / "read.yaml", "-o", tmp_path / "same.csv")
    assert (tmp_path / "q.csv").read_bytes() == (tmp_path / "same.csv").read_bytes()


REFUSED = {
    "an episode for a table": ("run planar2r log.csv --episode 0", "--episode is for data sets of LeRobot"),
    "no episode": ("run planar2r set --episode 9", "no episode 9; it has 3, 0 to 2"),
    "aggregates": ("run planar2r set --episode 1 --reduce peak -o out.csv", "--episode selects one motion, which is"),
    "which": ("motion planar2r set -o out.csv", "3 episodes, 0 to 2; select one by --episode N"),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_commands_refuse_in_one_line(kind, tmp_path):
    write_data_set(tmp_path / "set")
    (tmp_path / "log.csv").write_text("t,joint1,joint2\n0,0,0\n1,1,1\n")
    asked, message = REFUSED[kind]
    refused(tmp_path, [*asked.split(), "--columns", PATTERN, "--angles", "deg"], message)


def test_episodes_with_different_columns_are_refused(tmp_path):
    folder = write_data_set(tmp_path / "set")
    asked = "run", "planar2r", "set", "--columns", PATTERN, "--angles", "deg"
    # Another table of the set has lists of other lengths, or lacks a column.
    parquet.write_table(episode_table(2, width=3), data_table(folder, 1))
    refused(tmp_path, asked, "file-001.parquet: columns differ from those of file-000.parquet: observation.state[2];")
    parquet.write_table(episode_table(2).drop_columns(["action"]), data_table(folder, 1))
    refused(tmp_path, asked, ": action[0], action[1]; expected the same columns in all tables of a data set")
    # Lists of other lengths in one table.
    mixed = arrow.concat_tables([episode_table(0), episode_table(1, width=3)])
    parquet.write_table(mixed, data_table(folder))
    with expect_refusal("row 150 from 0: column 'observation.state' has 3 entries; expected 2, as in the first row"):
        load(data_table(folder), episode=1, columns=PATTERN)


def test_episodes_that_occur_twice_are_refused(tmp_path):
    folder = write_data_set(tmp_path)
    parquet.write_table(episode_table(0), data_table(folder, 1))
    refusal(lambda: load(folder, episode=0), "episode 0 begins a second time, after file-000.parquet")
    parquet.write_table(episode_table(2).drop_columns(["frame_index"]), data_table(folder, 1))
    refusal(lambda: load(folder, episode=0), "columns differ from those of file-000.parquet: frame_index")
    for path in (data_table(folder), data_table(folder, 1)):
        path.unlink()
    refusal(lambda: load(folder, episode=0), "a data set without tables")


def test_lists_with_missing_numbers_are_bad_rows(tmp_path):
    path = tmp_path / "lists.parquet"
    cells = [[0.1 * i, 0.2 * i] for i in range(40)]
    cells[5], cells[7] = None, [0.7, None]
    kind = arrow.list_(arrow.float64())
    parquet.write_table(arrow.table({"t": np.arange(40) / 10, "q": arrow.array(cells, kind)}), path)
    refusal(
        lambda: jounce.load_motion(path, ROBOT, degree=5, columns="q[{index}]"), "row 7 from 0: column 'q[1]' holds nan"
    )
    motion = jounce.load_motion(path, ROBOT, degree=5, columns="q[{index}]", on_error="skip")
    assert len(motion.samples[0]) == 38
    assert tables.PARQUET.columns(path) == {"t": "", "q[0]": "", "q[1]": ""}
    parquet.write_table(arrow.table({"t": [0.0], "q": arrow.array([["a"]])}), path)
    assert tables.PARQUET.columns(path)["q"] == "list<element: string>"
