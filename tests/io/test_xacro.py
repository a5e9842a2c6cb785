"""xacro files: expanded by xacrodoc, then read as any URDF; what goes wrong is one line."""

import builtins
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import xacro
import xacro.color
from xacrodoc import packages

import jounce
from jounce.io.xacro import expand
from support.files import GOOD, robot_file
from support.refusals import refusal

ARM = """<?xml version="1.0"?>
<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:arg name="mass" default="2"/>
  <xacro:property name="length" value="${2 * 0.25}"/>
  <xacro:include filename="rod.xacro"/>
  <link name="base"/>
  <xacro:rod name="rod" mass="$(arg mass)"/>
  <joint name="turn" type="revolute">
    <parent link="base"/>
    <child link="rod"/>
    <axis xyz="0 1 0"/>
  </joint>
</robot>
"""
ROD = """<robot xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:macro name="rod" params="name mass">
    <link name="${name}">
      <visual><geometry><mesh filename="package://nowhere/rod.stl"/></geometry></visual>
      <inertial>
        <origin xyz="0 0 ${-length}"/>
        <mass value="${mass}"/>
        <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.01"/>
      </inertial>
    </link>
  </xacro:macro>
</robot>
"""

ROUNDS = 40  # of 16 expansions by eight threads


@pytest.fixture
def arm_file(tmp_path):
    """A function that writes the arm with one text in the place of another."""

    def write(old="", new="", name="arm.urdf.xacro"):
        assert old in ARM
        (tmp_path / "rod.xacro").write_text(ROD)
        path = tmp_path / name
        path.write_text(ARM.replace(old, new) if old else ARM)
        return path

    return write


@pytest.mark.parametrize("name", ["arm.urdf.xacro", "arm.xacro", "Arm.XACRO"])
@pytest.mark.parametrize(("given", "mass"), [({}, 2.0), ({"mass": 3.5}, 3.5), ({"mass": "4"}, 4.0)])
def test_expands(arm_file, monkeypatch, name, given, mass):
    path = arm_file(name=name)
    monkeypatch.chdir("/")  # includes are found beside the file, not where the user stands
    robot = jounce.load(path, xacro_args=given) if given else jounce.load(path)
    assert (robot.name, robot.joint_names, robot.body_names) == ("arm", ("turn",), ("rod",))
    expected = jounce.inertia_matrix(mass, [0, 0, -0.5], np.diag([0.1, 0.1, 0.01]))
    np.testing.assert_allclose(robot.mechanism.M, [expected], atol=1e-15)


def test_all_options_of_a_urdf_hold(arm_file):
    path = arm_file('type="revolute"', 'type="floating"')
    assert jounce.load(path).nq == 7
    with pytest.warns(jounce.JounceWarning, match="welds at zero"):
        refusal(lambda: jounce.load(path, base="fixed"), "no movable joint")
    with pytest.warns(jounce.JounceWarning, match="has no inertia"):
        assert jounce.load(arm_file(), base="floating").nv == 7
    robot = jounce.load(arm_file(), gravity=(0, 0, -1), lock={})
    np.testing.assert_allclose(robot.gravity_forces([np.pi / 2]), [2 * 0.5], atol=1e-15)


def test_packages_are_looked_for_above_the_file(arm_file, tmp_path):
    (tmp_path / "package.xml").write_text("<package><name>rods_of_a_test</name></package>")
    assert jounce.load(arm_file('"rod.xacro"', '"$(find rods_of_a_test)/rod.xacro"')).n == 1


def test_packages_of_one_name_are_those_above_each_file(arm_file, tmp_path):
    """What the expansion of one checkout found must not serve another."""
    masses = []
    for checkout in ("one", "two"):
        folder = tmp_path / checkout
        folder.mkdir()
        (folder / "package.xml").write_text("<package><name>rods_of_a_test</name></package>")
        (folder / "rod.xacro").write_text(ROD.replace("${mass}", str(len(masses) + 1)))
        path = folder / "arm.xacro"
        path.write_text(ARM.replace('"rod.xacro"', '"$(find rods_of_a_test)/rod.xacro"'))
        masses.append(jounce.load(path).mechanism.M[0, 3, 3])
    assert masses == [1.0, 2.0]
    path = arm_file('"rod.xacro"', '"$(find rods_of_a_test)/rod.xacro"')  # above both
    refusal(lambda: jounce.load(path), str(path), "2 packages are named 'rods_of_a_test'", "ROS_PACKAGE_PATH")


def test_a_nameless_robot_is_named_after_its_file(arm_file):
    assert jounce.load(arm_file(' name="arm" xmlns', " xmlns")).name == "arm"


REFUSED = {
    "unknown name": ("2 * 0.25", "2 * x", ["xacro", "'x' is not defined"]),
    "division by zero": ("2 * 0.25", "1 / 0", ["division by zero", "1 / 0"]),
    "code": ("2 * 0.25", "open('x')", ["xacro"]),
    "absent include": ("rod.xacro", "rood.xacro", ["No such file", "rood.xacro"]),
    "absent package": ('"rod.xacro"', '"$(find no_such_package)/rod.xacro"', ["no_such_package"]),
    "unknown macro": ("xacro:rod ", "xacro:rood ", ["unknown macro", "rood"]),
    "unknown argument": ("$(arg mass)", "$(arg mas)", ["mas"]),
    "no XML": ("</robot>", "", ["no element found"]),
    "infinite mass": ("$(arg mass)", "${1e999}", ["(expanded):", "<mass value='inf'>", "finite"]),
    "a bad number": ("0 1 0", "0 1 o", ["(expanded):", "<axis xyz='0 1 o'>", "3 finite numbers"]),
}


@pytest.mark.parametrize(("old", "new", "words"), REFUSED.values(), ids=REFUSED)
def test_refuses(arm_file, old, new, words):
    path = arm_file(old, new)
    refusal(lambda: jounce.load(path), str(path), *words)


ENDLESS = '<xacro:macro name="rod" params="name mass"><xacro:rod name="${name}" mass="1"/></xacro:macro>'


def test_macros_and_files_that_take_themselves_are_refused_early(arm_file, monkeypatch):
    depth = []
    xacro = pytest.importorskip("xacro")
    evaluate = xacro.eval_all
    monkeypatch.setattr(xacro, "eval_all", lambda *given: depth.append(1) or evaluate(*given))
    path = arm_file('<link name="base"/>', f'{ENDLESS}<link name="base"/>')
    refusal(lambda: jounce.load(path), str(path), "<xacro:rod name=rod mass=1> calls itself without end")
    assert len(depth) < 200  # Python's stack ends far beyond
    path = arm_file('"rod.xacro"', '"arm.urdf.xacro"')
    refusal(lambda: jounce.load(path), "arm.urdf.xacro includes itself")


def test_macros_may_call_themselves_some_times(arm_file):
    links = """<xacro:macro name="rods" params="n"><link name="x${n}"/>
    <joint name="j${n}" type="fixed"><parent link="base"/><child link="x${n}"/></joint>
    <xacro:if value="${n > 0}"><xacro:rods n="${n - 1}"/></xacro:if></xacro:macro><xacro:rods n="60"/>"""
    assert len(jounce.load(arm_file('<link name="base"/>', f'<link name="base"/>{links}')).mechanism.frames) == 62


@pytest.mark.parametrize(("given", "words"), [
    ({"mas": 3}, ["unknown xacro argument 'mas'", "did you mean 'mass'"]),
    (3, ["xacro_args is of type int", "mapping"]),
])  # fmt: skip
def test_refuses_arguments(arm_file, given, words):
    refusal(lambda: jounce.load(arm_file(), xacro_args=given), *words)


def test_arguments_are_for_xacro_alone(tmp_path):
    path = robot_file(tmp_path, *GOOD)
    refusal(lambda: jounce.load(path, xacro_args={}), "'xacro_args'", "gravity, base, root")


def test_what_xacro_warns_of_is_a_warning(arm_file, capfd):
    path = arm_file("<link name=", '<xacro:rod name="more" mass="1" colour="red"/><link name=')
    refusal(lambda: jounce.load(path))
    path = arm_file('name="mass" default="2"', 'name="mass" default="2" colour="red"')
    with pytest.warns(jounce.JounceWarning, match=r"xacro: .*colour") as caught:
        assert jounce.load(path).n == 1
    assert len(caught) == 1
    assert str(caught[0].message).isprintable()
    assert capfd.readouterr() == ("", "")


def test_a_missing_package_is_named(arm_file, monkeypatch):
    known = builtins.__import__

    def absent(name, *rest):
        if name.startswith("xacro"):
            raise ImportError(name)
        return known(name, *rest)

    monkeypatch.setattr(builtins, "__import__", absent)
    refusal(lambda: jounce.load(arm_file()), "xacrodoc", "pip install 'jounce[xacro]'")


def test_threads_expand_files_of_their_own(tmp_path):
    """xacro keeps in variables of its module what it is at: one expansion comes after the other, until it is written.

    Written while another file was expanded, three of a thousand lost an element.
    """
    paths = [tmp_path / f"arm{i}" / "arm.urdf.xacro" for i in range(16)]
    for i, path in enumerate(paths):
        path.parent.mkdir()
        (path.parent / "rod.xacro").write_text(ROD.replace('"${name}"', f'"${{name}}{i}"'))
        path.write_text(ARM.replace('child link="rod"', f'child link="rod{i}"'))
    before, interval = state_of_modules(), sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    try:
        with ThreadPoolExecutor(8) as threads:
            texts = list(threads.map(lambda path: expand(path, {}), paths * ROUNDS))
            robots = list(threads.map(jounce.load, paths))
    finally:
        sys.setswitchinterval(interval)
    assert [text.count(b"<joint ") for text in texts] == [1] * len(texts)
    assert [robot.body_names for robot in robots] == [(f"rod{i}",) for i in range(16)]
    assert state_of_modules() == before


def state_of_modules():
    return sys.stderr, xacro.parse, xacro.handle_macro_call, xacro.sys, xacro.color.sys, packages._finder


def test_what_fails_leaves_the_modules_as_they_were(arm_file):
    before = state_of_modules()
    path = arm_file('name="length"', 'name="breadth"')
    refusal(lambda: jounce.load(path), "length")
    assert state_of_modules() == before


def test_what_other_threads_print_is_theirs(arm_file, monkeypatch, capfd):
    path, process = arm_file(), xacro.process_file

    def process_meanwhile(*arguments, **options):
        with ThreadPoolExecutor(1) as another:
            another.submit(print, "of another thread", file=sys.stderr).result()
        return process(*arguments, **options)

    monkeypatch.setattr(xacro, "process_file", process_meanwhile)
    jounce.load(path)
    assert capfd.readouterr().err == "of another thread\n"
