"""The search of an excitation from the arguments of a caller, checked: ranges, weights and parameters."""

from dataclasses import replace

import numpy as np

from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, quote_value
from jounce.core.scalars import asarray, is_finite
from jounce.core.typing import ArrayLike, DriveTerm
from jounce.engine.engine import Engine
from jounce.identification.barrier_terms import build_barrier
from jounce.identification.excitation_search import ExcitationSearch, motion_reaches
from jounce.identification.harmonics import Harmonics
from jounce.identification.information_matrix import Information, build_information
from jounce.model.coordinates import coordinate_limits, coordinate_units
from jounce.model.limit_kinds import LIMIT_KINDS, MOTION_KINDS
from jounce.model.limits import Limits
from jounce.model.positions import check_single_screws

TYPICAL_ROWS_PER_COLUMN = 4  # of the regressor of random states, so that only dependent columns depend in these


def prepare_search(
    robot: Engine,
    series: Harmonics,
    terms: tuple[DriveTerm, ...],
    weights: ArrayLike | None,
    reach: object,
    margin: object,
    rng: np.random.Generator,
    load: int | None = None,
) -> tuple[ExcitationSearch, tuple[str, ...]]:
    """The search for the arguments of a caller, checked, and notes on what is assumed."""
    if robot.mechanism.floats:
        fixed = Remedy("load(..., base='fixed')", "--base fixed")
        cure = f"expected one at rest, {fixed}"
        raise JounceError(f"the base of {quote_value(robot.name)} floats; {cure}")
    left = float(margin) if is_finite(margin) else -1.0  # type: ignore[arg-type]
    if not 0 <= left < 1:
        raise JounceError(f"margin is {quote_value(margin)}; expected a share of the limits, 0 <= margin < 1")
    if robot.mechanism.closure:
        has = "loops that are closed" if robot.mechanism.loops else "motors that move joints together"
        raise JounceError(f"{quote_value(robot.name)} has {has}; expected a robot without: excite() is of its joints")
    check_single_screws(robot.mechanism, "excite()")
    limits, notes = _bounded_positions(robot, check_number("reach", reach, "rad"))
    kinds = [kind for kind in limits.kinds if not LIMIT_KINDS[kind].takes]
    _check_limits(robot, limits, kinds)
    room = build_barrier(robot, limits, kinds)
    reaches = motion_reaches(limits, series, room.order)
    if not reaches[1].any():
        raise JounceError(f"the limits of {quote_value(robot.name)} let no joint move; expected room for one at least")
    middle = limits.bounds("position").mean(axis=0)
    inverse, equal = _weights(robot, limits, weights)
    information = _information(robot, terms, inverse, middle, reaches, load, rng)
    return ExcitationSearch(series, information, room, middle, reaches, 1 - left), (*notes, *equal)


def _bounded_positions(robot: Engine, reach: float) -> tuple[Limits, list[str]]:
    """The limits of the coordinates with two bounds of every position, and notes on those that were added."""
    limits, units = coordinate_limits(robot.mechanism), coordinate_units(robot.mechanism)
    lower, upper = limits.bounds("position").copy()
    bare = ~(np.isfinite(lower) & np.isfinite(upper))
    for j in np.flatnonzero(bare):
        if units[j] == "m":
            cure = f"state one with {Remedy('robot.with_limits(lower=..., upper=...)', '--limits FILE')}"
            raise JounceError(f"prismatic joint {quote_value(robot.joint_names[j])} has no range; {cure}")
    first = np.where(np.isfinite(lower), lower, np.where(np.isfinite(upper), upper - 2 * reach, -reach))
    last = np.where(np.isfinite(upper), upper, first + 2 * reach)
    table = limits.table.copy()
    table[[*LIMIT_KINDS].index("position")] = first, last
    notes = [
        f"joint {quote_value(robot.joint_names[j])} states no range of positions; it is kept within"
        f" {first[j]:.6g} to {last[j]:.6g} rad"
        for j in np.flatnonzero(bare)
    ]
    return replace(limits, table=table), notes


def _check_limits(robot: Engine, limits: Limits, kinds: list[str]) -> None:
    """Raise `JounceError` where nothing limits how fast a robot moves, or a force has no room on one side."""
    if kinds == [MOTION_KINDS[0]]:
        came = "states no limit of a rate or a force, and an excitation would go as far as it can"
        cure = f"state some with {Remedy('robot.with_limits(velocity=..., effort=...)', '--limits FILE')}"
        raise JounceError(f"{quote_value(robot.name)} {came}; {cure}")
    for kind in kinds:
        zero = (limits.bounds(kind) == 0).any(axis=0)
        if kind not in MOTION_KINDS and zero.any():
            joint = quote_value(robot.joint_names[int(zero.argmax())])
            way = Remedy(f"robot.with_limits({kind}=...)", "--limits FILE")
            cure = f"expected room on both sides of 0: state another with {way}"
            raise JounceError(f"a limit of {kind} of joint {joint} is 0; {cure}")


def _weights(robot: Engine, limits: Limits, given: ArrayLike | None) -> tuple[np.ndarray, list[str]]:
    """The weights (n,) of the forces, and a note where efforts do not give them."""
    if given is None:
        effort = np.abs(limits.bounds("effort")).max(axis=0)
        if np.isfinite(effort).all():
            return 1 / effort**2, []
        return np.ones(robot.n), ["not every joint states an effort limit: forces have equal weights"]
    weights = np.asarray(asarray(given, "weights"))
    if weights.dtype.kind != "f" or weights.shape != (robot.n,):
        raise JounceError(f"weights have shape {weights.shape}; expected numbers ({robot.n},), one per coordinate")
    if not (np.isfinite(weights).all() and (weights >= 0).all() and weights.any()):
        worst = weights[~((weights >= 0) & np.isfinite(weights))]
        came = f"a weight is {worst[0]:g}" if worst.size else "all weights are 0"
        raise JounceError(f"{came}; expected inverse variances: 0, which leaves a force out, or more")
    return weights.astype(float), []


def _information(
    robot: Engine,
    terms: tuple[DriveTerm, ...],
    weights: np.ndarray,
    middle: np.ndarray,
    reaches: np.ndarray,
    load: int | None,
    rng: np.random.Generator,
) -> Information:
    """The information of motions that go as far as the limits let them, from random states."""
    columns = 10 * len(robot.body_names) + len(terms) * len(robot.mechanism.joints)
    count = TYPICAL_ROWS_PER_COLUMN * columns // robot.n + 1
    states = rng.uniform(-1, 1, (3, count, robot.n)) * reaches[:3, None]
    states[0] = middle + np.where(reaches[1] > 0, states[0], states[0, 0])  # a joint that stands still, anywhere
    found = build_information(robot, terms, weights, tuple(states), load)
    if not found.names:
        raise JounceError(f"no parameter of {quote_value(robot.name)} enters the forces of joints that move")
    return found


def check_number(name: str, given: object, unit: str) -> float:
    """A caller's positive number in a unit."""
    if not is_finite(given) or not given > 0:  # type: ignore[operator]
        raise JounceError(f"{name} is {quote_value(given)}; expected a number of {unit} > 0")
    return float(given)  # type: ignore[arg-type]


def check_whole_number(name: str, given: object, least: int, most: int | None = None) -> int:
    """A caller's whole number from the least to the most."""
    if isinstance(given, bool) or not isinstance(given, int | np.integer) or not least <= given <= (most or given):
        raise JounceError(f"{name} is {quote_value(given)}; expected {least}{f' to {most}' if most else ' or more'}")
    return int(given)
