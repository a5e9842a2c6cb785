"""The pages, README.md and all of docs/, run as printed: files are written, commands and Python run, in page order.

A fence with a title holds a file. Indented, or after ``$`` in a ``console`` fence, `jounce ...` is a command, after
``$`` another tool or what one made too, where all it takes is there; lines without ``$`` are its output, ``...``
standing for any of it. Python fences are doctests, all of a page in one session.
"""

import doctest
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest

import jounce
from support import cupy_on_cpu
from support.commands import call
from support.tools import obstacle, require

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
BLOCK = re.compile(r'^```(\w+)(?: title="([^"]+)")?\n(.*?)^```$|^    (jounce [^\n]+)$', re.MULTILINE | re.DOTALL)

COMMAND = re.compile(r"^\$ ((?:.*\\\n)*.+)\n((?:(?!\$ ).*\n)*)", re.MULTILINE)
TOOLS = {  # by what a command says, the tools that it takes
    "": "make", "gcc": "gcc", "./": "gcc", "g++": "g++", "arm-none-eabi": "arm-none-eabi-gcc",
    " size": "arm-none-eabi-gcc", "qemu": "qemu-system-arm", "octave": "octave-cli", "node": "node",
}  # fmt: skip


def blocks(page: Path) -> Iterator[tuple[str, str, int]]:
    """What can run in a page: its kind, text and line. A file is of the kind of its name."""
    text = page.read_text()
    for found in BLOCK.finditer(text):
        language, title, inner, command = found.groups()
        kind = title or language or "console"
        yield kind, inner if command is None else f"$ {command}\n", text[: found.start()].count("\n") + 1


def run_commands(session: str) -> set[str]:
    """Runs them; what is wrong with the tools for which some are left out."""
    missed = set()
    for command, expected in COMMAND.findall(session):
        words = shlex.split(command.replace("\\\n", ""), comments=True)
        missing = {found for said, tool in TOOLS.items() if said in command and (found := obstacle(tool))}
        if words[0] != "jounce" and missing:
            missed |= missing
            continue
        output = run_jounce(words[1:]) if words[0] == "jounce" else run_tool(words)
        if expected:
            assert doctest.OutputChecker().check_output(expected, output, doctest.ELLIPSIS), output
    return missed


def run_jounce(words: list[str]) -> str:
    result = call(*words)
    findings = words[0] in ("check", "explain")  # which exits with 1 where it finds a broken limit
    assert result.exit_code in (0, 1 * findings), f"{words}: {result.output}"
    if "-o" in words:
        made = Path(words[words.index("-o") + 1])
        assert sum(path.stat().st_size for path in ([made] if made.is_file() else made.iterdir())) > 1000
    return result.output


def run_tool(words: list[str]) -> str:
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 0, f"{words}: {done.stdout}{done.stderr}"
    return done.stdout


def run_python(session: str, names: dict[str, object], place: str, line: int) -> None:
    test = doctest.DocTestParser().get_doctest(session, {}, place, place, line)
    assert test.examples, f"{place}:{line}: Python that is no doctest"
    test.globs, report = names, []
    doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(test, out=report.append, clear_globs=False)
    assert not report, "".join(report)


@pytest.mark.filterwarnings("default::jounce.JounceWarning")  # a page may show others
@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_a_page_runs_as_printed(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    if "jounce cache" in page.read_text():  # some clear it
        monkeypatch.setenv("JOUNCE_CACHE_DIR", str(tmp_path / "kernels"))
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    if page.stem == "gpu" and find_spec("cupy") is None:
        require("g++")
        monkeypatch.setitem(sys.modules, "cupy", cupy_on_cpu)
    names: dict[str, object] = {"__name__": "__main__"}
    missed: set[str] = set()
    for kind, text, line in blocks(page):
        if kind == "python":
            run_python(text, names, str(page.relative_to(ROOT)), line)
        elif kind == "console":
            missed |= run_commands(text)
        elif "." in kind:
            (tmp_path / kind).write_text(text)
        elif kind != "bibtex":
            assert kind == "sh", f"{page.name}:{line}: a block of {kind} that nothing runs"
            assert "jounce " not in text, f"{page.name}:{line}: a command that nothing runs"
    if missed:
        pytest.skip(f"commands are left out: {'; '.join(sorted(missed))}")


def test_every_public_name_of_a_robot_has_its_place_in_the_api():
    pages = "\n".join(page.read_text(encoding="utf-8") for page in (ROOT / "docs" / "api").glob("*.md"))
    listed = set(re.findall(r"(?<!_)members: \[(.*)\]", pages)[0].split(", "))
    named = set(re.findall(r"::: jounce\.Robot\.(\w+)", pages))
    public = {name for name in dir(jounce.Robot) if not name.startswith("_")}
    assert listed | named == public
    headed = [line for line in pages.splitlines() if line.startswith("::: ")]
    assert {f"::: jounce.{name}" for name in jounce.__all__ if name != "__version__"} <= set(headed)
    assert sorted(headed) == sorted(set(headed))  # a link to a name leads to one place


@pytest.mark.parametrize(("page", "least"), [(PAGES[0], 20), (ROOT / "CONTRIBUTING.md", 10)], ids=lambda x: str(x)[-9:])
def test_files_that_pages_at_the_root_link_to_exist(page, least):
    links = re.findall(r"\]\((?!https?:|#)([^)#]+)", page.read_text(encoding="utf-8"))
    assert len(links) > least
    assert [link for link in links if not (ROOT / link).exists()] == []


def test_nothing_of_the_pages_escapes_the_test():
    """As many commands are run as the pages name outside of prose."""
    for page in PAGES:
        named = re.findall(r"^(?:    |\$ )jounce ", page.read_text(), re.MULTILINE)
        run = [c for kind, text, _ in blocks(page) if kind == "console" for c in re.findall(r"^\$ jounce ", text, re.M)]
        assert len(run) == len(named), page
    assert sum(kind == "console" for page in PAGES for kind, _, _ in blocks(page)) >= 10


def test_no_page_has_footnotes():
    """The site has no extension for them: it would print the marks."""
    assert not [page.name for page in PAGES if re.search(r"\w\[\^\w+\]", page.read_text(encoding="utf-8"))]
