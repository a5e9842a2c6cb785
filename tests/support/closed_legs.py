"""Legs with closed loops in the manner of Gepetto's example-parallel-robots: a URDF, its YAML, and MuJoCo's model.

Every link stands in the axes of the world where all joints are at 0, and every loop is closed there, as in exports of
CAD. The URDF and the YAML are what jounce reads; the MJCF has the same links, with MuJoCo's own balls, connections and
welds.

Shares with jounce: nothing.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import mujoco
import numpy as np

Point = Sequence[float]
Y_AXIS = (0, 1, 0)
BALL, UNIVERSAL = "SPHERICAL", "CARDAN"
BASE_MASS, BASE_MOMENTS = 3.0, np.array([0.02, 0.03, 0.04])


@dataclass(frozen=True)
class Part:
    """A link and the joint that carries it: where its origin is in the world, and its mass."""

    name: str
    parent: str
    joint: str
    point: Point
    mass: float
    to: Point = (0, 0, 0)  # the COM is halfway to this place, seen from its origin
    axis: Point = Y_AXIS
    kind: str = "revolute"  # in the URDF
    real: str = ""  # in the YAML

    @property
    def com(self) -> np.ndarray:
        """The COM, a little off the line."""
        return np.array(self.to, dtype=float) / 2 + [0.004, 0.003, -0.002]

    @property
    def moments(self) -> np.ndarray:
        """The principal moments of inertia about the COM."""
        return self.mass * (np.array([0.0011, 0.0013, 0.0009]) + (np.dot(self.to, self.to) / 12))


@dataclass(frozen=True)
class Loop:
    """Two links that meet at a place of the world, by a ball (3d) or a weld (6d)."""

    a: str
    b: str
    point: Point
    kind: str


@dataclass(frozen=True)
class Leg:
    """A leg: its parts, its loops and its motors."""

    name: str
    parts: Sequence[Part]
    loops: Sequence[Loop]
    motors: Sequence[str]
    passive: int = 0  # how many coordinates its motors leave loose
    base: str = "base_link"
    stated: Mapping[str, Any] = field(default_factory=dict)  # further keys of its YAML

    def points(self) -> dict[str, np.ndarray]:
        """The origins of all links in the world, by name."""
        return {self.base: np.zeros(3)} | {part.name: np.array(part.point, dtype=float) for part in self.parts}

    def urdf(self) -> str:
        """The URDF: a tree, with a pair of links without mass for each loop."""
        places = self.points()
        lines = [f'<robot name="{self.name}">', _link(self.base, BASE_MASS, np.zeros(3), BASE_MOMENTS)]
        for part in self.parts:
            lines.append(_link(part.name, part.mass, part.com, part.moments))
            limit = '<limit lower="-1" upper="1" effort="1" velocity="20"/>' if part.kind != "fixed" else ""
            origin = places[part.name] - places[part.parent]
            lines.append(_joint(part.joint, part.kind, (part.parent, part.name), origin, part.axis, limit))
        for k, loop in enumerate(self.loops, start=1):
            for side, carrier in zip("AB", (loop.a, loop.b), strict=True):
                frame = f"closedloop{k}_{side}"
                lines.append(f'<link name="{frame}"/>')
                origin = np.array(loop.point) - places[carrier]
                lines.append(_joint(f"{frame}_frame", "fixed", (carrier, frame), origin, Y_AXIS, ""))
        return "\n".join([*lines, "</robot>"])

    def yaml(self) -> dict[str, Any]:
        """The content of the YAML beside it."""
        replaced = [part for part in self.parts if part.real != ""]
        data: dict[str, Any] = {
            "closed_loop": [[f"closedloop{k}_B", f"closedloop{k}_A"] for k in range(1, len(self.loops) + 1)],
            "type": [loop.kind for loop in self.loops],
            "name_mot": list(self.motors),
        }
        if replaced:
            data["joint_name"] = [part.joint for part in replaced]
            data["joint_type"] = [part.real for part in replaced]
        return data | dict(self.stated)

    def mjcf(self, floats: bool) -> str:
        """The same leg for MuJoCo, with connections and welds of its own; the joint of a base that floats is "base"."""
        places = self.points()

        def body(part: Part) -> str:
            pos = _text(places[part.name] - places[part.parent])
            inertial = f'<inertial pos="{_text(part.com)}" mass="{part.mass}" diaginertia="{_text(part.moments)}"/>'
            inside = "".join(body(child) for child in self.parts if child.parent == part.name)
            return f'<body name="{part.name}" pos="{pos}">{inertial}{_mujoco_joints(part)}{inside}</body>'

        bodies = "".join(body(part) for part in self.parts if part.parent == self.base)
        if floats:
            moments = f'pos="0 0 0" mass="{BASE_MASS}" diaginertia="{_text(BASE_MOMENTS)}"'
            bodies = f'<freejoint name="base"/><inertial {moments}/>{bodies}'
        ties = []
        for loop in self.loops:
            anchor = np.array(loop.point) - places[loop.a if loop.kind.lower() == "3d" else loop.b]
            pair = f'body1="{loop.a}" body2="{loop.b}" anchor="{_text(anchor)}"'
            ties.append(f"<{'connect' if loop.kind.lower() == '3d' else 'weld'} {pair}/>")
        return (
            f'<mujoco><option gravity="0 0 -9.81"/><worldbody><body name="{self.base}">{bodies}</body></worldbody>'
            f"<equality>{''.join(ties)}</equality></mujoco>"
        )


def _text(numbers: Any) -> str:
    return " ".join(repr(float(x)) for x in numbers)


def _link(name: str, mass: float, com: np.ndarray, moments: np.ndarray) -> str:
    ixx, iyy, izz = moments
    tensor = f'<inertia ixx="{ixx}" iyy="{iyy}" izz="{izz}" ixy="0" ixz="0" iyz="0"/>'
    return f'<link name="{name}"><inertial><origin xyz="{_text(com)}"/><mass value="{mass}"/>{tensor}</inertial></link>'


def _joint(name: str, kind: str, ends: tuple[str, str], origin: np.ndarray, axis: Point, limit: str) -> str:
    place = f'<origin xyz="{_text(origin)}"/><parent link="{ends[0]}"/><child link="{ends[1]}"/>'
    return f'<joint name="{name}" type="{kind}">{place}<axis xyz="{_text(axis)}"/>{limit}</joint>'


def _mujoco_joints(part: Part) -> str:
    if part.real == BALL:
        return f'<joint name="{part.joint}" type="ball"/>'
    if part.real == UNIVERSAL:
        return "".join(
            f'<joint name="{part.joint}_{end}" type="hinge" axis="{axis}"/>'
            for end, axis in (("X", "1 0 0"), ("Y", "0 1 0"))
        )
    if part.kind == "fixed" or part.real == "FIXED":
        return ""
    kind = {"revolute": "hinge", "prismatic": "slide"}[part.kind]
    return f'<joint name="{part.joint}" type="{kind}" axis="{_text(part.axis)}"/>'


def _between(first: Point, second: Point) -> np.ndarray:
    return np.array(second, dtype=float) - np.array(first, dtype=float)


def five_bar(kind: str) -> Leg:
    """Two motors at the hip, two shins that meet at the foot: by a pin and a weld (6d), or by a ball (3d)."""
    hips, knees, foot = ((-0.06, 0, 0), (0.06, 0, 0)), ((-0.16, 0, -0.18), (0.15, 0, -0.19)), (0.02, 0, -0.36)
    parts = []
    for side, hip, knee in zip(("left", "right"), hips, knees, strict=True):
        parts.append(Part(f"thigh_{side}", "base_link", f"motor_{side}", hip, 0.9, _between(hip, knee)))
        parts.append(Part(f"shin_{side}", f"thigh_{side}", f"knee_{side}", knee, 0.5, _between(knee, foot)))
    if kind == "6d":
        parts.append(Part("foot", "shin_left", "pin_foot", foot, 0.2, (0.05, 0, 0)))
    ends = ("foot" if kind == "6d" else "shin_left", "shin_right")
    return Leg(f"five_bar_{kind}", parts, [Loop(*ends, foot, kind)], ["motor_left", "motor_right"])


def four_bar_knee() -> Leg:
    """A hip, and a knee that a crank on the thigh moves by a coupler."""
    crank, lever, knee = (-0.05, 0, -0.08), (-0.06, 0, -0.33), (0, 0, -0.35)
    tip = (-0.09, 0, -0.11)
    parts = [
        Part("thigh", "base_link", "motor_hip", (0, 0, 0), 2.0, (0, 0, -0.35)),
        Part("shin", "thigh", "knee", knee, 1.1, (0, 0, -0.3)),
        Part("crank", "thigh", "motor_knee", crank, 0.2, _between(crank, tip)),
        Part("coupler", "crank", "free_coupler", tip, 0.3, _between(tip, lever)),
        Part("pin", "coupler", "free_pin", lever, 0.05, (0.01, 0, 0)),
    ]
    return Leg("four_bar_knee", parts, [Loop("pin", "shin", lever, "6D")], ["motor_hip", "motor_knee"])


def slider_knee() -> Leg:
    """A knee that a linear motor bends: a cylinder on the thigh, a piston whose end is on a lever of the shin."""
    pivot, lever, knee = (0.06, 0, -0.05), (0.05, 0, -0.37), (0, 0, -0.35)
    along = _between(pivot, lever) / np.linalg.norm(_between(pivot, lever))
    middle = np.array(pivot) + 0.15 * along
    parts = [
        Part("thigh", "base_link", "motor_hip", (0, 0, 0), 2.0, (0, 0, -0.35)),
        Part("shin", "thigh", "knee", knee, 1.1, (0, 0, -0.3)),
        Part("cylinder", "thigh", "free_cylinder", pivot, 0.4, _between(pivot, middle)),
        Part("piston", "cylinder", "motor_slider", middle, 0.3, _between(middle, lever), along, "prismatic"),
    ]
    return Leg("slider_knee", parts, [Loop("piston", "shin", lever, "3D")], ["motor_hip", "motor_slider"])


def rod_ankle() -> Leg:
    """A foot on a universal joint, turned in pitch and roll by two rods with a ball at both ends."""
    ankle = (0, 0, -0.4)
    parts = [Part("foot", "base_link", "ankle", ankle, 0.8, (0.06, 0, -0.05), real=UNIVERSAL)]
    loops = []
    for k, (side, height) in enumerate(((0.045, -0.12), (-0.045, -0.2)), start=1):
        hub, top, bottom = (0, side, height), (-0.05, side, height + 0.01), (-0.055, 0.9 * side, -0.41)
        parts += [
            Part(f"crank{k}", "base_link", f"motor_shin{k}", hub, 0.15, _between(hub, top)),
            Part(f"rod{k}", f"crank{k}", f"spherical_free_shin{k}", top, 0.12, _between(top, bottom), real=BALL),
            Part(f"end{k}", f"rod{k}", f"spherical_free_foot{k}", bottom, 0.02, (0.01, 0, 0.005), real=BALL),
        ]
        loops.append(Loop(f"end{k}", "foot", bottom, "6d"))
    return Leg("rod_ankle", parts, loops, ["motor_shin1", "motor_shin2"], passive=2)


def delta_leg() -> Leg:
    """A foot that slides along x, y and z, carried by three cranks and rods on universal joints."""
    foot = (0.0, 0.0, -0.3)
    parts = [
        Part("slide_x", "base_link", "free_x", foot, 0.1, axis=(1, 0, 0), kind="prismatic"),
        Part("slide_y", "slide_x", "free_y", foot, 0.1, axis=(0, 1, 0), kind="prismatic"),
        Part("foot", "slide_y", "free_z", foot, 0.6, (0, 0, -0.05), axis=(0, 0, 1), kind="prismatic"),
    ]
    loops = []
    for k, angle in enumerate(np.radians([20.0, 140.0, 260.0]), start=1):
        out, across = np.array([np.cos(angle), np.sin(angle), 0]), np.array([-np.sin(angle), np.cos(angle), 0])
        hip, elbow, tip = 0.08 * out, 0.2 * out - [0, 0, 0.05], np.array(foot) + 0.04 * out
        parts += [
            Part(f"arm{k}", "base_link", f"motor_{k}", hip, 0.4, _between(hip, elbow), axis=across),
            Part(f"rod{k}", f"arm{k}", f"cardan_{k}", elbow, 0.15, _between(elbow, tip), real=UNIVERSAL),
        ]
        loops.append(Loop(f"rod{k}", "foot", tip, "3d"))
    return Leg("delta_leg", parts, loops, ["motor_1", "motor_2", "motor_3"])


def parallelogram_hip() -> Leg:
    """A thigh that two equal links carry, which keeps its direction, and an ankle."""
    front, back, down = (0.05, 0, 0), (-0.05, 0, 0), np.array([0.04, 0, -0.3])
    parts = [
        Part("front", "base_link", "motor_hip", front, 1.2, down),
        Part("back", "base_link", "free_back", back, 0.8, down),
        Part("bridge", "front", "free_bridge", np.array(front) + down, 0.6, (-0.1, 0, 0)),
        Part("foot", "bridge", "motor_ankle", np.array(front) + down + [0, 0, -0.04], 0.4, (0.08, 0, -0.03)),
    ]
    return Leg(
        "parallelogram_hip", parts, [Loop("bridge", "back", np.array(back) + down, "3d")], ["motor_hip", "motor_ankle"]
    )


def two_legs() -> Leg:
    """A biped of twelve motors: turns of the hip about z and x, a four-bar knee and an ankle with two rods on each."""
    parts, loops, motors = [], [], []
    knee, ankle = four_bar_knee(), rod_ankle()
    for side, place in (("left", (0, 0.1, -0.05)), ("right", (0, -0.1, -0.05))):
        hip = np.array(place)
        parts += [
            Part(f"hip_z_{side}", "base_link", f"motor_hip_z_{side}", hip, 0.8, (0, 0, -0.05), axis=(0, 0, 1)),
            Part(f"hip_x_{side}", f"hip_z_{side}", f"motor_hip_x_{side}", hip, 0.7, (0, 0, -0.05), axis=(1, 0, 0)),
        ]
        motors += [f"motor_hip_z_{side}", f"motor_hip_x_{side}"]
        for leg, base, origin in ((knee, "hip_x", hip), (ankle, "shin", hip - np.array([0, 0, 0.35]))):
            for part in leg.parts:
                names = {"name": f"{part.name}_{side}", "joint": f"{part.joint}_{side}"}
                parent = base if part.parent == "base_link" else part.parent
                parts.append(replace(part, **names, parent=f"{parent}_{side}", point=origin + part.point))
            loops += [Loop(f"{x.a}_{side}", f"{x.b}_{side}", origin + x.point, x.kind) for x in leg.loops]
            motors += [f"{motor}_{side}" for motor in leg.motors]
    return Leg("two_legs", parts, loops, motors, passive=4)


LEGS = {
    leg.name: leg
    for leg in (
        five_bar("6d"),
        five_bar("3d"),
        four_bar_knee(),
        slider_knee(),
        rod_ankle(),
        delta_leg(),
        parallelogram_hip(),
    )
}


class MujocoLeg:
    """MuJoCo's model of a leg, and the motor forces that its inverse dynamics and its constraints need.

    A base that floats stays at the origin.
    """

    def __init__(self, leg: Leg, floats: bool = False) -> None:
        self.leg, self.floats, self.model = leg, floats, mujoco.MjModel.from_xml_string(leg.mjcf(floats))
        self.data = mujoco.MjData(self.model)

    def positions(self, named: Mapping[str, float]) -> np.ndarray:
        """qpos from coordinates by name; of balls by yaw, pitch and roll."""
        qpos = np.zeros(self.model.nq)
        if self.floats:
            qpos[3] = 1.0
        for j in range(self.floats, self.model.njnt):
            joint = self.model.joint(j)
            if joint.type[0] == mujoco.mjtJoint.mjJNT_BALL:
                quaternion = np.array([1.0, 0, 0, 0])
                for end, axis in (("yaw", 2), ("pitch", 1), ("roll", 0)):
                    turn, product = np.zeros(4), np.zeros(4)
                    mujoco.mju_axisAngle2Quat(turn, np.eye(3)[axis], named[f"{joint.name}_{end}"])
                    mujoco.mju_mulQuat(product, quaternion, turn)
                    quaternion = product
                qpos[joint.qposadr[0] : joint.qposadr[0] + 4] = quaternion
            else:
                qpos[joint.qposadr[0]] = named[joint.name]
        return qpos

    def gaps(self, qpos: np.ndarray) -> np.ndarray:
        """How far the loops are open, and the Jacobian of the constraints stays in the data."""
        self.data.qpos[:], self.data.qvel[:] = qpos, 0
        mujoco.mj_forward(self.model, self.data)
        return self.data.efc_pos[: self.data.ne].copy()

    def forces(self, qpos: np.ndarray, qvel: np.ndarray, qacc: np.ndarray) -> tuple[np.ndarray, float]:
        """The forces of motors with which constraint forces balance the motion, and what is left unbalanced.

        Behind them come the force on a base that floats and its moment.
        """
        self.gaps(qpos)
        count = self.data.ne * self.model.nv
        J = self.data.efc_J[:count].reshape(self.data.ne, self.model.nv).copy()
        flags, self.model.opt.disableflags = int(self.model.opt.disableflags), mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        self.data.qpos[:], self.data.qvel[:], self.data.qacc[:] = qpos, qvel, qacc
        mujoco.mj_inverse(self.model, self.data)
        self.model.opt.disableflags = flags
        places = [int(self.model.joint(name).dofadr[0]) for name in self.leg.motors]
        places += range(6 * self.floats)
        ways = np.concatenate([np.eye(self.model.nv)[places], J]).T
        needed = self.data.qfrc_inverse.copy()
        found, *_ = np.linalg.lstsq(ways, needed, rcond=1e-9)
        return found[: len(places)], float(np.abs(ways @ found - needed).max() / np.abs(needed).max())
