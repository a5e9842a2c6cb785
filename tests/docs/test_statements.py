"""Statements of pages about what jounce does and does not do are those of the code."""

from pathlib import Path

import numpy as np
import pytest

import jounce
from support.refusals import refusal

ROOT = Path(__file__).parents[2]


def excitation_refuses():
    for robot in (jounce.load("g1", base="floating"), jounce.load("fivebar")):
        refusal(lambda robot=robot: robot.with_limits(velocity=1.0, acceleration=1.0).excite(starts=1))


def orders_end(tmp_path):
    arm = jounce.load("planar2r")
    arm.codegen("c", 4, tmp_path / "four")
    refusal(lambda: arm.codegen("c", 5, tmp_path / "five"), "order")
    arm.compile(order=12)
    refusal(lambda: arm.compile(order=13), "order")


def limits_change_no_force():
    robot = jounce.load("planar2r")
    states = np.full((3, robot.n), 100.0)
    assert np.array_equal(robot.inverse_dynamics(*states), robot.with_limits(velocity=1.0).inverse_dynamics(*states))


def limits_are_kept():
    robot = jounce.load("iiwa14").with_limits("iiwa14")
    motion = jounce.Motion.trapezoidal(np.outer([0, 1], np.ones(7)), 3.0, 9.0).blended(0.05)
    assert robot.check(motion).verdict == "broken"
    for slower in (robot.slowdown(motion).motion, robot.retime(motion).motion):
        assert robot.check(slower).verdict == "kept"


def other_transmissions_are_left_out(tmp_path):
    text = (ROOT / "examples/panda.urdf").read_text(encoding="utf-8")
    joints = '<joint name="panda_joint6"/><joint name="panda_joint7"/>'
    wrist = f'<transmission name="t"><type>pr2_mechanism_model/WristTransmission</type>{joints}</transmission>'
    path = tmp_path / "geared.urdf"
    path.write_text(text.replace("</robot>", f"{wrist}</robot>"), encoding="utf-8")
    with pytest.warns(jounce.JounceWarning, match="as if each joint had its own motor: 1 of type WristTransmission"):
        geared = jounce.load(path)
    assert geared == jounce.load(ROOT / "examples/panda.urdf")


def identification_has_what_is_named():
    assert {"identify", "payload", "identify_stiffness"} <= {*dir(jounce.load("ur5"))}


STATEMENTS = {  # of a page, and what holds then
    ("limitations", "robots that float or have closed loops it refuses"): excitation_refuses,
    ("limitations", "native code to order 12, generated code to order 4"): orders_end,
    ("limitations", "Forces beyond limits are computed like any others."): limits_change_no_force,
    ("limitations", "`slowdown` and `retime` keep them"): limits_are_kept,
    ("limitations", "transmissions of URDF files of other types than"): other_transmissions_are_left_out,
    (
        "limitations",
        "[loads](howto/payload.md) and [stiffnesses](howto/stiffness.md)",
    ): identification_has_what_is_named,
    ("conventions", "limits are judged by `robot.check` and change no force"): limits_change_no_force,
}


@pytest.mark.parametrize(("statement", "check"), STATEMENTS.items(), ids=[words[:30] for _, words in STATEMENTS])
def test_a_statement_holds(statement, check, tmp_path):
    page, words = statement
    assert words in " ".join((ROOT / f"docs/{page}.md").read_text(encoding="utf-8").split())
    check(tmp_path) if "tmp_path" in check.__code__.co_varnames else check()
