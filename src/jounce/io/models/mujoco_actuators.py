"""Actuators of MuJoCo's models, at joints and on fixed tendons.

A fixed tendon has the length ``L = sum_j c_j theta_j``, which follows the coordinates by ``L = c^T (G q + g)``. What
pulls at it with the force F exerts F c_j on its joints, so that it is a rotor that turns by L: armature, damping,
friction and spring of the tendon are those of the rotor, and an actuator of gear r is a motor that turns by r L.
MuJoCo leaves out of the armature what couples joints on different branches, a c_i c_j, as its mass matrix has no place
for it; here it is kept.

`joint_forces` gives what the actuators at one joint exert together. `find_unread` says what is left out.
`prepare_tendons` and `drive_by_tendons` are the doors of tendons. On the tree that is built, in this order:

1. `_with_resisting_tendons`: tendons with a drive train become rotors that follow.
2. `_with_motor_ranges`: where tendons pull at a coordinate, the ranges of the actuators at its joint bound its force no
   longer. Motors on a tendon that moves a single coordinate sit at this coordinate, and their ranges add up.
3. `drive_by_tendons`: motors on tendons that move several coordinates together drive these, if they determine how they
   move; otherwise they are left out, with a warning.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from jounce.arguments.transmissions import drive_by_rotors
from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, join_names, warn
from jounce.io.models.mujoco_arrays import JOINT_TRANSMISSION_TYPES, ModelArrays, make_distinct
from jounce.model import positions
from jounce.model.coordinates import change_limits, leading_joints
from jounce.model.limits import StatedLimit
from jounce.model.mechanism import Mechanism
from jounce.model.transmissions import CoupledRotor, with_rotors

TENDON_TRANSMISSION_TYPE = 3  # mujoco.mjtTrn
JOINT_WRAP_TYPE = 1  # mujoco.mjtWrap: the parts of fixed tendons
Range = tuple[float, float]  # of a force: its smallest and its largest value
UNLIMITED: Range = (-np.inf, np.inf)


def find_joint_actuators(m: ModelArrays, j: int) -> np.ndarray:
    """Return which actuators act on a joint."""
    return np.isin(m["actuator_trntype"], JOINT_TRANSMISSION_TYPES) & (m["actuator_trnid"][:, 0] == j)


def joint_forces(m: ModelArrays, j: int) -> Range:
    """Return the smallest and largest force of the actuators of a joint.

    They may exert together the sum of their ranges. It is infinite without actuators, or where one has no range.
    """
    return _sum_of_ranges(m, find_joint_actuators(m, j))


def clamped_forces(m: ModelArrays, j: int, forces: Range) -> Range:
    """Return the part of a range that a joint allows its actuators."""
    if not m["jnt_actfrclimited"][j]:
        return forces
    return _intersect(forces, m["jnt_actfrcrange"][j])


def _sum_of_ranges(m: ModelArrays, acts: np.ndarray) -> Range:
    actuators = np.flatnonzero(acts)
    if actuators.size == 0 or not m["actuator_forcelimited"][actuators].all():
        return UNLIMITED
    # Gears may be negative, so that ends of a range change places.
    ranges = m["actuator_forcerange"][actuators] * m["actuator_gear"][actuators, :1]
    return float(ranges.min(axis=1).sum()), float(ranges.max(axis=1).sum())


def _intersect(forces: Range, others: Sequence[float]) -> Range:
    return max(forces[0], float(others[0])), min(forces[1], float(others[1]))


def _scale(forces: Sequence[float], factor: float) -> Range:
    """Return a range times a factor, its smaller end first."""
    smaller, larger = sorted((float(forces[0]) * factor, float(forces[1]) * factor))
    return smaller, larger


@dataclass(frozen=True, eq=False)
class Tendon:
    """A fixed tendon of the length ``coefficients theta``.

    theta are the joint variables of the model. `drive` is its drive train, by the names of `Drives`; `actuators` are
    those that pull at it.
    """

    index: int
    name: str
    coefficients: Mapping[str, float]  # by joint
    drive: Mapping[str, float]
    actuators: np.ndarray  # which of the model's

    def ratios(self, mechanism: Mechanism) -> tuple[np.ndarray, float]:
        """Return c^T G and c^T g of the tree.

        Joints that it lacks count as at rest at zero.
        """
        c = np.array([self.coefficients.get(name, 0.0) for name in mechanism.joints])
        return c @ mechanism.G, float(c @ mechanism.g)

    def forces(self, m: ModelArrays) -> Range:
        """Return the smallest and largest force of all actuators on the tendon."""
        forces = _sum_of_ranges(m, self.actuators)
        is_clamped = m["tendon_actfrclimited"].any() and m["tendon_actfrclimited"][self.index]
        return _intersect(forces, m["tendon_actfrcrange"][self.index]) if is_clamped else forces


def _find_fixed(m: ModelArrays) -> np.ndarray:
    """Return which tendons are fixed, not spatial."""
    return np.asarray(m["wrap_type"][m["tendon_adr"]] == JOINT_WRAP_TYPE)


def _find_slack(m: ModelArrays) -> np.ndarray:
    """Return which tendons have a spring with a slack range."""
    rests = m["tendon_lengthspring"]
    return np.asarray((m["tendon_stiffness"] != 0) & (rests[:, 0] != rests[:, 1]))


def find_unread(m: ModelArrays) -> dict[str, np.ndarray]:
    """Return what is not read of tendons and actuators.

    Which of them have a term, by the words of a warning.
    """
    spatial, slack = ~_find_fixed(m), _find_slack(m)
    on_tendon = m["actuator_trntype"] == TENDON_TRANSMISSION_TYPE
    on_fixed = on_tendon.copy()
    on_fixed[on_tendon] = ~spatial[m["actuator_trnid"][on_tendon, 0]]
    at_joint = np.isin(m["actuator_trntype"], JOINT_TRANSMISSION_TYPES)
    has_train = m.nonzero_rows("actuator_armature", "actuator_damping", "actuator_dampingpoly")
    resists = m.nonzero_rows("tendon_stiffness", "tendon_damping", "tendon_frictionloss")
    is_bent = m.nonzero_rows("tendon_stiffnesspoly", "tendon_dampingpoly", "tendon_springyield")
    return {
        "motors on spatial tendons": on_tendon & ~on_fixed,
        "spatial tendons that pull or resist": spatial & resists,
        "armatures of spatial tendons": spatial & m.nonzero_rows("tendon_armature"),
        "springs of tendons that are slack over a range": ~spatial & slack,
        "springs and dampers of tendons that are not linear": ~spatial & is_bent,
        "drive trains of actuators at no joint": has_train & ~at_joint & ~on_fixed,
        "dampers of actuators that are not linear": (at_joint | on_fixed) & m.nonzero_rows("actuator_dampingpoly"),
    }


def _read_tendons(m: ModelArrays) -> list[Tendon]:
    """Return the fixed tendons of a model.

    A spring that is slack over a range is no linear one, and is left out.
    """
    tendons = []
    for i in np.flatnonzero(_find_fixed(m)):
        parts = range(m["tendon_adr"][i], m["tendon_adr"][i] + m["tendon_num"][i])
        # A joint may occur twice: its coefficients add up.
        coefficients: dict[str, float] = {}
        for part in parts:
            joint = m.joints[m["wrap_objid"][part]]
            coefficients[joint] = coefficients.get(joint, 0.0) + float(m["wrap_prm"][part])
        pulls = (m["actuator_trntype"] == TENDON_TRANSMISSION_TYPE) & (m["actuator_trnid"][:, 0] == i)
        tendons.append(Tendon(int(i), m.tendons[i], coefficients, _tendon_drive(m, int(i), pulls), pulls))
    return tendons


def _tendon_drive(m: ModelArrays, i: int, pulls: np.ndarray) -> dict[str, float]:
    """Return the drive train of a tendon by its length.

    Armature and damping of its actuators count times the gear squared.
    """
    gears_squared = pulls * m["actuator_gear"][:, 0] ** 2
    armature = m["tendon_armature"][i] if m["tendon_armature"].ndim > 0 else 0.0
    drive = {
        "armature": armature + np.sum(gears_squared * m["actuator_armature"]),
        "damping": m["tendon_damping"][i] + np.sum(gears_squared * m["actuator_damping"]),
        "friction": m["tendon_frictionloss"][i] * m.acts("FRICTIONLOSS", "CONSTRAINT"),
    }
    drive["damping"] *= m.acts("DAMPER", "PASSIVE")
    if m["tendon_stiffness"][i] != 0 and not _find_slack(m)[i] and m.acts("SPRING", "PASSIVE"):
        drive |= {"stiffness": m["tendon_stiffness"][i], "rest": m["tendon_lengthspring"][i][0]}
    return {key: float(x) for key, x in drive.items() if x != 0}


@dataclass(frozen=True, eq=False)
class TendonDrives:
    """Which tendons move a tree, by the coordinates that they move.

    `moved` are the places of these coordinates, tendon by tendon.
    """

    m: ModelArrays
    tree: Mechanism
    tendons: Sequence[Tendon]
    moved: Sequence[np.ndarray] = field(init=False)

    def __post_init__(self) -> None:
        moved = [np.flatnonzero(tendon.ratios(self.tree)[0]) for tendon in self.tendons]
        object.__setattr__(self, "moved", moved)

    @property
    def pulled(self) -> list[tuple[Tendon, np.ndarray]]:
        """The tendons with actuators, and the coordinates that each moves."""
        pairs = zip(self.tendons, self.moved, strict=True)
        return [(tendon, places) for tendon, places in pairs if tendon.actuators.any() and len(places) > 0]

    @property
    def lone(self) -> dict[int, list[Tendon]]:
        """The pulled tendons that move a single coordinate, by its place."""
        by_place: dict[int, list[Tendon]] = {}
        for tendon, places in self.pulled:
            if len(places) == 1:
                by_place.setdefault(int(places[0]), []).append(tendon)
        return by_place

    @property
    def coupled(self) -> list[tuple[Tendon, np.ndarray]]:
        """The pulled tendons that move several coordinates together."""
        return [(tendon, places) for tendon, places in self.pulled if len(places) > 1]

    @property
    def motor_names(self) -> set[str]:
        """The names of coordinates that have motors of their own."""
        at_joints = self.m["actuator_trnid"][np.isin(self.m["actuator_trntype"], JOINT_TRANSMISSION_TYPES), 0]
        return {self.m.joints[j] for j in at_joints} | {self.tree.coordinates[place] for place in self.lone}

    def own_forces(self, place: int) -> Range | None:
        """Return the range of motors that move a coordinate alone, if any."""
        joint = self.joint(place)
        ranges = [joint_forces(self.m, joint)] if find_joint_actuators(self.m, joint).any() else []
        for tendon in self.lone.get(place, []):
            ranges.append(_scale(tendon.forces(self.m), float(tendon.ratios(self.tree)[0][place])))
        return (sum(lower for lower, _ in ranges), sum(upper for _, upper in ranges)) if len(ranges) > 0 else None

    def joint(self, place: int) -> int:
        """Return the joint of the model that leads a coordinate."""
        return self.m.joints.index(self.tree.coordinates[place])


def _with_resisting_tendons(m: ModelArrays, tree: Mechanism, tendons: Sequence[Tendon]) -> Mechanism:
    """Return the tree with rotors for tendons that have drive trains."""
    rotors = []
    used_names = {*tree.joints, *tree.coordinates, *tree.frame_names}
    for tendon in tendons:
        ratios, offset = tendon.ratios(tree)
        if ratios.any() and len(tendon.drive) > 0:
            rotors.append(CoupledRotor(make_distinct(tendon.name, used_names), ratios, offset, tendon.drive))
    if len(rotors) == 0:
        return tree
    try:
        positions.check_single_screws(tree, "tendons")
    except JounceError as error:
        warn(f"{m.place}: the drive trains of its tendons are left out: {error}")
        return tree
    return with_rotors(tree, rotors)


def _with_motor_ranges(drives: TendonDrives) -> Mechanism:
    """Return the tree with effort limits where tendons pull."""
    m, tree = drives.m, drives.tree
    shared = {int(place) for _, places in drives.coupled for place in places}
    changes: dict[int, Mapping[str, StatedLimit]] = {}
    for place in sorted(shared | drives.lone.keys()):
        # Motors that others share do not bound the force of the coordinate; its own clamp does.
        own = UNLIMITED if place in shared else drives.own_forces(place)
        assert own is not None, place
        lower, upper = clamped_forces(m, drives.joint(place), own)
        changes[leading_joints(tree)[place]] = {"effort": upper if lower == -upper else (lower, upper)}
    return replace(tree, limits=change_limits(tree, changes, {}))


def prepare_tendons(m: ModelArrays, tree: Mechanism) -> TendonDrives:
    """Return the tendons of a model on its tree.

    Those that resist are rotors, and those that move one coordinate are motors of it.
    """
    tendons = _read_tendons(m)
    drives = TendonDrives(m, _with_resisting_tendons(m, tree, tendons), tendons)
    return replace(drives, tree=_with_motor_ranges(drives))


def drive_by_tendons(drives: TendonDrives, closed: Mechanism) -> Mechanism:
    """Return the robot with the motors of tendons that move several coordinates.

    `closed` is the tree with its loops closed and its joints following by polynomials; with either, no motors of
    several joints are served. Motors that do not determine how their coordinates move are left out, with a warning.
    """
    served: list[CoupledRotor] = []
    moved: list[int] = []
    loose: list[str] = []
    # Tendons that share coordinates determine how these move together, or not at all.
    for tendons in _connected(drives.coupled):
        places = sorted({int(place) for _, touched in tendons for place in touched})
        rotors = _motors_of(drives, [tendon for tendon, _ in tendons], places)
        rank = np.linalg.matrix_rank(np.stack([rotor.ratios[places] for rotor in rotors]))
        if rank < len(places):
            moved_together = join_names(drives.tree.coordinates[place] for place in places)
            loose.append(f"{join_names(tendon.name for tendon, _ in tendons)} on {moved_together}")
            continue
        served += rotors
        moved += places
    # What is left out is said; the others drive the robot, if it has neither loops nor followers by polynomials.
    place = drives.m.place
    if len(loose) > 0:
        cure = Remedy("; robot.with_transmission() states motors that do not")
        came = f"motors on tendons are left out, as they leave their joints free to move: {'; '.join(loose)}"
        warn(f"{place}: {came}{cure}")
    if len(served) == 0:
        return closed
    if closed.is_closed or len(closed.loops) > 0:
        has = "loops" if len(closed.loops) > 0 else "joints that follow by polynomials"
        cure = Remedy("; state motors at joints by robot.closed(actuated=[...])")
        names = join_names(rotor.name for rotor in served)
        warn(f"{place}: motors on tendons are left out, as the robot has {has}: {names}{cure}")
        return closed
    try:
        return drive_by_rotors(closed, served, [closed.coordinates[k] for k in moved])
    except JounceError as error:
        warn(f"{place}: motors on tendons are left out: {error}")
        return closed


def _connected(coupled: Sequence[tuple[Tendon, np.ndarray]]) -> list[list[tuple[Tendon, np.ndarray]]]:
    """Return the tendons in groups that have no coordinate in common."""
    groups: list[list[tuple[Tendon, np.ndarray]]] = []
    for tendon, places in coupled:
        touching = [group for group in groups if any({*places} & {*others} for _, others in group)]
        groups = [group for group in groups if group not in touching]
        groups.append([*(member for group in touching for member in group), (tendon, places)])
    return groups


def _motors_of(drives: TendonDrives, tendons: Sequence[Tendon], places: Sequence[int]) -> list[CoupledRotor]:
    """Return the motors of coordinates that tendons move together: those of tendons, and their own."""
    m, tree = drives.m, drives.tree
    used_names = {*tree.joints, *tree.coordinates, *(name.removesuffix("_rotor") for name in tree.frame_names)}
    rotors = []
    for tendon in tendons:
        ratios, offset = tendon.ratios(tree)
        pulling = np.flatnonzero(tendon.actuators)
        # One actuator is a motor, which turns by its gear times L. Several together turn by L.
        alone = len(pulling) == 1 and m["actuator_gear"][pulling[0], 0] != 0
        gear = float(m["actuator_gear"][pulling[0], 0]) if alone else 1.0
        name = make_distinct(m.actuators[pulling[0]] if alone else tendon.name, used_names)
        limits = _motor_limits(m, tendon, gear)
        rotors.append(CoupledRotor(name, gear * ratios, gear * offset, limits=limits))
    for place in places:
        own = drives.own_forces(place)
        if own is not None:
            limits = {"effort": own} if np.isfinite(own).any() else {}
            name = make_distinct(f"{tree.coordinates[place]}_motor", used_names)
            rotors.append(CoupledRotor(name, np.eye(tree.n)[place], 0.0, limits=limits))
    return rotors


def _motor_limits(m: ModelArrays, tendon: Tendon, gear: float) -> dict[str, StatedLimit]:
    """Return the limits of a motor on a tendon.

    It turns by the gear times the length of the tendon.
    """
    limits: dict[str, StatedLimit] = {}
    if m["tendon_limited"][tendon.index]:
        limits["lower"], limits["upper"] = _scale(m["tendon_range"][tendon.index], gear)
    lower, upper = _scale(tendon.forces(m), 1 / gear)
    if np.isfinite([lower, upper]).any():
        limits["effort"] = upper if lower == -upper else (lower, upper)
    return limits
