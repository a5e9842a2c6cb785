"""What editors show of the methods that are made from the table of quantities."""

import inspect
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import jounce
from jounce.dynamics.quantities import QUANTITIES
from jounce.robot.docstrings import list_options
from support.language_server import LanguageServer
from support.stubs import stubs

PROGRAM = Path(__file__).with_name("editor.py")
SOURCES = Path(jounce.__file__).parents[1]
CALLS = {
    number: call[1]
    for number, line in enumerate(PROGRAM.read_text(encoding="utf-8").splitlines())
    if (call := re.match(r"robot\.(\w+)\(", line))
}


@pytest.mark.parametrize("path", stubs(), ids=lambda path: path.name)
def test_stubs_are_fresh(path):
    assert path.read_text(encoding="utf-8") == stubs()[path], "`make stubs` writes it"


@pytest.mark.parametrize("row", QUANTITIES.values(), ids=QUANTITIES)
def test_the_signature_of_a_method_is_a_line_of_names(row):
    method = getattr(jounce.Robot, row.name)
    signature = inspect.signature(method)
    assert len(str(signature)) < 160, signature
    more = 0 if row.gives.results else 2  # further rates that have names in all methods
    names = row.takes.names(row.takes.rates + more)
    assert list(signature.parameters)[1 : len(names) + 1] == list(names)
    assert all(x.default is None for x in list(signature.parameters.values())[row.takes.rates + 1 : len(names) + 1])
    assert [x.name for x in signature.parameters.values() if x.kind is x.KEYWORD_ONLY] == list(list_options(row))
    assert method.__qualname__ == f"Robot.{row.name}"


@pytest.mark.parametrize("row", QUANTITIES.values(), ids=QUANTITIES)
def test_the_source_of_a_method_is_its_row(row):
    source = inspect.getsource(getattr(jounce.Robot, row.name))
    assert re.match(r"\s*@(_\w+_)?quantity\(", source)
    assert f"def {row.name}(m: Mechanism, x: State" in source


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    pytest.importorskip("pyright")
    folder = tmp_path_factory.mktemp("user")
    shutil.copy(PROGRAM, folder)
    (folder / "pyrightconfig.json").write_text(json.dumps({"extraPaths": [str(SOURCES)]}))
    settings = {"python": {"pythonPath": sys.executable}}
    try:
        with LanguageServer([sys.executable, "-m", "pyright.langserver", "--stdio"], folder, settings) as running:
            running.open(folder / PROGRAM.name)
            yield running
    except AssertionError:
        pytest.skip("pyright does not run")  # without its Node


def ask_after(server, what, line, after):
    path = server.folder / PROGRAM.name
    return server.at(what, path, line, path.read_text(encoding="utf-8").splitlines()[line].index(after) + len(after))


@pytest.mark.parametrize("line", CALLS, ids=CALLS.values())
def test_an_editor_shows_the_method_its_parameters_and_its_row(server, line):
    name = CALLS[line]
    row, doc = QUANTITIES[name], inspect.getdoc(getattr(jounce.Robot, name))
    hover = ask_after(server, "hover", line, "robot.")["contents"]["value"]
    print(hover[: hover.index("Parameters")])
    assert hover.startswith("(method)"), hover
    assert f"def {name}(" in hover
    assert doc.splitlines()[0] in hover
    shown = ask_after(server, "signatureHelp", line, "(")["signatures"]
    print(*(signature["label"] for signature in shown), sep="\n")
    for order, signature in enumerate(shown[:3]):
        labels = [parameter["label"].partition(":")[0] for parameter in signature["parameters"]]
        assert labels == [*row.takes.names(row.takes.rates + order), "*", *list_options(row)]
    places = ask_after(server, "definition", line, "robot.")
    print(*(place["uri"].rpartition("/jounce/")[2] for place in places), sep="\n")
    source, first = inspect.getsourcelines(getattr(jounce.Robot, name))
    rows = [place for place in places if place["uri"].endswith(Path(inspect.getfile(getattr(jounce.Robot, name))).name)]
    assert [first - 1 <= place["range"]["start"]["line"] < first + len(source) for place in rows] == [True]


@pytest.mark.parametrize("name", CALLS.values())
def test_jedi_shows_the_method_and_its_docstring(name):
    jedi = pytest.importorskip("jedi")
    row, call = QUANTITIES[name], f"    robot.{name}("
    file = f"from jounce.robot.robot import Robot\ndef user(robot: Robot):\n{call})"
    script = jedi.Script(file, project=jedi.Project(str(PROGRAM.parent), added_sys_path=[str(SOURCES)]))
    [found] = script.help(3, len("    robot.") + 1)
    print(found.docstring())
    assert found.type == "function"
    assert row.printed.text.splitlines()[0] in found.docstring()
    shown = [x.name for x in script.get_signatures(3, len(call))[0].params if x.name]
    assert shown == [*row.takes.names(row.takes.rates), *list_options(row)]


def test_a_wrong_argument_costs_one_line_of_mypy():
    pytest.importorskip("mypy")
    environment = os.environ | {"MYPYPATH": str(SOURCES)}
    command = [sys.executable, "-m", "mypy", "--no-error-summary", str(PROGRAM)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=PROGRAM.parents[2], env=environment)
    print(done.stdout)
    lines = [re.sub(r"^.*?:(\d+): ", r"\1: ", line) for line in done.stdout.splitlines()]
    assert len(lines) == len(CALLS)
    for (number, name), line in zip(CALLS.items(), lines, strict=True):
        assert re.match(rf'{number + 1}: error: Argument .* to "{name}" of "Methods" has incompatible type', line)
        assert len(line) < 360
