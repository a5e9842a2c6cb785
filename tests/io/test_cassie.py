"""A biped in the manner of Cassie: balls in the tree, loops by equality constraints, springs, a pelvis that floats."""

import mujoco
import numpy as np
import pytest

import jounce
from jounce.model import positions
from support.biped import BIPED
from support.robots import relative_error

SQUAT = {
    "thigh": 0.5,
    "knee": -0.9,
    "tarsus": 0.8,
    "foot": -0.6,
    "hip": 0.05,
    "heel": 0.02,
    "shin": -0.01,
    "crank": 0.4,
}


@pytest.fixture(scope="module")
def biped_and_model(tmp_path_factory):
    path = tmp_path_factory.mktemp("biped") / "biped.xml"
    path.write_text(BIPED)
    with pytest.warns(jounce.JounceWarning, match="loops stay open.*'left-achilles-rod' of 'biped' is a ball joint"):
        robot = jounce.load(path, base="floating")
    model = mujoco.MjModel.from_xml_path(str(path))
    for train in ("dof_armature", "dof_damping", "jnt_stiffness"):
        getattr(model, train)[:] = 0
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    return robot, model


def biped_squat(robot, t, count):
    """q, qd, ... of a squat in which each ball turns about an axis of its own, and C, V, Vd, ... of the pelvis."""
    s = [np.sin(2 * t + k * np.pi / 2) * 2.0**k for k in range(count)]
    m = robot.mechanism
    shares = np.array([SQUAT.get(name.partition("-")[2], 0) for name in m.coordinates])
    rates = [shares @ positions.single_positions(m) * s[0], *(shares * value for value in s[1:])]
    for x in positions.multiscrew_joints(m).values():
        axis = np.array([0.6, 0, 0.8]) if x.name.startswith("left") else np.array([0, 0.28, -0.96])
        rates[0][x.numbers] = [*axis * np.sin(0.2 * s[0]), np.cos(0.2 * s[0])]
        for rate, value in zip(rates[1:], s[1:], strict=True):
            rate[x.coordinates] = 0.4 * value * axis
    C = np.eye(4)
    C[2, 3] = 1 - 0.2 * s[0]
    return rates, (C, *(np.array([0, 0, 0, 0, 0, -0.2 * value]) for value in s[1:]))


def test_it_loads_without_an_edit(biped_and_model):
    robot, model = biped_and_model
    assert (robot.nq, robot.nv) == (model.nq, model.nv)
    assert {x.name for x in positions.multiscrew_joints(robot.mechanism).values()} == {
        f"{side}-{rod}-rod" for side in ("left", "right") for rod in ("achilles", "plantar")
    }
    assert [loop.joint for loop in robot.mechanism.loops] == ["spherical"] * 4


@pytest.mark.parametrize("method", ["recursion", "closed_form"])
def test_forces_along_a_squat_of_its_tree_are_those_of_mujoco(biped_and_model, method):
    robot, model = biped_and_model
    data = mujoco.MjData(model)
    for t in np.linspace(0, 3, 7):
        rates, base = biped_squat(robot, t, 3)
        data.qpos[:], data.qvel[:], data.qacc[:] = robot.state_to("mujoco", *rates, base=base, model=model)
        mujoco.mj_inverse(model, data)
        theirs = robot.state_from("mujoco", data.qpos, forces=data.qfrc_inverse, model=model).Q
        assert relative_error(robot.inverse_dynamics(*rates, base=base, method=method), theirs) < 1e-12


def test_rates_of_forces_along_a_squat_are_those_of_differences(biped_and_model):
    """Seven-point differences of the forces of order 0, which are MuJoCo's."""
    robot, _ = biped_and_model
    h, stencil = 0.01, np.array([-1, 9, -45, 0, 45, -9, 1]) / 60
    for t in (0.3, 1.1):
        *_, Qd = robot.inverse_dynamics(*(state := biped_squat(robot, t, 4))[0], base=state[1])
        along = [biped_squat(robot, t + k * h, 3) for k in range(-3, 4)]
        values = [robot.inverse_dynamics(*rates, base=base) for rates, base in along]
        assert relative_error(np.tensordot(stencil, values, 1) / h, Qd) < 1e-9
