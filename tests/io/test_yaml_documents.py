"""YAML of ROS: angles with tags, several documents, messages that repeat; what is left is refused with its line."""

from fractions import Fraction

import numpy as np
import pytest

import jounce
from support.refusals import expect_refusal, refusal

LIMITS = """joint_limits:
  shoulder_pan_joint: {has_position_limits: true, min_position: !degrees -360.0, max_position: !degrees 360.0,
    has_velocity_limits: true, max_velocity: !degrees 180.0, has_effort_limits: true, max_effort: 150.0}
  elbow_joint: {has_position_limits: true, min_position: !radians -3, max_position: 3,
    has_velocity_limits: true, max_velocity: !degrees 180.0, has_effort_limits: true, max_effort: 150.0}
"""
JOINTS = sorted(jounce.load("ur5").joint_names)  # alphabetical, as drivers publish them
COUNT, START, STEP = 120, 1761659000, 16000032  # messages, s, ns


@pytest.fixture
def given_file(tmp_path):
    def write(text, name="given.yaml"):
        path = tmp_path / name
        path.write_text(text)
        return path

    return write


def test_tags_of_angles_in_limits(given_file):
    limits = jounce.load("ur5").with_limits(given_file(LIMITS)).limits
    names = list(jounce.load("ur5").joint_names)
    pan, elbow = names.index("shoulder_pan_joint"), names.index("elbow_joint")
    assert limits.velocity[[pan, elbow]].tolist() == [np.pi, np.pi]
    assert limits.bounds("position")[:, pan].tolist() == [-2 * np.pi, 2 * np.pi]
    assert limits.bounds("position")[:, elbow].tolist() == [-3, 3]
    assert limits.effort[[pan, elbow]].tolist() == [150, 150]


OWN = "units: SI\nangles: deg\njoints:\n  elbow_joint: {velocity: !degrees 180}\n"


@pytest.mark.parametrize(("text", "words"), [
    (LIMITS.replace("max_effort: 150", "max_effort: !degrees 150"), ["given.yaml:3", "!degrees 150.0; expected a"]),
    (LIMITS.replace("!degrees 180.0", "!degrees fast"), ["given.yaml:3: !degrees stands before 'fast'"]),
    (LIMITS.replace("!degrees 180.0", "!degrees [1]"), ["given.yaml:3: !degrees stands before a sequence"]),
    (LIMITS.replace("!degrees 180.0", "!degrees 1e999"), ["!degrees 1e999; expected a finite number"]),
    (LIMITS.replace("!degrees 180.0", "!turns 2"), ["given.yaml:3: unknown tag '!turns'; available: !degrees"]),
    (LIMITS.replace("!degrees 180.0", "!!python/name:os.system 1"), ["unknown tag"]),
    (OWN, ["given.yaml:4", "is !degrees 180"]),  # never converted twice
    (f"{LIMITS}---\n{LIMITS}", ["given.yaml:7: document 2 of 2, separated by ---; expected one"]),
])  # fmt: skip
def test_other_tags_and_documents_are_refused(given_file, text, words):
    said = refusal(lambda: jounce.load("ur5").with_limits(given_file(text)), *words)
    assert "not YAML" not in said


def test_angles_of_a_joint_that_slides_are_refused(given_file):
    hand = "joint_limits: {panda_finger_joint1: {max_velocity: !degrees 2}}"
    with expect_refusal("panda_finger_joint1", "!degrees 2; expected a finite"):
        jounce.load("panda").with_limits(given_file(hand))


def joint_state_text(i, q, seconds="sec", nanoseconds="nanosec", names=JOINTS):
    s, ns = divmod(i * STEP, 10**9)
    lists = {"name": names, "position": q, "velocity": [], "effort": [10 * x for x in q]}
    stamp = f"header:\n  stamp:\n    {seconds}: {START + s}\n    {nanoseconds}: {ns}\n  frame_id: base\n"
    return stamp + "".join(
        f"{key}:{''.join(f'{chr(10)}- {x}' for x in values) if values else ' []'}\n" for key, values in lists.items()
    )


POSITIONS = [[float(np.sin(0.5 + 0.02 * i + j)) for j in range(6)] for i in range(COUNT)]


def echo(**options):
    return "".join(f"{joint_state_text(i, q, **options)}---\n" for i, q in enumerate(POSITIONS))


@pytest.mark.parametrize("stamp", [("sec", "nanosec"), ("secs", "nsecs")])
def test_joint_states_as_topics_are_echoed(given_file, stamp):
    motion = jounce.load_motion(given_file(echo(seconds=stamp[0], nanoseconds=stamp[1])), jounce.load("ur5"), order=0)
    order = [JOINTS.index(name) for name in jounce.load("ur5").joint_names]
    np.testing.assert_array_equal(motion.samples[1], np.array(POSITIONS)[:, order])
    np.testing.assert_array_equal(motion.torques[1], 10 * np.array(POSITIONS)[:, order])
    exact = [float(Fraction(i * STEP, 10**9)) for i in range(COUNT)]  # since the first stamp, in all digits
    np.testing.assert_array_equal(motion.torques[0], exact)


@pytest.mark.parametrize(("old", "new", "words"), [
    (f"sec: {START + 1}", "sec: now", ["message 63: stamp is", "expected integers {sec: ..., nanosec: ...}"]),
    (f"sec: {START + 1}", f"sec: {START + 1}.5", ["message 63: stamp is", "expected integers"]),
    (f"sec: {START + 1}", f"sec: {10**400}", ["message 63: stamp is", "expected integers"]),
    ("- elbow_joint", "- wrist_1_joint", ["message 0: joint 'wrist_1_joint' occurs 2 times"]),
    ("velocity: []\n", "velocity: []\nvelocity: []\n", ["not YAML", "velocity"]),
    (f"- {POSITIONS[1][3]}\n", "", ["given.yaml:29: message 1 is of elbow_joint", "with 5 positions"]),
    (f"- {POSITIONS[1][3]}\n", "- fast\n", ["given.yaml:29: message 1: position is", "'fast'", "expected numbers"]),
    (f"header:\n  stamp:\n    sec: {START}\n    nanosec: {STEP}\n  frame_id: base\n", "data: 3\n",
     ["message 1 is", "a JointState"]),
])  # fmt: skip
def test_bad_messages_are_named(given_file, old, new, words):
    text = echo()
    assert old in text
    refusal(lambda: jounce.load_motion(given_file(text.replace(old, new, 1)), jounce.load("ur5")), "given.yaml", *words)


def test_echoed_samples_take_the_options_of_tables_and_no_topic(given_file):
    path, robot = given_file(echo()), jounce.load("ur5")
    assert jounce.load_motion(path, robot, degree=5).source != jounce.load_motion(path, robot, order=0).source
    refusal(lambda: jounce.load_motion(path, robot, topic="/joint_states"), "topic", "is for bags of ROS")


PLAN = """joint_names: [joint1, joint2]
points:
  - {positions: [0, 1], velocities: [0, 0], time_from_start: {sec: 0, nanosec: 0}}
  - {positions: [0.1, 1.2], velocities: [0.3, 0.1], time_from_start: {sec: 0, nanosec: 207295897}}
  - {positions: [0.2, 1.3], velocities: [0, 0], time_from_start: {sec: 0, nanosec: 372734245}}
"""
LAST = PLAN.splitlines()[-1] + "\n"


@pytest.mark.parametrize("times", [1, 2])
def test_points_that_repeat_the_one_before_are_left_out(given_file, times):
    robot = jounce.load("planar2r")
    plain = jounce.load_motion(given_file(PLAN), robot)
    twice = jounce.load_motion(given_file(PLAN + times * LAST), robot)
    assert [note for note in twice.notes if "equal to the one before, also in time; left out" in note] == [*twice.notes]
    assert (plain.notes, len(twice.notes)) == ((), 1)
    t = np.linspace(0, plain.stop, 50)
    np.testing.assert_array_equal(plain(t, 3), twice(t, 3))


@pytest.mark.parametrize("change", [("1.3]", "1.4]"), ("[0, 0], time", "[0, 0.1], time"), (", velocities: [0, 0]", "")])
def test_points_at_one_time_that_differ_are_refused(given_file, change):
    path = given_file(PLAN + LAST.replace(*change))
    refusal(lambda: jounce.load_motion(path, jounce.load("planar2r")), "time_from_start does not increase")


def test_points_at_one_time_that_differ_are_left_out_on_request(given_file):
    robot = jounce.load("planar2r")
    plain = jounce.load_motion(given_file(PLAN), robot)
    late = LAST.replace("[0.2, 1.3]", "[0.2, 1.4]")
    refusal(lambda: jounce.load_motion(given_file(PLAN + late), robot), "entries 2 and 3; on_error='skip'")
    skipped = jounce.load_motion(given_file(PLAN + late), robot, on_error="skip")
    assert skipped.notes == ("point 3: not later than those before; left out",)
    t = np.linspace(0, plain.stop, 50)
    np.testing.assert_array_equal(plain(t, 3), skipped(t, 3))


UR5_PLAN = """joint_names: [shoulder_pan_joint, shoulder_lift_joint, elbow_joint, wrist_1_joint, wrist_2_joint,
              wrist_3_joint]
points:
  - {positions: [0, -1.5, 1, 0, 0.5, 0], velocities: [0, 0, 0, 0, 0, 0], accelerations: [0, 0, 0, 0, 0, 0],
     time_from_start: {sec: 0, nanosec: 0}}
  - {positions: [0.09, -1.455, 1.045, 0, 0.5, 0], velocities: [0.6, 0.3, 0.3, 0, 0, 0],
     accelerations: [0, 0, 0, 0, 0, 0], time_from_start: {sec: 0, nanosec: 207295897}}
"""
UR5_LAST = """  - {positions: [0.17, -1.415, 1.085, 0, 0.5, 0], velocities: [0.0, 0.0, 0.0, 0, 0, 0],
     accelerations: [0, 0, 0, 0, 0, 0], time_from_start: {sec: 0, nanosec: 372734245}}
"""


def test_a_plan_with_its_last_point_twice_is_the_same_motion(given_file):
    robot = jounce.load("ur5")
    once, twice = (jounce.load_motion(given_file(UR5_PLAN + k * UR5_LAST), robot) for k in (1, 2))
    assert twice.notes == (*once.notes, "point 3: equal to the one before, also in time; left out")
    t = np.linspace(0, once.stop, 50)
    np.testing.assert_array_equal(robot.forces_along(once, t).forces, robot.forces_along(twice, t).forces)
