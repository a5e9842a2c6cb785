"""Smooth motions of measured samples to a lower bandwidth, which torques confirm.

A smoothing chooses its bandwidth by the noise of positions, and follows all of a motion that stands out of it. Where an
encoder moves as the link does not, by play, give or teeth between rotor and link, its samples hold accelerations a that
no link has, whose deviations are right for the encoder. No noise of positions shows it: torques do, which ask for
accelerations a + e, and may confirm less. `smooth_motion_to` makes the motion of its samples as they came: which
rows hold older positions, lie far off or have wrong stamps is found for the new bandwidth.

The band that is confirmed (`band_errors`): if the motion were smoothed to F, it would keep the errors e below F, and
would lose the true motion a + e above:

    S(F) = sum_{f <= F} |E(f)|^2 + sum_{f > F} |A(f) + E(f)|^2,    summed over joints, each over its sum of |A|^2,

with the transforms A, E of a and e. The band ends at the F of the least S. Noise of torques makes e as well, but of any
sign: both sums hold it alike, and S hardly changes with F where a is small. Invariant: a band is lower only where it
takes MIN_GAIN of S away and F is well below what the smoothing chose: neither noise of torques nor errors of parameters
do that.

Play (`find_play`): an encoder on the rotor of a joint with play stands still at a reversal, until the rotor has crossed
the play, while the link turns back. An encoder of the step s that follows its link shows one position around a reversal
for at most

    T = 2 sqrt(2 s / |a|),

which is how long a parabola of the acceleration a stays within a step, and one sample more. The acceleration is that of
the parabola through the position that stands and those some time before and after, which are far from it: there the
encoder moves as the link. Where most reversals of a joint last longer, its encoder does not follow, by play or because
the joint sticks.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from jounce.motion import noise
from jounce.motion.composite_curves import CurvePart, RetimedCurve
from jounce.motion.curves import ArrangedCurve, Curve
from jounce.motion.motion import Motion
from jounce.motion.sample_curves import SmoothedCurve

WRAPPERS = (ArrangedCurve, CurvePart, RetimedCurve)  # of the same motion: in another order, cut, at another pace
MIN_GAIN = 1.3  # S(all) over S(F): play makes 1.5 to 10, and logs without it 1.1 at most
MAX_CONFIRMED_SHARE = 0.8  # of F to the bandwidth of the smoothing: more is the same bandwidth, but for its roll-off
UNCERTAIN_END_SHARE = 0.03  # of the cells at either end, whose accelerations have deviations that rise by powers of ten
MIN_CONFIRMED_CELLS = 16  # between the ends: of fewer, a transform has too few lines to find a band: all of it counts
REACHES = (0.02, 0.04, 0.08, 0.16)  # s before a joint stands and after it, from which its acceleration follows
MIN_STEPS_APART = 20.0  # of positions there from where it stands: of fewer, an acceleration has an error of 10 %
MIN_REVERSALS = 8  # of a joint: fewer may all be slow by chance, as where a motion rests
MAX_LONG_SHARE = 0.75  # of them that last longer than a parabola: without play a tenth does, where a motion is rough


@dataclass(frozen=True)
class BandErrors:
    """Squares of errors of accelerations as torques show them, S.

    They are over those of accelerations.
    """

    frequency: float  # F of the least S, Hz
    least: float  # S(F)
    total: float  # S of all frequencies
    chosen: float  # the bandwidth that the motion is smoothed to, Hz

    @property
    def is_lower(self) -> bool:
        """Whether torques confirm less than the band of the smoothing."""
        return 0 < self.frequency < MAX_CONFIRMED_SHARE * self.chosen and self.total > MIN_GAIN * self.least


@dataclass(frozen=True)
class Reversals:
    """The reversals of a joint at which its encoder stands still."""

    count: int
    long: int  # of them that last longer than the acceleration allows
    usual: float  # median of how long they last, s

    @property
    def show_play(self) -> bool:
        """Whether the encoder does not follow its link."""
        return self.count >= MIN_REVERSALS and self.long > MAX_LONG_SHARE * self.count


def chosen_bandwidth(motion: Motion) -> float | None:
    """Return the bandwidth in Hz that a smoothing chose.

    None of a motion without samples, or of a stated bandwidth.
    """
    curve, pace = _find_smoothed(motion.curve)
    return None if curve is None or curve.way.bandwidth is not None else curve.fit.bandwidth * pace


def is_at_measured_pace(motion: Motion) -> bool:
    """Return whether a motion is as fast as its samples."""
    return _find_smoothed(motion.curve)[1] == 1


def trusted_span(motion: Motion) -> tuple[float, float]:
    """Return the times in s between which derivatives are trustworthy.

    They are of smoothed samples; of other motions all are.
    """
    curve, first, last = motion.curve, motion.start, motion.stop
    smoothed, _ = _find_smoothed(curve)
    if smoothed is not None:
        first, last = _outer(curve, np.array(smoothed.fit.ends)).tolist()
    return first, last


def limited_bandwidth(motion: Motion) -> float:
    """Return the bandwidth in Hz to which a smoothing is limited.

    Its user limits it, or what torques confirm; it is infinite of others. Above it the samples hold motion that
    the curve does not.
    """
    curve, pace = _find_smoothed(motion.curve)
    return np.inf if curve is None or curve.limit is None else curve.limit * pace


def find_play(motion: Motion, joints: Sequence[str]) -> dict[str, Reversals]:
    """Return the joints whose encoders stand still too long at reversals.

    They stand still longer where they turn back than the joints can, of smoothed samples. Columns without names
    are those of the `joints`, but of balls and loops, which have more of them.
    """
    curve, _ = _find_smoothed(motion.curve)
    if curve is None:
        return {}
    names = curve.sampled.names
    if names is None or len(names) == 0:
        names = joints if len(joints) == curve.columns else curve.fit.joints
    columns = zip(names, curve.fit.noise, curve.sampled.q.T, strict=True)
    # Only of an encoder with a known step it is known how long a parabola stays within a step.
    reversals = {
        name: find_reversals(curve.sampled.t, q, joint_noise.step)
        for name, joint_noise, q in columns
        if joint_noise.step > 0 and joint_noise.kind == noise.ENCODER_STEP
    }
    return {name: of_joint for name, of_joint in reversals.items() if of_joint.show_play}


def position_steps(motion: Motion) -> np.ndarray:
    """Return the steps (n,) of which smoothed positions are multiples.

    They are those of encoders, or of written digits, rad or m; or 0.
    """
    return _position_steps(motion.curve)


def smooth_motion_to(motion: Motion, bandwidth: float) -> Motion:
    """Return a motion of the same samples, smoothed to another bandwidth.

    Its smoothing chose its bandwidth. The new one is in Hz.
    """
    curve, pace = _find_smoothed(motion.curve)
    assert curve is not None, "callers ask for the chosen bandwidth before"
    # The samples are at their own pace, the bandwidth at that of the motion.
    smoothed = _with_smoothed(motion.curve, curve.smoothed_to(bandwidth / pace))
    if motion.samples is None:
        return replace(motion, curve=smoothed)
    t, q = motion.samples
    return replace(motion, curve=smoothed, residual=np.abs(smoothed.rates(t, 0)[0] - q).max(axis=0))


def _find_smoothed(curve: Curve) -> tuple[SmoothedCurve | None, float]:
    """Return the smoothed samples of a curve, and its pace.

    None of curves without samples. The pace is how much faster the curve is than the samples.
    """
    pace = 1.0
    while isinstance(curve, WRAPPERS):
        pace /= curve.factor if isinstance(curve, RetimedCurve) else 1.0
        curve = curve.base
    return (curve if isinstance(curve, SmoothedCurve) else None), pace


def _position_steps(curve: Curve) -> np.ndarray:
    """Return the steps (columns,) of the samples of a curve."""
    if isinstance(curve, ArrangedCurve):
        return np.append(_position_steps(curve.base), 0.0)[curve.order] * np.abs(curve.factors)
    if isinstance(curve, WRAPPERS):
        return _position_steps(curve.base)
    steps = [noise.step for noise in curve.fit.noise] if isinstance(curve, SmoothedCurve) else [0.0] * curve.columns
    return np.array(steps)


def _with_smoothed(curve: Curve, smoothed: SmoothedCurve) -> Curve:
    """Return a curve made of another smoothed one."""
    if isinstance(curve, WRAPPERS):
        return replace(curve, base=_with_smoothed(curve.base, smoothed))
    return smoothed


def _outer(curve: Curve, t: np.ndarray) -> np.ndarray:
    """Return the times of a curve at times of its smoothed samples."""
    return curve.outer(_outer(curve.base, t)) if isinstance(curve, WRAPPERS) else t


# The band that torques confirm.
def band_errors(t: np.ndarray, a: np.ndarray, e: np.ndarray, chosen: float) -> BandErrors | None:
    """Return the least S over frequencies, and S of all of them.

    Accelerations are a (C, n), and what is missing of them is e (C, n), at even times (C,). None of too few
    times, or where nothing moves.
    """
    end = int(UNCERTAIN_END_SHARE * len(t))
    t, a, e = (x[end : len(x) - end] for x in (t, a, e))
    if len(t) < 2:
        return None
    window = np.hanning(len(t))[:, None]
    A, E = (np.fft.rfft(x * window, axis=0) for x in (a, e))
    # Each joint counts by its share of its own power: joints at rest have none.
    power = (np.abs(A) ** 2).sum(axis=0)
    moves = power > 0
    if not moves.any():
        return None
    # By frequency: errors that a smoothing to F keeps if they are below F, and motion that it loses above, (lines,).
    errors, motions = ((np.abs(x[:, moves]) ** 2 / power[moves]).sum(axis=1) for x in (E, A + E))
    S = np.cumsum(errors) + motions.sum() - np.cumsum(motions)
    best = int(S.argmin()) if len(t) >= MIN_CONFIRMED_CELLS else len(S) - 1
    return BandErrors(best / (len(t) * float(np.median(np.diff(t)))), float(S[best]), float(S[-1]), chosen)


# Reversals that last too long, which show play.
def find_reversals(t: np.ndarray, q: np.ndarray, step: float) -> Reversals:
    """Return the reversals of an encoder with a known step.

    The step is in rad or m. The encoder shows positions (N,) at times (N,).
    """
    # Runs of rows with one position, which come from one side and go back to it: their first and last rows.
    moves = np.diff(q)
    changes = np.flatnonzero(np.abs(moves) > step / 2)
    turns = moves[changes[:-1]] * moves[changes[1:]] < 0
    first, last = changes[:-1][turns] + 1, changes[1:][turns]
    # The parabola through where it stands and through positions before and after, as near as these are far enough:
    # with rises h1, h2 at the time u from the middle of the run, the acceleration is |h1 + h2| / u^2.
    stands = t[last + 1] - t[first]
    acceleration = np.full(len(stands), np.nan)
    for reach in REACHES:
        before, after = t[first - 1] - reach, t[last + 1] + reach
        rise = np.stack([np.interp(times, t, q) for times in (before, after)]) - q[first]
        is_inside = (before >= t[0]) & (after <= t[-1])
        is_far = (np.abs(rise) > MIN_STEPS_APART * step).all(axis=0) & is_inside
        new = is_far & np.isnan(acceleration)
        acceleration[new] = np.abs(rise.sum(axis=0))[new] / (reach + stands[new] / 2) ** 2
    has_acceleration = np.isfinite(acceleration)
    stands, acceleration = stands[has_acceleration], acceleration[has_acceleration]
    # The parabola stays within a step for 2 sqrt(2 s / |a|), and the run may be seen one sample longer.
    longest = 2 * np.sqrt(2 * step / np.maximum(acceleration, np.finfo(float).tiny)) + np.median(np.diff(t))
    usual = float(np.median(stands)) if len(stands) else 0.0
    return Reversals(len(stands), int(np.count_nonzero(stands > longest)), usual)
