"""JavaScript: an ES module for browsers and Node.js, on typed arrays, which writes into arrays given or new ones."""

from jounce._codegen.language import Language

RESERVED = """abstract arguments async await boolean break byte case catch char class const continue debugger default
delete do double else enum eval export extends false final finally float for function get goto if implements import in
instanceof int interface let long native new null of package private protected public return set short static super
switch synchronized this throw throws transient true try typeof undefined var void volatile while with yield"""

LANGUAGE = Language(
    name="javascript",
    title="JavaScript",
    reserved=RESERVED,
    taken="Infinity Math NaN Object code console process",  # of the language, and of the example and the test
    literal=lambda digits, single: digits,
    function=lambda kind, x, single: f"Math.{kind}({x})",
    parameter=lambda port, i: f"params.{port.name}" + (f"[{i}]" if port.shape else ""),
    let="const {name} = {value};",
    single=False,  # all of its numbers are doubles
)
