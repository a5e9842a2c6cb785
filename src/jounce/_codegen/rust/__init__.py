"""Rust without its standard library."""

from math import prod

from jounce._codegen.language import Language
from jounce.dynamics.computation import Port

RESERVED = """Self abstract alloc as async await become box break const continue core crate do dyn else enum extern
f32 f64 false final fn for gen i32 if impl in let loop macro match mod move mut override priv proc_macro pub ref return
self static std struct super test trait true try type typeof unsafe unsized use usize virtual where while yield"""


def _entry(port: Port, i: int) -> str:
    """The i-th scalar of an array of arrays: W[1][0]."""
    places = (i // prod(port.shape[k + 1 :]) % size for k, size in enumerate(port.shape))
    return port.name + "".join(f"[{place}]" for place in places)


LANGUAGE = Language(
    name="rust",
    title="Rust",
    reserved=RESERVED,
    taken="Std",
    real=("f64", "f32"),
    literal=lambda digits, single: digits,
    function=lambda kind, x, single: f"F::{kind}({x})",
    element=_entry,
    parameter=lambda port, i: f"params.{_entry(port, i)}",
    let="let {name} = {value};",
    put="{place} = {value};",
)
