"""`check` judges every limit along a motion, between samples too.

A motion is cut into pieces on which what limits bound are polynomials, and `Worst` gathers the worst values and the
times beyond bounds. Of commands, differences are judged in place of derivatives (`take_differences`), at the times of
the commands. Limits of contacts are judged first, by `judge_contacts`: where no wrenches keep them there are no forces,
and limits of q and its rates alone are judged. The table of a `Check` has a row for each limit, and its notes say what
could not be judged.

A row is undecided for one of these causes.

* Samples: their deviations reach the limit (`judge_samples`).
* Speed: a value changes too fast between samples to be followed (`Worst.unresolved`).
* Measured torques: a log whose encoder moves as the link does not, by play or give between rotor and link, holds
  accelerations that no link has. Torques computed from them are certain of the encoder, by its deviations, and wrong of
  the link; so are those of a robot whose data are wrong. A limit of effort that computed torques break for sure is
  undecided, if at all these times the measured torque keeps it by more than two deviations of its noise. One that comes
  nearer, or is missing, contradicts nothing: drives clip at their limits; nor do commands, or torques that were
  measured at another pace. Efforts alone are judged: differences of measured torques are noise. Where no torques are
  measured, notes say what else shows such encoders: they stand still where joints turn back, or torques confirmed less
  of the robot where it was identified.
* Doubts: the robot's data leave a limit open along every motion. Files of robots state no inertia where nobody measured
  one, and a limit of 0 where nobody knows it. Then a force of 0 or a ratio of 0 proves nothing. An inertia that no body
  can have is off by at least its distance to one that a body can have: rows that the nearest such inertias decide
  otherwise are undecided, for which all limits are checked twice. What is `Mechanism.meant` is no doubt.
"""

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from jounce.core import scalars
from jounce.core.cures import Remedy
from jounce.core.errors import join_names, quote_value
from jounce.core.progress import stage
from jounce.dynamics import mobility
from jounce.dynamics.quantities import QUANTITIES
from jounce.engine import along, contact_limits, contact_motion
from jounce.engine.along import ForceBreak
from jounce.engine.engine import Engine, with_mechanism
from jounce.engine.motion_states import MotionStates
from jounce.engine.plan import compute
from jounce.limits.commands import JudgedCommands, take_differences
from jounce.limits.contact_ratios import judge_contacts
from jounce.limits.joints import joint_units
from jounce.limits.limited_motion import LimitedMotion, compute_deviations, is_measured, validate_limits
from jounce.limits.motion_polynomials import split_motion
from jounce.limits.ratios import SIGNS
from jounce.limits.verdicts import Check, CheckedLimit, combine_verdicts, join_spans
from jounce.limits.worst_values import DECISIVE_DEVIATIONS, Spans, Worst, judge_samples, judge_values
from jounce.model import coordinates
from jounce.model.limits import LIMIT_KINDS
from jounce.model.mechanism import INERTIAS, MASSLESS_TIPS
from jounce.motion import noise, reliability, resmoothing
from jounce.motion.channel import Span
from jounce.motion.motion import Motion
from jounce.spatial import inertia
from jounce.spatial.series import rate_name

SAMPLES_CAUSE = "the limit lies within two standard deviations of the value, which follows from measured samples"
UNRESOLVED_CAUSE = "the value changes too fast between samples to be followed"


@stage("limits along the motion")
def check(robot: Engine, motion: object) -> Check:
    """Every limit of a robot along a motion, or at the commands of one."""
    b = validate_limits(robot, motion)
    found = _check_limits(b)
    consistent, bodies = with_consistent_inertias(b.robot)
    if not bodies or not (b.forces or contact_limits.are_limited(robot.mechanism)):
        return found
    # Rows that are decided otherwise with inertias that bodies can have are undecided.
    others = _check_limits(replace(b, robot=consistent)).table
    causes = {
        place: describe_wrong_inertias(bodies, other.verdict)
        for place, (row, other) in enumerate(zip(found.table, others, strict=True))
        if row.verdict != other.verdict
    }
    return _doubt_rows(b, found, causes)


def _check_limits(b: LimitedMotion) -> Check:
    """Every limit along a motion with the inertias of a robot, but for limits of 0 and joints that move no mass."""
    if commands := take_differences(b):
        return _check_commands(b, commands)
    contact_motion.refuse_hovering(b.robot, b.motion)
    contacts = (
        tuple(CheckedLimit(*row) for row in judge_contacts(b)) if contact_limits.are_limited(b.robot.mechanism) else ()
    )
    if combine_verdicts([row.verdict for row in contacts]) == "broken":  # there are no forces
        b = b.select_kinds([kind for kind in b.kinds if LIMIT_KINDS[kind].of == "q"])
    breaks = find_limited_breaks(b)
    b = replace(b, switches=tuple(found.t for found in breaks if not found.causes))
    worst, measured = Worst(b), bool(b.kinds) and is_measured(b.motion)
    take = worst.take_worst if measured else worst.take
    for pieces in split_motion(b):
        take(pieces)
    known = _copy_worst(worst)
    undecided = judge_samples(b, worst) if measured else {}
    causes = dict.fromkeys(undecided, SAMPLES_CAUSE)
    for of, spans in worst.unresolved.items():
        undecided[of] = undecided.get(of, []) + spans
        causes[of] = UNRESOLVED_CAUSE
    worst.take_jumps(breaks)
    notes = (*describe_omissions(b, breaks), *describe_unresolved(worst), *describe_lacks(b, b.motion))
    if measured and b.force_rates:
        notes += describe_play(b)
    for j, cause in (find_contradictions(b, worst) if measured else {}).items():
        undecided[EFFORT, j] = undecided.get((EFFORT, j), []) + worst.drop_spans(EFFORT, j)
        causes[EFFORT, j] = cause
        notes += (f"undecided: effort of {b.joints[j]}: {cause}",)
    table = (*_build_table(b, worst, undecided, known, causes), *contacts)
    found = Check(table, breaks, notes, _judged_shares(b, undecided), b.whole)
    return _doubt_rows(b, found, _place_doubts(b))


def _check_commands(b: LimitedMotion, commands: JudgedCommands) -> Check:
    """Every limit that differences of commands are compared with; those of measured motions have deviations."""
    of, t, undecided = commands.b, commands.q.times[1:], Spans()
    worst = Worst(of)
    if is_measured(b.motion):
        judge_values(of, worst, t, {kind: channel.values for kind, channel in commands.limited.items()}, undecided)
    else:
        for kind, channel in commands.limited.items():
            for sign in SIGNS:
                worst.take_values(kind, sign, t, sign * channel.values, of.scales[kind].beyond(channel.values, sign))
    table = _build_table(of, worst, undecided, _copy_worst(worst), dict.fromkeys(undecided, SAMPLES_CAUSE))
    notes = (*commands.notes, *describe_omissions(b, ()))
    found = Check(table, (), notes, _judged_shares(of, undecided), b.whole)
    return _doubt_rows(b, found, _place_doubts(of))


def _place_doubts(b: LimitedMotion) -> dict[int, str]:
    """The causes for which limits are undecided along every motion, by their places in the table."""
    doubts = find_doubts(b)
    return {i: doubts[of] for i, of in enumerate(_limited_columns(b)) if of in doubts}


def _doubt_rows(b: LimitedMotion, found: Check, causes: Mapping[int, str]) -> Check:
    """The check with some rows undecided all the time, each for a cause."""
    if not causes:
        return found
    rows = list(found.table)
    for i, cause in causes.items():
        rows[i] = replace(rows[i], violations=(), undecided=(b.whole,), cause=cause)
    of_cause: dict[str, list[str]] = {}
    for i, cause in causes.items():
        of_cause.setdefault(cause, []).append(f"{rows[i].limit.replace('_', ' ')} of {rows[i].joint}")
    notes = tuple(f"undecided: {join_names(names)}: {cause}" for cause, names in of_cause.items())
    decided = {row.limit for i, row in enumerate(rows) if i not in causes}
    judged = {kind: share * (kind in decided) for kind, share in found.judged.items()}
    return replace(found, table=tuple(rows), notes=(*found.notes, *notes), judged=judged)


def find_limited_breaks(b: LimitedMotion) -> tuple[ForceBreak, ...]:
    """Where the forces that are limited are not smooth."""
    return along.find_force_breaks(b.robot, b.motion, b.motion.times, b.force_order, row=b.efforts) if b.forces else ()


def _copy_worst(worst: Worst) -> dict[tuple[str, int], tuple[np.ndarray, np.ndarray]]:
    """The worst values and their times by kind and sign, as they are now."""
    return {side: (value.copy(), worst.t[side].copy()) for side, value in worst.value.items()}


def _limited_columns(b: LimitedMotion) -> list[tuple[str, int]]:
    """The kind and joint of each row of the table."""
    return [
        (kind, j) for j in range(len(b.joints)) for kind in b.kinds if np.isfinite(b.limits.bounds(kind)[:, j]).any()
    ]


def _build_table(
    b: LimitedMotion,
    worst: Worst,
    undecided: Spans,
    known: Mapping[tuple[str, int], tuple[np.ndarray, np.ndarray]],
    causes: Mapping[tuple[str, int], str] = MappingProxyType({}),
) -> tuple[CheckedLimit, ...]:
    """The rows of the table, with the worst values and times that are `known` within windows, by kind and sign."""
    ratios, units = worst.ratios, joint_units(b.robot.mechanism)
    limited = [(kind, max(SIGNS, key=lambda sign: ratios[kind, sign][j]), j) for kind, j in _limited_columns(b)]
    off = compute_deviations(b, np.array([worst.t[kind, sign][j] for kind, sign, j in limited]))
    rows = []
    for i, (kind, sign, j) in enumerate(limited):
        value, bound = (sign * float(x[j]) for x in (worst.value[kind, sign], b.scales[kind].bound(sign)))
        spread, reach = float(off[kind][i, j]) if kind in off else np.nan, float(abs(b.scales[kind].reach(sign)[j]))
        t, (start, stop) = float(worst.t[kind, sign][j]), b.window(kind)
        near = max(SIGNS, key=lambda s: b.scales[kind].ratio(s * known[kind, s][0], s)[j])
        certain = near * float(known[kind, near][0][j]), float(known[kind, near][1][j])
        rows.append(CheckedLimit(
            joint=b.name(kind, j),
            limit=kind,
            of=b.limits.of(kind) if kind in LIMIT_KINDS.effort else None,
            unit=LIMIT_KINDS[kind].unit(units[j]),
            value=value,
            bound=bound,
            ratio=float(ratios[kind, sign][j]),
            margin=sign * (bound - value),
            t=t,
            deviation=None if np.isnan(spread) or not reach else spread / reach,
            violations=join_spans(worst.broken_spans(kind, j)),
            undecided=join_spans(undecided.get((kind, j), [])),
            certain=None if start <= t <= stop or spread <= reliability.MAX_CERTAIN_SHARE * abs(value) else certain,
            cause=causes.get((kind, j)),
        ))  # fmt: skip
    return tuple(rows)


def _judged_shares(b: LimitedMotion, undecided: Spans) -> dict[str, float]:
    """The share of time in which each kind is decided for all joints, 0 for those that nothing is checked against."""
    shares = dict.fromkeys(b.limits.kinds, 0.0)
    for kind in b.kinds:
        spans = join_spans([span for (of, _), found in undecided.items() if of == kind for span in found])
        share = sum(stop - start for start, stop in spans) / b.motion.duration if b.motion.duration else bool(spans)
        shares[kind] = 1.0 - share
    return shares


# Measured torques: what they leave open of efforts that computed torques break.
EFFORT = "effort"
MIN_TORQUE_SAMPLES = 4 * noise.NOISE_DIFFERENCE_ORDER  # of which a noise is known
TORQUES = "forces from its accelerations may be those of no link, and measured torques decide"
MAX_BAND_SAMPLES = 20_000  # about the worst time, from which the band is found that torques confirm


def find_contradictions(b: LimitedMotion, worst: Worst) -> dict[int, str]:
    """By joint why a limit of effort that is broken by computed torques is undecided: measured ones keep it."""
    if b.motion.torques is None or EFFORT not in b.kinds or b.robot.mechanism.closure is not None:
        return {}
    if b.motion.commanded or not resmoothing.is_at_measured_pace(b.motion):
        return {}
    t, tau = b.motion.torques
    if EFFORT in b.limits.without_gravity:
        if b.motion.base_curve or b.robot.mechanism.floats:
            return {}
        tau = tau - compute(b.robot, "gravity_forces", b.motion(t, 0))
    found = {}
    for j in range(len(b.joints)):
        kept = _largest_kept(t, tau[:, j], worst.broken_spans(EFFORT, j), b.limits.bounds(EFFORT)[:, j])
        if kept is not None:
            found[j] = _describe_contradiction(b, worst, j, kept)
    return found


def describe_play(b: LimitedMotion) -> tuple[str, ...]:
    """What is said of a log without measured torques whose encoders may move as its links do not."""
    motion, confirmed = b.motion, b.robot.mechanism.confirmed_band
    chosen = resmoothing.chosen_bandwidth(motion)
    if chosen is None or not (motion.torques is None or motion.commanded):
        return ()
    notes = [
        f"the encoder of {quote_value(joint)} stands still at {of.long} of {of.count} reversals, for longer than the"
        f" joint can, usually {1e3 * of.usual:.2g} ms: by play, or since it sticks; {TORQUES}"
        for joint, of in resmoothing.find_play(motion, b.robot.joint_names).items()
    ]
    if confirmed is not None and confirmed < resmoothing.MAX_CONFIRMED_SHARE * chosen:
        cure = Remedy(f"load the motion with bandwidth={confirmed:.3g}", f"--bandwidth {confirmed:.3g}")
        notes.append(
            f"torques confirmed positions of this robot up to {confirmed:.3g} Hz when it was identified, and the log is"
            f" smoothed to {chosen:.3g} Hz: forces beyond may be those of no link; {cure}"
        )
    return tuple(notes)


def _largest_kept(t: np.ndarray, tau: np.ndarray, spans: list[Span], bounds: np.ndarray) -> float | None:
    """The largest torque measured in spans, if all in each are surely within the bounds; else None."""
    known = np.isfinite(tau)
    if not spans or np.count_nonzero(known) < MIN_TORQUE_SAMPLES:
        return None
    t, tau = t[known], tau[known]
    room = DECISIVE_DEVIATIONS * float(noise.estimate_local_noise(tau[:, None])[0])
    step, largest = float(np.median(np.diff(t))), 0.0
    for start, stop in spans:
        there = tau[(t >= start - step) & (t <= stop + step)]
        if not there.size or (there - room <= bounds[0]).any() or (there + room >= bounds[1]).any():
            return None
        largest = max(largest, there[np.abs(there).argmax()], key=abs)
    return float(largest)


def _describe_contradiction(b: LimitedMotion, worst: Worst, j: int, kept: float) -> str:
    """Both torques, and the bandwidth at which they agree."""
    sign = max(SIGNS, key=lambda s: b.scales[EFFORT].ratio(s * worst.value[EFFORT, s], s)[j])
    unit = LIMIT_KINDS[EFFORT].unit(joint_units(b.robot.mechanism)[j])
    value = sign * worst.value[EFFORT, sign][j]
    came = f"computed {value:.3g} {unit}, measured {kept:.3g} {unit} at most at the times beyond the limit"
    why = "the encoder moves as its link does not, by play, or the robot's data are wrong"
    band = _confirmed_band(b, float(worst.t[EFFORT, sign][j]))
    if band is None:
        return f"{came}: {why}"
    cure = Remedy(f"load the motion with bandwidth={band:.3g}", f"--bandwidth {band:.3g}")
    return f"{came}: {why}; torques confirm the positions up to {band:.3g} Hz: {cure}"


def _confirmed_band(b: LimitedMotion, worst: float) -> float | None:
    """The frequency in Hz up to which measured torques confirm accelerations; None where it is what was smoothed to."""
    motion, chosen = b.motion, resmoothing.chosen_bandwidth(b.motion)
    if chosen is None or motion.loads or motion.base_curve or b.robot.mechanism.floats:
        return None
    assert motion.torques is not None, "callers have compared them"
    t, tau = motion.torques
    first = max(0, min(int(np.searchsorted(t, worst)) - MAX_BAND_SAMPLES // 2, len(t) - MAX_BAND_SAMPLES))
    part = slice(first, first + MAX_BAND_SAMPLES)
    t, tau = t[part], tau[part]
    rates = motion(t, 2)
    missing = tau - compute(b.robot, "inverse_dynamics", rates)
    if not np.isfinite(missing).all():
        return None
    M = compute(b.robot, "mass_matrix", rates[:1])
    if not (np.linalg.eigvalsh(M)[:, 0] > 0).all():
        return None
    found = resmoothing.band_errors(t, rates[2], np.linalg.solve(M, missing[..., None])[..., 0], chosen)
    return found.frequency if found is not None and found.is_lower else None


# Doubts: what a robot's data leave open of its limits, along every motion.
MASSLESS_CAUSE = (
    "moves no inertia at all, so that its forces are 0 for lack of it; state the inertias of its bodies, or load the"
    " robot with {} if that is meant"
)
ZERO_LIMIT_CAUSE = (
    "the limit is 0 on both sides, as files state where it is not known; state the limit, or omit it, as by {}"
)


def find_doubts(b: LimitedMotion) -> Mapping[tuple[str, int], str]:
    """By kind and joint why a limit is undecided, whatever the motion: it is 0, or its joint moves no mass."""
    mechanism, found = b.robot.mechanism, {}
    massless = mobility.find_idle_coordinates(mechanism) & (MASSLESS_TIPS not in mechanism.meant)
    for kind in b.kinds:
        bounds = b.limits.bounds(kind)
        limited = np.isfinite(bounds).any(axis=0)
        for j in np.flatnonzero((bounds == 0).all(axis=0)).tolist():
            found[kind, j] = ZERO_LIMIT_CAUSE.format(Remedy("with_limits", "--limits"))
        for j in np.flatnonzero(massless & limited).tolist() if LIMIT_KINDS[kind].of != "q" else ():
            found[kind, j] = f"{b.joints[j]} {MASSLESS_CAUSE.format(Remedy('massless_tips=True', '--massless-tips'))}"
    return found


def without_doubts(b: LimitedMotion) -> LimitedMotion:
    """The motion with the limits alone that can be decided: at no speed is there a verdict on the others."""
    doubts = find_doubts(b)
    if not doubts:
        return b
    table, kinds = b.limits.table.copy(), list(LIMIT_KINDS)
    for kind, j in doubts:
        table[kinds.index(kind), :, j] = -np.inf, np.inf
    decided = replace(b.limits, table=table)
    return replace(b, limits=decided, kinds=tuple(kind for kind in b.kinds if kind in decided.kinds))


def with_consistent_inertias(robot: Engine) -> tuple[Engine, tuple[str, ...]]:
    """The robot with the nearest inertias that bodies can have, and the bodies that have others, unless meant."""
    m = robot.mechanism
    if INERTIAS in m.meant or not scalars.is_numeric(m.M):
        return robot, ()
    nearest = [inertia.nearest_consistent(M) for M in m.M]
    changed = [i for i, M in enumerate(m.M) if not np.array_equal(nearest[i], M)]
    if not changed:
        return robot, ()
    return with_mechanism(robot, replace(m, M=np.array(nearest))), tuple(m.bodies[i] for i in changed)


def describe_wrong_inertias(bodies: tuple[str, ...], verdict: str) -> str:
    """The cause of a verdict that is another one with inertias that bodies can have."""
    return f"no body can have the inertias of {join_names(bodies)}, and with the nearest possible ones it is {verdict}"


# Notes: what a verdict leaves out.
LACK_TOLERANCE = 1e-5  # of the largest force: what integrated motions of springs lack by their steps is less


def describe_omissions(b: LimitedMotion, breaks: tuple[ForceBreak, ...]) -> tuple[str, ...]:
    """What the motion cannot meet because it is not smooth, and which limits nothing is checked against."""
    notes = []
    missed = [found for found in breaks if found.order < max(b.force_rates.values(), default=0)]
    if missed:
        first = missed[0]
        joints = b.robot.joint_names
        causes = [joints[j] if isinstance(j := cause.joint, int) else j for cause in first.causes]
        names = join_names(causes or ["a limit of a contact"])
        more = f" (and at {len(missed) - 1} more times)" if len(missed) > 1 else ""
        jumps = rate_name("Q", max(first.order, 0)) if first.order >= 0 else "qd"
        limits = " and ".join(kind.replace("_", " ") for kind, k in b.force_rates.items() if k > max(first.order, 0))
        came = f"break at t = {first.t:.9g} s{more}: {jumps} jumps because of {names}"
        cure = f"; {Remedy('motion.blended', '--blend')} replaces breaks" if causes else ""
        notes.append(f"{came}; no limit of {limits} can be met there{cure}")
    if idle := [kind.replace("_", " ") for kind in b.limits.kinds if kind not in b.kinds]:
        rigid, broken = (
            f"the joints are rigid{Remedy('; see robot.elastic(stiffness)')}",
            "limits of contacts are broken",
        )
        reason = rigid if all(LIMIT_KINDS[kind].takes for kind in b.limits.kinds if kind not in b.kinds) else broken
        notes.append(f"limits of {join_names(idle)} are not checked: {reason}")
    for joint in coordinates.following_efforts(b.robot.mechanism):
        notes.append(
            f"effort limits of {quote_value(joint)} are not checked: it follows another, shares motors or has none"
        )
    return tuple(notes)


def describe_unresolved(worst: Worst) -> tuple[str, ...]:
    """Which values change too fast between samples for a verdict, and where that begins."""
    return tuple(
        f"the {kind.replace('_', ' ')} of joint {quote_value(worst.b.name(kind, j))} may be beyond its limit between"
        f" samples from t = {min(spans)[0]:.9g} s on: it changes too fast there to be followed"
        for (kind, j), spans in worst.unresolved.items()
    )


def describe_lacks(b: LimitedMotion, motion: Motion) -> tuple[str, ...]:
    """What a motion lacks at passive coordinates, which no motor supplies: the robot moves otherwise."""
    m = b.robot.mechanism
    if m.closure is None or not m.closure.passive:
        return ()
    names, found = [m.coordinates[k] for k in m.closure.passive], list[np.ndarray]()
    for _, states in MotionStates.pieces(b.robot, motion, motion.times, [(QUANTITIES["actuator_forces"], 0)]):
        found.append(states.compute(b.robot, "actuator_forces")[0])
    forces = np.abs(np.concatenate(found))
    lacks = forces[:, -len(names) :]
    if not lacks.max() > LACK_TOLERANCE * forces.max():
        return ()
    i, j = np.unravel_index(lacks.argmax(), lacks.shape)
    return (
        f"the motion lacks {lacks[i, j]:.3g} at passive {quote_value(names[j])}, at t = {motion.times[i]:.6g} s, which"
        f" no motor supplies: the robot moves otherwise{Remedy(', see robot.passive_accelerations')}",
    )
