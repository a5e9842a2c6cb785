"""Springs and motors in robot files: what is written is read to the last bit, and mistakes name their line."""

import numpy as np
import pytest
from click.testing import CliRunner
from files import refusal

import jounce
from jounce.cli import main

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


def file(folder, text):
    path = folder / "arm.yaml"
    path.write_text(text)
    return path


def same(a, b):
    return all(np.array_equal(x, b.arrays[name]) for name, x in a.arrays.items())


@pytest.mark.parametrize("suffix", [".yaml", ".json"])
def test_springs_and_motors_come_back_to_the_last_bit(tmp_path, suffix):
    arm = jounce.load("panda_elastic").elastic(rotor={"panda_joint1": 1 / 3})
    jounce.save(arm.robot, tmp_path / f"arm{suffix}")
    again = jounce.load(tmp_path / f"arm{suffix}")
    assert same(again.mechanism.elasticity, arm.elasticity)
    assert again == arm.robot
    result = CliRunner().invoke(main, ["convert", str(tmp_path / f"arm{suffix}"), "-o", str(tmp_path / "copy.yaml")])
    assert result.exit_code == 0, result.output
    assert same(jounce.load(tmp_path / "copy.yaml").mechanism.elasticity, arm.elasticity)


def test_a_joint_that_the_section_leaves_out_is_rigid(tmp_path):
    arm = jounce.load(file(tmp_path, HEAD + SECTION)).elastic()
    e = arm.elasticity
    assert (e.stiffness.tolist(), e.rotor.tolist()) == ([300, np.inf], [0.3, 0])  # the armature is the rotor
    assert (e.viscous.tolist(), e.friction.tolist(), e.eps.tolist()) == ([0.5, 0], [0.1, 0], [0.02, 0.05])
    jounce.save(arm.robot, tmp_path / "copy.yaml")
    assert same(jounce.load(tmp_path / "copy.yaml").mechanism.elasticity, e)
    stiffer = arm.robot.elastic({"slide": 1e4}, rotor=2.0).elasticity
    assert (stiffer.stiffness.tolist(), stiffer.viscous.tolist()) == ([np.inf, 1e4], [0.5, 0])


def test_a_file_without_springs_takes_none():
    refusal(jounce.load("planar2r").elastic, "'planar2r' states no stiffness", "robot.elastic(stiffness)")
    assert jounce.load("planar2r").mechanism.elasticity is None


@pytest.mark.parametrize(
    ("mistake", "said"),
    [
        (("shoulder:", "elbow:"), [":14", "coordinate 'elbow'", "shoulder"]),
        (("stiffness: 300", "stiffness: 0"), [":12", "stiffness of joint 'shoulder' is 0", "N m/rad"]),
        (("stiffness: 300", "stiffness: -3"), ["stiffness of joint 'shoulder' is -3"]),
        (("stiffness: 300", "stiffness: .nan"), [":14", "stiffness", "a finite number"]),
        (("stiffness: 300", "rotor: 0, stiffness: 300"), ["rotor of joint 'shoulder' is 0", "kg m^2"]),
        (("stiffness: 300", "rigidity: 300"), [":14", "'rigidity'", "stiffness"]),
        (("viscous: 0.5", "viscous: -0.5"), [":14", "viscous", "0 or more"]),
        (("eps: 0.02", "eps: 0"), [":14", "eps", "above 0"]),
        (("  joints:", "  springs:"), ["'springs'", "joints"]),
    ],
)
def test_mistakes_are_refused_in_one_line(tmp_path, mistake, said):
    assert mistake[0] in SECTION
    refusal(lambda: jounce.load(file(tmp_path, HEAD + SECTION.replace(*mistake))), *said)


def test_the_bundled_arm_is_the_panda_on_springs():
    arm = jounce.load("panda_elastic")
    rigid = jounce.load("panda", lock={"panda_finger_joint1": 0.0})
    state = np.random.default_rng(0).normal(size=(3, 7))
    np.testing.assert_array_equal(arm.inverse_dynamics(*state), rigid.inverse_dynamics(*state))
    assert np.array_equal(jounce.load("panda_elastic", gravity=[0, 9.81, 0]).gravity, [0, 9.81, 0])
    said = CliRunner().invoke(main, ["info", "panda_elastic"]).stdout
    assert "panda_joint1  1000 N m/rad  0.60572 kg m^2" in said
