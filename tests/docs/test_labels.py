"""Labels of equations have the numbers that the paper prints, and the search finds them."""

import re
from pathlib import Path
from types import SimpleNamespace

import equation_numbers
import pytest
from equation_numbers import NUMBERS
from ruamel.yaml import YAML
from test_derivation import ENTRIES, PAGES

DOCS = Path(__file__).parents[2] / "docs"
[OPTIONS] = re.findall(
    r"^  - search:\n((?:      .*\n)+)", (DOCS.parent / "mkdocs.yml").read_text("utf-8"), re.MULTILINE
)
SEPARATOR = YAML(typ="safe").load(OPTIONS)["separator"]
SEARCHES = {  # the page of what is found, and a part of its heading
    "(5)": ("kinematics.md", "prismatic"),
    "(6)": ("kinematics.md", "Exponential"),
    "(25)": ("dynamics.md", "Qgrav"),
    "(49)": ("second.md", "Second rate of C"),
    "(52)": ("second.md", "Qgrav"),
    "(22)": ("dynamics.md", "(Csys)"),
    "wrench of the figure": ("errata.md", "Wrench"),
}
PAPER = r"""
\begin{equation} x = 1 % \label{comment}
\label{One} \end{equation}
\begin{equation*} x \label{Star} \end{equation*}
\begin{eqnarray}
x &=& \left(\begin{array}{cc} 1 & 2 \\ 3 & 4 \end{array}\right) \notag \\
&& + 2 \label{Two} \\
&=& 3 \\
&& + 4 \notag \label{Three} \\
&=& 5 \notag \label{Four} \\
&& + 6
\end{eqnarray}
\begin{equation} x = 7 \end{equation}
"""
# The rows of the paper's last four systems with labels on rows without a number, and how many equations stand before.
ROWS = {
    42: ["&=& \\notag", "&& \\label{M21}", "&=&", "&& \\notag \\label{M22}"],
    46: ["&=& \\notag", "&& \\notag", "&=&", "&& \\notag \\label{C1dot}"],
    47: ["&=&", "&& \\notag \\label{CSys2dot}", "&=&", "&& \\notag"],
    49: ["&=& \\notag", "&&", "&& \\notag \\label{C21}", "&=& \\notag", "&&", "&& \\notag \\label{C22}"],
    52: ["&=&", "&& \\notag \\label{Qextddot}"],
}  # fmt: skip


def test_equations_are_numbered_as_latex_numbers_them():
    assert equation_numbers.number(PAPER) == {"One": 1, "Two": 2, "Three": 3, "Four": 4, "5": 5}


def test_erratum_labels_on_rows_without_a_number_refer_to_the_next():
    for before, rows in ROWS.items():
        tex = before * r"\begin{equation} x \end{equation}" + r"\begin{eqnarray}" + r"\\".join(rows) + r"\end{eqnarray}"
        printed, own = equation_numbers.references(tex), equation_numbers.number(tex)
        for label in printed:
            assert own[label] == NUMBERS[label]
            assert printed[label] == NUMBERS[label] + (label != "M21")


def test_every_entry_has_its_number_in_the_order_of_the_paper():
    assert set(NUMBERS) == {label for label, _ in ENTRIES}
    assert list(NUMBERS.values()) == list(range(1, 59))


def test_numbers_known_from_the_text_of_the_paper():
    assert [NUMBERS[label] for label in ("EOM1", "Csys", "M21", "C22", "Cbar")] == [1, 22, 43, 51, 54]


@pytest.mark.parametrize("form", ["{}", "({})", "see ({}).", "`{}`"])
def test_the_search_takes_a_label_as_one_word(form):
    for label in NUMBERS:
        assert label in re.split(SEPARATOR, form.format(label).replace("`", " "))


def test_the_index_tags_the_entries_of_labels():
    pytest.importorskip("mkdocs")
    import labels

    sections = [{"location": f"derivation/{page}#{label}"} for page in PAGES for label in NUMBERS]
    labels.tag([*sections, other := {"location": "index.html#Csys"}])
    assert "tags" not in other
    assert {section["tags"][0] for section in sections if "tags" in section} == {
        "5",
        "6",
        *(label for label in NUMBERS if label[0] not in "aA" and not label.isdigit()),
    }


@pytest.mark.parametrize(("query", "place"), SEARCHES.items(), ids=SEARCHES)
def test_one_search_finds_what_a_reader_of_the_paper_looks_for(query, place):
    """Words of a heading outweigh those of texts a thousand times; one heading alone has all words of the query."""
    headings = [
        (page.name, heading)
        for page in [*(DOCS / "derivation").glob("*.md"), *DOCS.glob("*.md")]
        for heading in re.findall(r"^#+ (.*)$", labelled(page), re.MULTILINE)
    ]
    words = set(re.split(SEPARATOR, query.lower())) - {""}
    found = [pair for pair in headings if words <= set(re.split(SEPARATOR, pair[1].lower()))]
    assert len(found) == 1, found
    assert found[0][0] == place[0]
    assert place[1] in found[0][1]


def labelled(page):
    """A page with the headings that the site has: printed numbers are in them."""
    return re.sub(
        r"^(#+ \((\w+)\) .*)$",
        lambda found: f"{found[1]} ({NUMBERS[found[2]]})" if not found[2].isdigit() else found[1],
        page.read_text(encoding="utf-8"),
        flags=re.MULTILINE,
    )


def test_numbers_lead_to_equations_on_pages_about_the_paper_alone(monkeypatch):
    pytest.importorskip("mkdocs")
    import labels

    home = SimpleNamespace(url="derivation/dynamics.html")
    monkeypatch.setitem(labels.homes, "25", home)
    monkeypatch.setitem(labels.homes, "Csys", home)
    for url, count in (("derivation/second.html", 2), ("errata.html", 2), ("howto/forces.html", 1)):
        page = labels.on_page_content("<p>(25) and (Csys)</p>", SimpleNamespace(url=url))
        assert page.count('class="label"') == count


def test_the_search_asks_no_other_server():
    """The plugin `offline` loads a script from elsewhere if none of that name is given."""
    config = (Path(__file__).parents[2] / "mkdocs.yml").read_text(encoding="utf-8")
    [script] = re.findall(r"polyfills: \[([^]]+)\]", config)
    assert "iframe-worker" in script
    assert (Path(__file__).parents[2] / "docs" / script).is_file()
