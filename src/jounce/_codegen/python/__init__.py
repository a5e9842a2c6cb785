"""Python with NumPy: arrays of any batch shape, as jounce itself takes them."""

import sys

from jounce._codegen.language import Language

RESERVED = """False None True and as assert async await break class continue def del elif else except finally for from
global if import in is lambda nonlocal not or pass raise return try while with yield numpy sys"""

LANGUAGE = Language(
    name="python",
    title="Python",
    reserved=RESERVED,
    taken=" ".join(sys.stdlib_module_names),
    literal=lambda digits, single: digits,
    function=lambda kind, x, single: f"np.{kind}({x})",
    parameter=lambda port, i: f"params.{port.name}" + (f"[{i}]" if port.shape else ""),
    let="{name} = {value}",
    put="{place} = {value}",
)
