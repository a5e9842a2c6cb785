"""Check motors that move several joints together, and drive the joints.

`with_transmission` is the door of `Robot.with_transmission`: motors by a matrix. `drive_by_rotors` is the step that it
shares with readers of files.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from jounce.arguments.contacts import refuse_contacts
from jounce.arguments.loops import ClosureParameters, coordinate_places, values_per_joint, with_loops
from jounce.core.errors import JounceError, as_list, join_names, quote_value
from jounce.core.scalars import asarray, is_numeric
from jounce.model.elasticity import Motor
from jounce.model.mechanism import Mechanism
from jounce.model.transmissions import CoupledRotor, with_named_leaders, with_rotors

ELECTRIC = ("body", "resistance", "inductance", "constant")  # what a motor states that no drive term is


def with_transmission(m: Mechanism, matrix: object, motors: object, joints: object, offset: object) -> Mechanism:
    """Return the robot with motors that move some joints together.

    Its coordinates stay its own: motor angles follow them, ``phi = matrix q + offset``.
    """
    if m.elasticity is not None or m.closure is not None or len(m.loops) > 0:
        came = f"{m.name!r} has loops, a transmission or elastic joints"
        raise JounceError(f"{came}; expected a tree of rigid joints, and one matrix for all motors")
    refuse_contacts(m, "drives are coupled without")
    m = with_named_leaders(m)
    stated_motors = _read_motors(m, motors)
    places = range(m.n) if joints is None else coordinate_places(m, "joints", joints)
    moved_joints = [m.coordinates[j] for j in places]
    # phi = A q + phi0 of the motors, A (motors, moved joints); one offset may serve all motors.
    A, phi0 = asarray(matrix, "matrix"), values_per_joint(offset, [*stated_motors], 0.0, "motor", "offset")
    count = len(stated_motors)
    matrix_shape, offset_shape = (count, len(moved_joints)), (count,)
    for label, x, shapes in (("matrix", A, [matrix_shape]), ("offset", phi0, [offset_shape, ()])):
        if x.shape not in shapes or not is_numeric(x) or not np.isfinite(x).all():
            layout = f"a row for each of {join_names(stated_motors)}, a column for each of {join_names(moved_joints)}"
            raise JounceError(f"{label} is {quote_value(x.tolist())}; expected finite numbers {shapes[0]}: {layout}")
    ratios = np.zeros((count, m.n))
    ratios[:, list(places)] = A
    offsets = np.zeros(count) + phi0
    rotors = [
        CoupledRotor(name, row, float(offset), _reflect_drive(motor))
        for (name, motor), row, offset in zip(stated_motors.items(), ratios, offsets, strict=True)
    ]
    return drive_by_rotors(m, rotors, moved_joints)


def drive_by_rotors(m: Mechanism, rotors: Sequence[CoupledRotor], moved_joints: Sequence[str]) -> Mechanism:
    """Return the robot with rotors as motors of some coordinates.

    Its coordinates stay its own; those that no rotor moves keep their motors.
    """
    # Rotors take the places of the joints that they move, in their order; those beyond the number of joints come last.
    rotor_of_joint = {name: rotor.name for name, rotor in zip(moved_joints, rotors, strict=False)}
    actuated = [
        rotor_of_joint.get(name, name) for name in m.coordinates if name in rotor_of_joint or name not in moved_joints
    ]
    actuated += [rotor.name for rotor in rotors[len(moved_joints) :]]
    return with_loops(with_rotors(m, rotors), ClosureParameters(actuated=actuated, coordinates=m.coordinates))


def _reflect_drive(motor: Motor | None) -> dict[str, float]:
    """Return the drive train of a motor as seen through its gear: r^2 J, r^2 d and |r| f."""
    if motor is None:
        return {}
    return {
        "armature": motor.reflected_inertia or 0.0,
        "damping": motor.gear**2 * motor.damping,
        "friction": abs(motor.gear) * motor.friction,
    }


def _read_motors(m: Mechanism, stated_motors: object) -> dict[str, Motor | None]:
    """Return the motors by name, with data or None.

    Their names may not be those of joints or bodies.
    """
    motor_names = as_list(stated_motors)
    are_strings = all(isinstance(x, str) for x in motor_names)
    if len(motor_names) == 0 or not are_strings or len({*motor_names}) < len(motor_names):
        raise JounceError(
            f"motors is {quote_value(stated_motors)}; expected different names, or {{name: jounce.Motor}}"
        )
    motors: dict[str, Motor | None] = (
        dict(stated_motors) if isinstance(stated_motors, Mapping) else dict.fromkeys(motor_names)
    )
    for name, motor in motors.items():
        if name in (*m.joints, *m.coordinates) or f"{name}_rotor" in m.frame_names:
            raise JounceError(f"motor {quote_value(name)} or its rotor has the name of a joint or body; rename it")
        if not isinstance(motor, Motor | None):
            raise JounceError(f"motor {quote_value(name)} is {quote_value(motor)}; expected a jounce.Motor, or None")
        electric_data = [] if motor is None else [x for x in ELECTRIC if getattr(motor, x)]
        if len(electric_data) > 0:
            came = f"motor {quote_value(name)} states {join_names(electric_data)}, of motors on elastic joints"
            raise JounceError(
                f"{came}; expected gear, inertia, damping, friction: robot.closed().elastic() takes the others"
            )
    return motors
