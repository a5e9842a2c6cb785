"""Julia: a module of functions that write into vectors given, and of ones that make them."""

from jounce.printing.language import Language, from_one

RESERVED = """abstract baremodule begin break catch const continue do else elseif end export false finally for
function global if import in isa let local macro module mutable outer primitive public quote return struct true try
type using where while Base Core Main"""


def literal(digits: str, single: bool) -> str:
    """A number: 1.5, 1.0e-5, and in single precision 1.5f0, 1.0f-5."""
    if not single:
        return digits
    return digits.replace("e", "f") if "e" in digits else f"{digits}f0"


LANGUAGE = Language(
    name="julia",
    title="Julia",
    reserved=RESERVED,
    real=("Float64", "Float32"),
    literal=literal,
    function=lambda kind, x, single: f"{kind}({x})",
    element=lambda array, i: f"{array.name}[{from_one(array, i)}]",
    parameter=lambda array, i: f"p.{array.name}" + (f"[{from_one(array, i)}]" if array.shape else ""),
    scratch=lambda i: f"scratch[{i + 1}]",
    first=1,
    let="{name} = {value}",
    put="{place} = {value}",
)
