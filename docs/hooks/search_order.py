"""The search: how-to pages come first, then all others, then derivations and the API.

A word such as "mass matrix" stands in every derivation; who types it wants to compute one.
"""

from typing import Any

BOOSTS = {  # of pages by the beginning of their paths; the first that fits counts
    "howto/elastic-joints": 30.0,  # other pages name elastic joints more often
    "howto/codegen": 100.0,  # the letter C is a matrix in all derivations
    "howto/": 8.0,
    "derivation/": 0.3,
    "api/": 0.3,
}


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """The page as it is, with its boost among what the search reads."""
    for folder, boost in BOOSTS.items():
        if page.file.src_uri.startswith(folder):
            page.meta.setdefault("search", {}).setdefault("boost", boost)
            break
    return markdown


def on_post_page(output: str, **_: Any) -> str:
    """The page with a name of its search for screen readers, which the theme leaves out."""
    return output.replace(
        'data-md-component="search" role="dialog"', 'data-md-component="search" role="dialog" aria-label="Search"'
    )
