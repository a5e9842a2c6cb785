"""Columns that have other names than the robot's joints: units in headings, renamings, and what a refusal suggests."""

import numpy as np
import pytest

import jounce
from jounce.core.cures import running_command
from jounce.motion.column_names import suggest_names
from jounce.motion.units import split_unit
from support.refusals import refusal

ARM = jounce.load("planar2r")
UR5 = jounce.load("ur5")
T = np.linspace(0, 2, 201)
X, Y = 0.4 * np.sin(3 * T), 0.3 * np.cos(2 * T)

# As people write them: the heading of the times or of joint1, and the factor to SI units of its numbers.
HEADINGS = {
    "t": 1, "time": 1, "Time": 1, "timestamp": 1, "t [s]": 1, "t [ms]": 1e-3, "time(us)": 1e-6, "time (ms)": 1e-3,
    "timestamp_ms": 1e-3, "timestamp_ns": 1e-9, "t_us": 1e-6, "time_sec": 1, "Timestamp_MS": None,
    "joint1": 1, "joint1 [deg]": np.pi / 180, "joint1(deg)": np.pi / 180, "joint1 [°]": np.pi / 180,
    "joint1_deg": np.pi / 180, "joint1_rad": 1, "joint1_degrees": np.pi / 180, "joint1 [rad]": 1,
    "joint1 [turns]": None,
}  # fmt: skip


@pytest.mark.parametrize(("heading", "factor"), HEADINGS.items(), ids=HEADINGS)
def test_headings_are_read_with_their_unit(heading, factor):
    is_time = heading.lower().startswith("t")
    scale = 1 if factor is None else 1 / factor
    log = {heading: scale * T, "joint1": X} if is_time else {"t": T, heading: scale * X}
    if factor is None:
        refusal(lambda: jounce.load_motion(log | {"joint2": Y}, ARM, 0), "unit" if "[" in heading else "missing 't'")
        return
    motion = jounce.load_motion(log | {"joint2": Y}, ARM, 0)
    np.testing.assert_allclose(motion.samples[0], T, rtol=1e-12)
    np.testing.assert_allclose(motion.samples[1], np.c_[X, Y], atol=1e-12)


def test_a_suffix_is_a_name_where_a_joint_or_another_column_has_it():
    assert split_unit("arm_deg", whole={"arm_deg"}) == ("arm_deg", None)
    assert split_unit("arm_deg", taken={"arm"}) == ("arm_deg", None)
    assert split_unit("arm_deg") == ("arm", "deg")
    motion = jounce.load_motion({"t": T, "joint1": X, "joint1_deg": 9 * X, "joint2": Y}, ARM, 0)
    assert np.array_equal(motion.samples[1][:, 0], X)


def test_units_that_contradict_the_option_are_refused():
    log = {"t": T, "joint1_deg": X, "joint2_deg": Y}
    refusal(
        lambda: jounce.load_motion(log, ARM, 0, angles="rad"), "'joint1_deg' states its unit", "leave one of them out"
    )


def with_names(rename, *, columns=None, log=None):
    return jounce.load_motion(
        {"t": T, "base [deg]": X, "elbow": Y} if log is None else log, ARM, 0, rename=rename, columns=columns
    )


def test_whole_columns_are_renamed_with_their_units():
    for base in ("base", "base [deg]"):
        motion = with_names({base: "joint1", "elbow": "joint2"})
        np.testing.assert_allclose(motion.samples[1], np.c_[np.deg2rad(X), Y])


def test_a_heading_is_renamed_before_a_name_without_its_unit():
    log = {"t": T, "base [deg]": np.rad2deg(Y), "base": X, "elbow": Y}
    motion = with_names({"base": "joint1", "elbow": "joint2"}, log=log)
    np.testing.assert_allclose(motion.samples[1], np.c_[X, Y])
    log = {"t": T, "base [deg]": np.rad2deg(X), "base [rad]": X, "elbow": Y}
    refusal(
        lambda: with_names({"base": "joint1"}, log=log), "'base [deg]', 'base [rad]' have this name", "with its unit"
    )


def test_a_mapping_states_the_column_of_each_joint():
    motion = with_names((), columns={"joint1": "base [deg]", "joint2": "elbow"})
    np.testing.assert_allclose(motion.samples[1], np.c_[np.deg2rad(X), Y])


WRONG = {
    "no pairs": (3, ["rename is 3; expected a mapping"]),
    "a text": ("a=b", ["rename is 'a=b'; expected a mapping"]),
    "one star": ({"ba*": "joint1"}, ["expected OLD=NEW for a column, OLD*=NEW* for a prefix"]),
    "a star within": ({"b*e": "j*1"}, ["expected OLD=NEW for a column"]),
    "twice": ((("base", "joint1"), ("base", "joint2")), ["'base' is renamed twice, to 'joint1' and 'joint2'"]),
    "two to one": ({"base": "joint1", "elbow": "joint1"}, ["'base [deg]' and 'elbow' both become 'joint1'"]),
    "no such column": ({"hip": "joint1"}, ["no column 'hip'; there are: t, base [deg], elbow"]),
    "a prefix without stars": ({"el": "jo"}, ["a prefix is renamed by rename={'el*': 'jo*'}"]),
    "no such prefix": ({"hip*": "joint*"}, ["no column of hip1, hip2", "there are: t, base [deg], elbow"]),
    "no such joint": ({"base*": "axis*"}, ["no joint or body begins with 'axis'; there are: joint1, joint2"]),
}


@pytest.mark.parametrize(("rename", "words"), WRONG.values(), ids=WRONG)
def test_renamings_that_cannot_be_meant_are_refused(rename, words):
    refusal(lambda: with_names(rename), *words)


WRONG_MAPPINGS = {
    "no such joint": ({"wrist": "base"}, "unknown joint 'wrist'"),
    "no such column": ({"joint1": "hip"}, "unknown column 'hip'"),
    "one column twice": ({"joint1": "elbow", "joint2": "elbow"}, "column 'elbow' is that of 'joint1' and 'joint2'"),
    "no texts": ({"joint1": 1}, "expected a pattern, or a mapping"),
}


@pytest.mark.parametrize(("columns", "words"), WRONG_MAPPINGS.values(), ids=WRONG_MAPPINGS)
def test_mappings_of_what_is_not_there_are_refused(columns, words):
    refusal(lambda: with_names((), columns=columns), words)


UR_NAMES = ["base", "shoulder", "elbow", "wrist1", "wrist2", "wrist3"]
SUGGESTIONS = {
    "numbers": ([f"q{k}" for k in range(1, 7)], "try: columns='q{number}'"),
    "numbers from 0": ([f"pos[{k}]" for k in range(6)], "try: columns='pos[{index}]'"),
    "names within": ([f"pos_{joint}" for joint in UR5.joint_names], "try: rename={'pos_*': '*'}"),
    "names before": ([f"{joint}_pos" for joint in UR5.joint_names], "try: columns='{joint}_pos'"),
    "a prefix": ([f"ur_{joint}" for joint in UR5.joint_names[::-1]], "try: rename={'ur_*': '*'}"),
    "the order": (UR_NAMES, "try if the columns are in the robot's order: rename={'base': 'shoulder_pan_joint'"),
    "similar": (
        ["elbow_jnt", "shoulder_pan_jnt", "shoulder_lift_jnt", "wrist_3_jnt", "wrist_2_jnt", "wrist_1_jnt"],
        "try: rename={'shoulder_pan_jnt': 'shoulder_pan_joint'",
    ),
    "nothing": (["volts", "amps"], ""),
}


@pytest.mark.parametrize(("columns", "words"), SUGGESTIONS.values(), ids=SUGGESTIONS)
def test_refusals_suggest_what_maps_all_joints(columns, words):
    joints = UR5.joint_names
    found = suggest_names(joints, joints, columns)
    assert found.startswith(words)
    assert (found == "") == (words == "")


def test_different_prefixes_become_one_renaming():
    joints = [f"panda_joint{k}" for k in range(2, 5)]
    assert suggest_names(joints, joints, ["fer_joint2", "fer_joint3", "fer_joint4"]) == "try: rename={'fer*': 'panda*'}"


def test_the_shell_gets_the_finished_command():
    with running_command(["--rename", "--columns"], ["jounce", "run", "ur5", "my log.csv"]):
        found = suggest_names(UR5.joint_names, UR5.joint_names, [f"q{k}" for k in range(1, 7)])
    assert found == "try: jounce run ur5 'my log.csv' --columns 'q{number}'"


def test_renamings_are_added_to_those_that_were_typed():
    typed = ["jounce", "run", "ur5", "log.csv", "--rename", "x=wrist_1_joint"]
    with running_command(["--rename", "--columns"], typed):
        found = suggest_names(UR5.joint_names, ["elbow_joint"], ["elbow"])
    assert found == f"try: {' '.join(typed)} --rename elbow=elbow_joint"
