"""Equality constraints of MuJoCo's models: joints that follow others, and loops.

They are soft in MuJoCo, and hold exactly here. `find_followers` reads the first, which are mimics where they are linear
(`linear_mimics`) and dependent coordinates where they are polynomials (`follow_polynomials`). `find_ties` reads the
second, and `close_ties` closes them.
"""

from collections.abc import Container, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.polynomial import Polynomial

from jounce.arguments import loops as loop_arguments
from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, join_names, quote_value, warn
from jounce.io.models.mujoco_arrays import (
    ModelArrays,
    make_distinct,
    moves_along_one_screw,
)
from jounce.model import positions
from jounce.model.mechanism import Mechanism
from jounce.model.polynomials import PolynomialLaw, polynomial_laws, with_polynomials
from jounce.model.tree import ROOT, Mimic
from jounce.spatial import lie

JOINT_EQUALITY_TYPE = 2  # mujoco.mjtEq
CUT_JOINTS = {0: "spherical", 1: "fixed"}  # by mujoco.mjtEq: connect and weld
SITE_OBJECT_TYPE = 6  # mujoco.mjtObj


class LoopEnd(NamedTuple):
    """One end of a loop: the name of its frame, the body that carries it, and its pose there."""

    frame: str
    body: str
    T: np.ndarray


class LoopTie(NamedTuple):
    """Two ends that a constraint ties, and the joint between them."""

    a: LoopEnd
    b: LoopEnd
    joint: str


class Follower(NamedTuple):
    """A joint that follows another, by index: its variable is a polynomial of the other's."""

    joint: int
    leader: int
    law: Polynomial


def find_followers(m: ModelArrays) -> list[Follower]:
    """Return the joints that follow others.

    A constraint that would close a circle, or tie a joint a second time, is ignored.
    """
    leaders: dict[int, int] = {}
    followers: list[Follower] = []
    for k in active_constraints(m):
        i, leader = int(m["eq_obj1id"][k]), int(m["eq_obj2id"][k])
        if m["eq_type"][k] != JOINT_EQUALITY_TYPE or leader < 0 or i in leaders:
            continue
        are_single = moves_along_one_screw(m, i) and moves_along_one_screw(m, leader)
        if not are_single or _leads_to(leader, i, leaders):
            continue
        # MuJoCo counts from qpos0: q1 - q1_0 = a0 + a1 x + ... + a4 x^4 with x = q2 - q2_0.
        start, start_of_leader = (float(m["qpos0"][m["jnt_qposadr"][j]]) for j in (i, leader))
        coefficients = np.trim_zeros(np.array(m["eq_data"][k][:5], dtype=float), "b")
        leaders[i] = leader
        law = Polynomial(coefficients if len(coefficients) > 0 else np.zeros(1))
        followers.append(Follower(i, leader, start + law(Polynomial(np.array([-start_of_leader, 1.0])))))
    return followers


def linear_mimics(m: ModelArrays, followers: Sequence[Follower]) -> dict[int, Mimic]:
    """Return the laws of joints that follow at a constant ratio."""
    return {
        f.joint: Mimic(m.joints[f.leader], float(f.law.coef[1]) if f.law.degree() > 0 else 0.0, float(f.law.coef[0]))
        for f in followers
        if f.law.degree() <= 1
    }


def follow_polynomials(m: ModelArrays, mechanism: Mechanism, followers: Sequence[Follower]) -> Mechanism:
    """Return the mechanism with joints that follow at varying ratios."""
    laws: dict[str, PolynomialLaw] = {}
    for follower in followers:
        name, leader = m.joints[follower.joint], m.joints[follower.leader]
        if follower.law.degree() <= 1 or name not in mechanism.joints:
            continue
        if leader not in mechanism.joints:
            raise JounceError(f"{m.place}: joint {quote_value(name)} follows {quote_value(leader)}, excluded by {ROOT}")
        # The leader may follow at a constant ratio itself: theta = G q + g.
        row = mechanism.joints.index(leader)
        [places] = np.nonzero(mechanism.G[row])
        place = int(places[0]) if len(places) > 0 else 0
        law = follower.law(Polynomial([float(mechanism.g[row]), float(mechanism.G[row, place])]))
        laws[name] = PolynomialLaw(mechanism.coordinates[place], tuple(law.coef.tolist()))
    if len(laws) == 0:
        return mechanism
    try:
        return with_polynomials(mechanism, laws)
    except JounceError as error:
        warn(f"{m.place}: joints that follow by polynomials stay free: {error}")
        return mechanism


def active_constraints(m: ModelArrays) -> list[int]:
    """Return the active equality constraints."""
    if not m.acts("EQUALITY", "CONSTRAINT"):
        return []
    return [int(k) for k in np.flatnonzero(m["eq_active0"])]


def _leads_to(joint: int, end: int, leaders: dict[int, int]) -> bool:
    """Return whether a joint is another one, or follows it."""
    while joint != end and joint in leaders:
        joint = leaders[joint]
    return joint == end


def find_ties(m: ModelArrays, active: Sequence[int], used_names: set[str]) -> list[LoopTie]:
    """Return the loops among the active equality constraints.

    Their frames take names that are not used yet.
    """
    ties: list[LoopTie] = []
    for k in active:
        joint = CUT_JOINTS.get(int(m["eq_type"][k]))
        if joint is None:
            continue
        # The ends are two sites, or anchors on two bodies.
        places = [m[f"eq_obj{side}id"][k] for side in (1, 2)]
        if m["eq_objtype"][k] == SITE_OBJECT_TYPE:
            ends = [(m.bodies[m["site_bodyid"][i]], m.pose("site_pos", "site_quat", i)) for i in places]
        else:
            ends = list(zip([m.bodies[i] for i in places], _anchors(m, k, joint), strict=True))
        a, b = (LoopEnd(make_distinct(f"loop{len(ties)}:{body}", used_names), body, T) for body, T in ends)
        ties.append(LoopTie(a, b, joint))
    return ties


def _anchors(m: ModelArrays, k: int, joint: str) -> list[np.ndarray]:
    """Return the anchors of a constraint, as poses on two bodies.

    A weld has one anchor, on the second body, and the pose of this body in the first.
    """
    data = m["eq_data"][k]
    anchors = [lie.pose(np.eye(3), data[3 * i : 3 * i + 3, None]) for i in range(2)]
    if joint == "fixed":
        pose_first_from_second = lie.pose(lie.from_quaternion(data[6:10]), data[3:6, None])
        anchors = [pose_first_from_second @ anchors[0], anchors[0]]
    return anchors


def close_ties(m: ModelArrays, mechanism: Mechanism, ties: Sequence[LoopTie], motor_names: Container[str]) -> Mechanism:
    """Return the mechanism with its loops closed by the joints with motors.

    What these leave loose is moved by springs, or by nothing. The loops stay open if they cannot be closed.
    """
    # A tie between frames that `--root` has left out, or on one body, is no loop.
    loops = []
    for tie in ties:
        if {tie.a.frame, tie.b.frame} <= set(mechanism.frame_names):
            with suppress(JounceError):
                loops.append(loop_arguments.build_loop(mechanism, tie.a.frame, tie.b.frame, tie.joint))
    if len(loops) == 0:
        return mechanism
    if mechanism.is_closed:
        names = join_names(polynomial_laws(mechanism))
        warn(f"{m.place}: its loops are left out, since {names} follow by polynomials, with which no loop is closed")
        return mechanism
    mechanism = replace(mechanism, loops=tuple(loops))
    motors = [name for name in mechanism.coordinates if name in motor_names]
    try:
        positions.check_single_screws(mechanism, "closed loops")
        if mechanism.floats and any(-1 in (loop.a.body, loop.b.body) for loop in loops):
            raise JounceError("some hold the base to the ground, which makes its pose a coordinate")
        start: Mapping[str, float] = {
            name: float(m["qpos0"][m["jnt_qposadr"][m.joints.index(name)]]) for name in mechanism.coordinates
        }
        if len(motors) == 0:
            raise JounceError("no joint has an actuator")
        # What motors leave loose, as fingers on springs, is passive.
        return loop_arguments.with_loops(
            mechanism, loop_arguments.ClosureParameters(actuated=motors, start=start, finds_passive=True)
        )
    except JounceError as error:
        warn(f"{m.place}: its loops stay open{Remedy(', robot.closed(actuated=[...]) closes them')}: {error}")
        return mechanism
