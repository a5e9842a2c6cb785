"""Data at the door: what is accepted, and what is refused with one line that says why."""

import copy
import dataclasses
import pickle

import numpy as np
import pytest

import jounce
from jounce.model import screws
from jounce.spatial.inertia import form_error, principal_moments, triangle_slack
from support.refusals import expect_refusal, refusal
from support.robots import golden, random_mechanism, random_rotation, relative_error


def mechanism_data(n=2):
    M = jounce.inertia_matrix(1.0, [0.1, 0.2, 0.3], np.diag([0.1, 0.2, 0.25]))
    return {"B": [np.eye(4)] * n, "X": [[0, 0, 1, 0, 0, 0]] * n, "M": [M] * n}


def changed_data(name, index, value):
    array = np.array(mechanism_data()[name], dtype=float)
    array[index] = value
    return {name: array}


@pytest.mark.parametrize(("changes", "message"), [
    ({"B": np.eye(4)}, "B has shape (4, 4); expected (n, 4, 4)"),
    ({"B": np.zeros((0, 4, 4))}, "at least one body"),
    ({"X": np.zeros((2, 5))}, "X has shape (2, 5); expected (2, 6) for 2 bodies"),
    ({"M": np.zeros((3, 6, 6))}, "M has shape (3, 6, 6); expected (2, 6, 6)"),
    ({"gravity": 9.81}, "gravity has shape (); expected a vector (3,), as (0, 0, -9.81)"),
    (changed_data("B", (1, 0, 3), np.nan), "B[1, 0, 3] is nan; expected finite numbers"),
    (changed_data("M", (0, 0, 0), np.inf), "M[0, 0, 0] is inf"),
    (changed_data("B", (1, 0, 0), 1.1), "B[1] is not a pose … differs from I by 0.21"),
    (changed_data("B", (0, 0, 0), -1), "B[0] is not a pose … det R = -1"),
    (changed_data("B", (0, 3, 0), 1), "B[0] is not a pose … last row [1.0, 0.0, 0.0, 1.0]"),
    (changed_data("X", (1, 2), 2), "X[1] = … is not a unit screw"),
    (changed_data("X", 0, 0), "X[0] = … is not a unit screw"),
    (changed_data("M", (1, 0, 1), 1), "M[1] is not symmetric"),
    (changed_data("M", (1, 3, 3), 2), "M[1] has no m I in its lower right block"),
    (changed_data("M", ([1, 1], [0, 3], [3, 0]), 1), "M[1] has no skew matrix m c~"),
    ({"parent": [-1]}, "parent is [-1]; expected 2 indices"),
    ({"parent": [-1, 1]}, "parent[1] = 1; expected -1 (the ground) or an earlier body, 0 .. 0"),
    ({"parent": [1, -1]}, "parent[0] = 1"),
    ({"parent": [-1, -2]}, "parent[1] = -2"),
    ({"names": ["a"]}, "names is ['a']; expected 2 different texts"),
    ({"names": ["a", "a"]}, "expected 2 different texts"),
    ({"names": "ab"}, "names is 'ab'; expected 2 different texts"),
    ({"joint_names": [1, 2]}, "joint_names is"),
    ({"G": np.eye(3)}, "G has shape (3, 3); expected (2, 3)"),
    ({"G": np.zeros((2, 0))}, "G has shape (2, 0)"),
    ({"g": np.zeros(3)}, "g has shape (3,); expected (2,)"),
    ({"X": "axis"}, "X is of type str; expected an array of numbers"),
    ({"X": [["axis"] * 6] * 2}, "X holds text"),
    ({"parent": [None, 0]}, "parent[0] = None; expected -1 (the ground)$"),
    ({"parent": ["base", "a"]}, "parent[0] = 'base'"),
    ({"parent": -1}, "parent is -1; expected 2 indices"),
    ({"names": 3}, "names is 3; expected 2 different texts"),
])  # fmt: skip
def test_bad_data_are_refused_in_one_line(changes, message):
    given = mechanism_data() | changes
    refusal(lambda: jounce.Robot.from_screws(**given), message)


def test_data_are_copied_and_frozen_also_in_copies_of_a_robot():
    given = {name: np.array(array, dtype=float) for name, array in mechanism_data().items()}
    robot = jounce.Robot.from_screws(**given)
    for name, array in given.items():
        array[...] = 7.0  # the caller's own stays the caller's
        assert not np.shares_memory(array, getattr(robot.mechanism, name))
    for same in (robot, copy.deepcopy(robot), pickle.loads(pickle.dumps(robot))):
        with pytest.raises(ValueError, match="read-only"):
            same.mechanism.M[0, 0, 0] = 1.0
        with pytest.raises(dataclasses.FrozenInstanceError):
            same.mechanism.M = None


def test_rounded_data_within_the_tolerance_are_made_exact():
    """All paths agree: screws are unit and rotations orthonormal to the last digit, whatever was accepted."""
    given = {name: np.array(array, dtype=float) for name, array in mechanism_data().items()}
    given["X"] *= 1 + 9e-10
    given["B"][:, :3, :3] *= 1 - 4e-10
    robot = jounce.Robot.from_screws(**given)
    assert np.abs(robot.mechanism.X - mechanism_data()["X"]).max() == 0
    q = np.random.default_rng(0).normal(size=(5, 2))
    for Q, expected in zip(robot.inverse_dynamics(*q), robot.inverse_dynamics(*q, method="closed_form"), strict=True):
        assert relative_error(Q, expected) < 1e-13
    refusal(
        lambda: jounce.Robot.from_screws(**mechanism_data() | {"X": given["X"] * (1 + 1e-8)}), "is not a unit screw"
    )


def test_objects_that_are_numbers_are_checked_as_numbers():
    with expect_refusal("B[0] is not a pose"):
        jounce.Robot.from_screws(**mechanism_data() | {"B": (2 * np.array(mechanism_data()["B"])).astype(object)})


def test_the_arguments_of_the_contract_may_be_given_by_position():
    given = mechanism_data()
    robot = jounce.Robot.from_screws(given["B"], given["X"], given["M"], [-1, -1], ["left", "right"], (0, 0, -1.62))
    assert robot.body_names == ("left", "right")
    assert robot.gravity[2] == -1.62


def test_bad_spatial_data_are_refused():
    M = mechanism_data()["M"]
    refusal(lambda: jounce.Robot.from_spatial_screws([np.eye(4)], [[0, 0, 1, 0, 0, 0]] * 2, M), "A and Y have shapes")
    with expect_refusal("Y[1] = … is not a unit screw"):
        jounce.Robot.from_spatial_screws([np.eye(4)] * 2, [[0, 0, 1, 0, 0, 0], [0] * 6], M)
    with expect_refusal("A[0] is not a pose"):
        jounce.Robot.from_spatial_screws([2 * np.eye(4)] * 2, [[0, 0, 1, 0, 0, 0]] * 2, M)


def test_names_default_and_are_kept():
    robot = jounce.Robot.from_screws(**mechanism_data())
    assert robot.body_names == ("body1", "body2")
    assert robot.joint_names == ("joint1", "joint2")
    robot = jounce.Robot.from_screws(**mechanism_data(), names=["upper", "lower"], joint_names=["hip", "knee"])
    assert (robot.body_names, robot.joint_names) == (("upper", "lower"), ("hip", "knee"))
    robot = jounce.Robot.from_screws(**mechanism_data(), G=[[1.0], [-1.0]], joint_names=["squeeze"])
    assert (robot.n, robot.joint_names, robot.mechanism.joints) == (1, ("squeeze",), ("joint1", "joint2"))


def test_forests_are_accepted_and_their_trees_do_not_feel_each_other():
    rng = np.random.default_rng(5)
    kinds, masses = ["revolute", "helical", "prismatic", "revolute"], [1.0, 2.0, 3.0, 4.0]
    forest = random_mechanism(rng, [-1, 0, -1, 2], kinds, masses)
    both = jounce.Robot(forest)
    q = rng.normal(size=(5, 4))
    for part in (slice(0, 2), slice(2, 4)):
        alone = jounce.Robot.from_screws(forest.B[part], forest.X[part], forest.M[part], gravity=forest.gravity)
        for Q, expected in zip(both.inverse_dynamics(*q), alone.inverse_dynamics(*q[:, part]), strict=True):
            assert relative_error(Q[part], expected) < 1e-13


def test_massless_bodies_are_accepted():
    given = mechanism_data()
    given["M"] = [np.zeros((6, 6)), given["M"][0]]
    robot = jounce.Robot.from_screws(**given)
    assert np.isfinite(robot.inverse_dynamics([1.0, 2.0], [3.0, 4.0], [5.0, 6.0])).all()


def test_steiner_and_the_rotation_of_the_com_frame():
    """A rod about its end, and a tensor turned into the body frame, against sums over point masses."""
    rng = np.random.default_rng(7)
    points, m = rng.normal(size=(20, 3)), rng.uniform(0.1, 1, 20)
    c = m @ points / m.sum()
    R = random_rotation(rng)

    def tensor(about):
        d = points - about
        return sum(m_k * (d_k @ d_k * np.eye(3) - np.outer(d_k, d_k)) for m_k, d_k in zip(m, d, strict=True))

    M = jounce.inertia_matrix(m.sum(), c, R.T @ tensor(c) @ R, rotation=R)
    assert relative_error(M[:3, :3], tensor(np.zeros(3))) < 1e-14
    assert form_error(M) is None
    assert relative_error(principal_moments(M), np.linalg.eigvalsh(tensor(c))) < 1e-13
    assert triangle_slack(principal_moments(M)) > 0
    batch = jounce.inertia_matrix([m.sum()] * 3, [c] * 3, [tensor(c)] * 3)
    assert batch.shape == (3, 6, 6)
    assert relative_error(batch[1], M) < 1e-14


@pytest.mark.parametrize(("given", "message"), [
    ((1.0, [0, 0], np.eye(3)), "com has shape (2,); expected (..., 3)"),
    ((1.0, [0, 0, 0], np.ones(6)), "inertia_com has shape (6,); expected (..., 3, 3)"),
    ((1.0, [0, 0, 0], np.eye(3), np.eye(4)), "rotation has shape (4, 4)"),
    ((1.0, [0, 0, 0], np.eye(3), 2 * np.eye(3)), "rotation is not a rotation matrix: max abs(R^T R - I) = 3$"),
    (([1.0, 2.0], np.zeros((3, 3)), np.eye(3)), "batch axes do not fit together: mass (2,), com (3,)"),
])  # fmt: skip
def test_wrong_shapes_of_inertia_data_are_refused(given, message):
    refusal(lambda: jounce.inertia_matrix(*given), message)


def test_golden_mechanisms_are_read_as_they_are():
    mechanism, _ = golden("tree7")
    assert mechanism.parent == (-1, 0, 1, 1, 0, 4, 4)


def test_entries_that_are_rounding_become_one_number():
    """Of [2, 0] and [0, 2] of an inertia matrix, where nothing but rounding is left of either: files hold it once."""
    rng, whole = np.random.default_rng(0), np.diag([1.0, 1, 1, 2, 2, 2])
    for _ in range(100):
        M = screws.exact_inertia(whole + 1e-17 * rng.normal(size=(6, 6)) * 10 ** rng.uniform(-10, 0, (6, 6)), "M")
        np.testing.assert_array_equal(M, M.T)
        np.testing.assert_array_equal(M, screws.exact_inertia(M, "M"))
