"""Partial derivatives agree with differences, Pinocchio, JAX, CasADi, SymPy, reverse accumulation, at every order."""

import warnings
from dataclasses import replace

import jax
import numpy as np
import pytest
import sympy
from hypothesis import given, settings

import casadi
import jounce
from jounce.checks.compare import build_pinocchio_model
from jounce.dynamics.computation import Computation
from jounce.model.mechanism import with_exact_integers
from jounce.native.code_forms import trace_program
from jounce.program import differentiate
from jounce.program.program import Tape
from jounce.spatial.lie import exp
from support.bases import moved_mechanisms, random_base
from support.refusals import refusal
from support.robots import Interpreted, floating, mechanisms, on_its_axis, random_mechanism, relative_error, with_drives

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    import pinocchio

HASTY = {"xla_backend_optimization_level": 0}  # as each function runs once


def driven_forest():
    """A forest of all kinds of joints, one of which follows another, with drives."""
    rng = np.random.default_rng(8)
    kinds = ["revolute", "prismatic", "helical", "revolute"]
    return with_drives(random_mechanism(rng, [-1, 0, 0, 2], kinds, [1.0, 2.0, 1.0, 0.5], mimic=True), rng)


def state_and_wrenches(m, order, seed=0):
    rng = np.random.default_rng(seed)
    return list(rng.uniform(-1, 1, (order + 3, m.n))), tuple(rng.uniform(-1, 1, (order + 1, m.nb, 6)))


def displaced(x, step):
    """Coordinates or their rates, or those of a twist, moved by steps; a pose by twists along one of its axes each."""
    if x.shape != (4, 4):
        return x + step
    axes = np.eye(6, dtype=x.dtype)
    moves = np.stack([exp(axis, (step @ axis)[:, None, None]) for axis in axes])
    return x @ moves[np.abs(step).argmax(axis=-1), np.arange(len(step))]


@pytest.mark.parametrize("moved", ["never", "floats", "ground"])
def test_partial_derivatives_of_every_rate_are_limits_of_differences(moved):
    """In long doubles, by differences of eighth order, with wrenches fixed in the bodies and all drive terms."""
    m = floating(driven_forest(), np.random.default_rng(3)) if moved == "floats" else driven_forest()
    q, W = state_and_wrenches(m, 2)
    base = () if moved == "never" else random_base(np.random.default_rng(4), 5)
    q, W, base = ([x.astype(np.longdouble) for x in given] for given in (q, W, base))
    robot = Interpreted(jounce.Robot(m))
    step = np.longdouble("0.01")
    weights = {1: np.longdouble(4) / 5, 2: -np.longdouble(1) / 5, 3: np.longdouble(4) / 105, 4: -np.longdouble(1) / 280}
    grid = np.concatenate([s * k * step * np.eye(m.nv, dtype=np.longdouble) for k in weights for s in (1, -1)])
    found = robot.inverse_dynamics_partials(*q, wrench=tuple(W), base=tuple(base) or None)
    for j in range(5):
        along_q = [displaced(x, grid[:, -m.n :] * (i == j)) for i, x in enumerate(q)]
        along_base = [displaced(x, grid[:, :6] * (i == j)) if m.floats else x for i, x in enumerate(base)]
        moves = robot.inverse_dynamics(*along_q, wrench=tuple(W), base=tuple(along_base) or None)
        for k, Q in enumerate(moves):
            terms = zip(weights.values(), Q.reshape(4, 2, m.nv, m.nv), strict=True)
            difference = sum(w * (Q_k[0] - Q_k[1]) for w, Q_k in terms).T / step
            if j >= k + 3:
                assert np.abs(difference).max() < 1e-15
            else:
                assert relative_error(found[k][j], difference) < 1e-11, (k, j)


@given(moved_mechanisms(largest=3))
@settings(max_examples=10)
def test_partials_of_accelerations_solve_those_of_forces_on_a_base(drawn):
    m, rng = with_drives(*drawn), drawn[1]
    robot, (q, W), base = jounce.Robot(m), state_and_wrenches(m, 0, int(rng.integers(2**32))), random_base(rng, 3)
    K, D, M = robot.inverse_dynamics_partials(*q, wrench=W[0], base=base, method="recursion")
    Q = robot.inverse_dynamics(*q, wrench=W[0], base=base, method="recursion")
    given = base[:2] if m.floats else base
    dq, dqd, Minv = robot.forward_dynamics_partials(*q[:2], Q, wrench=W[0], base=given, method="recursion")
    tolerance = 1e-13 * np.linalg.cond(M) ** 2
    for x, y in ((Minv @ M, np.eye(m.nv)), (M @ dq, -K), (M @ dqd, -D)):
        assert relative_error(x, y) < tolerance


@given(mechanisms())
def test_partials_of_accelerations_solve_those_of_forces(drawn):
    """Trees and forests, joints that follow others, drives, wrenches; those of forces by q2d are the mass matrix."""
    m, rng = with_drives(*drawn), drawn[1]
    robot, (q, W) = jounce.Robot(m), state_and_wrenches(m, 0, int(rng.integers(2**32)))
    K, D, M = robot.inverse_dynamics_partials(*q, wrench=W[0], method="recursion")
    assert relative_error(M, robot.mass_matrix(q[0], method="recursion")) < 1e-13
    Q = robot.inverse_dynamics(*q, wrench=W[0], method="recursion")
    dq, dqd, Minv = robot.forward_dynamics_partials(*q[:2], Q, wrench=W[0], method="recursion")
    tolerance = 1e-13 * np.linalg.cond(M) ** 2
    for x, y in ((Minv @ M, np.eye(m.n)), (M @ dq, -K), (M @ dqd, -D)):
        assert relative_error(x, y) < tolerance


def test_reverse_accumulation_on_the_traced_forces_gives_the_same():
    m = driven_forest()
    q, W = state_and_wrenches(m, 1)
    traced = trace_program(with_exact_integers(m), Computation("inverse_dynamics", 1, wrench=True))
    tape = Tape()
    forces = differentiate.evaluate(traced, tape, [*tape.variables(traced.inputs)])
    rows = [differentiate.adjoints(forces, row)[: 4 * m.n] for row in np.eye(2 * m.n, dtype=int).tolist()]
    values = tape.program([x for row in rows for x in row]).run(np.concatenate([np.ravel(x) for x in (*q, *W)]))
    expected = np.reshape(values, (2, m.n, 4, m.n)).swapaxes(1, 2)
    found = jounce.Robot(m).inverse_dynamics_partials(*q, wrench=W, method="recursion")
    for k, P in enumerate(found):
        assert relative_error(P, expected[k, : k + 3]) < 1e-12


@pytest.mark.parametrize("name", ["iiwa14", "ur5", "g1"])
def test_they_are_those_of_pinocchio(name):
    robot = Interpreted(jounce.load(name))
    model = build_pinocchio_model(pinocchio, robot.robot.mechanism)
    data = model.createData()
    q, qd, q2d = np.random.default_rng(2).uniform(-1, 1, (3, robot.robot.n))
    pinocchio.computeRNEADerivatives(model, data, q, qd, q2d)
    M = np.triu(data.M) + np.triu(data.M, 1).T
    assert relative_error(robot.inverse_dynamics_partials(q, qd, q2d), [data.dtau_dq, data.dtau_dv, M]) < 1e-12
    expected = pinocchio.computeABADerivatives(model, data, q, qd, q2d)
    for found, theirs in zip(robot.forward_dynamics_partials(q, qd, q2d), expected, strict=True):
        theirs = np.triu(theirs) + np.triu(theirs, 1).T if found is expected[-1] else theirs
        assert relative_error(found, theirs) < 1e-10


@pytest.mark.parametrize("name", ["solo12", "g1"])
def test_those_of_floating_robots_are_those_of_pinocchio(name):
    """On its free flyer, the twist of which is (linear; angular) and its displacements along that."""
    robot = Interpreted(jounce.load(name, base="floating"))
    m = robot.mechanism
    model, rng = build_pinocchio_model(pinocchio, m), np.random.default_rng(2)
    data, (q, qd, q2d), (C, V, Vd) = model.createData(), rng.uniform(-1, 1, (3, m.n)), random_base(rng, 3)
    joints = [model.joints[model.getJointId(joint)] for joint in m.joints]
    places = [*range(3, 6), *range(3), *(joint.idx_v for joint in joints)]
    x, v, a, tau = np.zeros(model.nq), *np.zeros((3, model.nv))
    x[:7] = pinocchio.SE3ToXYZQUAT(pinocchio.SE3(C))
    x[[joint.idx_q for joint in joints]] = q
    Q = robot.inverse_dynamics(q, qd, q2d, base=(C, V, Vd))
    v[places], a[places], tau[places] = np.concatenate([V, qd]), np.concatenate([Vd, q2d]), Q
    assert (
        relative_error(robot.forward_dynamics(q, qd, Q, base=(C, V)), pinocchio.aba(model, data, x, v, tau)[places])
        < 1e-11
    )
    pinocchio.computeRNEADerivatives(model, data, x, v, a)
    theirs = [data.dtau_dq.copy(), data.dtau_dv.copy(), np.triu(data.M) + np.triu(data.M, 1).T]
    P = robot.inverse_dynamics_partials(q, qd, q2d, base=(C, V, Vd))
    dq, dqd, inverse = pinocchio.computeABADerivatives(model, data, x, v, tau)
    theirs += [dq, dqd, np.triu(inverse) + np.triu(inverse, 1).T]
    for found, expected in zip([*P, *robot.forward_dynamics_partials(q, qd, Q, base=(C, V))], theirs, strict=True):
        assert relative_error(found, expected[np.ix_(places, places)]) < 1e-10


def test_they_are_jacobians_by_jax():
    """Of Q and Qd by every rate of q; the closed form is less code for XLA."""
    m = driven_forest()
    q, W = state_and_wrenches(m, 1)
    robot = jounce.Robot(m)
    with jax.enable_x64(True):
        law = lambda q: robot.inverse_dynamics(*q, wrench=W, method="closed_form")  # noqa: E731
        expected = jax.jit(jax.jacfwd(law), compiler_options=HASTY)(np.stack(q))
    for k, P in enumerate(robot.inverse_dynamics_partials(*q, wrench=W, method="recursion")):
        assert relative_error(P, np.moveaxis(expected[k], 0, 1)[: k + 3]) < 1e-11


def test_they_are_jacobians_by_casadi():
    m = driven_forest()
    robot, (q, W) = jounce.Robot(m), state_and_wrenches(m, 2)
    forces = robot.casadi_function(order=2, wrench=True)
    symbols = [casadi.SX.sym("x", *x.shape) for x in (*q, *W)]
    Q = forces(*symbols)
    jacobian = casadi.Function("J", symbols, [casadi.jacobian(casadi.vertcat(*Q), casadi.vertcat(*symbols[:5]))])
    expected = np.array(jacobian(*q, *W)).reshape(3, m.n, 5, m.n).swapaxes(1, 2)
    for k, P in enumerate(robot.inverse_dynamics_partials(*q, wrench=W, method="recursion")):
        assert relative_error(P, expected[k, : k + 3]) < 1e-11


def test_the_planar_2r_by_sympy():
    S = jounce.load("planar2r").symbolic()
    for k, (P, Q) in enumerate(((S.P, S.Q), (S.Pd, S.Qd))):
        for j, x in enumerate((S.q, S.qd, S.q2d, S.q3d)[: k + 3]):
            assert (Q.jacobian(x) - sympy.Matrix(P[j])).expand() == sympy.zeros(2, 2)


def test_a_wrench_that_keeps_its_direction_in_space_has_one_more_term():
    """d(J^T W)/dq at constant W, and the derivative of the components of W by the chain rule."""
    robot = Interpreted(jounce.load("planar2r"))
    q, zero, h = np.array([0.3, -0.5]), np.zeros(2), 1e-6
    f = np.array([1.0, 2.0, 0.0])

    def components(q):
        return robot.wrench(q, body="body2", force=-f, frame="world")

    def forces(q, W):
        return robot.inverse_dynamics(q, zero, zero, wrench=W)

    steps = h * np.eye(2)
    whole = np.stack([forces(q + x, components(q + x)) - forces(q - x, components(q - x)) for x in steps], -1) / (2 * h)
    turning = np.stack([forces(q, components(q + x)) - forces(q, components(q - x)) for x in steps], -1) / (2 * h)
    K = robot.inverse_dynamics_partials(q, zero, zero, wrench=components(q))[0]
    assert np.abs(turning).max() > 0.1
    assert relative_error(K + turning, whole) < 1e-7


@pytest.mark.parametrize(
    ("name", "order", "base", "most"),
    [
        ("iiwa14", 0, "fixed", 2987),
        ("iiwa14", 2, "fixed", 13341),
        ("g1", 0, "fixed", 20177),
        ("solo12", 0, "floating", 6278),
    ],
)
def test_they_take_few_operations(name, order, base, most):
    m = jounce.load(name, **({} if base == "fixed" else {"base": base})).mechanism
    asked = Computation("inverse_dynamics_partials", order, base=base == "floating")
    assert trace_program(m, asked).operations <= most


def test_a_point_mass_falls_by_its_mass_alone():
    """A prismatic joint along gravity: K and D vanish, and so do the partial derivatives of the acceleration."""
    M = jounce.inertia_matrix(2.0, [0, 0, 0], np.eye(3))
    robot = jounce.Robot.from_screws([np.eye(4)], [[0, 0, 0, 0, 0, 1.0]], [M])
    P, Pd = robot.inverse_dynamics_partials([0.1], [0.2], [0.3], [0.4])
    assert P.ravel().tolist() == [0, 0, 2]
    assert Pd.ravel().tolist() == [0, 0, 0, 2]
    dq, dqd, Minv = robot.forward_dynamics_partials([0.1], [0.2], [0.3])
    assert (dq.item(), dqd.item(), Minv.item()) == (0, 0, 0.5)


def test_bad_input_is_named():
    robot, zeros = jounce.load("planar2r"), np.zeros((4, 2))
    refusal(lambda: robot.inverse_dynamics_partials(*zeros[:3], None, zeros[3]), "q3d is None, yet q4d is given")
    refusal(lambda: robot.forward_dynamics_partials(*zeros[:2], [0, 0, 0]), "Q has shape (3,)", "joint1, joint2")
    words = ("forward_dynamics_partials has no rates", "order 1", "expected q, qd, Q alone, order=0")
    with pytest.raises(TypeError, match="positional arguments"):
        robot.forward_dynamics_partials(*zeros)
    refusal(lambda: robot.compile("forward_dynamics_partials", order=1), *words)
    refusal(lambda: robot.inverse_dynamics_partials(*zeros, wrench=np.zeros((2, 6))), "wrench gives W alone")
    out = tuple(np.empty((2, 2)) for _ in range(2))
    refusal(lambda: robot.forward_dynamics_partials(*zeros[:3], out=out), "out has 2 arrays; expected 3")
    m = on_its_axis().mechanism
    singular = jounce.Robot(replace(m, M=0 * m.M))
    refusal(lambda: singular.forward_dynamics_partials([0.1], [0.2], [0.3]), "mass matrix", "singular", *m.coordinates)
