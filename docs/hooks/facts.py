"""Tables of the benchmarks, which pages quote from where they are kept.

The line ``@results WORDS`` becomes the first table below the heading or line of `benchmarks/RESULTS.md` that begins
with these words, ``@results WORDS in LITERATURE`` one of that page.
"""

import re
from pathlib import Path
from typing import Any

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
QUOTED = re.compile(r"^@results (.+?)(?: in ([A-Z]+))?$", re.MULTILINE)


def on_page_markdown(markdown: str, **_: Any) -> str:
    """The page with the facts that it quotes."""
    return QUOTED.sub(lambda found: table(found[1], found[2] or "RESULTS"), markdown)


def table(words: str, page: str = "RESULTS") -> str:
    """The first table below the heading or line of a page of results that begins with words."""
    pattern = rf"^(?:#+ )?{re.escape(words)}.*\n(?:(?!#|\|).*\n)*((?:\|.*\n)+)"
    below = re.search(pattern, (BENCHMARKS / f"{page}.md").read_text(encoding="utf-8"), re.MULTILINE)
    if below is None:
        raise LookupError(f"no table below {words!r} in {page}.md")
    return below[1]
