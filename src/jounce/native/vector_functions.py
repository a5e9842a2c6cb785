"""Write functions of vectors in LLVM IR: sine, cosine, exp and tanh.

Errors of sine, cosine and exp are within two units in the last place, those of tanh within three.

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
    """Define ``@sincos(x, y, at_x, at_y)`` of two vectors of angles.

    The sines of x go into the vector at `at_x`, their cosines into the next one, and likewise those of y. Two angles
    take less than twice the time of one, whose operations wait for each other.
    """
    _define_library_call(ir)
    # Both vectors are joined to one of twice the width, on which each operation is written once.
    V, lanes, ir = ir.V, ir.lanes, ir.twice_as_wide()
    halves = [range(lanes), range(lanes, 2 * lanes)]
    with ir.function(f"internal void @sincos({V} %x, {V} %y, ptr %at_x, ptr %at_y)"):
        angles = ir.shuffle(("%x", "%y"), range(2 * lanes), lanes)
        x = ir.let(f"bitcast {ir.V} {angles} to {ir.I}")
        # Doubles without sign are in the order of their bits as integers, in which NaN comes after all numbers. Large
        # angles and NaN are replaced by 0 here.
        size = ir.let(f"and {ir.I} {x}, {ir.integers(~SIGN_BIT)}")
        is_large = ir.let(f"icmp sgt {ir.I} {size}, {ir.integers(bits(MAX_REDUCED_ANGLE))}")
        r = ir.let(f"select {ir.B} {is_large}, {ir.V} zeroinitializer, {ir.V} {angles}")
        # Reduction: r = x - k pi/2, |r| <= pi/4. Adding the shift rounds x 2/pi to the nearest integer k.
        scaled = ir.op("fma", r, ir.vector(0.6366197723675814), ir.vector(INTEGER_SHIFT))  # 2/pi
        k = ir.op("sub", scaled, ir.vector(INTEGER_SHIFT))
        for part in HALF_PI_PARTS:
            r = ir.op("fnma", k, ir.vector(part), r)
        # The polynomials of r.
        z = ir.op("mul", r, r)
        sine = ir.op("fma", ir.op("mul", r, z), ir.horner(SINE_COEFFICIENTS, z), r)
        factors = ir.op("mul", z, z), ir.horner(COSINE_COEFFICIENTS, z)
        cosine = ir.op("fma", *factors, ir.op("fnma", ir.vector(0.5), z, ir.vector(1.0)))
        # Reconstruction: for odd k, sine and cosine change places. Bit 1 of k is the sign of the sine; that of the
        # cosine is bit 1 of k + 1, as a cosine is a sine a quarter on. Shifted by 62, it is the sign bit of a double.
        quarter = ir.let(f"bitcast {ir.V} {scaled} to {ir.I}")
        odd = ir.let(f"trunc {ir.I} {quarter} to {ir.B}")
        for j, (for_even, for_odd, more_quarters) in enumerate(((sine, cosine, 0), (cosine, sine, 1))):
            value = ir.let(f"select {ir.B} {odd}, {ir.V} {for_odd}, {ir.V} {for_even}")
            quarters = ir.let(f"add {ir.I} {quarter}, {ir.integers(more_quarters)}")
            sign = ir.let(f"and {ir.I} {ir.let(f'shl {ir.I} {quarters}, {ir.integers(62)}')}, {ir.integers(SIGN_BIT)}")
            signed = ir.let(f"xor {ir.I} {ir.let(f'bitcast {ir.V} {value} to {ir.I}')}, {sign}")
            result = ir.let(f"bitcast {ir.I} {signed} to {ir.V}")
            for place, half in zip(("%at_x", "%at_y"), halves, strict=True):
                ir.store(ir.shuffle([result], half), ir.at(place, j * lanes), lanes)
        # Lanes of large angles, which are rare, are written once more by the C library.
        mask = ir.let(f"bitcast {ir.B} {is_large} to i{ir.lanes}")
        with ir.only_if(ir.let(f"icmp ne i{ir.lanes} {mask}, 0"), "careful", "done"):
            for name, half in zip("xy", halves, strict=True):
                half_mask = ir.let(f"trunc i{ir.lanes} {ir.let(f'lshr i{ir.lanes} {mask}, {half[0]}')} to i{lanes}")
                ir.do(f"call void @careful({V} %{name}, i{lanes} {half_mask}, ptr %at_{name})")


def _define_library_call(ir: Writer) -> None:
    """Define ``@careful(x, mask, place)``: sines and cosines of the lanes of a mask, by the C library."""
    for name in ("sin", "cos"):
        ir.declared[f"declare double @{name}(double)"] = None
    head = f"internal void @careful({ir.V} %x, i{ir.lanes} %mask, ptr %place)"
    with ir.function(head), ir.loop(str(ir.lanes)) as lane:
        # The lane's bit of the mask is shifted to the lowest place.
        bit = ir.let(f"lshr i{ir.lanes} %mask, {ir.let(f'trunc i64 {lane} to i{ir.lanes}')}")
        is_set = ir.let(f"and i{ir.lanes} {bit}, 1")
        with ir.only_if(ir.let(f"icmp ne i{ir.lanes} {is_set}, 0"), "large", "small"):
            angle = ir.let(f"extractelement {ir.V} %x, i64 {lane}")
            for j, name in enumerate(("sin", "cos")):
                value = ir.let(f"call double @{name}(double {angle})")
                ir.do(f"store double {value}, ptr {ir.at(ir.at('%place', j * ir.lanes), lane)}")


def define_tanh(ir: Writer) -> None:
    """Define ``@tanh(x)``."""
    with ir.function(f"internal {ir.V} @tanh({ir.V} %x)"):
        # tanh is odd: it is computed of abs(x), which is capped; the sign is put back in the end. NaN counts as large.
        x = ir.let(f"bitcast {ir.V} %x to {ir.I}")
        sign = ir.let(f"and {ir.I} {x}, {ir.integers(SIGN_BIT)}")
        size = ir.let(f"and {ir.I} {x}, {ir.integers(~SIGN_BIT)}")
        is_large = ir.let(f"icmp sgt {ir.I} {size}, {ir.integers(bits(MAX_TANH_ARGUMENT))}")
        capped = ir.let(f"select {ir.B} {is_large}, {ir.I} {ir.integers(bits(MAX_TANH_ARGUMENT))}, {ir.I} {size}")
        twice = ir.op("mul", ir.let(f"bitcast {ir.I} {capped} to {ir.V}"), ir.vector(-2.0))
        k, rest = _split_exponent(ir, twice)
        power = _power_of_two(ir, k)
        # e = 2^k (exp(r) - 1) + (2^k - 1): no difference of nearly equal numbers where x is small.
        e = ir.op("fma", power, rest, ir.op("sub", power, ir.vector(1.0)))
        value = ir.let(f"fdiv {ir.V} {ir.op('neg', e)}, {ir.op('add', e, ir.vector(2.0))}")
        signed = ir.let(f"or {ir.I} {ir.let(f'bitcast {ir.V} {value} to {ir.I}')}, {sign}")
        # NaN is returned as it came.
        number = ir.let(f"icmp sle {ir.I} {size}, {ir.integers(bits(inf))}")
        result = ir.let(f"select {ir.B} {number}, {ir.I} {signed}, {ir.I} {x}")
        ir.do(f"ret {ir.V} {ir.let(f'bitcast {ir.I} {result} to {ir.V}')}")


def define_exp(ir: Writer) -> None:
    """Define ``@exp(x)``."""
    with ir.function(f"internal {ir.V} @exp({ir.V} %x)"):
        # x is clipped to where exp is neither 0 nor infinite. The comparison is unordered: NaN counts as large.
        high = ir.let(f"fcmp ugt {ir.V} %x, {ir.vector(MAX_EXP_ARGUMENT)}")
        x = ir.let(f"select {ir.B} {high}, {ir.V} {ir.vector(MAX_EXP_ARGUMENT)}, {ir.V} %x")
        low = ir.let(f"fcmp olt {ir.V} {x}, {ir.vector(MIN_EXP_ARGUMENT)}")
        k, rest = _split_exponent(ir, ir.let(f"select {ir.B} {low}, {ir.V} {ir.vector(MIN_EXP_ARGUMENT)}, {ir.V} {x}"))
        # 2^k itself may be infinite, or no normal number. Its two factors, 2^(k // 2) and the rest, are normal.
        k = ir.let(f"sub {ir.I} {k}, {ir.integers(bits(INTEGER_SHIFT))}")
        half = ir.let(f"ashr {ir.I} {k}, {ir.integers(1)}")
        value = ir.op("add", rest, ir.vector(1.0))
        for part in (half, ir.let(f"sub {ir.I} {k}, {half}")):
            value = ir.op("mul", value, _power_of_two(ir, part))
        number = ir.let(f"fcmp ord {ir.V} %x, %x")
        ir.do(f"ret {ir.V} {ir.let(f'select {ir.B} {number}, {ir.V} {value}, {ir.V} %x')}")


def _split_exponent(ir: Writer, x: str) -> tuple[str, str]:
    """Return k and exp(r) - 1 of exp x = 2^k exp(r).

    k are integers, in the last bits of others.
    """
    # k = x / ln 2, rounded to the nearest integer by adding the shift.
    scaled = ir.op("fma", x, ir.vector(1.4426950408889634), ir.vector(INTEGER_SHIFT))
    k = ir.op("sub", scaled, ir.vector(INTEGER_SHIFT))
    # r = x - k ln 2, in two parts: the product with the first one is exact.
    r = x
    for part in LN2_PARTS:
        r = ir.op("fnma", k, ir.vector(part), r)
    # exp(r) - 1 = r + r^2 (1/2! + r/3! + ...).
    rest = ir.op("fma", ir.op("mul", r, r), ir.horner(EXPM1_COEFFICIENTS, r), r)
    return ir.let(f"bitcast {ir.V} {scaled} to {ir.I}"), rest


def _power_of_two(ir: Writer, k: str) -> str:
    """Return 2^k of integers k, exponents of normal numbers.

    k is added to the exponent of 1.
    """
    exponent = ir.let(f"shl {ir.I} {k}, {ir.integers(52)}")
    return ir.let(f"bitcast {ir.I} {ir.let(f'add {ir.I} {exponent}, {ir.integers(bits(1.0))}')} to {ir.V}")


DEFINITIONS = {"sincos": define_sincos, "tanh": define_tanh, "exp": define_exp}  # by the name that code calls
