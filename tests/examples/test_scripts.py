"""The scripts of examples/ run, its README lists them all, and those of one capability each are numbered and short."""

import ast
import re
import runpy
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SCRIPTS = sorted((ROOT / "examples").glob("*.py"))


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_runs(script, tmp_path, monkeypatch, capsys):
    for node in ast.parse(script.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Import):
            pytest.importorskip(node.names[0].name)
    if "codegen" in script.read_text(encoding="utf-8"):
        monkeypatch.setattr(sys, "argv", [str(script), str(tmp_path)])
    else:
        monkeypatch.setattr(sys, "argv", [str(script)])
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(script), run_name="__main__")
    assert capsys.readouterr().out


def test_are_numbered_short_and_listed():
    listed = re.findall(r"\((\w+\.py)\)", (ROOT / "examples/README.md").read_text(encoding="utf-8"))
    assert listed == [path.name for path in SCRIPTS]
    for number, path in enumerate(sorted((ROOT / "examples").glob("[0-9]*.py")), 1):
        assert path.name.startswith(f"{number:02}_")
        assert len(path.read_text(encoding="utf-8").splitlines()) <= 60, path
