"""C99."""

from jounce.printing.language import Language

RESERVED = """auto break case char const continue default do double else enum extern float for goto if inline int long
register restrict return short signed sizeof static struct switch typedef union unsigned void volatile while"""

LANGUAGE = Language(name="c", title="C99", reserved=RESERVED)
