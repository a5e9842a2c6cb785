"""Python without assertions (-O), and without docstrings too (-OO), computes what Python computes."""

import json
import subprocess
import sys

import numpy as np
import pytest

import jounce

SCRIPT = """
import json, sys
from click.testing import CliRunner
import jounce
from jounce.cli import main
from jounce._codegen import symbolic

def call(*words, status=0):
    result = CliRunner().invoke(main, words)
    if result.exit_code != status:
        sys.exit(f"{words}: {result.exit_code} {result.output} {result.exception!r}")
    return result.stdout

folder = sys.argv[1]
torques = jounce.load("planar2r").inverse_dynamics([0.1, 0.2], [1.0, 2.0], [3.0, 4.0]).tolist()
run = json.loads(call("run", "iiwa14", "paper", "-o", f"{folder}/forces.csv", "--json"))
call("check", "iiwa14", "paper", "--limits", "iiwa14", status=1)  # it is too fast
call("codegen", "planar2r", "--lang", "python", "-o", f"{folder}/code")
helps = [len(call(name, "--help")) for name in main.list_commands(None)]
print(json.dumps([sys.flags.optimize, torques, run["peaks"], helps]))
"""


@pytest.mark.parametrize("level", [1, 2])
def test_commands_work_without_assertions_and_docstrings(tmp_path, level):
    words = [sys.executable, f"-{'O' * level}", "-c", SCRIPT, tmp_path]
    done = subprocess.run(words, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    flag, torques, peaks, helps = json.loads(done.stdout)
    assert flag == level
    assert np.allclose(
        torques, jounce.load("planar2r").inverse_dynamics([0.1, 0.2], [1.0, 2.0], [3.0, 4.0]), rtol=1e-14
    )
    assert set(peaks) == set(jounce.load("iiwa14").joint_names)
    assert min(helps) > 100
