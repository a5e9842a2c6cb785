"""Check what callers state of the joints of a robot: limits; springs and motors; stiffnesses in calls.

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
from jounce.model.limits import BOUNDED_FORCES, LIMIT_KINDS, POSITION_ENDS, StatedLimit
from jounce.model.mechanism import Mechanism
from jounce.model.spring_deflection import AntagonisticSprings
from jounce.model.springs import CubicSpring, DampedSpring, Spring, read_spring
from jounce.spatial.series import rate_name

ACTUATED = Remedy(", or robot.closed(actuated=[...]) with it")


def with_limits(mechanism: Mechanism, given: Mapping[str, object], of: object = None) -> Mechanism:
    """The mechanism with some limits in place of its own; `of` says which force its effort limits bound."""
    stated = {
        check_choice("limit", key, LIMIT_KINDS.bound_names): value for key, value in given.items() if value is not None
    }
    changes: dict[int, dict[str, StatedLimit]] = {}
    for key, value in stated.items():
        for i, number in _limits_by_joint(mechanism, key, values_by_name(value)).items():
            changes.setdefault(i, {})[key] = number
    return replace(mechanism, limits=coordinates.change_limits(mechanism, changes, _bounded_forces(stated, of)))


def _limits_by_joint(mechanism: Mechanism, key: str, given: object) -> dict[int, StatedLimit]:
    """What is given for a kind of limit, by the index of the joint variable."""
    each, leaders = _limited_joints(mechanism, key)
    if isinstance(given, Mapping):
        stated = {
            coordinates.limit_place(mechanism, name, key): _limit_value(key, value, name)
            for name, value in given.items()
        }
        motors = [mechanism.joints[i] for i in leaders]
        for i in stated:
            if each == "motor" and mechanism.joints[i] not in motors:
                raise JounceError(
                    f"{key} of joint {quote_value(mechanism.joints[i])}: it has no motor, so that nothing would check"
                    f" this limit; expected one of {join_names(motors)}{ACTUATED}"
                )
        return stated
    numbers, count = np.asarray(asarray(given, key)), len(leaders)
    pairs = key not in POSITION_ENDS
    if not is_numeric(numbers) or numbers.shape not in [(), (count,), *[(count, 2)] * pairs]:
        more = f", ({count}, 2) for (lower, upper)" if pairs else ""
        expected = f"one number, ({count},) one per {each}{more}, or a mapping {{joint: number}}"
        raise JounceError(f"{key} has shape {numbers.shape}; expected {expected}")
    numbers = numbers if numbers.ndim else np.full(count, numbers)
    return dict(zip(leaders, numbers.tolist(), strict=True))


def _limited_joints(mechanism: Mechanism, key: str) -> tuple[str, list[int]]:
    """What a kind of limit is stated for, coordinates or motors, and their joint variables in this order."""
    c = mechanism.closure
    if c is None or key in (*POSITION_ENDS, *LIMIT_KINDS.motion):
        return "coordinate", coordinates.leading_joints(mechanism)
    order = c.independent if sorted(c.actuated) == sorted(c.independent) else c.actuated
    every = coordinates.leading_joints(mechanism.tree)
    return "motor", [every[j] for j in order]


def _limit_value(key: str, given: object, joint: object) -> StatedLimit:
    number = np.asarray(asarray(given, key))
    if not is_numeric(number) or number.shape not in [(), *[(2,)] * (key not in POSITION_ENDS)]:
        pair = "" if key in POSITION_ENDS else " or two, (lower, upper)"
        raise JounceError(f"{key} of joint {quote_value(joint)} is {quote_value(given)}; expected a number{pair}")
    return number.tolist()


def _bounded_forces(stated: Mapping[str, object], of: object) -> dict[str, str]:
    """Which forces effort limits bound: those that are stated, or that `of` names."""
    efforts = [key for key in stated if key in LIMIT_KINDS.effort]
    said: Mapping[str, object] = (
        of if isinstance(of, Mapping) else dict.fromkeys(efforts, BOUNDED_FORCES[0] if of is None else of)
    )
    if of is not None and not said:
        kinds = ", ".join(LIMIT_KINDS.effort)
        raise JounceError(f"of={quote_value(of)} says which force effort limits bound; expected one of {kinds}")
    return dict.fromkeys(efforts, BOUNDED_FORCES[0]) | {
        check_choice("effort limit", kind, LIMIT_KINDS.effort): check_choice("force of a limit", force, BOUNDED_FORCES)
        for kind, force in said.items()
    }


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


def with_elasticity(mechanism: Mechanism, stated: ElasticParameters) -> Mechanism:
    """Return the mechanism with springs between motors and links: terms of the drives that act on motors leave Q."""
    refuse_contacts(mechanism, "joints are elastic without")
    stated = ElasticParameters(**{label: values_by_name(given) for label, given in vars(stated).items()})
    positions.check_single_screws(mechanism, "elastic joints")
    _check_closure(mechanism, stated)
    e = mechanism.elasticity or elasticity_from_drives(mechanism)
    if mechanism.elasticity and all(x is y for x, y in zip(vars(stated).values(), UNSTATED, strict=True)):
        return mechanism  # its own springs and motors stay
    kept = mechanism.elasticity is not None and stated.stiffness is None and stated.spring is None
    springs = e.springs if kept else _springs(mechanism, stated.spring)
    motors = _motors(mechanism, stated.motors, e)
    e = replace(
        e,
        stiffness=e.stiffness if kept else _stiffness(mechanism, stated, springs),
        rotor=e.rotor if stated.rotor is None else number_per_coordinate(mechanism, "rotor", stated.rotor, e.rotor),
        springs=springs if any(springs) else (),
        motors=motors if any(motors) else (),
        level=_coupling_level(stated.coupling),
    )
    if stated.motors is not None:
        e = _with_motors(mechanism, e, stated.rotor)
    _check_stiffness_and_rotors(mechanism, e, stated.rotor)
    e = _with_dampers(mechanism, e, stated)
    _check_carriers(mechanism, e)
    return replace(with_moved_terms(mechanism), elasticity=e)


def _check_closure(mechanism: Mechanism, stated: ElasticParameters) -> None:
    """Raise `JounceError` unless the motors of a closed robot are those of its coordinates, on the ground."""
    c = mechanism.closure
    if c is None:
        return
    if sorted(c.actuated) != sorted(c.independent):
        motors = join_names(c.coordinates[j] for j in c.actuated)
        raise JounceError(
            f"{mechanism.name!r} has motors at {motors}, and its coordinates are {join_names(mechanism.coordinates)};"
            f" expected elastic joints at the coordinates{CLOSED_MOTORS}"
        )
    if stated.coupling != "spong":
        level = f"coupling={quote_value(stated.coupling)}"
        raise JounceError(f"{level} is not available for robots with closed loops; use {SPONG_COUPLING}")
    followers = [c.coordinates[j] for j in c.dependent]
    for what, given in vars(stated).items():
        if isinstance(given, Mapping) and (named := [name for name in given if name in followers]):
            why = "it follows others in closed loops and has no motor"
            raise JounceError(
                f"{what} of joint {quote_value(named[0])}: {why}; expected one of {join_names(mechanism.coordinates)}"
            )


def _expand_by_joint(mechanism: Mechanism, given: object) -> dict[str, object]:
    """What is given of coordinates by name, or of all of them the same."""
    stated = given if isinstance(given, Mapping) else dict.fromkeys(mechanism.coordinates, given)
    return {check_choice("joint", name, mechanism.coordinates): value for name, value in stated.items()}


def _springs(mechanism: Mechanism, given: object) -> tuple[Spring | AntagonisticSprings | None, ...]:
    """The springs that are not linear, one per coordinate or None."""
    by_joint = _expand_by_joint(mechanism, given)
    stated = [(f"spring of joint {quote_value(name)}", by_joint.get(name)) for name in mechanism.coordinates]
    return tuple(x if x is None or isinstance(x, AntagonisticSprings) else read_spring(x, label) for label, x in stated)


def _motors(mechanism: Mechanism, given: object, e: Elasticity) -> tuple[Motor | None, ...]:
    """The motors, one per coordinate or None."""
    if given is None:
        return e.motors or (None,) * mechanism.n
    by_joint: dict[str, Motor] = {}
    for name, motor in _expand_by_joint(mechanism, given).items():
        if not isinstance(motor, Motor):
            raise JounceError(f"motor of joint {quote_value(name)} is {quote_value(motor)}; expected a jounce.Motor")
        if motor.body not in (None, GROUND_CARRIER):
            with locate_errors(f"motor of joint {quote_value(name)}"):
                mechanism.frame(motor.body)
        by_joint[name] = motor
    return tuple(by_joint.get(name) for name in mechanism.coordinates)


def _stiffness(mechanism: Mechanism, stated: ElasticParameters, springs: Sequence[object]) -> np.ndarray:
    """The stiffnesses (n,), those of other springs at rest; without any, joints are rigid."""
    given: Any = {} if stated.stiffness is None else stated.stiffness
    if stated.stiffness is None and not any(springs):
        raise JounceError(
            f"{mechanism.name!r} states no stiffness of its joints;"
            f" {Remedy('robot.elastic(stiffness) does, or spring=', '--stiffness does')}; infinity is a rigid joint"
        )
    numbers = number_per_coordinate(mechanism, "stiffness", given, np.full(mechanism.n, np.inf))
    for j, (name, spring) in enumerate(zip(mechanism.coordinates, springs, strict=True)):
        if spring is None:
            continue
        if (name in given) if isinstance(given, Mapping) else np.ndim(given) and not np.isnan(numbers[j]):
            cure = "leave it out of a mapping, or put NaN into an array"
            raise JounceError(f"joint {quote_value(name)} has a stiffness and a spring; expected one of them: {cure}")
        parts = (spring.first, spring.second) if isinstance(spring, AntagonisticSprings) else (spring,)
        numbers[j] = sum(float(part.stiffness(np.clip(0.0, *part.range))) for part in parts if isinstance(part, Spring))
    return numbers


def _coupling_level(coupling: object) -> int | None:
    if isinstance(coupling, str) and coupling == "spong":
        return None
    if isinstance(coupling, int) and not isinstance(coupling, bool) and coupling >= 0:
        return coupling
    levels = "the level at which rotors and links are coupled: 0, 1, 2, ..."
    raise JounceError(f"coupling is {quote_value(coupling)}; expected 'spong', or {levels}")


def _with_motors(mechanism: Mechanism, e: Elasticity, rotor: object) -> Elasticity:
    """Inertia, damping and friction of motors that state them, seen through their gears."""
    found = {name: array.copy() for name, array in e.arrays.items()}
    for j, (name, motor) in enumerate(zip(mechanism.coordinates, e.motors, strict=False)):
        if motor is None:
            continue
        if motor.reflected_inertia is not None:
            if rotor is not None and (not isinstance(rotor, Mapping) or name in rotor):
                by_both = "has the inertia of its rotor by rotor= and by its motor; state one of them"
                raise JounceError(f"joint {quote_value(name)} {by_both}")
            found["rotor"][j] = motor.reflected_inertia
        found["viscous"][j] += motor.gear**2 * motor.damping
        found["friction"][j] += abs(motor.gear) * motor.friction
    return replace(e, **found)


def _with_dampers(mechanism: Mechanism, e: Elasticity, stated: ElasticParameters) -> Elasticity:
    if stated.damping is None:
        return e
    terms = stated.damping_terms
    if not isinstance(terms, int) or isinstance(terms, bool) or terms < 1:
        raise JounceError(f"damping_terms is {quote_value(terms)}; expected a whole number, 1 or more")
    springs: list[ElasticLaw | None] = list(e.springs or (None,) * mechanism.n)
    present = np.array([law.damping if isinstance(law, DampedSpring) else 0.0 for law in springs])
    damping = number_per_coordinate(mechanism, "damping", stated.damping, present)
    for j, (name, D) in enumerate(zip(mechanism.coordinates, damping.tolist(), strict=True)):
        if not 0 <= D < np.inf:
            raise JounceError(f"damping of joint {quote_value(name)} is {D:g}; expected 0 or more, N m s/rad or N s/m")
        law = springs[j]
        spring = law.spring if isinstance(law, DampedSpring) else law
        if not D:
            springs[j] = spring
            continue
        spring = spring if spring or e.is_rigid[j] else CubicSpring(float(e.stiffness[j]))
        if not isinstance(spring, Spring):
            kind = "is rigid" if spring is None else "has two motors"
            raise JounceError(f"joint {quote_value(name)} {kind}; expected no damper parallel to its spring")
        if spring.stiffness(0.0) == 0:
            none = "has no stiffness at rest, and its damper no time constant there; give CubicSpring a k above 0"
            raise JounceError(f"the spring of joint {quote_value(name)} {none}")
        springs[j] = DampedSpring(spring, D, terms)
    return replace(e, springs=tuple(springs) if any(springs) else ())


def _check_carriers(mechanism: Mechanism, e: Elasticity) -> None:
    """Raise `JounceError` if rotors and links are coupled and a motor has no carrier, or another coupling."""
    if e.level is None:
        return
    motors = e.motors or (None,) * mechanism.n
    lost = [name for name, x in zip(mechanism.coordinates, motors, strict=True) if x is None or x.body is None]
    if lost:
        raise JounceError(
            f"coupling={e.level} needs the body that carries each rotor; {join_names(lost)} have none{ROTOR_BODIES}"
        )
    if e.is_rigid.any():
        held = join_names(name for name, rigid in zip(mechanism.coordinates, e.is_rigid, strict=True) if rigid)
        raise JounceError(f"coupling={e.level} needs elastic joints; {held} have no finite stiffness")
    if e.pairs:
        raise JounceError(f"coupling={e.level} is not available for joints with two motors; use {SPONG_COUPLING}")


def number_per_coordinate(mechanism: Mechanism, what: str, given: object, others: np.ndarray) -> np.ndarray:
    """One number for all coordinates, (n,), or {joint: number} with `others` for those left out: (n,)."""
    given = values_by_name(given)
    if isinstance(given, Mapping):
        numbers = others.copy()
        for name, value in _expand_by_joint(mechanism, given).items():
            number = np.asarray(asarray(value, f"{what} of joint {quote_value(name)}"))
            if not is_numeric(number) or number.shape != ():
                raise JounceError(f"{what} of joint {quote_value(name)} is {quote_value(value)}; expected a number")
            numbers[mechanism.coordinates.index(name)] = number
        return numbers
    array = np.asarray(asarray(given, what))
    if not is_numeric(array) or array.shape not in [(), (mechanism.n,)]:
        expected = f"one number, ({mechanism.n},) one per coordinate, or a mapping {{joint: number}}"
        raise JounceError(f"{what} has shape {array.shape}; expected {expected}")
    return np.full(mechanism.n, array, dtype=float)


def _check_stiffness_and_rotors(mechanism: Mechanism, e: Elasticity, rotor: object) -> None:
    """Raise `JounceError` unless stiffnesses and rotors are positive; a rigid joint may go without a rotor."""
    units, springs = coordinates.units(mechanism), e.springs or (None,) * mechanism.n
    for name, unit, K, B, law in zip(mechanism.coordinates, units, e.stiffness, e.rotor, springs, strict=True):
        joint, rad = f"joint {quote_value(name)}", unit == "rad"
        if not K > 0 and law is None:  # springs check their own
            expected = f"a positive number, {'N m/rad' if rad else 'N/m'}, or infinity for a rigid joint"
            raise JounceError(f"stiffness of {joint} is {K:g}; expected {expected}")
        if B == 0 and np.isinf(K):
            continue
        if B == 0 and rotor is None:
            option = Remedy("robot.elastic(stiffness, rotor=...)", "--rotor")
            raise JounceError(
                f"{joint} has no armature to take as the inertia of its rotor; {option}"
                f" states it, in {'kg m^2' if rad else 'kg'} as seen from the link"
            )
        if not 0 < B < np.inf:
            expected = f"a positive number, {'kg m^2' if rad else 'kg'} as seen from the link"
            raise JounceError(f"rotor of {joint} is {B:g}; expected {expected}")


ON_MOTORS = ("armature", "damping", "friction")  # terms of the drives that act on the motors of elastic joints


def elasticity_from_drives(mechanism: Mechanism) -> Elasticity:
    """Rigid joints with the armature of the drive trains as rotors, and the damping and friction that act."""
    n, drives = mechanism.n, mechanism.drives
    return Elasticity(
        stiffness=np.full(n, np.inf),
        rotor=_sum_by_coordinate(mechanism, "armature", mechanism.G**2),
        viscous=_sum_by_coordinate(mechanism, "damping", mechanism.G**2 * ("damping" in mechanism.acting)),
        friction=_sum_by_coordinate(mechanism, "friction", np.abs(mechanism.G) * ("friction" in mechanism.acting)),
        eps=_friction_eps(mechanism)
        if "friction" in mechanism.acting and drives.friction.any()
        else np.full(n, DEFAULT_SMOOTHING_VELOCITY),
    )


def _sum_by_coordinate(mechanism: Mechanism, term: str, weights: np.ndarray) -> np.ndarray:
    """The sums (n,) of a parameter of the joint variables; those that follow several coordinates have none."""
    amounts = getattr(mechanism.drives, term)
    for i, row in enumerate(weights):
        if amounts[i] and np.count_nonzero(row) > 1:
            leaders = join_names(mechanism.coordinates[j] for j in np.flatnonzero(row))
            came = f"joint {quote_value(mechanism.joints[i])} has {term} and follows {leaders}"
            expected = f"one motor per coordinate, with no {term} on a joint that follows several"
            raise JounceError(f"{came}; expected {expected}")
    return np.asarray(weights.T @ amounts)


def _friction_eps(mechanism: Mechanism) -> np.ndarray:
    """The smoothing velocities (n,) of the friction of the coordinates: one for all joints that follow the same."""
    found = np.full(mechanism.n, DEFAULT_SMOOTHING_VELOCITY)
    for j, name in enumerate(mechanism.coordinates):
        rubbing = np.flatnonzero(mechanism.G[:, j] * mechanism.drives.friction)
        speeds = mechanism.drives.eps[rubbing] / np.abs(mechanism.G[rubbing, j])
        if speeds.size and np.ptp(speeds) > 1e-12 * speeds.max():
            joints = join_names(mechanism.joints[i] for i in rubbing)
            came = f"different speeds of coordinate {quote_value(name)}, from {speeds.min():g} to {speeds.max():g}"
            raise JounceError(f"the friction of {joints} turns over at {came}; expected one, as a motor has")
        found[j] = speeds.mean() if speeds.size else DEFAULT_SMOOTHING_VELOCITY
    return found


def with_moved_terms(mechanism: Mechanism) -> Mechanism:
    """The mechanism without those terms of drives in Q that act on motors: of joints that coordinates move."""
    own, left, moved = np.any(mechanism.G != 0, axis=1), {}, []
    if mechanism.has_load_friction or ("stribeck" in mechanism.acting and mechanism.drives.stribeck.any()):
        cure = OMIT_LOAD_FRICTION
        raise JounceError(f"{mechanism.name}: motors of elastic joints have no stribeck or load_friction; {cure}")
    for term in [term for term in mechanism.acting if term in ON_MOTORS]:
        amounts = getattr(mechanism.drives, term)
        if amounts[~own].any():  # of joints that follow others in closed loops
            left[term] = np.where(own, 0.0, amounts)
        if term not in left or amounts[own].any():
            moved.append(term)
    if moved:
        warn(f"{mechanism.name}: {join_names(moved)} no longer acts in Q, but on the motors of the elastic joints")
    there = {term for term in mechanism.acting if getattr(mechanism.drives, AMOUNTS[term]).any()}
    acting = tuple(term for term in mechanism.acting if term in (left if term in ON_MOTORS else there))
    return replace(mechanism, drives=replace(mechanism.drives, **left), acting=acting)


def convert_stiffness(m: Mechanism, given: Any, count: int) -> list[Array]:
    """S, Sd, ... (..., k) of the k joints with two motors, by name or in their order: `count` of them."""
    names = [m.coordinates[j] for j in joint_springs.elasticity_of(m).pairs]
    if not names:
        if given is None:
            return []
        why = "no joint has two motors: spring=AntagonisticSprings(...)"
        raise JounceError(f"stiffness is given; expected None, as {why}")
    if given is None:
        raise JounceError(
            f"stiffness is None; expected the stiffness of the joints with two motors: {join_names(names)}"
        )
    terms = split_terms(given)
    if len(terms) < count:
        takes = ", ".join(rate_name("S", k) for k in range(count))
        raise JounceError(f"stiffness has {len(terms)} terms; expected a tuple ({takes}), one for each rate of Q")
    return [_stack_by_pair(term, names, rate_name("stiffness", k)) for k, term in enumerate(terms[:count])]


def _stack_by_pair(given: Any, names: Sequence[str], label: str) -> Array:
    array = np.asarray(array_by_name(given, names, label))
    array = np.broadcast_to(array, (len(names),)) if array.ndim == 0 else array
    return array_of_shape(array, (len(names),), label, f", for {join_names(names)}")
