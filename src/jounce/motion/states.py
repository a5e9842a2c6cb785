"""The states along a motion."""

from dataclasses import dataclass, replace

import numpy as np

from jounce._scalars import asarray
from jounce.errors import JounceError, quoted

COMPONENTS = ("mx", "my", "mz", "fx", "fy", "fz")  # of a wrench, (moment; force), in files


@dataclass(frozen=True, eq=False)
class Motion:
    """A motion of a robot: its coordinates with their rates at N times. `jounce.load_motion` makes one.

    Attributes
    ----------
    t : (N,)
        Times in s, increasing.
    rates : tuple of (N, n)
        q, qd, q2d, ...: rad or m, per s, per s^2, ...
    joints : tuple of str
        The names of the coordinates, in the order of the last axis of the rates.
    source : str
        How the rates came about, in words.
    wrench : tuple of dict, or None
        W, Wd, ...: what bodies and merged links exert, {name: (N, 6)}, (moment; force) in N m and N.
    residual : float or None
        Largest distance of the coordinates from the samples that a spline was made of, rad or m.

    Examples
    --------
    >>> import jounce
    >>> motion = jounce.load_motion("paper", jounce.load("iiwa14"), order=0)
    >>> motion.t.shape, [rate.shape for rate in motion.rates]
    ((10000,), [(10000, 7), (10000, 7), (10000, 7)])
    """

    t: np.ndarray
    rates: tuple[np.ndarray, ...]
    joints: tuple[str, ...]
    source: str
    wrench: tuple[dict[str, np.ndarray], ...] | None = None
    residual: float | None = None

    def part(self, which: slice | np.ndarray | int) -> "Motion":
        """The motion at some of its states: a slice, or numbers of states."""
        wrench = self.wrench and tuple({body: W[which] for body, W in rate.items()} for rate in self.wrench)
        return replace(self, t=self.t[which], rates=tuple(rate[which] for rate in self.rates), wrench=wrench)

    def at(self, t: object) -> "Motion":
        """The motion at given times (N,), each of which is one of its own.

        Raises
        ------
        JounceError
            If `t` is no array (N,) of numbers, or a time is not one of `Motion.t`.
        """
        times = np.asarray(asarray(t, "t"))
        if times.ndim != 1 or not times.size or times.dtype.kind != "f" or np.asarray(t).dtype.kind == "b":
            raise JounceError(f"t is {quoted(t)}; expected an array (N,) of times in s, or None for all of the motion")
        which = np.searchsorted(self.t, times).clip(max=len(self.t) - 1)
        [other] = np.nonzero(self.t[which] != times)
        if other.size:
            known = f"the {len(self.t)} times in motion.t, from {self.t[0]:g} to {self.t[-1]:g} s"
            raise JounceError(
                f"t[{other[0]}] = {times[other[0]]:.17g} s is not a time of the motion; expected some of {known}:"
                " states between them cannot be computed yet"
            )
        return self.part(which)
