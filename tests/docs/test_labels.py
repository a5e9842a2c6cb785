"""Labels of equations have the numbers that the paper prints, and the search finds them."""

import re
from pathlib import Path

import equation_numbers
import pytest
from equation_numbers import NUMBERS
from ruamel.yaml import YAML
from test_derivation import ENTRIES, PAGES

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
"""


def test_equations_are_numbered_as_latex_numbers_them():
    assert equation_numbers.number(PAPER) == {"One": 1, "Two": 2, "Three": 3, "Four": 4}


def test_every_entry_has_its_number_in_the_order_of_the_paper():
    assert set(NUMBERS) == {label for label, _ in ENTRIES}
    assert list(NUMBERS.values()) == sorted(set(NUMBERS.values()))


def test_numbers_known_from_the_text_of_the_paper():
    assert [NUMBERS[label] for label in ("EOM1", "Csys", "M21", "C22", "Cbar")] == [1, 22, 43, 51, 54]


@pytest.mark.parametrize("form", ["{}", "({})", "see ({}).", "`{}`"])
def test_the_search_takes_a_label_as_one_word(form):
    text = (Path(__file__).parents[2] / "mkdocs.yml").read_text(encoding="utf-8")
    [options] = re.findall(r"^  - search:\n((?:      .*\n)+)", text, re.MULTILINE)
    separator = YAML(typ="safe").load(options)["separator"]
    for label in NUMBERS:
        assert label in re.split(separator, form.format(label).replace("`", " "))


def test_the_index_tags_the_entries_of_labels():
    pytest.importorskip("mkdocs")
    import labels

    sections = [{"location": f"derivation/{page}#{label}"} for page in PAGES for label in NUMBERS]
    labels.tag([*sections, other := {"location": "index.html#Csys"}])
    assert "tags" not in other
    assert {section["tags"][0] for section in sections if "tags" in section} == {
        label for label in NUMBERS if label[0] not in "aA"
    }


def test_the_search_asks_no_other_server():
    """The plugin `offline` loads a script from elsewhere if none of that name is given."""
    config = (Path(__file__).parents[2] / "mkdocs.yml").read_text(encoding="utf-8")
    [script] = re.findall(r"polyfills: \[([^]]+)\]", config)
    assert "iframe-worker" in script
    assert (Path(__file__).parents[2] / "docs" / script).is_file()
