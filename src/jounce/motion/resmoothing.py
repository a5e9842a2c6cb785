"""Motions of measured samples that were smoothed, smoothed once more to a lower bandwidth than their noise allows.

A smoothing chooses its bandwidth by the noise of positions. What else is known of a motion, such as the torques that
made it, may confirm less. The motion is made of its samples as they came: which rows hold older positions, lie far off
or have wrong stamps is found for the new bandwidth.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from jounce.motion.composite_curves import CurvePart, RetimedCurve
from jounce.motion.curves import ArrangedCurve, Curve
from jounce.motion.motion import Motion
from jounce.motion.noise import ENCODER_STEP
from jounce.motion.reversals import Reversals, find_reversals
from jounce.motion.sample_curves import SmoothedCurve

WRAPPERS = (ArrangedCurve, CurvePart, RetimedCurve)  # of the same motion: in another order, cut, at another pace


def chosen_bandwidth(motion: Motion) -> float | None:
    """The bandwidth in Hz that a smoothing chose; None of a motion without samples, or of a stated bandwidth."""
    curve, pace = _find_smoothed(motion.curve)
    return None if curve is None or curve.way.bandwidth is not None else curve.fit.bandwidth * pace


def is_at_measured_pace(motion: Motion) -> bool:
    """Whether a motion is as fast as its samples."""
    return _find_smoothed(motion.curve)[1] == 1


def trusted_span(motion: Motion) -> tuple[float, float]:
    """The times in s between which derivatives of smoothed samples are trustworthy; all of other motions."""
    curve, first, last = motion.curve, motion.start, motion.stop
    if (smoothed := _find_smoothed(curve)[0]) is not None:
        first, last = _outer(curve, np.array(smoothed.fit.ends)).tolist()
    return first, last


def limited_bandwidth(motion: Motion) -> float:
    """The bandwidth in Hz to which a smoothing is limited, by its user or by what torques confirm; infinite of others.

    Above it the samples hold motion that the curve does not.
    """
    curve, pace = _find_smoothed(motion.curve)
    return np.inf if curve is None or curve.limit is None else curve.limit * pace


def find_play(motion: Motion, joints: Sequence[str]) -> dict[str, Reversals]:
    """The joints whose encoders stand still longer where they turn back than the joints can, of smoothed samples.

    Columns without names are those of the `joints`, but of balls and loops, which have more of them.
    """
    curve, _ = _find_smoothed(motion.curve)
    if curve is None:
        return {}
    names = curve.given.names or (joints if len(joints) == curve.columns else curve.fit.joints)
    columns = zip(names, curve.fit.noise, curve.given.q.T, strict=True)
    found = {
        name: find_reversals(curve.given.t, q, noise.step)
        for name, noise, q in columns
        if noise.step and noise.kind == ENCODER_STEP
    }
    return {name: of for name, of in found.items() if of.show_play}


def position_steps(motion: Motion) -> np.ndarray:
    """The steps (n,) of encoders, or of written digits, of which smoothed positions are multiples, rad or m; or 0."""
    return _position_steps(motion.curve)


def smooth_motion_to(motion: Motion, bandwidth: float) -> Motion:
    """A motion whose smoothing chose its bandwidth, of the same samples, smoothed to another bandwidth in Hz."""
    curve, pace = _find_smoothed(motion.curve)
    assert curve is not None, "callers ask for the chosen bandwidth before"
    smoothed = _with_smoothed(motion.curve, curve.smoothed_to(bandwidth / pace))
    if motion.samples is None:
        return replace(motion, curve=smoothed)
    t, q = motion.samples
    return replace(motion, curve=smoothed, residual=np.abs(smoothed.rates(t, 0)[0] - q).max(axis=0))


def _find_smoothed(curve: Curve) -> tuple[SmoothedCurve | None, float]:
    """The smoothed samples that a curve is made of, None of others, and how much faster the latter is."""
    pace = 1.0
    while isinstance(curve, WRAPPERS):
        pace /= curve.factor if isinstance(curve, RetimedCurve) else 1.0
        curve = curve.base
    return (curve if isinstance(curve, SmoothedCurve) else None), pace


def _position_steps(curve: Curve) -> np.ndarray:
    """The steps (columns,) of the samples that a curve is made of."""
    if isinstance(curve, ArrangedCurve):
        return np.append(_position_steps(curve.base), 0.0)[curve.order] * np.abs(curve.factors)
    if isinstance(curve, WRAPPERS):
        return _position_steps(curve.base)
    steps = [noise.step for noise in curve.fit.noise] if isinstance(curve, SmoothedCurve) else [0.0] * curve.columns
    return np.array(steps)


def _with_smoothed(curve: Curve, smoothed: SmoothedCurve) -> Curve:
    """A curve made of another smoothed one."""
    if isinstance(curve, WRAPPERS):
        return replace(curve, base=_with_smoothed(curve.base, smoothed))
    return smoothed


def _outer(curve: Curve, t: np.ndarray) -> np.ndarray:
    """The times of a curve at times of the smoothed samples that it is made of."""
    return curve.outer(_outer(curve.base, t)) if isinstance(curve, WRAPPERS) else t
