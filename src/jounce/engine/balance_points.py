"""Compute points by which balance is planned.

They are the zero-moment point, centres of pressure, and the divergent component of motion.

They are quotients of quantities with rates, so that their rates follow by the series of the division.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from jounce.core.errors import JounceError, quote_value
from jounce.core.scalars import concatenate, is_finite, is_numeric
from jounce.dynamics.quantities import QUANTITIES
from jounce.engine import generic_methods
from jounce.engine.engine import Engine
from jounce.engine.motion_states import MotionStates
from jounce.engine.plan import compute
from jounce.motion.motion import Motion
from jounce.spatial.lie import rotation
from jounce.spatial.linear import solve_series
from jounce.spatial.series import Series

SOLE_EDGE, FORCE_ENDS = slice(0, 5), slice(6, 8)  # of the points of a contact in `contact_lines`
_SQUARE = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1), (1, 1)])
MIN_PRESSURE = 1e-6  # of the weight, or of the largest force of a contact: what carries less is in flight


def zmp(robot: Engine, rates: Sequence[Any], base: Any, wrench: Any, height: Any) -> Any:
    """Compute p of F = (n; f), the wrench of the ground: ``n - p x f`` is vertical."""
    g, z = _gravity(robot), _number("height", height)
    F = generic_methods.as_tuple(compute(robot, "base_wrench", rates, base=base, wrench=wrench))
    weight = g * robot.mechanism.M[:, 3, 3].sum()
    # The point is a quotient by the vertical force, which must not vanish. Symbols are taken to be on the ground.
    lowest = F[0][..., 5].min(initial=np.inf) if is_numeric(F[0]) else np.inf
    if lowest < MIN_PRESSURE * weight:
        raise JounceError(
            f"{robot.name!r} has no zero-moment point in flight, where the ground carries {lowest:.3g} of"
            f" {weight:.4g} N"
        )
    return _divide([_moments(x, z) for x in F], [x[..., 5:] for x in F])


def _moments(F: Any, z: Any) -> Any:
    """Return the zero-moment point times f_z, at height z.

    Its x and y are (z f_x - n_y, z f_y + n_x).
    """
    return concatenate([z * F[..., 3:4] - F[..., 1:2], F[..., :1] + z * F[..., 4:5]], axis=-1)


def center_of_pressure(robot: Engine, rates: Sequence[Any], base: Any, wrench: Any) -> Any:
    """Compute (-my, mx) / fz of each contact, in its axes.

    It is NaN where the contact carries nothing.
    """
    return _pressures(generic_methods.as_tuple(compute(robot, "contact_wrenches", rates, base=base, wrench=wrench)))


def _pressures(F: tuple[Any, ...]) -> Any:
    """Return the centres of pressure of contact wrenches, with rates."""
    # What carries little, compared with the largest force of all contacts, has no centre.
    if is_numeric(F[0]):
        size = np.abs(F[0][..., 3:]).max(axis=(-1, -2), keepdims=True)
        F = tuple(np.where(F[0][..., 5:] > MIN_PRESSURE * size, x, np.nan) for x in F)
    return _divide([concatenate([-x[..., 1:2], x[..., :1]], axis=-1) for x in F], [x[..., 5:] for x in F])


def dcm(robot: Engine, rates: Sequence[Any], base: Any, height: Any) -> Any:
    """Compute ``c + cd / w`` with ``w = sqrt(g / height)``."""
    z = _number("height", height)
    if z <= 0:
        raise JounceError(f"height is {quote_value(height)}; expected that of the centre of mass, above 0 m")
    c = generic_methods.as_tuple(compute(robot, "center_of_mass", rates, base=base))
    time = float(np.sqrt(z / _gravity(robot)))
    return generic_methods.write_results(tuple(x + time * xd for x, xd in pairwise(c)), None)


def contact_lines(robot: Engine, states: MotionStates) -> np.ndarray:
    """Return points (..., contacts, 9, 3) of lines that show contacts.

    They are the edge of the sole (5), NaN, the force at its centre of pressure (2), 1 m for 1 N, and NaN.
    """
    m = robot.mechanism
    lines = np.zeros((*states.rates[0].shape[:-1], len(m.contacts), 9, 3))
    if len(m.contacts) == 0:
        return lines
    F, places = states.compute(robot, "contact_wrenches"), _contact_poses(robot, states)
    f, p = F[0][..., 3:], _pressures(F[:1])
    for k, contact in enumerate(m.contacts):
        # First in the axes of the contact, in a view of `lines`.
        points, H = lines[..., k, :, :], places[..., k, :, :]
        points[..., SOLE_EDGE, :2] = _SQUARE * (0 if contact.sole is None else contact.sole)
        points[..., FORCE_ENDS, :2] = p[..., k, None, :]
        points[..., 7, :] += f[..., k, :]
        # Then in those of the world. NaN interrupts the line.
        R = rotation(H) if contact.ground_axes is None else contact.ground_axes
        points[...] = points @ R.mT + H[..., None, :3, 3]
        points[..., [5, 8], :] = np.nan
    return lines


def contact_lines_along(robot: Engine, motion: Motion, t: np.ndarray) -> np.ndarray:
    """Return `contact_lines` at times (N,) of a motion.

    Its contacts may come and leave.
    """
    if len(robot.mechanism.contacts) == 0:
        return np.zeros((len(t), 0, 9, 3))
    return contact_lines(robot, MotionStates.sample(robot, motion, t, [(QUANTITIES["contact_wrenches"], 0)]))


def zmp_points(robot: Engine, states: MotionStates) -> np.ndarray:
    """Return zero-moment points (..., 3) at the mean height of contacts.

    They are NaN in flight.
    """
    m, points = robot.mechanism, np.full((*states.rates[0].shape[:-1], 3), np.nan)
    x, y, g = m.gravity
    # Without contacts, or without gravity along -z, there is no such point.
    if len(m.contacts) > 0 and is_finite(g) and x == y == 0 and g < 0:
        F, heights = states.compute(robot, "base_wrench")[0], _contact_poses(robot, states)[..., 2, 3]
        is_present = np.ones(heights.shape, dtype=bool)
        if len(states.presence) > 0:
            is_present = states.presence[0] > 0
        # States on the ground: a contact is there, and the ground carries a part of the weight.
        on_ground = is_present.any(axis=-1) & (F[..., 5] > MIN_PRESSURE * -g * m.M[:, 3, 3].sum())
        z = np.mean(heights[on_ground], axis=-1, where=is_present[on_ground], keepdims=True)
        points[on_ground] = np.concatenate([_moments(F[on_ground], z) / F[on_ground][..., 5:], z], axis=-1)
    return points


def zmp_along(robot: Engine, motion: Motion, t: np.ndarray) -> np.ndarray:
    """Return `zmp_points` (N, 3) at times (N,) of a motion.

    They are in m, in inertial axes.
    """
    return zmp_points(robot, MotionStates.sample(robot, motion, t, [(QUANTITIES["base_wrench"], 0)]))


def _contact_poses(robot: Engine, states: MotionStates) -> np.ndarray:
    """Return the poses (..., contacts, 4, 4) of contacts in the world."""
    base = None if states.base is None else states.base[:1]
    m, poses = robot.mechanism, compute(robot, "poses", states.rates[:1], base=base)
    links = [(m.frame(contact.frame), contact.place) for contact in m.contacts]
    return np.stack([poses[..., link.body, :, :] @ link.T @ place for link, place in links], axis=-3)


def _divide(numerators: Sequence[Any], divisors: Sequence[Any]) -> Any:
    """Return quotients with rates, of (..., k) and (..., 1)."""
    # As equations of one unknown each: (..., 1, 1) x = (..., 1, k).
    quotient = solve_series(
        Series.of([x[..., None] for x in divisors]), Series.of([x[..., None, :] for x in numerators])
    )
    return generic_methods.write_results(tuple(x[..., 0, :] for x in quotient.upto(len(divisors) - 1)), None)


def _gravity(robot: Engine) -> float:
    """Return the size of gravity, which has to be along -z."""
    x, y, z = robot.mechanism.gravity
    if not (is_finite(z) and x == y == 0 and z < 0):
        raise JounceError(f"gravity of {robot.name!r} is ({x}, {y}, {z}); points of balance take one along -z")
    return -float(z)


def _number(name: str, value: Any) -> float:
    """Return a number in m, checked."""
    if not is_finite(value):
        raise JounceError(f"{name} is {quote_value(value)}; expected a number in m")
    return float(value)
