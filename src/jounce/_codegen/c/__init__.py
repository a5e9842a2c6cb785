"""C99."""

from jounce._codegen.language import Language

RESERVED = """auto break case char const continue default do double else enum extern float for goto if inline int long
register restrict return short signed sizeof static struct switch typedef union unsigned void volatile while NULL EOF
INFINITY NAN HUGE_VAL M_E M_PI"""
HEADERS = """assert complex ctype errno fenv float inttypes iso646 limits locale math setjmp signal stdarg stdbool
stddef stdint stdio stdlib string tgmath time wchar wctype"""

LANGUAGE = Language(name="c", title="C99", reserved=RESERVED, taken=f"{HEADERS} test")
