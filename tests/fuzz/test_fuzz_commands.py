"""Mutated command lines on mutated files: a command succeeds, or refuses in one line and leaves files as they are."""

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import warnings
from contextlib import chdir
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import strategies as st

import jounce
from fuzz.contract import PATIENCE, is_a_line, kept, workshop
from fuzz.mutations import hostile, mutated
from fuzz.originals import MOTIONS, ROBOTS
from jounce.cli import Defect
from support.commands import call

pytestmark = pytest.mark.filterwarnings("always::UserWarning")  # as a terminal sees them
RANDOM = st.randoms(note_method_calls=False, use_true_random=False)
LINES = {
    "info": (
        "info arm.urdf", "info robot.json --json", "info dh.yaml --strict", "info arm.xml", "info planar2r-saved.yaml",
        "info arm.urdf --base fixed --root upper --lock turn=0.1 --drives all --gravity 0 0 -1.62 --json",
        "info arm.urdf.xacro --xacro-arg mass=3",
    ),
    "convert": (
        "convert arm.urdf -o out.yaml", "convert robot.yaml -o out.json --json", "convert tree4.yaml -o out.yml",
        "convert arm.xml -o out.yaml --drives armature,damping --lock yaw=1",
    ),
    "run": (
        "run planar2r samples.csv -o out.csv --intervals 3 --degree 5", "run planar2r motion.yaml -o out.npz --order 1",
        "run planar2r rates.npz -o out.csv --json", "run planar2r-saved.yaml rates.csv -o out.npz --method recursion",
        "run planar2r rates.npz -o out --json", "run planar2r rates.csv -o out.npz --reduce peak,rms",
    ),
    "motion": (
        "motion planar2r samples.csv -o out.csv --intervals 3",
        "motion planar2r motion.yaml -o out.npz --step 0.1 --json",
        "motion planar2r rates.csv -o out.csv --order 2 --time t --angles rad",
    ),
    "plot": ("plot rates.csv -o out.svg --quantity q", "plot samples.npz -o out.png --joint joint1 --json"),
    "codegen": (
        "codegen planar2r --lang c -o out --order 1 --wrench",
        "codegen arm.urdf --lang python -o out --overwrite --json",
        "codegen planar2r --lang rust -o out --order 0 --outputs gravity_forces,mass_matrix --prefix arm",
        "codegen planar2r-saved.yaml --lang cpp -o out --order 0 --parameters gravity,masses --float32",
    ),
    "compare": (
        "compare planar2r --states 2 --order 1 --seed 3 --json", "compare planar2r-saved.yaml --states 2 --order 0",
    ),
    "others": (
        "cache --json", "cache --clear", "robots --json", "robots panda", "--version",
        "demo -o samples.csv --states 99 --format png",
    ),
}  # fmt: skip
EXAMPLES = {
    "info": 110,
    "convert": 50,
    "motion": 20,
    "run": 80,
    "plot": 20,
    "codegen": 25,
    "compare": 12,
    "others": 40,
}
OLD = ("out.csv", "out.npz", "out.yaml", "out.json", "out.svg")
FILES = dict(file for files in (*ROBOTS.values(), *MOTIONS.values()) for file in files)


def drawn_line(rng, lines):
    """A command line, as it is or with words replaced, left out, repeated."""
    words = rng.choice(lines).split()
    for _ in range(rng.choice((0, 0, 0, 1, 2))):
        i, j = rng.randrange(len(words)), rng.randrange(len(words))
        word = rng.choice((hostile(rng), "\udcff", words[j], rng.choice(sorted(FILES))))
        before, after = words[:i], words[i + 1 :]
        words = rng.choice(([*before, word, *after], [*before, *after], [*before, word, words[i], *after])) or ["info"]
    return words


def write_mutated(folder, rng, words):
    """The files that a command line names, mutated; one that is none of its business; and perhaps older output."""
    shutil.rmtree(folder.parents[1], ignore_errors=True)
    folder.mkdir(parents=True)
    for name in sorted(FILES.keys() & set(words)):
        (folder / name).write_bytes(mutated(rng, Path(name).suffix, FILES[name]))
    (folder.parent / "notes.txt").write_text("mine")
    if rng.random() < 0.5:
        for name in OLD:
            (folder / name).write_text("old")


def files_of(folder):
    """All files below a folder, with what is in them and who may read them."""
    found = [path for path in folder.rglob("*") if path.is_file() and path.suffix != ".kernel"]
    return {path: (path.read_bytes(), path.stat().st_mode) for path in found}


def outputs(folder, words):
    """Where a command line may write."""
    after = [word for option, word in pairwise(words) if option in ("-o", "--output")]
    joined = [word.removeprefix("-o") for word in words if re.match("-o.", word)]
    return [(folder / word).resolve() for word in after + joined]


def check_command(folder, words, before, code, stdout, stderr):
    """What must hold of a command that has ended."""
    after = files_of(folder.parents[1])
    changed = [path for path in before.keys() | after.keys() if before.get(path) != after.get(path)]
    assert not [path for path in after if path.suffix == ".part"]
    said = stderr.splitlines()
    usage = stderr.startswith("Usage: ")  # in the words of click, on several lines
    for line in said * (not usage):
        is_a_line(line)
        assert line.startswith(("Error: ", "Warning: ")), line
    refusals = [line for line in said if line.startswith("Error: ")]
    if code == 2:
        assert usage or said[-1:] == refusals != [], stderr
        assert (stdout, changed) == ("", [])
        return
    assert code == 0 or (code == 1 and {"compare", "--strict"} & set(words)), (code, stderr)
    assert not refusals
    for path in changed:
        assert any(path == output or output in path.parents for output in outputs(folder, words)), path
        if path.suffix in (".yaml", ".yml", ".json") and words[0] == "convert":
            with warnings.catch_warnings(action="ignore"):
                jounce.load(path)
    asked = set(words) - {path.name for path in outputs(folder, words)}  # "-o --json" names a file
    if "--json" in asked and not {"--help", "-h", "--version"} & asked:
        json.loads(stdout)


def run_here(words):
    result = call(*words)
    if isinstance(result.exception, SystemExit) and isinstance(defect := result.exception.__context__, Defect):
        assert defect.__cause__ is not None
        raise defect.__cause__
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.exit_code, result.stdout, result.stderr


def run_elsewhere(words):
    """In a process of its own, as a shell starts it."""
    words = [os.fsencode(word) for word in words]
    done = subprocess.run([sys.executable, "-m", "jounce", *words], capture_output=True, timeout=PATIENCE, check=False)
    return done.returncode, done.stdout.decode(), done.stderr.decode()


def attack(budget, name, lines, run, examples):
    with workshop(name) as place:
        folder = place / "world/in/here"

        def check(rng):
            words = drawn_line(rng, lines)
            write_mutated(folder, rng, words)
            before = files_of(place / "world")
            (place / "line.txt").write_text(shlex.join(words), errors="surrogateescape")
            with kept(name, place / "line.txt", *before), chdir(folder):
                check_command(folder, words, before, *run(words))

        budget.attack(check, examples, rng=RANDOM)


@pytest.mark.parametrize("command", LINES)
def test_commands(budget, monkeypatch, tmp_path, command):
    monkeypatch.setenv("JOUNCE_CACHE_DIR", str(tmp_path))  # which some clear
    attack(budget, command, LINES[command], run_here, EXAMPLES[command])


def test_commands_in_processes_of_their_own(budget):
    attack(budget, "process", [line for lines in LINES.values() for line in lines], run_elsewhere, 8)
