"""Describe the target languages in a table: syntax of statements, words that names may not be, what templates call.

`language` is the door: a row of the table by its name. Each row has a folder of that name in this package, with the
templates of the files to write, and of their tests. A new language takes such a folder, a row, its name in
`jounce.core.typing.Language`, and a line in the tests.

C is C99. C++ is a header with plain arrays, and one with overloads for Eigen. CUDA has functions of one state for host
and device, and kernels of many, one a thread. C for CasADi is what CasADi loads. JavaScript is an ES module for
browsers and Node.js, on typed arrays, which writes into arrays given or new ones. Julia is a module of functions that
write into vectors given, and of ones that make them. LaTeX is a document of the equations themselves, in symbols, for
robots that are small. MATLAB and GNU Octave have one function per file, on columns, in the subset that MATLAB Coder and
Simulink support. Python takes NumPy's arrays of any batch shape, as jounce itself does. Rust needs no standard library.
"""

import sys
from math import prod

from jounce._codegen import latex_document
from jounce._codegen.casadi.external import element_place, external_functions
from jounce._codegen.language import Language, from_one
from jounce.core import errors
from jounce.dynamics.computation import Port
from jounce.dynamics.quantities import QUANTITIES
from jounce.spatial.series import rate_name

C_RESERVED = """auto break case char const continue default do double else enum extern float for goto if inline int
long register restrict return short signed sizeof static struct switch typedef union unsigned void volatile while
NULL EOF INFINITY NAN HUGE_VAL M_E M_PI"""
C_HEADERS = """assert complex ctype errno fenv float inttypes iso646 limits locale math setjmp signal stdarg stdbool
stddef stdint stdio stdlib string tgmath time wchar wctype"""
C = Language(name="c", title="C99", reserved=C_RESERVED, taken=f"{C_HEADERS} test")
CPP_RESERVED = """alignas alignof and and_eq asm bitand bitor bool catch char8_t char16_t char32_t class co_await
co_return co_yield compl concept consteval constexpr constinit const_cast decltype delete dynamic_cast explicit
export false friend mutable namespace new noexcept not not_eq nullptr operator or or_eq private protected public
reinterpret_cast requires static_assert static_cast template this thread_local throw true try typeid typename using
virtual wchar_t xor xor_eq"""
CPP_LIBRARY = """abort abs acos acosh alarm asin asinh atan atan2 atanh atexit atof atoi bsearch calloc cbrt ceil
clock close connect copysign cos cosh daemon div drand48 drem dup erf erfc exit exp exp2 expm1 fabs fdim finite floor
fma fmax fmin fmod fork free frexp gamma getenv hypot ilogb index j0 j1 jn labs ldexp lgamma link log log10 log1p
log2 logb lrint lround malloc modf nan nearbyint nextafter nice pause perror pipe pow printf puts qsort raise rand
random read realloc remainder remove remquo rename rewind rindex rint round scalb scalbn select signal signgam
significand sin sinh sleep sqrt srand srandom stderr stdin stdout sync system tan tanh tgamma time timezone tmpfile
trunc write y0 y1 yn"""
CPP = Language(
    name="cpp",
    title="C++",
    reserved=f"{C_RESERVED} {CPP_RESERVED} main std Eigen Parameters",
    taken=f"{CPP_LIBRARY} larger TOLERANCE",
    function=lambda kind, x, single: f"std::{kind}({x})",
    parameter=lambda port, i: f"params.{port.name}" + (f"[{i}]" if port.shape else ""),
)

CUDA = Language(name="cuda", title="CUDA", reserved=CPP.reserved, taken="test")
JAVASCRIPT_RESERVED = """abstract arguments async await boolean break byte case catch char class const continue
debugger default delete do double else enum eval export extends false final finally float for function get goto if
implements import in instanceof int interface let long native new null of package private protected public return set
short static super switch synchronized this throw throws transient true try typeof undefined var void volatile while
with yield"""
JAVASCRIPT = Language(
    name="javascript",
    title="JavaScript",
    reserved=JAVASCRIPT_RESERVED,
    taken="Infinity Math NaN Object code console process",  # of the language, and of the example and the test
    literal=lambda digits, single: digits,
    function=lambda kind, x, single: f"Math.{kind}({x})",
    parameter=lambda port, i: f"params.{port.name}" + (f"[{i}]" if port.shape else ""),
    let="const {name} = {value};",
    single=False,  # all of its numbers are doubles
)

JULIA_RESERVED = """abstract baremodule begin break catch const continue do else elseif end export false finally for
function global if import in isa let local macro module mutable outer primitive public quote return struct true try
type using where while Base Core Main"""
JULIA_SYMBOLS = ("q", "W", "base_twist", *(quantity.gives.symbol for quantity in QUANTITIES.values()))
JULIA_ARRAYS = " ".join(rate_name(symbol, k) for symbol in JULIA_SYMBOLS for k in range(10))  # more rates than code has
JULIA_TAKEN = f"""DimensionMismatch Entry Float32 Float64 OWN Parameters Scalar TOLERANCE abs all base_pose cos
eltype error exit found include k larger max maximum params passed permutedims promote_type reshape scratch sin size
sized so_far sqrt tanh throw worst zeros {JULIA_ARRAYS}"""


def _julia_literal(digits: str, single: bool) -> str:
    """Return a number: 1.5, 1.0e-5, and in single precision 1.5f0, 1.0f-5."""
    if not single:
        return digits
    return digits.replace("e", "f") if "e" in digits else f"{digits}f0"


JULIA = Language(
    name="julia",
    title="Julia",
    reserved=JULIA_RESERVED,
    taken=JULIA_TAKEN,
    real=("Float64", "Float32"),
    literal=_julia_literal,
    function=lambda kind, x, single: f"{kind}({x})",
    element=lambda port, i: f"{port.name}[{from_one(port, i)}]",
    parameter=lambda port, i: f"params.{port.name}" + (f"[{from_one(port, i)}]" if port.shape else ""),
    scratch=lambda i: f"scratch[{i + 1}]",
    first=1,
    let="{name} = {value}",
    put="{place} = {value}",
)

LATEX = Language(
    name="latex",
    title="LaTeX",
    reserved="",
    first=1,
    single=False,
    largest=1_200,
    helpers={
        "document": latex_document.document,
        "formula": latex_document.formula,
        "heading": latex_document.heading,
        "tex": latex_document.tex,
    },
)

MATLAB_RESERVED = """break case catch classdef continue do else elseif end end_try_catch end_unwind_protect endfor
endfunction endif endparfor endswitch endwhile for function global if otherwise parfor persistent return spmd switch
try until unwind_protect unwind_protect_cleanup while"""


def _matlab_extent(port: Port) -> tuple[int, int]:
    """Return the rows and columns of an array: vectors are columns, single numbers 1 by 1."""
    rows, columns, *_ = (*port.shape, 1, 1)
    return rows, columns


MATLAB = Language(
    name="matlab",
    title="MATLAB",
    reserved=MATLAB_RESERVED,
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
    helpers={"extent": _matlab_extent},
)

PYTHON_RESERVED = """False None True and as assert async await break class continue def del elif else except finally
for from global if import in is lambda nonlocal not or pass raise return try while with yield numpy sys"""
PYTHON = Language(
    name="python",
    title="Python",
    reserved=PYTHON_RESERVED,
    taken=" ".join(sys.stdlib_module_names),
    literal=lambda digits, single: digits,
    function=lambda kind, x, single: f"np.{kind}({x})",
    parameter=lambda port, i: f"params.{port.name}" + (f"[{i}]" if port.shape else ""),
    let="{name} = {value}",
    put="{place} = {value}",
)

RUST_RESERVED = """Self abstract alloc as async await become box break const continue core crate do dyn else enum
extern f32 f64 false final fn for gen i32 if impl in let loop macro match mod move mut override priv proc_macro pub
ref return self static std struct super test trait true try type typeof unsafe unsized use usize virtual where while
yield"""


def _rust_entry(port: Port, i: int) -> str:
    """Return the i-th scalar of an array of arrays: W[1][0]."""
    places = (i // prod(port.shape[k + 1 :]) % size for k, size in enumerate(port.shape))
    return port.name + "".join(f"[{place}]" for place in places)


RUST = Language(
    name="rust",
    title="Rust",
    reserved=RUST_RESERVED,
    taken="Std",
    real=("f64", "f32"),
    literal=lambda digits, single: digits,
    function=lambda kind, x, single: f"F::{kind}({x})",
    element=_rust_entry,
    parameter=lambda port, i: f"params.{_rust_entry(port, i)}",
    let="let {name} = {value};",
    put="{place} = {value};",
)

CASADI = Language(
    name="casadi",
    title="C for CasADi",
    reserved=C_RESERVED,
    taken="zeros main",
    element=element_place,
    single=False,
    largest=2500,  # operations of the values: their Hessian takes some 25 times as many, compilers half a minute
    helpers={"external_functions": external_functions},
)

LANGUAGES = {row.name: row for row in (C, CASADI, CPP, CUDA, JAVASCRIPT, JULIA, LATEX, MATLAB, PYTHON, RUST)}
LANGUAGE_NAMES = tuple(LANGUAGES)


def language(name: str) -> Language:
    """Return the language with a name; an error lists all of them."""
    return LANGUAGES[errors.check_choice("language", name, LANGUAGE_NAMES)]
