"""The plugin of the ros2_control page, against stand-ins of what it uses from ROS 2: configured, activated, stepped."""

import subprocess
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from ruamel.yaml import YAML
from test_pages import ROOT, blocks

import jounce
from support.tools import needs

PAGE = ROOT / "docs" / "howto" / "ros2-control.md"
FLAGS = ["-std=c++17", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wsign-conversion", "-Wshadow", "-Werror"]
DRIVER = """
#include "controller_interface/controller_interface.hpp"

using controller_interface::CallbackReturn;
using controller_interface::return_type;
std::unique_ptr<controller_interface::ControllerInterface> exported();

int main()
{
    auto controller = exported();
    auto &given = controller->get_node()->parameters;
    if (controller->on_init() != CallbackReturn::SUCCESS || controller->on_configure({}) != CallbackReturn::FAILURE)
        return 1; // nothing is given yet
%s
    if (controller->on_configure({}) != CallbackReturn::SUCCESS)
        return 2;
    for (const auto &name : controller->command_interface_configuration().names)
        std::printf("%%s ", name.c_str());
    for (const auto &name : controller->state_interface_configuration().names)
        std::printf("%%s ", name.c_str());
    std::printf("\\n");
    controller->command_interfaces_.resize(7);
    controller->state_interfaces_.resize(14);
    if (controller->on_activate({}) != CallbackReturn::FAILURE)
        return 3; // no position is known yet
    for (std::size_t i = 0; i < 14; i++)
        controller->state_interfaces_[i].value = 0.01 * static_cast<double>(i);
    if (controller->on_activate({}) != CallbackReturn::SUCCESS)
        return 4;
    for (int step = 0; step < 601; step++)
        if (controller->update({}, {0.001}) != return_type::OK)
            return 5;
    for (const auto &command : controller->command_interfaces_)
        std::printf("%%.17g ", *command.value);
}
"""


def literal(value):
    """A parameter of ROS as an initialiser in C++."""
    if isinstance(value, list):
        kind = "std::string" if isinstance(value[0], str) else "double"
        return f"std::vector<{kind}>{{{', '.join(map(literal, value))}}}"
    return f'"{value}"' if isinstance(value, str) else repr(float(value))


@pytest.fixture(scope="module")
def ros_package(tmp_path_factory):
    """The files of the page, the generated code among them, and the stand-ins under the names of ROS's headers."""
    folder = tmp_path_factory.mktemp("package")
    for kind, text, _ in blocks(PAGE):
        if kind.startswith("iiwa14_feedforward/"):
            (folder / Path(kind).name).write_text(text)
    jounce.load("iiwa14").codegen("cpp", directory=folder / "iiwa14")
    for name in ("controller_interface/controller_interface.hpp", "pluginlib/class_list_macros.hpp"):
        header = folder / "include" / name
        header.parent.mkdir(parents=True)
        header.write_text(f'#include "{ROOT / "tests" / "stand_ins" / "ros2_control.hpp"}"\n')
    return folder


@pytest.fixture(scope="module")
def settings(ros_package):
    """As ROS reads them: YAML 1.1, where 10e3 is a text."""
    yaml = YAML(typ="safe")
    yaml.version = "1.1"
    return yaml.load((ros_package / "controllers.yaml").read_text())


def driver_output(package, parameters):
    """What the driver prints."""
    given = "\n".join(f'    given["{name}"] = {{{literal(value)}}};' for name, value in parameters.items())
    (package / "driver.cpp").write_text(DRIVER % given)
    command = ["g++", *FLAGS, "-Iinclude", "-Iiiwa14", "controller.cpp", "driver.cpp", "-o", "driver"]
    subprocess.run(command, cwd=package, check=True)
    return subprocess.run([package / "driver"], capture_output=True, text=True, check=True).stdout


@needs("g++")
def test_the_plugin_commands_the_torques_of_elastic_joints(ros_package, settings):
    given = settings["feedforward"]["ros__parameters"]
    names, commands = driver_output(ros_package, given).split("\n")
    kinds = (("effort",), ("position", "velocity"))
    assert names.split() == [f"{joint}/{kind}" for of in kinds for joint in given["joints"] for kind in of]

    robot, still = jounce.load("iiwa14"), np.zeros(7)
    goal, K, B, kp, kd = (np.array(given[name]) for name in ("goal", "stiffness", "rotor", "kp", "kd"))
    theta, thetad = 0.01 * np.arange(14).reshape(7, 2).T
    start = theta
    for _ in range(30):
        start = theta - robot.inverse_dynamics(start, still, still) / K
    s = np.polynomial.Polynomial([0, 0, 0, 0, 0, 126, -420, 540, -315, 70])
    x, T = 0.6 / given["duration"], given["duration"]
    q, *rates = (start * (k == 0) + (goal - start) * s.deriv(k)(x) / T**k for k in range(5))
    Q, Qd, Q2d = robot.inverse_dynamics(q, *rates)
    expected = Q + B * (rates[1] + Q2d / K) + kp * (q + Q / K - theta) + kd * (rates[0] + Qd / K - thetad)
    np.testing.assert_allclose(np.array(commands.split(), float), expected, rtol=1e-9)


def test_the_files_of_the_package_name_each_other(ros_package, settings):
    library = ElementTree.parse(ros_package / "plugin.xml").getroot()
    cmake = (ros_package / "CMakeLists.txt").read_text()
    assert library.find("class").get("name") == settings["controller_manager"]["ros__parameters"]["feedforward"]["type"]
    assert f"add_library({library.get('path')} SHARED controller.cpp)" in cmake
    assert library.find("class").get("type") in (ros_package / "controller.cpp").read_text()
    manifest = ElementTree.parse(ros_package / "package.xml").getroot()
    assert manifest.findtext("name") == "iiwa14_feedforward"
    assert [x.text for x in manifest.findall("depend")] == ["controller_interface", "pluginlib"]
    assert all(f"find_package({x.text} REQUIRED)" in cmake for x in manifest.findall("depend"))
