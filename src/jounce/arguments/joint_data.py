"""Check what callers state of joints: limits, springs, motors and stiffnesses.

`with_limits` is the door of `Robot.with_limits`: numbers of all coordinates, arrays, or by joint name.

`with_elasticity` is the door of `Robot.elastic`: the springs, motors and couplings of its arguments, one entry per
coordinate, make an `Elasticity`; terms of drives that act on motors leave Q of the links. `elasticity_from_drives`
reads rotors, damping and friction of motors off the drive trains that a robot's file states. `convert_stiffness` runs
in each call for robots whose joints have two motors: their stiffness S with its rates is an argument, as q is.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from jounce.arguments.base import split_terms
from jounce.arguments.contacts import refuse_contacts
from jounce.arguments.names import array_by_name, values_by_name
from jounce.core.cures import SPONG_COUPLING, Remedy
from jounce.core.errors import JounceError, check_choice, join_names, locate_errors, quote_value, warn
from jounce.core.scalars import Array, array_of_shape, asarray, is_numeric
from jounce.dynamics import joint_springs
from jounce.dynamics.elastic import GROUND_CARRIER
from jounce.model import coordinates, positions
from jounce.model.drive_trains import AMOUNTS, DEFAULT_SMOOTHING_VELOCITY, OMIT_LOAD_FRICTION
from jounce.model.elasticity import Elasticity, ElasticLaw, Motor
from jounce.model.limits import BOUNDED_FORCES, LIMIT_KINDS, POSITION_ENDS, StatedLimit, limit_error
from jounce.model.mechanism import Mechanism
from jounce.model.spring_deflection import AntagonisticSprings
from jounce.model.springs import CubicSpring, DampedSpring, Spring, read_spring
from jounce.spatial.series import rate_name

# Of limits of the whole robot, those that bound each joint instead.
TOTAL_CURES = {"total_power": "power=[...]", "total_electrical_power": "motor_current=[...], motor_voltage=[...]"}
ACTUATED = Remedy(", or robot.closed(actuated=[...]) with it")


def with_limits(mechanism: Mechanism, limits: Mapping[str, object], of: object = None) -> Mechanism:
    """Return the mechanism with some limits in place of its own.

    `of` names the force that its effort limits bound.
    """
    known = (*LIMIT_KINDS.bound_names, *LIMIT_KINDS.totals)
    stated_limits = {check_choice("limit", key, known): value for key, value in limits.items() if value is not None}
    # Limits of the whole robot are of no joint.
    totals = {key: _total_limit(key, stated_limits.pop(key)) for key in LIMIT_KINDS.totals if key in stated_limits}
    # By kind of limit and joint -> by joint variable and kind.
    changes: dict[int, dict[str, StatedLimit]] = {}
    for key, value in stated_limits.items():
        for i, number in _limits_by_joint(mechanism, key, values_by_name(value)).items():
            changes.setdefault(i, {})[key] = number
    forces = _bounded_forces(stated_limits, of)
    changed_limits = coordinates.change_limits(mechanism, changes, forces)
    return replace(mechanism, limits=changed_limits.with_totals(totals))


def _total_limit(key: str, value: object) -> StatedLimit:
    """Return a limit of the whole robot.

    It is a number, or two for (lower, upper).
    """
    per_joint = Remedy(f"; with_limits({TOTAL_CURES[key]}) bounds each joint")
    number = None if isinstance(value, Mapping) else np.asarray(asarray(value, key))
    if number is not None and number.shape == (2, 1):
        number = number[:, 0]  # as `Limits.bounds` returns them
    if number is None or not is_numeric(number) or number.shape not in [(), (2,)]:
        raise JounceError(
            f"{key} is {quote_value(value)}; expected a number for the whole robot, or two, (lower, upper){per_joint}"
        )
    limit = number.tolist()
    error = limit_error(**{key: limit})
    if error is not None:
        raise JounceError(f"{error}{per_joint if number.ndim > 0 else ''}")
    return limit


def _limits_by_joint(mechanism: Mechanism, key: str, values: object) -> dict[int, StatedLimit]:
    """Return the limits of a kind by joint variable.

    A caller gives them by name, one per coordinate or motor, or one for all.
    """
    owner, leaders = _limited_joints(mechanism, key)
    if isinstance(values, Mapping):
        limits_by_joint = {
            coordinates.limit_place(mechanism, name, key): _limit_value(key, value, name)
            for name, value in values.items()
        }
        # Coordinates that motors move together have no motor, but a force.
        tree_leaders = coordinates.leading_joints(mechanism.tree)
        moved_together = [tree_leaders[j] for j in coordinates.shared_coordinates(mechanism)]
        motors = [mechanism.joints[i] for i in (*leaders, *moved_together)]
        for i in limits_by_joint:
            if owner == "motor" and mechanism.joints[i] not in motors:
                raise JounceError(
                    f"{key} of joint {quote_value(mechanism.joints[i])}: it has no motor, so that nothing would check"
                    f" this limit; expected one of {join_names(motors)}{ACTUATED}"
                )
        return limits_by_joint
    numbers, count = np.asarray(asarray(values, key)), len(leaders)
    if key not in POSITION_ENDS and numbers.shape == (2, len(mechanism.joints)) and is_numeric(numbers):
        numbers = _bounds_by_joint(key, numbers, leaders)
    # An end of a position is one number; other limits may differ by direction.
    shapes = [(), (count,)] if key in POSITION_ENDS else [(), (count,), (count, 2)]
    if not is_numeric(numbers) or numbers.shape not in shapes:
        pairs = "" if key in POSITION_ENDS else f", ({count}, 2) for (lower, upper)"
        expected = f"one number, ({count},) one per {owner}{pairs}, or a mapping {{joint: number}}"
        raise JounceError(f"{key} has shape {numbers.shape}; expected {expected}")
    numbers = np.full(count, numbers) if numbers.ndim == 0 else numbers
    return dict(zip(leaders, numbers.tolist(), strict=True))


def _bounds_by_joint(key: str, bounds: np.ndarray, leaders: list[int]) -> np.ndarray:
    """Return bounds (2, nb) as `Limits.bounds` returns them, lower and upper, by joint: (n, 2).

    Two joints have (2, 2) either way round: what no limits can be is not meant.
    """
    by_side = bounds[:, leaders].T
    if len(leaders) != 2 or bounds.shape != (2, 2) or np.array_equal(bounds, by_side):
        return by_side
    # Limits have 0 between their ends; those of forces may lie on one side of it.
    rules = (_enclose_zero, _are_ordered) if LIMIT_KINDS[key].any_sign else (_enclose_zero,)
    for are_limits in rules:
        fitting = [ends for ends in (bounds, by_side) if are_limits(ends)]
        if len(fitting) == 1:
            return fitting[0]
        if len(fitting) == 2:
            came = f"{key} of two joints is {quote_value(bounds.tolist())}, (lower, upper) by rows or by columns"
            raise JounceError(f"{came}; expected a mapping {{joint: (lower, upper)}}")
    return bounds


def _enclose_zero(ends: np.ndarray) -> bool:
    return bool(np.all((ends[:, 0] <= 0) & (ends[:, 1] >= 0)))


def _are_ordered(ends: np.ndarray) -> bool:
    return bool(np.all(ends[:, 0] <= ends[:, 1]))


def _limited_joints(mechanism: Mechanism, key: str) -> tuple[str, list[int]]:
    """Return the owner of a kind of limit, and the joint variables.

    The owner is a coordinate or a motor; the variables are in the order of coordinates or motors.
    """
    c = mechanism.closure
    if c is None or key in (*POSITION_ENDS, *LIMIT_KINDS.motion):
        return "coordinate", coordinates.leading_joints(mechanism)
    # Motors of a closed robot may be at joints that are no independent coordinates.
    order = c.independent if sorted(c.actuated) == sorted(c.independent) else c.actuated
    joints_of_tree = coordinates.leading_joints(mechanism.tree)
    return "motor", [joints_of_tree[j] for j in order]


def _limit_value(key: str, value: object, joint: object) -> StatedLimit:
    """Return the limit of one joint: a number, or two for (lower, upper)."""
    number = np.asarray(asarray(value, key))
    shapes = [()] if key in POSITION_ENDS else [(), (2,)]
    if not is_numeric(number) or number.shape not in shapes:
        pair = "" if key in POSITION_ENDS else " or two, (lower, upper)"
        raise JounceError(f"{key} of joint {quote_value(joint)} is {quote_value(value)}; expected a number{pair}")
    return number.tolist()


def _bounded_forces(stated_limits: Mapping[str, object], of: object) -> dict[str, str]:
    """Return the forces that effort limits bound, by kind of limit.

    `of` names one force for all limits that are stated, or forces by kind; by default limits bound the whole force.
    """
    efforts = [key for key in stated_limits if key in LIMIT_KINDS.effort]
    force_of_all = BOUNDED_FORCES[0] if of is None else of
    forces: Mapping[str, object] = of if isinstance(of, Mapping) else dict.fromkeys(efforts, force_of_all)
    if of is not None and len(forces) == 0:
        kinds = ", ".join(LIMIT_KINDS.effort)
        raise JounceError(f"of={quote_value(of)} says which force effort limits bound; expected one of {kinds}")
    checked_forces = {
        check_choice("effort limit", kind, LIMIT_KINDS.effort): check_choice("force of a limit", force, BOUNDED_FORCES)
        for kind, force in forces.items()
    }
    return dict.fromkeys(efforts, BOUNDED_FORCES[0]) | checked_forces


CLOSED_MOTORS = Remedy(
    ": robot.closed() has those of the motors, where these are as many as the ways in which it moves"
)
ROTOR_BODIES = Remedy(
    ": motors={joint: jounce.Motor(gear=..., inertia=..., body=..., axis=...)}, 'world' for the ground",
    "; state them in its file, 'world' for the ground",
)


@dataclass(frozen=True, kw_only=True)
class ElasticParameters:
    """The arguments of `Robot.elastic`, unchecked."""

    stiffness: object = None
    rotor: object = None
    damping: object = None
    spring: object = None
    coupling: object = "spong"
    motors: object = None
    damping_terms: object = 4


UNSTATED = tuple(vars(ElasticParameters()).values())


def with_elasticity(mechanism: Mechanism, parameters: ElasticParameters) -> Mechanism:
    """Return the mechanism with springs between motors and links.

    Terms of the drives that act on motors leave Q.
    """
    refuse_contacts(mechanism, "joints are elastic without")
    parameters = ElasticParameters(**{label: values_by_name(value) for label, value in vars(parameters).items()})
    positions.check_single_screws(mechanism, "elastic joints")
    _check_closure(mechanism, parameters)
    # Where nothing is stated, the springs and motors that the robot has already stay.
    is_unstated = all(x is y for x, y in zip(vars(parameters).values(), UNSTATED, strict=True))
    if mechanism.elasticity is not None and is_unstated:
        return mechanism
    e = elasticity_from_drives(mechanism) if mechanism.elasticity is None else mechanism.elasticity
    keeps_springs = mechanism.elasticity is not None and parameters.stiffness is None and parameters.spring is None
    springs = e.springs if keeps_springs else _springs(mechanism, parameters.spring)
    motors = _motors(mechanism, parameters.motors, e)
    e = replace(
        e,
        stiffness=e.stiffness if keeps_springs else _stiffness(mechanism, parameters, springs),
        rotor=e.rotor
        if parameters.rotor is None
        else number_per_coordinate(mechanism, "rotor", parameters.rotor, e.rotor),
        springs=springs if any(springs) else (),
        motors=motors if any(motors) else (),
        level=_coupling_level(parameters.coupling),
    )
    # Motors and dampers change what is there, so that they come after springs and rotors, and are checked with them.
    if parameters.motors is not None:
        e = _with_motors(mechanism, e, parameters.rotor)
    _check_stiffness_and_rotors(mechanism, e, parameters.rotor)
    e = _with_dampers(mechanism, e, parameters)
    _check_carriers(mechanism, e)
    return replace(with_moved_terms(mechanism), elasticity=e)


def _check_closure(mechanism: Mechanism, parameters: ElasticParameters) -> None:
    """Raise `JounceError` unless a closed robot can have elastic joints.

    Its motors have to be at its coordinates, on the ground.
    """
    c = mechanism.closure
    if c is None:
        return
    if sorted(c.actuated) != sorted(c.independent):
        motors = join_names(c.coordinates[j] for j in c.actuated)
        raise JounceError(
            f"{mechanism.name!r} has motors at {motors}, and its coordinates are {join_names(mechanism.coordinates)};"
            f" expected elastic joints at the coordinates{CLOSED_MOTORS}"
        )
    if parameters.coupling != "spong":
        level = f"coupling={quote_value(parameters.coupling)}"
        raise JounceError(f"{level} is not available for robots with closed loops; use {SPONG_COUPLING}")
    followers = [c.coordinates[j] for j in c.dependent]
    for what, values in vars(parameters).items():
        stated_followers = [name for name in values if name in followers] if isinstance(values, Mapping) else []
        if len(stated_followers) > 0:
            why = "it follows others in closed loops and has no motor"
            raise JounceError(
                f"{what} of joint {quote_value(stated_followers[0])}: {why};"
                f" expected one of {join_names(mechanism.coordinates)}"
            )


def _expand_by_joint(mechanism: Mechanism, values: object) -> dict[str, object]:
    """Return values by name of coordinates.

    A single value is that of all.
    """
    by_joint = values if isinstance(values, Mapping) else dict.fromkeys(mechanism.coordinates, values)
    return {check_choice("joint", name, mechanism.coordinates): value for name, value in by_joint.items()}


def _springs(mechanism: Mechanism, springs_by_joint: object) -> tuple[Spring | AntagonisticSprings | None, ...]:
    """Return the springs that are not linear, one per coordinate or None."""
    by_joint = _expand_by_joint(mechanism, springs_by_joint)
    springs: list[Spring | AntagonisticSprings | None] = []
    for name in mechanism.coordinates:
        spring: Any = by_joint.get(name)
        is_ready = spring is None or isinstance(spring, AntagonisticSprings)
        springs.append(spring if is_ready else read_spring(spring, f"spring of joint {quote_value(name)}"))
    return tuple(springs)


def _motors(mechanism: Mechanism, motors_by_joint: object, e: Elasticity) -> tuple[Motor | None, ...]:
    """Return the motors, one per coordinate or None."""
    if motors_by_joint is None:
        return e.motors if len(e.motors) > 0 else (None,) * mechanism.n
    by_joint: dict[str, Motor] = {}
    for name, motor in _expand_by_joint(mechanism, motors_by_joint).items():
        if not isinstance(motor, Motor):
            raise JounceError(f"motor of joint {quote_value(name)} is {quote_value(motor)}; expected a jounce.Motor")
        if motor.body not in (None, GROUND_CARRIER):
            with locate_errors(f"motor of joint {quote_value(name)}"):
                mechanism.frame(motor.body)
        by_joint[name] = motor
    return tuple(by_joint.get(name) for name in mechanism.coordinates)


def _stiffness(mechanism: Mechanism, parameters: ElasticParameters, springs: Sequence[object]) -> np.ndarray:
    """Return the stiffnesses (n,) of the joints; others are rigid.

    The stiffness of a spring that is not linear is that at rest.
    """
    stated_stiffness: Any = {} if parameters.stiffness is None else parameters.stiffness
    if parameters.stiffness is None and not any(springs):
        raise JounceError(
            f"the joint stiffness of {mechanism.name!r} is unknown; give it"
            f"{Remedy(' with robot.elastic(stiffness) or spring=', ' with --stiffness')}, infinity for rigid joints"
        )
    numbers = number_per_coordinate(mechanism, "stiffness", stated_stiffness, np.full(mechanism.n, np.inf))
    for j, (name, spring) in enumerate(zip(mechanism.coordinates, springs, strict=True)):
        if spring is None:
            continue
        # One number for all joints is no stiffness of a joint with a spring of its own.
        is_named = isinstance(stated_stiffness, Mapping) and name in stated_stiffness
        is_in_array = (
            not isinstance(stated_stiffness, Mapping) and np.ndim(stated_stiffness) > 0 and not np.isnan(numbers[j])
        )
        if is_named or is_in_array:
            cure = "leave it out of a mapping, or put NaN into an array"
            raise JounceError(f"joint {quote_value(name)} has a stiffness and a spring; expected one of them: {cure}")
        # Two springs of antagonistic motors act in parallel; at rest, or at the end of the range nearest to it.
        parts = (spring.first, spring.second) if isinstance(spring, AntagonisticSprings) else (spring,)
        numbers[j] = sum(float(part.stiffness(np.clip(0.0, *part.range))) for part in parts if isinstance(part, Spring))
    return numbers


def _coupling_level(coupling: object) -> int | None:
    """Return the level of coupled rotors, None for Spong's model."""
    if isinstance(coupling, str) and coupling == "spong":
        return None
    if isinstance(coupling, int) and not isinstance(coupling, bool) and coupling >= 0:
        return coupling
    levels = "the level at which rotors and links are coupled: 0, 1, 2, ..."
    raise JounceError(f"coupling is {quote_value(coupling)}; expected 'spong', or {levels}")


def _with_motors(mechanism: Mechanism, e: Elasticity, rotor: object) -> Elasticity:
    """Return inertia, damping and friction of motors, seen through gears."""
    arrays = {name: array.copy() for name, array in e.arrays.items()}
    for j, (name, motor) in enumerate(zip(mechanism.coordinates, e.motors, strict=False)):
        if motor is None:
            continue
        if motor.reflected_inertia is not None:
            if rotor is not None and (not isinstance(rotor, Mapping) or name in rotor):
                by_both = "has the inertia of its rotor by rotor= and by its motor; state one of them"
                raise JounceError(f"joint {quote_value(name)} {by_both}")
            arrays["rotor"][j] = motor.reflected_inertia
        arrays["viscous"][j] += motor.gear**2 * motor.damping
        arrays["friction"][j] += abs(motor.gear) * motor.friction
    return replace(e, **arrays)


def _with_dampers(mechanism: Mechanism, e: Elasticity, parameters: ElasticParameters) -> Elasticity:
    """Return the elasticity with dampers parallel to its springs."""
    if parameters.damping is None:
        return e
    terms = parameters.damping_terms
    if not isinstance(terms, int) or isinstance(terms, bool) or terms < 1:
        raise JounceError(f"damping_terms is {quote_value(terms)}; expected a whole number, 1 or more")
    springs: list[ElasticLaw | None] = list(e.springs) if len(e.springs) > 0 else [None] * mechanism.n
    # Dampers that are not stated stay.
    present_damping = np.array([law.damping if isinstance(law, DampedSpring) else 0.0 for law in springs])
    damping = number_per_coordinate(mechanism, "damping", parameters.damping, present_damping)
    for j, (name, D) in enumerate(zip(mechanism.coordinates, damping.tolist(), strict=True)):
        if not 0 <= D < np.inf:
            raise JounceError(f"damping of joint {quote_value(name)} is {D:g}; expected 0 or more, N m s/rad or N s/m")
        law = springs[j]
        spring = law.spring if isinstance(law, DampedSpring) else law
        if D == 0:
            springs[j] = spring
            continue
        # A linear spring, which is a stiffness without a law, gets one that a damper can be parallel to.
        if spring is None and not e.is_rigid[j]:
            spring = CubicSpring(float(e.stiffness[j]))
        if not isinstance(spring, Spring):
            kind = "is rigid" if spring is None else "has two motors"
            raise JounceError(f"joint {quote_value(name)} {kind}; expected no damper parallel to its spring")
        if spring.stiffness(0.0) == 0:
            none = "has no stiffness at rest, and its damper no time constant there; give CubicSpring a k above 0"
            raise JounceError(f"the spring of joint {quote_value(name)} {none}")
        springs[j] = DampedSpring(spring, D, terms)
    return replace(e, springs=tuple(springs) if any(springs) else ())


def _check_carriers(mechanism: Mechanism, e: Elasticity) -> None:
    """Raise `JounceError` if coupled rotors and links lack something.

    Each motor needs a body that carries it, and each joint one motor and a spring.
    """
    if e.level is None:
        return
    motors = e.motors if len(e.motors) > 0 else (None,) * mechanism.n
    without = [name for name, x in zip(mechanism.coordinates, motors, strict=True) if x is None or x.body is None]
    if len(without) > 0:
        raise JounceError(
            f"coupling={e.level} needs the body that carries each rotor; {join_names(without)} have none{ROTOR_BODIES}"
        )
    if e.is_rigid.any():
        rigid_names = [name for name, rigid in zip(mechanism.coordinates, e.is_rigid, strict=True) if rigid]
        raise JounceError(
            f"coupling={e.level} needs elastic joints; {join_names(rigid_names)} have no finite stiffness"
        )
    if e.pairs:
        raise JounceError(f"coupling={e.level} is not available for joints with two motors; use {SPONG_COUPLING}")


def number_per_coordinate(mechanism: Mechanism, what: str, values: object, defaults: np.ndarray) -> np.ndarray:
    """Return an array (n,) of one number per coordinate.

    A caller gives one number for all, an array, or numbers by name with `defaults` (n,) for those left out.
    """
    values = values_by_name(values)
    if isinstance(values, Mapping):
        numbers = defaults.copy()
        for name, value in _expand_by_joint(mechanism, values).items():
            number = np.asarray(asarray(value, f"{what} of joint {quote_value(name)}"))
            if not is_numeric(number) or number.shape != ():
                raise JounceError(f"{what} of joint {quote_value(name)} is {quote_value(value)}; expected a number")
            numbers[mechanism.coordinates.index(name)] = number
        return numbers
    array = np.asarray(asarray(values, what))
    if not is_numeric(array) or array.shape not in [(), (mechanism.n,)]:
        expected = f"one number, ({mechanism.n},) one per coordinate, or a mapping {{joint: number}}"
        raise JounceError(f"{what} has shape {array.shape}; expected {expected}")
    return np.full(mechanism.n, array, dtype=float)


def _check_stiffness_and_rotors(mechanism: Mechanism, e: Elasticity, rotor: object) -> None:
    """Raise `JounceError` unless stiffnesses and rotors are positive.

    A rigid joint may be without a rotor.
    """
    units, springs = coordinates.units(mechanism), e.springs if len(e.springs) > 0 else (None,) * mechanism.n
    for name, unit, K, B, law in zip(mechanism.coordinates, units, e.stiffness, e.rotor, springs, strict=True):
        joint, turns = f"joint {quote_value(name)}", unit == "rad"
        # Springs with a law check their own stiffness. A rigid joint moves its motor with its link.
        if not K > 0 and law is None:
            expected = f"a positive number, {'N m/rad' if turns else 'N/m'}, or infinity for a rigid joint"
            raise JounceError(f"stiffness of {joint} is {K:g}; expected {expected}")
        if B == 0 and np.isinf(K):
            continue
        if B == 0 and rotor is None:
            option = Remedy(" with robot.elastic(stiffness, rotor=...)", " with --rotor")
            raise JounceError(
                f"the rotor inertia of {joint} is unknown, since it has no armature; give it{option},"
                f" in {'kg m^2' if turns else 'kg'} as seen from the link"
            )
        if not 0 < B < np.inf:
            expected = f"a positive number, {'kg m^2' if turns else 'kg'} as seen from the link"
            raise JounceError(f"rotor of {joint} is {B:g}; expected {expected}")


ON_MOTORS = ("armature", "damping", "friction")  # terms of the drives that act on the motors of elastic joints


def elasticity_from_drives(mechanism: Mechanism) -> Elasticity:
    """Return rigid joints with the drive trains of the robot as motors.

    Rotors are the armature; the damping and friction that act in Q are those of the motors.
    """
    n, drives = mechanism.n, mechanism.drives
    has_damping, has_friction = "damping" in mechanism.acting, "friction" in mechanism.acting
    # Seen from a coordinate that moves a joint by a ratio G: inertia and damping times G^2, friction times |G|.
    eps = np.full(n, DEFAULT_SMOOTHING_VELOCITY)
    if has_friction and drives.friction.any():
        eps = _friction_eps(mechanism)
    return Elasticity(
        stiffness=np.full(n, np.inf),
        rotor=_sum_by_coordinate(mechanism, "armature", mechanism.G**2),
        viscous=_sum_by_coordinate(mechanism, "damping", mechanism.G**2 * has_damping),
        friction=_sum_by_coordinate(mechanism, "friction", np.abs(mechanism.G) * has_friction),
        eps=eps,
    )


def _sum_by_coordinate(mechanism: Mechanism, term: str, weights: np.ndarray) -> np.ndarray:
    """Return the sums (n,) of a parameter of the joint variables.

    Raises `JounceError` if a joint that has the parameter follows several coordinates.
    """
    amounts = getattr(mechanism.drives, term)
    for i, row in enumerate(weights):
        if amounts[i] and np.count_nonzero(row) > 1:
            leaders = join_names(mechanism.coordinates[j] for j in np.flatnonzero(row))
            came = f"joint {quote_value(mechanism.joints[i])} has {term} and follows {leaders}"
            expected = f"one motor per coordinate, with no {term} on a joint that follows several"
            raise JounceError(f"{came}; expected {expected}")
    return np.asarray(weights.T @ amounts)


def _friction_eps(mechanism: Mechanism) -> np.ndarray:
    """Return the smoothing velocities (n,) of the friction of coordinates.

    All joints that follow a coordinate have to agree on one.
    """
    eps = np.full(mechanism.n, DEFAULT_SMOOTHING_VELOCITY)
    for j, name in enumerate(mechanism.coordinates):
        # The speed of the coordinate at which the friction of a joint turns over.
        joints_with_friction = np.flatnonzero(mechanism.G[:, j] * mechanism.drives.friction)
        if joints_with_friction.size == 0:
            continue
        speeds = mechanism.drives.eps[joints_with_friction] / np.abs(mechanism.G[joints_with_friction, j])
        if np.ptp(speeds) > 1e-12 * speeds.max():
            joints = join_names(mechanism.joints[i] for i in joints_with_friction)
            came = f"different speeds of coordinate {quote_value(name)}, from {speeds.min():g} to {speeds.max():g}"
            raise JounceError(f"the friction of {joints} turns over at {came}; expected one, as a motor has")
        eps[j] = speeds.mean()
    return eps


def with_moved_terms(mechanism: Mechanism) -> Mechanism:
    """Return the mechanism without the terms of Q that act on motors.

    These are terms of the drives of joints that coordinates move.
    """
    if mechanism.has_load_friction or ("stribeck" in mechanism.acting and mechanism.drives.stribeck.any()):
        cure = OMIT_LOAD_FRICTION
        raise JounceError(f"{mechanism.name}: motors of elastic joints have no stribeck or load_friction; {cure}")
    # Joints that follow others in closed loops have no motors: their terms stay in Q.
    is_moved = np.any(mechanism.G != 0, axis=1)
    amounts_in_Q: dict[str, np.ndarray] = {}
    terms_on_motors = []
    for term in mechanism.acting:
        if term not in ON_MOTORS:
            continue
        amounts = getattr(mechanism.drives, term)
        if amounts[~is_moved].any():
            amounts_in_Q[term] = np.where(is_moved, 0.0, amounts)
        if term not in amounts_in_Q or amounts[is_moved].any():
            terms_on_motors.append(term)
    if len(terms_on_motors) > 0:
        names = join_names(terms_on_motors)
        warn(f"{mechanism.name}: {names} no longer acts in Q, but on the motors of the elastic joints")
    # Terms of zero amounts leave Q, too.
    nonzero_terms = {term for term in mechanism.acting if getattr(mechanism.drives, AMOUNTS[term]).any()}
    acting = tuple(term for term in mechanism.acting if term in (amounts_in_Q if term in ON_MOTORS else nonzero_terms))
    return replace(mechanism, drives=replace(mechanism.drives, **amounts_in_Q), acting=acting)


def convert_stiffness(m: Mechanism, stiffness: Any, count: int) -> list[Array]:
    """Return the `count` terms S, Sd, ... (..., k) of a call.

    They are stiffnesses of the k joints with two motors, by name or in their order.
    """
    names = [m.coordinates[j] for j in joint_springs.elasticity_of(m).pairs]
    if len(names) == 0:
        if stiffness is None:
            return []
        why = "no joint has two motors: spring=AntagonisticSprings(...)"
        raise JounceError(f"stiffness is given; expected None, as {why}")
    if stiffness is None:
        raise JounceError(
            f"stiffness is None; expected the stiffness of the joints with two motors: {join_names(names)}"
        )
    terms = split_terms(stiffness)
    if len(terms) < count:
        takes = ", ".join(rate_name("S", k) for k in range(count))
        raise JounceError(f"stiffness has {len(terms)} terms; expected a tuple ({takes}), one for each rate of Q")
    return [_stack_by_pair(term, names, rate_name("stiffness", k)) for k, term in enumerate(terms[:count])]


def _stack_by_pair(values: Any, names: Sequence[str], label: str) -> Array:
    """Return an array (..., k) for the joints with two motors."""
    array = np.asarray(array_by_name(values, names, label))
    # One number serves all joints.
    array = np.broadcast_to(array, (len(names),)) if array.ndim == 0 else array
    return array_of_shape(array, (len(names),), label, f", for {join_names(names)}")
