"""MATLAB and GNU Octave: one function per file, on columns, in the subset that MATLAB Coder and Simulink support."""

from jounce._codegen.language import Language, from_one
from jounce.dynamics.computation import Port

RESERVED = """break case catch classdef continue do else elseif end end_try_catch end_unwind_protect endfor
endfunction endif endparfor endswitch endwhile for function global if otherwise parfor persistent return spmd switch
try until unwind_protect unwind_protect_cleanup while"""


def _extent(port: Port) -> tuple[int, int]:
    """The rows and columns of an array: vectors are columns, single numbers 1 by 1."""
    rows, columns, *_ = (*port.shape, 1, 1)
    return rows, columns


LANGUAGE = Language(
    name="matlab",
    title="MATLAB",
    reserved=RESERVED,
    taken="check",  # how the functions within the test begin
    longest=63,
    literal=lambda digits, single: digits,  # what meets a single becomes one
    function=lambda kind, x, single: f"{kind}({x})",
    element=lambda port, i: f"{port.name}({from_one(port, i)})",
    parameter=lambda port, i: f"params.{port.name}" + (f"({from_one(port, i)})" if port.shape else ""),
    scratch=lambda i: f"scratch({i + 1})",
    first=1,
    let="{name} = {value};",
    put="{place} = {value};",
    helpers={"extent": _extent},
)
