"""Thresholds on lengths are shares of the robot's own: on both sides of each, of robots of micrometres and of 10 km."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import jounce
from jounce.actuators.link_motion import _LINK_TOLERANCE, _collocate
from jounce.checks.audit import _MEETING_AXES, check_sizes
from jounce.checks.description import _PITCH_ROUNDING, joint_kind
from jounce.dynamics import loop_closure
from jounce.engine import contact_motion
from jounce.engine.contact_projection import PLACE_TOLERANCE
from jounce.identification.averaging import MIN_RELATIVE_VARIATION, force_band
from jounce.limits.ratios import LIMIT_TOLERANCE
from jounce.limits.worst_values import Worst
from jounce.model import positions
from jounce.model.equivalent_mechanisms import frame_shifts, reframe
from jounce.model.frame import Frame
from jounce.model.mechanism import robot_size
from jounce.spatial import groups
from jounce.spatial.lie import Ad
from support.refusals import refusal
from support.robots import on_base, shifted
from support.several_screws import screw_robot
from support.units import Units, coordinate_factors, in_units

I4 = np.eye(4)
BOTH_UNITS = pytest.mark.parametrize("u", [Units(1e-6, 1.0), Units(1e4, 1.0)], ids=["um", "10km"])
BOTH_SIDES = pytest.mark.parametrize(("times", "counts"), [(0.3, False), (3.0, True)], ids=["below", "above"])
X, Y, Z = (np.eye(6)[k] for k in range(3))
ALONG_X = np.eye(6)[3]


def small_box(mass=2.0, com=(0.1, 0.0, 0.05)):
    return jounce.inertia_matrix(mass, com, mass * np.diag([0.010, 0.011, 0.012]))


def leg():
    """A base that floats, on three hinges in different directions."""
    robot = jounce.Robot.from_screws(
        [shifted(0.2), shifted(0.4), shifted(0.1, 0.3)], [X, Y, Z], [small_box(), small_box(), small_box()]
    )
    return on_base(robot.mechanism, small_box(5.0))


@BOTH_UNITS
@BOTH_SIDES
def test_a_thread_moves_its_slide_by_a_share_of_the_robot(times, counts, u):
    """A thread of m/rad that are rounding, or finer ones; that of a robot of micrometres has 1e-11 m/rad.

    A nut turns back on it, and a slide holds the nut.
    """
    for pitch, kept in ((times * loop_closure.RATIO_TOLERANCE, counts), (1e-5, True)):
        screws = [[*Z[:3], 0, 0, pitch], Z, np.eye(6)[5]]
        m = jounce.Robot.from_screws([I4] * 3, screws, [small_box()] * 3, [-1, 0, -1]).mechanism
        ends = (Frame("nut", 1, shifted(1.0)), Frame("rail", 2, shifted(1.0)))
        tree = jounce.Robot(in_units(replace(m, frames=ends), u))
        ratios = tree.closed([("nut", "rail", "fixed")], tree.joint_names[:1]).mechanism.closure.ratios
        assert ratios.places == (1, 2)
        np.testing.assert_allclose(ratios.F[:, 0], [-1, pitch * u.length * kept], rtol=1e-4, atol=0)


@BOTH_UNITS
@BOTH_SIDES
@pytest.mark.parametrize("group", [groups.BALL, groups.PLANAR], ids=lambda group: group.name)
def test_screws_of_a_joint_span_a_group_to_a_share_of_their_levers(group, times, counts, u):
    """A joint whose first axis turns with a pitch spans none."""
    X = Ad(shifted(0.3 * u.length, 0.5 * u.length)) @ group.X
    X[3 + np.abs(X[:3, 0]).argmax(), 0] += times * groups.SPAN_ROUNDING * u.length
    assert (groups.find_group(X) is None) == counts


@pytest.mark.parametrize("share", [1e-10, 1e-13])
def test_small_offsets_of_frames_are_kept(share):
    """Lengths below 1e-15 m are what they are, but for rounding of others."""
    u, T = Units(1e-6, 1.0), shifted(1.0, share)
    m = in_units(jounce.Robot.from_screws([T], [Z], [small_box()]).mechanism, u)
    moved = reframe(m, [u.pose(np.linalg.inv(T))])
    np.testing.assert_allclose(frame_shifts(m, moved)[0][:3, 3], -u.length * T[:3, 3], rtol=1e-2)


@BOTH_SIDES
@pytest.mark.parametrize("unit", [1e-12, 1e8])
def test_joints_of_several_screws_jump_by_shares(times, counts, unit):
    """Only the second velocity jumps, or the third too, but for rounding."""
    robot = screw_robot("planar")
    [joint] = positions.multiscrew_joints(robot.mechanism.tree).values()
    jump = unit * np.array([0.0, 1.0, times * LIMIT_TOLERANCE])

    def rates(t, order, side):
        return [np.zeros((1, 3))] * order + [jump[None] * (side == "right")]

    worst = Worst.__new__(Worst)
    worst.b = SimpleNamespace(robot=robot, joints=robot.mechanism.joints, follow=False, rates=rates)
    found = worst._jumps_by_joint(SimpleNamespace(joint=joint.names[1], order=1, t=0.5, jump=unit))
    assert list(found) == ([1, 2] if counts else [1])


@BOTH_UNITS
@BOTH_SIDES
def test_a_pitch_is_a_share_of_the_lever(times, counts, u):
    pitch = times * _PITCH_ROUNDING * 0.5
    robot = jounce.Robot.from_screws([shifted(0.4)], [[0, 0, 1, 0, 0.5, pitch]], [small_box()])
    assert joint_kind(in_units(robot.mechanism, u), 0) == ("helical" if counts else "revolute")


@BOTH_UNITS
@BOTH_SIDES
def test_axes_that_meet_are_a_share_of_the_robot_apart(times, counts, u):
    """Two axes through one point, which their frames are away from."""
    apart = times * _MEETING_AXES * 0.5
    screws = [[*Z[:3], 0, -0.5 - apart, 0], [*Y[:3], 0, 0, 0.5]]
    m = in_units(jounce.Robot.from_screws([I4] * 2, screws, [small_box()] * 2).mechanism, u)
    assert robot_size(m) == pytest.approx(0.5 * u.length)
    [found] = [x for x in check_sizes(m) if x.kind == "size"]
    assert ("between its joints" in found.text) == counts


@BOTH_SIDES
@pytest.mark.parametrize("unit", [1e-12, 1e8])
def test_columns_of_forces_vary_by_a_share_of_their_values(times, counts, unit):
    """A force that trembles at 40 Hz, beside one that changes slowly: below the tolerance it is rounding."""
    t = np.arange(2000) / 1e3
    slow, quick = np.sin(2 * np.pi * 2 * t), np.sin(2 * np.pi * 40 * t)
    trembling = 1 + times * MIN_RELATIVE_VARIATION * np.sqrt(2) * quick
    forces = unit * np.stack([slow, trembling], axis=1)
    band = force_band(t, forces, np.zeros((len(t), 1)), np.ones(1))
    assert (band > 30) == counts


@BOTH_UNITS
@BOTH_SIDES
@pytest.mark.filterwarnings("ignore:.*rounding of the samples")  # the drift is as small as that
def test_contacts_that_drift_by_a_share_of_the_robot_slide(times, counts, u):
    m = in_units(leg(), u)
    stand = jounce.Robot(m).contacts([jounce.Contact(m.bodies[-1], "plane")])
    t = np.linspace(0, 1, 11)
    C = np.tile(I4, (len(t), 1, 1))
    C[:, 0, 3] = times * contact_motion._STILL * robot_size(m) * t
    motion = jounce.Motion.through(t, np.zeros((len(t), stand.n)), joint_names=stand.joint_names)
    motion = motion.with_base(t, C, degree=7)
    if not counts:
        contact_motion.refuse_sliding(stand.mechanism, motion)
        return
    refusal(lambda: contact_motion.refuse_sliding(stand.mechanism, motion), "contacts stay where they are")


@BOTH_UNITS
def test_projected_contacts_stay_to_a_share_of_the_robot(u):
    """Where a few steps are too few, and where rounding is more than 1e-12 m."""
    m = in_units(leg(), u)
    stand = jounce.Robot(m).contacts([jounce.Contact(m.bodies[-1], "plane")])
    given = jounce.Motion.fourier([0.1, 0.2, 0.3], [[0.3, 0.2, 0.1]], [[0.1, 0.3, 0.2]], 2.0, 1.5)
    motion = stand.project(replace(given, joint_names=stand.joint_names), I4)
    t = np.linspace(0, 1.5, 40)
    H = stand.poses(motion(t, 0)[0], base=motion.base(t, 0), body=m.bodies[-1], method="recursion")
    off = np.abs(H - H[0]).max(axis=0)
    assert off[:3, :3].max() < 4 * PLACE_TOLERANCE
    assert off[:3, 3].max() < 4 * PLACE_TOLERANCE * robot_size(m)


@BOTH_UNITS
def test_links_behind_motors_are_found_to_a_share_of_the_robot(u):
    """A slide and a hinge on springs: a slide of micrometres takes as many steps as one of metres."""
    links = jounce.Robot.from_screws([I4, shifted(0.3)], [ALONG_X, Z], [small_box(), small_box()])
    found = []
    for m in (
        links.elastic([4e3, 3e2], rotor=0.1).mechanism,
        in_units(links.elastic([4e3, 3e2], rotor=0.1).mechanism, u),
    ):
        own = coordinate_factors(m, u) if found else np.ones(2)
        theta = jounce.Motion.fourier([0.1, 0.2] * own, [[0.2, 0.3] * own], [[0.1, 0.2] * own], 5.0, 1.0)
        spline = _collocate(jounce.Robot(m), theta, np.linspace(0, 1, 21), 1 / m.elasticity.stiffness)
        found.append(spline.c / own)
    np.testing.assert_allclose(found[1], found[0], rtol=0, atol=_LINK_TOLERANCE)


@BOTH_UNITS
@pytest.mark.parametrize(("share", "chain"), [(1e-10, True), (1e-8, False)])
def test_screws_of_a_chain_are_compared_with_its_lengths(share, chain, u):
    pinocchio = pytest.importorskip("pinocchio")
    from jounce.io.models.pinocchio import _evaluate_joint, _is_chain

    made = pinocchio.JointModelComposite(pinocchio.JointModelRX(), pinocchio.SE3.Identity())
    place = pinocchio.SE3(np.eye(3), np.array([1.0, 0.5, 0.2]) * u.length)
    made.addJoint(pinocchio.JointModelRY(), place)
    model = pinocchio.Model()
    model.addJoint(0, made, pinocchio.SE3.Identity(), "j1")
    T, screws = _evaluate_joint(model, model.joints[1], 0.0)
    screws[0, 5] += share * u.length
    assert _is_chain(model, model.joints[1], T, screws) == chain
