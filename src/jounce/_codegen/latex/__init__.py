"""LaTeX: a document of the equations themselves, in symbols, for robots that are small."""

from jounce._codegen.language import Language
from jounce._codegen.latex.equations import document, formula, heading, tex

LANGUAGE = Language(
    name="latex",
    title="LaTeX",
    reserved="",
    first=1,
    single=False,
    largest=1_200,
    helpers={"document": document, "formula": formula, "heading": heading, "tex": tex},
)
