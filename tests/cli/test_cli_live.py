"""`jounce live`: samples come as lines, rates and forces go as lines."""

import json
import subprocess
import sys
import threading

import numpy as np
import pytest

import jounce
from jounce.live.samples import read_lines
from support.commands import call, run

TIMES = 1e-3 * np.arange(700)
ROBOT = jounce.load("planar2r")
SETTINGS = ("live", "planar2r", "-", "--bandwidth", "8")


def samples(spoil=lambda k, row: row):
    """Lines of a CSV table, columns in another order than the joints, which `spoil` may change."""
    rows = [f"{t:.17g},{0.5 * np.cos(2 * t):.17g},{np.sin(t):.17g}" for t in TIMES]
    return "\n".join(["t,joint2,joint1", *(spoil(k, row) for k, row in enumerate(rows))]) + "\n"


def printed_rows(text):
    names, *rows = [line.split(",") for line in text.splitlines()]
    return [dict(zip(names, row, strict=True)) for row in rows]


def test_rows_of_samples_become_rows_of_rates_and_forces():
    live = ROBOT.live(TIMES[1] - TIMES[0], 8)
    expected = [(live.update([np.sin(t), 0.5 * np.cos(2 * t)], t), live.t, live.forces()) for t in TIMES.tolist()][-1]
    found = printed_rows(run(*SETTINGS, given=samples()).stdout)
    assert len(found) == len(TIMES) - 20
    last = found[-1]
    assert float(last["t"]) == expected[1]
    rates = [[float(last[f"joint{j}.{name}"]) for j in (1, 2)] for name in ("q", "qd", "q2d", "q3d", "q4d", "Q", "Qd")]
    np.testing.assert_allclose(rates, [*expected[0], *expected[2][:2]], rtol=1e-6, atol=1e-9)


def test_json_lines_are_read_and_written():
    lines = [json.dumps({"t": t, "joint1.q": np.sin(t), "joint2.q": 0.0}) for t in TIMES.tolist()]
    result = run(*SETTINGS, "--json", "--dt", 1e-3, given="\n".join(lines))
    last = json.loads(result.stdout.splitlines()[-1])
    assert last["joint1.qd"] == pytest.approx(np.cos(TIMES[-1] - 0.02), abs=1e-3)
    assert last["broken"] == []


def test_limits_that_are_broken_are_named(tmp_path):
    jounce.save(ROBOT.with_limits(velocity=[0.5, 5], effort=1e3), tmp_path / "robot.yaml")
    noise = np.random.default_rng(0).normal(0, 1e-5, (700, 2))
    rows = [f"{t},{np.sin(t) + a},{0.5 * np.cos(2 * t) + b}" for t, (a, b) in zip(TIMES, noise, strict=True)]
    given = "\n".join(["t,joint1,joint2", *rows])
    found = printed_rows(run("live", tmp_path / "robot.yaml", "--bandwidth", 8, given=given).stdout)
    assert found[-1]["broken"] == "velocity of joint1"
    assert found[50]["broken"] == ""  # as long as the noise is not known


@pytest.mark.filterwarnings("always::jounce.JounceWarning")
@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda k, row: row if k != 400 else "0.1,0.5,0.5", "not after the last sample"),
        (lambda k, row: row if k != 400 else row.rpartition(",")[0] + ",1.5", "jumps from"),
        (lambda k, row: row if k != 400 else "x,0.5,0.5", "has no time; it is left out"),
    ],
)
def test_row_that_cannot_be_used_is_left_out_with_a_warning(spoil, says):
    result = run(*SETTINGS, given=samples(spoil), code=3)
    assert says in result.stderr
    assert result.stderr.count("Warning") == 2
    assert "1 row is left out" in result.stderr
    assert len(printed_rows(result.stdout)) == len(TIMES) - 21


def test_cell_that_is_no_number_is_a_lost_sample():
    result = run(*SETTINGS, given=samples(lambda k, row: row if k != 400 else row.rpartition(",")[0] + ",?"))
    assert len(printed_rows(result.stdout)) == len(TIMES) - 20
    assert result.stderr == ""


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ("", "there are no samples"),
        ("1,2,3\n4,5,6\n", "expected a row of names"),
        ("t,joint1\n0,1\n", "joint2"),
        ("t,joint1,joint2\n0,1,2\n", "fewer than two rows"),
        ("t,joint1,joint2\n1,1,2\n0.5,1,2\n", "the times of the first 2 rows do not increase: 1.0 and 0.5 s"),
        ("t,joint1,joint2\n1,1,2\n1,1,2\n", "give the time between samples with --dt"),
    ],
)
def test_wrong_samples_are_one_line(given, says):
    error = run(*SETTINGS, given=given, code=2).stderr
    assert says in error
    assert error.count("\n") == 1


def test_file_that_grows_is_followed(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t,a\n0,1\n0.1,")
    found, done = [], threading.Event()

    def collect():
        with path.open() as file:
            for line in read_lines(file, follow=True):
                found.append(line)
                if len(found) == 4:
                    done.set()
                    return

    threading.Thread(target=collect, daemon=True).start()
    with path.open("a") as file:
        file.write("2\n\n0.2,3\n")
    assert done.wait(10)
    assert found == ["t,a\n", "0,1\n", "0.1,2\n", "0.2,3\n"]


def test_rows_go_as_samples_come():
    """The first row is there before the last sample is; a closed pipe ends the command without a traceback."""
    words = [sys.executable, "-m", "jounce", "live", "planar2r", "--lag", "0", "--dt", "1e-3"]
    with subprocess.Popen(words, stdin=-1, stdout=-1, stderr=-1, text=True) as process:
        process.stdin.write("t,joint1,joint2\n0,0.1,0.2\n")
        process.stdin.flush()
        assert process.stdout.readline().startswith("t,joint1.q,")
        assert process.stdout.readline().startswith("0.0,0.1,0.2,")
        process.stdout.close()
        for k in range(1, 20):
            process.stdin.write(f"{k / 1000},0.1,0.2\n")
        process.stdin.close()
        assert "Traceback" not in process.stderr.read()


@pytest.mark.filterwarnings("always")
@pytest.mark.parametrize(
    ("stamps", "words"),
    [
        ([0, 0], "the times of the first 2 rows do not increase: 0.0 and 0.0 s; give the time between samples"),
        ([3, 2, 1], "the times of the first 3 rows do not increase: 3.0 and 2.0 s; give the time between"),
        ([1], "fewer than two rows of samples; give the time between"),
        ([0, 0, 0.01], None),  # one spacing counts
    ],
)
def test_first_stamps_that_do_not_increase_are_named(tmp_path, stamps, words):
    path = tmp_path / "samples.csv"
    path.write_text("t,joint1,joint2\n" + "".join(f"{t},0,0\n" for t in stamps))
    result = call("live", "planar2r", path)
    assert (result.exit_code == 2) == (words is not None), result.stderr
    assert (words or "not after the last sample") in result.stderr
    assert "dt is" not in result.stderr
