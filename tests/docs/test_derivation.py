"""The derivation pages name every labelled equation of the code, and nothing that is not there."""

import re
from pathlib import Path

import listings
import pytest

ROOT = Path(__file__).parents[2]
PAGES = {page.name: page.read_text() for page in sorted((ROOT / "docs" / "derivation").glob("*.md"))}
ENTRY = re.compile(r"^### \((\w+)\) [^\n]+\n(.*?)(?=^##|\Z)", re.MULTILINE | re.DOTALL)
ENTRIES = [(label, text) for page in PAGES.values() for label, text in ENTRY.findall(page)]


def test_every_label_of_the_code_has_its_entry():
    assert set(listings.labelled()) - {label for label, _ in ENTRIES} == set()
    assert len(listings.labelled()) > 40


def test_every_listing_that_a_page_asks_for_is_there():
    asked = [found for page in PAGES.values() for found in listings.ASKED.findall(page)]
    assert len(asked) > 50
    assert all(listings.places(name, module or None) for name, module in asked)


def test_no_label_has_two_entries():
    labels = [label for label, _ in ENTRIES]
    assert len(set(labels)) == len(labels)


@pytest.mark.parametrize(("label", "text"), ENTRIES, ids=[label for label, _ in ENTRIES])
def test_an_entry_shows_its_formula_and_any_code(label, text):
    assert "$$" in text
    asked = listings.ASKED.findall(text)
    assert bool(asked) != ("*Not in the code*" in text)
    assert ("*Not in the code*" in text) == (label not in listings.labelled())
    shown = [place.text for name, module in asked for place in listings.places(name, module or None)]
    assert not asked or any(f"({label})" in lines for lines in shown)


def test_a_listing_is_the_whole_construct_that_ends_with_the_label(tmp_path, monkeypatch):
    (tmp_path / "room.py").write_text(
        "def f(x):\n    y = x @ x  # (One)\n    return (\n        y\n        + x\n    )  # (Two)  # fmt: skip\n"
    )
    monkeypatch.setattr(listings, "SOURCE", tmp_path)
    found = listings.labelled.__wrapped__()
    assert found["One"][0].text == "y = x @ x  # (One)"
    assert found["Two"][0].text.startswith("def f(x):")
    assert found["Two"][0].text.endswith(")  # (Two)")


@pytest.mark.parametrize("asked", ["Nowhere", "spatial.lie.nothing"])
def test_what_is_not_there_stops_the_build(asked):
    with pytest.raises(LookupError, match="no "):
        listings.places(asked)


@pytest.mark.parametrize("named", re.findall(r"`(test_\w+)\.py::(\w+)`", (ROOT / "docs" / "errata.md").read_text()))
def test_tests_that_the_errata_name_exist(named):
    file, test = named
    assert any(f"def {test}(" in path.read_text() for path in (ROOT / "tests").rglob(f"{file}.py"))


def test_every_erratum_names_its_test_or_says_why_it_has_none():
    errata = (ROOT / "docs" / "errata.md").read_text(encoding="utf-8")
    sections = re.findall(r"^### (.+?)\n(.*?)(?=^##|\Z)", errata, re.MULTILINE | re.DOTALL)
    assert len(sections) == 10
    for name, text in sections[:-1]:
        assert re.search(r"^\| test \| `test_", text, re.MULTILINE), name
    tables = [text for text in errata.split("\n\n") if re.match(r"\|.*\| test \|\n", text)]
    assert len(tables) == 2
    for row in "\n".join(table.split("\n", 2)[2] for table in tables).splitlines():
        assert re.search(r"`test_\w+\.py::\w+` \|$|\| none: .+ \|$", row), row
