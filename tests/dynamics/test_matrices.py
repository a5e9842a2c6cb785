"""Matrices, Jacobians and momenta: what they rest on, and batches, long chains and paths."""

import numpy as np
import pytest
from hypothesis import given

import jounce
from jounce.dynamics.closed_form import closed_form
from jounce.dynamics.state import BASE_AT_REST
from jounce.model import equivalent_mechanisms, screws
from jounce.model.mechanism import path_to
from jounce.program.program import Tape
from jounce.spatial.series import column_series
from support import recursion
from support.robots import golden, mechanisms, random_inertia, random_pose, random_screw, random_state

RECURSIONS = {
    "gM": recursion.mass_matrix,
    "gC": recursion.coriolis_matrix,
    "gCbar": recursion.skew_coriolis_matrix,
    "h": recursion.momentum,
}


def equal(found, expected, tolerance=1e-12, terms=1.0):
    """All but rounding of what is added up, of which nothing may be left."""
    assert found.shape == expected.shape
    assert np.abs(found - expected).max() <= tolerance * (np.abs(terms).max() + np.abs(expected).max())


@given(drawn=mechanisms())
def test_coriolis_matrices_are_those_of_any_body_frames(drawn):
    """Hence the frames on the joint axes; but not the base parameters, see below."""
    mechanism, rng = drawn
    moved = equivalent_mechanisms.reframe(mechanism, [random_pose(rng) for _ in range(mechanism.nb)])
    q, _ = random_state(rng, mechanism)
    F, G = closed_form(mechanism, column_series(q)), closed_form(moved, column_series(q))
    for C, expected in ((G.gC, F.gC), (G.gCbar, F.gCbar)):
        for k in range(3):
            equal(C[k], expected[k], 1e-11)


@pytest.mark.parametrize("entry", ["gC", "gCbar"])
def test_base_parameters_change_the_coriolis_matrix_alone(entry):
    mechanism, cases = golden("iiwa")
    q = column_series([np.array(cases[0][rate]) for rate in ("q", "qd")])
    given, reduced = closed_form(mechanism, q), closed_form(equivalent_mechanisms.minimal_mechanism(mechanism), q)
    equal(reduced.gM[0], given.gM[0])
    C, C_reduced = getattr(given, entry)[0], getattr(reduced, entry)[0]
    assert np.abs(C_reduced - C).max() > 0.1 * np.abs(C).max()
    qd = q[1]
    equal(C_reduced @ qd, C @ qd)


@pytest.mark.parametrize("compute", [*RECURSIONS.values(), lambda m, q: recursion.jacobians(m, q, BASE_AT_REST, None)])
def test_batches_of_a_single_joint_keep_their_axes(compute):
    """A lone joint's mass matrix and Jacobian depend on no coordinate."""
    mechanism = jounce.load("planar2r").mechanism
    lone = screws.from_screws(mechanism.B[:1], mechanism.X[:1], mechanism.M[:1])
    q = column_series(np.ones((4, 5, 3, 1)))
    one = compute(lone, column_series(np.ones((4, 1))))
    for k in range(2):
        assert compute(lone, q)[k].shape == (5, 3, *one[k].shape)


def test_long_chains_do_not_nest_deeply():
    """Two hundred joints: the matrices give the forces, with rates, of the recursion for forces."""
    rng = np.random.default_rng(0)
    nb = 200
    kinds = rng.choice(["revolute", "prismatic", "helical"], nb)
    M = np.stack([random_inertia(rng, 1) for _ in range(nb)])
    chain = screws.from_screws([random_pose(rng) for _ in range(nb)], [random_screw(rng, kind) for kind in kinds], M)
    q = column_series(rng.uniform(-0.1, 0.1, (4, nb)))
    Q = recursion.inverse_dynamics(chain, q) - recursion.gravity_forces(chain, q)
    M = recursion.mass_matrix(chain, q)
    for C in (recursion.coriolis_matrix(chain, q), recursion.skew_coriolis_matrix(chain, q)):
        for k in range(2):
            equal((M @ q.dot.dot + C @ q.dot)[k], Q[k], 1e-10)
    J = recursion.jacobians(chain, q, BASE_AT_REST, nb - 1)
    assert J[1].shape == recursion.jacobians(chain, q, BASE_AT_REST, None)[1][-1].shape
    assert recursion.base_wrench(chain, q)[1].shape == recursion.momentum(chain, q)[1].shape


def test_the_jacobian_of_a_body_takes_the_joints_of_its_path_alone():
    robot = jounce.Robot(golden("tree7")[0])
    tape = Tape()
    J = robot.jacobian(tape.variables(robot.n), body=robot.body_names[-1])
    taken = {step.value for step in tape.program(J.ravel()).steps if step.kind == "input"}
    path = path_to(robot.mechanism, robot.n - 1)
    assert taken == set(path[1:])  # turning the first joint turns all that hangs on it
    assert 1 < len(path) < robot.n
