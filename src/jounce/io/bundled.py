"""The bundled robots: the paper's as functions, others as files.

A file is ``robots/NAME/robot.yaml``. The files of arms and of robots with legs are converted from URDFs without loss:
their first lines name the URDF, and the licence is in the same folder. Robots with closed loops were written for
jounce, under its licence.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from jounce.core.errors import JounceError, join_names
from jounce.core.scalars import Array, convert_element
from jounce.model import screws
from jounce.model.mechanism import Mechanism
from jounce.spatial.inertia import inertia_matrix, symmetric_matrix
from jounce.spatial.lie import pose

if TYPE_CHECKING:
    from importlib.resources.abc import Traversable

# KUKA LBR iiwa 14 R820, the table of Müller & Kumar, Section 6.2: mass in kg; centre of mass in m; inertia about it in
# kg m^2, axes parallel to the link frame, in the order xx, xy, xz, yy, yz, zz (the paper heads its third column "yx";
# it is xz). Links 4 and 7 break the triangle inequality, by 2.9e-4 and 5.7e-5 kg m^2: rounded, identified data.
IIWA14 = np.array([
    [3.94781, -0.00351, 0.00160, -0.03139, 0.00455, 0.00000, -0.00000, 0.00454, 0.00001, 0.00029],
    [4.50275, -0.00767, 0.16669, -0.00355, 0.00032, 0.00000, 0.00000, 0.00010, -0.00000, 0.00042],
    [2.45520, -0.00225, -0.03492, -0.02652, 0.00223, -0.00005, 0.00007, 0.00219, 0.00007, 0.00073],
    [2.61155, 0.00020, -0.05268, 0.03818, 0.03844, 0.00088, -0.00112, 0.01144, -0.00111, 0.04988],
    [3.41000, 0.00005, -0.00237, -0.21134, 0.00277, -0.00001, 0.00001, 0.00284, -0.00000, 0.00012],
    [3.38795, 0.00049, 0.02019, -0.02750, 0.00050, -0.00005, -0.00003, 0.00281, -0.00004, 0.00232],
    [0.35432, -0.03466, -0.02324, 0.07138, 0.00795, 0.00022, -0.00029, 0.01089, -0.00029, 0.00294],
])  # fmt: skip
UPPER_ARM_LENGTH, FOREARM_LENGTH = 0.42, 0.40  # m, r3 and r5; not in the paper, from the authors' published code

# rotations about x by 90 and -90 degrees
_RX_90, _RX_MINUS_90 = [[1, 0, 0], [0, 0, -1], [0, 1, 0]], [[1, 0, 0], [0, 0, 1], [0, -1, 0]]


def iiwa14(gravity: Array = (0, 0, -9.80665)) -> Mechanism:
    """Return the KUKA LBR iiwa 14 of the paper.

    It has modified Denavit-Hartenberg frames, without base height and flange.
    """
    R = [np.eye(3), _RX_90, _RX_MINUS_90, _RX_MINUS_90, _RX_90, _RX_90, _RX_MINUS_90]
    r = np.zeros((7, 3))
    r[2, 1], r[4, 1] = UPPER_ARM_LENGTH, -FOREARM_LENGTH
    # B_i, the pose of each link in its parent, where q = 0.
    B = [pose(np.array(R_i, dtype=float), r_i[:, None]) for R_i, r_i in zip(R, r, strict=True)]
    M = [inertia_matrix(row[0], row[1:4], symmetric_matrix(row[4:])) for row in IIWA14]
    names = [f"link{i}" for i in range(1, 8)]
    X = [[0, 0, 1, 0, 0, 0]] * 7  # (58)
    return screws.from_screws(B, X, M, None, screws.ScrewOptions(names=names, gravity=gravity, name="iiwa14"))


def planar2r(L1: Array = 1, L2: Array = 1, m1: Array = 1, m2: Array = 1, g: Array = 9.81) -> Mechanism:
    """Return the planar 2R robot of the paper.

    It has point masses at the link ends, and gravity along -y; symbols are values too. The paper prints m L^2 as the xx
    moment of its links; a point mass on the x axis has 0 (it never enters Q).
    """
    for label, x in {"L1": L1, "L2": L2, "m1": m1, "m2": m2, "g": g}.items():
        shape = convert_element(x, label).shape
        if shape != ():
            raise JounceError(f"{label} has shape {shape}; expected one number or symbol")
    B = [np.eye(4, dtype=int), [[1, 0, 0, L1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]]
    M = [inertia_matrix(m, [L, 0, 0], np.zeros((3, 3), dtype=int)) for m, L in ((m1, L1), (m2, L2))]
    options = screws.ScrewOptions(gravity=[0, -convert_element(g, "g"), 0], name="planar2r")
    return screws.from_screws(B, [[0, 0, 1, 0, 0, 0]] * 2, M, None, options)


# A Panda as a series elastic arm. The inertias of its rotors, seen from the links, are those of the FR3, which
# Franka gave to the developers of Drake: manipulation/models/franka_description/README.md of
# https://github.com/RobotLocomotion/drake. No stiffness of its joints is published: those here are INVENTED, as soft
# as those of series elastic actuators.
PANDA_ROTORS = (0.605721456, 0.605721456, 0.462474144, 0.462474144, 0.205544064, 0.205544064, 0.205544064)  # kg m^2
PANDA_STIFFNESS = (1000.0, 1000.0, 1000.0, 1000.0, 400.0, 400.0, 400.0)  # N m/rad, invented


def panda_elastic(gravity: object = None) -> Mechanism:
    """Return the Panda with closed fingers and elastic joints."""
    from jounce.arguments.joint_data import ElasticParameters, with_elasticity  # imported here to keep start-up fast
    from jounce.model.locking import lock_coordinates

    arm = lock_coordinates(_read_bundled("panda", gravity), {"panda_finger_joint1": 0.0})
    parameters = ElasticParameters(stiffness=PANDA_STIFFNESS, rotor=PANDA_ROTORS)
    return replace(with_elasticity(arm, parameters), name="panda_elastic")


@dataclass(frozen=True)
class BundledRobot:
    """A bundled robot: description, size, source of its data, and constructor."""

    name: str
    kind: str
    n: int
    nb: int
    mass: float  # kg, of what moves
    licence: str  # its SPDX identifier
    source: str
    build: Callable[..., Mechanism]
    urdf: str | None = None  # what its file was converted from, in example-robot-data
    like: str | None = None  # the bundled robot from whose file it is made
    base: str | None = None  # the link that can float


def _bundle_file(
    name: str, kind: str, size: tuple[int, int, float], source: str, urdf: str | None = None, base: str | None = None
) -> BundledRobot:
    return BundledRobot(name, kind, *size, _BSD, source, partial(_read_bundled, name), urdf, base=base)


def _read_bundled(name: str, /, gravity: object = None, base: str = "fixed") -> Mechanism:
    """Return the mechanism of the file of a bundled robot."""
    from importlib.resources import as_file  # imported here to keep start-up fast

    from jounce.io import entries, robot_files

    with as_file(_robot_folder(name) / "robot.yaml") as path:
        return robot_files.read(entries.read(path, "the robot"), gravity, base)


def _robot_folder(name: str) -> "Traversable":
    from importlib.resources import files  # imported here to keep start-up fast

    return files("jounce.io") / "robots" / name


def check_floating_base(name: str) -> None:
    """Raise `JounceError` unless a bundled robot can float.

    The inertia of its base has to be known.
    """
    if BUNDLED[name].base is None:
        floating = join_names(robot.name for robot in BUNDLED.values() if robot.base is not None)
        raise JounceError(
            f"{name} has no floating base: the inertia of its base is not known; robots with one: {floating}"
        )


def read_notices(name: str) -> dict[str, str]:
    """Return the licence texts of a robot's file by name.

    Robots under the licence of jounce have no further texts.
    """
    like = BUNDLED[name].like
    folder = _robot_folder(name if like is None else like)
    texts = (folder / text for text in ("NOTICE", "LICENSE"))
    return {text.name: text.read_text(encoding="utf-8") for text in texts if text.is_file()}


_APACHE, _BSD, _PAPER, _GITHUB = "Apache-2.0", "BSD-3-Clause", "Müller & Kumar, Section 6", "https://github.com/"

BUNDLED: dict[str, BundledRobot] = {
    robot.name: robot
    for robot in (
        BundledRobot("iiwa14", "arm, KUKA LBR iiwa 14 R820", 7, 7, 20.66958, _BSD, _PAPER, iiwa14),
        BundledRobot("planar2r", "two links in a plane", 2, 2, 2.0, _BSD, _PAPER, planar2r),
        BundledRobot("panda", "arm with gripper, Franka Panda", 8, 9, 16.822132, _APACHE,
                _GITHUB + "frankaemika/franka_ros", partial(_read_bundled, "panda"),
                "panda_description/urdf/panda.urdf"),
        BundledRobot("panda_elastic", "Panda, elastic joints of invented stiffness", 7, 7, 16.822132, _APACHE,
                _GITHUB + "frankaemika/franka_ros", panda_elastic, like="panda"),
        _bundle_file("ur5", "arm, Universal Robots UR5", (6, 6, 16.9939), _GITHUB + "ros-industrial/universal_robot",
                 "ur_description/urdf/ur5_robot.urdf"),
        _bundle_file("ur10", "arm, Universal Robots UR10", (6, 6, 28.7), _GITHUB + "ros-industrial/universal_robot",
                 "ur_description/urdf/ur10_robot.urdf"),
        _bundle_file("xarm7", "arm, UFACTORY xArm 7", (7, 7, 10.4315), _GITHUB + "xArm-Developer/xarm_ros2",
                 "xarm_description/urdf/xarm7.urdf"),
        _bundle_file("g1", "humanoid on its pelvis, Unitree G1", (29, 29, 29.52714202),
                 _GITHUB + "unitreerobotics/unitree_ros", "g1_description/urdf/g1_29dof_rev_1_0.urdf", "pelvis"),
        _bundle_file("anymal", "quadruped on its base, ANYmal C", (12, 12, 25.76168),
                 _GITHUB + "ANYbotics/anymal_c_simple_description",
                 "anymal_c_simple_description/urdf/anymal.urdf", "base"),
        _bundle_file("solo12", "quadruped on its base, Solo 12", (12, 12, 1.33885188),
                 _GITHUB + "open-dynamic-robot-initiative/robot_properties_solo",
                 "solo_description/robots/solo12.urdf", "base_link"),
        _bundle_file("fivebar", "parallel, planar five-bar, invented", (2, 4, 1.05), "invented"),
        _bundle_file("delta", "parallel, Delta, arm masses invented", (3, 12, 1.76), _GITHUB + "RicoJia/Omnid_Project"),
        _bundle_file("gough_stewart", "parallel, Gough-Stewart, legs invented", (6, 21, 3.9),
                 "https://reference.wolfram.com/system-modeler/libraries/IndustryExamples/"),
        _bundle_file("fourbar_leg", "parallel, four-bar leg, invented", (2, 4, 3.27), "invented"),
    )
}  # fmt: skip
