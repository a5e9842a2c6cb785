"""Where a URDF stands: free joints welded on request, a named link to start at, drive trains that the file states."""

from pathlib import Path

import numpy as np
import pytest

import jounce
from support.files import BODY, GOOD, LINKS, OTHER, joint, link, origin, robot_file
from support.refusals import refusal

PANDA = Path(__file__).parents[2] / "examples" / "panda.urdf"
PLACED = origin((0.3, -0.2, 0.5), (0.1, 0.7, -0.4))
QUIET = pytest.mark.filterwarnings("ignore::jounce.JounceWarning")


def hanging(kind):
    """base carries body by a joint of this kind at a pose of its own, body carries arm, arm carries hand."""
    return (
        link("base", BODY), link("body", OTHER), link("arm", BODY), link("hand", OTHER),
        joint("hold", "base", "body", kind, inner=PLACED), joint("turn", "body", "arm", axis="0 1 0"),
        joint("bend", "arm", "hand", axis="1 0 0", inner=origin((0, 0, 0.4))),
    )  # fmt: skip


def assert_same_tree(ours, theirs):
    for field in ("B", "X", "M", "G", "g"):
        np.testing.assert_array_equal(getattr(ours.mechanism, field), getattr(theirs.mechanism, field))
    assert (ours.joint_names, ours.body_names) == (theirs.joint_names, theirs.body_names)


def test_floating_joints_are_welded_on_request_alone(tmp_path):
    path = robot_file(tmp_path, *hanging("floating"))
    refusal(lambda: jounce.load(path), f"{path}:6", "'hold'", "floating", "base='fixed'", "root=")
    with pytest.warns(jounce.JounceWarning) as caught:
        robot = jounce.load(path, base="fixed")
    assert [str(w.message) for w in caught] == [f"{path}: base='fixed' welds at zero: hold (floating)"]
    assert caught[0].filename == __file__
    fixed = jounce.load(robot_file(tmp_path, *hanging("fixed"), name="fixed.urdf"), base="fixed")  # nothing to say
    assert_same_tree(robot, fixed)
    np.testing.assert_array_equal(robot.poses([0, 0], body="body"), fixed.poses([0, 0], body="body"))


def test_one_warning_names_all_that_are_welded(tmp_path):
    more = (link("wing", BODY), joint("glide", "base", "wing", "floating"), link("fin", BODY))
    path = robot_file(tmp_path, *hanging("floating"), *more, joint("slide", "arm", "fin", "planar"))
    assert jounce.load(path).nq == 7 + 7 + 2 + 4
    with pytest.warns(jounce.JounceWarning) as caught:
        robot = jounce.load(path, base="fixed")
    assert len(caught) == 1
    assert str(caught[0].message).endswith("hold (floating), glide (floating)")
    assert robot.nq == 2 + 4


@pytest.mark.parametrize("kind", ["floating", "revolute"])
def test_root_starts_at_a_link(tmp_path, kind):
    """What hangs on the link, as a file of its own says it."""
    robot = jounce.load(robot_file(tmp_path, *hanging(kind)), root="body")
    _, *rest = hanging(kind)
    alone = [item for item in rest if "hold" not in item]
    assert_same_tree(robot, jounce.load(robot_file(tmp_path, *alone, name="alone.urdf")))
    assert [frame.name for frame in robot.mechanism.frames] == ["body"]
    assert robot.mechanism.frame("body").body == -1  # it stands on the ground
    refusal(lambda: robot.poses([0, 0], body="base"), "unknown body 'base'")


def test_a_wrist_is_an_arm_with_its_other_joints_locked():
    arm, wrist = jounce.load(PANDA), jounce.load(PANDA, root="panda_link4")
    assert wrist.joint_names == arm.joint_names[4:]
    held = jounce.load(PANDA, lock=dict.fromkeys(arm.joint_names[:4], -0.3), gravity=(0, 0, 0))
    q, qd, q2d = np.random.default_rng(0).normal(size=(3, wrist.n))
    Q = jounce.load(PANDA, root="panda_link4", gravity=(0, 0, 0)).inverse_dynamics(q, qd, q2d)
    np.testing.assert_allclose(held.inverse_dynamics(q, qd, q2d), Q, atol=1e-12)


MIMIC = (*hanging("revolute"), link("x"), joint("follow", "hand", "x", inner='<mimic joint="hold"/>'))
REFUSED = {
    "unknown root": (GOOD, {"root": "am"}, ["unknown link 'am'", "did you mean 'arm'", "base, arm"]),
    "root that carries no joint": (GOOD, {"root": "arm"}, ["no movable joint among 1 link and 0 joints"]),
    "root that is no text": (GOOD, {"root": 3}, ["unknown link 3;"]),
    "locked joints without values": (GOOD, {"lock": ["turn"]}, ["joints to lock are of type list", "mapping"]),
    "unknown base": (GOOD, {"base": "free"}, ["base is 'free'", "'floating'", "'fixed'"]),
    "mimic of what is left out": (MIMIC, {"root": "body"}, [":10", "'follow' mimics 'hold'", "excluded by root="]),
    "mimic of what is welded": (
        (*hanging("floating"), link("x"), joint("follow", "hand", "x", inner='<mimic joint="hold"/>')),
        {"base": "fixed"}, ["'follow' mimics 'hold', which is floating"]),
    "mimic of a planar joint": (
        (*hanging("planar"), link("x"), joint("follow", "hand", "x", inner='<mimic joint="hold"/>')), {},
        ["'follow' mimics 'hold', which is planar"]),
}  # fmt: skip


@QUIET
@pytest.mark.parametrize(("items", "options", "words"), REFUSED.values(), ids=REFUSED)
def test_refuses(tmp_path, items, options, words):
    path = robot_file(tmp_path, *items)
    assert str(path) in refusal(lambda: jounce.load(path, **options), *words) or "lock" in options


@pytest.mark.parametrize(
    ("inner", "damping", "friction"),
    [
        ("", 0, 0),
        ('<dynamics damping="0.5" friction="2e-1"/>', 0.5, 0.2),
        ('<dynamics damping="3"/>', 3, 0),
        ('<dynamics friction="4"/>', 0, 4),
        ("<dynamics/>", 0, 0),
    ],
)
@pytest.mark.filterwarnings("ignore:.*the robot states no:jounce.JounceWarning")
def test_dynamics_are_kept_and_enter_q_where_asked(tmp_path, inner, damping, friction):
    path = robot_file(tmp_path, *LINKS, joint("turn", "base", "arm", inner=inner))
    robot, driven = jounce.load(path), jounce.load(path, drives=True)
    assert (robot.drives.damping.tolist(), robot.drives.friction.tolist()) == ([damping], [friction])
    state = [0.4], [0.1], [0.7]
    taken = driven.inverse_dynamics(*state) - robot.inverse_dynamics(*state)
    np.testing.assert_allclose(taken, [damping * 0.1 + friction * np.tanh(0.1 / 0.05)], atol=1e-15)
    only = jounce.load(path, drives="damping").inverse_dynamics(*state) - robot.inverse_dynamics(*state)
    np.testing.assert_allclose(only, [damping * 0.1], atol=1e-15)


@pytest.mark.parametrize(("attributes", "words"), [
    ('damping="-1"', ["'turn'", "damping is -1; expected 0 or more"]),
    ('friction="-0.1"', ["'turn'", "friction is -0.1; expected 0 or more"]),
    ('damping="nan"', ["<dynamics damping='nan'>", "finite number"]),
    ('friction="inf"', ["<dynamics friction='inf'>", "finite number"]),
    ('damping=""', ["<dynamics damping=''>", "finite number"]),
])  # fmt: skip
def test_bad_dynamics_are_refused(tmp_path, attributes, words):
    path = robot_file(tmp_path, *LINKS, joint("turn", "base", "arm", inner=f"<dynamics {attributes}/>"))
    refusal(lambda: jounce.load(path), f"{path}:4", *words)


@pytest.mark.parametrize(
    "inner", ['<dynamics damping="0.5"/>', '<limit lower="-1" upper="1"/>', '<mimic joint="turn"/>']
)
def test_what_a_fixed_joint_says_of_moving_is_not_read(tmp_path, inner):
    glued = joint("glue", "arm", "tool", "fixed", inner=inner)
    robot = jounce.load(robot_file(tmp_path, *GOOD, link("tool", OTHER), glued))
    assert (robot.joint_names, robot.drives.damping.tolist()) == (("turn",), [0])
