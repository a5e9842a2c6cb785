"""C++: a header with plain arrays, and one with overloads for Eigen."""

from jounce._codegen.c import RESERVED
from jounce._codegen.language import Language

ADDED = """alignas alignof and and_eq asm bitand bitor bool catch char8_t char16_t char32_t class co_await co_return
co_yield compl concept consteval constexpr constinit const_cast decltype delete dynamic_cast explicit export false
friend mutable namespace new noexcept not not_eq nullptr operator or or_eq private protected public reinterpret_cast
requires static_assert static_cast template this thread_local throw true try typeid typename using virtual wchar_t xor
xor_eq"""

LIBRARY = """abort abs acos acosh alarm asin asinh atan atan2 atanh atexit atof atoi bsearch calloc cbrt ceil clock
close connect copysign cos cosh daemon div drand48 drem dup erf erfc exit exp exp2 expm1 fabs fdim finite floor fma
fmax fmin fmod fork free frexp gamma getenv hypot ilogb index j0 j1 jn labs ldexp lgamma link log log10 log1p log2 logb
lrint lround malloc modf nan nearbyint nextafter nice pause perror pipe pow printf puts qsort raise rand random read
realloc remainder remove remquo rename rewind rindex rint round scalb scalbn select signal signgam significand sin sinh
sleep sqrt srand srandom stderr stdin stdout sync system tan tanh tgamma time timezone tmpfile trunc write y0 y1 yn"""

LANGUAGE = Language(
    name="cpp",
    title="C++",
    reserved=f"{RESERVED} {ADDED} main std Eigen Parameters",
    taken=f"{LIBRARY} larger TOLERANCE",
    function=lambda kind, x, single: f"std::{kind}({x})",
    parameter=lambda port, i: f"params.{port.name}" + (f"[{i}]" if port.shape else ""),
)
