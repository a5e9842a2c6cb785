"""Document types in XML: an error if they declare anything, before the file itself is read.

Entities and default attributes define content outside the elements that use it. XML readers treat them differently, so
that one file could be two robots.
"""

from contextlib import suppress
from xml.parsers import expat

from jounce.core.errors import JounceError


class _RootReachedError(Exception):
    """The root element begins: no document type can follow."""


def refuse_declarations(content: bytes, file: object) -> None:
    """Raise `JounceError` if the document type of an XML file has declarations, in this or another file.

    A file that is not XML is left to the actual reader; ``<!DOCTYPE robot>`` without declarations is accepted.
    """
    parser = expat.ParserCreate()

    def begins(name: str, system: str | None, public: str | None, internal: int) -> None:
        if system or public or internal:
            what = "the document type has declarations; entities and default attributes are never resolved"
            raise JounceError(f"{file}:{parser.CurrentLineNumber}: {what}; write their content instead")

    def reached(*_: object) -> None:
        raise _RootReachedError

    parser.StartDoctypeDeclHandler, parser.StartElementHandler = begins, reached
    with suppress(_RootReachedError, expat.ExpatError, LookupError, ValueError):
        parser.Parse(content, True)
