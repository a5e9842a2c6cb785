"""Labels of equations: ``### (Adot) ...`` heads the entry of an equation; every ``(Adot)`` elsewhere leads there.

Headings show the number that the paper prints beside the equation, and the line ``@labels`` in a page becomes the table
of all labels. An equation without a label has its number as label, ``### (25) ...``: pages on the paper alone lead
there. The search puts the entry of a label first.
"""

import json
import re
from pathlib import Path
from typing import Any

from equation_numbers import NUMBERS
from mkdocs.plugins import event_priority

HEADING = re.compile(r"^(#+ \((\w+)\) (.*))$", re.MULTILINE)
MENTION = re.compile(r"\((\w+)\)")
TAG = re.compile(r"(<[^>]+>)")
ON_THE_PAPER = ("derivation/", "errata.")  # beginnings of pages in which a number between parentheses is an equation
CLOSED = ("a", "code", "math", "pre", "svg", "h1", "h2", "h3", "h4")  # elements whose text stays as it is

homes: dict[str, Any] = {}  # the file that holds each label's heading
names: dict[str, str] = {}  # what its heading says


def on_files(files: Any, **_: Any) -> Any:
    """Find the home of every label."""
    homes.clear()
    names.clear()
    for file in files.documentation_pages():
        if file.src_uri.startswith("derivation/"):
            for _heading, label, name in HEADING.findall(file.content_string):
                homes[label], names[label] = file, name
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """The page with an anchor of the label's name, and the printed number, at the heading of each equation."""
    markdown = markdown.replace("@labels\n", _table())
    if page.file not in homes.values():
        return markdown
    return HEADING.sub(lambda found: f"{found[1]} {_printed(found[2])} {{ #{found[2]} }}", markdown)


def on_page_content(html: str, page: Any, **_: Any) -> str:
    """The page with a link to its equation wherever a label is mentioned."""
    from mkdocs.utils import get_relative_url

    def link(found: re.Match[str]) -> str:
        if found[1] not in homes or (found[1].isdigit() and not page.url.startswith(ON_THE_PAPER)):
            return found[0]
        url = f"{get_relative_url(homes[found[1]].url, page.url)}#{found[1]}"
        return f'<a class="label" href="{url}" title="equation ({NUMBERS[found[1]]}) of the paper">{found[0]}</a>'

    parts, depth = TAG.split(html), 0
    for i, part in enumerate(parts):
        if TAG.fullmatch(part):
            name = re.match(r"</?(\w*)", part)
            if name and name[1] in CLOSED and not part.endswith("/>"):
                depth += -1 if part.startswith("</") else 1
        elif depth == 0:
            parts[i] = MENTION.sub(link, part)
    return "".join(parts)


@event_priority(-50)  # after the index is written, before the plugin `offline` copies it
def on_post_build(config: Any, **_: Any) -> None:
    """Tag the entries of the labels in the search index with their labels."""
    index = Path(config.site_dir) / "search" / "search_index.json"
    data = json.loads(index.read_text(encoding="utf-8"))
    tag(data["docs"])
    index.write_text(json.dumps(data), encoding="utf-8")


def tag(sections: list[dict[str, Any]]) -> None:
    """Tag the sections that are entries of labels; a tag weighs more than all text.

    Labels with an A are found by their headings alone: tags are found by their first letters too, and every sentence
    with "a" in it would find them first. So are numbers of two digits; (5) without a tag comes after (50) to (58).
    """
    for section in sections:
        page, _, label = section["location"].rpartition("#")
        if page.startswith("derivation/") and is_tagged(label):
            section["tags"] = [label]


def is_tagged(label: str) -> bool:
    """Whether the entry of a label has a tag."""
    return label in NUMBERS and label[0] not in "aA" and not (label.isdigit() and len(label) > 1)


def _printed(label: str) -> str:
    if label.isdigit():
        return ""
    return f'<span class="printed" title="its number in the paper">({NUMBERS[label]})</span>'


def _table() -> str:
    rows = [("number", "label", "equation"), ("---",) * 3]
    rows += [
        (f"({printed})", "" if label.isdigit() else f"({label})", names[label]) for label, printed in NUMBERS.items()
    ]
    return "".join(f"| {' | '.join(row)} |\n" for row in rows)
