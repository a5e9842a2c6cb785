"""Find how much of the limits of contacts a motion takes.

The wrenches are those that take least.

Problem: at each time min over f of rho = max a_i f / (b_i fz) subject to G f =
Q_0, for the limits C f <= 0 of the contacts as a_i f <= b_i fz. Some wrenches keep them where rho <= 1.

Algorithm: that of Dinkelbach for several ratios [1]. At a rho that suffices, the linear program max s subject to
a_i f - rho b_i fz <= -s d_i has s >= 0, and the largest ratio of its f is the next, smaller rho; with the b_i fz of the
last f as d_i it converges superlinearly. Where the best f is not unique rho may creep, and is bisected. Programs of
many times are one, with blocks. The first rho is that of the least-squares wrenches, or a large one: where that does
not suffice, rho is infinite, as the ground would have to pull.

Invariant: some wrenches take rho. It ends where none takes 1e-6 of it less, as a last program shows: rounding of forces
near 0 may end the descent before.

[1] J.-P. Crouzeix, J. A. Ferland, S. Schaible, An algorithm for generalized fractional programs, JOTA 47 (1985).
"""

import itertools
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from jounce.arguments import contacts
from jounce.core.errors import JounceError
from jounce.core.progress import stage
from jounce.core.scalars import Array
from jounce.dynamics.contacts import limit_rows
from jounce.dynamics.quantities import DEFAULT_QUANTITY
from jounce.engine import contact_limits
from jounce.engine.engine import with_mechanism
from jounce.engine.motion_states import MotionStates, are_present
from jounce.limits.limited_motion import LimitedMotion
from jounce.limits.ratios import LIMIT_TOLERANCE, find_runs
from jounce.limits.root_finding import find_maxima, find_roots
from jounce.model.mechanism import Mechanism
from jounce.motion import reliability
from jounce.motion.motion import Motion

_EVEN_TIMES, _SPACING = 201, 0.01  # at least, and s at most, in addition to the times of the motion: 25 Hz shows
_BREAK_SIDE_SHARE = 1e-9  # of the duration: how long before a break its left side is judged
_PEAKS, _FLATNESS = 2, 1e-6  # the highest peaks are placed between times; flatter ones, relative, rise no higher
_TIMES_PER_PROGRAM = 200  # linear programs in one: the time for each is least from a hundred on
_TOLERANCE = 1e-9  # of programs, where the largest component of Q_0 is 1: at 1e-10 the simplex method may fail
# Methods of HiGHS, with its presolve and without: the simplex method may fail on degenerate vertices, presolve where
# contacts have no friction.
_ATTEMPTS: tuple[tuple[Literal["highs-ds", "highs-ipm"], bool], ...] = (
    ("highs-ds", True), ("highs-ds", False), ("highs-ipm", True), ("highs-ipm", False),
)  # fmt: skip
_MIN_BOUND = 1e-8  # of d: where friction is 0, nothing but rounding is left
_PROMPT_STEPS = 12  # of Dinkelbach's method, which takes five to ten; then rho creeps, and is bisected
_MAX_RATIO = 1e3  # of rho: beyond, the ground would have to pull
MEASURED_CAUSE = "the deviations of contact forces along measured samples are not known"
RATIO_ACCURACY = 1e-6  # of rho, which is that much too large at most
MAX_POSSIBLE_RATIO = 1 + 2 * RATIO_ACCURACY


def judge_contacts(b: LimitedMotion) -> Iterator[tuple[Any, ...]]:
    """Yield the fields of a `CheckedLimit` of each contact with limits: its worst row.

    Peaks between the times of the motion count too. Deviations of rho are not known: of measured samples no row is
    kept, and towards their ends none is broken either.
    """
    motion, deviations = b.motion, b.motion.deviations(b.motion.times, 2)
    start, stop = b.whole if deviations is None else reliability.find_window(motion.times, deviations[2])
    # Times of the motion, even ones, and both sides of breaks.
    breaks = np.array([x.t - side * motion.duration for x in motion.breaks for side in (0, _BREAK_SIDE_SHARE)])
    count = max(_EVEN_TIMES, int((stop - start) / _SPACING) + 1)
    t = np.unique(np.clip([*motion.times, *breaks, *np.linspace(start, stop, count)], start, stop))
    # Evaluate some of them first: at the others programs are solved only where more might be taken.
    is_first = np.arange(len(t)) % max(1, len(t) // _EVEN_TIMES) == 0
    of_first = _find_ratios(b, t[is_first])
    least = float(of_first[0][np.isfinite(of_first[0])].max(initial=0.0))
    of_others = _find_ratios(b, t[~is_first], least)
    order = np.argsort([*t[is_first], *t[~is_first]])
    rho, a, bound = (np.concatenate(x)[order] for x in zip(of_first, of_others, strict=True))
    # Place the highest peaks between them, and add these times in their order.
    before, here, after = (rho[i : len(t) - 2 + i].clip(max=_MAX_RATIO) for i in range(3))
    peaks = np.flatnonzero((here >= before) & (here >= after) & (2 * here - before - after > _FLATNESS * here)) + 1
    peaks = peaks[np.argsort(rho[peaks])[-_PEAKS:]]

    def ratios_on_grids(t: np.ndarray) -> np.ndarray:
        return _find_ratios(b, t.ravel())[0].reshape(t.shape)

    peak_t = find_maxima(ratios_on_grids, t[peaks - 1], t[peaks + 1])
    order = np.argsort([*t, *peak_t], kind="stable")
    of_peaks = (peak_t, *_find_ratios(b, peak_t))
    t, rho, a, bound = (np.concatenate(x)[order] for x in zip((t, rho, a, bound), of_peaks, strict=True))
    # Place the ends of the spans in which no wrenches keep the limits: rho passes 1 between each end of a run and the
    # time next to it.
    runs = np.array(find_runs(rho > MAX_POSSIBLE_RATIO), dtype=int).reshape(-1, 2)
    sides = np.sort([t[runs], t[np.add(runs, (-1, 1)).clip(0, len(t) - 1)]], axis=0).reshape(2, -1)
    ends = find_roots(lambda t, _: _find_ratios(b, t)[0] - 1, *sides)
    spans = tuple(map(tuple, ends.reshape(-1, 2).tolist()))
    unknown, cause = ((), None) if deviations is None else ((b.whole,), MEASURED_CAUSE)
    # Ratios of the rows (N, r), in which those of a contact follow each other from `first` on.
    sizes, first = _scaled_limits(b.robot.mechanism)[2], 0
    ratio = np.where(np.isfinite(rho)[:, None], _ratios(a / sizes, bound / sizes), np.inf)
    for contact in (contact for contact in b.robot.mechanism.contacts if len(contact.limits) > 0):
        (names, rows), count = zip(*contact.named_limits, strict=True), len(contact.limits)
        # The worst time and row of this contact.
        i, k = divmod(int(ratio[:, first : first + count].argmax()), count)
        value, most, worst = (float(x[i, first + k]) for x in (a, bound, ratio))
        # A ratio that is above 1 by the accuracy of rho alone is 1.
        worst = min(worst, 1.0) if worst <= MAX_POSSIBLE_RATIO else worst
        unit, broken = "N m" if rows[k][:3].any() else "N", spans if worst > 1 else ()
        fields = contact.frame, names[k], None, unit, value, most, worst, most - value, float(t[i]), None, broken
        yield *fields, unknown, None, cause
        first += count


@np.errstate(all="ignore")
def _ratios(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return a / b (N, r) of limits that are forces.

    The ratio is 0 where a is rounding or negative.
    """
    return np.where(a > _TOLERANCE * np.abs(b).max(axis=1, keepdims=True), a / b, 0.0)


def _present(m: Mechanism, motion: Motion, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return which components and limits belong to contacts that are there.

    Components are (N, k), limits (N, r). Contacts come and go with the times t (N,) of a motion.
    """
    there = are_present(m, motion, t)
    components, limits = [len(x.held) for x in m.contacts], [len(x.limits) for x in m.contacts]
    return np.repeat(there, components, axis=1), np.repeat(there, limits, axis=1)


@stage("limits of contacts")
def _find_ratios(b: LimitedMotion, t: np.ndarray, least: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Find rho (N,) and its wrenches at times (N,).

    Returns rho with a f and b fz (N, r) of the wrenches that take it. Where least-squares wrenches take at most
    `least`, their ratio is returned, and no forces.
    """
    m = b.robot.mechanism
    free, (A, B, sizes) = with_mechanism(b.robot, replace(m, contacts=())), _scaled_limits(m)
    # Moments are divided by lengths, so that all components are forces.
    levers, on_base = contacts.moment_sizes(m), contacts.wrench_sizes(m)
    weights = np.sqrt(np.concatenate([x.weights[x.held] for x in m.contacts])) * levers
    ratios, f = np.full(len(t), _MAX_RATIO), np.zeros((len(t), A.shape[1]))
    for part in (slice(i, i + _TIMES_PER_PROGRAM) for i in range(0, len(t), _TIMES_PER_PROGRAM)):
        x = MotionStates.sample(free, b.motion, t[part], [(DEFAULT_QUANTITY, 0)])
        assert x.base is not None  # `check_motion` refuses others
        there, limited = _present(m, b.motion, t[part])
        # The balance G f = F of the contact wrenches f with the forces on the base of the robot without contacts.
        G, F = (
            contacts.balance_maps(m, x.rates[0], x.base[0]) * there[:, None],
            x.compute(free, DEFAULT_QUANTITY.name)[0][:, :6],
        )
        with contact_limits.unbalanced_at(t[part]):
            contact_limits.check_condition(m, G, t[part].shape)
        G, F = G * levers / on_base[:, None], F / on_base
        # Least-squares wrenches, weighted: where all contacts push they are a first guess.
        y = (np.linalg.pinv(G / weights) @ F[..., None])[..., 0] / weights
        pushes = ((y @ B.T > 0) | ~limited | ~B.any(axis=1)).all(axis=1)
        ratios[part] = np.where(pushes, _ratios(y @ A.T, y @ B.T).max(axis=1).clip(max=_MAX_RATIO), _MAX_RATIO)
        ratios[part][~there.any(axis=1)] = 0.0
        # Where they take more than `least`, programs find the wrenches that take least.
        more = np.flatnonzero(ratios[part] > least)
        if more.size > 0:
            first = ratios[part][more], np.where(pushes[more, None], y[more], 0)
            ratios[part][more], f[part][more] = _descend(
                m, (A, B), (G[more], F[more]), (there[more], limited[more]), first
            )
    return np.where(ratios < _MAX_RATIO, ratios, np.inf), f @ A.T * sizes, f @ B.T * sizes


def _scaled_limits(m: Mechanism) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the limits A f <= rho B f, scaled, with sizes.

    A and B are (r, k). The limits are divided by the sizes (r,), such that a push of 1 on each contact makes B f = 1.
    Components and limits that are moments are divided by lengths, so that N are not compared with N m.

    Components and limits that are moments are divided by lengths, so that N are not compared with N m.
    """
    C, normal = limit_rows(m.contacts) * contacts.moment_sizes(m), [i == 5 for x in m.contacts for i in x.held]
    # The normal force fz of each contact is what bounds the other components.
    A, B = np.where(normal, 0, C), np.where(normal, -C, 0)
    sizes = np.where(B.any(axis=1), B.sum(axis=1), np.abs(A).max(axis=1))
    sizes = np.where(sizes > 0, sizes, 1.0)[:, None]
    return A / sizes, B / sizes, sizes[:, 0]


def _descend(
    m: Mechanism,
    limits: tuple[Array, Array],
    balance: tuple[Array, Array],
    present: tuple[Array, Array],
    first: tuple[Array, Array],
) -> tuple[Array, Array]:
    """Descend to the least rho (N,) and its f (N, k).

    The descent begins at the `first` rho and f. The limits are A, B (r, k), the balance is G f = F (N, 6), and
    `present` are the components and limits of contacts that are there. The method of Dinkelbach takes one program for
    all times in each turn.
    """
    (A, B), (G, F), (there, limited), (rho, f) = limits, balance, present, map(np.copy, first)
    # In units of the largest force at each time, so that tolerances of programs are relative.
    size = np.abs(F).max(axis=1, keepdims=True)
    # d weighs the rows: the b_i fz of the last f, or of fz = 1 before the first f. `low` is the largest rho known
    # to have no room, `gains` whether rho fell in the last turn.
    d, low, gains = f / size @ B.T, np.zeros(len(F)), np.ones(len(F), dtype=bool)
    d[~d.any(axis=1)] = B.sum(axis=1)
    open_times = np.arange(len(F))
    for turn in itertools.count():
        if open_times.size == 0:
            break
        # Solve the programs of all open times at their rho, or a little below where it fell no more; where it creeps,
        # halfway to the largest rho that has no room.
        step = (np.where(gains, 0.0, RATIO_ACCURACY) * rho)[open_times]
        if turn >= _PROMPT_STEPS:
            step = ((rho - low) / 2).clip(RATIO_ACCURACY * rho)[open_times]
        tried_rho, weights = rho[open_times] - step, d[open_times].clip(_MIN_BOUND) * limited[open_times]
        rows = A - tried_rho[:, None, None] * B, weights
        y, s = _solve_programs(m, rows, (G[open_times], (F / size)[open_times]), there[open_times])
        # s >= 0 shows that some wrenches take the rho that was tried; theirs may be smaller still.
        has_room = s >= -_TOLERANCE
        ratio = np.minimum(_ratios(y @ A.T, y @ B.T).max(axis=1), rho[open_times])
        new_rho = np.where(has_room, np.minimum(tried_rho, ratio), rho[open_times])
        better = new_rho < (1 - LIMIT_TOLERANCE) * rho[open_times]
        # A time is done where there is no room by as little as the accuracy below its rho.
        done = ~has_room & (step <= RATIO_ACCURACY * rho[open_times])
        better_times = open_times[better]
        rho[better_times] = new_rho[better]
        f[better_times], d[better_times] = size[better_times] * y[better], y[better] @ B.T
        low[open_times] = np.where(has_room, low[open_times], tried_rho)
        gains[open_times] = better
        open_times = open_times[~done & (rho[open_times] > RATIO_ACCURACY)]
    return rho, f


def _solve_programs(
    m: Mechanism, limits: tuple[Array, Array], balance: tuple[Array, Array], there: Array
) -> tuple[Array, Array]:
    """Solve the programs of many times as one: the f (N, k) with the largest s (N,).

    They are subject to C f + s d <= 0 and G f = F, for `limits` C, d and a `balance` G, F. Components of contacts that
    are not `there` (N, k) are 0.
    """
    from scipy.optimize import linprog  # imported here to keep start-up fast

    # Variables are f and s of each time: (k + 1) of them.
    (C, d), (G, F), (times, count) = limits, balance, there.shape
    free_or_zero = np.where(there[..., None], (-np.inf, np.inf), 0.0)
    bounds: Any = np.concatenate([free_or_zero, np.tile((-np.inf, _MAX_RATIO), (times, 1, 1))], axis=1)
    rows, balance_rows = np.concatenate([C, d[..., None]], axis=2), np.pad(G, ((0, 0), (0, 0), (0, 1)))
    # Minimize the sum of -s; the programs do not share variables, so that each has its own largest s.
    inequalities = np.tile(np.append(np.zeros(count), -1.0), times), _block_diagonal(rows), np.zeros(d.size)
    equalities = _block_diagonal(balance_rows), F.ravel(), bounds.reshape(-1, 2)
    # The next method is tried where one fails.
    for method, presolve in _ATTEMPTS:
        options: Any = {
            "primal_feasibility_tolerance": _TOLERANCE,
            "dual_feasibility_tolerance": _TOLERANCE,
            "presolve": presolve,
        }
        result: Any = linprog(*inequalities, *equalities, method, options=options)
        if result.status == 0:
            y, s = np.split(result.x.reshape(times, -1), [count], axis=1)
            return y, s[:, 0]
    raise JounceError(f"limits of the contacts of {m.name!r} are not decided: {result.message}")


def _block_diagonal(blocks: np.ndarray) -> Any:
    """Return the sparse matrix of blocks (N, r, k) on its diagonal."""
    from scipy.sparse import bsr_array  # imported here to keep start-up fast

    count, rows, columns = blocks.shape
    places = np.arange(count + 1)
    return bsr_array((blocks, places[:-1], places), shape=(count * rows, count * columns)).tocsc()
