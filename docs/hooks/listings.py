"""Source lines in pages: what stands in `src/jounce` when the site is built, hence never stale.

A line ``@code (Adot)`` in a page becomes all the code that bears this label, ``@code (Csys) in closed_form`` only that
of one module, ``@code lie.exp`` a whole function. Each listing links to its lines in a page of the whole module.
"""

import ast
import re
from dataclasses import dataclass
from functools import cache
from io import StringIO
from pathlib import Path
from textwrap import dedent
from tokenize import COMMENT, generate_tokens
from typing import Any

SOURCE = Path(__file__).parents[2] / "src" / "jounce"
ASKED = re.compile(r"^@code \(?([\w.]+)\)?(?: in ([\w.]+))?$", re.MULTILINE)
LABEL = re.compile(r"(?<!\w)\(([A-Za-z]\w*|\d+)\)")


@dataclass(frozen=True)
class Place:
    """Lines of a module, counted from 1, both included."""

    module: str
    first: int
    last: int

    @property
    def text(self) -> str:
        """The lines, without what only the formatter reads."""
        lines = path(self.module).read_text().splitlines()[self.first - 1 : self.last]
        return dedent("\n".join(lines)).replace("  # fmt: skip", "")


def modules() -> list[str]:
    """All modules, by their dotted names."""
    return sorted(str(file.relative_to(SOURCE).with_suffix("")).replace("/", ".") for file in SOURCE.rglob("*.py"))


def path(module: str) -> Path:
    """The file of a module."""
    return SOURCE / f"{module.replace('.', '/')}.py"


@cache
def labelled() -> dict[str, list[Place]]:
    """The code that bears each label: the largest construct that ends in the line of the comment."""
    found: dict[str, list[Place]] = {}
    for module in modules():
        source = path(module).read_text()
        tree = ast.parse(source)
        for token in generate_tokens(StringIO(source).readline):
            for label in LABEL.findall(token.string) if token.type == COMMENT else ():
                line = token.start[0]
                found.setdefault(label, []).append(Place(module, _first(tree, line), line))
    return found


def _first(tree: ast.AST, last: int) -> int:
    nodes = (node for node in ast.walk(tree) if isinstance(node, ast.stmt | ast.expr))
    return min((node.lineno for node in nodes if node.end_lineno == last), default=last)


def function(name: str) -> Place:
    """A whole function, by module and name."""
    module, _, wanted = name.rpartition(".")
    for node in ast.walk(ast.parse(path(module).read_text())):
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and node.name == wanted:
            return Place(module, node.lineno, node.end_lineno or node.lineno)
    raise LookupError(f"no function {name!r} in {path(module)}")


def places(asked: str, module: str | None = None) -> list[Place]:
    """Where what a page asks for stands: a label, or a function."""
    found = [function(asked)] if "." in asked else labelled().get(asked, [])
    chosen = [place for place in found if module in (None, place.module)]
    if not chosen:
        raise LookupError(f"no code bears the label ({asked}){f' in {module}' if module else ''}")
    return chosen


def on_files(files: Any, config: Any) -> Any:
    """Add a page for every module, where listings lead to."""
    from mkdocs.structure.files import File

    for module in modules():
        front = f"title: {module}\nhide: [toc, navigation]\nsearch: {{exclude: true}}"
        text = f'````python linenums="1"\n{path(module).read_text()}````'
        content = f"---\n{front}\n---\n\n# {path(module).relative_to(SOURCE)}\n\n{text}\n"
        files.append(File.generated(config, _page(module), content=content))
    return files


def _page(module: str) -> str:
    return f"source/{module}.md"


def on_page_markdown(markdown: str, page: Any, files: Any, **_: Any) -> str:
    """The page with the listings it asks for."""

    def listing(found: re.Match[str]) -> str:
        return "\n".join(_listing(place, page, files) for place in places(found[1], found[2]))

    return ASKED.sub(listing, markdown)


def _listing(place: Place, page: Any, files: Any) -> str:
    from mkdocs.utils import get_relative_url

    url = get_relative_url(files.get_file_from_path(_page(place.module)).url, page.url)
    where = f"line {place.first}" if place.first == place.last else f"lines {place.first} to {place.last}"
    name = path(place.module).relative_to(SOURCE)
    link = f'<a href="{url}#__codelineno-0-{place.first}">{name}, {where}</a>'
    return f'<p class="place">{link}</p>\n\n```python\n{place.text}\n```\n'
