"""Files while they are written: whose mode they get, and what becomes of those that killed runs have left."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from jounce.core import temporary_files
from jounce.io import files
from support.abandoned import abandoned_part

posix = pytest.mark.skipif(not hasattr(os, "uname"), reason="Windows has other modes and processes")
MARK = "made by us"


@pytest.fixture
def umask():
    """A way to set the umask, which is restored."""
    before = os.umask(0o22)
    yield os.umask
    os.umask(before)


def write_part(path, content="new"):
    with files.write_whole(path) as part:
        part.write_text(content)


def mode(path):
    return path.stat().st_mode & 0o777


@posix
@pytest.mark.parametrize("kept", [0o600, 0o640, 0o444, 0o755])
def test_a_file_that_is_replaced_keeps_its_mode(tmp_path, umask, kept):
    path = tmp_path / "out.csv"
    path.write_text("old")
    path.chmod(kept)
    with files.write_whole(path) as part:
        assert mode(part) == 0o600  # until then nobody else reads it
        part.write_text("new")
    assert (path.read_text(), mode(path)) == ("new", kept)


@posix
@pytest.mark.parametrize(("mask", "expected"), [(0o22, 0o644), (0o77, 0o600), (0o2, 0o664)])
def test_a_new_file_follows_the_umask(tmp_path, umask, mask, expected):
    umask(mask)
    write_part(tmp_path / "out.csv")
    files.write_folder(tmp_path / "out", {"a": MARK}, MARK, overwrite=False)
    assert mode(tmp_path / "out.csv") == mode(tmp_path / "out" / "a") == expected


@posix
@pytest.mark.parametrize("empty", [True, False])
def test_folders_and_their_files_keep_their_modes(tmp_path, umask, empty):
    folder = tmp_path / "out"
    folder.mkdir(mode=0o700)
    if not empty:
        (folder / "a").write_text(MARK)
        (folder / "a").chmod(0o600)
    files.write_folder(folder, {"a": MARK, "b": MARK}, MARK, overwrite=True)
    assert (mode(folder), mode(folder / "a"), mode(folder / "b")) == (0o700, 0o644 if empty else 0o600, 0o644)


@posix
@pytest.mark.parametrize("kind", ["file", "folder"])
def test_the_next_run_into_a_folder_removes_what_a_killed_one_left(tmp_path, kind):
    """Killed while it writes, as no cleaning up can prevent."""
    code = """
import os, pathlib, signal, sys
from jounce.io import files
killed = lambda: os.kill(os.getpid(), signal.SIGKILL)
if sys.argv[1] == "file":
    with files.write_whole(pathlib.Path("out.csv")) as part:
        part.write_text("half of")
        killed()
files.file_mode = lambda path: killed() if path.name == "a" else None
files.write_folder(pathlib.Path("out"), {"a": "half of"}, "mark", overwrite=False)
"""
    subprocess.run([sys.executable, "-c", code, kind], cwd=tmp_path, check=False, timeout=60)
    [part] = tmp_path.iterdir()
    assert temporary_files.PART_NAME.fullmatch(part.name)
    assert part.is_dir() == (kind == "folder")
    write_part(tmp_path / "other.csv")
    assert [path.name for path in tmp_path.iterdir()] == ["other.csv"]


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="how a process is can be asked on Linux alone")
def test_a_killed_run_whose_end_nobody_asked_for_is_gone(tmp_path):
    """In a container whose first process asks for none, that is for good."""
    killed = subprocess.Popen([sys.executable, "-c", ""])
    os.waitid(os.P_PID, killed.pid, os.WEXITED | os.WNOWAIT)
    part = abandoned_part(tmp_path, killed.pid)
    write_part(tmp_path / "out.csv")
    killed.wait()
    assert not part.exists()


@posix
def test_parts_of_runs_that_go_on_and_files_of_users_stay(tmp_path):
    parts_of_others = [
        abandoned_part(tmp_path, os.getppid()),
        abandoned_part(tmp_path, os.getpid()),
        abandoned_part(tmp_path, 1),
    ]
    machine = tmp_path / f".jounce-{'0' * 8}-{2**22 + 1}-{'0' * 12}.part"  # processes of other machines may well run
    mine = [tmp_path / name for name in ("a.part", ".jounce-notes.part", ".jounce-.part")]
    for path in (machine, *mine):
        path.write_text("mine")
    before = {*parts_of_others, machine, *mine}
    gone = abandoned_part(tmp_path)
    write_part(tmp_path / "out.csv")
    assert not gone.exists()
    assert set(tmp_path.iterdir()) == before | {tmp_path / "out.csv"}


def test_whoever_wrote_it_what_is_a_day_old_is_removed(tmp_path):
    young, old = (abandoned_part(tmp_path, os.getpid(), age) for age in (3600, 90_000))
    nameless = tmp_path / f".jounce-{'0' * 12}.part"
    nameless.write_text("of an older version")
    os.utime(nameless, (0, 0))
    write_part(tmp_path / "out.csv")
    assert (young.exists(), old.exists(), nameless.exists()) == (True, False, False)


def test_a_link_called_as_a_part_leads_to_nothing_that_is_removed(tmp_path):
    kept = tmp_path / "kept"
    kept.mkdir()
    (kept / "file").touch()
    part = abandoned_part(tmp_path)
    part.unlink()
    part.symlink_to(kept)
    write_part(tmp_path / "out.csv")
    assert not part.is_symlink()
    assert (kept / "file").exists()
