"""Functions of vectors, in LLVM IR: sine, cosine and exp within two units in the last place, tanh within three.

Angles may be any finite numbers. They are reduced by the nearest multiple of pi/2, in three parts of which the first
two are so short that their multiples are exact up to `MAX_REDUCED_ANGLE` (Cody and Waite), and the third so small that
it does not round the rest once more. Two polynomials do what is left. Lanes beyond, rare, are given to the C library,
which also makes NaN of inf and NaN. They hold 0 meanwhile, so that nothing overflows and no NaN is compared: NumPy
would warn.

``tanh |x| = -e / (2 + e)`` with ``e = exp(-2 |x|) - 1``. The exponent is ``k ln 2 + r``, ln 2 in two parts of which the
first is so short that its multiples are exact; a polynomial does exp(r) - 1, its Taylor coefficients, as |r| < 0.35.
Beyond 20 the tangent is 1 to the last bit: larger numbers, and NaN, are taken for 20, so that nothing overflows; NaN is
put back in the end. ``exp x = 2^k exp(r)`` likewise, with 2^k in two factors, so that results grow to infinity and fall
to zero by way of the denormal numbers.

Problem: f(x) to a few units in the last place, for vectors of any x and without branches. Algorithm: reduction of the
argument to an interval about 0, a polynomial there, reconstruction [1]. Invariants: no lane depends on the others, and
NaN gives NaN. There is no failure: what the reduction does not reach, the C library computes.

[1] J.-M. Muller, Elementary Functions: Algorithms and Implementation, 3rd ed., Birkhauser 2016.
"""

from math import factorial, inf

from jounce.native.ir import Writer, bits

MAX_REDUCED_ANGLE = 2.0**17  # rad: multiples of the parts of pi/2 are exact up to here
HALF_PI_PARTS = (1.5707963267923333, 2.5633441515839558e-12, 1.0562999066987428e-23)  # pi/2 in 36, 36 and 53 bits
# Of S and C in sin r = r + r^3 S(r^2) and cos r = 1 - r^2/2 + r^4 C(r^2) for |r| <= pi/4: of degree 5 through the exact
# values at Chebyshev's points, computed to 50 digits; errors 0.18 and 0.01 units in the last place.
SINE_COEFFICIENTS = (
    -0.16666666666666666, 0.008333333333330948, -0.00019841269836756774,
    2.7557316101617874e-06, -2.505113165023518e-08, 1.5918115263265974e-10,
)  # fmt: skip
COSINE_COEFFICIENTS = (
    0.041666666666666664, -0.0013888888888887398, 2.480158729876456e-05,
    -2.7557317271145144e-07, 2.087614614655861e-09, -1.1382623647474604e-11,
)  # fmt: skip
INTEGER_SHIFT = 1.5 * 2.0**52  # a number plus this has the nearest integer in its last bits
SIGN_BIT = -(2**63)  # of a double, as an integer of 64 bits
MAX_TANH_ARGUMENT = 20.0  # beyond, tanh is 1 to the last bit
MIN_EXP_ARGUMENT, MAX_EXP_ARGUMENT = -746.0, 710.0  # beyond, exp is 0 or infinite
LN2_PARTS = (0.6931471803691238, 1.9082149292705877e-10)  # ln 2 in 33 and 53 bits
EXPM1_COEFFICIENTS = [1 / factorial(k) for k in range(2, 15)]  # of (exp(r) - 1 - r) / r^2 for |r| < 0.35


def define_sincos(ir: Writer) -> None:
    """``@sincos(x, y, at_x, at_y)``: the sines of x into the vector at `at_x`, the cosines into the next, and of y.

    Two angles take less than twice the time of one, whose operations wait for each other.
    """
    _define_library_call(ir)
    V, lanes, ir = ir.V, ir.lanes, ir.twice_as_wide()
    halves = [range(lanes), range(lanes, 2 * lanes)]
    with ir.function(f"internal void @sincos({V} %x, {V} %y, ptr %at_x, ptr %at_y)"):
        angles = ir.shuffle(("%x", "%y"), range(2 * lanes), lanes)
        x = ir.let(f"bitcast {ir.V} {angles} to {ir.I}")
        size = ir.let(f"and {ir.I} {x}, {ir.integers(~SIGN_BIT)}")
        beyond = ir.let(f"icmp sgt {ir.I} {size}, {ir.integers(bits(MAX_REDUCED_ANGLE))}")  # or not a number
        r = ir.let(f"select {ir.B} {beyond}, {ir.V} zeroinitializer, {ir.V} {angles}")
        # Reduction: r = x - k pi/2, |r| <= pi/4.
        scaled = ir.op("fma", r, ir.vector(0.6366197723675814), ir.vector(INTEGER_SHIFT))  # 2/pi
        k = ir.op("sub", scaled, ir.vector(INTEGER_SHIFT))
        for part in HALF_PI_PARTS:
            r = ir.op("fnma", k, ir.vector(part), r)
        # The polynomials of r.
        z = ir.op("mul", r, r)
        sine = ir.op("fma", ir.op("mul", r, z), ir.horner(SINE_COEFFICIENTS, z), r)
        factors = ir.op("mul", z, z), ir.horner(COSINE_COEFFICIENTS, z)
        cosine = ir.op("fma", *factors, ir.op("fnma", ir.vector(0.5), z, ir.vector(1.0)))
        # Reconstruction: k mod 4 exchanges both for odd k, and changes their signs.
        quarter = ir.let(f"bitcast {ir.V} {scaled} to {ir.I}")
        odd = ir.let(f"trunc {ir.I} {quarter} to {ir.B}")
        for j, (even, other, turned) in enumerate(((sine, cosine, 0), (cosine, sine, 1))):
            value = ir.let(f"select {ir.B} {odd}, {ir.V} {other}, {ir.V} {even}")
            quarters = ir.let(f"add {ir.I} {quarter}, {ir.integers(turned)}")  # a cosine is a sine a quarter on
            sign = ir.let(f"and {ir.I} {ir.let(f'shl {ir.I} {quarters}, {ir.integers(62)}')}, {ir.integers(SIGN_BIT)}")
            signed = ir.let(f"xor {ir.I} {ir.let(f'bitcast {ir.V} {value} to {ir.I}')}, {sign}")
            result = ir.let(f"bitcast {ir.I} {signed} to {ir.V}")
            for place, half in zip(("%at_x", "%at_y"), halves, strict=True):
                ir.store(ir.shuffle([result], half), ir.at(place, j * lanes), lanes)
        mask = ir.let(f"bitcast {ir.B} {beyond} to i{ir.lanes}")
        with ir.only_if(ir.let(f"icmp ne i{ir.lanes} {mask}, 0"), "careful", "done"):
            for name, half in zip("xy", halves, strict=True):
                own = ir.let(f"trunc i{ir.lanes} {ir.let(f'lshr i{ir.lanes} {mask}, {half[0]}')} to i{lanes}")
                ir.do(f"call void @careful({V} %{name}, i{lanes} {own}, ptr %at_{name})")


def _define_library_call(ir: Writer) -> None:
    """``@careful(x, mask, place)``: the lanes of the mask by the C library."""
    for name in ("sin", "cos"):
        ir.declared[f"declare double @{name}(double)"] = None
    head = f"internal void @careful({ir.V} %x, i{ir.lanes} %mask, ptr %place)"
    with ir.function(head), ir.loop(str(ir.lanes)) as lane:
        bit = ir.let(f"lshr i{ir.lanes} %mask, {ir.let(f'trunc i64 {lane} to i{ir.lanes}')}")
        odd = ir.let(f"and i{ir.lanes} {bit}, 1")
        with ir.only_if(ir.let(f"icmp ne i{ir.lanes} {odd}, 0"), "large", "small"):
            angle = ir.let(f"extractelement {ir.V} %x, i64 {lane}")
            for j, name in enumerate(("sin", "cos")):
                value = ir.let(f"call double @{name}(double {angle})")
                ir.do(f"store double {value}, ptr {ir.at(ir.at('%place', j * ir.lanes), lane)}")


def define_tanh(ir: Writer) -> None:
    """``@tanh(x)``."""
    with ir.function(f"internal {ir.V} @tanh({ir.V} %x)"):
        x = ir.let(f"bitcast {ir.V} %x to {ir.I}")
        sign = ir.let(f"and {ir.I} {x}, {ir.integers(SIGN_BIT)}")
        size = ir.let(f"and {ir.I} {x}, {ir.integers(~SIGN_BIT)}")
        beyond = ir.let(f"icmp sgt {ir.I} {size}, {ir.integers(bits(MAX_TANH_ARGUMENT))}")  # or not a number
        capped = ir.let(f"select {ir.B} {beyond}, {ir.I} {ir.integers(bits(MAX_TANH_ARGUMENT))}, {ir.I} {size}")
        twice = ir.op("mul", ir.let(f"bitcast {ir.I} {capped} to {ir.V}"), ir.vector(-2.0))
        k, rest = _split_exponent(ir, twice)
        power = _power_of_two(ir, k)
        e = ir.op("fma", power, rest, ir.op("sub", power, ir.vector(1.0)))  # 2^k (exp(r) - 1) + (2^k - 1)
        value = ir.let(f"fdiv {ir.V} {ir.op('neg', e)}, {ir.op('add', e, ir.vector(2.0))}")
        signed = ir.let(f"or {ir.I} {ir.let(f'bitcast {ir.V} {value} to {ir.I}')}, {sign}")
        number = ir.let(f"icmp sle {ir.I} {size}, {ir.integers(bits(inf))}")
        result = ir.let(f"select {ir.B} {number}, {ir.I} {signed}, {ir.I} {x}")
        ir.do(f"ret {ir.V} {ir.let(f'bitcast {ir.I} {result} to {ir.V}')}")


def define_exp(ir: Writer) -> None:
    """``@exp(x)``."""
    with ir.function(f"internal {ir.V} @exp({ir.V} %x)"):
        high = ir.let(f"fcmp ugt {ir.V} %x, {ir.vector(MAX_EXP_ARGUMENT)}")  # or not a number
        x = ir.let(f"select {ir.B} {high}, {ir.V} {ir.vector(MAX_EXP_ARGUMENT)}, {ir.V} %x")
        low = ir.let(f"fcmp olt {ir.V} {x}, {ir.vector(MIN_EXP_ARGUMENT)}")
        k, rest = _split_exponent(ir, ir.let(f"select {ir.B} {low}, {ir.V} {ir.vector(MIN_EXP_ARGUMENT)}, {ir.V} {x}"))
        k = ir.let(f"sub {ir.I} {k}, {ir.integers(bits(INTEGER_SHIFT))}")
        half = ir.let(f"ashr {ir.I} {k}, {ir.integers(1)}")
        value = ir.op("add", rest, ir.vector(1.0))
        for part in (half, ir.let(f"sub {ir.I} {k}, {half}")):
            value = ir.op("mul", value, _power_of_two(ir, part))
        number = ir.let(f"fcmp ord {ir.V} %x, %x")
        ir.do(f"ret {ir.V} {ir.let(f'select {ir.B} {number}, {ir.V} {value}, {ir.V} %x')}")


def _split_exponent(ir: Writer, x: str) -> tuple[str, str]:
    """The integers k, in the last bits of others, and exp(r) - 1, of exp x = 2^k exp(r)."""
    scaled = ir.op("fma", x, ir.vector(1.4426950408889634), ir.vector(INTEGER_SHIFT))  # 1 / ln 2
    k = ir.op("sub", scaled, ir.vector(INTEGER_SHIFT))
    r = x
    for part in LN2_PARTS:
        r = ir.op("fnma", k, ir.vector(part), r)
    rest = ir.op("fma", ir.op("mul", r, r), ir.horner(EXPM1_COEFFICIENTS, r), r)
    return ir.let(f"bitcast {ir.V} {scaled} to {ir.I}"), rest


def _power_of_two(ir: Writer, k: str) -> str:
    """2^k of integers k, exponents of normal numbers."""
    exponent = ir.let(f"shl {ir.I} {k}, {ir.integers(52)}")
    return ir.let(f"bitcast {ir.I} {ir.let(f'add {ir.I} {exponent}, {ir.integers(bits(1.0))}')} to {ir.V}")


DEFINITIONS = {"sincos": define_sincos, "tanh": define_tanh, "exp": define_exp}  # by the name that code calls
