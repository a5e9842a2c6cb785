"""The rows of contacts are those of the Jacobians of their frames, with rates: two mechanisms that share no step."""

from dataclasses import replace

import numpy as np
import pytest

import jounce
from contacts.conftest import FEET, PAWS
from jounce.dynamics.contacts import contact_paths
from jounce.spatial.lie import Ad, exp, inverse
from support.robots import random_pose, relative_error


def stand_of(name, dog, humanoid):
    rng = np.random.default_rng(3)
    place = random_pose(rng)
    if name == "paws":
        return dog.contacts([jounce.Contact(paw, "point", place=place) for paw in PAWS])
    if name == "feet and a hand":
        kinds = zip([*FEET, "left_rubber_hand"], ("plane", "line", "point"), strict=True)
        return humanoid.contacts([jounce.Contact(frame, kind, place=place) for frame, kind in kinds])
    if name == "base and a paw":
        return dog.contacts([jounce.Contact(dog.body_names[0], "plane", place=place), jounce.Contact(PAWS[2], "line")])
    G, g = rng.normal(size=(12, 8)), rng.normal(size=12)
    names = tuple(f"c{j}" for j in range(8))
    coupled = jounce.Robot(replace(dog.mechanism, G=G, g=g, coordinates=names))
    return coupled.contacts([jounce.Contact(paw, kind) for paw, kind in zip(PAWS, ("plane", "line"), strict=False)])


@pytest.mark.parametrize("name", ["paws", "feet and a hand", "base and a paw", "coupled joints"])
def test_rows_are_those_of_jacobians(name, dog, humanoid):
    stand, order = stand_of(name, dog, humanoid), 4
    m, free = stand.mechanism, stand.contacts([])
    paths, q = contact_paths(m), np.random.default_rng(0).normal(size=(order + 1, 2, stand.n))
    H = free.poses(q[0], base=np.eye(4), method="recursion")
    found = paths.rows_at_rest(paths.screws(H), paths.wrenches(paths.poses(H)), q[1:, ..., None])
    still, expected = (np.eye(4), *[np.zeros(6)] * order), []
    for contact in m.contacts:
        of_frame = Ad(inverse(contact.place))[contact.held]
        J = free.jacobian(*q, body=contact.frame, base=still, method="recursion")
        expected.append([of_frame @ x for x in J])
    assert len(expected[0]) == order + 1
    for k, parts in enumerate(zip(*expected, strict=True)):
        assert relative_error(found[k], np.concatenate(parts, axis=1)) < 1e-13, k


def test_a_wrench_on_a_twist_is_what_a_contact_holds(dog):
    """A displacement along a screw of space moves the place of a contact by what its wrenches say."""
    place, X = random_pose(np.random.default_rng(1)), np.array([0, 0.6, 0.8, 0.3, 0.1, -0.2])
    X[3:] -= (X[:3] @ X[3:]) * X[:3]
    stand = dog.contacts([jounce.Contact(PAWS[0], "plane", place=place)])
    C, h = random_pose(np.random.default_rng(2))[None], 1e-6
    moved = inverse(C) @ exp(X, np.full((1, 1, 1), h)) @ C
    expected = np.array([moved[0, 2, 1], moved[0, 0, 2], moved[0, 1, 0], *moved[0, :3, 3]]) / h
    np.testing.assert_allclose(contact_paths(stand.mechanism).wrenches(C)[..., 0] @ X, expected, atol=1e-5)
