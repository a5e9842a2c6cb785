"""Drive trains: every term and its rates against exact differentiation, each alone and all together, on every path."""

import copy
import subprocess
import sys
from pathlib import Path

import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
import sympy
from hypothesis import given, settings
from hypothesis import strategies as st

import casadi
import jounce
from jounce.checks.description import describe
from jounce.model.drive_trains import ALL_DRIVE_TERMS, DEFAULT_SMOOTHING_VELOCITY, DRIVE_TERMS
from support.commands import call
from support.files import LINKS, joint, robot_file
from support.refusals import expect_refusal, refusal
from support.robots import mechanisms, random_mechanism, relative_error
from support.tools import require
from support.units import SI

PANDA = Path(__file__).parents[2] / "examples" / "panda.urdf"
ONE = {"B": [np.eye(4)], "X": [[0, 0, 1, 0, 0, 0]], "M": [np.eye(6)]}
METHODS = ("recursion", "closed_form", "paper", "kernel")


def random_amounts(rng, nb):
    names = ("armature", "damping", "friction", "eps", "stribeck", "stribeck_velocity", "stiffness", "rest", "offset")
    return {name: rng.uniform(0.2, 2, nb) for name in names}


def robot_with_drives(mechanism, drives, terms=DRIVE_TERMS):
    """The robot of a mechanism with drives, some of which act."""
    m = mechanism
    names = {"names": m.bodies, "joint_names": m.coordinates}
    robot = jounce.Robot.from_screws(m.B, m.X, m.M, m.parent, gravity=m.gravity, G=m.G, g=m.g, drives=drives, **names)
    return robot.with_drives(terms)


def drawn_with_drives(drawn, terms=DRIVE_TERMS):
    mechanism, rng = drawn
    return robot_with_drives(mechanism, random_amounts(rng, mechanism.nb), terms), rng


def exact_term(term, drives, i, rates, order, digits=60):
    """The derivatives of a term of joint i, of the polynomial with the given rates, by mpmath's Taylor series."""
    d = {name: mpmath.mpf(float(array[i])) for name, array in drives.items()}

    def theta(t, k):
        return sum(mpmath.mpf(float(x)) * t ** (j - k) / mpmath.factorial(j - k) for j, x in enumerate(rates) if j >= k)

    laws = {
        "armature": lambda t: d["armature"] * theta(t, 2),
        "damping": lambda t: d["damping"] * theta(t, 1),
        "friction": lambda t: d["friction"] * mpmath.tanh(theta(t, 1) / d["eps"]),
        "stribeck": lambda t: (
            d["stribeck"]
            * mpmath.tanh(theta(t, 1) / d["eps"])
            * mpmath.exp(-((theta(t, 1) / d["stribeck_velocity"]) ** 2))
        ),
        "spring": lambda t: d["stiffness"] * (theta(t, 0) - d["rest"]),
        "offset": lambda t: d["offset"],
    }
    with mpmath.workdps(digits):
        return [float(mpmath.diff(laws[term], 0, k)) for k in range(order + 1)]


@pytest.mark.parametrize("term", DRIVE_TERMS)
def test_rates_of_every_term_are_exact(term):
    rng = np.random.default_rng(1)
    mechanism = random_mechanism(rng, [-1, 0, 1], ["revolute", "prismatic", "helical"], [1.0] * 3)
    drives = random_amounts(rng, 3)
    robot = robot_with_drives(mechanism, drives)
    q = rng.uniform(-1, 1, (7, 3))
    found = np.stack(robot.drive_forces(*q, terms=term))
    expected = np.stack([exact_term(term, drives, i, q[:, i], 4) for i in range(3)], axis=1)
    for k in range(5):
        assert relative_error(found[k], expected[k]) < 1e-13, k


@pytest.mark.parametrize("speed", [0.0, 0.1, 5.0, -10.0, 19.0, 25.0, 300.0], ids=lambda x: f"{x:g} eps")
@pytest.mark.parametrize("term", ["friction", "stribeck"])
def test_rates_of_saturated_friction_have_digits_of_their_own_size(term, speed):
    """However much smaller than friction they are: 1 - tanh^2 has 8 digits at 9 eps, and none from 19 eps on."""
    drives = {name: np.array([x]) for name, x in (("eps", 0.5), (term, 3.0), ("stribeck_velocity", 1e9))}
    robot = jounce.Robot.from_screws(**ONE, drives=drives).with_drives([term])
    q = np.random.default_rng(4).uniform(0.3, 1, (7, 1))
    q[1] = speed * 0.5
    found = np.ravel(robot.drive_forces(*q))
    np.testing.assert_allclose(found, exact_term(term, drives, 0, q[:, 0], 4, digits=600), rtol=1e-11, atol=0)


@settings(max_examples=6)
@given(mechanisms(4))
def test_every_path_adds_the_same_forces_of_drives(drawn):
    robot, rng = drawn_with_drives(drawn)
    q = rng.uniform(-1, 1, (5, 9, robot.n))
    rigid = robot.with_drives(False)
    added = robot.drive_forces(*q)
    for method in METHODS:
        with_them = robot.inverse_dynamics(*q, method=method)
        without = rigid.inverse_dynamics(*q, method=method)
        for x, y, z in zip(with_them, without, added, strict=True):
            assert relative_error(x, y + z) < 1e-13


@pytest.mark.parametrize("term", DRIVE_TERMS)
def test_switching_a_term_off_removes_exactly_that_term(term):
    rng = np.random.default_rng(2)
    base = jounce.load("iiwa14").mechanism
    robot = robot_with_drives(base, random_amounts(rng, 7))
    q = rng.uniform(-1, 1, (5, 7))
    everything, others = robot.inverse_dynamics(*q), robot.with_drives([t for t in DRIVE_TERMS if t != term])
    alone = robot.drive_forces(*q, terms=[term])
    for x, y, z in zip(everything, others.inverse_dynamics(*q), alone, strict=True):
        assert relative_error(x - y, z) < 1e-11


def test_drives_are_off_until_they_are_asked_for():
    rng = np.random.default_rng(3)
    base = jounce.load("iiwa14").mechanism
    robot, q = robot_with_drives(base, random_amounts(rng, 7), terms=False), rng.uniform(-1, 1, (5, 7))
    rigid = jounce.Robot.from_screws(base.B, base.X, base.M, gravity=base.gravity)
    for x, y in zip(robot.inverse_dynamics(*q), rigid.inverse_dynamics(*q), strict=True):
        np.testing.assert_array_equal(x, y)


@settings(max_examples=6)
@given(mechanisms(4, units=st.just(SI)))  # as drives are in
def test_the_armature_adds_to_the_mass_matrix_and_to_forces(drawn):
    robot, rng = drawn_with_drives(drawn, "armature")
    q, qd, a, b = rng.uniform(-1, 1, (4, robot.n))
    m = robot.mechanism
    rotors = m.G.T @ np.diag(m.drives.armature) @ m.G
    for method in METHODS:
        M, Md = robot.mass_matrix(q, qd, method=method)
        N, Nd = robot.with_drives(False).mass_matrix(q, qd, method=method)
        assert relative_error(M - N, rotors) < 1e-12
        np.testing.assert_array_equal(Md, Nd)
    difference = robot.inverse_dynamics(q, qd, a) - robot.inverse_dynamics(q, qd, b)
    assert relative_error(M @ (a - b), difference) < 1e-11


def test_a_robot_whose_code_is_a_loop_has_drives_too():
    rng = np.random.default_rng(4)
    kinds = ["revolute", "prismatic", "helical", "revolute"] * 4
    chain = random_mechanism(rng, [-1, 0, 0, *range(2, 15)], kinds, [1.0] * 16, mimic=True)
    robot = robot_with_drives(chain, random_amounts(rng, 16))
    q = rng.uniform(-1, 1, (5, 11, robot.n))
    results = zip(*(robot.inverse_dynamics(*q, method=method) for method in ("kernel", "recursion")), strict=True)
    for x, y in results:
        assert relative_error(x, y) < 1e-13


def test_rates_of_the_panda_with_drives_agree_with_differences():
    """Five-point differences of Q show Qd, and of Qd show Q2d, to what such differences can show."""
    base, rng = jounce.load(PANDA).mechanism, np.random.default_rng(5)
    drives = {"armature": rng.uniform(0.05, 0.5, 9), "damping": rng.uniform(1, 5, 9), "friction": rng.uniform(1, 4, 9)}
    robot = robot_with_drives(base, drives)
    t, h = np.linspace(0, 2, 41)[:, None], 1e-3
    phase, speed = rng.uniform(0, 6, robot.n), rng.uniform(0.4, 1.2, robot.n)

    def forces(t):
        rates = [0.4 * speed**k * np.sin(speed * t + phase + k * np.pi / 2) for k in range(5)]
        return robot.inverse_dynamics(*rates)

    before, after = [[forces(t + s * k * h) for k in (1, 2)] for s in (-1, 1)]
    here = forces(t)
    for k in (0, 1):
        first, second = after[0][k] - before[0][k], after[1][k] - before[1][k]
        assert relative_error((8 * first - second) / (12 * h), here[k + 1]) < 2e-8


def test_friction_at_rest_and_at_speed():
    robot = jounce.Robot.from_screws(**ONE, drives={"friction": [3.0]}).with_drives(eps=0.1)
    forces = [robot.drive_forces([0], [v], [0])[0] for v in (0.0, 0.1, 0.5, -40.0)]
    np.testing.assert_allclose(forces, [0, 3 * np.tanh(1), 3 * np.tanh(5), -3])
    assert jounce.Robot.from_screws(**ONE).drives.eps[0] == DEFAULT_SMOOTHING_VELOCITY
    assert not any(map(np.isnan, robot.drive_forces([0], [1e300], [0], [1.0], [1.0])))


@pytest.mark.parametrize("kind", ["jax", "sympy", "casadi", "long double"])
def test_drives_work_on_every_scalar_type(kind):
    rng = np.random.default_rng(6)
    robot = robot_with_drives(
        random_mechanism(rng, [-1, 0], ["revolute", "helical"], [1.0, 2.0]), random_amounts(rng, 2)
    )
    q = rng.uniform(-1, 1, (5, 2))
    expected = robot.inverse_dynamics(*q, method="recursion")
    if kind == "jax":
        found = robot.inverse_dynamics(*jnp.asarray(q))
        tolerance = 1e-5  # JAX calculates with single floats unless told otherwise
    elif kind == "long double":
        found, tolerance = robot.inverse_dynamics(*q.astype(np.longdouble)), 1e-14
    elif kind == "sympy":
        names = np.array(sympy.symbols("x:10"), dtype=object)
        values = dict(zip(names, q.ravel(), strict=True))
        found = [[float(x.subs(values)) for x in Q] for Q in robot.inverse_dynamics(*names.reshape(5, 2))]
        tolerance = 1e-13
    else:
        x = casadi.SX.sym("x", 10)
        names = np.array(casadi.vertsplit(x), dtype=object).reshape(5, 2)
        Q = robot.inverse_dynamics(*names)
        values = casadi.Function("Q", [x], [casadi.vertcat(*np.ravel(Q))])(q.ravel())
        found, tolerance = np.array(values).reshape(3, 2), 1e-13
    for x, y in zip(found, expected, strict=True):
        assert relative_error(x, y) < tolerance


def test_symbolic_form_has_the_drives_that_act():
    rng = np.random.default_rng(9)
    base = jounce.load("planar2r").mechanism
    robot, q = robot_with_drives(base, random_amounts(rng, 2)), rng.uniform(-1, 1, (5, 2))
    S = robot.symbolic()
    values = dict(zip([x for name in ("q", "qd", "q2d", "q3d", "q4d") for x in getattr(S, name)], q.flat, strict=True))
    for name, expected in zip(("Q", "Qd", "Q2d"), robot.inverse_dynamics(*q), strict=True):
        found = [float(x.subs(values)) for x in getattr(S, name)]
        assert relative_error(found, expected) < 1e-12, name
    M = [float(x.subs(values)) for x in S.M]
    assert relative_error(M, robot.mass_matrix(q[0]).ravel()) < 1e-12
    assert (S.dot(S.Q) - S.Qd).subs(values).norm() < 1e-12


@pytest.mark.parametrize("lang", ["c", "python"])
def test_generated_code_has_the_drives_that_act(tmp_path, lang):
    base = jounce.load("planar2r").mechanism
    robot = robot_with_drives(base, random_amounts(np.random.default_rng(10), 2))
    made = robot.codegen(lang, directory=tmp_path / lang, outputs=["inverse_dynamics", "mass_matrix"])
    require("make", *["cc"] * (lang == "c"))
    command = ["make", "-C", str(made.directory), "test", f"PYTHON={sys.executable}"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_urdf_states_damping_and_friction(tmp_path):
    turn = joint("turn", "base", "arm", inner="<dynamics damping='2.5' friction='0.5'/>")
    path = robot_file(tmp_path, *LINKS, turn)
    robot = jounce.load(path, drives=True)
    assert jounce.load(path).mechanism.acting == ()
    assert (robot.drives.damping[0], robot.drives.friction[0]) == (2.5, 0.5)
    assert robot.mechanism.acting == ALL_DRIVE_TERMS


@pytest.mark.parametrize("suffix", [".yaml", ".json"])
def test_a_robot_file_keeps_the_drives(tmp_path, suffix):
    rng = np.random.default_rng(8)
    robot = robot_with_drives(jounce.load("planar2r").mechanism, random_amounts(rng, 2), terms=False)
    jounce.save(robot, tmp_path / f"arm{suffix}")
    for name, array in vars(jounce.load(tmp_path / f"arm{suffix}").drives).items():
        np.testing.assert_array_equal(array, vars(robot.drives)[name])


def test_asking_for_drives_that_no_file_states_warns():
    with pytest.warns(jounce.JounceWarning, match="drives=True has no effect: the robot states no armature or damping"):
        jounce.load("planar2r", drives=True)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (
            {"terms": "friction"},
            "panda: drives='friction' has no effect: the robot states no friction; it states damping",
        ),
        ({"terms": ["armature", "spring"]}, "states no armature or spring"),
        ({"terms": "damping", "eps": 0.1}, "eps=0.1 has no effect: it is of friction, which is not selected"),
        ({"eps": 0.1}, "eps=0.1 has no effect: the robot states no friction"),
    ],
)
def test_drives_that_change_nothing_are_warned_of(options, words):
    with pytest.warns(jounce.JounceWarning, match=words):
        jounce.load("panda").with_drives(**options)


def test_drives_that_change_something_are_not():
    robot = jounce.load("panda")
    for terms in (True, False, "damping", ("armature", "damping")):
        robot.with_drives(terms)


def test_info_shows_what_is_stated_and_what_acts(tmp_path):
    turn = joint("turn", "base", "arm", inner="<dynamics damping='2.5' friction='0.5'/>")
    path = robot_file(tmp_path, *LINKS, turn)
    said = call("info", path).output
    assert "2.5 N m s/rad" in said
    assert "0.5 N m over 0.05 rad/s" in said
    assert "in Q: none of these" in said
    data = describe(jounce.load(path, drives="damping").mechanism).json()
    assert data["acting"] == ["damping"]
    assert data["bodies"][0]["drive"]["friction"] == 0.5


def test_a_rotor_moves_what_has_no_mass():
    robot = jounce.Robot.from_screws(**ONE | {"M": [np.zeros((6, 6))]}, drives={"armature": [0.1]})
    kinds = [{finding.kind for finding in arm.audit()} for arm in (robot, robot.with_drives())]
    assert ["singular mass matrix" in found for found in kinds] == [True, False]


def test_drives_are_copied_and_frozen():
    robot = jounce.Robot.from_screws(**ONE, drives={"damping": [1.0]})
    for same in (robot, copy.deepcopy(robot)):
        with pytest.raises(ValueError, match="read-only"):
            same.drives.damping[0] = 3.0


@pytest.mark.parametrize(("drives", "words"), [
    ({"armatur": [0]}, ["unknown drive 'armatur'; did you mean 'armature'"]),
    ({"damping": [0, 0]}, ["damping has shape (2,); expected numbers (1,)"]),
    ({"damping": [-1]}, ["joint 0", "damping is -1; expected 0 or more"]),
    ({"rest": [np.inf]}, ["rest is inf; expected a finite number"]),
    ({"stribeck_velocity": [0]}, ["stribeck_velocity is 0; expected a speed above 0"]),
    ({"load_friction": [1]}, ["load_friction is 1; expected a share of the load below 1"]),
    ({"load_eps": [0]}, ["load_eps is 0; expected a load above 0"]),
    ({"eps": [0]}, ["eps is 0; expected a smoothing velocity of friction above 0"]),
    ([1, 2], ["drives is of type list; expected a mapping of armature"]),
])  # fmt: skip
def test_refuses_wrong_drives(drives, words):
    refusal(lambda: jounce.Robot.from_screws(**ONE, drives=drives), *words)


@pytest.mark.parametrize("terms", ["frction", ["armature", 3], 5, None])
def test_refuses_unknown_terms(terms):
    with expect_refusal("unknown drive term", "armature, damping, friction, stribeck, spring, offset, load_friction"):
        jounce.load("iiwa14").with_drives(terms)


@pytest.mark.parametrize("eps", [0, -1.0, np.nan, np.inf, "fast", True])
def test_refuses_a_speed_that_is_none(eps):
    refusal(lambda: jounce.load("iiwa14").with_drives(eps=eps), "expected a smoothing velocity of friction above 0")


@pytest.mark.parametrize("stated", ["damping='-1'", "friction='nan'", "damping='much'"])
def test_refuses_wrong_dynamics_of_a_urdf_by_file_and_line(tmp_path, stated):
    path = robot_file(tmp_path, *LINKS, joint("turn", "base", "arm", inner=f"<dynamics {stated}/>"))
    refusal(lambda: jounce.load(path), f"{path}:4")


def test_stribeck_friction_is_refused_where_it_is_not_known():
    robot = jounce.Robot.from_screws(**ONE, drives={"stribeck": [1.0]}).with_drives().with_limits(velocity=1, effort=9)
    move = jounce.Motion.polynomial([[0, 0, 0, 1, -0.5]], 1.0)
    refusal(lambda: robot.retime(move), "retime does not support Stribeck friction", "'offset'])")
    refusal(lambda: robot.elastic(100.0, rotor=0.1), "motors of elastic joints have no stribeck")


@given(st.integers(0, 3))
def test_followers_push_on_their_leader_through_their_factor(k):
    """A joint that turns -2 times as far as its leader, with friction of its own alone."""
    G = [[1.0], [-2.0]]
    M = [np.eye(6)] * 2
    X = [[0, 0, 1, 0, 0, 0]] * 2
    robot = jounce.Robot.from_screws([np.eye(4)] * 2, X, M, G=G, drives={"friction": [0, 1.5], "eps": [1, 0.5]})
    rates = [np.array([0.3]), np.array([0.2]), np.array([0.1]), *[np.array([0.05])] * k]
    lone = jounce.Robot.from_screws(**ONE, drives={"friction": [1.5], "eps": [0.5]})
    found, own = robot.drive_forces(*rates), lone.drive_forces(*(-2 * x for x in rates))
    np.testing.assert_allclose(np.ravel(found), -2 * np.ravel(own), rtol=1e-14)
