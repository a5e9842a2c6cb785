"""Forces, their rates, gravity and mass matrices of random trees and forests agree with an oracle by Taylor series."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import strategies as st

from fuzz import newton_euler
from fuzz.trees import laid_out, random_tree, random_units, robot_of_tree, tree_in_units
from jounce.dynamics.quantities import QUANTITIES

TOLERANCE = 1e-13  # of the size of what is added up, whatever the order
DENSE_TOLERANCE = 5e-13  # the same of dense methods, which add up terms that a recursion never forms; 1.04e-13 was seen
DENSE = ("closed_form", "paper")
BATCHES = [(), (1,), (5,), (2, 3), (0,), (33,)]
SMALL, ANY = 12, 60  # bodies
SEEDS = st.integers(0, 2**32 - 1)


def methods(robot, quantity, order, wrench=False):
    """Those that take a robot of this size in a moment."""
    nb = len(robot.body_names)
    chosen = {"recursion": True, "closed_form": nb <= 8, "paper": nb <= 6 and order <= 2}
    if nb <= 2 * SMALL or QUANTITIES[quantity].sweep is not None:  # what has no loop compiles for seconds
        robot.compile(quantity, order, wrench)
        chosen |= {"kernel": True}
    return [method for method, suited in chosen.items() if suited]


def drawn_rates(rng, batch, tail, count, units=1.0):
    """A quantity with rates as a caller gives it, in any layouts, and flat, as the oracle takes it.

    Rates may lack axes of the batch, or have one entry along them: they are broadcast.
    """
    given, flat = [], []
    for k in range(count):
        axes = batch if k == 0 or rng.random() < 0.7 else (1,) * int(rng.integers(len(batch) + 1))
        x = rng.uniform(-2, 2, (*axes, *tail)) * units
        given.append(laid_out(rng, x))
        flat.append(np.broadcast_to(x, (*batch, *tail)).reshape(int(np.prod(batch)), *tail))
    return given, flat


def written_into(rng, batch, n, count):
    """Arrays for `out`, or None."""
    if rng.random() < 0.5:
        return None
    arrays = [laid_out(rng, np.full((*batch, n), np.nan)) for _ in range(count)]
    arrays = [array if array.flags.writeable else array.copy() for array in arrays]
    return tuple(arrays) if count > 1 else arrays[0]


def tolerance_of(method):
    return DENSE_TOLERANCE if method in DENSE else TOLERANCE


def assert_within_sums(method, found, expected, size, batch):
    found = found if isinstance(found, tuple) else (found,)
    assert len(found) == len(expected)
    for k, Q in enumerate(found):
        assert Q.shape == (*batch, expected.shape[-1])
        error = abs(Q.reshape(expected[k].shape) - expected[k])
        right = (error <= tolerance_of(method) * size[k]).all()
        assert right, f"{method}, rate {k}: {(error / size[k]).max():.1e} of what is added up"


def check_forces(nb, order, seed):
    rng = np.random.default_rng(seed)
    tree, batch, u = random_tree(rng, nb), BATCHES[rng.integers(len(BATCHES))], random_units(rng)
    tree = tree_in_units(tree, u)
    robot, loaded = robot_of_tree(tree), bool(rng.random() < 0.5)
    q, flat = drawn_rates(rng, batch, (robot.n,), order + 3)
    W, flat_W = drawn_rates(rng, batch, (nb, 6), order + 1, u.wrench) if loaded else ([], [])
    expected, size = newton_euler.forces(tree, flat, flat_W)
    if rng.random() < 0.3:
        W = [{name: w[..., i, :] for i, name in enumerate(robot.body_names)} for w in W]
    given = None if not loaded else W[0] if order == 0 and rng.random() < 0.5 else tuple(W)
    for method in methods(robot, "inverse_dynamics", order, loaded):
        out, threads = written_into(rng, batch, robot.n, order + 1), int(rng.integers(1, 4))
        options = {"threads": threads} if method == "kernel" and batch else {}
        found = robot.inverse_dynamics(*q, wrench=given, method=method, out=out, **options)
        assert_within_sums(method, found if out is None else out, expected, size, batch)


def check_gravity(nb, order, seed):
    rng = np.random.default_rng(seed)
    tree = tree_in_units(random_tree(rng, nb), random_units(rng))
    robot, weightless = robot_of_tree(tree), replace(tree, gravity=np.zeros(3))
    q, flat = drawn_rates(rng, (3,), (robot.n,), order + 3)
    (whole, size), (moved, _) = newton_euler.forces(tree, flat), newton_euler.forces(weightless, flat)
    for method in methods(robot, "gravity_forces", order):
        assert_within_sums(method, robot.gravity_forces(*q[: order + 1], method=method), whole - moved, size, (3,))


def check_mass_matrix(nb, seed):
    """M = Q at unit accelerations less Q at none."""
    rng = np.random.default_rng(seed)
    tree = tree_in_units(random_tree(rng, nb), random_units(rng))
    robot = robot_of_tree(tree)
    q = rng.uniform(-2, 2, robot.n)
    state = [np.tile(q, (robot.n + 1, 1)), np.zeros((robot.n + 1, robot.n)), np.eye(robot.n + 1, robot.n)]
    [Q], [size] = newton_euler.forces(tree, state)
    for method in methods(robot, "mass_matrix", 0):
        error = abs(robot.mass_matrix(q, method=method) - (Q[:-1] - Q[-1]))
        assert (error <= tolerance_of(method) * (size[:-1] + size[-1])).all(), method


@pytest.mark.parametrize(("orders", "examples"), [((0, 2), 8), ((3, 6), 5)])
def test_forces_of_small_robots(budget, orders, examples):
    """Straight-line code and loops, closed form and the paper's expansions."""
    budget.attack(check_forces, examples, nb=st.integers(1, SMALL), order=st.integers(*orders), seed=SEEDS)


@pytest.mark.parametrize(("orders", "examples"), [((0, 1), 3), ((2, 3), 3), ((4, 6), 2)])
def test_forces_of_robots_up_to_sixty_bodies(budget, orders, examples):
    budget.attack(check_forces, examples, nb=st.integers(SMALL + 1, ANY), order=st.integers(*orders), seed=SEEDS)


def test_gravity_and_mass_matrix(budget):
    budget.attack(check_gravity, 4, nb=st.integers(1, ANY), order=st.integers(0, 4), seed=SEEDS)
    budget.attack(check_mass_matrix, 5, nb=st.integers(1, ANY), seed=SEEDS)


@pytest.mark.parametrize("what", ["mass", "pitch", "gravity", "offset"])
def test_the_oracle_sees_a_billionth(monkeypatch, what):
    true = robot_of_tree

    def falsified(tree):
        if what in ("gravity", "offset"):
            return true(replace(tree, **{what: getattr(tree, what) + 1e-9}))
        bodies = [replace(body, **{what: (getattr(body, what) or 0.0) + 1e-9}) for body in tree.bodies]
        return true(replace(tree, bodies=tuple(bodies)))

    monkeypatch.setattr("test_fuzz_oracle.robot_of_tree", falsified)
    with pytest.raises(AssertionError, match="of what is added up"):
        check_forces(nb=5, order=0, seed=3)
