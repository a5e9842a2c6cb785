"""What limits bound along a plan, on a dense grid of its pieces: the true extremes, and where lower rates jump.

Shares with jounce: the forces, of states one by one; the motion is evaluated by the pieces of its plan.
"""

from collections.abc import Sequence

import numpy as np

import jounce
from fuzz.plans import Plan
from jounce.model.limits import LIMIT_KINDS

KINDS = (*LIMIT_KINDS.motion, *LIMIT_KINDS.effort, "power")
GRID = np.sin(np.linspace(0, np.pi / 2, 193)) ** 2  # shares of a piece, both ends among them
ZOOM = np.linspace(-1, 1, 33)  # of the distance to the neighbours of the best one
ROUNDS = 4
NEAR = 1e-3  # of the largest value: peaks of pieces that are as close to the highest one are refined too
ROUNDING = 1e-13  # of positions
JUMP = 1e-11  # of the largest value: a smaller difference at an end of pieces is rounding
FORCE_ROUNDING = 1e-12  # of the largest force of all joints: what their sum leaves at a joint that feels none of it

Values = dict[str, np.ndarray]


def order_of(kinds: Sequence[str], known: int) -> int:
    """The highest rate of q that some kinds take."""
    takes = [LIMIT_KINDS.motion.index(k) if k in LIMIT_KINDS.motion else 2 + ORDER.get(k, 0) for k in kinds]
    return max(takes, default=0)


ORDER = {kind: k for k, kind in enumerate(LIMIT_KINDS.effort)}  # of efforts: which rate of Q


def kinds_known(plan: Plan) -> list[str]:
    """The kinds of limits that the rates of a plan suffice for."""
    return [kind for kind in KINDS if order_of([kind], 0) <= plan.known]


def values_at(
    robot: jounce.Robot, plan: Plan, kinds: Sequence[str], piece: np.ndarray, share: np.ndarray, speed: float = 1.0
) -> Values:
    """What limits of some kinds bound (N, n) at shares of pieces, of the plan at a factor of speed."""
    order = max(2, order_of(kinds, 0))
    rates = [rate * speed**k for k, rate in enumerate(plan.carry(piece, share, order))]
    found = {kind: rates[k] for k, kind in enumerate(LIMIT_KINDS.motion) if kind in kinds}
    efforts = [kind for kind in kinds if kind not in LIMIT_KINDS.motion]
    if not efforts:
        return found
    highest = max(ORDER.get(kind, 0) for kind in efforts)
    base = plan.motion.base(plan.motion.start, highest + 2)  # which rests
    Q = robot.inverse_dynamics(*rates[: highest + 3], base=base)
    Q = [np.asarray(x)[:, -robot.n :] for x in (Q if isinstance(Q, tuple) else (Q,))]
    without = [kind for kind in efforts if kind in robot.limits.without_gravity]
    if without:
        G = robot.gravity_forces(*rates[: highest + 1], base=base and base[: highest + 1])
        G = [np.asarray(x)[:, -robot.n :] for x in (G if isinstance(G, tuple) else (G,))]
    for kind in efforts:
        k = ORDER.get(kind, 0)
        found[kind] = rates[1] * Q[0] if kind == "power" else Q[k] - G[k] if kind in without else Q[k]
    return found


def grid_of(plan: Plan) -> tuple[np.ndarray, np.ndarray]:
    """The pieces and shares (N,) of a dense grid."""
    m = len(plan.x) - 1
    return np.repeat(np.arange(m), len(GRID)), np.tile(GRID, m)


def extremes(
    robot: jounce.Robot, plan: Plan, kinds: Sequence[str], speed: float = 1.0
) -> dict[tuple[str, int], np.ndarray]:
    """The largest values (n,) by kind and sign (1, -1: of the negative), refined between the points of the grid."""
    piece, share = grid_of(plan)
    values = values_at(robot, plan, kinds, piece, share, speed)
    best = {(kind, sign): (sign * values[kind]).max(axis=0) for kind in kinds for sign in (1, -1)}
    for kind in kinds:
        for sign in (1, -1):
            rows = sign * values[kind].reshape(len(plan.x) - 1, len(GRID), robot.n)
            close = rows.max(axis=1) >= best[kind, sign] - NEAR * np.abs(rows).max(axis=(0, 1))
            here, joint = np.nonzero(close)
            at = rows.argmax(axis=1)[here, joint]
            middle, reach = (
                GRID[at],
                np.maximum(*(np.abs(GRID[(at + k).clip(0, len(GRID) - 1)] - GRID[at]) for k in (-1, 1))),
            )
            for _ in range(ROUNDS):
                shares = (middle[:, None] + reach[:, None] * ZOOM).clip(0, 1)
                near = values_at(robot, plan, [kind], np.repeat(here, len(ZOOM)), shares.ravel(), speed)[kind]
                own = sign * near.reshape(len(here), len(ZOOM), -1)[np.arange(len(here)), :, joint]
                np.maximum.at(best[kind, sign], joint, own.max(axis=1))
                middle, reach = shares[np.arange(len(here)), own.argmax(axis=1)], reach / 8
    return best


def infinite(robot: jounce.Robot, plan: Plan, kinds: Sequence[str]) -> dict[tuple[str, int], np.ndarray]:
    """Which limits (n,) by kind and sign no motion through the jumps of a plan keeps, as lower rates jump.

    A jump is an impulse of the next rate, of its sign, and an impulse of either sign of those after it. Where a
    velocity jumps, every force is infinite.
    """
    found = {(kind, sign): np.zeros(robot.n, dtype=bool) for kind in kinds for sign in (1, -1)}
    m = len(plan.x) - 1
    left, right = np.arange(m - 1), np.arange(1, m)
    if not len(left):
        return found
    rows = LIMIT_KINDS.motion[: max([0, *(LIMIT_KINDS.motion.index(k) for k in kinds if k in LIMIT_KINDS.motion)]) + 1]
    efforts = LIMIT_KINDS.effort[: max([-1, *(ORDER.get(k, 0) for k in kinds if k not in LIMIT_KINDS.motion)]) + 1]
    asked = sorted({*rows, *efforts, *LIMIT_KINDS.motion[:3]})
    before = values_at(robot, plan, asked, left, np.ones(m - 1))
    after = values_at(robot, plan, asked, right, np.zeros(m - 1))
    total = robot.with_limits(
        of=dict.fromkeys(LIMIT_KINDS.effort, "Q")
    )  # efforts less gravity have the rounding of all of Q
    sizes = [values_at(one, plan, asked, *grid_of(plan)) for one in (robot, total)]
    scale = {kind: np.maximum(*(np.abs(values[kind]).max(axis=0) for values in sizes)) for kind in asked}
    jumps = {kind: after[kind] - before[kind] for kind in asked}
    for k, kind in enumerate(LIMIT_KINDS.motion):
        if kind in asked and k <= plan.smooth:
            jumps[kind][:] = 0
    span = np.minimum(np.diff(plan.x)[:-1], np.diff(plan.x)[1:])[:, None]
    for kind in efforts[: max(plan.smooth - 1, 0)]:
        jumps[kind][:] = 0
    for kind in asked:
        if kind in LIMIT_KINDS.motion:  # rounding of positions, in derivatives over short spans
            k = LIMIT_KINDS.motion.index(kind)
            jumps[kind][np.abs(jumps[kind]) < ROUNDING * scale["position"] / span**k] = 0
        floor = JUMP * scale[kind] + (kind in LIMIT_KINDS.effort) * FORCE_ROUNDING * scale[kind].max()
        jumps[kind] = np.where(np.abs(jumps[kind]) > floor, jumps[kind], 0)
    for ladder in (rows, efforts):
        for i, kind in enumerate(ladder):
            for other in ladder[i + 1 :]:
                for sign in (1, -1):
                    either = jumps[kind] != 0 if other != ladder[i + 1] else sign * jumps[kind] > 0
                    if (other, sign) in found:
                        found[other, sign] |= either.any(axis=0)
    if efforts and (jumps["velocity"].any() or jumps["position"].any()):
        for kind in kinds:
            if kind not in LIMIT_KINDS.motion:
                found[kind, 1][:] = found[kind, -1][:] = True
    return found
