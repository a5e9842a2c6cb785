"""Facts that pages quote are where the pages say."""

import re
from pathlib import Path

import facts
import pytest
from ruamel.yaml import YAML

import jounce

DOCS = Path(__file__).parents[2] / "docs"


def test_the_home_page_names_the_version():
    page = facts.on_page_markdown((DOCS / "index.md").read_text(encoding="utf-8"))
    assert f"Version {jounce.__version__}," in page


@pytest.mark.parametrize("words", facts.QUOTED.findall((DOCS / "comparison.md").read_text(encoding="utf-8")))
def test_a_quoted_table_of_the_benchmarks_is_there(words):
    assert re.match(r"\|.*\|\n\| -", facts.table(words))


def test_a_table_that_is_not_there_stops_the_build():
    with pytest.raises(LookupError, match="no table below 'Nothing'"):
        facts.table("Nothing")


def test_the_page_and_the_file_cite_the_same_paper():
    page = (DOCS / "cite.md").read_text(encoding="utf-8")
    [paper] = YAML(typ="safe").load((DOCS.parent / "CITATION.cff").read_text(encoding="utf-8"))["references"]
    article, _, _ = page.partition("@software")
    printed = dict(re.findall(r"^  (\w+) += \{(.*)\},?$", article, re.MULTILINE))
    assert printed["pages"] == f"{paper['start']}--{paper['end']}"
    assert printed["number"] == str(paper["issue"])
    assert all(printed[key] == str(paper[key]) for key in ("title", "journal", "volume", "year", "doi"))
