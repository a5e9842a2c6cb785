"""Old names work for one release beside the new ones, and warn with them."""

import inspect
import re

import mujoco
import numpy as np
import pinocchio
import pytest

import jounce
from jounce import JounceWarning
from jounce.core.deprecated import deprecate_function, deprecate_keywords
from support.commands import call
from support.refusals import expect_refusal, refusal


@deprecate_keywords(base="moving_base")
def traced(order=2, *, moving_base=False):
    """What is traced."""
    return order, moving_base


def test_an_old_keyword_warns_at_its_line_with_the_new_one():
    with pytest.warns(JounceWarning, match=r"^base= of traced\(\) is deprecated, .*; write moving_base=$") as found:
        assert traced(1, base=True) == (1, True)
    assert found[0].filename == __file__
    assert traced(1, moving_base=True) == (1, True)


def test_a_keyword_by_both_names_is_refused():
    refusal(lambda: traced(base=True, moving_base=True), "write moving_base=")


def test_a_function_with_renamed_keywords_has_its_own_signature():
    assert list(inspect.signature(traced).parameters) == ["order", "moving_base"]
    assert traced.__doc__ == "What is traced."


def test_a_function_by_its_old_name_warns_with_the_new_call():
    with pytest.warns(JounceWarning, match=r"^report\(\) is deprecated, .*; write robot.report\(\.\.\.\)$"):
        assert deprecate_function("report()", "robot.report(...)", max)(1, 2) == 2


ARM = "<body><joint/><geom size='1'/></body>"
MJCF = f"<mujoco><worldbody><body><freejoint/><geom size='1'/>{ARM}</body></worldbody></mujoco>"


def test_old_names_of_states_and_forces_give_the_new_ones():
    """Tuples and arrays, as before: a tuple of one vector where one is given."""
    model = pinocchio.buildSampleModelManipulator()
    robot, q, v = jounce.Robot.from_pinocchio(model), np.arange(6.0), np.ones(6)
    with pytest.warns(JounceWarning, match=r'write state_from\("pinocchio", q, v, a, model=...\)'):
        state = robot.state_from_pinocchio(q, v=v, model=model)
    np.testing.assert_array_equal(state.rates, robot.state_from("pinocchio", q, v, model=model).rates)
    with pytest.warns(JounceWarning, match=r'write state_to\("pinocchio", q, qd, q2d, model=...\)'):
        [vector] = robot.state_to_pinocchio(q, model=model)
    np.testing.assert_array_equal(vector, q)
    with pytest.warns(JounceWarning, match=r'write state_from\("pinocchio", q, forces=tau, model=...\).Q'):
        np.testing.assert_array_equal(robot.forces_from_pinocchio(v, model=model), v)
    with pytest.warns(JounceWarning, match=r'write state_to\("pinocchio", Q=Q, base=C, model=...\)'):
        np.testing.assert_array_equal(robot.forces_to_pinocchio(v, model=model), v)


def test_those_of_mujoco_take_the_old_names_of_its_vectors():
    model = mujoco.MjModel.from_xml_string(MJCF)
    robot, data = jounce.Robot.from_mujoco(model, base="floating"), mujoco.MjData(model)
    data.qpos[3:7], data.qfrc_applied[:] = 0.5, np.arange(7.0)
    with pytest.warns(JounceWarning, match=r'write state_from\("mujoco", qpos, qvel, qacc, model=...\)'):
        state = robot.state_from_mujoco(qpos=data.qpos, qvel=data.qvel, model=model)
    assert (len(state.rates), len(state.base), state.Q) == (2, 2, None)
    with pytest.warns(JounceWarning, match=r'write state_to\("mujoco", q, qd, q2d, model=...\)'):
        qpos, _ = robot.state_to_mujoco(*state.rates, base=state.base, model=model)
    np.testing.assert_allclose(qpos, data.qpos, atol=1e-15)
    with pytest.warns(JounceWarning, match=r'write state_from\("mujoco", qpos, forces=qfrc, model=...\).Q'):
        Q = robot.forces_from_mujoco(data.qfrc_applied, data.qpos, model=model)
    np.testing.assert_array_equal(Q, robot.state_from("mujoco", qpos, forces=data.qfrc_applied, model=model).Q)
    with pytest.warns(JounceWarning, match=r'write state_to\("mujoco", Q=Q, base=C, model=...\)'):
        qfrc = robot.forces_to_mujoco(Q, base=state.base[0], model=model)
    np.testing.assert_allclose(qfrc, data.qfrc_applied, atol=1e-14)


PLANAR = jounce.load("planar2r")
MOTION = jounce.Motion.polynomial([[0, 2], [0, 0.5]], 1.0)
T = np.linspace(0, 1, 101)
FUNCTIONS = {
    "identify": (MOTION, PLANAR.forces_along(MOTION, T, order=0).forces[0]),
    "report": (MOTION,),
    "excite": (),
    "codegen": ("latex",),
    "symbolic": (),
    "casadi_function": (),
}
GIVEN = {"identify": {"t": T, "drives": False}, "excite": {"period": 4, "starts": 1}, "casadi_function": {"order": 0}}


@pytest.mark.filterwarnings("ignore:.*do not determine:jounce.JounceWarning")
@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_function_of_one_robot_calls_the_method(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    robot = PLANAR.with_limits(lower=-2, upper=2, velocity=3, effort=[60, 20])
    with pytest.warns(JounceWarning, match=rf"^jounce\.{name}\(robot, \.\.\.\) is .*; write robot\.{name}\(\.\.\.\)$"):
        found = getattr(jounce, name)(robot, *FUNCTIONS[name], **GIVEN.get(name, {}))
    monkeypatch.chdir(tmp_path.parent)
    again = {"directory": tmp_path / "again"} if name == "codegen" else {}
    expected = getattr(robot, name)(*FUNCTIONS[name], **GIVEN.get(name, {}), **again)
    assert type(found) is type(expected)
    assert name in dir(robot)
    assert name not in jounce.__all__


@pytest.mark.parametrize("name", FUNCTIONS)
def test_such_a_function_refuses_what_is_no_robot(name):
    with pytest.warns(JounceWarning), expect_refusal(f"^{name}() expects a jounce.Robot, got dict; try jounce.load$"):
        getattr(jounce, name)({}, *FUNCTIONS[name])


def test_the_motion_of_the_base_is_asked_for_by_its_old_name(tmp_path):
    calls = (
        lambda **given: PLANAR.compile(order=0, **given).computation,
        lambda **given: PLANAR.codegen("python", 0, **given).operations,
        lambda **given: PLANAR.casadi_function(order=0, **given).name_in(),
        lambda **given: sorted(PLANAR.symbolic(**given).series),
    )
    for i, method in enumerate(calls):
        folders = [{"directory": tmp_path / name} if i == 1 else {} for name in ("old", "new")]
        with pytest.warns(JounceWarning, match=r"^base= of \w+\(\) is deprecated, .*; write moving_base=$"):
            found = method(base=True, **folders[0])
        assert found == method(moving_base=True, **folders[1])


def test_what_force_allowed_has_a_name_of_its_own(tmp_path):
    noisy = {"t": T, "joint1": T + 0.005 * np.random.default_rng(0).normal(size=101), "joint2": T}
    with pytest.warns(JounceWarning, match=r"^force= of load_motion\(\) is .*; write allow_noise=$"):
        motion = jounce.load_motion(noisy, PLANAR, force=True)
    q = np.stack([noisy["joint1"], T], axis=-1)
    with pytest.warns(JounceWarning, match=r"^force= of fit\(\) is .*; write allow_noise=$"):
        np.testing.assert_array_equal(jounce.Motion.fit(T, q, force=True)(0.5), motion(0.5))
    with pytest.warns(JounceWarning, match=r"^force= of with_base\(\) is .*; write allow_noise=$"):
        MOTION.with_base(T, np.tile(np.eye(4), (101, 1, 1)), force=False)
    PLANAR.codegen("latex", 0, tmp_path)
    with pytest.warns(JounceWarning, match=r"^force= of codegen\(\) is .*; write overwrite=$"):
        PLANAR.codegen("latex", 0, tmp_path, force=True)


@pytest.mark.filterwarnings("default::jounce.JounceWarning")
@pytest.mark.parametrize(
    ("command", "new"),
    [
        ("codegen planar2r --lang latex --order 0 -o .", "--overwrite"),
        ("run planar2r log.csv -o o.csv", "--allow-noise"),
    ],
)
def test_options_of_commands_by_their_old_names_act_and_warn(command, new, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rows = (f"{t},{x},{t}" for t, x in zip(T, T + 0.005 * np.random.default_rng(0).normal(size=101), strict=True))
    (tmp_path / "log.csv").write_text("\n".join(["t,joint1,joint2", *rows]))
    if new == "--overwrite":
        PLANAR.codegen("latex", 0, tmp_path / "c")
        command = command.replace("-o .", "-o c")
    assert call(*command.split()).exit_code == 2
    done = call(*command.split(), "--force")
    assert done.exit_code == 0, done.output
    assert re.search(f"^Warning: --force is deprecated, .*; write {new}$", done.output, re.MULTILINE)
    done = call(*command.split(), new)
    assert (done.exit_code, "Warning" in done.output) == (0, False)
    shown = call(command.split()[0], "--help").output
    assert new in shown
    assert "--force" not in shown


def test_old_attributes_cost_calls_of_methods_nothing():
    """With a `__getattr__` in its class, Python looks up every attribute of a robot by a slower way."""
    assert not hasattr(jounce.Robot, "__getattr__")
    assert not hasattr(jounce.load("planar2r"), "along")
