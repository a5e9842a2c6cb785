"""The attacks find faults that are planted: mutations reach them, and the contract tells them from good manners."""

import re
from contextlib import chdir
from random import Random

import pytest
import test_fuzz_commands as commands
import test_fuzz_readers as readers

import jounce
from fuzz import contract
from fuzz import tables as lies
from fuzz.attack import Budget
from jounce.io import npz, tables

PLANTED = {  # in the reader of URDFs, by the text that it falls over
    "a number that is none": "nan",
    "an integer of 400 digits": "9{400}",
    "digits of another script": "\u0661",
    "an empty attribute": r'\w=""',
    "a byte order mark": "\ufeff",
    "an entity": "<!ENTITY",
    "a default of an attribute": "<!ATTLIST",
    "nesting": "(<a>){300}",
    "a name twice": r'<link name="(\w+)"(.|\n)*<link name="\1"',
    "a cut": "<link[^>]*$",
    "no bytes": "^$",
    "no UTF-8": "\ufffd",
}


@pytest.fixture(autouse=True)
def _kept_elsewhere(monkeypatch, tmp_path):
    monkeypatch.setattr(contract, "KEPT", tmp_path)


@pytest.mark.parametrize("pattern", PLANTED.values(), ids=PLANTED)
def test_mutations_reach_a_planted_fault_and_the_file_is_kept(monkeypatch, tmp_path, pattern):
    fault = re.compile(pattern)

    def planted(path):
        if fault.search(path.read_bytes().decode("utf-8", "replace")):
            raise ValueError("planted")
        raise jounce.JounceError("refused")

    monkeypatch.setattr(jounce, "load", planted)
    monkeypatch.setitem(readers.ROBOTS, "urdf", readers.ROBOTS["urdf"][:1])  # the short one
    with pytest.raises(ValueError, match="planted") as caught:
        readers.attack_robots(Budget(seed=0, seconds=1e-3), "urdf", 2000)
    assert any("make fuzz SEED=0" in note for note in caught.value.__notes__)
    [kept] = tmp_path.glob("urdf-ValueError-*/*.urdf")
    assert fault.search(kept.read_bytes().decode("utf-8", "replace"))


def test_command_lines_reach_a_planted_fault(tmp_path):
    def planted(words):
        if "arm.urdf" in words and "--json" not in words and "nan" in words:
            raise ValueError("planted")
        return 0, "{}", ""

    with pytest.raises(ValueError, match="planted"):
        commands.attack(Budget(seed=0, seconds=1e-3), "info", commands.LINES["info"], planted, 2000)
    [line] = tmp_path.glob("info-ValueError-*/line.txt")
    assert "nan" in line.read_text()


ENDS = {  # of `convert arm.urdf -o out.yaml`: exit code, output, errors, what it leaves in its folder
    "a traceback": (1, "", "Traceback (most recent call last):", {}),
    "an exit code of its own": (3, "", "", {}),
    "no word": (2, "", "", {}),
    "two lines": (2, "", "Error: one\ntwo\n", {}),
    "a control character": (2, "", "Error: \x1b[2J\n", {}),
    "an endless line": (2, "", f"Error: {'x' * 10_000}\n", {}),
    "output of a refusal": (2, "half", "Error: no\n", {}),
    "a file of a refusal": (2, "", "Error: no\n", {"out.yaml": "half"}),
    "another file": (0, "", "", {"out.yml": ""}),
    "the file that was read": (0, "", "", {"arm.urdf": ""}),
    "what lay beside": (0, "", "", {"../notes.txt": ""}),
    "a part": (0, "", "", {".jounce-1.part": ""}),
    "half a robot": (0, "", "", {"out.yaml": "name: arm"}),
}


@pytest.mark.parametrize(("code", "stdout", "stderr", "left"), ENDS.values(), ids=ENDS)
def test_the_contract_of_commands(tmp_path, code, stdout, stderr, left):
    folder, words = tmp_path / "in/here", ["convert", "arm.urdf", "-o", "out.yaml"]
    folder.mkdir(parents=True)
    (folder / "arm.urdf").write_text("<robot/>")
    (folder.parent / "notes.txt").write_text("mine")
    before = commands.files_of(tmp_path)
    with chdir(folder):
        commands.check_command(folder, words, before, 2, "", "Error: no\n")
        for name, content in left.items():
            (folder / name).write_text(content)
        with pytest.raises((AssertionError, jounce.JounceError)):
            commands.check_command(folder, words, before, code, stdout, stderr)


def test_archives_reach_every_refusal(tmp_path, monkeypatch):
    """And every kind of column that is read."""
    monkeypatch.setattr(npz, "MAX_INFLATED_BYTES", lies.MOST_INFLATED)
    monkeypatch.setattr(npz, "MAX_COLUMNS", 1000)
    rng, path, messages, read = Random(0), tmp_path / "table.npz", [], 0
    for _ in range(1500):
        path.write_bytes(lies.lying_archive(rng))
        try:
            read += len(tables.read_rows(path).columns) > 1
        except jounce.JounceError as error:
            messages.append(str(error))
    words = (
        "Python objects", "|V8", "datetime64", "bool", "<U3", "ends too early", "more follows",
        "negative", "compression 14", "CRC", "encrypted", "larger than the file", "compressed columns of",
        "more than 1000 columns", "occurs 2 times", "array header", "no columns or no rows", "of shape ()",
    )  # fmt: skip
    assert [word for word in words if not any(word in message for message in messages)] == []
    assert read > 20
