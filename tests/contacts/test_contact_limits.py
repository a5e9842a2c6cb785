"""Friction, soles, and ground that only pushes: the solution is optimal, and its rates are those of its active rows."""

from itertools import pairwise

import jax
import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.optimize import linprog

import jounce
from contacts.conftest import FEET, PAWS, SOLE, squat
from jounce.engine import contact_limits
from jounce.spatial.lie import Ad, inverse
from support.refusals import expect_refusal, refusal
from support.robots import differentiated_at_once, relative_error


def limited_soles(robot, **options):
    return robot.contacts([jounce.Contact(foot, "plane", **SOLE, **options) for foot in FEET])


def pushed(robot, sideways, jerk=0.0):
    """A robot at rest in q whose base accelerates sideways."""
    still, none = np.zeros(robot.n), np.zeros(6)
    Vd, V2d = np.zeros((2, 6))
    Vd[4], V2d[4] = sideways, jerk
    return [still] * 5, (np.eye(4), none, Vd, V2d, none)


def friction_problem(stand, rates, base):
    """C and G of C f <= 0, G f = Q_0."""
    contacts, robot = stand.mechanism.contacts, stand.contacts([])
    J = [robot.jacobian(rates[0], body=x.frame, base=base[:1], method="recursion")[:, :6] for x in contacts]
    G = np.concatenate([Ad(inverse(x.place)) @ of for x, of in zip(contacts, J, strict=True)]).T
    return block_diag(*(x.limits for x in contacts)), G


@pytest.mark.parametrize(("friction", "sideways"), [(0.43, 2.0), (0.85, 2.0), (0.3, 2.0), (None, 1.9)])
def test_the_solution_is_feasible_and_optimal(humanoid, friction, sideways):
    stand = limited_soles(humanoid, friction=friction)
    rates, base = pushed(humanoid, sideways)
    f, (C, G) = stand.contact_wrenches(*rates[:3], base=base[:3]).ravel(), friction_problem(stand, rates, base)
    free = humanoid.inverse_dynamics(*rates[:3], base=base[:3], method="recursion")[:6]
    assert relative_error(G @ f, free) < 1e-11
    slack = C @ f
    assert slack.max() < 1e-10 * np.abs(f).max()
    active = slack > -1e-9 * np.abs(f).max()
    assert active.any()
    W = np.concatenate([x.weights for x in stand.mechanism.contacts])
    # W f = G^T y - C_a^T u with u >= 0: the rest of the gradient is a nonnegative combination of active rows
    found = linprog(
        np.zeros(12 + active.sum()),
        A_eq=np.hstack([G.T, -G.T, -C[active].T]),
        b_eq=W * f / np.abs(f).max(),
        bounds=(0, None),
    )
    assert found.status == 0


def test_a_sole_transmits_what_forces_at_its_corners_do():
    x, y, mu = 0.09, 0.03, 0.6
    rows = jounce.Contact("foot", "plane", friction=mu * np.sqrt(2), sole=(x, y)).limits
    edges = [
        np.concatenate([np.cross((a * x, b * y, 0), f), f])
        for a in (1, -1)
        for b in (1, -1)
        for f in ((c * mu, d * mu, 1.0) for c in (1, -1) for d in (1, -1))
    ]
    assert (np.array(edges) @ rows.T).max() < 1e-12
    for direction in np.random.default_rng(0).normal(size=(40, 6)):  # both cones reach as far, at fz = 1
        direction *= [1 / y, 1 / x, 1 / x, 1, 1, 0]
        far = linprog(
            -direction, A_ub=rows, b_ub=np.zeros(len(rows)), A_eq=[[0, 0, 0, 0, 0, 1]], b_eq=[1], bounds=(None, None)
        )
        assert -far.fun == pytest.approx(max(edge @ direction for edge in edges), rel=1e-9)


def test_limits_that_are_kept_change_nothing(humanoid):
    rates, base = pushed(humanoid, 0.1)
    weights = limited_soles(humanoid).mechanism.contacts[0].weights
    free = [jounce.Contact(foot, "plane", place=SOLE["place"], weights=weights) for foot in FEET]
    least = humanoid.contacts(free).contact_wrenches(*rates[:3], base=base[:3])
    wide = limited_soles(humanoid, friction=5.0)
    np.testing.assert_array_equal(wide.contact_wrenches(*rates[:3], base=base[:3]), least)
    ratio = np.abs(least[:, 3:5]).max() / least[np.abs(least[:, 3:5]).max(axis=1).argmax(), 5]
    for mu in (ratio * (1 - 1e-7), ratio * (1 + 1e-7)):
        found = limited_soles(humanoid, friction=np.sqrt(2) * mu).contact_wrenches(*rates[:3], base=base[:3])
        assert relative_error(found, least) < 1e-4


@pytest.mark.parametrize("name", ["inverse_dynamics", "contact_wrenches"])
def test_rates_over_a_switch_are_those_of_the_active_rows(humanoid, name):
    stand = limited_soles(humanoid, friction=0.35)
    still, none = np.zeros(humanoid.n), np.zeros(6)

    def compute(t):
        """The base accelerates sideways ever more: friction of the left foot becomes active at some time."""
        n = len(t)
        Vd, V2d = np.zeros((2, n, 6))
        Vd[:, 4], V2d[:, 4] = 1.5 + t, 1.0
        base = [np.broadcast_to(np.eye(4), (n, 4, 4)), none + 0 * Vd, Vd, V2d, 0 * Vd][:4]
        return getattr(stand, name)(*[np.tile(still, (n, 1))] * 4, base=tuple(base))

    t = np.linspace(0, 0.4, 41)
    f, fd = compute(t)
    steps = np.abs(np.diff(f, axis=0)).reshape(40, -1).max(axis=1)
    assert steps.max() < 6 * steps.min()  # no jump
    jumps = np.abs(np.diff(fd, axis=0)).reshape(40, -1).max(axis=1) > 1e-6 * np.abs(fd).max()
    assert 1 <= jumps.sum() <= 4
    for i in (5, 35):  # either side of the switches
        rate = differentiated_at_once(lambda s, i=i: compute(t[i] + s)[0], 1e-3)
        assert relative_error(rate, fd[i]) < 1e-8


def test_feet_may_be_lifted_by_the_solution(humanoid):
    stand = limited_soles(humanoid, friction=1.0)
    rates, base = pushed(humanoid, 2.0)
    f = stand.contact_wrenches(*rates[:3], base=base[:3])
    assert np.abs(f[0]).max() < 1e-9 * np.abs(f[1]).max()
    for Q in stand.inverse_dynamics(*rates, base=base, method="recursion"):
        assert np.abs(Q[:6]).max() <= 1e-11 * np.abs(Q).max()


def test_what_friction_and_soles_cannot_do_is_refused(humanoid):
    """A linear program finds wrenches, or the call says that there are none."""
    rng, outcomes = np.random.default_rng(1), []
    stand = limited_soles(humanoid, friction=0.4)
    for sideways in rng.uniform(1, 4, 12):
        rates, base = pushed(humanoid, sideways)
        C, G = friction_problem(stand, rates, base)
        Q = humanoid.inverse_dynamics(*rates[:3], base=base[:3], method="recursion")[:6]
        exists = linprog(np.zeros(12), C, np.zeros(len(C)), G, Q, bounds=(None, None)).status == 0
        refusal = ""
        try:
            stand.inverse_dynamics(*rates[:3], base=base[:3])
        except jounce.JounceError as error:
            refusal = str(error)
        expected = "" if exists else "'g1': no contact wrenches within friction and soles balance the motion; slow it"
        assert refusal.startswith(expected)
        outcomes.append((exists, not refusal))
    assert set(outcomes) == {(True, True), (False, False)}


def test_native_code_and_symbols_take_no_limits(humanoid):
    stand = limited_soles(humanoid, friction=0.5)
    refusal(lambda: stand.compile(), "friction and soles are decided on numbers, not in native and generated")
    rates, base = pushed(humanoid, 0.0)
    with expect_refusal("decided on numbers, got symbols or arrays of JAX"):
        jax.jit(lambda q: stand.inverse_dynamics(q, *rates[1:3], base=base[:3]))(rates[0])


@pytest.mark.parametrize(("axis", "most"), [((1, 0), 0.3 / np.sqrt(2)), ((np.sqrt(0.5), np.sqrt(0.5)), 0.3)])
def test_a_quadruped_on_a_slope_slips_where_the_pyramid_ends(dog, axis, most):
    """Along the axes of the contacts at mu / sqrt(2), between them at the angle of friction itself."""
    q, none = np.zeros(12), np.zeros(6)
    for slope, holds in ((0.97 * most, True), (1.03 * most, False)):  # tan of the slope
        n = np.array([slope * axis[0], slope * axis[1], 1]) / np.hypot(slope, 1)
        stand = dog.contacts([jounce.Contact(paw, "point", normal=n, friction=0.3) for paw in PAWS])
        if holds:
            f = stand.contact_wrenches(q, q, q, base=(np.eye(4), none, none), method="recursion")
            assert (np.hypot(f[:, 3], f[:, 4]) <= (0.3 + contact_limits.LIMIT_ROUNDING) * f[:, 5]).all()
        else:
            with expect_refusal("no contact wrenches within friction"):
                stand.contact_wrenches(q, q, q, base=(np.eye(4), none, none), method="recursion")


def test_switches_along_a_motion_are_breaks(humanoid):
    t = np.arange(201) / 100
    q = squat(humanoid, 1 + 0 * t, 0)[0]
    q[:, humanoid.joint_names.index("waist_roll_joint")] = 0.3 * np.sin(7 * t)
    C = np.linalg.inv(humanoid.poses(q, body=FEET[0], base=np.eye(4), method="recursion"))
    motion = jounce.Motion.through(t, q, joint_names=humanoid.joint_names).with_base(t, C, degree=7)
    stand, during = limited_soles(humanoid, friction=0.6), np.linspace(0.5, 0.6, 3)
    found = stand.forces_along(motion, during, order=1).breaks
    assert found
    for switch in found:
        assert switch.order == 1
        assert not switch.causes
        sides = switch.t + np.array([-1e-6, 1e-6])
        Q, Qd = stand.inverse_dynamics(*motion(sides, 3), base=motion.base(sides, 3))
        assert np.abs(np.diff(Q, axis=0)).max() < 1e-5 * np.abs(Q).max()
        assert relative_error(Qd[1] - Qd[0], switch.jump) < 1e-2
    bounds = [during[0], *(switch.t for switch in found), during[-1]]
    for a, b in pairwise(bounds):  # there is none in between
        inside = np.linspace(a, b, 22)[1:-1]
        _, Qd, Q2d = stand.inverse_dynamics(*motion(inside), base=motion.base(inside))
        steps = np.abs(np.diff(Qd, axis=0)).max(axis=1)
        assert (steps < 3 * np.abs(Q2d).max() * (inside[1] - inside[0])).all()


def test_missing_values_stay_missing(humanoid):
    rates, base = pushed(humanoid, 2.0)
    rates = [np.stack([x, x]) for x in rates[:3]]
    rates[0][1, 3] = np.nan
    f = limited_soles(humanoid, friction=0.6).contact_wrenches(*rates, base=base[:3])
    assert np.isfinite(f[0]).all()
    assert np.isnan(f[1]).any()
