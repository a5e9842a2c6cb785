"""What type checkers say of programs of users: they find each mistake, and nothing else."""

import json
import os
import runpy
import shutil
import subprocess
import sys
from pathlib import Path
from typing import get_args

import pytest

import jounce
from jounce._codegen.languages import LANGUAGE_NAMES
from jounce.arguments import requests
from jounce.arguments.loads import LOAD_FRAMES
from jounce.core import typing
from jounce.dynamics.kinematics import SCREW_FRAMES
from jounce.dynamics.quantities import QUANTITIES
from jounce.dynamics.quantities.names import QuantityName
from jounce.engine.backends import NATIVE
from jounce.model import screws
from jounce.model.drive_trains import ALL_DRIVE_TERMS
from jounce.motion import units

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
SOURCES = Path(jounce.__file__).parents[1]
PROGRAMS = (HERE / "mistakes.py", HERE / "right.py")


def mypy() -> list[tuple[str, int]]:
    pytest.importorskip("mypy")
    command = [sys.executable, "-m", "mypy", "--output=json", *map(str, PROGRAMS)]
    environment = os.environ | {"MYPYPATH": str(SOURCES)}
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, env=environment)
    assert done.returncode == 1, done.stderr
    found = [json.loads(line) for line in done.stdout.splitlines()]
    return [(Path(x["file"]).name, x["line"]) for x in found if x["severity"] == "error"]


def pyright(folder: Path) -> list[tuple[str, int]]:
    pytest.importorskip("pyright")
    settings = {"extraPaths": [str(SOURCES)], "include": ["."], "typeCheckingMode": "standard"}
    for program in PROGRAMS:
        shutil.copy(program, folder)
    (folder / "pyrightconfig.json").write_text(json.dumps(settings), encoding="utf-8")
    command = [
        sys.executable,
        "-m",
        "pyright",
        "--outputjson",
        "--pythonpath",
        sys.executable,
        "--project",
        str(folder),
    ]
    done = subprocess.run(command, capture_output=True, text=True)
    if not done.stdout.startswith("{"):  # without its Node
        pytest.skip(f"pyright does not run: {done.stderr.splitlines()[-1:]}")
    assert done.returncode == 1, done.stdout + done.stderr
    found = json.loads(done.stdout)["generalDiagnostics"]
    return [(Path(x["file"]).name, x["range"]["start"]["line"] + 1) for x in found if x["severity"] == "error"]


@pytest.mark.parametrize("checker", ["mypy", "pyright"])
def test_type_checkers_find_each_mistake_and_no_other(checker, tmp_path):
    lines = enumerate((HERE / "mistakes.py").read_text(encoding="utf-8").splitlines(), 1)
    mistakes = {("mistakes.py", number) for number, line in lines if "# mistake" in line}
    assert len(mistakes) > 20
    assert set(mypy() if checker == "mypy" else pyright(tmp_path)) == mistakes


def test_the_right_program_runs():
    runpy.run_path(str(HERE / "right.py"))


@pytest.mark.parametrize(
    ("literal", "known"),
    [
        (QuantityName, QUANTITIES),
        (typing.Method, [NATIVE, *(method for row in QUANTITIES.values() for method in row.laws)]),
        (typing.Frame, SCREW_FRAMES),
        (typing.LoadFrame, LOAD_FRAMES),
        (typing.Form, requests.CORIOLIS_FORMS),
        (typing.DriveTerm, ALL_DRIVE_TERMS),
        (typing.Language, LANGUAGE_NAMES),
        (typing.Convention, screws.CONVENTIONS),
        (typing.JointType, screws.TYPES),
        (typing.Angles, units.ANGLE_UNITS),
        (typing.TimeUnit, units.TIME_UNITS),
    ],
)
def test_types_name_what_there_is(literal, known):
    assert set(get_args(literal)) == set(known)


def test_dir_lists_the_public_names():
    assert dir(jounce) == sorted(jounce.__all__)
