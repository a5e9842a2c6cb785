"""Programs as native code for the tests: for the host's vectors and for shorter ones, with fused products or not."""

from dataclasses import replace

from jounce.dynamics.computation import Port, Signature, number_scalars
from jounce.native import jit
from jounce.native.calls import write_modules
from jounce.native.jit import host, make_ufunc
from jounce.native.scratch_pool import make_pool
from jounce.native.straight import straight_block

WAYS = ["host", "4 lanes", "2 lanes", "4 lanes, 16 registers", "4 lanes, no fma", "2 lanes, no fma"]


def target(way):
    if way == "host":
        return host()
    lanes, fma = int(way[0]), "no fma" not in way and host().fma
    features = host().features + ("" if fma else ",-fma") + (",-avx512f" if "16 registers" in way else "")
    registers = 16 if "16 registers" in way else host().registers
    return replace(host(), lanes=lanes, fma=fma, features=features, registers=registers)


def signature(taken, given, first_orders):
    """The signature of arrays of these shapes, and the lowest order of results that depends on each input."""
    inputs = [
        Port(f"x{k}", shape, "coordinate", 0, order)
        for k, (shape, order) in enumerate(zip(taken, first_orders, strict=True))
    ]
    return Signature(
        number_scalars(inputs), number_scalars([Port(f"y{k}", shape, "result") for k, shape in enumerate(given)])
    )


def native(program, interface, way="host"):
    """A program as a function of arrays."""
    return assembled(
        write_modules(straight_block(program, interface, target(way)), interface, target(way)), interface, way
    )


def assembled(texts, interface, way="host"):
    """Modules as a function of arrays; what it needs lives as long as it does."""
    code = jit.load_object(jit.assemble(texts, target(way)), target(way))
    pool = make_pool(code)
    function, needed = make_ufunc(code.address("states"), interface, "native", pool.address if pool else None)
    return lambda *arrays, kept=(code, needed, pool), **options: function(*arrays, **options)
