"""Julia: a module of functions that write into vectors given, and of ones that make them."""

from jounce._codegen.language import Language, from_one

RESERVED = """abstract baremodule begin break catch const continue do else elseif end export false finally for
function global if import in isa let local macro module mutable outer primitive public quote return struct true try
type using where while Base Core Main"""
TAKEN = """C Cbar Cd Cbard Cbar2d C2d DimensionMismatch Float32 Float64 M Md M2d OWN Parameters Q Qd Q2d Qgrav Qgravd
Qgrav2d S T TOLERANCE W Wd W2d abs all cos eltype error exit found include k larger max maximum p passed permutedims
promote_type q q2d q3d q4d qd reshape scratch sin size sized so_far tanh throw worst zeros"""


def literal(digits: str, single: bool) -> str:
    """A number: 1.5, 1.0e-5, and in single precision 1.5f0, 1.0f-5."""
    if not single:
        return digits
    return digits.replace("e", "f") if "e" in digits else f"{digits}f0"


LANGUAGE = Language(
    name="julia",
    title="Julia",
    reserved=RESERVED,
    taken=TAKEN,
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
