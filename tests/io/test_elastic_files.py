"""Springs and motors in robot files: what is written is read to the last bit, and mistakes name their line."""

import numpy as np
import pytest

import jounce
from support.commands import call
from support.refusals import refusal

HEAD = """name: arm
units: SI
bodies:
  - name: upper
    parent: ground
    joint: {name: shoulder, type: revolute, axis: [0, 1, 0], drive: {armature: 0.3}}
    inertia: {mass: 2, com: [0, 0, -0.2], inertia: [0.03, 0, 0, 0.03, 0, 0.002]}
  - name: lower
    parent: upper
    joint: {name: slide, type: prismatic, axis: [0, 0, 1]}
    inertia: {mass: 1, com: [0, 0, -0.15], inertia: [0.01, 0, 0, 0.01, 0, 0.001]}
"""
SECTION = """elastic:
  joints:
    shoulder: {stiffness: 300, viscous: 0.5, friction: 0.1, eps: 0.02}
"""


def write_file(folder, text):
    path = folder / "arm.yaml"
    path.write_text(text)
    return path


def same_arrays(a, b):
    return all(np.array_equal(x, b.arrays[name]) for name, x in a.arrays.items())


@pytest.mark.parametrize("suffix", [".yaml", ".json"])
def test_springs_and_motors_come_back_to_the_last_bit(tmp_path, suffix):
    arm = jounce.load("panda_elastic").elastic(rotor={"panda_joint1": 1 / 3})
    jounce.save(arm, tmp_path / f"arm{suffix}")
    again = jounce.load(tmp_path / f"arm{suffix}")
    assert same_arrays(again.mechanism.elasticity, arm.elasticity)
    assert again == arm
    result = call("convert", tmp_path / f"arm{suffix}", "-o", tmp_path / "copy.yaml")
    assert result.exit_code == 0, result.output
    assert same_arrays(jounce.load(tmp_path / "copy.yaml").mechanism.elasticity, arm.elasticity)


def test_a_joint_that_the_section_leaves_out_is_rigid(tmp_path):
    arm = jounce.load(write_file(tmp_path, HEAD + SECTION)).elastic()
    e = arm.elasticity
    assert (e.stiffness.tolist(), e.rotor.tolist()) == ([300, np.inf], [0.3, 0])  # the armature is the rotor
    assert (e.viscous.tolist(), e.friction.tolist(), e.eps.tolist()) == ([0.5, 0], [0.1, 0], [0.02, 0.05])
    jounce.save(arm, tmp_path / "copy.yaml")
    assert same_arrays(jounce.load(tmp_path / "copy.yaml").mechanism.elasticity, e)
    stiffer = arm.elastic({"slide": 1e4}, rotor=2.0).elasticity
    assert (stiffer.stiffness.tolist(), stiffer.viscous.tolist()) == ([np.inf, 1e4], [0.5, 0])


def test_a_file_without_springs_takes_none():
    refusal(jounce.load("planar2r").elastic, "joint stiffness of 'planar2r' is unknown", "robot.elastic(stiffness)")
    assert jounce.load("planar2r").mechanism.elasticity is None


@pytest.mark.parametrize(("mistake", "said"), [
    (("shoulder:", "elbow:"), [":14", "coordinate 'elbow'", "shoulder"]),
    (("stiffness: 300", "stiffness: 0"), [":12", "stiffness of joint 'shoulder' is 0", "N m/rad"]),
    (("stiffness: 300", "stiffness: -3"), ["stiffness of joint 'shoulder' is -3"]),
    (("stiffness: 300", "stiffness: .nan"), [":14", "stiffness", "a finite number"]),
    (("stiffness: 300", "rotor: 0, stiffness: 300"), ["rotor of joint 'shoulder' is 0", "kg m^2"]),
    (("stiffness: 300", "rigidity: 300"), [":14", "'rigidity'", "stiffness"]),
    (("viscous: 0.5", "viscous: -0.5"), [":14", "viscous", "0 or more"]),
    (("eps: 0.02", "eps: 0"), [":14", "eps", "above 0"]),
    (("  joints:", "  springs:"), ["'springs'", "joints"]),
])  # fmt: skip
def test_mistakes_are_refused_in_one_line(tmp_path, mistake, said):
    assert mistake[0] in SECTION
    refusal(lambda: jounce.load(write_file(tmp_path, HEAD + SECTION.replace(*mistake))), *said)


def test_the_bundled_arm_is_the_panda_on_springs():
    arm = jounce.load("panda_elastic")
    rigid = jounce.load("panda", lock={"panda_finger_joint1": 0.0})
    state = np.random.default_rng(0).normal(size=(3, 7))
    np.testing.assert_array_equal(arm.inverse_dynamics(*state), rigid.inverse_dynamics(*state))
    assert np.array_equal(jounce.load("panda_elastic", gravity=[0, 9.81, 0]).gravity, [0, 9.81, 0])
    said = call("info", "panda_elastic").stdout
    assert "panda_joint1  1000 N m/rad  0.60572 kg m^2" in said


LAWS = """elastic:
  coupling: 0
  damping_terms: 3
  joints:
    shoulder:
      spring: {k: 300, k3: 2000}
      damping: 0.4
      motor: {gear: -100, inertia: 5.0e-5, body: world, friction: 0.01}
    slide:
      spring: {deflections: [-3, -2, -1, 1, 2, 3], forces: [-39, -14, -4, 4, 14, 39]}
      rotor: 2
      motor: {body: upper, constant: 0.1, axis: [1, 0, 0]}
"""


@pytest.mark.parametrize("suffix", [".yaml", ".json"])
def test_springs_of_every_kind_and_motors_come_back(tmp_path, suffix):
    robot = jounce.load(write_file(tmp_path, HEAD.replace(", drive: {armature: 0.3}", "") + LAWS))
    e = robot.mechanism.elasticity
    assert (e.level, [law and type(law).__name__ for law in e.springs]) == (0, ["DampedSpring", "SpringTable"])
    assert (e.springs[0].damping, e.springs[0].terms, e.springs[0].spring) == (0.4, 3, jounce.CubicSpring(300, 2000))
    assert (e.rotor[0], e.friction[0]) == pytest.approx((0.5, 1.0))
    jounce.save(robot, tmp_path / f"copy{suffix}")
    again = jounce.load(tmp_path / f"copy{suffix}").mechanism.elasticity
    assert same_arrays(again, e)
    assert (again.springs, again.motors, again.level) == (e.springs, e.motors, e.level)


def test_two_motors_on_one_joint_come_back(tmp_path):
    text = "elastic: {joints: {shoulder: {spring: [{k: 30, k3: 900}, {k: 20, k3: 800}], rotor: 0.1}}}\n"
    robot = jounce.load(write_file(tmp_path, HEAD.replace(", drive: {armature: 0.3}", "") + text))
    jounce.save(robot, tmp_path / "copy.yaml")
    again = jounce.load(tmp_path / "copy.yaml").mechanism.elasticity
    assert again.springs == robot.mechanism.elasticity.springs
    assert isinstance(again.springs[0], jounce.AntagonisticSprings)


@pytest.mark.parametrize(("section", "said"), [
    ("shoulder: {spring: {k: -3}}", [":14", "expected a stiffness k above 0"]),
    ("shoulder: {spring: {k3: 3}}", [":14", "no 'k'"]),
    ("shoulder: {spring: {deflections: [0, 1, 2, 3, 4, 5], forces: [0, 2, 1, 3, 4, 5]}}",
     [":14", "forces do not rise from row 1 (2) to 2 (1)", "monotone"]),
    ("shoulder: {spring: [{k: 3}]}", [":14", "two with a motor each"]),
    ("shoulder: {stiffness: 3, spring: {k: 3}}", ["has a stiffness and a spring"]),
    ("shoulder: {stiffness: 3, damping: -1}", [":14", "damping", "0 or more"]),
    ("shoulder: {stiffness: 3, motor: {gear: 0}}", [":14", "gear of a motor is 0"]),
    ("shoulder: {stiffness: 3, motor: {body: hand}}", ["motor of joint 'shoulder'", "'hand'"]),
    ("shoulder: {stiffness: 3, motor: {ratio: 3}}", [":14", "'ratio'", "gear"]),
])  # fmt: skip
def test_mistakes_in_springs_and_motors_are_refused(tmp_path, section, said):
    text = f"elastic:\n  joints:\n    {section}\n"
    refusal(lambda: jounce.load(write_file(tmp_path, HEAD + text)), *said)


def test_a_spring_function_is_not_written(tmp_path):
    arm = jounce.load("planar2r").elastic(spring=lambda delta: 300 * delta + 2e3 * delta**3, rotor=0.1)
    refusal(lambda: jounce.save(arm, tmp_path / "arm.yaml"), "spring of joint 'joint1' is a function", "SpringTable")
    assert not (tmp_path / "arm.yaml").exists()
