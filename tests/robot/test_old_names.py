"""Old names work for one release beside the new ones, and warn with them."""

import inspect

import mujoco
import numpy as np
import pinocchio
import pytest

import jounce
from jounce import JounceError, JounceWarning
from jounce.core.deprecated import renamed, renamed_keywords


@renamed_keywords(base="moving_base")
def traced(order=2, *, moving_base=False):
    """What is traced."""
    return order, moving_base


def test_a_keyword_by_its_old_name_warns_with_the_new_one_where_it_is_written():
    with pytest.warns(JounceWarning, match=r"^base= of traced\(\) is deprecated, .*; write moving_base=$") as found:
        assert traced(1, base=True) == (1, True)
    assert found[0].filename == __file__
    assert traced(1, moving_base=True) == (1, True)


def test_a_keyword_by_both_names_is_refused():
    with pytest.raises(JounceError, match="write moving_base="):
        traced(base=True, moving_base=True)


def test_a_function_with_renamed_keywords_has_its_own_signature():
    assert list(inspect.signature(traced).parameters) == ["order", "moving_base"]
    assert traced.__doc__ == "What is traced."


def test_a_function_by_its_old_name_warns_with_the_new_call():
    with pytest.warns(JounceWarning, match=r"^report\(\) is deprecated, .*; write robot.report\(\.\.\.\)$"):
        assert renamed("report()", "robot.report(...)", max)(1, 2) == 2


ARM = "<body><joint/><geom size='1'/></body>"
MJCF = f"<mujoco><worldbody><body><freejoint/><geom size='1'/>{ARM}</body></worldbody></mujoco>"


def test_states_and_forces_by_their_old_names_are_those_of_the_new_ones():
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
    with pytest.warns(JounceWarning, match=r'write state_to\("pinocchio", Q=Q, model=...\)'):
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
