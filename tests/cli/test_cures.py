"""A message is for who reads it: at the shell it names options that the command has, in Python arguments and calls."""

import ast
import re
from pathlib import Path

import numpy as np
import pytest

import jounce
from jounce.cli import main
from jounce.core.cures import OPTION, Remedy, find_options, join_cures, option_name, option_value, running_command
from jounce.io.motions import part_rows
from support.commands import call
from support.hostile import Malicious

SOURCE = Path(jounce.__file__).parent
CALL = re.compile(r"\b(robot|motion|Motion|Robot)\.[a-z_]+\(|\b[a-z_]+=(?=\W|$|'|\d)(?!=)")  # robot.f(...), argument=
DEGREES = "t,joint1,joint2\n" + "".join(f"{0.01 * i},{90 * np.sin(0.01 * i)},{9 * i}\n" for i in range(60))
PLAN = """joint_names: [joint1, joint2]
points:
  - {positions: [0, 0], time_from_start: {sec: 0}}
  - {positions: [1, 1], time_from_start: {sec: 1}}
  - {positions: [0, 1], time_from_start: {sec: 2}}
"""


@pytest.fixture(scope="module")
def cures_folder(tmp_path_factory):
    found = tmp_path_factory.mktemp("cures")
    t = np.arange(200) * 0.01
    good = np.c_[t, np.sin(3 * t), np.cos(2 * t)]
    for name, header, rows in (
        ("samples.csv", "t,joint1,joint2", good),
        ("few.csv", "t,joint1,joint2", good[:8]),
        ("others.csv", "stamp,fer_1,fer_2", good),
        ("millis.csv", "t,joint1,joint2", good * [1e3, 1, 1]),
        ("back.csv", "t,joint1,joint2", good[::-1]),
        ("noisy.csv", "t,joint1,joint2", good + [0, 0.2, 0.2] * np.random.default_rng(0).normal(size=good.shape)),
    ):
        np.savetxt(found / name, rows, delimiter=",", header=header, comments="")
    (found / "degrees.csv").write_text(DEGREES)
    (found / "cells.csv").write_text(DEGREES.replace("0.1,", "none,", 1))
    rates = ",".join(f"joint{j}.{rate}" for j in (1, 2) for rate in ("q", "qd", "q2d", "q3d", "q4d"))
    rows = "".join(f"{i}{',0' * 10}\n" for i in range(60))
    (found / "rates.csv").write_text(f"t,{rates}\n{rows}60,x{',0' * 9}\n")
    (found / "plan.yaml").write_text(PLAN)
    (found / "limits.yaml").write_text("units: SI\njoints: {joint1: {velocity: 1, acceleration: 2, effort: 1}}\n")
    return found


WRONG = """\
check iiwa14 paper
retime iiwa14 paper -o o.csv
slowdown iiwa14 paper -o o.csv
explain iiwa14 paper --rate 500
explain panda plan.yaml --controller ur
explain planar2r samples.csv
motors iiwa14 paper -o o.csv
motors planar2r samples.csv --stiffness 100 -o o.csv
excite planar2r -o o.csv
excite g1 --base floating -o o.csv
identify planar2r samples.csv -o k.yaml
payload planar2r samples.csv
stiffness planar2r samples.csv --motors m{number} -o k.yaml
run planar2r few.csv -o o.csv
run planar2r others.csv -o o.csv
run planar2r millis.csv -o o.csv
run planar2r back.csv -o o.csv
run planar2r noisy.csv -o o.csv
run planar2r degrees.csv -o o.csv
run planar2r cells.csv -o o.csv
run planar2r rates.csv -o o.csv
run planar2r absent.csv -o o.csv
run g1 samples.csv --base floating -o o.csv
run planar2r paper --degree 7 -o o.csv
run planar2r plan.yaml --rename a=b -o o.csv
run planar2r samples.csv --measured motors -o o.csv
run planar2r samples.csv --base floating -o o.csv
run planar2r plan.yaml --topic /a -o o.csv
retime planar2r plan.yaml --limits limits.yaml -o o.csv
slowdown planar2r plan.yaml --limits limits.yaml -o o.csv
retime planar2r samples.csv --limits limits.yaml -o o.csv
check planar2r plan.yaml --limits limits.yaml --rate 100
live planar2r few.csv
live planar2r others.csv
live planar2r degrees.csv
live planar2r back.csv
live planar2r samples.csv --bandwidth 1e6
live planar2r samples.csv --columns q
report planar2r others.csv -o o.html
codegen planar2r --lang c --outputs motor_torques -o out
view planar2r others.csv
motion planar2r others.csv -o o.csv
compare planar2r
convert planar2r -o o.yaml --base floating
info planar2r --base floating --lock joint1=0
""".splitlines()


@pytest.mark.parametrize("line", WRONG)
def test_no_command_names_a_call_of_python_or_an_option_it_lacks(line, cures_folder, monkeypatch):
    monkeypatch.chdir(cures_folder)
    words = line.split()
    result = call(*words)
    said = result.stderr + (result.stdout if result.exit_code == 0 else "")
    verb = main.commands[words[0]]
    assert "Usage:" not in said, said  # the command read its line
    assert not CALL.search(said), said
    assert find_options(said) <= {name for option in verb.params for name in option.opts}, said


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (None, "a=1 does, or b() does"),
        ({"--a", "--c"}, "--a 1 does, or --c does"),
        ({"--a"}, "--a 1 does"),
        ({"--b"}, ""),
    ],
)
def test_a_cure_is_in_the_words_of_its_reader(options, expected):
    cures = [Remedy("a=1 does", "--a 1 does"), Remedy("b() does", "--c does")]
    if options is None:
        assert join_cures(cures) == expected
        return
    with running_command(options):
        assert join_cures(cures) == expected
    assert join_cures(cures) == "a=1 does, or b() does"  # Python again


def test_names_of_options_and_of_arguments():
    assert option_name("time_unit") == "time_unit"
    with running_command(["--time-unit"]):
        assert (option_name("time_unit"), option_name("topic")) == ("--time-unit", "")
    assert option_value("eps", 0.1) == "eps=0.1"
    assert option_value("test", "log 2") == "test='log 2'"
    with running_command(["--eps"]):
        assert (option_value("eps", 0.1), option_value("test", "log 2")) == ("--eps 0.1", "")
    assert find_options("--a b, `jounce run --rates`, a--b; --c-d.") == {"--a", "--c-d"}


def test_values_are_quoted_for_their_reader_only():
    """In Python a value may be of a type that has no text; at the shell all of them are texts."""
    assert option_value("eps", Malicious()).startswith("eps=<Malicious instance")


def test_rows_that_are_read_ahead_in_a_thread_have_the_same_reader():
    texts = (str(Remedy("a=1", "--a 1")) for _ in range(3))
    with running_command(["--a"]):
        assert [*part_rows.read_ahead(texts)] == ["--a 1"] * 3


UNFILLED = re.compile(r"\{\w+\(['\"]")  # of a text without its f, which would print the call
LIBRARY = sorted(
    path for path in SOURCE.rglob("*.py") if path.relative_to(SOURCE).parts[0] not in ("cli", "_codegen", "_report")
)


def plain_texts(tree):
    """The texts of a module that are no docstrings, nor within a call of what words cures for their reader."""
    chosen = {
        inner
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") in ("Remedy", "option_name")
        for inner in ast.walk(node)
    }
    lines = {
        node.value for node in ast.walk(tree) if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and node not in chosen | lines:
            yield node.value


@pytest.mark.parametrize("path", LIBRARY, ids=lambda path: path.relative_to(SOURCE).as_posix())
def test_texts_of_the_library_name_no_option_but_in_cures(path):
    """An option in other words would be read in Python as well."""
    texts = [*plain_texts(ast.parse(path.read_text(encoding="utf-8")))]
    assert [text for text in texts if OPTION.search(text) and find_options(text)] == []
    assert [text for text in texts if UNFILLED.search(text)] == []
