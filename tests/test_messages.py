"""What stands in messages and tables: one line each, cut, and nothing that a terminal would take for a command."""

import copy
import pickle
import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import jounce
from jounce.core.errors import (
    MAX_MESSAGE_LENGTH,
    MAX_QUOTED_LENGTH,
    escape_text,
    join_names,
    one_line,
    quote_value,
    shorten,
    unknown_name_error,
)
from support.commands import call
from support.files import BODY, joint, link, robot_file
from support.refusals import refusal

ODD = "\x1b[31m\u202edrow\u2066\n\u2028\x00\x7f\x85\xad\ud800\u200b"  # colour, directions, ends of lines, half a pair
TEXTS = st.text(st.characters(), max_size=3 * MAX_QUOTED_LENGTH)
PLAIN = TEXTS | st.integers() | st.floats() | st.binary() | st.none()
VALUES = st.recursive(PLAIN, lambda inner: st.lists(inner) | st.tuples(inner))


@given(TEXTS)
def test_every_error_and_warning_is_one_printable_line(text):
    for kind in (jounce.JounceError, jounce.JounceWarning):
        said = kind(text)
        assert str(said).isprintable()
        assert str(kind(str(said))) == str(said)
        assert str(copy.copy(said)) == str(pickle.loads(pickle.dumps(said))) == str(said)
        assert not text.isprintable() or str(said) == text


@pytest.mark.parametrize("within", [np.errstate(all="ignore"), np.vectorize])
def test_a_warning_is_of_the_line_that_calls_jounce_via_numpy(within):
    t = np.linspace(0, 2, 400)
    with pytest.warns(jounce.JounceWarning, match="rounding of the samples .* of joint 0;") as caught:
        within(lambda digits: jounce.Motion.through(t, np.sin(t).round(digits)[:, None]).start)(4)
    assert caught[0].filename == __file__


def test_an_endless_message_keeps_its_ends():
    for kind in (jounce.JounceError, jounce.JounceWarning):
        said = str(kind(f"what came {'1' * 5000} what cures it"))
        assert len(said) <= MAX_MESSAGE_LENGTH
        assert said.startswith("what came 1")
        assert said.endswith("1 what cures it")
        assert str(kind(said)) == said
        longest = "1" * MAX_MESSAGE_LENGTH
        assert str(kind(longest)) == longest


@given(VALUES)
def test_whatever_is_quoted_is_cut(value):
    said = quote_value(value)
    assert said.isprintable()
    assert len(said) <= 10 * (MAX_QUOTED_LENGTH + 3) + 2  # each character may be escaped
    assert not (isinstance(value, str) and len(value) <= MAX_QUOTED_LENGTH) or said == repr(value)


@given(st.lists(TEXTS))
def test_names_in_a_row_are_cut_and_escaped(names):
    assert join_names(names).isprintable()
    assert str(unknown_name_error("thing", "".join(names), names)).isprintable()
    assert all(len(shorten(name)) <= MAX_QUOTED_LENGTH + 3 for name in names if name.isprintable())


def test_what_they_look_like():
    assert quote_value("x" * 81) == f"'{'x' * 80}...'"
    assert shorten("x" * 81) == "x" * 80 + "..."
    assert escape_text(ODD) == r"\x1b[31m\u202edrow\u2066\n\u2028\x00\x7f\x85\xad\ud800\u200b"
    assert quote_value(np.str_("a\nb")) == r"'a\nb'"
    numbers = [np.float64(0.1169), np.float32(0.1), np.int64(3), np.bool_(True), np.complex128(1j)]
    assert [quote_value(x) for x in numbers] == ["0.1169", "0.1", "3", "True", "1j"]
    assert quote_value([np.float64(0.5), {"a": (np.int8(1), np.str_("b"))}]) == "[0.5, {'a': (...)}]"
    assert quote_value((np.float64(0.5), [np.nan, np.float64("inf")])) == "(0.5, [nan, inf])"
    assert quote_value(np.array(0.5)) == "array(0.5)"
    assert quote_value(10**5000) == "an integer of 16610 bits"
    assert one_line("two\n lines") == "two lines"
    assert quote_value([[[1]]] * 9) == "[[[...]], [[...]], [[...]], [[...]], ...]"
    assert escape_text("łódź, Grüße, 腕, שלום") == "łódź, Grüße, 腕, שלום"


def robot_named(folder, name, of_arm):
    """A robot by a name, its joint and its body too, where a file can hold it."""
    arm, turn = link(of_arm, BODY), joint(of_arm, "base", of_arm)
    return robot_file(folder, link("base"), arm, turn, head=f'<robot name="{name}">')


REFERENCES = "&#x9;&#x202e;&#x85;\u2066"  # what XML lets through of what does not print


@pytest.mark.parametrize(
    "asked", [["info"], ["convert", "-o", "arm.yaml"], ["run", "motion.csv", "--degree", "7", "-o", "out.csv"]]
)
def test_names_of_a_file_are_shown_as_texts(tmp_path, monkeypatch, asked):
    monkeypatch.chdir(tmp_path)
    path = robot_named(tmp_path, f"r{REFERENCES}{'x' * 300}", f"j{REFERENCES}{'y' * 300}")
    name = jounce.load(path).joint_names[0]
    t = np.arange(9.0)
    np.savetxt("motion.csv", np.stack([t, np.sin(t)], 1), delimiter=",", header=f"t,{name}", encoding="utf-8")
    verb, *others = asked
    result = call(verb, path, *others)
    assert result.exit_code == 0, result.output
    lines = result.output.splitlines()
    assert [line for line in lines if not line.isprintable()] == []
    assert lines[0].count("x") <= MAX_QUOTED_LENGTH
    assert max(line.count("y") for line in lines) <= 2 * MAX_QUOTED_LENGTH  # once for the joint, once for the body


LONG = "x" * 300


@pytest.mark.parametrize("of_arm", [f"a{REFERENCES}", LONG])
def test_attributes_in_refusals_are_cut_and_escaped(tmp_path, of_arm):
    for old, new in (('value="2.0"', f'value="{of_arm}"'), (f'child link="{of_arm}"', f'child link="{of_arm}2"')):
        path = robot_named(tmp_path, "r", of_arm)
        text = path.read_text(encoding="utf-8")
        assert old in text
        path.write_text(text.replace(old, new), encoding="utf-8")
        message = refusal(lambda: jounce.load(path), f"{path}:")  # noqa: B023
        assert LONG not in message


@pytest.mark.parametrize("name", ["robot.yaml", "robot.json"])
def test_entries_in_refusals_are_cut_and_escaped(tmp_path, name):
    path = tmp_path / name
    for entry in (f'"{LONG}": 1', f'"name": 1, "units": "{LONG}"', r'"units": "\u202e\u001b"'):
        path.write_text(f'{{"bodies": [], {entry}}}', encoding="utf-8")
        assert LONG not in refusal(lambda: jounce.load(path), str(path))


@pytest.mark.filterwarnings("always")
def test_warnings_of_all_kinds_are_shown_as_texts(monkeypatch):
    def warns(*_, **__):
        warnings.warn(f"strange {ODD}", UserWarning, stacklevel=2)
        raise jounce.JounceError("stop")

    monkeypatch.setattr("jounce.robot.loading.load", warns)
    result = call("info", "planar2r")
    assert [line.isprintable() for line in result.stderr.splitlines()] == [True, True]
