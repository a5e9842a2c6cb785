"""Balances of momentum and energy hold without accelerations, and the filter is exact for what is cubic in time."""

from dataclasses import replace

import numpy as np
import pytest

import jounce
from identification.conftest import table_values
from jounce.identification import low_pass as filters
from jounce.identification.filtered_balances import (
    average_momentum,
    average_power,
    energy_balance,
    filter_rows,
    momentum_balance,
)
from jounce.identification.low_pass import design_low_pass
from jounce.identification.measurements import Measurements
from jounce.model.drives import AMOUNTS, DRIVE_TERMS
from support.quantities import branched
from support.refusals import expect_refusal, refusal
from support.robots import Interpreted, floating, relative_error


def moving_robot(seed=3, on_base=False):
    """A robot whose drives act, the parameters of it and of its drives, and a motion of it with wrenches."""
    rng = np.random.default_rng(seed)
    m = replace(branched((-1, 0, 1, 0)).mechanism, elasticity=None, acting=DRIVE_TERMS)
    m = floating(m, rng) if on_base else m
    motion = jounce.Motion.fourier(
        *rng.uniform(-0.5, 0.5, (3, m.n))[:1], *rng.uniform(-0.3, 0.3, (2, 2, m.n)), 3.0, 2.0
    )
    if on_base:
        motion = motion.with_base(None, np.eye(4))
    d = m.drives
    p = np.concatenate([jounce.Robot(m).inertial_parameters, *(getattr(d, AMOUNTS[term]) for term in DRIVE_TERMS)])
    return Interpreted(jounce.Robot(m)), p, motion


def uneven(rng, count, stop):
    t = np.linspace(0, stop, count)
    t[1:-1] += rng.uniform(-0.3, 0.3, count - 2) * t[1]
    return t


@pytest.mark.parametrize("degree", range(4))
def test_the_filter_is_exact_for_cubics_at_uneven_times(degree):
    t, f = uneven(np.random.default_rng(1), 60, 3.0), 0.7
    u, w = np.polynomial.Polynomial(np.arange(1.0, degree + 2)), 2 * np.pi * f
    steady = sum((-1 / w) ** k * u.deriv(k) for k in range(degree + 1))  # the polynomial with y' = w (u - y)
    found = design_low_pass(t, f).apply(u(t)[:, None])[:, 0]
    np.testing.assert_allclose(found, steady(t) - np.exp(-w * t) * steady(0), rtol=0, atol=1e-11 * abs(u(3.0)))


def test_where_intervals_differ_much_noise_is_not_amplified():
    t = np.sort(np.append(np.linspace(0, 1, 50), np.linspace(0, 1, 50)[5:45] + 1e-9))
    through = design_low_pass(t, 2.0)
    assert np.abs(through.weights).sum() < 2 * through.weights.sum()
    w = through.cutoff
    found = through.apply(2 * t[:, None] - 1)[:, 0]
    np.testing.assert_allclose(found, 2 * t - 1 - 2 / w + (1 + 2 / w) * np.exp(-w * t), atol=1e-12)


@pytest.mark.parametrize("on_base", [False, True])
def test_the_balance_of_momentum_is_the_equation_of_motion(on_base):
    robot, p, motion = moving_robot(on_base=on_base)
    t = np.linspace(0.1, 1.9, 7)
    rates, base = motion(t, 2), motion.base(t, 2)
    _, of_stored = robot.momentum_regressor(*rates, drives=DRIVE_TERMS, base=base)
    _, pd = robot.generalized_momentum(*rates, base=base)
    rest, stored = momentum_balance(robot, motion, t, DRIVE_TERMS)
    assert relative_error(of_stored + rest[..., :-1], robot.regressor(*rates, drives=DRIVE_TERMS, base=base)) < 1e-12
    assert relative_error((of_stored + rest[..., :-1]) @ p, robot.inverse_dynamics(*rates, base=base)) < 1e-12
    assert relative_error(stored[..., :-1] @ p, stored[..., -1]) < 1e-12
    wrench = motion.wrench(t, 0)
    assert relative_error(pd + rest[..., -1], robot.inverse_dynamics(*rates, wrench=wrench, base=base)) < 1e-12


def test_the_balance_of_energy_is_the_power_of_the_forces():
    robot, p, motion = moving_robot()
    t = np.linspace(0.1, 1.9, 7)
    rates = motion(t, 2)
    _, of_stored = robot.energy_regressor(*rates, drives=DRIVE_TERMS)
    power, loaded = (
        np.einsum("ti,ti->t", rates[1], robot.inverse_dynamics(*rates, wrench=W)) for W in (None, motion.wrench(t, 0))
    )
    rest, stored = (x[:, 0] for x in energy_balance(robot, motion, t, DRIVE_TERMS))
    assert relative_error((of_stored + rest[..., :-1]) @ p, power) < 1e-12
    assert relative_error(stored[..., :-1] @ p, stored[..., -1]) < 1e-12
    assert relative_error(of_stored @ p + rest[..., -1], loaded) < 1e-12


@pytest.mark.parametrize("law", [momentum_balance, energy_balance])
def test_filtered_rows_fit_filtered_forces_whatever_the_pieces(law, monkeypatch):
    robot, p, motion = moving_robot()
    t = uneven(np.random.default_rng(2), 250, 2.0)
    through = design_low_pass(t, 3.0)
    rates = motion(t, 2)
    rows = np.concatenate([y for _, y in filter_rows(law, robot, motion, DRIVE_TERMS, through)])
    for found, W in ((rows[..., :-1] @ p, None), (rows[..., -1], motion.wrench(t, 0))):
        Q = robot.inverse_dynamics(*rates, wrench=W)
        right = Q if law is momentum_balance else np.einsum("ti,ti->t", rates[1], Q)[:, None]
        assert relative_error(found, through.apply(right)) < 1e-4
    monkeypatch.setattr(filters, "MAX_REGRESSOR_SAMPLES", 37)
    parts = list(filter_rows(law, robot, motion, DRIVE_TERMS, through))
    assert [part.stop for part, _ in parts][-2:] == [223, 250]
    np.testing.assert_allclose(np.concatenate([y for _, y in parts]), rows, rtol=0, atol=1e-12 * np.abs(rows).max())


T = np.linspace(0, 8, 1601)


@pytest.fixture(scope="module")
def planar_arm():
    """Two links, with a motion of theirs and the torques that other masses and friction take."""
    model = jounce.load("planar2r")
    motion = jounce.Motion.fourier([0.3, 0.5], [[0.5, 0.2], [0.1, 0.4]], [[0.1, 0.3], [0.5, 0.2]], 2.0, 8.0)
    m = model.with_inertial_parameters(1.3 * model.inertial_parameters).mechanism
    drives = replace(m.drives, damping=np.array([0.3, 0.2]), friction=np.array([0.5, 0.4]))
    true = jounce.Robot(replace(m, drives=drives, acting=("damping", "friction")))
    return model, motion, true, true.forces_along(motion, T, order=0).forces[0]


def parameter_error(found, true):
    """The largest error of the parameters of the table relative to the largest parameter."""
    expected = [*true.base_parameters().values, *true.drives.damping, *true.drives.friction, 0, 0]
    return relative_error(table_values(found), np.array(expected))


@pytest.mark.parametrize("method", ["momentum", "power"])
def test_exact_forces_give_the_true_parameters_without_accelerations(planar_arm, method):
    model, motion, true, Q = planar_arm
    found = model.identify(motion, Q, t=T, method=method)
    assert (found.rank, found.unseen) == (12, ())
    assert parameter_error(found, true) < 1e-4
    rows = np.arange(len(T))[:, None]
    gaps = (abs(T[:, None] - 3.5) < 0.5) & [True, False] | (rows % 17 == 0) & [True, True]  # a long one, and short ones
    found = model.identify(motion, np.where(gaps, np.nan, Q), t=T, method=method)
    assert (found.rank, found.unseen) == (12, ())
    assert parameter_error(found, true) < 1e-3


@pytest.mark.filterwarnings("ignore:the motion. acceleration jumps", "ignore:the data do not", "ignore:residuals look")
def test_noise_that_accelerations_amplify_matters_less_to_momentum(planar_arm):
    model, motion, true, Q = planar_arm
    q = motion(T, 0)[0] + np.random.default_rng(1).normal(0, 1e-4, (len(T), 2))
    rough = jounce.Motion.through(T, q, 5)
    errors = {
        method: parameter_error(model.identify(rough, Q, t=T, method=method, band=3.0), true)
        for method in ("inverse_dynamics", "momentum")
    }
    assert errors["momentum"] < 0.2 * errors["inverse_dynamics"]


def test_deviations_of_smoothed_positions_enter(planar_arm):
    model, motion, _, Q = planar_arm
    q = motion(T, 0)[0] + np.random.default_rng(1).normal(0, 1e-4, (len(T), 2))
    smoothed = jounce.Motion.fit(T, q)
    samples = Measurements(T, Q, np.ones_like(Q))
    for cells_of in (average_momentum, average_power):
        cells = cells_of(model, smoothed, samples, (), 0.2, 2.5)
        assert cells.spread[0].min() > 10 * np.median(cells.spread, axis=0).max()  # smoothing is worst at the ends
        slow = cells_of(model, smoothed, samples, (), 0.2, 0.2).spread
        assert (slow[1] > 0.05 * slow[0]).all()  # the filter remembers where it started
        assert not cells_of(model, motion, samples, (), 0.2, 2.5).spread.any()


def test_what_power_cannot_do_is_refused_in_one_line(planar_arm):
    model, motion, _, Q = planar_arm
    with expect_refusal("unknown method 'energy'; available: inverse_dynamics, momentum, power"):
        model.identify(motion, Q, t=T, method="energy")
    missing = np.where([True, False], np.nan, Q)
    with expect_refusal("method='power' needs all forces, and joint1 is not measured; use method='momentum'"):
        model.identify(motion, missing, t=T, method="power")
    moving = motion.with_base(None, np.eye(4))
    refusal(lambda: model.identify(moving, Q, t=T, method="power"), "method='power' needs a base at rest")
    refusal(lambda: design_low_pass(T[:3], 1.0), "a filter needs 4 samples or more, got 3")
