"""Points of balance: identities of mechanics, rates, and refusals."""

import jax
import numpy as np
import pytest

import jounce
from contacts.conftest import FEET, PAWS, SOLE
from support.bases import base_path
from support.quantities import tupled
from support.refusals import refusal
from support.robots import differentiated_at_once, harmonic, relative_error


def slow_motion(robot, t, count):
    """Rates of a slow motion and of its base at times t."""
    rng = np.random.default_rng(1)
    joints, trunk = harmonic(rng, robot.n, count - 1), base_path(rng, count - 1)
    base = [np.stack(x) for x in zip(*(trunk(0.2 * s)[:count] for s in t), strict=True)]
    base = [np.linalg.inv(trunk(0)[0]) @ base[0], *(x * 0.2**k for k, x in enumerate(base) if k)]
    return [0.2 * x for x in joints(t)[:count]], tuple(base)


def test_the_moment_about_the_zero_moment_point_is_vertical(humanoid):
    rates, base = slow_motion(humanoid, np.array([0.3, 0.8]), 3)
    F = humanoid.base_wrench(*rates, base=base, method="recursion")
    for height in (0.0, -0.7):
        p = np.pad(humanoid.zmp(*rates, base=base, height=height), ((0, 0), (0, 1)), constant_values=height)
        moment = F[:, :3] - np.cross(p, F[:, 3:])
        assert np.abs(moment[:, :2]).max() < 1e-11 * np.abs(F).max()


def test_centres_of_pressure_average_to_the_zmp(dog):
    stand = dog.contacts([jounce.Contact(paw, "point") for paw in PAWS])
    q, base = np.tile([0.0, 0.7, -1.4], 4), (np.eye(4), np.zeros(6), np.zeros(6))
    f = stand.contact_wrenches(q, 0 * q, 0 * q, base=base)[:, 5]
    feet = np.stack([dog.poses(q, body=paw, base=base[0])[:3, 3] for paw in PAWS])
    np.testing.assert_allclose(feet[:, 2], feet[0, 2], atol=1e-12)
    p = dog.zmp(q, 0 * q, 0 * q, base=base, height=feet[0, 2])
    np.testing.assert_allclose(p, (f @ feet)[:2] / f.sum(), atol=1e-12)
    np.testing.assert_allclose(stand.center_of_pressure(q, 0 * q, 0 * q, base=base), 0, atol=1e-12)


@pytest.mark.parametrize("name", ["zmp", "dcm", "center_of_pressure"])
def test_each_further_rate_is_the_time_derivative(humanoid, name):
    robot = humanoid.contacts([jounce.Contact(foot, "plane", place=SOLE["place"]) for foot in FEET])
    options = {"height": 0.7} if name == "dcm" else {}
    least = 2 if name == "dcm" else 3

    def compute(t):
        rates, base = slow_motion(robot, t, least + 2)
        return tupled(getattr(robot, name)(*rates, base=base, **options))

    exact = compute(np.zeros(1))
    for order in range(2):
        rate = differentiated_at_once(lambda t, order=order: compute(t)[order], 0.01)
        assert relative_error(rate, exact[order + 1][0]) < 1e-7


def test_the_divergent_component_leaves_the_zero_moment_point(humanoid):
    """Of the whole robot: c2d = w^2 (c - p) - moments; without these it is the law of the inverted pendulum."""
    still = np.zeros(humanoid.n)
    C, Vd = np.eye(4), np.array([0, 0, 0, 0.6, 0.2, 0])
    c, _, c2d = humanoid.center_of_mass(*[still] * 3, base=(C, 0 * Vd, Vd))
    p = humanoid.zmp(*[still] * 3, base=(C, 0 * Vd, Vd), height=-0.8)
    w = np.sqrt(9.81 / (c[2] + 0.8))
    np.testing.assert_allclose(w**2 * (c[:2] - p), c2d[:2], atol=1e-10)  # all bodies accelerate alike
    _, rate = humanoid.dcm(*[still] * 3, base=(C, 0 * Vd, Vd), height=c[2] + 0.8)
    np.testing.assert_allclose(rate[:2], w * (c[:2] - p), atol=1e-10)


def test_a_foot_that_carries_nothing_has_no_centre_of_pressure(humanoid):
    stand = humanoid.contacts([jounce.Contact(foot, "plane", **SOLE, friction=1.0) for foot in FEET])
    still, Vd = np.zeros(humanoid.n), np.array([0, 0, 0, 0, 2.0, 0])
    p = stand.center_of_pressure(*[still] * 3, base=(np.eye(4), 0 * Vd, Vd))
    assert np.isnan(p[0]).all()
    assert (np.abs(p[1]) <= np.array(SOLE["sole"]) * (1 + 1e-9)).all()


def test_jax_traces_them(dog):
    q, base = np.tile([0.0, 0.7, -1.4], 4), (np.eye(4), np.zeros(6), np.zeros(6))
    with jax.enable_x64(True):
        found = jax.jit(lambda q: dog.zmp(q, 0 * q, 0 * q, base=base))(q)
    np.testing.assert_allclose(found, dog.zmp(q, 0 * q, 0 * q, base=base), atol=1e-12)


@pytest.mark.parametrize(("make", "match"), [
    (lambda dog, still, fall: dog.zmp(*still, base=fall), "'solo12' has no zero-moment point in flight, where the "),
    (lambda dog, still, fall: dog.zmp(*still, base=fall, height="low"), "height is 'low'; expected a number in m"),
    (lambda dog, still, fall: dog.dcm(*still[:2], base=fall[:2], height=0), "height is 0; expected that of the cent"),
    (lambda dog, still, fall: dog.center_of_pressure(*still, base=fall), "contact_wrenches of 'solo12': it has no"),
    (lambda dog, still, fall: jounce.load("planar2r").zmp([0, 0], [0, 0], [0, 0]),
     "gravity of 'planar2r' is (0.0, -9.81, 0.0); points of balance take one along -z"),
])  # fmt: skip
def test_what_has_no_such_point_is_refused(dog, make, match):
    fall = (np.eye(4), np.zeros(6), np.array([0, 0, 0, 0, 0, -9.81]))
    refusal(lambda: make(dog, np.zeros((3, 12)), fall), match)
