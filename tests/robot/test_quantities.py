"""The rule that every quantity of the table obeys: rates, batches, scalar types, `out=`, bodies and frames."""

import re

import jax
import numpy as np
import pytest

from jounce.dynamics.computation import Computation
from jounce.dynamics.quantities import QUANTITIES
from jounce.engine.backends import NATIVE
from support.comparisons import assert_close
from support.quantities import IDS, REQUESTS, affordable, branched, ids, rate_of, tupled
from support.refusals import refusal
from support.robots import Interpreted, differentiated_at_once, harmonic, relative_error
from support.states import random_rates

ROBOT = branched()
ORDERS = (0, 1, 2, 3)
TRACED = [  # of all bodies in their own frames, of a merged link in the others
    (quantity, keywords)
    for quantity, keywords in REQUESTS
    if (keywords.get("body"), keywords.get("frame") in ("world", "spatial")) in ((None, False), ("tool", True))
]


def expected_shapes(quantity, keywords, order):
    asked = Computation(quantity.name, order, body=keywords.get("body"))
    return [port.shape for port in asked.signature(ROBOT.mechanism).outputs]


@pytest.mark.parametrize(("quantity", "keywords"), REQUESTS, ids=IDS)
def test_each_further_rate_returns_one_more_time_derivative(quantity, keywords):
    compute, motion = getattr(Interpreted(ROBOT), quantity.name), harmonic(np.random.default_rng(1), ROBOT.n, 8)

    def path(t):
        """Rates of the coordinates along a motion, or two of them and those of the forces that it takes."""
        rates = motion(t)
        if not quantity.takes.forces:
            return rates
        return [*rates[:2], *Interpreted(ROBOT).inverse_dynamics(*rates)]

    plain = compute(*path(0.0)[: quantity.takes.rates], **keywords)
    assert [np.shape(x) for x in tupled(plain)] == expected_shapes(quantity, keywords, 0)
    for order in ORDERS[1 : quantity.highest(len(ORDERS))]:
        results = compute(*path(0.0)[: quantity.takes.rates + order], **keywords)
        assert isinstance(results, tuple)
        assert [x.shape for x in results] == expected_shapes(quantity, keywords, order)
        assert_close(results[0], plain, 1e-13)
        rate = rate_of(quantity, *map(np.asarray, results[-2:]))
        last = lambda t, count=quantity.takes.rates + order - 1: tupled(compute(*path(t)[:count], **keywords))[-1]  # noqa: E731
        assert_close(differentiated_at_once(last), rate, 1e-7)


def highest_order(quantity, keywords):
    return quantity.highest(1 if "body" in keywords or "parameters" in quantity.gives.shape else 2)


@pytest.mark.sweep(20)
@pytest.mark.parametrize(
    ("quantity", "keywords", "method"),
    [(quantity, keywords, method) for quantity, keywords in REQUESTS for method in (*quantity.laws, NATIVE)],
    ids=[f"{name}-{method}" for name, (row, _) in zip(IDS, REQUESTS, strict=True) for method in (*row.laws, NATIVE)],
)
def test_every_method_takes_every_batch(quantity, keywords, method):
    """Several axes, axes that broadcast, none, and no state at all; numbers are compared in tests/matrix."""
    compute, q = getattr(ROBOT, quantity.name), random_rates(ROBOT.n, quantity.takes.rates + quantity.highest(1), 3, 2)
    found = tupled(compute(*q, method=method, **keywords))
    for i in np.ndindex(3, 2):
        for x, one in zip(found, tupled(compute(*(x[i] for x in q), method=method, **keywords)), strict=True):
            assert_close(x[i], one)
    mixed, whole = (tupled(compute(x, *q[1:], method=method, **keywords)) for x in (q[0][0], q[0][:1].repeat(3, 0)))
    for x, y in zip(mixed, whole, strict=True):
        assert_close(x, y)
    none = tupled(compute(*(x[:0] for x in q), method=method, **keywords))
    assert [x.shape for x in none] == [(0, 2, *x.shape[2:]) for x in found]


@pytest.mark.sweep(12)
@pytest.mark.parametrize(("quantity", "keywords"), REQUESTS, ids=IDS)
def test_results_are_written_into_out(quantity, keywords):
    order = highest_order(quantity, keywords)
    compute, q = getattr(ROBOT, quantity.name), random_rates(ROBOT.n, quantity.takes.rates + order, 4)
    expected = compute(*q, **keywords)
    out = tuple(np.full(x.shape, np.nan) for x in expected)
    compute(*q, out=out, **keywords)
    for x, y in zip(out, expected, strict=True):
        assert_close(x, y, 0)
    refusal(lambda: compute(*q, out=out[0], **keywords), f"^out has 1 arrays; expected {len(expected)}")


@pytest.mark.sweep(12)
@pytest.mark.parametrize(("quantity", "keywords"), REQUESTS, ids=IDS)
def test_scalar_types_give_the_same_numbers(quantity, keywords):
    compute, q = getattr(ROBOT, quantity.name), random_rates(ROBOT.n, quantity.takes.rates + quantity.highest(1))
    expected = compute(*q, **keywords)
    longdouble = compute(*(x.astype(np.longdouble) for x in q), **keywords)
    assert {x.dtype for x in map(np.asarray, longdouble)} == {np.dtype(np.longdouble)}
    objects = compute(*(x.astype(object) + _Opaque(0) for x in q), **keywords)
    for found in (longdouble, objects):
        for x, y in zip(found, expected, strict=True):
            assert_close(np.vectorize(float, otypes=[float])(x), y)


@pytest.mark.sweep(12)
@pytest.mark.parametrize(("quantity", "keywords"), TRACED, ids=ids(TRACED))
def test_jax_calls_the_same_native_code_of_every_quantity(quantity, keywords):
    order = affordable(quantity, int(quantity.takes.rates < 3))
    compute, q = getattr(ROBOT, quantity.name), random_rates(ROBOT.n, quantity.takes.rates + order, 3)
    with jax.enable_x64(True):
        law = jax.jit(jax.vmap(lambda *q: compute(*q, **keywords)))
        for x, y in zip(tupled(law(*q)), tupled(compute(*q, **keywords)), strict=True):
            np.testing.assert_array_equal(x, y)
        assert law.lower(*q).as_text().count("custom_call @jounce_") == 1


class _Opaque:
    """A scalar of which only arithmetic is known: an object array of it is no array of numbers."""

    def __init__(self, x):
        self.x = float(x)

    def __float__(self):
        return self.x

    def __neg__(self):
        return _Opaque(-self.x)

    def __add__(self, other):
        return _Opaque(self.x + float(other))

    def __sub__(self, other):
        return _Opaque(self.x - float(other))

    def __rsub__(self, other):
        return _Opaque(float(other) - self.x)

    def __mul__(self, other):
        return _Opaque(self.x * float(other))

    def __rtruediv__(self, other):
        return _Opaque(other / self.x)

    def sin(self):
        return _Opaque(np.sin(self.x))

    def cos(self):
        return _Opaque(np.cos(self.x))

    def tanh(self):
        return _Opaque(np.tanh(self.x))

    def exp(self):
        return _Opaque(np.exp(self.x))

    __radd__, __rmul__ = __add__, __mul__


@pytest.mark.parametrize("quantity", [q for q in QUANTITIES.values() if q.of_bodies], ids=lambda q: q.name)
def test_of_one_body_is_the_row_of_all(quantity):
    compute, q = getattr(ROBOT, quantity.name), random_rates(ROBOT.n, quantity.takes.rates + 1, 2)
    for i, body in enumerate(ROBOT.body_names):
        for all_bodies, one in zip(compute(*q), compute(*q, body=body), strict=True):
            assert relative_error(one, all_bodies[:, i]) < 1e-13


@pytest.mark.parametrize(("keywords", "match"), [
    ({"body": "body9"}, re.compile(r"^unknown body 'body9'; did you mean 'body\d'\? available: body1, .*tool, stand$")),
    ({"body": 3}, "^unknown body 3; "),
    ({"frame": "wrld"}, "^unknown frame 'wrld'; did you mean 'world'? available: body, world, spatial$"),
    ({"method": "rnea"}, "^jacobian has no method 'rnea'; … available: recursion, closed_form, kernel$"),
])  # fmt: skip
def test_unknown_names_list_what_exists(keywords, match):
    refusal(lambda: ROBOT.jacobian(np.zeros(ROBOT.n), **keywords), match)
