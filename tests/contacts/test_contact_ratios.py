"""Limits of contacts along a motion: what share of them some wrenches need, and torques with active limits."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy import optimize
from scipy.linalg import block_diag
from scipy.optimize import linprog

import jounce
from contacts.conftest import FEET, PAWS, squat
from contacts.test_contact_limits import friction_problem, limited_soles
from jounce.engine import balance_points
from jounce.limits import check, contact_ratios
from jounce.limits.check import find_limited_breaks
from jounce.limits.contact_ratios import RATIO_ACCURACY, _find_ratios
from jounce.limits.limited_motion import LimitedMotion
from jounce.limits.motion_polynomials import split_motion
from support.commands import call
from support.refusals import expect_refusal, refusal

MU, X, Y, HEIGHT, G = 0.3, 0.2, 0.1, 0.8, 9.81
RATE = 4.0  # rad/s of the slider


def cart(**options):
    """A box on a sole, of 2 kg, whose slider of 1 kg moves along x at a height."""
    boxes = [jounce.inertia_matrix(mass, [0, 0, 0], np.eye(3) / 50) for mass in (1.0, 2.0)]
    B = np.eye(4)[None].copy()
    B[0, 2, 3] = HEIGHT
    robot = jounce.Robot.from_screws(
        B, [[0, 0, 0, 1, 0, 0]], boxes[:1], [-1], base=boxes[1], base_name="box", name="cart"
    )
    return robot.contacts([jounce.Contact("box", "plane", sole=(X, Y), **options)])


def sliding(amplitude, count=201, stop=1.6):
    """The slider's motion by sin, between even samples of a spline, on a box at rest."""
    t = np.linspace(0, stop, count)
    motion = jounce.Motion.through(t, amplitude * np.sin(RATE * t)[:, None], joint_names=["joint1"])
    return motion.with_base(None, np.eye(4))


def sways(robot, sway, stop=1.0):
    """A squat of the humanoid that throws its trunk to the side, on both feet."""
    t = stop * np.arange(41) / 40
    q = squat(robot, t, 0)[0]
    q[:, robot.joint_names.index("waist_roll_joint")] = sway * np.sin(7 * t)
    C = np.linalg.inv(robot.poses(q, body=FEET[0], base=np.eye(4), method="recursion"))
    return jounce.Motion.through(t, q, joint_names=robot.joint_names).with_base(t, C, degree=7)


def on_flat_points(robot, friction):
    return robot.contacts([jounce.Contact(paw, "point", normal=(0, 0, 1), friction=friction) for paw in PAWS])


def cop_ratio(amplitude):
    """Of the centre of pressure: (m g x - m a h) / (m' g X) with a = -rate^2 x."""
    return (G + RATE**2 * HEIGHT) * amplitude / (3 * G * X)


@pytest.mark.parametrize(("amplitude", "mu"), [(0.1, 0.6), (0.1, 0.1), (0.3, 0.6), (0.15, 0.1)])
def test_one_sole_has_one_wrench_whose_ratios_are_known(amplitude, mu):
    found = cart(friction=mu).check(sliding(amplitude))
    ratios = {
        "friction along x": np.sqrt(2) * RATE**2 * amplitude / (3 * G * mu),  # m a of mu m' g / sqrt(2)
        "centre of pressure along x": cop_ratio(amplitude),
    }
    [row] = [row for row in found.table if row.joint == "box"]
    name = max(ratios, key=ratios.get)
    assert row.limit == name
    assert row.ratio == pytest.approx(ratios[name], rel=1e-4)  # of a spline through samples
    assert row.value / row.bound == pytest.approx(row.ratio, rel=1e-9)
    assert np.sin(RATE * row.t) ** 2 == pytest.approx(1, abs=1e-3)
    assert row.verdict == found.verdict == ("broken" if ratios[name] > 1 else "kept")


def test_violations_begin_and_end_where_the_ratio_is_1():
    [row] = [row for row in cart(friction=MU).check(sliding(0.3, stop=1.0)).table if row.joint == "box"]
    first = np.arcsin(1 / cop_ratio(0.3))
    np.testing.assert_allclose(row.violations, [(first / RATE, (np.pi - first) / RATE)], rtol=1e-4)


def test_peaks_between_samples_count(monkeypatch):
    monkeypatch.setattr(contact_ratios, "_EVEN_TIMES", 2)
    robot, motion = cart(friction=MU), sliding(0.1, 17)
    [row] = robot.check(motion).table
    rho, *_ = _find_ratios(LimitedMotion(robot, motion, robot.limits, ()), row.t + np.linspace(-0.05, 0.05, 101))
    assert row.ratio >= rho.max() * (1 - 1e-9)
    assert np.abs(motion.times - row.t).min() > 1e-3


@pytest.mark.parametrize("share", [0.97, 1.03])
def test_a_quadruped_on_a_slope_needs_the_tangent_of_it(dog, share, monkeypatch):
    monkeypatch.setattr(contact_ratios, "_EVEN_TIMES", 3)
    mu = 0.4
    slope = share * mu / np.sqrt(2)
    normal = np.array([slope, 0, 1]) / np.hypot(slope, 1)
    stand = dog.contacts([jounce.Contact(paw, "point", normal=normal, friction=mu) for paw in PAWS])
    still = jounce.Motion.through(np.arange(9), np.zeros((9, 12))).with_base(None, np.eye(4))
    found = stand.check(still)
    assert found.worst.ratio == pytest.approx(share, rel=1.1 * RATIO_ACCURACY)
    assert found.verdict == ("kept" if share < 1 else "broken")
    assert found.judged["effort"] == (share < 1)
    assert any("limits of effort are not checked: limits of contacts" in note for note in found.notes) == (share > 1)


@pytest.mark.parametrize("friction", [0.6, 0.1, None])
def test_wrenches_exist_at_the_ratio_and_not_below(humanoid, friction):
    """A linear program for each: a_i f <= rho b_i fz, with rho a little larger and a little smaller."""
    stand, motion = limited_soles(humanoid, friction=friction), sways(humanoid, 0.25)
    t = np.array([0.2, 0.45, 0.7])
    rho, *_ = _find_ratios(LimitedMotion(stand, motion, stand.limits, ()), t)
    rates, base = motion(t, 2), motion.base(t, 2)
    for i in range(len(t)):
        state, pose = [x[i] for x in rates], tuple(x[i] for x in base)
        C, G = friction_problem(stand, state, pose)
        Q = humanoid.inverse_dynamics(*state, base=pose, method="recursion")[:6]
        normal = np.tile(np.arange(6) == 5, 2)
        for share, exists in ((rho[i] * (1 + 1e-6), True), (rho[i] * (1 - 2 * RATIO_ACCURACY), False)):
            rows = np.where(normal, share * C, C)
            options = {"primal_feasibility_tolerance": 1e-10}
            found = linprog(np.zeros(12), rows, np.zeros(len(C)), G, Q, bounds=(None, None), options=options)
            assert (found.status == 0) == exists


def test_no_multiple_of_the_limits_makes_the_ground_pull():
    t = np.linspace(0, 1, 201)
    C = np.tile(np.eye(4), (201, 1, 1))
    C[:, 2, 3] = np.sin(RATE * t)  # whose acceleration passes that of gravity
    robot, fall = cart(friction=MU), sliding(0.1, stop=1.0).with_base(t, C, degree=7)
    rho, *_ = _find_ratios(LimitedMotion(robot, fall, robot.limits, ()), np.array([0.1, 0.8]))
    assert np.isinf(rho).tolist() == [False, False]
    rho, *_ = _find_ratios(LimitedMotion(robot, fall, robot.limits, ()), np.array([0.4]))
    assert np.isinf(rho).all()


def hinged(**options):
    """The cart, a flap of which is hinged beside it and stands on a sole of its own."""
    boxes = [jounce.inertia_matrix(mass, [0, 0, 0], np.eye(3) / 50) for mass in (1.0, 1.5, 2.0)]
    B = np.tile(np.eye(4), (2, 1, 1))
    B[0, 2, 3], B[1, :3, 3] = HEIGHT, (1, 0, 0.3)
    X = [[0, 0, 0, 1, 0, 0], [0, 1, 0, 0, 0, 0]]
    robot = jounce.Robot.from_screws(B, X, boxes[:2], [-1, -1], base=boxes[2], base_name="box", name="cart")
    flap = robot.body_names[-1]
    places = {"box": (0, 0, 0), flap: (0.3, 0, -0.3)}
    return robot.contacts([jounce.Contact(name, "plane", place=place, **options) for name, place in places.items()])


def swinging_slider(robot):
    """The slider moves far enough for friction of one sole to be active."""
    t = np.linspace(0, 1.6, 41)
    q = np.stack([0.3 * np.sin(RATE * t), 0 * t], axis=1)
    return jounce.Motion.through(t, q, joint_names=robot.joint_names).with_base(None, np.eye(4))


def test_forces_are_those_within_limits_of_contacts(monkeypatch):
    """Efforts and their rates against those at many times, on both sides of switches."""
    monkeypatch.setattr(check, "judge_contacts", lambda b: ())
    stand = hinged(friction=0.25, sole=(X, Y))
    motion = swinging_slider(stand)
    found = stand.with_limits(effort=50, effort_rate=1e3, second_effort_rate=1e6).check(motion)
    switches = np.array([x.t for x in found.breaks])
    assert len(switches) >= 2
    t = np.unique(np.concatenate([np.linspace(0, 1.6, 1000), switches - 1e-7, switches + 1e-7]))
    Q, Qd = stand.inverse_dynamics(*motion(t, 3), base=motion.base(t, 3))
    weights = stand.mechanism.contacts[0].weights
    least = hinged(weights=weights).inverse_dynamics(*motion(t, 2), base=motion.base(t, 2))
    assert np.abs(Q - least).max() > 0.05 * np.abs(Q).max()  # limits change torques
    for row in (row for row in found.table if row.limit in ("effort", "effort_rate")):
        values = np.abs((Q, Qd)[row.limit == "effort_rate"][:, 6 + stand.joint_names.index(row.joint)])
        assert abs(row.value) >= values.max() * (1 - 1e-6)
        assert abs(row.value) <= values.max() * (1 + 1e-4)
    jumps = [row for row in found.table if row.limit == "second_effort_rate" and row.joint == stand.joint_names[1]]
    assert [row.ratio for row in jumps] == [np.inf]
    [note] = found.notes
    assert note.endswith("Qd jumps because of a limit of a contact; no limit of second effort rate can be met there")


def test_pieces_end_with_the_rates_before_a_switch():
    stand = hinged(friction=0.25, sole=(X, Y)).with_limits(effort_rate=1e3)
    motion = swinging_slider(stand)
    b = LimitedMotion(stand, motion, stand.limits, ("effort_rate",))
    switches = tuple(x.t for x in find_limited_breaks(b))
    [pieces] = split_motion(replace(b, switches=switches))
    for switch in switches:
        sides = switch + np.array([-1e-7, 1e-7])
        _, Qd = stand.inverse_dynamics(*motion(sides, 3), base=motion.base(sides, 3))
        assert np.abs(Qd[1] - Qd[0]).max() > 1e-2 * np.abs(Qd).max()
        [left] = pieces.right["effort_rate"][pieces.stop == switch]
        [right] = pieces.left["effort_rate"][pieces.start == switch]
        np.testing.assert_allclose([left, right], Qd[:, 6:], atol=1e-4 * np.abs(Qd).max())


def test_what_does_not_take_limited_contacts_says_so(humanoid):
    stand, motion = limited_soles(humanoid, friction=0.6), sways(humanoid, 0.0)
    with expect_refusal("'g1': slowdown takes contacts without friction and sole; check judges them"):
        stand.slowdown(motion)
    refusal(lambda: stand.retime(motion), "of its contacts would enter; robot.contacts([]) is the robot")


def test_contacts_along_samples_are_never_kept():
    t, rng = np.linspace(0, 1.6, 401), np.random.default_rng(0)
    q = 0.1 * np.sin(RATE * t) + 1e-5 * rng.normal(size=401)
    motion = jounce.Motion.fit(t, q[:, None], joint_names=["joint1"]).with_base(None, np.eye(4))
    [row] = cart(friction=MU).check(motion).table
    assert row.verdict == "undecided"
    assert row.undecided == ((0.0, 1.6),)
    assert "deviations of contact forces" in row.cause
    assert row.ratio == pytest.approx(cop_ratio(0.1), rel=1e-2)


def test_contacts_alone_are_checked():
    robot = cart(friction=MU)
    assert not robot.limits.kinds
    assert len(robot.check(sliding(0.1)).table) == 1


CONTACTS = [
    jounce.Contact("FL_FOOT", "point", place=(0, 0.1, 1 / 3), normal=(0, 0.6, 0.8), friction=0.5),
    jounce.Contact(
        "HR_LOWER_LEG", "plane", place=[[0, -1, 0, 0.1], [1, 0, 0, 0], [0, 0, 1, 1 / 7], [0, 0, 0, 1]],
        sole=(0.1, 0.2), weights=(1, 2, 3, 4, 5, 6),
    ),
    jounce.Contact("FR_FOOT", "line"),
]  # fmt: skip
STATED = ("frame", "kind", "place", "normal", "friction", "sole", "weights")


@pytest.mark.parametrize("suffix", [".yaml", ".json"])
def test_robot_files_keep_contacts(dog, tmp_path, suffix):
    jounce.save(dog.contacts(CONTACTS), tmp_path / f"dog{suffix}")
    found = jounce.load(tmp_path / f"dog{suffix}").mechanism.contacts
    for x, y in zip(found, CONTACTS, strict=True):
        assert all(np.array_equal(getattr(x, name), getattr(y, name)) for name in STATED)


@pytest.mark.parametrize(("old", "new", "match"), [
    ("kind: line", "kind: lime", re.compile(r"dog\.yaml:\d+: unknown kind of contact 'lime'; did you mean 'line'")),
    ("frame: FL_FOOT", "frame: FL_PAW", re.compile(r"dog\.yaml:\d+: unknown frame of a contact 'FL_PAW'")),
    ("friction: 0.5", "friction: low",
     re.compile(r"dog\.yaml:\d+: contact 'FL_FOOT': friction is 'low'; expected a number")),
    ("friction: 0.5", "slip: 0.5", re.compile(r"dog\.yaml:\d+: entry 1 of contacts of the robot has no key 'slip'")),
])  # fmt: skip
def test_wrong_contacts_of_files_are_refused(dog, tmp_path, old, new, match):
    path = tmp_path / "dog.yaml"
    jounce.save(dog.contacts(CONTACTS), path)
    text = path.read_text()
    assert text.count(old) == 1
    path.write_text(text.replace(old, new))
    refusal(lambda: jounce.load(path), match)


def test_welded_bases_have_no_contacts(dog, tmp_path):
    jounce.save(dog.contacts(CONTACTS), tmp_path / "dog.yaml")
    with expect_refusal("'solo12' does not float, as what stands on contacts does"):
        jounce.load(tmp_path / "dog.yaml", base="fixed")


def test_commands_take_contacts_of_files(tmp_path):
    jounce.save(cart(friction=MU), tmp_path / "cart.yaml")
    t = np.linspace(0, 1.6, 81)
    places = [f"base.{x}" for x in ("x", "y", "z", "qx", "qy", "qz")]
    rows = [",".join(["t", "joint1", *places, "base.qw"])]
    rows += [",".join(map(repr, [s, 0.3 * np.sin(RATE * s).item(), *[0] * 6, 1])) for s in t.tolist()]
    (tmp_path / "motion.csv").write_text("\n".join(rows))
    check = call("check", tmp_path / "cart.yaml", tmp_path / "motion.csv", "--json")
    assert check.exit_code == 1, check.output
    [row] = json.loads(check.stdout)["limits"]
    assert (row["joint"], row["limit"], row["unit"]) == ("box", "centre of pressure along x", "N m")
    assert row["ratio"] == pytest.approx(cop_ratio(0.3), rel=1e-3)


def test_lines_of_contacts_are_soles_and_forces():
    robot, motion = cart(friction=3.0), sliding(0.05)
    t = np.array([0.1, 0.3])
    rates = motion(t, 2)
    lines = balance_points.contact_lines_along(robot, motion, t)[:, 0]
    np.testing.assert_allclose(lines[:, balance_points.SOLE_EDGE][:, :4].mean(axis=1), 0, atol=1e-12)
    np.testing.assert_allclose(np.abs(lines[:, balance_points.SOLE_EDGE]), np.broadcast_to([X, Y, 0], (2, 5, 3)))
    start, stop = lines[:, balance_points.FORCE_ENDS].swapaxes(0, 1)
    np.testing.assert_allclose(stop - start, np.stack([rates[2][:, 0], 0 * t, 3 * G + 0 * t], axis=1), atol=1e-9)
    p = (G * rates[0][:, 0] - HEIGHT * rates[2][:, 0]) / (3 * G)
    np.testing.assert_allclose(start, np.stack([p, 0 * t, 0 * t], axis=1), atol=1e-12)
    assert np.isnan(lines[:, [5, 8]]).all()
    assert balance_points.contact_lines_along(robot.contacts([]), motion, t).shape == (2, 0, 9, 3)


@pytest.mark.parametrize(("share", "verdict"), [(1 - 1e-7, "kept"), (1 + 1e-5, "broken")])
def test_a_ratio_of_1_is_possible(dog, share, verdict):
    """On a slope that takes a share of the friction; the ratio is 1e-6 of itself too large at most."""
    slope = share * 0.4 / np.sqrt(2)
    normal = np.array([slope, 0, 1]) / np.hypot(slope, 1)
    stand = dog.contacts([jounce.Contact(paw, "point", normal=normal, friction=0.4) for paw in PAWS])
    still = jounce.Motion.through(np.arange(9) / 80, np.zeros((9, 12))).with_base(None, np.eye(4))
    rows = [row for row in stand.with_limits(effort=np.inf).check(still.with_step(0.05)).table if row.joint in PAWS]
    assert ("broken" in [row.verdict for row in rows]) == (verdict == "broken")


def test_checks_see_bursts_between_the_times_of_a_motion():
    """The slider jerks for 0.04 s in ten, at which no time of the motion is, nor one of 201 even ones."""
    P = np.polynomial.Polynomial
    begin, length = 3.005, 0.04
    jerk = 1e-4 * (P([0, 4]) * P([1, -1])) ** 6
    c = np.zeros((13, 3, 1))
    c[:, 1, 0] = jerk(P([0, 1 / length])).coef[::-1]
    motion = jounce.Motion.piecewise([0, begin, begin + length, 10], c, joint_names=["joint1"])
    [row] = cart(friction=0.6).check(motion.with_base(None, np.eye(4)).with_step(5.0)).table
    u = np.linspace(0, 1, 10_001)
    moments = G * jerk(u) - HEIGHT * jerk.deriv(2)(u) / length**2
    assert row.limit == "centre of pressure along x"
    assert row.ratio == pytest.approx(np.abs(moments).max() / (3 * G * X), rel=1e-6)
    assert begin < row.t < begin + length


def swaying_trunk(stand):
    """Times, and a motion over them that takes friction of 0.06 at most."""
    t = np.linspace(0, 1, 21)
    q = np.tile([0, 0.6, -1.4], 4) + 0.05 * np.sin(5 * t)[:, None]
    return t, stand.project(jounce.Motion.through(t, q), base=np.eye(4))


def test_friction_that_a_motion_needs_is_its_own(dog):
    """Whatever friction there is, down to very slippery ground."""
    needs = []
    for friction in (0.2, 1e-3):
        stand = on_flat_points(dog, friction)
        t, motion = swaying_trunk(stand)
        needs.append(friction * _find_ratios(LimitedMotion(stand, motion, stand.limits, ()), t)[0])
    np.testing.assert_allclose(needs[1], needs[0], rtol=2 * RATIO_ACCURACY)
    assert 1e-3 < needs[1].min() < needs[1].max() < 0.1


@pytest.mark.parametrize("friction", [1e-3, 0.0])
def test_ground_of_hardly_any_friction_is_decided(dog, friction):
    stand = on_flat_points(dog.with_limits(effort=np.inf), friction)
    found = stand.check(swaying_trunk(stand)[1])
    assert found.verdict == "broken"
    ratios = [row.ratio for row in found.table if row.joint in PAWS]
    assert all(ratio == np.inf if friction == 0 else 1 < ratio < np.inf for ratio in ratios)


def test_ratios_that_creep_take_few_programs(dog, monkeypatch):
    """Where the best wrenches are not unique Dinkelbach's steps alone take hundreds; linear programs hold the ratio."""
    stand = on_flat_points(dog, 0.2)
    even = np.linspace(0, 0.3, 31)
    q = np.tile([0, 0.6, -1.4], 4) + 0.03 * np.sin(21 * even)[:, None] * np.tile([0, 1, 0], 4)
    motion = stand.project(jounce.Motion.through(even, q), base=np.eye(4))
    t, programs, solve = np.linspace(0, 0.3, 100), [], optimize.linprog
    monkeypatch.setattr(optimize, "linprog", lambda *given, **options: programs.append(1) or solve(*given, **options))
    rho, *_ = _find_ratios(LimitedMotion(stand, motion, stand.limits, ()), t)
    assert len(programs) <= 40
    rates, base = motion(t, 2), motion.base(t, 2)
    C = block_diag(*(x.limits[:, 3:] for x in stand.mechanism.contacts))
    for i in range(5, 100, 12):
        state, pose = [x[i] for x in rates], tuple(x[i] for x in base)
        J = [dog.jacobian(state[0], body=paw, base=pose[:1], frame="world", method="recursion") for paw in PAWS]
        G = np.concatenate([x[3:, :6] for x in J]).T
        Q = dog.inverse_dynamics(*state, base=pose, method="recursion")[:6]
        normal, options = np.tile(np.arange(3) == 2, 4), {"primal_feasibility_tolerance": 1e-10}
        for share, exists in ((rho[i] * (1 + 1e-6), True), (rho[i] * (1 - 2 * RATIO_ACCURACY), False)):
            rows = np.where(normal, share * C, C)
            found = solve(np.zeros(12), rows, np.zeros(len(C)), G, Q, bounds=(None, None), options=options)
            assert (found.status == 0) == exists
