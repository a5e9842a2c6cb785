"""Robots with limits at factors of the true extremes of a plan, and how exact the extremes are."""

from dataclasses import replace

import numpy as np

import jounce
from fuzz import dense, plans
from fuzz.trees import random_tree, robot_of_tree
from jounce.model.limits import LIMIT_KINDS
from support.robots import floating, random_rotation

TOLERANCE = 2e-6  # of the largest value of a kind: what polynomials between rows are trusted to, and rounding
FACTORS = (0.9, 0.999, 0.99999, 1.00001, 1.001, 1.1, 2.0)
WAYS = ("both", "both", "upper", "lower", "none")
LEAST = {kind: 1e-10 if kind in LIMIT_KINDS.motion else 1e-4 for kind in dense.KINDS}  # of a limit, in SI units
UNLIMITED = {"lower": -np.inf} | {
    key: np.inf for key in LIMIT_KINDS.bound_names if key != "lower" and key not in LIMIT_KINDS.motor
}
ROBOTS = {
    name: jounce.load(name, lock=lock).with_limits(**UNLIMITED)
    for name, lock in {"planar2r": None, "ur5": None, "panda": {"panda_finger_joint1": 0.0}}.items()
}


def arm_or_tree(rng, name):
    """A bundled arm, or of "tree" a tree of screws or an arm that floats."""
    if name != "tree":
        return ROBOTS[name]
    if rng.random() < 0.2:
        return jounce.Robot(floating(ROBOTS["planar2r"].mechanism, rng))
    tree = random_tree(rng, nb := int(rng.integers(1, 5)))
    return robot_of_tree(replace(tree, coupling=np.eye(nb), offset=np.zeros(nb)))  # each joint has limits of its own


def plan_for(rng, robot, kind):
    """A plan for a robot; of one that floats with its base held anywhere."""
    if not robot.mechanism.floats:
        return plans.random_plan(rng, robot, kind)
    plan, pose = plans.random_plan(rng, ROBOTS["planar2r"], kind), np.eye(4)
    pose[:3, :3], pose[:3, 3] = random_rotation(rng), rng.normal(size=3)
    return replace(plan, motion=plan.motion.with_base(None, pose))


def with_planted_limits(rng, robot, plan):
    """The robot with limits, their bounds (2, n) by kind, and the extremes and infinite values by kind and sign."""
    kinds = [str(kind) for kind in rng.permutation(dense.kinds_known(plan))[: int(rng.integers(1, 4))]]
    of = {kind: rng.choice(["Q", "Q - Qgrav"]) for kind in LIMIT_KINDS.effort}
    robot = robot.with_limits(effort=1, effort_rate=1, second_effort_rate=1, of=of)
    peaks, infinite = dense.extremes(robot, plan, kinds), dense.infinite(robot, plan, kinds)
    given = {kind: bounds_of(rng, kind, -peaks[kind, -1], peaks[kind, 1]) for kind in kinds}
    keys = {kind: bounds.T for kind, bounds in given.items() if kind != "position"}
    if "position" in given:
        keys["lower"], keys["upper"] = given["position"]
    return robot.with_limits(**UNLIMITED | keys, of=of), given, peaks, infinite


def bounds_of(rng, kind, low, high):
    """Bounds (2, n) by extremes (n,): of both signs alike, on one side or none; of positions about their middle."""
    bounds = np.tile([[-np.inf], [np.inf]], len(low))
    for j, (down, up) in enumerate(zip(low, high, strict=True)):
        factor, way, least = rng.choice(FACTORS), rng.choice(WAYS), LEAST[kind]
        if kind == "position":
            middle, half = (up + down) / 2, factor * ((up - down) / 2 or 1e-3)
            ends = middle - half, middle + half
        elif way == "both":
            most = factor * max(abs(down), abs(up), least)
            ends = -most, most
        else:
            ends = min(factor * down, -least), max(factor * up, least)
        bounds[:, j] = ends[0] if way in ("both", "lower") else -np.inf, ends[1] if way in ("both", "upper") else np.inf
    return bounds


def rounding(plan, kind):
    """What rounding does to a value, relative and absolute: stamps in short pieces, and positions in their rates."""
    shortest = max(np.diff(plan.x).min(), 1e-9)
    share = 20 * np.spacing(np.abs(plan.x).max()) / shortest
    k = LIMIT_KINDS.motion.index(kind) if kind in LIMIT_KINDS.motion else 0
    return TOLERANCE + share, 1e-12 * np.abs(plan.motion(plan.motion.times, 0)[0]).max() / shortest**k


def is_infinite(given, infinite):
    """Whether a limit is broken at every speed, as a lower rate jumps."""
    sides = ((infinite[kind, sign], bounds[int(sign > 0)]) for kind, bounds in given.items() for sign in (1, -1))
    return any((jump & np.isfinite(bound)).any() for jump, bound in sides)


def excess(robot, plan, given, speed, refined=False):
    """By how much a plan at a factor of speed is beyond its limits at most, as a share of the largest value.

    It is looked at on the dense grid, or refined between its points.
    """
    if refined:
        peaks = dense.extremes(robot, plan, list(given), speed)
    else:
        values = dense.values_at(robot, plan, list(given), *dense.grid_of(plan), speed)
        peaks = {(kind, sign): (sign * values[kind]).max(axis=0) for kind in given for sign in (1, -1)}
    worst = -np.inf
    for (kind, sign), peak in peaks.items():
        bound = given[kind][1] if sign > 0 else -given[kind][0]
        size = np.maximum(np.maximum(peaks[kind, 1], peaks[kind, -1]), LEAST[kind])
        worst = max(worst, float(np.where(np.isfinite(bound), (peak - bound) / size, -np.inf).max()))
    return worst
