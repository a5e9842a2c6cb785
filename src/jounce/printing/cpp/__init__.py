"""C++: a header with plain arrays, and one with overloads for Eigen."""

from jounce.printing.c import RESERVED
from jounce.printing.language import Language

ADDED = """alignas alignof and and_eq asm bitand bitor bool catch char8_t char16_t char32_t class co_await co_return
co_yield compl concept consteval constexpr constinit const_cast decltype delete dynamic_cast explicit export false
friend mutable namespace new noexcept not not_eq nullptr operator or or_eq private protected public reinterpret_cast
requires static_assert static_cast template this thread_local throw true try typeid typename using virtual wchar_t xor
xor_eq"""

LANGUAGE = Language(
    name="cpp",
    title="C++",
    reserved=f"{RESERVED} {ADDED} main std Eigen Parameters",
    function=lambda kind, x, single: f"std::{kind}({x})",
    parameter=lambda array, i: f"p.{array.name}" + (f"[{i}]" if array.shape else ""),
)
