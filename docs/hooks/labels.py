"""Labels of equations: ``### (Adot) ...`` heads the entry of an equation; every ``(Adot)`` elsewhere leads there."""

import re
from typing import Any

HEADING = re.compile(r"^(#+ \((\w+)\).*)$", re.MULTILINE)
MENTION = re.compile(r"\((\w+)\)")
TAG = re.compile(r"(<[^>]+>)")
CLOSED = ("a", "code", "math", "pre", "svg", "h1", "h2", "h3", "h4")  # elements whose text stays as it is

homes: dict[str, Any] = {}  # the file that holds each label's heading


def on_files(files: Any, **_: Any) -> Any:
    """Find the home of every label."""
    homes.clear()
    for file in files.documentation_pages():
        if file.src_uri.startswith("derivation/"):
            homes.update((label, file) for _, label in HEADING.findall(file.content_string))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """The page with an anchor of the label's name at the heading of each equation."""
    return markdown if page.file not in homes.values() else HEADING.sub(r"\1 { #\2 }", markdown)


def on_page_content(html: str, page: Any, **_: Any) -> str:
    """The page with a link to its equation wherever a label is mentioned."""
    from mkdocs.utils import get_relative_url

    def link(found: re.Match[str]) -> str:
        if found[1] not in homes:
            return found[0]
        return f'<a class="label" href="{get_relative_url(homes[found[1]].url, page.url)}#{found[1]}">{found[0]}</a>'

    parts, depth = TAG.split(html), 0
    for i, part in enumerate(parts):
        if TAG.fullmatch(part):
            name = re.match(r"</?(\w*)", part)
            if name and name[1] in CLOSED and not part.endswith("/>"):
                depth += -1 if part.startswith("</") else 1
        elif depth == 0:
            parts[i] = MENTION.sub(link, part)
    return "".join(parts)
