"""Stances: which contacts are there along a motion, as the presence of each: 1 while it is there, else 0.

The presence multiplies the inverses of the weights of a contact, so that at 0 it transmits nothing. Blends are
polynomials from 0 to 1 after it comes, and back before it leaves.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from jounce.core.errors import JounceError, as_list, join_names, quote_value
from jounce.core.scalars import is_finite
from jounce.motion.curves import Polynomials

BLEND_DEGREE = 9
MAX_BLEND_SHARE = 0.49  # of a stance, at both of whose ends contacts may be blended
_STEP = np.array([70.0, -315, 540, -420, 126, 0, 0, 0, 0, 0])  # highest power first; four derivatives vanish at 0 and 1


def make_presence(given: Any, blend: Any, start: float, stop: float) -> tuple[tuple[str, ...], Polynomials | None]:
    """The frames that stances name, and the curve of their presence between two times; every argument is checked."""
    stances = as_list(given)
    for entry in stances:
        if not isinstance(entry, Sequence) or len(entry) != 2 or not is_finite(entry[0]):
            raise JounceError(f"stances holds {quote_value(entry)}; expected pairs (time in s, frames of the contacts)")
    if not stances:
        return (), None
    starts = [float(t) for t, _ in stances]
    if starts[0] > start or starts[-1] >= stop or (np.diff(starts) <= 0).any():
        came = f"stances begin at {join_names(f'{t:.6g}' for t in starts)} s"
        raise JounceError(f"{came}; expected times that increase, from {start:.6g} s on, to before {stop:.6g} s")
    ends = np.array([start, *starts[1:], stop])
    longest = MAX_BLEND_SHARE * float(np.diff(ends).min())
    if not is_finite(blend) or not 0 <= blend <= longest:
        came = f"blend is {quote_value(blend)}"
        raise JounceError(f"{came}; expected 0 to {longest:.6g} s, {MAX_BLEND_SHARE} of the shortest stance")
    frames = tuple(dict.fromkeys(frame for _, names in stances for frame in as_list(names)))
    if odd := [frame for frame in frames if not isinstance(frame, str)]:
        raise JounceError(f"stances hold {quote_value(odd[0])}; expected names of frames of contacts")
    there = np.array([[frame in as_list(names) for frame in frames] for _, names in stances], dtype=bool)
    return frames, _join_stances(ends, there, float(blend))


def _join_stances(ends: np.ndarray, there: np.ndarray, blend: float) -> Polynomials:
    """The presence (frames,) between ends where some are there; in flight there is nothing to blend with."""
    powers = np.arange(len(_STEP))[::-1, None]
    one, rise = 1.0 * (powers == 0), _STEP[:, None] / (blend or 1.0) ** powers
    x, c = [ends[0]], list[np.ndarray]()
    stances = [there[0], *there, there[-1]]
    for i, (first, last) in enumerate(pairwise(ends)):
        before, here, after = stances[i : i + 3]
        comes, leaves = (here & ~other & other.any() for other in (before, after))
        pieces = [one * here - (one - rise) * comes, one * here, one * here - rise * leaves]
        c += pieces if blend else pieces[1:2]
        x += [first + blend, last - blend, last] if blend else [last]
    return Polynomials(np.array(x), np.stack(c, axis=1))
