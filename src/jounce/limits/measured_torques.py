"""What measured torques leave open of limits of effort that computed torques break.

Problem: a log whose encoder moves as the link does not, by play or give between rotor and link, holds accelerations
that no link has. Torques computed from them are certain of the encoder, by its deviations, and wrong of the link; so
are those of a robot whose data are wrong. Where the log has torques that were measured, these decide.

Rule: a limit of effort that computed torques break for sure is undecided, if at all these times the measured torque
keeps it by more than two deviations of its noise. One that comes nearer, or is missing, contradicts nothing: drives
clip at their limits; nor do commands, or torques that were measured at another pace. Efforts alone are judged:
differences of measured torques are noise.

Where no torques are measured, what else shows such encoders is said of a verdict that relies on its accelerations: they
stand still where joints turn back, or torques confirmed less of the robot where it was identified.
"""

import numpy as np

from jounce.core.cures import Remedy
from jounce.core.errors import quote_value
from jounce.engine.plan import compute
from jounce.limits.joints import joint_units
from jounce.limits.limited_motion import LimitedMotion
from jounce.limits.ratios import SIGNS
from jounce.limits.uncertain_spans import DECISIVE_DEVIATIONS
from jounce.limits.worst_values import Worst
from jounce.model.limit_kinds import LIMIT_KINDS
from jounce.motion.channel import Span
from jounce.motion.confirmed_band import MAX_CONFIRMED_SHARE, band_errors
from jounce.motion.noise import NOISE_DIFFERENCE_ORDER, estimate_local_noise
from jounce.motion.resmoothing import chosen_bandwidth, find_play, is_at_measured_pace

EFFORT = "effort"
MIN_TORQUE_SAMPLES = 4 * NOISE_DIFFERENCE_ORDER  # of which a noise is known
TORQUES = "forces from its accelerations may be those of no link, and measured torques decide"
MAX_BAND_SAMPLES = 20_000  # about the worst time, from which the band is found that torques confirm


def find_contradictions(b: LimitedMotion, worst: Worst) -> dict[int, str]:
    """By joint why a limit of effort that is broken by computed torques is undecided: measured ones keep it."""
    if b.motion.torques is None or EFFORT not in b.kinds or b.robot.mechanism.closure is not None:
        return {}
    if b.motion.commanded or not is_at_measured_pace(b.motion):
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
            found[j] = _describe(b, worst, j, kept)
    return found


def describe_play(b: LimitedMotion) -> tuple[str, ...]:
    """What is said of a log without measured torques whose encoders may move as its links do not."""
    motion, confirmed = b.motion, b.robot.mechanism.confirmed_band
    chosen = chosen_bandwidth(motion)
    if chosen is None or not (motion.torques is None or motion.commanded):
        return ()
    notes = [
        f"the encoder of {quote_value(joint)} stands still at {of.long} of {of.count} reversals, for longer than the"
        f" joint can, usually {1e3 * of.usual:.2g} ms: by play, or since it sticks; {TORQUES}"
        for joint, of in find_play(motion, b.robot.joint_names).items()
    ]
    if confirmed is not None and confirmed < MAX_CONFIRMED_SHARE * chosen:
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
    room = DECISIVE_DEVIATIONS * float(estimate_local_noise(tau[:, None])[0])
    step, largest = float(np.median(np.diff(t))), 0.0
    for start, stop in spans:
        there = tau[(t >= start - step) & (t <= stop + step)]
        if not there.size or (there - room <= bounds[0]).any() or (there + room >= bounds[1]).any():
            return None
        largest = max(largest, there[np.abs(there).argmax()], key=abs)
    return float(largest)


def _describe(b: LimitedMotion, worst: Worst, j: int, kept: float) -> str:
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
    motion, chosen = b.motion, chosen_bandwidth(b.motion)
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
    found = band_errors(t, rates[2], np.linalg.solve(M, missing[..., None])[..., 0], chosen)
    return found.frequency if found is not None and found.is_lower else None
