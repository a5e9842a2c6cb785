"""CasADi: vectors of SX as states, and functions whose derivatives are those of the recursion."""

import re
from dataclasses import replace

import numpy as np
import pytest

import casadi
import jounce
from jounce.model import positions
from jounce.spatial import lie
from support.quantities import branched
from support.refusals import refusal
from support.robots import differentiated, floating, golden, golden_case, random_pose, relative_error
from support.several_named import named_robot, states

TOLERANCE = 1e-12
RATES = ("", "d", "2d", "3d", "4d")
ROBOT = branched((-1, 0, -1))


def named_inputs(symbol, arrays):
    return {symbol + rate: array for rate, array in zip(RATES, arrays, strict=False)}


def dense_array(x, shape=(-1,)):
    return np.array(casadi.DM(x).full()).reshape(shape)


def test_inputs_and_results_have_names():
    robot, q, W = golden_case("mixed5")
    F = robot.casadi_function(wrench=True)
    assert F.name_in() == ["q", "qd", "q2d", "q3d", "q4d", "W", "Wd", "W2d"]
    assert F.name_out() == ["Q", "Qd", "Q2d"]
    found = F(**named_inputs("q", q), **named_inputs("W", W))
    expected = robot.inverse_dynamics(*q, wrench=tuple(W), method="recursion")
    for name, y in zip(F.name_out(), expected, strict=True):
        assert relative_error(dense_array(found[name]), y) < TOLERANCE


@pytest.mark.parametrize("quantity", ["inverse_dynamics", "momentum", "gravity_forces"])
@pytest.mark.parametrize("afloat", [True, False])
def test_the_motion_of_the_base_is_an_input(quantity, afloat):
    rng = np.random.default_rng(1)
    m = golden("planar2r")[0]
    robot = jounce.Robot(floating(m, rng) if afloat else m)
    F = robot.casadi_function(quantity, 1, moving_base=True, parameters=["masses"] if afloat else [])
    q = rng.uniform(-1, 1, (sum(name.startswith("q") for name in F.name_in()), 2))
    base = (random_pose(rng), *rng.uniform(-1, 1, (len(q) - 1, 6)))
    names = ["base_pose", *(f"base_twist{rate}" for rate in RATES[: len(q) - 1])]
    given = named_inputs("q", q) | dict(zip(names, base, strict=True))
    if afloat:
        given["masses"] = robot.mechanism.M[:, 3, 3]
    expected = getattr(robot, quantity)(*q, base=base, method="recursion")
    for name, y in zip(F.name_out(), expected, strict=True):
        assert relative_error(dense_array(F(**given)[name]), y) < TOLERANCE


def test_a_function_is_named_after_what_it_computes():
    m = golden("mixed5")[0]
    robot = jounce.Robot(replace(m, bodies=("a_-_b", "größe", *m.bodies[2:])))
    assert robot.casadi_function(order=0).name() == "inverse_dynamics"
    assert robot.casadi_function("poses", 0, body="a_-_b").name() == "poses_a_b"
    assert robot.casadi_function("jacobian", 0, body="größe", frame="world").name() == "jacobian_gr_e_world"


def test_derivatives_by_casadi_are_quantities_themselves():
    """dU/dq = Qgrav, dp/dqd = M, dV/dqd = J, and dQ/dq2d = M with the armature that acts."""
    robot = jounce.Robot(replace(ROBOT.mechanism, elasticity=None)).with_drives("armature")
    q, qd, q2d = x = [casadi.MX.sym(name, robot.n) for name in ("q", "qd", "q2d")]

    def derivative(name, by, **keywords):
        F = robot.casadi_function(name, 0, **keywords)
        return casadi.jacobian(F(*x[: F.n_in()]), by)

    place = {"body": "tool", "frame": "world"}
    found = [
        derivative("potential_energy", q).T,
        derivative("generalized_momentum", qd),
        derivative("twists", qd, **place),
        derivative("inverse_dynamics", q2d),
    ]
    values = np.random.default_rng(6).uniform(-1, 1, (3, robot.n))
    M = robot.mass_matrix(values[0])
    expected = [robot.gravity_forces(values[0]), M, robot.jacobian(values[0], **place), M]
    for derived, value in zip(casadi.Function("derivatives", x, found)(*values), expected, strict=True):
        assert relative_error(dense_array(derived, value.shape), value) < TOLERANCE


@pytest.mark.parametrize("order", [0, 3])
def test_any_order(order):
    robot = jounce.load("planar2r", L1=1.1, m2=0.3)
    q = np.random.default_rng(0).uniform(-1, 1, (order + 3, 2))
    found = robot.casadi_function(order=order)(*q)
    expected = robot.inverse_dynamics(*q)
    assert (
        relative_error(dense_array(found if order == 0 else found[-1]), expected if order == 0 else expected[-1])
        < TOLERANCE
    )


def test_the_jacobian_with_respect_to_the_state_and_the_hessian():
    """Of Q2d by MX, against central differences of the recursion over nine points."""
    robot, q, _ = golden_case("iiwa")
    F = robot.casadi_function()
    x = [casadi.MX.sym(name, 7) for name in F.name_in()]
    Q2d = F(*x)[2]
    jacobian = casadi.Function("J", x, [casadi.jacobian(Q2d, casadi.vertcat(*x[:2]))])
    hessian = casadi.Function("H", x, [casadi.hessian(casadi.dot(Q2d, Q2d), x[1])[0]])
    J = dense_array(jacobian(*q), (7, 14))
    for j in (1, 3, 8, 13):
        step = np.eye(14)[j].reshape(2, 7)

        def moved(h, step=step):
            return robot.inverse_dynamics(q[0] + h * step[0], q[1] + h * step[1], *q[2:], method="recursion")[2]

        assert relative_error(J[:, j], differentiated(moved)) < 1e-8
    H = dense_array(hessian(*q), (7, 7))
    assert np.isfinite(H).all()
    assert relative_error(H, H.T) < 1e-12
    step = np.eye(7)[3]

    def gradient(h):
        at = [q[0], q[1] + h * step, *q[2:]]
        return 2 * robot.inverse_dynamics(*at, method="recursion")[2] @ dense_array(jacobian(*at), (7, 14))[:, 7:]

    assert relative_error(H[:, 3], differentiated(gradient)) < 1e-8


def test_springs_and_rotors_are_inputs():
    rigid, rng = jounce.load("planar2r"), np.random.default_rng(4)
    arm = rigid.elastic(1e4, rotor=0.4)
    F = arm.casadi_function("motor_torques", 0, parameters=["stiffness", "rotor"])
    q, (stiffness, rotor) = rng.uniform(-1, 1, (5, 2)), rng.uniform(0.5, 2, (2, 2)) * [[1e4], [0.4]]
    expected = rigid.elastic(stiffness, rotor=rotor).motor_torques(*q)
    found = F(*q, stiffness, rotor).full()[:, 0]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11 * np.abs(expected).max())


def test_parameters_without_effect_are_warned_of():
    with pytest.warns(jounce.JounceWarning, match="^parameters without effect on mass_matrix: gravity$"):
        ROBOT.casadi_function("mass_matrix", 0, parameters=["gravity", "masses"])


PARAMETERS = ("gravity", "masses", "lengths", "payload:link5")


def test_sensitivities_to_masses_lengths_gravity_and_payload():
    robot = jounce.load("iiwa14")
    m, rng = robot.mechanism, np.random.default_rng(1)
    F = robot.casadi_function(order=1, parameters=PARAMETERS)
    q = rng.uniform(-1, 1, (4, 7))
    own = {
        "gravity": m.gravity,
        "masses": m.M[:, 3, 3],
        "lengths": m.B[:, :3, 3],
        "payload_mass": np.array([1.5]),
        "payload_com": np.array([0.1, 0.2, 0.3]),
        "payload_inertia": np.array([0.1, 0.01, 0.02, 0.2, 0.03, 0.15]),
    }
    assert F.name_in()[4:] == list(own)
    x = {name: casadi.MX.sym(name, *value.shape) for name, value in own.items()}
    rate = F(**named_inputs("q", q), **x)["Qd"]
    for name, value in own.items():
        S = casadi.Function("S", list(x.values()), [casadi.jacobian(rate, casadi.vec(x[name]))])
        found = dense_array(S(*own.values()), (7, value.size))
        direction = rng.uniform(-1, 1, value.shape)

        def moved(h, name=name, direction=direction):
            return robot_with_values(robot, own | {name: own[name] + h * direction}).inverse_dynamics(
                *q, method="recursion"
            )[1]

        assert relative_error(found @ direction.ravel(order="F"), differentiated(moved)) < 1e-9, name


def robot_with_values(robot, values):
    """The iiwa with these data, as a robot of its own."""
    m = robot.mechanism
    B, M = m.B.copy(), m.M * (values["masses"] / m.M[:, 3, 3])[:, None, None]
    B[:, :3, 3] = values["lengths"]
    i = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
    M[4] += jounce.inertia_matrix(values["payload_mass"][0], values["payload_com"], values["payload_inertia"][i])
    return jounce.Robot.from_screws(B, m.X, M, gravity=values["gravity"])


@pytest.mark.parametrize("n", [1, 2, 5])
def test_vectors_of_sx_are_states(n):
    m = golden("mixed5")[0]
    robot = jounce.Robot.from_screws(m.B[:n], m.X[:n], m.M[:n], gravity=m.gravity)
    q, qd, q2d = symbols = [casadi.SX.sym(name, n) for name in ("q", "qd", "q2d")]
    W = casadi.SX.sym("W", 6)
    Q = robot.inverse_dynamics(q, qd.T, q2d, wrench={"body1": W})
    assert isinstance(Q, np.ndarray)
    assert Q.shape == (n,)
    F = casadi.Function("Q", [*symbols, W], [casadi.vertcat(*Q)])
    rng = np.random.default_rng(2)
    state, load = rng.uniform(-1, 1, (3, n)), rng.uniform(-1, 1, 6)
    expected = robot.inverse_dynamics(*state, wrench={"body1": load})
    assert relative_error(dense_array(F(*state, load)), expected) < TOLERANCE
    assert relative_error(robot.inverse_dynamics(*map(casadi.DM, state), wrench={"body1": load}), expected) == 0


def test_a_matrix_of_sx_is_a_wrench_on_every_body():
    robot, q, W = golden_case("mixed5")
    w = casadi.SX.sym("W", 5, 6)
    Q = robot.inverse_dynamics(*q[:3], wrench=w)
    found = casadi.Function("Q", [w], [casadi.vertcat(*Q)])(W[0])
    assert relative_error(dense_array(found), robot.inverse_dynamics(*q[:3], wrench=W[0])) < TOLERANCE


@pytest.mark.parametrize(("attempt", "message"), [
    (lambda r: r.inverse_dynamics(*[casadi.MX.sym("x", 2)] * 3), "^q is a CasADi MX; expected SX, or …casadi_function"),
    (lambda r: r.inverse_dynamics(*[casadi.SX.sym("x", 3)] * 3), "^q has shape (3,); expected (..., 2)"),
    (lambda r: r.casadi_function(order=-1), "^order is -1; expected 0 to 100$"),
    (lambda r: r.casadi_function("mass_matrx"), "^unknown quantity 'mass_matrx'; did you mean 'mass_matrix'"),
    (lambda r: r.casadi_function(["mass_matrix"]), "^unknown quantity ['mass_matrix']; available"),
    (lambda r: r.casadi_function(wrench=1), "^wrench is 1; expected True or False"),
    (lambda r: r.casadi_function(2), "^unknown quantity 2; available: inverse_dynamics, "),
    (lambda r: r.casadi_function("mass_matrix", wrench=True), "^mass_matrix takes no wrenches; these do: "),
    (lambda r: r.casadi_function("mass_matrix", body="body1"), "^mass_matrix takes no body; these"),
    (lambda r: r.casadi_function("poses", body="body3"), re.compile(r"^unknown body 'body3'; did you mean 'body\d'\?")),
    (lambda r: r.casadi_function("poses", body="body1", frame="world"), "^unknown frame 'world'; …: body$"),
    (lambda r: r.casadi_function("jacobian", frame="world"), "^jacobian of all bodies: …; body="),
    (lambda r: r.casadi_function(parameters=["gravty"]), "^unknown parameter 'gravty'; did you mean 'gravity'"),
    (lambda r: r.casadi_function(parameters=["payload:x"]), "^unknown body 'x'"),
])  # fmt: skip
def test_refusals(attempt, message):
    refusal(lambda: attempt(jounce.load("planar2r")), message)


@pytest.mark.parametrize("floats", [False, True])
def test_joints_of_several_screws_take_the_numbers_of_their_positions(floats):
    robot = named_robot(floats=floats)
    q, *rates = states(robot, 4)
    F = robot.casadi_function("inverse_dynamics", 1, moving_base=floats)
    nq, n = robot.nq - 7 * floats, robot.n
    assert [F.size1_in(k) for k in range(4)] == [nq, n, n, n]
    given = named_inputs("q", [q[-nq:], *(x[-n:] for x in rates)])
    if floats:
        C = lie.pose(np.eye(3), q[:3, None])
        q[3:7] = 0, 0, 0, 1
        given |= {"base_pose": C} | {f"base_twist{rate}": x[:6] for rate, x in zip(RATES, rates, strict=False)}
    for name, y in zip(F.name_out(), robot.inverse_dynamics(q, *rates), strict=True):
        assert relative_error(dense_array(F(**given)[name]), y) < TOLERANCE
    assert robot.casadi_function("poses", 0, body="body6").size_out(0) == (4, 4)


def test_derivatives_by_positions_give_those_by_displacements():
    robot = named_robot()
    q, *rates = states(robot, 3)
    F = robot.casadi_function("inverse_dynamics", 0)
    x = [casadi.SX.sym(name, F.size1_in(k)) for k, name in enumerate(F.name_in())]
    by_q = casadi.Function("J", x, [casadi.jacobian(F(*x), x[0])])
    J = dense_array(by_q(q, *rates), (robot.n, robot.nq))
    assert (
        relative_error(J @ positions.rate_map(robot.mechanism, q), robot.inverse_dynamics_partials(q, *rates)[0])
        < TOLERANCE
    )
    assert np.abs(J[:, 1:5] @ q[1:5]).max() < 1e-11  # the length of a quaternion does not matter
