"""Facts that pages quote are where the pages say."""

import re
from pathlib import Path

import facts
import pytest
from ruamel.yaml import YAML

import jounce

DOCS = Path(__file__).parents[2] / "docs"
CITATION = YAML(typ="safe").load((DOCS.parent / "CITATION.cff").read_text(encoding="utf-8"))


def test_the_home_page_names_the_version():
    page = (DOCS / "index.md").read_text(encoding="utf-8")
    assert f"Version {jounce.__version__}," in page


QUOTED = [
    pair for page in ("comparison", "literature", "howto/speed")
    for pair in facts.QUOTED.findall((DOCS / f"{page}.md").read_text(encoding="utf-8"))
]  # fmt: skip


@pytest.mark.parametrize(("words", "page"), QUOTED)
def test_a_quoted_table_of_the_benchmarks_is_there(words, page):
    assert re.match(r"\|.*\|\n\| -", facts.table(words, page or "RESULTS"))


def test_a_table_that_is_not_there_stops_the_build():
    with pytest.raises(LookupError, match="no table below 'Nothing'"):
        facts.table("Nothing")


def test_the_page_and_the_file_cite_the_same_paper():
    page = (DOCS / "cite.md").read_text(encoding="utf-8")
    [paper] = CITATION["references"]
    article, _, _ = page.partition("@software")
    printed = fields(article)
    assert printed["pages"] == f"{paper['start']}--{paper['end']}"
    assert printed["number"] == str(paper["issue"])
    assert all(printed[key] == str(paper[key]) for key in ("title", "journal", "volume", "year", "doi"))
    assert paper["title"] == "Closed-form time derivatives of the equations of motion of rigid body systems"


@pytest.mark.parametrize("name", ["README.md", "docs/derivation/index.md", "docs/literature.md"])
def test_pages_name_the_article_as_the_journal_does(name):
    text = " ".join((DOCS.parent / name).read_text(encoding="utf-8").split())
    assert CITATION["references"][0]["title"] in text


def test_the_page_and_the_file_cite_the_same_software():
    page = (DOCS / "cite.md").read_text(encoding="utf-8")
    printed = fields(page.partition("@software")[2])
    assert printed["author"] == f"{{{CITATION['authors'][0]['name']}}}"
    assert (printed["title"], printed["license"]) == (CITATION["title"], CITATION["license"])
    assert printed["version"] == CITATION["version"] == jounce.__version__
    assert printed["date"] == str(CITATION["date-released"])


def fields(entry):
    return dict(re.findall(r"^  (\w+) += \{(.*)\},?$", entry, re.MULTILINE))
