"""Transmissions of URDF files, in both forms, against their definitions by hand; limits of ros2_control."""

import re

import numpy as np
import pytest
from click.testing import CliRunner

import jounce
from jounce.cli import main
from support.files import BODY, OTHER, joint, link, origin, robot_file
from support.refusals import refusal, refused
from support.robots import relative_error

LIMIT = '<limit lower="-2" upper="2" effort="100" velocity="2"/>'
WRIST = (  # lines 2 to 8
    link("base", BODY),
    link("pitch", BODY),
    link("roll", OTHER),
    link("tool", OTHER),
    joint("j_pitch", "base", "pitch", axis="0 1 0", inner=LIMIT),
    joint("j_roll", "pitch", "roll", inner=origin((0, 0, 0.3)) + LIMIT),
    joint("j_tool", "roll", "tool", axis="1 0 0", inner=origin((0.1, 0, 0.2)) + LIMIT),
)
A1, A2, J1, J2, D1, D2 = 50.0, -40.0, 1.5, -2.0, 0.1, -0.2  # reductions of actuators and joints, offsets
MATRICES = {  # of the documentation of transmission_interface
    "Differential": [[A1 * J1, A1 * J2], [A2 * J1, -A2 * J2]],
    "FourBarLinkage": [[A1 * J1, 0], [A2, A2 * J2]],
}


def one_end(form, tag, name, role, reduction=None, offset=None):
    """A <joint> or <actuator> of a transmission, in the form of ROS 1 or ROS 2."""
    reduction_tag = {1: "mechanicalReduction", 2: "mechanical_reduction"}[form]
    inner = "" if reduction is None else f"<{reduction_tag}>{reduction}</{reduction_tag}>"
    inner += "" if offset is None else f"<offset>{offset}</offset>"
    if form == 1:
        inner += f"<role>{role}</role>" if role else ""
        return f'<{tag} name="{name}">{inner}</{tag}>'
    return f'<{tag} name="{name}"' + (f' role="{role}"' if role else "") + f">{inner}</{tag}>"


def transmission(form, kind, *ends, name="t"):
    """A transmission, on one line of a file."""
    tag = {1: "type", 2: "plugin"}[form]
    text = f'<transmission name="{name}"><{tag}>{kind}</{tag}>{"".join(ends)}</transmission>'
    return text if form == 1 else f'<ros2_control name="s" type="system">{text}</ros2_control>'


def coupled(form, kind="Differential", joints=("j_pitch", "j_roll"), motors=("m1", "m2"), name="t", **changes):
    """A well-formed transmission of two joints; `changes` replace one of its ends by other text."""
    ends = {
        "joint1": one_end(form, "joint", joints[0], "joint1", J1, D1),
        "joint2": one_end(form, "joint", joints[1], "joint2", J2, D2),
        "actuator1": one_end(form, "actuator", motors[0], "actuator1", A1),
        "actuator2": one_end(form, "actuator", motors[1], "actuator2", A2),
    }
    ends |= changes
    return transmission(form, f"transmission_interface/{kind}Transmission", *ends.values(), name=name)


@pytest.fixture
def load(tmp_path):
    return lambda *items, **options: jounce.load(robot_file(tmp_path, *WRIST, *items), **options)


@pytest.mark.parametrize("form", [1, 2])
@pytest.mark.parametrize("kind", MATRICES)
def test_motors_move_as_the_definition_says(load, kind, form):
    """phi = A (q - d) with its rates, and by virtual work tau = A^-T Q, on the two joints; the third has its own."""
    robot, plain = load(coupled(form, kind)), load()
    A, d = np.array(MATRICES[kind]), np.array([D1, D2])
    rates = np.random.default_rng(0).uniform(-1, 1, (5, 6, 3))
    phi, *phi_rates = (x[..., 3:] for x in robot.coordinates(*rates[:4]))
    np.testing.assert_allclose(phi, (rates[0][:, :2] - d) @ A.T, rtol=1e-14)
    for found, rate in zip(phi_rates, rates[1:4], strict=True):
        np.testing.assert_allclose(found, rate[:, :2] @ A.T, rtol=1e-14)
    for tau, Q in zip(robot.actuator_forces(*rates), plain.inverse_dynamics(*rates), strict=True):
        assert relative_error(tau[:, :2], np.linalg.solve(A.T, Q[:, :2].T).T) < 1e-13
        assert relative_error(tau[:, 2], Q[:, 2]) < 1e-13
    # Differences of the power that the motors give: A by brute force, from positions alone.
    step = 1e-6 * np.eye(3)
    moved = [(robot.coordinates(h)[3:] - robot.coordinates(-h)[3:]) / 2e-6 for h in step]
    np.testing.assert_allclose(np.transpose(moved)[:, :2], A, rtol=1e-8, atol=1e-6)


@pytest.mark.parametrize("kind", MATRICES)
def test_both_forms_and_any_order_of_roles_are_one_robot(load, kind):
    by_hand = load().with_transmission(
        MATRICES[kind], ["m1", "m2"], ["j_pitch", "j_roll"], -np.array(MATRICES[kind]) @ [D1, D2]
    )
    swapped = [re.sub(r"(<joint .*</joint>)(<actuator .*</actuator>)", r"\2\1", coupled(1, kind))]
    for form in (1, 2):
        ends = re.findall(r"<(?:joint|actuator) .*?</(?:joint|actuator)>", coupled(form, kind))
        swapped.append(transmission(form, f"transmission_interface/{kind}Transmission", *ends[::-1]))
    for text in (coupled(1, kind), coupled(2, kind), *swapped):
        assert load(text) == by_hand
    # A file for both generations of ROS states it in both forms, and means one.
    assert load(coupled(1, kind), coupled(2, kind)) == by_hand


def test_a_urdf_in_an_xml_or_xacro_file_has_them_too(tmp_path):
    robots = [
        jounce.load(robot_file(tmp_path, *WRIST, coupled(1), name=f"robot.{suffix}"))
        for suffix in ("urdf", "xml", "xacro")
    ]
    assert robots[0].closed().joint_names == ("m1", "m2", "j_tool")
    assert robots == [robots[0]] * 3


def test_quantities_are_those_of_the_joints_and_of_the_motors(load):
    """M of the motors is A^-T M A^-1; a robot loaded without transmissions is the tree."""
    robot, plain = load(coupled(2)), load(coupled(2), transmissions=False)
    assert plain == load()
    rates = np.random.default_rng(1).uniform(-1, 1, (5, 4, 3))
    A = np.eye(3)
    A[:2, :2] = MATRICES["Differential"]
    for name in ("inverse_dynamics", "mass_matrix", "gravity_forces", "coriolis_matrix", "momentum", "kinetic_energy"):
        count = {"mass_matrix": 3, "gravity_forces": 3, "inverse_dynamics": 5}.get(name, 4)
        for found, expected in zip(
            getattr(robot, name)(*rates[:count]), getattr(plain, name)(*rates[:count]), strict=True
        ):
            assert relative_error(found, expected) < 1e-13
    phi = rates[0] @ A.T - np.pad(A[:2, :2] @ [D1, D2], (0, 1))
    M, inverse = plain.mass_matrix(rates[0]), np.linalg.inv(A)
    assert relative_error(robot.closed().mass_matrix(phi), inverse.T @ M @ inverse) < 1e-12


def test_several_are_one_block_matrix(load):
    """A four-bar of one joint of the first pair's neighbours: rows of each stand in columns of its own joints."""
    arm = (link("a", BODY), joint("j_a", "tool", "a", axis="0 1 0"), link("b", OTHER), joint("j_b", "a", "b"))
    second = coupled(1, "FourBarLinkage", ("j_b", "j_tool"), ("m3", "m4"), name="u")
    robot = load(*arm, coupled(2), second)
    whole = np.zeros((4, 5))
    whole[:2, :2] = MATRICES["Differential"]
    whole[2:, [4, 2]] = MATRICES["FourBarLinkage"]
    q = np.random.default_rng(2).uniform(-1, 1, 5)
    offsets = whole @ [D1, D2, D2, 0, D1]
    joints = robot.mechanism.joints
    assert joints[5:] == ("m3", "m4", "m1", "m2")  # those of ROS 1 come first
    phi = dict(zip(joints, robot.coordinates(q), strict=True))
    np.testing.assert_allclose([phi[f"m{k}"] for k in range(1, 5)], whole @ q - offsets, rtol=1e-13)
    assert robot.closed().joint_names == ("m1", "m2", "m4", "j_a", "m3")


def test_a_motor_named_as_a_joint_gets_another_name(load):
    robot = load(coupled(1, motors=("j_pitch", "j_tool")))
    assert robot.closed().joint_names == ("j_pitch_motor", "j_tool_motor", "j_tool")


def simple(form, of="j_tool", reduction=30, kind="transmission_interface/SimpleTransmission", **options):
    ends = (one_end(form, "joint", of, "joint1"), one_end(form, "actuator", "m", "actuator1", reduction))
    return transmission(form, kind, *ends, **options)


SILENT = {
    "simple": simple(1),
    "simple of ROS 2": simple(2),
    "type as an attribute": simple(1).replace('name="t"', 'name="t" type="pr2_mechanism_model/SimpleTransmission"'),
    "of another package, one joint": simple(1, kind="hey5_transmissions/Hey5Reducer"),
    "of a joint that is not there": simple(1, "gone"),
    "of a type that nobody knows, with the joints left out": transmission(1, "x/Odd", '<joint name="j_fixed"/>' * 2),
}


@pytest.mark.parametrize("text", SILENT.values(), ids=SILENT)
def test_what_moves_one_joint_is_no_part_of_the_equations(load, text):
    fixed = link("flange"), joint("j_fixed", "tool", "flange", "fixed")
    assert load(*fixed, text) == load(*fixed)


LEFT_OUT = {  # why a warning of one line names them
    "unknown type": ([transmission(1, "x/WristTransmission", '<flexJoint name="j_pitch"/>')], ["1 of type Wrist"]),
    "half a differential": ([coupled(1, "HalfDifferential")], ["1 of type HalfDifferentialTransmission"]),
    "no type": ([transmission(1, "", '<joint name="j_pitch"/><joint name="j_roll"/>')], ["1 of type unknown"]),
    "types are counted": ([coupled(1, "Odd")] * 2 + [coupled(2, "Even")], ["2 of type Odd", "1 of type Even"]),
    "reduction 0": ([simple(1, reduction=0)], ["'t', whose reductions are 0"]),
    "reduction in words": ([simple(2, reduction="thirty")], ["'t', whose reductions are thirty"]),
    "two motors of a joint": (
        [transmission(1, "transmission_interface/SimpleTransmission", '<joint name="j_tool"/>', "<actuator/>" * 2)],
        ["1 of type SimpleTransmission"],
    ),
    "fixed joint": ([coupled(1, joints=("j_fixed", "j_tool"))], ["'t', whose joint 'j_fixed' is fixed"]),
    "joint that follows": ([coupled(1, joints=("j_tool", "j_mimic"))], ["'t', whose joint 'j_mimic' mimics another"]),
}


@pytest.mark.parametrize(("texts", "words"), LEFT_OUT.values(), ids=LEFT_OUT)
def test_others_are_left_out_with_one_warning(load, texts, words):
    more = (
        *(link("flange"), joint("j_fixed", "tool", "flange", "fixed")),
        *(link("finger", OTHER), joint("j_mimic", "tool", "finger", inner='<mimic joint="j_roll"/>')),
    )
    with pytest.warns(jounce.JounceWarning) as caught:
        robot = load(*more, *texts)
    [message] = [str(warning.message) for warning in caught]
    assert message.isprintable()
    assert message.endswith("robot.with_transmission() states others, after load(..., transmissions=False)")
    assert all(word in message for word in [*words, "robot.urdf: transmissions are left out"]), message
    assert robot == load(*more)


def test_a_simple_one_beside_a_coupled_one_is_left_out(load):
    with pytest.warns(jounce.JounceWarning, match="'s', whose joint 'j_roll' is one of 't'"):
        robot = load(coupled(1), simple(1, "j_roll", name="s"))
    assert robot == load(coupled(1))


def test_many_reasons_are_cut(load):
    with pytest.warns(jounce.JounceWarning, match=r"'t0', whose .* 't3', whose reductions are 0; 3 more; robot"):
        load(*(simple(1, reduction=0, name=f"t{k}") for k in range(7)))


def end(place, name, **changes):
    """An end of a ROS 1 transmission that something is wrong with."""
    tag, reduction = ("joint", J1) if place.startswith("joint") else ("actuator", A1)
    given = {"form": 1, "tag": tag, "name": name, "role": place, "reduction": reduction} | changes
    return {place: one_end(**given)}


REFUSED = {  # a transmission on line 10, and words of the error
    "no role": (
        coupled(1, **end("joint2", "j_roll", role="")),
        ["joint 'j_roll' of", "no role; expected", "joint1 and"],
    ),
    "no role, ROS 2": (coupled(2, actuator1=one_end(2, "actuator", "m1", "")), ["actuator 'm1' of", "has no role"]),
    "unknown role": (
        coupled(1, **end("joint1", "j_pitch", role="first")),
        ["has the role 'first'; expected the roles"],
    ),
    "two roles": (
        coupled(1, joint1=one_end(2, "joint", "j_pitch", "joint1").replace("><", "><role>joint2</role><")),
        ["has the role 'joint1 and joint2'; expected the roles joint1 and joint2, each once"],
    ),
    "role twice": (
        coupled(1, **end("joint1", "j_pitch", role="joint2")),
        ["has the role joint2, as 'j_pitch'; expected"],
    ),
    "one actuator": (coupled(1, actuator2=""), ["transmission 't' has 1 <actuator>; expected the roles actuator1 and"]),
    "a joint in its place": (
        coupled(1, actuator2=one_end(1, "joint", "j_tool", "joint2")),
        ["transmission 't' has 1 <actuator>"],
    ),
    "no name": (coupled(1, actuator1="<actuator/>"), ["a <actuator> of transmission 't' has no name="]),
    "one joint twice": (coupled(1, joints=("j_roll", "j_roll")), ["names joint 'j_roll' twice; expected two joints"]),
    "one actuator twice": (coupled(1, motors=("m", "m")), ["names actuator 'm' twice; expected two actuators"]),
    "unknown joint": (
        coupled(1, joints=("j_pitch", "j_rol")),
        ["transmission 't': unknown joint 'j_rol'; did you mean 'j_roll'?"],
    ),
    "reduction 0": (
        coupled(1, **end("actuator1", "m1", reduction=0)),
        ["the reduction of actuator 'm1' of transmission 't' is 0; expected any other"],
    ),
    "reduction of a joint 0": (
        coupled(1, **end("joint2", "j_roll", reduction="0.0")),
        ["joint 'j_roll'", "is 0; expected"],
    ),
    "reduction in words": (
        coupled(1, **end("actuator1", "m1", reduction="fifty")),
        ["<mechanicalReduction> of actuator 'm1'", "is 'fifty'; expected a finite number"],
    ),
    "reduction of xacro": (
        coupled(2, joint1=one_end(2, "joint", "j_pitch", "joint1", "${r}")),
        ["is '${r}'; expected"],
    ),
    "no reduction": (
        coupled(1, **end("actuator1", "m1", reduction=None)),
        ["actuator 'm1' of transmission 't' has no <mechanicalReduction>; expected a number other than 0"],
    ),
    "reduction twice": (
        coupled(
            1,
            actuator1=one_end(1, "actuator", "m1", "actuator1", 5).replace(
                "<role", "<mechanical_reduction>3</mechanical_reduction><role"
            ),
        ),
        ["states <mechanical_reduction> twice"],
    ),
    "offset in words": (coupled(1, **end("joint1", "j_pitch", offset="zero")), ["<offset> of joint", "is 'zero'"]),
    "offset of an actuator": (
        coupled(1, **end("actuator2", "m2", offset=0.1)),
        ["an offset, which no", "of the joints"],
    ),
    "numbers that overflow": (
        coupled(1, **end("actuator1", "m1", reduction=1e200), **end("joint1", "j_pitch", reduction=1e200)),
        ["transmissions at line 10: matrix is", "expected finite numbers"],
    ),
    "numbers that lose all digits": (
        coupled(1, **end("actuator1", "m1", reduction=1e-9)),
        ["transmissions at line 10", "motors m1, m2", "at rest leave joints free"],
    ),
    "name of a rotor": (coupled(1, motors=("x", "m2")), ["motor 'x' or its rotor has the name of a joint or body"]),
}


@pytest.mark.parametrize(("text", "words"), REFUSED.values(), ids=REFUSED)
def test_refuses_with_the_line_and_the_cure(load, text, words):
    rotor = link("x_rotor", OTHER) + joint("j_x", "base", "x_rotor", "fixed")
    message = refusal(lambda: load(rotor, text), *words)
    assert re.match(r".*robot\.urdf(:10: |: transmissions at line 10: )", message), message


PAIRS = {
    "a joint of two": (coupled(1, joints=("j_roll", "j_tool"), motors=("m3", "m4"), name="u"), "move joint 'j_roll'"),
    "a motor of two": (coupled(1, joints=("j_x", "j_tool"), motors=("m2", "m3"), name="u"), "have an actuator 'm2'"),
    "other numbers": (coupled(1, joint1=one_end(1, "joint", "j_pitch", "joint1", 3), name="u"), "move joint 'j_pitch'"),
}


@pytest.mark.parametrize(("text", "word"), PAIRS.values(), ids=PAIRS)
def test_two_that_contradict_each_other_are_refused(load, text, word):
    fourth = link("x", OTHER) + joint("j_x", "tool", "x")
    words = [
        "robot.urdf:11: transmissions 'u' and 't' both",
        word,
        "robot.urdf:10; expected one of them, or other names",
    ]
    refusal(lambda: load(fourth, coupled(1), text), *words)


def test_reductions_other_than_0_determine_the_motion():
    """det A is -2 a1 a2 j1 j2 of a differential, and a1 a2 j1 j2 of a four-bar."""
    assert np.isclose(np.linalg.det(MATRICES["Differential"]), -2 * A1 * A2 * J1 * J2)
    assert np.isclose(np.linalg.det(MATRICES["FourBarLinkage"]), A1 * A2 * J1 * J2)


def test_a_floating_base_locks_and_another_root(load):
    """Motors turn against a base that floats; where one of two joints stands still, both motors drive the other."""
    floating, plain = load(coupled(1), base="floating"), load(base="floating")
    rates = np.random.default_rng(3).uniform(-1, 1, (3, 3))
    base = (np.eye(4), *np.random.default_rng(4).uniform(-1, 1, (2, 6)))
    Q = plain.inverse_dynamics(*rates, base=base)
    assert relative_error(floating.inverse_dynamics(*rates, base=base), Q) < 1e-13
    A = np.array(MATRICES["Differential"])
    assert relative_error(floating.actuator_forces(*rates, base=base)[:2], np.linalg.solve(A.T, Q[6:8])) < 1e-12
    # tau of least squares with a tau_1 + b tau_2 = Q, (a, b) the column of the joint that moves.
    locked, rest = load(coupled(1), lock={"j_pitch": 0.3}), load(lock={"j_pitch": 0.3})
    tau = locked.actuator_forces(*rates[:, 1:])
    Q = rest.inverse_dynamics(*rates[:, 1:])
    assert set(locked.closed(coordinates=["m1", "j_tool"]).joint_names) == {"m1", "j_tool"}
    assert np.isclose(A[:, 1] @ tau[[i for i, name in enumerate(movers(locked)) if name.startswith("m")]], Q[0])
    with pytest.warns(jounce.JounceWarning, match=r"'t', whose joint 'j_pitch' is excluded by root="):
        assert load(coupled(1), root="pitch") == load(root="pitch")
    # What is excluded as a whole is not worth a word.
    assert load(coupled(1), root="roll") == load(root="roll")


def movers(robot):
    closure = robot.mechanism.closure
    return [closure.coordinates[j] for j in closure.actuated]


def test_a_robot_with_joints_of_several_screws_keeps_them(load):
    plane = link("ground") + joint("plane", "ground", "base", "planar")
    with pytest.warns(jounce.JounceWarning, match="'t', as the robot has joints of several screws"):
        robot = load(plane, coupled(1))
    assert robot == load(plane)


CONTROL = '<ros2_control name="s" type="system"><joint name="{}">{}</joint></ros2_control>'


def interface(kind, low=None, high=None, inner=""):
    bounds = "".join(
        f'<param name="{name}">{value}</param>' for name, value in (("min", low), ("max", high)) if value is not None
    )
    return f'<command_interface name="{kind}">{bounds}{inner}</command_interface>'


JOINED = {  # of j_pitch: what is stated, the kind, and the bounds that follow; <limit> has 2 rad, 2 rad/s, 100 N m
    "position": (interface("position", -1, 1.5), "position", (-1, 1.5)),
    "position, one end": (interface("position", high=1.5), "position", (-2, 1.5)),
    "wider position": (interface("position", -3, 1), "position", (-2, 1)),
    "velocity": (interface("velocity", -1, 1.5), "velocity", (-1, 1.5)),
    "velocity, one number": (interface("velocity", high=1.5), "velocity", (-1.5, 1.5)),
    "velocity, min alone": (interface("velocity", low=-1.5), "velocity", (-1.5, 1.5)),
    "acceleration": (interface("acceleration", -5, 5), "acceleration", (-5, 5)),
    "unequal acceleration": (interface("acceleration", -5, 4), "acceleration", (-5, 4)),
    "jerk": (interface("jerk", high=80), "jerk", (-80, 80)),
    "effort": (interface("effort", -20, 300), "effort", (-20, 100)),
    "effort of one sign": (interface("effort", 5, 30), "effort", (5, 30)),
    "no bound in words": (interface("velocity", "-inf", "inf"), "velocity", (-2, 2)),
    "twice": (interface("effort", -20, 30) + interface("effort", -30, 20), "effort", (-20, 20)),
    "disabled": (interface("velocity", -1, 1, '<limits enable="false"/>'), "velocity", (-2, 2)),
    "joint disabled": ('<limits enable="False"/>' + interface("velocity", -1, 1), "velocity", (-2, 2)),
    "enabled": (interface("velocity", -1, 1, '<limits enable="true"/>'), "velocity", (-1, 1)),
    "a state is no command": (interface("velocity", -1, 1).replace("command_", "state_"), "velocity", (-2, 2)),
    "not a limit": (interface("kp_gain", 3, 1), "velocity", (-2, 2)),
}


@pytest.mark.filterwarnings("ignore:.*the tighter ones count")
@pytest.mark.parametrize(("text", "kind", "expected"), JOINED.values(), ids=JOINED)
def test_limits_of_ros2_control_join_those_of_the_joint(load, text, kind, expected):
    limits, plain = load(CONTROL.format("j_pitch", text)).limits, load().limits
    np.testing.assert_array_equal(limits.bounds(kind)[:, 0], expected)
    np.testing.assert_array_equal(limits.table[..., 1:], plain.table[..., 1:])
    others = [other for other in ("position", "velocity", "acceleration", "jerk", "effort") if other != kind]
    for other in others:
        np.testing.assert_array_equal(limits.bounds(other), plain.bounds(other))


def test_continuous_joints_may_be_bounded_there(load):
    wheel = link("wheel", OTHER) + joint("turn", "tool", "wheel", "continuous")
    limits = load(wheel, CONTROL.format("turn", interface("position", -1, 2))).limits
    np.testing.assert_array_equal(limits.bounds("position")[:, -1], (-1, 2))


def test_one_warning_names_what_differs(load):
    """Bounds that agree, or stand alone, need none."""
    same = interface("velocity", -2, 2) + interface("acceleration", -5, 5) + interface("effort", -100, 100)
    assert load(CONTROL.format("j_roll", same)).limits.acceleration[1] == 5
    texts = [CONTROL.format(name, interface("velocity", -1, 1)) for name in ("j_pitch", "j_roll")]
    with pytest.warns(jounce.JounceWarning) as caught:
        load(*texts, CONTROL.format("j_tool", interface("effort", -10, 10)))
    [message] = [str(warning.message) for warning in caught]
    assert message.endswith("which the tighter ones count: velocity of j_pitch, j_roll; effort of j_tool")


def test_limits_stay_with_joints_that_motors_move(load):
    robot = load(coupled(2), CONTROL.format("j_pitch", interface("acceleration", -5, 5)))
    assert robot.limits.acceleration[0] == 5
    np.testing.assert_array_equal(robot.limits.effort, [100, 100, 100, np.inf, np.inf])


BAD_LIMITS = {  # on line 9
    "min > max": (
        interface("position", 1, -1),
        ["position of joint 'j_pitch' has min 1 and max -1; expected min <= max"],
    ),
    "both positive": (interface("velocity", 1, 2), ["has min 1 and max 2; expected min <= 0 <= max"]),
    "positive min alone": (interface("acceleration", low=5), ["has min 5; expected min <= 0 <= max"]),
    "negative max alone": (interface("jerk", high=-5), ["has max -5; expected min <= 0 <= max"]),
    "effort upside down": (interface("effort", 1, -1), ["has min 1 and max -1; expected min <= max"]),
    "xacro": (interface("effort", -1, "${top}"), ["max of effort of joint 'j_pitch' is '${top}'; expected a finite"]),
    "empty": (interface("effort", "", 1), ["min of effort of joint 'j_pitch' is ''; expected a finite number"]),
    "nan": (interface("effort", -1, "nan"), ["is 'nan'; expected a finite number"]),
    "infinite the wrong way": (interface("velocity", "inf", 1), ["min of velocity", "is 'inf'; expected a finite"]),
    "twice": (interface("effort", -1, "1").replace("min", "max"), ["effort of joint 'j_pitch' states max twice"]),
    "nothing in common": (
        interface("position", 3, 4),
        ["is bounded by 3 and 4 here, and by -2 and 2 elsewhere", "something between"],
    ),
    "enable": (interface("effort", -1, 1, '<limits enable="maybe"/>'), ["<limits enable='maybe'>; expected true or"]),
}


@pytest.mark.parametrize(("text", "words"), BAD_LIMITS.values(), ids=BAD_LIMITS)
def test_refuses_limits_of_ros2_control(load, text, words):
    message = refusal(lambda: load(CONTROL.format("j_pitch", text)), *words)
    assert re.match(r".*robot\.urdf:9: ", message), message


def test_refuses_limits_of_an_unknown_joint(load):
    """Interfaces without limits are left alone."""
    words = ["robot.urdf:9: limits in <ros2_control>: unknown joint 'j_ptch'; did you mean 'j_pitch'?"]
    refusal(lambda: load(CONTROL.format("j_ptch", interface("effort", -1, 1))), *words)
    assert load(CONTROL.format("j_ptch", interface("effort"))) == load()


def test_states_of_pinocchio_and_contacts_of_robots_with_motors(load, tmp_path):
    """States are of the joints, which the library has; contacts are refused with the option that leaves motors out."""
    pinocchio = pytest.importorskip("pinocchio")
    robot = load(coupled(1))
    model = pinocchio.buildModelFromUrdf(str(tmp_path / "robot.urdf"))
    q, v, a = np.random.default_rng(5).uniform(-1, 1, (3, 3))
    assert [*map(list, robot.state_to("pinocchio", q, v, a, model=model))] == [*map(list, (q, v, a))]
    tau = pinocchio.rnea(model, model.createData(), q, v, a)
    state = robot.state_from("pinocchio", q, v, a, forces=tau, model=model)
    np.testing.assert_allclose(robot.inverse_dynamics(*state.rates), state.Q, atol=1e-12)
    standing = load(coupled(1), base="floating")
    words = ["motors that move joints together", "load it with transmissions=False"]
    refusal(lambda: standing.contacts([jounce.Contact("tool", "plane")]), *words)
    refusal(lambda: robot.with_limits(velocity=1).excite(), *words)
    motion = jounce.Motion.polynomial([[0, 0, 0, 0, 0.1]] * 3, 1.0)
    for call in (lambda: robot.live(1e-3), lambda: robot.guard(motion)):
        refusal(call, "and coupled drives: transmissions=False leaves out those of a file")


DIFFERENTIAL = (  # reductions of 50, and accelerations of j_pitch in ros2_control
    '<link name="base"/>',
    '<link name="pitch"><inertial><origin xyz="0 0 0.2"/><mass value="2"/>'
    '<inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.005"/></inertial></link>',
    '<link name="roll"><inertial><origin xyz="0.05 0 0.1"/><mass value="1"/>'
    '<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.004"/></inertial></link>',
    joint("j_pitch", "base", "pitch", axis="0 1 0", inner=LIMIT),
    joint("j_roll", "pitch", "roll", inner=origin((0, 0, 0.3)) + LIMIT),
    transmission(
        1,
        "transmission_interface/DifferentialTransmission",
        one_end(1, "joint", "j_pitch", "joint1", "1.0"),
        one_end(1, "joint", "j_roll", "joint2", "1.0"),
        one_end(1, "actuator", "m1", "actuator1", 50),
        one_end(1, "actuator", "m2", "actuator2", 50),
    ),
    CONTROL.format("j_pitch", interface("position") + interface("acceleration", -5, 5)),
)
TWIN = """<mujoco><compiler angle="radian"/><worldbody>
<body name="pitch"><joint name="j_pitch" axis="0 1 0"/><inertial pos="0 0 0.2" mass="2" diaginertia="0.02 0.02 0.005"/>
<body name="roll" pos="0 0 0.3"><joint name="j_roll" axis="0 0 1"/>
<inertial pos="0.05 0 0.1" mass="1" diaginertia="0.01 0.01 0.004"/></body></body></worldbody>
<tendon><fixed name="t1"><joint joint="j_pitch" coef="50"/><joint joint="j_roll" coef="50"/></fixed>
<fixed name="t2"><joint joint="j_pitch" coef="50"/><joint joint="j_roll" coef="-50"/></fixed></tendon>
<actuator><motor name="m1" tendon="t1"/><motor name="m2" tendon="t2"/></actuator></mujoco>"""


def test_a_differential_wrist(tmp_path):
    """Joints are (m1 + m2) / (2 r) and (m1 - m2) / (2 r), torques of motors (Q1 + Q2) / (2 r) and (Q1 - Q2) / (2 r)."""
    robot = jounce.load(robot_file(tmp_path, *DIFFERENTIAL))
    assert robot.limits.acceleration[:2].tolist() == [5, np.inf]
    m1, m2 = 7.0, -3.0
    joints = robot.closed().coordinates([m1, m2])[:2]
    np.testing.assert_allclose(joints, [(m1 + m2) / 100, (m1 - m2) / 100], rtol=1e-14)
    Q = robot.inverse_dynamics([0.3, 0.2], [1, 2], [3, 4])
    tau = robot.actuator_forces([0.3, 0.2], [1, 2], [3, 4])
    np.testing.assert_allclose(tau, [(Q[0] + Q[1]) / 100, (Q[0] - Q[1]) / 100], rtol=1e-12)


def test_its_twin_on_tendons_in_mujoco(tmp_path):
    """Motors on fixed tendons of MuJoCo: lengths are positions of motors, their forces balance mj_inverse."""
    mujoco = pytest.importorskip("mujoco")
    robot, model = jounce.load(robot_file(tmp_path, *DIFFERENTIAL)), mujoco.MjModel.from_xml_string(TWIN)
    data = mujoco.MjData(model)
    lengths = []
    for q in np.eye(2):
        data.qpos[:] = q
        mujoco.mj_forward(model, data)
        lengths.append(data.ten_length.copy())
        np.testing.assert_allclose(robot.coordinates(q)[2:], data.ten_length, rtol=1e-14)
    for q, qd, q2d in np.random.default_rng(6).uniform(-1, 1, (5, 3, 2)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q, qd, q2d
        mujoco.mj_inverse(model, data)
        tau = np.linalg.solve(lengths, data.qfrc_inverse)
        np.testing.assert_allclose(robot.actuator_forces(q, qd, q2d), tau, rtol=1e-11)


@pytest.mark.filterwarnings("default::jounce.JounceWarning")
def test_the_command_line_has_an_option_without_motors(tmp_path):
    """Messages at the shell name it, and nothing of Python."""
    path = robot_file(tmp_path, *DIFFERENTIAL, transmission(1, "x/Wrist", '<a name="j_roll"/>'))
    with_motors, without = (
        CliRunner().invoke(main, ["info", str(path), *more]) for more in ([], ["--no-transmissions"])
    )
    assert ("m1_rotor" in with_motors.stdout, "m1_rotor" in without.stdout) == (True, False)
    assert with_motors.stderr.endswith("as if each joint had its own motor: 1 of type Wrist\n")
    assert without.stderr == ""
    wrist = robot_file(tmp_path, *DIFFERENTIAL, name="wrist.urdf")
    refused(tmp_path, ["excite", wrist, "-o", "e.csv"], "excite() is of its joints; of a file, load it with --no-trans")
