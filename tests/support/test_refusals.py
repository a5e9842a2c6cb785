"""The runner of refusals notices what a message lacks, and what a command leaves behind."""

import pytest

import jounce
from support.refusals import holds, refusal, refused


@pytest.mark.parametrize(("word", "held"), [
    ("joint 'x' (1.5)", True),
    ("joint 'x' (125)", False),
    ("^unknown joint", True),
    ("^joint", False),
    ("a, b$", True),
    ("available$", False),
    ("^unknown…b$", True),
    ("available…unknown", False),
])  # fmt: skip
def test_words_are_held_where_they_say(word, held):
    assert holds("unknown joint 'x' (1.5); available: a, b", word) == held


@pytest.mark.parametrize(("said", "words"), [
    ("unknown joint", ["unknown body"]),
    ("unknown joint", [*"unk"]),
    ("got <object object at 0x7f>", []),
    ("got np.float64(1.0)", []),
    ("got <class 'float'>", []),
])  # fmt: skip
def test_other_messages_are_noticed(said, words):
    def call():
        raise jounce.JounceError(said)

    with pytest.raises(AssertionError):
        refusal(call, *words)


def test_what_is_not_refused_is_noticed():
    with pytest.raises(pytest.fail.Exception):
        refusal(dict)
    with pytest.raises(ZeroDivisionError):
        refusal(lambda: 1 / 0)


@pytest.mark.parametrize("left", ["file", "change", "words", "nothing"])
def test_what_a_command_leaves_is_noticed(tmp_path, monkeypatch, left):
    (tmp_path / "kept").write_text("old")

    def load(*_, **__):
        if left == "file":
            (tmp_path / "new").touch()
        if left == "change":
            (tmp_path / "kept").write_text("new")
        if left == "words":
            print("so far")
        raise jounce.JounceError("stop")

    monkeypatch.setattr("jounce.robot.loading.load", load)
    if left == "nothing":
        assert refused(tmp_path, "info planar2r", "^stop$") == "stop"
        return
    with pytest.raises(AssertionError):
        refused(tmp_path, "info planar2r", "stop")
