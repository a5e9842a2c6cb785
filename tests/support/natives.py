"""Programs as native code for the tests: for the host's vectors and for shorter ones, with fused products or not."""

from dataclasses import replace

from jounce.native import jit
from jounce.native.emit import define_block, emitted
from jounce.native.target import host
from jounce.native.ufunc import ufunc

WAYS = ["host", "4 lanes", "2 lanes", "4 lanes, no fma", "2 lanes, no fma"]


def target(way):
    if way == "host":
        return host()
    lanes, fma = int(way[0]), "no fma" not in way and host().fma
    return replace(host(), lanes=lanes, fma=fma, features=host().features + ("" if fma else ",-fma"))


def native(program, interface, way="host"):
    """A program as a function of arrays."""
    return assembled(emitted(lambda ir: define_block(ir, program, interface), interface, target(way)), interface, way)


def assembled(text, interface, way="host"):
    """A module as a function of arrays; what it needs lives as long as it does."""
    address, engine = jit.loaded(jit.assembled(text, target(way)), target(way))
    function, needed = ufunc(address, interface, "native", None)
    return lambda *arrays, kept=(engine, needed), **options: function(*arrays, **options)
