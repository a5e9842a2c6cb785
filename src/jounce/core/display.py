"""Displays in notebooks: objects are shown by functions that are registered for their types, outside of them."""

from functools import singledispatch
from html import escape
from importlib import import_module

REGISTRY = "jounce.figures.displays"  # which registers the functions; it is imported when an object is first shown


@singledispatch
def render_html(shown: object) -> str:
    """An object in HTML."""
    return escape(repr(shown))


class HtmlDisplay:
    """An object that notebooks show in HTML."""

    def _repr_html_(self) -> str:
        import_module(REGISTRY)
        return render_html(self)
