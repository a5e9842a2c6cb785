"""Pictures that a page makes: its blocks run when the site is built, and what they draw stands among the pictures."""

import doctest
import os
import re
import shlex
import warnings
from contextlib import chdir
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

DOCS = Path(__file__).parents[1]
PAGES = [
    "tutorials/my-urdf.md",
    "tutorials/from-a-log-to-torques.md",
    "tutorials/elastic-panda.md",
    "tutorials/humanoid.md",
    "tutorials/delta.md",
    "tutorials/identify-a-robot.md",
    "howto/minimum-torque-change.md",
    "howto/contacts.md",
    "howto/retime.md",
    "derivation/examples.md",
]
BLOCK = re.compile(r'^```(\w+)(?: title="([^"]+)")?\n(.*?)^```$', re.MULTILINE | re.DOTALL)
COMMAND = re.compile(r"^\$ jounce ((?:.*\\\n)*.+)$", re.MULTILINE)


def on_files(files: Any, config: Any, **_: Any) -> Any:
    """The files of the site with the pictures that pages make."""
    from mkdocs.structure.files import File

    for page in PAGES:
        for name, content in made_by((DOCS / page).read_text(encoding="utf-8")).items():
            files.append(File.generated(config, f"pictures/{name}", content=content))
    return files


def made_by(page: str) -> dict[str, bytes]:
    """The pictures that the Python and the commands of a page leave in an empty folder, by the names of their files."""
    from click.testing import CliRunner

    from jounce.cli import main

    names: dict[str, Any] = {"__name__": "__main__"}
    with TemporaryDirectory() as folder, chdir(folder), warnings.catch_warnings(action="ignore"):
        Path("examples").symlink_to(DOCS.parent / "examples")
        for language, file, text in BLOCK.findall(page):
            if file:
                Path(file).write_text(text, encoding="utf-8")
            elif language == "python":
                _run(text, names)
            for words in COMMAND.findall(text) if language == "console" else ():
                result = CliRunner().invoke(main, shlex.split(words.replace("\\\n", "")))
                if result.exit_code:
                    raise RuntimeError(f"jounce {words}: {result.output}")
        drawn = sorted([*Path(os.curdir).glob("*.png"), *Path(os.curdir).glob("*.svg")])
        return {path.name: path.read_bytes() for path in drawn}


def _run(session: str, names: dict[str, Any]) -> None:
    """Run a session as it would be typed; the tests compare its output."""
    for example in doctest.DocTestParser().get_examples(session):
        if example.exc_msg is None:
            exec(compile(example.source, "<page>", "single"), names)
