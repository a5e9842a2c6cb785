"""How refusals are tested: tables of cases, `name: (call, [words])`, and what holds of every message.

A word is a text that the message holds: … in it stands for anything, ^ in front for the beginning of the message,
$ behind for its end. A compiled pattern is a word too.
"""

import re
from contextlib import chdir, contextmanager

import pytest
from click.testing import CliRunner

import jounce
from jounce.cli import main

OF_PYTHON = re.compile(r"Traceback|<(class|function|module) |<[\w.]+ object|\bat 0x|\bnp\.\w+\(")


def holds(message, word):
    """Whether a message has a word in it."""
    if not isinstance(word, re.Pattern):
        begin, end = "^" * word.startswith("^"), "$" * word.endswith("$")
        parts = word.removeprefix("^").removesuffix("$").split("…")
        word = re.compile(begin + ".*".join(map(re.escape, parts)) + end)
    return word.search(message) is not None


def check_message(message, words):
    """One line for a user, who sees nothing of Python in it."""
    assert sum(len(word) == 1 for word in words if isinstance(word, str)) < 3, "letters of a word in place of words"
    assert message.isprintable(), message  # hence one line
    assert OF_PYTHON.search(message) is None, message
    assert [word for word in words if not holds(message, word)] == [], message


@contextmanager
def expect_refusal(*words, kind=jounce.JounceError):
    """A context that ends with an error of one line, which holds all the words."""
    with pytest.raises(kind) as caught:
        yield caught
    check_message(str(caught.value), words)


def refusal(call, *words, kind=jounce.JounceError):
    """The message of the error that `call` raises: one line that holds all the words."""
    with expect_refusal(*words, kind=kind) as caught:
        call()
    return str(caught.value)


def refusals(cases):
    """The test of a table of calls and words: `name: (call, [words])`."""

    @pytest.mark.parametrize(("call", "words"), cases.values(), ids=cases)
    def test(call, words):
        refusal(call, *words)

    return test


def contents(folder):
    """What lies in a folder, and in those in it."""
    return {path: path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}


def refused(folder, asked, *words, **options):
    """The message of a command that ends with status 2 in a folder, where it leaves everything as it was.

    Without a folder it may leave parts that are finished.
    """
    before = contents(folder) if folder else {}
    with chdir(folder or "."):
        arguments = asked.split() if isinstance(asked, str) else map(str, asked)
        result = CliRunner().invoke(main, list(arguments), **options)
    assert isinstance(result.exception, SystemExit), result.exception
    assert (result.exit_code, result.stdout) == (2, ""), result.output
    [line] = result.stderr.splitlines()
    assert line.startswith("Error: "), line
    check_message(line.removeprefix("Error: "), words)
    assert (contents(folder) if folder else {}) == before
    return line.removeprefix("Error: ")
