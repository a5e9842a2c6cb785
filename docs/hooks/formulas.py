"""Formulas become MathML when the site is built, with a mathematical font beside the pages: no script, no other server.

Pages write LaTeX between dollars. `pymdownx.arithmatex` marks it, `latex2mathml` translates it, and letters in other
alphabets become the characters that Unicode has for them, which is how MathML Core knows bold and sans-serif.
"""

import re
import unicodedata
from functools import cache
from html import unescape
from pathlib import Path
from typing import Any

MARKED = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)
ALPHABETS = {"bold": "BOLD", "sans-serif": "SANS-SERIF", "bold-italic": "BOLD ITALIC"}
VARIANT = re.compile(rf'<(m[ino]) mathvariant="({"|".join(ALPHABETS)})">([^<]+)</')
# accents as spacing characters, which sit where they belong over a letter in every browser
ACCENTS = {"&#x020DB;": "&#x22EF;", "&#x020DC;": "&#x00A8;&#x00A8;"}
FUNCTION = "<mi>(?:sin|cos|tan|cot|tanh|exp|log)</mi>"
THIN_SPACE = '<mspace width="0.17em"></mspace>'
SPACED = {  # what TeX spaces and the translator does not: a function from its argument, and from the factor before it
    re.compile(rf"(?<!<msup>)({FUNCTION})(?!(?:<mrow>)*<mo|<mspace|</)"): rf"\1{THIN_SPACE}",
    re.compile(rf"(</m(?:n|i|sub|sup|subsup)>)(?={FUNCTION}|<msup>{FUNCTION})"): rf"\1{THIN_SPACE}",
}
FONT = "STIXTwoMath-Regular.ttf"


def on_page_content(html: str, **_: Any) -> str:
    """The page with all its formulas in MathML."""
    return MARKED.sub(lambda found: mathml(unescape(found[2]).strip(), found[1] == "div"), html)


@cache
def mathml(latex: str, display: bool) -> str:
    """A formula in MathML; what the translator leaves untranslated is an error."""
    from latex2mathml.converter import convert

    markup = convert(latex, display="block" if display else "inline")
    if "\\" in markup:
        raise ValueError(f"no MathML for {latex!r}: {markup}")
    for combining, spacing in ACCENTS.items():
        markup = markup.replace(combining, spacing)
    for pattern, spaced in SPACED.items():
        markup = pattern.sub(spaced, markup)
    return VARIANT.sub(lambda found: f"<{found[1]}>{_lettered(unescape(found[3]), found[2])}</", markup)


def _lettered(text: str, variant: str) -> str:
    return "".join(_letter(c, ALPHABETS[variant]) if c.isalnum() else c for c in text)


def _letter(c: str, alphabet: str) -> str:
    name = re.sub("LATIN |GREEK | LETTER", "", unicodedata.name(c))
    return unicodedata.lookup(f"MATHEMATICAL {alphabet} {name}")


def on_files(files: Any, config: Any) -> Any:
    """Put the font into the site; it is that of the package `ziamath`, under the SIL Open Font License."""
    from importlib.metadata import distribution

    from mkdocs.structure.files import File

    font = Path(str(distribution("ziamath").locate_file(f"ziamath/fonts/{FONT}"))).read_bytes()  # without importing it
    files.append(File.generated(config, f"fonts/{FONT}", content=font))
    return files
