"""Functions of native code against mpmath: every finite angle, in every lane, on vectors of any length."""

import warnings
from functools import cache

import mpmath
import numpy as np
import pytest

from jounce.native.vector_functions import HALF_PI_PARTS, MAX_REDUCED_ANGLE
from jounce.program.program import Tape
from support.natives import WAYS, native, signature

UNITS = 2  # in the last place
FEW = 10.0 ** np.arange(-300, 301, 20)
RNG = np.random.default_rng(0)
ANGLES = {
    "random": RNG.uniform(-10, 10, 1500),
    "up to where the C library takes over": RNG.uniform(-MAX_REDUCED_ANGLE, MAX_REDUCED_ANGLE, 1500),
    "where it takes over": np.nextafter(MAX_REDUCED_ANGLE, [-np.inf, MAX_REDUCED_ANGLE, np.inf]),
    "beyond": RNG.uniform(MAX_REDUCED_ANGLE, 2.0**20, 200),
    "next to multiples of pi/2": (np.arange(1, 500) * np.pi / 2)[:, None] + np.spacing(1.0) * np.arange(-2, 3),
    "next to large multiples of pi/2": RNG.integers(500, 2**20, 500) * np.pi / 2,
    # of all doubles up to 2^20 the nearest ones, for their size, to multiples of pi/2
    "nearest to multiples of pi/2": [45.553093477052, 2915.397982531328, 321307.9594422229, 642615.9188844458],
    "large": [1e3, 1e6, 1e15, 1e22, 1.7976931348623157e308, 5319372648326541416707072.0],
    "of any size": np.concatenate([FEW, 1 / FEW]),
    "denormal": [5e-324, 2.2250738585072014e-308, 1e-310],
    "zero": [0.0, -0.0],
}


@cache
def circle(way="host"):
    tape = Tape()
    (x,) = tape.variables(1)
    function = native(tape.program([x.sin(), x.cos()]), signature(((1,),), ((1,), (1,)), (0,)), way)
    return lambda x: [y[:, 0] for y in function(np.asarray(x)[:, None])]


def exactly(function, numbers):
    """Values of a function of mpmath: the nearest doubles, and what these leave, in units in the last place."""
    with mpmath.workprec(200):
        exact = [function(mpmath.mpf(float(x))) for x in numbers]
        nearest = np.array([float(x) for x in exact])
        units = np.spacing(np.abs(nearest))
        left = [(x - y) / unit for x, y, unit in zip(exact, nearest.tolist(), units.tolist(), strict=True)]
    return nearest, np.array([float(x) for x in left])


def units_off(found, exact):
    nearest, left = exact
    return np.abs((found - nearest) / np.spacing(np.abs(nearest)) - left)


@cache
def exact_circle(kind):
    """Angles of either sign, their sines and cosines: once for all ways."""
    angles = np.ravel(ANGLES[kind])
    angles = np.concatenate([angles, -angles])
    return angles, exactly(mpmath.sin, angles), exactly(mpmath.cos, angles)


@pytest.fixture(scope="module", params=WAYS)
def sincos(request):
    return circle(request.param)


@pytest.mark.parametrize("kind", ANGLES)
def test_sines_and_cosines_are_within_two_units_in_the_last_place(sincos, kind):
    angles, *exact = exact_circle(kind)
    for found, of in zip(sincos(angles), exact, strict=True):
        assert (units_off(found, of) <= UNITS).all(), angles[units_off(found, of) > UNITS]


def test_the_parts_of_a_quarter_turn_are_short_and_sum_up_to_it():
    with mpmath.workprec(300):
        assert abs(sum(map(mpmath.mpf, HALF_PI_PARTS)) - mpmath.pi / 2) < mpmath.mpf(2) ** -129
    for part in HALF_PI_PARTS[:2]:
        mantissa = int(np.frexp(part)[0] * 2**53)
        assert mantissa % 2 ** (53 - 36) == 0
    assert 36 + np.log2(MAX_REDUCED_ANGLE / (np.pi / 2)) <= 53  # so that a multiple is exact


def test_angles_keep_their_digits_whatever_stands_in_the_other_lanes(sincos):
    rng = np.random.default_rng(1)
    angles = np.concatenate([rng.uniform(-9, 9, 40), rng.uniform(1e6, 1e9, 6), [np.nan, 1e300, 5e-324, -0.0]])
    alone = np.array([np.ravel(sincos([x])) for x in angles])
    for _ in range(20):
        order = rng.permutation(angles.size)
        np.testing.assert_array_equal(np.stack(sincos(angles[order]), axis=1), alone[order])


@pytest.mark.parametrize("way", WAYS)
def test_several_angles_of_a_state_do_not_disturb_each_other(way):
    """An odd number, so that not all are taken in pairs; large ones and no numbers among them."""
    tape, alone = Tape(), circle(way)
    angles = tape.variables(3)
    program = tape.program([f for x in angles for f in (x.sin(), x.cos())])
    function = native(program, signature(((3,),), ((6,),), (1,)), way)  # 1: NaN does not spoil the other results
    values = np.random.default_rng(2).choice([0.5, -2.0, 1e6, 3e300, np.nan], (40, 3))
    with np.errstate(invalid="ignore"):
        expected = [y for x in values.T for y in alone(x)]
        np.testing.assert_array_equal(function(values), np.stack(expected, axis=1))


@pytest.mark.parametrize("way", WAYS)
def test_angles_may_depend_on_sines_of_other_angles(way):
    tape, alone = Tape(), circle(way)
    x, y, z = tape.variables(3)
    program = tape.program([x.sin().sin(), (x.sin() + y.cos()).cos(), z.cos().sin().cos()])
    function = native(program, signature(((3,),), ((3,),), (0,)), way)
    values = np.random.default_rng(3).uniform(-3, 3, (20, 3))
    sin_x, cos_y, cos_z = alone(values[:, 0])[0], alone(values[:, 1])[1], alone(values[:, 2])[1]
    expected = [alone(sin_x)[0], alone(sin_x + cos_y)[1], alone(alone(cos_z)[0])[1]]
    np.testing.assert_array_equal(function(values), np.stack(expected, axis=1))


def test_no_number_has_no_sine(sincos):
    with np.errstate(invalid="ignore"):
        for found in sincos([np.nan, 1.0, np.inf, -np.inf, 2.0]):
            assert (np.isnan(found) == [True, False, True, True, False]).all()


@pytest.mark.parametrize("angle", [0.5, MAX_REDUCED_ANGLE, 1e8, 1e200, 1e300, 5e-324, np.nan])
def test_numpy_has_nothing_to_warn_of(sincos, angle):
    with warnings.catch_warnings(), np.errstate(all="warn", under="ignore"):
        warnings.simplefilter("error")
        sincos([angle, 1.0])


@cache
def exact_tanh():
    rng = np.random.default_rng(7)
    sizes = 10.0 ** np.arange(-300, 301, 10)
    numbers = np.concatenate([rng.uniform(-22, 22, 2000), rng.uniform(-0.4, 0.4, 2000), sizes, -sizes, [0.0, -0.0]])
    return numbers, exactly(mpmath.tanh, numbers)


@cache
def exact_exp():
    rng = np.random.default_rng(8)
    sizes = 10.0 ** np.arange(-300, 1, 10)
    numbers = np.concatenate([rng.uniform(-745, 709.7, 2000), rng.uniform(-0.4, 0.4, 500), sizes, -sizes])
    return numbers, exactly(mpmath.exp, numbers)


@pytest.mark.parametrize("way", WAYS)
def test_native_tanh_is_within_three_units_in_the_last_place(way):
    tape = Tape()
    (x,) = tape.variables(1)
    function = native(tape.program([x.tanh()]), signature(((1,),), ((1,),), (0,)), way)
    numbers, exact = exact_tanh()
    off = units_off(function(numbers[:, None])[:, 0], exact)
    assert (off <= 3).all(), numbers[off > 3]


@pytest.mark.parametrize("way", WAYS)
def test_native_exp_is_within_two_units_in_the_last_place(way):
    tape = Tape()
    (x,) = tape.variables(1)
    function = native(tape.program([x.exp()]), signature(((1,),), ((1,),), (1,)), way)
    numbers, exact = exact_exp()
    with np.errstate(all="ignore"):
        found = function(numbers[:, None])[:, 0]
        ends = function(np.array([np.nan, np.inf, 709.79, -746, -np.inf])[:, None])[:, 0]
    np.testing.assert_array_equal(ends, [np.nan, np.inf, np.inf, 0, 0])
    off = units_off(found, exact)
    assert (off <= 2).all(), numbers[off > 2]


@pytest.mark.parametrize("way", WAYS)
def test_no_number_has_no_hyperbolic_tangent(way):
    """Where it comes of finite inputs too, which the check of inputs does not see."""
    tape = Tape()
    (x,) = tape.variables(1)
    function = native(tape.program([x.tanh()]), signature(((1,),), ((1,),), (1,)), way)  # of which no check is made
    np.testing.assert_array_equal(function([[np.nan], [np.inf], [-np.inf], [0.0]]), [[np.nan], [1.0], [-1.0], [0.0]])
