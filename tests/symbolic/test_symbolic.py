"""The quantities as SymPy expressions: those of the paper, those of the numeric methods, and what they look like."""

import re
import time
from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np
import pytest
import sympy
from sympy import cos, sin

import jounce
from jounce._codegen.trig_polynomial import Variables
from jounce.core.scalars import check_recording
from jounce.dynamics.quantities.row import ELASTIC
from jounce.model.drive_trains import AMOUNTS, DRIVE_TERMS
from jounce.spatial.lie import pose
from jounce.spatial.series import rate_name
from support.expressions import entries, evaluated
from support.planar2r import L1, L2, PARAMETERS, g, m1, m2, printed, symbolic_planar2r
from support.quantities import QUANTITIES, affordable, rate_of, tupled
from support.refusals import expect_refusal, refusal
from support.robots import on_base, random_pose, relative_error
from support.several_named import named_robot, states

UP, DOWN = [[1, 0, 0], [0, 0, -1], [0, 1, 0]], [[1, 0, 0], [0, 0, 1], [0, -1, 0]]


def symbolic_chain(turns, gravity):
    """Links along x, each with a mass, a centre of mass on its axis and three moments of inertia, all symbols."""
    B, M = [], []
    for i, R in enumerate(turns, start=1):
        r = [[sympy.Symbol(f"L{i - 1}")], [0], [0]] if i > 1 else [[0]] * 3
        B.append(pose(np.array(R, dtype=object), np.array(r, dtype=object)))
        mass, com, *moments = sympy.symbols(f"m{i} c{i} A{i} B{i} C{i}")
        M.append(jounce.inertia_matrix(mass, [com, 0, 0], np.diag(moments)))
    X = [[0, 0, 1, 0, 0, 0]] * len(turns)
    return jounce.Robot.from_screws(np.stack(B), X, np.stack(M), gravity=g * np.array(gravity, dtype=object))


I3 = np.eye(3, dtype=int)
CHAINS = {
    "planar3r": lambda: symbolic_chain([I3] * 3, [0, -1, 0]),
    "spatial3r": lambda: symbolic_chain([I3, UP, I3], [0, 0, -1]),
    "wrist3r": lambda: symbolic_chain([I3, UP, DOWN], [0, 0, -1]),
}


def symbolic_members(S, highest=2, bodies=(), partials=0):
    """(quantity, member with its rates, the same of a robot of numbers, a function of q and W) of all that S holds."""
    there = [row for row in QUANTITIES.values() if row.everywhere or (ELASTIC in row.needs and "theta" in dir(S))]
    own = [row for row in there if not row.takes.forces and not (row.everywhere and row.gives.results)]
    for quantity in own:
        order = affordable(quantity, highest, partials)
        if not quantity.of_bodies:
            yield quantity, [getattr(S, name) for name in quantity.names(order)], partial(value, quantity, order)
        for body in bodies if quantity.of_bodies else ():
            for frame in quantity.gives.frames or ("body",):
                named = {"body": body, "frame": frame} if quantity.gives.frames else {"body": body}
                terms = getattr(S, quantity.name)(order=order, **named)
                yield quantity, terms, partial(value, quantity, order, **named)
        if quantity.takes.wrenches and ELASTIC not in quantity.needs:
            terms = [getattr(S, rate_name(f"{quantity.gives.symbol}ext", k)) for k in range(order + 1)]
            yield quantity, terms, partial(external, quantity, order)


def value(quantity, order, robot, q, W, **keywords):
    return tupled(getattr(robot, quantity.name)(*q[: quantity.takes.rates + order], method="closed_form", **keywords))


def external(quantity, order, robot, q, W):
    loaded, free = (value(quantity, order, robot, q, W, wrench=w) for w in (tuple(W[: order + 1]), None))
    return [x - y for x, y in zip(loaded, free, strict=True)]


def assert_equal_values(S, robot, values=(), parameters=(), order=2, bodies=()):
    """Every member of S, with its rates, has the values of a robot of numbers."""
    rng = np.random.default_rng(0)
    q, W = rng.uniform(-2, 2, (order + 3, robot.n)), rng.uniform(-2, 2, (order + 1, robot.mechanism.nb, 6))
    given = [*zip([*S.q, *S.qd, *S.q2d, *S.q3d, *S.q4d], q.ravel(), strict=False)]
    given += [*zip([*S.W, *S.Wd, *S.W2d], W.ravel(), strict=False), *zip(parameters, values, strict=True)]
    known = {symbol: float(number) for symbol, number in given}
    for quantity, terms, numbers in symbolic_members(S, order, bodies):
        found = [[evaluated(x, known) for x in entries(term)] for term in terms]
        expected = numbers(robot, q, W)
        scale = max(1e-3, *(np.abs(reference).max() for reference in expected))  # some are zero but for rounding
        for x, reference in zip(found, expected, strict=True):
            assert np.abs(np.reshape(x, np.shape(reference)) - reference).max() <= 1e-12 * scale, quantity.name


def test_the_planar_2r_is_the_papers():
    """Identical to the six printed expressions, and with as many terms as they have."""
    start = time.perf_counter()
    S = symbolic_planar2r().symbolic()
    state = [list(x) for x in (S.q, S.qd, S.q2d, S.q3d, S.q4d)]
    on_paper = printed_symbolically(*PARAMETERS, *state)
    for matrix, taus, terms in zip((S.Q, S.Qd, S.Q2d), on_paper, ((11, 5), (15, 8), (25, 16)), strict=True):
        for entry, tau, count in zip(matrix, taus, terms, strict=True):
            assert sympy.simplify(entry - tau) == 0
            assert sympy.expand(entry) == sympy.expand(tau)
            assert len(sympy.expand(entry).args) == count
    assert time.perf_counter() - start < 20


def printed_symbolically(*arguments):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(np, "cos", cos)
        patch.setattr(np, "sin", sin)
        return printed(*arguments)


def test_what_is_shared_stands_in_front_as_the_paper_prints_it():
    S = symbolic_planar2r().symbolic()
    q1, q2 = S.q
    v1, v2 = S.qd
    a1, a2 = S.q2d
    assert str(S.Q[1]) == str(L2 * m2 * (L1 * a1 * cos(q2) + L1 * v1**2 * sin(q2) + L2 * (a1 + a2) + g * cos(q1 + q2)))
    assert S.Qd[1].func == sympy.Mul
    assert {L2, m2} < set(S.Qd[1].args)
    assert str(S.Md) == str(sympy.Matrix([[2, 1], [1, 0]]) * -L1 * L2 * m2 * v2 * sin(q2))
    assert str(S.Qgrav[0]) == str(g * (L1 * (m1 + m2) * cos(q1) + L2 * m2 * cos(q1 + q2)))


def test_symbols_print_as_the_paper_writes_them():
    S = symbolic_planar2r().symbolic()
    latex = [sympy.latex(x[0]) for x in (S.q, S.qd, S.q2d, S.q3d, S.q4d)]
    assert latex == [r"q_{1}", r"\dot{q}_{1}", r"\ddot{q}_{1}", r"\dddot{q}_{1}", r"\ddddot{q}_{1}"]
    assert S.q == sympy.Matrix(sympy.symbols("q1 q2"))
    assert S.W.shape == (2, 6)
    assert [sympy.latex(x) for x in S.W2d[1, :]][::5] == [r"\ddot{m}_{x2}", r"\ddot{f}_{z2}"]
    assert sympy.latex(S.series["q"][5][1]) == r"q^{(5)}_{2}"
    assert r"\cos{\left(q_{1} + q_{2} \right)}" in sympy.latex(S.Q)


@pytest.mark.parametrize(("name", "order"), [("planar3r", 1), ("spatial3r", 2), ("wrist3r", 0)])
def test_chains_of_three_joints_have_the_values_of_numbers(name, order):
    robot = CHAINS[name]()
    S = robot.symbolic()
    mechanism = robot.mechanism
    data = [x for label in ("B", "M", "gravity") for x in sympy.Matrix(getattr(mechanism, label).ravel())]
    parameters = sorted(set().union(*(x.free_symbols for x in data)), key=str)
    assert set().union(*(x.free_symbols for x in S.Q)) <= {*parameters, *S.q, *S.qd, *S.q2d}
    values = np.random.default_rng(1).uniform(0.5, 2, len(parameters))
    number = np.vectorize(lambda x: float(sympy.sympify(x).subs(dict(zip(parameters, values, strict=True)))))
    B, X, M, gravity = (number(getattr(mechanism, label)) for label in ("B", "X", "M", "gravity"))
    assert_equal_values(S, jounce.Robot.from_screws(B, X, M, gravity=gravity), values, parameters, order)


def test_the_planar_2r_with_drives_has_the_values_of_numbers():
    """Armature enters Q, M and p, springs Q and U, and friction Q, though it is no trigonometric polynomial."""
    values = {"L1": 1.1, "L2": 0.7, "m1": 0.9, "m2": 1.3, "g": 9.81}
    drives = {name: [0.3, 0.7] for name in (*(AMOUNTS[term] for term in DRIVE_TERMS), "rest")}

    def driven(**data):
        m = jounce.load("planar2r", **data).mechanism
        return jounce.Robot.from_screws(m.B, m.X, m.M, gravity=m.gravity, drives=drives).with_drives(eps=0.5)

    S = driven(L1=L1, L2=L2, m1=m1, m2=m2, g=g).symbolic()
    assert_equal_values(S, driven(**values), list(values.values()), PARAMETERS, bodies=("body1", "body2"))


def test_friction_of_links_moves_the_motors_behind_springs():
    m = jounce.load("planar2r").mechanism
    drives = {"friction": [2.0, 1.5], "stribeck": [1.0, 0.5], "eps": [0.5, 0.8], "stribeck_velocity": [0.3, 0.2]}
    driven = jounce.Robot.from_screws(m.B, m.X, m.M, gravity=m.gravity, drives=drives).with_drives()
    soft = jounce.load("planar2r").elastic(1024, rotor=3).elasticity
    S = jounce.Robot(replace(driven.mechanism, elasticity=soft)).symbolic()
    assert S.Q.has(sympy.tanh)
    for k, theta in enumerate((S.theta, S.thetad)):
        q, Q = (S.series[name][k] for name in ("q", "Q"))
        assert (theta - q - Q / 1024).applyfunc(lambda x: sympy.expand(x).evalf(chop=True)).is_zero_matrix
    assert (S.tau - S.Q - 3 * S.theta2d).applyfunc(lambda x: sympy.expand(x).evalf(chop=True)).is_zero_matrix


def test_joints_that_follow_others_with_offset():
    m = jounce.load("planar2r", L1=1.1, m2=0.3).mechanism
    robot = jounce.Robot.from_screws(m.B, m.X, m.M, gravity=m.gravity, G=[[1.0], [-0.5]], g=[0.25, 0.3])
    S = robot.symbolic()
    assert S.q.shape == (1, 1)
    assert cos(S.q[0] / 2 + sympy.Float(0.55)) in S.Qgrav[0].atoms(cos)


def test_numbers_are_read_as_the_decimals_they_print_as():
    S = jounce.load("planar2r", L1=0.1).symbolic()
    assert S.Qgrav[1] == sympy.Float(9.81) * cos(sum(S.q))
    assert S.M[0, 1] == sympy.Float(0.1) * cos(S.q[1]) + 1
    exact = jounce.load("planar2r", g=sympy.Rational(981, 100)).symbolic()
    assert not (exact.Q2d.atoms(sympy.Float) | exact.M.atoms(sympy.Float))
    assert exact.Qgrav[1] == sympy.Rational(981, 100) * cos(sum(exact.q))


@pytest.mark.parametrize("exponent", [-40_000, -3, 3, 99, 100, 40_000])
def test_powers_keep_their_exponents(exponent):
    m = sympy.Symbol("m")
    assert jounce.load("planar2r", m1=m**exponent).symbolic().M.diff(m)[0, 0] == sympy.diff(m**exponent, m)


def test_angles_in_the_data_are_waves_too():
    """A symbolic twist of a joint's frame, as in Denavit-Hartenberg tables: cos^2 + sin^2 is 1."""
    a = sympy.Symbol("alpha")
    R = np.array([[1, 0, 0], [0, cos(a), -sin(a)], [0, sin(a), cos(a)]], dtype=object)
    B = [np.eye(4, dtype=int), pose(R, np.array([[1], [0], [0]]))]
    M = jounce.inertia_matrix(1, [1, 0, 0], np.zeros((3, 3), dtype=int))
    S = jounce.Robot.from_screws(np.stack(B), [[0, 0, 1, 0, 0, 0]] * 2, [M, M]).symbolic()
    assert S.M[1, 1] == 1
    assert S.M.subs({a: 0, S.q[1]: 0}) == sympy.Matrix([[5, 2], [2, 1]])
    assert sin(a).args[0] in S.Qgrav[1].free_symbols


def test_a_joint_direction_may_be_a_symbol():
    h = sympy.Symbol("h")
    M = [jounce.inertia_matrix(2.0, [0.1, 0.2, 0.3], np.eye(3) * 0.1)]
    turned = jounce.Robot.from_screws([np.eye(4)], [[cos(h), sin(h), 0, 0, 0, 0]], M)
    number = jounce.Robot.from_screws([np.eye(4)], [[np.cos(0.3), np.sin(0.3), 0, 0, 0, 0]], M)
    assert_equal_values(turned.symbolic(), number, [0.3], [h])


def test_each_rate_is_the_derivative_of_the_one_below():
    S = symbolic_planar2r().symbolic()
    for quantity, terms, _ in symbolic_members(S, 2, ("body2",), partials=1):
        for below, above in pairwise(terms):
            found = rate_of(quantity, np.array(below), np.array(above))
            assert all(sympy.expand(x - y) == 0 for x, y in zip(entries(S.dot(below)), found.flat, strict=True)), (
                quantity
            )


def test_identities_of_the_matrices():
    S = CHAINS["spatial3r"]().symbolic()
    assert S.M == S.M.T
    assert (S.M * S.q2d + S.C * S.qd + S.Qgrav - S.Q).expand(trig=False).applyfunc(vanishing).is_zero_matrix
    skew = S.Md - 2 * S.Cbar
    assert (skew + skew.T).expand().is_zero_matrix
    assert (S.Qext - S.Qext.subs(dict.fromkeys(S.W, 0))).expand() == S.Qext.expand()


def vanishing(x):
    return x if sympy.expand(x) != 0 else sympy.S.Zero


def test_matrices_are_kept_and_frozen():
    S = symbolic_planar2r().symbolic()
    assert S.Q2d is S.Q2d
    assert isinstance(S.Q, sympy.ImmutableMatrix)
    assert {"q4d", "Q2d", "Cbar2d", "W2d", "dot"} <= set(dir(S))
    found = [row for row in QUANTITIES.values() if row.everywhere and not row.of_bodies]
    rigid = [row for row in found if not (row.takes.forces or row.gives.results)]
    members = [row.gives.symbol for row in rigid]
    members += [f"{row.gives.symbol}ext" for row in rigid if row.takes.wrenches]
    of_bodies = [row.name for row in QUANTITIES.values() if row.of_bodies]
    everything = ", ".join(["q", "W", *members])
    assert repr(S) == f"<Symbolic 'planar2r': {everything}, and their rates; of bodies: {', '.join(of_bodies)}>"
    assert {*members, *of_bodies} <= set(dir(S))
    with pytest.raises(
        AttributeError, match=f"Symbolic has no member 'Mdot'; did you mean .* available: {everything}, "
    ):
        _ = S.Mdot
    with pytest.raises(AttributeError):
        S.Q = 0


def test_what_is_too_large_says_so_and_names_the_way_out(monkeypatch):
    monkeypatch.setattr(
        "jounce._codegen.symbolic.MAX_SYMBOLIC_OPERATIONS", 200_000
    )  # a page of the documentation waits for all of it
    S = jounce.load("iiwa14").symbolic()
    assert len(S.Qgrav) == 7
    refusal(lambda: S.Q2d, "^Q of 'iiwa14': too large for symbolic form: …robot.codegen")


def test_array_products_beyond_the_limit_finish_then_name_it():
    """NumPy's products of object arrays with batch axes, in which an operator raises, end in segmentation faults."""
    variables = Variables(1000)
    A = np.full((3, 4, 4), variables.variable("x") + variables.variable("y"))
    check_recording(A)
    A = A @ A
    refusal(lambda: check_recording(A), "^too large for symbolic form: … more than 1,000 operations on terms;")
    assert not any(x.terms for x in (A @ A).flat)


def test_an_order_too_high_says_so(monkeypatch):
    monkeypatch.setattr("jounce._codegen.symbolic.MAX_SYMBOLIC_OPERATIONS", 20_000)
    S = symbolic_planar2r().symbolic()
    assert S.Q2d.shape == (2, 1)
    refusal(lambda: S.Q30d, re.compile(r"^Q[4-9]d of 'planar2r': too large .* more than 20,000 operations on terms;"))
    assert S.Q3d.shape == (2, 1)


def with_data(**data):
    m = jounce.load("planar2r").mechanism
    given = {"B": m.B, "X": m.X, "M": m.M, "gravity": m.gravity} | data
    return jounce.Robot.from_screws(**given)


@pytest.mark.parametrize(("build", "message"), [
    (lambda: with_data(gravity=[0, sympy.nan, 0]), "^gravity[1] of 'robot': it is nan; expected a real expression$"),
    (lambda: with_data(gravity=[0, sympy.I * g, 0]), "^gravity[1] … expected a real expression$"),
    (lambda: jounce.load("planar2r", g=sympy.Symbol("q1", positive=True)),
     "^the robot contains the symbol q1, which is"),
    (lambda: jounce.load("planar2r", g=sympy.Symbol("m_x2")),
     r"symbol m_x2, which is the name of a coordinate, wrench or"),
    (lambda: casadi_robot(), "^gravity[1] … it is of type SX; expected a number or a SymPy expression$"),
])  # fmt: skip
def test_refusals(build, message):
    refusal(lambda: build().symbolic(), message)


def casadi_robot():
    import casadi

    return with_data(gravity=np.array([0, casadi.SX.sym("g"), 0], dtype=object))


def test_numeric_paths_refuse_symbols_in_one_line(tmp_path):
    robot, state = symbolic_planar2r(), np.zeros((5, 2))
    attempts = [
        lambda: robot.compile(),
        lambda: robot.inverse_dynamics(*state, method="kernel"),
        lambda: jounce.save(robot, tmp_path / "arm.yaml"),
        lambda: robot.casadi_function(),
    ]
    for attempt in attempts:
        refusal(attempt, re.compile(r"symbols?\b"))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("afloat", [True, False])
def test_the_base_moves_as_its_symbols_say(afloat):
    """Q with its part of wrenches at a state, and its rate from the rates of the symbols, those of the pose too."""
    m, rng = jounce.load("planar2r").mechanism, np.random.default_rng(3)
    M = jounce.inertia_matrix(2.0, [0.0, 0.1, 0.2], np.diag([0.3, 0.4, 0.5]))
    robot = jounce.Robot(on_base(m, M) if afloat else m)
    S = robot.symbolic(moving_base=True)
    q, W = rng.uniform(-1, 1, (3, robot.n)), rng.uniform(-1, 1, (len(robot.body_names), 6))
    base = (random_pose(rng), *rng.uniform(-1, 1, (2, 6)))
    known = dict(zip([*S.base_pose[:3, :]], base[0][:3].ravel(), strict=True))
    for name, arrays in (("q", q), ("W", [W]), ("base_twist", base[1:])):
        for k, x in enumerate(arrays):
            known |= dict(zip(S.series[name][k], x.ravel(), strict=True))
    expected = robot.inverse_dynamics(*q, base=base, wrench=W)
    found = sympy.lambdify(list(known), S.Q + S.Qext)(*known.values())[:, 0]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * abs(expected).max())
    gap = S.dot(S.Qgrav) - S.Qgravd
    assert abs(sympy.lambdify(list(known), gap)(*known.values())).max() < 1e-12


def test_a_fixed_robot_has_no_symbols_of_a_base():
    S = symbolic_planar2r().symbolic()
    with pytest.raises(AttributeError, match=r"^Symbolic has no member 'base_pose'"):
        _ = S.base_pose
    with expect_refusal("R_11, which is the name of a coordinate, wrench or base motion"):
        jounce.load("planar2r", L1=sympy.Symbol("R_11")).symbolic(moving_base=True)


@pytest.mark.parametrize("kinds", [{"foot": "ball"}, {"cart": "planar"}, {"box": "free"}])
def test_joints_of_several_screws_have_the_values_of_numbers(kinds):
    robot = named_robot(kinds, [-1], tilted=False)
    given, S = states(robot, 4), robot.symbolic()
    symbols = [S.q, S.qd, S.q2d, S.q3d]
    assert [len(x) for x in symbols] == [robot.nq, robot.n, robot.n, robot.n]
    Q, Qd = robot.inverse_dynamics(*given)
    for x, expected in ((S.Q, Q), (S.Qd, Qd), (S.dot(S.U), robot.potential_energy(*given[:2])[1])):
        found = sympy.lambdify(symbols, x, cse=True)(*(y[:, None] for y in given))
        assert relative_error(np.ravel(found), np.ravel(expected)) < 1e-12


@pytest.mark.parametrize("method", ["recursion", "closed_form"])
def test_methods_take_symbols_of_the_numbers_of_positions(method):
    robot = named_robot({"cart": "planar"}, [-1], tilted=False)
    S, given = robot.symbolic(), states(robot, 3)
    Q = robot.inverse_dynamics([*S.q], [*S.qd], [*S.q2d], method=method)
    found = sympy.lambdify([S.q, S.qd, S.q2d], [*Q], cse=True)(*(y[:, None] for y in given))
    assert relative_error(np.ravel(np.array(found, dtype=float)), robot.inverse_dynamics(*given)) < 1e-12
