"""Higher-order inverse dynamics: a robot and a motion in, the drive forces Q and their exact time derivatives out.

    >>> import jounce
    >>> robot = jounce.load("planar2r")
    >>> Q, Qd = robot.inverse_dynamics([0, 0], [1, 0], [0, 0], [0, 0])

Each further rate that a call takes returns one more time derivative. Below, names with a capital are types, as
`jounce.Limits`; others without ``jounce.`` are methods of a robot, as ``robot.check``. ``help(jounce.Robot)`` states
what holds for all methods, and ``help(jounce.Robot.check)`` explains one.

Robots
    jounce.load, jounce.save           from a file or by name, "iiwa14", "g1", ...; to a file
    Robot.from_screws, from_dh         of numbers; from_mujoco, from_pinocchio: of models of other libraries
    Robot, Mechanism, RobotState       a robot, its data, its state in another library: state_from, state_to
    with_drives, locked                friction and other terms of Drives that act in Q; joints that are held
    jounce.inertia_matrix, audit       of one body, by Steiner's theorem; whether inertias can exist

Quantities and their rates
    inverse_dynamics, gravity_forces   generalized forces Q of a motion; those of gravity
    forward_dynamics                   accelerations and their rates of given forces
    mass_matrix, coriolis_matrix       M and C; skew_coriolis_matrix is that for passivity
    poses, twists, jacobian            of bodies, in frames "body", "world" or "spatial"
    momentum, kinetic_energy, ...      potential_energy, center_of_mass, base_wrench, joint_wrenches
    inverse_dynamics_partials, ...     derivatives by q, qd, q2d; forward_dynamics_partials; ..._second_partials
    wrench                             of a load on a body, for wrench= of inverse_dynamics

Motions
    jounce.load_motion                 of a log or table: smoothed by its noise, with standard deviations
    jounce.load_poses, Poses           of a table without times, or of the holds of a log: for identification at rest
    Motion                             a function of time; through, fit, polynomial, fourier, trapezoidal, ... make one
    forces_along, Along, Channel       Q, Qd, Q2d along a motion; a quantity of named joints over time

Limits
    with_limits, Limits                of position, velocity, effort, their rates, motors
    check, Check, CheckedLimit         every limit along a motion, between samples too
    slowdown, retime                   how fast a motion may be: Slowdown; the fastest along its path: Retiming
    explain, Explanation               why a controller stops a motion

Elastic joints
    elastic, Elasticity, Motor         a robot with springs and motors at its joints
    CubicSpring, SpringTable, ...      springs that are not linear: SpringFunction, AntagonisticSprings
    motor_torques, motor_positions     motor_currents, motor_voltages; motors_along a motion: ElasticAlong

Contacts and loops
    contacts, Contact                  a robot on its feet: contact_wrenches, zmp, center_of_pressure, dcm
    closed, Loop, Closure              loops that are closed: coordinates, actuator_forces, loop_wrenches

Identification
    identify, Identification           inertias and friction: IdentifiedLog, IdentifiedParameter, ForceResidual
    base_parameters, regressor         what forces depend on, BaseParameters, and how: Q = Y p
    payload, Payload                   what the robot carries, by PayloadParameter; identify_stiffness of joints
    excite, Excitation                 a motion that determines the parameters

While the robot moves
    live, LiveRates                    rates from encoders: LiveForces, LiveLinks, and whether to Trust them
    guard, Guard, GuardState           a motion within limits, tick by tick

Code
    compile, Kernel                    native code, with products of derivatives: vjp, jvp, hvp, hessian
    codegen                            C, C++, Rust, Julia, MATLAB, Python, JavaScript, CUDA, LaTeX
    casadi_function, symbolic          functions of CasADi; expressions of SymPy
    jounce.cuda, jounce.dask           modules for a GPU, and for a cluster

Pictures and reports
    report, Report                     a page about a robot along a motion; notebooks draw what they show
    jounce --help                      in a shell: run, plot, report, view and other commands

Errors
    JounceError                        one line: what came, what was expected, the cure
    UncertainError                     results that are uncertain, with the results
    JounceWarning                      what is taken, but may be meant otherwise

What is given wrongly, by type, shape, name or range, is refused with `JounceError`. Sections `Raises` of docstrings
state what else a call refuses. `jounce.__version__` is the version.
"""

from jounce.core.version import __version__

TYPE_CHECKING = False  # typing is not imported: until the command begins, Ctrl-C has Python's own traceback
if TYPE_CHECKING:
    from typing import Any

    from jounce._report import Report
    from jounce.actuators.motors import ElasticAlong
    from jounce.core.errors import JounceError, JounceWarning, UncertainError
    from jounce.dynamics.base_parameters import BaseParameters
    from jounce.engine.along import Along
    from jounce.identification import (
        Excitation,
        ForceResidual,
        Identification,
        IdentifiedLog,
        IdentifiedParameter,
        Payload,
        PayloadParameter,
    )
    from jounce.io.models.states import RobotState
    from jounce.limits.explanation import Explanation
    from jounce.limits.retime import Retiming
    from jounce.limits.slowdown import Slowdown
    from jounce.limits.verdicts import Check, CheckedLimit
    from jounce.live.estimator import LiveRates
    from jounce.live.forces import LiveForces, LiveLinks
    from jounce.live.guard import Guard, GuardState
    from jounce.live.innovations import Trust
    from jounce.model.contacts import Contact
    from jounce.model.drive_trains import Drives
    from jounce.model.elasticity import Elasticity, Motor
    from jounce.model.limits import Limits
    from jounce.model.loops import Closure, Loop
    from jounce.model.mechanism import Mechanism
    from jounce.model.spring_deflection import AntagonisticSprings
    from jounce.model.springs import CubicSpring, SpringFunction, SpringTable
    from jounce.motion import Motion
    from jounce.motion.channel import Channel
    from jounce.motion.poses import Poses
    from jounce.native.kernel import Kernel
    from jounce.robot import Robot
    from jounce.robot.loading import load
    from jounce.robot.motions import load_motion, load_poses
    from jounce.robot.saving import save
    from jounce.spatial.inertia import inertia_matrix

__all__ = [
    "Along", "AntagonisticSprings", "BaseParameters", "Channel", "Check", "CheckedLimit", "Closure", "Contact",
    "CubicSpring", "Drives", "ElasticAlong", "Elasticity", "Excitation", "Explanation", "ForceResidual", "Guard",
    "GuardState", "Identification", "IdentifiedLog", "IdentifiedParameter", "JounceError", "JounceWarning",
    "Kernel", "Limits", "LiveForces", "LiveLinks", "LiveRates", "Loop", "Mechanism", "Motion", "Motor", "Payload",
    "PayloadParameter", "Poses", "Report", "Retiming", "Robot", "RobotState", "Slowdown", "SpringFunction",
    "SpringTable", "Trust", "UncertainError", "__version__", "inertia_matrix", "load", "load_motion", "load_poses",
    "save",
]  # fmt: skip
_NAMES = {  # of modules, imported when first asked for one of them, so that whatever needs little of it starts at once
    "_report": "Report",
    "actuators.motors": "ElasticAlong",
    "core.errors": "JounceError JounceWarning UncertainError",
    "dynamics.base_parameters": "BaseParameters",
    "engine.along": "Along",
    "identification": (
        "Excitation ForceResidual Identification IdentifiedLog IdentifiedParameter Payload PayloadParameter"
    ),
    "io.models.states": "RobotState",
    "limits.verdicts": "Check CheckedLimit",
    "limits.explanation": "Explanation",
    "limits.retime": "Retiming",
    "limits.slowdown": "Slowdown",
    "live.estimator": "LiveRates",
    "live.forces": "LiveForces LiveLinks",
    "live.guard": "Guard GuardState",
    "live.innovations": "Trust",
    "model.contacts": "Contact",
    "model.drive_trains": "Drives",
    "model.elasticity": "Elasticity Motor",
    "model.limits": "Limits",
    "model.loops": "Closure Loop",
    "model.mechanism": "Mechanism",
    "model.spring_deflection": "AntagonisticSprings",
    "model.springs": "CubicSpring SpringFunction SpringTable",
    "motion": "Motion",
    "motion.channel": "Channel",
    "motion.poses": "Poses",
    "native.kernel": "Kernel",
    "robot": "Robot",
    "robot.loading": "load",
    "robot.motions": "load_motion load_poses",
    "robot.saving": "save",
    "spatial.inertia": "inertia_matrix",
}
_LATER = {name: f"jounce.{module}" for module, names in _NAMES.items() for name in names.split()}


def __getattr__(name: str) -> "Any":
    if name not in _LATER:
        raise AttributeError(f"module 'jounce' has no attribute {name!r}")
    from importlib import import_module

    # Kept in this module, so that the next access does not come here.
    value = getattr(import_module(_LATER[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    # Of a module, pydoc prints all that `dir` lists: below the guide, 9,400 lines on the methods of all classes.
    return [] if _is_asked_by_pydoc() else [*__all__]


def _is_asked_by_pydoc() -> bool:
    """Return whether pydoc asks for the names of this module, through inspect."""
    import sys

    frame = sys._getframe(2)
    while frame.f_back is not None and frame.f_globals.get("__name__") == "inspect":
        frame = frame.f_back
    return frame.f_globals.get("__name__") == "pydoc"
