"""Compute poses and twists of bases and joints from their curves.

The joints have several numbers: balls, planar and free joints.
The numbers of a base are its position and a quaternion, those of joints are named in `jounce.spatial.groups`. The
quaternion may have any length but zero: any smooth curve in four dimensions that avoids zero is a smooth motion, and
its rates give those of the twist exactly, ``nu = N^+(p) p'``. With Q = (w; v), the angular velocity in the axes that
move is ``2 E(Q) Qd / |Q|^2``, ``E = [-v, w 1 - hat(v)]``; so it is with cosine and sine in a plane.
"""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from jounce.core.errors import JounceError
from jounce.model.positions import Position
from jounce.motion.curves import Curve
from jounce.spatial import groups
from jounce.spatial.groups import Group
from jounce.spatial.lie import hat
from jounce.spatial.linear import solve_series
from jounce.spatial.series import RATE_SUFFIX, column_series, from_rate, join_series

POSE_COLUMNS = ("x", "y", "z", "qw", "qx", "qy", "qz")  # of a base, in files
BASE_COLUMNS = tuple(f"base.{column}" for column in POSE_COLUMNS)
UNIT_NORM_TOLERANCE = 1e-3  # rounding to three digits leaves no norm of a quaternion further from 1
MIN_QUATERNION_NORM = 0.1  # nearer to zero the curve of a quaternion has no direction
FREE_JOINT_PLACES = [0, 1, 2, 4, 5, 6, 3]  # of the numbers of a free joint, whose qw is last, among those of a base

BaseTerms = tuple[np.ndarray, ...]  # C, V, Vd, ...


def evaluate_base(curve: Curve, t: np.ndarray, order: int, left: bool = False) -> BaseTerms:
    """Return C, V, Vd, ... of a base at times (N,).

    The curve has seven columns, and as many rates as there are terms.
    """
    rates = curve.rates(t, order, left)
    check_norms(rates[0][:, 3:], t, "the quaternion of the base")
    return compute_base_motion(rates)


def perturb_rates(
    curve: Curve, t: np.ndarray, order: int, meaning: Callable[[Sequence[np.ndarray]], BaseTerms]
) -> Iterator[BaseTerms]:
    """Yield the meaning of rates, each entry off by its deviation.

    One entry is off after the other. An exact curve yields nothing.
    """
    rates = curve.rates(t, order)
    for k, off in enumerate(curve.deviations(t, order) or ()):
        for j in np.flatnonzero(off.any(axis=0)).tolist():
            yield meaning((*rates[:k], rates[k] + off * (np.arange(curve.columns) == j), *rates[k + 1 :]))


def check_norms(Q: np.ndarray, t: np.ndarray, what: str) -> None:
    """Raise `JounceError` where quaternions are near zero, without direction.

    They are (N, 4), or cosines and sines (N, 2).
    """
    norms = np.linalg.norm(Q, axis=1)
    near = np.flatnonzero(~(norms > MIN_QUATERNION_NORM))
    if near.size:
        i = int(near[0])
        expected = "one that stays away from zero: terms with an offset, or samples less than half a turn apart"
        raise JounceError(f"{what} has the norm {norms[i]:.2g} at t = {t[i]:g} s; expected {expected}")


def compute_base_motion(rates: Sequence[np.ndarray]) -> BaseTerms:
    """Return C, V, Vd, ... from position and quaternion and their rates.

    These are (N, 7) each; there are as many terms as rates.
    """
    numbers = [rate[:, FREE_JOINT_PLACES] for rate in rates]
    return (groups.FREE.pose(numbers[0]), *compute_twists(groups.FREE, numbers))


def compute_twists(group: Group, rates: Sequence[np.ndarray]) -> BaseTerms:
    """Return nu, nu', ... (N, k) from numbers p and their rates.

    There is one term less than rates. The kind of the joint is `group`.
    """
    count, p = len(group.places), column_series(rates)
    r, Q = p.map(lambda p: p[:, :count]), p.map(lambda p: p[:, count:])
    T = Q.map(lambda Q: group.turning(Q[..., 0]))
    # T^T T = |Q|^2 / 4 of quaternions, and |Q|^2 e e^T in a plane: the angular velocity is 4 T^T Qd / |Q|^2, or without
    # the 4, of which all rates follow as a series.
    squares = 4 if rates[0].shape[1] == count + 4 else 1
    w = solve_series(Q.mT @ Q, (T.mT @ Q.dot * squares).mT).mT
    # The rotation to the body's axes, R^T, has the rate -hat(w) R^T.
    to_body = from_rate(group.turn(rates[0][:, count:]).mT, lambda RT: -(w.map(lambda w: hat(w[..., 0])) @ RT))
    V = join_series([w, to_body.map(lambda RT: RT[..., :count]) @ r.dot], axis=-2)
    return tuple(V[k][:, list(group.axes), 0] for k in range(len(rates) - 1))


def compute_numbers(group: Group, p: np.ndarray, nu: Sequence[np.ndarray]) -> BaseTerms:
    """Return p', p'', ... (N, numbers) of a joint from its velocities.

    The joint is of a kind `group`, at its numbers p, with velocities nu, nu', ... (N, k).
    """
    count = len(group.places)
    # Twists (6,), by the motion subspace X; then the rotation by R' = R hat(w), and the quaternion by Q' = T(Q) w.
    V = group.X @ column_series(nu)
    R = from_rate(group.turn(p[:, count:]), lambda R: R @ V.map(lambda V: hat(V[:, :3, 0])))
    Q = from_rate(p[:, count:, None], lambda Q: Q.map(lambda Q: group.turning(Q[..., 0])) @ V.map(lambda V: V[:, :3]))
    rates = join_series([(R @ V.map(lambda V: V[:, 3:])).map(lambda r: r[:, :count]), Q.dot], axis=-2)
    return tuple(rates[k][..., 0] for k in range(len(nu)))


def with_blocks(row: Any, places: Sequence[slice], blocks: Sequence[Any]) -> list[Any]:
    """Return the parts of a row, with blocks in place of some.

    A row is names, or the columns of an array as its rows.
    """
    parts, start = list[Any](), 0
    for place, block in zip(places, blocks, strict=True):
        parts += [row[start : place.start], block]
        start = place.stop
    return [*parts, row[start:]]


def compute_states(joints: Sequence[Position], rates: Sequence[np.ndarray]) -> BaseTerms:
    """Return q, nu, nu', ... from numbers (N, nq) and their rates.

    Velocities (N, n) of joints of several numbers are twists.
    """
    if len(joints) == 0:
        return tuple(rates)
    nu = [compute_twists(joint.group, [rate[:, joint.numbers] for rate in rates]) for joint in joints]
    places = [joint.numbers for joint in joints]
    parts = (with_blocks(rate.T, places, [x[k].T for x in nu]) for k, rate in enumerate(rates[1:]))
    return (rates[0], *(np.concatenate(part).T for part in parts))


def align_quaternions(
    columns: Mapping[str, np.ndarray], names: Sequence[str], sampled: bool, unit: bool = False
) -> tuple[dict[str, np.ndarray], list[str]]:
    """Return columns with the quaternions of rows made neighbours, and notes.

    So are cosine and sine, and the rates of either. Samples get the length 1, and have it to three digits if
    `unit` says so. Cosine and sine have no free sign.
    """
    Q, what = np.stack([columns[name] for name in names], axis=1), ", ".join(names)
    norms = np.linalg.norm(Q, axis=1)
    is_valid = np.abs(norms - 1) <= UNIT_NORM_TOLERANCE if unit else norms > MIN_QUATERNION_NORM
    if not is_valid.all():
        i = int(is_valid.argmin())
        raise JounceError(f"row {i}: {what} have the norm {norms[i]:.6g}; expected 1, as every rotation has")
    signs, notes = neighbouring_signs(Q) if len(names) == 4 else np.ones(len(Q)), list[str]()
    if (signs < 0).any():
        notes.append(f"{what}: the sign flips from row to row, and is made that of the row before")
    if sampled and (np.abs(norms - 1) > UNIT_NORM_TOLERANCE).any():
        notes.append(f"{what}: of norm {norms.min():.4g} to {norms.max():.4g}, made 1")
    # Samples have no rates, which other lengths would change: curves take any length, and samples are made alike.
    factors = signs / norms if sampled else signs
    rates = re.compile(rf"({'|'.join(map(re.escape, names))}){RATE_SUFFIX}")
    return {name: x * factors if rates.fullmatch(name) else x for name, x in columns.items()}, notes


def neighbouring_signs(Q: np.ndarray) -> np.ndarray:
    """Return the signs (N,) by which quaternions (N, 4) are neighbours.

    With its sign each is nearest to the one before: Q and -Q are one rotation.
    """
    turns = np.einsum("ij,ij->i", Q[1:], Q[:-1]) < 0
    return np.where(np.concatenate([[False], np.cumsum(turns) % 2 == 1]), -1.0, 1.0)
