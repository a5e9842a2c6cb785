"""The help: groups of commands, sections of options, how tables are read; options given twice or by former names."""

import click
import pytest

from jounce.cli import GROUPS, main
from jounce.cli.commands import TABLES_LINE, TableOption
from support.commands import call, run

MAX_LINES = 60  # a page of a terminal
COMMANDS = sorted(main.commands)
ON_MOTIONS = [name for name, verb in main.commands.items() if any(isinstance(x, TableOption) for x in verb.params)]


def test_commands_stand_in_groups():
    text = run("--help").stdout
    assert sum(map(len, GROUPS.values())) == len(COMMANDS)
    for title, commands in GROUPS.items():
        group = text.split(f"\n{title}:\n")[1].split("\n\n")[0]
        assert [line.split()[0] for line in group.splitlines()] == [verb.name for verb in commands]


@pytest.mark.parametrize("name", COMMANDS)
def test_the_help_of_a_command_fits_a_page(name):
    lines = run(name, "--help").stdout.splitlines()
    assert len(lines) <= MAX_LINES
    assert max(map(len, lines)) <= 80
    assert run("help", name).stdout.splitlines() == lines


@pytest.mark.parametrize("name", ON_MOTIONS)
def test_options_of_tables_are_named_in_one_line(name):
    text = run(name, "--help").stdout
    assert TABLES_LINE in text
    options = [x.opts[0] for x in main.commands[name].params if isinstance(x, TableOption)]
    assert {"--read", "--bandwidth", "--columns", "--rename", "--topic", "--step"} <= {*options}
    assert [option for option in options if f"\n  {option} " in text] == []


def test_the_help_of_tables_has_all_their_options():
    text = run("help", "tables").stdout
    options = [x.opts[0] for x in main.commands["run"].params if isinstance(x, TableOption)]
    assert [option for option in options if f"  {option} " not in text] == []
    assert max(map(len, text.splitlines())) <= 80


def test_unknown_topics_are_refused():
    assert "unknown topic 'tabels'; did you mean 'tables'?" in run("help", "tabels", code=2).stderr
    assert run("help").stdout == run("--help").stdout


@pytest.mark.parametrize("name", COMMANDS)
def test_an_option_of_one_value_is_refused_twice(name):
    verb = main.commands[name]
    options = [x for x in verb.params if isinstance(x, click.Option) and not (x.multiple or x.is_flag or x.is_eager)]
    for option in options:
        word = option.opts[-1]
        values = ["1"] * option.nargs
        result = call(name, word, *values, word, *values)
        assert result.exit_code == 2
        assert f"{word} is given 2 times; expected it once" in result.stderr


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("check iiwa14 paper --limits iiwa14 -o ratio.svg", "draw the ratios by --picture ratio.svg"),
        ("check iiwa14 paper --table ratio.csv", "--table is now -o"),
        ("identify iiwa14 log.csv -o found.yaml --plot torques.svg", "--plot is now --picture"),
        ("run iiwa14 paper --reduce peak", "--reduce writes a table of aggregates; give its path with -o"),
        ("run iiwa14 paper -o forces.svg", "unknown type of table '.svg'"),
        ("demo -o out --format png,gif", "unknown format of pictures 'gif'"),
        ("run iiwa14 paper --drives damping,,friction -o o.csv", "expected names with commas between them"),
    ],
)
def test_other_forms_are_refused_in_one_line(words, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = call(*words.split())
    assert result.exit_code == 2
    assert said in result.stderr.splitlines()[-1]
    assert list(tmp_path.iterdir()) == []


def test_lists_of_names_may_be_given_one_by_one(tmp_path):
    motion, one, other = (tmp_path / f"{name}.csv" for name in ("motion", "one", "other"))
    run("motion", "iiwa14", "paper", "--step", 0.1, "-o", motion)
    run("run", "iiwa14", motion, "--reduce", "peak,rms", "-o", one)
    run("run", "iiwa14", motion, "--reduce", "peak", "--reduce", "rms", "-o", other)
    assert one.read_bytes() == other.read_bytes()


def test_a_run_without_an_output_prints_the_summary_alone(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    alone = run("run", "iiwa14", "paper", "--step", 0.1).stdout
    written = run("run", "iiwa14", "paper", "--step", 0.1, "-o", "forces.csv").stdout
    assert alone == written.replace("Q, Qd, Q2d written to forces.csv\n", "")
    assert [path.name for path in tmp_path.iterdir()] == ["forces.csv"]
