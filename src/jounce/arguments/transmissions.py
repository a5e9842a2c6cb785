"""Motors that move several joints together, as a caller states them, checked."""

from collections.abc import Mapping

import numpy as np

from jounce.arguments.contacts import refuse_contacts
from jounce.arguments.loops import coordinate_places, values_per_joint, with_loops
from jounce.core.errors import JounceError, as_list, join_names, quote_value
from jounce.core.scalars import asarray, is_numeric
from jounce.model.mechanism import Mechanism
from jounce.model.motors import Motor
from jounce.model.transmissions import with_named_leaders, with_rotors

ELECTRIC = ("body", "resistance", "inductance", "constant")  # what a motor states that no drive term is


def with_transmission(m: Mechanism, matrix: object, motors: object, joints: object, offset: object) -> Mechanism:
    """The robot with motors that move some of its joints together, in its own coordinates."""
    if m.elasticity or m.closure or m.loops:
        came = f"{m.name!r} has loops, a transmission or elastic joints"
        raise JounceError(f"{came}; expected a tree of rigid joints, and one matrix for all motors")
    refuse_contacts(m, "drives are coupled without")
    m = with_named_leaders(m)
    stated = _read_motors(m, motors)
    places = range(m.n) if joints is None else coordinate_places(m, "joints", joints)
    moved = [m.coordinates[j] for j in places]
    A, phi0 = asarray(matrix, "matrix"), values_per_joint(offset, [*stated], 0.0, "motor", "offset")
    for label, x, shape in (("matrix", A, (len(stated), len(moved))), ("offset", phi0, (len(stated),))):
        if x.shape not in (shape, () if label == "offset" else shape) or not is_numeric(x) or not np.isfinite(x).all():
            of = f"a row for each of {join_names(stated)}, a column for each of {join_names(moved)}"
            raise JounceError(f"{label} is {quote_value(x.tolist())}; expected finite numbers {shape}: {of}")
    G = np.zeros((len(stated), m.n))
    G[:, list(places)] = A
    # motors take the places of joints; those beyond their number come last
    instead = dict(zip(moved, stated, strict=False))
    actuated = [instead.get(name, name) for name in m.coordinates if name in instead or name not in moved]
    whole = with_rotors(m, stated, G, np.zeros(len(stated)) + phi0)
    return with_loops(whole, actuated=[*actuated, *[*stated][len(moved) :]], coordinates=m.coordinates)


def _read_motors(m: Mechanism, given: object) -> dict[str, Motor | None]:
    """The motors by name, which are not those of joints, and their data."""
    names = as_list(given)
    if not names or not all(isinstance(x, str) for x in names) or len({*names}) < len(names):
        raise JounceError(f"motors is {quote_value(given)}; expected different names, or {{name: jounce.Motor}}")
    found: dict[str, Motor | None] = dict(given) if isinstance(given, Mapping) else dict.fromkeys(names)
    for name, motor in found.items():
        if name in (*m.joints, *m.coordinates) or f"{name}_rotor" in m.frame_names:
            raise JounceError(f"motor {quote_value(name)} or its rotor has the name of a joint or body; rename it")
        if not isinstance(motor, Motor | None):
            raise JounceError(f"motor {quote_value(name)} is {quote_value(motor)}; expected a jounce.Motor, or None")
        if motor and (stated := [x for x in ELECTRIC if getattr(motor, x)]):
            came = f"motor {quote_value(name)} states {join_names(stated)}, of motors on elastic joints"
            raise JounceError(
                f"{came}; expected gear, inertia, damping, friction: robot.closed().elastic() takes the others"
            )
    return found
