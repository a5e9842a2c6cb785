"""Julia: a module of functions that write into vectors given, and of ones that make them."""

from jounce._codegen.language import Language, from_one
from jounce.dynamics.quantities import QUANTITIES
from jounce.spatial.series import rate_name

RESERVED = """abstract baremodule begin break catch const continue do else elseif end export false finally for
function global if import in isa let local macro module mutable outer primitive public quote return struct true try
type using where while Base Core Main"""
ARRAY_SYMBOLS = ("q", "W", "base_twist", *(quantity.gives.symbol for quantity in QUANTITIES.values()))
ARRAY_NAMES = " ".join(rate_name(symbol, k) for symbol in ARRAY_SYMBOLS for k in range(10))  # more rates than code has
TAKEN = f"""DimensionMismatch Entry Float32 Float64 OWN Parameters Scalar TOLERANCE abs all base_pose cos eltype error
exit found include k larger max maximum params passed permutedims promote_type reshape scratch sin size sized so_far
sqrt tanh throw worst zeros {ARRAY_NAMES}"""


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
    element=lambda port, i: f"{port.name}[{from_one(port, i)}]",
    parameter=lambda port, i: f"params.{port.name}" + (f"[{from_one(port, i)}]" if port.shape else ""),
    scratch=lambda i: f"scratch[{i + 1}]",
    first=1,
    let="{name} = {value}",
    put="{place} = {value}",
)
