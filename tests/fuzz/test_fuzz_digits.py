"""Where small errors grow, near singular positions and where drives are steep, results are right or refused by name."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import strategies as st

import jounce
from jounce import UncertainError
from jounce.dynamics.computation import Computation
from jounce.dynamics.quantities import QUANTITIES
from jounce.model.drive_trains import UNDRIVEN, Drives
from support import near_singular, own_equations
from support.quantities import tupled
from support.robots import floating, random_mechanism

PROMISED = near_singular.PROMISED
EARLY = 1e-11  # what is refused must be off by more than this, if it is not returned: four digits above rounding
QUIET, SLOWEST = 0.1, 0.01  # rad/s^k, and a part of lower rates: errors of smaller rates are compared with these
SEEDS = st.integers(0, 2**32 - 1)
KINDS = ("revolute", "prismatic", "helical")


def drawn_robot(name, rng):
    """One of the closed robots, the crossed four-bar and the slider-crank of random lengths."""
    if name == "folded_fivebar":
        return near_singular.ROBOTS[name]()
    long = 10 ** rng.uniform(-1, 1)
    lengths = sorted([long, long * rng.uniform(0.2, 0.9)])
    if name == "crossed_fourbar":
        return near_singular.crossed_fourbar(lengths[1], lengths[0])
    return near_singular.slider_crank(*lengths)


def check_near_singular(case, order, seed):
    name, quantity = case
    rng, found = np.random.default_rng(seed), near_singular.Digits()
    mechanism = drawn_robot(name, rng)
    robot, row = mechanism.serving(quantity), QUANTITIES[quantity]
    for exponent in rng.uniform(-7, 0, 8):
        found.judge(robot, quantity, row.highest(order), mechanism.position(rng, 10**exponent), rng)
    assert max(found.returned, default=0) <= PROMISED, f"{quantity} of {name}"


def steep_robot(rng):
    """A tree of up to three bodies of 1 g to 10 kg with damping, friction and springs of six orders of magnitude.

    Friction turns over at these speeds, or is saturated.
    """
    nb = int(rng.integers(1, 4))
    parent = [int(rng.integers(-1, i)) if i else -1 for i in range(nb)]
    m = random_mechanism(rng, parent, [*rng.choice(KINDS, nb)], [*10 ** rng.uniform(-3, 1, nb)])

    def amounts(scale):
        return scale * 10 ** rng.uniform(-2, 4, nb) * (rng.random(nb) < 0.5)

    table = {name: np.full(nb, value) for name, value in UNDRIVEN.items()}
    table |= {"damping": amounts(1.0), "friction": amounts(0.1), "eps": 10 ** rng.uniform(-3, 1.5, nb)}
    table |= {"stiffness": amounts(10.0), "rest": rng.normal(size=nb)}
    m = replace(m, drives=Drives(**table), acting=("damping", "friction", "spring"))
    return jounce.Robot(floating(m, rng) if rng.random() < 0.3 else m)


def random_motion(robot, rng, order):
    """q, qd, ..., C, V, ...: fast, slow, or nearly at rest."""
    rates = rng.normal(size=(order + 3, robot.n)) * 10 ** rng.uniform(-2, 0.5)
    rates[rng.integers(1, 3) :] *= rng.choice([1.0, 0.1, 0.01])
    base = (np.eye(4), *rng.normal(size=(order + 2, 6))) if robot.mechanism.floats else None
    return rates, base


def check_steep_drives(order, seed):
    rng = np.random.default_rng(seed)
    robot = steep_robot(rng)
    rates, base = random_motion(robot, rng, order)
    Q = tupled(robot.inverse_dynamics(*rates, base=base))
    if rng.random() < 0.1:
        Q = [0 * x for x in Q]
    given, method = base and base[:2], [None, "recursion", "closed_form"][rng.integers(3)]
    uncertain = [False] * (order + 1)
    try:
        found = tupled(robot.forward_dynamics(*rates[:2], *Q, base=given, method=method))
    except UncertainError as error:
        found, uncertain = error.results, [bool(x.any()) for x in error.uncertain]
    with near_singular.unchecked():
        values = tupled(robot.forward_dynamics(*rates[:2], *Q, base=given, method="recursion"))
    asked = Computation("forward_dynamics", order, base=base is not None)
    exact, lower = own_equations.results(robot, asked, [*rates[:2], *Q, *(given or ())]), np.abs(rates[1]).max()
    for k, (x, value, right, lost) in enumerate(zip(found, values, exact, uncertain, strict=True)):
        size = max(np.abs(right).max(), QUIET, SLOWEST * lower)
        lower = max(lower, np.abs(right).max())
        error = np.abs((value if lost else x) - right).max() / size
        assert error > EARLY if lost else error <= PROMISED, f"rate {k} of {method}: {error:.1e}, refused: {lost}"


def test_quantities_near_singular_positions(budget):
    budget.attack(
        check_near_singular, 20, case=st.sampled_from(near_singular.CASES), order=st.integers(0, 2), seed=SEEDS
    )


def test_accelerations_of_steep_drives(budget):
    budget.attack(check_steep_drives, 20, order=st.integers(0, 4), seed=SEEDS)


def test_the_attack_sees_what_is_not_refused(monkeypatch):
    monkeypatch.setattr("jounce.engine.certain_digits.drive_growth", lambda m: 0.0)
    with pytest.raises(AssertionError, match="refused: False"):
        [check_steep_drives(4, seed) for seed in range(20)]
