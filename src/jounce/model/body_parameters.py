"""Parameters of a mechanism: parts of its data that become arguments, and the inertial parameters of all its bodies.

Code that is generated once, or a function that is differentiated, takes gravity, masses, lengths, a payload, and
springs and rotors of elastic joints at run time, as what a caller says: CasADi's symbols or a tape's. Generalized
forces are linear in inertial parameters.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, join_names, quote_value, unknown_name_error
from jounce.core.scalars import Array, asarray, is_numeric, is_zero, restore_integers
from jounce.model.frame import Frame
from jounce.model.mechanism import INERTIAS, Mechanism, with_exact_integers
from jounce.spatial import inertia
from jounce.spatial.lie import pose, rotation

MODEL_PARAMETERS = ("gravity", "masses", "lengths", "payload")
ELASTIC_PARAMETERS = ("stiffness", "rotor")  # of robots with elastic joints, by the names of `Elasticity`
BODY_OPTION = Remedy("body=", "--body")
PAYLOAD_SIZES = {"mass": 1, "com": 3, "inertia": 6}  # what a payload consists of
_UNIT_POINT_MASS = np.diag([0, 0, 0, 1, 1, 1])  # the inertia matrix of 1 kg at the frame's origin


def parametrise(
    mechanism: Mechanism, names: Sequence[str], symbol: Callable[[str, tuple[int, ...]], Array]
) -> tuple[Mechanism, dict[str, Array]]:
    """Return the mechanism with symbols for some data, and the symbols.

    ======================== =====================================================================================
    in `names`               symbols
    ======================== =====================================================================================
    "gravity"                gravity (3,)
    "masses"                 masses (nb,), that of a floating base first: bodies keep their COM, inertia grows in
                             proportion, as with the density; one without mass gets it at its frame's origin
    "lengths"                lengths (nb, 3): the positions of the body frames in their parents', at theta = 0; no base
    "payload", "payload:X"   payload_mass (1,), payload_com (3,), payload_inertia (6,), added to body or link X, the
                             end of the robot if none is named: in the axes of X, the inertia about the COM as xx xy
                             xz yy yz zz; the symbols of a second payload are payload2_mass, ...
    "stiffness", "rotor"     stiffness (n,), rotor (n,): of linear springs and motors behind elastic joints
    ======================== =====================================================================================

    `symbol` makes an object array of new symbols by name and shape. Raises `JounceError` where a name is unknown or
    comes twice, or a payload hangs on the ground.
    """
    symbols = {name: symbol(name, value.shape) for name, value in own_values(mechanism, names).items()}
    B, M = restore_integers(mechanism.B), restore_integers(mechanism.M)
    if "lengths" in symbols:
        first = int(mechanism.floats)  # the base stays
        B = np.concatenate([B[:first], pose(rotation(B[first:]), symbols["lengths"][..., None])])
    if "masses" in symbols:
        M = np.stack([_with_mass(M_i, symbols["masses"][i : i + 1, None]) for i, M_i in enumerate(M)])
    # Inertia of a payload about the COM, in the axes of X, becomes one about the origin of the body that X is fixed to.
    for stem, frame in _payloads(mechanism, names).items():
        mass, com, six = (symbols[f"{stem}_{part}"] for part in PAYLOAD_SIZES)
        load = inertia.inertia_matrix(mass, com, inertia.symmetric_matrix(six))
        added = inertia.shift_inertia(load, restore_integers(frame.T))
        M = M + np.eye(len(M), dtype=int)[frame.body][:, None, None] * added
    gravity = symbols.get("gravity", mechanism.gravity)
    springs = {name: symbols[name] for name in ELASTIC_PARAMETERS if name in symbols}
    e = mechanism.elasticity and replace(mechanism.elasticity, **springs)
    return with_exact_integers(replace(mechanism, B=B, M=M, gravity=np.array(gravity), elasticity=e)), symbols


def own_values(mechanism: Mechanism, names: Sequence[str]) -> dict[str, np.ndarray]:
    """Return the arrays that `parametrise` replaces, with the robot's own values."""
    lengths = mechanism.B[int(mechanism.floats) :, :3, 3]
    values = {"gravity": mechanism.gravity, "masses": mechanism.M[:, 3, 3], "lengths": lengths}
    stems = _payloads(mechanism, names)
    values |= {name: _elastic_values(mechanism, name) for name in names if name in ELASTIC_PARAMETERS}
    # A robot carries no payload of its own.
    no_payloads = {f"{stem}_{part}": np.zeros(size) for stem in stems for part, size in PAYLOAD_SIZES.items()}
    return {name: values[name] for name in names if name in values} | no_payloads


def _payloads(mechanism: Mechanism, names: Sequence[str]) -> dict[str, Frame]:
    """Check `names`, and map stems of payload symbols to frames."""
    are_texts = isinstance(names, Sequence) and not isinstance(names, str) and all(isinstance(x, str) for x in names)
    if not are_texts or len(set(names)) != len(names):
        every = ", ".join(MODEL_PARAMETERS + ELASTIC_PARAMETERS)
        raise JounceError(f"parameters are {quote_value(names)}; expected a list of different names of {every}")
    payloads: dict[str, Frame] = {}
    for name in names:
        kind, colon, body = name.partition(":")
        parameters = [*MODEL_PARAMETERS, *ELASTIC_PARAMETERS, "payload:BODY"]
        if kind not in parameters or (colon and kind != "payload"):
            raise unknown_name_error("parameter", name, parameters)
        if kind == "payload":
            frame = find_load_frame(mechanism, body if colon else None, "payload:BODY")
            number = len(payloads) + 1
            payloads["payload" if number == 1 else f"payload{number}"] = frame
    return payloads


def _elastic_values(mechanism: Mechanism, name: str) -> np.ndarray:
    """Return the stiffnesses of linear springs, or the rotors."""
    e = mechanism.elasticity
    if e is None:
        raise JounceError(
            f"parameter {name!r}: the joints of {mechanism.name!r} are rigid{Remedy('; robot.elastic(stiffness)')}"
        )
    rigid = e.is_rigid | np.array([*map(bool, e.springs or [False] * mechanism.n)])
    if name == "stiffness" and rigid.any():
        joint = quote_value(mechanism.coordinates[int(rigid.argmax())])
        raise JounceError(f"parameter 'stiffness': joint {joint} has no linear spring; expected one at each joint")
    return np.asarray(e.arrays[name])


def find_load_frame(mechanism: Mechanism, body: str | None, option: str | Remedy = BODY_OPTION) -> Frame:
    """Return the frame that carries a payload.

    By default it is the body at the end of the robot, if there is one end.
    """
    frame = mechanism.frame(_tip(mechanism, option) if body is None else body)
    if frame.body < 0:
        raise JounceError(f"a payload on {frame.name!r} has no effect: it is fixed to the ground")
    return frame


def _tip(mechanism: Mechanism, option: str | Remedy) -> str:
    """Return the body that carries no other.

    Raises `JounceError` if there are several.
    """
    tips = [name for i, name in enumerate(mechanism.bodies) if i not in mechanism.parent]
    if len(tips) > 1:
        ends = f"{mechanism.name} ends in {join_names(tips)}"
        raise JounceError(f"payload: {ends}; expected {option}, on one of them or any other body or link")
    return tips[0]


def _with_mass(M: Array, mass: Array) -> Array:
    """Scale the inertia matrix of a body to another mass, (1, 1)."""
    return M + mass * _UNIT_POINT_MASS if is_zero(M[3, 3]) else mass * restore_integers(M / M[3, 3])


def inertial_parameters(mechanism: Mechanism) -> Array:
    """Return the ten parameters of each body, in the order of `bodies`: (10 nb,)."""
    return inertia.parameters(mechanism.M).reshape(-1)


def with_inertial_parameters(mechanism: Mechanism, parameters: object) -> Mechanism:
    """Return the mechanism with other inertial parameters, (10 nb,)."""
    p, names = asarray(parameters, "p"), mechanism.bodies
    if p.shape != (len(inertia.INERTIAL_PARAMETERS) * len(names),):
        expected = f"({len(inertia.INERTIAL_PARAMETERS) * len(names)},): {', '.join(inertia.INERTIAL_PARAMETERS)}"
        raise JounceError(f"p has shape {p.shape}; expected {expected} of each of {len(names)} bodies")
    if is_numeric(p) and not np.isfinite(p).all():
        place = int(np.flatnonzero(~np.isfinite(p))[0])
        body, k = divmod(place, len(inertia.INERTIAL_PARAMETERS))
        raise JounceError(
            f"p: {inertia.INERTIAL_PARAMETERS[k]} of {names[body]!r} is {p[place]}; expected finite numbers"
        )
    M = inertia.from_parameters(p.reshape((len(names), len(inertia.INERTIAL_PARAMETERS))))
    return replace(mechanism, M=M, meant=tuple(x for x in mechanism.meant if x != INERTIAS))
