"""Every argument of every public function meets values that it was never meant for: it works, or one line says why."""

import inspect
import warnings
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio
import pytest

import jounce
from jounce import JounceError
from jounce.dynamics.quantities import QUANTITIES
from jounce.dynamics.quantities.row import CLOSED, ELASTIC, ON_CONTACTS
from jounce.model.drive_trains import UNDRIVEN
from jounce.model.limits import LIMIT_KINDS
from support.hostile import HOSTILE

URDF = """<robot name="r"><link name="a"/><link name="b"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/></joint></robot>"""
MJCF = "<mujoco><worldbody><body name='b'><joint name='j'/><geom size='1'/></body></worldbody></mujoco>"
ROBOT = jounce.load("planar2r")
FIVEBAR = jounce.load("fivebar")
SPRUNG = replace(FIVEBAR.mechanism, drives=replace(FIVEBAR.drives, stiffness=np.ones(4)), acting=("spring",))
HALF = jounce.Robot(SPRUNG).closed(actuated=["left_shoulder"], passive=["right_shoulder"])
ARM = ROBOT.elastic([800, 600], rotor=0.1)
KERNEL = ROBOT.compile("gravity_forces", order=0)
SYMBOLIC = ROBOT.symbolic()
B, X, M = (getattr(ROBOT.mechanism, name) for name in "BXM")
TREE = {"parent": [-1, 0], "names": ["a", "b"], "gravity": [0, 0, -9.81], "joint_names": ["c", "d"], "name": "r"}
TREE |= {"limits": {"lower": [-1, -1]}, "drives": {"damping": [1, 1]}}
TREE |= {"G": np.eye(2), "g": [0, 0]}
CHAIN = {key: value for key, value in TREE.items() if key != "parent"}
TREE |= {"base": np.eye(6), "base_name": "trunk"}
WALKER = jounce.Robot.from_screws(B, X, M, base=np.eye(6), base_name="trunk")
FOOT = jounce.Contact("body2", "plane", place=(0.5, 0, 0))
GRIPPING = WALKER.contacts([jounce.Contact("body2", "plane", place=(0.5, 0, 0), friction=0.5)])
SAMPLES = np.linspace(0, 1, 20)
SAMPLED = jounce.load_motion({"t": SAMPLES, "joint1": SAMPLES**2, "joint2": SAMPLES**3}, ROBOT, 0, degree=7)
GUARD = ROBOT.with_limits(velocity=99).guard(SAMPLED)
LOGGED = replace(SAMPLED, torques=(SAMPLES, ROBOT.forces_along(SAMPLED, order=0).forces[0]))
OTHER = replace(LOGGED, torques=(SAMPLES, 2 * LOGGED.torques[1]))
TURNED = replace(SAMPLED, samples=(SAMPLES, SAMPLED(SAMPLES, 0)[0] + LOGGED.torques[1] / [800, 600]))
BENT = replace(SAMPLED, samples=(SAMPLES, -LOGGED.torques[1] / [800, 600]))
TWO = np.stack([SAMPLES**2, SAMPLES**3], axis=1)
AT_REST = {"joint1": SAMPLES, "joint2": SAMPLES**2, "tau_joint1": SAMPLES, "tau_joint2": SAMPLES}
NAMED = {"joint_names": ["joint1", "joint2"]}
POINTS = {
    "joint_names": ["a"],
    "points": [{"positions": [float(i)], "velocities": [0.0], "time_from_start": {"sec": i}} for i in range(2)],
}
MOTION = jounce.Motion.polynomial([[0, 1, 2]], 1.0)
BROKEN = jounce.Motion.piecewise([0, 0.5, 1], [[[1], [2]], [[0], [0.5]]])
READ = {"lock": None, "drives": False, "gravity": None}
PART = {"base": None, "root": None}
XML = {"massless_tips": False, "transmissions": True}
OPTIONS = {"wrench": None, "body": "body1", "frame": "world", "form": "skew"}
OPTIONS |= {"base": None, "method": "recursion", "out": None, "threads": 1, "stiffness": None}

MOTOR = jounce.Motor(gear=9.0, inertia=1e-3, body="body1", resistance=1.0, constant=1.0)
WINDING = ROBOT.elastic(80, motors=MOTOR)
DAMPED = ROBOT.elastic(800, 0.1, damping=1.0, damping_terms=2)

Case = tuple[Callable[..., Any], Mapping[str, Any]]  # a call that works, to spoil one argument at a time


def quiet_method(method: Callable[..., Any]) -> Callable[..., Any]:
    """A method without its warnings: of a load that is none."""

    def call_quietly(*given: Any, **keywords: Any) -> Any:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", jounce.JounceWarning)
            return method(*given, **keywords)

    return call_quietly


def case_along(method: Callable[..., Any], /, **keywords: Any) -> Case:
    """A method along a motion, with a rate beyond those that have names where it takes any."""
    parameters = inspect.signature(method).parameters
    rates = [name for name in parameters if (name[0] in "qQt" and name != "threads") or name == "higher"]
    options = {name: value for name, value in OPTIONS.items() if name in parameters}
    return method, dict.fromkeys(rates, (0.1, 0.2)) | options | keywords


def keyed(key: Any, value: Any) -> dict[Any, Any]:
    """A dict of one entry; of none where the key cannot be one."""
    try:
        return {key: value}
    except Exception:
        return {}


def screws(**data: Any) -> Any:
    return jounce.Robot.from_screws(B, X, M, **data)


def of_library(name: str, robot: jounce.Robot, model: Any) -> dict[str, Case]:
    """States and forces from and to another library."""
    motion = dict(zip(("q", "qd", "q2d"), np.zeros((3, robot.n)), strict=True))
    of, base, forces = {"library": name, "model": model}, (np.eye(4), *np.zeros((2, 6))), np.zeros(robot.nv)
    vectors = robot.state_to(name, *motion.values(), base=base, model=model)
    return {
        f"state_from {name}": (
            robot.state_from, of | dict(zip(("q", "v", "a"), vectors, strict=True)) | {"forces": forces}
        ),
        f"state_to {name}": (robot.state_to, of | motion | {"Q": forces, "base": base}),
    }  # fmt: skip


HUMANOID = pinocchio.buildSampleModelHumanoid()
FLYING = mujoco.MjModel.from_xml_string(
    "<mujoco><worldbody><body name='a'><freejoint/><geom size='1'/><body name='b'><joint name='j'/><geom size='1'/>"
    "</body></body></worldbody></mujoco>"
)

CASES: dict[str, Case] = {
    "Robot": (jounce.Robot, {"mechanism": ROBOT.mechanism}),
    "load": (jounce.load, {"source": "r.urdf", **READ, **PART, **XML, "loops": None}),
    "load xacro": (jounce.load, {"source": "r.xacro", **READ, **PART, **XML, "xacro_args": {}}),
    "load MJCF": (jounce.load, {"source": "r.xml", **READ, **PART, **XML}),
    "load bundled": (jounce.load, {"source": "iiwa14", **READ, "gravity": [0, 0, -9.81]}),
    "load planar2r": (jounce.load, {"source": "planar2r", "L1": 1, "L2": 1, "m1": 1, "m2": 1, "g": 9.81}),
    "save": (jounce.save, {"robot": ROBOT, "path": "r.yaml"}),
    "symbolic": (ROBOT.symbolic, {"moving_base": False}),
    "Symbolic.dot": (SYMBOLIC.dot, {"x": SYMBOLIC.q[0]}),
    "codegen": (
        ROBOT.codegen,
        {
            "lang": "python", "order": 0, "directory": "code", "outputs": ["gravity_forces"],
            "wrench": False, "parameters": (), "float32": False, "prefix": "r", "overwrite": True,
            "moving_base": True, "live": None,
        },
    ),
    "casadi_function": (
        ROBOT.casadi_function,
        {"quantity": "jacobian", "order": 0, "wrench": False, "body": "body1", "frame": "world"}
        | {"parameters": (), "moving_base": False, "native": False, "points": 2},
    ),
    "inertia_matrix": (
        jounce.inertia_matrix,
        {"mass": 1, "com": [0, 0, 1], "inertia_com": np.eye(3), "rotation": np.eye(3)},
    ),
    "load_motion": (
        jounce.load_motion,
        {"source": {"t": SAMPLES, "joint1": SAMPLES**2, "joint2": SAMPLES**3}, "robot": ROBOT}
        | {"order": 1, "degree": 7, "intervals": None, "time": "t", "columns": "{joint}", "angles": "rad"}
        | {"bandwidth": None, "allow_noise": False}
        | {"time_unit": "s", "topic": None, "torques": None, "measured": None}
        | {"torque_constants": None, "gear_ratios": None, "episode": None}
        | {"rename": None, "unwrap": False, "on_error": "stop", "as_": None}
        | {"duration": None, "tolerance": None},
    ),
    "points of load_motion": (
        jounce.load_motion,
        {"source": {"joint1": [0, 1, 1], "joint2": [0, 0, 1]}, "robot": ROBOT, "duration": 1.0, "tolerance": 0.1},
    ),
    "load_poses": (
        jounce.load_poses,
        {"source": AT_REST, "robot": ROBOT, "holds": False, "columns": "{joint}", "angles": "rad", "torques": None}
        | {"rename": None, "time": None, "time_unit": "s", "unwrap": False, "on_error": "stop"}
        | {"torque_constants": None, "gear_ratios": None},
    ),
    "Poses": (
        jounce.Poses,
        {"q": TWO, "torques": TWO, "joint_names": ["joint1", "joint2"], "approach": np.sign(TWO), "angles": "rad"}
        | {"places": ["pose"] * 20, "notes": ["one"]},
    ),
    "load_motion of currents": (
        lambda constants, ratios, current: jounce.load_motion(
            {"t": SAMPLES, "joint1": SAMPLES**2, "joint2": SAMPLES**3, "current_joint1": current},
            ROBOT, degree=7, torque_constants=constants, gear_ratios=ratios,
        ),
        {"constants": [0.1, 0.2], "ratios": {"joint1": 100.0}, "current": SAMPLES},
    ),
    "Motion": (MOTION, {"t": [0.1, 0.2], "order": 2, "side": "left"}),
    "Motion.wrench": (MOTION.wrench, {"t": [0.1, 0.2], "order": 2, "side": "left"}),
    "Motion.checked": (MOTION.checked, {"t": [0.1, 0.2]}),
    "Motion.wrench_deviations": (MOTION.wrench_deviations, {"t": [0.1, 0.2], "order": 2}),
    "Motion.deviations": (MOTION.deviations, {"t": [0.1, 0.2], "order": 2}),
    "Motion.sampled": (MOTION.sampled, {"rate": 100.0, "differences": 3}),
    "Motion.scaled": (MOTION.scaled, {"factor": 2.0}),
    "Motion.shifted": (MOTION.shifted, {"seconds": 2.0}),
    "Motion.with_step": (MOTION.with_step, {"step": 0.1}),
    "Motion.blended": (BROKEN.blended, {"time": 0.1, "continuity": 4}),
    "Motion.breaks_to": (MOTION.breaks_to, {"order": 4}),
    "Motion.through": (jounce.Motion.through, {"t": SAMPLES, "q": TWO, "degree": 7, **NAMED}),
    "Motion.fit": (
        jounce.Motion.fit,
        {"t": SAMPLES, "q": TWO, "degree": 7, "intervals": 1, "bandwidth": None, "allow_noise": False, **NAMED}
        | {"angles": "rad", "unwrap": False},
    ),
    "Motion.polynomial": (
        jounce.Motion.polynomial, {"coefficients": np.ones((2, 3)), "duration": 1.0, "start": 0.0, **NAMED}
    ),
    "Motion.fourier": (
        jounce.Motion.fourier,
        {"offset": [0.1, 0.2], "cosines": np.ones((1, 2)), "sines": np.ones((1, 2)), "frequency": 1.0}
        | {"duration": 1.0, "start": 0.0, **NAMED},
    ),
    "Motion.piecewise": (
        jounce.Motion.piecewise, {"breaks": [0.0, 1.0, 2.0], "coefficients": np.ones((3, 2, 2)), **NAMED}
    ),
    "Motion.trapezoidal": (
        jounce.Motion.trapezoidal, {"positions": TWO, "velocity": 1.0, "acceleration": [1.0, 2.0], **NAMED}
    ),
    "Motion.waypoints": (
        jounce.Motion.waypoints, {"points": [[0, 0], [1, 0], [1, 1]], "duration": 1.0, "tolerance": 0.1, **NAMED}
    ),
    "point of Motion.waypoints": (lambda point: jounce.Motion.waypoints([point, [1, 0]], 1.0), {"point": [0, 0]}),
    "Motion.from_joint_trajectory": (jounce.Motion.from_joint_trajectory, {"message": POINTS}),
    "points of Motion.from_joint_trajectory": (
        lambda **given: jounce.Motion.from_joint_trajectory({**POINTS, **given}),
        {"joint_names": ["a"], "points": POINTS["points"]},
    ),
    "point of Motion.from_joint_trajectory": (
        lambda **given: jounce.Motion.from_joint_trajectory({**POINTS, "points": [POINTS["points"][0], given]}),
        {"positions": [1.0], "velocities": [0.0], "time_from_start": {"sec": 1}},
    ),
    "columns of load_motion": (
        lambda **columns: jounce.load_motion(columns, ROBOT, order=1, degree=7),
        {"t": SAMPLES, "joint1": SAMPLES**2, "joint2": SAMPLES**3},
    ),
    "from_screws": (jounce.Robot.from_screws, {"B": B, "X": X, "M": M, "owners": [0, 1], **TREE}),
    "limits": (lambda **limits: screws(limits=limits), dict.fromkeys(LIMIT_KINDS.bound_names, (1, 1))),
    "drives": (
        lambda **drives: screws(drives=drives),
        dict.fromkeys(UNDRIVEN, (1, 1)) | {"load_friction": (0.5, 0.5)},
    ),
    "parents": (lambda a, b: screws(parent=[a, b]), {"a": -1, "b": 0}),
    "names": (lambda a, b: screws(names=[a, b]), {"a": "a", "b": "b"}),
    "from_spatial_screws": (jounce.Robot.from_spatial_screws, {"A": B, "Y": X, "M": M, **TREE}),
    "from_dh": (
        jounce.Robot.from_dh,
        {"table": np.zeros((2, 4)), "M": M, "convention": "standard", "types": ["revolute"] * 2}
        | {"degrees": False, "base": np.eye(4), "tool": np.eye(4), **CHAIN},
    ),
    "rows of from_dh": (
        lambda **row: jounce.Robot.from_dh([row], M[:1], "modified"),
        dict.fromkeys(("a", "alpha", "d", "theta"), 0.0) | {"type": "prismatic"},
    ),
    "key of from_dh": (
        lambda key: jounce.Robot.from_dh([{"alpha": 0, "d": 0, "theta": 0, **keyed(key, 0)}], M[:1], "modified"),
        {"key": "a"},
    ),
    "types of from_dh": (
        lambda kind: jounce.Robot.from_dh([[0] * 4], M[:1], "modified", types=[kind]),
        {"kind": "revolute"},
    ),
    "from_pinocchio": (
        jounce.Robot.from_pinocchio,
        {"model": pinocchio.buildSampleModelManipulator(), "gravity": None, **PART},
    ),
    "from_mujoco": (
        jounce.Robot.from_mujoco,
        {"model": mujoco.MjModel.from_xml_string(MJCF), "gravity": None, **PART},
    ),
    **of_library("pinocchio", jounce.Robot.from_pinocchio(HUMANOID, base="floating"), HUMANOID),
    **of_library("mujoco", jounce.Robot.from_mujoco(FLYING, base="floating"), FLYING),
    "with_drives": (ROBOT.with_drives, {"terms": True, "eps": None}),
    "term of with_drives": (lambda term: ROBOT.with_drives([term]), {"term": "spring"}),
    "with_limits": (
        ROBOT.with_limits,
        {
            "source": None, **dict.fromkeys([*LIMIT_KINDS.bound_names, *LIMIT_KINDS.totals], 1),
            "effort": [[-1, 1], [-2, 3]], "of": "Q",
        },
    ),
    "joint of with_limits": (lambda joint1: ROBOT.with_limits(jerk={"joint1": joint1}), {"joint1": (-1, 1)}),
    "kind of with_limits": (lambda effort: ROBOT.with_limits(of={"effort": effort}), {"effort": "Q"}),
    "elastic": (
        ROBOT.elastic,
        {"stiffness": [800, np.inf], "rotor": 0.1, **dict.fromkeys(("damping", "spring", "motors"))}
        | {"coupling": "spong", "damping_terms": 4},
    ),
    "springs of elastic": (
        lambda spring, D: ROBOT.elastic({"joint2": 80}, 0.1, {"joint1": D}, spring={"joint1": spring}),
        {"spring": jounce.CubicSpring(800.0), "D": 1.0},
    ),
    "coupling of elastic": (
        lambda motor, coupling: ROBOT.elastic(80, motors={"joint1": MOTOR, "joint2": motor}, coupling=coupling),
        {"motor": MOTOR, "coupling": 1},
    ),
    "CubicSpring": (jounce.CubicSpring, {"k": 800.0, "k3": 2e4}),
    "SpringTable": (jounce.SpringTable, {"deflections": SAMPLES, "forces": 9 * SAMPLES}),
    "SpringFunction": (
        lambda function, program: jounce.SpringFunction.of(function), {"function": lambda d: 9 * d, "program": None}
    ),
    "AntagonisticSprings": (
        jounce.AntagonisticSprings, dict.fromkeys(("first", "second"), jounce.CubicSpring(9.0, 9.0))
    ),
    "Motor": (jounce.Motor, dict(vars(MOTOR))),
    "joint of elastic": (
        lambda K, B: ROBOT.elastic({"joint1": K}, rotor={"joint1": B, "joint2": 0.1}), {"K": 800, "B": 0.1},
    ),
    "elastic_energy": case_along(ARM.elastic_energy),
    "motors_along": (
        ARM.motors_along, {"motion": SAMPLED, "t": None, "order": 0, "method": "recursion", "stiffness": None}
        | {"duration": None, "tolerance": None},
    ),
    "points of motors_along": (
        ARM.motors_along, {"motion": [[0, 0], [1, 0], [1, 1]], "duration": 1.0, "tolerance": 0.1}
    ),
    "damping_error": (
        lambda rates, wrench: DAMPED.damping_error(rates, *np.ones((3, 2)), wrench=wrench),
        {"rates": (0.1, 0.2), "wrench": None},
    ),
    "check": (
        ROBOT.with_limits(effort=99).check,
        {"motion": SAMPLED, "rate": None, "differences": 3, "duration": None, "tolerance": None},
    ),
    "points of check": (
        ROBOT.with_limits(effort=99).check, {"motion": [[0, 0], [1, 0], [1, 1]], "duration": 1.0, "tolerance": 0.1}
    ),
    "rate of check": (lambda rate: ROBOT.with_limits(velocity=99).check(SAMPLED, rate), {"rate": 100.0}),
    "explain": (
        ROBOT.with_limits(velocity=99).explain,
        {"motion": SAMPLED, "controller": None, "rate": 100.0, "differences": 3, "start": None},
    ),
    "slowdown": (
        ROBOT.with_limits(effort=99).slowdown,
        {"motion": SAMPLED, "rate": 500.0, "differences": 3, "up_to_limits": False},
    ),
    "retime": (
        ROBOT.with_limits(velocity=99, acceleration=99).retime,
        {"motion": SAMPLED, "margin": 0.01, "smooth": True, "rate": 500.0, "differences": 3, "tolerance": None},
    ),
    "points of retime": (
        ROBOT.with_limits(velocity=99, acceleration=99).retime, {"motion": [[0, 0], [1, 0], [1, 1]], "tolerance": 0.1}
    ),
    "motors of check": (ARM.with_limits(motor_velocity=99).check, {"motion": SAMPLED}),
    "motors of slowdown": (ARM.with_limits(motor_velocity=99).slowdown, {"motion": SAMPLED}),
    "report": (ROBOT.report, {"motion": SAMPLED, "order": 0, "visuals": None, "mesh_folders": []}),
    "locked": (ROBOT.locked, {"values": {"joint1": 0.0}}),
    "joint of locked": (lambda joint1: ROBOT.locked({"joint1": joint1}), {"joint1": 0.0}),
    "audit": (ROBOT.audit, {}),
    "with_inertial_parameters": (ROBOT.with_inertial_parameters, {"p": np.ones(20)}),
    "regressor with drives": (
        lambda drives: ROBOT.regressor(*np.ones((3, 2)), drives=drives), {"drives": ("damping", "offset")}
    ),
    **{
        f"{name} with drives": (
            lambda drives, name=name: getattr(ROBOT, name)(*np.ones((2, 2)), drives=drives), {"drives": "armature"}
        )
        for name in ("momentum_regressor", "energy_regressor")
    },
    "base_parameters": (ROBOT.base_parameters, {}),
    "compile": (
        ROBOT.compile,
        {"quantity": "jacobian", "order": 0, "wrench": False, "body": "body1", "frame": "world", "product": None}
        | {"moving_base": False},
    ),
    "kernel": (KERNEL, {"arrays": [0.1, 0.2], "out": None, "threads": 1}),
    "kernel in threads": (KERNEL, {"arrays": np.ones((4, 2)), "out": np.ones((4, 2)), "threads": 2}),
    "kernel.bind": (KERNEL.bind, {"arrays": np.ones(2), "out": np.ones(2)}),
    **{
        name: case_along(getattr(WINDING if ELASTIC in row.needs else ROBOT, name))
        for name, row in QUANTITIES.items()
        if not (CLOSED in row.needs or ON_CONTACTS in row.needs)
    },
    "contacts": (WALKER.contacts, {"contacts": [FOOT]}),
    "zmp": case_along(WALKER.zmp, base=(np.eye(4), *np.zeros((5, 6))), height=0.1),
    "dcm": case_along(WALKER.dcm, base=(np.eye(4), *np.zeros((4, 6))), height=0.1),
    "project": (WALKER.contacts([FOOT]).project, {"motion": SAMPLED, "base": np.eye(4)}),
    "next_switch": (
        lambda rates, base, wrench: GRIPPING.next_switch(rates, *np.zeros((3, 2)), base=base, wrench=wrench),
        {"rates": (0.1, 0.2), "base": (np.eye(4), *np.zeros((3, 6))), "wrench": None},
    ),
    "Motion.with_stances": (SAMPLED.with_stances, {"stances": [(0, ["foot"]), (0.5, [])], "blend": 0.1}),
    "center_of_pressure": case_along(WALKER.contacts([FOOT]).center_of_pressure, base=(np.eye(4), *np.zeros((5, 6)))),
    "contact_wrenches": case_along(WALKER.contacts([FOOT]).contact_wrenches, base=(np.eye(4), *np.zeros((5, 6)))),
    "Contact": (
        jounce.Contact,
        {"frame": "body2", "kind": "plane", "place": (0.5, 0, 0), "normal": None, "friction": 0.5}
        | {"sole": (0.1, 0.05), "weights": None},
    ),
    "Contact of a point": (jounce.Contact, {"frame": "body2", "kind": "point", "normal": (0, 0, 1)}),
    **{
        name: case_along(getattr(HALF if name == "passive_accelerations" else FIVEBAR, name), method=None)
        for name, row in QUANTITIES.items()
        if CLOSED in row.needs
    },
    "closed": (
        FIVEBAR.closed,
        {key: ["left_shoulder", "right_shoulder"] for key in ("actuated", "coordinates")}
        | {"loops": [("left_tip", "right_tip", "revolute", (0, 1, 0))], "start": None, "weights": (1, 1)},
    ),
    "with_transmission": (
        ROBOT.with_transmission,
        {"matrix": [[1, 0], [0.5, 1]], "motors": ["a", "b"], "joints": list(ROBOT.joint_names[:2]), "offset": 0.0},
    ),
    "closed with passive coordinates": (
        HALF.closed, {"loops": None, "actuated": ["left_shoulder"], "passive": ["right_shoulder"]},
    ),
    "inverse_dynamics natively": case_along(ROBOT.inverse_dynamics, wrench=(np.zeros((2, 6)),) * 4, method=None),
    "inverse_dynamics in closed form": case_along(ROBOT.inverse_dynamics, method="closed_form"),
    "live": (
        ROBOT.live, {"dt": 1e-3, "bandwidth": 10.0, "lag": 0.02, "states": 6, "noise": 1e-5},
    ),
    "LiveRates.update": (
        lambda q, t: ROBOT.live(1e-3).update(q, t), {"q": (0.1, 0.2), "t": 0.0},
    ),
    "LiveRates.forces": (ROBOT.live(1e-3).forces, {"keep_uncertain": False}),
    "guard": (ROBOT.with_limits(velocity=99).guard, {"motion": SAMPLED, "limits": None, "dt": 1e-3}),
    "Guard.step": (lambda setpoint: GUARD.step(setpoint), {"setpoint": 0.5}),
    "Guard.c_source": (GUARD.c_source, {"prefix": "arm"}),
    "forces_along": (
        ROBOT.forces_along,
        {
            "motion": SAMPLED,
            "t": None, "order": 0, "method": "recursion",
        },
    ),
    "Motion.base": (SAMPLED.with_base(None, np.eye(4)).base, {"t": 0.5, "order": 1, "side": "left"}),
    "Motion.with_base": (
        SAMPLED.with_base,
        {
            "t": SAMPLES, "C": np.tile(np.eye(4), (20, 1, 1)),
            "degree": 7, "intervals": None, "bandwidth": None, "allow_noise": False,
        },
    ),
    "excite": (
        ROBOT.with_limits(velocity=2.0).excite,
        {
            "period": 2.0, "periods": 1, "harmonics": 3, "drives": False,
            "weights": None, "reach": 1.0, "margin": 0.01, "starts": 1, "seed": 0, "payload": False,
        },
    ),
    "payload": (
        quiet_method(ROBOT.payload),
        {"with_load": LOGGED, "without_load": LOGGED, "body": "body2", "drives": False, "mass": None}
        | {"torques_as_given": False},
    ),
    "identify_stiffness": (
        quiet_method(ARM.identify_stiffness),
        {"links": LOGGED, "motors": TURNED, "gear": 1.0, "rotor": 0.1, "delay": None}
        | {"torques_as_given": False, "deflections": None},
    ),
    "identify_stiffness by deflections": (
        quiet_method(lambda links, deflections: ARM.identify_stiffness(links, deflections=deflections, rotor=0.1)),
        {"links": LOGGED, "deflections": BENT},
    ),
    "identify": (
        ROBOT.identify,
        {
            "motion": SAMPLED, "forces": ROBOT.forces_along(SAMPLED, order=0).forces[0], "t": SAMPLES,
            "drives": False, "eps": None, "span": None, "band": 9.0, "weights": None, "deviations": 1e-4, "prior": 0.3,
            "test": (), "delay": None, "torques_as_given": False,
        },
    ),
    "identify several": (
        lambda first, second, forces, test: ROBOT.identify([first, second], forces, drives=False, test=test),
        {"first": LOGGED, "second": OTHER, "forces": [None, None], "test": [1]},
    ),
    "drive_forces": case_along(ROBOT.drive_forces, terms=True),
    "wrench": case_along(ROBOT.wrench, force=(0, 0, 1), torque=None, frame="body", point=None),
    "joint of a state": (lambda joint1: ROBOT.mass_matrix({"joint1": joint1, "joint2": 0}), {"joint1": 0}),
    "body of a wrench": (
        lambda name, W: ROBOT.base_wrench([0, 0], [0, 0], [0, 0], wrench=keyed(name, W)),
        {"name": "body1", "W": np.zeros(6)},
    ),
    "rates of a wrench": (
        lambda W, Wd: ROBOT.inverse_dynamics(*np.ones((4, 2)), wrench=(W, Wd)),
        {"W": np.zeros((2, 6)), "Wd": np.zeros((2, 6))},
    ),
    "rates of a force": (
        lambda f, fd: ROBOT.wrench([0, 0], [1, 1], body="body1", force=(f, fd)),
        {"f": np.zeros(3), "fd": np.zeros(3)},
    ),
}  # fmt: skip


@pytest.fixture(autouse=True)
def _files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for suffix, text in (("urdf", URDF), ("xacro", URDF), ("xml", MJCF)):
        Path(f"r.{suffix}").write_text(text)


@cache
def positional(function: Callable[..., Any]) -> list[str]:
    """The names of what may be given in its place."""
    return [name for name, x in inspect.signature(function).parameters.items() if x.kind != x.KEYWORD_ONLY]


def call_with(function: Callable[..., Any], given: Mapping[str, Any]) -> Any:
    keywords = dict(given)
    arguments = [keywords.pop(name) for name in positional(function) if name in keywords]
    return function(*arguments, **keywords)


def failure(
    function: Callable[..., Any], given: Mapping[str, Any], argument: str, value: Callable[[], Any]
) -> str | None:
    """What a call with one argument spoilt did that no call may."""
    try:
        call_with(function, {**given, argument: value()})
    except JounceError as error:
        return None if str(error).isprintable() else f"JounceError: {error}"
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    return None


@pytest.mark.sweep(12)
@pytest.mark.filterwarnings("ignore:.* has no effect:jounce.JounceWarning")
@pytest.mark.parametrize("name", CASES)
def test_hostile_values_work_or_are_refused_in_one_line(name):
    function, given = CASES[name]
    call_with(function, given)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        failures = {
            (argument, kind): said
            for argument in given
            for kind, value in HOSTILE.items()
            if (said := failure(function, given, argument, value))
        }
    assert not failures


OBJECTS = ("Motion.from_ruckig", "Motion.from_toppra")  # take what a planner computes, and refuse all else


def test_every_argument_of_every_public_function_is_attacked():
    methods = {name: getattr(jounce.Robot, name) for name in dir(jounce.Robot) if name[0] != "_"}
    made = {  # what calls return, exported for its name
        "Along", "BaseParameters", "Channel", "Check", "CheckedLimit", "Closure", "Drives", "ElasticAlong",
        "Elasticity", "Excitation", "Explanation", "ForceResidual", "Identification", "IdentifiedLog",
        "IdentifiedParameter", "Kernel", "Limits", "LiveForces", "LiveLinks", "LiveRates", "Loop", "Mechanism",
        "Motion", "Payload", "PayloadParameter", "Report", "RobotState", "Retiming", "Slowdown", "UncertainError",
        "Guard", "GuardState", "Trust",
    }  # fmt: skip
    named = {name for name in jounce.__all__ if not name.startswith("Jounce")} - made
    public = {name: getattr(jounce, name) for name in named} | methods
    public |= {f"Motion.{name}": getattr(jounce.Motion, name) for name in dir(jounce.Motion) if name[0] != "_"}
    for name, function in public.items():
        if callable(function) and name not in OBJECTS:
            expected = [
                p.name
                for p in inspect.signature(function).parameters.values()
                if p.kind != p.VAR_KEYWORD and p.name != "self"
            ]
            attacked = {argument for case, (_, given) in CASES.items() if case.split()[0] == name for argument in given}
            assert set(expected) - {"progress"} <= attacked, name  # what a callback raises is its own
