"""Ctrl-C at any time of the command: one line, exit code 130, nothing half-written."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import jounce
from jounce.engine import motion_states
from support.commands import call

COMMAND = ["run", "planar2r", "motion.yaml", "-o", "out.csv"]
MOTION = "time: {stop: 1, count: 9}\njoints: {joint1: {offset: 1}, joint2: {cosines: [{amplitude: 1, frequency: 2}]}}\n"

PROCESS = """
import os, signal, sys
from jounce.__main__ import main

def stop():
    os.kill(os.getpid(), signal.SIGINT)

class Finder:
    def find_spec(self, name, *_):
        if name == when:
            stop()
        elif name == when.removeprefix("lost "):
            try:
                stop()
            except BaseException:
                pass

when, *sys.argv[1:] = sys.argv[1:]
sys.meta_path.insert(0, Finder())
if when == "replace":
    from pathlib import Path
    replace = Path.replace
    Path.replace = lambda *_: stop()
if when == "end":
    import atexit
    atexit.register(stop)
main()
"""


@pytest.fixture
def motion_folder(tmp_path):
    (tmp_path / "motion.yaml").write_text(MOTION)
    (tmp_path / "out.csv").write_text("old")
    return tmp_path


def interrupted(folder, when):
    command, settings = [sys.executable, "-c", PROCESS, when, *COMMAND], {"JOUNCE_CACHE_DIR": str(folder / "kernels")}
    return subprocess.run(
        command, capture_output=True, text=True, timeout=60, check=False, cwd=folder, env=os.environ | settings
    )


def texts_by_name(folder):
    return {path.name: path.read_text() for path in folder.iterdir() if path.is_file()}


@pytest.mark.skipif(sys.platform == "win32", reason="no signal is sent like this")
@pytest.mark.parametrize("when", ["jounce.cli", "numpy", "numpy.linalg._umath_linalg", "llvmlite.binding", "replace"])
def test_from_the_first_import_to_the_last_moment(motion_folder, when):
    before = texts_by_name(motion_folder)
    done = interrupted(motion_folder, when)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "\nAborted!\n")
    assert texts_by_name(motion_folder) == before


@pytest.mark.skipif(sys.platform == "win32", reason="no signal is sent like this")
@pytest.mark.parametrize("when", ["numpy", "llvmlite.binding"])
def test_an_import_that_drops_the_exception_is_interrupted(motion_folder, when):
    done = interrupted(motion_folder, f"lost {when}")
    assert (done.returncode, done.stderr) == (130, "\nAborted!\n")


@pytest.mark.skipif(sys.platform == "win32", reason="no signal is sent like this")
def test_what_is_done_stays_done(motion_folder):
    done = interrupted(motion_folder, "end")
    assert (done.returncode, done.stderr) == (0, "")
    assert texts_by_name(motion_folder)["out.csv"].startswith("t,joint1.Q")


def test_within_another_program(motion_folder, monkeypatch):
    def fails(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.chdir(motion_folder)
    monkeypatch.setattr(motion_states, "compute", fails)
    before, result = texts_by_name(motion_folder), call(*COMMAND)
    assert (result.exit_code, result.stdout, result.stderr) == (130, "", "\nAborted!\n")
    assert texts_by_name(motion_folder) == before


CODECS = {"cp1252": r"\u0142ód\u017a", "ascii": None, "utf-8": "łódź"}


@pytest.mark.parametrize(("codec", "shown"), CODECS.items(), ids=CODECS)
def test_an_output_that_cannot_hold_a_name_gets_it_escaped(tmp_path, codec, shown):
    """And no command fails for it, once its file is written."""
    text = (Path(__file__).parents[2] / "examples" / "panda.urdf").read_text().replace('name="panda"', 'name="łódź"')
    (tmp_path / "lodz.urdf").write_text(text, encoding="utf-8")
    command = [sys.executable, "-m", "jounce", "convert", "lodz.urdf", "-o", "arm.yaml"]
    settings = os.environ | {"PYTHONIOENCODING": codec, "PYTHONUTF8": "0"}
    done = subprocess.run(command, capture_output=True, timeout=60, check=False, cwd=tmp_path, env=settings)
    assert (done.returncode, done.stderr) == (0, b"")
    assert shown is None or done.stdout.decode(codec).startswith(f"{shown}: 8 coordinates")
    assert jounce.load(tmp_path / "arm.yaml").name == "łódź"
