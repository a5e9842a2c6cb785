"""Tests that need a program skip where it is missing, and where it is there but does not run."""

import os

import pytest

from support.tools import needs, obstacle, require

COUNT = 'echo x >> "$(dirname "$0")/calls"'


@pytest.fixture
def program(tmp_path, monkeypatch):
    """Writes a program under a name of its own, which is forgotten after the test."""
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")

    def written(text):
        (tmp_path / "jounce-fake").write_text(text)
        (tmp_path / "jounce-fake").chmod(0o700)
        return "jounce-fake"

    yield written
    obstacle.cache_clear()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (f"#!/bin/sh\n{COUNT}\necho 1.0\n", None),
        (f"#!/bin/sh\n{COUNT}\nexit 1\n", "jounce-fake does not run: exit code 1"),
        (f"#!/bin/sh\n{COUNT}\necho no toolchain >&2\necho help\nexit 1\n", "jounce-fake does not run: no toolchain"),
        ("#!/no/such/shell\n", "jounce-fake does not run: "),
    ],
)
def test_a_program_is_asked_once_whether_it_runs(program, tmp_path, text, words):
    name = program(text)
    found = obstacle(name)
    assert obstacle(name) is found
    assert found is None if words is None else found.startswith(words)
    calls = tmp_path / "calls"
    assert not calls.exists() or calls.read_text() == "x\n"


def test_what_needs_a_program_is_skipped_in_words(program):
    name = program("#!/bin/sh\nexit 3\n")
    mark = needs(name, "jounce-missing").mark
    assert mark.args == (True,)
    assert mark.kwargs["reason"] == "jounce-fake does not run: exit code 3; no jounce-missing"
    with pytest.raises(pytest.skip.Exception, match="does not run: exit code 3"):
        require(name)
    require()
    assert needs().mark.args == (False,)
