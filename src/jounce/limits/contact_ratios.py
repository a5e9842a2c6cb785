"""How much of the limits of contacts a motion takes, with the wrenches that take least.

Problem: at each time min over f of rho = max a_i f / (b_i fz) subject to G f = Q_0, for the limits C f <= 0 of the
contacts as a_i f <= b_i fz. Some wrenches keep them where rho <= 1.

Algorithm: that of Dinkelbach for several ratios [1]. At a rho that suffices, the linear program max s subject to
a_i f - rho b_i fz <= -s d_i has s >= 0, and the largest ratio of its f is the next, smaller rho; with the b_i fz of the
last f as d_i it converges superlinearly. Programs of many times are one, with blocks. It ends where rho falls no more.
Where the first, large rho does not suffice, it is infinite: the ground would have to pull.

[1] J.-P. Crouzeix, J. A. Ferland, S. Schaible, An algorithm for generalized fractional programs, JOTA 47 (1985).
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from jounce.arguments.contacts import balance_maps
from jounce.core.errors import JounceError
from jounce.dynamics.contacts import limit_rows
from jounce.dynamics.quantities import DEFAULT_QUANTITY
from jounce.engine.contact_limits import UnbalancedError, check_condition
from jounce.engine.engine import with_mechanism
from jounce.engine.motion_states import MotionStates, are_present
from jounce.limits.limited_motion import LimitedMotion
from jounce.limits.ratios import LIMIT_TOLERANCE
from jounce.limits.root_finding import find_maxima, find_roots
from jounce.limits.worst_values import find_runs
from jounce.model.mechanism import Mechanism
from jounce.motion.motion import Motion
from jounce.motion.reliability import find_window

_EVEN_TIMES = 201  # in addition to those of the motion
_BREAK_SIDE_SHARE = 1e-9  # of the duration: how long before a break its left side is judged
_PEAKS, _FLATNESS = 2, 1e-6  # the highest peaks are placed between times; flatter ones, relative, rise no higher
_TIMES_PER_PROGRAM = 200  # linear programs in one: the time for each is least from a hundred on
_TOLERANCE = 1e-10  # of programs, where the largest component of Q_0 is 1: the least that HiGHS takes
_MIN_BOUND = 1e-8  # of d: where friction is 0, nothing but rounding is left
_MAX_RATIO = 1e3  # of rho, which falls from it; motions take eight to fifteen programs


def judge_contacts(b: LimitedMotion) -> Iterator[tuple[Any, ...]]:
    """The fields of a `CheckedLimit` of each contact with limits: its worst row, between the times of the motion too.

    Where accelerations of measured samples are uncertain, towards their ends, nothing is decided.
    """
    motion, spread = b.motion, b.motion.deviations(b.motion.times, 2)
    start, stop = find_window(motion.times, spread[2]) if spread else b.whole
    # Evaluate at the times of the motion and more, both sides of breaks, then where rho peaks between them.
    breaks = np.array([x.t - side * motion.duration for x in motion.breaks for side in (0, _BREAK_SIDE_SHARE)])
    t = np.unique(np.clip([*motion.times, *breaks, *np.linspace(start, stop, _EVEN_TIMES)], start, stop))
    known = (rho, *_) = _find_ratios(b, t)
    before, here, after = (rho[i : len(t) - 2 + i].clip(max=_MAX_RATIO) for i in range(3))
    peaks = np.flatnonzero((here >= before) & (here >= after) & (2 * here - before - after > _FLATNESS * here)) + 1
    peaks = peaks[np.argsort(rho[peaks])[-_PEAKS:]]
    at = find_maxima(lambda t: _find_ratios(b, t.ravel())[0].reshape(t.shape), t[peaks - 1], t[peaks + 1])
    order = np.argsort([*t, *at], kind="stable")
    t, rho, a, bound = (np.concatenate(x)[order] for x in zip((t, *known), (at, *_find_ratios(b, at)), strict=True))
    # Place the ends of the spans in which no wrenches keep the limits.
    runs = np.array(find_runs(rho > 1 + LIMIT_TOLERANCE), dtype=int).reshape(-1, 2)
    sides = np.sort([t[runs], t[np.add(runs, (-1, 1)).clip(0, len(t) - 1)]], axis=0).reshape(2, -1)
    spans = tuple(map(tuple, find_roots(lambda t, _: _find_ratios(b, t)[0] - 1, *sides).reshape(-1, 2).tolist()))
    unknown = tuple(span for span in ((motion.start, start), (stop, motion.stop)) if span[0] < span[1])
    ratio, first = np.where(np.isfinite(rho)[:, None], _ratios(a, bound), np.inf), 0
    for contact in (contact for contact in b.robot.mechanism.contacts if len(contact.limits)):
        (names, rows), count = zip(*contact.named_limits, strict=True), len(contact.limits)
        i, k = divmod(int(ratio[:, first : first + count].argmax()), count)
        value, most, worst = (float(x[i, first + k]) for x in (a, bound, ratio))
        unit, broken = "N m" if rows[k][:3].any() else "N", spans if worst > 1 + LIMIT_TOLERANCE else ()
        yield contact.frame, names[k], None, unit, value, most, worst, most - value, float(t[i]), None, broken, unknown
        first += count


@np.errstate(all="ignore")
def _ratios(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(N, r): a / b, 0 where a is rounding or negative."""
    return np.where(a > _TOLERANCE * np.abs(b).max(axis=1, keepdims=True), a / b, 0.0)


def _present(m: Mechanism, motion: Motion, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which components (N, k) and limits (N, r) are those of contacts that are there at times of a motion."""
    there = are_present(m, motion, t)
    components, limits = [len(x.held) for x in m.contacts], [len(x.limits) for x in m.contacts]
    return np.repeat(there, components, axis=1), np.repeat(there, limits, axis=1)


def _find_ratios(b: LimitedMotion, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """rho (N,), and a f and b fz (N, r) of the wrenches that take it, at times (N,)."""
    from scipy.optimize import linprog  # imported here to keep start-up fast
    from scipy.sparse import block_diag

    m, C = b.robot.mechanism, limit_rows(b.robot.mechanism.contacts)
    free, normal = with_mechanism(b.robot, replace(m, contacts=())), [i == 5 for x in m.contacts for i in x.held]
    A, B, count = np.where(normal, 0, C), np.where(normal, -C, 0), len(normal)
    exact: Any = {"primal_feasibility_tolerance": _TOLERANCE, "dual_feasibility_tolerance": _TOLERANCE}
    ratios, f = np.full(len(t), _MAX_RATIO), np.zeros((len(t), count))
    for part in (slice(i, i + _TIMES_PER_PROGRAM) for i in range(0, len(t), _TIMES_PER_PROGRAM)):
        x = MotionStates.sample(free, b.motion, t[part], [(DEFAULT_QUANTITY, 0)])
        assert x.base is not None  # `check_motion` refuses others
        there, limited = _present(m, b.motion, t[part])
        G, F = balance_maps(m, x.rates[0], x.base[0]) * there[:, None], x.compute(free, DEFAULT_QUANTITY.name)[0][:, :6]
        size, rho, d = np.abs(F).max(axis=1, keepdims=True), ratios[part], np.tile(B.sum(axis=1), (len(F), 1))
        try:
            check_condition(m, G, t[part].shape)
        except UnbalancedError as error:
            raise JounceError(f"{error.reason}, at t = {t[part][error.state]:.9g} s") from None
        cost, free_or_zero = np.append(np.zeros(count), -1.0), np.where(there[..., None], (-np.inf, np.inf), 0.0)
        bounds: Any = np.concatenate([free_or_zero, np.tile((-np.inf, _MAX_RATIO), (len(F), 1, 1))], axis=1)
        left, rho[~there.any(axis=1)] = np.flatnonzero(there.any(axis=1)), 0.0
        while left.size:
            room_for = d[left].clip(_MIN_BOUND) * limited[left]
            rows = np.concatenate([A - rho[left, None, None] * B, room_for[..., None]], axis=2)
            equal = block_diag([*np.pad(G[left], ((0, 0), (0, 0), (0, 1)))], format="csc")
            found: Any = linprog(
                np.tile(cost, len(left)), block_diag([*rows], format="csc"), np.zeros(d[left].size), equal,
                (F / size)[left].ravel(), bounds[left].reshape(-1, 2), options=exact,
            )  # fmt: skip
            if found.status:
                raise JounceError(f"limits of the contacts of {m.name!r} are not decided: {found.message}")
            y, s = np.split(found.x.reshape(len(left), -1), [count], axis=1)
            room, ratio = s[:, 0] >= -_TOLERANCE, _ratios(y @ A.T, y @ B.T).max(axis=1)
            better = room & (ratio < (1 - LIMIT_TOLERANCE) * rho[left])
            left, y = left[better], y[better]
            rho[left], f[part][left], d[left] = ratio[better], size[left] * y, y @ B.T
    return np.where(ratios < _MAX_RATIO, ratios, np.inf), f @ A.T, f @ B.T
