"""Encoders that stand still where a joint turns back, for longer than the joint can: by play, or because it sticks.

Problem: an encoder on the rotor of a joint with play stands still at a reversal, until the rotor has crossed the play,
while the link turns back. Its accelerations there are those of no link, and no noise of positions shows it.

Algorithm: an encoder of the step s that follows its link shows one position around a reversal for at most

    T = 2 sqrt(2 s / |a|),

which is how long a parabola of the acceleration a stays within a step, and one sample more. The acceleration is that of
the parabola through the position that stands and those some time before and after, which are far from it: there the
encoder moves as the link. Where most reversals of a joint last longer, its encoder does not follow.
"""

from dataclasses import dataclass

import numpy as np

REACHES = (0.02, 0.04, 0.08, 0.16)  # s before a joint stands and after it, from which its acceleration follows
MIN_STEPS_APART = 20.0  # of positions there from where it stands: of fewer, an acceleration has an error of 10 %
MIN_REVERSALS = 8  # of a joint: fewer may all be slow by chance, as where a motion rests
MAX_LONG_SHARE = 0.75  # of them that last longer than a parabola: without play a tenth does, where a motion is rough


@dataclass(frozen=True)
class Reversals:
    """The reversals of a joint around which its encoder shows one position."""

    count: int
    long: int  # of them that last longer than the acceleration allows
    usual: float  # median of how long they last, s

    @property
    def show_play(self) -> bool:
        """Whether the encoder does not follow its link."""
        return self.count >= MIN_REVERSALS and self.long > MAX_LONG_SHARE * self.count


def find_reversals(t: np.ndarray, q: np.ndarray, step: float) -> Reversals:
    """The reversals of an encoder with a step in rad or m, which shows positions (N,) at times (N,)."""
    # runs of rows with one position, which come from one side and go back to it
    moves = np.diff(q)
    changes = np.flatnonzero(np.abs(moves) > step / 2)
    turns = moves[changes[:-1]] * moves[changes[1:]] < 0
    first, last = changes[:-1][turns] + 1, changes[1:][turns]
    # the parabola through where it stands, and from before to after that, as near as positions are far enough
    stands = t[last + 1] - t[first]
    acceleration = np.full(len(stands), np.nan)
    for reach in REACHES:
        before, after = t[first - 1] - reach, t[last + 1] + reach
        rise = np.stack([np.interp(at, t, q) for at in (before, after)]) - q[first]
        far = (np.abs(rise) > MIN_STEPS_APART * step).all(axis=0) & (before >= t[0]) & (after <= t[-1])
        new = far & np.isnan(acceleration)
        acceleration[new] = np.abs(rise.sum(axis=0))[new] / (reach + stands[new] / 2) ** 2
    known = np.isfinite(acceleration)
    stands, acceleration = stands[known], acceleration[known]
    longest = 2 * np.sqrt(2 * step / np.maximum(acceleration, np.finfo(float).tiny)) + np.median(np.diff(t))
    usual = float(np.median(stands)) if len(stands) else 0.0
    return Reversals(len(stands), int(np.count_nonzero(stands > longest)), usual)
