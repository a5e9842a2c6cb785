"""Facts that pages quote from where they are kept: the version of the package, and tables of the benchmarks.

``@version`` becomes the version, the line ``@results WORDS`` the first table below the heading or line of
`benchmarks/RESULTS.md` that begins with these words.
"""

import re
from pathlib import Path
from typing import Any

import jounce

RESULTS = Path(__file__).parents[2] / "benchmarks" / "RESULTS.md"
QUOTED = re.compile(r"^@results (.+)$", re.MULTILINE)


def on_page_markdown(markdown: str, **_: Any) -> str:
    """The page with the facts that it quotes."""
    return QUOTED.sub(lambda found: table(found[1]), markdown.replace("@version", jounce.__version__))


def table(words: str) -> str:
    """The first table below the heading or line of the results that begins with words."""
    pattern = rf"^(?:#+ )?{re.escape(words)}.*\n(?:(?!#|\|).*\n)*((?:\|.*\n)+)"
    below = re.search(pattern, RESULTS.read_text(encoding="utf-8"), re.MULTILINE)
    if below is None:
        raise LookupError(f"no table below {words!r} in {RESULTS.name}")
    return below[1]
