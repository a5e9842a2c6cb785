"""Loops of MJCF files: connections and welds, of bodies and of sites; MuJoCo's own constraints say the same."""

import numpy as np
import pytest

import jounce

mujoco = pytest.importorskip("mujoco")

ROD = "<geom type='capsule' fromto='0 0 0 {} {}' size='.01'/>"
CRANK = f"<body name='crank' euler='0 .2 0'><joint name='crank' axis='0 1 0'/>{ROD.format(0, '0 .1')}"
COUPLER = f"<body name='rod' pos='0 0 .1'><joint name='rod' axis='0 1 0'/>{ROD.format('.3 0', '.1')}"
ROCKER = f"<body name='rocker' pos='.3 0 0'><joint name='rocker' axis='0 1 0' ref='.3'/>{ROD.format('0 0', '.2')}"
PIN = "<site name='tip' pos='.3 0 .1'/></body></body>"
TIP = "<body name='pin' pos='0 0 .2'><joint name='pin' axis='0 1 0'/></body>"
FORMS = {
    "connect": (PIN, "", "<connect body1='rod' body2='rocker' anchor='.3 0 .1'/>"),
    "connect sites": (PIN, "<site name='top' pos='0 0 .2'/>", "<connect site1='tip' site2='top'/>"),
    "weld": (
        PIN,
        TIP.replace("/></body>", "/><geom size='.001' mass='1e-6'/></body>"),
        "<weld body1='rod' body2='pin'/>",
    ),
}


def model(pin, top, equality, motor="<motor joint='crank'/>"):
    tree = f"{CRANK}{COUPLER}{pin}{ROCKER}{top}</body>"
    ends = f"<equality>{equality}</equality><actuator>{motor}</actuator>"
    return f"<mujoco model='four'><compiler angle='radian'/><worldbody>{tree}</worldbody>{ends}</mujoco>"


@pytest.mark.parametrize("form", FORMS)
def test_a_file_with_loops_is_a_closed_robot(form, tmp_path):
    (tmp_path / "four.xml").write_text(model(*FORMS[form]))
    robot = jounce.load(tmp_path / "four.xml")
    assert robot.joint_names == ("crank",)
    assert robot.mechanism.loops[0].joint == ("fixed" if form == "weld" else "spherical")
    m = mujoco.MjModel.from_xml_path(str(tmp_path / "four.xml"))
    d = mujoco.MjData(m)
    q, qd, tau = np.array([0.3]), np.array([0.8]), np.array([0.2])
    d.qpos, d.qvel = robot.coordinates(q, qd)
    mujoco.mj_fwdPosition(m, d)
    assert np.abs(d.efc_pos[: d.ne]).max() < 1e-12  # MuJoCo finds the loops closed
    J = d.efc_J.reshape(-1, m.nv)[: d.ne]
    np.testing.assert_allclose(J @ d.qvel, 0, atol=1e-12)  # and at rest
    F = robot.coordinates(q, [1.0])[1]
    MF, M_qacc = np.zeros((2, m.nv))
    mujoco.mj_mulM(m, d, MF, F)
    np.testing.assert_allclose(robot.mass_matrix(q), [[F @ MF]], rtol=1e-8)
    q2d = robot.forward_dynamics(q, qd, tau)
    d.qacc = robot.coordinates(q, qd, q2d)[2]
    mujoco.mj_fwdVelocity(m, d)
    mujoco.mj_mulM(m, d, M_qacc, d.qacc)
    np.testing.assert_allclose(F @ (M_qacc + d.qfrc_bias), tau, rtol=1e-8)


def test_loops_that_actuators_do_not_determine_stay_open(tmp_path):
    (tmp_path / "four.xml").write_text(model(*FORMS["connect"], motor=""))
    with pytest.warns(
        jounce.JounceWarning, match=r"loops stay open, robot\.closed\(actuated=\[\.\.\.\]\) closes them: no j"
    ):
        tree = jounce.load(tmp_path / "four.xml")
    assert tree.n == 3
    closed = tree.closed(actuated=["rocker"])
    assert closed.n == 1
    jounce.save(closed, tmp_path / "four.yaml")
    assert jounce.load(tmp_path / "four.yaml") == closed
