"""The docstring of jounce is a guide by topics to all public names, on two screens."""

import inspect
import pydoc
import re
from importlib import import_module

import pytest

import jounce

SCREEN = 40  # lines
GUIDE = jounce.__doc__
NAMES = re.findall(r"[\w.-]+", " ".join(re.findall(r"^    (\w.*?)  ", GUIDE, re.MULTILINE)))
NOT_IN_PYTHON = {"--help", "..."}


def test_the_guide_fits_two_screens():
    assert len(GUIDE.splitlines()) <= 2 * SCREEN


def test_help_fits_three_screens():
    text = pydoc.plain(pydoc.render_doc(jounce))
    assert len(text.splitlines()) <= 3 * SCREEN
    assert "Identification" in text


def test_names_are_listed_to_all_but_pydoc():
    assert set(dir(jounce)) == {name for name, _ in inspect.getmembers(jounce)} == set(jounce.__all__)


@pytest.mark.parametrize("name", jounce.__all__)
def test_the_guide_has_every_public_name(name):
    assert re.search(rf"\b{name}\b", GUIDE) is not None


@pytest.mark.parametrize("name", sorted({*NAMES} - NOT_IN_PYTHON))
def test_the_guide_names_what_there_is(name):
    owner, _, last = name.rpartition(".")
    if name in ("jounce.cuda", "jounce.dask"):
        import_module(name)
    elif owner == "":
        assert last == "jounce" or hasattr(jounce, last) or hasattr(jounce.Robot, last)
    else:
        assert hasattr({"jounce": jounce, "Robot": jounce.Robot}[owner], last)
