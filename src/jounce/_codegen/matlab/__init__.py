"""MATLAB and GNU Octave: a function a file, of columns, within what MATLAB Coder and Simulink take."""

from jounce._codegen.function import OUTPUTS
from jounce._codegen.language import Language, from_one

RESERVED = """break case catch classdef continue do else elseif end end_try_catch end_unwind_protect endfor
endfunction endif endparfor endswitch endwhile for function global if otherwise parfor persistent return spmd switch
try until unwind_protect unwind_protect_cleanup while"""

LANGUAGE = Language(
    name="matlab",
    title="MATLAB",
    reserved=RESERVED,
    taken=f"test {' '.join(OUTPUTS)}",  # functions within the test, of which the file may not bear the name
    longest=63,
    literal=lambda digits, single: digits,  # what meets a single becomes one
    function=lambda kind, x, single: f"{kind}({x})",
    element=lambda array, i: f"{array.name}({from_one(array, i)})",
    parameter=lambda array, i: f"p.{array.name}" + (f"({from_one(array, i)})" if array.shape else ""),
    scratch=lambda i: f"scratch({i + 1})",
    first=1,
    let="{name} = {value};",
    put="{place} = {value};",
)
