"""Packages that a xacro file names: found around its own, as workspaces lay them out, by the names they state."""

import numpy as np
import pytest

import jounce
from jounce.io import xacro
from support.refusals import refusal

XACRO = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
ARM = f"""<robot name="arm" {XACRO}>
<xacro:include filename="$(find arm_macros)/urdf/link.xacro"/>
<link name="base"/>
<xacro:one_link name="l1" parent="base" mass="3.25" z="0.1"/>
<xacro:one_link name="l2" parent="l1" mass="1.5" z="0.3"/>
</robot>
"""
MACROS = f"""<robot {XACRO}>
<xacro:macro name="one_link" params="name parent mass z">
<link name="${{name}}"><inertial><origin xyz="0 0 0.15"/><mass value="${{mass}}"/>
<inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.005"/></inertial></link>
<joint name="j_${{name}}" type="revolute"><parent link="${{parent}}"/><child link="${{name}}"/>
<origin xyz="0 0 ${{z}}"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="50" velocity="2"/></joint>
</xacro:macro>
</robot>
"""


def write_package(folder, name, **files):
    (folder / "urdf").mkdir(parents=True)
    author = "<author>Somebody</author><export><name>another</name></export>"
    (folder / "package.xml").write_text(f'<package format="3"><name> {name}\n</name>{author}</package>')
    for file, text in files.items():
        (folder / "urdf" / f"{file}.xacro").write_text(text)
    return folder


def masses(path):
    return jounce.load(path).mechanism.M[:, 3, 3].tolist()


@pytest.mark.parametrize(
    ("own", "other"),
    [
        ("src/arm_description", "src/arm_macros"),
        ("src/arm_description", "src/any-checkout"),  # the manifest names a package, not its folder
        ("src/arm_description", "src/macros/arm_macros"),  # a repository of packages
        ("src/arm/arm_description", "src/arm_macros"),
        ("src/arm/arm_description", "src/macros/arm_macros"),
    ],
)
def test_finds_a_package_around_its_own(tmp_path, own, other):
    write_package(tmp_path / other, "arm_macros", link=MACROS)
    path = write_package(tmp_path / own, "arm_description", arm=ARM) / "urdf/arm.xacro"
    assert masses(path) == [3.25, 1.5]


def test_a_file_without_a_package_finds_those_around_it(tmp_path):
    write_package(tmp_path / "arm_macros", "arm_macros", link=MACROS)
    (tmp_path / "arm.xacro").write_text(ARM)
    assert masses(tmp_path / "arm.xacro") == [3.25, 1.5]


def test_the_nearest_package_counts_and_two_as_near_are_named(tmp_path):
    path = write_package(tmp_path / "src/arm/arm_description", "arm_description", arm=ARM) / "urdf/arm.xacro"
    write_package(tmp_path / "src/one", "arm_macros", link=MACROS.replace("${mass}", "7"))
    assert masses(path) == [7, 7]
    (tmp_path / "src/link").symlink_to(tmp_path / "src/one")  # the same package
    assert masses(path) == [7, 7]
    write_package(tmp_path / "src/two", "arm_macros", link=MACROS)
    words = ["2 packages are named 'arm_macros'", "src/one", "src/two", "ROS_PACKAGE_PATH"]
    refusal(lambda: jounce.load(path), str(path), *words)
    (tmp_path / "src/one/COLCON_IGNORE").touch()
    assert masses(path) == [3.25, 1.5]
    write_package(tmp_path / "src/arm/three", "arm_macros", link=MACROS.replace("${mass}", "8"))
    (tmp_path / "src/one/COLCON_IGNORE").unlink()
    assert masses(path) == [8, 8]


def test_the_environment_of_ros_comes_before_what_lies_around(tmp_path, monkeypatch):
    path = write_package(tmp_path / "src/arm_description", "arm_description", arm=ARM) / "urdf/arm.xacro"
    for name, mass in (("one", "7"), ("two", "8")):
        write_package(tmp_path / "src" / name, "arm_macros", link=MACROS.replace("${mass}", mass))
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "src/two"))
    assert masses(path) == [8, 8]


def test_what_is_not_found_lists_where_it_was_looked_for(tmp_path):
    path = write_package(tmp_path / "src/arm_description", "arm_description", arm=ARM) / "urdf/arm.xacro"
    write_package(tmp_path / "src/a/b/too_deep", "arm_macros", link=MACROS)
    (tmp_path / "src/broken").mkdir()
    (tmp_path / "src/broken/package.xml").write_text("<package><name>arm_macros")
    words = ["no package 'arm_macros' in the folders above the file", str(tmp_path / "src"), "ROS_PACKAGE_PATH"]
    refusal(lambda: jounce.load(path), str(path), *words)
    write_package(tmp_path / "src/arm/another", "another", arm=ARM)
    write_package(tmp_path / "arm_macros", "arm_macros", link=MACROS)  # outside of src: of whom is not known
    refusal(lambda: jounce.load(tmp_path / "src/arm/another/urdf/arm.xacro"), "no package 'arm_macros'")


@pytest.mark.parametrize(("most", "is_found"), [(3, True), (2, False)])
def test_the_search_is_bounded(tmp_path, monkeypatch, most, is_found):
    """Three folders are looked at: the package itself and its neighbours, in their order."""
    monkeypatch.setattr(xacro, "MAX_SEARCHED_FOLDERS", most)
    path = write_package(tmp_path / "src/arm_description", "arm_description", arm=ARM) / "urdf/arm.xacro"
    write_package(tmp_path / "src/arm_macros", "arm_macros", link=MACROS)
    (tmp_path / "src/empty").mkdir()
    if is_found:
        assert masses(path) == [3.25, 1.5]
    else:
        refusal(lambda: jounce.load(path), "more than 2 folders to search for package 'arm_macros'", "ROS_PACKAGE_PATH")


def test_packages_that_include_each_other_are_refused_in_a_line(tmp_path):
    def including(other):
        return f'<robot name="arm" {XACRO}><xacro:include filename="$(find {other})/urdf/{other}.xacro"/></robot>'

    for own, other in (("a", "b"), ("b", "c"), ("c", "b")):
        write_package(tmp_path / own, own, **{own: including(other)})
    path = tmp_path / "a/urdf/a.xacro"
    refusal(lambda: jounce.load(path), str(path), "b.xacro includes itself, by c.xacro")


def test_forces_of_the_arm_of_two_packages(tmp_path):
    """Against the weight of two links that lie flat, in closed form."""
    write_package(tmp_path / "arm_macros", "arm_macros", link=MACROS)
    path = write_package(tmp_path / "arm_description", "arm_description", arm=ARM) / "urdf/arm.xacro"
    robot = jounce.load(path)
    g = 9.81
    np.testing.assert_allclose(
        robot.gravity_forces([np.pi / 2, 0]), [-g * (3.25 * 0.15 + 1.5 * 0.45), -g * 1.5 * 0.15], rtol=1e-12
    )
