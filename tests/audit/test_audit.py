"""The audit: every finding on a robot that has the defect, none on one that barely has it not; real robots."""

import json
import re
import sys
from collections import Counter
from dataclasses import replace
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest
import sympy
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import jounce
from jounce.checks.audit import SEVERITIES, Finding, audit, check_formulas, check_singular
from jounce.checks.description import describe
from jounce.model.mechanism import Mechanism
from jounce.spatial import inertia, lie
from support.commands import call
from support.files import BODY, ODD, joint, link, robot_file
from support.refusals import refusal, refused
from support.robots import mechanisms, random_mechanism
from support.units import SI

PANDA = Path(__file__).parents[2] / "examples" / "panda.urdf"
LIMITS = {"effort": [50.0, 40.0, 30.0], "velocity": [2.0, 2.0, 3.0]}
TURNED = Rotation.from_rotvec([0.3, -0.5, 0.8]).as_matrix()


def body(mass, moments, com=(0.02, 0.01, 0.15)):
    """An inertia matrix of principal moments about axes that are not those of the frame."""
    return jounce.inertia_matrix(mass, list(com), np.diag(np.asarray(moments, dtype=float)), rotation=TURNED)


SANE = [body(4.0, [0.04, 0.05, 0.02]), body(3.0, [0.02, 0.03, 0.012]), body(1.0, [0.002, 0.003, 0.0025])]


def sane_arm(inertias=SANE, limits=LIMITS, apart=0.3, axes=((0, 0, 1), (0, 1, 0), (0, 1, 0)), **data):
    """A sane arm of three bodies, but for what is given."""
    B = [lie.pose(np.eye(3), np.array([[0.0], [0.0], [apart * (i > 0)]])) for i in range(3)]
    return jounce.Robot.from_screws(B, [[*axis, 0, 0, 0] for axis in axes], inertias, limits=limits, **data)


def last(M):
    return [*SANE[:2], M]


def found(robot):
    return {(finding.severity, finding.kind): finding for finding in robot.audit()}


def test_a_sane_arm_has_no_findings():
    assert sane_arm().audit() == ()


NO_EFFORT = LIMITS | {"effort": [np.inf, 40.0, np.inf]}
FINDINGS = {  # what is given, what is found, where, its number and a part of its text; and what is barely not found
    "negative mass": (
        {"inertias": last(body(-1.0, [1, 1, 1]))}, "error", ["body3"], -1.0, "mass -1 kg is negative",
        {"inertias": last(body(1.0, [0.002, 0.003, 0.0025]))},
    ),
    "moments without mass": (
        {"inertias": last(np.diag([0.1, 0.1, 0.2, 0, 0, 0]))}, "error", ["body3"], 0.2, "massless, yet with moments",
        {"inertias": last(body(0.1, [0.0001, 0.0002, 0.0002]))},
    ),
    "negative moment": (
        {"inertias": last(body(1.0, [-0.001, 0.003, 0.003]))}, "error", ["body3"], -0.001, "-0.001 kg m^2 about",
        {"inertias": last(body(1.0, [0.0, 0.003, 0.003]))},
    ),
    "triangle inequality": (
        {"inertias": last(body(1.0, [0.003, 0.003, 0.0065]))}, "error", ["body3"], -0.0005, "by 0.0005 kg m^2, 7.7 %",
        {"inertias": last(body(1.0, [0.003, 0.003, 0.006]))},
    ),
    "placeholder inertia": (
        {"inertias": [body(4.0, [0.1] * 3), SANE[1], body(1.0, [0.1] * 3)]}, "warning", ["body1", "body3"], 0.1,
        "0.1 kg m^2 times the identity",
        {"inertias": [body(4.0, [0.1, 0.1, 0.10001]), SANE[1], body(1.0, [0.105] * 3)]},
    ),
    "placeholder mass": (
        {"inertias": [body(1.0, [0.01, 0.02, 0.015 + i / 1e3]) for i in range(3)]}, "warning",
        ["body1", "body2", "body3"], 1.0, "mass 1 kg on 3 of 3 bodies",
        {"inertias": [SANE[0], *(body(1.0, [0.01, 0.02, 0.015 + i / 1e3]) for i in range(2))]},
    ),
    "density": (
        {"inertias": last(body(1.0, [2.9e-5] * 2 + [2.8e-5]))}, "warning", ["body3"], None, "denser than osmium",
        {"inertias": last(body(1.0, [2e-4] * 2 + [2.1e-4]))},
    ),
    "mass": (
        {"inertias": last(body(0.0029, [2e-6, 2e-6, 1.9e-6]))}, "warning", ["body3"], 0.0029, "of this robot, 3 kg",
        {"inertias": last(body(0.0031, [2e-6, 2e-6, 1.9e-6]))},
    ),
    "size": (
        {"apart": 27.0}, "warning", [], 54.0, "measures 54 m between its joints",
        {"apart": 24.0},
    ),
    "centre of mass": (
        {"inertias": last(body(1.0, [0.002, 0.003, 0.0025], com=(0, 20.0, 150.0)))}, "warning", ["body3"], None,
        "COM lies 151 m from its joint, in a robot of 0.6 m",
        {"inertias": last(body(1.0, [0.002, 0.003, 0.0025], com=(0, 0, 4.9)))},
    ),
    "massless": (
        {"inertias": [SANE[0], np.zeros((6, 6)), SANE[2]]}, "note", ["body2"], 0.0, "massless, but carries bodies",
        {"inertias": [SANE[0], body(0.1, [1e-4] * 2 + [1.1e-4]), SANE[2]]},
    ),
    "massless tip": (
        {"inertias": last(np.zeros((6, 6)))}, "warning", ["body3"], 0.0, "massless, as is everything it carries",
        {"inertias": last(body(0.1, [1e-4] * 2 + [1.1e-4]))},
    ),
    "singular mass matrix": (
        {"inertias": last(np.zeros((6, 6)))}, "error", ["joint3"], 1.0, "moves no inertia: the mass matrix is singular",
        {"inertias": last(jounce.inertia_matrix(0.1, [0.001, 0, 0], np.zeros((3, 3))))},
    ),
    "point mass": (
        {"inertias": last(jounce.inertia_matrix(1.0, [0.1, 0, 0], np.zeros((3, 3))))}, "note", ["body3"], 1.0,
        "1 kg at most",
        {"inertias": last(jounce.inertia_matrix(1.0, [0.1, 0, 0], np.diag([1e-3, 1e-3, 1.1e-3])))},
    ),
    "effort limit": (
        {"limits": NO_EFFORT}, "warning", ["joint1", "joint3"], 2.0, "no effort limit, unlike the other 1",
        {"limits": LIMITS | {"effort": [50.0, 40.0, 1e300]}},
    ),
    "velocity limit": (
        {"limits": LIMITS | {"velocity": [2.0, 0.0, 2.0]}}, "warning", ["joint2"], 0.0, "velocity limit 0",
        {"limits": LIMITS | {"velocity": [2.0, 0.1, 2.0]}},
    ),
    "position limit": (
        {"limits": LIMITS | {"lower": [-170.0, -2.0, -1e9], "upper": [170.0, 2.0, 1e9]}}, "warning", ["joint1"], 170.0,
        "170 rad, 27.1 turns: it looks like degrees",
        {"limits": LIMITS | {"lower": [-25.0, -2.0, -1e9], "upper": [25.0, 2.0, 1e9]}},
    ),
    "name": (
        {"joint_names": ["joint1", "=HYPERLINK(1)", "@j"]}, "warning", ["=HYPERLINK(1)", "@j"], 2.0,
        "the name begins with '='",
        {"joint_names": ["joint1", "j=1", "j-2"]},
    ),
    "gravity": (
        {"gravity": (0, 0, -9810)}, "warning", [], 9810.0, "gravity is 9810 m/s^2",
        {"gravity": (0, 9.80665 * 0.6, -9.80665 * 0.8)},
    ),
}  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "data", "severity", "where", "number", "text", "sound"),
    [(kind, *case) for kind, case in FINDINGS.items()],
    ids=FINDINGS,
)
def test_finds_it_and_not_what_is_barely_sound(kind, data, severity, where, number, text, sound):
    finding = found(sane_arm(**data))[severity, kind]
    assert list(finding.bodies + finding.joints) == where
    assert number is None or finding.number == pytest.approx(number)
    assert text in finding.text
    assert finding.advice
    assert f"{finding}\n{finding.advice}".replace("\n", "").isprintable()
    assert kind not in {other for _, other in found(sane_arm(**sound))}


@pytest.mark.parametrize("start", ["=", "+", "-", "@", "\t", "\r"])
def test_names_that_spreadsheets_execute_are_found(start):
    sane = sane_arm().mechanism
    named = replace(sane, joints=(f"{start}1+1", *sane.joints[1:]), bodies=(f"{start}2+2", *sane.bodies[1:]))
    found = [(finding.unit, finding.joints, finding.bodies) for finding in check_formulas(named)]
    assert found == [("joints", (f"{start}1+1",), ()), ("links", (), (f"{start}2+2",))]


def test_a_long_chain_is_not_singular():
    """Its mass matrix is regular, though its eigenvalues in doubles do not tell."""
    B = np.stack([lie.pose(np.eye(3), np.array([[0.0], [0.0], [0.1]]))] * 1000)
    M = np.stack([jounce.inertia_matrix(1.5, [0, 0, 0.05], np.diag([0.01, 0.012, 0.011]))] * 1000)
    chain = jounce.Robot.from_screws(B, [[0, 1, 0, 0, 0, 0]] * 1000, M)
    assert not list(check_singular(chain.mechanism))


def test_an_axis_that_a_urdf_leaves_out_is_noted(tmp_path):
    chain = (link("base"), link("arm", BODY), link("hand", BODY), joint("turn", "base", "arm", axis=""))
    robot = jounce.load(robot_file(tmp_path, *chain, joint("slide", "arm", "hand", "prismatic", axis="")))
    assert robot.mechanism.X.tolist() == [[1, 0, 0, 0, 0, 0], [0, 0, 0, 1, 0, 0]]
    note = found(robot)["note", "axis"]
    assert note.joints == ("turn", "slide")
    assert "1 0 0" in note.text
    assert found(robot.locked({"turn": 0.0}))["note", "axis"].joints == ("slide",)
    stated = [joint("turn", "base", "arm", axis="1 0 0"), joint("slide", "arm", "hand", "prismatic", axis="1 0 0")]
    same = jounce.load(robot_file(tmp_path, *chain[:3], *stated))
    assert same == robot
    assert ("note", "axis") not in found(same)


def rescaled_mechanism(mechanism: Mechanism, mass=1.0, moments=1.0, com=1.0, length=1.0) -> Mechanism:
    """What a mistake of units makes: masses, moments about the COMs, COMs and joints, times a factor each."""
    B, X, M = mechanism.B.copy(), mechanism.X.copy(), []
    B[:, :3, 3] *= length
    X[X[:, :3].any(axis=1), 3:] *= length
    for M_i in mechanism.M:
        m, h, _ = inertia.moments(M_i)
        c = h[:, 0] / m[0, 0]
        M.append(jounce.inertia_matrix(m[0, 0] * mass, c * com, (M_i[:3, :3] + m * lie.hat(c) @ lie.hat(c)) * moments))
    return replace(mechanism, B=B, X=X, M=np.stack(M))


MISTAKES = {
    "g and g m^2": ({"mass": 1e3, "moments": 1e3}, {"density"}),
    "g": ({"mass": 1e3}, {"density"}),
    "t and t m^2": ({"mass": 1e-3, "moments": 1e-3}, {"density"}),
    "t": ({"mass": 1e-3}, {"density"}),
    "g m^2": ({"moments": 1e3}, {"density"}),
    "kg mm^2": ({"moments": 1e6}, {"density"}),
    "moments / 1000": ({"moments": 1e-3}, {"density"}),
    "COMs in mm": ({"com": 1e3}, {"centre of mass"}),
    "joints in mm": ({"length": 1e3}, {"size"}),
    "all in mm": ({"length": 1e3, "com": 1e3, "moments": 1e6}, {"size", "density"}),
    "all in km": ({"length": 1e-3, "com": 1e-3, "moments": 1e-6}, {"size", "density"}),
}


@pytest.mark.parametrize(("factors", "kinds"), MISTAKES.values(), ids=MISTAKES)
@pytest.mark.parametrize("robot", [sane_arm(), jounce.load(PANDA)], ids=["arm", "panda"])
def test_a_mistake_of_units_is_found(robot, factors, kinds):
    """In most bodies, where it is one of bodies; and no other kind of mistake is suspected but one of that sort."""
    assert robot.audit() == ()
    findings = {finding.kind: finding for finding in audit(rescaled_mechanism(robot.mechanism, **factors))}
    assert kinds <= set(findings) <= kinds | {"mass"}
    for kind in kinds - {"size"}:
        assert 2 * len(findings[kind].bodies) > robot.mechanism.nb


@given(mechanisms(units=st.just(SI)), st.sampled_from([{"mass": 1e3}, {"moments": 1e6}, {"moments": 1e-6}]))
def test_the_density_names_every_body_of_random_ones(drawn, factors):
    [finding] = [f for f in audit(rescaled_mechanism(drawn[0], **factors)) if f.kind == "density"]
    assert finding.bodies == drawn[0].bodies


@given(mechanisms(units=st.just(SI)))
def test_a_body_within_a_ball_is_as_dense_as_the_ball_or_denser(drawn):
    """The bound that the check of densities rests on: with all the moments of osmium balls, no finding; less, one."""
    mechanism = drawn[0]
    m = mechanism.M[:, 3, 3]
    R = (m / (4 / 3 * np.pi * 22600)) ** (1 / 3)
    for factor, kinds in ((1.001, 0), (0.999, mechanism.nb)):
        moments = factor * 0.4 * m * R**2
        M = jounce.inertia_matrix(m, np.zeros((mechanism.nb, 3)), moments[:, None, None] * np.eye(3))
        dense = [f for f in audit(replace(mechanism, M=M)) if f.kind == "density"]
        assert sum(len(f.bodies) for f in dense) == kinds


@given(mechanisms(spread=True, units=st.just(SI)))
def test_any_robot_is_audited_and_its_findings_are_of_its_own_names(drawn):
    mechanism, _ = drawn
    for finding in audit(mechanism):
        assert finding.severity in SEVERITIES
        assert set(finding.bodies) <= set(mechanism.bodies)
        assert set(finding.joints) <= {*mechanism.joints, *mechanism.coordinates}
        assert np.isfinite(finding.number)
        assert str(finding).isprintable()
    assert not {f.kind for f in audit(mechanism)} & {"singular mass matrix", "triangle inequality", "negative moment"}


def test_pybullet_like_placeholders(tmp_path):
    """A Panda in which somebody put 0.1 times the identity, mass 1, into every link."""
    text = PANDA.read_text()
    text = re.sub(r"<inertial>.*?</inertial>", "", text, flags=re.DOTALL)
    box = '<inertial><mass value="1"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>'
    text = re.sub(r'<link name="([^"]+)"\s*/?>(?:\s*</link>)?', rf'<link name="\1">{box}</link>', text)
    path = tmp_path / "panda.urdf"
    path.write_text(text)
    robot = jounce.load(path)
    findings = found(robot)
    merged = "panda_link7"  # carries links behind fixed joints
    assert set(findings["warning", "placeholder inertia"].bodies) == set(robot.body_names) - {merged}
    assert set(findings["warning", "placeholder mass"].bodies) == set(robot.body_names) - {merged}


def test_the_same_moments_on_bodies_of_different_mass():
    """Copied ones, however turned; equal bodies, as left and right, may have equal moments."""
    moments = [0.0123, 0.0234, 0.0345]
    copied = sane_arm([body(4.0, moments), jounce.inertia_matrix(1.0, [0.1, 0, 0], np.diag(moments)), SANE[2]])
    finding = found(copied)["warning", "placeholder inertia"]
    assert finding.bodies == ("body1", "body2")
    assert "the same principal moments, up to 0.0345 kg m^2, on 2 bodies from 1 to 4 kg" in finding.text
    assert sane_arm([body(4.0, moments), body(4.0, moments), SANE[2]]).audit() == ()


class TestSingular:
    """Where the mass matrix has no inverse, by rank at a random state as the oracle."""

    def test_two_joints_about_one_axis_with_nothing_between(self):
        robot = sane_arm([np.zeros((6, 6)), *SANE[1:]], apart=0.0, axes=[(0, 0, 1), (0, 0, 1), (0, 1, 0)])
        finding = found(robot)["error", "singular mass matrix"]
        assert finding.joints == ("joint1", "joint2")
        assert "together" in finding.text
        assert np.linalg.matrix_rank(robot.mass_matrix([0.3, 0.5, 0.7]), tol=1e-12) == 2

    def test_a_point_mass_on_the_axis_of_its_joint(self):
        robot = sane_arm(last(jounce.inertia_matrix(1.0, [0, 0.4, 0], np.zeros((3, 3)))))
        assert found(robot)["error", "singular mass matrix"].joints == ("joint3",)

    def test_massless_wrists_between_crossing_axes_are_no_harm(self):
        robot = sane_arm([np.zeros((6, 6))] * 2 + [SANE[2]], apart=0.0, axes=np.eye(3))
        assert set(found(robot)) == {("note", "massless")}
        assert np.linalg.matrix_rank(robot.mass_matrix([0.3, 0.5, 0.7])) == 3

    def test_a_massless_tip_that_follows_is_no_coordinate(self):
        robot = sane_arm(last(np.zeros((6, 6))), G=[[1, 0], [0, 1], [0, 1]])
        assert set(found(robot)) == {("warning", "massless tip")}

    def test_negative_masses_make_it_indefinite_which_is_another_finding(self):
        assert set(found(sane_arm(last(body(-9.0, [1, 1, 1]))))) == {("error", "negative mass")}


def test_negative_moments_have_no_density():
    assert set(found(sane_arm(last(body(1.0, [-3, -1, -1]))))) == {("error", "negative moment")}


@pytest.mark.parametrize("factor", [-1, 1])  # of a gripper's other finger, as often 1 as -1
def test_limits_of_joints_that_follow_are_not_missed(factor):
    free = {"effort": [50, 40, np.inf], "velocity": [2, 2, np.inf]}
    assert sane_arm(limits=free, G=[[1, 0], [0, 1], [0, factor]]).audit() == ()
    assert set(found(sane_arm(limits=free))) == {("warning", "effort limit"), ("warning", "velocity limit")}


def test_without_any_limits_there_is_one_note_of_each():
    assert [(f.severity, f.kind, f.number) for f in sane_arm(limits=None).audit()] == [
        ("note", "effort limit", 3.0),
        ("note", "velocity limit", 3.0),
    ]


@pytest.mark.parametrize(
    ("g", "severity"), [(0, "note"), (1.62, "note"), (24.8, "note"), (0.981, "warning"), (98.1, "warning")]
)
def test_gravity_of_other_places(g, severity):
    assert set(found(sane_arm(gravity=(g, 0, 0)))) == {(severity, "gravity")}


@pytest.mark.parametrize(
    "M",
    [
        jounce.inertia_matrix(1e-310, [0.3, 0.1, 0.2], 1e-320 * np.eye(3)),
        jounce.inertia_matrix(1e300, [1e3, 0, 0], 1e307 * np.eye(3)),
        jounce.inertia_matrix(1e-300, [1e10, 0, 0], np.eye(3)),
    ],
)
def test_numbers_near_the_ends_of_the_doubles_are_no_trouble(M):
    for finding in sane_arm(last(M)).audit():
        assert np.isfinite(finding.number)


def test_symbols_are_refused():
    robot = jounce.load("planar2r", L1=sympy.Symbol("L"))
    refusal(robot.audit, "'planar2r' contains symbols; an audit needs numbers")


def test_bundled_robots_are_audited_too():
    findings = jounce.load("iiwa14").audit()
    told = [(f.severity, f.kind, f.where) for f in findings if f.severity != "note"]
    assert told == [
        ("error", "triangle inequality", "link4"),
        ("error", "triangle inequality", "link7"),
        ("warning", "density", "link2"),
    ]
    assert findings[0].number == pytest.approx(-2.9e-4, rel=0.01)


REAL = {
    str(file).partition("/robots/")[2]: Path(str(file.locate()))
    for file in metadata.files("example-robot-data") or []
    if file.suffix == ".urdf"
}
SOUND = (
    "panda_description/urdf/panda.urdf",
    "ur_description/urdf/ur5_robot.urdf",
    "ur_description/urdf/ur10_robot.urdf",
    "xarm_description/urdf/xarm7.urdf",
    "z1_description/urdf/z1.urdf",
    "talos_data/robots/talos_full_v2.urdf",
    "anymal_b_simple_description/robots/anymal.urdf",
    "solo_description/robots/solo12.urdf",
    "g1_description/urdf/g1_29dof_rev_1_0.urdf",
    "so_arm_description/urdf/so101.urdf",
    "allegro_hand_description/urdf/allegro_left_hand.urdf",
)
GUESSED = ("warning", "placeholder inertia")
MASSLESS = {("warning", "massless tip"), ("error", "singular mass matrix")}
UNLIMITED = {("warning", "effort limit"), ("warning", "velocity limit")}
ODDITIES = {
    "simple_humanoid_description/urdf/simple_humanoid.urdf": {
        ("warning", "placeholder inertia"),
        ("warning", "density"),
    },
    "asr_twodof_description/urdf/TwoDofs.urdf": {GUESSED},
    "baxter_description/urdf/baxter.urdf": {("warning", "density")},  # fingers of 30 g, of 0.02 kg m^2
    "double_pendulum_description/urdf/double_pendulum.urdf": UNLIMITED,
    "romeo_description/urdf/romeo.urdf": MASSLESS | UNLIMITED,
    "human_description/robots/human.urdf": {("note", "massless")},
    "icub_description/robots/icub.urdf": {("note", "point mass")},
}


@pytest.mark.filterwarnings("ignore:.*(bodies without mass|transmissions are left out)")
@pytest.mark.parametrize(("file", "kinds"), [*((file, set()) for file in SOUND), *ODDITIES.items()])
def test_real_robots(file, kinds):
    """What is right is left alone, and what is odd is so indeed: each finding was looked up in its file."""
    assert set(found(jounce.load(REAL[file]))) == kinds


def info(*words):
    return call("info", *words)


def load_odd(path):
    with pytest.warns(jounce.JounceWarning, match="triangle inequality"):
        return jounce.load(path)


@pytest.fixture
def odd_file(tmp_path):
    limit = '<limit effort="1" velocity="1"/>'
    return robot_file(tmp_path, link("base"), link("a", ODD), joint("turn", "base", "a", "continuous", inner=limit))


@pytest.fixture
def noted(tmp_path):
    return robot_file(tmp_path, link("base"), link("a", BODY), joint("turn", "base", "a", "continuous"), name="n.urdf")


@pytest.mark.filterwarnings("default::jounce.JounceWarning")  # which the command shows
@pytest.mark.parametrize("form", [[], ["--json"]], ids=["words", "json"])
def test_strict_exits_with_1_on_errors_and_warnings_and_says_the_same(odd_file, noted, tmp_path, form):
    for path, code in ((odd_file, 1), (noted, 0), (PANDA, 0)):
        strict, lax = info(path, "--strict", *form), info(path, *form)
        assert (strict.exit_code, lax.exit_code) == (code, 0)
        assert strict.stdout == lax.stdout
    refused(tmp_path, ["info", "no.urdf", "--strict", *form], "no.urdf: no such file")


@pytest.mark.filterwarnings("default::jounce.JounceWarning")  # which the command shows
def test_json_holds_the_findings(odd_file):
    [finding] = json.loads(info(odd_file, "--json").stdout)["findings"]
    assert finding == {
        "severity": "error",
        "kind": "triangle inequality",
        "bodies": ["a"],
        "joints": [],
        "number": pytest.approx(-0.5),
        "unit": "kg m^2",
        "text": "principal moments about the COM violate the triangle inequality by 0.5 kg m^2, 20 % of the largest",
        "advice": finding["advice"],
    }
    [same] = load_odd(odd_file).audit()
    assert Finding(**finding).where == same.where
    assert same.as_data() == finding


@pytest.mark.filterwarnings("default::jounce.JounceWarning")  # which the command shows
def test_words_hold_the_findings_and_the_moments(odd_file):
    said = info(odd_file).stdout
    [finding] = load_odd(odd_file).audit()
    assert " ".join(said.split()).endswith(f"error: {finding} {finding.advice}")
    assert max(map(len, said.splitlines())) <= 100
    row = next(line.split() for line in said.splitlines() if line.startswith("a "))
    assert row == ["a", "1", "1", "2.5", "-0.5"]
    assert info(PANDA).stdout.endswith("\nno findings\n")


def calls_to_describe(nb):
    """How many functions are called."""
    parent, kinds = list(range(-1, nb - 1)), ["revolute", "prismatic"] * (nb // 2)
    mechanism = random_mechanism(np.random.default_rng(0), parent, kinds, np.linspace(1, 2, nb).tolist())
    calls = Counter()
    sys.setprofile(lambda frame, event, _: calls.update([event]))
    try:
        describe(mechanism)
    finally:
        sys.setprofile(None)
    return calls["call"] + calls["c_call"]


def test_the_work_of_an_audit_grows_with_the_bodies_alone():
    first, second, third = map(calls_to_describe, (40, 80, 160))
    assert third - second < 2.1 * (second - first)
