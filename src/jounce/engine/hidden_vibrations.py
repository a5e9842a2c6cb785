"""Bound what vibrations that samples do not show would add to forces.

The bound takes the band and the amplitude of such vibrations, and the partial derivatives of Q.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jounce.engine.engine import Engine
from jounce.engine.plan import compute
from jounce.model import coordinates, positions
from jounce.model.limits import derivative_unit
from jounce.motion.motion import Motion
from jounce.motion.sample_curves import SmoothedCurve
from jounce.spatial.series import rate_name

MAX_PARTIAL_TIMES = 50  # of a motion, at which partials are taken


@dataclass(frozen=True)
class HiddenVibration:
    """What a hidden vibration of a joint would add.

    Attributes
    ----------
    joint : str
        The joint that might vibrate.
    bandwidth : float
        The highest frequency that its samples hold, Hz.
    amplitude, unit : float, str
        The largest amplitude that the samples can hide.
    adds, added_unit : float, str
        What it would add at the end of the band, at most.
    to, of : str
        To which quantity, Qd for one, of which joint.
    per_octave : int
        By how much that grows when the frequency is doubled.
    """

    joint: str
    bandwidth: float
    amplitude: float
    unit: str
    adds: float
    to: str
    of: str
    added_unit: str
    per_octave: int


def find_hidden_vibrations(robot: Engine, motion: Motion, order: int, symbol: str = "Q") -> tuple[HiddenVibration, ...]:
    """Find how much hidden vibrations add to Q or q.

    They are added to the k-th rate, by joint. A wave of the amplitude A of `Fit.hidden` at the end of the band f
    adds to Q_i^(k), to the first order in A, at most

        max over t of sum_l abs(dQ_i^(k) / dq_j^(l)) A (2 pi f)^l,  l = 0 ... k + 2,

    and to q_j^(k) A (2 pi f)^k; at twice the frequency at most 2^(k + 2) and 2^k times that. With loops, a base that
    floats or load_friction it is that of q, k two higher. Empty where a motion is exact or joints have several numbers.
    """
    curve, m = motion.curve, robot.mechanism
    if not isinstance(curve, SmoothedCurve) or curve.fit.hidden is None or positions.multiscrew_joints(m):
        return ()
    w, units = 2 * np.pi * curve.fit.bandwidth, coordinates.units(m)
    # Partial derivatives of Q by q, at all rates, are those of a tree without these.
    has_no_partials = m.floats or len(m.loops) > 0 or m.has_load_friction
    if symbol == "Q" and has_no_partials:
        order, symbol = order + 2, "q"
    highest = order + 2 if symbol == "Q" else order
    # The amplitudes of the rates of a wave, (l, j), and what it adds to its own rate: (i, j), here diagonal.
    waves = curve.fit.hidden * w ** np.arange(highest + 1)[:, None]
    added = np.diag(waves[order])
    # To Q: the sum over the rates l, the largest of some times t.
    if symbol == "Q":
        rates = curve.rates(np.linspace(*curve.fit.ends, MAX_PARTIAL_TIMES), highest)
        # Of the k-th rate of Q, (t, l, i, j).
        P = compute(robot, "inverse_dynamics_partials", rates, method="recursion")
        partials = np.asarray(P[-1] if order else P)
        added = np.einsum("tlij,lj->tij", np.abs(partials), waves).max(axis=0)
    vibrations = []
    for j, (joint, amplitude) in enumerate(zip(curve.fit.joints, curve.fit.hidden.tolist(), strict=True)):
        i = int(added[:, j].argmax())
        vibrations.append(
            HiddenVibration(
                joint=joint,
                bandwidth=curve.fit.bandwidth,
                amplitude=amplitude,
                unit=units[j],
                adds=float(added[i, j]),
                to=rate_name(symbol, order),
                of=curve.fit.joints[i],
                added_unit=derivative_unit(symbol, order, units[i]),
                per_octave=2**highest,
            )
        )
    return tuple(vibrations)


def describe_worst_vibration(vibrations: Sequence[HiddenVibration]) -> str:
    """Describe in one line what the samples of all joints can hide.

    It names the joint whose vibration adds most.
    """
    bands = f"{min(x.bandwidth for x in vibrations):.3g}"
    if len({x.bandwidth for x in vibrations}) > 1:
        bands += f" to {max(x.bandwidth for x in vibrations):.3g}"
    # Amplitudes and additions of revolute and prismatic joints have units of their own.
    amplitudes: dict[str, float] = {}
    worst: dict[str, HiddenVibration] = {}
    for x in vibrations:
        amplitudes[x.unit] = max(x.amplitude, amplitudes.get(x.unit, 0.0))
        if x.added_unit not in worst or x.adds > worst[x.added_unit].adds:
            worst[x.added_unit] = x
    hidden = " or ".join(f"{amplitude:.2g} {unit}" for unit, amplitude in amplitudes.items())
    changes = " and ".join(f"{x.to} of {x.of} by up to {x.adds:.2g} {x.added_unit}" for x in worst.values())
    causes = ", ".join(dict.fromkeys(x.joint for x in worst.values()))
    growth = max(x.per_octave for x in vibrations)
    return (
        f"Resolved up to {bands} Hz; faster vibrations below {hidden} are invisible in the samples and could change"
        f" {changes} (worst: {causes}; {growth} times as much at twice the frequency)"
    )


def describe_hidden_vibration(x: HiddenVibration) -> str:
    """Describe the vibration of a joint in one line."""
    return (
        f"{x.joint} is resolved up to {x.bandwidth:.3g} Hz; faster vibrations below {x.amplitude:.2g}"
        f" {x.unit} are invisible in the samples and could change {x.to} of {x.of} by up to"
        f" {x.adds:.2g} {x.added_unit}, and by {x.per_octave} times as much at twice the frequency"
    )
