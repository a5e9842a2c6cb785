"""What editors and Python show of the methods that are generated from the table of quantities."""

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
from support.docstrings import docstring, list_options
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
def test_a_method_takes_what_its_row_says(row):
    method = getattr(jounce.Robot, row.name)
    signature = inspect.signature(method)
    more = 0 if row.gives.results else 2  # further rates that have names in all methods
    names = row.takes.names(row.takes.rates + more)
    assert list(signature.parameters)[1 : len(names) + 1] == list(names)
    assert all(x.default is None for x in list(signature.parameters.values())[row.takes.rates + 1 : len(names) + 1])
    assert [x.name for x in signature.parameters.values() if x.kind is x.KEYWORD_ONLY] == list(list_options(row))
    assert all(x.annotation is not x.empty for x in list(signature.parameters.values())[1:])


@pytest.mark.parametrize("row", QUANTITIES.values(), ids=QUANTITIES)
def test_a_docstring_names_the_module_of_the_row(row):
    method = getattr(jounce.Robot, row.name)
    assert inspect.getdoc(method) == docstring(row)
    [module] = re.findall(r"^ *Computed by `(.*)`\.$", method.__doc__, re.MULTILINE)
    assert f"def {row.name}(m: Mechanism, x: State" in inspect.getsource(sys.modules[module])


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
def test_an_editor_shows_the_method_its_parameters_and_its_source(server, line):
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
    _, first = inspect.getsourcelines(getattr(jounce.Robot, name))
    file = Path(inspect.getfile(getattr(jounce.Robot, name))).as_uri()
    assert (file, first - 1) in [(place["uri"], place["range"]["start"]["line"]) for place in places]


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
        assert re.match(rf'{number + 1}: error: Argument .* to "{name}" of "QuantityMethods" has incompatible', line)
        assert len(line) < 360
