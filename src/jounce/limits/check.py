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
from jounce.limits.joints import power_factors
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
    """Check every limit of a robot along a motion.

    Of a motion that consists of commands, differences are judged in place of derivatives.
    """
    b = validate_limits(robot, motion)
    checked = _check_limits(b)
    consistent, bodies = with_consistent_inertias(b.robot)
    # Inertias enter forces alone.
    if len(bodies) == 0 or not (b.forces or contact_limits.are_limited(robot.mechanism)):
        return checked
    # Rows that are decided otherwise with inertias that bodies can have are undecided.
    consistent_rows = _check_limits(replace(b, robot=consistent)).table
    causes = {
        place: describe_wrong_inertias(bodies, other_row.verdict)
        for place, (row, other_row) in enumerate(zip(checked.table, consistent_rows, strict=True))
        if row.verdict != other_row.verdict
    }
    return _doubt_rows(b, checked, causes)


def _check_limits(b: LimitedMotion) -> Check:
    """Check every limit along a motion with the inertias of a robot.

    Limits of 0 and joints that move no mass are undecided in it.
    """
    commands = take_differences(b)
    if commands is not None:
        return _check_commands(b, commands)
    contact_motion.refuse_hovering(b.robot, b.motion)
    contacts: tuple[CheckedLimit, ...] = ()
    if contact_limits.are_limited(b.robot.mechanism):
        contacts = tuple(CheckedLimit(*row) for row in judge_contacts(b))
    # Where no wrenches of contacts keep their limits there are no forces to be judged.
    if combine_verdicts([row.verdict for row in contacts]) == "broken":
        b = b.select_kinds([kind for kind in b.kinds if LIMIT_KINDS[kind].of == "q"])
    # Breaks that no coordinate or load causes are switches of the contacts: pieces end there.
    breaks = find_limited_breaks(b)
    b = replace(b, switches=tuple(force_break.t for force_break in breaks if len(force_break.causes) == 0))
    # The worst values along the pieces. Of exact motions they decide; of measured ones, where they are known well, they
    # are shown beside values whose deviations are large, and the samples decide.
    worst, measured = Worst(b), len(b.kinds) > 0 and is_measured(b.motion)
    take = worst.take_worst if measured else worst.take
    for pieces in split_motion(b):
        take(pieces)
    worst_in_windows = _copy_worst(worst)
    # What nobody can decide, by kind and joint, with its cause: close samples, and values that change too fast.
    undecided = judge_samples(b, worst) if measured else {}
    causes = dict.fromkeys(undecided, SAMPLES_CAUSE)
    for limit, spans in worst.unresolved.items():
        undecided[limit] = undecided.get(limit, []) + spans
        causes[limit] = UNRESOLVED_CAUSE
    worst.take_jumps(breaks)
    notes = (*describe_omissions(b, breaks), *describe_unresolved(worst), *describe_lacks(b, b.motion))
    notes += describe_totals(b)
    if measured and len(b.force_rates) > 0:
        notes += describe_play(b)
    # Efforts that measured torques contradict are undecided where they would be broken.
    contradictions = find_contradictions(b, worst) if measured else {}
    for j, cause in contradictions.items():
        undecided[EFFORT, j] = undecided.get((EFFORT, j), []) + worst.drop_spans(EFFORT, j)
        causes[EFFORT, j] = cause
        notes += (f"undecided: effort of {b.joints[j]}: {cause}",)
    table = (*_build_table(b, worst, undecided, worst_in_windows, causes), *contacts)
    checked = Check(table, breaks, notes, _judged_shares(b, undecided), b.whole)
    return _doubt_rows(b, checked, _place_doubts(b))


def _check_commands(b: LimitedMotion, commands: JudgedCommands) -> Check:
    """Check every limit that differences of commands are compared with.

    Those of measured motions have deviations.
    """
    # The kinds that are judged, which may be fewer than those of b.
    judged, t, undecided = commands.b, commands.q.times[1:], Spans()
    worst = Worst(judged)
    if is_measured(b.motion):
        values = {kind: channel.values for kind, channel in commands.limited.items()}
        judge_values(judged, worst, t, values, undecided)
    else:
        for kind, channel in commands.limited.items():
            for sign in SIGNS:
                beyond = judged.scales[kind].beyond(channel.values, sign)
                worst.take_values(kind, sign, t, sign * channel.values, beyond)
    table = _build_table(judged, worst, undecided, _copy_worst(worst), dict.fromkeys(undecided, SAMPLES_CAUSE))
    notes = (*commands.notes, *describe_omissions(b, ()), *describe_totals(judged))
    checked = Check(table, (), notes, _judged_shares(judged, undecided), b.whole)
    return _doubt_rows(b, checked, _place_doubts(judged))


def _place_doubts(b: LimitedMotion) -> dict[int, str]:
    """Return why limits are undecided along every motion.

    The result has a cause by the place of each such limit in the table.
    """
    doubts = find_doubts(b)
    return {place: doubts[limit] for place, limit in enumerate(_limited_columns(b)) if limit in doubts}


def _doubt_rows(b: LimitedMotion, checked: Check, causes: Mapping[int, str]) -> Check:
    """Return the check with some rows undecided all the time.

    `causes` are by the place of a row in the table.
    """
    if len(causes) == 0:
        return checked
    rows = list(checked.table)
    for i, cause in causes.items():
        rows[i] = replace(rows[i], violations=(), undecided=(b.whole,), cause=cause)
    # One note for each cause, with all limits that have it.
    names_by_cause: dict[str, list[str]] = {}
    for i, cause in causes.items():
        names_by_cause.setdefault(cause, []).append(f"{rows[i].limit.replace('_', ' ')} of {rows[i].joint}")
    notes = tuple(f"undecided: {join_names(names)}: {cause}" for cause, names in names_by_cause.items())
    # Kinds of which no row is decided at all are not judged.
    decided = {row.limit for i, row in enumerate(rows) if i not in causes}
    judged = {kind: share * (kind in decided) for kind, share in checked.judged.items()}
    return replace(checked, table=tuple(rows), notes=(*checked.notes, *notes), judged=judged)


def find_limited_breaks(b: LimitedMotion) -> tuple[ForceBreak, ...]:
    """Find where the forces that are limited are not smooth."""
    if not b.forces:
        return ()
    options = along.ForceOptions(row=b.efforts)
    return along.find_force_breaks(b.robot, b.motion, b.motion.times, b.force_order, options=options)


def _copy_worst(worst: Worst) -> dict[tuple[str, int], tuple[np.ndarray, np.ndarray]]:
    """Copy the worst values and their times by kind and sign."""
    return {side: (value.copy(), worst.t[side].copy()) for side, value in worst.value.items()}


def _limited_columns(b: LimitedMotion) -> list[tuple[str, int]]:
    """Return the kind and joint of each row of the table."""
    limited = {kind: np.flatnonzero(np.isfinite(b.limits.bounds(kind)).any(axis=0)) for kind in b.kinds}
    totals = [kind for kind in b.kinds if LIMIT_KINDS[kind].is_total]
    of_joints = [kind for kind in b.kinds if kind not in totals]
    # Those of the whole robot follow those of its joints.
    return [(kind, j) for j in range(len(b.joints)) for kind in of_joints if j in limited[kind]] + [
        (kind, 0) for kind in totals
    ]


def _build_table(
    b: LimitedMotion,
    worst: Worst,
    undecided: Spans,
    worst_in_windows: Mapping[tuple[str, int], tuple[np.ndarray, np.ndarray]],
    causes: Mapping[tuple[str, int], str] = MappingProxyType({}),
) -> tuple[CheckedLimit, ...]:
    """Build the rows of the table.

    `worst_in_windows` holds values and times of the worst values where they are known well, by kind and sign.
    """
    ratios = worst.ratios
    # Each limit is shown on the side where its ratio is larger.
    limited = [(kind, max(SIGNS, key=lambda sign: ratios[kind, sign][j]), j) for kind, j in _limited_columns(b)]
    # The deviations at the times of all worst values at once: (rows, n) by kind.
    off = compute_deviations(b, np.array([worst.t[kind, sign][j] for kind, sign, j in limited]))
    rows = []
    for i, (kind, sign, j) in enumerate(limited):
        scale = b.scales[kind]
        value, bound = sign * float(worst.value[kind, sign][j]), sign * float(scale.bound(sign)[j])
        deviation, reach = float(off[kind][i, j]) if kind in off else np.nan, float(abs(scale.reach(sign)[j]))
        t, (start, stop) = float(worst.t[kind, sign][j]), b.window(kind)
        # The worst value within the window is shown in addition, where the worst one of all is uncertain.
        side = max(SIGNS, key=lambda s: scale.ratio(s * worst_in_windows[kind, s][0], s)[j])
        certain = side * float(worst_in_windows[kind, side][0][j]), float(worst_in_windows[kind, side][1][j])
        is_certain = start <= t <= stop or deviation <= reliability.MAX_CERTAIN_SHARE * abs(value)
        rows.append(CheckedLimit(
            joint=b.name(kind, j),
            limit=kind,
            of=b.limits.of(kind) if kind in LIMIT_KINDS.effort else None,
            unit=b.unit(kind, j),
            value=value,
            bound=bound,
            ratio=float(ratios[kind, sign][j]),
            margin=sign * (bound - value),
            t=t,
            deviation=None if np.isnan(deviation) or reach == 0 else deviation / reach,
            violations=join_spans(worst.broken_spans(kind, j)),
            undecided=join_spans(undecided.get((kind, j), [])),
            certain=None if is_certain else certain,
            cause=causes.get((kind, j)),
        ))  # fmt: skip
    return tuple(rows)


def _judged_shares(b: LimitedMotion, undecided: Spans) -> dict[str, float]:
    """Return the share of time in which each kind is decided.

    A kind is decided where it is for all joints. The share is 0 for kinds that nothing is checked against.
    """
    shares = dict.fromkeys(b.limits.kinds, 0.0)
    for kind in b.kinds:
        # Times at which any joint is undecided do not count; they may overlap.
        spans_of_joints = [spans for (limit_kind, _), spans in undecided.items() if limit_kind == kind]
        spans = join_spans([span for spans in spans_of_joints for span in spans])
        share = float(len(spans) > 0)
        if b.motion.duration > 0:
            share = sum(stop - start for start, stop in spans) / b.motion.duration
        shares[kind] = 1.0 - share
    return shares


# Measured torques: what they leave open of efforts that computed torques break.
EFFORT = "effort"
MIN_TORQUE_SAMPLES = 4 * noise.NOISE_DIFFERENCE_ORDER  # of which a noise is known
TORQUES = "forces from its accelerations may be those of no link, and measured torques decide"
MAX_BAND_SAMPLES = 20_000  # about the worst time, from which the band is found that torques confirm


def find_contradictions(b: LimitedMotion, worst: Worst) -> dict[int, str]:
    """Find efforts that computed torques break and measured torques keep.

    Returns by joint why the limit is undecided.
    """
    # Torques have to be measured, of the coordinates, and at the pace of the motion.
    if b.motion.torques is None or EFFORT not in b.kinds or b.robot.mechanism.closure is not None:
        return {}
    if b.motion.commanded or not resmoothing.is_at_measured_pace(b.motion):
        return {}
    t, tau = b.motion.torques
    if EFFORT in b.limits.without_gravity:
        # The gravity forces of a robot on a moving base are not those of q alone.
        if b.motion.base_curve is not None or b.robot.mechanism.floats:
            return {}
        tau = tau - compute(b.robot, "gravity_forces", b.motion(t, 0))
    causes = {}
    for j in range(len(b.joints)):
        largest = _largest_kept(t, tau[:, j], worst.broken_spans(EFFORT, j), b.limits.bounds(EFFORT)[:, j])
        if largest is not None:
            causes[j] = _describe_contradiction(b, worst, j, largest)
    return causes


def describe_play(b: LimitedMotion) -> tuple[str, ...]:
    """Describe where encoders may move as links do not.

    Logs with measured torques show it by these, and have no such note.
    """
    motion, confirmed = b.motion, b.robot.mechanism.confirmed_band
    chosen = resmoothing.chosen_bandwidth(motion)
    if chosen is None or not (motion.torques is None or motion.commanded):
        return ()
    notes = [
        f"the encoder of {quote_value(joint)} stands still at {play.long} of {play.count} reversals, for longer than"
        f" the joint can, usually {1e3 * play.usual:.2g} ms: by play, or since it sticks; {TORQUES}"
        for joint, play in resmoothing.find_play(motion, b.robot.joint_names).items()
    ]
    if confirmed is not None and confirmed < resmoothing.MAX_CONFIRMED_SHARE * chosen:
        cure = Remedy(f"load the motion with bandwidth={confirmed:.3g}", f"--bandwidth {confirmed:.3g}")
        notes.append(
            f"torques confirmed positions of this robot up to {confirmed:.3g} Hz when it was identified, and the log is"
            f" smoothed to {chosen:.3g} Hz: forces beyond may be those of no link; {cure}"
        )
    return tuple(notes)


def _largest_kept(t: np.ndarray, tau: np.ndarray, spans: list[Span], bounds: np.ndarray) -> float | None:
    """Return the largest torque measured in spans.

    Returns None if a torque is not surely within the bounds, or if a span has no measured torque.
    """
    known = np.isfinite(tau)
    if len(spans) == 0 or np.count_nonzero(known) < MIN_TORQUE_SAMPLES:
        return None
    t, tau = t[known], tau[known]
    room = DECISIVE_DEVIATIONS * float(noise.estimate_local_noise(tau[:, None])[0])
    step, largest = float(np.median(np.diff(t))), 0.0
    for start, stop in spans:
        # A span may be shorter than a sample: it takes the samples around it.
        torques = tau[(t >= start - step) & (t <= stop + step)]
        if torques.size == 0 or (torques - room <= bounds[0]).any() or (torques + room >= bounds[1]).any():
            return None
        largest = max(largest, torques[np.abs(torques).argmax()], key=abs)
    return float(largest)


def _describe_contradiction(b: LimitedMotion, worst: Worst, j: int, largest: float) -> str:
    """Describe both torques, and the bandwidth at which they agree."""
    sign = max(SIGNS, key=lambda s: b.scales[EFFORT].ratio(s * worst.value[EFFORT, s], s)[j])
    unit = b.unit(EFFORT, j)
    value = sign * worst.value[EFFORT, sign][j]
    came = f"computed {value:.3g} {unit}, measured {largest:.3g} {unit} at most at the times beyond the limit"
    why = "the encoder moves as its link does not, by play, or the robot's data are wrong"
    band = _confirmed_band(b, float(worst.t[EFFORT, sign][j]))
    if band is None:
        return f"{came}: {why}"
    cure = Remedy(f"load the motion with bandwidth={band:.3g}", f"--bandwidth {band:.3g}")
    return f"{came}: {why}; torques confirm the positions up to {band:.3g} Hz: {cure}"


def _confirmed_band(b: LimitedMotion, worst: float) -> float | None:
    """Find the frequency in Hz up to which measured torques confirm accelerations.

    Returns None where it is no lower than what the log was smoothed to.
    """
    motion, chosen = b.motion, resmoothing.chosen_bandwidth(b.motion)
    has_more = len(motion.loads) > 0 or motion.base_curve is not None or b.robot.mechanism.floats
    if chosen is None or has_more:
        return None
    assert motion.torques is not None, "callers have compared them"
    t, tau = motion.torques
    # Samples about the worst time, which bound the work.
    first = max(0, min(int(np.searchsorted(t, worst)) - MAX_BAND_SAMPLES // 2, len(t) - MAX_BAND_SAMPLES))
    part = slice(first, first + MAX_BAND_SAMPLES)
    t, tau = t[part], tau[part]
    # The torques that the model lacks, as accelerations: M^-1 (tau - Q), with M at the first sample.
    rates = motion(t, 2)
    missing = tau - compute(b.robot, "inverse_dynamics", rates)
    if not np.isfinite(missing).all():
        return None
    M = compute(b.robot, "mass_matrix", rates[:1])
    if not (np.linalg.eigvalsh(M)[:, 0] > 0).all():
        return None
    band = resmoothing.band_errors(t, rates[2], np.linalg.solve(M, missing[..., None])[..., 0], chosen)
    return band.frequency if band is not None and band.is_lower else None


# Doubts: what a robot's data leave open of its limits, along every motion.
MASSLESS_CAUSE = (
    "moves no inertia, so its forces are always 0; state the inertias of its bodies, or load the robot with {} to"
    " accept this"
)
ZERO_LIMIT_CAUSE = (
    "the limit is 0 on both sides, which often stands for an unknown limit; state the limit, or omit it, as by {}"
)


def find_doubts(b: LimitedMotion) -> Mapping[tuple[str, int], str]:
    """Find the limits that are undecided along every motion, and why.

    The limit is 0, or its joint moves no mass. Causes are by kind and joint.
    """
    mechanism, causes = b.robot.mechanism, {}
    massless = mobility.find_idle_coordinates(mechanism) & (MASSLESS_TIPS not in mechanism.meant)
    for kind in b.kinds:
        bounds = b.limits.bounds(kind)
        limited = np.isfinite(bounds).any(axis=0)
        for j in np.flatnonzero((bounds == 0).all(axis=0)).tolist():
            causes[kind, j] = ZERO_LIMIT_CAUSE.format(Remedy("with_limits", "--limits"))
        # Rates of q are what they are without any mass: forces alone are in doubt.
        if LIMIT_KINDS[kind].of != "q":
            cure = Remedy("massless_tips=True", "--massless-tips")
            # A sum over all joints lacks those without mass.
            doubted = massless if LIMIT_KINDS[kind].is_total else massless & limited
            for j in np.flatnonzero(doubted).tolist():
                column = 0 if LIMIT_KINDS[kind].is_total else j
                causes[kind, column] = f"{b.joints[j]} {MASSLESS_CAUSE.format(cure)}"
    return causes


def without_doubts(b: LimitedMotion) -> LimitedMotion:
    """Return the motion with only the limits that can be decided.

    At no speed is there a verdict on the others.
    """
    doubts = find_doubts(b)
    if len(doubts) == 0:
        return b
    # Limits in doubt become infinite, and kinds without any limit left are not checked.
    decided = b.limits.without(doubts)
    return replace(b, limits=decided, kinds=tuple(kind for kind in b.kinds if kind in decided.kinds))


def with_consistent_inertias(robot: Engine) -> tuple[Engine, tuple[str, ...]]:
    """Return the robot with the nearest inertias that bodies can have.

    Returns it with the names of the bodies that have others. Where the caller meant them, nothing changes.
    """
    m = robot.mechanism
    if INERTIAS in m.meant or not scalars.is_numeric(m.M):
        return robot, ()
    nearest = [inertia.nearest_consistent(M) for M in m.M]
    changed = [i for i, M in enumerate(m.M) if not np.array_equal(nearest[i], M)]
    if len(changed) == 0:
        return robot, ()
    return with_mechanism(robot, replace(m, M=np.array(nearest))), tuple(m.bodies[i] for i in changed)


def describe_wrong_inertias(bodies: tuple[str, ...], verdict: str) -> str:
    """Return the cause of a verdict that consistent inertias would change."""
    return f"no body can have the inertias of {join_names(bodies)}, and with the nearest possible ones it is {verdict}"


# Notes: what a verdict leaves out.
LACK_TOLERANCE = 1e-5  # of the largest force: what integrated motions of springs lack by their steps is less


def describe_omissions(b: LimitedMotion, breaks: tuple[ForceBreak, ...]) -> tuple[str, ...]:
    """Describe what is not met and what is not checked.

    A limit is not met where the motion is not smooth enough for it.
    """
    notes = []
    # Breaks of rates that limits take: there what they bound is infinite.
    missed = [force_break for force_break in breaks if force_break.order < max(b.force_rates.values(), default=0)]
    if len(missed) > 0:
        first, joints = missed[0], b.robot.joint_names
        causes = [cause.joint if isinstance(cause.joint, str) else joints[cause.joint] for cause in first.causes]
        names = join_names(causes if len(causes) > 0 else ["a limit of a contact"])
        more = f" (and at {len(missed) - 1} more times)" if len(missed) > 1 else ""
        jumps = rate_name("Q", max(first.order, 0)) if first.order >= 0 else "qd"
        limits = " and ".join(kind.replace("_", " ") for kind, k in b.force_rates.items() if k > max(first.order, 0))
        came = f"break at t = {first.t:.9g} s{more}: {jumps} jumps because of {names}"
        cure = f"; {Remedy('motion.blended', '--blend')} replaces breaks" if len(causes) > 0 else ""
        notes.append(f"{came}; no limit of {limits} can be met there{cure}")
    # Kinds that are stated and left out: those of motors of rigid joints, or of forces that contacts do not allow.
    unchecked = [kind for kind in b.limits.kinds if kind not in b.kinds]
    if len(unchecked) > 0:
        reason = "limits of contacts are broken"
        if all(LIMIT_KINDS[kind].takes for kind in unchecked):
            reason = f"the joints are rigid{Remedy('; see robot.elastic(stiffness)')}"
        idle = join_names([kind.replace("_", " ") for kind in unchecked])
        notes.append(f"limits of {idle} are not checked: {reason}")
    for joint in coordinates.following_efforts(b.robot.mechanism):
        notes.append(
            f"effort limits of {quote_value(joint)} are not checked: it follows another, shares motors or has none"
        )
    return tuple(notes)


def describe_totals(b: LimitedMotion) -> tuple[str, ...]:
    """Describe which powers the limits of the whole robot sum up."""
    m, notes = b.robot.mechanism, []
    motors = "all motors"
    if m.closure is not None:
        motors = f"the motors {join_names(m.tree.coordinates[j] for j in m.closure.actuated)}"
    acting = join_names(m.acting) if len(m.acting) > 0 else "no terms of drives"
    words_by_factor = {
        "velocity": f"Q qd of {motors}, with {acting} in Q{', and no motor at the base' if m.floats else ''}",
        "motor_velocity": "tau thetad of all motors behind springs, with their rotors and friction",
        "motor_voltage": "i u of all motors, with the losses of their windings",
    }
    for kind in (kind for kind in b.kinds if LIMIT_KINDS[kind].is_total):
        words = words_by_factor[power_factors(m, kind)[1]]
        notes.append(f"{kind.replace('_', ' ')} is the sum of {words}")
    return tuple(notes)


def describe_unresolved(worst: Worst) -> tuple[str, ...]:
    """Describe which values change too fast between samples, and where that begins."""
    return tuple(
        f"the {kind.replace('_', ' ')} of {worst.b.owner(kind, j)} may be beyond its limit between"
        f" samples from t = {min(spans)[0]:.9g} s on: it changes too fast there to be followed"
        for (kind, j), spans in worst.unresolved.items()
    )


def describe_lacks(b: LimitedMotion, motion: Motion) -> tuple[str, ...]:
    """Describe what a motion lacks at passive coordinates, which no motor supplies.

    There the robot moves otherwise.
    """
    m = b.robot.mechanism
    if m.closure is None or len(m.closure.passive) == 0:
        return ()
    # Forces of actuators, and after them what is left at the passive coordinates: (N, columns).
    names, parts = [m.coordinates[k] for k in m.closure.passive], list[np.ndarray]()
    for _, states in MotionStates.pieces(b.robot, motion, motion.times, [(QUANTITIES["actuator_forces"], 0)]):
        parts.append(states.compute(b.robot, "actuator_forces")[0])
    forces = np.abs(np.concatenate(parts))
    lacks = forces[:, -len(names) :]
    if not lacks.max() > LACK_TOLERANCE * forces.max():
        return ()
    i, j = np.unravel_index(lacks.argmax(), lacks.shape)
    return (
        f"the motion lacks {lacks[i, j]:.3g} at passive {quote_value(names[j])}, at t = {motion.times[i]:.6g} s, which"
        f" no motor supplies: the robot moves otherwise{Remedy(', see robot.passive_accelerations')}",
    )
