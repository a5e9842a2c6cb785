"""The README's commands run as printed (its Python blocks are doctests)."""

import shlex
from pathlib import Path

import pytest
from click.testing import CliRunner

from jounce.cli import main

ROOT = Path(__file__).parents[1]
COMMANDS = [
    shlex.split(line, comments=True)[1:]
    for line in (ROOT / "README.md").read_text().splitlines()
    if line.startswith("    jounce ")
]


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_command_runs_as_printed(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    result = CliRunner().invoke(main, command)
    assert result.exit_code == 0, result.output
    for written in (word for word in command if word.startswith("forces.")):
        assert (tmp_path / written).stat().st_size > 1000


def test_there_are_commands():
    assert len(COMMANDS) >= 3
