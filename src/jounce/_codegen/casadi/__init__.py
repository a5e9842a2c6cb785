"""CasADi: functions of a robot's quantities, and C that CasADi loads."""

from jounce._codegen.c import RESERVED
from jounce._codegen.casadi.external import external_functions
from jounce._codegen.casadi.matrices import element_place
from jounce._codegen.language import Language

LANGUAGE = Language(
    name="casadi",
    title="C for CasADi",
    reserved=RESERVED,
    taken="zeros main",
    element=element_place,
    single=False,
    largest=2500,  # operations of the values: their Hessian takes some 25 times as many, compilers half a minute
    helpers={"external_functions": external_functions},
)
