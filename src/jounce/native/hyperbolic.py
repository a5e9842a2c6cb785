"""The hyperbolic tangent of vectors, in LLVM IR: within three units in the last place.

``tanh |x| = -e / (2 + e)`` with ``e = exp(-2 |x|) - 1``. The exponent is ``k ln 2 + r``, ln 2 in two parts of which the
first is so short that its multiples are exact; a polynomial does exp(r) - 1, its Taylor coefficients, as |r| < 0.35.
Beyond 20 the tangent is 1 to the last bit: larger numbers, and NaN, are taken for 20, so that nothing overflows.
"""

from math import factorial

from jounce.native.functions import MAGIC, SIGN
from jounce.native.ir import Writer, bits

LAST = 20.0
LN2 = (0.6931471803691238, 1.9082149292705877e-10)  # of 33 and 53 bits
TAYLOR = [1 / factorial(k) for k in range(2, 15)]  # of (exp(r) - 1 - r) / r^2


def define_tanh(ir: Writer) -> None:
    """``@tanh(x)``."""
    with ir.function(f"internal {ir.V} @tanh({ir.V} %x)"):
        x = ir.let(f"bitcast {ir.V} %x to {ir.I}")
        sign = ir.let(f"and {ir.I} {x}, {ir.integers(SIGN)}")
        size = ir.let(f"and {ir.I} {x}, {ir.integers(~SIGN)}")
        beyond = ir.let(f"icmp sgt {ir.I} {size}, {ir.integers(bits(LAST))}")  # or not a number
        capped = ir.let(f"select {ir.B} {beyond}, {ir.I} {ir.integers(bits(LAST))}, {ir.I} {size}")
        twice = ir.op("mul", ir.let(f"bitcast {ir.I} {capped} to {ir.V}"), ir.vector(-2.0))
        scaled = ir.op("fma", twice, ir.vector(1.4426950408889634), ir.vector(MAGIC))  # 1 / ln 2
        k = ir.op("sub", scaled, ir.vector(MAGIC))
        r = twice
        for part in LN2:
            r = ir.op("fnma", k, ir.vector(part), r)
        rest = ir.op("fma", ir.op("mul", r, r), ir.horner(TAYLOR, r), r)
        exponent = ir.let(f"shl {ir.I} {ir.let(f'bitcast {ir.V} {scaled} to {ir.I}')}, {ir.integers(52)}")
        power = ir.let(f"bitcast {ir.I} {ir.let(f'add {ir.I} {exponent}, {ir.integers(bits(1.0))}')} to {ir.V}")
        e = ir.op("fma", power, rest, ir.op("sub", power, ir.vector(1.0)))  # 2^k (exp(r) - 1) + (2^k - 1)
        value = ir.let(f"fdiv {ir.V} {ir.op('neg', e)}, {ir.op('add', e, ir.vector(2.0))}")
        signed = ir.let(f"or {ir.I} {ir.let(f'bitcast {ir.V} {value} to {ir.I}')}, {sign}")
        ir.do(f"ret {ir.V} {ir.let(f'bitcast {ir.I} {signed} to {ir.V}')}")
