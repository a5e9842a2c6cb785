"""Poses at rest: loads within their deviations, and what rest does not determine."""

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest

import jounce
from jounce.spatial import inertia
from support.refusals import refusals

REACH = 1.4  # rad, of joints whose limits are wider
QUIET = pytest.mark.filterwarnings("ignore::jounce.JounceWarning")  # what notes hold
ARMS = ("ur5", "panda", "iiwa14", "xarm7", "ur10")


@cache
def load_arm(name):
    arm = jounce.load(name)
    fingers = [joint for joint in arm.joint_names if "finger" in joint]
    return arm.locked(dict.fromkeys(fingers, 0.02)) if fingers else arm


def with_ball(arm, mass, com):
    """The arm with a ball on its last body."""
    M = np.array(arm.mechanism.M)
    M[-1] += jounce.inertia_matrix(mass, com, 1e-3 * mass * np.eye(3))
    return arm.with_inertial_parameters(inertia.parameters(M).ravel())


@dataclass(frozen=True)
class StaticSet:
    """Poses of an arm with a load, and without it or not."""

    arm: jounce.Robot
    mass: float
    com: np.ndarray
    poses: list[jounce.Poses]
    friction: str


def draw_set(seed):
    """A simulated set: arm, load, number of poses, offsets, noise and friction at random."""
    rng = np.random.default_rng(seed)
    arm = load_arm(ARMS[seed % len(ARMS)])
    mass, com = rng.uniform(0, 3), rng.uniform(-0.08, 0.08, 3)
    friction = ("none", "sides", "order", "one side")[seed // len(ARMS) % 4]
    noise = rng.uniform(0.05, 0.3)
    robots = [with_ball(arm, mass, com), arm][: rng.integers(1, 3)]
    return StaticSet(arm, mass, com, [draw_poses(rng, robot, noise, friction) for robot in robots], friction)


def draw_poses(rng, robot, noise, friction):
    count = int(rng.integers(10, 101))
    n = robot.n
    limits = robot.limits.bounds("position")
    q = rng.uniform(np.maximum(limits[0], -REACH), np.minimum(limits[1], REACH), (count, n))
    amount = rng.uniform(0.3, 3, n)
    sides = {
        "none": np.zeros((count, n)),
        "sides": rng.choice([-1.0, 1.0], (count, n)),
        "order": np.sign(np.diff(q, axis=0, prepend=q[:1])),
        "one side": np.ones((count, n)),
    }[friction]
    Q = robot.gravity_forces(q) + rng.normal(size=n) + noise * rng.normal(size=q.shape) + amount * sides
    return jounce.Poses(q, Q, approach=sides if friction == "sides" and count % 2 else None)


def over_set_deviations(drawn):
    """The errors of mass and first moments of a set, over their deviations."""
    found = drawn.arm.payload(*drawn.poses)
    true = np.append(drawn.mass, drawn.mass * drawn.com)
    assert found.undetermined == ("Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
    assert [row.name for row in found.table] == ["mass", "com x", "com y", "com z"]
    return (found.parameters[:4] - true) / np.sqrt(np.diag(found.covariance)[:4])


@QUIET
def test_errors_of_forty_sets_are_as_large_as_their_deviations():
    """Five arms, 10 to 100 poses, loads of 0 to 3 kg, friction of none, any, the last or one side."""
    over = np.array([over_set_deviations(draw_set(seed)) for seed in range(40)])
    assert 0.85 < np.sqrt(np.mean(over[:, 0] ** 2)) < 1.15
    assert 0.85 < np.sqrt(np.mean(over**2)) < 1.15


@QUIET
@pytest.mark.parametrize("seed", [0, 7, 15])
def test_errors_are_within_deviations(seed):
    assert (np.abs(over_set_deviations(draw_set(seed))) < 3).all()


@QUIET
def test_a_load_that_friction_hides_is_said_not_to_be_seen():
    """0.29 kg in 49 poses, with friction from unknown sides."""
    drawn = draw_set(188)
    found = drawn.arm.payload(*drawn.poses)
    assert abs(found.table[0].value - drawn.mass) < 3 * found.table[0].deviation
    assert not found.table[0].seen
    assert any("these poses do not determine mass" in note for note in found.notes)


@pytest.fixture(scope="module")
def ur5():
    return load_arm("ur5")


def draw_positions(seed, count=30):
    return np.random.default_rng(seed).uniform(-REACH, REACH, (count, 6))


def values_by_name(found):
    """The values of a table by name."""
    return {row.name: row.value for row in found.table}


COM = (0.02, 0.01, 0.05)


def test_exact_torques_give_the_load(ur5):
    """Offsets that differ, and the model's own masses, do not matter with poses without the load."""
    q, loaded = draw_positions(0), with_ball(ur5, 1.7, COM)
    model = ur5.with_inertial_parameters(1.2 * ur5.inertial_parameters)
    pair = [jounce.Poses(x, arm.gravity_forces(x) + c) for x, arm, c in ((q, loaded, 0.5), (q[::-1], ur5, -0.2))]
    found = model.payload(*pair)
    assert found.parameters[:4] == pytest.approx([1.7, *(1.7 * np.array(COM))], abs=1e-7)
    assert found.com == pytest.approx(COM, abs=1e-6)
    assert found.mismatch < 1e-3
    assert np.isinf(np.diag(found.covariance)[4:]).all()
    x = draw_positions(1, 3)
    assert found.robot.gravity_forces(x) == pytest.approx(with_ball(model, 1.7, COM).gravity_forces(x), abs=1e-5)


def test_thirty_poses_agree_with_plain_least_squares(ur5):
    rng, q, loaded = np.random.default_rng(66), draw_positions(66), with_ball(ur5, 1.7, COM)
    Q = loaded.gravity_forces(q) + 0.05 * rng.normal(size=q.shape)
    # One regressor entry after the other: the torque of a unit of mass, and of first moments, on the last body.
    columns = []
    for unit in np.eye(4):
        p = np.array(ur5.inertial_parameters)
        p[-10:-6] += unit
        columns.append((ur5.with_inertial_parameters(p).gravity_forces(q) - ur5.gravity_forces(q)).ravel())
    A = np.stack(columns, axis=1)
    x = np.linalg.lstsq(A, (Q - ur5.gravity_forces(q)).ravel())[0]
    spread = 0.05 * np.sqrt(np.diag(np.linalg.inv(A.T @ A)))
    found = ur5.payload(jounce.Poses(q, Q), drives=False)
    assert found.parameters[:4] == pytest.approx(x, abs=2 * spread.max())
    assert np.sqrt(np.diag(found.covariance)[:4]) == pytest.approx(spread, rel=0.35)
    assert found.mass == pytest.approx(1.7, abs=0.005)


def test_friction_of_both_sides_is_found(ur5):
    rng, q = np.random.default_rng(1), draw_positions(1)
    sides, friction = rng.choice([-1.0, 1.0], q.shape), np.array([3.0, 4, 2, 1, 1, 0.5])
    Q = 1.1 * ur5.gravity_forces(q) + friction * sides + 0.3 + 0.02 * rng.normal(size=q.shape)
    found = ur5.identify(jounce.Poses(q, Q, approach=sides))
    values = values_by_name(found)
    assert [values[f"{joint} friction"] for joint in ur5.joint_names] == pytest.approx(friction, abs=0.02)
    assert [values[f"{joint} offset"] for joint in ur5.joint_names] == pytest.approx(np.full(6, 0.3), abs=0.05)
    assert found.robot.drives.friction == pytest.approx(friction, abs=0.02)
    assert found.undetermined == (
        "moments of inertia", "damping", "armature", "Stribeck friction", "friction by the load",
    )  # fmt: skip
    assert found.notes == ()
    assert found.predicted == pytest.approx(Q, abs=0.2)


def test_a_side_that_misses_makes_friction_a_part_of_the_offset(ur5):
    q = draw_positions(2)
    sides = np.where(np.arange(6) < 2, 1.0, np.sign(q))
    found = ur5.identify(jounce.Poses(q, ur5.gravity_forces(q) + sides, approach=sides))
    values = values_by_name(found)
    assert [joint for joint in ur5.joint_names if f"{joint} friction" in values] == list(ur5.joint_names[2:])
    assert values["shoulder_pan_joint offset"] == pytest.approx(1.0, abs=1e-6)
    assert found.undetermined[-1] == "Coulomb friction of shoulder_pan_joint, shoulder_lift_joint"
    assert "part of the offset, as no poses were approached from both sides" in found.notes[0]


@QUIET
def test_friction_by_the_order_of_the_poses_is_taken_out(ur5):
    """A joint that comes from below is mostly high: left in, 5 N m would be taken for load."""
    errors = []
    for seed in range(6):
        rng, q = np.random.default_rng(seed), draw_positions(seed)
        sides = np.sign(np.diff(q, axis=0, prepend=q[:1]))
        Q = with_ball(ur5, 1.7, COM).gravity_forces(q) + 5 * sides + 0.1 * rng.normal(size=q.shape)
        pairs = (jounce.Poses(q, Q), jounce.Poses(q, Q, approach=np.zeros_like(q)))
        errors.append([ur5.payload(poses).table[0].value - 1.7 for poses in pairs])
    by_order, unknown = np.sqrt(np.mean(np.square(errors), axis=0))
    assert by_order < 0.02 < 0.1 < unknown


@QUIET
def test_what_rest_does_not_determine_has_no_number(ur5):
    q = draw_positions(3)
    model = ur5.with_drives(False)
    found = model.identify(jounce.Poses(q, 1.1 * ur5.gravity_forces(q)), drives=True)
    assert {row.name.split()[-1] for row in found.table} == {"mcx", "mcy", "mcz", "offset", "spring"}
    assert all(np.isfinite(row.deviation) for row in found.table)
    assert found.covariance.shape == (len(found.table),) * 2
    text = str(found)
    assert "30 poses at rest" in text
    assert "rest does not determine moments of inertia, damping, armature, Stribeck friction" in text
    for word in ("nan", " inf", "cell", "Hz", "t = "):
        assert word not in text
    for name in ("friction", "damping", "armature", "stribeck"):
        assert (getattr(found.robot.drives, name) == getattr(ur5.drives, name)).all()
    assert "poses at rest" in found.summary
    assert "rest does not determine" in repr(found)


def test_a_load_at_rest_has_no_inertia_in_its_text(ur5):
    q = draw_positions(4)
    found = ur5.payload(jounce.Poses(q, with_ball(ur5, 1.7, COM).gravity_forces(q)))
    text = str(found)
    assert "rest does not determine the moments of inertia of the load" in text
    assert "mass of the first and the last poses" in text
    assert [word for word in ("Ixx", "setLoad", "JX") if word in text] == []
    assert found.settings["ur"] == "set_target_payload(1.7000, [0.02000, 0.01000, 0.05000])"
    assert found.unseen == found.undetermined


def test_joints_are_matched_by_name_and_unmeasured_ones_left_out(ur5):
    q, order = draw_positions(5), [3, 0, 5, 1, 2, 4]
    Q = with_ball(ur5, 1.7, COM).gravity_forces(q)
    Q[::4, 2], Q[5] = np.nan, np.nan
    names = [ur5.joint_names[k] for k in order]
    found = ur5.payload(jounce.Poses(q[:, order], Q[:, order], names))
    assert found.mass == pytest.approx(1.7, abs=1e-6)


@QUIET
def test_stated_deviations_are_those_of_the_result(ur5):
    """With known deviations those of parameters are in proportion to them, and few poses will do."""
    q = draw_positions(6, 5)
    poses = jounce.Poses(q, ur5.gravity_forces(q))
    one, two = (ur5.identify(poses, drives="offset", deviations=s) for s in (0.1, 0.2))
    assert [2 * row.deviation for row in one.table] == pytest.approx([row.deviation for row in two.table])


@QUIET
def test_torque_constants_follow_from_a_known_mass(ur5):
    rng, q = np.random.default_rng(7), draw_positions(7, 60)
    factors = np.array([1.0, 1.1, 0.95, 1, 1, 1])
    pair = [
        jounce.Poses(q, factors * arm.gravity_forces(q) + 0.01 * rng.normal(size=q.shape))
        for arm in (with_ball(ur5, 1.7, COM), ur5)
    ]
    found = ur5.payload(*pair, mass=1.7)
    assert found.factors[0][1:3] == pytest.approx(1 / factors[1:3], abs=0.005)
    assert np.isinf(found.factors[1][0])
    assert "not seen" in next(line for line in str(found).splitlines() if line.startswith("shoulder_pan_joint"))


@pytest.mark.parametrize("name", ["planar2r", "fivebar", "panda_elastic"])
def test_other_robots(name):
    """A planar arm, a closed loop and elastic joints: torques of the identified robot are those measured."""
    robot = jounce.load(name)
    rng = np.random.default_rng(8)
    q = rng.uniform(-0.3, 0.3, (40, robot.n))
    Q = 1.1 * robot.gravity_forces(q) + 0.001 * rng.normal(size=q.shape)
    found = robot.identify(jounce.Poses(q, Q, angles="rad"), drives=False, prior=10.0)
    assert found.predicted == pytest.approx(Q, abs=0.02)
    assert "moments of inertia" in found.undetermined


UR5 = jounce.load("ur5")
POSES = draw_positions(9, 20)
TORQUES = UR5.gravity_forces(POSES)
LOADED = with_ball(UR5, 2, COM).gravity_forces(POSES)
ALIKE = np.tile(POSES[:1], (20, 1))
NOISE = np.random.default_rng(9).normal(size=POSES.shape)
test_refuses = QUIET(refusals({
    "poses that are alike": (
        lambda: UR5.identify(jounce.Poses(ALIKE, UR5.gravity_forces(ALIKE) + NOISE)),
        ["20 poses determine no inertial parameter", "differ by 0 rad", "expected poses that differ"],
    ),
    "poses that hardly differ": (
        lambda: UR5.identify(jounce.Poses(ALIKE + 1e-3 * NOISE, UR5.gravity_forces(ALIKE) + NOISE)),
        ["all deviations exceed sizes", "expected poses that differ more"],
    ),
    "a load in poses that hardly differ": (
        lambda: UR5.payload(jounce.Poses(ALIKE + 1e-3 * NOISE, UR5.gravity_forces(ALIKE) + NOISE[::-1])),
        ["20 poses do not determine the mass of the load", "expected poses that differ more"],
    ),
    "fewer torques than unknowns": (
        lambda: UR5.payload(jounce.Poses(POSES[:3], TORQUES[:3])),
        ["3 poses hold 18 measured torques for 20 unknowns", "expected 4 poses or more, or fewer drives"],
    ),
    "no freedom for deviations": (
        lambda: UR5.identify(jounce.Poses(POSES[:4], TORQUES[:4])),
        ["take 4 of 4 torques", "expected more poses, fewer drives, or deviations= of the torques"],
    ),
    "torques that are 0": (lambda: UR5.payload(jounce.Poses(POSES, 0 * TORQUES)), ["with the load are 0"]),
    "no gravity": (
        lambda: jounce.load("ur5", gravity=[0, 0, 0]).identify(jounce.Poses(POSES, NOISE)),
        ["gravity loads none", "expected a motion"],
    ),
    "degrees": (
        lambda: UR5.payload(jounce.Poses(np.rad2deg(POSES), TORQUES)),
        ["within limits if they were degrees", "Poses(..., angles='rad')"],
    ),
    "joints of another robot": (
        lambda: UR5.payload(jounce.Poses(POSES[:, :2], TORQUES[:, :2], ["a", "b"])),
        ["missing 'shoulder_pan_joint'", "unknown 'a', 'b'"],
    ),
    "too few joints": (lambda: UR5.payload(jounce.Poses(POSES[:, :2], TORQUES[:, :2])), ["poses of 2 joints"]),
    "a base that floats": (
        lambda: jounce.load("g1", base="floating").identify(jounce.Poses(np.zeros((3, 29)), np.ones((3, 29)))),
        ["has a floating base", "base='fixed'"],
    ),
    "options of logs": (
        lambda: UR5.identify(jounce.Poses(POSES, TORQUES), span=(0, 1)),
        ["span is for logs, and poses at rest have no times"],
    ),
    "several tables": (
        lambda: UR5.identify([jounce.Poses(POSES, TORQUES)] * 2),
        ["among several logs", "join them in one jounce.Poses"],
    ),
    "a page over time": (
        lambda: UR5.report(UR5.identify(jounce.Poses(POSES, TORQUES + 0.1 * NOISE))),
        ["shows torques over time, which poses at rest have not"],
    ),
    "a negative mass": (
        lambda: UR5.payload(jounce.Poses(POSES, TORQUES), jounce.Poses(POSES, LOADED)),
        ["the mass of the load is negative", "swapped"],
    ),
}))  # fmt: skip
