"""Currents of motors: torques by constants and gear ratios, and torques that are refused as they may be currents."""

import json
from dataclasses import replace

import numpy as np
import pytest

import jounce
from jounce.identification.force_checks import MAX_SIZE_RATIO, MIN_TORQUE_SCALE, scale_notes
from support.commands import call, run
from support.refusals import expect_refusal, refusal, refused

T = np.linspace(0, 6, 1201)
CONSTANTS, GEARS = np.array([0.11, 0.09, 0.07]), np.array([101.0, -101.0, 51.0])
QUIET = pytest.mark.filterwarnings("ignore::jounce.JounceWarning")  # what notes hold


@pytest.fixture(scope="module")
def columns(arm, motion):
    """A log of positions with all rates, its torques with friction, and the currents that make them."""
    rates, rng = motion(T, 2), np.random.default_rng(1)
    Q = 1.2 * arm.inverse_dynamics(*rates) + 3 * np.tanh(rates[1] / 0.05) + 0.05 * rng.normal(size=rates[0].shape)
    names, table = arm.joint_names, {"t": T}
    for symbol, rate in zip(("q", "qd", "q2d"), rates, strict=True):
        table |= {f"{name}.{symbol}": x for name, x in zip(names, rate.T, strict=True)}
    of_torques = {f"tau_{name}": x for name, x in zip(names, Q.T, strict=True)}
    of_currents = {f"current_{name}": x for name, x in zip(names, (Q / CONSTANTS / GEARS).T, strict=True)}
    return table, of_torques, of_currents


def load_log(arm, columns, **options):
    return jounce.load_motion(columns, arm, order=0, **options)


def by_joint(arm, values):
    return dict(zip(arm.joint_names, values.tolist(), strict=True))


@QUIET
def test_currents_with_constants_give_what_torques_give(arm, columns):
    table, torques, currents = columns
    expected = load_log(arm, table | torques)
    found = load_log(arm, table | currents, torque_constants=CONSTANTS, gear_ratios=by_joint(arm, GEARS))
    np.testing.assert_allclose(found.torques[1], expected.torques[1], rtol=1e-15)
    assert "torques are currents, as 'current_shoulder_pan_joint', times torque constants" in found.notes[0]
    identified, reference = (arm.identify(log, drives=("friction",)) for log in (found, expected))
    values = [[row.value for row in result.table] for result in (identified, reference)]
    np.testing.assert_allclose(*values, rtol=1e-9, atol=1e-12)
    load, reference_load = (arm.payload(log, drives=("friction",)) for log in (found, expected))
    np.testing.assert_allclose(load.parameters, reference_load.parameters, rtol=1e-8, atol=1e-10)


def test_constants_are_of_all_joints_or_each_and_columns_have_units(arm, columns):
    table, torques, currents = columns
    Q = np.stack([*currents.values()], axis=1)
    for constants, expected in ((0.5, 0.5), ([1, 2, 3], [1, 2, 3]), (by_joint(arm, CONSTANTS), CONSTANTS)):
        found = load_log(arm, table | currents, torque_constants=constants)
        np.testing.assert_array_equal(found.torques[1], Q * expected)
    in_mA = {f"{name} [mA]": 1e3 * x for name, x in currents.items()}
    np.testing.assert_allclose(load_log(arm, table | in_mA, torque_constants=2).torques[1], 2 * Q, rtol=1e-15)
    # Columns of currents go before those of torques, and these serve without the others.
    both = load_log(arm, table | torques | currents, torque_constants=2)
    np.testing.assert_array_equal(both.torques[1], 2 * Q)
    efforts = load_log(arm, table | torques, torque_constants=2)
    np.testing.assert_array_equal(efforts.torques[1], 2 * np.stack([*torques.values()], axis=1))
    # Torques of now are torques.
    now = dict(zip((f"current_torque_{name}" for name in arm.joint_names), currents.values(), strict=True))
    np.testing.assert_array_equal(load_log(arm, table | now, torques="current_torque_{joint}").torques[1], Q)


@pytest.mark.parametrize(("options", "words"), [
    ({"torque_constants": [1, 2]}, ["torque_constants has 2 numbers; expected 3 in the order of the joints, shoulder"]),
    ({"torque_constants": {"wrist": 1}}, ["torque_constants: unknown joint 'wrist'; available: shoulder_pan_joint"]),
    ({"torque_constants": {"elbow_joint": 1}}, ["torque_constants: no number for shoulder_pan_joint, shoulder_lift_"]),
    ({"torque_constants": 0}, ["torque_constants is 0; expected a number", "none 0"]),
    ({"torque_constants": [1, 0, 1]}, ["torque_constants is [1, 0, 1]; expected a number", "none 0"]),
    ({"torque_constants": {"elbow_joint": 0}}, ["torque_constants of 'elbow_joint' is 0; expected a number"]),
    ({"torque_constants": np.nan}, ["torque_constants is nan; expected a number"]),
    ({"torque_constants": {}}, ["torque_constants is empty"]),
    ({"torque_constants": "0.1"}, ["torque_constants"]),
    ({"torque_constants": 1, "gear_ratios": [1, 2]}, ["gear_ratios has 2 numbers; expected 3"]),
    ({"gear_ratios": 100}, ["gear_ratios is of motors whose currents are read; give torque_constants too"]),
    ({"torques": "current_{joint}"}, ["column 'current_shoulder_pan_joint' holds a current, and torques are expected;",
                                      "give torque_constants= of jounce.load_motion, N m/A"]),
])  # fmt: skip
def test_bad_constants_are_refused(arm, columns, options, words):
    table, _, currents = columns
    refusal(lambda: load_log(arm, table | currents, **options), *words)


def test_units_and_columns_that_do_not_fit_are_refused(arm, columns):
    table, torques, currents = columns
    amperes = {f"tau_{name} [A]": x for name, x in zip(arm.joint_names, currents.values(), strict=True)}
    refusal(lambda: load_log(arm, table | amperes), "column 'tau_shoulder_pan_joint [A]' holds a current")
    stated = {f"{name} [Nm]": x for name, x in torques.items()}
    with expect_refusal("states 'Nm'; expected A or mA, or no torque_constants if it holds torques"):
        load_log(arm, table | stated, torque_constants=1)
    refusal(lambda: load_log(arm, table, torque_constants=1), "torque_constants: no columns of currents; expected")
    refusal(lambda: jounce.load_motion("paper", jounce.load("iiwa14"), torque_constants=1), "leave it out")
    refusal(lambda: arm.identify(load_log(arm, table | currents)), "the motion has no measured forces")


# Torques that may be currents.
@pytest.mark.parametrize("factors", [0.2, 0.05, [0.2, 0.05, 0.1], 1000])
def test_torques_of_another_scale_are_refused_unless_read_as_given(arm, columns, factors):
    table, torques, _ = columns
    log = load_log(arm, table | torques)
    log = replace(log, torques=(T, log.torques[1] * factors))
    words = "torques of shoulder_pan_joint, shoulder_lift_joint, elbow_joint are ", " times those of the model"
    cure = "expected torque_constants= (N m/A) and gear_ratios= of jounce.load_motion, or torques_as_given=True"
    for method, logs, place in ((arm.identify, [log], "^torques"), (arm.payload, [log, log], "^log with the load: ")):
        refusal(lambda method=method, logs=logs: method(*logs), place, *words, cure)
        with pytest.warns(jounce.JounceWarning):
            found = method(*logs, torques_as_given=True)
        assert any(words[0] in note and note.endswith("; read as given") for note in found.notes)
    with expect_refusal("torques_as_given is 1; expected True or False"):
        arm.identify(log, torques_as_given=1)


def scaled(scales, follow=1.0, friction=0.0):
    """Descriptions of torques of joints that are some scales times the model's, which they follow by a share."""
    rng = np.random.default_rng(3)
    Q, qd, other = 30 * rng.normal(size=(3, 2000, len(scales)))
    followed = np.sqrt(follow) * Q + np.sqrt(1 - follow) * other
    tau = scales * followed + friction * np.sign(qd) + 5
    return scale_notes([f"j{k}" for k in range(len(scales))], np.ones_like(Q), np.stack([tau, Q, qd]), as_given=True)


@pytest.mark.parametrize(("change", "refused"), [(0.97, True), (1.03, False)])
def test_both_sides_of_the_thresholds(change, refused):
    """Of the scale, of the number of joints, and of how closely torques follow the model's."""
    for friction in (0.0, 50.0):
        assert (len(scaled(np.full(3, MIN_TORQUE_SCALE * change), friction=friction)) == 1) == refused
        assert (len(scaled(np.full(3, MAX_SIZE_RATIO / change), friction=friction)) == 1) == refused
    low, right = 0.1, 1.0
    assert len(scaled(np.array([low, low, low, right, right]))) == 1
    assert scaled(np.array([low, low, right, right])) == []
    assert len(scaled(np.array([low]))) == 1
    assert scaled(np.array([low, low]), follow=np.array([0.8, 0.5])) == []
    assert len(scaled(np.full(3, low), follow=0.8)) == 1
    assert scaled(np.full(3, low), follow=0.7) == []
    assert scaled(np.full(3, -low)) == []


@pytest.mark.sweep(40)
@pytest.mark.parametrize("seed", range(6))
def test_wrong_masses_and_friction_are_no_currents(seed, motion):
    """A log with friction next to models whose bodies are wrong by exp(0.7 n): never refused, its fifth as a rule."""
    rng, ur5 = np.random.default_rng(seed), jounce.load("ur5")
    q, qd, q2d = (rng.normal(size=(6, 3)) @ x.T for x in motion(T, 2))
    true = ur5.inverse_dynamics(q.T, qd.T, q2d.T)
    tau = 0.85 * true + rng.uniform(2, 8, 6) * np.tanh(qd.T / 0.03) + 0.3 * rng.normal(size=true.shape)
    p = ur5.inertial_parameters.reshape(-1, 10) * np.exp(0.7 * rng.normal(size=(6, 1)))
    model = ur5.with_inertial_parameters(p.ravel()).inverse_dynamics(q.T, qd.T, q2d.T)
    weights = np.ones_like(tau)
    assert scale_notes(ur5.joint_names, weights, np.stack([tau, model, qd.T]), as_given=True) == []
    assert len(scale_notes(ur5.joint_names, weights, np.stack([tau / 5, true, qd.T]), as_given=True)) == 1
    assert len(scale_notes(ur5.joint_names, weights, np.stack([tau / 20, model, qd.T]), as_given=True)) == 1


# The commands.
@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Logs of a plane arm, with torques, currents and motors, and files of constants."""
    folder, robot = tmp_path_factory.mktemp("currents"), jounce.load("planar2r")
    motion = jounce.Motion.fourier([0.3, 0.2], [[0.5, 0.2], [0.1, 0.4]], [[0.1, 0.3], [0.5, 0.2]], 3.0, 6.0)
    q, qd, q2d = motion(T, 2)
    Q = robot.inverse_dynamics(q, qd, q2d)
    names = [f"joint{j}{rate}" for rate in (".q", ".qd", ".q2d") for j in (1, 2)]
    kinds = ("tau_joint1", "tau_joint2"), ("current_joint1", "current_joint2"), ("theta_joint1", "theta_joint2")
    header = ",".join(["t", *names, *sum(kinds, ())])
    table = np.column_stack([T, q, qd, q2d, Q, Q / [8.0, 5.0], q + Q / [800.0, 600.0]])
    np.savetxt(folder / "log.csv", table, "%.17g", ",", header=header, comments="")
    for name, text in {
        "list.yaml": "[8, 5]\n", "joints.json": '{"joint2": 5, "joint1": 8}', "column.csv": "constant\n8\n5\n",
        "row.csv": "joint2,joint1\n5,8\n", "options.yaml": "torque-constants: {joint1: 8, joint2: 5}\n",
        "bad.yaml": "[a, b]\n", "table.csv": "a,b\n1,2\n3,4\n",
    }.items():  # fmt: skip
        (folder / name).write_text(text)
    return folder


def options_of(files, *words):
    return [files / word if word.endswith((".yaml", ".json", ".csv")) else word for word in words]


@QUIET
@pytest.mark.parametrize("words", [
    ("--torque-constants", "8,5"), ("--torque-constants", "joint2=5,joint1=8"), ("--torque-constants", "list.yaml"),
    ("--torque-constants", "joints.json"), ("--torque-constants", "column.csv"), ("--torque-constants", "row.csv"),
    ("--read", "options.yaml"), ("--torque-constants", "0.08,0.05", "--gear-ratios", "100"),
])  # fmt: skip
def test_constants_in_all_forms_identify_what_torques_do(files, words):
    log, out = files / "log.csv", files / "out.yaml"
    plain = json.loads(run("identify", "planar2r", log, "-o", out, "--json").stdout)
    found = json.loads(run("identify", "planar2r", log, "-o", out, "--json", *options_of(files, *words)).stdout)
    values = [[row["value"] for row in result["parameters"]] for result in (plain, found)]
    np.testing.assert_allclose(*values, rtol=1e-9, atol=1e-12)
    assert any("torques are currents" in note for note in found["notes"])


@QUIET
def test_stiffness_and_payload_take_currents(files):
    log, out = files / "log.csv", files / "out.yaml"
    words = "stiffness", "planar2r", log, "-o", out, "--rotor", "0.1", "--torque-constants", "8,5", "--json"
    found = json.loads(run(*words).stdout)
    K = [row["value"] for row in found["parameters"] if row["name"].endswith("stiffness")]
    assert pytest.approx([800, 600], rel=1e-6) == K
    load = json.loads(run("payload", "planar2r", log, "--torque-constants", "8,5", "--json").stdout)
    assert load["mass"] == pytest.approx(0, abs=1e-6)


REFUSED = {
    "length": (("--torque-constants", "1,2,3"), "--torque-constants has 3 numbers; expected 2 in the order"),
    "joint": (("--torque-constants", "joint3=1"), "--torque-constants: unknown joint 'joint3'"),
    "zero": (("--torque-constants", "0,1"), "none 0"),
    "text": (("--torque-constants", "soft"), "--torque-constants 'soft'; expected a number, numbers separated by"),
    "mixed": (("--torque-constants", "1,joint1=2"), "expected JOINT=NUMBER for each joint, once"),
    "twice": (("--torque-constants", "joint1=1,joint1=2"), "expected JOINT=NUMBER for each joint, once"),
    "file": (("--torque-constants", "bad.yaml"), "a list of numbers in the order of the joints"),
    "table": (("--torque-constants", "table.csv"), "2 columns; expected one of numbers, or one row of numbers"),
    "no file": (("--torque-constants", "lost.yaml"), "lost.yaml"),
    "gears": (("--gear-ratios", "100"), "--gear-ratios is of motors whose currents are read; give --torque-constants"),
    "no constants": (("--torques", "current_{joint}"), "give --torque-constants, N m/A: torque = constant *"),
}  # fmt: skip


@pytest.mark.parametrize("kind", REFUSED)
def test_the_command_refuses_in_one_line(files, kind):
    words, message = REFUSED[kind]
    asked = "identify", "planar2r", files / "log.csv", "-o", files / "none.yaml", *options_of(files, *words)
    refused(files, asked, message)


def test_commands_refuse_currents_for_torques_and_write_nothing(files):
    log, out = files / "renamed.csv", files / "none.yaml"
    text = (files / "log.csv").read_text().replace("tau_", "torque_").replace("current_", "tau_")
    log.write_text(text)
    for command in (("identify", "-o", out), ("payload", log), ("stiffness", "-o", out, "--rotor", "0.1")):
        asked = command[0], "planar2r", log, *command[1:]
        refused(files, asked, "--torque-constants (N m/A) and --gear-ratios, or --torques-as-given")
        assert call(*asked, "--torques-as-given").exit_code == 0
        out.unlink(missing_ok=True)
