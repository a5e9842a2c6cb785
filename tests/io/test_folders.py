"""Folders are written whole or not at all, and nothing of a user's is lost."""

import os

import pytest
from files import refusal

from jounce.io import folders

MARK = "made by us"
FILES = {"a.txt": f"{MARK}\nnew\n", "b.txt": f"{MARK}\nnew\n"}


def write(folder, force=False):
    folders.write_folder(folder, FILES, MARK, force)


def contents(folder):
    return {path.name: path.read_text() for path in folder.iterdir()}


@pytest.mark.parametrize("there", [False, True])
def test_a_new_or_empty_folder_gets_all_files(there, tmp_path):
    if there:
        (tmp_path / "out").mkdir()
    write(tmp_path / "out")
    assert contents(tmp_path / "out") == FILES
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_a_folder_that_is_not_empty_takes_force_which_spares_what_is_not_ours(tmp_path):
    (tmp_path / "own.txt").write_text("mine")
    (tmp_path / "a.txt").write_text(f"# {MARK}, old")
    refusal(lambda: write(tmp_path), "is not empty (a.txt, own.txt)", "--force")
    assert contents(tmp_path) == {"own.txt": "mine", "a.txt": f"# {MARK}, old"}
    write(tmp_path, force=True)
    assert contents(tmp_path) == FILES | {"own.txt": "mine"}


def test_force_removes_what_a_former_run_left_and_no_copy_of_it(tmp_path):
    former = {"a.txt": f"{MARK}: run old and old_test", "old.txt": MARK, "old_test.txt": MARK, "B.TXT": MARK}
    copies = {"old_backup.txt": f"{MARK}, my changes", "old.dat": "mine", "run.txt": "mine"}
    for name, text in (former | copies).items():
        (tmp_path / name).write_text(text)
    (tmp_path / "old").mkdir()
    write(tmp_path, force=True)
    (tmp_path / "old").rmdir()
    assert contents(tmp_path) == FILES | copies | {"B.TXT": MARK}


@pytest.mark.parametrize("foreign", ["a user's", "x" * 5000 + MARK])
def test_a_users_file_of_the_same_name_is_not_replaced(foreign, tmp_path):
    (tmp_path / "b.txt").write_text(foreign)
    refusal(lambda: write(tmp_path, force=True), "b.txt: was not made by jounce")
    assert contents(tmp_path) == {"b.txt": foreign}


def test_links_and_folders_of_the_same_name_are_not_replaced(tmp_path):
    elsewhere = tmp_path / "elsewhere"
    elsewhere.write_text(MARK)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "a.txt").symlink_to(elsewhere)
    refusal(lambda: write(tmp_path / "out", force=True), "a.txt: was not made by jounce")
    assert elsewhere.read_text() == MARK


def test_what_cannot_be_written_leaves_nothing(tmp_path, monkeypatch):
    file = tmp_path / "file"
    file.write_text("")
    refusal(lambda: write(file), "file: exists and is not a folder")
    refusal(lambda: write(tmp_path / "no" / "out"), "there is no folder")

    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("pathlib.Path.replace", full)
    refusal(lambda: write(tmp_path / "out"), "out: cannot be written: No space left on device")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.skipif(getattr(os, "geteuid", lambda: 1)() == 0, reason="root may write anywhere")
def test_a_folder_that_is_not_writable_is_refused(tmp_path):
    (tmp_path / "out").mkdir(mode=0o500)
    refusal(lambda: write(tmp_path / "out"), "not writable")
