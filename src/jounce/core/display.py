"""Displays in notebooks: objects are shown by functions that are registered for their types, outside of them."""

from functools import singledispatch
from importlib import import_module

REGISTRY = "jounce.figures.displays"  # which registers the functions; it is imported when an object is first shown


@singledispatch
def render_html(shown: object) -> str:
    """An object in HTML."""
    from html import escape  # imported here to keep start-up fast

    return escape(repr(shown))


class HtmlDisplay:
    """An object that notebooks show in HTML."""

    def _repr_html_(self) -> str:
        import_module(REGISTRY)
        return render_html(self)
