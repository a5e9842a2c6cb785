"""Document types in XML: refused wherever they declare anything, before the file itself is read.

Entities and default attributes are content that stands elsewhere than where it counts. Readers differ in what they make
of it, so that one file would be two robots.
"""

from contextlib import suppress
from xml.parsers import expat

from jounce.errors import JounceError


class _RootReachedError(Exception):
    """The root element begins: no document type can follow."""


def refuse_declarations(content: bytes, file: object) -> None:
    """Raise `JounceError` where the document type of an XML file declares anything, there or in another file.

    What is not XML at all is left to the reader that comes next, and so is ``<!DOCTYPE robot>`` alone.
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
