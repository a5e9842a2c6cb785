"""Command lines of jounce, run within the process of the test."""

import json

from click.testing import CliRunner

from jounce.cli import main


def call(*words, given=""):
    """The result of a command line, whatever its exit code is."""
    return CliRunner().invoke(main, [*map(str, words)], input=given)


def run(*words, code=0, given=""):
    """The result of a command line that ends with an exit code."""
    result = call(*words, given=given)
    assert result.exit_code == code, result.output
    return result


def summary(*words, codes=(0,)):
    """What a command prints as JSON, for scripts; it ends with one of these exit codes."""
    result = call(*words, "--json")
    assert result.exit_code in codes, result.output
    return json.loads(result.stdout)
