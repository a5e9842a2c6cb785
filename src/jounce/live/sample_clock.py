"""The clock of samples that come one by one: which stamps are refused, and when refused ones are those of a new clock.

A stamp that is not after the last one is refused, with its sample. Where `NEW_CLOCK_STAMPS` in a row are refused that
increase among themselves, by steps that no gap is longer than, it is the one before them that was wrong, or the clock
was set back: the last of them is the first of a new clock. A stamp far ahead is a gap, and is not refused: a robot may
pause. If it was wrong, the stamps after it are refused, and the third of them starts the clock again.
"""

from dataclasses import dataclass

import numpy as np

from jounce.core.errors import JounceError, quote_value
from jounce.core.scalars import is_finite

NEW_CLOCK_STAMPS = 3  # one is an error, two are a pair of late rows: the third costs two rows more at a true new clock


@dataclass(frozen=True)
class SampleClock:
    """The time of the last stamp that was not refused, s, and of those refused since: how many increase, and the last.

    `is_new` says that the last stamp is the first of a new clock.
    """

    now: float = np.nan
    refused: int = 0
    stamp: float = np.nan
    is_new: bool = False

    def read(self, t: object, dt: float, longest_gap: float) -> "SampleClock":
        """The clock after one more stamp t, which is dt after the last one where it is None.

        Raises
        ------
        JounceError
            If t is no finite number. The clock is as before.
        """
        if t is None:
            return SampleClock(0.0 if np.isnan(self.now) else self.now + dt)
        if not is_finite(t):
            raise JounceError(f"t is {quote_value(t)}; expected the time of the sample in s, or None")
        time = float(t)  # type: ignore[arg-type]
        if not self.now >= time:
            return SampleClock(time)
        increases = self.refused > 0 and 0 < time - self.stamp <= longest_gap
        refused = 1 + self.refused * increases
        if refused == NEW_CLOCK_STAMPS:
            return SampleClock(time, is_new=True)
        return SampleClock(self.now, refused, time)
