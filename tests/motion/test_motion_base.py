"""Motions with a base: the pose and twist of a base that floats, or of the ground on which a robot stands."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jounce
from jounce import Motion
from jounce.io import tables
from jounce.io.motions import writing
from jounce.motion.base import BASE_COLUMNS, POSE_COLUMNS, compute_base_motion
from jounce.motion.curves import ArrangedCurve
from support.motion_tables import from_table
from support.refusals import refusal
from support.robots import floating

ARM = jounce.load("planar2r")
ROBOT = jounce.Robot(floating(ARM.mechanism, np.random.default_rng(3)))
T = np.linspace(0, 1, 101)
ANGLES = np.stack(
    [0.3 * np.sin(2 * T), 4 * T, 0.2 * T**2], axis=1
)  # more than half a turn: signs of quaternions change
TURNS = Rotation.from_euler("xyz", ANGLES)
Q = TURNS.as_quat(scalar_first=True, canonical=True)
P = np.stack([0.1 * np.sin(T), T**2, 0.5 + 0.1 * np.cos(3 * T)], axis=1)
C = np.tile(np.eye(4), (len(T), 1, 1))
C[:, :3, :3], C[:, :3, 3] = TURNS.as_matrix(), P
JOINTS = {"t": T, "joint1": np.sin(T), "joint2": np.cos(2 * T)}
BASE = dict(zip(BASE_COLUMNS, np.concatenate([P, Q], axis=1).T, strict=True))
MOTION = jounce.load_motion(JOINTS | BASE, ROBOT, degree=7)
PLAIN = jounce.load_motion(JOINTS, ARM, degree=7)
LINEAR = Motion.polynomial([[0, 1], [0, 2]], 1.0)
YAML = """time: {stop: 1, count: 11}
joints: {joint1: {polynomial: [0, 1]}, joint2: {offset: 0.5}}
"""


def test_rates_of_pose_and_twist_follow_their_derivatives():
    t, h = np.array([0.2, 0.5, 0.77]), 1e-4
    there = MOTION.base(t, 4)
    above, below = MOTION.base(t + h, 4), MOTION.base(t - h, 4)
    slopes = [(a - b) / (2 * h) for a, b in zip(above, below, strict=True)]
    twist = np.linalg.inv(there[0]) @ slopes[0]
    w = np.stack([twist[:, 2, 1], twist[:, 0, 2], twist[:, 1, 0]], axis=1)
    np.testing.assert_allclose(there[1], np.concatenate([w, twist[:, :3, 3]], axis=1), atol=1e-6)
    for k in (1, 2, 3):
        np.testing.assert_allclose(there[k + 1], slopes[k], atol=1e-5 * (1 + abs(slopes[k]).max()))
    np.testing.assert_allclose(MOTION.base(T, 0)[0], C, atol=1e-12)


def test_poses_make_the_base_that_columns_make():
    motion = PLAIN.with_base(T, C, degree=7)
    for ours, other in zip(motion.base(T, 2), MOTION.base(T, 2), strict=True):
        np.testing.assert_allclose(ours, other, atol=1e-9 * (1 + abs(other).max()))
    C_, V = PLAIN.with_base(None, C[7]).base([0.0, 0.5], 1)
    np.testing.assert_allclose(C_, [C[7], C[7]], atol=1e-15)
    assert V.shape == (2, 6)
    assert not V.any()
    assert PLAIN.base(0.5) is None
    assert "with a base" in repr(motion)
    assert "base" not in repr(PLAIN)


def test_forces_along_take_the_base():
    along = ROBOT.forces_along(MOTION)
    expected = ROBOT.inverse_dynamics(*MOTION(T), base=MOTION.base(T))
    assert [force.shape for force in along.forces] == [(101, 8)] * 3
    for ours, other in zip(along.forces, expected, strict=True):
        np.testing.assert_allclose(ours, other, rtol=1e-12, atol=1e-12 * abs(other).max())
    for ours, other in zip(along.base, MOTION.base(T), strict=True):
        np.testing.assert_array_equal(ours, other)
    ground = ARM.forces_along(MOTION, order=0)
    np.testing.assert_allclose(
        ground.forces[0], ARM.inverse_dynamics(*MOTION(T, 2), base=MOTION.base(T, 2)), atol=1e-12
    )
    assert abs(ground.forces[0] - ARM.forces_along(PLAIN, order=0).forces[0]).max() > 1
    assert ARM.forces_along(PLAIN, order=0).base is None


def test_all_rates_in_a_table_are_the_motion_again(tmp_path):
    """A table with other signs of some rows and the base link's name as prefix is the same motion."""
    robot = jounce.Robot(replace(ROBOT.mechanism, bodies=("trunk", *ARM.mechanism.bodies)))
    tables.write_pieces(tmp_path / "m.npz", writing.motion_pieces(MOTION, ROBOT.joint_names, 4))
    found = tables.read(tmp_path / "m.npz")
    columns = {name.replace("base.", "trunk."): values.copy() for name, values in found.items()}
    for name in columns:
        if ".q" in name and name.startswith("trunk."):
            columns[name][40:] *= -1
    again = jounce.load_motion(columns, robot)
    for ours, other in zip(again.base(T), MOTION.base(T), strict=True):
        np.testing.assert_allclose(ours, other, atol=1e-9 * (1 + abs(other).max()))
    assert [note for note in again.notes if "sign flips" in note] == list(again.notes[:1])
    between = jounce.load_motion(columns, robot).base(T[:-1] + 0.004, 0)[0]
    np.testing.assert_allclose(between, MOTION.base(T[:-1] + 0.004, 0)[0], atol=1e-8)


def test_units_stand_in_headers():
    columns = JOINTS | {"base.x [mm]": 1e3 * P[:, 0]} | {name: x for name, x in BASE.items() if name != "base.x"}
    motion = jounce.load_motion(columns, ROBOT, degree=7)
    np.testing.assert_allclose(motion.base(T, 0)[0], C, atol=1e-12)
    with pytest.warns(jounce.JounceWarning, match=r"base moves at .* m/s; expected m"):
        jounce.load_motion(JOINTS | BASE | {name: 1e3 * BASE[name] for name in BASE_COLUMNS[:3]}, ROBOT, degree=7)
    columns = {name.replace("qw", "qw [deg]"): x for name, x in columns.items()}
    refusal(lambda: jounce.load_motion(columns, ROBOT), "unknown unit 'deg'")


def test_a_smooth_curve_of_any_length_in_a_file_is_a_base(tmp_path):
    terms = "base: {z: {offset: 0.8}, qw: {offset: 2}, qz: {cosines: [{amplitude: 1, frequency: 3}]}}\n"
    (tmp_path / "m.yaml").write_text(YAML + terms)
    C, V = jounce.load_motion(tmp_path / "m.yaml", ROBOT).base(0.4, 1)
    angle = 2 * np.arctan2(np.cos(1.2), 2)
    np.testing.assert_allclose(C[:3, :3], Rotation.from_euler("z", angle).as_matrix(), atol=1e-15)
    np.testing.assert_allclose(V[2], 2 * -3 * np.sin(1.2) / 2 / (1 + np.cos(1.2) ** 2 / 4), atol=1e-12)
    (tmp_path / "m.yaml").write_text(YAML + "base: {x: {polynomial: [0, 1]}}\n")
    C, V = jounce.load_motion(tmp_path / "m.yaml", ARM).base(0.4, 1)
    np.testing.assert_allclose(V, [0, 0, 0, 1, 0, 0], atol=1e-15)
    np.testing.assert_allclose(C[:3, :3], np.eye(3), atol=1e-15)
    (tmp_path / "m.yaml").write_text(YAML)
    refusal(lambda: jounce.load_motion(tmp_path / "m.yaml", ROBOT), "expected base: with terms")


def test_the_base_goes_at_the_pace_of_the_joints():
    slow = MOTION.scaled(2).shifted(3)
    for k, (ours, other) in enumerate(zip(slow.base(3 + 2 * T), MOTION.base(T), strict=True)):
        np.testing.assert_allclose(ours, other / 2**k, atol=1e-10 * (1 + abs(other).max()))


def test_motions_that_follow_each_other_continue_the_base():
    """The sign of the second quaternion is free: no false break comes of it."""
    first = LINEAR.with_base(T, C, degree=7)
    later = Motion.polynomial([[1, -1], [2, -2]], 1.0).with_base(T, C[::-1], degree=7)
    for sign in (1, -1):
        other = replace(later, base_curve=ArrangedCurve(later.base_curve, np.arange(7), np.array([1] * 3 + [sign] * 4)))
        whole = first + other
        np.testing.assert_allclose(whole.base(1.5, 0)[0], C[50], atol=1e-6)
        of_base = {found.order for found in whole.breaks if found.symbol == "base"}
        assert 0 not in of_base
        assert 1 in of_base
    refusal(lambda: later + later, "do not meet")
    refusal(lambda: first + Motion.polynomial([[1, 1], [2, 1]], 1), "only one")


def test_jumps_of_the_base_are_force_breaks_that_blends_replace():
    whole = LINEAR.with_base(T, C, degree=7) + Motion.polynomial([[1, 1], [2, 2]], 1.0).with_base(None, C[-1])
    found = ROBOT.forces_along(whole, np.linspace(0, 2, 11), order=1).breaks
    assert [(one.t, one.order, {cause.symbol for cause in one.causes}) for one in found] == [(1.0, -1, {"base"})]
    smooth = whole.blended(0.1)
    assert smooth.breaks == ()
    assert any(note.startswith("base: blended") for note in smooth.notes)


def test_deviations_of_the_base_are_those_of_the_forces():
    """As many draws of the noise scatter the forces about as much as their deviations say."""
    rng = np.random.default_rng(1)
    t = np.linspace(0, 2, 240)
    angle = 0.3 * np.sin(2 * t)
    poses = np.tile(np.eye(4), (240, 1, 1))
    poses[:, 0, 3] = 0.2 * np.cos(t)

    def drawn():
        noisy = poses.copy()
        noisy[:, :3, 3] += 1e-5 * rng.normal(size=(240, 3))
        noisy[:, :3, :3] = Rotation.from_rotvec(
            np.c_[angle, 0 * t, 0 * t] + 1e-5 * rng.normal(size=(240, 3))
        ).as_matrix()
        return Motion.polynomial([[0, 1], [0, 2]], 2.0).with_base(t, noisy, bandwidth=2.0)

    at = np.array([0.7, 1.2])
    along = [ROBOT.forces_along(drawn(), at, order=0) for _ in range(4)]
    scatter = np.std([one.forces[0] for one in along], axis=0)
    ratio = np.sqrt((scatter**2).mean() / np.mean([one.deviations[0] ** 2 for one in along]))
    assert 0.3 < ratio < 2


def test_springs_with_dampers_take_the_base():
    """A stiff damped spring differs little from the rigid joint; without the base it would by all that this adds."""
    motion = LINEAR.with_base(T, C, degree=7)
    arm = ARM.elastic(1e5, 1e-6, damping=1.0)
    rigid = ARM.forces_along(motion, order=0).forces[0]
    assert abs(arm.motors_along(motion).torques[0] - rigid).max() < 1e-2 * abs(rigid).max()
    level = ARM.elastic(80, motors=jounce.Motor(gear=9.0, inertia=1e-3, body="body1"), coupling=0)
    refusal(lambda: level.motors_along(motion), "coupling=")


@pytest.mark.parametrize("missing", ["base.y", "base.qx"])
def test_missing_columns_of_the_base_are_named(missing):
    some = {name: x for name, x in BASE.items() if name != missing}
    message = refusal(lambda: jounce.load_motion(JOINTS | some, ROBOT))
    assert message.startswith(f"the motion: missing {missing}; expected base.x, base.y, base.z, base.qw")
    refusal(lambda: jounce.load_motion(JOINTS | some, ARM), missing)
    rates = BASE | {f"{name}d": 0 * T for name in BASE_COLUMNS if name != missing}
    refusal(lambda: jounce.load_motion(JOINTS | rates, ROBOT, 0), f"{missing}d, ")


def test_what_is_no_motion_of_a_base_is_refused_in_one_line():
    refusal(lambda: jounce.load_motion(JOINTS, ROBOT), "floats, and no column")
    off = BASE | {"base.qw": BASE["base.qw"] + 0.2}
    refusal(lambda: jounce.load_motion(JOINTS | off, ROBOT), "row 0: base.qw, base.qx, base.qy, base.qz have the norm")
    refusal(lambda: ROBOT.forces_along(PLAIN), "motion.with_base")
    refusal(lambda: PLAIN.with_base(T, np.where(np.arange(101)[:, None, None] == 3, 2 * C, C)), "sample 3")
    refusal(lambda: PLAIN.with_base(None, C), "one pose (4, 4)")
    refusal(lambda: PLAIN.with_base(T[:50], C), "101 poses")
    refusal(lambda: PLAIN.with_base(T / 2, C), "expected the whole motion")
    refusal(lambda: PLAIN.with_base(None, C[0], degree=7), "leave it out")
    through = replace(PLAIN, base_curve=Motion.polynomial([*[[0, 0]] * 3, [1, -2], *[[0, 0]] * 3], 1.0).curve)
    refusal(lambda: through.base(0.5), "norm 0 at t = 0.5 s")


def test_the_length_of_the_quaternion_is_free():
    x = [rng.normal(size=(5, 7)) for rng in [np.random.default_rng(0)] * 4]
    longer = [np.concatenate([rate[:, :3], 3 * rate[:, 3:]], axis=1) for rate in x]
    for ours, other in zip(compute_base_motion(longer), compute_base_motion(x), strict=True):
        np.testing.assert_allclose(ours, other, rtol=1e-10, atol=1e-10)
    assert len(POSE_COLUMNS) == 7


def test_a_table_of_a_robot_without_base_still_ignores_other_columns():
    assert from_table(JOINTS | {"foot.x": T}, ARM.mechanism, 4, "m.csv").base_curve is None
