"""The nearest motion that keeps the feet: they stay at all orders, rates are derivatives, the change is the least."""

import numpy as np
import pytest

import jounce
from contacts.conftest import FEET, PAWS, SOLE, squat
from jounce.engine import backends
from support.refusals import refusal
from support.robots import differentiated_at_once, relative_error

TIMES = np.array([0.1, 0.7, 1.3])
SLOPE = {"normal": (0, 0.6, 0.8)}


def logged(robot, amplitude=0.05):
    """Joints alone, every one with a motion of its own: no foot stays, wherever the base is."""
    rng, n = np.random.default_rng(0), robot.n
    offset = squat(robot, 0.4, 0)[0] if n != 12 else np.tile([0.1, 0.7, -1.4], 4)
    return jounce.Motion.fourier(
        offset, *amplitude * rng.normal(size=(2, 2, n)), 2.0, 1.5, joint_names=robot.joint_names
    )


def contacts_of(name):
    sole = jounce.Contact(FEET[0], "plane", place=SOLE["place"])
    edge = jounce.Contact(FEET[1], "line", place=(0.1, 0, -0.037))
    corners = [jounce.Contact(FEET[1], "point", place=(x, y, -0.037)) for x in (-0.05, 0.12) for y in (-0.03, 0.03)]
    hand = jounce.Contact("left_rubber_hand", "point", place=(0.1, 0, 0), **SLOPE)
    return {
        "one foot": [sole],
        "two feet": [sole, jounce.Contact(FEET[1], "plane", place=SOLE["place"])],
        "foot, edge, hand": [sole, edge, hand],
        "foot, corners": [sole, *corners],
        "paws": [jounce.Contact(paw, "point", **SLOPE) for paw in PAWS],
    }[name]


@pytest.fixture(scope="module", params=["one foot", "two feet", "foot, edge, hand", "foot, corners", "paws"])
def stand_and_projection(request, dog, humanoid):
    robot = dog if request.param == "paws" else humanoid
    stand, given = robot.contacts(contacts_of(request.param)), logged(robot)
    return stand, given, stand.project(given, np.eye(4) if request.param == "paws" else None)


@pytest.mark.sweep(2)
def test_contacts_stay_at_all_orders(stand_and_projection):
    stand, given, motion = stand_and_projection
    assert given.base_curve is None
    t = np.linspace(motion.start, motion.stop, 40)
    rates, base = motion(t), motion.base(t)
    free = stand.contacts([])
    for contact in stand.mechanism.contacts:
        options = {"body": contact.frame, "method": "recursion"}
        H = free.poses(rates[0], base=base[:1], **options) @ contact.place
        assert np.abs(H[:, :3, 3] - H[0, :3, 3]).max() < 2e-12
        if contact.kind == "plane":
            assert np.abs(H - H[0]).max() < 2e-12
        place = np.linalg.inv(contact.place)
        r, R = place[:3, 3], place[:3, :3]
        cross = np.array([[0, -r[2], r[1]], [r[2], 0, -r[0]], [-r[1], r[0], 0]])
        rows = np.block([[R, np.zeros((3, 3))], [cross @ R, R]])[contact.held]
        for V, scale in zip(free.twists(*rates, base=base, **options), rates[1:], strict=True):
            assert np.abs(V @ rows.T).max() < 1e-11 * np.abs(scale).max()


def joined_rates(curve, steps):
    """Rates 0 to 3 at all TIMES, moved by steps: (steps, times, numbers)."""
    rates = curve.rates(np.add.outer(steps, TIMES).ravel(), 3)
    return np.concatenate([x.reshape(len(steps), len(TIMES), -1) for x in rates], axis=-1)


def test_rates_are_derivatives(stand_and_projection):
    motion = stand_and_projection[-1]
    for curve in (motion.curve, motion.base_curve):
        exact = curve.rates(TIMES, 4)
        lower = differentiated_at_once(lambda s, curve=curve: joined_rates(curve, s), 0.01)
        for k, rate in enumerate(np.split(lower, np.cumsum([x[0].size for x in exact[:3]]), axis=-1)):
            assert relative_error(rate, exact[k + 1].reshape(3, -1)) < 1e-8


def test_the_change_has_no_part_along_motions_that_keep_the_contacts(stand_and_projection):
    """d q is square to the joints' part of all v with A v = 0 at the given joints: to first order nothing is nearer."""
    stand, given, motion = stand_and_projection
    free = stand.contacts([])
    for t in TIMES:
        [q], [near] = given(t, 0), motion(t, 0)
        J = [free.jacobian(q, body=x.frame, base=(np.eye(4),), method="recursion") for x in stand.mechanism.contacts]
        rows = []
        for contact, of_frame in zip(stand.mechanism.contacts, J, strict=True):
            T = np.linalg.inv(contact.place)
            r = T[:3, 3]
            cross = np.array([[0, -r[2], r[1]], [r[2], 0, -r[0]], [-r[1], r[0], 0]])
            rows.append(
                (np.block([[T[:3, :3], np.zeros((3, 3))], [cross @ T[:3, :3], T[:3, :3]]]) @ of_frame)[contact.held]
            )
        _, s, Vh = np.linalg.svd(np.concatenate(rows))
        kept = Vh[(s > 1e-9 * s[0]).sum() :, 6:]
        assert np.abs(kept @ (near - q)).max() < 1e-12


@pytest.mark.sweep(2)
def test_the_residual_is_the_largest_change_of_each_joint(stand_and_projection):
    _, given, motion = stand_and_projection
    t = np.linspace(0, 1.5, 500)
    largest = np.abs(motion(t, 0)[0] - given(t, 0)[0]).max(axis=0)
    np.testing.assert_allclose(motion.residual, largest, atol=1e-15)
    assert motion.notes[-1].endswith(" s")


def test_forces_along_it_leave_the_base_alone(stand_and_projection):
    stand, _, motion = stand_and_projection
    for Q in stand.inverse_dynamics(*motion(TIMES), base=motion.base(TIMES), method="recursion"):
        assert np.abs(Q[:, :6]).max() < 1e-12 * np.abs(Q).max()


def test_joints_may_change_by_a_radian(dog):
    """Newton's method comes there if the rows of its matrix are those of contacts far from their places."""
    motion = dog.contacts(contacts_of("paws")).project(logged(dog, 0.2), np.eye(4))
    assert 0.9 < motion.residual.max() < 1


def test_one_time_alone_is_that_of_many(stand_and_projection):
    """All times take the steps of Newton's method that one needs; contacts may be off by 1e-12 before the last."""
    curve = stand_and_projection[-1].curve.base
    together, alone = curve.rates(TIMES, 4), [curve.rates(TIMES[i : i + 1], 4) for i in range(3)]
    for k, rate in enumerate(together):
        assert relative_error(np.concatenate([rates[k] for rates in alone]), rate) < 1e-11


def test_a_projection_without_native_code(dog, monkeypatch):
    given = logged(dog)
    rates = dog.contacts(contacts_of("paws")).project(given, np.eye(4)).curve.base.rates(TIMES, 4)
    monkeypatch.setattr(backends, "is_available", lambda: False)
    curve = dog.contacts(contacts_of("paws")).project(given, np.eye(4)).curve.base
    for generic, native in zip(curve.rates(TIMES, 4), rates, strict=True):
        assert relative_error(generic, native) < 1e-13


def test_one_foot_changes_no_joint(humanoid):
    given = logged(humanoid)
    motion = humanoid.contacts(contacts_of("one foot")).project(given)
    assert motion.residual.max() < 1e-15
    assert relative_error(motion(TIMES, 4)[4], given(TIMES, 4)[4]) < 1e-13


def test_where_the_base_starts(humanoid):
    given, stand = logged(humanoid), humanoid.contacts(contacts_of("two feet"))
    first = stand.mechanism.contacts[0]
    C = stand.project(given).base(0.0, 0)[0]
    H = humanoid.poses(given(0.0, 0)[0], body=FEET[0], base=C) @ first.place
    np.testing.assert_allclose(H, np.eye(4), atol=1e-15)
    moved = C.copy()
    moved[:3, 3] += (1, 2, 3)
    t = np.linspace(0, 1.5, 30)
    drifting = np.stack([C] * 30)
    drifting[:, 0, 3] += 0.01 * t
    for motion, base, start in ((given, moved, moved), (given.with_base(t, drifting, degree=7), None, C)):
        np.testing.assert_allclose(stand.project(motion, base).base(0.0, 0)[0], start, atol=1e-14)


def test_breaks_and_deviations_and_stances_remain(dog):
    stand = dog.contacts(contacts_of("paws"))
    trapezoids = jounce.Motion.trapezoidal(
        [[0.1, 0.7, -1.4] * 4, [0.1, 0.8, -1.5] * 4], 1.0, 4.0, joint_names=dog.joint_names
    )
    motion = stand.project(trapezoids.with_stances([(0, PAWS)]), np.eye(4))
    assert {(x.t, x.order) for x in motion.breaks if x.symbol == "q"} == {(x.t, x.order) for x in trapezoids.breaks}
    assert any(x.symbol == "base" for x in motion.breaks)
    assert motion.stance_frames == tuple(PAWS)
    t = np.linspace(0, 2, 401)
    noise = 1e-5 * np.random.default_rng(1).normal(size=(401, 12))
    fitted = jounce.Motion.fit(t, logged(dog, 0.02).scaled(4 / 3)(t, 0)[0] + noise, joint_names=dog.joint_names)
    kept = stand.project(fitted, np.eye(4))
    np.testing.assert_array_equal(kept.deviations(1.0, 2)[2], fitted.deviations(1.0, 2)[2])


@pytest.mark.parametrize(("make", "match"), [
    (lambda stand: stand.contacts([]).project(logged(stand)), "'solo12' has no contacts that a motion could keep"),
    (lambda stand: stand.project(logged(stand)), "no base, and 'FL_FOOT', a point, no axes …; state base=C"),
    (lambda stand: stand.project(logged(stand), np.ones((4, 4))), "is no pose"),
    (lambda stand: stand.project("log.csv"), "motion is 'log.csv'; expected a jounce.Motion"),
    (  # more than the joints can keep: Newton's method leaves all bounds
        lambda stand: stand.contacts([jounce.Contact(*x) for x in zip(PAWS, ("point", "line", "plane"), strict=False)])
        .project(logged(stand), np.eye(4)),
        "the contacts of 'solo12' cannot stay: at t = … m or rad from",
    ),
    (lambda stand: stand.project(logged(stand, 3.0), np.eye(4)), "the contacts of 'solo12' cannot stay: at t = "),
])  # fmt: skip
def test_what_cannot_be_projected_is_refused(dog, make, match):
    refusal(lambda: make(dog.contacts(contacts_of("paws"))), match)


@pytest.mark.parametrize(("bent", "refused"), [(0.01, False), (1e-4, True)])
def test_legs_that_are_nearly_straight_are_refused(bent, refused):
    """Two legs in a plane, of three parallel joints each: no joint moves a foot along a straight leg."""
    axis = np.array([0, 1.0, 0, 0, 0, 0])
    inertia = np.diag([0.01] * 3 + [1.0] * 3)
    B = np.stack([np.eye(4)] * 6)
    B[:, :3, 3] = [(0, y, z) for y in (0.1, -0.1) for z in (0, -0.4, -0.4)]
    B[[1, 2, 4, 5], 1, 3] = 0
    biped = jounce.Robot.from_screws(
        B, np.stack([axis] * 6), np.stack([inertia] * 6), parent=[-1, 0, 1, -1, 3, 4], base=inertia
    )
    stand = biped.contacts([jounce.Contact(biped.body_names[k], "plane") for k in (3, 6)])
    leg = np.array([-bent / 2, bent, -bent / 2])
    bending = jounce.Motion.polynomial(np.stack([np.tile(leg, 2), [bent / 10, 0, 0] * 2], axis=1), 0.2)
    if refused:
        refusal(lambda: stand.project(bending), "hardly move its contacts in one direction at t = …, as straight legs")
    else:
        stand.project(bending)
