"""Contacts without limits: wrenches that balance the base, with rates."""

from importlib import metadata

import numpy as np
import pinocchio
import pytest

import jounce
from contacts.conftest import FEET, PAWS, squat, standing_base
from jounce.engine import contact_motion
from jounce.io.bundled import BUNDLED
from jounce.spatial.lie import Ad, inverse
from support.bases import base_path
from support.refusals import expect_refusal, refusal
from support.robots import differentiated_at_once, harmonic, relative_error

NAMES = ["quadruped", "uneven", "two feet", "one foot", "foot, edge, hand"]
by_name = pytest.mark.parametrize("name", NAMES)


def free_state(robot, order=2, seed=0):
    """q, qd, ..., and the motion of a base, of no contact that stays."""
    rng = np.random.default_rng(seed)
    rates = [0.5 * x for x in harmonic(rng, robot.n, order + 2)(0.3)]
    return rates, tuple(x for x in base_path(rng, order + 2)(0.2))


@by_name
def test_no_rate_of_the_base_rows_is_left(stands, name):
    rates, base = free_state(stands[name])
    for Q in stands[name].inverse_dynamics(*rates, base=base, method="recursion"):
        assert np.abs(Q[:6]).max() < 1e-12 * np.abs(Q).max()


def contact_jacobian(stand, contact, q, base):
    """The rows (6, nv) of a contact, in its axes, from the Jacobian of its frame."""
    J = stand.jacobian(q, body=contact.frame, base=base[:1], method="recursion")
    J = Ad(inverse(contact.place)) @ J
    if contact.kind == "point":
        R = (stand.poses(q, body=contact.frame, base=base[:1], method="recursion") @ contact.place)[:3, :3]
        n = np.array([0, 0, 1.0]) if contact.normal is None else contact.normal
        x = np.array([1.0, 0, 0]) - n[0] * n
        axes = np.stack([x / np.linalg.norm(x), np.cross(n, x / np.linalg.norm(x)), n], axis=1)
        J = np.kron(np.eye(2), axes.T @ R) @ J
    return J


@by_name
def test_wrenches_are_the_weighted_pseudoinverse_of_frame_jacobians(stands, name):
    stand, (rates, base) = stands[name], free_state(stands[name], 0)
    contacts = stand.mechanism.contacts
    A = np.concatenate([contact_jacobian(stand, x, rates[0], base)[x.held] for x in contacts])
    roots = np.sqrt(np.concatenate([x.weights[x.held] for x in contacts]))
    Q = stand.contacts([]).inverse_dynamics(*rates, base=base, method="recursion")
    f = np.linalg.pinv(A[:, :6].T / roots) @ Q[:6] / roots
    found = stand.contact_wrenches(*rates, base=base, method="recursion")
    assert relative_error(np.concatenate([w[x.held] for w, x in zip(found, contacts, strict=True)]), f) < 1e-12
    assert all(w[[i for i in range(6) if i not in x.held]].any() == 0 for w, x in zip(found, contacts, strict=True))
    tau = stand.inverse_dynamics(*rates, base=base, method="recursion")
    assert relative_error(tau[6:], (Q - A.T @ f)[6:]) < 1e-12


@by_name
@pytest.mark.parametrize("quantity", ["inverse_dynamics", "contact_wrenches"])
def test_each_further_rate_is_the_time_derivative(stands, name, quantity):
    stand, rng = stands[name], np.random.default_rng(1)
    joints, pelvis = harmonic(rng, stand.n, 5), base_path(rng, 5)

    def compute(t, order):
        base = [np.stack(x) for x in zip(*(pelvis(s)[: order + 3] for s in t), strict=True)]
        rates = [0.5 * x for x in joints(t)[: order + 3]]
        found = getattr(stand, quantity)(*rates, base=tuple(base), method="recursion")
        return found if order else (found,)

    exact = compute(np.zeros(1), 3)
    for order in range(3):
        rate = differentiated_at_once(lambda t, order=order: compute(t, order)[-1], 0.01)
        assert relative_error(rate, exact[order + 1][0]) < 1e-8


def test_contacts_that_stay_do_no_work(humanoid, stands):
    t = np.array([0.3, 0.9])
    rates = squat(humanoid, t, 4)
    turning = [x + 0.2 * y for x, y in zip(rates, harmonic(np.random.default_rng(2), humanoid.n, 4)(t), strict=True)]
    for name, motion in (("two feet", rates), ("one foot", turning)):
        base = standing_base(humanoid, motion, FEET[0])
        Q, Qd, _ = stands[name].inverse_dynamics(*motion, base=base, method="recursion")
        options = {"method": "recursion"}
        T, Td, T2d = humanoid.kinetic_energy(*motion[:4], base=base[:4], **options)
        U, Ud, U2d = humanoid.potential_energy(*motion[:3], base=base[:3], **options)
        del T, U
        power = (Q[:, 6:] * motion[1]).sum(axis=1)
        rate = (Qd[:, 6:] * motion[1] + Q[:, 6:] * motion[2]).sum(axis=1)
        assert relative_error(power, Td + Ud) < 1e-10
        assert relative_error(rate, T2d + U2d) < 1e-10


def test_pinocchio_agrees_at_order_0_and_its_differences_at_order_1(dog, stands):
    [urdf] = [x for x in metadata.files("example-robot-data") or [] if str(x).endswith(f"/{BUNDLED['solo12'].urdf}")]
    model = pinocchio.buildModelFromUrdf(str(urdf.locate()), pinocchio.JointModelFreeFlyer())
    data, rng = model.createData(), np.random.default_rng(3)
    joints, trunk = harmonic(rng, 12, 3), base_path(rng, 3)
    frames = [model.getFrameId(paw) for paw in PAWS]

    def forces(t):
        """The forces on the feet in inertial axes, by RNEA and frame Jacobians of Pinocchio."""
        rates, base = [0.5 * x for x in joints(t)[:3]], tuple(trunk(t)[:3])
        q, v, a = dog.state_to("pinocchio", *rates, base=base, model=model)
        required = pinocchio.rnea(model, data, q, v, a)[:6]
        pinocchio.computeJointJacobians(model, data, q)
        pinocchio.updateFramePlacements(model, data)
        J = [pinocchio.getFrameJacobian(model, data, i, pinocchio.LOCAL_WORLD_ALIGNED)[:3, :6] for i in frames]
        return np.linalg.pinv(np.concatenate(J).T) @ required

    rates, base = [0.5 * x for x in joints(0.0)], tuple(trunk(0.0))
    f, fd = stands["quadruped"].contact_wrenches(*rates, base=base)
    assert relative_error(f[:, 3:].ravel(), forces(0.0)) < 1e-9
    assert relative_error(fd[:, 3:].ravel(), differentiated_at_once(lambda t: np.stack([*map(forces, t)]), 0.01)) < 1e-7


def test_products_are_derivatives_and_transposes_of_each_other(dog):
    stand = dog.contacts([jounce.Contact(PAWS[0], "point"), jounce.Contact("HR_LOWER_LEG", "plane", place=(0, 0.1, 0))])
    rates, base = free_state(stand, 1, 4)
    kernel, rng = stand.compile(order=0), np.random.default_rng(5)
    given = [*rates[:3], *base[:3]]
    by = [rng.uniform(-1, 1, np.shape(x)) if np.shape(x) != (4, 4) else np.zeros(6) for x in given]
    [found] = [kernel.jvp(given, by)] if not isinstance(kernel.jvp(given, by), tuple) else kernel.jvp(given, by)
    weights = rng.uniform(-1, 1, np.shape(found))
    gradients = kernel.vjp(given, weights)
    assert sum((x * d).sum() for x, d in zip(gradients, by, strict=True)) == pytest.approx((weights * found).sum())
    moved = lambda h: kernel(*(x + h * d if np.shape(x) == np.shape(d) else x for x, d in zip(given, by, strict=True)))  # noqa: E731
    assert relative_error(found, differentiated_at_once(lambda h: np.stack([*map(moved, h)]), 1e-3)) < 1e-8


def test_wrenches_on_bodies_and_batches(stands):
    stand = stands["quadruped"]
    rates, base = free_state(stand)
    W = tuple(np.random.default_rng(6).uniform(-1, 1, (3, 13, 6)))
    options = {"wrench": W, "method": "recursion"}
    Q = stand.inverse_dynamics(*rates, base=base, **options)
    assert all(np.abs(x[:6]).max() < 1e-11 * np.abs(x).max() for x in Q)
    twice = stand.inverse_dynamics(*(np.stack([x, x]) for x in rates), base=base, **options)
    assert all(relative_error(y[1], x) < 1e-13 for x, y in zip(Q, twice, strict=True))


T = np.arange(61) / 30


def standing_motion(robot, raised=0.0, held=False):
    """A squat on the left foot, its right knee raised by so much times sin(t), or with the pelvis held."""
    q = squat(robot, T, 0)[0]
    C = np.linalg.inv(robot.poses(q, body=FEET[0], base=np.eye(4), method="recursion"))
    q[:, robot.joint_names.index("right_knee_joint")] += raised * np.sin(T)
    motion = jounce.Motion.through(T, q, joint_names=robot.joint_names)
    return motion.with_base(None, C[0]) if held else motion.with_base(T, C, degree=7)


@pytest.mark.parametrize("raised", [0.0, 0.3 * contact_motion.SLIDING_TOLERANCE])  # bodies turn at up to 0.9 rad/s
def test_forces_along_a_motion_of_feet_that_stay(humanoid, stands, raised):
    along = stands["two feet"].forces_along(standing_motion(humanoid, raised), T[::20], order=1)
    assert all(np.abs(Q[:, :6]).max() < 1e-11 * np.abs(Q).max() for Q in along.forces)


@pytest.mark.parametrize(("moved", "match"), [
    ({"raised": 10 * contact_motion.SLIDING_TOLERANCE},
     "'right_ankle_roll_link' about y by up to 0.01 rad/s, at t = 0 s, and 0.009"),
    ({"held": True}, "'…_ankle_roll_link' along z by up to 0.… m/s"),
])  # fmt: skip
def test_feet_that_slide_are_refused(humanoid, stands, moved, match):
    with expect_refusal(f"^the motion moves contact {match}"):
        stands["two feet"].forces_along(standing_motion(humanoid, **moved))


def test_quantities_that_contacts_would_enter_are_refused(humanoid, stands):
    still, base = np.zeros(humanoid.n), (np.eye(4), np.zeros(6))
    with expect_refusal("^forward_dynamics of 'g1': the wrenches of its contacts would enter; "):
        stands["two feet"].forward_dynamics(still, still, np.zeros(6 + humanoid.n), base=base)
    with expect_refusal("^generalized_momentum of 'g1': …; robot.contacts([]) is the robot"):
        stands["two feet"].retime(standing_motion(humanoid))


def test_three_points_on_a_line_do_not_balance_the_turn_about_it(dog):
    stand = dog.contacts([jounce.Contact(frame, "point", place=(0, 0, -0.3 * k)) for k, frame in enumerate(PAWS[:3])])
    still, base = np.zeros(12), (np.eye(4), np.zeros(6), np.zeros(6))
    bent = np.tile([0.1, 0.5, -1.0], 4)
    stand.inverse_dynamics(bent, still, still, base=base)
    feet = [dog.poses(still, body=paw, base=np.eye(4))[:3, 3] for paw in PAWS[:2]]
    third = np.linalg.inv(dog.poses(still, body="base_link", base=np.eye(4)))[:3] @ [*(2 * feet[1] - feet[0]), 1]
    on_line = [jounce.Contact(paw, "point") for paw in PAWS[:2]] + [jounce.Contact("base_link", "point", place=third)]
    with expect_refusal("do not balance the moment about the axis (…) through … in state [1]"):
        dog.contacts(on_line).contact_wrenches(np.stack([bent, still]), still, still, base=base)


@pytest.mark.parametrize(("make", "match"), [
    (lambda dog: jounce.load("ur5").contacts([jounce.Contact("wrist_3_link", "plane")]), "does not float"),
    (lambda dog: dog.contacts(["FL_FOOT"]), "contacts holds 'FL_FOOT'; expected a list of jounce.Contact"),
    (lambda dog: dog.contacts([jounce.Contact("FL_PAW", "point")]),
     "unknown frame of a contact 'FL_PAW'; available: base_link, "),
    (lambda dog: dog.contacts([jounce.Contact(paw, "point") for paw in PAWS[:2]]),
     "contacts at FL_FOOT, FR_FOOT never balance the moment about the axis ("),
    (lambda dog: jounce.Contact("a", "plain"), "unknown kind of contact 'plain'; did you mean 'plane'"),
    (lambda dog: jounce.Contact("a", "point", friction=0.5), "friction of a point needs the normal of the ground"),
    (lambda dog: jounce.Contact("a", "point", normal=(0, 0, 2)), "normal has length 2; expected 1"),
    (lambda dog: jounce.Contact("a", "plane", normal=(0, 0, 1)), "the normal of a plane is the z axis of place="),
    (lambda dog: jounce.Contact("a", "line", sole=(1, 1)), "a line has no sole"),
    (lambda dog: jounce.Contact("a", "plane", sole=(0.1, -1)), "sole is …; expected 2 positive finite numbers"),
    (lambda dog: jounce.Contact("a", "plane", friction=-1), "friction is -1; expected a number, 0 or more"),
    (lambda dog: jounce.Contact("a", "plane", place=2 * np.eye(4)), "place is no pose"),
    (lambda dog: dog.contact_wrenches(*np.zeros((3, 12))), "it has no contacts; robot.contacts"),
])  # fmt: skip
def test_wrong_contacts_are_refused(dog, make, match):
    refusal(lambda: make(dog), match)


@pytest.mark.parametrize("what", ["elastic", "closed", "symbolic"])
def test_what_takes_no_contacts_says_so(stands, what):
    stand = stands["quadruped"]
    calls = {
        "elastic": lambda: stand.elastic(100, 0.1),
        "closed": lambda: stand.closed([("FL_FOOT", "FR_FOOT")], list(stand.joint_names[:9])),
        "symbolic": lambda: stand.symbolic(),
    }
    refusal(lambda: calls[what](), "has contacts, and …; robot.contacts([]) is the robot without")
