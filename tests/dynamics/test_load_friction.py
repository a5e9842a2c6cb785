"""Friction that grows with the load: its law and rates, its inverse, and no quantity that leaves it out in silence."""

import subprocess
import sys
from dataclasses import replace

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
import sympy

import jounce
from jounce.dynamics.quantities import QUANTITIES
from jounce.dynamics.quantities.row import CLOSED, ELASTIC, ON_CONTACTS
from jounce.engine.hidden_vibrations import find_hidden_vibrations
from jounce.model.drive_trains import AMOUNTS, DRIVE_TERMS, LOAD_FRICTION
from support.refusals import refusal
from support.robots import floating, random_mechanism, relative_error
from support.tools import require

KINDS = ["revolute", "prismatic", "helical", "revolute"]


def load_rubbing(mechanism, seed=0, terms=True):
    """The robot with all drive terms: friction by the load at every joint but the first that has its own coordinate."""
    rng, nc = np.random.default_rng(seed), len(mechanism.joints)
    names = (*(AMOUNTS[term] for term in DRIVE_TERMS), "eps", "stribeck_velocity", "load_eps", "rest")
    drives = {name: rng.uniform(0.3, 1, nc) for name in names}
    drives["load_friction"] = rng.uniform(0.1, 0.3, nc) * mechanism.lone_joints * (np.arange(nc) > 0)
    robot = jounce.Robot(replace(mechanism, drives=replace(mechanism.drives, **drives)))
    return robot.with_drives(terms)


def without_load_friction(robot):
    return jounce.Robot(replace(robot.mechanism, acting=DRIVE_TERMS))


def tree(bodies=4):
    kinds = (KINDS * bodies)[:bodies]
    rng = np.random.default_rng(3)
    return random_mechanism(rng, [-1, 0, 0, *range(2, bodies - 1)], kinds, [1.0] * bodies, mimic=True)


def expected(robot, q, Q):
    """tau and its rates at one state by mpmath's Taylor series, from Q and its rates without the term."""
    m, order = robot.mechanism, len(Q) - 1
    c, eps, d = (m.G.T @ (x * m.lone_joints) for x in (m.drives.load_friction, m.drives.eps, m.drives.load_eps))

    def polynomial(rates):
        return lambda t: sum(mpmath.mpf(float(x)) * t**k / mpmath.factorial(k) for k, x in enumerate(rates))

    def torque(j):
        v, load = polynomial([rate[j] for rate in q[1:]]), polynomial([rate[m.nv - m.n + j] for rate in Q])
        a = lambda t: c[j] * mpmath.tanh(v(t) / eps[j]) if c[j] else 0  # noqa: E731
        tau = lambda t: load(t) + a(t) * mpmath.sqrt(load(t) ** 2 + d[j] ** 2)  # noqa: E731
        return [float(mpmath.diff(tau, 0, k)) for k in range(order + 1)]

    with mpmath.workdps(50):
        of_joints = np.array([torque(j) for j in range(m.n)]).T
    return [np.append(x[: m.nv - m.n], of_joint) for x, of_joint in zip(Q, of_joints, strict=True)]


@pytest.mark.parametrize(
    ("case", "method"),
    [("tree", "recursion"), ("floats", "recursion"), ("floats", "kernel"), ("chain in a loop of code", "kernel")],
)
def test_forces_and_their_rates_follow_the_law(case, method):
    rng = np.random.default_rng(1)
    m = {"tree": tree, "chain in a loop of code": lambda: tree(16), "floats": lambda: floating(tree(), rng)}[case]()
    if case == "tree":
        assert m.lone_joints.tolist().count(False) == 2, "one joint follows another"
    robot = load_rubbing(m)
    q = rng.uniform(-1, 1, (5, robot.n))
    base = {"base": (np.eye(4), *rng.uniform(-1, 1, (4, 6)))} if m.floats else {}
    W = tuple(rng.uniform(-1, 1, (3, len(robot.body_names), 6)))
    Q = without_load_friction(robot).inverse_dynamics(*q, wrench=W, **base, method="recursion")
    found = robot.inverse_dynamics(*q, wrench=W, **base, method=method)
    for x, y in zip(found, expected(robot, q, Q), strict=True):
        assert relative_error(x, y) < 1e-12
    lost = (found[0] - Q[0])[m.nv - m.n :] * q[1]
    assert (lost > -1e-12).all(), "friction takes power"
    assert np.count_nonzero(lost > 1e-9) == np.count_nonzero(robot.drives.load_friction)


def test_accelerations_of_a_large_robot_come_back():
    robot, rng = load_rubbing(tree(16)), np.random.default_rng(2)
    q = rng.uniform(-1, 1, (5, 3, robot.n))
    for x, y in zip(robot.forward_dynamics(*q[:2], *robot.inverse_dynamics(*q)), q[2:], strict=True):
        assert relative_error(x, y) < 1e-10


def test_lifting_takes_more_and_lowering_less():
    """At speed, lifting takes 1 + c of the load, and lowering 1 - c."""
    drives = {"load_friction": [0.2], "load_eps": [1e-6]}
    data = {"B": [np.eye(4)], "X": [[0, 0, 0, 0, 0, 1]], "M": [np.diag([1, 1, 1, 2, 2, 2])], "drives": drives}
    lift = jounce.Robot.from_screws(**data, gravity=[0, 0, -10]).with_drives()
    forces = [lift.inverse_dynamics([0], [v], [0])[0] for v in (1.0, -1.0, 0.0)]
    np.testing.assert_allclose(forces, [24, 16, 20])


@pytest.mark.parametrize("kind", ["single floats of JAX", "SymPy", "long doubles"])
@pytest.mark.parametrize("name", ["inverse_dynamics", "forward_dynamics"])
def test_other_scalars(name, kind):
    robot = load_rubbing(random_mechanism(np.random.default_rng(6), [-1, 0], ["revolute"] * 2, [1.0, 2.0]))
    q = np.random.default_rng(7).uniform(-1, 1, (5, 2))
    compute = getattr(robot, name)
    exact, tolerance = compute(*q, method="recursion"), 1e-12
    if kind == "single floats of JAX":
        found, tolerance = compute(*jnp.asarray(q)), 1e-4
    elif kind == "long doubles":
        found = compute(*q.astype(np.longdouble))
    else:
        names = np.array(sympy.symbols("x:10"), dtype=object)
        at = dict(zip(names, q.ravel(), strict=True))
        found = [[float(x.subs(at)) for x in compute(*names.reshape(5, 2)[:3])]]
    for x, y in zip(found, exact, strict=False):
        assert relative_error(x, y) < tolerance


@pytest.mark.parametrize("lang", ["c", "python"])
def test_generated_code(tmp_path, lang):
    robot = load_rubbing(jounce.load("planar2r").mechanism)
    made = robot.codegen(lang, directory=tmp_path / lang, outputs=["inverse_dynamics", "forward_dynamics"])
    words = " ".join(path.read_text() for path in made.directory.glob("*.[hp]*")).replace("*", "").replace("#", "")
    assert "friction by the load (a (Q^2 + d^2)^1/2, a = c tanh(thetad / eps))" in " ".join(words.split())
    require("make", *["cc"] * (lang == "c"))
    command = ["make", "-C", str(made.directory), "test", f"PYTHON={sys.executable}"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("name", ["inverse_dynamics", "forward_dynamics"])
def test_products_of_kernels_are_derivatives(name):
    robot, rng = load_rubbing(jounce.load("planar2r").mechanism), np.random.default_rng(3)
    kernel = robot.compile(name, order=1)
    x, d = rng.uniform(-1, 1, (2, 4, 2))
    w, h = rng.uniform(-1, 1, (2, 2)), 1e-6

    def difference(f):
        return (np.concatenate(np.atleast_2d(f(x + h * d))) - np.concatenate(np.atleast_2d(f(x - h * d)))) / (2 * h)

    along = np.concatenate(kernel.jvp(tuple(x), tuple(d)))
    np.testing.assert_allclose(along, difference(lambda x: kernel(*x)), rtol=1e-6, atol=1e-6 * np.abs(along).max())
    gradients = kernel.vjp(tuple(x), tuple(w))
    assert np.sum(np.array(gradients) * d) == pytest.approx(along @ w.ravel(), rel=1e-12)
    bent = np.concatenate(kernel.hvp(tuple(x), tuple(w), tuple(d)))
    slopes = difference(lambda x: kernel.vjp(tuple(x), tuple(w)))
    np.testing.assert_allclose(bent, slopes, rtol=1e-5, atol=1e-6 * np.abs(bent).max())
    through_jax = jax.grad(lambda q: (getattr(robot, name)(q, *x[1:])[1] * w[1]).sum())(jnp.asarray(x[0]))
    zero = kernel.vjp(tuple(x), (0 * w[0], w[1]))[0]
    np.testing.assert_allclose(through_jax, zero, rtol=1e-4, atol=1e-4 * np.abs(zero).max())


def robot_with(row):
    """A robot with drives that has a quantity: with closed loops, elastic joints, contacts, or none of these."""
    if CLOSED in row.needs:
        passive = {"actuated": ["left_shoulder"], "passive": ["right_shoulder"]} if "passive" in row.gives.shape else {}
        return jounce.load("fivebar").closed(**passive)
    if ON_CONTACTS in row.needs:
        dog = jounce.load("solo12", base="floating")
        return dog.contacts([jounce.Contact(f"{leg}_FOOT", "point") for leg in ("FL", "FR", "HL", "HR")])
    arm = jounce.load("planar2r")
    motor = jounce.Motor(constant=0.1, gear=100, resistance=1)
    return arm.elastic([800, 600], rotor=0.1, motors=motor) if ELASTIC in row.needs else arm


@pytest.mark.sweep(10)
@pytest.mark.filterwarnings("ignore:.*nothing but inertia moves")
@pytest.mark.parametrize("name", QUANTITIES)
def test_no_quantity_leaves_it_out_in_silence(name):
    """Each changes, refuses, or has no friction of any kind."""
    row, rng = QUANTITIES[name], np.random.default_rng(5)
    plain = robot_with(row).mechanism
    nc = len(plain.joints)
    drives = replace(plain.drives, friction=np.full(nc, 0.3), load_friction=np.full(nc, 0.2), eps=np.ones(nc))
    bare, robot, smooth = (
        jounce.Robot(replace(plain, drives=drives, acting=acting))
        for acting in (("friction",), ("friction", LOAD_FRICTION), ())
    )

    def compute(robot):
        count = 5 if ELASTIC in row.needs and not row.takes.motors else row.takes.rates
        q = rng.uniform(-0.3, 0.3, (count, robot.n))
        q[0] = {"fivebar": [2.2, 0.9]}.get(robot.name, q[0])
        given = [*q]
        options = {"base": (np.eye(4), *rng.uniform(-1, 1, (2, 6)))} if robot.mechanism.floats else {}
        return [np.asarray(x) for x in np.atleast_1d(getattr(robot, name)(*given, **options))]

    def same(a, b):
        return all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))

    results = []
    for one in (smooth, bare, robot):
        rng = np.random.default_rng(5)
        try:
            results.append(compute(one))
        except jounce.JounceError:
            assert one is robot
            cure = "with_drives(['armature', 'damping', 'friction', 'stribeck', 'spring', 'offset'])"
            refusal(lambda: compute(robot), f"does not hold {LOAD_FRICTION}", cure)
            return
    if same(results[0], results[1]):
        assert same(results[1], results[2]), "no friction enters"
    else:
        assert name in ("inverse_dynamics", "forward_dynamics")
        assert not same(results[1], results[2])


def test_contacts_bear_the_loads_that_friction_takes():
    """Contact forces stay as they are, and torques of the joints follow the law from those with contacts."""
    m = robot_with(QUANTITIES["contact_wrenches"]).mechanism
    drives = replace(m.drives, load_friction=np.full(12, 0.1), eps=np.ones(12))
    robot = jounce.Robot(replace(m, drives=drives, acting=(LOAD_FRICTION,)))
    rng = np.random.default_rng(4)
    q, base = rng.uniform(-0.3, 0.3, (3, 12)), {"base": (np.eye(4), *rng.uniform(-0.1, 0.1, (2, 6)))}
    Q = without_load_friction(robot).inverse_dynamics(*q, **base)
    tau = robot.inverse_dynamics(*q, **base)
    np.testing.assert_allclose(tau[:6], 0, atol=1e-9)
    np.testing.assert_allclose(tau[6:], Q[6:] + 0.1 * np.tanh(q[1]) * np.hypot(Q[6:], 0.1), rtol=1e-10, atol=1e-9)


def test_joints_that_share_their_force_refuse():
    m = tree()
    robot = jounce.Robot(replace(m, drives=replace(m.drives, load_friction=np.full(4, 0.1)))).with_drives()
    state = np.zeros((3, robot.n))
    refusal(lambda: robot.inverse_dynamics(*state), "does not hold load_friction", "without followers and loops")
    bar = jounce.load("fivebar").mechanism
    drives = replace(bar.drives, load_friction=np.full(len(bar.joints), 0.1))
    closed = jounce.Robot(replace(bar, drives=drives)).with_drives()
    for name in ("inverse_dynamics", "forward_dynamics", "actuator_forces"):
        refusal(lambda name=name: getattr(closed, name)([2.2, 0.9], [0, 0], [0, 0]), "does not hold load_friction")
    refusal(lambda: closed.compile("inverse_dynamics"), "does not hold load_friction")


def test_what_cannot_hold_it_refuses():
    robot = load_rubbing(jounce.load("planar2r").mechanism).with_limits(velocity=1, effort=100)
    move = jounce.Motion.polynomial([[0, 0, 0, 1, -0.5]] * 2, 1.0)
    log = robot.forces_along(move, order=0).forces[0]
    live = robot.live(1e-3, lag=0, bandwidth=10, noise=1e-5)
    live.update([0.1, 0.2])
    state = np.zeros((3, 2))
    for call in (
        lambda: robot.retime(move),
        lambda: robot.elastic(100.0, rotor=0.1),
        robot.symbolic,
        lambda: robot.drive_forces(*state),
        lambda: robot.regressor(*state, drives=LOAD_FRICTION),
        lambda: robot.excite(drives=LOAD_FRICTION),
        lambda: robot.identify(move, log, drives=LOAD_FRICTION),
        lambda: robot.identify(move, log, drives=("damping", "friction")),
        lambda: robot.payload(replace(move, torques=(move.times, log)), drives=("damping", "friction")),
        live.forces,
    ):
        refusal(call, LOAD_FRICTION)


def test_motions_are_checked_with_it():
    """The largest torque of a dense series is that of the check, and the slowed motion just keeps the limit."""
    robot = load_rubbing(jounce.load("planar2r").mechanism, terms=LOAD_FRICTION)
    move = jounce.Motion.fourier([0.3, -0.2], [[0.5, 0.2], [0.1, 0.4]], [[0.1, 0.3], [0.5, 0.2]], 3.0, 4.0)
    dense = np.linspace(0, 4, 100_001)
    along = robot.forces_along(move, dense)
    rates = move(dense, 4)
    for x, y in zip(along.forces, robot.inverse_dynamics(*rates), strict=True):
        np.testing.assert_allclose(x, y, rtol=1e-12, atol=1e-12)
    most = [np.abs(x).max(axis=0) for x in along.forces]
    limited = robot.with_limits(effort=most[0], effort_rate=most[1], second_effort_rate=most[2])
    worst = limited.check(move).worst
    there = [x[0] / y for x, y in zip(robot.forces_along(move, [worst.t]).forces, most, strict=True)]
    assert worst.ratio == pytest.approx(np.abs(there).max(), rel=1e-5)
    assert 1 - 1e-5 < worst.ratio < 1 + 1e-4, "of a series that may miss the top of a peak"
    held = robot.with_limits(effort_rate=0.98 * most[1])
    slow = held.slowdown(move)
    assert slow.factor < 1
    assert held.check(slow.motion).worst.ratio == pytest.approx(1, abs=1e-6)


def test_hidden_vibrations_are_those_of_the_motion():
    """Their effect on forces takes partial derivatives, which do not hold it; that on rates of q does not."""
    robot, t = load_rubbing(jounce.load("planar2r").mechanism), np.linspace(0, 2, 401)
    q = np.sin(np.outer(t, [3, 4])) + 1e-4 * np.random.default_rng(1).normal(size=(401, 2))
    read = jounce.Motion.fit(t, q)
    found = find_hidden_vibrations(robot, read, 2)
    assert found == find_hidden_vibrations(robot, read, 4, "q") != ()


def test_files_keep_it(tmp_path):
    robot = load_rubbing(jounce.load("planar2r").mechanism)
    for suffix in (".yaml", ".json"):
        jounce.save(robot, tmp_path / f"arm{suffix}")
        again = jounce.load(tmp_path / f"arm{suffix}", drives=True)
        np.testing.assert_array_equal(again.drives.load_friction, robot.drives.load_friction)
        np.testing.assert_array_equal(again.drives.load_eps, robot.drives.load_eps)
        q = np.random.default_rng(1).uniform(-1, 1, (3, 2))
        np.testing.assert_array_equal(again.inverse_dynamics(*q), robot.inverse_dynamics(*q))
