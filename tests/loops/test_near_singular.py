"""Results near singular positions: those that are returned are right, and those that are right are returned.

Of 4,000 positions each, as here, none that was returned was off by more than 2e-6 of its size.
"""

import re
import warnings
from dataclasses import replace

import numpy as np
import pytest
from pyarrow import parquet
from scipy.optimize import brentq

import jounce
from jounce import JounceError, JounceWarning, UncertainError
from jounce.dynamics.computation import Computation
from jounce.dynamics.loop_assembly import MIN_INVERSE_CONDITION, inverse_conditions, numpy_step
from jounce.dynamics.loop_branches import scales
from jounce.dynamics.quantities import QUANTITIES
from jounce.engine.certain_digits import describe_uncertain, displace_dependent, max_condition
from jounce.io import tables
from support import near_singular, own_equations
from support.commands import call
from support.linkages import elbows, fivebar, fourbar, rods, unit
from support.refusals import expect_refusal, refusal

COUNT = 25  # positions
ZEROS = (0.9, 1.3, -0.7)  # rad, coordinates of the four-bar where it lies: angles near 0 would be rounded less
RIGHT = 2e-8  # of the size of a result: such errors are smaller than any estimate may excuse


def crossed(rng):
    """A crossed parallelogram, which meets the other branch where its crank lies on the ground: a change point."""
    robot = fourbar(1.0, 0.5, 1.0, 0.5, [0.7, -1.9, -1.0], zeros=ZEROS)
    q = 10.0 ** rng.uniform(-6, 0, COUNT)
    d = -2 * np.arctan(3 * np.tan(q / 2))  # of the rocker, by half angles: (1 + 0.5) / (1 - 0.5)
    return robot, np.stack([q, d, d], axis=1) + ZEROS


def folded(rng, stretched):
    """A five-bar near positions in which its forearms are stretched, or fold onto each other."""
    base, left, right = 1.0, [0.5, 0.7], [0.6, 0.9] if stretched else [0.6, 1.2]
    start, found = np.array([2.0, 1.0]), []
    first, reach = elbows(base, left, right, start, 1)
    robot = fivebar(base, left, right, [start[0], first[0], start[1], first[1]])
    while len(found) < COUNT:
        a, b, side = *rng.uniform(-3, 3, 2), rng.choice([-1, 1])

        def reach_at(t, a=a, b=b):
            return float(elbows(base, left, right, np.array([a, b + t]), 1)[1])

        t = np.linspace(0, 2, 41)
        reach = np.array([reach_at(x) for x in t])
        out = np.flatnonzero((reach[:-1] > 0) & (reach[1:] < 0))
        if not len(out):
            continue
        edge = brentq(reach_at, t[out[0]], t[out[0] + 1], xtol=1e-15)
        at = np.array([a, b + edge - 10.0 ** rng.uniform(-12, 0)])
        far = np.linalg.norm(left[0] * unit(at[0]) - right[0] * unit(at[1]) - [base, 0]) > max(left[1], right[1])
        turned, reach = elbows(base, left, right, at, side)
        if reach > 0 and far == stretched:
            found.append([at[0], turned[0], at[1], turned[1]])
    return robot, np.array(found)


CASES = {
    "change point": crossed,
    "stretched": lambda rng: folded(rng, True),
    "folded": lambda rng: folded(rng, False),
}


@pytest.mark.parametrize("name", CASES)
def test_results_are_right_or_refused(name):
    rng = np.random.default_rng(4)
    robot, positions = CASES[name](rng)
    asked, kernel, returned, refused, missed = Computation("inverse_dynamics", 2), robot.compile(), 0, 0, 0
    own, others = (list(places) for places in (robot.mechanism.closure.independent, robot.mechanism.closure.dependent))
    for q in positions:
        rates = rng.normal(size=(4, robot.n))
        try:
            found, uncertain = robot.inverse_dynamics(q, *rates), [False] * 3
        except UncertainError as error:
            found, uncertain = error.results, [bool(x.any()) for x in error.uncertain]
        except JounceError:  # where 1/cond is below 1e-7
            assert inverse_conditions(robot.mechanism, q[None])[0] < 2 * MIN_INVERSE_CONDITION
            continue
        closed = robot.coordinates(q) if not any(uncertain) else q
        unchecked = kernel(closed[own], *rates, closed[others])
        for x, y, z, lost in zip(
            found, own_equations.results(robot, asked, [q, *rates]), unchecked, uncertain, strict=True
        ):
            size = np.abs(y).max()
            assert np.isnan(x).all() if lost else np.abs(x - y).max() <= 2e-6 * size
            returned, refused = returned + (not lost), refused + lost
            missed += lost and bool(np.abs(z - y).max() < RIGHT * size)
    assert min(returned, refused) > COUNT / 4
    assert missed <= 0.02 * returned


@pytest.mark.sweep(12)
@pytest.mark.parametrize(("name", "quantity"), near_singular.CASES, ids=map("-".join, near_singular.CASES))
def test_all_quantities_are_right_or_refused(name, quantity):
    """Nothing that is returned is off by more than is promised, and few refused results have 2.3 digits more."""
    mechanism, rng, found = near_singular.ROBOTS[name](), np.random.default_rng(3), near_singular.Digits()
    robot, row = mechanism.serving(quantity), QUANTITIES[quantity]
    for order in range(row.highest(1) + 1):
        for exponent in np.linspace(-5, 0, COUNT // 2):
            found.judge(robot, quantity, order, mechanism.position(rng, 10**exponent), rng)
    assert max(found.returned) <= near_singular.PROMISED
    assert sum(error < RIGHT / 4 for error in found.refused) <= max(1, 0.02 * len(found.returned))


def test_the_coriolis_matrix_near_a_change_point():
    """It holds F' as forces do: values for |q| below 0.004 were off by up to 4e-5."""
    robot = fourbar(1.0, 0.5, 1.0, 0.5, [0.7, -1.9, -1.0])
    for q in (0.0014, 0.0017, 0.0025):
        refusal(lambda q=q: robot.coriolis_matrix([q], [1.0]), "C at q would be off", kind=UncertainError)
    asked, at = Computation("coriolis_matrix", 0), near_singular.crossed_fourbar().position
    whole = at(np.random.default_rng(0), 0.01) - ZEROS
    [exact] = own_equations.results(robot, asked, [whole, [1.0]])
    np.testing.assert_allclose(robot.coriolis_matrix(whole, [1.0]), exact, rtol=1e-6)


@pytest.mark.parametrize(
    ("quantity", "held"),
    [
        ("poses", 0),
        ("mass_matrix", 1),
        ("jacobian", 1),
        ("gravity_forces", 1),
        ("twists", 1),
        ("inverse_dynamics", 2),
        ("coriolis_matrix", 2),
        ("forward_dynamics", 2),
        ("inverse_dynamics_partials", 3),
        ("forward_dynamics_partials", 3),
        ("motor_torques", 4),
    ],
)
def test_derivatives_of_f_that_quantities_hold(quantity, held):
    """Those of positions, F, F', F'', ...: C takes as few rates as twists, and holds what forces do."""
    assert QUANTITIES[quantity].held_rates == held
    assert max_condition(Computation(quantity, 1)) == pytest.approx((1e-6 / 2.2e-16) ** (1 / (held + 3)), rel=1e-2)


def test_the_limit_of_the_condition_number_has_a_reason():
    """Below it no error is above the threshold, just above it errors are estimated, and small ones returned."""
    robot, _ = crossed(np.random.default_rng(0))
    asked = Computation("inverse_dynamics", 2)
    assert max_condition(asked) == pytest.approx((1e-6 / 2.2e-16) ** (1 / 6), rel=1e-2)
    q = np.array([ZEROS[0] + 0.03])  # cond 80
    assert all(np.isfinite(x).all() for x in robot.inverse_dynamics(q, [1.0], [1.0], [1.0], [1.0]))
    with expect_refusal("Qd, Q2d at q would be off …; Q is certain there: give fewer rates", kind=UncertainError):
        robot.inverse_dynamics(np.array([ZEROS[0] + 3e-3]), [1.0], [1.0], [1.0], [1.0])


def test_loops_count_that_are_not_the_most_singular():
    """The lightest of two four-bars is, and its own errors are nothing to the forces of the other."""
    tree = rods([(-1, 0.0, [0.5, 1.0]), (-1, 1.0, [0.5]), (-1, 5.0, [0.5, 1.0]), (-1, 6.0, [0.5])]).mechanism
    tree = jounce.Robot(replace(tree, M=tree.M * np.repeat([1e-6, 1.0], 3)[:, None, None]))
    loops, cranks = [("end0", "end1"), ("end2", "end3")], [tree.joint_names[0], tree.joint_names[3]]
    robot = tree.closed(loops, cranks, start=[0.7, -1.9, -1.0] * 2)
    for heavy, light in ((1.5e-3, 1e-3), (1.5e-3, 0.1), (0.1, 1e-3)):
        rates = ([light, heavy], [0.5, 0.5], [0.2, 0.2], [0.0, 0.0], [0.0, 0.0])
        if heavy == 0.1:
            assert np.isfinite(robot.inverse_dynamics(*rates)).all()
        else:
            refusal(lambda rates=rates: robot.inverse_dynamics(*rates), "Qd, Q2d at q", kind=UncertainError)


def test_rounding_opens_loops_by_four_eps():
    """Along all singular directions of the constraints, and along the least one alone; in rows near singular ones."""
    tree = rods([(-1, 0.0, [0.5, 1.0]), (-1, 1.0, [0.5]), (-1, 5.0, [0.5, 1.0]), (-1, 6.0, [0.5])])
    loops, cranks = [("end0", "end1"), ("end2", "end3")], [tree.joint_names[0], tree.joint_names[3]]
    robot = tree.closed(loops, cranks, start=[0.7, -1.9, -1.0] * 2)
    m, c = robot.mechanism, robot.mechanism.closure
    own, others = list(c.independent), list(c.dependent)
    whole = robot.coordinates([[0.8, 0.5], [1e-3, 2e-3], [0.9, 1.5e-3]])
    A = numpy_step(m)(whole, np.zeros(m.n))[2]
    _, sizes, ways = np.linalg.svd(A)
    conditions = sizes[:, 0] / sizes[:, -1]
    assert conditions[0] < 30 < 300 < conditions[1:].min()
    given = whole[:, own], whole[:, others]
    found = displace_dependent(m, *given, 100.0)
    assert [x.shape for x in found] == [given[1].shape] * 2
    places = np.searchsorted(c.dependent, c.solved)
    along, least = ((x - given[1])[:, places] for x in found)
    assert not along[0].any()
    assert not least[0].any()
    for i, nearly in ((1, 2), (2, 1)):  # loops that are nearly singular
        opened = [sizes[i, -nearly:] * (ways[i, -nearly:] @ x[i]) / 2.0**-52 for x in (along, least)]
        np.testing.assert_allclose(opened[0], np.full(nearly, 4.0), rtol=0.02)
        np.testing.assert_allclose(opened[1], [0.0, 4.0][-nearly:], rtol=0.02, atol=0.02)
    one = whole[1, own], whole[1, others]
    for x, y in zip(displace_dependent(m, *one, 100.0), found, strict=True):
        np.testing.assert_allclose(x - one[1], y[1] - one[1], rtol=1e-6, atol=1e-15)


def test_slides_are_moved_by_the_length_of_the_robot():
    """The slide of a slider-crank whose rod is nearly perpendicular to it, moved by the crank."""
    crank, rod = 0.7, 0.5
    made = near_singular.slider_crank(crank, rod).robot.mechanism
    angle = np.arcsin(rod / crank) - 1e-6
    tilt = -np.arcsin(np.sin(angle) * crank / rod)
    q = np.array([angle, tilt - angle, crank * np.cos(angle) + rod * np.cos(tilt)])
    m = jounce.Robot(made.tree).closed([("end", "slide")], [made.tree.joints[0]], start=made.closure.start).mechanism
    c, length = m.closure, scales(m).length
    assert (list(c.independent), list(c.dependent), list(c.solved)) == ([0], [1, 2], [1, 2])
    assert abs(length - 1) > 0.1
    _, sizes, ways = np.linalg.svd(numpy_step(m)(q[None], np.zeros(m.n))[2][0])
    assert sizes[0] > 300 * sizes[-1]
    for found in displace_dependent(m, q[:1], q[1:], 100.0):
        off = (found - q[1:]) / [1.0, length]
        assert sizes[-1] * (ways[-1] @ off) / 2.0**-52 == pytest.approx(4.0, rel=0.02)


def test_positions_are_moved_from_a_condition_number_on():
    """Where the estimate is above the limit too, which is that of the steps of the two loops here."""
    tree = rods([(-1, 0.0, [0.5, 1.0]), (-1, 1.0, [0.5]), (-1, 5.0, [0.5, 1.0]), (-1, 6.0, [0.5])])
    loops, cranks = [("end0", "end1"), ("end2", "end3")], [tree.joint_names[0], tree.joint_names[3]]
    m = tree.closed(loops, cranks, start=[0.7, -1.9, -1.0] * 2).mechanism
    whole = jounce.Robot(m).coordinates([1e-3, 2e-3])
    own, others = (whole[list(x)] for x in (m.closure.independent, m.closure.dependent))
    sizes = np.linalg.svd(numpy_step(m)(whole[None], np.zeros(m.n))[2][0], compute_uv=False)
    condition = sizes[0] / sizes[-1]
    assert displace_dependent(m, own, others, condition * (1 + 1e-6)) is None
    assert displace_dependent(m, own, others, condition * (1 - 1e-6)) is not None
    assert displace_dependent(m, own.astype(object), others, 1.0) is None
    assert displace_dependent(m, own, others.astype(object), 1.0) is None


def test_rows_without_digits_are_counted_in_words():
    m, times = near_singular.crossed_fourbar().robot.mechanism, [np.array(x) for x in ([], [0.5], [0.25, 1.0, 0.75])]
    assert describe_uncertain(m, ["Q", "Qd", "Q2d"], times, 7) == (
        "'robot': the loops are so nearly singular that results have errors above 1e-06 of their size, and are NaN:"
        " Qd in 1 of 7 rows, t = 0.5 s; Q2d in 3 of 7 rows, t = 0.25 .. 1 s"
    )


def test_refusals_name_samples_and_orders_and_write_nothing():
    robot, _ = crossed(np.random.default_rng(0))
    q, qd = ZEROS[0] + np.array([[0.5], [0.003], [0.4], [0.002]]), np.ones((4, 1))
    out = tuple(np.full((4, 1), 7.0) for _ in range(3))
    for _ in range(2):  # by the long way of calls, and the short one
        with expect_refusal("Qd, Q2d at q of 2 of 4 samples, first 1, would be off", kind=UncertainError) as error:
            robot.inverse_dynamics(q, qd, qd, qd, qd, out=out)
        assert all((x == 7).all() for x in out)
        np.testing.assert_array_equal(error.value.uncertain[2], [False, True, False, True])
        np.testing.assert_array_equal(np.isnan(error.value.results[2][:, 0]), [False, True, False, True])
        good = robot.inverse_dynamics(q[::2], qd[::2], qd[::2], qd[::2], qd[::2], out=tuple(x[::2] for x in out))
        np.testing.assert_allclose(error.value.results[2][::2], good[2], rtol=1e-12)
        for x in out:
            x[:] = 7


@pytest.mark.parametrize("name", ["mass_matrix", "momentum", "jacobian", "forward_dynamics", "regressor"])
def test_other_quantities_are_refused_too(name):
    robot, _ = crossed(np.random.default_rng(0))
    with expect_refusal("nearly singular", kind=UncertainError):
        getattr(robot, name)(*[[ZEROS[0] + 1e-6], [1.0], [1.0], [1.0], [1.0]])


def test_rows_of_a_motion_without_digits_are_missing_and_counted():
    robot, _ = crossed(np.random.default_rng(0))
    motion, t = jounce.Motion.polynomial([[ZEROS[0] + 0.7, -0.6999]], 1.0), np.linspace(0, 1, 2001)
    with pytest.warns(
        JounceWarning, match=r"are NaN: Q in 1 of 2001 rows, t = 1 s; Qd in \d+ .*, t = 0\.\d+ \.\. 1 s; Q2d"
    ):
        along = robot.forces_along(motion, t)
    for k, least in ((0, 2000), (1, 1950), (2, 1900)):
        known = np.isfinite(along.forces[k][:, 0])
        assert least <= known.sum() <= 2001
        assert known[:1900].all()
    np.testing.assert_allclose(along.forces[2][:1900], robot.inverse_dynamics(*motion(t[:1900]))[2], rtol=1e-6)


def test_loads_and_drives_are_refused_too():
    robot, _ = crossed(np.random.default_rng(0))
    body = robot.body_names[1]
    far, near = [[ZEROS[0] + 0.5], [1.0], [1.0]], [[ZEROS[0] + 1e-5], [1.0], [1.0]]
    assert all(
        np.isfinite(W).all()
        for W in robot.wrench(*far, body=body, force=tuple([1.0, 0, 0] for _ in range(3)), frame="world")
    )
    with expect_refusal("W2d at q would be off", kind=UncertainError):
        robot.wrench(*near, body=body, force=tuple([1.0, 0, 0] for _ in range(3)), frame="world")
    damped = fourbar(1.0, 0.5, 1.0, 0.5, [0.7, -1.9, -1.0], damping=0.3)
    assert np.isfinite(damped.drive_forces(*far[:3])).all()
    refusal(lambda: damped.drive_forces([5e-7], [1.0], [1.0]), "Q at q would be off", kind=UncertainError)


def test_limits_name_the_time_at_which_digits_end():
    robot, _ = crossed(np.random.default_rng(0))
    limited = robot.with_limits(effort_rate=100.0, effort=100.0)
    motion = jounce.Motion.polynomial([[ZEROS[0] + 0.7, -0.6999]], 1.0)
    for judge in (limited.check, limited.slowdown, limited.retime):
        with expect_refusal(re.compile(r"along the motion at t = (0\.9\d*|1) s: .* would be off by up to")):
            judge(motion)
    assert limited.check(jounce.Motion.polynomial([[ZEROS[0] + 0.7, -0.6]], 1.0)).table


@pytest.mark.parametrize("output", ["forces.parquet", "folder"])
def test_tables_of_forces_have_missing_numbers_where_digits_end(output, tmp_path):
    """Along a motion that is read as a whole, and of rows that state all rates and all joints, by parts."""
    robot, _ = crossed(np.random.default_rng(0))
    jounce.save(robot, tmp_path / "robot.yaml")
    motion, t = jounce.Motion.polynomial([[ZEROS[0] + 0.7, -0.6999]], 1.0), np.linspace(0, 1, 401)
    rates, (crank, *others) = motion(t, 4), robot.mechanism.closure.coordinates
    names = ("q", "qd", "q2d", "q3d", "q4d")
    columns = {"t": t} | {f"{crank}.{name}": x[:, 0] for name, x in zip(names, rates, strict=True)}
    columns |= {f"{name}.q": x for name, x in zip(others, robot.coordinates(rates[0]).T[1:], strict=True)}
    (tmp_path / "moves").mkdir()
    tables.write(tmp_path / "moves" / "a.csv", columns)
    given = "moves" if output == "folder" else "moves/a.csv"
    asked = ["run", str(tmp_path / "robot.yaml"), str(tmp_path / given), "-o", str(tmp_path / output)]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        done = call(*asked)
    assert done.exit_code == 0, done.output
    [written] = (tmp_path / output).glob("*.parquet") if output == "folder" else [tmp_path / output]
    found = parquet.read_table(written)[f"{crank}.Q2d"].to_numpy()
    assert 0 < np.isnan(found).sum() < 100
